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
from functools import cached_property, partial
from itertools import chain, pairwise
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from jointstiff.schemas.options import Method as MethodName
from jointstiff.schemas.options import RunOptions, Weighting
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, unit_columns
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fit.constraints import Bounds, Constraints, Order
from jointstiff.solver.fit.observability import Excitation, Spectrum
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.statements import FittedStatements, Statements
from jointstiff.solver.fit.triangle import Triangle, orthonormal_basis
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

        If elastic links are requested, the loss belongs to their model, and joints alone are fitted by
        squares. Contradictions between options are found here, before any work is done.

        Raises:
            RequestError: an option names a joint that the robot does not have, or the order of the joints
                contradicts itself or the bounds.
        """
        order = _order_from_options(options, robot)
        fits_joints_alone = options.elasticity in {"joints", "automatic"}
        uses_huber = options.loss == "huber" and fits_joints_alone
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
        settings.refuse_contradictions()
        return settings

    def refuse_contradictions(self) -> None:
        """Refuse an order of the joints that contradicts itself or the bounds.

        Raises:
            RequestError: names the contradiction.
        """
        _ = self.constraints  # which checks order and bounds

    @cached_property
    def constraints(self) -> Constraints:
        """Bounds and order of the compliances.

        Raises:
            RequestError: if order and bounds contradict each other.
        """
        return Constraints(self.bounds, self.order)


def _order_from_options(options: RunOptions, robot: Robot) -> Order:
    """Return the pairs (i, j) of joints, joint i at least as stiff as joint j, that chains of names state.

    A chain of joints, stiffest first, states a pair for each two neighbours.
    """
    pairs = []
    for names in options.stiffness_order:
        joints = [robot.joint_index(name, f"stiffness_order.{name}") for name in names]
        pairs += list(pairwise(joints))
    return tuple(dict.fromkeys(pairs))  # each pair once


def _bounds_from_options(options: RunOptions, robot: Robot, order: Order) -> Bounds:
    """Return the bounds of the compliances; joints in an order or with a stiffness bound are positive.

    A compliance is the inverse of a stiffness, so that the greatest stiffness gives the lower bound.
    """
    bounds = Bounds.positive(robot.n) if options.positive else Bounds.unconstrained(robot.n)
    lower, upper = bounds.lower.copy(), bounds.upper.copy()
    for pair in order:
        lower[list(pair)] = 0.0
    for name, (least_stiffness, greatest_stiffness) in options.stiffness_bounds.items():
        j = robot.joint_index(name, f"stiffness_bounds.{name}")
        lower[j] = 0.0 if greatest_stiffness is None else 1.0 / greatest_stiffness
        upper[j] = np.inf if least_stiffness is None else 1.0 / least_stiffness
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
    """Rows of B observations of T targets in one stage, which fits N M, with a linear map N of the rows M."""

    #: (B, r, K + 1) rows N M that are fitted: columns of all K unknowns, then of the readings; rows of the
    #: targets, then rows of the encoders of the stage's joints
    fitted: FloatArray
    mapped_twice: FloatArray  #: (B, 3 T, K + 1) NᵀN M, rows of the targets, for covariances

    @property
    def columns(self) -> FloatArray:
        """Columns (B r, K) of all terms, without the readings, with the rows of all observations together."""
        return self.fitted.reshape(-1, self.fitted.shape[-1])[:, :-1]


class _StageMap(NamedTuple):
    """Linear map N of the whitened rows of B observations of T targets; the identity if both are None."""

    of_observations: FloatArray | None = None  # (B, m, 3 T) map of the rows of whole observations
    of_targets: FloatArray | None = None  # (B, T, 3, 3) map of the rows of single targets


class Method:
    """A method with its weighting, as linear maps N of the whitened rows of the readings."""

    def __init__(self, robot: Robot, settings: Settings, length: float | None) -> None:
        """Choose the stages of the method: the least-squares problems that it solves one after the other.

        The decoupled method estimates the arm's joints, then the wrist's joints; all others have one stage.

        Args:
            robot: n joints.
            settings: method and weighting.
            length: characteristic length [m], if the weighting uses one.

        Raises:
            UnsupportedMethodError: the decoupled method, and the robot has no spherical wrist.
        """
        all_joints, no_joints = np.arange(robot.n), np.arange(0)
        self.joint_names, self.joint_kinds = robot.joint_names, robot.joint_kinds
        self.name, self.weighting = settings.method, settings.weighting
        self.characteristic_length = length
        self.length = 1.0 if settings.weighting == "uniform" else length
        self.stages: tuple[Stage, ...] = (Stage(all_joints, known=no_joints),)
        if settings.method == "decoupled_partial_pose":
            self.centre = find_spherical_wrist(robot).centre
            arm, wrist = all_joints[:-WRIST_JOINTS], all_joints[-WRIST_JOINTS:]
            self.stages = (Stage(arm, known=no_joints), Stage(wrist, known=arm))

    @property
    def by_covariance(self) -> bool:
        """True if the rows are weighted by their covariance, as in the likelihood."""
        return self.weighting == "covariance"

    @property
    def is_plain(self) -> bool:
        """True if the method fits the whitened rows of the readings as they are, without a linear map."""
        return self.by_covariance and self.name == "partial_pose"

    def map_rows(self, whitened: BlockRows) -> Iterator[StageRows]:
        """Yield the rows of B observations of T targets in each stage, in the order of the stages.

        A stage is a least-squares problem with N times the whitened rows M of the targets, N its own linear
        map. Covariances need ``NᵀN M``, too. Rows of the encoders of the stage's joints come last.

        Args:
            whitened: whitened rows of B observations, in units of sigma.

        Raises:
            UnsupportedMethodError: if the targets of an observation lie on a line, and a pose is needed.
        """
        by_target = whitened.targets  # (B, T, 3, K + 1)
        M = by_target.reshape(len(by_target), -1, by_target.shape[-1])  # (B, 3 T, K + 1)
        for stage, N in zip(self.stages, self._stage_maps(whitened.block), strict=True):
            N_M, NtN_M = M, M  # for N = I
            if N.of_observations is not None:
                N_M = N.of_observations @ M
                NtN_M = N.of_observations.mT @ N_M
            elif N.of_targets is not None:
                N_by_target = N.of_targets @ by_target
                NtN_M = (N.of_targets.mT @ N_by_target).reshape(M.shape)
                N_M = N_by_target.reshape(M.shape)
            fitted = N_M
            if whitened.encoders is not None:
                fitted = np.concatenate([N_M, whitened.encoders[:, stage.joints]], axis=1)
            yield StageRows(fitted, mapped_twice=NtN_M)

    def _stage_maps(self, block: RegressorBlock) -> list[_StageMap]:
        """Return for each stage of the method the linear map N of the whitened rows of observations.

        The partial pose uses the positions of the targets, the complete pose that of the flange, and the
        decoupled method first that of the wrist centre, then the targets again. With a weighting other than
        that by covariance, the map to the targets undoes the whitening.
        """
        identity = _StageMap()
        to_targets = identity if self.by_covariance else self._undo_whitening(block)
        if self.name == "partial_pose":
            return [to_targets]
        if self.name == "complete_pose":
            return [_StageMap(of_observations=self._map_to_pose(block))]
        to_wrist_centre = _StageMap(of_observations=self._map_to_wrist_centre(block))
        return [to_wrist_centre, to_targets]

    def _map_to_pose(self, block: RegressorBlock) -> FloatArray:
        """Return the map (B, 6, 3 T) from whitened rows to the displacement of the flange's pose.

        With factors Q R of the whitened map from the displacement to the deflections, the displacement is
        R⁻¹ Qᵀ times the rows, of covariance (Rᵀ R)⁻¹. R whitens it if the method uses covariances, which
        leaves the map Qᵀ. Else its translation is divided by the method's length, so that translation and
        rotation have the same unit.
        """
        factors = factorise_displacement(block)
        if self.by_covariance:
            return factors.Q.mT
        displacement_map = np.linalg.solve(factors.R, factors.Q.mT)
        scale_of_translation, scale_of_rotation = 1.0 / (self.length or 1.0), 1.0
        row_scale = np.repeat([scale_of_translation, scale_of_rotation], 3)  # three coordinates each
        scaled_map = row_scale[:, None] * displacement_map
        return np.asarray(_find_least_root_weights(block.measurements) * scaled_map)

    def _map_to_wrist_centre(self, block: RegressorBlock) -> FloatArray:
        """Return the map (B, 3, 3 T) from whitened rows to the displacement of the wrist centre.

        The displacement is whitened if the method uses covariances.
        """
        factors = factorise_displacement(block)  # Q R of the targets' motion by a displacement of the flange
        B = len(factors.Q)
        # Map (B, 6, 3 T) to the translation of the barycentre of the targets, and the rotation of the flange
        displacement_map = np.linalg.solve(factors.R, factors.Q.mT)
        centre_in_flange = np.broadcast_to(self.centre, (B, 1, 3))
        centre = block.postures.to_base(centre_in_flange)[:, 0]  # (B, 3)
        # δp_centre = δp_b + δφ × (centre − b) = [I, −skew(centre − b)] (δp_b, δφ), b the barycentre
        identity = np.broadcast_to(np.eye(3), (B, 3, 3))
        to_centre = np.concatenate([identity, -skew(centre - factors.barycentre)], axis=2)
        centre_map = to_centre @ displacement_map
        if self.by_covariance:
            # A map of whitened rows gives a whitened displacement if its own rows are orthonormal.
            orthonormal_columns, _ = np.linalg.qr(centre_map.mT)
            return orthonormal_columns.mT
        return np.asarray(_find_least_root_weights(block.measurements) * centre_map)

    @staticmethod
    def _undo_whitening(block: RegressorBlock) -> _StageMap:
        """Return the map N from whitened rows back to the readings, times the roots S of their weights.

        The weights are those of a robust fit, and 1 for the squared loss.
        """
        measurements = block.measurements
        if not measurements.scatter:  # errors of different targets are independent
            inverse_whitener = np.linalg.inv(whitener(measurements.covariance))
            return _StageMap(of_targets=np.asarray(inverse_whitener, dtype=np.float64))
        B, T = measurements.present.shape
        weight = np.ones((B, T)) if measurements.weight is None else measurements.weight
        # Whiten the unit vector of each coordinate to get the matrix W of each observation.
        unit_vectors = np.broadcast_to(np.eye(3 * T).reshape(T, 3, 3 * T), (B, T, 3, 3 * T))
        W = block.whiten(unit_vectors).reshape(B, 3 * T, 3 * T)
        S = np.sqrt(weight).repeat(3, axis=1)[..., None]  # (B, 3 T, 1)
        return _StageMap(of_observations=np.asarray(S * np.linalg.inv(W), dtype=np.float64))


def _find_least_root_weights(measurements: Measurements) -> FloatArray | float:
    """Return the root (B, 1, 1) of the least weight of each observation's targets; 1 without weights.

    A robust fit gives the weights of single targets, but a pose of the flange needs one weight.
    """
    if measurements.weight is None:
        return 1.0
    weights = np.where(measurements.present, measurements.weight, 1.0)  # (B, T)
    return np.asarray(np.sqrt(weights.min(axis=1))[:, None, None])


class _MethodSums:
    """Triangular factors and products of a method's rows, summed block by block.

    Attributes:
        readings: triangular factor of all whitened rows.
        fitted: triangular factor of the rows that each stage fits; not used by a plain method.
        spreads: triangular factor of the rows ``NᵀN [A d]`` of each stage, with the stage's linear map N.
        cross: (n, n) products of these columns of the wrist's and the arm's stage.
        seen_from_centre: effect of the joints on the wrist centre, for the decoupled method.
    """

    def __init__(self, method: Method, n: int, K: int) -> None:
        """Start without rows, for n joints and K errors that are fitted with the joints."""
        self._method, self._n = method, n
        self.readings = Triangle(joints=n, statements=K)
        self.fitted = [Triangle(joints=n, statements=K) for _ in method.stages]
        self.spreads = [Triangle(joints=n) for _ in method.stages]
        self.cross: FloatArray = np.zeros((n, n))
        self.seen_from_centre = Excitation(method.joint_kinds)

    def add(self, block_rows: BlockRows) -> None:
        """Add the whitened rows of a block of observations, as they are and as each stage fits them.

        A plain method fits them as they are.
        """
        self.readings.add(block_rows.flat, count=int(block_rows.read.sum()))
        if self._method.is_plain:
            return
        stages = list(self._method.map_rows(block_rows))
        for stage_rows, fitted in zip(stages, self.fitted, strict=True):
            fitted.add(stage_rows.fitted)
        if not self._method.by_covariance:
            joints_and_readings = [*range(self._n), -1]
            for stage_rows, spread in zip(stages, self.spreads, strict=True):
                spread.add(stage_rows.mapped_twice[..., joints_and_readings])
        if len(stages) > 1:
            arm, wrist = stages
            arm_columns = arm.mapped_twice[..., : self._n].reshape(-1, self._n)  # (B 3 T, n) of the joints
            wrist_columns = wrist.mapped_twice[..., : self._n].reshape(-1, self._n)
            self.cross += wrist_columns.T @ arm_columns
            self.seen_from_centre.add_wrist_centre(block_rows.block, self._method.centre)


@dataclass(frozen=True, eq=False)
class MethodRows:
    """Compressed rows of a campaign for each stage of a method, in units of sigma."""

    method: Method  #: the method with its stages
    statements: Statements  #: errors of stated uncertainty, fitted with the joints, K unknowns
    #: triangle of all readings, weighted by covariance, with the stated errors projected out. Residuals,
    #: sigma and degrees of freedom are computed on this triangle, whatever the method fits
    all_readings: Triangle
    triangles: tuple[Triangle, ...]  #: rows of each stage, with the stated errors projected out
    #: triangle of each stage's `StageRows.mapped_twice`; None where rows are weighted by covariance
    spreads: tuple[Triangle, ...] | None
    #: (n, n) weighted covariance between the readings of the two stages: ``A₂ᵀΩ₂ Σ Ω₁A₁``
    cross: FloatArray
    #: excitation of the joints as the motion of the wrist centre shows it; decoupled method only
    seen_from_centre: Excitation
    columns: FloatArray  #: (m, n + K) compressed columns of all readings, then a row for each stated error
    fitted: FloatArray  #: (m, n + K + 1) rows of the last stage, before the stated errors are projected out

    @classmethod
    def compress(
        cls,
        method: Method,
        rows: Rows,
        statements: Statements | None = None,
        excitation: Excitation | None = None,
    ) -> MethodRows:
        """Compress the rows of all observations to triangular factors R, with RᵀR = AᵀA for rows A.

        Args:
            method: the method with its stages, which are least-squares problems.
            rows: N observations.
            statements: errors of stated uncertainty, fitted with the joints; only for a method of one stage.
            excitation: sums to which the observations are added in the same pass; None without any. The
                kinematics of a large set are computed anew by each pass.
        """
        n = rows.robot.n
        statements = statements or Statements.none(n)
        blocks = statements.generate(rows, [JOINTS])
        first = next(blocks)
        column_count = first.targets.shape[-1]  # n joints, K stated errors, the readings
        K = column_count - n - 1
        sums = _MethodSums(method, n, K)
        for block_rows in chain([first], blocks):
            sums.add(block_rows)
            if excitation is not None:
                excitation.add(block_rows.block)
        # Each unknown of a cause that was fitted to the readings before uses up one degree of freedom.
        sums.readings.rows -= fitted_errors(rows.measurements).determined
        sigma = statements.sigma
        all_readings = _project_out_stated_errors(sums.readings, K, sigma)
        if method.is_plain:  # the method fits all readings as they are
            fitted, triangles = [sums.readings], [all_readings]
        else:
            fitted = sums.fitted
            triangles = [_project_out_stated_errors(triangle, K, sigma) for triangle in fitted]
        rows_of_statements = np.eye(n + K)[n:] * sigma  # each error is 0 ± 1
        return cls(
            method=method,
            statements=statements,
            all_readings=all_readings,
            triangles=tuple(triangles),
            spreads=None if method.by_covariance else tuple(sums.spreads),
            cross=sums.cross,
            seen_from_centre=sums.seen_from_centre,
            columns=np.vstack([sums.readings.matrix, rows_of_statements]),
            fitted=fitted[-1].R,
        )

    @cached_property
    def to_unknowns(self) -> FloatArray:
        """Stated errors (K, n + 1) that fit one unit of each joint's column, and the readings, best."""
        return _fit_errors_to_columns(self.fitted, len(self.method.joint_names), self.statements.sigma)

    def fit_statements(self, compliance: FloatArray) -> FittedStatements:
        """Return the stated errors with the values that fit best for given compliances (n,) [rad/(N·m)].

        The errors fit what the joints leave of the readings, ``d − A c``, so that they are the same
        combination of those that fit the readings d and the columns of A best.
        """
        readings_minus_joints = np.append(-compliance, 1.0)
        return FittedStatements(self.statements, self.to_unknowns @ readings_minus_joints)

    @property
    def determined_statement_count(self) -> float:
        """Effective number of stated errors that the readings determine, ``tr(B (BᵀB + σ²)⁻¹ Bᵀ)``.

        B are the columns of K errors of stated uncertainty, such as errors of the load, with the columns of
        the joints projected out; σ is the noise of a reading. An error counts 1 if the readings determine it,
        and 0 if only its stated uncertainty does.
        """
        n, K = len(self.method.joint_names), len(self.to_unknowns)
        if not K:
            return 0.0
        columns_of_readings = self.columns[:-K]  # the last K rows state the errors
        of_joints, of_errors = columns_of_readings[:, :n], columns_of_readings[:, n:]
        unit_columns_of_joints, _ = unit_columns(of_joints)
        basis = orthonormal_basis(unit_columns_of_joints)
        B = of_errors - basis @ (basis.T @ of_errors)
        squares = np.square(np.linalg.svd(B, compute_uv=False))
        return float((squares / (squares + self.statements.sigma**2)).sum())

    def build_columns(self, rows: Rows) -> FloatArray:
        """Return the whitened columns (m, n + K) of the targets of further readings.

        First the n joints, then the K stated errors, as in `columns`.
        """
        blocks = []
        for block_rows in self.statements.generate(rows, [JOINTS]):
            columns = block_rows.targets[..., :-1]  # (B, T, 3, n + K), without the readings
            blocks.append(columns.reshape(-1, columns.shape[-1]))
        return np.concatenate(blocks)

    def compute_responses(
        self,
        rows: Rows,
        terms: Sequence[Term],
        compliance: FloatArray,
        joints: IndexArray,
        prior: Prior | None = None,
    ) -> dict[str, FloatArray]:
        """Compute the bias of the estimate that one unit of each unknown of neglected terms causes.

        A term is an error or effect that moves the targets in proportion to its k unknowns. Without bounds
        the estimate is linear in the readings d, ĉ = H d. The term adds its columns A_term to the readings,
        but nothing to the prior, so that the bias is ``H A_term``.

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
        products_of_stages, widths = self._multiply_by_terms(rows, terms, compliance)
        bias = np.zeros(products_of_stages[0].shape)  # of all joints, filled in stage by stage
        of_stages = zip(self.method.stages, self.triangles, products_of_stages, strict=True)
        for stage, triangle, products in of_stages:
            fitted_joints = np.intersect1d(stage.joints, joints)
            known_joints = np.intersect1d(stage.known, joints)  # estimated by an earlier stage
            A, A_known = triangle.matrix[:, fitted_joints], triangle.matrix[:, known_joints]
            # The bias b of the fitted joints solves (AᵀA + PᵀP) b = Aᵀ (A_term − A_known b_known), with the
            # rows P of a prior.
            rhs = products[fitted_joints] - A.T @ (A_known @ bias[known_joints])
            if prior is not None:
                P, _ = prior.rows(fitted_joints)
                A = np.vstack([A, P])
            inverse = Spectrum(A).inverse  # pseudo-inverse A⁺ of all rows, so (AᵀA)⁻¹ = A⁺ A⁺ᵀ
            bias[fitted_joints] = inverse @ (inverse.T @ rhs)
        bias_by_term, start = {}, 0
        for term in terms:
            stop = start + widths[term.name]
            bias_by_term[term.name] = bias[:, start:stop]
            start = stop
        return bias_by_term

    def _multiply_by_terms(
        self, rows: Rows, terms: Sequence[Term], compliance: FloatArray
    ) -> tuple[list[FloatArray], dict[str, int]]:
        """Return for each stage the products ``Aᵀ A_term`` (n, K) of the columns of joints and of terms.

        Where errors are fitted with the joints, A is what their columns leave of the joints' columns.

        Args:
            rows: the observations that were compressed.
            terms: terms with K unknowns together, a column for each.
            compliance: (n,) joint compliances at which the columns of the terms are computed [rad/(N·m)].

        Returns:
            The products for each stage, and the number of columns of each term, by the term's name.
        """
        n = len(self.method.joint_names)
        errors_of_joints = self.to_unknowns[:, :-1]  # fitted errors that explain each joint's column best
        products: list[FloatArray] = [np.zeros(()) for _ in self.triangles]
        widths: dict[str, int] = {}
        joint_blocks = self.statements.generate(rows, [JOINTS])
        for of_terms, of_joints in zip(rows.generate(terms, compliance), joint_blocks, strict=True):
            stage_rows = zip(self.method.map_rows(of_terms), self.method.map_rows(of_joints), strict=True)
            for stage, (term_rows, joint_rows) in enumerate(stage_rows):
                joint_columns, error_columns = joint_rows.columns[:, :n], joint_rows.columns[:, n:]
                A = joint_columns - error_columns @ errors_of_joints
                products[stage] = products[stage] + A.T @ term_rows.columns
            widths = of_terms.widths  # the same in all blocks
        return products, widths


def _project_out_stated_errors(triangle: Triangle, count: int, sigma: float) -> Triangle:
    """Return the triangle of the other columns, in which `count` stated errors are fitted, each 0 ± 1."""
    if not count:
        return triangle
    return triangle.project_out_stated("statements", np.ones(count), sigma)


def _fit_errors_to_columns(rows: FloatArray, joints: int, sigma: float) -> FloatArray:
    """Return the stated errors (K, n + 1) that fit each joint's column, and the readings, best.

    The best U minimises ``‖B U − Y‖² + sigma² ‖U‖²``, with the columns B of the errors, and the columns Y
    of the joints and the readings.

    Args:
        rows: (m, n + K + 1) rows of the readings: columns of the joints, of the errors, of the readings.
        joints: number n of joints.
        sigma: standard uncertainty of a reading, by which the errors are weighted.
    """
    B = rows[:, joints:-1]
    Y = rows[:, [*range(joints), -1]]
    K = B.shape[1]
    if not K:
        return np.zeros((0, joints + 1))
    with_statements = np.vstack([B, sigma * np.eye(K)])
    rhs = np.vstack([Y, np.zeros((K, joints + 1))])
    return np.asarray(np.linalg.lstsq(with_statements, rhs, rcond=None)[0])


class DisplacementFactors(NamedTuple):
    """Factors Q R of the map from a rigid displacement of the flange to the whitened deflections."""

    Q: FloatArray  # (B, 3 T, 6) orthonormal columns
    R: FloatArray  # (B, 6, 6) upper triangular
    barycentre: FloatArray  # (B, 3) of the targets, the point whose translation is meant, in R0 [m]


def factorise_displacement(block: RegressorBlock) -> DisplacementFactors:
    """Return factors Q R of the map from a rigid displacement of the flange to the whitened deflections.

    Target X moves by ``δp_X = δp_b + δφ × (P1X − b)``, with P1X its place and b the barycentre of the
    targets. The least-squares displacement (δp_b, δφ) is ``R⁻¹ Qᵀ W d`` with covariance ``(Rᵀ R)⁻¹`` in units
    of sigma²; W whitens the deflections d.

    Args:
        block: B observations with at least three targets each.

    Raises:
        UnsupportedMethodError: if the targets of an observation lie on a line.
    """
    measurements = block.measurements
    present = measurements.present[..., None]  # (B, T, 1)
    barycentre = block.points.mean(axis=1, where=present)
    lever_arms = np.where(present, block.points - barycentre[:, None], 0.0)
    _refuse_lines(lever_arms)
    # δp_X = [I, −skew(lever arm)] (δp_b, δφ): a matrix (3, 6) for each target
    rotation_columns = -skew(lever_arms)
    translation_columns = np.broadcast_to(np.eye(3), rotation_columns.shape)
    columns = measurements.project_on_directions(
        np.concatenate([translation_columns, rotation_columns], axis=-1)
    )
    whitened = block.whiten(np.where(present[..., None], columns, 0.0))  # (B, T, 3, 6)
    Q, R = np.linalg.qr(whitened.reshape(len(lever_arms), -1, 6))
    return DisplacementFactors(Q, R, barycentre)


def _refuse_lines(lever_arms: FloatArray) -> None:
    """Refuse observations whose targets lie on a line; lever arms (B, T, 3) are from their barycentre [m].

    Raises:
        UnsupportedMethodError: if the targets of an observation lie on a line.
    """
    singular_values = np.linalg.svd(lever_arms, compute_uv=False)
    length, height = singular_values[:, 0], singular_values[:, 1]
    line_count = int((height <= _COLLINEAR * length).sum())
    if line_count:
        raise UnsupportedMethodError(
            "the targets lie on a line, so the flange's rotation about this line is not observable "
            f"({line_count} observations)",
            where="readings",
            remedy="use method partial_pose, or place the three targets so that they form a triangle",
        )


def refuse_missing_poses(measurements: Measurements) -> None:
    """Refuse observations that have fewer than three targets with all coordinates read, or only a line.

    Raises:
        UnsupportedMethodError: names the first such observation.
    """
    is_read_completely = measurements.coordinates == 3  # (N, T) all three coordinates
    target_counts = is_read_completely.sum(axis=1)
    too_few = np.flatnonzero(target_counts < MIN_TARGETS)
    if len(too_few):
        first = int(too_few[0])
        raise UnsupportedMethodError(
            f"the pose of the flange needs {MIN_TARGETS} targets, but {measurements.place(first)} has "
            f"{target_counts[first]} ({len(too_few)} of {len(target_counts)} observations have too few)",
            where=f"observations[{first}].readings",
            remedy="use method partial_pose, or read three targets in every observation",
        )
    # Positions in two frames, flange and base, cannot be compared without the robot's kinematics. Whether
    # such targets form a triangle is checked when they are fitted.
    present, in_flange = measurements.present, measurements.in_flange
    all_in_flange = (in_flange | ~present).all(axis=1)
    none_in_flange = ~(in_flange & present).any(axis=1)
    has_one_frame = all_in_flange | none_in_flange
    position, is_read = measurements.position[has_one_frame], present[has_one_frame][..., None]
    barycentre = position.mean(axis=1, where=is_read)
    _refuse_lines(np.where(is_read, position - barycentre[:, None], 0.0))


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
    translation, rotation = slice(0, 3), slice(3, 6)  # rows of the flange's displacement
    for block_rows in rows.generate([JOINTS], np.zeros(n)):
        (only_stage,) = method.map_rows(block_rows)
        displacements.add(only_stage.fitted[:, translation])
        rotations.add(only_stage.fitted[:, rotation])
    A_v = displacements.matrix[:, ~has_no_effect]
    A_omega = rotations.matrix[:, ~has_no_effect]
    log_condition = partial(_compute_log_condition, A_v, A_omega)
    # The condition number has several local minima where singular values cross: scan, then refine.
    grid = np.linspace(*_DECADES, 121)
    best = grid[np.argmin([log_condition(decade) for decade in grid])]
    step = grid[1] - grid[0]
    refined = minimize_scalar(
        log_condition, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-10}
    )
    return float(10.0 ** np.clip(refined.x, *_DECADES))


def _compute_log_condition(A_v: FloatArray, A_omega: FloatArray, decade: float) -> float:
    """Return the logarithm of the condition number of [A_v / L; A_ω] with unit columns, L = 10**decade [m].

    Args:
        A_v: (m, p) rows of displacements.
        A_omega: (m, p) rows of rotations.
        decade: decimal logarithm of the length L.
    """
    stacked = np.concatenate([A_v / 10.0**decade, A_omega])
    unit_columns_of_stacked = stacked / np.linalg.norm(stacked, axis=0)
    singular_values = np.linalg.svd(unit_columns_of_stacked, compute_uv=False)
    return float(np.log(singular_values[0] / max(singular_values[-1], np.finfo(float).tiny)))
