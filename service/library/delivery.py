"""Finished files posted to a service: a measurement set of one robot, and its run."""

from __future__ import annotations

import hashlib
import json
from codecs import BOM_UTF8
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any, Final

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.measurement.measurement_set import MeasurementSetDocument
from jointstiff.schemas.robot import Robot
from jointstiff.service.conversion.parsing import MAX_SET_BYTES
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.importing.reading import SourceFile
from jointstiff.service.library.campaigns import as_campaign_error, parse_content, too_large
from jointstiff.service.library.client import Client
from jointstiff.service.library.errors import CampaignError, RefusedError
from jointstiff.service.library.folder import TABLES, FinishedFile
from jointstiff.service.problems.errors import FilesError
from jointstiff.service.problems.table import http_problem, problem_of
from jointstiff.service.resources.imports import import_files

_CONFLICT: Final = "urn:jointstiff:problem:idempotency-conflict"
_TAKEN_BEFORE: Final = "the same content was imported before, under another name"


class Delivery:
    """Post finished files to a service. Each content becomes one measurement set and one run."""

    def __init__(self, client: Client, robot_id: str, template: ImportRequest | None = None) -> None:
        """Deliver measurements of one robot.

        Args:
            client: of the service.
            robot_id: the robot.
            template: options by which tables are read; without it only JSON is taken.

        """
        self._client, self._template, self._robot_id = client, template, robot_id
        self._robot: Robot | None = None
        options = b"" if template is None else template.model_dump_json().encode()
        self._salt = hashlib.sha256(robot_id.encode() + b"\0" + options).hexdigest()

    def check(self) -> Robot:
        """Return the robot.

        Raises:
            RefusedError: the service has none of this id, or does not answer.
        """
        if self._robot is None:
            self._robot = self._client.robots.get(self._robot_id)
        return self._robot

    @property
    def suffixes(self) -> frozenset[str]:
        """Endings of the names that are taken."""
        return frozenset({".json"}) | (TABLES if self._template is not None else frozenset())

    def post(self, file: FinishedFile) -> str:
        """Post a file; return the address of its run, and the alarms of its robot.

        Raises:
            CampaignError: its content cannot be understood.
            RefusedError: the service refuses it, or does not answer.
        """
        if len(file.content) > MAX_SET_BYTES:
            raise too_large()
        robot = self.check()
        document, run = self._read(file, robot)
        key = hashlib.sha256(f"{self._salt} {file.digest}".encode()).hexdigest()
        try:
            stored = self._client.measurement_sets.create(document | {"robot_id": robot.id}, key=key)
        except RefusedError as error:
            if error.problem.type == _CONFLICT:
                return _TAKEN_BEFORE
            raise
        created = self._client.runs.create(run | {"measurement_set_id": stored.id}, key=key)
        alarms = [
            f"this robot is in alarm: {alarm.line}"
            for alarm in self._client.robots.get(robot.id).alarms
            if alarm.serial_number == stored.serial_number
        ]
        return "; ".join([f"/v1/runs/{created.id}", *alarms])

    def _read(self, file: FinishedFile, robot: Robot) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the measurement set and the options of its run, as they are posted."""
        if PurePath(file.name).suffix.lower() != ".json":
            return self._table(file)
        content = file.content.removeprefix(BOM_UTF8)
        if not _is_campaign(content):
            return _plain(parse_content(MeasurementSetDocument, content)), {}
        campaign = parse_content(Campaign, content)
        with as_campaign_error("robot"):
            robot_hash = prepare_robot(campaign.robot).content_hash
        if robot_hash != robot.content_hash:
            raise CampaignError(
                http_problem(
                    422,
                    f"the campaign's robot has other kinematics, limits or joint map than '{robot.name}'",
                    "move it to the folder of its own robot, or post it with `jointstiff post`",
                )
            )
        return _plain(campaign.measurement_set), _plain(campaign.run)

    def _table(self, file: FinishedFile) -> tuple[dict[str, Any], dict[str, Any]]:
        try:
            answer = import_files([SourceFile(file.name, file.content)], self._template or ImportRequest())
        except FilesError as error:
            raise CampaignError(problem_of(error)) from error
        if answer.measurement_set is None:
            missing = "; ".join(answer.missing)
            raise CampaignError(http_problem(422, f"this is missing: {missing}", "add it to the template"))
        return _plain(answer.measurement_set), {"leave_out": answer.leave_out}


def _is_campaign(content: bytes) -> bool:
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        return True  # whose parser says what is wrong
    return not isinstance(document, Mapping) or "measurement_set" in document


def _plain(message: Any) -> dict[str, Any]:  # noqa: ANN401 - any message
    document: dict[str, Any] = message.model_dump(mode="json", exclude_unset=True)
    return document
