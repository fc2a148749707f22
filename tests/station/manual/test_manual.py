"""The manual: links lead somewhere, nothing in its reference is forgotten, it reads in terminal and browser."""

import inspect
import re
from dataclasses import fields
from pathlib import Path
from urllib.parse import urlsplit

import click
import cv2
import html5lib
import numpy as np
import pytest

from drivers.dng import OpticsMetadata
from procedures.numbers import NUMBERS, reference_text
from procedures.outcome import BadParameter
from procedures.pattern_psf.diagnostics import Diagnostics
from procedures.restoration.joint.result import RestorationDiagnostics as OfRestoration
from station.__main__ import main
from station.bench.device_models import BUILTIN, options_of
from station.common.models import fields_of
from station.manual.browser_pages import html_of, section_name, write_manual
from station.manual.command_reference import SHOWN, attributes, commands_text
from station.manual.pages import FORMULA, PICTURE, Page, find_page, for_terminal, plain_formulas, read_pages, search
from tests.printed import print_faults, screen_faults
from tests.program import run
from tests.station.cli.test_help import CONTEXTS

SLOW_FIXTURES = {"written"}

GALLERY = find_page(read_pages(), "gallery").text
PAGES = read_pages({"commands": commands_text(main, GALLERY), "numbers": reference_text()})
USED = {one.rpartition("picture:")[2].strip(")\n") for page in PAGES for one in PICTURE.findall(page.text)}
"""The pictures of all pages."""
LINK = re.compile(r"\]\((?!picture:)([^)\s]+)\)")


def text_of(name):
    return find_page(PAGES, name).text


def test_every_page_has_a_title_and_a_name_of_its_own():
    names = [page.name for page in PAGES]
    assert len(set(names)) == len(names)
    assert all(page.text.startswith("# ") and page.title for page in PAGES)
    assert {page.part for page in PAGES} == {"tutorial", "how-to", "reference", "explanation"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_to_a_page_and_a_section(page):
    folder = Path(inspect.getfile(Page)).parent / page.part
    for link in LINK.findall(page.text):
        place, _, section = link.partition("#")
        target = (folder / place).resolve()
        assert target.is_file(), link
        if section:
            headings = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            assert section in map(section_name, headings), link


def test_unknown_topics_name_the_nearest_and_links_their_command():
    with pytest.raises(BadParameter, match=r"no page 'senors'.*sensor.*search"):
        find_page(PAGES, "senors")
    assert for_terminal("See [Numbers](../reference/numbers.md#of-a-psf).") == "See Numbers (`station manual numbers`)."


def test_every_command_number_and_diagnostic_is_described():
    text = text_of("commands")
    for path, context in CONTEXTS.items():
        section = text.partition(f"## station {path}\n")[2].partition("\n## ")[0]
        assert section, path
        for param in context.command.params:
            if isinstance(param, click.Option) and not param.hidden:
                assert max(param.opts, key=len) in section, (path, param.name)
    # a paragraph that is indented would be a block of code
    assert not re.search(r"^    \S", text_of("commands"), re.MULTILINE)
    defined = set(re.findall(r"`(\w+)`", text_of("numbers")))
    assert {*NUMBERS, *(one.name for one in fields(OfRestoration))} <= defined
    assert {name for names, _ in attributes(Diagnostics) for name in names} == {f.name for f in fields(Diagnostics)}
    assert all(stated for _, stated in attributes(Diagnostics))


@pytest.mark.parametrize("driver", BUILTIN)
def test_station_toml_has_every_driver_with_its_options(driver):
    row = re.search(rf"^\| `{driver}` \|.*$", text_of("station-toml"), re.MULTILINE)
    assert row is not None
    options = [one.name for one in fields_of(options_of(driver))]
    assert options
    lens = [one.name for one in fields(OpticsMetadata)] if "lens data" in row[0] else []
    assert all(f"`{name}`" in row[0] or name in lens for name in options)


def test_the_command_lists_shows_and_searches_pages():
    run("manual", says="station manual numbers")
    page = run("manual", "exit-codes")
    assert "75" in page.output
    assert "\x1b" not in page.output  # plain where it is no terminal
    run("manual", "numbrs", code=2, says="numbers")
    hits = search(PAGES, ["MTF50", "edge"])
    texts = [f"{one.page.title} {one.heading} {one.text}".lower() for one, _ in hits]
    assert texts
    assert all("mtf50" in one and "edge" in one for one in texts)
    assert search(PAGES, ["vignetting"])[0][0].page.name == "vignetting"
    shown = run("manual", "search", "coverage")
    assert "station manual" in shown.output
    run("manual", "search", "zygote", code=2, says="no section of the manual")
    assert "picture:" in text_of("psf")
    assert "picture:" not in for_terminal(text_of("psf"))


FORMULAS = [one[2] or one[3] for page in PAGES for one in FORMULA.finditer(page.text) if not one[1]]


@pytest.mark.parametrize("formula", FORMULAS)
def test_a_formula_is_plain_in_a_terminal_and_mathml_in_a_browser(formula):
    assert not re.search(r"[\\{}$]", plain_formulas(f"${formula}$"))
    pytest.importorskip("latex2mathml", reason="latex2mathml is not installed (extra `manual`)")
    body = html5lib.parse(html_of(f"# T\n\n$${formula}$$\n"), namespaceHTMLElements=False)
    (math,) = (one for one in body.iter() if one.tag.endswith("}math"))
    assert "\\" not in "".join(math.itertext())


def test_dollars_in_code_are_no_formulas_and_pictures_lead_to_commands():
    text = "`$110=500 $22=25` and $\\frac{1}{2} \\sigma^2$"
    assert plain_formulas(text) == "`$110=500 $22=25` and 1/2 σ²"
    assert "<math" not in html_of("# T\n\n`$110=500 $22=25`\n")
    shown = SHOWN.findall(GALLERY)
    assert len(shown) == len(PICTURE.findall(GALLERY)) >= 30
    for _, words in shown:
        assert any(f"{words} ".startswith(f"station {path} ") for path in CONTEXTS), words
    sections = text_of("commands").split("\n## ")[1:]
    assert [one.splitlines()[0] for one in sections if "(picture:" not in one] == []
    assert any(one.startswith("station psf field\n") and "(picture:field-psfs.svg)" in one for one in sections)


@pytest.mark.parametrize("page", [one for one in PAGES if one.part == "how-to"], ids=lambda page: page.name)
def test_every_task_has_a_picture(page):
    assert PICTURE.search(page.text)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The manual for a browser, its pictures drawn in no time."""
    folder, svg = tmp_path_factory.mktemp("manual"), b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 3 2"/>'
    dot = cv2.imencode(".png", np.zeros((8, 8), np.uint8))[1].tobytes()
    write_manual(PAGES, folder, {name: svg if name.endswith("svg") else dot for name in USED})
    return folder


@pytest.mark.nightly
def test_pictures_of_the_pages_are_drawn_and_all_are_used(tmp_path):
    run("manual", "--html", tmp_path)
    assert {one.name for one in tmp_path.iterdir() if one.suffix in (".svg", ".png")} == USED


def test_search_in_the_browser_leads_to_sections(written, browser):
    browser.shown(1440, 900)
    browser.open(written / "index.html")
    found = browser.evaluate(
        "box.value = 'mtf50 edge'; box.dispatchEvent(new Event('input'));"
        " [...hits.querySelectorAll('a')].map(one => one.getAttribute('href'))"
    )
    assert found
    for href in found:
        page, _, section = href.partition("#")
        assert (written / page).is_file()
        assert not section or f'id="{section}"' in (written / page).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["psf", "chart", "commands", "which-procedure", "gallery"])
def test_pages_fit_on_screens_and_on_paper(written, browser, name, tmp_path):
    page = written / f"{name}.html"
    assert list(screen_faults(browser, page)) == []
    assert browser.evaluate("[...document.images].filter(one => !one.naturalWidth).map(one => one.src)") == []
    assert list(print_faults(browser, page, "A4", tmp_path)) == []


def test_pages_for_a_browser_need_nothing_from_outside(written):
    pages = sorted(written.glob("*.html"))
    assert len(pages) == len(PAGES) + 1
    for page in pages:
        root = html5lib.parse(page.read_text(encoding="utf-8"), namespaceHTMLElements=False)
        ids = {one.get("id") for one in root.iter() if one.get("id")}
        assert [one.get("src") for one in root.iter("script")] == ["search.js", None]
        for link in root.iter("a"):
            parts = urlsplit(link.get("href"))
            assert not parts.scheme
            assert (written / (parts.path or page.name)).is_file(), link.get("href")
            assert parts.path or parts.fragment in ids
        assert all((written / one.get("src")).is_file() for one in root.iter() if one.get("src"))


def test_markdown_cannot_bring_markup_of_its_own():
    assert "<script>" not in html_of("# T\n\n<script>alert(1)</script>\n")
