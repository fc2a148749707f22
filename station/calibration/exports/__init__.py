"""Files for other programs, from results."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Export:
    """A file's content, and sentences on what it does not represent exactly."""

    data: bytes
    lost: tuple[str, ...] = ()
