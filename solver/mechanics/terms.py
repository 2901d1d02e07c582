"""Errors that a set may state, a test suspects, a budget lists and a plan hedges against (method.md §8, §13).

Of the load: with W = (F, M), J_F and J_ω its Jacobians, R the flange's rotation and c the compliances, each
error adds torques τ, which move the targets by ``J (c ∘ τ)``. Of geometry: places of targets on the flange,
axes of joints, tracker and base.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.axes import displaced_deflection
from jointstiff.solver.mechanics.block import (
    Motion,
    RegressorBlock,
    Term,
    by_torque,
    unloaded_postures,
)
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements
from jointstiff.solver.mechanics.postures import skew
from jointstiff.solver.mechanics.robot import Robot

_READ_AGAIN = "read a posture again without the load: if it is elsewhere, tracker or base moved"
_SETTLED, _WOUND = 50.0, 3e-5
"""Torque [N·m], or winding of its spring [rad] where that is less, at which a gear lies against one side of
its play; below it, in proportion. Makers state lost motion at 3 % of the rated torque, which winds a gear by
30 µrad (Nabtesco RV-20E: 167 N·m at 49 N·m/arcmin; RV-320E: 3136 N·m at 980)."""


def _load_point(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Move the load point by e along the flange's axes: it adds the moment e × F."""
    moment = -skew(block.measurements.force) @ block.postures.flange_rotation
    return by_torque(block, compliance, block.postures.angular_jacobian.transpose(0, 2, 1) @ moment)


def _force_scale(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Scale all forces and moments."""
    return by_torque(block, compliance, block.torque[..., None])


def _force_direction(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Turn all forces and moments about the axes of R0: φ × F, φ × M."""
    part = block.measurements
    by_force = block.load_jacobian.transpose(0, 2, 1) @ -skew(part.force)
    by_moment = block.postures.angular_jacobian.transpose(0, 2, 1) @ -skew(part.moment)
    return by_torque(block, compliance, by_force + by_moment)


def _constant_force(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Add one force, axes of R0, to every load."""
    return by_torque(block, compliance, block.load_jacobian.transpose(0, 2, 1))


def _load_zero(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Add one force, axes of the flange, to every load: the zero of a load cell that turns with it."""
    forces = block.load_jacobian.transpose(0, 2, 1) @ block.postures.flange_rotation
    return by_torque(block, compliance, forces)


def _stated(names: tuple[str, ...], common: CommonUncertainty) -> tuple[float, ...]:
    return tuple(getattr(common, name) for name in names)


def _with_load_point(_: Robot, part: Measurements, error: FloatArray) -> Measurements:
    return replace(part, load_point=part.load_point + error)


def _with_force(_: Robot, part: Measurements, force: FloatArray) -> Measurements:
    return replace(part, force=part.force + force)


def _with_flange_force(robot: Robot, part: Measurements, force: FloatArray) -> Measurements:
    turned = unloaded_postures(robot, part).flange_rotation @ force
    return replace(part, force=part.force + turned)


LOAD_POINT = Term(
    "load_point",
    "m",
    _load_point,
    partial(_stated, ("load_point",)),
    suspected=True,
    under=_with_load_point,
    words="every load point moved by {} in the flange frame",
    remedy="measure the load point on the flange",
)
FORCE_SCALE = Term("force_scale", "1", _force_scale, partial(_stated, ("scale",)))
FORCE_DIRECTION = Term("force_direction", "rad", _force_direction, partial(_stated, ("direction",)))
CONSTANT_FORCE = Term(
    "constant_force",
    "N",
    _constant_force,
    suspected=True,
    under=_with_force,
    words="a constant force of {} (axes of R0) added to every load",
    remedy="check for a weight that hangs on the flange only while loaded, and the load cell's zero",
)
LOAD_ZERO = Term(
    "load_zero",
    "N",
    _load_zero,
    suspected=True,
    under=_with_flange_force,
    words="a constant force of {} (axes of the flange) added to every load",
    remedy="read the load cell without load in two postures",
)


Groups = tuple[tuple[str, ...], ...]
"""Labels of observations, group by group."""


def _membership(groups: Groups, part: Measurements) -> FloatArray:
    """Return the group of each observation as (N, g) of 1 or 0."""
    return np.stack([np.isin(part.labels, list(group)) for group in groups], axis=1).astype(np.float64)


def _group_scale(groups: Groups, block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Scale forces and moments of each group."""
    torque = block.torque[..., None] * _membership(groups, block.measurements)[:, None]
    return by_torque(block, compliance, torque)


def _with_scale(groups: Groups, _: Robot, part: Measurements, scale: FloatArray) -> Measurements:
    factor = 1.0 + _membership(groups, part) @ scale[:, None]
    return replace(part, force=factor * part.force, moment=factor * part.moment)


def load_scale(groups: Collection[Collection[str]]) -> Term:
    """Return the term of a scale of its own for each group of loads, by the labels of their observations."""
    listed = tuple(map(tuple, groups))
    return Term(
        "load_scale",
        "1",
        partial(_group_scale, listed),
        suspected=True,
        under=partial(_with_scale, listed),
        words="the loads scaled by {}, one group after the other,",
        remedy="weigh the loads, or check the load cell against one of them",
    )


def _target_places(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Move each target by e along the flange's axes: with the flange's rotation φ it moves by φ × e."""
    rotation = np.einsum("bij,bj->bi", block.postures.angular_jacobian, compliance * block.torque)
    moved = skew(rotation) @ block.postures.flange_rotation
    B, T = block.points.shape[:2]
    columns = np.zeros((B, T, 3, T, 3))
    columns[:, np.arange(T), :, np.arange(T)] = moved
    return Motion(columns.reshape(B, T, 3, 3 * T))


def _axes(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Move each axis along both directions across it, and turn it about them: [m, rad, m, rad] a joint."""
    targets, joints = [], []
    for j, axis in enumerate(block.robot.axes):
        first, second = np.linalg.svd(axis[None])[2][1:]
        across = np.zeros((6, 4))
        across[:3, 0] = across[3:, 1] = first
        across[:3, 2] = across[3:, 3] = second
        change, torque = displaced_deflection(block, compliance, j, across)
        targets.append(change)
        joints.append(compliance[:, None] * torque)
    return Motion(np.concatenate(targets, axis=-1), np.concatenate(joints, axis=-1))


def _play(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Turn each joint through half of its gear's play, to the side that the torque pushes it."""
    settled = _WOUND / np.maximum(compliance, _WOUND / _SETTLED)  # (n,) torques
    side = np.where(block.robot.prismatic, 0.0, 0.5 * np.clip(block.torque / settled, -1.0, 1.0))
    return Motion(block.jacobian * side[:, None, None], side[..., None] * np.eye(side.shape[1]))


def _shift(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Shift what was read under load: tracker or base moved."""
    return Motion(np.broadcast_to(np.eye(3), (*block.points.shape, 3)))


def _turn(pivot: FloatArray, block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Shift what was read under load, and turn it about a pivot."""
    turned = -skew(block.points - pivot)
    return Motion(np.concatenate([_shift(block, compliance).targets, turned], axis=-1))


def turn_about(pivot: FloatArray) -> Term:
    """Return the term of a shift and a turn, about a pivot (3,) in R0 [m], of what was read under load."""
    return Term(
        "turn",
        "m, rad",
        partial(_turn, pivot),
        suspected=True,
        words="what was read under load moved by {}",
        remedy=_READ_AGAIN,
    )


def _only_observations(
    labels: Sequence[str],
    motion: Callable[[RegressorBlock, FloatArray], Motion],
    block: RegressorBlock,
    compliance: FloatArray,
) -> Motion:
    """Move the targets of the observations of some labels only."""
    moved = np.isin(block.measurements.labels, labels)
    return Motion(np.where(moved[:, None, None, None], motion(block, compliance).targets, 0.0))


def since(term: Term, labels: Sequence[str], first: str) -> Term:
    """Return a term that came about with an observation: it moves the targets of this and later ones only.

    Loads before and after have a scale of their own each.
    """
    row = labels.index(first)
    later, label = labels[row:], first.replace("{", "{{").replace("}", "}}")  # words are a format
    words = f"{term.words} since observation '{label}'"
    own = (
        load_scale([labels[:row], later])
        if term.name == "load_scale"
        else replace(term, motion=partial(_only_observations, later, term.motion))
    )
    return replace(own, name=f"{term.name} since {first}", words=words)


TARGET_PLACES = Term("target_places", "m", _target_places, partial(_stated, ("target_places",)))
AXES = Term("axes", "m, rad", _axes, partial(_stated, ("axis_position", "axis_direction")))
PLAY = Term(
    "play",
    "rad",
    _play,
    suspected=True,
    nonnegative=True,
    words="play of {} in the gears",
    remedy="read the same posture at half the load: play stays, and a spring bends by half",
)
SHIFT = Term(
    "shift",
    "m",
    _shift,
    suspected=True,
    words="what was read under load moved by {}",
    remedy=_READ_AGAIN,
)

TERMS: Final[dict[str, Term]] = {
    term.name: term
    for term in (
        FORCE_SCALE,
        FORCE_DIRECTION,
        LOAD_POINT,
        CONSTANT_FORCE,
        LOAD_ZERO,
        PLAY,
        SHIFT,
        TARGET_PLACES,
        AXES,
    )
}
"""Errors by name. Each has its line in the budget where the readings state its uncertainty."""
