"""The published photograph of the noise chart, and the published program's results."""

import numpy as np
import numpy.typing as npt

from procedures.pattern_print.source import Source
from procedures.pattern_psf.estimate import PatternPsf
from procedures.raw import read_frame
from procedures.slanted_edge.estimate import estimate_edges
from station.demo.reproduce import cameras, patterns
from station.demo.reproduce.figures import pictures
from station.demo.reproduce.rival_rows import LEVELS, K, joshi, view
from station.demo.reproduce.row import Order, RowValues, Setting, ordered

Array = npt.NDArray[np.float64]

F = cameras.FREQUENCIES
PHOTOGRAPH = ("pattern_photo/img_example.pgm", "pattern_photo/pattern_noise.pgm")
REFERENCES = ("reference/real_pattern_ls_s4_k17.txt", "reference/real_pattern_nnls_s4_k17.txt")


def published(setting: Setting, *, k: int = 17, solver: str = "ls") -> PatternPsf:
    """The PSF of the published photograph."""
    image, cells = (setting.path(name) for name in PHOTOGRAPH)
    return cameras.estimated(read_frame(image).planes["Y"], Source.from_file(cells).chart, k=k, solver=solver)


@ordered(Order("the difference has less than 1 % of the energy", lambda v: v[0] < 0.01 and v[1] < 0.1))
def nonnegative(setting: Setting) -> RowValues:
    """Non-negative and free least squares give the same PSF."""
    free, constrained = (published(setting, solver=solver).psf.h for solver in ("ls", "nnls"))
    difference = free - constrained
    ratio = float(np.sum(difference**2) / np.sum(constrained**2))
    mtf = {"least squares": cameras.mtf_across(free), "non-negative": cameras.mtf_across(constrained)}
    apart = np.abs(mtf["least squares"] - mtf["non-negative"])
    figures = (
        pictures(
            "nonnegative-psf",
            [("least squares", free), ("non-negative", constrained), ("difference", difference)],
            columns=3,
            cmap="viridis",
        ),
        cameras.mtf_curves("nonnegative-mtf", "horizontal", mtf),
    )
    return RowValues((ratio, float(apart.max())), figures)


def supports(setting: Setting) -> RowValues:
    """The PSF for supports of 9, 17, 25 and 33 samples: the last three similar, the first hardly sufficient."""
    estimates = {k: published(setting, k=k).psf.h for k in (9, 17, 25, 33)}
    mtf = {k: cameras.mtf_down(h) for k, h in estimates.items()}
    figures = (
        pictures("supports-psf", [(f"{k} × {k}", _middle(h)) for k, h in estimates.items()], cmap="viridis"),
        cameras.mtf_curves("supports-mtf", "vertical", {f"{k} × {k}": one for k, one in mtf.items()}),
    )
    apart = max(float(np.abs(mtf[k] - mtf[17]).max()) for k in (25, 33))
    return RowValues((apart, float(np.abs(mtf[9] - mtf[17]).max()) / apart), figures)


def _middle(h: Array) -> Array:
    half = len(h) // 2
    return h[half - 4 : half + 5, half - 4 : half + 5]


def published_photograph(setting: Setting) -> RowValues:
    """The PSF of the published photograph, compared with the published program's."""
    results = [np.loadtxt(setting.path(name)) for name in REFERENCES]
    ours = [published(setting, solver=solver).psf.h for solver in ("ls", "nnls")]
    correlations = [float(np.corrcoef(a.ravel(), b.ravel())[0, 1]) for a, b in zip(results, ours, strict=True)]
    mtf = {"published program": cameras.mtf_across(results[0]), "ours": cameras.mtf_across(ours[0])}
    figures = (
        pictures(
            "program-psf",
            [("published, free", results[0]), ("ours, free", ours[0]),
             ("published, n.n.", results[1]), ("ours, n.n.", ours[1])],
            cmap="viridis",
        ),
        cameras.mtf_curves("program-mtf", "horizontal", mtf),
    )  # fmt: skip
    return RowValues(tuple(correlations), figures)


EDGE = "edges/Test_edge1_mono.tif"
EDGE_WINDOW = (80, 80)


@ordered(Order("a higher level lowers the MTF at high frequencies", lambda v: v[1] > 0))
def joshi_photograph(setting: Setting) -> RowValues:
    """Joshi et al. at three levels on a photograph of a slanted edge: the level decides at high frequencies only."""
    plane = read_frame(setting.path(EDGE)).planes["Y"]
    edge = estimate_edges(plane)[0].result()
    samples, course = (plane.samples.T, edge.course[:, ::-1]) if edge.turned else (plane.samples, edge.course)
    kernels = {f"Joshi, {name}": h for name, h in _by_predicted_edge(samples, course).items()}
    mtf = {name: cameras.mtf_across(h) for name, h in kernels.items()}
    measured = np.interp(F, edge.frequencies, edge.mtf, right=np.nan)
    low, high = (F <= 0.15), (F >= 0.4) & (F <= 1.2)
    apart = max(float(np.abs(one - measured)[low].max()) for one in mtf.values())
    spread = np.ptp(list(mtf.values()), axis=0)
    figures = (
        pictures("joshi-psf", list(kernels.items()), columns=3, cmap="viridis"),
        cameras.mtf_curves("joshi-mtf", "across the edge", {**mtf, "slanted edge": measured}),
    )
    return RowValues((apart, float(spread[high].max())), figures)


def _by_predicted_edge(samples: npt.NDArray[np.floating], course: Array) -> dict[str, Array]:
    """Kernels at each level from a near-vertical edge whose sharp picture is a step along its course (x, y)."""
    slope, at_0 = np.polyfit(course[:, 1], course[:, 0], 1)
    half = (EDGE_WINDOW[0] - 1) / 2
    top = (samples.shape[0] - EDGE_WINDOW[0]) // 2
    middle = slope * (top + half) + at_0
    left = round(middle - half)
    window = samples[top : top + EDGE_WINDOW[0], left : left + EDGE_WINDOW[1]].astype(np.float64)
    first, last = (float(np.median(window[:, part])) for part in (np.s_[:8], np.s_[-8:]))
    step = patterns.of_drawing(
        lambda x, y: np.where(x - (middle - left - half) > slope * y, 1.0, 0.0),
        patterns.side(EDGE_WINDOW, cameras.S, K), cameras.S,
    )  # fmt: skip
    A = view(step, EDGE_WINDOW).A
    return {name: joshi(A, ((window - first) / (last - first)).ravel(), K, w) for name, w in LEVELS.items()}
