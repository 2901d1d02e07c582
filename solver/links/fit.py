"""Fit of a model of elastic links with a penalty whose weight is known, and what it says (method.md §7).

A rotation of joint j and a rotation of its link about the same axis move every target alike, so that readings
determine at most their sum ``c_j + a_jᵀ C_j,rot a_j``, with a_j the axis in the joint's frame: the effective
compliance. Its interval is the range over all compliances of the cone whose penalised squares exceed the
least by no more than ``(q σ)²``, q the quantile: a profile, as for joints alone.
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
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.estimation.cones import find_diagonal_entries, lift_diagonal, to_matrix
from jointstiff.solver.estimation.conic import (
    compute_effective_freedom,
    compute_penalised_range,
    compute_unconstrained_range,
    solve_cone,
)
from jointstiff.solver.estimation.estimate import Estimate, JointCompliance, Prediction
from jointstiff.solver.estimation.fit import student_quantile
from jointstiff.solver.estimation.method import Settings
from jointstiff.solver.estimation.solution import Certificate
from jointstiff.solver.links.choice import Folds
from jointstiff.solver.links.model import (
    ElasticColumns,
    ElasticModel,
    Formulation,
    elastic_blocks,
)
from jointstiff.solver.mechanics.block import spring_frames
from jointstiff.solver.mechanics.measurements import Measurements
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
    degrees_of_freedom: float | None  #: of sigma from residuals; None if sigma was stated


@dataclass(frozen=True, eq=False)
class ElasticEstimate:
    """Joint and link compliances with their evidence."""

    model: ElasticModel  #: what bends
    penalty: float  #: weight λ of the penalty
    compliance: FloatArray  #: (n,) joint compliances [rad/(N·m)]; NaN if the readings do not determine one
    #: (n, n) full joint compliance [rad/(N·m)], zero in rows of undetermined joints; None if joints are
    #: not coupled
    coupled_joints: FloatArray | None
    entries: FloatArray  #: (P,) all compliances; deflections are rows @ entries
    links: tuple[ElasticCompliance, ...]  #: links that bend
    base: ElasticCompliance | None  #: compliance of the base; None where it is taken to be rigid
    elements: tuple[ElementShare, ...]  #: share of the deflections that each element explains
    prediction: Prediction  #: prediction of all deflections
    sigma: float | None  #: stated sigma, or from the residuals [m]; None without degrees of freedom
    chi_square: float  #: chi square of the weighted residuals, under sigma
    degrees_of_freedom: float  #: readings less effective freedom
    effective_freedom: float  #: effective freedom of the whole model: how many numbers the readings determine
    parameters: int  #: how many numbers the model has
    certificate: LinkCertificate  #: certificate of optimality
    companion: Companion  #: problem with which uncertainties are computed

    @property
    def unexplained(self) -> float:
        """Share of the measured deflection that no element explains."""
        return 1.0 - sum(element.share for element in self.elements)


def find_principal_compliances(block: FloatArray) -> list[PrincipalCompliance]:
    """Return the principal compliances and directions of a compliance block (3, 3), largest first."""
    values, vectors = np.linalg.eigh(block)
    pairs = zip(np.maximum(values[::-1], 0.0).tolist(), fix_axis_signs(vectors.T[::-1]), strict=True)
    return [PrincipalCompliance(value=value, direction=point(direction)) for value, direction in pairs]


CERTIFIED_GAP: Final = 1e-2
"""Largest gap of an accepted certificate, in units of sigma."""
_DESIRED_GAP: Final = 1e-3
"""Gap aimed at where rounding allows it: the ranks of the matrices are then certain."""
_SOLVED_GAP: Final = 0.8 * CERTIFIED_GAP
"""Largest gap of the solution: making its matrices positive semidefinite may increase the gap a little."""
_LEAST_SCALE: Final = 1e-6
"""Smallest residual scale relative to the readings: data without noise need a scale, too."""
_LEAST_FREEDOM: Final = 0.5
"""Degrees of freedom below which the residuals do not determine sigma."""


def refuse_unsupported_elastic(measurements: Measurements, settings: Settings) -> None:
    """Refuse options and readings that a model with bending links or base does not support.

    The complementary stiffness is not refused but neglected where links bend: at 1 kN it changes a deflection
    by 0.05 % only.

    Raises:
        UnsupportedMethodError: an option is not supported; the error names the option and a remedy.
    """
    positive = bool((settings.bounds.lower == 0.0).all() and np.isinf(settings.bounds.upper).all())
    refused = (
        (settings.method != "partial_pose", "method", "use method partial_pose"),
        (settings.weighting != "covariance", "weighting", "use weighting covariance"),
        (not positive, "stiffness_bounds", "omit `stiffness_bounds`, and leave `positive` true"),
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


def estimate_elastic(folds: Folds, model: ElasticModel, weight: float) -> ElasticEstimate:
    """Fit an elastic model to the whole set for a given penalty, and certify the optimum.

    Args:
        folds: measurement set with its compressed rows.
        model: what bends besides the joints; a model of joints alone is not supported.
        weight: λ > 0 of the penalty.

    Raises:
        UnsupportedMethodError: the penalty has no scale, or is too small for the optimum to be certified.
    """
    robot, measurements, formulation = folds.robot, folds.measurements, folds.formulation(model)
    scale = _scale_gaps(formulation, measurements.sigma)
    unit = scale / formulation.unit_of_gaps(model)
    try:  # the desired gap if rounding allows, else any gap that is still accepted
        gap, accepted = _DESIRED_GAP * unit, _SOLVED_GAP * unit
        solution, threshold = formulation.fit(model, weight, gap=gap, accepted=accepted)
    except SolverError as error:
        raise _uncertified_error(weight) from error
    columns = model.columns
    compliances, least = _semidefinite_compliances(formulation.compliances(solution.x), model)
    gap = formulation.certify_gap(model, compliances, weight, solution, threshold) / unit
    if not gap <= CERTIFIED_GAP:
        raise _uncertified_error(weight)
    squares, weight_of_squares = formulation.companion(model, compliances, weight, threshold)
    freedom, freedom_left, sigma, chi_square = _summarise_residuals(
        squares, weight_of_squares, compliances, measurements.sigma
    )
    elements, prediction = _shares_of_elements(robot, measurements, model, compliances)
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
                joint=robot.joint_names[frame], **_summarise_compliance(compliances, model, freedom, frame)
            )
            for frame in model.frames
            if frame != BASE
        ),
        base=ElasticCompliance(joint=None, **_summarise_compliance(compliances, model, freedom, BASE))
        if BASE in model.frames
        else None,
        elements=elements,
        prediction=prediction,
        sigma=sigma,
        chi_square=chi_square,
        degrees_of_freedom=freedom_left,
        effective_freedom=float(freedom.sum()),
        parameters=len(formulation.columns),
        certificate=LinkCertificate(
            least_eigenvalue=least, dual=solution.certificate.dual, gap=gap, scale=float(scale)
        ),
        companion=_build_companion(formulation, model, compliances, weight),
    )


def _build_companion(
    form: Formulation, model: ElasticModel, compliances: FloatArray, weight: float
) -> Companion:
    """Return the problem for a fit's uncertainties, with sigma lift_diagonal if the residuals exceed it."""
    weight, stated = form.weight_of_squares(model, compliances, weight), form.sigma
    _, freedom_left, sigma, chi_square = _summarise_residuals(form, weight, compliances, stated)
    if stated is None or sigma is None:
        return Companion(form, weight, sigma, freedom_left)
    excess = sqrt(chi_square / freedom_left) if freedom_left >= _LEAST_FREEDOM else 1.0
    return Companion(form, weight, sigma * max(1.0, excess), None)


def fit_first_certified(folds: Folds, model: ElasticModel, weights: Sequence[float]) -> ElasticEstimate:
    """Fit a model with the smallest penalty in `weights`, in ascending order, that has a certified optimum.

    Raises:
        UnsupportedMethodError: no optimum is certified; the error is that of the last penalty.
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
    """Compute the degrees of freedom, sigma and chi-square of a fit.

    Returns:
        The effective freedom (P,) of each column; the remaining degrees of freedom; sigma [m], computed from
        the residuals if None is given; and the chi-square of the residuals under sigma, 0 without sigma.
    """
    x, rows = compliances[squares.columns] / squares.unit, squares.rows
    freedom = np.zeros(squares.width)
    freedom[squares.columns] = compute_effective_freedom(squares.program(weight), x)
    left = max(0.0, rows.readings - float(freedom.sum()))
    total = float(np.square(rows.triangle[:, :-1] @ compliances - rows.triangle[:, -1]).sum())
    if sigma is None and left >= _LEAST_FREEDOM:
        sigma = sqrt(total / left)
    return freedom, left, sigma, total / sigma**2 if sigma else 0.0


def _scale_gaps(formulation: Formulation, sigma: float | None) -> float:
    """Return the length [m] that is the unit of certificates' gaps: sigma, or the residuals if greater.

    An unknown sigma is replaced by the residual scale of a fit of joints alone. Residuals that remain without
    penalty and constraints count as noise, too: a more exact optimum would have no use.
    """
    fit, rows, joints = formulation.squares, formulation.rows, formulation.cone.free
    R = fit.R[:, :joints]
    alone = float(np.linalg.norm(R @ np.linalg.lstsq(R, fit.z, rcond=None)[0] - fit.z))
    least = float(np.linalg.norm(fit.R @ fit.near - fit.z))
    stated = sigma or max(alone, _LEAST_SCALE) * formulation.size / sqrt(max(1, rows.readings - joints))
    return max(stated, least * formulation.size / sqrt(max(1, rows.readings)))


def _uncertified_error(weight: float) -> UnsupportedMethodError:
    """Return the error for a penalty λ with which no optimum can be certified."""
    return UnsupportedMethodError(
        f"with a penalty of {weight:.3g}, rounding errors hide which links bend, and no fit can be certified",
        where="link_penalty",
        remedy=f"give link_penalty {10.0 * weight:.0e} or more, choose fewer links, or omit link_penalty",
    )


def _semidefinite_compliances(compliances: FloatArray, model: ElasticModel) -> tuple[FloatArray, float]:
    """Return compliances (P,) with matrices made positive semidefinite, and the least eigenvalue of all.

    The eigenvalues are those computed in SI units: rounding of a scaled optimum may leave some below zero.
    """
    out, columns = compliances.copy(), model.columns
    places = [(6, columns.link(frame)) for frame in columns.frames] + [(columns.n, columns.coupling)]
    least = [float(out[columns.joints].min())]
    for size, own in places:
        if out[own].any():
            out[own] = lift_diagonal(out[own], size)
            least.append(float(np.linalg.eigvalsh(to_matrix(out[own], size)).min()))
    return out, min(least)


def _summarise_compliance(
    compliances: FloatArray, model: ElasticModel, freedom: FloatArray, frame: int
) -> dict[str, Any]:
    """Return the fields of the `ElasticCompliance` of a bending link or base, without the field `joint`."""
    own = model.columns.link(frame)
    matrix = to_matrix(compliances[own], 6)
    return {
        "matrix": matrix.tolist(),
        "translation": find_principal_compliances(matrix[:3, :3]),
        "rotation": find_principal_compliances(matrix[3:, 3:]),
        "effective_freedom": float(freedom[own].sum()),
        "parameters": 6 if model.name == "diagonal_links" else len(own),
    }


def _shares_of_elements(
    robot: Robot, measurements: Measurements, model: ElasticModel, compliances: FloatArray
) -> tuple[tuple[ElementShare, ...], Prediction]:
    """Return the share of measured deflections explained by each element, and the prediction of all."""
    columns = model.columns
    coupled = columns.coupling[find_diagonal_entries(columns.n)]
    places: list[tuple[Literal["joint", "coupling", "link", "base"], str | None, IndexArray]] = [
        ("joint", robot.joint_names[joint], np.array([columns.joints[joint], coupled[joint]]))
        for joint in range(columns.n)
    ]
    if model.name == "coupled_joints":
        places.append(("coupling", None, np.setdiff1d(columns.coupling, coupled)))
    for frame in model.frames:
        kind: Literal["link", "base"] = "base" if frame == BASE else "link"
        places.append((kind, None if frame == BASE else robot.joint_names[frame], columns.link(frame)))
    predicted, along = [], []
    for block, rows in elastic_blocks(robot, measurements, model.columns):
        # Missing readings add nothing: their rows and deflections are zero.
        work = np.einsum("btip,bti->bp", rows[..., :-1], block.measurements.deflection) * compliances
        along.append(np.stack([work[:, own].sum(axis=1) for _, _, own in places]))
        predicted.append(rows[..., :-1] @ compliances)
    measured = np.square(measurements.deflection).sum(axis=(1, 2))
    explained = np.concatenate(along, axis=1)
    share = np.divide(explained, measured, out=np.zeros_like(explained), where=measured > 0.0)
    elements = tuple(
        ElementShare(
            kind=kind,
            joint=joint,
            share=float(explained[number].sum() / measured.sum()),
            by_observation=share[number].tolist(),
        )
        for number, (kind, joint, _) in enumerate(places)
    )
    prediction = Prediction.from_predicted(measurements, np.concatenate(predicted))
    bending: Literal["links", "base"] = "base" if model.name == "joints_and_base" else "links"
    return elements, replace(prediction, bending=bending)


_LIGHTER: Final = 0.3
"""Penalty for intervals relative to the penalty that predicts best. With the latter, bias is as large as
dispersion; with a lighter penalty dispersion outweighs bias (undersmoothing)."""
_NOTHING: Final = 1e-4
"""Least lower end relative to the upper end: a smaller one counts as zero, which cone programs miss."""
_GAP: Final = 1e-4
"""Gap of the optimum around which intervals are computed, relative to the readings."""


def build_effective_rows(robot: Robot, columns: ElasticColumns) -> FloatArray:
    """Return the matrix (n, P) that takes all compliances (P,) to the joints' effective compliances.

    An effective compliance [rad/(N·m)] is the joint's compliance plus the link's about or along the same
    axis, and for joint 1 also the base's: they move every target like the joint, so that readings cannot
    separate them.
    """
    rows = np.zeros((columns.n, columns.width))
    rows[np.arange(columns.n), columns.joints] = 1.0
    rows[np.arange(columns.n), columns.coupling[find_diagonal_entries(columns.n)]] = 1.0
    i, j = triangle_indices(6)
    placed = spring_frames(Postures(robot, np.zeros((1, columns.n))))[0][0]
    moved = {frame: (frame, robot.axes[frame]) for frame in columns.links}
    for frame, (joint, own) in (moved | {BASE: (0, placed[0] @ robot.axes[0])}).items():
        along_or_about = (own, np.zeros(3))
        axis = np.concatenate(along_or_about if robot.prismatic[joint] else along_or_about[::-1])
        rows[joint, columns.link(frame)] = axis[i] * axis[j] * triangle_weights(6)
    return rows


@dataclass(frozen=True, eq=False)
class EffectiveCompliances:
    """Effective compliances of the n joints with their ranges; NaN where a number is not known."""

    #: (n,) compliances of the joints plus their links' about, or along, the joints' axes [rad/(N·m)]
    compliance: FloatArray
    range: FloatArray  #: (n, 2) least and greatest values [rad/(N·m)]
    quantile: float  #: half-width of a range divided by the standard uncertainty
    quoted: bool = True  #: whether the ranges are quoted as intervals: not if the penalty was given

    @property
    def ends(self) -> FloatArray:
        """Ends (n, 2) of the quoted intervals [rad/(N·m)]; NaN if no intervals are quoted."""
        return self.range if self.quoted else np.full_like(self.range, np.nan)

    @property
    def uncertainty(self) -> FloatArray:
        """Standard uncertainties (n,) [rad/(N·m)]: half of a range divided by the quantile."""
        return 0.5 * (self.range[:, 1] - self.range[:, 0]) / self.quantile

    def joined(self, other: EffectiveCompliances) -> EffectiveCompliances:
        """Return these compliances with ranges widened to contain the ranges of another model."""
        low = np.fmin(self.range[:, 0], other.range[:, 0])
        high = np.fmax(self.range[:, 1], other.range[:, 1])
        # A range that comes only from the other model need not contain this model's value: widen the range.
        own = np.where(np.isnan(low), np.nan, self.compliance)
        low, high = np.fmin(low, own), np.fmax(high, own)
        return replace(self, range=np.column_stack([low, high]), quantile=min(self.quantile, other.quantile))


def compute_effective_compliances(
    robot: Robot,
    elastic: ElasticEstimate,
    confidence: float,
    widest: ElasticEstimate | None = None,
    *,
    with_ends: bool = True,
) -> EffectiveCompliances:
    """Compute the joints' effective compliances and their confidence ranges.

    A range contains the values at which the objective, with a lighter penalty, is close to its minimum. With
    joints and base alone, it also contains the range of ordinary least squares, which has no bias from
    penalty or constraints.

    Args:
        robot: n joints.
        elastic: estimate whose effective compliances are returned; the ranges contain them in any case.
        confidence: confidence level of the ranges.
        widest: estimate of the richest model compared, from which the ranges are computed; None takes
            `elastic`.
        with_ends: whether to quote the ranges as intervals: only if cross-validation chose the penalty.
    """
    widest = widest or elastic
    companion = widest.companion
    rows = build_effective_rows(robot, elastic.model.columns)
    effective, ends = rows @ elastic.entries, np.full((robot.n, 2), np.nan)
    quantile = student_quantile(0.5 * (1.0 + confidence), companion.degrees_of_freedom)
    if companion.sigma is not None:
        form = companion.formulation
        program = form.program(_LIGHTER * companion.weight)
        with suppress(SolverError):
            x = solve_cone(program, gap=_GAP).x
            size, functions = quantile * companion.sigma / form.size, rows[:, form.columns] * form.unit
            ends = compute_penalised_range(program, x, size**2, functions)
            if widest.model.name == "joints_and_base":
                least, greatest = compute_unconstrained_range(form.squares, functions, size).T
                ends = np.column_stack([np.fmin(ends[:, 0], least), np.fmax(ends[:, 1], greatest)])
    ends[:, 0] = np.minimum(np.maximum(ends[:, 0], 0.0), effective)
    ends[:, 1] = np.maximum(ends[:, 1], effective)
    ends[ends[:, 0] < _NOTHING * ends[:, 1], 0] = 0.0
    return EffectiveCompliances(
        compliance=np.where(np.isnan(elastic.compliance), np.nan, effective),
        range=ends,
        quantile=quantile,
        quoted=with_ends,
    )


LARGEST_UNCERTAINTY: Final = 0.5
"""Relative standard uncertainty of an effective compliance above which it is poorly known."""

RIGID: Final = 1e-12
"""Compliance [rad/(N·m)] below which a joint counts as rigid: cone programs do not reach zero exactly."""


def replace_by_effective(
    estimate: Estimate, elastic: ElasticEstimate, effective: EffectiveCompliances
) -> Estimate:
    """Return the joints' estimate with joint compliances replaced by effective compliances.

    Args:
        estimate: estimate of joints alone.
        elastic: estimate with bending links or base.
        effective: effective compliances of the same joints.
    """
    others = {link.joint: "its link" for link in elastic.links}
    if elastic.base is not None:
        first = estimate.joints[0].name
        # The text is followed by "'s": "its link's and the base's rotation about …".
        others[first] = f"{others[first]}'s and the base" if first in others else "the base"
    certificate = elastic.certificate
    evidence = Certificate(
        primal=max(0.0, -certificate.least_eigenvalue),
        dual=certificate.dual,
        gap=certificate.gap,
        multipliers=np.zeros(0),
        solved_by="clarabel",
    )
    return replace(
        estimate,
        joints=tuple(
            _effective_joint(joint, effective, j, others.get(joint.name))
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


def _effective_joint(
    joint: JointCompliance, effective: EffectiveCompliances, j: int, other: str | None
) -> JointCompliance:
    """Return the result of joint j with its effective compliance and remarks on what else bends there.

    `other` names the link or base that bends about the same axis. A joint that is not observable is returned
    unchanged.
    """
    compliance, uncertainty = float(effective.compliance[j]), float(effective.uncertainty[j])
    if joint.status == "not_observable" or np.isnan(compliance):
        return joint
    low, high = effective.ends[j].tolist()
    rigid = compliance < RIGID
    motion = JOINT_UNITS[joint.kind].of_link
    together = (
        f"effective compliance: the joint together with {other}'s {motion} its axis, which readings "
        "do not distinguish"
    )
    remarks = [] if other is None else [together]
    if rigid:
        remarks = ["the other elements explain the readings without a compliance of this joint"]
    elif not np.isfinite(uncertainty):
        remarks.append("no interval: the range of compliances that fit the readings was not found")
    elif uncertainty > LARGEST_UNCERTAINTY * compliance:
        remarks.append(
            f"poorly determined (standard uncertainty {100 * uncertainty / compliance:.0f} %): "
            "bending links explain the readings nearly as well"
        )
    return JointCompliance(
        name=joint.name,
        kind=joint.kind,
        status="at_bound" if rigid else "identified" if uncertainty < compliance else "uncertain",
        compliance=0.0 if rigid else compliance,
        standard_uncertainty=uncertainty if np.isfinite(uncertainty) else None,
        compliance_interval=(low, high) if np.isfinite([low, high]).all() else None,
        reason="; ".join(remarks) or None,
    )
