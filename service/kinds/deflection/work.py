"""Deflections by the model of a run: quick, and nothing to store."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.schemas.deflection import DeflectionBudget, DeflectionOptions, DeflectionResult, LinkMass
from jointstiff.schemas.run.model import ElasticPart, IdentifiedModel
from jointstiff.schemas.run.run import Run
from jointstiff.service.kinds.deflection.models import (
    to_directions,
    to_elastic_predictor,
    to_joint_model,
    to_load_cases,
    to_own_weight,
)
from jointstiff.service.kinds.deflection.results import to_case_results
from jointstiff.service.kinds.run.budgets import to_covariances, to_deflection_budgets
from jointstiff.solver.deflection.joint_model import JointModel
from jointstiff.solver.deflection.length_uncertainty import length_uncertainties
from jointstiff.solver.deflection.model_error import ModelError, ModelErrorBound
from jointstiff.solver.deflection.prediction import Deflection, predict_deflections
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot.model import Robot

FIRST_ORDER: Final = (
    "to first order in the load: links and joints bend linearly, own weight and complementary stiffness are "
    "left out"
)


def predict_by_run(robot: Robot, run: Run, request: DeflectionOptions) -> DeflectionResult:
    """Predict deflections.

    Args:
        robot: that was measured.
        run: that succeeded.
        request: postures, loads and places.

    Raises:
        RequestError: the run has no model of joints, or the request does not fit the robot.
    """
    stored = model_of(run)
    if stored.elastic is not None:
        return _by_elastic(robot, run, stored, stored.elastic, request)
    model, error = to_joint_model(robot, stored)
    cases = to_load_cases(request, robot)
    weight = to_own_weight(request, robot)
    found = predict_deflections(model, cases, confidence=request.confidence, weight=weight)
    bound = None if error is None else error.bound(model, found.posture, request.confidence)
    labels = [case.label or str(i + 1) for i, case in enumerate(request.cases)]
    return DeflectionResult(
        confidence=request.confidence,
        model_error_postures=0 if error is None else error.postures,
        postures_needed=ModelError.needed(request.confidence),
        remarks=[
            *remarks_of(run, weighed=weight is not None),
            *no_bound(error, stored.no_error, request.confidence),
        ],
        cases=to_case_results(
            model,
            found,
            bound,
            to_directions(request, cases),
            labels,
            _budgets(run, model, found, bound, request.confidence),
        ),
    )


def _budgets(
    run: Run, model: JointModel, found: Deflection, bound: ModelErrorBound | None, confidence: float
) -> Sequence[DeflectionBudget | None]:
    """Return the budget of each case, where the run has one."""
    budget = None if run.result is None else run.result.budget
    if budget is None:
        return [None] * len(found.displacement)
    contributions = length_uncertainties(found, to_covariances(budget, model.robot.joint_names))
    radius = None if bound is None else bound.radius
    return to_deflection_budgets(budget, contributions, radius, model.quantile(confidence))


def _by_elastic(
    robot: Robot, run: Run, stored: IdentifiedModel, part: ElasticPart, request: DeflectionOptions
) -> DeflectionResult:
    """Predict by a model in which links or coupling bend.

    Raises:
        RequestError: masses are given, or the request does not fit the robot.
    """
    refuse_masses(run, request.masses)
    model, error = to_elastic_predictor(robot, stored, part)
    cases = to_load_cases(request, robot)
    found = model.predict(cases, request.confidence)
    bound = None if error is None else error.bound_of(cases, model.leverage(found), request.confidence)
    labels = [case.label or str(i + 1) for i, case in enumerate(request.cases)]
    return DeflectionResult(
        confidence=request.confidence,
        model_error_postures=0 if error is None else error.postures,
        postures_needed=ModelError.needed(request.confidence),
        remarks=[FIRST_ORDER, *no_bound(error, stored.no_error, request.confidence)],
        cases=to_case_results(
            model, found, bound, to_directions(request, cases), labels, [None] * len(labels)
        ),
    )


def refuse_masses(run: Run, masses: Sequence[LinkMass]) -> None:
    """Refuse own weight with a run whose links bend.

    Raises:
        RequestError: masses are given.
    """
    if masses:
        raise RequestError(
            f"run '{run.id}' lets links or coupling bend, where own weight is not supported",
            where="masses",
            remedy="omit masses, or choose a run with elasticity joints",
        )


def model_of(run: Run) -> IdentifiedModel:
    """Return the model of a run that predicts.

    Raises:
        RequestError: the run has none.
    """
    if run.result is None:
        raise RequestError(
            f"run '{run.id}' has {run.state} and has no model",
            where="run_id",
            remedy="name one that succeeded",
        )
    if run.result.model is None:
        raise RequestError(f"run '{run.id}' holds no model", where="run_id", remedy="identify the set again")
    return run.result.model


def remarks_of(run: Run, *, weighed: bool) -> list[str]:
    """Return what holds for all predictions of a run: whether own weight is in them, and K_c in the fit."""
    remarks = [] if weighed else ["own weight is left out, as no masses are given"]
    if run.request.complementary_stiffness == "neglected":
        remarks.append(
            "the run neglects the complementary stiffness K_c, which the prediction includes: identify with "
            "complementary_stiffness included"
        )
    return remarks


def no_bound(error: ModelError | None, reason: str | None, confidence: float) -> list[str]:
    """Return why there is no bound of the model error in any case, if there is none."""
    level = f"no bound of the model error at {100 * confidence:g} %"
    if error is None:
        return [f"no bound of the model error: {reason or 'no posture could be left out'}"]
    needed = error.needed(confidence)
    if error.postures < needed:
        return [f"{level}: it takes {needed} postures, and there are {error.postures}"]
    if np.isinf(error.quantile(confidence)):
        return [f"{level}: too many postures twist a joint that the others do not determine"]
    return []
