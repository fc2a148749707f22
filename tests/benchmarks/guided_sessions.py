"""Whole guided sessions on the simulated bench: how long they take there, how far their numbers are from the truth.

Usage: guided_sessions.py camera|tilt|restoration [SEED]: `camera` is the whole camera behind a colour mosaic, `tilt` a
sensor that is tilted behind f/2.8, whose screws are turned until that would not help, `restoration` a scene of three
sheets behind 160 x 120 pixels of each plane, restored in all ways that are asked for.
"""

import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from procedures.whole_camera.camera_file import read_camera_numbers
from simulators.bench.simulated_operator import F_NUMBERS
from simulators.bench.view import bench_camera
from simulators.camera.sensor import Sensor
from station.bench.opening import Bench, simulated_bench
from station.guide.catalogue import plan_named
from station.guide.frontend import Event, Result
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.sessions.session import Session


def guided(name: str, bench: Bench, folder: Path, answers: dict[str, Any], listen: Any) -> Path:
    """Go through a plan; the last result's folder."""
    with Session.create(folder, plan=name, camera="C", lens="L", config={}, clock=bench.clock, seed=3) as session:
        operator = ScriptedOperator(answers, listen=listen)
        before = time.process_time()
        ended = Run(plan_named(name, session.folder), bench, session, operator).go()
        took_s = time.process_time() - before
        results = [event for event in operator.heard if isinstance(event, Result)]
        shots = len(session.state.shots)
    print(f"{name}: {ended.how}, {shots} photographs in {bench.clock.now_s() / 60:.1f} minutes of the bench's time, "
          f"{took_s:.0f} s of processor; {results[-1].verdict}: {results[-1].reason}")  # fmt: skip
    return results[-1].folder


def camera(bench: Bench, folder: Path) -> None:
    """All parts of one camera against what was simulated."""
    view = bench.simulated.view
    lens = replace(view.camera.lens, k1=-0.01, vignetting=(-0.12, -0.02, 0.0), lateral_colour=0.01)
    view.camera = replace(bench_camera(), lens=lens, sensor=Sensor(720, 960), oversampling=4)
    result = guided("camera", bench, folder, {"places": 9.0, "views": 6.0}, lambda event: None)
    found = read_camera_numbers(result / "camera.h5")
    parts = {".".join(name.split(".")[: 1 + (name[0] in "lp")]): 0 for name in found.names}
    print(f"  parts with numbers: {', '.join(parts)}")
    true_px = np.mean([one.truths[0].projection.principal_px for one in view.taken if one.truths][-6:])
    radius_px = np.hypot(view.camera.sensor.rows, view.camera.sensor.columns) / 2
    truths = {"geometry.f": true_px, "geometry.fx": true_px}
    for plane in ("R", "G1", "B"):
        truths[f"sensor.{plane}.system_gain"] = 1 / view.camera.sensor.gain_e_per_dn
        truths[f"sensor.{plane}.temporal_dark_noise"] = view.camera.sensor.read_noise_e
    for plane, shift_um in (("R", 0.07), ("B", -0.07)):  # the image grows by so much of half the diagonal
        truths[f"lateral_colour.{plane}.x.x"] = truths[f"lateral_colour.{plane}.y.y"] = 0.01 * shift_um * radius_px
    for name, (value, uncertainty) in found.numbers().items():
        if name in truths:
            print(f"  {name} {value:.6g} +- {uncertainty:.2g}, truly {truths[name]:.6g}")
    for plane in ("R", "G1", "B"):
        corner = sum(found.numbers(f"vignetting.{plane}.k")[f"vignetting.{plane}.k{i}"][0] for i in (1, 2, 3))
        print(f"  light lost in the corners of {plane}: {-corner:.4f}, truly {-sum(lens.vignetting):.4f}")


def tilt(bench: Bench, folder: Path) -> None:
    """The sensor's highest corner, before and after every turn."""
    view = bench.simulated.view
    view.camera = replace(view.camera, oversampling=4)
    half_mm = np.array([640, 480]) * 11.88e-3 / 2

    def listen(event: Event) -> None:
        if isinstance(event, Result):
            true = np.array(view.held.slopes)
            print(f"  {bench.clock.now_s() / 60:.1f} minutes: corner truly {np.abs(true) @ half_mm:.2f} um")
            for one in event.planes.values():
                for what, at in (("tilt_horizontal", 0), ("tilt_vertical", 1)):
                    stated = one.numbers[what]
                    truly = 2 * true[at] * half_mm[at]
                    print(
                        f"    {what} {stated.value:+.2f} +- {stated.uncertainty:.2f} um, truly {truly:+.2f}", flush=True
                    )

    guided("tilt", bench, folder, {}, listen)
    print(f"  left: corner truly {np.abs(view.held.slopes) @ half_mm:.2f} um")


RESTORATIONS: dict[str, tuple[bool, dict[str, Any]]] = {
    "shaker, two": (True, {}),
    "shaker, three": (True, {"photographs": 3.0}),
    "shaker, three, in colour": (True, {"photographs": 3.0, "colour": "colour"}),
    "IMU, two": (False, {}),
    "IMU, three": (False, {"photographs": 3.0}),
    "motions and lens, two": (False, {"blur_by": "motions and lens"}),
    "shaker and lens, two": (True, {"blur_by": "motions and lens"}),
    "apertures, two": (False, {"blur_by": "apertures"}),
    "apertures, three": (False, {"blur_by": "apertures", "photographs": 3.0}),
    "apertures, three, in colour": (False, {"blur_by": "apertures", "photographs": 3.0, "colour": "colour"}),
}
SHEETS = (np.s_[76:110, 112:150], np.s_[5:45, 115:155], np.s_[10:110, 10:80])
"""Parts of the plane that show one sheet each, from the back to the front."""


def restoration(folder: Path, seed: int) -> None:
    """Depth and picture of a scene, each with a ground truth, by all that may blur."""
    for n, (what, (shaker, answers)) in enumerate(RESTORATIONS.items()):
        incoming = folder / str(n)
        incoming.mkdir()
        bench = simulated_bench(incoming, seed=seed, virtual_time=True, shaker=shaker)
        view = bench.simulated.view
        view.camera = replace(view.camera, sensor=Sensor(rows=240, columns=320))
        print(what, end=", ")
        result = guided("restoration", bench, folder, {**answers, "ground_truth": "yes"}, lambda event: None)
        w, witness = np.load(result / "w.npy"), json.loads((result / "result.json").read_text())["ground_truth"]
        grain = w.shape[0] // 120
        parts = [tuple(slice(grain * one.start, grain * one.stop) for one in part) for part in SHEETS]
        stated = [float(np.median(w[part])) for part in parts]
        distances_mm = [bench.simulated.world.distance_mm(0.0) + one.behind_mm for one in view.sheets]
        camera = view.camera
        if answers.get("blur_by") == "apertures":
            # radius of the blur circle of the first photograph, in pixels of a plane
            f, focus_mm, pitch_mm = camera.lens.focal_length_mm, float(view.focus_mm or 0.0), camera.pitch_um / 1000
            widest = f**2 / (2 * F_NUMBERS["first"] * (focus_mm - f)) / (2 * pitch_mm)
            truth = [widest * (1 - focus_mm / d) for d in distances_mm]
        else:
            truth = [1000 / d for d in distances_mm]
        print("  w " + ", ".join(f"{a:.3f} (truly {b:.3f})" for a, b in zip(stated, truth, strict=True)))
        print(f"  ground truth {witness['psnr_db']:.1f} dB, photographs {max(witness['before_db']):.1f} dB at best; "
              f"error {100 * witness['error']:.2f} % of white, as soft {100 * witness['error_as_soft']:.2f} %, stated "
              f"{100 * witness['stated_error']:.2f} %", flush=True)  # fmt: skip
        bench.close()


def main(what: str = "camera", seed: int = 3) -> None:
    """One session, or all ways to restore."""
    with tempfile.TemporaryDirectory() as name:
        if what == "restoration":
            restoration(Path(name), seed)
            return
        incoming = Path(name) / "incoming"
        incoming.mkdir()
        bench = simulated_bench(incoming, seed=seed, virtual_time=True)
        bench.simulated.show(plan_named(what).subject)
        {"camera": camera, "tilt": tilt}[what](bench, Path(name))
        bench.close()


if __name__ == "__main__":
    main(*(kind(text) for kind, text in zip((str, int), sys.argv[1:], strict=False)))
