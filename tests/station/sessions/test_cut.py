"""A journal that lost its end, at a line's end or inside one: nothing is written over or lost, and it is said."""

import os
import shutil
from itertools import pairwise
from pathlib import Path

import pytest

from procedures.outcome import ProcedureError
from station.common.durable_files import Disk
from station.sessions import reader
from station.sessions.index import Index
from station.sessions.journal import Contents, Damaged, Journal
from station.sessions.layout import read_config
from station.sessions.reader import check_whole, read_session, unknown_files, verify
from tests.program import run

from .faulty_disk import FaultyDisk
from .work import Camera, Work, created, opened


@pytest.fixture(autouse=True)
def _unhurried(monkeypatch):
    monkeypatch.setattr(reader, "BETWEEN_WRITES_S", ())


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """A session that came to its end, closed."""
    root = tmp_path_factory.mktemp("finished")
    return Work(root / "sessions", Camera(root / "incoming")).go(FaultyDisk()).folder


@pytest.fixture(scope="module")
def earlier(finished, tmp_path_factory) -> Path:
    """The same, as versions wrote it that knew no head of a journal."""
    folder = tmp_path_factory.mktemp("earlier") / "sessions" / finished.name
    shutil.copytree(finished, folder)
    lines = read_session(finished).contents.lines
    (folder / "journal.jsonl").write_bytes(b"")
    journal = Journal(folder / "journal.jsonl", Contents((), read_config(folder)[1], 0), FaultyDisk())
    for line in lines:
        journal.append(line.event, line.at, line.clock_s, {k: v for k, v in line.data.items() if k != "head"})
    journal.close()
    (folder / "journal.head").unlink()
    verify(folder, read_session(folder).state)
    return folder


def precious(folder: Path) -> dict[str, bytes]:
    """Every photograph and every file of a result."""
    parts = [*(folder / "originals").rglob("*"), *(folder / "derived").rglob("*")]
    return {str(path.relative_to(folder)): path.read_bytes() for path in parts if path.is_file()}


def cut(whole: Path, root: Path, length: int) -> Path:
    """A copy whose journal ends after so many bytes."""
    folder = root / str(length) / "sessions" / whole.name
    shutil.copytree(whole, folder)
    with (folder / "journal.jsonl").open("rb+") as file:
        file.truncate(length)
    return folder


def take_one(folder: Path, noise: str) -> list[str]:
    """Open it and take a photograph whose name on the camera repeats; what was said at opening."""
    camera = Camera(folder.parent / "incoming", noise=noise)
    with opened(folder, disk=FaultyDisk()) as session:
        said = list(session.state.notices)
        session.expect("shots", "frame 0")
        shot = session.adopt(camera.expose("frame 0"), step="shots", purpose="frame 0", snapshot={})
        assert session.original(shot).read_bytes() == (camera.folder / "IMG_0001.DNG").read_bytes()
    return said


def check(folder: Path, before: dict[str, bytes]) -> None:
    now = precious(folder)
    assert {name: now.get(name) for name in before} == before


def ends(whole: Path) -> list[int]:
    """The lengths of the journal up to each line, without the whole one."""
    data = (whole / "journal.jsonl").read_bytes()
    return [i + 1 for i, byte in enumerate(data) if byte == ord("\n")][:-1]


@pytest.mark.slow
def test_cut_at_any_line_is_reported_and_nothing_is_written_over(finished, tmp_path):
    before = precious(finished)
    for number, length in enumerate(ends(finished), 1):
        folder = cut(finished, tmp_path, length)
        with pytest.raises(Damaged, match=f"the journal has {number} lines"):
            check_whole(read_session(folder))
        with Index(folder.parent) as index:
            assert f"has {number} lines" in index.sessions()[0].damage
        said = take_one(folder, noise="other")
        assert any(f"the journal has {number} lines" in one for one in said)
        check(folder, before)
        assert not read_session(folder).oddities  # what was lost is in the journal now


def test_cut_of_an_earlier_version_writes_nothing_over_and_names_what_the_journal_lacks(earlier, tmp_path):
    before = precious(earlier)
    for length in ends(earlier):
        folder = cut(earlier, tmp_path, length)
        unknown = unknown_files(folder, read_session(folder).state)
        said = take_one(folder, noise="other")
        assert all(any(repr(Path(name).name) in one for one in said) for name in unknown)
        check(folder, before)


@pytest.mark.slow
def test_cut_at_any_byte_of_the_last_ten_lines_is_reported_and_nothing_is_written_over(finished, tmp_path):
    whole = (finished / "journal.jsonl").read_bytes()
    lines = list(pairwise([*ends(finished)[-10:], len(whole)]))
    read = cut(finished, tmp_path / "read", len(whole))
    for at in range(len(whole) - 1, lines[0][0] - 1, -1):
        os.truncate(read / "journal.jsonl", at)
        found = read_session(read)
        begin = max(first for first, _ in lines if first <= at)
        # whoever opens it knows the journal by this alone: wherever in a line it was cut, that line is gone as a whole
        assert (found.contents.length, found.contents.torn) == (begin, whole[begin:at])
        assert len(found.contents.lines) == whole[:begin].count(b"\n")
        assert any("the journal has" in one or "was not whole" in one for one in found.oddities)
    before = precious(finished)
    for begin, end in lines:
        for at in (begin, begin + 1, (begin + end) // 2, end - 1):
            folder = cut(finished, tmp_path, at)
            said = take_one(folder, noise="other")
            assert any("the journal has" in one or "was not whole" in one for one in said)
            check(folder, before)


@pytest.mark.slow
def test_cut_at_any_line_it_goes_on_to_its_end(finished, tmp_path):
    before = precious(finished)
    for length in ends(finished):
        folder = cut(finished, tmp_path, length)
        work = Work(folder.parent, Camera(folder.parent / "incoming", noise="other"))
        with work.go(FaultyDisk()) as session:
            assert session.state.done == ("focus", "shots", "estimate")
            assert session.state.results
        check(folder, before)
        verify(folder, read_session(folder).state)


@pytest.mark.parametrize(("lines", "more"), [(1, 0), (2, 0), (1, 20)])
def test_lines_that_were_lost_are_named_and_recorded(finished, tmp_path, lines, more):
    whole = read_session(finished).contents.lines
    left = len(whole) - lines
    folder = cut(finished, tmp_path, ends(finished)[left - 1] + more)
    torn = (folder / "journal.jsonl").read_bytes()[-more:].decode() if more else ""
    (said, *_) = take_one(folder, noise="")
    counts = f"the journal has {left} lines, but journal.head counts {len(whole)}"
    lost = {
        1: f"{counts}: line {left + 1} is missing; it was lost, or being written when the program ended",
        2: f"{counts}: lines {left + 1} to {left + 2} are missing: they were lost",
    }
    assert said == ("the last line of the journal was not whole and did not count" if more else lost[lines])
    after = [(line.event, dict(line.data)) for line in read_session(folder).contents.lines[left:]]
    assert after[0] == ("cut", {"lines": lines})
    assert (after[2] == ("torn", {"bytes": more, "text": torn})) is bool(more)


def test_cut_inside_the_first_line_leaves_the_folder_as_it_is(finished, tmp_path):
    for length in (0, 40):
        folder = cut(finished, tmp_path, length)
        with pytest.raises(Damaged, match="the journal has no line"):
            opened(folder)
        check(folder, precious(finished))


def test_result_that_the_journal_lost_is_confirmed_where_it_comes_out_the_same(finished, tmp_path):
    lines = read_session(finished).contents.lines
    drawn = next(line.seq for line in lines if line.event == "derived")
    folder = cut(finished, tmp_path, ends(finished)[drawn - 2])
    with Work(folder.parent, Camera(folder.parent / "incoming")).go(Disk()) as session:
        (result,) = session.state.results
    assert result.folder == "derived/1"
    assert [path.name for path in (folder / "derived").iterdir()] == ["1"]


def test_file_that_gets_the_name_of_an_announced_photograph_is_left_alone(tmp_path):
    disk = FaultyDisk()
    with created(tmp_path, disk) as session:
        exposure = Camera(tmp_path / "incoming").expose("frame")
        disk.at, disk.how = disk.count + 5, "full"
        with pytest.raises(ProcedureError, match="No space left"):
            session.adopt(exposure, step="shots", purpose="frame", snapshot={})
        stranger = session.folder / "originals" / "0001-IMG_0001.DNG"
        stranger.write_bytes(b"stranger")
        disk.full = False
        shot = session.adopt(exposure, step="shots", purpose="frame", snapshot={})
        assert shot.path == "originals/0001-IMG_0001-2.DNG"
        assert session.original(shot).read_bytes() == exposure.path.read_bytes()
        assert stranger.read_bytes() == b"stranger"


@pytest.mark.parametrize("links", [True, False], ids=["links", "no links"])
def test_name_that_is_taken_is_never_replaced(tmp_path, monkeypatch, links):
    if not links:
        monkeypatch.setattr("os.link", lambda *_, **__: (_ for _ in ()).throw(OSError(95, "not supported")))
    new, taken = tmp_path / "new", tmp_path / "taken"
    new.write_bytes(b"new")
    taken.write_bytes(b"old")
    with pytest.raises(FileExistsError):
        Disk().place(new, taken)
    assert (new.read_bytes(), taken.read_bytes()) == (b"new", b"old")
    Disk().place(new, tmp_path / "free")
    assert (tmp_path / "free").read_bytes() == b"new"
    assert not new.exists()


# --- damage to the head itself


def test_any_altered_byte_of_the_head_is_reported(finished, tmp_path):
    folder = cut(finished, tmp_path, (finished / "journal.jsonl").stat().st_size)
    head = folder / "journal.head"
    whole = head.read_bytes()
    for i in range(len(whole)):
        head.write_bytes(whole[:i] + bytes([whole[i] ^ 0x01]) + whole[i + 1 :])
        assert "journal.head is not what was written" in read_session(folder).lost, i
    head.write_bytes(whole)
    assert not read_session(folder).lost


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda head: head.unlink(), "is missing"),
        (lambda head: head.write_bytes(b""), "is not what was written"),
        (lambda head: head.write_bytes(b" " * 169 + b"\n"), "is not what was written"),
    ],
    ids=["deleted", "emptied", "blank"],
)
def test_head_that_is_gone_is_reported_and_made_anew_by_whoever_resumes(finished, tmp_path, spoil, said):
    folder = cut(finished, tmp_path, (finished / "journal.jsonl").stat().st_size)
    spoil(folder / "journal.head")
    assert said in read_session(folder).lost
    assert any(said in one for one in take_one(folder, noise=""))
    assert not read_session(folder).lost
    check(folder, precious(finished))


def test_head_of_another_journal_is_reported(finished, earlier, tmp_path):
    folder = cut(finished, tmp_path, (finished / "journal.jsonl").stat().st_size)
    shutil.copytree(earlier, other := tmp_path / "other")
    take_one(other, noise="")
    shutil.copy(other / "journal.head", folder / "journal.head")
    assert "journal.head" in read_session(folder).lost


def test_show_says_that_lines_are_gone_and_what_they_spoke_of(finished, tmp_path):
    folder = cut(finished, tmp_path, ends(finished)[1])
    done = run("session", "show", folder, code=4, says="the journal has 2 lines")
    unknown = unknown_files(folder, read_session(folder).state)
    assert unknown == ["derived/1", *(f"originals/000{i}-IMG_000{i}.DNG" for i in (1, 2, 3))]
    for name in unknown:
        assert f"{name} is not in the journal" in done.stderr
