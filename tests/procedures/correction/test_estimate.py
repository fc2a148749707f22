import numpy as np
import pytest

from procedures import CorrectionParameters, Verdict, correct
from procedures.correction.priors import Prior

from .lens_photographs import RGGB, Sensor
from .small_lens import RIM, SmallLens, bayer, grey, scene

pytestmark = pytest.mark.slow

SHAPE = (150, 200)
PHASES = {
    "RGGB": RGGB,
    "BGGR": {"R": (1, 1), "G1": (0, 1), "G2": (1, 0), "B": (0, 0)},
    "GRBG": {"R": (1, 0), "G1": (0, 0), "G2": (1, 1), "B": (0, 1)},
    "GBRG": {"R": (0, 1), "G1": (1, 1), "G2": (0, 0), "B": (1, 0)},
}
PLANES = (80, 104)


def with_rim(shape: tuple[int, int]) -> tuple[int, int]:
    return shape[0] + 2 * RIM, shape[1] + 2 * RIM


@pytest.fixture(scope="module")
def lens() -> SmallLens:
    return SmallLens(SHAPE, 0.8)


@pytest.fixture(scope="module")
def field(lens):
    return lens.field("Y").field


@pytest.fixture(scope="module")
def photograph(lens):
    return grey(lens, scene(with_rim(SHAPE)), Sensor(white_e=60000.0))


@pytest.mark.parametrize("prior", ["total-variation", "second-order"])
def test_a_grey_photograph_is_improved_up_to_its_edges(photograph, field, prior):
    outcome = correct(photograph.frame, {"Y": field}, parameters=CorrectionParameters(Prior(prior)))
    assert (outcome.verdict, outcome.reason) == (Verdict.PASS, "")
    before = photograph.frame.planes["Y"].samples[None]
    gain = photograph.psnr(outcome.value.picture) - photograph.psnr(before)
    gain_inside = photograph.psnr(outcome.value.picture, 20) - photograph.psnr(before, 20)
    assert gain > 3
    # twenty pixels along the rim are a third of the frame
    assert gain > gain_inside - 1


@pytest.fixture(scope="module")
def lenses():
    """Red larger by a third of a pixel of the sensor in the corners; blue, the softest, smaller by a sixth."""
    of = {
        "R": SmallLens(PLANES, 0.5, shift_px=0.17),
        "G1": SmallLens(PLANES, 0.45),
        "B": SmallLens(PLANES, 0.6, shift_px=-0.08),
    }
    return {**of, "G2": of["G1"]}


@pytest.fixture(scope="module")
def fields(lenses):
    return {name: lens.field(name).field for name, lens in lenses.items()}


def shift_of(lens):
    """The lens's lateral colour, in pixels of the sensor."""
    rows, columns = PLANES

    def at(points):
        return 2 * lens.shift_px * (points - np.array([columns - 1, rows - 1]) / 2) / (np.hypot(rows, columns) / 2)

    return at


@pytest.mark.parametrize(
    "phase", ["RGGB", "GBRG", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("BGGR", "GRBG"))]
)
def test_a_grey_scene_stays_grey_for_every_mosaic(lenses, fields, phase):
    light = np.repeat(scene(with_rim((160, 208))), 3, axis=0)
    photograph = bayer(lenses, light, Sensor(white_e=60000.0), PHASES[phase])
    shifts = {name: shift_of(lenses[name]) for name in ("R", "B")}
    outcome = correct(photograph.frame, fields, shifts).value
    picture = outcome.picture
    # one grey level at a contrast of 38, and the contribution of the noise, which is about another; up to the edges
    assert 255 * np.std(picture[0] - picture[2]) < 2


def test_colours_are_reproduced(lenses, fields):
    light = scene(with_rim((160, 208)), channels=3)
    photograph = bayer(lenses, light, Sensor(white_e=60000.0))
    shifts = {name: shift_of(lenses[name]) for name in ("R", "B")}
    picture = correct(photograph.frame, fields, shifts).value.picture
    through = np.stack([photograph.light[name] for name in ("R", "G1", "B")])
    # better than an uncorrected sensor with all three colours at every pixel
    assert photograph.psnr(picture) > photograph.psnr(through)
