"""What a restoration knows: what blurs its two photographs, how much, and how bright they are."""

from __future__ import annotations

from dataclasses import dataclass

from procedures.facts import CameraFacts

APERTURES, MOTIONS = "apertures", "motions"


@dataclass(frozen=True)
class RestorationFacts(CameraFacts):
    """The facts of the plan.

    Attributes
    ----------
    blur_by : "apertures" or "motions"
    max_w : half-width of the widest blur, in pixels of the plane
    first_f_number, second_f_number : as typed, or as the camera noted them
    first_level, second_level : mean of each photograph
    first_exposure_s, second_exposure_s : as the camera noted them
    shape : of the apertures, see `masks.blur_models.named`
    region : a flat part of one distance, x,y,width,height in pixels, "auto" or "whole"
    scheme : of the joint descent; None is the usual one
    """

    blur_by: str = APERTURES
    max_w: float | None = None
    first_f_number: float | None = None
    second_f_number: float | None = None
    first_level: float | None = None
    second_level: float | None = None
    first_exposure_s: float | None = None
    second_exposure_s: float | None = None
    shape: str = "pillbox"
    region: str = "auto"
    scheme: str | None = None
