"""A session as it lies on the disk: read and checked, without a lock, and nothing is written."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.disk import holds, sha256_of
from station.journal import Contents, Damaged, read_journal
from station.session_folder import CONFIG, JOURNAL, check_layout, is_session, read_config
from station.session_state import State, replay


@dataclass(frozen=True)
class SessionRecord:
    """What a session's folder tells: its frozen configuration, its journal, and the state that this comes to."""

    folder: Path
    config: Mapping[str, Any]
    contents: Contents
    state: State


def read_session(folder: Path) -> SessionRecord:
    """A session's configuration and journal, checked; photographs are checked by `verify`.

    Raises
    ------
    BadInput
        If the folder is no session.
    Damaged
        If the configuration or the journal is not what was written.
    """
    check_layout(folder)
    config, first_sum = read_config(folder)
    contents = read_journal(folder / JOURNAL, first_sum)
    return SessionRecord(folder, config, contents, replay(contents.lines))


def verify(folder: Path, state: State, without: Collection[int] = ()) -> None:
    """Every photograph has the hash that the journal tells. Raises Damaged, naming all that have not."""
    here = [shot for shot in state.shots if not shot.lost and shot.number not in without]
    wrong = [shot for shot in here if not holds(folder / shot.path, shot.sha256)]
    if wrong:
        names = ", ".join(f"{shot.path} (shot {shot.number}, SHA-256 {shot.sha256})" for shot in wrong)
        numbers = " ".join(f"--without {shot.number}" for shot in wrong)
        raise Damaged(
            f"{folder.name}: missing or changed: {names}",
            f"bring these files back from a copy, or give them up: station session resume {numbers}",
        )


def sums(folder: Path, state: State) -> bytes:
    """The hashes of configuration, photographs and results, as `sha256sum` writes them."""
    entries = {CONFIG: sha256_of(folder / CONFIG)}
    entries |= {shot.path: shot.sha256 for shot in state.shots if not shot.lost}
    for result in state.results:
        entries |= {f"{result.folder}/{name}": digest for name, digest in result.files.items()}
    return "".join(f"{digest}  {name}\n" for name, digest in entries.items()).encode()


def sessions_in(root: Path) -> Iterator[Path]:
    """The folders of all sessions in a folder, oldest name first; hidden ones are none yet."""
    if root.is_dir():
        yield from sorted(path for path in root.iterdir() if not path.name.startswith(".") and is_session(path))
