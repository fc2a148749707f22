"""Commands: their options in groups, those of several commands, finite numbers, and rows in columns."""

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import click

from station.common.errors import ContextFlag, log_json_option, quiet_option
from station.common.sanitise import printable

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]
GROUPS: dict[str, tuple[str, ...]] = {
    "Input": (
        "--raw", "--plane", "--bits", "--seed", "--sensor", "--pixel-pitch-um", "--f-number", "--wavelength-nm",
        "--trust-typed", "--config", "--simulate", "--shaker", "--speed", "--sessions",
        "--originals", "--encoding", "--reference",
    ),
    "Blur": (
        "--blur", "--shape", "--samples-per-pixel", "--ratio", "--offset", "--max-w", "--defocus-shape",
        "--defocus-ratio", "--defocus-offset",
    ),
    "Unknown motion": (
        "--prototype-region", "--recorded-path", "--imu", "--poses", "--focal-px", "--max-inverse-depth",
        "--exposure-s", "--imu-within-s",
    ),
    "Depth in metres": ("--metres", "--focus-m", "--focal-length-mm"),
    "Estimation": (
        "--image-weight", "--depth-weight", "--scheme", "--depth-start", "--symmetric-axis", "--total-variation",
        "--depth-total-variation",
    ),
    "Numbers and limits": ("--unit", "--at", "--specification", "--strict"),
    "Results": (
        "--out", "--report", "--reports", "--certificate", "--certificate-details", "--overlay", "--parquet", "--force",
    ),
    "Output and help": ("--json", "--log-json", "--quiet", "--version", "--help"),
}  # fmt: skip
"""Headings of the help, with their options; all others are under `Options`."""

json_option = click.option(
    "--json", "as_json", is_flag=True, help="Write the result as JSON to stdout, and nothing else there."
)
strict_option = click.option("--strict", is_flag=True, help="Count what is doubtful or undecided as failed: exit 1.")
force_option = ContextFlag("--force", help="Overwrite files in --out that this program has not written.")


def options(*several: Decorator) -> Decorator:
    """A decorator that adds these options to a command, in their order."""

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        for one in reversed(several):
            function = one(function)
        return function

    return add


class StationCommand(click.Command):
    """A command with --quiet, whose help has its options in groups."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        quiet_option(self)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        headings = {name: heading for heading, names in GROUPS.items() for name in names}
        groups: dict[str, list[tuple[str, str]]] = {"Options": [], **{heading: [] for heading in GROUPS}}
        for param in self.get_params(ctx):
            if isinstance(param, click.Option) and (record := param.get_help_record(ctx)) is not None:
                groups[headings.get(max(param.opts, key=len), "Options")].append(record)
        for heading, records in groups.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)


def command(
    name: str, *, strict: bool = False, as_json: bool = False, log_json: bool = True
) -> Callable[[Callable[..., Any]], click.Command]:
    """Make a function a command, whose last options are --strict, --json and --log-json."""
    last = [option for option, wanted in ((strict_option, strict), (json_option, as_json), (log_json_option, log_json))
            if wanted]  # fmt: skip

    def make(function: Callable[..., Any]) -> click.Command:
        own = function.__dict__.pop("__click_params__", [])  # the last option first
        options(*last)(function)
        function.__dict__.setdefault("__click_params__", []).extend(own)
        return click.command(name, cls=StationCommand)(function)

    return make


class FiniteNumber(click.FloatRange):
    """A finite number, within optional bounds."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number

    def _describe_range(self) -> str:
        """The bounds in the help; without bounds click would write x<=None."""
        return "" if self.min is None and self.max is None else super()._describe_range()


def completed(names: Callable[[click.Context], Iterable[str]]) -> Any:
    """Completion of a parameter by the names of its values, which are found when a shell asks."""
    return lambda ctx, param, incomplete: [name for name in names(ctx) if name.startswith(incomplete)]


def plan_names(ctx: click.Context) -> Iterable[str]:
    """The names of the guided procedures."""
    from station.guide.catalogue import entries

    return entries()


UNITS = click.Choice(["cycles/pixel", "lp/mm", "lw/ph"], case_sensitive=False)
SEED = click.IntRange(0, 2**63 - 1)


class NamedPath(click.Path):
    """A path; an empty one, as of a shell variable that is not set, would be the current folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("a path must not be empty.", param, ctx)
        return super().convert(value, param, ctx)


PATH = NamedPath(path_type=Path)


def columns(rows: Sequence[Sequence[str]]) -> str:
    """The rows, the first being the heading, each column as wide as its widest word."""
    cells = [[printable(word) for word in row] for row in rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(cells[0]))]
    lines = ("  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip() for row in cells)
    return "\n".join(lines)
