"""A suspicion about geometry readings: said with its figure, never mended silently."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["GeometryFinding", "GeometryFindingCode"]

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


@dataclass(frozen=True)
class GeometryFinding:
    """One suspicion.

    Attributes:
        code: its kind.
        where: path into the input, such as `sweeps[2].observations[7].targets.P10`.
        figure: the number that raised it.
        unit: of the figure; empty where it is a ratio.
        message: what was seen, with figure and unit.
        remedy: what to check.
    """

    code: GeometryFindingCode
    where: str
    figure: float
    unit: str
    message: str
    remedy: str
