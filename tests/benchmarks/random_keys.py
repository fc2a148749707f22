"""Ten thousand random keys in each of twenty seeds over all screens: `python -m tests.benchmarks.random_keys`."""

import argparse
import tempfile
import time
from pathlib import Path

from tests.station.app.random_keys import press_at_random


def main() -> None:
    """Press them, and say what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="the first seed, where they are pressed in parts")
    parser.add_argument("--keys", type=int, default=10_000)
    given = parser.parse_args()
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
