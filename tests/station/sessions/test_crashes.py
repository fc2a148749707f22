"""The power is cut, or the disk is full, at every single operation of a session."""

import pytest

from procedures.outcome import ProcedureError
from station.sessions.session import Session

from .faulty_disk import FaultyDisk, PowerCut
from .work import Camera, Work, created, opened, result_of


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    """The result of a session that nothing disturbed, and how many operations it took."""
    root = tmp_path_factory.mktemp("whole")
    disk, work = FaultyDisk(), Work(root / "sessions", Camera(root / "incoming"))
    session = work.go(disk)
    assert not work.notices
    return result_of(session.folder), session.state, disk.count


def check(session: Session, work: Work, uninterrupted) -> None:
    """Nothing is lost, nothing counts twice, whatever was repeated was said, and the result is the same."""
    result, state, _ = uninterrupted
    assert result_of(session.folder) == result
    assert session.state.facts == state.facts
    assert [shot.sha256 for shot in session.state.counting()] == [shot.sha256 for shot in state.counting()]
    shots = {shot.number: shot.sha256 for shot in session.state.shots}
    assert {number: shots.get(number) for number in work.stored} == work.stored
    lost = len(work.camera.exposures) - len(shots)
    again = [notice for notice in work.notices if "it will be taken again" in notice]
    assert lost <= len(again) <= lost + 1  # one that was announced in the journal may not have been fired yet


FEW = 11
"""Every so many operations are tried with every change, all others nightly; coprime to the operations per line."""
EVERY = pytest.mark.parametrize(
    "few", [True, pytest.param(False, marks=pytest.mark.nightly)], ids=["few", "the others"]
)


def tried(count: int, few: bool) -> list[int]:
    """Of so many operations a few, or all the others."""
    return [at for at in range(1, count + 1) if (at % FEW == 1) is few]


@pytest.mark.slow
@EVERY
@pytest.mark.parametrize("lose", [False, True], ids=["killed", "power cut"])
@pytest.mark.parametrize("how", ["before", "half", "after"])
def test_interrupted_at_any_operation_the_result_is_the_same(tmp_path, uninterrupted, how, lose, few):
    for at in tried(uninterrupted[2], few):
        root = tmp_path / str(at)
        work = Work(root / "sessions", Camera(root / "incoming"))
        disk = FaultyDisk(at, how)
        with pytest.raises(PowerCut):
            work.go(disk)
        if lose:
            disk.lose()
        check(work.go(FaultyDisk()), work, uninterrupted)


@pytest.mark.parametrize("how", ["before", "half", "after"])
def test_interrupted_while_it_is_opened_it_repeats_no_exposure_in_silence(tmp_path, how):
    for at in range(1, 60):
        with created(tmp_path / str(at), FaultyDisk()) as session:
            session.expect("shots", "frame")
        try:
            opened(session.folder, disk=FaultyDisk(at, how)).close()
        except PowerCut:
            pass
        else:
            assert at == 3 * 4 + 1  # opened, noticed, gave up: four operations each
            break
        with opened(session.folder, disk=FaultyDisk()) as session:
            assert sum("an exposure for frame (shots)" in one for one in session.state.notices) == 1


@EVERY
def test_full_at_any_operation_is_a_sentence_and_with_room_again_it_goes_on(tmp_path, uninterrupted, few):
    for at in tried(uninterrupted[2], few):
        root = tmp_path / str(at)
        work = Work(root / "sessions", Camera(root / "incoming"))
        with pytest.raises(ProcedureError, match="No space left") as refusal:
            work.go(FaultyDisk(at, "full"))
        assert refusal.value.exit_code == 75
        check(work.go(FaultyDisk()), work, uninterrupted)


@pytest.mark.parametrize("opened_again", [False, True])
def test_disk_that_was_full_takes_the_same_shot_once_there_is_room(tmp_path, opened_again):
    disk = FaultyDisk()
    with created(tmp_path, disk) as session:
        exposure = Camera(tmp_path / "incoming").expose("frame")
        disk.at, disk.how = disk.count + 5, "full"  # it is announced: head and line, written and synchronised
        with pytest.raises(ProcedureError, match="No space left"):
            session.adopt(exposure, step="shots", purpose="frame", snapshot={})
        assert exposure.path.is_file()
        assert session.state.shots == ()
        assert list((session.folder / "originals").iterdir()) == []
        disk.full = False
        if opened_again:
            session.close()
            session = opened(session.folder)
            (shot,) = session.state.shots
            assert session.state.notices == ("shot 1 had been announced but not adopted; it is now in the session",)
        else:
            shot = session.adopt(exposure, step="shots", purpose="frame", snapshot={})
        assert session.state.shots == (shot,)
        assert session.original(shot).read_bytes() == exposure.path.read_bytes()
        session.close()
