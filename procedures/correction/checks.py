"""Whether a photograph and a field belong together, and whether the photograph is still light as the sensor gave it."""

from __future__ import annotations

from collections.abc import Mapping

from procedures.correction.noise import Noise
from procedures.outcome import BadInput, Check, Refused, Verdict
from procedures.psf_field import PsfField
from procedures.raw import Exposure, Plane, unprocessed

NEAR_APERTURE = 0.04
"""Difference of f-numbers that is none."""
NEAR_MAGNIFICATION = 0.005
"""Difference of the scale of the image, focal length over distance, within which a lens draws alike."""
NEAR_FOCAL = 0.02
LEAST_WHITE = 0.35
"""Of the noise's whiteness: less where neighbours were mixed, as demosaicking, denoising and change of size do."""
LEAST_RISE, USUAL_RISE = 0.7, 0.9
"""Noise variance of the brightest over that of the darkest; of light itself it is 1 and more, under a curve of 1/2.4 it
falls by a half over two decades of light."""
SEEN_NOISE = 0.6
"""Steps of the digital numbers that noise must have before its shape tells anything."""
MOST_CLIPPED = 0.05


def check_fields(planes: Mapping[str, Plane], fields: Mapping[str, PsfField]) -> None:
    """Refuse a field of other planes or of another sensor.

    Raises
    ------
    BadInput
        If a plane has no field, or one of another size.
    Refused
        If the photograph shows nothing.
    """
    for name, plane in planes.items():
        if name not in fields:
            raise BadInput(
                f"the photograph has the plane {name}, the field has {', '.join(fields)}",
                "measure the field from photographs of the same kind, with all planes (--plane all)",
            )
        if tuple(fields[name].shape) != plane.samples.shape:
            rows, columns = fields[name].shape
            raise BadInput(
                f"plane {name} of the field has {columns} x {rows} pixels, the photograph's has "
                f"{plane.samples.shape[1]} x {plane.samples.shape[0]}",
                "give a whole photograph of the camera that the field was measured with",
            )
    if all(plane.samples.min() == plane.samples.max() for plane in planes.values()):
        reason = "the photograph shows nothing: its samples are all alike"
        raise Refused(reason, "photograph a scene, neither all black nor all white")


def check_scale(planes: Mapping[str, Plane], fields: Mapping[str, PsfField], scale: int) -> None:
    """Refuse a picture finer than the field's PSFs.

    Raises
    ------
    BadInput
        If the picture would have more samples per pixel of a plane than the PSFs.
    """
    for name, plane in planes.items():
        if scale * plane.pitch > fields[name].s:
            raise BadInput(
                f"a picture {scale} times as fine as the sensor has {scale * plane.pitch} samples per pixel of plane "
                f"{name}, the field's PSFs have {fields[name].s}",
                f"{'lower --scale, or ' if scale > 1 else ''}measure the field with -s {scale * plane.pitch}",
            )


def check_exposure(photograph: Exposure, field: Exposure | None) -> list[str]:
    """Refuse a field of another camera, lens, aperture or focus; what cannot be told is returned, a phrase for each.

    Parameters
    ----------
    field : what the camera noted when the field was measured; None where its file does not tell

    Raises
    ------
    Refused
        If both tell, and differ.
    """
    if field is None:
        return ["the field does not tell its camera"]
    unknown = []
    for words, ours, theirs in (("camera", photograph.camera, field.camera), ("lens", photograph.lens, field.lens)):
        if not ours or not theirs:
            unknown.append(words)
        elif ours != theirs:
            raise Refused(f"the field is of the {words} {theirs}, the photograph of {ours}", _OTHER)
    unknown += _check_number(photograph.f_number, field.f_number, "f/", "aperture", NEAR_APERTURE)
    unknown += _check_number(photograph.focal_length_mm, field.focal_length_mm, "", "focal length", NEAR_FOCAL)
    return unknown + _check_focus(photograph, field)


_OTHER = "measure a field with the photograph's settings, or give the one that was"


def _check_number(ours: float | None, theirs: float | None, sign: str, words: str, near: float) -> list[str]:
    if not ours or not theirs:
        return [words]
    if abs(ours / theirs - 1) > near:
        raise Refused(f"the field's {words} is {sign}{theirs:g}, the photograph's {sign}{ours:g}", _OTHER)
    return []


def _check_focus(photograph: Exposure, field: Exposure) -> list[str]:
    ours, theirs = photograph.subject_distance_mm, field.subject_distance_mm
    focal = photograph.focal_length_mm or field.focal_length_mm
    if not ours or not theirs or not focal:
        return ["focus distance"]
    if abs(focal / ours - focal / theirs) > NEAR_MAGNIFICATION:
        raise Refused(
            f"the field was focused at {theirs / 1000:.2f} m, the photograph at {ours / 1000:.2f} m: the lens draws "
            f"otherwise where the image's scale differs by more than {NEAR_MAGNIFICATION:g}",
            _OTHER,
        )
    return []


def checks_of(planes: Mapping[str, Plane], noise: Mapping[str, Noise]) -> list[Check]:
    """Whether the samples look like light on a sensor; each check has the worst plane's number."""
    told = [one for name, one in noise.items() if _shows(planes[name], one)]
    whiteness = min((one.whiteness for one in told), default=1.0)
    rise = min((one.rise for one in told), default=1.0)
    clipped = max(float((plane.samples >= 0.998).mean()) for plane in planes.values())
    raw = all(plane.raw for plane in planes.values())
    linear = unprocessed(raw, "give the RAW file, or export it without a tone curve")
    return [
        Check("noise correlation", whiteness, LEAST_WHITE, Verdict.REFUSED,
              f"the photograph was processed: its noise has {whiteness:.0%} of a sensor's at the finest scale, at "
              f"least {LEAST_WHITE:.0%} are needed",
              unprocessed(raw, "give the RAW file, or its plane exported without denoising, demosaicking or change of "
                          "size"), least=True),
        Check("linearity", rise, LEAST_RISE, Verdict.REFUSED,
              f"the photograph is not linear in light: its noise variance where it is bright is {rise:.2f} times that "
              "where it is dark, light has 1 or more", linear, least=True),
        Check("linearity", rise, USUAL_RISE, Verdict.DOUBTFUL,
              f"the noise does not grow with light, its variance is {rise:.2f} times as much where it is bright: the "
              "photograph may have a tone curve", linear, least=True),
        Check("clipping", clipped, MOST_CLIPPED, Verdict.DOUBTFUL,
              f"{clipped:.0%} of the samples are clipped: their light is not known", "expose less"),
    ]  # fmt: skip


def _shows(plane: Plane, noise: Noise) -> bool:
    """Whether the noise is more than the rounding of the numbers."""
    usual = float(noise.variance_at(plane.samples[::16, ::16]).mean())
    return bool(usual**0.5 > SEEN_NOISE * plane.quantisation)
