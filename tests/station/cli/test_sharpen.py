"""`station sharpen`: which procedure it chooses, that it says why, and that every decision can be overridden."""

import json

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from drivers.dng import Shot, write_dng
from procedures import BadParameter, read_frame
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from station.calibration.sharpening import DEFOCUS, FIELD, FINER, SHAKEN, choose, spectral_difference
from tests.program import run

SIZE = 96


def disc(radius):
    return mask_stack(pillbox(), radius, R=5).at(radius)


def line(length, angle):
    kernel = np.zeros((2 * length + 1,) * 2)
    for t in np.linspace(-length, length, 40 * length):
        kernel[length + round(t * np.sin(angle)), length + round(t * np.cos(angle))] += 1
    return kernel / kernel.sum()


@pytest.fixture
def photograph(tmp_path):
    rng = np.random.default_rng(3)
    scene = 0.5 + 0.2 * np.sign(gaussian_filter(rng.standard_normal((SIZE + 20,) * 2), 2))

    def write(name, kernel=None, shift=0):
        z = scene if kernel is None else fftconvolve(scene, kernel, mode="same")
        z = np.roll(z, (shift, -shift), (0, 1))[10:-10, 10:-10] + 0.003 * rng.standard_normal((SIZE, SIZE))
        path = tmp_path / f"{name}.png"
        cv2.imwrite(str(path), np.rint(65535 * np.clip(z, 0, 1)).astype(np.uint16))
        return path

    return write


def chosen(*paths, field=False, ratio=(), way=None):
    return choose([read_frame(one) for one in paths], field_given=field, ratio=ratio, way=way)


@pytest.mark.parametrize("field", [False, True])
def test_different_motions_are_recognised(photograph, field):
    way, reasons, _ = chosen(photograph("a", line(4, 0.3)), photograph("b", line(4, 1.9)), field=field)
    assert way == SHAKEN
    assert "by direction" in reasons[0]


def test_photographs_that_are_only_moved_go_on_a_finer_grid(photograph):
    paths = photograph("a"), photograph("b", shift=2)
    assert chosen(*paths, field=True)[0] == FINER
    with pytest.raises(BadParameter, match="equally sharp"):
        chosen(*paths)


def test_defocus_without_apertures_asks_for_their_ratio(photograph):
    paths = photograph("a", disc(1.5)), photograph("b", disc(2.5))
    with pytest.raises(BadParameter, match="differ by defocus") as refused:
        chosen(*paths)
    assert "--ratio" in refused.value.remedy
    assert chosen(*paths, ratio=(1.6,)) == (DEFOCUS, ("--ratio states that their apertures differ by 1.6",),
                                            {"ratio": (1.6,)})  # fmt: skip


def test_an_inverted_ratio_is_named_unless_the_way_is_given(photograph):
    paths = photograph("a", disc(2)), photograph("b", disc(2.5))
    with pytest.raises(BadParameter, match="photograph 1 is blurred more, but photograph 2 is") as refused:
        chosen(*paths, ratio=(0.8,))
    assert "--ratio 1.25" in refused.value.remedy
    assert chosen(*paths, ratio=(0.8,), way=DEFOCUS)[2] == {"ratio": (0.8,)}


def test_recorded_apertures_give_the_ratio(tmp_path):
    paths = []
    for f_number in (2.0, 2.8):
        paths.append(tmp_path / f"{f_number}.dng")
        write_dng(paths[-1], np.full((32, 32), 4000, np.uint16), Shot(exposure_s=0.1, f_number=f_number),
                  cfa="RGGB", black=(512,) * 4, white=16383)  # fmt: skip
    way, reasons, more = chosen(*paths)
    assert (way, more) == (DEFOCUS, {"ratio": (pytest.approx(2 / 2.8),)})
    assert "f/2, f/2.8" in reasons[0]


def test_one_photograph_needs_the_field_of_its_lens(photograph):
    path = photograph("a")
    assert chosen(path, field=True)[0] == FIELD
    with pytest.raises(BadParameter, match="PSF field"):
        chosen(path)


def test_light_does_not_count_as_blur(photograph):
    one = read_frame(photograph("a"))
    other = read_frame(photograph("b"))
    other.planes["Y"].samples[:] *= 0.5
    size, _ = spectral_difference(one, other)
    assert size < 0.1


@pytest.mark.slow
def test_defocused_pair_is_restored_and_the_record_says_why(photograph, tmp_path):
    paths = photograph("a", disc(1.5)), photograph("b", disc(2.5))
    done = run("sharpen", *paths, "--ratio", 5 / 3, "--max-w", 4, "--scheme", "2x(4+4)+1x6", "--out", tmp_path / "o")
    assert done.exit_code in (0, 5), done.output
    record = json.loads((tmp_path / "o" / "result.json").read_text())
    assert record["procedure"] == record["choice_of_procedure"]["procedure"] == "restore"
    assert record["settings"]["ratio"] == [5 / 3]
    assert any("--ratio states" in one for one in record["choice_of_procedure"]["reasons"])
    assert "--ratio states" in done.output
