"""Sequences: every frame is filtered with its neighbours in time, with few frames in memory."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain
from typing import TypeVar

from procedures.outcome import BadParameter
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.filter import FilterParameters
from procedures.ray_histogram.multiscale import FilteredFilm, filter_film
from procedures.ray_histogram.uncertainty import standard_uncertainty

T = TypeVar("T")


def filter_sequence(
    films: Iterable[Film],
    parameters: FilterParameters | None = None,
    *,
    reach: int = 1,
    uncertain: bool = False,
    threads: int = 1,
) -> Iterator[FilteredFilm]:
    """Filter every film of a sequence, in order; a single film is a sequence too.

    Films are read when needed: 2 `reach` + 1 are held in memory, twice as many with uncertainties.

    Raises BadParameter if the reach is negative, BadInput if a film cannot be filtered or its neighbours differ in
    size.

    films : iterable of Film, the frames in time
    parameters : FilterParameters, the defaults if None
    reach : int, frames before and after in which similar patches are searched for; 0 filters each frame by itself
    uncertain : bool
        Whether to estimate the standard uncertainty of each picture: one more filtering, with nine times the channels.
    threads : int, bands filtered at once
    """
    if reach < 0:
        raise BadParameter(f"the reach is 0 frames or more; got {reach}", "choose 0 or more")
    parameters = parameters or FilterParameters()
    frames = (
        (film, filter_film(film, parameters, neighbours=others, threads=threads))
        for film, others in _windows(films, reach)
    )
    if not uncertain:
        yield from (filtered for _, filtered in frames)
        return
    for (film, filtered), others in _windows(frames, reach):
        pictures = [(other, its.picture) for other, its in others]
        sigma = standard_uncertainty(film, filtered.picture, parameters, neighbours=pictures, threads=threads)
        yield replace(filtered, uncertainty=sigma)


def _windows(frames: Iterable[T], reach: int) -> Iterator[tuple[T, list[T]]]:
    window: deque[T | None] = deque([None] * (2 * reach + 1), maxlen=2 * reach + 1)
    for frame in chain(frames, [None] * reach):
        window.append(frame)
        middle = window[reach]
        if middle is not None:
            yield middle, [other for other in window if other is not None and other is not middle]
