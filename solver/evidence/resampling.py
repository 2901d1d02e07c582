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
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.options import Resampling
from jointstiff.schemas.run import ResampledJoint, ResamplingResult
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError, UnsupportedMethodError
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.fit.cone import Scalars
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.identify import refuse_unsupported
from jointstiff.solver.fit.method import Method, Settings
from jointstiff.solver.fit.observability import NULL_COLUMN, Excitation, Spectrum, analyse_spectrum
from jointstiff.solver.fit.problem import LeastSquares, Problem
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.solution import solve, solve_batch
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.fit.statements import FittedStatements
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.messages import build_messages

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

    joints: IndexArray  #: (p,) the joints that the stage estimates
    known: IndexArray  #: (q,) joints that an earlier stage has estimated; their deflection is subtracted
    stack: Stack  #: N configurations, p + q columns of unit length
    unit: FloatArray  #: (p + q,) unit of the scaled parameters x, ``c = unit · x`` [rad/(N·m)]

    def sum_grams(self, weights: FloatArray) -> FloatArray:
        """Return the Gram matrices ``Σ_i w_ki M_iᵀM_i`` (K, p + q + 1, p + q + 1) of K weighted subsets.

        M_i are the rows of configuration i: columns of p joints, q joints of an earlier stage, and the
        readings.

        Args:
            weights: w (K, N), how often each configuration i counts in each subset k.
        """
        return np.asarray(np.einsum("ki,iab->kab", weights, self.stack.grams))


@dataclass(frozen=True, eq=False)
class MethodStacks:
    """Rows of a method on a measurement set, ready to fit any subset of the N configurations."""

    joint_count: int  #: n
    stages: tuple[StageStack, ...]  #: stages of the method, in the order in which they are solved
    visible: IndexArray  #: (v,) joints that have an effect on the readings of the full set
    #: (v, 3, M) regressor of the M readings of all targets in all configurations, axes of R0 [m/(rad/(N·m))];
    #: compensation is computed from these readings, whatever the method fits
    regressor: FloatArray
    deflection: FloatArray  #: (3, M) deflection of the same readings, axes of R0 [m]

    def __len__(self) -> int:
        return len(self.stages[0].stack)

    def compute_compensation(self, compliance: FloatArray) -> FloatArray:
        """Return the fraction of the deflections that a correction by their prediction compensates.

        It is ``1 − mean‖δp − δp̂‖ / mean‖δp‖`` over all readings (method.md §6): δp are the deflections that
        were read, δp̂ those that the compliances predict.

        Args:
            compliance: (K, n) compliances of K repetitions [rad/(N·m)].

        Returns:
            (K,) dimensionless; NaN where the compliance of a visible joint is NaN.
        """
        mean_deflection = np.linalg.norm(self.deflection, axis=0).mean()
        mean_residual = np.empty(len(compliance))
        # Some repetitions at a time, so that their residuals stay in the cache.
        tile_size = max(1, TILE_RESIDUALS // self.deflection.size)
        for start in range(0, len(compliance), tile_size):
            tile = slice(start, start + tile_size)
            visible_compliance = compliance[tile, self.visible]
            # Repetition k, visible joint v, axis i, reading m.
            predicted = np.einsum("kv,vim->kim", visible_compliance, self.regressor)
            residual_length = np.sqrt(np.square(self.deflection - predicted).sum(axis=1))
            mean_residual[tile] = residual_length.mean(axis=1)
        return np.asarray(1.0 - mean_residual / mean_deflection)


def build_method_stacks(rows: Rows, settings: Settings, estimate: Estimate) -> MethodStacks:
    """Build the least-squares rows of a method for each configuration, from which any subset is fitted.

    Args:
        rows: N observations.
        settings: method, weighting and K_c are used; other settings are ignored.
        estimate: estimate from the full set by the same method. The rows are computed at its characteristic
            length and compliances, so that a fit is linear in the rows. Errors that were fitted with the
            joints, such as that of the load point, are subtracted from the readings.
    """
    rows = rows.at(estimate.balanced)
    method = Method(rows.robot, settings, estimate.characteristic_length)
    collected = _collect_rows(rows, method, estimate.statements)
    observable = ~Excitation.of(rows).observability().null
    stages = []
    for stage, stage_rows in zip(method.stages, collected.rows_of_stages, strict=True):
        joints, known = stage.joints[observable[stage.joints]], stage.known[observable[stage.known]]
        if len(joints):
            stages.append(_build_stage_stack(stage_rows, joints, known))
    visible = np.flatnonzero(observable)
    return MethodStacks(
        joint_count=rows.robot.n,
        stages=tuple(stages),
        visible=visible,
        regressor=np.ascontiguousarray(collected.regressor.T[visible]),
        deflection=np.ascontiguousarray(collected.deflection.T),
    )


class _CollectedRows(NamedTuple):
    """Rows of all N configurations: for the fit of each stage of a method, and of all M readings as read."""

    rows_of_stages: list[FloatArray]  # (N, r, n + 1) [A d] of each stage
    regressor: FloatArray  # (M, 3, n) axes of R0 [m/(rad/(N·m))]
    deflection: FloatArray  # (M, 3) axes of R0 [m]


def _collect_rows(rows: Rows, method: Method, statements: FittedStatements) -> _CollectedRows:
    """Collect the rows of a method, block by block, with fitted errors subtracted from the readings.

    A subset of the configurations corrects stated values, such as the load point, as all of them do.
    """
    blocks_of_stages: list[list[FloatArray]] = [[] for _ in method.stages]
    regressors, deflections = [], []
    for of_block in statements.statements.generate(rows, [JOINTS], whitened=False):
        corrected = statements.subtract(of_block)
        stage_rows = method.map_rows(corrected.whiten())
        for blocks, mapped in zip(blocks_of_stages, stage_rows, strict=True):
            blocks.append(mapped.fitted)
        present = of_block.block.measurements.present
        regressors.append(of_block.block.A[present])
        deflections.append(corrected.targets[present][..., -1])
    rows_of_stages = [np.concatenate(blocks) for blocks in blocks_of_stages]
    return _CollectedRows(rows_of_stages, np.concatenate(regressors), np.concatenate(deflections))


STEP_SECONDS: Final = 0.25
_SECONDS_A_REPETITION: Final = 8e-6
_SECONDS_A_READING: Final = 2.5e-8
"""Measured on the developers' machine; they decide the size of a step and nothing else."""


class Draws:
    """Resampling of a model of joints alone, divided into steps of about `STEP_SECONDS`."""

    unit = "resamples"
    activity = "resampling"

    def __init__(self, joints: JointsAlone, plan: Resampling) -> None:
        """Check that the plan suits the measurements and settings.

        Args:
            joints: identification of the whole set, from which the configurations are drawn.
            plan: size and number of the draws.

        Raises:
            UnsupportedMethodError: the readings cannot support the method, or the settings make the fit
                nonlinear.
            RequestError: a draw is larger than the set.
        """
        count = len(joints.measurements)
        refuse_unsupported(joints.rows, joints.stated)
        refuse_nonlinear(joints.stated)
        if plan.size > count:
            raise RequestError(
                f"a draw of {plan.size} configurations is larger than the measurement set with {count} "
                "configurations",
                where="resampling.size",
                remedy=f"set `size` to at most {count}",
            )
        self._joints, self._plan = joints, plan

    @cached_property
    def _stacks(self) -> MethodStacks:
        """Rows of the method on the whole measurement set, configuration by configuration."""
        joints = self._joints
        return build_method_stacks(joints.rows, joints.settings, joints.estimate)

    def steps(self) -> tuple[tuple[int, int], ...]:
        """Return the range of repetitions of each step of the work, as (first, one past the last)."""
        readings = int(self._joints.measurements.present.sum())
        seconds = _SECONDS_A_REPETITION + _SECONDS_A_READING * readings
        step_size = max(1, int(STEP_SECONDS / seconds))
        count = self._plan.repetitions
        return tuple((first, min(first + step_size, count)) for first in range(0, count, step_size))

    def compute(self, span: tuple[int, int]) -> dict[str, FloatArray]:
        """Fit the compliances in the repetitions of one step of the work.

        Args:
            span: range of repetitions, as (first, one past the last); K repetitions.

        Returns:
            Arrays by name: `compliance` (K, n) [rad/(N·m)]; and `compensation` (K,), the fraction of the
            deflections of the whole set that a correction by their prediction compensates, dimensionless.

        Raises:
            JointstiffError: the identification of the whole set fails.
        """
        resamples = resample(self._stacks, self._plan, self._joints.settings.bounds, *span)
        return {"compliance": resamples.compliance, "compensation": resamples.compensation}

    def statistics(self, results: Sequence[Mapping[str, FloatArray]]) -> ResamplingResult:
        """Return the statistics of the compliances and of the compensation over all repetitions.

        Joints that are not observable in the whole set get no statistics.

        Args:
            results: arrays that `compute` returned for each step, in the order of the steps.
        """
        joints = self._joints.estimate.joints
        resamples = [Resamples(step["compliance"], step["compensation"]) for step in results]
        return summarise_resamples(
            Resamples.concatenate(resamples),
            [joint.name for joint in joints],
            kinds=[joint.kind for joint in joints],
            is_hidden=np.array([joint.status == "not_observable" for joint in joints]),
            confidence=self._joints.settings.confidence,
        )


def refuse_nonlinear(settings: Settings) -> None:
    """Refuse settings that resampling does not support, because its fits are sums over configurations.

    Raises:
        UnsupportedMethodError: the loss is not squared, or the settings contain priors or a stiffness order.
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


def _build_stage_stack(rows: FloatArray, joints: IndexArray, known: IndexArray) -> StageStack:
    """Return the least-squares problem of one stage, with columns scaled to unit length.

    Args:
        rows: (N, r, n + 1) [A d] of all n joints in N configurations.
        joints: (p,) joints that the stage estimates.
        known: (q,) joints that an earlier stage has estimated.
    """
    stage_rows = rows[..., [*joints, *known, -1]]
    row_counts = np.full(len(rows), rows.shape[1])  # every row counts as a reading
    stack = Stack(stage_rows, row_counts, {"joints": len(joints), "known": len(known)})
    unit_stack, lengths = stack.scale_to_unit_columns()
    unit = lengths[-1] / lengths[:-1]  # the readings are the last column
    return StageStack(joints, known, unit_stack, unit)


def draw_configurations(plan: Resampling, configurations: int, start: int, stop: int) -> IndexArray:
    """Draw the configurations for a range of repetitions, reproducibly from the seed.

    With u the table ``np.random.default_rng(seed).random((repetitions, N))``, repetition r draws the
    configurations at the m least numbers of row r. With replacement, repetition r draws the configurations
    ⌊N u⌋ for the first m numbers u of row r.

    Args:
        plan: number m of configurations in a draw, at most N, and seed.
        configurations: N, the number of configurations to draw from.
        start: first repetition.
        stop: one past the last repetition.

    Returns:
        (stop − start, m) indices of configurations.
    """
    # The generator makes one number for each entry of the table, so `advance` skips the rows above.
    generator = np.random.Generator(np.random.PCG64(plan.seed).advance(start * configurations))
    table = generator.random((stop - start, configurations))
    if plan.replacement:
        return (table[:, : plan.size] * configurations).astype(np.intp)
    return np.argpartition(table, plan.size - 1, axis=1)[:, : plan.size]


@dataclass(frozen=True, eq=False)
class Resamples:
    """Estimates of K repetitions.

    A joint's compliance is NaN where the drawn configurations do not determine the compliance: the joint has
    no effect on their readings, or the readings show only a combination of this joint and other joints.
    """

    compliance: FloatArray  #: (K, n) optimum [rad/(N·m)]; NaN where undetermined
    #: (K,) compensated fraction ``1 − mean‖δp − δp̂‖ / mean‖δp‖`` of the deflections of all N configurations,
    #: drawn or not; NaN where a joint that is visible in the full set is undetermined
    compensation: FloatArray

    @classmethod
    def concatenate(cls, parts: Sequence[Resamples]) -> Resamples:
        """Return the repetitions of all parts, at least one, in the given order."""
        return cls(
            np.concatenate([part.compliance for part in parts]),
            np.concatenate([part.compensation for part in parts]),
        )


def resample(
    stacks: MethodStacks, plan: Resampling, bounds: Bounds, start: int = 0, stop: int | None = None
) -> Resamples:
    """Draw configurations and fit the compliances to them, for the repetitions from `start` to `stop`.

    Args:
        stacks: rows of the method on the measurement set.
        plan: size, number and seed of the draws.
        bounds: bounds on all n compliances.
        start: first repetition.
        stop: one past the last repetition; None for the end of the plan.

    Returns:
        Estimates of these repetitions, each certified, in order.

    Raises:
        SolverError: if optimality of an estimate could not be certified.
    """
    stop = plan.repetitions if stop is None else stop
    batch_size = max(1, min(TILE, _TILE_WEIGHTS // len(stacks)))
    batches = []
    for first in range(start, stop, batch_size) or [start]:  # an empty range is one empty batch
        drawn = draw_configurations(plan, len(stacks), first, min(first + batch_size, stop))
        compliance = fit_subsets(stacks, _count_draws(drawn, len(stacks)), bounds)
        batches.append(Resamples(compliance, stacks.compute_compensation(compliance)))
    return Resamples.concatenate(batches)


def _count_draws(drawn: IndexArray, configurations: int) -> FloatArray:
    """Return how often each of K repetitions drew each of N configurations: a table (K, N).

    Args:
        drawn: (K, m) indices of the configurations that each repetition drew.
        configurations: N.
    """
    repetitions = np.arange(len(drawn))[:, None]
    cells = repetitions * configurations + drawn  # number of the cell in the flattened table
    counts = np.bincount(cells.ravel(), minlength=len(drawn) * configurations)
    return counts.reshape(len(drawn), configurations).astype(np.float64)


def fit_subsets(stacks: MethodStacks, weights: FloatArray, bounds: Bounds) -> FloatArray:
    """Fit the compliances to each of K subsets of the configurations, stage by stage.

    Args:
        stacks: rows of the method on the measurement set.
        weights: (K, N) how often each configuration counts in each subset.
        bounds: on all n compliances.

    Returns:
        (K, n) compliances [rad/(N·m)], NaN where undetermined.

    Raises:
        SolverError: if optimality of an estimate could not be certified.
    """
    compliance = np.full((len(weights), stacks.joint_count), np.nan)
    for stage in stacks.stages:
        compliance_of_earlier_stages = compliance[:, stage.known]
        compliance[:, stage.joints] = _solve_stage(
            stage, weights, compliance_of_earlier_stages, bounds.select(stage.joints)
        )
    return compliance


def _solve_stage(
    stage: StageStack, weights: FloatArray, known_compliance: FloatArray, bounds: Bounds
) -> FloatArray:
    """Return the compliances (K, p) of a stage's joints in K subsets [rad/(N·m)]; NaN where undetermined.

    Subsets whose normal equations are too ill-conditioned are fitted to their rows.

    Args:
        stage: rows of all N configurations, for p joints.
        weights: (K, N) how often each configuration counts in each subset.
        known_compliance: (K, q) compliances of the joints of an earlier stage [rad/(N·m)].
        bounds: bounds of the p compliances.
    """
    joint_count = len(stage.joints)
    units = stage.unit[:joint_count]
    scaled_known = known_compliance / stage.unit[joint_count:]
    scaled_bounds = Bounds(bounds.lower / units, bounds.upper / units)
    equations = _build_normal_equations(stage, weights, scaled_known)
    solution = equations.solve(scaled_bounds)
    scaled_compliance = solution.compliance
    for k in np.flatnonzero(~solution.certified):
        drawn = np.repeat(np.arange(weights.shape[1]), weights[k].astype(np.intp))
        scaled_compliance[k] = _solve_from_rows(stage, drawn, scaled_known[k], scaled_bounds)
    # The multiplication by the units would move a compliance at a bound off it by rounding.
    active_bounds = scaled_bounds.active_bounds_at(scaled_compliance)
    return bounds.hold_exactly(scaled_compliance * units, active_bounds)


class _SubsetSolutions(NamedTuple):
    """Solutions of the normal equations of K subsets."""

    compliance: FloatArray  # (K, p) scaled; NaN where not solved
    certified: BoolArray  # (K,) whether a solution is proved to be optimal


class _NormalEquations(NamedTuple):
    """Normal equations ``G x = g`` of K subsets, with unit columns over the full set."""

    gram: FloatArray  # G (K, p, p)
    moment: FloatArray  # g (K, p); NaN where a joint of an earlier stage is undetermined

    def solve(self, bounds: Bounds) -> _SubsetSolutions:
        """Solve the equations of all subsets at once, with bounds on the p unknowns.

        Equations of a joint without an effect on the readings of its subset are left out.
        """
        squared_lengths = np.diagonal(self.gram, axis1=1, axis2=2)  # of the columns
        is_observable = (squared_lengths > NULL_COLUMN**2).all(axis=1)
        solvable = np.flatnonzero(is_observable & np.isfinite(self.moment).all(axis=1))
        solution = solve_batch(self.gram[solvable], self.moment[solvable], bounds)
        compliance = np.full(self.moment.shape, np.nan)
        compliance[solvable] = solution.compliance
        certified = np.zeros(len(self.gram), dtype=np.bool_)
        certified[solvable] = solution.certified
        return _SubsetSolutions(compliance, certified)


def _build_normal_equations(
    stage: StageStack, weights: FloatArray, scaled_known: FloatArray
) -> _NormalEquations:
    """Return ``A_jᵀ A_j x = A_jᵀ d − A_jᵀ A_k x_k`` of K subsets.

    A_j are the columns of the stage's p joints, A_k those of q joints that an earlier stage has estimated, d
    the readings.

    Args:
        stage: rows of all N configurations.
        weights: (K, N) how often each configuration counts in each subset.
        scaled_known: x_k (K, q), scaled compliances.
    """
    joint_count = len(stage.joints)
    of_joints, of_known = slice(0, joint_count), slice(joint_count, -1)
    grams = stage.sum_grams(weights)  # of the columns [A_j A_k d] of each subset
    explained_by_known = (grams[:, of_joints, of_known] * scaled_known[:, None, :]).sum(axis=2)
    return _NormalEquations(grams[:, of_joints, of_joints], grams[:, of_joints, -1] - explained_by_known)


def _solve_from_rows(
    stage: StageStack, drawn: IndexArray, known: FloatArray, scaled_bounds: Bounds
) -> FloatArray:
    """Fit one stage of one repetition to its rows, for a Gram matrix that is too ill-conditioned.

    Args:
        stage: rows of all configurations.
        drawn: indices of the drawn configurations, repeated as often as they were drawn.
        known: (q,) scaled compliances of the joints of an earlier stage; NaN where undetermined.
        scaled_bounds: bounds of the scaled parameters.

    Returns:
        (p,) scaled parameters, NaN where undetermined.
    """
    joint_count = len(stage.joints)
    parameters = np.full(joint_count, np.nan)
    triangle = stage.stack[drawn].triangle().R  # factor R of the rows: columns of joints, known, readings
    is_null = np.linalg.norm(triangle, axis=0) <= NULL_COLUMN
    # An undetermined joint of an earlier stage does no harm if it has no effect on these rows either.
    has_no_effect = is_null[joint_count:-1]
    known = np.where(has_no_effect & np.isnan(known), 0.0, known)
    shown = np.flatnonzero(~is_null[:joint_count])  # joints with an effect on these rows
    if np.isnan(known).any() or not len(shown):
        return parameters
    readings = triangle[:, -1] - triangle[:, joint_count:-1] @ known
    parameters[shown] = _solve_determined(triangle[:, shown], readings, scaled_bounds.select(shown), shown)
    return parameters


def _solve_determined(
    columns: FloatArray, readings: FloatArray, bounds: Bounds, joints: IndexArray
) -> FloatArray:
    """Return the scaled parameters of some joints; NaN for those that the rows show only in combination.

    For example two parallel joints that always see the same torque have no value of their own.

    Args:
        columns: (m, s) columns of s joints.
        readings: (m,) readings of the same rows.
        bounds: bounds of the s parameters.
        joints: (s,) indices of the joints.
    """
    spectrum = Spectrum(columns)
    problem = Problem(LeastSquares(spectrum.determined, readings), Scalars(bounds))
    solution = solve(problem, witnessed=False)
    is_combined = np.isin(joints, list(analyse_spectrum(spectrum, joints).combined))
    return np.where(is_combined, np.nan, solution.x)


def summarise_resamples(
    resamples: Resamples,
    joints: Sequence[str],
    *,
    kinds: Sequence[JointKind] | None = None,
    is_hidden: BoolArray | None = None,
    confidence: float = 0.95,
) -> ResamplingResult:
    """Return statistics of each joint's compliance and stiffness, and of the compensation.

    The statistics of a joint are those over the repetitions that determine the joint.

    Args:
        resamples: K repetitions, at least one.
        joints: names of the n joints.
        kinds: revolute or prismatic, for each joint; all revolute if None.
        is_hidden: (n,) whether a joint is not observable in the whole set; such a joint gets no statistics.
        confidence: share of the repetitions within the percentile intervals, between 0 and 1.
    """
    compliances = resamples.compliance.copy()
    if is_hidden is not None:
        compliances[:, is_hidden] = np.nan
    if kinds is None:
        kinds = ["revolute"] * len(joints)
    has_negative_joint = (resamples.compliance < 0).any(axis=1)
    compensation = _summarise_samples([_drop_nan(resamples.compensation)], confidence)
    (result,) = build_messages(
        ResamplingResult,
        repetitions=[len(compliances)],
        joints=[_summarise_joints(compliances, joints, kinds, confidence)],
        share_any_negative=[float(has_negative_joint.mean())],
        compensation_mean=compensation.mean,
        compensation_deviation=compensation.deviation,
        compensation_interval=compensation.interval,
    )
    return result


def _summarise_joints(
    compliances: FloatArray, names: Sequence[str], kinds: Sequence[JointKind], confidence: float
) -> list[ResampledJoint]:
    """Return statistics of each joint's compliance and stiffness, over the repetitions that determine it.

    Args:
        compliances: (K, n) in K repetitions [rad/(N·m)]; NaN where a repetition does not determine a joint.
        names: names of the n joints.
        kinds: revolute or prismatic, for each joint.
        confidence: share of the repetitions within the percentile intervals.
    """
    is_undetermined = np.isnan(compliances)
    determined_counts = np.maximum((~is_undetermined).sum(axis=0), 1)
    determined = [_drop_nan(compliances_of_joint) for compliances_of_joint in compliances.T]
    compliance = _summarise_samples(determined, confidence)
    stiffness = _summarise_samples([1.0 / values[values != 0] for values in determined], confidence)
    return build_messages(
        ResampledJoint,
        name=names,
        kind=kinds,
        compliance_mean=compliance.mean,
        compliance_deviation=compliance.deviation,
        compliance_interval=compliance.interval,
        stiffness_mean=stiffness.mean,
        stiffness_deviation=stiffness.deviation,
        share_negative=(compliances < 0).sum(axis=0) / determined_counts,
        share_infinite=(compliances == 0).sum(axis=0) / determined_counts,
        share_undetermined=is_undetermined.mean(axis=0),
    )


class _Statistics(NamedTuple):
    """Statistics of k samples; NaN where a sample has too few values."""

    mean: FloatArray  # (k,)
    deviation: FloatArray  # (k,) standard deviation
    interval: FloatArray  # (k, 2) percentiles


def _drop_nan(values: FloatArray) -> FloatArray:
    """Return the values that are not NaN."""
    return values[~np.isnan(values)]


def _summarise_samples(samples: Sequence[FloatArray], confidence: float) -> _Statistics:
    """Return mean, standard deviation and percentile interval of each of k samples.

    A mean or an interval needs one value of the sample, a deviation two values; else the number is NaN.
    """
    tail = (1.0 - confidence) / 2.0
    mean = np.full(len(samples), np.nan)
    deviation = np.full(len(samples), np.nan)
    interval = np.full((len(samples), 2), np.nan)
    for k, values in enumerate(samples):
        if len(values):
            mean[k] = values.mean()
            interval[k] = np.quantile(values, [tail, 1.0 - tail])
        if len(values) > 1:
            deviation[k] = values.std(ddof=1)
    return _Statistics(mean, deviation, interval)
