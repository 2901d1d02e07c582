"""Models of elastic joints, links and base, from simple to rich: rows, penalty and losses (method.md §7).

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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.schemas.options import Loss, RunOptions
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fit.cone import Cone, find_diagonal_entries
from jointstiff.solver.fit.conic import (
    ConeSolution,
    LeastSquares,
    NormSum,
    RobustProgram,
    RobustSolution,
    SemidefiniteProgram,
    certify_cone,
    certify_robust,
    solve_cone,
    solve_robust,
)
from jointstiff.solver.fit.method import DEFAULT_THRESHOLD
from jointstiff.solver.fit.problem import Bounds, IdentificationProblem
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import solve_step
from jointstiff.solver.fit.stages import MEDIAN_NORM
from jointstiff.solver.fit.statements import Statements
from jointstiff.solver.fit.triangle import Triangle, compute_triangular_factor
from jointstiff.solver.mechanics.block import (
    BlockRows,
    Term,
)
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import (
    BASE,
    COUPLED_JOINTS,
    JOINTS,
    build_links_term,
    triangle_indices,
)

MOST_JOINTS = 12
"""Greatest number of joints of a robot with elastic links: with more joints, unknowns outnumber readings."""

MOST_TARGETS: Final = 500
"""Greatest number of targets for which robust losses are supported: one fit then takes about 0.5 s."""
_BLOCK = 256
"""Number of observations in a block: the rows of a block stay below 10 MB for each target."""


@dataclass(frozen=True)
class ElasticColumns:
    """Columns of each compliance among the P columns of the richest model.

    A symmetric compliance matrix has one column for each entry of its upper triangle.
    """

    n: int  #: number of joints
    links: tuple[int, ...]  #: indices of the joints whose links may bend; the base may bend in any case

    def __post_init__(self) -> None:
        if self.n > MOST_JOINTS:
            raise UnsupportedMethodError(
                f"the robot has {self.n} joints; elastic links support at most {MOST_JOINTS}",
                where="elasticity",
                remedy="use elasticity joints",
            )

    @classmethod
    def from_options(cls, options: RunOptions, robot: Robot) -> ElasticColumns:
        """Return the columns of the links that may bend.

        Raises:
            RequestError: the robot has no joint that an option names.
            UnsupportedMethodError: the robot has too many joints.
        """
        named = sorted({robot.joint_index(name, "links") for name in options.links})
        return cls(robot.n, tuple(named or range(robot.n)))

    @property
    def width(self) -> int:
        """Number P of columns: of the joints, of their coupling, and 21 for each link and for the base."""
        return self.n + len(self.coupling) + 21 * len(self.frames)

    @property
    def frames(self) -> tuple[int, ...]:
        """Frames with a 6 × 6 compliance (21 different entries): joint indices of the links, then `BASE`."""
        return *self.links, BASE

    @property
    def joints(self) -> IndexArray:
        """(n,) columns of the joint compliances c [m/(rad/(N·m))]."""
        return np.arange(self.n)

    @property
    def coupling(self) -> IndexArray:
        """Columns (n (n + 1) / 2,) of the full compliance matrix C_θ of the joints [m/(rad/(N·m))]."""
        return np.arange(self.n, self.n + self.n * (self.n + 1) // 2)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of the deflection model in the order of the columns: joints, coupling, links and base."""
        return JOINTS, COUPLED_JOINTS, build_links_term(self.frames)

    def link_columns(self, frame: int) -> IndexArray:
        """Return the columns (21,) of the compliance C_i of the link behind joint `frame`, or of `BASE`."""
        start = self.n + len(self.coupling) + 21 * self.frames.index(frame)
        return np.arange(start, start + 21)


@dataclass(frozen=True, eq=False)
class ElasticRows:
    """Compressed rows of some observations, and the sums that determine the scale of the penalty.

    The columns A of P compliances come first, then the columns B of K stated errors, in units of their
    standard uncertainties, then the readings d.
    """

    #: (P + K + 1, P + K + 1) with ``TᵀT`` the Gram matrix of the rows [A B d], whitened in units of sigma
    triangle: FloatArray
    configurations: int  #: number of observations
    readings: int  #: number of coordinates that were read
    targets: int  #: number of targets that were read
    force: float  #: sum over the observations of ‖F‖² [N²]
    moment: float  #: sum over the observations of ‖M‖² [N²·m²]
    #: (n + 1,) sum of the squared distances of the load point from the origins of the joint frames and, as
    #: the last number, of the base [m²]
    lever: FloatArray
    deflection: float  #: sum over the targets of ‖δp‖² [m²]

    #: (T, 3, P + K + 1) whitened rows [A B d] of each target, which a robust loss needs; T = 0 for more than
    #: `MOST_TARGETS` targets
    each: FloatArray
    stated: FloatArray  #: (q, P + K + 1) rows of what is stated: first that K errors are zero, then priors
    stated_errors: int = 0  #: number K of stated errors
    sigma: float = 1.0  #: standard uncertainty of a reading, by which statements are weighted [m]

    @classmethod
    def merge(cls, parts: Sequence[ElasticRows]) -> ElasticRows:
        """Merge the rows of several parts of a set; sums of squares are added, so that no digits are lost.

        The rows of single targets are dropped if they become too many.
        """
        kept = {name: getattr(parts[0], name) for name in ("stated", "stated_errors", "sigma")}
        added_fields = (f.name for f in fields(cls) if f.name not in {"triangle", "each", *kept})
        sums = {name: sum(getattr(part, name) for part in parts) for name in added_fields}
        rows_of_targets = np.concatenate([part.each for part in parts])
        rows_of_targets = rows_of_targets if sums["targets"] <= MOST_TARGETS else rows_of_targets[:0]
        triangle = compute_triangular_factor(np.concatenate([part.triangle for part in parts]))
        return cls(triangle=triangle, each=rows_of_targets, **sums, **kept)

    @property
    def compliances(self) -> int:
        """Number P of columns of compliances."""
        return int(self.triangle.shape[1]) - 1 - self.stated_errors

    @cached_property
    def _stated(self) -> tuple[FloatArray, FloatArray]:
        """Triangle (P + 1, P + 1) with stated errors projected out, and the map (K, P + 1) to these errors.

        Each stated error has a row like a reading: the error is zero, within its standard uncertainty.
        """
        P, K = self.compliances, self.stated_errors
        errors, others = slice(P, P + K), [*range(P), P + K]
        rows = np.vstack([self.triangle, self.stated])
        factor = compute_triangular_factor(np.hstack([rows[:, errors], rows[:, others]]))
        return factor[K:, K:], np.asarray(np.linalg.solve(factor[:K, :K], factor[:K, K:]), dtype=np.float64)

    @property
    def with_errors_fitted(self) -> FloatArray:
        """Triangle (P + 1, P + 1) of the rows [A d]: a fit to it equals a fit with the stated errors free.

        The errors are free within their standard uncertainties.
        """
        return self._stated[0] if len(self.stated) else self.triangle

    @property
    def count(self) -> int:
        """Number of readings and of stated compliances."""
        return self.readings + len(self.stated) - self.stated_errors

    def append_fitted_errors(self, compliances: FloatArray) -> FloatArray:
        """Return compliances (..., P), followed by the stated errors (..., K) that fit best in squares."""
        if not self.stated_errors:
            return compliances
        to_errors = self._stated[1]
        errors = to_errors[:, -1] - compliances @ to_errors[:, :-1].T
        return np.concatenate([compliances, errors], axis=-1)

    def compute_residual_norms(self, unknowns: FloatArray) -> FloatArray:
        """Return the norms (T,) [m] of each target's whitened residual at unknowns (P + K,)."""
        residuals = self.each[..., :-1] @ unknowns - self.each[..., -1]
        return np.asarray(np.linalg.norm(residuals, axis=1))

    def compute_huber_weights(self, unknowns: FloatArray, threshold: float) -> FloatArray:
        """Return the weights (T,) of the targets' squares by Huber's loss with a threshold [m].

        Args:
            unknowns: (P + K,) compliances and stated errors.
            threshold: length of a residual from which the loss is linear [m].
        """
        norms = self.compute_residual_norms(unknowns)
        return np.asarray(threshold / np.maximum(norms, threshold))

    def weight_targets(self, weight: FloatArray) -> ElasticRows:
        """Return the rows with a triangle in which the squares of the T targets have weights (T,).

        The rows `each` stay unweighted.
        """
        rows = np.sqrt(weight)[:, None, None] * self.each
        return replace(self, triangle=compute_triangular_factor(rows.reshape(-1, rows.shape[-1])))


def compress_elastic_rows(
    source: Rows,
    columns: ElasticColumns,
    parts: Sequence[IndexArray],
    statements: Statements | None = None,
) -> tuple[ElasticRows, ...]:
    """Compress the rows of each of several parts of a measurement set, in one pass with little memory.

    Args:
        source: N observations.
        columns: columns of the richest model.
        parts: ascending indices of the observations of each part.
        statements: stated errors that are fitted together with the compliances; None without any.

    Raises:
        MeasurementError: a covariance is not positive definite.
    """
    robot, measurements = source.robot, source.measurements
    blocks = list(generate_elastic_rows(source, columns, statements))
    width = blocks[0].targets.shape[-1] - 1
    errors = width - columns.width
    triangles = [Triangle(unknowns=width) for _ in parts]
    squared_levers = np.zeros((len(parts), robot.n + 1))
    rows_of_targets = [[np.zeros((0, 3, width + 1))] for _ in parts]
    keeps_rows = [int(measurements.present[part].sum()) <= MOST_TARGETS for part in parts]
    start = 0  # index of the first observation of the block
    for rows in blocks:
        whitened, block = rows.whiten(), rows.block
        present, coordinates = block.measurements.present, block.measurements.coordinates
        lever = np.square(block.frames[2]).sum(axis=2)
        for part_number, part in enumerate(parts):
            in_part = select_rows_of_part(part, start, start + len(present))
            triangle = triangles[part_number]
            triangle.add(whitened.targets[in_part], count=int(coordinates[in_part].sum()))
            if whitened.encoders is not None and block.measurements.encoders is not None:
                read = block.measurements.encoders.present[in_part]
                triangle.add(whitened.encoders[in_part], count=int(read.sum()))
            if keeps_rows[part_number]:
                rows_of_targets[part_number].append(whitened.targets[in_part][present[in_part]])
            squared_levers[part_number] += lever[in_part].sum(axis=0)
        start += len(present)
    return tuple(
        ElasticRows(
            triangle=triangle.R,
            configurations=len(part),
            readings=triangle.rows,
            targets=int(measurements.present[part].sum()),
            force=float(np.square(measurements.force[part]).sum()),
            moment=float(np.square(measurements.moment[part]).sum()),
            lever=lever,
            deflection=float(np.square(measurements.deflection[part]).sum()),
            each=np.concatenate(target_rows),
            stated=np.zeros((0, width + 1))
            if statements is None
            else statements.build_rows(columns.width, errors),
            stated_errors=errors,
            sigma=1.0 if statements is None else statements.sigma,
        )
        for part, triangle, lever, target_rows in zip(
            parts, triangles, squared_levers, rows_of_targets, strict=True
        )
    )


def select_rows_of_part(part: IndexArray, start: int, stop: int) -> IndexArray:
    """Return the rows of a block of observations that belong to a part of the measurement set.

    Args:
        part: ascending indices of the observations of the part.
        start: index of the first observation of the block.
        stop: index after the last observation of the block.

    Returns:
        Indices of the rows, counted from the start of the block.
    """
    first, last = np.searchsorted(part, [start, stop])
    return np.asarray(part[first:last] - start)


def generate_elastic_rows(
    rows: Rows, columns: ElasticColumns, statements: Statements | None = None
) -> Iterator[BlockRows]:
    """Yield the rows of blocks of observations.

    P columns of compliances come first, then K columns of stated errors, then the readings.
    """
    statements = statements or Statements.none(rows.robot.n)
    for start in range(0, len(rows), _BLOCK):
        part = rows[np.arange(start, min(start + _BLOCK, len(rows)))] if len(rows) > _BLOCK else rows
        yield from statements.generate(part, columns.terms, whitened=False)


MODELS: Final[tuple[ModelName, ...]] = (
    "joints",
    "joints_and_base",
    "coupled_joints",
    "diagonal_links",
    "joints_and_links",
    "links_and_base",
)
"""The models, from simple to rich."""
WITH_BASE: Final[frozenset[ModelName]] = frozenset({"joints_and_base", "links_and_base"})
"""Models whose base bends: compared with the others only if a test finds that the base bends."""
LINKS_ALONE: Final[frozenset[ModelName]] = frozenset({"diagonal_links", "joints_and_links"})
"""Models whose links bend and whose base does not."""


LOSSES: Final[tuple[Loss, ...]] = ("squared", "huber")
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
class ElasticModel:
    """Elements that deflect, and the loss with which their compliances are fitted."""

    #: elastic elements in addition to the joints, which have compliances of zero or more: `coupled_joints`
    #: has a full positive semidefinite joint compliance; `diagonal_links` six compliances for each link;
    #: `joints_and_links` a full positive semidefinite 6 × 6 compliance for each link; `joints_and_base` a
    #: full 6 × 6 compliance of the base; `links_and_base` full compliances of links and base
    name: ModelName
    columns: ElasticColumns  #: columns of the richest model; its links are those that bend here
    #: loss of the norm of each target's whitened residual: its square, or Huber's
    loss: Loss = "squared"
    threshold: float = DEFAULT_THRESHOLD  #: threshold of Huber's loss, in units of sigma

    @property
    def key(self) -> tuple[ModelName, Loss]:
        """Pair of name and loss, which identifies the model within a run."""
        return self.name, self.loss

    def generate_penalised_elements(
        self, determined: BoolArray, lever: FloatArray
    ) -> Iterator[tuple[IndexArray, FloatArray, bool]]:
        """Yield the penalised elements of the model.

        The penalty of an element with compliance C is the trace of K C K, K diagonal.

        Yields:
            The columns of the element's compliance; the diagonal of K; and whether the compliance is a full
            matrix (True) or diagonal (False).

        Args:
            determined: (n,) mask of the joints whose compliance is determined.
            lever: (n + 1,) lever ρ of the load about each joint's frame and the base [m].
        """
        rotation_root = np.sqrt(2.0 / 3.0) * lever  # entries of K for rotations, see the module's docstring
        if self.name == "coupled_joints":
            rows, columns = triangle_indices(self.columns.n)
            yield (
                self.columns.coupling[determined[rows] & determined[columns]],
                rotation_root[:BASE][determined],
                True,
            )
        for frame in self.frames:
            is_full = self.name != "diagonal_links"
            columns = self.columns.link_columns(frame)
            root = np.repeat([1.0, rotation_root[frame]], 3) * (_BASE_ROOT if frame == BASE else 1.0)
            yield columns if is_full else columns[find_diagonal_entries(6)], root, is_full

    @property
    def frames(self) -> tuple[int, ...]:
        """Frames of the links and base that bend: joint indices of the links, then `BASE`."""
        links = () if self.name in {"joints", "coupled_joints", "joints_and_base"} else self.columns.links
        return (*links, BASE) if self.name in WITH_BASE else links


@dataclass(frozen=True, eq=False)
class Formulation:
    """Optimisation problem of fitting a model to some observations, for any weight of the penalty."""

    squares: LeastSquares  #: squared residuals as a function of the p parameters
    cone: Cone  #: cone that contains the parameters
    columns: IndexArray  #: (p,) column of the rows that belongs to each parameter
    unit: FloatArray  #: (p,) unit of each parameter: compliances are ``unit · x``
    rows: ElasticRows  #: rows of the observations
    size: float  #: norm ‖d‖ of the whitened readings [m], by which the readings are divided
    sigma: float | None  #: stated sigma of one coordinate of one reading [m]; None if no sigma is stated

    @property
    def column_count(self) -> int:
        """Number P of columns of compliances."""
        return self.rows.compliances

    @cached_property
    def total(self) -> float:
        """Sum of the lengths of all targets' deflections [m]: the unit of robust losses."""
        return float(np.linalg.norm(self.rows.each[..., -1], axis=1).sum())

    @cached_property
    def _norms(self) -> NormSum:
        """Sum of the norms of the targets' residuals, as all robust losses and penalties use it."""
        each, total = self.rows.each, self.total
        A, B = each[..., self.columns] * (self.unit / total), each[..., self.column_count : -1] / total
        return NormSum(A, each[..., -1] / total, self.cone, B, self.rows.sigma / total)

    def build_squared_program(self, weight: float) -> SemidefiniteProgram:
        """Return the semidefinite program of the squared loss for a weight λ of the penalty."""
        return SemidefiniteProgram(self.squares, self.cone, weight)

    def build_robust_program(self, weight: float, threshold: float) -> RobustProgram:
        """Return the program of a robust loss for a weight λ and a threshold h [m]."""
        return RobustProgram(self._norms, weight, threshold / self.total)

    def convert_to_compliances(self, x: FloatArray) -> FloatArray:
        """Return the compliances (P,) of parameters x (p,); zero in columns without a parameter."""
        compliances = np.zeros(self.column_count)
        compliances[self.columns] = self.unit * x
        return compliances

    def convert_to_unknowns(self, solution: ConeSolution) -> FloatArray:
        """Return the unknowns (P + K,) of a solution: the compliances, then the stated errors."""
        compliances = self.convert_to_compliances(solution.x)
        if isinstance(solution, RobustSolution):
            return np.concatenate([compliances, solution.errors])
        return self.rows.append_fitted_errors(compliances)

    def compute_gap_unit(self, model: ElasticModel) -> float:
        """Return the factor [m] that converts the gap of a certificate to a length.

        With the squared loss, the length is ‖R (x − x̂)‖, the distance between the fitted readings and the
        fitted readings at the exact optimum. With a robust loss, the length is the amount by which the mean
        norm of the targets' residuals exceeds that at the exact optimum.
        """
        if model.loss == "squared":
            return self.size
        return self.total / self.rows.targets

    def fit(
        self, model: ElasticModel, weight: float, *, gap: float, accepted: float | None = None
    ) -> tuple[ConeSolution, float]:
        """Fit the parameters with the model's loss, and certify the optimum.

        The threshold of Huber's loss is in units of sigma; if sigma is unknown, in units of the robust scale
        of the residuals, first of a fit with squares, then of the fit itself.

        Args:
            model: elastic elements that bend, and the loss.
            weight: λ > 0 of the penalty.
            gap: duality gap at which the search ends; `compute_gap_unit` converts the gap to a length.
            accepted: greatest gap that is accepted if rounding prevents `gap`; None for `gap` itself.

        Returns:
            The solution, parameters (p,) with their certificate; and the threshold h [m] of Huber's loss, inf
            for squares.

        Raises:
            SolverError: no optimum is certified within the accepted gap.
        """
        if model.loss == "squared":
            return self._fit_squares(weight, gap, accepted), float("inf")
        if self.sigma is not None:
            threshold = model.threshold * self.sigma
            return self._fit_huber(weight, threshold, gap, accepted), threshold
        solution: ConeSolution = self._fit_squares(weight, gap, accepted)
        for _ in range(_SCALE_ROUNDS):
            threshold = model.threshold * self._estimate_residual_scale(self.convert_to_unknowns(solution))
            solution = self._fit_huber(weight, threshold, gap, accepted)
        return solution, threshold

    def _fit_squares(self, weight: float, gap: float, accepted: float | None) -> ConeSolution:
        """Fit the parameters by squares; arguments and errors as in `fit`."""
        return solve_cone(self.build_squared_program(weight), wanted_gap=gap, accepted_gap=accepted)

    def _fit_huber(
        self, weight: float, threshold: float, gap: float, accepted: float | None
    ) -> RobustSolution:
        """Fit the parameters by Huber's loss with a threshold h [m]; arguments and errors as in `fit`."""
        program = self.build_robust_program(weight, threshold)
        return solve_robust(program, wanted_gap=gap, accepted_gap=accepted)

    def certify_gap(
        self, compliances: FloatArray, weight: float, solution: ConeSolution, threshold: float
    ) -> float:
        """Return the duality gap at compliances (P,) that differ slightly from a solution.

        Args:
            compliances: (P,) compliances, for example a solution with raised diagonals.
            weight: weight λ of the penalty.
            solution: the solution, whose dual multipliers are used for a robust loss.
            threshold: threshold h [m] of the robust loss; unused for the squared loss.
        """
        x = compliances[self.columns] / self.unit
        if not isinstance(solution, RobustSolution):
            return certify_cone(self.build_squared_program(weight), x).gap
        program = self.build_robust_program(weight, threshold)
        return certify_robust(program, x, solution.errors, solution.certificate.multipliers).gap

    def fit_joints_only(self) -> FloatArray:
        """Return the exact least-squares unknowns (P + K,) if joints alone bend: there is no penalty."""
        R, z = self.squares.R, self.squares.z
        problem = IdentificationProblem(R, z, Bounds.positive(R.shape[1]))
        compliances = self.convert_to_compliances(solve_step(problem).compliance)
        return self.rows.append_fitted_errors(compliances)

    def _estimate_residual_scale(self, unknowns: FloatArray) -> float:
        """Return the standard deviation [m] of the residuals at unknowns (P + K,), from their median norm."""
        norms = self.rows.compute_residual_norms(unknowns)
        least = _LEAST_SCALE * self.total / max(1, len(norms))
        return max(float(np.median(norms)) / MEDIAN_NORM, least)

    def build_weighted_squares(
        self, model: ElasticModel, unknowns: FloatArray, weight: float, threshold: float
    ) -> tuple[Formulation, float]:
        """Return a weighted least-squares problem with the optimum of a robust fit, and its penalty weight.

        A target whose residual r exceeds the threshold h has weight h/‖r‖: the sum of the weighted squares is
        stationary where Huber's loss is stationary. For the squared loss, this problem itself is returned.

        Args:
            model: elastic elements that bend, and the loss.
            unknowns: (P + K,) fitted compliances and stated errors.
            weight: weight λ of the penalty in the fit.
            threshold: threshold h of the fit [m].
        """
        if model.loss == "squared":
            return self, weight
        weighted = self.rows.weight_targets(self.rows.compute_huber_weights(unknowns, threshold))
        determined = np.isin(np.arange(model.columns.n), self.columns)
        squares = formulate_fit(weighted, model, determined, self.sigma)
        return squares, 2.0 * self.total * threshold * weight / squares.size**2

    def convert_weight_to_squares(self, model: ElasticModel, unknowns: FloatArray, weight: float) -> float:
        """Return the penalty's weight for squares that is as strong as λ is in a fit of the model.

        Args:
            model: elastic elements that bend, and the loss.
            unknowns: (P + K,) fitted compliances and stated errors.
            weight: weight λ of the penalty in the fit.
        """
        if model.loss == "squared":
            return weight
        return max(weight * self._compare_penalties(model, unknowns), _LEAST_WEIGHT)

    def convert_weight_to_huber(self, model: ElasticModel, unknowns: FloatArray, weight: float) -> float:
        """Return the penalty's weight for Huber's loss that is as strong as λ is in a fit by squares.

        Args:
            model: elastic elements that bend, and the threshold of the loss.
            unknowns: (P + K,) compliances and stated errors, fitted by squares.
            weight: weight λ of the penalty in the fit by squares.
        """
        return weight / self._compare_penalties(model, unknowns)

    def _compare_penalties(self, model: ElasticModel, unknowns: FloatArray) -> float:
        """Return how much weaker a penalty of the same weight is with squares than with Huber's loss.

        In the gradient of Huber's loss a residual up to the threshold h counts with its length over h, and a
        longer residual with 1; in the gradient of squares each residual counts with its own length.
        """
        scale = self.sigma or self._estimate_residual_scale(unknowns)
        lengths = np.maximum(self.rows.compute_residual_norms(unknowns), model.threshold * scale)
        return 2.0 * self.total * float(lengths.mean()) / self.size**2


def formulate_fit(
    rows: ElasticRows, model: ElasticModel, visible: BoolArray, sigma: float | None = None
) -> Formulation:
    """Formulate the fit of a model to some observations as an optimisation problem.

    Args:
        rows: compressed rows of the observations: regressor R and readings z after a QR decomposition.
        model: elastic elements that bend, and the loss.
        visible: (n,) mask of the joints whose compliances the readings determine.
        sigma: stated standard uncertainty of one coordinate of one reading [m]; None if unknown.

    Raises:
        UnsupportedMethodError: no target moved, or no load acts, so that the size of the penalty is
            undefined.
    """
    regressor, z = rows.with_errors_fitted[:, :-1], rows.with_errors_fitted[:, -1]
    reading_norm = float(np.linalg.norm(rows.triangle[:, -1]))
    norms = np.linalg.norm(regressor[:, model.columns.joints], axis=0)
    is_determined = visible & (norms > _NO_COLUMN * norms.max())
    joints = np.flatnonzero(is_determined)
    penalty_unit, lever_arms = _scale_penalty(rows, reading_norm)
    # Columns and units of the parameters: first scalar compliances, then the entries of full matrices.
    scalars, matrices, matrix_orders = [(joints, reading_norm / norms[joints])], [], []
    for columns, penalty_root, is_full in model.generate_penalised_elements(is_determined, lever_arms):
        if is_full:
            i, j = triangle_indices(len(penalty_root))
            matrices.append((columns, penalty_unit / (penalty_root[i] * penalty_root[j])))
            matrix_orders.append(len(penalty_root))
        else:
            scalars.append((columns, penalty_unit / penalty_root**2))
    parameter_columns = np.concatenate([columns for columns, _ in scalars + matrices])
    units = np.concatenate([units for _, units in scalars + matrices])
    scalar_count = sum(len(columns) for columns, _ in scalars)
    return Formulation(
        squares=LeastSquares((regressor / reading_norm)[:, parameter_columns] * units, z / reading_norm),
        cone=Cone(scalar_count, tuple(matrix_orders), penalised=scalar_count - len(joints)),
        columns=parameter_columns,
        unit=units,
        rows=rows,
        size=reading_norm,
        sigma=sigma,
    )


def _scale_penalty(rows: ElasticRows, reading_norm: float) -> tuple[float, FloatArray]:
    """Return the unit of compliance u [m/N] and the levers ρ (n + 1,) [m] that scale the penalty.

    u is the root mean square deflection divided by the root mean square force. A moment is converted to the
    force that causes this moment on the levers of the joints.

    Args:
        rows: compressed rows of the observations.
        reading_norm: norm of the whitened readings [m]; zero if no target moved.

    Raises:
        UnsupportedMethodError: no target moved, or no load has a lever arm.
    """
    lever_arms = np.sqrt(rows.lever / rows.configurations)
    lever_arms = np.maximum(lever_arms, _SHORTEST_LEVER * lever_arms[:BASE].max())
    # Sum of the squared forces; 1.5 / lever² converts a squared moment to the squared force on a lever with
    # a direction at random. If the load point lies in the origin of every joint's frame, all levers are zero,
    # and no force is computed.
    squared_force = (
        rows.force + rows.moment * float(np.mean(1.5 / lever_arms[:BASE] ** 2)) if lever_arms.all() else 0.0
    )
    if reading_norm == 0.0 or squared_force == 0.0:
        raise UnsupportedMethodError(
            "no target moved, or no load has a lever arm, so the penalty on link compliance has no scale",
            where="elasticity",
            remedy="use elasticity joints",
        )
    return float(np.sqrt(rows.deflection / rows.targets / (squared_force / rows.configurations))), lever_arms


def list_losses_to_compare(measurements: Measurements, losses: tuple[Loss, ...]) -> tuple[Loss, ...]:
    """Return those of `losses` that a set supports.

    Only `squared` is supported for more than `MOST_TARGETS` targets, for encoders, and for readings along a
    direction, whose residuals have no length.

    Raises:
        UnsupportedMethodError: the set does not support the loss, and `losses` does not contain `squared`.
    """
    targets = int(measurements.present.sum())
    of_lengths = measurements.encoders is None and measurements.direction is None
    if targets <= MOST_TARGETS and of_lengths:
        return losses
    if "squared" in losses:
        return ("squared",)
    if not of_lengths:
        raise UnsupportedMethodError(
            f"the loss {losses[0]} needs the length of each residual; encoder readings and readings along a "
            "direction have none",
            where="loss",
            remedy="use loss squared",
        )
    raise UnsupportedMethodError(
        f"{targets} targets were read, but the loss {losses[0]} of elastic links supports at most "
        f"{MOST_TARGETS} targets",
        where="loss",
        remedy="use loss squared, or leave observations out",
    )
