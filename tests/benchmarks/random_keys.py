"""Ten thousand random keys in each of twenty seeds over all screens: `python -m tests.benchmarks.random_keys`."""

import tempfile
import time
from pathlib import Path

from tests.benchmarks import options
from tests.station.app.random_keys import press_at_random


def main() -> None:
    """Press them, and say what came of it."""
    given = options(__doc__, seeds=20, first=0, keys=10_000)
    for seed in range(given.first, given.first + given.seeds):
        begin_s = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            seen = press_at_random(Path(folder), seed, given.keys)
        took_s = time.perf_counter() - begin_s
        print(
            f"seed {seed}: {given.keys} keys, {seen.runs} runs, {seen.moves} moves, {took_s:.0f} s",
            *seen.wrong,
            flush=True,
        )
        if seen.wrong:
            raise SystemExit(1)


if __name__ == "__main__":
    main()
