"""A run as tables: CSV of its joints, and an Excel workbook with kinematics, provenance and warnings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from jointstiff.schemas.run.joints import JointResult
from jointstiff.service.exporting.model import ExportedModel, stiffness_of, why_no_stiffness
from jointstiff.service.tables.files import csv_text, xlsx_bytes
from jointstiff.service.tables.table import Sheet, Value
from jointstiff.service.tables.verdict import judged

_PLACE: Final = ("x [m]", "y [m]", "z [m]", "roll [rad]", "pitch [rad]", "yaw [rad]")
_AXIS: Final = ("axis x [1]", "axis y [1]", "axis z [1]")


def joints_table(model: ExportedModel) -> Sheet:
    """Return a row a joint. What there is no number for is an empty cell, and `reason` says why."""
    sheet = Sheet.of_rows(_joint_row(model, joint) for joint in model.result.joints)
    return judged(sheet, model.result.assessment)


def _joint_row(model: ExportedModel, joint: JointResult) -> dict[str, Value]:
    bounds = joint.one_sided
    has_number = stiffness_of(joint) is not None
    return {
        "joint": joint.name,
        "status": joint.status,
        "verdict": joint.verdict,
        "reason": joint.reason if has_number else why_no_stiffness(joint),
        "stiffness [N.m/rad]": joint.stiffness,
        **_ends("stiffness {} [N.m/rad]", joint.stiffness_interval),
        "stiffness at least, one-sided [N.m/rad]": None if bounds is None else bounds.stiffness_at_least,
        "stiffness at most, one-sided [N.m/rad]": None if bounds is None else bounds.stiffness_at_most,
        "compliance [rad/(N.m)]": joint.compliance,
        "compliance standard uncertainty [rad/(N.m)]": joint.standard_uncertainty,
        **_ends("compliance {} [rad/(N.m)]", joint.compliance_interval),
        "confidence of the intervals [1]": model.run.request.confidence,
        **_budget(model, joint.name),
        "run": model.run.id,
        "input SHA-256": model.run.provenance.input_hash,
    }


def _budget(model: ExportedModel, joint: str) -> dict[str, Value]:
    """Return the contributions to the uncertainty of a joint's compliance, if the run has a budget."""
    budget = model.result.budget
    if budget is None:
        return {}
    place = budget.joints.index(joint) if joint in budget.joints else None

    def at(values: Sequence[float]) -> float | None:
        return None if place is None else values[place]

    return {
        **{
            f"contribution of {each.source.replace('_', ' ')}, type {each.evaluation}"
            f"{'' if each.included else ', not included'} [rad/(N.m)]": at(each.contributions)
            for each in budget.components
        },
        "compliance expanded uncertainty [rad/(N.m)]": at(budget.expanded_uncertainty),
        "compliance expanded uncertainty with model error [rad/(N.m)]": at(budget.expanded_with_model_error),
        "coverage factor [1]": budget.coverage_factor,
    }


def _ends(header: str, ends: tuple[float, float | None] | None) -> dict[str, Value]:
    low, high = (None, None) if ends is None else ends
    return {header.format("low"): low, header.format("high"): high}


def kinematics_table(model: ExportedModel) -> Sheet:
    """Return a row a joint of the chain: its frame in that of the link that carries it, at angle zero."""
    rows: list[dict[str, Value]] = []
    for joint in model.chain.joints:
        lower, upper = joint.limits or (None, None)
        rows.append(
            {
                "joint": joint.name,
                "type": joint.kind,
                "child link": joint.child,
                **dict(zip(_PLACE, [*joint.translation.tolist(), *joint.roll_pitch_yaw], strict=True)),
                **dict(zip(_AXIS, joint.axis.tolist() if joint.is_moving else [None] * 3, strict=True)),
                "lower limit [rad]": lower,
                "upper limit [rad]": upper,
            }
        )
    return Sheet.of_rows(rows)


def remarks_table(model: ExportedModel) -> Sheet:
    """Return what holds for all numbers: a line a row."""
    result = model.result
    figures: dict[str, Any] = {
        "compensation [1]": result.compensation,
        "root mean square of the residuals [m]": result.rms_residual,
        "standard uncertainty of a coordinate of a reading [m]": result.sigma,
    }
    lines: list[tuple[str, Value]] = [*((line, None) for line in model.remarks()), *figures.items()]
    return Sheet.of_rows({"remark": line, "value": value} for line, value in lines)


def warnings_table(model: ExportedModel) -> Sheet:
    """Return the reasons of the assessment and the warnings, a row each."""
    result = model.result
    rows: list[tuple[Value, ...]] = [
        (each.code, each.weight, each.where, each.message, each.remedy) for each in result.assessment.reasons
    ]
    rows += [(each.code, each.weight, each.where, each.message, each.remedy) for each in result.warnings]
    headers = ("code", "weight", "where", "message", "remedy")
    return Sheet.of_rows(dict(zip(headers, row, strict=True)) for row in rows)


def joints_csv(model: ExportedModel) -> bytes:
    """Return the table of the joints as CSV (RFC 4180); numbers read back the same."""
    return csv_text(joints_table(model)).encode()


def workbook(model: ExportedModel) -> bytes:
    """Return the workbook; numbers have 16 digits, and no cell is a formula."""
    sheets = {
        "joints": joints_table(model),
        "kinematics": kinematics_table(model),
        "provenance": remarks_table(model),
        "warnings": warnings_table(model),
    }
    return xlsx_bytes({name: sheet for name, sheet in sheets.items() if sheet.columns})
