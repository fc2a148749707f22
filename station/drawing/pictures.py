"""Pictures as files: colour planes as image channels, 8-bit levels, false colours, PNG in sRGB, float32 TIFF."""

import struct
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.psf import Psf

Array = npt.NDArray[np.floating[Any]]
Levels = npt.NDArray[np.uint8]
IMAGE_DESCRIPTION, ASCII = 270, 2


def picture(sharp: Array) -> Array:
    """Planes (C, H, W) as OpenCV's image: (H, W), or (H, W, 3) as blue, green, red of RAW planes."""
    if len(sharp) == 1:
        return np.asarray(sharp[0])
    red, blue = sharp[0], sharp[-1]
    return np.stack([blue, sharp[1:-1].mean(axis=0), red], axis=-1)


def levels(image: Array, black: float, white: float) -> Levels:
    """8-bit levels of an image between two values."""
    return np.asarray(np.clip((image - black) / max(white - black, 1e-12) * 255 + 0.5, 0, 255), dtype=np.uint8)


def smaller(image: Array, side: int) -> Array:
    """An image reduced to a largest side in pixels, unchanged if it is not larger."""
    import cv2

    if max(image.shape[:2]) <= side:
        return image
    factor = side / max(image.shape[:2])
    return np.asarray(cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA))


def false_colours(image: Levels) -> Levels:
    """8-bit levels in false colours."""
    import cv2

    return np.asarray(cv2.applyColorMap(image, cv2.COLORMAP_VIRIDIS), dtype=np.uint8)


def encoded(kind: str, image: npt.NDArray[Any]) -> bytes:
    """The bytes of an image file; colours in OpenCV's order, blue first."""
    import cv2

    done, data = cv2.imencode(kind, image)
    if not done:
        raise RuntimeError(f"OpenCV could not encode {kind}")
    return data.tobytes()


def float_tiff(image: Array) -> bytes:
    """A float32 TIFF of linear (rows, columns) or (rows, columns, 3), 1 = white."""
    return encoded(".tiff", _blue_first(image.astype(np.float32)))


def display_png(image: Array) -> bytes:
    """A PNG of a linear image for a screen: clipped to [0, 1], with the transfer curve of sRGB (IEC 61966-2-1)."""
    light = np.clip(image.astype(np.float64), 0.0, 1.0)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return encoded(".png", _blue_first(np.rint(255 * curve).astype(np.uint8)))


def _blue_first(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.ascontiguousarray(image[..., ::-1] if image.ndim == 3 else image)


def described_tiff(tiff: bytes, description: str) -> bytes:
    """A little-endian TIFF with an ImageDescription, its directory repeated at the end (TIFF 6.0, sections 2, 8)."""
    if tiff[:4] != b"II*\0":
        raise ValueError("a little-endian TIFF is required; got another file")
    (at,) = struct.unpack_from("<I", tiff, 4)
    (count,) = struct.unpack_from("<H", tiff, at)
    entries = [tiff[at + 2 + 12 * i : at + 14 + 12 * i] for i in range(count)]
    text = description.encode("ascii", "replace") + b"\0"
    tiff += b"\0" * (len(tiff) % 2)
    entries.append(struct.pack("<HHII", IMAGE_DESCRIPTION, ASCII, len(text), len(tiff)))
    body = tiff + text + b"\0" * (len(text) % 2)
    entries.sort(key=lambda entry: struct.unpack_from("<H", entry)[0])
    directory = struct.pack("<H", len(entries)) + b"".join(entries) + bytes(4)
    return body[:4] + struct.pack("<I", len(body)) + body[8:] + directory


_SIDE = 480  # side of the PSF in picture pixels; at least one per sample
_LEFT, _TOP, _BOTTOM, _RIGHT = 64, 40, 56, 130
_INK = (60, 60, 60)


def psf_picture(psf: Psf, title: str) -> bytes:
    """A PNG of the PSF: a square per sample, axes in pixels of the plane, a colour bar, a cross at the centre."""
    import cv2

    zoom = max(1, _SIDE // psf.k)
    side = zoom * psf.k
    low, high = min(0.0, float(psf.h.min())), float(psf.h.max())
    scaled = np.clip((psf.h - low) / max(high - low, 1e-300) * 255, 0, 255).astype(np.uint8)
    square = cv2.resize(false_colours(scaled), (side, side), interpolation=cv2.INTER_NEAREST)
    picture = np.full((_TOP + side + _BOTTOM, _LEFT + side + _RIGHT, 3), 255, dtype=np.uint8)
    picture[_TOP : _TOP + side, _LEFT : _LEFT + side] = square
    _write(picture, title, (_LEFT, 26), 0.6)
    _draw_axes(picture, psf, zoom)
    _draw_bar(picture, side, low, high)
    cv2.drawMarker(picture, (_LEFT + side // 2, _TOP + side // 2), (255, 255, 255), cv2.MARKER_CROSS, 12, 1)
    return encoded(".png", picture)


def _draw_axes(picture: Levels, psf: Psf, zoom: int) -> None:
    import cv2

    side = zoom * psf.k
    reach = int(psf.offsets_px[-1])
    step = max(1, -(-reach // 4))
    for pixel in range(-(reach // step) * step, reach + 1, step):
        at = round((psf.k / 2 + pixel * psf.s) * zoom)
        cv2.line(picture, (_LEFT + at, _TOP + side), (_LEFT + at, _TOP + side + 6), _INK, 1)
        cv2.line(picture, (_LEFT - 6, _TOP + at), (_LEFT, _TOP + at), _INK, 1)
        _write(picture, f"{pixel:d}", (_LEFT + at - 6 - 4 * (pixel < 0), _TOP + side + 22), 0.45)
        _write(picture, f"{pixel:3d}", (_LEFT - 40, _TOP + at + 5), 0.45)
    _write(picture, f"pixels of the plane; {psf.s} samples each", (_LEFT, _TOP + side + 44), 0.45)


def _draw_bar(picture: Levels, side: int, low: float, high: float) -> None:
    import cv2

    left = picture.shape[1] - _RIGHT + 20
    ramp = np.linspace(255, 0, side).astype(np.uint8)[:, None].repeat(16, axis=1)
    picture[_TOP : _TOP + side, left : left + 16] = false_colours(ramp)
    for value in (low, high) if low > -0.05 * high else (low, 0.0, high):
        at = _TOP + round((high - value) / max(high - low, 1e-300) * (side - 1))
        cv2.line(picture, (left + 16, at), (left + 20, at), _INK, 1)
        _write(picture, f"{value:.3g}", (left + 24, at + 5), 0.45)


def _write(picture: Levels, text: str, at: tuple[int, int], size: float) -> None:
    import cv2

    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, _INK, 1, cv2.LINE_AA)
