"""Motion between tracker and robot, from targets on the robot's base that are read twice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special
from scipy.spatial.transform import Rotation

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.frames.rigid_transform import RigidTransform
from jointstiff.solver.geometry.gauss_newton import minimise
from jointstiff.solver.text import length_text
from jointstiff.solver.triangle import whitener

SIGNIFICANCE = 1e-4
"""p-value below which a drift, or a base target that moved, is reported."""

_COLLINEAR = 1e-3  # least ratio of the width of the targets' spread to its length


@dataclass(frozen=True, eq=False)
class BaseDrift:
    """Motion of the base between two readings of its targets, as the tracker sees it."""

    transform_after_to_before: RigidTransform  #: brings later readings back; apply it to remove the drift
    displacement: FloatArray  #: (3,) of the point asked for, later less earlier, tracker's frame [m]
    displacement_covariance: FloatArray  #: (3, 3) [m²]
    rotation: FloatArray  #: (3,) rotation vector, tracker's frame [rad]
    probability: float  #: probability that tracker noise alone does this
    deformation_probability: float  #: that noise alone leaves these residuals to a rigid motion
    residuals: FloatArray  #: (B, 3) later reading less the moved earlier one [m]
    moved_targets: tuple[str, ...]  #: targets that moved on the base, each tested alone: their names
    names: tuple[str, ...]

    @property
    def significant(self) -> bool:
        """Return whether there is a drift beyond noise."""
        return self.probability < SIGNIFICANCE

    def findings(self) -> tuple[Finding, ...]:
        """Return what a user should know."""
        findings = []
        size = float(np.linalg.norm(self.displacement))
        if self.significant:
            direction = self.displacement / max(size, 1e-300)
            spread = float(np.sqrt(direction @ self.displacement_covariance @ direction))
            findings.append(
                Finding(
                    code="base_drifted",
                    weight="use_with_care",
                    where="base_targets",
                    message=(
                        "between the two readings of the base targets, tracker and robot base moved "
                        "relative to "
                        f"each other by {length_text(size)} ± {length_text(spread)} at the robot, and "
                        "turned by "
                        f"{np.linalg.norm(self.rotation) * 1e6:.0f} µrad"
                    ),
                    remedy="correct later readings with the given transform, or measure again",
                )
            )
        for target in self.moved_targets:
            left = float(np.linalg.norm(self.residuals[self.names.index(target)]))
            findings.append(
                Finding(
                    code="base_target_moved",
                    weight="use_with_care",
                    where=f"base_targets.after.{target}",
                    message=f"this base target moved relative to the others, by about {length_text(left)}",
                    remedy="omit it, and attach it more firmly",
                )
            )
        return tuple(findings)


def find_drift(
    before: FloatArray,
    after: FloatArray,
    *,
    sigma: float,
    at: FloatArray,
    covariance: FloatArray | None = None,
    names: tuple[str, ...] | None = None,
) -> BaseDrift:
    """Fit the rigid motion ``after = R before + t`` of the base by maximum likelihood.

    Args:
        before: (B, 3) first readings of at least three targets on the base, tracker's frame [m].
        after: (B, 3) later readings of the same.
        sigma: standard uncertainty of one coordinate of one reading [m].
        at: (3,) point of interest, such as the middle of the measured points [m].
        covariance: (3, 3) or (B, 3, 3) of one reading in units of sigma²; isotropic if None.
        names: (B,) of the targets; numbers from 1 if None.

    Raises:
        MeasurementError: shapes disagree, a number is not finite, or the targets lie on a line.
    """
    if before.shape != after.shape or before.ndim != 2 or before.shape[1] != 3 or len(before) < 3:
        raise MeasurementError(
            f"the base targets have shape {before.shape} before and {after.shape} after",
            where="base_targets",
            remedy="read the same three or more targets on the base both times",
        )
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        raise MeasurementError(
            "a coordinate is not finite", where="base_targets", remedy="omit or repeat the reading"
        )
    spread = np.linalg.svd(before - before.mean(axis=0), compute_uv=False)
    if spread[1] <= _COLLINEAR * spread[0]:
        raise MeasurementError(
            "the base targets lie on a line, so a rotation about that line cannot be determined",
            where="base_targets",
            remedy="place the targets so that they form a triangle",
        )
    one = np.eye(3) if covariance is None else covariance
    W = np.broadcast_to(whitener(2.0 * sigma**2 * one), (len(before), 3, 3))
    centre = before.mean(axis=0)
    turn, _ = Rotation.align_vectors(after - after.mean(axis=0), before - centre)
    R = turn.as_matrix()
    motion, _ = minimise(
        RigidTransform(R, after.mean(axis=0) - R @ centre),
        lambda motion: np.asarray((W @ (after - motion.apply(before))[..., None]).ravel()),
        lambda motion: np.asarray((W @ RigidTransform.sensitivity(motion.apply(before))).reshape(-1, 6)),
        lambda motion, step: motion.displaced(step),
        where="base_targets",
    )
    S = RigidTransform.sensitivity(motion.apply(before))
    whitened = (W @ S).reshape(-1, 6)
    left = (W @ (after - motion.apply(before))[..., None]).ravel()
    C = np.asarray(np.linalg.inv(whitened.T @ whitened), dtype=np.float64)
    unmoved = (W @ (after - before)[..., None]).ravel()
    gain = float(unmoved @ unmoved - left @ left)
    at_point = RigidTransform.sensitivity(at)
    known = names or tuple(str(number) for number in range(1, len(before) + 1))
    certain = RigidTransform(motion.rotation, motion.translation, C)
    return BaseDrift(
        transform_after_to_before=certain.inverse(),
        displacement=motion.apply(at) - at,
        displacement_covariance=at_point @ C @ at_point.T,
        rotation=Rotation.from_matrix(motion.rotation).as_rotvec(),
        probability=float(special.chdtrc(6, gain)),
        deformation_probability=float(special.chdtrc(left.size - 6, left @ left)),
        residuals=after - motion.apply(before),
        moved_targets=tuple(known[target] for target in _moved_targets(whitened, left)),
        names=known,
    )


def _moved_targets(whitened: FloatArray, left: FloatArray) -> tuple[int, ...]:
    """Test each target alone: what leaving it out takes off the sum of squares, χ² with three numbers.

    With three targets a rigid motion leaves three numbers, which do not tell which one moved.
    """
    Q, _ = np.linalg.qr(whitened)
    moved, count = [], len(left) // 3
    for target in range(count if count > 3 else 0):
        rows = slice(3 * target, 3 * target + 3)
        free = np.eye(3) - Q[rows] @ Q[rows].T
        gain = float(left[rows] @ np.linalg.lstsq(free, left[rows], rcond=1e-9)[0])
        if special.chdtrc(3, gain) * count < SIGNIFICANCE:
            moved.append((gain, target))
    return (max(moved)[1],) if moved else ()
