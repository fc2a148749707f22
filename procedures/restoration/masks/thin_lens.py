"""Blur from camera settings and distance, and back: Gaussian optics (4.1 to 4.18) and its precision (chapter 9).

Distances from the front principal plane, all lengths in millimetres unless named otherwise.
"""

from dataclasses import dataclass

import numpy as np

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter


@dataclass(frozen=True)
class CameraSetting:
    """Focal length, f-number, distance of the plane of focus (may be infinite), pixel pitch. Raises BadParameter.

    `spread` is the half-width of the blur over the radius of the blur circle: 3 k for a Gaussian of sigma = k r.
    """

    focal_length_mm: float
    f_number: float
    focus_mm: float
    pitch_um: float
    spread: float = 1.0

    def __post_init__(self) -> None:
        if not all(0 < one < np.inf for one in (self.focal_length_mm, self.f_number, self.pitch_um)):
            raise BadParameter("focal length, f-number and pixel pitch must be positive", "take them from the camera")
        if not self.focus_mm > self.focal_length_mm:
            raise BadParameter(
                f"the plane of focus must lie beyond the focal length, got {self.focus_mm} mm",
                "measure it from the lens",
            )

    @property
    def aperture_radius_mm(self) -> float:
        """rho = f / (2 f-number) (4.2)."""
        return self.focal_length_mm / (2 * self.f_number)

    @property
    def image_distance_mm(self) -> float:
        """zeta: distance of the image plane from the lens, 1/zeta = 1/f - 1/l_s (4.1)."""
        return 1 / (1 / self.focal_length_mm - 1 / self.focus_mm)

    @property
    def scale_px_mm(self) -> float:
        """rho zeta in pixels times millimetres: the blur per unit of inverse distance (4.5)."""
        return self.spread * self.aperture_radius_mm * self.image_distance_mm / (self.pitch_um * 1e-3)

    def blur_radius_px(self, distance_mm: float | Array) -> Array:
        """Signed half-width of the blur, pixels: positive in front of the plane of focus (4.5)."""
        return np.asarray(self.scale_px_mm * (1 / np.asarray(distance_mm, float) - 1 / self.focus_mm))

    def distance_mm(self, radius_px: float | Array) -> Array:
        """Distance of a signed half-width of blur; infinite where no distance has so large a one."""
        inverse = np.asarray(radius_px, float) / self.scale_px_mm + 1 / self.focus_mm
        return np.where(inverse > 0, 1 / np.where(inverse > 0, inverse, 1), np.inf)


def relation(first: CameraSetting, second: CameraSetting) -> tuple[float, float]:
    """alpha, beta of r2 = alpha r1 + beta, half-widths in pixels of each photograph (4.8 to 4.10, 4.18)."""
    alpha = second.scale_px_mm / first.scale_px_mm
    inverse = 1 / second.image_distance_mm - 1 / first.image_distance_mm
    inverse += 1 / first.focal_length_mm - 1 / second.focal_length_mm
    return alpha, second.scale_px_mm * inverse
