"""Priors of a sharp picture: which differences are few and large rather than many and small."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadParameter

Array = npt.NDArray[np.float64]

CHROMA = 5.0
"""Weight of differences of colour relative to differences of lightness, in a balanced picture."""


@dataclass(frozen=True)
class Prior:
    """A penalty on the lengths of differences, of all colours jointly as in (6.11) of the thesis.

    name : "total-variation": differences of neighbours; "second-order": second differences, which do not penalise
    slopes; chroma : weight of differences between the colours relative to those of lightness; strength : factor of the
    strength derived from the photograph's noise and differences.
    """

    name: str = "total-variation"
    chroma: float = CHROMA
    strength: float = 1.0

    def __post_init__(self) -> None:
        if self.name not in ORDERS:
            raise BadParameter(f"the prior is one of {', '.join(ORDERS)}; got {self.name!r}", "choose one of them")
        if not (self.chroma >= 1 and self.strength > 0):
            raise BadParameter(
                f"a prior needs a chroma of 1 or more and a positive strength; got {self.chroma:g}, {self.strength:g}",
                "use the defaults",
            )

    @property
    def second(self) -> bool:
        """Whether the differences are of second order."""
        return self.name == "second-order"

    @property
    def kinds(self) -> int:
        """Number of differences per pixel: down and across; or down, across and mixed."""
        return 3 if self.second else 2

    def mixing(self, channels: int) -> Array:
        """Matrix from red, green and blue to lightness and weighted colour differences, (C, C)."""
        if channels == 1:
            return np.ones((1, 1))
        lightness = np.ones(3) / np.sqrt(3)
        colour = np.array([[1.0, 0.0, -1.0], [1.0, -2.0, 1.0]]) / np.sqrt([[2.0], [6.0]])
        return np.vstack([lightness, self.chroma * colour])

    def power(self, n: int) -> Array:
        """Sum of the differences' squared transfer functions on n x n samples, (n, n // 2 + 1)."""
        once = 2 - 2 * np.cos(2 * np.pi * np.fft.fftfreq(n))
        down, across = once[:, None], once[None, : n // 2 + 1]
        # second differences down, across, and twice the mixed one: the Laplacian's square
        return np.asarray((down + across) ** 2 if self.second else down + across)


ORDERS = ("total-variation", "second-order")
