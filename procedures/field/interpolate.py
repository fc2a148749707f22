"""The PSF between the nodes: components, a model of their coefficients, and its choice by cross-validation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from procedures.field.models import AxialSymmetry, Separate, SymmetryAxis, fit_axis
from procedures.field.whitening import MAX_DIRECTIONS, WhitenedNodes
from procedures.numerics.arrays import Array
from procedures.numerics.kernel_tail import SHAPES, tail_border, tail_kernels
from procedures.numerics.scattered import Polynomial, ThinPlate
from procedures.outcome import Check, Refused, Verdict
from procedures.psf import Psf
from procedures.psf_field import CoefficientModel, Node, PsfField, in_half_diagonals

Indices = npt.NDArray[np.intp]

FEWEST = 6  # positions from which a PSF is interpolated: a quadratic surface has six coefficients
FEWEST_OF_LENS = 9
"""Nodes from which a symmetric lens is tried and its axis estimated: those of the usual tour determine it to 0.003 half
diagonals where aberrations are strong."""
SAME_PLACE = 0.02  # nodes nearer than this, in half diagonals, are at one position
NARROWEST = 0.02  # minimum root mean square distance of the nodes from a line, in half diagonals
ONE_BY_ONE, GROUPS = 30, 10
"""Up to so many positions cross-validation excludes one at a time; more are excluded in groups."""
COUNTS = (1, 2, 3, 4, 6, 8, 12, 16, MAX_DIRECTIONS)  # candidate numbers of components
DEGREES = (0, 1, 2, 3, 4, 5, 6)
STIFFNESS = (0.0, 0.03)
SYMMETRIC_DEGREES = (2, 3, 4)
HIGH_DEGREE, MAX_ERROR_RATIO = 6, 0.95
"""Degree of a lens with strong aberrations near the corners, and its accepted error relative to lower degrees: where
noise decides, the error of its maps exceeds their uncertainty."""
FEW = 16
"""Up to so many nodes the components of a symmetric lens are its own: those of the nodes do not span its variation."""
MAX_SYMMETRIC = 16  # most components of the symmetric lens with more nodes
AXIS_ROUNDS = 2  # iterations that refine the axis estimated from the nodes' components by those of a lens about it
MAX_AXIS_ERROR = 0.25  # standard uncertainty of the axis, in half diagonals, from which it is not reported


@dataclass(frozen=True)
class InterpolationCandidate:
    """A tried interpolation; `error` is the mean square in cross-validation, in units of the noise."""

    name: str
    components: int
    error: float


@dataclass(frozen=True)
class Recipe:
    """How to build a model from nodes.

    kind : "polynomial", "thin plate" or "symmetric lens"
    setting : degree, or stiffness of the plate
    axis : (x, y), axis of the symmetric lens, in half diagonals from the frame's centre
    """

    kind: str
    setting: float
    axis: tuple[float, float] = (0.0, 0.0)

    @property
    def name(self) -> str:
        if self.kind == "thin plate":
            return "thin plate" if self.setting == 0 else "thin plate, stiff"
        return f"{self.kind}, degree {self.setting:.0f}"


@dataclass(frozen=True, eq=False)
class Interpolation:
    """A field, and its choice.

    recipe : of its model; with the number of components it is sufficient to rebuild the field from its nodes
    candidates : all tried interpolations, the best first
    axis : intersection of the lens's axis of symmetry with the frame; None where the nodes do not determine it
    """

    field: PsfField
    recipe: Recipe
    candidates: tuple[InterpolationCandidate, ...]
    axis: SymmetryAxis | None

    @property
    def curvature(self) -> Check:
        """Whether the charts show how the PSF varies between them: few, of a constant or linearly changing PSF, are as
        consistent with another one in the middle."""
        n, flat = len(self.field.nodes), self.recipe.kind == "polynomial" and self.recipe.setting < 2
        reason = f"{n} charts do not show how the PSF varies between them; it is taken as constant or as linear"
        remedy = f"photograph the chart at {FEWEST_OF_LENS} places or more, the frame's centre among them"
        return Check("curvature", flat and n < FEWEST_OF_LENS, 0, Verdict.DOUBTFUL, reason, remedy)


def interpolate(plane: str, shape: tuple[int, int], nodes: Sequence[Node]) -> Interpolation:
    """The PSF over the frame by the model with the smallest cross-validation error. Raises Refused if there are fewer
    than six nodes, they lie on a line, or have different samplings."""
    nodes, data = _prepared(plane, shape, nodes)
    folds = _folds(data.places)
    scores = _separate_scores(data, folds)
    best = min(scores, key=_rank)
    axis = _axis(data, best[1])
    if axis is not None:
        symmetric, axis = _symmetric_scores(data, folds, best[1], axis)
        scores += symmetric
    scores.sort(key=_rank)
    recipe, r, _ = scores[0]
    field = _field(plane, shape, nodes, data, recipe, r)
    candidates = tuple(InterpolationCandidate(one.name, n, error) for one, n, error in scores)
    return Interpolation(field, recipe, candidates, axis)


def rebuild(plane: str, shape: tuple[int, int], nodes: Sequence[Node], recipe: Recipe, components: int) -> PsfField:
    """The field of an earlier choice from its nodes, without choosing again. Raises Refused as `interpolate`."""
    nodes, data = _prepared(plane, shape, nodes)
    return _field(plane, shape, nodes, data, recipe, components)


def _prepared(plane: str, shape: tuple[int, int], nodes: Sequence[Node]) -> tuple[tuple[Node, ...], WhitenedNodes]:
    """The nodes with a common support, and whitened. Raises Refused where they cannot be interpolated."""
    places = in_half_diagonals(np.array([node.position for node in nodes]).reshape(-1, 2), shape)
    count = int(_place_numbers(places).max(initial=-1)) + 1
    if count < FEWEST:
        raise Refused(
            f"the PSF is interpolated from {FEWEST} places of the frame or more; plane {plane} has {count}",
            "photograph the chart at more places",
        )
    width = float(np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[-1]) / len(nodes) ** 0.5
    if width < NARROWEST:
        raise Refused(
            f"the places must enclose a part of the frame; those of plane {plane} lie on one line",
            "spread them over the frame, along both its sides",
        )
    nodes = with_common_support(nodes)
    return nodes, WhitenedNodes.of(nodes, shape)


def _place_numbers(places: Array) -> Indices:
    """Index of the position of each node, (N,): nodes closer than `SAME_PLACE` are repeated measurements."""
    pairs = cKDTree(places).query_pairs(SAME_PLACE, output_type="ndarray") if len(places) else np.zeros((0, 2), int)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)


_Folds = Sequence[tuple[Indices, Indices]]  # indices of the kept and excluded nodes


def _folds(places: Array) -> _Folds:
    """Folds that exclude every node once, together with the others at its position."""
    number = _place_numbers(places)
    count = int(number.max()) + 1
    groups = count if count <= ONE_BY_ONE else GROUPS
    excluded = [number % groups == g for g in range(groups)]
    return [(np.flatnonzero(~mask), np.flatnonzero(mask)) for mask in excluded]


# --- models as recipes, built from any subset of the nodes ---


def _model(recipe: Recipe, data: WhitenedNodes, kept: Indices, V: Array) -> CoefficientModel:
    """The model of the kept nodes. Raises ValueError where they do not determine it."""
    places, trust = data.places[kept], data.trust[kept]
    if recipe.kind == "polynomial":
        return Separate(recipe.name, Polynomial(places, trust, int(recipe.setting)))
    if recipe.kind == "thin plate":
        return Separate(recipe.name, ThinPlate(places, trust, recipe.setting))
    return AxialSymmetry(places, trust, data.optic(V), int(recipe.setting), recipe.axis)


def recipe_of(model: CoefficientModel) -> Recipe:
    """The recipe by which a model was built. Raises TypeError for a model of another kind."""
    match model:
        case AxialSymmetry():
            return Recipe("symmetric lens", model.degree, model.axis)
        case Separate(smoother=Polynomial(degree=degree)):
            return Recipe("polynomial", degree)
        case Separate(smoother=ThinPlate(stiffness=stiffness)):
            return Recipe("thin plate", stiffness)
    raise TypeError(f"a field of model {model.name!r} cannot be written: pass one of estimate_field or read_field")


def _basis(data: WhitenedNodes, kept: Indices, recipe: Recipe) -> tuple[Array, Array]:
    """Mean (p,) and principal directions (n, p) of the variation of the kept nodes, the strongest first."""
    if recipe.kind == "symmetric lens" and _few(data):
        return data.symmetric_basis(kept, int(recipe.setting), recipe.axis)
    return data.basis(kept)


def _few(data: WhitenedNodes) -> bool:
    """Whether the nodes do not span the variation of a lens between them."""
    return len(data.z) <= FEW


_Score = tuple[Recipe, int, float]  # recipe, number of components, error


def _rank(score: _Score) -> tuple[float, int]:
    """The error, and where errors are equal within rounding the number of components: a constant has any number."""
    _, components, error = score
    return float(f"{error:.9g}"), components


def _separate_scores(data: WhitenedNodes, folds: _Folds) -> list[_Score]:
    recipes = [Recipe("polynomial", d) for d in DEGREES] + [Recipe("thin plate", v) for v in STIFFNESS]
    counts = [r for r in COUNTS if r <= min(len(kept) for kept, _ in folds) - 1]
    total = {recipe: np.zeros(len(counts)) for recipe in recipes}
    for kept, out in folds:
        mean, V = data.basis(kept)
        inside, outside = (data.z[kept] - mean) @ V.T, (data.z[out] - mean) @ V.T
        trust = data.trust[out]
        without_components = trust @ np.sum((data.z[out] - mean) ** 2, axis=1)
        for recipe in list(total):
            try:
                predicted = _model(recipe, data, kept, V).predict(data.places[out], inside)
            except ValueError:
                del total[recipe]
                continue
            change = np.cumsum(trust @ ((outside - predicted) ** 2 - outside**2))
            total[recipe] += without_components + change[np.array(counts) - 1]
    return [
        (recipe, r, float(error) / data.z.size)
        for recipe, errors in total.items()
        for r, error in zip(counts, errors, strict=True)
    ]


def _symmetric_scores(
    data: WhitenedNodes, folds: _Folds, r: int, axis: SymmetryAxis
) -> tuple[list[_Score], SymmetryAxis]:
    """Errors of the symmetric lens, and its axis: that of the high degree where it is accepted."""
    scores = [score for degree in SYMMETRIC_DEGREES for score in _symmetric_score(data, folds, r, degree, axis)]
    high_axis = _refined(data, axis, HIGH_DEGREE) if _few(data) else axis
    limit = MAX_ERROR_RATIO * min(error for *_, error in scores)
    high = [score for score in _symmetric_score(data, folds, r, HIGH_DEGREE, high_axis) if score[2] < limit]
    return scores + high, high_axis if high else axis


def _symmetric_score(data: WhitenedNodes, folds: _Folds, r: int, degree: int, axis: SymmetryAxis) -> list[_Score]:
    """Errors with all components of the lens where nodes are few; otherwise with the best number of components of the
    separate models, and twice as many."""
    recipe = Recipe("symmetric lens", degree, _coordinates(axis))
    counts = {r, min(2 * r, min(len(kept) for kept, _ in folds) - 1, MAX_SYMMETRIC)}
    if _few(data):
        counts = {len(_basis(data, np.arange(len(data.z)), recipe)[1])}
    scores: list[_Score] = []
    for count in sorted(counts):
        errors = [_validated(data, fold, recipe, count)[0] for fold in folds]
        error = sum(float(data.trust[out] @ np.sum(e**2, axis=1)) for e, (_, out) in zip(errors, folds, strict=True))
        scores.append((recipe, count, error / data.z.size))
    return scores


def _validated(
    data: WhitenedNodes, fold: tuple[Indices, Indices], recipe: Recipe, r: int
) -> tuple[Array, CoefficientModel]:
    """Errors (n, p) at the excluded nodes in units of noise, and the model of the others. Raises ValueError if
    undetermined."""
    kept, out = fold
    mean, V = _basis(data, kept, recipe)
    V = V[:r]
    model, origin = _model(recipe, data, kept, V), data.origin(mean, V)
    predicted = model.predict(data.places[out], data.z[kept] @ V.T - origin) + origin
    return np.asarray(data.z[out] - mean - (predicted - V @ mean) @ V), model


def _axis(data: WhitenedNodes, r: int) -> SymmetryAxis | None:
    """The lens's axis; None where the nodes are too few or do not determine it."""
    if len(data.z) < FEWEST_OF_LENS:
        return None
    mean, V = data.basis(np.arange(len(data.z)))
    V = V[: max(r, 2)]
    axis = fit_axis(data.places, data.trust, data.optic(V), 4, data.z @ V.T - data.origin(mean, V))
    for _ in range(AXIS_ROUNDS if _few(data) else 0):
        axis = _refined(data, axis, 4)
    return axis if np.sqrt(np.trace(axis.covariance)) < MAX_AXIS_ERROR else None


def _refined(data: WhitenedNodes, axis: SymmetryAxis, degree: int) -> SymmetryAxis:
    """The axis near another one, by all components of a lens of that degree, its constant first term among them."""
    start = _coordinates(axis)
    V = data.symmetric_basis(np.arange(len(data.z)), degree, start)[1]
    return fit_axis(data.places, data.trust, data.optic(V), degree, data.z @ V.T, start)


def _coordinates(axis: SymmetryAxis) -> tuple[float, float]:
    return float(axis.position[0]), float(axis.position[1])


# --- the field and its error ---


def _field(
    plane: str, shape: tuple[int, int], nodes: tuple[Node, ...], data: WhitenedNodes, recipe: Recipe, r: int
) -> PsfField:
    everything = np.arange(len(nodes))
    mean, V = _basis(data, everything, recipe)
    V = V[:r]
    lack, rest = _model_error(data, _folds(data.places), recipe, r, V)
    return PsfField(
        plane=plane,
        shape=shape,
        nodes=nodes,
        share=data.trust / data.trust.sum(),
        components=V @ data.back.T,
        analysis=V @ data.to,
        origin=data.origin(mean, V),
        model=_model(recipe, data, everything, V),
        lack=lack,
        lack_rest=rest * data.back @ (np.eye(data.size) - V.T @ V) @ data.back.T,
    )


def _model_error(data: WhitenedNodes, folds: _Folds, recipe: Recipe, r: int, V: Array) -> tuple[Array, float]:
    """Variance of the model error, of the coefficients (r, r) and in every other direction: cross-validation errors
    contain it once at the node and with the others' weights, beside their noise."""
    inner = data.inner(V)
    noise = data.size / data.trust
    excess, rest = np.zeros((r, r)), 0.0
    for kept, out in folds:
        error, model = _validated(data, (kept, out), recipe, r)
        # share of one node's variance that reaches the excluded ones through the others
        share = np.sum(model.transfer(data.places[out], r) ** 2, axis=(1, 2, 3)) / r
        along = error @ V.T
        mean_share = 1 / len(kept)
        for i, node in enumerate(out):
            beyond = np.outer(along[i], along[i]) - inner[node] - share[i] * inner[kept].mean(axis=0)
            excess += beyond / (1 + share[i])
            expected = (noise[node] - np.trace(inner[node])) * (1 + mean_share)
            beyond_rest = float(error[i] @ error[i] - along[i] @ along[i]) - expected
            rest += beyond_rest / (1 + mean_share) / (data.size - r)
    values, vectors = np.linalg.eigh(excess / len(data.z))
    return (vectors * np.maximum(values, 0)) @ vectors.T, max(rest / len(data.z), 0.0)


# --- nodes of one sampling: narrower supports are extended to the widest one by their tails ---


def with_common_support(nodes: Sequence[Node]) -> tuple[Node, ...]:
    """The nodes with PSFs of the widest support. Raises Refused if samplings or tails' shapes differ, or supports
    without a tail."""
    first = nodes[0]
    for node in nodes[1:]:
        if node.psf.s != first.psf.s:
            raise Refused(
                f"the PSFs of a field must have the same samples per pixel; {_name(first)} has s = {first.psf.s}, "
                f"{_name(node)} has s = {node.psf.s}",
                "measure all photographs with one s: give it with -s",
            )
        if len(node.psf.tail.amplitudes) != len(first.psf.tail.amplitudes):
            raise Refused(
                f"the PSFs of a field must all have the same tail, or none; {_name(first)} has {_shapes(first)} and "
                f"{_name(node)} has {_shapes(node)}",
                "measure all photographs with this version",
            )
    k = max(node.psf.k for node in nodes)
    narrow = next((node for node in nodes if node.psf.k < k and not len(node.psf.tail.amplitudes)), None)
    if narrow is not None:
        raise Refused(
            f"the PSFs of a field must have supports of one size where they have no tail; {_name(narrow)} has k = "
            f"{narrow.psf.k}, another k = {k}",
            "measure all photographs with one k: give it with -k",
        )
    return tuple(node if node.psf.k == k else replace(node, psf=widened(node.psf, k)) for node in nodes)


def widened(psf: Psf, k: int) -> Psf:
    """A PSF with a tail on a wider support of k x k samples: the added samples are those of the tail, without error of
    their own.

    The PSF is unchanged, except for a small difference of the azimuthal shapes beyond their reach.
    """
    n, q = psf.k**2, len(psf.tail.amplitudes)
    if k < psf.k or k % 2 == 0 or not q:
        raise ValueError(
            f"the new support must be odd and at least {psf.k}, and the PSF have a tail; got {k}, {q} shapes"
        )
    narrow, wide = tail_kernels(psf.k)[:q], tail_kernels(k)[:q]
    M = np.zeros((k * k + q, n + q))
    inner = np.pad(np.arange(n).reshape(psf.k, psf.k) + 1, (k - psf.k) // 2).ravel()
    M[np.flatnonzero(inner), inner[inner > 0] - 1] = 1
    low = tail_border(psf.k) - k // 2
    M[: k * k, n:] = narrow[:, low : low + k, low : low + k].reshape(q, -1).T
    # amplitudes (q,) of the wide support's shapes equal to those of the narrow one; azimuthal shapes as the mean
    beyond = k // 2 + 1
    ratio = np.array([a[len(a) // 2, len(a) // 2 + beyond] / b[len(b) // 2, len(b) // 2 + beyond]
                      for a, b in zip(narrow[:2], wide[:2], strict=True)])  # fmt: skip
    rescaling = np.array([ratio[j] if SHAPES[j].startswith("1/") else ratio[0] for j in range(len(narrow))])
    M[k * k :, n:] = np.diag(rescaling)
    return Psf.of_unit_sum(M @ psf.parameters, M @ psf.parameter_covariance @ M.T, k, psf.s)


def _name(node: Node) -> str:
    return f"chart {node.number} of {node.source}" if node.source else f"chart {node.number}"


def _shapes(node: Node) -> str:
    count = len(node.psf.tail.amplitudes)
    return f"{count} tail shapes" if count else "no tail"
