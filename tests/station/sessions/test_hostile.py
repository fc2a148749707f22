"""Nothing typed or found writes outside the session's folder, whatever it is called and wherever links lead."""

import re
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.common.durable_files import Disk, WriteFailed
from station.results.result_files import ResultFolder
from station.sessions.journal import Damaged, Journal
from station.sessions.layout import original_name, safe_name
from station.sessions.reader import read_session
from station.sessions.session import Session

from .work import FixedClock, exposure_of, today

NAMES = [
    "../../evil", "/etc/passwd", "..", "", "a\x00b", "\x1b[31mred\x1b[0m", '"\n[config]\nevil = true', "-rf",
    "x" * 5000, "a\udcffb", "C:\\windows", "<script>alert(1)</script>", "{{ 7 * 7 }}",
]  # fmt: skip


def tree(folder) -> dict[str, bytes]:
    """Every file below, with its content."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def about():
    return {"plan": "test", "camera": "Box", "lens": "50 mm", "config": {}, "clock": FixedClock(), "today": today}


@pytest.fixture
def outside(tmp_path):
    folder = tmp_path / "outside"
    folder.mkdir()
    (folder / "file").write_text("untouched")
    return folder


@pytest.fixture
def session(tmp_path, about):
    with Session.create(tmp_path / "sessions", **about) as session:
        yield session


def adopted(session, path, data=b"frame"):
    path.write_bytes(data)
    return session.adopt(exposure_of(path), step="shots", purpose="frame", snapshot={})


@pytest.mark.parametrize("name", NAMES)
def test_session_of_any_name_lies_in_its_root(tmp_path, about, outside, name):
    root = tmp_path / "sessions"
    reported = {**about, "plan": name, "camera": name, "lens": name, "config": {"name": name, "names": {"x": [name]}}}
    with Session.create(root, **reported) as session:
        session.learn({"name": name})
        session.note("typed", text=name)
        assert session.folder.parent == root
        assert re.fullmatch(r"[a-z0-9-]+", session.folder.name)
        assert session.state.camera == name
    config = tomllib.loads((session.folder / "session.toml").read_text())
    assert config.keys() == {"schema", "plan", "camera", "lens", "began", "seed", "config"}
    assert config["config"]["name"] == name.replace("\udcff", "?")
    assert read_session(session.folder).state.facts == {"name": name}
    assert {path.name for path in tmp_path.iterdir()} == {"sessions", "outside"}


@pytest.mark.slow
@given(text=st.text(max_size=100))
def test_names_of_folders_and_files_are_plain(text):
    assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", safe_name(text, "camera"))
    assert re.fullmatch(r"0007-[A-Za-z0-9_-]{1,40}\.[A-Za-z0-9]{1,8}", original_name(7, text))


@pytest.mark.parametrize(
    "name", ["a\nb.DNG", "\x1b[2J.NEF", "-rf.dng", ".hidden", "x.d\\ng", "$(reboot).dng", "ä.cr3", "a" * 200]
)
def test_photograph_of_any_name_is_kept_inside(session, tmp_path, name):
    shot = adopted(session, tmp_path / name)
    assert session.original(shot).parent == session.folder / "originals"
    session.close()
    Session.open(session.folder, FixedClock(), today=today).close()
    assert tree(session.folder / "originals") == {shot.path.removeprefix("originals/"): b"frame"}


@pytest.mark.parametrize("part", ["originals", "derived", "wire", "session.toml", "journal.jsonl"])
def test_part_that_is_a_link_is_refused(session, outside, part):
    session.close()
    here = session.folder / part
    moved = outside / part
    here.rename(moved)
    here.symlink_to(moved)
    before = tree(outside)
    with pytest.raises(Damaged, match=f"{part} must be"):
        Session.open(session.folder, FixedClock(), today=today)
    assert tree(outside) == before


@pytest.mark.parametrize("part", [".lock", "SHA256SUMS"])
def test_file_that_the_session_writes_is_never_written_through_a_link(session, outside, part):
    session.close()
    (session.folder / part).unlink()
    (session.folder / part).symlink_to(outside / "file")
    try:
        Session.open(session.folder, FixedClock(), today=today).close()
    except WriteFailed:
        assert part == ".lock"
    assert tree(outside) == {"file": b"untouched"}


@pytest.mark.parametrize("name", ["0001-a.DNG", ".0001-a.DNG.part"])
def test_link_in_the_place_of_a_photograph_is_replaced_not_followed(session, tmp_path, outside, name):
    (session.folder / "originals" / name).symlink_to(outside / "file")
    shot = adopted(session, tmp_path / "a.DNG")
    assert session.original(shot).read_bytes() == b"frame"
    assert tree(outside) == {"file": b"untouched"}


def test_photograph_that_became_a_link_is_no_photograph(session, tmp_path, outside):
    shot = adopted(session, tmp_path / "a.DNG", b"untouched")
    session.original(shot).unlink()
    (session.folder / shot.path).symlink_to(outside / "file")
    with pytest.raises(Damaged, match="missing"):
        session.original(shot)
    session.close()
    with pytest.raises(Damaged, match="missing or changed"):
        Session.open(session.folder, FixedClock(), today=today)


@pytest.mark.parametrize("part", ["derived/1", "wire/001"])
def test_folder_of_a_result_or_a_transcript_that_is_a_link_is_refused(session, outside, part):
    (session.folder / part).symlink_to(outside)
    with pytest.raises(Damaged, match="is a link"):
        session.result_folder() if part.startswith("derived") else session.wire_folder()


def test_result_with_a_link_among_its_files_is_not_kept(session, outside):
    with ResultFolder(session.result_folder()) as files:
        files.write("result.json", b"{}")
        files.publish()
    (session.result_folder() / "secret").symlink_to(outside / "file")
    with pytest.raises(WriteFailed):
        session.keep_result(step="estimate", shots=[], verdict="pass")


@pytest.mark.parametrize(
    ("event", "data"),
    [
        ("adopting", {"path": "originals/../../outside/file"}),
        ("adopting", {"path": "/etc/passwd"}),
        ("adopting", {"path": "originals/.."}),
        ("adopting", {"path": "originals/a\n.DNG"}),
        ("derived", {"folder": "derived/../../outside"}),
        ("derived", {"folder": "/tmp"}),
    ],
)
def test_forged_journal_leads_nowhere(session, event, data):
    """Whoever forges a journal can sum its lines up as well."""
    session.close()
    record = read_session(session.folder)
    whole = {"shot": 1, "sha256": "0", "size_bytes": 1, "purpose": "", "step": "", "exposure": {}, "snapshot": {}}
    whole |= {"files": {}, "shots": [], "verdict": "pass"}
    journal = Journal(session.folder / "journal.jsonl", record.contents, Disk())
    journal.append(event, "", 0.0, {**whole, **data})
    journal.close()
    with pytest.raises(Damaged, match="cannot be understood"):
        Session.open(session.folder, FixedClock(), today=today)


def test_deeply_nested_line_is_no_line(session):
    session.close()
    text = b'{"seq":3,"x":' + b"[" * 100_000 + b"\n"
    with (session.folder / "journal.jsonl").open("ab") as file:
        file.write(text)
    with Session.open(session.folder, FixedClock(), today=today) as reopened:
        assert "was not whole" in reopened.state.notices[0]


def test_half_a_session_of_a_killed_run_is_removed_by_the_next(tmp_path, about):
    root = tmp_path / "sessions"
    left = root / ".creating-0123456789abcdef"
    (left / "originals").mkdir(parents=True)
    (left / "session.toml").write_text("half")
    with Session.create(root, **about) as session:
        assert {path.name for path in root.iterdir()} == {session.folder.name}
        assert session.folder.stat().st_mode & 0o777 == root.stat().st_mode & 0o777  # as umask says, no narrower


def test_sessions_may_lie_behind_a_link_to_their_folder(tmp_path, about):
    (tmp_path / "disk").mkdir()
    (tmp_path / "sessions").symlink_to(tmp_path / "disk")
    with Session.create(tmp_path / "sessions", **about) as session:
        shot = adopted(session, tmp_path / "a.DNG")
    assert (tmp_path / "disk" / session.folder.name / shot.path).read_bytes() == b"frame"


@pytest.mark.parametrize(
    "path", ["/etc/passwd", "given/1/../../session.toml", "given/1/.hidden", "originals/0001-a.dng"]
)
def test_a_journal_cannot_name_given_files_elsewhere(about, tmp_path, path):
    with Session.create(tmp_path, **about) as session, pytest.raises(ValueError, match="must be in given/"):
        session.note("given", source="a", files={path: "00"})


def test_given_files_go_nowhere_through_a_link(about, tmp_path, outside):
    (tmp_path / "a.npy").write_bytes(b"1")
    with Session.create(tmp_path / "sessions", **about) as session:
        (session.folder / "given").symlink_to(outside)
        with pytest.raises(Damaged, match="is a link"):
            session.give([tmp_path / "a.npy"])
