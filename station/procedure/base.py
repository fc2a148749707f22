"""Protocol of procedures, and the base class of those that process photographs plane by plane."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, Literal, Self, TypeVar

import msgspec

from procedures.developed import is_developed, read_developed
from procedures.outcome import BadParameter, ColourInput, Miss, Outcome
from procedures.pattern import DEFAULT_SEED
from procedures.pattern_print.source import Source
from procedures.plan import Advice
from procedures.raw import RawFrame, default_plane, read_frame, read_photograph
from procedures.reading.sensor_dump import DumpLayout
from station.calibration.folder_photographs import PHOTOGRAPHS
from station.common.progress import Progress, silent
from station.results.measurement import BY_PLANE, Measurement
from station.results.overlay import read_overlay
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead, files_read
from station.results.terms import USUAL, Terms

if TYPE_CHECKING:
    from station.reports.report import Report


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all settings models."""

    def check(self) -> None:
        """Raise ProcedureError if values are inconsistent, or a file that they name is unreadable."""

    def placed(self, folder: Path) -> Self:
        """The settings with relative file names resolved against a folder, where such files exist."""

        def in_folder(value: Any) -> Any:
            if isinstance(value, tuple):
                return tuple(map(in_folder, value))
            return folder / value if isinstance(value, Path) and (folder / value).exists() else value

        values = msgspec.structs.asdict(self)
        return msgspec.structs.replace(self, **{name: in_folder(value) for name, value in values.items()})


def setting(
    description: str, *, least: float | None = None, most: float | None = None, metavar: str = ""
) -> msgspec.Meta:
    """Annotation of a field: description, bounds, and metavar."""
    return msgspec.Meta(ge=least, le=most, description=description, extra={"metavar": metavar})


def named_files(settings: Settings) -> list[Path]:
    """The files named in a model."""
    values = msgspec.structs.asdict(settings).values()
    every = (one for value in values for one in (value if isinstance(value, tuple) else (value,)))
    return [one for one in every if isinstance(one, Path)]


def to_record(settings: Settings) -> dict[str, Any]:
    """Convert a model to JSON-compatible data, without None."""
    plain: dict[str, Any] = msgspec.to_builtins(settings, enc_hook=str)
    return {name: value for name, value in plain.items() if value is not None}


class Inputs(StrEnum):
    """Input of one measurement, on the command line and as an item of a batch."""

    PHOTOGRAPH = "photograph"
    """One photograph."""
    PAIR = "pair"
    """Two photographs."""
    PHOTOGRAPHS = "photographs"
    """Any number of photographs; a folder or a session is replaced by its photographs."""
    FOLDER = "folder"
    """A folder with a manifest or a prescribed layout."""
    SCENE = "scene"
    """Two or more photographs of one scene; in a batch a pair, or a row of a table."""
    SERIES = "series"
    """A folder, each of whose photographs is measured; the command is a batch."""
    SEVERAL = "several"
    """One or several files, which the procedure groups itself; in a batch each is an item."""
    RESULTS = "results"
    """Two results of another procedure, each a folder or its record."""


def upper_plane(name: str | None) -> str | None:
    """Normalise the name of a plane: G1 for g1, all for ALL."""
    return name if name is None else "all" if name.lower() == "all" else name.upper()


class RawLayout(Settings, frozen=True, kw_only=True):
    """Settings of procedures that read photographs."""

    raw: Annotated[str | None, setting(
        "The photographs are a sensor's samples: size, colours, kind of sample and levels of files without a header; "
        "RGGB,BLACK,WHITE, or Y for RGGB, of grey pictures.", metavar="WxH,RGGB,u16le,BLACK,WHITE")] = None  # fmt: skip

    @property
    def layout(self) -> DumpLayout | None:
        """Layout of a sensor's samples. Raises BadParameter if the text is invalid."""
        return None if self.raw is None else DumpLayout.parse(self.raw)

    def check(self) -> None:
        """Raise BadParameter if the layout is invalid."""
        _ = self.layout


class PlaneSettings(RawLayout, frozen=True, kw_only=True):
    """Settings of procedures that measure planes of photographs."""

    plane: Annotated[str | None, setting("R, G1, G2, B, Y or all.  [default: G1 of a RAW file, Y of a grey image]")] = (
        None
    )

    @property
    def plane_name(self) -> str | None:
        """The normalised name of the plane, see `upper_plane`."""
        return upper_plane(self.plane)

    def read(self, path: Path) -> RawFrame:
        """The requested planes: one, several separated by commas, or all. Raises ProcedureError."""
        chosen = self.plane_name or default_plane(path, self.layout)
        return read_frame(path, None if chosen == "all" else chosen.split(","), self.layout)


Encoding = Annotated[
    Literal["linear", "srgb"] | None,
    setting("Of files in colour, JPEG, WebP and HEIC.  [default: by the ICC profile, or sRGB]"),
]


def read_picture(path: Path, encoding: str | None, read: Callable[[Path], RawFrame]) -> RawFrame:
    """A photograph as `read` gives it, or a developed picture: in colour, or where an encoding is stated. Raises
    ProcedureError."""
    data = read_photograph(path)
    if encoding and data[:2] in (b"P2", b"P5"):
        if encoding != "linear":
            reason = f"the samples of a PGM are taken as linear; {encoding} is stated for {path}"
            raise BadParameter(reason, "omit --encoding, or save the picture as PNG or TIFF")
        encoding = None
    if not encoding and not is_developed(data):
        with suppress(ColourInput):
            return read(path)
    return read_developed(path, encoding, data=data)


class PictureSettings(PlaneSettings, frozen=True, kw_only=True):
    """Settings of procedures that also take developed pictures, as JPEG files."""

    encoding: Encoding = None

    def read(self, path: Path) -> RawFrame:
        """The plane, or all of a picture in colour. Raises ProcedureError."""
        return read_picture(path, self.encoding, super().read)


ChartBits = Annotated[Path, setting("The chart's 256 x 256 cells as a grey image.")] | None
ChartSeed = (
    Annotated[int, setting("The chart's seed; 1 if neither this nor the cells are given.", least=0, most=2**63 - 1)]
    | None
)


def chart_source(bits: Path | None, seed: int | None) -> Source:
    """The chart from its cells or its seed. Raises BadParameter if both are given."""
    if bits is not None and seed is not None:
        raise BadParameter("the chart comes from its cells or from its seed", "give one of them: --bits or --seed")
    if bits is not None:
        return Source.from_file(bits)
    return Source.from_seed(DEFAULT_SEED if seed is None else seed)


class ChartSettings(PlaneSettings, frozen=True, kw_only=True):
    """Settings of procedures that measure photographs of the noise chart."""

    bits: ChartBits = None
    seed: ChartSeed = None

    @property
    def source(self) -> Source:
        """The chart. Raises ProcedureError."""
        return chart_source(self.bits, self.seed)

    def check(self) -> None:
        """Raise ProcedureError if the layout is invalid, or the chart is unreadable."""
        super().check()
        _ = self.source


def beside(path: Path, folder: Path) -> Path:
    """The path itself if it is absolute or exists, else below `folder`."""
    return path if path.is_absolute() or path.exists() else folder / path


@dataclass(frozen=True)
class BatchSummary:
    """Files of a batch's folder by name, lines for the terminal, and warnings."""

    files: Mapping[str, bytes]
    lines: Sequence[str] = ()
    warnings: Sequence[str] = ()


S = TypeVar("S", bound=Settings)


class Procedure(ABC, Generic[S]):
    """One kind of measurement.

    name : as commands, records, procedure files and limits call it
    title : one line for lists and for the first line of its page
    help : what `--help` says, paragraphs with an empty line between
    inputs : what it takes at once
    Settings : its model of settings
    argument : what stands for its photographs in the help, where "PHOTO..." and the like do not fit
    suffixes : which files of a folder a batch takes: suffixes, or whole names
    endings : how the names of a batch's pairs end, by key of the procedure file
    results_key : the entry of the record that holds the results by plane, or the only one of them
    has_page : whether a page is drawn; `page_name` is its file, `drawn_by` the function in `station.reports`;
        `usual_page` whether it is where nothing is said of it
    has_mtf : whether it has an MTF, so that a unit of frequencies and further frequencies can be chosen
    method : the publication or standard that certificates cite
    subject : what the general guided plan photographs on a simulated bench, see `procedures.plan.Plan`
    """

    name: ClassVar[str]
    title: ClassVar[str]
    help: ClassVar[str]
    inputs: ClassVar[Inputs]
    Settings: ClassVar[type[Any]] = Settings
    suffixes: ClassVar[frozenset[str]] = PHOTOGRAPHS
    endings: ClassVar[Mapping[str, str]] = {"first": "_1", "second": "_2"}
    results_key: ClassVar[str] = BY_PLANE
    has_page: ClassVar[bool] = True
    page_name: ClassVar[str] = "report.html"
    drawn_by: ClassVar[str] = "report_page:measurement_page"
    usual_page: ClassVar[bool] = True
    has_mtf: ClassVar[bool] = False
    argument: ClassVar[str] = ""
    method: ClassVar[str] = ""
    subject: ClassVar[str] = "chart"

    @property
    def schema(self) -> str:
        return f"station/{self.name}/1"

    @property
    def record_name(self) -> str:
        """The procedure that its records name."""
        return self.name

    def steps(self, paths: Sequence[Path]) -> int:
        """Number of progress steps of a measurement of these files."""
        return len(paths)

    def check_photograph(self, frame: RawFrame, settings: Mapping[str, Any]) -> Advice:
        """Whether a photograph of the guided plan counts, and the pose to match; the settings are those given."""
        return Advice(True, "The photograph has been read.")

    def measure(
        self, paths: Sequence[Path], settings: S, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        """Measure the files, in the terms. Raises ProcedureError if no plane can be given a verdict."""
        return self.measured(paths, settings, progress).compared(terms)

    def measured(self, paths: Sequence[Path], settings: S, progress: Progress) -> Measurement:
        """Measure the files, where the estimate does not depend on the terms; otherwise `measure` is overridden."""
        raise NotImplementedError

    def places(self, paths: Sequence[Path]) -> list[str]:
        """Result folders below --out, one per measurement."""
        return [""]

    def measurements(
        self, paths: Sequence[Path], settings: S, terms: Terms = USUAL, progress: Progress = silent
    ) -> Iterator[Measurement]:
        """Yield the measurement for each of `places`."""
        yield self.measure(paths, settings, terms, progress)

    def files(self, paths: Sequence[Path], settings: S) -> list[Path]:
        """Files besides the inputs on which a measurement depends."""
        return [beside(file, paths[0].parent) for file in named_files(settings)]

    def missed(self, measurement: Measurement) -> Sequence[Miss]:
        """The unusable photographs."""
        return measurement.missed or ()

    def read_overlays(self, paths: Sequence[Path], terms: Terms) -> Sequence[Any]:
        """Results whose MTF is drawn over this one's. Raises BadParameter."""
        return [read_overlay(path) for path in paths]

    def lines(self, measurement: Measurement) -> list[str]:
        """Additional lines for the terminal, after those of the planes."""
        return []

    def summary(self, rows: Sequence[Any]) -> BatchSummary | None:
        """Summary of a batch's rows besides the usual one."""
        return None

    def report(self, measurement: Measurement) -> Report:
        """Contents of the certificate of a measurement."""
        from station.reports.report import measurement_report  # here: it draws, which is slow to load

        return measurement_report(measurement, self.name, title=self.title, method=self.method)

    def draws(self, measurement: Measurement) -> bool:
        return self.has_page and not measurement.refused

    def page(self, measurement: Measurement) -> bytes:
        """The HTML page: by default verdict, numbers, limits, curves and provenance."""
        module, _, draw = self.drawn_by.partition(":")  # imported now: drawing is slow to load
        page: str = getattr(import_module(f"station.reports.{module}"), draw)(self.report(measurement))
        return page.encode()


class PhotographProcedure(Procedure[S]):
    """Base of a procedure that measures planes of photographs; only `run` must be implemented."""

    inputs = Inputs.PHOTOGRAPH
    Settings: ClassVar[type[Any]] = PlaneSettings

    @abstractmethod
    def run(self, frames: Sequence[RawFrame], settings: S) -> Mapping[str, Outcome[Any]]:
        """The outcome by plane. Its value has `numbers`, and optionally `curves` and `arrays`."""

    def measured(self, paths: Sequence[Path], settings: S, progress: Progress) -> Measurement:
        reading = settings if isinstance(settings, PlaneSettings) else PlaneSettings()
        frames = []
        for path in paths:
            frames.append(reading.read(path))
            progress(f"read {path.name}")
        outcomes = self.run(frames, settings)
        planes = tuple(plane_result(name, outcome) for name, outcome in outcomes.items())
        head = RecordHead(self.name, files_read(frames), to_record(settings))
        return Measurement(self.schema, head, planes, exposure=frames[0].exposure)


def plane_result(name: str, outcome: Outcome[Any], details: Mapping[str, Any] | None = None) -> PlaneResult:
    """Convert the outcome of a plane, with additional entries of the record."""
    estimate = outcome.value
    numbers = {} if estimate is None else estimate.numbers
    return PlaneResult.of_outcome(
        name, outcome,
        numbers=numbers() if callable(numbers) else numbers,
        curves=getattr(estimate, "curves", {}),
        estimate=estimate, pitch=0, details=details or {},
    )  # fmt: skip
