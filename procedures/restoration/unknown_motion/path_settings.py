"""What the search of motion paths goes by."""

from __future__ import annotations

from dataclasses import dataclass, field

from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.unknown_motion.basin_hopping import BendSettings
from procedures.restoration.unknown_motion.cross_relation import PlaceSettings
from procedures.restoration.unknown_motion.path_pairs import PairSettings


@dataclass(frozen=True)
class PathSettings:
    """How long motion paths are looked for, and when they are believed.

    Attributes
    ----------
    most_pixels, searched_pixels : int
        Of the frame about the flat part whose depth is matched roughly, and of the window of it in which paths are
        looked for: that takes as much longer as it is larger, and finds somewhat better ones.
    contrast : float
        Mean squared difference of neighbours expected of the picture while paths are sought, white = 1.
    joint : int
        Joint steps of picture and depth after matching: with fewer the depth is not yet as good as the curves deserve.
    joint_iterations, picture_iterations : int
        Conjugate gradients of one joint step, and of improving the picture alone.
    doubt : float
        Mean squared error of a tile, of noise 1, beyond which a depth step or a wrong depth is rather in it.
    beginnings, matched, restored, more : int
        Beginnings of each curve, pairs whose depth is matched, those of them with which the frame is restored, and most
        restorations with what the best becomes. Nearly all of the time goes into these.
    scheme : Scheme
        Of these restorations.
    settled : float
        Part of the scheme's rounds that a depth has behind it which was matched, or restored with other curves.
    least_fall : float
        Fall of what is left unexplained, of the noise, below which nothing more is found.
    enough : float
        What is left unexplained, of the noise, below which no other pair is turned as well.
    usual_left, most_left : float
        What is left unexplained, of the noise, with the curves of the rig, and beyond which they are others.
    pairs, bends, places
        Of pairs of curves, of bends moved at random, and of the places where pairs are compared.
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
