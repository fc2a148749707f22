"""The public API: every name exists, is typed, is loaded on first use, and is used in an example of the manual."""

import ast
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import procedures
from simulators.bench.demonstration import EXPOSURE_S, ISO, Staging, stage
from simulators.camera.camera import true_mtf

ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / "station" / "manual" / "how-to" / "library.md", ROOT / "README.md")


def python_blocks(page: Path) -> list[str]:
    """The Python blocks of a page."""
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def five_lines(page: Path) -> str:
    """The first of them."""
    return python_blocks(page)[0]


def photographed(folder: Path) -> Any:
    """photo.dng of a chart before the demonstration's lens, in a folder; the optics that drew it."""
    staging = Staging("small", "Small", (0.5, 0.5), 1.0, rows=260, columns=260)
    camera, scene = stage(staging, procedures.Chart.from_seed())
    path, rng = folder / "photo.dng", np.random.default_rng(3)
    return camera.photograph(scene, rng, path, exposure_s=EXPOSURE_S, iso=ISO).truths[0].optics


def in_python(code: str, folder: Path, **environ: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **environ},
    )  # fmt: skip


def test_stub_and_program_have_the_same_names_and_no_others():
    stub = ast.parse(Path(procedures.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    (listed,) = (ast.literal_eval(node.value) for node in stub.body if isinstance(node, ast.Assign))
    assert listed == sorted(listed) == procedures.__all__
    assert all(getattr(procedures, name) is not None for name in listed)
    with pytest.raises(AttributeError, match="attribute psf_of_everything"):
        procedures.psf_of_everything  # noqa: B018


def test_import_loads_nothing_by_itself(tmp_path):
    code = "import sys, procedures; print('numpy' in sys.modules, 'estimate_psf' in dir(procedures))"
    done = in_python(code, tmp_path, PYTHONPATH=str(ROOT))
    assert done.stdout.split() == ["False", "True"], done.stderr


@pytest.mark.slow
def test_five_lines_tell_the_camera_s_mtf50_with_its_error_bar(tmp_path, monkeypatch, capsys):
    optics = photographed(tmp_path)
    monkeypatch.chdir(tmp_path)
    exec(five_lines(PAGES[0]), {})
    lines = re.findall(r"(\w+) = (\S+) ± (\S+)", capsys.readouterr().out)
    printed = {name: (float(value), float(bar)) for name, value, bar in lines}
    value, uncertainty = printed["mtf50_horizontal"]
    f = np.arange(0.0, 1.0, 1e-3)
    mtf = true_mtf(optics, f, 0.0, colour="G", pitch=2)
    true = f[np.flatnonzero(mtf < 0.5)[0]]
    # four standard uncertainties, and half a step of the frequencies
    assert abs(value - true) < 4 * uncertainty + 1e-3
    assert 0 < uncertainty < 0.05 * value


def test_readme_and_manual_show_the_same_lines_and_a_refused_outcome_says_why():
    assert five_lines(PAGES[0]) == five_lines(PAGES[1])
    outcome = procedures.Outcome[float](None, procedures.Verdict.REFUSED, "no chart was found", "show the whole chart")
    with pytest.raises(procedures.Refused, match="no chart was found; show the whole chart"):
        outcome.result()


PICTURE, LENS = np.ones((1, 40, 40)), procedures.CameraSetting(50.0, 2.8, 2000.0, 6.0)


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: procedures.Chart.from_seed("7"), "a seed is a whole number, 0 or more; got '7'"),  # type: ignore[arg-type]
        (lambda: procedures.PatternParameters(s=2.5), "s and k must be whole numbers"),  # type: ignore[arg-type]
        (lambda: procedures.PatternParameters(at=(float("nan"),)), "frequencies must be finite"),
        (lambda: procedures.Psf(np.full((5, 5), np.nan), 4, np.eye(25)), "a PSF has finite samples"),
        (lambda: procedures.Psf(np.ones((4, 4)), 4, np.eye(16)), "a PSF is an odd square of samples"),
        (lambda: procedures.assess(procedures.Psf(np.ones((5, 5)), 4, np.eye(25)), n=1), "have the sum 1"),
        (lambda: procedures.Psf(np.ones((5, 5)) / 25, 4, -np.eye(25)), "variances of a PSF must be finite"),
        (lambda: procedures.GeometryParameters(-1.0), "must be positive"),
        (lambda: procedures.CameraSetting(50.0, float("nan"), 2000.0, 6.0), "must be positive"),
        (lambda: procedures.refocus(PICTURE, -PICTURE[0], LENS, procedures.pillbox()), "must be positive"),
        (lambda: procedures.stacks_of([procedures.pillbox()], (1.0, 2.0), 6.0, (90, 90)), "need as many ratios"),
    ],
)
def test_arguments_that_cannot_be_meant_are_refused_with_a_remedy(make, reason):
    with pytest.raises(procedures.BadParameter, match=reason):
        make()


def site_of_wheel(folder: Path) -> Path:
    """A folder with the project as a wheel of it would be installed."""
    built = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    (wheel,) = folder.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(folder / "site")
    return folder / "site"
