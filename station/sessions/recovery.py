"""When a session is opened: what a crash left half done is finished, and whatever is odd is said."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Collection
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

from station.common.durable_files import holds, sha256_of
from station.results.result_files import RECORD
from station.sessions.compute_environment import machine
from station.sessions.given_files import GIVEN
from station.sessions.journal_head import HEAD
from station.sessions.layout import DERIVED, ORIGINALS
from station.sessions.reader import SessionRecord, damaged_results, unknown_files
from station.sessions.state import SessionShot, SessionState


class OpenSession(Protocol):
    """What recovery does with a session that is open for writing."""

    folder: Path
    leftovers: tuple[Path, ...]

    @property
    def state(self) -> SessionState:
        """What the journal says now."""

    def note(self, event: str, **data: Any) -> None:
        """Append a line to the journal."""

    def notice(self, say: str) -> None:
        """Something the operator must hear."""

    def take_in(self, shot: SessionShot, source: Path) -> SessionShot:
        """Copy a photograph that was announced, and confirm it."""

    def write_sums(self) -> None:
        """The hashes of all originals, as a file."""


def recover(session: OpenSession, record: SessionRecord, without: Collection[int] = ()) -> None:
    """Sweep up, say what was torn or lost, take in what was announced, and name what is missing or strange.

    Parameters
    ----------
    record : the session as it was found
    without : shots to give up

    Raises
    ------
    NotKept
        If the disk takes nothing more.
    """
    _sweep(session.folder)
    if record.gap.lines:
        session.note("cut", lines=record.gap.lines)
    elif record.has_head and not record.oddities:
        _discard_unconfirmed(session)
    session.note("opened", process=os.getpid(), machine=machine(), head=HEAD)
    if torn := record.contents.torn:
        session.note("torn", bytes=len(torn), text=torn[:10_000].decode("utf-8", "replace"))
    for words in record.oddities:
        session.notice(words)
    for number in without:
        if any(shot.number == number and not shot.lost for shot in session.state.shots):
            session.note("lost", shot=number)
            session.notice(f"shot {number} was given up: its photograph is lost")
    if session.state.adopting is not None:
        finish_adopting(session, session.state.adopting)
    if wrong := damaged_results(session.folder, session.state):
        session.notice(f"{', '.join(wrong)}: missing, or not what was written; bring them back from a copy")
    _give_up_awaited(session)
    _name_unfinished(session)
    _name_strangers(session)
    session.write_sums()


def finish_adopting(session: OpenSession, shot: SessionShot) -> None:
    """Take in a photograph that was announced, if it is still there as it was; else say that it is lost."""
    source = Path(shot.exposure["path"])
    if holds(session.folder / shot.path, shot.sha256) or holds(source, shot.sha256):
        session.take_in(shot, source)
        session.notice(f"shot {shot.number} had been announced and not taken in; now it is in the session")
        return
    _say_and_give_up(
        session,
        f"shot {shot.number} had been announced and not taken in, and {source} is not there as it was: "
        "it will be taken again",
        shot=shot.number,
    )


def _say_and_give_up(session: OpenSession, say: str, **what: Any) -> None:
    """In this order: between the two the power may go, and nothing is repeated in silence."""
    if say not in session.state.notices:
        session.notice(say)
    session.note("gave_up", **what)


def _give_up_awaited(session: OpenSession) -> None:
    awaited = session.state.awaited
    if awaited is None:
        return
    _say_and_give_up(
        session,
        f"an exposure for {awaited.purpose} ({awaited.step}) was asked for, and its photograph is not in the session: "
        "it will be taken again",
        step=awaited.step,
        purpose=awaited.purpose,
    )


def _name_unfinished(session: OpenSession) -> None:
    """A step that was begun and not finished begins anew: shots that count are used, trials are taken anew."""
    step = session.state.step
    others = [shot for shot in session.state.shots if shot.step == step and not shot.counts and not shot.lost]
    say = (
        f"the step {step} was not finished and begins again; of its {len(others)} photographs that do not count so "
        "far, trials will be taken again"
    )
    if step and others and say not in session.state.notices:
        session.notice(say)


def _name_strangers(session: OpenSession) -> None:
    """Photographs and results that the journal does not speak of are named, once, and left alone."""
    unknown = unknown_files(session.folder, session.state)
    for relative in unknown:
        path = session.folder / relative
        file = path / RECORD if relative.startswith(DERIVED) else path
        digest = sha256_of(file) if file.is_file() and not file.is_symlink() else ""
        if session.state.strangers.get(relative) != digest:
            session.note("found", path=relative, sha256=digest)
            where = f"{path.name!r} lies in {path.parent.name}/, but the journal does not speak of it"
            session.notice(f"{where}; it is kept as it is, and not used")
    session.leftovers = tuple(session.folder / one for one in unknown if one.startswith(DERIVED))


def _discard_unconfirmed(session: OpenSession) -> None:
    """Results that nobody was told of, which is sure only where the journal is known to be whole."""
    for relative in unknown_files(session.folder, session.state):
        if relative.startswith(DERIVED) and not (session.folder / relative).is_symlink():
            shutil.rmtree(session.folder / relative, ignore_errors=True)


def _sweep(folder: Path) -> None:
    """Remove what a crash left half-written."""
    halves = (folder.glob(".*.part"), (folder / ORIGINALS).glob(".*.part"), (folder / GIVEN).glob("*/.*.part"))
    for part in chain.from_iterable(halves):
        part.unlink()
    for unfinished in (folder / DERIVED).glob("*/.unfinished-*"):
        if not unfinished.parent.is_symlink():
            shutil.rmtree(unfinished, ignore_errors=True)
            with contextlib.suppress(OSError):  # there is more in it
                unfinished.parent.rmdir()
