"""Results for people: the parts that a kind gives, and how much of them is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jointstiff.service.tables.stiffness import DEFAULT_UNIT, UNITS, StiffnessUnit
from jointstiff.service.tables.table import Part


@dataclass(frozen=True)
class View:
    """Extent of what is shown of a job, and the unit of stiffness."""

    details: bool = False  # whether to show all that the result says
    unit: StiffnessUnit = UNITS[DEFAULT_UNIT]


@dataclass(frozen=True)
class Report:
    """Parts of a result for people, beside its verdict, its warnings and the remedies of both."""

    parts: Sequence[Part]  # between verdict and warnings
    evidence: Sequence[Part] = ()  # below the warnings
    advice: Sequence[str] = ()  # things to do beside the remedies
