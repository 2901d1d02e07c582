"""A comparison as a table for spreadsheets: RFC 4180, one row an entry and joint, units in the headers."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import Final

from jointstiff.schemas.comparison import ComparedFit, ComparisonResult
from jointstiff.schemas.run import JointResult, ResampledJoint

__all__ = ["comparison_csv"]

Cell = str | float | None

_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")
"""What makes a spreadsheet take a text for a formula."""

_OF_FIT: Final = (
    "method",
    "weighting",
    "constraint",
    "characteristic_length [m]",
    "error",
    "compensation [1]",
    "rms_residual [m]",
    "condition_number [1]",
)
_OF_JOINT: Final = (
    "joint",
    "status",
    "stiffness [N.m/rad]",
    "stiffness_low [N.m/rad]",
    "stiffness_high [N.m/rad]",
    "compliance [rad/(N.m)]",
    "compliance_standard_uncertainty [rad/(N.m)]",
    "compliance_low [rad/(N.m)]",
    "compliance_high [rad/(N.m)]",
)
_OF_DRAWS: Final = (
    "resamples",
    "resampled_stiffness_mean [N.m/rad]",
    "resampled_stiffness_deviation [N.m/rad]",
    "resampled_compliance_mean [rad/(N.m)]",
    "resampled_compliance_deviation [rad/(N.m)]",
    "share_negative [1]",
    "share_infinite [1]",
    "share_undetermined [1]",
    "share_any_negative [1]",
    "resampled_compensation_mean [1]",
    "resampled_compensation_deviation [1]",
)


def comparison_csv(result: ComparisonResult) -> str:
    """The table. An entry that has no numbers has one row, with no joint, that says why.

    Numbers are written so that they read back the same; what there is no number for is an empty cell, and
    so is the upper end of a stiffness without upper limit.
    """
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(_OF_FIT + _OF_JOINT + _OF_DRAWS)
    for entry in result.entries:
        writer.writerows([_shown(cell) for cell in row] for row in _rows(entry))
    return text.getvalue()


def _rows(entry: ComparedFit) -> Iterator[list[Cell]]:
    of_fit: list[Cell] = [
        entry.method,
        entry.weighting,
        "positive" if entry.positive else "unconstrained",
        entry.characteristic_length,
        entry.error.detail if entry.error else None,
        entry.compensation,
        entry.rms_residual,
        entry.condition_number,
    ]
    if not entry.joints:
        yield of_fit + [None] * (len(_OF_JOINT) + len(_OF_DRAWS))
    for number, joint in enumerate(entry.joints):
        draws = entry.resampling.joints[number] if entry.resampling else None
        yield of_fit + _joint_cells(joint) + _draw_cells(entry, draws)


def _joint_cells(joint: JointResult) -> list[Cell]:
    return [
        joint.name,
        joint.status,
        joint.stiffness,
        *(joint.stiffness_interval or (None, None)),
        joint.compliance,
        joint.standard_uncertainty,
        *(joint.compliance_interval or (None, None)),
    ]


def _draw_cells(entry: ComparedFit, joint: ResampledJoint | None) -> list[Cell]:
    if entry.resampling is None or joint is None:
        return [None] * len(_OF_DRAWS)
    return [
        entry.resampling.repetitions,
        joint.stiffness_mean,
        joint.stiffness_deviation,
        joint.compliance_mean,
        joint.compliance_deviation,
        joint.share_negative,
        joint.share_infinite,
        joint.share_undetermined,
        entry.resampling.share_any_negative,
        entry.resampling.compensation.mean,
        entry.resampling.compensation.deviation,
    ]


def _shown(cell: Cell) -> Cell:
    """A text that a spreadsheet would carry out is led by an apostrophe, which it does not show."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(_FORMULA) else cell
