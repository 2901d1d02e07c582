"""Numbers of a run that other programs read from the database by SQL (docs/sql.md)."""

from __future__ import annotations

from typing import Any

from jointstiff.schemas.joints import JOINT_UNITS
from jointstiff.schemas.run import JointResult, Run


def extract_numbers(run: Run) -> dict[str, Any] | None:
    """Return verdict and stiffnesses of a run, as stored in its row; None if the run has no result."""
    result = run.result
    if result is None:
        return None
    return {
        "verdict": result.assessment.verdict,
        "confidence": run.request.confidence,
        "joints": [_extract_joint(joint) for joint in result.joints],
    }


def _extract_joint(joint: JointResult) -> dict[str, Any]:
    """Return the numbers of a joint; an interval's upper end of None means no upper limit."""
    return {
        "name": joint.name,
        "verdict": joint.verdict,
        "status": joint.status,
        "stiffness": joint.stiffness,
        "interval": None if joint.stiffness_interval is None else list(joint.stiffness_interval),
        "at_least": joint.stiffness_at_least,
        "unit": JOINT_UNITS[joint.kind].stiffness,
    }
