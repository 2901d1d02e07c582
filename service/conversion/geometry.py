"""Readings of a geometry: sweeps, poses and conventions from messages to SI units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from jointstiff.schemas.geometry import MAX_GEOMETRY_TARGETS, GeometryRequest, JointSweep, TrackedPosition
from jointstiff.service.conversion.units import ANGLE, LENGTH, to_instrument
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.identification import Conventions
from jointstiff.solver.geometry.poses import Poses
from jointstiff.solver.geometry.sweeps import Sweep, SweepSet
from jointstiff.solver.mechanics.measurements import Instrument, fill_unread_places
from jointstiff.solver.mechanics.robot import JointMap, Robot


class _RequestReadings:
    """Targets, units and noise that all readings of a request share, and arrays of the readings."""

    def __init__(self, request: GeometryRequest, robot: Robot | None) -> None:
        positions = [each for sweep in request.sweeps or () for each in sweep.observations]
        positions += request.poses or ()
        # names of the T targets, in order of first appearance
        self.names = tuple(dict.fromkeys(name for position in positions for name in position.targets))
        _refuse_too_many_targets(len(self.names), where="sweeps" if request.sweeps else "poses")
        self.n = robot.n if robot is not None else len(positions[0].joints)
        self._length, self._angle = LENGTH[request.units.length], ANGLE[request.units.angle]
        self._instrument: Instrument | None = None  # None if its noise is not stated
        # sigma of a coordinate, or the unit of the covariances [m]; None if it is not stated
        self.sigma: float | None = None
        noise = request.noise
        if noise is not None and noise.sigma is not None:
            self.sigma = self._length * noise.sigma
        elif noise is not None and noise.instrument is not None:
            self._instrument = to_instrument(noise.instrument, self._length)
            _, points, present = self.arrange(positions, "")
            self.sigma = self._instrument.typical_sigma(points[present])

    def arrange(
        self, positions: Sequence[TrackedPosition], where: str
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Arrange K tracked positions as arrays; `where` is their field, for messages.

        Returns:
            (K, n) joint angles [rad]; (K, T, 3) points [m], zero where a target was not read; mask (K, T) of
            the targets that were read.

        Raises:
            MeasurementError: a position has another number of joint angles than the robot has joints.
        """
        self._refuse_other_joint_counts(positions, where)
        angles = self._angle * np.array([position.joints for position in positions], dtype=np.float64)
        present = np.array([[name in each.targets for name in self.names] for each in positions])
        unread = (0.0, 0.0, 0.0)
        points = np.array([[each.targets.get(name, unread) for name in self.names] for each in positions])
        return angles, self._length * points, present

    def _refuse_other_joint_counts(self, positions: Sequence[TrackedPosition], where: str) -> None:
        """Raise a `MeasurementError` if a position has another number of joint angles than the robot.

        `where` is the field of the positions; empty for all positions of the request.
        """
        for index, position in enumerate(positions):
            count = len(position.joints)
            if count != self.n:
                raise MeasurementError(
                    f"there are {count} joint angles, but the robot has {self.n} joints",
                    where=f"{where}[{index}].joints" if where else "observations",
                    remedy="give the angles of all controller joints in every position",
                )

    def covariance(self, points: FloatArray, present: BoolArray) -> FloatArray:
        """Return the covariances of points (..., 3), in units of sigma²; `present` masks the points read.

        The result is (..., 3, 3), or the identity (3, 3) if no instrument is stated.
        """
        if self._instrument is None or self.sigma is None:
            return np.eye(3)
        return self._instrument.covariance(fill_unread_places(points, present)) / self.sigma**2


def _refuse_too_many_targets(count: int, where: str) -> None:
    """Raise a `MeasurementError` if readings in the field `where` have too many different targets."""
    if count > MAX_GEOMETRY_TARGETS:
        raise MeasurementError(
            f"there are {count} different targets, more than {MAX_GEOMETRY_TARGETS}",
            where=where,
            remedy="use the same name for the same target everywhere",
        )


def to_sweeps(request: GeometryRequest, robot: Robot | None) -> SweepSet:
    """Return the sweeps of a request, in SI units.

    Raises:
        MeasurementError: a joint or a number of angles does not fit the robot.
        RobotError: the joint map does not fit.
    """
    readings = _RequestReadings(request, robot)
    joint_names = tuple(f"joint_{i + 1}" for i in range(readings.n))
    if robot is not None:
        joint_names = robot.joint_names
    sweeps = [
        _to_sweep(sweep, readings, joint_names, f"sweeps[{i}]")
        for i, sweep in enumerate(request.sweeps or ())
    ]
    joint_map = _choose_joint_map(request, robot, readings.n)
    return SweepSet(tuple(sweeps), readings.names, joint_map, readings.sigma)


def _to_sweep(sweep: JointSweep, readings: _RequestReadings, joint_names: Sequence[str], where: str) -> Sweep:
    """Return the readings of one sweep, in which a single joint moves, in SI units.

    Args:
        sweep: sweep of the request.
        readings: targets, units and noise of the request.
        joint_names: names of the robot's joints.
        where: field of the request that has the sweep, for errors.

    Raises:
        MeasurementError: the robot has no joint of this name, or another number of joints.
    """
    angles, points, present = readings.arrange(sweep.observations, f"{where}.observations")
    if sweep.joint not in joint_names:
        raise MeasurementError(
            f"the robot has no joint '{sweep.joint}'",
            where=f"{where}.joint",
            remedy=f"use one of {', '.join(joint_names)}",
        )
    return Sweep(
        name=sweep.joint,
        joint=joint_names.index(sweep.joint),
        angles=angles,
        points=points,
        present=present,
        covariance=readings.covariance(points, present),
    )


def to_poses(request: GeometryRequest, robot: Robot) -> Poses:
    """Return the poses of a request, in SI units.

    Raises:
        MeasurementError: a number of joint angles does not fit the robot.
    """
    readings = _RequestReadings(request, robot)
    angles, points, present = readings.arrange(request.poses or (), "poses")
    return Poses(
        angles=angles,
        points=points,
        present=present,
        targets=readings.names,
        joint_map=robot.joint_map,
        sigma=readings.sigma,
        covariance=readings.covariance(points, present),
    )


def to_conventions(request: GeometryRequest, targets: Sequence[str]) -> Conventions:
    """Return the conventions that define R0 and the flange frame; `targets` are the targets that were read.

    Raises:
        MeasurementError: a target that defines the flange frame was not read.
    """
    default: Literal["nominal", "axes"] = "nominal" if request.has_robot else "axes"
    return Conventions(
        base=request.base or default,
        flange=request.flange or default,
        height=LENGTH[request.units.length] * request.base_height,
        flange_targets=_find_flange_targets(request, targets),
    )


def _find_flange_targets(request: GeometryRequest, targets: Sequence[str]) -> tuple[int, int, int]:
    """Return the indices of the three targets that define the flange frame, among the targets that were read.

    Without such targets the indices are not used.

    Raises:
        MeasurementError: one of the three was not read.
    """
    names = request.flange_targets
    if names is None:
        return 0, 1, 2
    for i, name in enumerate(names):
        if name not in targets:
            raise MeasurementError(
                f"target '{name}' has no reading",
                where=f"flange_targets[{i}]",
                remedy=f"choose three of {', '.join(targets)}",
            )
    first, second, third = (targets.index(name) for name in names)
    return first, second, third


def _choose_joint_map(request: GeometryRequest, robot: Robot | None, n: int) -> JointMap:
    """Return the joint map of the robot, else of the request, else the identity map of n joints."""
    if robot is not None:
        return robot.joint_map
    if request.joint_map is None:
        return JointMap.identity(n)
    return JointMap.from_rows(request.joint_map.matrix, request.joint_map.offset)
