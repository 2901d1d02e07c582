"""A robot's motion as its controller logs it: angles of both encoders, and what the motors carry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.robot import Robot

_SMOOTHING: Final = 0.1
"""Duration [s] over which angles are smoothed, to differentiate them."""
_DEGREE: Final = 4
"""Degree of the polynomials of the smoothing."""
_KEPT: Final = 5
"""Number of samples that are kept of each duration of the smoothing: samples that are closer say the same."""
_MOST_KEPT: Final = 2_000
"""Greatest number of samples that are kept of a log."""
CENTRE: Final = 3
"""Number of coordinates of a centre of mass."""
_DIFFERENCE: Final = 1e-3
"""Shift of a centre of mass [m] for a central difference: exact, because parameters are quadratic in it."""


@dataclass(frozen=True, eq=False)
class MovingBody:
    """Body that a joint carries, with its inertia; its mass and its centre are known within bounds."""

    name: str
    joint: int  #: index of the joint that carries it
    mass: float  #: [kg]
    mass_tolerance: float  #: relative half-width of the bounds of the mass
    centre: FloatArray  #: (3,) in the frame that moves with the joint [m]
    centre_tolerance: float  #: radius of the ball that contains the centre [m]
    inertia: FloatArray  #: (3, 3) about the centre of mass [kg·m²]

    @cached_property
    def parameters(self) -> FloatArray:
        """(10, 4) dynamic parameters as Pinocchio orders them, and their changes by 1 m of the centre."""
        steps = _DIFFERENCE * np.eye(CENTRE)
        changes = [self._parameters_at(step) - self._parameters_at(-step) for step in steps]
        return np.column_stack(
            [self._parameters_at(np.zeros(CENTRE)), *np.array(changes) / (2 * _DIFFERENCE)]
        )

    def _parameters_at(self, shift: FloatArray) -> FloatArray:
        """Return the dynamic parameters (10,) with the centre shifted by (3,) [m]."""
        inertia = pin.Inertia(self.mass, self.centre + shift, self.inertia)
        return np.asarray(inertia.toDynamicParameters())


@dataclass(frozen=True, eq=False)
class GasSpring:
    """Balancer of a joint: a gas spring between the link before the joint and the link behind it.

    Its gas keeps its temperature. Its rod pulls, so that its volume is greatest where the spring is shortest.
    """

    joint: int  #: index of the joint
    radius_before: float  #: distance of its end on the link before the joint from the joint's axis [m]
    radius_behind: float  #: distance of its end on the link behind the joint from the axis [m]
    angle: float  #: angle from the first end to the second about the joint's axis at joint position 0 [rad]
    area: float  #: of the piston, on which the gas acts [m²]
    pressure: float  #: at the greatest volume [Pa]
    volume: float  #: greatest volume [m³]
    tolerance: float  #: relative half-width of the bounds of the pressure

    def holding_torque(self, position: FloatArray) -> FloatArray:
        """Return the torque [N·m] that the motor adds against the spring, at joint positions [rad].

        The gas law gives the pull ``A p V / (V − A (s − s₀))`` of a spring of length s, which is s₀ at the
        greatest volume V.
        """
        before, behind, angle = self.radius_before, self.radius_behind, position + self.angle
        length = np.sqrt(before**2 + behind**2 - 2.0 * before * behind * np.cos(angle))
        volume = self.volume - self.area * (length - abs(before - behind))
        pull = self.area * self.pressure * self.volume / volume
        lever = before * behind * np.sin(angle) / length  # change of the length by the joint's position
        return np.asarray(pull * lever)


@dataclass(frozen=True, eq=False)
class MotionLog:
    """Angles of one motion at equal intervals of time."""

    label: str
    period: float  #: interval of time [s]
    motor: FloatArray  #: (N, n) positions of the model's joints by their motors [rad or m]
    link: Mapping[int, FloatArray]  #: joint → (N,) angle of the encoder behind its gearbox [rad]

    @cached_property
    def window(self) -> int:
        """Odd number of samples over which angles are smoothed."""
        return 2 * max(round(0.5 * _SMOOTHING / self.period), _DEGREE // 2 + 1) + 1

    @cached_property
    def kept(self) -> slice:
        """Samples that a fit uses: away from the ends, where the smoothing has no full window."""
        usable = len(self.motor) - 2 * self.window
        step = max(self.window // _KEPT, usable // _MOST_KEPT + 1, 1)
        return slice(self.window, len(self.motor) - self.window, step)

    def smooth(self, values: FloatArray, derivative: int = 0) -> FloatArray:
        """Return kept samples of (N, …) values, smoothed and differentiated by time."""
        smoothed = savgol_filter(values, self.window, _DEGREE, derivative, self.period, axis=0)
        return np.asarray(smoothed[self.kept], dtype=np.float64)

    def shift_link(self, joint: int, delay: float) -> FloatArray:
        """Return the angles (N,) of a link encoder whose readings come `delay` [s] after the motor's."""
        time = self.period * np.arange(len(self.motor))
        return np.asarray(CubicSpline(time, self.link[joint])(time + delay))


@dataclass(frozen=True, eq=False)
class MotionCampaign:
    """Logs of one robot, with the bodies and gas springs that its motors carry."""

    robot: Robot
    logs: tuple[MotionLog, ...]
    links: tuple[MovingBody, ...]  #: bodies of the arm itself
    payload: MovingBody  #: load at the flange, with the tool
    springs: tuple[GasSpring, ...]
    gravity: FloatArray  #: (3,) acceleration in R0 [m/s²]
    periods: Mapping[int, tuple[float, ...]] = field(default_factory=dict)
    """Joint → periods of its gear error, in periods a turn of the joint."""

    @property
    def bodies(self) -> tuple[MovingBody, ...]:
        """Bodies that the motors carry."""
        return (*self.links, self.payload)

    @cached_property
    def joints(self) -> tuple[int, ...]:
        """Joints with an encoder behind the gearbox, in order."""
        return tuple(sorted({joint for log in self.logs for joint in log.link}))

    @cached_property
    def torques(self) -> tuple[FloatArray, ...]:
        """For each log the torques (S, n, B, 4) [N·m] of B bodies at S kept samples.

        The first of the four is the torque of the body as stated; the others are its changes by 1 m of the
        centre of mass along each axis [N·m/m].
        """
        return tuple(self._compute_torques(log) for log in self.logs)

    def find_stated_torque(self, joint: int, numbers: Sequence[int]) -> FloatArray:
        """Return the torques (S,) [N·m] of a joint's motor in some logs, with all masses as stated."""
        springs = [spring for spring in self.springs if spring.joint == joint]
        torques = []
        for number in numbers:
            log = self.logs[number]
            position = log.smooth(log.motor[:, joint])
            by_springs = [spring.holding_torque(position) for spring in springs]
            torques.append(self.torques[number][:, joint, :, 0].sum(axis=1) + sum(by_springs))
        return np.concatenate(torques)

    def _compute_torques(self, log: MotionLog) -> FloatArray:
        """Return the torques of one log, by Pinocchio's regressor of joint torques."""
        model = self.robot.model.copy()
        model.gravity = pin.Motion(np.asarray(self.gravity), np.zeros(3))
        data, n, bodies = model.createData(), self.robot.n, len(self.bodies)
        of_bodies = np.zeros((10 * n, bodies, 1 + CENTRE))
        for number, body in enumerate(self.bodies):
            of_bodies[10 * body.joint : 10 * (body.joint + 1), number] = body.parameters
        parameters = of_bodies.reshape(10 * n, -1)
        states = zip(*(log.smooth(log.motor, derivative) for derivative in range(3)), strict=True)
        torques = [pin.computeJointTorqueRegressor(model, data, *state) @ parameters for state in states]
        return np.array(torques).reshape(-1, n, bodies, 1 + CENTRE)
