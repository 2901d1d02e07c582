"""Identified models as files that other programs load: tables, workbooks and MJCF."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Literal
from xml.etree import ElementTree

import numpy as np

from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.run import Budget, JointAlone, JointResult, Run, RunResult
from jointstiff.service.runs.verdicts import refuse_unaccepted, require_result
from jointstiff.service.tables.files import csv_text, xlsx_bytes
from jointstiff.service.tables.report import METHOD_NAMES, VERDICTS, with_overall_verdict
from jointstiff.service.tables.stiffness import UNITS, lower_limit
from jointstiff.service.tables.table import Sheet, Value
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.chain import ChainJoint, KinematicChain
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.text import round_down, stiffness_text

_UNIT = UNITS["MNm/rad"]
PLACEHOLDERS = (
    "Masses and inertias are placeholders that the format requires, and gravity is off: for dynamics or own "
    "weight, enter the values of the robot."
)


@dataclass(frozen=True, eq=False)
class ExportedModel:
    """A run with its result and its robot, ready to be written as a file for other programs."""

    run: Run  # identification run
    result: RunResult  # result of the run
    robot: Robot  # robot that was measured
    name: str  # name of the robot
    # id of the geometry identification whose result is the robot's model; None if the model was posted
    geometry_id: str | None = None

    @classmethod
    def from_run(cls, run: Run, robot: Robot, name: str, geometry_id: str | None = None) -> ExportedModel:
        """Return the model to export from a run, its robot and the robot's name.

        Raises:
            RequestError: the run has no result.
        """
        return cls(run, require_result(run), robot, name, geometry_id)

    @property
    def chain(self) -> KinematicChain:
        """Kinematic chain of the robot."""
        return self.robot.chain

    def springs(self) -> Iterator[tuple[ChainJoint, float | None]]:
        """Yield (moving joint, stiffness in SI units; None if not positive) of the fit by joints alone.

        Where links bend, effective stiffnesses without the links would be a worse robot than this fit.
        """
        results: Sequence[JointResult | JointAlone] = self.result.joints
        if self.result.alone is not None:
            results = self.result.alone.joints
        for joint, result in zip(self.chain.moving, results, strict=True):
            yield joint, positive_stiffness(result)

    def remarks(self) -> list[str]:
        """Return lines about the whole file: robot, run, method, verdict, geometry, units and limits."""
        provenance = self.run.provenance
        version = provenance.versions.get("jointstiff", "")
        time = provenance.created_at.isoformat()
        return [
            f"Joint stiffness of {self.name}, identified from laser-tracker readings by jointstiff "
            f"{version}.",
            f"Run {self.run.id} of {time}; SHA-256 of its input: {provenance.input_hash}.",
            self._describe_method(),
            f"Verdict on the result: {VERDICTS[self.result.assessment.verdict]}.",
            self._describe_geometry(),
            f"Lengths in m, angles in rad, stiffness in {self._stiffness_units()}. Angles are those of the "
            f"model, in the frame of the link {self.chain.base}.",
            *self._list_limits(),
        ]

    def _describe_method(self) -> str:
        """Return a line on method, weights and constraint of the fit, and on the level of its intervals."""
        request = self.run.request
        constraint = "compliances not negative" if request.positive else "unconstrained"
        return (
            f"Method: {METHOD_NAMES[request.method]}, {request.weighting} weights, {constraint}. "
            f"Intervals at {100 * request.confidence:g} %."
        )

    def _describe_geometry(self) -> str:
        """Return a line on the source of the lengths and axes of the robot's model."""
        if self.geometry_id is None:
            return "Geometry: as in the robot's model, not identified."
        return f"Geometry: as identified, geometry {self.geometry_id}."

    def _stiffness_units(self) -> str:
        """Return the unit of stiffness as text; for a robot with prismatic joints also their unit."""
        prismatic = "" if not self.robot.prismatic.any() else ", of prismatic joints in N/m"
        return f"N·m/rad{prismatic}"

    def _list_limits(self) -> Iterator[str]:
        """Yield the limits of the file as sentences: controller angles that differ, and links that bend."""
        joint_map = self.robot.joint_map
        n = len(joint_map.offset)
        if not (np.array_equal(joint_map.matrix, np.eye(n)) and not joint_map.offset.any()):
            yield (
                "The controller shows other angles: model angles = matrix · controller angles + offset, with "
                f"the matrix {joint_map.matrix.tolist()} and the offset {joint_map.offset.tolist()} rad."
            )
        if self.result.links is not None:
            yield (
                "The run found that links or a coupling of joints bend, too. An effective number is that of "
                "a joint together with the motion of its link about or along the axis of the joint, an own "
                "number that of the joint, which predicts together with the links."
            )
        if self.result.alone is not None:
            yield (
                "A number alone is that of the fit in which only joints bend: it explains "
                f"{100 * self.result.alone.compensation:.1f} % of the deflection of held-out postures, "
                f"the model with links {100 * self._held_out_score():.1f} %."
            )

    def _held_out_score(self) -> float:
        """Return the compensation of held-out postures by the model of a run with links."""
        choice = self.result.choice
        if choice is None:
            raise ValueError("a run whose links bend states its choice")
        scores = {(each.model, each.loss): each.compensation for each in choice.models}
        return scores[choice.elasticity, choice.loss]

    def describe_joint(self, joint: JointResult) -> str:
        """Return a line on a joint: stiffness, interval and verdict, or why it has no stiffness."""
        verdict = f"verdict: {VERDICTS[joint.verdict]}"
        if positive_stiffness(joint) is None:
            return f"{joint.name}: no stiffness: {explain_missing_stiffness(joint)}; {verdict}"
        shown = _UNIT.show_joint(joint)
        level = f"{100 * self.run.request.confidence:g} % interval {shown.interval}"
        number = f"{shown.value} {shown.unit}" if shown.unit else f"{shown.value} · {_UNIT.label}"
        return f"{joint.name}: {number} ({level}); {verdict}"


def positive_stiffness(joint: JointResult | JointAlone) -> float | None:
    """Return the stiffness of a joint in SI units if it is positive, as a spring needs; otherwise None."""
    return joint.stiffness if joint.stiffness is not None and joint.stiffness > 0.0 else None


def explain_missing_stiffness(joint: JointResult) -> str:
    """Return why a joint has no positive stiffness: undetermined, negative, or as good as rigid."""
    if joint.compliance is None:
        return joint.reason or "the readings cannot determine the stiffness"
    if joint.compliance < 0.0:
        return "the estimate is negative: identify again with non-negative compliances"
    least, bound = lower_limit(joint), ""
    if least is not None:
        bound = f"; the stiffness is at least {stiffness_text(round_down(least), joint.kind)}"
    return f"the readings cannot distinguish the joint from rigid{bound}"


_JOINT: Final = {
    "stiffness": "stiffness",
    "stiffness {low high}": "stiffness_interval",
    "stiffness at least, one-sided": "stiffness_at_least",
    "compliance": "compliance",
    "compliance standard uncertainty": "standard_uncertainty",
    "compliance {low high}": "compliance_interval",
}
"""Field of `JointResult` by header of the column; the unit of the field is added to the header."""
_WITH_LINKS: Final = {f"effective {header}": field for header, field in _JOINT.items()} | {
    "own compliance": "own_compliance"
}
"""As `_JOINT`, for a run whose links bend."""
_ALONE: Final = {"stiffness alone": "stiffness", "compliance alone": "compliance"}
"""Field of `JointAlone` by header of the column."""
_FRAME: Final = ("x [m]", "y [m]", "z [m]", "roll [rad]", "pitch [rad]", "yaw [rad]")
_AXIS: Final = ("axis x [1]", "axis y [1]", "axis z [1]")
_FINDING: Final = ("code", "weight", "where", "message", "remedy")


def tabulate_joints(model: ExportedModel) -> Sheet:
    """Return a sheet with one row per joint; a missing number is an empty cell, explained in `reason`."""
    joints, run = model.result.joints, model.run
    names_and_verdicts = {"joint": "name", "status": "status", "verdict": "verdict"}
    columns: dict[str, Any] = dict(Sheet.from_messages(joints, names_and_verdicts).columns)
    columns["reason"] = [_explain_joint(joint) for joint in joints]
    with_limit = [joint.model_copy(update={"stiffness_at_least": lower_limit(joint)}) for joint in joints]
    has_links = model.result.links is not None
    columns |= Sheet.from_messages(with_limit, _WITH_LINKS if has_links else _JOINT).columns
    if model.result.alone is not None:
        columns |= Sheet.from_messages(model.result.alone.joints, _ALONE).columns
    columns["confidence of the intervals [1]"] = [run.request.confidence] * len(joints)
    if model.result.budget is not None:
        columns |= _make_budget_columns(model.result.budget, joints)
    columns["run"] = [run.id] * len(joints)
    columns["input SHA-256"] = [run.provenance.input_hash] * len(joints)
    sheet = Sheet.with_joint_kinds(Sheet(columns), [joint.kind for joint in joints])
    return with_overall_verdict(sheet, model.result.assessment)


def _explain_joint(joint: JointResult) -> str | None:
    """Return the remark on a joint's number or, if it has no positive stiffness, why not."""
    if positive_stiffness(joint) is None:
        return explain_missing_stiffness(joint)
    return joint.reason


def _make_budget_columns(budget: Budget, joints: Sequence[JointResult]) -> dict[str, list[float | None]]:
    """Return header → numbers of the uncertainty budget, one for each joint; None for joints without one."""
    columns = dict[str, list[float | None]]()
    for header, values in _list_budget_columns(budget):
        value_by_joint = dict(zip(budget.joints, values, strict=True))
        columns[header] = [value_by_joint.get(joint.name) for joint in joints]
    columns["coverage factor [1]"] = [budget.coverage_factor] * len(joints)
    return columns


def _list_budget_columns(budget: Budget) -> Iterator[tuple[str, Sequence[float | None]]]:
    """Yield header and values, one for each joint of the budget, of each column of an uncertainty budget."""
    for component in budget.components:
        source = component.source.replace("_", " ")
        remark = "" if component.included else ", not included"
        header = f"contribution of {source}, type {component.evaluation}{remark} [rad/(N.m)]"
        yield header, component.contributions
    yield "compliance expanded uncertainty [rad/(N.m)]", budget.expanded_uncertainty
    yield (
        "compliance expanded uncertainty with model error [rad/(N.m)]",
        budget.expanded_with_model_error,
    )


def tabulate_kinematics(model: ExportedModel) -> Sheet:
    """Return a sheet with one row per joint of the chain: type, frame, axis and limits.

    The frame of a joint is stated at joint position zero, relative to the frame of the link that carries it.
    """
    rows, kinds = list[dict[str, Value]](), list[JointKind | None]()
    for joint in model.chain.joints:
        lower, upper = joint.limits or (None, None)
        frame = [*joint.translation.tolist(), *joint.roll_pitch_yaw]
        axis = joint.axis.tolist() if joint.is_moving else [None] * 3
        row: dict[str, Value] = {"joint": joint.name, "type": joint.kind, "child link": joint.child}
        row |= zip(_FRAME, frame, strict=True)
        row |= zip(_AXIS, axis, strict=True)
        row |= {"lower limit [rad]": lower, "upper limit [rad]": upper}
        rows.append(row)
        kinds.append(None if joint.kind == "fixed" else joint.kind)
    return Sheet.with_joint_kinds(Sheet.from_rows(rows), kinds)


def write_joints_csv(model: ExportedModel) -> bytes:
    """Return the table of the joints as CSV (RFC 4180); reading the numbers gives the same floats."""
    return csv_text(tabulate_joints(model)).encode()


def write_workbook(model: ExportedModel) -> bytes:
    """Return an Excel workbook with the sheets joints, kinematics, provenance and warnings.

    A sheet without content, such as that of warnings, is left out.
    """
    findings = [*model.result.assessment.reasons, *model.result.warnings]
    fields_by_header = dict(zip(_FINDING, _FINDING, strict=True))
    sheets = {
        "joints": tabulate_joints(model),
        "kinematics": tabulate_kinematics(model),
        "provenance": _tabulate_provenance(model),
        "warnings": Sheet.from_messages(findings, fields_by_header),
    }
    return xlsx_bytes({name: sheet for name, sheet in sheets.items() if sheet.columns})


def _tabulate_provenance(model: ExportedModel) -> Sheet:
    """Return a sheet with remarks, which have no value, and then with quantities and their values."""
    rows: dict[str, Value] = {
        **dict.fromkeys(model.remarks()),
        "compensation [1]": model.result.compensation,
        "root mean square of the residuals [m]": model.result.rms_residual,
        "standard uncertainty of a coordinate of a reading [m]": model.result.sigma,
    }
    return Sheet({"remark": list(rows), "value": list(rows.values())})


Element = ElementTree.Element


def add_element(parent: Element, tag: str, text: str | None = None, **attributes: str) -> Element:
    """Append an XML element to a parent and return the element."""
    element = ElementTree.SubElement(parent, tag, attributes)
    element.text = text
    return element


def add_remarks(parent: Element, model: ExportedModel, *further_remarks: str) -> None:
    """Append XML comments: the remarks on the whole model, further remarks, and a remark on each joint."""
    joint_remarks = [model.describe_joint(joint) for joint in model.result.joints]
    for line in (*model.remarks(), *further_remarks, *joint_remarks):
        add_comment(parent, line)


def add_comment(parent: Element, text: str) -> None:
    """Append an XML comment; two dashes in a row, which XML forbids in comments, are separated."""
    while "--" in text:
        text = text.replace("--", "- -")
    parent.append(ElementTree.Comment(f" {text} "))


def format_numbers(values: Iterable[float]) -> str:
    """Return numbers as text separated by blanks, with all digits of the floats."""
    return " ".join(repr(float(value)) for value in values)


def xml_bytes(root: Element) -> bytes:
    """Return an XML document as indented UTF-8 with a declaration."""
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"


_ACTUATORS: Final = (
    "Each position actuator is the spring in series with a drive that holds its joint: kp is the "
    "stiffness, ctrl the commanded position, and the position of the joint differs from ctrl by the "
    "torque or force divided by kp."
)
_RIGID_JOINTS: Final = (
    "A joint without a stiffness has no actuator: an equality constraint, which is no spring of the "
    "robot, holds the joint at the position that the first number of polycoef states."
)


def write_mjcf(model: ExportedModel) -> bytes:
    """Return a MuJoCo model (MJCF) of hinges, slides and position actuators; the world frame is R0.

    Raises:
        RequestError: an older run whose links bend states no fit by joints alone.
    """
    if model.result.links is not None and model.result.alone is None:
        raise RequestError(
            f"run '{model.run.id}' has bending links, but no fit by joints alone",
            where="format",
            remedy="identify the measurement set again, and export the new run",
        )
    root = ElementTree.Element("mujoco", model=model.name)
    add_remarks(root, model, _ACTUATORS, _RIGID_JOINTS, PLACEHOLDERS)
    # `eulerseq` in capital letters: roll, pitch and yaw turn about fixed axes. MuJoCo requires that moving
    # bodies have mass and inertia: placeholders of 1.
    add_element(
        root, "compiler", angle="radian", eulerseq="XYZ", autolimits="true", boundmass="1", boundinertia="1"
    )
    add_element(root, "option", gravity="0 0 0")
    body = add_element(add_element(root, "worldbody"), "body", name=model.chain.base)
    for joint in model.chain.joints:
        body = _add_body(body, joint)
    add_element(body, "site", name=model.chain.flange)
    _add_springs(root, model)
    return xml_bytes(root)


def _add_springs(root: ElementTree.Element, model: ExportedModel) -> None:
    """Add a position actuator with the stiffness as gain `kp` for each elastic joint of a MuJoCo model.

    A joint without a stiffness is rigid: a constraint holds its position at zero.
    """
    actuators, constraints = add_element(root, "actuator"), add_element(root, "equality")
    for joint, stiffness in model.springs():
        name = joint.name
        if stiffness is None:
            add_element(constraints, "joint", name=f"{name} held", joint1=name, polycoef="0 0 0 0 0")
        else:
            add_element(actuators, "position", name=name, joint=name, kp=format_numbers([stiffness]))


def _add_body(parent: Element, joint: ChainJoint) -> Element:
    """Append the body of a joint's child link, with the joint if it moves; return the body."""
    pose = {"pos": format_numbers(joint.translation), "euler": format_numbers(joint.roll_pitch_yaw)}
    body = add_element(parent, "body", name=joint.child, **pose)
    if joint.is_moving:
        kind = "slide" if joint.kind == "prismatic" else "hinge"
        limits = {} if joint.limits is None else {"range": format_numbers(joint.limits)}
        add_element(body, "joint", name=joint.name, type=kind, axis=format_numbers(joint.axis), **limits)
    return body


ModelFormat = Literal["csv", "xlsx", "mjcf"]


@dataclass(frozen=True)
class Format:
    """File format of an exported model."""

    write: Callable[[ExportedModel], bytes]  # returns the content of the file
    media_type: str  # for HTTP


FORMATS: Final[Mapping[ModelFormat, Format]] = MappingProxyType(
    {
        "csv": Format(write_joints_csv, "text/csv"),
        "xlsx": Format(write_workbook, "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"),
        "mjcf": Format(write_mjcf, "application/xml"),
    }
)


def export_model(model: ExportedModel, name: ModelFormat, accept_verdict: str | None = None) -> bytes:
    """Return the content of a file with a model, in the format of this name.

    Raises:
        VerdictError: the verdict on the run is "do not use", and `accept_verdict` does not accept it.
    """
    refuse_unaccepted(model.result.assessment, accept_verdict, f"run '{model.run.id}'")
    return FORMATS[name].write(model)
