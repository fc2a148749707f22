"""A simulated sensor with known parameters, independent of the method and of the bench's sensor.

Electrons are Poisson distributed; response, noise, offset, gain, rounding and clipping follow.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from procedures.sensor.stacks import SensorRecording, measure_level, measure_stack

Array = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint16]


SHARES = np.linspace(0.02, 1.2, 60)


@dataclass(frozen=True)
class KnownSensor:
    """Parameters of a sensor; the patterns have exactly the given deviations.

    row_wave, column_wave : amplitude in DN and cycles per pixel of sinusoidal offsets
    bend : the response to e electrons is e (1 - bend e / full scale)
    """

    rows: int = 256
    columns: int = 320
    gain: float = 0.1
    efficiency: float = 0.6
    dark_noise_e: float = 30.0
    offset: float = 64.0
    top: int = 4095
    dsnu_dn: float = 1.5
    prnu: float = 0.005
    row_wave: tuple[float, float] = (0.0, 0.1)
    column_wave: tuple[float, float] = (0.0, 0.1)
    outliers: int = 0
    bend: float = 0.0
    dark_current_e_s: float = 0.0
    flicker: float = 0.0
    shading: float = 0.0
    row_noise_e: float = 0.0
    seed: int = 7

    @cached_property
    def patterns(self) -> tuple[Array, Array, Array]:
        """Offsets (DN), relative response, and the outliers' places (n, 2): half hot, half insensitive."""
        rng = np.random.default_rng(self.seed)
        shape = (self.rows, self.columns)
        offset = self.dsnu_dn * _standard(rng, shape)
        response = 1 + self.prnu * _standard(rng, shape)
        m, n = np.arange(self.rows)[:, None], np.arange(self.columns)[None, :]
        offset = offset + self.row_wave[0] * np.sin(2 * np.pi * self.row_wave[1] * m + 0.7)
        offset = offset + self.column_wave[0] * np.sin(2 * np.pi * self.column_wave[1] * n + 2.1)
        chosen = rng.choice(self.rows * self.columns, self.outliers, replace=False)
        places = np.column_stack(np.divmod(chosen, self.columns))
        hot, weak = places[: self.outliers // 2], places[self.outliers // 2 :]
        offset[tuple(hot.T)] += rng.uniform(40, 200, len(hot))
        response[tuple(weak.T)] *= rng.uniform(0.5, 0.9, len(weak))
        x = (n - self.columns / 2) / self.columns
        return offset, response * (1 + self.shading * x), places

    def full_scale_e(self) -> float:
        return (self.top - self.offset) / self.gain

    def bent(self, electrons: Array) -> Array:
        return electrons * (1 - self.bend * electrons / self.full_scale_e())

    def picture(self, photons: float, exposure_s: float, rng: np.random.Generator) -> Picture:
        offset, response, _ = self.patterns
        photons *= 1 + self.flicker * rng.standard_normal()
        mean = self.efficiency * photons * response + self.dark_current_e_s * exposure_s
        electrons = self.bent(rng.poisson(mean).astype(np.float64))
        electrons += self.dark_noise_e * rng.standard_normal(mean.shape)
        electrons += self.row_noise_e * rng.standard_normal((self.rows, 1))
        return np.clip(np.rint(self.offset + offset + self.gain * electrons), 0, self.top).astype(np.uint16)

    def photons_at(self, share: float) -> float:
        """Light for a share of the scale."""
        return share * self.full_scale_e() / self.efficiency

    def record(
        self,
        seed: int,
        shares: Sequence[float] | Array = SHARES,
        stack: int = 40,
        exposures_s: Sequence[float] = (0.01,),
        light_s: float | None = None,
    ) -> SensorRecording:
        """Dark pairs, a ladder of pairs, a dark stack and a flat one at half the scale."""
        rng = np.random.default_rng(seed)
        first = light_s or (exposures_s[0] if exposures_s else 0.01)

        def pair(photons: float, exposure_s: float) -> list[Picture]:
            return [self.picture(photons, exposure_s, rng) for _ in range(2)]

        ladder = [self.photons_at(share) for share in shares]
        return SensorRecording(
            tuple(measure_level(pair(0, t), t, 0.0) for t in exposures_s),
            tuple(measure_level(pair(p, first), first, p) for p in ladder),
            True,
            measure_stack((self.picture(0, first, rng) for _ in range(stack)), first, 0.0) if stack else None,
            measure_stack((self.picture(self.photons_at(0.5), first, rng) for _ in range(stack)), first, 1.0)
            if stack
            else None,
        )

    def linearity_error(self, shares: Array, saturation_share: float) -> float:
        """Linearity error of the noise-free response, in per cent, by numerical minimisation."""
        from scipy.optimize import minimize

        light = np.array([self.photons_at(s) for s in shares])
        y = self.gain * self.bent(self.efficiency * light)
        full = self.gain * float(self.bent(np.array(self.efficiency * self.photons_at(saturation_share))))
        used = (y >= 0.05 * full) & (y <= 0.95 * full)
        x, y = light[used] / light[-1], y[used]
        best = minimize(lambda p: np.sum((p[0] * x + p[1] - y) ** 2 / y**2), (y[-1] / x[-1], 0.0), method="Nelder-Mead",
                        options={"xatol": 1e-9, "fatol": 1e-18, "maxiter": 4000})  # fmt: skip
        line = best.x[0] * x + best.x[1]
        return float(100 * np.mean(np.abs(y - line) / line))


def _standard(rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    """Values of mean 0 and deviation 1, exactly, over all pixels."""
    values = rng.standard_normal(shape)
    return np.asarray((values - values.mean()) / values.std())
