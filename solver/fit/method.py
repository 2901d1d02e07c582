"""Settings of an identification, and methods as linear maps of the targets' whitened readings (method.md §4).

With the whitened rows T = W [A d] of an observation, of unit covariance, a stage of a method fits N T:

    partial pose            N = I: three rows a target, positions only
    complete pose           N = Qᵀ, the whitened G = Q R of the rigid motion ``δp_X = δp_b + δφ × (X − b)``
    decoupled, the arm      N = Q_cᵀ, the displacement ``E R⁻¹ Qᵀ`` carried to P_wrist, with orthonormal rows
    decoupled, the wrist    N = I, less the deflection by the arm

Other weightings than that by covariance scale the readings themselves, N = S W⁻¹ or S R⁻¹ Qᵀ, and leave a
sandwich covariance: with the spread ``NᵀN A`` it is ``(AᵀNᵀN A)⁻¹ (NᵀN A)ᵀ(NᵀN A) (AᵀNᵀN A)⁻¹``. Secondary
encoders take part in every method: what they say of a joint does not pass through the targets.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, pairwise
from typing import Final, Literal

import numpy as np
from scipy.optimize import minimize_scalar

from jointstiff.schemas.options import Method as MethodName
from jointstiff.schemas.options import RunOptions, Weighting
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fit.observability import Excitation, Spectrum
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.problem import Bounds, Constraints, Order
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.statements import FittedStatements, Statements
from jointstiff.solver.fit.triangle import Triangle, orthonormal_basis, unit_columns
from jointstiff.solver.mechanics.block import BlockRows, RegressorBlock, Term, fitted_errors
from jointstiff.solver.mechanics.measurements import Measurements, whitener
from jointstiff.solver.mechanics.postures import WRIST_JOINTS, Wrist, find_wrist, skew
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import JOINTS

Loss = Literal["squared", "huber"]

DEFAULT_THRESHOLD: Final = 2.8
"""Default threshold of the Huber loss in units of sigma, about the 95 % quantile of χ with three degrees of
freedom, 2.796: 95 % of good readings of three coordinates stay below."""


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of an identification."""

    method: MethodName  #: see method.md §4
    weighting: Weighting  #: see method.md §3; `characteristic_length` goes with the complete pose only
    bounds: Bounds  #: on the compliances
    characteristic_length: float | None = None  #: [m]; None for the length of least condition number
    confidence: float = 0.95  #: level of the intervals, between 0 and 1
    #: pairs (i, j) of joints with c_i ≤ c_j: joint i at least as stiff as joint j
    order: tuple[tuple[int, int], ...] = ()
    #: prior of the compliances; with weighting by covariance only
    prior: Prior | None = None
    loss: Loss = "squared"  #: loss of the norm of each target's whitened residual
    huber_threshold: float = DEFAULT_THRESHOLD  #: for the loss `huber`, in units of sigma
    complementary_stiffness: bool = False  #: whether K_c is part of the model (method.md §2)

    @classmethod
    def from_options(cls, options: RunOptions, robot: Robot) -> Settings:
        """Convert the options of a run into settings; stiffnesses become compliances.

        Raises:
            RequestError: an option names a joint that the robot does not have, or the order of the joints
                contradicts itself or the bounds.
        """
        pairs = (pair for chain in options.stiffness_order for pair in pairwise(chain))
        order = tuple(
            dict.fromkeys(
                (
                    robot.joint_index(first, f"stiffness_order.{first}"),
                    robot.joint_index(second, f"stiffness_order.{second}"),
                )
                for first, second in pairs
            )
        )
        # If elastic links are requested, the loss belongs to their model, and joints alone use squares.
        uses_huber = options.loss == "huber" and options.elasticity in {"joints", "automatic"}
        settings = cls(
            method=options.method,
            weighting=options.weighting,
            characteristic_length=options.characteristic_length,
            bounds=_bounds_from_options(options, robot, order),
            confidence=options.confidence,
            order=order,
            prior=_prior_from_options(options, robot),
            loss="huber" if uses_huber else "squared",
            huber_threshold=options.huber_threshold or DEFAULT_THRESHOLD,
            complementary_stiffness=options.complementary_stiffness == "included",
        )
        _ = settings.constraints  # raises RequestError for contradictions before any work is done
        return settings

    @cached_property
    def constraints(self) -> Constraints:
        """Bounds and order of the compliances.

        Raises:
            RequestError: if order and bounds contradict each other.
        """
        return Constraints(self.bounds, self.order)


def _bounds_from_options(options: RunOptions, robot: Robot, order: Order) -> Bounds:
    """Return the bounds of the compliances; joints in an order or with a stiffness bound are positive."""
    bounds = Bounds.positive(robot.n) if options.positive else Bounds.unconstrained(robot.n)
    lower, upper = bounds.lower.copy(), bounds.upper.copy()
    for pair in order:
        lower[list(pair)] = 0.0
    for name, (least, greatest) in options.stiffness_bounds.items():
        j = robot.joint_index(name, f"stiffness_bounds.{name}")
        lower[j] = 0.0 if greatest is None else 1.0 / greatest
        upper[j] = np.inf if least is None else 1.0 / least
    return Bounds(lower, upper)


def _prior_from_options(options: RunOptions, robot: Robot) -> Prior | None:
    """Return the prior of the compliances that priors of the stiffnesses imply; None without `priors`.

    To first order, a stiffness k₀ with uncertainty u(k₀) gives c₀ = 1/k₀ and s₀ = u(k₀)/k₀².
    """
    if not options.priors:
        return None
    mean, uncertainty = np.full(robot.n, np.nan), np.full(robot.n, np.inf)
    for name, known in options.priors.items():
        j = robot.joint_index(name, f"priors.{name}")
        mean[j] = 1.0 / known.stiffness
        uncertainty[j] = known.standard_uncertainty / known.stiffness**2
    return Prior(mean, uncertainty)


MIN_TARGETS = 3
_COLLINEAR = 1e-3
"""Least ratio of height to length of the targets' triangle: below, rotation about its long side is noise."""
_DECADES = (-3.0, 3.0)
"""Range of the characteristic length, as exponents of ten [m]."""


@dataclass(frozen=True, eq=False)
class Stage:
    """One least-squares problem of a method; the decoupled method has two, for arm and wrist."""

    joints: IndexArray  #: (p,) joints that the stage estimates
    known: IndexArray  #: (q,) joints that an earlier stage has estimated; their deflection is subtracted


@dataclass(frozen=True, eq=False)
class StageRows:
    """Rows of B observations in one stage."""

    #: (B, r, K + 1) columns of all terms, then of the readings; rows of the targets, then rows of the
    #: encoders of the stage's joints
    fitted: FloatArray
    #: (B, 3 T, K + 1) ``NᵀN`` times the targets' rows, N the linear map of the stage; None where N = I
    spread: FloatArray | None

    def list_spread_columns(self, whitened: BlockRows, joints: int) -> FloatArray:
        """Return the columns (m, n) of the joints in `spread`, or in the whitened rows where N = I."""
        spread = whitened.targets if self.spread is None else self.spread
        return spread.reshape(-1, spread.shape[-1])[:, :joints]


class Method:
    """A method with its weighting, as linear maps N of the whitened rows of the readings."""

    def __init__(self, robot: Robot, settings: Settings, length: float | None) -> None:
        """Choose the stages of the method.

        Args:
            robot: n joints.
            settings: method and weighting.
            length: characteristic length [m], if the weighting uses one.

        Raises:
            UnsupportedMethodError: the decoupled method, and the robot has no spherical wrist.
        """
        joints = np.arange(robot.n)
        self.joint_names, self.joint_kinds = robot.joint_names, robot.joint_kinds
        self.name, self.weighting = settings.method, settings.weighting
        self.characteristic_length = length
        self.length = 1.0 if settings.weighting == "uniform" else length
        self.stages: tuple[Stage, ...] = (Stage(joints, joints[:0]),)
        if settings.method == "decoupled_partial_pose":
            self.centre = find_spherical_wrist(robot).centre
            arm, wrist = joints[:-WRIST_JOINTS], joints[-WRIST_JOINTS:]
            self.stages = (Stage(arm, joints[:0]), Stage(wrist, arm))

    @property
    def by_covariance(self) -> bool:
        """True if the rows are weighted by their covariance, as in the likelihood."""
        return self.weighting == "covariance"

    @property
    def is_plain(self) -> bool:
        """True if the method fits the whitened rows of the readings as they are, without a linear map."""
        return self.by_covariance and self.name == "partial_pose"

    def map_rows(self, whitened: BlockRows) -> Iterator[StageRows]:
        """Yield the rows of a block of observations in each stage, in the order of the stages.

        Args:
            whitened: whitened rows of B observations, in units of sigma.

        Raises:
            UnsupportedMethodError: if the targets of an observation lie on a line, and a pose is needed.
        """
        targets, encoders = whitened.targets, whitened.encoders
        flat = targets.reshape(len(targets), -1, targets.shape[-1])
        maps = self._stage_maps(whitened.block)
        for stage, (observation_map, target_map) in zip(self.stages, maps, strict=True):
            if observation_map is not None:
                fitted_rows = observation_map @ flat
                spread_rows = observation_map.transpose(0, 2, 1) @ fitted_rows
            elif target_map is not None:  # S W⁻¹, target by target
                fitted_rows = target_map @ targets
                spread_rows = (target_map.mT @ fitted_rows).reshape(flat.shape)
                fitted_rows = fitted_rows.reshape(flat.shape)
            else:
                fitted_rows, spread_rows = flat, None
            if encoders is not None:
                fitted_rows = np.concatenate([fitted_rows, encoders[:, stage.joints]], axis=1)
            yield StageRows(fitted_rows, spread_rows)

    def _stage_maps(self, block: RegressorBlock) -> list[tuple[FloatArray | None, FloatArray | None]]:
        """Return for each stage the linear map N of the whitened rows, as a pair of arrays or None.

        The first array (B, m, 3 T) maps the rows of whole observations, the second (B, T, 3, 3) the rows of
        single targets. At least one of them is None; if both are, N is the identity.
        """
        target_maps: tuple[FloatArray | None, FloatArray | None] = (None, None)
        if not self.by_covariance:
            target_maps = self._undo_whitening(block)
        match self.name:
            case "partial_pose":
                return [target_maps]
            case "complete_pose":
                return [(self._map_to_pose(block), None)]
            case _:
                return [(self._map_to_wrist_centre(block), None), target_maps]

    def _map_to_pose(self, block: RegressorBlock) -> FloatArray:
        """Return the map (B, 6, 3 T) from whitened rows to the displacement of the flange's pose.

        The displacement is whitened if the method uses covariances, else scaled by the method's length.
        """
        Q, R, _ = factorise_displacement(block)
        if self.by_covariance:
            return Q.mT
        row_scale = np.repeat([1.0 / (self.length or 1.0), 1.0], 3)
        scaled_map = row_scale[:, None] * np.linalg.solve(R, Q.mT)
        return np.asarray(_least_root_weights(block.measurements) * scaled_map)

    def _map_to_wrist_centre(self, block: RegressorBlock) -> FloatArray:
        """Return the map (B, 3, 3 T) from whitened rows to the displacement of the wrist centre.

        The displacement is whitened if the method uses covariances.
        """
        Q, R, reference = factorise_displacement(block)
        centre = block.postures.to_base(np.broadcast_to(self.centre, (len(Q), 1, 3)))[:, 0]
        # Map from the displacement of the reference point, and the rotation, to that of the centre.
        identity = np.broadcast_to(np.eye(3), (len(Q), 3, 3))
        extrapolation = np.concatenate([identity, -skew(centre - reference)], axis=2)
        centre_map = extrapolation @ np.linalg.solve(R, Q.mT)
        if self.by_covariance:  # orthonormal rows: the displacement of the centre, whitened
            return np.linalg.qr(centre_map.mT)[0].mT
        return np.asarray(_least_root_weights(block.measurements) * centre_map)

    @staticmethod
    def _undo_whitening(block: RegressorBlock) -> tuple[FloatArray | None, FloatArray | None]:
        """Return the map from whitened rows back to equal weights, as a pair like that of `_stage_maps`."""
        part = block.measurements
        weight = np.ones(part.present.shape) if part.weight is None else part.weight
        if not part.scatter:
            return None, np.asarray(np.linalg.inv(whitener(part.covariance)), dtype=np.float64)
        identity = np.eye(3 * weight.shape[1]).reshape(*weight.shape[1:], 3, -1)
        whiten = block.whiten(np.broadcast_to(identity, (len(weight), *identity.shape)))
        back = np.linalg.inv(whiten.reshape(len(weight), identity.shape[-1], -1))
        return np.asarray(np.repeat(np.sqrt(weight), 3, axis=1)[..., None] * back, dtype=np.float64), None


def _least_root_weights(measurements: Measurements) -> FloatArray | float:
    """Return the root (B, 1, 1) of the least weight of each observation's targets; 1 without weights.

    With a robust loss, a pose gets the least weight of its targets.
    """
    if measurements.weight is None:
        return 1.0
    least_weight = np.where(measurements.present, measurements.weight, 1.0).min(axis=1)
    return np.asarray(np.sqrt(least_weight)[:, None, None])


@dataclass(frozen=True, eq=False)
class MethodRows:
    """Compressed rows of a campaign for each stage of a method, in units of sigma."""

    method: Method  #: the method with its stages
    statements: Statements  #: statements that are fitted with the joints, with K unknowns
    #: triangle of all readings, weighted by covariance, with the statements projected out. Residuals, sigma
    #: and degrees of freedom are computed on this triangle, whatever the method fits
    all_readings: Triangle
    stages: tuple[Triangle, ...]  #: triangle of each stage, with the statements projected out
    #: triangle of each stage's `StageRows.spread`; None where rows are weighted by covariance
    spreads: tuple[Triangle, ...] | None
    #: (n, n) weighted covariance between the readings of the two stages: ``A₂ᵀΩ₂ Σ Ω₁A₁``
    cross: FloatArray
    #: excitation of the joints as the motion of the wrist centre shows it; decoupled method only
    seen_from_centre: Excitation
    columns: FloatArray  #: (m, n + K) compressed columns of all readings, then a row for each statement
    #: (K, n + 1) unknowns of the statements that one unit of each joint's column, and the readings, call for
    to_unknowns: FloatArray

    @classmethod
    def compress(cls, method: Method, rows: Rows, statements: Statements | None = None) -> MethodRows:
        """Compress the rows of all observations.

        Args:
            method: the method with its stages.
            rows: N observations.
            statements: statements to be fitted with the joints; only for a method of one stage.
        """
        n = rows.robot.n
        statements = statements or Statements.none(n)
        generated = statements.generate(rows, [JOINTS])
        first = next(generated)
        count = first.targets.shape[-1] - 1 - n
        readings = Triangle(joints=n, statements=count)
        fitted = [Triangle(joints=n, statements=count) for _ in method.stages]
        spreads = [Triangle(joints=n) for _ in method.stages]
        cross, seen_from_centre = np.zeros((n, n)), Excitation(method.joint_kinds)
        for of_block in chain([first], generated):
            readings.add(of_block.flat, count=int(of_block.read.sum()))
            if method.is_plain:
                continue
            stage_rows = list(method.map_rows(of_block))
            for stage, mapped in enumerate(stage_rows):
                fitted[stage].add(mapped.fitted)
                if mapped.spread is not None:
                    spreads[stage].add(mapped.spread[..., [*range(n), -1]])
            if len(stage_rows) > 1:
                arm, wrist = (mapped.list_spread_columns(of_block, n) for mapped in stage_rows)
                cross += wrist.T @ arm
                seen_from_centre.add_wrist_centre(of_block.block, method.centre)
        stages = [readings] if method.is_plain else fitted
        sigma = statements.sigma
        # Each unknown of a cause that was fitted to the readings before uses up one degree of freedom.
        readings.rows -= fitted_errors(rows.measurements).determined
        all_readings, *others = [
            triangle.given("statements", np.ones(count), sigma) if count else triangle
            for triangle in ([readings] if method.is_plain else [readings, *fitted])
        ]
        return cls(
            method=method,
            statements=statements,
            all_readings=all_readings,
            stages=(all_readings,) if method.is_plain else tuple(others),
            spreads=None if method.by_covariance else tuple(spreads),
            cross=cross,
            seen_from_centre=seen_from_centre,
            columns=np.vstack([readings.matrix, np.eye(n + count)[n:] * sigma]),
            to_unknowns=_fit_unknowns(stages[-1].R, n, sigma),
        )

    def compress_again(self, rows: Rows) -> MethodRows:
        """Compress other observations by the same method, with the same statements."""
        return MethodRows.compress(self.method, rows, self.statements)

    def fit_statements(self, compliance: FloatArray) -> FittedStatements:
        """Return the statements with the values that fit best for given compliances (n,) [rad/(N·m)]."""
        return FittedStatements(self.statements, self.to_unknowns @ np.append(-compliance, 1.0))

    @property
    def determined_statement_count(self) -> float:
        """Effective number of unknowns of statements that the readings determine, ``tr(B (BᵀB + σ²)⁻¹ Bᵀ)``.

        B are the columns of the statements after projecting the joints out; σ is the noise of a reading.
        """
        n, statement_count = len(self.method.joint_names), len(self.to_unknowns)
        if not statement_count:
            return 0.0
        joints, columns = np.split(self.columns[:-statement_count], [n], axis=1)
        joint_basis = orthonormal_basis(unit_columns(joints)[0])
        columns = columns - joint_basis @ (joint_basis.T @ columns)
        squared_singular_values = np.square(np.linalg.svd(columns, compute_uv=False))
        return float((squared_singular_values / (squared_singular_values + self.statements.sigma**2)).sum())

    def build_columns(self, rows: Rows) -> FloatArray:
        """Return the whitened columns (m, n + K) of the targets of further readings.

        First the n joints, then the K unknowns of the statements, as in `columns`.
        """
        columns = [of_block.targets[..., :-1] for of_block in self.statements.generate(rows, [JOINTS])]
        return np.concatenate([each.reshape(-1, each.shape[-1]) for each in columns])

    def compute_responses(
        self,
        rows: Rows,
        terms: Sequence[Term],
        compliance: FloatArray,
        joints: IndexArray,
        prior: Prior | None = None,
    ) -> dict[str, FloatArray]:
        """Compute the bias of the estimate that one unit of each unknown of neglected terms causes.

        Without bounds the estimate is linear, ĉ = H d, so the bias is ``H A_term``.

        Args:
            rows: the observations that were compressed.
            terms: neglected terms.
            compliance: (n,) joint compliances at which the columns of the terms are computed [rad/(N·m)].
            joints: (p,) joints that are estimated.
            prior: prior of the fit.

        Returns:
            For each term's name the bias (n, k) that its k unknowns cause [rad/(N·m) per unit]; zero for
            joints that are not estimated.
        """
        n, count = len(self.method.joint_names), len(self.to_unknowns)
        moments: list[FloatArray | float] = [0.0] * len(self.stages)
        neglected = rows.generate(terms, compliance)
        fitted = self.statements.generate(rows, [JOINTS])
        for of_terms, of_joints in zip(neglected, fitted, strict=True):
            stage_rows = zip(self.method.map_rows(of_terms), self.method.map_rows(of_joints), strict=True)
            for stage, (mapped_terms, mapped_joints) in enumerate(stage_rows):
                columns = mapped_joints.fitted.reshape(-1, n + count + 1)[:, :-1]
                columns = columns[:, :n] - columns[:, n:] @ self.to_unknowns[:, :-1]
                flat = mapped_terms.fitted.reshape(-1, mapped_terms.fitted.shape[-1])
                moments[stage] = moments[stage] + columns.T @ flat[:, :-1]
            widths = of_terms.widths
        bias = np.zeros(np.shape(moments[0]))
        for stage_of_method, triangle, moment in zip(self.method.stages, self.stages, moments, strict=True):
            fitted_joints = np.intersect1d(stage_of_method.joints, joints)
            known_joints = np.intersect1d(stage_of_method.known, joints)
            matrix = triangle.matrix
            remaining = np.asarray(moment)[fitted_joints] - matrix[:, fitted_joints].T @ (
                matrix[:, known_joints] @ bias[known_joints]
            )
            columns = matrix[:, fitted_joints]
            with_prior = columns if prior is None else np.vstack([columns, prior.rows(fitted_joints)[0]])
            inverse = Spectrum(with_prior).inverse
            bias[fitted_joints] = inverse @ (inverse.T @ remaining)
        last_columns = np.cumsum([widths[term.name] for term in terms])[:-1]
        return dict(zip((term.name for term in terms), np.split(bias, last_columns, axis=1), strict=True))


def _fit_unknowns(rows: FloatArray, joints: int, sigma: float) -> FloatArray:
    """Return the unknowns (K, n + 1) of statements that fit each joint's column, and the readings, best.

    Args:
        rows: (m, n + K + 1) rows of the readings: columns of the joints, of the statements, of the readings.
        joints: number n of joints.
        sigma: standard uncertainty of a reading, by which statements are weighted.
    """
    columns = rows[:, joints:-1]
    count = columns.shape[1]
    if not count:
        return np.zeros((0, joints + 1))
    others = rows[:, [*range(joints), -1]]
    stated = np.vstack([columns, sigma * np.eye(count)])
    return np.asarray(
        np.linalg.lstsq(stated, np.vstack([others, np.zeros((count, joints + 1))]), rcond=None)[0]
    )


def factorise_displacement(block: RegressorBlock) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return factors Q R of the map from a rigid displacement of the flange to the whitened deflections.

    Target X moves by ``δp_X = δp_b + δφ × (P1X − b)``, with P1X its place and b the barycentre of the
    targets. The least-squares displacement (δp_b, δφ) is ``R⁻¹ Qᵀ W d`` with covariance ``(Rᵀ R)⁻¹`` in units
    of sigma²; W whitens the deflections d.

    Args:
        block: B observations with at least three targets each.

    Returns:
        Orthonormal Q (B, 3 T, 6), upper triangular R (B, 6, 6), and b (B, 3) in R0 [m].

    Raises:
        UnsupportedMethodError: if the targets of an observation lie on a line.
    """
    measurements = block.measurements
    present = measurements.present[..., None]
    reference = block.points.mean(axis=1, where=present)
    lever_arms = np.where(present, block.points - reference[:, None], 0.0)
    _refuse_lines(lever_arms)
    rotation_columns = -skew(lever_arms)
    displacement_columns = measurements.project_on_directions(
        np.concatenate([np.broadcast_to(np.eye(3), rotation_columns.shape), rotation_columns], axis=-1)
    )
    Q, R = np.linalg.qr(
        block.whiten(np.where(present[..., None], displacement_columns, 0.0)).reshape(len(lever_arms), -1, 6)
    )
    return Q, R, reference


def _refuse_lines(lever_arms: FloatArray) -> None:
    """Refuse observations whose targets lie on a line; lever arms (B, T, 3) are from their barycentre [m].

    Raises:
        UnsupportedMethodError: if the targets of an observation lie on a line.
    """
    singular_values = np.linalg.svd(lever_arms, compute_uv=False)
    collinear = np.flatnonzero(singular_values[:, 1] <= _COLLINEAR * singular_values[:, 0])
    if len(collinear):
        raise UnsupportedMethodError(
            "the targets lie on a line, so the flange's rotation about this line is not observable "
            f"({len(collinear)} observations)",
            where="readings",
            remedy="use method partial_pose, or place the three targets so that they form a triangle",
        )


def refuse_missing_poses(measurements: Measurements) -> None:
    """Refuse observations that have fewer than three targets with all coordinates read, or only a line.

    Raises:
        UnsupportedMethodError: names the first such observation.
    """
    counts = (measurements.coordinates == 3).sum(axis=1)
    too_few = np.flatnonzero(counts < MIN_TARGETS)
    if len(too_few):
        first = int(too_few[0])
        raise UnsupportedMethodError(
            f"the pose of the flange needs {MIN_TARGETS} targets, but {measurements.place(first)} has "
            f"{counts[first]} ({len(too_few)} of {len(counts)} observations have too few)",
            where=f"observations[{first}].readings",
            remedy="use method partial_pose, or read three targets in every observation",
        )
    present, in_flange = measurements.present, measurements.in_flange
    # Places in two frames form no line; `factorise_displacement` judges them by the robot.
    of_one_frame = (in_flange | ~present).all(axis=1) | ~(in_flange & present).any(axis=1)
    read = present[of_one_frame][..., None]
    position = measurements.position[of_one_frame]
    _refuse_lines(np.where(read, position - position.mean(axis=1, where=read)[:, None], 0.0))


def find_spherical_wrist(robot: Robot) -> Wrist:
    """Return the robot's spherical wrist, which the decoupled method needs.

    Raises:
        UnsupportedMethodError: if the robot has no spherical wrist.
    """
    wrist = find_wrist(robot)
    if wrist is None or robot.n == WRIST_JOINTS:
        raise UnsupportedMethodError(
            f"a robot with {robot.n} joints has no arm with a spherical wrist",
            where="method",
            remedy="use method partial_pose",
        )
    if not wrist.spherical:
        raise UnsupportedMethodError(
            f"the last three axes miss each other by {1e3 * wrist.miss_distance:.3g} mm, more than "
            f"{1e3 * Wrist.TOLERANCE:g} mm, so the wrist has no centre",
            where="method",
            remedy="use method partial_pose, or correct the robot's model",
        )
    return wrist


def find_length_of_least_condition(method: Method, rows: Rows, has_no_effect: BoolArray) -> float:
    """Return the length L [m] that minimises the condition number of the rows [A_v / L; A_ω].

    A_v are the rows of displacements, A_ω the rows of rotations (Khan & Angeles; method.md §3). Columns are
    first scaled to unit norm, as they are for the solution: otherwise the different sizes of the torques on
    arm and wrist dominate, and the least condition number is at an infinite length.

    Args:
        method: complete pose with a length of 1 m.
        rows: all observations.
        has_no_effect: (n,) joints that the readings do not see.

    Returns:
        L between 1 mm and 1 km [m].
    """
    n = len(has_no_effect)
    displacements, rotations = Triangle(joints=n), Triangle(joints=n)
    for of_block in rows.generate([JOINTS], np.zeros(n)):
        (mapped,) = method.map_rows(of_block)
        displacements.add(mapped.fitted[:, :3])
        rotations.add(mapped.fitted[:, 3:])
    linear, angular = (part.matrix[:, ~has_no_effect] for part in (displacements, rotations))

    def log_condition(decade: float) -> float:
        """Return the logarithm of the condition number for the length 10**decade [m]."""
        stacked = np.concatenate([linear / 10.0**decade, angular])
        singular_values = np.linalg.svd(stacked / np.linalg.norm(stacked, axis=0), compute_uv=False)
        return float(np.log(singular_values[0] / max(singular_values[-1], np.finfo(float).tiny)))

    # The condition number has several local minima where singular values cross: scan, then refine.
    grid = np.linspace(*_DECADES, 121)
    best = int(np.argmin([log_condition(decade) for decade in grid]))
    step = grid[1] - grid[0]
    refined = minimize_scalar(
        log_condition,
        bounds=(grid[best] - step, grid[best] + step),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return float(10.0 ** np.clip(refined.x, *_DECADES))
