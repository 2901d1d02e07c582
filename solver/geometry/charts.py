"""Rigid transforms and directed lines, the charts in which they are uncertain, and fits that step in these.

A joint's axis is a directed line: it has four degrees of freedom. `Axis` carries a frame (u, v, a) at one
of its points, a along the axis; displacements along u and v and rotations about u and v are the *chart*
in which fits step and covariances are stated. Sliding along the axis and turning about it change
nothing, so the chart is minimal and has no singularity.

`minimise` is a damped Gauss-Newton for small non-linear least squares on such curved spaces. The state may
be anything with a `stepped` function; the Jacobian is taken in the chart at the state itself. At the minimum
the linearised fit is kept: it carries covariance, rank and what each reading does to each unknown. Unknowns
that belong to one group of readings each, such as the angle of one position, are eliminated group by group:
their number costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.robot.configuration import skew

State = TypeVar("State")

CHART_SIZE = 4
"""Degrees of freedom of a line."""

ROTATION_TOLERANCE = 1e-5
"""Tolerance of a stated rotation's orthonormality: 10 µm in a metre."""

_MOST_STEPS = 60
_MOST_TRIALS = 25
_LEAST_DAMPING, _FACTOR = 1e-12, 10.0
"""Least damping beside the squares of singular values of columns of unit norm; factor from trial to trial."""
_ROUNDING = 2e-16
_EXACT = 1e-8
"""Residual [m rms] that no tracker sees: exact readings of a joint that hardly moved end there slowly."""
_CONVERGED = 1e-9
_RANK_TOLERANCE = 1e-10
"""Singular value of the column-scaled Jacobian, relative to the largest, that counts as zero."""
_UNDETERMINED = 1e-6
"""Share of an unknown in an unobservable direction above which it is not determined."""
_IDENTITY = np.eye(3)


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """``y = R x + t``: coordinates x in one frame become y in the other. Arrays are read-only.

    It is uncertain by a small motion in the frame of y: ``y = (I + [φ]×)(R x + t) + δ``.
    """

    rotation: FloatArray  #: (3, 3) R
    translation: FloatArray  #: (3,) t [m]
    #: (6, 6) covariance of (δ, φ) [m, rad]; zero for a transform that is exact by definition
    covariance: FloatArray = field(default_factory=lambda: np.zeros((6, 6)))

    def __post_init__(self) -> None:
        for array in (self.rotation, self.translation, self.covariance):
            array.setflags(write=False)

    @classmethod
    def identity(cls) -> RigidTransform:
        """The exact transform that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def stated(cls, rotation: FloatArray, translation: FloatArray) -> RigidTransform:
        """Return a transform whose rotation (3, 3) is stated to some digits, made exact.

        Raises:
            MeasurementError: the matrix is not a rotation.
        """
        gap = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if not gap <= ROTATION_TOLERANCE or np.linalg.det(rotation) < 0.0:
            what = (
                "it is a reflection (determinant -1)"
                if gap <= ROTATION_TOLERANCE
                else f"its largest deviation is {gap:.2g}"
            )
            raise MeasurementError(
                f"the rotation matrix is not orthonormal: {what}",
                where="frame.rotation",
                remedy="give the rotation matrix from the tracker's frame to R0 row by row, with "
                "seven digits",
            )
        U, _, Vt = np.linalg.svd(rotation)
        return cls(U @ Vt, translation)

    def apply(self, points: FloatArray) -> FloatArray:
        """Transform points (..., 3) [m]."""
        return np.asarray(points @ self.rotation.T + self.translation)

    @staticmethod
    def sensitivity(moved: FloatArray) -> FloatArray:
        """Displacement (..., 3, 6) of transformed points y (..., 3) by (δ, φ)."""
        eye = np.broadcast_to(np.eye(3), (*moved.shape, 3))
        return np.concatenate([eye, -skew(moved)], axis=-1)

    def inverse(self) -> RigidTransform:
        """Return the transform from y to x; its uncertainty is a motion in the frame of x."""
        back = self.rotation.T
        S = np.zeros((6, 6))
        S[:3, :3] = S[3:, 3:] = -back
        S[:3, 3:] = back @ skew(self.translation)
        return RigidTransform(back, -back @ self.translation, S @ self.covariance @ S.T)

    def after(self, first: RigidTransform) -> RigidTransform:
        """This transform after another one, the two uncertain independently of each other."""
        S = np.zeros((6, 6))
        S[:3, :3] = S[3:, 3:] = self.rotation
        S[:3, 3:] = skew(self.translation) @ self.rotation
        covariance = self.covariance + S @ first.covariance @ S.T
        return RigidTransform(self.rotation @ first.rotation, self.apply(first.translation), covariance)

    def chart(self, other: RigidTransform) -> FloatArray:
        """The motion (δ, φ) (6,) that makes this transform the other one."""
        turn = other.rotation @ self.rotation.T
        shift = other.translation - turn @ self.translation
        return np.concatenate([shift, Rotation.from_matrix(turn).as_rotvec()])

    def displaced(self, motion: FloatArray) -> RigidTransform:
        """The transform after a motion (δ, φ) (6,); inverse of `chart`. The covariance is kept."""
        turn = Rotation.from_rotvec(motion[3:]).as_matrix()
        return RigidTransform(turn @ self.rotation, turn @ self.translation + motion[:3], self.covariance)


@dataclass(frozen=True, eq=False)
class Axis:
    """A directed line. Arrays are read-only.

    The chart of an axis has the coordinates (x, y, α, β): displacement of the point along u and v [m],
    then rotation about u and v [rad].
    """

    point: FloatArray  #: (3,) a point on it [m]
    frame: FloatArray  #: (3, 3) rotation with columns u, v and the direction a

    def __post_init__(self) -> None:
        self.point.setflags(write=False)
        self.frame.setflags(write=False)

    @classmethod
    def through(cls, point: npt.ArrayLike, direction: npt.ArrayLike) -> Axis:
        """The axis through a point (3,) [m] along a direction (3,) of any length but zero."""
        a = np.array(direction, dtype=np.float64)
        a /= np.linalg.norm(a)
        u = np.cross(np.eye(3)[np.argmin(np.abs(a))], a)
        u /= np.linalg.norm(u)
        return cls(np.array(point, dtype=np.float64), np.column_stack([u, np.cross(a, u), a]))

    @property
    def direction(self) -> FloatArray:
        """Unit vector a (3,) along the axis, in the sense of positive rotation."""
        return np.asarray(self.frame[:, 2])

    def at(self, distance: float) -> FloatArray:
        """The point (3,) at this signed distance [m] from `point`, along the direction."""
        return np.asarray(self.point + distance * self.direction)

    def nearest(self, point: FloatArray) -> FloatArray:
        """The foot (3,) of the perpendicular from a point (3,) [m]."""
        return self.at(float((point - self.point) @ self.direction))

    def displaced(self, chart: FloatArray) -> Axis:
        """The axis at these coordinates (4,) of this axis's chart."""
        angle = float(np.hypot(chart[2], chart[3]))
        about = np.array([chart[2], chart[3], 0.0]) / angle if angle > 0.0 else np.array([1.0, 0.0, 0.0])
        return Axis(self.point + self.frame[:, :2] @ chart[:2], self.frame @ _rotation(about, angle))

    def chart(self, other: Axis) -> FloatArray:
        """Coordinates (4,) of another axis, not perpendicular to this; inverse of `displaced`."""
        w = self.frame.T @ other.direction
        q = self.frame.T @ (other.point - self.point)
        x, y, _ = q - w * (q[2] / w[2])
        sine = float(np.hypot(w[0], w[1]))
        stretch = np.arctan2(sine, w[2]) / sine if sine > 0.0 else 1.0
        return np.array([x, y, -w[1] * stretch, w[0] * stretch])

    def moved(self, motion: RigidTransform) -> Axis:
        """The axis after a rigid motion, or in another frame; charts go with it unchanged."""
        return Axis(motion.rotation @ self.point + motion.translation, motion.rotation @ self.frame)

    def motion(self, angle: float) -> RigidTransform:
        """Return the rigid motion that turns about the axis by an angle [rad], by the right hand."""
        R = _rotation(self.direction, angle)
        return RigidTransform(R, self.point - R @ self.point)

    def turns(self, angles: FloatArray) -> FloatArray:
        """Rotations (K, 3, 3) about the direction by angles (K,) [rad]."""
        return _rotation(self.direction, angles)

    def turned(self, turns: FloatArray, points: FloatArray) -> FloatArray:
        """Points (K, T, 3) or (T, 3) turned about the axis by rotations (K, 3, 3): (K, T, 3) [m]."""
        return np.asarray(self.point + (points - self.point) @ np.swapaxes(turns, -1, -2))

    def turned_by_chart(self, turns: FloatArray, points: FloatArray) -> FloatArray:
        """Derivative (K, T, 3, 4) of `turned` by the chart.

        A displacement δ of the axis moves the result by (1 − R) δ; a rotation ω of it, with arm r from
        its point, by ω × R r − R (ω × r).
        """
        arms = points - self.point
        first, second = self.frame[:, :2], np.cross(self.frame[:, :2].T[:, None, None], arms[None])
        by_place = np.broadcast_to((first - turns @ first)[:, None], (len(turns), points.shape[-2], 3, 2))
        after = np.cross(first.T[:, None, None], (arms @ np.swapaxes(turns, -1, -2))[None])
        before = second @ np.swapaxes(turns, -1, -2)
        return np.concatenate([by_place, np.moveaxis(after - before, 0, -1)], axis=-1)


def _rotation(direction: FloatArray, angle: FloatArray | float) -> FloatArray:
    """Rotation (..., 3, 3) about a unit vector by angles (...) [rad], by Rodrigues.

    SciPy's Rotation takes ten times as long for a single one, and derivatives need thousands.
    """
    x, y, z = direction.tolist()
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angle), 2.0 * np.sin(0.5 * np.asarray(angle)) ** 2
    return np.asarray(_IDENTITY + (sine[..., None, None] * K + versine[..., None, None] * (K @ K)))


@dataclass(frozen=True, eq=False)
class LinearFit:
    """The linearised least squares problem ``min ‖r − J δ‖`` by its singular value decomposition.

    Columns are scaled to unit norm first, so that metres and radians do not decide the rank.
    """

    residual: FloatArray  #: (m,) r
    left: FloatArray  #: (m, k) orthonormal basis U of the range of J, k the rank
    #: (p, k) with δ = inverse Uᵀ r; of minimum norm in scaled unknowns where J is deficient
    inverse: FloatArray
    unseen: FloatArray  #: (p, p - k) orthonormal combinations of scaled unknowns that r does not determine
    scale: FloatArray  #: (p,) norms of the columns of J; 1 for a null column
    #: the unknowns of single groups of readings, if there are any; they are no part of the others
    own: OwnUnknowns | None = None

    @classmethod
    def of(cls, residual: FloatArray, jacobian: FloatArray, by_own: FloatArray | None = None) -> LinearFit:
        """Decompose, by QR first: it is cheaper for many readings.

        Args:
            residual: (m,) whitened.
            jacobian: (m, p) of the prediction, whitened.
            by_own: (G, m / G) derivative of each group of readings by its own unknown, whitened.
        """
        if by_own is not None:
            own = OwnUnknowns.of(residual, jacobian, by_own)
            return replace(cls.of(own.without(residual), own.without(jacobian)), own=own)
        norms = np.linalg.norm(jacobian, axis=0)
        scale = np.where(norms > 0.0, norms, 1.0)
        Q, R = np.linalg.qr(jacobian / scale)
        U, s, Vt = np.linalg.svd(R, full_matrices=False)
        rank = int((s > _RANK_TOLERANCE * s[0]).sum()) if s.size and s[0] > 0.0 else 0
        seen = Vt[:rank].T
        unseen = np.linalg.svd(seen)[0][:, rank:] if rank < len(scale) else np.zeros((rank, 0))
        return cls(residual, Q @ U[:, :rank], seen / s[:rank] / scale[:, None], unseen, scale)

    @property
    def pseudo_inverse(self) -> FloatArray:
        """Derivative (p, m) of the unknowns by the whitened readings."""
        return np.asarray(self.inverse @ self.left.T)

    @property
    def covariance(self) -> FloatArray:
        """(p, p) in units of sigma²; of undetermined unknowns it tells only the determined part."""
        return np.asarray(self.inverse @ self.inverse.T)

    @property
    def rank(self) -> int:
        """Number of combinations of unknowns that are determined."""
        return int(self.left.shape[1])

    @property
    def rss(self) -> float:
        """Sum of the squares of the residuals."""
        return float(self.residual @ self.residual)

    def determines(self, unknowns: slice) -> bool:
        """Return whether the readings determine all of these unknowns, one by one."""
        return bool((np.linalg.norm(self.unseen[unknowns], axis=1) < _UNDETERMINED).all())

    def step(self, damping: float = 0.0) -> FloatArray:
        """Return the least squares step δ (p,), then that of the groups' own unknowns (G,).

        Args:
            damping: λ of Levenberg's step, beside the squares of the singular values of scaled columns.
        """
        inverse_squares = np.square(self.inverse * self.scale[:, None]).sum(axis=0)
        step = self.inverse @ (self.left.T @ self.residual / (1.0 + damping * inverse_squares))
        if self.own is None:
            return np.asarray(step)
        return np.concatenate([step, (self.own.along - self.own.others @ step) / self.own.norms])

    @property
    def explained(self) -> float:
        """Norm of the part of the residual that the step would explain."""
        part = float(np.linalg.norm(self.left.T @ self.residual))
        return part if self.own is None else float(np.hypot(part, np.linalg.norm(self.own.along)))


@dataclass(frozen=True, eq=False)
class OwnUnknowns:
    """Unknowns of which each moves the readings of one group only."""

    directions: FloatArray  #: (G, m / G) unit vectors of the readings' derivatives; null where there is none
    norms: FloatArray  #: (G,) norms of these derivatives; 1 for a null one
    along: FloatArray  #: (G,) residual along the directions
    others: FloatArray  #: (G, p) the same part of the derivative by the other unknowns

    @classmethod
    def of(cls, residual: FloatArray, jacobian: FloatArray, by_own: FloatArray) -> OwnUnknowns:
        """Take the derivatives of `LinearFit.of`."""
        norms = np.linalg.norm(by_own, axis=1)
        norms = np.where(norms > 0.0, norms, 1.0)
        directions = by_own / norms[:, None]
        grouped = jacobian.reshape(*by_own.shape, -1)
        along = np.einsum("gi,gi->g", directions, residual.reshape(by_own.shape))
        return cls(directions, norms, along, np.einsum("gi,gip->gp", directions, grouped))

    @property
    def count(self) -> int:
        """Number of unknowns that the readings determine."""
        return int(self.directions.any(axis=1).sum())

    def without(self, rows: FloatArray) -> FloatArray:
        """Project rows (m,) or (m, p) on what the own unknowns do not explain."""
        grouped = rows.reshape(*self.directions.shape, -1)
        along = np.einsum("gi,gip->gp", self.directions, grouped)
        return np.asarray((grouped - self.directions[..., None] * along[:, None]).reshape(rows.shape))


def minimise(
    state: State,
    residual: Callable[[State], FloatArray],
    jacobian: Callable[[State], FloatArray],
    stepped: Callable[[State, FloatArray], State],
    *,
    where: str,
    by_own: Callable[[State], FloatArray] | None = None,
    size: float = 0.0,
    enough: float = 0.0,
) -> tuple[State, LinearFit]:
    """Minimise ``‖residual(state)‖²``, damping steps that go too far (Levenberg and Marquardt).

    It ends where a step would change the prediction by less than 1e-9 of the residual, or than rounding, or
    where rounding lets no step lower the residual any more.

    Args:
        state: to start from.
        residual: whitened readings minus prediction (m,).
        jacobian: derivative of the prediction (m, p) in the chart at the state.
        stepped: the state after a step (p,), with `by_own` (p + G,).
        where: for the message.
        by_own: derivative (G, m / G) of each group of readings by its own unknown, if there are such.
        size: norm of the whitened readings, whose rounding no fit explains.
        enough: residual [rms] below which a fit that goes on slowly has converged.

    Raises:
        MeasurementError: no convergence.
    """
    r = residual(state)
    for _ in range(_MOST_STEPS):
        linear = LinearFit.of(r, jacobian(state), None if by_own is None else by_own(state))
        if linear.explained <= max(_CONVERGED * float(np.linalg.norm(r)), _ROUNDING * size):
            return state, linear
        damping = 0.0
        for _ in range(_MOST_TRIALS):
            trial = stepped(state, linear.step(damping))
            shorter = residual(trial)
            if shorter @ shorter < r @ r:
                break
            damping = max(_LEAST_DAMPING, _FACTOR * damping)
        else:
            return state, linear
        state, r = trial, shorter
    rms = float(np.sqrt(np.mean(r**2)))
    if rms < max(_EXACT, enough):
        return state, linear
    raise MeasurementError(
        f"the fit did not converge in {_MOST_STEPS} steps; the residual is {rms:.2g} m rms",
        where=where,
        remedy="check the unit and the sign of the angles, the joint map, and the order of the rows",
    )
