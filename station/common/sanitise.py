"""Escaping of external text (file names, EXIF, TOML) for terminals, file names and spreadsheets."""

import math
import re
import unicodedata
from pathlib import Path

LONGEST_STEM = 48
"""Characters of a photograph's name kept in its folder's name."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""First characters that a spreadsheet takes for a formula."""


def encodable(text: str) -> str:
    r"""Replace what is not Unicode (bytes of a file name) by `\udc80` and the like, so that it can be written."""
    return text.encode("utf-8", "backslashreplace").decode()


def printable(text: object) -> str:
    r"""One printable line: line ends and control characters become `\n`, `\x1b`; spaces of any width stay."""
    return "".join(
        letter
        if letter.isprintable() or unicodedata.category(letter) == "Zs"
        else letter.encode("unicode_escape").decode()
        for letter in encodable(str(text))
    )


def safe_stem(path: Path) -> str:
    """A folder name from a photograph's: ASCII letters, digits, dots, dashes; no leading dot, never empty."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", path.stem).lstrip(".")[:LONGEST_STEM] or "_"


def cell(text: str) -> str:
    """Text that a spreadsheet shows unchanged, on one line: formulas get a leading apostrophe."""
    shown = printable(text)
    return f"'{shown}" if shown.startswith(FORMULA) else shown


def stated(value: float, uncertainty: float) -> str:
    """A value with its standard uncertainty, rounded to two digits of it: 0.5782 ± 0.0014."""
    if not math.isfinite(value):
        return "—"
    if not math.isfinite(uncertainty) or uncertainty <= 0:
        return f"{value:.4g}".replace("-", "−")
    decimals = max(0, 1 - math.floor(math.log10(uncertainty)))
    if decimals > 12:  # a power of ten is shorter
        return f"{value:.4g} ± {uncertainty:.1e}".replace("-", "−")
    return f"{value:z.{decimals}f} ± {uncertainty:.{decimals}f}".replace("-", "−")


UNITS = {"_m_s2": "m/s²", "_rad_s": "rad/s", "_mm": "mm", "_deg": "°", "_um": "µm", "_nm": "nm", "_s": "s"}


def unit_of(name: str) -> tuple[str, str]:
    """Split a name and its unit: z_mm is z in mm."""
    for ending, unit in UNITS.items():
        if name.endswith(ending):
            return name.removesuffix(ending).replace("_", " "), unit
    return name.replace("_", " "), ""
