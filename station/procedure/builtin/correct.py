"""Photographs sharpened by the measured PSF field of their lens."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from procedures.raw import read_photograph
from station.common.progress import Progress
from station.procedure.base import Encoding, Inputs, Procedure, RawLayout, read_picture, setting, to_record
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import InputFile, RecordHead, files_read

if TYPE_CHECKING:
    from procedures.correction.estimate import CorrectionParameters
    from procedures.raw import RawFrame
    from station.calibration.correction import Corrected


class CorrectSettings(RawLayout, frozen=True, kw_only=True):
    """The field, and how the photograph is restored."""

    prior: Annotated[Literal["total-variation", "second-order"], setting("Regularization of the picture.")] = (
        "total-variation"
    )
    strength: Annotated[
        float, setting("Of the prior; 1 is what the photograph's noise asks for.", least=0.01, most=100)
    ] = 1.0
    iterations: Annotated[int, setting("Iterations of the solver.", least=1, most=500)] = 12
    field: (
        Annotated[
            Path,
            setting(
                "What `station psf field` wrote: its folder, or field.h5 in it.  [default: the best one of "
                "`station profile find PHOTO`]"
            ),
        ]
        | None
    ) = None
    scale: Annotated[
        int,
        setting("Pixels of the picture per pixel of the sensor, along each side: more than 1 needs several "
                "photographs.", least=1, most=4),
    ] = 1  # fmt: skip
    tile_px: Annotated[Literal[128, 192, 256, 384, 512] | None, setting("[default: as the field varies]")] = None
    encoding: Encoding = None
    f_number: Annotated[float, setting("Of a lens that the camera does not know.", least=0.1)] | None = None
    pixel_pitch_um: Annotated[float, setting("Of the sensor, if the file lacks it.", least=0.1)] | None = None
    insist: Annotated[bool, setting("Take a field whatever camera, lens, aperture and focus it is of.")] = False

    def read(self, path: Path) -> RawFrame:
        """All planes of a photograph, or of a developed picture. Raises ProcedureError."""
        from procedures.raw import read_frame

        return read_picture(path, self.encoding, lambda one: read_frame(one, layout=self.layout))

    @property
    def parameters(self) -> CorrectionParameters:
        from procedures.correction.deconvolve import Splitting
        from procedures.correction.estimate import CorrectionParameters
        from procedures.correction.priors import Prior

        return CorrectionParameters(
            prior=Prior(self.prior, strength=self.strength), side=self.tile_px, scale=self.scale,
            splitting=Splitting(self.iterations),
        )  # fmt: skip


class Correct(Procedure[CorrectSettings]):
    """One picture from one photograph, or from several of one scene."""

    name = "correct"
    title = "correction by the lens's PSF field"
    help = """Sharpen PHOTO by the PSF field of its lens: RAW with a 2 x 2 mosaic, linear grey, or developed.

    Demosaicking, deblurring and lateral colour are undone as one problem, as strongly as the photograph's noise allows.
    JPEG, HEIC, WebP, PNG and TIFF in colour are decoded to light, and the result is doubtful. Several photographs of
    one scene, moved by some pixels, become one picture, with --scale 2 of twice as many pixels."""
    inputs = Inputs.SEVERAL
    Settings = CorrectSettings
    results_key = "result"
    drawn_by = "correction_page:correction_page"
    method = "joint demosaicking and deconvolution through the measured PSF field, regularized"

    def steps(self, paths: Sequence[Path]) -> int:
        return 100

    def files(self, paths: Sequence[Path], settings: CorrectSettings) -> list[Path]:
        return [_field(paths, settings)]

    def measured(self, paths: Sequence[Path], settings: CorrectSettings, progress: Progress) -> Measurement:
        from station.calibration.correction import (
            TypedAperture,
            correct_photographs,
            correction_entries,
            correction_files,
            correction_numbers,
        )

        field = _field(paths, settings)
        frames = [settings.read(path) for path in paths]
        results = correct_photographs(
            frames, field, settings.parameters, _by_hundredths(progress), insisted=settings.insist,
            typed=TypedAperture(settings.f_number, settings.pixel_pitch_um) if settings.f_number else None,
        )  # fmt: skip
        given = {
            **to_record(settings),
            "field": str(settings.field or field),
            "tile_px": str(settings.tile_px or "auto"),
        }
        given = {name: one for name, one in given.items() if (name, one) not in _USUAL}
        value = results.outcome.value
        through = InputFile(str(field), hashlib.sha256(read_photograph(field)).hexdigest())
        head = RecordHead(self.name, (*files_read((results.frame, *results.others)), through), given)
        plane = PlaneResult.of_outcome(
            "picture", results.outcome, values={} if value is None else correction_numbers(value), pitch=0
        )
        return Measurement(
            self.schema, head, (plane,), entries=correction_entries(results), results_key=self.results_key,
            files=correction_files(results), exposure=results.frame.exposure,
            result=results,
        )  # fmt: skip

    def lines(self, measurement: Measurement) -> list[str]:
        whole: Corrected = measurement.result
        places = () if whole.outcome.value is None else whole.outcome.value.places
        return [
            f"{frame.path.name} is set aside: {place.reason}; {place.remedy}"
            for frame, place in zip(whole.others, places, strict=bool(places))
            if place.reason
        ]


_USUAL = (("scale", 1), ("insist", False), ("encoding", None), ("f_number", None), ("pixel_pitch_um", None))


def _field(paths: Sequence[Path], settings: CorrectSettings) -> Path:
    """The field's file: the one that was given, else that of the library for the first photograph."""
    from station.calibration.exports.psf import field_path
    from station.calibration.profiles import profile_for

    if settings.field is not None:
        return field_path(settings.field)
    return profile_for(settings.read(paths[0]).exposure)


def _by_hundredths(progress: Progress) -> Callable[[int, int], None]:
    """Hundredths of the work, from the number of tiles done and of all."""
    last = 0

    def advance(done: int, of: int) -> None:
        nonlocal last
        if (now := 100 * done // of) > last:
            progress(f"{done} of {of} tiles", now - last)
            last = now

    return advance
