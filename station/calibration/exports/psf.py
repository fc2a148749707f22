"""A PSF field as files for other programs: photutils' STDPSF, PSFEx, deepinv."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

from procedures.field.field_file import read_field
from procedures.field.samplings import as_polynomial, grid_places, whole_psfs
from procedures.outcome import BadInput, BadParameter
from procedures.psf_field import PsfField, SpaceVariantBlur
from station.calibration.exports import Export
from station.results.exports import Cards, primary_image, table_of_one_cube

STDPSF_SAMPLES = 4
"""Samples per pixel: readers of STDPSF assume this number, which is not in the file."""
STDPSF_COLUMNS = 7
"""Points of the grid along the longer side of the frame."""
INSTRUMENTS = (36, 56, 90, 200)
"""Numbers of PSFs that readers attribute to instruments with several detectors."""
ALLOWED = 0.002
"""Largest error of a polynomial relative to the norm of a PSF: several tenths of the uncertainty of a field."""
FIRST = 1
"""Number of the first pixel in FITS and PSFEx."""


def field_path(result: Path) -> Path:
    """The field's file of a result, given by its folder or the file."""
    return result / "field.h5" if result.is_dir() else result


def read_plane(result: Path, plane: str | None) -> PsfField:
    """The field of one plane of a result, by its folder or field.h5; of green, or the first plane, by default. Raises
    BadInput if there is no field; BadParameter if the plane is not in it."""
    path = field_path(result)
    fields = read_field(path)
    if not fields:
        raise BadInput(f"{path} contains no field", "give the result of `station psf field` with one")
    name = plane or ("G1" if "G1" in fields else next(iter(fields)))
    if name not in fields:
        raise BadParameter(f"{path} has the planes {', '.join(fields)}, not {name!r}", "name one of these")
    return fields[name]


def _stdpsf(field: PsfField) -> Export:
    """Effective PSFs (with pixel response) on a grid of whole pixels.

    Source: `photutils.psf.stdpsf_reader`; Anderson & King 2000, PASP 112, 1360.
    """
    if field.s != STDPSF_SAMPLES:
        raise BadParameter(
            f"STDPSF has {STDPSF_SAMPLES} samples per pixel; the field has {field.s}",
            f"make the field with -s {STDPSF_SAMPLES}, or export to psfex",
        )
    columns = next(n for n in range(STDPSF_COLUMNS, 2 * STDPSF_COLUMNS) if _count(field, n) not in INSTRUMENTS)
    x, y = grid_places(field, columns)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    psfs = (field.s**2 * whole_psfs(field, points)).astype(np.float32)
    cards: Cards = [("NXPSFS", len(x)), ("NYPSFS", len(y))]
    cards += [(f"IPSFX{i:02d}", int(one) + FIRST) for i, one in enumerate(x, 1)]
    cards += [(f"JPSFY{i:02d}", int(one) + FIRST) for i, one in enumerate(y, 1)]
    cards += [
        ("PLANE", field.plane),
        ("COMMENT", "First row of the data: the upper one. Positions: pixels of the plane."),
    ]
    return Export(primary_image(psfs, cards), _grid_loss(field, x, y))


def _count(field: PsfField, columns: int) -> int:
    x, y = grid_places(field, columns)
    return len(x) * len(y)


def _grid_loss(field: PsfField, x: np.ndarray, y: np.ndarray) -> tuple[str, ...]:
    """Error of interpolation between the points of the grid at the centres of cells, where the field is known."""
    middle = np.stack(np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2), axis=-1).reshape(-1, 2)
    i, j = np.meshgrid(np.arange(len(x) - 1), np.arange(len(y) - 1))
    corners = [np.column_stack([x[i + a].ravel(), y[j + b].ravel()]) for a in (0, 1) for b in (0, 1)]
    known = np.all([field.inside(corner) for corner in corners], axis=0)
    if not known.any():
        return ()
    between = np.mean([whole_psfs(field, corner[known]) for corner in corners], axis=0)
    true = whole_psfs(field, middle[known])
    lost = np.linalg.norm(between - true, axis=(1, 2)) / np.linalg.norm(true, axis=(1, 2))
    return (f"between the points of the grid linear interpolation errs by {lost.max():.2%} of the PSF's norm at most",)


def _psfex(field: PsfField) -> Export:
    """PSFEx's model: a polynomial over the field for every sample, with pixel response.

    Source: PSFEx manual, "The PSF model file"; as read by `galsim.des.DES_PSFEx`.
    """
    model = as_polynomial(field, allowed=ALLOWED)
    h = field.samples(np.array([[(field.shape[1] - 1) / 2, (field.shape[0] - 1) / 2]]))[0]
    c, rows, columns = model.images.shape
    fwhm = float(2 * np.sqrt(np.count_nonzero(h > h.max() / 2) / np.pi) / field.s)  # of the circle of the same area
    cards: Cards = [
        ("EXTNAME", "PSF_DATA"), ("LOADED", len(field.nodes)), ("ACCEPTED", len(field.nodes)), ("CHI2", 1.0),
        ("POLNAXIS", 2), ("POLGRP1", 1), ("POLNAME1", "X_IMAGE"), ("POLZERO1", model.centre[0] + FIRST),
        ("POLSCAL1", model.scale), ("POLGRP2", 1), ("POLNAME2", "Y_IMAGE"), ("POLZERO2", model.centre[1] + FIRST),
        ("POLSCAL2", model.scale), ("POLNGRP", 1), ("POLDEG1", model.degree), ("PSF_FWHM", fwhm),
        ("PSF_SAMP", 1 / field.s), ("PSFNAXIS", 3), ("PSFAXIS1", columns), ("PSFAXIS2", rows), ("PSFAXIS3", c),
        ("PLANE", field.plane),
    ]  # fmt: skip
    data = table_of_one_cube("PSF_MASK", model.images.astype(np.float32), cards)
    return Export(
        data, (f"a polynomial of degree {model.degree} errs by {model.lost:.2%} of the PSF's norm at most; "
        "beyond the charts the polynomial is extrapolated",)
    )  # fmt: skip


def _deepinv(field: PsfField) -> Export:
    """Filters (1, 1, K, h, w) and multipliers (1, 1, K, rows, columns) on the plane's pixels, float32.

    The photograph is the sum over K of each filter's convolution with its multiplier times the scene, in this order.
    Source: deepinv, `physics.SpaceVaryingBlur`; Escande & Weiss 2017, J. Math. Imaging Vis. 58, 333.
    """
    filters, multipliers = SpaceVariantBlur(field).product_convolution(field.shape)
    file = io.BytesIO()
    np.savez_compressed(
        file, filters=filters[None, None].astype(np.float32), multipliers=multipliers[None, None].astype(np.float32)
    )
    return Export(file.getvalue(), ("on the plane's pixels, frequencies beyond their sampling are filtered out",))


PSF_FORMATS: dict[str, Callable[[PsfField], Export]] = {"stdpsf": _stdpsf, "psfex": _psfex, "deepinv": _deepinv}
