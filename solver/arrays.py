"""Types of arrays. A comment or docstring beside each use gives shape, unit and frame."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
IndexArray: TypeAlias = npt.NDArray[np.intp]
Support: TypeAlias = npt.NDArray[np.int8]
"""-1 where a lower bound holds a parameter, 1 where an upper bound does, 0 where it is free."""
