"""Single readings that the integrity checks refute, and that no fit may use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding, FindingCode
from jointstiff.solver.mechanics.measurements import Measurements

_MOST_REFUTED: Final = 0.1
"""Largest share of the observations that are single mistakes: of more the whole set is doubtful."""
_LASTING: Final[frozenset[FindingCode]] = frozenset({"target_moved"})
"""Mistakes that begin with the observation of the finding, and concern all later observations, too."""


def list_refuted(measurements: Measurements, findings: Sequence[Finding]) -> tuple[str, ...]:
    """Return the labels of observations that findings forbid to use, if these are few of the set.

    Args:
        measurements: N observations.
        findings: findings of the integrity checks of these measurements.
    """
    named = {
        finding.observation
        for finding in findings
        if finding.weight == "do_not_use" and finding.code not in _LASTING
    }
    refuted = tuple(label for label in measurements.labels if label in named)
    return refuted if len(refuted) <= _MOST_REFUTED * len(measurements) else ()


def leave_out(measurements: Measurements, labels: Sequence[str]) -> Measurements:
    """Return the measurements without the observations of these labels; the same object without any."""
    kept = [i for i, label in enumerate(measurements.labels) if label not in labels]
    return measurements if len(kept) == len(measurements) else measurements[np.array(kept)]
