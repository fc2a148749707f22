"""Film files: npz for reading and writing, and the multichannel OpenEXR of the renderer published with the method.

A film's npz holds `image` (rows, columns, 3) linear, `hist` (rows, columns, 3, 20) and `nsamples` (rows, columns), in
any precision; `variance` (rows, columns, 3) of single samples and `dropped` (rows, columns) are optional. An npz with
`samples` (rows, columns, n, 3) instead is converted to a film.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array
from procedures.outcome import BadInput
from procedures.ray_histogram.film import BINS, Film, film_of_samples
from procedures.reading.arrays import Arrays, Shape, checked_array, read_npz
from procedures.reading.exr import read_exr

PARTS = ("samples", "image", "hist", "nsamples", "variance", "dropped")
"""The arrays of a film; others in the file are ignored."""


def read_film(path: Path | str, picture: Path | None = None) -> Film:
    """Read a film from an npz, or from an OpenEXR of histograms with its picture.

    path : Path, `.npz`, or `.exr` with channels `Bin_0000` to `Bin_0060`: 20 bins of each colour, then the count
    picture : Path, the OpenEXR with the picture's R, G and B, if `path` does not contain them. The published renderer
        writes two files: histograms in single precision, and the picture in half precision with alpha and, for a part
        of the frame, with that part's data window. Tested with files of this layout written by the package OpenEXR, not
        with files of the renderer itself.

    Raises BadInput if the file cannot be read, or something is missing; `Film.checked` checks the contents.
    """
    path = Path(path)
    if path.suffix.lower() == ".exr":
        return _read_exr(path, picture)
    return _film_of_arrays(*read_npz(path, PARTS, "give a film, or an array `samples`"))


def write_film(film: Film, path: Path) -> None:
    """Write a film as npz, atomically."""
    arrays: dict[str, Any] = {
        "image": film.mean,
        "hist": film.histogram,
        "nsamples": film.count,
        "dropped": film.dropped,
    }
    if film.variance is not None:
        arrays["variance"] = film.variance
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        np.savez_compressed(file, **arrays)  # numbers only; older NumPy takes `allow_pickle` for one more array
    os.replace(part, path)


def _film_of_arrays(arrays: Arrays, names: list[str]) -> Film:
    if "samples" in arrays:
        return film_of_samples(_real(arrays, "samples", (None, None, None, 3)))
    missing = {"image", "hist", "nsamples"} - set(arrays)
    if missing:
        raise BadInput(
            f"a film needs image, hist and nsamples; {', '.join(sorted(missing))} missing among the arrays {names}",
            "give `image`, `hist` and `nsamples`, or `samples`",
        )
    counts = _whole(arrays["nsamples"], "`nsamples`", (None, None))
    size = counts.shape
    variance = _real(arrays, "variance", (*size, 3)) if "variance" in arrays else None
    return Film(
        np.ascontiguousarray(_real(arrays, "hist", (*size, 3, BINS)), np.float32),
        _real(arrays, "image", (*size, 3)).astype(np.float64),
        None if variance is None else variance * np.maximum(counts.astype(np.float64) - 1.0, 1.0)[..., None],
        counts,
        _whole(arrays["dropped"], "`dropped`", size) if "dropped" in arrays else np.zeros(size, np.uint32),
    )


def _real(arrays: Arrays, name: str, shape: Shape) -> npt.NDArray[Any]:
    """An array in its own precision; `Film.checked` reports pixels that are not finite."""
    return checked_array(arrays[name], f"`{name}`", shape, finite=False, dtype=None, remedy="write the film again")


def _whole(numbers: npt.NDArray[Any], what: str, shape: Shape) -> npt.NDArray[np.uint32]:
    high = float(np.iinfo(np.uint32).max)
    remedy = "write the film again"
    counts: Array = checked_array(numbers, what, shape, low=-0.5, high=high, remedy=remedy)
    return np.rint(counts).astype(np.uint32)


def _read_exr(path: Path, picture: Path | None) -> Film:
    names = [f"Bin_{i:04d}" for i in range(3 * BINS + 1)]
    channels, present = read_exr(path, {*names, *"RGB"})
    missing = [name for name in names if name not in channels]
    if missing:
        raise BadInput(f"{path} has no channel {missing[0]}", f"give histograms as {names[0]} to {names[-1]}")
    more = [name for name in present if name.startswith("Bin_") and name not in names]
    if more:
        raise BadInput(
            f"a film has {BINS} bins per colour; {path} has channels up to {more[-1]}", f"render with {BINS} bins"
        )
    colours = channels if picture is None else read_exr(picture, "RGB")[0]
    if not {"R", "G", "B"} <= set(colours):
        raise BadInput(f"{picture or path} has no channels R, G and B", "give the OpenEXR of the picture as well")
    image = np.stack([colours[name] for name in "RGB"], axis=-1)
    histogram = np.stack([channels[name] for name in names[:-1]], axis=-1)
    parts = {"image": image, "hist": histogram.reshape(*histogram.shape[:2], 3, BINS), "nsamples": channels[names[-1]]}
    return _film_of_arrays(parts, [*parts])
