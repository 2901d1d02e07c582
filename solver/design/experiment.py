"""Equipment of a campaign, and the rows of the readings that could be taken with it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.readings.measurements import Measurements, shown_along
from jointstiff.solver.readings.tracker_noise import DifferenceNoise, Instrument
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import regressor_blocks
from jointstiff.solver.terms.joints import JOINTS
from jointstiff.solver.terms.links import links_behind
from jointstiff.solver.terms.term import whitened_rows as term_rows
from jointstiff.solver.triangle import whitened

LoadKind = Literal["dead_weight", "any_direction", "cable"]

_LARGEST_ANGLE: Final = np.pi
"""Range of a joint without limits [rad]."""
_ROUNDING: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Loads:
    """Forces that can be applied."""

    kind: LoadKind  #: a weight pulls along −z of R0, a cable towards one of the anchors, or in any direction
    force: float  #: magnitude [N]; for any direction the greatest
    torque_limit: FloatArray  #: (n,) greatest torque of the load about each joint [N·m]; inf for none
    anchors: FloatArray = field(default_factory=lambda: np.empty((0, 3)))  #: (A, 3) of the cable, in R0 [m]

    @property
    def choices(self) -> int:
        """Return how many loads there are for a posture."""
        return len(self.anchors) if self.kind == "cable" else 1


@dataclass(frozen=True, eq=False)
class Equipment:
    """Instrument, targets and loads."""

    targets: FloatArray  #: (T, 3) flange frame [m]
    load_point: FloatArray  #: (3,) where the force acts, flange frame [m]; or (N, 3), of as many postures
    loads: Loads  #: loads that can be applied
    sigma: float  #: standard uncertainty of one coordinate of one reading [m]
    instrument: Instrument | None = None  #: the tracker at its station; isotropic noise of sigma if None
    #: (3, 3) or (T, 3, 3) of the targets' deflections, in units of sigma², where there is no instrument;
    #: isotropic if None
    covariance: FloatArray | None = None
    #: (T, 3), or (N, 1, 3) of as many postures: unit vectors in R0 along which targets are read; zero for
    #: targets whose three coordinates are. None if there are only those
    along: FloatArray | None = None

    def measurements(self, robot: Robot, joints: FloatArray, force: FloatArray) -> Measurements:
        """Return readings still to be taken, with deflections of zero and the covariance that they will have.

        Args:
            robot: n joints.
            joints: (N, n) angles as the controller shows them [rad].
            force: (N, 3) axes of R0 [N].
        """
        count, shape = len(joints), (len(joints), *self.targets.shape)
        plain = Measurements(
            joints=joints,
            force=force,
            moment=np.zeros((count, 3)),
            load_point=np.broadcast_to(self.load_point, (count, 3)),
            position=np.broadcast_to(self.targets, shape),
            in_flange=np.ones(shape[:2], dtype=np.bool_),
            deflection=np.zeros(shape),
            present=np.ones(shape[:2], dtype=np.bool_),
            sigma=self.sigma,
            direction=None if self.along is None else np.broadcast_to(self.along, shape).copy(),
        )
        if self.instrument is None:
            if self.covariance is None:
                return plain
            return replace(plain, covariance=np.broadcast_to(self.covariance, (*shape[:2], 3, 3)).copy())
        noise = DifferenceNoise.by(self.instrument, robot, plain)
        # The unit of the covariance is the sigma stated here, whatever that of these places is.
        return replace(plain, covariance=noise.covariance * (noise.sigma / self.sigma) ** 2)

    def direction(self, robot: Robot, joints: FloatArray, anchor: int) -> FloatArray:
        """Return the unit vectors of the force (N, 3) in R0, of a weight or towards an anchor."""
        if self.loads.kind == "dead_weight":
            return np.broadcast_to([0.0, 0.0, -1.0], (len(joints), 3))
        at = self.load_place(robot, joints)
        towards = self.loads.anchors[anchor] - at
        unit: FloatArray = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
        return unit

    def load_place(self, robot: Robot, joints: FloatArray) -> FloatArray:
        """Return where the load acts (N, 3) in R0 [m]."""
        now = Configurations(robot, robot.joint_map.model_angles(joints))
        points = np.broadcast_to(self.load_point, (len(joints), 3))[:, None]
        place: FloatArray = now.to_base(points)[:, 0]
        return place

    def strength(self, robot: Robot, joints: FloatArray) -> FloatArray:
        """Return the greatest force (N,) [N] whose torques stay within the limits in every direction."""
        now = Configurations(robot, robot.joint_map.model_angles(joints))
        jacobian = now.jacobian_at(self.load_place(robot, joints)[:, None])[:, 0]
        lever = np.maximum(np.linalg.norm(jacobian, axis=1), 1e-9)
        strength: FloatArray = np.minimum(self.loads.force, (self.loads.torque_limit / lever).min(axis=1))
        return strength


def whitened_rows(robot: Robot, measurements: Measurements, *, links: bool) -> FloatArray:
    """Return the rows of readings, in units of sigma.

    Args:
        robot: n joints.
        measurements: N readings of T targets.
        links: whether the columns of link compliances follow those of the joints.

    Returns:
        (N, 3 T, P).
    """
    terms = [JOINTS, links_behind(tuple(range(robot.n)))] if links else [JOINTS]
    blocks = regressor_blocks(robot, measurements)
    parts = [term_rows(block, terms, np.zeros(robot.n)).targets[..., :-1] for block in blocks]
    rows = np.concatenate(parts)
    return rows.reshape(len(rows), -1, rows.shape[-1])


@dataclass(frozen=True, eq=False)
class Motion:
    """Jacobians of N postures, which turn a load into deflections."""

    load_jacobian: FloatArray  #: (N, 3, n) J_v at the load point [m/rad]
    target_jacobian: FloatArray  #: (N, 3 T, n) J_v at the targets, whitened in units of sigma

    @classmethod
    def of(cls, robot: Robot, equipment: Equipment, joints: FloatArray) -> Motion:
        """Compute the Jacobians of postures (N, n) [rad]."""
        count = len(joints)
        now = Configurations(robot, robot.joint_map.model_angles(joints))
        load_point = np.broadcast_to(equipment.load_point, (count, 3))[:, None]
        targets = np.broadcast_to(equipment.targets, (count, *equipment.targets.shape))
        covariance, along = equipment.covariance, equipment.along
        if covariance is None:
            covariance = equipment.measurements(robot, joints, np.zeros((count, 3))).covariance
        direction = None if along is None else np.broadcast_to(along, targets.shape)
        jacobian = whitened(covariance, shown_along(direction, now.jacobian_at(now.to_base(targets))))
        return cls(
            now.jacobian_at(now.to_base(load_point))[:, 0],
            jacobian.reshape(count, 3 * len(equipment.targets), robot.n),
        )

    def rows(self, force: FloatArray) -> FloatArray:
        """Return the rows (N, 3 T, n) of one reading under forces (N, 3) [N]."""
        torque = np.einsum("ni,nij->nj", force, self.load_jacobian)
        rows: FloatArray = self.target_jacobian * torque[:, None]
        return rows

    def information(self, force: FloatArray) -> FloatArray:
        """Return ``diag(τ) (Σ_t J_tᵀ Σ_t⁻¹ J_t) diag(τ)`` of a reading under each force (N, D, 3) [N].

        Returns:
            (n, n, N, D) in units of sigma⁻².
        """
        J = self.target_jacobian
        motion = (J.transpose(0, 2, 1) @ J).transpose(1, 2, 0)[..., None]
        torque = np.ascontiguousarray((force @ self.load_jacobian).transpose(2, 0, 1))
        information: FloatArray = motion * torque[:, None] * torque[None]
        return information

    def __getitem__(self, rows: IndexArray) -> Motion:
        """Some of the postures."""
        return Motion(self.load_jacobian[rows], self.target_jacobian[rows])


def drawn_postures(robot: Robot, count: int, seed: int) -> FloatArray:
    """Draw postures evenly within the joints' limits, in whole degrees of the controller's angles.

    Returns:
        (N, n) [rad], N at most `count`.

    Raises:
        RequestError: the limits leave no whole degree.
    """
    limits = np.clip(robot.limits, -_LARGEST_ANGLE, _LARGEST_ANGLE)
    random = np.random.default_rng(seed)
    model = limits[:, 0] + (limits[:, 1] - limits[:, 0]) * random.random((count, robot.n))
    controller = np.linalg.solve(robot.joint_map.matrix, (model - robot.joint_map.offset).T).T
    joints: FloatArray = np.radians(np.round(np.degrees(controller)))
    joints = joints[within_limits(robot, joints)]
    if not len(joints):
        raise RequestError(
            "no posture in whole degrees is within the joint limits",
            where="postures",
            remedy="give the postures, or correct the joint limits of the robot's model",
        )
    return joints


def within_limits(robot: Robot, joints: FloatArray) -> BoolArray:
    """Return which postures (N, n) of the controller lie within the limits of the model's joints (N,)."""
    model = robot.joint_map.model_angles(joints)
    inside = (model >= robot.limits[:, 0] - _ROUNDING) & (model <= robot.limits[:, 1] + _ROUNDING)
    return np.asarray(inside.all(axis=1), dtype=np.bool_)


def targets_in_flange(robot: Robot, measurements: Measurements) -> FloatArray:
    """Return the mean places (T, 3) of targets that were read, flange frame [m]."""
    now = Configurations(robot, robot.joint_map.model_angles(measurements.joints))
    measured = (measurements.position - now.flange_translation[:, None]) @ now.flange_rotation
    places = np.where(measurements.in_flange[..., None], measurements.position, measured)
    present = measurements.present[..., None]
    mean: FloatArray = np.where(present, places, 0.0).sum(axis=0) / np.maximum(present.sum(axis=0), 1)
    return mean
