"""Forces in other axes than R0: the axes of the tracker, or exchanged and reversed ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Final

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.block import get_whole_block
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot

_TURNS: Final = 24
"""Number of turns about the vertical axis that are tried: trackers stand upright."""
_SAME_AXES: Final = 0.03
"""Largest difference of a turn from exchanged axes [rad]."""
_MOST_OBSERVATIONS: Final = 60
"""Number of observations that suffice to find the axes of the forces."""
_FIRST_TURN: Final = 0.1
"""First turns [rad] from the best of the tried axes."""
_TOLERANCE: Final = 1e-3
"""Tolerance of the turn [rad] that is searched from the best of the tried ones."""


@dataclass(frozen=True, eq=False)
class _ForcesAlongAxes:
    """Regressors of deflections, for each component of the forces and each axis along which it may act."""

    A: FloatArray  #: (3, 3, m, n) by axis and component
    d: FloatArray  #: (m,) deflections [m]

    @classmethod
    def of(cls, robot: Robot, measurements: Measurements) -> _ForcesAlongAxes:
        """Compute the regressors of N observations, each with one component of forces and moments alone."""
        count = len(measurements)
        sample = measurements[np.unique(np.linspace(0, count - 1, _MOST_OBSERVATIONS).round().astype(int))]
        A = []
        for axis in range(3):
            for component in range(3):
                taken = np.outer(np.eye(3)[axis], np.eye(3)[component])
                A.append(get_whole_block(robot, turn_forces(sample, taken)).A)
        shape = (3, 3, -1, robot.n)
        return cls(np.array(A).reshape(shape), sample.deflection.ravel())

    def measure_residual(self, axes: FloatArray) -> float:
        """Return the sum of squares [m²] that joint compliances leave, with forces R F in axes R (3, 3)."""
        regressor = np.einsum("ij,ijmn->mn", axes, self.A)
        compliance = np.linalg.lstsq(regressor, self.d, rcond=None)[0]
        residual = self.d - regressor @ compliance
        return float(residual @ residual)


def turn_forces(measurements: Measurements, axes: FloatArray) -> Measurements:
    """Return measurements with forces and moments ``R F`` in other axes R (3, 3)."""
    return replace(measurements, force=measurements.force @ axes.T, moment=measurements.moment @ axes.T)


def find_axes_of_forces(robot: Robot, measurements: Measurements) -> FloatArray:
    """Return the axes R (3, 3) in which forces ``R F`` explain the deflections best.

    The axes are a turn, or exchanged and reversed axes.

    Args:
        robot: n joints.
        measurements: N observations with forces.
    """
    forces = _ForcesAlongAxes.of(robot, measurements)
    best = min(_list_axes(), key=forces.measure_residual)
    if np.linalg.det(best) < 0.0:
        return best

    def measure_turned(turn: FloatArray) -> float:
        """Return the residual [m] with the best axes turned by a vector (3,) [rad]."""
        return float(np.sqrt(forces.measure_residual(pin.exp3(turn) @ best)))

    first_turns = _FIRST_TURN * np.vstack([np.zeros(3), np.eye(3)])
    found = minimize(
        measure_turned,
        np.zeros(3),
        method="Nelder-Mead",
        options={"xatol": _TOLERANCE, "initial_simplex": first_turns},
    )
    return np.asarray(pin.exp3(found.x) @ best)


def _list_axes() -> Iterator[FloatArray]:
    """Yield turns about the vertical axis, then exchanged and reversed axes, but no reversal of all axes."""
    for angle in np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False):
        yield pin.exp3(np.array([0.0, 0.0, angle]))
    for order in permutations(range(3)):
        for signs in np.ndindex(2, 2, 2):
            axes = (1.0 - 2.0 * np.array(signs))[:, None] * np.eye(3)[list(order)]
            if not np.array_equal(axes, -np.eye(3)):
                yield axes


def describe_axes(axes: FloatArray) -> str:
    """Return the axes of forces in words: exchanged axes such as `y, x, z`, or the angle of their turn."""
    nearest = np.round(axes)
    if np.abs(axes - nearest).max() < _SAME_AXES:
        columns = np.abs(nearest).argmax(axis=1).tolist()
        signs = nearest[np.arange(3), columns]
        pairs = zip(signs, columns, strict=True)
        names = ", ".join(("−" if sign < 0.0 else "") + "xyz"[column] for sign, column in pairs)
        return f"with {names} of the forces as x, y, z"
    turn = pin.log3(axes)
    angle = float(np.degrees(np.linalg.norm(turn)))
    direction = ", ".join(f"{part:.2f}" for part in turn / np.linalg.norm(turn))
    return f"with all forces turned by {angle:.3g}° about ({direction})"


def measure_turn(axes: FloatArray) -> float:
    """Return the angle [rad] by which axes are turned; π for axes of the other hand."""
    return float(np.linalg.norm(pin.log3(axes))) if np.linalg.det(axes) > 0.0 else np.pi
