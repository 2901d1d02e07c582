"""Fit of a model of elastic links for a known weight of the penalty, and its results (method.md §7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from jointstiff.schemas.model import (
    ElasticCompliance,
    ElementShare,
    LinkCertificate,
    PrincipalCompliance,
)
from jointstiff.schemas.options import Loss
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, fix_axis_signs
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.fit.cone import find_diagonal_entries, lift_diagonal, to_matrix
from jointstiff.solver.fit.conic import compute_effective_freedom
from jointstiff.solver.fit.estimate import Prediction
from jointstiff.solver.fit.method import DEFAULT_THRESHOLD, Settings
from jointstiff.solver.fit.part import Part, generate_elastic_rows
from jointstiff.solver.fit.problem import Certificate, Witness
from jointstiff.solver.fit.reduced import (
    Candidate,
    Fitted,
    Reduced,
    compute_gap_unit,
    convert_weight_to_squares,
    fit_loss,
    reduce_part,
)
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stages import Scale
from jointstiff.solver.fit.statements import LEAST_STATED_SIGMA, Statements
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import BASE
from jointstiff.solver.messages import point
from jointstiff.solver.models import Columns, ElasticModel


@dataclass(frozen=True, eq=False)
class PenalisedLikelihood:
    """Likelihood of the compliances with a penalty, by squares, from which uncertainties are computed.

    With the weights of a robust loss, residuals near zero would count too much, and uncertainties would be
    too small.
    """

    reduced: Reduced  #: rows of the whole set
    weight: float  #: weight λ of the penalty
    #: sigma of one coordinate of one reading: as stated, or that of the residuals if that is greater
    scale: Scale


@dataclass(frozen=True, eq=False)
class Penalised:
    """Options of a fit whose cone has matrices, with a penalty on their traces."""

    columns: Columns  #: columns of the richest model; its links are those that bend
    visible: BoolArray  #: (n,) mask of the joints that the readings determine
    weight: float  #: λ > 0 of the penalty
    part: Part  #: rows of all observations, compressed, with what is stated
    loss: Loss = "squared"  #: loss of the norm of each target's whitened residual
    threshold: float = DEFAULT_THRESHOLD  #: threshold of Huber's loss, in units of sigma


@dataclass(frozen=True, eq=False)
class ElasticFit:
    """Compliances of joints, links and base from one fit, with residuals, uncertainties and certificate."""

    candidate: Candidate  #: elastic elements that bend, and the loss
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
    #: sigma and the chi-square of the weighted residuals; the degrees of freedom are the number of
    #: coordinates read minus the effective freedom
    scale: Scale
    effective_freedom: float  #: effective number of parameters that the readings determine
    parameters: int  #: number of parameters of the model
    certificate: LinkCertificate  #: certificate of optimality
    likelihood: PenalisedLikelihood  #: least-squares problem from which the uncertainties are computed
    witness: Witness | None  #: comparison of Clarabel's own answer with the certified one
    force_scale: float  #: relative standard uncertainty of the size of all loads

    @property
    def model(self) -> ElasticModel:
        """Elastic elements that bend."""
        return self.candidate.model

    @property
    def certificates(self) -> tuple[Certificate, ...]:
        """Certificate in the form of that of joints alone: violations of the cone, and the gap."""
        certificate = Certificate(
            primal=max(0.0, -self.certificate.least_eigenvalue),
            dual=self.certificate.dual,
            gap=self.certificate.gap,
            multipliers=np.zeros(0),
            solved_by="clarabel",
            witness=self.witness,
        )
        return (certificate,)

    @property
    def statements(self) -> Statements:
        """Stated errors that were fitted together with the compliances."""
        return self.likelihood.reduced.part.statements

    @property
    def unexplained(self) -> float:
        """Fraction of the measured deflection that no elastic element explains."""
        return 1.0 - sum(element.share for element in self.elements)


def find_principal_compliances(block: FloatArray) -> list[PrincipalCompliance]:
    """Return eigenvalues and eigenvectors of a compliance block (3, 3), the largest compliance first."""
    eigenvalues, eigenvectors = np.linalg.eigh(block)  # ascending; eigenvectors are columns
    values = np.maximum(eigenvalues[::-1], 0.0)  # rounding may make a zero negative
    directions = fix_axis_signs(eigenvectors.T[::-1])
    return [
        PrincipalCompliance(value=value, direction=point(direction))
        for value, direction in zip(values.tolist(), directions, strict=True)
    ]


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
    bounds = settings.bounds
    only_positive = bool((bounds.lower == 0.0).all() and np.isinf(bounds.upper).all())
    if settings.method != "partial_pose":
        field, remedy = "method", "use method partial_pose"
    elif settings.weighting != "covariance":
        field, remedy = "weighting", "use weighting covariance"
    elif not only_positive:
        field, remedy = "stiffness_bounds", "omit `stiffness_bounds`, and leave `positive` true"
    elif settings.order:
        field, remedy = "stiffness_order", "omit `stiffness_order`"
    else:
        return
    raise UnsupportedMethodError(
        f"the given {field.replace('_', ' ')} works only with the elasticity `joints`",
        where=field,
        remedy=f"{remedy}, or use elasticity joints",
    )


def fit_matrices(rows: Rows, model: ElasticModel, options: Penalised) -> ElasticFit:
    """Fit a model with compliance matrices to a whole set for a given penalty, and certify the optimum.

    Priors of compliances and errors are weighted by sigma, the standard uncertainty of a reading. If sigma is
    not stated, a first fit finds sigma from its residuals, and the fit is repeated with this sigma.

    Args:
        rows: N observations.
        model: elastic elements that bend; a model of joints alone is not supported.
        options: weight of the penalty, loss, and the same observations, compressed.

    Raises:
        UnsupportedMethodError: the penalty has no scale, or is too small for the optimum to be certified.
    """
    stated_sigma = rows.measurements.sigma
    part, visible = options.part, options.visible
    candidate = Candidate(model, options.columns, options.loss, options.threshold)
    reduced = reduce_part(part, candidate, visible, stated_sigma)
    first = _fit_and_summarise(rows, reduced, candidate, options.weight)
    has_priors = len(part.stated) > 0
    if not has_priors or stated_sigma is not None or not first.scale.sigma:
        return first
    sigma_of_residuals = max(first.scale.sigma, LEAST_STATED_SIGMA)
    reweighted = reduce_part(part.with_sigma(sigma_of_residuals), candidate, visible)
    return _fit_and_summarise(rows, reweighted, candidate, options.weight)


def _fit_and_summarise(rows: Rows, reduced: Reduced, candidate: Candidate, weight: float) -> ElasticFit:
    """Fit the compliances of joints, links and base to a whole set, certify the optimum, and summarise it.

    The compliance of a joint is NaN if the readings do not determine it.

    Args:
        rows: N observations.
        reduced: compressed rows of all these observations, for the parameters of the model.
        candidate: elastic elements that bend, and the loss.
        weight: λ > 0 of the penalty.

    Raises:
        UnsupportedMethodError: the penalty is too small for the optimum to be certified.
    """
    certified = _find_certified_optimum(reduced, candidate, weight)
    compliances, unknowns = certified.compliances, certified.unknowns
    residuals = _summarise_residuals(
        certified.squares, certified.weight_of_squares, compliances, reduced.sigma
    )
    elements, prediction = _compute_element_shares(rows, candidate, reduced.part.statements, unknowns)
    joint_matrix = _assemble_joint_matrix(compliances, candidate)
    is_determined = np.isin(candidate.columns.joints, reduced.columns)
    bending = _BendingFrames.of(compliances, candidate, residuals.effective_freedom, rows.robot)
    return ElasticFit(
        candidate=candidate,
        penalty=weight,
        compliance=np.where(is_determined, np.diagonal(joint_matrix), np.nan),
        coupled_joints=joint_matrix if candidate.model.couples_joints else None,
        entries=compliances,
        links=bending.links,
        base=bending.base,
        elements=elements,
        prediction=prediction,
        scale=residuals.scale,
        effective_freedom=float(residuals.effective_freedom.sum()),
        parameters=len(reduced.columns),
        certificate=certified.certificate,
        likelihood=_build_likelihood(reduced, candidate, unknowns, weight),
        witness=certified.witness,
        force_scale=rows.measurements.common_uncertainty.scale,
    )


class _BendingFrames(NamedTuple):
    """Compliances of the links and the base that bend."""

    links: tuple[ElasticCompliance, ...]
    base: ElasticCompliance | None  #: None if the base is rigid

    @classmethod
    def of(
        cls, compliances: FloatArray, candidate: Candidate, freedom: FloatArray, robot: Robot
    ) -> _BendingFrames:
        """Summarise the compliances of the links and of the base.

        Args:
            compliances: (P,) fitted compliances.
            candidate: elastic elements that bend.
            freedom: (P,) effective degrees of freedom of each compliance.
            robot: n joints.
        """
        links, base = list[ElasticCompliance](), None
        for frame in candidate.frames:
            summary = _summarise_compliance(compliances, candidate, freedom, frame)
            if frame == BASE:
                base = ElasticCompliance(joint=None, **summary)
            else:
                links.append(ElasticCompliance(joint=robot.joint_names[frame], **summary))
        return cls(tuple(links), base)


def _assemble_joint_matrix(compliances: FloatArray, candidate: Candidate) -> FloatArray:
    """Return the compliance matrix (n, n) of the joints [rad/(N·m)] from all compliances (P,) of a model.

    A model has the compliance of a joint as a number of its own, or on the diagonal of the matrix that
    couples the joints; the other of the two is zero, so that the sum is right for either model.
    """
    columns = candidate.columns
    coupled_matrix = to_matrix(compliances[columns.coupling], columns.n)
    own_compliances = np.diag(compliances[columns.joints])
    return np.asarray(coupled_matrix + own_compliances)


class _CertifiedOptimum(NamedTuple):
    """Certified optimum with matrices that are positive semidefinite in SI units."""

    compliances: FloatArray  #: (P,)
    unknowns: FloatArray  #: (P + K,) compliances and stated errors
    certificate: LinkCertificate
    witness: Witness | None
    squares: Reduced  #: weighted least-squares problem with the same optimum
    weight_of_squares: float  #: weight of the penalty in this problem


def _find_certified_optimum(reduced: Reduced, candidate: Candidate, weight: float) -> _CertifiedOptimum:
    """Minimise the loss and the penalty, make compliance matrices semidefinite, and certify the result.

    The certificate is the duality gap: by how much the objective may exceed the optimum. Here it is expressed
    in units of sigma, the noise of a reading. The solver aims at the desired gap; a larger gap up to the
    accepted one is no error.

    Raises:
        UnsupportedMethodError: the penalty is too small for the optimum to be certified.
    """
    gap_scale = _compute_gap_scale(reduced)  # sigma, or the residuals if greater [m]
    gap_of_one_sigma = gap_scale / compute_gap_unit(reduced, candidate)
    loss, solution = _fit_to_gap(reduced, candidate, weight, gap_of_one_sigma)
    compliances, least_eigenvalue = _make_semidefinite(reduced.to_compliances(solution.x), candidate)
    gap = loss.certify_gap(compliances, weight, solution) / gap_of_one_sigma
    is_certified = gap <= CERTIFIED_GAP  # false for NaN
    if not is_certified:
        raise _build_uncertified_error(weight)
    stated_errors = reduced.to_unknowns(solution)[len(compliances) :]
    unknowns = np.concatenate([compliances, stated_errors])
    squares, weight_of_squares = loss.build_weighted_squares(candidate, unknowns, weight)
    certificate = LinkCertificate(
        least_eigenvalue=least_eigenvalue, dual=solution.certificate.dual, gap=gap, scale=float(gap_scale)
    )
    return _CertifiedOptimum(
        compliances=compliances,
        unknowns=unknowns,
        certificate=certificate,
        witness=solution.certificate.witness,
        squares=squares,
        weight_of_squares=weight_of_squares,
    )


def _fit_to_gap(reduced: Reduced, candidate: Candidate, weight: float, gap_of_one_sigma: float) -> Fitted:
    """Minimise the loss and the penalty to the desired gap; a gap up to the accepted one is no error.

    Args:
        reduced: compressed rows.
        candidate: elastic elements that bend, and the loss.
        weight: weight λ of the penalty.
        gap_of_one_sigma: duality gap at which the fit may be off by the noise of a reading.

    Raises:
        UnsupportedMethodError: the penalty is too small for the optimum to be certified.
    """
    try:
        return fit_loss(
            reduced,
            candidate,
            weight,
            gap=_DESIRED_GAP * gap_of_one_sigma,
            accepted=_SOLVED_GAP * gap_of_one_sigma,
        )
    except SolverError as error:
        raise _build_uncertified_error(weight) from error


def _build_likelihood(
    reduced: Reduced, candidate: Candidate, unknowns: FloatArray, weight: float
) -> PenalisedLikelihood:
    """Return the least-squares problem from which the uncertainties of a fit are computed.

    Also a fit with a robust loss has such a problem, with a penalty of equal strength. Its sigma, the noise
    of a reading, is the stated sigma, or that of the residuals if that is greater or no sigma is stated.

    Args:
        reduced: rows of the fit.
        candidate: elastic elements that bend, and the loss.
        unknowns: (P + K,) fitted compliances, then fitted systematic errors.
        weight: weight λ of the penalty in the fit.
    """
    weight_of_squares = convert_weight_to_squares(reduced, candidate, unknowns, weight)
    compliances = unknowns[: reduced.part.compliances]
    residuals = _summarise_residuals(reduced, weight_of_squares, compliances, reduced.sigma)
    scale = residuals.scale
    if reduced.sigma is None:
        return PenalisedLikelihood(reduced, weight_of_squares, scale)
    residuals_to_stated_sigma = 1.0  # ratio √(χ²/ν) of the residuals' sigma to the stated sigma
    if scale.degrees_of_freedom >= _LEAST_FREEDOM:
        residuals_to_stated_sigma = sqrt(scale.chi_square / scale.degrees_of_freedom)
    sigma = reduced.sigma * max(1.0, residuals_to_stated_sigma)
    return PenalisedLikelihood(reduced, weight_of_squares, replace(scale, sigma=sigma))


class _Residuals(NamedTuple):
    """Summary of the residuals of a fit."""

    #: (P,) effective freedom of each compliance: 1 if the readings determine the compliance, 0 if the penalty
    #: does
    effective_freedom: FloatArray
    scale: Scale  #: chi-square is 0 without sigma


def _summarise_residuals(
    squares: Reduced, weight: float, compliances: FloatArray, sigma: float | None
) -> _Residuals:
    """Compute the degrees of freedom, sigma and chi square of a penalised fit from its residuals.

    A penalty leaves each compliance an effective freedom between 0 and 1; the degrees of freedom are the
    number of readings less the sum of these.

    Args:
        squares: (weighted) least-squares problem of the fit.
        weight: weight λ of the penalty.
        compliances: (P,) fitted compliances.
        sigma: stated standard uncertainty of a coordinate [m]; None if unknown.
    """
    part = squares.part
    effective_freedom = np.zeros(part.compliances)
    effective_freedom[squares.columns] = compute_effective_freedom(
        squares.build_problem(weight), squares.to_parameters(compliances)
    )
    degrees_of_freedom = max(0.0, part.count - float(effective_freedom.sum()))
    S, s = part.regression
    residuals = S @ compliances - s
    sum_of_squares = float(np.square(residuals).sum())
    is_stated = sigma is not None
    if not is_stated and degrees_of_freedom >= _LEAST_FREEDOM:
        sigma = sqrt(sum_of_squares / degrees_of_freedom)
    chi_square = sum_of_squares / sigma**2 if sigma else 0.0
    return _Residuals(effective_freedom, Scale(sigma, is_stated, chi_square, degrees_of_freedom))


def _compute_gap_scale(reduced: Reduced) -> float:
    """Return the length [m] by which the duality gap of a fit is judged: the size of the noise.

    The length is the stated sigma, or the rms residual of an unconstrained fit without penalty, if that is
    greater: an optimum more exact than these residuals would have no use. If no sigma is stated, the rms
    residual of a fit of joints alone replaces sigma.
    """
    # Rows and residuals are relative to the norm of the readings, `reduced.reading_norm` [m].
    squares, reading_count = reduced.squares, reduced.part.sums.readings
    noise = reduced.sigma
    if noise is None:
        joint_count = reduced.cone.unpenalised  # the joints are the first parameters
        joint_columns = squares.R[:, :joint_count]
        compliances, *_ = np.linalg.lstsq(joint_columns, squares.z, rcond=None)
        residual = max(float(np.linalg.norm(joint_columns @ compliances - squares.z)), _LEAST_SCALE)
        noise = residual * reduced.reading_norm / sqrt(max(1, reading_count - joint_count))
    # `squares.origin` are the parameters of the unconstrained fit.
    least_residual = float(np.linalg.norm(squares.R @ squares.origin - squares.z))
    return max(noise, least_residual * reduced.reading_norm / sqrt(max(1, reading_count)))


def _build_uncertified_error(weight: float) -> UnsupportedMethodError:
    """Build the error for a weight λ of the penalty with which no optimum can be certified."""
    return UnsupportedMethodError(
        f"the fit with a penalty of {weight:.3g} cannot be certified as optimal, because rounding errors "
        "hide which links bend",
        where="link_penalty",
        remedy=f"give link_penalty {10.0 * weight:.0e} or more, choose fewer links, or omit link_penalty",
    )


def _make_semidefinite(compliances: FloatArray, candidate: Candidate) -> tuple[FloatArray, float]:
    """Make the matrices of fitted compliances positive semidefinite.

    Rounding of the scaled optimum may leave small negative eigenvalues in SI units; the diagonals are raised
    accordingly. Matrices of zeros, of rigid elements, stay as they are.

    Returns:
        The compliances (P,) with raised diagonals; and the least of all joint compliances and of the
        eigenvalues of all matrices that are not zero.
    """
    columns = candidate.columns
    raised = compliances.copy()
    # Number of rows of each symmetric matrix, and the columns of its upper triangle.
    matrices = [(6, columns.link_columns(frame)) for frame in columns.frames]
    matrices.append((columns.n, columns.coupling))
    least_values = [float(raised[columns.joints].min())]
    for size, upper_triangle in matrices:
        is_flexible = raised[upper_triangle].any()
        if is_flexible:
            raised[upper_triangle] = lift_diagonal(raised[upper_triangle], size)
            eigenvalues = np.linalg.eigvalsh(to_matrix(raised[upper_triangle], size))
            least_values.append(float(eigenvalues.min()))
    return raised, min(least_values)


def _summarise_compliance(
    compliances: FloatArray, candidate: Candidate, freedom: FloatArray, frame: int
) -> dict[str, Any]:
    """Return the fields of the message `ElasticCompliance` of a link or the base, but the field `joint`.

    Args:
        compliances: (P,) fitted compliances.
        candidate: elastic elements that bend.
        freedom: (P,) effective degrees of freedom of each compliance.
        frame: index of the link, or `BASE`.
    """
    link_columns = candidate.columns.link_columns(frame)
    matrix = to_matrix(compliances[link_columns], 6)
    translation, rotation = slice(0, 3), slice(3, 6)
    is_diagonal = candidate.model.links == "diagonal"
    return {
        "matrix": matrix.tolist(),
        "translation": find_principal_compliances(matrix[translation, translation]),
        "rotation": find_principal_compliances(matrix[rotation, rotation]),
        "effective_freedom": float(freedom[link_columns].sum()),
        "parameters": 6 if is_diagonal else len(link_columns),
    }


def _compute_element_shares(
    source: Rows,
    candidate: Candidate,
    statements: Statements,
    unknowns: FloatArray,
) -> tuple[tuple[ElementShare, ...], Prediction]:
    """Compute the share of the measured deflections that each elastic element explains.

    The deflections that an element causes are projected on the measured deflections: their scalar products,
    summed over the targets, are divided by the sum of the squared measured deflections.

    Args:
        source: N observations.
        candidate: elastic elements that bend.
        statements: systematic errors that were fitted together with the elements.
        unknowns: (P + K,) fitted compliances, then fitted systematic errors.

    Returns:
        The shares; and the prediction of all deflections by all elements and errors together.
    """
    elements = _list_elements(source.robot, candidate)
    motions = _ExplainedMotions.of(source, candidate, statements, unknowns, elements)
    measurements = source.measurements
    prediction = Prediction.from_predicted(measurements, motions.targets)
    only_base_bends = candidate.model.name == "joints_and_base"
    bending: Literal["links", "base"] = "base" if only_base_bends else "links"
    shares = motions.build_shares(elements, measurements)
    return shares, replace(prediction, bending=bending, encoders=motions.encoders)


class _ExplainedMotions(NamedTuple):
    """Motions of the targets that a fit explains, of all elements together and of each element."""

    targets: FloatArray  #: (N, T, 3) deflections by all elements and stated errors [m]
    encoders: FloatArray | None  #: (N, n) motion of the encoders [rad]; None without encoders
    #: (elements, N) scalar product of the deflections by an element with the measured deflections [m²]
    products: FloatArray

    @classmethod
    def of(
        cls,
        source: Rows,
        candidate: Candidate,
        statements: Statements,
        unknowns: FloatArray,
        elements: Sequence[_Element],
    ) -> _ExplainedMotions:
        """Compute the motions, some hundred observations at a time, with the arguments of the shares."""
        targets, encoders, products = [], [], []
        for rows in generate_elastic_rows(source, candidate.columns, statements):
            # Missing readings add nothing: their rows and deflections are zero.
            regressor = rows.targets[..., :-1]  # (B observations, T targets, 3 axes, P + K unknowns)
            deflection = rows.block.measurements.deflection  # (B, T, 3)
            # Scalar products (B, P + K) of the deflections by each unknown with the measured deflections
            by_unknown = np.einsum("btip,bti->bp", regressor, deflection) * unknowns
            by_element = [by_unknown[:, element.columns].sum(axis=1) for element in elements]
            products.append(np.stack(by_element))
            targets.append(regressor @ unknowns)
            if rows.encoders is not None:
                encoders.append(rows.encoders[..., :-1] @ unknowns)
        of_encoders = np.concatenate(encoders) if encoders else None
        return cls(np.concatenate(targets), of_encoders, np.concatenate(products, axis=1))

    def build_shares(
        self, elements: Sequence[_Element], measurements: Measurements
    ) -> tuple[ElementShare, ...]:
        """Return the share of the measured deflections that each element explains, also by observation."""
        measured = np.square(measurements.deflection).sum(axis=(1, 2))  # (N,)
        zeros = np.zeros_like(self.products)
        by_observation = np.divide(self.products, measured, out=zeros, where=measured > 0.0)
        shares = list[ElementShare]()
        for number, element in enumerate(elements):
            share = ElementShare(
                kind=element.kind,
                joint=element.joint,
                share=float(self.products[number].sum() / measured.sum()),
                by_observation=by_observation[number].tolist(),
            )
            shares.append(share)
        return tuple(shares)


class _Element(NamedTuple):
    """Elastic element, whose share of the deflections is computed."""

    kind: Literal["joint", "coupling", "link", "base"]
    joint: str | None  #: name of the joint, or of the joint before the link; None for coupling and base
    columns: IndexArray  #: columns of its compliances among the P columns of the richest model


def _list_elements(robot: Robot, candidate: Candidate) -> list[_Element]:
    """List the elastic elements of a model: all joints, their coupling, then links and base.

    Each element has the columns of its compliances in the rows of a fit. The compliance of a joint has two:
    as a single number, and on the diagonal of the matrix that couples the joints; one of the two is zero.
    """
    columns = candidate.columns
    coupling_diagonal = columns.coupling[find_diagonal_entries(columns.n)]
    elements = list[_Element]()
    for joint, name in enumerate(robot.joint_names):
        own_columns = np.array([columns.joints[joint], coupling_diagonal[joint]])
        elements.append(_Element("joint", name, own_columns))
    if candidate.model.couples_joints:
        off_diagonal = np.setdiff1d(columns.coupling, coupling_diagonal)
        elements.append(_Element("coupling", None, off_diagonal))
    for frame in candidate.frames:  # a link has the index of the joint before it
        link_columns = columns.link_columns(frame)
        if frame == BASE:
            elements.append(_Element("base", None, link_columns))
        else:
            elements.append(_Element("link", robot.joint_names[frame], link_columns))
    return elements
