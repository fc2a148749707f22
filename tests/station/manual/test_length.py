"""Documents stay short: table cells, README and changelog."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PAGES = [ROOT / "README.md", *sorted((ROOT / "station" / "manual").glob("*/*.md"))]
MOST_WORDS = 25
"""Words of a table cell that a reader takes in at a glance."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_table_cells_are_short(page):
    rows = re.findall(r"^\|(.*)\|$", page.read_text(encoding="utf-8"), re.MULTILINE)
    cells = (cell for row in rows for cell in re.split(r"(?<!\\)\|", row))
    assert [cell for cell in cells if len(cell.split()) > MOST_WORDS] == []


@pytest.mark.parametrize(("name", "most"), [("CHANGELOG.md", 60), ("README.md", 119)])
def test_readme_and_changelog_are_short(name, most):
    assert len((ROOT / name).read_text(encoding="utf-8").splitlines()) <= most


def test_a_sentence_of_the_readme_is_at_most_three_lines():
    text = re.sub(r"```.*?```", "", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    prose = [block for block in text.split("\n\n") if not block.lstrip().startswith(("|", "#", "![", "-"))]
    assert all(sentence.count("\n") <= 3 for block in prose for sentence in re.split(r"[.:;] |[.:;]\n", block))
