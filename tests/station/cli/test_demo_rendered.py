from types import SimpleNamespace

import pytest

from station.demo.rendered import RenderPlan
from tests.program import run


@pytest.fixture
def calibrated(monkeypatch):
    """The demonstration's calibrations, done at once."""
    monkeypatch.setattr(
        "station.demo.demo.run_demo", lambda out, seed, progress: (SimpleNamespace(refused=(), shots=()), "{}\n")
    )


@pytest.fixture
def small(monkeypatch):
    """A plan of one small scene, with the seed that was asked for."""
    small = {"columns": 32, "samples": 8, "converged": 16, "scenes": ("room",), "restored": False}
    monkeypatch.setattr("station.demo.rendered.RenderPlan", lambda seed: RenderPlan(seed=seed, **small))


@pytest.mark.slow
def test_scenes_are_rendered_on_request(calibrated, small, tmp_path):
    done = run("demo", "--rendered", "--seed", "7", "--json", "--out", tmp_path)
    assert done.stdout == "{}\n"
    assert "room: " in done.stderr
    assert (tmp_path / "rendered" / "rays.html").is_file()
    assert [path.stem for path in sorted((tmp_path / "rendered" / "films").iterdir())] == [
        "room-32x24-seed7-16",
        "room-32x24-seed7-8",
    ]


def test_nothing_is_rendered_unasked(calibrated, small, tmp_path):
    run("demo", "--json", "--out", tmp_path)
    assert not (tmp_path / "rendered").exists()
