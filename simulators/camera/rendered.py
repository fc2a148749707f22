"""A rendered image as photographed by the camera: blurred by its optics, sampled by its sensor, written as a DNG."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import fft

from drivers.frame_files.dng import Shot, write_dng
from simulators.camera.optics import Optics
from simulators.camera.sensor import Mosaic, Sensor

Array = npt.NDArray[np.float64]

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Response of a sensor without a mosaic to red, green and blue (ITU-R BT.709)."""


def photograph_render(
    picture: npt.NDArray[np.floating],
    optics: Optics,
    sensor: Sensor,
    rng: np.random.Generator,
    path: Path | None = None,
    *,
    white_e: float = 25e3,
    shot: Shot | None = None,
) -> Mosaic:
    """Digital numbers of a render, (sensor.rows, sensor.columns); a DNG of them where `path` is given.

    Parameters
    ----------
    picture : (n rows, n columns, 3)
        Linear light, 1 = white, each value the mean over its cell; n cells per sensor pixel along each axis. The
        optics act on what these cells resolve: with n = 1 what lies beyond half a cycle per pixel has aliased already.
    white_e : float
        Electrons that white gives in green, or without a mosaic.

    Raises
    ------
    ValueError
        If the picture is not a whole multiple of the sensor's size.
    """
    n = picture.shape[0] // sensor.rows
    if picture.shape != (n * sensor.rows, n * sensor.columns, 3) or n == 0:
        size = f"{sensor.rows} x {sensor.columns}"
        raise ValueError(f"a sensor of {size} needs a picture some times as large; got {picture.shape}")
    light = np.empty((sensor.rows, sensor.columns))
    period = 1 if sensor.cfa is None else 2
    for colour in set(sensor.tile.values()):
        samples = blur_and_sample(_channel(picture, colour), optics, colour, n)
        for x, y in (place for place, one in sensor.tile.items() if one == colour):
            light[y::period, x::period] = samples[y::period, x::period]
    mosaic = sensor.expose(light, white_e, rng)
    if path is not None:
        write_dng(path, mosaic, shot or Shot(), cfa=sensor.cfa, black=sensor.black, white=sensor.white)
    return mosaic


def blur_and_sample(channel: Array, optics: Optics, colour: str, n: int) -> Array:
    """Light on the pixels: the optics' transfer function over that of the cells, taken at the pixels' centres."""
    margin = n * optics.margin_px()
    wide = np.pad(channel, margin, mode="symmetric")
    fy, fx = fft.fftfreq(wide.shape[0])[:, None], fft.rfftfreq(wide.shape[1])[None, :]
    transfer = optics.otf(n * fx, n * fy, colour) / (np.sinc(fx) * np.sinc(fy))
    centre = np.exp(1j * np.pi * (n - 1) * fx) * np.exp(1j * np.pi * (n - 1) * fy)  # of n cells, from the first's
    blurred: Array = fft.irfft2(fft.rfft2(wide) * transfer * centre, s=wide.shape)
    return np.maximum(blurred[margin : margin + channel.shape[0] : n, margin : margin + channel.shape[1] : n], 0.0)


def _channel(picture: npt.NDArray[np.floating], colour: str) -> Array:
    if colour == "Y":
        return np.asarray(picture @ np.array(LUMINANCE), np.float64)
    return np.asarray(picture[..., "RGB".index(colour)], np.float64)
