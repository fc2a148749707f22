"""MTF50 of simulated cameras from the slanted edge and from the noise chart: errors, and how far the two differ.

The public recipe: Gaussian PSF of MTF50 0.25 cycles/pixel, 12 bit, 0.641 electrons a step, PRNU 0.85 %, read noise 2.5
electrons. Then one camera with diffraction before charts with edges, PSF and edges from the same frames.

python -m tests.benchmarks.slanted_edge [edges, default 200] [charts, default 30] [frames with both, default 100]
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from procedures import Chart, Plane, Roi, estimate_edge, estimate_psf
from procedures.cross_check.estimate import check_edges
from procedures.outcome import Quantity
from simulators.camera.camera import Lens, SimulatedCamera
from simulators.camera.optics import Optics
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene
from tests.procedures.slanted_edge.scenes import FULL_WELL_E, RECIPE, edge_light, exposed, gaussian, true_mtf50

MTF50 = 0.25


def report(name: str, numbers: Sequence[Quantity], true: float) -> None:
    """One line: the errors' 95th percentile, their mean, and how they compare with the error bars."""
    error = np.array([n.value for n in numbers]) / true - 1
    z = np.array([(n.value - true) / n.uncertainty for n in numbers])
    print(
        f"  {name}: 95 % of errors under {np.quantile(np.abs(error), 0.95):.2%}, mean {error.mean():+.2%}; over their "
        f"uncertainty {z.mean():+.2f} on average, standard deviation {z.std():.2f}"
    )


def edges(count: int, rows: int, columns: int) -> None:
    """The recipe's edges at random angles and places."""
    rng, numbers, taken = np.random.default_rng(1), [], 0.0
    light = edge_light(gaussian(MTF50))
    for serial in range(count):
        if serial % 5 == 0:
            angle, shift = rng.uniform(4, 12), tuple(rng.uniform(-0.5, 0.5, 2))
            light = edge_light(gaussian(MTF50), rows=rows, columns=columns, angle_deg=angle, shift=shift)
        plane = exposed(light, serial, rng)
        start = time.perf_counter()
        found = estimate_edge(plane, Roi.whole(plane.samples)).value
        taken += time.perf_counter() - start
        if found is not None:
            numbers.append(found.numbers["mtf50"])
    report(
        f"edge of {rows} x {columns} pixels, {len(numbers)} of {count} ({1000 * taken / count:.0f} ms)", numbers, MTF50
    )


def charts(count: int) -> None:
    """The recipe's camera before the noise chart."""
    camera = SimulatedCamera(
        Lens(), replace(RECIPE, rows=210, columns=210), 1.0, gaussian(MTF50), white_e_per_s=0.95 * FULL_WELL_E / 0.02
    )
    chart, rng, numbers = Chart.from_seed(), np.random.default_rng(2), []
    for serial in range(count):
        own = replace(camera, sensor=replace(camera.sensor, serial=serial))
        placed = own.place(chart, pixels=130, yaw_deg=rng.uniform(-5, 5), roll_deg=rng.uniform(-5, 5))
        shot = own.photograph(Scene((placed,)), rng)
        found = estimate_psf(Plane("Y", shot.plane("Y").astype(np.float32), 1 / 4095), chart).value
        if found is not None:
            numbers += [found.quality.numbers[f"mtf50_{name}"] for name in ("horizontal", "vertical")]
    report(f"PSF from a chart of 130 pixels, {len(numbers) // 2} of {count}", numbers, MTF50)


def both(count: int) -> None:
    """PSF and edges of the same frames, f/5.6 on 7.5 micrometres: the differences, and both against the truth."""
    optics, white = Optics.typical(f_number=5.6, pitch_um=7.52, gaussian_px=0.3), 2e4
    sensor = Sensor(
        230, 230, None, bits=14, full_well_e=1.3 * white, gain_e_per_dn=1.3 * white / 15000, read_noise_e=3.0
    )
    camera = SimulatedCamera(Lens(k1=0.01), sensor, 7.52, optics, white_e_per_s=white / 0.02)
    chart, found, refused = replace(Chart.from_seed(), edges=True), [], 0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        yaw, pitch, roll = rng.uniform(-1, 1, 3) * (6, 6, 3)
        placed = camera.place(chart, pixels=110, at=(0.43, 0.43), yaw_deg=yaw, pitch_deg=pitch, roll_deg=roll)
        scene = Scene((placed,), light=camera.light_on(placed, (0.03, 0.02)))
        plane = Plane("Y", camera.photograph(scene, rng).plane("Y").astype(np.float32), 1 / 15000)
        psf = estimate_psf(plane, chart).value
        checks = check_edges(plane, psf) if psf is not None else ()
        refused += len(checks) < 2
        found += [(check, true_mtf50(optics, -check.edge.normal_deg)) for check in checks]
    sigmas = np.array([check.sigmas for check, _ in found])
    print(f"  {len(found)} edges in {count} frames, {refused} frames with fewer than two")
    print(
        f"  PSF less edge: mean {np.mean([check.difference for check, _ in found]):+.2%}, "
        f"{np.mean(np.abs(sigmas) < 2):.1%} inside two standard errors, standard deviation of them {sigmas.std():.2f}"
    )
    for name in ("by_psf", "by_edge"):
        scaled = [
            replace(q := getattr(check, name), value=q.value / t, uncertainty=q.uncertainty / t) for check, t in found
        ]
        report(name.replace("_", " "), scaled, 1.0)


def main() -> None:
    """Run the three series."""
    counts = [int(n) for n in sys.argv[1:]]
    some, photographs, frames = (counts + [200, 30, 100][len(counts) :])[:3]
    print("The public recipe, MTF50 0.25 cycles/pixel")
    for rows, columns in ((100, 60), (60, 40)):
        edges(some, rows, columns)
    charts(photographs)
    print("Charts with edges, f/5.6, 7.5 micrometres, tilt to 6 degrees")
    both(frames)


if __name__ == "__main__":
    main()
