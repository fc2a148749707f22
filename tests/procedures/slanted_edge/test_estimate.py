"""MTF across simulated edges against the true optics, uncertainties against the scatter of errors, and refusals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procedures import BadParameter, Outcome, Roi, Verdict, read_frame
from procedures.slanted_edge.estimate import EdgeMtf, estimate_edge, estimate_edges
from simulators.camera.optics import Optics
from simulators.camera.pupil import Wavefront
from simulators.world.scene import Illumination

from .scenes import edge_light, exposed, gaussian, plane, true_mtf50

pytestmark = pytest.mark.delicate


def whole(samples: np.ndarray) -> Outcome[EdgeMtf]:
    made = plane(samples)
    return estimate_edge(made, Roi.whole(made.samples))


def value(outcome: Outcome[EdgeMtf]) -> EdgeMtf:
    assert outcome.value is not None, outcome.reason
    return outcome.value


LENSES = {
    "Gaussian": (gaussian(0.25), None),
    "diffraction": (Optics.typical(f_number=8, pitch_um=5.5), 150),
    "low-pass filter": (Optics.typical(f_number=4, pitch_um=5.0, olpf_px=0.8), 150),
    "spherical": (
        Optics.typical(f_number=4, pitch_um=5.0, wavefront=Wavefront(spherical_um=0.06, defocus_um=0.05)), 150,
    ),
}  # fmt: skip


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("columns", [30, 60])
def test_mtf50_of_known_optics_without_noise(lens: str, columns: int) -> None:
    # errors: the tail's shape beyond the window and, for sharp optics, the aliases of four bins; the wide margin keeps
    # the wrap-around of the simulator's Fourier transform out of the tail
    optics, margin = LENSES[lens]
    found = value(whole(edge_light(optics, columns=columns, margin_px=margin)))
    assert found.numbers["mtf50"].value == pytest.approx(true_mtf50(optics, 5.5), rel=0.002)
    assert found.numbers["angle"].value == pytest.approx(5.5, abs=0.01)


def test_slope_of_the_light_and_a_bent_edge_do_not_blur():
    light = Illumination(1.0, (0.1, 0.05), centre_px=(30.0, 50.0), radius_px=50.0)
    found = value(whole(edge_light(gaussian(0.25), light=light)))
    assert found.numbers["mtf50"].value == pytest.approx(0.25, rel=0.002)
    # a sagitta of three pixels: with a straight line, a blur of one pixel
    found = value(whole(edge_light(gaussian(0.25), bend=3.0)))
    assert found.order >= 2
    assert found.numbers["mtf50"].value == pytest.approx(0.25, rel=0.003)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_direction_and_polarity_do_not_matter(turns: int) -> None:
    samples = edge_light(gaussian(0.2))
    assert value(whole(np.rot90(samples, turns))).numbers["mtf50"].value == pytest.approx(
        value(whole(samples)).numbers["mtf50"].value, rel=1e-3
    )


def test_the_normal_points_across_the_edge() -> None:
    # x grows with y along the edge: the normal of (sin 5.5, cos 5.5) is (cos 5.5, -sin 5.5)
    samples = edge_light(gaussian(0.2))
    assert value(whole(samples)).normal_deg == pytest.approx(-5.5, abs=0.02)
    assert value(whole(samples.T)).normal_deg == pytest.approx(-84.5, abs=0.02)
    assert value(whole(samples.T[::-1])).normal_deg == pytest.approx(84.5, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("draws", [10, pytest.param(24, marks=pytest.mark.nightly)])
def test_uncertainties_are_as_large_as_errors(rng: np.random.Generator, draws: int) -> None:
    light = edge_light(gaussian(0.25))
    numbers, noises = [], []
    for serial in range(draws):
        made = exposed(light, serial, rng)
        edge = value(estimate_edge(made, Roi.whole(made.samples)))
        numbers.append(edge.numbers["mtf50"])
        noises.append(edge.budgets["mtf50"]["noise"])  # without corruptions that such a picture does not exclude
    z = np.array([(n.value - 0.25) / noise for n, noise in zip(numbers, noises, strict=True)])
    # three standard deviations of the mean and of the standard deviation of so many draws
    assert abs(z.mean()) < 3 / draws**0.5
    assert abs(z.std() - 1) < 3 / (2 * draws - 2) ** 0.5
    errors = np.abs(np.array([n.value for n in numbers]) / 0.25 - 1)
    assert np.quantile(errors, 0.95) < 0.02


def test_the_standard_s_sample_edge(shared_data: Path) -> None:
    # the grey of a picture in three channels: its noise has a quarter of the power at Nyquist that it has below 0.1
    made = read_frame(shared_data / "edges" / "Test_edge1_mono.tif").planes["Y"]
    for outcome in (estimate_edge(made, Roi.whole(made.samples)), estimate_edges(made)[0]):
        found = value(outcome)
        assert outcome.verdict is Verdict.DOUBTFUL
        assert "demosaicked" in outcome.reason
        assert found.numbers["mtf50"].value == pytest.approx(0.292, abs=0.005)
        assert found.numbers["angle"].value == pytest.approx(5.5, abs=0.05)
        assert found.orientation == "near-horizontal"


def test_all_edges_of_a_frame_are_detected(rng: np.random.Generator) -> None:
    frame = np.full((260, 300), 0.1)
    frame[20:120, 30:90] = edge_light(gaussian(0.25))
    # each on its own dark ground, whose borders are parallel to the axes
    frame[150:210, 120:220] = edge_light(gaussian(0.15)).T
    noisy = frame + 0.005 * rng.standard_normal(frame.shape)
    found = [value(one) for one in estimate_edges(plane(noisy))]
    assert [one.turned for one in found] in ([True, False], [False, True])
    by_turn = {one.turned: one for one in found}
    assert by_turn[False].numbers["mtf50"].value == pytest.approx(0.25, rel=0.04)
    assert by_turn[True].numbers["mtf50"].value == pytest.approx(0.15, rel=0.04)


def test_hot_and_dead_pixels_do_not_matter(rng):
    made = exposed(edge_light(gaussian(0.25)), 1, rng)
    clean = value(estimate_edge(made, Roi.whole(made.samples)))
    samples = made.samples.copy()
    samples[[20, 50, 51], [10, 20, 30]], samples[[3, 70], [55, 40]] = 0.95, 0.0  # in the dark, and in the bright
    outcome = estimate_edge(replace(made, samples=samples), Roi.whole(samples))
    assert outcome.verdict is Verdict.PASS
    assert value(outcome).numbers["mtf50"].value == pytest.approx(clean.numbers["mtf50"].value, rel=0.002)


def refusal(samples: np.ndarray, words: str) -> None:
    outcome = whole(samples)
    assert outcome.verdict is Verdict.REFUSED
    assert words in outcome.reason
    assert outcome.remedy


def test_noise_and_texture_are_no_edges(rng):
    refusal(0.5 + 0.05 * rng.standard_normal((60, 60)), "no edge")
    refusal(np.full((60, 60), 0.5), "no edge")
    refusal(np.kron(rng.random((15, 15)), np.ones((4, 4))), "edge")
    for seed, words in (2, "levels of their own"), (245, "leaves it"):
        refusal(gaussian_filter(np.random.default_rng(seed).random((24, 24)), 1.0), words)


@pytest.mark.parametrize(("angle", "words"), [(0.2, "near the axis"), (45.0, "near the diagonal")])
def test_an_edge_that_misses_phases_is_refused(angle: float, words: str) -> None:
    refusal(edge_light(gaussian(0.25), angle_deg=angle, columns=60, rows=50), words)


def test_short_clipped_sharp_and_noisy_edges_are_refused_by_name(rng):
    refusal(edge_light(gaussian(0.25), rows=12, columns=40), "too short")
    refusal(np.minimum(edge_light(gaussian(0.25)) * 1.2, 1.0), "saturated")
    refusal(edge_light(gaussian(1.25)), "stays above 1/2")
    light = 0.3 + 0.25 * edge_light(gaussian(0.25))
    refusal(light + 0.15 * rng.standard_normal(light.shape), "too noisy")


@pytest.mark.parametrize("roi", [Roi(-1, 0, 20, 20), Roi(50, 0, 20, 20), Roi(0, 0, 4, 50)])
def test_a_region_outside_the_plane_is_an_error(roi: Roi) -> None:
    with pytest.raises(BadParameter, match="region must"):
        estimate_edge(plane(np.zeros((60, 60))), roi)


def test_planes_without_slanted_edges_are_refused(rng):
    noise = plane(0.5 + 0.01 * rng.standard_normal((120, 120)))
    (only,) = estimate_edges(noise)
    assert only.verdict is Verdict.REFUSED
    assert "no straight edge" in only.reason
    samples = np.full((120, 120), 0.1)
    samples[:, 60:] = 0.9
    (only,) = estimate_edges(plane(samples))
    assert "too near the axes" in only.reason
