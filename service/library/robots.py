"""Robots from what Python programs have: names of the catalogue, files, URDFs, DH rows, Pinocchio models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import PrivateAttr

from jointstiff.schemas.fields import Message
from jointstiff.schemas.robot import JointMap, RobotDocument
from jointstiff.service.problems import as_campaign_error
from jointstiff.service.resources.documents import parse_document, read_robot

if TYPE_CHECKING:
    from jointstiff.schemas.joints import JointKind
    from jointstiff.service.conversion.arguments import AnyUnits
    from jointstiff.service.conversion.prepared import PreparedRobot


class ModelledRobot(RobotDocument):
    """Robot document made from a Pinocchio model; files contain the document, computations use the model."""

    _model: Any = PrivateAttr()
    _flange: str | None = PrivateAttr()

    @classmethod
    def from_model(cls, document: RobotDocument, model: Any, flange: str | None) -> ModelledRobot:  # noqa: ANN401
        """Return a document with the `pin.Model` from which it was made, and the name of the flange frame."""
        robot = cls.model_validate(dict(document))
        robot._model, robot._flange = model, flange
        return robot

    def replace_model_of(self, prepared: PreparedRobot) -> PreparedRobot:
        """Return a copy of a prepared robot that computes with the Pinocchio model of this object."""
        from jointstiff.solver.mechanics.robot import Robot

        old_robot = prepared.robot
        robot_with_model = Robot(
            self._model,
            old_robot.joint_map,
            old_robot.bodies,
            flange=self._flange,
            payload=old_robot.payload,
        )
        return replace(prepared, robot=robot_with_model)


def prepare_once(document: RobotDocument) -> PreparedRobot:
    """Return a robot document prepared for computations; the last four prepared robots are cached.

    A `ModelledRobot` computes with the Pinocchio model from which it was made.

    Raises:
        RobotError: the description of the robot cannot be used.
    """
    prepared = _prepare_cached(document.model_dump_json())
    return document.replace_model_of(prepared) if isinstance(document, ModelledRobot) else prepared


def read_joint_kinds(document: RobotDocument) -> dict[str, JointKind]:
    """Return the kind of each joint, revolute or prismatic, by name and in order.

    Raises:
        RobotError: the description of the robot cannot be used.
    """
    prepared = prepare_once(document).robot
    return dict(zip(prepared.joint_names, prepared.joint_kinds, strict=True))


@lru_cache(maxsize=4)
def _prepare_cached(robot: str) -> PreparedRobot:
    """Return the robot of a document, the JSON text `robot`, prepared for computations."""
    from jointstiff.service.conversion.prepared import prepare_robot

    return prepare_robot(RobotDocument.model_validate_json(robot))


def robot(
    source: object,
    *,
    name: str | None = None,
    base: str | None = None,
    flange: str | None = None,
    convention: str | None = None,
    units: AnyUnits = None,
    joint_map: JointMap | Mapping[str, Any] | None = None,
) -> RobotDocument:
    """Return the document of a robot, from any form of description.

    Args:
        source: a robot document or a file of one; the name of an arm of the catalogue, such as "KUKA KR 210
            R2700 extra"; a URDF, its text or file; rows of a, alpha, d, theta (and limits); or a model of
            Pinocchio.
        name: name of the robot.
        base: link of a URDF whose frame is R0; default: its root.
        flange: link of a URDF, or frame of a model, that is the flange; default: the only tip.
        convention: convention of the rows, `standard` or `modified` (Craig).
        units: units of the lengths and angles of rows, such as "m, rad, N"; default: mm and deg.
        joint_map: map from the controller's joints to the model's; default: identity, or the map of the arm.

    Raises:
        CampaignError: the source does not describe a robot.
        OSError: a file cannot be read.
    """
    document: dict[str, Any]
    if isinstance(source, Message | Mapping):
        document = plain_fields(source)
    elif isinstance(source, str | PathLike):
        document = _read_robot_fields(str(source), base, flange)
    else:
        document = _make_robot_fields(source, flange, convention, units)
    if joint_map is not None:
        document["joint_map"] = plain_fields(joint_map)
    parsed = parse_document({"name": "robot", **document, **({"name": name} if name else {})}, RobotDocument)
    return ModelledRobot.from_model(parsed, source, flange) if hasattr(source, "jointPlacements") else parsed


def _read_robot_fields(text: str, base: str | None, flange: str | None) -> dict[str, Any]:
    """Return the fields of a robot: from a URDF (its text or file), a robot file, or the name of an arm."""
    if not text.lstrip().startswith("<") and Path(text).suffix.lower() not in {".urdf", ".xml", ".xacro"}:
        return plain_fields(read_robot(text))
    from jointstiff.service.conversion.arrays import convert_urdf

    is_text = text.lstrip().startswith("<")
    if Path(text).suffix.lower() == ".xacro" and not is_text:
        urdf = _expand_xacro(Path(text))
    else:
        urdf = text if is_text else Path(text).read_text(encoding="utf-8-sig")
    with as_campaign_error("robot"):
        return {"name": "robot" if is_text else Path(text).stem, "model": convert_urdf(urdf, base, flange)}


def _expand_xacro(path: Path) -> str:
    """Return the URDF of a xacro file, by the package `xacro`.

    Raises:
        CampaignError: the package is not installed, or the file cannot be expanded.
    """
    from jointstiff.solver.errors import RobotError

    with as_campaign_error("robot"):
        try:
            import xacro
        except ImportError:
            raise RobotError(
                "a xacro file needs the package xacro, which is not installed",
                where="robot",
                remedy="pip install xacro, or expand the file first: xacro robot.urdf.xacro > robot.urdf",
            ) from None
        try:
            return str(xacro.process_file(str(path)).toxml())
        except Exception as error:
            reason = f"the xacro file cannot be expanded: {error}"
            remedy = (
                "check the file with the program xacro; the packages that the file includes must be installed"
            )
            raise RobotError(reason, where="robot", remedy=remedy) from error


def _make_robot_fields(
    source: Any,  # noqa: ANN401 - a model of Pinocchio, or rows
    flange: str | None,
    convention: str | None,
    units: AnyUnits,
) -> dict[str, Any]:
    """Return the fields of a robot: from a Pinocchio model, or from rows of Denavit-Hartenberg parameters."""
    from jointstiff.service.conversion.arguments import complete_units
    from jointstiff.service.conversion.arrays import convert_dh_rows, convert_pinocchio_model

    with as_campaign_error("robot"):
        if hasattr(source, "jointPlacements"):  # a Pinocchio model
            model, bodies = convert_pinocchio_model(source, flange)
            return {"name": source.name or "robot", "model": model, **({"bodies": bodies} if bodies else {})}
        return {"model": convert_dh_rows(source, convention, complete_units(units))}


def plain_fields(fields: Message | Mapping[str, Any]) -> dict[str, Any]:
    """Return fields for JSON: of a message those that were set, of a mapping those that are not None."""
    if isinstance(fields, Message):
        return fields.model_dump(mode="json", exclude_unset=True)
    return {
        name: value.model_dump(mode="json", exclude_unset=True) if isinstance(value, Message) else value
        for name, value in fields.items()
        if value is not None
    }
