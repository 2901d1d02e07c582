"""Robots from what Python programs have: names of the catalogue, files, URDFs, DH rows, Pinocchio models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from pydantic import PrivateAttr

from jointstiff.schemas.fields import Message
from jointstiff.schemas.robot import JointMap, RobotDocument
from jointstiff.service.problems import CampaignError, as_campaign_error
from jointstiff.service.process import one_thread
from jointstiff.service.resources.documents import URDF_ENDINGS, parse_document, read_robot, read_urdf_file
from jointstiff.solver.errors import RobotError

if TYPE_CHECKING:
    from jointstiff.schemas.joints import JointKind
    from jointstiff.service.conversion.prepared import PreparedRobot
    from jointstiff.service.conversion.units import AnyUnits
    from jointstiff.service.kinds.correction.verb import CorrectFields
    from jointstiff.service.library.correction import AnyJoints, AnyPoses, Correction


class DescribedRobot(RobotDocument):
    """Robot document that `robot` returns: equal to the plain document, with the work that needs no run."""

    @one_thread()
    def correct(
        self,
        poses: AnyPoses,
        /,
        joints: AnyJoints = None,
        **options: Unpack[CorrectFields],
    ) -> Correction:
        """Correct poses by the prior of this robot; arguments as of `jointstiff.correct`."""
        from jointstiff.service.kinds.verb import JobMonitor
        from jointstiff.service.library.correction import correct_here

        with as_campaign_error("robot"):
            robot = prepare_once(self).robot
        with JobMonitor() as monitor:
            return correct_here(robot, poses, joints, options, monitor)

    def __eq__(self, other: object) -> bool:
        """Return whether another document, of any class, has the same fields."""
        return isinstance(other, RobotDocument) and dict(self) == dict(other)

    def __hash__(self) -> int:
        """Return the hash of the document."""
        return hash(self.model_dump_json())


class ModelledRobot(DescribedRobot):
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
    columns: str | Sequence[str] | None = None,
    units: AnyUnits = None,
    joint_map: JointMap | Mapping[str, Any] | None = None,
    payload: float | None = None,
) -> DescribedRobot:
    """Return the document of a robot, from any form of description.

    Args:
        source: a robot document or a file of one; a run, whose robot is meant; the name of an arm of the
            catalogue, such as "KUKA KR 210 R2700 extra"; a URDF, its text or file; a table of Denavit and
            Hartenberg, as a data frame, mappings or rows; or a model of Pinocchio.
        name: name of the robot.
        base: link of a URDF whose frame is R0; default: its root.
        flange: link of a URDF, or frame of a model, that is the flange; default: the only tip.
        convention: convention of the rows, `standard` or `modified` (Craig).
        columns: names of the columns of rows without names, in their order, such as "theta d a alpha";
            further names are lower, upper, speed and kind.
        units: units of the lengths and angles of rows, such as "m, rad" or "mm, deg"; needed, unless the
            names of all columns have units.
        joint_map: map from the controller's joints to the model's, with an offset in rad or m; default:
            identity, or the map of the arm.
        payload: largest payload by the maker [kg]; default: that of the document, or of the arm.

    Raises:
        CampaignError: the source does not describe a robot, or an argument does not concern this source.
        OSError: a file cannot be read.
    """
    _refuse_scalar(source)
    source = getattr(source, "campaign", source)  # of a run, the robot that was measured
    described = _StatedDescription(source, base, flange, convention, columns, units)
    document = {"name": "robot", **described.read_fields()}
    if joint_map is not None:
        is_document = isinstance(joint_map, Message | Mapping)
        document["joint_map"] = plain_fields(joint_map) if is_document else joint_map
    if payload is not None:
        document["payload"] = payload
    if name:
        document["name"] = name
    parsed = parse_document(document, DescribedRobot)
    return ModelledRobot.from_model(parsed, source, flange) if _is_pinocchio_model(source) else parsed


def _refuse_scalar(source: object) -> None:
    """Refuse a source that has no content, such as None, a number or a function.

    Raises:
        CampaignError: the source describes no robot.
    """
    if source is None or callable(source) or isinstance(source, bool | int | float):
        with as_campaign_error("robot"):
            raise RobotError(
                f"{source!r} describes no robot",
                where="source",
                remedy="give a file, the name of an arm of the catalogue, a URDF, or rows of a DH table",
            )


def _is_pinocchio_model(source: object) -> bool:
    """Return whether a source is a `pinocchio.Model`; Pinocchio is not imported for it."""
    return hasattr(source, "jointPlacements")


@dataclass(frozen=True, eq=False)
class _StatedDescription:
    """Source of a robot's description, and arguments of `robot` that concern some forms of sources."""

    source: object
    base: str | None
    flange: str | None
    convention: str | None
    columns: str | Sequence[str] | None
    units: AnyUnits

    def read_fields(self) -> dict[str, Any]:
        """Return the fields of the robot's document.

        Raises:
            CampaignError: the source describes no robot, or an argument does not concern this form of source.
        """
        of_frames: dict[str, object] = {"base": self.base, "flange": self.flange}
        of_rows: dict[str, object] = {
            "convention": self.convention,
            "columns": self.columns,
            "units": self.units,
        }
        source = self.source
        if isinstance(source, Message | Mapping):
            _refuse_arguments("a robot document", of_frames | of_rows)
            document = plain_fields(source)
            is_campaign = {"robot", "measurement_set"} <= document.keys()
            return plain_fields(document["robot"]) if is_campaign else document
        if isinstance(source, str | PathLike) and _is_urdf(str(source)):
            _refuse_arguments("a URDF", of_rows)
            return _read_urdf_fields(str(source), self.base, self.flange)
        if isinstance(source, str | PathLike):
            _refuse_arguments("a robot file or an arm of the catalogue", of_frames | of_rows)
            return plain_fields(read_robot(str(source)))
        if _is_pinocchio_model(source):
            _refuse_arguments("a model of Pinocchio", {"base": self.base} | of_rows)
            return _convert_model(source, self.flange)
        _refuse_arguments("a table", of_frames)
        return _convert_rows(source, self.convention, self.columns, self.units)


def _refuse_arguments(what: str, arguments: Mapping[str, object]) -> None:
    """Refuse arguments that do not concern the source, which is `what` in words.

    Raises:
        CampaignError: an argument is not None.
    """
    for name, value in arguments.items():
        if value is not None:
            with as_campaign_error("robot"):
                raise RobotError(
                    f"`{name}` has no meaning for {what}",
                    where=name,
                    remedy=f"omit `{name}`, or change the source",
                )


def _is_urdf(text: str) -> bool:
    """Return whether a text is a URDF, or the name of a file of one."""
    return text.lstrip().startswith("<") or Path(text).suffix.lower() in URDF_ENDINGS


def _read_urdf_fields(text: str, base: str | None, flange: str | None) -> dict[str, Any]:
    """Return the fields of a robot from a URDF: its text, or a file, also of xacro.

    Raises:
        CampaignError: this is no URDF, or several links may be the base or the flange.
    """
    from jointstiff.service.conversion.urdf_links import SeveralLinksError, convert_urdf

    try:
        if not text.lstrip().startswith("<"):
            return read_urdf_file(Path(text), base, flange)
        with as_campaign_error("robot"):
            return {"name": "robot", "model": convert_urdf(text, base, flange)}
    except CampaignError as error:
        if not isinstance(error.__cause__, SeveralLinksError):
            raise
        remedy = f"name the link of the flange: jointstiff.robot(urdf, flange='{error.__cause__.link}')"
        raise CampaignError(error.problem.model_copy(update={"remedy": remedy})) from error


def _convert_model(model: Any, flange: str | None) -> dict[str, Any]:  # noqa: ANN401 - a pinocchio.Model
    """Return the fields of a robot from a Pinocchio model, with its bodies if they have masses.

    Raises:
        CampaignError: the model cannot be used, or several frames may be the flange.
    """
    from jointstiff.service.conversion.robots import convert_pinocchio_model

    with as_campaign_error("robot"):
        converted, bodies = convert_pinocchio_model(model, flange)
    fields = {"name": model.name or "robot", "model": converted}
    return fields | {"bodies": bodies} if bodies else fields


def _convert_rows(
    rows: Any,  # noqa: ANN401 - a data frame, mappings or rows
    convention: str | None,
    columns: str | Sequence[str] | None,
    units: AnyUnits,
) -> dict[str, Any]:
    """Return the fields of a robot from rows of Denavit-Hartenberg parameters; arguments as of `robot`.

    Raises:
        CampaignError: the rows are not understood.
    """
    from jointstiff.service.conversion.dh_tables import convert_dh_rows
    from jointstiff.service.conversion.units import complete_units

    if isinstance(units, str) and units.count(",") == 1:  # a robot has no forces
        units = f"{units}, N"
    with as_campaign_error("robot"):
        are_stated = isinstance(units, str) or {"length", "angle"} <= plain_fields(units or {}).keys()
        full_units = complete_units(units)
        model = convert_dh_rows(rows, convention, full_units, columns=columns, units_are_stated=are_stated)
    return {"model": model}


def plain_fields(fields: Message | Mapping[str, Any]) -> dict[str, Any]:
    """Return fields for JSON: of a message those that were set, of a mapping those that are not None."""
    if isinstance(fields, Message):
        return fields.model_dump(mode="json", exclude_unset=True)
    return {
        name: value.model_dump(mode="json", exclude_unset=True) if isinstance(value, Message) else value
        for name, value in fields.items()
        if value is not None
    }
