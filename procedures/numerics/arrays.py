"""Types of arrays, by their numbers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]
Complex = npt.NDArray[np.complex128]
Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
