"""Stiffnesses in the units people use, with as many digits as their uncertainty allows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import inf, isfinite, radians
from types import MappingProxyType
from typing import Final, Protocol

from jointstiff.schemas.joints import JOINT_UNITS, JointKind
from jointstiff.schemas.run import JointResult
from jointstiff.service.tables.estimate import NO_INTERVAL, Ends, ShownEstimate, show_estimate
from jointstiff.service.tables.table import NO_NUMBER
from jointstiff.solver.text import figure, round_down


def _invert(compliance: float) -> float | None:
    """Return 1 / c of a compliance c; None for a rigid joint."""
    stiffness = 1.0 / compliance if compliance else inf
    return stiffness if isfinite(stiffness) else None


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
    """A unit of stiffness."""

    factor: float  # factor from SI units to this unit
    label: str  # name as printed
    sliding: StiffnessUnit | None = None  # unit for prismatic joints; None if this unit is for all joints

    def for_kind(self, kind: JointKind) -> StiffnessUnit:
        """Return the unit for joints of a kind: `sliding` for prismatic joints, else this unit."""
        return self.sliding if kind == "prismatic" and self.sliding is not None else self

    def label_of(self, joints: Iterable[HasKind]) -> str:
        """Return the unit's label; if a joint is prismatic, followed by the label for prismatic joints."""
        if self.sliding is None or all(joint.kind != "prismatic" for joint in joints):
            return self.label
        return f"{self.label}, or {self.sliding.label} where stated"

    def show_joint(self, joint: JointResult) -> ShownEstimate:
        """Format a joint's number with its interval, in this unit; dimmed if the joint must not be used.

        Where the stiffness has no upper limit, its one-sided lower limit takes the place of the number: the
        limit is tighter than the lower end of the interval.
        """
        is_refuted, compliance = joint.verdict == "do_not_use", joint.compliance
        shown = self.show_compliance(compliance, joint.compliance_interval, joint.kind, lower_limit(joint))
        interval = joint.compliance_interval
        is_open = compliance == 0.0 or (interval is not None and interval[0] == 0.0)
        if is_refuted and is_open:
            # Neither the number nor the limit of a refuted model says anything.
            return ShownEstimate(NO_NUMBER, style="dim")
        is_negative = compliance is not None and compliance < 0.0
        return replace(
            shown, style="dim" if is_refuted or not shown.interval else "bad" if is_negative else ""
        )

    def show_compliance(
        self,
        compliance: float | None,
        interval: tuple[float, float] | None,
        kind: JointKind = "revolute",
        at_least: float | None = None,
    ) -> ShownEstimate:
        """Format a compliance in SI units with its interval, in this unit.

        Args:
            compliance: the compliance; None if the readings do not determine the compliance.
            interval: its lower and upper end; None if the uncertainty is unknown.
            kind: kind of the joint.
            at_least: lower limit of the stiffness at the full confidence, used if the interval reaches zero.
        """
        if (unit := self.for_kind(kind)) is not self:
            shown = unit.show_compliance(compliance, interval, at_least=at_least)
            return shown if compliance is None else replace(shown, unit=unit.label)
        if compliance is None:
            return ShownEstimate(NO_NUMBER, style="dim")
        shown = self._show_stiffness(compliance, interval)
        is_open = compliance == 0.0 or (interval is not None and interval[0] == 0.0)
        if at_least is None or not is_open:
            return shown
        return replace(shown, limit=self._format_limit(at_least))

    def show_stiffness(
        self,
        stiffness: float | None,
        interval: Ends | None,
        kind: JointKind = "revolute",
        *,
        may_be_used: bool = True,
    ) -> ShownEstimate:
        """Format a stiffness in SI units with its interval, in this unit; dimmed unless it may be used.

        A stiffness without an upper limit is shown as its lower limit; without a limit, and if it is zero or
        unknown, as a dash.
        """
        low, high = interval or (None, None)
        if low is not None and high is None:
            compliances = (0.0, 1.0 / low)
            limit = low if may_be_used else None
            shown = self.show_compliance(1.0 / stiffness if stiffness else 0.0, compliances, kind, limit)
        else:
            ends = None if low is None or high is None else (1.0 / high, 1.0 / low)
            shown = self.show_compliance(1.0 / stiffness if stiffness else None, ends, kind)
        return shown if may_be_used else replace(shown, style="dim")

    def _show_stiffness(self, compliance: float, interval: tuple[float, float] | None) -> ShownEstimate:
        """Format the stiffness that belongs to a compliance with its interval, both in SI units."""
        stiffness = _invert(compliance)
        if interval is None:
            shown = show_estimate(stiffness, None, self.factor)
            return shown if stiffness is not None else ShownEstimate("rigid", NO_INTERVAL)
        ends = (_invert(interval[1]), _invert(interval[0]))
        can_be_rigid_or_negative = interval[0] < 0.0 < interval[1]
        if can_be_rigid_or_negative:
            # The stiffness is outside of a range around zero, on either side.
            ends = ends[::-1]
        shown = show_estimate(inf if stiffness is None else stiffness, ends, self.factor)
        if stiffness is None:
            shown = replace(shown, value="rigid")
        if can_be_rigid_or_negative:
            return replace(shown, interval=f"not {shown.interval}", relative=None)
        return shown

    def _format_limit(self, at_least: float) -> str:
        """Format the lower limit of a stiffness in SI units."""
        return f"> {figure(self.factor * round_down(at_least), '.3g')}"


_PER_MICRON: Final = StiffnessUnit(1e-6, JOINT_UNITS["prismatic"].million_stiffness)
UNITS: Final[Mapping[str, StiffnessUnit]] = MappingProxyType(
    {
        "MNm/rad": StiffnessUnit(1e-6, JOINT_UNITS["revolute"].million_stiffness, sliding=_PER_MICRON),
        "Nm/arcmin": StiffnessUnit(_ARC_MINUTE, "N·m/arcmin", sliding=_PER_MICRON),
    }
)
"""Name of a unit on the terminal and on the page → unit."""
DEFAULT_UNIT: Final = "MNm/rad"
