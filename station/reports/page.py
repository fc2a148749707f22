"""Pages: lists of sections, drawn by one template into one HTML file that needs no network. A page shows everything
without scripts. The small scripts in it sort tables, and let one explore the numbers."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import jinja2
from markupsafe import Markup, escape

from procedures.outcome import Cause, Miss, Quantity, WithVerdict
from procedures.raw import Exposure
from station.common.sanitise import stated
from station.drawing import colours
from station.drawing.colours import PLANE_COLOURS
from station.drawing.plots import Figure
from station.results.comparison import measurement_words
from station.results.record_head import PartBeside
from station.results.units import Unit

Text = str
"""Text of a page, as a block a paragraph. It is escaped unless it is Markup; between backticks it is set as code."""


@dataclass(frozen=True)
class Note:
    """A paragraph in small print."""

    text: Text
    kind: ClassVar[str] = "note"


@dataclass(frozen=True)
class Heading:
    """A heading within a section."""

    text: Text
    kind: ClassVar[str] = "heading"


@dataclass(frozen=True)
class Items:
    """A list of texts; in small print if they are `small`."""

    texts: Sequence[Text]
    small: bool = False
    kind: ClassVar[str] = "items"


@dataclass(frozen=True)
class KeyNumbers:
    """The most important numbers, large: (value, label)."""

    values: Sequence[tuple[Text, Text]]
    kind: ClassVar[str] = "facts"


SORTABLE = "sortable"
"""Style of a table that a script sorts."""


@dataclass(frozen=True)
class Table:
    """A table.

    rows, head : cells
    columns : one letter per column: w word, n number, u unit, r long text; without a letter, number
    style : "" a table of data; "numbers" and "conditions", each row with a heading; "plain" the same in small print;
        `SORTABLE`, each row with a heading, sorted by a column on a click
    boxed : on its own ground, and scrolled where it is wider than the page
    """

    rows: Sequence[Sequence[Text]]
    head: Sequence[Text] = ()
    columns: str = "w"
    style: str = ""
    boxed: bool = True
    kind: ClassVar[str] = "table"

    def column(self, index: int) -> str:
        """The class of a column's cells."""
        letter = self.columns[index] if index < len(self.columns) else "n"
        return {"w": "word", "n": "", "u": "unit", "r": "word reason"}[letter]


@dataclass(frozen=True)
class Figures:
    """Figures side by side; `wide` ones have half of the page each, those of the `summary` stand with the verdict."""

    figures: Sequence[Figure]
    wide: bool = False
    summary: bool = False
    kind: ClassVar[str] = "figures"


SMALL_MM = 60
"""Narrower pictures have their caption beside them."""


@dataclass(frozen=True)
class PrintedPicture:
    """A PNG or JPEG image, `width_mm` wide in print, with its caption: below, or beside a small one."""

    data: bytes
    caption: str
    width_mm: float

    def __html__(self) -> Markup:
        """The image and its caption."""
        kind = "jpeg" if self.data.startswith(b"\xff\xd8") else "png"
        uri = f"data:image/{kind};base64,{base64.b64encode(self.data).decode()}"
        return html('<figure class="{}"><img src="{}" alt="" style="width: {}mm"><figcaption>{}</figcaption></figure>',
                    "beside" if self.width_mm < SMALL_MM else "", uri, self.width_mm, self.caption)  # fmt: skip


@dataclass(frozen=True)
class Scripted:
    """HTML that the script of this name completes and shows."""

    markup: Markup
    script: str

    def __html__(self) -> Markup:
        """The HTML."""
        return self.markup


Block = Scripted | Text | Markup | PrintedPicture | Note | Heading | Items | KeyNumbers | Table | Figures


@dataclass(frozen=True)
class Section:
    """A part of a page.

    heading : may be empty
    verdict : of a section that states one: it is drawn with the colour of the verdict
    kicker : line above the heading of such a section
    new_page : in print
    closing : of the last sections, which stay on one page, in print
    """

    heading: Text
    blocks: Sequence[Block]
    verdict: str = ""
    kicker: Text = ""
    new_page: bool = False
    closing: bool = False
    anchor: str = ""


def page(title: str, sections: Iterable[Section], *, explored: Markup | None = None) -> str:
    """The page of sections, with the scripts that they use; `explored` is the data of `explore.explorer`."""
    shown = list(sections)
    blocks = [block for one in shown for block in one.blocks]
    scripts = ["sort.js"] if any(isinstance(one, Table) and one.style == SORTABLE for one in blocks) else []
    scripts += ["explore.js"] if explored else []
    scripts += sorted({one.script for one in blocks if isinstance(one, Scripted)})
    return render("page.html", title=title, sections=shown, scripts=scripts, explored=explored or "")


def render(template: str, **context: Any) -> str:
    """A page from a template of this package; its values are escaped unless they are Markup."""
    return _environment().get_template(template).render(context)


@cache  # it compiles each template once
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("station.reports"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(stated=stated, percent=percent, signed=signed, sentence=sentence, text=marked)
    environment.globals.update(palette=colours, plane_name=plane_name, tag=tag, causes=causes)
    return environment


def marked(text: Text) -> Markup:
    """A text as HTML: escaped unless it is Markup, and code between backticks."""
    if isinstance(text, Markup):
        return text
    parts = str(escape(text)).split("`")
    if len(parts) % 2 == 0:
        return escape(text)
    return Markup("".join(f"<code>{part}</code>" if i % 2 else part for i, part in enumerate(parts)))


def html(template: str, *values: object) -> Markup:
    """HTML with each {} replaced by a value, escaped."""
    return Markup(template).format(*values)


def small(text: Text, more: Text) -> Markup:
    """A text with small print below it."""
    return html("{}<small>{}</small>", text, more) if more else escape(text)


def tag(verdict: str, words: str | None = None) -> Markup:
    """A verdict in its colour, as `words` or as of a measurement; nothing without a verdict."""
    shown = measurement_words(verdict) if words is None else words
    return html('<span class="tag {}">{}</span>', verdict.replace(" ", "-"), shown) if verdict else Markup()


def plane_name(name: str, *verdicts: Markup) -> Markup:
    """The name of a plane with its colour, and verdicts on it."""
    colour = PLANE_COLOURS.get(name)
    swatch = html('<span class="swatch" style="background: {}"></span>', colour) if colour else ""
    return Markup("&nbsp;").join([html("{}{}", swatch, name), *(verdict for verdict in verdicts if verdict)])


def quantity(number: Quantity) -> str:
    """A number with its uncertainty and its unit."""
    return f"{stated(number.value, number.uncertainty)} {unit_of(number)}".rstrip()


def unit_of(number: Quantity) -> str:
    """The unit of a number; nothing if it has none."""
    return {"1": "", "um": "µm"}.get(number.unit, number.unit)


def shown_unit(number: Quantity) -> Text:
    """The unit of a number. The script of a page changes that of a frequency."""
    unit = unit_of(number)
    return html("<span data-unit>{}</span>", unit) if unit in tuple(Unit) else unit


def value_of(number: Quantity) -> Text:
    """A number with its uncertainty. The script of a page converts that of a frequency."""
    words = stated(number.value, number.uncertainty)
    if number.unit not in tuple(Unit):
        return words
    return html('<span data-q="{:.7g} {:.7g}">{}</span>', number.value, number.uncertainty, words)


def percent(share: float) -> str:
    """A share in per cent: 2.14 %, 99.5 %."""
    decimals = 2 if abs(share) < 0.0995 else 1
    return f"{100 * share:z.{decimals}f} %".replace("-", "−")


def signed(value: float) -> str:
    """A difference with its sign: +0.4."""
    return f"{value:+z.1f}".replace("-", "−")


def sentence(words: str) -> str:
    """Words as a sentence: capitalised, with a full stop."""
    return f"{words[:1].upper()}{words[1:]}." if words else ""


def reason_words(judged: WithVerdict | Miss | Cause | PartBeside) -> str:
    """Reason and remedy as sentences; nothing without a reason."""
    return f"{sentence(judged.reason)} {sentence(judged.remedy)}".strip() if judged.reason else ""


def exposure_words(exposure: Exposure) -> str:
    """Settings recorded by the camera: f/2.8, 1/50 s, ISO 400, 50 mm."""
    seconds = exposure.exposure_s
    words = [
        f"f/{exposure.f_number:g}" if exposure.f_number else "",
        "" if not seconds else f"{seconds:g} s" if seconds >= 0.3 else f"1/{round(1 / seconds)} s",
        f"ISO {exposure.iso:g}" if exposure.iso else "",
        f"{exposure.focal_length_mm:g} mm" if exposure.focal_length_mm else "",
    ]
    return ", ".join(word for word in words if word)


def causes(judged: WithVerdict, before: Text = "") -> list[Block]:
    """The most likely cause of a verdict with its remedy, then other possible ones."""
    blocks: list[Block] = [html("<p>{}{}</p>", before, reason_words(judged))] if judged.reason else []
    if judged.other_causes:
        blocks += [
            Note("Other possible causes:"),
            Items([reason_words(cause) for cause in judged.other_causes], small=True),
        ]
    return blocks


def number_rows(numbers: Mapping[str, Quantity], *, methods: bool = False) -> Table:
    """Numbers by name in small print, with their methods."""
    rows = [
        [name.replace("_", " "), small(quantity(one), one.method if methods else "")] for name, one in numbers.items()
    ]
    return Table(rows, columns="wr", style="plain", boxed=False)


def image(data: bytes, alternative: str, *, enlarged: bool = False) -> Markup:
    """A PNG as an element of the page; an enlarged one shows its pixels as squares."""
    uri = "data:image/png;base64," + base64.b64encode(data).decode()
    return html('<img{} src="{}" alt="{}">', Markup(' class="enlarged"' if enlarged else ""), uri, alternative)


def exclusions(heading: str, missed: Sequence[Miss], what: str) -> list[Section]:
    """The inputs that were not used, with reasons; no section if there are none."""
    rows = [[one.source, reason_words(one)] for one in missed]
    return [Section(heading, [Table(rows, [what, "why, and what helps"], "wr")])] if rows else []
