"""Why a result has its verdict and its uncertainty: most likely cause, largest terms of the budget, remedies."""

import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.choice import TERMS
from procedures.numbers import PIXELS_PER_PATTERN, SYSTEM_GAIN, Group, in_group
from procedures.outcome import BadInput, Verdict
from station.common.sanitise import printable, stated
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.reader import read_record
from station.results.result_files import RECORD

DERIVED = "derived"
EDGES = "edges"
BUDGETS, BRIGHTER = "budgets", "with_four_times_the_light"
"""Entries of a restoration: budgets by number, and the picture's expected error."""
SENSOR_SAMPLES = "photograph RAW; if the picture holds a sensor's samples, state it by --raw ORDER,BLACK,WHITE"
OWN = {
    "points": ("noise of the chart's points", "photograph four times as many views, or the chart larger and sharper"),
    "flatness": (
        "flatness of the chart",
        "fix the chart on a plane, rigid sheet, and turn it in its plane between the views",
    ),
    "model": ("model of the camera", "photograph the chart all over the frame, tilted to all sides"),
    "shutter": ("time between the rows", "hold the camera still, or move the chart faster in the video"),
    "scale": ("scale of the chart", "measure the chart with a better ruler, and give its record by --scale"),
    "squareness": ("squareness of the chart", "square the chart more exactly, and give --chart-tilt-deg"),
    "slope": ("slope of the flats' light", "take flats in more turns of the camera, or make their light more even"),
    "curvature": ("curvature of the response", "use the gain at dark, which is corrected for it"),
    "bins": ("aliases of the bins", "photograph the noise chart, whose estimate has no bins"),
    "scatter": ("displacements along the edge", "use a straighter edge, and hold the camera still"),
    "sharpening": ("unsharp mask not excluded", "switch off sharpening, or photograph RAW"),
    "overshoot": ("wide mask not excluded", "switch off clarity and local contrast, or photograph RAW"),
    "tone": ("tone curve not excluded", SENSOR_SAMPLES),
    "contrast": ("S-shaped tone curve not excluded", SENSOR_SAMPLES),
    "shapes": (
        "disagreement of blur and photographs",
        "measure the shapes of the blur again, and check that nothing moved",
    ),
    "detail": (
        "detail that the blur has removed",
        "take a third photograph with another blur, which keeps what these suppress",
    ),
    "kernels": ("other kernels that explain the photographs as well", "record the motion, or give measured kernels"),
    "development": ("rounding and coding of the files", "give RAW files"),
}
"""Terms of other results than PSFs: in words, and the remedy."""
REMEDIES = {
    "noise": "take four times as many photographs, or give four times the light",
    "light": "light the chart evenly, within 10 % from corner to corner",
    "sensor": "measure the sensor again with more frames per level",
    "geometry": "mount the chart flat, and photograph it from the front",
    "print": "print the chart larger, or with a finer printer",
    "print blur": "print the chart larger, or photograph it from farther away",
    "tail": "give --f-number and --pixel-pitch-um, which fix the far tail",
    "mismatch": "check focus and flatness: the model does not explain the photograph down to its noise",
    "processing": "switch off sharpening and denoising, or photograph RAW",
    "wide mask": "switch off clarity and local contrast, or photograph RAW",
    "ghost": "keep bright surfaces out of the frame, and photograph the chart on a dark wall",
    "variation": "use a smaller chart, or one nearer to the frame's centre",
    "focus": "focus again at either distance, or leave the focus",
    "choice": "photograph the chart larger, so that s and k matter less",
    **{term: remedy for term, (_, remedy) in OWN.items()},
}
WORDS = {**TERMS, **{term: words for term, (words, _) in OWN.items()}}
NEXT_VIEW = "next_view"
TWIN, PREDICTED = {PIXELS_PER_PATTERN, EDGES, "scale", SYSTEM_GAIN}, {NEXT_VIEW, BRIGHTER}
"""Entries of planes whose subject the digital twin photographs, and of those whose own model predicts a gain."""
OUTLIER = 3.5
"""Robust standard deviations from the median: B. Iglewicz, D. Hoaglin, How to detect and handle outliers, ASQC 1993."""
LEAST_VALUES = 5
"""Values among which an outlier can be recognised."""
MAD = 1.4826
"""Standard deviation over median absolute deviation of a normal distribution."""
PLANE = re.compile(r"^(R|G1|G2|B|Y): ")
"""Beginning of a batch's reason."""
HALVED = ("noise", "points")
"""Terms that the remedy halves; the others are removed at best."""


@dataclass(frozen=True)
class BudgetShare:
    """A term of a number's budget: its share of the variance, the remedy, and the uncertainty with that."""

    term: str
    share: float
    remedy: str
    uncertainty_then: float


@dataclass(frozen=True)
class PlaneExplanation:
    """A plane: cause, limits not met, headline `number` in words, "" without one, its budget, largest term first."""

    plane: str
    verdict: str
    reason: str
    remedy: str
    number: str = ""
    value: str = ""
    uncertainty: float = 0.0
    terms: Sequence[BudgetShare] = field(default_factory=tuple)
    against: Sequence[str] = ()


@dataclass(frozen=True)
class CauseCount:
    """A cause in a batch, its remedy, and the number of photographs that have it."""

    count: int
    reason: str
    remedy: str


@dataclass(frozen=True)
class BatchExplanation:
    """A batch: causes of what did not pass, photographs whose headline number is an outlier, in words, and the folder
    of the photograph that passed with the median uncertainty, "" without one."""

    causes: Sequence[CauseCount]
    outliers: Sequence[str] = ()
    typical: str = ""


def result_folder(path: Path) -> Path:
    """The folder of a result: the path, that of its record, or the last result of a session. Raises BadInput."""
    folder = path.parent if path.name == RECORD else path
    results = sorted(folder.glob(f"{DERIVED}/*/{RECORD}"), key=lambda one: (len(one.parent.name), one.parent.name))
    if results:
        return results[-1].parent
    if not (folder / RECORD).is_file():
        raise BadInput(f"{printable(path)} holds no result", "name the folder of a result, a session or a batch")
    return folder


def is_batch(folder: Path) -> bool:
    """Whether the result is that of a batch."""
    return str(read_record(folder).get("schema", "")).startswith("station/batch/")


def explain_result(measurement: Measurement) -> list[PlaneExplanation]:
    """The explanation of every plane, that of the worst verdict first."""
    planes = sorted(measurement.planes, key=lambda one: -one.verdict.rank)
    return [_explain_plane(plane) for plane in planes]


def _explain_plane(plane: PlaneResult) -> PlaneExplanation:
    against = plane.specification.against if plane.specification else ()
    plain = PlaneExplanation(plane.name, str(plane.verdict), plane.reason, plane.remedy, against=against)
    known = [name for name in in_group(Group.LINE) if name in {**plane.numbers, **plane.values}]
    name = next((name for name in known if _budget(plane, name)), next(iter(known), ""))
    number, budget = plane.numbers.get(name), _budget(plane, name)
    if plane.verdict is Verdict.REFUSED or not name:
        return plain
    total = sum(part**2 for part in budget.values())
    saved = {term: 0.75 if term in HALVED else 1.0 for term in budget}  # of a term's variance, at best
    shares = [
        BudgetShare(term, part**2 / total, REMEDIES.get(term, ""), math.sqrt(total - saved[term] * part**2))
        for term, part in sorted(budget.items(), key=lambda item: -item[1])
        if part > 0
    ]
    if number is None:  # itself an uncertainty
        return replace(
            plain, number=name, value=f"{plane.values[name]:.2g}", uncertainty=total**0.5, terms=tuple(shares)
        )
    value = f"{stated(number.value, number.uncertainty)} {number.unit}".removesuffix(" 1")
    return replace(plain, number=name, value=value, uncertainty=number.uncertainty, terms=tuple(shares))


def _budget(plane: PlaneResult, name: str) -> Mapping[str, float]:
    """The budget of a number of a plane; empty if it has none."""
    entry: Any = plane.details.get(name)
    several: Any = plane.details.get(BUDGETS, {})
    budget = entry.get("budget") if isinstance(entry, dict) else several.get(name) or _mean_budget(plane, name)
    known = {} if not isinstance(budget, dict) else budget
    return {term: float(one) for term, one in known.items() if term in WORDS and isinstance(one, int | float)}


def _mean_budget(plane: PlaneResult, name: str) -> dict[str, float] | None:
    """The mean variances of a number's terms over the edges of a plane, scaled to its uncertainty; None without any."""
    entries = [edge.get(name) for edge in plane.details.get(EDGES, [])]
    budgets = [entry["budget"] for entry in entries if isinstance(entry, dict) and "budget" in entry]
    if not budgets or name not in plane.numbers:
        return None
    root = {term: math.hypot(*(budget.get(term, 0.0) for budget in budgets)) for term in budgets[0]}
    scale = plane.numbers[name].uncertainty / (math.hypot(*root.values()) or 1.0)
    return {term: scale * one for term, one in root.items()}


def explain_batch(folder: Path) -> BatchExplanation:
    """Causes, outliers and a typical photograph. Raises BadInput if the rows are damaged."""
    causes: Counter[tuple[str, str]] = Counter()
    headlines: list[tuple[float, float, Mapping[str, Any]]] = []
    path = folder / "results.jsonl"
    try:
        for line in path.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            if row.get("reason"):
                reason = PLANE.sub("", row["reason"])
                for one in row["files"]:
                    reason = reason.replace(one, "the photograph").replace(Path(one).name, "the photograph")
                causes[(reason, row["remedy"])] += 1
            elif (known := _headline(row)) is not None:
                headlines.append((float(known["uncertainty"]), float(known["value"]), row))
    except (OSError, ValueError, KeyError, AttributeError, TypeError) as error:
        raise BadInput(f"{printable(path)} cannot be read: {error}", "run the batch again") from error
    counted = [CauseCount(count, *cause) for cause, count in causes.most_common()]
    if not headlines:
        return BatchExplanation(counted)
    uncertainties, values, rows = zip(*headlines, strict=True)
    odd = [f"{printable(', '.join(rows[i]['files']))}: {stated(values[i], uncertainties[i])}"
           for i in np.flatnonzero(outliers(values, values, uncertainties))]  # fmt: skip
    middle = rows[int(np.argsort(uncertainties)[len(rows) // 2])]
    return BatchExplanation(counted, odd, str(folder / middle["folder"]))


def _headline(row: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The headline number of a row's first plane that has one with an uncertainty."""
    numbers = [plane["numbers"] for plane in row["planes"].values()]
    known = (one[name] for one in numbers for name in in_group(Group.LINE, one) if "uncertainty" in one[name])
    return next(known, None)


def outliers(
    known: Sequence[float] | npt.NDArray[np.float64], values: npt.ArrayLike, uncertainties: npt.ArrayLike
) -> npt.NDArray[np.bool_]:
    """Which values with standard uncertainties are outliers among the known ones."""
    middle = np.median(known)
    spread = MAD * np.median(np.abs(np.asarray(known) - middle))
    away: npt.NDArray[np.bool_] = np.abs(np.asarray(values) - middle) > OUTLIER * np.hypot(spread, uncertainties)
    return away & (np.size(known) >= LEAST_VALUES)
