"""Blur of photographs on their picture's grid at any position: the planes' PSFs and relative shifts."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
import scipy.fft

from procedures.numerics.kernel_tail import spectrum_beyond, tail_kernels
from procedures.psf import extended
from procedures.psf_field import PsfField, SpaceVariantBlur
from procedures.raw import Plane

Array = npt.NDArray[np.float64]
Spectrum = npt.NDArray[np.complex64]
Shift = Callable[[Array], Array]
"""Shift (n, 2) from the reference plane, in pixels of the picture, at points (n, 2) of a plane."""

COLOURS = {"R": 0, "G1": 1, "G2": 1, "B": 2, "Y": 0}
"""Index of the picture's colour for each plane."""
CHANGE, MOVE_PX = 0.03, 0.1
"""Tolerated changes within a tile: of the PSF, relative to its norm, and of lateral colour."""
SIDES = (256, 192, 128)
"""Sides of tiles, in pixels of the picture; larger ones do not stay in a processor's cache and take longer."""


@dataclass(frozen=True, eq=False)
class PlaneFields:
    """Fields of the planes of one photograph or several, with the planes' positions on the picture's grid.

    fields : by plane, in the order of the photographs
    channel : (P,), index of the picture's colour for each plane
    photographs : their number; each has the same planes
    origins : (x, y) of the first pixel of each field's plane
    pitch : pixels of the picture per pixel of a field's plane
    shifts : of displaced planes: lateral colour, movement between photographs
    """

    fields: Mapping[str, PsfField]
    channel: Sequence[int]
    photographs: int
    origins: Mapping[str, tuple[float, float]]
    pitch: int
    shifts: Mapping[str, Shift]

    @classmethod
    def of(
        cls, planes: Mapping[str, Plane], fields: Mapping[str, PsfField], shifts: Mapping[str, Shift]
    ) -> "PlaneFields":
        """The optics of planes, with the fields of their names.

        Planes of a developed picture have all pixels of the sensor, less a rim, where a mosaic's field has every other.
        """
        of_planes = {key: fields[plane.name] for key, plane in planes.items()}
        first, field = next(iter(planes.values())), next(iter(of_planes.values()))
        finer = 2 if first.pitch == 1 and first.name != "Y" and first.samples.shape[0] > field.shape[0] else 1
        pitch = finer * first.pitch
        origins = {
            key: plane.origin if finer == 1 else _centred(plane.samples.shape, of_planes[key].shape, finer)
            for key, plane in planes.items()
        }
        photographs = len(planes) // len({plane.name for plane in planes.values()})
        return cls(of_planes, [COLOURS[plane.name] for plane in planes.values()], photographs, origins, pitch, shifts)

    @cached_property
    def _blurs(self) -> dict[str, SpaceVariantBlur]:
        made = {id(field): SpaceVariantBlur(field, self.pitch) for field in self.fields.values()}
        return {name: made[id(field)] for name, field in self.fields.items()}

    def otf(self, x: float, y: float, n: int) -> Spectrum:
        """Transfer functions of all planes on n x n samples about a position of the picture, (P, n, n // 2 + 1),
        without the shifts by `whole` pixels."""
        return np.stack([self._of_plane(name, x, y, n) for name in self.fields])

    def responses(self, name: str, n: int) -> Spectrum:
        """Derivatives of a plane's transfer function on n x n samples with respect to the PSF's parameters, without
        normalisation to sum 1; (p, n (n // 2 + 1))."""
        blur, field = self._blurs[name], self.fields[name]
        unit = np.eye(field.k**2 + field.q)
        spectra = np.array([scipy.fft.rfft2(wrapped(blur.kernel(extended(row, field.k)), n)) for row in unit])
        if field.q:
            spectra[field.k**2] += _far(field.k, n, self.pitch / field.s)
        return np.asarray(spectra, dtype=np.complex64).reshape(len(unit), -1)

    def whole(self, x: float, y: float) -> dict[str, tuple[int, int]]:
        """Displacement of the planes about a position in whole pixels (x, y): their samples are shifted back by it, and
        `otf` contains the rest. For rotated photographs it differs from tile to tile."""
        moved = {name: np.rint(self._moved(name, x, y)[1]).astype(int) for name in self.shifts}
        return {name: (int(dx), int(dy)) for name, (dx, dy) in moved.items()}

    def _moved(self, name: str, x: float, y: float) -> tuple[Array, Array]:
        """The point (1, 2) of a plane at a position of the picture, and its displacement (2,)."""
        place = np.array([[x, y]])
        there = self.in_plane(name, place)
        if name not in self.shifts:
            return there, np.zeros(2)
        there = self.in_plane(name, place + self.shifts[name](there))
        return there, self.shifts[name](there)[0]

    def _of_plane(self, name: str, x: float, y: float, n: int) -> Spectrum:
        place, (dx, dy) = self._moved(name, x, y)
        dx, dy = dx - np.rint(dx), dy - np.rint(dy)
        field, F = self.fields[name], scipy.fft.rfft2(wrapped(self._blurs[name].at(place)[0], n))
        if field.q:
            F += _mean_tail(field, place) * _far(field.k, n, self.pitch / field.s)
            F /= F[0, 0].real
        if name in self.shifts:
            fy, fx = np.fft.fftfreq(n)[:, None], np.fft.fftfreq(n)[: n // 2 + 1]
            F = F * np.exp(-2j * np.pi * (fx * dx + fy * dy))
        return np.asarray(F, dtype=np.complex64)

    def in_plane(self, name: str, points: Array) -> Array:
        """Points of the picture in pixels of the plane."""
        return np.asarray((points - np.array(self.origins[name])) / self.pitch)

    @property
    def ring(self) -> int:
        """Half-width of the supports in pixels of the picture."""
        return max(int(np.ceil(field.k / 2 / field.s * self.pitch)) for field in self.fields.values()) + 2

    def side(self, shape: tuple[int, int]) -> int:
        """Side of the tiles, in pixels of the picture, within which the PSFs change little."""
        for n in SIDES:
            if self._change(shape, n / 2) <= CHANGE and self._move(shape, n / 2) <= MOVE_PX:
                return n
        return SIDES[-1]

    def _change(self, shape: tuple[int, int], reach: float) -> float:
        """Root mean square change of the supports over a quarter of a tile's side, relative to their norm."""
        name, field = next(iter(self.fields.items()))
        here, *moved = (field.samples(self.in_plane(name, places)) for places in _places(shape, reach / 2))
        return float(np.sqrt(max(np.sum((other - here) ** 2) for other in moved) / np.sum(here**2)))

    def _move(self, shape: tuple[int, int], reach: float) -> float:
        """Largest change of the shifts over a quarter of a tile's side, in pixels of the picture."""
        most = 0.0
        for name, shift in self.shifts.items():
            here, *moved = (shift(self.in_plane(name, places)) for places in _places(shape, reach / 2))
            most = max(most, *(float(np.abs(other - here).max()) for other in moved))
        return most


def _centred(shape: tuple[int, ...], coarse: tuple[int, int], finer: int) -> tuple[float, float]:
    """(x, y) of the first pixel of a coarser plane whose middle is that of a plane."""
    rows, columns = ((n - 1 - finer * (m - 1)) / 2 for n, m in zip(shape, coarse, strict=True))
    return columns, rows


def _mean_tail(field: PsfField, place: Array) -> float:
    """Amplitude of the mean tail at a position (1, 2), over the light within the tail's reach."""
    samples, amplitudes = np.split(field.parameters(place)[0], [field.k**2])
    within = samples.sum() + amplitudes @ tail_kernels(field.k)[: field.q].sum(axis=(1, 2))
    return float(amplitudes[0] / within)


@lru_cache(maxsize=8)
def _far(k: int, n: int, ratio: float) -> Array:
    """Spectrum (n, n // 2 + 1) of the mean tail's light from beyond the reach, per amplitude, for `ratio` samples of
    the picture per sample of the PSFs. It is a veil that only the lowest frequencies pass: without it every detail
    would count as slightly less blurred than it is."""
    f = np.hypot(np.fft.fftfreq(n)[:, None], np.arange(n // 2 + 1) / n)
    return spectrum_beyond(f.ravel() * ratio, k).reshape(f.shape)


def wrapped(kernel: Array, n: int) -> Array:
    """A kernel centred on sample 0 of n x n, with periodic boundary."""
    wrapped = np.zeros((n, n))
    at = (np.arange(len(kernel)) - len(kernel) // 2) % n
    np.add.at(wrapped, np.ix_(at, at), kernel)
    return wrapped


def _places(shape: tuple[int, int], step: float) -> tuple[Array, Array, Array]:
    """Positions over the frame, and those a step to the right and below."""
    rows, columns = shape
    x, y = np.meshgrid(np.linspace(0, columns - 1 - step, 8), np.linspace(0, rows - 1 - step, 8))
    places = np.column_stack([x.ravel(), y.ravel()])
    return places, places + np.array([step, 0]), places + np.array([0, step])
