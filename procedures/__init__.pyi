# The public API. `procedures/__init__.py` loads each name on first use from the module that is named here.

from .correction.estimate import CorrectionParameters, correct
from .field.estimate import estimate_field
from .field.field_file import read_field, write_field
from .geometry.chart_bins.photographs import view_of
from .geometry.estimate import GeometryParameters, calibrate_geometry
from .outcome import BadInput, BadParameter, Outcome, ProcedureError, Refused, Verdict
from .pattern import Chart
from .pattern_psf.estimate import PatternParameters, estimate_psf
from .physics.estimate import estimate_physics
from .psf import Psf
from .psf_field import PsfField
from .quality import Diffraction, assess, otf
from .raw import Plane, read_frame
from .ray_histogram.film_files import read_film
from .ray_histogram.filter import FilterParameters
from .ray_histogram.multiscale import filter_film
from .reading.sensor_dump import DumpLayout
from .restoration.ground_truth import compare_to_ground_truth
from .restoration.joint.estimate import RestorationParameters, restore
from .restoration.joint.kernel_sizes import stacks_of
from .restoration.joint.schedule import Scheme
from .restoration.masks.blur_models import gaussian, pillbox
from .restoration.masks.camera_motion import poses_at
from .restoration.masks.gaussian_constant import gaussian_constant
from .restoration.masks.thin_lens import CameraSetting
from .restoration.photograph_blur import BlurSpec, KnownShapes, RecordedMotion, UnknownMotion, blur_of
from .restoration.refocus import refocus
from .sensor.estimate import characterise
from .sensor.stacks import SensorRecording, measure_level, measure_stack
from .slanted_edge.estimate import estimate_edge, estimate_edges
from .slanted_edge.strip import Roi
from .two_photo.estimate import TwoPhotoParameters, estimate_psf_of_pair
from .two_photo.several import estimate_psf_of_wall
from .vignetting.estimate import estimate_vignetting
from .whole_camera.camera_file import read_camera_numbers

__all__ = [
    "BadInput", "BadParameter", "BlurSpec", "CameraSetting", "Chart", "CorrectionParameters", "Diffraction",
    "DumpLayout", "FilterParameters", "GeometryParameters", "KnownShapes", "Outcome", "PatternParameters", "Plane",
    "ProcedureError", "Psf", "PsfField", "RecordedMotion", "Refused", "RestorationParameters", "Roi", "Scheme",
    "SensorRecording", "TwoPhotoParameters", "UnknownMotion", "Verdict", "assess", "blur_of", "calibrate_geometry",
    "characterise", "compare_to_ground_truth", "correct", "estimate_edge", "estimate_edges", "estimate_field",
    "estimate_physics", "estimate_psf", "estimate_psf_of_pair", "estimate_psf_of_wall", "estimate_vignetting",
    "filter_film", "gaussian", "gaussian_constant", "measure_level", "measure_stack", "otf", "pillbox", "poses_at",
    "read_camera_numbers", "read_field", "read_film", "read_frame", "refocus", "restore", "stacks_of", "view_of",
    "write_field",
]  # fmt: skip
