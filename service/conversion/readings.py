"""Readings as arrays: in the units of their set, as they are stored, and in SI units for computation."""

from __future__ import annotations

import hashlib
import io
import math
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Final, Self

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.joints import JOINT_UNITS
from jointstiff.schemas.measurement import (
    MAX_TARGETS,
    EncoderReading,
    Matrix3,
    MeasurementSetHeader,
    Noise,
    Observation,
    Reading,
    ResolvedFrame,
    Units,
)
from jointstiff.schemas.robot import MAX_JOINTS
from jointstiff.service.conversion.robots import joint_factors, list_joint_names
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT, to_instrument
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.mechanics.hook import HookReading, HookShot, locate_hook
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
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import length_text


class NamedObservationError(MeasurementError):
    """An observation cannot be used; the reason names its label, which no caller needs to add."""


@dataclass(frozen=True, eq=False)
class ArrayGroup:
    """Arrays of N observations that are stored together; the fields of a subclass are the arrays."""

    prefix: ClassVar[str]

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return name → array; the names are those under which the arrays are stored."""
        return {f"{self.prefix}{field.name}": getattr(self, field.name) for field in fields(self)}

    def select(self, rows: IndexArray, targets: IndexArray) -> Self:
        """Return the arrays of the selected observations and targets, in the given order."""
        selected = {name: array[rows][:, targets] for name, array in vars(self).items()}
        return replace(self, **selected)

    @classmethod
    def from_archive(cls, archive: Mapping[str, npt.NDArray[np.generic]]) -> Self | None:
        """Build the group from an archive, name → array; None if the archive has no such group."""
        names = [f"{cls.prefix}{field.name}" for field in fields(cls)]
        return cls(*(archive[name] for name in names)) if names[0] in archive else None


@dataclass(frozen=True, eq=False)
class Directions(ArrayGroup):
    """Readings along a direction of N observations of T targets; zero where a reading is of another kind."""

    prefix = "direction_"

    displacement: FloatArray  # (N, T) loaded minus unloaded, along the direction
    vector: FloatArray  # (N, T, 3) direction as posted, of any length
    in_flange: BoolArray  # (N, T) whether the direction was posted in the flange frame

    @classmethod
    def from_readings(
        cls, shape: tuple[int, int], indices: tuple[list[int], list[int]], readings: list[Reading]
    ) -> Directions | None:
        """Arrange readings along a direction as arrays; None if no reading is along a direction.

        Args:
            shape: numbers N of observations and T of targets.
            indices: index of the observation, then of the target, of each reading.
            readings: all readings of the set.
        """
        if all(reading.displacement is None for reading in readings):
            return None
        displacement = np.zeros(shape)
        vector = np.zeros((*shape, 3))
        in_flange = np.zeros(shape, np.bool_)
        displacement[indices] = [each.displacement or 0.0 for each in readings]
        vector[indices] = [each.direction or each.flange_direction or (0, 0, 0) for each in readings]
        in_flange[indices] = [each.flange_direction is not None for each in readings]
        return cls(displacement, vector, in_flange)

    @property
    def has_direction(self) -> BoolArray:
        """Mask (N, T) of the readings that are one component along a direction, whose vector is not zero."""
        return np.asarray(self.vector.any(axis=-1))

    def rotate(self, R: FloatArray) -> Directions:
        """Return a copy with the directions rotated by R (3, 3), except directions in the flange frame."""
        vector = np.where(self.in_flange[..., None], self.vector, self.vector @ R.T)
        return replace(self, vector=vector)

    def get_reading_fields(self, i: int, t: int) -> dict[str, Any]:
        """Return field → value of a reading along a direction: its displacement and its direction.

        `i` and `t` are the indices of the observation and of the target.
        """
        name = "flange_direction" if self.in_flange[i, t] else "direction"
        return {"displacement": float(self.displacement[i, t]), name: tuple(self.vector[i, t].tolist())}

    def compute_unit_vectors(self, robot: Robot, joints: FloatArray) -> FloatArray:
        """Return unit vectors (N, T, 3) of the directions in R0; zero for readings of another kind.

        Args:
            robot: robot with n joints.
            joints: (N, n) controller angles [rad].
        """
        rotation = Postures(robot, robot.joint_map.model_angles(joints)).flange_rotation
        vector = np.where(self.in_flange[..., None], self.vector @ rotation.transpose(0, 2, 1), self.vector)
        length = np.linalg.norm(vector, axis=-1, keepdims=True)
        return np.asarray(vector / np.where(length > 0.0, length, 1.0))


@dataclass(frozen=True, eq=False)
class EncoderArrays(ArrayGroup):
    """Angles of N observations of E secondary encoders."""

    prefix = "encoder_"

    joints: npt.NDArray[np.str_]  # (E,) names of the joints, in order of first appearance
    present: BoolArray  # (N, E) which encoders were read
    unloaded: FloatArray  # (N, E) angles before the load; zero where not read
    loaded: FloatArray  # (N, E) angles under load; zero where not read

    def select(self, rows: IndexArray, targets: IndexArray) -> Self:
        """Return the angles of the selected observations; encoders have no targets."""
        del targets
        return replace(
            self, present=self.present[rows], unloaded=self.unloaded[rows], loaded=self.loaded[rows]
        )

    @classmethod
    def from_observations(cls, observations: list[Observation]) -> EncoderArrays | None:
        """Arrange the readings of encoders as arrays; None if no encoder was read.

        Raises:
            MeasurementError: an observation has a joint twice, or there are too many joints.
        """
        names = dict.fromkeys(
            reading.joint for observation in observations for reading in observation.encoder_readings or ()
        )
        if not names:
            return None
        if len(names) > MAX_JOINTS:
            raise MeasurementError(
                f"the readings name encoders of {len(names)} different joints, more than {MAX_JOINTS}",
                where="observations",
                remedy="use the robot's joint names, the same in every observation",
            )
        column = {name: index for index, name in enumerate(names)}
        present = np.zeros((len(observations), len(names)), dtype=np.bool_)
        unloaded, loaded = np.zeros((2, *present.shape))
        for row, observation in enumerate(observations):
            for reading_index, reading in enumerate(observation.encoder_readings or ()):
                cell = row, column[reading.joint]
                if present[cell]:
                    raise NamedObservationError(
                        f"the encoder of '{reading.joint}' has two readings in observation "
                        f"'{observation.label}'",
                        where=f"observations[{row}].encoder_readings[{reading_index}].joint",
                        remedy="give each joint at most once per observation",
                    )
                present[cell] = True
                unloaded[cell], loaded[cell] = reading.unloaded, reading.loaded
        return cls(np.array(list(names)), present, unloaded, loaded)

    def build_encoder_readings(self, i: int) -> list[EncoderReading] | None:
        """Return the encoder readings of an observation as they were posted; None if no encoder was read.

        `i` is the index of the observation.
        """
        readings = [
            EncoderReading.model_construct(
                joint=str(self.joints[column]),
                unloaded=float(self.unloaded[i, column]),
                loaded=float(self.loaded[i, column]),
            )
            for column in np.flatnonzero(self.present[i])
        ]
        return readings or None

    def find_joint_indices(self, joint_names: tuple[str, ...]) -> IndexArray:
        """Return indices (E,) of the encoders' joints among the robot's joints.

        Raises:
            MeasurementError: the robot has no joint of an encoder's name.
        """
        for e, name in enumerate(self.joints.tolist()):
            if name not in joint_names:
                first = int(np.flatnonzero(self.present[:, e])[0])
                raise MeasurementError(
                    f"the robot has no joint '{name}'",
                    where=f"observations[{first}].encoder_readings",
                    remedy=f"use one of {', '.join(joint_names)}",
                )
        return np.array([joint_names.index(name) for name in self.joints.tolist()])


@dataclass(frozen=True, eq=False)
class PositionsAfter(ArrayGroup):
    """Positions of T targets in N observations that were read again after the load was removed."""

    prefix = "after_"

    position: FloatArray  # (N, T, 3) positions, as those of the other readings; zero where not read again
    present: BoolArray  # (N, T) which targets were read again

    @classmethod
    def from_readings(
        cls, shape: tuple[int, int], indices: tuple[list[int], list[int]], readings: list[Reading]
    ) -> PositionsAfter | None:
        """Arrange the positions that were read again without load as arrays; None without such positions.

        Args:
            shape: numbers N of observations and T of targets.
            indices: index of the observation, then of the target, of each reading.
            readings: all readings of the set.
        """
        if all(reading.unloaded_after is None for reading in readings):
            return None
        positions = [each.unloaded_after or (0.0, 0.0, 0.0) for each in readings]
        was_read = [each.unloaded_after is not None for each in readings]
        return cls(
            _scatter((*shape, 3), indices, positions, np.float64),
            _scatter(shape, indices, was_read, np.bool_),
        )

    def get_reading_fields(self, i: int, t: int) -> dict[str, Any]:
        """Return field → value for the position of a target that was read again without load; {} without one.

        `i` and `t` are the indices of the observation and of the target.
        """
        return {"unloaded_after": tuple(self.position[i, t].tolist())} if self.present[i, t] else {}


@dataclass(frozen=True, eq=False)
class PointNoise(ArrayGroup):
    """Noise stated by readings of T targets in N observations: sigma or covariances, zero if not stated."""

    prefix = "noise_"

    sigma: FloatArray  # (N, T) standard uncertainty of each coordinate
    unloaded: FloatArray  # (N, T, 3, 3) covariance of the unloaded position
    loaded: FloatArray  # (N, T, 3, 3) covariance of the loaded position

    @classmethod
    def from_readings(
        cls, shape: tuple[int, int], indices: tuple[list[int], list[int]], readings: list[Reading]
    ) -> PointNoise | None:
        """Arrange the noise that readings state as arrays; None if no reading states its noise.

        Args:
            shape: numbers N of observations and T of targets.
            indices: index of the observation, then of the target, of each reading.
            readings: all readings of the set.

        Raises:
            MeasurementError: some readings of the tracker state their noise, and others do not.
        """
        states_noise = [each.sigma is not None or each.unloaded_covariance is not None for each in readings]
        if not any(states_noise):
            return None
        # Readings along a direction come from another instrument: their noise is checked elsewhere.
        tracker_readings = [k for k, each in enumerate(readings) if each.displacement is None]
        observations, _ = indices
        _refuse_partly_stated_noise(
            [states_noise[k] for k in tracker_readings], [observations[k] for k in tracker_readings]
        )
        sigma = np.zeros(shape)
        unloaded_covariances = np.zeros((*shape, 3, 3))
        loaded_covariances = np.zeros((*shape, 3, 3))
        for row, target, reading in zip(*indices, readings, strict=True):
            if reading.sigma is not None:
                sigma[row, target] = reading.sigma
            elif reading.unloaded_covariance is not None:
                unloaded_covariances[row, target], loaded_covariances[row, target] = (
                    reading.unloaded_covariance,
                    reading.loaded_covariance,
                )
        return cls(sigma, unloaded_covariances, loaded_covariances)

    def get_reading_fields(self, i: int, t: int) -> dict[str, Any]:
        """Return field → value for the noise that a reading states itself; {} if it states none.

        `i` and `t` are the indices of the observation and of the target.
        """
        if self.sigma[i, t]:
            return {"sigma": float(self.sigma[i, t])}
        if not self.unloaded[i, t].any():
            return {}
        return {
            "unloaded_covariance": _to_matrix_rows(self.unloaded[i, t]),
            "loaded_covariance": _to_matrix_rows(self.loaded[i, t]),
        }

    @property
    def stated(self) -> BoolArray:
        """Mask (N, T) of the readings that state their own sigma or covariances."""
        return np.asarray((self.sigma > 0.0) | self.unloaded.any(axis=(2, 3)))

    def compute_covariances(self) -> tuple[FloatArray, FloatArray]:
        """Return (unloaded, loaded): covariances (N, T, 3, 3) of the positions without and with load.

        The unit is the squared unit of length of the set.
        """
        isotropic = (self.sigma**2)[..., None, None] * np.eye(3)
        return self.unloaded + isotropic, self.loaded + isotropic


def _to_matrix_rows(matrix: FloatArray) -> Matrix3:
    """Return a matrix (3, 3) as a tuple of its three rows."""
    x, y, z = (tuple(row) for row in matrix.tolist())
    return x, y, z


def _refuse_partly_stated_noise(stated: list[bool], observations: list[int]) -> None:
    """Refuse readings if some of them state their noise, and others do not.

    Args:
        stated: for each reading, whether its noise is stated.
        observations: index of the observation of each reading.

    Raises:
        MeasurementError: a reading states no noise, but another does.
    """
    if len(set(stated)) < 2:
        return
    i = observations[stated.index(False)]
    raise MeasurementError(
        "some readings state their own noise, but a reading of this observation states no noise",
        where=f"observations[{i}].readings",
        remedy="give every reading its `sigma` or its covariances, or give only `noise` for the set",
    )


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


_OPTIONAL_GROUPS: dict[str, type[ArrayGroup]] = {
    "encoders": EncoderArrays,
    "noise": PointNoise,
    "directions": Directions,
    "after": PositionsAfter,
}
LARGEST_HOOK_SCATTER = 3.0 * LEAST_OF_GROUND["tracker"]
"""Largest distance [m] between two readings of the hook, and of a target from its mean place on the flange:
three standard uncertainties."""
LARGEST_HOOK_SHIFT = 0.02
"""Largest distance [m] by which the kinematics place targets wrong where the hook is read: a greater one is a
wrong reading, or wrong joint angles."""
_UNREAD = (np.nan, np.nan, np.nan)
_NOTHING: Final = (0.0, 0.0, 0.0)
"""Vector in place of one that an observation or a reading does not state."""


@dataclass(frozen=True, eq=False)
class ReadingArrays:
    """N observations of up to T targets, in the units of their set."""

    labels: npt.NDArray[np.str_]  # (N,) names of the observations
    targets: npt.NDArray[np.str_]  # (T,) names of the targets, in order of first appearance
    joints: FloatArray  # (N, n) controller angles
    force: FloatArray  # (N, 3)
    moment: FloatArray  # (N, 3), zero where not given
    moment_given: BoolArray  # (N,)
    load_point: FloatArray  # (N, 3), zero where not given
    load_point_given: BoolArray  # (N,)
    present: BoolArray  # (N, T) which targets were read
    as_deflection: BoolArray  # (N, T) which readings came as a deflection
    unloaded: FloatArray  # (N, T, 3) positions in R0; zero for deflections
    # (N, T, 3) positions in R0, or the deflection itself; NaN where read unloaded only, zero where it was
    # read along a direction
    loaded: FloatArray
    encoders: EncoderArrays | None = None  # readings of secondary encoders; None without encoders
    noise: PointNoise | None = None  # noise that readings state themselves; None if no reading states it
    directions: Directions | None = None  # readings along a direction; None without them
    after: PositionsAfter | None = None  # positions after unloading; None if no target was read again

    @classmethod
    def from_observations(cls, observations: list[Observation]) -> ReadingArrays:
        """Arrange observations as arrays, in the units of their set.

        Raises:
            MeasurementError: numbers of joint angles differ; a label, a target or an encoder occurs twice;
                there are too many targets or encoders; noise is stated for some readings only.
        """
        _refuse_unlike_observations(observations)
        names = dict.fromkeys(
            reading.target for observation in observations for reading in observation.readings
        )
        _refuse_too_many_targets(names)
        target_index = {name: i for i, name in enumerate(names)}
        rows, columns, readings = _list_readings(observations, target_index)
        shape = (len(observations), len(names))
        indices = rows, columns
        labels = [observation.label for observation in observations]
        joints = [observation.joints for observation in observations]
        forces = [observation.force for observation in observations]
        has_moment = [observation.moment is not None for observation in observations]
        has_load_point = [observation.load_point is not None for observation in observations]
        moments = [observation.moment or _NOTHING for observation in observations]
        load_points = [observation.load_point or _NOTHING for observation in observations]
        is_deflection = [reading.unloaded is None for reading in readings]
        unloaded = [reading.unloaded or _NOTHING for reading in readings]
        loaded = [_choose_loaded(reading) for reading in readings]
        return cls(
            labels=np.array(labels),
            targets=np.array(list(names)),
            joints=np.array(joints, dtype=np.float64),
            force=np.array(forces, dtype=np.float64),
            moment=np.array(moments, dtype=np.float64),
            moment_given=np.array(has_moment),
            load_point=np.array(load_points, dtype=np.float64),
            load_point_given=np.array(has_load_point),
            present=_scatter(shape, indices, [True] * len(readings), np.bool_),
            as_deflection=_scatter(shape, indices, is_deflection, np.bool_),
            unloaded=_scatter((*shape, 3), indices, unloaded, np.float64),
            loaded=_scatter((*shape, 3), indices, loaded, np.float64),
            encoders=EncoderArrays.from_observations(observations),
            noise=PointNoise.from_readings(shape, indices, readings),
            directions=Directions.from_readings(shape, indices, readings),
            after=PositionsAfter.from_readings(shape, indices, readings),
        )

    @property
    def unloaded_only(self) -> BoolArray:
        """Mask (N, T) of the targets that were read without a load only."""
        return np.isnan(self.loaded[..., 0])

    def select(self, rows: IndexArray, targets: IndexArray) -> ReadingArrays:
        """Return the readings of the selected observations and targets, in the given order."""
        selected: dict[str, Any] = {"targets": self.targets[targets]}
        for name in ("labels", "joints", "force", "moment", "moment_given", "load_point", "load_point_given"):
            selected[name] = getattr(self, name)[rows]
        for name in ("present", "as_deflection", "unloaded", "loaded"):
            selected[name] = getattr(self, name)[rows][:, targets]
        for name in _OPTIONAL_GROUPS:
            group = getattr(self, name)
            selected[name] = None if group is None else group.select(rows, targets)
        return replace(self, **selected)

    def observations(self) -> list[Observation]:
        """Return the observations as they were posted, with readings in the order of `targets`."""
        return [self._build_observation(row) for row in range(len(self.labels))]

    def _build_observation(self, i: int) -> Observation:
        """Return an observation as it was posted; `i` is its index.

        The numbers were validated when they were posted: validating 10,000 again takes as long as a run.
        """
        moment = tuple(self.moment[i].tolist()) if self.moment_given[i] else None
        load_point = tuple(self.load_point[i].tolist()) if self.load_point_given[i] else None
        read_targets = np.flatnonzero(self.present[i]).tolist()
        encoder_readings = None if self.encoders is None else self.encoders.build_encoder_readings(i)
        return Observation.model_construct(
            label=str(self.labels[i]),
            joints=self.joints[i].tolist(),
            force=tuple(self.force[i].tolist()),
            moment=moment,
            load_point=load_point,
            readings=[self._build_reading(i, t) for t in read_targets],
            encoder_readings=encoder_readings,
        )

    def _build_reading(self, i: int, t: int) -> Reading:
        """Return a reading as it was posted; `i` and `t` are the indices of observation and target."""
        loaded = tuple(self.loaded[i, t].tolist())
        noise = self.noise.get_reading_fields(i, t) if self.noise else {}
        if self.directions is not None and self.directions.has_direction[i, t]:
            values = self.directions.get_reading_fields(i, t)
            return Reading.model_construct(target=str(self.targets[t]), **noise, **values)
        if self.as_deflection[i, t]:
            return Reading.model_construct(target=str(self.targets[t]), deflection=loaded, **noise)
        unloaded = tuple(self.unloaded[i, t].tolist())
        if self.unloaded_only[i, t]:
            return Reading.model_construct(target=str(self.targets[t]), unloaded=unloaded, **noise)
        values = {} if self.after is None else self.after.get_reading_fields(i, t)
        return Reading.model_construct(
            target=str(self.targets[t]), unloaded=unloaded, loaded=loaded, **values, **noise
        )

    def pack(self) -> bytes:
        """Return the arrays as bytes of an npz archive, without pickles."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **self._get_arrays_by_name())
        return buffer.getvalue()

    @classmethod
    def unpack(cls, blob: bytes) -> ReadingArrays:
        """Return the readings from the bytes that `pack` made."""
        with np.load(io.BytesIO(blob), allow_pickle=False) as archive:
            arrays: dict[str, Any] = {name: archive[name] for name in cls._list_required_names()}
            arrays |= {name: group.from_archive(archive) for name, group in _OPTIONAL_GROUPS.items()}
            return cls(**arrays)

    @classmethod
    def _list_required_names(cls) -> list[str]:
        """Return the names of the arrays that every set has."""
        return [field.name for field in fields(cls) if field.name not in _OPTIONAL_GROUPS]

    def _get_arrays_by_name(self) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays by name: first the required arrays, then the arrays of optional groups."""
        arrays = {name: getattr(self, name) for name in self._list_required_names()}
        groups = (getattr(self, name) for name in _OPTIONAL_GROUPS)
        return arrays | {name: array for group in groups if group for name, array in group.arrays().items()}

    def digest(self) -> bytes:
        """Return the SHA-256, as bytes, of the arrays' names, types, shapes and contents."""
        digest = hashlib.sha256()
        for name, array in self._get_arrays_by_name().items():
            digest.update(f"{name} {array.dtype.str} {array.shape};".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.digest()


def compute_content_hash(
    header: MeasurementSetHeader, readings: ReadingArrays, resolved: ResolvedFrame | None = None
) -> str:
    """Return the SHA-256 of a set's content: header, readings and resolved frame, but not its name."""
    # Sets were hashed before these fields existed: where nothing is stated, the hash has to stay what it was.
    newer_fields = {"refuted", "grounds"}
    unstated_fields = {name for name in newer_fields if not getattr(header.noise, name, None)}
    excluded: dict[str, Any] = dict.fromkeys(unstated_fields, True)
    grounds = None if header.noise is None else header.noise.grounds
    if grounds is not None:
        newer_grounds = ("between", "force", "tared")
        excluded["grounds"] = {name for name in newer_grounds if getattr(grounds, name) is None}
    text = header.model_dump_json(
        include={"units", "encoders", "noise", "flange_targets", "load_point"},
        exclude={"noise": excluded},
    )
    if header.load_point_target is not None:
        text += f"load_point_target {header.load_point_target}"
    if header.frame is not None and resolved is not None:
        text += f"{header.frame.forces} {resolved.model_dump_json()}"
    return hashlib.sha256(text.encode() + readings.digest()).hexdigest()


def _list_readings(
    observations: list[Observation], column: dict[str, int]
) -> tuple[list[int], list[int], list[Reading]]:
    """Return the readings of all observations in one list, with the indices of observation and target.

    Args:
        observations: observations of a set.
        column: index of each target by its name.

    Returns:
        (rows, columns, readings): index of the observation and of the target of each reading; the readings.

    Raises:
        MeasurementError: an observation has two readings of a target.
    """
    rows, columns, readings = [], [], []
    used = set[tuple[int, int]]()  # observations and targets that have a reading already
    for i, observation in enumerate(observations):
        for k, reading in enumerate(observation.readings):
            cell = i, column[reading.target]
            if cell in used:
                raise NamedObservationError(
                    f"target '{reading.target}' has two readings in observation '{observation.label}'",
                    where=f"observations[{i}].readings[{k}].target",
                    remedy="give each target at most once per observation, or rename the target",
                )
            used.add(cell)
            rows.append(cell[0])
            columns.append(cell[1])
            readings.append(reading)
    return rows, columns, readings


def _choose_loaded(reading: Reading) -> Sequence[float]:
    """Return the position under load of a reading, or its deflection; NaN if it was read unloaded only."""
    stated = reading.loaded or reading.deflection
    if stated:
        return stated
    return _UNREAD if reading.unloaded else _NOTHING


def _scatter(
    shape: tuple[int, ...],
    indices: tuple[list[int], list[int]],
    values: list[Any],
    number_type: type[np.generic],
) -> npt.NDArray[Any]:
    """Return an array of zeros with given values at some cells.

    Args:
        shape: shape of the array; its first two axes are observations and targets.
        indices: index of the observation, then of the target, of each value.
        values: values of the cells.
        number_type: type of the array's numbers.
    """
    table = np.zeros(shape, dtype=number_type)
    table[indices] = values
    return table


def _refuse_too_many_targets(names: Collection[str]) -> None:
    """Refuse more than `MAX_TARGETS` different targets.

    The arrays hold all targets of all observations: a new name for every reading would fill the memory.
    """
    if len(names) > MAX_TARGETS:
        raise MeasurementError(
            f"the set has {len(names)} different targets, more than {MAX_TARGETS}",
            where="observations",
            remedy="use the same name for the same target in every observation",
        )


def _refuse_unlike_observations(observations: list[Observation]) -> None:
    """Refuse observations with different numbers of joint angles, or with the same label."""
    _refuse_other_joint_counts(observations)
    index_of_label = dict[str, int]()  # index of the first observation with the label
    for i, observation in enumerate(observations):
        first = index_of_label.setdefault(observation.label, i)
        if first != i:
            raise NamedObservationError(
                f"label '{observation.label}' is already used by observations[{first}]",
                where=f"observations[{i}].label",
                remedy="give every observation a unique label",
            )


def _refuse_other_joint_counts(observations: Sequence[Observation]) -> None:
    """Refuse an observation that has another number of joint angles than most observations."""
    counts = Counter(len(observation.joints) for observation in observations)
    usual_count = counts.most_common(1)[0][0]
    first_count = len(observations[0].joints)
    others = "the first observation has" if usual_count == first_count else "most observations have"
    for i, observation in enumerate(observations):
        count = len(observation.joints)
        if count != usual_count:
            raise NamedObservationError(
                f"observation '{observation.label}' has {count} joint angles, but {others} {usual_count}",
                where=f"observations[{i}].joints",
                remedy="give one angle for each joint of the robot in every observation",
            )


def has_loads(blob: bytes) -> bool:
    """Return whether any reading was made under a load, in arrays that `ReadingArrays.pack` serialised."""
    with np.load(io.BytesIO(blob), allow_pickle=False) as archive:
        return bool((archive["present"] & ~np.isnan(archive["loaded"][..., 0])).any())


def hash_texts(*texts: str) -> str:
    """Return the SHA-256, in hexadecimal digits, of texts that are joined by blanks."""
    return hashlib.sha256(" ".join(texts).encode()).hexdigest()


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
    shots = _locate_load_point(header, header.load_point_target, readings, robot)
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
    header: MeasurementSetHeader, readings: ReadingArrays, robot: Robot, shots: _LocatedLoadPoint | None
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


@dataclass(frozen=True, eq=False)
class _LocatedLoadPoint:
    """Load point from readings of a target at the hook, with the set that remains without these readings."""

    target: str  # name of the target at the hook
    place: FloatArray  # (3,) load point that the readings show, flange frame [m]
    lever: float  # distance of the hook from the targets that give its place, or from R0 [m]
    error: float  # greatest of the errors [m] that the readings show: scatter of the hook, misfit of targets
    least: float  # least standard uncertainty of each coordinate [m], by what the place rests on
    stated: FloatArray | None  # (3,) load point that was stated, flange frame [m]; None if not stated
    stated_uncertainty: float  # standard uncertainty of each coordinate of `stated` [m]
    header: MeasurementSetHeader  # header of the set, with this load point
    other_readings: ReadingArrays  # readings of the other targets
    rows: IndexArray  # (K,) indices of the observations in the set with such readings

    def to_hook_reading(self, sigma: float, repeatability: float) -> HookReading:
        """Return the reading with its uncertainty: what its errors add up to, and at least `least`.

        Args:
            sigma: standard uncertainty of a coordinate of a reading [m].
            repeatability: standard deviation of a joint's angle from posture to posture [rad].
        """
        by_reading = float(np.hypot(sigma, repeatability * self.lever))
        uncertainty = max(float(np.hypot(by_reading, self.error)), self.least)
        return HookReading(self.target, self.place, uncertainty, self.stated, self.stated_uncertainty)


def _locate_load_point(
    header: MeasurementSetHeader, name: str, readings: ReadingArrays, robot: Robot
) -> _LocatedLoadPoint:
    """Locate the load point by the readings of a target at the hook.

    An observation that has only positions without load belongs to the reading of the hook: it is no
    observation under load.

    Args:
        header: header of a set in R0.
        name: name of the target at the hook.
        readings: readings of the set in R0.
        robot: robot that was measured.

    Raises:
        MeasurementError: the target was not read without load, its readings disagree, the other targets of
            its posture are not where they are in the other postures, no other reading remains, or
            observations state different load points.
    """
    length = LENGTH[header.units.length]
    is_hook = readings.targets == name
    stated = _find_single_load_point(header, readings)
    was_placed = readings.present & ~readings.as_deflection
    _refuse_unread_hook(name, readings, was_placed & is_hook)
    is_shot = (was_placed & is_hook).any(axis=1)
    hook = length * readings.unloaded[:, int(np.argmax(is_hook))]
    targets = length * readings.unloaded[:, ~is_hook]
    others = was_placed[:, ~is_hook]
    postures = Postures(
        robot, robot.joint_map.model_angles(joint_factors(robot, header.units) * readings.joints)
    )
    shots = locate_hook(postures, targets, others, hook, is_shot)
    _refuse_moved_targets(name, readings, is_shot, shots)
    places = np.array([shot.place for shot in shots])
    place = places.mean(axis=0)
    _refuse_disagreeing_shots(name, readings, is_shot, places)
    first = int(np.argmax(is_shot))
    origin = targets[first, others[first]].mean(axis=0) if others[first].any() else np.zeros(3)
    is_loaded = (readings.present & ~readings.unloaded_only & ~is_hook).any(axis=1)
    if readings.encoders is not None:
        is_loaded |= readings.encoders.present.any(axis=1)
    is_kept = (readings.present & ~is_hook).any(axis=1)
    if readings.encoders is not None:
        is_kept |= readings.encoders.present.any(axis=1)
    if is_loaded.any():
        is_kept &= is_loaded | ~is_shot
    if not is_kept.any():
        raise MeasurementError(
            f"target '{name}' gives only the load point, but no other target has a reading",
            where="load_point_target",
            remedy="omit `load_point_target` and give `load_point`, or add the readings of the other targets",
        )
    kept = readings.select(np.flatnonzero(is_kept), np.flatnonzero(~is_hook))
    rest_on_targets = all(shot.targets for shot in shots)
    x, y, z = (place / length).tolist()
    without_points = replace(kept, load_point_given=np.zeros_like(kept.load_point_given))
    return _LocatedLoadPoint(
        target=name,
        place=place,
        lever=float(np.linalg.norm(hook[first] - origin)),
        error=max(float(_find_distances(places).max()) / 2.0, max(shot.misfit for shot in shots)),
        least=LEAST_OF_GROUND["tracker" if rest_on_targets else "drawing"],
        stated=None if stated is None else length * stated,
        stated_uncertainty=_find_stated_uncertainty(header.noise, length),
        header=header.model_copy(update={"load_point": (x, y, z)}),
        other_readings=without_points,
        rows=np.flatnonzero(is_kept),
    )


def _find_stated_uncertainty(noise: Noise | None, length: float) -> float:
    """Return the uncertainty of a coordinate of the load point [m] as stated, else by its ground."""
    if noise is not None and noise.load_point is not None:
        return length * noise.load_point
    ground = None if noise is None or noise.grounds is None else noise.grounds.load_point
    return ASSUMED_LOAD_POINT if ground is None else LEAST_OF_GROUND[ground]


def _find_single_load_point(header: MeasurementSetHeader, readings: ReadingArrays) -> FloatArray | None:
    """Return the load point (3,) that the set and all observations state; None if nothing states it.

    Raises:
        MeasurementError: observations state different load points, although a reading shows one.
    """
    points: list[FloatArray] = [readings.load_point[i] for i in np.flatnonzero(readings.load_point_given)]
    is_default_used = not readings.load_point_given.all()
    if header.load_point is not None and is_default_used:
        points.insert(0, np.array(header.load_point, dtype=np.float64))
    if not points:
        return None
    if any(not np.array_equal(point, points[0]) for point in points):
        raise MeasurementError(
            "the observations state different load points, but the reading of target "
            f"'{header.load_point_target}' shows a single load point",
            where="load_point_target",
            remedy="omit `load_point_target`, or omit `load_point` in every observation",
        )
    first: FloatArray = points[0]
    return first


def _refuse_unread_hook(name: str, readings: ReadingArrays, was_placed: BoolArray) -> None:
    """Refuse a set whose target at the hook has no position without load.

    Args:
        name: name of the target at the hook.
        readings: readings of N observations of T targets.
        was_placed: (N, T) mask of the positions of this target without load.
    """
    if was_placed.any():
        return
    is_read = name in readings.targets
    reason = f"no observation has a reading of target '{name}'"
    if is_read:
        reason = f"target '{name}' was read only as a deflection, which shows no position"
    raise MeasurementError(
        f"{reason}, so the load point is unknown",
        where="load_point_target",
        remedy=f"read target '{name}' on the hook once without load (`unloaded`), in any observation; or "
        "omit `load_point_target`, and give `load_point`",
    )


def _find_distances(places: FloatArray) -> FloatArray:
    """Return the distances (S, S) [m] between places (S, 3)."""
    between = places[:, None] - places
    return np.asarray(np.linalg.norm(between, axis=2))


def _refuse_moved_targets(
    name: str, readings: ReadingArrays, is_shot: BoolArray, shots: Sequence[HookShot]
) -> None:
    """Refuse a reading of the hook whose posture has the other targets in other places on the flange.

    The hook's place rests on these targets: a wrong reading of one of them moves the load point.

    Args:
        name: name of the target at the hook.
        readings: readings of N observations.
        is_shot: (N,) mask of the S observations with a reading of this target.
        shots: S readings of this target.
    """
    for row, shot in zip(np.flatnonzero(is_shot).tolist(), shots, strict=True):
        is_plausible = shot.misfit <= LARGEST_HOOK_SCATTER and shot.shift <= LARGEST_HOOK_SHIFT
        if is_plausible:
            continue
        distance, plausible = shot.misfit, LARGEST_HOOK_SCATTER
        if shot.misfit <= LARGEST_HOOK_SCATTER:
            distance, plausible = shot.shift, LARGEST_HOOK_SHIFT
        raise NamedObservationError(
            f"observation '{readings.labels[row]}' reads target '{name}' on the hook, but in this "
            f"observation another target is {length_text(distance)} from its place on the flange in the "
            f"other observations ({length_text(plausible)} is plausible), so the load point is wrong",
            where=f"observations[{row}].readings",
            remedy="correct or omit the wrong reading, or check the joint angles of this observation",
        )


def _refuse_disagreeing_shots(
    name: str, readings: ReadingArrays, is_shot: BoolArray, places: FloatArray
) -> None:
    """Refuse readings of a target at the hook that show different load points.

    Args:
        name: name of the target at the hook.
        readings: readings of N observations.
        is_shot: (N,) mask of the S observations with a reading of this target.
        places: (S, 3) load points that these readings show, flange frame [m].
    """
    distances = _find_distances(places)
    if distances.max() <= LARGEST_HOOK_SCATTER:
        return
    farthest = int(np.argmax(np.median(distances, axis=1)))
    row = int(np.flatnonzero(is_shot)[farthest])
    raise NamedObservationError(
        f"the {len(places)} readings of target '{name}' show different load points: the load point by "
        f"observation '{readings.labels[row]}' is {length_text(float(distances[farthest].max()))} from the "
        f"load point by another observation ({length_text(LARGEST_HOOK_SCATTER)} is plausible)",
        where=f"observations[{row}].readings",
        remedy="omit the wrong reading, or check the joint angles of its observation; the hook must not move "
        "on the flange",
    )


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
