"""Colour pairs of a mosaic at 40 dB: error at the found depth over that at the true one, how grey a grey scene stays.

    python -m tests.benchmarks.restoration_colour [SIDE]

SIDE, 176 by default: rows of the sensor. Scenes of `restoration_scenes`, blurred on the sensor's grid.
"""

import sys
import time
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from procedures.raw import Plane
from procedures.restoration.colour.estimate import descended, in_colour, mixing, problem_of, unknowns_of
from procedures.restoration.colour.mosaic import mosaics, spread
from procedures.restoration.joint.estimate import restoration_of
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.masks.blur_operator import BlurOperator
from tests.benchmarks.restoration_scenes import picture

ORIGINS = {"R": (0, 0), "G1": (1, 0), "G2": (0, 1), "B": (1, 1)}
LIGHT = np.array([0.6, 1.0, 0.7])[:, None, None]
RATIOS, MAX_W, R, RIM = (1.0, 1.25), 3.3, 9, 12


@dataclass(frozen=True)
class Pair:
    """Two mosaics, the truth on the sensor's grid, and the noise."""

    photographs: list[dict[str, Plane]]
    truth: np.ndarray
    w: np.ndarray
    sigma: float

    def error(self, found: np.ndarray) -> float:
        """RMSE over all colours, grey levels of 255, the rim left out."""
        return float(255 * np.sqrt(np.mean((found - self.truth)[:, RIM:-RIM, RIM:-RIM] ** 2)))


def pair(shape: tuple[int, int], tinted: bool, seed: int) -> Pair:
    """A slope with a near square, seen through two apertures."""
    rng, extended = np.random.default_rng(seed), (shape[0] + 2 * R, shape[1] + 2 * R)
    grey = gaussian_filter(picture(extended, rng), 0.6)
    tint = [np.sign(gaussian_filter(rng.standard_normal(extended), s)) for s in (8, 5)]
    amounts = np.array([[0.25, 0.05], [0.0, 0.0], [-0.1, 0.2]]) * tinted
    u = np.clip(LIGHT * grey * np.exp(np.tensordot(amounts, tint, axes=1)), 0, 0.95)
    y, x = np.mgrid[0 : extended[0], 0 : extended[1]]
    w = 3.0 + 2.2 * x / extended[1] + 1.0 * ((x < 0.4 * extended[1]) & (y > 0.45 * extended[0]))
    photographs = []
    for ratio in RATIOS:
        blur = BlurOperator(mask_stack(pillbox(), 2 * MAX_W, ratio=ratio, R=R), shape)
        blur.focus(w)
        clean = blur.blur(u)
        sigma = float(clean[1].std() * 10 ** (-40 / 20))
        z = clean + sigma * rng.standard_normal(clean.shape)
        cut = {n: z["RGB".index(n[0]), b::2, a::2].astype(np.float32) for n, (a, b) in ORIGINS.items()}
        photographs.append({n: Plane(n, one, 0.0, 2, ORIGINS[n]) for n, one in cut.items()})
    return Pair(photographs, u[:, R:-R, R:-R], w[R:-R, R:-R], sigma)


def main(side: int = 176) -> None:
    """Print a line for each scene."""
    shape = (side, side * 7 // 6 // 2 * 2)
    masks = [mask_stack(pillbox(), 2 * MAX_W, ratio=ratio, R=R) for ratio in RATIOS]
    of_planes = [mask_stack(pillbox(), MAX_W, ratio=ratio, R=R // 2 + 1) for ratio in RATIOS]
    print("scene        error at true w   at found w   ratio   R-B    planes stacked: R-B   seconds of processor")
    for name, tinted, seed in (("colour", True, 1), ("colour", True, 2), ("grey", False, 1), ("grey", False, 2)):
        one = pair(shape, tinted, seed)
        known = mosaics(one.photographs, np.ones(2))
        samples = {n: plane.samples for n, plane in one.photographs[0].items()}
        first = spread(samples, ORIGINS) / known.gains[:, None, None]
        term = problem_of(known, masks, np.float32)
        u, _ = descended(term, unknowns_of(known, first, R, np.float32), one.w, one.sigma, joint=0)
        at_truth = known.gains[:, None, None] * np.tensordot(np.linalg.inv(mixing()), u[:, R:-R, R:-R], axes=1)
        start = time.process_time()
        z = [np.stack([p.samples.astype(float) for p in planes.values()]) for planes in one.photographs]
        planes = restoration_of(z, of_planes)
        found = in_colour(planes, one.photographs, masks).sharp
        took = time.process_time() - start
        apart = [255 * float(np.std(a / 0.6 - b / 0.7)) for a, b in ((found[0], found[2]), planes.sharp[[0, 3]])]
        a, b = one.error(at_truth), one.error(found)
        print(f"{name} {seed:<8} {a:10.2f} {b:15.2f} {b / a:9.2f} {apart[0]:7.2f} {apart[1]:15.2f} {took:22.0f}")


if __name__ == "__main__":
    main(*(int(one) for one in sys.argv[1:]))
