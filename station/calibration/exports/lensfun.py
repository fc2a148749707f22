"""lensfun's database entry of a lens: distortion, lateral colour, vignetting, each with its error.

lensfun's coordinates are relative to the middle of the frame, in units of half the shorter side for distortion and
lateral colour, of half the diagonal for vignetting, between pixel centres 0 and n - 1. The middle may be displaced
(`center`), for all three together. There is no decentring distortion, and no colour shading.
Source: lensfun's documentation, "Lens calibration"; checked against its library.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from procedures.field.maps import LateralColour
from procedures.geometry.conversion import RadialCamera, as_radial
from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter
from procedures.reading.exposure import Exposure
from procedures.vignetting.surface import LightSurface, even_powers
from station.calibration.exports import Export
from station.calibration.exports.geometry import EXACT, best_fit
from station.calibration.stored_cameras import StoredCamera

MODELS = ("poly3", "poly5", "ptlens")
FULL_FRAME_MM = float(np.hypot(36, 24))
DISTANCES_M = (0.25, 1000.0)
"""lensfun interpolates over the focus distance: equal values at both ends apply to all distances."""
COLOURS = {"R": "r", "B": "b"}
DIGITS = 9
PLACES = 41
"""Points along each side at which the light is compared with its formula."""


@dataclass(frozen=True)
class LensNames:
    """Names of the entry, and the photographs to which it applies. pitch_um : of the sensor's pixels."""

    maker: str
    lens: str
    camera: str
    focal_mm: float
    f_number: float
    pitch_um: float


@dataclass(frozen=True)
class GivenNames:
    """The given names; None where an option was omitted."""

    maker: str
    camera: str | None
    lens: str | None
    focal_mm: float | None
    f_number: float | None
    pitch_um: float | None

    def completed(self, exposure: Exposure | None, focal_px: float, *, with_light: bool) -> LensNames:
        """Completed by the exposure of the field's photographs; focal length and pitch follow from each other. Raises
        BadParameter if neither of these two is known, or vignetting has no f-number."""
        known = exposure or Exposure()
        focal = self.focal_mm or known.focal_length_mm
        pitch = self.pitch_um
        if focal is None and pitch is not None:
            focal = focal_px * pitch / 1000
        if focal is None:
            raise BadParameter(
                "lensfun requires the focal length in mm, which was neither given nor is in a field",
                "give --focal-length-mm or --pixel-pitch-um",
            )
        f_number = self.f_number or known.f_number
        if f_number is None and with_light:
            raise BadParameter("lensfun requires the f-number of the vignetting; none was given", "give --f-number")
        return LensNames(
            self.maker, self.lens or known.lens or "lens", self.camera or known.camera or "camera", focal,
            f_number or 0.0, pitch or 1000 * focal / focal_px,
        )  # fmt: skip


def export_lensfun(
    stored: StoredCamera,
    names: LensNames,
    colours: Mapping[str, LateralColour] | None = None,
    vignetting: LightSurface | None = None,
) -> Export:
    """The entry of a calibrated camera. Raises BadParameter if a field or vignetting is of another frame.

    colours : of R and B; vignetting : of one plane, best green.
    """
    camera = stored.camera
    radial = best_radial(stored)
    top = ElementTree.Element("lensdatabase", version="1")
    mount = f"{names.camera} mount"
    ElementTree.SubElement(ElementTree.SubElement(top, "mount"), "name").text = mount
    crop = FULL_FRAME_MM / (np.hypot(camera.columns, camera.rows) * names.pitch_um / 1000)
    aspect = (max(camera.columns, camera.rows) - 1) / (min(camera.columns, camera.rows) - 1)  # lensfun's own
    _entry(top, "camera", names.maker, names.camera, mount, crop)
    lens = _entry(top, "lens", names.maker, names.lens, mount, crop)
    ElementTree.SubElement(lens, "aspect-ratio").text = f"{aspect:.9f}"
    middle = np.array([camera.columns - 1, camera.rows - 1]) / 2
    offset = (np.array(radial.centre) - middle) / unit_px(camera.columns, camera.rows)
    ElementTree.SubElement(lens, "center", x=_text(offset[0]), y=_text(offset[1]))
    calibration = ElementTree.SubElement(lens, "calibration")
    focal = _text(names.focal_mm)
    terms = ("a", "b", "c") if radial.formula == "ptlens" else ("k1", "k2")
    numbers = {name: _text(k) for name, k in zip(terms, radial.coefficients, strict=False)}
    ElementTree.SubElement(calibration, "distortion", {"model": radial.formula, "focal": focal, **numbers})
    rms_px, max_px = radial.difference.rms_px, radial.difference.max_px
    words = f"distortion as {radial.formula}: {rms_px:.4f} pixel rms, {max_px:.4f} at most, are lost"
    lost = [words] if max_px >= EXACT else []
    if colours:
        terms_tca, lines = lateral_terms(colours, np.array(radial.centre), camera.columns, camera.rows)
        ElementTree.SubElement(calibration, "tca", {"model": "poly3", "focal": focal, **terms_tca})
        lost += lines
    if vignetting is not None:
        lost += _add_vignetting(calibration, vignetting, np.array(radial.centre), camera.columns, camera.rows, names)
    ElementTree.indent(top, "    ")
    return Export(ElementTree.tostring(top) + b"\n", tuple(lost))


def unit_px(columns: int, rows: int) -> float:
    """lensfun's unit of length, in pixels: half of the shorter side, between pixel centres."""
    return (min(columns, rows) - 1) / 2


def best_radial(stored: StoredCamera) -> RadialCamera:
    """lensfun's most accurate model, the simplest of exact ones."""
    unit = unit_px(stored.camera.columns, stored.camera.rows)
    return best_fit(as_radial(stored.camera, stored.region, model, unit) for model in MODELS)


def lateral_terms(
    colours: Mapping[str, LateralColour], centre: Array, columns: int, rows: int
) -> tuple[dict[str, str], list[str]]:
    """tca's poly3 of red and blue: r (v + c r + b r^2), and its residual in sensor pixels. Raises BadParameter if the
    field is of another frame."""
    terms: dict[str, str] = {}
    lost, unit = [], unit_px(columns, rows)
    for plane, letter in COLOURS.items():
        colour = colours.get(plane)
        if colour is None:
            raise BadParameter(
                f"lensfun requires lateral colour of red and blue; the field has none of {plane}",
                "make the field of all planes, or leave --field out",
            )
        pitch = pitch_of(colour.shape, columns, rows)
        places = colour.positions
        shift, covariance = colour.at(places)
        u = (pitch * places - centre) / unit
        r = np.linalg.norm(u, axis=1)
        # shift along u is u (dv + c r + b r^2), in units
        design = (u[:, :, None] * np.stack([np.ones_like(r), r, r**2], axis=1)[:, None, :]).reshape(-1, 3)
        weight = np.repeat(1 / np.sqrt(np.maximum(np.trace(covariance, axis1=1, axis2=2), 1e-12)), 2)
        values = (shift / unit).ravel()
        v, c, b = np.linalg.lstsq(design * weight[:, None], values * weight, rcond=None)[0]
        terms |= {f"v{letter}": _text(1 + v), f"c{letter}": _text(c), f"b{letter}": _text(b)}
        residual = (values - design @ [v, c, b]).reshape(-1, 2) * unit
        rms, most = float(np.sqrt(np.mean(np.sum(residual**2, axis=1)))), float(np.linalg.norm(residual, axis=1).max())
        lost.append(f"lateral colour of {plane}: {rms:.4f} pixel rms, {most:.4f} at most, are lost")
    return terms, lost


def pitch_of(shape: tuple[int, int], columns: int, rows: int) -> int:
    """Sensor pixels per pixel of a plane of that shape. Raises BadParameter for another frame. The origin of the plane,
    at most a pixel, is negligible for variations over the whole frame."""
    pitch = max(round(columns / shape[1]), 1)
    if (shape[0] * pitch, shape[1] * pitch) != (rows, columns):
        raise BadParameter(
            f"planes must fit the camera's frame, {columns} x {rows}; got {shape[1]} x {shape[0]}",
            "give results of one camera",
        )
    return pitch


def _add_vignetting(
    calibration: ElementTree.Element, light: LightSurface, centre: Array, columns: int, rows: int, names: LensNames
) -> list[str]:
    pitch = pitch_of(light.shape, columns, rows)
    x, y = np.meshgrid(np.linspace(0, light.shape[1] - 1, PLACES), np.linspace(0, light.shape[0] - 1, PLACES))
    places = np.column_stack([x.ravel(), y.ravel()])
    r = np.linalg.norm(pitch * places - centre, axis=1) / (np.hypot(columns - 1, rows - 1) / 2)
    fit = even_powers(r, light.at(places), 3)
    terms = {f"k{i}": _text(term) for i, term in enumerate(fit.terms, 1)}
    for distance in DISTANCES_M:
        about = {"focal": _text(names.focal_mm), "aperture": _text(names.f_number), "distance": _text(distance)}
        ElementTree.SubElement(calibration, "vignetting", {"model": "pa", **about, **terms})
    return [f"vignetting: {fit.lost:.2%} of the light rms, {fit.most:.2%} at most, are lost"]


def _entry(top: ElementTree.Element, kind: str, maker: str, model: str, mount: str, crop: float) -> ElementTree.Element:
    entry = ElementTree.SubElement(top, kind)
    for name, text in (("maker", maker), ("model", model), ("mount", mount), ("cropfactor", f"{crop:.9f}")):
        ElementTree.SubElement(entry, name).text = text
    return entry


def _text(value: float) -> str:
    return f"{value:.{DIGITS}g}"
