"""Results of many nodes: bracket, planes, verdicts, and their page."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from procedures.field import measuring
from procedures.field.conclusion import conclude
from procedures.field.estimate import FrameNodes
from procedures.field.measuring import MeasuredFrames
from procedures.outcome import Miss, Refused
from procedures.psf import Psf
from procedures.psf_field import Node
from procedures.raw import Plane, RawFrame
from procedures.reading.exposure import Exposure
from station.calibration.field import centre_result
from station.procedure.schema import procedure_named
from station.reports.field.field_files import FieldParts, field_measurement
from station.results.record_head import RecordHead

SLOW_FIXTURES = {"bracket"}

S, K, SHAPE = 4, 13, (300, 450)
COVARIANCE = 1e-7 * np.eye(K * K)
POSITIONS_MM = {"near.dng": -0.5, "middle.dng": 0.0, "far.dng": 0.5}
TILT_MM = (0.16, -0.08)


def gaussian(sigma: float) -> np.ndarray:
    x = (np.arange(K) - K // 2) / S
    h = np.exp(-(x**2 + (x**2)[:, None]) / (2 * sigma**2))
    return h / h.sum()


def measured(rng, sources=POSITIONS_MM, places=5, planes=("R", "G1")) -> MeasuredFrames:
    """Blur through a tilted plane of best focus: sigma^2 = 0.5^2 + 0.3 z^2, z the defocus."""
    result = MeasuredFrames()
    for name in planes:
        result.planes[name] = Plane(name, np.broadcast_to(np.float32(0), SHAPE), 1 / 16383, 2)
        result.nodes[name] = []
    grid = [(x, y) for y in np.linspace(40, 260, places) for x in np.linspace(50, 400, places)]
    for source, z in sources.items():
        result.frames.append((Path(source), "0" * 64))
        for number, (x, y) in enumerate(grid, 1):
            half = np.hypot(*SHAPE) / 2
            best = TILT_MM[0] * (x - 224.5) / half + TILT_MM[1] * (y - 149.5) / half
            h = gaussian(np.sqrt(0.25 + 0.3 * (z - best) ** 2))
            for name in planes:
                noisy = h + 3e-4 * rng.standard_normal((K, K))
                at = np.array([x, y]) + 0.002 * rng.standard_normal(2)
                psf = Psf(noisy / noisy.sum(), S, COVARIANCE)
                result.nodes[name].append(Node(at, 4e-6 * np.eye(2), 2 * at, psf, source, number))
    return result


@pytest.fixture(scope="module")
def bracket():
    return conclude(measured(np.random.default_rng(1)), POSITIONS_MM)


def test_a_bracket_gives_the_tilt_and_the_field_of_the_sharpest_position_and_the_page_shows_them(bracket):
    numbers = bracket.focus.numbers()
    for name, expected in zip(("focus_tilt_x", "focus_tilt_y"), TILT_MM, strict=True):
        assert numbers[name].value == pytest.approx(expected, abs=4 * numbers[name].uncertainty + 0.004)
    centre = bracket.planes["R"].result().centre.h
    # noise of one sample 3e-4 before the mean of many
    np.testing.assert_allclose(centre, gaussian(0.5), atol=1e-3)
    results = [centre_result(name, outcome) for name, outcome in bracket.planes.items()]
    measurement = field_measurement(FieldParts(bracket), results, RecordHead("field"))
    page = procedure_named("field").page(measurement).decode()
    for words in ("Best focus", "focus tilt x", "Lateral colour", "R against G1"):
        assert words in page


@pytest.mark.slow
def test_a_short_bracket_gives_the_field_without_the_focus():
    two = {name: POSITIONS_MM[name] for name in ("near.dng", "middle.dng")}
    result = conclude(measured(np.random.default_rng(1), two), two)
    assert result.focus is None
    assert "3 focus positions or more" in result.focus_refusal
    assert result.planes["R"].value is not None


def test_planes_with_too_few_nodes_are_refused_by_name():
    result = conclude(measured(np.random.default_rng(1), {"one.dng": 0.0}, places=2))
    assert [str(one.verdict) for one in result.planes.values()] == ["refused", "refused"]
    assert "plane R has 4" in result.planes["R"].reason
    assert result.colours == ()


@pytest.mark.slow
@pytest.mark.parametrize(("count", "fails"), [(1, False), (2, True)])
def test_a_field_with_many_doubtful_charts_is_doubtful(count, fails):
    result = measured(np.random.default_rng(1), {"one.dng": 0.0}, places=3, planes=("Y",))
    nodes = result.nodes["Y"]
    nodes[:count] = [replace(node, caveat="its light flickers", remedy="light it evenly") for node in nodes[:count]]
    outcome = conclude(result).planes["Y"]
    assert ("2 of the 9 charts are doubtful, for example: its light flickers" in outcome.reason) == fails
    assert ("light it evenly" in outcome.remedy) == fails


def test_no_nodes_are_refused_with_the_first_reason():
    empty = MeasuredFrames(misses=[Miss("a.dng", "a.dng is empty", "copy it again")], failed=["a.dng"])
    with pytest.raises(Refused, match="none of 1 photographs gives a PSF"):
        conclude(empty)


def test_a_photograph_of_another_size_and_a_copy_are_named(monkeypatch, tmp_path):
    sizes = {"a.dng": (20, 30), "b.dng": (20, 40), "c.dng": (20, 30), "copy.dng": (20, 30)}
    psf = Psf(gaussian(0.5), S, COVARIANCE)

    def read(path, names, layout=None, data=None):
        plane = Plane("Y", np.zeros(sizes[path.name], dtype=np.float32), 1.0)
        return RawFrame(path, path.name.replace("copy", "a"), {"Y": plane}, Exposure())

    def nodes(frame, chart, parameters, each, sensors):
        node = Node(np.zeros(2), np.eye(2), np.zeros(2), psf, frame.path.name, 1)
        return FrameNodes({"Y": [node]}, {"Y": sizes[frame.path.name]}, [])

    monkeypatch.setattr(measuring, "read_frame", read)
    monkeypatch.setattr(measuring, "measure_frame", nodes)
    finished = []
    result = measuring.measure(
        [tmp_path / name for name in sizes], None, None, None, finished.append, content=lambda path: b""
    )
    assert result.failed == ["b.dng", "copy.dng"]
    assert "has not the planes and sizes of a.dng" in result.misses[0].reason
    assert "copy.dng has the content of a.dng" in result.misses[1].reason
    assert finished == [f"read {name}" for name in sizes]
    assert [node.source for node in result.nodes["Y"]] == ["a.dng", "c.dng"]
