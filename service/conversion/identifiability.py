"""What the readings can determine, and what to measure next: from the numerical core to messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from math import degrees, isfinite

from jointstiff.schemas.run import identifiability as messages
from jointstiff.solver.inference import Advice, Estimate
from jointstiff.solver.observability import observability_indices

__all__ = ["to_identifiability"]


def to_identifiability(
    estimate: Estimate, advice: Sequence[Advice], labels: Sequence[str]
) -> messages.Identifiability:
    """Rank, condition, combinations and indices, with advice in words.

    Args:
        estimate: of the joints.
        advice: on the same measurements.
        labels: of the observations.
    """
    names = tuple(joint.name for joint in estimate.joints)
    analyses = estimate.identifiability
    indices = observability_indices(estimate.regressor, estimate.visibility)
    return messages.Identifiability(
        parameters=len(names),
        rank=sum(analysis.rank for analysis in analyses),
        condition_number=_finite(max(analysis.condition_number for analysis in analyses)),
        combinations=[
            [names[j] for j in group.joints] for analysis in analyses for group in analysis.combinations
        ],
        observability=None if indices is None else messages.ObservabilityIndices(**asdict(indices)),
        advice=[_advice(piece, names, labels) for piece in advice],
        weakest=[analysis.weakest.in_words(names) for analysis in analyses if analysis.weakest],
        stages=[
            messages.StageIdentifiability(
                rank=analysis.rank,
                condition_number=_finite(analysis.condition_number),
                singular_values=analysis.singular_values.tolist(),
            )
            for analysis in analyses
        ],
    )


def _advice(advice: Advice, names: Sequence[str], labels: Sequence[str]) -> messages.Advice:
    label = None if advice.observation is None else labels[advice.observation]
    x, y, z = advice.force.tolist()
    return messages.Advice(
        joint=names[advice.joint],
        message=f"{_posture(advice, label)} {_load(advice)}: {_gain(advice, names[advice.joint])}",
        joints=advice.joints.tolist(),
        observation=label,
        force=(x, y, z),
        uncertainty_ratio=advice.ratio,
        standard_uncertainty=advice.uncertainty,
    )


def _posture(advice: Advice, label: str | None) -> str:
    if label is not None:
        return f"in the posture of {label}"
    angles = ", ".join(f"{degrees(angle):.0f}" for angle in advice.joints.tolist())
    return f"in the posture ({angles})°, if it is clear,"


def _load(advice: Advice) -> str:
    size = float((advice.force**2).sum() ** 0.5)
    if advice.own_direction:
        return f"load with {size:.4g} N as before"
    direction = ", ".join(f"{part / size + 0.0:.2f}" for part in advice.force.tolist())
    return f"pull {size:.4g} N along ({direction})"


def _gain(advice: Advice, name: str) -> str:
    """What the reading brings: the uncertainty, the change of it, or at least the torque."""
    method = "" if advice.same_method else "by the partial pose "
    change = "" if advice.ratio is None else f", {advice.ratio:.2g} of what it is"
    if advice.uncertainty is not None:
        return f"{method}u({name}) becomes {advice.uncertainty:.2g} rad/(N.m){change}"
    if advice.ratio is not None:
        return f"{method}u({name}) becomes {advice.ratio:.2g} of what it is"
    return f"that twists {name} with {advice.torque:.3g} N.m"


def _finite(number: float) -> float | None:
    return number if isfinite(number) else None
