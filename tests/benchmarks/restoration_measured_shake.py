"""Real photographs of real camera shake with its measured kernels: PSNR of the restoration, and of a plain filter.

`python -m tests.benchmarks.restoration_measured_shake FOLDER [--photographs 2] [--weights 0.3 1 3] [--unknown]`. FOLDER
holds the public set of Levin et al. (2009), 4 scenes x 8 kernels: `im05_flit01.mat` to `im08_flit08.mat` with the sharp
picture x, the photograph y and the kernel f. Eight groups of photographs, two of each scene. `--weights` also restores
with these multiples of the weight that the station chose; `--unknown` finds the kernels from the photographs, and shows
how like the true ones they are. The plain filter is Tikhonov's over all photographs, brought into
one place by the truth, with the weight that suits the truth best.
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.ndimage import shift
from scipy.optimize import OptimizeResult, minimize
from scipy.signal import fftconvolve

from procedures.restoration.joint.estimate import RestorationParameters, restore
from procedures.restoration.joint.kernel_sizes import default_max_w, fitting_ratios, stacks_of
from procedures.restoration.joint.result import Restoration
from procedures.restoration.photograph_blur import BlurSpec, SceneBlur, UnknownMotion, blur_of
from procedures.restoration.unknown_motion.flat_scene import FreeKernels, kernels_of_flat_scene
from tests.benchmarks.restoration_shaken import Shaken

Array = NDArray[np.float64]
SCENES = (5, 6, 7, 8)
WEIGHTS = 10.0 ** np.arange(-6, -1.9, 0.25)
RIM = 40


def group(folder: Path, scene: int, kernels: list[int]) -> Shaken:
    """The photographs of one scene through these kernels, numbered from 1."""
    parts = [loadmat(folder / f"im{scene:02d}_flit{k:02d}.mat") for k in kernels]
    # the set's f correlates
    known = [np.asarray(one["f"], float)[::-1, ::-1] / one["f"].sum() for one in parts]
    return Shaken([np.asarray(one["y"], float) for one in parts], known, known, np.asarray(parts[0]["x"], float))


def groups(count: int) -> list[tuple[int, list[int]]]:
    """Two groups of each scene: kernels 1 and 2, 3 and 4, ... in turn, then as many more as asked."""
    firsts = {5: (1, 5), 6: (3, 7), 7: (1, 5), 8: (3, 7)}
    return [(scene, [(k - 1 + n) % 8 + 1 for n in range(count)]) for scene in SCENES for k in firsts[scene]]


@dataclass(frozen=True)
class Plain:
    """The photographs (P, H, W) where the sharp picture is, and their kernels."""

    z: Array
    kernels: list[Array]

    @classmethod
    def of(cls, case: Shaken) -> Plain:
        """By the truth: every photograph is brought to where, and to the light in which, its kernel has the picture."""
        return cls(np.stack([_brought(z, h, case.sharp) for z, h in zip(case.z, case.true, strict=True)]), case.true)

    def restored(self, weight: float) -> Array:
        """The picture (H, W) of least squared differences and gradients, mirrored at its frame."""
        z = np.pad(self.z, ((0, 0), (RIM, RIM), (RIM, RIM)), mode="reflect")
        size = z.shape[1:]
        H = [np.fft.fft2(_centred(h, size)) for h in self.kernels]
        across = [2 - 2 * np.cos(2 * np.pi * np.fft.fftfreq(n)) for n in size]
        power = sum(np.abs(h) ** 2 for h in H) + weight * (across[0][:, None] + across[1])
        u = np.fft.ifft2(sum(np.conj(h) * np.fft.fft2(one) for h, one in zip(H, z, strict=True)) / power).real
        return np.asarray(u[RIM:-RIM, RIM:-RIM])


def _centred(kernel: Array, size: tuple[int, ...]) -> Array:
    wide = np.zeros(size)
    wide[: kernel.shape[0], : kernel.shape[1]] = kernel
    return np.roll(wide, [-(n // 2) for n in kernel.shape], (0, 1))


def _brought(z: Array, kernel: Array, sharp: Array) -> Array:
    """A photograph where and as light as the sharp picture through its kernel."""
    ideal = fftconvolve(np.pad(sharp, RIM, mode="edge"), kernel, mode="same")[RIM:-RIM, RIM:-RIM]
    inner = (slice(RIM, -RIM), slice(RIM, -RIM))

    def left(d: Array) -> float:
        back = shift(z, -d, order=3, mode="nearest")[inner]
        return float(np.std(back - ideal[inner] * (back.mean() / ideal[inner].mean())))

    d = _least(left, _whole_shift(z, ideal)).x
    back = shift(z, -d, order=3, mode="nearest")
    return np.asarray(back * (ideal[inner].mean() / back[inner].mean()))


def _whole_shift(z: Array, other: Array) -> Array:
    """How far z is shifted against another picture, y, x, to whole pixels."""
    window = np.outer(np.hanning(len(z)), np.hanning(len(z)))
    a, b = (np.fft.fft2((one - one.mean()) * window) for one in (other, z))
    peak = np.array(np.unravel_index(np.fft.ifft2(b * a.conj()).real.argmax(), z.shape))
    return np.asarray((peak + len(z) // 2) % len(z) - len(z) // 2)


def _least(left: Callable[[Array], float], begin: Array) -> OptimizeResult:
    """The shift about `begin` that leaves least, to hundredths of a pixel."""
    corners = begin + np.array([[0, 0], [0.5, 0], [0, 0.5]])
    return minimize(
        left, begin, method="Nelder-Mead", options={"xatol": 0.01, "fatol": 1e-9, "initial_simplex": corners}
    )


def restored(case: Shaken, weight: float | None = None, reported: FreeKernels | None = None) -> tuple[Restoration, str]:
    """What the station makes of it, and what it says. reported : the kernels, where the photographs gave them."""
    z = [photograph[None] for photograph in case.z]
    max_w = default_max_w(case.known)
    ratios = fitting_ratios(z, case.known, max_w)
    p = RestorationParameters(image_weight=weight)
    if reported is not None:
        outcome = blur_of_kernels(reported, z).restored(z, p)
    else:
        outcome = restore(z, stacks_of(case.known, ratios, max_w, case.z[0].shape), p)
    assert outcome.value is not None, outcome.reason
    return outcome.value, f"{outcome.verdict} {outcome.reason}"


INNER = (slice(16, -16), slice(16, -16))


def error(case: Shaken, found: Array) -> tuple[Array, Array]:
    """Error of a picture after the shift and the factor of light that suit best, rim left out; and the shift, y, x."""
    u, sharp = found.astype(np.float64), case.sharp[INNER]

    def left(d: Array) -> Array:
        back = shift(u, -d, order=3, mode="nearest")[INNER]
        return np.asarray(np.vdot(back, sharp) / np.vdot(back, back) * back - sharp)

    d = _least(lambda d: float(np.mean(left(d) ** 2)), _whole_shift(u, case.sharp)).x
    return left(d), d


def score(case: Shaken, found: Array) -> float:
    """PSNR, dB."""
    return float(-10 * np.log10(np.mean(error(case, found)[0] ** 2)))


def covered(case: Shaken, found: Restoration) -> tuple[float, float]:
    """The picture's stated error over its error, and the part of its pixels that err by less than 2 stated ones."""
    left, d = error(case, found.sharp[0])
    std = shift(found.sharp_std, -d, order=1, mode="nearest")[INNER]
    return float(found.diagnostics.picture_std / left.std()), float(np.mean(np.abs(left) < 2 * std))


def blur_of_kernels(reported: FreeKernels, z: list[Array]) -> SceneBlur:
    """As the station takes kernels that it found."""
    blur = blur_of(BlurSpec(UnknownMotion("whole", kernels=(*reported.kernels,))), z)
    return replace(blur, motion=reported.shapes)


def unknown(case: Shaken) -> FreeKernels:
    """The kernels as the photographs show them; printed."""
    start = time.process_time()
    found = kernels_of_flat_scene(np.stack(case.z))
    seconds = time.process_time() - start
    likeness = " ".join(f"{_likeness(a, b):.2f}" for a, b in zip(found.kernels, case.true, strict=True))
    print(
        f"likeness {likeness}  agreement {found.agreement:.2f}  left {found.residual:.4f}  {seconds:.0f} s"
        f"  {found.caveat or 'sure'}",
        flush=True,
    )
    return found


def _likeness(a: Array, b: Array) -> float:
    """Normalised correlation of two kernels at their best shift."""
    return float(fftconvolve(a, b[::-1, ::-1]).max() / np.linalg.norm(a) / np.linalg.norm(b))


def compare(case: Shaken, multiples: list[float], reported: FreeKernels | None = None) -> list[float]:
    """PSNR of the plain filter, of the restoration, and of those with other weights; printed."""
    plain = Plain.of(case)
    filtered = max(score(case, plain.restored(weight)) for weight in WEIGHTS)
    start = time.process_time()
    found, said = restored(case, reported=reported)
    seconds = time.process_time() - start
    weight = found.history[-1].weights.picture
    scores = [filtered, score(case, found.sharp[0])]
    scores += [score(case, restored(case, m * weight, reported)[0].sharp[0]) for m in multiples]
    stated, inside = covered(case, found)
    print(
        "".join(f"{one:7.2f}" for one in scores) + f"   stated/error {stated:.2f}  in 2 sd {inside:.3f}"
        f"   weight {weight:.1e}  noise {found.diagnostics.noise:.4f}"
        f"  w {np.median(found.w):5.2f}, sd {found.w.std():.2f}   {seconds:3.0f} s  {said}",
        flush=True,
    )
    return scores


def main() -> None:
    """Print the environment, a line for each group, and the means."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--photographs", type=int, default=2)
    parser.add_argument("--groups", type=int, nargs="*", default=range(8), help="of the eight, from 0")
    parser.add_argument("--unknown", action="store_true", help="kernels are found from the photographs")
    parser.add_argument("--weights", type=float, nargs="*", default=[])
    asked = parser.parse_args()
    print(f"Python {platform.python_version()}, {platform.machine()}, {asked.photographs} photographs")
    print("PSNR, dB, plain filter and restored, " + ", ".join(f"weight x {m:g}" for m in asked.weights))
    scores = []
    for n in asked.groups:
        scene, kernels = groups(asked.photographs)[n]
        print(f"scene {scene}, kernels {kernels}: ", end="")
        case = group(asked.folder, scene, kernels)
        scores.append(compare(case, asked.weights, unknown(case) if asked.unknown else None))
    print("mean", *(f"{one:.2f}" for one in np.mean(scores, axis=0)))


if __name__ == "__main__":
    main()
