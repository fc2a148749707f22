"""What a failed command says and returns: one sentence, one remedy, one exit code."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

import click

from station.common.log import log

FAILED_ITEMS = 1  # some photographs gave nothing, and the result goes without them
SYSTEM = 2  # what was asked for, the system does not allow
REFUSED = 5
INTERRUPTED = 130
SOFTWARE_FAULT = 70  # EX_SOFTWARE of sysexits.h, the family of the contract's 75 "try again later"
TRACEBACK = "STATION_TRACEBACK"
"""Environment variable: where it is set, an unexpected fault shows its traceback."""


@runtime_checkable
class Explained(Protocol):
    """An error of ours, from procedures or drivers: what happened, what to do, and the exit code."""

    reason: str
    remedy: str
    exit_code: int


@contextmanager
def explained() -> Iterator[None]:
    """Turn what a command raises into its sentence on stderr and its exit code.

    Our own errors bring theirs; an interruption is 130; a fault of the program itself is named, with the way to its
    traceback.
    """
    try:
        yield
    except (KeyboardInterrupt, click.Abort) as error:
        log("interrupted", "interrupted; no result was written", level="error")
        raise click.exceptions.Exit(INTERRUPTED) from error
    except (click.ClickException, click.exceptions.Exit, BrokenPipeError):
        raise
    except Exception as error:
        if os.environ.get(TRACEBACK):
            raise
        raise click.exceptions.Exit(_tell(error)) from error


def _tell(error: Exception) -> int:
    """Log the error and give its exit code."""
    if isinstance(error, Explained):
        log("failed", error.reason, level="error", remedy=error.remedy, exit_code=error.exit_code)
        return error.exit_code
    if isinstance(error, OSError) and error.strerror:  # the system's answer, not the program's fault
        reason = f"{error.filename or 'a file'}: {error.strerror}"
        remedy = "check the path, its permissions, and the room on the disk"
        log("failed", reason, level="error", remedy=remedy, exit_code=SYSTEM)
        return SYSTEM
    if isinstance(error, MemoryError):
        reason, remedy = "it takes more memory than there is", "give smaller files, or end other programs"
        log("failed", reason, level="error", remedy=remedy, exit_code=REFUSED)
        return REFUSED
    reason = f"the program failed on something it did not foresee: {type(error).__name__}: {error}"
    remedy = f"run it again with {TRACEBACK}=1 in the environment to see where, and report that"
    log("failed", reason, level="error", remedy=remedy, exit_code=SOFTWARE_FAULT)
    return SOFTWARE_FAULT
