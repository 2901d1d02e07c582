"""Readings as arrays: in the units of their set, as they are stored, and in SI units for computation."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

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
from jointstiff.service.conversion.robots import joint_factors, named_joints
from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT, to_instrument
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.mechanics.measurements import (
    ASSUMED_FORCE_SCALE,
    ASSUMED_LOAD_POINT,
    ISOTROPIC_DIFFERENCE,
    CommonUncertainty,
    DifferenceNoise,
    EncoderReadings,
    Measurements,
    position_covariances,
    refuse_no_covariance,
)
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot


@dataclass(frozen=True, eq=False)
class ArrayGroup:
    """Arrays of N observations; a subclass's fields are their names."""

    prefix: ClassVar[str]

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays by the names under which they are stored."""
        return {f"{self.prefix}{field.name}": getattr(self, field.name) for field in fields(self)}

    @classmethod
    def from_archive(cls, archive: Mapping[str, npt.NDArray[np.generic]]) -> Self | None:
        """Read them back; None for a set without."""
        names = [f"{cls.prefix}{field.name}" for field in fields(cls)]
        return cls(*(archive[name] for name in names)) if names[0] in archive else None


@dataclass(frozen=True, eq=False)
class Directions(ArrayGroup):
    """Readings along a direction of N observations of T targets; zero where a reading is of another kind."""

    prefix = "direction_"

    displacement: FloatArray  # (N, T) loaded minus unloaded, along the direction
    vector: FloatArray  # (N, T, 3) direction as posted, of any length
    in_flange: BoolArray  # (N, T) whether it was posted in the flange frame

    @classmethod
    def from_readings(
        cls, shape: tuple[int, int], place: tuple[list[int], list[int]], readings: list[Reading]
    ) -> Directions | None:
        """Arrange the readings of shape (N, T) at their observation and target; None if there are none."""
        if all(reading.displacement is None for reading in readings):
            return None
        displacement, vector, in_flange = np.zeros(shape), np.zeros((*shape, 3)), np.zeros(shape, np.bool_)
        displacement[place] = [r.displacement or 0.0 for r in readings]
        vector[place] = [r.direction or r.flange_direction or (0, 0, 0) for r in readings]
        in_flange[place] = [r.flange_direction is not None for r in readings]
        return cls(displacement, vector, in_flange)

    @property
    def present(self) -> BoolArray:
        """(N, T) which readings are along a direction."""
        return np.asarray(self.vector.any(axis=-1))

    def turned(self, R: FloatArray) -> Directions:
        """Return the same with directions that were posted outside the flange frame turned by R (3, 3)."""
        vector = np.where(self.in_flange[..., None], self.vector, self.vector @ R.T)
        return replace(self, vector=vector)

    def fields(self, i: int, t: int) -> dict[str, Any]:
        """Return what a reading posted, by the names of its fields."""
        name = "flange_direction" if self.in_flange[i, t] else "direction"
        return {"displacement": float(self.displacement[i, t]), name: tuple(self.vector[i, t].tolist())}

    def unit_vectors(self, robot: Robot, joints: FloatArray) -> FloatArray:
        """(N, T, 3) directions of length one in R0; zero for readings of another kind.

        Args:
            robot: n joints.
            joints: (N, n) controller angles [rad].
        """
        rotation = Postures(robot, robot.joint_map.model_angles(joints)).flange_rotation
        vector = np.where(self.in_flange[..., None], self.vector @ rotation.transpose(0, 2, 1), self.vector)
        length = np.linalg.norm(vector, axis=-1, keepdims=True)
        return np.asarray(vector / np.where(length > 0.0, length, 1.0))


@dataclass(frozen=True, eq=False)
class EncoderArrays(ArrayGroup):
    """N observations of up to E encoders."""

    prefix = "encoder_"

    joints: npt.NDArray[np.str_]  # (E,) names of the joints, in order of first appearance
    present: BoolArray  # (N, E) which encoders were read
    unloaded: FloatArray  # (N, E) angles before the load; zero where not read
    loaded: FloatArray  # (N, E) angles under load; zero where not read

    @classmethod
    def from_observations(cls, observations: list[Observation]) -> EncoderArrays | None:
        """Arrange the readings; None if there are none.

        Raises:
            MeasurementError: a joint is given twice in an observation, or there are too many.
        """
        names = dict.fromkeys(r.joint for o in observations for r in o.encoder_readings or ())
        if not names:
            return None
        if len(names) > MAX_JOINTS:
            raise MeasurementError(
                f"the readings name encoders of {len(names)} different joints, more than {MAX_JOINTS}",
                where="observations",
                remedy="use the robot's joint names, the same in every observation",
            )
        column = {name: e for e, name in enumerate(names)}
        present = np.zeros((len(observations), len(names)), dtype=np.bool_)
        unloaded, loaded = np.zeros((2, *present.shape))
        for i, observation in enumerate(observations):
            for k, reading in enumerate(observation.encoder_readings or ()):
                place = i, column[reading.joint]
                if present[place]:
                    raise MeasurementError(
                        f"the encoder of '{reading.joint}' has two readings in observation "
                        f"'{observation.label}'",
                        where=f"observations[{i}].encoder_readings[{k}].joint",
                        remedy="give each joint at most once per observation",
                    )
                present[place] = True
                unloaded[place], loaded[place] = reading.unloaded, reading.loaded
        return cls(np.array(list(names)), present, unloaded, loaded)

    def readings(self, i: int) -> list[EncoderReading] | None:
        """Return those of one observation as they were posted, by `joints`; None if there are none."""
        readings = [
            EncoderReading.model_construct(
                joint=str(self.joints[e]),
                unloaded=float(self.unloaded[i, e]),
                loaded=float(self.loaded[i, e]),
            )
            for e in np.flatnonzero(self.present[i])
        ]
        return readings or None

    def columns(self, joint_names: tuple[str, ...]) -> IndexArray:
        """Return (E,) the robot's joint of each encoder.

        Raises:
            MeasurementError: the robot has no such joint.
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
class PointNoise(ArrayGroup):
    """Noise stated by N observations of T targets; zero where a reading states the other kind or none."""

    prefix = "noise_"

    sigma: FloatArray  # (N, T)
    unloaded: FloatArray  # (N, T, 3, 3) covariance before the load
    loaded: FloatArray  # (N, T, 3, 3) under load

    @classmethod
    def from_readings(
        cls, shape: tuple[int, int], place: tuple[list[int], list[int]], readings: list[Reading]
    ) -> PointNoise | None:
        """Arrange what the readings state; None if none states anything.

        Args:
            shape: N and T.
            place: observation and target of each reading.
            readings: all of the set.

        Raises:
            MeasurementError: some readings of the tracker state their noise, and others do not.
        """
        stated = [r.sigma is not None or r.unloaded_covariance is not None for r in readings]
        if not any(stated):
            return None
        tracker = [i for i, r in enumerate(readings) if r.displacement is None]
        _refuse_gaps([stated[i] for i in tracker], [place[0][i] for i in tracker])
        sigma, unloaded, loaded = np.zeros(shape), np.zeros((*shape, 3, 3)), np.zeros((*shape, 3, 3))
        for i, t, reading in zip(*place, readings, strict=True):
            if reading.sigma is not None:
                sigma[i, t] = reading.sigma
            elif reading.unloaded_covariance is not None:
                unloaded[i, t], loaded[i, t] = reading.unloaded_covariance, reading.loaded_covariance
        return cls(sigma, unloaded, loaded)

    def fields(self, i: int, t: int) -> dict[str, Any]:
        """Return what a reading stated, by the names of its fields."""
        if self.sigma[i, t]:
            return {"sigma": float(self.sigma[i, t])}
        if not self.unloaded[i, t].any():
            return {}
        return {
            "unloaded_covariance": _rows(self.unloaded[i, t]),
            "loaded_covariance": _rows(self.loaded[i, t]),
        }

    @property
    def stated(self) -> BoolArray:
        """(N, T) True where the noise of a reading is stated: a sigma, or covariances."""
        return np.asarray((self.sigma > 0.0) | self.unloaded.any(axis=(2, 3)))

    def covariances(self) -> tuple[FloatArray, FloatArray]:
        """Return covariances (N, T, 3, 3) of unloaded and loaded positions, unit of length squared."""
        isotropic = (self.sigma**2)[..., None, None] * np.eye(3)
        return self.unloaded + isotropic, self.loaded + isotropic


def _rows(matrix: FloatArray) -> Matrix3:
    x, y, z = (tuple(row) for row in matrix.tolist())
    return x, y, z


def _refuse_gaps(stated: list[bool], observations: list[int]) -> None:
    if len(set(stated)) < 2:
        return
    i = observations[stated.index(False)]
    raise MeasurementError(
        "some readings give their own noise, but one of this observation gives none",
        where=f"observations[{i}].readings",
        remedy="give every reading its `sigma` or its covariances, or none and `noise` for the set",
    )


def to_noise(
    noise: Noise | None, points: PointNoise | None, robot: Robot, plain: Measurements, *, length: float
) -> tuple[float | None, FloatArray]:
    """Return sigma [m], None where nothing is stated, and the deflections' covariance in units of sigma².

    Args:
        noise: of the set.
        points: what its readings state of their own.
        robot: n joints.
        plain: the readings, without noise.
        length: metres in the set's unit of length.

    Raises:
        MeasurementError: two kinds of noise, or one that is none.
    """
    present = plain.present
    own = np.zeros_like(present) if points is None else points.stated
    _refuse_unclear(noise, own, plain)
    instrument = (
        None if noise is None or noise.instrument is None else to_instrument(noise.instrument, length)
    )
    sigma = None if noise is None or noise.sigma is None else length * noise.sigma
    if points is None and instrument is None:
        return sigma, ISOTROPIC_DIFFERENCE
    of_set = ((sigma or 0.0) ** 2 * np.eye(3),) * 2
    unloaded, loaded = of_set if instrument is None else position_covariances(instrument, robot, plain)
    if points is not None:
        parts = points.covariances()
        refuse_no_covariance(parts[0], own, "unloaded_covariance")
        refuse_no_covariance(parts[1], own, "loaded_covariance")
        unloaded, loaded = (
            np.where(own[..., None, None], length**2 * part, other)
            for part, other in zip(parts, (unloaded, loaded), strict=True)
        )
    stated = DifferenceNoise.of(unloaded, loaded, plain.coordinates)
    return stated.sigma, stated.covariance


def _refuse_unclear(noise: Noise | None, own: BoolArray, plain: Measurements) -> None:
    """Refuse noise that is stated twice, or of some readings only.

    Args:
        noise: of the set; it belongs to the readings that state none.
        own: (N, T) readings that state their own.
        plain: the readings.
    """
    rest = plain.present & ~own
    kind = next((k for k in ("sigma", "instrument") if getattr(noise, k, None) is not None), None)
    if kind is not None and not rest.any():
        raise MeasurementError(
            f"both the readings and noise.{kind} give the noise",
            where=f"noise.{kind}",
            remedy="give only one: omit it here, or in every reading",
        )
    unclear = rest & (plain.coordinates == 1) if kind == "instrument" else rest & (kind is None and own.any())
    if unclear.any():
        i = int(np.argwhere(unclear)[0, 0])
        raise MeasurementError(
            "the noise of a reading is not given: that of the others does not apply to it",
            where=f"observations[{i}].readings",
            remedy="give the reading its `sigma`, or `noise.sigma` for all that state none",
        )


def to_common_uncertainty(noise: Noise | None, length: float) -> CommonUncertainty:
    """Return the uncertainty of what all observations share.

    What is not stated of the load point and of the forces' scale is assumed.

    Args:
        noise: of the set.
        length: metres in the set's unit of length.
    """
    assumed = CommonUncertainty(
        scale=ASSUMED_FORCE_SCALE,
        load_point=ASSUMED_LOAD_POINT,
        assumed=frozenset({"force_scale", "load_point"}),
    )
    if noise is None:
        return assumed
    force, axes = noise.force, noise.axes
    if force is not None:
        assumed = replace(assumed, direction=force.direction)
    if force is not None and force.scale is not None:
        assumed = replace(assumed, scale=force.scale, assumed=assumed.assumed - {"force_scale"})
    if noise.load_point is not None:
        place = length * noise.load_point
        assumed = replace(assumed, load_point=place, assumed=assumed.assumed - {"load_point"})
    return replace(
        assumed,
        target_places=length * (noise.target_places or 0.0),
        axis_position=0.0 if axes is None else length * axes.position,
        axis_direction=0.0 if axes is None else axes.direction,
    )


_GROUPS: dict[str, type[ArrayGroup]] = {
    "encoders": EncoderArrays,
    "noise": PointNoise,
    "directions": Directions,
}
_UNREAD = (np.nan, np.nan, np.nan)


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
    encoders: EncoderArrays | None = None  # what secondary encoders read; None if there are none
    noise: PointNoise | None = None  # what readings state of their own; None if they do not
    directions: Directions | None = None  # readings along a direction; None if there are none

    @classmethod
    def from_observations(cls, observations: list[Observation]) -> ReadingArrays:
        """Arrange the observations.

        Raises:
            MeasurementError: joints of different lengths, a label, a target or an encoder given twice,
                too many different targets or encoders, noise stated of some readings only.
        """
        _refuse_unlike_observations(observations)
        names = dict.fromkeys(r.target for o in observations for r in o.readings)
        _refuse_crowd(names)
        column = {name: i for i, name in enumerate(names)}
        rows, columns, readings = _flatten(observations, column)
        shape = (len(observations), len(names))
        place = rows, columns
        return cls(
            labels=np.array([o.label for o in observations]),
            targets=np.array(list(names)),
            joints=np.array([o.joints for o in observations], dtype=np.float64),
            force=np.array([o.force for o in observations], dtype=np.float64),
            moment=np.array([o.moment or (0, 0, 0) for o in observations], dtype=np.float64),
            moment_given=np.array([o.moment is not None for o in observations]),
            load_point=np.array([o.load_point or (0, 0, 0) for o in observations], np.float64),
            load_point_given=np.array([o.load_point is not None for o in observations]),
            present=_scatter(shape, place, [True for _ in readings], np.bool_),
            as_deflection=_scatter(shape, place, [r.unloaded is None for r in readings], np.bool_),
            unloaded=_scatter((*shape, 3), place, [r.unloaded or (0, 0, 0) for r in readings], np.float64),
            loaded=_scatter(
                (*shape, 3),
                place,
                [r.loaded or r.deflection or (_UNREAD if r.unloaded else (0, 0, 0)) for r in readings],
                np.float64,
            ),
            encoders=EncoderArrays.from_observations(observations),
            noise=PointNoise.from_readings(shape, place, readings),
            directions=Directions.from_readings(shape, place, readings),
        )

    @property
    def unloaded_only(self) -> BoolArray:
        """(N, T) readings that are positions without a load, and nothing else."""
        return np.isnan(self.loaded[..., 0])

    def observations(self) -> list[Observation]:
        """Return the observations as they were posted, readings in the order of `targets`."""
        # The numbers were validated when they came in; validating 10,000 again is the cost of a run.
        return [
            Observation.model_construct(
                label=str(self.labels[i]),
                joints=self.joints[i].tolist(),
                force=tuple(self.force[i].tolist()),
                moment=tuple(self.moment[i].tolist()) if self.moment_given[i] else None,
                load_point=tuple(self.load_point[i].tolist()) if self.load_point_given[i] else None,
                readings=[self._reading(i, int(t)) for t in np.flatnonzero(self.present[i])],
                encoder_readings=self.encoders.readings(i) if self.encoders else None,
            )
            for i in range(len(self.labels))
        ]

    def _reading(self, i: int, t: int) -> Reading:
        loaded = tuple(self.loaded[i, t].tolist())
        noise = self.noise.fields(i, t) if self.noise else {}
        if self.directions is not None and self.directions.present[i, t]:
            noise |= self.directions.fields(i, t)
            return Reading.model_construct(target=str(self.targets[t]), **noise)
        if self.as_deflection[i, t]:
            return Reading.model_construct(target=str(self.targets[t]), deflection=loaded, **noise)
        unloaded = tuple(self.unloaded[i, t].tolist())
        if self.unloaded_only[i, t]:
            return Reading.model_construct(target=str(self.targets[t]), unloaded=unloaded, **noise)
        return Reading.model_construct(target=str(self.targets[t]), unloaded=unloaded, loaded=loaded, **noise)

    def pack(self) -> bytes:
        """Serialise as npz, without pickles."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **self._arrays())
        return buffer.getvalue()

    @classmethod
    def unpack(cls, blob: bytes) -> ReadingArrays:
        """Read what `pack` wrote."""
        with np.load(io.BytesIO(blob), allow_pickle=False) as archive:
            arrays: dict[str, Any] = {name: archive[name] for name in cls._always()}
            arrays |= {name: group.from_archive(archive) for name, group in _GROUPS.items()}
            return cls(**arrays)

    @classmethod
    def _always(cls) -> list[str]:
        """Return names of the arrays that every set has."""
        return [field.name for field in fields(cls) if field.name not in _GROUPS]

    def _arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays by name; of the groups only those that there are."""
        arrays = {name: getattr(self, name) for name in self._always()}
        groups = (getattr(self, name) for name in _GROUPS)
        return arrays | {name: array for group in groups if group for name, array in group.arrays().items()}

    def digest(self) -> bytes:
        """Return SHA-256 of names, types, shapes and contents."""
        digest = hashlib.sha256()
        for name, array in self._arrays().items():
            digest.update(f"{name} {array.dtype.str} {array.shape};".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.digest()


def content_hash(
    header: MeasurementSetHeader, readings: ReadingArrays, resolved: ResolvedFrame | None = None
) -> str:
    """Return SHA-256 of a set's header, its readings and what its frame means, not its name."""
    refuted = header.noise is not None and header.noise.refuted
    text = header.model_dump_json(
        include={"units", "encoders", "noise", "flange_targets", "load_point"},
        exclude=None if refuted else {"noise": {"refuted"}},  # sets were hashed before there was this field
    )
    if header.frame is not None and resolved is not None:
        text += f"{header.frame.forces} {resolved.model_dump_json()}"
    return hashlib.sha256(text.encode() + readings.digest()).hexdigest()


def _flatten(
    observations: list[Observation], column: dict[str, int]
) -> tuple[list[int], list[int], list[Reading]]:
    rows, columns, readings = [], [], []
    seen = set[tuple[int, int]]()
    for i, observation in enumerate(observations):
        for k, reading in enumerate(observation.readings):
            place = i, column[reading.target]
            if place in seen:
                raise MeasurementError(
                    f"target '{reading.target}' has two readings in observation '{observation.label}'",
                    where=f"observations[{i}].readings[{k}].target",
                    remedy="give each target at most once per observation, or rename it",
                )
            seen.add(place)
            rows.append(place[0])
            columns.append(place[1])
            readings.append(reading)
    return rows, columns, readings


def _scatter(
    shape: tuple[int, ...], place: tuple[list[int], list[int]], values: list[Any], kind: type[np.generic]
) -> npt.NDArray[Any]:
    out = np.zeros(shape, dtype=kind)
    out[place] = values
    return out


def _refuse_crowd(names: Collection[str]) -> None:
    """Refuse a name of its own for every reading: arrays are dense, and would take its square in memory."""
    if len(names) > MAX_TARGETS:
        raise MeasurementError(
            f"the set has {len(names)} different targets, more than {MAX_TARGETS}",
            where="observations",
            remedy="use the same name for the same target in every observation",
        )


def _refuse_unlike_observations(observations: list[Observation]) -> None:
    """Refuse observations of different numbers of joints, or of one label."""
    length = len(observations[0].joints)
    first = dict[str, int]()
    for i, observation in enumerate(observations):
        if len(observation.joints) != length:
            raise MeasurementError(
                f"observation '{observation.label}' has {len(observation.joints)} joint angles, the first "
                f"one {length}",
                where=f"observations[{i}].joints",
                remedy="give one angle for each joint of the robot in every observation",
            )
        if first.setdefault(observation.label, i) != i:
            raise MeasurementError(
                f"label '{observation.label}' is already used by observations[{first[observation.label]}]",
                where=f"observations[{i}].label",
                remedy="give every observation a unique label",
            )


def has_loads(blob: bytes) -> bool:
    """Return whether any of the readings that `ReadingArrays.pack` wrote was read under a load."""
    with np.load(io.BytesIO(blob), allow_pickle=False) as archive:
        return bool((archive["present"] & ~np.isnan(archive["loaded"][..., 0])).any())


def hash_of(*texts: str) -> str:
    """Return the SHA-256 of some texts, separated by blanks."""
    return hashlib.sha256(" ".join(texts).encode()).hexdigest()


def to_measurements(header: MeasurementSetHeader, readings: ReadingArrays, robot: Robot) -> Measurements:
    """Bring a set to SI units and check that it is complete.

    Raises:
        MeasurementError: with the place and the remedy.
    """
    if readings.joints.shape[1] != robot.n:
        raise MeasurementError(
            f"there are {readings.joints.shape[1]} joint angles, but the robot has {robot.n} joints",
            where="observations[0].joints",
            remedy=f"give the {robot.n} controller angles of {named_joints(robot)}",
        )
    if header.joint_kinds is not None and tuple(header.joint_kinds) != robot.joint_kinds:
        stated = zip(robot.joint_names, robot.joint_kinds, header.joint_kinds, strict=False)
        name, own = next(((name, own) for name, own, given in stated if own != given), ("", None))
        units = JOINT_UNITS[own or "revolute"]
        raise MeasurementError(
            f"joint {name} is read as {'an angle' if units.dimension == 'length' else 'a length'}, but the "
            f"robot's is {own}",
            where="joint_kinds",
            remedy=f"give its {units.dimension}s, in `units.{units.dimension}`, or check the robot and the "
            "order of the joints",
        )
    length, unloaded_only = LENGTH[header.units.length], readings.unloaded_only
    deflection = np.where(
        readings.as_deflection[..., None], readings.loaded, readings.loaded - readings.unloaded
    )
    deflection = np.where(unloaded_only[..., None], 0.0, deflection)
    joints = joint_factors(robot, header.units) * readings.joints
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
        unloaded_only=unloaded_only if unloaded_only.any() else None,
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
        present=readings.present & ~unloaded_only,
    )


def _encoder_readings(
    header: MeasurementSetHeader, encoders: EncoderArrays | None, robot: Robot
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
    if robot.prismatic[columns].any():
        name = robot.joint_names[columns[int(np.argmax(robot.prismatic[columns]))]]
        raise MeasurementError(
            f"there are encoder readings of {name}, a prismatic joint",
            where="observations",
            remedy="omit them: secondary encoders are read of revolute joints only",
        )
    deflection = np.zeros((len(encoders.present), robot.n))
    present = np.zeros(deflection.shape, dtype=np.bool_)
    deflection[:, columns] = angle * (encoders.loaded - encoders.unloaded)
    present[:, columns] = encoders.present
    return EncoderReadings(deflection, present, angle * header.noise.encoder_sigma)


def _moment_factor(units: Units, readings: ReadingArrays) -> float:
    """Return N·m in the unit of moments, to be stated where the others do not imply it."""
    if units.moment is not None:
        return MOMENT[units.moment]
    if units.length == "m" or not readings.moment.any():
        return FORCE[units.force]
    first = int(np.flatnonzero(readings.moment.any(axis=1))[0])
    raise MeasurementError(
        f"observation '{readings.labels[first]}' has a moment, whose unit is ambiguous when lengths are in "
        "mm",
        where="units.moment",
        remedy=f"give `units.moment`, one of {', '.join(MOMENT)}",
    )


def _load_points(header: MeasurementSetHeader, readings: ReadingArrays) -> FloatArray:
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


def _positions(header: MeasurementSetHeader, readings: ReadingArrays) -> FloatArray:
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
