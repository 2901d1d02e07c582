"""A comparison as a table for spreadsheets: RFC 4180, one row an entry and joint, units in the headers."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import Any, Final

from jointstiff.schemas.comparison import ComparedFit, ComparisonResult

_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")
"""First characters of a text that a spreadsheet takes for a formula."""

_COLUMNS: Final = {
    "method": "fit.method",
    "weighting": "fit.weighting",
    "constraint": "fit.positive",
    "characteristic_length [m]": "fit.characteristic_length",
    "error": "fit.error.detail",
    "compensation [1]": "fit.compensation",
    "rms_residual [m]": "fit.rms_residual",
    "condition_number [1]": "fit.condition_number",
    "joint": "joint.name",
    "status": "joint.status",
    "verdict": "joint.verdict",
    "stiffness [N.m/rad]": "joint.stiffness",
    "stiffness_low [N.m/rad]": "joint.stiffness_interval.0",
    "stiffness_high [N.m/rad]": "joint.stiffness_interval.1",
    "compliance [rad/(N.m)]": "joint.compliance",
    "compliance_standard_uncertainty [rad/(N.m)]": "joint.standard_uncertainty",
    "compliance_low [rad/(N.m)]": "joint.compliance_interval.0",
    "compliance_high [rad/(N.m)]": "joint.compliance_interval.1",
    "resamples": "draws.repetitions",
    "resampled_stiffness_mean [N.m/rad]": "drawn.stiffness_mean",
    "resampled_stiffness_deviation [N.m/rad]": "drawn.stiffness_deviation",
    "resampled_compliance_mean [rad/(N.m)]": "drawn.compliance_mean",
    "resampled_compliance_deviation [rad/(N.m)]": "drawn.compliance_deviation",
    "share_negative [1]": "drawn.share_negative",
    "share_infinite [1]": "drawn.share_infinite",
    "share_undetermined [1]": "drawn.share_undetermined",
    "share_any_negative [1]": "draws.share_any_negative",
    "resampled_compensation_mean [1]": "draws.compensation.mean",
    "resampled_compensation_deviation [1]": "draws.compensation.deviation",
}
"""Headers, and where each column's numbers stand."""


def comparison_csv(result: ComparisonResult) -> str:
    """Return the table. An entry that has no numbers has one row, with no joint, that says why.

    Numbers are written so that they read back the same; what there is no number for is an empty cell, and
    so is the upper end of a stiffness without upper limit.
    """
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(_COLUMNS)
    for entry in result.entries:
        for row in _rows(entry):
            writer.writerow([_cell(row, path) for path in _COLUMNS.values()])
    return text.getvalue()


def _rows(entry: ComparedFit) -> Iterator[dict[str, Any]]:
    draws = entry.resampling
    drawn = [None] * len(entry.joints) if draws is None else draws.joints
    for joint, of_draws in zip(entry.joints, drawn, strict=True):
        yield {"fit": entry, "joint": joint, "draws": draws, "drawn": of_draws}
    if not entry.joints:
        yield {"fit": entry, "joint": None, "draws": None, "drawn": None}


def _cell(row: dict[str, Any], path: str) -> str | float | None:
    """Return the cell of a row at a path."""
    first, *steps = path.split(".")
    value = row[first]
    for step in steps:
        if value is not None:
            value = value[int(step)] if step.isdigit() else getattr(value, step)
    if isinstance(value, bool):
        return "positive" if value else "unconstrained"
    return guarded(value)


def guarded(value: str | float | None) -> str | float | None:
    """Return a cell; a text that a spreadsheet would carry out is led by an apostrophe, which it hides."""
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value
