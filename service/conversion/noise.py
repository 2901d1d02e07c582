"""What a set states of its noise, of whichever kind: sigma and the covariance of its deflections."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from schemas.measurement_set import MeasurementSetHeader
from schemas.noise import Instrument as StatedInstrument
from service.conversion.point_noise import PointNoise
from solver.exceptions import MeasurementError
from solver.measurements import ISOTROPIC_DIFFERENCE
from solver.robot import Robot
from solver.tracker_noise import DifferenceNoise, Instrument, places_in_base, refuse_no_covariance

__all__ = ["to_noise"]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def to_noise(
    header: MeasurementSetHeader,
    points: PointNoise | None,
    robot: Robot,
    *,
    length: float,
    joints: FloatArray,
    position: FloatArray,
    deflection: FloatArray,
    in_flange: BoolArray,
    present: BoolArray,
) -> tuple[float | None, FloatArray]:
    """Sigma [m], None where nothing is stated, and the covariance of the deflections in units of sigma².

    Args:
        header: of the set.
        points: what its readings state of their own.
        robot: n joints.
        length: metres in the set's unit of length.
        joints: (N, n) controller angles [rad].
        position: (N, T, 3) unloaded places [m].
        deflection: (N, T, 3) [m].
        in_flange: (N, T) whether a place is in the flange frame.
        present: (N, T).

    Raises:
        MeasurementError: two kinds of noise, or one that is none.
    """
    noise = header.noise
    if points is not None:
        _refuse_second_kind(header)
        unloaded, loaded = points.covariances()
        refuse_no_covariance(unloaded, present, "unloaded_covariance")
        refuse_no_covariance(loaded, present, "loaded_covariance")
        stated = DifferenceNoise.of(length**2 * unloaded, length**2 * loaded, present)
        return stated.sigma, stated.covariance
    if noise is not None and noise.instrument is not None:
        instrument = _instrument(noise.instrument, length)
        # Targets that were not read have no place; where one stands in for them does not matter.
        before = places_in_base(robot, joints, position, in_flange)
        before = np.where(present[..., None], before, before[present][0])
        after = before + deflection
        stated = DifferenceNoise.of(instrument.covariance(before), instrument.covariance(after), present)
        return stated.sigma, stated.covariance
    sigma = None if noise is None or noise.sigma is None else length * noise.sigma
    return sigma, ISOTROPIC_DIFFERENCE


def _refuse_second_kind(header: MeasurementSetHeader) -> None:
    noise = header.noise
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
