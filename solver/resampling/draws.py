"""Resampling: fit m of the N configurations drawn at random, R times (method.md §6; paper: 10 of 19).

How far the estimates of different draws lie apart shows what the choice of configurations decides. All
repetitions are fitted together, tile by tile, from `GramBlocks`; those that a Gram matrix cannot answer
go back to the rows. Repetition r has the same numbers to the last bit whichever range of repetitions it
is computed in, so that any number of workers may share them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, Support
from jointstiff.solver.convex.batch import exactly_at_bounds, solve_batch
from jointstiff.solver.convex.problem import Bounds, IdentificationProblem
from jointstiff.solver.convex.solution import solve_step
from jointstiff.solver.errors import RequestError
from jointstiff.solver.observability import NULL_COLUMN, Spectrum, analyse
from jointstiff.solver.resampling.blocks import GramBlocks, StageBlocks
from jointstiff.solver.triangle import triangle_of

MAX_REPETITIONS = 100_000
MAX_SEED = 2**63 - 1

TILE = 1024
"""Number of repetitions per block."""
_TILE_WEIGHTS = 2**22
"""Maximum number of weights per block, 32 MB, however many configurations there are."""
_CACHED_NUMBERS = 2**16
"""Random numbers per block, 512 kB: they stay in a processor's own cache, so that workers do not wait for
each other's memory."""


@dataclass(frozen=True)
class ResamplingPlan:
    """Size, number and seed of the draws.

    With u the table ``np.random.default_rng(seed).random((repetitions, N))``, repetition r draws the
    configurations at the m least numbers of row r; with replacement it draws ⌊N u⌋ of the first m.

    Raises:
        RequestError: a number out of range, naming it.
    """

    size: int  #: m, configurations in a draw
    repetitions: int  #: R, how many draws
    seed: int  #: seed of the draws
    replacement: bool = False  #: whether a configuration may come more than once in a draw (bootstrap)

    def __post_init__(self) -> None:
        _refuse_outside("size", self.size, 1, None)
        _refuse_outside("repetitions", self.repetitions, 1, MAX_REPETITIONS)
        _refuse_outside("seed", self.seed, 0, MAX_SEED)

    def draw(self, configurations: int, start: int, stop: int) -> IndexArray:
        """The configurations of some of the repetitions.

        Args:
            configurations: N, from which to draw.
            start: first repetition.
            stop: one past the last.

        Returns:
            (stop − start, m) indices of configurations.

        Raises:
            RequestError: if m exceeds N, or there are no such repetitions.
        """
        _refuse_outside("size", self.size, 1, configurations)
        if not 0 <= start <= stop <= self.repetitions:
            raise RequestError(
                f"the repetitions {start} to {stop} are outside the plan of {self.repetitions}",
                where="resampling.repetitions",
                remedy="ask for a range within the plan",
            )
        # One number of the generator makes one of the table, so a row is reached without those above.
        generator = np.random.Generator(np.random.PCG64(self.seed).advance(start * configurations))
        drawn = np.empty((stop - start, self.size), dtype=np.intp)
        rows = max(1, _CACHED_NUMBERS // configurations)
        for first in range(0, len(drawn), rows):
            part = drawn[first : first + rows]
            table = generator.random((len(part), configurations))
            if self.replacement:
                part[:] = table[:, : self.size] * configurations
            else:
                part[:] = np.argpartition(table, self.size - 1, axis=1)[:, : self.size]
        return drawn


@dataclass(frozen=True, eq=False)
class Resamples:
    """Estimates of K repetitions.

    A joint has no number, but NaN, where it leaves no trace in what was drawn, where it shows there only
    in combination with others, or where the deflection of such joints cannot be told from its own.
    """

    compliance: FloatArray  #: (K, n) optimum [rad/(N·m)]; NaN where undetermined
    active: Support  #: (K, n) -1 or 1 at a lower or upper bound, else 0
    #: (K,) ``1 − mean‖δp − δp̂‖ / mean‖δp‖`` over all N configurations, drawn or not; NaN where a joint
    #: that they show is undetermined
    compensation: FloatArray

    @property
    def undetermined(self) -> BoolArray:
        """(K, n) joints of which a draw says nothing."""
        return np.isnan(self.compliance)

    @classmethod
    def concatenate(cls, parts: Sequence[Resamples]) -> Resamples:
        """Join parts, at least one, in the given order."""
        return cls(
            np.concatenate([part.compliance for part in parts]),
            np.concatenate([part.active for part in parts]),
            np.concatenate([part.compensation for part in parts]),
        )


def resample(
    blocks: GramBlocks, plan: ResamplingPlan, bounds: Bounds, start: int = 0, stop: int | None = None
) -> Resamples:
    """Fit the repetitions from start to stop.

    Args:
        blocks: of the method, weighting and measurement set.
        plan: what is drawn.
        bounds: on all n compliances.
        start: first repetition.
        stop: one past the last; all to the end if None.

    Returns:
        Their estimates, each certified, in order.

    Raises:
        RequestError: if the plan does not suit the measurement set.
        SolverError: if optimality of an estimate could not be certified.
    """
    stop = plan.repetitions if stop is None else stop
    step = max(1, min(TILE, _TILE_WEIGHTS // len(blocks)))
    starts = range(start, stop, step) or [start]
    draws = (plan.draw(len(blocks), first, min(first + step, stop)) for first in starts)
    parts = []
    for drawn in draws:
        compliance, active = fit_subsets(blocks, _counts(drawn, len(blocks)), bounds)
        parts.append(Resamples(compliance, active, blocks.compensation(compliance)))
    return Resamples.concatenate(parts)


def fit_subsets(blocks: GramBlocks, weights: FloatArray, bounds: Bounds) -> tuple[FloatArray, Support]:
    """Fit subsets of the configurations, stage by stage.

    Args:
        blocks: of the method, weighting and measurement set.
        weights: (K, N) how often each configuration counts in each subset.
        bounds: on all n compliances.

    Returns:
        (K, n) compliances [rad/(N·m)], NaN where undetermined, and the bounds that hold them.

    Raises:
        SolverError: if optimality of an estimate could not be certified.
    """
    compliance = np.full((len(weights), blocks.parameters), np.nan)
    active = np.zeros(compliance.shape, dtype=np.int8)
    for stage in blocks.stages:
        known = compliance[:, stage.known]
        solved = _solve_stage(stage, weights, known, bounds.select(stage.joints))
        compliance[:, stage.joints], active[:, stage.joints] = solved
    return compliance, active


def _solve_stage(
    stage: StageBlocks, weights: FloatArray, known: FloatArray, bounds: Bounds
) -> tuple[FloatArray, Support]:
    """Compliances (K, p) of a stage's joints, given those that are known (K, q) [rad/(N·m)].

    ``h = A_jᵀ d − A_jᵀ A_k c_k``, with A_j the columns of the joints and A_k those of the known ones.
    """
    p = len(stage.joints)
    unit, offset = stage.unit[:p], known / stage.unit[p:]
    box = Bounds(bounds.lower / unit, bounds.upper / unit)
    total = stage.total(weights)
    gram = total[:, :p, :p]
    moment = total[:, :p, -1] - (total[:, :p, p:-1] * offset[:, None, :]).sum(axis=2)
    seen = (np.diagonal(gram, axis1=1, axis2=2) > NULL_COLUMN**2).all(axis=1)
    fit = np.flatnonzero(seen & np.isfinite(offset).all(axis=1))
    solution = solve_batch(gram[fit], moment[fit], box)
    x, active = np.full(moment.shape, np.nan), np.zeros(moment.shape, dtype=np.int8)
    x[fit], active[fit] = solution.compliance, solution.active
    pending = np.ones(len(weights), dtype=np.bool_)
    pending[fit] = ~solution.certified
    for k in np.flatnonzero(pending):
        drawn = np.repeat(np.arange(weights.shape[1]), weights[k].astype(np.intp))
        x[k], active[k] = _solve_rows(stage, drawn, offset[k], box)
    return exactly_at_bounds(x * unit, active, bounds), active


def _solve_rows(
    stage: StageBlocks, drawn: IndexArray, offset: FloatArray, box: Bounds
) -> tuple[FloatArray, Support]:
    """One repetition from its rows, as `solver.fitting.methods` would: QR, rank, `solve_step`.

    Returns:
        (p,) scaled parameters, NaN where undetermined, and (p,) their bounds.
    """
    p = len(stage.joints)
    x, active = np.full(p, np.nan), np.zeros(p, dtype=np.int8)
    triangle = triangle_of(stage.rows[drawn].reshape(-1, stage.rows.shape[2]))
    null = np.linalg.norm(triangle, axis=0) <= NULL_COLUMN
    # What is not known of an earlier joint does no harm where that joint leaves no trace, either.
    offset = np.where(null[p:-1] & np.isnan(offset), 0.0, offset)
    columns = np.flatnonzero(~null[:p])
    if np.isnan(offset).any() or not len(columns):
        return x, active
    R, z = triangle[:, columns], triangle[:, -1] - triangle[:, p:-1] @ offset
    spectrum = Spectrum(R)
    solution = solve_step(IdentificationProblem(spectrum.determined, z, box.select(columns)))
    combined = np.isin(columns, list(analyse(spectrum, columns, p).combined))
    x[columns] = np.where(combined, np.nan, solution.compliance)
    active[columns] = np.where(combined, 0, solution.active)
    return x, active


def _counts(drawn: IndexArray, configurations: int) -> FloatArray:
    """(K, N) how often each configuration was drawn."""
    flat = (np.arange(len(drawn))[:, None] * configurations + drawn).ravel()
    counts = np.bincount(flat, minlength=len(drawn) * configurations)
    return counts.reshape(len(drawn), configurations).astype(np.float64)


def _refuse_outside(name: str, value: int, least: int, most: int | None) -> None:
    if value < least or (most is not None and value > most):
        limits = f"at least {least}" if most is None else f"from {least} to {most:,}"
        raise RequestError(
            f"{name} is {value:,}", where=f"resampling.{name}", remedy=f"give a number {limits}"
        )
