"""What computes a result: versions, processor, and the libraries of linear algebra, whose last bits depend on both.

A product of matrices is summed in another order by every number of threads and every family of processors. With one
thread the order is that of the processor's kernels alone; those are told, so that two results can be compared.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any

from station.common.versions import software

KERNELS = "OPENBLAS_CORETYPE"
"""Environment variable by which OpenBLAS computes as another family of processors would."""


@cache
def machine() -> Mapping[str, Any]:
    """Everything that may change the last bits of a result; the same as long as the program runs."""
    import numpy as np

    return {
        "software": software(),
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "simd": " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])),
        "blas": _libraries(),
    }


def _libraries() -> str:
    """The BLAS of numpy and scipy: "openblas 0.3.30 SkylakeX". OpenCV brings its own, which draws pictures only."""
    import scipy.linalg  # noqa: F401  (what is not loaded is not listed)
    from threadpoolctl import threadpool_info

    found = {
        f"{one['internal_api']} {one['version']} {one.get('architecture', '')}".strip()
        for one in threadpool_info()
        if one["user_api"] == "blas" and "opencv" not in one["filepath"]
    }
    return ", ".join(sorted(found))


@contextmanager
def same_bits() -> Iterator[None]:
    """Within, linear algebra has one thread, however many the environment asks for."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield
