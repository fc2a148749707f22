"""Recovery when a session is opened: completes what a crash interrupted, and reports irregularities."""

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
from station.sessions.journal_head import HEAD
from station.sessions.layout import DERIVED, GIVEN, ORIGINALS
from station.sessions.reader import SessionRecord, damaged_results, unknown_files
from station.sessions.state import SessionShot, SessionState


class OpenSession(Protocol):
    """The operations of recovery on a session that is open for writing."""

    folder: Path
    leftovers: tuple[Path, ...]

    @property
    def state(self) -> SessionState:
        """The state according to the journal."""

    def note(self, event: str, **data: Any) -> None:
        """Append a line to the journal."""

    def notice(self, say: str) -> None:
        """Record a message for the operator."""

    def take_in(self, shot: SessionShot, source: Path) -> SessionShot:
        """Copy an announced photograph, and confirm it."""

    def write_sums(self) -> None:
        """Write the hashes of all originals to a file."""


def recover(session: OpenSession, record: SessionRecord, without: Collection[int] = ()) -> None:
    """Clean up, report incomplete or lost lines, complete announced photographs, and list missing or unknown files.

    record : the session as read; without : shots to give up. Raises NotKept if the disk refuses.
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
        session.notice(f"{', '.join(wrong)}: missing or changed; bring them back from a copy")
    _give_up_awaited(session)
    _name_unfinished(session)
    _name_strangers(session)
    session.write_sums()


def finish_adopting(session: OpenSession, shot: SessionShot) -> None:
    """Adopt an announced photograph if it still exists unchanged; otherwise report it as lost."""
    source = Path(shot.exposure["path"])
    if holds(session.folder / shot.path, shot.sha256) or holds(source, shot.sha256):
        session.take_in(shot, source)
        session.notice(f"shot {shot.number} had been announced but not adopted; it is now in the session")
        return
    _say_and_give_up(
        session,
        f"shot {shot.number} had been announced but not adopted, and {source} is missing or changed: "
        "it will be taken again",
        shot=shot.number,
    )


def _say_and_give_up(session: OpenSession, say: str, **what: Any) -> None:
    """Report, then give up, in this order: after a power failure between the two nothing is repeated unreported."""
    if say not in session.state.notices:
        session.notice(say)
    session.note("gave_up", **what)


def _give_up_awaited(session: OpenSession) -> None:
    awaited = session.state.awaited
    if awaited is None:
        return
    _say_and_give_up(
        session,
        f"an exposure for {awaited.purpose} ({awaited.step}) was requested, but its photograph is not in the session: "
        "it will be taken again",
        step=awaited.step,
        purpose=awaited.purpose,
    )


def _name_unfinished(session: OpenSession) -> None:
    """A step that was not finished begins again: shots that count are used, trials are repeated."""
    step = session.state.step
    others = [shot for shot in session.state.shots if shot.step == step and not shot.counts and not shot.lost]
    say = (
        f"the step {step} was not finished and begins again; of its {len(others)} photographs that do not count so "
        "far, trials will be taken again"
    )
    if step and others and say not in session.state.notices:
        session.notice(say)


def _name_strangers(session: OpenSession) -> None:
    """List photographs and results that are not in the journal, once; they stay untouched."""
    unknown = unknown_files(session.folder, session.state)
    for relative in unknown:
        path = session.folder / relative
        file = path / RECORD if relative.startswith(DERIVED) else path
        digest = sha256_of(file) if file.is_file() and not file.is_symlink() else ""
        if session.state.strangers.get(relative) != digest:
            session.note("found", path=relative, sha256=digest)
            where = f"{path.name!r} is in {path.parent.name}/ but not in the journal"
            session.notice(f"{where}; it is kept unchanged, and not used")
    session.leftovers = tuple(session.folder / path for path in unknown if path.startswith(DERIVED))


def _discard_unconfirmed(session: OpenSession) -> None:
    """Remove results that were never confirmed, which is certain only if the journal is known to be complete."""
    for relative in unknown_files(session.folder, session.state):
        if relative.startswith(DERIVED) and not (session.folder / relative).is_symlink():
            shutil.rmtree(session.folder / relative, ignore_errors=True)


def _sweep(folder: Path) -> None:
    """Remove files that a crash left half-written."""
    halves = (folder.glob(".*.part"), (folder / ORIGINALS).glob(".*.part"), (folder / GIVEN).glob("*/.*.part"))
    for part in chain.from_iterable(halves):
        part.unlink()
    for unfinished in (folder / DERIVED).glob("*/.unfinished-*"):
        if not unfinished.parent.is_symlink():
            shutil.rmtree(unfinished, ignore_errors=True)
            with contextlib.suppress(OSError):  # it is not empty
                unfinished.parent.rmdir()
