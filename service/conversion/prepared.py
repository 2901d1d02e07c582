"""Preparation of robots and measurement sets for computation; transformation of readings to R0."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from math import degrees, radians
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal, TypeVar

import numpy as np
import pinocchio as pin

from jointstiff.schemas.fields import Vector3
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.measurement import (
    Frame,
    MeasurementSetDocument,
    MeasurementSetHeader,
    Observation,
    ResolvedFrame,
    Rigid,
)
from jointstiff.schemas.robot import CatalogueModel, DhModel, DhRow, GeometryModel, RobotDocument, UrdfModel
from jointstiff.schemas.run import RunRequest
from jointstiff.service.conversion.catalogue import find_arm
from jointstiff.service.conversion.measurements import to_measurements
from jointstiff.service.conversion.readings import (
    NamedObservationError,
    ReadingArrays,
    compute_content_hash,
    hash_texts,
)
from jointstiff.service.conversion.robots import build_chain_robot, build_dh_chain, to_bodies
from jointstiff.service.conversion.units import ANGLE, LENGTH, to_instrument
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import MeasurementError, RequestError, RobotError
from jointstiff.solver.integrity import inspect_measurements, inspect_unloaded
from jointstiff.solver.integrity.values import InstrumentFrame
from jointstiff.solver.mechanics.chain import KinematicChain
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import KnownRobot, Robot
from jointstiff.solver.mechanics.urdf import read_inertials, read_urdf, write_urdf
from jointstiff.solver.messages import to_rigid

if TYPE_CHECKING:
    from jointstiff.schemas.geometry import GeometryRequest
    from jointstiff.solver.geometry.frames import BaseTargets

Header = TypeVar("Header", bound=MeasurementSetHeader)


def read_stated_transform(frame: Frame, length: float) -> pin.SE3:
    """Return the transform from tracker to R0 [m] that a frame states, with its rotation made orthonormal.

    Args:
        frame: frame with a rotation and a translation.
        length: the set's unit of length in m.

    Raises:
        MeasurementError: the matrix is not a rotation.
    """
    from jointstiff.solver.geometry import poses

    return poses.orthonormalise_transform(
        np.array(frame.rotation, dtype=np.float64), length * np.array(frame.translation, dtype=np.float64)
    )


def to_resolved_frame(transform: pin.SE3, flange_targets: dict[str, Vector3] | None = None) -> ResolvedFrame:
    """Return a transform from tracker to R0 [m], with the set's flange targets, as a frame to be stored."""
    rigid = to_rigid(transform)
    return ResolvedFrame(
        rotation=rigid.rotation, translation=rigid.translation, flange_targets=flange_targets or {}
    )


def frame_fields(resolved: ResolvedFrame | None) -> dict[str, Any]:
    """Return the resolved frame and the flange targets as fields of a stored set; empty without a frame."""
    if resolved is None:
        return {}
    frame = Rigid(rotation=resolved.rotation, translation=resolved.translation)
    return {"resolved_frame": frame, "geometry_targets": resolved.flange_targets}


def transform_to_base(
    header: Header, readings: ReadingArrays, resolved: ResolvedFrame | None
) -> tuple[Header, ReadingArrays]:
    """Transform a set from the tracker's frame to R0; return its header and readings, in the set's units.

    Positions are rotated and translated; deflections, covariances and, if the frame says so, forces are
    rotated. The uncertainty of the transform is neglected: an error of 100 µrad changes a deflection of 1 mm
    by 0.1 µm, and a lever of 2 m by 0.2 mm.

    Args:
        header: header of the set.
        readings: readings as they were posted.
        resolved: transform of the header's frame; None if all readings are in R0 already.
    """
    if resolved is None or header.frame is None:
        return header, readings
    length = LENGTH[header.units.length]
    R, t = np.array(resolved.rotation), np.array(resolved.translation) / length
    was_read = readings.present[..., None]
    is_deflection = readings.as_deflection[..., None]
    unloaded, loaded = readings.unloaded, readings.loaded
    noise, after = readings.noise, readings.after
    if noise is not None:
        turned = [R @ covariance @ R.T for covariance in (noise.unloaded, noise.loaded)]
        # Rounding of the products leaves the two triangles unequal in the last digit.
        turned = [0.5 * (covariance + np.swapaxes(covariance, -1, -2)) for covariance in turned]
        noise = replace(noise, unloaded=turned[0], loaded=turned[1])
    if after is not None:
        after = replace(after, position=np.where(after.present[..., None], after.position @ R.T + t, 0.0))
    force_rotation = R if header.frame.forces == "tracker" else np.eye(3)
    transformed = replace(
        readings,
        unloaded=np.where(was_read & ~is_deflection, unloaded @ R.T + t, unloaded),
        loaded=np.where(was_read, loaded @ R.T + np.where(is_deflection, 0.0, t), loaded),
        noise=noise,
        directions=None if readings.directions is None else readings.directions.rotate(R),
        after=after,
        force=readings.force @ force_rotation.T,
        moment=readings.moment @ force_rotation.T,
    )
    # Targets that the header states replace those of the identified geometry.
    identified = {
        name: _to_vector(1.0 / length * np.array(place)) for name, place in resolved.flange_targets.items()
    }
    changes: dict[str, Any] = {"flange_targets": identified | header.flange_targets}
    if header.noise is not None and header.noise.instrument is not None:
        station = _to_vector(R @ np.array(header.noise.instrument.station) + t)
        instrument = header.noise.instrument.model_copy(update={"station": station})
        changes["noise"] = header.noise.model_copy(update={"instrument": instrument})
    return header.model_copy(update=changes), transformed


def _to_vector(vector: FloatArray) -> Vector3:
    """Return a vector of three coordinates as a tuple."""
    x, y, z = vector.tolist()
    return x, y, z


def to_base_targets(
    request: GeometryRequest, sigma: float | None, after: dict[str, tuple[float, float, float]] | None = None
) -> BaseTargets | None:
    """Return the targets on the base that were read both before and after the other readings.

    The result is None if earlier or later readings of base targets are missing.

    Args:
        request: request with the earlier readings.
        sigma: standard uncertainty that scales the covariances [m]; None if no noise is stated.
        after: later readings by target, in the request's unit of length; None takes those of the request.

    Raises:
        MeasurementError: fewer than three targets were read both times.
    """
    from jointstiff.solver.geometry.frames import BaseTargets

    before = request.base_targets_before
    where = "base_targets_after" if after is None else "frame.base_targets"
    later = request.base_targets_after if after is None else after
    if before is None or later is None:
        return None
    common = [name for name in before if name in later]
    if len(common) < 3:  # too few to show how the tracker moved
        raise MeasurementError(
            f"only {len(common)} base targets were read both before and after; at least three are needed",
            where=where,
            remedy="read at least three base targets before and after, with the same names",
        )
    length = LENGTH[request.units.length]
    first = length * np.array([before[name] for name in common])
    second = length * np.array([later[name] for name in common])
    covariance = np.eye(3)
    if sigma is not None and request.noise is not None and request.noise.instrument is not None:
        covariance = to_instrument(request.noise.instrument, length).covariance(first) / sigma**2
    return BaseTargets(first, second, covariance, tuple(common), where)


@dataclass(frozen=True, eq=False)
class PreparedRobot:
    """A robot ready for computation."""

    document: RobotDocument  # the robot as it was understood
    robot: Robot  # the robot
    content_hash: str  # SHA-256 of kinematics and joint map, not of the name


@dataclass(frozen=True, eq=False)
class PreparedSet:
    """A measurement set that was checked and is ready for computation in any number of runs."""

    robot: Robot  # the robot that was measured
    robot_id: str  # id of the stored robot
    robot_hash: str  # hash of the robot's content
    readings: ReadingArrays  # the readings as they are stored, in the units of the set
    measurements: Measurements  # the readings in SI units
    warnings: list[Finding]  # findings of the check of the set
    content_hash: str  # SHA-256 of readings, units and frame, not of the name

    @property
    def content(self) -> str:
        """Hash (SHA-256) of robot and readings together, in hexadecimal digits."""
        return hash_texts(self.robot_hash, self.content_hash)

    def number_as_in(self, observations: Sequence[Observation]) -> PreparedSet:
        """Return a copy whose observations have their numbers in the order of the whole set."""
        numbers = {observation.label: float(number) for number, observation in enumerate(observations)}
        order = np.array([numbers[label] for label in self.measurements.labels])
        return replace(self, measurements=replace(self.measurements, order=order))

    def run_hash(self, request: RunRequest) -> str:
        """Return the SHA-256 of all on which the result of a run depends: equal runs have equal hashes.

        The bodies of the robot count only if the run fits own weight. A robot without a payload has no text
        for the payload, so that hashes of such runs are those from before robots had payloads.
        """
        options = request.model_dump_json(exclude={"measurement_set_id", "leave_out", "variant_of"})
        fits_own_weight = request.weight is not None
        texts = [self.content, options, repr(self.robot.bodies) if fits_own_weight else ""]
        if self.robot.payload is not None:
            texts.append(repr(self.robot.payload))
        return hash_texts(*texts)


def prepare_robot(document: RobotDocument) -> PreparedRobot:
    """Check the document of a robot, and build the robot.

    An arm of the catalogue is replaced by its DH table, a URDF by its chain from base to flange.

    Raises:
        RobotError: the description cannot be used, or the catalogue has no such arm.
    """
    model = document.model
    if isinstance(model, GeometryModel):
        raise RobotError(
            f"the stored geometry '{model.geometry_id}' can be used only in the service that stores the "
            "geometry",
            where="model.geometry_id",
            remedy="store the robot in a service, and give its `robot_id`",
        )
    if isinstance(model, CatalogueModel):
        document = _replace_arm_by_table(document, model.arm)
    if isinstance(document.model, UrdfModel):
        return _prepare_urdf_robot(document, document.model)
    if isinstance(document.model, DhModel):
        document = document.model_copy(update={"model": _to_si_table(document.model)})
    robot = build_robot(document)
    return PreparedRobot(document, robot, _hash_robot(document, robot))


def _replace_arm_by_table(document: RobotDocument, name: str) -> RobotDocument:
    """Return the document with the model of a catalogue arm; joint map and payload as stated, else the arm's.

    Raises:
        RobotError: the catalogue has no arm of this name.
    """
    try:
        arm = find_arm(name, "model.arm")
    except RequestError as error:
        raise RobotError(error.reason, remedy=error.remedy, where=error.where) from error
    joint_map = document.joint_map or arm.joint_map
    payload = arm.payload if document.payload is None else document.payload
    return document.model_copy(update={"model": arm.model, "joint_map": joint_map, "payload": payload})


def _prepare_urdf_robot(document: RobotDocument, model: UrdfModel) -> PreparedRobot:
    """Return the robot of a URDF, with its chain from base to flange and, if none are stated, its bodies.

    Raises:
        RobotError: the URDF cannot be used.
    """
    chain = _read_uploaded_urdf(model)
    bodies = document.bodies or to_bodies(read_inertials(model.urdf, chain), chain)
    with_chain = model.model_copy(update={"urdf": write_urdf(chain)})
    document = document.model_copy(update={"model": with_chain, "bodies": bodies})
    robot = build_robot(document)
    without_speeds = model.model_copy(update={"urdf": write_urdf(chain.without_speeds())})
    hashed = document.model_copy(update={"model": without_speeds})
    return PreparedRobot(document, robot, _hash_robot(hashed, robot))


def _hash_robot(document: RobotDocument, robot: Robot) -> str:
    """Return the SHA-256 of kinematics and joint map, by the document of a robot in m and rad.

    Speeds of joints change no identification: the hash has none. Robots were hashed before joints had kinds:
    without prismatic joints, the hash has to stay what it was.
    """
    of_rows = {"speed"} if robot.prismatic.any() else {"kind", "speed"}
    of_model: dict[str, Any] = {"length_unit": True, "angle_unit": True, "rows": {"__all__": of_rows}}
    excluded: dict[str, Any] = {"name": True, "bodies": True, "payload": True, "model": of_model}
    return hash_texts(document.model_dump_json(exclude=excluded))


def _to_si_table(model: DhModel) -> DhModel:
    """Return a Denavit-Hartenberg table in m and rad; its units say in which ones its numbers are."""
    length, angle = LENGTH[model.length_unit], ANGLE[model.angle_unit]
    if length == angle == 1.0:
        return model
    rows = [_scale_row(row, length, angle) for row in model.rows]
    return model.model_copy(update={"rows": rows, "length_unit": "m", "angle_unit": "rad"})


def _scale_row(row: DhRow, length: float, angle: float) -> DhRow:
    """Return a row of a Denavit-Hartenberg table in m and rad; numbers that are not stated stay absent.

    `length` and `angle` are the sizes of the table's units [m, rad]. Limits and speed of a joint are lengths
    if the joint slides, otherwise angles.
    """
    position = length if row.kind == "prismatic" else angle
    lengths = dict.fromkeys(("a", "d"), length)
    angles = dict.fromkeys(("alpha", "theta"), angle)
    positions = dict.fromkeys(("lower", "upper", "speed"), position)
    scaled = {}
    for name, factor in {**lengths, **angles, **positions}.items():
        number = getattr(row, name)
        if number is not None:
            scaled[name] = factor * number
    return row.model_copy(update=scaled)


def build_robot(document: RobotDocument) -> Robot:
    """Build the robot of a document that `prepare_robot` returned.

    Raises:
        RobotError: the description cannot be used.
        TypeError: the document did not come from `prepare_robot`.
    """
    robot = _build_stated_robot(document)
    robot.list_misreadings = partial(_list_misreadings, document)
    return robot


def _build_stated_robot(document: RobotDocument) -> Robot:
    """Build the robot of such a document as the document states it; raise the same errors."""
    model = document.model
    if isinstance(model, DhModel):
        chain = build_dh_chain(model, document.name)
    elif not isinstance(model, UrdfModel):
        raise TypeError("the document of the robot does not come from `prepare_robot`")
    else:
        chain = read_urdf(model.urdf, model.base, model.flange)
    return build_chain_robot(chain, document.joint_map, document.bodies or (), document.payload)


def _list_misreadings(document: RobotDocument) -> Iterator[KnownRobot]:
    """Yield the robots that a mistaken Denavit-Hartenberg table means; nothing without a table.

    The table may be in the other convention, or have exchanged columns or reversed signs.

    Args:
        document: the robot as `prepare_robot` returned it.
    """
    model = document.model
    if not isinstance(model, DhModel):
        return
    convention: Literal["standard", "modified"] = "modified" if model.convention == "standard" else "standard"
    other = model.model_copy(update={"convention": convention})
    remedy = f"set `convention` of the Denavit-Hartenberg table to `{convention}`, and give the robot again"
    yield from _name_misreading(document, other, f"in the convention {convention}", remedy)
    for unit, factor in _OTHER_ANGLES.items():
        rows = [_scale_row(row, 1.0, factor) for row in model.rows]
        remedy = f"set `angle_unit` of the Denavit-Hartenberg table to `{unit}`, and give the robot again"
        in_unit = model.model_copy(update={"rows": rows})
        yield from _name_misreading(document, in_unit, f"with all angles in {unit}", remedy)
    for read_as, signs, words in _MISREAD_COLUMNS:
        rows = [
            row.model_copy(update={name: sign * getattr(row, read_as[name]) for name, sign in signs.items()})
            for row in model.rows
        ]
        remedy = f"correct the Denavit-Hartenberg table, {words}, and give the robot again"
        yield from _name_misreading(document, model.model_copy(update={"rows": rows}), words, remedy)
    for rows, words in _list_other_rows(model.rows):
        remedy = f"correct the Denavit-Hartenberg table, {words}, and give the robot again"
        yield from _name_misreading(document, model.model_copy(update={"rows": rows}), words, remedy)


def _list_other_rows(rows: list[DhRow]) -> Iterator[tuple[list[DhRow], str]]:
    """Yield other rows that a table may mean, each with the correction in words."""
    yield rows[::-1], "with the rows in reverse order"
    for i, j in combinations(range(len(rows)), 2):
        exchanged = [*rows]
        exchanged[i], exchanged[j] = rows[j], rows[i]
        yield exchanged, f"with the rows {i + 1} and {j + 1} exchanged"
    for name, other in (("alpha", "theta"), ("theta", "alpha")):
        if not any(getattr(row, other) for row in rows):
            continue  # then `name` has all angles of the table
        for unit, factor in _OTHER_ANGLES.items():
            in_unit = [row.model_copy(update={name: factor * getattr(row, name)}) for row in rows]
            yield in_unit, f"with {name} in {unit}"


_OTHER_ANGLES: Final = MappingProxyType({"rad": degrees(1.0), "deg": radians(1.0)})
"""True unit of a table's angles, and factor that corrects them if the other unit was stated."""
_MISREAD_COLUMNS: Final = (
    ({"a": "d", "d": "a"}, {"a": 1.0, "d": 1.0}, "with the columns a and d exchanged"),
    (
        {"alpha": "theta", "theta": "alpha"},
        {"alpha": 1.0, "theta": 1.0},
        "with the columns alpha and theta exchanged",
    ),
    ({"alpha": "alpha"}, {"alpha": -1.0}, "with the opposite signs of alpha"),
    ({"a": "a"}, {"a": -1.0}, "with the opposite signs of a"),
    ({"d": "d"}, {"d": -1.0}, "with the opposite signs of d"),
    ({"theta": "theta"}, {"theta": -1.0}, "with the opposite signs of theta"),
)
"""Columns of a mistaken table: where each column was written, with which sign, and the words for it."""


def _name_misreading(
    document: RobotDocument, model: DhModel, words: str, remedy: str
) -> Iterator[KnownRobot]:
    """Yield the robot of a corrected table, named by the correction; nothing if no arm has such a table."""
    other = document.model_copy(update={"model": model})
    with suppress(RobotError):
        yield KnownRobot(f"{document.name} {words}", _build_stated_robot(other), remedy=remedy)


def check_set(
    document: MeasurementSetDocument,
    robot: Robot,
    resolved: ResolvedFrame | None,
    frame_findings: list[Finding],
    others: Iterable[KnownRobot] = (),
    *,
    flange_fields: Sequence[str] = (),
    header_units: Collection[str] = (),
    robot_id: str = "",
    robot_hash: str = "",
) -> PreparedSet:
    """Check a measurement set, and look for the usual mistakes; return the set ready for computation.

    Args:
        document: the set as it was posted.
        robot: the robot that was measured.
        resolved: transform from the set's frame to R0; None if all readings are in R0.
        frame_findings: findings about the frame, which come before the findings about the readings.
        others: known robots, in case another robot was measured instead of `robot`.
        flange_fields: fields that a remedy names if lengths in the flange frame seem to have another unit.
        header_units: quantities, such as length, whose units the headers of files state.
        robot_id: id of the robot, if it is stored.
        robot_hash: hash of the robot's content.

    Raises:
        MeasurementError: the set cannot be used.
    """
    readings, measurements = convert_readings(document, robot, resolved)
    findings = list(frame_findings)
    degrees = document.units.angle == "deg"
    frame = None
    if resolved is not None:
        frame = InstrumentFrame(np.array(resolved.rotation), np.array(resolved.translation))
    if measurements.unloaded_only is None:
        findings += inspect_measurements(
            robot,
            measurements,
            degrees=degrees,
            others=others,
            flange_fields=flange_fields,
            header_units=header_units,
            frame=frame,
            length_unit=document.units.length,
        )
    else:
        findings += inspect_unloaded(
            robot,
            measurements,
            degrees=degrees,
            others=others,
            header_units=header_units,
            frame=frame,
            length_unit=document.units.length,
        )
    findings += _find_unread_places(document, readings.targets.tolist())
    content = compute_content_hash(document, readings, resolved)
    return PreparedSet(robot, robot_id, robot_hash, readings, measurements, findings, content)


def _find_unread_places(document: MeasurementSetDocument, targets: Sequence[str]) -> list[Finding]:
    """Return a finding if `flange_targets` names targets that were not read: names may be misspelt."""
    unread = [name for name in document.flange_targets if name not in targets]
    if not unread:
        return []
    listed = ", ".join(f"'{name}'" for name in unread)
    return [
        Finding(
            code="target_name_suspect",
            weight="use_with_care",
            where="flange_targets",
            message=f"`flange_targets` states the places of {listed}, but no observation reads these; "
            f"the targets that were read are {', '.join(targets)}",
            remedy="correct the names in `flange_targets`, or remove these targets from the field",
        )
    ]


def convert_readings(
    document: MeasurementSetDocument, robot: Robot, resolved: ResolvedFrame | None
) -> tuple[ReadingArrays, Measurements]:
    """Return the readings of a measurement set as arrays, as posted and as the solver takes them.

    Args:
        document: the set as it was posted.
        robot: the robot that was measured.
        resolved: transform from the set's frame to R0; None if all readings are in R0.

    Raises:
        MeasurementError: the set cannot be used.
    """
    with _add_label_to_errors(document.observations):
        readings = ReadingArrays.from_observations(document.observations)
        return readings, to_measurements(*transform_to_base(document, readings, resolved), robot)


@contextmanager
def _add_label_to_errors(observations: Sequence[Observation]) -> Iterator[None]:
    """Add the observation's label to a `MeasurementError` of the block that gives only its number."""
    try:
        yield
    except NamedObservationError:
        raise
    except MeasurementError as error:
        match = re.match(r"observations\[(\d+)\]", error.where or "")
        label = "" if match is None else observations[int(match[1])].label
        if not label:
            raise
        reason = f"observation '{label}': {error.reason}"
        raise MeasurementError(reason, where=error.where, remedy=error.remedy) from error


def prepare_set(
    document: MeasurementSetDocument, robot: PreparedRobot, robot_id: str, others: Iterable[KnownRobot] = ()
) -> PreparedSet:
    """Check a measurement set without a store; return the set ready for computation.

    Args:
        document: the set, in R0 or in a frame that the set states in numbers.
        robot: the robot that was measured.
        robot_id: any id for the robot.
        others: known robots, in case another robot was measured instead of `robot`.
        flange_fields: fields that a remedy names if lengths in the flange frame seem to have another unit.

    Raises:
        MeasurementError: the set cannot be used.
        RequestError: the set's frame names a stored geometry.
    """
    return check_set(
        document,
        robot.robot,
        resolve_stated_frame(document),
        [],
        others,
        robot_id=robot_id,
        robot_hash=robot.content_hash,
    )


def resolve_stated_frame(document: MeasurementSetDocument) -> ResolvedFrame | None:
    """Return the frame that a set states in numbers; None if the set is in R0.

    Raises:
        RequestError: the frame names a stored geometry, which only a service has.
    """
    frame = document.frame
    if frame is None:
        return None
    if frame.geometry_id is not None:
        raise RequestError(
            f"the geometry '{frame.geometry_id}' can be used only in the service that stores the geometry, "
            "not from a file",
            remedy="give the frame's rotation and translation, or use a service",
            where="frame.geometry_id",
        )
    return to_resolved_frame(read_stated_transform(frame, LENGTH[document.units.length]))


def _read_uploaded_urdf(model: UrdfModel) -> KinematicChain:
    """Return the chain from base to flange of a URDF; errors name the field of the model.

    Raises:
        RobotError: the URDF cannot be used.
    """
    try:
        return read_urdf(model.urdf, model.base, model.flange)
    except RobotError as error:
        is_model_field = error.where in {"base", "flange"}
        place = f"model.{error.where}" if is_model_field else f"model.urdf: {error.where or 'document'}"
        raise RobotError(error.reason, remedy=error.remedy, where=place) from error


_MOST_LABELS: Final = 12
"""Number of labels that a message lists."""


def _list_labels(observations: Sequence[Observation]) -> str:
    """Return the labels of observations, for a message: all of a few, or the first and the last."""
    labels = [observation.label for observation in observations]
    if len(labels) > _MOST_LABELS:
        labels = [*labels[: _MOST_LABELS - 2], "…", labels[-1]]
    return ", ".join(labels)


def leave_out_observations(observations: Sequence[Observation], labels: Collection[str]) -> list[Observation]:
    """Return the observations of a set whose labels are not among `labels`.

    Raises:
        RequestError: a label belongs to no observation, or no observation remains.
    """
    unknown = set(labels) - {observation.label for observation in observations}
    if unknown:
        raise RequestError(
            f"the set has no observation '{min(unknown)}'",
            where="leave_out",
            remedy=f"give labels of the set's observations: {_list_labels(observations)}",
        )
    kept = [observation for observation in observations if observation.label not in labels]
    if not kept:
        raise RequestError(
            "all observations are omitted", where="leave_out", remedy="keep at least one observation"
        )
    return kept
