"""Ray histogram fusion on the Cornell box: quality, time and memory against the published program and NL-means.

python -m tests.benchmarks.ray_histograms [quality] [speed] [memory]; the data folder is $STATION_SHARED_DATA/rays.
"""

import os
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import replace

import numba
import numpy as np
import numpy.typing as npt

from procedures import filter_film, read_film
from procedures.ray_histogram.comparison import psnr_db
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_noise import mean_variance
from procedures.ray_histogram.filter import PAPER, FilterParameters
from procedures.reading.arrays import read_npz
from tests.benchmarks import ROOT, SHARED

Doubles = npt.NDArray[np.float64]

DATA = SHARED / "rays"
PUBLISHED_DB = {  # (samples, kappa, scales): clipped, unclipped; from the data's README
    (256, 1.0, 1): (45.37, 39.59), (256, 1.0, 2): (45.55, 41.60), (256, 1.0, 3): (46.35, 42.18),
    (256, 0.8, 2): (45.78, 42.19), (256, 0.8, 3): (46.15, 42.57), (64, 1.0, 2): (41.36, 37.49),
    (64, 1.0, 3): (42.39, 38.37), (64, 0.8, 2): (41.97, 38.19), (64, 0.8, 3): (42.79, 38.96),
}  # fmt: skip
PUBLISHED_S = {(1, 2): 16.4, (1, 3): 16.9, (2, 3): 8.2}
"""(threads, scales) to seconds, whole process; for two threads the README does not say the scales."""
RUNS = 15


def nl_means(film: Film, k: float = 0.7, search: int = 6, patch: int = 1) -> Doubles:
    """NL-means that knows the variance of each pixel's mean: patch distances less what noise explains.

    The variances are the film's, or read off the histograms' nodes where it has none. Weights exp(-max(0, d)) with
    d = mean of ((u - v)^2 - (a + min(a, b))) / (k^2 (a + b)), a and b the variances (Rousselle, Knaus, Zwicker 2012).
    """
    error = np.maximum(mean_variance(film), 1e-8 / film.count[..., None])
    reach = search + patch
    u, e = (np.pad(a, ((reach, reach), (reach, reach), (0, 0)), "reflect") for a in (film.mean, error))
    rows, columns = film.count.shape
    wide = np.s_[search : search + rows + 2 * patch, search : search + columns + 2 * patch]
    total, weights = np.zeros((rows, columns, 3)), np.zeros((rows, columns, 1))
    for y in range(-search, search + 1):
        for x in range(-search, search + 1):
            moved = np.s_[search + y : search + y + rows + 2 * patch, search + x : search + x + columns + 2 * patch]
            both = e[wide] + e[moved]
            excess = (u[wide] - u[moved]) ** 2 - (e[wide] + np.minimum(e[wide], e[moved]))
            d = (excess / (k**2 * both)).mean(-1)
            windows = np.lib.stride_tricks.sliding_window_view(d, (2 * patch + 1,) * 2)
            weight = np.exp(-np.maximum(windows.mean((-2, -1)), 0.0))[..., None]
            total += weight * u[moved][patch : patch + rows, patch : patch + columns]
            weights += weight
    return total / weights


def film_of(samples: int) -> Film:
    """The Cornell box at 64 or 256 samples per pixel."""
    return read_film(DATA / f"cornell_{samples:05d}_f16.npz").checked()


def quality() -> None:
    """PSNR in dB, clipped / unclipped, for 64 and 256 samples, 1 to 4 scales."""
    arrays, _ = read_npz(DATA / "cornell_reference.npz", ("reference",))
    reference = arrays["reference"].astype(np.float64)
    show = "{:5.2f} / {:5.2f}".format
    print(f"{'':32s}{'published':>16s}{'as the paper says':>19s}{'defaults':>16s}")
    for samples in (64, 256):
        film = film_of(samples)
        print(f"{samples:3d} samples, input{show(*psnr_db(film.mean, reference)):>31s}")
        print(f"{samples:3d} samples, NL-means, known variance {show(*psnr_db(nl_means(film), reference))}")
        for kappa in (1.0, 0.8):
            for scales in (1, 2, 3, 4):
                published = PUBLISHED_DB.get((samples, kappa, scales))
                line = f"{samples:3d} samples, kappa {kappa}, {scales} scales   "
                line += f"{show(*published) if published else '-':>16s}"
                for base in (PAPER, FilterParameters()):
                    found = filter_film(film, replace(base, kappa=kappa, scales=scales), threads=os.cpu_count() or 1)
                    line += f"{show(*psnr_db(found.picture, reference)):>18s}"
                print(line)


def speed() -> None:
    """Best of n: the filter alone, and the whole `station rays`, against the published program's whole process."""
    film = film_of(256)
    best: dict[tuple[int, int], tuple[float, float]] = {}
    filter_film(film, threads=2)  # builds the kernels
    for _ in range(RUNS):
        for threads, scales in PUBLISHED_S:
            start, busy = time.perf_counter(), time.process_time()
            filter_film(film, FilterParameters(scales=scales), threads=threads)
            times = time.perf_counter() - start, time.process_time() - busy
            best[threads, scales] = min(best.get((threads, scales), times), times)
    for (threads, scales), (wall, cpu) in best.items():
        published = PUBLISHED_S[threads, scales]
        print(
            f"filter, {threads} thread(s), {scales} scales: {wall:.3f} s ({cpu:.3f} s of processor);"
            f" the published program took {published} s: {published / wall:.1f} x"
        )
    print(f"two threads against one, 3 scales: {best[1, 3][0] / best[2, 3][0]:.2f} x")
    command = [sys.executable, "-m", "station", "rays", str(DATA / "cornell_00256_f16.npz"), "--threads", "1"]
    whole = []
    for _ in range(RUNS):
        start, busy = time.perf_counter(), os.times().children_user + os.times().children_system
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([*command, "--out", folder], cwd=ROOT, check=True, capture_output=True)
        cpu = os.times().children_user + os.times().children_system - busy
        whole.append((time.perf_counter() - start, cpu))
    wall, cpu = min(whole)
    print(f"whole station rays, 1 thread: {wall:.2f} s ({cpu:.2f} s of processor), {PUBLISHED_S[1, 3] / wall:.1f} x")


def memory() -> None:
    """Peak memory of a process that filters, over pixels and over samples per pixel."""
    code = (
        "import sys, resource; import numpy as np\n"
        "from procedures.ray_histogram.film import Film\n"
        "from procedures.ray_histogram.multiscale import filter_film\n"
        "side, n = map(int, sys.argv[1:]); film = Film.blank(side, side); rng = np.random.default_rng(1)\n"
        "rows = np.repeat(np.arange(side), side); columns = np.tile(np.arange(side), side)\n"
        "for _ in range(n): film.add(rows, columns, rng.random((side * side, 3)))\n"
        "filter_film(film)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)\n"
    )

    def peak_mib(side: int, n: int) -> float:
        words = [sys.executable, "-c", code, str(side), str(n)]
        return float(subprocess.run(words, cwd=ROOT, check=True, capture_output=True, text=True).stdout)

    base = peak_mib(48, 1)
    print(f"libraries and kernels: {base:.0f} MiB")
    for side, n in ((500, 4), (500, 64), (1000, 4), (1414, 4)):
        used = peak_mib(side, n) - base
        each = used / side**2 * 2**20
        print(f"{side:4d} x {side:4d} pixels, {n:2d} samples: {used:6.0f} MiB more, {each:.0f} bytes per pixel")


def main() -> None:
    """Print environment, then what was asked for."""
    print(
        f"Python {platform.python_version()}, NumPy {np.__version__}, Numba {numba.__version__}, {platform.machine()},"
        f" {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, best of {RUNS}"
    )
    chosen = sys.argv[1:] or ["quality", "speed", "memory"]
    for part in (quality, speed, memory):
        if part.__name__ in chosen:
            print(f"\n{part.__name__}")
            part()


if __name__ == "__main__":
    main()
