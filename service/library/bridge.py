"""The terminal's side of a bridge: a tracker's positions go to the page that shows the reading."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from itertools import islice
from typing import Any, Final
from urllib.parse import quote

import numpy as np
from pydantic import TypeAdapter, ValidationError

from jointstiff.schemas.bridge import (
    MAX_NAMES,
    MAX_TROUBLE_LENGTH,
    Bridge,
    BridgeCode,
    BridgePoints,
    BridgeStand,
    BridgeTask,
)
from jointstiff.schemas.fields import Name
from jointstiff.schemas.live import MeasurementSet
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.library.answers import parse_resource
from jointstiff.service.library.client import Client
from jointstiff.service.library.measure import SourceThread
from jointstiff.service.live.declaration import Scales
from jointstiff.service.live.sources import CheckedSource, Place, Setting, SourceError, Stand, make_source
from jointstiff.service.problems import (
    AwayError,
    CampaignError,
    RefusedError,
    as_campaign_error,
    http_problem,
)
from jointstiff.solver.mechanics.robot import Robot

_POST_SECONDS: Final = 0.4
"""Pause after a post [s]."""
_ALIVE_SECONDS: Final = 0.6
"""Time without new positions after which a post says that the command is still there [s]."""
_ROUND_SECONDS: Final = 0.2
"""Shortest time for a round of all targets [s]: some sources answer each request at once."""
_TROUBLE_SECONDS: Final = 1.0
"""Pause before the source is read again after an error [s]."""
_NOT_FOUND: Final = 404


class TrackerBridge:
    """A source of readings joined to a page: the page says what to read, and shows what was read."""

    def __init__(
        self,
        client: Client,
        code: str,
        source: str,
        *,
        source_options: Mapping[str, Any] | None = None,
        warn: Callable[[str], object] = lambda _: None,
    ) -> None:
        """Join the page that shows a code.

        Args:
            client: client of the page's service.
            code: code that the page shows.
            source: source of readings as of `jointstiff.measure`.
            source_options: options of a source of lines.
            warn: function called with messages for the person at the terminal.

        Raises:
            CampaignError: the source cannot be used.
            RefusedError: the service refuses the code.
        """
        self._client, self._warn = client, warn
        with as_campaign_error(""):
            self._source = make_source(source, source_options or {})
        answer = client.send("POST", "/v1/bridges", None, BridgeCode(code=code))
        self.bridge = parse_resource(answer, Bridge)
        measured_set = client.measurement_sets.get(self.bridge.set_id)
        self.name = measured_set.name
        with as_campaign_error("robot"):
            robot = prepare_robot(client.robots.get(measured_set.robot_id)).robot
        # Somebody has to walk to the target first, so the source is waited for without end.
        self._checked = CheckedSource(self._source, _make_setting(measured_set, robot), None)
        self._reading = BridgePoints()  # set by the thread of the source; a message never changes itself
        self._changed = threading.Event()

    def run(self) -> None:
        """Send positions until the page ends the bridge, or its set is closed.

        Raises:
            SourceError: the source cannot be reached.
            RefusedError: the service refuses a position.
        """
        loop = SourceThread()
        task: Future[None] | None = None  # reads in the stand that the page shows
        stand: BridgeStand | None = None
        try:
            loop.run_coroutine(self._checked.open())
            if (profile := loop.run_coroutine(self._checked.profile())) is not None:
                self._warn(profile)
            while (asked := self._exchange()) is not None:
                if asked.stand != stand:
                    stand = asked.stand
                    if task is not None:
                        task.cancel()
                    task = None if stand is None else loop.start_coroutine(self._read_on(stand))
                if task is not None and task.done():
                    task.result()  # raises the error that ended the task
        finally:
            if task is not None:
                task.cancel()
            loop.run_coroutine(self._checked.close())
            loop.close()

    def _exchange(self) -> BridgeTask | None:
        """Send the next positions when there are some, or after a while; return what the page wants then.

        Return None if the bridge has ended.
        """
        self._changed.wait(_ALIVE_SECONDS)
        self._changed.clear()
        read = self._reading
        unknown = self._unknown_points()
        task = self._post(
            BridgePoints(number=read.number, points=read.points, unknown=unknown, trouble=read.trouble)
        )
        time.sleep(_POST_SECONDS)
        return task

    def _unknown_points(self) -> dict[str, Place]:
        """Return the last positions [m] of names that are no targets; the page asks for their targets."""
        points = {name: place for name, place in self._checked.unknown.items() if _is_name(name)}
        return dict(islice(points.items(), MAX_NAMES))

    def _post(self, reading: BridgePoints) -> BridgeTask | None:
        """Send the last positions; return what the page wants, None if the bridge has ended.

        While the service is away, wait for it.
        """
        path = f"/v1/bridges/{quote(self.bridge.id, safe='')}/points"
        while True:
            try:
                return parse_resource(
                    self._client.send("POST", path, None, reading.model_dump_json()), BridgeTask
                )
            except AwayError as error:
                self._warn(f"{error.problem.detail}; waiting for the service")
            except RefusedError as refused:
                if refused.problem.status == _NOT_FOUND:
                    return None
                raise

    async def _read_on(self, asked: BridgeStand) -> None:
        """Read the targets in a stand of the page again and again, until this task is cancelled."""
        stand, number = Stand(asked.label, tuple(asked.joints), asked.force, asked.loaded), asked.number
        self._warn(f"{asked.label}: reading {'with the load' if asked.loaded else 'without load'}")
        self._checked.rename(asked.names)
        self._put(BridgePoints(number=number))

        def take(name: str, place: Place) -> None:
            """Put a position into the reading; a position ends the trouble."""
            self._put(BridgePoints(number=number, points={**self._reading.points, name: place}))

        goes_on = False
        while True:
            begun = time.monotonic()
            try:
                await self._checked.read(stand, take, goes_on=goes_on)
                goes_on = True
            except SourceError as error:
                goes_on = False
                trouble = f"{error.reason}; {error.remedy}"
                if trouble != self._reading.trouble:
                    self._warn(trouble)
                self._put(BridgePoints(number=number, trouble=trouble[:MAX_TROUBLE_LENGTH]))
                await asyncio.sleep(_TROUBLE_SECONDS)
            await asyncio.sleep(max(0.0, _ROUND_SECONDS - (time.monotonic() - begun)))

    def _put(self, reading: BridgePoints) -> None:
        """Set the reading that is sent next."""
        self._reading = reading
        self._changed.set()


_NAME: Final = TypeAdapter(Name)


def _is_name(text: str) -> bool:
    """Return whether a text that a source sent can be the name of a target."""
    try:
        _NAME.validate_python(text)
    except ValidationError:
        return False
    return True


def _make_setting(measured_set: MeasurementSet, robot: Robot) -> Setting:
    """Return what a source needs to know of an open set.

    Raises:
        CampaignError: the set is not measured live.
    """
    options, scales = measured_set.open, Scales.from_units(measured_set.units, robot)
    if options is None:
        raise CampaignError(http_problem(409, "the set is not measured live", "open another live campaign"))
    targets = options.targets or {
        name: (scales.length * x, scales.length * y, scales.length * z)
        for name, (x, y, z) in measured_set.flange_targets.items()
    }
    noise = measured_set.noise
    sigma = scales.length * noise.sigma if noise is not None and noise.sigma else options.sigma
    frame = measured_set.resolved_frame
    transform = (
        (np.eye(3), np.zeros(3)) if frame is None else (np.array(frame.rotation), np.array(frame.translation))
    )
    load_point = options.load_point or (0.0, 0.0, 0.0)
    return Setting(robot, targets, load_point, sigma or _SIGMA, transform)


_SIGMA: Final = 2e-5
"""Standard deviation of a simulated tracker where the set states no noise [m]."""
