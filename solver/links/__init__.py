"""Elastic links as positive semidefinite compliance matrices."""

from __future__ import annotations

from jointstiff.solver.links.cross_validation import WEIGHTS, FoldFit, Folds, Plan, fit_fold
from jointstiff.solver.links.estimate import Companion, ElasticEstimate, LinkCompliance
from jointstiff.solver.links.estimation import (
    effective_compliances,
    effective_intervals,
    estimate_elastic,
    first_certified,
    refuse_unsupported_elastic,
)
from jointstiff.solver.links.joints import with_links
from jointstiff.solver.links.losses import MOST_TARGETS, compared_losses
from jointstiff.solver.links.model import LOSSES, MODELS, ElasticModel, Loss, ModelName
from jointstiff.solver.links.penalty import judge_losses, judge_penalty
from jointstiff.solver.links.places import ElasticPlaces, elastic_residuals
from jointstiff.solver.links.regressor import ElasticColumns, elastic_rows_of
from jointstiff.solver.links.selection import HeldOut, Selection, select_model

__all__ = [
    "LOSSES",
    "MODELS",
    "MOST_TARGETS",
    "WEIGHTS",
    "Companion",
    "ElasticColumns",
    "ElasticEstimate",
    "ElasticModel",
    "ElasticPlaces",
    "FoldFit",
    "Folds",
    "HeldOut",
    "LinkCompliance",
    "Loss",
    "ModelName",
    "Plan",
    "Selection",
    "compared_losses",
    "effective_compliances",
    "effective_intervals",
    "elastic_residuals",
    "elastic_rows_of",
    "estimate_elastic",
    "first_certified",
    "fit_fold",
    "judge_losses",
    "judge_penalty",
    "refuse_unsupported_elastic",
    "select_model",
    "with_links",
]
