"""Stated over actual error of pictures restored with known kernels; scenes with which nothing was chosen.

    python -m tests.benchmarks.restoration_known_error [--chosen]

Two photographs of 170 x 170 pixels, kernels of tremor of 13 to 19 pixels, 12 bits. `--chosen`: the pictures and kernels
with which the formula of the error was chosen. Requires scikit-image; the mean and the range are printed last.
"""

import sys

import numpy as np
from scipy.ndimage import shift

from procedures.restoration.joint.estimate import RestorationParameters, restoration_of
from procedures.restoration.joint.kernel_sizes import default_max_w, stacks_of
from tests.benchmarks.restoration_shaken import RIM, Conditions, shaken

HELD_OUT = (("immunohistochemistry", 0.004), ("coins", 0.003), ("clock", 0.006), ("moon", 0.002), ("rocket", 0.003),
            ("coffee", 0.005), ("chelsea", 0.006), ("gravel", 0.002), ("camera", 0.002),
            ("astronaut", 0.005))  # fmt: skip
CHOSEN = (("camera", 0.004), ("coins", 0.004), ("coffee", 0.002), ("astronaut", 0.008), ("grass", 0.004),
          ("moon", 0.003), ("rocket", 0.005), ("brick", 0.004), ("gravel", 0.004), ("chelsea", 0.003),
          ("camera", 0.008), ("grass", 0.002), ("astronaut", 0.003), ("clock", 0.004), ("brick", 0.002))  # fmt: skip


def ratio(name: str, noise: float, sizes: tuple[int, int], seeds: tuple[int, int]) -> float:
    """Stated over actual error of one pair."""
    case = shaken(name, sizes, seeds, Conditions(noise=noise, bits=12), (170, 170))
    first, second = case.half_widths
    masks = stacks_of(case.known, (1.0, second / first), default_max_w(case.known), case.z[0].shape)
    found = restoration_of([one[None] for one in case.z], masks, RestorationParameters(flat_w=first))
    inside = (slice(RIM, -RIM), slice(RIM, -RIM))
    sharp = found.sharp[0].astype(float)
    moved = (shift(sharp, (a / 4, b / 4), order=3, mode="nearest") for a in range(-2, 3) for b in range(-2, 3))
    error = min(float(np.std((one - case.sharp)[inside])) for one in moved)
    stated = float(np.sqrt(np.mean(found.sharp_std[inside] ** 2)))
    print(f"{name:10} noise {noise:.3f}  error {error:.4f}  stated/error {stated / error:.2f}")
    return stated / error


def main() -> None:
    """Print each pair, and the mean."""
    chosen = "--chosen" in sys.argv
    cases, sizes, first = (CHOSEN, (13, 17), 1) if chosen else (HELD_OUT, (17, 15), 901)
    ratios = [ratio(*case, sizes, (first + 10 * n, first + 10 * n + 1)) for n, case in enumerate(cases)]
    print(f"mean {np.mean(ratios):.2f}, {min(ratios):.2f} to {max(ratios):.2f}")


if __name__ == "__main__":
    main()
