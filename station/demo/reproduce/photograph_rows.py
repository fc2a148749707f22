"""The published photograph of the noise chart, and the published program's results."""

import numpy as np
import numpy.typing as npt

from procedures.pattern_print.source import Source
from procedures.pattern_psf.estimate import PatternPsf
from procedures.raw import read_frame
from station.demo.reproduce import cameras
from station.demo.reproduce.figures import pictures
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
