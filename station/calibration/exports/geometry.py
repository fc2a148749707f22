"""A calibrated camera as files that other programs read: OpenCV, ROS, Kalibr, COLMAP, mrcal."""

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np

from procedures.geometry.cameras import COLMAP_CENTRE, MODELS, STEREOGRAPHIC, split_model
from procedures.geometry.conversion import Difference, OpenCvCamera, RadialCamera, as_kalibr, as_model, as_opencv
from procedures.numerics.arrays import Array
from procedures.reading.guard import decoding
from station.calibration.exports import Export
from station.calibration.exports.mrcal import cameramodel
from station.calibration.stored_cameras import GIVE, StoredCamera

Fit = TypeVar("Fit", OpenCvCamera, RadialCamera)
Text = tuple[str, Difference | None]
"""A file's text, and the error of its conversion."""

EXACT = 1e-6
"""Error in pixels below which a conversion is exact."""


def export_camera(stored: StoredCamera, form: str) -> Export:
    """The camera in a format. Raises BadInput for an invalid camera."""
    with decoding(stored.source, "a camera that can be written", GIVE):  # the record may contain numbers of any size
        text, lost = CAMERA_FORMATS[form](stored)
    if lost is None or lost.max_px < EXACT:
        return Export(text.encode())
    words = f"{form} does not represent this camera exactly: {lost.rms_px:.4f} pixel rms, {lost.max_px:.4f} at most"
    return Export(text.encode(), (words,))


def _opencv(stored: StoredCamera) -> Text:
    camera = _by_opencv(stored, (4, 5, 8, 12))
    (fx, fy), (cx, cy) = camera.focal_px, camera.centre
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    lines = [
        "%YAML:1.0",
        "---",
        f"image_width: {stored.camera.columns}",
        f"image_height: {stored.camera.rows}",
        *_matrix("camera_matrix", K),
        *_matrix("distortion_coefficients", camera.distortion[None]),
    ]
    return "\n".join(lines) + "\n", camera.difference


def _matrix(name: str, values: Array) -> list[str]:
    rows, columns = values.shape
    return [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d",
            f"   data: {_list(values.ravel())}"]  # fmt: skip


def _ros(stored: StoredCamera) -> Text:
    camera = _by_opencv(stored, (5, 8))
    (fx, fy), (cx, cy) = camera.focal_px, camera.centre
    model = "plumb_bob" if len(camera.distortion) == 5 else "rational_polynomial"
    lines = [
        f"image_width: {stored.camera.columns}",
        f"image_height: {stored.camera.rows}",
        "camera_name: camera",
        *_ros_matrix("camera_matrix", 3, 3, [fx, 0, cx, 0, fy, cy, 0, 0, 1]),
        f"distortion_model: {model}",
        *_ros_matrix("distortion_coefficients", 1, len(camera.distortion), camera.distortion.tolist()),
        *_ros_matrix("rectification_matrix", 3, 3, [1, 0, 0, 0, 1, 0, 0, 0, 1]),
        *_ros_matrix("projection_matrix", 3, 4, [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]),
    ]
    return "\n".join(lines) + "\n", camera.difference


def _ros_matrix(name: str, rows: int, columns: int, data: Sequence[float]) -> list[str]:
    return [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: {_list(data)}"]


def _kalibr(stored: StoredCamera) -> Text:
    """Kalibr's camera chain, by the most accurate of its camera and distortion models."""
    camera = as_kalibr(stored.camera, stored.region)
    lines = [
        "cam0:",
        f"  camera_model: {camera.model[0]}",
        f"  intrinsics: {_list(camera.intrinsics)}",
        f"  distortion_model: {camera.model[1]}",
        f"  distortion_coeffs: {_list(camera.coefficients)}",
        f"  resolution: [{stored.camera.columns}, {stored.camera.rows}]",
        "  rostopic: /cam0/image_raw",
    ]
    return "\n".join(lines) + "\n", camera.difference


def _colmap(stored: StoredCamera) -> Text:
    """COLMAP's cameras.txt, with pixel centres at 0.5; others are converted to COLMAP's most accurate model."""
    camera, lost = stored.camera, None
    if any(split_model(camera.model)[1]) or camera.model == STEREOGRAPHIC:
        fits = [as_model(camera, stored.region, model) for model in MODELS]
        camera, lost = min(fits, key=lambda one: one[1].rms_px)
    centre = np.array([name in ("cx", "cy") for name in camera.names])
    numbers = " ".join(repr(float(value)) for value in camera.params + COLMAP_CENTRE * centre)
    lines = [
        "# Camera list with one line of data per camera:",
        "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",
        "# Number of cameras: 1",
        f"1 {camera.model} {camera.columns} {camera.rows} {numbers}",
    ]
    return "\n".join(lines) + "\n", lost


def _mrcal(stored: StoredCamera) -> Text:
    """mrcal's .cameramodel, with the part of the frame covered by charts as its valid region."""
    camera = _by_opencv(stored, (4, 5, 8, 12))
    return cameramodel(stored, camera), camera.difference


def _by_opencv(stored: StoredCamera, counts: Sequence[int]) -> OpenCvCamera:
    """The camera by OpenCV's formula: the fewest coefficients that are exact, else the most accurate ones."""
    return best_fit(as_opencv(stored.camera, stored.region, count) for count in counts)


def best_fit(fits: Iterable[Fit]) -> Fit:
    """The first exact conversion, else the most accurate one."""
    tried = []
    for fit in fits:
        if fit.difference.max_px < EXACT:
            return fit
        tried.append(fit)
    return min(tried, key=lambda fit: fit.difference.rms_px)


def _list(values: Sequence[float] | Array) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


CAMERA_FORMATS: dict[str, Callable[[StoredCamera], Text]] = {
    "opencv": _opencv,
    "ros": _ros,
    "kalibr": _kalibr,
    "colmap": _colmap,
    "mrcal": _mrcal,
}
