"""A batch of every procedure of the registry: limits, record and schema, page, certificate, and no work done twice."""

import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import jsonschema
import numpy as np
import pytest

from procedures.field import conclusion, measuring
from procedures.field.maps import derive
from procedures.outcome import Outcome
from station.batch.run import batch_schema
from station.calibration import geometry as geometry_module
from station.calibration import tilt as tilt_module
from station.demo.small_inputs import tilted_sensor
from station.procedure.base import Settings
from station.procedure.schema import BUILTIN, procedure_named, schema_of
from tests.golden import cases
from tests.program import run
from tests.station.cli.test_refocus import write_restored
from tests.station.cli.test_stability import write_results

pytestmark = pytest.mark.slow
SAMPLES = "parameters = { s = 3, k = 13 }\n"
PLANE = f'planes = ["G1"]\n{SAMPLES}'


def made(case: Callable[[Path], object], text: str) -> Callable[[Path, pytest.MonkeyPatch], str]:
    """The inputs of a golden case, and the text of a procedure file."""

    def make(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
        case(folder)
        return text

    return make


def correct(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    cases.correct(folder)
    shutil.move(folder / "grey.h5", folder.parent / "grey.h5")
    return '[settings]\nfield = "grey.h5"\niterations = 2\n'


def sharpen(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    correct(folder, monkeypatch)
    return '[settings]\nfield = "grey.h5"\n'


def photographs(folder: Path) -> None:
    for at in range(3):
        cases.save(folder / f"{at}.png", np.full((8, 8), 0.5))


def geometry(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The views are those of the golden record: charts would take minutes to render."""
    photographs(folder)
    monkeypatch.setattr(geometry_module, "measure_views", lambda *given: [cases.geometry_shoot()])
    return '[settings]\nmodel = "OPENCV"\n'


def tilt(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    photographs(folder)
    (folder / "focus.csv").write_text("0.png,0\n1.png,0.1\n2.png,0.2\n")
    monkeypatch.setattr(measuring, "measure", lambda *given: SimpleNamespace(frames=[], misses=[]))
    monkeypatch.setattr(tilt_module, "measure_tilt", lambda *given: Outcome(tilted_sensor()))
    monkeypatch.setattr(tilt_module, "known_optics", lambda *given: (4.0, 50.0))
    monkeypatch.setattr(tilt_module, "check_known", lambda *given: None)
    return '[settings]\nfocus = "focus.csv"\nscrew_radius_mm = 30\nscrew_pitch_mm = 0.5\n'


def rig(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    cases.rig(folder)
    (folder.parent / "rigs.csv").write_text("left/result.json,right/result.json\n")
    return 'pairs = { table = "rigs.csv" }\n'


def stability(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    names = [f"{one.name}/result.json" for one in write_results(folder)]
    (folder.parent / "results.csv").write_text(",".join(names) + "\n")
    return 'pairs = { table = "results.csv" }\n'


def refocus(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    write_restored(folder)
    return "[settings]\nf_number = 2\nfocus_m = 0.5\n"


def pattern(folder: Path) -> None:
    cases.chart_photograph(folder / "photo.dng", 1)


RESTORE = '[settings]\nblur = "defocus"\nshape = "gaussian"\nratio = 1.5\nmax_w = 6\nscheme = "1x(2+2)+1x2"\n'
BATCHES: dict[str, tuple[Callable[[Path, pytest.MonkeyPatch], str], str]] = {
    "correct": (correct, "noise_gain"),
    "edge": (made(cases.edge, ""), "mtf50"),
    "field": (made(cases.field, SAMPLES), "mtf50_horizontal"),
    "geometry": (geometry, "fx"),
    "pattern": (made(pattern, PLANE), "mtf50_horizontal"),
    "rays": (made(cases.rays, "[settings]\nscales = 1\nthreads = 1\n"), "similar_patches"),
    "refocus": (refocus, "depth_of_field_near"),
    "restore": (made(cases.restoration, RESTORE), "w_median"),
    "rig": (rig, "baseline"),
    "sensor": (made(cases.sensor, '[settings]\nplane = "G1"\n'), "system_gain"),
    "series": (made(pattern, PLANE), "mtf50_horizontal"),
    "sharpen": (sharpen, "noise_gain"),
    "stability": (stability, "mtf_sensitivity"),
    "tilt": (tilt, "tilt_horizontal"),
    "two-photo": (made(cases.two_photo, 'pairs = { near = "near", far = "far" }\n' + SAMPLES), "mtf50_horizontal"),
    "witnessed": (made(cases.witnessed, f"{SAMPLES}[settings]\nexposure_ratio = 2\n"), "mtf50_horizontal"),
    "vignetting": (made(cases.vignetting, ""), "corner_light"),
}
"""Inputs and procedure file, and a number that has a limit."""
LONG = {"correct", "field", "pattern", "sensor", "series", "sharpen", "two-photo", "witnessed"}
"""Those whose measuring takes more than a second, with inputs of a kind that others have too."""


def test_every_procedure_is_here():
    assert BATCHES.keys() == BUILTIN.keys()


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=pytest.mark.nightly) if one in LONG else one for one in BUILTIN]
)
def test_a_batch_measures_compares_records_draws_and_certifies(name, tmp_path, monkeypatch):
    procedure, (make, number), photographs = procedure_named(name), BATCHES[name], tmp_path / "in"
    photographs.mkdir()
    text = make(photographs, monkeypatch)
    where = ', place = "centre"' if name == "field" else ""  # its charts do not enclose the corners
    limits = f"[limits]\n{number} = {{ min = 0.001{where} }}\n"
    (tmp_path / "p.toml").write_text(f'procedure = "{name}"\n{text}{limits}')
    assert issubclass(procedure.Settings, Settings)
    measured = []
    measure = type(procedure).measure
    monkeypatch.setattr(type(procedure), "measure", lambda *given: measured.append(measure(*given)) or measured[-1])
    monkeypatch.setattr("station.batch.run._answers", here)
    monkeypatch.setattr(conclusion, "derive", partial(derive, columns=7))  # maps of a ninth of their places
    words = ("batch", photographs, "--procedure", tmp_path / "p.toml", "--out", tmp_path / "out", "--reports", "--json")
    done = run(*words)
    batch = json.loads(done.stdout)
    jsonschema.validate(batch, batch_schema(), jsonschema.Draft202012Validator)
    assert (batch["procedure"], batch["photographs"], batch["specification_verdicts"]) == (name, 1, {"meets": 1})
    (folder,) = (tmp_path / "out" / "results").iterdir()
    record = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    chosen = procedure_named(record["procedure"]) if name == "sharpen" else procedure
    jsonschema.validate(record, schema_of(chosen), jsonschema.Draft202012Validator)
    assert record["specification"]["verdict"] == "meets"
    assert (folder / procedure.page_name).is_file() == procedure.has_page
    assert procedure.report(measured[0]).procedure
    done = run(*words, code=None)
    assert json.loads(done.stdout)["reused"] == 1


def here(items, job, *given):
    """The answers of this process."""
    from station.batch.item import work

    return ((number, work(item, job)) for number, item in enumerate(items))
