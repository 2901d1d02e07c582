"""Forward models: the deflection under a load, its uncertainty, and the command that compensates it.

Predictions, maps and programs use a `ForwardModel`, of elastic joints or of joints and links (method.md §9).
A compensated path (§12) states the wanted *loaded* postures θ. Their torques do not depend on the command, so
that no iteration is needed for joints: ``q_cmd = θ − c ∘ τ(θ)``. The simpler command ``x − δ(x)``, with the
deflection δ computed at the wanted pose x, has an error of second order.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Final, NamedTuple

import numpy as np

from jointstiff.solver.arrays import (
    BoolArray,
    FloatArray,
    cross,
    fix_axis_signs,
    greatest_eigenvalue,
)
from jointstiff.solver.errors import CasesError, RequestError
from jointstiff.solver.fit.stages import student_quantile
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.postures import Postures, flange_poses, rotation_vectors
from jointstiff.solver.mechanics.robot import Robot

LARGEST_TURN: Final = 0.25
"""Greatest rotation of a joint, or of the flange, under load for which the models are valid [rad]."""
_SINGULAR: Final = 1e-12
"""Ratio of the least to the greatest singular value below which a scaled compliance matrix is singular."""


@dataclass(frozen=True, eq=False)
class WorstDirection:
    """Direction in which a force moves the place of the tool most, for B load cases."""

    compliance: FloatArray  #: (B,) greatest eigenvalue of C_tt [m/N]
    direction: FloatArray  #: (B, 3) unit vector, axes of R0
    compliance_uncertainty: FloatArray  #: (B,) standard uncertainty of the eigenvalue [m/N]; NaN if unknown
    #: (B,) standard uncertainty of the direction's angle [rad], at most a quarter turn; NaN if unknown
    direction_uncertainty: FloatArray


@dataclass(frozen=True, eq=False)
class CartesianCompliance:
    """``C_x = J_x (I − diag(c)(K_c + ∂g/∂q))⁻¹ diag(c) J_xᵀ`` in the loaded posture of B load cases.

    C_x maps a further small wrench at the place (N, then N·m) to the displacement of the place (m) and the
    rotation of the flange (rad), axes of R0. C_tt is the block (3, 3) of C_x from force to displacement.
    Directions are unit vectors (B, 3).
    """

    matrix: FloatArray  #: (B, 6, 6) blocks [m/N, m/(N·m); rad/N, rad/(N·m)]
    #: (B,) whether C_x is symmetric, as the load has a potential; a moment fixed in R0 has no potential
    symmetric: BoolArray
    #: function that returns the factors L and M, each (B, 6, n), with ``∂C_x/∂c_j = L_j M_jᵀ``, and the
    #: covariance (n, n) of the compliances [(rad/(N·m))²]; None if the covariance is unknown
    differentiate: Callable[[], tuple[FloatArray, FloatArray, FloatArray]] | None

    @property
    def translation(self) -> FloatArray:
        """Translational compliances C_tt (B, 3, 3): displacement of the place per force there [m/N]."""
        return self.matrix[:, :3, :3]

    def compliance_along(self, direction: FloatArray) -> FloatArray:
        """Return the compliance ``uᵀ C_tt u`` (B,) along unit vectors u (B, 3) [m/N].

        C_tt (B, 3, 3) is the translational compliance.
        """
        return np.asarray(np.einsum("bi,bij,bj->b", direction, self.translation, direction))

    def greatest_compliance_across(self, direction: FloatArray) -> FloatArray:
        """Return the greatest compliance (B,) [m/N] in the plane perpendicular to each direction (B, 3).

        The greatest compliance is the greater eigenvalue of the symmetric part of C_tt, the translational
        compliance, projected on the plane.
        """
        # Any vector that is not nearly parallel to the direction gives a basis of the plane.
        not_parallel = np.where(np.abs(direction[:, :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
        first_axis = unit_vectors(cross(direction.T, not_parallel.T).T)
        plane = np.stack([first_axis, cross(direction.T, first_axis.T).T], axis=1)  # (B, 2, 3)
        projected = plane @ self.translation @ plane.transpose(0, 2, 1)
        first_diagonal = projected[:, 0, 0]
        off_diagonal = 0.5 * (projected[:, 0, 1] + projected[:, 1, 0])
        second_diagonal = projected[:, 1, 1]
        return np.asarray(
            0.5 * (first_diagonal + second_diagonal)
            + np.hypot(0.5 * (first_diagonal - second_diagonal), off_diagonal)
        )

    def stiffness_lateral_free(self, direction: FloatArray) -> FloatArray:
        """Return the stiffness ``1/(uᵀ C_tt u)`` (B,) along u [N/m] if the place may also move across u.

        C_tt (B, 3, 3) is the translational compliance.
        """
        with np.errstate(divide="ignore"):
            return 1.0 / self.compliance_along(direction)

    def stiffness_lateral_blocked(self, direction: FloatArray) -> FloatArray:
        """Return the stiffness along u (B, 3) [N/m] if the place cannot move across u: ``uᵀ C_tt⁻¹ u`` (B,).

        C_tt (B, 3, 3) is the translational compliance; the stiffness is infinite where C_tt is singular.
        """
        return _evaluate_form_of_inverse(self.translation, direction)

    def stiffness_rotation_blocked(self, direction: FloatArray) -> FloatArray:
        """Return ``uᵀ K_tt u`` (B,), K = C_x⁻¹ [N/m]: stiffness if all but motion along u is blocked.

        The stiffness is inf where C_x is singular.
        """
        return _evaluate_form_of_inverse(self.matrix, np.pad(direction, ((0, 0), (0, 3))))

    @cached_property
    def worst(self) -> WorstDirection:
        """Direction of the greatest compliance λ, with uncertainties by linear propagation (GUM, 5.1.2).

        ``∂λ/∂c_j = vᵀ (∂C/∂c_j) v`` and ``∂v/∂c_j = Σ_m v_m v_mᵀ(∂C/∂c_j)v / (λ − λ_m)``, with the loaded
        posture held constant: C is the translational compliance, λ_m and v_m its eigenvalues and
        eigenvectors, λ
        and v the greatest of them, c_j the compliance of joint j.
        """
        symmetric = 0.5 * (self.translation + self.translation.transpose(0, 2, 1))
        values, vectors = np.linalg.eigh(symmetric)
        greatest, direction = values[:, -1], fix_axis_signs(vectors[:, :, -1])
        if self.differentiate is None:
            unknown = np.full(len(direction), np.nan)
            return WorstDirection(greatest, direction, unknown, unknown)
        L, M, covariance = self.differentiate()
        # Both factors in the axes of the eigenvectors; then the slopes v_mᵀ (∂C/∂c_j) v (B, 3, n), with v the
        # last eigenvector.
        left_in_eigenvectors, right_in_eigenvectors = (
            vectors.transpose(0, 2, 1) @ factor[:, :3] for factor in (L, M)
        )
        slopes = 0.5 * (
            left_in_eigenvectors * right_in_eigenvectors[:, -1:]
            + right_in_eigenvectors * left_in_eigenvectors[:, -1:]
        )
        variance = np.einsum("bmi,ij,bmj->bm", slopes, covariance, slopes)
        with np.errstate(divide="ignore", invalid="ignore"):
            angle_variance = (variance[:, :2] / np.square(greatest[:, None] - values[:, :2])).sum(axis=1)
        # Equal eigenvalues give 0/0: the direction is then unknown, and the angle at most a quarter turn.
        angle_variance = np.where(np.isnan(angle_variance), np.inf, angle_variance)
        angle = np.minimum(np.sqrt(angle_variance), 0.5 * np.pi)
        return WorstDirection(greatest, direction, np.sqrt(variance[:, -1]), angle)

    def uncertainty_along(self, direction: FloatArray) -> FloatArray:
        """Return the standard uncertainty (B,) of the compliance along unit vectors u (B, 3) [m/N].

        NaN if the uncertainty of the joints' compliances is unknown.
        """
        if self.differentiate is None:
            return np.full(len(direction), np.nan)
        # L and M (B, 6, n): the derivative of the compliance matrix with respect to the compliance of joint j
        # is L_j M_jᵀ, with the columns j of L and M.
        L, M, covariance = self.differentiate()
        # The compliance along u has the derivatives (uᵀ L_j) (M_jᵀ u).
        slope = ((direction[:, None] @ L[:, :3]) * (direction[:, None] @ M[:, :3]))[:, 0]
        return np.asarray(np.sqrt(np.einsum("bi,ij,bj->b", slope, covariance, slope)))


def _evaluate_form_of_inverse(matrices: FloatArray, direction: FloatArray) -> FloatArray:
    """Return ``uᵀ A⁻¹ u`` (B,) of matrices A (B, k, k) and vectors u (B, k); inf where A is singular.

    Rows and columns are scaled to a unit diagonal before A is tested.
    """
    scale = np.sqrt(np.abs(np.diagonal(matrices, axis1=1, axis2=2)))
    scale = np.where(scale > 0.0, scale, 1.0)
    equilibrated = matrices / scale[:, :, None] / scale[:, None]
    singular_values = np.linalg.svd(equilibrated, compute_uv=False)
    regular = singular_values[:, -1] > _SINGULAR * singular_values[:, 0]
    values = np.full(len(matrices), np.inf)
    scaled_direction = (direction / scale)[regular]
    values[regular] = (
        scaled_direction * np.linalg.solve(equilibrated[regular], scaled_direction[..., None])[..., 0]
    ).sum(axis=1)
    return values


@dataclass(frozen=True, eq=False)
class ForwardModel(ABC):
    """Model of the loaded robot: joints alone, or joints and links."""

    first_order: ClassVar[bool]
    """True if deflections are linear in the load, so that own weight and complementary stiffness are
    neglected."""

    robot: Robot  #: n joints
    #: degrees of freedom of a sigma that comes from residuals; None for a sigma that was given
    degrees_of_freedom: float | None = field(default=None, kw_only=True)

    @abstractmethod
    def deflect(
        self, cases: LoadCases, unloaded: Postures | None = None, near: Postures | None = None
    ) -> Deflection:
        """Compute the deflections of the robot under loads.

        Args:
            cases: B load cases.
            unloaded: kinematics of the cases without the load; None to compute them here.
            near: kinematics of postures where the search for the loaded postures starts; None for `unloaded`.

        Raises:
            RequestError: a load has no stable equilibrium.
        """

    @abstractmethod
    def compute_commands(self, cases: LoadCases, goal: Postures, share: FloatArray) -> FloatArray:
        """Compute the angles (B, n) to command [rad] for the deflected robot to reach the postures of `goal`.

        Args:
            cases: B loads, their load points, and the places on the flange.
            goal: B postures that would bring the places to their goals if nothing bent.
            share: (B,) share of the deflection that is compensated, 0 to 1.

        Raises:
            RequestError: no angles near the posture of the goal bring the loaded robot there.
        """

    @abstractmethod
    def linear_displacement(self, cases: LoadCases, unloaded: Postures) -> FloatArray:
        """Return the displacements (B, 3) of the load cases' places [m], to first order in the load."""

    @abstractmethod
    def find_overloads(self, cases: LoadCases, unloaded: Postures) -> BoolArray:
        """Return a mask (B,) of the load cases whose load is too great for the model.

        `unloaded` are the postures of the cases without their loads.
        """

    def unloaded(self, cases: LoadCases) -> Postures:
        """Return the postures of load cases without their loads."""
        return Postures(self.robot, self.robot.joint_map.model_angles(cases.joints))

    def quantile(self, confidence: float) -> float:
        """Return the coverage factor of an interval: the half-width divided by the standard uncertainty.

        Raises:
            RequestError: the confidence is not between 0 and 1.
        """
        if not 0.0 < confidence < 1.0:
            raise RequestError(
                f"the confidence {confidence} is not between 0 and 1",
                where="confidence",
                remedy="give a confidence between 0 and 1",
            )
        return student_quantile(0.5 * (1.0 + confidence), self.degrees_of_freedom)


@dataclass(frozen=True, eq=False)
class Deflection(ABC):
    """Deflections of B load cases by a forward model, axes of R0."""

    model: ForwardModel  #: model with p compliances
    cases: LoadCases  #: loads and places
    unloaded: Postures  #: postures without the loads
    place: FloatArray  #: (B, 3) loaded places in R0 [m]
    axes: FloatArray  #: (B, 3, 3) axes of the flange in R0, under load

    @cached_property
    def unloaded_place(self) -> FloatArray:
        """(B, 3) places without the loads in R0 [m]."""
        return self.unloaded.to_base(self.cases.place[:, None])[:, 0]

    @cached_property
    def motion(self) -> FloatArray:
        """(B, 6) displacements of the places [m], then rotation vectors of the flange [rad]."""
        return _compute_pose_difference(
            self.unloaded_place, self.unloaded.flange_rotation, self.place, self.axes
        )

    @property
    def displacement(self) -> FloatArray:
        """(B, 3) displacements of the places [m]."""
        return self.motion[:, :3]

    @property
    def rotation(self) -> FloatArray:
        """(B, 3) rotation vectors of the flange [rad]."""
        return self.motion[:, 3:]

    @abstractmethod
    def deflect_from(self, unloaded: Postures) -> Deflection:
        """Compute the deflections of the same loads from other unloaded postures.

        The search for the loaded postures starts at the unloaded postures of these deflections.

        Raises:
            RequestError: a load has no stable equilibrium.
        """

    @property
    @abstractmethod
    def rows(self) -> FloatArray:
        """Derivatives (B, 6, p) of displacement and rotation with respect to the p compliances.

        Displacement [m], then rotation [rad], per unit of compliance [rad/(N·m)].
        """

    @property
    @abstractmethod
    def covariance_root(self) -> FloatArray | None:
        """(B, 6, r) matrices H whose product H Hᵀ is the covariance of `motion`; None if it is unknown.

        The covariance contains the uncertainty from the readings, and neither constraints nor model error.
        """

    @property
    @abstractmethod
    def unseen(self) -> BoolArray:
        """Mask (B, n) of the joints that the load twists, and whose compliance the readings do not determine.

        The numbers of a case with such a joint are not valid.
        """

    @property
    @abstractmethod
    def compliance(self) -> CartesianCompliance:
        """Cartesian compliance at the places, in the loaded postures."""

    @abstractmethod
    def compliance_known(self, direction: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return two masks (B,): compliance along each direction (B, 3) is known, and compliance across is.

        Forces in these directions may twist joints of unknown compliance that the load itself does not twist.
        """

    def interval(self, confidence: float) -> FloatArray | None:
        """Return intervals (B, 6, 2) of displacement [m], then rotation [rad], from the readings alone.

        The intervals respect the constraints of the fit. None is returned if no uncertainty is known.
        """
        if self.covariance_root is None:
            return None
        spread = self.model.quantile(confidence) * np.linalg.norm(self.covariance_root, axis=2)
        return np.stack([self.motion - spread, self.motion + spread], axis=-1)

    def interval_along(self, direction: FloatArray, confidence: float) -> FloatArray:
        """Return intervals (B, 2) of displacements along unit vectors (B, 3) [m]; NaN if unknown."""
        value = np.einsum("bi,bi->b", direction, self.displacement)
        spread = self.model.quantile(confidence) * self.uncertainty_along(direction)
        return np.stack([value - spread, value + spread], axis=-1)

    def uncertainty_along(self, direction: FloatArray) -> FloatArray:
        """Return standard uncertainties (B,) of displacements along unit vectors [m]; NaN if unknown."""
        if self.covariance_root is None:
            return np.full(len(direction), np.nan)
        return np.asarray(np.linalg.norm((direction[:, None] @ self.covariance_root[:, :3])[:, 0], axis=1))

    @property
    def leverage(self) -> FloatArray:
        """Greatest standard uncertainty (B,) of a displacement in any direction [m]; zero if unknown."""
        return (
            np.zeros(len(self.motion))
            if self.covariance_root is None
            else greatest_deviation(self.covariance_root[:, :3])
        )

    def length_uncertainties(self, covariances: FloatArray) -> FloatArray:
        """Return the standard uncertainty ``√(uᵀ A C_k Aᵀ u)`` of each displacement's length by source k.

        u is the direction of the displacement, and A its derivatives with respect to the compliances.

        Args:
            covariances: (K, p, p) covariance C_k of the compliances from each of K sources [(rad/(N·m))²].

        Returns:
            (B, K) [m]; zero for a displacement of zero.
        """
        row = np.einsum("bi,bip->bp", unit_vectors(self.displacement), self.rows[:, :3])
        variance = np.einsum("bp,kpq,bq->bk", row, covariances, row)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Return unit vectors (B, 3) along vectors (B, 3); zero where a vector is zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


def greatest_deviation(covariance_root: FloatArray) -> FloatArray:
    """Return the greatest standard uncertainty (B,) in any direction of vectors (3,).

    Args:
        covariance_root: (B, 3, p) matrices H; H Hᵀ is the covariance of a vector.
    """
    roots = np.ascontiguousarray(covariance_root.transpose(1, 2, 0))
    return np.asarray(np.sqrt(greatest_eigenvalue(np.einsum("ikn,jkn->ijn", roots, roots))))


@dataclass(frozen=True)
class CorrectionLimits:
    """Greatest corrections that a compensation may make."""

    displacement: float = 5e-3  #: greatest correction of the place [m]
    rotation: float = 10e-3  #: greatest correction of the orientation [rad]


@dataclass(frozen=True, eq=False)
class Compensation:
    """Commands for m wanted postures, with the poses that the loaded robot reaches by the forward model."""

    commanded: FloatArray  #: (m, n) angles as the controller shows them [rad]
    #: (m, 6) from the wanted pose to the unloaded pose of the command: displacement of the place [m], then
    #: rotation vector [rad], axes of R0
    correction: FloatArray
    #: (m, 6) from the wanted pose to the loaded pose of the command [m, rad]; nearly zero if it was fully
    #: corrected
    residual: FloatArray
    uncorrected: FloatArray  #: (m, 6) from the wanted to the loaded pose without correction [m, rad]
    #: (m,) standard uncertainty of the deflection along itself, from the readings [m]; NaN if unknown
    uncertainty: FloatArray
    leverage: FloatArray  #: (m,) greatest standard uncertainty in any direction [m]; zero if unknown
    #: (m,) root of the sum of the variances of the deflection along x, y and z, from the readings [m]; NaN if
    #: unknown
    scatter: FloatArray
    share: FloatArray  #: (m,) fraction of the full correction that the command contains, 0 to 1
    #: (m,) mask of postures without correction, as the uncertainty of the deflection exceeds the deflection
    uncertain: BoolArray
    capped: BoolArray  #: (m,) mask of postures whose correction was reduced to the limits


def _compute_allowed_shares(correction: FloatArray, limits: CorrectionLimits) -> FloatArray:
    """Return the fraction (m,) of each correction (m, 6) that the limits allow, at most 1."""
    allowed_shares = []
    for components, limit in ((correction[:, :3], limits.displacement), (correction[:, 3:], limits.rotation)):
        size = np.linalg.norm(components, axis=1)
        allowed_shares.append(np.where(size > limit, limit / np.where(size > 0.0, size, 1.0), 1.0))
    return np.minimum(*allowed_shares)


def compensate(
    model: ForwardModel,
    cases: LoadCases,
    limits: CorrectionLimits | None = None,
    ramp: FloatArray | None = None,
    keep_fixed_joints: Callable[[FloatArray], FloatArray] | None = None,
) -> Compensation:
    """Compute commanded angles with which the deflected robot brings the tool to its places.

    Arguments and errors are those of `compensate_poses`.

    Returns:
        The commands, the corrections, and the deviations that remain.
    """
    return compensate_poses(model, cases, limits, ramp, keep_fixed_joints).compensation


class CompensatedPoses(NamedTuple):
    """A compensation, and the unloaded poses of its commands."""

    compensation: Compensation
    flange_poses: FloatArray  #: (m, 4, 4) in R0 [m]


def compensate_poses(
    model: ForwardModel,
    cases: LoadCases,
    limits: CorrectionLimits | None = None,
    ramp: FloatArray | None = None,
    keep_fixed_joints: Callable[[FloatArray], FloatArray] | None = None,
    commanded_cases: LoadCases | None = None,
) -> CompensatedPoses:
    """Compute commanded angles as `compensate` does, and return their poses, too.

    Args:
        model: model of the loaded robot.
        cases: m load cases. `joints` are the controller's angles that would bring the tool to its places if
            nothing bent.
        limits: greatest corrections.
        ramp: (m,) fraction of each correction to apply, such as from `compute_ramp_shares`; None for full
            corrections.
        keep_fixed_joints: function that changes commands (m, n) so that fixed joints keep their angles and
            the other joints reach the same poses; None if no joint is fixed.
        commanded_cases: the same cases with the loads that the commands correct, such as from `blend_loads`;
            None for the loads of `cases`.

    Raises:
        CasesError: a load twists a joint of unknown compliance, has no stable equilibrium, or cannot be
            compensated.
    """
    robot, limits = model.robot, CorrectionLimits() if limits is None else limits
    ramp = np.ones(len(cases)) if ramp is None else ramp
    commanded_cases = cases if commanded_cases is None else commanded_cases
    goal = model.unloaded(cases)
    uncorrected = model.deflect(cases, goal)
    goal_poses = uncorrected.unloaded_place, goal.flange_rotation
    if uncorrected.unseen.any():
        twisted = ", ".join(np.array(robot.joint_names)[uncorrected.unseen.any(axis=0)])
        raise CasesError(
            f"the load or own weight twists {twisted}, but the readings do not determine the stiffness there",
            failed=np.asarray(uncorrected.unseen.any(axis=1)),
            cause="unseen_joint",
            where="run_id",
            remedy="choose a run whose readings determine every joint that the process loads",
        )
    uncertainty = uncorrected.uncertainty_along(unit_vectors(uncorrected.displacement))
    is_uncertain = uncertainty > np.linalg.norm(uncorrected.displacement, axis=1)
    share = np.where(is_uncertain, 0.0, ramp)  # no correction where its direction is not known

    def apply_commands(angles: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return commands (m, n), their unloaded poses (m, 4, 4), and the difference (m, 6) from the goal."""
        commanded = angles if keep_fixed_joints is None else keep_fixed_joints(angles)
        poses = flange_poses(robot, commanded)
        rotation, translation = poses[:, :3, :3], poses[:, :3, 3]
        place = (cases.place[:, None] @ rotation.transpose(0, 2, 1))[:, 0] + translation
        return commanded, poses, _compute_pose_difference(*goal_poses, place, rotation)

    commanded, poses, correction = apply_commands(model.compute_commands(commanded_cases, goal, share))
    allowed_share = _compute_allowed_shares(correction, limits)
    if (allowed_share < 1.0).any():
        reduced = model.compute_commands(commanded_cases, goal, share * allowed_share)
        angles = np.where(allowed_share[:, None] < 1.0, reduced, commanded)
        commanded, poses, correction = apply_commands(angles)
    reached = uncorrected.deflect_from(Postures(robot, commanded))
    scatter = np.full(len(cases), np.nan)
    if uncorrected.covariance_root is not None:
        scatter = np.linalg.norm(uncorrected.covariance_root[:, :3], axis=(1, 2))
    compensation = Compensation(
        commanded=robot.joint_map.controller_angles(commanded),
        correction=correction,
        residual=_compute_pose_difference(*goal_poses, reached.place, reached.axes),
        uncorrected=uncorrected.motion,
        uncertainty=uncertainty,
        leverage=uncorrected.leverage,
        scatter=scatter,
        share=share * allowed_share,
        uncertain=is_uncertain,
        capped=allowed_share < 1.0,
    )
    return CompensatedPoses(compensation, poses)


def _compute_pose_difference(
    place: FloatArray, axes: FloatArray, other_place: FloatArray, other_axes: FloatArray
) -> FloatArray:
    """Return the motion (m, 6) from poses to other poses: displacement [m], then rotation vector [rad].

    Args:
        place: (m, 3) places of the first poses in R0 [m].
        axes: (m, 3, 3) axes of the first poses in R0.
        other_place: (m, 3) places of the other poses [m].
        other_axes: (m, 3, 3) axes of the other poses.
    """
    return np.concatenate([other_place - place, rotation_vectors(other_axes, axes)], axis=1)


def compute_pose_residuals(
    model: ForwardModel,
    cases: LoadCases,
    goal_poses: FloatArray,
    commanded: FloatArray,
    start_angles: FloatArray,
) -> FloatArray:
    """Compute how far loaded poses of the tool are from their goals, under given commands.

    Args:
        model: model of the loaded robot.
        cases: m loads and places on the flange.
        goal_poses: (m, 4, 4) poses that the flange must have in R0 [m].
        commanded: (m, n) angles of the model without the loads [rad].
        start_angles: (m, n) angles at which the search for the loaded postures starts [rad].

    Returns:
        (m, 6) differences, loaded minus goal: displacement [m], then rotation vector [rad], axes of R0.

    Raises:
        RequestError: a load has no stable equilibrium.
    """
    unloaded, start = Postures(model.robot, commanded), Postures(model.robot, start_angles)
    reached = model.deflect(cases, unloaded, start)
    axes = goal_poses[:, :3, :3]
    place = (axes @ cases.place[..., None])[..., 0] + goal_poses[:, :3, 3]
    return _compute_pose_difference(place, axes, reached.place, reached.axes)


def compute_ramp_shares(robot: Robot, cases: LoadCases, length: float) -> FloatArray:
    """Return the fraction (m,) of each correction: rises after the load begins, falls before the load ends.

    Args:
        robot: n joints.
        cases: m postures along a path, with their loads.
        length: length of path over which the fraction rises from 0 to 1 [m]; 0 gives 1 everywhere.
    """
    if length <= 0.0:
        return np.ones(len(cases))
    postures = Postures(robot, robot.joint_map.model_angles(cases.joints))
    steps = np.linalg.norm(np.diff(postures.to_base(cases.place[:, None])[:, 0], axis=0), axis=1)
    loaded = (cases.force != 0.0).any(axis=1) | (cases.moment != 0.0).any(axis=1)
    path_before = _measure_path_since_load(loaded, steps)
    path_after = _measure_path_since_load(loaded[::-1], steps[::-1])[::-1]
    fraction: FloatArray = np.clip(np.minimum(path_before, path_after) / length, 0.0, 1.0)
    return fraction


def _measure_path_since_load(loaded: BoolArray, steps: FloatArray) -> FloatArray:
    """Return the length of path (m,) [m] from the posture at which the load began to each posture.

    The length is zero at postures without load. If the path begins under load, the length is inf up to the
    first posture without load.

    Args:
        loaded: (m,) mask of the postures under load.
        steps: (m − 1,) distances between consecutive postures [m].
    """
    length = np.zeros(len(loaded))
    length[0] = np.inf if loaded[0] else 0.0
    for i in range(1, len(loaded)):
        length[i] = length[i - 1] + steps[i - 1] if loaded[i] and loaded[i - 1] else 0.0
    return length
