"""A DNG's opcodes from a calibration, by which RAW converters correct distortion and vignetting."""

from collections.abc import Mapping

import numpy as np

from procedures.geometry.conversion import as_radial
from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter
from procedures.reading.dng_opcodes import GainMap, Opcode, fix_vignette_radial, warp_rectilinear, with_opcodes
from procedures.vignetting.surface import even_powers
from station.calibration.exports import Export
from station.calibration.exports.lensfun import PLACES, pitch_of
from station.calibration.stored_cameras import StoredCamera
from station.calibration.vignetting import StoredVignetting

VIGNETTE_TERMS = 5


def export_dng(
    data: bytes, name: str, stored: StoredCamera | None, vignetting: StoredVignetting | None, size: tuple[int, int],
    shading: Mapping[str, tuple[StoredVignetting, tuple[int, int]]] | None = None,
) -> Export:  # fmt: skip
    """A copy of a DNG with the opcodes of a camera and of its vignetting.

    size : (columns, rows) of the photograph in the file; shading : instead of `vignetting`: a gain map for each plane
    of the mosaic. Raises BadParameter if there is nothing to write, or the photograph differs in size from the camera;
    BadInput if the file is no DNG.
    """
    corrections = [vignette_opcode(vignetting, *size)] if vignetting is not None else []
    corrections += [warp_opcode(stored, size)] if stored is not None else []
    maps = [gain_map(one, origin, size) for one, origin in (shading or {}).values()]
    if not (corrections or maps):
        raise BadParameter("a DNG requires a geometry, a vignetting or both; got neither", "name one of their results")
    opcodes, gains = [one for one, _ in corrections], [one.opcode() for one, _ in maps]
    lost = (*(words for _, words in corrections), *(words for _, words in maps))
    return Export(with_opcodes(data, opcodes, name, gains), lost)


def warp_opcode(stored: StoredCamera, size: tuple[int, int]) -> tuple[Opcode, str]:
    """WarpRectilinear of a camera, the same for all planes, and its error."""
    camera = stored.camera
    if (camera.columns, camera.rows) != size:
        raise BadParameter(
            f"the photograph has {size[0]} x {size[1]} pixels, the camera's frame {camera.columns} x {camera.rows}",
            "give a photograph of the calibrated camera, not cropped",
        )
    radial = as_radial(camera, stored.region, "even", min(size) / 2, decentring=True)
    unit = farthest(radial.centre, size)
    k = radial.coefficients * (unit / radial.unit_px) ** (2 * np.arange(1, 4))
    p1, p2 = radial.tangential * unit / radial.unit_px
    opcode = warp_rectilinear([(1.0, *k, p1, p2)], over_frame(radial.centre, size))
    lost = radial.difference
    return opcode, f"WarpRectilinear: {lost.rms_px:.4f} pixel rms, {lost.max_px:.4f} at most, are lost"


def vignette_opcode(stored: StoredVignetting, columns: int, rows: int) -> tuple[Opcode, str]:
    """FixVignetteRadial of the light of green, and its error."""
    light, size = stored.light, (columns, rows)
    pitch = pitch_of(light.shape, columns, rows)
    x, y = np.meshgrid(np.linspace(0, light.shape[1] - 1, PLACES), np.linspace(0, light.shape[0] - 1, PLACES))
    places = np.column_stack([x.ravel(), y.ravel()])
    centre = pitch * np.clip(stored.centre, 0, [light.shape[1] - 1, light.shape[0] - 1])
    r = np.linalg.norm(pitch * places - centre, axis=1) / farthest(centre, size)
    fit = even_powers(r, 1 / light.at(places), VIGNETTE_TERMS)
    words = f"FixVignetteRadial: {fit.lost:.2%} of the light rms, {fit.most:.2%} at most, are lost; no colour shading"
    return fix_vignette_radial(list(fit.terms), over_frame(centre, size)), words


def gain_map(stored: StoredVignetting, origin: tuple[int, int], size: tuple[int, int]) -> tuple[GainMap, str]:
    """Reciprocal of the light of a plane, 1 at the frame's centre, and the error of interpolation."""
    pitch = pitch_of(stored.light.shape, *size)

    def gain(columns: Array, rows: Array) -> Array:
        x, y = np.meshgrid(columns, rows)
        sensor = np.column_stack([x.ravel(), y.ravel()]) * size - 0.5
        return np.asarray(1 / stored.light.at((sensor - origin) / pitch)).reshape(x.shape)

    at = np.linspace(0, 1, PLACES)
    gains = gain(at, at)
    between = (at[1:] + at[:-1]) / 2
    straight = (gains[1:, 1:] + gains[1:, :-1] + gains[:-1, 1:] + gains[:-1, :-1]) / 4
    most = float(np.abs(straight / gain(between, between) - 1).max())
    return GainMap(size, origin, pitch, gains.astype(np.float32)), f"GainMap of {stored.plane}: {most:.3%} at most"


def farthest(centre: tuple[float, float] | Array, size: tuple[int, int]) -> float:
    """Distance from a point (x, y) to the farthest corner of the frame, between pixel centres."""
    x, y = centre
    return float(np.hypot(max(x, size[0] - 1 - x), max(y, size[1] - 1 - y)))


def over_frame(centre: tuple[float, float] | Array, size: tuple[int, int]) -> tuple[float, float]:
    """A point (x, y) in fractions of the frame."""
    return float(centre[0] / (size[0] - 1)), float(centre[1] / (size[1] - 1))
