"""The observations of a set as arrays: how they are stored, exactly as they were posted.

Numbers keep the units of the set, so that what comes back is what was sent, bit for bit.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Collection
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from jointstiff.schemas.measurement import (
    MAX_TARGETS,
    MeasurementSetHeader,
    Observation,
    Reading,
    ResolvedFrame,
)
from jointstiff.service.conversion.array_group import ArrayGroup
from jointstiff.service.conversion.directions import Directions
from jointstiff.service.conversion.encoders import EncoderArrays
from jointstiff.service.conversion.point_noise import PointNoise
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import MeasurementError

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
        _refuse_ragged(observations)
        _refuse_duplicate_labels(observations)
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
    """Return SHA-256 of a set's header, its readings and what its frame stands for, not its name."""
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


def _refuse_ragged(observations: list[Observation]) -> None:
    length = len(observations[0].joints)
    for i, observation in enumerate(observations):
        if len(observation.joints) != length:
            raise MeasurementError(
                f"the observation has {len(observation.joints)} joint angles, the first one {length}",
                where=f"observations[{i}].joints",
                remedy="give one angle for each joint of the robot in every observation",
            )


def _refuse_duplicate_labels(observations: list[Observation]) -> None:
    first: dict[str, int] = {}
    for i, observation in enumerate(observations):
        if first.setdefault(observation.label, i) != i:
            raise MeasurementError(
                f"label '{observation.label}' is already used by observations[{first[observation.label]}]",
                where=f"observations[{i}].label",
                remedy="give every observation a unique label",
            )


def hash_of(*texts: str) -> str:
    """Return the SHA-256 of some texts, separated by blanks."""
    return hashlib.sha256(" ".join(texts).encode()).hexdigest()
