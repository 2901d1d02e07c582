"""Errors that a set may state, a test suspects, a budget lists and a plan hedges against (method.md §8, §13).

An error of the load adds joint torques τ, which move the targets by ``J (c ∘ τ)``, with J the targets'
Jacobian and c the compliances. Errors of the geometry concern the places of targets on the flange, the axes
of joints, the tracker and the base.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.axes import differentiate_deflection
from jointstiff.solver.mechanics.block import (
    Motion,
    RegressorBlock,
    Term,
    fitted_errors,
    move_by_torque,
    unloaded_postures,
)
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements
from jointstiff.solver.mechanics.postures import skew
from jointstiff.solver.mechanics.robot import Robot

_READ_AGAIN = (
    "read a posture again without the load: if the targets are elsewhere, the tracker or the base moved"
)
_READ_WARM = "warm the arm up, and read each posture without and with load before the next posture"
_SETTLED, _WOUND = 50.0, 3e-5
"""Torque [N·m] at which a gear lies against one side of its play at the latest, and winding [rad] of the
gear's spring at which the gear does so if the spring winds so far at a smaller torque. Makers state lost
motion at 3 % of the rated torque, which winds a gear by 30 µrad (Nabtesco RV-20E: 167 N·m at 49 N·m/arcmin;
RV-320E: 3136 N·m at 980). They do not state at which smaller torque it is taken up."""
_EXPONENT_DOUBT: Final = 0.7
"""Standard uncertainty of the exponent with which the compliance of a curved spring changes: 1 is fitted; a
cubic law has 2, the three stages of a strain wave gear 0.8."""


def _move_load_point(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to an error e (3,) [m] of the load point in the flange frame.

    The error adds the moment (R e) × F, with F the force and R the flange's rotation.
    """
    moment = -skew(block.measurements.force) @ block.postures.flange_rotation
    return move_by_torque(block, compliance, block.postures.angular_jacobian.transpose(0, 2, 1) @ moment)


def _scale_loads(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion of targets and joints per unit of a relative error of all forces and moments."""
    return move_by_torque(block, compliance, block.torque[..., None])


def _turn_loads(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion of targets and joints per radian of a turn of all loads about each axis of R0.

    A turn φ (3,) adds φ × F to the force F and φ × M to the moment M.
    """
    measurements = block.measurements
    by_force = block.load_jacobian.transpose(0, 2, 1) @ -skew(measurements.force)
    by_moment = block.postures.angular_jacobian.transpose(0, 2, 1) @ -skew(measurements.moment)
    return move_by_torque(block, compliance, by_force + by_moment)


def _add_constant_force(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to one constant force, axes of R0, added to every load."""
    return move_by_torque(block, compliance, block.load_jacobian.transpose(0, 2, 1))


def _add_flange_force(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to one constant force, axes of the flange, such as a load cell's wrong zero."""
    forces = block.load_jacobian.transpose(0, 2, 1) @ block.postures.flange_rotation
    return move_by_torque(block, compliance, forces)


def _find_rope_directions(measurements: Measurements) -> FloatArray:
    """Return the direction (N, 3) of each force, axes of R0; zero without a force."""
    size = np.linalg.norm(measurements.force, axis=1, keepdims=True)
    return measurements.force / np.where(size > 0.0, size, 1.0)


def _add_rope_force(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to one force along each rope, such as the wrong zero of the cell in the rope.

    The force z adds the torques ``z J_Fᵀ F / |F|``.
    """
    directions = _find_rope_directions(block.measurements)
    return move_by_torque(block, compliance, block.load_jacobian.transpose(0, 2, 1) @ directions[..., None])


def _add_hook_weight(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to a weight that hangs with every load: a force along −z of R0."""
    return move_by_torque(block, compliance, -block.load_jacobian.transpose(0, 2, 1)[..., 2:])


def _read_uncertainties(names: tuple[str, ...], common: CommonUncertainty) -> tuple[float, ...]:
    """Return the standard uncertainties that `common` has in the fields with the given names."""
    return tuple(getattr(common, name) for name in names)


def _move_load_points(_: Robot, measurements: Measurements, error: FloatArray) -> Measurements:
    """Return the measurements with every load point moved by an error (3,), flange frame [m]."""
    return replace(measurements, load_point=measurements.load_point + error)


def _load_with_force(_: Robot, measurements: Measurements, force: FloatArray) -> Measurements:
    """Return the measurements with a force (3,), axes of R0 [N], added to every load."""
    return replace(measurements, force=measurements.force + force)


def _load_with_flange_force(robot: Robot, measurements: Measurements, force: FloatArray) -> Measurements:
    """Return the measurements with a force (3,), axes of the flange [N], added to every load."""
    force_in_base = unloaded_postures(robot, measurements).flange_rotation @ force
    return replace(measurements, force=measurements.force + force_in_base)


def _load_along_ropes(_: Robot, measurements: Measurements, force: FloatArray) -> Measurements:
    """Return the measurements with a force (1,) along each rope [N] added to every load."""
    return replace(measurements, force=measurements.force + force * _find_rope_directions(measurements))


def _load_with_weight(_: Robot, measurements: Measurements, weight: FloatArray) -> Measurements:
    """Return the measurements with a weight (1,) [N] added to every load."""
    return replace(measurements, force=measurements.force - weight * np.array([0.0, 0.0, 1.0]))


LOAD_POINT = Term(
    "load_point",
    "m",
    _move_load_point,
    partial(_read_uncertainties, ("load_point",)),
    suspected=True,
    change_loads=_move_load_points,
    words="every load point moved by {} in the flange frame",
    remedy="measure the load point on the flange",
)
FORCE_SCALE = Term("force_scale", "1", _scale_loads, partial(_read_uncertainties, ("scale",)))
FORCE_DIRECTION = Term("force_direction", "rad", _turn_loads, partial(_read_uncertainties, ("direction",)))
CONSTANT_FORCE = Term(
    "constant_force",
    "N",
    _add_constant_force,
    suspected=True,
    change_loads=_load_with_force,
    words="a constant force of {} (axes of R0) added to every load",
    remedy="check for a weight that hangs on the flange only while loaded, and the load cell's zero",
)
LOAD_ZERO = Term(
    "load_zero",
    "N",
    _add_flange_force,
    suspected=True,
    change_loads=_load_with_flange_force,
    words="a constant force of {} (axes of the flange) added to every load",
    remedy="read the load cell without load in two postures",
)
ROPE_ZERO = Term(
    "rope_zero",
    "N",
    _add_rope_force,
    partial(_read_uncertainties, ("rope_zero",)),
    suspected=True,
    change_loads=_load_along_ropes,
    words="a force of {} along the rope added to every load",
    remedy="read the load cell without load, and tare it before each reading",
)
HOOK_WEIGHT = Term(
    "hook_weight",
    "N",
    _add_hook_weight,
    suspected=True,
    change_loads=_load_with_weight,
    nonnegative=True,
    words="a weight of {} that hangs with every load",
    remedy="weigh hook and slings, and add them to the loads",
)


Groups = tuple[tuple[str, ...], ...]
"""Labels of observations, group by group."""


def _mark_groups(groups: Groups, measurements: Measurements) -> FloatArray:
    """Return a matrix (N, g) with 1 where an observation belongs to a group of observations, else 0."""
    return np.stack([np.isin(measurements.labels, list(group)) for group in groups], axis=1).astype(
        np.float64
    )


def _scale_groups(groups: Groups, block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion of targets and joints per relative error of the loads of each group."""
    torque = block.torque[..., None] * _mark_groups(groups, block.measurements)[:, None]
    return move_by_torque(block, compliance, torque)


def _scale_loads_of_groups(
    groups: Groups, _: Robot, measurements: Measurements, relative_errors: FloatArray
) -> Measurements:
    """Return the measurements with the loads of each group multiplied by 1 + its relative error.

    `relative_errors` (g,) are those of the g groups of observations.
    """
    factor = 1.0 + _mark_groups(groups, measurements) @ relative_errors[:, None]
    return replace(measurements, force=factor * measurements.force, moment=factor * measurements.moment)


def build_load_scale_term(groups: Collection[Collection[str]]) -> Term:
    """Return the term of a relative load error for each group of observations, given by their labels."""
    listed = tuple(map(tuple, groups))
    return Term(
        "load_scale",
        "1",
        partial(_scale_groups, listed),
        suspected=True,
        change_loads=partial(_scale_loads_of_groups, listed),
        words="relative load errors of {}, one for each group of loads,",
        remedy="weigh the loads, or check the load cell against a known weight",
    )


def _move_target_places(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to errors e of the T targets' places on the flange, three unknowns for each [m].

    When the flange turns by φ under load, a target whose place is wrong by e moves too far, by φ × e.
    """
    rotation = np.einsum("bij,bj->bi", block.postures.angular_jacobian, compliance * block.torque)
    motion_per_error = skew(rotation) @ block.postures.flange_rotation
    B, T = block.points.shape[:2]
    columns = np.zeros((B, T, 3, T, 3))
    columns[:, np.arange(T), :, np.arange(T)] = motion_per_error  # an error moves its own target only
    return Motion(columns.reshape(B, T, 3, 3 * T))


def _displace_axes(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to displacements of the joints' axes, four for each joint [m, rad, m, rad].

    The four are a translation along, then a rotation about the first and the second direction across the
    axis.
    """
    targets, joints = [], []
    for j, axis in enumerate(block.robot.axes):
        first, second = np.linalg.svd(axis[None])[2][1:]  # unit vectors perpendicular to the axis
        across = np.zeros((6, 4))
        across[:3, 0] = across[3:, 1] = first
        across[:3, 2] = across[3:, 3] = second
        change, torque = differentiate_deflection(block, compliance, j, across)
        targets.append(change)
        joints.append(compliance[:, None] * torque)
    return Motion(np.concatenate(targets, axis=-1), np.concatenate(joints, axis=-1))


def _compute_settling(block: RegressorBlock, compliance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by how much of half its play each gear turns (B, n), and the standard uncertainty of this share.

    A gear turns in proportion to its torque τ up to the torque s that takes up its play. This torque is
    uncertain, with a uniform distribution from 0 to the s_max of makers' data: with x = |τ| / s_max ≤ 1 the
    mean share is ``x (1 − ln x)``, and the mean of its square ``2 x − x²``.
    """
    # A soft gear's spring winds by _WOUND before the torque reaches _SETTLED.
    # (n,) torques that take up the play [N·m]
    settling_torque = _WOUND / np.maximum(compliance, _WOUND / _SETTLED)
    relative_torque = np.clip(np.abs(block.torque) / settling_torque, np.finfo(float).tiny, 1.0)
    mean_share = relative_torque * (1.0 - np.log(relative_torque))
    torque_sign = np.where(block.robot.prismatic, 0.0, np.sign(block.torque))
    return torque_sign * mean_share, torque_sign * np.sqrt(
        np.maximum(2.0 * relative_torque - relative_torque**2 - mean_share**2, 0.0)
    )


def _turn_joints(block: RegressorBlock, turn: FloatArray) -> Motion:
    """Return the motion of targets and joints if each joint turns by a given angle per unit of its unknown.

    `turn` (B, n) are these angles [rad].
    """
    return Motion(block.jacobian * turn[:, None, None], turn[..., None] * np.eye(turn.shape[1]))


def _take_up_play(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to gear play: each joint turns by half the play in the torque's direction."""
    return _turn_joints(block, 0.5 * _compute_settling(block, compliance)[0])


def _settle_elsewhere(play: FloatArray, block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion per unit of an unknown: each gear takes up its play at another torque than expected.

    `play` (n,) are the plays of the gears [rad].
    """
    return _turn_joints(block, 0.5 * play * _compute_settling(block, compliance)[1])


def _state_as_standard(_: CommonUncertainty) -> tuple[float, ...]:
    """Return the standard uncertainty 1, for unknowns that are in units of their standard uncertainty."""
    return (1.0,)


def _doubt_settling(play: FloatArray) -> Term:
    """Return the term for the unknown torques at which gears take up their play (n,) [rad]."""
    return Term("settling", "1", partial(_settle_elsewhere, play), _state_as_standard)


def _curve_springs(largest: FloatArray, block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to curved springs: ``δθ = c τ (1 + h |τ| / τ_max)`` for each joint.

    The unknown h is the relative change of the compliance from small torques to the joint's largest torque
    τ_max, in `largest` (n,) [N·m]; springs that harden have h < 0.
    """
    return _turn_joints(block, compliance * block.torque * np.abs(block.torque) / largest)


def _curve_otherwise(
    largest: FloatArray, change: FloatArray, block: RegressorBlock, compliance: FloatArray
) -> Motion:
    """Return the motion due to springs curved by another power of the torque: of ``h xᵐ``, x = |τ| / τ_max.

    The derivative by m at 1 is ``h x ln x``, with h the relative change (n,) of the compliance.
    """
    x = np.maximum(np.abs(block.torque) / largest, np.finfo(float).tiny)
    return _turn_joints(block, _EXPONENT_DOUBT * change * compliance * block.torque * x * np.log(x))


def _doubt_curve(largest: FloatArray, change: FloatArray) -> Term:
    """Return the term for the unknown shape of springs that are not linear.

    Args:
        largest: (n,) largest torque of each joint [N·m].
        change: (n,) relative change of each joint's compliance up to this torque.
    """
    return Term("curve_shape", "1", partial(_curve_otherwise, largest, change), _state_as_standard)


def build_curve_term(largest: FloatArray) -> Term:
    """Return the term for springs that are not linear; `largest` (n,) are the largest torques [N·m]."""
    nonzero_torques = np.where(largest > 0.0, largest, 1.0)
    return Term(
        "curved_springs",
        "1",
        partial(_curve_springs, nonzero_torques),
        suspected=True,
        doubt=partial(_doubt_curve, nonzero_torques),
        words="compliances that differ by {} between no torque and the largest torque of each joint",
        remedy="read the same posture at half the load: a hardening spring deflects by more than half",
    )


def _shift_readings(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Return the motion due to a shift of all readings under load, as if tracker or base moved."""
    return Motion(np.broadcast_to(np.eye(3), (*block.points.shape, 3)))


def _drift_readings(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to a drift of all readings under load that grows with the order of reading.

    The unknowns are the drift from one observation to the next along each axis of R0 [m].
    """
    shift = _shift_readings(block, compliance).targets
    return Motion(block.measurements.order[:, None, None, None] * shift)


def _grow_arm(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Return the motion due to a growth of the arm, per strain: each target moves away from R0's origin."""
    return Motion(block.points[..., None])


def _grow_arm_steadily(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to a growth of the arm that increases by a strain with each observation."""
    growth = _grow_arm(block, compliance).targets
    return Motion(block.measurements.order[:, None, None, None] * growth)


def _bend_tool(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Return the motion due to a tool that bends between the flange and the targets on the tool.

    A force F moves the targets by F per unit of the first compliance [m/N]. The moment M about the origin of
    the flange turns them, by ``M × r`` per unit of the second compliance [rad/(N·m)], with r from this origin
    to the target.
    """
    measurements, postures = block.measurements, block.postures
    origin = postures.flange_translation
    to_load_point = postures.to_base(measurements.load_point[:, None])[:, 0] - origin
    moment = measurements.moment + np.cross(to_load_point, measurements.force)
    levers = block.points - origin[:, None]
    by_force = np.broadcast_to(measurements.force[:, None], levers.shape)
    by_moment = np.cross(moment[:, None], levers)
    return Motion(np.stack([by_force, by_moment], axis=-1))


def _soften_joints(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Return the motion of targets and joints per change of each joint's compliance."""
    return _turn_joints(block, block.torque)


def _shift_and_turn_readings(pivot: FloatArray, block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion due to a shift of all readings under load and a turn about a pivot (3,) in R0 [m]."""
    turned = -skew(block.points - pivot)
    return Motion(np.concatenate([_shift_readings(block, compliance).targets, turned], axis=-1))


def build_turn_term(pivot: FloatArray) -> Term:
    """Return the term of a shift of all readings under load, and a turn about a pivot (3,) in R0 [m].

    The same pivot gives the same term, so that kept columns are found again.
    """
    return _build_turn_term(tuple(pivot.tolist()))


@lru_cache(maxsize=32)
def _build_turn_term(pivot: tuple[float, ...]) -> Term:
    """Return the term of a shift and a turn about a pivot in R0 [m]; terms of the last pivots are kept."""
    return Term(
        "turn",
        "m, rad",
        partial(_shift_and_turn_readings, np.array(pivot)),
        suspected=True,
        words="a shift and turn of all readings under load by {}",
        remedy=_READ_AGAIN,
    )


def _move_only_observations(
    labels: Sequence[str],
    motion: Callable[[RegressorBlock, FloatArray], Motion],
    block: RegressorBlock,
    compliance: FloatArray,
) -> Motion:
    """Return the motion due to a term's `motion`; zero for observations not among `labels`."""
    is_concerned = np.isin(block.measurements.labels, labels)
    targets, joints = motion(block, compliance)
    if joints is not None:
        joints = np.where(is_concerned[:, None, None], joints, 0.0)
    return Motion(np.where(is_concerned[:, None, None, None], targets, 0.0), joints)


def limit_to_later(term: Term, labels: Sequence[str], first: str) -> Term:
    """Return a copy of a term that acts only on the observation `first` and on all later observations.

    A load scale becomes two scales: one for the loads before `first`, one for the loads from `first` on.
    """
    row = labels.index(first)
    later, label = labels[row:], first.replace("{", "{{").replace("}", "}}")  # words are a format string
    words = f"{term.words} since observation '{label}'"
    limited = (
        build_load_scale_term([labels[:row], later])
        if term.name == "load_scale"
        else replace(term, motion=partial(_move_only_observations, later, term.motion))
    )
    return replace(limited, name=f"{term.name} since {first}", words=words)


TARGET_PLACES = Term(
    "target_places", "m", _move_target_places, partial(_read_uncertainties, ("target_places",))
)
AXES = Term(
    "axes", "m, rad", _displace_axes, partial(_read_uncertainties, ("axis_position", "axis_direction"))
)
PLAY = Term(
    "play",
    "rad",
    _take_up_play,
    suspected=True,
    nonnegative=True,
    doubt=_doubt_settling,
    words="play of {} in the gears",
    remedy="read the same posture at half the load: the play stays the same, and a spring deflects by half",
)
SHIFT = Term(
    "shift",
    "m",
    _shift_readings,
    suspected=True,
    words="a shift of all readings under load by {}",
    remedy=_READ_AGAIN,
)
GROWTH = Term(
    "growth",
    "m/m",
    _grow_arm,
    suspected=True,
    words="a growth of the arm by {} between the readings without and with load",
    remedy=_READ_WARM,
)
GROWTH_OVER_TIME = Term(
    "growth_over_time",
    "m/m",
    _grow_arm_steadily,
    suspected=True,
    words="a growth of the arm between the readings without and with load that increases by {} with each "
    "observation",
    remedy=_READ_WARM,
)
TOOL = Term(
    "tool",
    "m/N, rad/(N·m)",
    _bend_tool,
    suspected=True,
    nonnegative=True,
    words="a tool that yields between flange and targets by {}",
    remedy="put the targets on the flange, or read one target on the flange with the others",
)
STIFFNESS = Term(
    "stiffness",
    "rad/(N·m)",
    _soften_joints,
    words="compliances of the joints that differ by {}",
    remedy="identify the observations before and after apart, and look for what changed on the arm",
)
"""It is suspected from a later observation on; from the first on, it is the joints themselves."""
DRIFT = Term("drift", "m", _drift_readings, partial(_read_uncertainties, ("drift",)))


def _move_by_each_joint(term: Term, block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Return the motion due to a term at unit compliance of each joint: n times the term's columns."""
    motions = [term.motion(block, unit) for unit in np.eye(block.robot.n)]
    by_joint = [motion.joints for motion in motions if motion.joints is not None]
    targets = np.concatenate([motion.targets for motion in motions], axis=-1)
    return Motion(targets, np.concatenate(by_joint, axis=-1) if by_joint else None)


BY_JOINT: Final[dict[str, Term]] = {
    term.name: replace(
        term, name=f"{term.name}_by_joint", motion=partial(_move_by_each_joint, term), suspected=False
    )
    for term in (LOAD_POINT, FORCE_DIRECTION)
}
"""Errors of the load with columns at unit compliance of each joint, by the name of the error: their motion is
linear in the compliances."""

TERMS: Final[dict[str, Term]] = {
    term.name: term
    for term in (
        FORCE_SCALE,
        FORCE_DIRECTION,
        LOAD_POINT,
        CONSTANT_FORCE,
        LOAD_ZERO,
        ROPE_ZERO,
        HOOK_WEIGHT,
        TOOL,
        PLAY,
        SHIFT,
        GROWTH,
        GROWTH_OVER_TIME,
        DRIFT,
        TARGET_PLACES,
        AXES,
    )
}
"""Errors by name. A budget lists an error if the readings state its uncertainty."""


def list_stated_terms(measurements: Measurements) -> tuple[Term, ...]:
    """List the systematic errors that are fitted together with the compliances.

    These are the errors whose standard uncertainty is stated. Left out are errors that an earlier fit has
    already estimated, and the common scale of all loads: readings cannot distinguish it from the compliances.
    """
    left_out = {FORCE_SCALE.name}
    left_out.update(term.name for term in fitted_errors(measurements).terms)
    stated_terms = list[Term]()
    for term in TERMS.values():
        uncertainties = term.prior(measurements.common_uncertainty)  # of its unknowns; 0 where not stated
        if any(uncertainties) and term.name not in left_out:
            stated_terms.append(term)
    return tuple(stated_terms)
