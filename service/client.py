"""A client of the API: it knows the service's address and nothing else of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

import httpx
from pydantic import ValidationError

from schemas.problem import Problem
from schemas.run import Progress, Run
from service.problems import http_problem

__all__ = ["RefusedError", "ServiceClient"]

_LOOK_SECONDS: Final = 0.2


class RefusedError(Exception):
    """The service refused, or did not answer; carries the problem."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.problem = problem


class ServiceClient:
    """Posts robots, measurement sets and runs."""

    def __init__(self, address: str) -> None:
        """Make a client for the service at an address such as http://127.0.0.1:8000."""
        self._http = httpx.Client(base_url=address, timeout=60.0)

    def __enter__(self) -> ServiceClient:
        return self

    def __exit__(self, *_: object) -> None:
        self._http.close()

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

    def run(
        self, set_id: str, options: dict[str, Any], tell: Callable[[Progress], object] | None = None
    ) -> Run:
        """Post a run of a stored measurement set, and wait for its end.

        Args:
            set_id: of the measurement set.
            options: how to identify.
            tell: told of the progress of a run that takes long.

        Raises:
            RefusedError: the service refuses it, or does not answer.
        """
        body = options | {"measurement_set_id": set_id}
        run = Run.model_validate(self._post("/v1/runs?wait=1", body))
        while run.state in {"queued", "running"}:
            time.sleep(_LOOK_SECONDS)
            run = Run.model_validate(self._request("GET", f"/v1/runs/{run.id}"))
            if tell is not None and run.progress is not None:
                tell(run.progress)
        return run

    def _post(self, path: str, body: object) -> dict[str, Any]:
        return self._request("POST", path, body)

    def _request(self, verb: str, path: str, body: object = None) -> dict[str, Any]:
        try:
            response = self._http.request(verb, path, json=body)
        except (httpx.TransportError, httpx.InvalidURL, httpx.UnsupportedProtocol) as error:
            silence = f"no answer from {self._http.base_url}: {error}"
            raise RefusedError(http_problem(503, silence, "start it: jointstiff serve")) from error
        if not response.is_success:
            raise RefusedError(_problem_of(response))
        answer: dict[str, Any] = response.json()
        return answer


def _problem_of(response: httpx.Response) -> Problem:
    try:
        return Problem.model_validate_json(response.content)
    except ValidationError:
        return http_problem(
            502, f"an answer that is not Jointstiff's: {response.status_code}", "check the address"
        )
