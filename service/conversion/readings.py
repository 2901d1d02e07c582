"""Readings as arrays: in the units of their set, as they are stored, and in SI units for computation."""

from __future__ import annotations

import hashlib
import io
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Final, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.joints import JOINT_UNITS, JointKind
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
class ReadingCells:
    """All K readings of a set, with their cells in tables of N observations of T targets."""

    shape: tuple[int, int]  # (N, T)
    observations: list[int]  # (K,) index of the observation of each reading
    targets: list[int]  # (K,) index of the target of each reading
    readings: list[Reading]  # (K,)

    def tabulate(
        self, values: Sequence[Any], *value_shape: int, number_type: type[np.generic] = np.float64
    ) -> npt.NDArray[Any]:
        """Return the values of the K readings as a table (N, T, …) that is zero where there is no reading.

        `value_shape` is the shape of a value: vectors have 3, and their table is (N, T, 3).
        """
        table = np.zeros((*self.shape, *value_shape), dtype=number_type)
        table[self.observations, self.targets] = values
        return table


@dataclass(frozen=True, eq=False)
class Directions(ArrayGroup):
    """Readings along a direction of N observations of T targets; zero where a reading is of another kind."""

    prefix = "direction_"

    displacement: FloatArray  # (N, T) loaded minus unloaded, along the direction
    vector: FloatArray  # (N, T, 3) direction as posted, of any length
    in_flange: BoolArray  # (N, T) whether the direction was posted in the flange frame

    @classmethod
    def from_readings(cls, cells: ReadingCells) -> Directions | None:
        """Arrange readings along a direction as arrays; None if no reading is along a direction."""
        readings = cells.readings
        if all(reading.displacement is None for reading in readings):
            return None
        displacements = [each.displacement or 0.0 for each in readings]
        vectors = [each.direction or each.flange_direction or _NOTHING for each in readings]
        is_in_flange = [each.flange_direction is not None for each in readings]
        return cls(
            displacement=cells.tabulate(displacements),
            vector=cells.tabulate(vectors, 3),
            in_flange=cells.tabulate(is_in_flange, number_type=np.bool_),
        )

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
        joints = _list_encoder_joints(observations)
        if not joints:
            return None
        present = np.zeros((len(observations), len(joints)), dtype=np.bool_)
        unloaded, loaded = np.zeros(present.shape), np.zeros(present.shape)
        for row, observation in enumerate(observations):
            _refuse_two_readings_of_encoder(row, observation)
            for reading in observation.encoder_readings or ():
                column = joints.index(reading.joint)
                present[row, column] = True
                unloaded[row, column] = reading.unloaded
                loaded[row, column] = reading.loaded
        return cls(np.array(joints), present, unloaded, loaded)

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
    def from_readings(cls, cells: ReadingCells) -> PositionsAfter | None:
        """Arrange the positions that were read again without load as arrays; None without such positions."""
        positions = [each.unloaded_after for each in cells.readings]
        if not any(positions):
            return None
        was_read = [position is not None for position in positions]
        return cls(
            position=cells.tabulate([position or _NOTHING for position in positions], 3),
            present=cells.tabulate(was_read, number_type=np.bool_),
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
    def from_readings(cls, cells: ReadingCells) -> PointNoise | None:
        """Arrange the noise that readings state as arrays; None if no reading states its noise.

        Raises:
            MeasurementError: some readings of the tracker state their noise, and others do not.
        """
        readings = cells.readings
        if not any(_states_noise(reading) for reading in readings):
            return None
        _refuse_partly_stated_noise(cells)
        # A reading states either sigma or covariances: the schema refuses readings with both.
        sigmas = [each.sigma or 0.0 for each in readings]
        unloaded_covariances = [each.unloaded_covariance or _NO_COVARIANCE for each in readings]
        loaded_covariances = [each.loaded_covariance or _NO_COVARIANCE for each in readings]
        return cls(
            sigma=cells.tabulate(sigmas),
            unloaded=cells.tabulate(unloaded_covariances, 3, 3),
            loaded=cells.tabulate(loaded_covariances, 3, 3),
        )

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


def _list_encoder_joints(observations: list[Observation]) -> list[str]:
    """Return the names of the joints whose encoders were read, in order of first appearance.

    Raises:
        MeasurementError: there are more joints than a robot can have.
    """
    readings = (reading for observation in observations for reading in observation.encoder_readings or ())
    names = list(dict.fromkeys(reading.joint for reading in readings))
    if len(names) > MAX_JOINTS:
        raise MeasurementError(
            f"the readings name encoders of {len(names)} different joints, more than {MAX_JOINTS}",
            where="observations",
            remedy="use the robot's joint names, the same in every observation",
        )
    return names


def _refuse_two_readings_of_encoder(row: int, observation: Observation) -> None:
    """Raise a `MeasurementError` if the observation with the index `row` has two readings of an encoder."""
    joints = set[str]()
    for k, reading in enumerate(observation.encoder_readings or ()):
        if reading.joint in joints:
            raise NamedObservationError(
                f"the encoder of '{reading.joint}' has two readings in observation '{observation.label}'",
                where=f"observations[{row}].encoder_readings[{k}].joint",
                remedy="give each joint at most once per observation",
            )
        joints.add(reading.joint)


def _states_noise(reading: Reading) -> bool:
    """Return whether a reading states its own noise: sigma, or covariances of its positions."""
    return reading.sigma is not None or reading.unloaded_covariance is not None


def _refuse_partly_stated_noise(cells: ReadingCells) -> None:
    """Refuse readings if some of them state their noise, and others do not.

    Readings along a direction come from another instrument: their noise is checked elsewhere.

    Raises:
        MeasurementError: a reading of the tracker states no noise, but another does.
    """
    by_tracker = [k for k, reading in enumerate(cells.readings) if reading.displacement is None]
    without_noise = [k for k in by_tracker if not _states_noise(cells.readings[k])]
    if not without_noise or len(without_noise) == len(by_tracker):
        return
    i = cells.observations[without_noise[0]]
    raise MeasurementError(
        "some readings state their own noise, but a reading of this observation states no noise",
        where=f"observations[{i}].readings",
        remedy="give every reading its `sigma` or its covariances, or give only `noise` for the set",
    )


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
            covariances = covariances.replaced_by(own_noise, length)
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

    def replaced_by(self, own_noise: PointNoise, length: float) -> _PositionCovariances:
        """Return the covariances with those of the readings that state their noise themselves.

        `length` is the set's unit of length in m.

        Raises:
            MeasurementError: a stated matrix is not a covariance.
        """
        own_unloaded, own_loaded = own_noise.compute_covariances()
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
        noise = DifferenceNoise.from_positions(unloaded, self.loaded, measurements.coordinates)
        return _StatedNoise(noise.sigma, noise.covariance)


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
_NO_COVARIANCE: Final = (_NOTHING, _NOTHING, _NOTHING)
"""Covariance in place of one that a reading does not state."""


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
        names = _list_target_names(observations)
        cells = _list_readings(observations, names)
        return cls(
            labels=np.array([observation.label for observation in observations]),
            targets=np.array(names),
            **_arrange_loads(observations),
            **_arrange_positions(cells),
            encoders=EncoderArrays.from_observations(observations),
            noise=PointNoise.from_readings(cells),
            directions=Directions.from_readings(cells),
            after=PositionsAfter.from_readings(cells),
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
        noise = {} if self.noise is None else self.noise.get_reading_fields(i, t)
        return Reading.model_construct(target=str(self.targets[t]), **self._get_values(i, t), **noise)

    def _get_values(self, i: int, t: int) -> dict[str, Any]:
        """Return field → value of what a reading measured: a displacement, a deflection, or positions.

        `i` and `t` are the indices of observation and target.
        """
        if self.directions is not None and self.directions.has_direction[i, t]:
            return self.directions.get_reading_fields(i, t)
        loaded = tuple(self.loaded[i, t].tolist())
        if self.as_deflection[i, t]:
            return {"deflection": loaded}
        unloaded = tuple(self.unloaded[i, t].tolist())
        if self.unloaded_only[i, t]:
            return {"unloaded": unloaded}
        read_again = {} if self.after is None else self.after.get_reading_fields(i, t)
        return {"unloaded": unloaded, "loaded": loaded, **read_again}

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
    text = header.model_dump_json(
        include={"units", "encoders", "noise", "flange_targets", "load_point"},
        exclude={"noise": _list_unhashed_fields(header.noise)},
    )
    if header.load_point_target is not None:
        text += f"load_point_target {header.load_point_target}"
    if header.frame is not None and resolved is not None:
        text += f"{header.frame.forces} {resolved.model_dump_json()}"
    return hashlib.sha256(text.encode() + readings.digest()).hexdigest()


def _list_unhashed_fields(noise: Noise | None) -> dict[str, Any]:
    """Return the fields of the noise that its hash leaves out, in the form of Pydantic's `exclude`.

    Sets were hashed before these fields existed: where nothing is stated, the hash has to stay what it was.
    """
    excluded: dict[str, Any] = {}
    for name in ("refuted", "grounds"):
        if not getattr(noise, name, None):
            excluded[name] = True
    if noise is not None and noise.grounds is not None:
        newer_grounds = ("between", "force", "tared")
        excluded["grounds"] = {name for name in newer_grounds if getattr(noise.grounds, name) is None}
    return excluded


def _arrange_loads(observations: list[Observation]) -> dict[str, npt.NDArray[Any]]:
    """Return name → array with a row for each of N observations: joint angles, forces, moments, load points.

    Moments and load points that an observation does not state are zero, and False in `…_given`.
    """
    joints = [observation.joints for observation in observations]
    forces = [observation.force for observation in observations]
    moments = [observation.moment for observation in observations]
    load_points = [observation.load_point for observation in observations]
    return {
        "joints": np.array(joints, dtype=np.float64),
        "force": np.array(forces, dtype=np.float64),
        "moment": np.array([moment or _NOTHING for moment in moments], dtype=np.float64),
        "moment_given": np.array([moment is not None for moment in moments]),
        "load_point": np.array([point or _NOTHING for point in load_points], dtype=np.float64),
        "load_point_given": np.array([point is not None for point in load_points]),
    }


def _arrange_positions(cells: ReadingCells) -> dict[str, npt.NDArray[Any]]:
    """Return name → array of positions (N, T, 3) without and under load, and masks (N, T) of the readings.

    A reading that has no position without load is a deflection, or lies along a direction.
    """
    readings = cells.readings
    was_read = [True for _ in readings]
    is_deflection = [reading.unloaded is None for reading in readings]
    unloaded = [reading.unloaded or _NOTHING for reading in readings]
    loaded = [_choose_loaded(reading) for reading in readings]
    return {
        "present": cells.tabulate(was_read, number_type=np.bool_),
        "as_deflection": cells.tabulate(is_deflection, number_type=np.bool_),
        "unloaded": cells.tabulate(unloaded, 3),
        "loaded": cells.tabulate(loaded, 3),
    }


def _list_readings(observations: list[Observation], targets: list[str]) -> ReadingCells:
    """Return the readings of all observations with their cells; `targets` are the names of the T targets.

    Raises:
        MeasurementError: an observation has two readings of a target.
    """
    column = {name: t for t, name in enumerate(targets)}
    cells = ReadingCells((len(observations), len(targets)), [], [], [])
    for i, observation in enumerate(observations):
        _refuse_two_readings_of_target(i, observation)
        for reading in observation.readings:
            cells.observations.append(i)
            cells.targets.append(column[reading.target])
            cells.readings.append(reading)
    return cells


def _refuse_two_readings_of_target(i: int, observation: Observation) -> None:
    """Raise a `MeasurementError` if the observation with the index `i` has two readings of a target."""
    targets = set[str]()
    for k, reading in enumerate(observation.readings):
        if reading.target in targets:
            raise NamedObservationError(
                f"target '{reading.target}' has two readings in observation '{observation.label}'",
                where=f"observations[{i}].readings[{k}].target",
                remedy="give each target at most once per observation, or rename the target",
            )
        targets.add(reading.target)


def _choose_loaded(reading: Reading) -> Sequence[float]:
    """Return the position under load of a reading, or its deflection; NaN if it was read unloaded only."""
    stated = reading.loaded or reading.deflection
    if stated:
        return stated
    return _UNREAD if reading.unloaded else _NOTHING


def _list_target_names(observations: list[Observation]) -> list[str]:
    """Return the names of all targets, in order of first appearance.

    The arrays have all targets of all observations: a new name for every reading would fill the memory.

    Raises:
        MeasurementError: there are more than `MAX_TARGETS` different targets.
    """
    readings = (reading for observation in observations for reading in observation.readings)
    names = list(dict.fromkeys(reading.target for reading in readings))
    if len(names) > MAX_TARGETS:
        raise MeasurementError(
            f"the set has {len(names)} different targets, more than {MAX_TARGETS}",
            where="observations",
            remedy="use the same name for the same target in every observation",
        )
    return names


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


def _add_hook(measurements: Measurements, shots: _LocatedLoadPoint) -> Measurements:
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


def _refuse_other_joints(header: MeasurementSetHeader, readings: ReadingArrays, robot: Robot) -> None:
    """Refuse readings with joints that differ from the robot's joints in number or kind.

    Raises:
        MeasurementError: names the first such joint.
    """
    count = readings.joints.shape[1]
    if count != robot.n:
        raise MeasurementError(
            f"there are {count} joint angles, but the robot has {robot.n} joints",
            where="observations[0].joints",
            remedy=f"give the {robot.n} controller angles of {list_joint_names(robot)}",
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


@dataclass(frozen=True, eq=False)
class _HookPositions:
    """Positions in R0 [m] that N observations read without load: of the hook, and of the T other targets."""

    hook: FloatArray  # (N, 3) position of the target at the hook
    is_shot: BoolArray  # (N,) whether the target at the hook was read
    targets: FloatArray  # (N, T, 3) positions of the other targets
    was_read: BoolArray  # (N, T) whether these were read

    @classmethod
    def from_readings(cls, name: str, readings: ReadingArrays, length: float) -> _HookPositions:
        """Select the positions that were read without load.

        Args:
            name: name of the target at the hook.
            readings: readings of the set in R0.
            length: the set's unit of length in m.

        Raises:
            MeasurementError: the target at the hook was not read without load.
        """
        is_hook = readings.targets == name
        was_placed = readings.present & ~readings.as_deflection
        _refuse_unread_hook(name, readings, was_placed & is_hook)
        return cls(
            hook=length * readings.unloaded[:, int(np.argmax(is_hook))],
            is_shot=(was_placed & is_hook).any(axis=1),
            targets=length * readings.unloaded[:, ~is_hook],
            was_read=was_placed[:, ~is_hook],
        )

    def compute_lever(self) -> float:
        """Return the distance [m] of the hook from the mean of the other targets, in the first shot.

        Without other targets it is the distance from the origin of R0.
        """
        first = int(np.argmax(self.is_shot))
        others = self.targets[first, self.was_read[first]]
        origin = others.mean(axis=0) if len(others) else np.zeros(3)
        return float(np.linalg.norm(self.hook[first] - origin))


def _locate_load_point(
    header: MeasurementSetHeader, name: str, readings: ReadingArrays, robot: Robot
) -> _LocatedLoadPoint:
    """Locate the load point by the readings of a target at the hook.

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
    stated = _find_single_load_point(header, readings)
    positions = _HookPositions.from_readings(name, readings, length)
    joints = joint_factors(robot, header.units) * readings.joints
    postures = Postures(robot, robot.joint_map.model_angles(joints))
    is_shot = positions.is_shot
    shots = locate_hook(postures, positions.targets, positions.was_read, positions.hook, is_shot)
    _refuse_moved_targets(name, readings, is_shot, shots)
    places = np.array([shot.place for shot in shots])
    _refuse_disagreeing_shots(name, readings, is_shot, places)
    rows = _find_kept_observations(name, readings, is_shot)
    place = places.mean(axis=0)
    x, y, z = (place / length).tolist()
    return _LocatedLoadPoint(
        target=name,
        place=place,
        lever=positions.compute_lever(),
        error=_find_greatest_error(places, shots),
        least=_find_least_uncertainty(shots),
        stated=None if stated is None else length * stated,
        stated_uncertainty=_find_stated_uncertainty(header.noise, length),
        header=header.model_copy(update={"load_point": (x, y, z)}),
        other_readings=_omit_hook(name, readings, rows),
        rows=rows,
    )


def _find_greatest_error(places: FloatArray, shots: Sequence[HookShot]) -> float:
    """Return the greatest error [m] of S readings of the hook: half their scatter, or a misfit of targets.

    Args:
        places: (S, 3) places of the hook by each reading, flange frame [m].
        shots: the readings; `misfit` is the distance of another target from its mean place on the flange [m].
    """
    half_scatter = float(_find_distances(places).max()) / 2.0
    return max(half_scatter, max(shot.misfit for shot in shots))


def _find_least_uncertainty(shots: Sequence[HookShot]) -> float:
    """Return the least uncertainty [m] of the hook's place: of a tracker, if each reading rests on targets.

    A reading without other targets rests on the kinematics of the robot, known as well as from a drawing.
    """
    rest_on_targets = all(shot.targets for shot in shots)
    return LEAST_OF_GROUND["tracker" if rest_on_targets else "drawing"]


def _find_kept_observations(name: str, readings: ReadingArrays, is_shot: BoolArray) -> IndexArray:
    """Return the indices (K,) of the observations that remain without the readings of the hook.

    An observation that has only positions without load belongs to the reading of the hook, and is omitted: it
    is no observation under load.

    Args:
        name: name of the target at the hook.
        readings: readings of N observations.
        is_shot: (N,) mask of the observations with a reading of this target.

    Raises:
        MeasurementError: no observation remains.
    """
    encoders_were_read = np.zeros(len(readings.labels), dtype=np.bool_)
    if readings.encoders is not None:
        encoders_were_read |= readings.encoders.present.any(axis=1)
    of_others = readings.present & (readings.targets != name)
    is_loaded = (of_others & ~readings.unloaded_only).any(axis=1) | encoders_were_read
    is_kept = of_others.any(axis=1) | encoders_were_read
    if is_loaded.any():
        is_kept &= is_loaded | ~is_shot
    if not is_kept.any():
        raise MeasurementError(
            f"target '{name}' gives only the load point, but no other target has a reading",
            where="load_point_target",
            remedy="omit `load_point_target` and give `load_point`, or add the readings of the other targets",
        )
    return np.flatnonzero(is_kept)


def _omit_hook(name: str, readings: ReadingArrays, rows: IndexArray) -> ReadingArrays:
    """Return the readings of the other targets in the observations `rows`, without stated load points.

    The set's load point, which the target `name` at the hook shows, then holds for all observations.
    """
    others = readings.select(rows, np.flatnonzero(readings.targets != name))
    return replace(others, load_point_given=np.zeros_like(others.load_point_given))


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
    names = readings.targets.tolist()
    for t in np.flatnonzero(readings.as_deflection.any(axis=0)):
        if names[t] not in header.flange_targets:
            first = int(np.flatnonzero(readings.as_deflection[:, t])[0])
            raise MeasurementError(
                f"target '{names[t]}' has a deflection but no position in the flange frame",
                where=f"observations[{first}].readings",
                remedy=f"add '{names[t]}' to `flange_targets`, in the flange frame",
            )
    in_flange = np.array([header.flange_targets.get(name, _NOTHING) for name in names])
    return np.where(readings.as_deflection[..., None], in_flange, readings.unloaded)
