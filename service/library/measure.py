"""Measure live: one reading after the other until a declared goal is reached, here or over a service."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Coroutine, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol, Self, TypeVar, cast
from urllib.parse import quote

import numpy as np

from jointstiff.schemas.fields import Message
from jointstiff.schemas.live import (
    LiveOptions,
    LiveReading,
    LiveState,
    MeasurementSetPost,
)
from jointstiff.schemas.measurement import MeasurementSetDocument, Observation, SetChange, Units
from jointstiff.schemas.options import OwnWeight, RunOptions
from jointstiff.schemas.plan import Goal, PlannedReading
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.arguments import convert_to_si
from jointstiff.service.conversion.arrays import to_number_array
from jointstiff.service.conversion.prepared import (
    PreparedRobot,
    prepare_robot,
    read_stated_transform,
    resolve_stated_frame,
)
from jointstiff.service.conversion.units import FORCE, AnyUnits, complete_units
from jointstiff.service.library.answers import parse_resource
from jointstiff.service.library.campaigns import Campaign
from jointstiff.service.live.campaign import MOST_READINGS, Declaration, Entry, LiveCampaign
from jointstiff.service.live.declaration import Scales, declare_set, read_goal
from jointstiff.service.live.sources import (
    PATIENCE,
    CheckedSource,
    Place,
    Point,
    Setting,
    Source,
    SourceError,
    Stand,
    make_source,
)
from jointstiff.service.problems import (
    AwayError,
    CampaignError,
    ProblemError,
    as_campaign_error,
    http_problem,
)
from jointstiff.service.resources.documents import parse_document, read_plan_source
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import Robot

if TYPE_CHECKING:
    import httpx2

    from jointstiff.service.library.results import TabledRun

Value = TypeVar("Value")
_SIMULATED_SIGMA: Final = 2e-5
"""Standard deviation of a simulated tracker where the campaign states no noise [m]."""
_READ_AGAIN: Final = "doubtful; read again"
_SHOWN_BY_LATER_READINGS: Final = "a mistake, as later readings show"
_FULL_NAMES: Final = {"area": "work_area"}
"""Full name of each option that has a shorter one."""


class Person:
    """Person at the robot, who decides before readings, about doubtful readings, and when a source fails.

    This base class decides without a person: it reads on, reads a doubtful posture once more and then keeps
    the reading, withdraws the first earlier mistake and keeps later ones, and retries a failed source once.
    """

    def confirms(self, profile: str) -> bool:  # noqa: ARG002 - subclasses use the argument
        """Return whether the text `profile` describes correctly how the lines of a source are read."""
        return True

    def ready(self, following: PlannedReading, *, loaded: bool) -> Literal["read", "skip", "stop"]:  # noqa: ARG002
        """Wait until the arm is in the next posture, with or without load; return what to do then."""
        return "read"

    def on_reading(self, state: LiveState, reading: LiveReading) -> None:
        """Show a reading and the state after it; this base class shows nothing."""

    def doubts(self, reading: LiveReading, *, again: bool) -> Literal["again", "keep"]:  # noqa: ARG002
        """Return whether to read a doubtful posture again, or to keep the reading.

        `again` is true if the posture was read again before.
        """
        return "keep" if again else "again"

    def doubts_earlier(self, reading: LiveReading, *, again: bool) -> Literal["withdraw", "keep"]:  # noqa: ARG002
        """Return whether to withdraw or keep an earlier reading that later readings show to be a mistake.

        `again` is true if another reading was withdrawn for this reason before.
        """
        return "keep" if again else "withdraw"

    def missed(self, error: Exception, *, again: bool) -> Literal["again", "skip", "stop"]:
        """Return what to do after a source gave no reading.

        `again` is true if the source failed before for this reading. This base class tries once more, and
        then raises the error.
        """
        if again:
            raise error
        return "again"


class _SetInProcess:
    """Measurement set that is measured live, kept in this process."""

    def __init__(self, robot: PreparedRobot, post: MeasurementSetPost, run: RunOptions) -> None:
        """Begin without readings; `post` declares goal, load and targets; `run` has the run's options."""
        self._robot_document, self._run_options = robot.document, run
        with as_campaign_error("measurement_set"):
            resolved = resolve_stated_frame(post)
        with as_campaign_error(""):
            self._campaign = LiveCampaign(Declaration(robot.robot, post, resolved))
            # Computed now, so that an impossible declaration raises its error here.
            _ = self._campaign.declaration.candidate_readings

    def state(self) -> LiveState:
        """Return the results of the readings so far, and the next planned reading."""
        return self._campaign.state()

    def observe(self, observation: Observation) -> LiveState:
        """Add a reading; return the new state."""
        with as_campaign_error(""):
            self._campaign = self._campaign.with_entry(self._campaign.compare_with_prediction(observation))
        return self.state()

    def change(self, change: SetChange) -> LiveState:
        """Withdraw or keep readings, or skip a posture; return the new state."""
        with as_campaign_error(""):
            for entry in self._campaign.entries_for_change(change):
                self._campaign = self._campaign.with_entry(entry)
        return self.state()

    def close(self) -> tuple[TabledRun, LiveState]:
        """Close the set and identify its readings; return the run, and the state of the closed set."""
        from jointstiff.service.library.here import Here

        campaign = self._make_closed_campaign()
        if not self._campaign.closed:
            self._campaign = self._campaign.with_entry(Entry("closed", ""))
        return Here().identify(campaign), self.state()

    def _make_closed_campaign(self) -> Campaign:
        """Return the ordinary campaign of the readings, without withdrawn ones.

        Raises:
            CampaignError: all readings were withdrawn.
        """
        with as_campaign_error(""):
            closed_fields = self._campaign.fields_when_closed()
        # A closed set has more fields, such as its history, than the document of a campaign.
        set_fields = {name: closed_fields[name] for name in MeasurementSetDocument.model_fields}
        options = {name: value for name, value in self._campaign.run_options.items() if value}
        return Campaign(
            robot=self._robot_document,
            measurement_set=MeasurementSetDocument.model_validate(set_fields),
            run=self._run_options.model_copy(update=options),
        )


class LiveService(Protocol):
    """Client of a service that keeps a measurement set, such as `jointstiff.Client`."""

    runs: Any  # collection of the runs of the service

    def prepare_robot(self, robot: RobotDocument) -> str:
        """Return the id of a robot in the service."""

    def send(
        self,
        verb: str,
        path: str,
        query: Mapping[str, str | bool] | None = None,
        document: Any = None,  # noqa: ANN401 - a message, a document or JSON text
    ) -> httpx2.Response:
        """Send a request; return the answer of the service."""


class _SetInService:
    """Measurement set that is measured live, kept by a service."""

    def __init__(self, client: LiveService, robot: RobotDocument, post: MeasurementSetPost) -> None:
        """Store robot and measurement set in the service; `post` declares goal, load and targets."""
        self._client = client
        body = post.model_copy(update={"robot_id": client.prepare_robot(robot)})
        text = body.model_dump_json(exclude_unset=True)
        answer = client.send("POST", "/v1/measurement-sets", None, text)
        self.id = str(json.loads(answer.content)["id"])
        self._path = f"/v1/measurement-sets/{quote(self.id, safe='')}"

    def _request_state(self, verb: str, path: str, document: Message | str | None = None) -> LiveState:
        """Send a request about the set to the service; return the state in its answer."""
        answer = self._client.send(verb, f"{self._path}{path}", None, document)
        return parse_resource(answer, LiveState)

    def state(self) -> LiveState:
        """Return the results of the readings so far, and the next planned reading."""
        return self._request_state("GET", "/next")

    def observe(self, observation: Observation) -> LiveState:
        """Add a reading; return the new state."""
        return self._request_state("POST", "/observations", observation)

    def change(self, change: SetChange) -> LiveState:
        """Withdraw or keep readings, or skip a posture; return the new state."""
        self._client.send("PATCH", self._path, None, change)
        return self.state()

    def close(self) -> tuple[TabledRun, LiveState]:
        """Close the set in the service, wait for its run; return the run, and the state of the closed set."""
        state = self._request_state("POST", "/close", "{}")
        run = self._client.runs.wait(self._client.runs.get(str(state.run_id)))
        return run, state


class SourceThread:
    """Thread with an event loop, in which a source can receive data between readings."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="source", daemon=True)
        self._thread.start()

    def run_coroutine(self, coroutine: Coroutine[Any, Any, Value]) -> Value:
        """Run a coroutine in the thread; wait for its end and return its value."""
        future = self.start_coroutine(coroutine)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def start_coroutine(self, coroutine: Coroutine[Any, Any, Value]) -> Future[Value]:
        """Start a coroutine in the thread; return its future, which can be cancelled."""
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop)

    def close(self) -> None:
        """Stop the event loop and end the thread."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        # One more turn of the loop lets connections end that were closed just before.
        self._loop.run_until_complete(asyncio.sleep(0))
        self._loop.close()


class LiveMeasurement:
    """Campaign while it is measured live, in this process or over a service.

    ::

        with js.measure("campaign.json", goal="15 %", source="simulated:1") as campaign:
            campaign.run_source()
        print(campaign.run)

    The end of the `with` block releases the source; the set stays open until `close`.
    """

    def __init__(
        self,
        measured_set: _SetInProcess | _SetInService,
        robot: PreparedRobot,
        post: MeasurementSetPost,
        source: Source | None,
        wait: float,
        units: Units,
    ) -> None:
        """Begin a live measurement; called by `jointstiff.measure` and `Client.measure`.

        Args:
            measured_set: measurement set in this process or in a service.
            robot: measured robot, with n joints.
            post: declaration of goal, load and targets.
            source: source of readings; None for readings by `observe`.
            wait: time after which a source that sends nothing is considered stopped [s].
            units: units of the arguments of `observe`.
        """
        self._set, self._robot, self._declaration = measured_set, robot.robot, post
        self._options = cast("LiveOptions", post.open)
        self._scales = Scales.from_units(post.units, robot.robot)
        self._units_of_caller = Scales.from_units(units, robot.robot)
        self.source, self._wait = source, wait
        self.joint_names, self.joint_kinds = robot.robot.joint_names, robot.robot.joint_kinds
        self._source_thread: SourceThread | None = None
        self._checked_source: CheckedSource | None = None
        self._confirmed = False
        self.state = measured_set.state()  #: results of the readings so far, and the next planned reading
        self.run: TabledRun | None = None  #: run of the closed campaign; None before
        self.robot = robot.document  #: measured robot
        #: state before the campaign was closed
        self.outcome: LiveState = self.state

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release_source()

    def __repr__(self) -> str:
        """Return the robot's name, the goal and the message of the present state in one line."""
        return f"<LiveMeasurement of '{self.robot.name}': {self.state.goal}; {self.state.message}>"

    @property
    def next(self) -> PlannedReading | None:
        """Next planned reading, in SI units; None if nothing is left to read."""
        return self.state.next

    @property
    def count(self) -> int:
        """Number of readings, without those that were withdrawn."""
        return sum(each.state != "withdrawn" for each in self.state.readings)

    def observe(
        self,
        unloaded: Any = None,  # noqa: ANN401 - arrays or positions by target
        loaded: Any = None,  # noqa: ANN401 - arrays or positions by target
        *,
        label: str | None = None,
        joints: Any = None,  # noqa: ANN401 - anything that numpy understands
        force: Any = None,  # noqa: ANN401 - anything that numpy understands
        sigma: Mapping[str, float] | None = None,
    ) -> LiveState:
        """Add a reading, compare the reading with all others, and return the resulting state.

        Args:
            unloaded: positions without load, by target or (T, 3) in the order of the targets; in R0, or in
                the frame of the campaign. All numbers are in the units that `jointstiff.measure` was called
                with: mm, deg and N unless it stated others.
            loaded: positions under load in the same form; None for readings by the robot's own weight.
            label: label of the reading; default: the label of the next planned reading.
            joints: (n,) joint values as the controller shows them; default: as planned.
            force: (3,) force on the robot, axes of R0; default: as planned.
            sigma: standard uncertainty of a coordinate by target, where the campaign states none.

        Raises:
            CampaignError: the reading cannot be right, or another reading has this label.
            RefusedError: the service refuses the reading.
        """
        units = self._units_of_caller
        with as_campaign_error(""):
            if joints is not None:
                joints = to_number_array(joints, "joints") * np.array(units.joints)
            if force is not None:
                force = to_number_array(force, "force") * units.force
        return self._add_observation_in_si(
            _scale_positions(unloaded, units.length),
            _scale_positions(loaded, units.length),
            label=label,
            joints=joints,
            force=force,
            sigma=None if sigma is None else {name: units.length * each for name, each in sigma.items()},
        )

    def _add_observation_in_si(
        self,
        unloaded: Any,  # noqa: ANN401 - an array or positions by target [m]
        loaded: Any,  # noqa: ANN401 - an array or positions by target [m]
        *,
        label: str | None,
        joints: Any,  # noqa: ANN401 - anything that numpy understands [rad or m]
        force: Any,  # noqa: ANN401 - anything that numpy understands [N]
        sigma: Mapping[str, float] | None,
    ) -> LiveState:
        """Add a reading in SI units; return the state that follows from all readings.

        What is not stated of label, joints and force is that of the next planned reading.
        """
        planned, units = self.next, self._scales
        if planned is None and (label is None or joints is None or force is None):
            remedy = "give `label`, `joints` and `force` of the reading"
            raise CampaignError(http_problem(422, "no planned reading is left", remedy))
        if planned is not None:
            label = label or planned.label
            joints = planned.joints if joints is None else joints
            force = planned.force if force is None else force
        document = {
            "label": label or "",
            "joints": (np.asarray(joints, dtype=np.float64) / np.array(units.joints)).tolist(),
            "force": (np.asarray(force, dtype=np.float64) / units.force).tolist(),
            "readings": self._list_target_readings(unloaded, loaded, sigma or {}),
        }
        self.state = self._set.observe(parse_document(document, Observation))
        return self.state

    def _list_target_readings(
        self,
        unloaded: Any,  # noqa: ANN401 - an array or positions by target [m]
        loaded: Any,  # noqa: ANN401 - an array or positions by target [m]
        sigma: Mapping[str, float],
    ) -> list[dict[str, Any]]:
        """Return the reading of each target in the form of a document, in the units of the set.

        A target without a position under load, or without a standard uncertainty `sigma` [m], has no such
        field.
        """
        unloaded_by_target = self._positions_by_target(unloaded)
        loaded_by_target = self._positions_by_target(loaded)
        readings = list[dict[str, Any]]()
        for name, position in unloaded_by_target.items():
            reading: dict[str, Any] = {"target": name, "unloaded": position}
            if name in loaded_by_target:
                reading["loaded"] = loaded_by_target[name]
            if name in sigma:
                reading["sigma"] = sigma[name] / self._scales.length
            readings.append(reading)
        return readings

    def withdraw(self, label: str, reason: str) -> LiveState:
        """Withdraw a reading for a stated reason: the estimate ignores the reading, the record shows it."""
        return self._send_change({"withdrawn": {label: reason}})

    def keep(self, label: str) -> LiveState:
        """Use the doubtful reading of this label in the estimate, because the reading is right."""
        return self._send_change({"kept": [label]})

    def skip(self) -> LiveState:
        """Skip the next planned posture; return the state, in which `next` is another posture."""
        return self.state if self.next is None else self._send_change({"skipped": self.next.label})

    def run_source(self, person: Person | None = None, most: int = MOST_READINGS) -> LiveState:
        """Read with the source until the goal is reached or cannot be reached, or after `most` readings.

        Args:
            person: person who decides about readings; default: nobody, as `Person` describes.
            most: largest number of readings, withdrawn ones included.

        Raises:
            SourceError: the source failed twice at the same reading.
            CampaignError: the campaign has no source, or nobody confirmed how its lines are read.
        """
        person = Person() if person is None else person
        with as_campaign_error(""):
            self._open_source()
            while (
                self.state.state == "measuring" and self.next is not None and len(self.state.readings) < most
            ):
                answer = self._read_posture(self.next, person)
                if answer == "stop":
                    break
                if answer == "skip":
                    self.skip()
        return self.state

    def close(self) -> TabledRun:
        """Close the measurement: make an ordinary measurement set of its readings, and return its run.

        Raises:
            CampaignError: all readings were withdrawn.
            RefusedError: the service refuses the request.
        """
        self.release_source()
        if self.run is None:
            self.outcome = self.state
            self.run, self.state = self._set.close()
        return self.run

    @property
    def campaign(self) -> Campaign:
        """Close the measurement; return its campaign, with the declared goal and the outcome in its notes."""
        return self.close().campaign

    def release_source(self) -> None:
        """Close the connection to the source, and end its thread."""
        if self._source_thread is not None:
            if self._checked_source is not None:
                self._source_thread.run_coroutine(self._checked_source.close())
            self._source_thread.close()
            self._source_thread = self._checked_source = None

    def _send_change(self, change: dict[str, Any]) -> LiveState:
        """Apply a change to the measurement set, such as to withdraw a reading; return the new state."""
        self.state = self._set.change(parse_document(change, SetChange))
        return self.state

    def _positions_by_target(self, positions: Any) -> dict[str, list[float]]:  # noqa: ANN401 - array or mapping
        """Return positions by target, in the units of the set.

        `positions` [m] are a dictionary by target, or an array (T, 3) in the order of the targets; for None,
        return an empty dictionary.
        """
        if positions is None:
            return {}
        names = self._options.targets
        by_name = positions if isinstance(positions, Mapping) else dict(zip(names, positions, strict=True))
        return {
            str(name): (np.asarray(position, dtype=np.float64) / self._scales.length).tolist()
            for name, position in by_name.items()
        }

    def _make_source_setting(self) -> Setting:
        """Return the setting of a source of readings: robot, targets, load point [m], sigma [m], and frame.

        The frame is the pose of the campaign's frame in R0, None if the campaign's frame is R0.
        """
        declaration, options = self._declaration, self._options
        length_unit = self._scales.length
        targets, load_point = options.targets, options.load_point or (0.0, 0.0, 0.0)
        stated_sigma = declaration.noise.sigma if declaration.noise is not None else None
        sigma = length_unit * stated_sigma if stated_sigma else options.sigma or _SIMULATED_SIGMA
        if declaration.frame is None or declaration.frame.rotation is None:
            return Setting(self._robot, targets, load_point, sigma)
        transform = read_stated_transform(declaration.frame, length_unit)
        frame = (transform.rotation, np.asarray(transform.translation))
        return Setting(self._robot, targets, load_point, sigma, frame)

    def _open_source(self) -> None:
        """Open the source in a thread of its own, unless the source is open.

        Raises:
            RequestError: the campaign has no source, or the source cannot give its readings.
        """
        source = self._require_suitable_source()
        if self._source_thread is not None:
            return
        self._source_thread = SourceThread()
        self._checked_source = CheckedSource(source, self._make_source_setting(), self._wait)
        try:
            self._source_thread.run_coroutine(self._checked_source.open())
        except BaseException:
            self.release_source()
            raise

    def _require_suitable_source(self) -> Source:
        """Return the source of readings.

        Raises:
            RequestError: the campaign has no source, or a source that simulates loads, without a load.
        """
        if self.source is None:
            raise RequestError(
                "the live measurement has no source of readings",
                where="source",
                remedy='give a source, such as source="simulated:1"',
            )
        if isinstance(self._options.load, OwnWeight) and self.source.by_itself:
            raise RequestError(
                "a simulated source cannot read a robot that carries only its own weight",
                where="source",
                remedy="give a load, such as dead_weight:1500",
            )
        return self.source

    def _read_posture(self, planned: PlannedReading, person: Person) -> Literal["read", "skip", "stop"]:
        """Read a posture until a reading is kept; return `read`, or the person's decision to skip or stop.

        A doubtful reading is withdrawn and read again with a new label, unless the person keeps it.

        Raises:
            AwayError: the service does not answer.
        """
        source_failed = was_read_again = False
        while True:
            answer: Literal["read", "again", "skip", "stop"]
            try:
                answer = self._read_once(planned, person)
            except AwayError:
                raise
            except (SourceError, ProblemError) as error:
                answer, source_failed = person.missed(error, again=source_failed), True
            if answer == "again":
                continue
            if answer != "read":
                return answer
            reading = self.state.readings[-1]
            person.on_reading(self.state, reading)
            self._review_earlier_readings(person)
            if reading.state != "doubtful":
                return answer
            if person.doubts(reading, again=was_read_again) == "keep":
                self.keep(reading.label)
                return answer
            self.withdraw(reading.label, _READ_AGAIN)
            source_failed, was_read_again = False, True
            label = f"m{1 + len(self.state.readings):02d}"
            planned = planned.model_copy(update={"label": label})

    def _review_earlier_readings(self, person: Person) -> None:
        """Let the person withdraw or keep each earlier reading that later readings made doubtful."""
        readings = self.state.readings
        withdrew_before = any(each.reason == _SHOWN_BY_LATER_READINGS for each in readings)
        for earlier in readings[:-1]:
            if earlier.state == "doubtful":
                person.on_reading(self.state, earlier)
                if person.doubts_earlier(earlier, again=withdrew_before) == "keep":
                    self.keep(earlier.label)
                else:
                    self.withdraw(earlier.label, _SHOWN_BY_LATER_READINGS)

    def _read_once(self, planned: PlannedReading, person: Person) -> Literal["read", "skip", "stop"]:
        """Read the targets in a posture without load and under load, and add the reading to the campaign.

        If the robot's own weight is the load, the targets are read only once. Return `read`, or the person's
        decision to skip the posture or to stop.
        """
        points_by_load_state: list[dict[str, Point]] = []
        load_states = (False,) if isinstance(self._options.load, OwnWeight) else (False, True)
        for loaded in load_states:
            answer = person.ready(planned, loaded=loaded)
            if answer != "read":
                return answer
            points_by_load_state.append(self._read_points(planned, person, loaded=loaded))
        # The two are equal for the robot's own weight.
        first_points, last_points = points_by_load_state[0], points_by_load_state[-1]
        states_no_sigma = self._declaration.noise is None or self._declaration.noise.sigma is None
        self._add_observation_in_si(
            _take_positions(first_points),
            _take_positions(last_points) if len(load_states) > 1 else None,
            label=planned.label,
            joints=planned.joints,
            force=planned.force,
            sigma=_find_greater_sigmas(first_points, last_points) if states_no_sigma else {},
        )
        return "read"

    def _read_points(self, planned: PlannedReading, person: Person, *, loaded: bool) -> dict[str, Point]:
        """Read all targets with the source, in a planned posture without or under load; return them by name.

        Raises:
            SourceError: the source has stopped, or nobody confirmed how its lines are read.
        """
        source_thread = cast("SourceThread", self._source_thread)
        checked_source = cast("CheckedSource", self._checked_source)
        stand = Stand(planned.label, tuple(planned.joints), planned.force, loaded)
        self._confirm_line_format(stand, person)
        return source_thread.run_coroutine(checked_source.read(stand))

    def _confirm_line_format(self, stand: Stand, person: Person) -> None:
        """Let a person confirm, before the first reading, how the lines of the source are read.

        Raises:
            RequestError: the person does not confirm how the lines are read.
        """
        if self._confirmed:
            return
        profile = cast("SourceThread", self._source_thread).run_coroutine(
            cast("CheckedSource", self._checked_source).profile(stand)
        )
        if profile is not None and not person.confirms(profile):
            raise RequestError(
                "nobody confirmed that the lines of the source are read correctly",
                where="source",
                remedy="state the form of the lines with `columns` or `pattern`, and the unit with "
                "`source_unit`",
            )
        self._confirmed = True


def measure(
    robot: Any,  # noqa: ANN401 - a robot, a campaign, or a run
    /,
    goal: str | Goal | Mapping[str, Any],
    source: str | Source | None = None,
    *,
    force: Any = None,  # noqa: ANN401 - three numbers
    timeout: float = PATIENCE,
    client: LiveService | None = None,
    source_options: Mapping[str, Any] | None = None,
    units: AnyUnits = None,
    **options: Any,  # noqa: ANN401 - fields of LiveOptions
) -> LiveMeasurement:
    """Begin a live measurement: a campaign that is measured until a declared goal is reached.

    Args:
        robot: a robot (a document, a file, or the name of an arm of the catalogue), with the options `load`
            and `targets`. Or a campaign, its file or a run, from which robot, loads, targets, noise and load
            point are taken, but no readings.
        goal: uncertainty "15 %" of every joint that the load twists; uncertainty "6 um" of the deflection in
            the work area; "below 0.5 mm" to decide whether the deflection is below this limit; or a goal as
            in the API.
        source: `simulated:SEED`, `lines:/dev/ttyUSB0`, `lines:tcp://host:port`, `lines:udp://:port`,
            `robodk`, the name of an entry point in the group `jointstiff.sources`, or an object with
            ``async def point(name)``. Without a source, add readings with `observe`.
        force: (3,) force in the work area, axes of R0; default: the force of the load.
        timeout: seconds after which a source that sends nothing has stopped.
        client: client of the service that keeps the measurement set; default: this process keeps the set.
        source_options: options of the source `lines`: `columns` or `pattern`, `source_unit`, `request`,
            `baud`, `sample`.
        units: units of the numbers of this call and of `observe`, such as "m, rad, kN, kN.m"; default: mm,
            deg, N and N.m.
        options: fields of `LiveOptions`, such as `load`, `targets`, `work_area` (or `area`), `load_point`,
            `sigma`, `surroundings`, `candidates`, `seed`. A load may be a text with its force in N, such as
            "dead_weight:1500".

    Raises:
        CampaignError: robot, goal or an option cannot be used; the error's `problem` has reason and remedy.
        RefusedError: the service refuses the request.
        OSError: a file cannot be read.
    """
    robot_document, campaign = _robot_and_campaign(robot)
    inherited = _Inherited.from_campaign(campaign)
    with as_campaign_error(""):
        stated_units = complete_units(units)
        parsed_goal = _parse_goal(goal, force, stated_units)
        prepared = prepare_robot(robot_document)
        live_options = _parse_options(_convert_options(options, stated_units, prepared.robot), parsed_goal)
        declaration = declare_set(
            prepared, inherited.set_document, parsed_goal, live_options, inherited.own_weight
        )
        opened_source = make_source(source, source_options or {}) if isinstance(source, str) else source
    measured_set: _SetInProcess | _SetInService
    if client is None:
        measured_set = _SetInProcess(prepared, declaration, inherited.run_options)
    else:
        measured_set = _SetInService(client, robot_document, declaration)
    return LiveMeasurement(measured_set, prepared, declaration, opened_source, timeout, Units(**stated_units))


@dataclass(frozen=True)
class _Inherited:
    """Parts that a live measurement takes from an earlier campaign of the robot."""

    set_document: MeasurementSetDocument | None = None  # for loads, targets, noise and load point
    run_options: RunOptions = field(default_factory=RunOptions)
    own_weight: OwnWeight | None = None  # options of a run by the robot's own weight

    @classmethod
    def from_campaign(cls, campaign: Campaign | None) -> _Inherited:
        """Return what a campaign states; without a campaign, nothing is inherited."""
        if campaign is None:
            return cls()
        run_options = RunOptions(confidence=campaign.run.confidence)
        return cls(campaign.measurement_set, run_options, campaign.run.weight)


def _parse_goal(
    goal: str | Goal | Mapping[str, Any],
    force: Any,  # noqa: ANN401 - three numbers
    units: dict[str, str],
) -> Goal:
    """Return a goal in SI units; `goal` and `force`, the force in the work area, are in the units of a call.

    Raises:
        RequestError: the goal or a unit is not understood.
    """
    force_size = FORCE[units["force"]]
    area_force = None if force is None else tuple((force_size * np.asarray(force, np.float64)).tolist())
    if isinstance(goal, Mapping):
        goal = convert_to_si(LiveOptions, {"goal": goal}, units)["goal"]
    return read_goal(goal, cast("Any", area_force))


def _convert_options(options: Mapping[str, Any], units: dict[str, str], robot: Robot) -> dict[str, Any]:
    """Return fields of `LiveOptions` by their full names, in SI units.

    A load as text is parsed: "dead_weight:1500" is a weight of 1500 N.

    Raises:
        RequestError: a text is no load.
    """
    from jointstiff.service.conversion.units import parse_load_text

    full_options = {_FULL_NAMES.get(name, name): value for name, value in options.items()}
    kinds = dict(zip(robot.joint_names, robot.joint_kinds, strict=True))
    converted = convert_to_si(LiveOptions, full_options, units, lambda: kinds)
    if isinstance(converted.get("load"), str):
        converted["load"] = parse_load_text(converted["load"])
    return converted


def _take_positions(points: Mapping[str, Point]) -> dict[str, Place]:
    """Return target → position [m] of points that a source gave with their uncertainties."""
    return {name: position for name, (position, _) in points.items()}


def _find_greater_sigmas(first: Mapping[str, Point], last: Mapping[str, Point]) -> dict[str, float]:
    """Return target → the greater standard uncertainty [m] of its two positions, without and under load.

    A reading has one uncertainty for both of its positions. A target has none if the source states none.
    """
    sigmas = dict[str, float]()
    for name, (_, first_sigma) in first.items():
        _, last_sigma = last[name]
        if first_sigma is not None and last_sigma is not None:
            sigmas[name] = max(first_sigma, last_sigma)
    return sigmas


def _scale_positions(positions: Any, factor: float) -> Any:  # noqa: ANN401 - an array or positions by target
    """Return positions, an array or arrays by target, times a factor; None for None."""
    if isinstance(positions, Mapping):
        return {name: factor * np.asarray(each, dtype=np.float64) for name, each in positions.items()}
    return None if positions is None else factor * np.asarray(positions, dtype=np.float64)


def _parse_options(options: Mapping[str, Any], goal: Goal) -> dict[str, Any]:
    """Validate options of a live measurement; return those that are not None, with parsed values."""
    stated = {name: value for name, value in options.items() if value is not None}
    message = parse_document({**stated, "goal": goal}, LiveOptions)
    return {name: getattr(message, name) for name in stated}


def _robot_and_campaign(source: Any) -> tuple[RobotDocument, Campaign | None]:  # noqa: ANN401 - robot, campaign or run
    """Return (robot, campaign) of a source; the campaign is None if the source is only a robot."""
    from jointstiff.schemas import run as messages
    from jointstiff.service.library import robots
    from jointstiff.service.library.results import TabledRun

    if isinstance(source, TabledRun):
        source = source.campaign
    source = read_plan_source(source)
    if isinstance(source, messages.Campaign):
        return source.robot, Campaign.from_message(source)
    return robots.robot(source), None
