"""The class of all commands: its options in groups, and those that every command has; options of several commands."""

from typing import Any

import click

from station.common.errors import quiet_option

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


class StationCommand(click.Command):
    """A command with --quiet, whose help has its options in groups."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        quiet_option(self)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        headings = {name: heading for heading, names in GROUPS.items() for name in names}
        groups: dict[str, list[tuple[str, str]]] = {"Options": [], **{heading: [] for heading in GROUPS}}
        for one in self.get_params(ctx):
            if isinstance(one, click.Option) and (record := one.get_help_record(ctx)) is not None:
                groups[headings.get(max(one.opts, key=len), "Options")].append(record)
        for heading, records in groups.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)
