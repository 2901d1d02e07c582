"""Postures and loads in which a set of measurements could go on, and what a reading there would tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.readings import Measurements
from jointstiff.solver.regression import whitener
from jointstiff.solver.robot import Configurations, Robot

LEAST_SPAN = 1.0
"""Range of a joint's angle [rad] for new postures, where the set itself spans less."""
_DRAWS = 4
"""New postures drawn for each one needed, as limits of coupled joints exclude some."""
_SEED = 20170924

AXIS_DIRECTIONS: FloatArray = np.array(
    [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (z, y, x) > (0, 0, 0)],
    dtype=np.float64,
)
"""(13, 3) towards faces, edges and corners of a cube, one of each opposite pair: both tell the same."""
AXIS_DIRECTIONS /= np.linalg.norm(AXIS_DIRECTIONS, axis=1, keepdims=True)
AXIS_DIRECTIONS.setflags(write=False)


@dataclass(frozen=True, eq=False)
class Equipment:
    """Available loads and targets.

    Attributes:
        force: (3,) the strongest of the set, axes of R0 [N].
        load_point: (3,) where it acts, flange frame [m].
        targets: (T, 3) flange frame [m].
        whitener: (3, 3) or (T, 3, 3) of a target's deflection, in units of sigma.
        one_direction: whether all forces of the set pull along one line, as weights do.
    """

    force: FloatArray
    load_point: FloatArray
    targets: FloatArray
    whitener: FloatArray
    one_direction: bool

    @classmethod
    def of(cls, robot: Robot, measurements: Measurements) -> Equipment:
        """Find the strongest force, and the targets of the observation that read most of them.

        Args:
            robot: n joints.
            measurements: N observations.
        """
        sizes = np.linalg.norm(measurements.force, axis=1)
        strongest = int(np.argmax(sizes))
        force = measurements.force[strongest]
        along = measurements.force @ force
        richest = int(np.argmax(measurements.present.sum(axis=1)))
        present = measurements.present[richest]
        covariance = measurements.covariance
        return cls(
            force=force,
            load_point=measurements.load_point[strongest],
            targets=_in_flange(robot, measurements, richest)[present],
            whitener=whitener(covariance if covariance.ndim == 2 else covariance[richest, present]),
            one_direction=bool((np.abs(along) >= (1.0 - 1e-6) * sizes * sizes[strongest]).all()),
        )

    @property
    def strength(self) -> float:
        """Return the magnitude of the strongest force [N]."""
        return float(np.linalg.norm(self.force))


@dataclass(frozen=True, eq=False)
class Postures:
    """M postures with all targets on the flange.

    Attributes:
        joints: (M, n) angles as the controller shows them [rad].
        observation: (M,) the observation that has this posture; -1 for a new one.
        load_jacobian: (M, 3, n) J_v at the load point [m/rad].
        target_jacobian: (M, T, 3, n) J_v at the targets, whitened in units of sigma [m/rad].
    """

    joints: FloatArray
    observation: IndexArray
    load_jacobian: FloatArray
    target_jacobian: FloatArray

    def __len__(self) -> int:
        return len(self.joints)

    def torque(self, forces: FloatArray) -> FloatArray:
        """Torques of forces (M, D, 3) at the load point: (M, D, n) [N·m]."""
        torque: FloatArray = forces @ self.load_jacobian
        return torque

    def information(self, torque: FloatArray) -> FloatArray:
        """Return what one reading of all targets tells: ``AᵀΣ⁻¹A = diag(τ) (Σ_t J_tᵀ Σ_t⁻¹ J_t) diag(τ)``.

        Args:
            torque: (M, D, n) [N·m].

        Returns:
            (n, n, M, D) in units of sigma⁻².
        """
        n = self.joints.shape[1]
        rows = self.target_jacobian.reshape(len(self), -1, n)
        motion = (rows.transpose(0, 2, 1) @ rows).transpose(1, 2, 0)[..., None]
        twist = np.ascontiguousarray(torque.transpose(2, 0, 1))
        information: FloatArray = motion * twist[:, None] * twist[None]
        return information

    def rows(self, posture: int, torque: FloatArray) -> FloatArray:
        """Regressor (3T, n) of one reading under torques (n,), whitened in units of sigma."""
        rows: FloatArray = (self.target_jacobian[posture] * torque).reshape(-1, len(torque))
        return rows


def measured_postures(robot: Robot, measurements: Measurements, tools: Equipment, count: int) -> Postures:
    """Postures of the set, each with its own load point.

    Args:
        robot: n joints.
        measurements: N observations.
        tools: what to measure with.
        count: at most so many; of more observations, evenly spread ones.
    """
    chosen = np.unique(np.linspace(0, len(measurements) - 1, min(count, len(measurements))).astype(np.intp))
    return _postures(robot, measurements.joints[chosen], chosen, measurements.load_point[chosen], tools)


def new_postures(robot: Robot, measurements: Measurements, tools: Equipment, count: int) -> Postures:
    """Random postures in whole degrees, within what the set spans and the joints' limits.

    The draw is the same at each call. A joint that the set hardly moves is moved by `LEAST_SPAN`, as a
    posture that none of the set resembles may be what is missing.

    Args:
        robot: n joints.
        measurements: N observations.
        tools: what to measure with.
        count: at most so many.
    """
    least, greatest = measurements.joints.min(axis=0), measurements.joints.max(axis=0)
    half = np.maximum(greatest - least, LEAST_SPAN) / 2.0
    draws = np.random.default_rng(_SEED).uniform(-1.0, 1.0, (_DRAWS * count, robot.n))
    joints = np.radians(np.round(np.degrees((least + greatest) / 2.0 + half * draws)))
    model, limits = robot.joint_map.model_angles(joints), robot.limits
    inside = ((model >= limits[:, 0]) & (model <= limits[:, 1])).all(axis=1)
    joints = joints[inside][:count]
    return _postures(
        robot,
        joints,
        np.full(len(joints), -1, dtype=np.intp),
        np.broadcast_to(tools.load_point, (len(joints), 3)),
        tools,
    )


def _postures(
    robot: Robot,
    joints: FloatArray,
    observation: IndexArray,
    load_point: FloatArray,
    tools: Equipment,
) -> Postures:
    configurations = Configurations(robot, robot.joint_map.model_angles(joints))
    targets = np.broadcast_to(tools.targets, (len(joints), *tools.targets.shape))
    load_jacobian = configurations.jacobian_at(configurations.to_base(load_point[:, None]))[:, 0]
    jacobian = configurations.jacobian_at(configurations.to_base(targets))
    return Postures(joints, observation, load_jacobian, tools.whitener @ jacobian)


def _in_flange(robot: Robot, measurements: Measurements, observation: int) -> FloatArray:
    """Places of an observation's targets (T, 3) in the flange frame [m]."""
    joints = measurements.joints[observation][None]
    now = Configurations(robot, robot.joint_map.model_angles(joints))
    position = measurements.position[observation]
    measured = (position - now.flange_translation[0]) @ now.flange_rotation[0]
    places: FloatArray = np.where(measurements.in_flange[observation][:, None], position, measured)
    return places
