"""Messages about runs."""

from __future__ import annotations

from jointstiff.schemas.run.budget import Budget, BudgetComponent
from jointstiff.schemas.run.identifiability import Advice, Identifiability
from jointstiff.schemas.run.joints import JointResult, OneSidedBounds, UncertaintyBudget, identified_in
from jointstiff.schemas.run.links import Elasticity, LinkCompliance, LinksResult, ModelSelection
from jointstiff.schemas.run.options import Method, RunOptions, StiffnessPrior, Weighting
from jointstiff.schemas.run.resampling import (
    MAX_REPETITIONS,
    ResampledCompensation,
    ResampledJoint,
    Resampling,
    ResamplingResult,
)
from jointstiff.schemas.run.run import Certificate, EncoderResidual, Run, RunRequest, RunResult, RunSummary

__all__ = [
    "MAX_REPETITIONS",
    "Advice",
    "Budget",
    "BudgetComponent",
    "Certificate",
    "Elasticity",
    "EncoderResidual",
    "Identifiability",
    "JointResult",
    "LinkCompliance",
    "LinksResult",
    "Method",
    "ModelSelection",
    "OneSidedBounds",
    "ResampledCompensation",
    "ResampledJoint",
    "Resampling",
    "ResamplingResult",
    "Run",
    "RunOptions",
    "RunRequest",
    "RunResult",
    "RunSummary",
    "StiffnessPrior",
    "UncertaintyBudget",
    "Weighting",
    "identified_in",
]
