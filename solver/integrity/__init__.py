"""Plausibility checks of a measurement set: the usual mistakes of a long day."""

from jointstiff.solver.integrity.report import MAX_FINDINGS_PER_CODE, inspect

__all__ = ["MAX_FINDINGS_PER_CODE", "inspect"]
