"""Elastic links of a whole set, fitted with a penalty whose weight is known: method.md §7."""

from __future__ import annotations

from collections.abc import Iterator
from math import sqrt
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.convex import (
    ConeSolution,
    certify_cone,
    diagonal,
    effective_freedom,
    raised,
    solve_cone,
    to_matrix,
)
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.fitting import Settings
from jointstiff.solver.inference import Prediction
from jointstiff.solver.links.cross_validation import Folds
from jointstiff.solver.links.estimate import (
    ElasticEstimate,
    Element,
    ElementKind,
    LinkCertificate,
    LinkCompliance,
    principal,
)
from jointstiff.solver.links.model import ElasticModel, Formulation, formulate
from jointstiff.solver.links.regressor import ElasticColumns, ElasticRows, elastic_blocks
from jointstiff.solver.readings import Measurements
from jointstiff.solver.robot import Robot

CERTIFIED_GAP: Final = 1e-2
"""Of a certificate that is accepted, in units of sigma."""
_DESIRED_GAP: Final = 1e-3
"""Where rounding allows it: the ranks of the matrices are then beyond doubt."""
_LEAST_SCALE: Final = 1e-6
"""Of a residual, beside the readings: data without noise have a scale, too."""
_LEAST_FREEDOM: Final = 0.5
"""Degrees of freedom below which the residuals say nothing of sigma."""


def refuse_unsupported_elastic(measurements: Measurements, settings: Settings) -> None:
    """Refuse what does not go with more than joints, before any work is done.

    Raises:
        UnsupportedMethodError: naming the option and what to do.
    """
    positive = bool((settings.bounds.lower == 0.0).all() and np.isinf(settings.bounds.upper).all())
    refused = (
        (settings.method != "partial_pose", "method", "use method partial_pose"),
        (settings.weighting != "covariance", "weighting", "use weighting covariance"),
        (settings.loss != "squared", "loss", "use loss squared without the suspicious readings"),
        (not positive, "stiffness_bounds", "leave bounds out, and compliances positive"),
        (bool(settings.order), "stiffness_order", "leave the order of the joints out"),
        (settings.prior is not None, "priors", "leave the priors out"),
        (settings.complementary_stiffness, "complementary_stiffness", "neglect the complementary stiffness"),
        (measurements.encoders is not None, "encoder_readings", "leave the encoder readings out"),
    )
    for is_refused, where, remedy in refused:
        if is_refused:
            raise UnsupportedMethodError(
                f"elasticity beyond joints does not go with this {where.replace('_', ' ')}",
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
        folds: of the same, for its compressed rows.
        model: what bends besides the joints; not joints alone, which need no penalty.
        weight: λ > 0 of the penalty.

    Raises:
        UnsupportedMethodError: the penalty has no scale.
        SolverError: optimality could not be certified.
    """
    rows = folds.all_rows
    formulation = formulate(rows, model, folds.visible)
    scale = measurements.sigma or _residual_scale(formulation, rows)
    solution = _solved(formulation, weight, scale / formulation.size)
    freedom = _by_column(formulation, effective_freedom(formulation.program(weight), solution.x))
    compliances, least = _returned(formulation.compliances(solution.x), model)
    gap = _judged(formulation, weight, compliances, scale)
    left = max(0.0, rows.readings - float(freedom.sum()))
    sigma, chi_square = _residuals(rows, compliances, left, measurements.sigma)
    elements, prediction = _explained(robot, measurements, model, compliances)
    seen = np.isin(np.arange(robot.n), formulation.columns)
    return ElasticEstimate(
        model=model,
        penalty=weight,
        compliance=np.where(seen, _joint_compliances(compliances, model.columns), np.nan),
        coupled_joints=_coupled(compliances, model),
        entries=compliances,
        links=tuple(_links(compliances, model, freedom)),
        elements=elements,
        prediction=prediction,
        sigma=sigma,
        chi_square=chi_square,
        degrees_of_freedom=left,
        effective_freedom=float(freedom.sum()),
        parameters=len(formulation.columns),
        certificate=LinkCertificate(
            least, solution.certificate.dual, gap, float(scale), solution.certificate.tolerance
        ),
    )


def _residuals(
    rows: ElasticRows, compliances: FloatArray, left: float, sigma: float | None
) -> tuple[float | None, float]:
    """Sigma [m], of the residuals if it is not given, and chi-square under it."""
    squares = float(np.square(rows.triangle[:, :-1] @ compliances - rows.triangle[:, -1]).sum())
    if sigma is None and left >= _LEAST_FREEDOM:
        sigma = sqrt(squares / left)
    return sigma, squares / sigma**2 if sigma else 0.0


def _residual_scale(formulation: Formulation, rows: ElasticRows) -> float:
    """Of joints alone, whose model error stands for noise where sigma is unknown [m]."""
    joints = formulation.joints
    R, z = formulation.fit.R[:, joints], formulation.fit.z
    left = float(np.linalg.norm(R @ np.linalg.lstsq(R, z, rcond=None)[0] - z))
    return max(left, _LEAST_SCALE) * formulation.size / sqrt(max(1, rows.readings - len(joints)))


def _solved(formulation: Formulation, weight: float, scale: float) -> ConeSolution:
    """As exactly as rounding allows, and certified in any case."""
    program = formulation.program(weight)
    try:
        return solve_cone(program, gap=_DESIRED_GAP * scale)
    except SolverError:
        return solve_cone(program, gap=0.5 * CERTIFIED_GAP * scale)


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


def _judged(formulation: Formulation, weight: float, compliances: FloatArray, scale: float) -> float:
    """Gap of what is returned, in units of the scale.

    Raises:
        SolverError: it is not the optimum after all.
    """
    x = compliances[formulation.columns] / formulation.unit
    gap = certify_cone(formulation.program(weight), x, 0.0).gap * formulation.size / scale
    if not gap <= CERTIFIED_GAP:
        raise SolverError(
            f"the gap of what is returned is {gap:.1e} sigma", remedy="report this with the data"
        )
    return gap


def _joint_compliances(compliances: FloatArray, columns: ElasticColumns) -> FloatArray:
    """(n,) the joints' own, with their part of a coupled compliance."""
    coupled = compliances[columns.coupling][diagonal(columns.n)]
    own: FloatArray = compliances[columns.joints] + coupled
    return own


def _coupled(compliances: FloatArray, model: ElasticModel) -> FloatArray | None:
    if model.name != "coupled_joints":
        return None
    columns = model.columns
    return to_matrix(compliances[columns.coupling], columns.n) + np.diag(compliances[columns.joints])


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


def _by_column(formulation: Formulation, shares: FloatArray) -> FloatArray:
    """(P,) numbers of the parameters (p,) at their columns."""
    out = np.zeros(formulation.width)
    out[formulation.columns] = shares
    return out


def _explained(
    robot: Robot, measurements: Measurements, model: ElasticModel, compliances: FloatArray
) -> tuple[tuple[Element, ...], Prediction]:
    """Return what each element explains of the measured deflections, and all of them together."""
    places = list(_places(model))
    predicted, along = [], []
    for block in elastic_blocks(robot, measurements, model.columns):
        deflection = block.base.measurements.deflection
        # Whatever was not read is zero, in the rows as in the deflections.
        weighed = np.einsum("btip,bti->bp", block.rows, deflection) * compliances
        along.append(np.stack([weighed[:, own].sum(axis=1) for _, _, own in places]))
        predicted.append(block.rows @ compliances)
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
