"""Measurements in SI units, with their noise, from the readings of a set."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from jointstiff.schemas.joints import JOINT_UNITS
from jointstiff.schemas.measurement import MeasurementSetHeader, Noise, Units
from jointstiff.service.conversion.hook import LocatedLoadPoint, locate_load_point
from jointstiff.service.conversion.readings import EncoderArrays, PointNoise, ReadingArrays
from jointstiff.service.conversion.robots import joint_factors, list_joint_names
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT, to_instrument
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.mechanics.measurements import (
    ASSUMED_FORCE_SCALE,
    ASSUMED_LOAD_POINT,
    CATALOGUE_SCALE,
    FORCE_BEYOND_PULLEY,
    ISOTROPIC_DIFFERENCE,
    LEAST_OF_GROUND,
    PULLEY_SCALE,
    ROPE_ZERO_IF_TARED,
    ROPE_ZERO_OF_CELL,
    CommonUncertainty,
    DifferenceNoise,
    EncoderReadings,
    Measurements,
    ReturnReadings,
    Scatter,
    position_covariances,
    refuse_invalid_covariance,
)
from jointstiff.solver.mechanics.robot import Robot


def to_measurements(header: MeasurementSetHeader, readings: ReadingArrays, robot: Robot) -> Measurements:
    """Check that a measurement set in R0 is complete; return its measurements in SI units, with their noise.

    Raises:
        MeasurementError: the set does not fit the robot, lacks a quantity or a unit, or its noise is unclear.
    """
    _refuse_other_joints(header, readings, robot)
    if not readings.unloaded_only.all():
        refuse_informed_controller(header.noise)
    if header.load_point_target is None:
        return _convert(header, readings, robot, None)
    shots = locate_load_point(header, header.load_point_target, readings, robot)
    with _counting_rows_as_posted(shots.rows):
        return _convert(shots.header, shots.other_readings, robot, shots)


@contextmanager
def _counting_rows_as_posted(rows: IndexArray) -> Iterator[None]:
    """Number the observation that an error names as it is numbered in the set that was posted.

    Args:
        rows: (K,) indices in the posted set of the observations that were kept.
    """

    def count_as_posted(match: re.Match[str]) -> str:
        return f"observations[{rows[int(match[1])]}]"

    try:
        yield
    except MeasurementError as error:
        if error.where is not None:
            error.where = re.sub(r"^observations\[(\d+)\]", count_as_posted, error.where)
        raise


def _convert(
    header: MeasurementSetHeader, readings: ReadingArrays, robot: Robot, shots: LocatedLoadPoint | None
) -> Measurements:
    """Return the measurements of a set, without the readings of a target at the hook; `shots` are these.

    Raises:
        MeasurementError: the set lacks a quantity or a unit, or its noise is unclear.
    """
    length = LENGTH[header.units.length]
    unloaded_only = readings.unloaded_only
    unloaded, returned = _average_unloaded_readings(readings, length)
    deflection = np.where(readings.as_deflection[..., None], readings.loaded, readings.loaded - unloaded)
    deflection = np.where(unloaded_only[..., None], 0.0, deflection)
    joints = joint_factors(robot, header.units) * readings.joints
    at_hook = _find_force_at_hook(header.noise)
    direction = None
    if readings.directions is not None:
        direction = readings.directions.compute_unit_vectors(robot, joints)
        deflection = deflection + readings.directions.displacement[..., None] * direction
    measurements = Measurements(
        joints=joints,
        force=at_hook * FORCE[header.units.force] * readings.force,
        moment=at_hook * _get_moment_factor(header.units, readings) * readings.moment,
        load_point=length * _choose_load_points(header, readings),
        position=length * _choose_positions(header, readings),
        in_flange=readings.as_deflection,
        deflection=length * deflection,
        present=readings.present,
        direction=direction,
        force_unit=header.units.force,
        unloaded_only=unloaded_only if unloaded_only.any() else None,
        returned=returned,
        labels=tuple(readings.labels.tolist()),
        targets=tuple(readings.targets.tolist()),
    )
    sigma, covariance = to_noise(header.noise, readings.noise, robot, measurements, length=length)
    # A stated sigma that was refuted is only reported; the residuals then give the noise.
    refuted_sigma = None
    if header.noise is not None and header.noise.refuted:
        refuted_sigma, sigma = sigma, None
        covariance = to_noise(None, None, robot, measurements, length=length)[1]
    encoders = _to_encoder_readings(header, readings.encoders, robot)
    common_uncertainty = to_common_uncertainty(header.noise, length)
    repeatability = _get_repeatability(header, encoders)
    hook = None
    if shots is not None:
        hook = shots.to_hook_reading(sigma or 0.0, repeatability or 0.0)
        common_uncertainty = replace(
            common_uncertainty,
            load_point=hook.uncertainty,
            assumed=common_uncertainty.assumed - {"load_point"},
            doubtful_load_point=None,
        )
    return replace(
        measurements,
        sigma=sigma,
        covariance=covariance,
        refuted_sigma=refuted_sigma,
        repeatability=repeatability,
        # Without sigma, the first fit tells how the scatter compares to the noise of the readings.
        scatter=Scatter(joints=repeatability / sigma if repeatability and sigma else 0.0),
        encoders=encoders,
        hook=hook,
        closed_on_links=header.encoders == "secondary",
        common_uncertainty=common_uncertainty,
        present=readings.present & ~unloaded_only,
    )


_KNOWLEDGE_OF_CONTROLLER = {
    "payload_declared": (
        "the load was declared as a payload to the controller",
        "with the same declared payload before and under the load",
    ),
    "gravity_compensated": (
        "the controller compensated the weight of the load",
        "with the compensation switched off",
    ),
}
"""Ground → (what the controller did, how to measure instead)."""


def refuse_informed_controller(noise: Noise | None) -> None:
    """Refuse readings under a load that was declared to the controller.

    The controller then moved the joints against the deflection.

    Raises:
        MeasurementError: a ground of the noise says so.
    """
    between = None if noise is None or noise.grounds is None else noise.grounds.between
    if between is None or between not in _KNOWLEDGE_OF_CONTROLLER:
        return
    reason, way = _KNOWLEDGE_OF_CONTROLLER[between]
    raise MeasurementError(
        f"{reason} between the readings without and under load, so the controller moved the joints against "
        "the deflection: stiffnesses from these readings would be wrong by a quarter, and no check would "
        "show this error",
        where="noise.grounds.between",
        remedy=f"measure again {way}, and state `between` as `still`",
    )


def _refuse_other_joints(header: MeasurementSetHeader, readings: ReadingArrays, robot: Robot) -> None:
    """Refuse readings with joints that differ from the robot's joints in number or kind.

    Raises:
        MeasurementError: names the first such joint.
    """
    if readings.joints.shape[1] != robot.n:
        raise MeasurementError(
            f"there are {readings.joints.shape[1]} joint angles, but the robot has {robot.n} joints",
            where="observations[0].joints",
            remedy=f"give the {robot.n} controller angles of {list_joint_names(robot)}",
        )
    if header.joint_kinds is not None and tuple(header.joint_kinds) != robot.joint_kinds:
        kinds = zip(robot.joint_kinds, header.joint_kinds, strict=False)
        first_other = next((j for j, (kind, read_as) in enumerate(kinds) if kind != read_as), 0)
        joint_name, joint_kind = robot.joint_names[first_other], robot.joint_kinds[first_other]
        units = JOINT_UNITS[joint_kind]
        read_as_text = "an angle" if units.dimension == "length" else "a length"
        raise MeasurementError(
            f"joint {joint_name} is read as {read_as_text}, but in the robot this joint is {joint_kind}",
            where="joint_kinds",
            remedy=f"give {units.dimension}s of this joint, in `units.{units.dimension}`, or check the "
            "robot and the order of the joints",
        )


def _average_unloaded_readings(
    readings: ReadingArrays, length: float
) -> tuple[FloatArray, ReturnReadings | None]:
    """Return the mean (N, T, 3) of the positions before and after the load, and their differences [m].

    The positions keep the set's unit of length. The differences are None without readings after the load.

    Args:
        readings: readings of a set.
        length: the set's unit of length in m.
    """
    if readings.after is None:
        return readings.unloaded, None
    was_read, after = readings.after.present, readings.after.position
    mean = np.where(was_read[..., None], 0.5 * (readings.unloaded + after), readings.unloaded)
    return_difference = np.where(was_read[..., None], after - readings.unloaded, 0.0)
    return mean, ReturnReadings(length * return_difference, was_read)


def _get_repeatability(header: MeasurementSetHeader, encoders: EncoderReadings | None) -> float | None:
    """Return the stated repeatability of the joints [rad]; None if it is not stated.

    Raises:
        MeasurementError: the set has encoder readings, too, which show the same turns of the joints.
    """
    if header.noise is None or header.noise.repeatability is None:
        return None
    repeatability = header.noise.repeatability * ANGLE[header.units.angle]
    if repeatability and encoders is not None:
        raise MeasurementError(
            "a repeatability of the joints is stated, but the encoder readings already show the random "
            "turns of the joints",
            where="noise.repeatability",
            remedy="omit `noise.repeatability`, or the encoder readings",
        )
    return repeatability


def _to_encoder_readings(
    header: MeasurementSetHeader, encoders: EncoderArrays | None, robot: Robot
) -> EncoderReadings | None:
    """Return deflections of joints [rad] and their noise from secondary encoders; None if none were read.

    Raises:
        MeasurementError: the encoders show no deflection, their noise is missing, or a joint is prismatic.
    """
    if encoders is None:
        return None
    if header.encoders == "secondary":
        first = int(np.flatnonzero(encoders.present.any(axis=1))[0])
        raise MeasurementError(
            "the position loop closes on the secondary encoders, so these encoders show no deflection",
            where=f"observations[{first}].encoder_readings",
            remedy="omit `encoder_readings`, or measure with the loop closed on the motors' encoders",
        )
    if header.noise is None or header.noise.encoder_sigma is None:
        raise MeasurementError(
            "there are encoder readings, but the uncertainty of these readings is not stated",
            where="noise" if header.noise is None else "noise.encoder_sigma",
            remedy="give both `noise.sigma` and `noise.encoder_sigma`: the two weight angles against lengths",
        )
    angle = ANGLE[header.units.angle]
    columns = encoders.find_joint_indices(robot.joint_names)
    if robot.prismatic[columns].any():
        name = robot.joint_names[columns[int(np.argmax(robot.prismatic[columns]))]]
        raise MeasurementError(
            f"there are encoder readings of {name}, but {name} is a prismatic joint",
            where="observations",
            remedy="omit these readings: encoder readings are used for revolute joints only",
        )
    deflection = np.zeros((len(encoders.present), robot.n))
    present = np.zeros(deflection.shape, dtype=np.bool_)
    deflection[:, columns] = angle * (encoders.loaded - encoders.unloaded)
    present[:, columns] = encoders.present
    return EncoderReadings(deflection, present, angle * header.noise.encoder_sigma)


def _get_moment_factor(units: Units, readings: ReadingArrays) -> float:
    """Return the factor from the unit of moments to N·m.

    If the unit is not stated, it is the unit of force times m; lengths must then be in m, or all moments 0.

    Raises:
        MeasurementError: moments are given, and their unit is ambiguous.
    """
    if units.moment is not None:
        return MOMENT[units.moment]
    if units.length == "m" or not readings.moment.any():
        return FORCE[units.force]
    first = int(np.flatnonzero(readings.moment.any(axis=1))[0])
    raise MeasurementError(
        f"the unit of the moment in observation '{readings.labels[first]}' is ambiguous, because "
        "lengths are in mm",
        where="units.moment",
        remedy=f"give `units.moment`, one of {', '.join(MOMENT)}",
    )


def _choose_load_points(header: MeasurementSetHeader, readings: ReadingArrays) -> FloatArray:
    """Return load points (N, 3) in the flange frame: each observation's own, else the set's.

    Raises:
        MeasurementError: an observation with a force has no load point.
    """
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


def _choose_positions(header: MeasurementSetHeader, readings: ReadingArrays) -> FloatArray:
    """Return positions (N, T, 3) of the targets: in R0, unloaded; for deflections, in the flange frame.

    Raises:
        MeasurementError: a target with a deflection has no position in the flange frame.
    """
    names = [str(name) for name in readings.targets]
    needs_flange_position = readings.as_deflection.any(axis=0)
    for target in np.flatnonzero(needs_flange_position):
        if names[target] not in header.flange_targets:
            first_observation = int(np.flatnonzero(readings.as_deflection[:, target])[0])
            raise MeasurementError(
                f"target '{names[target]}' has a deflection but no position in the flange frame",
                where=f"observations[{first_observation}].readings",
                remedy=f"add '{names[target]}' to `flange_targets`, in the flange frame",
            )
    in_flange = np.array([header.flange_targets.get(name, (0.0, 0.0, 0.0)) for name in names])
    return np.where(readings.as_deflection[..., None], in_flange, readings.unloaded)


def to_noise(
    noise: Noise | None,
    reading_noise: PointNoise | None,
    robot: Robot,
    measurements: Measurements,
    *,
    length: float,
) -> tuple[float | None, FloatArray]:
    """Return the noise of the deflections: sigma [m] of a coordinate, and covariances in units of sigma².

    Sigma is None if no noise is stated.

    Args:
        noise: noise that is stated for the set; None if it is not stated.
        reading_noise: noise that readings state themselves; None if no reading states it.
        robot: the robot that was measured.
        measurements: measurements in SI units, still without noise.
        length: the set's unit of length in m.

    Raises:
        MeasurementError: noise is stated twice or for some readings only, or a matrix is not a covariance.
    """
    present = measurements.present
    states_noise = np.zeros_like(present) if reading_noise is None else reading_noise.stated
    _refuse_ambiguous_noise(noise, states_noise, measurements)
    instrument = (
        None if noise is None or noise.instrument is None else to_instrument(noise.instrument, length)
    )
    sigma = None if noise is None or noise.sigma is None else length * noise.sigma
    read_again = None if measurements.returned is None else measurements.returned.present[..., None, None]
    if reading_noise is None and instrument is None:
        if read_again is None:
            return sigma, ISOTROPIC_DIFFERENCE
        # The mean of two readings has half the variance of one.
        return sigma, np.where(read_again, 0.75, 1.0) * ISOTROPIC_DIFFERENCE
    unloaded = loaded = (sigma or 0.0) ** 2 * np.eye(3)
    if instrument is not None:
        unloaded, loaded = position_covariances(instrument, robot, measurements)
    if reading_noise is not None:
        own_unloaded, own_loaded = reading_noise.compute_covariances()
        refuse_invalid_covariance(own_unloaded, states_noise, "unloaded_covariance")
        refuse_invalid_covariance(own_loaded, states_noise, "loaded_covariance")
        # The noise that a reading states itself replaces the noise of the set.
        unloaded = np.where(states_noise[..., None, None], length**2 * own_unloaded, unloaded)
        loaded = np.where(states_noise[..., None, None], length**2 * own_loaded, loaded)
    if read_again is not None:
        unloaded = np.where(read_again, 0.5, 1.0) * unloaded
    difference_noise = DifferenceNoise.from_positions(unloaded, loaded, measurements.coordinates)
    return difference_noise.sigma, difference_noise.covariance


def _refuse_ambiguous_noise(noise: Noise | None, states_noise: BoolArray, measurements: Measurements) -> None:
    """Refuse noise that is stated twice, or for some readings only.

    Args:
        noise: noise of the set, which applies to the readings that state no noise themselves.
        states_noise: mask (N, T) of the readings that state their noise themselves.
        measurements: measurements in SI units, still without noise.

    Raises:
        MeasurementError: noise is stated twice, or not at all for a reading.
    """
    without_own_noise = measurements.present & ~states_noise
    stated_field = next((k for k in ("sigma", "instrument") if getattr(noise, k, None) is not None), None)
    if stated_field is not None and not without_own_noise.any():
        raise MeasurementError(
            f"both the readings and noise.{stated_field} state the noise",
            where=f"noise.{stated_field}",
            remedy=f"state the noise once: omit noise.{stated_field}, or omit the noise in every reading",
        )
    if stated_field == "instrument":  # a tracker's data sheet does not apply to readings along a direction
        without_noise = without_own_noise & (measurements.coordinates == 1)
    else:
        without_noise = without_own_noise & (stated_field is None and states_noise.any())
    if without_noise.any():
        i = int(np.argwhere(without_noise)[0, 0])
        raise MeasurementError(
            "the noise of a reading is not stated, and the noise of the other readings does not apply to "
            "this reading",
            where=f"observations[{i}].readings",
            remedy="state `sigma` of this reading, or state `noise.sigma` for all readings without `sigma`",
        )


def to_common_uncertainty(noise: Noise | None, length: float) -> CommonUncertainty:
    """Return the uncertainty of quantities that all observations share, such as load point and axes.

    Uncertainties of the load point and of the forces' scale that are not stated are assumed.

    Args:
        noise: noise that is stated for the set.
        length: the set's unit of length in m.
    """
    common = CommonUncertainty(
        scale=ASSUMED_FORCE_SCALE,
        load_point=ASSUMED_LOAD_POINT,
        assumed=frozenset({"force_scale", "load_point"}),
    )
    if noise is None:
        return common
    axes = noise.axes
    return replace(
        _state_load_point(_state_force(common, noise), noise, length),
        target_places=length * (noise.target_places or 0.0),
        drift=length * (noise.drift or 0.0),
        axis_position=0.0 if axes is None else length * axes.position,
        axis_direction=0.0 if axes is None else axes.direction,
    )


def _state_force(common: CommonUncertainty, noise: Noise) -> CommonUncertainty:
    """Return uncertainties with those of the force, which are at least those of its ground.

    Args:
        common: uncertainties, in which the scale of the force is assumed.
        noise: noise that is stated for the set.
    """
    if noise.force is not None:
        common = replace(common, direction=noise.force.direction)
    stated = None if noise.force is None else noise.force.scale
    if stated is not None:
        common = replace(common, scale=stated, assumed=common.assumed - {"force_scale"})
    grounds = noise.grounds
    if grounds is None or grounds.force is None:
        return common
    if grounds.force == "cell":
        zero = ROPE_ZERO_IF_TARED if grounds.tared else ROPE_ZERO_OF_CELL
        return replace(common, rope_zero=zero)
    if grounds.force == "pulley":
        scale = math.hypot(stated or 0.0, PULLEY_SCALE)
    elif grounds.force == "catalogue":
        scale = max(stated or 0.0, CATALOGUE_SCALE)
    else:
        return common
    return replace(common, scale=scale, assumed=common.assumed - {"force_scale"})


def _find_force_at_hook(noise: Noise | None) -> float:
    """Return the force at the hook, relative to the stated force."""
    ground = None if noise is None or noise.grounds is None else noise.grounds.force
    return FORCE_BEYOND_PULLEY if ground == "pulley" else 1.0


def _state_load_point(common: CommonUncertainty, noise: Noise, length: float) -> CommonUncertainty:
    """Return uncertainties with that of the load point, which is at least that of its ground.

    Without a ground the assumed uncertainty remains, unless a larger one is stated.

    Args:
        common: uncertainties, in which that of the load point is assumed.
        noise: noise that is stated for the set.
        length: the set's unit of length in m.
    """
    ground = None if noise.grounds is None else noise.grounds.load_point
    least = ASSUMED_LOAD_POINT if ground is None else LEAST_OF_GROUND[ground]
    stated = None if noise.load_point is None else length * noise.load_point
    is_smaller = stated is not None and stated < least
    uncertainty = least if stated is None or is_smaller else stated
    is_known = ground is not None or (stated is not None and not is_smaller)
    has_weak_ground = ground in (None, "hand")
    return replace(
        common,
        load_point=uncertainty,
        assumed=common.assumed - {"load_point"} if is_known else common.assumed,
        doubtful_load_point=stated if is_smaller and has_weak_ground else None,
    )
