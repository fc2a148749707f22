"""Every file of a finished session, deleted, emptied, flipped: named by show, and by list where it is of a result."""

import os
import shutil
from pathlib import Path

import pytest

from procedures.outcome import ProcedureError
from station.results.result_files import damage, is_sealed
from station.sessions import reader
from station.sessions.index import Index
from station.sessions.session import Session
from tests.program import run

from .faulty_disk import FaultyDisk
from .work import Camera, FixedClock, Work, today

SPOILS = {
    "deleted": lambda path, data: path.unlink(),
    "emptied": lambda path, data: path.write_bytes(b""),
    "flipped": lambda path, data: path.write_bytes(data[:-20] + bytes([data[-20] ^ 1]) + data[-19:]),
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """A session that came to its end, with a wire's transcript, closed."""
    root = tmp_path_factory.mktemp("finished")

    class Wired(Work):
        def steps(self, session: Session) -> None:
            (session.wire_folder() / "wire-stage.txt").write_text("> G0 X1\n< ok and more than that\n")
            super().steps(session)

    return Wired(root / "sessions", Camera(root / "incoming")).go(FaultyDisk()).folder


def parts(folder: Path) -> list[str]:
    return [str(path.relative_to(folder)) for path in sorted(folder.rglob("*")) if path.is_file()]


@pytest.mark.parametrize("spoil", SPOILS)
def test_every_file_that_is_not_what_was_written_is_named(finished, tmp_path, monkeypatch, spoil):
    monkeypatch.setattr(reader, "BETWEEN_WRITES_S", ())
    assert "WARNING" not in run("session", "show", finished).stderr.upper()
    names = [name for name in parts(finished) if name != ".lock"]
    assert len(names) == 4 + 3 + 2 + 1  # the session's own, photographs, a result, a wire
    for name in names:
        folder = tmp_path / "sessions" / finished.name
        shutil.copytree(finished, folder)
        path = folder / name
        data = path.read_bytes()
        path.chmod(0o644)
        SPOILS[spoil](path, data)
        done = run("session", "show", folder, code=None)
        assert Path(name).name in done.stderr or ("journal" in name and "journal" in done.stderr), name
        assert done.exit_code == (0 if name == "SHA256SUMS" or "was not whole" in done.stderr else 4), name
        shutil.rmtree(tmp_path / "sessions")


@pytest.mark.parametrize("spoil", SPOILS)
def test_damaged_result_is_named_by_list_and_by_whoever_resumes(finished, tmp_path, spoil):
    folder = tmp_path / "sessions" / finished.name
    shutil.copytree(finished, folder)
    with Index(folder.parent) as index:
        assert not index.sessions()[0].damage
    path = folder / "derived" / "1" / "sum.txt"
    SPOILS[spoil](path, path.read_bytes())
    with Index(folder.parent) as index:
        assert "derived/1/sum.txt: missing or changed" in index.sessions()[0].damage
    with Session.open(folder, FixedClock(), today=today, disk=FaultyDisk()) as session:
        assert any("derived/1/sum.txt" in one for one in session.state.notices)


@pytest.mark.parametrize("spoil", SPOILS)
def test_sealed_result_reports_which_of_its_files_is_not_what_was_written(finished, tmp_path, spoil):
    folder = finished / "derived" / "1"
    assert damage(folder) == ()
    assert is_sealed(folder)
    for name in parts(folder):
        copy = tmp_path / "copy"
        shutil.copytree(folder, copy)
        SPOILS[spoil](copy / name, (copy / name).read_bytes())
        assert damage(copy) == (name,)
        shutil.rmtree(copy)


def test_pipe_in_the_place_of_a_file_is_named_and_not_waited_for(finished, tmp_path):
    folder = tmp_path / "sessions" / finished.name
    shutil.copytree(finished, folder)
    for name in ("originals/0001-IMG_0001.DNG", "derived/1/sum.txt", "journal.head"):
        (folder / name).unlink()
        os.mkfifo(folder / name)
    record = reader.read_session(folder)
    assert "journal.head cannot be read (it is not a regular file)" in record.lost
    with pytest.raises(ProcedureError, match=r"0001-IMG_0001\.DNG"):
        reader.verify(folder, record.state)
    with pytest.raises(ProcedureError, match=r"derived/1/sum\.txt"):
        reader.verify_results(record)
