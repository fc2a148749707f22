"""A group of commands that imports each only when it is called: the help must not import numpy."""

import importlib
from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import Any

import click
from click.shell_completion import CompletionItem

from station.cli.terminal.command import StationCommand
from station.cli.terminal.examples import EXAMPLES
from station.cli.terminal.inherited import check_inherited
from station.common.errors import ContextFlag, reporting_errors

Table = Mapping[str, tuple[str, str, str]]
"""name -> (module under station.cli, function, help line)"""
PROCEDURES = "procedure_command"
"""The module whose attributes are the procedures' commands."""
ADDED = "station.procedures"
"""The entry-point group of other packages' procedures, each of which is a command."""


json_before = ContextFlag(
    "--json", help="Passed on to the command: write its result as JSON to stdout, and nothing else there.", hidden=True
)


class LazyGroup(StationCommand, click.Group):
    """A group that imports a command's module when the command is called, and explains its errors."""

    def __init__(self, *args: Any, table: Table, extensible: bool = False, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.table, self.extensible = table, extensible
        json_before(self)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order they are declared; the procedures of other packages last."""
        return [*self.table, *self._procedures()]

    def _procedures(self) -> list[str]:
        if not self.extensible:
            return []
        return [point.name for point in entry_points(group=ADDED) if point.name not in self.table]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.table:
            return _attribute(PROCEDURES, cmd_name) if cmd_name in self._procedures() else None
        module, function, _ = self.table[cmd_name]
        command = _attribute(module, function)
        path = cmd_name if self.extensible else f"{self.name} {cmd_name}"
        if path in EXAMPLES:
            command.epilog = f"Example: station {path} {EXAMPLES[path]}".rstrip()
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The named command. Raises UsageError where an option before it does not apply to it."""
        name, command, rest = super().resolve_command(ctx, args)
        if name and command and not isinstance(command, click.Group) and not ctx.resilient_parsing:
            check_inherited(ctx, name, command)
            rest = ["--json", *rest] if json_before.given(ctx) else rest
        return name, command, rest

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        super().format_options(ctx, formatter)
        self.format_commands(ctx, formatter)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(self._lines().items()))

    def _lines(self) -> dict[str, str]:
        """The help lines of all commands, without imports."""
        added = dict.fromkeys(self._procedures(), "A procedure of another package.")
        return {name: line for name, (_, _, line) in self.table.items()} | added

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        named = [CompletionItem(name, help=line) for name, line in self._lines().items() if name.startswith(incomplete)]
        return named + click.Command.shell_complete(self, ctx, incomplete)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; errors become a message and an exit code."""
        with reporting_errors():
            return super().invoke(ctx)


def _attribute(module: str, name: str) -> click.Command:
    command: click.Command = getattr(importlib.import_module(f"station.cli.{module}"), name)
    return command
