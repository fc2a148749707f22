"""Chapter 2 of the thesis, theory: noise amplification of patterns, and its lower bound. gamma is the sum of 1 /
sigma_i^2, as in the thesis."""

import numpy as np

from procedures.numerics.arrays import Array
from procedures.pattern_psf.gamma import gamma_bound
from station.demo.reproduce import patterns
from station.demo.reproduce.figures import Curve, curves, pictures
from station.demo.reproduce.row import Order, RowValues, Setting, ordered

S = 4
SUPPORTS = (9, 17, 25, 33)
BERNOULLI_PUBLISHED = (0.19, 0.69, 1.54, 2.98)
REGION = (53, 54)
"""Pixels of the noise region in Table 2.2, derived from its bounds: see `table_window`."""
DISC_PX = 20.0
"""Radius of the circle that stands for the pattern of Joshi et al."""


def table_window(r: int) -> patterns.Window:
    """Window of Table 2.2: the noise region and the pixels around it that a PSF of r samples reaches.

    Proposition 1 gives the table's four bounds, to their last digit, for 53 x 54 pixels grown by (r - 1) / s.
    """
    return REGION[0] + (r - 1) // S, REGION[1] + (r - 1) // S


def _bernoulli(r: int, window: patterns.Window, seed: int, samples_per_cell: float = 1.0) -> Array:
    samples = patterns.side(window, S, r)
    return patterns.bernoulli(samples, samples_per_cell, np.random.default_rng(seed))


def _mean_gamma(r: int, window: patterns.Window, seeds: range, samples_per_cell: float = 1.0) -> float:
    views = (_bernoulli(r, window, seed, samples_per_cell) for seed in seeds)
    return float(np.mean([patterns.gamma_of(view, S, r, window) for view in views]))


OTHERS: dict[str, patterns.Drawing] = {
    "slanted edge": patterns.slanted_edge,
    "disc of arcs": patterns.disc(DISC_PX),
    "checkerboard": patterns.checkerboard(6.0),
    "star": patterns.star(36),
    "single square": patterns.square(20.0),
}


def _table_order(values: tuple[float, ...]) -> bool:
    bounds, noise, joshi = (np.array(values[n : n + 4]) for n in (0, 4, 8))
    return bool(
        np.all(bounds < noise)
        and np.all(np.diff(noise) > 0)
        and np.all(np.diff(joshi / noise) > 0)
        and np.all(joshi > 10 * noise)
    )


@ordered(
    Order(
        "bound < noise pattern < a tenth of Joshi's γ, and the ratio of the two patterns grows with the support",
        _table_order,
    )
)
def gamma_table(setting: Setting) -> RowValues:
    """γ of the noise pattern, of the pattern of Joshi et al., and the theoretical bound, s = 4."""
    windows = [table_window(r) for r in SUPPORTS]
    bounds = [gamma_bound(m * n, r * r) for r, (m, n) in zip(SUPPORTS, windows, strict=True)]
    noise = [_mean_gamma(r, w, range(20 if setting.full else 3)) for r, w in zip(SUPPORTS, windows, strict=True)]
    joshi = [
        patterns.gamma_of(patterns.of_drawing(patterns.disc(DISC_PX), patterns.side(window, S, r), S), S, r, window)
        for r, window in zip(SUPPORTS, windows, strict=True)
    ]
    figure = curves(
        "gamma-table",
        [
            Curve("noise pattern", SUPPORTS, noise, "o-"),
            Curve("bound", SUPPORTS, bounds, "s-"),
            Curve("disc", SUPPORTS, joshi, "^-"),
        ],
        x="side of the PSF's support, samples",
        y="γ",
        log="y",
        published=Curve("published noise pattern", SUPPORTS, BERNOULLI_PUBLISHED, "--"),
    )
    farther = _mean_gamma(17, table_window(17), range(1), 1.1)
    remark = f"γ is the sum of 1/σ². At s/t = 1.1 the noise pattern has {farther:.2f} for 17 × 17."
    return RowValues((*bounds, *noise, *joshi), (figure,), remark)


def gamma_patterns(setting: Setting) -> RowValues:
    """Patterns made of step edges have far larger γ than the noise pattern (17 × 17, s = 4)."""
    r = 17
    window = table_window(r)
    samples = patterns.side(window, S, r)
    noise = _bernoulli(r, window, 0)
    views = {name: patterns.of_drawing(draw, samples, S) for name, draw in OTHERS.items()}
    best = patterns.gamma_of(noise, S, r, window)
    ratios = [patterns.gamma_of(view, S, r, window) / best for view in views.values()]
    figure = pictures("gamma-patterns", [("noise pattern", noise), *views.items()], columns=3)
    return RowValues(tuple(ratios), (figure,), f"γ of the noise pattern is {best:.3f}.")


WINDOW_SIDES = (20, 30, 40, 60, 80, 100, 140, 200)


def bound_solved(setting: Setting) -> RowValues:
    """The bound of Lemma 3 and the exact solution of its constrained minimum."""
    N = 17 * 17
    M = np.array(WINDOW_SIDES) ** 2
    plain = np.array([gamma_bound(int(m), N) for m in M])
    solved = np.array([patterns.gamma_bound_solved(int(m), N) for m in M])
    shown = [Curve("Lemma 3", M, plain), Curve("solved (KKT)", M, solved, "--")]
    both = curves("bound-solved", shown, x="samples M", y="lower bound of γ", log="xy")
    apart = curves(
        "bound-apart", [Curve("difference", M, solved - plain, "o-")], x="samples M", y="difference", log="xy"
    )
    return RowValues((float(np.max((solved - plain) / plain)), float(np.min(solved - plain))), (both, apart))


def bound_expected(setting: Setting) -> RowValues:
    """γ of the expected Bernoulli operator lies above the bound by 4 / M."""
    N = 17 * 17
    M = np.array(WINDOW_SIDES) ** 2
    bound = np.array([gamma_bound(int(m), N) for m in M])
    expected = np.array([patterns.gamma_expected(int(m), N) for m in M])
    shown = [Curve("Lemma 3", M, bound), Curve("expected noise pattern", M, expected, "--")]
    figure = curves("bound-expected", shown, x="samples M", y="γ", log="xy")
    share = (expected - bound) / (4 / M)
    return RowValues((float(share.min()), float(share.max())), (figure,))


def bound_realised(setting: Setting) -> RowValues:
    """Random zeros and ones as samples approach the bound at finite windows and supports, s = 4."""

    def over_bound(r: int, m: int) -> float:
        samples = patterns.side((m, m), S, r)
        views = (np.random.default_rng(seed).integers(0, 2, (samples, samples)).astype(float) for seed in range(2))
        mean = np.mean([patterns.gamma_of(view, S, r, (m, m)) for view in views])
        return float(mean / gamma_bound(m * m, r * r))

    sides = [m for m in WINDOW_SIDES if 30 <= m <= 100]
    by_window = [over_bound(17, m) for m in sides]
    by_support = [over_bound(r, 100) for r in SUPPORTS]
    figures = (
        curves("realised-m", [Curve("17 × 17", sides, by_window, "o-")], x="side of the window", y="γ / bound"),
        curves("realised-r", [Curve("100 × 100", SUPPORTS, by_support, "o-")], x="side of the PSF", y="γ / bound"),
    )  # fmt: skip
    return RowValues((by_window[-1], max(by_support), min(by_window + by_support)), figures)


CELLS_PER_SAMPLE = (0.4, 0.55, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0, 2.5, 3.0)


def gamma_zoom(setting: Setting) -> RowValues:
    """γ over the zoom: near its least between 0.7 and 2, growing when the chart is seen from too near or too far."""
    r, window = 17, (60, 60)
    values = np.array([_mean_gamma(r, window, range(1), 1 / t_over_s) for t_over_s in CELLS_PER_SAMPLE])
    at = dict(zip(CELLS_PER_SAMPLE, values, strict=True))
    least = float(values.min())
    bound = gamma_bound(window[0] * window[1], r * r)
    ratios = np.array([0.7, 0.85, 1.0, 1.15, 1.3, 1.4, 1.5, 1.6, 1.75])
    gammas = []
    for ratio in ratios:
        side = int((256 * ratio - r) / S)
        samples = patterns.side((side, side), S, r)
        view = patterns.bernoulli(samples, float(ratio), np.random.default_rng(0), cells=256)
        gammas.append(patterns.gamma_of(view, S, r, (side, side)))
    shown = [
        Curve("60 × 60 pixels", CELLS_PER_SAMPLE, values, "o-"),
        Curve("bound", CELLS_PER_SAMPLE, np.full(len(values), bound), "--"),
    ]
    fixed = curves("gamma-zoom", shown, x="t/s: cells in a sample", y="γ", log="y")
    shown = [Curve("256 × 256 cells", ratios, np.array(gammas), "o-")]
    chart = curves("gamma-chart", shown, x="s/t: samples in a cell", y="γ", log="y")
    best = float(ratios[np.argmin(gammas)])
    remark = (
        "The range 0.7 to 2 holds for t/s, cells per sample, as in the caption's “t/s zoom factor (b)”; its “s/t” is"
        " the inverse. At s/t = 2 the low-pass filter of a cell has its zero at the edge of the band. The second"
        f" figure shows a whole chart, larger from nearer: the minimum is at s/t = {best:.2f}."
    )
    measured = (CELLS_PER_SAMPLE[int(np.argmin(values))], at[0.7] / least, at[2.0] / least, at[0.4] / least)
    return RowValues(measured, (fixed, chart), remark)


def gamma_support(setting: Setting) -> RowValues:
    """γ of the noise pattern grows with the PSF's support, s/t = 1."""
    supports, window = (5, 9, 13, 17, 21, 25, 29, 33), (60, 60)
    values = [_mean_gamma(r, window, range(2)) for r in supports]
    bounds = [gamma_bound(window[0] * window[1], r * r) for r in supports]
    shown = [Curve("noise pattern", supports, values, "o-"), Curve("bound", supports, bounds, "--")]
    figure = curves("gamma-support", shown, x="side of the PSF's support, samples", y="γ", log="y")
    steps = np.diff(values)
    ratios = np.array(values) / bounds
    return RowValues((float(steps.min()), float(ratios.min()), float(ratios.max())), (figure,))


def eigenvalues(setting: Setting) -> RowValues:
    """Eigenvalues after the first are similar for the noise pattern and decay fast for Joshi's (81 × 81, 25 × 25)."""
    r, window = 25, (81, 81)
    views = {
        "noise pattern": _bernoulli(r, window, 0),
        "disc of arcs": patterns.of_drawing(patterns.disc(DISC_PX), patterns.side(window, S, r), S),
    }
    values = {name: patterns.singular_values(view, S, r, window) ** 2 for name, view in views.items()}
    order = np.arange(1, r * r + 1)
    figure = curves(
        "eigenvalues",
        [Curve(name, order, value) for name, value in values.items()],
        x="order",
        y="eigenvalues of C'S'SC",
        log="y",
    )
    spread = {name: float(value[1] / value[-1]) for name, value in values.items()}
    return RowValues((spread["noise pattern"], spread["disc of arcs"] / spread["noise pattern"]), (figure,))
