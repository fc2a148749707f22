"""Results as a short text, as a figure on the caller's axes, and as both in a notebook."""

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter

from procedures.display import LINES, WIDTH, summary
from procedures.outcome import BadInput, BadParameter, Outcome, Refused, Verdict
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import estimate_psf
from procedures.quality import assess
from procedures.raw import Plane, as_plane
from procedures.restoration.joint.estimate import restore
from procedures.restoration.joint.kernel_sizes import stacks_of
from procedures.restoration.masks.blur_models import pillbox
from procedures.slanted_edge.estimate import estimate_edges
from tests.psfs import gaussian

from .correction.small_lens import SmallLens


@pytest.fixture
def psf():
    return gaussian(0.5, k=13)


@pytest.fixture(scope="module")
def field():
    return SmallLens((60, 80)).field("Y").field


@pytest.fixture(scope="module")
def edge():
    """A slanted edge as an array, blurred by a known Gaussian."""
    y, x = np.mgrid[:160, :160] - 80
    u = gaussian_filter(np.where(x > 0.12 * y, 0.8, 0.2), 0.8)
    return u + 0.003 * np.random.default_rng(0).standard_normal(u.shape)


@pytest.fixture(scope="module")
def outcome(edge):
    return estimate_edges(edge)[0]


@pytest.fixture
def axes():
    return Figure().subplots()


def test_no_text_has_more_than_twelve_lines(psf, field, outcome):
    doubtful = Outcome(outcome.value, Verdict.DOUBTFUL, "reason " * 40, "remedy")
    refused = Outcome(None, Verdict.REFUSED, "no chart was found", "show the whole chart")
    everything = [psf, assess(psf, n=99), field, field.nodes[0], Outcome(field), outcome, doubtful, refused]
    for one in everything:
        assert len(repr(one).splitlines()) <= LINES
    assert all(len(line) <= WIDTH for line in summary(field).splitlines())
    assert repr(refused) == "Outcome: refused\nno chart was found; show the whole chart"


def test_a_text_has_the_numbers_with_their_uncertainties(outcome):
    number = outcome.value.numbers["mtf50"]
    assert f"mtf50 = {number.value:.5g} ± {number.uncertainty:.2g} cycles/pixel" in repr(outcome)
    assert "… and " in repr(outcome)


def test_values_of_any_kind_have_a_text():
    assert repr(Outcome(0.25)) == "Outcome: pass\n0.25"
    assert "samples: float32 (4, 5)" in repr(Plane.from_array(np.zeros((4, 5))))


def test_a_psf_is_drawn_to_scale_on_the_caller_s_axes(psf, axes):
    assert psf.plot(axes) is axes
    # 13 samples, four to a pixel, about the centre
    assert axes.images[0].get_extent() == [-13 / 8, 13 / 8, 13 / 8, -13 / 8]
    np.testing.assert_array_equal(axes.images[0].get_array(), psf.h)


def test_an_mtf_is_drawn_with_its_uncertainty(psf, outcome, axes):
    assert outcome.plot(axes) is axes
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), outcome.value.mtf)
    assert len(axes.collections) == 1
    assert len(assess(psf, n=99).plot(axes).lines) == 4


def test_a_field_is_drawn_over_its_frame(field, axes):
    field.plot(axes)
    rows, columns = field.shape
    assert axes.images[0].get_extent() == [-0.5, columns - 0.5, rows - 0.5, -0.5]
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), field.positions)


def test_a_notebook_shows_figure_and_text(psf, field, outcome):
    for one in (psf, field, outcome, outcome.value, Outcome(field)):
        page = one._repr_html_()
        assert page.startswith('<img src="data:image/png;base64,')
        assert f"<pre>{type(one).__name__}" in page
    assert Outcome(1.0)._repr_html_() is None


def test_what_has_no_figure_says_so_and_how_to_get_one():
    with pytest.raises(TypeError, match="no figure of a float"):
        Outcome(1.0).plot()
    with pytest.raises(Refused, match="dark; expose longer"):
        Outcome(None, Verdict.REFUSED, "dark", "expose longer").plot()
    code = """
import sys
sys.modules["matplotlib"] = sys.modules["matplotlib.pyplot"] = sys.modules["matplotlib.figure"] = None
import numpy as np
from procedures import Psf
psf = Psf(np.full((3, 3), 1 / 9), 3, np.eye(9))
assert psf._repr_html_() is None
psf.plot()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "matplotlib, which is not installed: pip install matplotlib" in done.stderr


def test_arrays_are_planes_and_wrong_types_and_places_are_named(edge, outcome, psf, field):
    whole = np.round(edge * 65535).astype(np.uint16)
    plane = Plane.from_array(whole)
    assert (plane.name, plane.white, plane.quantisation) == ("Y", 65535, 1 / 65535)
    np.testing.assert_allclose(plane.samples, edge, atol=1 / 65535)
    twelve = Plane.from_array(whole // 16, "G1", black=64, white=4095)
    np.testing.assert_allclose(twelve.samples, (whole // 16 - 64.0) / 4031, atol=1e-6)
    assert estimate_edges(plane)[0].value.numbers["mtf50"].value == pytest.approx(
        outcome.value.numbers["mtf50"].value, abs=1e-4
    )
    assert estimate_psf(edge, Chart.from_seed()).verdict is Verdict.REFUSED
    with pytest.raises(BadInput, match="one linear channel"):
        Plane.from_array(np.zeros((4, 5, 3)))
    for black, white in ((64, 64), (64, 5), (0, np.nan)):
        with pytest.raises(BadParameter, match="white must exceed black"):
            Plane.from_array(whole, black=black, white=white)
    frames = {
        "pass a Plane, as read_frame": lambda: as_plane("photo.dng"),
        "pass Chart.from_seed": lambda: estimate_psf(edge, "chart"),
        "outcome.result\\(\\).psf": lambda: assess(outcome, n=1),
        "pass photographs": lambda: restore(["a.tiff", "b.tiff"], stacks_of([pillbox()] * 2, (1, 0.5), 3.0, (60, 60))),
    }
    for remedy, call in frames.items():
        with pytest.raises(TypeError, match=remedy):
            call()
    rows, columns = field.shape
    assert field.at(columns - 0.5, -0.5).k == field.k
    for x, y in ((columns, 10), (10, -1), (10, rows), (float("nan"), 10)):
        with pytest.raises(BadParameter, match=f"frame of {columns} x {rows} pixels"):
            field.at(x, y)
