"""Stiffnesses in the units people use, with as many digits as their uncertainty allows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import radians
from types import MappingProxyType
from typing import Final, Protocol

from jointstiff.schemas.joints import JOINT_UNITS, JointKind
from jointstiff.schemas.run import JointResult
from jointstiff.service.tables.table import NO_NUMBER, Line, format_concise, format_rounded
from jointstiff.solver.text import figure, round_down


def lower_limit(joint: JointResult) -> float | None:
    """Return the lower limit of a joint's stiffness in SI units; None without a limit.

    A joint with the verdict `do_not_use` has no limit, as its model is refuted.
    """
    return None if joint.verdict == "do_not_use" else joint.stiffness_at_least


_ARC_MINUTE: Final = radians(1.0 / 60.0)


class HasKind(Protocol):
    """Anything with the kind of a joint, such as a joint of a result."""

    @property
    def kind(self) -> JointKind:
        """Kind of the joint."""


@dataclass(frozen=True)
class StiffnessUnit:
    """A unit of stiffness, or of compliance."""

    factor: float  # factor from SI units to this unit, of a stiffness, or of a compliance if `is_compliance`
    label: str  # name as printed
    is_compliance: bool = False  # whether compliances are shown instead of stiffnesses
    sliding: StiffnessUnit | None = None  # unit for prismatic joints; None if this unit is for all joints

    def for_kind(self, kind: JointKind) -> StiffnessUnit:
        """Return the unit for joints of a kind: `sliding` for prismatic joints, else this unit."""
        return self.sliding if kind == "prismatic" and self.sliding is not None else self

    def label_of(self, joints: Iterable[HasKind]) -> str:
        """Return the unit's label; if a joint is prismatic, followed by the label for prismatic joints."""
        if self.sliding is None or all(joint.kind != "prismatic" for joint in joints):
            return self.label
        return f"{self.label}, or {self.sliding.label} where stated"

    @property
    def quantity(self) -> str:
        """Name of the quantity that has this unit."""
        return "compliance" if self.is_compliance else "stiffness"

    def convert_compliance(self, compliance: float) -> float | None:
        """Convert a compliance in SI units to this unit; None for a rigid joint (infinite stiffness)."""
        if self.is_compliance:
            return self.factor * compliance
        return self.factor / compliance if compliance else None

    def uncertainty(self, joint: JointResult) -> float | None:
        """Return the standard uncertainty of a joint's number in this unit; None if it is unknown.

        The uncertainty of a stiffness k = 1/c follows from that of the compliance c to first order:
        u(k) = u(c) k².
        """
        if joint.standard_uncertainty is None:
            return None
        if self.is_compliance:
            return self.factor * joint.standard_uncertainty
        if joint.stiffness is None:
            return None
        return self.factor * joint.standard_uncertainty * joint.stiffness**2

    def cells(self, joint: JointResult) -> tuple[str, str, str]:
        """Return (value, standard uncertainty, interval) of a joint as texts, in this unit.

        The value of a prismatic joint is followed by its unit, which differs from that of the column.
        """
        if (unit := self.for_kind(joint.kind)) is not self:
            cells = unit.cells(joint)
            return cells[0] if joint.compliance is None else f"{cells[0]} {unit.label}", cells[1], cells[2]
        if joint.compliance is None:
            return "—", "—", "—"
        uncertainty = self.uncertainty(joint)
        value = self.convert_compliance(joint.compliance)
        return (
            "rigid" if value is None else format_rounded(value, uncertainty),
            "—" if uncertainty is None else format_rounded(uncertainty, uncertainty),
            self._interval(joint, uncertainty),
        )

    def _interval(self, joint: JointResult, uncertainty: float | None) -> str:
        """Return a joint's interval as text: `low … high`, a one-sided bound such as `> 3.1`, or a dash."""
        interval = joint.compliance_interval if self.is_compliance else joint.stiffness_interval
        if interval is not None and interval[1] is not None and joint.stiffness is not None:
            lower, upper = (
                format_rounded(self.factor * end, uncertainty) for end in (interval[0], interval[1])
            )
            return f"{lower} … {upper}"
        # Without an upper end the one-sided bound is shown: it is tighter than the lower end of the interval.
        if (lower_stiffness := lower_limit(joint)) is None:
            return "—"
        bound = round_down(lower_stiffness)
        return (
            f"< {figure(self.factor / bound, '.3g')}"
            if self.is_compliance
            else f"> {figure(self.factor * bound, '.3g')}"
        )

    def format_concise(self, joint: JointResult) -> Line:
        """Return a joint's value with its standard uncertainty in the last digits: 2.51(12) (GUM, 7.2.2)."""
        if (unit := self.for_kind(joint.kind)) is not self:
            line = unit.format_concise(joint)
            return line if joint.compliance is None else Line(f"{line.text} {unit.label}", line.style)
        value = None if joint.compliance is None else self.convert_compliance(joint.compliance)
        if value is None:
            return Line(NO_NUMBER if joint.compliance is None else "rigid", "dim")
        return Line(format_concise(value, self.uncertainty(joint)), "bad" if value < 0 else "")

    def format_compliance(self, compliance: float | None, kind: JointKind = "revolute") -> str:
        """Format a compliance in SI units, whose uncertainty is unknown, in this unit."""
        if compliance is None:
            return "—"
        if (unit := self.for_kind(kind)) is not self:
            return f"{unit.format_compliance(compliance)} {unit.label}"
        value = self.convert_compliance(compliance)
        return "rigid" if value is None else figure(value, ".3g")

    def format_compliance_interval(self, interval: tuple[float, float] | None) -> str:
        """Format an interval of compliances in SI units; a lower end of 0 gives a stiffness without limit."""
        if interval is None or interval[1] <= 0:
            return "—"
        if self.is_compliance:
            return f"{figure(self.factor * interval[0], '.3g')} … {figure(self.factor * interval[1], '.3g')}"
        return f"{figure(self.factor / interval[1], '.3g')} … " + (
            f"{figure(self.factor / interval[0], '.3g')}" if interval[0] > 0 else "no limit"
        )


_PER_MICRON: Final = StiffnessUnit(1e-6, JOINT_UNITS["prismatic"].million_stiffness)
UNITS: Final[Mapping[str, StiffnessUnit]] = MappingProxyType(
    {
        "MNm/rad": StiffnessUnit(1e-6, JOINT_UNITS["revolute"].million_stiffness, sliding=_PER_MICRON),
        "kNm/deg": StiffnessUnit(radians(1.0) / 1e3, "kN·m/°", sliding=_PER_MICRON),
        "Nm/arcmin": StiffnessUnit(_ARC_MINUTE, "N·m/arcmin", sliding=_PER_MICRON),
        "Nm/rad": StiffnessUnit(1.0, "N·m/rad", sliding=StiffnessUnit(1.0, "N/m")),
        "urad/Nm": StiffnessUnit(
            1e6,
            JOINT_UNITS["revolute"].micro_compliance,
            is_compliance=True,
            sliding=StiffnessUnit(1e6, JOINT_UNITS["prismatic"].micro_compliance, is_compliance=True),
        ),
    }
)
"""Name of a unit on the terminal and on the page → unit."""
DEFAULT_UNIT: Final = "MNm/rad"
