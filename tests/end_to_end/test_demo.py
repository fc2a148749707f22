"""The demonstration through its command: its output on a new machine."""

import json
import os
import re
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import html5lib
import numpy as np
import pytest

from procedures.raw import read_frame
from simulators.bench.demonstration import SETUPS, Staging
from station.demo import demo
from tests.program import run

pytestmark = pytest.mark.slow

MADE, SAID = "STATION_DEMONSTRATION", ("stdout", "stderr")
PATIENCE_S = 600.0
PLANES = ("R", "G1", "G2", "B")
REFERRING = {"src", "href", "data", "action", "poster", "srcset"}


@pytest.fixture(scope="module")
def demonstration(tmp_path_factory):
    """What `station demo` made: now, or in $STATION_DEMONSTRATION, where a file `ended` says that it makes no more.

    Whoever runs the command beside the tests, as .ci/run does, need not wait for it a second time; what it said is in
    stdout and stderr there.
    """
    if MADE in os.environ:
        folder, end = Path(os.environ[MADE]), time.monotonic() + PATIENCE_S
        while not (folder / "ended").exists() and time.monotonic() < end:
            time.sleep(0.1)
        out, done = folder / "demo", SimpleNamespace(**{name: (folder / name).read_text() for name in SAID})
    else:
        out = tmp_path_factory.mktemp("demonstration") / "demo"
        done = run("demo", "--out", out)
    return SimpleNamespace(out=out, done=done, record=json.loads((out / "result.json").read_text()))


def planes(demonstration):
    return [plane for one in demonstration.record["photographs"] for plane in one["planes"].values()]


def test_all_documented_files_are_written(demonstration):
    out = demonstration.out
    assert {path.name for path in out.iterdir()} == {"chart.pdf", "photographs", "results", "result.json", "index.html"}
    exports = ("psf_{}.fits", "psf_{}.tiff", "profile_{}.csv")
    chart = (out / "chart.pdf").read_bytes()
    assert chart.startswith(b"%PDF-")
    assert b"/MediaBox [ 0 0 595.2756 841.8898 ]" in chart  # A4
    for setup in SETUPS:
        found = {path.name for path in (out / "results" / setup.name).iterdir()}
        kinds = ("psf_{}.npy", "covariance_{}.npy", "mtf_{}.csv", "psf_{}.png", *exports)
        assert found == {kind.format(plane) for kind in kinds for plane in PLANES} | {
            "budget.csv",
            "numbers.csv",
            "result.json",
        }
        assert np.load(out / "results" / setup.name / "psf_G1.npy").sum() == pytest.approx(1)


def test_every_plane_of_every_photograph_passes_within_its_uncertainties(demonstration):
    for setup, collected in zip(SETUPS, demonstration.record["photographs"], strict=True):
        frame = read_frame(demonstration.out / collected["input"]["path"])
        assert frame.sha256 == collected["input"]["sha256"]
        assert tuple(frame.planes) == PLANES
        assert frame.planes["R"].samples.shape == (setup.rows // 2, setup.columns // 2)
        assert (frame.exposure.f_number, frame.exposure.iso) == (2.8, 400)
    # the relative error's square is a sum over modes of which few are large: 1.3 leaves room for three deviations
    assert [plane["verdict"] for plane in planes(demonstration)] == ["pass"] * 4 * len(SETUPS)
    ratios = [plane["error"] / plane["expected_error"] for plane in planes(demonstration)]
    assert max(ratios) < 1.3
    assert 0.9 < np.mean(ratios) < 1.1
    both = [plane[f"mtf50_{direction}"] for plane in planes(demonstration) for direction in ("horizontal", "vertical")]
    off = np.array([(one["value"] - one["true"]) / one["uncertainty"] for one in both])
    np.testing.assert_allclose(off, [one["sigmas"] for one in both])
    assert np.mean(np.abs(off) < 2.5) >= 0.95
    # in the middle of the frame the PSF is the same over chart and edges
    for setup in SETUPS[:2]:
        record = json.loads((demonstration.out / "results" / setup.name / "result.json").read_text())
        checks = [check for plane in record["planes"].values() for check in plane["edges"]]
        assert len(checks) == 2 * len(PLANES)
        assert abs(np.mean([check["difference"] for check in checks])) < 0.01
        assert max(abs(check["sigmas"]) for check in checks) < 3.5
    assert "MTF50 across the near-vertical edge" in (demonstration.out / "index.html").read_text()
    assert max(np.hypot(*plane["centre_px"]) for plane in planes(demonstration)) < 0.03


def test_table_and_progress_fit_into_eighty_columns_without_a_terminal(demonstration):
    lines = demonstration.done.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert [line.split()[0] for line in lines if line.rstrip().endswith("pass")] == list(PLANES) * len(SETUPS)
    assert f"{4 * len(SETUPS)} of {4 * len(SETUPS)} planes pass" in demonstration.done.stdout
    lines = demonstration.done.stderr.splitlines()
    assert len(lines) == demo.steps() + 1
    assert lines[1] == f"{SETUPS[0].title}: photographed"


def tree_of(text):
    """The page as a tree; raises on the first error of its HTML."""
    return html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(text)


def test_page_stands_alone_and_begins_with_the_verdict(demonstration):
    text = (demonstration.out / "index.html").read_text()
    elements = list(tree_of(text).iter())
    ids = [one.get("id") for one in elements if one.get("id")]
    assert len(ids) == len(set(ids))
    references = [value for one in elements for name, value in one.items() if name.rpartition("}")[2] in REFERRING]
    assert all((one[:1] == "#" and one[1:] in ids) or one.startswith("data:image/png;") for one in references)
    assert not {one.tag for one in elements} & {"script", "link", "iframe", "object", "img"}
    assert not re.search(r"https?://|@import|url\((?!#)", text)
    assert len(text.encode()) < 3e6
    assert text.index("20 of 20 planes pass</h1>") < text.index("<table")
    assert text.count('<article class="card">') == 20
    for one in demonstration.record["photographs"]:
        assert one["input"]["sha256"] in text


@pytest.mark.nightly
def test_same_seed_gives_the_same_bytes_and_another_does_not(demonstration, tmp_path, monkeypatch):
    first, out, again = SETUPS[0], tmp_path / "once", tmp_path / "again"
    found, _ = demo.run_demo(out, 1, setups=(first,))
    demo.run_demo(again, 1, setups=(first,))
    names = [path.relative_to(out) for path in out.rglob("*") if path.is_file()]
    # the records hold how long it took, and this page shows one photograph alone
    fixed = [name for name in names if name.name not in ("result.json", demo.PAGE)]
    assert len(fixed) > 4 * len(PLANES)
    assert all((out / name).read_bytes() == (again / name).read_bytes() for name in fixed)
    # an installation may have the loops of the estimate in C++, whose last bits differ from those of array operations
    drawn = [name for name in fixed if name.parts[0] != "results"]
    assert len(drawn) == 2
    assert all((out / name).read_bytes() == (demonstration.out / name).read_bytes() for name in drawn)
    assert demo.demonstration_page(found) == (out / demo.PAGE).read_text(encoding="utf-8")
    other = []

    def enough(path):
        other.append(path.read_bytes())
        raise KeyboardInterrupt

    monkeypatch.setattr(demo, "read_frame", enough)
    with pytest.raises(KeyboardInterrupt):
        demo.run_demo(tmp_path / "other", 2, setups=(first,))
    assert other != [(out / "photographs" / f"{first.name}.dng").read_bytes()]


@pytest.fixture
def refused(monkeypatch):
    """A demonstration whose only chart is too far away."""
    far = (Staging("far", "Too <far>", (0.5, 0.5), 0.5, rows=400, columns=600),)
    monkeypatch.setattr(demo, "run_demo", partial(demo.run_demo, setups=far))


def test_refused_planes_are_reported_everywhere_with_exit_5(refused, tmp_path):
    done = run("demo", "--out", tmp_path, code=5)
    assert done.stdout.count("refused") == 4
    text = (tmp_path / "index.html").read_text()
    tree_of(text)
    assert "0 of 4 planes pass, 4 refused" in text
    assert "Too &lt;far&gt;" in text
    record = json.loads((tmp_path / "result.json").read_text())
    assert record["summary"]["ratio_mean"] is None
    plane = record["photographs"][0]["planes"]["G1"]
    assert f"N{plane['reason'][1:]}. P{plane['remedy'][1:]}." in text  # no chart ...: photograph the whole chart ...


def test_json_is_the_record_only(refused, tmp_path):
    done = run("demo", "--out", tmp_path, "--json", "--log-json", code=None)
    assert done.stdout == (tmp_path / "result.json").read_text()
    assert all(json.loads(line)["event"] in ("step", "written") for line in done.stderr.splitlines())


def test_interrupted_demonstration_leaves_existing_files(monkeypatch, tmp_path):
    (tmp_path / "index.html").write_text("older")
    monkeypatch.setattr(demo, "read_frame", lambda path: (_ for _ in ()).throw(KeyboardInterrupt))
    small = (Staging("small", "Small", (0.5, 0.5), 0.5, rows=200, columns=300),)
    with pytest.raises(KeyboardInterrupt):
        demo.run_demo(tmp_path, setups=small)
    assert [path.name for path in tmp_path.iterdir()] == ["index.html"]
    assert (tmp_path / "index.html").read_text() == "older"
