"""Robust loss: which readings it gives less weight, by name."""

from __future__ import annotations

from typing import Final

from jointstiff.schemas.run import run as runs
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.solver.inference import Estimate

__all__ = ["MAX_SUSPICIOUS", "to_robust_loss"]

MAX_SUSPICIOUS: Final = 100
"""Readings that are listed; all are counted."""


def to_robust_loss(estimate: Estimate, readings: ReadingArrays) -> runs.RobustLoss | None:
    """What the Huber loss made of the readings, worst first; None for the squared loss."""
    robust = estimate.robust
    if robust is None:
        return None
    suspicious = robust.suspicious
    labels, targets = readings.labels.tolist(), readings.targets.tolist()
    return runs.RobustLoss(
        threshold=robust.threshold,
        suspicious=[
            runs.SuspiciousReading(
                observation=labels[i],
                target=targets[t],
                weight=float(robust.weight[i, t]),
                residual_norm=float(robust.residual_norm[i, t]),
            )
            for i, t in suspicious[:MAX_SUSPICIOUS].tolist()
        ],
        suspicious_count=len(suspicious),
    )
