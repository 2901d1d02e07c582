"""Fit of a model of elastic links for a known weight of the penalty, and its results (method.md §7).

A rotation of joint j and a rotation of the link behind this joint about the same axis move every target
alike, so that readings determine at most the sum ``c_j + a_jᵀ C_j,rot a_j``, with a_j the axis in the joint's
frame: the effective compliance. The interval of an effective compliance is its range over all compliances of
the cone whose penalised sum of squares exceeds the least sum by no more than ``(q σ)²``, q the quantile.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, Final, Literal

import numpy as np

from jointstiff.schemas.joints import JOINT_UNITS
from jointstiff.schemas.model import (
    ElasticCompliance,
    ElementShare,
    LinkCertificate,
    PrincipalCompliance,
)
from jointstiff.solver.arrays import FloatArray, IndexArray, fix_axis_signs
from jointstiff.solver.choice.held_out import Folds
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.fit.cone import find_diagonal_entries, lift_diagonal, to_matrix
from jointstiff.solver.fit.conic import (
    compute_effective_freedom,
    compute_penalised_range,
    compute_unconstrained_range,
    solve_cone,
)
from jointstiff.solver.fit.elastic import (
    ElasticColumns,
    ElasticModel,
    Formulation,
    generate_elastic_rows,
)
from jointstiff.solver.fit.estimate import Estimate, JointCompliance, Prediction
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import Certificate, Witness
from jointstiff.solver.fit.stages import student_quantile
from jointstiff.solver.fit.statements import LEAST_STATED_SIGMA, Statements
from jointstiff.solver.mechanics.block import spring_frames
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import BASE, triangle_indices, triangle_weights
from jointstiff.solver.messages import point


@dataclass(frozen=True, eq=False)
class Companion:
    """Least-squares problem without robust weights, from which the uncertainties of an estimate are computed.

    With the weights of a robust loss, residuals near zero would count too much, and uncertainties would be
    too small.
    """

    formulation: Formulation  #: formulation of the whole set
    weight: float  #: weight λ of the penalty
    #: standard uncertainty of one coordinate of one reading [m]: the stated sigma, or the residuals' sigma if
    #: greater; None without degrees of freedom
    sigma: float | None
    degrees_of_freedom: float | None  #: degrees of freedom of a sigma from residuals; None for a stated sigma


@dataclass(frozen=True, eq=False)
class ElasticEstimate:
    """Compliances of joints, links and base from one fit, with residuals, uncertainties and certificate."""

    model: ElasticModel  #: elastic elements that bend, and the loss
    penalty: float  #: weight λ of the penalty
    compliance: FloatArray  #: (n,) joint compliances [rad/(N·m)]; NaN if the readings do not determine one
    #: (n, n) full joint compliance [rad/(N·m)], zero in rows of undetermined joints; None if joints are
    #: not coupled
    coupled_joints: FloatArray | None
    entries: FloatArray  #: (P,) all compliances; deflections are rows @ entries
    links: tuple[ElasticCompliance, ...]  #: compliances of the links that bend
    base: ElasticCompliance | None  #: compliance of the base; None if the model has a rigid base
    elements: tuple[ElementShare, ...]  #: share of the deflections that each element explains
    prediction: Prediction  #: predicted deflections of all targets, and their residuals
    sigma: float | None  #: stated sigma, or sigma from the residuals [m]; None without degrees of freedom
    chi_square: float  #: chi square of the weighted residuals, computed with sigma
    degrees_of_freedom: float  #: number of coordinates read minus the effective freedom
    effective_freedom: float  #: effective number of parameters that the readings determine
    parameters: int  #: number of parameters of the model
    certificate: LinkCertificate  #: certificate of optimality
    companion: Companion  #: least-squares problem from which the uncertainties are computed
    #: (T,) weights of the squares of all targets whose optimum is that of a robust loss; None for squares
    target_weights: FloatArray | None
    penalty_of_squares: float  #: weight of the penalty in a fit by these squares
    statements: Statements | None  #: stated errors that were fitted together with the compliances
    witness: Witness | None  #: comparison of Clarabel's own answer with the certified one
    force_scale: float  #: relative standard uncertainty of the size of all loads

    @property
    def unexplained(self) -> float:
        """Fraction of the measured deflection that no elastic element explains."""
        return 1.0 - sum(element.share for element in self.elements)


def find_principal_compliances(block: FloatArray) -> list[PrincipalCompliance]:
    """Return eigenvalues and eigenvectors of a compliance block (3, 3), the largest compliance first."""
    values, vectors = np.linalg.eigh(block)  # in ascending order
    pairs = zip(np.maximum(values[::-1], 0.0).tolist(), fix_axis_signs(vectors.T[::-1]), strict=True)
    return [PrincipalCompliance(value=value, direction=point(direction)) for value, direction in pairs]


CERTIFIED_GAP: Final = 1e-2
"""Largest duality gap of an accepted certificate, in units of sigma."""
_DESIRED_GAP: Final = 1e-3
"""Duality gap aimed at where rounding allows it: the ranks of the matrices are then certain."""
_SOLVED_GAP: Final = 0.8 * CERTIFIED_GAP
"""Largest accepted gap of the solver's solution, below `CERTIFIED_GAP`: making the matrices of the solution
positive semidefinite may increase the gap a little."""
_LEAST_SCALE: Final = 1e-6
"""Smallest residual scale relative to the readings, so that the scale of data without noise is not zero."""
_LEAST_FREEDOM: Final = 0.5
"""Degrees of freedom below which the residuals do not determine sigma."""


def refuse_unsupported_elastic(settings: Settings) -> None:
    """Refuse options that a model with bending links or base does not support.

    The option of the complementary stiffness is not refused: this stiffness is neglected if links bend,
    because it changes a deflection under 1 kN by 0.05 % only.

    Raises:
        UnsupportedMethodError: an option is not supported; the error names the option and a remedy.
    """
    only_positive = bool((settings.bounds.lower == 0.0).all() and np.isinf(settings.bounds.upper).all())
    # Whether the option is refused, field of the request, remedy
    refused = (
        (settings.method != "partial_pose", "method", "use method partial_pose"),
        (settings.weighting != "covariance", "weighting", "use weighting covariance"),
        (not only_positive, "stiffness_bounds", "omit `stiffness_bounds`, and leave `positive` true"),
        (bool(settings.order), "stiffness_order", "omit `stiffness_order`"),
    )
    for is_refused, where, remedy in refused:
        if is_refused:
            raise UnsupportedMethodError(
                f"the given {where.replace('_', ' ')} works only with elasticity joints",
                where=where,
                remedy=f"{remedy}, or use elasticity joints",
            )


def estimate_elastic(folds: Folds, model: ElasticModel, weight: float) -> ElasticEstimate:
    """Fit an elastic model to the whole set for a given penalty, and certify the optimum.

    Where sigma is not stated, joints alone give the first sigma, by which statements are weighted; the fit is
    repeated with its own sigma.

    Args:
        folds: measurement set with its compressed rows.
        model: elastic elements that bend, and the loss; a model of joints alone is not supported.
        weight: λ > 0 of the penalty.

    Raises:
        UnsupportedMethodError: the penalty has no scale, or is too small for the optimum to be certified.
    """
    first_fit = _estimate_once(folds, folds.formulate_model_fit(model), folds.statements, model, weight)
    if folds.statements is None or folds.measurements.sigma is not None or not first_fit.sigma:
        return first_fit
    statements = replace(folds.statements, sigma=max(first_fit.sigma, LEAST_STATED_SIGMA))
    formulation = folds.formulate_with_statements(model, statements)
    return _estimate_once(folds, formulation, statements, model, weight)


def _estimate_once(
    folds: Folds, formulation: Formulation, statements: Statements | None, model: ElasticModel, weight: float
) -> ElasticEstimate:
    """Fit an elastic model to the whole set, with the columns of stated errors as they are.

    Args:
        folds: measurement set.
        formulation: problem of fitting the model to the whole set.
        statements: stated errors in the rows of the problem; None without any.
        model: elastic elements that bend, and the loss.
        weight: λ > 0 of the penalty.

    Raises:
        UnsupportedMethodError: the penalty is too small for the optimum to be certified.
    """
    robot, measurements = folds.robot, folds.measurements
    gap_scale = _compute_gap_scale(formulation, measurements.sigma)
    # Gap of a certificate that corresponds to one sigma
    gap_of_one_sigma = gap_scale / formulation.compute_gap_unit(model)
    try:  # The solver aims at the desired gap; a larger gap within the accepted limit is no error.
        wanted_gap = _DESIRED_GAP * gap_of_one_sigma
        accepted_gap = _SOLVED_GAP * gap_of_one_sigma
        solution, threshold = formulation.fit(model, weight, gap=wanted_gap, accepted=accepted_gap)
    except SolverError as error:
        raise _build_uncertified_error(weight) from error
    columns = model.columns
    compliances, least_eigenvalue = _make_semidefinite(formulation.convert_to_compliances(solution.x), model)
    unknowns = formulation.convert_to_unknowns(solution)
    unknowns[: len(compliances)] = compliances
    wanted_gap = formulation.certify_gap(compliances, weight, solution, threshold) / gap_of_one_sigma
    if not wanted_gap <= CERTIFIED_GAP:
        raise _build_uncertified_error(weight)
    squares, weight_of_squares = formulation.build_weighted_squares(model, unknowns, weight, threshold)
    effective_freedom, degrees_of_freedom, sigma, chi_square = _summarise_residuals(
        squares, weight_of_squares, compliances, measurements.sigma
    )
    elements, prediction = _compute_element_shares(folds.source, model, statements, unknowns)
    determined = np.isin(np.arange(robot.n), formulation.columns)
    joints = to_matrix(compliances[columns.coupling], columns.n) + np.diag(compliances[columns.joints])
    return ElasticEstimate(
        model=model,
        penalty=weight,
        compliance=np.where(determined, np.diagonal(joints), np.nan),
        coupled_joints=joints if model.name == "coupled_joints" else None,
        entries=compliances,
        links=tuple(
            ElasticCompliance(
                joint=robot.joint_names[frame],
                **_summarise_compliance(compliances, model, effective_freedom, frame),
            )
            for frame in model.frames
            if frame != BASE
        ),
        base=ElasticCompliance(
            joint=None, **_summarise_compliance(compliances, model, effective_freedom, BASE)
        )
        if BASE in model.frames
        else None,
        elements=elements,
        prediction=prediction,
        sigma=sigma,
        chi_square=chi_square,
        degrees_of_freedom=degrees_of_freedom,
        effective_freedom=float(effective_freedom.sum()),
        parameters=len(formulation.columns),
        certificate=LinkCertificate(
            least_eigenvalue=least_eigenvalue,
            dual=solution.certificate.dual,
            gap=wanted_gap,
            scale=float(gap_scale),
        ),
        companion=_build_companion(formulation, model, unknowns, weight),
        target_weights=None
        if model.loss == "squared"
        else formulation.rows.compute_huber_weights(unknowns, threshold),
        penalty_of_squares=weight_of_squares,
        statements=statements,
        witness=solution.certificate.witness,
        force_scale=measurements.common_uncertainty.scale,
    )


def _build_companion(
    formulation: Formulation, model: ElasticModel, unknowns: FloatArray, weight: float
) -> Companion:
    """Return the least-squares problem from which the uncertainties of a fit are computed.

    The stated sigma is raised to the sigma of the residuals, if the residuals are larger.

    Args:
        formulation: rows, cone and units of the fit.
        model: elastic elements that bend, and the loss.
        unknowns: (P + K,) fitted compliances and stated errors.
        weight: weight λ of the penalty in the fit.
    """
    weight = formulation.convert_weight_to_squares(model, unknowns, weight)
    stated, compliances = formulation.sigma, unknowns[: formulation.column_count]
    _, degrees_of_freedom, sigma, chi_square = _summarise_residuals(formulation, weight, compliances, stated)
    if stated is None or sigma is None:
        return Companion(formulation, weight, sigma, degrees_of_freedom)
    excess = sqrt(chi_square / degrees_of_freedom) if degrees_of_freedom >= _LEAST_FREEDOM else 1.0
    return Companion(formulation, weight, sigma * max(1.0, excess), None)


def fit_first_certified(folds: Folds, model: ElasticModel, weights: Sequence[float]) -> ElasticEstimate:
    """Fit a model to the whole set with the smallest penalty in `weights` that gives a certified optimum.

    Args:
        folds: measurement set with its compressed rows.
        model: elastic elements that bend, and the loss.
        weights: weights λ of the penalty to try one after the other, in ascending order.

    Raises:
        UnsupportedMethodError: no optimum is certified; the error names the largest penalty.
    """
    for weight in weights[:-1]:
        try:
            return estimate_elastic(folds, model, weight)
        except UnsupportedMethodError:
            continue
    return estimate_elastic(folds, model, weights[-1])


def _summarise_residuals(
    squares: Formulation, weight: float, compliances: FloatArray, sigma: float | None
) -> tuple[FloatArray, float, float | None, float]:
    """Compute the degrees of freedom, sigma and chi square of a fit from its residuals.

    Args:
        squares: (weighted) least-squares problem of the fit.
        weight: weight λ of the penalty.
        compliances: (P,) fitted compliances.
        sigma: stated standard uncertainty of a coordinate [m]; None if unknown.

    Returns:
        The effective freedom (P,) of each compliance: 1 if the readings determine the compliance, 0 if the
        penalty does; the degrees of freedom of the residuals; sigma [m], computed from the residuals if it is
        not stated, None if there are too few readings; and the chi square of the residuals, 0 without sigma.
    """
    parameters, rows = compliances[squares.columns] / squares.unit, squares.rows
    effective_freedom = np.zeros(squares.column_count)
    effective_freedom[squares.columns] = compute_effective_freedom(
        squares.build_squared_program(weight), parameters
    )
    degrees_of_freedom = max(0.0, rows.count - float(effective_freedom.sum()))
    triangle = rows.with_errors_fitted
    squares_sum = float(np.square(triangle[:, :-1] @ compliances - triangle[:, -1]).sum())
    if sigma is None and degrees_of_freedom >= _LEAST_FREEDOM:
        sigma = sqrt(squares_sum / degrees_of_freedom)
    return effective_freedom, degrees_of_freedom, sigma, squares_sum / sigma**2 if sigma else 0.0


def _compute_gap_scale(formulation: Formulation, sigma: float | None) -> float:
    """Return the length [m] that is the unit of the gaps of certificates.

    The length is sigma, or the rms residual of an unconstrained fit without penalty, if that is greater: an
    optimum more exact than these residuals would have no use. If sigma is None, the rms residual of a fit of
    joints alone replaces sigma.
    """
    fit, rows, joint_count = formulation.squares, formulation.rows, formulation.cone.free
    joint_columns = fit.R[:, :joint_count]
    joints_residual = float(
        np.linalg.norm(joint_columns @ np.linalg.lstsq(joint_columns, fit.z, rcond=None)[0] - fit.z)
    )
    least_residual = float(np.linalg.norm(fit.R @ fit.origin - fit.z))
    joints_scale = max(joints_residual, _LEAST_SCALE) * formulation.size
    noise = sigma or joints_scale / sqrt(max(1, rows.readings - joint_count))
    return max(noise, least_residual * formulation.size / sqrt(max(1, rows.readings)))


def _build_uncertified_error(weight: float) -> UnsupportedMethodError:
    """Build the error for a weight λ of the penalty with which no optimum can be certified."""
    return UnsupportedMethodError(
        f"the fit with a penalty of {weight:.3g} cannot be certified as optimal, because rounding errors "
        "hide which links bend",
        where="link_penalty",
        remedy=f"give link_penalty {10.0 * weight:.0e} or more, choose fewer links, or omit link_penalty",
    )


def _make_semidefinite(compliances: FloatArray, model: ElasticModel) -> tuple[FloatArray, float]:
    """Make the matrices of fitted compliances positive semidefinite.

    Rounding of the scaled optimum may leave small negative eigenvalues in SI units; the diagonals are raised
    accordingly.

    Returns:
        The compliances (P,) with raised diagonals; and the least of all joint compliances and of the
        eigenvalues of all matrices that are not zero.
    """
    raised, columns = compliances.copy(), model.columns
    matrices = [(6, columns.link_columns(frame)) for frame in columns.frames]
    matrices.append((columns.n, columns.coupling))
    least_values = [float(raised[columns.joints].min())]
    for size, entry_columns in matrices:
        if raised[entry_columns].any():  # A matrix of zeros belongs to an element that does not bend.
            raised[entry_columns] = lift_diagonal(raised[entry_columns], size)
            eigenvalues = np.linalg.eigvalsh(to_matrix(raised[entry_columns], size))
            least_values.append(float(eigenvalues.min()))
    return raised, min(least_values)


def _summarise_compliance(
    compliances: FloatArray, model: ElasticModel, freedom: FloatArray, frame: int
) -> dict[str, Any]:
    """Return the fields of the message `ElasticCompliance` of a link or the base, but the field `joint`.

    Args:
        compliances: (P,) fitted compliances.
        model: elastic elements that bend.
        freedom: (P,) effective degrees of freedom of each compliance.
        frame: index of the link, or `BASE`.
    """
    link_columns = model.columns.link_columns(frame)
    matrix = to_matrix(compliances[link_columns], 6)
    return {
        "matrix": matrix.tolist(),
        "translation": find_principal_compliances(matrix[:3, :3]),
        "rotation": find_principal_compliances(matrix[3:, 3:]),
        "effective_freedom": float(freedom[link_columns].sum()),
        "parameters": 6 if model.name == "diagonal_links" else len(link_columns),
    }


def _compute_element_shares(
    source: Rows,
    model: ElasticModel,
    statements: Statements | None,
    unknowns: FloatArray,
) -> tuple[tuple[ElementShare, ...], Prediction]:
    """Compute the share of the measured deflections that each elastic element explains.

    The deflections that an element causes are projected on the measured deflections: their scalar products,
    summed over the targets, are divided by the sum of the squared measured deflections.

    Args:
        source: N observations.
        model: elastic elements that bend.
        statements: stated errors that were fitted; None without any.
        unknowns: (P + K,) fitted compliances and stated errors.

    Returns:
        The shares; and the prediction of all deflections by all elements and stated errors together.
    """
    robot, measurements, columns = source.robot, source.measurements, model.columns
    coupling_diagonal = columns.coupling[find_diagonal_entries(columns.n)]
    # Kind, joint, and columns of each element. A joint's own compliance has a column as a single number, and
    # a column on the diagonal of the coupled compliance; one of the two compliances is zero.
    elements_of_model: list[tuple[Literal["joint", "coupling", "link", "base"], str | None, IndexArray]] = [
        ("joint", robot.joint_names[joint], np.array([columns.joints[joint], coupling_diagonal[joint]]))
        for joint in range(columns.n)
    ]
    if model.name == "coupled_joints":
        elements_of_model.append(("coupling", None, np.setdiff1d(columns.coupling, coupling_diagonal)))
    for frame in model.frames:
        kind: Literal["link", "base"] = "base" if frame == BASE else "link"
        joint_name = None if frame == BASE else robot.joint_names[frame]
        elements_of_model.append((kind, joint_name, columns.link_columns(frame)))
    predicted, predicted_turns, products = [], [], []
    for rows in generate_elastic_rows(source, model.columns, statements):
        # Missing readings add nothing: their rows and deflections are zero.
        # (B, P + K) scalar product of the deflections due to each unknown with the measured deflections
        deflection = rows.block.measurements.deflection
        column_products = np.einsum("btip,bti->bp", rows.targets[..., :-1], deflection) * unknowns
        products.append(
            np.stack(
                [column_products[:, part_columns].sum(axis=1) for _, _, part_columns in elements_of_model]
            )
        )
        predicted.append(rows.targets[..., :-1] @ unknowns)
        if rows.encoders is not None:
            predicted_turns.append(rows.encoders[..., :-1] @ unknowns)
    measured = np.square(measurements.deflection).sum(axis=(1, 2))
    explained = np.concatenate(products, axis=1)
    share_of_observation = np.divide(explained, measured, out=np.zeros_like(explained), where=measured > 0.0)
    elements = tuple(
        ElementShare(
            kind=kind,
            joint=joint,
            share=float(explained[number].sum() / measured.sum()),
            by_observation=share_of_observation[number].tolist(),
        )
        for number, (kind, joint, _) in enumerate(elements_of_model)
    )
    prediction = Prediction.from_predicted(measurements, np.concatenate(predicted))
    bending: Literal["links", "base"] = "base" if model.name == "joints_and_base" else "links"
    encoders = np.concatenate(predicted_turns) if predicted_turns else None
    return elements, replace(prediction, bending=bending, encoders=encoders)


_LIGHTER: Final = 0.12
"""Penalty for stiffnesses and their intervals relative to the penalty that predicts best. With the latter,
bias is as large as dispersion; with a lighter penalty dispersion outweighs bias (undersmoothing)."""
_NOTHING: Final = 1e-4
"""Lower end of an interval, relative to its upper end, below which the lower end counts as zero: cone
programs do not reach zero exactly."""
_GAP: Final = 1e-4
"""Duality gap of the optimum around which intervals are computed, relative to the readings."""


def build_effective_rows(robot: Robot, columns: ElasticColumns) -> FloatArray:
    """Return the matrix (n, P) that maps all compliances (P,) to the joints' effective compliances (n,).

    An effective compliance [rad/(N·m)] is the joint's compliance plus the compliance of its link about (for a
    prismatic joint: along) the joint's axis; for joint 1 also that of the base. Link and base move every
    target like the joint, so that readings cannot separate the three.
    """
    rows = np.zeros((columns.n, columns.width))
    rows[np.arange(columns.n), columns.joints] = 1.0
    rows[np.arange(columns.n), columns.coupling[find_diagonal_entries(columns.n)]] = 1.0
    i, j = triangle_indices(6)
    rotations = spring_frames(Postures(robot, np.zeros((1, columns.n))))[0][0]
    # For each link or base: the joint that moves targets alike, and the joint's axis in the frame of the
    # element.
    joint_axes = {frame: (frame, robot.axes[frame]) for frame in columns.links}
    joint_axes[BASE] = (0, rotations[0] @ robot.axes[0])
    for frame, (joint, joint_axis) in joint_axes.items():
        # A small motion has three translations, then three rotations.
        translation, rotation = (
            (joint_axis, np.zeros(3)) if robot.prismatic[joint] else (np.zeros(3), joint_axis)
        )
        axis = np.concatenate([translation, rotation])
        rows[joint, columns.link_columns(frame)] = axis[i] * axis[j] * triangle_weights(6)
    return rows


@dataclass(frozen=True, eq=False)
class EffectiveCompliances:
    """Effective compliances of the n joints with their ranges; NaN where a number is not known."""

    #: (n,) compliance of each joint plus that of its link about, or along, the joint's axis [rad/(N·m)]
    compliance: FloatArray
    range: FloatArray  #: (n, 2) least and greatest values [rad/(N·m)]
    quantile: float  #: half-width of a range divided by the standard uncertainty
    #: False if the ranges must not be published as intervals, because the penalty was given
    ranges_are_published: bool = True

    @property
    def ends(self) -> FloatArray:
        """Ends (n, 2) of the published intervals [rad/(N·m)]; NaN if no intervals are published."""
        return self.range if self.ranges_are_published else np.full_like(self.range, np.nan)

    @property
    def uncertainty(self) -> FloatArray:
        """Standard uncertainties (n,) [rad/(N·m)]: half of a range divided by the quantile."""
        return 0.5 * (self.range[:, 1] - self.range[:, 0]) / self.quantile

    def widen_ranges_by(self, other: EffectiveCompliances) -> EffectiveCompliances:
        """Return these compliances with ranges widened to contain the ranges of another model.

        Each range still contains the compliance of this model.
        """
        lower = np.fmin(self.range[:, 0], other.range[:, 0])
        upper = np.fmax(self.range[:, 1], other.range[:, 1])
        # A range that comes only from the other model need not contain this model's value: widen the range.
        value = np.where(np.isnan(lower), np.nan, self.compliance)
        lower, upper = np.fmin(lower, value), np.fmax(upper, value)
        return replace(
            self, range=np.column_stack([lower, upper]), quantile=min(self.quantile, other.quantile)
        )


def compute_effective_compliances(
    robot: Robot,
    elastic: ElasticEstimate,
    confidence: float,
    range_estimate: ElasticEstimate | None = None,
    *,
    publishes_ranges: bool = True,
) -> EffectiveCompliances:
    """Compute the joints' effective compliances and their confidence ranges.

    A range contains the values of an effective compliance at which the objective, with a lighter penalty, is
    close to its minimum. The compliance itself is that at the minimum: from one draw of the noise to the
    next, compliances at the chosen penalty differ more, as the choice of the penalty does. For the model of
    joints and base, a range also contains the range of ordinary least squares, which has no bias from penalty
    or constraints.

    Args:
        robot: n joints.
        elastic: estimate of the chosen model; its effective compliances are returned if no range is known.
        confidence: confidence level of the ranges.
        range_estimate: estimate of the richest model compared, from which the ranges are computed; None takes
            `elastic`.
        publishes_ranges: whether the ranges may be published as intervals: only if cross-validation chose the
            penalty.
    """
    range_estimate = range_estimate or elastic
    companion = range_estimate.companion
    rows = build_effective_rows(robot, elastic.model.columns)
    effective, ranges = rows @ elastic.entries, np.full((robot.n, 2), np.nan)
    quantile = student_quantile(0.5 * (1.0 + confidence), companion.degrees_of_freedom)
    if companion.sigma is not None:
        formulation = companion.formulation
        program = formulation.build_squared_program(_LIGHTER * companion.weight)
        with suppress(SolverError):  # Without a certified optimum the ranges stay unknown (NaN).
            optimum = solve_cone(program, wanted_gap=_GAP).x
            # Root of the allowed increase of the objective, and the effective compliances as functions of x
            radius = quantile * companion.sigma / formulation.size
            functions = rows[:, formulation.columns] * formulation.unit
            effective = functions @ optimum if publishes_ranges else effective
            ranges = compute_penalised_range(program, optimum, radius**2, functions)
            if range_estimate.model.name == "joints_and_base":
                least, greatest = compute_unconstrained_range(formulation.squares, functions, radius).T
                ranges = np.column_stack([np.fmin(ranges[:, 0], least), np.fmax(ranges[:, 1], greatest)])
    # The programs find the ends to a tolerance only: a range must contain the estimate.
    ranges[:, 0] = np.minimum(np.maximum(ranges[:, 0], 0.0), effective)
    ranges[:, 1] = np.maximum(ranges[:, 1], effective)
    # An error of all loads' size changes all compliances in proportion, and no reading shows it.
    scale_error = quantile * range_estimate.force_scale * effective
    ranges[:, 0] = np.maximum(effective - np.hypot(effective - ranges[:, 0], scale_error), 0.0)
    ranges[:, 1] = effective + np.hypot(ranges[:, 1] - effective, scale_error)
    ranges[ranges[:, 0] < _NOTHING * ranges[:, 1], 0] = 0.0
    return EffectiveCompliances(
        compliance=np.where(np.isnan(elastic.compliance), np.nan, effective),
        range=ranges,
        quantile=quantile,
        ranges_are_published=publishes_ranges,
    )


LARGEST_UNCERTAINTY: Final = 0.5
"""Relative standard uncertainty of an effective compliance above which it is poorly known."""

RIGID: Final = 1e-12
"""Compliance [rad/(N·m)] below which a joint counts as rigid: cone programs do not reach zero exactly."""


def replace_by_effective(
    estimate: Estimate, elastic: ElasticEstimate, effective: EffectiveCompliances
) -> Estimate:
    """Return the joints' estimate with joint compliances replaced by effective compliances.

    Sigma, chi square, degrees of freedom and certificate are those of the estimate with bending links or
    base.

    Args:
        estimate: estimate of joints alone.
        elastic: estimate with bending links or base.
        effective: effective compliances of the same joints.
    """
    # Words for the link or base that bends about the axis of a joint; keys are names of joints.
    bending_words = {link.joint: "its link" for link in elastic.links}
    if elastic.base is not None:
        first = estimate.joints[0].name
        # The text is followed by "'s": "its link's and the base's rotation about …".
        bending_words[first] = (
            f"{bending_words[first]}'s and the base" if first in bending_words else "the base"
        )
    certificate = elastic.certificate
    evidence = Certificate(
        primal=max(0.0, -certificate.least_eigenvalue),
        dual=certificate.dual,
        gap=certificate.gap,
        multipliers=np.zeros(0),
        solved_by="clarabel",
        witness=elastic.witness,
    )
    return replace(
        estimate,
        joints=tuple(
            _build_effective_joint(joint, effective, j, bending_words.get(joint.name))
            for j, joint in enumerate(estimate.joints)
        ),
        compliance=np.nan_to_num(effective.compliance),
        covariance=None,
        sigma=elastic.sigma,
        chi_square=elastic.chi_square,
        degrees_of_freedom=elastic.degrees_of_freedom,
        complementary_stiffness=None,
        certificates=(evidence,),
    )


def _build_effective_joint(
    joint: JointCompliance, effective: EffectiveCompliances, index: int, bending_words: str | None
) -> JointCompliance:
    """Return the result of a joint with its effective compliance, and remarks on links or base that bend.

    A joint that is not observable is returned unchanged.

    Args:
        joint: result of the joint alone.
        effective: effective compliances of all joints.
        index: index of the joint.
        bending_words: name of the link or base that bends about the joint's axis; None if both are rigid.
    """
    compliance = float(effective.compliance[index])
    uncertainty = float(effective.uncertainty[index])
    if joint.status == "not_observable" or np.isnan(compliance):
        return joint
    lower, upper = effective.ends[index].tolist()
    is_rigid = compliance < RIGID
    motion = JOINT_UNITS[joint.kind].of_link
    remark_on_sum = (
        f"effective compliance of the joint together with {bending_words}'s {motion} its axis, because "
        "readings do not distinguish the two"
    )
    remarks = [] if bending_words is None else [remark_on_sum]
    if is_rigid:
        remarks = [
            "the other elastic elements (joints, links or base) explain the readings without a compliance of "
            "this joint"
        ]
    elif not np.isfinite(uncertainty):
        remarks.append("no interval: the range of compliances that fit the readings was not found")
    elif uncertainty > LARGEST_UNCERTAINTY * compliance:
        remarks.append(
            f"poorly determined (standard uncertainty {100 * uncertainty / compliance:.0f} %): "
            "bending links explain the readings nearly as well as this joint"
        )
    return JointCompliance(
        name=joint.name,
        kind=joint.kind,
        status="at_bound" if is_rigid else "identified" if uncertainty < compliance else "uncertain",
        compliance=0.0 if is_rigid else compliance,
        standard_uncertainty=uncertainty if np.isfinite(uncertainty) else None,
        compliance_interval=(lower, upper) if np.isfinite([lower, upper]).all() else None,
        reason="; ".join(remarks) or None,
    )
