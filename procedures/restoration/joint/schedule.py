"""The scheme of iterations, N_g x (N_u + N_w) + N_TV x N_u, and the weights of each round (sections 6.4, 6.5)."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

from procedures.outcome import BadParameter
from procedures.restoration.joint.gauss_newton import PriorWeights


@dataclass(frozen=True)
class Scheme:
    """rounds x (picture + depth) + final_rounds x final.

    rounds : Gauss-Newton steps over picture and depth; each solves its equations by picture + depth iterations of
    conjugate gradients. Then the picture alone: final_rounds of final iterations, its prior relinearised in between.
    """

    rounds: int = 20
    picture: int = 20
    depth: int = 20
    final_rounds: int = 5
    final: int = 20

    @staticmethod
    def parse(text: str) -> Scheme:
        """The scheme written as in the thesis: "20x(8+10)+5x20", "50x(8+10)+100".

        Raises
        ------
        BadParameter
            If it is written otherwise.
        """
        found = re.fullmatch(r"(\d+)x\((\d+)\+(\d+)\)(?:\+(?:(\d+)x)?(\d+))?", re.sub(r"\s|×", _plain, text))
        if not found:
            raise BadParameter(f"scheme {text!r} is not understood", 'write it like "20x(8+10)+5x20"')
        rounds, picture, depth, final_rounds, final = found.groups()
        scheme = Scheme(int(rounds), int(picture), int(depth), int(final_rounds or 1), int(final or 0))
        if scheme.rounds < 1 or scheme.picture + scheme.depth < 1:
            raise BadParameter(f"scheme {text!r} does nothing", "give at least 1x(1+0)")
        return scheme


def _plain(found: re.Match[str]) -> str:
    return "x" if found.group() == "×" else ""


@dataclass(frozen=True)
class PlaceEdges:
    """Puts the depth steps in their place before a joint step.

    reach, doubt : pixels about a step in which it is looked for, and in which w is not believed; None for what the
    first depth needs. decided : distance from one half at which a pixel's share of two layers is believed as it is,
    since medians cut corners; 1 for never. layers : how many lie between a step's two sides, at most. softness : least
    weight of the picture's prior meanwhile.
    """

    said: str
    reach: int | None = None
    doubt: int = 0
    decided: float = 0.25
    layers: int = 1
    softness: float = 1e-5

    @property
    def far(self) -> bool:
        """Whether it works about the first depth's steps, which may lie some pixels off."""
        return self.reach is None


@dataclass(frozen=True)
class RestartRegions:
    """Begins the parts again that the restoration does not explain, and keeps what came out better."""

    said: str = "parts anew"


Opening = PlaceEdges | RestartRegions | None
"""What a round does before its joint step."""
FAR = PlaceEdges("steps far", decided=1.0, softness=1e-3)
BETWEEN = PlaceEdges("steps far, between", decided=1.0, layers=2, softness=1e-3)
NEAR = PlaceEdges("steps near", reach=5, doubt=2)
NEARER = PlaceEdges("steps nearer", reach=3, doubt=1)


def openings(rounds: int) -> tuple[Opening, ...]:
    """What opens each round: depth steps placed from afar at first, then twice from near; thrice parts begun again."""
    if rounds < 2:
        return (None,) * rounds
    again = {round(part * rounds): RestartRegions() for part in (0.35, 0.5, 0.65)}
    late = {round(0.3 * rounds): NEAR, round(0.55 * rounds): NEARER}
    chosen: dict[int, Opening] = {**again, **late, 0: FAR, 1: BETWEEN, 2: FAR}
    return tuple(chosen.get(n) for n in range(rounds))


DEPTH_SLOPE = 0.014
"""What w usually changes by between neighbouring pixels away from depth steps, pixels: believed of every scene."""


@dataclass(frozen=True)
class WeightSettings:
    """How the priors' weights go from round to round, and where they end.

    While w is still a tenth of a pixel off, a weak prior lets the picture fit the depth's error: the first rounds hold
    strong ones, then they fall geometrically. Grey values in [0, 1], w in pixels.

    Attributes
    ----------
    first_picture, first_depth : float
        Weights of the first rounds.
    last_picture, last_depth : float
        What they fall to in the last round, unless noise and contrast ask for more.
    held : float
        Part of the rounds that hold the first.
    caution : float
        The picture's weight over sigma^2 / G: masks that all err alike leave nothing over, and where w is found too
        little is worse than too much. 1 suits simulated noise of 20 dB, 2 real photographs.
    slope : float
        Of w between neighbouring pixels, usually.
    least_picture : float
        What the picture's weight is at least, where nobody gives it: for kernels that share an error with the picture,
        of which nothing is left over.
    """

    first_picture: float = 3e-4
    first_depth: float = 0.03
    last_picture: float = 1e-7
    last_depth: float = 1e-5
    held: float = 0.25
    caution: float = 1.5
    slope: float = DEPTH_SLOPE
    least_picture: float = 0.0


@dataclass(frozen=True)
class Statistics:
    """What the weights are made of, white = 1.

    sigma : of the noise over all frequencies; deciding, contrast : sigma and mean squared gradient G of the sharp
    picture at the frequencies where the picture's weight decides (`moments`).
    """

    sigma: float
    deciding: float
    contrast: float


@dataclass(frozen=True)
class Schedule:
    """Weights from round to round, never below what noise and contrast ask for.

    picture, depth : final weights if given, else the ratio of noise and prior variance: sigma^2 / G times a caution,
    and sigma^2 over the usual slope of w squared. bent : w's second differences count, and its differences little.
    """

    rounds: int
    picture: float | None = None
    depth: float | None = None
    bent: bool = True
    weights: WeightSettings = field(default_factory=WeightSettings)

    def final(self, known: Statistics) -> PriorWeights:
        """Weights of the last rounds."""
        told = max(self.weights.caution * known.deciding**2 / known.contrast, self.weights.least_picture)
        picture = told if self.picture is None else self.picture
        depth = self.depth if self.depth is not None else known.sigma**2 / self.weights.slope**2
        return PriorWeights(picture, depth) if self.bent else PriorWeights(picture, depth, tilt=1, bend=0)

    def at(self, n: int, known: Statistics) -> PriorWeights:
        """Weights of round n = 0, 1, ..."""
        s = self.weights
        held = int(s.held * self.rounds)
        t = max(0, n - held) / max(1, self.rounds - 1 - held)
        least = self.final(known)
        return replace(
            least,
            picture=max(least.picture, s.first_picture * (s.last_picture / s.first_picture) ** t),
            depth=max(least.depth, s.first_depth * (s.last_depth / s.first_depth) ** t),
        )
