"""A restoration's report: before, after, depth, what is left over, and the picture refocused, on one page."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from procedures.outcome import Outcome
from procedures.restoration.joint.result import Restoration, refocused
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.metres import Distances
from station.common.versions import software
from station.drawing.depth_pictures import encoded, levels, picture
from station.reports import psf_figures
from station.reports.page import render
from station.results.record_head import RecordHead

Array = npt.NDArray[np.floating[Any]]

WIDEST_PX = 720
"""Larger pictures are drawn smaller on the page; the files keep every pixel."""
KERNEL_PX = 240
"""A kernel's side on the page, at most."""
SPREAD_PX = 0.5
"""Standard deviation of w from which depth counts as not determined."""
FOCUS_AT = (("near", 90), ("in the middle", 50), ("far", 10))
"""Where the refocused pictures are sharp: percentiles of w."""


def restoration_page(
    outcome: Outcome[Restoration],
    photographs: Sequence[Array],
    head: RecordHead,
    distances: Distances | None = None,
) -> bytes:
    """The page, UTF-8, with its pictures inside.

    outcome : with a value; photographs : (C, H, W) each, 1 = white
    """
    found = outcome.value
    if found is None:
        raise ValueError("a restoration without a value has no page")
    white = float(np.percentile(photographs[0], 99.5))

    def shown(image: Array) -> str:
        return _uri(levels(_small(picture(image)), 0, white))

    return render(
        "restoration.html",
        outcome=outcome,
        head=head,
        diagnostics=found.diagnostics,
        w=tuple(float(one) * found.unit.per_pixel for one in (found.w.min(), found.w.max())),
        unit=found.unit.name,
        shifts=found.shifts[1:].tolist() if found.shifts.any() else [],
        turns=_turns(found),
        before=[shown(image) for image in photographs],
        after=shown(found.sharp),
        refocused=[(where, shown(image)) for where, image in _refocused(found)],
        **_maps(found),
        distances=_in_metres(distances),
        truth=found.ground_truth,
        difference=_difference(found),
        kernels=[_kernel(one) for one in (() if found.kernels is None else found.kernels)],
        course=psf_figures.course_figure(
            [r.n for r in found.history],
            [r.cost for r in found.history],
            [255 * r.residual for r in found.history],
            "course",
        ),
        software=software(),
    ).encode()


def _maps(found: Restoration) -> dict[str, Markup]:
    """Depth, its standard deviation, that of the picture, and what is left of photograph 1."""
    limit = psf_figures.RESIDUAL_LIMIT
    left_over = found.residual[0].mean(axis=0) / max(found.diagnostics.noise, 1e-9)
    unit = found.unit
    name = "pixels" if unit.name == "pixel" else unit.name
    w = _small(found.w * unit.per_pixel)
    return {
        "depth": psf_figures.map_figure(
            w, f"w in {name}", "depth", colours="viridis", limits=(float(w.min()), float(w.max()))
        ),
        "spread": psf_figures.map_figure(
            _small(found.w_std * unit.per_pixel),
            f"standard deviation of w in {name}",
            "spread",
            colours="magma",
            limits=(0.0, SPREAD_PX * unit.per_pixel),
        ),
        "uncertain": psf_figures.map_figure(
            _small(found.sharp_std),
            "standard deviation of the picture, white = 1",
            "uncertain",
            colours="magma",
            limits=(0.0, float(np.percentile(found.sharp_std, 99))),
        ),
        "residual": psf_figures.map_figure(
            _small(left_over),
            "photograph 1 less prediction, in σ of the noise",
            "residual",
            colours="RdBu_r",
            limits=(-limit, limit),
        ),
    }


def _difference(found: Restoration) -> Markup | None:
    """The picture less the ground truth, of all planes; None where there was none."""
    if found.ground_truth is None:
        return None
    off = _small(found.ground_truth.difference.mean(axis=0))
    limit = 3 * max(found.ground_truth.told, 1e-6)
    words = "picture less ground truth, white = 1"
    return psf_figures.map_figure(off, words, "difference", colours="RdBu_r", limits=(-limit, limit))


def _turns(found: Restoration) -> list[tuple[float, float]]:
    """Turn in degrees and zoom of each photograph after the first; none where none was taken up."""
    if not found.turns.any():
        return []
    return [(float(np.rad2deg(a)), float(b)) for a, b in zip(found.turns[1:], found.zooms[1:], strict=True)]


def _in_metres(found: Distances | None) -> dict[str, Any] | None:
    """Maps of the distance and its standard uncertainty, and their numbers; None where no distance is told."""
    if found is None or not found.told:
        return None
    least, greatest = (float(one) for one in np.nanpercentile(found.metres, (0.5, 99.5)))
    most = float(np.nanpercentile(found.std, 95))
    return {
        "range": (least, greatest),
        "std": float(np.nanmedian(found.std)),
        "told": found.told,
        "map": psf_figures.map_figure(
            _small(found.metres), "distance in m", "distance", colours="viridis", limits=(least, greatest)
        ),
        "spread": psf_figures.map_figure(
            _small(found.std), "standard uncertainty in m", "distance_std", colours="magma", limits=(0.0, most)
        ),
    }


def _refocused(found: Restoration) -> list[tuple[str, Array]]:
    """The sharp picture as a lens of the photographs' depth of focus would show it, focused at three depths.

    Blur grows with the distance from the plane of focus; it is a blur circle, whatever blurred the photographs.
    """
    reach = float(found.w.max() - found.w.min())
    if reach < 0.5:
        return []
    stack = mask_stack(pillbox(), reach)
    return [(where, refocused(found, stack, float(np.percentile(found.w, p)))) for where, p in FOCUS_AT]


def _kernel(kernel: Array) -> str:
    """A kernel's pixels as squares, its greatest value white."""
    side = max(1, KERNEL_PX // len(kernel))
    return _uri(levels(np.kron(kernel, np.ones((side, side))), 0, float(kernel.max())))


def _small(image: Array) -> Array:
    import cv2

    factor = WIDEST_PX / max(image.shape[:2])
    if factor >= 1:
        return image
    return np.asarray(cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA))


def _uri(image: npt.NDArray[np.uint8]) -> str:
    return "data:image/png;base64," + base64.b64encode(encoded(".png", image)).decode()
