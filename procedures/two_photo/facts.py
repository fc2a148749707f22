"""Facts of a calibration from two photographs of a wall: distances, light, numbers of frames."""

from dataclasses import dataclass

from procedures.plan import CameraFacts, derived_from

LEAST_RATIO, RATIO, MOST_RATIO = 2.2, 4.0, 8.0
"""Ratio of the two distances: below, no subpixel PSF is determined; above, the common part of the wall is too small."""
SHARP_RATIO = 3.2
"""Ratio from which three samples per pixel are determined, as required by a sharp lens: the zoom is larger."""


@dataclass(frozen=True)
class TwoPhotoFacts(CameraFacts):
    """Facts of the plan.

    near_mm : near distance of the wall
    ratio : far over near distance
    s : samples per pixel; None: chosen from the photographs
    focus_by : "ring" or "skip"
    near_level : mean of the near photograph
    far_light_percent : relative increase of the light in the far photograph
    near_laser_mm, near_z_mm : the rangefinder's reading and the rail's position at the near place
    far_way_mm : way of the camera to the far place, by rail or rangefinder
    near_frames, far_frames : number of accepted photographs
    predicted : "ratio uncertainty" of the MTF at Nyquist for each of `prediction.DISTANCES`, separated by commas
    farther : number of further distances
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
    predicted: str = ""
    farther: float = 0.0

    @property
    def predictions(self) -> dict[float, float]:
        """Predicted uncertainty of the MTF at Nyquist by a far photograph, by its distance over the near one."""
        pairs = (one.split() for one in self.predicted.split(",") if one)
        return {float(ratio): float(uncertainty) for ratio, uncertainty in pairs}
