"""Links and coupled joints as springs of several directions (method.md §7).

``δp_X = Σ_jk J_j C_jk τ_k + Σ_i B_i C_i w_i``: coupling between joints, links. Frame i is that of joint i,
which moves with it (after its rotation); w_i is the load's wrench in it, force then moment about its origin
o_i, and ``B_i = [R_i, −[p_X − o_i]× R_i]`` moves the target with the frame.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.conic import entries, weights
from jointstiff.solver.robot.configuration import joint_frames, skew
from jointstiff.solver.terms.block import RegressorBlock
from jointstiff.solver.terms.term import Motion, Term


def link_motion(block: RegressorBlock) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return how the links' frames move the targets, and how the load pulls at them.

    Returns:
        (n, B, T, 3, 6) motion of the targets with translations, then rotations of the frame of each joint;
        (n, B, 6) wrench of the load in it, force then moment about its origin [N, N·m]; and (B, n, 3) the
        load point from the origins, axes of R0 [m].
    """
    part = block.measurements
    axes, origin = joint_frames(block.robot, block.configurations.q)
    lever = block.configurations.to_base(part.load_point[:, None]) - origin
    moment = part.moment[:, None] + np.cross(lever, part.force[:, None])
    R = axes.transpose(1, 0, 2, 3)  # (n, B, 3, 3)
    wrench = np.concatenate([part.force[:, None] @ R, moment.transpose(1, 0, 2)[:, :, None] @ R], axis=-1)
    turn = -skew(block.points - origin.transpose(1, 0, 2)[:, :, None]) @ R[:, :, None]
    moves = np.concatenate([np.broadcast_to(R[:, :, None], turn.shape), turn], axis=-1)
    return moves, wrench[:, :, 0], lever


def products(moves: FloatArray, load: FloatArray) -> FloatArray:
    """Return columns (..., k (k + 1) / 2) of ``moves C load``, both (..., k), by entries of a symmetric C."""
    size = moves.shape[-1]
    i, j = entries(size)
    # An entry off the diagonal stands for two of the matrix, each 1/√2 of it.
    both: FloatArray = moves[..., i] * load[..., j] + moves[..., j] * load[..., i]
    return both * np.where(i == j, 0.5, 1.0 / weights(size))


def _coupled(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001  # linear
    """Bend joints by the torques about others, in the order of `entries`."""
    return Motion(products(block.jacobian, block.torque[:, None, None]))


def _links(joints: tuple[int, ...], block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Bend the links behind some joints, each by 21 entries of its compliance."""
    moves, wrench, _ = link_motion(block)
    return Motion(np.concatenate([products(moves[j], wrench[j, :, None, None]) for j in joints], axis=-1))


def _diagonal_links(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Bend each link along and about the axes of its joint's frame: six compliances a link."""
    moves, wrench, _ = link_motion(block)
    return Motion(np.concatenate(list(moves * wrench[:, :, None, None]), axis=-1))


COUPLED_JOINTS = Term("coupled_joints", "rad/(N·m)", _coupled)
DIAGONAL_LINKS = Term("links", "m/N, rad/(N·m)", _diagonal_links)


def links_behind(joints: tuple[int, ...]) -> Term:
    """Return the term of full link compliances (6, 6) behind some joints."""
    return Term("links", "m/N, rad/(N·m)", partial(_links, joints))
