"""A photograph through a simulated lens, corrected through the measured field: what is gained, and how long it takes.

    python -m tests.benchmarks.correction gain            PSNR against the scene: several fields, and none
    python -m tests.benchmarks.correction loss            what fields' errors cost against the lens's own, and as stated
    python -m tests.benchmarks.correction speed [MEGAPIXELS]   four planes of a mosaic; 24 by default

The scene is a public photograph (matplotlib's sample of Grace Hopper, of the U.S. Navy), blurred by the lens's own
transfer functions on a grid of places. Fields are measured at 5 x 5 and 7 x 5 charts with errors as charts have them.
"""

import os
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest import mock

import cv2
import matplotlib
import numpy as np
import scipy.fft

from procedures.correction import estimate
from procedures.correction.estimate import Correction, CorrectionParameters, correct
from procedures.correction.optics import PlaneFields, wrapped
from procedures.correction.priors import ORDERS, Prior
from procedures.field.interpolate import interpolate
from procedures.field.models import Separate
from procedures.numerics.scattered import Polynomial
from procedures.psf import Psf
from procedures.psf_field import Node, PsfField, in_half_diagonals
from procedures.raw import Exposure, Plane, RawFrame
from simulators.camera.camera import Lens
from tests.procedures.correction.lens_photographs import RGGB, Sensor, blurred, kernels_over, sampled
from tests.procedures.correction.small_lens import SmallLens
from tests.procedures.field.lens import SHAPE, FieldCamera, K, S, grid, nodes

LENS = Lens(f_number=2.8, coma_um=0.2, astigmatism_um=0.22, field_curvature_um=0.2, axis=(0.08, -0.05))
LENSES = (
    LENS,
    Lens(f_number=2.8, coma_um=0.19, astigmatism_um=-0.157, field_curvature_um=0.114, axis=(-0.022, 0.060)),
    Lens(f_number=2.8, coma_um=-0.10, astigmatism_um=0.13, field_curvature_um=0.18, axis=(0.05, 0.03)),
    Lens(f_number=2.8, coma_um=0.15, astigmatism_um=0.10, field_curvature_um=-0.20, axis=(-0.06, -0.02)),
)
MEASURED = ((5, 5, 0.05, 1), (7, 5, 0.05, 1), (7, 5, 0.03, 1), (7, 5, 0.03, 4))
"""Columns and rows of charts, the outermost ones' distance from the edge, and the noise of their PSFs."""
RIM, EDGE = 40, 20
SAMPLE_STD = 1.4e-4
"""Of a PSF's samples, as a chart 100 pixels wide with noise of 0.5 % gives them: 0.0023 over all."""


def public_photograph() -> np.ndarray:
    """Green light of the photograph, mirrored to the frame's size and a rim."""
    path = Path(matplotlib.__file__).parent / "mpl-data" / "sample_data" / "grace_hopper.jpg"
    levels = cv2.imread(str(path))[..., 1] / 255
    light = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    return np.pad(light, ((0, 0), (160, 160)), mode="reflect")[: SHAPE[0] + 2 * RIM, : SHAPE[1] + 2 * RIM]


def constant_field(psf: Psf, measured: list[Node]) -> PsfField:
    """A field that has one PSF everywhere."""
    positions, n = np.array([node.position for node in measured]), len(psf.parameters)
    same = tuple(replace(node, psf=psf) for node in measured)
    smoother = Polynomial(in_half_diagonals(positions, SHAPE), np.ones(len(same)), 1)
    none, V = np.zeros((1, 1)), np.eye(1, n)
    share = np.full(len(same), 1 / len(same))
    return PsfField("Y", SHAPE, same, share, V, V, np.zeros(1), Separate("none", smoother), none, np.zeros((n, n)))


def gaussian_of(psf: Psf) -> Psf:
    """The Gaussian whose half maximum is as wide as the PSF's."""
    n = np.sum(psf.h > psf.h.max() / 2) / S**2
    r2 = psf.offsets_px[:, None] ** 2 + psf.offsets_px**2
    h = np.exp(-r2 * np.log(2) * np.pi / n)
    return Psf(h / h.sum(), S, psf.covariance)


def photograph(camera: FieldCamera) -> tuple[RawFrame, np.ndarray]:
    """The photograph, and the light that it is of."""
    light = public_photograph()
    through = blurred(light, kernels_over(lambda x, y: sampled(camera.whole(x, y), S, 1), SHAPE, (7, 9)), RIM)
    sensor = Sensor()
    plane = Plane("Y", sensor.read(through, np.random.default_rng(5)), 1 / sensor.steps)
    return RawFrame(Path("simulated"), "", {"Y": plane}, Exposure()), light[RIM:-RIM, RIM:-RIM]


class OwnOptics(PlaneFields):
    """The lens's own transfer functions for those of a field."""

    camera = FieldCamera(LENS)

    def _of_plane(self, name: str, x: float, y: float, n: int) -> np.ndarray:
        return scipy.fft.rfft2(wrapped(sampled(self.camera.whole(x, y), S, 1), n)).astype(np.complex64)


def squares(difference: np.ndarray) -> np.ndarray:
    """Mean square over the frame, and without its rim."""
    square = difference**2
    return np.array([square.mean(), square[EDGE:-EDGE, EDGE:-EDGE].mean()])


def losses(lens: Lens, seed: int) -> Iterator[np.ndarray]:
    """For each way to measure the lens's field, mean squares of the frame and without its rim: (3, 2).

    What the picture errs by through the lens's own PSFs, what it errs by more through the field, and how far the two
    pictures lie apart; and how far they do as stated from the field's covariance, twice.
    """
    camera = FieldCamera(lens)
    frame, truth = photograph(camera)
    covariance, how = np.eye(K * K + 6) * SAMPLE_STD**2, CorrectionParameters(Prior("second-order"))
    best = None
    for columns, rows, margin, noise in MEASURED:
        measured = nodes(camera, grid(columns, rows, margin), noise**2 * covariance, np.random.default_rng(seed))
        field = {"Y": interpolate("Y", SHAPE, measured).field}
        if best is None:
            with mock.patch.object(OwnOptics, "camera", camera), mock.patch.object(estimate, "PlaneFields", OwnOptics):
                best = corrected(frame, field, how).picture[0]
        found = corrected(frame, field, how)
        errs = squares(best - truth)
        picture = found.picture[0]
        yield np.array([
            errs, squares(picture - truth) - errs, squares(picture - best), np.full(2, found.field_error.rms**2)
        ])  # fmt: skip


def corrected(frame: RawFrame, field: dict[str, PsfField], how: CorrectionParameters) -> Correction:
    """The photograph through a field."""
    found = correct(frame, field, parameters=how).value
    assert found is not None
    return found


def loss() -> None:
    """Print the loss against the lens's own PSFs in dB, and how far the pictures lie apart, in levels of 255.

    The loss is of LENS, of the mean over all lenses, and as it would be if what is stated came to the picture's other
    errors as an independent one; the distance is measured and stated: of the frame, and without its rim.
    """
    every = np.array([list(losses(lens, seed)) for seed, lens in enumerate(LENSES, start=1)])
    words = ("loss, dB", "of all", "as stated", "differs")
    head = f"{'charts':28}" + "".join(f" {one:>13}" for one in words)
    print(f"{head} {'stated':>6} {'over it':>11} {'of one':>11}   (frame, inside)")
    for (columns, rows, margin, noise), each in zip(MEASURED, every.swapaxes(0, 1), strict=True):
        lost, as_stated = (10 * np.log10(1 + each[:, k] / each[:, 0]) for k in (1, 3))
        _, _, apart, stated = 255 * np.sqrt(np.maximum(each.mean(axis=0), 0))
        ratios = np.sqrt(each[:, 3] / each[:, 2])
        columns_of = (lost[0], lost.mean(axis=0), as_stated.mean(axis=0), apart)
        print(
            f"{f'{columns} x {rows} to {margin:.0%}, noise {noise} times':28}"
            + "".join(f" {frame:6.3f} {inside:6.3f}" for frame, inside in columns_of)
            + f" {stated[0]:6.3f} {stated[0] / apart[0]:5.2f} {stated[0] / apart[1]:5.2f}"
            + f" {ratios[:, 0].min():5.2f} {ratios[:, 0].max():5.2f}",
            flush=True,
        )


def gain() -> None:
    """Print PSNR in dB, of the whole frame and without its rim."""
    camera = FieldCamera(LENS)
    frame, truth = photograph(camera)
    covariance = np.eye(K * K + 6) * SAMPLE_STD**2
    measured = nodes(camera, grid(5, 5, 0.05), covariance, np.random.default_rng(1))
    closer = nodes(camera, grid(7, 5, 0.03), covariance, np.random.default_rng(1))
    dense = nodes(camera, grid(7, 7, 0.0), 1e-4 * covariance, np.random.default_rng(1), centre_px=1e-6)
    mean = Psf.of(np.mean([node.psf.parameters for node in measured], axis=0), covariance, K, S)
    fields = {
        "true field (7 x 7, no noise)": interpolate("Y", SHAPE, dense).field,
        "measured field (5 x 5)": interpolate("Y", SHAPE, measured).field,
        "measured field (7 x 5)": interpolate("Y", SHAPE, closer).field,
        "frame-averaged PSF": constant_field(mean, measured),
        "Gaussian of its width": constant_field(gaussian_of(mean), measured),
    }

    def line(words: str, picture: np.ndarray) -> None:
        difference = (picture - truth) ** 2
        whole, inside = np.mean(difference), np.mean(difference[EDGE:-EDGE, EDGE:-EDGE])
        print(f"{words:50} {-10 * np.log10(whole):8.2f} {-10 * np.log10(inside):8.2f}")

    print(f"{'PSNR in dB':50} {'frame':>8} {'inside':>8}")
    line("as it came", frame.planes["Y"].samples)
    for name, field in fields.items():
        for prior in ORDERS:
            found = correct(frame, {"Y": field}, parameters=CorrectionParameters(Prior(prior))).value
            if found is not None:
                line(f"{name}, {prior}", found.picture[0])


def speed(megapixels: float = 24.0) -> None:
    """Print the time and memory of a mosaic of so many megapixels, on all cores; reading and writing not included."""
    columns = round((megapixels * 1e6 * 1.5) ** 0.5 / 4) * 2
    shape = (round(columns / 1.5), columns)
    rng = np.random.default_rng(0)
    field = SmallLens(shape, 0.5, 0.3).field("G1", 1e-4).field
    light = 0.4 + 0.2 * np.sign(cv2.GaussianBlur(rng.standard_normal(shape, dtype=np.float32), (0, 0), 3))
    read = {name: light + np.float32(0.003) * rng.standard_normal(shape, dtype=np.float32) for name in RGGB}
    planes = {name: Plane(name, read[name], 1 / 16383, 2, origin) for name, origin in RGGB.items()}
    frame = RawFrame(Path("simulated"), "", planes, Exposure())
    wall, processor = time.perf_counter(), time.process_time()
    found = correct(frame, dict.fromkeys(RGGB, field)).value
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    side = found.side if found is not None else 0
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"{4 * light.size / 1e6:.1f} megapixels, tiles of {side}; {memory:.2f} GB")
    print(f"{wall:.1f} s on {os.cpu_count()} cores at a load of {os.getloadavg()[0]:.1f}")
    print(f"{processor:.1f} s of processor, {processor / 2:.1f} s on two cores")


if __name__ == "__main__":
    {"gain": gain, "loss": loss, "speed": lambda: speed(*(float(one) for one in sys.argv[2:]))}[
        (sys.argv[1:] or ["gain"])[0]
    ]()
