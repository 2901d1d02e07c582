"""Readings as arrays: in the units of their set, as they are stored."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
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
class Directions(ArrayGroup):
    """Readings along a direction of N observations of T targets; zero where a reading is of another kind."""

    prefix = "direction_"

    displacement: FloatArray  # (N, T) loaded minus unloaded, along the direction
    vector: FloatArray  # (N, T, 3) direction as posted, of any length
    in_flange: BoolArray  # (N, T) whether the direction was posted in the flange frame

    @property
    def has_direction(self) -> BoolArray:
        """Mask (N, T) of the readings that are one component along a direction, whose vector is not zero."""
        return np.asarray(self.vector.any(axis=-1))

    def rotate(self, R: FloatArray) -> Directions:
        """Return a copy with the directions rotated by R (3, 3), except directions in the flange frame."""
        vector = np.where(self.in_flange[..., None], self.vector, self.vector @ R.T)
        return replace(self, vector=vector)

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
        read = [(row, each) for row, one in enumerate(observations) for each in one.encoder_readings or ()]
        joints = list(dict.fromkeys(reading.joint for _, reading in read))
        if not joints:
            return None
        _refuse_many_names(joints, MAX_JOINTS, "joints with encoders")
        present = np.zeros((len(observations), len(joints)), dtype=np.bool_)
        unloaded, loaded = np.zeros(present.shape), np.zeros(present.shape)
        for row, reading in read:
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


@dataclass(frozen=True, eq=False)
class PositionsAfter(ArrayGroup):
    """Positions of T targets in N observations that were read again after the load was removed."""

    prefix = "after_"

    position: FloatArray  # (N, T, 3) positions, as those of the other readings; zero where not read again
    present: BoolArray  # (N, T) which targets were read again


@dataclass(frozen=True, eq=False)
class PointNoise(ArrayGroup):
    """Noise stated by readings of T targets in N observations: sigma or covariances, zero if not stated."""

    prefix = "noise_"

    sigma: FloatArray  # (N, T) standard uncertainty of each coordinate
    unloaded: FloatArray  # (N, T, 3, 3) covariance of the unloaded position
    loaded: FloatArray  # (N, T, 3, 3) covariance of the loaded position

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
_STATED_LOADS: Final[Mapping[str, Callable[[Observation], Any]]] = {
    "joints": lambda observation: observation.joints,
    "force": lambda observation: observation.force,
    "moment": lambda observation: observation.moment or _NOTHING,
    "moment_given": lambda observation: observation.moment is not None,
    "load_point": lambda observation: observation.load_point or _NOTHING,
    "load_point_given": lambda observation: observation.load_point is not None,
}
"""Array of N rows → value of an observation."""
_STATED_READINGS: Final[Mapping[str, tuple[Callable[[Reading], Any], Any]]] = {
    "present": (lambda _: True, False),
    "as_deflection": (lambda reading: reading.unloaded is None, False),
    "unloaded": (lambda reading: reading.unloaded, _NOTHING),
    "loaded": (
        lambda reading: reading.loaded or reading.deflection or (_UNREAD if reading.unloaded else None),
        _NOTHING,
    ),
    "noise_sigma": (lambda reading: reading.sigma, 0.0),
    "noise_unloaded": (lambda reading: reading.unloaded_covariance, _NO_COVARIANCE),
    "noise_loaded": (lambda reading: reading.loaded_covariance, _NO_COVARIANCE),
    "direction_displacement": (lambda reading: reading.displacement, 0.0),
    "direction_vector": (lambda reading: reading.direction or reading.flange_direction, _NOTHING),
    "direction_in_flange": (lambda reading: reading.flange_direction is not None, False),
    "after_position": (lambda reading: reading.unloaded_after, _NOTHING),
    "after_present": (lambda reading: reading.unloaded_after is not None, False),
}
"""Array of a cell for each observation and target → value of a reading, and value where none is stated.

A reading without a position without load is a deflection, or is along a direction; one without a position
under load is NaN there.
"""
_STATES_GROUP: Final[Mapping[str, Callable[[Reading], bool]]] = {
    "noise_": lambda reading: reading.sigma is not None or reading.unloaded_covariance is not None,
    "direction_": lambda reading: reading.displacement is not None,
    "after_": lambda reading: reading.unloaded_after is not None,
}
"""Prefix of an optional group of arrays → whether a reading states its values."""


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
        readings = [reading for observation in observations for reading in observation.readings]
        names = list(dict.fromkeys(reading.target for reading in readings))
        _refuse_many_names(names, MAX_TARGETS, "targets")
        index = {name: t for t, name in enumerate(names)}
        rows = [i for i, observation in enumerate(observations) for _ in observation.readings]
        columns = [index[reading.target] for reading in readings]
        omitted = tuple(group for group, states in _STATES_GROUP.items() if not any(map(states, readings)))
        arrays: dict[str, Any] = {
            "labels": np.array([observation.label for observation in observations]),
            "targets": np.array(names),
        }
        for name, state in _STATED_LOADS.items():
            arrays[name] = np.array([state(observation) for observation in observations])
        for name, (read, nothing) in _STATED_READINGS.items():
            if name.startswith(omitted):
                continue
            values = [read(reading) for reading in readings]
            table = np.zeros((len(observations), len(names), *np.shape(nothing)), np.asarray(nothing).dtype)
            table[rows, columns] = [nothing if value is None else value for value in values]
            arrays[name] = table
        groups: dict[str, Any] = {
            name: group.from_archive(arrays) for name, group in _OPTIONAL_GROUPS.items() if name != "encoders"
        }
        encoders = EncoderArrays.from_observations(observations)
        made = cls(**{name: arrays[name] for name in cls._list_required_names()}, **groups, encoders=encoders)
        made._refuse_partly_stated_noise()
        return made

    def _refuse_partly_stated_noise(self) -> None:
        """Refuse readings if some of them state their noise, and others do not.

        Readings along a direction come from another instrument: their noise is checked elsewhere.

        Raises:
            MeasurementError: a reading of the tracker states no noise, but another does.
        """
        if self.noise is None:
            return
        by_tracker = self.present
        if self.directions is not None:
            by_tracker = self.present & ~self.directions.has_direction
        unstated = by_tracker & ~self.noise.stated
        if unstated.any() and (by_tracker & self.noise.stated).any():
            raise MeasurementError(
                "some readings state their own noise, but a reading of this observation states no noise",
                where=f"observations[{np.argwhere(unstated)[0, 0]}].readings",
                remedy="give every reading its `sigma` or its covariances, or give only `noise` for the set",
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
        cell = i, t
        fields: dict[str, Any] = {}
        if self.directions is not None and self.directions.has_direction[cell]:
            name = "flange_direction" if self.directions.in_flange[cell] else "direction"
            fields["displacement"] = float(self.directions.displacement[cell])
            fields[name] = _to_tuple(self.directions.vector[cell])
        elif self.as_deflection[cell]:
            fields["deflection"] = _to_tuple(self.loaded[cell])
        else:
            fields["unloaded"] = _to_tuple(self.unloaded[cell])
            if not self.unloaded_only[cell]:
                fields["loaded"] = _to_tuple(self.loaded[cell])
        if self.after is not None and self.after.present[cell]:
            fields["unloaded_after"] = _to_tuple(self.after.position[cell])
        if self.noise is not None and self.noise.sigma[cell]:
            fields["sigma"] = float(self.noise.sigma[cell])
        elif self.noise is not None and self.noise.stated[cell]:
            fields["unloaded_covariance"] = tuple(map(_to_tuple, self.noise.unloaded[cell]))
            fields["loaded_covariance"] = tuple(map(_to_tuple, self.noise.loaded[cell]))
        return Reading.model_construct(target=str(self.targets[t]), **fields)

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


def _to_tuple(vector: FloatArray) -> tuple[float, ...]:
    """Return a vector as a tuple of its numbers."""
    return tuple(vector.tolist())


def _refuse_many_names(names: Sequence[str], most: int, what: str) -> None:
    """Refuse more names than arrays may have columns: a new name for every reading would fill the memory.

    Raises:
        MeasurementError: there are more than `most`.
    """
    if len(names) > most:
        raise MeasurementError(
            f"the set has {len(names)} different {what}, more than {most}",
            where="observations",
            remedy="use the same names in every observation",
        )


def _refuse_unlike_observations(observations: Sequence[Observation]) -> None:
    """Refuse different numbers of joint angles, and labels, targets or encoders that occur twice.

    Raises:
        MeasurementError: names the first such observation.
    """
    labels = dict[str, int]()  # label → index of the first observation with it
    for i, observation in enumerate(observations):
        label, where = observation.label, f"observations[{i}]"
        first = labels.setdefault(label, i)
        if first != i:
            raise NamedObservationError(
                f"label '{label}' is already used by observations[{first}]",
                where=f"{where}.label",
                remedy="give every observation a unique label",
            )
        count, first_count = len(observation.joints), len(observations[0].joints)
        if count != first_count:
            raise NamedObservationError(
                f"observation '{label}' has {count} joint angles, but the first observation has "
                f"{first_count}",
                where=f"{where}.joints",
                remedy="give one angle for each joint of the robot in every observation",
            )
        targets = [reading.target for reading in observation.readings]
        encoders = [reading.joint for reading in observation.encoder_readings or ()]
        for noun, field, names in (
            ("target", "readings[{}].target", targets),
            ("encoder", "encoder_readings[{}].joint", encoders),
        ):
            if len(set(names)) < len(names):
                k = next(k for k, name in enumerate(names) if name in names[:k])
                raise NamedObservationError(
                    f"{noun} '{names[k]}' has two readings in observation '{label}'",
                    where=f"{where}.{field.format(k)}",
                    remedy=f"give each {noun} at most once per observation",
                )


def hash_texts(*texts: str) -> str:
    """Return the SHA-256, in hexadecimal digits, of texts that are joined by blanks."""
    return hashlib.sha256(" ".join(texts).encode()).hexdigest()
