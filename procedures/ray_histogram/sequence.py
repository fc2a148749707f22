"""Whole sequences: every frame is filtered with those before and after it, and few of them are held at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain
from typing import NamedTuple, TypeVar

from procedures.outcome import BadParameter
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.filter import FilterParameters
from procedures.ray_histogram.multiscale import FilteredFilm, filter_film
from procedures.ray_histogram.uncertainty import standard_uncertainty

T = TypeVar("T")


class _Frame(NamedTuple):
    film: Film
    found: FilteredFilm


def filter_sequence(
    films: Iterable[Film],
    parameters: FilterParameters | None = None,
    *,
    reach: int = 1,
    uncertain: bool = False,
    threads: int = 1,
) -> Iterator[FilteredFilm]:
    """Every film's picture without its noise, in order; one film is a sequence too.

    Films are taken as they are needed: 2 `reach` + 1 are held, twice as many where uncertainties are told.

    Parameters
    ----------
    films : iterable of Film
        The frames in time.
    parameters : FilterParameters
        The defaults if None.
    reach : int
        Frames before, and after, in which similar patches are sought; 0 filters each by itself.
    uncertain : bool
        Whether to tell the standard uncertainty of each picture: one more filtering, with nine times the channels.
    threads : int
        Bands filtered at once.

    Raises
    ------
    BadParameter
        If the reach is negative.
    BadInput
        If a film cannot be filtered or has another size than those beside it.
    """
    if reach < 0:
        raise BadParameter(f"a reach of {reach} frames", "choose 0 or more")
    parameters = parameters or FilterParameters()
    frames = _filtered(films, parameters, reach, threads)
    if not uncertain:
        yield from (frame.found for frame in frames)
        return
    for here, others in _windows(frames, reach):
        beside = [(one.film, one.found.picture) for one in others]
        told = standard_uncertainty(here.film, here.found.picture, parameters, neighbours=beside, threads=threads)
        yield replace(here.found, uncertainty=told)


def _filtered(films: Iterable[Film], parameters: FilterParameters, reach: int, threads: int) -> Iterator[_Frame]:
    for film, others in _windows(films, reach):
        yield _Frame(film, filter_film(film, parameters, neighbours=others, threads=threads))


def _windows(frames: Iterable[T], reach: int) -> Iterator[tuple[T, list[T]]]:
    """Each frame with those up to `reach` before and after it."""
    held: deque[T | None] = deque([None] * (2 * reach + 1), maxlen=2 * reach + 1)
    for frame in chain(frames, [None] * reach):
        held.append(frame)
        here = held[reach]
        if here is not None:
            yield here, [one for one in held if one is not None and one is not here]
