"""What people read of a result, and how they want to see it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS, StiffnessUnit
from jointstiff.service.tables.table import Part


@dataclass(frozen=True)
class View:
    """How much of a job is shown, and in which unit of stiffness."""

    details: bool = False  # whether to show all that the result says
    unit: StiffnessUnit = UNITS[DEFAULT_UNIT]


@dataclass(frozen=True)
class Report:
    """What people read of a result, beside its verdict, its warnings and the remedies of both."""

    parts: Sequence[Part]  # between verdict and warnings
    evidence: Sequence[Part] = ()  # below the warnings
    advice: Sequence[str] = ()  # things to do beside the remedies
