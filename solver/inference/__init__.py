"""Inference from a fit: intervals, verdicts and predictions."""

from __future__ import annotations

from jointstiff.solver.inference.assessment import Assessment, assess
from jointstiff.solver.inference.budget import BudgetComponent, LeftOut, Spread, UncertaintyBudget
from jointstiff.solver.inference.encoder_prediction import inspect_encoders, predict_encoders
from jointstiff.solver.inference.estimate import Estimate, assemble
from jointstiff.solver.inference.joint import JointCompliance, stiffness_interval, stiffness_of
from jointstiff.solver.inference.plausibility import judge
from jointstiff.solver.inference.prediction import Contributions, Prediction, predict
from jointstiff.solver.inference.profile import profile_ends, profile_row_ends, range_on_box
from jointstiff.solver.inference.reason import Action, Place, Reason, Usability
from jointstiff.solver.inference.stages import StagesCertificate

__all__ = [
    "Action",
    "Assessment",
    "BudgetComponent",
    "Contributions",
    "Estimate",
    "JointCompliance",
    "LeftOut",
    "Place",
    "Prediction",
    "Reason",
    "Spread",
    "StagesCertificate",
    "UncertaintyBudget",
    "Usability",
    "assemble",
    "assess",
    "inspect_encoders",
    "judge",
    "predict",
    "predict_encoders",
    "profile_ends",
    "profile_row_ends",
    "range_on_box",
    "stiffness_interval",
    "stiffness_of",
]
