"""Profile-likelihood intervals of two campaigns' compliances under the order between them (method.md §6)."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex.constraints import Constraints
from jointstiff.solver.convex.problem import Bounds
from jointstiff.solver.fitting.fit import Likelihood
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.inference.profile import profile_ends
from jointstiff.solver.paired.ordered_pair import OrderedFit

Order = tuple[tuple[int, int], ...]


def ordered_intervals(
    estimates: tuple[Estimate, Estimate],
    settings: tuple[Settings, Settings],
    together: OrderedFit,
    quantile: float,
) -> FloatArray:
    """Intervals under both campaigns' constraints and ``c_second ≤ c_first``.

    Both estimates are Gaussian and independent, so their likelihood is that of 2 n compliances with a
    covariance of two blocks. Joints of which a campaign says nothing are left out: they neither get an
    interval nor bound another. The intervals are widened to contain the estimate: that of a method that is
    not maximum likelihood, such as the decoupled one, may lie outside its own interval under constraints.

    Args:
        estimates: of the first and the second, without constraints; their uncertainties are known.
        settings: their bounds and orders.
        together: the estimate of both.
        quantile: t, so that an interval without active constraints is ĉ ± t u(ĉ).

    Returns:
        (2, n, 2) lower and upper ends of the first's and the second's compliances [rad/(N·m)]; NaN for
        joints of which the campaign says nothing.

    Raises:
        RequestError: the constraints contradict each other.
        SolverError: an end could not be certified.
    """
    known = [
        np.flatnonzero([joint.compliance is not None for joint in estimate.joints]) for estimate in estimates
    ]
    n = len(estimates[0].joints)
    ends = np.full((2 * n, 2), np.nan)
    places = np.concatenate([known[0], n + known[1]])
    if not len(places):
        return ends.reshape(2, n, 2)
    covariances = [
        np.zeros((n, n)) if estimate.covariance is None else estimate.covariance for estimate in estimates
    ]
    likelihood = Likelihood(
        joints=places,
        centre=np.concatenate([estimate.compliance for estimate in estimates])[places],
        covariance=block_diag(*covariances)[np.ix_(places, places)],
    )
    constraints = ordered_constraints(settings).select(places)
    ends[places] = profile_ends(likelihood, constraints, np.arange(len(places)), np.array([quantile]))[0]
    estimate = np.concatenate([together.first, together.second])[places]
    ends[places, 0] = np.minimum(ends[places, 0], estimate)
    ends[places, 1] = np.maximum(ends[places, 1], estimate)
    return ends.reshape(2, n, 2)


def ordered_constraints(settings: tuple[Settings, Settings]) -> Constraints:
    """On the 2 n compliances of the first campaign and the second.

    Raises:
        RequestError: they contradict each other.
    """
    lower = np.concatenate([side.bounds.lower for side in settings])
    upper = np.concatenate([side.bounds.upper for side in settings])
    return Constraints(Bounds(lower, upper), _orders(settings, len(settings[0].bounds.lower)))


def _orders(settings: tuple[Settings, Settings], n: int) -> Order:
    """Pairs (i, j) with c_i ≤ c_j among the 2 n: the second's each below the first's, and their own."""
    between = [(n + j, j) for j in range(n)]
    own = [(i + k * n, j + k * n) for k, side in enumerate(settings) for i, j in side.order]
    return (*between, *own)
