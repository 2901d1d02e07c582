"""Deflections by the model of a run: quick, and nothing to store."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointstiff.schemas import deflection as messages
from jointstiff.schemas.assessment import Assessment
from jointstiff.schemas.deflection import DeflectionBudget, DeflectionOptions, DeflectionResult
from jointstiff.schemas.model import IdentifiedModel
from jointstiff.schemas.run import Run, RunResult
from jointstiff.service.kinds.deflection.models import (
    to_covariances,
    to_deflection_budgets,
    to_directions,
    to_forward_model,
    to_load_cases,
    to_own_weight,
)
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.messages import finite
from jointstiff.solver.predict.forward import CartesianCompliance, Deflection, ForwardModel
from jointstiff.solver.predict.model_error import ModelError, ModelErrorBound
from jointstiff.solver.predict.models import JointModel, OwnWeight
from jointstiff.solver.robot.model import Robot


def predict_by_run(robot: Robot, run: Run, request: DeflectionOptions) -> DeflectionResult:
    """Predict deflections.

    Raises:
        RequestError: the run has no model of joints, or the request does not fit the robot.
    """
    model, error = forward_model(robot, run, to_own_weight(request, robot, run))
    cases = to_load_cases(request, robot)
    prediction = model.deflect(cases)
    bound = None if error is None else error.bound(cases, prediction.leverage, request.confidence)
    labels = [case.label or str(i + 1) for i, case in enumerate(request.cases)]
    budgets: Sequence[DeflectionBudget | None] = [None] * len(labels)
    budget = None if run.result is None else run.result.budget
    if budget is not None:
        contributions = prediction.length_uncertainties(to_covariances(budget, robot.joint_names))
        radius = None if bound is None else bound.radius
        budgets = to_deflection_budgets(budget, contributions, radius, model.quantile(request.confidence))
    return DeflectionResult(
        assessment=assessment_of(run),
        confidence=request.confidence,
        model_error_postures=0 if error is None else error.postures,
        postures_needed=ModelError.needed(request.confidence),
        remarks=remarks_of(run, model, error, request.confidence),
        cases=to_case_results(
            prediction, bound, request.confidence, to_directions(request, cases), labels, budgets
        ),
    )


def forward_model(
    robot: Robot, run: Run, weight: OwnWeight | None = None
) -> tuple[ForwardModel, ModelError | None]:
    """Return the model of a run that predicts the loaded robot, and its error.

    Raises:
        RequestError: the run has none or is of another robot, or masses are given where links bend.
    """
    model, error = to_forward_model(robot, model_of(run), weight)
    if weight is not None and model.first_order:
        raise RequestError(
            f"run '{run.id}' has elastic links or coupling, which do not support own weight",
            where="masses",
            remedy="omit masses, or choose a run with elasticity joints",
        )
    return model, error


def assessment_of(run: Run) -> Assessment:
    """Return the assessment of a run that predicts; raises as `model_of` does."""
    return result_of(run).assessment


def model_of(run: Run) -> IdentifiedModel:
    """Return the model of a run that predicts.

    Raises:
        RequestError: the run has none.
    """
    model = result_of(run).model
    if model is None:
        raise RequestError(
            f"run '{run.id}' has no model", where="run_id", remedy="choose a run that determines a joint"
        )
    return model


def result_of(run: Run) -> RunResult:
    """Return the result of a run.

    Raises:
        RequestError: it has none.
    """
    if run.result is None:
        raise RequestError(
            f"run '{run.id}' has {run.state} and has no model",
            where="run_id",
            remedy="give the id of a succeeded run",
        )
    return run.result


def remarks_of(run: Run, model: ForwardModel, error: ModelError | None, confidence: float) -> list[str]:
    """Return what holds for all predictions of a run: what its model leaves out, and no bound."""
    if not isinstance(model, JointModel):
        remarks = [
            "to first order in the load: links and joints bend linearly, own weight and complementary "
            "stiffness are left out"
        ]
    else:
        remarks = []
        if model.weight is None:
            why = "no masses are given" if run.request.weight is None else "`absolute` is not requested"
            remarks.append(f"own weight is not included, because {why}")
        elif model.weight.absolute:
            remarks.append(
                "absolute: relative to an arm that does not bend, so sag by own weight is included"
            )
        if run.request.complementary_stiffness == "neglected" and run.request.weight is None:
            remarks.append(
                "the run neglects the complementary stiffness K_c, which the prediction includes: identify "
                "with complementary_stiffness included"
            )
    level = f"no bound of the model error at {100 * confidence:g} %"
    if error is None:
        reason = model_of(run).no_error or "no posture could be omitted"
        remarks.append(f"no bound of the model error: {reason}")
    elif error.postures < (needed := error.needed(confidence)):
        remarks.append(f"{level}: {needed} postures are needed, and there are {error.postures}")
    elif np.isinf(error.quantile(confidence)):
        remarks.append(f"{level}: too many postures twist a joint that the others do not determine")
    return remarks


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
        f"the load or own weight twists {', '.join(unseen)}, which the readings of the run do not "
        "determine: the prediction is not valid"
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
        remarks.append(f"extrapolated: no {bound.unmeasured} was measured, so its model error has no bound")
    elif load > 1.0 + 1e-6:
        remarks.append(f"extrapolated: the load is {load:.2g} times the greatest that was measured")
    if np.isfinite(load) and leverage > 1.0 + 1e-6:
        remarks.append(
            f"extrapolated: the readings determine this posture and place {leverage:.2g} times less than "
            "the worst measured target"
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
            lateral_free=finite(free),
            lateral_blocked=finite(lateral),
            rotation_blocked=finite(rotation),
            compliance=float(along),
            standard_uncertainty=finite(deviation),
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
                "compliance_uncertainty": finite(worst.compliance_uncertainty[b]),
                "direction_uncertainty": finite(worst.direction_uncertainty[b]),
            },
        }
    )
