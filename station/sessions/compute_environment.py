"""The computing environment of a result: versions, processor, and BLAS libraries, all of which affect the last bits.

The order of summation in a matrix product depends on the number of threads and the processor family. With one
thread it depends on the processor's kernels only; these are recorded, so that two results can be compared.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any

from procedures.numerics.loops import COMPILER
from station.common.versions import software

KERNELS = "OPENBLAS_CORETYPE"
"""Environment variable that makes OpenBLAS compute like another processor family."""


@cache
def machine() -> Mapping[str, Any]:
    """Everything that may change the last bits of a result; constant during a run of the program."""
    import numpy as np

    return {
        "software": software(),
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "simd": " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])),
        "blas": _libraries(),
        "loops": COMPILER,
    }


def _libraries() -> str:
    """The BLAS of numpy and scipy: "openblas 0.3.30 SkylakeX". OpenCV's own is ignored, as it only draws pictures."""
    import scipy.linalg  # noqa: F401  (only loaded libraries are listed)
    from threadpoolctl import threadpool_info

    libraries = {
        f"{info['internal_api']} {info['version']} {info.get('architecture', '')}".strip()
        for info in threadpool_info()
        if info["user_api"] == "blas" and "opencv" not in info["filepath"]
    }
    return ", ".join(sorted(libraries))


@contextmanager
def same_bits() -> Iterator[None]:
    """Context in which linear algebra has one thread, whatever the environment sets."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield
