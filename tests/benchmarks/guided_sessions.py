"""Whole guided sessions on the simulated bench: how long they take there, how far their numbers are from the truth.

Usage: guided_sessions.py camera|tilt [SEED]: `camera` is the whole camera behind a colour mosaic, `tilt` a sensor that
is tilted behind f/2.8, whose screws are turned until that would not help.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from procedures import read_camera_numbers
from simulators.camera.sensor import Sensor
from station.bench.opening import Bench, simulated_bench
from station.guide.catalogue import plan_named
from station.guide.frontend import Event, Result
from station.guide.run import Run
from station.guide.scripted import Scripted
from station.sessions.session import Session


def guided(name: str, bench: Bench, folder: Path, answers: dict[str, Any], listen: Any) -> Path:
    """Go through a plan; the last result's folder."""
    with Session.create(folder, plan=name, camera="C", lens="L", config={}, clock=bench.clock, seed=3) as session:
        operator = Scripted(answers, listen=listen)
        before = time.process_time()
        ended = Run(plan_named(name), bench, session, operator).go()
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
    view.camera = replace(view.camera, lens=lens, oversampling=4)
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
    view.camera = replace(view.camera, oversampling=4, sensor=Sensor(480, 640, cfa=None), pitch_um=11.88)
    half_mm = np.array([640, 480]) * 11.88e-3 / 2

    def listen(event: Event) -> None:
        if isinstance(event, Result):
            true = np.array(view.held.slopes)
            print(f"  {bench.clock.now_s() / 60:.1f} minutes: corner truly {np.abs(true) @ half_mm:.2f} um")
            for one in event.planes.values():
                for what, at in (("tilt_horizontal", 0), ("tilt_vertical", 1)):
                    told = one.numbers[what]
                    truly = 2 * true[at] * half_mm[at]
                    print(f"    {what} {told.value:+.2f} +- {told.uncertainty:.2f} um, truly {truly:+.2f}", flush=True)

    guided("tilt", bench, folder, {"chart_width_mm": 48.0}, listen)
    print(f"  left: corner truly {np.abs(view.held.slopes) @ half_mm:.2f} um")


def main(what: str = "camera", seed: int = 3) -> None:
    """One session."""
    with tempfile.TemporaryDirectory() as name:
        incoming = Path(name) / "incoming"
        incoming.mkdir()
        bench = simulated_bench(incoming, seed=seed, virtual_time=True)
        {"camera": camera, "tilt": tilt}[what](bench, Path(name))
        bench.close()


if __name__ == "__main__":
    main(*(kind(text) for kind, text in zip((str, int), sys.argv[1:], strict=False)))
