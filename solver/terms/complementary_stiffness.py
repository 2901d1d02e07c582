"""Complementary stiffness K_c: how the load's torques change as the joints bend (method.md §2).

Chen & Kao, *Conservative congruence transformation for joint and Cartesian stiffness matrices of robotic
hands and fingers*, Int. J. Robotics Research 19(9), 2000: ``(K_θ − K_c) δθ = τ`` with K_c = ∂τ/∂θ for a
wrench W whose force and moment keep their size and direction in R0, while the load point moves with the
flange. A dead force has a potential, so its share of K_c is symmetric; a dead moment has none.
"""

from __future__ import annotations

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.terms.balance import wrench_stiffness
from jointstiff.solver.terms.block import RegressorBlock
from jointstiff.solver.terms.term import Motion, Term


def complementary_stiffness(block: RegressorBlock) -> FloatArray:
    """``K_c,jk = ∂τ_j/∂θ_k``, in the configurations of the block.

    With v_j = a_j × (p_W − o_j), a joint k before j turns a_j and v_j, and a joint k after j moves p_W by
    v_k: ``K_c,jk = F · (a_min(j,k) × v_max(j,k)) + [k < j] M · (a_k × a_j)``.

    Returns:
        (B, n, n) [N·m/rad].
    """
    part = block.measurements
    axes = block.configurations.angular_jacobian
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
    turns = block.configurations.angular_jacobian * deflection[:, None]
    turned = np.cumsum(turns, axis=2) - 0.5 * turns
    jacobian = block.jacobian if part.direction is None else block.configurations.jacobian_at(block.points)
    moves = jacobian * deflection[:, None, None]
    # Σ_k Ω_k × m_k holds the antisymmetric part of Σ_k Ω_k m_kᵀ.
    pairs = moves @ turned.transpose(0, 2, 1)[:, None]
    bent = (pairs - np.swapaxes(pairs, -1, -2))[..., [2, 0, 1], [1, 2, 0]]
    softened = (block.jacobian @ added[:, None, :, None])[..., 0]
    return Motion((softened + bent)[..., None], added[..., None])


NEGLECTED_STIFFNESS = Term("complementary_stiffness", "1", _neglected)
