"""When a session is opened: what a crash left half done is finished, and whatever is odd is said."""

from __future__ import annotations

import os
import shutil
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from station.disk import holds, sha256_of
from station.machine import machine
from station.session_folder import DERIVED, ORIGINALS
from station.session_state import Shot

if TYPE_CHECKING:
    from station.session import Session


def recover(session: Session, torn: bytes, without: Collection[int] = ()) -> None:
    """Sweep up, say what was torn, take in what was announced, and name what is missing or strange.

    Parameters
    ----------
    torn : what stood after the last whole line of the journal
    without : shots to give up

    Raises
    ------
    NotKept
        If the disk takes nothing more.
    """
    _sweep(session.folder, len(session.state.results))
    session.note("opened", process=os.getpid(), machine=machine())
    if torn:
        session.note("torn", bytes=len(torn), text=torn[:10_000].decode("utf-8", "replace"))
        session.notice("the last line of the journal was not whole and did not count")
    for number in without:
        if any(shot.number == number and not shot.lost for shot in session.state.shots):
            session.note("lost", shot=number)
            session.notice(f"shot {number} was given up: its photograph is lost")
    if session.state.adopting is not None:
        finish_adopting(session, session.state.adopting)
    _give_up_awaited(session)
    _name_unfinished(session)
    _name_strangers(session)
    session.write_sums()


def finish_adopting(session: Session, shot: Shot) -> None:
    """Take in a photograph that was announced, if it is still there as it was; else say that it is lost."""
    source = Path(shot.exposure["path"])
    if holds(session.folder / shot.path, shot.sha256) or holds(source, shot.sha256):
        session.take_in(shot, source)
        session.notice(f"shot {shot.number} had been announced and not taken in; now it is in the session")
        return
    session.note("gave_up", shot=shot.number)
    session.notice(
        f"shot {shot.number} had been announced and not taken in, and {source} is not there as it was: "
        "it will be taken again"
    )


def _give_up_awaited(session: Session) -> None:
    awaited = session.state.awaited
    if awaited is None:
        return
    session.note("gave_up", step=awaited.step, purpose=awaited.purpose)
    session.notice(
        f"an exposure for {awaited.purpose} ({awaited.step}) was asked for, and its photograph is not in the session: "
        "it will be taken again"
    )


def _name_unfinished(session: Session) -> None:
    """A step that was begun and not finished begins anew: shots that count are used, trials are taken anew."""
    step = session.state.step
    others = [shot for shot in session.state.shots if shot.step == step and not shot.counts and not shot.lost]
    say = (
        f"the step {step} was not finished and begins again; of its {len(others)} photographs that do not count so "
        "far, trials will be taken again"
    )
    if step and others and say not in session.state.notices:
        session.notice(say)


def _name_strangers(session: Session) -> None:
    """Files in originals/ that the journal does not speak of are named, once, and left alone."""
    known = {shot.path for shot in session.state.shots}
    for path in sorted((session.folder / ORIGINALS).iterdir()):
        relative = f"{ORIGINALS}/{path.name}"
        digest = sha256_of(path) if path.is_file() and not path.is_symlink() else ""
        if relative not in known and session.state.strangers.get(relative) != digest:
            session.note("found", path=relative, sha256=digest)
            session.notice(f"{path.name!r} lies in {ORIGINALS}/, but the session did not put it there; it is not used")


def _sweep(folder: Path, results: int) -> None:
    """Remove what a crash left half-written: parts of files, and results that nobody was told of."""
    for part in (*folder.glob(".*.part"), *(folder / ORIGINALS).glob(".*.part")):
        part.unlink()
    for unfinished in (folder / DERIVED).glob("*/.unfinished-*"):
        if not unfinished.parent.is_symlink():
            shutil.rmtree(unfinished, ignore_errors=True)
    for result in (folder / DERIVED).iterdir():
        if result.name.isdecimal() and int(result.name) > results and not result.is_symlink():
            shutil.rmtree(result, ignore_errors=True)
