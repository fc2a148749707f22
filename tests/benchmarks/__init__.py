"""Scripts that print figures of speed and accuracy: `python -m tests.benchmarks.NAME` in a copy of the sources."""

import argparse
import os
from pathlib import Path
from typing import Any

# as the program does for itself, before numpy is loaded; and a process with threads cannot be forked safely
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("STATION_SHARED_DATA", ROOT.parent / "shared" / "data"))
"""Photographs and known truths that are kept beside the project."""


def processor_s() -> float:
    """Processor time of this process and of the children that have ended."""
    return sum(os.times()[:4])


def options(about: str | None, *words: str, **defaults: Any) -> argparse.Namespace:
    """What the command line states of these options, each of its default's type; `words` come without their names.

    A default of None is a path that may be given, a type a word that must be, a list any number of its first entry's
    type.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in defaults.items():
        flag = name if name in words else f"--{name.replace('_', '-')}"
        if default is False:
            parser.add_argument(flag, action="store_true")
        elif isinstance(default, type):
            parser.add_argument(flag, type=default)
        else:
            first = (*default, "")[0] if isinstance(default, list) else default
            kind = Path if default is None else type(first)
            many = "*" if isinstance(default, list) else "?" if name in words else None
            parser.add_argument(flag, type=kind, nargs=many, default=default)
    return parser.parse_args()
