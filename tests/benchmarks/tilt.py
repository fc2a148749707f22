"""`station tilt` on rendered photographs: a tilted sensor at f/2.8, nine charts, seven focus positions, screws turned.

Usage: tilt.py [ROUNDS [CORNER_UM [SEED [BEHIND_UM]]]]: measure, turn, measure and so on, from a highest corner of
CORNER_UM and a middle BEHIND_UM too far behind, which the lens's scale of distances does not know: its backfocus.
"""

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from procedures.pattern import Chart
from procedures.tilt.plane import Positions, Screws, behind_lens_um
from simulators.camera.camera import Lens, SimulatedCamera
from simulators.camera.optics import Optics
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene
from tests.benchmarks import ROOT

PITCH_UM, PIXELS = 11.88, 102.4
SENSOR = Sensor(500, 750, None, bits=14, full_well_e=60000.0, gain_e_per_dn=3.78)
LENS = Lens(f_number=2.8, coma_um=0.05, astigmatism_um=0.06, field_curvature_um=0.05)
STEPS_UM = 35.0 * np.arange(-3, 4)
SCREWS = Screws(3, 8.0, 0.35, 30.0, turn_uncertainty=0.003)
PER_RMS = 16 * 3**0.5 * LENS.f_number**2
"""Of focus, in um along the axis, to a root mean square path difference of one um."""
HALF = np.array([SENSOR.columns, SENSOR.rows]) * PITCH_UM / 2000
CORNERS = np.array([(x, y) for x in (-1, 1) for y in (-1, 1)]) * HALF


def focused_at(image_um: float) -> float:
    """The distance in mm that is in focus so far behind the lens."""
    image_mm = image_um / 1000
    return LENS.focal_length_mm * image_mm / (image_mm - LENS.focal_length_mm)


def bracket(folder: Path, plane: np.ndarray, rng: np.random.Generator) -> tuple[Path, float]:
    """Photographs of a sensor (offset in um, slopes in um/mm); the table of their focus distances, and the charts'."""
    folder.mkdir(parents=True)
    tilt_um = tuple(float(one) for one in plane[1:] * np.hypot(*HALF) / PER_RMS)
    optics = Optics.typical(f_number=LENS.f_number, pitch_um=PITCH_UM, fill=0.7, gaussian_px=0.2)
    camera = SimulatedCamera(
        replace(LENS, tilt_um=tilt_um), SENSOR, PITCH_UM, optics, white_e_per_s=1e6, oversampling=4
    )
    chart = Chart.from_seed()
    charts = tuple(camera.place(chart, pixels=PIXELS, at=(x, y)) for y in (0.16, 0.5, 0.84) for x in (0.13, 0.5, 0.87))
    distance_mm = float(charts[0].pose.centre_mm[2])
    image_um = behind_lens_um(distance_mm, Positions.SET, LENS.focal_length_mm)
    rows = []
    for number, step in enumerate(STEPS_UM):
        name = f"frame-{number}.pgm"
        focused = replace(camera, focus_mm=focused_at(image_um + step + plane[0]))
        taken = focused.photograph(Scene(charts), rng, exposure_s=0.005)
        samples = np.clip(np.rint(taken.plane("Y") * 65535), 0, 65535).astype(">u2")
        header = f"P5\n{SENSOR.columns} {SENSOR.rows}\n65535\n"
        (folder / name).write_bytes(header.encode() + samples.tobytes())
        rows.append(f"{name},{focused_at(image_um + step):.6f}")
    table = folder / "bracket.csv"
    table.write_text("\n".join(rows))
    return table, distance_mm


def measured(folder: Path, table: Path, distance_mm: float) -> dict:
    """The plane's entry of the record that the command writes."""
    out = folder / "tilt"
    command = [
        sys.executable, "-m", "station", "tilt", str(folder), "--focus", str(table), "--positions", "set",
        "--screw-radius-mm", str(SCREWS.radius_mm), "--screw-pitch-mm", str(SCREWS.pitch_mm),
        "--first-screw-deg", str(SCREWS.first_deg), "--turn-uncertainty", str(SCREWS.turn_uncertainty),
        "--chart-tilt-deg", "0", "--pixel-pitch-um", str(PITCH_UM), "--focal-length-mm", str(LENS.focal_length_mm),
        "--nominal-mm", str(distance_mm), "--out", str(out),
    ]  # fmt: skip
    done = subprocess.run(command, check=False, cwd=ROOT)
    if done.returncode not in (0, 1):
        raise SystemExit(done.returncode)
    return json.loads((out / "result.json").read_text())["planes"]["Y"]


def corner(plane: np.ndarray) -> float:
    """How far the highest corner stands out over the middle."""
    return float(np.abs(CORNERS @ plane[1:]).max())


def main(rounds: int = 3, corner_um: float = 80.0, seed: int = 1, behind_um: float = 0.0) -> None:
    """Measure and turn."""
    rng = np.random.default_rng(seed)
    slopes = rng.standard_normal(2)
    slopes *= corner_um / np.abs(CORNERS @ slopes).max()
    plane = np.array([behind_um, *slopes])
    with tempfile.TemporaryDirectory() as name:
        for number in range(rounds):
            folder = Path(name) / f"round-{number}"
            table, distance_mm = bracket(folder, plane, rng)
            start = time.perf_counter()
            stated = measured(folder, table, distance_mm)
            took = time.perf_counter() - start
            print(f"round {number + 1}: corner truly {corner(plane):.2f} um, {took:.0f} s")
            for what, true in zip(("tilt_horizontal", "tilt_vertical"), 2 * HALF * plane[1:], strict=True):
                one = stated[what]
                print(f"  {what} {one['value']:+.2f} +- {one['uncertainty']:.2f} um, truly {true:+.2f}")
            centre = stated["backfocus_centre"]
            print(f"  backfocus_centre {centre['value']:+.2f} +- {centre['uncertainty']:.2f} um, truly {plane[0]:+.2f}")
            print(f"  misfit {stated['diagnostics']['misfit']:.2f}, helps {stated['helps']:.3f}, {stated['reason']}")
            turned = np.array([one["turn"]["value"] for one in stated["screws"]])
            slips = SCREWS.turn_uncertainty * rng.standard_normal(SCREWS.count)
            plane = plane + np.linalg.solve(SCREWS.heights, 1000 * SCREWS.pitch_mm * (turned + slips))
            print(f"  turned: corner truly {corner(plane):.2f} um, middle {plane[0]:+.2f} um", flush=True)


if __name__ == "__main__":
    main(*(kind(text) for kind, text in zip((int, float, int, float), sys.argv[1:], strict=False)))
