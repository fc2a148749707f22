"""Template of the chart's frame, and its agreement with a rectified picture: positions, orientation, score."""

from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, Array32, Mask
from procedures.numerics.warps import apply_homography
from procedures.pattern import BLACK_BLOCKS, BLOCK, BLOCKS, CELLS, X_CORNER_BLOCKS, X_CORNERS
from procedures.pattern_psf.chart_finding.corner_layouts import RIM_CELLS, Layouts

PIXELS = 16  # pixels of the rectified picture per block
RIM_BLOCKS = 1  # blocks of surroundings rectified around the chart
SIDE = (BLOCKS + 2 * RIM_BLOCKS) * PIXELS
PIXELS_PER_CELL = PIXELS / BLOCK
ORIGIN = -BLOCK * (1 + RIM_BLOCKS)  # cell coordinate of the rectified picture's top left edge
BLUR = 0.1 * PIXELS  # blur of the template, that of a typical photograph; the agreement hardly depends on it
SCREEN_SAMPLES = 4  # samples of a block along one side when candidates are screened
SCREENED_AT_ONCE = 128  # candidates whose samples fit the processor's cache together
MARK_HALF, SEARCH = 5, 6  # half the side of a mark's template, and the greatest offset searched, in rectified pixels

H_CELLS_RECTIFIED: Array = np.array(
    [
        [1 / PIXELS_PER_CELL, 0, ORIGIN + 0.5 / PIXELS_PER_CELL],
        [0, 1 / PIXELS_PER_CELL, ORIGIN + 0.5 / PIXELS_PER_CELL],
        [0, 0, 1],
    ]
)


@cache
def expected() -> Array32:
    """Rectified chart, black 0, white 1, its noise region 1/2."""
    picture = np.ones((SIDE, SIDE), dtype=np.float32)
    for place in BLACK_BLOCKS:
        picture[_pixels_of(*place)] = 0.0
    for place in X_CORNER_BLOCKS:
        # an x-corner's block, its pixels the means of 8 x 8 points
        fine = 8
        t = np.abs((np.arange(PIXELS * fine) + 0.5) / (PIXELS * fine) - 0.5)
        points = (t[:, None] < t).reshape(PIXELS, fine, PIXELS, fine)
        picture[_pixels_of(*place)] = np.asarray(points.mean(axis=(1, 3)), dtype=np.float32)
    noise = slice((RIM_BLOCKS + 1) * PIXELS, -(RIM_BLOCKS + 1) * PIXELS)
    picture[noise, noise] = 0.5
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), BLUR), dtype=np.float32)


def _pixels_of(column: int, row: int) -> tuple[slice, slice]:
    first = np.array([row, column]) + RIM_BLOCKS
    rows, columns = (slice(at * PIXELS, (at + 1) * PIXELS) for at in first.tolist())
    return rows, columns


@cache
def ring() -> Mask:
    """Mask of the frame in the rectified picture: the blocks around the noise region, a quarter block off it."""
    mask = np.zeros((SIDE, SIDE), dtype=np.bool_)
    outer, inner = RIM_BLOCKS * PIXELS, (RIM_BLOCKS + 1) * PIXELS - PIXELS // 4
    mask[outer:-outer, outer:-outer] = True
    mask[inner:-inner, inner:-inner] = False
    return mask


@cache
def oriented_frames() -> Array32:
    """Template in each of the eight orientations, (8, SIDE, SIDE)."""
    return np.stack([template for _, template in symmetries()])


@cache
def symmetries() -> tuple[tuple[Array, Array32], ...]:
    """Symmetries of the square as maps of cells onto cells, each with the template in that orientation."""
    maps = []
    for swap in (False, True):
        for flip_x in (False, True):
            for flip_y in (False, True):
                template = expected()[:: -1 if flip_y else 1, :: -1 if flip_x else 1]
                flips = np.diag([-1.0 if flip_x else 1.0, -1.0 if flip_y else 1.0, 1.0])
                flips[:2, 2] = CELLS * (np.diag(flips)[:2] < 0)
                g = flips @ np.eye(3)[[1, 0, 2]] if swap else flips
                maps.append((g, np.ascontiguousarray(template.T if swap else template)))
    return tuple(maps)


def rectify(image: Array32, H_image_cells: Array) -> Array32:
    """Array32 resampled to the chart's coordinates (SIDE, SIDE), NaN outside the photograph."""
    return np.asarray(
        cv2.warpPerspective(
            image,
            H_image_cells @ H_CELLS_RECTIFIED,
            (SIDE, SIDE),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=float("nan"),
        ),
        dtype=np.float32,
    )


def agreements(rectified: Array32, frames: Array32, where: Mask) -> Array:
    """Correlations (n,), 0 to 1, of a rectified picture with templates T (n, SIDE, SIDE) under linear light: the root
    of the share of the variance about a(x, y) that b(x, y) T explains."""
    rows, columns = np.nonzero(where & np.isfinite(rectified))
    if len(rows) < ring().sum() / 3:
        return np.zeros(len(frames))
    values = rectified[rows, columns].astype(np.float64)
    light = np.column_stack([np.ones(len(rows)), columns / SIDE - 0.5, rows / SIDE - 0.5])
    pairs = (light[:, :, None] * light[:, None]).reshape(len(rows), 9)
    t = frames[:, rows, columns].astype(np.float64)
    alone, cross, square = (m.reshape(-1, 3, 3) for m in (pairs.sum(axis=0), t @ pairs, t**2 @ pairs))
    alone = np.broadcast_to(alone, cross.shape)
    normal = np.block([[alone, cross], [cross, square]])
    right = np.column_stack([np.broadcast_to(values @ light, (len(t), 3)), (t * values) @ light])
    both = np.linalg.solve(normal + 1e-9 * np.eye(6), right[..., None])[..., 0]
    total = values @ values
    unexplained = total - np.sum(both * right, axis=1)
    around_light = total - right[0, :3] @ np.linalg.solve(alone[0], right[0, :3])
    if around_light <= 1e-12 * total:
        return np.zeros(len(frames))
    return np.asarray(np.where(both[:, 3] > 0, np.sqrt(np.clip(1 - unexplained / around_light, 0.0, 1.0)), 0.0))


@cache
def _screen_samples() -> tuple[Array, Array]:
    """Cells (n, 2) of a few points in every block of the frame, and the eight templates there, (n, 8)."""
    index = np.arange(SCREEN_SAMPLES * SIDE // PIXELS) * PIXELS // SCREEN_SAMPLES + PIXELS // (2 * SCREEN_SAMPLES)
    rows, columns = (grid.ravel() for grid in np.meshgrid(index, index, indexing="ij"))
    inside = ring()[rows, columns]
    rows, columns = rows[inside], columns[inside]
    cells = apply_homography(H_CELLS_RECTIFIED, np.column_stack([columns, rows]).astype(np.float64))
    return cells, np.column_stack([template[rows, columns] for _, template in symmetries()]).astype(np.float64)


def screen(image: Array32, layouts: Layouts) -> Array:
    """Correlation (n, 8) of the surroundings of layouts with the eight templates: `agreements` with few samples per
    block, additive light, and blocks around missing x-corners excluded."""
    parts = range(0, len(layouts.maps), SCREENED_AT_ONCE)
    scores = [_screen_part(image, layouts.maps[i : i + SCREENED_AT_ONCE], layouts.hits[i : i + SCREENED_AT_ONCE])
              for i in parts]  # fmt: skip
    return np.concatenate([np.zeros((0, len(symmetries()))), *scores])


def _screen_part(image: Array32, maps: Array, hits: Mask) -> Array:
    """`screen` of maps (n, 3, 3) with hits (n, 12)."""
    cells, frames = _screen_samples()
    q = maps @ np.column_stack([cells, np.ones(len(cells))]).T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        x, y = (q[:, :2] / q[:, 2:]).astype(np.float32).transpose(1, 0, 2)
    values = np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float64)
    near = np.abs(cells[:, None] - RIM_CELLS).max(axis=2) < BLOCK
    weights = 1.0 - (~hits).astype(np.float64) @ near.T.astype(np.float64)
    light = np.column_stack([np.ones(len(cells)), cells / CELLS - 0.5])
    pairs = (light[:, :, None] * light[:, None]).reshape(len(cells), 9)
    normal = (weights @ pairs).reshape(-1, 3, 3)
    values -= np.linalg.solve(normal, ((weights * values) @ light)[..., None])[..., 0] @ light.T
    centred, weighted = frames - light @ np.linalg.lstsq(light, frames, rcond=None)[0], weights * values
    norms = np.sqrt(np.einsum("nm,nm->n", weighted, values)[:, None] * (weights @ centred**2))
    out: Array = weighted @ centred / np.maximum(norms, np.finfo(np.float32).tiny)
    return out


def locate_marks(rectified: Array32) -> tuple[Array, Array]:
    """Cell coordinates (12, 2) of the marks near their expected positions, to a fraction of a rectified pixel, and
    correlations with the template; 0 outside photograph or search window."""
    offsets = np.zeros((len(X_CORNERS), 2))
    likeness = np.zeros(len(X_CORNERS))
    for n, (column, row) in enumerate(X_CORNER_BLOCKS):
        x, y = ((RIM_BLOCKS + np.array([column, row])) * PIXELS + PIXELS // 2).tolist()
        mark = expected()[y - MARK_HALF : y + MARK_HALF, x - MARK_HALF : x + MARK_HALF]
        reach = MARK_HALF + SEARCH
        window = rectified[y - reach : y + reach, x - reach : x + reach]
        template = np.isfinite(window)
        if not template[SEARCH:-SEARCH, SEARCH:-SEARCH].all():
            continue
        window = np.where(template, window, window[template].mean())
        offsets[n], likeness[n] = _peak(cv2.matchTemplate(window, mark, cv2.TM_CCOEFF_NORMED))
    return X_CORNERS + offsets / PIXELS_PER_CELL, likeness


def _peak(likeness: npt.NDArray[np.generic]) -> tuple[Array, float]:
    """Offset (x, y) of the maximum from the middle, by parabolas, and its value; 0 on the border."""
    row, column = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
    middle = (likeness.shape[0] - 1) / 2
    if not (0 < row < likeness.shape[0] - 1 and 0 < column < likeness.shape[1] - 1):
        return np.zeros(2), 0.0
    around = np.asarray(likeness[row - 1 : row + 2, column - 1 : column + 2], dtype=np.float64)
    x = _vertex(around[1]) + column - middle
    y = _vertex(around[:, 1]) + row - middle
    return np.array([x, y]), float(around[1, 1])


def _vertex(v: Array) -> float:
    curvature = v[0] - 2 * v[1] + v[2]
    return float(0.5 * (v[0] - v[2]) / curvature) if curvature < 0 else 0.0


def around_marks(which: Mask) -> Mask:
    """Mask of the blocks of some marks in the rectified picture, with a block around each."""
    mask = np.zeros((SIDE, SIDE), dtype=np.bool_)
    for (column, row), chosen in zip(X_CORNER_BLOCKS, which, strict=True):
        if chosen:
            x, y = (RIM_BLOCKS + column) * PIXELS, (RIM_BLOCKS + row) * PIXELS
            mask[max(y - PIXELS, 0) : y + 2 * PIXELS, max(x - PIXELS, 0) : x + 2 * PIXELS] = True
    return mask
