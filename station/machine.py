"""What computed a result: versions of the program and of the packages, interpreter, system, processor."""

from __future__ import annotations

import os
import platform
from typing import Any

from station.results import software


def machine() -> dict[str, Any]:
    """Everything that may change the last bits of a result."""
    return {
        "software": software(),
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "blas_threads": os.environ.get("OPENBLAS_NUM_THREADS", ""),
    }
