"""What is suspicious in a set though not impossible: the usual mistakes of a long day."""

from jointstiff.solver.integrity.report import MAX_FINDINGS_PER_CODE, inspect

__all__ = ["MAX_FINDINGS_PER_CODE", "inspect"]
