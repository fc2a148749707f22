"""Speed of restoration: one space-variant convolution against the machine's own peak and a NumPy loop.

`python -m tests.benchmarks.restoration_speed [--memory MEGAPIXELS]`
"""

import os
import platform
import resource
import sys
import time
from collections.abc import Callable
from functools import partial

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from procedures.restoration.joint.estimate import RestorationParameters, restore
from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.masks.array_loops import in_bands, most_threads
from procedures.restoration.masks.blur_models import mask_stack, path_shape
from procedures.restoration.masks.blur_operator import BlurOperator

SHAPE = (650, 730)
Array = NDArray[np.float32]


def best_of(*works: Callable[[], object], runs: int) -> list[float]:
    """Shortest wall time of each, seconds: taken in turn, so that all of them meet the machine's quiet moments."""
    for work in works:
        work()  # compiled here
    return np.min([[_seconds(work) for work in works] for _ in range(runs)], axis=0).tolist()


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


@numba.njit(fastmath=True, nogil=True)
def _peak(low: Array, high: Array, out: Array, rounds: int, first: int, last: int) -> None:
    """The convolution's innermost line on data that stay in the first cache: two products, three loads, one store."""
    for n in range(first, last):
        row = out[n]
        a, b = low[n], high[n]
        for k in range(rounds):
            p = np.float32(k)
            for t in range(row.size):
                row[t] += p * a[t] + p * b[t]


def peak_work() -> tuple[Callable[[], object], int]:
    """The convolution's access pattern at its best for about as long, and how many multiply-adds that is.

    Its threads are the convolution's: numba's own stay awake for milliseconds after their work, on a processor that
    whatever is timed next needs.
    """
    threads, width, rounds = most_threads(), 1024, 100000
    low, high, out = (np.zeros((threads, width), np.float32) for _ in range(3))
    return lambda: in_bands(partial(_peak, low, high, out, rounds), range(threads + 1)), 2 * threads * width * rounds


def numpy_loop(u: Array, w: Array, masks: Array, step: float, R: int) -> Array:
    """The same convolution, one NumPy pass for each mask entry."""
    level = np.minimum((w / step).astype(int), len(masks) - 2)
    f = (w / step - level).astype(np.float32)
    out = np.zeros(SHAPE, np.float32)
    for ky in range(2 * R + 1):
        for kx in range(2 * R + 1):
            entry = (1 - f) * masks[level, ky, kx] + f * masks[level + 1, ky, kx]
            y, x = 2 * R - ky, 2 * R - kx
            out += (u * entry)[y : y + SHAPE[0], x : x + SHAPE[1]]
    return out


def wandering(seed: int) -> NDArray[np.float64]:
    """A vibration path's shape."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2 * np.pi, 400)
    path = np.stack([sum(rng.standard_normal(2) @ [np.cos(k * t), np.sin(k * t)] / k for k in (1, 2, 3)) for _ in "xy"])
    return path_shape((path - (path.max(axis=1) + path.min(axis=1))[:, None] / 2).T)


def main() -> None:
    """Print environment, times and ratios."""
    print(
        f"Python {platform.python_version()}, numba {numba.__version__}, {platform.machine()}, {os.cpu_count()} cores"
    )
    stacks = [mask_stack(wandering(seed), 7.5, R=8) for seed in (1, 2)]
    rng = np.random.default_rng(0)
    blur = BlurOperator(stacks[0], SHAPE, np.float32)
    u = rng.random(blur.extended).astype(np.float32)
    w = (7 - 5 * np.mgrid[0 : blur.extended[0], 0 : blur.extended[1]][1] / blur.extended[1]).astype(np.float32)
    blur.focus(w)
    supports = stacks[0].supports()[blur.level + 1].astype(float)
    work = 2 * float(np.sum((2 * supports + 1) ** 2))
    peak, peak_madds = peak_work()
    errors, masks = np.ascontiguousarray(u[: SHAPE[0], : SHAPE[1]]), stacks[0].masks.astype(np.float32)
    seconds, adjoint, at_peak = best_of(lambda: blur.blur(u), lambda: blur.blur_adjoint(errors), peak, runs=60)
    rate = peak_madds / at_peak
    print(f"{most_threads()} threads, blur {SHAPE[1]}x{SHAPE[0]}, masks to 17x17")
    print(f"  peak of the access pattern {rate / 1e9:.1f} G madd/s")
    for name, took in (("blur", seconds), ("adjoint", adjoint)):
        reached = work / took
        print(f"  {name} {1000 * took:.1f} ms, {reached / 1e9:.1f} G madd/s: {reached / rate:.2f} of it   bound 0.33")
    slow, seconds = best_of(lambda: numpy_loop(u, w, masks, stacks[0].step, 8), lambda: blur.blur(u), runs=5)
    print(f"  NumPy loop over mask entries {slow:.2f} s: {slow / seconds:.0f} x   bound 50 x")
    if "--memory" in sys.argv:
        memory(stacks, float(sys.argv[sys.argv.index("--memory") + 1]))


def memory(stacks: list, megapixels: float) -> None:  # type: ignore[type-arg]
    """Peak memory of a colour pair, a short scheme with every kind of round: longer ones have no other arrays."""
    side = int(np.sqrt(megapixels * 1e6))
    rng = np.random.default_rng(2)
    R = stacks[0].R
    u = 0.5 + 0.2 * np.sign(gaussian_filter(rng.standard_normal((side + 2 * R, side + 2 * R)), 4)).astype(np.float32)
    w = np.full(u.shape, 4.0, np.float32)
    w[side // 2 :] = 5.0
    photographs = []
    for stack in stacks:
        blur = BlurOperator(stack, (side, side), np.float32)
        blur.focus(w)
        grey = blur.blur(u) + 0.0015 * rng.standard_normal((side, side)).astype(np.float32)
        photographs.append(np.stack([grey, 0.8 * grey, 0.6 * grey]))
    restore(photographs, stacks, RestorationParameters(scheme=Scheme(6, 2, 2, 1, 2)))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"colour pair of {megapixels:g} megapixels: peak {peak:.2f} GiB   bound 4 GiB at 4 megapixels")


if __name__ == "__main__":
    main()
