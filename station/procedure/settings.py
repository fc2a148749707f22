"""Settings of a procedure as one validated model: command-line options, keys of a procedure file, entries of a record.

A model is a `Settings` whose fields have a type, a default and, by `setting`, a description and bounds. It is read from
a table of TOML by `read_settings`; the command line reads its options from `fields_of`.
"""

from __future__ import annotations

import difflib
import math
import re
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import msgspec

from procedures.outcome import BadParameter
from station.common.sanitise import printable


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


S = TypeVar("S", bound=Settings)
WORDS = {float: "a number", int: "a whole number", bool: "true or false", str: "text", Path: "a path"}


def setting(
    description: str, *, least: float | None = None, most: float | None = None, metavar: str = ""
) -> msgspec.Meta:
    """Annotation of a field: description, bounds, and metavar."""
    return msgspec.Meta(ge=least, le=most, description=description, extra={"metavar": metavar})


@dataclass(frozen=True)
class SettingField:
    """One field of a model.

    Attributes
    ----------
    kind : float, int, bool, str or Path
    choices : the only values, of a Literal; empty where others are possible
    word : a text that may stand in place of a number, as "auto"; "" where none may
    several : whether it is a list of such values
    required : whether it has no default
    """

    name: str
    kind: type
    default: Any
    description: str
    least: float | None
    most: float | None
    metavar: str
    choices: tuple[str, ...]
    word: str
    several: bool
    required: bool

    @property
    def option(self) -> str:
        """Its name on the command line."""
        return ("-" if len(self.name) == 1 else "--") + self.name.replace("_", "-")


def fields_of(model: type[Settings]) -> list[SettingField]:
    """The fields of a model in order of definition."""
    hints = typing.get_type_hints(model, include_extras=True)
    return [_field(one, hints[one.name]) for one in msgspec.structs.fields(model)]


def _field(one: msgspec.structs.FieldInfo, hint: Any) -> SettingField:
    kind, choices, several = _plain(hint)
    default = None if one.required else one.default if one.default is not msgspec.NODEFAULT else one.default_factory()
    known = _meta(hint) or msgspec.Meta()
    return SettingField(
        one.name, kind, default, known.description or "", known.ge, known.le, (known.extra or {}).get("metavar", ""),
        choices, _word(hint), several, one.required,
    )  # fmt: skip


def _word(hint: Any) -> str:
    """Description of a number that may also be "auto"."""
    parts = typing.get_args(hint) if typing.get_origin(hint) in (typing.Union, types.UnionType) else ()
    texts = [one for part in parts if typing.get_origin(part) is Literal for one in typing.get_args(part)]
    return str(texts[0]) if texts and typing.get_origin(parts[0]) is not Literal else ""


def _meta(hint: Any) -> msgspec.Meta | None:
    """The annotation of a field, also inside an optional field or a list."""
    inside = typing.get_args(hint) if typing.get_origin(hint) in (typing.Union, types.UnionType, tuple) else ()
    found = (extra for one in (hint, *inside) for extra in getattr(one, "__metadata__", ()))
    return next((extra for extra in found if isinstance(extra, msgspec.Meta)), None)


def _plain(hint: Any) -> tuple[type, tuple[str, ...], bool]:
    """The type behind Annotated, Optional, tuple and Literal; its choices; whether it is a list."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        return _plain(arguments[0])
    if origin in (typing.Union, types.UnionType):
        return _plain(next(one for one in arguments if one is not type(None)))
    if origin is tuple:
        kind, choices, _ = _plain(arguments[0])
        return kind, choices, True
    if origin is Literal:
        return type(arguments[0]), tuple(map(str, arguments)), False
    return hint, (), False


def read_settings(model: type[S], given: Mapping[str, Any], shown: Mapping[str, str] | None = None) -> S:
    """Create a model from options or keys of a TOML file; one value is accepted for a list.

    shown : names of keys in messages, where they differ

    Raises
    ------
    BadParameter
        If a key is not known (the nearest one is named), a value is not valid, or a required one is missing.
    """
    known, shown = {one.name: one for one in fields_of(model)}, shown or {}
    for key in given:
        if key not in known:
            near = difflib.get_close_matches(key, known, 1)
            remedy = f"write {near[0]}" if near else f"use one of {', '.join(known)}" if known else "leave it out"
            raise BadParameter(f"{printable(key)} is not known", remedy)
    values = {key: _listed(known[key], one) for key, one in given.items()}
    for key, value in values.items():
        parts = value if isinstance(value, list | tuple) else [value]
        if any(isinstance(one, float) and not math.isfinite(one) for one in parts):
            raise BadParameter(f"{shown.get(key, key)} must be finite; it is {value}", "correct it")
    try:
        return msgspec.convert(values, model, dec_hook=_path)
    except msgspec.ValidationError as error:
        raise _explained(str(error), known, given, shown) from error


def _listed(one: SettingField, value: Any) -> Any:
    return [value] if one.several and not isinstance(value, list | tuple) else value


def _path(kind: type, value: object) -> object:
    if kind is Path and isinstance(value, str | Path) and "\0" not in str(value):
        return Path(value)
    raise TypeError(f"{value!r} is not {WORDS.get(kind, kind.__name__)}")


def _explained(
    message: str, known: Mapping[str, SettingField], given: Mapping[str, Any], shown: Mapping[str, str]
) -> BadParameter:
    """Error message: key, required value, given value."""
    found = re.search(r"at `\$\.(\w+)", message)
    if found is None:
        missing = re.search(r"missing required field `(\w+)`", message)
        if missing is None:
            return BadParameter(f"the settings: {message}", "correct the procedure file")
        name = shown.get(missing[1], missing[1])
        return BadParameter(f"{name} is required", f"give it: {known[missing[1]].description}")
    one = known[found[1]]
    value = printable(given.get(one.name))
    return BadParameter(f"{shown.get(one.name, one.name)} must be {_required(one)}; it is {value!r}", "correct it")


def _required(one: SettingField) -> str:
    if one.choices:
        return f"one of {', '.join(one.choices)}"
    words = WORDS.get(one.kind, one.kind.__name__)
    bounds = [
        f"{word} {bound:g}" for word, bound in (("at least", one.least), ("at most", one.most)) if bound is not None
    ]
    or_word = f'or "{one.word}"' if one.word else ""
    parts = ("a list, each" if one.several else "", words, " and ".join(bounds), or_word)
    return " ".join(part for part in parts if part)


def named_files(settings: Settings) -> list[Path]:
    """The files named in a model."""
    values = msgspec.structs.asdict(settings).values()
    every = (one for value in values for one in (value if isinstance(value, tuple) else (value,)))
    return [one for one in every if isinstance(one, Path)]


def to_record(settings: Settings) -> dict[str, Any]:
    """Convert a model to JSON-compatible data, without None."""
    plain: dict[str, Any] = msgspec.to_builtins(settings, enc_hook=str)
    return {name: value for name, value in plain.items() if value is not None}
