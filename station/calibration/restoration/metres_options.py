"""Options of a restoration in metres: the camera's data, the resulting blur, and depth in metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from procedures.outcome import BadParameter, Outcome, Verdict
from station.calibration.restoration.blur_options import BlurOptions, unfit

if TYPE_CHECKING:
    from procedures.raw import RawFrame
    from procedures.restoration.joint.result import Restoration
    from procedures.restoration.masks.blur_operator import Array
    from procedures.restoration.masks.mask_fields import Masks
    from procedures.restoration.masks.thin_lens import CameraSetting
    from procedures.restoration.metres import Distances


SIDES = ("front", "behind")
LEAST_DETERMINED = 0.3
"""Smallest fraction of the frame with a distance: there is none at depth edges, and where there is no texture."""


@dataclass(frozen=True)
class MetresOptions:
    """The options by name, as in `station restore` and in a procedure file.

    The camera's data are one value, or one for each image.
    """

    metres: str | None = None
    f_numbers: tuple[float, ...] = ()
    focus_m: tuple[float, ...] = ()
    focal_length_mm: float | None = None
    pixel_pitch_um: float | None = None

    def check(self, blur: BlurOptions, images: int) -> None:
        """Refuse inconsistent options. Raises BadParameter."""
        given = [one for one in (self.f_numbers, self.focus_m, self.focal_length_mm, self.pixel_pitch_um) if one]
        if self.metres is None:
            if given:
                raise unfit("--f-number, --focus-m, --focal-length-mm and --pixel-pitch-um go with --metres")
            return
        if self.metres not in SIDES:
            raise unfit(f"--metres is one of {', '.join(SIDES)}, not {self.metres!r}")
        if blur.blur != "defocus" or any(one != "pillbox" for one in blur.shapes):
            raise unfit(
                "--metres goes with --blur defocus --shape pillbox: there w is the radius of the lens's blur circle"
            )
        if blur.ratios or blur.offsets:
            raise unfit("--metres takes ratio and offset of the blurs from the camera's data")
        for option, several in (("--f-number", self.f_numbers), ("--focus-m", self.focus_m)):
            if len(several) not in (0, 1, images):
                raise unfit(f"{option} takes one value, or one for each of {images} images")

    def settings(self, frames: Sequence[RawFrame]) -> list[CameraSetting]:
        """Lens and focus of each photograph, in pixels of the plane. Raises BadParameter where something is missing."""
        from procedures.restoration.masks.thin_lens import CameraSetting

        settings = []
        for n, frame in enumerate(frames):
            recorded = frame.exposure
            focus_mm = 1000 * focus if (focus := _one(self.focus_m, n)) else recorded.subject_distance_mm
            known = {
                "--focal-length-mm": self.focal_length_mm or recorded.focal_length_mm,
                "--f-number": _one(self.f_numbers, n) or recorded.f_number,
                "--focus-m": focus_mm,
                "--pixel-pitch-um": self.pixel_pitch_um,
            }
            lacking = ", ".join(option for option, value in known.items() if not value)
            if lacking:
                raise BadParameter(f"photograph {n + 1} does not record all data for metres", f"give {lacking}")
            focal, number, focus_mm, pitch = (float(value or 0) for value in known.values())
            pitch *= next(iter(frame.planes.values())).pitch
            settings.append(CameraSetting(focal, number, focus_mm, pitch))
        return settings

    def blur(self, blur: BlurOptions, settings: Sequence[CameraSetting]) -> BlurOptions:
        """The blur's options with ratios and offsets from the camera's data (4.8 to 4.10)."""
        from procedures.restoration.masks.thin_lens import relation

        # radii are positive in front of the plane of focus; behind it w is their negative
        side = 1 if self.metres == "front" else -1
        related = [relation(settings[0], other) for other in settings[1:]]
        offsets = tuple(side * beta for _, beta in related)
        return replace(
            blur,
            shapes=("pillbox",),
            ratios=tuple(alpha for alpha, _ in related),
            offsets=offsets if any(abs(one) > 1e-9 for one in offsets) else (),
        )

    def distances(
        self, restoration: Restoration, photographs: Sequence[Array], masks: Sequence[Masks], setting: CameraSetting
    ) -> Distances:
        """Depth in metres of a restoration."""
        import numpy as np

        from procedures.restoration.first_depth.registration import register
        from procedures.restoration.masks.checks import trust_of
        from procedures.restoration.metres import ambiguity, distances_of, unexplained

        z = np.stack(photographs)
        aligned = register(z, trust_of(z), masks).z
        w, noise = restoration.w.astype(np.float64), restoration.diagnostics.noise
        spread = np.hypot(restoration.w_std, ambiguity(list(aligned), masks, w, noise))
        spread[unexplained(restoration.residual.astype(np.float64), noise)] = np.inf
        return distances_of(w, spread, setting, str(self.metres))

    @staticmethod
    def judged(outcome: Outcome[Restoration], distances: Distances) -> Outcome[Restoration]:
        """The outcome, doubtful where the distance of most of the frame is undetermined."""
        if distances.determined >= LEAST_DETERMINED or outcome.reason:
            return outcome
        reason = f"only {distances.determined:.0%} of the frame have a distance, as texture or blur are insufficient"
        return replace(
            outcome, verdict=Verdict.DOUBTFUL, reason=reason, remedy="put structure into the scene, or open the lens"
        )

    def entries(self, settings: Sequence[CameraSetting]) -> dict[str, Any]:
        """Record entries."""
        return {
            "metres": self.metres,
            "f_number": [one.f_number for one in settings],
            "focus_m": [one.focus_mm / 1000 for one in settings],
            "focal_length_mm": settings[0].focal_length_mm,
            "pixel_pitch_um": self.pixel_pitch_um,
        }


def _one(given: Sequence[float], n: int) -> float | None:
    return (given[0] if len(given) == 1 else given[n]) if given else None
