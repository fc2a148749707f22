import json
import sqlite3

import pytest

from station.results.result_files import ResultFolder
from station.sessions.index import FILE, Filter, Index
from station.sessions.reader import read_session
from station.sessions.session import Session

from .work import FixedClock, today


def make(root, camera="Box", lens="50 mm", mtf50=None, day=14, plan="pattern", verdict="pass"):
    """A session with a result of one plane, or none."""
    about = {"plan": plan, "camera": camera, "lens": lens, "config": {}, "clock": FixedClock()}
    when = today().replace(day=day)
    with Session.create(root, **about, today=lambda: when) as session:
        if mtf50 is not None:
            number = {"value": mtf50, "unit": "cycles/pixel", "uncertainty": 0.002, "method": "m", "n": 100}
            exact = {**number, "uncertainty": 0.0}
            planes = {
                "G1": {"verdict": verdict, "mtf50_horizontal": number, "scale": exact},
                "B": {"verdict": "refused"},
            }
            with ResultFolder(session.result_folder()) as files:
                files.write("result.json", json.dumps({"planes": planes}).encode())
                files.publish()
            session.keep_result(step="estimate", shots=[], verdict=verdict)
            session.end("finished")
    return session.folder


@pytest.fixture
def root(tmp_path):
    root = tmp_path / "sessions"
    make(root, mtf50=0.30, day=10)
    make(root, mtf50=0.29, day=12, verdict="doubtful")
    make(root, camera="Other", lens="35 mm", day=14)
    return root


def folders(root, **wanted):
    with Index(root) as index:
        return [entry.folder.name for entry in index.sessions(Filter(**wanted))]


def test_newest_session_comes_first_with_its_verdict(root):
    with Index(root) as index:
        entries = index.sessions()
    assert [entry.verdict for entry in entries] == ["", "doubtful", "pass"]
    assert [entry.ended for entry in entries] == ["", "finished", "finished"]


@pytest.mark.parametrize(
    ("wanted", "count"),
    [
        ({"camera": "Box"}, 2),
        ({"lens": "35 mm"}, 1),
        ({"plan": "none"}, 0),
        ({"since": "2026-03-12"}, 2),
        ({"verdict": "pass"}, 1),
        ({"camera": "Box", "since": "2026-03-11", "verdict": "doubtful"}, 1),
        ({"camera": "Box' OR 1=1 --"}, 0),
    ],
)
def test_filters_hold_together(root, wanted, count):
    assert len(folders(root, **wanted)) == count


def test_numbers_of_results_come_oldest_first(root):
    with Index(root) as index:
        numbers = index.measured(Filter(camera="Box"), ["mtf50_horizontal"])
        assert index.measured(Filter(camera="Box"), ["scale"]) == []  # no weight without an uncertainty
    assert [(one.plane, one.value, one.uncertainty) for one in numbers] == [("G1", 0.30, 0.002), ("G1", 0.29, 0.002)]


def test_it_follows_the_folders(root):
    (first, *_) = folders(root, camera="Box")
    with Session.open(root / first, FixedClock(), today=today) as session:
        session.end("stopped")
        assert len(folders(root)) == 3
    with Index(root) as index:
        assert index.sessions()[1].ended == "stopped"
    (root / first).rename(root.parent / "elsewhere")
    assert len(folders(root)) == 2


def test_camera_without_a_session_is_forgotten(root):
    with Index(root) as index:
        assert index.names("cameras") == ["Box", "Other"]
    (name,) = folders(root, camera="Other")
    (root / name).rename(root.parent / "elsewhere")
    with Index(root) as index:
        assert index.names("cameras") == ["Box"]
        assert index.names("lenses") == ["50 mm"]


def changed(path, command):
    with sqlite3.connect(path) as database:
        database.execute(command)
    database.close()


@pytest.mark.parametrize(
    "spoil",
    [
        lambda path: path.unlink(),
        lambda path: path.write_bytes(b"x" * 5000),
        lambda path: path.write_bytes(path.read_bytes()[:4096].ljust(path.stat().st_size, b"\xff")),
        lambda path: changed(path, "PRAGMA user_version = 99"),
    ],
    ids=["gone", "damaged", "damaged inside", "another version"],
)
def test_index_that_is_of_no_use_is_made_anew(root, spoil):
    before = folders(root)
    spoil(root / FILE)
    assert folders(root) == before
    with sqlite3.connect(root / FILE) as database:
        assert database.execute("SELECT count(*) FROM sessions").fetchone() == (3,)
    database.close()


def test_rebuilding_begins_with_nothing(root):
    folders(root)
    changed(root / FILE, "UPDATE sessions SET verdict = 'pass'")
    assert len(folders(root, verdict="pass")) == 3
    with Index(root, rebuild=True) as index:
        assert len(index.sessions(Filter(verdict="pass"))) == 1


def test_index_that_another_program_holds_is_worked_around(root):
    folders(root)
    holder = sqlite3.connect(root / FILE, isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    make(root, day=20)
    index = Index(root)
    index.TIMEOUT_S = 0.01
    with index:
        assert len(index.sessions()) == 4
    holder.execute("ROLLBACK")
    holder.close()


def test_damaged_session_is_listed_with_what_is_wrong(root):
    (name,) = folders(root, camera="Other")
    (root / name / "session.toml").write_text("x = ")
    (root / name / "journal.jsonl").touch()
    with Index(root) as index:
        (entry,) = [entry for entry in index.sessions() if entry.damage]
    assert entry.folder.name == name
    assert (entry.shots, entry.counting) == (0, 0)
    assert "session.toml cannot be read" in entry.damage


DEEP = "[" * 100_000 + "]" * 100_000


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda folder: (folder / "session.toml").write_text(f"x = {DEEP}"), "session.toml cannot be read"),
        (lambda folder: (folder / "session.toml").unlink(), "session.toml"),
        (lambda folder: (folder / "journal.jsonl").unlink(), "journal.jsonl"),
        (lambda folder: (folder / "journal.jsonl").write_text('{"seq":1,"x":' + "[" * 900 + "]" * 900 + "}\n"), "line"),
        (lambda folder: (folder / "derived").rmdir(), "derived must be a folder"),
    ],
    ids=["nested", "no configuration", "no journal", "nested line", "no results' folder"],
)
def test_damaged_session_hides_no_other(root, damage, said):
    (name,) = folders(root, camera="Other")
    damage(root / name)
    with Index(root) as index:
        entries = {entry.folder.name: entry for entry in index.sessions()}
    assert len(entries) == 3
    assert [entry.folder.name for entry in entries.values() if entry.damage] == [name]
    assert said in entries[name].damage


def test_session_that_makes_the_program_fail_hides_no_other(root, monkeypatch):
    (name,), read = folders(root, camera="Other"), read_session
    monkeypatch.setattr(
        "station.sessions.index.read_session", lambda folder: read(folder) if folder.name != name else 1 / 0
    )
    with Index(root, rebuild=True) as index:
        damage = {entry.folder.name: entry.damage for entry in index.sessions()}
    assert damage.pop(name) == "it cannot be read: ZeroDivisionError('division by zero')"
    assert list(damage.values()) == ["", ""]


@pytest.mark.parametrize("number", ["NaN", "1e999", "9" * 400, "[1]", '{"x": 1}', '"\\ud800"', "null"])
def test_number_that_is_none_hides_no_other(root, number):
    about = {"plan": "pattern", "camera": "Odd", "lens": "l", "config": {}, "clock": FixedClock()}
    with Session.create(root, **about, today=today) as session:
        entry = f'{{"value": {number}, "unit": {number}, "uncertainty": {number}, "method": "m", "n": {number}}}'
        with ResultFolder(session.result_folder()) as files:
            files.write("result.json", f'{{"planes": {{"G1": {{"verdict": "pass", "mtf50": {entry}}}}}}}'.encode())
            files.publish()
        session.keep_result(step="estimate", shots=[], verdict="pass")
    with Index(root) as index:
        assert len(index.sessions()) == 4
        assert {one.camera for one in index.measured()} == {"Box"}


def test_result_that_was_altered_is_not_counted(root):
    (name,) = folders(root, verdict="pass")
    (root / name / "derived" / "1" / "result.json").write_text('{"planes": {}}')
    with Index(root, rebuild=True) as index:
        assert [one.value for one in index.measured()] == [0.29]


def test_folder_that_is_not_there_has_no_sessions(tmp_path):
    with Index(tmp_path / "none") as index:
        assert index.sessions() == []
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("camera", ["\x1b[31m", "a\udcff", "'; DROP TABLE sessions; --", "\x00"])
def test_cameras_of_any_name_are_found_again(tmp_path, camera):
    make(tmp_path, camera=camera)
    with Index(tmp_path) as index:
        (entry,) = index.sessions()
        assert index.sessions(Filter(camera=entry.camera)) == [entry]
