"""How results are shown: a text of at most 12 lines, and a figure on the caller's axes or in a notebook."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sized
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINES, WIDTH = 12, 100  # most lines of a text, and most characters of a line


def summary(value: object, most: int = LINES) -> str:
    """At most 12 lines: the class, its numbers with their uncertainties, and what else it has."""
    lines = [line if len(line) <= WIDTH else f"{line[: WIDTH - 1]}…" for line in _lines(value)]
    return "\n".join(lines if len(lines) <= most else [*lines[: most - 1], f"  … and {len(lines) - most + 1} more"])


def _lines(value: object) -> Iterator[str]:
    if not is_dataclass(value):
        yield _short(value)
        return
    yield type(value).__name__
    numbers = getattr(value, "numbers", None) or getattr(getattr(value, "quality", None), "numbers", None)
    if isinstance(numbers, Mapping):
        for name, number in numbers.items():
            if hasattr(number, "uncertainty"):
                unit = "" if number.unit == "1" else f" {number.unit}"
                yield f"  {name} = {number.value:.5g} ± {number.uncertainty:.2g}{unit}"
    for field in fields(value):
        if field.name != "numbers" and getattr(value, field.name) is not None:
            yield f"  {field.name}: {_short(getattr(value, field.name))}"


def _short(value: Any) -> str:
    """One line for any value, without the contents of large ones."""
    if hasattr(value, "dtype") and hasattr(value, "shape"):
        return f"{value.dtype} {value.shape}"
    match value:
        case float():
            return f"{value:.6g}"
        case str() | int():
            return str(value)
        case tuple() if len(value) <= 3 and all(isinstance(one, int | float | str) for one in value):
            return ", ".join(map(_short, value))
        case Mapping():
            return ", ".join(map(str, value))
        case Sized():
            return f"{len(value)} entries"
    return type(value).__name__


def axes_of(ax: Axes | None) -> Axes:
    """The caller's axes, or those of a new figure. Raises ImportError if matplotlib is not installed."""
    if ax is not None:
        return ax
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError("a figure needs matplotlib, which is not installed: pip install matplotlib") from error
    return plt.subplots(layout="constrained")[1]


def html(value: Any) -> str | None:
    """The figure that `value.plot` draws, over its text, for a notebook; None without matplotlib."""
    import base64
    import io
    from html import escape

    try:
        from matplotlib.figure import Figure
    except ImportError:
        return None
    figure, picture = Figure(figsize=(4.8, 3.4), layout="constrained"), io.BytesIO()
    value.plot(figure.subplots())
    figure.savefig(picture, format="png", dpi=110)
    image = base64.b64encode(picture.getvalue()).decode()
    return f'<img src="data:image/png;base64,{image}"><pre>{escape(repr(value))}</pre>'
