"""The picture of a Monte Carlo render without its noise, from the samples' histograms."""

import hashlib
import os
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from procedures import numbers as names
from procedures.outcome import BadInput, BadParameter, Outcome, Verdict
from procedures.ray_histogram.adaptive import allot
from procedures.ray_histogram.blend import blend, open_image_denoise
from procedures.ray_histogram.comparison import psnr_db
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_files import read_film
from procedures.ray_histogram.filter import PAPER, FilterParameters
from procedures.ray_histogram.multiscale import FilteredFilm, filter_film
from procedures.ray_histogram.render_files import read_halves
from procedures.ray_histogram.sequence import filter_sequence
from procedures.ray_histogram.uncertainty import coverage
from procedures.reading.arrays import checked_array, read_npz
from procedures.reading.exr import write_exr
from station.common.progress import Progress, silent
from station.drawing.pictures import described_tiff, display_png, float_tiff
from station.procedure.base import Inputs, Procedure, Settings, setting
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import InputFile, RecordHead, files_read, verdict_entry
from station.results.result_files import npy
from station.results.terms import USUAL, Terms

Picture = npt.NDArray[np.float64]

DESCRIPTION = "filtered render, linear, 1 = white, first row uppermost; calibration-station"
UNCERTAINTY = "standard uncertainty of the filtered render, linear, 1 = white; calibration-station"
FEW_SIMILAR = 4.0
"""Similar patches in the median below which a picture keeps most of its noise."""


class RaysSettings(Settings, frozen=True, kw_only=True):
    """The filter, the films beside each film, and what is reported besides."""

    picture: Annotated[Path | None, setting("The picture's own file, where FILM is an OpenEXR of histograms only.")] = (
        None
    )
    kappa: Annotated[float, setting("Chi-square per bin that is half similar.")] = 1.0
    scales: Annotated[int, setting("Scales; 1 leaves noise wider than a block.", most=16)] = 3
    search: Annotated[int, setting("Half size of the search block, pixels.", most=64)] = 6
    patch: Annotated[int, setting("Half size of the patches, pixels.", most=16)] = 1
    reach: Annotated[int, setting("Frames of a sequence before and after.", least=0, most=64)] = 1
    neighbour: Annotated[tuple[Path, ...], setting("A frame beside the only FILM; may be repeated.")] = ()
    add: Annotated[tuple[Path, ...], setting("A film of more samples of the only FILM; may be repeated.")] = ()
    reference: Annotated[
        Path | None, setting("A converged render (npz with `reference` or `image`) to compare with.")
    ] = None
    published: Annotated[bool, setting("Filter as Algorithms 1 and 2 state it, without what was added since.")] = False
    uncertainty: Annotated[bool, setting("Report the standard uncertainty of each pixel too.")] = False
    blend: Annotated[
        bool, setting("Blend candidates by cross-validation between halves: FILM of samples, or FILM and --add of EXR.")
    ] = False
    oidn: Annotated[bool, setting("Open Image Denoise as one more candidate of the blend.")] = False
    exr: Annotated[bool, setting("Write filtered.exr too, with the uncertainty as a layer.")] = False
    budget: Annotated[int, setting(
        "Samples to cast next: writes how many each pixel needs to more.npy.", least=0, most=2**63 - 1
    )] | None = None  # fmt: skip
    threads: Annotated[int, setting("Threads.  [default: one for each processor]", least=1, most=1024)] | None = None

    @property
    def parameters(self) -> FilterParameters:
        """Those of the filter. Raises BadParameter."""
        return replace(
            PAPER if self.published else FilterParameters(),
            kappa=self.kappa, scales=self.scales, search=self.search, patch=self.patch,
        )  # fmt: skip

    def check_for(self, films: int) -> None:
        """Raises BadParameter where settings do not go together."""
        alone = {"--picture": self.picture, "--neighbour": self.neighbour, "--add": self.add, "--blend": self.blend}
        for option, given in {**alone, "--reference": self.reference}.items():
            if given and films > 1:
                raise BadParameter(f"{option} with {films} films", "give one film, or leave the option out")
        if self.oidn and not self.blend:
            raise BadParameter("--oidn without --blend", "give both: Open Image Denoise is a candidate of the blend")
        if self.blend and (self.neighbour or self.picture):
            raise BadParameter("--blend with --neighbour or --picture", "blend a render by itself")
        if self.neighbour and self.uncertainty:
            raise BadParameter("--uncertainty with --neighbour", "give all frames in order as a sequence instead")

    def read(self, path: Path) -> Film:
        """A film with what is to be added to it, checked."""
        film = read_film(path, self.picture)
        for more in self.add:
            film = film.merge(read_film(more))
        return film.checked()

    def sources(self, films: Sequence[Path], i: int) -> list[Path]:
        """The files that the result of frame i comes from, its own first."""
        beside = [*films[max(0, i - self.reach) : i], *films[i + 1 : i + 1 + self.reach]]
        picture = None if self.picture == films[i] else self.picture
        others = (picture, *self.add, *self.neighbour, self.reference)
        return [films[i], *beside, *(path for path in others if path is not None)]


@dataclass(frozen=True, eq=False)
class FilteredRender:
    """A film, its filtered picture, the converged render where there is one, and the weights of a blend."""

    film: Film
    filtered: FilteredFilm
    truth: Picture | None
    weights: dict[str, float] | None = None
    exr: bool = False

    @cached_property
    def decibels(self) -> dict[str, tuple[float, float]]:
        """PSNR as rendered and filtered, each with values cut to 0...1 and as they are; without a truth nothing."""
        if self.truth is None:
            return {}
        return {"input": psnr_db(self.film.mean, self.truth), "filtered": psnr_db(self.filtered.picture, self.truth)}

    @cached_property
    def coverage(self) -> float | None:
        """Share of values within two standard uncertainties of the truth, where both are known."""
        spread = self.filtered.uncertainty
        if spread is None or self.truth is None:
            return None
        return float(coverage(self.filtered.picture, spread, self.truth))

    @property
    def outcome(self) -> Outcome[FilteredFilm]:
        dropped, cast, similar = int(self.film.dropped.sum()), int(self.film.count.sum()), self.filtered.median_similar
        if dropped:
            share = f"{dropped} of {cast + dropped} samples"
            reason = f"{share} were NaN or infinite and were dropped: their light is missing"
            return Outcome(self.filtered, Verdict.DOUBTFUL, reason, "look for the fault in the renderer")
        if similar[0] < FEW_SIMILAR:
            reason = f"few pixels are alike ({similar[0]:.1f} in the median), so most of the noise is still there"
            return Outcome(self.filtered, Verdict.DOUBTFUL, reason, "cast more samples, or raise --kappa")
        return Outcome(self.filtered)

    def numbers(self) -> dict[str, float]:
        """Numbers for which limits can be set."""
        numbers: dict[str, float] = {
            names.SIMILAR_PATCHES: self.filtered.median_similar[0],
            names.SAMPLES_CAST: float(self.film.count.mean()),
            names.DROPPED_SAMPLES: int(self.film.dropped.sum()),
        }
        if self.filtered.uncertainty is not None:
            numbers[names.RENDER_UNCERTAINTY] = float(np.median(self.filtered.uncertainty))
        if self.coverage is not None:
            numbers[names.COVERAGE] = self.coverage
        if self.decibels:
            numbers |= {
                names.PSNR_RENDERED: self.decibels["input"][0],
                names.PSNR_FILTERED: self.decibels["filtered"][0],
            }
        return numbers

    def entries(self) -> dict[str, Any]:
        """Entries of the record besides the numbers."""
        count, spread = self.film.count, self.filtered.uncertainty
        entries: dict[str, Any] = {
            **verdict_entry(self.outcome),
            "size": list(count.shape),
            "samples_per_pixel": {"least": int(count.min()), "mean": float(count.mean()), "most": int(count.max())},
            names.DROPPED_SAMPLES: int(self.film.dropped.sum()),
            "similar_median": list(self.filtered.median_similar),
        }
        if spread is not None:
            covered = {} if self.coverage is None else {names.COVERAGE: self.coverage}
            entries["uncertainty"] = {"median": float(np.median(spread)), "most": float(spread.max()), **covered}
        if self.weights is not None:
            entries["blend"] = self.weights
        if self.decibels:
            entries["psnr_db"] = {
                name: {"clipped": clipped, "unclipped": unclipped}
                for name, (clipped, unclipped) in self.decibels.items()
            }
        return entries

    def files(self) -> dict[str, bytes | Callable[[Path], None]]:
        result, spread = self.filtered, self.filtered.uncertainty
        layers = {"": result.picture, **({} if spread is None else {"uncertainty": spread})}
        return {
            "filtered.tiff": described_tiff(float_tiff(result.picture), DESCRIPTION),
            "filtered.png": display_png(result.picture),
            "similar.npy": npy(result.similar, result.similar.dtype),
            **({} if spread is None else {"uncertainty.tiff": described_tiff(float_tiff(spread), UNCERTAINTY)}),
            **({"filtered.exr": partial(write_exr, layers=layers)} if self.exr else {}),
        }

    def page(self) -> bytes:
        from station.reports.ray_page import RenderRow, ray_page  # here: it draws, which is slow to load

        film, result = self.film, self.filtered
        shown: list[tuple[str, npt.NDArray[np.floating]]] = [("as rendered", film.mean), ("filtered", result.picture)]
        facts = [f"{film.count.mean():.0f} samples per pixel."]
        if self.truth is not None:
            shown.append(("converged", self.truth))
            before, after = (clipped for clipped, _ in self.decibels.values())
            facts.append(f"PSNR against the converged render: {before:.2f} dB as rendered, {after:.2f} dB filtered.")
        if result.uncertainty is not None:
            median = np.median(result.uncertainty)
            facts.append(f"Standard uncertainty of the filtered values: {median:.2g} in the median.")
        size = f"{film.count.shape[1]} x {film.count.shape[0]} pixels"
        row = RenderRow(size, tuple(shown), result.similar, tuple(facts))
        return ray_page("A render, and the same without its noise", (row,))


class Rays(Procedure[RaysSettings]):
    """Films filtered, each by itself or as the frames of a sequence."""

    name = "rays"
    title = "a Monte Carlo render without its noise"
    help = """Filter renders: each FILM is an npz of `image`, `hist` and `nsamples`, or of `samples`.

    Several are the frames of a sequence, in order: each is filtered with those before and after it, and has a folder
    of its own in --out."""
    inputs = Inputs.SEVERAL
    Settings = RaysSettings
    argument = "FILM..."
    suffixes = frozenset((".npz", ".exr"))
    results_key = "result"
    page_name = "rays.html"
    method = "ray histogram fusion: mean of patches whose sample histograms are alike, at several scales"

    def places(self, paths: Sequence[Path]) -> list[str]:
        if len(paths) == 1:
            return [""]
        twice = [stem for stem, n in Counter(path.stem for path in paths).items() if n > 1]
        if twice:
            remedy = "results are named after films: give each its name"
            raise BadParameter(f"several films are called {twice[0]}", remedy)
        return [path.stem for path in paths]

    def measure(
        self, paths: Sequence[Path], settings: RaysSettings, terms: Terms = USUAL, progress: Progress = silent
    ) -> Measurement:
        return next(self.measurements(paths, settings, terms, progress))

    def measurements(
        self, paths: Sequence[Path], settings: RaysSettings, terms: Terms = USUAL, progress: Progress = silent
    ) -> Iterator[Measurement]:
        """The picture of every film; films are read as they are needed."""
        settings.check_for(len(paths))
        for i, (film, filtered, weights) in enumerate(_filtered(paths, settings, progress)):
            truth = None if settings.reference is None else _reference(settings.reference, film.mean.shape)
            result = FilteredRender(film, filtered, truth, weights, settings.exr)
            yield self._measurement(result, settings, settings.sources(paths, i), len(paths)).compared(terms)

    def _measurement(
        self, result: FilteredRender, settings: RaysSettings, sources: Sequence[Path], films: int
    ) -> Measurement:
        given = {name: getattr(settings, name) for name in ("kappa", "scales", "search", "patch")}
        given |= {"published": True} if settings.published else {}
        given |= {name: True for name in ("blend", "oidn") if getattr(settings, name)}
        given |= {"reach": settings.reach} if films > 1 else {}
        read = files_read([InputFile(str(path), hashlib.sha256(path.read_bytes()).hexdigest()) for path in sources])
        head = RecordHead(self.name, read, given)
        plane = PlaneResult.of_outcome("render", result.outcome, values=result.numbers(), pitch=0)
        entries, files = result.entries(), result.files()
        if settings.budget is not None:
            more = allot(result.film, result.filtered.similar, settings.budget)
            files["more.npy"] = npy(more, more.dtype)
            entries["more_samples"] = {
                "all": int(more.sum()), "most": int(more.max()), "pixels_without": float((more == 0).mean())
            }  # fmt: skip
        return Measurement(
            self.schema, head, (plane,), entries=entries, files=files, results_key=self.results_key, result=result
        )

    def page(self, measurement: Measurement) -> bytes:
        return FilteredRender.page(measurement.result)

    def lines(self, measurement: Measurement) -> list[str]:
        similar = ", ".join(f"{n:.0f}" for n in measurement.entries["similar_median"])
        return [f"similar patches in the median, finest scale first: {similar}"]


def _filtered(
    paths: Sequence[Path], settings: RaysSettings, progress: Progress
) -> Iterator[tuple[Film, FilteredFilm, dict[str, float] | None]]:
    """Every film and its filtered picture, with the weights of a blend."""
    threads, kept = settings.threads or os.cpu_count() or 1, deque[Film]()

    if settings.blend:
        halves, whole = read_halves((*paths, *settings.add))
        progress(f"read {paths[0]}")
        denoiser = open_image_denoise if settings.oidn else None
        filtered, weights = blend(halves, whole, settings.parameters, denoiser=denoiser, threads=threads)
        yield whole.film, filtered, weights
        return

    def films() -> Iterator[Film]:
        for path in paths:
            kept.append(settings.read(path))
            progress(f"read {path}")
            yield kept[-1]

    if settings.neighbour:
        (film,) = films()
        others = [read_film(path) for path in settings.neighbour]
        yield film, filter_film(film, settings.parameters, neighbours=others, threads=threads), None
        return
    sequence = filter_sequence(
        films(), settings.parameters, reach=settings.reach, uncertain=settings.uncertainty, threads=threads
    )
    for frame in sequence:
        yield kept.popleft(), frame, None


def _reference(path: Path, shape: tuple[int, ...]) -> Picture:
    arrays, _ = read_npz(path, ("reference", "image"))
    truth = arrays.get("reference", arrays.get("image"))
    if truth is None:
        raise BadInput(f"{path} has no array `reference` or `image`", f"give a converged render of shape {shape}")
    return checked_array(truth, f"the reference {path}", shape, remedy="give a converged render of the film's size")
