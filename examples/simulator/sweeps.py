"""Sweeps: what a tracker that stands elsewhere reads while one joint after the other is turned.

Springs play no part: the arm carries no load. Units are SI; readings are in the tracker's frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from jointstiff.simulator.arm import FloatArray, Posture, SpringArm, default_arm

__all__ = ["HOME", "SWEEPS", "SWEEP_TARGETS", "TrackedArm", "WornArm", "imperfect_arm", "rotation_by"]

HOME = np.radians([10.0, -25.0, 20.0, 15.0, 40.0, -30.0])
"""Controller angles [rad] of the joints that are at rest."""

SWEEPS = np.radians([[-50, 50], [-35, 35], [-40, 40], [-80, 80], [-70, 70], [-150, 150]])
"""First and last controller angle of each joint's sweep [rad], (6, 2)."""

SWEEP_TARGETS = np.array([[0.10, 0.15, 0.0], [0.10, -0.10, 0.12], [0.12, -0.08, -0.13]])
"""Targets in the flange frame [m], (3, 3)."""


def rotation_by(axis: ArrayLike, angle: float) -> FloatArray:
    """Rotation (3, 3) about an axis of any length by an angle [rad], by Rodrigues."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: FloatArray = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
    return rotation


def imperfect_arm(seed: int, size: float = 1e-3) -> SpringArm:
    """The default arm as it might have been made: axes 2 to 6 are off.

    Args:
        seed: of the errors.
        size: about this much in each coordinate [m], and exactly this angle [rad].
    """
    nominal, rng = default_arm(), np.random.default_rng([seed, 77])
    points = nominal.axis_points + rng.normal(0.0, size, (6, 3))
    directions = np.stack([rotation_by(rng.normal(size=3), size) @ a for a in nominal.axis_directions])
    points[0], directions[0] = nominal.axis_points[0], nominal.axis_directions[0]
    return SpringArm(
        points, directions, nominal.flange_rotation, nominal.flange_translation, nominal.stiffnesses
    )


@dataclass(frozen=True, eq=False)
class TrackedArm:
    """An arm, a tracker, targets on the flange, and a controller that may count in its own way."""

    arm: SpringArm = field(default_factory=default_arm)  #: the arm; six axes
    #: (3, 3) from R0 to the tracker's frame
    rotation: FloatArray = field(default_factory=lambda: rotation_by([0.1, -0.05, 1.0], 2.1))
    #: (3,) origin of R0 in the tracker's frame [m]
    translation: FloatArray = field(default_factory=lambda: np.array([-2.4, 3.1, -0.35]))
    targets: FloatArray = field(default_factory=lambda: SWEEP_TARGETS)  #: (T, 3) in the flange frame [m]
    #: (6, 6) angles of the arm by those of the controller
    matrix: FloatArray = field(default_factory=lambda: np.eye(6))

    def readings(self, controller: FloatArray) -> FloatArray:
        """Exact readings (N, T, 3) [m] at controller angles (N, 6) [rad]."""
        in_base = self.arm.posture(controller @ self.matrix.T).targets_to_base(self.targets)
        readings: FloatArray = in_base @ self.rotation.T + self.translation
        return readings

    def sweep(self, joint: int, angles: ArrayLike, home: FloatArray = HOME) -> FloatArray:
        """Controller angles (K, 6) while one joint takes these angles (K,) and the others rest [rad]."""
        turned = np.asarray(angles, dtype=float)
        rows = np.tile(home, (len(turned), 1))
        rows[:, joint] = turned
        return rows

    def axis(self, joint: int, controller: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """A point on an axis [m] and its direction, tracker's frame, at controller angles (6,) [rad]."""
        posture = self.arm.posture(self.matrix @ np.asarray(controller, dtype=float))
        point: FloatArray = self.rotation @ posture.axis_points[joint] + self.translation
        direction: FloatArray = self.rotation @ posture.axis_directions[joint]
        return point, direction


@dataclass(frozen=True, eq=False)
class WornArm(TrackedArm):
    """A tracked arm whose gears do not turn evenly and that sags under its own weight.

    A joint stands at ``q + gear sin(turns q + phase)``. Every link weighs on the joints before it, which
    give way about all three directions, about their axes most.
    """

    #: (6,) amplitude of each joint's error [rad]
    gear: FloatArray = field(default_factory=lambda: np.zeros(6))
    #: (6,) its periods in one turn of the joint
    turns: FloatArray = field(default_factory=lambda: np.ones(6))
    phase: FloatArray = field(default_factory=lambda: np.zeros(6))  #: (6,) [rad]
    sag: float = 0.0  #: greatest change of a target's displacement by weight within the sweeps from HOME [m]

    @classmethod
    def random(cls, seed: int, *, gear: float, sag: float) -> WornArm:
        """An imperfect arm with gear errors of about this amplitude [rad] and this sag [m]."""
        rng = np.random.default_rng([seed, 78])
        return cls(
            imperfect_arm(seed),
            gear=gear * rng.uniform(0.5, 1.5, 6),
            turns=rng.integers(1, 60, 6).astype(float),
            phase=rng.uniform(0.0, 2.0 * np.pi, 6),
            sag=sag,
        )

    def readings(self, controller: FloatArray) -> FloatArray:
        """Readings (N, T, 3) [m] at controller angles (N, 6) [rad], without noise."""
        q = controller @ self.matrix.T
        q = q + self.gear * np.sin(self.turns * q + self.phase)
        posture = self.arm.posture(q)
        in_base = posture.targets_to_base(self.targets)
        in_base = in_base + self._compliance * _give(posture, in_base)
        readings: FloatArray = in_base @ self.rotation.T + self.translation
        return readings

    @cached_property
    def _compliance(self) -> float:
        """Scale of `_give` at which the sag is the one stated."""
        most = 0.0
        for joint, (first, last) in enumerate(SWEEPS.tolist()):
            posture = self.arm.posture(self.sweep(joint, np.linspace(first, last, 21)) @ self.matrix.T)
            given = _give(posture, posture.targets_to_base(self.targets))
            most = max(most, float(np.linalg.norm(given[:, None] - given[None], axis=-1).max()))
        return self.sag / most


_MASSES = np.array([300.0, 250.0, 150.0, 80.0, 40.0, 20.0])
_ABOUT_AXIS = np.array([1.0, 1.2, 1.5, 6.0, 8.0, 10.0])
"""Relative compliance of each joint about its axis; across it a third of that."""


def _give(posture: Posture, places: FloatArray) -> FloatArray:
    """Displacement of places (..., T, 3) as the joints give way to the links' weights, not to scale."""
    points, axes = posture.axis_points, posture.axis_directions
    ends = np.concatenate([points[..., 1:, :], posture.flange_translation[..., None, :]], axis=-2)
    centres = 0.5 * (points + ends)
    moved = np.zeros_like(places)
    for j, compliance in enumerate(_ABOUT_AXIS):
        arms = centres[..., j:, :] - points[..., j, None, :]
        weights = _MASSES[j:, None] * np.array([0.0, 0.0, -1.0])
        moment = np.cross(arms, weights).sum(axis=-2)
        along = np.sum(moment * axes[..., j, :], axis=-1, keepdims=True) * axes[..., j, :]
        turn = compliance * (along + (moment - along) / 3.0)
        moved = moved + np.cross(turn[..., None, :], places - points[..., j, None, :])
    return moved
