"""Turns of the screws that align the sensor with the surface of best focus, and the probability of improvement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter, Quantity
from procedures.tilt.plane import TiltedPlane

DRAWS = 2000
SURE = 0.9  # probability of improvement from which a turn is advised
SEED = 20260801  # seed of the draws, so that the result is reproducible


@dataclass(frozen=True)
class Screws:
    """Screws that hold the sensor, equally spaced on a circle about the frame's centre.

    radius_mm : radius of the circle
    pitch_mm : move of the sensor per turn
    first_deg : position of the first screw, clockwise from the top, seen from behind the camera; the others follow
        clockwise
    turn_uncertainty : standard uncertainty of a turn by hand, in turns
    """

    count: int = 3
    radius_mm: float = 20.0
    pitch_mm: float = 0.35
    first_deg: float = 0.0
    turn_uncertainty: float = 0.02

    def __post_init__(self) -> None:
        if self.count < 3 or min(self.radius_mm, self.pitch_mm) <= 0 or self.turn_uncertainty < 0:
            raise BadParameter(
                f"a plane needs three screws or more, with a positive radius and pitch; got {self}",
                "measure those of the camera",
            )

    @property
    def angles_deg(self) -> Array:
        """Angle of each, clockwise from the top, seen from behind the camera."""
        return (self.first_deg + 360 * np.arange(self.count) / self.count) % 360

    @property
    def places_mm(self) -> Array:
        """Positions (count, 2) in the photograph, right and down.

        The image is inverted on the sensor: above and to the right in the photograph is below and to the left on the
        sensor, seen from behind.
        """
        angle = np.radians(self.angles_deg)
        return self.radius_mm * np.stack([-np.sin(angle), np.cos(angle)], axis=1)

    @property
    def heights(self) -> Array:
        """Matrix (count, 3) from a plane's offset and slopes to the heights at the screws."""
        return np.column_stack([np.ones(self.count), self.places_mm])


@dataclass(frozen=True, eq=False)
class Turns:
    """Correction of a plane.

    moves : moves of the sensor at each screw, in um, away from the lens; negative is towards it
    turns : the same in turns of each screw
    helps : probability that the correction reduces the distance from the surface of best focus over the frame
    before, after : root mean square height over the frame, in um, before and expected after the correction
    """

    moves: tuple[Quantity, ...]
    turns: tuple[Quantity, ...]
    helps: float
    before: Quantity
    after: Quantity


def turns_for(sensor: TiltedPlane, screws: Screws, *, with_focus: bool) -> Turns:
    """The turns that align the sensor with the surface of best focus, and the probability of improvement.

    with_focus : whether the offset is corrected too; otherwise the mean focus over the frame is unchanged

    The probability is the share of planes, drawn from the measurement, that are flatter after turns with their own
    uncertainty.
    """
    kept = np.ones(3) if with_focus else np.array([0.0, 1.0, 1.0])
    plane, covariance = sensor.plane * kept, sensor.covariance * np.outer(kept, kept)
    to_screws = screws.heights
    heights, spread = to_screws @ plane, np.sqrt(np.diag(to_screws @ covariance @ to_screws.T))
    n = len(sensor.heights_um)
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
    remaining = true - plane + slips @ np.linalg.pinv(to_screws).T * kept
    before, after = sensor.rms(true), sensor.rms(remaining)
    method = "root mean square over the frame, of planes drawn from the measurement"
    return Turns(
        moves, turns, float(np.mean(after < before)),
        Quantity(float(sensor.rms(plane[None])[0]), "um", float(before.std()), method, n),
        Quantity(float(np.sqrt(np.mean(after**2))), "um", float(after.std()), method, n),
    )  # fmt: skip
