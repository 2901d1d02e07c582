"""Forward models: where a load takes the tool, what the readings say of it, and which command undoes it.

Prediction, maps and programs ask a `ForwardModel`, and nothing else tells joints from elastic links
(method.md §9). A compensated path (§12) wants its *loaded* postures. Their torques are known before any
command is, so no iteration is needed for joints: ``q_cmd = θ − c ∘ τ(θ)``. The mirror of a deflection that is
computed at the wanted posture, ``x − δ(x)``, has an error of second order.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Final

import numpy as np

from jointstiff.solver.arrays import (
    BoolArray,
    FloatArray,
    cross,
    fix_axis_signs,
    greatest_eigenvalue,
)
from jointstiff.solver.errors import RequestError
from jointstiff.solver.estimation.fit import student_quantile
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.postures import Postures, rotation_vectors
from jointstiff.solver.mechanics.robot import Robot

LARGEST_TURN: Final = 0.25
"""Greatest deflection of a joint, or rotation of the flange, under a load of a process [rad]."""
_SINGULAR: Final = 1e-12
"""Eigenvalue, relative to the greatest, in equilibrated compliances, that is rounding."""


@dataclass(frozen=True, eq=False)
class WorstDirection:
    """The direction in which a force moves the place most, in B load cases."""

    compliance: FloatArray  #: (B,) greatest eigenvalue of C_tt [m/N]
    direction: FloatArray  #: (B, 3) unit vector, axes of R0
    compliance_uncertainty: FloatArray  #: (B,) standard uncertainty of the eigenvalue [m/N]; NaN if unknown
    #: (B,) standard uncertainty of the direction's angle [rad], at most a quarter turn; NaN if unknown
    direction_uncertainty: FloatArray


@dataclass(frozen=True, eq=False)
class CartesianCompliance:
    """``C_x = J_x (I − diag(c)(K_c + ∂g/∂q))⁻¹ diag(c) J_xᵀ`` in the loaded posture of B load cases.

    It maps a further small wrench at the place (N, then N·m) to the displacement of the place (m) and the
    rotation of the flange (rad), axes of R0. Directions are unit vectors (B, 3).
    """

    matrix: FloatArray  #: (B, 6, 6) blocks [m/N, m/(N·m); rad/N, rad/(N·m)]
    #: (B,) whether the load has a potential: a dead moment has none, and leaves C asymmetric
    symmetric: BoolArray
    #: returns (B, 6, n) factors L, M with ``∂C/∂c_j = L_j M_jᵀ``, and (n, n) covariance of the compliances
    #: [(rad/(N·m))²]; None if it is unknown
    by_joint: Callable[[], tuple[FloatArray, FloatArray, FloatArray]] | None

    @property
    def translation(self) -> FloatArray:
        """(B, 3, 3) C_tt [m/N]."""
        return self.matrix[:, :3, :3]

    def along(self, direction: FloatArray) -> FloatArray:
        """Return ``uᵀ C_tt u`` (B,), the compliance along directions [m/N]."""
        return np.asarray(np.einsum("bi,bij,bj->b", direction, self.translation, direction))

    def across(self, direction: FloatArray) -> FloatArray:
        """Return the greatest compliance (B,) [m/N] in the plane perpendicular to each direction.

        It is the greater eigenvalue of the symmetric part of C_tt projected on this plane.
        """
        helper = np.where(np.abs(direction[:, :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
        first = unit_vectors(cross(direction.T, helper.T).T)
        plane = np.stack([first, cross(direction.T, first.T).T], axis=1)  # (B, 2, 3)
        form = plane @ self.translation @ plane.transpose(0, 2, 1)
        a, b, c = form[:, 0, 0], 0.5 * (form[:, 0, 1] + form[:, 1, 0]), form[:, 1, 1]
        return np.asarray(0.5 * (a + c) + np.hypot(0.5 * (a - c), b))

    def stiffness_lateral_free(self, direction: FloatArray) -> FloatArray:
        """Return ``1/(uᵀ C_tt u)`` (B,) [N/m]: force per displacement along u if motion across u is free."""
        with np.errstate(divide="ignore"):
            return 1.0 / self.along(direction)

    def stiffness_lateral_blocked(self, direction: FloatArray) -> FloatArray:
        """Return ``uᵀ C_tt⁻¹ u`` (B,) [N/m]: stiffness if motion across u is blocked; inf if singular."""
        return _compute_inverse_form(self.translation, direction)

    def stiffness_rotation_blocked(self, direction: FloatArray) -> FloatArray:
        """Return ``uᵀ K_tt u`` (B,), K = C_x⁻¹ [N/m]: stiffness if all but motion along u is blocked.

        It is inf where C_x is singular.
        """
        return _compute_inverse_form(self.matrix, np.pad(direction, ((0, 0), (0, 3))))

    @cached_property
    def worst(self) -> WorstDirection:
        """Direction of the greatest compliance, with uncertainties from the law of propagation (GUM, 5.1.2).

        ``∂λ/∂c_j = vᵀ (∂C/∂c_j) v`` and ``∂v/∂c_j = Σ_m v_m v_mᵀ(∂C/∂c_j)v / (λ − λ_m)``, with the loaded
        posture held constant.
        """
        symmetric = 0.5 * (self.translation + self.translation.transpose(0, 2, 1))
        values, vectors = np.linalg.eigh(symmetric)
        worst, v = values[:, -1], fix_axis_signs(vectors[:, :, -1])
        if self.by_joint is None:
            unknown = np.full(len(v), np.nan)
            return WorstDirection(worst, v, unknown, unknown)
        left, right, covariance = self.by_joint()
        along, against = (vectors.transpose(0, 2, 1) @ factor[:, :3] for factor in (left, right))
        slopes = 0.5 * (along * against[:, -1:] + against * along[:, -1:])  # (B, 3, n): v_mᵀ ∂C/∂c_j v
        variance = np.einsum("bmi,ij,bmj->bm", slopes, covariance, slopes)
        with np.errstate(divide="ignore", invalid="ignore"):
            turned = (variance[:, :2] / np.square(worst[:, None] - values[:, :2])).sum(axis=1)
        angle = np.minimum(np.sqrt(np.where(np.isnan(turned), np.inf, turned)), 0.5 * np.pi)
        return WorstDirection(worst, v, np.sqrt(variance[:, -1]), angle)

    def deviation_along(self, direction: FloatArray) -> FloatArray:
        """Return the standard uncertainty (B,) of the compliance ``uᵀ C_tt u`` [m/N]; NaN if unknown."""
        if self.by_joint is None:
            return np.full(len(direction), np.nan)
        left, right, covariance = self.by_joint()
        slope = (direction[:, None] @ left[:, :3] * (direction[:, None] @ right[:, :3]))[:, 0]
        return np.asarray(np.sqrt(np.einsum("bi,ij,bj->b", slope, covariance, slope)))


def _compute_inverse_form(matrices: FloatArray, direction: FloatArray) -> FloatArray:
    """Return ``uᵀ A⁻¹ u`` (B,) of matrices A (B, k, k) and vectors u (B, k); inf where A is singular.

    Rows and columns are scaled to a unit diagonal before A is tested.
    """
    scale = np.sqrt(np.abs(np.diagonal(matrices, axis1=1, axis2=2)))
    scale = np.where(scale > 0.0, scale, 1.0)
    equilibrated = matrices / scale[:, :, None] / scale[:, None]
    singular = np.linalg.svd(equilibrated, compute_uv=False)
    regular = singular[:, -1] > _SINGULAR * singular[:, 0]
    out = np.full(len(matrices), np.inf)
    u = (direction / scale)[regular]
    out[regular] = (u * np.linalg.solve(equilibrated[regular], u[..., None])[..., 0]).sum(axis=1)
    return out


@dataclass(frozen=True, eq=False)
class ForwardModel(ABC):
    """Model of the loaded robot: joints alone, or joints and links."""

    first_order: ClassVar[bool]
    """Whether it is linear in the load, without own weight and complementary stiffness."""

    robot: Robot  #: n joints
    #: degrees of freedom of a sigma that comes from residuals; None for one that was given
    degrees_of_freedom: float | None = field(default=None, kw_only=True)

    @abstractmethod
    def deflect(
        self, cases: LoadCases, unloaded: Postures | None = None, near: Postures | None = None
    ) -> Deflection:
        """Compute the deflections of the robot under loads.

        Args:
            cases: B load cases.
            unloaded: kinematics of the cases without the load; None computes them.
            near: kinematics near the loaded postures; None starts at the unloaded ones.

        Raises:
            RequestError: a load has no stable equilibrium.
        """

    @abstractmethod
    def compute_commands(self, wanted: LoadCases, goal: Postures, share: FloatArray) -> FloatArray:
        """Return angles (B, n) [rad] to command, so that the deflected robot reaches the wanted postures.

        Args:
            wanted: B loaded postures.
            goal: kinematics of the wanted postures.
            share: (B,) share of the deflection that is compensated, 0 to 1.

        Raises:
            RequestError: no angles near the wanted posture bring the loaded robot there.
        """

    @abstractmethod
    def linear_displacement(self, cases: LoadCases, unloaded: Postures) -> FloatArray:
        """Return the displacements (B, 3) of the load cases' places [m], to first order in the load."""

    @abstractmethod
    def find_overloads(self, cases: LoadCases, unloaded: Postures) -> BoolArray:
        """Return a mask (B,) of load cases whose loads are too great for the model."""

    def unloaded(self, cases: LoadCases) -> Postures:
        """Return the kinematics of load cases without their loads."""
        return Postures(self.robot, self.robot.joint_map.model_angles(cases.joints))

    def quantile(self, confidence: float) -> float:
        """Return the coverage factor of an interval: its half-width over the standard uncertainty."""
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
    #: (B, 6) displacements of the places [m], then rotation vectors of the flange [rad]
    motion: FloatArray
    place: FloatArray  #: (B, 3) loaded places in R0 [m]
    axes: FloatArray  #: (B, 3, 3) axes of the flange in R0, under load

    @property
    def displacement(self) -> FloatArray:
        """(B, 3) displacements of the places [m]."""
        return self.motion[:, :3]

    @property
    def rotation(self) -> FloatArray:
        """(B, 3) rotation vectors of the flange [rad]."""
        return self.motion[:, 3:]

    @property
    @abstractmethod
    def rows(self) -> FloatArray:
        """(B, 6, p) ``∂(displacement, rotation)/∂c`` [m, then rad, / (rad/(N·m))]."""

    @property
    @abstractmethod
    def covariance_root(self) -> FloatArray | None:
        """(B, 6, r) matrices H whose product H Hᵀ is the covariance of `motion`; None if it is unknown.

        The covariance contains the uncertainty from the readings, and neither constraints nor model error.
        """

    @property
    @abstractmethod
    def unseen(self) -> BoolArray:
        """(B, n) mask of joints that the load twists, and whose compliance the readings do not determine.

        The numbers of a case with such a joint are not valid.
        """

    @property
    @abstractmethod
    def compliance(self) -> CartesianCompliance:
        """Cartesian compliance at the places, in the loaded postures."""

    @abstractmethod
    def compliance_known(self, direction: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return two masks (B,): whether compliances along directions (B, 3), and across them, are known.

        Forces in these directions may twist joints that the load itself does not twist.
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
        spread = self.model.quantile(confidence) * self.deviation_along(direction)
        return np.stack([value - spread, value + spread], axis=-1)

    def deviation_along(self, direction: FloatArray) -> FloatArray:
        """Return standard uncertainties (B,) of displacements along unit vectors [m]; NaN if unknown."""
        if self.covariance_root is None:
            return np.full(len(direction), np.nan)
        return np.asarray(np.linalg.norm((direction[:, None] @ self.covariance_root[:, :3])[:, 0], axis=1))

    @property
    def leverage(self) -> FloatArray:
        """(B,) greatest standard uncertainty of a displacement in any direction [m]; zero if unknown."""
        return (
            np.zeros(len(self.motion))
            if self.covariance_root is None
            else greatest_deviation(self.covariance_root[:, :3])
        )

    def length_uncertainties(self, covariances: FloatArray) -> FloatArray:
        """Return the standard uncertainty of each displacement's length by source, ``√(uᵀ A C_k Aᵀ u)``.

        u is the direction of the displacement, and A its derivatives with respect to the compliances.

        Args:
            covariances: (K, p, p) covariance C_k of the compliances from each of K sources [(rad/(N·m))²].

        Returns:
            (B, K) [m]; zero where nothing moves.
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
    roots = covariance_root.transpose(1, 2, 0)
    return np.asarray(np.sqrt(greatest_eigenvalue(np.einsum("ikn,jkn->ijn", roots, roots))))


@dataclass(frozen=True)
class CorrectionLimits:
    """Greatest corrections that a compensation may make."""

    displacement: float = 5e-3  #: greatest correction of the place [m]
    rotation: float = 10e-3  #: greatest correction of the orientation [rad]


@dataclass(frozen=True, eq=False)
class Compensation:
    """Commands for m wanted postures, with what they reach by the forward model of the loaded robot."""

    commanded: FloatArray  #: (m, n) angles as the controller shows them [rad]
    #: (m, 6) from the wanted to the commanded pose of the place: displacement [m], then rotation vector
    #: [rad], axes of R0
    correction: FloatArray
    #: (m, 6) from the wanted to the loaded pose under the command: the certificate [m, rad]
    residual: FloatArray
    uncorrected: FloatArray  #: (m, 6) from the wanted to the loaded pose without correction [m, rad]
    #: (m,) standard uncertainty of the deflection along itself, from the readings [m]; NaN if unknown
    uncertainty: FloatArray
    leverage: FloatArray  #: (m,) the greatest of a displacement in any direction [m]; zero if unknown
    share: FloatArray  #: (m,) share of the full correction that the command carries, 0 to 1
    uncertain: BoolArray  #: (m,) left alone, as the uncertainty of the deflection exceeds it
    capped: BoolArray  #: (m,) held back by the limits


def compensate(
    model: ForwardModel,
    wanted: LoadCases,
    limits: CorrectionLimits | None = None,
    ramp: FloatArray | None = None,
    hold: Callable[[FloatArray], FloatArray] | None = None,
) -> Compensation:
    """Compute commanded angles with which the deflected robot brings the tool to the wanted places.

    Args:
        model: model of the loaded robot.
        wanted: m postures that bring the tool to the wanted places while nothing bends: `joints` are their
            angles as the controller would show them, the load acts there.
        limits: greatest corrections.
        ramp: (m,) shares of the corrections (`ramp_shares`); None corrects in full.
        hold: function that changes commands (m, n) so that the joints that are free to move reach the same
            poses, and the other joints stay; None if all joints are free.

    Raises:
        RequestError: a load twists a joint of unknown compliance, has no stable equilibrium, or cannot be
            compensated.
    """
    robot, limits = model.robot, CorrectionLimits() if limits is None else limits
    ramp = np.ones(len(wanted)) if ramp is None else ramp
    goal = model.unloaded(wanted)
    wanted_poses = goal.to_base(wanted.place[:, None])[:, 0], goal.flange_rotation
    uncorrected = model.deflect(wanted, goal)
    if uncorrected.unseen.any():
        twisted = ", ".join(np.array(robot.joint_names)[uncorrected.unseen.any(axis=0)])
        raise RequestError(
            f"the load or own weight twists {twisted}, which the readings do not determine",
            where="run_id",
            remedy="choose a run whose readings determine every joint that the process loads",
        )
    uncertainty = uncorrected.deviation_along(unit_vectors(uncorrected.displacement))
    uncertain = uncertainty > np.linalg.norm(uncorrected.displacement, axis=1)
    share = np.where(uncertain, 0.0, ramp)  # no correction where its direction is not known

    def apply_commands(angles: FloatArray) -> tuple[Postures, FloatArray]:
        """Return the unloaded kinematics of commands (m, n), and their difference (m, 6) from the goal."""
        under = Postures(robot, angles if hold is None else hold(angles))
        place = under.to_base(wanted.place[:, None])[:, 0]
        return under, _compute_pose_difference(*wanted_poses, place, under.flange_rotation)

    under, correction = apply_commands(model.compute_commands(wanted, goal, share))
    # `cap` (m,) is the share of each correction that the limits allow.
    size = np.stack([np.linalg.norm(correction[:, :3], axis=1), np.linalg.norm(correction[:, 3:], axis=1)])
    most = np.array([[limits.displacement], [limits.rotation]])
    cap: FloatArray = np.min(np.where(size > most, most / np.where(size > 0.0, size, 1.0), 1.0), axis=0)
    if (cap < 1.0).any():
        reduced = model.compute_commands(wanted, goal, share * cap)
        under, correction = apply_commands(np.where(cap[:, None] < 1.0, reduced, under.q))
    reached = model.deflect(wanted, under, near=goal)
    return Compensation(
        commanded=robot.joint_map.controller_angles(under.q),
        correction=correction,
        residual=_compute_pose_difference(*wanted_poses, reached.place, reached.axes),
        uncorrected=uncorrected.motion,
        uncertainty=uncertainty,
        leverage=uncorrected.leverage,
        share=share * cap,
        uncertain=uncertain,
        capped=cap < 1.0,
    )


def _compute_pose_difference(
    place: FloatArray, axes: FloatArray, there: FloatArray, axes_there: FloatArray
) -> FloatArray:
    """Return the difference (m, 6) of two sets of poses: displacement [m], then rotation vector [rad], in R0.

    Args:
        place: (m, 3) places of the first poses [m].
        axes: (m, 3, 3) axes of the first poses.
        there: (m, 3) places of the second poses [m].
        axes_there: (m, 3, 3) axes of the second poses.
    """
    return np.concatenate([there - place, rotation_vectors(axes_there, axes)], axis=1)


def residuals(
    model: ForwardModel, wanted: LoadCases, goal: FloatArray, commanded: FloatArray, near: FloatArray
) -> FloatArray:
    """Compute how far loaded poses are from the wanted poses under given commands.

    Args:
        model: model of the loaded robot.
        wanted: m loads and places.
        goal: (m, 4, 4) wanted poses of the flange in R0 [m].
        commanded: (m, n) angles of the model without the loads [rad].
        near: (m, n) angles near the loaded postures, where the search for the balance starts [rad].

    Returns:
        (m, 6) differences, loaded minus wanted: displacement [m], then rotation vector [rad], axes of R0.

    Raises:
        RequestError: a load has no stable equilibrium.
    """
    under, expected = (Postures(model.robot, angles) for angles in (commanded, near))
    axes, reached = goal[:, :3, :3], model.deflect(wanted, under, expected)
    place = (axes @ wanted.place[..., None])[..., 0] + goal[:, :3, 3]
    return _compute_pose_difference(place, axes, reached.place, reached.axes)


def ramp_shares(robot: Robot, wanted: LoadCases, length: float) -> FloatArray:
    """Return the share (m,) of each correction: it rises after the load begins, and falls before it ends.

    Args:
        robot: n joints.
        wanted: m postures along a path, with their loads.
        length: length of path over which the share rises from 0 to 1 [m]; 0 gives 1 everywhere.
    """
    if length <= 0.0:
        return np.ones(len(wanted))
    here = Postures(robot, robot.joint_map.model_angles(wanted.joints))
    steps = np.linalg.norm(np.diff(here.to_base(wanted.place[:, None])[:, 0], axis=0), axis=1)
    loaded = (wanted.force != 0.0).any(axis=1) | (wanted.moment != 0.0).any(axis=1)
    since = _measure_path_since_load(loaded, steps)
    until = _measure_path_since_load(loaded[::-1], steps[::-1])[::-1]
    share: FloatArray = np.clip(np.minimum(since, until) / length, 0.0, 1.0)
    return share


def _measure_path_since_load(loaded: BoolArray, steps: FloatArray) -> FloatArray:
    """Return the length of path (m,) from where the load began to each posture [m].

    The length is zero at postures without load, and inf up to the first unloaded posture if the path begins
    under load.

    Args:
        loaded: (m,) postures under load.
        steps: (m − 1,) distances between consecutive postures [m].
    """
    length = np.zeros(len(loaded))
    length[0] = np.inf if loaded[0] else 0.0
    for i in range(1, len(loaded)):
        length[i] = length[i - 1] + steps[i - 1] if loaded[i] and loaded[i - 1] else 0.0
    return length
