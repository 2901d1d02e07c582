"""Readings as arrays: in the units of their set, as they are stored."""

from __future__ import annotations

import hashlib
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Final, Self

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.measurement import (
    MAX_TARGETS,
    EncoderReading,
    Matrix3,
    MeasurementSetHeader,
    Noise,
    Observation,
    Reading,
    ResolvedFrame,
)
from jointstiff.schemas.robot import MAX_JOINTS
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot


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


_OPTIONAL_GROUPS: dict[str, type[ArrayGroup]] = {
    "encoders": EncoderArrays,
    "noise": PointNoise,
    "directions": Directions,
    "after": PositionsAfter,
}
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


def hash_texts(*texts: str) -> str:
    """Return the SHA-256, in hexadecimal digits, of texts that are joined by blanks."""
    return hashlib.sha256(" ".join(texts).encode()).hexdigest()
