"""The scheme of iterations, N_g x (N_u + N_w) + N_TV x N_u, and the weights of each round (sections 6.4, 6.5)."""

import re
from dataclasses import dataclass, replace

from procedures.outcome import BadParameter
from procedures.restoration.joint.gauss_newton import PriorWeights


@dataclass(frozen=True)
class Scheme:
    """rounds x (picture + depth) + final_rounds x final.

    rounds : Gauss-Newton steps over picture and depth, each by picture + depth iterations of conjugate gradients. Then
    the picture alone: final_rounds of final iterations, with its prior relinearised in between.
    """

    rounds: int = 20
    picture: int = 20
    depth: int = 20
    final_rounds: int = 5
    final: int = 20

    @staticmethod
    def parse(text: str) -> "Scheme":
        """The scheme written as in the thesis: "20x(8+10)+5x20", "50x(8+10)+100".

        Raises BadParameter if it has another form.
        """
        match = re.fullmatch(
            r"(\d+)x\((\d+)\+(\d+)\)(?:\+(?:(\d+)x)?(\d+))?", re.sub(r"\s", "", text).replace("×", "x")
        )
        if not match:
            raise BadParameter(f"scheme {text!r} is not understood", 'write it like "20x(8+10)+5x20"')
        rounds, picture, depth, final_rounds, final = match.groups()
        scheme = Scheme(int(rounds), int(picture), int(depth), int(final_rounds or 1), int(final or 0))
        if scheme.rounds < 1 or scheme.picture + scheme.depth < 1:
            raise BadParameter(f"scheme {text!r} does nothing", "give at least 1x(1+0)")
        return scheme


@dataclass(frozen=True)
class PlaceEdges:
    """Localises the depth edges before a joint step.

    reach, margin : pixels about an edge in which it is searched for, and in which w is ignored; None for those of the
    first depth. decided : distance from one half above which a pixel's share of two layers is used without median
    filter, which cuts corners; 1 for never. layers : maximum number of layers across an edge. softness : smallest
    weight of the picture's prior meanwhile.
    """

    label: str
    reach: int | None = None
    margin: int = 0
    decided: float = 0.25
    layers: int = 1
    softness: float = 1e-5

    @property
    def far(self) -> bool:
        """Whether it works about the first depth's edges, which may be wrong by some pixels."""
        return self.reach is None


@dataclass(frozen=True)
class RestartRegions:
    """Restarts the regions that the restoration does not explain, and keeps them where the result is better."""

    label: str = "parts anew"


Opening = PlaceEdges | RestartRegions | None
"""Preparation of the joint step of a round."""
FAR = PlaceEdges("steps far", decided=1.0, softness=1e-3)
BETWEEN = PlaceEdges("steps far, between", decided=1.0, layers=2, softness=1e-3)
NEAR = PlaceEdges("steps near", reach=5, margin=2)
NEARER = PlaceEdges("steps nearer", reach=3, margin=1)


def openings(rounds: int) -> tuple[Opening, ...]:
    """Openings of each round: edge localisation first in wide, then in narrow bands; three times restarted regions."""
    if rounds < 2:
        return (None,) * rounds
    again = {round(part * rounds): RestartRegions() for part in (0.35, 0.5, 0.65)}
    late = {round(0.3 * rounds): NEAR, round(0.55 * rounds): NEARER}
    chosen: dict[int, Opening] = {**again, **late, 0: FAR, 1: BETWEEN, 2: FAR}
    return tuple(chosen.get(n) for n in range(rounds))


# Weights of the priors from round to round; grey values in [0, 1], w in pixels. While w is wrong by a tenth of a pixel,
# a weak prior lets the picture fit the error of depth: the first rounds use strong ones, which then fall geometrically.
FIRST_PICTURE, FIRST_DEPTH = 3e-4, 0.03
LAST_PICTURE, LAST_DEPTH = 1e-7, 1e-5
"""Weights of the last round, unless noise and contrast require more."""
CONSTANT = 0.25
"""Fraction of the rounds with the first weights."""
CAUTION = 1.5
"""Factor of the picture's weight over sigma^2 / G: common errors of all masks leave no residual, and too small a weight
harms w more than too large a one. 1 suits simulated noise of 20 dB, 2 real photographs."""
DEPTH_SLOPE = 0.014
"""Typical change of w between neighbouring pixels away from depth edges, pixels."""


@dataclass(frozen=True)
class Statistics:
    """Statistics from which the weights derive, white = 1.

    sigma : of the noise over all frequencies; deciding, contrast : sigma and mean squared gradient G of the sharp
    picture at the frequencies where the picture's weight decides (`moments`).
    """

    sigma: float
    deciding: float
    contrast: float


@dataclass(frozen=True)
class Schedule:
    """Weights from round to round, never below those required by noise and contrast.

    picture, depth : final weights if given, else the ratio of noise and prior variance: sigma^2 / G times a caution,
    and sigma^2 over the squared slope of w. bent : whether the prior is mainly on second differences of w;
    least_picture : smallest default weight of the picture, for kernels that share an error with the picture, which
    leaves no residual.
    """

    rounds: int
    picture: float | None = None
    depth: float | None = None
    bent: bool = True
    least_picture: float = 0.0

    def final(self, statistics: Statistics) -> PriorWeights:
        """Weights of the last rounds."""
        least = max(CAUTION * statistics.deciding**2 / statistics.contrast, self.least_picture)
        picture = least if self.picture is None else self.picture
        depth = self.depth if self.depth is not None else statistics.sigma**2 / DEPTH_SLOPE**2
        return PriorWeights(picture, depth) if self.bent else PriorWeights(picture, depth, tilt=1, bend=0)

    def at(self, n: int, statistics: Statistics) -> PriorWeights:
        """Weights of round n = 0, 1, ..."""
        first = int(CONSTANT * self.rounds)
        t = max(0, n - first) / max(1, self.rounds - 1 - first)
        least = self.final(statistics)
        return replace(
            least,
            picture=max(least.picture, FIRST_PICTURE * (LAST_PICTURE / FIRST_PICTURE) ** t),
            depth=max(least.depth, FIRST_DEPTH * (LAST_DEPTH / FIRST_DEPTH) ** t),
        )
