"""What a calibration with the chart knows: print, lens, sensor, what was looked at, and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from procedures.choice import START_K, START_S
from procedures.facts import CameraFacts, derived_from, gathered, number, required
from procedures.pattern import AIM_S_OVER_T, BEST_S_OVER_T, DEFAULT_SEED, Chart
from procedures.pattern_print.distance import PHOTOSITES_PER_PIXEL
from procedures.pattern_print.paper import ISO_PAPERS, Paper, paper_named
from procedures.pattern_print.rulers import LENGTH_MM
from procedures.pattern_print.sheet import Size, largest_width_mm
from procedures.pattern_psf.estimate import PatternParameters
from procedures.pattern_psf.pose import Optics
from procedures.plan import Facts
from procedures.quality import CAMERA, OPERATOR, WAVELENGTHS_NM, Diffraction
from procedures.raw import Plane

RATIO, (RATIO_LOW, RATIO_HIGH) = AIM_S_OVER_T, BEST_S_OVER_T
"""Aim and tolerance of s/t. At 1 the chart is as fine as the PSF's samples; with a camera that is sharper than its
pixels, the same number of shots has half the error at 1.3 (simulated: 24 mm at f/5.6 on pixels of 11.9 um)."""
SIZES = ("focal_length_mm", "pixel_pitch_um", "chart_width_mm", "ruler_mm")
"""The numbers by which a chart's size tells its distance."""
LOOKS = "range_"
MOSAIC, MONOCHROME = SENSORS = ("mosaic", "monochrome")


@dataclass(frozen=True)
class RangeLook:
    """How large the chart appeared, and what laser and rail then said; None where there is none."""

    px_per_cell: float
    laser_mm: float | None = None
    rail_mm: float | None = None


def looks_of(facts: Facts) -> tuple[RangeLook, ...]:
    """The looks at the chart from its distances, in their order. Raises BadParameter."""
    count = int(number(facts, f"{LOOKS}looks")) if f"{LOOKS}looks" in facts else 0
    return tuple(_look(facts, f"{LOOKS}{i}_") for i in range(1, count + 1))


def _look(facts: Facts, start: str) -> RangeLook:
    laser_mm, rail_mm = (
        number(facts, name) if (name := f"{start}{what}_mm") in facts else None for what in ("laser", "rail")
    )
    return RangeLook(number(facts, f"{start}cell_px"), laser_mm, rail_mm)


@lru_cache(maxsize=4)
def chart_of(seed: int) -> Chart:
    """The chart of a seed."""
    return Chart.from_seed(seed)


@dataclass(frozen=True)
class PatternFacts(CameraFacts):
    """The facts of the plan with the chart.

    Attributes
    ----------
    paper : in the printer; None where it was not asked, as in sessions of earlier versions
    chart_width_mm : as ordered; None where nothing was ordered
    chart_seed : of its cells; the station's own where none was given
    seed_agreement : correlation of the cells seen with the seed's; None before they were looked at
    ruler_mm : what the printed ruler measured; None is a print that is taken for true
    sensor_kind : one of `SENSORS`, as a photograph told it, else as it was typed; not known, it is taken for a mosaic
    s, k : how the PSF shall be sampled; None lets the photograph choose
    laser_offset_mm : of the rangefinder's zero behind the lens
    looks : at the chart from its distances
    focus_by : "ring", "rail" or "skip"
    white_percent, s_over_t, tilt_deg, focus_mtf50, mtf50_uncertainty : what the steps gave, as the rail shows it: white
        on the sensor's scale, the sampling ratio, the larger of yaw and pitch, the sharpness, its standard uncertainty
    wanted_mtf50 : standard uncertainty to reach, in cycles/pixel
    tape_mm : distance of the chart by a tape measure, where there is neither laser nor rail
    typed_f_number : as the operator told it, where the camera noted none
    """

    paper: str | None = None
    chart_width_mm: float | None = None
    chart_seed: int = DEFAULT_SEED
    seed_agreement: float | None = derived_from("chart_seed")
    ruler_mm: float | None = None
    sensor_kind: str = MOSAIC
    s: int | None = None
    k: int | None = None
    laser_offset_mm: float | None = derived_from(*SIZES)
    looks: tuple[RangeLook, ...] = gathered(looks_of, "chart_width_mm", "tape_mm", prefix=LOOKS)
    focus_by: str = "ring"
    white_percent: float | None = None
    s_over_t: float | None = None
    tilt_deg: float | None = None
    focus_mtf50: float | None = None
    mtf50_uncertainty: float | None = None
    wanted_mtf50: float | None = None
    tape_mm: float | None = None
    typed_f_number: float | None = None

    @property
    def aperture(self) -> float | None:
        """The f-number: as the camera noted it, else as it was typed; None where neither is known."""
        return self.typed_f_number if self.f_number is None else self.f_number

    def diffraction(self, plane: Plane) -> Diffraction | None:
        """What limits the plane, where aperture and pixels are known."""
        if self.aperture is None or self.pixel_pitch_um is None:
            return None
        by = OPERATOR if self.f_number is None else CAMERA
        return Diffraction(self.aperture, self.pixel_pitch_um * plane.pitch, WAVELENGTHS_NM[plane.name[0]], by)

    @property
    def chart(self) -> Chart:
        """The chart that was printed."""
        return chart_of(self.chart_seed)

    @property
    def size(self) -> Size:
        """Of the print, as ordered; the largest that the paper holds where nothing was ordered yet."""
        if self.chart_width_mm is None:
            return Size(largest_width_mm(self.printed_on or ISO_PAPERS[0]))
        return Size(self.chart_width_mm)

    @property
    def printed_on(self) -> Paper | None:
        """The paper in the printer. Raises BadParameter where no paper has the name."""
        return None if self.paper is None else paper_named(self.paper)

    @property
    def cell_mm(self) -> float:
        """Side of a printed cell: as ordered, corrected by what the printed ruler measured. Raises BadParameter."""
        width = required(self.chart_width_mm, "the chart's width", "answer the step `print`")
        return Size(width).cell_mm * (LENGTH_MM if self.ruler_mm is None else self.ruler_mm) / LENGTH_MM

    @property
    def parameters(self) -> PatternParameters:
        """How the PSF is to be sampled: as the facts say, else as the photograph lets the program choose."""
        if self.s is None or self.k is None:
            return PatternParameters()
        return PatternParameters(self.s, self.k, chosen=True)

    @property
    def quick_parameters(self) -> PatternParameters:
        """How a PSF is sampled whose sharpness alone is asked, many times over."""
        asked = self.parameters
        return asked if asked.s is not None else PatternParameters(START_S, START_K, chosen=True)

    @property
    def plane_pitch(self) -> int:
        """Photosites from one pixel of a plane to the next, by the kind of sensor."""
        return 1 if self.sensor_kind == MONOCHROME else PHOTOSITES_PER_PIXEL

    @property
    def lens_known(self) -> bool:
        """Whether sizes tell distances."""
        return None not in (self.focal_length_mm, self.pixel_pitch_um, self.chart_width_mm)

    def optics(self, pitch: int | None = None) -> Optics:
        """What tells distances from sizes, for planes of so many photosites a pixel; None: as the kind of sensor has.

        Raises BadParameter.
        """
        remedy = "answer the step `distance`"
        focal_length_mm = required(self.focal_length_mm, "the lens's focal length", remedy)
        pitch_um = required(self.pixel_pitch_um, "the distance of the sensor's pixels", remedy)
        return Optics(focal_length_mm, pitch_um * (pitch or self.plane_pitch), self.cell_mm)

    @property
    def wanted_px_per_cell(self) -> float:
        """Pixels of the plane per cell at the s/t that is aimed at."""
        return RATIO / self.s_or_start

    @property
    def s_or_start(self) -> int:
        """Samples per pixel, as given or as the choice begins."""
        return self.parameters.s or START_S

    def wanted_distance_mm(self) -> float:
        """From how far to photograph, by the lens, the sensor and the print. Raises BadParameter."""
        return self.optics().distance_mm(self.wanted_px_per_cell)
