"""A restoration's picture with another aperture and another plane of focus."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import cv2
import numpy as np

from procedures.field.field_file import read_field
from procedures.numerics.arrays import Array
from procedures.outcome import BadInput, BadParameter, Outcome
from procedures.psf_field import SpaceVariantBlur
from procedures.reading.arrays import parse_npy
from procedures.restoration.masks.blur_models import GAUSSIAN, named, read_shape, spread_of
from procedures.restoration.masks.thin_lens import CameraSetting
from procedures.restoration.metres import BEHIND
from procedures.restoration.refocus import refocus
from station.common.durable_files import sha256_of
from station.common.progress import Progress
from station.common.sanitise import printable
from station.drawing.pictures import described_tiff, display_png, encoded, float_tiff
from station.procedure.base import Inputs, Procedure, Settings, plane_result, setting, to_record
from station.results.measurement import Measurement
from station.results.reader import read_record
from station.results.record_head import InputFile, RecordHead

if TYPE_CHECKING:
    from station.reports.page import Scripted

DESCRIPTION = "refocused picture, linear, 1 = white, first row uppermost; calibration-station"
FILES = ("result.json", "sharp.tiff", "w.npy")
METRES = "restore the photographs with --metres front or --metres behind"


class RefocusSettings(Settings, frozen=True, kw_only=True):
    """The new aperture and focus."""

    f_number: Annotated[float, setting("Of the new picture.", least=0.1)]
    focus_m: Annotated[float, setting("Distance of its plane of focus from the lens.", least=0.001)]
    shape: Annotated[
        str, setting("Shape of the blur: pillbox, gaussian[:K] of sigma K r, polygon:BLADES[:DEGREES], or a file.")
    ] = "pillbox"
    field: Annotated[Path, setting("PSFs of the lens, field.h5: the picture is also blurred by them.")] | None = None

    @property
    def aperture(self) -> Array:
        """The sampled shape. Raises ProcedureError."""
        shape = named(self.shape)
        return read_shape(Path(self.shape)) if shape is None else shape

    def check(self) -> None:
        """Raise ProcedureError if the shape is unknown."""
        _ = self.aperture


class Refocus(Procedure[RefocusSettings]):
    """Depth of focus changed after a restoration."""

    name = "refocus"
    title = "picture with another aperture and focus"
    help = """Change the depth of focus of RESTORED, a result of station restore with --metres.

    The restored picture is seen through another aperture, focused at another distance."""
    inputs = Inputs.FOLDER
    Settings = RefocusSettings
    argument = "RESTORED"
    suffixes = frozenset(("result.json",))
    method = "mean of the views from the points of the aperture, by Gaussian optics"

    def measured(self, paths: Sequence[Path], settings: RefocusSettings, progress: Progress) -> Measurement:
        """The refocused picture and the limits of its depth of field."""
        folder = paths[0].parent if paths[0].is_file() else paths[0]
        sharp, metres, taken = _restored(folder)
        focus_mm, spread = 1000 * settings.focus_m, spread_of(settings.shape)
        new = CameraSetting(taken.focal_length_mm, settings.f_number, focus_mm, taken.pitch_um, spread)
        result = refocus(sharp, metres, new, settings.aperture)
        picture = result.picture if settings.field is None else _through(settings.field, result.picture)
        progress("refocused")
        image = _image(picture)
        inputs = tuple(InputFile(str(folder / name), sha256_of(folder / name)) for name in FILES)
        planes = (plane_result("picture", Outcome(result)),)
        files = {"refocused.tiff": described_tiff(float_tiff(image), DESCRIPTION), "refocused.png": display_png(image)}
        head = RecordHead(self.name, inputs, to_record(settings))
        return Measurement(self.schema, head, planes, files=files, result=(sharp, metres, result))

    def page(self, measurement: Measurement) -> bytes:
        """The restored and the refocused picture, and where it is sharp."""
        # imported here: it draws, which is slow to load
        from station.drawing.plots import BAR_RIGHT, Figure, finished, frame_axes, picture
        from station.reports.page import Figures, Section, image
        from station.reports.report_page import report_page

        sharp, metres, result = measurement.result
        shown = [("restored", sharp), ("refocused", result.picture)]
        pictures = [Figure(image(display_png(_image(one)), words), words) for words, one in shown]
        axes = frame_axes(4, result.radius_px.shape)
        picture(axes, result.radius_px, colours="RdBu_r", bar=BAR_RIGHT)
        blur = finished(axes, "blur", "signed radius of the blur circle in pixels, positive in front of the focus")
        sections = [Section("Pictures", [Figures(pictures, wide=True)]), Section("Blur", [Figures([blur])])]
        sections.insert(1, Section("Other apertures", [_explorer(sharp, metres, result.setting)]))
        return report_page(self.report(measurement), closing=sections).encode()


EXPLORED_PX = 320
"""Greatest side of the picture in which the page's reader changes aperture, focus and bokeh."""
CONTROLS = """<div class="refocus" data-lens="{}" hidden><p>
<label>Aperture <input type="range" name="aperture" min="0" max="10" step="0.25" value="{}"></label>
<label>Focus, far to near <input type="range" name="focus" min="0" max="1" step="0.005" value="{}"></label>
<label>Bokeh <select name="bokeh"><option value="circle">circle</option><option value="polygon:5">5 blades</option>
<option value="polygon:6">6 blades</option><option value="polygon:7">7 blades</option>
<option value="gaussian">Gaussian</option></select></label></p>
<canvas></canvas><p><output></output></p><div hidden>{}{}</div></div>"""


def _explorer(sharp: Array, metres: Array, setting: CameraSetting) -> "Scripted":
    """Controls of aperture, focus and bokeh over a small picture, which a script refocuses."""
    from station.reports.page import Scripted, html, image  # imported here: templates are slow to load

    factor = min(1.0, EXPLORED_PX / max(metres.shape))
    size = tuple(max(1, round(factor * n)) for n in metres.shape[::-1])
    small = np.asarray(cv2.resize(_image(sharp), size, interpolation=cv2.INTER_AREA), np.float64)
    inverse = cv2.resize(1 / metres, size, interpolation=cv2.INTER_NEAREST)
    least, most = float(inverse.min()), max(float(inverse.max()), float(inverse.min()) + 1e-6)
    code = np.rint((inverse - least) / (most - least) * 65535).astype(np.uint16)
    coded = np.dstack([np.zeros_like(code), code % 256, code // 256]).astype(np.uint8)
    lens = {
        "focal_length_mm": setting.focal_length_mm,
        "pitch_um": setting.pitch_um * metres.shape[1] / size[0],
        "gaussian": spread_of(GAUSSIAN),
        "least": least,
        "most": most,
    }
    stop, focus = 2 * np.log2(setting.f_number), (1000 / setting.focus_mm - least) / (most - least)
    pictures = image(display_png(small), "restored"), image(encoded(".png", coded), "inverse distances")
    return Scripted(
        html(CONTROLS, json.dumps(lens), round(4 * stop) / 4, float(np.clip(focus, 0, 1)), *pictures), "refocus.js"
    )


def _image(picture: Array) -> Array:
    """A picture (C, H, W) as (H, W), or (H, W, 3)."""
    return picture[0] if len(picture) == 1 else np.moveaxis(picture, 0, -1)


def _through(path: Path, picture: Array) -> Array:
    """The picture blurred by the field of the lens, its planes in order or its only one."""
    field = read_field(path)
    planes = list(field.values())
    if len(planes) not in (1, len(picture)):
        raise BadParameter(
            f"the field must have one plane or {len(picture)}; {printable(path)} has {', '.join(field)}",
            "measure the field of these planes",
        )
    if any(plane.shape != picture.shape[1:] for plane in planes):
        rows, columns = picture.shape[1:]
        raise BadParameter(
            f"the field must be of frames of {columns} x {rows} pixels; {printable(path)} is of "
            f"{planes[0].shape[1]} x {planes[0].shape[0]}",
            "measure the field with the camera of the restored photographs",
        )
    blurs = [SpaceVariantBlur(planes[n % len(planes)]) for n in range(len(picture))]
    inside = np.ones(picture.shape[1:])  # beyond the frame there is no light: the share that is inside counts
    return np.stack([blur.blur(one) / blur.blur(inside) for blur, one in zip(blurs, picture, strict=True)])


def _restored(folder: Path) -> tuple[Array, Array, CameraSetting]:
    """Picture (C, H, W), distances (H, W) in metres, and the first photograph's setting. Raises BadInput."""
    record = read_record(folder)
    given: Any = record.get("parameters", {})
    if record.get("procedure") != "restore" or given.get("metres") is None:
        raise BadInput(f"{printable(folder)} must be a restoration with distances in metres", METRES)
    try:
        taken = CameraSetting(
            given["focal_length_mm"], given["f_number"][0], 1000 * given["focus_m"][0], given["pixel_pitch_um"],
            spread_of((given.get("shape") or ("pillbox",))[0]),
        )  # fmt: skip
        data = np.frombuffer((folder / "sharp.tiff").read_bytes(), np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        w = parse_npy((folder / "w.npy").read_bytes(), str(folder / "w.npy"), METRES).astype(np.float64)
    except (OSError, KeyError, TypeError, IndexError, cv2.error) as error:
        raise BadInput(
            f"{printable(folder)} is no whole restoration: {error}", "restore the photographs again"
        ) from error
    if image is None or image.shape[:2] != w.shape:
        raise BadInput(f"{printable(folder)}: sharp.tiff and w.npy must have one size", "restore the photographs again")
    colours = image[None] if image.ndim == 2 else np.moveaxis(image[..., ::-1], -1, 0)
    radius = w * (-1 if given["metres"] == BEHIND else 1)
    return colours.astype(np.float64), taken.distance_mm(radius) / 1000, taken
