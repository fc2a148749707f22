"""What a result says about one plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from procedures.cross_check.estimate import EdgeCheck
from procedures.outcome import Outcome, Verdict
from procedures.psf import Psf
from procedures.quality import Diffraction, Quality

if TYPE_CHECKING:
    from procedures.choice import Trial
    from procedures.pattern_psf.error_parts import Variation
    from procedures.physics.estimate import Physics

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PlaneRecord:
    """What a result says about one plane; a refused one has a reason and a remedy, and no PSF.

    Attributes
    ----------
    numbers : what the procedure found beside the PSF, plain: gamma (sum of 1 / sigma_i^2), residual_std, scale, ...
    pitch : sensor pixels per pixel of the plane
    inter_image : the kernel between two photographs, where the PSF comes from two
    quality : its curves, and the derived numbers with unit and uncertainty
    diagnostics : further numbers for those who look into a verdict
    choice : what was tried of s and k, the last one chosen
    variations : numbers that differ in the halves of the chart
    edges : the chart's slanted edges beside the PSF, where the photograph shows some
    diffraction : what limits the plane, where f-number and pitch are known
    physics : the model of sensor and lens that explains the PSF, where one was asked for
    """

    name: str
    verdict: Verdict
    reason: str = ""
    remedy: str = ""
    psf: Psf | None = None
    quality: Quality | None = None
    numbers: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    inter_image: Array | None = None
    pitch: int = 1
    choice: tuple[Trial, ...] = ()
    variations: tuple[Variation, ...] = ()
    edges: tuple[EdgeCheck, ...] = ()
    diffraction: Diffraction | None = None
    physics: Outcome[Physics] | None = None
