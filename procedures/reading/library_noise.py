"""Capture of messages that C libraries print to standard error, for the reader instead of the terminal."""

from __future__ import annotations

import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import BinaryIO, cast

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
