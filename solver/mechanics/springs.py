"""Joints, coupled joints, links and the base as springs, and how torques change (method.md §2, §7).

``δp_X = Σ_jk J_j C_jk τ_k + Σ_i B_i C_i w_i``: coupling between joints, links. Frame i is that of joint i,
which moves with it (after its rotation); w_i is the load's wrench in it, force then moment about its origin
o_i, and ``B_i = [R_i, −[p_X − o_i]× R_i]`` moves the target with the frame. The base is one more, below
joint 1: its frame is R0, which turns with no joint.

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
from jointstiff.solver.mechanics.block import Motion, RegressorBlock, Term, wrench_stiffness


def _joints(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001  # linear
    """Return ``A = J diag(τ)``, and ``diag(τ)`` behind the gearboxes."""
    if block.measurements.encoders is None:
        return Motion(block.A)
    return Motion(block.A, block.torque[..., None] * np.eye(block.torque.shape[1]))


def _turns(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001  # kinematics
    """Return J, whatever the load."""
    return Motion(block.jacobian)


JOINTS = Term("joints", "rad/(N·m)", _joints)
TURNS = Term("turns", "rad", _turns)
"""A turn of each joint: the motion that a torque makes a deflection of."""


BASE: Final = -1
"""Number of the base among the frames that bend: the last, after those of the joints."""


@lru_cache(maxsize=64)
def entries(size: int) -> tuple[IndexArray, IndexArray]:
    """Rows and columns (size (size + 1) / 2,) of the entries: (0,0), (0,1), (1,1), (0,2), ...

    The order that Clarabel's triangle cone has.
    """
    lower_rows, lower_columns = np.tril_indices(size)
    for indices in (lower_rows, lower_columns):
        indices.setflags(write=False)
    return lower_columns, lower_rows


@lru_cache(maxsize=64)
def weights(size: int) -> FloatArray:
    """1 for diagonal entries and √2 for the others, so that vectors have the matrices' inner product."""
    rows, columns = entries(size)
    weights: FloatArray = np.where(rows == columns, 1.0, np.sqrt(2.0))
    weights.setflags(write=False)
    return weights


def products(moves: FloatArray, load: FloatArray) -> FloatArray:
    """Return columns (..., k (k + 1) / 2) of ``moves C load``, both (..., k), by entries of a symmetric C."""
    size = moves.shape[-1]
    i, j = entries(size)
    # An entry off the diagonal represents two of the matrix, each 1/√2 of it.
    both: FloatArray = moves[..., i] * load[..., j] + moves[..., j] * load[..., i]
    return both * np.where(i == j, 0.5, 1.0 / weights(size))


def _coupled(block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001  # linear
    """Bend joints by the torques about others, in the order of `entries`."""
    return Motion(products(block.jacobian, block.torque[:, None, None]))


def _links(frames: tuple[int, ...], block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Bend links behind some joints, or the base, each by 21 entries of its compliance."""
    moves, wrench, _ = block.frames
    return Motion(np.concatenate([products(moves[j], wrench[j, :, None, None]) for j in frames], axis=-1))


def _diagonal(frames: slice, block: RegressorBlock, compliance: FloatArray) -> Motion:  # noqa: ARG001
    """Bend each link, or the base, along and about the axes of its frame: six compliances each."""
    moves, wrench, _ = block.frames
    return Motion(np.concatenate(list((moves * wrench[:, :, None, None])[frames]), axis=-1))


COUPLED_JOINTS = Term("coupled_joints", "rad/(N·m)", _coupled)
DIAGONAL_LINKS = Term("links", "m/N, rad/(N·m)", partial(_diagonal, slice(BASE)))
DIAGONAL_BASE = Term("base", "m/N, rad/(N·m)", partial(_diagonal, slice(BASE, None)))
FULL_BASE = Term("full_base", "m/N, rad/(N·m)", partial(_links, (BASE,)))


def links_behind(frames: tuple[int, ...]) -> Term:
    """Return the term of full compliances (6, 6) of links behind some joints, or of the `BASE`."""
    return Term("links", "m/N, rad/(N·m)", partial(_links, frames))


def complementary_stiffness(block: RegressorBlock) -> FloatArray:
    """``K_c,jk = ∂τ_j/∂θ_k``, in the configurations of the block.

    With v_j = a_j × (p_W − o_j), a joint k before j turns a_j and v_j, and a joint k after j moves p_W by
    v_k: ``K_c,jk = F · (a_min(j,k) × v_max(j,k)) + [k < j] M · (a_k × a_j)``.

    Returns:
        (B, n, n) [N·m/rad].
    """
    part = block.measurements
    axes = block.postures.angular_jacobian
    return wrench_stiffness(axes, block.load_jacobian, part.force, part.moment)


def _neglected(block: RegressorBlock, compliance: FloatArray) -> Motion:
    """Return what the linear model leaves out, ``e = (A(c) − A) c``, in the unloaded configurations.

    To second order in the deflection: the torques change by ``K_c δθ``, and on the way each axis turns with
    the joints before it and half of its own deflection, ``Ω_k = Σ_{j<k} a_j δθ_j + ½ a_k δθ_k``, hence
    ``e = J diag(c) K_c δθ + Σ_k Ω_k × J_k δθ_k``.
    """
    part = block.measurements
    deflection = compliance * block.torque
    added = compliance * np.einsum("bjk,bk->bj", complementary_stiffness(block), deflection)
    turns = block.postures.angular_jacobian * deflection[:, None]
    turned = np.cumsum(turns, axis=2) - 0.5 * turns
    jacobian = block.jacobian if part.direction is None else block.postures.jacobian_at(block.points)
    moves = jacobian * deflection[:, None, None]
    # Σ_k Ω_k × m_k holds the antisymmetric part of Σ_k Ω_k m_kᵀ.
    pairs = moves @ turned.transpose(0, 2, 1)[:, None]
    bent = (pairs - pairs.mT)[..., [2, 0, 1], [1, 2, 0]]
    softened = (block.jacobian @ added[:, None, :, None])[..., 0]
    return Motion((softened + bent)[..., None], added[..., None])


NEGLECTED_STIFFNESS = Term("complementary_stiffness", "1", _neglected)
