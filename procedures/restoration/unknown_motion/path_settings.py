"""Settings of the search of motion paths."""

from __future__ import annotations

from dataclasses import dataclass, field

from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.unknown_motion.basin_hopping import BendSettings
from procedures.restoration.unknown_motion.cross_relation import PlaceSettings
from procedures.restoration.unknown_motion.path_pairs import PairSettings


@dataclass(frozen=True)
class PathSettings:
    """Effort of the search of motion paths, and criteria of reliability.

    Attributes
    ----------
    most_pixels, searched_pixels : int
        Pixels of the frame around the flat part whose depth is matched roughly, and of the window in which paths are
        searched for: time grows with it, and paths improve slightly.
    contrast : float
        Expected mean squared difference of neighbours of the picture during the search, white = 1.
    joint : int
        Joint steps of picture and depth after matching: fewer leave the depth less accurate than the curves.
    joint_iterations, picture_iterations : int
        Conjugate gradients of one joint step, and of improving the picture alone.
    doubt : float
        Mean squared error of a tile, relative to the noise, above which it probably has a depth edge or a wrong depth.
    beginnings, matched, restored, more : int
        Starts of each curve, pairs whose depth is matched, those of them with which the frame is restored, and maximum
        number of restorations from the best. Nearly all of the time is spent on these.
    scheme : Scheme
        Scheme of these restorations.
    settled : float
        Fraction of the scheme's rounds that is skipped for a depth that was matched, or restored with other curves.
    least_fall : float
        Fall of the residual energy, relative to the noise, below which the search ends.
    enough : float
        Residual energy, relative to the noise, below which no other pair is optimised.
    usual_left, most_left : float
        Typical residual energy, relative to the noise, with the true curves, and the value above which they are wrong.
    pairs, bends, places
        Settings of pairs of curves, of random bends, and of the places where pairs are compared.
    """

    most_pixels: int = 120_000
    searched_pixels: int = 60_000
    contrast: float = 6.3e-3
    joint: int = 8
    joint_iterations: int = 18
    picture_iterations: int = 20
    doubt: float = 10.0
    beginnings: int = 96
    matched: int = 6
    restored: int = 3
    more: int = 12
    scheme: Scheme = field(default_factory=lambda: Scheme(10, 20, 20, 2, 10))
    settled: float = 0.6
    least_fall: float = 0.003
    enough: float = 0.8
    usual_left: float = 0.75
    most_left: float = 0.87
    pairs: PairSettings = field(default_factory=PairSettings)
    bends: BendSettings = field(default_factory=BendSettings)
    places: PlaceSettings = field(default_factory=PlaceSettings)
