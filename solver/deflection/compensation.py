"""Command that brings the loaded tool to where it is wanted (docs/method.md section 13).

The wanted posture is the *loaded* one. Its torques are known before any command is, so no iteration is
needed: ``q_cmd = θ − c ∘ τ(θ)``. The mirror of a deflection that is computed at the wanted posture,
``x − δ(x)``, has an error of second order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.deflection.joint_model import JointModel
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.deflection.loaded import LoadedPosture, rotation_vector
from jointstiff.solver.deflection.own_weight import OwnWeight
from jointstiff.solver.deflection.prediction import compliance_rows
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot import Configurations, Robot

_BLOCK: Final = 4096
"""Postures worked on at a time: a few MB."""
_WEIGHT_STEPS: Final = 8
"""Steps in which the own weight of the commanded posture settles; each gains three digits."""


@dataclass(frozen=True)
class CorrectionLimits:
    """Rules by which a correction is held back.

    Attributes:
        displacement: greatest correction of the place [m].
        rotation: greatest correction of the orientation [rad].
        ramp: length of path over which the correction sets in and fades with the load [m].
    """

    displacement: float = 5e-3
    rotation: float = 10e-3
    ramp: float = 0.0


@dataclass(frozen=True, eq=False)
class Compensation:
    """Commands for m wanted postures, with what they reach by the forward model of the loaded robot.

    Attributes:
        commanded: (m, n) angles as the controller shows them [rad].
        correction: (m, 6) from the wanted to the commanded pose of the place: displacement [m], then rotation
            vector [rad], axes of R0.
        residual: (m, 6) from the wanted to the loaded pose under the command: the certificate [m, rad].
        uncorrected: (m, 6) from the wanted to the loaded pose without correction [m, rad].
        uncertainty: (m,) standard uncertainty of the deflection along itself, from the readings [m]; NaN if
            unknown.
        share: (m,) of the full correction that the command carries, 0 to 1.
        uncertain: (m,) left alone, as the uncertainty of the deflection exceeds it.
        capped: (m,) held back by the limits.
    """

    commanded: FloatArray
    correction: FloatArray
    residual: FloatArray
    uncorrected: FloatArray
    uncertainty: FloatArray
    share: FloatArray
    uncertain: BoolArray
    capped: BoolArray


def compensate(
    model: JointModel,
    wanted: LoadCases,
    limits: CorrectionLimits | None = None,
    weight: OwnWeight | None = None,
    ramp: FloatArray | None = None,
) -> Compensation:
    """Command such postures that springs and load bring the tool to the wanted ones.

    Args:
        model: elastic joints.
        wanted: m postures in which the loaded robot is to stand, in the order of the path: `joints` are their
            angles as the controller would show them, the load acts there.
        limits: by which corrections are held back.
        weight: of the links; None leaves it out, as the controller's zero has it in already.
        ramp: (m,) shares of the corrections, where the cases are a part of the path (`ramp_shares`).

    Raises:
        RequestError: a load twists a joint of which nothing is known, or finds no stable balance.
    """
    limits = CorrectionLimits() if limits is None else limits
    ramp = ramp_shares(model.robot, wanted, limits.ramp) if ramp is None else ramp
    parts = [
        _compensate_block(model, _rows(wanted, block), limits, ramp[block], weight)
        for block in _blocks(len(wanted))
    ]
    return Compensation(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in Compensation.__dataclass_fields__
        )
    )


def command(
    model: JointModel, wanted: LoadCases, share: FloatArray, weight: OwnWeight | None = None
) -> FloatArray:
    """Return ``θ − s c ∘ (τ(θ) + g(θ) − g(q_cmd))`` (m, n), angles of the model [rad].

    Args:
        model: elastic joints.
        wanted: m loaded postures.
        share: (m,) s.
        weight: of the links.
    """
    robot = model.robot
    theta = robot.joint_map.model_angles(wanted.joints)
    loaded = Configurations(robot, theta)
    torque = load_torque(wanted, loaded)
    step = share[:, None] * model.compliance
    if weight is None:
        return theta - step * torque
    own = weight.torque_and_stiffness(robot, theta, loaded)[0]
    commanded = theta - step * torque
    for _ in range(_WEIGHT_STEPS):
        rest = weight.torque_and_stiffness(robot, commanded, Configurations(robot, commanded))[0]
        commanded = theta - step * (torque + own - rest)
    return commanded


def load_torque(cases: LoadCases, here: Configurations) -> FloatArray:
    """Return the torques (m, n) [N·m] of the loads in given postures."""
    jacobian = here.jacobian_at(here.to_base(cases.load_point[:, None]))[:, 0]
    linear = np.einsum("bij,bi->bj", jacobian, cases.force)
    torque: FloatArray = linear + np.einsum("bij,bi->bj", here.angular_jacobian, cases.moment)
    return torque


def _compensate_block(
    model: JointModel, wanted: LoadCases, limits: CorrectionLimits, ramp: FloatArray, weight: OwnWeight | None
) -> Compensation:
    robot = model.robot
    goal = Configurations(robot, robot.joint_map.model_angles(wanted.joints))
    bare = LoadedPosture.of(robot, model.compliance, wanted, weight)
    uncorrected = _off(wanted, goal, bare.loaded)
    rows = compliance_rows(bare)
    if model.unseen(rows).any():
        raise RequestError(
            "the load twists a joint of which the readings say nothing",
            where="run_id",
            remedy="choose a run whose readings determine every joint that the process loads",
        )
    uncertainty = _uncertainty(model, rows[:, :3], uncorrected[:, :3])
    uncertain = uncertainty > np.linalg.norm(uncorrected[:, :3], axis=1)
    share = np.where(uncertain, 0.0, ramp)
    full = command(model, wanted, share, weight)
    size = _off(wanted, goal, Configurations(robot, full))
    cap = _cap(size, limits)
    commanded = full
    if (cap < 1.0).any():
        commanded = np.where(cap[:, None] < 1.0, command(model, wanted, share * cap, weight), full)
    shown = robot.joint_map.controller_angles(commanded)
    under = LoadedPosture.of(robot, model.compliance, replace(wanted, joints=shown), weight)
    return Compensation(
        commanded=shown,
        correction=_off(wanted, goal, under.unloaded),
        residual=_off(wanted, goal, under.loaded),
        uncorrected=uncorrected,
        uncertainty=uncertainty,
        share=share * cap,
        uncertain=uncertain,
        capped=cap < 1.0,
    )


def _off(cases: LoadCases, goal: Configurations, here: Configurations) -> FloatArray:
    """Return displacement [m] and rotation vector [rad] of the places (m, 6) from the goal to here."""
    place = cases.place[:, None]
    moved = (here.to_base(place) - goal.to_base(place))[:, 0]
    turned = rotation_vector(here.flange_rotation @ goal.flange_rotation.transpose(0, 2, 1))
    return np.concatenate([moved, turned], axis=1)


def _uncertainty(model: JointModel, rows: FloatArray, deflection: FloatArray) -> FloatArray:
    """Return the standard uncertainty (m,) [m] of the deflection along itself."""
    if model.likelihood is None:
        return np.full(len(rows), np.nan)
    size = np.linalg.norm(deflection, axis=1, keepdims=True)
    along = np.einsum("bi,bij->bj", deflection / np.where(size > 0.0, size, 1.0), rows)
    variance: FloatArray = np.einsum("bi,ij,bj->b", along, model.covariance, along)
    return np.sqrt(variance)


def _cap(correction: FloatArray, limits: CorrectionLimits) -> FloatArray:
    """Return the share (m,) of each correction that the limits allow."""
    size = np.stack([np.linalg.norm(correction[:, :3], axis=1), np.linalg.norm(correction[:, 3:], axis=1)])
    most = np.array([[limits.displacement], [limits.rotation]])
    share: FloatArray = np.min(np.where(size > most, most / np.where(size > 0.0, size, 1.0), 1.0), axis=0)
    return share


def residuals(
    model: JointModel, wanted: LoadCases, commanded: FloatArray, weight: OwnWeight | None = None
) -> FloatArray:
    """Return displacement [m] and rotation vector [rad] (m, 6) from the wanted to the loaded place.

    Args:
        model: elastic joints.
        wanted: m loaded postures.
        commanded: (m, n) angles as the controller shows them [rad].
        weight: of the links.

    Raises:
        RequestError: a load finds no stable balance.
    """
    robot = model.robot
    found = np.empty((len(wanted), 6))
    for block in _blocks(len(wanted)):
        cases = _rows(wanted, block)
        goal = Configurations(robot, robot.joint_map.model_angles(cases.joints))
        under = replace(cases, joints=commanded[block].copy())
        found[block] = _off(cases, goal, LoadedPosture.of(robot, model.compliance, under, weight).loaded)
    return found


def ramp_shares(robot: Robot, wanted: LoadCases, length: float) -> FloatArray:
    """Return the share (m,) by the length of path [m] since the load set in, and until it ends."""
    if length <= 0.0:
        return np.ones(len(wanted))
    here = Configurations(robot, robot.joint_map.model_angles(wanted.joints))
    steps = np.linalg.norm(np.diff(here.to_base(wanted.place[:, None])[:, 0], axis=0), axis=1)
    loaded = (wanted.force != 0.0).any(axis=1) | (wanted.moment != 0.0).any(axis=1)
    since = _since_start(loaded, steps)
    until = _since_start(loaded[::-1], steps[::-1])[::-1]
    share: FloatArray = np.clip(np.minimum(since, until) / length, 0.0, 1.0)
    return share


def _since_start(loaded: BoolArray, steps: FloatArray) -> FloatArray:
    """Return the length of path (m,) since the load set in; zero without load, inf from its begin."""
    length = np.zeros(len(loaded))
    length[0] = np.inf if loaded[0] else 0.0
    for i in range(1, len(loaded)):
        length[i] = length[i - 1] + steps[i - 1] if loaded[i] and loaded[i - 1] else 0.0
    return length


def _blocks(count: int) -> Iterator[slice]:
    for start in range(0, count, _BLOCK):
        yield slice(start, start + _BLOCK)


def _rows(cases: LoadCases, block: slice) -> LoadCases:
    return LoadCases(
        cases.joints[block].copy(),
        cases.force[block].copy(),
        cases.moment[block].copy(),
        cases.load_point[block].copy(),
        cases.place[block].copy(),
    )
