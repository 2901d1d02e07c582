"""Models of what bends, from simple to rich: rows, penalty, losses, and their optima (method.md §7).

    squared    ‖z − R x‖² / ‖z‖² + λ tr              rows compressed to a triangle
    absolute   Σ ‖r_i‖ / Σ ‖d_i‖ + λ tr              one second-order cone a target
    huber      Σ ρ(r_i) / Σ ‖d_i‖ + λ tr             ρ = ‖r‖²/(2h) up to h, ‖r‖ − h/2 beyond

The penalty has no length that anyone chose. It is the work that a unit force at the load point does on an
element: averaged over the force's direction and, as the fitted postures are few, over all directions of the
lever, whose length ρ_i (root mean square from the frame's origin to the load point) the fitted postures give.
For a link that is ``tr(M_i C_i)`` with ``M_i = diag(I, 2/3 ρ_i² I)``, for coupled joints the same with
``M = diag(2/3 ρ_j²)``. In ``X = K C K / u``, K² = M, it is a plain trace, and with u the deflection over the
force it has no unit either.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.schemas.options import Loss, RunOptions
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.estimation.cones import Cone, find_diagonal_entries
from jointstiff.solver.estimation.conic import (
    ConeSolution,
    LeastSquares,
    NormSum,
    RobustProgram,
    SemidefiniteProgram,
    certify_cone,
    certify_robust,
    solve_cone,
    solve_robust,
)
from jointstiff.solver.estimation.fit import MEDIAN_NORM
from jointstiff.solver.estimation.method import DEFAULT_THRESHOLD
from jointstiff.solver.estimation.problem import Bounds, IdentificationProblem
from jointstiff.solver.estimation.solution import solve_step
from jointstiff.solver.estimation.triangle import Triangle, compute_triangular_factor
from jointstiff.solver.mechanics.block import RegressorBlock, Term, build_rows, regressor_blocks
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
"""Maximum number of joints of a robot with elastic links: beyond, unknowns exceed readings."""

MOST_TARGETS: Final = 500
"""Targets up to which robust losses are supported: a program takes about 0.5 s there."""
_BLOCK = 256
"""Observations per block: their rows stay below 10 MB a target."""


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
        """Number P of columns."""
        return self.n + len(self.coupling) + 21 * len(self.frames)

    @property
    def frames(self) -> tuple[int, ...]:
        """Return the frames with a compliance of 21 entries: joint indices of the links, then `BASE`."""
        return *self.links, BASE

    @property
    def joints(self) -> IndexArray:
        """(n,) columns of the joint compliances c [m/(rad/(N·m))]."""
        return np.arange(self.n)

    @property
    def coupling(self) -> IndexArray:
        """(n (n + 1) / 2,) columns of the full joint compliance C_θ [m/(rad/(N·m))]."""
        return np.arange(self.n, self.n + self.n * (self.n + 1) // 2)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Return the terms of all columns, in their order."""
        return JOINTS, COUPLED_JOINTS, build_links_term(self.frames)

    def link(self, frame: int) -> IndexArray:
        """(21,) columns of the compliance C_i of the link behind a joint, or of the `BASE`."""
        start = self.n + len(self.coupling) + 21 * self.frames.index(frame)
        return np.arange(start, start + 21)


@dataclass(frozen=True, eq=False)
class ElasticRows:
    """Compressed rows of some observations, and the sums that determine the scale of the penalty."""

    #: (P + 1, P + 1) with ``TᵀT`` the Gram matrix of the rows [A d], whitened in units of sigma
    triangle: FloatArray
    configurations: int  #: number of observations
    readings: int  #: coordinates that were read
    targets: int  #: targets that were read
    force: float  #: sum of ‖F‖² [N²]
    moment: float  #: sum of ‖M‖² [N²·m²]
    #: (n + 1,) sum of the squared distances of the load point from the frames' origins, the base's last [m²]
    lever: FloatArray
    deflection: float  #: sum of ‖δp‖² [m²]

    #: (K, 3, P + 1) rows of each target, which a robust loss needs; K = 0 for more than `MOST_TARGETS`
    each: FloatArray

    @classmethod
    def merge(cls, parts: Sequence[ElasticRows]) -> ElasticRows:
        """Merge the rows of several parts of a set; only sums are taken, so that no digits are lost."""
        summed = (f.name for f in fields(cls) if f.name not in {"triangle", "each"})
        sums = {name: sum(getattr(part, name) for part in parts) for name in summed}
        each = np.concatenate([part.each for part in parts])
        each = each if sums["targets"] <= MOST_TARGETS else each[:0]
        triangle = compute_triangular_factor(np.concatenate([part.triangle for part in parts]))
        return cls(triangle=triangle, each=each, **sums)

    def residual_norms(self, compliances: FloatArray) -> FloatArray:
        """Return the norms (K,) [m] of each target's whitened residual at compliances (P,)."""
        residuals = self.each[..., :-1] @ compliances - self.each[..., -1]
        return np.asarray(np.linalg.norm(residuals, axis=1))

    def weight_targets(self, weight: FloatArray) -> ElasticRows:
        """Return rows whose triangle weights the K targets by `weight` (K,); `each` stays unweighted."""
        rows = np.sqrt(weight)[:, None, None] * self.each
        return replace(self, triangle=compute_triangular_factor(rows.reshape(-1, rows.shape[-1])))


def elastic_rows(
    robot: Robot, measurements: Measurements, columns: ElasticColumns, parts: Sequence[IndexArray]
) -> tuple[ElasticRows, ...]:
    """Compress the rows of each of several parts of a measurement set, in one pass with little memory.

    Args:
        robot: n joints.
        measurements: N observations.
        columns: columns of the richest model.
        parts: ascending indices of the observations of each part.

    Raises:
        MeasurementError: a covariance is not positive definite.
    """
    triangles = [Triangle(entries=columns.width) for _ in parts]
    levers, each = np.zeros((len(parts), robot.n + 1)), [[np.zeros((0, 3, columns.width + 1))] for _ in parts]
    few = [int(measurements.present[part].sum()) <= MOST_TARGETS for part in parts]
    start = 0
    for block, rows in elastic_blocks(robot, measurements, columns):
        present, in_sigma = block.measurements.present, block.whiten(rows)
        lever = np.square(block.frames[2]).sum(axis=2)
        for k, part in enumerate(parts):
            own = select_rows_of_part(part, start, start + len(present))
            triangles[k].add(in_sigma[own], count=3 * int(present[own].sum()))
            if few[k]:
                each[k].append(in_sigma[own][present[own]])
            levers[k] += lever[own].sum(axis=0)
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
            each=np.concatenate(listed),
        )
        for part, triangle, lever, listed in zip(parts, triangles, levers, each, strict=True)
    )


def select_rows_of_part(part: IndexArray, start: int, stop: int) -> IndexArray:
    """Return the rows of a part of the set within a block.

    The part holds ascending indices of observations; the block has the observations from start to stop. Rows
    count from the start of the block.
    """
    first, last = np.searchsorted(part, [start, stop])
    return np.asarray(part[first:last] - start)


def elastic_blocks(
    robot: Robot, measurements: Measurements, columns: ElasticColumns
) -> Iterator[tuple[RegressorBlock, FloatArray]]:
    """Yield blocks of observations, each with rows (B, T, 3, P + 1): columns of the model, then readings."""
    for start in range(0, len(measurements), _BLOCK):
        for block in regressor_blocks(robot, measurements[start : start + _BLOCK]):
            yield block, build_rows(block, columns.terms, np.zeros(robot.n)).targets


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


LOSSES: Final[tuple[Loss, ...]] = ("squared", "huber", "absolute")
"""Losses of the norm of each target's residual."""

_LEAST_SCALE: Final = 1e-6
"""Least robust scale relative to the mean deflection: for exact readings the scale would be zero."""
_LEAST_WEIGHT: Final = 1e-9
"""Least weight of the penalty in a least-squares problem."""
_SHORTEST_LEVER: Final = 1e-2
"""Least lever relative to the longest: a shorter one, through the load point, would leave rotations
unpenalised."""
_BASE_ROOT: Final = 0.3
"""Root of the base's penalty relative to a link's: all readings see this one element, so that they need
hardly any, and λ for links would take 5 % off a pedestal."""
_NO_COLUMN: Final = 1e-9
"""Least joint column relative to the largest: a smaller one is rounding, and its joint gets no number."""


@dataclass(frozen=True)
class ElasticModel:
    """Elements that deflect, and the loss by which their compliances are fitted."""

    #: elastic elements besides the joints, whose compliances are zero or positive: `coupled_joints` a
    #: full positive semidefinite joint compliance, `diagonal_links` six compliances a link,
    #: `joints_and_links` a full positive semidefinite 6 × 6 compliance a link, `joints_and_base` one of the
    #: base, `links_and_base` both
    name: ModelName
    columns: ElasticColumns  #: columns of the richest model; its links are those that bend here
    #: loss of the norm of each target's whitened residual: its square, Huber's, or the norm itself
    loss: Loss = "squared"
    threshold: float = DEFAULT_THRESHOLD  #: threshold of Huber's loss, in units of sigma

    @property
    def key(self) -> tuple[ModelName, Loss]:
        """Return the pair of name and loss, which identifies the model within a run."""
        return self.name, self.loss

    def elements(
        self, determined: BoolArray, lever: FloatArray
    ) -> Iterator[tuple[IndexArray, FloatArray, bool]]:
        """Yield the penalised elements: columns, diagonal of K, and whether the compliance is a full matrix.

        The penalty of an element with compliance C is the trace of K C K, K diagonal.

        Args:
            determined: (n,) mask of the joints whose compliance is determined.
            lever: (n + 1,) lever ρ of the load about each joint's frame and the base [m].
        """
        turning = np.sqrt(2.0 / 3.0) * lever
        if self.name == "coupled_joints":
            rows, columns = triangle_indices(self.columns.n)
            yield (
                self.columns.coupling[determined[rows] & determined[columns]],
                turning[:BASE][determined],
                True,
            )
        for frame in self.frames:
            full = self.name != "diagonal_links"
            own = self.columns.link(frame)
            root = np.repeat([1.0, turning[frame]], 3) * (_BASE_ROOT if frame == BASE else 1.0)
            yield own if full else own[find_diagonal_entries(6)], root, full

    @property
    def frames(self) -> tuple[int, ...]:
        """Return the frames of the links and base that bend: joint indices of the links, then `BASE`."""
        links = () if self.name in {"joints", "coupled_joints", "joints_and_base"} else self.columns.links
        return (*links, BASE) if self.name in WITH_BASE else links


@dataclass(frozen=True, eq=False)
class Formulation:
    """Optimisation problem of a model on some observations, for any weight of the penalty."""

    squares: LeastSquares  #: quadratic part, in the program's parameters
    cone: Cone  #: cone of the parameters
    columns: IndexArray  #: (p,) column of each parameter
    unit: FloatArray  #: (p,) unit of each parameter: compliances are ``unit · x``
    rows: ElasticRows  #: rows of the observations
    size: float  #: ‖z‖, by which the readings are divided, in units of the whitened readings [m]
    sigma: float | None  #: sigma of one coordinate of one reading, if it is stated [m]
    #: fits with the absolute loss, kept for reuse; keys are weight, gap and accepted gap
    _absolute: dict[tuple[float, float, float | None], ConeSolution] = field(default_factory=dict)

    @property
    def width(self) -> int:
        """Number P of columns."""
        return len(self.rows.triangle[0]) - 1

    @cached_property
    def total(self) -> float:
        """Sum of the lengths of the targets' readings [m], the unit of robust losses."""
        return float(np.linalg.norm(self.rows.each[..., -1], axis=1).sum())

    @cached_property
    def _norms(self) -> NormSum:
        """Sum of the norms of the targets' residuals, the same for all robust losses and penalties."""
        A = self.rows.each[..., self.columns] * (self.unit / self.total)
        return NormSum(A, self.rows.each[..., -1] / self.total, self.cone)

    def program(self, weight: float) -> SemidefiniteProgram:
        """Return the program of the squared loss for a weight λ of the penalty."""
        return SemidefiniteProgram(self.squares, self.cone, weight)

    def build_robust_program(self, weight: float, threshold: float) -> RobustProgram:
        """Return the program of a robust loss for a weight λ and a threshold h [m]."""
        return RobustProgram(self._norms, weight, threshold / self.total)

    def fit_absolute(self, weight: float, gap: float, accepted: float | None = None) -> ConeSolution:
        """Return the fit with the absolute loss, computed once for each combination of arguments.

        Args:
            weight: λ > 0 of the penalty.
            gap: gap of the certificate that ends the search.
            accepted: greatest gap that is accepted; `gap` if None.
        """
        key = weight, gap, accepted
        if key not in self._absolute:
            self._absolute[key] = solve_robust(
                self.build_robust_program(weight, 0.0), gap=gap, accepted=accepted
            )
        return self._absolute[key]

    def compliances(self, x: FloatArray) -> FloatArray:
        """Return compliances (..., P) of parameters (..., p); zero in columns without a parameter."""
        out = np.zeros((*x.shape[:-1], self.width))
        out[..., self.columns] = self.unit * x
        return out

    def unit_of_gaps(self, model: ElasticModel) -> float:
        """Return the factor [m] that converts a certificate's gap to a length.

        With squares, the length is ‖R (x − x̂)‖, how far the fitted readings are from those at the optimum;
        with robust losses, it is the excess of the mean norm of a target's residual.
        """
        if model.loss == "squared":
            return self.size
        return self.total / self.rows.targets

    def fit(
        self, model: ElasticModel, weight: float, *, gap: float, accepted: float | None = None
    ) -> tuple[ConeSolution, float]:
        """Fit the parameters with the model's loss, and certify the optimum.

        The threshold of Huber's loss is in units of sigma; if sigma is unknown, in units of the robust scale
        of the residuals of a fit with the absolute loss.

        Args:
            model: what bends, and the loss.
            weight: λ > 0 of the penalty.
            gap: gap of the certificate that ends the search, in units of `unit_of_gaps`.
            accepted: greatest gap that is accepted; `gap` if None.

        Returns:
            Parameters (p,) with their certificate, and the threshold h [m] of Huber's loss: 0 for the
            absolute loss, inf for squares.

        Raises:
            SolverError: no optimum is certified within the accepted gap.
        """
        if model.loss == "squared":
            return solve_cone(self.program(weight), gap=gap, accepted=accepted), float("inf")
        if model.loss == "absolute":
            return self.fit_absolute(weight, gap, accepted), 0.0
        scale = self.sigma
        if scale is None:
            scale = self._robust_scale(self.compliances(self.fit_absolute(weight, gap).x))
        threshold = model.threshold * scale
        return solve_robust(
            self.build_robust_program(weight, threshold), gap=gap, accepted=accepted
        ), threshold

    def certify_gap(
        self,
        model: ElasticModel,
        compliances: FloatArray,
        weight: float,
        solution: ConeSolution,
        threshold: float,
    ) -> float:
        """Return the certificate's gap at compliances (P,) close to a fit, in units of `unit_of_gaps`."""
        x = compliances[self.columns] / self.unit
        if model.loss == "squared":
            return certify_cone(self.program(weight), x).gap
        program = self.build_robust_program(weight, threshold)
        return certify_robust(program, x, solution.certificate.multipliers).gap

    def fit_joints_only(self) -> FloatArray:
        """Return the exact least-squares parameters (p,) of a model of joints alone, which has no penalty."""
        R, z = self.squares.R, self.squares.z
        problem = IdentificationProblem(R, z, Bounds.positive(R.shape[1]))
        return solve_step(problem).compliance

    def _robust_scale(self, compliances: FloatArray) -> float:
        """Return the robust standard deviation [m] of the residuals at compliances (P,), by their median."""
        norms = self.rows.residual_norms(compliances)
        least = _LEAST_SCALE * self.total / max(1, len(norms))
        return max(float(np.median(norms)) / MEDIAN_NORM, least)

    def companion(
        self, model: ElasticModel, compliances: FloatArray, weight: float, threshold: float
    ) -> tuple[Formulation, float]:
        """Return a weighted least-squares problem with the optimum of a fit, and its penalty's weight.

        A target whose residual r exceeds the threshold h has weight h/‖r‖: these squares are stationary where
        Huber's loss is. For the absolute loss, h is the threshold times the robust scale of the residuals,
        and the optimum is only nearly the same.

        Args:
            model: what bends, and the loss.
            compliances: (P,) of the fit.
            weight: λ of the fit.
            threshold: h of the fit [m].
        """
        if model.loss == "squared":
            return self, weight
        if threshold == 0.0:
            threshold = model.threshold * max(self._robust_scale(compliances), self.sigma or 0.0)
        norms = self.rows.residual_norms(compliances)
        weighted = self.rows.weight_targets(threshold / np.maximum(norms, threshold))
        determined = np.isin(np.arange(model.columns.n), self.columns)
        squares = formulate(weighted, model, determined, self.sigma)
        return squares, 2.0 * self.total * threshold * weight / squares.size**2

    def weight_of_squares(self, model: ElasticModel, compliances: FloatArray, weight: float) -> float:
        """Return the penalty's weight for plain squares that is as strong as λ is in a robust fit.

        The gradient of the absolute loss has the direction of a residual only, that of squares also its
        length, so that the weight scales with the mean length of the residuals.

        Args:
            model: what bends, and the loss.
            compliances: (P,) of the fit.
            weight: λ of the fit.
        """
        if model.loss == "squared":
            return weight
        length = float(self.rows.residual_norms(compliances).mean())
        return max(2.0 * self.total * length * weight / self.size**2, _LEAST_WEIGHT)


def formulate(
    rows: ElasticRows, model: ElasticModel, visible: BoolArray, sigma: float | None = None
) -> Formulation:
    """Formulate the fit of a model to some observations as an optimisation problem.

    Args:
        rows: compressed rows of the observations.
        model: what bends.
        visible: (n,) mask of the joints whose compliances the readings determine.
        sigma: stated standard uncertainty of one coordinate of one reading [m]; None if unknown.

    Raises:
        UnsupportedMethodError: no target moved, or no load acts, so that the penalty has no scale.
    """
    triangle, z = rows.triangle[:, :-1], rows.triangle[:, -1]
    size = float(np.linalg.norm(z))
    norms = np.linalg.norm(triangle[:, model.columns.joints], axis=0)
    determined = visible & (norms > _NO_COLUMN * norms.max())
    joints = np.flatnonzero(determined)
    scale, lever = _scale_penalty(rows, size)
    scalars, blocks, sizes = [(joints, size / norms[joints])], [], []
    for columns, root, full in model.elements(determined, lever):
        if full:
            i, j = triangle_indices(len(root))
            blocks.append((columns, scale / (root[i] * root[j])))
            sizes.append(len(root))
        else:
            scalars.append((columns, scale / root**2))
    of_parameters = np.concatenate([columns for columns, _ in scalars + blocks])
    unit = np.concatenate([unit for _, unit in scalars + blocks])
    count = sum(len(columns) for columns, _ in scalars)
    return Formulation(
        squares=LeastSquares((triangle / size)[:, of_parameters] * unit, z / size),
        cone=Cone(count, tuple(sizes), penalised=count - len(joints)),
        columns=of_parameters,
        unit=unit,
        rows=rows,
        size=size,
        sigma=sigma,
    )


def _scale_penalty(rows: ElasticRows, size: float) -> tuple[float, FloatArray]:
    """Return the unit of compliance u [m/N] and the levers ρ (n + 1,) [m] that scale the penalty.

    u is the root mean square deflection over the root mean square force. A moment counts as the force that
    makes such a moment on the levers of the joints.

    Raises:
        UnsupportedMethodError: nothing moved, or no load has a lever arm.
    """
    lever = np.sqrt(rows.lever / rows.configurations)
    lever = np.maximum(lever, _SHORTEST_LEVER * lever[:BASE].max())
    force = rows.force + rows.moment * float(np.mean(1.5 / lever[:BASE] ** 2)) if lever.all() else 0.0
    if size == 0.0 or force == 0.0:
        raise UnsupportedMethodError(
            "nothing moved, or no load has a lever arm, so the penalty on link compliance has no scale",
            where="elasticity",
            remedy="use elasticity joints",
        )
    return float(np.sqrt(rows.deflection / rows.targets / (force / rows.configurations))), lever


def list_losses_to_compare(measurements: Measurements, losses: tuple[Loss, ...]) -> tuple[Loss, ...]:
    """Return the losses that a set supports: only `squared` if it has more than `MOST_TARGETS` targets.

    Raises:
        UnsupportedMethodError: the set supports none of the losses.
    """
    targets = int(measurements.present.sum())
    if targets <= MOST_TARGETS:
        return losses
    if "squared" in losses:
        return ("squared",)
    raise UnsupportedMethodError(
        f"{targets} targets were read, and loss {losses[0]} of elastic links supports at most {MOST_TARGETS}",
        where="loss",
        remedy="use loss squared, or leave observations out",
    )
