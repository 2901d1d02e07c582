"""Rows reduced to the parameters of an elastic model, and the losses of their residuals (method.md §7).

    squared    ‖z − R x‖² / ‖z‖² + λ tr              rows compressed to a triangle
    huber      Σ ρ(r_i) / Σ ‖d_i‖ + λ tr             one second-order cone a target

ρ is ‖r‖²/(2h) up to h, and ‖r‖ − h/2 beyond.

The penalty contains no arbitrarily chosen length. The penalty is the work that a unit force at the load point
does on an element, averaged over the directions of the force and, because the fitted postures are few, over
all directions of the lever. The length ρ_i of the lever is the root mean square distance, over the fitted
postures, from the origin of frame i to the load point. The penalty of a link is ``tr(M_i C_i)`` with
``M_i = diag(I, 2/3 ρ_i² I)``; the penalty of coupled joints is ``tr(M C_θ)`` with ``M = diag(2/3 ρ_j²)``.
With the parameters ``X = K C K / u``, K² = M, the penalty is the trace of X, and with u the deflection
divided by the force it has no unit.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.schemas.options import Loss as LossName
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fit.cone import Matrices, Scalars, find_diagonal_entries
from jointstiff.solver.fit.conic import (
    NormSum,
    RobustProgram,
    RobustSolution,
    certify_cone,
    certify_robust,
    solve_robust,
)
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.method import DEFAULT_THRESHOLD
from jointstiff.solver.fit.part import MOST_TARGETS, Part, RowColumns, Sums
from jointstiff.solver.fit.problem import LeastSquares, Problem, Solution
from jointstiff.solver.fit.solution import solve
from jointstiff.solver.fit.stages import MEDIAN_NORM
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.springs import BASE, triangle_indices
from jointstiff.solver.models import Columns, ElasticModel

LOSSES: Final[tuple[LossName, ...]] = ("squared", "huber")
"""Losses of the norm of each target's residual."""
_LEAST_SCALE: Final = 1e-6
"""Least robust scale of residuals, relative to the mean deflection: exact readings would give zero."""
_SCALE_ROUNDS: Final = 2
"""Rounds in which the scale of the residuals and a robust fit follow from each other: the median hardly moves
after the first."""
_LEAST_WEIGHT: Final = 1e-9
"""Least weight of the penalty in a least-squares problem."""
_SHORTEST_LEVER: Final = 1e-2
"""Least lever relative to the longest lever: with a lever near zero, because the load point lies in the
origin of the frame, rotations would have no penalty."""
_BASE_ROOT: Final = 0.3
"""Square root of the base's penalty relative to a link's. All readings depend on the base, so that hardly any
penalty is needed; the penalty of a link would make the estimated compliance of a pedestal 5 % too small."""
_NO_COLUMN: Final = 1e-9
"""Least norm of a joint's column relative to the largest norm: a smaller column is rounding, and the
compliance of this joint is not estimated."""


@dataclass(frozen=True)
class Candidate:
    """Model with the loss of its fit, as it competes with others."""

    model: ElasticModel
    columns: Columns  #: columns of the richest model; its links are those that bend here
    loss: LossName = "squared"  #: loss of the norm of each target's whitened residual: its square, or Huber's
    threshold: float = DEFAULT_THRESHOLD  #: threshold of Huber's loss, in units of sigma

    @property
    def key(self) -> tuple[ModelName, LossName]:
        """Pair of the names of model and loss, which identifies the candidate within a run."""
        return self.model.name, self.loss

    @property
    def frames(self) -> tuple[int, ...]:
        """Frames of the links and base that bend: joint indices of the links, then `BASE`."""
        return self.model.list_frames(self.columns)


class _Element(NamedTuple):
    """Elastic element with a compliance matrix C, whose penalty is the trace of K C K, with K diagonal."""

    columns: IndexArray  #: (q,) columns of the parameters: C's diagonal, or its upper triangle
    root: FloatArray  #: (size,) diagonal of K
    is_full: bool  #: whether C is a full matrix; else it is diagonal

    def compute_units(self, typical_compliance: float) -> FloatArray:
        """Return the units (q,) of the entries of C, in which their parameters are those of ``K C K / u``.

        The entry C_ij has the unit u / (K_i K_j), with the typical compliance u [m/N].
        """
        if not self.is_full:
            return typical_compliance / self.root**2
        i, j = triangle_indices(len(self.root))
        return np.asarray(typical_compliance / (self.root[i] * self.root[j]))


class _PenaltyScale(NamedTuple):
    """Quantities that make the penalty on elastic elements free of units."""

    typical_compliance: float  #: u, deflection over force [m/N]
    levers: FloatArray  #: (n + 1,) lever ρ of the load about each joint's frame and, last, the base [m]


@dataclass(frozen=True, eq=False)
class Reduced:
    """Rows of a part of a campaign, reduced to the p parameters of a model, for any weight of the penalty."""

    part: Part  #: rows of the observations
    squares: LeastSquares  #: squared residuals as a function of the parameters
    cone: Matrices  #: cone that contains the parameters
    columns: IndexArray  #: (p,) column of the rows that belongs to each parameter
    unit: FloatArray  #: (p,) unit of each parameter: compliances are ``unit · x``
    reading_norm: float  #: norm ‖d‖ of all whitened readings [m], by which the squared loss divides residuals
    sigma: float | None  #: stated sigma of one coordinate of one reading [m]; None if no sigma is stated

    @cached_property
    def total_deflection(self) -> float:
        """Sum Σ ‖d_i‖ of the lengths of all targets' deflections [m], by which Huber's loss is divided."""
        deflections = self.part.target_columns.d  # (T, 3)
        return float(np.linalg.norm(deflections, axis=1).sum())

    @cached_property
    def norms(self) -> NormSum:
        """Huber's loss ``Σ ρ(‖A_i x + B_i v − d_i‖)`` of the targets i, without the penalty.

        x (p,) are the parameters, v (K,) systematic errors in units of their stated uncertainties, d_i (3,)
        is the deflection of target i. All lengths are divided by `total_deflection`, so that Σ ‖d_i‖ = 1.
        """
        in_total_deflections = self.part.targets / self.total_deflection
        count_of_compliances = self.part.compliances
        of_compliances, of_errors, d = RowColumns.split(in_total_deflections, count_of_compliances)
        return NormSum(
            A=of_compliances[..., self.columns] * self.unit,
            d=d,
            cone=self.cone,
            B=of_errors,
            statement=self.part.statements.sigma / self.total_deflection,
        )

    def build_problem(self, weight: float) -> Problem[Matrices]:
        """Return the problem that minimises squared residuals plus λ times the penalty."""
        return Problem(self.squares, self.cone, weight)

    def to_parameters(self, compliances: FloatArray) -> FloatArray:
        """Return the parameters (p,) of compliances (P,)."""
        return np.asarray(compliances[self.columns] / self.unit)

    def to_compliances(self, x: FloatArray) -> FloatArray:
        """Return the compliances (P,) of parameters x (p,); zero in columns without a parameter."""
        compliances = np.zeros(self.part.compliances)
        compliances[self.columns] = self.unit * x
        return compliances

    def to_unknowns(self, solution: Solution) -> FloatArray:
        """Return the unknowns (P + K,) of a solution: compliances, then systematic errors with a prior."""
        compliances = self.to_compliances(solution.x)
        if isinstance(solution, RobustSolution):
            return np.concatenate([compliances, solution.errors])
        return self.part.append_fitted_errors(compliances)

    def estimate_residual_scale(self, unknowns: FloatArray) -> float:
        """Estimate the standard deviation [m] of a residual's coordinate, robustly by the median norm.

        Args:
            unknowns: (P + K,) fitted compliances, then fitted systematic errors.
        """
        norms = self.part.compute_residual_norms(unknowns)
        mean_deflection = self.total_deflection / max(1, len(norms))
        scale = float(np.median(norms)) / MEDIAN_NORM  # `MEDIAN_NORM` is the median norm of normal noise
        return max(scale, _LEAST_SCALE * mean_deflection)


def reduce_part(part: Part, candidate: Candidate, visible: BoolArray, sigma: float | None = None) -> Reduced:
    """Select and scale the columns of least-squares rows for the parameters x of a model.

    Compliances are ``unit · x``. For joints the unit makes the columns of x unit vectors. For elements with a
    penalty it makes the penalty the sum of x or, if the compliance is a full matrix, the trace of the matrix
    X of x: with the compliance C, the diagonal roots K of its penalty and the typical compliance u,
    ``X_ij = K_i C_ij K_j / u``. In x the joints come first, then the entries of diagonal matrices, then the
    upper triangles of full matrices.

    Args:
        part: compressed rows of the observations.
        candidate: elastic elements that bend.
        visible: (n,) mask of the joints whose compliances the readings determine.
        sigma: stated standard uncertainty of one coordinate of one reading [m]; None if unknown.

    Raises:
        UnsupportedMethodError: no target moved, or no load acts, so that the size of the penalty is
            undefined.
    """
    regressor, z = part.regression
    reading_norm = float(np.linalg.norm(part.triangle[:, -1]))
    joint_norms = np.linalg.norm(regressor[:, candidate.columns.joints], axis=0)
    is_determined = visible & (joint_norms > _NO_COLUMN * joint_norms.max())
    joints = np.flatnonzero(is_determined)
    typical_compliance, levers = _scale_penalty(part.sums, reading_norm)
    elements = list(_list_penalised_elements(candidate, is_determined, levers))
    unit_of_joints = reading_norm / joint_norms[joints]
    parameters = _Parameters.arrange(joints, unit_of_joints, elements, typical_compliance)
    scaled_regressor = (regressor / reading_norm)[:, parameters.columns] * parameters.unit
    return Reduced(
        part=part,
        squares=LeastSquares(scaled_regressor, z / reading_norm),
        cone=parameters.cone,
        columns=parameters.columns,
        unit=parameters.unit,
        reading_norm=reading_norm,
        sigma=sigma,
    )


class _Parameters(NamedTuple):
    """Parameters x of a model: first of the joints, then of diagonal matrices, then of full matrices."""

    columns: IndexArray  #: (p,) column of the rows that belongs to each parameter
    unit: FloatArray  #: (p,) unit of each parameter: compliances are ``unit · x``
    cone: Matrices  #: cone that contains the parameters

    @classmethod
    def arrange(
        cls,
        joints: IndexArray,
        unit_of_joints: FloatArray,
        elements: Sequence[_Element],
        typical_compliance: float,
    ) -> _Parameters:
        """Arrange the parameters in the order of `Matrices`.

        Args:
            joints: (j,) columns of the joints whose compliances are estimated.
            unit_of_joints: (j,) units of these compliances [m/(rad/(N·m))].
            elements: elements with a penalty.
            typical_compliance: deflection over force, by which the penalty is scaled [m/N].
        """
        diagonal = [element for element in elements if not element.is_full]
        full = [element for element in elements if element.is_full]
        columns, units = [joints], [unit_of_joints]
        for element in [*diagonal, *full]:
            columns.append(element.columns)
            units.append(element.compute_units(typical_compliance))
        diagonal_entry_count = sum(len(element.columns) for element in diagonal)
        cone = Matrices(
            nonnegative=len(joints) + diagonal_entry_count,
            sizes=tuple(len(element.root) for element in full),
            penalised=diagonal_entry_count,
        )
        return cls(np.concatenate(columns), np.concatenate(units), cone)


def _list_penalised_elements(
    candidate: Candidate, determined: BoolArray, lever: FloatArray
) -> Iterator[_Element]:
    """Yield the elastic elements of a model whose compliance C is penalised by the trace of K C K.

    For a link K is ``diag(1, 1, 1, r, r, r)`` with ``r = √(2/3) ρ`` for rotations; for coupled joints it is
    the diagonal matrix of their r. The base has a smaller K, and always a full compliance.

    Args:
        candidate: elastic elements that bend.
        determined: (n,) mask of the joints whose compliance is determined.
        lever: (n + 1,) lever ρ of the load about each joint's frame and, last, about the base [m].
    """
    model, columns = candidate.model, candidate.columns
    rotation_root = np.sqrt(2.0 / 3.0) * lever
    if model.couples_joints:
        i, j = triangle_indices(columns.n)  # joints of each column of the coupling
        both_determined = determined[i] & determined[j]
        joints_root = rotation_root[:-1][determined]
        yield _Element(columns.coupling[both_determined], joints_root, is_full=True)
    for frame in candidate.frames:
        root = np.repeat([1.0, rotation_root[frame]], 3)  # translations, rotations
        link_columns = columns.link_columns(frame)
        if frame == BASE:
            yield _Element(link_columns, _BASE_ROOT * root, is_full=True)
        elif model.links == "full":
            yield _Element(link_columns, root, is_full=True)
        else:
            diagonal_columns = link_columns[find_diagonal_entries(6)]
            yield _Element(diagonal_columns, root, is_full=False)


def _scale_penalty(sums: Sums, reading_norm: float) -> _PenaltyScale:
    """Return the typical compliance u and the levers ρ by which the penalty is scaled.

    u is the root mean square deflection of a target, divided by the root mean square force of a load.

    Args:
        sums: sums over the observations.
        reading_norm: norm of the whitened readings [m]; zero if no target moved.

    Raises:
        UnsupportedMethodError: no target moved, or no load has a lever arm.
    """
    levers = _compute_levers(sums)
    sum_of_squared_forces = _sum_squared_forces(sums, levers)
    if reading_norm == 0.0 or sum_of_squared_forces == 0.0:
        raise UnsupportedMethodError(
            "no target moved, or no load has a lever arm, so the penalty on link compliance has no scale",
            where="elasticity",
            remedy="use elasticity joints",
        )
    squared_deflection = sums.squared_deflection / sums.targets  # mean of a target
    squared_force = sum_of_squared_forces / sums.observations  # mean of an observation
    return _PenaltyScale(float(np.sqrt(squared_deflection / squared_force)), levers)


def _compute_levers(sums: Sums) -> FloatArray:
    """Return the levers ρ (n + 1,) of the load [m], about the frames of the n joints and, last, the base.

    A lever is the root mean square distance from the frame's origin to the load point. Levers near zero are
    raised to a small fraction of the longest lever of a joint.
    """
    levers = np.sqrt(sums.squared_levers / sums.observations)
    longest_of_joints = levers[:-1].max()
    return np.asarray(np.maximum(levers, _SHORTEST_LEVER * longest_of_joints))


def _sum_squared_forces(sums: Sums, levers: FloatArray) -> float:
    """Return the sum of ‖F‖² over all loads [N²], in which a moment M counts as the force that causes it.

    A force F on a lever of length ρ and random direction causes a squared moment of 2/3 ρ² ‖F‖² on average.
    So a moment counts as ‖F‖² = 3/2 ‖M‖² / ρ², averaged over the levers of the joints.

    Args:
        sums: sums over the observations.
        levers: (n + 1,) levers ρ of the joints' frames and, last, of the base [m].

    Returns:
        The sum; zero if the load point is the origin of every joint's frame, so that no lever has a length.
    """
    if not levers.all():
        return 0.0
    squared_force_per_moment = float(np.mean(1.5 / levers[:-1] ** 2))
    return sums.squared_force + sums.squared_moment * squared_force_per_moment


class Loss(ABC):
    """Loss of the residuals of reduced rows."""

    reduced: Reduced

    @abstractmethod
    def solve(self, weight: float, *, gap: float, accepted: float | None = None) -> Solution:
        """Minimise the loss plus λ times the penalty, and certify the optimum.

        Args:
            weight: λ > 0 of the penalty.
            gap: duality gap at which the search ends; `compute_gap_unit` converts the gap to a length.
            accepted: greatest gap that is accepted if rounding prevents `gap`; None for `gap` itself.

        Raises:
            SolverError: no optimum is certified within the accepted gap.
        """

    @abstractmethod
    def certify_gap(self, compliances: FloatArray, weight: float, solution: Solution) -> float:
        """Return the duality gap at compliances (P,) that differ slightly from those of a solution."""

    @abstractmethod
    def build_weighted_squares(
        self, candidate: Candidate, unknowns: FloatArray, weight: float
    ) -> tuple[Reduced, float]:
        """Return a weighted least-squares problem with the optimum of the fit, and its penalty weight.

        Args:
            candidate: elastic elements that bend.
            unknowns: (P + K,) fitted compliances, then fitted systematic errors.
            weight: weight λ of the penalty in the fit.
        """


@dataclass(frozen=True, eq=False)
class SquaredLoss(Loss):
    """Squares of the residuals, over the squares of the readings."""

    reduced: Reduced

    def solve(self, weight: float, *, gap: float, accepted: float | None = None) -> Solution:
        """Minimise the squares plus λ times the penalty; arguments and errors are those of `Loss.solve`.

        Without penalised parameters, the problem is one over scalars, whose optimum has no gap.
        """
        cone = self.reduced.cone
        if not cone.has_penalty:
            positive = Scalars(Bounds.positive(cone.dimension))
            return solve(Problem(self.reduced.squares, positive), witnessed=False)
        return solve(self.reduced.build_problem(weight), gap=gap, accepted=accepted)

    def certify_gap(self, compliances: FloatArray, weight: float, solution: Solution) -> float:  # noqa: ARG002
        """Return the duality gap at compliances (P,); the solution is not needed."""
        x = self.reduced.to_parameters(compliances)
        return certify_cone(self.reduced.build_problem(weight), x).gap

    def build_weighted_squares(
        self,
        candidate: Candidate,  # noqa: ARG002
        unknowns: FloatArray,  # noqa: ARG002
        weight: float,
    ) -> tuple[Reduced, float]:
        """Return the problem and its penalty weight as they are: they are least squares already."""
        return self.reduced, weight


@dataclass(frozen=True, eq=False)
class HuberLoss(Loss):
    """Huber's loss ρ of the norm of each target's residual, over the sum of the deflections' lengths."""

    reduced: Reduced
    threshold: float  #: h, the length of a residual from which ρ is linear [m]

    def _state_program(self, weight: float) -> RobustProgram:
        """Return the program with Huber's loss and λ times the penalty, in the unit of robust losses."""
        threshold = self.threshold / self.reduced.total_deflection
        return RobustProgram(self.reduced.norms, weight, threshold)

    def solve(self, weight: float, *, gap: float, accepted: float | None = None) -> RobustSolution:
        """Minimise Huber's loss plus λ times the penalty; arguments and errors are those of `Loss.solve`."""
        return solve_robust(self._state_program(weight), wanted_gap=gap, accepted_gap=accepted)

    def certify_gap(self, compliances: FloatArray, weight: float, solution: Solution) -> float:
        """Return the duality gap at compliances (P,), with the dual multipliers of the solution.

        Args:
            compliances: (P,) compliances near those of the solution.
            weight: weight λ of the penalty.
            solution: optimum of this loss; one of another loss has no stated errors.
        """
        x = self.reduced.to_parameters(compliances)
        errors = solution.errors if isinstance(solution, RobustSolution) else np.zeros(0)
        multipliers = solution.certificate.multipliers
        return certify_robust(self._state_program(weight), x, errors, multipliers).gap

    def _compute_target_weights(self, unknowns: FloatArray) -> FloatArray:
        """Return weights (T,): 1 up to the threshold h, and h/‖r‖ for a target whose residual r is longer.

        With these weights w, the gradient 2 w r of a weighted square is 2h times the gradient of Huber's
        loss, which is r/h up to h and r/‖r‖ beyond.
        """
        norms = self.reduced.part.compute_residual_norms(unknowns)
        return np.asarray(self.threshold / np.maximum(norms, self.threshold))

    def build_weighted_squares(
        self, candidate: Candidate, unknowns: FloatArray, weight: float
    ) -> tuple[Reduced, float]:
        """Return a weighted least-squares problem with the optimum of the fit, and its penalty weight.

        The fit minimises ``Σ ρ(r_i) / Σ ‖d_i‖ + λ tr`` over the parameters, with the residuals r_i, the
        deflections d_i and Huber's loss ρ with threshold h. The problem is ``Σ w_i ‖r_i‖² / ‖d_w‖² + λ_s tr``
        with the weights w_i of `_compute_target_weights` and the norm ‖d_w‖ of the weighted readings. At the
        fitted unknowns ``Σ w_i ‖r_i‖²`` has 2h times the gradient of ``Σ ρ(r_i)``. So both optima are the
        same for ``λ_s = 2h λ Σ ‖d_i‖ / ‖d_w‖²``.

        Args:
            candidate: elastic elements that bend.
            unknowns: (P + K,) fitted compliances, then fitted systematic errors.
            weight: weight λ of the penalty in the fit.

        Returns:
            The weighted problem, and λ_s.
        """
        part, sigma = self.reduced.part, self.reduced.sigma
        weighted_part = part.with_target_weights(self._compute_target_weights(unknowns))
        squares = reduce_part(weighted_part, candidate, self._find_fitted_joints(candidate), sigma)
        numerator = 2.0 * self.reduced.total_deflection * self.threshold * weight
        return squares, numerator / squares.reading_norm**2

    def _find_fitted_joints(self, candidate: Candidate) -> BoolArray:
        """Return the mask (n,) of the joints whose compliances are parameters of the fit."""
        joints = np.arange(candidate.columns.n)  # the first columns, in the order of the joints
        return np.isin(joints, self.reduced.columns)


def compute_gap_unit(reduced: Reduced, candidate: Candidate) -> float:
    """Return the length [m] that corresponds to a duality gap of 1: `gap · length` is the error of a fit.

    The gap of an answer, `Certificate.gap`, bounds how far the answer is from the exact optimum. It has no
    unit, because a loss is divided by the size of the readings d:

        squared    Σ ‖r_i‖² / ‖d‖²       The gap is the root of the excess of the loss. With ‖d‖ as its unit
                                         it is the distance of the fitted readings from those at the optimum.
        huber      Σ ρ(r_i) / Σ ‖d_i‖    The gap is the excess of the loss. With the mean length of the
                                         deflections, Σ ‖d_i‖ over their number, as its unit it is the excess
                                         of the mean loss of a target, which is a length.
    """
    if candidate.loss == "squared":
        return reduced.reading_norm
    target_count = reduced.part.sums.targets
    return reduced.total_deflection / target_count


class Fitted(NamedTuple):
    """Optimum of a loss."""

    loss: Loss
    solution: Solution


def fit_loss(
    reduced: Reduced, candidate: Candidate, weight: float, *, gap: float, accepted: float | None = None
) -> Fitted:
    """Fit the parameters with squared loss or Huber's loss, and certify the optimum.

    The threshold of Huber's loss is in units of sigma, the stated noise of a reading. If sigma is unknown, it
    is in units of the residuals' robust scale, first of a fit with squares, then of the fit itself.

    Args:
        reduced: rows of some observations.
        candidate: model with its loss and the threshold of the loss.
        weight: λ > 0 of the penalty.
        gap: duality gap at which the search ends.
        accepted: greatest gap that is accepted if rounding prevents `gap`; None for `gap` itself.

    Raises:
        SolverError: no optimum is certified within the accepted gap.
    """
    loss: Loss = SquaredLoss(reduced)
    if candidate.loss == "huber" and reduced.sigma is not None:
        loss = HuberLoss(reduced, candidate.threshold * reduced.sigma)
    solution = loss.solve(weight, gap=gap, accepted=accepted)
    if candidate.loss == "huber" and reduced.sigma is None:
        for _ in range(_SCALE_ROUNDS):
            unknowns = reduced.to_unknowns(solution)
            scale = reduced.estimate_residual_scale(unknowns)
            loss = HuberLoss(reduced, candidate.threshold * scale)
            solution = loss.solve(weight, gap=gap, accepted=accepted)
    return Fitted(loss, solution)


def convert_weight_to_squares(
    reduced: Reduced, candidate: Candidate, unknowns: FloatArray, weight: float
) -> float:
    """Return the weight of the penalty in least squares that is as strong as λ is in a fit of the candidate.

    Args:
        reduced: rows of the fit.
        candidate: model and loss of the fit.
        unknowns: (P + K,) fitted compliances, then fitted systematic errors.
        weight: weight λ of the penalty in the fit.
    """
    if candidate.loss == "squared":
        return weight
    ratio = _compute_ratio_of_gradients(reduced, candidate, unknowns)
    return max(weight * ratio, _LEAST_WEIGHT)


def convert_weight_to_huber(
    reduced: Reduced, candidate: Candidate, unknowns: FloatArray, weight: float
) -> float:
    """Return the weight of the penalty with Huber's loss that is as strong as λ is in a fit by squares.

    Args:
        reduced: rows of the fit.
        candidate: model, and threshold of the loss.
        unknowns: (P + K,) compliances, then systematic errors, fitted by squares.
        weight: weight λ of the penalty in the fit by squares.
    """
    return weight / _compute_ratio_of_gradients(reduced, candidate, unknowns)


def _compute_ratio_of_gradients(reduced: Reduced, candidate: Candidate, unknowns: FloatArray) -> float:
    """Return the ratio of the gradient of the squared loss to that of Huber's loss, at fitted unknowns.

    A fit balances the gradient of its loss and that of the penalty. So a weight λ of the penalty with Huber's
    loss is as strong as `ratio · λ` with squares. For residuals r_i and deflections d_i of the targets:

        loss       Σ ‖r_i‖² / ‖d‖²        Σ ρ(r_i) / Σ ‖d_i‖
        gradient   2 ‖r_i‖ / ‖d‖²         min(‖r_i‖/h, 1) / Σ ‖d_i‖     by the length of r_i
        ratio      2 max(‖r_i‖, h) Σ ‖d_i‖ / ‖d‖²                       averaged over the targets

    Args:
        reduced: rows of the fit.
        candidate: threshold h of Huber's loss ρ, in units of sigma.
        unknowns: (P + K,) fitted compliances, then fitted systematic errors.
    """
    sigma = reduced.sigma or reduced.estimate_residual_scale(unknowns)
    h = candidate.threshold * sigma
    norms = reduced.part.compute_residual_norms(unknowns)  # ‖r_i‖
    mean_ratio = 2.0 * float(np.maximum(norms, h).mean())
    return mean_ratio * reduced.total_deflection / reduced.reading_norm**2


def list_losses_to_compare(measurements: Measurements, losses: tuple[LossName, ...]) -> tuple[LossName, ...]:
    """Return those of `losses` that a set of measurements supports.

    Only `squared` is supported for more than `MOST_TARGETS` targets, for encoders, and for readings along a
    direction, whose residuals have no length. Then `squared` is returned alone if it is among `losses`.

    Raises:
        UnsupportedMethodError: the set does not support the loss, and `losses` does not contain `squared`.
    """
    targets = int(measurements.present.sum())
    residuals_have_lengths = measurements.encoders is None and measurements.direction is None
    if targets <= MOST_TARGETS and residuals_have_lengths:
        return losses
    if "squared" in losses:
        return ("squared",)
    if not residuals_have_lengths:
        problem = (
            f"the loss {losses[0]} needs the length of each residual; encoder readings and readings along a "
            "direction have none"
        )
        remedy = "use loss squared"
    else:
        problem = (
            f"{targets} targets were read, but the loss {losses[0]} of elastic links supports at most "
            f"{MOST_TARGETS} targets"
        )
        remedy = "use loss squared, or leave observations out"
    raise UnsupportedMethodError(problem, where="loss", remedy=remedy)
