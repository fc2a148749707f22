"""Scripts that print figures of speed and accuracy: `python -m tests.benchmarks.NAME` in a copy of the sources."""

import os
from pathlib import Path

# as the program does for itself, before numpy is loaded; and a process with threads cannot be forked safely
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("STATION_SHARED_DATA", ROOT.parent / "shared" / "data"))
"""Photographs and known truths that are kept beside the project."""
