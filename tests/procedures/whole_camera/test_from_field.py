"""Parts of a camera from simulated charts: their covariance compared with that of draws."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from procedures.field.estimate import MeasuredChart
from procedures.field.maps import lateral_colour
from procedures.outcome import Outcome, Quantity, Verdict
from procedures.pattern_psf.correspondences import Correspondences
from procedures.pattern_psf.registration import Registration
from procedures.pattern_psf.solution import SharedErrors
from procedures.psf import Psf
from procedures.psf_field import Node
from procedures.whole_camera.from_field import (
    COMPUTED,
    ZERO,
    CameraPart,
    charts_of,
    colour_part,
    join,
    monomial_names,
    psf_part,
    with_sensor_reason,
)

K, S, SHAPE = 5, 2, (300, 450)
SIZE = K * K
PLACES = [(x, y) for y in (60.0, 150.0, 240.0) for x in (60.0, 220.0, 380.0)]
NOTHING = Correspondences(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))
PLAIN = Registration(np.eye(3), np.zeros(2), 1.0, np.zeros((2, 9)))


@dataclass(frozen=True)
class Charts:
    """The charts of three planes, and their common covariance (27, 27) of PSF and centre."""

    planes: dict[str, list[MeasuredChart]]
    covariance: np.ndarray

    def drawn(self, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """Errors (places, 27) of every plane's PSFs and centres."""
        root = np.linalg.cholesky(self.covariance)
        return {name: rng.standard_normal((len(seen), SIZE + 2)) @ root.T for name, seen in self.planes.items()}


@pytest.fixture(scope="module")
def charts() -> Charts:
    rng = np.random.default_rng(5)
    root = 1e-3 * rng.standard_normal((SIZE + 2, 40)) / np.sqrt(40)
    root[-2:] += 2 * root[3:5]  # the centre follows the PSF
    covariance = root @ root.T
    shared = SharedErrors(covariance[:-2, -2:], np.zeros((18, SIZE + 2)), np.zeros((2, SIZE + 2)), np.zeros(9))
    h = np.full((K, K), 1 / SIZE)
    gradients = {name: rng.standard_normal(SIZE) for name in ("mtf50_horizontal", "fwhm_vertical")}
    gradients["fwhm_vertical"][3] = 20.0
    spreads = {name: np.sqrt(g @ covariance[:-2, :-2] @ g) for name, g in gradients.items()}
    planes = {}
    for plane in ("R", "G1", "B"):
        planes[plane] = []
        for i, (x, y) in enumerate(PLACES):
            colour = {"R": 2e-3, "G1": 0.0, "B": -1e-3}[plane] * (np.array([x, y]) - np.array(SHAPE[::-1]) / 2)
            at = np.array([x, y]) + colour + root[-2:] @ rng.standard_normal(40)
            node = Node(at, covariance[-2:, -2:], 2 * at, Psf(h, S, covariance[:-2, :-2]), f"{i}.dng", 1)
            # the stated uncertainty of the width includes more than noise
            numbers = {
                name: Quantity(0.5, "pixel", spreads[name] * (1.5 if name[0] == "f" else 1.0), "", 1)
                for name in gradients
            }
            planes[plane].append(MeasuredChart(node, numbers, gradients, PLAIN, NOTHING, shared))
    return Charts(planes, covariance)


def colours(charts: Charts):
    """Lateral colour of red and blue."""
    nodes = {name: [one.node for one in seen] for name, seen in charts.planes.items()}
    return [lateral_colour(name, nodes[name], "G1", nodes["G1"], SHAPE, 2) for name in ("R", "B")]


@pytest.fixture(scope="module")
def joint(charts):
    parts = [psf_part(name, seen) for name, seen in charts.planes.items()]
    parts += [colour_part(one, 2, charts.planes) for one in colours(charts)]
    known = {(name, f"{i}.dng", 1): charts.covariance for name in charts.planes for i in range(len(PLACES))}
    return join(parts, known)


def test_the_block_of_one_part_is_its_own_covariance_with_widened_supports_too(charts, joint):
    stated = [number.uncertainty for one in charts.planes["R"] for number in one.numbers.values()]
    np.testing.assert_allclose(np.sqrt(np.diag(joint.block("psf.R", "psf.R"))), stated)
    (red, _), own = colours(charts), joint.block("lateral_colour.R", "lateral_colour.R")
    (x, first), (y, second) = (red.surface.coefficients(axis) for axis in np.eye(2))
    count = len(x)
    np.testing.assert_allclose(own[:count, :count], first, rtol=1e-9)
    np.testing.assert_allclose(own[count:, count:], second, rtol=1e-9)
    assert joint.parts[3].names[:3] == ("x.1", "x.x", "x.y")
    np.testing.assert_allclose(joint.parts[3].values, [*x, *y])
    seen = charts.planes["G1"]
    field = SimpleNamespace(nodes=[replace(one.node) for one in seen[1:]])
    kept = Outcome(SimpleNamespace(interpolation=SimpleNamespace(field=field)))
    found = SimpleNamespace(
        planes={"G1": kept, "B": Outcome(None, Verdict.REFUSED)}, measured=SimpleNamespace(charts=charts.planes)
    )
    assert charts_of(found) == {"G1": seen[1:], "B": []}


def test_no_eigenvalue_is_below_zero(joint):
    np.testing.assert_array_equal(joint.covariance, joint.covariance.T)
    values = np.linalg.eigvalsh(joint.covariance)
    assert values.min() > -1e-12 * values.max()


def test_covariances_between_parts_are_those_of_draws(charts, joint):
    rng, count = np.random.default_rng(9), 3000
    x, y = ((np.array(PLACES) - (np.array(SHAPE[::-1]) - 1) / 2) / (np.hypot(*SHAPE) / 2)).T
    to_terms = np.linalg.pinv(np.stack([np.ones_like(x), x, y], axis=1))
    gradient, drawn = charts.planes["R"][0].gradients["fwhm_vertical"], []
    for _ in range(count):
        errors = charts.drawn(rng)
        shifts = (2 * (errors[name][:, -2:] - errors["G1"][:, -2:]) for name in ("R", "B"))
        coefficients = [(to_terms @ shift).T.ravel() for shift in shifts]
        widths = [gradient @ errors[name][4, :-2] for name in ("R", "G1", "B")]
        drawn.append(np.concatenate([*coefficients, widths]))
    found = np.cov(np.array(drawn).T)
    spread = np.sqrt(np.diag(found))
    found = found / np.outer(spread, spread)
    near = 5 / np.sqrt(count)  # standard error of a correlation: one over the root of the draws
    of_colours = joint.block("lateral_colour.R", "lateral_colour.B") / np.outer(spread[:6], spread[6:12])
    np.testing.assert_allclose(found[:6, 6:12], of_colours, atol=near)
    assert np.diag(found[:6, 6:12]).min() > 0.4  # both contain green's positions
    for i, name in enumerate(("R", "G1", "B"), 12):
        shared = joint.block(f"psf.{name}", "lateral_colour.R")[9]  # the fifth place's second number
        np.testing.assert_allclose(found[i, :6], shared / (spread[i] * spread[:6]), atol=near)
    assert np.abs(found[12:14, :6]).max(axis=1).min() > 2 * near
    assert not joint.block("psf.B", "lateral_colour.R").any()


def test_every_pair_of_parts_has_a_block_with_its_reason_and_bound(joint, charts):
    flats = CameraPart("vignetting", ("k1",), ("1",), np.zeros(1), np.eye(1), "the flats")
    blocks = {(one.first, one.second): one for one in join([*joint.parts, flats], {
        key: np.eye(SIZE + 2) for part in joint.parts for key in part.charts}).blocks}  # fmt: skip
    assert len(blocks) == 15
    assert blocks["psf.R", "lateral_colour.R"].how == COMPUTED
    assert blocks["psf.R", "psf.B"].how == ZERO
    assert "photosites" in blocks["psf.R", "psf.B"].why
    assert blocks["lateral_colour.B", "vignetting"].why == "other photographs: the charts, and the flats"
    assert monomial_names(2) == ["1", "x", "y", "x2", "xy", "y2"]
    apart = {("R", "a", 1): np.diag([1.0, 1.0, 1.0])}
    row = np.array([[1.0, 0.0, 0.0]])
    parts = [
        CameraPart(name, ("n",), ("1",), np.zeros(1), np.eye(1) * variance, "", {("R", "a", 1): row})
        for name, variance in (("a", 0.5), ("b", 0.5))  # stated to be smaller than the common part
    ]
    found = join(parts, apart).covariance
    np.testing.assert_allclose(np.diag(found), [0.5, 0.5])
    assert np.linalg.eigvalsh(found).min() > -1e-12
    part = psf_part("R", charts.planes["R"])
    ladder = CameraPart("sensor", ("R.system_gain",), ("DN/e-",), np.ones(1), np.eye(1), "the sensor's ladder of light")
    assert with_sensor_reason(part, charts.planes) is part
    assert join([part, ladder], {}).blocks[0].why.startswith("other photographs: ")
    terms = {name: {"sensor": 0.02 * number.uncertainty} for name, number in charts.planes["R"][0].numbers.items()}
    planes = {name: [replace(one, budgets=terms) for one in seen] for name, seen in charts.planes.items()}
    (block,) = join([with_sensor_reason(part, planes), ladder], {}).blocks
    assert block.how == ZERO
    assert "response and noise were used" in block.why
    assert "0.02 times an uncertainty" in block.why
