"""Measurements: arrays in SI units, checked once, that the identification reads."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.readings.common_uncertainty import CommonUncertainty
from jointstiff.solver.readings.encoders import EncoderReadings

ISOTROPIC_DIFFERENCE: FloatArray = 2.0 * np.eye(3)
"""Covariance of a deflection in units of sigma²: it is a difference of two readings (method.md §3)."""
ISOTROPIC_DIFFERENCE.setflags(write=False)


@dataclass(frozen=True, eq=False)
class Measurements:
    """N observations of up to T targets. Arrays are checked and made read-only.

    Raises:
        MeasurementError: shapes disagree, a number is not finite, there is no observation, sigma is
            not positive, encoders were read and sigma is unknown, or a covariance is not symmetric
            positive definite.
    """

    joints: FloatArray  #: (N, n) angles as the controller shows them [rad]
    force: FloatArray  #: (N, 3) force on the robot, axes of R0 [N]
    moment: FloatArray  #: (N, 3) moment on the robot about the load point, axes of R0 [N·m]
    load_point: FloatArray  #: (N, 3) where the force acts, flange frame [m]
    #: (N, T, 3) unloaded place of each target [m]: in R0 if measured, in the flange frame where `in_flange`
    #: says so
    position: FloatArray
    in_flange: BoolArray  #: (N, T) frame of `position`
    deflection: FloatArray  #: (N, T, 3) loaded minus unloaded, axes of R0 [m]
    present: BoolArray  #: (N, T) which targets were read; the others hold zeros
    sigma: float | None = None  #: standard uncertainty of one coordinate of one reading [m]; None if unknown
    #: (3, 3) or (N, T, 3, 3) covariance of the deflections in units of sigma²
    covariance: FloatArray = field(default_factory=lambda: ISOTROPIC_DIFFERENCE)
    #: what secondary encoders read of the joints; None if there are none. It takes a sigma to weigh them
    #: against the targets.
    encoders: EncoderReadings | None = None
    #: (N, T) what a robust loss leaves of each reading, 1 of a good one; `covariance` is divided by it
    #: already, and rows that are not weighted by covariance are weighted by it. None for ones.
    weight: FloatArray | None = None
    #: of loads and places, common to all observations; None for exact ones
    common_uncertainty: CommonUncertainty | None = None

    def __post_init__(self) -> None:
        count, targets = self.present.shape
        if count == 0 or targets == 0:
            raise MeasurementError("no observation", remedy="give at least one observation")
        if self.sigma is not None and not (np.isfinite(self.sigma) and self.sigma > 0):
            raise MeasurementError(
                f"sigma must be positive, but is {self.sigma} m",
                where="noise.sigma",
                remedy="give a positive length; omit `noise` to estimate it from the residuals",
            )
        for name, shape in (
            ("joints", (count, self.joints.shape[-1])),
            ("force", (count, 3)),
            ("moment", (count, 3)),
            ("load_point", (count, 3)),
            ("position", (count, targets, 3)),
            ("deflection", (count, targets, 3)),
            ("in_flange", (count, targets)),
            ("present", (count, targets)),
        ):
            _check(name, getattr(self, name), shape)
        if self.covariance.shape not in {(3, 3), (count, targets, 3, 3)}:
            _check("covariance", self.covariance, (count, targets, 3, 3))
        self.covariance.setflags(write=False)
        if self.weight is not None:
            _check("weight", self.weight, (count, targets))
        if self.encoders is not None:
            self._check_encoders(self.encoders)

    def _check_encoders(self, encoders: EncoderReadings) -> None:
        if encoders.deflection.shape != self.joints.shape:
            _check("encoder_readings", encoders.deflection, self.joints.shape)
        if self.sigma is None:
            raise MeasurementError(
                "there are encoder readings but no sigma of the tracker, so angles and lengths cannot be "
                "weighted",
                where="noise",
                remedy="state `noise.sigma` and `noise.encoder_sigma`, or omit the encoder readings",
            )

    @property
    def encoder_lever(self) -> float:
        """Length on which an encoder's deflection weighs like a target's [m]; 0 without encoders."""
        if self.encoders is None or self.sigma is None:
            return 0.0
        return self.encoders.lever(self.sigma)

    def __len__(self) -> int:
        return len(self.joints)

    def __getitem__(self, rows: slice | IndexArray) -> Measurements:
        """Some of the observations, in the given order."""
        covariance = self.covariance if self.covariance.ndim == 2 else self.covariance[rows]
        return Measurements(
            joints=self.joints[rows],
            force=self.force[rows],
            moment=self.moment[rows],
            load_point=self.load_point[rows],
            position=self.position[rows],
            in_flange=self.in_flange[rows],
            deflection=self.deflection[rows],
            present=self.present[rows],
            sigma=self.sigma,
            covariance=covariance,
            encoders=None if self.encoders is None else self.encoders[rows],
            weight=None if self.weight is None else self.weight[rows],
            common_uncertainty=self.common_uncertainty,
        )


def _check(name: str, array: npt.NDArray[np.generic], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise MeasurementError(
            f"the shape is {array.shape} instead of {shape}",
            where=name,
            remedy="give one entry for each observation and target",
        )
    if array.dtype != np.bool_ and not np.isfinite(array).all():
        raise MeasurementError("a number is not finite", where=name, remedy="remove or repeat the reading")
    array.setflags(write=False)
