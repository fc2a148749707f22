"""The delay of an inertial unit's cable, from taps that a second unit on the shutter's box feels too."""

from collections.abc import Callable
from typing import Protocol, cast

import numpy as np
import numpy.typing as npt

from drivers.errors import BadConfiguration, DeviceError
from drivers.imu import CableLatency, StrigImu
from drivers.interfaces import Imu, ImuBlock
from station.bench.opening import Bench

RATE_HZ, TAPS, LISTEN_S = 200.0, 5, 3.0
STEP_S = 2e-4
FARTHEST_S = 0.1
LEAST_CORRELATION = 0.5
"""Least correlation of two records of the same event at the best lag."""


class DelayedImu(Imu, Protocol):
    """A unit on a cable of its own, with the delay that it assumes."""

    @property
    def latency(self) -> CableLatency:
        """The delay assumed of its samples."""


class NoCommonEvent(DeviceError):
    """Two inertial units that did not feel the same."""


def lag_s(reference: ImuBlock, other: ImuBlock) -> float:
    """Lag of the other's times at which the accelerations' magnitudes agree best. Raises NoCommonEvent."""
    first, last = (f(reference.host_s[i], other.host_s[i]) for f, i in ((max, 0), (min, -1)))
    t = np.arange(first + FARTHEST_S, last - FARTHEST_S, STEP_S)
    lags = np.arange(-FARTHEST_S, FARTHEST_S + STEP_S / 2, STEP_S)
    if len(t) < 2:
        raise NoCommonEvent("the records of two inertial units must overlap; these do not", "check both, and try again")
    still = _magnitude(reference, t)
    agreement = [float(np.corrcoef(still, _magnitude(other, t + lag))[0, 1]) for lag in lags]
    best = int(np.clip(np.argmax(agreement), 1, len(lags) - 2))
    if not agreement[best] > LEAST_CORRELATION:
        raise NoCommonEvent(
            f"both inertial units must feel the tap; their records have a correlation of {agreement[best]:.2f}",
            "tap harder, on the part that carries both, and not in time with anything that vibrates",
        )
    a, b, c = agreement[best - 1 : best + 2]
    return float(lags[best] + STEP_S * (a - c) / (2 * (a - 2 * b + c)))


def _magnitude(block: ImuBlock, t: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Magnitude of the acceleration, which does not depend on how a unit is mounted."""
    return np.asarray(np.interp(t, block.host_s, np.linalg.norm(block.acceleration_m_s2, axis=1)))


def measured_latency(reference: Imu, other: DelayedImu, tap: Callable[[int], None]) -> CableLatency:
    """The delay of a unit's cable; `tap` is called before each tap. Raises DeviceError."""
    lags, within_s = [], 0.0
    for n in range(TAPS):
        reference.start(RATE_HZ)
        other.start(RATE_HZ)
        tap(n)
        blocks = reference.read_block(LISTEN_S), other.read_block(0.0)
        reference.stop()
        other.stop()
        lags.append(lag_s(*blocks))
        assert blocks[0].clock is not None
        within_s = max(within_s, blocks[0].clock.within_s)
        assumed_s = other.latency.latency_s
        lags[-1] += assumed_s
    scatter_s = 2 * float(np.std(lags, ddof=1)) / np.sqrt(TAPS)
    return CableLatency(float(np.mean(lags)), within_s + scatter_s + STEP_S, "common event")


def latencies(bench: Bench, tap: Callable[[str, int], None]) -> dict[str, CableLatency]:
    """The delay of each unit of a bench that is on a cable of its own. Raises DeviceError."""
    units = {name: device for name, device in bench.devices.items() if hasattr(device, "read_block")}
    reference = next((unit for unit in units.values() if isinstance(unit, StrigImu)), None)
    others = {name: cast("DelayedImu", unit) for name, unit in units.items() if hasattr(unit, "latency")}
    if reference is None or not others:
        raise BadConfiguration(
            "a tap is compared by an inertial unit on the shutter's box with one on a cable of its own",
            'add a device with driver = "strig_imu" to station.toml, if only for this',
        )
    return {name: measured_latency(reference, one, lambda n, name=name: tap(name, n)) for name, one in others.items()}  # type: ignore[misc]
