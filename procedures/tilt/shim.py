"""What the sensor's offset asks of a shim under the lens's mount, or of all screws alike."""

from __future__ import annotations

from procedures.tilt.estimate import Tilt

TOLD = 2.0
"""Standard uncertainties under which an offset is not told from none."""


def shim_words(found: Tilt) -> str:
    """How much thicker or thinner the shim has to be, as a sentence without its stop; "" where no focus was nominal.

    A shim that is thicker by so much carries the image as far away from the sensor: its distance before the lens
    changes by the square of the magnification of that, which is left out.
    """
    shim = found.numbers().get("shim")
    if shim is None:
        return ""
    size = f"{abs(shim.value):.1f} ± {shim.uncertainty:.1f} um"
    if abs(shim.value) < TOLD * shim.uncertainty:
        return f"the backfocus of {size} does not differ from zero: leave the shim as it is"
    where, change, way = ("behind", "thinner", "towards") if shim.value < 0 else ("before", "thicker", "away from")
    turn = abs(shim.value) / (1000 * found.screws.pitch_mm)
    return (
        f"the sensor stands {size} {where} best focus: take a shim under the lens's mount that is {change} by that, or "
        f"turn every screw by {turn:.3f} {way} the lens, which is in their turns; not both"
    )
