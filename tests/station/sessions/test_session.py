import hashlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from procedures.outcome import BadInput
from station.common.durable_files import ContentChanged, Disk, WriteFailed
from station.results.result_files import ResultFolder
from station.sessions import reader
from station.sessions import session as session_module
from station.sessions.journal import Damaged
from station.sessions.layout import Busy
from station.sessions.reader import read_session
from station.sessions.session import Session

from .work import Camera, FixedClock, Work, today

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def about():
    return {"plan": "test", "camera": "Box", "lens": "50 mm", "config": {"s": 4}, "clock": FixedClock(), "today": today}


@pytest.fixture
def session(tmp_path, about):
    with Session.create(tmp_path / "sessions", **about) as session:
        yield session


@pytest.fixture
def camera(tmp_path):
    return Camera(tmp_path / "incoming")


def take(session, camera, what="frame", step="shots"):
    session.expect(step, what)
    return session.adopt(camera.expose(what), step=step, purpose=what, snapshot={"axes": {"z_mm": 3.5}})


def again(session, **options) -> Session:
    session.close()
    return Session.open(session.folder, FixedClock(), today=today, **options)


def test_a_small_session_is_recorded_as_documented(tmp_path, monkeypatch):
    for module in (reader, session_module):
        monkeypatch.setattr(module, "machine", lambda: {"cores": 2})
    folder = Work(tmp_path / "sessions", Camera(tmp_path / "incoming")).go(Disk()).folder
    assert folder.name == "2026-03-14-box-50-mm-test"
    kept = {"session.toml", "journal.jsonl", "journal.head", "SHA256SUMS", ".lock", "originals", "derived", "wire"}
    assert {path.name for path in folder.iterdir()} == kept
    record = read_session(folder)
    assert not record.oddities
    shots = [(n, f"originals/000{n}-IMG_000{n}.DNG") for n in (1, 2, 3)]
    digests = [hashlib.sha256((folder / path).read_bytes()).hexdigest() for _, path in shots]
    seen = list(zip(shots, digests, ("focus", "shots", "shots"), ("look", "frame 0", "frame 1"), strict=True))

    def taking(at):
        ((number, path), digest, step, purpose) = seen[at]
        file = {"sha256": digest, "size_bytes": 1280}
        source = {"path": str(tmp_path / "incoming" / f"IMG_000{number}.DNG"), **file, "requested_s": 1.0,
                  "received_s": 2.0, "settings": {"exposure_s": 0.02, "iso": 100, "f_number": None}, "shutter": None,
                  "companions": []}  # fmt: skip
        counts = step == "shots"
        return [
            ("exposing", {"step": step, "purpose": purpose}),
            ("adopting", {"shot": number, "path": path, **file, "purpose": purpose, "step": step, "exposure": source,
                          "snapshot": {"axes": {"z_mm": 3.5}}}),
            ("adopted", {"shot": number}),
            ("judged", {"shot": number, "counts": counts, "reason": "" if counts else "a trial"}),
        ]  # fmt: skip

    about = {"plan": "test", "camera": "Box", "lens": "50 mm", "began": "2026-03-14T09:26:53+00:00", "seed": 3}
    files = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in (folder / "derived" / "1").iterdir()}
    result = {"folder": "derived/1", "files": files, "shots": [2, 3], "step": "estimate", "verdict": "pass"}

    def step(name, *events):
        return [("step_began", {"step": name}), *events, ("step_ended", {"step": name})]

    assert [(line.event, line.data) for line in record.contents.lines] == [
        ("created", {"schema": "station/session/1", **about}),
        ("opened", {"process": os.getpid(), "machine": {"cores": 2}, "head": "journal.head"}),
        *step("focus", *taking(0), ("learned", {"facts": {"best_mm": 1.25}})),
        *step("shots", *taking(1), *taking(2)),
        *step("estimate", ("derived", {**result, "machine": {"cores": 2}})),
    ]
    assert {(line.at, line.clock_s) for line in record.contents.lines} == {("2026-03-14T09:26:53+00:00", 12.5)}
    state = record.record()["state"]
    assert [shot["number"] for shot in state["shots"] if shot["counts"]] == [2, 3]
    assert {name: state[name] for name in about} == about
    expected = {"done": ["focus", "shots", "estimate"], "step": "", "facts": {"best_mm": 1.25}, "adopting": None,
                "awaited": None, "notices": [], "strangers": {}, "given": {}, "ended": None}  # fmt: skip
    assert {name: state[name] for name in expected} == expected
    (derived,) = state["results"]
    assert derived == state["standing"] == {**result, "at": about["began"], "about": {"machine": {"cores": 2}}}
    config = tomllib.loads((folder / "session.toml").read_text())
    assert config == {"schema": "station/session/1", **about, "config": {"s": 4}}


def test_folder_is_open_to_whom_the_umask_lets_in(tmp_path, about):
    for mask, mode in ((0o077, 0o700), (0o022, 0o755)):
        before = os.umask(mask)
        try:
            with Session.create(tmp_path / str(mask), **about) as session:
                assert session.folder.stat().st_mode & 0o777 == mode
                assert (session.folder / "originals").stat().st_mode & 0o777 == mode
                shot = take(session, Camera(tmp_path / f"incoming-{mask}"))
                assert session.original(shot).stat().st_mode & 0o777 == mode & 0o444
        finally:
            os.umask(before)


def test_second_session_of_the_day_gets_a_number(session, tmp_path, about):
    with Session.create(tmp_path / "sessions", **about) as second:
        assert second.folder.name == "2026-03-14-box-50-mm-test-2"


def test_photograph_is_kept_read_only_and_stays_where_the_camera_put_it(session, camera):
    shot = take(session, camera)
    original = session.original(shot)
    assert original.stat().st_mode & 0o222 == 0
    assert original.read_bytes() == (camera.folder / "IMG_0001.DNG").read_bytes()
    assert shot.snapshot == {"axes": {"z_mm": 3.5}}
    assert shot.exposure["settings"]["exposure_s"] == 0.02


def test_coreutils_check_its_hashes(tmp_path):
    work = Work(tmp_path / "sessions", Camera(tmp_path / "incoming"))
    finished = work.go(Disk())
    done = subprocess.run(["sha256sum", "--check", "SHA256SUMS"], cwd=finished.folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 1 + 3 + 2  # configuration, photographs, files of the result


def test_hashes_follow_each_photograph_and_result_and_are_made_anew(session, camera):
    def listed():
        return [line.split("  ")[1] for line in (session.folder / "SHA256SUMS").read_text().splitlines()]

    assert listed() == ["session.toml"]
    shot = take(session, camera)
    assert listed() == ["session.toml", shot.path]
    with ResultFolder(session.result_folder()) as files:
        files.write("psf.npy", b"1")
        files.publish()
    session.keep_result(step="estimate", shots=[1], verdict="pass")
    assert listed() == ["session.toml", shot.path, "derived/1/psf.npy"]
    (session.folder / "SHA256SUMS").unlink()
    again(session).close()
    assert listed() == ["session.toml", shot.path, "derived/1/psf.npy"]


def test_result_that_was_never_confirmed_is_removed_without_a_word(session):
    with ResultFolder(session.result_folder()) as files:
        files.write("psf.npy", b"1")
        files.publish()
    with again(session) as reopened:
        assert not list((session.folder / "derived").iterdir())
        assert (reopened.state.notices, reopened.leftovers) == ((), ())


def test_what_a_crash_left_half_written_is_removed_and_nothing_else(session, tmp_path):
    (tmp_path / "answer.txt").write_text("1")
    session.give([tmp_path / "answer.txt"])
    session.close()
    halves = [".a.part", "originals/.a.part", "given/1/.a.part", "derived/1/.unfinished-a/result.json"]
    others = ["a.part", "originals/a.part", "given/1/a.part"]
    for name in halves + others:
        (session.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (session.folder / name).write_text("half")
    again(session).close()
    left = {str(path.relative_to(session.folder)) for path in session.folder.rglob("*")}
    assert not {*halves, "derived/1"} & left
    assert set(others) <= left


def test_known_facts_are_not_written_again(session):
    session.learn({"distance_mm": 1550.0})
    size = (session.folder / "journal.jsonl").stat().st_size
    session.learn({"distance_mm": 1550.0})
    assert (session.folder / "journal.jsonl").stat().st_size == size


def test_session_that_nothing_but_an_emergency_touched_is_kept_for_its_times(session):
    session.note("halted", asked_s=1.0, on_the_wire_s={"stage": 1.001}, after_ms={"stage": 1.0})
    session.end("stopped")  # by a Ctrl-C at the first question: the devices were listed, and nothing moved
    assert session.state.empty
    session.end("emergency")
    assert not session.state.empty


def test_step_that_is_reopened_takes_those_after_it_along_and_its_shots_count_no_more(session, camera):
    for step in ("focus", "shots", "estimate"):
        session.begin_step(step)
        session.judge(take(session, camera, step, step), True)
        session.finish_step(step)
    session.begin_step("verdict")
    session.reopen("shots")
    assert session.state.done == ("focus",)
    assert [shot.step for shot in session.state.counting()] == ["focus"]
    assert {shot.reason for shot in session.state.shots if not shot.counts} == {"put aside for a retake"}
    with again(session) as reopened:
        assert reopened.state.done == ("focus",)


def test_same_photograph_does_not_count_twice(session, camera):
    first = session.judge(take(session, camera, "same"), True)
    second = session.judge(take(session, camera, "same"), True)
    assert first.counts
    assert not second.counts
    assert "shot 1, bit for bit" in second.reason


def test_file_that_changed_since_it_was_exposed_is_not_taken(session, camera):
    exposure = camera.expose("frame")
    exposure.path.write_bytes(b"something else")
    with pytest.raises(ContentChanged, match="has changed since its exposure"):
        session.adopt(exposure, step="shots", purpose="frame", snapshot={})
    assert list((session.folder / "originals").iterdir()) == []
    assert session.adopt(camera.expose("next"), step="shots", purpose="frame", snapshot={}).number == 1
    assert "taken again" in session.state.notices[0]


def test_exposure_without_a_photograph_is_reported_to_whoever_resumes(session):
    session.expect("shots", "frame")
    with again(session) as reopened:
        (notice,) = reopened.state.notices
        assert "an exposure for frame (shots)" in notice
    with again(reopened) as reopened:
        assert reopened.state.notices == (notice,)
        reopened.acknowledge_notices()
    with again(reopened) as reopened:
        assert reopened.state.notices == ()


def test_trials_of_a_step_that_was_not_finished_are_reported_to_be_repeated(session, camera):
    session.begin_step("focus")
    session.judge(take(session, camera, step="focus"), False, "a trial")
    with again(session) as reopened:
        (notice,) = reopened.state.notices
        assert "the step focus was not finished and begins again; of its 1 photographs" in notice
        reopened.begin_step("focus")
        reopened.finish_step("focus")
        reopened.acknowledge_notices()
    with again(reopened) as reopened:
        assert reopened.state.notices == ()


@pytest.mark.parametrize("spoil", [lambda path: path.unlink(), lambda path: path.write_bytes(b"x")])
def test_photograph_that_is_missing_or_changed_is_named_and_can_be_given_up(session, camera, spoil):
    for what in ("a", "b"):
        session.judge(take(session, camera, what), True)
    path = session.folder / "originals" / "0001-IMG_0001.DNG"
    path.chmod(0o644)
    spoil(path)
    with pytest.raises(Damaged, match=r"0001-IMG_0001.DNG \(shot 1") as refusal:
        again(session)
    assert "--without 1" in refusal.value.remedy
    with again(session, without=[1]) as reopened:
        assert [shot.number for shot in reopened.state.counting()] == [2]
        assert reopened.state.shot(1).lost
        assert reopened.state.notices == ("shot 1 was given up: its photograph is lost",)
        assert "0001" not in (session.folder / "SHA256SUMS").read_text()
    with again(reopened) as reopened:
        assert reopened.state.next_number == 3


def test_altered_journal_and_configuration_are_refused(session):
    session.learn({"distance_mm": 1550.0})
    session.learn({"more": 1.0})
    session.close()
    for name in ("session.toml", "journal.jsonl"):
        path = session.folder / name
        whole = path.read_bytes()
        path.write_bytes(whole.replace(b"Box", b"Fox"))
        with pytest.raises(Damaged, match=re.escape(str(session.folder))):
            Session.open(session.folder, FixedClock(), today=today)
        path.write_bytes(whole)
    again(session).close()


def test_strange_file_among_the_photographs_is_named_once_and_not_used(session):
    (session.folder / "originals" / "holiday.jpg").write_bytes(b"x")
    with again(session) as reopened:
        assert "'holiday.jpg' is in originals/" in reopened.state.notices[0]
        assert reopened.state.shots == ()
        reopened.acknowledge_notices()
    with again(reopened) as reopened:
        assert reopened.state.notices == ()


def test_second_program_is_refused_by_the_name_of_the_first_and_leaves_no_file_open(session):
    descriptors = Path("/proc/self/fd")  # where the system has it
    before = os.listdir(descriptors) if descriptors.exists() else []
    with pytest.raises(Busy, match=rf"open in another program \(.+, process {os.getpid()}\)") as refusal:
        Session.open(session.folder, FixedClock())
    assert refusal.value.exit_code == 75
    assert not before or os.listdir(descriptors) == before


def test_lock_of_a_program_that_died_is_taken_over(session):
    session.close()
    program = "import os, sys, pathlib, station.sessions.layout as s; s.Lock(pathlib.Path(sys.argv[1])); os._exit(0)"
    subprocess.run([sys.executable, "-c", program, session.folder], check=True, cwd=ROOT)
    assert "process" in (session.folder / ".lock").read_text()
    Session.open(session.folder, FixedClock(), today=today).close()


def test_it_is_read_while_another_program_works_in_it(session):
    session.learn({"distance_mm": 1550.0})
    assert read_session(session.folder).state == session.state


def test_folder_that_is_no_session_is_named(tmp_path):
    with pytest.raises(BadInput, match="not a session"):
        Session.open(tmp_path, FixedClock())


def test_wire_transcripts_of_each_opening_have_a_folder_of_their_own(session):
    first = session.wire_folder()
    with again(session) as reopened:
        assert reopened.wire_folder() != first
        assert reopened.wire_folder().parent == session.folder / "wire"


def test_files_that_answers_name_are_kept_with_their_hashes_and_reported_when_they_are_missing(session, tmp_path):
    (tmp_path / "psf one.npy").write_bytes(b"1")
    (tmp_path / "result.json").write_bytes(b"{}")
    assert session.give([tmp_path / "psf one.npy", tmp_path / "result.json"]) == (
        "given/1/psf-one.npy",
        "given/1/result.json",
    )
    (tmp_path / "psf one.npy").write_bytes(b"2")
    (tmp_path / "link.npy").symlink_to(tmp_path / "psf one.npy")
    assert session.give([tmp_path / "link.npy"]) == ("given/2/psf-one.npy",)
    folder = session.folder
    assert (folder / "given/1/psf-one.npy").read_bytes() == b"1"
    assert not os.access(folder / "given/1/psf-one.npy", os.W_OK) or os.geteuid() == 0
    with again(session) as opened:
        assert list(opened.state.given) == ["given/1/psf-one.npy", "given/1/result.json", "given/2/psf-one.npy"]
        text = (folder / "SHA256SUMS").read_text()
        assert all(f"{digest}  {name}" in text for name, digest in opened.state.given.items())
    (folder / "given/1/result.json").unlink()
    with pytest.raises(Damaged, match=r"given/1/result\.json"):
        Session.open(folder, FixedClock(), today=today)


def test_a_file_that_is_gone_is_not_given(session, tmp_path):
    with pytest.raises(WriteFailed, match=r"gone\.npy"):
        session.give([tmp_path / "gone.npy"])
    assert not session.state.given
