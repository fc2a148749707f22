"""The manual's pages, and the page of a topic."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files

from markdown_it import MarkdownIt
from markupsafe import Markup
from mdit_py_plugins.dollarmath import dollarmath_plugin

from procedures.outcome import BadParameter

FORMULA = re.compile(r"(```.*?```|`[^`]*`)|\$\$(.+?)\$\$|(?<!\\)\$([^$\n]+)\$", re.DOTALL)
LETTERS = {
    "alpha": "α", "gamma": "γ", "sigma": "σ", "Phi": "Φ", "mu": "μ", "nu": "ν", "pi": "π", "lambda": "λ", "sum": "Σ",
    "int": "∫", "infty": "∞", "cdot": "·", "le": "≤", "ge": "≥", "approx": "≈", "ast": "*", "times": "×", "pm": "±",
    "in": "∈", "quad": "  ", "min": "min", "left": "", "right": "", ",": "", "!": "", "|": "‖",
}  # fmt: skip
"""Commands of LaTeX, and what a terminal shows."""
GROUPS = (
    (r"\\frac\{(\w)\}\{(\w)\}", r"\1/\2"),
    (r"\\frac\{([^{}]*)\}\{([^{}]*)\}", r"(\1)/(\2)"),
    (r"\\sqrt\{([^{}]*)\}", r"√(\1)"),
    (r"\\(?:mathrm|text)\{([^{}]*)\}", r"\1"),
    (r"\\hat\{([^{}]*)\}", "\\1\u0302"),
    (r"([_^])\{([^{}]*)\}", r"\1(\2)"),
)
"""Commands with arguments, the innermost first, and what a terminal shows."""
RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def plain_formulas(text: str) -> str:
    """A text with its formulas in plain letters."""
    return FORMULA.sub(lambda one: one[1] or _plain((one[2] or one[3]).strip()), text)


def _plain(formula: str) -> str:
    before = ""
    while before != formula:
        before = formula
        for pattern, replacement in GROUPS:
            formula = re.sub(pattern, replacement, formula)
    formula = re.sub(r"\\([A-Za-z]+|[,!|])", lambda one: LETTERS[one[1]], formula)
    formula = re.sub(r"\^(\d)", lambda one: one[1].translate(RAISED), formula)
    return " ".join(re.sub(r"[_^]\((\w)\)", r"_\1", formula).split())


def add_formulas(reader: MarkdownIt) -> None:
    """Let a reader of Markdown render formulas."""
    reader.use(dollarmath_plugin, allow_space=False, allow_digits=False, double_inline=True)
    for kind, display in (("math_inline", "inline"), ("math_inline_double", "block"), ("math_block", "block")):
        reader.add_render_rule(kind, lambda _, tokens, at, *rest, display=display: _math(tokens[at].content, display))


def _math(formula: str, display: str) -> Markup:
    """MathML, or plain letters where the extra `manual` is not installed."""
    try:
        from latex2mathml.converter import convert
    except ImportError:
        return Markup("<code>{}</code>").format(_plain(formula))
    return Markup(convert(formula.strip(), display=display))


PARTS = {"tutorial": "Tutorial", "how-to": "How to", "reference": "Reference", "explanation": "Explanation"}
WELCOME = """\
The tutorials go through a first calibration step by step. Each how-to page has one task. The reference lists every
command, number, file and option. The explanations define the numbers and their reliability."""
FIRST = (
    "which-procedure", "without-a-camera", "with-a-camera", "gallery",
    "chart", "focus", "two-photographs", "edge", "field", "batch", "sessions", "devices", "serve", "correct", "restore",
    "camera", "geometry", "vignetting", "tilt", "export", "sensor", "sensor-dumps", "rays", "library", "reproduce",
    "commands", "numbers", "files", "station-toml", "exit-codes", "environment", "vocabulary",
    "evidence", "evidence-cameras", "evidence-restoration", "evidence-robustness", "dependencies",
    "glossary",
    "psf", "sampling-and-gamma", "whole-psf", "uncertainty", "verdicts", "limits", "reproducibility",
)  # fmt: skip
"""Order of the pages; others follow by title."""
GENERATED = "<!-- drawn from the program -->"
PICTURE = re.compile(r"^!\[[^\]]*\]\(picture:[^)]*\)\n+", re.MULTILINE)
PAGE_LINK = re.compile(r"\[([^\]]*)\]\((?:\.\./)?(?:[\w-]+/)?([\w-]+)\.md(#[\w-]+)?\)")


@dataclass(frozen=True)
class Page:
    """One page: folder, name (the topic), and Markdown."""

    part: str
    name: str
    text: str

    @property
    def title(self) -> str:
        """Its first heading."""
        return self.text.partition("\n")[0].removeprefix("# ").strip()


def read_pages(generated: Mapping[str, str] | None = None) -> list[Page]:
    """All pages, part by part.

    generated : mapping of a page's name to Markdown, optional
        Replacement of `GENERATED` in that page.
    """
    sorted_pages = []
    for part in PARTS:
        pages = [
            Page(part, file.name.removesuffix(".md"), file.read_text(encoding="utf-8"))
            for file in files(__package__).joinpath(part).iterdir()
            if file.name.endswith(".md")
        ]
        sorted_pages += sorted(pages, key=_place)
    more = generated or {}
    return [replace(page, text=page.text.replace(GENERATED, more.get(page.name, ""))) for page in sorted_pages]


def _place(page: Page) -> tuple[int, str]:
    return (FIRST.index(page.name) if page.name in FIRST else len(FIRST), page.title)


def find_page(pages: Sequence[Page], topic: str) -> Page:
    """The page of a topic. Raises BadParameter, with the nearest topics, if there is none."""
    for page in pages:
        if page.name == topic.lower():
            return page
    names = [page.name for page in pages]
    near = difflib.get_close_matches(topic.lower(), names, n=3, cutoff=0.4)
    raise BadParameter(
        f"the manual has no page {topic!r}",
        f"read {', '.join(near or names)}, or search all pages: station manual search",
    )


def index_text(pages: Sequence[Page]) -> str:
    """The list of all pages, as Markdown."""
    lines = ["# The manual of the calibration station", "", WELCOME]
    for part, called in PARTS.items():
        lines += ["", f"## {called}", ""]
        lines += [f"- [{page.title}]({part}/{page.name}.md)" for page in pages if page.part == part]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class PageSection:
    """A section of a page: its heading, empty above the first one, and its text."""

    page: Page
    heading: str
    text: str


def sections_of(page: Page) -> list[PageSection]:
    """The sections of a page."""
    above, *rest = re.split(r"^#{2,3} (.*)\n", plain_formulas(page.text), flags=re.MULTILINE)
    parts = [("", above), *zip(rest[::2], rest[1::2], strict=True)]
    return [PageSection(page, heading, PICTURE.sub("", text)) for heading, text in parts]


def search(pages: Sequence[Page], words: Sequence[str]) -> list[tuple[PageSection, str]]:
    """Sections that have all words, with the first line that has one, those with a word in a heading first."""
    wanted = [word.lower() for word in words]
    hits = []
    for section in (one for page in pages for one in sections_of(page)):
        headings = f"{section.page.title} {section.heading}".lower()
        if all(word in f"{headings} {section.text.lower()}" for word in wanted):
            lines = [line for line in section.text.splitlines() if any(word in line.lower() for word in wanted)]
            hits.append((-sum(word in headings for word in wanted), section, (lines or [section.heading])[0]))
    return [(section, line) for _, section, line in sorted(hits, key=lambda hit: hit[0])]


def for_terminal(text: str) -> str:
    """The Markdown without pictures, formulas in plain letters, and links to pages as the command that shows them."""
    return PAGE_LINK.sub(r"\1 (`station manual \2`)", plain_formulas(PICTURE.sub("", text)))
