"""Report page of a restoration: before, after, depth, residual, and the refocused picture."""

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
from station.drawing.pictures import encoded, levels, picture
from station.reports import psf_figures
from station.reports.page import render
from station.results.record_head import RecordHead

Array = npt.NDArray[np.floating[Any]]

WIDEST_PX = 720
"""Larger pictures are drawn smaller on the page; the files keep every pixel."""
KERNEL_PX = 240
"""Largest side of a kernel on the page."""
SPREAD_PX = 0.5
"""Standard deviation of w above which depth is undetermined."""
FOCUS_AT = (("near", 90), ("in the middle", 50), ("far", 10))
"""Depths of focus of the refocused pictures: percentiles of w."""


def restoration_page(
    outcome: Outcome[Restoration],
    photographs: Sequence[Array],
    head: RecordHead,
    distances: Distances | None = None,
) -> bytes:
    """The page, UTF-8, with embedded pictures.

    outcome : with a value; photographs : (C, H, W) each, 1 = white
    """
    restoration = outcome.value
    if restoration is None:
        raise ValueError("a restoration without a value has no page")
    white = float(np.percentile(photographs[0], 99.5))

    def shown(image: Array) -> str:
        return _uri(levels(_small(picture(image)), 0, white))

    return render(
        "restoration.html",
        outcome=outcome,
        head=head,
        diagnostics=restoration.diagnostics,
        w=tuple(float(each) * restoration.unit.per_pixel for each in (restoration.w.min(), restoration.w.max())),
        unit=restoration.unit.name,
        shifts=restoration.shifts[1:].tolist() if restoration.shifts.any() else [],
        turns=_turns(restoration),
        before=[shown(image) for image in photographs],
        after=shown(restoration.sharp),
        refocused=[(where, shown(image)) for where, image in _refocused(restoration)],
        **_maps(restoration),
        distances=_in_metres(distances),
        truth=restoration.ground_truth,
        difference=_difference(restoration),
        kernels=[_kernel(each) for each in (() if restoration.kernels is None else restoration.kernels)],
        course=psf_figures.course_figure(
            [r.n for r in restoration.history],
            [r.cost for r in restoration.history],
            [255 * r.residual for r in restoration.history],
            "course",
        ),
        software=software(),
    ).encode()


def _maps(restoration: Restoration) -> dict[str, Markup]:
    limit = psf_figures.RESIDUAL_LIMIT
    residual = restoration.residual[0].mean(axis=0) / max(restoration.diagnostics.noise, 1e-9)
    unit = restoration.unit
    name = "pixels" if unit.name == "pixel" else unit.name
    w = _small(restoration.w * unit.per_pixel)
    return {
        "depth": psf_figures.map_figure(
            w, f"w in {name}", "depth", colours="viridis", limits=(float(w.min()), float(w.max()))
        ),
        "spread": psf_figures.map_figure(
            _small(restoration.w_std * unit.per_pixel),
            f"standard deviation of w in {name}",
            "spread",
            colours="magma",
            limits=(0.0, SPREAD_PX * unit.per_pixel),
        ),
        "uncertain": psf_figures.map_figure(
            _small(restoration.sharp_std),
            "standard deviation of the picture, white = 1",
            "uncertain",
            colours="magma",
            limits=(0.0, float(np.percentile(restoration.sharp_std, 99))),
        ),
        "residual": psf_figures.map_figure(
            _small(residual),
            "photograph 1 less prediction, in σ of the noise",
            "residual",
            colours="RdBu_r",
            limits=(-limit, limit),
        ),
    }


def _difference(restoration: Restoration) -> Markup | None:
    if restoration.ground_truth is None:
        return None
    off = _small(restoration.ground_truth.difference.mean(axis=0))
    limit = 3 * max(restoration.ground_truth.stated_error, 1e-6)
    words = "picture less ground truth, white = 1"
    return psf_figures.map_figure(off, words, "difference", colours="RdBu_r", limits=(-limit, limit))


def _turns(restoration: Restoration) -> list[tuple[float, float]]:
    """Rotation in degrees and zoom of each photograph after the first; none if none was corrected."""
    if not restoration.turns.any():
        return []
    return [(float(np.rad2deg(a)), float(b)) for a, b in zip(restoration.turns[1:], restoration.zooms[1:], strict=True)]


def _in_metres(restoration: Distances | None) -> dict[str, Any] | None:
    if restoration is None or not restoration.determined:
        return None
    least, greatest = (float(each) for each in np.nanpercentile(restoration.metres, (0.5, 99.5)))
    most = float(np.nanpercentile(restoration.std, 95))
    return {
        "range": (least, greatest),
        "std": float(np.nanmedian(restoration.std)),
        "determined": restoration.determined,
        "map": psf_figures.map_figure(
            _small(restoration.metres), "distance in m", "distance", colours="viridis", limits=(least, greatest)
        ),
        "spread": psf_figures.map_figure(
            _small(restoration.std), "standard uncertainty in m", "distance_std", colours="magma", limits=(0.0, most)
        ),
    }


def _refocused(restoration: Restoration) -> list[tuple[str, Array]]:
    """The sharp picture for a lens of the photographs' depth of focus, focused at three depths.

    Blur grows with the distance from the plane of focus; it is a blur circle, whatever blurred the photographs.
    """
    reach = float(restoration.w.max() - restoration.w.min())
    if reach < 0.5:
        return []
    stack = mask_stack(pillbox(), reach)
    return [(where, refocused(restoration, stack, float(np.percentile(restoration.w, p)))) for where, p in FOCUS_AT]


def _kernel(kernel: Array) -> str:
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
