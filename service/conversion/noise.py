"""Noise that a set states, of whichever kind, as sigma and the covariance of its deflections."""

from __future__ import annotations

from jointstiff.schemas.measurement.noise import Noise
from jointstiff.service.conversion.point_noise import PointNoise
from jointstiff.service.conversion.units import to_instrument
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.readings.measurements import ISOTROPIC_DIFFERENCE, CommonUncertainty, Measurements
from jointstiff.solver.readings.tracker_noise import DifferenceNoise, refuse_no_covariance
from jointstiff.solver.robot.model import Robot


def to_noise(
    noise: Noise | None, points: PointNoise | None, robot: Robot, plain: Measurements, *, length: float
) -> tuple[float | None, FloatArray]:
    """Return sigma [m], None where nothing is stated, and the deflections' covariance in units of sigma².

    Args:
        noise: of the set.
        points: what its readings state of their own.
        robot: n joints.
        plain: the readings, without noise.
        length: metres in the set's unit of length.

    Raises:
        MeasurementError: two kinds of noise, or one that is none.
    """
    if points is not None:
        if noise is not None and (noise.sigma is not None or noise.instrument is not None):
            kind = "sigma" if noise.sigma is not None else "instrument"
            raise MeasurementError(
                f"both the readings and noise.{kind} give the noise",
                where=f"noise.{kind}",
                remedy="give only one: omit it here, or in every reading",
            )
        present = plain.present
        unloaded, loaded = points.covariances()
        refuse_no_covariance(unloaded, present, "unloaded_covariance")
        refuse_no_covariance(loaded, present, "loaded_covariance")
        stated = DifferenceNoise.of(length**2 * unloaded, length**2 * loaded, present)
    elif noise is not None and noise.instrument is not None:
        stated = DifferenceNoise.by(to_instrument(noise.instrument, length), robot, plain)
    else:
        sigma = None if noise is None or noise.sigma is None else length * noise.sigma
        return sigma, ISOTROPIC_DIFFERENCE
    return stated.sigma, stated.covariance


def to_common_uncertainty(noise: Noise | None, length: float) -> CommonUncertainty | None:
    """Return the uncertainty of what all observations share; None where none is stated.

    Args:
        noise: of the set.
        length: metres in the set's unit of length.
    """
    if noise is None or not noise.states_common:
        return None
    return CommonUncertainty(
        0.0 if noise.force is None else noise.force.scale,
        0.0 if noise.force is None else noise.force.direction,
        length * (noise.load_point or 0.0),
        length * (noise.target_places or 0.0),
        0.0 if noise.axes is None else length * noise.axes.position,
        0.0 if noise.axes is None else noise.axes.direction,
    )
