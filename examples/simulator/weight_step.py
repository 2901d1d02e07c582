"""Simulated weight steps: angles of two encoders of joints at rest, without and with a load at the flange."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .arm import FloatArray, SpringArm
from .document import robot_document

GRAVITY = 9.80665
"""Acceleration along −z of R0 [m/s²]."""
_ROUNDS = 60
"""Rounds of the equilibrium: each changes the angles by the deflection times its gradient, some 1e-3."""


@dataclass(frozen=True)
class Gears:
    """Imperfections of gearboxes and encoders."""

    lost_motion: float = 15e-6  #: twist from the positive side less that from the negative side [rad]
    gear_error: tuple[float, ...] = (15e-6, 10e-6, 5e-6)  #: amplitudes [rad] at the periods below
    periods: tuple[int, ...] = (52, 104, 267)  #: of the gear error, in a turn of the motor's angle
    eccentricity: float = 40e-6  #: of the link's encoder, once a turn; a quarter of it twice a turn [rad]
    drift: float = 20e-6  #: standard deviation of each joint's offset between the states [rad]
    encoder_noise: float = 1.7e-6  #: standard deviation of an angle of an encoder [rad]


@dataclass(frozen=True, eq=False)
class SteppedArm:
    """An arm with a load that hangs at its flange in the second state."""

    arm: SpringArm
    mass: float  #: of the load [kg]
    point: FloatArray  #: centre of mass of the load in the flange frame [m], (3,)
    own_masses: FloatArray  #: of a body at the flange end of each link [kg], (n,)

    def link_angles(self, motor: FloatArray, *, loaded: bool) -> FloatArray:
        """Return the angles of the links [rad] at which springs and weights are in equilibrium.

        Args:
            motor: angles of the motors at the joints [rad], (..., n).
            loaded: whether the load hangs at the flange.
        """
        link = motor.copy()
        for _ in range(_ROUNDS):
            link = motor + self.arm.compliances * self.torques(link, loaded=loaded)
        return link

    def torques(self, link: FloatArray, *, loaded: bool) -> FloatArray:
        """Torques of all weights about the joints [N·m], (..., n)."""
        posture = self.arm.posture(link)
        weights = np.zeros_like(link)
        if loaded:
            force = np.array([0.0, 0.0, -GRAVITY * self.mass])
            place = posture.point_to_base(self.point)
            weights = weights + posture.velocities(place) @ force
        for body, mass in enumerate(self.own_masses):
            if body + 1 < link.shape[-1]:
                place = posture.axis_points[..., body + 1, :]
                lever = posture.velocities(place) @ np.array([0.0, 0.0, -GRAVITY * mass])
                lever[..., body + 1 :] = 0.0  # joints beyond the body do not carry it
                weights = weights + lever
        return weights


def simulate_weight_step(
    stepped: SteppedArm,
    motor: FloatArray,
    joints: tuple[int, ...],
    gears: Gears,
    rng: np.random.Generator,
    *,
    link_holds: bool = False,
) -> dict[str, Any]:
    """Return a weight step as `POST /v1/gearboxes` takes it: each posture from both sides, in both states.

    Args:
        stepped: the arm and its load.
        motor: angles of the motors at the joints [rad], (P, n).
        joints: indices of the joints with two encoders.
        gears: imperfections of gearboxes and encoders.
        rng: random numbers.
        link_holds: true if the controller keeps the link's angle, false if it keeps the motor's.
    """
    at_motor = [motor, motor]
    links = [stepped.link_angles(motor, loaded=False), stepped.link_angles(motor, loaded=True)]
    if link_holds:  # the motor turns until the link is where it was
        turned = motor + links[0] - links[1]
        at_motor, links = [motor, turned], [links[0], stepped.link_angles(turned, loaded=True)]
    phases = rng.uniform(0.0, 2.0 * np.pi, (len(joints), len(gears.periods) + 2))
    drift = gears.drift * rng.standard_normal(len(joints))
    readings: list[list[dict[str, Any]]] = [[] for _ in motor]
    for number, joint in enumerate(joints):
        for side in (1.0, -1.0):
            states = []
            for state in range(2):
                theta, phi = at_motor[state][:, joint], links[state][:, joint]
                error = sum(
                    amplitude * np.sin(period * theta + phase)
                    for amplitude, period, phase in zip(
                        gears.gear_error, gears.periods, phases[number], strict=False
                    )
                )
                eccentric = gears.eccentricity * (
                    np.sin(phi + phases[number, -2]) + 0.25 * np.sin(2.0 * phi + phases[number, -1])
                )
                play = 0.5 * side * gears.lost_motion * (1.0 + 0.1 * rng.standard_normal(len(motor)))
                noise = gears.encoder_noise * rng.standard_normal((2, len(motor)))
                link = phi - play + error + eccentric + state * drift[number] + noise[0]
                states.append(np.stack([theta + noise[1], link], axis=-1).tolist())
            for posture, (unloaded, loaded) in enumerate(zip(*states, strict=True)):
                readings[posture].append(
                    {
                        "joint": stepped.arm.joint_names[joint],
                        "unloaded": {"motor": unloaded[0], "link": unloaded[1]},
                        "loaded": {"motor": loaded[0], "link": loaded[1]},
                        "approach": "+" if side > 0.0 else "-",
                    }
                )
    return {
        "name": "simulated weight step",
        "units": {"length": "m", "angle": "rad"},
        "robot": robot_document(stepped.arm),
        "load": {"mass": stepped.mass, "point": stepped.point.tolist()},
        "observations": [
            {"label": f"s{i + 1:02d}", "joints": q, "encoder_readings": each}
            for i, (q, each) in enumerate(zip(motor.tolist(), readings, strict=True))
        ],
    }
