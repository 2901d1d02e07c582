"""Elastic links of a whole set, fitted with a penalty whose weight is known: method.md §7."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from math import sqrt
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.convex.conic import diagonal, effective_freedom, raised, to_matrix
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.inference.prediction import Prediction
from jointstiff.solver.links.cross_validation import Folds
from jointstiff.solver.links.effective import EffectiveIntervals, effective_rows
from jointstiff.solver.links.estimate import (
    Companion,
    ElasticEstimate,
    Element,
    ElementKind,
    LinkCertificate,
    LinkCompliance,
    principal,
)
from jointstiff.solver.links.losses import LossProblem
from jointstiff.solver.links.model import ElasticModel, Formulation
from jointstiff.solver.links.regressor import ElasticRows, elastic_blocks
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot

CERTIFIED_GAP: Final = 1e-2
"""Largest gap of an accepted certificate, in units of sigma."""
_DESIRED_GAP: Final = 1e-3
"""Gap aimed at where rounding allows it: the ranks of the matrices are then certain."""
_SOLVED_GAP: Final = 0.8 * CERTIFIED_GAP
"""Largest gap of the solution: raising its matrices to be semidefinite may add a little."""
_LEAST_SCALE: Final = 1e-6
"""Smallest residual scale relative to the readings: data without noise need a scale, too."""
_LEAST_FREEDOM: Final = 0.5
"""Degrees of freedom below which the residuals do not determine sigma."""


def refuse_unsupported_elastic(measurements: Measurements, settings: Settings) -> None:
    """Refuse what does not go with more than joints, before any work is done.

    K_c is left out where links bend, whatever the settings: at 1 kN it changes 0.05 % of a deflection.

    Raises:
        UnsupportedMethodError: naming the option and what to do.
    """
    positive = bool((settings.bounds.lower == 0.0).all() and np.isinf(settings.bounds.upper).all())
    refused = (
        (settings.method != "partial_pose", "method", "use method partial_pose"),
        (settings.weighting != "covariance", "weighting", "use weighting covariance"),
        (not positive, "stiffness_bounds", "omit `stiffness_bounds`, and leave `non_negative` true"),
        (bool(settings.order), "stiffness_order", "omit `stiffness_order`"),
        (settings.prior is not None, "priors", "omit `priors`"),
        (measurements.encoders is not None, "encoder_readings", "omit the encoder readings"),
        (measurements.direction is not None, "directional_readings", "omit the readings along a direction"),
    )
    for is_refused, where, remedy in refused:
        if is_refused:
            raise UnsupportedMethodError(
                f"an elasticity other than joints cannot be combined with this {where.replace('_', ' ')}",
                where=where,
                remedy=f"{remedy}, or use elasticity joints",
            )


def estimate_elastic(
    robot: Robot, measurements: Measurements, folds: Folds, model: ElasticModel, weight: float
) -> ElasticEstimate:
    """Fit a model to a whole set.

    Args:
        robot: n joints.
        measurements: N observations.
        folds: of the measurements, for their compressed rows.
        model: what bends besides the joints; not joints alone, which need no penalty.
        weight: λ > 0 of the penalty.

    Raises:
        UnsupportedMethodError: the penalty has no scale, or is too small for the optimum to be certified.
    """
    rows, problem = folds.all_rows, folds.problem(model)
    formulation = problem.formulation
    scale = _scale(formulation, rows, measurements.sigma)
    unit = scale / problem.size
    try:  # as exactly as rounding allows, and certified in any case
        fitted = problem.fit(weight, gap=_DESIRED_GAP * unit, accepted=_SOLVED_GAP * unit)
    except SolverError as error:
        raise _uncertified(weight) from error
    solution, columns = fitted.solution, model.columns
    compliances, least = _returned(formulation.compliances(solution.x), model)
    gap = problem.gap_at(compliances, weight, fitted) / unit
    if not gap <= CERTIFIED_GAP:
        raise _uncertified(weight)
    weighted, shared, shared_weight = problem.companion(rows, compliances, weight, fitted.threshold)
    freedom, left, sigma, chi_square = _residuals(
        weighted, shared, shared_weight, compliances, measurements.sigma
    )
    elements, prediction = _explained(robot, measurements, model, compliances)
    seen = np.isin(np.arange(robot.n), formulation.columns)
    joints = to_matrix(compliances[columns.coupling], columns.n) + np.diag(compliances[columns.joints])
    return ElasticEstimate(
        model=model,
        penalty=weight,
        compliance=np.where(seen, np.diagonal(joints), np.nan),
        coupled_joints=joints if model.name == "coupled_joints" else None,
        entries=compliances,
        links=tuple(_links(compliances, model, freedom)),
        elements=elements,
        prediction=prediction,
        sigma=sigma,
        chi_square=chi_square,
        degrees_of_freedom=left,
        effective_freedom=float(freedom.sum()),
        parameters=len(formulation.columns),
        certificate=LinkCertificate(least, solution.certificate.dual, gap, float(scale), solution.tolerance),
        companion=_companion(problem, rows, compliances, weight, measurements.sigma),
    )


def _companion(
    problem: LossProblem, rows: ElasticRows, compliances: FloatArray, weight: float, stated: float | None
) -> Companion:
    """Return the plain squares beside a fit, their sigma raised where the residuals exceed what is stated."""
    weight = problem.weight_of_squares(compliances, weight)
    _, left, sigma, chi_square = _residuals(rows, problem.formulation, weight, compliances, stated)
    if stated is None or sigma is None:
        return Companion(problem.formulation, weight, sigma, left)
    excess = sqrt(chi_square / left) if left >= _LEAST_FREEDOM else 1.0
    return Companion(problem.formulation, weight, sigma * max(1.0, excess), None)


def first_certified(
    robot: Robot, measurements: Measurements, folds: Folds, model: ElasticModel, weights: Sequence[float]
) -> ElasticEstimate:
    """Fit a model with the first of some ascending weights whose optimum is certified.

    Raises:
        UnsupportedMethodError: none is; the error is that of the last.
    """
    for weight in weights[:-1]:
        try:
            return estimate_elastic(robot, measurements, folds, model, weight)
        except UnsupportedMethodError:
            continue
    return estimate_elastic(robot, measurements, folds, model, weights[-1])


def _residuals(
    rows: ElasticRows, squares: Formulation, weight: float, compliances: FloatArray, sigma: float | None
) -> tuple[FloatArray, float, float | None, float]:
    """Return the freedom (P,) of each column, what is left, sigma [m] and chi-square under it.

    Sigma is of the residuals if it is not given.
    """
    x = compliances[squares.columns] / squares.unit
    freedom = np.zeros(squares.width)
    freedom[squares.columns] = effective_freedom(squares.program(weight), x)
    left = max(0.0, rows.readings - float(freedom.sum()))
    total = float(np.square(rows.triangle[:, :-1] @ compliances - rows.triangle[:, -1]).sum())
    if sigma is None and left >= _LEAST_FREEDOM:
        sigma = sqrt(total / left)
    return freedom, left, sigma, total / sigma**2 if sigma else 0.0


def _scale(formulation: Formulation, rows: ElasticRows, sigma: float | None) -> float:
    """Return the unit of gaps [m]: sigma, or the residuals where they are greater.

    The residual scale of joints alone, with its model error as noise, replaces an unknown sigma.
    The least that the model leaves without constraints is no noise that sigma knows of: no optimum is
    needed more exactly than that.
    """
    fit, joints = formulation.fit, formulation.joints
    R = fit.R[:, joints]
    alone = float(np.linalg.norm(R @ np.linalg.lstsq(R, fit.z, rcond=None)[0] - fit.z))
    least = float(np.linalg.norm(fit.R @ fit.near - fit.z))
    stated = sigma or max(alone, _LEAST_SCALE) * formulation.size / sqrt(max(1, rows.readings - len(joints)))
    return max(stated, least * formulation.size / sqrt(max(1, rows.readings)))


def _uncertified(weight: float) -> UnsupportedMethodError:
    return UnsupportedMethodError(
        f"with a penalty of {weight:.3g} rounding hides which links bend: no optimum can be certified",
        where="link_penalty",
        remedy=f"give link_penalty {10.0 * weight:.0e} or more, choose fewer links, or omit link_penalty",
    )


def _returned(compliances: FloatArray, model: ElasticModel) -> tuple[FloatArray, float]:
    """(P,) compliances whose matrices, in SI units, have no computed eigenvalue below zero, and the least."""
    out, columns = compliances.copy(), model.columns
    places = [(6, columns.link(joint)) for joint in columns.links] + [(columns.n, columns.coupling)]
    least = [float(out[columns.joints].min())]
    for size, own in places:
        if out[own].any():
            out[own] = raised(out[own], size)
            least.append(float(np.linalg.eigvalsh(to_matrix(out[own], size)).min()))
    return out, min(least)


def effective_compliances(robot: Robot, elastic: ElasticEstimate) -> FloatArray:
    """(n,) of the joints with their links' rotations about their axes [rad/(N·m)]; NaN of joints not seen."""
    effective = effective_rows(robot, elastic.model.columns) @ elastic.entries
    return np.where(np.isnan(elastic.compliance), np.nan, effective)


def effective_intervals(
    robot: Robot, elastic: ElasticEstimate, confidence: float
) -> EffectiveIntervals | None:
    """Return the intervals of the effective compliances; None where no uncertainty is known."""
    companion = elastic.companion
    if companion.sigma is None:
        return None
    rows = effective_rows(robot, elastic.model.columns)
    with suppress(SolverError):
        return EffectiveIntervals.of(
            companion.formulation,
            companion.weight,
            rows,
            rows @ elastic.entries,
            sigma=companion.sigma,
            quantile=companion.quantile(confidence),
        )
    return None


def _links(compliances: FloatArray, model: ElasticModel, freedom: FloatArray) -> Iterator[LinkCompliance]:
    if model.name in {"joints", "coupled_joints"}:
        return
    for joint in model.columns.links:
        own = model.columns.link(joint)
        matrix = to_matrix(compliances[own], 6)
        yield LinkCompliance(
            joint=joint,
            matrix=matrix,
            translation=principal(matrix[:3, :3]),
            rotation=principal(matrix[3:, 3:]),
            effective_freedom=float(freedom[own].sum()),
            parameters=6 if model.name == "diagonal_links" else len(own),
        )


def _explained(
    robot: Robot, measurements: Measurements, model: ElasticModel, compliances: FloatArray
) -> tuple[tuple[Element, ...], Prediction]:
    """Return what each element explains of the measured deflections, and all of them together."""
    places = list(_places(model))
    predicted, along = [], []
    for block, rows in elastic_blocks(robot, measurements, model.columns):
        # Whatever was not read is zero, in the rows as in the deflections.
        weighed = np.einsum("btip,bti->bp", rows[..., :-1], block.measurements.deflection) * compliances
        along.append(np.stack([weighed[:, own].sum(axis=1) for _, _, own in places]))
        predicted.append(rows[..., :-1] @ compliances)
    moved = np.square(measurements.deflection).sum(axis=(1, 2))
    worked = np.concatenate(along, axis=1)
    share = np.divide(worked, moved, out=np.zeros_like(worked), where=moved > 0.0)
    elements = tuple(
        Element(kind, joint, float(worked[number].sum() / moved.sum()), share[number])
        for number, (kind, joint, _) in enumerate(places)
    )
    return elements, Prediction.of(measurements, np.concatenate(predicted))


def _places(model: ElasticModel) -> Iterator[tuple[ElementKind, int | None, IndexArray]]:
    """Kind, joint and columns of each element."""
    columns = model.columns
    own = columns.coupling[diagonal(columns.n)]
    for joint in range(columns.n):
        yield "joint", joint, np.array([columns.joints[joint], own[joint]])
    if model.name == "coupled_joints":
        yield "coupling", None, np.setdiff1d(columns.coupling, own)
    elif model.name != "joints":
        for joint in columns.links:
            yield "link", joint, columns.link(joint)
