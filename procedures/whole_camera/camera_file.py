"""All numbers of a camera and their covariance in one self-describing HDF5 file, written and read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from procedures.display import summary
from procedures.geometry.budget import TERMS
from procedures.numerics.arrays import Array
from procedures.reading.guard import Room
from procedures.reading.hdf5 import Stored, opened
from procedures.whole_camera.from_field import CovarianceBlock, WholeCamera

if TYPE_CHECKING:
    import h5py


SCHEMA = "station/camera/1"
CONVENTIONS = """\
`values`, `names`, `units` and `covariance` have the same order; a name consists of the part, a dot, and the number's
name in it. Pixels have their centres at integers, x right, y down.
geometry.NAME: parameters of COLMAP's camera `model` (an attribute of the group geometry), in pixels of the sensor;
COLMAP's own cx and cy have 0.5 more. Of a model BASE+SPLINE_NXxNY those of BASE, then spline_AXIS_COLUMN_ROW: control
points of a cubic B-spline over the frame, in pixels, which is added to the projection by BASE.
psf.PLANE.N.NAME: of the PSF at place N of that plane, see `places`; lengths and frequencies are in pixels of the plane.
lateral_colour.PLANE.AXIS.TERM: the shift along an axis against the reference plane, in pixels of the sensor, is the sum
of coefficient times term; x and y in the terms are the place in half diagonals from the frame's centre.
vignetting.PLANE.NAME: light = 1 + k1 r^2 + k2 r^4 + k3 r^6, r from (centre_x, centre_y), which are pixels of the plane
from the frame's centre, in half diagonals.
sensor.PLANE.NAME: gain K in digital numbers per electron, dark noise in electrons.
geometry/budget: `value` of every reported number, a formula's parameters where the model is a spline, and the terms of
its standard uncertainty, a row each; the root of their sum of squares is the uncertainty.
`blocks`: for each pair of parts whether their covariance was computed, or is zero, and why. Covariances are those of
noise and of other stated uncertainties; an unknown error common to all photographs, as that of a print, is in no
block."""
GIVE = "give the camera.h5 of a field's result"


@dataclass(frozen=True, eq=False)
class CameraNumbers:
    """Contents of a camera's file.

    values : (n,) float64
    covariance : (n, n) float64
    model : model of the geometry; "" without one
    size : (columns, rows), size of the frame in sensor pixels, (0, 0) without a geometry
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array
    blocks: tuple[CovarianceBlock, ...]
    model: str = ""
    size: tuple[int, int] = (0, 0)

    __repr__ = summary

    def places(self, beginning: str) -> list[int]:
        """Indices of the numbers with a prefix of their names: "geometry.", "psf.G1."."""
        return [i for i, name in enumerate(self.names) if name.startswith(beginning)]

    def numbers(self, beginning: str = "") -> dict[str, tuple[float, float]]:
        """Value and standard uncertainty by name."""
        sigma = np.sqrt(np.diag(self.covariance))
        return {self.names[i]: (float(self.values[i]), float(sigma[i])) for i in self.places(beginning)}

    def block(self, first: str, second: str) -> Array:
        """Covariance between the numbers of two prefixes."""
        return self.covariance[np.ix_(self.places(first), self.places(second))]


def write_camera_numbers(path: Path, camera: WholeCamera, provenance: Mapping[str, str]) -> None:
    """Write a camera, with provenance as text."""
    import h5py

    numbers = camera.numbers
    with h5py.File(path, "w") as file:
        file.attrs.update({"schema": SCHEMA, "conventions": CONVENTIONS, **provenance})
        _put_texts(file, "names", numbers.names)
        _put_texts(file, "units", numbers.units)
        file.create_dataset("values", data=numbers.values)
        file.create_dataset("covariance", data=numbers.covariance)
        blocks = file.create_group("blocks")
        for name in ("first", "second", "how", "why"):
            _put_texts(blocks, name, [getattr(block, name) for block in numbers.blocks])
        _write_geometry(file.create_group("geometry"), camera)
        _write_places(file.create_group("places"), camera)
        for colour in camera.colours:
            group = file.create_group(f"lateral_colour/{colour.plane}")
            group.attrs.update({"reference": colour.reference, "degree": colour.surface.degree,
                                "rows": colour.shape[0], "columns": colour.shape[1]})  # fmt: skip


def _write_geometry(group: h5py.Group, camera: WholeCamera) -> None:
    outcome = camera.geometry
    group.attrs.update({"verdict": str(outcome.verdict), "reason": outcome.reason, "remedy": outcome.remedy})
    if outcome.value is not None:
        one = outcome.value.camera
        group.attrs.update({"model": one.model, "columns": one.columns, "rows": one.rows})
        numbers, budgets = outcome.value.numbers(), outcome.value.budgets()
        budget = group.create_group("budget")
        _put_texts(budget, "names", budgets)
        _put_texts(budget, "units", [numbers[name].unit for name in budgets])
        _put_texts(budget, "terms", TERMS)
        budget.create_dataset("value", data=[numbers[name].value for name in budgets])
        budget.create_dataset("uncertainty", data=[[one[term] for term in TERMS] for one in budgets.values()])


def _write_places(group: h5py.Group, camera: WholeCamera) -> None:
    for plane in dict.fromkeys(name for name, _ in camera.places):
        nodes = [one.node for name, one in camera.places if name == plane]
        places = group.create_group(plane)
        places.create_dataset("position", data=[node.position for node in nodes]).attrs["unit"] = "pixel of the plane"
        _put_texts(places, "source", [node.source for node in nodes])
        places.create_dataset("number", data=[node.number for node in nodes])


def _put_texts(group: h5py.Group, name: str, texts: Any) -> None:
    group.create_dataset(name, data=np.array([text.encode() for text in texts], dtype="S"))


def read_camera_numbers(path: Path | str) -> CameraNumbers:
    """Read a camera's file. Raises BadInput if it is not such a file, or its parts are inconsistent."""
    with opened(path, "camera", (SCHEMA,), GIVE) as file:
        room = Room(str(path))
        stored, blocks = Stored(file, room), Stored(file["blocks"], room)
        texts = [blocks.texts(name) for name in ("first", "second", "how", "why")]
        geometry = file["geometry"].attrs
        camera = CameraNumbers(
            tuple(stored.texts("names")), tuple(stored.texts("units")), stored.numbers("values"),
            stored.numbers("covariance"), tuple(CovarianceBlock(*one) for one in zip(*texts, strict=True)),
            str(geometry.get("model", "")), (int(geometry.get("columns", 0)), int(geometry.get("rows", 0))),
        )  # fmt: skip
        # raise ValueError where numbers and covariance are inconsistent
        count, C = len(camera.names), camera.covariance
        if len(camera.units) != count or camera.values.shape != (count,) or C.shape != (count, count):
            raise ValueError("names, units, values and covariance must have the same length")
        if not np.allclose(C, C.T, rtol=1e-9, atol=0) or (np.diag(C) < 0).any():
            raise ValueError("a covariance must be symmetric, with variances of 0 or more")
        return camera
