"""Before the estimate of a restoration: the predicted error of the picture, and how the camera has moved since the
first photograph.
"""

import base64
import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np

from procedures.numerics.arrays import Array
from procedures.plan import Goal, Outline, Points, Shake
from procedures.raw import Plane
from procedures.restoration.facts import APERTURES, YES, RestorationFacts

SIZE, USUAL = 64, 0.5
"""Frequencies along each axis; usual blur over the widest one."""
DISC: Array = np.sqrt((np.arange(200) + 0.5) / 200)[:, None] * np.stack(
    [trig(np.arange(200) * math.pi * (3 - 5**0.5)) for trig in (np.cos, np.sin)], axis=1
)
"""Points of the unit disc at equal density."""
ACROSS_DEG = (0.0, 90.0, 45.0)
"""Directions of motions whose paths are not known before the estimate."""
VIEW, INSET, CLEAR = (32, 24), 0.1, 0.1
"""Columns and rows of the first photograph's view; inset of its outline; least height of the correlation's peak."""


def progress(taken: int, known: RestorationFacts, path: Callable[[str], Shake | None]) -> Goal:
    """The predicted error of the picture by the photographs `taken` and by one more, from the first one's noise."""
    left = known.photographs + (known.ground_truth == YES) - taken
    if known.first_noise is None or known.first_contrast is None:
        return Goal(left)
    share = USUAL * (known.max_w or 0.0)
    points = [share * blur_points(which, known, path(which)) for which in known.blurred]
    now, after = (100 * picture_error(points[:n], known.first_noise, known.first_contrast) for n in (taken, taken + 1))
    return Goal(left, "Predicted error of the picture", "% of white", now, after)


def blur_points(which: str, known: RestorationFacts, shake: Shake | None) -> Array:
    """Points (n, 2) of a photograph's blur over the widest one. Motions by hand are straight, across each other."""
    widest = min((f_number for name in known.blurred if (f_number := known.f_numbers[name])), default=None)
    f_number = known.f_numbers[which]
    if known.blur_by == APERTURES and widest and f_number:
        return DISC * (widest / f_number)
    if shake is not None:
        points = np.stack([shake.shares["x_mm"], shake.shares["y_mm"]], axis=1)
        return np.asarray(points / np.abs(points).max())
    angle = math.radians(ACROSS_DEG[known.blurred.index(which)])
    return np.outer(np.linspace(-1, 1, len(DISC)), (math.cos(angle), math.sin(angle)))


def picture_error(blurs: Sequence[Array], noise: float, contrast: float) -> float:
    """Root mean square error of the best linear restoration of a scene with spectrum 1/f^2 and this contrast.

    blurs : points (n, 2) of each photograph's blur, in pixels; infinite without a photograph
    """
    if not blurs:
        return math.inf
    f = np.fft.fftfreq(SIZE)
    grid = np.stack(np.meshgrid(f, f), axis=-1).reshape(-1, 2)[1:]
    power = sum(np.abs(np.exp(-2j * np.pi * grid @ points.T).mean(axis=1)) ** 2 for points in blurs)
    scene = 1 / (grid**2).sum(axis=1)
    scene *= contrast**2 / scene.mean()
    return float(np.sqrt(np.mean(1 / (power / noise**2 + 1 / scene))))


def view_of(plane: Plane) -> str:
    """A small copy of a plane as text, which a session stores."""
    small = cv2.resize(plane.samples, VIEW, interpolation=cv2.INTER_AREA)
    levels = np.clip(255 * small / max(float(small.max()), 1e-6), 0, 255).astype(np.uint8)
    return base64.b64encode(levels.tobytes()).decode()


def moved(plane: Plane, first_view: str | None) -> Outline | None:
    """The view of the first photograph in this one, and where it belongs; None where it is not recognised."""
    if first_view is None:
        return None
    first, now = (
        np.frombuffer(base64.b64decode(one), np.uint8).reshape(VIEW[::-1]).astype(np.float64)
        for one in (first_view, view_of(plane))
    )
    window = cv2.createHanningWindow(VIEW, cv2.CV_64F)
    (dx, dy), peak = cv2.phaseCorrelate(first - first.mean(), now - now.mean(), window)
    if peak < CLEAR:
        return None
    rows, columns = plane.samples.shape
    low, high = INSET, 1 - INSET
    wanted = [(x * columns, y * rows) for x, y in ((low, low), (high, low), (high, high), (low, high))]
    present: Points = tuple((x + dx * columns / VIEW[0], y + dy * rows / VIEW[1]) for x, y in wanted)
    return Outline(present, tuple(wanted))
