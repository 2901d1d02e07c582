"""Command that brings the loaded tool to where it is wanted (docs/method.md section 12).

The wanted posture is the *loaded* one. Its torques are known before any command is, so no iteration is
needed for joints: ``q_cmd = θ − c ∘ τ(θ)``. The mirror of a deflection that is computed at the wanted
posture, ``x − δ(x)``, has an error of second order. Where links bend, Newton's method finds the command.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.deflection.forward import Deflection, ForwardModel, unit_vectors
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot.configuration import Configurations, rotation_vector
from jointstiff.solver.robot.model import Robot

_BLOCK: Final = 4096
"""Postures worked on at a time: a few MB."""


@dataclass(frozen=True)
class CorrectionLimits:
    """Rules by which a correction is held back."""

    displacement: float = 5e-3  #: greatest correction of the place [m]
    rotation: float = 10e-3  #: greatest correction of the orientation [rad]
    ramp: float = 0.0  #: length of path over which the correction sets in and fades with the load [m]


@dataclass(frozen=True, eq=False)
class Compensation:
    """Commands for m wanted postures, with what they reach by the forward model of the loaded robot."""

    commanded: FloatArray  #: (m, n) angles as the controller shows them [rad]
    #: (m, 6) from the wanted to the commanded pose of the place: displacement [m], then rotation vector
    #: [rad], axes of R0
    correction: FloatArray
    #: (m, 6) from the wanted to the loaded pose under the command: the certificate [m, rad]
    residual: FloatArray
    uncorrected: FloatArray  #: (m, 6) from the wanted to the loaded pose without correction [m, rad]
    #: (m,) standard uncertainty of the deflection along itself, from the readings [m]; NaN if unknown
    uncertainty: FloatArray
    leverage: FloatArray  #: (m,) the greatest of a displacement in any direction [m]; zero if unknown
    share: FloatArray  #: (m,) share of the full correction that the command carries, 0 to 1
    uncertain: BoolArray  #: (m,) left alone, as the uncertainty of the deflection exceeds it
    capped: BoolArray  #: (m,) held back by the limits


def compensate(
    model: ForwardModel,
    wanted: LoadCases,
    limits: CorrectionLimits | None = None,
    ramp: FloatArray | None = None,
) -> Compensation:
    """Command such postures that the bent robot brings the tool to the wanted places.

    Args:
        model: of the loaded robot.
        wanted: m postures that bring the tool to the wanted places while nothing bends, in the order of the
            path: `joints` are their angles as the controller would show them, the load acts there.
        limits: by which corrections are held back.
        ramp: (m,) shares of the corrections, where the cases are a part of the path (`ramp_shares`).

    Raises:
        RequestError: a load twists a joint of which nothing is known, finds no stable balance, or cannot be
            compensated.
    """
    limits = CorrectionLimits() if limits is None else limits
    ramp = ramp_shares(model.robot, wanted, limits.ramp) if ramp is None else ramp
    parts = [_compensate_block(model, wanted[block], limits, ramp[block]) for block in _blocks(len(wanted))]
    return Compensation(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in Compensation.__dataclass_fields__
        )
    )


def _compensate_block(
    model: ForwardModel, wanted: LoadCases, limits: CorrectionLimits, ramp: FloatArray
) -> Compensation:
    robot = model.robot
    goal = Configurations(robot, robot.joint_map.model_angles(wanted.joints))
    still = _Places.of(wanted, goal)
    bare = model.deflect(wanted, goal)
    uncorrected = still.off(bare)
    if bare.unseen.any():
        raise RequestError(
            "the load or own weight twists a joint that the readings do not determine",
            where="run_id",
            remedy="choose a run whose readings determine every joint that the process loads",
        )
    uncertainty = bare.deviation_along(unit_vectors(uncorrected[:, :3]))
    uncertain = uncertainty > np.linalg.norm(uncorrected[:, :3], axis=1)
    share = np.where(uncertain, 0.0, ramp)
    under = Configurations(robot, model.command(wanted, goal, share))
    correction = still.off(_Places.of(wanted, under))
    # Share (m,) of each correction that the limits allow
    size = np.stack([np.linalg.norm(correction[:, :3], axis=1), np.linalg.norm(correction[:, 3:], axis=1)])
    most = np.array([[limits.displacement], [limits.rotation]])
    cap: FloatArray = np.min(np.where(size > most, most / np.where(size > 0.0, size, 1.0), 1.0), axis=0)
    if (cap < 1.0).any():
        held = np.where(cap[:, None] < 1.0, model.command(wanted, goal, share * cap), under.q)
        under = Configurations(robot, held)
        correction = still.off(_Places.of(wanted, under))
    return Compensation(
        commanded=robot.joint_map.controller_angles(under.q),
        correction=correction,
        residual=still.off(model.deflect(wanted, under, near=goal)),
        uncorrected=uncorrected,
        uncertainty=uncertainty,
        leverage=bare.leverage,
        share=share * cap,
        uncertain=uncertain,
        capped=cap < 1.0,
    )


@dataclass(frozen=True, eq=False)
class _Places:
    """Places (m, 3) in R0 [m] and axes (m, 3, 3) of the flange."""

    place: FloatArray
    axes: FloatArray

    @classmethod
    def of(cls, cases: LoadCases, here: Configurations) -> _Places:
        """Return the places of rigid postures."""
        return cls(here.to_base(cases.place[:, None])[:, 0], here.flange_rotation)

    def off(self, there: _Places | Deflection) -> FloatArray:
        """Return displacements [m] and rotation vectors [rad] (m, 6) from here to there."""
        turned = rotation_vector(there.axes @ self.axes.transpose(0, 2, 1))
        return np.concatenate([there.place - self.place, turned], axis=1)


def residuals(
    model: ForwardModel, wanted: LoadCases, goal: FloatArray, commanded: FloatArray, near: FloatArray
) -> FloatArray:
    """Return displacement [m] and rotation vector [rad] (m, 6) from the wanted to the loaded place.

    Args:
        model: of the loaded robot.
        wanted: m loads and places.
        goal: (m, 4, 4) wanted poses of the flange in R0 [m].
        commanded: (m, n) angles of the model without the loads [rad].
        near: (m, n) angles near the loaded postures, where the balance is looked for [rad].

    Raises:
        RequestError: a load finds no stable balance.
    """
    under, expected = (Configurations(model.robot, angles) for angles in (commanded, near))
    axes = goal[:, :3, :3]
    place = (axes @ wanted.place[..., None])[..., 0] + goal[:, :3, 3]
    return _Places(place, axes).off(model.deflect(wanted, under, expected))


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
