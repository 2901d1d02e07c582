"""Readings of secondary encoders: the angle of a joint behind its gearbox, before and under load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError


@dataclass(frozen=True, eq=False)
class EncoderReadings:
    """Readings of secondary encoders in N observations of a robot with n joints.

    While the motors' encoders close the position loop, the angle behind the gearbox changes under load by
    the deflection of the joint itself: ``δθ_j = c_j τ_j``, free of what else bends.

    Raises:
        MeasurementError: shapes disagree, a number is not finite, or sigma is not positive.
    """

    deflection: FloatArray  #: (N, n) loaded minus unloaded, angles of the model's joints [rad]
    present: BoolArray  #: (N, n) which joints were read; the others hold zeros
    sigma: float  #: standard uncertainty of one encoder reading [rad]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sigma) and self.sigma > 0):
            raise MeasurementError(
                f"the encoders' sigma must be positive, but is {self.sigma}",
                where="noise.encoder_sigma",
                remedy="give a positive angle",
            )
        if self.deflection.shape != self.present.shape or not np.isfinite(self.deflection).all():
            raise MeasurementError(
                "the encoder readings must be one finite number for each observation and joint",
                where="encoder_readings",
                remedy="remove or repeat the reading",
            )
        for array in (self.deflection, self.present):
            array.setflags(write=False)

    def __getitem__(self, rows: slice | IndexArray) -> EncoderReadings:
        """Those of some of the observations, in the given order."""
        return EncoderReadings(self.deflection[rows], self.present[rows], self.sigma)

    def lever(self, sigma: float) -> float:
        """Length on which a deflection of one encoder weighs like one of a target [m].

        A target on that lever moves by ``lever · δθ``, and tells as much of the joint as the encoder.

        Args:
            sigma: standard uncertainty of one coordinate of one position reading [m].
        """
        return sigma / self.sigma
