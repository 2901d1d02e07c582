"""A weight step: angles of two encoders of joints at rest, without and with a load at the flange."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray, wrap
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot

PLACE: Final = 3
"""Number of coordinates of the load's place."""
_NO_VARIATION: Final = 1e-3
"""Part of the torque below which its variation counts as none."""
_DISTINCT: Final = 0.01
"""Part of the range of torques by which two torques differ at least."""


@dataclass(frozen=True, eq=False)
class Load:
    """Load at the flange; its weight acts along gravity in its centre of mass."""

    mass: float  #: [kg]
    mass_uncertainty: float  #: standard uncertainty [kg]
    point: FloatArray  #: (3,) centre of mass in the flange frame [m]
    point_uncertainty: float  #: standard uncertainty of each coordinate [m]
    is_weighed: bool = True  #: false if the uncertainty of the mass is assumed


def compute_holding_torques(
    robot: Robot, positions: FloatArray, load: Load, gravity: FloatArray
) -> FloatArray:
    """Return the torques (4, P, n) with which the motors hold a load [N·m].

    The first is that of the load where it is; the other three are the changes if the load hangs 1 m farther
    along x, y or z of the flange [N·m/m].

    Args:
        robot: n joints.
        positions: (P, n) positions of the model's joints [rad or m].
        load: load at the flange.
        gravity: (3,) acceleration in R0 [m/s²].
    """
    postures = Postures(robot, positions)
    places = load.point + np.vstack([np.zeros(PLACE), np.eye(PLACE)])
    force = np.tile(load.mass * gravity, (len(positions), 1))
    by_load = np.stack(
        [postures.load(np.tile(place, (len(force), 1)), force, np.zeros_like(force))[1] for place in places]
    )
    by_load[1:] -= by_load[0]
    return -by_load


@dataclass(frozen=True, eq=False)
class EncoderReadings:
    """R readings of both encoders of joints, each in one posture from one side, in two states.

    The columns of `motor` and `link` are the states: without and with the load.
    """

    posture: IndexArray  #: (R,) index of the posture
    joint: IndexArray  #: (R,) index of the joint
    approach: IndexArray  #: (R,) 1 or −1: sense in which the joint turned last; 0 if unknown
    motor: FloatArray  #: (R, 2) angle of the motor, at the joint [rad]
    link: FloatArray  #: (R, 2) angle behind the gearbox [rad]

    @cached_property
    def twist(self) -> FloatArray:
        """(R, 2) twist of the gearbox in both states, motor angle less link angle [rad]."""
        return wrap(self.motor - self.link)

    @cached_property
    def step(self) -> FloatArray:
        """(R,) twist with the load less twist without [rad]."""
        return wrap(self.twist[:, 1] - self.twist[:, 0])


@dataclass(frozen=True, eq=False)
class WeightStep:
    """P postures of a robot of n joints, with the readings of its encoders and the load of the second state.

    The twist of a gearbox at rest is ``c (τ_arm + τ) ± h/2``, with the torque τ with which the motor holds
    the load. Masses of the arm, balancers, gear errors and eccentric encoders are in both states, so that
    they cancel in the step of the twist, ``c τ + offset``.
    """

    robot: Robot
    labels: tuple[str, ...]  #: of the P postures
    joints: FloatArray  #: (P, n) as the controller shows them [rad or m]
    readings: EncoderReadings
    load: Load
    gravity: FloatArray  #: (3,) acceleration in R0 [m/s²]
    encoder_sigma: float = 0.0  #: least standard uncertainty of an angle of one encoder [rad]

    @cached_property
    def loaded_positions(self) -> FloatArray:
        """(P, n) positions of the model's joints under load [rad or m].

        A joint with two encoders is where its link encoder shows it; other joints stay where they were.
        """
        q = self.robot.joint_map.model_angles(self.joints)
        read = self.readings
        moved, count = np.zeros_like(q), np.zeros_like(q)
        np.add.at(moved, (read.posture, read.joint), wrap(read.link[:, 1] - read.link[:, 0]))
        np.add.at(count, (read.posture, read.joint), 1.0)
        return q + moved / np.maximum(count, 1.0)

    @cached_property
    def torques(self) -> FloatArray:
        """(4, P, n) torques with which the motors hold the load, as `compute_holding_torques` [N·m]."""
        return compute_holding_torques(self.robot, self.loaded_positions, self.load, self.gravity)

    def select(self, joint: int) -> JointStep:
        """Return the steps of one joint, the mean over the approaches of each posture."""
        read, of_joint = self.readings, self.readings.joint == joint
        postures, row = np.unique(read.posture[of_joint], return_inverse=True)
        count = np.bincount(row).astype(np.float64)
        imbalance = np.bincount(row, weights=read.approach[of_joint]) / count
        return JointStep(
            joint,
            postures,
            np.bincount(row, weights=read.step[of_joint]) / count,
            self.torques[:, postures, joint],
            imbalance,
            2.0 * self.encoder_sigma / np.sqrt(count),
        )

    def lost_motion(self, joint: int) -> FloatArray:
        """Return the twist from the positive side less that from the negative side [rad].

        One value for each state of each posture that has both sides.
        """
        read = self.readings
        values = []
        for posture in range(len(self.labels)):
            here = (read.joint == joint) & (read.posture == posture)
            positive, negative = here & (read.approach == 1), here & (read.approach == -1)
            if positive.any() and negative.any():
                values.append(wrap(read.twist[positive].mean(axis=0) - read.twist[negative].mean(axis=0)))
        return np.concatenate(values) if values else np.zeros(0)


@dataclass(frozen=True, eq=False)
class JointStep:
    """Steps of the twist of one joint in S postures."""

    joint: int  #: index of the joint
    postures: IndexArray  #: (S,) indices of the postures
    step: FloatArray  #: (S,) twist with the load less twist without [rad]
    torques: FloatArray  #: (4, S) holding torque, and its changes with the load's place, as in `WeightStep`
    imbalance: FloatArray  #: (S,) mean sense of the approaches: 0 if both sides were read
    least_noise: FloatArray  #: (S,) least standard deviation of a step [rad]

    @cached_property
    def columns(self) -> FloatArray:
        """(S, u) columns of the compliance, the offset and, if it varies, the imbalance of approaches.

        The offset takes in lost motion that differs between the states, if all postures were approached
        alike.
        """
        columns = [self.torques[0], np.ones(len(self.step))]
        if np.ptp(self.imbalance) > 0.0:
            columns.append(0.5 * self.imbalance)
        return np.column_stack(columns)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of postures less unknowns of the joint."""
        return len(self.step) - int(self.columns.shape[1])

    @property
    def distinct_torques(self) -> int:
        """Number of torques that differ by more than a hundredth of their range."""
        torque = np.sort(self.torques[0])
        is_another = np.diff(torque) > _DISTINCT * np.ptp(torque)
        return 1 + int(is_another.sum())

    @cached_property
    def has_varied_torque(self) -> bool:
        """True if the torque varies between postures more than the offset and the approaches explain."""
        others = self.columns[:, 1:]
        torque = self.torques[0]
        varied = torque - others @ np.linalg.lstsq(others, torque, rcond=None)[0]
        return bool(np.linalg.norm(varied) > _NO_VARIATION * max(float(np.linalg.norm(torque)), 1.0))
