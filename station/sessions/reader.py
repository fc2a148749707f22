"""Reading of a session on the disk: verified, without lock and without writing."""

import contextlib
import os
import secrets
import shutil
import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

from station.common.durable_files import holds, sha256_of, write_errors
from station.results.result_files import RECORD
from station.sessions import layout
from station.sessions.journal import HEAD, Contents, Damaged, Gap, gap, machine, read_journal
from station.sessions.state import SessionShot, SessionState, replay


@dataclass(frozen=True)
class SessionRecord:
    """The content of a session's folder: frozen configuration, journal, and the resulting state. `gap` lists the lines
    that the journal lacks according to its head."""

    folder: Path
    config: Mapping[str, Any]
    contents: Contents
    state: SessionState
    gap: Gap

    @property
    def oddities(self) -> tuple[str, ...]:
        """Irregularities of the journal, as text."""
        torn = "the last line of the journal was not whole and did not count" if self.contents.torn else ""
        return tuple(words for words in (torn, self.lost) if words)

    @property
    def lost(self) -> str:
        """Which lines are missing, or why this is unknown, as text; "" if none, or only an incomplete last one."""
        return "" if self.contents.torn and self.gap.lines == 1 else self.gap.words

    def record(self) -> dict[str, Any]:
        from station.results.result_files import plain  # here, because its imports are slow

        return {"schema": "station/session/1", "folder": str(self.folder), "state": plain(asdict(self.state))}


def read_session(folder: Path) -> SessionRecord:
    """A session's configuration and journal, verified, its photographs by `verify`. Raises BadInput, Damaged."""
    layout.check_layout(folder)
    config, first_sum = layout.read_config(folder)
    for pause_s in (*BETWEEN_WRITES_S, 0.0):
        contents = read_journal(folder / layout.JOURNAL, first_sum)
        missing = gap(folder / HEAD, [line.sum for line in contents.lines], expected=_has_head(contents))
        if not missing.words:
            break
        time.sleep(pause_s)
    return SessionRecord(folder, config, contents, replay(contents.lines), missing)


BETWEEN_WRITES_S = (0.01, 0.05)
"""How long to wait for another program that is writing head and line."""


def _has_head(contents: Contents) -> bool:
    return any(line.event == "opened" and line.data.get("head") for line in contents.lines)


def unknown_files(folder: Path, state: SessionState) -> list[str]:
    """Photographs in originals/ and results in derived/ that are not in the journal."""
    known = {shot.path for shot in (*state.shots, state.adopting) if shot} | {result.folder for result in state.results}
    originals = [path for path in (folder / layout.ORIGINALS).iterdir() if not path.name.startswith(".")]
    results = [path for path in (folder / layout.DERIVED).iterdir() if path.name.isdecimal()]
    return [name for path in sorted(originals + results) if (name := path.relative_to(folder).as_posix()) not in known]


def verify(folder: Path, state: SessionState, without: Collection[int] = ()) -> None:
    """Raise Damaged, naming all, unless photographs and files of answers have the journal's hashes."""
    if lost := [name for name, digest in state.given.items() if not holds(folder / name, digest)]:
        raise Damaged(f"{folder.name}: missing or changed: {', '.join(lost)}", "bring these files back from a copy")
    here = [shot for shot in state.shots if not shot.lost and shot.number not in without]
    wrong = [shot for shot in here if not holds(folder / shot.path, shot.sha256)]
    if wrong:
        names = ", ".join(f"{shot.path} (shot {shot.number}, SHA-256 {shot.sha256})" for shot in wrong)
        numbers = " ".join(f"--without {shot.number}" for shot in wrong)
        raise Damaged(
            f"{folder.name}: missing or changed: {names}",
            f"bring these files back from a copy, or give them up: station session resume {numbers}",
        )


def damaged_results(folder: Path, state: SessionState) -> list[str]:
    """Files of results that are missing or differ from the journal."""
    files = [(f"{result.folder}/{name}", digest) for result in state.results for name, digest in result.files.items()]
    return [name for name, digest in files if not holds(folder / name, digest)]


def verify_results(record: SessionRecord) -> None:
    """Verify every file of every result and every transcript against the journal. Raises Damaged."""
    folder, wires = record.folder, [line.data for line in record.contents.lines if line.event == "wired"]
    files = [(f"{wire['folder']}/{name}", digest) for wire in wires for name, digest in wire["files"].items()]
    changed = [name for name, digest in files if not holds(folder / name, digest)]
    if wrong := damaged_results(folder, record.state) + changed:
        raise Damaged(
            f"{folder.name}: {', '.join(wrong)}: missing or changed",
            "bring these files back from a copy; `station session resume --back-to STEP` computes a new result",
        )


def check_whole(record: SessionRecord) -> None:
    """Check that the journal has all lines that its head counts. Raises Damaged."""
    if record.lost:
        raise Damaged(
            f"{record.folder.name}: {record.lost}",
            f"bring {layout.JOURNAL} and {HEAD} back from a copy; or resume: files in the folder are kept, and listed",
        )


def sums(folder: Path, state: SessionState) -> bytes:
    """The hashes of configuration, photographs, files of answers and results, in the format of `sha256sum`."""
    entries = {layout.CONFIG: sha256_of(folder / layout.CONFIG)}
    entries |= {shot.path: shot.sha256 for shot in state.shots if not shot.lost}
    entries |= state.given
    for result in state.results:
        entries |= {f"{result.folder}/{name}": digest for name, digest in result.files.items()}
    return "".join(f"{digest}  {name}\n" for name, digest in entries.items()).encode()


def sessions_in(root: Path) -> Iterator[Path]:
    """The folders of all sessions in a folder, also damaged ones, sorted by name; hidden folders are no sessions."""
    if root.is_dir():
        named = [path for path in root.iterdir() if not path.name.startswith(".")]
        yield from sorted(path for path in named if layout.is_session(path) or layout.has_parts(path))


def delete_session(folder: Path) -> None:
    """Delete a session with photographs and results. Raises BadInput if it is none; Busy if open; WriteFailed."""
    layout.check_layout(folder)
    layout.Lock(folder).release()  # raises if another program has it open
    doomed = folder.with_name(f".deleting-{secrets.token_hex(8)}")
    with write_errors(folder):
        folder.rename(doomed)
        shutil.rmtree(doomed)


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
    """Clean up, complete photographs, report lost lines, missing and unknown files, `without` some shots. Raises
    WriteFailed."""
    _sweep(session.folder)
    if record.gap.lines:
        session.note("cut", lines=record.gap.lines)
    elif _has_head(record.contents) and not record.oddities:  # the journal is complete: these were never confirmed
        for relative in unknown_files(session.folder, session.state):
            if relative.startswith(layout.DERIVED) and not (session.folder / relative).is_symlink():
                shutil.rmtree(session.folder / relative, ignore_errors=True)
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
    _repeat_unfinished(session)
    unknown = unknown_files(session.folder, session.state)
    for relative in unknown:
        path = session.folder / relative
        file = path / RECORD if relative.startswith(layout.DERIVED) else path
        digest = sha256_of(file) if file.is_file() and not file.is_symlink() else ""
        if session.state.strangers.get(relative) != digest:
            session.note("found", path=relative, sha256=digest)
            where = f"{path.name!r} is in {path.parent.name}/ but not in the journal"
            session.notice(f"{where}; it is kept unchanged, and not used")
    session.leftovers = tuple(session.folder / path for path in unknown if path.startswith(layout.DERIVED))
    session.write_sums()


def finish_adopting(session: OpenSession, shot: SessionShot) -> None:
    """Adopt an announced photograph if it still exists unchanged; otherwise report it as lost."""
    source = Path(shot.exposure["path"])
    if holds(session.folder / shot.path, shot.sha256) or holds(source, shot.sha256):
        session.take_in(shot, source)
        session.notice(f"shot {shot.number} had been announced but not adopted; it is now in the session")
        return
    words = f"shot {shot.number} had been announced but not adopted, and {source} is missing or changed: "
    _say_and_give_up(session, words + "it will be taken again", shot=shot.number)


def _say_and_give_up(session: OpenSession, say: str, **what: Any) -> None:
    """Report, then give up, in this order: after a power failure between the two nothing is repeated unreported."""
    if say not in session.state.notices:
        session.notice(say)
    session.note("gave_up", **what)


def _sweep(folder: Path) -> None:
    halves = (
        folder.glob(".*.part"),
        (folder / layout.ORIGINALS).glob(".*.part"),
        (folder / layout.GIVEN).glob("*/.*.part"),
    )
    for part in chain.from_iterable(halves):
        part.unlink()
    for unfinished in (folder / layout.DERIVED).glob("*/.unfinished-*"):
        if not unfinished.parent.is_symlink():
            shutil.rmtree(unfinished, ignore_errors=True)
            with contextlib.suppress(OSError):  # it is not empty
                unfinished.parent.rmdir()


def _repeat_unfinished(session: OpenSession) -> None:
    if awaited := session.state.awaited:
        words = (
            f"an exposure for {awaited.purpose} ({awaited.step}) was requested, but its photograph is not in the "
            "session: it will be taken again"
        )
        _say_and_give_up(session, words, step=awaited.step, purpose=awaited.purpose)
    step = session.state.step
    others = [shot for shot in session.state.shots if shot.step == step and not shot.counts and not shot.lost]
    say = (
        f"the step {step} was not finished and begins again; of its {len(others)} photographs that do not count so "
        "far, trials will be taken again"
    )
    if step and others and say not in session.state.notices:
        session.notice(say)
