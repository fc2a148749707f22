"""The command line: parses and delegates, nothing else. Commands are loaded when they are called."""

from __future__ import annotations

import importlib

import click

# name -> (module under station.cli, function, help line): the help must not import numpy
COMMANDS = {
    "pattern": ("pattern", "pattern", "Write the printable noise chart."),
    "psf": ("psf", "psf", "Estimate a point spread function."),
    "demo": ("demo", "demo", "Calibrate a simulated camera, start to end."),
}


class LazyGroup(click.Group):
    """A group that imports a command's module when the command is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order they are declared."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command itself, imported now."""
        if cmd_name not in COMMANDS:
            return None
        module, function, _ = COMMANDS[cmd_name]
        command: click.Command = getattr(importlib.import_module(f"station.cli.{module}"), function)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Help lines from the table, without importing anything."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, _, line) in COMMANDS.items()])


@click.group(cls=LazyGroup)
@click.version_option(package_name="calibration-station")
def main() -> None:
    """Camera calibration station: subpixel point spread functions with error bars."""


if __name__ == "__main__":
    main(prog_name="station")
