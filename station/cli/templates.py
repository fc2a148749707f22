"""`station init` and `station completion`: template files, and the script by which a shell completes commands."""

from pathlib import Path

import click
from click.shell_completion import get_completion_class

from station.cli.terminal.command import PATH, command

EXAMPLES = {
    "station.toml": "station.bench",
    "procedure.toml": "station.batch",
    "specification.toml": "station.results",
    "certificate.toml": "station.reports",
}


@command("init", log_json=False)
@click.argument("folder", type=PATH, default=Path())
@click.option(
    "--key", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE",
    help="Write only a new private key for signatures (Ed25519, PEM) into FILE, and its public key beside it (.pub).",
)  # fmt: skip
def init(folder: Path, key: Path | None) -> None:
    """Write commented templates into FOLDER: station, procedure, specification and certificate.

    FOLDER is the current one by default. Existing files are not overwritten.
    """
    from importlib.resources import files

    from procedures.outcome import BadParameter
    from station.common.durable_files import write_whole

    if key is not None:
        _write_key(key)
        return
    existing = [name for name in EXAMPLES if (folder / name).exists()]
    if existing:
        raise BadParameter(f"{folder} has {', '.join(existing)} already", "name another folder, or move them away")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadParameter(f"{folder} cannot be made: {error.strerror}", "name another folder") from error
    for name, package in EXAMPLES.items():
        write_whole(folder / name, files(package).joinpath("example.toml").read_bytes())
        click.echo(folder / name)


def _write_key(path: Path) -> None:
    from procedures.outcome import BadParameter
    from station.common.signature import create_key

    try:
        create_key(path)
    except OSError as error:
        raise BadParameter(f"{path} cannot be written: {error.strerror}", "name a file that does not exist") from error
    click.echo(path)
    click.echo(path.with_suffix(".pub"))


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
    script = shown.source_template % shown.source_vars()
    click.echo(script.replace('split ","', 'split -m 1 ","'))  # fish: a description may have commas
