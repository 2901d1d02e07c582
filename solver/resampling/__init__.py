"""Resampling: fits of many random subsets of a measurement set."""

from __future__ import annotations

from jointstiff.solver.resampling.blocks import GramBlocks, StageBlocks, gram_blocks, refuse_nonlinear
from jointstiff.solver.resampling.draws import Resamples, ResamplingPlan, resample
from jointstiff.solver.resampling.summary import ResamplingSummary, summarise

__all__ = [
    "GramBlocks",
    "Resamples",
    "ResamplingPlan",
    "ResamplingSummary",
    "StageBlocks",
    "gram_blocks",
    "refuse_nonlinear",
    "resample",
    "summarise",
]
