"""Renders as two halves of their samples: one npz of samples, or two files of the same picture with other seeds.

A layered OpenEXR has the layers of Blender, Mitsuba or Arnold: the picture, and as far as present albedo, normal and
depth. It has no histograms: the variance of the picture is a layer, or follows from the difference of the two files.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from procedures.numerics.arrays import Array, Array32
from procedures.outcome import BadInput
from procedures.ray_histogram.blend import Render, divisor
from procedures.ray_histogram.film import Film, film_of_samples
from procedures.reading.arrays import checked_array, read_npz
from procedures.reading.exr import read_exr

Layers = Mapping[str, npt.NDArray[Any]]
Halves = tuple[tuple[Render, Render], Render]

LAYERS = {
    "image": ("", "combined", "noisy image", "rgba", "beauty"),
    "albedo": ("albedo", "denoising albedo", "diffuse_albedo"),
    "normal": ("normal", "denoising normal", "n", "nn", "sh_normal"),
    "depth": ("depth", "denoising depth", "z", "dd"),
    "variance": ("variance", "denoising image variance"),
}
"""Names of the layers, without the render layer's name before them, in lower case; the first that is present counts."""
COMPONENTS = {"image": "rgb", "albedo": "rgb", "normal": "xyz", "depth": "zvtryx", "variance": "rgb"}
"""Components; of the depth the first that is present."""
NORMAL_STEP, DEPTH_STEP = 0.1, 0.02  # differences of normals, and of depths over the median depth, that matter
VARIANCE_PX = 1.0
"""Standard deviation of the neighbourhood over which the squared difference of two pictures is averaged."""
MEDIAN_SIDE, MOST_OVER_MEDIAN = 3, 4.0
"""Side of the neighbourhood whose median limits that mean, and the factor between the two."""
MEDIAN_OF_SQUARES = 0.455  # median of the square of a normal variable with unit variance


def read_halves(paths: Iterable[Path]) -> Halves:
    """The two halves of a render, and all of it.

    Raises BadInput if a file cannot be read, or the files do not make two halves.

    paths : iterable of Path, an npz of `samples` (rows, columns, n, 3), optionally with `albedo`, `normal` (rows,
        columns, n, 3) and `depth` (rows, columns, n) of the samples or (rows, columns, ...) of the pixels; or two
        OpenEXR pictures with other random numbers
    """
    files = tuple(paths)
    if len(files) == 2 and all(path.suffix.lower() == ".exr" for path in files):
        return halves_of_pictures(read_layers(files[0]), read_layers(files[1]))
    if len(files) == 1 and files[0].suffix.lower() == ".npz":
        arrays, names = read_npz(files[0], ("samples", "albedo", "normal", "depth"), "give an array `samples`")
        if "samples" in arrays:
            return halves_of_samples(arrays)
        raise BadInput(f"a blend needs the samples; {files[0]} has the arrays {names}", "give an array `samples`")
    raise BadInput(
        f"a blend needs an npz of samples, or two OpenEXR pictures; got {', '.join(path.name for path in files)}",
        "name the second picture, rendered with another seed, by --add",
    )


def halves_of_samples(arrays: Layers) -> Halves:
    """Even and odd samples."""
    samples = checked_array(arrays["samples"], "`samples`", (None, None, None, 3), finite=False, dtype=None)
    rows, columns, n, _ = samples.shape
    if n < 4:
        raise BadInput(f"a blend needs 4 samples per pixel or more; got {n}", "cast more samples")
    features = {}
    for name, last in (("albedo", (3,)), ("normal", (3,)), ("depth", ())):
        if name in arrays:
            each = (n,) if arrays[name].ndim == 3 + len(last) else ()
            features[name] = checked_array(arrays[name], f"`{name}`", (rows, columns, *each, *last))
    parts = slice(0, None, 2), slice(1, None, 2), slice(None)
    first, second, whole = (_of_samples(samples, features, part) for part in parts)
    return (first, second), whole


def _of_samples(samples: npt.NDArray[Any], features: Mapping[str, Array], part: slice) -> Render:
    chosen = samples[:, :, part]
    means: dict[str, Array] = {}
    variances: dict[str, Array] = {}
    for name, values in features.items():
        each = values.ndim == (3 if name == "depth" else 4)
        chosen_values = values[:, :, part] if each else values[:, :, None]
        means[name] = chosen_values.mean(2)
        variances[name] = chosen_values.var(2) / max(chosen_values.shape[2] - 1, 1)
    if "albedo" not in means:
        return Render(film_of_samples(chosen), guides=_guides(means, variances))
    light = film_of_samples(chosen / divisor(means["albedo"])[:, :, None])
    return Render(film_of_samples(chosen), means["albedo"], light, means.get("normal"), _guides(means, variances))


def halves_of_pictures(first: Layers, second: Layers) -> Halves:
    """Two pictures of the layers of `read_layers` as halves of one render."""
    if first["image"].shape != second["image"].shape:
        raise BadInput(
            f"two halves need one size; got {first['image'].shape[:2]} and {second['image'].shape[:2]} pixels",
            "render the same picture twice",
        )
    common = [name for name in first if name in second]
    whole = {name: (first[name] + second[name]) / 2 for name in common}
    squares = {name: _variance(first[name] - second[name]) for name in common}
    if "variance" in common:  # of samples or of their mean: the difference says which
        stated = np.maximum(whole["variance"], 0)
        squares["image"] = stated * (np.sum((first["image"] - second["image"]) ** 2) / max(stated.sum(), 1e-30))
    a, b, both = (
        _of_means(means, {name: share * square for name, square in squares.items()})
        for means, share in ((first, 0.5), (second, 0.5), (whole, 0.25))
    )
    return (a, b), both


def _of_means(means: Layers, variances: Mapping[str, Array]) -> Render:
    film = _film(means["image"], variances["image"])
    if "albedo" not in variances:
        return Render(film, guides=_guides(means, variances))
    reflected = divisor(means["albedo"])
    light = _film(means["image"] / reflected, variances["image"] / reflected**2)
    return Render(film, means["albedo"], light, means.get("normal"), _guides(means, variances))


def _film(mean: Array, variance: Array) -> Film:
    """A film without histograms; it counts two samples, as fewer have no variance."""
    count = np.full(mean.shape[:2], 2, np.uint32)
    return Film(np.zeros((*mean.shape, 0), np.float32), mean, 2 * variance, count, np.zeros_like(count))


def _guides(means: Layers, variances: Mapping[str, Array]) -> Array32 | None:
    """Normal and depth in units of the differences that matter, and their variances with that of such a difference."""
    values, squares = [], []
    if "normal" in variances:
        values.append(means["normal"] / NORMAL_STEP)
        squares.append(variances["normal"] / NORMAL_STEP**2)
    if "depth" in variances:
        step = DEPTH_STEP * max(float(np.median(means["depth"])), 1e-12)
        values.append(means["depth"][..., None] / step)
        squares.append(variances["depth"][..., None] / step**2)
    if not values:
        return None
    return np.concatenate([*values, *(square + 0.5 for square in squares)], axis=-1).astype(np.float32)


def _variance(difference: Array) -> Array:
    """Variance of the difference of two pictures: the mean square around each pixel.

    It is limited where the pixel itself and the median around are far below the mean: beside a lamp's rim.
    """
    squares, other = difference**2, difference.ndim - 2
    mean = ndimage.gaussian_filter(squares, (VARIANCE_PX, VARIANCE_PX) + (0,) * other)
    median = ndimage.median_filter(squares, (MEDIAN_SIDE, MEDIAN_SIDE) + (1,) * other) / MEDIAN_OF_SQUARES
    return np.asarray(np.minimum(mean, MOST_OVER_MEDIAN * np.maximum(squares, median)))


def read_layers(path: Path) -> dict[str, Array]:
    """Picture, and as far as present albedo, normal, depth and variance, of a layered OpenEXR.

    Raises BadInput if the file cannot be read, has no picture, or a value that is not finite.
    """
    channels, names = read_exr(path)
    layers = {name: layer for name in LAYERS if (layer := _layer(name, channels)) is not None}
    if "image" not in layers:
        present = ", ".join(names)
        raise BadInput(f"{path} needs a picture of channels R, G and B; it has {present}", "write the picture too")
    return {name: checked_array(layer, f"{name} of {path}", (None,) * layer.ndim) for name, layer in layers.items()}


def _layer(name: str, channels: Layers) -> npt.NDArray[Any] | None:
    by_name = {tuple(part.lower() for part in _parts(channel)): values for channel, values in channels.items()}
    for layer in LAYERS[name]:
        if name == "depth":
            present = [by_name[layer, one] for one in COMPONENTS[name] if (layer, one) in by_name]
            present += [by_name["", layer]] if ("", layer) in by_name else []
            if present:
                return present[0]
        for names in (COMPONENTS[name], "rgb"):
            if all((layer, one) in by_name for one in names):
                return np.stack([by_name[layer, one] for one in names], axis=-1)
    return None


def _parts(channel: str) -> tuple[str, str]:
    """Layer and component of a channel's name: ("Denoising Albedo", "R") of "ViewLayer.Denoising Albedo.R"."""
    *layers, component = channel.split(".")
    return (layers[-1] if layers else "", component)
