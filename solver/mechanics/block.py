"""Blocks of observations with their exact balance, and terms: causes that can move a target, as columns.

A block holds kinematics, loads and regressors of some observations (method.md §2, §9, §13), so few that
memory stays flat however many there are. From it every term makes the columns by which its unknowns move the
targets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache, partial
from typing import ClassVar, Final, NamedTuple

import numpy as np
import pinocchio as pin

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, cross
from jointstiff.solver.errors import CasesError, RequestError, SolverError
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements, whitened
from jointstiff.solver.mechanics.postures import Postures, skew
from jointstiff.solver.mechanics.robot import Robot, copy_with_weights, in_configuration_space

_STEPS: Final = 20
"""Most Newton steps; three suffice for the loads of machining."""
_LAST_STEP: Final = 1e-8
"""Step [rad] after which Newton's method ends: the error left is half its square, 1e-16 m at arm's reach."""
_LARGEST_DEFLECTION: Final = 1.0
"""Deflection of a joint [rad] beyond which a balance may not be the balance near the unloaded posture."""
_SMALL: Final = 0.1
"""Share of the stiffness that a load takes away, up to which a series is quicker than elimination."""
_ROUNDING: Final = 1e-17
"""Size of a term of the series that is negligible next to 1."""


STANDARD_GRAVITY: FloatArray = np.array([0.0, 0.0, -9.80665])
"""Gravity in R0 with z upwards [m/s²]."""


@dataclass(frozen=True, eq=False)
class OwnWeight:
    """Masses and centres of mass of the n links; a tool and its payload belong to the last link.

    Raises:
        RequestError: a mass is negative, or a number is not finite.
    """

    absolute: ClassVar[bool] = False
    """True if deflections count from the rigid arm; False if they count from the arm that already sags."""

    #: (n,) masses [kg], zero for a link whose weight is neglected; or (n, n), where row j has the masses with
    #: which the torque of joint j is computed
    mass: FloatArray
    #: (n, 3) centres of mass in the frames that move with the joints [m]; or (n, n, 3), row j for joint j
    centre: FloatArray
    gravity: FloatArray = field(default_factory=lambda: STANDARD_GRAVITY)  #: (3,) in R0 [m/s²]

    def __post_init__(self) -> None:
        is_finite = all(np.isfinite(array).all() for array in (self.mass, self.centre, self.gravity))
        has_negative_mass = (self.mass < 0.0).any()
        shapes_agree = self.centre.shape == (*self.mass.shape, 3)
        if not is_finite or has_negative_mass or not shapes_agree:
            raise RequestError(
                "a mass is negative, or a number is not finite",
                where="own_weight",
                remedy="give each link a mass in kg and its centre in m",
            )

    def torque_and_stiffness(self, robot: Robot, postures: Postures) -> tuple[FloatArray, FloatArray]:
        """Return the torques g(q) of the weights about the joints, and ``∂g/∂q`` (method.md §9).

        Returns:
            Torques (B, n) [N·m], and their derivative (B, n, n) with respect to the joint angles [N·m/rad].
        """
        all_joints_have_the_same_masses = self.mass.ndim == 1
        if all_joints_have_the_same_masses:
            return self._compute_torques(robot, postures, self.mass, self.centre)
        posture_count, n = postures.q.shape
        torque, stiffness = np.empty((posture_count, n)), np.empty((posture_count, n, n))
        for j in range(n):
            torques, derivatives = self._compute_torques(robot, postures, self.mass[j], self.centre[j])
            torque[:, j], stiffness[:, j] = torques[:, j], derivatives[:, j]
        return torque, stiffness

    def _compute_torques(
        self, robot: Robot, postures: Postures, mass: FloatArray, centre: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return torques (B, n) of weights about the joints, and their derivatives (B, n, n), by Pinocchio.

        The links have the masses (n,) [kg], and the centres of mass (n, 3) in their frames [m].
        """
        posture_count, n = postures.q.shape
        torques, derivatives = np.empty((posture_count, n)), np.empty((posture_count, n, n))
        model = copy_with_weights(robot.model, mass, centre, self.gravity)
        data = model.createData()
        for posture, q in enumerate(in_configuration_space(model, postures.q)):
            # Pinocchio returns the torques that hold the weights: those of the weights are opposite.
            derivatives[posture] = -pin.computeGeneralizedGravityDerivatives(model, data, q)
            torques[posture] = -data.g
        return torques, derivatives


@dataclass(frozen=True, eq=False)
class LoadedJoints:
    """Torques of loads and own weight in B postures, and how elastic joints give way to them."""

    postures: Postures  #: kinematics of the postures
    torque: FloatArray  #: (B, n) torque of the load and of the own weight about the joints [N·m]
    stiffness: FloatArray  #: (B, n, n) K_c + ∂g/∂q of load and own weight [N·m/rad]
    #: (B, n, n) ``(I − diag(c)(K_c + ∂g/∂q))⁻¹``, the derivative of δθ with respect to c ∘ τ
    softened: FloatArray

    @classmethod
    def of_block(cls, block: RegressorBlock, compliance: FloatArray) -> LoadedJoints:
        """Return the joints in the configurations of a block, whose torques are known, without own weight.

        Raises:
            CasesError: a load has no equilibrium, as it softens a joint completely.
        """
        stiffness = block.complementary_stiffness
        softened = _invert_softening(compliance[:, None] * stiffness)
        return cls(block.postures, block.torque, stiffness, softened)

    @classmethod
    def compute(
        cls,
        robot: Robot,
        compliance: FloatArray,
        cases: Measurements | LoadCases,
        weight: OwnWeight | None,
        postures: Postures,
    ) -> LoadedJoints:
        """Compute the torques of load and own weight in B postures, with the arguments of `find_balance`.

        Raises:
            CasesError: a load has no equilibrium, as it softens a joint completely.
        """
        jacobian, torque = postures.load(cases.load_point, cases.force, cases.moment)
        stiffness = wrench_stiffness(postures.angular_jacobian, jacobian, cases.force, cases.moment)
        if weight is not None:
            weight_torque, weight_stiffness = weight.torque_and_stiffness(robot, postures)
            torque = torque + weight_torque
            stiffness = stiffness + weight_stiffness
        softened = _invert_softening(compliance[:, None] * stiffness)
        return cls(postures, torque, stiffness, softened)


@dataclass(frozen=True, eq=False)
class Balance:
    """Equilibrium of joint springs, loads and own weight: ``δθ = c ∘ (τ(q + δθ) + g(q + δθ) − g(q))``.

    If the own weight is `absolute`, the term g(q) is omitted, so that δθ includes the sag. Torques and
    stiffness belong to the posture before the last step of Newton's method.
    """

    joints: LoadedJoints  #: the joints in the loaded postures, before the last step
    step: FloatArray  #: (B, n) the last step [rad]
    #: (B, n) torque of the load about the joints, plus the change of the own weight's torque [N·m]
    torque: FloatArray
    start: LoadedJoints  #: the joints in the postures from which Newton's method started


def find_balance(
    robot: Robot,
    compliance: FloatArray,
    cases: Measurements | LoadCases,
    weight: OwnWeight | None,
    unloaded: Postures,
    start: LoadedJoints | None = None,
) -> Balance:
    """Find the equilibrium of joint springs, loads and own weight using Newton's method.

    The deflection δθ solves ``δθ = c ∘ τ(q + δθ)``, with τ the torques of the load and the change of the own
    weight's torques. The derivative of τ is the stiffness K of load and weight, so that a step of Newton's
    method is ``(I − diag(c) K)⁻¹ (c ∘ τ − δθ)``.

    Args:
        robot: n joints.
        compliance: (n,) joint compliances [rad/(N·m)].
        cases: B loads, measured or to be predicted.
        weight: own weight of the links; None neglects the weight.
        unloaded: B postures without the load.
        start: loaded joints in the B postures from which Newton's method starts; None for `unloaded`.

    Returns:
        The loaded postures, the torques, and the stiffness due to load and weight.

    Raises:
        CasesError: a load has no stable equilibrium near the unloaded posture.
    """
    unloaded_weight: FloatArray | float = 0.0  # g(q), by which the own weight already bends the arm
    if weight is not None and not weight.absolute:
        unloaded_weight, _ = weight.torque_and_stiffness(robot, unloaded)
    compute_joints = partial(LoadedJoints.compute, robot, compliance, cases, weight)
    start = compute_joints(unloaded) if start is None else start
    loaded = start
    for _ in range(_STEPS):
        deflection = loaded.postures.q - unloaded.q
        torque = loaded.torque - unloaded_weight
        residual = compliance * torque - deflection
        step = (loaded.softened @ residual[..., None])[..., 0]
        deflection = deflection + step
        sizes = np.abs(deflection)
        has_converged = (np.abs(step) <= _LAST_STEP).all()
        if has_converged:
            is_far = np.asarray((sizes > _LARGEST_DEFLECTION).any(axis=1))
            _refuse_cases_without_balance(is_far)
            _refuse_cases_without_balance(_is_unstable(compliance[:, None] * loaded.stiffness))
            return Balance(loaded, step, torque, start)
        may_converge = (sizes <= 2.0 * _LARGEST_DEFLECTION).all(axis=1)  # false for NaN
        _refuse_cases_without_balance(np.asarray(~may_converge))
        loaded = compute_joints(Postures(robot, unloaded.q + deflection))
    step_sizes = np.abs(step).max(axis=1)
    raise _build_no_balance_error(step_sizes > _LAST_STEP, int(np.argmax(step_sizes)))


def wrench_stiffness(
    axes: FloatArray, load_jacobian: FloatArray, force: FloatArray, moment: FloatArray
) -> FloatArray:
    """Return the complementary stiffness ``K_c,jk = ∂τ_j/∂θ_k`` of constant wrenches (method.md §2).

    A wrench turns with no joint, so that its torque τ_j about joint j changes when joint k turns by θ_k. A
    force F contributes ``(F × a_j)ᵀ v_k`` for j ≤ k, symmetric in j and k, with a_j the axis of joint j and
    v_k the column of J_v. A moment M contributes ``a_jᵀ (M × a_k)`` for k < j.

    Args:
        axes: (B, 3, n) axes of the joints in R0.
        load_jacobian: (B, 3, n) J_v at the load points [m/rad].
        force: (B, 3) force on the robot, axes of R0 [N].
        moment: (B, 3) moment on the robot about the load point, axes of R0 [N·m].

    Returns:
        The stiffness K_c (B, n, n) [N·m/rad].
    """
    # With the B loads on the last axis, all operations run along contiguous memory: (B, 3, n) → (3, n, B).
    axes, motions = (np.ascontiguousarray(each.transpose(1, 2, 0)) for each in (axes, load_jacobian))
    _, n, load_count = axes.shape
    force_cross_axes = cross(force.T[:, None], axes)
    stiffness = np.empty((n, n, load_count))
    for j in range(n):
        from_j_on = np.einsum("ib,ikb->kb", force_cross_axes[:, j], motions[:, j:])  # (F × a_j)ᵀ v_k, k ≥ j
        stiffness[j, j:] = from_j_on
        stiffness[j:, j] = from_j_on
    if moment.any():
        moment_terms = np.einsum("ijb,ikb->jkb", axes, cross(moment.T[:, None], axes))  # a_jᵀ (M × a_k)
        is_before = np.tri(n, k=-1)[..., None]  # 1 where k < j: only joints before j turn its axis
        stiffness += is_before * moment_terms
    return stiffness.transpose(2, 0, 1)  # (B, n, n)


def _invert_softening(softening: FloatArray) -> FloatArray:
    """Return ``(I − E)⁻¹`` for matrices E (B, n, n).

    If all matrices are small, the series ``(I + E)(I + E²)(I + E⁴)…`` is quicker than elimination.

    Raises:
        CasesError: a matrix is singular, so that a load case has no balance.
    """
    identity = np.eye(softening.shape[1])
    largest_norm = float(_infinity_norms(softening).max(initial=0.0))
    all_are_small = largest_norm <= _SMALL  # false for NaN
    if not all_are_small:
        try:
            return np.asarray(np.linalg.inv(identity - softening))
        except np.linalg.LinAlgError:
            is_singular = np.linalg.slogdet(identity - softening).sign == 0.0
            _refuse_cases_without_balance(is_singular)
            raise
    power = np.ascontiguousarray(softening)  # E, then E², E⁴, …
    inverse = identity + power
    norm_of_next_power = largest_norm**2
    while norm_of_next_power > _ROUNDING:
        power = power @ power
        inverse += inverse @ power
        norm_of_next_power = norm_of_next_power**2
    return inverse


def _infinity_norms(matrices: FloatArray) -> FloatArray:
    """Return the infinity norms (B,) of matrices (B, n, n): the greatest sum of magnitudes in a row."""
    return np.asarray(np.abs(matrices).sum(axis=2).max(axis=1))


def _is_unstable(softening: FloatArray) -> BoolArray:
    """Return a mask (B,) of unstable equilibria, where ``I − E`` has an eigenvalue that is not positive.

    E (B, n, n) is diag(c) times the stiffness of the load. Row sums of E below 1 prove stability without
    eigenvalues (Gershgorin).
    """
    is_doubtful: BoolArray = _infinity_norms(softening) >= 1.0
    is_unstable = is_doubtful.copy()
    if is_doubtful.any():
        doubtful = np.eye(softening.shape[1]) - softening[is_doubtful]
        has_negative_eigenvalue = (np.linalg.eigvals(doubtful).real <= 0.0).any(axis=1)
        # A zero eigenvalue may be rounded to either side: the determinant decides.
        is_singular = np.linalg.slogdet(doubtful).sign == 0.0
        is_unstable[is_doubtful] = is_singular | has_negative_eigenvalue
    return is_unstable


def _refuse_cases_without_balance(failed: BoolArray) -> None:
    """Raise a `CasesError` that names the first load case that failed, if any failed.

    `failed` (B,) marks the load cases without a balance.
    """
    if failed.any():
        first = int(np.argmax(failed))
        raise _build_no_balance_error(failed, first)


def _build_no_balance_error(failed: BoolArray, case: int) -> CasesError:
    """Return the error for the load cases of a mask (B,) without a stable equilibrium; it names one case."""
    return CasesError(
        "the robot has no stable equilibrium under this load near the unloaded posture",
        failed=failed,
        cause="overloaded",
        where=f"cases[{case}]",
        remedy="check the units of force, moment and length, or reduce the load",
    )


BLOCK_LENGTH = 3072
"""Observations per block: its arrays stay in the cache, and numpy's overhead is spread well."""

_MOST_CACHED_OBSERVATIONS = 256
"""Most observations of a set whose block is cached: a block takes 1 MB at most."""
_BLOCKS_CACHED = 16
"""Number of blocks of small sets that a process caches: the blocks used last."""


def spring_frames(postures: Postures) -> tuple[FloatArray, FloatArray]:
    """Return rotations (B, n + 1, 3, 3) and origins (B, n + 1, 3) [m] in R0 of the frames that may bend.

    These are the n frames that move with the joints, then R0 for the base.
    """
    rotations, origins = postures.joint_frames  # (B, n, 3, 3) and (B, n, 3)
    posture_count = len(rotations)
    base_rotation = np.broadcast_to(np.eye(3), (posture_count, 1, 3, 3))
    base_origin = np.zeros((posture_count, 1, 3))
    return (
        np.concatenate([rotations, base_rotation], axis=1),
        np.concatenate([origins, base_origin], axis=1),
    )


@dataclass(frozen=True, eq=False)
class RegressorBlock:
    """Regressors of B observations of T targets of a robot with n joints.

    Without a compliance, the configurations are the unloaded postures. With a compliance, they are half-way
    between the unloaded and the loaded postures, and the torques act in the loaded postures.
    """

    robot: Robot  #: n joints
    compliance: FloatArray | None  #: (n,) compliances whose balance is computed [rad/(N·m)]; None without K_c
    postures: Postures  #: kinematics of the configurations
    torque: FloatArray  #: (B, n) torque of the load about each joint [N·m]
    load_jacobian: FloatArray  #: (B, 3, n) J_v at the load point [m/rad]
    points: FloatArray  #: (B, T, 3) targets in R0, in these configurations [m]
    #: (B, T, 3, n) J_v at the targets [m/rad], projected on the direction of readings along a direction
    jacobian: FloatArray
    A: FloatArray  #: (B, T, 3, n) regressor of the deflections [m / (rad/(N·m))]; zero where not present
    measurements: Measurements  #: the observations themselves
    #: motions of terms that were computed, by term and compliances; kept for small sets
    _motions: dict[tuple[Term, bytes], Motion] = field(default_factory=dict)

    def move(self, term: Term, compliance: FloatArray) -> Motion:
        """Return the motion of targets and encoders by each unknown of a term, a cause that can move targets.

        A term's motion is computed once and kept, unless the block is large.

        Args:
            term: elastic element or error.
            compliance: (n,) joint compliances, on which the motion by errors depends [rad/(N·m)].
        """
        is_large = len(self.torque) > _MOST_CACHED_OBSERVATIONS
        if is_large:
            return term.motion(self, compliance)
        key = term, compliance.tobytes()
        if key not in self._motions:
            self._motions[key] = term.motion(self, compliance)
        return self._motions[key]

    @cached_property
    def frames(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute the targets' motion with the frames of links and base, and the load's wrench in each frame.

        The n + 1 frames are those that move with the joints, then R0 for the base.

        Returns:
            (n + 1, B, T, 3, 6) motion of the targets by translations, then rotations, of each frame about its
            own axes; (n + 1, B, 6) wrench of the load in each frame, force then moment about the frame's
            origin [N, N·m]; and (B, n + 1, 3) vectors from the origins to the load point, axes of R0 [m].
        """
        force, moment = self.measurements.force[:, None], self.measurements.moment[:, None]  # (B, 1, 3)
        rotations, origins = spring_frames(self.postures)  # (B, n + 1, 3, 3) and (B, n + 1, 3)
        to_load_point = self.postures.to_base(self.measurements.load_point[:, None]) - origins
        moment_about_origin = moment + np.cross(to_load_point, force)  # (B, n + 1, 3)

        # Now the frames come first. A vector v of R0 is Rᵀ v in a frame: as a row, vᵀ R.
        R = rotations.transpose(1, 0, 2, 3)  # (n + 1, B, 3, 3)
        moment_rows = moment_about_origin.transpose(1, 0, 2)[:, :, None]  # (n + 1, B, 1, 3)
        wrench = np.concatenate([force @ R, moment_rows @ R], axis=-1)  # (n + 1, B, 1, 6)

        # A translation t of the frame moves a target by R t, and a rotation r by (R r) × lever.
        levers = self.points - origins.transpose(1, 0, 2)[:, :, None]  # (n + 1, B, T, 3)
        by_rotations = -skew(levers) @ R[:, :, None]
        by_translations = np.broadcast_to(R[:, :, None], by_rotations.shape)
        target_motions = np.concatenate([by_translations, by_rotations], axis=-1)
        return target_motions, wrench[:, :, 0], to_load_point

    @cached_property
    def complementary_stiffness(self) -> FloatArray:
        """Complementary stiffness ``K_c,jk = ∂τ_j/∂θ_k`` (B, n, n) in these configurations [N·m/rad].

        a_j and o_j are axis and origin of joint j, p_W the load point, F and M force and moment. With
        v_j = a_j × (p_W − o_j), a joint k before j turns a_j and v_j, and a joint k after j moves p_W by v_k:
        ``K_c,jk = F · (a_min(j,k) × v_max(j,k)) + [k < j] M · (a_k × a_j)``.
        """
        loads, axes = self.measurements, self.postures.angular_jacobian
        return wrench_stiffness(axes, self.load_jacobian, loads.force, loads.moment)

    @cached_property
    def shared_motion(self) -> tuple[FloatArray, FloatArray]:
        """Compute the motion of the targets by errors that all T targets of each of B postures share.

        The motion is whitened: in units of the noise of the readings, sigma.

        Returns:
            (B, 3 T, n) motion by a turn of each joint [sigma per rad]; and (B, 3 T, 3) motion by a shift of
            all targets along each axis of R0 [sigma per m]; zero for targets that were not read.
        """
        measurements = self.measurements
        B, T, _ = self.points.shape
        by_shift = measurements.project_on_directions(np.broadcast_to(np.eye(3), (B, T, 3, 3)))
        motions = np.concatenate([self.jacobian, by_shift], axis=-1)  # (B, T, 3, n + 3)
        was_read = measurements.present[..., None, None]
        motions = whitened(measurements.covariance, np.where(was_read, motions, 0.0))
        rows = motions.reshape(B, 3 * T, -1)
        return rows[..., :-3], rows[..., -3:]

    @cached_property
    def _scatter_roots(self) -> tuple[FloatArray, FloatArray]:
        """Directions U (B, 3 T, r) of the shared errors, and their reduction (B, r) by whitening."""
        scatter = self.measurements.scatter
        return compute_scatter_roots(self.shared_motion, scatter.list_turns(self.robot.n), scatter.station)

    @cached_property
    def unloaded_readings(self) -> IndexArray:
        """Number (B,) of the unloaded reading of each observation."""
        return self.measurements.number_unloaded_readings()

    @cached_property
    def load_counts(self) -> IndexArray:
        """Number (B,) of loads in this block that share the unloaded reading of each observation."""
        return np.asarray(np.bincount(self.unloaded_readings)[self.unloaded_readings])

    def _average_over_loads(self, rows: FloatArray) -> FloatArray:
        """Return the mean of rows (B, 3 T, k) over the loads of the same unloaded reading, for each load."""
        total = np.zeros((self.unloaded_readings.max() + 1, *rows.shape[1:]))
        np.add.at(total, self.unloaded_readings, rows)
        return np.asarray(total[self.unloaded_readings] / self.load_counts[:, None, None])

    def _whiten_shared_errors(self, rows: FloatArray, variance: FloatArray) -> FloatArray:
        """Multiply rows (B, 3 T, k) by ``(v I + G Gᵀ)^(-1/2)``, with the variances v (B,) of their noise."""
        deviation = np.sqrt(variance)[:, None]
        if self.measurements.scatter:
            U, w = self._scatter_roots
            squared_motion = 1.0 / (1.0 - w) ** 2 - 1.0  # eigenvalues of G Gᵀ
            w = 1.0 - 1.0 / np.sqrt(1.0 + squared_motion / deviation**2)
            rows = rows - U @ (w[..., None] * (U.mT @ rows))
        return np.asarray(rows / deviation[..., None])

    def whiten(self, rows: FloatArray) -> FloatArray:
        """Whiten rows (B, T, 3, k) of the targets, so that the noise of each row has variance sigma².

        First each reading is whitened by its own covariance Σ. Errors that a posture's targets share add G Gᵀ
        to the covariance I of these rows. The symmetric root ``(I + G Gᵀ)^(-1/2) = I − U diag(w) Uᵀ`` keeps
        each row close to the reading that it belongs to. Weights by a robust loss apply to rows of
        independent noise.

        The deflections of m loads that share an unloaded reading have the covariance ``½ (I + 1 1ᵀ)`` in
        place of I: contrasts of the loads ½, their mean ½ (1 + m). Each has a symmetric root of its own.
        """
        measurements = self.measurements
        flat = whitened(measurements.covariance, rows).reshape(len(rows), -1, rows.shape[-1])  # (B, 3 T, k)
        if self.load_counts.max() > 1:
            mean = self._average_over_loads(flat)
            contrasts = self._whiten_shared_errors(np.asarray(flat - mean), np.full(len(rows), 0.5))
            variance_of_mean = np.asarray(0.5 * (1.0 + self.load_counts), dtype=np.float64)
            flat = contrasts + self._whiten_shared_errors(mean, variance_of_mean)
        else:
            flat = self._whiten_shared_errors(flat, np.ones(len(rows)))
        whitened_rows = flat.reshape(rows.shape)
        if measurements.weight is None:
            return whitened_rows
        return np.sqrt(measurements.weight)[..., None, None] * whitened_rows

    def whiten_encoders(self, rows: FloatArray, targets: FloatArray) -> FloatArray:
        """Whiten rows of the encoders: independent noise of variance sigma², given the rows of the targets.

        Tracker and encoders see the same turns of the joints. The errors s ~ N(0, I) that a posture's
        readings share move the targets' rows t by G s and the encoders' rows e by H s. Given the targets, s
        has the covariance ``M = (I + GᵀG)⁻¹`` and the mean M Gᵀ t; so ``e − H M Gᵀ t`` has the covariance
        ``I + H M Hᵀ``, whose inverse root makes the rows independent.

        Args:
            rows: (B, n, k) rows of the encoders [rad].
            targets: (B, T, 3, k) rows of the targets [m].
        """
        measurements = self.measurements
        scatter, lever = measurements.scatter, measurements.encoder_lever
        if not scatter.encoders or measurements.encoders is None:
            return np.asarray(lever / np.sqrt(2.0) * rows)
        # (n,) motion [sigma per rad] of each encoder's row e by a turn of its joint.
        by_turn = lever / (np.sqrt(2.0) * np.array(scatter.encoders))
        e = np.asarray(by_turn[:, None] * rows)
        joints_repeat_exactly = scatter.joints == 0.0
        if joints_repeat_exactly:
            return e
        by_joints, by_station = self.shared_motion
        G = np.concatenate([scatter.joints * by_joints, scatter.station * by_station], axis=-1)
        t = whitened(measurements.covariance, targets).reshape(*G.shape[:2], -1)  # (B, 3 T, k)
        if measurements.weight is not None:
            root_weight = np.repeat(np.sqrt(measurements.weight), 3, axis=1)[..., None]
            G, t = root_weight * G, root_weight * t
        n, error_count = len(by_turn), G.shape[-1]
        M = np.linalg.inv(np.eye(error_count) + G.mT @ G)
        own_turns = scatter.joints * by_turn * measurements.encoders.present  # (B, n)
        H = own_turns[..., None] * np.eye(n, error_count)  # an encoder sees only the turn of its own joint
        remaining = e - H @ M @ (G.mT @ t)
        # Multiply by the symmetric root V diag(λ^(-1/2)) Vᵀ of the inverse covariance.
        eigenvalues, V = np.linalg.eigh(np.eye(n) + H @ M @ H.mT)
        return np.asarray(V @ ((V.mT @ remaining) / np.sqrt(eigenvalues)[..., None]))


def compute_scatter_roots(
    shared_motion: tuple[FloatArray, FloatArray], joints: FloatArray, station: float
) -> tuple[FloatArray, FloatArray]:
    """Decompose the covariance ``I + G Gᵀ`` of whitened readings with errors that a posture's targets share.

    Args:
        shared_motion: motion of the targets by joints (B, 3 T, n) and by a common shift (B, 3 T, 3).
        joints: (n,) standard deviation of each joint's angle [rad/m of sigma].
        station: standard deviation of the common shift along each axis, in units of sigma.

    Returns:
        Directions U (B, 3 T, r), the left singular vectors of G; and factors w (B, r) with
        ``I − U diag(w) Uᵀ`` the symmetric root of the inverse covariance.
    """
    by_joints, by_station = shared_motion
    G = np.concatenate([joints * by_joints, station * by_station], axis=-1)
    U, singular_values, _ = np.linalg.svd(G, full_matrices=False)
    root_of_variance = np.sqrt(1.0 + np.square(singular_values))  # along the directions U; 1 in all others
    return U, 1.0 - 1.0 / root_of_variance


def regressor_blocks(
    robot: Robot, measurements: Measurements, compliance: FloatArray | None = None
) -> Iterator[RegressorBlock]:
    """Compute the regressors of the deflections, block by block.

    With a compliance c the regressors include the complementary stiffness (method.md §2): A c is then the
    deflection of the exact balance ``δθ = c ∘ τ(q + δθ)`` up to third order in δθ. Torques are those at
    q + δθ. Jacobians and targets are those half-way, at q + δθ/2: the motion from q to q + δθ is a rotation
    about the half-way axes, which moves each target by the rotation times the target's half-way lever.

    Args:
        robot: n joints.
        measurements: N observations.
        compliance: (n,) joint compliances [rad/(N·m)]; None neglects how deflection changes the torques.

    Returns:
        An iterator over blocks of at most `BLOCK_LENGTH` observations, in order.

    Raises:
        SolverError: a load has no equilibrium with joints of this compliance.
    """
    if len(measurements.joints) <= BLOCK_LENGTH:
        return iter((get_whole_block(robot, measurements, compliance),))
    return _compute_blocks_ahead(robot, measurements, compliance)


def _compute_blocks_ahead(
    robot: Robot, measurements: Measurements, compliance: FloatArray | None
) -> Iterator[RegressorBlock]:
    """Yield blocks in order, while a thread computes the next block."""
    previous: Future[RegressorBlock] | None = None
    with ThreadPoolExecutor(max_workers=1) as thread:
        for start in range(0, len(measurements), BLOCK_LENGTH):
            observations = measurements[start : start + BLOCK_LENGTH]
            coming = thread.submit(_compute_block, robot, observations, compliance)
            if previous is not None:
                yield previous.result()
            previous = coming
        yield coming.result()


def get_whole_block(
    robot: Robot,
    measurements: Measurements,
    compliance: FloatArray | None = None,
    independent: Measurements | None = None,
) -> RegressorBlock:
    """Return the regressors of all observations as one block; blocks of small sets are cached.

    Args:
        robot: n joints.
        measurements: observations; a block of at most `_MOST_CACHED_OBSERVATIONS` is cached.
        compliance: (n,) joint compliances with which the load is in balance, to include the complementary
            stiffness; None to neglect the complementary stiffness.
        independent: the same readings with other sizes of shared errors, which have the same regressors; None
            if there are none.

    Raises:
        SolverError: a load has no equilibrium with joints of this compliance.
    """
    if _is_large(measurements):
        return _compute_block(robot, measurements, compliance)
    hashable = None if compliance is None else tuple(compliance.tolist())
    if independent is None:
        return _get_cached_block(robot, measurements, hashable)
    return _get_cached_block_with_shared_errors(robot, measurements, hashable, independent)


def _is_large(measurements: Measurements) -> bool:
    """Return whether a set is too large for the blocks that are cached."""
    return len(measurements) > _MOST_CACHED_OBSERVATIONS


@lru_cache(maxsize=_BLOCKS_CACHED)
def _get_cached_block(
    robot: Robot, measurements: Measurements, compliance: tuple[float, ...] | None
) -> RegressorBlock:
    """Return the regressors of a small set from a cache of the blocks used last; compute if not there."""
    array = None if compliance is None else np.array(compliance)
    return _compute_block(robot, measurements, array)


@lru_cache(maxsize=_BLOCKS_CACHED)
def _get_cached_block_with_shared_errors(
    robot: Robot,
    measurements: Measurements,
    compliance: tuple[float, ...] | None,
    independent: Measurements,
) -> RegressorBlock:
    """Return the block of the same readings with other sizes of shared errors; all arrays are the same."""
    return replace(_get_cached_block(robot, independent, compliance), measurements=measurements)


def unloaded_postures(robot: Robot, measurements: Measurements) -> Postures:
    """Return the kinematics of the unloaded configurations of a set; kinematics of small sets are cached."""
    if _is_large(measurements):
        return Postures(robot, robot.joint_map.model_angles(measurements.joints))
    return get_whole_block(robot, measurements).postures


def targets_in_flange(robot: Robot, part: Measurements) -> FloatArray:
    """Return the mean place (T, 3) of each target in the flange frame [m] over all observations.

    Targets that were never read are at the origin.
    """
    converted = unloaded_postures(robot, part).to_flange(part.position)
    places = np.where(part.in_flange[..., None], part.position, converted)  # (N, T, 3)
    was_read = part.present[..., None]
    sums = np.where(was_read, places, 0.0).sum(axis=0)
    counts = np.maximum(was_read.sum(axis=0), 1)
    return np.asarray(sums / counts)


def _compute_block(robot: Robot, part: Measurements, compliance: FloatArray | None) -> RegressorBlock:
    """Compute the regressors of some observations, by which joint compliances move the targets.

    Without a compliance, the torques are those in the unloaded postures. With joint compliances (n,), they
    are those in the loaded postures, found by Newton's method, and the targets move about axes half-way.

    Raises:
        SolverError: a load has no equilibrium with joints of this compliance.
    """
    if compliance is None:
        postures = Postures(robot, robot.joint_map.model_angles(part.joints))
        return unloaded_block(robot, postures, part)
    unloaded, start = unloaded_postures(robot, part), None
    try:
        if not _is_large(part):  # Newton's method starts from torques that do not depend on the compliances
            start = LoadedJoints.of_block(get_whole_block(robot, part), compliance)
        equilibrium = find_balance(robot, compliance, part, None, unloaded, start)
    except RequestError:
        raise SolverError(
            "with such soft joints, the loaded arm has no equilibrium near the unloaded posture",
            where="complementary_stiffness",
            remedy="neglect the complementary stiffness, or check the units of force and length",
        ) from None
    # The torques belong to the postures before Newton's last step: follow them along this step.
    change = equilibrium.joints.stiffness @ equilibrium.step[..., None]
    torque = equilibrium.torque + change[..., 0]
    halfway = Postures(robot, unloaded.q + 0.5 * compliance * torque)
    in_flange = np.where(part.in_flange[..., None], part.position, unloaded.to_flange(part.position))
    points = halfway.to_base(in_flange)
    load_jacobian, _ = halfway.load(part.load_point, part.force, part.moment)
    return _assemble_block(robot, compliance.copy(), halfway, load_jacobian, torque, points, part)


def unloaded_block(robot: Robot, postures: Postures, part: Measurements) -> RegressorBlock:
    """Return the regressors of observations in known unloaded postures, without complementary stiffness."""
    points = part.position
    if part.in_flange.any():
        points = np.where(part.in_flange[..., None], postures.to_base(points), points)
    load_jacobian, torque = postures.load(part.load_point, part.force, part.moment)
    return _assemble_block(robot, None, postures, load_jacobian, torque, points, part)


def _assemble_block(
    robot: Robot,
    compliance: FloatArray | None,
    postures: Postures,
    load_jacobian: FloatArray,
    torque: FloatArray,
    points: FloatArray,
    part: Measurements,
) -> RegressorBlock:
    """Build a block of B observations from kinematics and torques.

    The regressor A (B, T, 3, n) is the motion of the targets by each joint times the joint's torque: A c is
    the deflection with joint compliances c.

    Args:
        robot: n joints.
        compliance: (n,) compliances whose balance is included [rad/(N·m)]; None without.
        postures: kinematics of the configurations.
        load_jacobian: (B, 3, n) Jacobian J_v at the load points [m/rad].
        torque: (B, n) torque of the load about each joint [N·m].
        points: (B, T, 3) places of the targets in R0 [m].
        part: the observations.
    """
    jacobian = part.project_on_directions(postures.jacobian_at(points))
    A = np.multiply(jacobian, torque[:, None, None], order="C")
    if not part.present.all():
        A[~part.present] = 0.0
    return RegressorBlock(robot, compliance, postures, torque, load_jacobian, points, jacobian, A, part)


class BlockRows(NamedTuple):
    """Rows of a block: K columns of terms, then a column of readings; zero for missing readings."""

    block: RegressorBlock  #: B observations
    targets: FloatArray  #: (B, T, 3, K + 1) rows of the targets [m], axes of R0
    encoders: FloatArray | None  #: (B, n, K + 1) rows of the encoders [rad]; None without encoders
    widths: dict[str, int]  #: number of columns of each term

    @property
    def flat(self) -> FloatArray:
        """Rows (B, m, K + 1) of each observation: those of its targets, then those of its encoders."""
        B, T, _, width = self.targets.shape
        targets = self.targets.reshape(B, 3 * T, width)
        if self.encoders is None:
            return targets
        return np.concatenate([targets, self.encoders], axis=1)

    @property
    def read(self) -> IndexArray:
        """Number (B,) of coordinates and encoders that were read in each observation."""
        measurements = self.block.measurements
        read: IndexArray = measurements.coordinates.sum(axis=1)
        if measurements.encoders is not None:
            read = read + measurements.encoders.present.sum(axis=1)
        return read

    def whiten(self) -> BlockRows:
        """Return the rows whitened: combined so that their noise is independent, with variance sigma².

        The deflection of an encoder is a difference of two readings, with variance 2 σ_e² (method.md §2).
        """
        targets = self.block.whiten(self.targets)
        encoders = self.encoders
        if encoders is not None:
            encoders = self.block.whiten_encoders(encoders, self.targets)
        return self._replace(targets=targets, encoders=encoders)

    def scale(self, units: FloatArray) -> BlockRows:
        """Return the rows in other units of the unknowns; the units (K + 1,) multiply the columns."""
        encoders = None if self.encoders is None else self.encoders * units
        return self._replace(targets=self.targets * units, encoders=encoders)


class Motion(NamedTuple):
    """Motion of targets and joints for one unit of each of k unknowns."""

    targets: FloatArray  #: (B, T, 3, k) motion of the targets [m per unit], axes of R0
    #: (B, n, k) motion of the joints as secondary encoders show it [rad per unit]; None if they show nothing
    joints: FloatArray | None = None


def return_no_uncertainty(_: CommonUncertainty) -> tuple[float, ...]:
    """Return an empty tuple, for a term whose uncertainty is never stated with the readings."""
    return ()


@dataclass(frozen=True)
class Term:
    """Cause that can move a target: an elastic element or an error, with columns for its unknowns.

    Fits, tests for suspected causes, uncertainty budgets and plans are made of terms. Terms are pickled, so
    that their functions must be defined at module level.
    """

    name: str  #: name in budgets, tests and plans
    unit: str  #: unit of its unknowns
    #: function that returns the motion per unit of its unknowns, at joint compliances (n,) [rad/(N·m)]
    motion: Callable[[RegressorBlock, FloatArray], Motion]
    #: function that returns the stated standard uncertainties, which repeat over the unknowns; may be empty
    prior: Callable[[CommonUncertainty], tuple[float, ...]] = return_no_uncertainty
    suspected: bool = False  #: whether it is tested as a cause of what the joints leave unexplained
    #: function that returns measurements with loads changed by the unknowns; None if targets move directly
    change_loads: Callable[[Robot, Measurements, FloatArray], Measurements] | None = None
    nonnegative: bool = False  #: whether its unknowns cannot be negative
    #: function that returns, for its fitted unknowns, the term of what is uncertain about its columns; the
    #: unknowns of that term are zero with a standard uncertainty of 1
    doubt: Callable[[FloatArray], Term] | None = None
    words: str = ""  #: description of the cause for messages, with a place {} for its unknowns
    remedy: str = ""  #: what to check or to read to confirm the cause
    #: standard uncertainty of its unknowns that plans under one load account for; 0 for none
    hedged: float = 0.0


@dataclass(frozen=True, eq=False)
class FittedErrors:
    """Errors that were fitted together with the joints and subtracted from the readings: K unknowns."""

    terms: tuple[Term, ...]  #: fitted terms
    unknowns: tuple[FloatArray, ...]  #: (k,) fitted values of each term, in its unit
    root: FloatArray  #: (K, r) root R of the covariance R Rᵀ of all unknowns
    determined: int  #: number of combinations of the unknowns that the readings distinguish from the joints
    #: labels of the observations under each distinct load, before fitted errors changed the loads
    labels_by_load: tuple[tuple[str, ...], ...] = ()


NOTHING_FITTED: Final = FittedErrors((), (), np.zeros((0, 0)), 0)


@dataclass(frozen=True, eq=False)
class CorrectedMeasurements(Measurements):
    """Measurements from which the motion of fitted errors was subtracted."""

    fitted: FittedErrors = NOTHING_FITTED

    @classmethod
    def from_measurements(cls, measurements: Measurements, fitted: FittedErrors) -> CorrectedMeasurements:
        """Attach the fitted errors to measurements that are already corrected for these errors."""
        values = {field.name: getattr(measurements, field.name) for field in fields(Measurements)}
        return cls(**values, fitted=fitted)


def fitted_errors(measurements: Measurements) -> FittedErrors:
    """Return the fitted errors of corrected measurements; `NOTHING_FITTED` for uncorrected measurements."""
    return measurements.fitted if isinstance(measurements, CorrectedMeasurements) else NOTHING_FITTED


def move_by_torque(block: RegressorBlock, compliance: FloatArray, torque: FloatArray) -> Motion:
    """Return the motion due to joint torques τ (B, n, k): ``J (c ∘ τ)`` of targets, ``c ∘ τ`` of joints."""
    joint_turns = compliance[:, None] * torque
    return Motion(block.jacobian @ joint_turns[:, None], joint_turns)


def build_rows(block: RegressorBlock, terms: Sequence[Term], compliance: FloatArray) -> BlockRows:
    """Build the least-squares rows [A d] of ``A x ≈ d``: motions A by unit unknowns x, and readings d.

    Args:
        block: B observations.
        terms: causes that can move targets, with a column of A for each unknown.
        compliance: (n,) compliances of the joints, on which the columns of errors depend [rad/(N·m)].
    """
    measurements, encoders = block.measurements, block.measurements.encoders
    motions = {term.name: block.move(term, compliance) for term in terms}
    widths = {name: motion.targets.shape[-1] for name, motion in motions.items()}
    columns = [motion.targets for motion in motions.values()]
    columns.append(measurements.deflection[..., None])
    targets = np.concatenate(columns, axis=-1)  # (B, T, 3, K + 1)
    if measurements.direction is not None:
        targets = measurements.project_on_directions(targets)
    if not measurements.present.all():
        targets[~measurements.present] = 0.0
    if encoders is None:
        return BlockRows(block, targets, None, widths)

    columns = []
    for name, motion in motions.items():
        no_motion = np.zeros((*measurements.joints.shape, widths[name]))
        columns.append(no_motion if motion.joints is None else motion.joints)
    columns.append(encoders.deflection[..., None])
    encoder_rows = np.concatenate(columns, axis=-1)  # (B, n, K + 1)
    encoder_rows = np.where(encoders.present[..., None], encoder_rows, 0.0)
    return BlockRows(block, targets, encoder_rows, widths)
