"""Photographs in folders: search, grouping, and unreadable ones."""

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from drivers.frames import RAW_SUFFIXES as DRIVER_SUFFIXES
from procedures.outcome import BadInput, BadParameter, Miss, Outcome
from procedures.reading.text import read_rows
from station.common.sanitise import encodable, printable
from station.results.result_files import RECORD

T = TypeVar("T")

RAW_SUFFIXES = DRIVER_SUFFIXES | {".fff", ".k25", ".rwl", ".sr2", ".srf"}
GREY_SUFFIXES = frozenset((".pgm", ".png", ".tif", ".tiff"))
PHOTOGRAPHS = RAW_SUFFIXES | GREY_SUFFIXES
HIDDEN = (".", "~")  # first letters of hidden and temporary files, and of those that macOS adds to each on a card


def photographs_in(folder: Path) -> set[Path]:
    """The photographs directly in a folder, without hidden and temporary ones. Raises BadInput where there is none."""
    if not folder.is_dir():
        raise BadInput(f"there is no folder {folder}", "create it, or name another one")
    return {p for p in folder.iterdir() if p.suffix.lower() in PHOTOGRAPHS and not p.name.startswith(HIDDEN)}


@dataclass(frozen=True)
class Item:
    """The input of one estimate: one photograph, or several that belong together.

    trouble, remedy : why it cannot be estimated, or ""; and the remedy.
    """

    paths: tuple[Path, ...]
    trouble: str = ""
    remedy: str = "rename it, or take it out of the folder"

    @property
    def files(self) -> tuple[str, ...]:
        """The paths, encodable in UTF-8."""
        return tuple(encodable(str(path)) for path in self.paths)

    @property
    def shown(self) -> str:
        """The item on one line of a terminal."""
        return printable(" + ".join(str(path) for path in self.paths))


def _refuse(folder: Path, error: OSError) -> None:
    raise BadInput(f"{printable(folder)} cannot be read: {error.strerror}", NOT_READ) from error


NOT_READ = "check its permissions, or name the other folders"


def unread(folder: Path, error: OSError) -> Item:
    """An item for a folder that cannot be read."""
    return Item((folder,), f"the folder cannot be read: {error.strerror}", NOT_READ)


def find_frames(
    folders: Sequence[Path],
    out: Path,
    missed: Callable[[Path, OSError], object] = _refuse,
    suffixes: Collection[str] = PHOTOGRAPHS,
) -> list[Path]:
    """Files in folders and below, each once, folder by folder and ordered by name.

    `suffixes` are those of the wanted files, or whole names; by default those of photographs. Files may be given, too,
    with any suffix. Hidden folders, hidden and temporary files, `out`, the folder of results, its `results`, and the
    pictures beside a record of this program are excluded. Pipes and broken links are included: reading them raises an
    error with their name. `missed` is called for each folder that cannot be read, which raises by default. Raises
    BadParameter if one of the folders does not exist, or there is no photograph in all of them; BadInput if a folder
    cannot be read, and `missed` is not given.
    """
    files: dict[str, Path] = {}
    outs = os.path.realpath(out), os.path.realpath(out / "results")
    for folder in folders:
        if not os.path.lexists(folder):
            raise BadParameter(f"there is no folder {printable(folder)}", "check the path")
        for path in [folder] if folder.is_file() else _below(folder, outs, missed, suffixes):
            files.setdefault(os.path.realpath(path), path)  # which ends in loops of links, too
    if not files:
        where = ", ".join(map(printable, folders))
        if PHOTOGRAPHS.issubset(suffixes):
            raise BadParameter(f"no photographs in {where}", "name folders with RAW, PGM, PNG or TIFF files")
        words = ", ".join(sorted(suffixes))
        raise BadParameter(f"no {words} in {where}", f"name folders with {words}")
    return list(files.values())


def _below(
    folder: Path, outs: Sequence[str], missed: Callable[[Path, OSError], object], suffixes: Collection[str]
) -> Iterator[Path]:
    for root, folders, files in os.walk(folder, onerror=lambda error: missed(Path(error.filename), error)):
        here = Path(root)
        folders[:] = sorted(
            name for name in folders if not name.startswith(".") and os.path.realpath(here / name) not in outs
        )
        if here != folder and RECORD not in suffixes and RECORD in files and _is_own(here / RECORD):
            continue
        for name in sorted(files):
            if (Path(name).suffix.lower() in suffixes or name in suffixes) and not name.startswith(HIDDEN):
                yield here / name


def _is_own(record: Path) -> bool:
    """Whether a record is one of this program: its first entry is the schema."""
    try:
        with record.open("rb") as file:
            return b'"station/' in file.read(64)
    except OSError:
        return False


def singly(frames: Sequence[Path]) -> list[Item]:
    """Each photograph separately."""
    return [Item((frame,)) for frame in frames]


def by_folder(frames: Sequence[Path]) -> list[Item]:
    """The photographs of each folder together."""
    folders: dict[Path, list[Path]] = {}
    for frame in frames:
        folders.setdefault(frame.parent, []).append(frame)
    return [Item(tuple(folder)) for folder in folders.values()]


def naming_path(path: Path) -> Path:
    """The path that names a file: for a record, the folder of its result."""
    return path.parent if path.name == RECORD else path


def in_pairs(frames: Sequence[Path], endings: tuple[str, str]) -> list[Item]:
    """Pairs of photographs or results in one folder whose names differ by endings; those without a partner have this
    trouble."""
    groups: dict[tuple[Path, str], dict[str, Path]] = {}
    alone: list[Path] = []
    for frame in frames:
        name = naming_path(frame)
        ending = next((end for end in endings if name.stem.lower().endswith(end.lower())), None)
        if ending is None:
            alone.append(frame)
        else:
            groups.setdefault((name.parent, name.stem[: -len(ending)]), {}).setdefault(ending, frame)
    pairs = [Item(tuple(group[end] for end in endings)) for group in groups.values() if len(group) == 2]
    alone += [frame for group in groups.values() if len(group) == 1 for frame in group.values()]
    words = f"a pair's names end in {endings[0]} and {endings[1]}; this one has no partner"
    return pairs + [Item((frame,), words) for frame in alone]


def in_rows(frames: Sequence[Path], table: Path, least: int = 2, most: int | None = None) -> list[Item]:
    """The photographs of each row of a CSV file, by name or end of path; a row of unknown, ambiguous or wrongly many
    names has this trouble. Raises BadInput for no table, or no rows."""
    lines = [
        [name.strip() for name in row] for row in read_rows(table, "give a CSV file: a row of names for each item")
    ]
    rows = [[name for name in row if name] for row in lines if any(row)]
    if rows and not any(_named(frames, name) for name in rows[0]):
        rows = rows[1:]
    if not rows:
        raise BadInput(f"{printable(table)} has no rows of photographs", "write for example: scene_1.dng,scene_2.dng")
    return [_row(frames, row, table, least, most or len(row)) for row in rows]


def _named(frames: Sequence[Path], name: str) -> list[Path]:
    parts = Path(name).parts
    return [frame for frame in frames if parts and frame.parts[-len(parts) :] == parts]


def _row(frames: Sequence[Path], names: Sequence[str], table: Path, least: int, most: int) -> Item:
    matches = [_named(frames, name) for name in names]
    words = [f"{len(match) or 'no'} photographs are called {printable(name)}"
             for name, match in zip(names, matches, strict=True) if len(match) != 1]  # fmt: skip
    if not least <= len(names) <= most:
        words.append(f"{least} photographs are required; the row has {len(names)}")
    if words:
        here = tuple(match[0] if match else Path(name) for name, match in zip(names, matches, strict=True))
        return Item(here, f"{printable(table.name)}: {'; '.join(words)}", "correct the table, or the folders")
    return Item(tuple(match[0] for match in matches))


def readable(paths: Iterable[Path], read: Callable[[Path], T], missed: list[Miss]) -> Iterator[T]:
    """The photographs that `read` can read, in turn; the others are added to `missed`."""
    for path in paths:
        try:
            frame = read(path)
        except BadInput as error:
            missed.append(Miss(str(path), error.reason, error.remedy))
        else:
            yield frame


def check_any(missed: Sequence[Miss], count: int) -> None:
    """Raises BadInput where none of `count` photographs is left."""
    if count == 0:
        raise BadInput("there are no photographs to measure", "name a folder that holds some")
    if len(missed) == count:
        raise BadInput(f"none of {count} photographs can be used; {missed[0]}", missed[0].remedy)


def for_want(outcome: Outcome[T], missed: Sequence[Miss], count: int) -> Outcome[T]:
    """The outcome; a refusal mentions the unusable ones of `count` photographs, which may be its cause."""
    if outcome.value is not None or not missed:
        return outcome
    reason = f"{outcome.reason}; {len(missed)} of {count} photographs cannot be used, {missed[0]}"
    return replace(outcome, reason=reason)
