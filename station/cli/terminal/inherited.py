"""Options that commands inherit from the groups above them: `--simulate devices` is `devices --simulate`.

A command declares with `inherited` each group option that applies to it. Its own value takes precedence over the
group's. A group option that does not apply to the command is a usage error.
"""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import click
from click.core import ParameterSource

EXPLICIT = (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)
WITHOUT_COMMAND = "leave the command out; the option is for the guide, which `station` opens by itself"
KEPT = "leave it out; a session keeps what it was begun with"
SIMULATED = "leave it out; this command simulates in any case"
KEPT_OPTIONS = ("--seed", "--shaker", "--speed", "--specification", "--unit", "--plan")
INSTEAD: Mapping[tuple[str, str], str] = {
    ("batch", "--unit"): 'write `unit = "..."` in the procedure file',
    ("batch", "--specification"): 'write `specification = "..."` in the procedure file',
    ("session resume", "--plain"): "leave it out; a session is resumed in plain lines in any case",
    ("demo", "--simulate"): SIMULATED,
    ("simulate", "--simulate"): SIMULATED,
    **{("session resume", name): KEPT for name in KEPT_OPTIONS},
}
"""Remedy by command and option, where it is more specific than to omit the option."""


class InheritedOption(click.Option):
    """An option that takes its value from a group's option `inherits` where the command itself is given none."""

    def __init__(self, *args: Any, inherits: str | None = None, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.inherits = inherits or self.opts[-1]

    def consume_value(self, ctx: click.Context, opts: Mapping[str, Any]) -> tuple[Any, ParameterSource]:
        """The value given to the command, else to the nearest group, else the default."""
        value, source = super().consume_value(ctx, opts)
        if source not in EXPLICIT:
            for option, given in _given(ctx.parent):
                if self.inherits in option.opts:
                    return given, ParameterSource.COMMANDLINE
        return value, source


inherited = partial(click.option, cls=InheritedOption)
"""`click.option` for an option that a command inherits."""


def check_inherited(group: click.Context, name: str, command: click.Command) -> None:
    """Raises UsageError where an option was given to a group that does not apply to its command `name`."""
    applying = {option.inherits for option in command.params if isinstance(option, InheritedOption)}
    for option, _ in _given(group):
        if applying.isdisjoint(option.opts):
            flag = option.opts[-1]
            reason = f"{flag} does not apply to `{group.command_path} {name}`"
            raise click.UsageError(f"{reason}: {_instead(group, name, command, flag)}", group.find_root())


def _given(context: click.Context | None) -> Iterator[tuple[click.Parameter, Any]]:
    """The options given to a group and its parents, nearest first, without eager ones (--quiet)."""
    while context is not None:
        for option in context.command.params:
            if option.expose_value and context.get_parameter_source(str(option.name)) in EXPLICIT:
                yield option, context.params[str(option.name)]
        context = context.parent


def _instead(group: click.Context, name: str, command: click.Command, flag: str) -> str:
    program = group.find_root().command_path
    words = f"{group.command_path} {name}".removeprefix(f"{program} ")
    if advice := INSTEAD.get((words, flag)):
        return advice
    for option in command.params:
        if flag in option.opts and isinstance(option, click.Option):
            return f"leave it out, or write it after the command, where it means: {option.help}"
    if flag in ("--plain", "--plan"):
        return WITHOUT_COMMAND
    return f"leave it out; `{program} --help` lists the commands to which it applies"
