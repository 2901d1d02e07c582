"""Measurement sets: from messages and stored arrays to SI units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jointstiff.schemas import measurement as sets
from jointstiff.service.conversion.encoders import EncoderArrays
from jointstiff.service.conversion.point_noise import to_common_uncertainty, to_noise
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.readings.measurements import EncoderReadings, Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.triangle import ISOTROPIC_DIFFERENCE


def to_measurements(header: sets.MeasurementSetHeader, readings: ReadingArrays, robot: Robot) -> Measurements:
    """Bring a set to SI units and check that it is complete.

    Raises:
        MeasurementError: with the place and the remedy.
    """
    if readings.joints.shape[1] != robot.n:
        raise MeasurementError(
            f"there are {readings.joints.shape[1]} joint angles, but the robot has {robot.n} joints",
            where="observations[0].joints",
            remedy=f"give the {robot.n} controller angles of {', '.join(robot.joint_names)}",
        )
    length = LENGTH[header.units.length]
    deflection = np.where(
        readings.as_deflection[..., None], readings.loaded, readings.loaded - readings.unloaded
    )
    deflection = np.where(readings.unloaded_only[..., None], 0.0, deflection)
    joints = ANGLE[header.units.angle] * readings.joints
    direction = None
    if readings.directions is not None:
        direction = readings.directions.unit_vectors(robot, joints)
        deflection = deflection + readings.directions.displacement[..., None] * direction
    plain = Measurements(
        joints=joints,
        force=FORCE[header.units.force] * readings.force,
        moment=_moment_factor(header.units, readings) * readings.moment,
        load_point=length * _load_points(header, readings),
        position=length * _positions(header, readings),
        in_flange=readings.as_deflection,
        deflection=length * deflection,
        present=readings.present,
        direction=direction,
        unloaded_only=readings.unloaded_only if readings.unloaded_only.any() else None,
        labels=tuple(readings.labels.tolist()),
        targets=tuple(readings.targets.tolist()),
    )
    sigma, covariance = to_noise(header.noise, readings.noise, robot, plain, length=length)
    refuted_sigma = None
    if header.noise is not None and header.noise.refuted:
        refuted_sigma, sigma, covariance = sigma, None, ISOTROPIC_DIFFERENCE
    encoders = _encoder_readings(header, readings.encoders, robot)
    common = to_common_uncertainty(header.noise, length)
    return replace(
        plain,
        sigma=sigma,
        covariance=covariance,
        refuted_sigma=refuted_sigma,
        encoders=encoders,
        common_uncertainty=common,
        present=readings.present & ~readings.unloaded_only,
    )


def _encoder_readings(
    header: sets.MeasurementSetHeader, encoders: EncoderArrays | None, robot: Robot
) -> EncoderReadings | None:
    """Return deflections of the model's joints, where their encoders were read and say something."""
    if encoders is None:
        return None
    if header.encoders == "secondary":
        first = int(np.flatnonzero(encoders.present.any(axis=1))[0])
        raise MeasurementError(
            "the position loop closes on the secondary encoders, so they show no deflection",
            where=f"observations[{first}].encoder_readings",
            remedy="omit `encoder_readings`, or measure with the loop closed on the motors' encoders",
        )
    if header.noise is None or header.noise.encoder_sigma is None:
        raise MeasurementError(
            "there are encoder readings, but their uncertainty is not given",
            where="noise" if header.noise is None else "noise.encoder_sigma",
            remedy="give both `noise.sigma` and `noise.encoder_sigma`: they weigh angles against lengths",
        )
    angle, columns = ANGLE[header.units.angle], encoders.columns(robot.joint_names)
    deflection = np.zeros((len(encoders.present), robot.n))
    present = np.zeros(deflection.shape, dtype=np.bool_)
    deflection[:, columns] = angle * (encoders.loaded - encoders.unloaded)
    present[:, columns] = encoders.present
    return EncoderReadings(deflection, present, angle * header.noise.encoder_sigma)


def _moment_factor(units: sets.Units, readings: ReadingArrays) -> float:
    """Return N·m in the unit of moments, to be stated where the others do not imply it."""
    if units.moment is not None:
        return MOMENT[units.moment]
    if units.length == "m" or not readings.moment.any():
        return FORCE[units.force]
    first = int(np.flatnonzero(readings.moment.any(axis=1))[0])
    raise MeasurementError(
        f"observations[{first}] has a moment, whose unit is ambiguous when lengths are in mm",
        where="units.moment",
        remedy=f"give `units.moment`, one of {', '.join(MOMENT)}",
    )


def _load_points(header: sets.MeasurementSetHeader, readings: ReadingArrays) -> FloatArray:
    missing = ~readings.load_point_given & readings.force.any(axis=1)
    if header.load_point is not None:
        return np.where(readings.load_point_given[:, None], readings.load_point, header.load_point)
    if missing.any():
        raise MeasurementError(
            "the load point is missing",
            where=f"observations[{int(np.flatnonzero(missing)[0])}].load_point",
            remedy="give `load_point`, in the flange frame, for the set or for each observation",
        )
    return readings.load_point


def _positions(header: sets.MeasurementSetHeader, readings: ReadingArrays) -> FloatArray:
    """Return places of the targets: measured in R0, or in the flange frame for deflections."""
    names = [str(name) for name in readings.targets]
    needed = readings.as_deflection.any(axis=0)
    for t in np.flatnonzero(needed):
        if names[t] not in header.flange_targets:
            first = int(np.flatnonzero(readings.as_deflection[:, t])[0])
            raise MeasurementError(
                f"target '{names[t]}' has a deflection but no position in the flange frame",
                where=f"observations[{first}].readings",
                remedy=f"add '{names[t]}' to `flange_targets`, in the flange frame",
            )
    in_flange = np.array([header.flange_targets.get(name, (0.0, 0.0, 0.0)) for name in names])
    return np.where(readings.as_deflection[..., None], in_flange, readings.unloaded)
