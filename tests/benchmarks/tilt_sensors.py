"""The tilt of a hundred simulated sensors: are its intervals honest, and do two turns of the screws lay them flat?

Usage: tilt_sensors.py [SENSORS [SEED]]. Each sensor's highest corner stands up to 100 um out, its middle up to 30 um,
before a lens at f/2.8 with coma, astigmatism and a curved field. PSFs come from the pupil, with the noise of one
rendered photograph's estimate; positions are reported with an error of 0.5 um. `tilt.py` renders the photographs too.
"""

import sys
import time
from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from procedures import Chart, Plane, Psf, estimate_psf
from procedures.field.estimate import BRACKET
from procedures.psf_field import Node
from procedures.tilt.estimate import Tilt, TiltParameters, estimate_tilt
from procedures.tilt.plane import Screws
from simulators.camera.camera import Lens, SimulatedCamera
from simulators.camera.optics import Optics
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene
from tests.procedures.field.lens import SHAPE, FieldCamera, K, S, grid

LENS = Lens(f_number=2.8, coma_um=0.05, astigmatism_um=0.06, field_curvature_um=0.05, axis=(0.0, 0.0))
PITCH_UM, FRAME_UM, STEPS_UM = 11.88, 36, 35.0 * np.arange(-4, 5)
PER_RMS = 16 * 3**0.5 * LENS.f_number**2
"""Of focus, in um along the axis, to a root mean square path difference of one um."""
POSITION_UM, MIDDLE_UM, CORNER_UM = 0.5, 30.0, 100.0
BAR_UM = 2.0
"""Standard uncertainty of a tilt over the frame that is asked for."""
REACH_UM, GRID_UM = 240.0, 6.0
"""Heights for which PSFs are computed; in between they are interpolated, beyond them a chart is too blurred."""
SCREWS = Screws(3, 8.0, 0.35, 30.0, turn_uncertainty=0.003)
PARAMETERS = TiltParameters(
    PITCH_UM, position_uncertainty_mm=POSITION_UM / 1000, chart_tilt_deg=0.0, nominal_mm=0.0, screws=SCREWS
)
HALF = np.array([SHAPE[1], SHAPE[0]]) * PITCH_UM / 2000
CORNERS = np.array([(x, y) for x in (-1, 1) for y in (-1, 1)]) * HALF
PLACES = grid(3, 3, 0.14)
AT_MM = (PLACES - (np.array([SHAPE[1], SHAPE[0]]) - 1) / 2) * PITCH_UM / 1000
NAMES = ("tilt_horizontal", "tilt_vertical", "backfocus")
Through = Callable[[float], np.ndarray]


def noise_of_a_chart() -> np.ndarray:
    """Covariance (p, p) of the PSF that one rendered photograph of a chart gives, as `tilt.py` takes them."""
    sensor = Sensor(170, 170, None, bits=14, full_well_e=60000.0, gain_e_per_dn=3.78)
    optics = Optics.typical(f_number=2.8, pitch_um=PITCH_UM, fill=0.7, gaussian_px=0.2)
    camera = SimulatedCamera(Lens(f_number=2.8), sensor, PITCH_UM, optics, white_e_per_s=1e6, oversampling=4)
    chart = Chart.from_seed()
    taken = camera.photograph(Scene((camera.place(chart, pixels=102.4),)), np.random.default_rng(1), exposure_s=0.005)
    found = estimate_psf(Plane("Y", taken.plane("Y").astype(np.float32), 1 / 65535), chart, BRACKET).result()
    return found.psf.parameter_covariance


def through_focus() -> list[Through]:
    """At each place, what gives the PSF's parameters from the sensor's height behind the lens's due focus, in um."""
    camera = FieldCamera(LENS, PITCH_UM, FRAME_UM)
    heights = np.arange(-REACH_UM, REACH_UM + GRID_UM, GRID_UM)
    return [
        CubicSpline(heights, [camera.parameters(x, y, defocus_um=height / PER_RMS) for height in heights])
        for x, y in PLACES
    ]


def bracket(
    plane: np.ndarray, through: list[Through], covariance: np.ndarray, root: np.ndarray, rng: np.random.Generator
) -> dict[float, list[Node]]:
    """The nodes of a sensor (offset in um, slopes in um/mm) at positions as they are reported."""
    found = {}
    for number, step in enumerate(STEPS_UM):
        nodes = []
        for place, at_mm, psf_at in zip(PLACES, AT_MM, through, strict=True):
            height = step + plane[0] + at_mm @ plane[1:]
            if abs(height) < REACH_UM:
                p = psf_at(height) + root @ rng.standard_normal(root.shape[1])
                nodes.append(Node(place, 1e-5 * np.eye(2), place, Psf.of(p, covariance, K, S), f"{number}", 1))
        found[(step + POSITION_UM * rng.standard_normal()) / 1000] = nodes
    return found


def random_sensor(rng: np.random.Generator) -> np.ndarray:
    """Offset and slopes."""
    slopes = rng.standard_normal(2)
    slopes *= rng.uniform(0, CORNER_UM) / np.abs(CORNERS @ slopes).max()
    return np.array([rng.uniform(-MIDDLE_UM, MIDDLE_UM), *slopes])


def turned(plane: np.ndarray, reported: Tilt, rng: np.random.Generator) -> np.ndarray:
    """The plane after its screws were turned by hands."""
    turns = np.array([one.value for one in reported.turns.turns]) + SCREWS.turn_uncertainty * rng.standard_normal(3)
    return plane + np.linalg.solve(SCREWS.heights, 1000 * SCREWS.pitch_mm * turns)


def truth(plane: np.ndarray) -> np.ndarray:
    """Of NAMES; the field's curvature lifts the mean by a third of what it has at half the diagonal."""
    bent = PER_RMS * LENS.field_curvature_um / 3
    return np.array([*(2 * HALF * plane[1:]), plane[0] + bent])


def main(sensors: int = 100, seed: int = 1) -> None:
    """Measure, turn, measure and turn every sensor."""
    start, rng = time.process_time(), np.random.default_rng(seed)
    covariance = noise_of_a_chart()
    values, vectors = np.linalg.eigh(covariance)
    root, through = vectors * np.sqrt(np.maximum(values, 0)), through_focus()
    print(f"PSFs through focus at {len(PLACES)} places: {time.process_time() - start:.0f} s of processor", flush=True)
    errors, stated, verdicts, left, misfits = [], [], [], [], []
    for _ in range(sensors):
        plane = random_sensor(rng)
        for number in range(2):
            outcome = estimate_tilt(bracket(plane, through, covariance, root, rng), SHAPE, 1, PARAMETERS)
            if (found := outcome.value) is None:
                verdicts.append(f"round {number + 1}: {outcome.reason}")
                break
            if number == 0:
                numbers = found.numbers()
                errors.append([numbers[name].value for name in NAMES] - truth(plane))
                stated.append([numbers[name].uncertainty for name in NAMES])
                verdicts.append(f"{outcome.verdict} {outcome.reason}")
                misfits.append(found.sensor.misfit)
            plane = turned(plane, found, rng)
        else:
            left.append((np.abs(CORNERS @ plane[1:]).max(), np.abs(truth(plane)[2])))
    report(np.array(errors), np.array(stated), np.array(left), verdicts, np.array(misfits))
    print(f"{time.process_time() - start:.0f} s of processor")


def report(errors: np.ndarray, stated: np.ndarray, left: np.ndarray, verdicts: list[str], misfits: np.ndarray) -> None:
    """Coverage, uncertainties and what two turns leave."""
    inside = np.abs(errors) < 1.96 * stated
    for i, name in enumerate(NAMES):
        ratio = np.sqrt(np.mean((errors[:, i] / stated[:, i]) ** 2))
        print(
            f"{name}: stated {np.median(stated[:, i]):.2f} um, {stated[:, i].max():.2f} at most; error "
            f"{np.sqrt(np.mean(errors[:, i] ** 2)):.2f} um rms, mean {errors[:, i].mean():+.2f}, {ratio:.2f} times "
            f"what is stated; {inside[:, i].mean():.1%} inside 95 %"
        )
    print(f"tilts inside: {inside[:, :2].mean():.1%} of {inside[:, :2].size}; misfit {np.median(misfits):.2f}")
    worse = np.any(stated[:, :2] > BAR_UM, axis=1)
    print(f"{worse.sum()} of {len(worse)} sensors have a tilt that is known to {BAR_UM:g} um only or worse")
    for words in sorted(set(verdicts)):
        print(f"{verdicts.count(words)} sensors: {words}")
    corner, mean = left.T
    print(
        f"after two turns: highest corner over the middle {np.median(corner):.2f} um, 95 % "
        f"{np.quantile(corner, 0.95):.2f}, {corner.max():.2f} at most; mean height "
        f"{np.median(mean):.2f} um, {mean.max():.2f} at most"
    )


if __name__ == "__main__":
    main(*(int(text) for text in sys.argv[1:]))
