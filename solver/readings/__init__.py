"""Readings in SI units: measurement sets, secondary encoders and tracker noise."""

from __future__ import annotations

from jointstiff.solver.readings.common_uncertainty import CommonUncertainty
from jointstiff.solver.readings.encoders import EncoderReadings
from jointstiff.solver.readings.measurements import ISOTROPIC_DIFFERENCE, Measurements
from jointstiff.solver.readings.tracker_noise import (
    DifferenceNoise,
    Instrument,
    at_read_places,
    refuse_no_covariance,
)

__all__ = [
    "ISOTROPIC_DIFFERENCE",
    "CommonUncertainty",
    "DifferenceNoise",
    "EncoderReadings",
    "Instrument",
    "Measurements",
    "at_read_places",
    "refuse_no_covariance",
]
