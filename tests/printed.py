"""What is wrong with a printed page: text outside the paper or its box, and a last page that is nearly empty."""

import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np

from tests.browser import Browser

PAPERS = {"A4": (210.0, 297.0), "Letter": (215.9, 279.4)}
"""Width and height in mm."""
MARGIN_MM = 10.5
"""Least distance of text from the rim of the paper; the style sheets ask for 11 mm, and for 14 mm on certificates."""
FOOT_MM = 14.0
"""Height of the strip at the foot that has the number of the page."""
LEAST_FILL = 0.12
"""Share of the last page's height that is drawn on, at least."""
MM_PER_POINT = 25.4 / 72
CSS_PIXELS_PER_MM = 96 / 25.4
OUTSIDE = """
(() => {
  const boxes = "td, th, figure, figcaption, dd, dt, li, p, h1, h2, h3, pre, svg, .card, .verdict, main", found = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const text = walk.currentNode, box = text.parentElement.closest(boxes);
    if (!text.data.trim() || !box || text.parentElement.closest("style, script, title")) continue;
    const range = document.createRange();
    range.selectNodeContents(text);
    for (const one of range.getClientRects()) {
      for (const around of [box, document.querySelector("main")]) {
        const outer = around.getBoundingClientRect();
        if (one.width && (one.left < outer.left - 1 || one.right > outer.right + 1 ||
            around === box && (one.top < outer.top - 3 || one.bottom > outer.bottom + 3)))
          found.push(`${text.data.trim().slice(0, 40)} outside ${around.tagName.toLowerCase()}`);
      }
    }
  }
  return [...new Set(found)];
})()
"""
"""Texts that are drawn outside the box that they are in, or outside the page's."""


@dataclass(frozen=True)
class Word:
    """A word of a PDF: page, text, and its box in mm from the upper left corner of the paper."""

    page: int
    text: str
    left: float
    top: float
    right: float
    bottom: float


def print_faults(browser: Browser, page: Path, paper: str, folder: Path) -> Iterator[str]:
    """The faults of a page as it is laid out for a paper, and as it is printed on it."""
    width, height = PAPERS[paper]
    browser.shown(round((width - 22) * CSS_PIXELS_PER_MM), 1000, "print")
    browser.open(page)
    yield from (f"{page.name}, {paper}: {one}" for one in browser.evaluate(OUTSIDE))
    printed = folder / f"{page.stem}-{paper}.pdf"
    printed.write_bytes(browser.pdf(width / 25.4, height / 25.4))
    words = list(words_of(printed))
    for one in words:
        outside = one.left < MARGIN_MM or one.right > width - MARGIN_MM or one.top < MARGIN_MM or one.bottom > height
        if outside:
            yield f"{page.name}, {paper}, page {one.page}: {one.text!r} is in the margin"
    if _filled(printed, words[-1].page, FOOT_MM / height) < LEAST_FILL:
        yield f"{page.name}, {paper}: its last page, {words[-1].page}, is nearly empty"


def screen_faults(browser: Browser, page: Path) -> Iterator[str]:
    """Widths of windows, of a telephone and of a desk, in which a page must be moved sideways."""
    for width in (390, 1440):
        browser.shown(width, 900)
        browser.open(page)
        if (shown := browser.evaluate("document.documentElement.scrollWidth")) > width:
            yield f"{page.name} is {shown} pixels wide in a window of {width}"


def _filled(pdf: Path, page: int, foot: float) -> float:
    """Share of a page's height from its first to its last row with ink, its foot left away."""
    only = ["-f", str(page), "-l", str(page)]
    data = subprocess.run(["pdftoppm", "-r", "20", "-gray", *only, str(pdf)], capture_output=True, check=True).stdout
    drawn = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    rows = np.flatnonzero(drawn.min(axis=1)[: round((1 - foot) * len(drawn))] < 250)
    return float(np.ptp(rows)) / len(drawn) if len(rows) else 0.0


def words_of(pdf: Path) -> Iterator[Word]:
    """The words of a PDF, page by page."""
    found = subprocess.run(["pdftotext", "-bbox", str(pdf), "-"], capture_output=True, check=True)
    pages = ElementTree.fromstring(found.stdout).iter("{http://www.w3.org/1999/xhtml}page")
    for number, page in enumerate(pages, 1):
        for one in page:
            box = (MM_PER_POINT * float(one.attrib[side]) for side in ("xMin", "yMin", "xMax", "yMax"))
            left, top, right, bottom = box
            yield Word(number, one.text or "", left, top, right, bottom)
