"""Priors of a live campaign, and whether the readings agree with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, Literal

import numpy as np

from jointstiff.schemas.options import StiffnessPrior
from jointstiff.solver.estimation.fit import student_quantile
from jointstiff.solver.live.ahead import Known

_NORMAL: Final = student_quantile(0.975, None)
"""Half-width of an interval of 95 % over the standard uncertainty."""
Standing = Literal["waits", "counts", "deviates"]


def standings(
    names: Sequence[str], known: Known, priors: Mapping[str, StiffnessPrior]
) -> dict[str, Standing]:
    """Return what becomes of each joint's prior, by the arm's own readings.

    A prior counts once the own readings know the joint as well as it does, and agree with it (95 %). So an
    arm that deviates by more than that is found before it is pulled to the prior.

    Args:
        names: of the n joints.
        known: n compliances by the own readings alone.
        priors: by joint.
    """
    found: dict[str, Standing] = {}
    for j, name in enumerate(names):
        if name not in priors:
            continue
        prior, c = priors[name], float(known.compliance[j])
        expected, u = 1.0 / prior.stiffness, float(np.sqrt(known.covariance[j, j]))
        of_prior = prior.standard_uncertainty / prior.stiffness**2
        if not np.isfinite(c):
            found[name] = "waits"
        elif abs(c - expected) > _NORMAL * np.hypot(u, of_prior):
            found[name] = "deviates"
        else:
            found[name] = "counts" if u <= of_prior else "waits"
    return found
