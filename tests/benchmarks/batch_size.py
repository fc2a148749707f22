"""Memory, processor time and size of a batch's files over its number of photographs, with made-up rows.

    python -m tests.benchmarks.batch_size [ROWS ..., default 1000 10000 100000]

Each size runs in a process of its own: rows of two planes with eight numbers each go through the writer of `station
batch` into results.jsonl, then the summary as CSV and Parquet, the page and the record are written. The memory is the
greatest of the process, less what it had before the first row.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from procedures.numbers import NUMBERS
from station.batch.item import ItemRow, Job, PlaneRow
from station.batch.procedure_file import read_procedure
from station.batch.run import Batch, _write
from station.batch.stored_rows import StoredRows
from tests.benchmarks import options

NAMES = [name for name in NUMBERS if name.startswith("mtf")][:8]
FILES = ("results.jsonl", "summary.csv", "summary.parquet", "report.html", "result.json")


def made_up(n: int, rng: np.random.Generator) -> ItemRow:
    """The row of a photograph that was never taken."""
    planes = {
        plane: PlaneRow("pass", "", "", {
            name: {"value": value, "uncertainty": 0.002, "unit": "cycles/pixel", "method": "made up", "n": 1}
            for name, value in zip(NAMES, rng.normal(0.3, 0.02, len(NAMES)).tolist(), strict=True)
        })
        for plane in ("G1", "G2")
    }  # fmt: skip
    noted = {"camera": f"camera {n % 3}", "f_number": 4.0, "iso": 100.0, "exposure_s": 0.02}
    digest, folder = f"{n:064x}", f"results/IMG_{n:06d}-{n:016x}"
    return ItemRow((f"/shoot/{n // 1000:03d}/IMG_{n:06d}.DNG",), "pass" if n % 50 else "refused",
                   "" if n % 50 else "the chart was not found", sha256=(digest,), folder=folder,
                   planes=planes if n % 50 else {}, duration_s=1.0, noted=noted)  # fmt: skip


def peak_mb() -> float:
    """Greatest resident memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measure(count: int) -> dict[str, float]:
    """One size in this process."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as place:
        out = Path(place)
        (out / "p.toml").write_text('procedure = "pattern"\nplanes = ["G1"]\n')
        job = Job(read_procedure(out / "p.toml"), out)
        warm = out / "warm"
        warm.mkdir()
        _run(Job(job.procedure, warm), 10, rng)  # imports, fonts
        before_mb, start_s = peak_mb(), time.process_time()
        added_s = _run(job, count, rng)
        sizes = {name: (out / name).stat().st_size / 1e6 for name in FILES}
        return {"rows": count, "memory_mb": peak_mb() - before_mb, "rows_s": added_s,
                "files_s": time.process_time() - start_s - added_s, **sizes}  # fmt: skip


def _run(job: Job, count: int, rng: np.random.Generator) -> float:
    start_s, rows = time.process_time(), StoredRows(job.out / "results.jsonl")
    for n in range(count):
        rows.add(n, made_up(n, rng))
    added_s = time.process_time() - start_s
    _write(Batch(job, rows, 0, 0.0), rows, parquet=True)
    rows.close()
    return added_s


def main() -> None:
    """Measure each size in a new process; print a table."""
    given = options(__doc__, "rows", rows=[1000, 10_000, 100_000], here=False)
    if given.here:
        print(json.dumps(measure(given.rows[0])))
        return
    head = ("rows", "memory MB", "rows s", "files s", *FILES)
    print("  ".join(f"{one:>15}" for one in head))
    for count in given.rows:
        command = [sys.executable, "-m", "tests.benchmarks.batch_size", str(count), "--here"]
        done = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ})
        print("  ".join(f"{value:15.4g}" for value in json.loads(done.stdout).values()), flush=True)


if __name__ == "__main__":
    main()
