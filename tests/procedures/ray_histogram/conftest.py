from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from procedures.ray_histogram.film import Film, film_of_samples
from procedures.ray_histogram.film_files import read_film

Doubles = npt.NDArray[np.float64]


def cast(rng: np.random.Generator, level: npt.ArrayLike, n: int) -> Doubles:
    """Samples (rows, columns, n, 3) like a path tracer's: half of the paths find no light, the others are
    gamma-like."""
    level = np.asarray(level, np.float64)
    shape = (*level.shape, n)
    bright = rng.gamma(2.0, 1.0, (*shape, 3)) * (rng.random(shape) < 0.5)[..., None]
    return bright * level[..., None, None]  # mean: level


@pytest.fixture
def light(rng: np.random.Generator) -> Callable[[npt.ArrayLike, int], Doubles]:
    """Generator of samples (rows, columns, n, 3) with the given mean."""
    return lambda level, n: cast(rng, level, n)


@pytest.fixture
def flat_film(rng: np.random.Generator) -> Film:
    return film_of_samples(cast(rng, np.full((24, 21), 0.4), 32))


@pytest.fixture(scope="session")
def cornell(shared_data: Path) -> dict[int, Film]:
    return {n: read_film(shared_data / "rays" / f"cornell_{n:05d}_f16.npz") for n in (64, 256)}


@pytest.fixture(scope="session")
def reference(shared_data: Path) -> Doubles:
    with np.load(shared_data / "rays" / "cornell_reference.npz") as archive:
        return archive["reference"].astype(np.float64)
