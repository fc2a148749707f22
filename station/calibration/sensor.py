"""Characterisation of a sensor from dark and evenly lit pictures: EMVA 1288."""

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
from procedures.sensor.spectrograms import NoisePower, measure_noise_power
from procedures.sensor.stacks import LEAST_PICTURES, FrameStack, LightLevel, SensorRecording, StackSums, measure_level
from station.calibration.folder_photographs import check_any, for_want, readable
from station.calibration.sensor_folder import DARK, LIGHT, Shots
from station.results.record_head import InputFile

Numbers = npt.NDArray[np.float64]

LEVEL_PICTURES = 2
"""Pictures from which a level is measured; further ones of a stack belong to the stack alone."""
LEAST_PIXELS = 2
"""Least size of a frame along each side: the noise of a single pixel is that of the frame."""
SEED = 1288
"""Seed of the draws for intervals: the same pictures give the same numbers."""


@dataclass(frozen=True, eq=False)
class SensorPlane:
    """The outcome of one plane.

    step : step of the file's values per digital number (left-aligned samples); noise : spectrum of the temporal noise
    at the signal of the flat stack.
    """

    name: str
    outcome: Outcome[SensorResult]
    shape: tuple[int, ...]
    step: float
    noise: NoisePower | None


@dataclass(frozen=True, eq=False)
class SensorFiles:
    """The pictures' hashes, camera and sensitivity of the first picture, and the planes. `missed` are unreadable
    pictures, and pictures that are the only readable ones of their level."""

    files: Sequence[InputFile]
    camera: str | None
    iso: float | None
    planes: Sequence[SensorPlane]
    missed: Sequence[Miss] = ()


@dataclass
class _Gathered:
    """Levels and stacks of one plane."""

    darks: list[LightLevel] = field(default_factory=list)
    lights: list[LightLevel] = field(default_factory=list)
    stacks: list[tuple[str, FrameStack]] = field(default_factory=list)
    spectra: list[NoisePower | None] = field(default_factory=list)
    shape: tuple[int, ...] = ()
    step: float = 0.0


def measure_sensor(
    shots: Sequence[Shots],
    plane: str | None,
    watch: Callable[[Iterator[Path]], Iterator[Path]] = lambda paths: paths,
    read: Callable[[Path], RawFrame] | None = None,
    missed: Sequence[Miss] = (),
) -> SensorFiles:
    """The requested planes. The pictures are read once, one after the other; unreadable ones are excluded.

    Raises BadInput if no picture can be read, or pictures differ in size or planes.

    plane : a plane's name; "all" or None for every plane
    watch : passes on the paths as they are read
    read : reads a picture; by default from its file
    missed : pictures that are already excluded
    """
    gathered: dict[str, _Gathered] = {}
    inputs: list[InputFile] = []
    exposures: list[Exposure] = []
    opened = read or partial(read_frame, names=None if plane in (None, "all") else [str(plane)])
    excluded = [*missed]
    paths = watch(path for shot in shots for path in shot.paths)
    for shot in shots:
        frames = readable(islice(paths, len(shot.paths)), opened, excluded)
        _gather(gathered, shot, (_checked(frame, inputs, exposures) for frame in frames), excluded)
    count = len(missed) + sum(len(shot.paths) for shot in shots)
    check_any(excluded, count)
    light = any(shot.photons is not None for shot in shots)
    planes = []
    for name, of in gathered.items():
        dark, flat = (
            max((stack for which, stack in of.stacks if which == kind), key=lambda stack: stack.count, default=None)
            for kind in (DARK, LIGHT)
        )
        darks, lights = _once(of.darks, lambda one: one.exposure_s), _once(of.lights, lambda one: one.light)
        recording = SensorRecording(darks, lights, light, dark, flat)
        outcome = for_want(characterise(recording, np.random.default_rng(SEED)), excluded, count)
        noise = None
        if dark is not None and flat is not None:  # of the first pictures of the flat stack
            noise = next(one for one, (_, stack) in zip(of.spectra, of.stacks, strict=True) if stack is flat)
            noise = None if noise is None else replace(noise, signal=flat.mean - dark.mean)
        planes.append(SensorPlane(name, outcome, of.shape, of.step, noise))
    first = exposures[0] if exposures else Exposure()
    return SensorFiles(tuple(inputs), first.camera, first.iso, planes, excluded)


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
    """Add the pictures of one exposure to all planes; a single readable one is `missed`."""
    first: dict[str, list[Numbers]] = {}
    sums: dict[str, StackSums] = {}
    taken: list[Path] = []
    same: dict[str, Path] = {}
    for frame in frames:
        if (other := same.setdefault(frame.sha256, frame.path)) is not frame.path and _varies(frame):
            raise BadInput(f"pictures must differ; {frame.path} has the content of {other}", "take the level again")
        if gathered and list(frame.planes) != list(gathered):
            raise BadInput(f"{frame.path} has other planes than the pictures before it", _ONE_CAMERA)
        for name, plane in frame.planes.items():
            if min(plane.samples.shape) < LEAST_PIXELS:
                rows, columns = plane.samples.shape
                reason = f"a plane must have {LEAST_PIXELS} x {LEAST_PIXELS} pixels or more"
                raise BadInput(f"{reason}; {frame.path} has {columns} x {rows}", "give whole frames")
            numbers = _numbers(gathered.setdefault(name, _Gathered()), plane, frame.path)
            if len(first.setdefault(name, [])) < LEVEL_PICTURES:
                first[name].append(numbers)
            if len(shots.paths) >= LEAST_PICTURES:
                sums.setdefault(name, StackSums()).add(numbers)
        taken.append(frame.path)
    if 0 < len(taken) < LEVEL_PICTURES:
        path = taken[0]
        needed = "of its exposure; temporal noise needs two"
        if len(shots.paths) < LEVEL_PICTURES:
            raise BadInput(f"{path} is the only picture {needed}", "take every level twice, or leave this one out")
        missed.append(Miss(str(path), f"{path} is the only readable picture {needed}", "take the level again"))
        return
    for name, pictures in first.items():
        of = gathered[name]
        level = measure_level(pictures, shots.exposure_s, shots.level)
        if not shots.only_stack:
            (of.darks if shots.kind == DARK else of.lights).append(level)
        if len(taken) >= LEAST_PICTURES:
            of.stacks.append((shots.kind, sums[name].stack(shots.exposure_s, shots.level)))
            of.spectra.append(measure_noise_power(pictures, np.nan))


def _varies(frame: RawFrame) -> bool:
    """Whether most samples are neither at the lowest nor at the highest number, as in clipped pictures."""
    samples = frame.guide.samples
    return bool(samples.min() < np.median(samples) < samples.max())


_ONE_CAMERA = "give pictures of one camera at one setting, in one format"


def _numbers(of: _Gathered, plane: Plane, path: Path) -> Numbers:
    shape = plane.samples.shape
    if of.shape and shape != of.shape:
        raise BadInput(
            f"all pictures must be of one size; {path} has {shape[1]} x {shape[0]} pixels in {plane.name}, those "
            f"before it {of.shape[1]} x {of.shape[0]}",
            _ONE_CAMERA,
        )
    numbers = plane.samples.astype(np.float64) / plane.quantisation + plane.black
    if float(plane.black).is_integer():
        np.rint(numbers, out=numbers)  # removes rounding to single precision
    if not of.shape:
        of.shape, of.step = shape, _step(numbers)
    return numbers / of.step if of.step != 1 else numbers


def _step(numbers: Numbers) -> float:
    values = np.unique(numbers)
    if len(values) < 3 or not np.array_equal(values, np.rint(values)):
        return 1.0
    return float(np.gcd.reduce(np.diff(values).astype(np.int64)))


def _once(levels: Sequence[LightLevel], of: Callable[[LightLevel], float]) -> tuple[LightLevel, ...]:
    """The first of the levels of each: that of the ladder where a stack repeats it."""
    first: dict[float, LightLevel] = {}
    for level in levels:
        first.setdefault(of(level), level)
    return tuple(first.values())
