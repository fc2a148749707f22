"""What a killed run left behind is removed by the next one; what another run holds is not touched."""

import os
import signal
import stat
import tempfile
from contextlib import ExitStack

import pytest

from station.common.durable_files import make, release, sweep, temporary_folder
from station.results.result_files import ResultFolder

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no locks of folders, and nothing to kill")


def killed(work):
    """Run this in a process that is killed in the middle of it."""
    child = os.fork()
    if child == 0:
        work()
        os.kill(os.getpid(), signal.SIGKILL)
    assert os.waitpid(child, 0)[1] == signal.SIGKILL


def test_half_a_result_of_a_killed_run_is_removed_by_the_next(tmp_path):
    out = tmp_path / "out"

    def work():
        folder = ResultFolder(out).__enter__()
        folder.write("psf_G1.npy", b"half")

    killed(work)
    (left,) = out.glob(".unfinished-*")
    assert (left / "psf_G1.npy").read_bytes() == b"half"
    with ResultFolder(out) as folder:
        assert [one for one in out.iterdir() if one != folder.staging] == []


def test_result_that_another_run_writes_at_this_moment_is_not_touched(tmp_path):
    with ResultFolder(tmp_path) as first:
        first.write("a.csv", b"1")
        with ResultFolder(tmp_path) as second:
            assert second.staging != first.staging
        assert (first.staging / "a.csv").read_bytes() == b"1"
    assert list(tmp_path.iterdir()) == []


def test_folder_of_a_simulated_bench_whose_program_was_killed_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    contexts = ExitStack()

    def work():
        folder = contexts.enter_context(temporary_folder())
        (folder / "frame.dng").write_bytes(b"light")

    killed(work)
    assert len(list(tmp_path.iterdir())) == 1
    (tmp_path / f"station-{'0' * 16}").symlink_to("/")
    with temporary_folder() as folder:
        assert set(tmp_path.iterdir()) == {folder, tmp_path / f"station-{'0' * 16}"}
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert set(tmp_path.iterdir()) == {tmp_path / f"station-{'0' * 16}"}


def test_what_cannot_be_locked_or_is_held_stays(tmp_path):
    folder, descriptor = make("station-", tmp_path)
    sweep(tmp_path, "station-")
    assert folder.is_dir()
    release(descriptor)
    sweep(tmp_path, "station-")
    assert not folder.exists()


def test_a_folder_that_a_person_called_so_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for name in ("station-demo", "station-dvbge5zg"):  # the second as other programs call theirs
        (tmp_path / name).mkdir()
        (tmp_path / name / "photo.dng").write_bytes(b"light")
    with temporary_folder():
        pass
    assert sorted(one.name for one in tmp_path.glob("*/photo.dng")) == ["photo.dng"] * 2


def test_all_that_a_result_leaves_is_its_owners_alone_where_umask_reports_it(tmp_path):
    before = os.umask(0o077)
    try:
        with ResultFolder(tmp_path / "out") as folder:
            folder.write("numbers.csv", b"1")
            folder.publish()
    finally:
        os.umask(before)
    found = [tmp_path / "out", *(tmp_path / "out").iterdir()]
    assert len(found) == 2
    assert [one for one in found if one.stat().st_mode & 0o077] == []
