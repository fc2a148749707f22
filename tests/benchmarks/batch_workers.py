"""Throughput of `station batch` over its workers on this machine, and what a photograph costs besides its own work.

    python -m tests.benchmarks.batch_workers [--photographs 120] [--work-s 0.25] [--workers 1,2]

Every photograph is a fixed amount of arithmetic, `--work-s` seconds of processor time as measured here, so that all
else is overhead: processes, messages, hashes, files and the summary. The processor time is that of all processes; the
time on the clock depends on what else the machine does.
"""

import os
import platform
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from distributed import LocalCluster

from station.batch.item import ItemRow, Job
from station.batch.procedure_file import read_procedure
from station.batch.run import run_batch
from station.calibration.folder_photographs import Item, singly
from tests.benchmarks import options, processor_s

WORK_S = "STATION_BENCHMARK_WORK_S"


def spend(item: Item, job: Job) -> ItemRow:
    """Read the photograph, then compute for so much processor time."""
    end_s = time.process_time() + float(os.environ[WORK_S])
    data = item.paths[0].read_bytes()
    while time.process_time() < end_s:
        sum(range(2000))
    return ItemRow(item.files, "pass", sha256=(f"{len(data):064x}",))


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    """The address of a cluster on this machine."""
    with LocalCluster(workers, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50) as running:
        yield running.scheduler_address


def measure(folder: Path, engine: str, workers: int, count: int) -> tuple[float, float]:
    """Seconds on the clock and of the processor of one batch."""
    out = folder / f"{engine}-{workers}-{count}"
    job = Job(read_procedure(folder / "p.toml"), out)
    items = singly(sorted((folder / "in").iterdir())[:count])
    start_s, before_s = time.monotonic(), processor_s()
    with cluster(workers) if engine == "dask" else nullcontext() as address:
        batch, _ = run_batch(items, job, jobs=workers, cluster=address, function=spend)
    assert batch.counts == {"pass": count}
    return time.monotonic() - start_s, processor_s() - before_s


def main() -> None:
    """Print a line for every engine and number of workers."""
    given = options(__doc__, photographs=120, work_s=0.25, workers="1,2")
    os.environ[WORK_S] = str(given.work_s)
    print(f"Python {platform.python_version()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print(f"{'engine':>8} {'workers':>8} {'per minute':>11} {'processor s':>12} {'overhead ms':>12} {'start s':>8}")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "in").mkdir()
        (folder / "p.toml").write_text('procedure = "pattern"\n')
        for n in range(given.photographs):
            (folder / "in" / f"{n:05d}.pgm").write_bytes(b"P5 200 150 65535\n" + n.to_bytes(2, "big") * 30_000)
        for engine in ("pool", "dask"):
            for workers in map(int, given.workers.split(",")):
                _, start_s = measure(folder, engine, workers, workers)  # one for each: what starting costs
                took_s, spent_s = measure(folder, engine, workers, given.photographs)
                more = given.photographs - workers
                overhead_ms = 1000 * ((spent_s - start_s) / more - given.work_s)
                rate = 60 * given.photographs / took_s
                print(f"{engine:>8} {workers:8} {rate:11.1f} {spent_s:12.1f} {overhead_ms:12.1f} "
                      f"{start_s - workers * given.work_s:8.2f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
