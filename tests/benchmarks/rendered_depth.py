"""A rendered scene in depth, photographed at two apertures and restored: errors of depth and picture, and the time.

python tests/benchmarks/rendered_depth.py [--columns 320] [--samples 64] [--out FOLDER]; films are kept in the folder.
"""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
import time
from pathlib import Path

from station.demo.rendered import RenderPlan, rendered_demo


def main() -> None:
    """Print environment, time, and the figures beside what they are compared with."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--columns", type=int, default=320)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    threads = os.cpu_count() or 1
    print(f"Python {platform.python_version()}, {platform.machine()}, {threads} cores, load {os.getloadavg()[0]:.1f}")
    plan = RenderPlan(columns=options.columns, samples=options.samples, scenes=())
    start = time.perf_counter()
    _, depth, _ = rendered_demo(options.out or Path(tempfile.mkdtemp()), plan, threads=threads)
    assert depth is not None
    print(f"{plan.columns} x {plan.rows}, {plan.samples} samples per pixel: {time.perf_counter() - start:.0f} s")
    figures = depth.figures
    w, levels = figures["w_px"], figures["rms_error_of_picture"]
    print(f"w {w['true'][0]:.2f} to {w['true'][1]:.2f}: RMSE {w['rms_error']:.3f}, median {w['median_error']:.3f},")
    print(f"  the start's RMSE {w['rms_error_of_start']:.3f}; verdict {depth.outcome.verdict}")
    print(f"distance: {figures['distance_median_relative_error']:.1%} in the median")
    print(f"picture: {levels['restored'][0]:.2f} of 255; photographs {levels['photographs']}")


if __name__ == "__main__":
    main()
