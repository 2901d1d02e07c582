"""Measurements in SI units, with their noise, from the readings of a set."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from jointstiff.schemas.joints import JOINT_UNITS
from jointstiff.schemas.measurement import (
    MeasurementSetHeader,
    Noise,
    Units,
)
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


def _convert_noise(
    noise: Noise | None, own_noise: PointNoise | None, robot: Robot, measurements: Measurements, length: float
) -> dict[str, Any]:
    """Return the noise of the deflections as fields of `Measurements`: sigma [m], covariance, refuted sigma.

    A deflection is the difference of two positions, Σ = Σ_unloaded + Σ_loaded. Where the position without
    load is the mean of two readings, it has half the variance of one. A stated sigma that was refuted is only
    reported; the residuals of the fit then give the noise.

    Args:
        noise: noise that is stated for the set; None if it is not stated.
        own_noise: noise that readings state themselves; None if no reading states it.
        robot: the robot that was measured.
        measurements: measurements in SI units, still without noise.
        length: the set's unit of length in m.

    Raises:
        MeasurementError: noise is stated twice or for some readings only, or a matrix is not a covariance.
    """
    states_noise = np.zeros_like(measurements.present) if own_noise is None else own_noise.stated
    _refuse_ambiguous_noise(noise, states_noise, measurements)
    variance_unloaded = (
        np.ones((1, 1))
        if measurements.returned is None
        else (np.where(measurements.returned.present[..., None, None], 0.5, 1.0))
    )
    isotropic = 0.5 * (variance_unloaded + 1.0) * ISOTROPIC_DIFFERENCE
    sigma = None if noise is None or noise.sigma is None else length * noise.sigma
    covariance = isotropic
    instrument = None if noise is None else noise.instrument
    if own_noise is not None or instrument is not None:
        unloaded = loaded = (sigma or 0.0) ** 2 * np.eye(3)
        if instrument is not None:
            unloaded, loaded = position_covariances(to_instrument(instrument, length), robot, measurements)
        if own_noise is not None:
            # The sigma of a displacement is that of the difference: each position has half of its variance.
            share = np.where(_find_displacements(measurements), 0.5, 1.0)[..., None, None]
            own = [share * each for each in own_noise.compute_covariances()]
            refuse_invalid_covariance(own[0], own_noise.stated, "unloaded_covariance")
            refuse_invalid_covariance(own[1], own_noise.stated, "loaded_covariance")
            is_stated = own_noise.stated[..., None, None]
            unloaded = np.where(is_stated, length**2 * own[0], unloaded)
            loaded = np.where(is_stated, length**2 * own[1], loaded)
        unloaded = variance_unloaded * unloaded
        difference = DifferenceNoise.from_positions(
            unloaded,
            loaded,
            measurements.coordinates,
            are_displacements=_find_displacements(measurements),
        )
        sigma, covariance = difference.sigma, difference.covariance
    if noise is not None and noise.refuted:
        return {"sigma": None, "covariance": isotropic, "refuted_sigma": sigma}
    return {"sigma": sigma, "covariance": covariance}


def _find_displacements(measurements: Measurements) -> BoolArray:
    """Return which readings (N, T) are displacements along a direction."""
    if measurements.direction is None:
        return np.zeros_like(measurements.present)
    return np.asarray(measurements.direction.any(axis=-1))


def _refuse_ambiguous_noise(noise: Noise | None, states_noise: BoolArray, measurements: Measurements) -> None:
    """Refuse noise that is stated twice, or for some readings only.

    Args:
        noise: noise of the set, which applies to the readings that state no noise themselves.
        states_noise: mask (N, T) of the readings that state their noise themselves.
        measurements: measurements in SI units, still without noise.

    Raises:
        MeasurementError: noise is stated twice, or not at all for a reading.
    """
    relies_on_set = measurements.present & ~states_noise
    stated = [name for name in ("sigma", "instrument") if getattr(noise, name, None) is not None]
    if stated and not relies_on_set.any():
        raise MeasurementError(
            f"both the readings and noise.{stated[0]} state the noise",
            where=f"noise.{stated[0]}",
            remedy=f"state the noise once: omit noise.{stated[0]}, or omit the noise in every reading",
        )
    without_noise = np.zeros_like(relies_on_set)
    if stated == ["instrument"]:  # a tracker's data sheet does not apply to readings along a direction
        without_noise = relies_on_set & (measurements.coordinates == 1)
    elif not stated and states_noise.any():
        without_noise = relies_on_set
    if without_noise.any():
        raise MeasurementError(
            "the noise of a reading is not stated, and the noise of the other readings does not apply to "
            "this reading",
            where=f"observations[{np.argwhere(without_noise)[0, 0]}].readings",
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

    A ground is how the force is known: by a load `cell` at the hook, by a cell beyond a `pulley`, or by the
    `catalogue` mass of a weight.

    Args:
        common: uncertainties, in which the scale of the force is assumed.
        noise: noise that is stated for the set.
    """
    if noise.force is not None:
        common = replace(common, direction=noise.force.direction)
    if noise.grounds is not None and noise.grounds.force == "cell":
        zero = ROPE_ZERO_IF_TARED if noise.grounds.tared else ROPE_ZERO_OF_CELL
        common = replace(common, rope_zero=zero)
    scale = _choose_force_scale(noise)
    if scale is None:
        return common
    return replace(common, scale=scale, assumed=common.assumed - {"force_scale"})


def _choose_force_scale(noise: Noise) -> float | None:
    """Return the relative uncertainty of all forces; None if neither a number nor a ground gives it.

    The friction of a pulley, which nobody states, adds to the stated uncertainty. A mass from a catalogue is
    known no better than `CATALOGUE_SCALE`.
    """
    stated = None if noise.force is None else noise.force.scale
    ground = None if noise.grounds is None else noise.grounds.force
    match ground:
        case "pulley":
            return math.hypot(stated or 0.0, PULLEY_SCALE)
        case "catalogue":
            return max(stated or 0.0, CATALOGUE_SCALE)
        case _:
            return stated


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
    joints = joint_factors(robot, header.units) * readings.joints
    direction = None
    if readings.directions is not None:
        direction = readings.directions.compute_unit_vectors(robot, joints)
    ground = None if header.noise is None or header.noise.grounds is None else header.noise.grounds.force
    at_hook = FORCE_BEYOND_PULLEY if ground == "pulley" else 1.0  # force at the hook by the stated force
    unloaded_only = readings.unloaded_only
    without_noise = Measurements(
        joints=joints,
        force=at_hook * FORCE[header.units.force] * readings.force,
        moment=at_hook * _get_moment_factor(header.units, readings) * readings.moment,
        load_point=length * _choose_load_points(header, readings),
        position=length * _choose_positions(header, readings),
        in_flange=readings.as_deflection,
        deflection=length * _compute_deflections(readings, direction),
        present=readings.present,
        direction=direction,
        force_unit=header.units.force,
        unloaded_only=unloaded_only if unloaded_only.any() else None,
        returned=_to_return_readings(readings, length),
        labels=tuple(readings.labels.tolist()),
        targets=tuple(readings.targets.tolist()),
        closed_on_links=header.encoders == "secondary",
    )
    noise = _convert_noise(header.noise, readings.noise, robot, without_noise, length)
    encoders = None if readings.encoders is None else _to_encoder_readings(header, readings.encoders, robot)
    sigma, repeatability = noise["sigma"], _get_repeatability(header, encoders)
    # Without sigma the first fit shows how the scatter of the joints compares to the noise of the readings.
    scatter = repeatability / sigma if repeatability and sigma else 0.0
    measured = replace(
        without_noise,
        **noise,
        repeatability=repeatability,
        scatter=Scatter(joints=scatter),
        encoders=encoders,
        common_uncertainty=to_common_uncertainty(header.noise, length),
        present=readings.present & ~unloaded_only,
    )
    if shots is None:
        return measured
    # The readings of the hook give the uncertainty of the load point, in place of an assumed one.
    hook = shots.to_hook_reading(sigma or 0.0, repeatability or 0.0)
    common_uncertainty = replace(
        measured.common_uncertainty,
        load_point=hook.uncertainty,
        assumed=measured.common_uncertainty.assumed - {"load_point"},
        doubtful_load_point=None,
    )
    return replace(measured, hook=hook, common_uncertainty=common_uncertainty)


def _compute_deflections(readings: ReadingArrays, direction: FloatArray | None) -> FloatArray:
    """Return the deflections (N, T, 3) of the targets, in the set's unit of length.

    A deflection is given as such, or is the loaded minus the unloaded position, or is a displacement along a
    direction. The unloaded position is the mean of those before and after the load, where both were read. The
    deflection is zero where a target was read without load only.

    Args:
        readings: readings of a set in R0.
        direction: (N, T, 3) unit vectors of the readings along a direction in R0, zero for other readings;
            None if no reading is along a direction.
    """
    as_given = readings.as_deflection[..., None]
    unloaded = readings.unloaded
    if readings.after is not None:
        mean = 0.5 * (unloaded + readings.after.position)
        unloaded = np.where(readings.after.present[..., None], mean, unloaded)
    difference = readings.loaded - unloaded
    deflection = np.where(as_given, readings.loaded, difference)
    deflection = np.where(readings.unloaded_only[..., None], 0.0, deflection)
    if readings.directions is None or direction is None:
        return deflection
    return np.asarray(deflection + readings.directions.displacement[..., None] * direction)


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
    for name, kind, read_as in zip(
        robot.joint_names, robot.joint_kinds, header.joint_kinds or robot.joint_kinds, strict=False
    ):
        if read_as != kind:
            dimension = JOINT_UNITS[kind].dimension
            raise MeasurementError(
                f"joint {name} is read as {read_as}, but in the robot this joint is {kind}",
                where="joint_kinds",
                remedy=f"give {dimension}s of this joint, in `units.{dimension}`, or check the robot and the "
                "order of the joints",
            )


def _to_return_readings(readings: ReadingArrays, length: float) -> ReturnReadings | None:
    """Return how far the targets are from their first positions after the load was removed [m].

    None if no target was read again. `length` is the set's unit of length in m.
    """
    if readings.after is None:
        return None
    was_read_again = readings.after.present
    difference = readings.after.position - readings.unloaded
    difference = np.where(was_read_again[..., None], difference, 0.0)
    return ReturnReadings(length * difference, was_read_again)


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
    header: MeasurementSetHeader, encoders: EncoderArrays, robot: Robot
) -> EncoderReadings:
    """Return deflections of joints [rad] and their noise from secondary encoders.

    Raises:
        MeasurementError: the encoders show no deflection, their noise is missing, or a joint is prismatic or
            unknown.
    """
    first = int(np.flatnonzero(encoders.present.any(axis=1))[0])
    where = f"observations[{first}].encoder_readings"
    if header.encoders == "secondary":  # the controller turns the motors until these show no deflection
        raise MeasurementError(
            "the position loop closes on the secondary encoders, so these encoders show no deflection",
            where=where,
            remedy="omit `encoder_readings`, or measure with the loop closed on the motors' encoders",
        )
    if header.noise is None or header.noise.encoder_sigma is None:
        raise MeasurementError(
            "there are encoder readings, but the uncertainty of these readings is not stated",
            where="noise" if header.noise is None else "noise.encoder_sigma",
            remedy="give both `noise.sigma` and `noise.encoder_sigma`: the two weight angles against lengths",
        )
    names = encoders.joints.tolist()
    turning = [
        name for name, kind in zip(robot.joint_names, robot.joint_kinds, strict=True) if kind == "revolute"
    ]
    for e, name in enumerate(names):
        if name not in turning:
            first = int(np.flatnonzero(encoders.present[:, e])[0])
            raise MeasurementError(
                f"the robot has no revolute joint '{name}'",
                where=f"observations[{first}].encoder_readings",
                remedy=f"use one of {', '.join(turning)}",
            )
    columns = [robot.joint_names.index(name) for name in names]
    angle = ANGLE[header.units.angle]
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
    names = readings.targets.tolist()
    for t in np.flatnonzero(readings.as_deflection.any(axis=0)):
        if names[t] not in header.flange_targets:
            first = int(np.flatnonzero(readings.as_deflection[:, t])[0])
            raise MeasurementError(
                f"target '{names[t]}' has a deflection but no position in the flange frame",
                where=f"observations[{first}].readings",
                remedy=f"add '{names[t]}' to `flange_targets`, in the flange frame",
            )
    in_flange = np.array([header.flange_targets.get(name, (0.0, 0.0, 0.0)) for name in names])
    return np.where(readings.as_deflection[..., None], in_flange, readings.unloaded)
