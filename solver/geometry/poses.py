"""All axes and targets at once, from readings in many configurations, by maximum likelihood.

    p_kt = E_1(q_k1) E_2(q_k2) … E_n(q_kn) x_t

with E_i the rotation about axis i as it lies at model angle zero, and x_t the target there, both in the
tracker's frame. With four numbers for each axis and three for each target the model is complete and has no
number too many: offsets of joint angles, base and flange frame are conventions that are laid on it
afterwards. Angles are the controller's, but for corrections that a caller may free.

`calibrate` fits unloaded poses, for robots without sweeps, starting from the nominal model. What remains
undetermined is then the poses' fault (a joint that never moved, too few poses), not the parametrisation's;
such combinations keep their nominal values and are named.

A joint's axis is a directed line with four degrees of freedom. `Axis` has a frame (u, v, a) at one of its
points, with a along the axis. Displacements along u and v and rotations about u and v are the *chart*: the
coordinates of the steps of a fit and of covariances. Sliding the frame along the axis or turning it about the
axis changes nothing, so the chart is minimal and has no singularity. Rigid transforms are Pinocchio's:
coordinates x in one frame become y = R x + t in the other frame. The uncertainty of a transform is that of a
small motion (δ, φ) in the frame of y, ``y = (I + [φ]×)(R x + t) + δ``.

`minimise` is a damped Gauss-Newton for small non-linear least squares on such curved spaces. The state may
be anything with a `take_step` function; the Jacobian is taken in the chart at the state itself. At the
minimum the linearised fit is kept: from it follow the covariance, the rank, and the effect of each reading on
each unknown. Unknowns that affect one group of readings only, such as the angle of one position, are
eliminated group by group, so that their number costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy import special
from scipy.linalg import qr

from jointstiff.schemas.geometry import PoseEvidence
from jointstiff.solver.arrays import BoolArray, FloatArray, cross, unit_columns
from jointstiff.solver.errors import MeasurementError, NotObservableError, RobotError
from jointstiff.solver.mechanics.chain import KinematicChain
from jointstiff.solver.mechanics.measurements import whitener
from jointstiff.solver.mechanics.postures import Postures, skew
from jointstiff.solver.mechanics.robot import JointMap, Robot
from jointstiff.solver.text import length_text

State = TypeVar("State")

CHART = [0, 1, 3, 4]
"""Small motions of a frame along and about x and y: those that displace the axis along its z."""
CHART_SIZE = len(CHART)
"""Degrees of freedom of a line."""

ROTATION_TOLERANCE = 1e-5
"""Tolerance of a stated rotation's orthonormality: 10 µm in a metre."""

_MOST_STEPS = 60  # Gauss-Newton steps
_MOST_TRIALS = 25  # of growing damping, within a step
_LEAST_DAMPING, _DAMPING_FACTOR = 1e-12, 10.0
"""Least damping relative to the squares of singular values of columns of unit norm; factor from trial to
trial."""
_ROUNDING = 2e-16
_EXACT_RMS = 1e-8
"""Residual [m rms], below the noise of any tracker, at which a fit that did not converge is accepted."""
_CONVERGED = 1e-9
_RANK_TOLERANCE = 1e-10
"""Singular value of the column-scaled Jacobian, relative to the largest, that counts as zero."""
VAGUE_UNCERTAINTY: Final = 10e-3
"""Standard uncertainty of a link parameter [m or rad] beyond which a data sheet knows it better."""
LARGEST_RESIDUAL: Final = 1e-3
"""Residual of a coordinate [m rms] after the fit, above which no geometry explains the readings."""
_UNDETERMINED = 1e-6
"""Share of an unknown in an unobservable direction above which it is not determined."""


def orthonormalise_transform(rotation: FloatArray, translation: FloatArray) -> pin.SE3:
    """Return the transform with a rotation (3, 3) made exactly orthonormal and a translation (3,) [m].

    The rotation comes from a user, with a limited number of digits.

    Raises:
        MeasurementError: the matrix is not a rotation.
    """
    deviation = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if not deviation <= ROTATION_TOLERANCE or np.linalg.det(rotation) < 0.0:
        is_reflection = deviation <= ROTATION_TOLERANCE
        fault = (
            "the matrix is a reflection (determinant -1)"
            if is_reflection
            else f"the largest deviation of an element is {deviation:.2g}"
        )
        raise MeasurementError(
            f"the rotation matrix is not orthonormal: {fault}",
            where="frame.rotation",
            remedy="give the rotation matrix from the tracker's frame to R0 row by row, with seven digits",
        )
    U, _, Vt = np.linalg.svd(rotation)
    return pin.SE3(U @ Vt, translation)


def transform_points(transform: pin.SE3, points: FloatArray) -> FloatArray:
    """Return points (..., 3) [m] mapped by a rigid transform: ``R x + t``."""
    return np.asarray(points @ transform.rotation.T + transform.translation)


def build_right_handed_frame(x: FloatArray, z: FloatArray, origin: FloatArray) -> pin.SE3:
    """Return the transform from the frame with unit vectors x (3,), z (3,) and origin (3,) [m].

    x, z and the origin are given in the target frame of the transform; y = z × x.
    """
    return pin.SE3(np.column_stack([x, cross(z, x), z]), origin)


def differentiate_by_rigid_motion(points: FloatArray) -> FloatArray:
    """Return the derivative (..., 3, 6) of points (..., 3) [m] with respect to a small rigid motion.

    The motion is a translation [m], then a rotation vector [rad], about the origin.
    """
    eye = np.broadcast_to(np.eye(3), (*points.shape, 3))
    return np.concatenate([eye, -skew(points)], axis=-1)


@dataclass(frozen=True, eq=False)
class Axis:
    """A directed line.

    The chart of an axis has the coordinates (x, y, α, β): displacement of the point along u and v [m],
    then rotation about u and v [rad].
    """

    #: placement of a frame at a point of the axis [m]: u, v, and the direction a of positive rotation
    place: pin.SE3

    @classmethod
    def through(cls, point: npt.ArrayLike, direction: npt.ArrayLike) -> Axis:
        """Return the axis through a point (3,) [m] along a direction (3,), a vector of any length but zero.

        The normals u and v of the axis's frame are chosen arbitrarily.
        """
        a = np.array(direction, dtype=np.float64)
        a /= np.linalg.norm(a)
        # The coordinate axis that is least parallel to `a` gives a normal of `a` without loss of digits.
        u = cross(np.eye(3)[np.argmin(np.abs(a))], a)
        u /= np.linalg.norm(u)
        return cls(pin.SE3(np.column_stack([u, cross(a, u), a]), np.array(point, dtype=np.float64)))

    @cached_property
    def point(self) -> FloatArray:
        """A point (3,) on the axis [m]."""
        return np.array(self.place.translation)

    @cached_property
    def frame(self) -> FloatArray:
        """Rotation (3, 3) of the axis frame: columns are u and v, normal to the axis, and the direction a."""
        return np.array(self.place.rotation)

    @property
    def direction(self) -> FloatArray:
        """Unit vector a (3,) along the axis, in the sense of positive rotation."""
        return np.asarray(self.frame[:, 2])

    def point_at(self, distance: float) -> FloatArray:
        """Return the point (3,) [m] of the axis at a signed distance [m] from `point`."""
        return np.asarray(self.point + distance * self.direction)

    def nearest_point_to(self, point: FloatArray) -> FloatArray:
        """Return the point (3,) of the axis that is nearest to `point` (3,) [m]."""
        return self.point_at(float((point - self.point) @ self.direction))

    def represent_near(self, point: FloatArray) -> Axis:
        """Return the same line with the origin of its frame at the point of the line nearest to `point`.

        `point` (3,) [m] need not lie on the line.
        """
        return Axis(pin.SE3(self.frame, self.nearest_point_to(point)))

    def displace(self, chart: FloatArray) -> Axis:
        """Return the axis displaced along u and v, and turned about u and v, the normals in its frame.

        `chart` (4,) has the displacements x and y [m], then the angles α and β [rad].
        """
        x, y, alpha, beta = chart.tolist()
        turn = pin.exp3(np.array([alpha, beta, 0.0]))
        return Axis(self.place * pin.SE3(turn, np.array([x, y, 0.0])))

    def chart(self, other: Axis) -> FloatArray:
        """Return the chart coordinates (4,) of another axis relative to this axis: the inverse of `displace`.

        The coordinates are displacements x and y along the normals u and v of this axis's frame [m], then
        rotations α and β about u and v [rad]. The other axis must not be perpendicular to this axis.
        """
        direction = self.frame.T @ other.direction
        offset = self.frame.T @ (other.point - self.point)
        # The other axis pierces the plane of u and v at (x, y).
        x, y, _ = offset - direction * (offset[2] / direction[2])
        sine = float(np.hypot(direction[0], direction[1]))
        angle_over_sine = np.arctan2(sine, direction[2]) / sine if sine > 0.0 else 1.0
        return np.array([x, y, -direction[1] * angle_over_sine, direction[0] * angle_over_sine])

    def transform(self, motion: pin.SE3) -> Axis:
        """Return the axis mapped by a rigid transform: moved, or expressed in another frame.

        Chart coordinates of steps are the same before and after, because the frame of the axis moves along.
        """
        return Axis(motion * self.place)


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Linearised least-squares problem ``min ‖r − J δ‖``, solved using a singular value decomposition of J.

    Columns are scaled to unit norm first, so that metres and radians do not decide the rank.
    """

    residual: FloatArray  #: (m,) r
    range_basis: FloatArray  #: (m, k) orthonormal basis U of the range of J, k the rank
    #: (p, k) matrix in δ = inverse Uᵀ r; where J is rank deficient, δ has minimum norm in scaled unknowns
    inverse: FloatArray
    #: (p, p - k) orthonormal combinations of scaled unknowns that r does not determine
    undetermined: FloatArray
    scale: FloatArray  #: (p,) norms of the columns of J; 1 for a null column
    #: further unknowns that each affect one group of readings only, and were eliminated from the problem of
    #: the p unknowns; None without such unknowns
    group_unknowns: GroupUnknowns | None = None

    @classmethod
    def from_derivatives(
        cls,
        residual: FloatArray,
        jacobian: FloatArray,
        group_derivative: FloatArray | None = None,
        *,
        noise: float = 0.0,
    ) -> LinearFit:
        """Solve the linearised problem using a QR decomposition of J and the singular values of R.

        Args:
            residual: (m,) whitened residuals r.
            jacobian: (m, p) whitened derivative J of the prediction with respect to p unknowns.
            group_derivative: (G, m / G) whitened derivative of each of G groups of readings with respect to
                an unknown that affects this group only; None without such unknowns.
            noise: standard deviation of a whitened residual. A combination of unknowns that this noise leaves
                uncertain by more than `VAGUE_UNCERTAINTY` counts as undetermined.
        """
        if group_derivative is not None:
            unknowns = GroupUnknowns.from_derivatives(residual, jacobian, group_derivative)
            residual, jacobian = unknowns.project_out(residual), unknowns.project_out(jacobian)
            return replace(cls.from_derivatives(residual, jacobian, noise=noise), group_unknowns=unknowns)
        scaled_jacobian, scale = unit_columns(jacobian)
        Q, R = np.linalg.qr(scaled_jacobian)
        U, singular_values, Vt = np.linalg.svd(R, full_matrices=False)
        greatest = singular_values.max(initial=0.0)
        sizes = np.linalg.norm(Vt / scale, axis=1)  # of the combinations of unknowns, in m and rad
        is_determined = singular_values > _RANK_TOLERANCE * greatest
        is_determined &= noise * sizes <= VAGUE_UNCERTAINTY * singular_values
        rank = int(is_determined.sum())
        row_space = Vt[is_determined].T
        undetermined = np.linalg.svd(row_space)[0][:, rank:] if rank < len(scale) else np.zeros((rank, 0))
        return cls(
            residual,
            Q @ U[:, is_determined],
            row_space / singular_values[is_determined] / scale[:, None],
            undetermined,
            scale,
        )

    @property
    def pseudo_inverse(self) -> FloatArray:
        """Matrix (p, m) that gives the unknowns from the whitened residuals: their derivative."""
        return np.asarray(self.inverse @ self.range_basis.T)

    @property
    def covariance(self) -> FloatArray:
        """Covariance (p, p) of the unknowns in units of sigma², without undetermined combinations."""
        return np.asarray(self.inverse @ self.inverse.T)

    @property
    def rank(self) -> int:
        """Number of combinations of unknowns that the readings determine.

        The unknowns that affect one group of readings only are counted, too.
        """
        if self.group_unknowns is None:
            return int(self.range_basis.shape[1])
        # An unknown whose derivative is zero has a zero direction, and is not determined.
        return int(self.range_basis.shape[1]) + int(self.group_unknowns.directions.any(axis=1).sum())

    @property
    def rss(self) -> float:
        """Sum of the squares of the residuals."""
        return float(self.residual @ self.residual)

    def determines(self, unknowns: slice) -> bool:
        """Return whether the readings determine all unknowns of a slice."""
        return bool((np.linalg.norm(self.undetermined[unknowns], axis=1) < _UNDETERMINED).all())

    def step(self, damping: float = 0.0) -> FloatArray:
        """Return the least-squares step (p + G,): of the p unknowns, then of the unknown of each group.

        Args:
            damping: λ of Levenberg's step, added to the squares of the singular values of the scaled J.
        """
        inverse_squares = np.square(self.inverse * self.scale[:, None]).sum(axis=0)
        step = self.inverse @ (self.range_basis.T @ self.residual / (1.0 + damping * inverse_squares))
        if self.group_unknowns is None:
            return np.asarray(step)
        # Each group's unknown explains the rest along its own derivative.
        rest_along = self.group_unknowns.residual_along - self.group_unknowns.derivative_along @ step
        return np.concatenate([step, rest_along / self.group_unknowns.norms])

    @property
    def explained(self) -> float:
        """Norm of the part of the residual that the least-squares step would explain."""
        without_groups = float(np.linalg.norm(self.range_basis.T @ self.residual))
        if self.group_unknowns is None:
            return without_groups
        return float(np.hypot(without_groups, np.linalg.norm(self.group_unknowns.residual_along)))


@dataclass(frozen=True, eq=False)
class GroupUnknowns:
    """Unknowns that each affect the readings of one group only; G groups of m / G readings."""

    #: (G, m / G) unit vectors along the derivatives of the readings; zero for a zero derivative
    directions: FloatArray
    norms: FloatArray  #: (G,) norms of these derivatives; 1 for a zero derivative
    residual_along: FloatArray  #: (G,) residual along the directions
    #: (G, p) component along the directions of the derivative with respect to p other unknowns
    derivative_along: FloatArray

    @classmethod
    def from_derivatives(
        cls, residual: FloatArray, jacobian: FloatArray, group_derivative: FloatArray
    ) -> GroupUnknowns:
        """Build the unknowns of G groups of readings from whitened residuals and derivatives.

        Args:
            residual: (m,) whitened residuals.
            jacobian: (m, p) whitened derivative of the prediction with respect to the other p unknowns.
            group_derivative: (G, m / G) whitened derivative of the readings of each group with respect to the
                unknown of the group.
        """
        norms = np.linalg.norm(group_derivative, axis=1)
        norms = np.where(norms > 0.0, norms, 1.0)
        directions = group_derivative / norms[:, None]
        grouped = jacobian.reshape(*group_derivative.shape, -1)
        residual_along = np.einsum("gi,gi->g", directions, residual.reshape(group_derivative.shape))
        return cls(directions, norms, residual_along, np.einsum("gi,gip->gp", directions, grouped))

    def project_out(self, rows: FloatArray) -> FloatArray:
        """Return rows without what the groups' unknowns explain: orthogonal to their derivatives.

        `rows` are residuals (m,) or columns of a Jacobian (m, p); the result has the same shape.
        """
        grouped = rows.reshape(*self.directions.shape, -1)
        components = np.einsum("gi,gip->gp", self.directions, grouped)
        return np.asarray((grouped - self.directions[..., None] * components[:, None]).reshape(rows.shape))


class StalledFitError(MeasurementError):
    """A fit of geometry that did not converge, with its residual `rms` [m]."""

    def __init__(self, where: str, rms: float) -> None:
        super().__init__(
            f"the fit did not converge in {_MOST_STEPS} steps; the residual is {length_text(rms)} rms",
            where=where,
            remedy="check the unit and the sign of the angles, the joint map, and the order of the rows",
        )
        self.rms = rms


def minimise(
    state: State,
    residual: Callable[[State], FloatArray],
    jacobian: Callable[[State], FloatArray],
    take_step: Callable[[State, FloatArray], State],
    *,
    where: str,
    group_jacobian: Callable[[State], FloatArray] | None = None,
    readings_norm: float = 0.0,
    sufficient_rms: float = 0.0,
    noise: float = 0.0,
) -> tuple[State, LinearFit]:
    """Minimise ``‖residual(state)‖²`` using Gauss-Newton steps, damped where needed (Levenberg-Marquardt).

    The iteration ends when a step would change the prediction by less than 1e-9 of the residual or by less
    than rounding, or when no step lowers the residual any more because of rounding.

    Args:
        state: start value of the unknowns, of any type that `take_step` understands.
        residual: function that returns whitened readings minus prediction (m,) at a state.
        jacobian: function that returns the derivative (m, p) of the prediction, in the chart at a state.
        take_step: function that returns the state after a step (p,), or (p + G,) with `group_jacobian`.
        where: name of the readings in the error.
        group_jacobian: function that returns the derivative (G, m / G) of each group of readings with respect
            to an unknown that affects this group only; None without such unknowns.
        readings_norm: norm of the whitened readings; a step below their rounding errors ends the iteration.
        sufficient_rms: residual [rms] below which a fit that used all steps counts as converged.
        noise: standard deviation of a residual, by which vague combinations of unknowns keep their start
            values; 0 moves all combinations.

    Returns:
        The state at the minimum, and the linearised fit there.

    Raises:
        StalledFitError: the fit does not converge.
    """
    current_residual = residual(state)
    for _ in range(_MOST_STEPS):
        group_derivative = None if group_jacobian is None else group_jacobian(state)
        linear = LinearFit.from_derivatives(current_residual, jacobian(state), group_derivative, noise=noise)
        if linear.explained <= max(
            _CONVERGED * float(np.linalg.norm(current_residual)), _ROUNDING * readings_norm
        ):
            return state, linear
        damping = 0.0
        for _ in range(_MOST_TRIALS):
            trial = take_step(state, linear.step(damping))
            trial_residual = residual(trial)
            if trial_residual @ trial_residual < current_residual @ current_residual:
                break
            damping = max(_LEAST_DAMPING, _DAMPING_FACTOR * damping)
        else:  # no trial lowered the residual: rounding dominates
            return state, linear
        state, current_residual = trial, trial_residual
    rms = float(np.sqrt(np.mean(current_residual**2)))
    if rms < max(_EXACT_RMS, sufficient_rms):
        return state, linear
    raise StalledFitError(where, rms)


Geometry = Callable[[Sequence[Axis], FloatArray], FloatArray]
"""A quantity (k,) as a function of the n axes and the targets (T, 3), both at model angle zero."""

LEAST_REACH, MOST_REACH = 1e-2, 50.0
"""Displacements of a target [m] that no robot's readings stay below, or exceed: the unit is wrong."""

_UNDETERMINED_SHARE = (
    1e-6  # share of a quantity in undetermined combinations, above which it is not determined
)
_STEP = 1e-6  # of the difference quotients [m, rad]: both truncation and rounding are some 1e-10
_BEYOND_NOISE_P_VALUE = 1e-6  # p-value below which residuals exceed the stated sigma
_LEAST_NAMED_SHARE = 0.1  # least share of an unknown in a combination for which it is named
_FOLDS = 5
_LEAST_ENLARGEMENT: Final = 1e-9  # least singular value of a placement that is divided by
_SIMILAR_RMS = 1.1  # residual of some of the poses, relative to that of all poses, that counts as equal
_CHART_NAMES = ("across u", "across v", "about u", "about v")


@dataclass(frozen=True, eq=False)
class TrackedReadings:
    """Unloaded readings in N configurations, T targets. Arrays are checked and made read-only.

    Raises:
        MeasurementError: shapes disagree, or a number is not finite.
    """

    angles: FloatArray  #: (N, n) controller's joint angles [rad]
    points: FloatArray  #: (N, T, 3) tracker's frame [m]; anything where absent
    present: BoolArray  #: (N, T) True for targets that were read
    #: (3, 3) or (N, T, 3, 3) covariance of the readings in units of sigma²
    covariance: FloatArray = field(default_factory=lambda: np.eye(3), kw_only=True)

    def __post_init__(self) -> None:
        shape = (*self.present.shape, 3)
        if (
            self.points.shape != shape
            or self.angles.shape[:1] != shape[:1]
            or self.covariance.shape not in {(3, 3), (*shape, 3)}
        ):
            raise MeasurementError(
                f"the angles have shape {self.angles.shape}, the readings {self.points.shape}, and their "
                f"covariance {self.covariance.shape}",
                where=self.where,
                remedy="give all joint angles and a reading of each target for each position; give one "
                "covariance for all readings, or one for each reading",
            )
        if not (np.isfinite(self.angles).all() and np.isfinite(self.points[self.present]).all()):
            raise MeasurementError(
                "an angle or a coordinate is not finite",
                where=self.where,
                remedy="omit or repeat the reading",
            )
        for array in (self.angles, self.points, self.present, self.covariance):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def where(self) -> str:
        """Name of the readings in messages."""
        return "poses"

    @property
    def points_or_zero(self) -> FloatArray:
        """Readings (N, T, 3) [m], zero where absent."""
        return np.where(self.present[..., None], self.points, 0.0)

    @cached_property
    def weight(self) -> FloatArray:
        """Whitening matrices (N, T, 3, 3) in units of 1/sigma: matrix times deviation has unit covariance.

        Zero for readings that are absent.
        """
        return np.where(self.present[..., None, None], whitener(self.covariance), 0.0)


@dataclass(frozen=True, eq=False)
class Poses(TrackedReadings):
    """Unloaded poses of N configurations with T targets, for calibration. Arrays are made read-only.

    Raises:
        MeasurementError: shapes disagree, a number is not finite, sigma is not positive, or the unit of
            length is wrong.
    """

    targets: tuple[str, ...]  #: names of the T targets
    joint_map: JointMap  #: from controller to model angles
    sigma: float | None = None  #: standard uncertainty of one coordinate [m]; None if unknown

    def __post_init__(self) -> None:
        super().__post_init__()
        readings = self.points[self.present]
        reach = float(np.linalg.norm(np.ptp(readings, axis=0))) if len(readings) else 0.0
        refuse_wrong_units(self.sigma, reach)

    def __getitem__(self, rows: BoolArray) -> Poses:
        """Return the poses of the configurations that a mask (N,) selects."""
        # A common covariance (3, 3) has no rows to select.
        names = ("angles", "points", "present", *(["covariance"] if self.covariance.ndim > 2 else []))
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    @property
    def whitened(self) -> PoseReadings:
        """Readings at the model's joint angles, with whiteners in units of 1/sigma, for `fit_poses`."""
        angles = self.joint_map.model_angles(self.angles)
        no_corrections = np.zeros((len(angles), 0))
        return PoseReadings(
            angles,
            self.points_or_zero,
            self.weight,
            slopes=np.zeros_like(angles),
            basis=no_corrections,
        )


def refuse_wrong_units(sigma: float | None, reach: float) -> None:
    """Refuse a sigma that is not positive, and readings that are plausible only in another unit of length.

    Args:
        sigma: standard uncertainty of a coordinate [m]; None if unknown.
        reach: largest displacement of a target [m].

    Raises:
        MeasurementError: sigma is not positive and finite, or the displacement is not that of a robot.
    """
    if sigma is not None and not (np.isfinite(sigma) and sigma > 0.0):
        raise MeasurementError(
            f"sigma must be positive, but is {sigma}", where="noise.sigma", remedy="give a positive length"
        )
    # Targets that hardly move are implausible in metres and in millimetres: another check reports them.
    reach_in_other_unit = reach / 1e3 if reach > 1.0 else 1e3 * reach
    if LEAST_REACH <= reach <= MOST_REACH or reach_in_other_unit < LEAST_REACH:
        return
    reach_text = f"{reach:,.0f} m" if reach > 1.0 else f"{1e3 * reach:.2g} mm"
    declared_unit, likely_unit = ("m", "mm") if reach > 1.0 else ("mm", "m")
    raise MeasurementError(
        (f"no target moves farther than {reach_text}" if reach < 1.0 else f"a target moves by {reach_text}")
        + f"; {1e3 * LEAST_REACH:g} mm to {MOST_REACH:g} m is plausible",
        where="units.length",
        remedy=f"check units.length: positions in {likely_unit} seem to be declared in {declared_unit}; "
        "for a machine of another size give the robot as a URDF or table",
    )


@dataclass(frozen=True, eq=False)
class PoseReadings:
    """Readings in N configurations with their whiteners, and the corrections of joint angles to estimate."""

    angles: FloatArray  #: (N, n) angles of the model [rad]
    points: FloatArray  #: (N, T, 3) tracker's frame [m]; zero where absent
    weight: FloatArray  #: (N, T, 3, 3) whiteners in units of 1/sigma; zero where absent
    slopes: FloatArray  #: (N, n) derivative of the angles with respect to the configuration's correction
    #: (N, F) combinations of the N corrections that are estimated. None estimates each correction separately,
    #: by elimination from the readings of its configuration
    basis: FloatArray | None


@dataclass(frozen=True, eq=False)
class PoseState:
    """Unknowns of `fit_poses`: axes, targets and corrections of angles."""

    axes: tuple[Axis, ...]  #: n axes at angle zero, tracker's frame
    targets: FloatArray  #: (T, 3) at angle zero, tracker's frame [m]
    corrections: FloatArray  #: (N,) corrections of the angles [rad]

    def motion(self, readings: PoseReadings) -> Motion:
        """Return the axes and targets moved to the readings' configurations, at corrected joint angles."""
        return Motion(self.axes, self.targets, readings.angles + self.corrections[:, None] * readings.slopes)

    def displace(self, step: FloatArray) -> PoseState:
        """Return the state after a step (4 m + 3 T,): charts of the first m axes, then all targets [m]."""
        charts = step[: len(step) - self.targets.size].reshape(-1, CHART_SIZE)
        displaced = tuple(axis.displace(chart) for axis, chart in zip(self.axes, charts, strict=False))
        targets = self.targets + step[CHART_SIZE * len(charts) :].reshape(-1, 3)
        return replace(self, axes=displaced + self.axes[len(charts) :], targets=targets)


def build_arm(axes: Sequence[Axis], places: Sequence[pin.SE3], flange: pin.SE3) -> Robot:
    """Build the robot whose joints turn about these axes.

    Args:
        axes: n axes at model angle zero, base first.
        places: n frames that move with the joints, at model angle zero, in the frame of the axes.
        flange: placement of the flange frame at model angle zero, in the frame of the axes.
    """
    model, previous_place = pin.Model(), pin.SE3.Identity()
    for i, (axis, place) in enumerate(zip(axes, places, strict=True)):
        joint = pin.JointModelRevoluteUnaligned(place.rotation.T @ axis.direction)
        model.addJoint(i, joint, previous_place.actInv(place), f"joint_{i + 1}")
        previous_place = place
    model.addFrame(pin.Frame("flange", len(axes), previous_place.actInv(flange), pin.FrameType.OP_FRAME))
    return Robot(model)


class Motion:
    """Places of axes and targets in N configurations.

    Attributes:
        axes: n axes at angle zero.
        angles: (N, n) joint angles [rad].
        postures: kinematics of the arm with these axes; at angle zero, the arm's flange frame coincides with
            the frame in which the axes are given.
        points: (N, T, 3) places of the targets, which the last joint carries [m].
    """

    def __init__(self, axes: Sequence[Axis], targets: FloatArray, angles: FloatArray) -> None:
        """Place axes and targets (T, 3) [m], given at angle zero, at joint angles (N, n) [rad]."""
        self.axes, self.angles = axes, angles
        self.postures = Postures(build_arm(axes, [axis.place for axis in axes], pin.SE3.Identity()), angles)
        self.points = self.postures.to_base(np.broadcast_to(targets, (len(angles), *targets.shape)))

    def jacobian(self) -> FloatArray:
        """Return the derivative (N, T, 3, 4 n + 3 T) of the points with respect to axes and targets.

        Columns are the four chart coordinates of each axis, then the coordinates of the targets.
        """
        reading_count, target_count, _ = self.points.shape
        axis_motions = (
            self.postures.axis_motions[..., CHART].transpose(0, 2, 1, 3).reshape(reading_count, 1, 6, -1)
        )
        by_charts = differentiate_by_rigid_motion(self.points) @ axis_motions
        by_targets = np.einsum("nij,ts->ntisj", self.postures.flange_rotation, np.eye(target_count))
        return np.concatenate([by_charts, by_targets.reshape(reading_count, target_count, 3, -1)], axis=-1)

    def differentiate_by_angles(self) -> FloatArray:
        """Return the derivative (N, T, 3, n) of the points with respect to the joint angles [m/rad]."""
        return self.postures.jacobian_at(self.points)


def fit_poses(
    readings: PoseReadings,
    start: PoseState,
    *,
    where: str,
    fitted_axes: int | None = None,
    sufficient_rms: float = 0.0,
    noise: float = 0.0,
) -> tuple[PoseState, LinearFit]:
    """Fit axes, targets and corrections of angles to readings, by maximum likelihood.

    Unknowns are in this order: charts of axes (4 n), targets (3 T), then free corrections (F). A combination
    that the readings do not determine keeps its start value.

    Args:
        readings: readings in at least two configurations.
        start: start values.
        where: name of the readings in errors.
        fitted_axes: number of axes, base first, that are fitted; the other axes stay fixed. None fits all.
        sufficient_rms: residual [rms, whitened] below which a fit that used all steps counts as converged.
        noise: standard deviation of a whitened residual, by which vague combinations keep their start values.

    Returns:
        The fitted state, and the linearised fit there.

    Raises:
        StalledFitError: the fit does not converge.
    """
    fitted_axes = len(start.axes) if fitted_axes is None else fitted_axes
    chart_count = CHART_SIZE * fitted_axes
    columns_of_fixed_axes = slice(chart_count, CHART_SIZE * len(start.axes))
    geometry_count = chart_count + start.targets.size  # unknowns of axes and targets; corrections follow
    basis = readings.basis

    def take_step(state: PoseState, step: FloatArray) -> PoseState:
        """Return the state after a step of all unknowns."""
        correction = step[geometry_count:] if basis is None else basis @ step[geometry_count:]
        return replace(state.displace(step[:geometry_count]), corrections=state.corrections + correction)

    def residual(state: PoseState) -> FloatArray:
        """Return the whitened readings minus the prediction (3 N T,)."""
        gaps = readings.points - state.motion(readings).points
        return np.asarray((readings.weight @ gaps[..., None]).ravel())

    def differentiate_by_correction(motion: Motion) -> FloatArray:
        """Return the derivative (N, T, 3, 1) [m/rad] with respect to the correction of each configuration."""
        return np.asarray(
            np.einsum("ktin,kn->kti", motion.differentiate_by_angles(), readings.slopes)[..., None]
        )

    def jacobian(state: PoseState) -> FloatArray:
        """Return the whitened derivative (3 N T, p) with respect to all unknowns that are not eliminated."""
        motion = state.motion(readings)
        J = np.delete(motion.jacobian(), columns_of_fixed_axes, axis=-1)
        if basis is not None and basis.size:
            J = np.concatenate([J, differentiate_by_correction(motion) * basis[:, None, None]], axis=-1)
        return np.asarray((readings.weight @ J).reshape(readings.points.size, -1))

    def correction_jacobian(state: PoseState) -> FloatArray:
        """Return the whitened derivative (N, 3 T) with respect to the correction of each configuration."""
        return (readings.weight @ differentiate_by_correction(state.motion(readings))).reshape(
            len(readings.angles), -1
        )

    return minimise(
        start,
        residual,
        jacobian,
        take_step,
        where=where,
        group_jacobian=correction_jacobian if basis is None else None,
        readings_norm=float(np.linalg.norm(readings.weight @ readings.points[..., None])),
        sufficient_rms=sufficient_rms,
        noise=noise,
    )


@dataclass(frozen=True, eq=False)
class IdentifiedAxes:
    """Axes and targets at model angle zero, in the tracker's frame: the robot's geometry.

    Base frame, wrist centre, link lengths and the kinematic model are functions of axes and targets; their
    uncertainties follow from `covariance`.
    """

    axes: tuple[Axis, ...]  #: n axes, base first
    targets: FloatArray  #: (T, 3) [m], carried by the last axis
    names: tuple[str, ...]  #: names of the targets
    covariance: FloatArray  #: (4 n + 3 T, 4 n + 3 T) covariance of the axes' charts, then the targets
    influence: FloatArray  #: (4 n + 3 T, m) derivative with respect to the whitened readings, in sigma
    sigma: float  #: standard uncertainty of a coordinate [m], stated or pooled from the residuals
    rss: float  #: sum of squares of the residuals, whitened in units of sigma² [m²]
    dof: int  #: degrees of freedom of the residuals
    #: (4 n + 3 T, r) combinations of charts and targets that the readings do not determine: they keep their
    #: start values, and the covariance does not contain them
    undetermined: FloatArray = field(default_factory=lambda: np.zeros((0, 0)), kw_only=True)

    @property
    def n(self) -> int:
        """Number of axes."""
        return len(self.axes)

    @property
    def variance_factor(self) -> float:
        """χ²/dof: 1 on average if sigma was stated and is right; exactly 1 if sigma was not stated."""
        return self.rss / (self.dof * self.sigma**2)

    def differentiate_quantity(self, geometry: Geometry) -> FloatArray:
        """Return the derivative (k, 4 n + 3 T) of a quantity with respect to the axes' charts and targets.

        `geometry` is the function that computes the quantity (k,) from axes and targets.
        """
        return differentiate_geometry(self.axes, self.targets, geometry)

    def compute_covariance_of(self, geometry: Geometry) -> FloatArray:
        """Return the covariance (k, k) of the quantity that `geometry` computes from axes and targets."""
        J = self.differentiate_quantity(geometry)
        return np.asarray(J @ self.covariance @ J.T)

    def compute_standard_uncertainties(self, jacobian: FloatArray) -> FloatArray:
        """Return the standard uncertainties (k,) of quantities; infinite for an undetermined quantity.

        `jacobian` (k, 4 n + 3 T) is the derivative of the quantities with respect to charts and targets.
        """
        spread = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian))
        if not self.undetermined.size:
            return np.asarray(spread)
        # A quantity is undetermined if it changes along a combination that the readings do not determine.
        change = np.abs(jacobian @ self.undetermined).max(axis=1)
        largest = np.linalg.norm(jacobian, axis=1) * np.linalg.norm(self.undetermined, axis=0).max()
        return np.where(change > _UNDETERMINED_SHARE * largest, np.inf, spread)

    def compute_covariances(self, jacobian: FloatArray, size: int = 3) -> FloatArray:
        """Return the covariances (k, size, size) of k vectors of `size` components.

        All entries of a covariance are NaN if the readings do not determine a component of its vector.
        `jacobian` (k · size, 4 n + 3 T) is the derivative of the vectors with respect to charts and targets.
        """
        blocks = jacobian.reshape(-1, size, jacobian.shape[-1])
        covariances: FloatArray = blocks @ self.covariance @ blocks.transpose(0, 2, 1)
        is_undetermined = (
            np.isinf(self.compute_standard_uncertainties(jacobian)).reshape(-1, size).any(axis=1)
        )
        covariances[is_undetermined] = np.nan
        return covariances


def differentiate_numerically(quantity: Callable[[FloatArray], FloatArray], count: int) -> FloatArray:
    """Return the derivative (k, count) of a quantity at zero, from central differences.

    `quantity` takes a vector (count,) of small steps [m, rad] and returns (k,).
    """
    steps = _STEP * np.eye(count)
    return np.stack([(quantity(step) - quantity(-step)) / (2.0 * _STEP) for step in steps], axis=1)


def differentiate_geometry(axes: Sequence[Axis], targets: FloatArray, geometry: Geometry) -> FloatArray:
    """Return the derivative (k, 4 n + 3 T) of a quantity with respect to the axes' charts and the targets.

    `geometry` computes the quantity (k,) from axes and targets. Derivatives are central differences.
    """

    def evaluate_after(step: FloatArray) -> FloatArray:
        """Return the quantity (k,) after a step (4 n + 3 T,) of charts and targets."""
        charts = step[: CHART_SIZE * len(axes)].reshape(-1, CHART_SIZE)
        displaced = [
            axis.displace(chart) if chart.any() else axis for axis, chart in zip(axes, charts, strict=True)
        ]
        return geometry(displaced, targets + step[CHART_SIZE * len(axes) :].reshape(targets.shape))

    return differentiate_numerically(evaluate_after, CHART_SIZE * len(axes) + targets.size)


def list_chain_axes(chain: KinematicChain) -> tuple[tuple[Axis, ...], pin.SE3]:
    """Return (axes, flange): the joint axes of a chain in R0, and the transform from flange to R0.

    All joints are at angle zero. The point of each axis is the origin of its joint.

    Raises:
        RobotError: a joint is prismatic, so that its axis has a direction but no place.
    """
    prismatic = [joint.name for joint in chain.moving if joint.kind == "prismatic"]
    if prismatic:
        raise RobotError(
            f"only axes of revolute joints can be identified, but {', '.join(prismatic)} is prismatic",
            remedy="make this joint fixed in the model (URDF: type fixed, at its present position), and omit "
            "the joint from the readings; or use the nominal model",
            where="robot",
        )
    postures = Postures(Robot(chain.model()), np.zeros((1, len(chain.moving))))
    directions, origins = postures.angular_jacobian[0].T, postures.joint_frames[1][0]
    axes = tuple(Axis.through(origin, axis) for origin, axis in zip(origins, directions, strict=True))
    return axes, postures.flange_placement(0)


@dataclass(frozen=True, eq=False)
class CalibratedAxes(IdentifiedAxes):
    """Axes from a calibration by unloaded poses."""

    evidence: PoseEvidence  #: the unknowns that the poses determine, and the residuals
    #: stated standard uncertainty of a coordinate [m], if the residuals are significantly greater: `sigma` is
    #: then computed from the residuals; None otherwise
    exceeded_sigma: float | None


def refuse_other_joint_count(nominal: KinematicChain, poses: Poses) -> None:
    """Refuse poses with another number of angles than the nominal model has joints.

    Raises:
        MeasurementError: the numbers differ.
    """
    count = len(nominal.moving)
    if not count == poses.joint_map.n == poses.angles.shape[1]:
        raise MeasurementError(
            f"the nominal model has {count} revolute joints, but the poses have "
            f"{poses.angles.shape[1]} angles",
            where="poses",
            remedy="give the nominal model of the robot that was measured",
        )


def calibrate(
    nominal: KinematicChain,
    poses: Poses,
    *,
    start: pin.SE3 | None = None,
    hold_out: bool = True,
    sufficient_rms: float = 0.0,
    noise: float = 0.0,
) -> CalibratedAxes:
    """Calibrate a nominal model: fit its axes and the targets to unloaded poses.

    Args:
        nominal: model within some centimetres and degrees of the truth.
        poses: more readings than unknowns; 20 or more poses over the whole work area are good practice.
        start: rough transform from base to tracker; estimated from the poses if None.
        hold_out: whether to compute the error of predicted poses using cross-validation.
        sufficient_rms: residual [rms, whitened] below which a fit that used all steps counts as converged.
        noise: standard deviation of a whitened residual, by which vague combinations keep their nominal
            values; 0 lets them keep these values only if they stall the fit.

    Returns:
        Axes and targets in the tracker's frame, with their covariance.

    Raises:
        MeasurementError: the model has another number of joints, or the fit does not converge.
        NotObservableError: the readings have no more coordinates than there are unknowns.
    """
    refuse_other_joint_count(nominal, poses)
    axes, _ = list_chain_axes(nominal)
    readings = poses.whitened
    placed = place_arm(axes, readings.angles, poses.points, poses.present, start=start)
    start_state = PoseState(
        tuple(axis.transform(placed.base_to_tracker) for axis in axes),
        transform_points(placed.base_to_tracker, placed.targets),
        np.zeros(len(poses)),
    )
    try:
        state, linear = fit_poses(
            readings, start_state, where="poses", sufficient_rms=sufficient_rms, noise=noise
        )
    except StalledFitError as stalled:
        if noise or stalled.rms > LARGEST_RESIDUAL:
            raise
        # The residual is that of noise, which moves some combinations by metres along a valley of equal
        # residuals: in poses of one orientation of the tool, for instance.
        noise = stalled.rms
        state, linear = fit_poses(readings, start_state, where="poses", noise=noise)
    rms = float(np.sqrt(np.mean(np.square(linear.residual))))
    held_out_rms = _cross_validate(nominal, poses, start, rms, noise) if hold_out else None
    coordinate_count, unknown_count = 3 * int(poses.present.sum()), len(linear.scale)
    if coordinate_count <= unknown_count:
        raise NotObservableError(
            f"{coordinate_count} measured coordinates do not determine {unknown_count} unknowns",
            where="poses",
            remedy="record more poses, or more targets in each pose",
        )
    degrees_of_freedom = coordinate_count - linear.rank
    p_value = 1.0 if poses.sigma is None else special.chdtrc(degrees_of_freedom, linear.rss / poses.sigma**2)
    exceeds_sigma = bool(p_value < _BEYOND_NOISE_P_VALUE)
    sigma = (
        float(np.sqrt(linear.rss / degrees_of_freedom))
        if poses.sigma is None or exceeds_sigma
        else poses.sigma
    )
    influence = linear.pseudo_inverse
    if exceeds_sigma:
        influence = _compute_influence_of_poses(linear, len(poses)) / sigma
    unwhitened = np.linalg.pinv(readings.weight) @ linear.residual.reshape(*readings.points.shape, 1)
    evidence = PoseEvidence(
        positions=len(poses),
        unknowns=unknown_count,
        determined=linear.rank,
        only_together=_name_combinations(linear, len(state.axes), poses.targets),
        rms_residual=np.sqrt(np.mean(np.square(unwhitened[poses.present]))),
        held_out_rms=held_out_rms,
    )
    return CalibratedAxes(
        axes=state.axes,
        targets=state.targets,
        names=poses.targets,
        covariance=sigma**2 * influence @ influence.T,
        influence=influence,
        sigma=sigma,
        rss=linear.rss,
        dof=degrees_of_freedom,
        evidence=evidence,
        exceeded_sigma=poses.sigma if exceeds_sigma else None,
        undetermined=linear.undetermined / linear.scale[:, None],
    )


def _compute_influence_of_poses(linear: LinearFit, pose_count: int) -> FloatArray:
    """Return the contribution (p, N) of the residuals of each of N poses to each of p fitted unknowns.

    Columns times their transposes sum up to the covariance (p, p) of the unknowns. `pose_count` is N.
    """
    # A wrong joint angle moves all targets of a pose, so that residuals of one pose are correlated; residuals
    # of different poses are assumed independent (cluster-robust covariance, Liang and Zeger 1986). The factor
    # corrects for the degrees of freedom that the unknowns use.
    pseudo_inverse = linear.pseudo_inverse.reshape(len(linear.scale), pose_count, -1)
    contributions = (pseudo_inverse * linear.residual.reshape(pose_count, -1)).sum(axis=-1)
    degrees_of_freedom = pose_count - linear.rank / (linear.residual.size / pose_count)
    return np.asarray(contributions * np.sqrt(pose_count / degrees_of_freedom))


def _cross_validate(
    nominal: KinematicChain, poses: Poses, start: pin.SE3 | None, rms: float, noise: float
) -> float | None:
    """Return the root mean square error [m] of coordinates predicted by five-fold cross-validation.

    All poses of one posture are in the same fold. A fit that converges slowly counts as converged when its
    residual is about `rms`, the residual of all poses. By a `noise` above 0 vague combinations keep their
    nominal values. Return None if there is one posture only, or a fit fails.
    """
    _, posture_of_pose = np.unique(poses.angles, axis=0, return_inverse=True)
    count = int(posture_of_pose.max()) + 1
    if count == 1:  # no other posture is left to calibrate with
        return None
    fold_of_pose = np.random.default_rng(0).permutation(count)[posture_of_pose.reshape(-1)] % _FOLDS
    errors = []
    for fold in range(min(_FOLDS, count)):
        try:
            calibrated = calibrate(
                nominal,
                poses[fold_of_pose != fold],
                start=start,
                hold_out=False,
                sufficient_rms=_SIMILAR_RMS * rms,
                noise=noise,
            )
        except (MeasurementError, NotObservableError):
            return None
        left_out = poses[fold_of_pose == fold]
        state = PoseState(calibrated.axes, calibrated.targets, np.zeros(len(left_out)))
        errors.append((left_out.points - state.motion(left_out.whitened).points)[left_out.present])
    return float(np.sqrt(np.square(np.concatenate(errors)).mean()))


class Placement(NamedTuple):
    """An arm with the axes of its model, placed among the readings."""

    base_to_tracker: pin.SE3  # transform from R0 to the tracker's frame
    targets: FloatArray  # (T, 3) targets at model angle zero, in R0 [m]
    scale: float  # lengths of the readings relative to those of the model; 1 unless it was fitted
    rms: float  # residual of a coordinate [m], in the model's lengths


def place_arm(
    axes: Sequence[Axis],
    angles: FloatArray,
    points: FloatArray,
    present: BoolArray,
    *,
    start: pin.SE3 | None = None,
    fits_scale: bool = False,
) -> Placement:
    """Place an arm among readings, by linear least squares.

    For a reading p of target t in pose k, ``Q p + s = R_k x_t + t_k`` is linear in Q = Rᵀ, s = −Rᵀ t and the
    target x_t. Q is first fitted as nine numbers and made a rotation, then s and x_t are fitted with Q fixed.
    A known transform `start` leaves only x_t to fit.

    Args:
        axes: n axes at model angle zero, in R0.
        angles: (N, n) angles of the model [rad].
        points: (N, T, 3) readings [m].
        present: (N, T) mask of the targets that were read.
        start: transform from R0 to the tracker's frame, if it is known.
        fits_scale: whether the readings may have another unit of length than the model: the median singular
            value of Q is then the reciprocal of the scale.
    """
    pose_of_reading, target_of_reading = np.nonzero(present)
    # `Motion` needs a target; a target at the origin does not affect the postures.
    postures = Motion(axes, np.zeros((1, 3)), angles).postures
    flange_rotation = postures.flange_rotation[pose_of_reading]
    flange_position = postures.flange_translation[pose_of_reading]
    read_points = points[pose_of_reading, target_of_reading]
    coordinate_count = 3 * len(pose_of_reading)
    target_columns = np.einsum(
        "mij,mt->mitj", flange_rotation, np.eye(present.shape[1])[target_of_reading]
    ).reshape(coordinate_count, -1)
    if start is not None:
        local = (transform_points(start.inverse(), read_points) - flange_position).ravel()
        solution = np.linalg.lstsq(target_columns, local, rcond=None)[0]
        rms = float(np.sqrt(np.mean(np.square(local - target_columns @ solution))))
        return Placement(start, solution.reshape(-1, 3), 1.0, rms)
    shift_columns = np.tile(np.eye(3), (len(pose_of_reading), 1))
    rotation_columns = np.einsum("ij,mk->mijk", np.eye(3), read_points).reshape(coordinate_count, 9)
    system = np.hstack([rotation_columns, shift_columns, target_columns])
    fitted = np.linalg.lstsq(system, flange_position.ravel(), rcond=None)[0]
    U, singular_values, Vt = np.linalg.svd(fitted[:9].reshape(3, 3))
    Q = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    enlargement = float(singular_values[1]) if fits_scale else 1.0
    right_side = (enlargement * read_points @ Q.T - flange_position).ravel()
    columns = np.hstack([-shift_columns, target_columns])
    solution = np.linalg.lstsq(columns, right_side, rcond=None)[0]
    return Placement(
        base_to_tracker=pin.SE3(Q.T, -Q.T @ solution[:3]),
        targets=solution[3:].reshape(-1, 3),
        scale=1.0 / max(enlargement, _LEAST_ENLARGEMENT),
        rms=float(np.sqrt(np.mean(np.square(right_side - columns @ solution)))),
    )


def _name_combinations(linear: LinearFit, n: int, targets: Sequence[str]) -> list[list[str]]:
    """Return, for each undetermined combination of unknowns, the names of the unknowns in it.

    The combinations are chosen so that each has an unknown that is in no other combination. `n` is the number
    of axes; `targets` are the names of the targets.
    """
    names = [f"axis {i + 1} {coordinate}" for i in range(n) for coordinate in _CHART_NAMES]
    names += [f"target {target} {coordinate}" for target in targets for coordinate in "xyz"]
    # Pivoting finds the unknowns that are least determined, one for each combination.
    _, unknowns_by_pivot = qr(linear.undetermined.T, mode="r", pivoting=True)
    free_unknowns = np.sort(unknowns_by_pivot[: linear.undetermined.shape[1]])
    combinations = linear.undetermined @ np.linalg.inv(linear.undetermined[free_unknowns])
    shares = np.abs(combinations) / np.abs(combinations).max(axis=0)  # (unknowns, combinations)
    return [
        [name for name, share in zip(names, column, strict=True) if share > _LEAST_NAMED_SHARE]
        for column in shares.T
    ]
