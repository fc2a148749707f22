"""One sharp picture from whatever photographs there are: the way is chosen, stated with its reasons, and taken."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec.structs import replace as replace_settings

from procedures.outcome import ProcedureError
from station.calibration.exports.psf import field_path
from station.calibration.profiles import profile_for
from station.calibration.sharpening import DEFOCUS, FIELD, FINER, WAYS, choose
from station.common.models import TableSource, read_model
from station.common.progress import Progress
from station.procedure.base import Inputs, PictureSettings, Procedure, setting, to_record
from station.procedure.schema import procedure_named
from station.results.measurement import Measurement

SCENES = {"flat": "whole", "deep": "auto"}
"""Scenes, and the part of each in which unknown motions are estimated; the first costs a quarter of the second."""


class SharpenSettings(PictureSettings, frozen=True, kw_only=True):
    """Knowledge besides the photographs, and decisions that are not left to the program."""

    field: Annotated[Path, setting(
        "What `station psf field` wrote of the lens: its folder, or field.h5 in it.  [default: of one photograph, "
        "the best one of `station profile find`]")] | None = None  # fmt: skip
    way: Annotated[
        Literal["field", "finer", "defocus", "shaken"] | None, setting("How they are sharpened.  [default: chosen]")
    ] = None
    scene: Annotated[
        Literal["flat", "deep"] | None,
        setting("Shaken photographs: whether all of the scene is at one distance.  [default: flat, then deep]"),
    ] = None
    ratio: Annotated[
        tuple[float, ...],
        setting("f-number of photograph 1 over that of photograph 2 (3, ...).  [default: as recorded]"),
    ] = ()
    max_w: Annotated[
        float | None, setting("Largest half-width of blur, pixels of photograph 1.  [default: as station restore]")
    ] = None
    scheme: Annotated[str | None, setting("Rounds of the descent.  [default: as station restore]")] = None


class Sharpen(Procedure[SharpenSettings]):
    """The way of sharpening chosen by the photographs."""

    name = "sharpen"
    title = "one sharp picture from the photographs that there are"
    help = """Sharpen FILES: one photograph with the PSF field of its lens, several that are moved, two or more that are
    shaken, two or more apertures.

    The choice is reported with its reasons; --way, --scene and --ratio override it. It runs `station correct` or
    `station restore`, whose record and page are the result."""
    inputs = Inputs.SEVERAL
    Settings = SharpenSettings
    argument = "FILES..."
    method = "as the record states"

    def steps(self, paths: Sequence[Path]) -> int:
        return 100

    def files(self, paths: Sequence[Path], settings: SharpenSettings) -> list[Path]:
        return [field_path(settings.field)] if settings.field else []

    def measured(self, paths: Sequence[Path], settings: SharpenSettings, progress: Progress) -> Measurement:
        """The record of the procedure that was chosen, with the decision."""
        frames = [settings.read(path) for path in paths]
        if len(frames) == 1 and settings.field is None:
            with suppress(ProcedureError):
                settings = replace_settings(settings, field=profile_for(frames[0].exposure))
        way: str
        why: tuple[str, ...]
        more: Mapping[str, Any] = {}
        if settings.way in (FIELD, FINER) and settings.field is not None:
            way, why = settings.way, (f"--way {settings.way} was given",)
        else:
            way, why, more = choose(
                frames, field_given=settings.field is not None, ratio=settings.ratio, way=settings.way
            )
        reasons = (WAYS[way], *why)
        for words in reasons:
            progress(words, 0)
        if way in (FIELD, FINER):
            options: dict[str, Any] = {
                "field": str(settings.field),
                "raw": settings.raw,
                "encoding": settings.encoding,
                "scale": 2 if way == FINER else 1,
            }
            return _taken("correct", options, reasons, paths, progress)
        options = {name: getattr(settings, name) for name in ("plane", "raw", "encoding", "max_w", "scheme")}
        if way == DEFOCUS:
            options |= {"blur": "defocus", "shape": ["pillbox"], **more}
            return _taken("restore", options, reasons, paths, progress)
        tried = []
        for scene, region in SCENES.items():
            if settings.scene in (None, scene):
                chosen = f"the scene is taken as {scene}" + ("" if settings.scene else "; --scene states it")
                progress(chosen, 0)
                motion = {"blur": "motion", "prototype_region": region}
                tried.append(_taken("restore", {**options, **motion}, (*reasons, chosen), paths, progress))
                if _rank(tried[-1]) == 0:
                    break
        return min(tried, key=_rank)

    def page(self, measurement: Measurement) -> bytes:
        return procedure_named(measurement.head.procedure).page(measurement)

    def lines(self, measurement: Measurement) -> list[str]:
        reasons = measurement.entries["choice_of_procedure"]["reasons"]
        return [*reasons, *procedure_named(measurement.head.procedure).lines(measurement)]


def _taken(
    name: str, options: Mapping[str, Any], reasons: Sequence[str], paths: Sequence[Path], progress: Progress,
) -> Measurement:  # fmt: skip
    """The measurement by a procedure, with its settings and the reasons for it in the record."""
    procedure = procedure_named(name)
    given = {key: value for key, value in options.items() if value is not None}
    settings = read_model(procedure.Settings, given, TableSource())
    settings.check()
    measured = procedure.measured(paths, settings, progress)
    head = replace(measured.head, settings=to_record(settings))
    choice = {"procedure": name, "reasons": list(reasons)}
    return replace(measured, head=head, entries={**measured.entries, "choice_of_procedure": choice})


def _rank(measurement: Measurement) -> int:
    """0 for a measurement that passes, 2 if a plane is refused."""
    return max(plane.verdict.rank for plane in measurement.planes)
