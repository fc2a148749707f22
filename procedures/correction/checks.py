"""Checks that a photograph and a field belong together, and that the photograph is unprocessed."""

from collections.abc import Mapping

from procedures.correction.noise import Noise
from procedures.outcome import BadInput, Check, Refused, Verdict
from procedures.psf_field import PsfField
from procedures.raw import Exposure, Plane, unprocessed

NEAR_APERTURE = 0.04
"""Relative difference of f-numbers that is tolerated."""
NEAR_MAGNIFICATION = 0.005
"""Tolerated difference of the image scale, focal length over distance."""
NEAR_FOCAL = 0.02
LEAST_WHITE = 0.35
"""Smallest whiteness of the noise: less where neighbours were mixed, as by demosaicking, denoising and resampling."""
LEAST_RISE, USUAL_RISE = 0.7, 0.9
"""Noise variance of the brightest over that of the darkest levels: 1 or more for linear samples; under a curve of 1/2.4
it falls by a half over two decades of light."""
RESOLVED_NOISE = 0.6
"""Least standard deviation of the noise, in steps of the digital numbers, for its shape to be estimated."""
MOST_CLIPPED = 0.05
MOST_CROPPED = 0.03
"""Fraction of a side by which a developed picture may be smaller than the sensor."""


def check_fields(planes: Mapping[str, Plane], fields: Mapping[str, PsfField], *, developed: bool = False) -> None:
    """Refuse a field of other planes or of another sensor.

    developed : whether the planes may have twice the pixels of a mosaic's field along each side.

    Raises BadInput if a plane has no field, or one of another size, Refused if the photograph has no contrast.
    """
    for name, plane in planes.items():
        if name not in fields:
            raise BadInput(
                f"the photograph has the plane {name}, the field has {', '.join(fields)}",
                "measure the field from photographs of the same kind, with all planes (--plane all)",
            )
        rows, columns = fields[name].shape
        cropped = [1 - n / (2 * m) for n, m in zip(plane.samples.shape, (rows, columns), strict=True)]
        if (rows, columns) != plane.samples.shape and not (
            developed and 0 <= min(cropped) <= max(cropped) <= MOST_CROPPED
        ):
            raise BadInput(
                f"plane {name} of the field has {columns} x {rows} pixels, the photograph's has "
                f"{plane.samples.shape[1]} x {plane.samples.shape[0]}",
                "give a whole photograph of the field's camera, neither cropped nor turned from the sensor's rows",
            )
    if all(plane.samples.min() == plane.samples.max() for plane in planes.values()):
        reason = "the photograph has no contrast: all samples are equal"
        raise Refused(reason, "photograph a scene, neither all black nor all white")


def check_scale(planes: Mapping[str, Plane], fields: Mapping[str, PsfField], scale: int) -> None:
    """Refuse a picture finer than the field's PSFs.

    Raises BadInput if the picture would have more samples per pixel of a plane than the PSFs.
    """
    for name, plane in planes.items():
        if scale * plane.pitch > fields[name].s:
            raise BadInput(
                f"a picture {scale} times as fine as the sensor has {scale * plane.pitch} samples per pixel of plane "
                f"{name}; the field's PSFs have {fields[name].s}",
                f"{'lower --scale, or ' if scale > 1 else ''}measure the field with -s {scale * plane.pitch}",
            )


def check_exposure(photograph: Exposure, field: Exposure | None) -> list[str]:
    """Refuse a field of another camera, lens, aperture or focus; return what could not be compared.

    Raises Refused if a known value differs.

    field : exposure data of the field's measurement; None if its file has none
    """
    if field is None:
        return ["the field does not name its camera"]
    unknown = []
    for words, ours, theirs in (("camera", photograph.camera, field.camera), ("lens", photograph.lens, field.lens)):
        if not ours or not theirs:
            unknown.append(words)
        elif ours != theirs:
            raise Refused(f"the field is of the {words} {theirs}, the photograph of {ours}", _OTHER)
    unknown += _check_number(photograph.f_number, field.f_number, "f/", "aperture", NEAR_APERTURE)
    unknown += _check_number(photograph.focal_length_mm, field.focal_length_mm, "", "focal length", NEAR_FOCAL)
    return unknown + _check_focus(photograph, field)


_OTHER = "measure a field with the photograph's settings, or give the one measured with them"


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
            f"the field was focused at {theirs / 1000:.2f} m, the photograph at {ours / 1000:.2f} m: the lens's PSF "
            f"changes where the image scale differs by more than {NEAR_MAGNIFICATION:g}",
            _OTHER,
        )
    return []


def checks_of(planes: Mapping[str, Plane], noise: Mapping[str, Noise], *, developed: bool = False) -> list[Check]:
    """Checks for linear, unprocessed samples; each has the worst plane's number. A developed picture is processed."""
    noises = [
        one for name, one in noise.items()
        if one.variance_at(planes[name].samples[::16, ::16]).mean() ** 0.5 > RESOLVED_NOISE * planes[name].quantisation
    ]  # fmt: skip
    whiteness = min((estimate.whiteness for estimate in noises), default=1.0)
    rise = min((estimate.rise for estimate in noises), default=1.0)
    clipped = max(float((plane.samples >= 0.998).mean()) for plane in planes.values())
    raw = all(plane.raw for plane in planes.values())
    linear = unprocessed(raw, "give the RAW file, or export it without a tone curve")
    clipping = Check(
        "clipping", clipped, MOST_CLIPPED, Verdict.DOUBTFUL, f"{clipped:.0%} of the samples are clipped", "expose less"
    )
    if developed:
        return [clipping]
    return [
        Check("noise correlation", whiteness, LEAST_WHITE, Verdict.REFUSED,
              f"the photograph was processed: its noise at the finest scale is {whiteness:.0%} of a sensor's, at "
              f"least {LEAST_WHITE:.0%} are needed",
              unprocessed(raw, "give the RAW file, or its plane exported without denoising, demosaicking or change of "
                          "size"), least=True),
        Check("linearity", rise, LEAST_RISE, Verdict.REFUSED,
              f"the photograph is not linear in light: the noise variance of its bright parts is {rise:.2f} times that "
              "of its dark parts, and must be at least 1", linear, least=True),
        Check("linearity", rise, USUAL_RISE, Verdict.DOUBTFUL,
              f"the noise does not grow with light, its variance is {rise:.2f} times as large in bright parts: the "
              "photograph may have a tone curve", linear, least=True),
        clipping,
    ]  # fmt: skip
