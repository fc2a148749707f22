"""Output of a failed command: one sentence, one remedy, one exit code."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

import click

from station.common.log import log

FAILED_ITEMS = 1  # some photographs failed and are omitted from the result
SYSTEM = 2  # the system does not allow the operation
REFUSED = 5
INTERRUPTED = 130
SOFTWARE_FAULT = 70  # EX_SOFTWARE of sysexits.h, the family of the contract's 75 "try again later"
TRACEBACK = "STATION_TRACEBACK"
"""Environment variable that shows the traceback of an unexpected fault."""


@runtime_checkable
class ExplainedError(Protocol):
    """An error of procedures or drivers: what happened, the remedy, and the exit code."""

    reason: str
    remedy: str
    exit_code: int


@contextmanager
def reporting_errors() -> Iterator[None]:
    """Exceptions of a command as a sentence on stderr and an exit code, 130 for an interruption; an unexpected fault
    also names its traceback."""
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
    """Log the error and return its exit code."""
    if isinstance(error, ExplainedError):
        log("failed", error.reason, level="error", remedy=error.remedy, exit_code=error.exit_code)
        return error.exit_code
    if isinstance(error, OSError) and error.strerror:  # refused by the system, not a fault of the program
        reason = f"{error.filename or 'a file'}: {error.strerror}"
        remedy = "check the path, its permissions, and the room on the disk"
        log("failed", reason, level="error", remedy=remedy, exit_code=SYSTEM)
        return SYSTEM
    if isinstance(error, MemoryError):
        reason, remedy = "the computation needs more memory than there is", "give smaller files, or end other programs"
        log("failed", reason, level="error", remedy=remedy, exit_code=REFUSED)
        return REFUSED
    reason = f"the program failed unexpectedly: {type(error).__name__}: {error}"
    remedy = f"run it again with {TRACEBACK}=1 in the environment for a traceback, and report that"
    log("failed", reason, level="error", remedy=remedy, exit_code=SOFTWARE_FAULT)
    return SOFTWARE_FAULT
