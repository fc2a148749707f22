"""`station init`: commented files to begin with, of the bench, of a batch's procedure, of a lens's specification."""

from __future__ import annotations

from pathlib import Path

import click

EXAMPLES = {
    "station.toml": "station.bench",
    "procedure.toml": "station.batch",
    "specification.toml": "station.results",
}
"""The files that are written, and the packages whose `example.toml` they are."""


@click.command("init")
@click.argument("folder", type=click.Path(path_type=Path), default=Path())
def init(folder: Path) -> None:
    """Write commented files into FOLDER, the current one by default, of the bench, a batch and a specification.

    They are station.toml, procedure.toml and specification.toml. Nothing that is there already is touched.
    """
    from importlib.resources import files

    from procedures.outcome import BadParameter
    from station.common.atomic_files import write_whole

    there = [name for name in EXAMPLES if (folder / name).exists()]
    if there:
        raise BadParameter(f"{folder} has {' and '.join(there)} already", "name another folder, or move them away")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadParameter(f"{folder} cannot be made: {error.strerror}", "name another folder") from error
    for name, package in EXAMPLES.items():
        write_whole(folder / name, files(package).joinpath("example.toml").read_bytes())
        click.echo(folder / name)
