"""A session's results are recomputed bitwise from its folder; differences are named."""

import json
import shutil
from dataclasses import replace
from functools import partial

import pytest
from threadpoolctl import threadpool_limits

from procedures import BadParameter, read_frame
from station.guide import catalogue, session_result
from station.guide.catalogue import PLANS
from station.guide.recompute import kernels_of, recompute
from station.guide.session_report import COMMANDS, certificate_files, session_page
from station.guide.session_result import Frames, compute, derive
from station.procedure.schema import procedure_names
from station.results.reader import read_result
from station.sessions.journal import Damaged
from station.sessions.reader import read_session
from station.sessions.session import Session
from tests.program import run

from ..sessions.short_plan import ENTRY, SHOTS, photographs, plan
from ..sessions.work import FixedClock, exposure_of, today

SLOW_FIXTURES = {"folder"}
READING = {"value": 21.34, "unit": "°C", "uncertainty": 0.1}
ROOM = {"axes": {"z_mm": 3.5}, "environment": {"<i>room</i>": {"temperature": READING}}}
CAMERA = "<script>alert(1)</script>{{ 7 * 7 }}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A session with two results: one from all shots, one without the last."""
    root = tmp_path_factory.mktemp("recompute")
    about = {"plan": "short", "camera": CAMERA, "lens": "</title>", "config": {}, "clock": FixedClock()}
    with pytest.MonkeyPatch.context() as patch, Session.create(root, **about, today=today) as session:
        patch.setattr(catalogue, "PLANS", {**catalogue.PLANS, **ENTRY})
        session.learn({"mean": 0.25, "note": "<img src=x onerror=alert(1)>"})
        for name, data in photographs().items():
            path = root / f"{name}.dng"
            path.write_bytes(data)
            shot = session.adopt(exposure_of(path), step="shots", purpose=name, snapshot=ROOM)
            session.judge(shot, name != "look", "<b>a trial</b>")
        derive(session, plan(), "estimate")
        session.judge(session.state.shots[-1], False, "put aside")
        session.learn({"mean": 0.5})
        derive(session, plan(), "estimate")
    return session.folder


@pytest.fixture(autouse=True)
def _known_plan(monkeypatch):
    monkeypatch.setattr(catalogue, "PLANS", {**catalogue.PLANS, **ENTRY})


def test_every_result_is_recomputed_bitwise_by_any_number_of_threads(folder):
    with threadpool_limits(2, user_api="blas"):
        records = list(recompute(folder))
    assert [one.result for one in records] == ["derived/1", "derived/2"]
    assert all(one.identical and "psf_G1.npy" in one.same for one in records)
    assert all(one.machine == () for one in records)


def test_result_of_a_version_without_hashes_is_reproduced(folder, tmp_path, monkeypatch):
    shutil.copytree(folder, earlier := tmp_path / "earlier")
    monkeypatch.setattr("station.guide.session_result.compute", partial(compute, sealed=False))
    with Session.open(earlier, FixedClock(), today=today) as session:
        session.learn({"mean": 0.75})
        derive(session, plan(), "estimate")
    assert "files" not in json.loads((earlier / "derived/3/result.json").read_text())
    (redone,) = recompute(earlier, (3,))
    assert redone.identical


def test_each_result_uses_the_journal_at_its_time(folder):
    records = [json.loads((folder / f"derived/{i}/result.json").read_text()) for i in (1, 2)]
    assert [record["parameters"]["mean"] for record in records] == [0.25, 0.5]
    assert [len(record["input"]) for record in records] == [SHOTS, SHOTS - 1]


@pytest.mark.parametrize(
    ("blas", "family"),
    [
        ("openblas 0.3.30 SkylakeX, openblas 0.3.31 SkylakeX", "SkylakeX"),
        ("openblas 0.3.30 SkylakeX, openblas 0.3.31 Haswell", ""),
        ("mkl 2024.0", ""),
        ("", ""),
    ],
)
def test_family_of_processors_is_known_where_all_libraries_agree(blas, family):
    assert kernels_of({"blas": blas}) == family


@pytest.mark.parametrize(("room", "times"), [(500e6, 1), (0, 2)])
def test_photographs_are_read_on_access_and_cached_within_the_limit(folder, monkeypatch, room, times):
    shots, read, accessed = read_session(folder).state.shots, [], []
    monkeypatch.setattr(session_result, "read_frame", lambda path: read.append(path) or read_frame(path))
    monkeypatch.setattr(session_result, "CACHE_BYTES", room)
    frames = Frames(folder, shots, lambda done, total: accessed.append((done, total)))
    assert [one.sha256 for one in (*frames, *frames)] == 2 * [shot.sha256 for shot in shots]
    assert len(read) == times * len(shots)
    assert accessed == 2 * [(i, len(shots)) for i in range(len(shots))]
    assert [one.sha256 for one in frames[1:]] == [shot.sha256 for shot in shots[1:]]


def test_photographs_and_results_that_changed_are_refused(folder):
    first, second, *_ = read_session(folder).state.shots
    with pytest.raises(Damaged, match="has changed since it was taken"):
        list(Frames(folder, [replace(first, sha256=second.sha256)]))
    with pytest.raises(BadParameter, match="got number 3"):
        list(recompute(folder, (3,)))
    path = folder / "derived/2/result.json"
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b'"mean": 0.5', b'"mean": 0.6'))
    done = run("session", "recompute", folder, "--result", "2", code=1)
    path.write_bytes(whole)
    assert "numbers are the same; missing or altered: result.json; in the record: parameters.mean" in done.stderr
    assert "bring these files back from a copy" in done.stderr


def test_a_changed_number_is_reported_in_units_of_its_uncertainty(folder):
    path = folder / "derived/2/result.json"
    whole = path.read_bytes()
    record = json.loads(whole)
    number = record["planes"]["G1"]["mtf50_radial"]
    now = number["value"]
    number["value"] = now + 3 * number["uncertainty"]  # as if it had been estimated three uncertainties too high
    assert record["planes"]["G1"]["verdict"] == "doubtful"
    record["planes"]["G1"]["verdict"] = "pass"
    path.write_text(json.dumps(record))
    done = run("session", "recompute", folder, "--result", "2", code=None)
    (redone,) = recompute(folder, (2,))
    path.write_bytes(whole)
    (moved,) = redone.moved
    assert (moved.plane, moved.number, moved.now) == ("G1", "mtf50_radial", now)
    assert moved.sigmas == pytest.approx(-3)
    assert f"1 of {redone.numbers} numbers moved, the most mtf50_radial of G1" in done.stderr
    assert "plane G1 was pass, is doubtful" in done.stderr


def test_altered_photographs_are_found_first_and_the_report_is_complete(folder):
    path = next((folder / "originals").iterdir())
    whole = path.read_bytes()
    path.chmod(0o644)
    path.write_bytes(whole[:-1] + b"x")
    with pytest.raises(Damaged, match="missing or changed"):
        list(recompute(folder))
    path.write_bytes(whole)
    head = (folder / "journal.head").rename(folder / "set-aside")
    assert "warning: journal.head is missing" in run("session", "report", folder).stderr
    head.rename(folder / "journal.head")
    page = (folder / "report.html").read_text()
    assert "&lt;script&gt;alert(1)&lt;/script&gt;{{ 7 * 7 }}" in page
    assert "&lt;b&gt;a trial&lt;/b&gt;" in page
    for markup in ("<script>alert", "<img", "<b>a", ", </title>", "<i>room"):
        assert markup not in page
    record = json.loads((folder / "derived/1/result.json").read_text())
    assert record["environment"]["<i>room</i>"]["temperature"] == {**READING, "min": 21.34, "max": 21.34, "n": 2}
    assert read_result(folder / "derived/1").head.environment == record["environment"]
    words = "21.34 °C, standard uncertainty 0.10 °C"
    page = session_page(folder)
    assert words in page
    assert "temperature (&lt;i&gt;room&lt;/i&gt;)" in page
    assert words in certificate_files(folder)["certificate.html"].decode()


def test_every_plan_has_a_certificate():
    assert {COMMANDS.get(plan, plan) for plan in PLANS} <= set(procedure_names())
