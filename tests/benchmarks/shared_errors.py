"""What PSF, centre and bins of a chart share, against repeated photographs: found over predicted spread, correlations.

    python -m tests.benchmarks.shared_errors [photographs]

A quarter of a second each. A correlation of n photographs is off by 1 / sqrt(n).
"""

import sys

import numpy as np

from procedures.pattern import CELLS, Chart
from procedures.pattern_psf.centre import mark_offset
from procedures.pattern_psf.correspondences import BINS, Correspondences
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.raw import Plane
from simulators.camera.camera import Lens, SimulatedCamera
from simulators.camera.optics import Optics
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene

Array = np.ndarray
WHITE_E, PITCH_UM, PIXELS = 2e4, 11.88, 66
WATCHED = ("first moment, x", "first moment, y", "centre, x", "centre, y", "bins' second power along x, x")


def photographs(count: int) -> list[PatternPsf]:
    sensor = Sensor(110, 110, None, bits=16, full_well_e=1.3 * WHITE_E, gain_e_per_dn=1.3 * WHITE_E / 65000)
    optics = Optics.typical(f_number=2.8, pitch_um=PITCH_UM, fill=0.5, gaussian_px=0.3)
    camera = SimulatedCamera(Lens(f_number=2.8), sensor, PITCH_UM, optics, white_e_per_s=WHITE_E / 4 / 0.02)
    chart = Chart.from_seed()
    scene = Scene((camera.place(chart, pixels=PIXELS, roll_deg=3.0),))
    found = []
    for seed in range(count):
        samples = camera.photograph(scene, np.random.default_rng(seed)).plane("Y").astype(np.float32)
        plane = Plane("Y", samples, 1 / 65535)
        found.append(estimate_psf(plane, chart, PatternParameters(3, 11, chosen=True)).result())
    return found


def bend(seen: Correspondences) -> Array:
    """How strongly a bin counts in the second power of place along x; a shift of the whole counts nothing."""
    x = np.meshgrid(*2 * [np.linspace(-1, 1, BINS)])[0].ravel()[seen.index] ** 2
    return (x - x.mean()) / len(x)


def measured(one: PatternPsf, first: PatternPsf) -> Array:
    """The watched numbers of one photograph; those of the bins from where the first photograph has them."""
    psf, seen = one.psf, one.correspondences
    centre = one.registration.to_sensor(np.full((1, 2), CELLS / 2))[0]
    centre = centre + mark_offset(psf.h, psf.s, one.registration.jacobian())
    x = psf.offsets_px
    moved = seen.points - first.registration.to_sensor(seen.cells)
    return np.array([x @ psf.h.sum(axis=0), x @ psf.h.sum(axis=1), *centre, bend(seen) @ moved[:, 0]])


def predicted(one: PatternPsf) -> Array:
    """Their covariance (5, 5) by the first photograph."""
    psf, seen, size = one.psf, one.correspondences, len(one.psf.parameters)
    x = np.tile(psf.offsets_px, (psf.k, 1))
    rows = np.zeros((4, size + 2))
    rows[0, : x.size], rows[1, : x.size] = x.ravel(), x.T.ravel()
    rows[2:, size:] = np.eye(2)
    shared = one.shared.centre
    joint = np.block([[psf.parameter_covariance, shared], [shared.T, one.centre_covariance]])
    weights = bend(seen)
    cross = weights @ one.shared.of_points(one.registration, seen.points)[:, 0] @ rows.T
    own = weights**2 @ seen.covariance[:, 0, 0]
    return np.block([[rows @ joint @ rows.T, cross[:, None]], [cross[None], np.full((1, 1), own)]])


def main(count: int) -> None:
    found = photographs(count)
    covariance, expected = np.cov(np.array([measured(one, found[0]) for one in found]).T), predicted(found[0])
    spread, said = (np.sqrt(np.diag(one)) for one in (covariance, expected))
    for i, name in enumerate(WATCHED):
        print(f"{name}: spread {spread[i] / said[i]:.2f} of the predicted")
        for j in range(i):
            here, there = covariance[i, j] / spread[i] / spread[j], expected[i, j] / said[i] / said[j]
            if abs(there) > 0.05:
                print(f"    with {WATCHED[j]}: {here:+.2f}, predicted {there:+.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
