"""Joints, coupled joints, links and the base as springs, and how torques change (method.md §2, §7).

The deflection of target X is ``δp_X = Σ_jk J_j C_jk τ_k + Σ_i B_i C_i w_i``: the first sum is that of coupled
joints, the second that of links. Frame i moves with joint i (after the joint's rotation); w_i is the wrench
of the load in frame i, force, then moment about the origin o_i; ``B_i = [R_i, −[p_X − o_i]× R_i]`` moves the
target with the frame. The base is a further elastic element below joint 1, with the frame R0, which turns
with no joint.

Complementary stiffness: Chen & Kao, *Conservative congruence transformation for joint and Cartesian stiffness
matrices of robotic hands and fingers*, Int. J. Robotics Research 19(9), 2000: ``(K_θ − K_c) δθ = τ`` with
K_c = ∂τ/∂θ for a wrench W whose force and moment keep their size and direction in R0, while the load point
moves with the flange. A dead force has a potential, so its share of K_c is symmetric; a dead moment has none.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.mechanics.block import Motion, RegressorBlock, Term


def _bend_joints(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001  # linear
    """Return the motion per unit of joint compliances: ``J diag(τ)`` of targets, ``diag(τ)`` of joints."""
    if block.measurements.encoders is None:
        return Motion(block.A)
    return Motion(block.A, block.torque[..., None] * np.eye(block.torque.shape[1]))


def _bend_structure(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001  # linear
    """Return the motion per unit of compliances behind the encoders, which only the targets see."""
    return Motion(block.A)


def _turn_joints(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001  # kinematics
    """Return the motion of the targets per unit turn of each joint: the Jacobian J, whatever the load."""
    return Motion(block.jacobian)


JOINTS = Term("joints", "rad/(N·m)", _bend_joints)
STRUCTURE = Term("structure", "rad/(N·m)", _bend_structure)
"""What bends about the axis of a joint behind its encoder: bearings and housings."""
TURNS = Term("turns", "rad", _turn_joints)
"""Turns of the joints [rad], independent of torques."""


BASE: Final = -1
"""Index of the base among the frames of elastic elements: the base is the last, after all joints."""


@lru_cache(maxsize=64)
def triangle_indices(size: int) -> tuple[IndexArray, IndexArray]:
    """Return the row indices and the column indices of the upper triangle of a symmetric matrix.

    The ``size · (size + 1) / 2`` entries of the triangle are in the order (0,0), (0,1), (1,1), (0,2), …, that
    of Clarabel's cone of symmetric matrices, which are stated as vectors of these entries.
    """
    lower_rows, lower_columns = np.tril_indices(size)
    for indices in (lower_rows, lower_columns):
        indices.setflags(write=False)
    # The lower triangle row by row, with rows and columns exchanged, is the upper triangle column by column.
    return lower_columns, lower_rows


@lru_cache(maxsize=64)
def triangle_weights(size: int) -> FloatArray:
    """Return the factors of a symmetric matrix's entries as a vector: 1 on the diagonal, √2 elsewhere.

    With these factors, the inner product of two vectors equals the inner product of their matrices.
    """
    rows, columns = triangle_indices(size)
    weights: FloatArray = np.where(rows == columns, 1.0, np.sqrt(2.0))
    weights.setflags(write=False)
    return weights


def differentiate_bilinear_form(moves: FloatArray, load: FloatArray) -> FloatArray:
    """Return the derivative of ``movesᵀ C load`` with respect to the entries of a symmetric matrix C (k, k).

    `moves` and `load` are (..., k), the derivative is (..., k (k + 1) / 2). The entries are those of the
    upper triangle of C, in the order of `triangle_indices`, with entries off the diagonal times √2.
    """
    size = moves.shape[-1]
    i, j = triangle_indices(size)
    # An entry of the vector off the diagonal represents two entries of the matrix, each 1/√2 as large.
    # On the diagonal the two products are equal, and the factor 0.5 counts them once.
    products: FloatArray = moves[..., i] * load[..., j] + moves[..., j] * load[..., i]
    return products * np.where(i == j, 0.5, 1.0 / triangle_weights(size))


def _bend_coupled_joints(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001  # linear
    """Return the targets' motion per entry of a full joint compliance (n, n), which couples the joints."""
    return Motion(differentiate_bilinear_form(block.jacobian, block.torque[:, None, None]))


def _bend_links(frames: tuple[int, ...], block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Return the targets' motion per entry of the compliances (6, 6) of links or base: 21 for each frame."""
    moves, wrench, _ = block.frames
    return Motion(
        np.concatenate(
            [differentiate_bilinear_form(moves[j], wrench[j, :, None, None]) for j in frames], axis=-1
        )
    )


def _bend_links_diagonally(frames: slice, block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Return the targets' motion per entry of diagonal compliances of links or base: six for each frame."""
    moves, wrench, _ = block.frames
    return Motion(np.concatenate(list((moves * wrench[:, :, None, None])[frames]), axis=-1))


COUPLED_JOINTS = Term("coupled_joints", "rad/(N·m)", _bend_coupled_joints)
DIAGONAL_LINKS = Term("links", "m/N, rad/(N·m)", partial(_bend_links_diagonally, slice(BASE)))
DIAGONAL_BASE = Term("base", "m/N, rad/(N·m)", partial(_bend_links_diagonally, slice(BASE, None)))
FULL_BASE = Term("full_base", "m/N, rad/(N·m)", partial(_bend_links, (BASE,)))


def build_links_term(frames: tuple[int, ...]) -> Term:
    """Return the term of full compliances (6, 6) of the links behind joints with these indices.

    The index `BASE` means the base.
    """
    return Term("links", "m/N, rad/(N·m)", partial(_bend_links, frames))


def _compute_neglected_motion(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return the motion that the linear model neglects, ``e = (A(c) − A) c``, in unloaded configurations.

    To second order in the deflection: the torques change by ``K_c δθ``, and on the way each axis turns with
    the joints before it and half of its own deflection, ``Ω_k = Σ_{j<k} a_j δθ_j + ½ a_k δθ_k``, hence
    ``e = J diag(c) K_c δθ + Σ_k Ω_k × J_k δθ_k``.
    """
    joint_turns = compliance * block.torque  # δθ (B, n)
    stiffness_turns = compliance * np.einsum("bjk,bk->bj", block.complementary_stiffness, joint_turns)
    turns = block.postures.angular_jacobian * joint_turns[:, None]
    axis_turns = np.cumsum(turns, axis=2) - 0.5 * turns  # Ω_k
    # For readings along a direction, the block's Jacobian has that component only: compute all of it.
    is_directional = block.measurements.direction is not None
    jacobian = block.postures.jacobian_at(block.points) if is_directional else block.jacobian
    moves = jacobian * joint_turns[:, None, None]
    # Σ_k Ω_k × m_k holds the antisymmetric part of Σ_k Ω_k m_kᵀ.
    pairs = moves @ axis_turns.transpose(0, 2, 1)[:, None]
    from_axis_turns = (pairs - pairs.mT)[..., [2, 0, 1], [1, 2, 0]]
    from_torque_change = (block.jacobian @ stiffness_turns[:, None, :, None])[..., 0]
    return Motion((from_torque_change + from_axis_turns)[..., None], stiffness_turns[..., None])


NEGLECTED_STIFFNESS = Term("complementary_stiffness", "1", _compute_neglected_motion)
