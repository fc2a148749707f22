"""Records of the camera's motion during an exposure: measured by an inertial unit, or commanded to a shaker."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, Complex
from procedures.outcome import BadInput


@dataclass(frozen=True, eq=False)
class ImuRecord:
    """Samples of an inertial unit on the camera around an exposure, its x to the right, its y up.

    time_s : (n,) from the opening of the shutter; acceleration_m_s2, rotation_rad_s : (n, 3), gravity included.
    within_s : bound of the common error of all times.
    """

    time_s: Array
    acceleration_m_s2: Array
    rotation_rad_s: Array
    within_s: float = 0.0


@dataclass(frozen=True)
class ShakerResponse:
    """How an axis follows its command: gain, resonance in Hz (None: at any frequency), damping ratio."""

    gain: float = 1.0
    frequency_hz: float | None = None
    damping: float = 1.0

    def at(self, frequency_hz: Array) -> Complex:
        """Amplitude and phase at some frequencies: of a mass on a damped spring."""
        if self.frequency_hz is None:
            return np.full(frequency_hz.shape, self.gain, np.complex128)
        ratio = frequency_hz / self.frequency_hz
        return np.asarray(self.gain / (1 - ratio**2 + 2j * self.damping * ratio))


@dataclass(frozen=True, eq=False)
class ShakerPath:
    """The closed path around which a shaker was commanded to move the camera during an exposure.

    position_m : (n, 3) of one round, x to the right, y up, z back, relative to the rest position
    interval_s : between two positions
    since_s : from the first position to the opening of the shutter; None where that was not recorded
    response : of the three axes to their commands
    within_s : bound of the common error of all times
    amplitude_uncertainty : its relative standard uncertainty, which is that of the inverse depths of a restoration, too
    """

    position_m: Array
    interval_s: float
    since_s: float | None = None
    response: tuple[ShakerResponse, ...] = (ShakerResponse(),) * 3
    within_s: float = 0.0
    amplitude_uncertainty: float = 0.0


LEAST_ROUNDS = 2.0  # rounds that a record must have to separate its harmonics from drift
HIGHEST = 0.4  # frequency of the highest harmonic that is measured, relative to the sampling rate


def measured_path(commanded: ShakerPath, imu: ImuRecord) -> ShakerPath:
    """The path that a shaker really played, from an inertial unit that it carries: amplitude and phase at the harmonics
    of its round.

    Harmonics have no drift, and the offsets of the unit are not among them. Noise sigma of n accelerations gives an
    uncertainty of sqrt(2 / n) sigma / (2 pi f)^2 of the amplitude at a frequency f.

    Raises BadInput if the record is shorter than two rounds, or the start of the path is not known.
    """
    round_s = commanded.interval_s * len(commanded.position_m)
    t = imu.time_s
    if commanded.since_s is None or len(t) < 2 or t[-1] - t[0] < LEAST_ROUNDS * round_s:
        raise BadInput("a shaker's path is measured over two rounds or more", "record longer, and wire the hot shoe")
    rate_hz = (len(t) - 1) / (t[-1] - t[0])
    highest = min(int(HIGHEST * rate_hz * round_s), len(commanded.position_m) // 2)
    w = 2 * np.pi / round_s * np.arange(1, highest + 1)
    waves = _waves(w, t + commanded.since_s)
    trend = np.vander((t - t.mean()) / (t[-1] - t[0]), 3)
    design = np.hstack([waves, trend])
    terms = np.linalg.lstsq(design, imu.acceleration_m_s2, rcond=None)[0]
    fit = terms[: 2 * highest]
    variance = np.sum((imu.acceleration_m_s2 - design @ terms) ** 2) / max(len(t) - design.shape[1], 1)
    at = commanded.interval_s * np.arange(len(commanded.position_m))
    position_m = -_waves(w, at) @ (fit / np.tile(w, 2)[:, None] ** 2)
    error_m, rms_m = np.sqrt(2 / len(t) * variance * np.sum(w**-4.0)), np.linalg.norm(position_m) / np.sqrt(len(at))
    return ShakerPath(
        np.asarray(position_m, np.float64), commanded.interval_s, commanded.since_s, within_s=imu.within_s,
        amplitude_uncertainty=float(error_m / max(rms_m, error_m)),
    )  # fmt: skip


def _waves(w: npt.NDArray[np.floating[Any]], t: npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.floating[Any]]:
    return np.hstack([np.cos(t[:, None] * w), np.sin(t[:, None] * w)])
