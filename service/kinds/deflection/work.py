"""Deflections by the model of a run: quick, and nothing to store."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointstiff.schemas.assessment import Assessment
from jointstiff.schemas.deflection import DeflectionBudget, DeflectionOptions, DeflectionResult
from jointstiff.schemas.run.model import IdentifiedModel
from jointstiff.schemas.run.run import Run, RunResult
from jointstiff.service.importing.limits import FAR_LOAD_POINT
from jointstiff.service.kinds.deflection.models import (
    to_directions,
    to_forward_model,
    to_load_cases,
    to_own_weight,
)
from jointstiff.service.kinds.deflection.results import to_case_results
from jointstiff.service.kinds.run.budgets import to_covariances, to_deflection_budgets
from jointstiff.solver.deflection.forward import ForwardModel
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.deflection.model_error import ModelError
from jointstiff.solver.deflection.own_weight import OwnWeight
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot.model import Robot


def predict_by_run(robot: Robot, run: Run, request: DeflectionOptions) -> DeflectionResult:
    """Predict deflections.

    Args:
        robot: that was measured.
        run: that succeeded.
        request: postures, loads and places.

    Raises:
        RequestError: the run has no model of joints, or the request does not fit the robot.
    """
    model, error = forward_model(robot, run, to_own_weight(request, robot))
    cases = to_load_cases(request, robot)
    found = model.deflect(cases)
    bound = None if error is None else error.bound(cases, found.leverage, request.confidence)
    labels = [case.label or str(i + 1) for i, case in enumerate(request.cases)]
    budgets: Sequence[DeflectionBudget | None] = [None] * len(labels)
    budget = None if run.result is None else run.result.budget
    if budget is not None:
        contributions = found.length_uncertainties(to_covariances(budget, robot.joint_names))
        radius = None if bound is None else bound.radius
        budgets = to_deflection_budgets(budget, contributions, radius, model.quantile(request.confidence))
    return DeflectionResult(
        assessment=assessment_of(run),
        confidence=request.confidence,
        model_error_postures=0 if error is None else error.postures,
        postures_needed=ModelError.needed(request.confidence),
        remarks=[
            *_far_load_points(cases, labels),
            *remarks_of(run, model, error, request.confidence, weighed=bool(request.masses)),
        ],
        cases=to_case_results(
            found, bound, request.confidence, to_directions(request, cases), labels, budgets
        ),
    )


def _far_load_points(cases: LoadCases, labels: Sequence[str]) -> list[str]:
    """Return a remark on load points that no tool reaches, which may be in another unit."""
    distances = np.linalg.norm(cases.load_point, axis=1)
    far = [label for label, distance in zip(labels, distances, strict=True) if distance > FAR_LOAD_POINT]
    if not far:
        return []
    others = f" and of {len(far) - 1} others" if len(far) > 1 else ""
    distance = f"{max(distances):g} m from the flange"
    return [f"the load point of case {far[0]}{others} is up to {distance}: check its unit"]


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
            f"run '{run.id}' lets links or coupling bend, where own weight is not supported",
            where="masses",
            remedy="omit masses, or choose a run with elasticity joints",
        )
    return model, error


def assessment_of(run: Run) -> Assessment:
    """Return the assessment of a run that predicts; raises as `model_of` does."""
    return _result_of(run).assessment


def model_of(run: Run) -> IdentifiedModel:
    """Return the model of a run that predicts.

    Raises:
        RequestError: the run has none.
    """
    model = _result_of(run).model
    if model is None:
        raise RequestError(f"run '{run.id}' holds no model", where="run_id", remedy="identify the set again")
    return model


def _result_of(run: Run) -> RunResult:
    if run.result is None:
        raise RequestError(
            f"run '{run.id}' has {run.state} and has no model",
            where="run_id",
            remedy="name one that succeeded",
        )
    return run.result


def remarks_of(
    run: Run, model: ForwardModel, error: ModelError | None, confidence: float, *, weighed: bool
) -> list[str]:
    """Return what holds for all predictions of a run: what its model leaves out, and no bound."""
    if model.first_order:
        remarks = [
            "to first order in the load: links and joints bend linearly, own weight and complementary "
            "stiffness are left out"
        ]
    else:
        remarks = [] if weighed else ["own weight is left out, as no masses are given"]
        if run.request.complementary_stiffness == "neglected" and run.request.weight is None:
            remarks.append(
                "the run neglects the complementary stiffness K_c, which the prediction includes: identify "
                "with complementary_stiffness included"
            )
    level = f"no bound of the model error at {100 * confidence:g} %"
    if error is None:
        reason = model_of(run).no_error or "no posture could be left out"
        remarks.append(f"no bound of the model error: {reason}")
    elif error.postures < (needed := error.needed(confidence)):
        remarks.append(f"{level}: it takes {needed} postures, and there are {error.postures}")
    elif np.isinf(error.quantile(confidence)):
        remarks.append(f"{level}: too many postures twist a joint that the others do not determine")
    return remarks
