"""Resampling: fit m of the N configurations drawn at random, R times (method.md §6; paper: 10 of 19).

How far the estimates of different draws lie apart shows what the choice of configurations decides. The
least-squares problem of some of the configurations is a sum over them (method.md §5): with the weighted rows
M_i = [A_i d_i] of configuration i and its weight w_i (how often it was drawn), ``Σ w_i M_iᵀ M_i`` holds all
that the fit takes from the readings. So all repetitions are fitted together, tile by tile; those that a Gram
matrix cannot answer go back to the rows. Repetition r has the same numbers to the last bit whichever range of
repetitions it is computed in, so that any number of workers may share them: sums over configurations and
joints are left to einsum: BLAS groups them by the size of the matrix and the number of threads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.options import Resampling
from jointstiff.schemas.run import ResampledJoint, ResamplingResult
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError, UnsupportedMethodError
from jointstiff.solver.estimation.estimate import Estimate
from jointstiff.solver.estimation.identify import refuse_unsupported
from jointstiff.solver.estimation.joints import JointsAlone
from jointstiff.solver.estimation.method import Method, Settings
from jointstiff.solver.estimation.observability import NULL_COLUMN, Excitation, Spectrum, analyse
from jointstiff.solver.estimation.problem import Bounds, IdentificationProblem
from jointstiff.solver.estimation.solution import solve_batch, solve_step
from jointstiff.solver.estimation.stack import Stack
from jointstiff.solver.mechanics.block import regressor_blocks, whitened_rows
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.messages import rows

TILE_RESIDUALS = 2**17
"""Maximum number of residuals per block, 1 MB: they stay in the cache."""
TILE = 1024
"""Number of repetitions per block."""
_TILE_WEIGHTS = 2**22
"""Maximum number of weights per block, 32 MB, however many configurations there are."""


@dataclass(frozen=True, eq=False)
class StageStack:
    """One least-squares problem of a method, configuration by configuration.

    Columns are divided by their norms over the full set, so that no square under- or overflows, and a
    diagonal entry of a sum of Gram matrices is the share of the full set's information on that column.
    """

    joints: IndexArray  #: (p,) the joints that it estimates
    known: IndexArray  #: (q,) joints that an earlier stage has estimated; their deflection is subtracted
    stack: Stack  #: N configurations, p + q columns of unit length
    unit: FloatArray  #: (p + q,) unit of the scaled parameters x, ``c = unit · x`` [rad/(N·m)]

    def total(self, weights: FloatArray) -> FloatArray:
        """``Σ_i w_ki M_iᵀM_i`` (K, p + q + 1, p + q + 1) for the weights (K, N)."""
        return np.asarray(np.einsum("kn,nij->kij", weights, self.stack.grams))


@dataclass(frozen=True, eq=False)
class MethodStacks:
    """A method on a measurement set, ready to be fitted to any of its N configurations."""

    parameters: int  #: n, number of joints
    stages: tuple[StageStack, ...]  #: stages of the method, in the order in which they are solved
    visible: IndexArray  #: (v,) the joints that leave a trace in the full set
    #: (v, 3, M) regressor of the M readings of all targets in all configurations, axes of R0 [m/(rad/(N·m))];
    #: compensation is judged on these whatever a method fits
    regressor: FloatArray
    deflection: FloatArray  #: (3, M) deflection of the same readings, axes of R0 [m]

    def __len__(self) -> int:
        return len(self.stages[0].stack)

    def compensation(self, compliance: FloatArray) -> FloatArray:
        """``1 − mean‖δp − δp̂‖ / mean‖δp‖`` over all readings (method.md §6).

        Args:
            compliance: (K, n) [rad/(N·m)].

        Returns:
            (K,) dimensionless; NaN where a visible joint has no number.
        """
        moved = np.linalg.norm(self.deflection, axis=0).mean()
        left = np.empty(len(compliance))
        step = max(1, TILE_RESIDUALS // self.deflection.size)
        for first in range(0, len(left), step):
            part = compliance[first : first + step, self.visible]
            residual = self.deflection - np.einsum("kv,vim->kim", part, self.regressor)
            left[first : first + step] = np.sqrt(np.square(residual).sum(axis=1)).mean(axis=1)
        shares: FloatArray = 1.0 - left / moved
        return shares


def method_stacks(
    robot: Robot, measurements: Measurements, settings: Settings, estimate: Estimate
) -> MethodStacks:
    """Compute the blocks of a method on a set that was identified by it.

    Args:
        robot: n joints.
        measurements: N observations.
        settings: method, weighting and K_c; all else plays no part.
        estimate: of the full set: its characteristic length, if the weighting uses one, and the compliances
            that bend the robot, so that the rows are linear.
    """
    method = Method(robot, settings, estimate.characteristic_length)
    excitation = Excitation(robot.joint_kinds)
    fitted, regressors, deflections = [], [], []
    for block in regressor_blocks(robot, measurements, estimate.balanced):
        excitation.add(block)
        whitened = whitened_rows(block, [JOINTS], estimate.compliance)
        fitted.append([rows.fitted for rows in method.rows(block, whitened)])
        present = block.measurements.present
        regressors.append(block.A[present])
        deflections.append(block.measurements.deflection[present])
    seen = ~excitation.observability().null
    visible = np.flatnonzero(seen)
    stages = (
        _stage_stack(np.concatenate(rows), stage.joints[seen[stage.joints]], stage.known[seen[stage.known]])
        for stage, rows in zip(method.stages, zip(*fitted, strict=True), strict=True)
        if seen[stage.joints].any()
    )
    return MethodStacks(
        parameters=robot.n,
        stages=tuple(stages),
        visible=visible,
        regressor=np.ascontiguousarray(np.concatenate(regressors).transpose(2, 1, 0)[visible]),
        deflection=np.ascontiguousarray(np.concatenate(deflections).T),
    )


STEP_SECONDS: Final = 0.25
_SECONDS_A_REPETITION: Final = 8e-6
_SECONDS_A_READING: Final = 2.5e-8
"""Measured on the developers' machine; they decide the size of a step and nothing else."""


class Draws:
    """The draws of a run of joints alone, in steps of about `STEP_SECONDS`."""

    unit = "resamples"
    activity = "resampling"

    def __init__(self, joints: JointsAlone, plan: Resampling) -> None:
        """Check that draws can be made.

        Args:
            joints: whose whole set the draws are parts of.
            plan: what is drawn.

        Raises:
            UnsupportedMethodError: the readings cannot support the method, or it is not linear in them.
            RequestError: a draw is larger than the set.
        """
        count = len(joints.measurements)
        refuse_unsupported(joints.robot, joints.measurements, joints.stated)
        refuse_nonlinear(joints.stated)
        if plan.size > count:
            raise RequestError(
                f"a draw of {plan.size} configurations exceeds the set's {count}",
                where="resampling.size",
                remedy=f"set `size` to at most {count}",
            )
        self._joints, self._plan = joints, plan

    @cached_property
    def _blocks(self) -> MethodStacks:
        joints = self._joints
        return method_stacks(joints.robot, joints.measurements, joints.settings, joints.estimate)

    def steps(self) -> tuple[tuple[int, int], ...]:
        """Return the first repetition of each step, and one past its last."""
        readings = int(self._joints.measurements.present.sum())
        seconds = _SECONDS_A_REPETITION + _SECONDS_A_READING * readings
        size, count = max(1, int(STEP_SECONDS / seconds)), self._plan.repetitions
        return tuple((start, min(start + size, count)) for start in range(0, count, size))

    def compute(self, span: tuple[int, int]) -> dict[str, FloatArray]:
        """Fit some of the draws.

        Raises:
            JointstiffError: as the identification of the whole set does.
        """
        found = resample(self._blocks, self._plan, self._joints.settings.bounds, *span)
        return {"compliance": found.compliance, "compensation": found.compensation}

    def statistics(self, parts: Sequence[Mapping[str, FloatArray]]) -> ResamplingResult:
        """Return what the draws come to, of the joints that the whole set shows."""
        found = self._joints.estimate.joints
        return summarise(
            Resamples.concatenate([Resamples(part["compliance"], part["compensation"]) for part in parts]),
            [joint.name for joint in found],
            kinds=[joint.kind for joint in found],
            hidden=np.array([joint.status == "not_observable" for joint in found]),
            confidence=self._joints.settings.confidence,
        )


def refuse_nonlinear(settings: Settings) -> None:
    """Sums over configurations serve every draw only where no draw changes the rows.

    Raises:
        UnsupportedMethodError: a loss or a model that is not linear in the readings.
    """
    if settings.loss != "squared":
        raise UnsupportedMethodError(
            f"resampling supports only the squared loss, not loss {settings.loss}",
            where="resampling",
            remedy="omit `resampling`, or use loss squared and omit the suspicious readings",
        )
    if settings.prior is not None or settings.order:
        raise UnsupportedMethodError(
            "resampling supports neither `priors` nor `stiffness_order`",
            where="resampling",
            remedy="omit `resampling`, or `priors` and `stiffness_order`",
        )


def _stage_stack(rows: FloatArray, joints: IndexArray, known: IndexArray) -> StageStack:
    chosen = rows[..., [*joints, *known, -1]]
    read = np.full(len(rows), rows.shape[1])
    stack, norms = Stack(chosen, read, {"joints": len(joints), "known": len(known)}).of_unit_columns()
    return StageStack(joints, known, stack, norms[-1] / norms[:-1])


def draws_of(plan: Resampling, configurations: int, start: int, stop: int) -> IndexArray:
    """Draw the configurations of some of the repetitions.

    With u the table ``np.random.default_rng(seed).random((repetitions, N))``, repetition r draws the
    configurations at the m least numbers of row r; with replacement it draws ⌊N u⌋ of the first m.

    Args:
        plan: number m of configurations in a draw, at most N, and seed.
        configurations: N, from which to draw.
        start: first repetition.
        stop: one past the last.

    Returns:
        (stop − start, m) indices of configurations.
    """
    # One number of the generator makes one of the table, so a row is reached without those above.
    generator = np.random.Generator(np.random.PCG64(plan.seed).advance(start * configurations))
    table = generator.random((stop - start, configurations))
    if plan.replacement:
        return (table[:, : plan.size] * configurations).astype(np.intp)
    return np.argpartition(table, plan.size - 1, axis=1)[:, : plan.size]


@dataclass(frozen=True, eq=False)
class Resamples:
    """Estimates of K repetitions.

    A joint has no number, but NaN, where it leaves no trace in what was drawn, where it shows there only
    in combination with others, or where the deflection of such joints cannot be distinguished from its own.
    """

    compliance: FloatArray  #: (K, n) optimum [rad/(N·m)]; NaN where undetermined
    #: (K,) ``1 − mean‖δp − δp̂‖ / mean‖δp‖`` over all N configurations, drawn or not; NaN where a joint
    #: that they show is undetermined
    compensation: FloatArray

    @classmethod
    def concatenate(cls, parts: Sequence[Resamples]) -> Resamples:
        """Join parts, at least one, in the given order."""
        return cls(
            np.concatenate([part.compliance for part in parts]),
            np.concatenate([part.compensation for part in parts]),
        )


def resample(
    blocks: MethodStacks, plan: Resampling, bounds: Bounds, start: int = 0, stop: int | None = None
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
        SolverError: if optimality of an estimate could not be certified.
    """
    stop = plan.repetitions if stop is None else stop
    step = max(1, min(TILE, _TILE_WEIGHTS // len(blocks)))
    starts = range(start, stop, step) or [start]
    draws = (draws_of(plan, len(blocks), first, min(first + step, stop)) for first in starts)
    parts = []
    for drawn in draws:
        shape = len(drawn), len(blocks)
        places = np.arange(len(drawn))[:, None] * len(blocks) + drawn
        counts = np.bincount(places.ravel(), minlength=shape[0] * shape[1]).reshape(shape).astype(np.float64)
        compliance = fit_subsets(blocks, counts, bounds)
        parts.append(Resamples(compliance, blocks.compensation(compliance)))
    return Resamples.concatenate(parts)


def fit_subsets(blocks: MethodStacks, weights: FloatArray, bounds: Bounds) -> FloatArray:
    """Fit subsets of the configurations, stage by stage.

    Args:
        blocks: of the method, weighting and measurement set.
        weights: (K, N) how often each configuration counts in each subset.
        bounds: on all n compliances.

    Returns:
        (K, n) compliances [rad/(N·m)], NaN where undetermined.

    Raises:
        SolverError: if optimality of an estimate could not be certified.
    """
    compliance = np.full((len(weights), blocks.parameters), np.nan)
    for stage in blocks.stages:
        known, own = compliance[:, stage.known], bounds.select(stage.joints)
        compliance[:, stage.joints] = _solve_stage(stage, weights, known, own)
    return compliance


def _solve_stage(stage: StageStack, weights: FloatArray, known: FloatArray, bounds: Bounds) -> FloatArray:
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
    x = np.full(moment.shape, np.nan)
    x[fit] = solution.compliance
    pending = np.ones(len(weights), dtype=np.bool_)
    pending[fit] = ~solution.certified
    for k in np.flatnonzero(pending):
        drawn = np.repeat(np.arange(weights.shape[1]), weights[k].astype(np.intp))
        x[k] = _solve_rows(stage, drawn, offset[k], box)
    return bounds.hold_exactly(x * unit, box.support_at(x))


def _solve_rows(stage: StageStack, drawn: IndexArray, offset: FloatArray, box: Bounds) -> FloatArray:
    """One repetition from its rows, as `solver.estimation.fit` would: QR, rank, `solve_step`.

    Returns:
        (p,) scaled parameters, NaN where undetermined.
    """
    p = len(stage.joints)
    x = np.full(p, np.nan)
    triangle = stage.stack[drawn].triangle().R
    null = np.linalg.norm(triangle, axis=0) <= NULL_COLUMN
    # What is not known of an earlier joint does no harm where that joint leaves no trace, either.
    offset = np.where(null[p:-1] & np.isnan(offset), 0.0, offset)
    columns = np.flatnonzero(~null[:p])
    if np.isnan(offset).any() or not len(columns):
        return x
    R, z = triangle[:, columns], triangle[:, -1] - triangle[:, p:-1] @ offset
    spectrum = Spectrum(R)
    solution = solve_step(IdentificationProblem(spectrum.determined, z, box.select(columns)))
    combined = np.isin(columns, list(analyse(spectrum, columns).combined))
    x[columns] = np.where(combined, np.nan, solution.compliance)
    return x


def summarise(
    resamples: Resamples,
    joints: Sequence[str],
    *,
    kinds: Sequence[JointKind] | None = None,
    hidden: BoolArray | None = None,
    confidence: float = 0.95,
) -> ResamplingResult:
    """Summarise resamples: statistics of each joint over the repetitions that determine it.

    Args:
        resamples: K repetitions, at least one.
        joints: names of the n joints.
        kinds: of the joints; all revolute if None.
        hidden: (n,) joints that the whole set does not show: they get no numbers.
        confidence: share of the repetitions within the percentile intervals, between 0 and 1.
    """
    draws = np.where(False if hidden is None else hidden, np.nan, resamples.compliance)
    undetermined = np.isnan(draws)
    determined = np.maximum((~undetermined).sum(axis=0), 1)
    columns = [c[~np.isnan(c)] for c in draws.T]
    compliance, c_deviation, c_interval = _statistics(columns, confidence)
    stiffness, k_deviation, _ = _statistics([1.0 / c[c != 0] for c in columns], confidence)
    compensation = resamples.compensation[~np.isnan(resamples.compensation)]
    explained, e_deviation, e_interval = _statistics([compensation], confidence)
    of_joints = rows(
        ResampledJoint,
        name=joints,
        kind=["revolute"] * len(joints) if kinds is None else kinds,
        compliance_mean=compliance,
        compliance_deviation=c_deviation,
        compliance_interval=c_interval,
        stiffness_mean=stiffness,
        stiffness_deviation=k_deviation,
        share_negative=(draws < 0).sum(axis=0) / determined,
        share_infinite=(draws == 0).sum(axis=0) / determined,
        share_undetermined=undetermined.mean(axis=0),
    )
    (result,) = rows(
        ResamplingResult,
        repetitions=[len(draws)],
        joints=[of_joints],
        share_any_negative=[float((resamples.compliance < 0).any(axis=1).mean())],
        compensation_mean=explained,
        compensation_deviation=e_deviation,
        compensation_interval=e_interval,
    )
    return result


def _statistics(
    samples: Sequence[FloatArray], confidence: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean (k,), standard deviation (k,) and percentile interval (k, 2) of samples; NaN of too few."""
    tail = (1.0 - confidence) / 2.0
    mean, deviation, interval = np.full(len(samples), np.nan), np.full(len(samples), np.nan), []
    for k, values in enumerate(samples):
        mean[k] = values.mean() if len(values) else np.nan
        deviation[k] = values.std(ddof=1) if len(values) > 1 else np.nan
        interval.append(np.quantile(values, [tail, 1.0 - tail]) if len(values) else [np.nan, np.nan])
    return mean, deviation, np.array(interval)
