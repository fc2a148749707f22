"""Paper formats by name, and the formats of a locale."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from procedures.outcome import BadParameter


@dataclass(frozen=True)
class Paper:
    """A sheet of paper, in mm; upright as listed in `PAPERS`."""

    name: str
    width_mm: float
    height_mm: float

    @property
    def key(self) -> str:
        """Key in `PAPERS`."""
        return self.name.lower()

    def turned(self) -> Paper:
        """Sheet rotated by 90 degrees."""
        return Paper(self.name, self.height_mm, self.width_mm)


ISO_PAPERS = (
    Paper("A4", 210, 297), Paper("A3", 297, 420), Paper("A2", 420, 594), Paper("A1", 594, 841), Paper("A0", 841, 1189),
)  # fmt: skip
"""ISO 216, smallest first."""
US_PAPERS = (
    Paper("Letter", 215.9, 279.4), Paper("Legal", 215.9, 355.6), Paper("Tabloid", 279.4, 431.8),
)  # fmt: skip
"""US formats, smallest first; larger charts are printed on A sheets."""
PAPERS = {paper.key: paper for paper in ISO_PAPERS + US_PAPERS}
LETTER_TERRITORIES = frozenset(["BZ", "CA", "CL", "CO", "CR", "GT", "MX", "NI", "PA", "PH", "PR", "SV", "US", "VE"])
"""Territories where Letter is common: Unicode CLDR, supplemental data, measurementData/paperSize."""


def papers_of_locale(environ: Mapping[str, str]) -> tuple[Paper, ...]:
    """Formats for the environment's locale, the most common first.

    POSIX: LC_ALL overrides LC_PAPER, which overrides LANG; an empty variable counts as not set.
    """
    locale = next((value for name in ("LC_ALL", "LC_PAPER", "LANG") if (value := environ.get(name))), "")
    territory = locale.partition(".")[0].partition("@")[0].partition("_")[2]
    return US_PAPERS + ISO_PAPERS if territory.upper() in LETTER_TERRITORIES else ISO_PAPERS


def paper_named(name: str) -> Paper:
    """Paper of that name, in any case. Raises BadParameter if no paper has that name."""
    paper = PAPERS.get(name.lower())
    if paper is None:
        raise BadParameter(f"the paper must be one of {', '.join(PAPERS)}; got {name!r}", "give one of these")
    return paper
