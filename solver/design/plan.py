"""Plan of a campaign: from equipment and surroundings to an ordered list of readings with its certificate.

candidates → optimal weights → list of distinct postures → validation → order → beside other plans
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.schemas.goal import DeflectionGoal, JointsGoal
from jointstiff.schemas.plan import MAX_READINGS
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.design.candidates import CriterionName, PlanRequest, Pool
from jointstiff.solver.design.optimum import (
    AOptimality,
    Atoms,
    Criterion,
    Design,
    DesignProblem,
    DOptimality,
    EOptimality,
    GOptimality,
    SmoothCriterion,
    optimise,
    uncertainty_of,
)
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot.model import Robot

_LINKS_GAP, _OTHERS_GAP = 1e-2, 1e-4
"""Gaps at which the search ends where elastic links are a nuisance, and for criteria not asked for."""
_WORST_PLACES: Final = 12
"""Places of the work area for the criterion of the worst place, whose program has a cone for each."""
_RANDOM_PLANS: Final = 20
_PARTITIONS: Final = 8
"""Partitions of the postures into cells that are tried; each gives a bound, and the sharpest counts."""
_LOOKED_AT: Final = 4_000
"""Candidates of the best prices whose cells are compared; the others are bounded by the last of them."""
_INSIDE: Final = 1.0 - 1e-9
"""Share of the angle that a cell is wide, so that rounding puts no two distinct postures into one."""
_MIXTURES: Final = (0.5, 0.75, 0.9, 1.0)
"""Shares of a list's information in the matrices at which its bound is sought."""
_POOL: Final = 4_000
"""Candidates of the best prices among which readings are exchanged."""
_TRIED: Final = 8
"""Best-priced candidates whose exchange is evaluated exactly."""
_EXCHANGES: Final = 600
"""Exchanges tried in one search: 30 passes over a list of 20. A long list is near its optimum at once."""
_RESTARTED: Final = 160
"""Readings of all restarts, at each of which a third of the list is drawn anew: short lists need most."""
_MOST_RESTARTS: Final = 16
_LONG: Final = 60
"""Readings of a list for which that gains nothing."""
_MANY: Final = 30
"""Parameters above which restarts cost more than a plan gains: elastic links as a nuisance."""
_BLOCK: Final = 4
"""Fitted readings of a block, which are a good plan by themselves."""
_SWAPS: Final = 600
"""Exchanges between blocks that are tried."""
_SHARE_BEFORE: Final = 1e-6
"""Information beside that of the whole list that a block is compared with."""
_COVERAGE: Final = 1.959963984540054
"""Half-width of an interval of 95 % over the standard uncertainty, which the stated noise gives."""
_IMPROVES: Final = 1.0 + 1e-10


@dataclass(frozen=True, eq=False)
class OtherPlan:
    """A plan of as many readings made in another way."""

    efficiency: float  #: φ relative to the plan's
    uncertainty: FloatArray  #: (s,) standard uncertainty of each joint's relative compliance


@dataclass(frozen=True, eq=False)
class CampaignPlan:
    """An ordered list of readings."""

    joints: FloatArray  #: (n, q) controller's angles [rad], in the order in which to take them
    force: FloatArray  #: (n, 3) on the robot, axes of R0 [N]
    anchor: IndexArray  #: (n,) anchor of the cable; -1 without one
    along: FloatArray | None  #: (n, 3) unit vectors in R0 along which to read; None if all coordinates are
    validation: BoolArray  #: (n,) which readings are held out from the fit
    block: IndexArray  #: (n,) blocks in order, each a good plan by itself; all 0 if there is one
    efficiency: float  #: least share of the greatest φ of all lists that obey the same rules
    weights_gap: float  #: 1 − efficiency of the optimal weights that lead to the list
    efficiencies: Mapping[CriterionName, float]  #: the same by each criterion that applies
    pool: Pool  #: the candidates, the parameters to determine, and what cannot be read
    uncertainty: FloatArray  #: (s,) standard uncertainty of each joint's relative compliance after the list
    before: FloatArray  #: (s,) the same before it; inf where it is not determined
    #: standard uncertainty of the predicted deflection in the work area under the load [m]: root mean
    #: square and greatest; None without a work area
    deflection: tuple[float, float] | None
    random: OtherPlan  #: mean of random plans
    one_at_a_time: OtherPlan  #: each reading the best next one
    goal_share: float | None = None  #: expanded uncertainty over that of the goal; None without one


def plan_campaign(robot: Robot, request: PlanRequest) -> CampaignPlan:
    """Plan a campaign.

    Raises:
        RequestError: no reading is feasible, nothing excites a joint, there are too few readings or distinct
            postures.
    """
    pool = Pool.of(robot, request)
    s = len(pool.parameters.joints)
    distinct = Distinct(pool.readings.joints, request.angle)
    criteria, worst = _criteria(pool, request)
    if request.goal is not None:
        request = replace(
            request, readings=least_readings(pool, request, criteria[request.criterion], distinct)
        )
    held_out = round(request.validation * request.readings)
    fitted = request.readings - held_out
    rows = (3 if request.directions is None else 1) * len(request.equipment.targets) * fitted
    if fitted < 1 or (request.so_far is None and rows < s):
        raise RequestError(
            f"{fitted} readings without those held out do not determine {s} joints",
            where="readings",
            remedy="ask for more readings, or a smaller share for validation",
        )
    problem = DesignProblem(pool.candidates, criteria[request.criterion], fitted, pool.base)
    design = optimise(problem, _LINKS_GAP if request.links else None)
    exact = exact_design(problem, design, distinct, seed=request.seed)
    M = exact.matrix
    # Least efficiency of the list by the criterion that was asked for, and by the smooth ones
    efficiencies: dict[CriterionName, float] = {}
    for name, criterion in criteria.items():
        if name == request.criterion:
            efficiencies[name] = exact.efficiency
        elif isinstance(criterion, SmoothCriterion):
            other = DesignProblem(pool.candidates, criterion, fitted, pool.base)
            best = optimise(other, _LINKS_GAP if request.links else _OTHERS_GAP)
            efficiencies[name] = list_efficiency(other, distinct, M, best)
    deflection = None
    if worst is not None:
        mean = criteria["work_area"].information(M)
        deflection = float(mean**-0.5), float(np.sqrt(worst.variances(M).max()))
    validation = _validation(pool, distinct, exact.atoms.index, held_out, request.seed)
    atoms = exact.atoms.joined(validation)
    block = _blocks(exact.atoms.information / problem.squares, pool.base, criteria[request.criterion])
    anchors = pool.readings.anchor[atoms.index]
    if (anchors != anchors[0]).any():  # to change the anchor takes longer than to travel
        block = np.zeros_like(block)
    block = np.concatenate([block, np.arange(held_out) % (1 + block.max())])
    order = ordered(pool.readings.joints[atoms.index], block if block.any() else anchors)
    readings = pool.readings[atoms.index[order]]
    return CampaignPlan(
        joints=readings.joints,
        force=pool.force(atoms.force[order], atoms.index[order]),
        anchor=readings.anchor,
        along=readings.along,
        validation=order >= fitted,
        block=block[order],
        efficiency=exact.efficiency,
        weights_gap=1.0 - design.bound.efficiency,
        efficiencies=efficiencies,
        pool=pool,
        uncertainty=uncertainty_of(M, s),
        before=uncertainty_of(pool.base, s),
        deflection=deflection,
        random=random_plans(problem, M, s, request.seed),
        one_at_a_time=one_at_a_time(problem, distinct, M, s),
        goal_share=None if request.goal is None else goal_share(pool, request.goal, M),
    )


def _criteria(pool: Pool, request: PlanRequest) -> tuple[dict[CriterionName, Criterion], GOptimality | None]:
    """Return the criteria that apply, and that of the worst place; None without a work area.

    Raises:
        RequestError: the one that was asked for needs a work area.
    """
    s, p = len(pool.parameters.joints), len(pool.base)
    criteria: dict[CriterionName, Criterion] = {
        "relative_a": AOptimality(np.diag(np.r_[np.ones(s), np.zeros(p - s)]) / s),
        "d": DOptimality(s),
        "e": EOptimality(np.ones(s)),
    }
    worst: GOptimality | None = None
    if pool.places is not None:
        worst = GOptimality(pool.places[:: -(-len(pool.places) // _WORST_PLACES)])
        criteria |= {"work_area": AOptimality(pool.places.mean(axis=0)), "worst_place": worst}
    if request.criterion not in criteria:
        raise RequestError(
            f"criterion {request.criterion} needs a work area",
            where="work_area",
            remedy="give the corners of the work area, or use criterion relative_a, d or e",
        )
    return criteria, worst


def goal_share(pool: Pool, goal: JointsGoal | DeflectionGoal, M: FloatArray) -> float:
    """Return the expanded uncertainty after a list of information M (p, p) over that of the goal.

    Raises:
        RequestError: the goal is about deflections, and there is no work area.
    """
    if isinstance(goal, JointsGoal):
        return _COVERAGE * float(uncertainty_of(M, len(pool.parameters.joints)).max()) / goal.relative
    if pool.places is None:
        raise RequestError(
            "the goal is about deflections, and the work area is missing",
            where="work_area",
            remedy='give the corners of the work area, or a goal for the joints, such as "15 %"',
        )
    information = AOptimality(pool.places.mean(axis=0)).information(M)
    return _COVERAGE * float(information**-0.5 if information > 0.0 else np.inf) / goal.uncertainty


def least_readings(pool: Pool, request: PlanRequest, criterion: Criterion, distinct: Distinct) -> int:
    """Return the least number of readings, those held out among them, whose list meets the goal.

    Uncertainties fall with the root of the number of readings, nearly: that brackets it, and halving ends it.

    Raises:
        RequestError: as many readings as a plan may have do not meet it.
    """
    goal, s = request.goal, len(pool.parameters.joints)
    a_reading = (3 if request.directions is None else 1) * len(request.equipment.targets)
    least = 1 if request.so_far is not None else -(-s // a_reading)
    most = MAX_READINGS - round(request.validation * MAX_READINGS)

    def share(fitted: int) -> float:
        problem = DesignProblem(pool.candidates, criterion, fitted, pool.base)
        design = optimise(problem, _LINKS_GAP if request.links else None)
        M = exact_design(problem, design, distinct, seed=request.seed).matrix
        return 0.0 if goal is None else goal_share(pool, goal, M)

    low, high = least - 1, least
    while (reached := share(high)) > 1.0:
        if high >= most:
            raise RequestError(
                f"{MAX_READINGS} readings leave {reached:.3g} times the uncertainty of the goal",
                where="goal",
                remedy="choose a wider goal, a greater load, more targets, or less noise",
            )
        low, high = high, min(most, max(high + 1, int(min(high * reached**2, most))))
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if share(middle) <= 1.0 else (middle, high)
    count = high
    while count - round(request.validation * count) < high:
        count += 1
    return count


def _validation(pool: Pool, distinct: Distinct, chosen: IndexArray, count: int, seed: int) -> Atoms:
    """Draw readings at random that are distinct from those chosen, and under loads drawn at random."""
    random = np.random.default_rng([seed, 1])
    free = ~np.any([distinct.near(i) for i in chosen], axis=0)
    validation: list[int] = []
    for i in random.permutation(len(free)):
        if len(validation) < count and free[i]:
            validation.append(int(i))
            free &= ~distinct.near(i)
    if len(validation) < count:
        raise RequestError(
            f"{len(validation)} of {count} readings for validation are in postures distinct from the others",
            where="distinct_angle",
            remedy="ask for fewer readings, a smaller angle, or more candidates",
        )
    return pool.candidates.under(np.array(validation, dtype=np.intp), _drawn_directions(random, count))


def _blocks(information: FloatArray, base: FloatArray, criterion: Criterion) -> IndexArray:
    """Return the block (n,) of each reading: four in each, so that each is a good plan by itself.

    Readings are exchanged between blocks while the sum of the blocks' 1/φ falls, in which the worst counts
    most. The last block has the rest, and the best one comes first.

    Args:
        information: (n, p, p) of the readings.
        base: (p, p) of earlier readings and priors.
        criterion: of the plan.
    """
    count = len(information)
    block = np.minimum(np.arange(count) // _BLOCK, max(count // _BLOCK - 1, 0))
    total = base + information.sum(axis=0)
    vague = _SHARE_BEFORE * np.diag(np.diagonal(total))  # few readings of a gauge determine nothing

    def value(members: BoolArray) -> float:
        return float(
            np.log(max(criterion.information(base + vague + information[members].sum(axis=0)), 1e-300))
        )

    values = [value(block == b) for b in range(1 + int(block.max()))]
    random = np.random.default_rng(0)
    for _ in range(_SWAPS if len(values) > 1 else 0):
        i, j = random.choice(count, 2, replace=False)
        a, b = block[i], block[j]
        if a == b:
            continue
        block[i], block[j] = b, a
        exchanged = value(block == a), value(block == b)
        if sum(exchanged) > values[a] + values[b]:
            values[a], values[b] = exchanged
        else:
            block[i], block[j] = a, b
    best = np.argsort(-np.array(values), kind="stable")
    return np.asarray(np.argsort(best)[block], dtype=np.intp)


def ordered(joints: FloatArray, group: IndexArray) -> IndexArray:
    """Order readings group by group, each by the nearest next posture, improved by reversing parts.

    Args:
        joints: (n, q) [rad].
        group: (n,) of equal loads.

    Returns:
        (n,) order. Travel is the greatest change of a joint from one posture to the next [rad or m].
    """
    order: list[int] = []
    for each in np.unique(group):
        members = np.flatnonzero(group == each)
        start = joints[order[-1]] if order else np.zeros(joints.shape[1])
        places = np.vstack([start, joints[members]])
        distance = np.pad(np.abs(places[:, None] - places).max(axis=2), (0, 1))
        left, path = set(range(1, len(places))), [0]
        while left:
            path.append(min(left, key=lambda i: distance[path[-1], i]))
            left.remove(path[-1])
        path.append(len(places))  # an end that is near to all
        improved = True
        while improved:
            improved = False
            for i in range(1, len(path) - 2):
                for j in range(i + 1, len(path) - 1):
                    before = distance[path[i - 1], path[i]] + distance[path[j], path[j + 1]]
                    after = distance[path[i - 1], path[j]] + distance[path[i], path[j + 1]]
                    if after < before - 1e-9:
                        path[i : j + 1] = path[i : j + 1][::-1]
                        improved = True
        order += [int(members[i - 1]) for i in path[1:-1]]
    return np.array(order, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Distinct:
    """Rule that no two readings are taken in nearly the same posture."""

    postures: FloatArray  #: (N, n) joint angles of the candidates [rad]
    #: two postures are distinct if the position of a joint differs by at least this [rad or m]; zero lets a
    #: candidate be read again
    angle: float

    def near(self, candidate: int, index: IndexArray | slice = slice(None)) -> BoolArray:
        """Return which of some candidates are not distinct from one."""
        return np.asarray(np.abs(self.postures[index] - self.postures[candidate]).max(axis=1) < self.angle)

    def best_mean(self, prices: FloatArray, count: int) -> float:
        """Bound the mean price of any list of distinct readings.

        Two postures in one cell of a grid narrower than the angle are not distinct, so a list has at most one
        reading of each cell: the mean of the greatest prices of as many cells bounds it, whatever the grid.

        Args:
            prices: (N,).
            count: readings in a list.
        """
        if self.angle <= 0.0:
            return float(prices.max())
        top = np.argsort(-prices)[: max(_LOOKED_AT, 10 * count)]
        rest = prices[top[-1]] if len(top) < len(prices) else 0.0
        bounds = []
        for shift in self.angle * np.random.default_rng(0).random((_PARTITIONS, self.postures.shape[1])):
            cells = np.floor((self.postures[top] + shift) / (_INSIDE * self.angle)).astype(np.int64)
            greatest: dict[bytes, float] = {}
            for cell, price in zip(cells, prices[top].tolist(), strict=True):
                greatest.setdefault(cell.tobytes(), price)
                if len(greatest) == count:
                    break
            bounds.append((sum(greatest.values()) + (count - len(greatest)) * rest) / count)
        return float(min(bounds))


@dataclass(frozen=True, eq=False)
class ExactDesign:
    """A list of readings."""

    atoms: Atoms  #: (n,) candidates with their loads, in the order in which they were found
    matrix: FloatArray  #: (p, p) information of earlier readings, priors and the list
    #: share that it has, at least, of the greatest φ of all lists of n readings which obey the same rules,
    #: proved by sweeps over all candidates
    efficiency: float


def exact_design(problem: DesignProblem, design: Design, distinct: Distinct, *, seed: int = 0) -> ExactDesign:
    """Find a list of n readings, from optimal weights.

    Readings are taken one by one, the weights standing in for those to come; then each is exchanged for
    others as long as φ grows.

    Args:
        problem: the choice.
        design: optimal weights of it.
        distinct: which postures go together.
        seed: of the restarts.

    Raises:
        RequestError: there are not as many distinct postures.
    """
    search = _Search(problem, design, distinct)
    best = search.improved(search.completed([]))
    random = np.random.default_rng(seed)
    few = problem.readings < _LONG and len(problem.base) <= _MANY
    for _ in range(min(_MOST_RESTARTS, _RESTARTED // problem.readings) if few else 0):
        kept = random.permutation(problem.readings)[: -(-2 * problem.readings // 3)]
        trial = search.improved(search.completed([best[i] for i in kept]))
        best = max(best, trial, key=lambda atoms: problem.criterion.information(search.matrix(atoms)))
    M = search.matrix(best) / problem.squares
    return ExactDesign(best[0].joined(*best[1:]), M, list_efficiency(problem, distinct, M, design))


def list_efficiency(problem: DesignProblem, distinct: Distinct, M: FloatArray, optimum: Design) -> float:
    """Bound the share that a list has of the greatest φ of all lists which obey the same rules.

    Any supporting matrix proves a bound; those of mixtures of the list and the optimal weights are tried.

    Args:
        problem: the choice.
        distinct: which postures go together.
        M: (p, p) information with the list.
        optimum: optimal weights.
    """
    M, best = M * problem.squares, optimum.matrix * problem.squares
    bounds = [optimum.bound]
    bounds += [problem.bound(share * M + (1.0 - share) * best) for share in _MIXTURES]
    upper = min(
        problem.upper(bound.support, distinct.best_mean(bound.prices, problem.readings)) for bound in bounds
    )
    return min(1.0, problem.criterion.information(M) / upper)


class _Search:
    """Exchange of readings in one problem."""

    def __init__(self, problem: DesignProblem, design: Design, distinct: Distinct) -> None:
        self._problem, self._distinct = problem, distinct
        self._criterion, self._base = problem.criterion, problem.base
        added = design.matrix - problem.base / problem.squares
        self._expected = added * problem.squares / problem.readings
        best = np.argsort(-design.bound.prices)[: max(_POOL, 4 * problem.readings)]
        self._pool: IndexArray = np.sort(best)
        self._candidates = problem.candidates[self._pool]

    def matrix(self, atoms: list[Atoms]) -> FloatArray:
        """Return M0 + Σ K_i (p, p)."""
        return np.asarray(self._base + sum(each.information[0] for each in atoms))

    def completed(self, kept: list[Atoms]) -> list[Atoms]:
        """Complete a list, the reading of the best price after the other."""
        atoms, M = list(kept), self.matrix(kept)
        free = np.ones(len(self._problem.candidates), dtype=np.bool_)
        for each in kept:
            free &= ~self._distinct.near(each.index[0])
        while len(atoms) < self._problem.readings:
            if not free.any():
                raise RequestError(
                    f"only {len(atoms)} candidates are in postures {np.degrees(self._distinct.angle):.3g}° "
                    f"apart, but {self._problem.readings} readings are requested",
                    where="distinct_angle",
                    remedy="ask for fewer readings, a smaller angle, or more candidates",
                )
            G = self._criterion.support(M + (self._problem.readings - len(atoms)) * self._expected)
            new = self._problem.candidates.best(G, free)
            free &= ~self._distinct.near(new.index[0])
            atoms.append(new)
            M = M + new.information[0]
        return atoms

    def improved(self, atoms: list[Atoms]) -> list[Atoms]:
        """Exchange one reading at a time while φ grows."""
        atoms = list(atoms)
        near = np.array([self._distinct.near(each.index[0], self._pool) for each in atoms])
        taken = near.sum(axis=0)  # how many readings each candidate of the pool does not go with
        M = self.matrix(atoms)
        for _ in range(max(2, _EXCHANGES // len(atoms))):
            before = value = self._criterion.information(M)
            for i, old in enumerate(atoms):
                # A candidate that adds more to the others than the one left out
                rest, free = M - old.information[0], taken == near[i]
                at = rest if self._criterion.information(rest) > 1e-6 * value else M
                G = self._criterion.support(at)
                prices = np.where(free, self._candidates.prices(G), -np.inf)
                tried = self._candidates.atoms(np.argsort(-prices)[: min(_TRIED, int(free.sum()))], G)
                reached = [self._criterion.information(rest + K) for K in tried.information]
                best = int(np.argmax([_IMPROVES * value, *reached]))
                if not best:
                    continue
                M = rest + tried.information[best - 1]
                taken, atoms[i] = taken - near[i], tried[best - 1 : best].among(self._pool)
                near[i] = self._distinct.near(atoms[i].index[0], self._pool)
                taken, value = taken + near[i], self._criterion.information(M)
            if value <= _IMPROVES * before:
                break
        return atoms


def random_plans(problem: DesignProblem, M: FloatArray, s: int, seed: int) -> OtherPlan:
    """Return the mean of random plans of the same candidates, beside a list of information M (p, p)."""
    random = np.random.default_rng([seed, 2])
    n, values, variances = problem.readings, [], []
    for _ in range(_RANDOM_PLANS):
        index = random.integers(0, len(problem.candidates), n)
        drawn = problem.candidates.under(index, _drawn_directions(random, n)).information
        other = problem.base + drawn.sum(axis=0)
        values.append(problem.criterion.information(other))
        variances.append(np.square(uncertainty_of(other / problem.squares, s)))
    efficiency = float(np.mean(values)) / problem.criterion.information(M * problem.squares)
    return OtherPlan(efficiency, np.sqrt(np.mean(variances, axis=0)))


def one_at_a_time(problem: DesignProblem, distinct: Distinct, M: FloatArray, s: int) -> OtherPlan:
    """Return the plan in which each reading is the best next one by its price, beside a list's M (p, p)."""
    M, other = M * problem.squares, problem.base
    share = 1e-6 * (M - problem.base)
    free = np.ones(len(problem.candidates), dtype=np.bool_)
    for _ in range(problem.readings):
        best = problem.candidates.best(problem.criterion.support(other + share), free)
        other = other + best.information[0]
        free &= ~distinct.near(best.index[0])
    efficiency = problem.criterion.information(other) / problem.criterion.information(M)
    return OtherPlan(efficiency, uncertainty_of(other / problem.squares, s))


def _drawn_directions(random: np.random.Generator, count: int) -> FloatArray:
    """Draw unit vectors (count, 3)."""
    draws = random.standard_normal((count, 3))
    return np.asarray(draws / np.linalg.norm(draws, axis=1, keepdims=True))
