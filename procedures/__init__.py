"""What is computed: arrays become results. No terminal and no port; files only in `raw` and `pattern_print`.

Rooms stand side by side (`pattern_psf`, ...) over what they share (`quality`, `raw`, `psf`, `pattern`,
`outcome`), over `numerics`, which is mathematics without cameras. A new room is a package whose verb is in
`estimate.py`; add it to the contract in `pyproject.toml`.

For scripts and notebooks `__all__` is the library, and stays as it is between releases: whatever else has to be
imported from the rooms may move. Each name is loaded when it is first used, so that one who wants a PSF does not wait
for the restoration, and the command line, which imports from the rooms, waits for nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from procedures.correction.estimate import correct
    from procedures.field.estimate import estimate_field
    from procedures.field.field_file import read_field
    from procedures.geometry.estimate import calibrate_geometry
    from procedures.outcome import BadInput, BadParameter, Outcome, ProcedureError, Quantity, Refused, Verdict
    from procedures.pattern import Chart
    from procedures.pattern_print.source import Source
    from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
    from procedures.physics.estimate import Physics, estimate_physics
    from procedures.psf import Psf
    from procedures.psf_field import Node, PsfField
    from procedures.quality import Diffraction, Quality, assess, otf
    from procedures.raw import Exposure, Plane, RawFrame, read_frame
    from procedures.ray_histogram.film import Film
    from procedures.ray_histogram.film_files import read_film
    from procedures.ray_histogram.filter import FilterParameters
    from procedures.ray_histogram.multiscale import FilteredFilm, filter_film
    from procedures.reading.sensor_dump import DumpLayout
    from procedures.restoration.joint.estimate import Restoration, RestorationParameters, restore
    from procedures.restoration.joint.kernel_sizes import stacks_of
    from procedures.restoration.joint.schedule import Scheme
    from procedures.restoration.masks.blur_models import gaussian, pillbox
    from procedures.sensor.estimate import characterise
    from procedures.slanted_edge.estimate import EdgeMtf, EdgeOutcome, estimate_edge, estimate_edges
    from procedures.slanted_edge.strip import Roi
    from procedures.two_photo.estimate import TwoPhotoParameters, TwoPhotoPsf
    from procedures.two_photo.estimate import estimate_psf as estimate_psf_of_pair

__all__ = [
    "BadInput", "BadParameter", "Chart", "Diffraction", "DumpLayout", "EdgeMtf", "EdgeOutcome", "Exposure", "Film",
    "FilterParameters", "FilteredFilm", "Node", "Outcome", "PatternParameters", "PatternPsf", "Physics", "Plane",
    "ProcedureError", "Psf", "PsfField", "Quality", "Quantity", "RawFrame", "Refused", "Restoration",
    "RestorationParameters", "Roi", "Scheme", "Source", "TwoPhotoParameters", "TwoPhotoPsf", "Verdict", "assess",
    "calibrate_geometry", "characterise", "correct", "estimate_edge", "estimate_edges", "estimate_field",
    "estimate_physics", "estimate_psf", "estimate_psf_of_pair",
    "filter_film", "gaussian", "otf", "pillbox", "read_field", "read_film", "read_frame", "restore", "stacks_of",
]  # fmt: skip

# name -> the module under `procedures` that has it, and its name there where it is another: the same imports as above,
# which a checker of types or imports reads and a running program does not
_PLACES = {
    "BadInput": "outcome",
    "BadParameter": "outcome",
    "Chart": "pattern",
    "Diffraction": "quality",
    "DumpLayout": "reading.sensor_dump",
    "EdgeMtf": "slanted_edge.estimate",
    "EdgeOutcome": "slanted_edge.estimate",
    "Exposure": "raw",
    "Film": "ray_histogram.film",
    "FilterParameters": "ray_histogram.filter",
    "FilteredFilm": "ray_histogram.multiscale",
    "Node": "psf_field",
    "Outcome": "outcome",
    "PatternParameters": "pattern_psf.estimate",
    "PatternPsf": "pattern_psf.estimate",
    "Physics": "physics.estimate",
    "Plane": "raw",
    "ProcedureError": "outcome",
    "Psf": "psf",
    "PsfField": "psf_field",
    "Quality": "quality",
    "Quantity": "outcome",
    "RawFrame": "raw",
    "Refused": "outcome",
    "Restoration": "restoration.joint.estimate",
    "RestorationParameters": "restoration.joint.estimate",
    "Roi": "slanted_edge.strip",
    "Scheme": "restoration.joint.schedule",
    "Source": "pattern_print.source",
    "TwoPhotoParameters": "two_photo.estimate",
    "TwoPhotoPsf": "two_photo.estimate",
    "Verdict": "outcome",
    "assess": "quality",
    "calibrate_geometry": "geometry.estimate",
    "characterise": "sensor.estimate",
    "correct": "correction.estimate",
    "estimate_edge": "slanted_edge.estimate",
    "estimate_edges": "slanted_edge.estimate",
    "estimate_field": "field.estimate",
    "estimate_physics": "physics.estimate",
    "estimate_psf": "pattern_psf.estimate",
    "estimate_psf_of_pair": "two_photo.estimate:estimate_psf",
    "filter_film": "ray_histogram.multiscale",
    "gaussian": "restoration.masks.blur_models",
    "otf": "quality",
    "pillbox": "restoration.masks.blur_models",
    "read_field": "field.field_file",
    "read_film": "ray_histogram.film_files",
    "read_frame": "raw",
    "restore": "restoration.joint.estimate",
    "stacks_of": "restoration.joint.kernel_sizes",
}


def __getattr__(name: str) -> object:
    """One name of the library, loaded now (PEP 562)."""
    if name not in _PLACES:
        raise AttributeError(f"module 'procedures' has no attribute {name!r}")
    module, _, there = _PLACES[name].partition(":")
    value: object = getattr(import_module(f"procedures.{module}"), there or name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
