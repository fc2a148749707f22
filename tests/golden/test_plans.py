"""All that guided plans ask, say and decide, for a few benches and photographs: `--freeze` writes it anew."""

import pickle
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from procedures import Chart, ProcedureError, estimate_psf
from procedures.field.plan import BEFORE
from procedures.plan import Ask, Estimate, Facts, Give, Go, Known, Look, Plan, Scan, SetLight, Shoot, Show, Tour
from procedures.raw import Plane, RawFrame, read_frame
from procedures.reading.exposure import Exposure
from simulators.bench.demonstration import Staging, stage
from station.guide.catalogue import plan_named
from tests.procedures.two_photo.wall import gaussian, photographs

from .frozen import check_frozen, plain

Frames = dict[str, RawFrame]

LENS = {"focal_length_mm": 50.0, "pixel_pitch_um": 5.94, "f_number": 2.8}
PRINTED = {
    **LENS,
    "paper": "a4",
    "chart_width_mm": 124.0,
    "ruler_mm": 150.3,
    "iso": 100.0,
    "exposure_s": 0.08,
    "views": 3.0,
}
AXES = {"z_mm": (300.0, 0.0, 900.0), "x_mm": (4.0, -50.0, 60.0), "y_mm": (-3.0, -40.0, 40.0)}
HEAD = {"pan_deg": (2.0, -30.0, 40.0), "tilt_deg": (-1.0, -20.0, 20.0)}


def bench(axes: dict[str, tuple[float, float, float]], **more: float | str) -> Facts:
    """Facts of axes at a place with limits."""
    return {f"{end}_{axis}": axes[axis][i] for axis in axes for i, end in enumerate(("at", "low", "high"))} | more


def chart_frames(folder: Path, side: int, **stagings: dict[str, Any]) -> Frames:
    """Photographs of the chart."""
    frames = {}
    for seed, (name, words) in enumerate(stagings.items()):
        exposure_s, iso = words.pop("light", (0.08, 100))
        staging = Staging(name, name, **{"at": (0.5, 0.5), "s_over_t": 1.3, "rows": side, "columns": side, **words})
        camera, scene = stage(staging, Chart.from_seed())
        path, rng = folder / f"{name}.dng", np.random.default_rng(seed)
        replace(camera, oversampling=5).photograph(scene, rng, path, exposure_s=exposure_s, iso=iso)
        frames[name] = read_frame(path)
    return frames


def of_pattern(folder: Path) -> tuple[list[Facts], Frames]:
    frames = chart_frames(
        folder, 280, right={}, askew={"at": (0.56, 0.45), "yaw_deg": 6.0, "pitch_deg": -3.0, "slope": (0.2, 0.05)},
        far={"s_over_t": 1.0, "roll_deg": 8.0, "light": (0.01, 400)},
    )  # fmt: skip
    rig = bench({**AXES, **HEAD}, distance_mm=7720.0, laser_offset_mm=80.0, focus_by="rail", wanted_mtf50=0.004)
    frames["far"] = replace(frames["far"], exposure=replace(frames["far"].exposure, f_number=None))
    typed = {"f_number": None, "typed_f_number": 16.0}
    kept = {name: one for name, one in {**PRINTED, **rig, **typed}.items() if one is not None}
    return [PRINTED, kept], frames


def of_wall(folder: Path) -> tuple[list[Facts], Frames]:
    pair = photographs(gaussian(0.42, 0.37), tilt=0.04)
    planes = {"near": pair.near, "far": pair.far, "dim": 0.6 * pair.far, "bright": 1.3 * pair.near}
    frames = {
        name: RawFrame(Path(name), name, {"Y": Plane("Y", np.float32(one), 1 / 16383)}, Exposure(exposure_s=0.02))
        for name, one in planes.items()
    }
    predicted = "3.2 0.004, 4 0.0045, 5 0.005, 6.3 0.006"
    hand = {"near_mm": 1000.0, "ratio": 4.4, "near_level": 0.5, "predicted": predicted, "farther": 2.0}
    rail = bench({"z_mm": (200.0, 0.0, 6200.0), **HEAD}, near_z_mm=100.0, distance_mm=1120.0, near_laser_mm=1110.0)
    short = {**rail, "high_z_mm": 2000.0, "far_way_mm": 3400.0}
    wrong = [{"distance_mm": 1700.0}, {"far_way_mm": 2400.0, "insisted_near_mm": True}, {"exposure_s": 0.05}]
    return [{"near_mm": 900.0}, hand, *({**hand, **one} for one in (rail, short, *wrong))], frames


def of_field(folder: Path) -> tuple[list[Facts], Frames]:
    frames = chart_frames(folder, 600, middle={}, corner={"at": (0.3, 0.28), "roll_deg": 3.0})
    begun = {"rows": 300.0, "columns": 300.0, "principal_px": 4240.0, "distance_mm": 7600.0, "x": 0.5, "y": 0.51}
    tour = {f"tour_{name}": one for name, one in {**begun, "half_x": 0.15, "half_y": 0.16}.items()}
    known = {**PRINTED, **tour, "places": 6.0, "distance_mm": 7700.0}
    poses = {"x_mm": 30.0, "y_mm": -200.0, "z_mm": 7600.0, "yaw_deg": 12.0, "pitch_deg": 5.0, "roll_deg": 1.0}
    known |= {f"view_0_{name}": one for name, one in poses.items()}  # no two next views are equally good
    rigs = bench({"z_mm": AXES["z_mm"], **HEAD}), bench(AXES, aim="20,30")
    began = [{f"tour_from_{name[3:]}": one for name, one in rig.items() if name[:3] == "at_"} for rig in rigs]
    return [known, *({**known, **rig, **start} for rig, start in zip(rigs, began, strict=True))], frames


MADE: dict[str, Callable[[Path], tuple[list[Facts], Frames]]] = {
    "pattern": of_pattern, "two-photo": of_wall, "field": of_field, "geometry": of_field,
}  # fmt: skip


@pytest.fixture
def estimated_once(monkeypatch):
    """Equal planes with equal parameters have one estimate."""
    known: dict[bytes, Any] = {}

    def remembered(*given: Any) -> Any:
        key = pickle.dumps(given)
        if key not in known:
            known[key] = estimate_psf(*given)
        return known[key]

    for module in ("pattern_psf.plan", "pattern_psf.checks", "pattern_psf.focus.sharpness", "field.plan"):
        monkeypatch.setattr(f"procedures.{module}.estimate_psf", remembered)


def got(function: Callable[..., Any], *given: Any) -> Any:
    """A result, or the sentence of a refusal."""
    try:
        return plain(function(*given))
    except ProcedureError as error:
        return f"{error.reason}; {error.remedy}"


def answers(request: Any, facts: Facts, frames: Frames, known: Known) -> Iterator[Any]:
    """What one request gives for facts and frames."""
    each = frames.values()
    if isinstance(request, Ask):
        yield [got(one, facts) for one in (request.when, request.given, request.proposed)]
        yield [
            got(request.check, one, facts) for one in (request.low, request.default, request.high) if one is not None
        ]
        yield plain([request.default, request.low, request.high, request.choices])
    elif isinstance(request, Go):
        yield [got(one, facts) for one in (request.to, request.say, request.by_hand)]
    elif isinstance(request, SetLight):
        yield got(request.level, facts)
    elif isinstance(request, Show):
        yield got(request.diagram, facts)
    elif isinstance(request, Look):
        yield [request.tries, got(request.when, facts), *(got(request.check, one, facts) for one in each)]
    elif isinstance(request, Scan):
        places = request.places(facts)
        yield [plain(list(places)), *(request.say(change) for change in (-2.0, 1.0, 1.5))]
        yield [got(request.score, one, facts) for one in each] if places else []
        for scores in ([5, 8, 9, 7, 2], [1, 2, 3, 4, 5], [np.nan] * 5, [np.nan, 2, 3, 2.5, np.nan]):
            yield got(request.choose, places, np.array(scores, float)) if len(places) == len(scores) else None
    elif isinstance(request, Tour):
        for stop in request.stops(facts):
            yield [stop.name, got(stop.go.to, facts), got(stop.go.say, facts), got(stop.goal, facts)]
        yield [got(stop.check, one, facts) for stop in request.stops(facts)[:2] for one in each]
    elif isinstance(request, Shoot):
        yield [request.most, *(got(request.check, one, facts) for one in each)]
        results: list[Any] = []
        for one in list(each)[:2]:
            results.append(request.estimate(one, facts, results, known))
            yield got(request.enough, results, facts)


def walked(plan: Plan, facts: Facts, frames: Frames) -> dict[str, Any]:
    """What the steps of a plan give, by step, without those that it shares with the pattern's."""
    known: Known = {}
    return {
        step.name: [got(step.value, facts), got(step.when, facts)]
        + [list(answers(one, facts, frames, known)) for one in step.requests if not isinstance(one, Give | Estimate)]
        for step in plan.steps
        if plan.name == "pattern" or step.name not in BEFORE
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", MADE)
def test_plans_ask_and_decide_as_they_did(name, tmp_path, request, estimated_once):
    every, frames = MADE[name](tmp_path)
    frames["empty"] = replace(
        frames[next(iter(frames))], planes={"Y": Plane("Y", np.full((90, 90), 0.3, np.float32), 1e-4)}
    )
    found = [walked(plan_named(name), facts, frames) for facts in every]
    check_frozen(request, f"plan_{name}", found)
