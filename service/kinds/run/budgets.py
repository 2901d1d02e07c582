"""Uncertainty budgets as messages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import hypot, isfinite
from typing import Final

import numpy as np

from jointstiff.schemas import run as messages
from jointstiff.schemas.deflection import DeflectionBudget, DeflectionComponent
from jointstiff.schemas.run import Budget, BudgetComponent
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.budget import UncertaintyBudget

_LACK_OF_FIT: Final = {
    "lack_of_fit",
    "links_bend_with_joints",
    "residuals_exceed_sigma",
    "deflection_unexplained",
    "alternative_explains_better",
}
"""Reasons of an assessment for which the joints alone are not all that bends, or not as stated."""


def to_budget(
    budget: UncertaintyBudget | None, names: Sequence[str], reasons: Iterable[str]
) -> Budget | None:
    """Return the budget of the joints that have an estimate; None for none."""
    if budget is None:
        return None
    shown, total = budget.joints, budget.total()
    square = np.ix_(shown, shown)
    return Budget(
        joints=[names[j] for j in shown],
        components=[
            BudgetComponent(
                source=part.source,
                evaluation=part.evaluation,
                included=part.included,
                degrees_of_freedom=part.degrees_of_freedom,
                contributions=part.spread.uncertainty[shown].tolist(),
                correlation=part.spread.correlation[square].tolist(),
            )
            for part in budget.components
        ],
        standard_uncertainty=total.uncertainty[shown].tolist(),
        correlation=total.correlation[square].tolist(),
        probability=budget.probability,
        coverage_factor=budget.coverage_factor,
        expanded_uncertainty=(budget.coverage_factor * total.uncertainty[shown]).tolist(),
        missing=[
            *([] if any(part.source == "model_error" for part in budget.components) else ["model_error"]),
            *([] if _LACK_OF_FIT.isdisjoint(reasons) else ["lack_of_fit"]),
        ],
        expanded_with_model_error=(
            budget.coverage_factor * budget.total(whole=True).uncertainty[shown]
        ).tolist(),
    )


def to_covariances(budget: Budget, joints: Sequence[str]) -> FloatArray:
    """Return the covariances (K, n, n) of the components, zero for joints without an estimate."""
    shown = [joints.index(name) for name in budget.joints]
    covariances = np.zeros((len(budget.components), len(joints), len(joints)))
    for k, part in enumerate(budget.components):
        size = np.array(part.contributions)
        covariances[np.ix_([k], shown, shown)] = np.outer(size, size) * np.array(part.correlation)
    return covariances


def to_deflection_budgets(
    budget: Budget, contributions: FloatArray, radius: FloatArray | None, factor: float
) -> list[DeflectionBudget]:
    """Return the budget of each displacement.

    Args:
        budget: of the run.
        contributions: (B, K) of its components [m].
        radius: (B,) of the balls of the model error [m], inf where there is no bound; None without any.
        factor: coverage factor.
    """
    return [
        _deflection_budget(budget, row, None if radius is None else float(radius[b]), factor)
        for b, row in enumerate(contributions)
    ]


def _deflection_budget(
    budget: Budget, contributions: FloatArray, radius: float | None, factor: float
) -> DeflectionBudget:
    components = [
        DeflectionComponent(
            source=part.source, evaluation=part.evaluation, included=part.included, contribution=float(u)
        )
        for part, u in zip(budget.components, contributions, strict=True)
        if part.source != "model_error"
    ]
    if radius is not None and isfinite(radius):
        components.append(
            DeflectionComponent(
                source="model_error", evaluation="A", included=False, contribution=radius / factor
            )
        )
    combined = hypot(*(part.contribution for part in components if part.included))
    return DeflectionBudget(
        components=components,
        standard_uncertainty=combined,
        coverage_factor=factor,
        expanded_uncertainty=factor * combined,
        expanded_with_model_error=factor * hypot(*(part.contribution for part in components)),
    )


def to_joint_budgets(budget: UncertaintyBudget | None, count: int) -> list[messages.UncertaintyBudget | None]:
    """Return the included contributions of each of `count` joints, where there is more than readings."""
    included = [] if budget is None else [part for part in budget.components if part.included]
    if budget is None or len(included) < 2:
        return [None] * count
    parts = {part.source: part.spread.uncertainty for part in included}
    return [
        messages.UncertaintyBudget(**{str(source): float(u[j]) for source, u in parts.items()})
        if j in budget.joints
        else None
        for j in range(count)
    ]
