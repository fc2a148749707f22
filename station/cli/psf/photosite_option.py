"""The option that takes the photosite out of the maps of a field, and what a record says of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from procedures.field.photosite import Photosite

NOBODY_KNOWS = "assumed"
"""The word for a fill factor that was not measured."""


def _photosite(context: click.Context, option: click.Parameter, words: str | None) -> Photosite | None:
    """The photosite of `assumed`, 0.9 or 0.9,0.02. Raises BadParameter where the numbers cannot be meant."""
    if words is None:
        return None
    from procedures.field.photosite import ASSUMED, Photosite

    if words == NOBODY_KNOWS:
        return ASSUMED
    try:
        fill, *rest = (float(word) for word in words.split(","))
        (uncertainty,) = rest or (0.0,)
    except ValueError:
        remedy = f"give {NOBODY_KNOWS}, a fill factor as 0.9, or one with its standard uncertainty as 0.9,0.02"
        raise click.BadParameter(f"{words!r} is no fill factor; {remedy}", context, option) from None
    return Photosite(fill, uncertainty)


photosite_option = click.option(
    "--without-photosite",
    "photosite",
    callback=_photosite,
    metavar="FILL[,ERROR]|assumed",
    help="Tell sagittal and meridional MTF also divided by that of square photosites of this fill factor.",
)


def told_photosite(photosite: Photosite | None) -> dict[str, float | str]:
    """What a record says of the photosite that was divided by."""
    if photosite is None:
        return {}
    return {
        "photosite_fill": photosite.fill,
        "photosite_fill_uncertainty": photosite.uncertainty,
        "photosite_fill_origin": NOBODY_KNOWS if photosite.assumed else "given",
    }
