"""A suspicion about geometry readings: said with its figure, never mended silently."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from jointstiff.solver.finding import Severity

GeometryFindingCode = Literal[
    "short_arc",
    "tracker_bumped",
    "position_suspect",
    "reading_suspect",
    "residuals_exceed_sigma",
    "residuals_below_sigma",
    "angle_scale_suspect",
    "axes_nearly_parallel",
    "base_drifted",
    "base_target_moved",
    "sweeps_disagree",
    "wrist_centres_disagree",
    "parameters_not_identified",
]

_SEVERITIES: Final[dict[GeometryFindingCode, Severity]] = {
    "tracker_bumped": "error",
    "angle_scale_suspect": "error",
    "residuals_below_sigma": "note",
    "axes_nearly_parallel": "note",
}
"""Severities of findings that are not warnings."""


@dataclass(frozen=True)
class GeometryFinding:
    """One suspicion."""

    code: GeometryFindingCode  #: kind of finding
    where: str  #: path into the input, such as `sweeps[2].observations[7].targets.P10`
    figure: float  #: the number that raised it
    unit: str  #: unit of the figure; empty where it is a ratio
    message: str  #: observed effect, with figure and unit
    remedy: str  #: checks to make

    @property
    def severity(self) -> Severity:
        """Severity: "error" where it is almost certainly a mistake, "note" where it is good to know."""
        return _SEVERITIES.get(self.code, "warning")
