"""Real photographs with which nothing was chosen: a chimney through turbulent air, and shake recorded and played back.

    python -m tests.benchmarks.restoration_real chimney FOLDER [--frames 20]
    python -m tests.benchmarks.restoration_real shake FOLDER

`chimney`: Hirsch, Sra, Schölkopf, Harmeling (CVPR 2010), `y_0001.png` to `y_0100.png` of 237 x 237 pixels, of which the
first are restored, and `groundtruth.png`, a photograph through still air. Rivals: the registered mean, and from it
scikit-image's Richardson-Lucy and Wiener filters with the Gaussian PSF, iterations and balance of the least error.
`shake`: Köhler, Hirsch, Mohler, Schölkopf, Harmeling (ECCV 2012), `Blurry1_1.png`, ...: two disjoint pairs of each
scene are restored, in their middle of 256 x 256 pixels; half of the mean square difference of both pictures is the
error of one, as far as the pairs do not share it. Rival: the difference of the pairs' most alike photographs.
"""

import argparse
import time
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from skimage.restoration import richardson_lucy, wiener

from procedures.outcome import Outcome, with_refusal
from procedures.restoration.joint.result import Restoration
from procedures.restoration.photograph_blur import BlurSpec, UnknownMotion, blur_of
from tests.benchmarks.restoration_burst import registered_mean
from tests.benchmarks.restoration_measured_shake import INNER, _whole_shift, error
from tests.benchmarks.restoration_shaken import Shaken

Array = np.ndarray
SIDE, PAIRS = 256, ((1, 3), (2, 5))


def restored(frames: list[Array]) -> tuple[Outcome[Restoration], float]:
    """The flat scene of frames (H, W) with unknown motion, and the time, seconds of processor."""
    z, start = [one[None] for one in frames], time.process_time()
    outcome = with_refusal(lambda: blur_of(BlurSpec(UnknownMotion("whole")), z).restored(z))()
    return outcome, time.process_time() - start


def rms(truth: Array, picture: Array) -> float:
    """Root mean square error after the shift and the light that suit best."""
    return float(np.sqrt(np.mean(error(Shaken([], [], [], truth), picture)[0] ** 2)))


def gaussian(sigma: float) -> Array:
    """A PSF."""
    line = cv2.getGaussianKernel(15, sigma)
    return line @ line.T


def chimney(folder: Path, count: int) -> None:
    """Print the PSNR of each picture."""
    frames = [cv2.imread(str(folder / f"y_{n:04d}.png"), 0) for n in range(1, count + 1)]
    truth = cv2.imread(str(folder / "groundtruth.png"), 0) / 255
    mean = registered_mean(frames)
    outcome, seconds = restored([one / 255 for one in frames])
    rivals = {
        f"first frame, and mean of {count}": [frames[0] / 255, mean],
        "Richardson-Lucy": [
            richardson_lucy(mean, gaussian(s), n) for s, n in product((1, 1.5, 2, 2.5), (5, 10, 20, 40))
        ],
        "Wiener": [
            wiener(mean, gaussian(s), b, clip=False) for s, b in product((1, 1.5, 2, 2.5), (1e-3, 1e-2, 0.1, 1))
        ],
    }
    for name, pictures in rivals.items():
        print(f"{name}: " + ", ".join(f"{-20 * np.log10(rms(truth, one)):.2f}" for one in pictures), "dB", flush=True)
    print(outcome.verdict, outcome.reason, f"{seconds:.0f} s of processor")
    if outcome.value is not None:
        off, stated = rms(truth, outcome.value.sharp[0]), float(np.sqrt(np.mean(outcome.value.sharp_std[INNER] ** 2)))
        print(f"restored {-20 * np.log10(off):.2f} dB, stated/error {stated / off:.2f}")


def middles(photographs: list[Array]) -> list[Array]:
    """The same middle of photographs that are displaced, to whole pixels."""
    moves = [_whole_shift(one, photographs[0]) for one in photographs]
    starts = [[(n - SIDE) // 2 + int(d) for n, d in zip(photographs[0].shape, move, strict=True)] for move in moves]
    return [one[y : y + SIDE, x : x + SIDE] for one, (y, x) in zip(photographs, starts, strict=True)]


def shake(folder: Path) -> None:
    """Print the difference of both restorations of each scene, and what they state."""
    for scene in range(1, 5):
        found, z = [], []
        for pair in PAIRS:
            levels = middles([cv2.imread(str(folder / f"Blurry{scene}_{k}.png"), 0) / 255 for k in pair])
            light = [np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4) for v in levels]
            z.append(light)
            outcome, seconds = restored(light)
            print(f"scene {scene}, shakes {pair}: {outcome.verdict} {outcome.reason}, {seconds:.0f} s", flush=True)
            found += [] if outcome.value is None else [outcome.value]
        before = min(rms(a, b) for a, b in product(*z)) / 2**0.5
        print(f"  photographs differ by {before:.4f} of white over the root of 2")
        if len(found) == 2:
            after = rms(found[0].sharp[0].astype(float), found[1].sharp[0]) / 2**0.5
            stated = np.sqrt(np.mean([np.mean(one.sharp_std[INNER] ** 2) for one in found]))
            print(f"  restored pictures by {after:.4f}, stated {stated:.4f}: {stated / after:.2f}", flush=True)


def main() -> None:
    """Print the figures of a set."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("set", choices=("chimney", "shake"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, default=20)
    given = parser.parse_args()
    chimney(given.folder, given.frames) if given.set == "chimney" else shake(given.folder)


if __name__ == "__main__":
    main()
