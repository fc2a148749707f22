"""One term for one concept: sources and manual keep to the vocabulary, and a class name has one meaning."""

import ast
import re
import tokenize
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from station.manual.pages import read_pages

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("station", "drivers", "procedures", "simulators")
VOCABULARY = "station/manual/reference/vocabulary.md"
SUFFIXES = {".py", ".pyi", ".md", ".html", ".toml"}
ALLOWED = {
    # keys of older records and journal events
    "doubt": {"station/calibration/restoration/inputs.py": 1},
    "told": {"station/sessions/state.py": 1},
    "untold": {"station/results/reader.py": 2},
    "tell": {
        # the position of a file
        "procedures/reading/arrays.py": 2,
        "procedures/reading/tiff_tags.py": 1,
        "procedures/reading/exposure.py": 2,
    },
    "left out": {},
}
"""Occurrences of refused words by file; fewer than 20 of each."""
OPENINGS = re.compile(r'"""(Of|What|As|The same|Whose|Nobody)\b')
"""Docstrings that do not name what they describe."""
PARTICIPLES = {"told", "felt", "said", "seen", "found"}
"""Participles that are no names of values."""
SHARED_CLASS_NAMES = {"_Fit", "_View"}
"""Private names of unrelated modules."""


@cache
def texts() -> dict[str, str]:
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*") if path.suffix in SUFFIXES]
    files = [*paths, ROOT / "README.md", ROOT / "pyproject.toml"]
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in sorted(files)}


def sources() -> dict[str, str]:
    return {name: text for name, text in texts().items() if name.endswith(".py")}


def refused_words() -> list[str]:
    page = next(one for one in read_pages() if one.name == "vocabulary")
    rows = re.findall(r"^\|(.*)\|$", page.text, re.MULTILINE)[2:]
    return [word.strip() for row in rows for word in row.split("|")[2].split(",") if word.strip()]


@pytest.mark.parametrize("word", refused_words())
def test_a_refused_word_occurs_only_where_it_is_a_contract(word):
    pattern = re.compile(rf"\b{word}\b".replace(" ", r"\s+"), re.IGNORECASE)
    counts = {name: len(pattern.findall(text)) for name, text in texts().items() if name != VOCABULARY}
    assert {name: count for name, count in counts.items() if count} == ALLOWED.get(word, {})


def test_exceptions_are_few_and_names_mean_one_thing():
    assert set(ALLOWED) <= set(refused_words())
    assert all(sum(files.values()) < 20 for files in ALLOWED.values())
    lines = ((name, line.strip()) for name, text in sources().items() for line in text.splitlines())
    assert [(name, line) for name, line in lines if OPENINGS.search(line)] == []
    names = []
    for name, text in sources().items():
        tokens = tokenize.generate_tokens(iter(text.splitlines(keepends=True)).__next__)
        names += [(name, one.start[0], one.string) for one in tokens if one.string in PARTICIPLES]
    assert names == []
    trees = (ast.parse(text) for text in sources().values())
    classes = Counter(node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    assert {name for name, count in classes.items() if count > 1} == SHARED_CLASS_NAMES
