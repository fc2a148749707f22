"""Sensor model: electrons with noise, full well, gain, black level, quantisation, clipping."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mosaic = npt.NDArray[np.uint16]

SENSITIVITY: Mapping[str, float] = {"R": 0.6, "G": 1.0, "B": 0.7, "Y": 1.0}
"""Electrons from a white sheet through each colour filter, relative to green."""
GAUSSIAN_FROM_E = 1000.0
"""Mean from which photon noise is Gaussian: the skewness of the Poisson distribution is below 0.03."""

BAND_ROWS = 128  # rows exposed at once, which limits the memory


@dataclass(frozen=True)
class Sensor:
    """A sensor and its converter.

    rows, columns : int, sensor pixels
    cfa : str or None
        Colours of the mosaic's tile, row by row: "RGGB", "BGGR", "GRBG", "GBRG"; None counts all light ("Y").
    bits : int, of the converter: 10, 12, 14 or 16
    black : (4,) int, number without light at each position of the 2 x 2 tile, row by row
    full_well_e : float, electrons that a photosite holds
    gain_e_per_dn : float, electrons per digital number
    read_noise_e : float, standard deviation, in electrons
    prnu : float, standard deviation of the photosites' relative response, fixed for one `serial`
    curvature : float
        e electrons are read as e (1 + curvature (1 - e / full_well_e)): a response that is not quite linear.
    """

    rows: int = 4000
    columns: int = 6000
    cfa: str | None = "RGGB"
    bits: int = 14
    black: tuple[int, int, int, int] = (512, 512, 512, 512)
    full_well_e: float = 40000.0
    gain_e_per_dn: float = 2.4
    read_noise_e: float = 3.0
    prnu: float = 0.0
    curvature: float = 0.0
    serial: int = 1
    sensitivity: Mapping[str, float] = field(default_factory=lambda: dict(SENSITIVITY), hash=False)

    def __post_init__(self) -> None:
        if self.cfa is not None and sorted(self.cfa) != ["B", "G", "G", "R"]:
            raise ValueError(f"a Bayer tile has one R, two G and one B, row by row; got {self.cfa!r}")
        if self.bits not in (10, 12, 14, 16):
            raise ValueError(f"the converter has 10, 12, 14 or 16 bits; got {self.bits}")

    @property
    def tile(self) -> dict[tuple[int, int], str]:
        """Colour of each position (x, y) of the mosaic's tile; {(0, 0): "Y"} without a mosaic."""
        if self.cfa is None:
            return {(0, 0): "Y"}
        return {(i % 2, i // 2): colour for i, colour in enumerate(self.cfa)}

    @property
    def planes(self) -> dict[str, tuple[int, int]]:
        """Position (x, y) in the tile of each plane: R, G1 (on the red rows), G2, B, or Y."""
        if self.cfa is None:
            return {"Y": (0, 0)}
        red_row = self.cfa.index("R") // 2
        planes = {}
        for (x, y), colour in self.tile.items():
            planes[colour if colour != "G" else "G1" if y == red_row else "G2"] = (x, y)
        return planes

    @property
    def white(self) -> int:
        """Digital number at which the first position of the tile saturates: full well or end of scale."""
        top: int = 2**self.bits - 1
        return min(top, int(self.full_well_e / self.gain_e_per_dn) + min(self.black))

    def at_iso(self, iso: float, base: float = 100.0) -> "Sensor":
        """The sensor with another gain: `gain_e_per_dn` is that of ISO `base`."""
        return replace(self, gain_e_per_dn=self.gain_e_per_dn * base / iso)

    def electrons(self, mean_e: Array, rng: np.random.Generator) -> Array:
        """Electrons read where `mean_e` are expected: photon noise, full well, curvature, read noise; same shape."""
        counted = mean_e + np.sqrt(mean_e) * rng.standard_normal(mean_e.shape, dtype=np.float32)
        dim = mean_e < GAUSSIAN_FROM_E
        counted[dim] = rng.poisson(mean_e[dim])
        np.minimum(counted, self.full_well_e, out=counted)
        if self.curvature:
            counted *= 1 + self.curvature * (1 - counted / self.full_well_e)
        counted += self.read_noise_e * rng.standard_normal(mean_e.shape, dtype=np.float32)
        return counted

    def digitise(self, electrons: Array) -> Mosaic:
        """Digital numbers of the electrons of some rows from an even one on: gain, black level, rounding, clipping."""
        numbers = electrons / self.gain_e_per_dn
        for i, black in enumerate(self.black):
            numbers[i // 2 :: 2, i % 2 :: 2] += black
        np.rint(numbers, out=numbers)
        return np.clip(numbers, 0, 2**self.bits - 1, out=numbers).astype(np.uint16)

    def expose(self, light: npt.NDArray[np.floating], white_e: float, rng: np.random.Generator) -> Mosaic:
        """Digital numbers of one exposure.

        light : (rows, columns) 1 where a perfect white stands in full light
        white_e : float, mean electrons that such a white gives in green (or without a mosaic)
        """
        fixed = np.random.default_rng(self.serial)
        scale = white_e * self._sensitivities(light.shape[1])
        mosaic = np.empty(light.shape, dtype=np.uint16)
        for top in range(0, len(light), BAND_ROWS):
            mean_e = light[top : top + BAND_ROWS] * scale[: len(light) - top]
            if self.prnu:
                mean_e *= 1 + self.prnu * fixed.standard_normal(mean_e.shape, dtype=np.float32)
            mosaic[top : top + BAND_ROWS] = self.digitise(self.electrons(mean_e, rng))
        return mosaic

    def linear(self, numbers: Mosaic) -> Array:
        """Digital numbers with the black level subtracted and saturation scaled to 1, as from a RAW reader."""
        values = numbers.astype(np.float64)
        for i, black in enumerate(self.black):
            values[i // 2 :: 2, i % 2 :: 2] -= black
            values[i // 2 :: 2, i % 2 :: 2] /= self.white - black
        return values

    def _sensitivities(self, columns: int) -> Array:
        """Relative sensitivity of two rows, repeated for a band of them, (BAND_ROWS, columns)."""
        period = 1 if self.cfa is None else 2
        tile = np.array([[self.sensitivity[self.tile[x, y]] for x in range(period)] for y in range(period)])
        return np.tile(tile, (BAND_ROWS // period, -(-columns // period)))[:, :columns]
