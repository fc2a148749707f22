"""Formulas in LaTeX between dollars: MathML for browsers, plain letters for terminals and for the search."""

from __future__ import annotations

import re

from markdown_it import MarkdownIt
from markupsafe import Markup
from mdit_py_plugins.dollarmath import dollarmath_plugin

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
    try:
        from latex2mathml.converter import convert
    except ImportError:
        return Markup("<code>{}</code>").format(_plain(formula))
    return Markup(convert(formula.strip(), display=display))
