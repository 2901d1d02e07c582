"""Readings of a geometry: sweeps, poses and conventions from messages to SI units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from jointstiff.schemas.geometry import MAX_GEOMETRY_TARGETS, GeometryRequest, TrackedPosition
from jointstiff.service.conversion.units import ANGLE, LENGTH, to_instrument
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.identification import Conventions
from jointstiff.solver.geometry.poses import Poses
from jointstiff.solver.geometry.sweeps import Sweep, SweepSet
from jointstiff.solver.mechanics.measurements import fill_unread_places
from jointstiff.solver.mechanics.robot import JointMap, Robot


class _RequestReadings:
    """Targets, units and noise that all readings of a request share, and arrays of the readings."""

    def __init__(self, request: GeometryRequest, robot: Robot | None) -> None:
        positions = [
            *(p for sweep in request.sweeps or () for p in sweep.observations),
            *(request.poses or ()),
        ]
        # names of the T targets, in order of first appearance
        self.names = tuple(dict.fromkeys(name for position in positions for name in position.targets))
        if len(self.names) > MAX_GEOMETRY_TARGETS:
            raise MeasurementError(
                f"there are {len(self.names)} different targets, more than {MAX_GEOMETRY_TARGETS}",
                where="sweeps" if request.sweeps else "poses",
                remedy="use the same name for the same target everywhere",
            )
        self.n = robot.n if robot is not None else len(positions[0].joints)
        self._length, self._angle = LENGTH[request.units.length], ANGLE[request.units.angle]
        # sigma of a coordinate, or the unit of the covariances [m]; None if it is not stated
        self._instrument, self.sigma = None, None
        if request.noise is not None and request.noise.sigma is not None:
            self.sigma = self._length * request.noise.sigma
        elif request.noise is not None and request.noise.instrument is not None:
            self._instrument = to_instrument(request.noise.instrument, self._length)
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
        for index, position in enumerate(positions):
            if len(position.joints) != self.n:
                raise MeasurementError(
                    f"there are {len(position.joints)} joint angles, but the robot has {self.n} joints",
                    where=f"{where}[{index}].joints" if where else "observations",
                    remedy="give the angles of all controller joints in every position",
                )
        angles = self._angle * np.array([position.joints for position in positions], dtype=np.float64)
        present = np.array([[name in p.targets for name in self.names] for p in positions])
        unread = (0.0, 0.0, 0.0)
        points = np.array([[p.targets.get(name, unread) for name in self.names] for p in positions])
        return angles, self._length * points, present

    def covariance(self, points: FloatArray, present: BoolArray) -> FloatArray:
        """Return the covariances of points (..., 3), in units of sigma²; `present` masks the points read.

        The result is (..., 3, 3), or the identity (3, 3) if no instrument is stated.
        """
        if self._instrument is None or self.sigma is None:
            return np.eye(3)
        return self._instrument.covariance(fill_unread_places(points, present)) / self.sigma**2


def to_sweeps(request: GeometryRequest, robot: Robot | None) -> SweepSet:
    """Return the sweeps of a request, in SI units.

    Raises:
        MeasurementError: a joint or a number of angles does not fit the robot.
        RobotError: the joint map does not fit.
    """
    readings = _RequestReadings(request, robot)
    sweeps = []
    for index, sweep in enumerate(request.sweeps or ()):
        angles, points, present = readings.arrange(sweep.observations, f"sweeps[{index}].observations")
        name = sweep.joint
        names = robot.joint_names if robot is not None else tuple(f"joint_{i + 1}" for i in range(readings.n))
        if name not in names:
            raise MeasurementError(
                f"the robot has no joint '{name}'",
                where=f"sweeps[{index}].joint",
                remedy=f"use one of {', '.join(names)}",
            )
        sweeps.append(
            Sweep(
                name=sweep.joint,
                joint=names.index(name),
                angles=angles,
                points=points,
                present=present,
                covariance=readings.covariance(points, present),
            )
        )
    return SweepSet(
        tuple(sweeps), readings.names, _choose_joint_map(request, robot, readings.n), readings.sigma
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
    flange_targets = request.flange_targets
    for index, name in enumerate(flange_targets or ()):
        if name not in targets:
            raise MeasurementError(
                f"target '{name}' has no reading",
                where=f"flange_targets[{index}]",
                remedy=f"choose three of {', '.join(targets)}",
            )
    # Without flange targets, the indices are not used.
    indices = (0, 1, 2) if flange_targets is None else tuple(targets.index(name) for name in flange_targets)
    return Conventions(
        base=request.base or default,
        flange=request.flange or default,
        height=LENGTH[request.units.length] * request.base_height,
        flange_targets=(indices[0], indices[1], indices[2]),
    )


def _choose_joint_map(request: GeometryRequest, robot: Robot | None, n: int) -> JointMap:
    """Return the joint map of the robot, else of the request, else the identity map of n joints."""
    if robot is not None:
        return robot.joint_map
    if request.joint_map is None:
        return JointMap.identity(n)
    return JointMap.from_rows(request.joint_map.matrix, request.joint_map.offset)
