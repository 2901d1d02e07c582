"""Comparison of two campaigns on one robot."""

from __future__ import annotations

from jointstiff.solver.paired.avoided import PredictedDeflection, Share
from jointstiff.solver.paired.comparison import AvoidedDeflection, JointRatio, Pair, compare_pair
from jointstiff.solver.paired.ordered_pair import OrderedFit
from jointstiff.solver.paired.sides import PairSide, models_differ, refuse_other_joints

__all__ = [
    "AvoidedDeflection",
    "JointRatio",
    "OrderedFit",
    "Pair",
    "PairSide",
    "PredictedDeflection",
    "Share",
    "compare_pair",
    "models_differ",
    "refuse_other_joints",
]
