"""Calibration of a nominal model from unloaded poses, for robots without sweeps.

The fit is `pose_fit`: all axes as lines and all targets, in the tracker's frame, starting from the nominal
model. It has no redundant unknowns, so that what remains undetermined is the poses' fault (a joint that never
moved, too few poses), not the parametrisation's; such combinations keep their nominal values and are
named. Tracker to base, offsets of joint angles and link parameters follow from the axes as they do from
those of sweeps (`base_frame`, `identified_model.link_table`), with their uncertainties.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError, NotObservableError
from jointstiff.solver.geometry.frames.base_frame import chain_axes
from jointstiff.solver.geometry.frames.rigid_transform import RigidTransform
from jointstiff.solver.geometry.gauss_newton import LinearFit
from jointstiff.solver.geometry.sweeps.identified_axes import IdentifiedAxes, posed
from jointstiff.solver.geometry.sweeps.pose_fit import PoseReadings, Poses, PoseState, fit_poses
from jointstiff.solver.robot.chain import KinematicChain
from jointstiff.solver.text import length_text
from jointstiff.solver.triangle import whitener

_BEYOND_NOISE = 1e-6  # probability of chance below which residuals exceed the stated sigma
_NAMED = 0.1  # least share of an unknown in a combination for which it is named
_FOLDS = 5
_LIKE_ALL = 1.1  # residual of a part beside that of all poses that counts as the same
_CHART_NAMES = ("across u", "across v", "about u", "about v")


@dataclass(frozen=True, eq=False)
class CalibratedAxes(IdentifiedAxes):
    """Axes from a calibration."""

    residuals: FloatArray  #: (N, T, 3) reading less prediction [m]; zero where absent
    rank: int  #: number of combinations of unknowns that were determined, of 4 n + 3 T
    #: for each combination that was not, the names of the unknowns in it
    only_together: tuple[tuple[str, ...], ...]
    #: standard uncertainty of a coordinate that was stated [m]; None if there was none
    stated_sigma: float | None
    exceeds_stated: bool  #: whether the residuals exceed it beyond chance; `sigma` is then from them
    #: root mean square error of a coordinate of poses that were left out of the fit, in turn [m]; None where
    #: the others do not determine the geometry
    held_out_rms: float | None

    @property
    def positions(self) -> int:
        """Number of poses."""
        return len(self.residuals)

    @property
    def unknowns(self) -> int:
        """Number of unknowns, 4 n + 3 T."""
        return len(self.covariance)

    @property
    def determined(self) -> int:
        """Number of combinations of unknowns that the poses determine."""
        return self.rank

    @property
    def rms_residual(self) -> float:
        """Root mean square of the residuals' coordinates [m]."""
        read = self.residuals[self.residuals.any(axis=-1)]
        return float(np.sqrt(np.mean(np.square(read)))) if read.size else 0.0

    def findings(self) -> tuple[Finding, ...]:
        """Return what was not determined, and residuals beyond the stated noise."""
        undetermined = tuple(
            Finding(
                code="parameters_not_identified",
                weight="use_with_care",
                where="poses",
                message=(
                    "the poses do not determine "
                    + ("a combination of " if len(names) > 1 else "")
                    + ", ".join(names)
                ),
                remedy="add poses in which all joints turn over most of their range",
            )
            for names in self.only_together
        )
        return (*self._beyond_noise(), *undetermined)

    def _beyond_noise(self) -> tuple[Finding, ...]:
        if not self.exceeds_stated or self.stated_sigma is None:
            return ()
        return (
            Finding(
                code="residuals_exceed_sigma",
                weight="use_with_care",
                where="poses",
                message=(
                    f"the residuals give sigma = {length_text(self.sigma)}, but "
                    f"{length_text(self.stated_sigma)} was stated: gear errors and sag, which no geometry "
                    "explains, are part of it; the uncertainties include the part that changes from pose "
                    "to pose"
                ),
                remedy="sweep single joints, which shows gear errors separately, or correct sigma",
            ),
        )


def calibrate(
    nominal: KinematicChain,
    poses: Poses,
    *,
    start: RigidTransform | None = None,
    hold_out: bool = True,
    enough: float = 0.0,
) -> CalibratedAxes:
    """Calibrate a nominal model.

    Args:
        nominal: within some centimetres and degrees of the truth.
        poses: more readings than unknowns; 20 or more poses over the whole work area are good practice.
        start: rough transform from base to tracker; found from the poses if None.
        hold_out: whether to find the error of poses that are left out.
        enough: residual [rms, whitened] below which a fit that goes on slowly has converged.

    Raises:
        MeasurementError: the model has another number of joints, or the fit does not converge.
        NotObservableError: fewer coordinates than combinations that they should determine.
    """
    axes, _ = chain_axes(nominal)
    if len(axes) != poses.joint_map.n:
        raise MeasurementError(
            f"the nominal model has {len(axes)} revolute joints, but the poses have "
            f"{poses.joint_map.n} angles",
            where="poses",
            remedy="give the nominal model of the robot that was measured",
        )
    angles = poses.joint_map.model_angles(poses.angles)
    motions = [posed(axes, q)[1:] for q in angles]
    T, at_zero = _start(motions, poses, start)
    first = PoseState(
        tuple(axis.moved(T.rotation, T.translation) for axis in axes),
        T.apply(at_zero),
        np.zeros(len(angles)),
    )
    readings = pose_readings(angles, poses)
    state, linear = fit_poses(readings, first, where="poses", enough=enough)
    rms = float(np.sqrt(np.mean(np.square(linear.residual))))
    held_out_rms = _held_out_rms(nominal, poses, start, rms) if hold_out else None
    coordinates = 3 * int(poses.present.sum())
    if coordinates <= len(linear.scale):
        raise NotObservableError(
            f"{coordinates} measured coordinates do not determine {len(linear.scale)} unknowns",
            where="poses",
            remedy="record more poses, or more targets in each pose",
        )
    dof = coordinates - linear.rank
    rss = float(linear.residual @ linear.residual)
    exceeds = poses.sigma is not None and bool(special.chdtrc(dof, rss / poses.sigma**2) < _BEYOND_NOISE)
    sigma = float(np.sqrt(rss / dof)) if poses.sigma is None or exceeds else poses.sigma
    influence = _by_pose(linear, len(poses.angles)) / sigma if exceeds else linear.pseudo_inverse
    unwhitened = np.linalg.pinv(readings.weight) @ linear.residual.reshape(*readings.points.shape, 1)
    return CalibratedAxes(
        axes=state.axes,
        targets=state.targets,
        names=poses.targets,
        covariance=sigma**2 * influence @ influence.T,
        influence=influence,
        sigma=sigma,
        rss=rss,
        dof=dof,
        residuals=unwhitened[..., 0],
        rank=linear.rank,
        only_together=_only_together(linear, len(state.axes), poses.targets),
        stated_sigma=poses.sigma,
        exceeds_stated=exceeds,
        held_out_rms=held_out_rms,
        unseen=linear.unseen / linear.scale[:, None],
    )


def _held_out_rms(
    nominal: KinematicChain, poses: Poses, start: RigidTransform | None, rms: float
) -> float | None:
    """Return the root mean square error [m] of a coordinate predicted from the other poses, in five parts.

    Readings of one posture stay together. Four parts may hardly tell two unknowns apart, so that their fit
    stalls in a flat valley: at the residual `rms` of all poses it has converged.
    """
    _, posture = np.unique(poses.angles, axis=0, return_inverse=True)
    count = int(posture.max()) + 1
    if count == 1:  # nothing is left to calibrate by
        return None
    part = np.random.default_rng(0).permutation(count)[posture.reshape(-1)] % _FOLDS
    errors = []
    for fold in range(min(_FOLDS, count)):
        try:
            calibrated = calibrate(
                nominal, poses[part != fold], start=start, hold_out=False, enough=_LIKE_ALL * rms
            )
        except (MeasurementError, NotObservableError):
            return None
        left_out = poses[part == fold]
        for angles, points, present in zip(
            left_out.joint_map.model_angles(left_out.angles), left_out.points, left_out.present, strict=True
        ):
            _, rotation, shift = posed(calibrated.axes, angles)
            errors.append((points - calibrated.targets @ rotation.T - shift)[present])
    return float(np.sqrt(np.square(np.concatenate(errors)).mean()))


def _by_pose(linear: LinearFit, count: int) -> FloatArray:
    """Contribution (p, N) of each pose's residuals to the unknowns: their outer products are the covariance.

    An angle that is off moves all targets of a pose, each its own way: residuals of one pose are no
    independent numbers. Those of different poses are taken to be (cluster-robust covariance, Liang and Zeger
    1986), with the usual correction for the unknowns.
    """
    shares = linear.pseudo_inverse.reshape(len(linear.scale), count, -1) * linear.residual.reshape(count, -1)
    rows = linear.residual.size / count
    freedom = count - linear.rank / rows
    return np.asarray(shares.sum(axis=-1) * np.sqrt(count / freedom))


def pose_readings(angles: FloatArray, poses: Poses) -> PoseReadings:
    """Return the poses, at angles (N, n) of the model [rad], with their weights in units of 1/sigma."""
    present = poses.present[..., None]
    return PoseReadings(
        angles=angles,
        points=np.where(present, poses.points, 0.0),
        weight=np.where(present[..., None], whitener(poses.covariance), 0.0),
        slopes=np.zeros_like(angles),
        basis=np.zeros((len(angles), 0)),
    )


def _start(
    motions: Sequence[tuple[FloatArray, FloatArray]], poses: Poses, start: RigidTransform | None
) -> tuple[RigidTransform, FloatArray]:
    """Base to tracker, and targets at angle zero in R0, by linear least squares.

    ``Q p + s = R_k x_t + t_k`` is linear in Q = Rᵀ (nine numbers), s = −Rᵀ t and x_t. Q is then made a
    rotation, and s and x_t are those with it. Where the transform is known, x_t are those with that.
    """
    k, t = np.nonzero(poses.present)
    rotation, shift = (np.stack(part)[k] for part in zip(*motions, strict=True))
    points, size = poses.points[k, t], 3 * len(k)
    by_target = np.einsum("mij,mt->mitj", rotation, np.eye(len(poses.targets))[t]).reshape(size, -1)
    if start is not None:
        local = start.inverse().apply(points) - shift
        return start, np.linalg.lstsq(by_target, local.ravel(), rcond=None)[0].reshape(-1, 3)
    by_shift = np.tile(np.eye(3), (len(k), 1))
    by_rotation = np.einsum("ij,mk->mijk", np.eye(3), points).reshape(size, 9)
    system = np.hstack([by_rotation, by_shift, -by_target])
    U, _, Vt = np.linalg.svd(np.linalg.lstsq(system, shift.ravel(), rcond=None)[0][:9].reshape(3, 3))
    Q = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    right = (points @ Q.T - shift).ravel()
    solution = np.linalg.lstsq(np.hstack([-by_shift, by_target]), right, rcond=None)[0]
    return RigidTransform(Q.T, -Q.T @ solution[:3]), solution[3:].reshape(-1, 3)


def _only_together(linear: LinearFit, n: int, targets: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Names of the unknowns in each undetermined combination, as sparse as a rotation makes them."""
    names = [f"axis {i + 1} {what}" for i in range(n) for what in _CHART_NAMES]
    names += [f"target {target} {coordinate}" for target in targets for coordinate in "xyz"]
    out = []
    # Gauss-Jordan with full pivoting: each combination gets an unknown of its own
    reduced = linear.unseen.copy()
    taken: list[int] = []
    for column in range(reduced.shape[1]):
        candidates = np.abs(reduced[:, column:])
        candidates[taken] = 0.0
        row, offset = np.unravel_index(int(np.argmax(candidates)), candidates.shape)
        reduced[:, [column, column + int(offset)]] = reduced[:, [column + int(offset), column]]
        reduced[:, column] /= reduced[row, column]
        for other in range(reduced.shape[1]):
            if other != column:
                reduced[:, other] -= reduced[row, other] * reduced[:, column]
        taken.append(int(row))
    for combination in reduced.T:
        share = np.abs(combination) / np.abs(combination).max()
        out.append(tuple(name for name, part in zip(names, share, strict=True) if part > _NAMED))
    return tuple(out)
