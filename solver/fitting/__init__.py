"""Fits of the joint compliances by the three methods."""

from __future__ import annotations

from jointstiff.solver.fitting.common import CommonErrors, CommonSource, common_errors
from jointstiff.solver.fitting.decoupled import DecoupledPartialPose
from jointstiff.solver.fitting.fit import Fit
from jointstiff.solver.fitting.iteration import (
    Iteration,
    fit_once,
    iterate_to_convergence,
    neglected_shift,
    require_observable,
)
from jointstiff.solver.fitting.likelihood import Likelihood
from jointstiff.solver.fitting.methods import (
    CompletePose,
    LengthOfLeastCondition,
    MethodAccumulator,
    PartialPose,
)
from jointstiff.solver.fitting.prior import Prior
from jointstiff.solver.fitting.robust import DEFAULT_THRESHOLD, RobustFit
from jointstiff.solver.fitting.scale import Scale, SigmaTest, scale_of, sigma_test
from jointstiff.solver.fitting.settings import Method, Settings, Weighting
from jointstiff.solver.fitting.with_prior import prior_to_data

__all__ = [
    "DEFAULT_THRESHOLD",
    "CommonErrors",
    "CommonSource",
    "CompletePose",
    "DecoupledPartialPose",
    "Fit",
    "Iteration",
    "LengthOfLeastCondition",
    "Likelihood",
    "Method",
    "MethodAccumulator",
    "PartialPose",
    "Prior",
    "RobustFit",
    "Scale",
    "Settings",
    "SigmaTest",
    "Weighting",
    "common_errors",
    "fit_once",
    "iterate_to_convergence",
    "neglected_shift",
    "prior_to_data",
    "require_observable",
    "scale_of",
    "sigma_test",
]
