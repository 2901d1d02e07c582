"""Measurements in SI units, with their noise, from the readings of a set."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.joints import JOINT_UNITS, JointKind
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
from jointstiff.solver.mechanics.robot import Robot, describe_other_count


class _StatedNoise(NamedTuple):
    """Noise of the deflections of N observations of T targets, as the set and its readings state it."""

    sigma: float | None  # standard uncertainty of a coordinate of a position [m]; None if not stated
    covariance: FloatArray  # of the deflections, in units of sigma²: (N, T, 3, 3), or (3, 3) for all
    refuted_sigma: float | None = None  # stated sigma that a check refuted, so that it is not used [m]


def _to_noise(
    noise: Noise | None, own_noise: PointNoise | None, robot: Robot, measurements: Measurements, length: float
) -> _StatedNoise:
    """Return the noise of the deflections.

    A stated sigma that was refuted is only reported; the residuals of the fit then give the noise.

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
    isotropic = _compute_isotropic_covariance(measurements)
    if own_noise is None and _find_noise_field(noise) != "instrument":
        sigma = None if noise is None or noise.sigma is None else length * noise.sigma
        stated = _StatedNoise(sigma, isotropic)
    else:
        covariances = _PositionCovariances.from_set(noise, robot, measurements, length)
        if own_noise is not None:
            covariances = covariances.replaced_by(own_noise, length, measurements)
        stated = covariances.to_noise(measurements)
    if noise is None or not noise.refuted:
        return stated
    return _StatedNoise(sigma=None, covariance=isotropic, refuted_sigma=stated.sigma)


def _compute_isotropic_covariance(measurements: Measurements) -> FloatArray:
    """Return the covariance of deflections, in units of sigma², if sigma is the same in all coordinates.

    A deflection is the difference of two positions: its covariance is `ISOTROPIC_DIFFERENCE`, 2 I (3, 3).
    Where the position without load is the mean of two readings, which has half the variance of one, the
    covariance is 0.75 of that: (N, T, 3, 3).
    """
    if measurements.returned is None:
        return ISOTROPIC_DIFFERENCE
    read_again = measurements.returned.present[..., None, None]
    return np.where(read_again, 0.75, 1.0) * ISOTROPIC_DIFFERENCE


@dataclass(frozen=True, eq=False)
class _PositionCovariances:
    """Covariances [m²] of positions of T targets in N observations: (N, T, 3, 3), or (3, 3) for all."""

    unloaded: FloatArray
    loaded: FloatArray

    @classmethod
    def from_set(
        cls, noise: Noise | None, robot: Robot, measurements: Measurements, length: float
    ) -> _PositionCovariances:
        """Return the covariances by the noise of the set: of its instrument, else sigma² I, else zero.

        `length` is the set's unit of length in m.
        """
        if noise is None:
            return cls(0.0 * np.eye(3), 0.0 * np.eye(3))
        if noise.instrument is not None:
            instrument = to_instrument(noise.instrument, length)
            unloaded, loaded = position_covariances(instrument, robot, measurements)
            return cls(unloaded, loaded)
        sigma = 0.0 if noise.sigma is None else length * noise.sigma
        return cls(sigma**2 * np.eye(3), sigma**2 * np.eye(3))

    def replaced_by(
        self, own_noise: PointNoise, length: float, measurements: Measurements
    ) -> _PositionCovariances:
        """Return the covariances with those of the readings that state their noise themselves.

        The sigma of a reading along a direction is that of its displacement, of which each position has half
        of the variance. `length` is the set's unit of length in m.

        Raises:
            MeasurementError: a stated matrix is not a covariance.
        """
        own_unloaded, own_loaded = own_noise.compute_covariances()
        share = np.where(_find_displacements(measurements), 0.5, 1.0)[..., None, None]
        own_unloaded, own_loaded = share * own_unloaded, share * own_loaded
        refuse_invalid_covariance(own_unloaded, own_noise.stated, "unloaded_covariance")
        refuse_invalid_covariance(own_loaded, own_noise.stated, "loaded_covariance")
        is_stated = own_noise.stated[..., None, None]
        return _PositionCovariances(
            unloaded=np.where(is_stated, length**2 * own_unloaded, self.unloaded),
            loaded=np.where(is_stated, length**2 * own_loaded, self.loaded),
        )

    def to_noise(self, measurements: Measurements) -> _StatedNoise:
        """Return the noise of the deflections, Σ_deflection = Σ_unloaded + Σ_loaded, in units of sigma².

        Where a position without load was read twice, the mean of the two has half the variance of one.
        """
        unloaded = self.unloaded
        if measurements.returned is not None:
            read_again = measurements.returned.present[..., None, None]
            unloaded = np.where(read_again, 0.5, 1.0) * unloaded
        noise = DifferenceNoise.from_positions(
            unloaded,
            self.loaded,
            measurements.coordinates,
            are_displacements=_find_displacements(measurements),
        )
        return _StatedNoise(noise.sigma, noise.covariance)


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
    stated_field = _find_noise_field(noise)
    if stated_field is not None and not relies_on_set.any():
        raise MeasurementError(
            f"both the readings and noise.{stated_field} state the noise",
            where=f"noise.{stated_field}",
            remedy=f"state the noise once: omit noise.{stated_field}, or omit the noise in every reading",
        )
    if stated_field == "instrument":  # a tracker's data sheet does not apply to readings along a direction
        _refuse_readings_without_noise(relies_on_set & (measurements.coordinates == 1))
    elif stated_field is None and states_noise.any():
        _refuse_readings_without_noise(relies_on_set)


def _find_noise_field(noise: Noise | None) -> str | None:
    """Return the field that states the noise of all readings of a set: `sigma`, `instrument` or None."""
    if noise is None:
        return None
    if noise.sigma is not None:
        return "sigma"
    return None if noise.instrument is None else "instrument"


def _refuse_readings_without_noise(without_noise: BoolArray) -> None:
    """Raise a `MeasurementError` at the first reading in the mask (N, T), if the mask has any reading."""
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
    measurements = _convert_readings(header, readings, robot)
    noise = _to_noise(header.noise, readings.noise, robot, measurements, length)
    encoders = _to_encoder_readings(header, readings.encoders, robot)
    repeatability = _get_repeatability(header, encoders)
    measured = replace(
        measurements,
        sigma=noise.sigma,
        covariance=noise.covariance,
        refuted_sigma=noise.refuted_sigma,
        repeatability=repeatability,
        scatter=_start_scatter(repeatability, noise.sigma),
        encoders=encoders,
        common_uncertainty=to_common_uncertainty(header.noise, length),
        present=readings.present & ~readings.unloaded_only,
    )
    return measured if shots is None else _add_hook(measured, shots)


def _start_scatter(repeatability: float | None, sigma: float | None) -> Scatter:
    """Return the scatter with which the first fit begins: of joints [rad] relative to sigma [m].

    Without sigma it is zero: the first fit shows how the scatter compares to the noise of the readings.
    """
    if not repeatability or not sigma:
        return Scatter(joints=0.0)
    return Scatter(joints=repeatability / sigma)


def _add_hook(measurements: Measurements, shots: LocatedLoadPoint) -> Measurements:
    """Return measurements whose load point is known by the readings of a target at the hook, `shots`.

    These readings give the uncertainty of the load point, in place of an assumed one.
    """
    hook = shots.to_hook_reading(measurements.sigma or 0.0, measurements.repeatability or 0.0)
    common_uncertainty = replace(
        measurements.common_uncertainty,
        load_point=hook.uncertainty,
        assumed=measurements.common_uncertainty.assumed - {"load_point"},
        doubtful_load_point=None,
    )
    return replace(measurements, hook=hook, common_uncertainty=common_uncertainty)


def _convert_readings(header: MeasurementSetHeader, readings: ReadingArrays, robot: Robot) -> Measurements:
    """Return N observations of T targets in SI units, still without noise.

    Raises:
        MeasurementError: the load point, a position or the unit of moments is missing.
    """
    length = LENGTH[header.units.length]
    joints = joint_factors(robot, header.units) * readings.joints
    direction = None
    if readings.directions is not None:
        direction = readings.directions.compute_unit_vectors(robot, joints)
    deflection = _compute_deflections(readings, direction)
    at_hook = _find_force_at_hook(header.noise)
    unloaded_only = readings.unloaded_only
    return Measurements(
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
        returned=_to_return_readings(readings, length),
        labels=tuple(readings.labels.tolist()),
        targets=tuple(readings.targets.tolist()),
        closed_on_links=header.encoders == "secondary",
    )


def _compute_deflections(readings: ReadingArrays, direction: FloatArray | None) -> FloatArray:
    """Return the deflections (N, T, 3) of the targets, in the set's unit of length.

    A deflection is given as such, or is the loaded minus the unloaded position, or is a displacement along a
    direction. It is zero where a target was read without load only.

    Args:
        readings: readings of a set in R0.
        direction: (N, T, 3) unit vectors of the readings along a direction in R0, zero for other readings;
            None if no reading is along a direction.
    """
    as_given = readings.as_deflection[..., None]
    difference = readings.loaded - _average_unloaded_positions(readings)
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


_USUAL_JOINTS: Final = 6
"""Joints of most arms: a model with more joints may count a tool as a joint."""


def _refuse_other_joints(header: MeasurementSetHeader, readings: ReadingArrays, robot: Robot) -> None:
    """Refuse readings with joints that differ from the robot's joints in number or kind.

    Raises:
        MeasurementError: names the first such joint.
    """
    count = readings.joints.shape[1]
    if count != robot.n:
        remedy = f"give the {robot.n} controller angles of {list_joint_names(robot)}"
        if count > robot.n:
            remedy += (
                f"; or, if the arm has {count} joints, describe all of them: the robot's model ends at its "
                f"flange, '{robot.flange}'"
            )
        elif robot.n > _USUAL_JOINTS:
            remedy += f"; or, if the arm has {count} joints, {describe_other_count(count, robot.n)}"
        raise MeasurementError(
            f"there are {count} joint angles, but the robot has {robot.n} joints",
            where="observations[0].joints",
            remedy=remedy,
        )
    if header.joint_kinds is not None:
        _refuse_other_joint_kinds(header.joint_kinds, robot)


def _refuse_other_joint_kinds(read_kinds: Sequence[JointKind], robot: Robot) -> None:
    """Refuse joints that were read as lengths but turn, or that were read as angles but slide.

    Args:
        read_kinds: `revolute` or `prismatic` for each joint, by the unit in which it was read.
        robot: robot that was measured.

    Raises:
        MeasurementError: names the first such joint.
    """
    if tuple(read_kinds) == robot.joint_kinds:
        return
    is_other = [read_as != kind for read_as, kind in zip(read_kinds, robot.joint_kinds, strict=False)]
    joint = is_other.index(True) if any(is_other) else 0
    name, kind = robot.joint_names[joint], robot.joint_kinds[joint]
    dimension = JOINT_UNITS[kind].dimension
    read_as_text = "an angle" if dimension == "length" else "a length"
    raise MeasurementError(
        f"joint {name} is read as {read_as_text}, but in the robot this joint is {kind}",
        where="joint_kinds",
        remedy=f"give {dimension}s of this joint, in `units.{dimension}`, or check the "
        "robot and the order of the joints",
    )


def _average_unloaded_positions(readings: ReadingArrays) -> FloatArray:
    """Return the mean (N, T, 3) of the positions before and after the load, in the set's unit of length.

    It is the position before the load where the target was not read again.
    """
    if readings.after is None:
        return readings.unloaded
    mean = 0.5 * (readings.unloaded + readings.after.position)
    return np.where(readings.after.present[..., None], mean, readings.unloaded)


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
    header: MeasurementSetHeader, encoders: EncoderArrays | None, robot: Robot
) -> EncoderReadings | None:
    """Return deflections of joints [rad] and their noise from secondary encoders; None if none were read.

    Raises:
        MeasurementError: the encoders show no deflection, their noise is missing, or a joint is prismatic.
    """
    if encoders is None:
        return None
    _refuse_encoders_in_the_loop(header, encoders)
    angle = ANGLE[header.units.angle]
    sigma = angle * _get_encoder_sigma(header.noise)
    columns = encoders.find_joint_indices(robot.joint_names)
    _refuse_encoders_of_slides(robot, columns)
    deflection = np.zeros((len(encoders.present), robot.n))
    present = np.zeros(deflection.shape, dtype=np.bool_)
    deflection[:, columns] = angle * (encoders.loaded - encoders.unloaded)
    present[:, columns] = encoders.present
    return EncoderReadings(deflection, present, sigma)


def _refuse_encoders_in_the_loop(header: MeasurementSetHeader, encoders: EncoderArrays) -> None:
    """Refuse readings of secondary encoders on which the controller closes its position loop.

    The controller then turns the motors until these encoders show no deflection.
    """
    if header.encoders != "secondary":
        return
    first = int(np.flatnonzero(encoders.present.any(axis=1))[0])
    raise MeasurementError(
        "the position loop closes on the secondary encoders, so these encoders show no deflection",
        where=f"observations[{first}].encoder_readings",
        remedy="omit `encoder_readings`, or measure with the loop closed on the motors' encoders",
    )


def _get_encoder_sigma(noise: Noise | None) -> float:
    """Return the standard uncertainty of a reading of an encoder, in the set's unit of angles.

    Raises:
        MeasurementError: it is not stated.
    """
    if noise is None or noise.encoder_sigma is None:
        raise MeasurementError(
            "there are encoder readings, but the uncertainty of these readings is not stated",
            where="noise" if noise is None else "noise.encoder_sigma",
            remedy="give both `noise.sigma` and `noise.encoder_sigma`: the two weight angles against lengths",
        )
    return noise.encoder_sigma


def _refuse_encoders_of_slides(robot: Robot, joints: IndexArray) -> None:
    """Raise a `MeasurementError` if one of the joints with the indices `joints` (E,) is prismatic."""
    is_prismatic = robot.prismatic[joints]
    if is_prismatic.any():
        name = robot.joint_names[joints[int(np.argmax(is_prismatic))]]
        raise MeasurementError(
            f"there are encoder readings of {name}, but {name} is a prismatic joint",
            where="observations",
            remedy="omit these readings: encoder readings are used for revolute joints only",
        )


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
