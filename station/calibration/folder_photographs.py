"""The photographs in folders, and which of them belong together."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from procedures.outcome import BadInput, BadParameter
from station.common.sanitise import encodable, printable

RAW_SUFFIXES = frozenset(
    """.3fr .arw .cr2 .cr3 .crw .dcr .dng .erf .fff .iiq .k25 .kdc .mef .mos .mrw .nef .nrw .orf .pef .raf .raw .rw2
    .rwl .sr2 .srf .srw .x3f""".split()  # noqa: SIM905  (a list of them in quotes is twice as long)
)
GREY_SUFFIXES = frozenset((".pgm", ".png", ".tif", ".tiff"))


@dataclass(frozen=True)
class Item:
    """What is estimated at once: one photograph, or two of one wall.

    Attributes
    ----------
    paths : tuple of Path
    trouble, remedy : str
        Why nothing can be estimated, "" where something can; and what to do.
    """

    paths: tuple[Path, ...]
    trouble: str = ""
    remedy: str = "rename it, or take it out of the folder"

    @property
    def files(self) -> tuple[str, ...]:
        """The paths as text that can be written to a file."""
        return tuple(encodable(str(path)) for path in self.paths)

    @property
    def shown(self) -> str:
        """The item on one line of a terminal."""
        return printable(" + ".join(str(path) for path in self.paths))


def _refuse(folder: Path, error: OSError) -> None:
    raise BadInput(f"{printable(folder)} cannot be read: {error.strerror}", NOT_READ) from error


NOT_READ = "check its permissions, or name the folders beside it"


def unread(folder: Path, error: OSError) -> Item:
    """A folder that cannot be read, as an item that nothing comes of."""
    return Item((folder,), f"the folder cannot be read: {error.strerror}", NOT_READ)


def find_frames(folders: Sequence[Path], out: Path, missed: Callable[[Path, OSError], object] = _refuse) -> list[Path]:
    """Photographs in folders and below, by their suffix, each once, folder by folder and in the order of their names.

    Files may be named too, whatever their suffix. Hidden folders are left out, and so is `out`, where results go. Pipes
    and links that lead nowhere are among them, if they are called so: whoever reads one refuses it by name.
    `missed` is told of each folder that cannot be read; by default that is refused.

    Raises
    ------
    BadParameter
        If one of the folders does not exist, or there is no photograph in all of them.
    BadInput
        If a folder cannot be read, and `missed` is left out.
    """
    found: dict[str, Path] = {}
    for folder in folders:
        if not os.path.lexists(folder):
            raise BadParameter(f"there is no folder {printable(folder)}", "check the path")
        for path in [folder] if folder.is_file() else _below(folder, os.path.realpath(out), missed):
            found.setdefault(os.path.realpath(path), path)  # which goes round no loop of links
    if not found:
        raise BadParameter(
            f"no photographs in {', '.join(map(printable, folders))}", "name folders that hold RAW, PGM, PNG or TIFF"
        )
    return list(found.values())


def _below(folder: Path, out: str, missed: Callable[[Path, OSError], object]) -> Iterator[Path]:
    for root, folders, files in os.walk(folder, onerror=lambda error: missed(Path(error.filename), error)):
        here = Path(root)
        folders[:] = sorted(
            name for name in folders if not name.startswith(".") and os.path.realpath(here / name) != out
        )
        for name in sorted(files):
            if Path(name).suffix.lower() in RAW_SUFFIXES | GREY_SUFFIXES:
                yield here / name


def singly(frames: Sequence[Path]) -> list[Item]:
    """Each photograph for itself."""
    return [Item((frame,)) for frame in frames]


def by_folder(frames: Sequence[Path]) -> list[Item]:
    """The photographs of each folder together."""
    folders: dict[Path, list[Path]] = {}
    for frame in frames:
        folders.setdefault(frame.parent, []).append(frame)
    return [Item(tuple(found)) for found in folders.values()]


def in_pairs(frames: Sequence[Path], endings: tuple[str, str]) -> list[Item]:
    """Two photographs each: of one folder and one suffix, with names that differ by their endings only.

    Photographs without a partner are items of their own, with that as their trouble.
    """
    groups: dict[tuple[Path, str], dict[str, Path]] = {}
    alone: list[Path] = []
    for frame in frames:
        ending = next((end for end in endings if frame.stem.lower().endswith(end.lower())), None)
        if ending is None:
            alone.append(frame)
        else:
            groups.setdefault((frame.parent, frame.stem[: -len(ending)]), {}).setdefault(ending, frame)
    pairs = [Item(tuple(one[end] for end in endings)) for one in groups.values() if len(one) == 2]
    alone += [frame for one in groups.values() if len(one) == 1 for frame in one.values()]
    words = f"a pair's names end in {endings[0]} and {endings[1]}; this photograph has no partner"
    return pairs + [Item((frame,), words) for frame in alone]
