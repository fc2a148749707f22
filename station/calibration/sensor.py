"""From a folder of dark and evenly lit pictures to what every plane's sensor is: EMVA 1288."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput, Miss, Outcome
from procedures.raw import Exposure, Plane, RawFrame, read_frame
from procedures.sensor.estimate import SensorResult, characterise
from procedures.sensor.levels import LightLevel, measure_level
from procedures.sensor.noise_power import NoisePower, measure_noise_power
from procedures.sensor.recording import SensorRecording
from procedures.sensor.stacks import LEAST_PICTURES, FrameStack, StackSums
from station.calibration.folder_photographs import check_any, for_want, readable
from station.calibration.sensor_folder import DARK, LIGHT, Shots
from station.results.record_head import InputFile

Numbers = npt.NDArray[np.float64]

LEVEL_PICTURES = 2
"""Pictures that a level is measured from: those of a stack beyond them are the stack's."""
LEAST_PIXELS = 2
"""Of a frame along each side: one pixel has no noise of its own beside the frame's."""
SEED = 1288
"""Of the draws that intervals come from: the same pictures give the same numbers."""


@dataclass(frozen=True, eq=False)
class SensorPlane:
    """One plane's answer.

    Attributes
    ----------
    step : float
        How many of the file's numbers one digital number is (left-aligned samples).
    noise : NoisePower or None
        Spectrum of the temporal noise at the flat stack's signal.
    """

    name: str
    outcome: Outcome[SensorResult]
    shape: tuple[int, ...]
    step: float
    noise: NoisePower | None


@dataclass(frozen=True, eq=False)
class SensorFiles:
    """What was read: the pictures' hashes, camera and sensitivity as the first picture tells them, and the planes.

    `missed` are pictures that cannot be read, and the only one that such a picture left of a level.
    """

    files: Sequence[InputFile]
    camera: str | None
    iso: float | None
    planes: Sequence[SensorPlane]
    missed: Sequence[Miss] = ()


@dataclass
class _Gathered:
    """One plane while its pictures are read."""

    darks: list[LightLevel] = field(default_factory=list)
    lights: list[LightLevel] = field(default_factory=list)
    stacks: list[tuple[str, FrameStack]] = field(default_factory=list)
    spectra: list[NoisePower | None] = field(default_factory=list)
    shape: tuple[int, ...] = ()
    step: float = 0.0


def measure_sensor(
    shots: Sequence[Shots],
    plane: str | None,
    tell: Callable[[Iterator[Path]], Iterator[Path]] = lambda paths: paths,
    read: Callable[[Path], RawFrame] | None = None,
    missed: Sequence[Miss] = (),
) -> SensorFiles:
    """Every plane asked for; the pictures are read once, one after the other. What cannot be read is left out.

    Parameters
    ----------
    plane : str or None
        A plane's name; "all" or None for every plane.
    tell : callable
        Sees every path as it is read.
    read : callable, optional
        Gives a picture; by default its file is opened.
    missed : sequence of Miss
        What was left out of the shots.

    Raises
    ------
    BadInput
        If no picture can be read, or pictures differ in size or planes.
    """
    gathered: dict[str, _Gathered] = {}
    inputs: list[InputFile] = []
    exposures: list[Exposure] = []
    opened = read or partial(read_frame, names=None if plane in (None, "all") else [str(plane)])
    left_out = [*missed]
    paths = tell(path for one in shots for path in one.paths)
    for one in shots:
        frames = readable(islice(paths, len(one.paths)), opened, left_out)
        _gather(gathered, one, (_checked(frame, inputs, exposures) for frame in frames), left_out)
    count = len(missed) + sum(len(one.paths) for one in shots)
    check_any(left_out, count)
    light = any(one.photons is not None for one in shots)
    planes = [
        SensorPlane(
            name,
            for_want(_characterised(of, photons_known=light), left_out, count),
            of.shape,
            of.step,
            _noise_power(of),
        )
        for name, of in gathered.items()
    ]
    first = exposures[0] if exposures else Exposure()
    return SensorFiles(tuple(inputs), first.camera, first.iso, planes, left_out)


def _checked(frame: RawFrame, inputs: list[InputFile], exposures: list[Exposure]) -> RawFrame:
    inputs.append(InputFile(str(frame.path), frame.sha256))
    exposures.append(frame.exposure)
    if frame.exposure.iso != exposures[0].iso:
        raise BadInput(
            f"all pictures must be of one sensitivity; {frame.path} is of ISO {frame.exposure.iso}, those before it of "
            f"{exposures[0].iso}",
            _ONE_CAMERA,
        )
    return frame


def _gather(gathered: dict[str, _Gathered], shots: Shots, frames: Iterator[RawFrame], missed: list[Miss]) -> None:
    """Count the pictures of one exposure in, all planes side by side; one that is left alone is `missed`."""
    first: dict[str, list[Numbers]] = {}
    sums: dict[str, StackSums] = {}
    taken: list[Path] = []
    for frame in frames:
        if gathered and list(frame.planes) != list(gathered):
            raise BadInput(f"{frame.path} has other planes than the pictures before it", _ONE_CAMERA)
        for name, plane in frame.planes.items():
            if min(plane.samples.shape) < LEAST_PIXELS:
                rows, columns = plane.samples.shape
                reason = f"a sensor is measured from frames of {LEAST_PIXELS} x {LEAST_PIXELS} pixels or more a plane"
                raise BadInput(f"{reason}; {frame.path} has {columns} x {rows}", "give whole frames")
            numbers = _numbers(gathered.setdefault(name, _Gathered()), plane, frame.path)
            if len(first.setdefault(name, [])) < LEVEL_PICTURES:
                first[name].append(numbers)
            if len(shots.paths) >= LEAST_PICTURES:
                sums.setdefault(name, StackSums()).add(numbers)
        taken.append(frame.path)
    if 0 < len(taken) < LEVEL_PICTURES:
        _leave_alone(taken[0], shots, missed)
        return
    for name, pictures in first.items():
        of = gathered[name]
        level = measure_level(pictures, shots.exposure_s, shots.level)
        (of.darks if shots.kind == DARK else of.lights).append(level)
        if len(taken) >= LEAST_PICTURES:
            of.stacks.append((shots.kind, sums[name].stack(shots.exposure_s, shots.level)))
            of.spectra.append(measure_noise_power(pictures, np.nan))


def _leave_alone(path: Path, shots: Shots, missed: list[Miss]) -> None:
    """Leave out all that can be read of a level. Raises BadInput where there never was more of it."""
    needed = "of its exposure; temporal noise needs two"
    if len(shots.paths) < LEVEL_PICTURES:
        raise BadInput(f"{path} is the only picture {needed}", "take every level twice, or leave this one out")
    missed.append(Miss(str(path), f"{path} is the only picture left {needed}", "take the level again"))


_ONE_CAMERA = "give pictures of one camera at one setting, in one format"


def _numbers(of: _Gathered, plane: Plane, path: Path) -> Numbers:
    """The digital numbers as the converter gave them: a file's samples may hold them left-aligned."""
    shape = plane.samples.shape
    if of.shape and shape != of.shape:
        raise BadInput(
            f"all pictures must be of one size; {path} has {shape[1]} x {shape[0]} pixels in {plane.name}, those "
            f"before it {of.shape[1]} x {of.shape[0]}",
            _ONE_CAMERA,
        )
    numbers = plane.samples.astype(np.float64) / plane.quantisation + plane.black
    if float(plane.black).is_integer():
        np.rint(numbers, out=numbers)  # single precision left them a little off
    if not of.shape:
        of.shape, of.step = shape, _step(numbers)
    return numbers / of.step if of.step != 1 else numbers


def _step(numbers: Numbers) -> float:
    """What all differences of a picture's numbers are multiples of."""
    values = np.unique(numbers)
    if len(values) < 3 or not np.array_equal(values, np.rint(values)):
        return 1.0
    return float(np.gcd.reduce(np.diff(values).astype(np.int64)))


def _characterised(of: _Gathered, *, photons_known: bool) -> Outcome[SensorResult]:
    dark, flat = (_largest(of.stacks, kind) for kind in (DARK, LIGHT))
    recording = SensorRecording(
        _once(of.darks, lambda one: one.exposure_s),
        _once(of.lights, lambda one: one.light),
        photons_known,
        dark,
        flat,
    )
    return characterise(recording, np.random.default_rng(SEED))


def _noise_power(of: _Gathered) -> NoisePower | None:
    """Of the flat stack's first pictures, where there is a dark stack too."""
    dark, flat = (_largest(of.stacks, kind) for kind in (DARK, LIGHT))
    if dark is None or flat is None:
        return None
    found = next(one for one, (_, stack) in zip(of.spectra, of.stacks, strict=True) if stack is flat)
    return None if found is None else replace(found, signal=flat.mean - dark.mean)


def _once(levels: Sequence[LightLevel], of: Callable[[LightLevel], float]) -> tuple[LightLevel, ...]:
    """The levels in order, one of each: where a stack repeats a level of the ladder, the ladder's, which came first."""
    found: dict[float, LightLevel] = {}
    for level in levels:
        found.setdefault(of(level), level)
    return tuple(found[at] for at in sorted(found))


def _largest(stacks: Sequence[tuple[str, FrameStack]], kind: str) -> FrameStack | None:
    """The stack of a kind with the most pictures."""
    return max((stack for of, stack in stacks if of == kind), key=lambda stack: stack.count, default=None)
