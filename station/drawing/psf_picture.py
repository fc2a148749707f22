"""Levels of a PSF in false colours, with axes in pixels and a colour bar."""

from __future__ import annotations

import numpy as np

from procedures.psf import Psf
from station.drawing.pictures import Levels, encoded, false_colours

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
    """Ticks at whole pixels along the bottom and the left."""
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
    """The colour bar, its ends and its zero."""
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
