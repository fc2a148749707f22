from __future__ import annotations

import numpy as np
import pytest

from procedures.numerics import transforms


@pytest.mark.parametrize("shape", [None, (12, 20), (15, 18)])
def test_single_precision_is_numpy_s_transform(rng: np.random.Generator, shape: tuple[int, int] | None) -> None:
    picture = rng.standard_normal((12, 15)).astype(np.float32)
    # rounding of single precision, over 300 terms of order 1
    np.testing.assert_allclose(transforms.rfft2(picture, shape), np.fft.rfft2(picture, shape), atol=2e-5)


def test_double_precision_stays_double(rng: np.random.Generator) -> None:
    picture = rng.standard_normal((3, 8, 9))
    np.testing.assert_allclose(transforms.rfft2(picture), np.fft.rfft2(picture), atol=1e-12)
