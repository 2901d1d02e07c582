"""Observability of joints and of their combinations."""

from __future__ import annotations

from jointstiff.solver.observability.combination import Combination
from jointstiff.solver.observability.identifiability import (
    NULL_COLUMN,
    Excitation,
    Identifiability,
    Observability,
    Spectrum,
    analyse,
    noise_reason,
)
from jointstiff.solver.observability.indices import ObservabilityIndices, observability_indices

__all__ = [
    "NULL_COLUMN",
    "Combination",
    "Excitation",
    "Identifiability",
    "Observability",
    "ObservabilityIndices",
    "Spectrum",
    "analyse",
    "noise_reason",
    "observability_indices",
]
