"""Annotations of a driver's options: allowed values, an example, and what an error says they must be."""

from collections.abc import Sequence
from typing import Annotated, Any

import msgspec

GRBL_STAGE, SHUTTER, STRIG_BOX = "GRBL stage", "shutter", "STRIG box"
ENABLED_STAGE = "stage with a motor enable input"
"""Kinds of device that another one is named as, see `drivers.making.DriverOptions.provides`."""


def option(
    example: str, words: str = "", *, above: float | None = None, least: float | None = None,
    most: float | None = None, pattern: str | None = None, **extra: Any,
) -> msgspec.Meta:  # fmt: skip
    """Annotation of a field.

    example : a value as written in station.toml
    words : what it must be, where type and bounds do not say it
    holds, unlike, kind : see `station.common.models`
    """
    limits = {"gt": above, "ge": least, "le": most, "pattern": pattern}
    given: Any = {name: limit for name, limit in limits.items() if limit is not None}
    return msgspec.Meta(extra={"example": example, "words": words, **extra}, **given)


def text(example: str, words: str = "text in quotes") -> msgspec.Meta:
    """Annotation of a text that is not empty."""
    return option(example, words, pattern=r"\S")


def positive(example: str) -> msgspec.Meta:
    """Annotation of a number above 0."""
    return option(example, above=0)


def device(kind: str, example: str = '"stage"') -> msgspec.Meta:
    """Annotation of the name of another device, of this kind."""
    return option(example, "the name of a device in quotes", pattern=r"\S", kind=kind)


def increasing(ends: Sequence[float]) -> bool:
    """Whether the first is below the last."""
    return ends[0] < ends[-1]


def interval(example: str) -> msgspec.Meta:
    """Annotation of the low and the high end of a range."""
    return option(example, "two numbers, the smaller one first", holds=increasing)


def distinct(values: Sequence[object]) -> bool:
    """Whether there is at least one, and none twice."""
    return bool(values) and len(set(values)) == len(values)


def has_port(address: str) -> bool:
    """Whether the number at the end of an address, if any, can be a port's."""
    number = address.rpartition(":")[2]
    return not number.isdigit() or int(number) < 2**16


def axes(*unlike: str) -> msgspec.Meta:
    """Annotation of a list of axes: each has a name and a combination of these keys of its own."""
    return msgspec.Meta(extra={"unlike": (("name",), unlike)})


Port = Annotated[str, text('"/dev/ttyUSB0"', "the name of a port in quotes")]
Baud = Annotated[int, option("115200", least=300, most=4_000_000)]
AxisName = Annotated[
    str, option('"z_mm"', "a name that ends in its unit, _mm or _deg", pattern=r"^[a-z][a-z0-9_]*_(mm|deg)\Z")
]
FolderName = Annotated[str, text('"incoming"', "the name of a folder in quotes")]
Interval = Annotated[tuple[float, float], interval("[-300.0, 0.0]")]
Seconds = Annotated[float, option("0.5", least=0)]
TimeLimit = Annotated[float, positive("60")]
Uncertainty = Annotated[float, positive("0.3")]
PollInterval = Annotated[float, option("0.2", above=0, most=5)]
Count = Annotated[int, option("0", least=0, most=2**16)]  # number of a thing counted from 0
