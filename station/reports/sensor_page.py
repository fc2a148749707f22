"""The page of a sensor: the plots of EMVA 1288, periodic patterns and defect pixels."""

from procedures.sensor.estimate import SensorResult
from procedures.sensor.spectrograms import Period
from station.common.sanitise import stated
from station.reports.page import Block, Figures, Heading, Items, Note, Table, quantity
from station.reports.report import Report
from station.reports.report_page import SUMMARY_FIGURES, report_page
from station.reports.sensor_figures import sensor_figures
from station.results.plane_result import PlaneResult

MAX_DEFECTS = 40
INTERVALS = Note(
    "95 % intervals of temporal numbers: draws of every level’s mean and variance; of spatial numbers: residual "
    "temporal noise of the mean pictures. They are this sensor’s, not its model’s. By the standard’s sections: "
    "`emva1288.xml`."
)


def sensor_page(report: Report) -> str:
    """The page of all planes."""
    return report_page(report, plane_blocks=_plane_blocks)


def _plane_blocks(plane: PlaneResult) -> list[Block]:
    result: SensorResult | None = plane.estimate
    if result is None:
        return []
    patterns = {which: one for which, one in (("dark", result.dark), ("light", result.light)) if one is not None}
    figures = sensor_figures(result, patterns, plane.name)
    blocks: list[Block] = [Figures(figures[:SUMMARY_FIGURES], summary=True), Figures(figures[SUMMARY_FIGURES:])]
    if periods := [_period_words(period) for pattern in patterns.values() for period in pattern.periods]:
        blocks += [Heading("Periodic patterns"), Items(periods)]
    defects = [
        [which, str(row), str(column), f"{deviation:.4g} {pattern.unit}".replace("-", "−")]
        for which, pattern in patterns.items()
        for (row, column), deviation in zip(pattern.defects.places, pattern.defects.deviation, strict=True)
    ]
    if defects:
        blocks += [Heading("Defect pixels"), Table(defects[:MAX_DEFECTS], ["picture", "row", "column", "deviation"])]
        if (rest := len(defects) - MAX_DEFECTS) > 0:
            blocks.append(Note(f"and {rest} more: `defects_{plane.name}.csv`."))
    return [*blocks, INTERVALS]


def _period_words(period: Period) -> str:
    kind = "Rows" if period.pattern == "row" else "Columns"
    frequency = stated(period.frequency.value, period.frequency.uncertainty)
    return (
        f"{kind} differ with a period of {1 / period.frequency.value:.3f} pixels. Frequency {frequency} cycles/pixel, "
        f"amplitude {quantity(period.amplitude)}."
    )
