"""Wall time of `station --help`, against a Python that does nothing."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time

RUNS = 20
BOUND_S = 0.3


def best_of(words: list[str], runs: int = RUNS) -> float:
    """Shortest wall time of the command, seconds."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        subprocess.run([sys.executable, *words], stdout=subprocess.DEVNULL, check=True)
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    """Print environment, best times and their ratio."""
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores, best of {RUNS}")
    nothing = best_of(["-c", "pass"])
    print(f"{'python -c pass':30s} {1000 * nothing:7.1f} ms")
    for words in (["--help"], ["psf", "--help"], ["psf", "pattern", "--help"]):
        seconds = best_of(["-m", "station", *words])
        ratio = f"{seconds / nothing:5.2f} x   bound {BOUND_S} s"
        print(f"{'station ' + ' '.join(words):30s} {1000 * seconds:7.1f} ms   {ratio}")


if __name__ == "__main__":
    main()
