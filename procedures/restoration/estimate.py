"""From blurred photographs to the sharp picture and the depth map: check, start, alternate, judge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, uniform_filter

from procedures.outcome import BadParameter, Outcome, Verdict
from procedures.restoration import alternate, checks, depth
from procedures.restoration.cost import DataTerm
from procedures.restoration.evidence import noise_gain
from procedures.restoration.forward import Array, Blur, MaskStack
from procedures.restoration.scheme import Schedule, Scheme

# noise of the restored picture beyond which ringing hides its detail, white = 1
MOST_NOISE = 0.06
STARTS = ("matched", "blur", "symmetric")
# level differences of the matching's steps, taken as noise: below this the first costs say nothing more
LEAST_START_SIGMA = 1.4e-3


@dataclass(frozen=True)
class RestorationParameters:
    """How to restore.

    image_weight, depth_weight : lambda_u and lambda_w of (6.1), photographs in [0, 1], w in pixels; None takes them
    from the noise. depth_start : "matched" (whitened Algorithm III over the whole frame), "blur" (Algorithm III),
    "symmetric" (Algorithm II). total_variation, depth_total_variation : of picture and w, instead of quadratic priors.
    """

    scheme: Scheme = field(default_factory=Scheme)
    image_weight: float | None = None
    depth_weight: float | None = None
    depth_start: str = "matched"
    total_variation: bool = False
    depth_total_variation: bool = False
    dtype: type[np.floating[Any]] = np.float32

    def __post_init__(self) -> None:
        if self.depth_start not in STARTS:
            raise BadParameter(f"depth start {self.depth_start!r} is unknown", f"use one of {', '.join(STARTS)}")
        for name in ("image_weight", "depth_weight"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise BadParameter(f"{name.replace('_', ' ')} must be positive, got {value}", "leave it out")


@dataclass(frozen=True)
class Diagnostics:
    """What a restoration says of itself.

    noise : standard deviation, white = 1; residual_over_noise : robust; undetermined : part of the frame whose w is
    uncertain by more than half a pixel at best; noise_gain : of the restoration at the median w; saturated, at_limit :
    parts of the frame saturated, and at the end of the range of w.
    """

    noise: float
    residual_over_noise: float
    undetermined: float
    noise_gain: float
    saturated: float
    at_limit: float


@dataclass(frozen=True)
class Restoration:
    """Sharp picture (C, H, W), w (H, W) pixels and its least standard deviation, residuals (P, C, H, W), history."""

    sharp: Array
    w: Array
    w_std: Array
    residual: Array
    start: depth.DepthStart
    history: tuple[alternate.Round, ...]
    diagnostics: Diagnostics


def noise_of(z: Array, stacks: list[MaskStack]) -> float:
    """Standard deviation of the photographs' noise, from what no common picture explains at any depth.

    Whitened differences (8.1) of two photographs have unit variance at the true depth; over the levels the least
    windowed mean is taken, and over the frame its lower quartile, where blur is constant and levels fit.
    """
    levels = depth.levels_of(stacks, 0.3)
    least = depth.cost_volume(z[:2], stacks[:2], np.ones(2), levels, 5).min(axis=2) / z.shape[1]
    return max(1.3 * float(np.sqrt(np.percentile(least, 25))), 1e-5)


def first_depth(z: Array, stacks: list[MaskStack], sigma: float, start: str) -> depth.DepthStart:
    """The depth to begin with, by the algorithm named."""
    sigmas = np.full(len(z), max(sigma, LEAST_START_SIGMA))
    if start == "symmetric":
        return depth.algorithm_2(z, stacks, sigma)
    if start == "blur":
        return depth.algorithm_3(z, stacks, sigmas)
    return depth.matched(z, stacks, sigmas)


def restore(
    photographs: list[Array],
    stacks: list[MaskStack],
    parameters: RestorationParameters | None = None,
    progress: Callable[[alternate.Round], None] | None = None,
) -> Outcome[Restoration]:
    """The sharp picture and the depth map, with a verdict.

    photographs : P arrays (C, H, W), linear, white = 1; stacks : the masks of each as functions of one w.

    Raises
    ------
    BadInput, BadParameter, Refused
        If photographs, blurs or parameters cannot be restored (see `checks`).
    """
    p = parameters or RestorationParameters()
    z = checks.check_photographs([np.asarray(photo, dtype=np.float64) for photo in photographs])
    shape = (z.shape[2], z.shape[3])
    checks.check_blurs(stacks, shape)
    trust = checks.trust_of(z)
    sigma = noise_of(z, stacks)
    checks.check_texture(z, sigma)
    checks.check_registered(z, stacks[0].R)
    start = first_depth(z, stacks, sigma, p.depth_start)
    schedule = Schedule(p.scheme.rounds, p.image_weight, p.depth_weight)
    data, other = alternate.problem_of(z, stacks, trust, p.dtype)
    problem = alternate.Problem(
        data,
        other,
        p.scheme,
        schedule,
        sigma,
        reach_of(start.w, stacks),
        misfit_of(start.trusted, data.R),
        p.total_variation,
        p.depth_total_variation,
    )
    state = alternate.run(problem, alternate.begin(problem, start.w), progress)
    return judge(_restoration(data, state, start, trust))


def reach_of(w: Array, stacks: list[MaskStack]) -> int:
    """Pixels about a depth step where windowed matching mixes both sides: both masks' half-widths and the window."""
    w75 = float(np.percentile(w, 75))
    widths = [s.supports()[min(int(w75 / s.step) + 1, len(s.masks) - 1)] for s in stacks]
    return int(sum(sorted(widths)[-2:])) + 5


def misfit_of(trusted: NDArray[np.bool_], R: int) -> NDArray[np.bool_]:
    """Where a first depth is not trusted, and two pixels around, on the extended frame."""
    return np.asarray(~binary_erosion(np.pad(trusted, R), iterations=2, border_value=1))


def _restoration(data: DataTerm, state: alternate.State, start: depth.DepthStart, trust: Array) -> Restoration:
    R, inside = data.R, (slice(data.R, -data.R), slice(data.R, -data.R))
    data.focus(state.w)
    residual = data.residual(state.u)
    spread = w_uncertainty(data, state.u, state.w, state.known.sigma)[inside]
    w = state.w[inside]
    limit = min(b.stack.max_w for b in data.blurs)
    diagnostics = Diagnostics(
        noise=state.known.sigma,
        residual_over_noise=float(np.median(np.abs(residual)) / 0.6745 / state.known.sigma),
        undetermined=float((spread > 0.5).mean()),
        noise_gain=noise_gain([b.stack for b in data.blurs], float(np.median(w)), state.history[-1].weights.picture),
        saturated=float((trust == 0).mean()),
        at_limit=float((w > limit - 0.2).mean()),
    )
    sharp = state.u[:, R:-R, R:-R]
    return Restoration(sharp, w, spread, residual, start, state.history, diagnostics)


def w_uncertainty(data: DataTerm, u: Array, w: Array, sigma: float, window: int = 7) -> Array:
    """Least standard deviation of w, pixels: how far w of a window can shift before the photographs show it.

    The photographs' change per pixel of w, squared and summed over a window, against the noise (chapter 9).
    """
    delta = 0.1
    data.focus(w + delta)
    above = data.blur(u)
    data.focus(w - delta)
    change = (above - data.blur(u)) / (2 * delta)
    data.focus(w)
    power = uniform_filter((change**2).sum(axis=(0, 1)), window) * window**2
    return np.asarray(np.pad(sigma / np.sqrt(np.maximum(power, 1e-20)), data.R, mode="edge"))


def judge(result: Restoration) -> Outcome[Restoration]:
    """The verdict on a restoration: passed, or doubtful with the first thing wrong."""
    d = result.diagnostics
    doubts = [
        (d.at_limit > 0.05, f"w reaches the end of its range in {d.at_limit:.0%} of the frame", "raise --max-w"),
        (
            d.residual_over_noise > 3,
            f"the residual is {d.residual_over_noise:.1f} times the noise: the shape or ratio is not the true one",
            "measure the shape again, or check that nothing moved between the photographs",
        ),
        (
            d.undetermined > 0.5,
            f"depth is not determined in {d.undetermined:.0%} of the frame, where texture is weak",
            "put structure into the scene",
        ),
        (
            d.noise_gain * d.noise > MOST_NOISE,
            f"noise is amplified {d.noise_gain:.0f} times, to {d.noise_gain * d.noise:.0%} of white: ringing is likely",
            "raise --image-weight",
        ),
        (d.saturated > 0.02, f"{d.saturated:.0%} of the samples are saturated", "expose less"),
    ]
    for wrong, reason, remedy in doubts:
        if wrong:
            return Outcome(result, Verdict.DOUBTFUL, reason, remedy)
    return Outcome(result)


def refocused(result: Restoration, stack: MaskStack, focus_w: float, strength: float = 1.0) -> Array:
    """The sharp picture with another depth of focus, (C, H, W): sharp at w = `focus_w`, blurred by distance from it."""
    R = stack.R
    blur = Blur(stack, (result.w.shape[0], result.w.shape[1]), np.float64)
    blur.focus(np.pad(np.abs(result.w - focus_w) * strength, R, mode="edge"))
    return blur.blur(np.pad(result.sharp, ((0, 0), (R, R), (R, R)), mode="edge").astype(np.float64))
