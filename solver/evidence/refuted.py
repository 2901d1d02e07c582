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
    """Return the labels of observations that findings forbid to use; none if these are too many.

    Args:
        measurements: N observations.
        findings: findings of the integrity checks of these measurements.
    """
    forbidden_labels = set()
    for finding in findings:
        concerns_one_observation = finding.code not in _LASTING
        if finding.weight == "do_not_use" and concerns_one_observation:
            forbidden_labels.add(finding.observation)
    refuted = tuple(label for label in measurements.labels if label in forbidden_labels)
    are_few = len(refuted) <= _MOST_REFUTED * len(measurements)
    return refuted if are_few else ()


def leave_out(measurements: Measurements, labels: Sequence[str]) -> Measurements:
    """Return the measurements without the observations of these labels.

    The measurements themselves are returned if they contain none of the labels.
    """
    kept = [i for i, label in enumerate(measurements.labels) if label not in labels]
    if len(kept) == len(measurements):
        return measurements
    return measurements[np.array(kept)]
