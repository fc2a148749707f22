"""The command lines that the manual and the README show are run as they stand."""

import re
import shlex
from functools import partial
from pathlib import Path

import pytest
from click.testing import CliRunner

from procedures.field import conclusion
from procedures.field.maps import derive
from station.__main__ import main

ROOT = Path(__file__).resolve().parents[3]
PAGES = [ROOT / "README.md", *sorted((ROOT / "station" / "manual").glob("*/*.md"))]
FENCE = re.compile(
    r"^```sh run(?P<mark> slow| nightly)?(?: exit (?P<code>\d+))?\n(?P<lines>.*?)^```", re.MULTILINE | re.DOTALL
)

WIDEST = 78
"""Characters of a line of an example that `station manual` does not break: a terminal's 80 less its margins."""


def examples():
    """Each block; one that several pages show is run once, with all their names."""
    names, marks = {}, {}
    for page in PAGES:
        for number, block in enumerate(FENCE.finditer(page.read_text(encoding="utf-8")), 1):
            stated = block["lines"], int(block["code"] or 0)
            names.setdefault(stated, []).append(f"{page.stem}-{number}")
            if block["mark"]:
                marks[stated] = [getattr(pytest.mark, block["mark"].strip())]
    for stated, pages in names.items():
        yield pytest.param(*stated, id=" ".join(pages), marks=marks.get(stated, []))


@pytest.mark.slow
@pytest.mark.parametrize(("lines", "code"), list(examples()))
def test_example_does_what_the_page_says(lines, code, tmp_path, monkeypatch, make_example_file):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(conclusion, "derive", partial(derive, columns=7))  # maps of a ninth of their places
    for line in lines.replace("\\\n", " ").splitlines():
        if line.startswith("#"):
            continue
        program, *words = shlex.split(line, comments=True)
        assert program == "station"
        for word in words:
            make_example_file(word)
        done = CliRunner().invoke(main, words, prog_name="station")
        assert done.exit_code == code, f"{line}\n{done.output}"


def test_what_is_typed_stands_whole_in_a_terminal_of_80_columns():
    wide = [
        f"{page.stem}: {line}"
        for page in PAGES[1:]
        for block in re.findall(r"^```.*?\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
        for line in block.splitlines()
        if len(line) > WIDEST
    ]
    assert not wide


def test_every_task_has_an_example_that_is_run():
    shown = {page.stem for page in PAGES if FENCE.search(page.read_text(encoding="utf-8"))}
    tasks = {page.stem for page in PAGES if page.parent.name == "how-to"}
    # the wall needs two photographs of one wall, which take longer to render than all other files together; the
    # library's lines are run by tests/procedures/test_library.py
    assert tasks - shown == {"two-photographs", "library"}
