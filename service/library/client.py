"""A client of the API: it knows the service's address and nothing else of it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any, Final, TypeVar
from uuid import uuid4

import httpx
from pydantic import TypeAdapter, ValidationError

from jointstiff.schemas.comparison import Comparison
from jointstiff.schemas.fields import Identifier
from jointstiff.schemas.job import Job, Progress
from jointstiff.schemas.problem import Problem
from jointstiff.schemas.run import Run
from jointstiff.service.problems import http_problem

__all__ = ["PATIENCE_SECONDS", "RefusedError", "ServiceClient"]

PATIENCE_SECONDS: Final = 60.0
"""For a service that answered before and does not now."""
_LOOK_SECONDS: Final = 0.2
_FIRST_PAUSE: Final = 0.2
_LONGEST_PAUSE: Final = 2.0
_UNAVAILABLE: Final = 503
_IDENTIFIER: Final[TypeAdapter[str]] = TypeAdapter(Identifier)

AnyJob = TypeVar("AnyJob", bound=Job)


class RefusedError(Exception):
    """The service refused, or did not answer; carries the problem."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.problem = problem


class ServiceClient:
    """Posts robots, measurement sets and jobs, and waits for what goes on.

    A service that answered once and does not now is being restarted, most of the time: requests are repeated
    until it answers again. Each post carries a key that makes it safe to repeat.
    """

    def __init__(
        self,
        address: str,
        warn: Callable[[str], object] | None = None,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        """Make a client.

        Args:
            address: of the service, such as http://127.0.0.1:8000.
            warn: told when the service does not answer and is asked again.
            transport: carries the requests, if not over the network.

        Raises:
            RefusedError: there can be no such address.
        """
        try:
            self._http = httpx.Client(base_url=address, timeout=60.0, transport=transport)
        except httpx.InvalidURL as error:
            raise RefusedError(_silence(address, error)) from error
        self._warn = warn
        self._answered = False

    def __enter__(self) -> ServiceClient:
        return self

    def __exit__(self, *_: object) -> None:
        self._http.close()

    def ping(self) -> None:
        """Find out that the service is there; from now on it is waited for.

        Raises:
            RefusedError: it is not.
        """
        self._answer("GET", "/health")

    def post_campaign(self, document: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Post the robot and the readings of a campaign document.

        Returns:
            The stored robot and the stored measurement set.

        Raises:
            RefusedError: the service refuses one of them, or does not answer.
        """
        robot = self._post("/v1/robots", document["robot"])
        readings = document["measurement_set"] | {"robot_id": robot["id"]}
        return robot, self._post("/v1/measurement-sets", readings)

    def run(self, set_id: str, options: dict[str, Any]) -> Run:
        """Post a run of a stored measurement set.

        Args:
            set_id: of the measurement set.
            options: how to identify.

        Returns:
            It, ended if that took no longer than a second.

        Raises:
            RefusedError: the service refuses it, or does not answer.
        """
        return self._job(Run, options | {"measurement_set_id": set_id})

    def compare(self, set_id: str, options: dict[str, Any]) -> Comparison:
        """Post a comparison on a stored measurement set.

        Args:
            set_id: of the measurement set.
            options: what to compare.

        Returns:
            It, ended if that took no longer than a second.

        Raises:
            RefusedError: the service refuses it, or does not answer.
        """
        return self._job(Comparison, options | {"measurement_set_id": set_id})

    def ended(self, job: AnyJob, on_progress: Callable[[Progress], object] | None = None) -> AnyJob:
        """Wait for the end of a job.

        Args:
            job: that was posted.
            on_progress: called with its progress.

        Raises:
            RefusedError: the service does not answer.
        """
        kind = type(job)
        while job.state in {"queued", "running"}:
            if on_progress is not None and job.progress is not None:
                on_progress(job.progress)
            time.sleep(_LOOK_SECONDS)
            job = _as(kind, self._answer("GET", f"/v1/{job.collection}/{job.id}"))
        return job

    def _job(self, kind: type[AnyJob], body: dict[str, Any]) -> AnyJob:
        return _as(kind, self._post(f"/v1/{kind.collection}?wait=1", body))

    def _post(self, path: str, body: object) -> dict[str, Any]:
        content = json.dumps(body).encode()
        headers = {"Content-Type": "application/json", "Idempotency-Key": uuid4().hex}
        answer = self._answer("POST", path, content=content, headers=headers)
        try:
            _IDENTIFIER.validate_python(answer.get("id"))
        except ValidationError as error:
            raise RefusedError(_alien("without an id")) from error
        return answer

    def _answer(self, verb: str, path: str, **parts: Any) -> dict[str, Any]:  # noqa: ANN401 - httpx's
        """Ask until there is an answer.

        Raises:
            RefusedError: the service refuses, never answered, or has not for `PATIENCE_SECONDS`.
        """
        request = self._request(verb, path, **parts)
        deadline, pause = time.monotonic() + PATIENCE_SECONDS, _FIRST_PAUSE
        while True:
            found = self._try(request)
            if isinstance(found, dict):
                return found
            if not self._answered or time.monotonic() + pause > deadline:
                raise RefusedError(found)
            if pause == _FIRST_PAUSE and self._warn is not None:
                self._warn(f"{found.detail}; trying again for {PATIENCE_SECONDS:.0f} s")
            time.sleep(pause)
            pause = min(2 * pause, _LONGEST_PAUSE)

    def _request(self, verb: str, path: str, **parts: Any) -> httpx.Request:  # noqa: ANN401 - httpx's
        try:
            return self._http.build_request(verb, path, **parts)
        except httpx.InvalidURL as error:
            raise RefusedError(_silence(self._http.base_url, error)) from error

    def _try(self, request: httpx.Request) -> dict[str, Any] | Problem:
        """The answer; or, if it may be had later, why there is none now.

        Raises:
            RefusedError: the service refuses.
        """
        try:
            response = self._http.send(request)
        except httpx.TransportError as error:
            return _silence(self._http.base_url, error)
        except httpx.DecodingError as error:
            raise RefusedError(_alien("which cannot be decoded")) from error
        self._answered = True
        if response.status_code == _UNAVAILABLE:
            return _problem_of(response)
        if not response.is_success:
            raise RefusedError(_problem_of(response))
        return _read(response)


def _as(kind: type[AnyJob], answer: dict[str, Any]) -> AnyJob:
    try:
        return kind.model_validate(answer)
    except ValidationError as error:
        raise RefusedError(_alien(f"which is no {kind.__name__.lower()}")) from error


def _read(response: httpx.Response) -> dict[str, Any]:
    """The JSON of an answer, which may come from anyone; what would steer a terminal is taken out of it.

    Raises:
        RefusedError: it is none.
    """
    try:
        answer = _printable(json.loads(response.content))
    except (ValueError, RecursionError) as error:
        raise RefusedError(_alien("which is not JSON")) from error
    if not isinstance(answer, dict):
        raise RefusedError(_alien("which is no resource"))
    return answer


def _printable(value: Any) -> Any:  # noqa: ANN401 - any JSON
    if isinstance(value, str):
        return "".join(c if c.isprintable() else "\ufffd" for c in value)
    if isinstance(value, list):
        return [_printable(item) for item in value]
    if isinstance(value, dict):
        return {_printable(name): _printable(item) for name, item in value.items()}
    return value


def _silence(address: object, error: Exception) -> Problem:
    remedy = "start it: jointstiff serve"
    if not str(address).startswith(("http://", "https://")):
        remedy = "write the address with http:// before it"
    return http_problem(_UNAVAILABLE, f"no answer from {address}: {error}", remedy)


def _alien(what: str) -> Problem:
    return http_problem(
        502, f"an answer that is not Jointstiff's, {what}", "check the address, and that versions agree"
    )


def _problem_of(response: httpx.Response) -> Problem:
    try:
        return Problem.model_validate(_read(response))
    except (RefusedError, ValidationError):
        return _alien(f"status {response.status_code}")
