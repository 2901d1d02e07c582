"""Planned campaigns for studies of many: exact deflections computed once, noise drawn again and again.

Nothing here knows the solver's physics: deflections, and what they could tell at best (the Cramér-Rao
bound), come from springs that balance the load exactly (`jointstiff.simulator.equilibrium`).
"""

from __future__ import annotations

from collections.abc import Iterator
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
from jointstiff.solver.readings.measurements import Measurements

__all__ = ["CONFIGURATIONS", "FORCE", "SIGMA", "Design", "planned_design", "with_compliances"]


CONFIGURATIONS = 19
FORCE = 1500.0
"""Size of the pull on the flange [N]."""
SIGMA = 2e-5
"""Standard uncertainty of one coordinate of one reading [m], of a laser tracker."""
_CANDIDATES = 20
"""Random plans, of which the best is taken."""
_STEP = 1e-3
"""Of a compliance, relative to the arm's mean, in numerical derivatives. Their error falls with its square;
the rounding of positions of metres, 1e-15 m, is 1e-9 of what such a step moves a target."""
_NOISE_STREAM = 20


@dataclass(frozen=True, eq=False)
class Design:
    """Design of a campaign, and the readings of exact instruments.

    Attributes:
        arm: the arm with its true compliances.
        experiment: N configurations and loads.
        unloaded: (N, T, 3) places of the targets without load, in R0 [m].
        loaded: (N, T, 3) the same with load [m].
    """

    arm: SpringArm
    experiment: Experiment
    unloaded: FloatArray
    loaded: FloatArray

    @classmethod
    def of(cls, arm: SpringArm, experiment: Experiment) -> Design:
        """Balance springs and loads."""
        return cls(arm, experiment, *deflections(arm, experiment.joints, *experiment.wrenches, _POINTS))

    def measured(self, draws: int, *, seed: int, sigma: float = SIGMA) -> Iterator[Measurements]:
        """Campaigns of the same design, each with noise of its own on every coordinate of both readings.

        Args:
            draws: how many.
            seed: of the noise.
            sigma: its standard deviation [m].
        """
        generator = np.random.default_rng([seed, _NOISE_STREAM])
        exact = np.stack([self.unloaded, self.loaded])
        for _ in range(draws):
            yield self.measurements(*(exact + sigma * generator.standard_normal(exact.shape)), sigma=sigma)

    def measurements(self, unloaded: FloatArray, loaded: FloatArray, *, sigma: float | None) -> Measurements:
        """Positions read, (N, T, 3) each, as the solver takes them."""
        present = np.ones(unloaded.shape[:2], dtype=np.bool_)
        return Measurements(
            joints=self.experiment.joints,
            force=self.experiment.forces,
            moment=self.experiment.moments,
            load_point=self.experiment.load_points,
            position=unloaded,
            in_flange=~present,
            deflection=loaded - unloaded,
            present=present,
            sigma=sigma,
        )

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
    return Design.of(arm, min(plans, key=lambda plan: _worst(arm, plan)))


def _worst(arm: SpringArm, plan: Experiment) -> float:
    """Largest relative standard uncertainty, up to a factor; the linear model is good enough for a plan."""
    shares = [
        linear_deflections(with_compliances(arm, c), plan.joints, *plan.wrenches, _POINTS).ravel()
        for c in np.diag(arm.compliances)
    ]
    return float(np.sqrt(np.diag(np.linalg.inv(np.array(shares) @ np.array(shares).T))).max())


_POINTS: FloatArray = np.array(list(TARGETS.values()))
