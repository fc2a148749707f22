"""Developed pictures: the error of what is made of them, what is not known of them, and the result in their format."""

import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.correction.noise import noise_of
from procedures.developed import LOSSY, RAW, pillow
from procedures.outcome import Outcome, mark_doubtful
from procedures.raw import RawFrame
from procedures.reading.development import LINEAR, Development
from procedures.reading.tiff_tags import ICC_PROFILE
from procedures.restoration.joint.result import Restoration
from station.calibration.camera_metadata import metadata_of
from station.calibration.picture_files import write_tiff
from station.drawing.pictures import encoded

QUALITY = 97
"""Quality of JPEG, WebP and HEIC files that are written: their loss is below that of the files that are read."""
SUFFIXES = {"JPEG": ".jpg", "WEBP": ".webp", "HEIF": ".heic", "PNG": ".png", "TIFF": ".tiff", RAW: ".tiff"}
MOST_GROWTH, LEAST_GROWTH = 1.2, -0.3
"""Exponents of the noise variance's growth with light between which a tone curve is plausible: 0 to 1 of a sensor, with
0.3 by the scatter of 84 simulated planes; linear samples decoded as sRGB have 0.6 to 1.9, the reverse -2.5 to -0.1."""


def judged(outcome: Outcome[Restoration], frames: Sequence[RawFrame]) -> Outcome[Restoration]:
    """The outcome with the error of rounding and coding, doubtful where the development is not known."""
    developments = [frame.development for frame in frames if frame.development]
    if not developments or outcome.value is None:
        return outcome
    light = np.clip(outcome.value.sharp.mean(axis=0), 0, 1)
    error = np.max([development.light_error(light) for development in developments], axis=0)
    gain = max(1.0, outcome.value.diagnostics.noise_gain)
    outcome = replace(outcome, value=outcome.value.with_added_error("development", gain * error))
    if curve := wrong_curve(frames):
        outcome = mark_doubtful(outcome, *curve)
    unknown = unknown_of(developments)
    return mark_doubtful(outcome, *unknown) if unknown else outcome


def unknown_of(developments: Sequence[Development]) -> tuple[str, str] | None:
    """Unknown parts of the pictures' development, with the remedy; None where all of it is stated."""
    if any(development.format == RAW for development in developments):
        return "the photographs have no 2 x 2 mosaic: they were demosaicked, which is part of their blur", _BAYER
    lossy = any(development.coding for development in developments)
    if not lossy and not any(development.assumed for development in developments):
        return None
    curves = " and ".join(dict.fromkeys(_words(development) for development in developments))
    kinds = " and ".join(dict.fromkeys(development.format for development in developments))
    reason = f"{kinds} pictures were developed by a camera or a program: {curves}; sharpening and noise reduction stay"
    remedy = "give RAW files" if lossy else "give RAW files, or state --encoding"
    return reason, remedy


_BAYER = "use a camera with a Bayer mosaic, and its RAW files as it wrote them"


def _words(development: Development) -> str:
    if development.assumed:
        return "their tone curve is assumed to be sRGB's"
    return f"their tone curve is that of {development.curve.name}"


def wrong_curve(frames: Sequence[RawFrame]) -> tuple[str, str] | None:
    """Doubtful where the noise contradicts the tone curve; block coding replaces the noise by its own."""
    lossless = [one for one in frames if one.development and not one.development.coding]
    growths = [noise_of(plane).growth for frame in lossless for plane in frame.planes.values()]
    if not growths:
        return None
    growth, name = float(np.median(growths)), lossless[0].development and lossless[0].development.curve.name
    if growth > MOST_GROWTH and name != LINEAR:
        reason = f"the samples seem to be linear, not {name}: their noise grows as light to the {growth:.1f}"
        return reason, "give --encoding linear"
    if growth < LEAST_GROWTH and name == LINEAR:
        reason = f"the samples seem to have a tone curve: noise falls with light, to the power {growth:.1f}"
        return reason, "give --encoding srgb"
    return None


def picture_file(
    frame: RawFrame, picture: npt.NDArray[np.floating] | None, *, words: str
) -> dict[str, Callable[[Path], None]]:
    """The picture (C, H, W) in the format of a developed photograph by its name, generated when it is written; nothing
    without a picture or for other photographs. `words` describe it in a TIFF."""
    development = frame.development
    if development is None or picture is None:
        return {}
    levels, name = development.curve.encoded(picture), f"picture{SUFFIXES[development.format]}"
    words = f"{words}; tone curve: {development.curve.name}"
    if development.format in ("TIFF", RAW):
        metadata = metadata_of(frame)
        profile = {ICC_PROFILE: (7, len(development.icc), development.icc)} if development.icc else {}
        metadata = replace(metadata, picture={**metadata.picture, **profile})
        return {name: lambda path: write_tiff(path, levels, metadata, words)}
    encode = _png_16 if development.bits == 16 else _picture_8
    return {name: lambda path: _write(path, encode(development, levels))}


def _write(path: Path, data: bytes) -> None:
    path.write_bytes(data)


def _png_16(development: Development, levels: npt.NDArray[np.float32]) -> bytes:
    """A PNG of 16 bits with profile and metadata, which OpenCV does not write."""
    png = encoded(".png", np.rint(np.moveaxis(levels, 0, -1)[..., ::-1] * 65535).astype(np.uint16))
    chunks = {b"iCCP": b"ICC\0\0" + zlib.compress(development.icc)} if development.icc else {}
    chunks |= {b"eXIf": development.exif.removeprefix(b"Exif\0\0")} if development.exif else {}
    framed = (
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks.items()
    )
    return png[:HEAD] + b"".join(framed) + png[HEAD:]


HEAD = 33
"""Bytes of a PNG's signature and IHDR."""


def _picture_8(development: Development, levels: npt.NDArray[np.float32]) -> bytes:
    Image = pillow(heif=development.format == "HEIF")
    samples = np.rint(np.moveaxis(levels, 0, -1) * 255).astype(np.uint8)
    options: dict[str, Any] = {"quality": QUALITY} if development.format in LOSSY else {}
    options |= {"subsampling": 0} if development.format == "JPEG" else {}
    options |= {"icc_profile": development.icc} if development.icc else {}
    options |= {"exif": development.exif} if development.exif else {}
    image, file = Image.fromarray(samples[..., 0] if samples.shape[2] == 1 else samples), BytesIO()
    image.save(file, development.format, **options)
    return file.getvalue()
