"""Settings of a procedure as one validated model: command-line options, keys of a procedure file, entries of a record.

A model is a `Settings` whose fields have a type, a default and, by `setting`, a description and bounds, see
`station.common.models`.
"""

from pathlib import Path
from typing import Any, Self

import msgspec


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all settings models."""

    def check(self) -> None:
        """Raise ProcedureError if values are inconsistent, or a file that they name is unreadable."""

    def placed(self, folder: Path) -> Self:
        """The settings with relative file names resolved against a folder, where such files exist."""

        def in_folder(value: Any) -> Any:
            if isinstance(value, tuple):
                return tuple(map(in_folder, value))
            return folder / value if isinstance(value, Path) and (folder / value).exists() else value

        values = msgspec.structs.asdict(self)
        return msgspec.structs.replace(self, **{name: in_folder(value) for name, value in values.items()})


def setting(
    description: str, *, least: float | None = None, most: float | None = None, metavar: str = ""
) -> msgspec.Meta:
    """Annotation of a field: description, bounds, and metavar."""
    return msgspec.Meta(ge=least, le=most, description=description, extra={"metavar": metavar})


def named_files(settings: Settings) -> list[Path]:
    """The files named in a model."""
    values = msgspec.structs.asdict(settings).values()
    every = (one for value in values for one in (value if isinstance(value, tuple) else (value,)))
    return [one for one in every if isinstance(one, Path)]


def to_record(settings: Settings) -> dict[str, Any]:
    """Convert a model to JSON-compatible data, without None."""
    plain: dict[str, Any] = msgspec.to_builtins(settings, enc_hook=str)
    return {name: value for name, value in plain.items() if value is not None}
