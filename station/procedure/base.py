"""The protocol of procedures, and the base of those that look at photographs one by one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, Protocol, TypeVar

from procedures.outcome import BadParameter, Outcome, Quantity
from procedures.pattern import DEFAULT_SEED
from procedures.pattern_print.source import Source
from procedures.raw import RawFrame, default_plane, read_frame
from procedures.reading.sensor_dump import DumpLayout
from station.calibration.folder_photographs import PHOTOGRAPHS
from station.common.progress import Progress, silent
from station.procedure.settings import Settings, named_files, setting, to_record
from station.results.measurement import BY_PLANE, Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead, files_read
from station.results.terms import USUAL, Terms


class Inputs(StrEnum):
    """What a procedure takes at once, on the command line and as an item of a batch."""

    PHOTOGRAPH = "photograph"
    """One photograph."""
    PAIR = "pair"
    """Two photographs."""
    PHOTOGRAPHS = "photographs"
    """Any number of photographs; a folder or a session stands for its own."""
    FOLDER = "folder"
    """A folder whose files have roles."""
    SEVERAL = "several"
    """One file or several, which is up to the procedure; a batch takes each by itself."""
    RESULTS = "results"
    """Two results of another procedure, each a folder or its record."""


def upper_plane(name: str | None) -> str | None:
    """A plane's name as records have it: G1 for g1, all for ALL."""
    return name if name is None else "all" if name.lower() == "all" else name.upper()


class RawLayout(Settings, frozen=True, kw_only=True):
    """Settings of everything that reads whole photographs."""

    raw: (
        Annotated[
            str,
            setting(
                "The photographs are a sensor's samples without a header: size, colours, kind of sample, levels.",
                metavar="WxH,RGGB,u16le,BLACK,WHITE",
            ),
        ]
        | None
    ) = None

    @property
    def layout(self) -> DumpLayout | None:
        """How samples without a header lie. Raises BadParameter where the text says nothing of the kind."""
        return None if self.raw is None else DumpLayout.parse(self.raw)


class Reading(RawLayout, frozen=True, kw_only=True):
    """Settings of everything that reads photographs by plane."""

    plane: Annotated[str, setting("R, G1, G2, B, Y or all.  [default: G1 of a RAW file, Y of a grey image]")] | None = (
        None
    )

    @property
    def plane_name(self) -> str | None:
        """The plane as records call it: G1 for g1, all for ALL."""
        return upper_plane(self.plane)

    def read(self, path: Path) -> RawFrame:
        """The planes asked for. Raises ProcedureError."""
        chosen = self.plane_name or default_plane(path, self.layout)
        return read_frame(path, None if chosen == "all" else [chosen], self.layout)


class ChartReading(Reading, frozen=True, kw_only=True):
    """Settings of everything that reads photographs of the noise chart."""

    bits: Annotated[Path, setting("The chart's 256 x 256 cells as a grey image.")] | None = None
    seed: (
        Annotated[int, setting("The chart's seed; 1 if neither this nor the cells are given.", least=0, most=2**63 - 1)]
        | None
    ) = None

    @property
    def source(self) -> Source:
        """The chart. Raises BadParameter where both were given."""
        if self.bits is not None and self.seed is not None:
            raise BadParameter("the chart comes from its cells or from its seed", "give --bits or --seed")
        if self.bits is not None:
            return Source.from_file(self.bits)
        return Source.from_seed(DEFAULT_SEED if self.seed is None else self.seed)


def beside(path: Path, folder: Path) -> Path:
    """A file that is named from here, or lies in a folder."""
    return path if path.is_absolute() or path.exists() else folder / path


S = TypeVar("S", bound=Settings)


class Procedure(ABC, Generic[S]):
    """One kind of measurement.

    Attributes
    ----------
    name : as commands, records, procedure files and limits call it
    title : one line for lists and for the first line of its page
    help : what `--help` says, paragraphs with an empty line between
    inputs : what it takes at once
    Settings : its model of settings
    argument : what stands for its photographs in the help, where "PHOTO..." and the like do not fit
    suffixes : which files of a folder a batch takes: suffixes, or whole names
    endings : how the names of a batch's pairs end, by key of the procedure file
    results_key : the entry of the record that holds the results by plane, or the only one of them
    has_page : whether a page is drawn; `page_name` is its file
    has_mtf : whether it has an MTF, so that a unit of frequencies and further frequencies can be chosen
    method : the publication or standard that certificates cite
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
    has_mtf: ClassVar[bool] = False
    argument: ClassVar[str] = ""
    method: ClassVar[str] = ""

    @property
    def schema(self) -> str:
        """Of its record."""
        return f"station/{self.name}/1"

    def steps(self, paths: Sequence[Path]) -> int:
        """How many steps a measurement of these files reports to its progress."""
        return len(paths)

    @abstractmethod
    def measure(
        self, paths: Sequence[Path], settings: S, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        """What these files give. Raises ProcedureError where they give nothing that could be judged."""

    def places(self, paths: Sequence[Path]) -> list[str]:
        """The folders of the results below --out: of a procedure that gives several, one for each."""
        return [""]

    def measurements(
        self, paths: Sequence[Path], settings: S, terms: Terms = USUAL, progress: Progress = silent
    ) -> Iterator[Measurement]:
        """The measurement of each of `places`, one after the other."""
        yield self.measure(paths, settings, terms, progress)

    def files(self, paths: Sequence[Path], settings: S) -> list[Path]:
        """The files on which a measurement depends beside its inputs."""
        return [beside(one, paths[0].parent) for one in named_files(settings)]

    def lines(self, found: Measurement) -> list[str]:
        """Further lines for the terminal, after those of the planes."""
        return []

    def page(self, found: Measurement) -> bytes:
        """The page for people: by default verdict, numbers, limits, curves and provenance."""
        from station.reports.measurement_page import measurement_page  # here: it draws, which is slow to load

        return measurement_page(found, self.title).encode()


class Numbered(Protocol):
    """What a result must have: its numbers."""

    @property
    def numbers(self) -> Mapping[str, Quantity]:
        """Every number with unit and standard uncertainty, by a name of `procedures.numbers`."""
        ...


class PhotographProcedure(Procedure[S]):
    """A procedure that looks at the planes of photographs: `run` is all that it needs."""

    inputs = Inputs.PHOTOGRAPH
    Settings: ClassVar[type[Any]] = Reading

    @abstractmethod
    def run(self, frames: Sequence[RawFrame], settings: S) -> Mapping[str, Outcome[Any]]:
        """The outcome of every plane. Its value has `numbers`; it may have `curves` and `arrays`."""

    def measure(
        self, paths: Sequence[Path], settings: S, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        """Reads the photographs, runs, and puts the planes together."""
        reading = settings if isinstance(settings, Reading) else Reading()
        frames = []
        for path in paths:
            frames.append(reading.read(path))
            progress(path.name)
        outcomes = self.run(frames, settings)
        planes = tuple(plane_result(name, one) for name, one in outcomes.items())
        head = RecordHead(self.name, files_read(frames), to_record(settings))
        return Measurement(self.schema, head, planes, exposure=frames[0].exposure).compared(terms)


def plane_result(name: str, outcome: Outcome[Any], details: Mapping[str, Any] | None = None) -> PlaneResult:
    """A plane's outcome with the numbers and curves of its value, and further entries of the record."""
    found = outcome.value
    numbers = {} if found is None else found.numbers
    return PlaneResult.of_outcome(
        name, outcome,
        numbers=numbers() if callable(numbers) else numbers,
        curves=getattr(found, "curves", {}) if found is not None else {},
        found=found, pitch=0, details=details or {},
    )  # fmt: skip
