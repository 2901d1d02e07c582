"""The work of a map: its steps are blocks of places. Its table is computed again when it is needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np

from jointstiff.schemas.deflection import MAX_PLACES, MAX_POSES, MapOptions, MapRequest, MapResult
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.readings import hash_texts
from jointstiff.service.conversion.robots import (
    joint_kinds_by_name,
    refuse_far_point,
    refuse_wrong_joint_count,
)
from jointstiff.service.kinds.work import Arrays, Span, Work, concatenate_steps, cut_into_spans
from jointstiff.service.resources.inputs import Inputs
from jointstiff.service.runs.verdicts import (
    RunModel,
    assess_with_run,
    find_accepted_run,
    find_beyond_campaign,
    find_far_points,
    find_implausible_deflection,
    find_missing_numbers,
)
from jointstiff.service.tables.table import Sheet
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError, RobotError
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.answers import (
    STATUSES,
    DeflectionMap,
    MapTask,
    compute_tool_rotations,
    map_places,
    summarise_map,
)
from jointstiff.solver.text import length_text

POSES_A_STEP: Final = 10_000
"""Number of postures (places times orientations) in a step, which takes a quarter of a second."""
_ELASTIC_LINKS_FACTOR: Final = 5
"""Time and memory for a posture if links are elastic, relative to elastic joints alone."""
_AT_ORIGIN: Final = 0.02
"""Fraction of the reach within which an area is at the origin of R0, inside the arm's base."""
_LEAST_LENGTH: Final = 1e-9
"""Length below which a direction counts as the zero vector."""


class MapWork(Work):
    """Work of a map, whose units are places; a map of a single block of places has no steps."""

    unit = "places"
    activity = "mapping"

    def __init__(self, robot: Robot, robot_id: str, run: Run, request: MapOptions) -> None:
        """Check the request, and prepare the model, the grid and the inverse kinematics.

        Raises:
            RequestError: the run has no model for predictions, or the request does not fit the robot.
        """
        self.robot_id = robot_id
        self.robot, self.request = robot, request
        options = request.model_dump_json(exclude={"run_id", "name"})
        self.input_hash = hash_texts(run.provenance.input_hash, options)
        self._run_model = RunModel.from_run(robot, run, absolute=request.absolute)
        self._task, self.places = make_map_task(request, robot), make_grid(request)
        try:
            self._inverse = InverseKinematics(robot, self._task.near)
        except RobotError as error:
            raise RequestError(error.reason, where="run_id", remedy=error.remedy) from error

    def steps(self) -> tuple[Span, ...]:
        """Return a step for each block of places; no steps if one block has all places."""
        blocks = self._blocks()
        return blocks if len(blocks) > 1 else ()

    def compute(self, span: Span) -> Arrays:
        """Return columns by name: posture, deflection and compliance at each place of a step.

        Raises:
            JointstiffError: the springs have no stable equilibrium under the load.
        """
        places = self.places[slice(*span)]
        return vars(
            map_places(self._run_model.model, self._run_model.error, self._task, self._inverse, places)
        )

    def conclude(self, parts: Sequence[Arrays]) -> MapResult:
        """Return the summary of the map, from the columns of all steps.

        Raises:
            JointstiffError: the springs have no stable equilibrium under the load.
        """
        table = DeflectionMap(**concatenate_steps(parts)) if parts else self.table
        run_model = self._run_model
        tool = self._task.rotation @ _unit_vector(self.request.tool_axis, "tool_axis")
        numbers = summarise_map(table, self.places, tool)
        return MapResult(
            assessment=assess_with_run("map", self._list_reasons(numbers), run_model.result.assessment),
            joint_kinds=joint_kinds_by_name(self.robot),
            model_error_postures=run_model.postures,
            remarks=run_model.remarks(self.request.confidence),
            **numbers,
        )

    def _list_reasons(self, numbers: Mapping[str, Any]) -> list[Finding]:
        """Return the reasons not to use the map, or to use it with care, in addition to those of its run.

        `numbers` are the fields of the map's summary, by name.
        """
        counts, places, worst = numbers["counts"], numbers["places"], numbers["worst"]
        return [
            *find_implausible_deflection(None if worst is None else worst.deflection, self._run_model.result),
            *find_missing_numbers(
                places - counts["reached"],
                places,
                "places",
                unseen=counts["unseen_joint"] > 0,
                remedy=self._describe_far_area(),
            ),
            *find_far_points([self.request.place, self.request.load_point]),
            *find_beyond_campaign(numbers["extrapolated"], places, "places"),
        ]

    def _describe_far_area(self) -> str | None:
        """Return the remedy if all places are beyond the reach, or at the origin of R0; else None."""
        distances = np.linalg.norm(self.places, axis=1)
        distance = float(distances.min())
        reach = self.robot.reach_bound + float(np.linalg.norm(self.request.place))
        if distances.max() < _AT_ORIGIN * reach:
            return (
                f"check the unit of `area`, and move it: all its places are within "
                f"{length_text(float(distances.max()))} of the origin of R0, inside the arm's base"
            )
        if distance <= reach:
            return None
        return (
            f"move `area`, whose lengths are in m: its nearest place is {length_text(distance)} from the "
            f"origin of R0, and the tool reaches at most {length_text(reach)}"
        )

    @cached_property
    def table(self) -> DeflectionMap:
        """Table of all places; every computation gives the same numbers, because a run never changes."""
        return DeflectionMap(**concatenate_steps(map(self.compute, self._blocks())))

    def sheet(self) -> Sheet:
        """Return the sheet of all places, for files: units in headers, NaN for a place without posture."""
        table = self.table
        columns = {"status": np.array(STATUSES)[table.status]}
        columns |= _name_components("{} [m]", self.places)
        columns |= self._number_orientations(table)
        for header, positions in zip(self._list_joint_headers(), table.joints.T, strict=True):
            columns[header] = positions
        columns |= _name_components("d{} [m]", table.displacement)
        columns["deflection [m]"] = table.length
        columns["readings only low [m]"], columns["readings only high [m]"] = table.readings.T
        columns["with model error low [m]"], columns["with model error high [m]"] = table.with_model_error.T
        columns["compliance along [m/N]"] = table.along
        columns["compliance across [m/N]"] = table.across
        is_extrapolation_known = np.isfinite(table.extrapolation)
        columns["extrapolation [1]"] = np.where(is_extrapolation_known, table.extrapolation, np.nan)
        return Sheet(columns, texts=frozenset({"status"}), digits=".10g")

    def _number_orientations(self, table: DeflectionMap) -> dict[str, FloatArray]:
        """Return the columns with the number of direction and turn of the tool at each place.

        Orientations are numbered direction by direction: with 4 turns, orientation 6 is direction 1, turn 2.
        """
        direction, turn = np.divmod(table.orientation, self.request.turns)
        has_posture = ~np.isnan(table.joints[:, 0])
        return {
            "direction": np.where(has_posture, direction, np.nan),
            "turn": np.where(has_posture, turn, np.nan),
        }

    def _list_joint_headers(self) -> list[str]:
        """Return the header of each joint's column: `joint_2 [rad]`, or `joint x [m]` of a prismatic joint.

        The name of a prismatic joint may be "x", which is also the header of a column of the place.
        """
        headers = list[str]()
        for name, kind in zip(self.robot.joint_names, self.robot.joint_kinds, strict=True):
            headers.append(f"joint {name} [m]" if kind == "prismatic" else f"{name} [rad]")
        return headers

    def _blocks(self) -> tuple[Span, ...]:
        """Cut the places into spans that each take about a quarter of a second, and return the spans."""
        poses = POSES_A_STEP // _ELASTIC_LINKS_FACTOR if self._run_model.model.first_order else POSES_A_STEP
        size = max(1, poses // len(self._task.rotation))
        return cut_into_spans(len(self.places), size)


def prepare_map(inputs: Inputs, request: MapRequest) -> MapWork:
    """Fetch the run of a request, and return the work of the map.

    Raises:
        RequestError: the run does not exist, has no model for predictions, or does not fit the request.
    """
    run = find_accepted_run(inputs, request.run_id, request.accept_verdict)
    return MapWork(run.prepared.robot, run.prepared.robot_id, run.run, request)


def _name_components(header: str, vectors: FloatArray) -> dict[str, FloatArray]:
    """Return header → column of the vectors (N, 3); "d{} [m]" makes the headers dx [m], dy [m], dz [m]."""
    return {header.format(axis): vectors[:, i] for i, axis in enumerate("xyz")}


def make_grid(request: MapOptions) -> FloatArray:
    """Return the places (P, 3) of the grid in R0 [m], in order of x, then y, then z (z changes fastest).

    Raises:
        RequestError: the first corner of the box exceeds the second, or there are too many places or poses.
    """
    least, greatest = (np.array(corner) for corner in request.area)
    if (least > greatest).any():
        raise RequestError(
            "a coordinate of the first corner is greater than that of the second corner",
            where="area",
            remedy="give the corner with the smaller x, y and z first",
        )
    places = int(np.prod(request.grid))
    _refuse_too_many(places, "places", MAX_PLACES)
    poses = places * len(request.directions) * request.turns
    _refuse_too_many(poses, "places times directions times turns", MAX_POSES)
    axes = [
        _divide_evenly(low, high, count)
        for low, high, count in zip(least, greatest, request.grid, strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _refuse_too_many(count: int, noun: str, limit: int) -> None:
    """Refuse a map with more of something than the limit.

    Raises:
        RequestError: `count` exceeds `limit`.
    """
    if count > limit:
        raise RequestError(
            f"the map has {count:,} {noun}, but at most {limit:,} are possible",
            where="grid",
            remedy="use a coarser grid, fewer orientations, or several maps",
        )


def _divide_evenly(low: float, high: float, count: int) -> FloatArray:
    """Return `count` numbers at even distances from `low` to `high`; a single number is in the middle."""
    if count == 1:
        return np.array([0.5 * (low + high)])
    return np.linspace(low, high, count)


def make_map_task(request: MapOptions, robot: Robot) -> MapTask:
    """Return the task to solve at each place: tool orientations, load, direction, joint limits, posture.

    Load and direction are stated along the axes of the flange, or of R0; the task has them along R0.

    Raises:
        RequestError: a direction has no length, the load is missing, limits or angles do not fit the robot's
            joints, or a point is too far from the flange.
    """
    refuse_far_point(request.place, "place")
    refuse_far_point(request.load_point, "load_point")
    load = _read_load(request)
    limits = _read_limits(request, robot)
    near = _read_near_joints(request, robot)
    rotation = _compute_tool_orientations(request)
    stated_direction = tuple(load.force) if request.direction is None else request.direction
    direction = _unit_vector(stated_direction, "direction")
    load_axes = rotation if request.axes == "flange" else np.broadcast_to(np.eye(3), rotation.shape)
    load_point = request.place if request.load_point is None else request.load_point
    return MapTask(
        rotation=rotation,
        force=load_axes @ load.force,
        moment=load_axes @ load.moment,
        direction=load_axes @ direction,
        place=np.array(request.place),
        load_point=np.array(load_point),
        limits=limits,
        near=near,
        confidence=request.confidence,
    )


def _read_near_joints(request: MapOptions, robot: Robot) -> FloatArray | None:
    """Return the joints (n,) to which the postures of the map are near; None if the request states none.

    Raises:
        RequestError: the robot has another number of joints.
    """
    if request.near is None:
        return None
    refuse_wrong_joint_count(robot, request.near, "near")
    return np.array(request.near)


class _Load(NamedTuple):
    """Load of a process, along the axes that the request names."""

    force: FloatArray  # (3,) [N]
    moment: FloatArray  # (3,) [N·m]


def _read_load(request: MapOptions) -> _Load:
    """Return the load of a request, zero only for a map of the sag under own weight (`absolute`).

    Raises:
        RequestError: the load is missing, or the direction of the compliance is neither stated nor that of a
            force.
    """
    force, moment = np.array(request.force), np.array(request.moment or (0.0, 0.0, 0.0))
    if not (force.any() or moment.any() or request.absolute):
        raise RequestError("the load is missing", where="force", remedy="give the force of the process in N")
    if request.direction is None and not force.any():
        raise RequestError(
            "the direction of the compliance is missing",
            where="direction",
            remedy="give `direction`, or a force that is not zero",
        )
    return _Load(force, moment)


def _compute_tool_orientations(request: MapOptions) -> FloatArray:
    """Return the rotations (K, 3, 3) of the flange that point the tool along each direction, at each turn.

    Directions × turns: 3 directions and 4 turns about the tool's axis → (12, 3, 3).

    Raises:
        RequestError: a direction has no length.
    """
    tool_axis = _unit_vector(request.tool_axis, "tool_axis")
    directions = [_unit_vector(each, f"directions[{i}]") for i, each in enumerate(request.directions)]
    return compute_tool_rotations(tool_axis, np.array(directions), request.turns)


def _read_limits(request: MapOptions, robot: Robot) -> FloatArray:
    """Return the least and the greatest position (n, 2) of each joint [rad or m]; infinite if not stated.

    Raises:
        RequestError: the robot has no joint of a name, or the lower limit exceeds the upper one.
    """
    limits = np.tile([-np.inf, np.inf], (robot.n, 1))
    for name, (least, greatest) in request.limits.items():
        if least > greatest:
            raise RequestError(
                "the lower limit of the joint is greater than the upper limit",
                where=f"limits.{name}",
                remedy="give the lower limit first",
            )
        limits[robot.joint_index(name, f"limits.{name}")] = least, greatest
    return limits


def _unit_vector(vector: Sequence[float], where: str) -> FloatArray:
    """Return a vector (3,) divided by its length.

    Raises:
        RequestError: the vector, the request's field `where`, is zero.
    """
    array = np.array(vector, dtype=np.float64)
    length = float(np.linalg.norm(array))
    if length < _LEAST_LENGTH:
        raise RequestError(
            "the direction is the zero vector", where=where, remedy="give a vector that is not zero"
        )
    return np.asarray(array / length)
