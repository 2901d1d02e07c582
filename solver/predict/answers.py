"""Results that people read, filled from arrays: the model of a run as it is stored, load cases, maps."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, isfinite
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from jointstiff.schemas import deflection as cases
from jointstiff.schemas import model as stored_as
from jointstiff.schemas.fields import Message
from jointstiff.schemas.run import Budget
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.convex.solution import Bounds, Constraints
from jointstiff.solver.errors import JointstiffError, RequestError
from jointstiff.solver.fitting.fit import Likelihood
from jointstiff.solver.links.model import ElasticColumns
from jointstiff.solver.messages import finite, rows
from jointstiff.solver.predict.forward import Deflection, ForwardModel
from jointstiff.solver.predict.maps import STATUSES, DeflectionMap
from jointstiff.solver.predict.model_error import ModelError, ModelErrorBound
from jointstiff.solver.predict.models import ElasticPredictor, IdentifiedWeight, JointModel, OwnWeight
from jointstiff.solver.robot.model import Robot

_EXTRAPOLATED: Final = 1.0 + 1e-6
_SHARES: Final = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
_BLOCKS: Final = {
    f"{moved}_by_{load}": (slice(3 * i, 3 * i + 3), slice(3 * k, 3 * k + 3))
    for i, moved in enumerate(("translation", "rotation"))
    for k, load in enumerate(("force", "moment"))
}

_OF_ERROR: Final = ("postures", "force", "moment", "least_load", "leverage", "noise")
"""Numbers of a model error that are stored as they are."""

Answer = TypeVar("Answer", bound=Message)


def answers_of(
    kind: type[Answer], where: Sequence[bool] | BoolArray, **columns: npt.NDArray[Any] | Sequence[Any]
) -> list[Answer | None]:
    """Return a message for each row of columns, as `rows` does, and None where there is none."""
    there = np.flatnonzero(where).tolist()
    answers: list[Answer | None] = [None] * len(where)
    chosen = rows(kind, **{name: [column[i] for i in there] for name, column in columns.items()})
    for i, answer in zip(there, chosen, strict=True):
        answers[i] = answer
    return answers


def _rounded(values: FloatArray) -> list[float]:
    return [float(f"{value:.8g}") for value in values.tolist()]


def stored_model(
    model: JointModel | ElasticPredictor, error: ModelError | JointstiffError
) -> stored_as.IdentifiedModel:
    """Return a model as it is stored with its run, with its model error or the reason why it has none."""
    part = _elastic_part(model) if isinstance(model, ElasticPredictor) else _joint_part(model)
    residuals: dict[str, Any] = {"error": None}
    if isinstance(error, ModelError):
        steps = rows(stored_as.ScoreStep, score=error.score, share=error.share)
        residuals = {"error": {"steps": steps} | {name: getattr(error, name) for name in _OF_ERROR}}
    else:
        residuals["no_error"] = error.reason
    names = {"joints": model.robot.joint_names, "degrees_of_freedom": model.degrees_of_freedom}
    return stored_as.IdentifiedModel.model_validate(names | part | residuals)


def _joint_part(model: JointModel) -> dict[str, Any]:
    names, likelihood, bounds, weight = (
        model.robot.joint_names,
        model.likelihood,
        model.constraints.bounds,
        None,
    )
    if isinstance(model.weight, IdentifiedWeight):
        weight = {name: getattr(model.weight, name).tolist() for name in ("gravity", "mass", "centre")}
        weight["covariance_root"] = [_rounded(row) for row in model.weight.root]
    given = None if likelihood is None else likelihood.given_rows
    return {
        "compliance": model.compliance.tolist(),
        "seen": [] if likelihood is None else [names[j] for j in likelihood.joints],
        "estimate": [] if likelihood is None else likelihood.centre.tolist(),
        "covariance": [] if likelihood is None else likelihood.covariance.tolist(),
        "information_root": None if given is None else given.tolist(),
        "lower": [finite(value) for value in bounds.lower],
        "upper": [finite(value) for value in bounds.upper],
        "order": model.constraints.order,
        "weight": weight,
    }


def _elastic_part(model: ElasticPredictor) -> dict[str, Any]:
    names, n = model.robot.joint_names, model.robot.n
    own = np.zeros(model.columns.width)
    own[model.kept] = model.entries
    root = np.zeros(0) if model.root is None else model.root[np.triu_indices(len(model.kept))]
    return {
        "compliance": own[model.columns.joints].tolist(),
        "seen": [names[j] for j in np.flatnonzero(model.seen)],
        **dict.fromkeys(("estimate", "covariance", "order"), ()),
        "information_root": None,
        "lower": [0.0] * n,
        "upper": [None] * n,
        "elastic": {
            "links": [names[j] for j in model.columns.links],
            "columns": model.kept.tolist(),
            "entries": model.entries.tolist(),
            "covariance_root": _rounded(root),
        },
    }


def forward_model(
    robot: Robot, stored: stored_as.IdentifiedModel, weight: OwnWeight | None = None
) -> tuple[ForwardModel, ModelError | None]:
    """Return the model of a run, ready to predict.

    Args:
        robot: that was measured.
        stored: model of the run.
        weight: own weight of the links, which only elastic joints take; None leaves it out.

    Raises:
        RequestError: it is of another robot.
    """
    if list(robot.joint_names) != stored.joints:
        raise RequestError(
            f"the run is of a robot with the joints {', '.join(stored.joints)}",
            where="run_id",
            remedy="give the robot that was measured",
        )
    error = None
    if stored.error is not None:
        score = _limits([step.score for step in stored.error.steps], np.inf)
        share = np.array([step.share for step in stored.error.steps], dtype=np.float64)
        error = ModelError(
            score=score, share=share, **{name: getattr(stored.error, name) for name in _OF_ERROR}
        )
    model: ForwardModel
    if stored.elastic is None:
        likelihood = None
        if stored.covariance:
            seen = np.array([robot.joint_names.index(name) for name in stored.seen], dtype=np.intp)
            rows_given = None if stored.information_root is None else np.array(stored.information_root)
            likelihood = Likelihood(seen, np.array(stored.estimate), np.array(stored.covariance), rows_given)
        model = JointModel(
            robot,
            np.array(stored.compliance),
            likelihood,
            Constraints(
                Bounds(_limits(stored.lower, -np.inf), _limits(stored.upper, np.inf)), tuple(stored.order)
            ),
            weight,
            degrees_of_freedom=stored.degrees_of_freedom,
        )
    else:
        part, root = stored.elastic, None
        if part.covariance_root:
            root = np.zeros((len(part.columns), len(part.columns)))
            root[np.triu_indices(len(part.columns))] = part.covariance_root
        model = ElasticPredictor(
            robot,
            ElasticColumns(robot.n, tuple(robot.joint_names.index(name) for name in part.links)),
            np.array(part.columns, dtype=np.intp),
            np.array(part.entries),
            root,
            np.isin(np.array(robot.joint_names), stored.seen),
            degrees_of_freedom=stored.degrees_of_freedom,
        )
    return model, error


def _limits(values: Sequence[float | None], limit: float) -> FloatArray:
    return np.array([limit if value is None else value for value in values], dtype=np.float64)


def case_results(
    bent: Deflection,
    bound: ModelErrorBound | None,
    directions: FloatArray,
    confidence: float,
    labels: Sequence[str],
    budget: Budget | None,
) -> list[cases.CaseResult]:
    """Return each load case; one that twists a joint of which nothing is known has its reason instead.

    Args:
        bent: deflections of B cases.
        bound: model error of their displacements; None where it has no bound.
        directions: (B, 3) unit vectors along which stiffness is asked for; NaN where there are none.
        confidence: level of the intervals.
        labels: of the cases.
        budget: of the run; None without one.
    """
    unseen, intervals, names = bent.unseen, bent.interval(confidence), bent.model.robot.joint_names
    there = np.asarray(~unseen.any(axis=1))
    readings: Sequence[cases.ReadingsInterval | None] = [None] * len(labels)
    with_error: Sequence[cases.ModelErrorInterval | None] = readings  # type: ignore[assignment]
    radius = np.full(len(labels), np.inf)
    if intervals is not None:
        readings = answers_of(
            cases.ReadingsInterval, there, displacement=intervals[:, :3], rotation=intervals[:, 3:]
        )
    if bound is not None:
        radius = bound.radius
        with_error = answers_of(
            cases.ModelErrorInterval,
            there & np.isfinite(radius),
            displacement=bound.interval(bent.displacement, intervals),
            radius=radius,
            load_ratio=bound.load_ratio,
            leverage_ratio=bound.leverage_ratio,
        )
    answers = answers_of(
        cases.CaseResult,
        there,
        label=labels,
        displacement=bent.displacement,
        rotation=bent.rotation,
        readings_only=readings,
        with_model_error=with_error,
        compliance=_compliances(bent, directions, there),
        remarks=[[] if bound is None else _extrapolation(bound, b) for b in range(len(labels))],
        budget=_budgets(bent, budget, radius, bent.model.quantile(confidence)),
    )
    numbers = dict.fromkeys(("displacement", "rotation", "readings_only", "with_model_error", "compliance"))
    for b in np.flatnonzero(~there).tolist():
        reason = (
            f"the load or own weight twists {', '.join(np.array(names)[unseen[b]])}, which the readings of "
            "the run do not determine: the prediction is not valid"
        )
        answers[b] = cases.CaseResult.model_validate({"label": labels[b], "remarks": [reason], **numbers})
    return [case for case in answers if case is not None]


def _extrapolation(bound: ModelErrorBound, b: int) -> list[str]:
    load, leverage = float(bound.load_ratio[b]), float(bound.leverage_ratio[b])
    remarks = []
    if np.isinf(load):
        remarks.append(f"extrapolated: no {bound.unmeasured} was measured, so its model error has no bound")
    elif load > _EXTRAPOLATED:
        remarks.append(f"extrapolated: the load is {load:.2g} times the greatest that was measured")
    if np.isfinite(load) and leverage > _EXTRAPOLATED:
        remarks.append(
            f"extrapolated: the readings determine this posture and place {leverage:.2g} times less than "
            "the worst measured target"
        )
    return remarks


def _compliances(
    bent: Deflection, directions: FloatArray, there: BoolArray
) -> list[cases.CartesianCompliance | None]:
    found, worst, known = bent.compliance, bent.compliance.worst, ~np.isnan(directions[:, 0])
    u = np.where(known[:, None], directions, [1.0, 0.0, 0.0])
    along = answers_of(
        cases.DirectionalStiffness,
        there & known,
        direction=u,
        lateral_free=found.stiffness_lateral_free(u),
        lateral_blocked=found.stiffness_lateral_blocked(u),
        rotation_blocked=found.stiffness_rotation_blocked(u),
        compliance=found.along(u),
        standard_uncertainty=found.deviation_along(u),
    )
    return answers_of(
        cases.CartesianCompliance,
        there,
        **{name: found.matrix[:, moved, load] for name, (moved, load) in _BLOCKS.items()},
        symmetric=found.symmetric,
        along=along,
        worst=answers_of(cases.WorstDirection, there, **vars(worst)),
    )


def _budgets(
    bent: Deflection, budget: Budget | None, radius: FloatArray, factor: float
) -> Sequence[cases.DeflectionBudget | None]:
    """Return the budget of each displacement's length, by the covariances of the run's components."""
    if budget is None:
        return [None] * len(radius)
    joints = bent.model.robot.joint_names
    shown = [joints.index(name) for name in budget.joints]
    covariances = np.zeros((len(budget.components), len(joints), len(joints)))
    for k, part in enumerate(budget.components):
        size = np.array(part.contributions)
        covariances[np.ix_([k], shown, shown)] = np.outer(size, size) * np.array(part.correlation)
    budgets = []
    for contributions, ball in zip(
        bent.length_uncertainties(covariances).tolist(), radius.tolist(), strict=True
    ):
        components = [
            cases.DeflectionComponent(
                source=part.source, evaluation=part.evaluation, included=part.included, contribution=size
            )
            for part, size in zip(budget.components, contributions, strict=True)
            if part.source != "model_error"
        ]
        if isfinite(ball):
            error = ball / factor
            components.append(
                cases.DeflectionComponent(
                    source="model_error", evaluation="A", included=False, contribution=error
                )
            )
        combined = hypot(*(part.contribution for part in components if part.included))
        budgets.append(
            cases.DeflectionBudget(
                components=components,
                standard_uncertainty=combined,
                coverage_factor=factor,
                expanded_uncertainty=factor * combined,
                expanded_with_model_error=factor * hypot(*(part.contribution for part in components)),
            )
        )
    return budgets


def map_numbers(table: DeflectionMap, places: FloatArray, tool: FloatArray) -> dict[str, Any]:
    """Return what sums up a map: counts, quantiles, the worst and the stiffest place.

    Args:
        table: P places.
        places: (P, 3) in R0 [m].
        tool: (O, 3) direction of the tool in each orientation, in R0.
    """
    reached, length = np.flatnonzero(table.reached), table.length
    ends: Sequence[cases.MapPlace | None] = (None, None)
    quantiles: Sequence[cases.MapQuantile] = ()
    if len(reached):
        order = [reached[np.argmax(length[reached])], reached[np.argmin(length[reached])]]
        ends = rows(
            cases.MapPlace,
            position=places[order],
            joints=table.joints[order],
            tool_direction=tool[table.orientation[order]],
            displacement=table.displacement[order],
            deflection=length[order],
            readings_only=table.readings[order],
            with_model_error=table.with_model_error[order],
            compliance_along=table.along[order],
            compliance_across=table.across[order],
            extrapolation=table.extrapolation[order],
        )
        deflections = np.quantile(length[reached], _SHARES)
        quantiles = rows(cases.MapQuantile, share=_SHARES, deflection=deflections)
    return {
        "places": len(table),
        "counts": {name: int((table.status == i).sum()) for i, name in enumerate(STATUSES)},
        "quantiles": quantiles,
        "worst": ends[0],
        "stiffest": ends[1],
        "extrapolated": int((table.extrapolation[reached] > _EXTRAPOLATED).sum()),
    }
