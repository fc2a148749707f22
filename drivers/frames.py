"""RAW files as they come from a body: which names count, what was photographed, whether it is what was asked for."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import FrameWrong
from drivers.interfaces import CameraSettings

TIFF_LIKE = frozenset((".3fr", ".arw", ".cr2", ".dng", ".erf", ".iiq", ".kdc", ".nef", ".nrw", ".pef", ".srw"))
OTHERS = frozenset((".cr3", ".crw", ".dcr", ".mef", ".mos", ".mrw", ".orf", ".raf", ".raw", ".rw2", ".x3f"))
RAW_SUFFIXES = TIFF_LIKE | OTHERS
THIRD_STOP = 2 ** (1 / 3) - 1  # bodies round their settings to thirds of a stop


@dataclass(frozen=True)
class Facts:
    """What a file says about its exposure; None where it does not."""

    exposure_s: float | None = None
    iso: int | None = None
    f_number: float | None = None


# Decodes a RAW file and tells its facts; any exception means that it is not (yet) a good file.
Inspect = Callable[[Path], Facts]


def is_raw(path: Path) -> bool:
    """Whether its name is that of a RAW file, and no temporary or hidden one."""
    return path.suffix.lower() in RAW_SUFFIXES and not path.name.startswith((".", "~"))


def sha256_of(path: Path) -> str:
    """The file's hash, in hex."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_settings(path: Path, facts: Facts, wanted: CameraSettings) -> None:
    """Raises FrameWrong if the file tells other settings than were wanted, beyond a third of a stop."""
    for unit, asked, told in (
        (" s", wanted.exposure_s, facts.exposure_s),
        (" ISO", wanted.iso, facts.iso),
        ("", wanted.f_number, facts.f_number),
    ):
        if asked is not None and told is not None and not 1 / (1 + THIRD_STOP) <= told / asked <= 1 + THIRD_STOP:
            raise FrameWrong(
                f"{path.name} was taken at {told:g}{unit} instead of {asked:g}{unit}", "set the body, repeat"
            )
