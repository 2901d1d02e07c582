"""Unloaded poses of a robot, as a tracker reads them, for its calibration."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.sweeps.sweep import refuse_other_unit
from jointstiff.solver.robot.joint_map import JointMap


@dataclass(frozen=True, eq=False)
class Poses:
    """Unloaded readings in N configurations, T targets. Arrays are checked and made read-only.

    Raises:
        MeasurementError: shapes disagree, a number is not finite, sigma is not positive, or the unit of
            length is wrong.
    """

    angles: FloatArray  #: (N, n) as the controller shows them [rad]
    points: FloatArray  #: (N, T, 3) tracker's frame [m]; anything where absent
    present: BoolArray  #: (N, T) which targets were read
    targets: tuple[str, ...]  #: names of the T targets
    joint_map: JointMap  #: from controller to model angles
    sigma: float | None = None  #: standard uncertainty of one coordinate [m]; None if unknown
    #: (3, 3) or (N, T, 3, 3) of the readings in units of sigma²
    covariance: FloatArray = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        count = len(self.angles)
        shape = (count, len(self.targets))
        if (
            self.angles.shape != (count, self.joint_map.n)
            or self.present.shape != shape
            or self.points.shape != (*shape, 3)
            or self.covariance.shape not in {(3, 3), (*shape, 3, 3)}
        ):
            raise MeasurementError(
                f"the angles have shape {self.angles.shape} and the readings {self.points.shape}, for "
                f"{self.joint_map.n} joints and {len(self.targets)} targets",
                where="poses",
                remedy="give all joint angles and a reading of each target for each pose",
            )
        if not (np.isfinite(self.angles).all() and np.isfinite(self.points[self.present]).all()):
            raise MeasurementError(
                "an angle or a coordinate is not finite", where="poses", remedy="remove or repeat the reading"
            )
        if self.sigma is not None and not (np.isfinite(self.sigma) and self.sigma > 0.0):
            raise MeasurementError(
                f"sigma must be positive, but is {self.sigma}",
                where="noise.sigma",
                remedy="give a positive length",
            )
        refuse_other_unit(self._span)
        for array in (self.angles, self.points, self.present, self.covariance):
            array.setflags(write=False)

    def __getitem__(self, rows: BoolArray) -> Poses:
        """Return some of the configurations (N,)."""
        covariance = self.covariance if self.covariance.ndim == 2 else self.covariance[rows]
        angles, points, present = self.angles[rows], self.points[rows], self.present[rows]
        return replace(self, angles=angles, points=points, present=present, covariance=covariance)

    @property
    def _span(self) -> float:
        """Diagonal of the box around all readings [m]."""
        read = self.points[self.present]
        return float(np.linalg.norm(np.ptp(read, axis=0))) if len(read) else 0.0
