"""Check robots as they come in, store them, and build them when they are needed."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from functools import lru_cache
from uuid import uuid4

from jointstiff.schemas import robot as messages
from jointstiff.service.conversion import build_robot, describe_joints, describe_wrist, dh_kinematics
from jointstiff.service.resources.stored_geometry import succeeded_geometry
from jointstiff.service.store import IdempotencyKey, RobotRecord, Store
from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot import Robot, read_urdf, write_urdf

__all__ = ["Robots"]

_CACHED = 64


class Robots:
    """Create and load the robots of a store."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._stored = lru_cache(_CACHED)(self._load)

    def create(
        self, request: messages.RobotDocument | messages.RobotRequest, key: IdempotencyKey | None
    ) -> RobotRecord:
        """Check a robot and store it.

        Raises:
            RobotError: the description cannot be used.
            RequestError: there is no such geometry.
            IdempotencyConflictError: the key came before with another body.
        """
        if key is not None and (before := self._store.find(RobotRecord, key)) is not None:
            return before
        document, geometry_id = self._described(request)
        checked, robot = _checked(document)
        created_at = datetime.now(UTC)
        stored = messages.Robot(
            **checked.model_dump(exclude={"model"}),
            model=checked.model,
            id=uuid4().hex,
            joints=describe_joints(robot),
            wrist=describe_wrist(robot),
            geometry_id=geometry_id,
            content_hash=_content_hash(checked),
            created_at=created_at,
        )
        record = RobotRecord(
            id=stored.id,
            name=stored.name,
            created_at=created_at,
            content_hash=stored.content_hash,
            document=stored.model_dump_json(),
        )
        return self._store.add(record, key)

    def load(self, robot_id: str) -> tuple[Robot, str]:
        """Return the robot ready for computation, and the hash of its content.

        Raises:
            NotFoundError: there is no such robot.
        """
        return self._stored(robot_id)

    def find(self, robot_id: str | None, document: messages.RobotDocument | None) -> Robot:
        """Return a stored robot, or build one that is described and stays unstored.

        Raises:
            NotFoundError: there is no such robot.
            RobotError: the description cannot be used.
        """
        if document is not None:
            return _checked(document)[1]
        return self.load(robot_id or "")[0]

    def _described(
        self, request: messages.RobotDocument | messages.RobotRequest
    ) -> tuple[messages.RobotDocument, str | None]:
        """Return the robot that a request describes, and the identifier of its geometry."""
        model = request.model
        if isinstance(model, messages.GeometryModel):
            where = "model.geometry_id"
            _, result = succeeded_geometry(self._store, model.geometry_id, where)
            return result.robot.model_copy(update={"name": request.name}), model.geometry_id
        document = messages.RobotDocument(name=request.name, model=model, joint_map=request.joint_map)
        return document, None

    def _load(self, robot_id: str) -> tuple[Robot, str]:
        record = self._store.get(RobotRecord, robot_id)
        stored = messages.Robot.model_validate_json(record.document)
        return _checked(stored)[1], record.content_hash


def _checked(document: messages.RobotDocument) -> tuple[messages.RobotDocument, Robot]:
    """Return the document reduced to the chain that is used, and its robot."""
    model = document.model
    if isinstance(model, messages.DhModel):
        return document, build_robot(dh_kinematics(model, document.name), document.joint_map)
    try:
        chain = read_urdf(model.urdf, model.base, model.flange)
    except RobotError as error:
        named = error.where in {"base", "flange"}
        place = f"model.{error.where}" if named else f"model.urdf: {error.where or 'document'}"
        raise RobotError(error.reason, remedy=error.remedy, where=place) from error
    understood = model.model_copy(update={"urdf": write_urdf(chain)})
    return document.model_copy(update={"model": understood}), build_robot(chain, document.joint_map)


def _content_hash(document: messages.RobotDocument) -> str:
    """Return the SHA-256 of the kinematics and the joint map, not of the name."""
    return hashlib.sha256(document.model_dump_json(exclude={"name"}).encode()).hexdigest()
