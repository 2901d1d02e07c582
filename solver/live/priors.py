"""Priors of a live campaign, and whether the readings agree with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, Literal

import numpy as np

from jointstiff.schemas.options import StiffnessPrior
from jointstiff.solver.fit.stages import student_quantile
from jointstiff.solver.live.ahead import KnownCompliances

_NORMAL: Final = student_quantile(0.975, None)
"""Half-width of an interval of 95 % divided by the standard uncertainty."""
Standing = Literal["waits", "counts", "deviates"]


def compare_priors(
    names: Sequence[str], known: KnownCompliances, priors: Mapping[str, StiffnessPrior]
) -> dict[str, Standing]:
    """Compare prior stiffnesses with the readings, and return the state of each prior.

    A prior "counts" (is used) once the readings alone determine the joint at least as well as the prior does,
    and agree with the prior (95 %). Before that the prior "waits" for more readings. A prior "deviates" if
    the readings contradict it. A wrong prior is thus noticed before it influences the result.

    Args:
        names: names of the n joints.
        known: compliances of the n joints from the readings alone.
        priors: prior stiffnesses by name of the joint.

    Returns:
        "counts", "waits" or "deviates" for each joint with a prior, by the name of the joint.
    """
    states: dict[str, Standing] = {}
    for j, name in enumerate(names):
        if name not in priors:
            continue
        prior, c = priors[name], float(known.compliance[j])
        expected, u = 1.0 / prior.stiffness, float(np.sqrt(known.covariance[j, j]))
        # Standard uncertainty of the compliance 1/K, from that of the stiffness K.
        u_prior = prior.standard_uncertainty / prior.stiffness**2
        if not np.isfinite(c):
            states[name] = "waits"
        elif abs(c - expected) > _NORMAL * np.hypot(u, u_prior):
            states[name] = "deviates"
        else:
            states[name] = "counts" if u <= u_prior else "waits"
    return states
