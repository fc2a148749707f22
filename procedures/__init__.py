"""Computation: from arrays to results. No terminal and no device; files only in `raw` and `pattern_print`.

Packages such as `pattern_psf` are independent of each other. They share `quality`, `raw`, `psf`, `pattern` and
`outcome`, and below these `numerics`, which is mathematics without cameras. A new package has its main function in
`estimate.py`; add it to the contract in `pyproject.toml`.

`__all__` is the public API for scripts and notebooks, stable between releases; other names may move. Each name is
loaded on first use, to keep imports fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from procedures.correction.deconvolve import Splitting
    from procedures.correction.estimate import Correction, CorrectionParameters, correct
    from procedures.correction.priors import Prior
    from procedures.field.estimate import MapLike, estimate_field
    from procedures.field.field_file import read_field
    from procedures.geometry.chart_bins.photographs import view_of, views_of
    from procedures.geometry.estimate import Geometry, GeometryParameters, calibrate_geometry
    from procedures.geometry.planes import calibrate_planes
    from procedures.geometry.views import ChartView
    from procedures.outcome import BadInput, BadParameter, Outcome, ProcedureError, Quantity, Refused, Verdict
    from procedures.pattern import Chart
    from procedures.pattern_print.source import Source
    from procedures.pattern_psf.chart_finding.detection import ChartSighting, find_chart
    from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
    from procedures.physics.estimate import Physics, estimate_physics
    from procedures.psf import Psf, PsfTail
    from procedures.psf_field import CoefficientModel, Node, PsfField
    from procedures.quality import Diffraction, Quality, assess, otf
    from procedures.raw import Exposure, ImuRecord, Plane, RawFrame, read_frame
    from procedures.ray_histogram.film import Film
    from procedures.ray_histogram.film_files import read_film
    from procedures.ray_histogram.filter import FilterParameters
    from procedures.ray_histogram.multiscale import FilteredFilm, filter_film
    from procedures.ray_histogram.sequence import filter_sequence
    from procedures.reading.sensor_dump import DumpLayout
    from procedures.restoration.first_depth.initial_depth import MatchingSettings
    from procedures.restoration.first_depth.registration import RegistrationSettings
    from procedures.restoration.first_depth.segments import SegmentSettings
    from procedures.restoration.ground_truth import GroundTruthLimits, compare_to_ground_truth
    from procedures.restoration.joint.depth_edges import EdgeSettings
    from procedures.restoration.joint.estimate import RestorationLimits, RestorationParameters, restore
    from procedures.restoration.joint.gauss_newton import PriorWeights
    from procedures.restoration.joint.joint_descent import JointRound, JointSettings
    from procedures.restoration.joint.kernel_sizes import stacks_of
    from procedures.restoration.joint.moved_objects import MovedSettings
    from procedures.restoration.joint.occlusion import OcclusionSettings
    from procedures.restoration.joint.restart_regions import RestartSettings
    from procedures.restoration.joint.result import GroundTruth, Restoration
    from procedures.restoration.joint.schedule import Scheme, WeightSettings
    from procedures.restoration.masks.blur_models import DepthUnit, gaussian, pillbox
    from procedures.restoration.masks.blur_operator import MaskStack
    from procedures.restoration.masks.camera_motion import Poses, RigSettings, poses_at, poses_of
    from procedures.restoration.masks.mask_fields import MaskField
    from procedures.restoration.masks.psf_shapes import MeasuredShape, measured_field, measured_shape
    from procedures.restoration.masks.shape_fields import ShapeField
    from procedures.restoration.photograph_blur import (
        AdditionalDefocus,
        BlurSpec,
        KnownShapes,
        RecordedMotion,
        SceneBlur,
        UnknownMotion,
        blur_of,
    )
    from procedures.restoration.unknown_motion.basin_hopping import BendSettings
    from procedures.restoration.unknown_motion.blind import Prototypes
    from procedures.restoration.unknown_motion.cross_relation import PlaceSettings
    from procedures.restoration.unknown_motion.flat_scene import (
        FreeKernels,
        FreeKernelSettings,
        KernelStart,
        kernels_of_flat_scene,
    )
    from procedures.restoration.unknown_motion.path_pairs import PairSettings
    from procedures.restoration.unknown_motion.path_refinement import MotionShapes
    from procedures.restoration.unknown_motion.path_settings import PathSettings
    from procedures.restoration.unknown_motion.rotated_scene import kernels_of_rotated_scene
    from procedures.sensor.estimate import SensorResult, characterise
    from procedures.sensor.estimate import sensor_model as sensor_model_of
    from procedures.sensor.levels import LightLevel, measure_level
    from procedures.sensor.recording import SensorRecording
    from procedures.sensor.stacks import FrameStack, measure_stack
    from procedures.sensor_model import SensorModel
    from procedures.slanted_edge.estimate import EdgeMtf, EdgeOutcome, estimate_edge, estimate_edges
    from procedures.slanted_edge.strip import Roi
    from procedures.two_photo.estimate import TwoPhotoParameters, TwoPhotoPsf
    from procedures.two_photo.estimate import estimate_psf as estimate_psf_of_pair
    from procedures.vignetting.estimate import PlaneVignetting, estimate_vignetting
    from procedures.whole_camera.camera_file import CameraNumbers, read_camera_numbers

__all__ = [
    "AdditionalDefocus", "BadInput", "BadParameter", "BendSettings", "BlurSpec", "CameraNumbers", "Chart",
    "ChartSighting", "ChartView", "CoefficientModel", "Correction", "CorrectionParameters", "DepthUnit",
    "Diffraction", "DumpLayout", "EdgeMtf", "EdgeOutcome", "EdgeSettings", "Exposure", "Film", "FilterParameters",
    "FilteredFilm", "FrameStack", "FreeKernelSettings", "FreeKernels", "Geometry", "GeometryParameters",
    "GroundTruth", "GroundTruthLimits", "ImuRecord", "JointRound", "JointSettings", "KernelStart", "KnownShapes",
    "LightLevel", "MapLike", "MaskField", "MaskStack", "MatchingSettings", "MeasuredShape", "MotionShapes",
    "MovedSettings", "Node", "OcclusionSettings", "Outcome", "PairSettings", "PathSettings", "PatternParameters",
    "PatternPsf", "Physics", "PlaceSettings", "Plane", "PlaneVignetting", "Poses", "Prior", "PriorWeights",
    "ProcedureError", "Prototypes", "Psf", "PsfField", "PsfTail", "Quality", "Quantity", "RawFrame",
    "RecordedMotion", "Refused", "RegistrationSettings", "RestartSettings", "Restoration", "RestorationLimits",
    "RestorationParameters", "RigSettings", "Roi", "SceneBlur", "Scheme", "SegmentSettings", "SensorModel",
    "SensorRecording", "SensorResult", "ShapeField", "Source", "Splitting", "TwoPhotoParameters", "TwoPhotoPsf",
    "UnknownMotion", "Verdict", "WeightSettings", "assess", "blur_of", "calibrate_geometry", "calibrate_planes",
    "characterise", "compare_to_ground_truth", "correct", "estimate_edge", "estimate_edges", "estimate_field",
    "estimate_physics", "estimate_psf", "estimate_psf_of_pair", "estimate_vignetting", "filter_film",
    "filter_sequence", "find_chart", "gaussian", "kernels_of_flat_scene", "kernels_of_rotated_scene",
    "measure_level", "measure_stack", "measured_field", "measured_shape", "otf", "pillbox", "poses_at", "poses_of",
    "read_camera_numbers", "read_field", "read_film", "read_frame", "restore", "sensor_model_of", "stacks_of",
    "view_of", "views_of",
]  # fmt: skip

# name -> its module under `procedures`, and its name there if different: the imports above, for use at run time
_MODULES = {
    "BadInput": "outcome",
    "BadParameter": "outcome",
    "BendSettings": "restoration.unknown_motion.basin_hopping",
    "BlurSpec": "restoration.photograph_blur",
    "CameraNumbers": "whole_camera.camera_file",
    "Chart": "pattern",
    "ChartSighting": "pattern_psf.chart_finding.detection",
    "ChartView": "geometry.views",
    "CoefficientModel": "psf_field",
    "Correction": "correction.estimate",
    "CorrectionParameters": "correction.estimate",
    "AdditionalDefocus": "restoration.photograph_blur",
    "DepthUnit": "restoration.masks.blur_models",
    "Diffraction": "quality",
    "DumpLayout": "reading.sensor_dump",
    "EdgeMtf": "slanted_edge.estimate",
    "EdgeOutcome": "slanted_edge.estimate",
    "EdgeSettings": "restoration.joint.depth_edges",
    "Exposure": "raw",
    "ImuRecord": "raw",
    "Film": "ray_histogram.film",
    "FilterParameters": "ray_histogram.filter",
    "FilteredFilm": "ray_histogram.multiscale",
    "FrameStack": "sensor.stacks",
    "FreeKernelSettings": "restoration.unknown_motion.flat_scene",
    "FreeKernels": "restoration.unknown_motion.flat_scene",
    "Geometry": "geometry.estimate",
    "GeometryParameters": "geometry.estimate",
    "GroundTruth": "restoration.joint.result",
    "GroundTruthLimits": "restoration.ground_truth",
    "JointRound": "restoration.joint.joint_descent",
    "JointSettings": "restoration.joint.joint_descent",
    "KernelStart": "restoration.unknown_motion.flat_scene",
    "KnownShapes": "restoration.photograph_blur",
    "LightLevel": "sensor.levels",
    "MapLike": "field.estimate",
    "MaskField": "restoration.masks.mask_fields",
    "MaskStack": "restoration.masks.blur_operator",
    "MatchingSettings": "restoration.first_depth.initial_depth",
    "MeasuredShape": "restoration.masks.psf_shapes",
    "MotionShapes": "restoration.unknown_motion.path_refinement",
    "MovedSettings": "restoration.joint.moved_objects",
    "Node": "psf_field",
    "OcclusionSettings": "restoration.joint.occlusion",
    "Outcome": "outcome",
    "PairSettings": "restoration.unknown_motion.path_pairs",
    "PathSettings": "restoration.unknown_motion.path_settings",
    "PatternParameters": "pattern_psf.estimate",
    "PatternPsf": "pattern_psf.estimate",
    "Physics": "physics.estimate",
    "PlaceSettings": "restoration.unknown_motion.cross_relation",
    "Plane": "raw",
    "PlaneVignetting": "vignetting.estimate",
    "Poses": "restoration.masks.camera_motion",
    "Prior": "correction.priors",
    "PriorWeights": "restoration.joint.gauss_newton",
    "ProcedureError": "outcome",
    "Prototypes": "restoration.unknown_motion.blind",
    "Psf": "psf",
    "PsfField": "psf_field",
    "PsfTail": "psf",
    "Quality": "quality",
    "Quantity": "outcome",
    "RawFrame": "raw",
    "RecordedMotion": "restoration.photograph_blur",
    "Refused": "outcome",
    "RegistrationSettings": "restoration.first_depth.registration",
    "RestartSettings": "restoration.joint.restart_regions",
    "Restoration": "restoration.joint.result",
    "RestorationLimits": "restoration.joint.estimate",
    "RestorationParameters": "restoration.joint.estimate",
    "RigSettings": "restoration.masks.camera_motion",
    "Roi": "slanted_edge.strip",
    "SceneBlur": "restoration.photograph_blur",
    "Scheme": "restoration.joint.schedule",
    "SegmentSettings": "restoration.first_depth.segments",
    "SensorModel": "sensor_model",
    "SensorRecording": "sensor.recording",
    "SensorResult": "sensor.estimate",
    "ShapeField": "restoration.masks.shape_fields",
    "Source": "pattern_print.source",
    "Splitting": "correction.deconvolve",
    "TwoPhotoParameters": "two_photo.estimate",
    "TwoPhotoPsf": "two_photo.estimate",
    "UnknownMotion": "restoration.photograph_blur",
    "Verdict": "outcome",
    "WeightSettings": "restoration.joint.schedule",
    "assess": "quality",
    "blur_of": "restoration.photograph_blur",
    "calibrate_geometry": "geometry.estimate",
    "calibrate_planes": "geometry.planes",
    "characterise": "sensor.estimate",
    "correct": "correction.estimate",
    "estimate_edge": "slanted_edge.estimate",
    "estimate_edges": "slanted_edge.estimate",
    "estimate_field": "field.estimate",
    "estimate_physics": "physics.estimate",
    "estimate_psf": "pattern_psf.estimate",
    "estimate_psf_of_pair": "two_photo.estimate:estimate_psf",
    "estimate_vignetting": "vignetting.estimate",
    "filter_film": "ray_histogram.multiscale",
    "filter_sequence": "ray_histogram.sequence",
    "find_chart": "pattern_psf.chart_finding.detection",
    "gaussian": "restoration.masks.blur_models",
    "compare_to_ground_truth": "restoration.ground_truth",
    "kernels_of_flat_scene": "restoration.unknown_motion.flat_scene",
    "kernels_of_rotated_scene": "restoration.unknown_motion.rotated_scene",
    "measure_level": "sensor.levels",
    "measure_stack": "sensor.stacks",
    "measured_field": "restoration.masks.psf_shapes",
    "measured_shape": "restoration.masks.psf_shapes",
    "otf": "quality",
    "pillbox": "restoration.masks.blur_models",
    "poses_at": "restoration.masks.camera_motion",
    "poses_of": "restoration.masks.camera_motion",
    "read_camera_numbers": "whole_camera.camera_file",
    "read_field": "field.field_file",
    "read_film": "ray_histogram.film_files",
    "read_frame": "raw",
    "restore": "restoration.joint.estimate",
    "sensor_model_of": "sensor.estimate:sensor_model",
    "stacks_of": "restoration.joint.kernel_sizes",
    "view_of": "geometry.chart_bins.photographs",
    "views_of": "geometry.chart_bins.photographs",
}


def __getattr__(name: str) -> object:
    """Load a public name on first use (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module 'procedures' has no attribute {name!r}")
    module, _, original = _MODULES[name].partition(":")
    value: object = getattr(import_module(f"procedures.{module}"), original or name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
