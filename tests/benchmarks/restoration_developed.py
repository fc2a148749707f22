"""Shaken photographs as JPEG and PNG files: how well `station restore` restores them, and its stated error.

    python -m tests.benchmarks.restoration_developed PICTURE ... [--seeds 2]

Each PICTURE (any sharp 8-bit picture in colour; those of scikit-image were used) is decoded to light, blurred by two
random motions of 4.5 pixels each way by SciPy's convolution, and gets the noise of photons. It is encoded as sRGB of 16
and 8 bits and as JPEG by Pillow. The kernels are unknown to the program.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter1d
from scipy.signal import fftconvolve

SIDE, EDGE, REACH = 240, 10, 9
QUALITIES = {97: 0, 92: 0, 80: 2}
"""Quality of the JPEG files, and how their colours are subsampled (2: by two each way)."""


def decoded(levels):
    return np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)


def encoded(light):
    light = np.clip(light, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def motion(rng):
    path = np.cumsum(gaussian_filter1d(rng.standard_normal((600, 2)), 40, axis=0), axis=0)
    path -= path.mean(axis=0)
    path *= 4.5 / np.abs(path).max()
    kernel = np.zeros((2 * REACH + 1,) * 2)
    for point in path + REACH:
        (y, x), (v, u) = np.floor(point).astype(int), point % 1
        kernel[y : y + 2, x : x + 2] += np.outer((1 - v, v), (1 - u, u))
    return kernel / kernel.sum()


def write(stem, light):
    levels = encoded(light[EDGE:-EDGE, EDGE:-EDGE])
    cv2.imwrite(f"{stem}.16.png", np.rint(65535 * levels).astype(np.uint16)[..., ::-1])
    image = Image.fromarray(np.rint(255 * levels).astype(np.uint8))
    image.save(f"{stem}.8.png")
    for quality, subsampling in QUALITIES.items():
        image.save(f"{stem}.{quality}.jpg", quality=quality, subsampling=subsampling)


def photographs(picture, seed, folder):
    light = 0.95 * decoded(np.asarray(Image.open(picture).convert("RGB")) / 255)
    size = SIDE + 2 * EDGE
    y, x = ((n - size) // 2 for n in light.shape[:2])
    light, rng = light[y : y + size, x : x + size], np.random.default_rng(seed)
    write(folder / "truth", light)
    for name in "ab":
        kernel = motion(rng)
        blurred = np.stack([fftconvolve(light[..., c], kernel, mode="same") for c in range(3)], axis=-1)
        noise = np.sqrt(0.002**2 + 0.004**2 * np.clip(blurred, 0, 1)) * rng.standard_normal(blurred.shape)
        write(folder / name, blurred + noise)


def restored(folder, suffix):
    out = folder / f"out.{suffix}"
    files = [folder / f"{name}.{suffix}" for name in "ab"]
    words = ["--blur", "motion", "--prototype-region", "whole", "--reference", folder / "truth.16.png", "--out", out]
    done = subprocess.run(
        [sys.executable, "-m", "station", "restore", *files, *words], capture_output=True, check=False
    )
    if not (out / "result.json").exists():
        return done.stderr.decode()[-200:]
    record = json.loads((out / "result.json").read_text())
    truth = record.get("ground_truth")
    if truth is None:
        return f"refused: {record['result']['reason']}"
    ratio = truth["error"] / truth["stated_error"]
    best = max(truth["before_db"])
    return f"{best:5.1f} -> {truth['psnr_db']:5.1f} dB, error over stated {ratio:.2f}, {record['result']['verdict']}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pictures", nargs="+", type=Path)
    parser.add_argument("--seeds", type=int, default=1)
    given = parser.parse_args()
    for picture in given.pictures:
        for seed in range(given.seeds):
            with tempfile.TemporaryDirectory() as name:
                photographs(picture, seed, Path(name))
                for suffix in ("16.png", "8.png", *(f"{quality}.jpg" for quality in QUALITIES)):
                    print(f"{picture.stem} {seed} {suffix:7} {restored(Path(name), suffix)}", flush=True)


if __name__ == "__main__":
    main()
