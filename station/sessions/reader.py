"""Reading of a session on the disk: verified, without lock and without writing."""

from __future__ import annotations

import secrets
import shutil
import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from station.common.durable_files import holds, sha256_of, write_errors
from station.sessions.journal import Contents, Damaged, read_journal
from station.sessions.journal_head import HEAD, Gap, gap
from station.sessions.layout import (
    CONFIG,
    DERIVED,
    JOURNAL,
    ORIGINALS,
    Lock,
    check_layout,
    has_parts,
    is_session,
    read_config,
)
from station.sessions.state import SessionState, replay


@dataclass(frozen=True)
class SessionRecord:
    """The content of a session's folder: frozen configuration, journal, and the resulting state.

    `gap` lists the lines that the journal lacks according to its head.
    """

    folder: Path
    config: Mapping[str, Any]
    contents: Contents
    state: SessionState
    gap: Gap

    @property
    def has_head(self) -> bool:
        """Whether it was ever opened by a version that writes the journal's head."""
        return _has_head(self.contents)

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
        """For programs."""
        from station.results.result_files import plain  # here, because its imports are slow

        return {"schema": "station/session/1", "folder": str(self.folder), "state": plain(asdict(self.state))}


def read_session(folder: Path) -> SessionRecord:
    """A session's configuration and journal, verified; photographs are verified by `verify`.

    Raises BadInput if the folder is not a session; Damaged if the configuration or the journal is damaged.
    """
    check_layout(folder)
    config, first_sum = read_config(folder)
    for pause_s in (*BETWEEN_WRITES_S, 0.0):
        contents = read_journal(folder / JOURNAL, first_sum)
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
    originals = [path for path in (folder / ORIGINALS).iterdir() if not path.name.startswith(".")]
    results = [path for path in (folder / DERIVED).iterdir() if path.name.isdecimal()]
    return [name for path in sorted(originals + results) if (name := path.relative_to(folder).as_posix()) not in known]


def verify(folder: Path, state: SessionState, without: Collection[int] = ()) -> None:
    """Verify that photographs and files of answers have the hashes in the journal.

    Raises Damaged, naming all that differ.
    """
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
            f"bring {JOURNAL} and {HEAD} back from a copy; or resume: files in the folder are kept, and listed",
        )


def sums(folder: Path, state: SessionState) -> bytes:
    """The hashes of configuration, photographs, files of answers and results, in the format of `sha256sum`."""
    entries = {CONFIG: sha256_of(folder / CONFIG)}
    entries |= {shot.path: shot.sha256 for shot in state.shots if not shot.lost}
    entries |= state.given
    for result in state.results:
        entries |= {f"{result.folder}/{name}": digest for name, digest in result.files.items()}
    return "".join(f"{digest}  {name}\n" for name, digest in entries.items()).encode()


def sessions_in(root: Path) -> Iterator[Path]:
    """The folders of all sessions in a folder, also damaged ones, sorted by name; hidden folders are no sessions."""
    if root.is_dir():
        named = [path for path in root.iterdir() if not path.name.startswith(".")]
        yield from sorted(path for path in named if is_session(path) or has_parts(path))


# --- deletion --------------------------------------------------------------------------------------------------------


def delete_session(folder: Path) -> None:
    """Delete a session with its photographs and results.

    Raises BadInput if the folder is not a session; Busy if a program has it open; NotKept if the disk refuses.
    """
    check_layout(folder)
    Lock(folder).release()  # raises if another program has it open
    doomed = folder.with_name(f".deleting-{secrets.token_hex(8)}")
    with write_errors(folder):
        folder.rename(doomed)
        shutil.rmtree(doomed)
