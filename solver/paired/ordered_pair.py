"""Two campaigns in one convex problem: no joint is softer in the second than in the first (method.md §5).

The unknowns are ``v = (c_second, c_first − c_second)``: then the order ``c_second ≤ c_first`` is a bound on
the second half, which the solver keeps exactly, and both campaigns' rows, each whitened by its own sigma, are
linear in v: ``‖R₁ L₁ v − z₁‖² + ‖R₂ L₂ v − z₂‖²`` with ``c_first = L₁ v`` and ``c_second = L₂ v``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from scipy.linalg import block_diag

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.convex.problem import Bounds, Constraints, IdentificationProblem, Inequalities
from jointstiff.solver.convex.solution import Certificate, StagesCertificate, solve, solve_step
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fitting.fit import Likelihood
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.inference.profile import profile_ends
from jointstiff.solver.inference.verdict import stiffness_of
from jointstiff.solver.observability import Spectrum


@dataclass(frozen=True, eq=False)
class WhitenedCampaign:
    """One of the campaigns, ready to be fitted."""

    estimate: Estimate  #: with its rows, stage by stage
    sigma: float  #: standard uncertainty of one coordinate of one reading [m]
    settings: Settings  #: method, bounds and orders of its joints

    @property
    def seen(self) -> BoolArray:
        """(n,) joints that its readings see."""
        return ~self.estimate.observability.null


@dataclass(frozen=True, eq=False)
class OrderedFit:
    """The optimum of both campaigns together."""

    #: (n,) compliances of the first campaign [rad/(N·m)]; NaN for joints that it does not see
    first: FloatArray
    second: FloatArray  #: (n,) of the second campaign, nowhere greater
    equal: BoolArray  #: (n,) joints that the order holds together
    #: of both campaigns' residuals over their least without the order; large where the readings contradict
    #: it
    chi_square_increase: float
    certificates: tuple[Certificate, ...]  #: certificates of each stage of the method

    @property
    def certificate(self) -> StagesCertificate:
        """The greatest violations over the stages."""
        return StagesCertificate.of(self.certificates)


@dataclass(frozen=True)
class OrderedJoint:
    """One joint in the problem of both campaigns; None where a campaign does not determine it."""

    name: str
    compliance_first: float | None  #: of the first campaign [rad/(N·m)]
    compliance_second: float | None  #: of the second campaign, never above [rad/(N·m)]
    #: profile-likelihood interval under all constraints [rad/(N·m)]
    compliance_interval_first: tuple[float, float] | None
    compliance_interval_second: tuple[float, float] | None  #: likewise
    equal: bool  #: whether the order holds both together

    @property
    def stiffness_first(self) -> float | None:
        """Stiffness of the first campaign [N·m/rad]; None for a rigid joint."""
        return stiffness_of(self.compliance_first)

    @property
    def stiffness_second(self) -> float | None:
        """Stiffness of the second campaign [N·m/rad]; None for a rigid joint."""
        return stiffness_of(self.compliance_second)


def ordered_joints(fit: OrderedFit, intervals: FloatArray, names: Sequence[str]) -> tuple[OrderedJoint, ...]:
    """Return the numbers by joint; one without an interval has no compliance either.

    Args:
        fit: the optimum of both campaigns.
        intervals: (2, n, 2) of the compliances [rad/(N·m)], NaN where a campaign says nothing.
        names: of the n joints.
    """
    sides = [
        [_known(*joint) for joint in zip(c, ends, strict=True)]
        for c, ends in zip((fit.first, fit.second), intervals, strict=True)
    ]
    return tuple(
        OrderedJoint(name, c_first, c_second, ends_first, ends_second, bool(equal))
        for name, (c_first, ends_first), (c_second, ends_second), equal in zip(
            names, *sides, fit.equal, strict=True
        )
    )


def _known(compliance: float, ends: FloatArray) -> tuple[float | None, tuple[float, float] | None]:
    """Return the compliance and its interval, None where a campaign does not determine them."""
    low, high = ends.tolist()
    if not (isfinite(low) and isfinite(high)):
        return None, None
    return (float(compliance) if isfinite(compliance) else None), (low, high)


@dataclass(frozen=True, eq=False)
class _Rows:
    """A stage of a campaign: ‖R c − z‖² over the n joints, those it does not estimate having zero columns."""

    R: FloatArray
    z: FloatArray
    visible: BoolArray
    bounds: Bounds
    order: tuple[tuple[int, int], ...]


def fit_ordered(first: WhitenedCampaign, second: WhitenedCampaign) -> OrderedFit:
    """Identify both campaigns subject to ``c_second ≤ c_first`` for every joint.

    Args:
        first: the softer campaign, such as with the motors' encoders in the loop.
        second: the stiffer one, of the same joints, by the same method.

    Raises:
        UnsupportedMethodError: the campaigns are identified by different methods.
        SolverError: optimality could not be certified.
    """
    if first.settings.method != second.settings.method:
        raise UnsupportedMethodError(
            f"both sets must use one method, not {first.settings.method} and {second.settings.method}",
            where="ordered",
            remedy="identify both by the same method, or set `ordered` to false",
        )
    n = first.estimate.parameters
    c = np.zeros((2, n))
    increase, certificates = 0.0, []
    for stage in range(len(first.estimate.triangles.stages)):
        sides = [_rows(side, stage, c[k]) for k, side in enumerate((first, second))]
        if not any(side.visible.any() for side in sides):
            continue
        solved, certificate = _solve_together(*sides)
        increase += sum(_squares(side, x) for side, x in zip(sides, solved, strict=True))
        increase -= sum(_least_squares(side) for side in sides)
        c += solved
        certificates.append(certificate)
    seen = np.stack([first.seen, second.seen])
    equal = seen.all(axis=0) & (c[0] == c[1])
    one, two = np.where(seen, c, np.nan)
    return OrderedFit(one, two, equal, max(0.0, increase), tuple(certificates))


def _rows(side: WhitenedCampaign, number: int, known: FloatArray) -> _Rows:
    """Return a stage in units of sigma, less the deflection of joints (n,) that an earlier one estimated."""
    triangles = side.estimate.triangles
    stage, triangle = triangles.method.stages[number], triangles.stages[number]
    visible = np.isin(np.arange(len(known)), stage.joints) & side.seen
    before = stage.known[side.seen[stage.known]]
    R = np.zeros(triangle.matrix.shape)
    R[:, visible] = Spectrum(triangle.matrix[:, visible] / side.sigma).determined
    z = (triangle.rhs - triangle.matrix[:, before] @ known[before]) / side.sigma
    order = tuple((i, j) for i, j in side.settings.order if visible[i] and visible[j])
    return _Rows(R, z, visible, side.settings.bounds, order)


def _solve_together(one: _Rows, two: _Rows) -> tuple[FloatArray, Certificate]:
    """(2, n) compliances of both campaigns, zero where a campaign does not see the joint."""
    n = len(one.visible)
    eye = np.eye(n)
    both = np.diag((one.visible & two.visible).astype(float))
    kept = np.flatnonzero(np.concatenate([two.visible, one.visible]))
    L1 = np.hstack([both, eye])[:, kept]
    L2 = np.hstack([eye, np.zeros((n, n))])[:, kept]
    # Bounds of v: the second's, then zero for the differences, or the first's
    lower = np.concatenate([two.bounds.lower, np.where(two.visible, 0.0, one.bounds.lower)])
    upper = np.concatenate([two.bounds.upper, np.where(two.visible, np.inf, one.bounds.upper)])
    # The first's bounds that those of v do not imply
    limits = []
    for j in np.flatnonzero(one.visible & two.visible):
        if one.bounds.lower[j] > two.bounds.lower[j]:
            limits.append((L1[j], float(one.bounds.lower[j])))
        if np.isfinite(one.bounds.upper[j]):
            limits.append((-L1[j], -float(one.bounds.upper[j])))
    problem = IdentificationProblem(
        np.vstack([one.R @ L1, two.R @ L2]),
        np.concatenate([one.z, two.z]),
        Bounds(lower[kept], upper[kept]),
        _inequalities([*limits, *_orders(one, L1), *_orders(two, L2)]),
    )
    solution = solve(problem)
    return np.stack([L1 @ solution.compliance, L2 @ solution.compliance]), solution.certificate


def _orders(side: _Rows, L: FloatArray) -> list[tuple[FloatArray, float]]:
    """c_i ≤ c_j within a campaign."""
    return [(L[j] - L[i], 0.0) for i, j in side.order]


def _inequalities(rows: list[tuple[FloatArray, float]]) -> Inequalities | None:
    if not rows:
        return None
    return Inequalities(np.stack([row for row, _ in rows]), np.array([least for _, least in rows]))


def _squares(side: _Rows, c: FloatArray) -> float:
    return float(((side.R @ c - side.z) ** 2).sum())


def _least_squares(side: _Rows) -> float:
    """The least sum of squares of one campaign, without the other."""
    joints = np.flatnonzero(side.visible)
    if not len(joints):
        return float((side.z**2).sum())
    L = np.eye(len(side.visible))[:, joints]
    inequalities = _inequalities(_orders(side, L))
    problem = IdentificationProblem(side.R[:, joints], side.z, side.bounds.select(joints), inequalities)
    return _squares(side, L @ solve_step(problem).compliance)


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
    """Return the constraints on the 2 n compliances of both campaigns.

    Raises:
        RequestError: they contradict each other.
    """
    lower = np.concatenate([side.bounds.lower for side in settings])
    upper = np.concatenate([side.bounds.upper for side in settings])
    # Pairs (i, j) with c_i ≤ c_j among the 2 n: the second's each below the first's, and their own
    n = len(settings[0].bounds.lower)
    between = [(n + j, j) for j in range(n)]
    own = [(i + k * n, j + k * n) for k, side in enumerate(settings) for i, j in side.order]
    return Constraints(Bounds(lower, upper), (*between, *own))
