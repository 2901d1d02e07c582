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
    own_frame,
    prepare_robot,
    stated_transform,
)
from jointstiff.service.library.campaigns import Campaign
from jointstiff.service.live.campaign import MOST_READINGS, Declared, Entry, LiveCampaign
from jointstiff.service.live.declaration import Scales, declared, goal_of
from jointstiff.service.live.sources import (
    PATIENCE,
    Checked,
    Point,
    Setting,
    Source,
    SourceError,
    Stand,
    source_of,
)
from jointstiff.service.problems import (
    AwayError,
    CampaignError,
    ProblemError,
    as_campaign_error,
    http_problem,
)
from jointstiff.service.resources.documents import parse_document, read_planned
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from jointstiff.service.library.client import Client
    from jointstiff.service.library.results import TabledRun

T = TypeVar("T")
_SIGMA: Final = 2e-5
"""Noise of a simulated tracker where none is stated [m]."""
_AGAIN: Final = "doubtful; read again"
_SHOWN: Final = "a mistake, as later readings show"
_PLAIN: Final = {"area": "work_area"}
"""Shorter names of options."""


class Person:
    """The person at the robot: asked before readings, when one is doubtful, and when there is none.

    This one is nobody: it goes on, reads a doubtful posture again once and then keeps it, withdraws one
    earlier mistake and keeps others, and asks a source that failed once more.
    """

    def confirms(self, profile: str) -> bool:  # noqa: ARG002 - others read it
        """Return whether the readings of a source are understood so."""
        return True

    def ready(self, following: PlannedReading, *, loaded: bool) -> Literal["read", "skip", "stop"]:  # noqa: ARG002
        """Return what to do once the arm is in a posture, with or without its load."""
        return "read"

    def on_reading(self, state: LiveState, reading: LiveReading) -> None:
        """Hear what a reading says."""

    def doubts(self, reading: LiveReading, *, again: bool) -> Literal["again", "keep"]:  # noqa: ARG002
        """Return what becomes of a doubtful reading, read again already or not."""
        return "keep" if again else "again"

    def doubts_earlier(self, reading: LiveReading, *, again: bool) -> Literal["withdraw", "keep"]:  # noqa: ARG002
        """Return what becomes of an earlier reading that is a mistake by now, the first such one or not."""
        return "keep" if again else "withdraw"

    def missed(self, error: Exception, *, again: bool) -> Literal["again", "skip", "stop"]:
        """Return what to do where a source has no reading; nobody lets a second failure pass."""
        if again:
            raise error
        return "again"


class _Here:
    """An open set in this process."""

    def __init__(self, robot: PreparedRobot, post: MeasurementSetPost, run: RunOptions) -> None:
        self._document, self._run = robot.document, run
        with as_campaign_error("measurement_set"):
            resolved = own_frame(post)
        with as_campaign_error(""):
            self._campaign = LiveCampaign(Declared(robot.robot, post, resolved))
            _ = self._campaign.declared.ahead  # refuses what cannot be measured

    def state(self) -> LiveState:
        return self._campaign.state()

    def observe(self, observation: Observation) -> LiveState:
        with as_campaign_error(""):
            self._campaign = self._campaign.with_entry(self._campaign.judged(observation))
        return self.state()

    def change(self, change: SetChange) -> LiveState:
        with as_campaign_error(""):
            for entry in self._campaign.entries_of(change):
                self._campaign = self._campaign.with_entry(entry)
        return self.state()

    def close(self) -> tuple[TabledRun, LiveState]:
        from jointstiff.service.library.here import Here

        with as_campaign_error(""):
            fields = self._campaign.closing()
        if not self._campaign.closed:
            self._campaign = self._campaign.with_entry(Entry("closed", ""))
        kept = {name: fields[name] for name in MeasurementSetDocument.model_fields}
        options = {name: value for name, value in self._campaign.run_options.items() if value}
        run = self._run.model_copy(update=options)
        campaign = Campaign(
            robot=self._document, measurement_set=MeasurementSetDocument.model_validate(kept), run=run
        )
        return Here().identify(campaign), self.state()


class _There:
    """An open set of a service."""

    def __init__(self, client: Client, robot: RobotDocument, post: MeasurementSetPost) -> None:
        self._client = client
        body = post.model_copy(update={"robot_id": client.described(robot)})
        text = body.model_dump_json(exclude_unset=True)
        answer = client.send("POST", "/v1/measurement-sets", None, text)
        self.id = str(json.loads(answer.content)["id"])
        self._path = f"/v1/measurement-sets/{quote(self.id, safe='')}"

    def _state_in(self, verb: str, path: str, document: Message | str | None = None) -> LiveState:
        from jointstiff.service.library.client import resource_in

        answer = self._client.send(verb, f"{self._path}{path}", None, document)
        return resource_in(answer, LiveState)

    def state(self) -> LiveState:
        return self._state_in("GET", "/next")

    def observe(self, observation: Observation) -> LiveState:
        return self._state_in("POST", "/observations", observation)

    def change(self, change: SetChange) -> LiveState:
        self._client.send("PATCH", self._path, None, change)
        return self.state()

    def close(self) -> tuple[TabledRun, LiveState]:
        state = self._state_in("POST", "/close", "{}")
        run = self._client.runs.wait(self._client.runs.get(str(state.run_id)))
        return run, state


class _Loop:
    """A thread in which a source waits for what comes, while nobody asks."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="source", daemon=True)
        self._thread.start()

    def do(self, work: Coroutine[Any, Any, T]) -> T:
        """Return what a coroutine returns."""
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def close(self) -> None:
        """End the thread."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.run_until_complete(asyncio.sleep(0))  # connections that were just closed
        self._loop.close()


class LiveMeasurement:
    """A campaign while it is measured, here or over a service.

    ::

        with js.measure("campaign.json", goal="15 %", source="simulated:1") as campaign:
            campaign.run_source()
        print(campaign.run)

    Left as a context manager it lets go of its source; the set stays open until `close`.
    """

    def __init__(
        self,
        place: _Here | _There,
        robot: PreparedRobot,
        post: MeasurementSetPost,
        source: Source | None,
        wait: float,
    ) -> None:
        """Begin; `jointstiff.measure` and `Client.measure` do."""
        self._place, self._robot, self._post = place, robot.robot, post
        self._options = cast("LiveOptions", post.open)
        self._scales = Scales.of(post.units, robot.robot)
        self.source, self._wait = source, wait
        self.joint_names, self.joint_kinds = robot.robot.joint_names, robot.robot.joint_kinds
        self._loop: _Loop | None = None
        self._checked: Checked | None = None
        self._confirmed = False
        self.state = place.state()  #: what the readings say so far, and what is next
        self.run: TabledRun | None = None  #: the run, once the campaign is closed
        self.robot = robot.document  #: that is measured
        #: state before it was closed
        self.outcome: LiveState = self.state

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.let_go()

    def __repr__(self) -> str:
        """Return goal and standing."""
        return f"<LiveMeasurement of '{self.robot.name}': {self.state.goal}; {self.state.message}>"

    @property
    def next(self) -> PlannedReading | None:
        """Next reading, in SI units; None if nothing is left."""
        return self.state.next

    @property
    def count(self) -> int:
        """Number of readings that count."""
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
        """Take in a reading, compare it with the others, and return what all of them say.

        Args:
            unloaded: positions without load [m], by target or as (T, 3) in their order; R0, or the frame of
                the campaign.
            loaded: the same under load; None for the robot's own weight.
            label: of the reading; default: that of the next one.
            joints: (n,) as the controller shows them [rad or m]; default: those of the next reading.
            force: (3,) on the robot, axes of R0 [N]; default: that of the next reading.
            sigma: standard uncertainty of a coordinate by target [m], where the campaign states none.

        Raises:
            CampaignError: the reading cannot be right, or the label is taken.
            RefusedError: the service refuses it.
        """
        following, scales = self.next, self._scales
        if following is None and (label is None or joints is None or force is None):
            remedy = "give `label`, `joints` and `force`"
            raise CampaignError(http_problem(422, "nothing is left to read", remedy))
        angles = np.asarray(following.joints if joints is None and following else joints, dtype=np.float64)
        newtons = np.asarray(following.force if force is None and following else force, dtype=np.float64)
        before, after = self._places(unloaded), self._places(loaded)
        readings = [
            {
                "target": name,
                "unloaded": place,
                **({"loaded": after[name]} if name in after else {}),
                **({"sigma": sigma[name] / scales.length} if sigma and name in sigma else {}),
            }
            for name, place in before.items()
        ]
        document = {
            "label": label or (following.label if following else ""),
            "joints": (angles / np.array(scales.joints)).tolist(),
            "force": (newtons / scales.force).tolist(),
            "readings": readings,
        }
        self.state = self._place.observe(parse_document(document, Observation))
        return self.state

    def withdraw(self, label: str, reason: str) -> LiveState:
        """Let a reading count no more, and say why; it stays in the record."""
        return self._send_change({"withdrawn": {label: reason}})

    def keep(self, label: str) -> LiveState:
        """Let the doubtful reading of a label count, because it is right."""
        return self._send_change({"kept": [label]})

    def skip(self) -> LiveState:
        """Leave the next posture out; another one is chosen."""
        return self.state if self.next is None else self._send_change({"skipped": self.next.label})

    def run_source(self, person: Person | None = None, most: int = MOST_READINGS) -> LiveState:
        """Read by the source until the goal is reached, cannot be, or there are as many readings.

        Args:
            person: asked on the way; default: nobody, a doubtful posture is read again once and then kept.
            most: number of readings after which it ends.

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
        """Make an ordinary measurement set of the readings, and return its run.

        Raises:
            CampaignError: no reading counts.
            RefusedError: the service refuses it.
        """
        self.let_go()
        if self.run is None:
            self.outcome = self.state
            self.run, self.state = self._place.close()
        return self.run

    @property
    def campaign(self) -> Campaign:
        """Close the measurement; return its campaign, with the declared goal and the outcome in its notes."""
        return self.close().campaign

    def let_go(self) -> None:
        """Let go of the source."""
        if self._loop is not None:
            if self._checked is not None:
                self._loop.do(self._checked.close())
            self._loop.close()
            self._loop = self._checked = None

    def _send_change(self, change: dict[str, Any]) -> LiveState:
        self.state = self._place.change(parse_document(change, SetChange))
        return self.state

    def _places(self, places: Any) -> dict[str, list[float]]:  # noqa: ANN401 - arrays or positions by target
        """Return positions by target in the units of the set."""
        if places is None:
            return {}
        names = self._options.targets
        named = places if isinstance(places, Mapping) else dict(zip(names, places, strict=True))
        return {
            str(name): (np.asarray(place, dtype=np.float64) / self._scales.length).tolist()
            for name, place in named.items()
        }

    def _setting(self) -> Setting:
        post, options = self._post, self._options
        length = self._scales.length
        targets, point = options.targets, options.load_point or (0.0, 0.0, 0.0)
        noise = post.noise.sigma if post.noise is not None else None
        sigma = length * noise if noise else options.sigma or _SIGMA
        if post.frame is None or post.frame.rotation is None:
            return Setting(self._robot, targets, point, sigma)
        transform = stated_transform(post.frame, length)
        return Setting(
            self._robot, targets, point, sigma, (transform.rotation, np.asarray(transform.translation))
        )

    def _open_source(self) -> None:
        if self.source is None:
            raise RequestError(
                "the campaign has no source", where="source", remedy='give one, such as source="simulated:1"'
            )
        if isinstance(self._options.load, OwnWeight) and self.source.by_itself:
            raise RequestError(
                "a simulated source bends by loads only",
                where="source",
                remedy="give a load, such as dead_weight:1500",
            )
        if self._loop is not None:
            return
        self._loop = _Loop()
        self._checked = Checked(self.source, self._setting(), self._wait)
        try:
            self._loop.do(self._checked.open())
        except BaseException:
            self.let_go()
            raise

    def _read_posture(
        self, following: PlannedReading, person: Person
    ) -> Literal["read", "again", "skip", "stop"]:
        """Read a posture, again where it is doubtful; return what became of it, or what to do instead."""
        missed = doubted = False
        while True:
            answer: Literal["read", "again", "skip", "stop"]
            try:
                answer = self._read_once(following, person)
            except AwayError:
                raise
            except (SourceError, ProblemError) as error:
                answer, missed = person.missed(error, again=missed), True
            if answer == "again":
                continue
            if answer != "read":
                return answer
            reading = self.state.readings[-1]
            person.on_reading(self.state, reading)
            self._settle_earlier(person)
            if reading.state != "doubtful":
                return answer
            if person.doubts(reading, again=doubted) == "keep":
                self.keep(reading.label)
                return answer
            self.withdraw(reading.label, _AGAIN)
            missed, doubted = False, True
            label = f"m{1 + len(self.state.readings):02d}"
            following = following.model_copy(update={"label": label})

    def _settle_earlier(self, person: Person) -> None:
        """Ask about earlier readings that turn out to be mistakes; what is missing then comes next."""
        readings = self.state.readings
        before = any(each.reason == _SHOWN for each in readings)
        for earlier in readings[:-1]:
            if earlier.state == "doubtful":
                person.on_reading(self.state, earlier)
                if person.doubts_earlier(earlier, again=before) == "keep":
                    self.keep(earlier.label)
                else:
                    self.withdraw(earlier.label, _SHOWN)

    def _read_once(self, following: PlannedReading, person: Person) -> Literal["read", "skip", "stop"]:
        """Read a posture without and with its load, and take the reading in; or return what to do instead."""
        loop, checked = cast("_Loop", self._loop), cast("Checked", self._checked)
        parts: list[dict[str, Point]] = []
        for loaded in (False,) if isinstance(self._options.load, OwnWeight) else (False, True):
            answer = person.ready(following, loaded=loaded)
            if answer != "read":
                return answer
            stand = Stand(following.label, tuple(following.joints), following.force, loaded)
            self._confirm(stand, person)
            parts.append(loop.do(checked.read(stand)))
        unloaded, loaded_ = parts[0], parts[-1]
        sigma: dict[str, float] = {}
        if self._post.noise is None or self._post.noise.sigma is None:
            # of both positions the greater one
            stated = {name: (unloaded[name][1], loaded_[name][1]) for name in unloaded}
            sigma = {name: max(u, v) for name, (u, v) in stated.items() if u is not None and v is not None}
        places = [{name: place for name, (place, _) in part.items()} for part in parts]
        self.observe(
            *places,
            label=following.label,
            joints=following.joints,
            force=following.force,
            sigma=sigma,
        )
        return "read"

    def _confirm(self, stand: Stand, person: Person) -> None:
        """Let a person confirm how the first reading is understood.

        Raises:
            RequestError: nobody does.
        """
        if self._confirmed:
            return
        profile = cast("_Loop", self._loop).do(cast("Checked", self._checked).profile(stand))
        if profile is not None and not person.confirms(profile):
            raise RequestError(
                "nobody confirmed how the lines are read",
                where="source",
                remedy="state their form by `columns` or `pattern`, and their unit",
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
    """Begin a campaign that is measured until a declared goal is reached.

    Args:
        robot: to begin with a robot: a document, a file, or the name of an arm of the catalogue, with `load`
            and `targets`. Or a campaign, its file or a run: its robot, loads, targets, noise and load point
            are taken, its readings are not.
        goal: "15 %" of every joint that the load twists; "6 um" of the deflection in the work area; "below
            0.5 mm", a decision about it; or a goal as in the API.
        source: `simulated:SEED`, `lines:/dev/ttyUSB0`, `lines:tcp://host:port`, `lines:udp://:port`,
            `robodk`, another one by the entry points `jointstiff.sources`, or an object with ``async def
            point(name)``. Without one, readings come by `observe`.
        force: (3,) in the work area, axes of R0 [N]; default: that of the load.
        timeout: seconds after which a source that sends nothing has stopped.
        client: service that keeps the open set; default: this process. `Client.measure` gives it.
        source_options: of `lines`: `columns` or `pattern`, `source_unit`, `request`, `baud`, `sample`.
        options: fields of `LiveOptions` in SI units, such as `load`, `targets`, `work_area` (or `area`),
            `load_point`, `sigma`, `surroundings`, `candidates`, `seed`. A load may be a text, such as
            "dead_weight:1500".

    Raises:
        CampaignError: robot, goal or an option cannot be used; its `problem` says what, where and what to do.
        RefusedError: the service refuses it.
        OSError: a file cannot be read.
    """
    from jointstiff.schemas.fields import planned_load_of

    if isinstance(options.get("load"), str):
        options["load"] = planned_load_of(options["load"])
    named = {_PLAIN.get(name, name): value for name, value in options.items()}
    measured, campaign = _robot_and_campaign(robot)
    with as_campaign_error(""):
        towards = None if force is None else tuple(np.asarray(force, dtype=np.float64).tolist())
        stated = goal_of(goal, cast("Any", towards))
        prepared = prepare_robot(measured)
        document = None if campaign is None else campaign.measurement_set
        run = RunOptions() if campaign is None else RunOptions(confidence=campaign.run.confidence)
        weight = None if campaign is None else campaign.run.weight
        post = declared(prepared, document, stated, _parse_options(named, stated), weight)
        reader = source_of(source, source_options or {}) if isinstance(source, str) else source
    place = _Here(prepared, post, run) if client is None else _There(client, measured, post)
    return LiveMeasurement(place, prepared, post, reader, timeout)


def _parse_options(options: Mapping[str, Any], goal: Goal) -> dict[str, Any]:
    """Return options that are checked, with those that were stated."""
    stated = {name: value for name, value in options.items() if value is not None}
    message = parse_document({**stated, "goal": goal}, LiveOptions)
    return {name: getattr(message, name) for name in stated}


def _robot_and_campaign(source: Any) -> tuple[RobotDocument, Campaign | None]:  # noqa: ANN401 - robot, campaign or run
    """Return the robot, and the campaign if it is one."""
    from jointstiff.schemas import run as messages
    from jointstiff.service.library import robots
    from jointstiff.service.library.results import TabledRun

    if isinstance(source, TabledRun):
        source = source.campaign
    source = read_planned(source)
    if isinstance(source, messages.Campaign):
        return source.robot, Campaign.of(source)
    return robots.robot(source), None
