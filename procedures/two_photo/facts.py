"""What a calibration from two photographs of a wall knows: the two distances, the light, the frames from nearby."""

from __future__ import annotations

from dataclasses import dataclass

from procedures.facts import CameraFacts, derived_from

LEAST_RATIO, RATIO, MOST_RATIO = 2.2, 4.0, 8.0
"""Of the two distances: below, no subpixel PSF is determined; above, too little of the wall is common to both."""
SHARP_RATIO = 3.2
"""From which three samples per pixel are determined, as a sharp lens needs: the zoom is larger than the ratio."""


@dataclass(frozen=True)
class TwoPhotoFacts(CameraFacts):
    """The facts of the plan.

    Attributes
    ----------
    near_mm : distance of the wall from nearby
    ratio : far over near distance
    s : samples per pixel; None lets the photographs choose
    focus_by : "ring" or "skip"
    near_level : mean of the near photograph
    far_light_percent : how much brighter the wall is from afar
    near_laser_mm, near_z_mm : the rangefinder's reading and the rail's position from nearby
    far_way_mm : how far the camera went back from there, by rail or rangefinder
    near_frames, far_frames : photographs that count
    """

    near_mm: float | None = None
    ratio: float = RATIO
    s: int | None = None
    focus_by: str = "ring"
    near_level: float | None = None
    far_light_percent: float | None = None
    near_laser_mm: float | None = derived_from("near_mm")
    near_z_mm: float | None = None
    far_way_mm: float | None = None
    near_frames: int | None = None
    far_frames: int | None = None
