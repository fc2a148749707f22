"""Tables as validated models: settings, options of drivers, files. One check of values, one form of messages.

A model is a dataclass or a `msgspec.Struct`. A field's `msgspec.Meta` gives description, bounds and pattern; its
`extra` gives `words` (the required value), `example`, `metavar`, `holds` (a further condition), `one_of` (a function
that lists the only valid texts, or the valid keys of a table of tables), `unlike` (keys that differ between the rows of
a list) and `kind` (of a named device, see `drivers.options`). A model may have `problem()`, which gives reason and
remedy if its values are inconsistent.
"""

import dataclasses
import math
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn, Self, TypeVar

import msgspec

from procedures.outcome import BadInput, BadParameter
from procedures.reading.text import parse_toml, read_text
from station.common.sanitise import printable
from station.common.toml_text import KeyPath, line_of, toml_value

T = TypeVar("T")
WORDS = {float: "a number", int: "a whole number", bool: "true or false", str: "text", Path: "a path"}
BOUNDS = (
    (("ge", "le"), "from {ge} to {le}"),
    (("gt", "le"), "above {gt} up to {le}"),
    (("gt",), "above {gt}"),
    (("ge",), "at least {ge}"),
    (("le",), "at most {le}"),
)
LONGEST, MOST_NAMED = 60, 12
"""Characters of a value, and number of valid names, that an error shows."""
UNIONS = (typing.Union, types.UnionType)


@dataclass(frozen=True)
class ModelField:
    """One field of a model.

    kind : float, int, bool, str or Path; the model of a table or of the tables of a list
    choices : the only values, of a Literal; empty where others are possible
    word : a text that may stand in place of a number, as "auto"; "" where none may
    several : whether it is a list of any number of such values
    keyed : whether it is a table of such tables
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
    keyed: bool
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
    def valid(self) -> Sequence[str]:
        """The only valid texts; empty where others are possible."""
        return self.choices or tuple(self.extra("one_of", tuple)())

    @property
    def words(self) -> str:
        """Valid values in words, to follow "must be"."""
        bounds = next((words for keys, words in BOUNDS if all(getattr(self.meta, key) is not None for key in keys)), "")
        parts = (
            "a list, each" if self.several else "",
            f"one of {listed(self.valid)}" if self.valid else self.extra("words") or WORDS.get(self.kind, "valid"),
            bounds.format(**{key: _digits(getattr(self.meta, key)) for key in ("gt", "ge", "le")}),
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
        return str(self.extra("example")) or first or ("true" if self.kind is bool else "")

    def remedy(self, given: object = None) -> str:
        """How to correct it: by the nearest valid text, an example, or all valid texts."""
        near = get_close_matches(given, self.valid, 1) if isinstance(given, str) else []
        if near:
            return f"write {self.name} = {toml_value(near[0])}"
        return f"write {self.name} = {self.example}, for example" if self.example else "correct it"


def one_of(names: Callable[[], Iterable[str]]) -> msgspec.Meta:
    """Annotation of a text that must be one of these, or of a table with such keys; in letters of any size."""
    return msgspec.Meta(extra={"one_of": names})


def _digits(bound: float | None) -> str:
    """A bound without a superfluous point or exponent."""
    return "" if bound is None else str(int(bound)) if float(bound).is_integer() else f"{bound:g}"


def listed(names: Sequence[str]) -> str:
    """The first of some names, and the number of the others."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return f"{', '.join(names[:MOST_NAMED])}{more}"


def is_model(kind: Any) -> bool:
    """Whether a type is a model."""
    return dataclasses.is_dataclass(kind) or (isinstance(kind, type) and issubclass(kind, msgspec.Struct))


def fields_of(model: type) -> tuple[ModelField, ...]:
    """The fields of a model in order of definition."""
    hints = typing.get_type_hints(model, include_extras=True)
    return tuple(_field(name, hints[name], default, required) for name, default, required in _defaults(model))


def _defaults(model: type) -> Iterator[tuple[str, Any, bool]]:
    for one in dataclasses.fields(model) if dataclasses.is_dataclass(model) else msgspec.structs.fields(model):
        given, make = one.default, one.default_factory
        if make not in (dataclasses.MISSING, msgspec.NODEFAULT):
            yield one.name, typing.cast(Callable[[], Any], make)(), False
        else:
            required = given in (dataclasses.MISSING, msgspec.NODEFAULT)
            yield one.name, None if required else given, required


def _field(name: str, hint: Any, default: Any, required: bool) -> ModelField:
    kind, choices, several = _plain(hint)
    keyed = typing.get_origin(_bare(hint)) is dict
    inside = typing.get_args(hint) if typing.get_origin(hint) in (*UNIONS, tuple) else ()
    metadata = (extra for one in (hint, *inside) for extra in getattr(one, "__metadata__", ()))
    meta = next((extra for extra in metadata if isinstance(extra, msgspec.Meta)), None) or msgspec.Meta()
    return ModelField(name, hint, kind, default, meta, choices, _word(hint), several, keyed, required)


def _bare(hint: Any) -> Any:
    if typing.get_origin(hint) is Annotated:
        return _bare(typing.get_args(hint)[0])
    if typing.get_origin(hint) in UNIONS:
        return _bare(next(arg for arg in typing.get_args(hint) if arg is not type(None)))
    return hint


def _word(hint: Any) -> str:
    parts = typing.get_args(hint) if typing.get_origin(hint) in UNIONS else ()
    texts = [arg for part in parts if typing.get_origin(part) is Literal for arg in typing.get_args(part)]
    return str(texts[0]) if texts and typing.get_origin(parts[0]) is not Literal else ""


def _plain(hint: Any) -> tuple[Any, tuple[str, ...], bool]:
    """The type behind Annotated, Optional, tuple, dict and Literal; its choices; whether it is a list of any length."""
    bare = _bare(hint)
    origin, arguments = typing.get_origin(bare), typing.get_args(bare)
    if origin is tuple:
        kind, choices, _ = _plain(arguments[0])
        return kind, choices, arguments[-1] is Ellipsis
    if origin is dict:
        return arguments[1], (), False
    if origin is Literal:
        return type(arguments[0]), tuple(map(str, arguments)), False
    return bare, (), False


@dataclass(frozen=True)
class TableSource:
    """Origin of a table, as named in messages.

    file : name of the file; "" for options of a command
    text : its content, for the lines of its keys
    places : paths of keys in the file, where they differ from those in the model
    error : class of the errors, made of reason and remedy
    """

    file: str = ""
    text: str = ""
    places: Mapping[str, KeyPath] = field(default_factory=dict)
    error: Callable[[str, str], Exception] = BadParameter

    @classmethod
    def parse(cls, text: str, file: str) -> tuple[dict[str, Any], Self]:
        """The content of a file and its origin. Raises BadParameter if it is not TOML."""
        try:
            return parse_toml(text, file, "correct it"), cls(Path(file).name, text)
        except BadInput as error:
            raise not_toml(file, error) from error

    @classmethod
    def read(cls, path: Path) -> tuple[dict[str, Any], Self]:
        """The content of a file and its origin. Raises BadParameter if it cannot be read, or is not TOML."""
        try:
            text = read_text(path, "TOML file", "correct it")
        except BadInput as error:
            raise not_toml(str(path), error) from error
        return cls.parse(text, str(path))

    def refuse(self, path: KeyPath, reason: str, remedy: str = "correct it") -> NoReturn:
        """Raise the error about a key: `reason` follows its name."""
        place = self.places.get(str(path[0]), path[:1]) + path[1:] if path else path
        line = line_of(self.text, place)
        raise self.error(f"{f'{printable(self.file)}, line {line}: ' if line else ''}{name_of(place)} {reason}", remedy)

    def refuse_unknown(self, path: KeyPath, known: Sequence[str]) -> NoReturn:
        """Raise the error about a key, the last part of a path, that is none of the known ones."""
        near = get_close_matches(str(path[-1]), known, 1)
        others = f"use one of {listed(known)}" if known else "leave it out"
        self.refuse(path, "is not known", f"write {near[0]}" if near else others)


def not_toml(file: str, error: BadInput) -> BadParameter:
    """The error about a file that is not TOML."""
    reason = f"{printable(file)} must be a TOML file: {printable(error.reason)}"
    return BadParameter(reason, "correct it, or name another file")


def name_of(path: KeyPath) -> str:
    """A path in a file: devices.stage.axes[1].feed_per_min, rows counted from 1."""
    parts = (f"[{part + 1}]" if isinstance(part, int) else f".{printable(part)}" for part in path)
    return "".join(parts).removeprefix(".")


def shown(value: Any) -> str:
    """A value as in a file, truncated if long."""
    try:
        text = printable(toml_value(value))
    except TypeError:
        text = printable(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


def read_model(model: type[T], given: Mapping[str, Any], source: TableSource, path: KeyPath = ()) -> T:
    """A model of a table's values; one value makes a list. Raises the source's error for a key not known (with the
    nearest), invalid or missing."""
    fields = {one.name: one for one in fields_of(model)}
    for key in given:
        if key not in fields:
            source.refuse_unknown((*path, key), sorted(fields))
    for one in fields.values():
        if one.required and one.name not in given:
            remedy = one.remedy() if one.example else f"give it: {one.description}"
            source.refuse((*path, one.name), "is missing", remedy)
    values = {key: read_value(fields[key], value, source, (*path, key)) for key, value in given.items()}
    made = model(**values)
    if problem := getattr(made, "problem", lambda: None)():
        source.refuse(path, *problem)
    return made


def read_value(one: ModelField, value: Any, source: TableSource, path: KeyPath) -> Any:
    """The value of a field. Raises the source's error."""
    if one.keyed:
        rows = require_table(value, source, path)
        if not is_model(one.kind):
            return dict(rows)
        for key in rows:
            if key not in one.valid:
                source.refuse_unknown((*path, key), one.valid)
        return {key: _table(one.kind, row, source, (*path, key)) for key, row in rows.items()}
    if is_model(one.kind):
        return _rows(one, value, source, path) if one.several else _table(one.kind, value, source, path)
    many = isinstance(value, list | tuple)
    parts = value if many else [value]
    if any(isinstance(part, float) and not math.isfinite(part) for part in parts):
        source.refuse(path, f"must be finite; it is {shown(value)}", one.remedy())
    if one.extra("one_of"):
        names = {name.lower(): str(name) for name in one.valid}
        parts = [names.get(part.lower()) if isinstance(part, str) else None for part in parts]
    try:
        made = msgspec.convert(parts if many or one.several else parts[0], one.hint, dec_hook=_path)
    except msgspec.ValidationError:
        valid = False
    else:
        valid = one.extra("holds", lambda value: True)(made)
    if not valid:
        source.refuse(path, f"must be {one.words}; it is {shown(value)}", one.remedy(value))
    return made


def _path(kind: type, value: object) -> object:
    if kind is Path and isinstance(value, str | Path) and "\0" not in str(value):
        return Path(value)
    raise TypeError(f"{value!r} is not {WORDS.get(kind, kind.__name__)}")


def require_table(value: Any, source: TableSource, path: KeyPath) -> Mapping[str, Any]:
    """The value if it is a table. Raises the source's error."""
    if not isinstance(value, Mapping):
        source.refuse(path, f"must be a table; it is {shown(value)}", f"begin one with [{name_of(path)}]")
    return value


def _table(model: type[T], value: Any, source: TableSource, path: KeyPath) -> T:
    return read_model(model, require_table(value, source, path), source, path)


def _rows(one: ModelField, value: Any, source: TableSource, path: KeyPath) -> tuple[Any, ...]:
    """A list of tables, at least one if it is required."""
    good = isinstance(value, list) and all(isinstance(row, Mapping) for row in value)
    if not good or (one.required and not value):
        least = " with at least one row" if one.required else ""
        source.refuse(path, f"must be a list of tables{least}; it is {shown(value)}", one.remedy())
    rows = tuple(read_model(one.kind, row, source, (*path, n)) for n, row in enumerate(value))
    for keys in one.extra("unlike", ()):
        marks = [[getattr(row, key) for key in keys] for row in rows]
        for n, mark in enumerate(marks):
            if mark in marks[:n]:
                values = ", ".join(f"{key} = {shown(one)}" for key, one in zip(keys, mark, strict=True))
                words = f"must differ; {values} is given twice"
                source.refuse((*path, n, keys[0]), words, f"give each its own {keys[-1]}")
    return rows
