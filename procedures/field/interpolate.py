"""The PSF between the nodes: components, a model of their coefficients, and which model the nodes left out prefer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from procedures.field.alike import alike
from procedures.field.models import AxialSymmetry, Separate, SymmetryAxis, fit_axis
from procedures.field.whitening import MOST, WhitenedNodes
from procedures.numerics.scattered import Polynomial, ThinPlate
from procedures.outcome import Refused
from procedures.psf_field import CoefficientModel, Node, PsfField, in_half_diagonals

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

FEWEST = 6
"""Nodes from which a PSF is interpolated: a quadratic surface has six coefficients."""
FEWEST_OF_LENS = 9
"""Nodes from which a symmetric lens is tried and its axis told: those of the usual tour tell it to 0.003 half
diagonals where aberrations are strong."""
SAME_PLACE = 0.02
"""Nodes nearer than this, in half diagonals, are one place."""
NARROWEST = 0.02
"""Least root mean square distance of the nodes from a line, in half diagonals."""
ONE_BY_ONE = 30
"""Up to so many nodes are left out one at a time, more in ten groups."""
GROUPS = 10
COUNTS = (1, 2, 3, 4, 6, 8, 12, 16, MOST)
"""Numbers of components that are tried."""
DEGREES = (0, 1, 2, 3, 4, 5, 6)
STIFFNESS = (0.0, 0.03)
SYMMETRIC_DEGREES = (2, 3, 4)
HIGH_DEGREE, EARNED = 6, 0.95
"""Degree of a lens with strong aberrations near the corners, and its error over those of lower degrees from which it is
believed: where noise alone decides, its maps err by more than they tell."""
FEW = 16
"""Up to so many nodes a symmetric lens's own directions are its components, not the nodes': these span too little."""
MOST_SYMMETRIC = 16
"""Components of the symmetric lens among more nodes, at most."""
AXIS_ROUNDS = 2
"""In which the axis by what the nodes show is found again by what a lens about it shows."""
UNSURE = 0.25
"""Standard uncertainty of the axis, in half diagonals, from which it is not told."""


@dataclass(frozen=True)
class Candidate:
    """A way to interpolate, and its error at nodes left out: mean square, in units of the noise (1 is noise alone)."""

    name: str
    components: int
    error: float


@dataclass(frozen=True)
class Recipe:
    """How to build a model from nodes.

    Attributes
    ----------
    kind : str
        "polynomial", "thin plate" or "symmetric lens".
    setting : float
        The degree, or the plate's stiffness.
    axis : (x, y)
        Of the symmetric lens, in half diagonals from the frame's centre.
    """

    kind: str
    setting: float
    axis: tuple[float, float] = (0.0, 0.0)

    @property
    def name(self) -> str:
        """For people."""
        if self.kind == "thin plate":
            return "thin plate" if self.setting == 0 else "thin plate, stiff"
        return f"{self.kind}, degree {self.setting:.0f}"


@dataclass(frozen=True, eq=False)
class Interpolation:
    """A field, and how it was chosen.

    Attributes
    ----------
    field : PsfField
    recipe : Recipe
        Of its model; with the number of components it is enough to build the field again from its nodes.
    candidates : tuple of Candidate
        All that were tried, the best first.
    axis : SymmetryAxis or None
        Where the lens's axis of symmetry meets the frame, in half diagonals from its centre; None where the nodes
        do not tell.
    """

    field: PsfField
    recipe: Recipe
    candidates: tuple[Candidate, ...]
    axis: SymmetryAxis | None


def interpolate(plane: str, shape: tuple[int, int], nodes: Sequence[Node]) -> Interpolation:
    """The PSF over the frame from its nodes, by the model that predicts nodes left out best.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the plane.

    Raises
    ------
    Refused
        If there are fewer than six nodes, they lie on a line, or their PSFs are not sampled alike (`alike`).
    """
    _check(plane, shape, nodes)
    nodes = alike(nodes)
    data = WhitenedNodes.of(nodes, shape)
    folds = list(_folds(data.places))
    scores = _separate_scores(data, folds)
    best = min(scores, key=_rank)
    axis = _axis(data, best[1])
    if axis is not None:
        symmetric, axis = _symmetric_scores(data, folds, best[1], axis)
        scores += symmetric
    scores.sort(key=_rank)
    recipe, r, _ = scores[0]
    field = _field(plane, shape, nodes, data, recipe, r)
    told = tuple(Candidate(one.name, n, score) for one, n, score in scores)
    return Interpolation(field, recipe, told, axis)


def rebuild(plane: str, shape: tuple[int, int], nodes: Sequence[Node], recipe: Recipe, components: int) -> PsfField:
    """The field of an earlier choice from its nodes, without choosing again. Raises Refused as `interpolate`."""
    _check(plane, shape, nodes)
    nodes = alike(nodes)
    return _field(plane, shape, nodes, WhitenedNodes.of(nodes, shape), recipe, components)


def _check(plane: str, shape: tuple[int, int], nodes: Sequence[Node]) -> None:
    """Raise Refused for nodes between which nothing can be told."""
    places = in_half_diagonals(np.array([node.position for node in nodes]).reshape(-1, 2), shape)
    count = int(_places_apart(places).max(initial=-1)) + 1
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


def _places_apart(places: Array) -> Indices:
    """Number of the place of each node, (N,): nodes that hardly lie apart are one place, measured again."""
    pairs = cKDTree(places).query_pairs(SAME_PLACE, output_type="ndarray") if len(places) else np.zeros((0, 2), int)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)


def _folds(places: Array) -> Iterator[tuple[Indices, Indices]]:
    """(kept, left out), so that every node is left out once, and with it whatever was measured at its place."""
    number = _places_apart(places)
    count = int(number.max()) + 1
    groups = count if count <= ONE_BY_ONE else GROUPS
    for g in range(groups):
        out = number % groups == g
        yield np.flatnonzero(~out), np.flatnonzero(out)


# --- models as recipes: built again from whichever nodes are kept -------------------------------------------------


def _build(recipe: Recipe, data: WhitenedNodes, kept: Indices, V: Array) -> CoefficientModel:
    """The model of the nodes that are kept. Raises ValueError where they do not determine it."""
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
    """Mean (p,) and directions (n, p) of the nodes that are kept, the strongest first, in which its PSFs differ."""
    if recipe.kind == "symmetric lens" and _few(data):
        return data.symmetric_basis(kept, int(recipe.setting), recipe.axis)
    return data.basis(kept)


def _few(data: WhitenedNodes) -> bool:
    """Whether the nodes do not show by themselves all that a lens shows between them."""
    return len(data.z) <= FEW


_Scores = list[tuple[Recipe, int, float]]
_Folds = Sequence[tuple[Indices, Indices]]


def _rank(score: tuple[Recipe, int, float]) -> tuple[float, int]:
    """The error, and where errors are equal but for rounding the number of components: a constant has any number."""
    _, components, error = score
    return float(f"{error:.9g}"), components


def _separate_scores(data: WhitenedNodes, folds: _Folds) -> _Scores:
    """The error of every polynomial and plate with every number of components."""
    recipes = [Recipe("polynomial", d) for d in DEGREES] + [Recipe("thin plate", v) for v in STIFFNESS]
    counts = [r for r in COUNTS if r <= min(len(kept) for kept, _ in folds) - 1]
    total = {recipe: np.zeros(len(counts)) for recipe in recipes}
    for kept, out in folds:
        mean, V = data.basis(kept)
        inside, outside = (data.z[kept] - mean) @ V.T, (data.z[out] - mean) @ V.T
        trust = data.trust[out]
        all_of_it = trust @ np.sum((data.z[out] - mean) ** 2, axis=1)
        for recipe in list(total):
            try:
                predicted = _build(recipe, data, kept, V).predict(data.places[out], inside)
            except ValueError:
                del total[recipe]
                continue
            gained = np.cumsum(trust @ ((outside - predicted) ** 2 - outside**2))
            total[recipe] += all_of_it + gained[np.array(counts) - 1]
    size = data.z.size
    return [
        (recipe, r, float(e) / size) for recipe, errors in total.items() for r, e in zip(counts, errors, strict=True)
    ]


def _symmetric_scores(data: WhitenedNodes, folds: _Folds, r: int, axis: SymmetryAxis) -> tuple[_Scores, SymmetryAxis]:
    """The error of the symmetric lens, and its axis: that of the high degree where it earns it."""
    scores = [one for degree in SYMMETRIC_DEGREES for one in _symmetric_score(data, folds, r, degree, axis)]
    of_high = _refined(data, axis, HIGH_DEGREE) if _few(data) else axis
    high = _symmetric_score(data, folds, r, HIGH_DEGREE, of_high)
    earned = [one for one in high if one[2] < EARNED * min(error for *_, error in scores)]
    return scores + earned, of_high if earned else axis


def _symmetric_score(data: WhitenedNodes, folds: _Folds, r: int, degree: int, axis: SymmetryAxis) -> _Scores:
    """With all that the lens shows where nodes are few, else with as many components as served the others best, and
    with twice as many."""
    recipe = Recipe("symmetric lens", degree, _place(axis))
    counts = {r, min(2 * r, min(len(kept) for kept, _ in folds) - 1, MOST_SYMMETRIC)}
    if _few(data):
        counts = {len(_basis(data, np.arange(len(data.z)), recipe)[1])}
    scores: _Scores = []
    for count in sorted(counts):
        left = [_left_out(data, fold, _built(data, fold[0], recipe, count)) for fold in folds]
        error = sum(float(data.trust[out] @ np.sum(e**2, axis=1)) for e, (_, out) in zip(left, folds, strict=True))
        scores.append((recipe, count, error / data.z.size))
    return scores


_Built = tuple[CoefficientModel, Array, Array]
"""The model of some nodes, their mean (p,), and its directions (r, p)."""


def _built(data: WhitenedNodes, kept: Indices, recipe: Recipe, r: int) -> _Built:
    """By the nodes that are kept. Raises ValueError where they do not determine it."""
    mean, V = _basis(data, kept, recipe)
    return _build(recipe, data, kept, V[:r]), mean, V[:r]


def _left_out(data: WhitenedNodes, fold: tuple[Indices, Indices], built: _Built) -> Array:
    """Errors (n, p) at the nodes left out, in units of noise."""
    kept, out = fold
    model, mean, V = built
    origin = data.origin(mean, V)
    predicted = model.predict(data.places[out], data.z[kept] @ V.T - origin) + origin
    return np.asarray(data.z[out] - mean - (predicted - V @ mean) @ V)


def _shares(data: WhitenedNodes, out: Indices, model: CoefficientModel, r: int) -> Array:
    """How much of one node's variance comes to those left out through the others, (n,)."""
    return np.asarray(np.sum(model.transfer(data.places[out], r) ** 2, axis=(1, 2, 3)) / r)


def _axis(data: WhitenedNodes, r: int) -> SymmetryAxis | None:
    """Where the lens's axis is, by the nodes; None where they are too few, or do not really tell."""
    if len(data.z) < FEWEST_OF_LENS:
        return None
    everything = np.arange(len(data.z))
    mean, V = data.basis(everything)
    V = V[: max(r, 2)]
    axis = fit_axis(data.places, data.trust, data.optic(V), 4, data.z @ V.T - data.origin(mean, V))
    for _ in range(AXIS_ROUNDS if _few(data) else 0):
        axis = _refined(data, axis, 4)
    return axis if np.sqrt(np.trace(axis.covariance)) < UNSURE else None


def _refined(data: WhitenedNodes, axis: SymmetryAxis, degree: int) -> SymmetryAxis:
    """The axis near another, by all that a lens of that degree shows about it."""
    at = _place(axis)
    mean, V = data.symmetric_basis(np.arange(len(data.z)), degree, at)
    return fit_axis(data.places, data.trust, data.optic(V), degree, data.z @ V.T - data.origin(mean, V), at)


def _place(axis: SymmetryAxis) -> tuple[float, float]:
    return float(axis.position[0]), float(axis.position[1])


# --- the field and its error ----------------------------------------------------------------------------------------


def _field(
    plane: str,
    shape: tuple[int, int],
    nodes: Sequence[Node],
    data: WhitenedNodes,
    recipe: Recipe,
    r: int,
) -> PsfField:
    """The field by the chosen recipe, from all nodes."""
    everything = np.arange(len(nodes))
    mean, V = _basis(data, everything, recipe)
    V = V[:r]
    lack, rest = _lack(data, list(_folds(data.places)), recipe, r, V)
    outside = np.eye(data.size) - V.T @ V
    return PsfField(
        plane=plane,
        shape=shape,
        nodes=tuple(nodes),
        share=data.trust / data.trust.sum(),
        components=V @ data.back.T,
        analysis=V @ data.to,
        origin=data.origin(mean, V),
        model=_build(recipe, data, everything, V),
        lack=lack,
        lack_rest=rest * data.back @ outside @ data.back.T,
    )


def _lack(data: WhitenedNodes, folds: _Folds, recipe: Recipe, r: int, V: Array) -> tuple[Array, float]:
    """Variance of what the model leaves out: of the coefficients (r, r), and of every other direction.

    The errors at nodes left out have the noise of the node, that of the others by their share, and what is looked for,
    once at the node and by the same share through the others.
    """
    inner = data.inner(V)
    noise = data.size / data.trust
    excess, rest = np.zeros((r, r)), 0.0
    for fold in folds:
        kept, out = fold
        built = _built(data, kept, recipe, r)
        error, share = _left_out(data, fold, built), _shares(data, out, built[0], r)
        seen = error @ V.T
        mean_share = 1 / len(kept)
        for i, node in enumerate(out):
            beyond = np.outer(seen[i], seen[i]) - inner[node] - share[i] * inner[kept].mean(axis=0)
            excess += beyond / (1 + share[i])
            expected = (noise[node] - np.trace(inner[node])) * (1 + mean_share)
            beyond_rest = float(error[i] @ error[i] - seen[i] @ seen[i]) - expected
            rest += beyond_rest / (1 + mean_share) / (data.size - r)
    values, vectors = np.linalg.eigh(excess / len(data.z))
    return (vectors * np.maximum(values, 0)) @ vectors.T, max(rest / len(data.z), 0.0)
