"""Beside steps of depth a near thing hides what lies behind it: what a restoration says of itself there, and elsewhere.

`python -m tests.benchmarks.restoration_occlusion`

Two flats 200 x 240, rays traced to what they meet first; steps of 0.7 to 2 pixels of blur, two apertures and two
motions, noise 40 and 30 dB below the photographs. Parts: the frame beside steps as the restoration names it, and the
rest.
"""

from itertools import product

import numpy as np

from procedures import restore, stacks_of
from tests.benchmarks.restoration_scenes import picture
from tests.procedures.restoration.two_flats import lens, two_flats, wandering

SHAPE, RIM = (200, 240), 12
WIDTHS = ((1.5, 2.2), (1.5, 3.5), (3.0, 1.5), (4.0, 2.0), (2.5, 2.5))
MASKS_PX = {"defocus": 0.05, "motion": 0.12}
"""By what w errs besides: of a path that is drawn as a line."""


def trial(kind: str, widths: tuple[float, float], noise_db: float, seed: int) -> None:
    """Print errors over stated ones of both parts."""
    openings = (
        ((lens(), 1.0), (lens(), 1.25))
        if kind == "defocus"
        else ((wandering(7 * seed + 1), 1.0), (wandering(7 * seed + 2), 1.0))
    )
    case = two_flats(picture, SHAPE, widths, openings, noise_db, seed)
    stacks = stacks_of([one.shape for one, _ in openings], [r for _, r in openings], max(widths) + 1.5, SHAPE)
    outcome = restore(list(case.z), stacks)
    if outcome.value is None:
        print(f"{kind} {widths} {noise_db:.0f} dB: {outcome.verdict}: {outcome.reason}")
        return
    found, inside = outcome.value, (slice(RIM, -RIM), slice(RIM, -RIM))
    off, stated = (found.sharp[0] - case.sharp)[inside], found.sharp_std[inside]
    w_off, w_stated = (found.w - case.w)[inside], np.hypot(found.w_std, MASKS_PX[kind])[inside]
    beside = found.occlusion[inside]
    print(f"{kind} {widths} {noise_db:.0f} dB: {outcome.verdict} {outcome.reason[:60]}")
    for name, part in (("beside", beside), ("rest", ~beside)):
        if part.any():
            over = np.sqrt(np.mean(off[part] ** 2) / np.mean(stated[part] ** 2))
            shares = [np.mean(np.abs(a[part]) < 2 * b[part]) for a, b in ((off, stated), (w_off, w_stated))]
            print(
                f"   {name:6} {part.mean():4.0%} of the frame: picture's error over the stated one {over:.2f}, within "
                f"2 sigma {shares[0]:.0%}; w within 2 sigma {shares[1]:.0%}",
                flush=True,
            )


if __name__ == "__main__":
    for n, (kind, widths, noise_db) in enumerate(product(("defocus", "motion"), WIDTHS, (40.0, 30.0)), start=101):
        trial(kind, widths, noise_db, n)
