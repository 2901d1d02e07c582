"""Predicted deflections as messages, with remarks where they extrapolate or say nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointstiff.schemas import deflection as messages
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.deflection.cartesian import CartesianCompliance
from jointstiff.solver.deflection.forward import Deflection
from jointstiff.solver.deflection.model_error import ModelErrorBound


def to_case_results(
    deflection: Deflection,
    bound: ModelErrorBound | None,
    confidence: float,
    directions: FloatArray,
    labels: Sequence[str],
    budgets: Sequence[messages.DeflectionBudget | None],
) -> list[messages.CaseResult]:
    """Return each case; one that twists a joint of which nothing is known has its reason instead."""
    intervals, compliance, unseen = deflection.interval(confidence), deflection.compliance, deflection.unseen
    bounds = None if bound is None else bound.interval(deflection.displacement, intervals)
    stiffnesses = _stiffnesses(compliance, directions)
    names = deflection.model.robot.joint_names
    results = []
    for b, label in enumerate(labels):
        if unseen[b].any():
            results.append(_without_numbers(label, [names[j] for j in np.flatnonzero(unseen[b])]))
            continue
        readings = None
        if intervals is not None:
            interval = intervals[b].tolist()
            readings = messages.ReadingsInterval(
                displacement=tuple(interval[:3]), rotation=tuple(interval[3:])
            )
        results.append(
            messages.CaseResult(
                label=label,
                displacement=tuple(deflection.displacement[b].tolist()),
                rotation=tuple(deflection.rotation[b].tolist()),
                readings_only=readings,
                with_model_error=_with_model_error(bound, bounds, b),
                compliance=_compliance(compliance, stiffnesses[b], b),
                remarks=[] if bound is None else _extrapolation(bound, b),
                budget=budgets[b],
            )
        )
    return results


def _without_numbers(label: str, unseen: Sequence[str]) -> messages.CaseResult:
    reason = (
        f"the load twists {', '.join(unseen)}, of which the readings of the run say nothing: no number holds"
    )
    return messages.CaseResult(
        label=label,
        displacement=None,
        rotation=None,
        readings_only=None,
        with_model_error=None,
        compliance=None,
        remarks=[reason],
    )


def _with_model_error(
    bound: ModelErrorBound | None, ends: FloatArray | None, b: int
) -> messages.ModelErrorInterval | None:
    if bound is None or ends is None or not np.isfinite(bound.radius[b]):
        return None
    return messages.ModelErrorInterval(
        displacement=tuple(ends[b].tolist()),
        radius=float(bound.radius[b]),
        load_ratio=float(bound.load_ratio[b]),
        leverage_ratio=float(bound.leverage_ratio[b]),
    )


def _extrapolation(bound: ModelErrorBound, b: int) -> list[str]:
    load, leverage = float(bound.load_ratio[b]), float(bound.leverage_ratio[b])
    remarks = []
    if np.isinf(load):
        remarks.append(
            f"extrapolated: no {bound.unmeasured} was measured, so the model error under one has no bound"
        )
    elif load > 1.0 + 1e-6:
        remarks.append(f"extrapolated: the load is {load:.2g} times the greatest that was measured")
    if np.isfinite(load) and leverage > 1.0 + 1e-6:
        remarks.append(
            f"extrapolated: of this posture and place the readings say {leverage:.2g} times less than of the "
            "worst target that was measured"
        )
    return remarks


def _stiffnesses(
    compliance: CartesianCompliance, directions: FloatArray
) -> list[messages.DirectionalStiffness | None]:
    known = ~np.isnan(directions[:, 0])
    u = np.where(known[:, None], directions, [1.0, 0.0, 0.0])
    columns = zip(
        u,
        compliance.stiffness_lateral_free(u),
        compliance.stiffness_lateral_blocked(u),
        compliance.stiffness_rotation_blocked(u),
        compliance.along(u),
        compliance.deviation_along(u),
        known,
        strict=True,
    )
    return [
        messages.DirectionalStiffness(
            direction=tuple(direction.tolist()),
            lateral_free=_finite(free),
            lateral_blocked=_finite(lateral),
            rotation_blocked=_finite(rotation),
            compliance=float(along),
            standard_uncertainty=_finite(deviation),
        )
        if there
        else None
        for direction, free, lateral, rotation, along, deviation, there in columns
    ]


def _compliance(
    found: CartesianCompliance, stiffness: messages.DirectionalStiffness | None, b: int
) -> messages.CartesianCompliance:
    matrix, worst = found.matrix[b], found.worst
    blocks = {
        name: tuple(map(tuple, matrix[rows, columns].tolist()))
        for name, rows, columns in (
            ("translation_by_force", slice(3), slice(3)),
            ("translation_by_moment", slice(3), slice(3, 6)),
            ("rotation_by_force", slice(3, 6), slice(3)),
            ("rotation_by_moment", slice(3, 6), slice(3, 6)),
        )
    }
    return messages.CartesianCompliance.model_validate(
        {
            **blocks,
            "symmetric": bool(found.symmetric[b]),
            "along": stiffness,
            "worst": {
                "direction": worst.direction[b].tolist(),
                "compliance": float(worst.compliance[b]),
                "compliance_uncertainty": _finite(worst.compliance_uncertainty[b]),
                "direction_uncertainty": _finite(worst.direction_uncertainty[b]),
            },
        }
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
