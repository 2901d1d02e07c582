"""Deflections of targets by springs in the joints, under forces that the columns of a file may be.

The deflection of a target is ``d = J_v(p) diag(c) J_v(p_W)ᵀ F`` (method.md §2) with compliances c ≥ 0 of any
size, so that no unit of the forces is needed: only their directions, and their sizes relative to each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import nnls

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.mechanics.postures import Postures

LARGEST_UNEXPLAINED: Final = 0.5
"""Largest part of the sum of squared deflections that forces leave if they explain the deflections."""
LEAST_MARGIN: Final = 8.0
"""Least difference of the logarithms of the likelihood by forces and by any others."""
_DIRECTIONS: Final = 200
"""Number of directions that are compared with −z."""
_NEAR: Final = float(np.cos(np.radians(30.0)))
"""Cosine of the angle of directions too near to −z to be compared."""
_LEAST_NUMBERS: Final = 18
"""Least number of coordinates of deflections, three for each of six compliances."""


@dataclass(frozen=True, eq=False)
class DeflectedTargets:
    """Deflections of targets in postures, and the motions by which springs in the joints explain them."""

    of_targets: FloatArray  #: (M, 3, n) Jacobians of the targets
    of_load: FloatArray  #: (M, 3, n) Jacobians of the load point
    deflections: FloatArray  #: (M, 3) in axes of R0 [m]
    indices: IndexArray  #: (M, 2) of posture and reading

    @classmethod
    def of(
        cls, postures: Postures, load_point: FloatArray, places: FloatArray, deflections: FloatArray
    ) -> DeflectedTargets:
        """Compute the Jacobians of N postures.

        Args:
            postures: N postures.
            load_point: (3,) in the flange frame [m].
            places: (N, K, 3) targets of K readings in R0 [m].
            deflections: (N, K, 3) of these targets [m]; NaN where no position is.
        """
        is_known = np.isfinite(deflections).all(axis=2)
        points = np.tile(load_point, (len(postures), 1, 1))
        of_load = np.broadcast_to(
            postures.jacobian_at(postures.to_base(points)), (*is_known.shape, 3, postures.q.shape[1])
        )
        of_targets = postures.jacobian_at(np.nan_to_num(places))
        return cls(of_targets[is_known], of_load[is_known], deflections[is_known], np.argwhere(is_known))

    @property
    def are_enough(self) -> bool:
        """Return whether there are enough deflections to distinguish forces."""
        return self.deflections.size >= _LEAST_NUMBERS and bool(self.deflections.any())

    def measure_unexplained(self, forces: FloatArray) -> float:
        """Return the part of the sum of squared deflections that forces (N, K, 3) in any unit leave."""
        own = forces[self.indices[:, 0], self.indices[:, 1]]
        size = np.abs(own).max(initial=0.0)
        if not np.isfinite(size) or size == 0.0:
            return 1.0
        torques = np.einsum("mij,mi->mj", self.of_load, own / size)
        regressor = (self.of_targets * torques[:, None, :]).reshape(-1, torques.shape[1])
        length = float(np.linalg.norm(self.deflections))
        _, left = nnls(regressor, self.deflections.ravel() / length)
        return float(left) ** 2

    def measure_margin(self, unexplained: float, by_others: float) -> float:
        """Return the difference of the logarithms of the likelihood of deflections by two kinds of forces.

        Both leave a part of the sum of squares; the size of the errors is that which fits best to each.
        """
        least = 1e-12
        return 0.5 * self.deflections.size * float(np.log((by_others + least) / (unexplained + least)))

    def are_down(self, sizes: FloatArray) -> bool:
        """Return whether forces of sizes (N, K) act along −z of R0, and along no other fixed direction."""
        if not self.are_enough:
            return False
        down = np.array([0.0, 0.0, -1.0])
        unexplained = self.measure_unexplained(sizes[..., None] * down)
        if unexplained > LARGEST_UNEXPLAINED:
            return False
        for other in _list_directions():
            by_other = self.measure_unexplained(sizes[..., None] * other)
            is_near = other @ down >= _NEAR
            if not is_near and self.measure_margin(unexplained, by_other) < LEAST_MARGIN:
                return False
        return True


def _list_directions() -> FloatArray:
    """Return unit vectors (m, 3) that cover the sphere evenly, along a spiral."""
    number = np.arange(_DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * number / _DIRECTIONS
    angle = np.pi * (1.0 + np.sqrt(5.0)) * number
    radius = np.sqrt(1.0 - z**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
