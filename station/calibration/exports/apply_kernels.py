"""Sharpen a picture by the inverse filters in this file. Python and NumPy are sufficient.

python THIS IN OUT [--srgb]     files: .npy (rows, columns, colours), .ppm or .pgm of 8 or 16 bit; --srgb: encoded by
the curve of sRGB, otherwise linear in light.
"""

import base64
import io
import re
import sys

import numpy as np

SOURCE = ""
FILTERS = ""


def corrected(picture: np.ndarray, kernels: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The picture (rows, columns, colours), linear in light, convolved with filters (i, j, colours, K, K).

    Filters are those at the nodes (y[i], x[j]); between them results are interpolated bilinearly.
    """
    half, out = kernels.shape[-1] // 2, np.empty_like(picture)
    padded = np.pad(picture, ((half, half), (half, half), (0, 0)), mode="edge")
    rows, columns = picture.shape[:2]
    for i in range(len(y) - 1):
        top, below = y[i], rows if i == len(y) - 2 else y[i + 1]
        down = ((np.arange(top, below) - y[i]) / (y[i + 1] - y[i]))[:, None]
        for j in range(len(x) - 1):
            left, right = x[j], columns if j == len(x) - 2 else x[j + 1]
            across = (np.arange(left, right) - x[j]) / (x[j + 1] - x[j])
            for colour in range(picture.shape[2]):
                part = padded[top : below + 2 * half, left : right + 2 * half, colour]
                a, b, c, d = convolved(part, kernels[i : i + 2, j : j + 2, colour].reshape(4, *kernels.shape[-2:]))
                out[top:below, left:right, colour] = (a + (b - a) * across) * (1 - down) + (c + (d - c) * across) * down
    return out


def convolved(part: np.ndarray, kernels: np.ndarray) -> np.ndarray:
    """The convolutions of a part with each filter where the filter lies within it."""
    size, shape = kernels.shape[-1], part.shape
    spectra = np.fft.rfft2(part) * np.fft.rfft2(kernels, shape)
    return np.fft.irfft2(spectra, shape)[:, size - 1 :, size - 1 :]


def read(path: str) -> tuple[np.ndarray, int]:
    """A picture (rows, columns, colours), and its white; 0 for floating-point numbers."""
    if path.endswith(".npy"):
        picture = np.load(path, allow_pickle=False)
        if not (picture.dtype.kind == "f" or (picture.dtype.kind == "u" and picture.dtype.itemsize <= 2)):
            sys.exit(f"numbers must be floating-point or unsigned of 8 or 16 bits; {path} has {picture.dtype}")
        if not np.isfinite(picture).all():
            sys.exit(f"numbers must be finite; {path} has others")
        white = 0 if picture.dtype.kind == "f" else np.iinfo(picture.dtype).max
        return picture.reshape(*picture.shape[:2], -1).astype(float), white
    with open(path, "rb") as file:
        data = file.read()
    head = re.match(rb"P([56])" + 3 * rb"(?:\s|#[^\n]*\n)+(\d+)" + rb"\s", data)
    if head is None:
        sys.exit(f"{path} has no header of P5 or P6")
    columns, rows, white = map(int, head.groups()[1:])
    shape, kind = (rows, columns, 3 if head[1] == b"6" else 1), np.dtype(">u2" if white > 255 else "u1")
    if len(data) < head.end() + np.prod(shape) * kind.itemsize:
        sys.exit(f"{path} is truncated")
    return np.frombuffer(data, kind, np.prod(shape), head.end()).reshape(shape).astype(float), white


def write(path: str, picture: np.ndarray, white: int) -> None:
    """Write a picture with the white of the input."""
    kind = ">u2" if white > 255 else "u1"
    values = picture if white == 0 else np.rint(picture.clip(0, white)).astype(kind)
    if path.endswith(".npy"):
        np.save(path, values)
        return
    rows, columns, colours = values.shape
    with open(path, "wb") as file:
        file.write(b"P%d\n%d %d\n%d\n" % (5 if colours == 1 else 6, columns, rows, white))
        file.write(values.tobytes())


def main(arguments: list[str]) -> None:
    """Read, correct and write."""
    files = [argument for argument in arguments if argument != "--srgb"]
    if len(files) != 2:
        sys.exit(f"{__doc__}\nThe filters are of {SOURCE}.")
    if other := [file for file in files if not file.endswith((".npy", ".ppm", ".pgm"))]:
        sys.exit(f"files must be .npy, .ppm or .pgm; got {', '.join(other)}")
    stored = np.load(io.BytesIO(base64.b64decode(FILTERS)), allow_pickle=False)
    picture, white = read(files[0])
    expected = (*stored["shape"].tolist(), stored["kernels"].shape[2])
    if picture.shape != expected:
        sys.exit(f"a picture of {expected} rows, columns, colours is required; got {picture.shape}")
    if white == 0 and not files[1].endswith(".npy"):
        sys.exit(f"floating-point numbers are written as .npy; got {files[1]}")
    scale = white or 1
    if srgb := "--srgb" in arguments:
        v = picture / scale
        picture = scale * np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    result = corrected(picture, stored["kernels"].astype(float), stored["x"], stored["y"])
    if srgb:
        v = (result / scale).clip(0, 1)
        result = scale * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)
    write(files[1], result, white)


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (OSError, ValueError) as error:
        sys.exit(f"files must be readable and writable pictures; {error}")
