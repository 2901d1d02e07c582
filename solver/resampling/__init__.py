"""Resampling: fits of many random subsets of a measurement set."""

from __future__ import annotations

from jointstiff.solver.resampling.blocks import (
    GramBlocks,
    StageBlocks,
    blocks_of_identified,
    gram_blocks,
    refuse_nonlinear,
)
from jointstiff.solver.resampling.draws import Resamples, ResamplingPlan, fit_subsets, resample
from jointstiff.solver.resampling.summary import ResamplingSummary, summarise

__all__ = [
    "GramBlocks",
    "Resamples",
    "ResamplingPlan",
    "ResamplingSummary",
    "StageBlocks",
    "blocks_of_identified",
    "fit_subsets",
    "gram_blocks",
    "refuse_nonlinear",
    "resample",
    "summarise",
]
