"""Planned campaigns for studies of many: exact deflections computed once, noise drawn again and again.

Nothing here knows the solver's physics: deflections, and what they could tell at best (the Cramér-Rao
bound), come from springs that balance the load exactly (`jointstiff.simulator.equilibrium`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointstiff.simulator.campaign import (
    TARGETS,
    Experiment,
    SpringArm,
    deflections,
    linear_deflections,
    plan_experiment,
)
from jointstiff.solver.arrays import FloatArray
from tests.support.springs import SIGMA, SpringCampaign

__all__ = ["CONFIGURATIONS", "FORCE", "SIGMA", "Design", "planned_design", "with_compliances"]


CONFIGURATIONS = 19
FORCE = 1500.0
"""Size of the pull on the flange [N]."""
_CANDIDATES = 20
"""Random plans, of which the best is taken."""
_STEP = 1e-3
"""Of a compliance, relative to the arm's mean, in numerical derivatives. Their error falls with its square;
the rounding of positions of metres, 1e-15 m, is 1e-9 of what such a step moves a target."""


@dataclass(frozen=True, eq=False)
class Design(SpringCampaign):
    """A campaign with the least covariance that its deflections could tell at best."""

    def cramer_rao(self, *, sigma: float = SIGMA) -> FloatArray:
        """Least covariance of any unbiased estimate of the compliances from the deflections.

        ``(Jᵀ (2 σ² I)⁻¹ J)⁻¹`` with J the derivative of the *exact* deflections with respect to the
        compliances, by central differences. A deflection is a difference of two readings of sigma each.

        Returns:
            (n, n) [(rad/(N·m))²].
        """
        J = self._derivative()
        size = np.linalg.norm(J, axis=0)
        scaled = J / size
        covariance: FloatArray = 2.0 * sigma**2 * np.linalg.inv(scaled.T @ scaled) / np.outer(size, size)
        return covariance

    def _derivative(self) -> FloatArray:
        """(3 N T, n) of the loaded positions [m / (rad/(N·m))]; one-sided where a compliance is zero."""
        c = self.arm.compliances
        step = _STEP * c.mean()
        columns = []
        for unit in np.eye(len(c)):
            above, below = c + step * unit, np.maximum(c - step * unit, 0.0)
            moved = self._loaded(above) - self._loaded(below)
            columns.append(moved.ravel() / (above - below).sum())
        return np.stack(columns, axis=1)

    def _loaded(self, compliances: FloatArray) -> FloatArray:
        arm = with_compliances(self.arm, compliances)
        return deflections(arm, self.experiment.joints, *self.experiment.wrenches, _POINTS)[1]


def with_compliances(arm: SpringArm, compliances: FloatArray) -> SpringArm:
    """The same arm with other springs; zero makes a joint rigid.

    Args:
        arm: any arm of n joints.
        compliances: (n,) not negative [rad/(N·m)].
    """
    with np.errstate(divide="ignore"):
        return replace(arm, stiffnesses=1.0 / compliances)


def planned_design(arm: SpringArm, *, seed: int) -> Design:
    """A well spread set of configurations with pulls in all directions, in which every joint shows.

    Of some random plans, each drawn over the middle half of every joint's range, it is the one whose
    largest standard uncertainty of a compliance, relative to the compliance, is least.

    Args:
        arm: of n joints, none rigid: the plan is made on nominal values, as it is in practice.
        seed: of the plans.
    """
    plans = (
        plan_experiment(
            arm,
            configurations=CONFIGURATIONS,
            load="pull",
            force=FORCE,
            seed=_CANDIDATES * seed + candidate,
        )
        for candidate in range(_CANDIDATES)
    )
    return Design.by(arm, min(plans, key=lambda plan: _worst(arm, plan)))


def _worst(arm: SpringArm, plan: Experiment) -> float:
    """Largest relative standard uncertainty, up to a factor; the linear model is good enough for a plan."""
    shares = [
        linear_deflections(with_compliances(arm, c), plan.joints, *plan.wrenches, _POINTS).ravel()
        for c in np.diag(arm.compliances)
    ]
    return float(np.sqrt(np.diag(np.linalg.inv(np.array(shares) @ np.array(shares).T))).max())


_POINTS: FloatArray = np.array(list(TARGETS.values()))
