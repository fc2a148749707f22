from __future__ import annotations

import os
from pathlib import Path

# as the program does for itself, before numpy is loaded: see station.__main__
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20120323)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of photographs and known truths that is kept beside the project."""
    folder = Path(os.environ.get("STATION_SHARED_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no shared data at {folder}; set STATION_SHARED_DATA to its folder")
    return folder
