"""Simulated weight steps: arms, cobots, and the mistakes of the people who measure them."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Final

import numpy as np

import jointstiff as js
from jointstiff.schemas.gearbox import GearboxRequest
from jointstiff.schemas.plan import PlanResult
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.gearbox import to_weight_step
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator import SpringArm, default_arm
from jointstiff.simulator.document import robot_document
from jointstiff.simulator.weight_step import Gears, SteppedArm, simulate_weight_step
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.gearboxes.step import WeightStep

Document = dict[str, Any]
JOINTS: Final = (1, 2)
"""Joints with two encoders."""
POSTURES: Final = 12
PLACE: Final = np.array([0.0, 0.0, 0.15])
OWN_MASSES: Final = np.array([0.0, 250.0, 150.0, 50.0, 20.0, 10.0])
"""Masses of the arm's own bodies [kg]."""
PLANS: Final = 4
"""Number of plans that the simulated steps share."""
CANDIDATES: Final = 1000
ARM_LOAD, COBOT_LOAD = 100.0, 5.0
"""Masses of the loads [kg]."""
MASS_UNCERTAINTY: Final = 0.003
"""Standard uncertainty of the mass, relative to it."""
PLACE_UNCERTAINTY: Final = 0.006
"""Standard uncertainty of each coordinate of the load's place [m]."""
ARM_NOISE, COBOT_NOISE = 3e-6, 24e-6
"""Standard deviations of a step of a twist, median of the simulated steps [rad]."""
COBOT_STIFFNESS: Final = 2.5e4
COBOT_SIZE: Final = 0.37
"""Size of a cobot, in that of the arm."""


@dataclass(frozen=True)
class Simulated:
    """A weight step with what is true."""

    document: Document
    stiffness: FloatArray  # (6,) of all gearboxes [N·m/rad]


def build_arm(*, is_cobot: bool) -> SpringArm:
    """Return the arm with typical stiffnesses, or a small and soft one."""
    arm = default_arm()
    if not is_cobot:
        return replace(arm, payload=1.2 * ARM_LOAD)
    return replace(
        arm,
        axis_points=COBOT_SIZE * np.array(arm.axis_points),
        flange_translation=COBOT_SIZE * np.array(arm.flange_translation),
        stiffnesses=np.full(len(arm.stiffnesses), COBOT_STIFFNESS),
        payload=1.2 * COBOT_LOAD,
    )


@cache
def plan(seed: int, *, is_cobot: bool = False, noise: float | None = None) -> PlanResult:
    """Return a plan of a weight step, by the command's planner, typical stiffnesses and noise [rad]."""
    arm = build_arm(is_cobot=is_cobot)
    mass = COBOT_LOAD if is_cobot else ARM_LOAD
    names = [arm.joint_names[joint] for joint in JOINTS]
    planned = js.plan(
        RobotDocument.model_validate(robot_document(arm)),
        units="m, rad, N, N.m",
        weight_step={
            "mass": mass,
            "mass_uncertainty": MASS_UNCERTAINTY * mass,
            "point_uncertainty": PLACE_UNCERTAINTY,
            **({} if noise is None else {"noise": noise}),
        },
        load_point=PLACE.tolist(),
        joints=names,
        stiffness={name: float(arm.stiffnesses[joint]) for name, joint in zip(names, JOINTS, strict=True)},
        readings=POSTURES,
        candidates=CANDIDATES,
        seed=seed,
    )
    assert planned.result is not None
    return planned.result


def simulate(
    seed: int, *, is_planned: bool = True, is_cobot: bool = False, postures: int = POSTURES
) -> Simulated:
    """Return the weight step of a random arm, whose load is as uncertain as it states.

    Args:
        seed: of the arm, its gears, the load and the postures.
        is_planned: whether the postures are planned, or random.
        is_cobot: whether the arm is small, soft and has much play.
        postures: number of random postures.
    """
    draw = np.random.default_rng([seed, 93])
    arm, mass, share = build_arm(is_cobot=is_cobot), ARM_LOAD, 1.0
    stiffness = np.array(arm.stiffnesses) * np.exp(draw.uniform(-0.5, 0.5, 6))
    gears = Gears(lost_motion=draw.uniform(5e-6, 20e-6))
    if is_cobot:
        mass, share = COBOT_LOAD, 0.05
        gears = Gears(draw.uniform(30e-6, 150e-6), (150e-6,), (52,), drift=50e-6, encoder_noise=14e-6)
    arm = replace(arm, stiffnesses=stiffness, payload=1.2 * mass)
    true = SteppedArm(
        arm,
        mass * (1.0 + draw.normal(0.0, MASS_UNCERTAINTY)),
        PLACE + draw.normal(0.0, PLACE_UNCERTAINTY, 3),
        share * OWN_MASSES,
    )
    lower, upper = np.array(arm.limits).T
    candidates = draw.uniform(lower, upper, (300, 6))
    chosen = candidates[:postures]
    if is_planned:
        chosen = np.array([each.joints for each in plan(seed % PLANS, is_cobot=is_cobot).readings])
    document = simulate_weight_step(true, chosen, JOINTS, gears, draw, link_holds=bool(seed % 2))
    document["load"] = {
        "mass": mass,
        "mass_uncertainty": MASS_UNCERTAINTY * mass,
        "point": PLACE.tolist(),
        "point_uncertainty": PLACE_UNCERTAINTY,
    }
    return Simulated(document, stiffness)


def read(document: Document) -> WeightStep:
    """Return the weight step of a document."""
    request = GearboxRequest.model_validate(document)
    assert request.robot is not None
    assert request.load is not None
    return to_weight_step(request, request.load, prepare_robot(request.robot).robot)


def _readings(document: Document) -> list[Document]:
    """Return all readings of a document."""
    return [reading for posture in document["observations"] for reading in posture["encoder_readings"]]


def _weight_for_mass(document: Document, _draw: np.random.Generator) -> None:
    document["load"]["mass"] *= 9.80665
    document["load"]["mass_uncertainty"] *= 9.80665


def _other_sign(document: Document, _draw: np.random.Generator) -> None:
    for reading in _readings(document):
        if reading["joint"] == "joint_3":
            for state in ("unloaded", "loaded"):
                reading[state] = {name: -angle for name, angle in reading[state].items()}


def _states_exchanged(document: Document, _draw: np.random.Generator) -> None:
    for reading in _readings(document):
        reading["unloaded"], reading["loaded"] = reading["loaded"], reading["unloaded"]


def _load_not_hung(step: int) -> Callable[[Document, np.random.Generator], None]:
    def mistake(document: Document, draw: np.random.Generator) -> None:
        for posture in document["observations"][::step]:
            for reading in posture["encoder_readings"]:
                reading["loaded"] = {
                    name: angle + draw.normal(0.0, 2e-6) for name, angle in reading["unloaded"].items()
                }

    return mistake


def _another_posture(document: Document, _draw: np.random.Generator) -> None:
    document["observations"][4]["joints"] = document["observations"][7]["joints"]


def _rolled_postures(document: Document, _draw: np.random.Generator) -> None:
    joints = [posture["joints"] for posture in document["observations"]]
    for posture, other in zip(document["observations"], joints[1:] + joints[:1], strict=True):
        posture["joints"] = other


def _rolled_readings(document: Document, _draw: np.random.Generator) -> None:
    postures = document["observations"]
    loaded = [[reading["loaded"] for reading in posture["encoder_readings"]] for posture in postures]
    for posture, others in zip(postures, loaded[1:] + loaded[:1], strict=True):
        for reading, other in zip(posture["encoder_readings"], others, strict=True):
            reading["loaded"] = other


def _sides_exchanged(document: Document, _draw: np.random.Generator) -> None:
    for reading in _readings(document):
        reading["approach"] = "-" if reading["approach"] == "+" else "+"


def _one_side_said_as_two(document: Document, draw: np.random.Generator) -> None:
    for posture in document["observations"]:
        readings = posture["encoder_readings"]
        for positive, negative in zip(readings[::2], readings[1::2], strict=True):
            for state in ("unloaded", "loaded"):
                negative[state] = {
                    name: angle + draw.normal(0.0, 1.7e-6) for name, angle in positive[state].items()
                }


def _referenced_anew(document: Document, _draw: np.random.Generator) -> None:
    for reading in _readings(document):
        if reading["joint"] == "joint_2":
            reading["loaded"]["link"] += 1e-3


def _degrees(document: Document, _draw: np.random.Generator) -> None:
    for reading in _readings(document):
        for state in ("unloaded", "loaded"):
            reading[state] = {name: float(np.degrees(angle)) for name, angle in reading[state].items()}


def _unknown_side(document: Document, _draw: np.random.Generator) -> None:
    for posture in document["observations"]:
        posture["encoder_readings"] = posture["encoder_readings"][::2]
        for reading in posture["encoder_readings"]:
            reading["approach"] = None


MISTAKES: Final[dict[str, Callable[[Document, np.random.Generator], None]]] = {
    "weight in N for the mass": _weight_for_mass,
    "sign of an encoder": _other_sign,
    "states exchanged": _states_exchanged,
    "load not hung in half the postures": _load_not_hung(2),
    "load never hung": _load_not_hung(1),
    "another posture": _another_posture,
    "postures rolled": _rolled_postures,
    "readings under load rolled": _rolled_readings,
    "sides exchanged": _sides_exchanged,
    "one side said as two": _one_side_said_as_two,
    "an encoder referenced anew": _referenced_anew,
    "degrees for radians": _degrees,
    "side not said": _unknown_side,
}
"""Mistakes in a document, by name."""


def with_mistake(document: Document, name: str, seed: int = 0) -> Document:
    """Return a copy of a document with a mistake."""
    changed = copy.deepcopy(document)
    MISTAKES[name](changed, np.random.default_rng(seed))
    return changed
