"""Models of the loaded robot: elastic joints in the exact balance, elastic links, and the model error.

Elastic joints balance springs, load and own weight. Links bend to first order in the load (method.md §9).
The covariance of elastic models follows from Bayesian least squares: the readings, and a normal prior of the
penalised entries about zero. Its standard deviation is half the root mean square of the elements' traces, in
units of the penalty. The cone is neglected. Entries that the readings do not determine have the uncertainty
of the prior, which follows from how much the links bend on the whole.

The model error is an empirical bound from postures held out, one after the other (method.md §11): if a new
posture is exchangeable with the measured postures, every rank of its score among their scores is as likely
(Vovk, Gammerman & Shafer, *Algorithmic Learning in a Random World*, 2005). The scores of all targets of a
posture count together as one posture (Lee, Barber & Willett, *Distribution-free inference with hierarchical
data*, 2023). Here each score comes from another fit, so the argument is no proof: residuals of held-out
postures have no guarantee without assumptions on their distribution (Barber, Candès, Ramdas & Tibshirani,
*Predictive inference with the jackknife+*, 2021).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil
from typing import ClassVar, Final

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial.transform import Rotation

from jointstiff.schemas.options import CrossValidation
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.choice.held_out import Folds, fit_fold
from jointstiff.solver.errors import CasesError, RequestError, SolverError
from jointstiff.solver.evidence.resampling import build_method_stacks, fit_subsets
from jointstiff.solver.fit.cone import find_diagonal_entries, to_matrix
from jointstiff.solver.fit.constraints import Constraints
from jointstiff.solver.fit.elastic import ElasticFit
from jointstiff.solver.fit.estimate import Estimate, PostureJackknife, compute_interval_ends
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.observability import Spectrum
from jointstiff.solver.fit.part import generate_elastic_rows
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stages import Likelihood
from jointstiff.solver.mechanics.block import (
    Balance,
    LoadedJoints,
    OwnWeight,
    find_balance,
    spring_frames,
    wrench_stiffness,
)
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures, rotation_vectors, skew
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import differentiate_bilinear_form
from jointstiff.solver.models import Columns
from jointstiff.solver.predict.forward import (
    LARGEST_TURN,
    CartesianCompliance,
    Deflection,
    ForwardModel,
    greatest_deviation,
)

_UNSEEN: Final = 1e-9
"""Relative size below which the part of a row in undetermined directions counts as rounding."""
_BLOCK: Final = 500
"""Number of rows whose interval ends are computed at once, to save memory: each row needs n × n matrices."""
_LEAST_SIGMA: Final = 1e-15
"""Least standard uncertainty of a reading [m]: the rounding of a position."""
_WEIGHT_STEPS: Final = 8
"""Number of iterations for the own weight in the commanded posture; each gains three digits."""
_TILT: Final = 5e-3
"""Torque of own weight about a nominally vertical axis, relative to the greatest torque, that counts as
zero."""
_SOFTEST: Final = 0.5
"""Greatest fraction by which a load may reduce a joint's stiffness; loads of real processes reduce it
less."""
_SHARE_OF_TRACE: Final = 0.5
"""Prior standard deviation of an entry relative to the elements' root mean square trace. In simulations with
beams, 95 % intervals then contain 97 % (20 and 40 postures) and 95 % (100) of the true displacements."""
_JOINT_PRIOR: Final = 10.0
"""Prior standard deviation of a joint's compliance, relative to one that would explain all deflections."""
_LEAST_PRIOR: Final = 1e-6
"""Least prior standard deviation of an entry, for models in which no element bends."""
_NEWTON_STEPS: Final = 20
_REACHED: Final = 1e-12
"""Distance [m] and angle [rad] from the wanted pose that count as rounding."""
_DAMPING: Final = 1e-12


@dataclass(frozen=True, eq=False)
class IdentifiedWeight(OwnWeight):
    """Own weight that was identified together with the compliances, so that deflections include the sag."""

    absolute: ClassVar[bool] = True

    #: (n + 4 n², r) root of the covariance: rows of all c_j, then for each j and each link l the four rows of
    #: c_j m_jl and c_j m_jl s_jl (mass, and mass times centre) [rad/(N·m), times kg, kg·m]
    root: FloatArray = field(kw_only=True)

    def compute_turn_root(self, postures: Postures, torque: FloatArray) -> FloatArray:
        """Return a root L (B, n, r) of the covariance of the joints' deflections in B postures [rad].

        L Lᵀ is the covariance [rad²] of the deflections of the n joints, due to the uncertainty of the
        compliances and of the own weight.

        Args:
            postures: B postures.
            torque: (B, n) torques of the loads alone [N·m].
        """
        n = len(torque.T)
        # Torques (B, n, n, 4) per unit of mass, and of mass times centre, of each link
        unit_torques = postures.weight_levers @ self.gravity
        weight_part = np.einsum("bjlp,jlpr->bjr", unit_torques, self.root[n:].reshape(n, n, 4, -1))
        return np.asarray(torque[..., None] * self.root[:n] + weight_part)


@dataclass(frozen=True, eq=False)
class JointModel(ForwardModel):
    """Elastic joints: the exact balance of springs, load and own weight."""

    first_order = False

    compliance: FloatArray  #: (n,) [rad/(N·m)]; zero where nothing is known
    #: likelihood of the compliances that the readings show, without constraints, in SI units; None if unknown
    likelihood: Likelihood | None
    constraints: Constraints  #: constraints on all n compliances
    #: own weight of the links; None neglects it, as the zero of the controller's angles includes the sag;
    #: with an identified weight, deflections include the sag
    weight: OwnWeight | None = None

    @classmethod
    def from_estimate(cls, robot: Robot, estimate: Estimate, constraints: Constraints) -> JointModel:
        """Build the model from an estimate of the compliances and its constraints."""
        likelihood = estimate.likelihood if estimate.covariance is not None else None
        if likelihood is not None:
            likelihood = likelihood.multiply_covariance(max(float(estimate.sigma or 0.0), _LEAST_SIGMA) ** 2)
        freedom = None if estimate.sigma_given else estimate.degrees_of_freedom
        return cls(robot, estimate.compliance, likelihood, constraints, degrees_of_freedom=freedom)

    @cached_property
    def covariance(self) -> FloatArray:
        """(n, n) covariance of the unconstrained estimate [(rad/(N·m))²]; zero without an estimate."""
        covariance = np.zeros((self.robot.n, self.robot.n))
        if self.likelihood is not None:
            covariance[np.ix_(self.likelihood.joints, self.likelihood.joints)] = self.likelihood.covariance
        return covariance

    @cached_property
    def root(self) -> FloatArray:
        """Root L (n, n) of the covariance L Lᵀ of the unconstrained estimate [rad/(N·m)]."""
        values, vectors = np.linalg.eigh(self.covariance)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    def deflect(
        self, cases: LoadCases, unloaded: Postures | None = None, near: Postures | None = None
    ) -> JointDeflection:
        """Compute the deflections in the exact balance of springs and loads.

        Args:
            cases: B load cases.
            unloaded: postures without load; computed from the cases if None.
            near: start of the search for the loaded postures; the unloaded postures if None.

        Raises:
            RequestError: a load has no stable equilibrium near the unloaded posture.
        """
        unloaded = self.unloaded(cases) if unloaded is None else unloaded
        start = None
        if near is not None:
            start = LoadedJoints.compute(self.robot, self.compliance, cases, self.weight, near)
        return self.balance_loads(cases, unloaded, start)

    def balance_loads(
        self, cases: LoadCases, unloaded: Postures, start: LoadedJoints | None = None
    ) -> JointDeflection:
        """Compute the deflections of B load cases from unloaded postures; see `find_balance`."""
        equilibrium = find_balance(self.robot, self.compliance, cases, self.weight, unloaded, start)
        loaded = equilibrium.joints.postures
        reached = loaded.to_base(cases.place[:, None])
        jacobian = loaded.pose_jacobian_at(reached)
        # The last step of the balance is added to first order, which saves another computation of kinematics.
        pose_step = (jacobian @ equilibrium.step[..., None])[..., 0]
        axes = loaded.flange_rotation + skew(pose_step[:, 3:]) @ loaded.flange_rotation
        return JointDeflection(
            model=self,
            cases=cases,
            unloaded=unloaded,
            place=reached[:, 0] + pose_step[:, :3],
            axes=axes,
            balance=equilibrium,
            jacobian=jacobian,
        )

    def compute_commands(self, cases: LoadCases, goal: Postures, share: FloatArray) -> FloatArray:
        """Compute the joint angles (B, n) to command [rad] so that the loaded joints reach those of `goal`.

        ``q_cmd = θ − s c ∘ (τ(θ) + g(θ) − g(q_cmd))`` with θ the angles of the goal, c (n,) the compliances,
        τ the
        torques of the load and g the torques of own weight. If the run also identified the effect of own
        weight
        (`weight.absolute`), deflections include the sag, and g(q_cmd) is left out.

        Args:
            cases: B loads and their load points.
            goal: B postures that the loaded arm must reach.
            share: (B,) share s of the correction that is applied, 0 to 1.
        """
        scaled_compliance = share[:, None] * self.compliance
        joint_torque = goal.load(cases.load_point, cases.force, cases.moment)[1]
        commanded: FloatArray = goal.q - scaled_compliance * joint_torque
        if self.weight is None:
            return commanded
        joint_torque = joint_torque + self.weight.torque_and_stiffness(self.robot, goal)[0]
        if self.weight.absolute:
            return goal.q - scaled_compliance * joint_torque
        for _ in range(_WEIGHT_STEPS):
            weight_torque = self.weight.torque_and_stiffness(self.robot, Postures(self.robot, commanded))[0]
            commanded = goal.q - scaled_compliance * (joint_torque - weight_torque)
        return commanded

    def linear_displacement(self, cases: LoadCases, unloaded: Postures) -> FloatArray:
        """Return the displacements ``J diag(c) τ`` (B, 3) of the places, to first order in the load [m]."""
        torque = unloaded.load(cases.load_point, cases.force, cases.moment)[1]
        if self.weight is not None and self.weight.absolute:
            torque = torque + self.weight.torque_and_stiffness(self.robot, unloaded)[0]
        rotation = self.compliance * torque
        jacobian = unloaded.jacobian_at(unloaded.to_base(cases.place[:, None]))[:, 0]
        return np.asarray((jacobian @ rotation[..., None])[..., 0])

    def find_overloads(self, cases: LoadCases, unloaded: Postures) -> BoolArray:
        """Return a mask (B,) of the cases whose load turns or softens a joint more than the model allows.

        A joint softens where the load reduces its stiffness.
        """
        jacobian, torque = unloaded.load(cases.load_point, cases.force, cases.moment)
        turned = np.abs(self.compliance * torque) > LARGEST_TURN
        stiffness = wrench_stiffness(unloaded.angular_jacobian, jacobian, cases.force, cases.moment)
        softened = self.compliance * np.abs(stiffness).sum(axis=2) > _SOFTEST
        return np.asarray((turned | softened).any(axis=1))

    @cached_property
    def _undetermined_directions(self) -> FloatArray:
        """Combinations (u, n) of the n compliances that the readings do not determine, one in each row."""
        identity = np.eye(self.robot.n)
        if self.likelihood is None:
            return identity[:0]
        without_estimate = np.delete(identity, self.likelihood.joints, axis=0)
        if self.likelihood.given_rows is None:
            return without_estimate
        spectrum = Spectrum(self.likelihood.given_rows)
        null_combinations = spectrum.null_space / spectrum.scale * spectrum.scale.max()
        return np.concatenate([without_estimate, null_combinations @ identity[self.likelihood.joints]])

    def find_undetermined_joints(self, rows: FloatArray) -> BoolArray:
        """Return a mask (B, n) of the joints that make a function uncertain without limit.

        These joints have a compliance that the readings do not determine, and the function depends on it.

        Args:
            rows: (B, w, n) coefficients of w linear functions of the compliances in each of B cases.
        """
        if not len(self._undetermined_directions):
            return np.zeros((len(rows), self.robot.n), dtype=np.bool_)
        row_size = np.abs(rows).max(axis=(1, 2), initial=0.0)[:, None, None]
        components = rows @ self._undetermined_directions.T  # (B, w, u)
        affects_function = (np.abs(components) > _UNSEEN * row_size).any(axis=1)  # (B, u)
        joints = (affects_function[:, :, None] & (np.abs(self._undetermined_directions) > _UNSEEN)).any(
            axis=1
        )
        return np.asarray(joints)

    def find_interval_ends(
        self, rows: FloatArray, confidence: float, *, by_profile: bool = True
    ) -> FloatArray | None:
        """Return confidence intervals of linear functions aᵀc of the compliances c, under the constraints.

        The unconstrained interval is cut to the bounds, and widened to contain the estimate and the interval
        of the profile likelihood (method.md §9). Without the profile likelihood the coverage is the same, and
        the computation is faster, as no optimisation is needed.

        Args:
            rows: (K, n) coefficients a of the functions.
            confidence: level of the intervals.
            by_profile: whether the profile likelihood widens the intervals.

        Returns:
            Lower and upper ends (K, 2) in the unit of aᵀc; None if no uncertainty is known.
        """
        likelihood = self.likelihood
        if likelihood is None:
            return None
        identified_rows, value = rows[:, likelihood.joints], rows @ self.compliance
        constraints = self.constraints.select(likelihood.joints)
        radii = np.array([self.quantile(confidence)])
        ends: FloatArray = compute_interval_ends(
            likelihood, constraints, identified_rows, radii, value, by_profile=False
        )[0]
        # With an order of joints, the interval of the profile likelihood lies within these ends already.
        if not by_profile or constraints.order:
            return ends
        uncertain = np.flatnonzero(
            ((identified_rows @ likelihood.covariance) * identified_rows).sum(axis=1) > 0.0
        )
        for start in range(0, len(uncertain), _BLOCK):
            block = uncertain[start : start + _BLOCK]
            with suppress(SolverError):  # the ends without the profile likelihood have the coverage, too
                ends[block] = compute_interval_ends(
                    likelihood, constraints, identified_rows[block], radii, value[block]
                )[0]
        return ends


@dataclass(frozen=True, eq=False)
class JointDeflection(Deflection):
    """Deflections due to elastic joints; `rows` and `compliance` hold in the loaded posture."""

    model: JointModel
    balance: Balance  #: balance of springs and loads
    jacobian: FloatArray  #: (B, 6, n) jacobian of the places [m/rad, then rad/rad], in the loaded posture

    def deflect_from(self, unloaded: Postures) -> JointDeflection:
        """Compute the deflections of the same loads from other unloaded postures."""
        return self.model.balance_loads(self.cases, unloaded, self.balance.start)

    @cached_property
    def _motion_by_joint_turn(self) -> FloatArray:
        """(B, 6, n) derivatives of `motion` with respect to c ∘ τ: ``J_x (I − diag(c)(K_c + ∂g/∂q))⁻¹``."""
        return self.jacobian @ self.balance.joints.softened

    @cached_property
    def _torque(self) -> FloatArray:
        """(B, n) torques of the joints [N·m], without those of an identified own weight."""
        if self.model.weight is None or not self.model.weight.absolute:
            return self.balance.torque
        loaded = self.balance.joints.postures
        return loaded.load(self.cases.load_point, self.cases.force, self.cases.moment)[1]

    @cached_property
    def rows(self) -> FloatArray:
        """Derivatives (B, 6, n) of the motion of the place with respect to the n compliances c.

        They are ``J_x (I − diag(c)(K_c + ∂g/∂q))⁻¹ diag(τ)``: J_x is the Jacobian of the place, K_c the
        stiffness due to the load, g the torque of own weight, τ the torques of the load.
        """
        return np.asarray(self._motion_by_joint_turn * self._torque[:, None])

    @cached_property
    def covariance_root(self) -> FloatArray | None:
        """(B, 6, r) L with L Lᵀ the covariance of `motion`, identified sag included; None if unknown."""
        if isinstance(self.model.weight, IdentifiedWeight):
            turn_root = self.model.weight.compute_turn_root(self.balance.joints.postures, self._torque)
            return np.asarray(self._motion_by_joint_turn @ turn_root)
        return None if self.model.likelihood is None else np.asarray(self.rows @ self.model.root)

    @property
    def unseen(self) -> BoolArray:
        """Mask (B, n) of the joints of undetermined compliance that the load or own weight twists."""
        unseen, weight = self.model.find_undetermined_joints(self.rows), self.model.weight
        if isinstance(weight, IdentifiedWeight):
            weight_torque = np.abs(self.balance.torque - self._torque)
            # A joint without uncertainty was not identified, so its own weight must not twist it.
            not_identified = ~weight.root[: self.model.robot.n].any(axis=1)
            unseen |= not_identified & (weight_torque > _TILT * weight_torque.max(axis=1, keepdims=True))
        return unseen

    @property
    def compliance(self) -> CartesianCompliance:
        """Cartesian compliance at the places, in the loaded postures."""
        matrix = (self._motion_by_joint_turn * self.model.compliance) @ self.jacobian.transpose(0, 2, 1)
        symmetric = (self.cases.moment == 0.0).all(axis=1)
        differentiate = None if self.model.likelihood is None else self._differentiate_compliance
        return CartesianCompliance(matrix, symmetric, differentiate)

    def _differentiate_compliance(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return L and M, each (B, 6, n), with ``∂C_x/∂c_j = L_j M_jᵀ``, and the covariance (n, n) of c.

        C_x (B, 6, 6) is the compliance of the loaded place; c (n,) are the compliances of the joints.
        """
        # This is (I − K diag(c))⁻¹ = I + K (I − diag(c) K)⁻¹ diag(c), with K the stiffness due to the load.
        joints = self.balance.joints
        feedback = joints.stiffness @ (joints.softened * self.model.compliance)
        stiffened = np.eye(self.model.robot.n) + feedback
        return self._motion_by_joint_turn, self.jacobian @ stiffened.transpose(0, 2, 1), self.model.covariance

    def compliance_known(self, direction: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return two masks (B,): whether the compliance along a direction is known, and that across it.

        A compliance is known if all joints that move the place in this way have a known compliance.

        Args:
            direction: (B, 3) unit vectors.
        """
        linear = self.jacobian[:, :3]
        along = np.square(np.einsum("bi,bij->bj", direction, linear))
        across = np.maximum(np.einsum("bij,bij->bj", linear, linear) - along, 0.0)
        unknown_along, unknown_across = (
            self.model.find_undetermined_joints(rows[:, None]).any(axis=1) for rows in (along, across)
        )
        return np.asarray(~unknown_along), np.asarray(~unknown_across)

    def interval(self, confidence: float) -> FloatArray | None:
        """Return confidence intervals (B, 6, 2) of the place's displacement [m], then its rotation [rad].

        The intervals respect the constraints on the compliances. `confidence` is their level.
        """
        n = self.model.robot.n
        ends = self._find_interval_ends(self.rows.reshape(-1, n), self.motion.reshape(-1), confidence)
        return super().interval(confidence) if ends is None else ends.reshape(*self.motion.shape, 2)

    def interval_along(self, direction: FloatArray, confidence: float) -> FloatArray:
        """Return intervals (B, 2) of displacements along unit vectors (B, 3) [m], cut to the bounds."""
        rows = np.einsum("bi,bij->bj", direction, self.rows[:, :3])
        value = np.einsum("bi,bi->b", direction, self.displacement)
        ends = self._find_interval_ends(rows, value, confidence, by_profile=False)
        return super().interval_along(direction, confidence) if ends is None else ends

    def _find_interval_ends(
        self, rows: FloatArray, value: FloatArray, confidence: float, *, by_profile: bool = True
    ) -> FloatArray | None:
        """Return intervals (K, 2) of K linear functions of the compliances, shifted to exact values.

        The shift is necessary because the balance is not linear in the compliances.

        Args:
            rows: (K, n) coefficients of the functions.
            value: (K,) exact values of the functions at the estimate.
            confidence: level of the intervals.
            by_profile: whether the profile likelihood widens the intervals.

        Returns:
            The intervals; None if own weight was identified or no uncertainty is known.
        """
        if isinstance(self.model.weight, IdentifiedWeight):
            return None
        ends = self.model.find_interval_ends(rows, confidence, by_profile=by_profile)
        return None if ends is None else ends + (value - rows @ self.model.compliance)[:, None]


def _compute_joint_root(elastic: ElasticFit) -> FloatArray | None:
    """Return a root of the covariance of stated errors and of entries; None if sigma is unknown.

    Stated errors have a normal prior, too: zero within their standard uncertainties.

    Returns:
        (K + p, K + p) upper triangular L with L Lᵀ the covariance of K stated errors, in units of their
        standard uncertainties, and of p entries.
    """
    reduced, sigma = elastic.likelihood.reduced, elastic.likelihood.scale.sigma
    if sigma is None:
        return None
    cone, part = reduced.cone, reduced.part
    scaled_entries = elastic.entries[reduced.columns] / reduced.unit
    traces_of_diagonal_links = scaled_entries[cone.unpenalised : cone.nonnegative].reshape(-1, 6).sum(axis=1)
    traces = [
        *traces_of_diagonal_links,
        *(scaled_entries[place][find_diagonal_entries(size)].sum() for size, place in cone.blocks()),
    ]
    prior_deviation = max(_SHARE_OF_TRACE * float(np.sqrt(np.mean(np.square(traces)))), _LEAST_PRIOR)
    prior = np.full(len(scaled_entries), prior_deviation)
    prior[: cone.unpenalised] = _JOINT_PRIOR
    unit = np.concatenate([np.ones(part.stated_errors), reduced.unit * prior])
    errors = np.arange(part.compliances, part.compliances + part.stated_errors)
    known = np.vstack([part.triangle, part.stated[part.stated_errors :]])  # statements follow as a prior
    scaled_rows = known[:, np.concatenate([errors, reduced.columns])] * (unit / sigma)
    factor = np.linalg.cholesky(scaled_rows.T @ scaled_rows + np.eye(len(unit)))
    inverse = solve_triangular(factor, np.eye(len(unit)), lower=True)
    return np.asarray(unit[:, None] * inverse.T)


@dataclass(frozen=True, eq=False)
class ElasticPredictor(ForwardModel):
    """Elastic joints, links and base, to first order in the load at the unloaded posture."""

    first_order = True

    columns: Columns  #: columns of the model with all joints, links and base
    kept: IndexArray  #: (p,) indices of the columns that this model has
    entries: FloatArray  #: (p,) entries of the compliance matrices, one for each of these columns
    #: (p, p) upper triangular L with L Lᵀ the covariance of the entries; None if the covariance is unknown
    root: FloatArray | None
    seen: BoolArray  #: (n,) mask of the joints whose compliance the readings show

    @classmethod
    def from_estimate(cls, robot: Robot, elastic: ElasticFit) -> ElasticPredictor:
        """Build the model from an estimate of joints and links.

        The covariance of the entries of the compliance matrices follows from the readings together with a
        normal prior about zero, whose standard deviation follows from the traces of the estimated matrices;
        see the head of this module.
        """
        reduced = elastic.likelihood.reduced
        root, errors = _compute_joint_root(elastic), reduced.part.stated_errors
        return cls(
            robot,
            elastic.candidate.columns,
            reduced.columns,
            elastic.entries[reduced.columns],
            None if root is None else root[errors:, errors:],
            ~np.isnan(elastic.compliance),
            degrees_of_freedom=elastic.likelihood.scale.freedom_of_sigma,
        )

    @cached_property
    def matrices(self) -> tuple[FloatArray, FloatArray]:
        """Compliance matrices: (n, n) of the joints [rad/(N·m)], and (L, 6, 6) of links and base [SI]."""
        compliances = np.zeros(self.columns.width)
        compliances[self.kept] = self.entries
        coupling = to_matrix(compliances[self.columns.coupling], self.columns.n)
        links = [to_matrix(compliances[self.columns.link_columns(frame)], 6) for frame in self.columns.frames]
        return np.diag(compliances[self.columns.joints]) + coupling, np.array(links).reshape(-1, 6, 6)

    def deflect(
        self,
        cases: LoadCases,
        unloaded: Postures | None = None,
        near: Postures | None = None,  # noqa: ARG002  # nothing is balanced
    ) -> ElasticDeflection:
        """Compute the deflections of joints, links and base, to first order at the unloaded posture.

        Args:
            cases: B load cases.
            unloaded: postures without load; computed from the cases if None.
            near: ignored, because no balance is searched.
        """
        return self._deflect_linearly(cases, self.unloaded(cases) if unloaded is None else unloaded)

    def _deflect_linearly(
        self, cases: LoadCases, unloaded: Postures, share: FloatArray | None = None
    ) -> ElasticDeflection:
        """Compute the deflections to first order in the load, times fractions `share` (B,) unless None.

        Args:
            cases: B load cases.
            unloaded: B postures without load, at which the model is linear.
            share: (B,) fractions of the load's deflection.
        """
        # Axes (B, L, 3, 3) and origins (B, L, 3) of the frames at which links and base bend
        frame_axes, origin = (part[:, list(self.columns.frames)] for part in spring_frames(unloaded))
        place, load_point = (unloaded.to_base(p[:, None]) for p in (cases.place, cases.load_point))
        jacobian = unloaded.pose_jacobian_at(place)
        load_jacobian = unloaded.jacobian_at(load_point)[:, 0]
        torque = unloaded.joint_torque(load_jacobian, cases.force, cases.moment)
        # Motion of the place per motion of each frame, and the wrench of the load in each frame
        place_motions = np.zeros((*frame_axes.shape[:2], 6, 6))
        place_motions[..., :3, :3] = place_motions[..., 3:, 3:] = frame_axes
        place_motions[..., :3, 3:] = -skew(place - origin) @ frame_axes
        moment = cases.moment[:, None] + np.cross(load_point - origin, cases.force[:, None])
        wrench = np.concatenate(
            [cases.force[:, None, None] @ frame_axes, moment[:, :, None] @ frame_axes], axis=-1
        )
        joint_compliance, link_compliances = self.matrices
        motion = (jacobian @ (torque @ joint_compliance)[..., None])[..., 0]
        motion = motion + (place_motions @ (wrench @ link_compliances).mT)[..., 0].sum(axis=1)
        motion = motion if share is None else share[:, None] * motion
        return ElasticDeflection(
            model=self,
            cases=cases,
            unloaded=unloaded,
            place=place[:, 0] + motion[:, :3],
            axes=Rotation.from_rotvec(motion[:, 3:]).as_matrix() @ unloaded.flange_rotation,
            jacobian=jacobian,
            torque=torque,
            moves=place_motions,
            wrench=wrench[:, :, 0],
        )

    def compute_commands(self, cases: LoadCases, goal: Postures, share: FloatArray) -> FloatArray:
        """Find the joint angles (B, n) to command [rad] with which the loaded places reach those of `goal`.

        Newton's method; its derivative neglects that the deflection changes with the posture, but each step
        still gains three digits.

        Args:
            cases: B loads, their load points, and the places on the flange that must reach the goal.
            goal: B postures with which the unloaded arm would have the places at the goal.
            share: (B,) share of the deflection that is corrected, 0 to 1.

        Raises:
            RequestError: the place is at a singular posture, or out of reach.
        """
        target, angles = goal.to_base(cases.place[:, None])[:, 0], goal.q
        for _ in range(_NEWTON_STEPS):
            loaded = self._deflect_linearly(cases, Postures(self.robot, angles), share)
            rotation = rotation_vectors(goal.flange_rotation, loaded.axes)
            deviation = np.concatenate([target - loaded.place, rotation], axis=1)
            if (np.abs(deviation) <= _REACHED).all():
                return angles
            jacobian = loaded.jacobian
            normal = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING * np.eye(6)
            angles = (
                angles + (jacobian.transpose(0, 2, 1) @ np.linalg.solve(normal, deviation[..., None]))[..., 0]
            )
        sizes = np.abs(deviation).max(axis=1)
        raise CasesError(
            "no posture near the given posture brings the loaded tool to its target",
            failed=sizes > _REACHED,
            cause="not_reached",
            where=f"cases[{int(np.argmax(sizes))}]",
            remedy="move the part away from the singularity, or state no load in this posture",
        )

    def linear_displacement(self, cases: LoadCases, unloaded: Postures) -> FloatArray:
        """Return the displacements (B, 3) of the places [m]."""
        return self._deflect_linearly(cases, unloaded).displacement

    def find_overloads(self, cases: LoadCases, unloaded: Postures) -> BoolArray:
        """Return a mask (B,) of the cases whose load turns the flange too far for a linear model."""
        angle = np.linalg.norm(self._deflect_linearly(cases, unloaded).rotation, axis=1)
        return np.asarray(angle > LARGEST_TURN)


@dataclass(frozen=True, eq=False)
class ElasticDeflection(Deflection):
    """Deflections due to elastic joints, and to L elastic links and base, in the unloaded posture."""

    model: ElasticPredictor
    jacobian: FloatArray  #: (B, 6, n) jacobian of the places [m/rad, then rad/rad], axes of R0
    torque: FloatArray  #: (B, n) torque of the joints [N·m]
    #: (B, L, 6, 6) motion of the places per motion of each link's frame; both translation, then rotation
    moves: FloatArray
    wrench: FloatArray  #: (B, L, 6) wrench of the load in each link's frame [N, then N·m]

    def deflect_from(self, unloaded: Postures) -> ElasticDeflection:
        """Compute the deflections of the same loads from other unloaded postures."""
        return self.model.deflect(self.cases, unloaded)

    @cached_property
    def rows(self) -> FloatArray:
        """Derivatives (B, 6, p) of the motion of the place with respect to the p compliances of the model."""
        columns = self.model.columns
        rows = np.empty((len(self.torque), 6, columns.width))
        rows[..., columns.joints] = self.jacobian * self.torque[:, None]
        rows[..., columns.coupling] = differentiate_bilinear_form(self.jacobian, self.torque[:, None])
        for i, frame in enumerate(columns.frames):
            rows[..., columns.link_columns(frame)] = differentiate_bilinear_form(
                self.moves[:, i], self.wrench[:, i, None]
            )
        return rows[..., self.model.kept]

    @cached_property
    def covariance_root(self) -> FloatArray | None:
        """(B, 6, p) matrices L with L Lᵀ the covariance of `motion`; None if the covariance is unknown."""
        return None if self.model.root is None else np.asarray(self.rows @ self.model.root)

    @property
    def unseen(self) -> BoolArray:
        """(B, n) mask of joints that the load twists although the readings do not show their compliance."""
        twisted = np.abs(self.jacobian * self.torque[:, None]).max(axis=1) > 0.0
        return np.asarray(twisted & ~self.model.seen)

    @property
    def compliance(self) -> CartesianCompliance:
        """Cartesian compliance at the places, without its uncertainty, which is not known."""
        of_joints, of_links = self.model.matrices
        by_links = (self.moves @ of_links @ self.moves.mT).sum(axis=1)
        matrix = self.jacobian @ of_joints @ self.jacobian.transpose(0, 2, 1) + by_links
        return CartesianCompliance(matrix, np.ones(len(matrix), dtype=np.bool_), None)

    def compliance_known(self, direction: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return two masks (B,): whether the compliance along a direction is known, and that across it.

        Both are known if the readings show the compliances of all joints.
        """
        known = np.full(len(direction), self.model.seen.all())
        return known, known


MOST_LEFT_OUT: Final = 200
"""Greatest number of postures that are left out in turn, evenly spread over a larger set."""
MOST_STEPS: Final = 500
"""Number of steps of the distribution of scores that are kept: a quantile is rounded up by at most 0.2 %."""
_FOLD_COUNT: Final = 20
"""Number of parts of the postures that are left out in turn in models with elastic links."""
_SAME_POSTURE: Final = 1e-6
"""Difference of joint angles [rad] below which two observations share a posture."""
_SLACK: Final = 1e-9
EXTRAPOLATED: Final = 1.01
"""Ratio to the campaign's greatest load or leverage above which a prediction is called extrapolated."""


@dataclass(frozen=True, eq=False)
class ModelErrorBound:
    """Bound of the model error: radii of balls about B predicted displacements that contain the true ones."""

    radius: FloatArray  #: (B,) [m]; inf where nothing is known
    #: `force` or `moment` if no load of the campaign had this part, so that its effect is unknown; else None
    unmeasured: str | None
    #: (B,) size of the load over the greatest measured size; above EXTRAPOLATED the prediction is
    #: extrapolated
    load_ratio: FloatArray
    #: (B,) uncertainty of the displacement per size of load, over that of the worst measured place; above
    #: EXTRAPOLATED the prediction is extrapolated
    leverage_ratio: FloatArray
    #: (B,) standard deviation of the model error along any direction [m]; inf where nothing is known
    deviation: FloatArray

    def interval(self, displacement: FloatArray, of_readings: FloatArray | None) -> FloatArray:
        """Return intervals (B, 3, 2) of displacements [m] that contain the balls and the readings' intervals.

        Args:
            displacement: (B, 3) predicted [m].
            of_readings: (B, 6, 2) intervals of displacement and rotation from the readings; None if unknown.
        """
        radius = self.radius[:, None]
        ends: FloatArray = np.stack([displacement - radius, displacement + radius], axis=-1)
        if of_readings is None:
            return ends
        lower = np.minimum(ends[..., 0], of_readings[:, :3, 0])
        return np.stack([lower, np.maximum(ends[..., 1], of_readings[:, :3, 1])], axis=-1)


@dataclass(frozen=True, eq=False)
class ModelError:
    """Model error: distribution of the residuals of readings in postures that were left out of the fit."""

    postures: int  #: number P of postures that were left out in turn
    #: (S,) ascending scores [m]: length of a residual, without the part due to noise of the reading, over the
    #: factor by which residuals grow with load; inf if the other postures do not determine the prediction
    score: FloatArray
    share: FloatArray  #: (S,) share of readings with at most this score, times P/(P + 1)
    force: float  #: force of size 1 [N]; zero if no force was measured. The greatest load has size 1
    moment: float  #: moment of size 1 [N·m]; zero if no moment was measured
    least_load: float  #: least size of a load
    #: greatest uncertainty of a target's displacement, ``√λ_max(A C Aᵀ)``, over the size of its load [m];
    #: beyond it the ball widens
    leverage: float
    #: standard deviation of a coordinate of a reading [m], estimated in a model with elastic links: residuals
    #: then grow with the leverage over this noise. None if noise was stated or only joints bend: residuals
    #: then grow with the root of the load
    noise: float | None = None
    #: the same for the load points of the observations [m]; zero in a run of an earlier version. A load point
    #: in its measured posture is no extrapolation, even if no target was there
    load_point_leverage: float = 0.0
    left_out: PostureJackknife | None = None  #: fits without each posture; None if not known

    @staticmethod
    def count_needed_postures(confidence: float) -> int:
        """Return the least number ``⌈1/α⌉ − 1`` of postures that gives a bound at the confidence 1 − α."""
        return ceil(1.0 / (1.0 - confidence) - _SLACK) - 1

    def quantile(self, confidence: float) -> float:
        """Return the least score [m] that a fraction of the readings does not exceed.

        `confidence` is the fraction; with too few postures the score is infinite. A score is the error of the
        prediction of a held-out reading, divided by the growth of this error with the load.
        """
        index = int(np.searchsorted(self.share, confidence - _SLACK))
        return float(self.score[index]) if index < len(self.score) else float("inf")

    @cached_property
    def deviation(self) -> float:
        """Standard deviation of the error along any direction, at a growth of 1 [m]: a third of the square.

        Infinite if the other postures did not determine a prediction.
        """
        weight = np.diff(self.share, prepend=0.0)
        # `inf · 0` cannot occur: each step has a positive weight.
        return float(np.sqrt((weight @ np.square(self.score)) / weight.sum() / 3.0))

    def bound(self, cases: LoadCases, leverage: FloatArray, confidence: float) -> ModelErrorBound:
        """Return the bound of the model error at predicted places.

        Within the campaign's loads the radius grows with the square root of the load, as the error is partly
        elastic, partly friction. With elastic links and no stated noise, it grows with the leverage over the
        noise of a reading. Beyond the campaign's loads or leverages, it grows in proportion to them.

        Args:
            cases: B load cases.
            leverage: (B,) greatest standard uncertainty of a component of each predicted displacement [m].
            confidence: level of the bound.
        """
        relative_load = compute_load_sizes(cases.force, cases.moment, self.force, self.moment)
        relative_leverage = leverage / np.where(relative_load > 0.0, relative_load, 1.0)
        measured_leverage = max(self.leverage, self.load_point_leverage)
        growth = _compute_residual_growth(
            np.maximum(relative_load, self.least_load), leverage, self.noise
        ) * np.maximum(_divide_positive(relative_leverage, self.leverage), 1.0)
        radius = self.quantile(confidence) * growth
        unmeasured = "force" if self.force == 0.0 else "moment" if self.moment == 0.0 else None
        leverage_ratio = _divide_positive(relative_leverage, measured_leverage)
        return ModelErrorBound(radius, unmeasured, relative_load, leverage_ratio, self.deviation * growth)


def _divide_positive(values: FloatArray, reference: float) -> FloatArray:
    """Return values (B,) over a reference: 0 for a value of 0, and inf for others if the reference is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(values > 0.0, np.divide(values, reference), 0.0)


def _compute_residual_growth(load: FloatArray, leverage: FloatArray, noise: float | None) -> FloatArray:
    """Return the factor (B,) by which residuals grow with sizes of loads (B,) and leverages (B,) [m].

    With a noise [m] the factor is 1 at zero leverage within the measured loads; without noise (None), it is 1
    at the greatest measured load.
    """
    if noise is None:
        return np.maximum(np.sqrt(load), load)
    return np.hypot(np.maximum(load, 1.0), leverage / noise)


def compute_load_sizes(
    force: FloatArray, moment: FloatArray, most_force: float, most_moment: float
) -> FloatArray:
    """Return the sizes ``|F|/most_force + |M|/most_moment`` (B,) of loads (B, 3).

    A size is inf if the load has a force although `most_force` is zero, as none was measured, or likewise a
    moment.
    """
    size = np.zeros(len(force))
    for vector, greatest in ((force, most_force), (moment, most_moment)):
        length = np.linalg.norm(vector, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            size += np.where(length > 0.0, np.divide(length, greatest), 0.0)
    return size


def estimate_error_by_leaving_postures_out(
    rows: Rows, settings: Settings, estimate: Estimate, model: JointModel
) -> ModelError:
    """Estimate the error of the model's predictions at new postures.

    For each posture: fit the model again without the posture, then predict the readings of the posture. The
    refits use the method, weighting and bounds of the run, and the weights of a robust loss. They use the
    complementary stiffness K_c at the compliances of the run. They neglect priors and the constraint that
    orders the joints, so the residuals tend to be too large.

    Raises:
        RequestError: no posture can be left out.
        JointstiffError: a refit fails.
    """
    measurements = rows.measurements
    posture_of_observation, left_out_postures = _choose_left_out_postures(measurements, estimate)
    posture_count = len(left_out_postures)
    if posture_count > MOST_LEFT_OUT:
        left_out_postures = left_out_postures[np.linspace(0, posture_count - 1, MOST_LEFT_OUT).astype(int)]
    if estimate.robust is not None:
        measurements = estimate.robust.reweight(measurements)
    linear_settings = replace(settings, loss="squared", prior=None, order=())
    blocks = build_method_stacks(rows.of(measurements), linear_settings, estimate)
    fits = fit_subsets(
        blocks,
        (posture_of_observation != left_out_postures[:, None]).astype(np.float64),
        linear_settings.bounds,
    )
    posture_of_reading = posture_of_observation[np.nonzero(measurements.present)[0]]
    is_left_out = np.isin(posture_of_reading, left_out_postures)
    # (R, v) for each reading, the v compliances of the refit without its posture; zero without a refit
    compliance = np.zeros((len(posture_of_reading), len(blocks.visible)))
    compliance[is_left_out] = fits[np.searchsorted(left_out_postures, posture_of_reading[is_left_out])][
        :, blocks.visible
    ]
    # (R, 3) measured minus predicted; (R, 3, k) root of the covariance of each prediction
    residual = blocks.deflection.T - np.einsum("rv,vir->ri", compliance, blocks.regressor)
    prediction_root = blocks.regressor.transpose(2, 1, 0) @ model.root[blocks.visible]
    # Without one of `count` postures, the covariance of the estimate grows by about this fraction.
    added_variance = np.full(len(posture_of_reading), 1.0 / (posture_count - 1))
    error = _compute_model_error(
        measurements, np.where(is_left_out, posture_of_reading, -1), residual, prediction_root, added_variance
    )
    return replace(
        error,
        left_out=PostureJackknife(fits, posture_count),
        load_point_leverage=_compute_load_point_leverage(model, measurements, error),
    )


def _compute_load_point_leverage(
    model: JointModel | ElasticPredictor, measurements: Measurements, error: ModelError
) -> float:
    """Return the greatest leverage over load size of the load points of the observations [m]."""
    load = compute_load_sizes(measurements.force, measurements.moment, error.force, error.moment)
    loaded = load > 0.0
    point = measurements.load_point[loaded]
    cases = LoadCases(
        measurements.joints[loaded],
        measurements.force[loaded],
        measurements.moment[loaded],
        point,
        point.copy(),
    )
    return float((model.deflect(cases).leverage / load[loaded]).max())


def _choose_left_out_postures(
    measurements: Measurements, estimate: Estimate
) -> tuple[IndexArray, IndexArray]:
    """Return the number (N,) of each observation's posture, and the numbers of the postures under load.

    Raises:
        RequestError: the readings do not show the model error.
    """
    rounded = np.round(measurements.joints / _SAME_POSTURE)
    posture_of_observation = np.unique(rounded, axis=0, return_inverse=True)[1].reshape(-1)
    loaded = (measurements.force != 0.0).any(axis=1) | (measurements.moment != 0.0).any(axis=1)
    left_out_postures = np.unique(posture_of_observation[loaded])
    if len(left_out_postures) < 2:
        raise RequestError("the model error needs two postures under load", remedy="measure more postures")
    _refuse_directions(measurements)
    if estimate.covariance is None:
        raise RequestError(
            "the uncertainty of the readings is unknown", remedy="measure more postures, or state `noise`"
        )
    return posture_of_observation, left_out_postures


def _refuse_directions(measurements: Measurements) -> None:
    """Raise RequestError for readings along a direction, which show a part of the error of a prediction."""
    if measurements.direction is not None:
        raise RequestError(
            "readings along one direction do not show the whole error of a prediction",
            remedy="read all three coordinates of a target",
        )


def estimate_error_by_leaving_folds_out(source: Rows, elastic: ElasticFit) -> ModelError:
    """Estimate the error of a model with elastic links at new postures.

    The postures are divided into `_FOLD_COUNT` folds. For each fold: fit the model again without the fold,
    with its own loss, then predict the readings of the fold. If a fold with whitened rows A is left out, the
    covariance ``C = L Lᵀ`` of the compliances becomes ``L (I − Lᵀ AᵀA L)⁻¹ Lᵀ``.

    Raises:
        RequestError: readings are along a direction.
        UnsupportedMethodError: the set has one posture only.
    """
    robot, measurements = source.robot, source.measurements
    _refuse_directions(measurements)
    model, sigma = ElasticPredictor.from_estimate(robot, elastic), elastic.likelihood.scale.sigma
    cross_validation = CrossValidation(folds=_FOLD_COUNT, draws=1)
    statements = elastic.statements
    folds = Folds(source, elastic.candidate.columns, model.seen, cross_validation, statements)
    covariance = np.broadcast_to(measurements.covariance, (*measurements.present.shape, 3, 3))
    observation_of_reading = np.nonzero(measurements.present)[0]
    residual = np.empty((len(observation_of_reading), 3))
    added_variance = np.empty(len(observation_of_reading))
    joint_root = _compute_joint_root(elastic)
    rank = 1 if joint_root is None else len(joint_root)
    prediction_root = np.zeros((len(observation_of_reading), 3, rank))
    stated_errors = elastic.likelihood.reduced.part.stated_errors
    kept = np.concatenate([np.arange(stated_errors) + folds.columns.width, model.kept])
    for number, held_out_observations in enumerate(folds.held_out):
        unknowns, _ = fit_fold(folds, elastic.candidate, number, (elastic.penalty,))
        blocks = list(generate_elastic_rows(source[held_out_observations], folds.columns, statements))
        rows = np.concatenate([each.targets[each.block.measurements.present] for each in blocks])
        held_out_readings = np.flatnonzero(np.isin(observation_of_reading, held_out_observations))
        residual[held_out_readings] = rows[..., -1] - rows[..., :-1] @ unknowns[0]
        added_variance[held_out_readings] = len(held_out_observations) / len(measurements)
        if joint_root is not None and sigma is not None:
            root = rows[..., kept] @ joint_root
            whitened_rows = [
                each.block.whiten(each.targets[..., kept] @ joint_root)[each.block.measurements.present]
                for each in blocks
            ]
            scaled_rows = np.concatenate(whitened_rows).reshape(-1, root.shape[-1]) / sigma
            factor = np.linalg.cholesky(np.eye(scaled_rows.shape[1]) - scaled_rows.T @ scaled_rows)
            prediction_root[held_out_readings] = root @ np.linalg.inv(factor).T
    posture_of_observation = np.unique(measurements.joints, axis=0, return_inverse=True)[1].reshape(-1)
    variance = float(np.trace(covariance, axis1=-2, axis2=-1)[measurements.present].mean()) / 3.0
    # A stated sigma is subtracted from the scores, so only an estimated noise is kept.
    noise = sigma * np.sqrt(variance) if sigma and measurements.sigma is None else None
    error = _compute_model_error(
        measurements,
        posture_of_observation[observation_of_reading],
        residual,
        prediction_root,
        added_variance,
        noise,
    )
    return replace(error, load_point_leverage=_compute_load_point_leverage(model, measurements, error))


def _compute_share_without_noise(
    squares: FloatArray, noise_squares: FloatArray, posture_of_reading: IndexArray
) -> float:
    """Return the share of the mean square that noise does not explain, plus its standard error, at most 1.

    Args:
        squares: (R,) scaled squares of residuals.
        noise_squares: (R,) expected squares due to noise, in the same scale.
        posture_of_reading: (R,) index of each reading's posture.
    """
    mean_square = float(squares.mean()) if len(squares) else 0.0
    if mean_square <= 0.0:
        return 1.0
    counts = np.bincount(posture_of_reading)
    means = np.bincount(posture_of_reading, squares)[counts > 0] / counts[counts > 0]
    # Standard error of the mean square, from the spread of the postures' means
    standard_error = float(means.std(ddof=1)) / np.sqrt(len(means)) if len(means) > 1 else mean_square
    noise_share = float(noise_squares.mean()) / mean_square
    return float(min(1.0, max(0.0, 1.0 - noise_share) + standard_error / mean_square))


def _compute_model_error(
    measurements: Measurements,
    posture_of_reading: IndexArray,
    residual: FloatArray,
    prediction_root: FloatArray,
    added_variance: FloatArray,
    noise: float | None = None,
) -> ModelError:
    """Compute the model error from R residuals of held-out readings, without the noise of the readings.

    A residual contains the error of the prediction and the noise of the reading. As the squares of both add
    up only in the mean, the noise is subtracted from all scores by one common factor. The standard error of
    the mean square is added to the factor, so that scores are rather too large than too small.

    Args:
        measurements: N observations.
        posture_of_reading: (R,) index of each reading's posture; −1 for a posture that was not left out.
        residual: (R, 3) residuals of the readings in fits without their postures [m]; NaN where undetermined.
        prediction_root: (R, 3, p) matrices H with H Hᵀ the covariance of a prediction [m²]; zero if unknown.
        added_variance: (R,) fraction by which the covariance grows in the fit without the posture.
        noise: standard deviation of a coordinate of a reading [m]; None if residuals grow with the load only.
    """
    observation_of_reading = np.nonzero(measurements.present)[0]
    greatest_force, greatest_moment = (
        float(np.linalg.norm(each, axis=1).max()) for each in (measurements.force, measurements.moment)
    )
    load = compute_load_sizes(measurements.force, measurements.moment, greatest_force, greatest_moment)
    greatest_load = float(load.max())
    load = load / greatest_load
    loaded = load[observation_of_reading] > 0.0
    prediction_deviation = greatest_deviation(prediction_root)
    scored = np.flatnonzero(loaded & (posture_of_reading >= 0))
    posture_of_reading = posture_of_reading[scored]
    growth_squared = np.square(
        _compute_residual_growth(load[observation_of_reading[scored]], prediction_deviation[scored], noise)
    )
    trace = np.trace(measurements.covariance, axis1=-2, axis2=-1)
    variance = np.broadcast_to(trace, measurements.present.shape)[measurements.present][scored]
    # Expected square of a residual that is due to noise of the readings
    noise_squares = (measurements.sigma or 0.0) ** 2 * variance
    noise_squares = noise_squares + added_variance[scored] * np.square(prediction_root[scored]).sum(
        axis=(1, 2)
    )
    squares = np.square(residual[scored]).sum(axis=1) / growth_squared
    is_known = np.isfinite(squares)
    remaining_share = _compute_share_without_noise(
        squares[is_known], (noise_squares / growth_squared)[is_known], posture_of_reading[is_known]
    )
    score, share = merge_score_steps(
        posture_of_reading, np.sqrt(np.where(is_known, remaining_share * squares, np.inf))
    )
    return ModelError(
        postures=len(np.unique(posture_of_reading)),
        score=score,
        share=share,
        force=greatest_load * greatest_force,
        moment=greatest_load * greatest_moment,
        least_load=float(load[load > 0.0].min()),
        leverage=float((prediction_deviation[loaded] / load[observation_of_reading[loaded]]).max()),
        noise=noise,
    )


def merge_score_steps(posture: IndexArray, score: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Merge scores into about `MOST_STEPS` steps of their distribution function; postures have equal weights.

    Args:
        posture: (R,) index of each reading's posture.
        score: (R,) score of each reading.

    Returns:
        (S,) ascending scores, the greatest score of each step; and (S,) the share of readings with at most
        this score, times P/(P + 1) for P postures.
    """
    distinct_postures, posture_index, counts = np.unique(posture, return_inverse=True, return_counts=True)
    order = np.argsort(score, kind="stable")
    share = np.cumsum(1.0 / counts[posture_index[order]]) / (len(distinct_postures) + 1)
    if len(order) > MOST_STEPS:
        ends_step = np.diff(np.ceil(MOST_STEPS * share), append=np.inf) > 0.0
        order, share = order[ends_step], share[ends_step]
    return score[order], share
