"""Simulated logs of arms in motion, with what is true."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import pinocchio as pin

from jointstiff.schemas.gearbox import GearboxRequest
from jointstiff.service.conversion.motion import to_motion_campaign
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator import default_arm
from jointstiff.simulator.motion_log import (
    GasBalancer,
    MovedArm,
    document_of_logs,
    make_fast_path,
    make_slow_path,
    simulate_motion_log,
)
from jointstiff.simulator.weight_step import Gears
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.gearboxes.motion import MotionCampaign

JOINTS: Final = (0, 1, 2)
"""Joints with an encoder behind the gearbox."""
PAYLOAD: Final = 150.0
"""Mass of the load [kg]."""
POINT: Final = np.array([0.0, 0.0, 0.15])
MASSES: Final = np.array([350.0, 300.0, 150.0, 50.0, 25.0, 10.0])
"""Masses of the links [kg]."""
PLACES: Final = np.array(
    [
        [0.1, 0.0, 0.6],
        [0.33, 0.1, 1.3],
        [0.5, 0.0, 2.0],
        [1.1, 0.0, 1.96],
        [1.6, 0.0, 1.96],
        [1.8, 0.0, 1.96],
    ]
)
"""Centres of mass of the links at zero joint positions, in R0 [m]."""
CENTRE: Final = np.radians([0.0, 15.0, -10.0, 0.0, 20.0, 0.0])
REACH: Final = np.radians([25.0, 25.0, 25.0, 40.0, 40.0, 60.0])
"""Middle and half-range of the motions of the joints [rad]."""
SLOW: Final = np.radians(5.0)
"""Speed of slow sweeps [rad/s]."""


@dataclass(frozen=True)
class Simulated:
    """Logs of one arm with what is true."""

    document: dict[str, Any]
    stiffness: FloatArray  # (6,) of the gearboxes [N·m/rad]


def simulate(seed: int, *, is_slow: bool = False, logs: int = 3) -> Simulated:
    """Return logs of a random arm, whose masses are as uncertain as stated.

    Args:
        seed: of the arm, its gears, its masses and its motions.
        is_slow: whether the joints sweep there and back at 5°/s, or swing.
        logs: number of motions.
    """
    draw = np.random.default_rng([seed, 94])
    nominal = default_arm()
    stiffness = np.array([5.0e6, 6.0e6, 5.0e6, 0.6e6, 0.5e6, 0.3e6]) * np.exp(draw.uniform(-0.5, 0.5, 6))
    arm = replace(nominal, stiffnesses=stiffness, payload=1.2 * PAYLOAD)
    stated = GasBalancer()
    true = MovedArm(
        arm,
        MASSES * draw.uniform(0.9, 1.1, 6),
        PLACES,
        PAYLOAD * draw.uniform(0.95, 1.05),
        POINT + _draw_in_ball(draw, 0.01),
        replace(stated, pressure=stated.pressure * draw.uniform(0.9, 1.1)),
    )
    gears = Gears(lost_motion=draw.uniform(5e-6, 20e-6))
    path_of = _make_slow if is_slow else _make_fast
    imperfect: dict[str, Any] = {
        "delay": draw.uniform(1e-3, 5e-3),
        "second_order": draw.uniform(-5e-6, 5e-6),
        "friction": draw.uniform(50.0, 200.0),
        "phases": draw.uniform(0.0, 2.0 * np.pi, (len(JOINTS), len(gears.periods) + 2)),
    }
    measured = [
        simulate_motion_log(true, path_of(draw, number), JOINTS, gears, draw, **imperfect)
        for number in range(logs)
    ]
    return Simulated(document_of_logs(true, measured, _state(true, stated)), stiffness)


def _make_fast(draw: np.random.Generator, _number: int) -> FloatArray:
    """Return a path (N, 6) [rad] of 10 s."""
    return make_fast_path(CENTRE, REACH, draw)


def _make_slow(draw: np.random.Generator, _number: int) -> FloatArray:
    """Return a sweep (N, 6) [rad] there and back, from one random posture to another."""
    start = CENTRE + REACH * draw.uniform(-1.0, -0.5, 6)
    end = CENTRE + REACH * draw.uniform(0.5, 1.0, 6)
    turned = draw.choice([-1.0, 1.0], 6)
    return make_slow_path(CENTRE + turned * (start - CENTRE), CENTRE + turned * (end - CENTRE), SLOW)


def _draw_in_ball(draw: np.random.Generator, radius: float) -> FloatArray:
    """Return a random vector (3,) in a ball."""
    direction = draw.standard_normal(3)
    return np.asarray(radius * draw.uniform() ** (1 / 3) * direction / np.linalg.norm(direction))


def _state(true: MovedArm, balancer: GasBalancer) -> dict[str, Any]:
    """Return what is stated of the masses: nominal values with bounds."""
    return {
        "payload": {"mass": PAYLOAD, "point": POINT.tolist()},
        "bodies": [
            {"name": f"link {i + 1}", "joint": true.arm.joint_names[i], "mass": mass, "centre": centre}
            for i, (mass, centre) in enumerate(zip(MASSES.tolist(), _find_centres(true), strict=True))
        ],
        "gas_springs": [
            {
                "joint": "joint_2",
                "radius_before": balancer.radius_before,
                "radius_behind": balancer.radius_behind,
                "angle": balancer.angle,
                "area": balancer.area,
                "pressure": balancer.pressure,
                "volume": balancer.volume,
            }
        ],
    }


def _find_centres(true: MovedArm) -> list[list[float]]:
    """Return the centres of mass of the links in the frames that move with the joints [m]."""
    robot = _build_robot(document_of_logs(true, [], {}))
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, np.zeros(robot.n))
    return [data.oMi[i + 1].actInv(place).tolist() for i, place in enumerate(PLACES)]


def _build_robot(document: dict[str, Any]) -> Any:
    """Return the robot of a document."""
    from jointstiff.schemas.robot import RobotDocument

    return prepare_robot(RobotDocument.model_validate(document["robot"])).robot


def read(document: dict[str, Any]) -> MotionCampaign:
    """Return the campaign of a document."""
    request = GearboxRequest.model_validate(document)
    assert request.robot is not None
    assert request.motion is not None
    return to_motion_campaign(request, request.motion, prepare_robot(request.robot).robot)
