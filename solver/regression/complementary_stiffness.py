"""Complementary stiffness K_c: how the load's torques change as the joints bend (method.md §2).

Chen & Kao, *Conservative congruence transformation for joint and Cartesian stiffness matrices of robotic
hands and fingers*, Int. J. Robotics Research 19(9), 2000: ``(K_θ − K_c) δθ = τ`` with K_c = ∂τ/∂θ for a
wrench W whose force and moment keep their size and direction in R0, while the load point moves with the
flange. A dead force has a potential, so its share of K_c is symmetric; a dead moment has none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.regression.balance import wrench_stiffness
from jointstiff.solver.regression.regressor import RegressorBlock


@dataclass(frozen=True)
class ComplementaryStiffness:
    """Effect of K_c on a fit. Dimensionless."""

    included: bool  #: whether it is part of the model
    iterations: int  #: fits until the deflected configurations stood still; 0 if neglected
    largest_ratio: float  #: greatest ``|K_c,ij| c_i`` over the set, over the joints with an estimate
    #: greatest change of a compliance between neglecting and including it, in units of its standard
    #: uncertainty; None where that is unknown
    largest_shift: float | None
    #: (n,) change of the compliances by including it [rad/(N·m)]; None where it is not known
    shift: FloatArray | None = None
    obstacle: str | None = None  #: why it is neglected although it was asked for; None where it is not


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


class LargestStiffness:
    """The largest entries of K_c over a set."""

    def __init__(self, parameters: int) -> None:
        self._largest: FloatArray = np.zeros((parameters, parameters))

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations."""
        np.maximum(self._largest, np.abs(complementary_stiffness(block)).max(axis=0), out=self._largest)

    def ratio(self, compliance: FloatArray, known: BoolArray) -> float:
        """Largest ``|K_c,ij c_i|`` over the joints that are known, dimensionless.

        Args:
            compliance: (n,) [rad/(N·m)].
            known: (n,) the joints with an estimate.
        """
        ratios = np.abs(compliance)[:, None] * self._largest
        return float(ratios[np.ix_(known, known)].max(initial=0.0))


def neglected_readings(block: RegressorBlock, compliance: FloatArray) -> Measurements:
    """Return what the linear model leaves out, ``e = (A(c) − A) c``, in place of what was read.

    To second order in the deflection: the torques change by ``K_c δθ``, and on the way each axis turns with
    the joints before it and half of its own deflection, ``Ω_k = Σ_{j<k} a_j δθ_j + ½ a_k δθ_k``, hence
    ``e = J diag(c) K_c δθ + Σ_k Ω_k × J_k δθ_k``.

    Args:
        block: B observations in their unloaded configurations.
        compliance: (n,) [rad/(N·m)].

    Returns:
        The same observations, whose deflections are e [m], and whose encoders read what K_c adds [rad].
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
    left_out = np.where(part.present[..., None], softened + bent, 0.0)
    encoders = part.encoders
    if encoders is not None:
        encoders = replace(encoders, deflection=np.where(encoders.present, added, 0.0))
    return replace(part, deflection=left_out, encoders=encoders)
