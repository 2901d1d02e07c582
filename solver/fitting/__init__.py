"""Fits of the joint compliances by the three methods."""

from __future__ import annotations

from jointstiff.solver.fitting.decoupled import DecoupledPartialPose
from jointstiff.solver.fitting.fit import Fit
from jointstiff.solver.fitting.informed import prior_to_data
from jointstiff.solver.fitting.likelihood import Likelihood
from jointstiff.solver.fitting.methods import (
    CompletePose,
    LengthOfLeastCondition,
    MethodAccumulator,
    PartialPose,
)
from jointstiff.solver.fitting.passes import Pass, fit_pass, neglected_shift, until_still, visible
from jointstiff.solver.fitting.prior import Prior
from jointstiff.solver.fitting.robust import DEFAULT_THRESHOLD, RobustFit
from jointstiff.solver.fitting.scale import Scale, SigmaTest, scale_of, sigma_test
from jointstiff.solver.fitting.settings import Method, Settings, Weighting

__all__ = [
    "DEFAULT_THRESHOLD",
    "CompletePose",
    "DecoupledPartialPose",
    "Fit",
    "LengthOfLeastCondition",
    "Likelihood",
    "Method",
    "MethodAccumulator",
    "PartialPose",
    "Pass",
    "Prior",
    "RobustFit",
    "Scale",
    "Settings",
    "SigmaTest",
    "Weighting",
    "fit_pass",
    "neglected_shift",
    "prior_to_data",
    "scale_of",
    "sigma_test",
    "until_still",
    "visible",
]
