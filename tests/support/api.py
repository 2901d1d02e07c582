"""Addresses and bodies of the API that jobs of all kinds share."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import httpx2
import pytest

BOTH_DATABASES = pytest.mark.parametrize("service", ["sqlite", "postgresql"], indirect=True, scope="session")
"""For modules that ask the running service on SQLite and on PostgreSQL."""
EITHER_DATABASE = pytest.mark.parametrize(
    "service", ["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)], indirect=True, scope="session"
)
"""The same, on PostgreSQL each night only."""
CANCEL = {"cancelled": True}
DELETE = {"deleted": True}
RESTORE = {"deleted": False}


def job_at(job: str | dict[str, Any]) -> str:
    """The address that all jobs share, of a job, its id, or the address of its kind."""
    identifier = job if isinstance(job, str) else str(job["id"])
    return f"/v1/jobs/{identifier.rpartition('/')[2]}"


def file_at(job: str | dict[str, Any], name: str) -> str:
    """The address of a file of a job."""
    return f"{job_at(job)}/files/{name}"


def patient(send: Callable[[], httpx2.Response]) -> httpx2.Response:
    """Send a request, and again while the service of a busy machine says that it is still starting."""
    while (answer := send()).status_code == 503 and "still starting" in answer.text:
        pass  # the service waits a minute before each such answer
    return answer


def post(client: Any, path: str, body: Any, status: int = 201, **headers: str) -> Any:
    """Post a body; return what is answered, if it is answered as expected."""
    answer = patient(partial(client.request, "POST", path, json=body, headers=headers))
    assert answer.status_code == status, answer.text
    return answer.json()


def made(client: Any, send: Callable[[], httpx2.Response]) -> str:
    """Send a request; return the id of what is made, once its work has succeeded, however long it takes."""
    answer = patient(send)
    assert answer.status_code in {201, 202}, answer.text
    job: dict[str, Any] = answer.json()
    while job.get("state") in {"queued", "running"}:
        time.sleep(0.2)
        job = client.get(job_at(job)).json()
    assert job.get("state", "succeeded") == "succeeded", job
    return str(job["id"])


def posted(client: Any, campaign: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Post a campaign with options of its run; return the run, which has ended."""
    run: dict[str, Any] = post(client, "/v1/campaigns", campaign | {"run": options})
    return run


def stored_set(client: Any, campaign: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Post robot and measurement set of a campaign, which nobody identifies yet; return the set."""
    robot = post(client, "/v1/robots", campaign["robot"])["id"]
    readings = campaign["measurement_set"] | {"robot_id": robot} | changes
    stored: dict[str, Any] = post(client, "/v1/measurement-sets", readings)
    return stored


def posted_set(client: Any, campaign: dict[str, Any]) -> str:
    """Post a campaign; return the id of its measurement set."""
    return str(posted(client, campaign)["request"]["measurement_set_id"])
