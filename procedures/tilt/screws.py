"""Which screws to turn, and how far, so that the sensor's plane meets the surface of best focus; whether it helps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadParameter, Quantity
from procedures.tilt.plane import SensorPlane

Array = npt.NDArray[np.float64]

DRAWS = 2000
SURE = 0.9
"""Probability of helping from which on a turn is advised."""
SEED = 20260801
"""Of the draws that the probability is counted from: the same plane always gets the same one."""


@dataclass(frozen=True)
class Screws:
    """Screws that hold the sensor, equally spaced on a circle about the frame's centre.

    Attributes
    ----------
    count : int
    radius_mm : float
        Of the circle.
    pitch_mm : float
        What a turn moves the sensor by.
    first_deg : float
        Where the first is, clockwise from the top, as one sees who stands behind the camera; the others follow
        clockwise.
    turn_uncertainty : float
        Standard uncertainty of a turn as hands make it, in turns.
    """

    count: int = 3
    radius_mm: float = 20.0
    pitch_mm: float = 0.35
    first_deg: float = 0.0
    turn_uncertainty: float = 0.02

    def __post_init__(self) -> None:
        if self.count < 3 or min(self.radius_mm, self.pitch_mm) <= 0 or self.turn_uncertainty < 0:
            raise BadParameter(
                f"three screws or more hold a plane, on a circle, with a pitch; got {self}", "measure the camera's own"
            )

    @property
    def angles_deg(self) -> Array:
        """Of each, clockwise from the top, seen from behind the camera."""
        return (self.first_deg + 360 * np.arange(self.count) / self.count) % 360

    @property
    def places_mm(self) -> Array:
        """Where they are as the photograph counts, (count, 2), right and down.

        The image stands on its head on the sensor: what the photograph shows above and to the right lies below and to
        the left there, for who looks from behind.
        """
        angle = np.radians(self.angles_deg)
        return self.radius_mm * np.stack([-np.sin(angle), np.cos(angle)], axis=1)

    @property
    def heights(self) -> Array:
        """What makes the heights at the screws from a plane's offset and slopes, (count, 3)."""
        return np.column_stack([np.ones(self.count), self.places_mm])


@dataclass(frozen=True, eq=False)
class Turns:
    """What mends a plane.

    Attributes
    ----------
    moves : tuple of Quantity
        Of the sensor at each screw, in um, away from the lens; negative is towards it.
    turns : tuple of Quantity
        The same in turns of each screw.
    helps : float
        Probability that the plane is nearer to the surface of best focus afterwards, over the whole frame.
    before, after : Quantity
        Root mean square height over the frame, in um: as it is, and as it is to be expected after the turn.
    """

    moves: tuple[Quantity, ...]
    turns: tuple[Quantity, ...]
    helps: float
    before: Quantity
    after: Quantity


def turns_for(found: SensorPlane, screws: Screws, *, with_focus: bool) -> Turns:
    """The turns that lay the sensor into the surface of best focus, and the probability that they help.

    Parameters
    ----------
    with_focus : bool
        Whether the offset is mended too; otherwise the screws tilt only, and the mean focus over the frame stays.

    The probability is the share of planes, drawn from what was measured, that come out flatter after turns that are
    themselves as uncertain as hands are.
    """
    kept = np.ones(3) if with_focus else np.array([0.0, 1.0, 1.0])
    plane, covariance = found.plane * kept, found.covariance * np.outer(kept, kept)
    to_screws = screws.heights
    heights, spread = to_screws @ plane, np.sqrt(np.diag(to_screws @ covariance @ to_screws.T))
    n = len(found.heights_um)
    moves = tuple(
        Quantity(float(-h), "um", float(u), "the plane at the screw, away from the lens", n)
        for h, u in zip(heights, spread, strict=True)
    )
    per_turn = 1000 * screws.pitch_mm
    turns = tuple(
        Quantity(one.value / per_turn, "turn", one.uncertainty / per_turn, "its move over the screw's pitch", n)
        for one in moves
    )
    rng = np.random.default_rng(SEED)
    true = rng.multivariate_normal(plane, covariance, DRAWS, method="eigh")
    slips = screws.turn_uncertainty * per_turn * rng.standard_normal((DRAWS, screws.count))
    left = true - plane + slips @ np.linalg.pinv(to_screws).T * kept
    before, after = found.rms(true), found.rms(left)
    method = "root mean square over the frame, of planes drawn from what was measured"
    return Turns(
        moves, turns, float(np.mean(after < before)),
        Quantity(float(found.rms(plane[None])[0]), "um", float(before.std()), method, n),
        Quantity(float(np.sqrt(np.mean(after**2))), "um", float(after.std()), method, n),
    )  # fmt: skip
