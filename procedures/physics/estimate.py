"""Physical model of a measured PSF: sensor and lens parameters with uncertainties, wavefront error, Strehl ratio."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from procedures.display import summary
from procedures.numbers import STREHL_LENS, WAVEFRONT_RMS, WAVEFRONT_RMS_NM
from procedures.numerics.arrays import Array, Mask
from procedures.outcome import BadParameter, Check, Outcome, Quantity, Verdict, checked_type, verdict_of
from procedures.physics.model import TERMS, Aperture, Grid, LowPass, ModelParts, bounds_of, names_of, start_of
from procedures.psf import Psf
from procedures.quality import Diffraction

METHOD = "generalised least squares by the PSF's covariance"
STEP = 1e-4
ALIKE = 2.0  # difference of the criterion up to which two models are equally good: odds of e to 1
SENSOR_UNITS = {"side": "pixel", "separation": "pixel", "diffusion": "pixel", "notch": "1"}
EVEN = ("defocus", "astigmatism", "astigmatism_oblique", "spherical")
"""Aberrations whose common sign one PSF does not determine: the largest is taken as positive."""


@dataclass(frozen=True)
class Physics:
    """The physical model of a PSF.

    aperture, low_pass : the photosite's shape and the low-pass filter
    missing_corner_deg : direction of the missing corner of an L-shaped aperture, from x towards y, y down
    numbers : side, notch, separation, diffusion (in sensor pixels), fill_factor; aberrations; wavefront_rms, also in
        nanometres; strehl_lens, the Strehl ratio of the lens alone. A parameter at its bound has the bound as its
        value, and a one-sided uncertainty.
    chi_square, freedom : float, int
    remaining : chi-square over that of the zero model: the fraction of the PSF, weighted by its noise, left unexplained
    prediction : (k, k) the model's PSF
    candidates : the models tried, and the excess of their criterion over the best one's
    """

    aperture: str
    low_pass: str
    missing_corner_deg: int | None
    numbers: Mapping[str, Quantity]
    chi_square: float
    freedom: int
    remaining: float
    prediction: Array
    candidates: tuple[tuple[str, float], ...]

    __repr__ = summary


def estimate_physics(
    psf: Psf, diffraction: Diffraction | None, pitch: int, progress: Callable[[str], object] | None = None
) -> Outcome[Physics]:
    """Fit the physical model that explains a measured PSF best.

    psf : Psf, with its full covariance
    diffraction : Diffraction or None, aperture, pitch of the plane's pixels, wavelength
    pitch : int, sensor pixels per pixel of the plane
    progress : callable, called with a sentence after every model that was fitted

    Raises BadParameter if aperture or pitch are not known: without them diffraction and defocus cannot be separated.
    """
    checked_type(psf, Psf, "pass the psf of an estimate, outcome.result().psf, or field.at(x, y)")
    data = WhitenedPsf.of(Grid(psf, check_known(diffraction), pitch))
    fit, tried = choose(data, progress)
    numbers = _numbers(data, fit)
    # numbers of a fit, with uncertainties from its curvature, that are limited on one side: parameters at bounds, fill
    # factor above 1, Strehl ratio 1 with wavefront error 0
    limits = [_parameter(data, fit, name, numbers[name]) for name in fit.parts.names]
    bounded = [limit for limit in (*limits, _fill_factor(numbers["fill_factor"]), *_no_aberrations(data, fit)) if limit]
    numbers |= {bound.name: bound.quantity(numbers[bound.name]) for bound in bounded}
    scale = scale_of(tried)
    least = fit.criterion(scale)
    prediction, _ = data.grid.model(fit.parts, fit.p)
    nothing = float(np.sum((data.W @ data.grid.psf.h.ravel()) ** 2))
    k = data.grid.psf.k
    physics = Physics(
        aperture=str(fit.parts.aperture),
        low_pass=str(fit.parts.low_pass),
        missing_corner_deg=fit.parts.aperture.missing_corner_deg,
        numbers=numbers,
        chi_square=fit.chi2,
        freedom=fit.freedom,
        remaining=fit.chi2 / nothing,
        prediction=prediction.reshape(k, k),
        candidates=tuple((_words(one), one.criterion(scale) - least) for one in tried),
    )
    return verdict_of(_flags(fit, tried, bounded), physics)


def check_known(diffraction: Diffraction | None) -> Diffraction:
    """The diffraction limit. Raises BadParameter where it is not known."""
    if diffraction is None:
        raise BadParameter(
            "the physics of a PSF needs the sensor's pitch and the f-number; one of them is not known",
            "give --pixel-pitch-um and --f-number",
        )
    return diffraction


def _flags(fit: ModelFit, tried: list[ModelFit], bounded: list[OneSided]) -> list[Check]:
    ratio = fit.chi2 / fit.freedom
    scale = scale_of(tried)
    limit = fit.criterion(scale) + ALIKE
    rivals = [other for other in tried if other.parts != fit.parts and other.criterion(scale) < limit]
    return [
        Check("residual", ratio**0.5, 2**0.5, Verdict.DOUBTFUL,
              f"the residual of the best model is {ratio:.1f} times the expected noise variance",
              "check --f-number, --pixel-pitch-um and --wavelength-nm; the model contains no other causes of blur"),
        Check("rivals", bool(rivals), 0, Verdict.DOUBTFUL,
              f"this PSF does not separate two models: {_words(fit)}; {_words(rivals[0]) if rivals else ''}",
              "compare with other planes and apertures: aberrations change with them, the sensor's parts do not"),
        *(Check(one.name, not one.follows, 0, Verdict.DOUBTFUL, one.words,
                "take it as a limit, not as a value; reduce the noise, and check f-number and pixel pitch")
          for one in bounded),
    ]  # fmt: skip


def _words(fit: ModelFit) -> str:
    free = [TERMS[i].replace("_", " ") for i in fit.parts.aberrations]
    lens = "all aberrations" if len(free) == len(TERMS) else " and ".join(free) or "no aberrations"
    charge = ", diffusion" if fit.parts.diffusion else ""
    return f"{fit.parts.aperture}, low-pass filter: {fit.parts.low_pass}{charge}, {lens}"


def _numbers(data: WhitenedPsf, fit: ModelFit) -> dict[str, Quantity]:
    names, n = names_of(fit.parts), data.rank
    even = [value for name, value in zip(names, fit.p, strict=True) if name in EVEN]
    sign = -1.0 if even and max(even, key=abs) < 0 else 1.0
    spread = np.sqrt(np.maximum(np.diag(fit.covariance), 0))
    numbers: dict[str, Quantity] = {}
    for name, value, uncertainty in zip(names, fit.p, spread, strict=True):
        if name in ("shift_x", "shift_y"):  # the centre is a convention of the marks
            continue
        unit = "wave rms" if name in TERMS else SENSOR_UNITS[name]
        signed = sign * value if name in EVEN else value
        numbers[name] = Quantity(float(signed), unit, float(uncertainty), METHOD, n)

    def derived(name: str, unit: str, function: Callable[[Array], float]) -> None:
        gradient = np.array(
            [(function(fit.p + e) - function(fit.p - e)) / (2 * STEP) for e in STEP * np.eye(len(fit.p))]
        )
        variance = float(gradient @ fit.covariance @ gradient)
        numbers[name] = Quantity(function(fit.p), unit, max(variance, 0.0) ** 0.5, METHOD, n)

    place = {name: i for i, name in enumerate(names)}
    notch = place.get("notch") if fit.parts.aperture is not Aperture.SQUARE else None
    derived("fill_factor", "1", lambda p: float(p[place["side"]] ** 2 * (1 - (p[notch] ** 2 if notch else 0.0))))
    count, pupil = 2 + len(fit.parts.names), data.grid.pupil
    derived(WAVEFRONT_RMS, "wave", lambda p: float(np.linalg.norm(p[count:])))
    nm = data.grid.diffraction.wavelength_nm
    derived(WAVEFRONT_RMS_NM, "nm", lambda p: nm * float(np.linalg.norm(p[count:])))

    def strehl(p: Array) -> float:
        waves = np.zeros(len(TERMS))
        waves[list(fit.parts.aberrations)] = p[count:]
        return pupil.strehl(waves)

    derived(STREHL_LENS, "1", strehl)
    return numbers


# --- choice of a model ---
# support.

ABERRATIONS: tuple[tuple[int, ...], ...] = ((), (0,), (7,), (0, 7), tuple(range(8)))
"""None, defocus, spherical, both, all eight."""


def choose(data: WhitenedPsf, progress: Callable[[str], object] | None = None) -> tuple[ModelFit, list[ModelFit]]:
    """The best model, and all models in order of the criterion: low-pass filter and diffusion, aperture, and the filter
    again are chosen with free aberrations, then useless aberrations removed."""
    tried: dict[ModelParts, ModelFit] = {}

    def best_of(candidates: Iterable[ModelParts], near: ModelParts | None = None) -> ModelParts:
        candidates = list(candidates)
        for parts in candidates:
            if parts not in tried:
                tried[parts] = fit_parts(data, parts, start_near(tried[near], parts) if near else None)
                if progress is not None:
                    progress(f"{len(tried)} models of sensor and lens fitted")
        scale = scale_of(tried.values())
        return min(candidates, key=lambda parts: tried[parts].criterion(scale))

    filters = [ModelParts(low_pass=filter_) for filter_ in LowPass]
    best_of(filters)
    # spots can mimic diffusion, and two boxes of half the width a single one: compare both before fixing either
    diffusing = [best_of([replace(parts, diffusion=True)], near=parts) for parts in filters]
    parts = best_of([*filters, *diffusing])
    square = parts
    parts = best_of([square, *(replace(square, aperture=shape) for shape in Aperture)], near=square)
    if parts.aperture is not Aperture.SQUARE:
        parts = best_of((replace(parts, low_pass=filter_) for filter_ in LowPass), near=parts)
    # diffusion is tried again: slight defocus can mimic it, and all aberrations together always can
    lenses = [replace(parts, aberrations=some) for some in ABERRATIONS]
    parts = best_of((replace(lens, diffusion=flag) for lens in lenses for flag in (False, True)), near=parts)
    scale = scale_of(tried.values())
    order = sorted(tried.values(), key=lambda fit: fit.criterion(scale))
    return tried[parts], order


def scale_of(fits: Iterable[ModelFit]) -> float:
    """Reduced chi-square of the best model, at least 1: where no model is perfect, differences count less."""
    return max(1.0, min(fit.chi2 / fit.freedom for fit in fits))


# --- numbers at a bound ---

AT_BOUND = 1e-3  # fraction of a parameter's range within which it counts as at its bound
PROBES = ("defocus", "astigmatism", "coma_x", "spherical")
"""Aberrations tried one at a time for the largest that the data allow where the fit has none."""
LARGEST_PROBE = 0.25


@dataclass(frozen=True)
class OneSided:
    """A number at its bound. `best` is the unconstrained optimum, at or beyond the bound; `follows` marks a number that
    restates another one."""

    name: str
    bound: float
    uncertainty: float
    best: float
    follows: bool = False

    @property
    def words(self) -> str:
        """Description of the limit."""
        name = self.name.replace("_", " ")
        if self.best != self.bound:
            return f"{name} fits best at {self.best:.3g}, beyond its bound {self.bound:g}"
        return f"{name} is at its bound {self.bound:g}, within {self.uncertainty:.2g}"

    def quantity(self, number: Quantity) -> Quantity:
        """The number with its one-sided uncertainty."""
        method = f"{number.method}; at its bound: chi-square rises by 1 over this distance, on one side"
        return replace(number, value=self.bound, uncertainty=self.uncertainty, method=method)


def _parameter(data: WhitenedPsf, fit: ModelFit, name: str, number: Quantity) -> OneSided | None:
    place = names_of(fit.parts).index(name)
    low, high = (float(limits[place]) for limits in bounds_of(fit.parts))
    for bound, inward in ((low, 1.0), (high, -1.0)):
        if abs(number.value - bound) < AT_BOUND * (high - low):
            return OneSided(name, bound, distance_of_rise(data, fit, name, bound, inward), bound)
    return None


def _fill_factor(number: Quantity) -> OneSided | None:
    """Limit of the fill factor, as a photosite is no larger than its pixel. With chi-square ((f - best) / u)^2, it
    rises by 1 over its value at f = 1 at u (sqrt(d^2 + 1) - d) below, d = (best - 1) / u."""
    if number.value <= 1:
        return None
    d = (number.value - 1) / max(number.uncertainty, 1e-9)
    return OneSided("fill_factor", 1.0, number.uncertainty * (float(np.hypot(d, 1)) - d), number.value)


def _no_aberrations(data: WhitenedPsf, fit: ModelFit) -> list[OneSided]:
    """Limits where a fit needs no aberrations: the loss of Strehl ratio by the least visible aberration, and the
    largest wavefront error of any of them."""
    if fit.parts.aberrations:
        return []
    hidden, drops = [], []
    for term in (TERMS.index(name) for name in PROBES):
        parts = replace(fit.parts, aberrations=(term,))
        p = start_near(fit, parts)
        p[-1] = 0.0
        started = replace(fit, parts=parts, p=p)
        hidden.append(min(distance_of_rise(data, started, TERMS[term], 0.0, 1.0), LARGEST_PROBE))
        drops.append(1 - data.grid.pupil.strehl(hidden[-1] * np.eye(len(TERMS))[term]))
    nm = data.grid.diffraction.wavelength_nm
    return [
        OneSided(STREHL_LENS, 1.0, max(drops), 1.0),
        OneSided(WAVEFRONT_RMS, 0.0, max(hidden), 0.0, follows=True),
        OneSided(WAVEFRONT_RMS_NM, 0.0, nm * max(hidden), 0.0, follows=True),
    ]


# --- Model parameters by generalised least squares, weighted by the PSF's covariance ---

RANK = 1e-9
"""Fraction of the covariance's largest eigenvalue below which a direction is taken as free of noise.

A PSF of sum 1 has one such direction, and two more where its centre was fixed. The value along such a direction is a
convention and carries no information about a model."""
RISE_FROM, RISE_STEPS = 0.02, 12
"""Start of the search for a rise of chi-square, as a fraction of the parameter's range, and maximum of iterations."""
STARTS = ((0.06, 0.03), (0.06, -0.03))
"""Starting values of defocus and spherical aberration in waves: a fit does not leave the wrong relative sign of the
two, so both signs are tried."""


@dataclass(frozen=True, eq=False)
class WhitenedPsf:
    """A PSF transformed to white noise: W (r, k^2) with W C W' = 1, r the rank of the covariance C."""

    grid: Grid
    W: Array

    @classmethod
    def of(cls, grid: Grid) -> WhitenedPsf:
        """Whiten by the eigenvectors of the covariance."""
        values, vectors = np.linalg.eigh((grid.psf.covariance + grid.psf.covariance.T) / 2)
        kept = values > RANK * values[-1]
        return cls(grid, (vectors[:, kept] / np.sqrt(values[kept])).T)

    @property
    def rank(self) -> int:
        """Number of independent data."""
        return len(self.W)


@dataclass(frozen=True, eq=False)
class ModelFit:
    """A fitted model.

    p : (n,) parameters in the order of `model.names_of`; covariance : (n, n) scaled by the reduced chi-square where
    that exceeds 1.
    """

    parts: ModelParts
    p: Array
    covariance: Array
    chi2: float
    freedom: int

    def criterion(self, scale: float = 1.0) -> float:
        """Schwarz's information criterion, smaller is better; chi-square is divided by `scale`."""
        return self.chi2 / scale + len(self.p) * float(np.log(self.freedom + len(self.p)))


def fit_parts(data: WhitenedPsf, parts: ModelParts, start: Array | None = None) -> ModelFit:
    """The best parameters of a model, from one start or from `STARTS`."""
    pairs = STARTS if parts.aberrations else STARTS[:1]
    starts = [start_of(parts, *pair) for pair in pairs] if start is None else [start]
    low, high = bounds_of(parts)
    fits = [_descend(data, parts, np.clip(first, low + 1e-6, high - 1e-6), (low, high)) for first in starts]
    return min(fits, key=lambda fit: fit.chi2)


def start_near(fit: ModelFit, parts: ModelParts) -> Array:
    """Starting values for a model with other parts, taken from a fit that shares most of them."""
    known = dict(zip(names_of(fit.parts), fit.p, strict=True))
    fresh = start_of(parts, *STARTS[0])
    return np.array([known.get(name, value) for name, value in zip(names_of(parts), fresh, strict=True)])


def distance_of_rise(data: WhitenedPsf, fit: ModelFit, name: str, bound: float, inward: float) -> float:
    """Distance from a bound at which chi-square, minimised over the other parameters, has risen by 1.

    Where the fit's residual exceeds the noise, the required rise is larger by the reduced chi-square. For a parameter
    whose effect begins with its square (defocus, diffusion) this is the only uncertainty at the bound.

    fit : includes this parameter; its start is moved to the bound first
    inward : 1 or -1, direction from the bound into the range
    """
    low, high = bounds_of(fit.parts)
    place = names_of(fit.parts).index(name)
    free = np.arange(len(fit.p)) != place
    reach = float(high[place] - low[place])

    def fit_at(distance: float, start: Array) -> ModelFit:
        p = start.copy()
        p[place] = bound + inward * distance
        return _descend(data, fit.parts, p, (low, high), free)

    at = fit_at(0.0, fit.p)
    target = max(at.chi2 / at.freedom, 1.0)
    distance, near, far = RISE_FROM * reach, 0.0, reach
    for _ in range(RISE_STEPS):
        rise = fit_at(distance, at.p).chi2 - at.chi2
        if abs(rise / target - 1) < 0.1:
            break
        near, far = (distance, far) if rise < target else (near, distance)
        # chi-square rises with the second to fourth power; noise may bend the first part, the bracket holds anyway
        distance *= float(np.clip((target / max(rise, 0.01 * target)) ** (1 / 3), 0.1, 10))
        if not near < distance < far:
            distance = (near + far) / 2
    return distance


def _descend(
    data: WhitenedPsf,
    parts: ModelParts,
    start: Array,
    bounds: tuple[Array, Array],
    free: Mask | None = None,
) -> ModelFit:
    """Best fit from a start; parameters that are not `free` are held."""
    moves = np.ones(len(start), dtype=bool) if free is None else free
    cache: dict[bytes, tuple[Array, Array]] = {}

    def evaluated(x: Array) -> tuple[Array, Array]:
        key = x.tobytes()
        if key not in cache:
            cache.clear()
            cache[key] = data.grid.model(parts, placed(x))
        return cache[key]

    def placed(x: Array) -> Array:
        p = start.copy()
        p[moves] = x
        return p

    measured = data.grid.psf.h.ravel()
    inside = np.clip(start, bounds[0] + 1e-9, bounds[1] - 1e-9)
    done = least_squares(
        lambda x: data.W @ (evaluated(x)[0] - measured),
        inside[moves],
        jac=lambda x: data.W @ evaluated(x)[1][:, moves],
        bounds=(bounds[0][moves], bounds[1][moves]),
        xtol=1e-6,
        ftol=1e-6,
        gtol=1e-6,
        max_nfev=30,
    )
    chi2, freedom = 2 * float(done.cost), data.rank - int(moves.sum())
    covariance = np.zeros((len(start), len(start)))
    covariance[np.ix_(moves, moves)] = np.linalg.pinv(done.jac.T @ done.jac, rcond=1e-12) * max(chi2 / freedom, 1.0)
    return ModelFit(parts, placed(np.asarray(done.x, dtype=np.float64)), covariance, chi2, freedom)
