"""A restoration for the command and a batch: from options and files to the outcome and its record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from procedures.colour_frame import read_colour_frame
from procedures.outcome import BadInput, ColourInput, Outcome
from procedures.raw import RawFrame, default_plane, read_frame
from procedures.reading.sensor_dump import DumpLayout
from procedures.restoration.colour.mosaic import is_mosaic
from procedures.restoration.ground_truth import check_ground_truth, compare_to_ground_truth
from procedures.restoration.joint.estimate import RestorationParameters
from procedures.restoration.joint.joint_descent import JointRound
from procedures.restoration.joint.result import Restoration
from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.masks.blur_models import named
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.checks import check_photographs
from procedures.restoration.metres import Distances
from procedures.restoration.photograph_blur import blur_of
from station.calibration.restoration.blur_options import (
    BlurOptions,
    Report,
    blur_record,
    no_report,
    report_finding,
    report_measured,
)
from station.calibration.restoration.inputs import files_in, with_files, with_record
from station.calibration.restoration.metres_options import MetresOptions

NAME = "{name}"
"""Placeholder in the name of a record for the photograph's name without suffix; such records are in its folder."""
OF_FILES = ("shapes", "defocus_shapes", "paths", "imu", "poses")
"""Options that name files."""
ENCODINGS = ("linear", "srgb")


@dataclass(frozen=True)
class DescentOptions:
    """Parameters of the estimation: options by name, as in `station restore` and in a procedure file."""

    image_weight: float | None = None
    depth_weight: float | None = None
    scheme: str = "20x(20+20)+5x20"
    depth_start: str = "matched"
    symmetric_axis: str = "both"
    total_variation: bool = False
    depth_total_variation: bool = False

    @property
    def parameters(self) -> RestorationParameters:
        """The procedure's parameters. Raises BadParameter."""
        return RestorationParameters(**{**self.entries, "scheme": Scheme.parse(self.scheme)})

    @property
    def entries(self) -> dict[str, Any]:
        """Record entries."""
        return {option.name: getattr(self, option.name) for option in fields(self)}


@dataclass(frozen=True)
class RestorationOptions:
    """All options of a restoration.

    Attributes
    ----------
    blur : BlurOptions
    descent : DescentOptions
    encoding : "linear", "srgb" or None
        Encoding of colour files of 16 bits; None for planes of RAW and grey files.
    metres : MetresOptions
        Whether depth is given in metres, and from which data.
    reference : str or None
        File of a sharp photograph of the same scene, with which the result is compared.
    """

    blur: BlurOptions
    descent: DescentOptions = field(default_factory=DescentOptions)
    encoding: str | None = None
    metres: MetresOptions = field(default_factory=MetresOptions)
    reference: str | None = None

    def checked(self, photographs: int) -> RestorationOptions:
        """The options with the shape required by distances. Raises BadParameter where options are inconsistent."""
        self.metres.check(self.blur, photographs)
        blur = self.blur
        if self.metres.metres is not None and not blur.shapes:
            blur = replace(blur, shapes=("pillbox",))
        blur.check(photographs)
        _ = self.descent.parameters
        return replace(self, blur=blur)

    @property
    def entries(self) -> dict[str, Any]:
        """All options other than the defaults, by name."""
        groups = (self.blur, self.metres)
        each = {option.name: getattr(group, option.name) for group in groups for option in fields(group)}
        given = {name: value for name, value in each.items() if value not in ((), None)}
        more = {"encoding": self.encoding, "reference": self.reference}
        return {**given, **{name: value for name, value in more.items() if value}, **self.descent.entries}

    def spread(self, photographs: int) -> RestorationOptions:
        """The options with one record per photograph where a name with `{name}` represents all."""
        spread: dict[str, Any] = {
            option: names * photographs
            for option in OF_FILES
            if len(names := getattr(self.blur, option)) == 1 and NAME in names[0]
        }
        return replace(self, blur=replace(self.blur, **spread))

    def placed(self, folder: Path, photographs: Sequence[Path]) -> RestorationOptions:
        """The options with complete paths: files are in `folder`, those with `{name}` in each photograph's folder."""
        spread = self.spread(len(photographs)).blur
        last = len(photographs) - 1
        paths: dict[str, Any] = {
            option: tuple(_placed(name, folder, photographs[min(i, last)]) for i, name in enumerate(names))
            for option in OF_FILES
            if (names := getattr(spread, option))
        }
        reference = self.reference and _placed(self.reference, folder, photographs[0])
        return replace(self, blur=replace(spread, **paths), reference=reference)

    @property
    def files(self) -> list[Path]:
        """The files that the options name, with the records of measured PSFs."""
        names = [name for option in OF_FILES for name in getattr(self.blur, option)]
        inputs = [file for name in names for part in _parts(name) for file in with_record(Path(part))]
        truth = [Path(self.reference)] if self.reference else []
        return list(dict.fromkeys([*inputs, *truth]))


def _placed(name: str, folder: Path, photograph: Path) -> str:
    if NAME in name:
        return str(photograph.parent / name.replace(NAME, photograph.stem))
    parts = _parts(name)
    if not parts:
        return name
    return with_files(name, [str(folder / part) for part in parts])


GIVE_ENCODING = "give the encoding of 16-bit colours, --encoding linear or srgb; or give RAW files"


def _parts(name: str) -> list[str]:
    return [] if named(name) is not None else files_in(name)


def read_photographs(
    images: Sequence[Path],
    plane: str | None,
    layout: DumpLayout | None,
    encoding: str | None,
    contents: Sequence[bytes] | None = None,
) -> tuple[list[RawFrame], list[Array]]:
    """Frames, and their planes stacked as channels (C, H, W).

    plane : a name, "all" or None for the default one; contents : of the files, if they were read already

    Raises
    ------
    BadInput
        If a file cannot be read, or the photographs do not belong together.
    """
    given: Sequence[bytes | None] = contents or [None] * len(images)
    chosen = plane if encoding else plane or default_plane(images[0], layout)
    frames = [_read(image, chosen, layout, encoding, data) for image, data in zip(images, given, strict=True)]
    photographs: list[Array] = [np.stack([p.samples.astype(np.float64) for p in f.planes.values()]) for f in frames]
    check_photographs(photographs)
    return frames, photographs


def read_ground_truth(
    path: Path, frames: Sequence[RawFrame], layout: DumpLayout | None, encoding: str | None
) -> RawFrame:
    """A photograph of the same planes as these. Raises BadInput where it cannot be compared with them."""
    names = list(frames[0].planes)
    truth = _read(path, names[0] if len(names) == 1 else "all", layout, encoding, None)
    check_ground_truth([frame.planes for frame in frames], truth.planes)
    return truth


def _read(
    path: Path, plane: str | None, layout: DumpLayout | None, encoding: str | None, data: bytes | None
) -> RawFrame:
    if encoding:
        return read_colour_frame(path, encoding, data=data)
    try:
        return read_frame(path, None if plane in ("all", None) else [str(plane)], layout, data=data)
    except ColourInput as error:
        raise BadInput(error.reason, GIVE_ENCODING) from error


@dataclass(frozen=True, eq=False)
class Restored:
    """A restoration with its verdict.

    Attributes
    ----------
    outcome : Outcome[Restoration]
    parameters : mapping
        Record entries of the parameters.
    distances : Distances, optional
        Depth in metres, if requested.
    """

    outcome: Outcome[Restoration]
    parameters: Mapping[str, Any]
    distances: Distances | None = None


def restored(
    options: RestorationOptions,
    frames: list[RawFrame],
    photographs: list[Array],
    report: Report = no_report,
    progress: Callable[[JointRound], None] | None = None,
    truth: RawFrame | None = None,
) -> Restored:
    """The sharp picture and the depth map; truth : a sharp photograph of the same planes for comparison.

    Raises
    ------
    ProcedureError
        As `procedures.restoration` does, and where the options' files cannot be read.
    """
    metres = options.metres
    settings = metres.settings(frames) if metres.metres else []
    spec = (metres.blur(options.blur, settings) if settings else options.blur).spec(frames, photographs)
    report_measured(spec, report)
    blur = blur_of(spec, photographs, partial(report_finding, report=report))
    outcome = blur.restored(photographs, options.descent.parameters, progress)
    if is_mosaic(frames[0].planes) and outcome.value is not None:
        report("colour", "picture in colour on the sensor's grid")
        outcome = blur.coloured(outcome, [frame.planes for frame in frames])
    distances = None
    if settings and outcome.value is not None:
        distances = metres.distances(outcome.value, photographs, blur.masks, settings[0])
        outcome = metres.judged(outcome, distances)
    if truth is not None:
        outcome = compare_to_ground_truth(outcome, [one.planes for one in frames], truth.planes)
    parameters = {
        **blur_record(options.blur, frames, spec, blur),
        **(metres.entries(settings) if settings else {}),
        "planes": list(frames[0].planes),
        **({"encoding": options.encoding} if options.encoding else {}),
        **({"reference": options.reference, "reference_sha256": truth.sha256} if truth else {}),
        **options.descent.entries,
    }
    return Restored(outcome, parameters, distances)
