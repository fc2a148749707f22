from __future__ import annotations

import numpy as np
import pytest

from procedures.numerics import compiled as procedures_compiled
from simulators.world import compiled as simulators_compiled

DECORATORS = {
    "compiled": procedures_compiled.compiled,
    "vectorised": procedures_compiled.vectorised,
    "simulators": simulators_compiled.compiled,
}


@pytest.mark.parametrize("name", DECORATORS)
def test_kernels_work_where_nothing_can_be_kept(name):
    # a function without a source file cannot be kept on disk, as in a checkout and a home that cannot be written
    namespace = {}
    exec("def halves(x):\n    return x / 2.0", namespace)
    kernel = DECORATORS[name](namespace["halves"])
    assert kernel(3.0) == 1.5


def test_strict_kernels_keep_nan():
    @procedures_compiled.compiled
    def finite(x):
        return np.isfinite(x)

    assert not finite(np.nan)
    assert not finite(np.inf)
    assert finite(1.0)
