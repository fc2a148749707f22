"""The option `--force`: overwrite files of other programs."""

from collections.abc import Callable
from typing import Any

import click

_FORCE = "station.force"


def force_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the option `--force`."""
    option = click.option(
        "--force",
        is_flag=True,
        expose_value=False,
        callback=lambda context, _, chosen: context.meta.__setitem__(_FORCE, chosen),
        help="Overwrite files in --out that this program has not written.",
    )
    return option(command)


def forced() -> bool:
    """Whether the running command has --force."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(_FORCE))
