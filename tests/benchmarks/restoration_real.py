"""Real photographs through known kernels of camera shake: PSNR of the restoration, and of what one photograph gives.

`python tests/benchmarks/restoration_real.py [CASE ...] [--size 255]`. The pictures are those bundled with scikit-image
(which this needs), blurred by simulated kernels of 13 to 27 pixels; the kernels are given to the station as arrays with
one sample a pixel. Wiener and Richardson-Lucy get the true kernel and the parameters that suit the truth best.
"""

import argparse
import platform
import time

import numpy as np
from restoration_shaken import Conditions, Shaken, shaken

from procedures.restoration.joint.estimate import restore
from procedures.restoration.joint.kernel_sizes import default_max_w, fitting_ratios, stacks_of

CASES: dict[str, tuple[str, tuple[int, int], tuple[int, int], Conditions]] = {
    "plain": ("camera", (19, 17), (4, 3), Conditions()),
    "noise": ("coins", (23, 27), (6, 7), Conditions(noise=0.01)),
    "large": ("camera", (27, 27), (7, 8), Conditions(noise=0.01)),
    "smooth": ("moon", (13, 15), (1, 2), Conditions(noise=0.02)),
    "shifted": ("coins", (13, 15), (1, 2), Conditions(moved=(2.0, 1.0))),
    "subpixel": ("coins", (13, 15), (1, 2), Conditions(moved=(0.3, 0.4))),
    "light": ("camera", (13, 15), (1, 2), Conditions(light=0.96)),
    "highlights": ("camera", (15, 17), (2, 3), Conditions(exposure=1.3)),
    "padded": ("brick", (15, 19), (2, 4), Conditions(padded=True)),
    "kernels": ("camera", (21, 21), (5, 9), Conditions(measured=0.05)),
}
BALANCES = (1e-3, 3e-3, 1e-2, 3e-2, 0.1)
LUCY = (10, 30, 100)


def single_photograph(case: Shaken) -> tuple[float, float, float]:
    """PSNR of the better photograph, and of its best Wiener and Richardson-Lucy deconvolutions."""
    from skimage.restoration import richardson_lucy, wiener

    seen = list(zip(case.z, case.true, strict=True))
    return (
        max(case.psnr(z) for z in case.z),
        max(case.psnr(wiener(z, h, b)) for z, h in seen for b in BALANCES),
        max(case.psnr(richardson_lucy(z, h, n)) for z, h in seen for n in LUCY),
    )


def compare(name: str, case: Shaken) -> None:
    """Print one line."""
    blurred, wiener, lucy = single_photograph(case)
    z = [photograph[None] for photograph in case.z]
    start = time.process_time()
    max_w = default_max_w(case.known)
    ratios = fitting_ratios(z, case.known, max_w)
    outcome = restore(z, stacks_of(case.known, ratios, max_w, case.z[0].shape))
    seconds = time.process_time() - start
    found = outcome.value
    assert found is not None
    ours = case.psnr(found.sharp[0].astype(np.float64))
    print(
        f"{name:11s} {blurred:8.2f} {wiener:8.2f} {lucy:8.2f} {ours:9.2f} {ours - blurred:+7.2f}"
        f"   {np.median(found.w):6.2f} of {case.half_widths[0]:4.1f}, sd {found.w.std():.2f}"
        f"   {found.diagnostics.residual_over_noise:5.2f}   {seconds:4.0f} s   {outcome.verdict} {outcome.reason}",
        flush=True,
    )


def main() -> None:
    """Print the environment and a line for each case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", help=", ".join(CASES))
    parser.add_argument("--size", type=int, default=255)
    asked = parser.parse_args()
    print(f"Python {platform.python_version()}, {platform.machine()}, {asked.size} x {asked.size}")
    print("PSNR, dB     blurred   Wiener     Lucy  restored    gain   w, pixels              residual   processor")
    for name in asked.cases or CASES:
        picture, sizes, seeds, conditions = CASES[name]
        compare(name, shaken(picture, sizes, seeds, conditions, (asked.size, asked.size)))


if __name__ == "__main__":
    main()
