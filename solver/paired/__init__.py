"""Comparison of two campaigns on one robot."""

from __future__ import annotations

from jointstiff.solver.paired.comparison import JointRatio, Pair, compare_pair
from jointstiff.solver.paired.sides import PairSide, models_differ, refuse_other_joints

__all__ = [
    "JointRatio",
    "Pair",
    "PairSide",
    "compare_pair",
    "models_differ",
    "refuse_other_joints",
]
