"""`station completion`: the script by which a shell completes commands, options and files."""

import click
from click.shell_completion import get_completion_class

from station.cli.terminal.command import command

VARIABLE = "_STATION_COMPLETE"


@command("completion", log_json=False)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Write the completion script of SHELL to stdout.

    \b
    For bash 4.4 or later, in ~/.bashrc:  eval "$(station completion bash)"
    For zsh, in ~/.zshrc:  eval "$(station completion zsh)"
    For fish:  station completion fish > ~/.config/fish/completions/station.fish
    """
    kind = get_completion_class(shell)
    assert kind is not None  # click has these three
    shown = kind(ctx.find_root().command, {}, "station", VARIABLE)
    click.echo(shown.source_template % shown.source_vars())
