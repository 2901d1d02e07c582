"""Deflections: identified models and load cases to the numerical core, and predictions to messages."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, isfinite
from typing import Final

import numpy as np

from jointstiff.schemas import deflection as messages
from jointstiff.schemas.deflection import DeflectionBudget, DeflectionComponent
from jointstiff.schemas.fields import Vector3
from jointstiff.schemas.map import MapOptions
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.model import ElasticPart, IdentifiedModel, ScoreStep, WeightPart
from jointstiff.schemas.model import ModelError as StoredModelError
from jointstiff.schemas.program import ProgramOptions
from jointstiff.schemas.run import Budget, Run
from jointstiff.service.conversion.robots import joint_index, refuse_far_point, refuse_other_angles
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.problem import Bounds, Constraints
from jointstiff.solver.errors import JointstiffError, RequestError
from jointstiff.solver.fitting.fit import Likelihood
from jointstiff.solver.links.model import ElasticColumns
from jointstiff.solver.messages import finite, message, rows
from jointstiff.solver.predict.forward import ForwardModel, LoadCases
from jointstiff.solver.predict.model_error import ModelError
from jointstiff.solver.predict.models import ElasticPredictor, IdentifiedWeight, JointModel, OwnWeight
from jointstiff.solver.robot.model import Robot

MAX_CASE_WORK: Final = 150_000
"""Load cases times joints squared in a request. Each end of an interval takes a matrix of the joints."""
_LIMITS: Final = {"lower": -np.inf, "upper": np.inf}


def to_identified_model(model: JointModel, error: ModelError | JointstiffError) -> IdentifiedModel:
    """Return a model as it is stored with its run, with its model error or the reason why it has none."""
    names, likelihood, bounds = model.robot.joint_names, model.likelihood, model.constraints.bounds
    given = None if likelihood is None else likelihood.given_rows
    weight = None
    if isinstance(model.weight, IdentifiedWeight):
        root = [[float(f"{value:.8g}") for value in row] for row in model.weight.root.tolist()]
        weight = message(WeightPart, model.weight, covariance_root=root)
    return IdentifiedModel(
        joints=list(names),
        compliance=model.compliance.tolist(),
        seen=[] if likelihood is None else [names[j] for j in likelihood.joints],
        estimate=[] if likelihood is None else likelihood.centre.tolist(),
        covariance=[] if likelihood is None else likelihood.covariance.tolist(),
        information_root=None if given is None else given.tolist(),
        lower=[finite(value) for value in bounds.lower],
        upper=[finite(value) for value in bounds.upper],
        order=list(model.constraints.order),
        weight=weight,
        degrees_of_freedom=model.degrees_of_freedom,
        error=_stored_error(error) if isinstance(error, ModelError) else None,
        no_error=error.reason if isinstance(error, JointstiffError) else None,
    )


def _stored_error(error: ModelError) -> StoredModelError:
    return StoredModelError(
        postures=error.postures,
        steps=rows(ScoreStep, score=error.score, share=error.share),
        force=error.force,
        moment=error.moment,
        least_load=error.least_load,
        leverage=error.leverage,
    )


def to_elastic_model(model: ElasticPredictor, error: ModelError | JointstiffError) -> IdentifiedModel:
    """Return an elastic model as it is stored with its run."""
    names, n = model.robot.joint_names, model.robot.n
    own = np.zeros(model.columns.width)
    own[model.kept] = model.entries
    root = np.zeros(0) if model.root is None else model.root[np.triu_indices(len(model.kept))]
    return IdentifiedModel(
        joints=list(names),
        compliance=own[model.columns.joints].tolist(),
        seen=[names[j] for j in np.flatnonzero(model.seen)],
        estimate=[],
        covariance=[],
        information_root=None,
        lower=[0.0] * n,
        upper=[None] * n,
        order=[],
        elastic=ElasticPart(
            links=[names[j] for j in model.columns.links],
            columns=model.kept.tolist(),
            entries=model.entries.tolist(),
            covariance_root=[float(f"{value:.8g}") for value in root],
        ),
        degrees_of_freedom=model.degrees_of_freedom,
        error=_stored_error(error) if isinstance(error, ModelError) else None,
        no_error=error.reason if isinstance(error, JointstiffError) else None,
    )


def to_forward_model(
    robot: Robot, stored: IdentifiedModel, weight: OwnWeight | None = None
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
    error = None if stored.error is None else _model_error(stored.error)
    part = stored.elastic
    if part is None:
        return _joint_model(robot, stored, weight), error
    count = len(part.columns)
    root: FloatArray | None = None
    if part.covariance_root:
        root = np.zeros((count, count))
        root[np.triu_indices(count)] = part.covariance_root
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


def _joint_model(robot: Robot, stored: IdentifiedModel, weight: OwnWeight | None) -> JointModel:
    likelihood = None
    if stored.covariance:
        joints = np.array([robot.joint_names.index(name) for name in stored.seen], dtype=np.intp)
        root = None if stored.information_root is None else np.array(stored.information_root)
        likelihood = Likelihood(joints, np.array(stored.estimate), np.array(stored.covariance), root)
    lower, upper = (_bound(getattr(stored, name), limit) for name, limit in _LIMITS.items())
    return JointModel(
        robot,
        np.array(stored.compliance),
        likelihood,
        Constraints(Bounds(lower, upper), tuple(stored.order)),
        weight,
        degrees_of_freedom=stored.degrees_of_freedom,
    )


def _model_error(stored: StoredModelError) -> ModelError:
    return ModelError(
        postures=stored.postures,
        score=_bound([step.score for step in stored.steps], np.inf),
        share=np.array([step.share for step in stored.steps], dtype=np.float64),
        force=stored.force,
        moment=stored.moment,
        least_load=stored.least_load,
        leverage=stored.leverage,
    )


def to_load_cases(request: messages.DeflectionOptions, robot: Robot) -> LoadCases:
    """Return load cases in SI units.

    Raises:
        RequestError: too many cases for the joints, angles for another number of joints, no load point, a
            point that no tool reaches, or a moment without a unit.
    """
    most = MAX_CASE_WORK // robot.n**2
    if len(request.cases) > most:
        raise RequestError(
            f"{len(request.cases)} cases for {robot.n} joints: cases times joints squared exceed "
            f"{MAX_CASE_WORK:,}",
            where="cases",
            remedy=f"ask for at most {most} at a time",
        )
    units, length = request.units, LENGTH[request.units.length]
    refuse_far_point(request.load_point, "load_point", length=length)
    refuse_far_point(request.place, "place", length=length)
    for i, case in enumerate(request.cases):
        refuse_other_angles(robot, case.joints, f"cases[{i}].joints")
        refuse_far_point(case.load_point, f"cases[{i}].load_point", length=length)
        refuse_far_point(case.place, f"cases[{i}].place", length=length)
    points = [case.load_point or request.load_point for case in request.cases]
    if None in points:
        raise RequestError(
            "the load point is missing",
            where=f"cases[{points.index(None)}].load_point",
            remedy="give load_point, in the flange frame, for all cases or for each",
        )
    places = [case.place or request.place or point for case, point in zip(request.cases, points, strict=True)]
    moments = _vectors([case.moment or (0.0, 0.0, 0.0) for case in request.cases])
    return LoadCases(
        joints=ANGLE[units.angle] * np.array([case.joints for case in request.cases], dtype=np.float64),
        force=FORCE[units.force] * _vectors([case.force for case in request.cases]),
        moment=moment_factor(units, moments) * moments,
        load_point=length * _vectors(points),
        place=length * _vectors(places),
    )


def to_directions(request: messages.DeflectionOptions, cases: LoadCases) -> FloatArray:
    """Return unit vectors (B, 3) along which stiffness is asked for; NaN where there are none."""
    directions = np.array(
        [case.direction or force for case, force in zip(request.cases, cases.force, strict=True)]
    )
    size = np.linalg.norm(directions, axis=1, keepdims=True)
    return np.where(size > 0.0, directions / np.where(size > 0.0, size, 1.0), np.nan)


def to_own_weight(
    request: messages.DeflectionOptions | MapOptions | ProgramOptions, robot: Robot, run: Run
) -> OwnWeight | None:
    """Return the own weight of the links: the run's for absolute positions, or of stated masses, or None.

    Raises:
        RequestError: the run has no own weight, the robot no such joint, or one has two masses.
    """
    stated = [] if isinstance(request, MapOptions) else request.masses
    if request.absolute:
        model = None if run.result is None else run.result.model
        if model is None or model.weight is None or stated:
            raise RequestError(
                f"sag takes the own weight of the run: '{run.id}' has none, or masses are stated, too",
                where="absolute",
                remedy="choose a run with `weight` and without balancers, and leave `masses` out",
            )
        part = model.weight
        mass, centre, gravity, root = (
            np.array(each) for each in (part.mass, part.centre, part.gravity, part.covariance_root)
        )
        return IdentifiedWeight(mass, centre, gravity, root=root)
    if isinstance(request, MapOptions) or not stated:
        return None
    mass, centre = np.zeros(robot.n), np.zeros((robot.n, 3))
    for i, link in enumerate(stated):
        j = joint_index(robot, link.joint, f"masses[{i}].joint")
        if link.joint in (other.joint for other in stated[:i]):
            raise RequestError(
                f"'{link.joint}' has a mass already",
                where=f"masses[{i}].joint",
                remedy="give each joint one mass, at the common centre of what it carries",
            )
        mass[j], centre[j] = link.mass, LENGTH[request.units.length] * np.array(link.centre)
    return OwnWeight(mass, centre)


def _vectors(rows: Sequence[Vector3 | None]) -> FloatArray:
    return np.array(rows, dtype=np.float64)


def moment_factor(units: Units, moments: FloatArray) -> float:
    """Return N·m in the unit of moments.

    Raises:
        RequestError: there are moments, whose unit is not stated, and the others do not imply it.
    """
    if units.moment is not None:
        return MOMENT[units.moment]
    if units.length == "m" or not moments.any():
        return FORCE[units.force]
    raise RequestError(
        "a load has a moment, whose unit is not clear when lengths are in mm",
        where="units.moment",
        remedy=f"state units.moment, one of {', '.join(MOMENT)}",
    )


def _bound(values: list[float | None], limit: float) -> FloatArray:
    return np.array([limit if value is None else value for value in values], dtype=np.float64)


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
