"""The one translator between messages (schemas) and the numerical core (solver)."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from schemas import measurement_set as sets
from schemas import robot as robots
from schemas.run import RunOptions
from service.readings import ReadingArrays
from solver.chain import KinematicChain
from solver.dh import DhRow, dh_chain
from solver.exceptions import MeasurementError, RequestError
from solver.identification import Settings
from solver.integrity import Finding
from solver.measurements import Measurements
from solver.problem import Bounds
from solver.robot import JointMap, Robot
from solver.wrist import find_wrist

__all__ = [
    "build_robot",
    "describe_joints",
    "describe_wrist",
    "dh_kinematics",
    "to_measurements",
    "to_settings",
    "to_warnings",
]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

KGF: Final = 9.80665
"""Standard gravity: newtons in a kilogram-force, exactly."""

_LENGTH: Final[dict[str, float]] = {"m": 1.0, "mm": 1e-3}
_ANGLE: Final[dict[str, float]] = {"rad": 1.0, "deg": np.pi / 180.0}
_FORCE: Final[dict[str, float]] = {"N": 1.0, "kN": 1e3, "kgf": KGF}
_MOMENT: Final[dict[str, float]] = {"N.m": 1.0, "N.mm": 1e-3, "kN.m": 1e3, "kgf.m": KGF}


def dh_kinematics(model: robots.DhModel, name: str) -> KinematicChain:
    """The chain of a DH table.

    Raises:
        RobotError: a row that makes no robot.
    """
    rows = [DhRow(row.a, row.alpha, row.d, row.theta, row.lower, row.upper) for row in model.rows]
    return dh_chain(rows, model.convention, name)


def build_robot(chain: KinematicChain, joint_map: robots.JointMap | None) -> Robot:
    """A robot of a checked chain.

    Raises:
        RobotError: the joint map does not fit.
    """
    if joint_map is None:
        return Robot(chain)
    return Robot(chain, JointMap.from_rows(joint_map.matrix, joint_map.offset))


def describe_joints(robot: Robot) -> list[robots.Joint]:
    """The moving joints with their limits."""
    return [
        robots.Joint(
            name=name,
            lower=float(lower) if np.isfinite(lower) else None,
            upper=float(upper) if np.isfinite(upper) else None,
        )
        for name, (lower, upper) in zip(robot.joint_names, robot.limits, strict=True)
    ]


def describe_wrist(robot: Robot) -> robots.Wrist:
    """Whether the decoupled method applies."""
    wrist = find_wrist(robot)
    if wrist is None:
        return robots.Wrist(spherical=False, miss_distance=None)
    return robots.Wrist(spherical=wrist.spherical, miss_distance=wrist.miss_distance)


def to_measurements(
    header: sets.MeasurementSetHeader, readings: ReadingArrays, robot: Robot
) -> Measurements:
    """Bring a set to SI units and check that it is complete.

    Raises:
        MeasurementError: with the place and the remedy.
    """
    if readings.joints.shape[1] != robot.n:
        raise MeasurementError(
            f"{readings.joints.shape[1]} joint angles for a robot with {robot.n} joints",
            where="observations[0].joints",
            remedy=f"give the {robot.n} controller angles of {', '.join(robot.joint_names)}",
        )
    length = _LENGTH[header.units.length]
    deflection = np.where(
        readings.as_deflection[..., None], readings.loaded, readings.loaded - readings.unloaded
    )
    return Measurements(
        joints=_ANGLE[header.units.angle] * readings.joints,
        force=_FORCE[header.units.force] * readings.force,
        moment=_moment_factor(header.units, readings) * readings.moment,
        load_point=length * _load_points(header, readings),
        position=length * _positions(header, readings),
        in_flange=readings.as_deflection,
        deflection=length * deflection,
        present=readings.present,
        sigma=length * header.noise.sigma if header.noise is not None else None,
    )


def _moment_factor(units: sets.Units, readings: ReadingArrays) -> float:
    """N·m in the unit of moments, which must be stated where the others do not imply it."""
    if units.moment is not None:
        return _MOMENT[units.moment]
    if units.length == "m" or not readings.moment.any():
        return _FORCE[units.force]
    first = int(np.flatnonzero(readings.moment.any(axis=1))[0])
    raise MeasurementError(
        f"observations[{first}] has a moment, whose unit is not clear when lengths are in mm",
        where="units.moment",
        remedy=f"state units.moment, one of {', '.join(_MOMENT)}",
    )


def _load_points(header: sets.MeasurementSetHeader, readings: ReadingArrays) -> FloatArray:
    missing = ~readings.load_point_given & readings.force.any(axis=1)
    if header.load_point is not None:
        return np.where(readings.load_point_given[:, None], readings.load_point, header.load_point)
    if missing.any():
        raise MeasurementError(
            "it is not said where the force acts",
            where=f"observations[{int(np.flatnonzero(missing)[0])}].load_point",
            remedy="give load_point, in the flange frame, for the set or for each observation",
        )
    return readings.load_point


def _positions(header: sets.MeasurementSetHeader, readings: ReadingArrays) -> FloatArray:
    """Places of the targets: measured in R0, or from the flange frame for deflections."""
    names = [str(name) for name in readings.targets]
    needed = readings.as_deflection.any(axis=0)
    for t in np.flatnonzero(needed):
        if names[t] not in header.flange_targets:
            first = int(np.flatnonzero(readings.as_deflection[:, t])[0])
            raise MeasurementError(
                f"target '{names[t]}' is read as a deflection and its place is not given",
                where=f"observations[{first}].readings",
                remedy=f"add '{names[t]}' to flange_targets, in the flange frame",
            )
    in_flange = np.array([header.flange_targets.get(name, (0.0, 0.0, 0.0)) for name in names])
    return np.where(readings.as_deflection[..., None], in_flange, readings.unloaded)


def to_settings(options: RunOptions, robot: Robot) -> Settings:
    """How to identify, with stiffness bounds turned into bounds on the compliances.

    Raises:
        RequestError: a bound on a joint that the robot does not have.
    """
    n = robot.n
    bounds = Bounds.positive(n) if options.positive else Bounds.unconstrained(n)
    lower, upper = bounds.lower.copy(), bounds.upper.copy()
    for name, (least, greatest) in options.stiffness_bounds.items():
        if name not in robot.joint_names:
            raise RequestError(
                f"the robot has no joint '{name}'",
                where=f"stiffness_bounds.{name}",
                remedy=f"use one of {', '.join(robot.joint_names)}",
            )
        j = robot.joint_names.index(name)
        lower[j] = 0.0 if greatest is None else 1.0 / greatest
        upper[j] = np.inf if least is None else 1.0 / least
    return Settings(
        method=options.method,
        weighting=options.weighting,
        characteristic_length=options.characteristic_length,
        bounds=Bounds(lower, upper),
        confidence=options.confidence,
    )


def to_warnings(findings: list[Finding], readings: ReadingArrays) -> list[sets.SetWarning]:
    """What was noticed, with the observations' labels."""
    return [
        sets.SetWarning(
            code=finding.code,
            where=None
            if finding.observation is None
            else f"observations[{finding.observation}] '{readings.labels[finding.observation]}'",
            message=finding.message,
            remedy=finding.remedy,
        )
        for finding in findings
    ]
