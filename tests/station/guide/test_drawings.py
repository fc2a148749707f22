"""The drawings of every plan's steps fit the smallest terminal."""

import pytest

from procedures.drawings.steps import DRAWINGS
from procedures.plan import Look, Scan, Shoot, Tour
from station.guide.catalogue import PLANS


@pytest.mark.parametrize("text", DRAWINGS.values(), ids=DRAWINGS)
def test_a_drawing_is_ascii_and_fits_next_to_the_rail_of_80_by_24(text):
    lines = text.splitlines()
    assert text.isascii()
    assert len(lines) <= 11
    assert max(map(len, lines)) <= 52


@pytest.mark.parametrize("name", PLANS)
def test_every_step_that_photographs_shows_what_to_do(name):
    for step in PLANS[name].plan().steps:
        photographs = any(isinstance(request, Look | Scan | Shoot | Tour) for request in step.requests)
        assert step.drawing or not photographs, step.name
