"""Output of a failed command: one sentence, one remedy, one exit code."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import click

from station.common.sanitise import printable

if TYPE_CHECKING:
    from procedures.outcome import Cause

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
        raise click.exceptions.Exit(_report(error)) from error


def _report(error: Exception) -> int:
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


Fact = str | float | int | None


class ContextFlag:
    """A flag of commands that is kept in their context, for the code below them; that of a group is for all its
    commands."""

    def __init__(self, *names: str, help: str, is_eager: bool = False, hidden: bool = False) -> None:
        self._key = f"station{names[-1]}"
        self._option = click.option(
            *names, is_flag=True, expose_value=False, is_eager=is_eager, callback=self._keep, help=help, hidden=hidden
        )

    def __call__(self, command: Callable[..., Any]) -> Callable[..., Any]:
        """Add the flag to a command."""
        return self._option(command)

    def _keep(self, context: click.Context, option: click.Parameter, chosen: bool) -> None:
        context.meta[self._key] = chosen or self.given(context)

    def given(self, context: click.Context | None = None) -> bool:
        """Whether the running command has it."""
        context = context or click.get_current_context(silent=True)
        return context is not None and bool(context.meta.get(self._key))


log_json_option = ContextFlag("--log-json", is_eager=True, help="Write every progress and log line as a JSON object.")
quiet_option = ContextFlag("-q", "--quiet", help="Write only warnings and errors to stderr.")


def log(
    event: str, sentence: str, *, level: str = "info", remedy: str = "", other_causes: Sequence[Cause] = (),
    **facts: Fact,
) -> None:  # fmt: skip
    """Write one line to stderr: the sentence and its remedy, or the event with its facts.

    A quiet program omits level "info".

    event : a stable name, for programs
    level : "info", "warning" or "error"
    other_causes : alternative causes, each with its own remedy
    facts : values of the event; numbers that are not finite become null
    """
    if level == "info" and quiet_option.given():
        return
    if log_json_option.given():
        entry = {"ts": datetime.now(UTC).isoformat(timespec="milliseconds"), "level": level, "event": event}
        text: dict[str, Any] = {"message": sentence, **({"remedy": remedy} if remedy else {})}
        if other_causes:
            text["other_causes"] = [{"reason": cause.reason, "remedy": cause.remedy} for cause in other_causes]
        finite = {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in facts.items()}
        click.echo(json.dumps({**entry, **text, **finite}, allow_nan=False), err=True)
        return
    shown = printable(sentence)  # a file name in it may hold control characters
    click.echo(shown if level == "info" else f"{level}: {shown}", err=True)
    if remedy:
        click.echo(f"  what to do: {printable(remedy)}", err=True)
    if other_causes:
        click.echo("  other possible causes:", err=True)
    for cause in other_causes:
        click.echo(f"  - {printable(cause.reason)}; {printable(cause.remedy)}", err=True)
