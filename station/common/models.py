"""Tables as validated models: settings, options of drivers, files. One check of values, one form of messages.

A model is a dataclass or a `msgspec.Struct`. A field's `msgspec.Meta` gives description, bounds and pattern; its
`extra` gives `words` (the required value), `example`, `metavar`, `holds` (a further condition), `unlike` (keys that
differ between the rows of a list) and `kind` (of a named device, see `drivers.options`). A model may have `problem()`,
which gives reason and remedy if its values are inconsistent.
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn, Self, TypeVar

import msgspec

from procedures.outcome import BadInput, BadParameter
from procedures.reading.text import parse_toml, read_text
from station.common.sanitise import printable
from station.common.toml_lines import Path as KeyPath
from station.common.toml_lines import key_lines, line_of
from station.common.toml_text import toml_value

T = TypeVar("T")
WORDS = {float: "a number", int: "a whole number", bool: "true or false", str: "text", Path: "a path"}
EXAMPLES = {bool: "true"}
LONGEST, MOST_NAMED = 60, 12
"""Characters of a value, and number of known keys, that an error shows."""


@dataclass(frozen=True)
class ModelField:
    """One field of a model.

    Attributes
    ----------
    kind : float, int, bool, str or Path; the model of a table or of the tables of a list
    choices : the only values, of a Literal; empty where others are possible
    word : a text that may stand in place of a number, as "auto"; "" where none may
    several : whether it is a list of any number of such values
    required : whether it has no default
    """

    name: str
    hint: Any
    kind: Any
    default: Any
    meta: msgspec.Meta
    choices: tuple[str, ...]
    word: str
    several: bool
    required: bool

    @property
    def option(self) -> str:
        """Its name on the command line."""
        return ("-" if len(self.name) == 1 else "--") + self.name.replace("_", "-")

    @property
    def description(self) -> str:
        """Description for help, questions and the manual."""
        return self.meta.description or ""

    @property
    def least(self) -> float | None:
        """The smallest valid number."""
        return self.meta.ge

    @property
    def most(self) -> float | None:
        """The largest valid number."""
        return self.meta.le

    def extra(self, key: str, default: Any = "") -> Any:
        """An entry of its annotation."""
        return (self.meta.extra or {}).get(key, default)

    @property
    def words(self) -> str:
        """Valid values in words, to follow "must be"."""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        low, high, above = self.meta.ge, self.meta.le, self.meta.gt
        limits = {
            "from {low:g} to {high:g}": low is not None and high is not None,
            "above {above:g} up to {high:g}": above is not None and high is not None,
            "above {above:g}": above is not None,
            "at least {low:g}": low is not None,
            "at most {high:g}": high is not None,
        }
        bounds = next((words for words, fits in limits.items() if fits), "").format(low=low, high=high, above=above)
        parts = (
            "a list, each" if self.several else "",
            self.extra("words") or WORDS.get(self.kind, "of another type"),
            bounds,
            f'or "{self.word}"' if self.word else "",
        )
        return " ".join(part for part in parts if part)

    @property
    def example(self) -> str:
        """An example of its value as written in a file; "" where none is known."""
        if is_model(self.kind):
            inside = ", ".join(f"{one.name} = {one.example}" for one in fields_of(self.kind) if one.required)
            return f"[{{ {inside} }}]" if self.several else f"{{ {inside} }}"
        first = toml_value(typing.get_args(_bare(self.hint))[0]) if self.choices and not self.several else ""
        return self.extra("example") or first or EXAMPLES.get(self.kind, "")

    @property
    def remedy(self) -> str:
        """How to correct it."""
        return f"write {self.name} = {self.example}, for example" if self.example else "correct it"


def is_model(kind: Any) -> bool:
    """Whether a type is a model."""
    return dataclasses.is_dataclass(kind) or (isinstance(kind, type) and issubclass(kind, msgspec.Struct))


def fields_of(model: type) -> tuple[ModelField, ...]:
    """The fields of a model in order of definition."""
    hints = typing.get_type_hints(model, include_extras=True)
    return tuple(_field(name, hints[name], default, required) for name, default, required in _defaults(model))


def _defaults(model: type) -> Iterator[tuple[str, Any, bool]]:
    """Name, default value, and whether there is none."""
    for one in dataclasses.fields(model) if dataclasses.is_dataclass(model) else msgspec.structs.fields(model):
        given, make = one.default, one.default_factory
        if make not in (dataclasses.MISSING, msgspec.NODEFAULT):
            yield one.name, typing.cast(Callable[[], Any], make)(), False
        else:
            required = given in (dataclasses.MISSING, msgspec.NODEFAULT)
            yield one.name, None if required else given, required


def _field(name: str, hint: Any, default: Any, required: bool) -> ModelField:
    kind, choices, several = _plain(hint)
    return ModelField(name, hint, kind, default, _meta(hint) or msgspec.Meta(), choices, _word(hint), several, required)


UNIONS = (typing.Union, types.UnionType)


def _bare(hint: Any) -> Any:
    """A hint without its annotation and None."""
    if typing.get_origin(hint) is Annotated:
        return _bare(typing.get_args(hint)[0])
    if typing.get_origin(hint) in UNIONS:
        return _bare(next(one for one in typing.get_args(hint) if one is not type(None)))
    return hint


def _word(hint: Any) -> str:
    """The text of a number that may also be "auto"."""
    parts = typing.get_args(hint) if typing.get_origin(hint) in UNIONS else ()
    texts = [one for part in parts if typing.get_origin(part) is Literal for one in typing.get_args(part)]
    return str(texts[0]) if texts and typing.get_origin(parts[0]) is not Literal else ""


def _meta(hint: Any) -> msgspec.Meta | None:
    """The annotation of a field, also inside an optional field or a list."""
    inside = typing.get_args(hint) if typing.get_origin(hint) in (*UNIONS, tuple) else ()
    metadata = (extra for one in (hint, *inside) for extra in getattr(one, "__metadata__", ()))
    return next((extra for extra in metadata if isinstance(extra, msgspec.Meta)), None)


def _plain(hint: Any) -> tuple[Any, tuple[str, ...], bool]:
    """The type behind Annotated, Optional, tuple and Literal; its choices; whether it is a list of any length."""
    bare = _bare(hint)
    arguments = typing.get_args(bare)
    if typing.get_origin(bare) is tuple:
        kind, choices, _ = _plain(arguments[0])
        return kind, choices, arguments[-1] is Ellipsis
    if typing.get_origin(bare) is Literal:
        return type(arguments[0]), tuple(map(str, arguments)), False
    return bare, (), False


# --- reading ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TableSource:
    """Origin of a table, as named in messages.

    Attributes
    ----------
    file : name of the file; "" for options of a command
    lines : lines of its keys
    shown : names of keys in messages, where they differ
    error : class of the errors, made of reason and remedy
    """

    file: str = ""
    lines: Mapping[KeyPath, int] = field(default_factory=dict)
    shown: Mapping[str, str] = field(default_factory=dict)
    error: Callable[[str, str], Exception] = BadParameter

    @classmethod
    def parse(cls, text: str, file: str) -> tuple[dict[str, Any], Self]:
        """The content of a file and its origin. Raises BadParameter if it is not TOML."""
        try:
            content = parse_toml(text, file, "correct it")
        except BadInput as error:
            reason = f"{printable(file)} must be a TOML file: {printable(error.reason)}"
            raise BadParameter(reason, "correct it, or name another file") from error
        return content, cls(Path(file).name, key_lines(text))

    @classmethod
    def read(cls, path: Path) -> tuple[dict[str, Any], Self]:
        """The content of a file and its origin. Raises BadParameter if it cannot be read, or is not TOML."""
        try:
            text = read_text(path, "TOML file", "correct it")
        except BadInput as error:
            reason = f"{printable(path)} must be a TOML file: {printable(error.reason)}"
            raise BadParameter(reason, "correct it, or name another file") from error
        return cls.parse(text, str(path))

    def refuse(self, path: Sequence[str | int], reason: str, remedy: str = "correct it") -> NoReturn:
        """Raise the error about a key: `reason` follows its name."""
        line = line_of(self.lines, tuple(path))
        place = f"{printable(self.file)}, line {line}: " if line else ""
        raise self.error(f"{place}{self.name(path)} {reason}", remedy)

    def name(self, path: Sequence[str | int]) -> str:
        """A path in the file: devices.stage.axes[1].feed_per_min, rows counted from 1."""
        text = ""
        for part in path:
            text += f"[{part + 1}]" if isinstance(part, int) else f".{printable(part)}" if text else printable(part)
        return self.shown.get(text, text)

    def refuse_unknown(self, path: Sequence[str | int], known: Sequence[str]) -> NoReturn:
        """Raise the error about a key, the last part of a path, that is none of the known ones."""
        near = get_close_matches(str(path[-1]), known, 1)
        more = f" and {len(known) - MOST_NAMED} more" if len(known) > MOST_NAMED else ""
        others = f"use one of {', '.join(known[:MOST_NAMED])}{more}" if known else "leave it out"
        self.refuse(path, "is not known", f"write {near[0]}" if near else others)


def shown(value: Any) -> str:
    """A value as in a file, truncated if long."""
    try:
        text = printable(toml_value(value))
    except TypeError:
        text = printable(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


def read_model(model: type[T], given: Mapping[str, Any], source: TableSource, path: KeyPath = ()) -> T:
    """A model of the values of a table; one value is accepted for a list.

    Raises
    ------
    The source's error
        If a key is not known (the nearest one is named), a value is not valid, or a required one is missing.
    """
    known = fields_of(model)
    for key in given:
        if key not in [one.name for one in known]:
            source.refuse_unknown((*path, key), [one.name for one in known])
    values: dict[str, Any] = {}
    for one in known:
        if one.name in given:
            values[one.name] = read_value(one, given[one.name], source, (*path, one.name))
        elif one.required:
            remedy = one.remedy if one.example else f"give it: {one.description}"
            source.refuse((*path, one.name), "is missing", remedy)
    made = model(**values)
    if problem := getattr(made, "problem", lambda: None)():
        source.refuse(path, *problem)
    return made


def read_value(one: ModelField, value: Any, source: TableSource, path: KeyPath) -> Any:
    """The value of a field. Raises the source's error."""
    if is_model(one.kind):
        return _rows(one, value, source, path) if one.several else _table(one.kind, value, source, path)
    listed = [value] if one.several and not isinstance(value, list | tuple) else value
    parts = listed if isinstance(listed, list | tuple) else [listed]
    if any(isinstance(part, float) and not math.isfinite(part) for part in parts):
        source.refuse(path, f"must be finite; it is {shown(value)}", one.remedy)
    try:
        made = msgspec.convert(listed, one.hint, dec_hook=_path)
    except msgspec.ValidationError:
        valid = False
    else:
        valid = one.extra("holds", lambda value: True)(made)
    if not valid:
        source.refuse(path, f"must be {one.words}; it is {shown(value)}", one.remedy)
    return made


def _path(kind: type, value: object) -> object:
    if kind is Path and isinstance(value, str | Path) and "\0" not in str(value):
        return Path(value)
    raise TypeError(f"{value!r} is not {WORDS.get(kind, kind.__name__)}")


def _table(model: type[T], value: Any, source: TableSource, path: KeyPath) -> T:
    if not isinstance(value, Mapping):
        source.refuse(path, f"must be a table; it is {shown(value)}", f"begin one with [{source.name(path)}]")
    return read_model(model, value, source, path)


def _rows(one: ModelField, value: Any, source: TableSource, path: KeyPath) -> tuple[Any, ...]:
    good = isinstance(value, list) and all(isinstance(row, Mapping) for row in value)
    if not good or (one.required and not value):
        least = " with at least one row" if one.required else ""
        source.refuse(path, f"must be a list of tables{least}; it is {shown(value)}", one.remedy)
    rows = tuple(read_model(one.kind, row, source, (*path, n)) for n, row in enumerate(value))
    for keys in one.extra("unlike", ()):
        _require_unlike(rows, keys, source, path)
    return rows


def _require_unlike(rows: Sequence[Any], keys: Sequence[str], source: TableSource, path: KeyPath) -> None:
    marks: list[list[Any]] = []
    for n, row in enumerate(rows):
        mark = [getattr(row, key) for key in keys]
        if mark in marks:
            values = ", ".join(f"{key} = {shown(one)}" for key, one in zip(keys, mark, strict=True))
            source.refuse((*path, n, keys[0]), f"must differ; {values} is given twice", f"give each its own {keys[-1]}")
        marks.append(mark)
