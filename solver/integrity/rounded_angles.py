"""Angles of the robot's description that were rounded, such as 1.57 for π/2."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.integrity.values import View
from jointstiff.solver.text import figure

_LARGEST_ROUNDING: Final = 1e-3
"""Distance from a multiple of π/2 [rad] up to which an angle seems to be this multiple, rounded."""
_LEAST_ROUNDING: Final = 1e-5
"""Distance from a multiple of π/2 [rad] that is not reported: 10 µm in a metre."""
_DECIMALS: Final = 5
_ARITHMETIC: Final = 1e-9  # error of an angle [rad] by conversion to a rotation and back


def inspect_rounded_angles(view: View) -> Iterator[Finding]:
    """Remark angles of the model that are a multiple of π/2 rounded to a few decimals."""
    for joint in view.robot.chain.joints:
        for name, angle in zip(("roll", "pitch", "yaw"), joint.roll_pitch_yaw, strict=True):
            quarters = round(angle / (0.5 * np.pi))
            exact = quarters * 0.5 * np.pi
            error = angle - exact
            has_few_decimals = abs(angle - round(angle, _DECIMALS)) < _ARITHMETIC
            if quarters and has_few_decimals and _LEAST_ROUNDING < abs(error) < _LARGEST_ROUNDING:
                value, off = figure(angle, ".6g"), figure(1e3 * error, ".2g")
                yield view.build_finding(
                    "angle_rounded",
                    f"the {name} of {joint.name} is {value} rad, {off} mrad off {90 * quarters}°",
                    f"if {90 * quarters}° is meant, write {figure(exact, '.9g')} in the robot's description",
                    "use",
                )
