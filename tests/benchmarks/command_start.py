"""Processor time of a whole command, imports included, beside that of `import numpy` alone.

    OMP_NUM_THREADS=1 python tests/benchmarks/command_start.py [RUNS]

The PSF of the published photograph with s and k given, as a person calls it; least of some runs (7), user and system
time of the process. The first run of all compiles kernels and modules, it is not counted; what is compiled of modules
is kept in a folder of its own, so that sources which nobody installed start as installed ones do. Needs
STATION_SHARED_DATA.
"""

from __future__ import annotations

import os
import platform
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]


def processor_s(words: list[str], runs: int, modules: str) -> float:
    """Least processor time of some runs of a command, seconds; `modules` is where compiled ones are kept."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = modules
    found = []
    for _ in range(runs):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *words], cwd=ROOT, env=environment, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(found)


def main() -> None:
    """Measure and print."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    data = Path(os.environ["STATION_SHARED_DATA"]) / "pattern_photo"
    with tempfile.TemporaryDirectory() as out, tempfile.TemporaryDirectory() as modules:
        command = ["-m", "station", "psf", "pattern", str(data / "img_example.pgm")]
        command += ["--bits", str(data / "pattern_noise.pgm"), "-s", "4", "-k", "17", "--out", out]
        processor_s(command, 1, modules)
        measured = {
            "import numpy": ["-c", "import numpy"],
            "import station.calibration.planes": ["-c", "import station.calibration.planes"],
            "station psf pattern": command,
        }
        times = {name: processor_s(words, runs, modules) for name, words in measured.items()}
    print(
        f"Python {platform.python_version()}, {platform.machine()}, least of {runs} runs, {os.getloadavg()[0]:.1f} load"
    )
    print("                           processor s   over import numpy")
    for name, seconds in times.items():
        print(f"{name:26s} {seconds:11.3f} {seconds / times['import numpy']:15.1f}")


if __name__ == "__main__":
    main()
