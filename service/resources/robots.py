"""Robots, checked as they come in, stored, and built when needed: described, identified or nominal.

The catalogue is tables of published figures in `arms.json`, in millimetres and degrees.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from datetime import UTC, datetime
from difflib import get_close_matches
from functools import cache, lru_cache
from importlib.resources import files
from math import radians
from typing import Any, Generic, TypeVar
from uuid import uuid4

from jointstiff.schemas import robot as messages
from jointstiff.schemas.fields import ResourceChange
from jointstiff.schemas.geometry import Geometry, GeometryResult
from jointstiff.schemas.job import Job
from jointstiff.schemas.robot import Arm, Catalogue, DhModel, DhRow, JointMap, JointMapPreset, RobotDocument
from jointstiff.service.conversion.prepared import build_robot, prepare_robot
from jointstiff.service.conversion.robots import describe_joints, describe_wrist
from jointstiff.service.problems.errors import NotFoundError, Resource
from jointstiff.service.store.collection import Collection
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import Entry, IdempotencyKey, Record, RobotRecord
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot.model import Robot

AnyJob = TypeVar("AnyJob", bound=Job)
Prepared = TypeVar("Prepared")

_CACHED = 64
_SHOWN = 5  # arms that a message names


class Kept(Generic[Record, Entry, Prepared]):
    """Stored inputs of one kind: what may change of them, and their deletion. What was computed stays."""

    def __init__(
        self, records: Collection[Record, Entry], prepare: Callable[[str], Prepared], most: int
    ) -> None:
        """Keep records, and what the latest of them, up to a number, were prepared to."""
        self.records: Collection[Record, Entry] = records
        self.ready = lru_cache(most)(prepare)  # by id

    def change(self, identifier: str, change: ResourceChange) -> Record:
        """Change what was given of a resource, archive it, or delete or restore it.

        Raises:
            NotFoundError: there is no such resource, or it has been removed for good.
            DeletedError: it was deleted and stays so, or what it refers to is deleted.
            ReferencedError: it is to be deleted, and others refer to it.
        """
        if change.deleted is False:
            self.records.restore(identifier)
        stated = {name: getattr(change, name) for name in change.model_fields_set - {"deleted"}}
        lasting = {name for name in ("name", "archived") if stated.get(name) is None}
        changes = {name: value for name, value in stated.items() if name not in lasting}
        record = self.records.change(identifier, changes, hidden=change.deleted is True)
        self.ready.cache_clear()
        if change.deleted:
            self.delete(identifier)
        return record

    def delete(self, identifier: str) -> None:
        """Hide a resource that nothing refers to; to do so again changes nothing.

        Raises:
            NotFoundError: there is no such resource.
            ReferencedError: others refer to it.
        """
        self.records.delete(identifier)
        self.ready.cache_clear()


class Robots(Kept[RobotRecord, RobotRecord, tuple[Robot, str]]):
    """Create and load the robots of a store."""

    def __init__(self, store: Store) -> None:
        super().__init__(store.robots, self._load, _CACHED)
        self._store = store

    def create(
        self, request: messages.RobotDocument | messages.RobotRequest, key: IdempotencyKey | None
    ) -> RobotRecord:
        """Check a robot and store it.

        Raises:
            RobotError: the description cannot be used.
            RequestError: there is no such geometry, or no such arm in the catalogue.
            IdempotencyConflictError: the key came before with another body.
        """
        if key is not None and (before := self._store.robots.find(key)) is not None:
            return before
        document, origin = self._described(request)
        prepared = prepare_robot(document)
        checked, robot = prepared.document, prepared.robot
        created_at = datetime.now(UTC)
        stored = messages.Robot(
            **checked.model_dump(exclude={"model"}),
            model=checked.model,
            id=uuid4().hex,
            joints=describe_joints(robot),
            wrist=describe_wrist(robot),
            **origin,
            content_hash=prepared.content_hash,
            created_at=created_at,
        )
        record = RobotRecord(
            id=stored.id,
            name=stored.name,
            created_at=created_at,
            content_hash=stored.content_hash,
            document=stored.model_dump_json(exclude={"alarms"}),
        )
        return self._store.robots.add(record, key)

    def load(self, robot_id: str) -> tuple[Robot, str]:
        """Return the robot ready for computation, and the hash of its content.

        Raises:
            NotFoundError: there is no such robot.
        """
        return self.ready(robot_id)

    def find(self, robot_id: str | None, document: messages.RobotDocument | None) -> Robot:
        """Return a stored robot, or build one that is described and stays unstored.

        Raises:
            NotFoundError: there is no such robot.
            RobotError: the description cannot be used.
        """
        if document is not None:
            return prepare_robot(document).robot
        return self.load(robot_id or "")[0]

    def _described(
        self, request: messages.RobotDocument | messages.RobotRequest
    ) -> tuple[messages.RobotDocument, dict[str, str]]:
        """Return the robot that a request describes, and what its model is taken from."""
        model = request.model
        if isinstance(model, messages.GeometryModel):
            where = "model.geometry_id"
            _, result = succeeded_geometry(self._store, model.geometry_id, where)
            found = result.robot.model_copy(update={"name": request.name, "bodies": request.bodies})
            return found, {"geometry_id": model.geometry_id}
        joint_map, origin = request.joint_map, {}
        if isinstance(model, messages.CatalogueModel):
            arm = find_arm(model.arm, "model.arm")
            model, joint_map, origin = arm.model, joint_map or arm.joint_map, {"nominal_arm": arm.name}
        document = messages.RobotDocument(
            name=request.name, model=model, joint_map=joint_map, bodies=request.bodies
        )
        return document, origin

    def _load(self, robot_id: str) -> tuple[Robot, str]:
        record = self._store.robots.get(robot_id)
        return build_robot(described(record)), record.content_hash


def described(record: RobotRecord) -> messages.Robot:
    """Return the message of a stored robot."""
    stored = messages.Robot.model_validate_json(record.document)
    return stored.model_copy(update={"name": record.name, "archived": record.archived})


def stored_job(store: Store, message: type[AnyJob], job_id: str) -> AnyJob:
    """Return a job, for those who build on it.

    Raises:
        NotFoundError: there is none, or it was deleted.
    """
    record = store.jobs(Resource(message.kind, message.collection)).get(job_id)
    return message.model_validate_json(record.document)


def succeeded_geometry(store: Store, geometry_id: str, where: str) -> tuple[Geometry, GeometryResult]:
    """Return a geometry and its result.

    Raises:
        RequestError: there is none, it was deleted, or it has no result.
    """
    try:
        geometry = stored_job(store, Geometry, geometry_id)
    except NotFoundError as error:
        raise RequestError(error.reason, remedy=error.remedy, where=where) from error
    if geometry.result is None:
        raise RequestError(
            f"geometry '{geometry_id}' is {geometry.state} and has no identified robot",
            remedy="use a geometry that has succeeded",
            where=where,
        )
    return geometry, geometry.result


@cache
def catalogue() -> Catalogue:
    """Return the catalogue."""
    text = files("jointstiff.service.resources").joinpath("arms.json").read_text(encoding="utf-8")
    tables = json.loads(text)
    presets = [
        JointMapPreset(
            joint_map=JointMap(matrix=each["matrix"], offset=[0.0] * len(each["matrix"])),
            **_without(each, "matrix"),
        )
        for each in tables["joint_maps"]
    ]
    maps = {preset.id: preset.joint_map for preset in presets}
    arms = [
        Arm(
            **_without(each, "rows", "convention", "joint_map", "reach"),
            model=DhModel(
                format="dh", convention=each["convention"], rows=[_row(*row) for row in each["rows"]]
            ),
            joint_map=None if each["joint_map"] is None else maps[each["joint_map"]],
            joint_map_preset=each["joint_map"],
            reach=each["reach"] / 1e3,
        )
        for each in tables["arms"]
    ]
    return Catalogue(arms=arms, joint_maps=presets)


def find_arm(name: str, where: str) -> Arm:
    """Return the arm of a name, or of a part of it that no other has; case and blanks do not count.

    Args:
        name: as it was typed, such as `KUKA KR 210 R2700`.
        where: field or option that has it, for messages.

    Raises:
        RequestError: there is none, or several.
    """
    wanted = _bare(name)
    arms = [arm for arm in catalogue().arms if wanted and wanted in _bare(arm.name)]
    exact = [arm for arm in arms if _bare(arm.name) == wanted]
    if len(exact or arms) == 1:
        return (exact or arms)[0]
    if arms:
        shown = ", ".join(arm.name for arm in arms[:_SHOWN])
        raise RequestError(
            f"'{name}' matches several arms of the catalogue: {shown}{', …' if arms[_SHOWN:] else ''}",
            where=where,
            remedy="give the whole name",
        )
    names = {_bare(arm.name): arm.name for arm in catalogue().arms}
    near = [names[each] for each in get_close_matches(wanted, names, n=3, cutoff=0.5)]
    raise RequestError(
        f"the catalogue has no arm '{name}'" + (f"; similar names: {', '.join(near)}" if near else ""),
        where=where,
        remedy=(
            "`jointstiff robots` and GET /v1/catalogue list its arms; or describe yours by a DH table or URDF"
        ),
    )


def nominal_robot(arm: Arm) -> RobotDocument:
    """Return an arm of the catalogue as a robot."""
    return RobotDocument(name=f"{arm.name} (nominal)", model=arm.model, joint_map=arm.joint_map)


def _bare(name: str) -> str:
    return re.sub(r"[\W_]+", "", name.casefold())


def _without(table: dict[str, Any], *names: str) -> dict[str, Any]:
    return {name: value for name, value in table.items() if name not in names}


def _row(a: float, alpha: float, d: float, theta: float, lower: float | None, upper: float | None) -> DhRow:
    """Return a row of a table in millimetres and degrees."""
    return DhRow(
        a=a / 1e3,
        alpha=radians(alpha),
        d=d / 1e3,
        theta=radians(theta),
        lower=None if lower is None else radians(lower),
        upper=None if upper is None else radians(upper),
    )
