"""What a photographed chart tells beside its node: headline numbers, its bins, and what all their errors share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from procedures.budget import Budget
from procedures.numbers import FWHM_HORIZONTAL, FWHM_VERTICAL, MTF50_HORIZONTAL, MTF50_RADIAL, MTF50_VERTICAL
from procedures.outcome import Quantity
from procedures.pattern_psf.correspondences import Correspondences
from procedures.pattern_psf.estimate import PatternPsf
from procedures.pattern_psf.registration import Registration
from procedures.pattern_psf.solution import SharedErrors
from procedures.psf_field import Node

Array = npt.NDArray[np.float64]

HEADLINE: tuple[str, ...] = (MTF50_HORIZONTAL, MTF50_VERTICAL, MTF50_RADIAL, FWHM_HORIZONTAL, FWHM_VERTICAL)
"""The numbers of every place that are told beside the whole PSF."""


@dataclass(frozen=True, eq=False)
class SeenChart:
    """One chart in one plane of one photograph.

    Attributes
    ----------
    node : Node
    numbers : mapping of str to Quantity
        Of `HEADLINE`, those that the PSF has.
    gradients : mapping of str to (P,) float64
        Of each number by the PSF's parameters.
    budgets : mapping of str to Budget
        What each number's uncertainty is made of.
    registration : Registration
    correspondences : Correspondences
        In pixels of the plane.
    shared : SharedErrors
    """

    node: Node
    numbers: Mapping[str, Quantity]
    gradients: Mapping[str, Array]
    registration: Registration
    correspondences: Correspondences
    shared: SharedErrors
    budgets: Mapping[str, Budget] = field(default_factory=dict)

    @property
    def joint_covariance(self) -> Array:
        """Covariance (P + 2, P + 2) of the PSF's parameters and of the place where the chart's centre is seen."""
        shared = self.shared.centre
        return np.block([[self.node.psf.parameter_covariance, shared], [shared.T, self.node.position_covariance]])


def seen_chart_of(found: PatternPsf, node: Node) -> SeenChart:
    """What is kept of an estimate."""
    told = [name for name in HEADLINE if name in found.quality.numbers]
    numbers = {name: found.quality.numbers[name] for name in told}
    gradients = {name: found.quality.gradients[name] for name in told}
    budgets = {name: found.quality.budgets[name] for name in told}
    return SeenChart(node, numbers, gradients, found.registration, found.correspondences, found.shared, budgets)


def usual_budgets(charts: Sequence[SeenChart]) -> dict[str, dict[str, float]]:
    """What a number's uncertainty at one chart is made of, by number: root mean squares over the charts.

    A term that adds to none of them is left out.
    """
    found: dict[str, dict[str, float]] = {}
    for name in HEADLINE:
        budgets = [one.budgets[name] for one in charts if name in one.budgets]
        terms = dict.fromkeys(term for one in budgets for term, size in one.items() if size > 0)
        if terms:
            found[name] = {
                term: float(np.sqrt(np.mean([one.get(term, 0.0) ** 2 for one in budgets]))) for term in terms
            }
    return found
