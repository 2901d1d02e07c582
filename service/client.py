"""A client of the API: it knows the service's address and nothing else of it."""

from __future__ import annotations

from typing import Any

import httpx
from pydantic import ValidationError

from schemas.problem import Problem
from schemas.run import Run
from service.problems import http_problem

__all__ = ["RefusedError", "ServiceClient"]


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

    def run(self, set_id: str, options: dict[str, Any]) -> Run:
        """Post a run of a stored measurement set.

        Raises:
            RefusedError: the service refuses it, or does not answer.
        """
        return Run.model_validate(self._post("/v1/runs", options | {"measurement_set_id": set_id}))

    def _post(self, path: str, body: object) -> dict[str, Any]:
        try:
            response = self._http.post(path, json=body)
        except (httpx.TransportError, httpx.InvalidURL, httpx.UnsupportedProtocol) as error:
            problem = http_problem(
                503, f"no answer from {self._http.base_url}: {error}", "start it: jointstiff serve"
            )
            raise RefusedError(problem) from error
        if response.status_code != httpx.codes.CREATED:
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
