"""Capture of messages that C libraries print to standard error, for the reader instead of the terminal."""

import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, BinaryIO, cast

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array32, Mask

# LibRaw's default data callback, OpenCV's logger with its stack lines, libpng and libtiff
_OWN_LINES = re.compile(
    rb"[^\n]*(?:: Unexpected end of file|: data corrupted(?: at [^\n]*)?)\n?"
    rb"|\[ ?(?:WARN|ERROR|INFO|DEBUG)[^\n]*\n(?:[> ][^\n]*\n|\n)*"
    rb"|(?:libpng|TIFF\w*|OpenCV)[^\n]*\n?"
)
_ERRORS = re.compile(rb"Unexpected end of file|data corrupted|\[ERROR|libpng error|can't read|CRC error|IDAT")
_one_at_a_time = threading.RLock()


@dataclass
class LibraryWords:
    """Messages of the libraries; `text` is available after the block."""

    text: bytes = b""

    @property
    def errors(self) -> bool:
        """Whether a library reported missing or damaged data."""
        return bool(_ERRORS.search(self.text))


@contextmanager
def captured_noise() -> Iterator[LibraryWords]:
    """Collect what libraries write to the process's standard error during the block.

    The file descriptor is shared by all threads, so output of others meanwhile is passed on afterwards.
    """
    noise = LibraryWords()
    with _one_at_a_time, _unnamed_file() as file:
        try:
            kept = os.dup(2)
        except OSError:  # no standard error, as under a service manager
            yield noise
            return
        sys.stderr.flush()
        os.dup2(file.fileno(), 2)
        try:
            yield noise
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            printed = file.read()
            noise.text = b"".join(_OWN_LINES.findall(printed))
            others = _OWN_LINES.sub(b"", printed)
            while others:
                others = others[os.write(2, others) :]


def _unnamed_file() -> BinaryIO:
    """Temporary file, in memory where the system supports it, since a disk may be full."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("noise"), "w+b")
    return cast(BinaryIO, tempfile.TemporaryFile())


# --- Detection of stuck pixels ---


def no_pixels() -> npt.NDArray[np.intp]:
    """Empty list of pixels."""
    return np.empty((0, 2), dtype=np.intp)


def stuck_pixels(samples: Array32, zero: float) -> npt.NDArray[np.intp]:
    """[row, column] of pixels at white whose eight neighbours are all below half of it, and of pixels at the digital
    number 0 whose neighbours all exceed 10 % of white; none if more than 1 % qualify, which is scene detail."""
    white, dead = np.float32(1 - 1e-6), np.float32(zero + 1e-6)
    bad = [_isolated(samples, samples >= white, lambda near: near.max(axis=0) < 0.5)]
    bad += [_isolated(samples, samples <= dead, lambda near: near.min(axis=0) > 0.1)]
    return np.concatenate(bad)


def _isolated(samples: Array32, chosen: Mask, differs: Any) -> npt.NDArray[np.intp]:
    rows, columns = samples.shape
    places = np.column_stack(np.divmod(np.flatnonzero(chosen), columns))
    if len(places) == 0 or len(places) > samples.size / 100:
        return no_pixels()
    row, column = places.T
    places = places[(row > 0) & (row < rows - 1) & (column > 0) & (column < columns - 1)]
    around = [(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c]
    near = np.stack([samples[places[:, 0] + r, places[:, 1] + c] for r, c in around])
    isolated: npt.NDArray[np.intp] = places[differs(near)]
    return isolated
