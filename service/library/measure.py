"""Measure live: one reading after the other until a declared goal is reached, here or over a service."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Coroutine, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Literal, Self, TypeVar, cast
from urllib.parse import quote

import numpy as np

from jointstiff.schemas.fields import Message
from jointstiff.schemas.live import (
    LiveOptions,
    LiveReading,
    LiveState,
    MeasurementSetPost,
)
from jointstiff.schemas.measurement import MeasurementSetDocument, Observation, SetChange
from jointstiff.schemas.options import OwnWeight, RunOptions
from jointstiff.schemas.plan import Goal, PlannedReading
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import (
    PreparedRobot,
    prepare_robot,
    read_stated_transform,
    resolve_stated_frame,
)
from jointstiff.service.library.campaigns import Campaign
from jointstiff.service.live.campaign import MOST_READINGS, Declaration, Entry, LiveCampaign
from jointstiff.service.live.declaration import Scales, declare_set, read_goal
from jointstiff.service.live.sources import (
    PATIENCE,
    CheckedSource,
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

if TYPE_CHECKING:
    from jointstiff.service.library.client import Client
    from jointstiff.service.library.results import TabledRun

T = TypeVar("T")
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

    def confirms(self, profile: str) -> bool:  # noqa: ARG002 - others read it
        """Return whether a text, `profile`, describes correctly how the lines of a source are read."""
        return True

    def ready(self, following: PlannedReading, *, loaded: bool) -> Literal["read", "skip", "stop"]:  # noqa: ARG002
        """Wait until the arm is in the next posture, with or without load; return what to do then."""
        return "read"

    def on_reading(self, state: LiveState, reading: LiveReading) -> None:
        """Show a reading and the state after it; this base class shows nothing."""

    def doubts(self, reading: LiveReading, *, again: bool) -> Literal["again", "keep"]:  # noqa: ARG002
        """Return whether to read a doubtful reading again or keep it; `again`: it was read again before."""
        return "keep" if again else "again"

    def doubts_earlier(self, reading: LiveReading, *, again: bool) -> Literal["withdraw", "keep"]:  # noqa: ARG002
        """Return whether to withdraw or keep an earlier reading that later readings show to be a mistake.

        `again`: another reading was withdrawn for this reason before.
        """
        return "keep" if again else "withdraw"

    def missed(self, error: Exception, *, again: bool) -> Literal["again", "skip", "stop"]:
        """Return what to do after a source gave no reading; `again`: it failed before for this reading.

        This base class tries once more, and then raises the error.
        """
        if again:
            raise error
        return "again"


class _SetInProcess:
    """Measurement set that is measured live, kept in this process."""

    def __init__(self, robot: PreparedRobot, post: MeasurementSetPost, run: RunOptions) -> None:
        """Begin without readings; `post` declares goal, load and targets; `run` has the run's options."""
        self._document, self._run = robot.document, run
        with as_campaign_error("measurement_set"):
            resolved = resolve_stated_frame(post)
        with as_campaign_error(""):
            self._campaign = LiveCampaign(Declaration(robot.robot, post, resolved))
            # Computed now to raise an error for what cannot be measured.
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

        with as_campaign_error(""):
            fields = self._campaign.fields_when_closed()
        if not self._campaign.closed:
            self._campaign = self._campaign.with_entry(Entry("closed", ""))
        kept = {name: fields[name] for name in MeasurementSetDocument.model_fields}
        options = {name: value for name, value in self._campaign.run_options.items() if value}
        run = self._run.model_copy(update=options)
        campaign = Campaign(
            robot=self._document, measurement_set=MeasurementSetDocument.model_validate(kept), run=run
        )
        return Here().identify(campaign), self.state()


class _SetInService:
    """Measurement set that is measured live, kept by a service."""

    def __init__(self, client: Client, robot: RobotDocument, post: MeasurementSetPost) -> None:
        """Store robot and measurement set in the service; `post` declares goal, load and targets."""
        self._client = client
        body = post.model_copy(update={"robot_id": client.described(robot)})
        text = body.model_dump_json(exclude_unset=True)
        answer = client.send("POST", "/v1/measurement-sets", None, text)
        self.id = str(json.loads(answer.content)["id"])
        self._path = f"/v1/measurement-sets/{quote(self.id, safe='')}"

    def _request_state(self, verb: str, path: str, document: Message | str | None = None) -> LiveState:
        """Send a request about the set to the service; return the state in its answer."""
        from jointstiff.service.library.client import parse_resource

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


class _SourceThread:
    """Thread with an event loop, in which a source can receive data between readings."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="source", daemon=True)
        self._thread.start()

    def do(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine in the thread; wait for its end and return its value."""
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def close(self) -> None:
        """Stop the event loop and end the thread."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        # One more turn of the loop lets connections end that were just closed.
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
    ) -> None:
        """Begin a live measurement; called by `jointstiff.measure` and `Client.measure`.

        `wait` is the time after which a silent source has stopped [s].
        """
        self._set, self._robot, self._post = measured_set, robot.robot, post
        self._options = cast("LiveOptions", post.open)
        self._scales = Scales.from_units(post.units, robot.robot)
        self.source, self._wait = source, wait
        self.joint_names, self.joint_kinds = robot.robot.joint_names, robot.robot.joint_kinds
        self._loop: _SourceThread | None = None
        self._checked: CheckedSource | None = None
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
        """Number of readings that were not withdrawn."""
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
        """Add a reading, compare it with the others, and return the state that follows from all readings.

        Args:
            unloaded: positions without load [m], by target or (T, 3) in the order of the targets; in R0, or
                in the frame of the campaign.
            loaded: positions under load in the same form; None for readings by the robot's own weight.
            label: label of the reading; default: the label of the next planned reading.
            joints: (n,) joint values as the controller shows them [rad or m]; default: as planned.
            force: (3,) force on the robot, axes of R0 [N]; default: as planned.
            sigma: standard uncertainty of a coordinate by target [m], where the campaign states none.

        Raises:
            CampaignError: the reading cannot be right, or another reading has this label.
            RefusedError: the service refuses the reading.
        """
        planned, scales = self.next, self._scales
        if planned is None and (label is None or joints is None or force is None):
            remedy = "give `label`, `joints` and `force` of the reading"
            raise CampaignError(http_problem(422, "no planned reading is left", remedy))
        angles = np.asarray(planned.joints if joints is None and planned else joints, dtype=np.float64)
        force_newtons = np.asarray(planned.force if force is None and planned else force, dtype=np.float64)
        unloaded_by_target = self._positions_by_target(unloaded)
        loaded_by_target = self._positions_by_target(loaded)
        readings = [
            {
                "target": name,
                "unloaded": place,
                **({"loaded": loaded_by_target[name]} if name in loaded_by_target else {}),
                **({"sigma": sigma[name] / scales.length} if sigma and name in sigma else {}),
            }
            for name, place in unloaded_by_target.items()
        ]
        document = {
            "label": label or (planned.label if planned else ""),
            "joints": (angles / np.array(scales.joints)).tolist(),
            "force": (force_newtons / scales.force).tolist(),
            "readings": readings,
        }
        self.state = self._set.observe(parse_document(document, Observation))
        return self.state

    def withdraw(self, label: str, reason: str) -> LiveState:
        """Withdraw a reading for a stated reason: the estimate ignores it, the record still shows it."""
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
        if self._loop is not None:
            if self._checked is not None:
                self._loop.do(self._checked.close())
            self._loop.close()
            self._loop = self._checked = None

    def _send_change(self, change: dict[str, Any]) -> LiveState:
        """Apply a change to the measurement set, such as to withdraw a reading; return the new state."""
        self.state = self._set.change(parse_document(change, SetChange))
        return self.state

    def _positions_by_target(self, places: Any) -> dict[str, list[float]]:  # noqa: ANN401 - arrays or positions by target
        """Return positions by target, in the units of the set.

        `places` [m] are a dictionary by target, or rows (T, 3) in the order of the targets; None: no entries.
        """
        if places is None:
            return {}
        names = self._options.targets
        named = places if isinstance(places, Mapping) else dict(zip(names, places, strict=True))
        return {
            str(name): (np.asarray(place, dtype=np.float64) / self._scales.length).tolist()
            for name, place in named.items()
        }

    def _make_source_setting(self) -> Setting:
        """Return what a source needs: robot, targets, load point [m], sigma [m], and the frame in R0."""
        post, options = self._post, self._options
        length = self._scales.length
        targets, point = options.targets, options.load_point or (0.0, 0.0, 0.0)
        noise = post.noise.sigma if post.noise is not None else None
        sigma = length * noise if noise else options.sigma or _SIMULATED_SIGMA
        if post.frame is None or post.frame.rotation is None:
            return Setting(self._robot, targets, point, sigma)
        transform = read_stated_transform(post.frame, length)
        return Setting(
            self._robot, targets, point, sigma, (transform.rotation, np.asarray(transform.translation))
        )

    def _open_source(self) -> None:
        """Open the source in a thread of its own, unless it is open.

        Raises:
            RequestError: the campaign has no source, or the source cannot give its readings.
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
        if self._loop is not None:
            return
        self._loop = _SourceThread()
        self._checked = CheckedSource(self.source, self._make_source_setting(), self._wait)
        try:
            self._loop.do(self._checked.open())
        except BaseException:
            self.release_source()
            raise

    def _read_posture(self, planned: PlannedReading, person: Person) -> Literal["read", "skip", "stop"]:
        """Read a posture until its reading is kept; return `read`, or the person's decision to skip or stop.

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
        """Ask the person about earlier readings that later ones have made doubtful; withdraw or keep each."""
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
        """Read a posture without and with load, and add the reading.

        Return `read`, or the person's decision to skip the posture or to stop. With the robot's own weight as
        load, read the posture once.
        """
        loop, checked = cast("_SourceThread", self._loop), cast("CheckedSource", self._checked)
        positions: list[dict[str, Point]] = []
        for loaded in (False,) if isinstance(self._options.load, OwnWeight) else (False, True):
            answer = person.ready(planned, loaded=loaded)
            if answer != "read":
                return answer
            posture = Stand(planned.label, tuple(planned.joints), planned.force, loaded)
            self._confirm_line_format(posture, person)
            positions.append(loop.do(checked.read(posture)))
        unloaded, loaded_or_unloaded = positions[0], positions[-1]
        sigma: dict[str, float] = {}
        if self._post.noise is None or self._post.noise.sigma is None:
            # A reading has one uncertainty for both of its positions: the greater of the two is stated.
            stated = {name: (unloaded[name][1], loaded_or_unloaded[name][1]) for name in unloaded}
            sigma = {name: max(u, v) for name, (u, v) in stated.items() if u is not None and v is not None}
        places = [{name: place for name, (place, _) in part.items()} for part in positions]
        self.observe(
            *places,
            label=planned.label,
            joints=planned.joints,
            force=planned.force,
            sigma=sigma,
        )
        return "read"

    def _confirm_line_format(self, posture: Stand, person: Person) -> None:
        """Let a person confirm, before the first reading, how the lines of the source are read.

        Raises:
            RequestError: the person does not confirm it.
        """
        if self._confirmed:
            return
        profile = cast("_SourceThread", self._loop).do(cast("CheckedSource", self._checked).profile(posture))
        if profile is not None and not person.confirms(profile):
            raise RequestError(
                "nobody confirmed how the lines are read",
                where="source",
                remedy="state the form of the lines by `columns` or `pattern`, and the unit by `source_unit`",
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
    client: Client | None = None,
    source_options: Mapping[str, Any] | None = None,
    **options: Any,  # noqa: ANN401 - fields of LiveOptions
) -> LiveMeasurement:
    """Begin a live measurement: a campaign that is measured until a declared goal is reached.

    Args:
        robot: to begin with a robot: a document, a file, or the name of an arm of the catalogue, with `load`
            and `targets`. Or a campaign, its file or a run: its robot, loads, targets, noise and load point
            are taken, its readings are not.
        goal: "15 %" of every joint that the load twists; "6 um" of the deflection in the work area; "below
            0.5 mm", a decision about it; or a goal as in the API.
        source: `simulated:SEED`, `lines:/dev/ttyUSB0`, `lines:tcp://host:port`, `lines:udp://:port`,
            `robodk`, another one by the entry points `jointstiff.sources`, or an object with ``async def
            point(name)``. Without one, readings come by `observe`.
        force: (3,) force in the work area, axes of R0 [N]; default: the force of the load.
        timeout: seconds after which a source that sends nothing has stopped.
        client: client of the service that keeps the open set; default: this process keeps it.
        source_options: options of the source `lines`: `columns` or `pattern`, `source_unit`, `request`,
            `baud`, `sample`.
        options: fields of `LiveOptions` in SI units, such as `load`, `targets`, `work_area` (or `area`),
            `load_point`, `sigma`, `surroundings`, `candidates`, `seed`. A load may be a text, such as
            "dead_weight:1500".

    Raises:
        CampaignError: robot, goal or an option cannot be used; its `problem` says what, where and what to do.
        RefusedError: the service refuses the request.
        OSError: a file cannot be read.
    """
    from jointstiff.schemas.fields import parse_planned_load

    if isinstance(options.get("load"), str):
        options["load"] = parse_planned_load(options["load"])
    named = {_FULL_NAMES.get(name, name): value for name, value in options.items()}
    measured, campaign = _robot_and_campaign(robot)
    with as_campaign_error(""):
        area_force = None if force is None else tuple(np.asarray(force, dtype=np.float64).tolist())
        stated = read_goal(goal, cast("Any", area_force))
        prepared = prepare_robot(measured)
        document = None if campaign is None else campaign.measurement_set
        run = RunOptions() if campaign is None else RunOptions(confidence=campaign.run.confidence)
        weight = None if campaign is None else campaign.run.weight
        post = declare_set(prepared, document, stated, _parse_options(named, stated), weight)
        reader = make_source(source, source_options or {}) if isinstance(source, str) else source
    measured_set = (
        _SetInProcess(prepared, post, run) if client is None else _SetInService(client, measured, post)
    )
    return LiveMeasurement(measured_set, prepared, post, reader, timeout)


def _parse_options(options: Mapping[str, Any], goal: Goal) -> dict[str, Any]:
    """Validate options of a live measurement; return those that are not None, with parsed values."""
    stated = {name: value for name, value in options.items() if value is not None}
    message = parse_document({**stated, "goal": goal}, LiveOptions)
    return {name: getattr(message, name) for name in stated}


def _robot_and_campaign(source: Any) -> tuple[RobotDocument, Campaign | None]:  # noqa: ANN401 - robot, campaign or run
    """Return the robot of a source, and the campaign if the source is a campaign or a run; else None."""
    from jointstiff.schemas import run as messages
    from jointstiff.service.library import robots
    from jointstiff.service.library.results import TabledRun

    if isinstance(source, TabledRun):
        source = source.campaign
    source = read_plan_source(source)
    if isinstance(source, messages.Campaign):
        return source.robot, Campaign.from_message(source)
    return robots.robot(source), None
