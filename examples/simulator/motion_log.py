"""Simulated logs of a motion: angles of two encoders of joints over time, without a known load.

The torques are those of point masses, by Newton's law: accelerations are differences of positions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arm import FloatArray, Posture, SpringArm
from .document import robot_document
from .weight_step import GRAVITY, Gears

PERIOD = 0.004
"""Interval of a controller's log [s]."""
_TURN_OVER = 2e-3
"""Motion of a joint [rad] after which lost motion has changed sides."""
_BITS = 20
"""Resolution of the link's encoder: 2 to this power steps a turn."""


@dataclass(frozen=True)
class GasBalancer:
    """Gas spring that pulls between a point before joint 2 and a point behind it."""

    radius_before: float = 0.8  #: distance of the first point from the axis [m]
    radius_behind: float = 0.2  #: distance of the second point from the axis [m]
    angle: float = 1.66  #: between both points at joint position 0 [rad]
    area: float = 1.7e-3  #: [m²]
    pressure: float = 1.6e7  #: at the greatest volume [Pa]
    volume: float = 0.96e-3  #: greatest volume [m³]

    def work(self, position: FloatArray) -> FloatArray:
        """Return the energy of the gas [J] at joint positions [rad], up to a constant."""
        first = self.radius_before * np.exp(0j)
        second = self.radius_behind * np.exp(1j * (position + self.angle))
        stroke = np.abs(second - first) - (self.radius_before - self.radius_behind)
        return np.asarray(-self.pressure * self.volume * np.log(1.0 - self.area * stroke / self.volume))

    def torque(self, position: FloatArray, step: float = 1e-5) -> FloatArray:
        """Return the torque [N·m] with which the motor turns against the spring: change of its energy."""
        return (self.work(position + step) - self.work(position - step)) / (2.0 * step)


@dataclass(frozen=True, eq=False)
class MovedArm:
    """An arm whose links carry point masses, and a payload at its flange."""

    arm: SpringArm
    masses: FloatArray  #: (n,) at the places below [kg]
    places: FloatArray  #: (n, 3) at zero joint positions, in R0 [m]
    payload: float  #: [kg]
    point: FloatArray  #: (3,) centre of mass of the payload in the flange frame [m]
    balancer: GasBalancer | None = None  #: of joint 2

    def torques(self, q: FloatArray, period: float) -> FloatArray:
        """Return the torques (N, n) [N·m] that move the masses, at positions (N, n) [rad] in time."""
        torques = np.zeros_like(q)
        posture = self.arm.posture(q)
        for body in range(q.shape[1]):
            torques += self._holding(posture, self._follow(q, body), self.masses[body], body, period)
        centre = posture.point_to_base(np.broadcast_to(self.point, (len(q), 3)))
        torques += self._holding(posture, centre, self.payload, q.shape[1] - 1, period)
        if self.balancer is not None:
            torques[:, 1] += self.balancer.torque(q[:, 1])
        return torques

    def _follow(self, q: FloatArray, body: int) -> FloatArray:
        """Return the places (N, 3) of the mass of a link in R0, which only joints up to `body` move."""
        moved = np.where(np.arange(q.shape[1]) <= body, q, 0.0)
        posture = self.arm.posture(moved)
        start = self.arm.posture(np.zeros(q.shape[1]))
        in_flange = start.flange_rotation.T @ (self.places[body] - start.flange_translation)
        return posture.point_to_base(np.broadcast_to(in_flange, (len(q), 3)))

    @staticmethod
    def _holding(posture: Posture, place: FloatArray, mass: float, body: int, period: float) -> FloatArray:
        """Return the torques (N, n) [N·m] that hold and accelerate a mass at places (N, 3)."""
        acceleration = np.gradient(
            np.gradient(place, period, axis=0, edge_order=2), period, axis=0, edge_order=2
        )
        force = mass * (acceleration + np.array([0.0, 0.0, GRAVITY]))
        torques = np.einsum("tji,ti->tj", posture.velocities(place), force)
        torques[:, body + 1 :] = 0.0
        return np.asarray(torques)


def make_fast_path(
    centre: FloatArray, reach: FloatArray, rng: np.random.Generator, duration: float = 10.0
) -> FloatArray:
    """Return positions (N, n) [rad] of five harmonics about `centre`, as far as `reach`."""
    time = np.arange(0.0, duration, PERIOD)
    base = 2.0 * np.pi / duration
    phase = rng.uniform(0.0, 2.0 * np.pi, (5, len(centre)))
    weight = rng.uniform(0.3, 1.0, (5, len(centre))) / np.arange(1, 6)[:, None]
    waves = np.sin(base * np.arange(1, 6)[:, None, None] * time[:, None] + phase[:, None, :])
    path = np.einsum("hj,htj->tj", weight, waves)
    return np.asarray(centre + reach * path / np.abs(path).max(axis=0))


def make_slow_path(start: FloatArray, end: FloatArray, speed: float) -> FloatArray:
    """Return positions (N, n) [rad] of a sweep from start to end and back; its fastest joint has `speed`."""
    duration = float(np.abs(end - start).max()) / speed
    time = np.arange(0.0, 2.0 * duration, PERIOD)
    there = np.where(time < duration, time, 2.0 * duration - time) / duration
    ramp = 0.5 / duration  # half a second to turn back, at constant acceleration
    smooth = np.where(
        there > 1.0 - ramp,
        1.0 - ramp + (there - 1.0 + ramp) * (1.0 - (there - 1.0 + ramp) / (2 * ramp)),
        there,
    )
    smooth = np.where(there < ramp, there**2 / (2 * ramp) + 0.5 * ramp, smooth)
    return np.asarray(start + (end - start) * smooth[:, None])


def simulate_motion_log(
    moved: MovedArm,
    link: FloatArray,
    joints: Sequence[int],
    gears: Gears,
    rng: np.random.Generator,
    *,
    delay: float,
    second_order: float,
    friction: float,
    phases: FloatArray,
) -> dict[str, Any]:
    """Return one log of a motion of the links, as `motion.logs` of `POST /v1/gearboxes` takes it.

    Args:
        moved: arm with its masses.
        link: (N, n) positions of the links [rad].
        joints: joints with an encoder behind the gearbox.
        gears: imperfections of gearboxes and encoders.
        rng: random numbers.
        delay: of the link's encoder behind the motor's [s].
        second_order: filter of the link's encoder [s²].
        friction: torque behind the gearbox [N·m].
        phases: (joints, periods of the gear error + 2) phases of the errors [rad].
    """
    time = PERIOD * np.arange(len(link))
    torques = moved.torques(link, PERIOD)
    velocity = np.gradient(link, PERIOD, axis=0)
    motor = link + moved.arm.compliances * (torques + friction * np.tanh(velocity / 0.003))
    shown = {}
    for number, joint in enumerate(joints):
        phi = link[:, joint]
        for amplitude, period, phase in zip(gears.gear_error, gears.periods, phases[number], strict=False):
            motor[:, joint] += amplitude * np.sin(period * phi + phase)
        motor[:, joint] += 0.5 * gears.lost_motion * _find_side(phi)
        eccentric = gears.eccentricity * (
            np.sin(phi + phases[number, -2]) + 0.25 * np.sin(2.0 * phi + phases[number, -1])
        )
        seen = phi + eccentric
        late = np.interp(time - delay, time, seen)
        late += second_order * np.gradient(np.gradient(late, PERIOD), PERIOD)
        step = 2.0 * np.pi / 2**_BITS
        shown[moved.arm.joint_names[joint]] = (step * np.round((late + rng.uniform(0, step)) / step)).tolist()
    motor += gears.encoder_noise * rng.standard_normal(motor.shape)
    names = moved.arm.joint_names
    return {"period": PERIOD, "motor": dict(zip(names, motor.T.tolist(), strict=True)), "link": shown}


def _find_side(position: FloatArray) -> FloatArray:
    """Return on which side (N,) the gear's teeth touch, from −1 to 1, after motions that turn over."""
    side = np.zeros(len(position))
    for i, moved in enumerate(np.diff(position, prepend=position[0])):
        side[i] = np.clip(side[i - 1] + 2.0 * moved / _TURN_OVER, -1.0, 1.0)
    return side


def document_of_logs(moved: MovedArm, logs: list[dict[str, Any]], stated: dict[str, Any]) -> dict[str, Any]:
    """Return the document of `POST /v1/gearboxes` for logs; `stated` is its `motion` without logs."""
    named = [{"label": f"log {i + 1}", **log} for i, log in enumerate(logs)]
    return {
        "name": "simulated logs",
        "units": {"length": "m", "angle": "rad"},
        "robot": robot_document(moved.arm),
        "motion": {**stated, "logs": named},
    }
