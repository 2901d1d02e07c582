"""Stiffnesses in the units people use, with as many digits as their uncertainty allows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import radians
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.run import JointResult
from jointstiff.service.tables.table import NO_NUMBER, Line, concise, figure, rounded
from jointstiff.solver.text import rounded_down

_ARC_MINUTE: Final = radians(1.0 / 60.0)


@dataclass(frozen=True)
class StiffnessUnit:
    """A unit of stiffness, or of its inverse."""

    factor: float  # factor of a stiffness in N·m/rad; where inverse, of a compliance in rad/(N·m)
    label: str  # as printed
    inverse: bool = False  # whether compliances are shown

    @property
    def quantity(self) -> str:
        """Name of the quantity that has this unit."""
        return "compliance" if self.inverse else "stiffness"

    def value(self, compliance: float) -> float | None:
        """Convert a compliance [rad/(N·m)]; None for a stiffness without limit."""
        if self.inverse:
            return self.factor * compliance
        return self.factor / compliance if compliance else None

    def uncertainty(self, joint: JointResult) -> float | None:
        """Return the standard uncertainty; of a stiffness to first order: u(k) = u(c) k²."""
        if joint.standard_uncertainty is None:
            return None
        if self.inverse:
            return self.factor * joint.standard_uncertainty
        if joint.stiffness is None:
            return None
        return self.factor * joint.standard_uncertainty * joint.stiffness**2

    def cells(self, joint: JointResult) -> tuple[str, str, str]:
        """Return value, standard uncertainty and interval as printed."""
        if joint.compliance is None:
            return "—", "—", "—"
        uncertainty = self.uncertainty(joint)
        value = self.value(joint.compliance)
        return (
            "rigid" if value is None else rounded(value, uncertainty),
            "—" if uncertainty is None else rounded(uncertainty, uncertainty),
            self._interval(joint, uncertainty),
        )

    def _interval(self, joint: JointResult, uncertainty: float | None) -> str:
        ends = joint.compliance_interval if self.inverse else joint.stiffness_interval
        if ends is not None and ends[1] is not None and joint.stiffness is not None:
            low, high = (rounded(self.factor * end, uncertainty) for end in (ends[0], ends[1]))
            return f"{low} … {high}"
        # Without an upper end of the stiffness: the one-sided bound, which is the higher one.
        least = None if joint.one_sided is None else joint.one_sided.stiffness_at_least
        if least is None:
            return "—"
        bound = rounded_down(least)
        return (
            f"< {figure(self.factor / bound, '.3g')}"
            if self.inverse
            else f"> {figure(self.factor * bound, '.3g')}"
        )

    def concise(self, joint: JointResult) -> Line:
        """Return the value with its standard uncertainty in units of the last digits (GUM, 7.2.2)."""
        value = None if joint.compliance is None else self.value(joint.compliance)
        if value is None:
            return Line(NO_NUMBER if joint.compliance is None else "rigid", "dim")
        return Line(concise(value, self.uncertainty(joint)), "bad" if value < 0 else "")

    def bare(self, compliance: float | None) -> str:
        """Format a compliance [rad/(N·m)] of which no uncertainty is known."""
        if compliance is None:
            return "—"
        value = self.value(compliance)
        return "rigid" if value is None else figure(value, ".3g")

    def bare_interval(self, ends: tuple[float, float] | None) -> str:
        """Format an interval of compliances; the ends of a stiffness swap, and one at zero has no limit."""
        if ends is None or ends[1] <= 0:
            return "—"
        if self.inverse:
            return f"{figure(self.factor * ends[0], '.3g')} … {figure(self.factor * ends[1], '.3g')}"
        return f"{figure(self.factor / ends[1], '.3g')} … " + (
            f"{figure(self.factor / ends[0], '.3g')}" if ends[0] > 0 else "no limit"
        )


UNITS: Final[Mapping[str, StiffnessUnit]] = MappingProxyType(
    {
        "MNm/rad": StiffnessUnit(1e-6, "10⁶ N·m/rad"),
        "kNm/deg": StiffnessUnit(radians(1.0) / 1e3, "kN·m/°"),
        "Nm/arcmin": StiffnessUnit(_ARC_MINUTE, "N·m/arcmin"),
        "Nm/rad": StiffnessUnit(1.0, "N·m/rad"),
        "urad/Nm": StiffnessUnit(1e6, "µrad/(N·m)", inverse=True),
    }
)
"""Units by the names of the terminal; the page has the same."""
DEFAULT_UNIT: Final = "MNm/rad"
