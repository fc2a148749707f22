"""What computed a result: versions of the program and of the packages, interpreter, system, processor."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from functools import cache
from typing import Any

from station.results import software


@cache
def machine() -> Mapping[str, Any]:
    """Everything that may change the last bits of a result; the same as long as the program runs."""
    return {
        "software": software(),
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "blas_threads": os.environ.get("OPENBLAS_NUM_THREADS", ""),
    }
