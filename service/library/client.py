"""A client of the service, for notebooks and for the command line."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from uuid import uuid4

import httpx2

from jointstiff.schemas.comparison import Comparison
from jointstiff.schemas.deflection import DeflectionResult
from jointstiff.schemas.fields import Message
from jointstiff.schemas.geometry.message import Geometry
from jointstiff.schemas.map import Map
from jointstiff.schemas.measurement.measurement_set import MeasurementSet, MeasurementSetSummary
from jointstiff.schemas.pair import Pair
from jointstiff.schemas.plan import Plan
from jointstiff.schemas.program import Program
from jointstiff.schemas.robot import Robot, RobotSummary
from jointstiff.schemas.run.run import Run
from jointstiff.service.kinds.comparison import COMPARISON
from jointstiff.service.kinds.geometry import GEOMETRY
from jointstiff.service.kinds.map import MAP
from jointstiff.service.kinds.pair import PAIR
from jointstiff.service.kinds.plan import PLAN
from jointstiff.service.kinds.program import PROGRAM
from jointstiff.service.library.answers import alien, no_address, problem_in, resource_in, silence
from jointstiff.service.library.campaigns import read_object
from jointstiff.service.library.collections import Collection, Document, Jobs, Programs, Runs, plain
from jointstiff.service.library.errors import AwayError, RefusedError
from jointstiff.service.library.in_process import AnyCampaign, campaign_of
from jointstiff.service.library.results import TabledRun
from jointstiff.service.problems.table import http_problem

PATIENCE_SECONDS: Final = 60.0
"""For a service that answered before and does not now."""
_FIRST_PAUSE: Final = 0.2
_LONGEST_PAUSE: Final = 2.0


class Client:
    """A service, with its resources by kind, such as `client.runs.get(id)`.

    A service that answered once and does not now is restarting, most of the time: requests are repeated until
    it answers again. Each post carries a key that makes it safe to repeat. Every method raises `RefusedError`
    if the service refuses or does not answer. Used as a context manager, it closes its connections.
    """

    def __init__(
        self,
        url: str,
        key: str | None = None,
        *,
        warn: Callable[[str], object] | None = None,
        transport: httpx2.BaseTransport | None = None,
        patience: float = PATIENCE_SECONDS,
    ) -> None:
        """Make a client.

        Args:
            url: of the service, such as http://127.0.0.1:8000.
            key: that the service or a proxy before it demands; without it the environment variable
                JOINTSTIFF_KEY, if there is one.
            warn: called when the service does not answer and requests are repeated.
            transport: carries the requests, if not over the network.
            patience: seconds for which requests are repeated while a service that answered does not.

        Raises:
            RefusedError: there can be no such address, or no such key.
        """
        if not url.startswith(("http://", "https://")):
            raise RefusedError(no_address(url))
        key = (os.environ.get("JOINTSTIFF_KEY", "") if key is None else key).strip()
        if not (key.isascii() and key.isprintable()):  # HTTP's own complaint would show the key
            raise RefusedError(http_problem(401, "the text given is not a key", "copy the whole key"))
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        try:
            self._http = httpx2.Client(base_url=url, headers=headers, timeout=60.0, transport=transport)
        except httpx2.InvalidURL as error:
            raise RefusedError(silence(url, error)) from error
        self._warn, self._patience = warn, patience
        self._answered = False
        self.robots = Collection(self.send, "robots", Robot, RobotSummary)
        self.measurement_sets = Collection(
            self.send, "measurement-sets", MeasurementSet, MeasurementSetSummary
        )
        self.runs = Runs(self.send)
        self.comparisons = Jobs(self.send, COMPARISON)
        self.pairs = Jobs(self.send, PAIR)
        self.geometries = Jobs(self.send, GEOMETRY)
        self.plans = Jobs(self.send, PLAN)
        self.maps = Jobs(self.send, MAP)
        self.programs = Programs(self.send, PROGRAM)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def ping(self) -> None:
        """Find out that the service is there; from now on requests are repeated while it is not."""
        self.send("GET", "/health")

    def identify(self, campaign: AnyCampaign, **options: Any) -> TabledRun:  # noqa: ANN401 - of RunOptions
        """Post a campaign and its run; return the run once it has ended.

        Args:
            campaign: a file, a document that was read from JSON, or a `Campaign`.
            options: fields of `RunOptions` that replace the campaign's.

        Raises:
            CampaignError: the file is no campaign.
            RefusedError: the service refuses it.
        """
        document = plain(campaign_of(campaign))
        _, stored = self.post_campaign(document)
        request = document.get("run", {}) | options | {"measurement_set_id": stored.id}
        return self.runs.done(request)

    def compare(self, run: Run, **options: Any) -> Comparison:  # noqa: ANN401 - of ComparisonOptions
        """Compare the methods on the measurement set of a run."""
        return self.comparisons.done({"measurement_set_id": run.request.measurement_set_id, **options})

    def pair(self, first: Run, second: Run, **options: Any) -> Pair:  # noqa: ANN401 - of PairOptions
        """Compare two runs, each by its own options."""
        return self.pairs.done({"first": {"run_id": first.id}, "second": {"run_id": second.id}, **options})

    def geometry(self, request: Document) -> Geometry:
        """Identify a robot's geometry from a `GeometryRequest`."""
        return self.geometries.done(request)

    def plan(self, source: Run | Robot, **options: Any) -> Plan:  # noqa: ANN401 - of PlanOptions
        """Plan readings: to go on with the measurement set of a run, or to begin with a stored robot."""
        if isinstance(source, Run):
            return self.plans.done({"measurement_set_id": source.request.measurement_set_id, **options})
        return self.plans.done({"robot_id": source.id, **options})

    def predict(self, run: Run, cases: Sequence[Document], **options: Any) -> DeflectionResult:  # noqa: ANN401
        """Predict deflections by a run; `cases` are load cases, `options` fields of `DeflectionOptions`."""
        request = {"run_id": run.id, "cases": [plain(case) for case in cases], **options}
        return resource_in(self.send("POST", "/v1/deflections", None, request), DeflectionResult)

    def map(self, run: Run, options: Document | None = None, **fields: Any) -> Map:  # noqa: ANN401
        """Map a work area by a run."""
        return self.maps.done({**plain(options or {}), **fields, "run_id": run.id})

    def compensate(self, run: Run, *files: str | Path, **options: Any) -> Program:  # noqa: ANN401
        """Correct a robot program by a run; `programs.files` has what it became."""
        return self.programs.compensate(files, {**options, "run_id": run.id})

    def post_campaign(self, campaign: Message | Mapping[str, Any]) -> tuple[Robot, MeasurementSet]:
        """Post the robot and the readings of a campaign, each once; return both as they were stored."""
        document = plain(campaign)
        robot = self.robots.once(document["robot"])
        return robot, self.measurement_sets.once(document["measurement_set"] | {"robot_id": robot.id})

    def post_file(self, path: Path) -> None:
        """Post a robot from a file, and its readings and their run if the file has them, each once.

        Raises:
            CampaignError: the file holds no JSON object.
            RefusedError: the service refuses it.
        """
        document = read_object(path)
        if "measurement_set" in document:
            _, stored = self.post_campaign(document)
            self.runs.once(document.get("run", {}) | {"measurement_set_id": stored.id})
        else:
            self.robots.once(document.get("robot", {}))

    def send(
        self,
        verb: str,
        path: str,
        query: Mapping[str, str] | None = None,
        document: Document | None = None,
        key: str | None = None,
        files: Mapping[str, bytes] | None = None,
    ) -> httpx2.Response:
        """Send a request until it is answered; return the answer.

        A document is posted with the key, or with one of its own; with files, as the `options` of a form.

        Raises:
            RefusedError: the service refuses, never answered, or has not for as long as its patience.
        """
        parts: dict[str, Any] = {"params": query}
        if files is not None:
            parts |= {"headers": {"Idempotency-Key": key or uuid4().hex}}
            parts |= {"files": [("files", (name, content)) for name, content in files.items()]}
            parts |= {"data": {"options": json.dumps(plain(document or {}))}}
        elif document is not None:
            headers = {"Content-Type": "application/json", "Idempotency-Key": key or uuid4().hex}
            parts |= {"content": json.dumps(plain(document)), "headers": headers}
        end, pause = time.monotonic() + self._patience, _FIRST_PAUSE
        while True:
            try:
                return self._try(verb, path, parts)
            except AwayError as error:
                if not self._answered or time.monotonic() + pause >= end:
                    raise
                if pause == _FIRST_PAUSE and self._warn is not None:
                    self._warn(f"{error.problem.detail}; trying again for {self._patience:.0f} s")
            time.sleep(pause)
            pause = min(2.0 * pause, _LONGEST_PAUSE)

    def _try(self, verb: str, path: str, parts: dict[str, Any]) -> httpx2.Response:
        try:
            response = self._http.request(verb, path, **parts)
        except httpx2.DecodingError as error:
            raise alien("which cannot be decoded") from error
        except httpx2.InvalidURL as error:
            raise RefusedError(silence(self._http.base_url, error)) from error
        except httpx2.TransportError as error:
            raise AwayError(silence(self._http.base_url, error)) from error
        self._answered = True
        if not response.is_success:
            away = response.status_code == httpx2.codes.SERVICE_UNAVAILABLE
            raise (AwayError if away else RefusedError)(problem_in(response))
        return response
