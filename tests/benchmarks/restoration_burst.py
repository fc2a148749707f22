"""A burst of frames held by hand, restored by `station restore` as its user would, against their registered mean.

`python -m tests.benchmarks.restoration_burst [--frames 100] [--side 200] [--max-w 5]`. The scene is matplotlib's sample
of Grace Hopper (of the U.S. Navy), at half its size. Each frame lies otherwise (some pixels, some tenths of a degree),
is blurred by the lens and by a shake of its own, and has noise and 8 bits: drawn by splines and the path's points in
Fourier, sharing no code with the restoration. The first frame is the one that is not moved. The mean is that of all
frames registered by OpenCV's ECC, turn and shift, to the first; PSNR after registration to the truth.
"""

import json
import platform
import tempfile
import time
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import affine_transform, gaussian_filter, gaussian_filter1d

from station.__main__ import main as station
from tests.benchmarks import options
from tests.benchmarks.restoration_measured_shake import score
from tests.benchmarks.restoration_shaken import Shaken

Array = NDArray[np.float64]
LENS_PX, SHAKE_PX, NOISE = 0.6, 1.5, 0.01
"""Width of the lens's blur, standard deviation of the shake along a path, both in pixels, and of the noise, white 1."""
MOVED_PX, TURNED_DEG = 2.0, 0.2
STEPS, RIM = 40, 20


def scene(side: int) -> Array:
    """The photograph's face, grey, at half the file's size, with a rim; twice as fine as a pixel."""
    levels = cv2.imread(str(Path(matplotlib.__file__).parent / "mpl-data" / "sample_data" / "grace_hopper.jpg"))
    grey = levels.astype(float) @ [0.114, 0.587, 0.299] / 255
    half, (y, x) = side + 2 * RIM, (230, 256)
    return np.pad(grey, half, mode="reflect")[y : y + 2 * half, x : x + 2 * half]


def frame(fine: Array, rng: np.random.Generator, *, still: bool) -> Array:
    """One frame (side, side) of a scene that is twice as fine."""
    turn = 0.0 if still else np.deg2rad(TURNED_DEG) * rng.standard_normal()
    move = np.zeros(2) if still else MOVED_PX * rng.standard_normal(2)
    path = gaussian_filter1d(rng.standard_normal((2, 4 * STEPS)).cumsum(axis=1), 3, axis=1)[:, STEPS : 2 * STEPS]
    path -= path.mean(axis=1, keepdims=True)
    path *= SHAKE_PX * rng.uniform(0.2, 1.2) / path.std(axis=1).max()
    M = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle = (np.array(fine.shape) - 1) / 2
    seen = gaussian_filter(fine, 2 * LENS_PX)
    seen = affine_transform(seen, M, middle - M @ middle + 2 * move, order=3, mode="reflect")
    fy, fx = np.fft.fftfreq(seen.shape[0])[:, None, None], np.fft.fftfreq(seen.shape[1])[:, None]
    along = np.exp(2j * np.pi * 2 * (fy * path[0] + fx * path[1])).mean(axis=2)
    return np.asarray(np.fft.ifft2(np.fft.fft2(seen) * along).real)


def sensor(light: Array, rng: np.random.Generator) -> Array:
    """Pixels of two by two of what is twice as fine, without the rim, 8 bits."""
    pixels = pixelled(light)
    return np.round(np.clip(pixels + NOISE * rng.standard_normal(pixels.shape), 0, 1) * 255).astype(np.uint8)


def pixelled(fine: Array) -> Array:
    """The mean of two by two, rim left out."""
    return fine.reshape(len(fine) // 2, 2, -1, 2).mean(axis=(1, 3))[RIM:-RIM, RIM:-RIM]


def registered_mean(frames: list[NDArray[np.uint8]]) -> Array:
    """The mean of the frames brought to the first."""
    first, sums = frames[0].astype(np.float32), frames[0].astype(np.float64)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-6)
    for one in frames[1:]:
        to = np.eye(2, 3, dtype=np.float32)
        _, to = cv2.findTransformECC(first, one.astype(np.float32), to, cv2.MOTION_EUCLIDEAN, stop, None, 5)
        flags = cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP
        size = one.shape[::-1]
        sums += cv2.warpAffine(one.astype(np.float64), to, size, flags=flags, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(sums / len(frames) / 255)


def main() -> None:
    """Print both PSNRs, the verdict and the time."""
    asked = options(__doc__, frames=100, side=200, max_w=10.0)
    rng = np.random.default_rng(3)
    fine = scene(asked.side)
    frames = [sensor(frame(fine, rng, still=n == 0), rng) for n in range(asked.frames)]
    case = Shaken([], [], [], pixelled(fine))
    print(f"Python {platform.python_version()}, {platform.machine()}, {asked.frames} frames of {asked.side}; PSNR, dB")
    mean = registered_mean(frames)
    print(f"first frame {score(case, frames[0] / 255):.2f}, mean {score(case, mean):.2f}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        files = [str(Path(folder) / f"frame_{n:03d}.png") for n in range(asked.frames)]
        for name, one in zip(files, frames, strict=True):
            cv2.imwrite(name, one)
        out = Path(folder) / "out"
        order = ["restore", *files, "--blur", "motion", "--prototype-region", "whole", "--max-w", str(asked.max_w)]
        start = time.process_time()
        try:
            station([*order, "--out", str(out)])
        except SystemExit as end:
            print("exit code", end.code)
        seconds = time.process_time() - start
        stated = json.loads((out / "result.json").read_text())
        print(stated["verdict"], stated.get("reason", ""), f"{seconds:.0f} s")
        sharp = cv2.imread(str(out / "sharp.tiff"), cv2.IMREAD_UNCHANGED)
        if sharp is not None:
            print(f"restored {score(case, sharp.astype(float)):.2f}")


if __name__ == "__main__":
    main()
