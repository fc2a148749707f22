"""A field in one self-describing HDF5 file, written and read: see `decisions/0001-hdf5.md`."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from procedures.field.interpolate import Interpolation, Recipe, rebuild, recipe_of
from procedures.field.maps import DEGREES, FieldMap, LateralColour, grid, mesh
from procedures.field.surfaces import fit_surface
from procedures.numbers import ENERGY_OUTSIDE_SUPPORT
from procedures.numerics.kernel_tail import SHAPES, tail_kernels
from procedures.outcome import BadInput, checked_type
from procedures.psf import MOST_PER_PX, Psf, PsfTail
from procedures.psf_field import Node, PsfField, in_half_diagonals
from procedures.reading.arrays import LONGEST
from procedures.reading.exposure import Exposure
from procedures.reading.guard import Room
from procedures.reading.hdf5 import Stored, opened
from procedures.vignetting.surface import LightSurface

if TYPE_CHECKING:
    import h5py


SCHEMA, WITHOUT_TAIL = "station/psf-field/2", "station/psf-field/1"
"""Schemas of this version and of older ones, whose PSFs end with their supports."""
FIELD = ("PSF field", (SCHEMA, WITHOUT_TAIL), "give the field.h5 of a result")
CONVENTIONS = """\
Arrays are [row, column]; positions are (x, y) in pixels of the plane, pixel centres at integers, x right, y down.
A PSF has `samples_per_pixel` samples per pixel of its plane along each axis. `psf` is its support, an odd square of
samples, of sum 1; its tail outside that is the sum over j of tail[j] tail_shapes[j], images about the same centre,
which end at a radius (the first continues as 1/r^3). The photograph is the convolution with support and tail, over the
sum of both; energy_outside_support is the tail's share of that sum. The centre sample lies at the position of the
chart's marks. Covariances are those of the samples in the order psf.ravel(), of the tail's amplitudes
(tail_covariance), and between the two (tail_cross), due to the noise of the photographs.
PLANE/nodes: measured PSFs.
PLANE/anywhere: base + sum over c of coefficients[i, j, c] components[c] is the PSF's support at (x[j], y[i]); the same
of base_tail and components_tail is the tail's amplitudes.
PLANE/maps: numbers of the whole PSF and their standard uncertainties; beyond the nodes they grow.
lateral_colour/PLANE: shift against the reference plane, in pixels of the sensor.
vignetting/PLANE: log of the light over that at the frame's centre, a polynomial of the place in half diagonals."""
CAMERA = "camera"  # attribute with the camera's metadata as JSON
VIGNETTING = "vignetting"
TEXTS, NUMBERS = ("camera", "lens"), ("f_number", "focal_length_mm", "subject_distance_mm")
NOTHING: Mapping[str, Any] = MappingProxyType({})
COLUMNS = 64  # positions of the rendered field along the frame's longer side


def write_field(
    path: Path | str,
    fields: Mapping[str, Interpolation | PsfField],
    maps: Mapping[str, Sequence[FieldMap]] = NOTHING,
    colours: Sequence[LateralColour] = (),
    provenance: Mapping[str, str] = NOTHING,
    camera: Exposure | None = None,
) -> None:
    """Write fields by plane, and where they are given their maps, lateral colour, and texts on their provenance.

    `camera` is what all photographs have in common: camera, lens, aperture, focus.

    Raises TypeError if one of them is no field, as the outcome of an estimate.
    """
    import h5py

    advice = "pass a field by plane, as outcome.result() of each that estimate_field gives"
    bare = ((name, one.field if isinstance(one, Interpolation) else one) for name, one in fields.items())
    whole = {name: checked_type(one, PsfField, advice) for name, one in bare}
    with h5py.File(path, "w") as file:
        file.attrs.update({"schema": SCHEMA, "conventions": CONVENTIONS, **provenance})
        if camera is not None:
            _put_camera(file, camera)
        for name, field in whole.items():
            plane = file.create_group(name)
            _write_plane(plane, field)
            _write_maps(plane.create_group("maps"), maps.get(name, ()))
        for colour in colours:
            group = file.create_group(f"lateral_colour/{colour.plane}")
            group.attrs["reference"] = colour.reference
            _put(group, "position", colour.positions, "pixel of the plane")
            _put(group, "shift", colour.shift, "pixel of the sensor")
            _put(group, "covariance", colour.covariance, "squared pixel of the sensor")
            _write_maps(group.create_group("maps"), colour.maps())


def set_camera(path: Path, camera: Exposure) -> None:
    """State camera, lens, aperture and focus in a written field."""
    import h5py

    with h5py.File(path, "a") as file:
        _put_camera(file, camera)


def _put_camera(file: h5py.File, camera: Exposure) -> None:
    metadata = asdict(camera)
    file.attrs[CAMERA] = json.dumps({name: metadata[name] for name in (*TEXTS, *NUMBERS)})


def add_lights(path: Path, lights: Mapping[str, LightSurface]) -> None:
    """Add the vignetting, by plane, to a written field. Raises BadInput where the frame's size differs."""
    import h5py

    with h5py.File(path, "a") as file:
        for name, light in lights.items():
            rows, columns = light.shape
            shape = (int(file[name].attrs["rows"]), int(file[name].attrs["columns"])) if name in file else light.shape
            if shape != light.shape:
                raise BadInput(
                    f"the vignetting of {name} must have the size of the field, {shape[1]} x {shape[0]} pixels; got "
                    f"{columns} x {rows}",
                    "give the flats and the charts of one camera",
                )
            group = file.create_group(f"{VIGNETTING}/{name}")
            group.attrs.update({"rows": rows, "columns": columns, "degree": light.degree})
            _put(group, "coefficients", light.coefficients, "1")


def read_lights(path: Path | str) -> dict[str, LightSurface]:
    """The vignetting by plane; empty where none was added. Raises BadInput as `read_field`."""
    with opened(path, *FIELD) as file:
        room = Room(str(path))
        planes = {name: Stored(group, room) for name, group in file.get(VIGNETTING, {}).items()}
        return {
            name: LightSurface(
                _shape_of(plane), plane.count("degree", 1, LONGEST), plane.numbers("coefficients", (None,))
            )
            for name, plane in planes.items()
        }


def _shape_of(plane: Stored) -> tuple[int, int]:
    return plane.count("rows", 1, LONGEST), plane.count("columns", 1, LONGEST)


def _put(group: h5py.Group, name: str, values: npt.ArrayLike, unit: str, **options: Any) -> None:
    group.create_dataset(name, data=np.asarray(values), **options).attrs["unit"] = unit


def _write_plane(plane: h5py.Group, field: PsfField) -> None:
    recipe = recipe_of(field.model)
    plane.attrs.update(
        {
            "rows": field.shape[0],
            "columns": field.shape[1],
            "samples_per_pixel": field.s,
            "model": field.model.name,
            "model_kind": recipe.kind,
            "model_setting": recipe.setting,
            "model_axis": np.array(recipe.axis),
            "components": len(field.components),
        }
    )
    nodes = plane.create_group("nodes")
    _put(nodes, "position", field.positions, "pixel of the plane")
    _put(nodes, "position_covariance", [n.position_covariance for n in field.nodes], "squared pixel of the plane")
    _put(nodes, "sensor_position", [n.sensor_position for n in field.nodes], "pixel of the sensor")
    _put(nodes, "psf", [n.psf.h for n in field.nodes], "1 (sum 1)")
    # seven digits of an error bar are enough, and half the file
    _put(nodes, "covariance", np.array([n.psf.covariance for n in field.nodes], dtype=np.float32), "1")
    if field.q:
        plane.attrs["tail_shape_names"] = list(SHAPES[: field.q])
        _put(nodes, "tail", [n.psf.tail.amplitudes for n in field.nodes], "1 (in addition to a support of sum 1)")
        _put(nodes, "tail_covariance", [n.psf.tail.covariance for n in field.nodes], "1")
        _put(nodes, "tail_cross", np.array([n.psf.tail.cross for n in field.nodes], dtype=np.float32), "1")
        share, uncertainty = np.transpose([n.psf.energy_outside for n in field.nodes])
        _put(nodes, ENERGY_OUTSIDE_SUPPORT, share, "1")
        _put(nodes, "energy_outside_support_uncertainty", uncertainty, "1")
    nodes.create_dataset("source", data=[n.source.encode() for n in field.nodes])
    nodes.create_dataset("number", data=[n.number for n in field.nodes])
    _write_anywhere(plane.create_group("anywhere"), field)


def _write_anywhere(group: h5py.Group, field: PsfField) -> None:
    """The field as base, components and coefficients on a grid, readable without its model."""
    k, n = field.k, field.k**2
    x, y = grid(field.shape, COLUMNS)
    points = mesh(x, y)
    coefficients = field.coefficients(points)
    _put(group, "x", x, "pixel of the plane")
    _put(group, "y", y, "pixel of the plane")
    _put(group, "base", field.base[:n].reshape(k, k), "1")
    _put(group, "components", field.components[:, :n].reshape(-1, k, k), "1")
    _put(group, "coefficients", coefficients.reshape(len(y), len(x), -1), "1")
    _put(group, "inside", field.inside(points).reshape(len(y), len(x)), "whether the nodes enclose the place")
    if field.q:
        _put(group, "base_tail", field.base[n:], "1")
        _put(group, "components_tail", field.components[:, n:], "1")
        shapes = tail_kernels(k)[: field.q].astype(np.float32)
        _put(group, "tail_shapes", shapes, "1 (energy per sample)", compression="gzip")
        _put(group, ENERGY_OUTSIDE_SUPPORT, field.energy_outside(points).reshape(len(y), len(x)), "1")


def _write_maps(group: h5py.Group, maps: Iterable[FieldMap]) -> None:
    for one in maps:
        entry = group.create_group(one.name)
        entry.attrs["title"] = one.title
        _put(entry, "x", one.x, "pixel of the plane")
        _put(entry, "y", one.y, "pixel of the plane")
        _put(entry, "value", one.value, one.unit)
        if one.uncertainty is not None:
            _put(entry, "uncertainty", one.uncertainty, one.unit)


def read_field(path: Path | str) -> dict[str, PsfField]:
    """The fields of a file by plane, with covariances in single precision.

    PSFs in a file of an older version have no tail (`PsfField.q` is 0): they end with their supports, and their
    numbers describe the support alone.

    Raises BadInput if it is not such a file.
    """
    with opened(path, *FIELD) as file:
        room = Room(str(path))
        return {name: _read_plane(name, group, room) for name, group in _planes(file)}


def read_camera(path: Path | str) -> Exposure | None:
    """Camera, lens, aperture and focus of the measurement; None where unknown. Raises BadInput as `read_field`."""
    with opened(path, *FIELD) as file:
        text = file.attrs.get(CAMERA)
    try:
        metadata = json.loads(text) if text is not None else None
    except (TypeError, ValueError, RecursionError):
        return None
    if not isinstance(metadata, dict):
        return None
    texts = {name: metadata[name] for name in TEXTS if isinstance(metadata.get(name), str)}
    numbers = {name: metadata[name] for name in NUMBERS if _is_positive(metadata.get(name))}
    return Exposure(**texts, **numbers)


def _is_positive(value: Any) -> bool:
    return type(value) in (int, float) and 0 < value < math.inf


def read_colours(path: Path | str) -> dict[str, LateralColour]:
    """Lateral colour by plane, where it was measured. Raises BadInput as `read_field`."""
    with opened(path, *FIELD) as file:
        room = Room(str(path))
        shapes = {name: _shape_of(Stored(plane, room)) for name, plane in _planes(file)}
        groups = {name: group for name, group in file.get("lateral_colour", {}).items() if name in shapes}
        return {name: _read_colour(name, group, shapes[name], room) for name, group in groups.items()}


def _read_colour(name: str, group: h5py.Group, shape: tuple[int, int], room: Room) -> LateralColour:
    stored = Stored(group, room)
    positions, shift = (stored.numbers(part, (None, 2), LONGEST) for part in ("position", "shift"))
    covariance = stored.numbers("covariance", (len(positions), 2, 2))
    surface = fit_surface(in_half_diagonals(positions, shape), shift, covariance, DEGREES)
    return LateralColour(name, str(group.attrs["reference"]), shape, positions, shift, covariance, surface)


def _planes(file: h5py.File) -> list[tuple[str, h5py.Group]]:
    return [(name, group) for name, group in file.items() if "nodes" in group]


def _read_plane(name: str, plane: h5py.Group, room: Room) -> PsfField:
    stored, attributes = Stored(plane["nodes"], room), Stored(plane, room)
    s = attributes.count("samples_per_pixel", 1, MOST_PER_PX)
    columns = (
        stored.numbers("position", (None, 2), LONGEST),
        stored.numbers("position_covariance", (None, 2, 2)),
        stored.numbers("sensor_position", (None, 2), LONGEST),
        _read_psfs(stored, s),
        stored.texts("source"),
        [int(number) for number in stored.values("number")],
    )
    nodes = [Node(*row) for row in zip(*columns, strict=True)]
    x, y = plane.attrs["model_axis"]
    recipe = Recipe(str(plane.attrs["model_kind"]), float(plane.attrs["model_setting"]), (float(x), float(y)))
    field = rebuild(name, _shape_of(attributes), nodes, recipe, attributes.count("components", 0, len(nodes)))
    _ = field.hull  # raises ValueError where the file's nodes enclose nothing
    return field


def _read_psfs(stored: Stored, s: int) -> Iterator[Psf]:
    supports = stored.numbers("psf", (None, "k", "k"))
    n, samples = len(supports), supports.shape[1] ** 2
    covariances = stored.numbers("covariance", (n, samples, samples))
    tails: Iterable[PsfTail] = [PsfTail.none(samples)] * n
    if "tail" in stored:
        parts = (
            stored.numbers("tail", (None, None)),
            stored.numbers("tail_covariance", (None, "q", "q")),
            stored.numbers("tail_cross", (None, samples, None)),
        )
        tails = [PsfTail(*part) for part in zip(*parts, strict=True)]
    for h, covariance, tail in zip(supports, covariances, tails, strict=True):
        yield Psf(h, s, covariance, tail)
