"""Recording of a sensor: dark and bright levels, a dark and a flat stack."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.sensor.levels import LightLevel
from procedures.sensor.stacks import FrameStack


@dataclass(frozen=True, eq=False)
class SensorRecording:
    """One plane's levels and stacks, in digital numbers.

    Attributes
    ----------
    darks : without light, by exposure time
    lights : by light
    photons_known : whether `light` is photons per pixel
    dark_stack, flat_stack : FrameStack or None
    """

    darks: tuple[LightLevel, ...]
    lights: tuple[LightLevel, ...]
    photons_known: bool
    dark_stack: FrameStack | None
    flat_stack: FrameStack | None

    @property
    def dark_weights(self) -> Array:
        """Weights (bright, dark) that interpolate the dark levels linearly to each bright level's exposure."""
        known = np.array([level.exposure_s for level in self.darks])
        wanted = np.array([level.exposure_s for level in self.lights])
        return np.column_stack([np.interp(wanted, known, row) for row in np.eye(len(known))])

    @property
    def signal(self) -> Array:
        """Mean of each bright level less the dark at its exposure."""
        return column(one.mean for one in self.lights) - self.dark_weights @ column(one.mean for one in self.darks)


def column(values: Iterable[float]) -> Array:
    """One attribute of all levels, as an array."""
    return np.fromiter(values, dtype=np.float64)
