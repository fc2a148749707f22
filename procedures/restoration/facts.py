"""Facts of a restoration: blur and brightness of its photographs."""

from collections.abc import Mapping
from dataclasses import dataclass

from procedures.plan import CameraFacts

APERTURES, MOTIONS, BOTH = "apertures", "motions", "motions and lens"
PLANE, COLOUR = "one plane", "colour"
NO, YES = "no", "yes"
SEARCH = "search"
"""Motions without a record are estimated from the photographs."""
ORDER = ("first", "second", "third")
"""Names of the blurred photographs in steps, purposes and facts."""
TRUTH = "truth"
"""Name of the sharp photograph."""


@dataclass(frozen=True)
class RestorationFacts(CameraFacts):
    """The facts of the plan.

    blur_by : "apertures", "motions", or "motions and lens" with one aperture in addition to recorded motions (6.5)
    lens_f_number : common f-number, where both blur
    focus_m : distance of the plane of focus from the lens, if the camera does not record it
    photographs : number of blurred ones, two or three
    colour : what is restored, "one plane", or the mosaic in "colour"
    max_w : half-width of the widest blur, in pixels of the plane
    first_f_number, second_f_number, third_f_number : as typed, or as recorded by the camera
    first_noise, first_contrast, first_view : standard deviations of its noise and of its samples, and a small copy
    first_level, second_level, third_level : mean of each photograph
    first_exposure_s, second_exposure_s, third_exposure_s : as recorded by the camera
    ground_truth : "yes" where one more, sharp photograph is taken
    truth_level, truth_exposure_s, truth_f_number, truth_sha256 : of that one
    shape : of the apertures, one for all or one for each photograph separated by ;, as in `masks.blur_models.named`, or
        files
    motion_shape : "search", or files of a shape for each photograph's motion separated by ;
    region : a flat part at one distance, x,y,width,height in pixels, "auto" or "whole"
    steady : "x" or "y" for uniform motion along that axis, whose masks are even, for the initial depth (Proposition 3);
        else "no"
    scheme : of the joint descent; None for the default
    """

    blur_by: str = APERTURES
    photographs: int = 2
    colour: str = PLANE
    max_w: float | None = None
    lens_f_number: float | None = None
    focus_m: float | None = None
    first_f_number: float | None = None
    second_f_number: float | None = None
    third_f_number: float | None = None
    first_noise: float | None = None
    first_contrast: float | None = None
    first_view: str | None = None
    first_level: float | None = None
    second_level: float | None = None
    third_level: float | None = None
    first_exposure_s: float | None = None
    second_exposure_s: float | None = None
    third_exposure_s: float | None = None
    ground_truth: str = NO
    truth_level: float | None = None
    truth_exposure_s: float | None = None
    truth_f_number: float | None = None
    truth_sha256: str | None = None
    shape: str = "pillbox"
    motion_shape: str = SEARCH
    region: str = "auto"
    steady: str = NO
    scheme: str | None = None

    def _each(self, fact: str) -> Mapping[str, float | None]:
        return {which: getattr(self, f"{which}_{fact}") for which in (*ORDER, TRUTH)}

    @property
    def f_numbers(self) -> Mapping[str, float | None]:
        """By photograph."""
        return self._each("f_number")

    @property
    def levels(self) -> Mapping[str, float | None]:
        """By photograph."""
        return self._each("level")

    @property
    def exposures_s(self) -> Mapping[str, float | None]:
        """By photograph."""
        return self._each("exposure_s")

    @property
    def blurred(self) -> tuple[str, ...]:
        """Names of the blurred photographs."""
        return ORDER[: self.photographs]
