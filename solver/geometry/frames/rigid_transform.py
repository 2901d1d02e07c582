"""A rigid transform between two frames, with the covariance of its six numbers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.robot.configuration import skew

ROTATION_TOLERANCE = 1e-5
"""Tolerance of a stated rotation's orthonormality: 10 µm in a metre."""


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """``y = R x + t``: coordinates x in one frame become y in the other. Arrays are read-only.

    It is uncertain by a small motion in the frame of y: ``y = (I + [φ]×)(R x + t) + δ``.
    """

    rotation: FloatArray  #: (3, 3) R
    translation: FloatArray  #: (3,) t [m]
    #: (6, 6) covariance of (δ, φ) [m, rad]; zero for a transform that is exact by definition
    covariance: FloatArray = field(default_factory=lambda: np.zeros((6, 6)))

    def __post_init__(self) -> None:
        for array in (self.rotation, self.translation, self.covariance):
            array.setflags(write=False)

    @classmethod
    def identity(cls) -> RigidTransform:
        """The exact transform that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def stated(cls, rotation: FloatArray, translation: FloatArray) -> RigidTransform:
        """Return a transform whose rotation (3, 3) is stated to some digits, made exact.

        Raises:
            MeasurementError: the matrix is not a rotation.
        """
        gap = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if not gap <= ROTATION_TOLERANCE or np.linalg.det(rotation) < 0.0:
            what = (
                "it is a reflection (determinant -1)"
                if gap <= ROTATION_TOLERANCE
                else f"its largest deviation is {gap:.2g}"
            )
            raise MeasurementError(
                f"the rotation matrix is not orthonormal: {what}",
                where="frame.rotation",
                remedy="give the rotation matrix from the tracker's frame to R0 row by row, with "
                "seven digits",
            )
        U, _, Vt = np.linalg.svd(rotation)
        return cls(U @ Vt, translation)

    def apply(self, points: FloatArray) -> FloatArray:
        """Transform points (..., 3) [m]."""
        return np.asarray(points @ self.rotation.T + self.translation)

    @staticmethod
    def sensitivity(moved: FloatArray) -> FloatArray:
        """Displacement (..., 3, 6) of transformed points y (..., 3) by (δ, φ)."""
        eye = np.broadcast_to(np.eye(3), (*moved.shape, 3))
        return np.concatenate([eye, -skew(moved)], axis=-1)

    def inverse(self) -> RigidTransform:
        """Return the transform from y to x; its uncertainty is a motion in the frame of x."""
        back = self.rotation.T
        translation = -back @ self.translation
        S = np.zeros((6, 6))
        S[:3, :3] = S[3:, 3:] = -back
        S[:3, 3:] = back @ skew(self.translation)
        return RigidTransform(back, translation, S @ self.covariance @ S.T)

    def after(self, first: RigidTransform) -> RigidTransform:
        """This transform after another one, the two uncertain independently of each other."""
        S = np.zeros((6, 6))
        S[:3, :3] = S[3:, 3:] = self.rotation
        S[:3, 3:] = skew(self.translation) @ self.rotation
        covariance = self.covariance + S @ first.covariance @ S.T
        return RigidTransform(self.rotation @ first.rotation, self.apply(first.translation), covariance)

    def chart(self, other: RigidTransform) -> FloatArray:
        """The motion (δ, φ) (6,) that makes this transform the other one."""
        turn = other.rotation @ self.rotation.T
        shift = other.translation - turn @ self.translation
        return np.concatenate([shift, Rotation.from_matrix(turn).as_rotvec()])

    def displaced(self, motion: FloatArray) -> RigidTransform:
        """The transform after a motion (δ, φ) (6,); inverse of `chart`. The covariance is kept."""
        turn = Rotation.from_rotvec(motion[3:]).as_matrix()
        return RigidTransform(turn @ self.rotation, turn @ self.translation + motion[:3], self.covariance)
