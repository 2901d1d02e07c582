"""Priors of a live campaign: what other arms of the same kinematics say, and whether this one agrees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, Literal

import numpy as np

from jointstiff.schemas.options import StiffnessPrior
from jointstiff.schemas.run import JointResult
from jointstiff.solver.errors import RequestError
from jointstiff.solver.estimation.fit import student_quantile
from jointstiff.solver.live.ahead import Known

FEWEST_ARMS: Final = 3
"""Other arms of which a prior is made."""
_NORMAL: Final = student_quantile(0.975, None)
"""Half-width of an interval of 95 % over the standard uncertainty."""
Standing = Literal["waits", "counts", "deviates"]


def priors_of(arms: Sequence[Mapping[str, JointResult]]) -> dict[str, StiffnessPrior]:
    """Return what an arm's stiffness is expected to be by other arms: one more of their population.

    Mean and scatter of their compliances; the scatter of few arms is not well known, so Student's factor at
    its degrees of freedom takes the place of the normal one. A joint that scatters by half has none.

    Args:
        arms: results of each joint by its name, of each arm.

    Raises:
        RequestError: fewer than `FEWEST_ARMS` arms have a number of any joint.
    """
    priors: dict[str, StiffnessPrior] = {}
    for name in dict.fromkeys(name for arm in arms for name in arm):
        numbers = [arm[name].compliance for arm in arms if name in arm]
        known = np.array([number for number in numbers if number is not None and number > 0.0])
        count = len(known)
        if count < FEWEST_ARMS:
            continue
        mean = float(known.mean())
        scatter = float(known.std(ddof=1)) * np.sqrt(1.0 + 1.0 / count)
        relative = scatter * student_quantile(0.975, count - 1) / _NORMAL / mean
        if 0.0 < relative <= 0.5:
            priors[name] = StiffnessPrior(stiffness=1.0 / mean, standard_uncertainty=float(relative) / mean)
    if not priors:
        raise RequestError(
            f"fewer than {FEWEST_ARMS} other arms of these kinematics have a run, or they differ much",
            where="open.prior",
            remedy="omit `prior`, or identify other robots of the same description first",
        )
    return priors


def standings(
    names: Sequence[str], known: Known, priors: Mapping[str, StiffnessPrior]
) -> dict[str, Standing]:
    """Return what becomes of each joint's prior, by the arm's own readings.

    A prior counts once the own readings know the joint as well as it does, and agree with it (95 %). So an
    arm that deviates by more than that is found before it is pulled to the mean of the others.

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
