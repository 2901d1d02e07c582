"""A pair as a table for spreadsheets: a row a joint, units in the headers."""

from __future__ import annotations

import csv
import io

from jointstiff.schemas.pair import PairedJoint, PairResult
from jointstiff.schemas.run.joints import JointResult
from jointstiff.service.kinds.comparison.csv_table import guarded

_Row = dict[str, str | float | None]


def pair_csv(result: PairResult) -> str:
    """Return the joints of both sides with their ratio (RFC 4180); numbers read back the same."""
    text = io.StringIO()
    writer = csv.writer(text)
    rows = [_row(joint) for joint in result.joints]
    writer.writerow(rows[0])
    writer.writerows([guarded(cell) for cell in row.values()] for row in rows)
    return text.getvalue()


def _row(joint: PairedJoint) -> _Row:
    low, high = joint.ratio_interval or (None, None)
    not_from, not_to = joint.ratio_excluded or (None, None)
    return {
        "joint": joint.name,
        **_side("first", joint.first),
        **_side("second", joint.second),
        "ratio of stiffnesses, second to first [1]": joint.ratio,
        "ratio low [1]": low,
        "ratio high [1]": high,
        "excluded ratios from [1]": not_from,
        "excluded ratios to [1]": not_to,
        "p-value of equal stiffnesses [1]": joint.p_value,
        "reason": joint.reason,
    }


def _side(name: str, joint: JointResult) -> _Row:
    low, high = joint.stiffness_interval or (None, None)
    return {
        f"{name} status": joint.status,
        f"{name} verdict": joint.verdict,
        f"{name} stiffness [N.m/rad]": joint.stiffness,
        f"{name} stiffness low [N.m/rad]": low,
        f"{name} stiffness high [N.m/rad]": high,
        f"{name} compliance [rad/(N.m)]": joint.compliance,
        f"{name} compliance standard uncertainty [rad/(N.m)]": joint.standard_uncertainty,
    }
