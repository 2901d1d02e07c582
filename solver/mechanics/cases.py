"""Load cases: postures, loads and load points, and the places whose deflection is predicted."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import RequestError


@dataclass(frozen=True, eq=False)
class LoadCases:
    """B load cases: postures, loads and load points, and the places whose deflection is predicted.

    Force and moment keep their size and direction in R0, while the load point moves with the flange. Arrays
    are made read-only.

    Raises:
        RequestError: shapes disagree, a number is not finite, or there is no case.
    """

    joints: FloatArray  #: (B, n) controller's joint angles without the load [rad]
    force: FloatArray  #: (B, 3) force on the robot, axes of R0 [N]
    moment: FloatArray  #: (B, 3) moment on the robot about the load point, axes of R0 [N·m]
    load_point: FloatArray  #: (B, 3) point on which the force acts, flange frame [m]
    place: FloatArray  #: (B, 3) point whose deflection is predicted, flange frame [m]

    def __post_init__(self) -> None:
        count = len(self.joints)
        for each in fields(self):
            array: FloatArray = getattr(self, each.name)
            width = array.shape[-1] if each.name == "joints" else 3  # any number of joints, else x, y, z
            if count == 0 or array.shape != (count, width) or not np.isfinite(array).all():
                raise RequestError(
                    f"{each.name} needs finite numbers of shape {(count, width)}, but has shape "
                    f"{array.shape}",
                    where=f"cases.{each.name}",
                    remedy="give at least one case, with the same fields for each case",
                )
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.joints)

    def __getitem__(self, index: IndexArray | slice) -> LoadCases:
        """Return the selected cases, in the given order."""
        return LoadCases(*(array[index].copy() for array in vars(self).values()))
