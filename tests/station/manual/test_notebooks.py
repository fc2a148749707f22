"""The manual's Python as notebooks: every cell is run, and every public name of the library is used in one."""

import ast
import json
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pytest

import procedures
from station.demo.small_inputs import defocused, six_charts
from station.manual.browser_pages import cells_of, notebook_of, write_manual
from station.manual.pages import Page, read_pages
from tests.golden.cases import chart_photograph, save
from tests.procedures.correction.small_lens import scene
from tests.procedures.geometry.chart_bins import test_photographs as chart_views
from tests.procedures.two_photo.wall import gaussian, photographs

from .conftest import edge_levels, levels, render_samples

SLOW_FIXTURES = {"library_folder"}
PAGES = {page.name: page for page in read_pages()}


def code_of(page: Page) -> list[str]:
    return [cell["source"] for cell in cells_of(page.text) if cell["cell_type"] == "code"]


def test_a_page_becomes_a_notebook_with_all_of_its_text():
    page = Page(
        "how-to", "page", "# Title\n\nText.\n\n```python\nx = 1\n```\n\n```sh\nstation\n```\n\n```python\nx\n```\n"
    )
    notebook = json.loads(notebook_of(page))
    cells = [(cell["cell_type"], cell["source"]) for cell in notebook["cells"]]
    assert cells == [
        ("markdown", "# Title\n\nText."), ("code", "x = 1"), ("markdown", "```sh\nstation\n```"), ("code", "x"),
    ]  # fmt: skip
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 4)
    assert all(set(cell) >= {"metadata", "source"} for cell in notebook["cells"])
    assert notebook_of(Page("how-to", "page", "# Title\n\nText.\n")) is None


def test_pages_with_python_are_written_as_notebooks_too(tmp_path):
    write_manual(list(PAGES.values()), tmp_path, {})
    assert json.loads((tmp_path / "library.ipynb").read_text())["cells"][0]["source"].startswith("# Use the library")
    assert not (tmp_path / "chart.ipynb").exists()


def test_every_public_name_is_used_in_an_example():
    imported, used = set(), set()
    for page in PAGES.values():
        for code in code_of(page):
            for node in ast.walk(ast.parse(code)):
                if isinstance(node, ast.ImportFrom) and node.module == "procedures":
                    imported |= {one.name for one in node.names}
                elif isinstance(node, ast.Name):
                    used.add(node.id)
    assert imported & used == set(procedures.__all__)
    assert imported <= used


def shoot_sensor(folder: Path) -> None:
    """Levels and stacks of a grey sensor of 12 bits as dumps: 0.1 per electron, 3 electrons of noise in the dark."""
    rng = np.random.default_rng(4)
    folder.mkdir()

    def dump(name: str, electrons: float) -> None:
        signal = rng.poisson(electrons, (64, 80)) + 30 * rng.standard_normal((64, 80))
        np.clip(np.rint(64 + 0.1 * signal), 0, 4095).astype("<u2").tofile(folder / f"{name}.raw")

    for n, electrons in enumerate(np.linspace(800, 44000, 16)):
        for which in "ab":
            dump(f"light{n:02d}_{which}", electrons)
    for which in "ab":
        dump(f"dark0_{which}", 0.0)
        dump(f"dark1_{which}", 0.0)
    for n in range(16):
        dump(f"darks_{n:02d}", 0.0)
        dump(f"flats_{n:02d}", 20000.0)


@pytest.fixture(scope="module")
def library_folder(tmp_path_factory):
    """All files that the page on the library reads."""
    folder = tmp_path_factory.mktemp("library")
    chart_photograph(folder / "photo.dng", 3)
    (folder / "frames").mkdir()
    cv2.imwrite(str(folder / "frames" / "charts.pgm"), levels(six_charts()))
    save(folder / "scene.pgm", scene((280, 310))[0])
    wall = photographs(gaussian(0.42, 0.37), tilt=0.04)
    save(folder / "near.pgm", wall.near)
    save(folder / "far.pgm", wall.far)
    cv2.imwrite(str(folder / "edge.pgm"), edge_levels())
    for name, sigma in (("blurred_1", 1.0), ("blurred_2", 1.5), ("sharp", 0.0)):
        cv2.imwrite(str(folder / f"{name}.pgm"), levels(defocused(sigma)))
    camera = chart_views.wide_camera()
    (folder / "views").mkdir()
    for i in range(len(chart_views.PLACES)):
        view = chart_views.photographed(camera, chart_views.tilted(camera, i), i)
        save(folder / "views" / f"{i}.pgm", view.samples)
    y, x = np.mgrid[-1:1:96j, -1:1:128j]
    (folder / "flats").mkdir()
    rng = np.random.default_rng(7)
    for name in "abc":
        light = 0.5 - 0.1 * (x**2 + y**2) + 0.001 * rng.standard_normal(x.shape)
        save(folder / "flats" / f"{name}.pgm", light)
    shoot_sensor(folder / "sensor")
    np.savez(folder / "film.npz", samples=render_samples())
    return folder


@pytest.fixture(scope="module")
def session(library_folder):
    """What the page's cells have in common."""
    return {}


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(code_of(PAGES["library"]))))
def test_a_cell_of_the_library_page_runs(number, library_folder, session, monkeypatch, capsys):
    monkeypatch.chdir(library_folder)
    matplotlib.use("agg")
    code = code_of(PAGES["library"])[number]
    exec(compile(code, f"cell {number}", "exec"), session)
    last = ast.parse(code).body[-1]
    if isinstance(last, ast.Expr) and isinstance(last.value, ast.Name):
        # what a notebook shows
        assert len(repr(session[last.value.id]).splitlines()) <= 12
    printed = capsys.readouterr().out
    assert "refused" not in printed, printed
