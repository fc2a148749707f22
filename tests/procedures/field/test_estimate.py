"""Charts of one frame become nodes, in every plane at their positions in that plane."""

from pathlib import Path

import numpy as np
import pytest

from procedures import BadInput, PatternParameters, Refused, Verdict, assess
from procedures.field import estimate
from procedures.field.estimate import FrameNodes, estimate_field, measure_frame
from procedures.pattern import CELLS, Chart
from procedures.raw import Plane, RawFrame, read_frame
from simulators.camera.camera import Lens, SimulatedCamera, true_mtf
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene, Shape

SLOW_FIXTURES = {"shot", "six"}
CHART = Chart.from_seed()
MIDDLE = np.full((1, 2), CELLS / 2)
PARAMETERS = PatternParameters(4, 13)


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    """Three charts in a Bayer frame; one is hidden at four marks."""
    camera = SimulatedCamera(
        Lens(lateral_colour=0.02), Sensor(220, 640, full_well_e=6e4, gain_e_per_dn=3.8), 5.94, white_e_per_s=8e5
    )
    cover = Shape(((-40.0, -40.0), (300.0, -40.0), (300.0, 4.0), (-40.0, 4.0)), 0.3)
    placed = [camera.place(CHART, pixels=66, at=(x, 0.5), roll_deg=2.0) for x in (0.82, 0.5, 0.18)]
    placed[1] = type(placed[1])(**{**vars(placed[1]), "covers": (cover,)})
    path = tmp_path_factory.mktemp("frame") / "three.dng"
    return camera.photograph(Scene(tuple(placed)), np.random.default_rng(3), path)


def test_nodes_and_lateral_colour_are_those_of_the_charts_and_a_failed_chart_is_named(shot):
    frame_nodes = measure_frame(read_frame(shot.path), CHART, PARAMETERS)
    for plane, nodes in frame_nodes.nodes.items():
        assert [node.number for node in nodes] == [1, 3]  # from left to right; the middle one is hidden
        for node, chart in zip(nodes, (2, 0), strict=True):
            off = node.position - shot.true_points(plane, MIDDLE, chart)[0]
            assert np.all(np.abs(off) < 4 * np.sqrt(np.diag(node.position_covariance)) + 1e-3)
    # one half diagonal is 338 sensor pixels: at 205 of them from the axis red is 0.07 * 0.02 * 205 = 0.29 farther out
    for number, (red, green) in enumerate(zip(frame_nodes.nodes["R"], frame_nodes.nodes["G1"], strict=True)):
        shift = red.sensor_position - green.sensor_position
        error = 2 * np.sqrt(red.position_covariance[0, 0] + green.position_covariance[0, 0])
        expected = shot.truths[2 - 2 * number].colour_shift.at(0.6)
        assert abs(expected[0]) > 0.25
        np.testing.assert_allclose(shift, expected, atol=4 * error + 2e-3)
    assert {miss.plane for miss in frame_nodes.misses} <= {"R", "G1", "G2", "B"}
    assert all("hidden" in miss.reason and miss.source == "three.dng" for miss in frame_nodes.misses)
    assert all(miss.place.startswith("(1") for miss in frame_nodes.misses)  # in the middle of 320 pixels


def test_a_frame_without_charts_is_refused():
    plane = Plane("Y", np.full((120, 160), 0.5, dtype=np.float32), 1 / 65535)
    with pytest.raises(Refused, match=r"flat\.pgm: no chart"):
        measure_frame(RawFrame(Path("flat.pgm"), "", {"Y": plane}, None), CHART, PARAMETERS)


@pytest.fixture(scope="module")
def six():
    """Six charts in a grey frame, and the optics, uniform over it."""
    sensor = Sensor(280, 310, None, bits=16, full_well_e=5.2e5, gain_e_per_dn=8.0)
    camera = SimulatedCamera(sensor=sensor, pitch_um=7.5, white_e_per_s=2e7, oversampling=5)
    places = [(x, y) for y in (0.25, 0.75) for x in (0.18, 0.5, 0.82)]
    charts = tuple(camera.place(CHART, pixels=66, at=at, roll_deg=2.0) for at in places)
    photograph = camera.photograph(Scene(charts), np.random.default_rng(4))
    plane = Plane("Y", photograph.plane("Y").astype(np.float32), 1 / 65535)
    return RawFrame(Path("six.pgm"), "", {"Y": plane}, None), photograph.truths[0].optics


def test_a_field_gives_mtf50_between_the_charts_and_refuses_too_few(six, shot):
    frame, optics = six
    outcome = estimate_field([frame], CHART, PARAMETERS)["Y"]
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "6 charts do not show how the PSF varies" in outcome.reason
    psf = outcome.result().at(100.0, 140.0)
    mtf50 = assess(psf, n=6).numbers["mtf50_horizontal"]
    f = np.arange(0.0, 1.0, 1e-3)
    true = f[np.flatnonzero(true_mtf(optics, f, 0.0) < 0.5)[0]]
    # four standard uncertainties, and a step of the frequencies
    assert abs(mtf50.value - true) < 4 * mtf50.uncertainty + 1e-3
    outcomes = estimate_field([read_frame(shot.path, ["G1"])], CHART, PARAMETERS)
    assert outcomes["G1"].verdict is Verdict.REFUSED
    assert "6 places of the frame or more; plane G1 has 2" in outcomes["G1"].reason


def test_photographs_of_a_field_are_of_one_size(six, monkeypatch):
    sizes = iter([(280, 310), (280, 312)])
    monkeypatch.setattr(estimate, "measure_frame", lambda *_: FrameNodes({"Y": []}, {"Y": next(sizes)}, []))
    with pytest.raises(BadInput, match=r"same planes and sizes; six\.pgm has others"):
        estimate_field([six[0], six[0]], CHART)


def test_a_field_of_no_photographs_is_refused():
    with pytest.raises(Refused, match="there is none"):
        estimate_field([], CHART)
