"""The bench and the results, driven by keys."""

import json
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.errors import EmergencyStopped, OutsideTravel
from drivers.interfaces import Condition
from procedures import assess
from procedures.outcome import Cause, Verdict
from procedures.plan import Ask
from station.app.app import StationApp
from station.app.screens.dialogs import Choose
from station.app.screens.result_view import mtf_plot, plane_in_words, specified
from station.app.screens.results import read_all
from station.app.screens.start import USUAL_PLAN
from station.app.terminal_images import psf_thumbnail
from station.drawing.glyphs import ASCII
from station.drawing.pictures import encoded
from station.guide.catalogue import DEFAULT, PLANS
from station.guide.frontend import Result, RunEnded
from station.results.comparison import Comparison, Compliance, Judgement
from station.results.measurement import RESTORATION
from station.results.plane_result import PlaneResult
from station.results.psf_files import write_psf_result
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder, write_record
from tests.psfs import gaussian

from .driving import BEGIN, PATIENCE_S, START, Absent, Act, play
from .fakes import FakeLab, FakeRun, FakeStage, chosen_step


def nothing(run: FakeRun) -> RunEnded:
    return RunEnded("finished")


@pytest.fixture
def lab(tmp_path) -> FakeLab:
    return FakeLab(tmp_path, nothing)


@pytest.mark.parametrize("size", [(59, 24), (80, 14)])
def test_a_small_window_says_so_and_returns_to_the_screen_when_it_is_larger(lab, size):
    small = "too small", Absent(START), lambda driver: driver.pilot.resize_terminal(80, 24)
    play(StationApp(lab), *small, START, Absent("too small"), size=size)


def test_devices_are_shown_with_what_to_do(lab):
    lab.wire.record(1.5, ">", b"$H\n\x1b[31m")
    start = START, "stage: not homed: the guide homes it; or press F3, then H"
    bench = ["f3"], "not homed. home it", r"> b'$H\n\x1b[31m'", lambda driver: driver.looks_like("bench-80")
    play(StationApp(lab), *start, *bench, ["b"], "no device has the name light")


def test_the_plan_that_is_offered_first_keeps_its_words_when_all_are_loaded():
    assert {DEFAULT: PLANS[DEFAULT].title} == USUAL_PLAN


@pytest.mark.parametrize("key", ["h", "H"])
def test_a_stage_is_homed_and_moved_by_hand(lab, key):
    homed = START, ["f3"], "not homed. home it", [key], "way clear?", lambda driver: not lab.stage.homed, ["enter"]
    moved = ["right_square_bracket", "right"], "z_mm is at 10.000 mm", ["left_square_bracket", "left"]
    play(StationApp(lab), *homed, "is homed", *moved, "z_mm is at 9.000 mm")
    assert lab.stage.place == {"z_mm": 9.0}


def test_an_emergency_stop_takes_a_question_back_that_would_begin_a_movement(lab):
    asked = START, ["f3"], "not homed. home it", ["h"], "way clear?", ["1", "space"], "way clear?"
    back = ["f12", "enter"], lambda driver: not isinstance(driver.app.screen, Choose), ["enter"]
    play(StationApp(lab), *asked, *back)
    assert not lab.stage.homed


def test_a_dark_lamp_asks_before_it_is_lit_and_stays_between_dark_and_full(lab):
    levels = [0.0]
    lab.bench.devices["light"] = SimpleNamespace(  # type: ignore[assignment]
        address="", connect=lab.stage.connect, condition=lambda: Condition("on"), level=lambda: levels[-1],
        set_level=levels.append, emergency_stop=lambda: None, close=lambda: None,
    )  # fmt: skip
    lab.bench.drivers["light"] = "fake"
    begun = START, ["f3"], "not homed. home it", ["d"], "lamp is at 0 %", ["b"], "Do not look into it"
    lit = ["enter"], "lamp is at 10 %", ["b"], "lamp is at 20 %", ["d"], lambda driver: levels[-1] == 0.1
    play(StationApp(lab), *begun, lambda driver: levels == [0.0, 0.0], *lit)


class MovesUntilStopped(FakeStage):
    """A stage that arrives nowhere."""

    def __init__(self) -> None:
        super().__init__()
        self.stopped = threading.Event()

    def move_to(self, **target: float) -> None:
        self.stopped.wait(PATIENCE_S)
        raise EmergencyStopped("emergency stop", "home the stage")

    def emergency_stop(self) -> None:
        super().emergency_stop()
        self.stopped.set()


def test_ctrl_c_stops_an_axis_that_moves(lab):
    lab.stage = lab.bench.devices["stage"] = MovesUntilStopped()
    moves = START, ["f3", "right"], lambda driver: lab.bench.motions.under_way
    play(StationApp(lab), *moves, ["ctrl+c"], "EMERGENCY STOP", lambda driver: not lab.bench.motions.under_way)
    assert lab.stage.stops == 1


def test_a_device_that_refuses_is_a_sentence(lab):
    lab.stage.wrong = OutsideTravel("z_mm 501 lies beyond 0 to 500", "stay inside")
    play(StationApp(lab), START, ["f3", "right"], "z_mm 501 lies beyond 0 to 500. stay inside.")


def write_result(sessions: Path, name: str, width_px: float) -> Path:
    psf = gaussian(width_px)
    good = PlaneResult.of("G1", Verdict.PASS, psf, assess(psf, n=9000))
    others = (Cause("it is blurred", "focus"),)
    bad = PlaneResult("R", Verdict.REFUSED, "too dark", "light the chart", other_causes=others)
    folder = sessions / name / "derived" / "1"
    with ResultFolder(folder) as result:
        write_psf_result(result, [bad, good], RecordHead("pattern"))
    return folder


@pytest.mark.parametrize("size", [(80, 24), (120, 40)], ids=["80x24", "120x40"])
def test_a_result_shows_verdict_numbers_picture_and_curve(lab, tmp_path, size):
    write_result(tmp_path, "2026-03-14-d90", 0.5)
    good = ["f4"], "Plane G1: ✓ trusted", "MTF50, rows", "cycles/pixel"
    bad = ["p"], "Plane R: ✗ refused", "too dark", "light the chart", "- it is blurred; focus"
    play(StationApp(lab), START, *good, lambda driver: driver.looks_like(f"results-{size[0]}"), *bad, size=size)


@pytest.mark.parametrize("refused", [False, True], ids=["restored", "refused"])
def test_a_restoration_is_shown(lab, tmp_path, refused):
    folder = tmp_path / "s" / "derived" / "1"
    record = {"schema": RESTORATION, "procedure": "restoration", "verdict": "refused" if refused else "doubtful"}
    with ResultFolder(folder) as result:
        if not refused:
            ramp = np.tile(np.arange(0, 250, 5, dtype=np.uint8), (20, 1))
            result.write("sharp.png", encoded(".png", ramp))
            record["w"] = {"least": 1.5, "greatest": 7.25, "unit": "pixel"}
        write_record(result, {**record, "reason": "the light differs", "remedy": "expose alike"})
    shown = "w of the depth map: 1.5 to 7.25 pixel", "restored image"
    verdict = "Restoration: ✗ refused" if refused else "Restoration: ? doubtful"
    play(StationApp(lab), START, ["f4"], verdict, "the light differs", *(map(Absent, shown) if refused else shown))


def test_two_results_are_compared(lab, tmp_path):
    write_result(tmp_path, "a", 0.5)
    write_result(tmp_path, "b", 0.6)
    play(StationApp(lab), START, ["f4"], "Plane G1", ["c", "down"], "differ by", ["c"], "Plane G1: ✓ trusted")


@pytest.mark.parametrize(
    "damage",
    [
        lambda folder: (folder / "result.json").write_text("{"),
        lambda folder: (folder / "result.json").write_text(json.dumps({"planes": {"../../x": {}}})),
        lambda folder: (folder / "psf_G1.npy").write_bytes(b"\x93NUMPY"),
        lambda folder: (folder / "mtf_G1.csv").write_text("frequency,radial\n1,x\n"),
    ],
    ids=["record", "plane's name", "psf", "table"],
)
def test_a_damaged_result_is_a_sentence(lab, tmp_path, damage):
    damage(write_result(tmp_path, "a", 0.5))
    play(StationApp(lab), START, ["f4"], "compute the result again")


def in_record(change):
    """Damage that changes the entry of plane G1."""

    def damage(folder: Path) -> None:
        record = json.loads((folder / "result.json").read_text())
        change(record["planes"]["G1"])
        (folder / "result.json").write_text(json.dumps(record))

    return damage


@pytest.mark.parametrize(
    "damage",
    [
        lambda folder: (folder / "result.json").write_text('{"planes": ' + "[" * 100_000 + "]" * 100_000 + "}"),
        in_record(lambda plane: plane["mtf50_radial"].update(n=float("nan"))),
        in_record(lambda plane: plane["mtf50_radial"].update(n=float("inf"), value=10**400)),
        in_record(lambda plane: plane.update(reason=["no", "text"], verdict="doubtful")),
        lambda folder: (np.savez(folder / "x.npz", h=np.eye(3)), (folder / "x.npz").replace(folder / "psf_G1.npy")),
        lambda folder: np.save(folder / "psf_G1.npy", np.empty((0, 0))),
        lambda folder: np.save(folder / "psf_G1.npy", np.full((3, 3), np.nan)),
        lambda folder: (folder / "mtf_G1.csv").write_text("frequency,horizontal,vertical,radial\nnan,nan,nan,nan\n"),
        lambda folder: (folder / "mtf_G1.csv").write_text("frequency,horizontal,vertical,radial\n0,1,1,1\n"),
    ],
    ids=["nested", "n", "infinite n", "reason", "npz", "no samples", "nan", "table of nan", "one frequency"],
)
def test_a_damaged_result_hides_no_other_and_whatever_is_shown_of_it_can_be_drawn(tmp_path, damage):
    damage(write_result(tmp_path, "a", 0.5))
    write_result(tmp_path, "b", 0.5)
    entries = {entry.folder.parent.parent.name: entry for entry in read_all(tmp_path)}
    assert entries["b"].result is not None
    assert (entries["a"].result is None) == bool(entries["a"].wrong)
    if entries["a"].result is not None:
        plane = entries["a"].result.by_name["G1"]
        assert plane_in_words(plane, ASCII)
        psf_thumbnail(plane.samples, "")
        mtf_plot([plane])(60, 20, True)


def test_the_lens_is_judged_by_its_worst_plane_and_what_is_not_met_is_said():
    miss = Judgement("mtf50", Compliance.MISSES, 0.2, 0.01, 0.3, None, "cycles/pixel", "", "MTF50 must be 0.3 at least")
    good, bad = (
        PlaneResult(name, Verdict.PASS, specification=comparison)
        for name, comparison in (("G1", Comparison(Compliance.MEETS)), ("R", Comparison(Compliance.MISSES, (miss,))))
    )
    assert specified([good]) == ["Lens: meets the specification"]
    assert specified([good, bad]) == ["Lens: does not meet the specification", "R: MTF50 must be 0.3 at least"]
    assert specified([PlaneResult("G1", Verdict.PASS)]) == []


@pytest.mark.slow
def test_a_verdict_is_shown_whole_with_what_to_do_and_with_what_the_lens_misses(tmp_path):
    missed = "MTF50 at the centre is 0.212 ± 0.004 cycles/pixel and must be 0.3 at least"
    miss = Judgement("mtf50", Compliance.MISSES, 0.212, 0.004, 0.3, None, "cycles/pixel", "centre", missed)
    good = PlaneResult("G1", Verdict.PASS)
    planes = {"G1": good, "B": replace(good, name="B", specification=Comparison(Compliance.MISSES, (miss,)))}
    planes |= {name: PlaneResult(name, Verdict.REFUSED, "too dark") for name in ("R", "G2")}
    reason, remedy = (
        "plane R: white is at 4 % of the scale and noise leads",
        "expose longer, and take the pictures anew",
    )
    result = Result(tmp_path, planes, Verdict.REFUSED, reason, remedy, (Cause("it is blurred", "focus"),))
    accept = Ask("verdict", "Accept it?", "choice", default="accept", choices=("accept", "retake", "stop"))
    lab = FakeLab(tmp_path, lambda run: chosen_step(run, result, accept))

    def shows(words: str) -> Act:
        return lambda driver: words in without_edges(driver.text)

    words = "Lens: does not meet", f"{reason}. Expose", "the pictures anew.", "must be 0.3 at"
    play(StationApp(lab), BEGIN, *map(shows, (*words, "Other possible causes: it is blurred.", accept.question)))


def without_edges(text: str) -> str:
    """The words right of the rail, as if their lines had not been broken."""
    return " ".join(" ".join(line[26:] for line in text.splitlines()).split())
