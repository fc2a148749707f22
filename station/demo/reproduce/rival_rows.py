"""Figure 2.9 of the thesis: noise pattern, Joshi et al. and slanted edge, on a known kernel."""

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from procedures.numerics.arrays import Array
from procedures.numerics.normal_equations import solve_constrained
from procedures.raw import Plane
from procedures.slanted_edge.estimate import EdgeMtf, estimate_edges
from station.demo.reproduce import cameras, patterns
from station.demo.reproduce.figures import Curve, curves, pictures
from station.demo.reproduce.row import Order, RowValues, Setting, ordered

S, K = 4, 17
NOISE = 0.02
GAUSSIAN_PX = 0.45
"""Standard deviation of the kernel: its MTF is 37 % at Nyquist, so that the photograph aliases."""
WHOLE: patterns.Window = (110, 110)
SAMPLES_PER_CELL = 1.375
"""The chart with its frame, 320 cells, fills the 110 pixels."""
NOISE_REGION: patterns.Window = (84, 84)
"""Pixels that receive light from the noise region only: 88 less the PSF's support."""
LEVELS = {"little": 1e-4, "middle": 1e-3, "strong": 1e-1}
"""Weights of the kernel's gradient, over the mean diagonal of the equations."""
SWEEP = (1e-3, 2e-3, 4e-3, 7e-3, 1e-2, 2e-2)
TILE_PX = 55.0
F = cameras.FREQUENCIES


def joshi(A: Array, v: Array, k: int, weight: float) -> Array:
    """The non-negative kernel (k, k) that minimises ||A h - v||^2 + weight ||grad h||^2.

    A : (m, k^2), the known pattern as a convolution, sampled at the pixels
    v : (m,), the photograph
    weight : in units of the mean diagonal element of A'A; without it the equations of step edges are singular

    Source: Joshi, Szeliski, Kriegman, PSF Estimation using Sharp Edge Prediction, CVPR 2008, equation 6.
    """
    G = A.T @ A
    smoothed = G + weight * float(np.mean(np.diag(G))) * gradient_energy(k)
    return solve_constrained(smoothed, A.T @ v, "nnls").reshape(k, k)


def gradient_energy(k: int) -> Array:
    """L with h' L h the sum of squared differences of neighbours in a (k, k) picture padded by zeros."""
    second = 2 * np.eye(k) - np.eye(k, k=1) - np.eye(k, k=-1)
    return np.kron(second, np.eye(k)) + np.kron(np.eye(k), second)


def least_squares(A: Array, v: Array, k: int) -> Array:
    """The kernel (k, k) that minimises ||A h - v||^2: the thesis's method, equation (P)."""
    return solve_constrained(A.T @ A, A.T @ v, "ls").reshape(k, k)


def psnr_db(h: Array, truth: Array) -> float:
    """Peak signal-to-noise ratio of a kernel with respect to the true one."""
    return float(10 * np.log10(truth.max() ** 2 / np.mean((h - truth) ** 2)))


@dataclass(frozen=True, eq=False)
class PatternView:
    """The linear system of the pixels of a window on a pattern."""

    A: Array
    window: patterns.Window

    def photograph(self, h: Array, rng: np.random.Generator) -> Array:
        """Its pixels through a kernel, with noise, (m n,)."""
        return self.A @ h.ravel() + NOISE * rng.standard_normal(len(self.A))


def view(u: Array, window: patterns.Window) -> PatternView:
    """The system of a window on a band-limited picture."""
    return PatternView(patterns.system(u, S, K, window), window)


def edge_mtf(picture: Array) -> EdgeMtf:
    """The MTF across the edge of a simulated photograph. Raises Refused."""
    plane = Plane("Y", (0.1 + 0.8 * picture).astype(np.float32), 1e-4)
    return estimate_edges(plane)[0].result()


@ordered(
    Order(
        "the noise pattern is better than little and strong regularisation, one noisy, the other biased",
        lambda v: v[0] > 3 and v[2] > 3 and v[4] > 1 and v[5] < 0 and v[6] < -v[5],
    )
)
def simulated_rivals(setting: Setting) -> RowValues:
    """The noise pattern without regularisation outperforms Joshi et al. at three levels, kernel known, noise 0.02."""
    x = (np.arange(K) - K // 2) / S
    line = np.exp(-(x**2) / (2 * GAUSSIAN_PX**2))
    truth = np.asarray(np.outer(line, line) / line.sum() ** 2)
    rng = np.random.default_rng(9)
    noise = view(patterns.bernoulli(patterns.side(NOISE_REGION, S, K), SAMPLES_PER_CELL, rng, cells=256), NOISE_REGION)

    def discs(x: Array, y: Array) -> Array:
        px, py = x % TILE_PX - TILE_PX / 2, y % TILE_PX - TILE_PX / 2
        return np.where(np.hypot(px, py) < 20.0, 0.0, 1.0)

    arcs = view(patterns.of_drawing(discs, patterns.side(WHOLE, S, K), S), WHOLE)
    kernels: dict[str, list[Array]] = {name: [] for name in ("noise pattern", *LEVELS)}
    sweep = []
    for _ in range(30 if setting.full else 8):
        kernels["noise pattern"].append(least_squares(noise.A, noise.photograph(truth, rng), K))
        v = arcs.photograph(truth, rng)
        for name, weight in LEVELS.items():
            kernels[name].append(joshi(arcs.A, v, K, weight))
        sweep.append([psnr_db(joshi(arcs.A, v, K, weight), truth) for weight in SWEEP])
    return _compared(truth, kernels, float(np.mean(sweep, axis=0).max()), _edge(truth, rng))


def _edge(truth: Array, rng: np.random.Generator) -> EdgeMtf:
    edge_view = view(patterns.of_drawing(patterns.slanted_edge, patterns.side(WHOLE, S, K), S), WHOLE)
    return edge_mtf(edge_view.photograph(truth, rng).reshape(WHOLE))


def _compared(truth: Array, kernels: dict[str, list[Array]], best: float, edge: EdgeMtf) -> RowValues:
    psnr = {name: float(np.mean([psnr_db(h, truth) for h in estimates])) for name, estimates in kernels.items()}
    mtf = {name: np.array([cameras.mtf_across(h) for h in estimates]) for name, estimates in kernels.items()}
    true = cameras.mtf_across(truth)
    high, middle = true < 0.1, (true > 0.2) & (F < 0.7)
    noisy = {name: float(one[:, high].std(axis=0).mean()) for name, one in mtf.items()}
    bias = {name: float((one.mean(axis=0) - true)[middle].mean()) for name, one in mtf.items()}
    measured = (edge.frequencies <= 0.5) & np.isfinite(edge.mtf)
    edge_error = float(np.abs(edge.mtf - np.interp(edge.frequencies, F, true))[measured].max())
    ours = psnr["noise pattern"]
    values = (
        *(ours - psnr[name] for name in LEVELS),
        ours - best,
        noisy["little"] / noisy["noise pattern"],
        bias["strong"],
        abs(bias["noise pattern"]),
        edge_error,
    )
    remark = (
        f"PSNR: noise pattern {ours:.1f} dB; Joshi et al. "
        + ", ".join(f"{name} regularisation {psnr[name]:.1f} dB" for name in LEVELS)
        + f"; at the level that is best for this kernel {best:.1f} dB."
    )
    return RowValues(values, _figures(truth, kernels, mtf, edge), remark)


def _figures(truth: Array, kernels: dict[str, list[Array]], mtf: dict[str, Array], edge: EdgeMtf) -> tuple[Markup, ...]:
    differences = [(name, estimate[0] - truth) for name, estimate in kernels.items()]
    return (
        pictures(
            "rivals-psf", [("true", truth), *((name, estimate[0]) for name, estimate in kernels.items())], columns=5
        ),
        pictures("rivals-errors", differences, columns=4, cmap="RdBu_r"),
        curves(
            "rivals-mtf",
            [
                *(Curve(name, F, one.mean(axis=0), band=one.std(axis=0)) for name, one in mtf.items()),
                Curve("slanted edge", edge.frequencies, edge.mtf, ":"),
            ],
            x="cycles per pixel",
            y="MTF",
            published=Curve("true", F, cameras.mtf_across(truth)),
            xlim=(0, 2),
            ylim=(-0.02, 1.05),
        ),
    )
