"""Inference from a fit: intervals, verdicts, predictions and advice."""

from __future__ import annotations

from jointstiff.solver.inference.advice import Advice, advise
from jointstiff.solver.inference.assessment import Assessment, assess
from jointstiff.solver.inference.encoder_prediction import inspect_encoders, predict_encoders
from jointstiff.solver.inference.estimate import Estimate, JointCompliance, assemble
from jointstiff.solver.inference.plausibility import judge
from jointstiff.solver.inference.prediction import Prediction, predict
from jointstiff.solver.inference.profile import profile_ends
from jointstiff.solver.inference.reason import Action, Place, Reason

__all__ = [
    "Action",
    "Advice",
    "Assessment",
    "Estimate",
    "JointCompliance",
    "Place",
    "Prediction",
    "Reason",
    "advise",
    "assemble",
    "assess",
    "inspect_encoders",
    "judge",
    "predict",
    "predict_encoders",
    "profile_ends",
]
