"""Progress and log lines on stderr: sentences for people, or with `--log-json` one object each for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import click

from station.common.sanitise import printable

if TYPE_CHECKING:
    from procedures.outcome import Cause

Fact = str | float | int | None

_LOG_JSON = "station.log_json"
_QUIET = "station.quiet"


def log_json_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the option `--log-json` to a command."""
    option = click.option(
        "--log-json",
        is_flag=True,
        expose_value=False,
        is_eager=True,
        callback=lambda context, _, chosen: context.meta.__setitem__(_LOG_JSON, chosen),
        help="Write every progress and log line as a JSON object.",
    )
    return option(command)


def logs_json() -> bool:
    """Whether the running command writes its log lines as JSON objects."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(_LOG_JSON))


def quiet_option(program: Callable[..., Any]) -> Callable[..., Any]:
    """Add the option `--quiet` to a command; that of a group is for all its commands."""
    option = click.option(
        "-q",
        "--quiet",
        is_flag=True,
        expose_value=False,
        callback=lambda context, _, chosen: context.meta.__setitem__(_QUIET, chosen or is_quiet(context)),
        help="Write only warnings and errors to stderr.",
    )
    return option(program)


def is_quiet(context: click.Context | None = None) -> bool:
    """Whether the running command writes only warnings and errors."""
    context = context or click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(_QUIET))


def log(
    event: str,
    sentence: str,
    *,
    level: str = "info",
    remedy: str = "",
    other_causes: Sequence[Cause] = (),
    **facts: Fact,
) -> None:
    """Write one line to stderr: the sentence and its remedy, or the event with its facts.

    A quiet program omits level "info".

    event : a stable name, for programs
    level : "info", "warning" or "error"
    other_causes : alternative causes, each with its own remedy
    facts : values of the event; numbers that are not finite become null
    """
    if level == "info" and is_quiet():
        return
    if logs_json():
        entry = {"ts": datetime.now(UTC).isoformat(timespec="milliseconds"), "level": level, "event": event}
        text: dict[str, Any] = {"message": sentence, **({"remedy": remedy} if remedy else {})}
        if other_causes:
            text["other_causes"] = [{"reason": cause.reason, "remedy": cause.remedy} for cause in other_causes]
        click.echo(json.dumps({**entry, **text, **_finite(facts)}, allow_nan=False), err=True)
        return
    shown = printable(sentence)  # a file name in it may hold control characters
    click.echo(shown if level == "info" else f"{level}: {shown}", err=True)
    if remedy:
        click.echo(f"  what to do: {printable(remedy)}", err=True)
    if other_causes:
        click.echo("  other possible causes:", err=True)
    for cause in other_causes:
        click.echo(f"  - {printable(cause.reason)}; {printable(cause.remedy)}", err=True)


def _finite(facts: dict[str, Fact]) -> dict[str, Fact]:
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in facts.items()}
