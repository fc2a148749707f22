"""Recorded motion: known paths with unknown size in the flat part and unknown relative shift."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift
from scipy.signal import fftconvolve

from procedures.outcome import BadInput
from procedures.restoration.masks.line_rasterisation import path_mask
from procedures.restoration.unknown_motion import recorded_paths
from procedures.restoration.unknown_motion.blind import prototype_shapes

T = np.linspace(0, 2 * np.pi, 400)
# metres, of different extents like those of two exposures
PATHS = [
    1e-4 * np.stack([np.cos(T) + 0.3 * np.cos(2 * T), np.sin(T)], axis=1),
    0.7e-4 * np.stack([np.sin(2 * T), np.cos(T) + 0.4 * np.sin(3 * T)], axis=1),
]


@pytest.fixture(scope="module")
def flat():
    """A flat wall under both motions of half-width 2 at 40 dB, the second photograph shifted by a pixel."""
    rng = np.random.default_rng(5)
    u = 0.5 + 0.2 * np.sign(gaussian_filter(rng.standard_normal((76, 76)), 2.5)) + 0.02 * rng.standard_normal((76, 76))
    masks = [path_mask((p - (p.max(axis=0) + p.min(axis=0)) / 2) * 2.0 / 1.3e-4, 4) for p in PATHS]
    masks[1] = np.clip(shift(masks[1], (0, 1), order=1), 0, None)
    z = np.stack([fftconvolve(u, h, mode="valid") for h in masks])
    return z + rng.standard_normal(z.shape) * z.std() / 100, masks


def likeness(a, b):
    return float(fftconvolve(a, b[::-1, ::-1]).max() / np.linalg.norm(a) / np.linalg.norm(b))


def test_size_and_shift_of_recorded_paths_start_the_search(flat):
    masks = recorded_paths.recorded_masks(flat[0], PATHS, 4)
    # sizes are tried at quarters of a pixel: half a step off keeps the correlation above 0.98
    assert [likeness(a, b) > 0.98 for a, b in zip(masks, flat[1], strict=True)] == [True, True]
    x = np.arange(-4, 5)
    between = [(h * x).sum() for h in masks]
    true = [(h * x).sum() for h in flat[1]]
    assert between[1] - between[0] == pytest.approx(true[1] - true[0], abs=0.15)
    blind = prototype_shapes(flat[0], 4, rounds=3, first=masks)
    assert [likeness(a, b) > 0.95 for a, b in zip(blind.masks, flat[1], strict=True)] == [True, True]


@pytest.mark.parametrize(
    ("paths", "complaint"),
    [
        ([PATHS[0]], "two recorded"),
        ([PATHS[0], PATHS[1][:, :1]], "two columns|two recorded"),
        ([PATHS[0] * 0] * 2, "move"),
    ],
)
def test_invalid_paths_are_refused(flat, paths, complaint):
    with pytest.raises(BadInput, match=complaint):
        recorded_paths.recorded_masks(flat[0], paths, 4)


def test_an_invalid_path_file_is_refused(tmp_path):
    (tmp_path / "path.txt").write_text("1 nan\n2 3\n")
    with pytest.raises(BadInput, match="must be finite"):
        recorded_paths.read_path(tmp_path / "path.txt")
    (tmp_path / "path.txt").write_text("1 2 3\n2 3 4\n")
    with pytest.raises(BadInput, match=r"must be an array \(any, 2\)"):
        recorded_paths.read_path(tmp_path / "path.txt")
    with pytest.raises(BadInput, match="there is no file"):
        recorded_paths.read_path(tmp_path / "none.txt")
