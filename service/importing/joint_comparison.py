"""Comparison of the joints of one observation in two files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import NamedTuple

from jointstiff.schemas.joints import JointKind


class JointDifference(NamedTuple):
    """Difference of one joint between two files; `max` finds the greatest relative to its tolerance."""

    relative: float  # difference divided by the tolerance
    joint: int  # index of the joint
    absolute: float  # difference in the unit of the joint


@dataclass(frozen=True)
class JointComparison:
    """Tolerances within which the joints of one observation may differ between files."""

    tolerances: Sequence[float]  # of each joint, in its unit
    units: Sequence[str]  # of each joint, as written behind numbers: `°`, ` rad`, ` mm` or ` m`

    @classmethod
    def from_units(
        cls, tolerance: float, units: Mapping[str, str], kinds: Sequence[JointKind]
    ) -> JointComparison:
        """Return the comparison of joints with a tolerance in degrees or mm, in the units of the files.

        Args:
            tolerance: tolerance of each joint [deg or mm].
            units: units of the files by `angle` and `length`.
            kinds: kind of each joint, `revolute` or `prismatic`.
        """
        in_radians, in_metres = units.get("angle") == "rad", units.get("length") == "m"
        tolerance_of_kind = {
            "revolute": tolerance / (degrees(1.0) if in_radians else 1.0),
            "prismatic": tolerance / (1e3 if in_metres else 1.0),
        }
        unit_of_kind = {
            "revolute": " rad" if in_radians else "°",
            "prismatic": f" {units.get('length', 'mm')}",
        }
        return cls([tolerance_of_kind[kind] for kind in kinds], [unit_of_kind[kind] for kind in kinds])

    def find_greatest(self, first: Sequence[float], second: Sequence[float]) -> JointDifference:
        """Return the greatest difference between the joints (n,) of two files, relative to its tolerance."""
        absolute = [abs(one - other) for one, other in zip(first, second, strict=True)]
        relative = [each / most for each, most in zip(absolute, self.tolerances, strict=False)]
        return max(JointDifference(relative[k], k, absolute[k]) for k in range(len(relative)))

    def describe(self, joint: int, number: float) -> str:
        """Return a difference of a joint with its unit in words, such as `0.02°`."""
        return f"{number:.4g}{self.units[joint]}"
