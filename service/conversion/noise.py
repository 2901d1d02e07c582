"""What a set states of its noise, of whichever kind: sigma and the covariance of its deflections."""

from __future__ import annotations

import numpy as np

from jointstiff.schemas.measurement import Instrument as StatedInstrument
from jointstiff.schemas.measurement import Noise
from jointstiff.service.conversion.point_noise import PointNoise
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.readings import (
    ISOTROPIC_DIFFERENCE,
    DifferenceNoise,
    Instrument,
    Measurements,
    places_in_base,
    refuse_no_covariance,
)
from jointstiff.solver.robot import Robot

__all__ = ["to_noise"]


def to_noise(
    noise: Noise | None, points: PointNoise | None, robot: Robot, plain: Measurements, *, length: float
) -> tuple[float | None, FloatArray]:
    """Sigma [m], None where nothing is stated, and the covariance of the deflections in units of sigma².

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
        _refuse_second_kind(noise)
        stated = _of_points(points, plain.present, length)
    elif noise is not None and noise.instrument is not None:
        stated = _of_instrument(_instrument(noise.instrument, length), robot, plain)
    else:
        sigma = None if noise is None or noise.sigma is None else length * noise.sigma
        return sigma, ISOTROPIC_DIFFERENCE
    return stated.sigma, stated.covariance


def _of_points(points: PointNoise, present: BoolArray, length: float) -> DifferenceNoise:
    unloaded, loaded = points.covariances()
    refuse_no_covariance(unloaded, present, "unloaded_covariance")
    refuse_no_covariance(loaded, present, "loaded_covariance")
    return DifferenceNoise.of(length**2 * unloaded, length**2 * loaded, present)


def _of_instrument(instrument: Instrument, robot: Robot, plain: Measurements) -> DifferenceNoise:
    present = plain.present
    before = places_in_base(robot, plain.joints, plain.position, plain.in_flange)
    # Targets that were not read have no place; where one stands in for them does not matter.
    before = np.where(present[..., None], before, before[present][0])
    after = before + plain.deflection
    return DifferenceNoise.of(instrument.covariance(before), instrument.covariance(after), present)


def _refuse_second_kind(noise: Noise | None) -> None:
    if noise is not None and (noise.sigma is not None or noise.instrument is not None):
        kind = "sigma" if noise.sigma is not None else "instrument"
        raise MeasurementError(
            f"the readings state their own noise, and so does noise.{kind}",
            where=f"noise.{kind}",
            remedy="state one kind: leave it out here, or in every reading",
        )


def _instrument(stated: StatedInstrument, length: float) -> Instrument:
    x, y, z = stated.station
    return Instrument(
        station=(length * x, length * y, length * z),
        range_constant=length * stated.range.constant,
        range_per_distance=stated.range.per_distance,
        transverse_constant=length * stated.transverse.constant,
        transverse_per_distance=stated.transverse.per_distance,
    )
