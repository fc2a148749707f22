"""The published photograph of the noise chart, and the published program's results."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.pattern_print.source import Source
from procedures.pattern_psf.estimate import PatternPsf
from procedures.raw import read_frame
from station.demo.reproduce import cameras
from station.demo.reproduce.figures import pictures
from station.demo.reproduce.row import Check, Order, Row, RowValues, Setting, register

Array = npt.NDArray[np.float64]
ROWS: list[Row] = []
row = register(ROWS, "camera")

F = cameras.FREQUENCIES
PHOTOGRAPH = ("pattern_photo/img_example.pgm", "pattern_photo/pattern_noise.pgm")
REFERENCES = ("reference/real_pattern_ls_s4_k17.txt", "reference/real_pattern_nnls_s4_k17.txt")


def published(setting: Setting, *, k: int = 17, solver: str = "ls") -> PatternPsf:
    """The PSF of the published photograph."""
    image, cells = (setting.path(name) for name in PHOTOGRAPH)
    return cameras.estimated(read_frame(image).planes["Y"], Source.from_file(cells).chart, k=k, solver=solver)


@row(
    place="Thesis, Figure 2.18; IPOL 2012, section 5.3",
    checks=(
        Check.at_most("energy of the difference over the PSF's", "0.001"),
        Check("greatest difference of the MTFs", "extremely close", high=0.05),
    ),
    order=Order("the difference has less than 1 % of the energy", lambda v: v[0] < 0.01 and v[1] < 0.1),
    setup="The published photograph is not the figure's, and its noise differs.",
    needs=PHOTOGRAPH,
)
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


@row(
    place="Thesis, Figure 2.19",
    checks=(
        Check("greatest difference of MTF, 25 and 33 from 17", "very close to each other", high=0.06),
        Check("greatest difference of 9 from 17, over that", "hardly sufficient", low=1.0),
    ),
    setup=(
        "As in the thesis, the MTF is that of the support. At 25 and 33 samples γ is 1.5 and 3.0: with the"
        " photograph's noise of 1.3 % the MTFs scatter by 0.03, and 2 to 3 % of the light is outside 17 samples."
        " Very close is read as 0.06."
    ),
    needs=PHOTOGRAPH,
)
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


@row(
    place="IPOL 2012, section 5, and its program's results",
    checks=(
        Check("correlation, free least squares", "the program's own PSF", low=0.98),
        Check("correlation, non-negative", "the program's own PSF", low=0.98),
    ),
    setup=(
        "The program registers by the marks alone and does not model ink spread, which causes errors that this program"
        " does not share. A correlation of 0.98 is a relative difference of a fifth."
    ),
    needs=(*PHOTOGRAPH, *REFERENCES),
)
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
