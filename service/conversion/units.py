"""SI units in the units that messages may have."""

from __future__ import annotations

from typing import Final

import numpy as np

__all__ = ["ANGLE", "LENGTH"]

LENGTH: Final[dict[str, float]] = {"m": 1.0, "mm": 1e-3}
ANGLE: Final[dict[str, float]] = {"rad": 1.0, "deg": np.pi / 180.0}
