"""Restoration of picture and depth from blurred photographs: checks, first depth, joint descent, verdict."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.ndimage import binary_erosion, uniform_filter

from procedures.corruption.family import SHARPENED
from procedures.corruption.noise import DRIFT, MASK_RADII, mask_scores
from procedures.corruption.paper import flat_noise
from procedures.numerics.arrays import Mask
from procedures.outcome import SYMPTOM, BadParameter, Check, Outcome, Verdict, verdict_of
from procedures.raw import PlaneLike
from procedures.restoration.first_depth import initial_depth, registration
from procedures.restoration.joint import joint_descent
from procedures.restoration.joint.data_term import DataTerm
from procedures.restoration.joint.moved_objects import PICTURE, Occlusion, largest, moved_objects, occlusion_of
from procedures.restoration.joint.noise_and_contrast import depth_freedom, effective_weights, noise_gain
from procedures.restoration.joint.picture_error import error_map, noise_upper_bound, picture_error, residual_noise
from procedures.restoration.joint.result import Restoration, RestorationDiagnostics
from procedures.restoration.joint.schedule import Schedule, Scheme
from procedures.restoration.masks import checks
from procedures.restoration.masks.array_loops import kept_memory
from procedures.restoration.masks.blur_operator import Array
from procedures.restoration.masks.mask_fields import MaskField, Masks, half_size_at, one_grid

STARTS = ("matched", "blur", "symmetric")
AXES = ("both", "x", "y")

EXPLAINED, MOST_RESIDUAL = 1.2, 5.0
"""Residual over the photographs' noise above which a restoration is doubtful, and refused: 0.1 to 1.1 with true masks
and with kernels of real shake; 1.2 to 1.5 with errors in all kernel samples, and with paths bent by a fifth; up to 2.6
with a wrong shape (a Gaussian for a pillbox); 11 and more for photographs of different scenes."""
LEAST_GAINED = 3.0
"""Above the first limit, the error due to blur over the picture's expected error, which includes the residual: 3 to 11
with true masks, 1.4 and less with paths bent by a fifth and with wrong shapes."""
LEAST_GAIN = 1.25
"""Error due to blur over the picture's expected error below which restoring is of no use; the ratio is known to
a quarter."""
LEAST_NOISE = 1.2e-3
"""Residual of 8-bit quantisation, which is no disagreement, white = 1."""
MOST_NOISE = 0.06
"""Noise of the restored picture above which ringing hides its detail, white = 1."""
MOST_AT_LIMIT, MOST_UNDETERMINED, MOST_SATURATED = 0.05, 0.5, 0.02
"""Fractions of the frame with w at the end of its range, with w uncertain by more than half a pixel, saturated."""
MOST_MOVED = 0.3
"""Fraction of the frame with motion above which the photographs are refused."""


@dataclass(frozen=True)
class RestorationParameters:
    """Parameters of a restoration.

    image_weight, depth_weight : lambda_u and lambda_w of (6.1), photographs in [0, 1], w in pixels; None derives them
    from the noise. lambda_w weights second differences of w (see `PriorWeights`). depth_start : "matched" (whitened
    Algorithm III over the whole frame), "blur" (Algorithm III), "symmetric" (Algorithm II). symmetric_axis : "both" for
    masks symmetric about axes and diagonals (Proposition 2), "x" or "y" for even ones along one axis (Proposition 3).
    total_variation, depth_total_variation : priors of picture and w, instead of quadratic ones.
    flat_w : w of the whole frame if known; then only the picture is estimated.
    least_image_weight : smallest lambda_u that is derived from the noise.
    """

    scheme: Scheme = field(default_factory=Scheme)
    image_weight: float | None = None
    depth_weight: float | None = None
    depth_start: str = "matched"
    symmetric_axis: str = "both"
    total_variation: bool = False
    depth_total_variation: bool = False
    flat_w: float | None = None
    dtype: type[np.floating[Any]] = np.float32
    least_image_weight: float = 0.0

    def __post_init__(self) -> None:
        if self.depth_start not in STARTS:
            raise BadParameter(f"depth start {self.depth_start!r} is unknown", f"use one of {', '.join(STARTS)}")
        if self.symmetric_axis not in AXES:
            raise BadParameter(f"symmetric axis {self.symmetric_axis!r} is unknown", f"use one of {', '.join(AXES)}")
        for name, value in (("image weight", self.image_weight), ("depth weight", self.depth_weight)):
            if value is not None and not value > 0:
                raise BadParameter(f"{name} must be positive, got {value}", "omit it to derive it from the noise")


def noise_of(z: Array, stacks: Sequence[Masks], step: float = initial_depth.LEVEL_PX) -> float:
    """Standard deviation of the photographs' noise: whitened differences (8.1) have unit variance at the true depth;
    lower quartile over the frame of the least windowed mean over levels."""
    levels = initial_depth.levels_of(stacks, step)
    costs = initial_depth.cost_volume(z[:2], stacks[:2], np.ones(2), levels, 5).min(axis=2) / z.shape[1]
    least: float = max(float(np.percentile(costs, 25)), 0.0)
    return max(1.3 * math.sqrt(least), 1e-5)


def first_depth(z: Array, stacks: Sequence[Masks], sigma: float, p: RestorationParameters) -> initial_depth.DepthStart:
    """The first depth by the chosen algorithm; that of a flat scene where it is known."""
    if p.flat_w is not None:
        flat = np.full(z.shape[2:], p.flat_w)
        return initial_depth.DepthStart(flat, np.ones(flat.shape, bool))
    sigmas = np.full(len(z), max(sigma, initial_depth.LEAST_SIGMA))
    if p.depth_start == "symmetric":
        return initial_depth.algorithm_2(z, stacks, sigma, direction=p.symmetric_axis)
    if p.depth_start == "blur":
        return initial_depth.algorithm_3(z, stacks, sigmas)
    return initial_depth.matched(z, stacks, sigmas)


def restore(
    photographs: Sequence[PlaneLike],
    stacks: Sequence[Masks],
    parameters: RestorationParameters | None = None,
    progress: Callable[[joint_descent.JointRound], None] | None = None,
) -> Outcome[Restoration]:
    """The sharp picture and the depth map, with a verdict and without value if refused. See `restoration_of`."""
    return judge(restoration_of(photographs, stacks, parameters, progress))


@kept_memory()
def restoration_of(
    photographs: Sequence[PlaneLike],
    stacks: Sequence[Masks],
    parameters: RestorationParameters | None = None,
    progress: Callable[[joint_descent.JointRound], None] | None = None,
) -> Restoration:
    """The sharp picture and the depth map, without verdict.

    photographs : P arrays (H, W) or (C, H, W), linear, white = 1, or planes; stacks : the masks of each as functions of
    one w, constant over the frame or a field of them.

    Raises BadInput, BadParameter, Refused if photographs, blurs or parameters cannot be restored (see `checks`).
    """
    p = parameters or RestorationParameters()
    z = checks.check_photographs(checks.as_channels(photographs))
    shape = (z.shape[2], z.shape[3])
    checks.check_blurs(stacks, shape)
    trust = checks.trust_of(z)
    saturated = float((trust == 0).mean())
    checks.check_texture(z, noise_upper_bound(z))
    checks.check_registered(z, stacks[0].R)
    registered = registration.register(z, trust, stacks)
    z, trust = registered.z, registered.trust
    sigma = noise_of(z, stacks)
    start = first_depth(z, stacks, sigma, p)
    fields = one_grid(stacks)
    schedule = Schedule(
        p.scheme.rounds, p.image_weight, p.depth_weight, not p.depth_total_variation, p.least_image_weight
    )
    data, other = joint_descent.problem_of(z, fields, trust, p.dtype, MaskField.blur)
    misfit = ~binary_erosion(np.pad(start.trusted, data.R), iterations=2, border_value=1)  # with a margin
    problem = joint_descent.JointProblem(
        data, other, p.scheme, schedule, sigma, reach_of(start.w, stacks), p.total_variation, p.depth_total_variation,
        misfit,
    )  # fmt: skip
    descend = joint_descent.run if p.flat_w is None else joint_descent.picture_alone
    state = descend(problem, joint_descent.begin(problem, start.w), progress)
    return _restoration(data, state, start, registered, saturated, p)


SEARCHED = 2 * len(MASK_RADII)
"""Places in which sharpening is searched for, in two photographs."""


def reach_of(w: Array, stacks: Sequence[Masks]) -> int:
    """Pixels about a depth edge where windowed matching mixes both sides: half-widths of both masks and the window."""
    w75 = float(np.percentile(w, 75))
    return sum(sorted(half_size_at(stack, w75) for stack in stacks)[-2:]) + 5


def _restoration(
    data: DataTerm, state: joint_descent.DescentState, start: initial_depth.DepthStart,
    registered: registration.PhotographRegistration, saturated: float, p: RestorationParameters,
) -> Restoration:  # fmt: skip
    R, inside = data.R, (slice(data.R, -data.R), slice(data.R, -data.R))
    data.focus(state.w)
    residual = data.residual(state.u)
    w = state.w[inside]
    flat = p.flat_w is not None
    limit = min(b.stack.max_w for b in data.blurs)
    spread = np.zeros_like(w) if flat else w_uncertainty(data, state.u, state.w, state.statistics.sigma)[inside]
    spread = np.minimum(spread, limit)
    masks, last = [b.stack for b in data.blurs], state.history[-1].weights
    sharp = state.u[:, R:-R, R:-R]
    finest = max(noise_upper_bound(data.z), LEAST_NOISE)
    moved = moved_objects(residual, data.z, finest)
    noise = max(finest, residual_noise(data.z, residual * ~moved, sharp, R))
    rms = _rms(residual, data.trust)
    freedom = 0.0 if flat else depth_freedom(data, state.u, last)
    downhill = data.blur_adjoint(residual)[:, R:-R, R:-R].astype(np.float64)
    weights = np.maximum(effective_weights(sharp.astype(np.float64), downhill), last.picture)
    error = picture_error(
        masks, w, weights, residual, sharp, noise, freedom, as_restored=p.least_image_weight > 0
    )  # fmt: skip
    # where something moved, neither w nor the picture is known
    occlusion = Occlusion(np.zeros(w.shape, bool), np.zeros(w.shape)) if flat else occlusion_of(w, masks)
    undetermined = float((np.where(moved, limit, spread) > 0.5).mean())
    spread = np.where(moved, np.maximum(spread, limit), occlusion.spread(spread))
    uncertain = error_map(error, residual, 2 * R + 1) * np.where(occlusion.mask, PICTURE, 1.0)
    uncertain = np.where(moved, max(error.std, float(sharp.std())), uncertain)
    diagnostics = RestorationDiagnostics(
        noise=state.statistics.sigma,
        residual_over_noise=rms / noise,
        unexplained=float(np.sqrt(max(rms**2 - noise**2, 0.0)) / max(float(data.z.std(axis=(-2, -1)).mean()), 1e-9)),
        picture_std=error.std,
        gained=error.blurred / max(error.std, 1e-9),
        undetermined=undetermined,
        noise_gain=noise_gain(masks, float(np.median(w)), last.picture),
        saturated=saturated,
        at_limit=float((w > limit - 0.2).mean()),
        moved=float(moved.mean()),
        occlusion=float(occlusion.mask.mean()),
        elsewhere_over_noise=_rms(residual * ~moved, data.trust * ~moved) / finest,
        # a blurred scene varies slowly, so that squares and fourth powers of the noise suffice
        sharpened=max(
            score.score
            for photograph in data.z
            for one in photograph
            for score in mask_scores([flat_noise(one.astype(np.float32))], MASK_RADII, [DRIFT, DRIFT**2])
        ),
    )
    corrections = (registered.shifts, registered.light, registered.turns, registered.zooms)
    result = (sharp, uncertain, w, spread, residual, start, state.history, diagnostics)
    return Restoration(*result, *corrections, moved, occlusion.mask, error.budget, error.brighter)


def _rms(residual: Array, trust: Array) -> float:
    trusted = trust.mean() * residual.size
    return float(np.sqrt(np.sum(residual.astype(np.float64) ** 2) / max(trusted, 1.0)))


def w_uncertainty(data: DataTerm, u: Array, w: Array, sigma: float) -> Array:
    """Lower bound of the standard deviation of w, pixels: squared derivatives in a window against the noise (chapter
    9)."""
    delta, window = 0.1, 7
    data.focus(w + delta)
    above = data.blur(u)
    data.focus(w - delta)
    change = (above - data.blur(u)) / (2 * delta)
    data.focus(w)
    power = uniform_filter((change**2).sum(axis=(0, 1)), window) * window**2
    return np.asarray(np.pad(sigma / np.sqrt(np.maximum(power, 1e-20)), data.R, mode="edge"))


def judge(result: Restoration) -> Outcome[Restoration]:
    """The restoration with its verdict, without value if refused."""
    d = result.diagnostics
    doubtful, refused = Verdict.DOUBTFUL, Verdict.REFUSED
    noise = d.noise_gain * d.noise
    negative = float(np.sqrt(np.mean(np.minimum(result.sharp, 0) ** 2)))
    order = _order(d)
    unexplained = 1.0 if order else SYMPTOM  # a wrong order alone causes a residual and an undetermined depth together
    return verdict_of([
        Check("motion", d.moved, MOST_MOVED, refused,
              f"something moved in {d.moved:.0%} of the frame between the photographs; at most {MOST_MOVED:.0%} is "
              "allowed", "take them again while nothing moves"),
        Check("residual", d.elsewhere_over_noise, MOST_RESIDUAL, refused,
              f"no picture explains the photographs: the residual is {d.elsewhere_over_noise:.1f} times their noise "
              f"and {d.unexplained:.0%} of their contrast; at most {MOST_RESIDUAL:.0f} times are allowed",
              f"{order}check that the photographs show one scene without motion, and that each shape belongs to its "
              "photograph", prior=unexplained),
        Check("motion", d.moved, 0, doubtful,
              f"{_what_moved(result)}: {_where(result.moved)}; picture and depth are unreliable there",
              "take them again while nothing moves, or omit that part"),
        Check("range", d.at_limit, MOST_AT_LIMIT, doubtful,
              f"w reaches the end of its range in {d.at_limit:.0%} of the frame", "raise --max-w"),
        Check("residual", d.residual_over_noise, EXPLAINED, doubtful,
              f"the shapes are inaccurate: in excess of noise, {d.unexplained:.1%} of the photographs' contrast remain "
              f"unexplained ({d.residual_over_noise:.1f} times the noise in total); the picture is uncertain by "
              f"{d.picture_std:.1%} of white or more",
              f"{order}for finer detail measure the shapes again, or check that nothing moved between the "
              "photographs", given=d.gained < LEAST_GAINED, prior=unexplained),
        Check("gain", d.gained, LEAST_GAIN, doubtful,
              f"the restored picture is expected to err by {d.picture_std:.1%} of white, and the least blurred "
              f"photograph by {d.picture_std * d.gained:.1%}: restoring gains nothing",
              f"{order}use the photograph, take photographs with less noise or more different blur, or raise "
              "--image-weight",
              least=True, prior=SYMPTOM**2),
        # no light is negative, so that negative light is a lower bound of the picture's error
        Check("negative light", negative / max(d.picture_std, LEAST_NOISE), 1, doubtful,
              f"the restored picture has negative light of {negative:.1%} of white, more than its expected error of "
              f"{d.picture_std:.1%}: the blur is not the one assumed",
              "lower --max-w to what the blur surely does not exceed, or measure the shapes"),
        Check("depth", d.undetermined, MOST_UNDETERMINED, doubtful,
              f"depth is not determined in {d.undetermined:.0%} of the frame, where texture is weak",
              "put structure into the scene"),
        Check("noise", noise, MOST_NOISE, doubtful,
              f"noise is amplified {d.noise_gain:.0f} times, to {noise:.0%} of white: ringing is likely",
              "raise --image-weight"),
        Check("clipping", d.saturated, MOST_SATURATED, doubtful, f"{d.saturated:.0%} of the samples are saturated",
              "expose less"),
        SHARPENED.check(d.sharpened, raw=False, places=SEARCHED),
    ], result)  # fmt: skip


def _order(d: RestorationDiagnostics) -> str:
    """The first remedy where photographs disagree and depth is undetermined; empty otherwise."""
    if d.undetermined <= MOST_UNDETERMINED:
        return ""
    return "check that photographs, ratios and f-numbers are in one order, as no depth explains them; "


def _what_moved(result: Restoration) -> str:
    """Description of the motion; next to depth edges it may be an occlusion instead."""
    if (result.moved & ~result.occlusion).any():
        return "something moved between the photographs"
    return "something moved between the photographs, or a near object occludes a part of the background"


def _where(moved: Mask) -> str:
    if not moved.any():
        return ""
    rows, columns = largest(moved)
    place = f"at x {columns.start} to {columns.stop - 1}, y {rows.start} to {rows.stop - 1}"
    return f"{moved.mean():.1%} of the frame, the most of it {place}"
