"""Choice of readings: the plan of a whole campaign with its certificate, or advice on the next reading.

Plan: candidates → optimal weights → list of distinct postures → validation → order → comparison with other
    plans.

Advice: each candidate is one more reading of all targets under the strongest force of the set. It adds
``K = AᵀΣ⁻¹A`` to the information ``G = RᵀR`` of the readings at hand, so that the standard uncertainty of
c_j after the reading is known beforehand: ``u_j = σ √[(G + K)⁻¹]_jj``, the uncertainty by method
partial_pose. Candidates are compared by u_j alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Any, Final

import numpy as np

from jointstiff.schemas.fields import validate_list
from jointstiff.schemas.joints import JOINT_UNITS
from jointstiff.schemas.plan import MAX_READINGS, JointsGoal, LoadPointGoal, PlanCriterion
from jointstiff.schemas.run import Advice
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, unit_columns
from jointstiff.solver.design.candidates import (
    PlanRequest,
    Pool,
)
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
    compute_uncertainties,
    optimise_design,
)
from jointstiff.solver.errors import RequestError
from jointstiff.solver.evidence.term_tests import MISTAKE_LEVEL, compute_noncentrality
from jointstiff.solver.fit.estimate import CARRIES, Estimate
from jointstiff.solver.fit.observability import Spectrum
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.fit.triangle import orthonormal_basis
from jointstiff.solver.mechanics.block import STANDARD_GRAVITY, targets_in_flange, unloaded_block
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import JOINTS, TURNS
from jointstiff.solver.mechanics.terms import LOAD_POINT
from jointstiff.solver.text import figure, posture_text, stiffness_text

_LINKS_GAP, _OTHERS_GAP = 1e-2, 1e-4
"""Gaps (1 − efficiency) at which a search for optimal weights ends: the first if elastic links are a
nuisance, the second for criteria that were not requested."""
_WORST_PLACES: Final = 12
"""Greatest number of places for the criterion of the worst place; its dual problem has a share of each
place."""
_RANDOM_PLANS: Final = 20
_PARTITIONS: Final = 8
"""Number of partitions of the postures into cells that are tried; each gives a bound, and the sharpest
counts."""
_COMPARED_CANDIDATES: Final = 4_000
"""Number of candidates of the greatest prices whose cells are compared. The least of these prices bounds the
prices of all other candidates."""
_RELATIVE_CELL_WIDTH: Final = 1.0 - 1e-9
"""Width of a cell relative to the angle, so that rounding puts no two distinct postures into one cell."""
_MIXTURES: Final = (0.5, 0.75, 0.9, 1.0)
"""Weights of a list's information, mixed with that of the optimum, in the matrices at which bounds are
computed."""
_POOL: Final = 4_000
"""Number of candidates of the greatest prices for which readings may be exchanged."""
_EVALUATED_EXCHANGES: Final = 8
"""Number of candidates of the greatest prices whose exchange for a reading is evaluated exactly."""
_EXCHANGES: Final = 600
"""Number of exchanges tried in one search: 30 passes over a list of 20. A long list is soon near its
optimum."""
_RESTARTED_READINGS: Final = 160
"""Total length of the lists of all restarts, so that short lists get most restarts. Each restart chooses a
third of the list anew."""
_MOST_RESTARTS: Final = 16
_LONG_LIST: Final = 60
"""Number of readings of a list from which on restarts gain nothing."""
_MANY_PARAMETERS: Final = 30
"""Number of parameters above which restarts are not worth their time, as with elastic links."""
_BLOCK: Final = 4
"""Number of fitted readings in a block, which is a good plan by itself."""
_SWAPS: Final = 600
"""Number of exchanges between blocks that are tried."""
_REGULARISING_SHARE: Final = 1e-6
"""Small information, relative to that of the whole list, that is added so that a few readings are not
singular."""
_COVERAGE: Final = 1.959963984540054
"""Half-width of an interval of 95 % over the standard uncertainty, for a normal distribution."""
_IMPROVEMENT_FACTOR: Final = 1.0 + 1e-10
"""Least factor on φ that counts as an improvement, not as rounding."""


@dataclass(frozen=True, eq=False)
class OtherPlan:
    """Plan of the same number of readings, chosen in another way, for comparison."""

    efficiency: float  #: φ of this plan over φ of the campaign plan
    uncertainty: FloatArray  #: (s,) standard uncertainty of each joint's relative compliance


@dataclass(frozen=True, eq=False)
class CampaignPlan:
    """Plan of a campaign: an ordered list of n readings of a robot with q joints, to determine s of them."""

    joints: FloatArray  #: (n, q) controller's angles [rad], in the order in which to take the readings
    force: FloatArray  #: (n, 3) force on the robot, axes of R0 [N]
    anchor: IndexArray  #: (n,) index of the cable's anchor; -1 without a cable
    along: FloatArray | None  #: (n, 3) unit vectors in R0 along which to read; None if all coordinates are
    validation: BoolArray  #: (n,) mask of the readings that are held out from the fit
    block: IndexArray  #: (n,) number of each reading's block, a good plan by itself; ascending from 0
    efficiency: float  #: lower bound on φ of the list over the greatest φ of any list that obeys the rules
    weights_gap: float  #: 1 − efficiency of the optimal weights that lead to the list
    efficiencies: Mapping[PlanCriterion, float]  #: efficiency of the list for each criterion that applies
    pool: Pool  #: the candidates, the parameters to determine, and the numbers of infeasible readings
    uncertainty: FloatArray  #: (s,) standard uncertainty of each joint's relative compliance after the list
    #: (s,) the uncertainty before the list; inf where the joint is not determined
    uncertainty_before: FloatArray
    #: standard uncertainty of the predicted deflection in the work area under the load [m]: root mean
    #: square and greatest; None without a work area
    deflection: tuple[float, float] | None
    random_plans: OtherPlan  #: mean of random plans
    one_at_a_time: OtherPlan  #: plan in which each reading is the best next one
    goal_share: float | None = None  #: expanded uncertainty over the goal's uncertainty; None without a goal


def plan_campaign(robot: Robot, request: PlanRequest) -> CampaignPlan:
    """Plan a campaign: choose the readings, add readings for validation, and put all in order.

    Args:
        robot: robot with q joints.
        request: equipment, rules and number of readings, or a goal.

    Raises:
        RequestError: no reading is feasible, no load twists a joint, or there are too few readings or too few
            distinct postures.
    """
    pool = Pool.from_request(robot, request)
    joint_count = len(pool.parameters.joints)
    distinct = DistinctPostures(pool.readings.joints, request.angle)
    criteria, worst_place = _build_criteria(pool, request)
    if request.goal is not None:
        request = replace(
            request,
            readings=find_least_readings(robot, pool, request, criteria[request.criterion], distinct),
        )
    held_out = round(request.validation * request.readings)
    fitted = request.readings - held_out
    _check_reading_count(request, fitted, joint_count)
    problem = DesignProblem(pool.candidates, criteria[request.criterion], fitted, pool.base)
    design = optimise_design(problem, _LINKS_GAP if request.links else None)
    chosen = find_exact_design(problem, design, distinct, seed=request.seed)
    information = chosen.matrix  # (p, p) of all p parameters, the joints first, by old and chosen readings
    deflection = None
    if worst_place is not None:
        # The criterion of the work area is φ = 1 / (mean variance of the deflection).
        phi = criteria["work_area"].information(information)
        deflection = float(phi**-0.5), float(np.sqrt(worst_place.variances(information).max()))
    validation = _draw_validation_readings(pool, distinct, chosen.atoms.index, held_out, request.seed)
    atoms = chosen.atoms.join(validation)
    block = _divide_into_blocks(
        chosen.atoms.information / problem.scale_squared, pool.base, criteria[request.criterion]
    )
    anchors = pool.readings.anchor[atoms.index]
    # To change the anchor takes longer than to travel, so readings at several anchors are not divided into
    # blocks.
    if (anchors != anchors[0]).any():
        block = np.zeros_like(block)
    # The readings for validation are dealt out evenly to the blocks.
    block = np.concatenate([block, np.arange(held_out) % (1 + block.max())])
    order = order_by_travel(pool.readings.joints[atoms.index], block if block.any() else anchors)
    readings = pool.readings[atoms.index[order]]
    return CampaignPlan(
        joints=readings.joints,
        force=pool.candidate_forces(atoms.force[order], atoms.index[order]),
        anchor=readings.anchor,
        along=readings.along,
        validation=order >= fitted,
        block=block[order],
        efficiency=chosen.efficiency,
        weights_gap=1.0 - design.bound.efficiency,
        efficiencies=_bound_efficiencies(pool, request, criteria, distinct, chosen, fitted),
        pool=pool,
        uncertainty=compute_uncertainties(information, joint_count),
        uncertainty_before=compute_uncertainties(pool.base, joint_count),
        deflection=deflection,
        random_plans=average_random_plans(problem, information, joint_count, request.seed),
        one_at_a_time=plan_one_at_a_time(problem, distinct, information, joint_count),
        goal_share=None if request.goal is None else compute_goal_share(robot, pool, request, chosen),
    )


def _check_reading_count(request: PlanRequest, fitted: int, joint_count: int) -> None:
    """Refuse a plan whose fitted readings have fewer coordinates than there are joints to determine.

    A plan that continues a campaign may have fewer: the readings so far are fitted, too.

    Raises:
        RequestError: there are too few readings.
    """
    coordinates = request.rows_of_reading * fitted
    if fitted < 1 or (request.so_far is None and coordinates < joint_count):
        raise RequestError(
            f"without the readings for validation, {fitted} readings remain, too few to determine "
            f"{joint_count} joints",
            where="readings",
            remedy="request more readings, or a smaller fraction for validation",
        )


def _bound_efficiencies(
    pool: Pool,
    request: PlanRequest,
    criteria: Mapping[PlanCriterion, Criterion],
    distinct: DistinctPostures,
    chosen: ExactDesign,
    fitted: int,
) -> dict[PlanCriterion, float]:
    """Return lower bounds on the efficiency of the chosen list: by the requested criterion and smooth ones.

    Args:
        pool: candidates of the plan.
        request: request with the criterion.
        criteria: criteria that apply, by name.
        distinct: rule that postures must differ.
        chosen: chosen list of readings.
        fitted: number of readings in the list.
    """
    efficiencies: dict[PlanCriterion, float] = {}
    for name, criterion in criteria.items():
        if name == request.criterion:
            efficiencies[name] = chosen.efficiency
        elif isinstance(criterion, SmoothCriterion):
            problem = DesignProblem(pool.candidates, criterion, fitted, pool.base)
            design = optimise_design(problem, _LINKS_GAP if request.links else _OTHERS_GAP)
            efficiencies[name] = bound_list_efficiency(problem, distinct, chosen.matrix, design)
    return efficiencies


def _build_criteria(
    pool: Pool, request: PlanRequest
) -> tuple[dict[PlanCriterion, Criterion], GOptimality | None]:
    """Build the criteria that apply to a plan.

    Returns:
        The criteria by name; and the criterion of the worst place, None without a work area.

    Raises:
        RequestError: the requested criterion needs a work area.
    """
    s, p = len(pool.parameters.joints), len(pool.base)
    weights = np.r_[np.ones(s), np.zeros(p - s)] / s
    if isinstance(request.goal, LoadPointGoal) and not request.links:
        weights[-3:] = 1.0 / 3.0  # the load point, in units of the mistake, is the last of the nuisance
    criteria: dict[PlanCriterion, Criterion] = {
        "relative_a": AOptimality(np.diag(weights)),
        "d": DOptimality(s),
        "e": EOptimality(np.ones(s)),
    }
    worst_place: GOptimality | None = None
    if pool.places is not None:
        worst_place = GOptimality(pool.places[:: -(-len(pool.places) // _WORST_PLACES)])
        criteria |= {"work_area": AOptimality(pool.places.mean(axis=0)), "worst_place": worst_place}
    if request.criterion not in criteria:
        raise RequestError(
            f"criterion {request.criterion} needs a work area",
            where="work_area",
            remedy="give `work_area`, two corners of a box, or use criterion relative_a, d or e",
        )
    return criteria, worst_place


def compute_goal_share(robot: Robot, pool: Pool, request: PlanRequest, exact: ExactDesign) -> float:
    """Return the expanded uncertainty, or the least mistake that shows, over that of the goal.

    Args:
        robot: n joints.
        pool: candidates of the plan.
        request: request with the goal.
        exact: list of readings.

    Raises:
        RequestError: the goal is about deflections, and there is no work area; or the goal is about the load
            point, and the load is the robot's own weight.
    """
    goal, M = request.goal, exact.matrix
    if goal is None:
        return 0.0
    if isinstance(goal, LoadPointGoal):
        return compute_least_mistake(robot, pool, request, exact.atoms) / goal.mistake
    if isinstance(goal, JointsGoal):
        return _COVERAGE * float(compute_uncertainties(M, len(pool.parameters.joints)).max()) / goal.relative
    if pool.places is None:
        raise RequestError(
            "the goal concerns deflections in a work area, but the request has no work area",
            where="work_area",
            remedy='give `work_area`, two corners of a box, or a goal for the joints, such as "15 %"',
        )
    information = AOptimality(pool.places.mean(axis=0)).information(M)
    return _COVERAGE * float(information**-0.5 if information > 0.0 else np.inf) / goal.uncertainty


def compute_least_mistake(robot: Robot, pool: Pool, request: PlanRequest, chosen: Atoms) -> float:
    """Return the least mistake of the load point [m] that its F test finds with the power `POWER`.

    The mistake is that in the direction in which the readings show it least: with N = Bᵀ(I − P_A)B of the
    load point's columns B and the joints' columns A, ``σ √(λ₀ / least eigenvalue of N)`` (Baarda;
    method.md §13). Infinite for too few readings.

    Args:
        robot: n joints.
        pool: candidates of the plan.
        request: equipment, and the readings so far.
        chosen: readings of the plan.

    Raises:
        RequestError: the load is the robot's own weight, which has no load point; or no stiffness is known.
    """
    if request.own_weight_rows is not None:
        raise RequestError(
            "the load is the robot's own weight, which has no load point",
            where="goal",
            remedy='give a goal for the uncertainty of the joints, such as "15 %"',
        )
    if not pool.parameters.known.any():
        raise RequestError(
            "an error of the load point shows in deflections, but no stiffness is known to compute the "
            "deflections",
            where="goal",
            remedy="continue a campaign, or state the expected `stiffness` of the joints",
        )
    readings = pool.readings[chosen.index]
    forces = pool.candidate_forces(chosen.force, chosen.index)
    parts = [request.equipment.build_measurements(robot, readings.joints, forces, readings.along)]
    parts += [] if request.so_far is None else [request.so_far]
    stacks = [Rows(robot, part).stack([JOINTS, LOAD_POINT], pool.parameters.nominal) for part in parts]
    rows, span = np.concatenate([stack.flat for stack in stacks]), stacks[0].span
    known = orthonormal_basis(unit_columns(rows[:, span[JOINTS.name]])[0])
    columns = rows[:, span[LOAD_POINT.name]]
    singular = np.linalg.svd(columns - known @ (known.T @ columns), compute_uv=False)
    width = len(singular)
    freedom = sum(int(stack.read.sum()) for stack in stacks) - known.shape[1] - width
    noncentrality = compute_noncentrality(width, freedom, MISTAKE_LEVEL)
    least = max(float(singular.min()), np.finfo(float).tiny)
    return float(request.equipment.sigma * np.sqrt(noncentrality) / least)


def find_least_readings(
    robot: Robot, pool: Pool, request: PlanRequest, criterion: Criterion, distinct: DistinctPostures
) -> int:
    """Find the least number of readings, with those held out for validation, that meets the goal.

    Uncertainties are nearly proportional to 1/√(number of readings), from which an interval that contains the
    wanted number follows; bisection then finds the number.

    Raises:
        RequestError: the greatest number of readings of a plan does not meet the goal.
    """
    s = len(pool.parameters.joints)
    coordinates = request.rows_of_reading
    least = 1 if request.so_far is not None else -(-s // coordinates)
    most = MAX_READINGS - round(request.validation * MAX_READINGS)

    def compute_share(fitted: int) -> float:
        """Return the uncertainty, or least mistake, of `fitted` fitted readings over that of the goal."""
        problem = DesignProblem(pool.candidates, criterion, fitted, pool.base)
        design = optimise_design(problem, _LINKS_GAP if request.links else None)
        exact = find_exact_design(problem, design, distinct, seed=request.seed)
        return compute_goal_share(robot, pool, request, exact)

    # `low` readings do not meet the goal; `high` is raised until it does.
    low, high = least - 1, least
    while (reached := compute_share(high)) > 1.0:
        if high >= most:
            of_load_point = isinstance(request.goal, LoadPointGoal)
            what = (
                "the least mistake of the load point that the readings show"
                if of_load_point
                else "the uncertainty"
            )
            greater = "mistake" if of_load_point else "uncertainty"
            raise RequestError(
                f"with {MAX_READINGS} readings, the maximum of a plan, {what} is still "
                f"{figure(reached, '.3g')} times the value of the goal",
                where="goal",
                remedy=f"choose a goal with a greater {greater}, apply a greater load, read more targets, or "
                "reduce the noise",
            )
        low, high = high, min(most, max(high + 1, int(min(high * reached**2, most))))
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if compute_share(middle) <= 1.0 else (middle, high)
    # The goal needs `high` fitted readings: add the number of readings that are held out.
    count = high
    while count - round(request.validation * count) < high:
        count += 1
    return count


def _draw_validation_readings(
    pool: Pool, distinct: DistinctPostures, chosen: IndexArray, count: int, seed: int
) -> Atoms:
    """Draw readings for validation at random, distinct from the chosen ones, under random loads.

    Args:
        pool: feasible candidates.
        distinct: rule that two postures must differ.
        chosen: indices of the readings that are used in the fit.
        count: number of readings to draw.
        seed: seed of the draw.

    Raises:
        RequestError: too few postures are distinct.
    """
    random = np.random.default_rng([seed, 1])
    allowed = ~np.any([distinct.find_conflicts(i) for i in chosen], axis=0)
    validation: list[int] = []
    for i in random.permutation(len(allowed)):
        if len(validation) < count and allowed[i]:
            validation.append(int(i))
            allowed &= ~distinct.find_conflicts(i)
    if len(validation) < count:
        raise RequestError(
            f"only {len(validation)} of {count} readings for validation are in postures that differ "
            "from those of all other readings",
            where="distinct_angle",
            remedy="request fewer readings, a smaller angle, or more candidates",
        )
    return pool.candidates.build_atoms_under(
        np.array(validation, dtype=np.intp), _draw_directions(random, count)
    )


def _divide_into_blocks(information: FloatArray, base: FloatArray, criterion: Criterion) -> IndexArray:
    """Divide n readings into blocks of four readings, so that each block is a good plan by itself.

    Random exchanges of readings between two blocks are accepted if the product of the blocks' φ grows. The
    last block also has the readings that remain when n is divided by four.

    Args:
        information: (n, p, p) information of the readings.
        base: (p, p) information of earlier readings and priors.
        criterion: criterion of the plan.

    Returns:
        (n,) number of each reading's block; the best block has number 0.
    """
    count = len(information)
    block = np.minimum(np.arange(count) // _BLOCK, max(count // _BLOCK - 1, 0))
    total = base + information.sum(axis=0)
    # A little information is added, as the matrix of a few readings with a dial gauge would be singular.
    added = _REGULARISING_SHARE * np.diag(np.diagonal(total))

    def compute_log_information(members: BoolArray) -> float:
        """Return log φ of the readings marked in a mask (n,)."""
        value = criterion.information(base + added + information[members].sum(axis=0))
        return float(np.log(np.maximum(value, 1e-300)))  # never log 0

    values = [compute_log_information(block == b) for b in range(1 + int(block.max()))]
    random = np.random.default_rng(0)
    for _ in range(_SWAPS if len(values) > 1 else 0):
        i, j = random.choice(count, 2, replace=False)
        a, b = block[i], block[j]
        if a == b:
            continue
        block[i], block[j] = b, a
        exchanged = compute_log_information(block == a), compute_log_information(block == b)
        if sum(exchanged) > values[a] + values[b]:
            values[a], values[b] = exchanged
        else:
            block[i], block[j] = a, b
    # Number the blocks anew, the best first.
    best_first = np.argsort(-np.array(values), kind="stable")
    return np.asarray(np.argsort(best_first)[block], dtype=np.intp)


def order_by_travel(joints: FloatArray, group: IndexArray) -> IndexArray:
    """Order readings group by group so that travel is short, by nearest neighbours and 2-opt exchanges.

    Travel is the greatest change of a joint from one posture to the next [rad or m].

    Args:
        joints: (n, q) postures [rad or m].
        group: (n,) number of the group of each reading, such as its block or anchor.

    Returns:
        (n,) indices of the readings in order.
    """
    order: list[int] = []
    for each in np.unique(group):
        members = np.flatnonzero(group == each)
        start = joints[order[-1]] if order else np.zeros(joints.shape[1])
        stops = np.vstack([start, joints[members]])
        distance = np.pad(np.abs(stops[:, None] - stops).max(axis=2), (0, 1))
        unvisited, path = set(range(1, len(stops))), [0]
        while unvisited:
            path.append(min(unvisited, key=lambda i: distance[path[-1], i]))
            unvisited.remove(path[-1])
        path.append(len(stops))  # a dummy end at distance zero from all, as any posture may be last
        improved = True  # 2-opt: reverse a part of the path as long as this makes the path shorter
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
class DistinctPostures:
    """Rule that no two readings are taken in nearly the same posture."""

    postures: FloatArray  #: (N, n) joint angles of the candidates [rad]
    #: two postures are distinct if the position of a joint differs by at least this much [rad or m]; zero
    #: allows two readings of one candidate
    angle: float

    def find_conflicts(self, candidate: int, index: IndexArray | slice = slice(None)) -> BoolArray:
        """Return a mask of the candidates whose postures are too near to the posture of a given candidate.

        Args:
            candidate: index of the given candidate.
            index: indices of the candidates that are compared with it; all by default.
        """
        return np.asarray(np.abs(self.postures[index] - self.postures[candidate]).max(axis=1) < self.angle)

    def bound_mean_price(self, prices: FloatArray, count: int) -> float:
        """Return an upper bound on the mean price of any list of distinct readings.

        Two postures in one cell of a grid narrower than the angle are not distinct, so a list has at most one
        reading in each cell. With any grid, the mean of the `count` greatest prices of cells is a bound.

        Args:
            prices: (N,) price of each candidate.
            count: number of readings in a list.
        """
        if self.angle <= 0.0:
            return float(prices.max())
        top = np.argsort(-prices)[: max(_COMPARED_CANDIDATES, 10 * count)]
        # No candidate outside `top` has a greater price than this.
        other_price = prices[top[-1]] if len(top) < len(prices) else 0.0
        bounds = []
        for shift in self.angle * np.random.default_rng(0).random((_PARTITIONS, self.postures.shape[1])):
            cells = np.floor((self.postures[top] + shift) / (_RELATIVE_CELL_WIDTH * self.angle)).astype(
                np.int64
            )
            # Prices descend, so the first price met in a cell is the greatest of this cell.
            price_of_cell: dict[bytes, float] = {}
            for cell, price in zip(cells, prices[top].tolist(), strict=True):
                price_of_cell.setdefault(cell.tobytes(), price)
                if len(price_of_cell) == count:
                    break
            bounds.append((sum(price_of_cell.values()) + (count - len(price_of_cell)) * other_price) / count)
        return float(min(bounds))


@dataclass(frozen=True, eq=False)
class ExactDesign:
    """List of n readings, with its information and a bound on its efficiency."""

    atoms: Atoms  #: (n,) candidates with their loads, in the order in which they were found
    matrix: FloatArray  #: (p, p) information of earlier readings, priors and the list
    #: lower bound on φ of the list over the greatest φ of any list of n readings that obeys the same rules
    efficiency: float


def find_exact_design(
    problem: DesignProblem, design: Design, distinct: DistinctPostures, *, seed: int = 0
) -> ExactDesign:
    """Find a list of n distinct readings with a great φ, starting from optimal weights.

    Readings are chosen one by one; readings not yet chosen are represented by the mean information of the
    optimal weights. Then readings are exchanged for other candidates as long as φ grows. Short lists are
    improved by restarts that keep two thirds of the best list.

    Args:
        problem: readings to choose from, and the criterion.
        design: optimal weights of the problem.
        distinct: rule that two postures of a list must differ.
        seed: seed of the restarts.

    Raises:
        RequestError: there are fewer distinct postures than readings.
    """
    search = _ExchangeSearch(problem, design, distinct)
    expected = (design.matrix * problem.scale_squared - problem.base) / problem.readings
    best = search.improve(_complete_list(problem, distinct, [], expected))
    random = np.random.default_rng(seed)
    restarts_pay = problem.readings < _LONG_LIST and len(problem.base) <= _MANY_PARAMETERS
    for _ in range(min(_MOST_RESTARTS, _RESTARTED_READINGS // problem.readings) if restarts_pay else 0):
        kept = random.permutation(problem.readings)[: -(-2 * problem.readings // 3)]
        trial = search.improve(_complete_list(problem, distinct, [best[i] for i in kept], expected))
        best = max(
            best, trial, key=lambda atoms: problem.criterion.information(search.information_matrix(atoms))
        )
    M = search.information_matrix(best) / problem.scale_squared
    return ExactDesign(best[0].join(*best[1:]), M, bound_list_efficiency(problem, distinct, M, design))


def bound_list_efficiency(
    problem: DesignProblem, distinct: DistinctPostures, M: FloatArray, optimum: Design
) -> float:
    """Return a lower bound on φ of a list over the greatest φ of all lists that obey the same rules.

    Each information matrix proves a bound by its supporting matrix. Mixtures of the list's and the optimal
    weights' information are tried, and the sharpest bound counts.

    Args:
        problem: readings to choose from, and the criterion.
        distinct: rule that postures of a list differ.
        M: (p, p) information with the list.
        optimum: optimal weights of the problem.
    """
    # Both matrices in the problem's units
    M, optimal = M * problem.scale_squared, optimum.matrix * problem.scale_squared
    bounds = [optimum.bound]
    bounds += [problem.bound(share * M + (1.0 - share) * optimal) for share in _MIXTURES]
    upper = min(
        problem.upper_bound(bound.supergradient, distinct.bound_mean_price(bound.prices, problem.readings))
        for bound in bounds
    )
    return min(1.0, float(problem.criterion.information(M)) / upper)


def _complete_list(
    problem: DesignProblem, distinct: DistinctPostures, kept: list[Atoms], expected: FloatArray
) -> list[Atoms]:
    """Complete a list of readings by adding, one by one, the candidate of the greatest price.

    Args:
        problem: readings to choose from, and the criterion.
        distinct: rule that postures of a list differ.
        kept: readings that are already in the list.
        expected: (p, p) mean information expected of each reading still to be chosen.

    Raises:
        RequestError: there are fewer distinct postures than readings.
    """
    atoms, M = list(kept), problem.base + sum(each.information[0] for each in kept)
    allowed = np.ones(len(problem.candidates), dtype=np.bool_)
    for each in kept:
        allowed &= ~distinct.find_conflicts(each.index[0])
    while len(atoms) < problem.readings:
        if not allowed.any():
            raise RequestError(
                f"only {len(atoms)} candidates are in postures that differ by "
                f"{np.degrees(distinct.angle):.3g}°, but {problem.readings} readings are requested",
                where="distinct_angle",
                remedy="request fewer readings, a smaller angle, or more candidates",
            )
        G = problem.criterion.supergradient(M + (problem.readings - len(atoms)) * expected)
        atoms.append(problem.candidates.find_highest_priced(G, allowed))
        allowed &= ~distinct.find_conflicts(atoms[-1].index[0])
        M = M + atoms[-1].information[0]
    return atoms


class _ExchangeSearch:
    """Search that improves a list by exchanging readings for candidates of great prices."""

    def __init__(self, problem: DesignProblem, design: Design, distinct: DistinctPostures) -> None:
        self._distinct, self._criterion, self._base = distinct, problem.criterion, problem.base
        best = np.argsort(-design.bound.prices)[: max(_POOL, 4 * problem.readings)]
        self._pool: IndexArray = np.sort(best)
        self._candidates = problem.candidates[self._pool]

    def information_matrix(self, atoms: list[Atoms]) -> FloatArray:
        """Return the information M0 + Σ K_i (p, p) of earlier readings, priors and a list."""
        return np.asarray(self._base + sum(each.information[0] for each in atoms))

    def improve(self, atoms: list[Atoms]) -> list[Atoms]:
        """Return a list improved by exchanging one reading at a time for another candidate while φ grows."""
        atoms = list(atoms)
        # Mask (n, N) of the candidates too near to each reading, and their numbers of such readings.
        near = np.array([self._distinct.find_conflicts(each.index[0], self._pool) for each in atoms])
        conflicts = near.sum(axis=0)
        M = self.information_matrix(atoms)
        for _ in range(max(2, _EXCHANGES // len(atoms))):
            before = value = self._criterion.information(M)
            for i, old in enumerate(atoms):
                # Search a candidate that adds more to the other readings than the reading taken out. A
                # candidate is allowed if only the reading taken out is too near to it.
                rest, allowed = M - old.information[0], conflicts == near[i]
                # If the other readings are nearly singular, prices are computed from the whole list.
                G = self._criterion.supergradient(
                    rest if self._criterion.information(rest) > 1e-6 * value else M
                )
                prices = np.where(allowed, self._candidates.prices(G), -np.inf)
                tried = self._candidates.build_atoms(
                    np.argsort(-prices)[: min(_EVALUATED_EXCHANGES, int(allowed.sum()))], G
                )
                reached = self._criterion.information(rest + tried.information)
                best = int(np.argmax([_IMPROVEMENT_FACTOR * value, *reached]))
                if not best:  # entry 0, the present list, is not exceeded
                    continue
                M = rest + tried.information[best - 1]
                conflicts = conflicts - near[i]
                atoms[i] = tried[best - 1 : best].map_indices(self._pool)
                near[i] = self._distinct.find_conflicts(atoms[i].index[0], self._pool)
                conflicts = conflicts + near[i]
                value = self._criterion.information(M)
            if value <= _IMPROVEMENT_FACTOR * before:
                break
        return atoms


def average_random_plans(problem: DesignProblem, M: FloatArray, s: int, seed: int) -> OtherPlan:
    """Compute the mean efficiency and uncertainties of random plans, for comparison with a list.

    Args:
        problem: readings to choose from, and the criterion.
        M: (p, p) information with the list.
        s: number of joints to be determined.
        seed: seed of the draws.
    """
    random = np.random.default_rng([seed, 2])
    n, informations, variances = problem.readings, [], []
    for _ in range(_RANDOM_PLANS):
        index = random.integers(0, len(problem.candidates), n)
        drawn = problem.candidates.build_atoms_under(index, _draw_directions(random, n)).information
        random_M = problem.base + drawn.sum(axis=0)
        informations.append(problem.criterion.information(random_M))
        variances.append(np.square(compute_uncertainties(random_M / problem.scale_squared, s)))
    efficiency = float(np.mean(informations) / problem.criterion.information(M * problem.scale_squared))
    return OtherPlan(efficiency, np.sqrt(np.mean(variances, axis=0)))


def plan_one_at_a_time(
    problem: DesignProblem, distinct: DistinctPostures, M: FloatArray, s: int
) -> OtherPlan:
    """Plan readings one at a time, each the best next reading, for comparison with a list.

    Args:
        problem: readings to choose from, and the criterion.
        distinct: rule that postures of a list differ.
        M: (p, p) information with the list.
        s: number of joints to be determined.
    """
    M = M * problem.scale_squared
    other_M = problem.base
    # A little of the list's information makes the matrix regular before the first readings are chosen.
    for atoms in _complete_list(
        problem, distinct, [], _REGULARISING_SHARE / problem.readings * (M - problem.base)
    ):
        other_M = other_M + atoms.information[0]
    efficiency = float(problem.criterion.information(other_M) / problem.criterion.information(M))
    return OtherPlan(efficiency, compute_uncertainties(other_M / problem.scale_squared, s))


def _draw_directions(random: np.random.Generator, count: int) -> FloatArray:
    """Draw random unit vectors (count, 3)."""
    draws = random.standard_normal((count, 3))
    return np.asarray(draws / np.linalg.norm(draws, axis=1, keepdims=True))


LARGEST_RELATIVE_UNCERTAINTY: Final = 0.1
"""Relative standard uncertainty of a compliance above which a joint gets advice."""
MOST_JOINTS: Final = 3
"""Greatest number of joints that get advice, the worst first: one posture often serves several joints."""
MOST_POSTURES: Final = 48
"""Greatest number of measured postures and of new postures; fewer if many joints make each candidate
costly."""
LEAST_GAIN: Final = 0.5
"""Least relative reduction of a joint's standard uncertainty, errors common to all readings included, for
which a reading is advised: who measures once more wants to see that it was worth it."""
TOLERATED_RATIO: Final = 1.1
"""Ratio of the uncertainties after two readings up to which only the easier reading is advised. With weights,
which only pull downwards, this is the new posture; otherwise the measured one, known to be free of
collisions."""
EASIER_FACTOR: Final = 1.05
"""Factor by which another force must be better than a force along an axis of R0 or than the force of the set,
which are easier to apply."""
_COSINE_ROUNDING: Final = 1e-6
"""Difference of a direction's cosine that is not due to rounding."""
_LEAST_LEVER: Final = 1e-6
"""Distance [m] between a force and a joint's axis below which only rounding makes the force twist the
joint."""
_LEAST_SPAN: Final = (1.0, 0.1)
"""Least range of a joint [rad; m for a prismatic joint] from which new postures are drawn."""
_DRAWS: Final = 4
"""Number of draws for each new posture, as limits of coupled joints exclude some of the draws."""
_SEED: Final = 20170924
_CUBE: Final = np.array(
    [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (z, y, x) > (0, 0, 0)],
    dtype=np.float64,
)
"""(13, 3) vectors towards faces, edges and corners of a cube; one of two opposite vectors, as both forces
give the same information."""
_DIRECTIONS: Final = _CUBE / np.linalg.norm(_CUBE, axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class ReadablePostures:
    """M postures in which all targets could be read, and the Jacobians that map a load to deflections."""

    joints: FloatArray  #: (M, n) angles as the controller shows them [rad]
    observation: IndexArray  #: (M,) index of the observation with this posture; -1 for a new posture
    load_jacobian: FloatArray  #: (M, 3, n) translational Jacobian of the load point [m/rad]
    turns: Stack  #: M whitened blocks of rows: motion of the targets per turn of each joint
    readable: Measurements  #: the M observations, with the load of another posture

    @classmethod
    def from_observations(
        cls, robot: Robot, measurements: Measurements, joints: FloatArray, observation: IndexArray
    ) -> ReadablePostures:
        """Compute the Jacobians in M postures, for the targets of the observation that read most targets.

        A measured posture keeps its load point; a new posture gets the load point of the strongest force.

        Args:
            robot: n joints.
            measurements: N observations.
            joints: (M, n) postures, controller's angles [rad].
            observation: (M,) index of the observation with this posture; −1 for a new posture.
        """
        strongest = int(np.argmax(np.linalg.norm(measurements.force, axis=1)))
        richest = int(np.argmax(measurements.coordinates.sum(axis=1)))
        repeated = measurements[np.full(len(joints), richest)]
        targets = targets_in_flange(robot, measurements[richest : richest + 1])
        readable = replace(
            repeated,
            joints=joints,
            position=np.broadcast_to(targets, repeated.position.shape),
            in_flange=np.ones_like(repeated.present),
            load_point=measurements.load_point[np.where(observation < 0, strongest, observation)],
        )
        block = unloaded_block(robot, Postures(robot, robot.joint_map.model_angles(joints)), readable)
        turns = Rows(robot, readable, prepared=block).stack([TURNS], np.zeros(robot.n))
        return cls(joints, observation, block.load_jacobian, turns, readable)

    def __len__(self) -> int:
        """Return the number M of postures."""
        return len(self.joints)

    def __getitem__(self, rows: slice) -> ReadablePostures:
        """Return some of the postures."""
        return ReadablePostures(**{name: part[rows] for name, part in vars(self).items()})

    def information(self, force: FloatArray) -> FloatArray:
        """Return the information ``diag(τ) (Σ_t J_tᵀ Σ_t⁻¹ J_t) diag(τ)`` of a reading under each force.

        τ are the joint torques of the force; J_t moves target t with the joints, and Σ_t is its covariance.

        Args:
            force: (M, D, 3) forces in each posture [N].

        Returns:
            Information (M, D, n, n) on the compliances, in units of sigma⁻².
        """
        torque = force @ self.load_jacobian
        return np.asarray(self.turns.grams[:, None, :-1, :-1] * torque[..., :, None] * torque[..., None, :])


def advise_next_readings(robot: Robot, measurements: Measurements, estimate: Estimate) -> tuple[Advice, ...]:
    """Advise on the best next reading for each joint that is poorly determined.

    For each joint two readings are compared: a measured posture under a load in another direction, and a new
    posture (under the same load if the loads are weights). The reading that is harder to take is dropped if
    the easier reading is about as good; a reading that gains less than `LEAST_GAIN` is dropped, too.

    Returns:
        At most two pieces of advice for each joint, the better first; an empty tuple if all joints are well
        determined or no force was applied.
    """
    joints = _select_poor_joints(estimate)
    if not len(joints) or not measurements.force.any():
        return ()
    count = int(np.clip(36 * MOST_POSTURES // robot.n**2, 4, MOST_POSTURES))
    new = draw_new_postures(robot, measurements, count)
    inside = np.flatnonzero(robot.within_limits(measurements.joints))
    # At most `count` observations, evenly spread
    spread = inside[np.unique(np.linspace(0, len(inside) - 1, min(count, len(inside))).astype(np.intp))]
    strongest = measurements.force[int(np.argmax(np.linalg.norm(measurements.force, axis=1)))]
    if robot.payload is not None:  # a pull may be stronger than the payload, an advised load is not
        heaviest = robot.payload * np.linalg.norm(STANDARD_GRAVITY)
        strongest = strongest * min(1.0, heaviest / np.linalg.norm(strongest))
    # Forces that are all parallel to the strongest one are taken to be weights.
    sizes = np.linalg.norm(measurements.force, axis=1) * np.linalg.norm(strongest)
    weights = bool((np.abs(measurements.force @ strongest) >= (1.0 - 1e-6) * sizes).all())
    search = _NextReading(robot, measurements, estimate, strongest, one_direction=weights)
    all_joints = np.concatenate([measurements.joints[spread], new])
    observation = np.concatenate([spread, np.full(len(new), -1, dtype=np.intp)])
    if not len(all_joints):
        return ()
    postures = ReadablePostures.from_observations(robot, measurements, all_joints, observation)
    measured_postures, new_postures = postures[: len(spread)], postures[len(spread) :]
    advice: list[dict[str, Any]] = []
    # One pair of candidates for each joint: in a measured posture, and in a new posture
    for in_measured, in_new in zip(
        search.find_best_candidates(measured_postures, joints, all_directions=True),
        search.find_best_candidates(new_postures, joints, all_directions=not weights),
        strict=True,
    ):
        easier_first = (in_new, in_measured) if weights else (in_measured, in_new)
        useful = [
            candidate
            for candidate in easier_first
            if candidate and (candidate[1]["uncertainty_ratio"] or 0.0) <= 1.0 - LEAST_GAIN
        ]
        # Drop the harder of two readings if the uncertainty after the easier one is about as small.
        if len(useful) == 2 and useful[0][0] <= TOLERATED_RATIO * useful[1][0]:
            useful = useful[:1]
        advice += [fields for _, fields in sorted(useful, key=itemgetter(0))]
    return tuple(validate_list(Advice, advice))


def _select_poor_joints(estimate: Estimate) -> IndexArray:
    """Return the indices of at most `MOST_JOINTS` joints that are poorly determined, the worst first.

    Joints without a compliance or with compliance zero come first, then the others by relative uncertainty.
    A joint that carries hardly any of the deflection is not among them.
    """
    relative = np.zeros(len(estimate.joints))
    for j, (joint, share) in enumerate(zip(estimate.joints, estimate.greatest_shares.tolist(), strict=True)):
        if share < CARRIES:
            continue
        if joint.status == "not_observable" or joint.compliance == 0.0:
            relative[j] = np.inf
        elif joint.compliance is not None and joint.standard_uncertainty is not None:
            relative[j] = joint.standard_uncertainty / abs(joint.compliance)
    worst = np.argsort(-relative, kind="stable")[:MOST_JOINTS]
    return np.asarray(worst[relative[worst] > LARGEST_RELATIVE_UNCERTAINTY])


def draw_new_postures(robot: Robot, measurements: Measurements, count: int) -> FloatArray:
    """Draw new postures in whole degrees and millimetres, within the measured range and the joints' limits.

    The draw is the same at each call. A joint that hardly moves in the measurements is varied by
    `_LEAST_SPAN`, as the measurements may lack just these postures.

    Args:
        robot: n joints.
        measurements: N observations.
        count: greatest number of postures.

    Returns:
        Postures (M, n) [rad or m], with M at most `count`.
    """
    least, greatest = measurements.joints.min(axis=0), measurements.joints.max(axis=0)
    half = np.maximum(greatest - least, robot.select_by_kind(*_LEAST_SPAN)) / 2.0
    draws = np.random.default_rng(_SEED).uniform(-1.0, 1.0, (_DRAWS * count, robot.n))
    joints = robot.round_to_whole_units((least + greatest) / 2.0 + half * draws)
    return joints[robot.within_limits(joints)][:count]


Candidate = tuple[float, dict[str, Any]]
"""Standard uncertainty of the joint after the reading, in units of sigma [rad/(N·m)/m]; and the fields of
`Advice`."""


class _NextReading:
    """Comparison of candidates for the next reading of one measurement set."""

    def __init__(
        self,
        robot: Robot,
        measurements: Measurements,
        estimate: Estimate,
        own: FloatArray,
        *,
        one_direction: bool,
    ) -> None:
        self._names, self._kinds, self._labels = robot.joint_names, robot.joint_kinds, measurements.labels
        self._regressor = np.where(estimate.observability.null, 0.0, estimate.regressor)
        self._spectrum = Spectrum(self._regressor)
        self._robot, self._compressed = robot, estimate.compressed
        # Columns of statements follow those of the joints.
        self._unseen = np.zeros(estimate.compressed.columns.shape[1], np.bool_)
        self._unseen[: robot.n] = estimate.observability.null
        self._columns = np.where(self._unseen, 0.0, estimate.compressed.columns)
        self._sigma = estimate.sigma
        self._next_order = np.array([measurements.order.max() + 1.0])  # the advised reading is the next one
        #: (n,) compliances [rad/(N·m)]; zero where there is none
        self._compliance = [joint.compliance or 0.0 for joint in estimate.joints]
        #: (n,) variances due to errors that all readings share, and that no further reading lessens
        self._shared = np.zeros(robot.n)
        if estimate.common is not None:
            self._shared = np.square(estimate.common.responses_to_unfitted_errors).sum(axis=1)
        #: (n,) factors by which short levers widen the uncertainties; a further reading leaves them
        self._widening = np.ones(robot.n)
        self._own, self._strength = own, float(np.linalg.norm(own))
        self._one_direction = one_direction
        # The advice predicts the uncertainties that method partial_pose gives. If the estimate has the same
        # uncertainties, a new run by its method will confirm the advice; otherwise the advice names
        # partial_pose.
        self._same_method = False
        if estimate.covariance is not None and estimate.sigma is not None:
            visible = ~estimate.observability.null
            inverse = Spectrum(self._regressor[:, visible]).inverse
            least = estimate.sigma * np.linalg.norm(inverse, axis=1)
            second_order = np.diagonal(estimate.square_second_order())
            own_variances = np.diagonal(estimate.covariance) - self._shared - second_order
            present = np.divide(second_order, own_variances, out=np.zeros(robot.n), where=own_variances > 0.0)
            self._widening = np.sqrt(1.0 + present)
            deviation = np.sqrt(np.maximum(own_variances[visible], 0.0))
            self._same_method = np.allclose(deviation, least, rtol=0.01, atol=0.0)

    def find_best_candidates(
        self, postures: ReadablePostures, joints: IndexArray, *, all_directions: bool
    ) -> list[Candidate | None]:
        """Find for each joint the candidate that leaves the least uncertainty; None for no candidate.

        Args:
            postures: M postures to choose from.
            joints: indices of the joints.
            all_directions: whether forces in other directions than that of the strongest force are tried.
        """
        if not len(postures):
            return [None] * len(joints)
        forces = self._propose_forces(postures, joints if all_directions else joints[:0])
        total = self._regressor.T @ self._regressor + postures.information(forces)
        deviation = compute_uncertainties(total, total.shape[-1])
        # Forces along an axis of R0, and the first one, along the strongest force of the set, are easy to
        # apply.
        easy = np.abs(forces).max(axis=2) > (1.0 - _COSINE_ROUNDING) * self._strength
        easy[:, 0] = True
        best = list[Candidate | None]()
        for joint in joints.tolist():
            scores = deviation[..., joint] / np.where(easy, EASIER_FACTOR, 1.0)
            m, d = np.unravel_index(int(np.argmin(scores)), scores.shape)
            best.append(self._describe_advice(joint, postures, int(m), forces[m, d]))
        return best

    def _propose_forces(self, postures: ReadablePostures, twisted: IndexArray) -> FloatArray:
        """Propose D forces (M, D, 3) [N] in each posture, all as strong as the strongest force of the set.

        The first has the direction of the strongest force. If `twisted` names joints, others follow: towards
        faces, edges and corners of a cube, and for each of these joints the force that twists the joint most.
        """
        own = self._own / self._strength
        count = len(postures)
        directions = np.broadcast_to(own, (count, 1, 3))
        if len(twisted):
            # A force along the velocity of the load point, when a joint turns, twists this joint most.
            velocity = postures.load_jacobian[:, :, twisted].transpose(0, 2, 1)
            speed = np.linalg.norm(velocity, axis=2, keepdims=True)
            along_velocity = np.where(speed > 0, velocity / np.where(speed > 0, speed, 1.0), own)
            cube = np.broadcast_to(_DIRECTIONS, (count, len(_DIRECTIONS), 3))
            directions = np.concatenate([directions, cube, along_velocity], axis=1)
        # A force and its opposite give the same information: take the one nearer to the strongest force.
        sign = np.where(directions @ own < -_COSINE_ROUNDING, -1.0, 1.0)
        return np.asarray(self._strength * sign[..., None] * directions)

    def _describe_advice(
        self, joint: int, postures: ReadablePostures, m: int, force: FloatArray
    ) -> Candidate | None:
        """Describe the advice to take one candidate as the next reading.

        Returns:
            The joint's standard uncertainty after the reading, in units of sigma, and the fields of `Advice`;
            None if the candidate does not determine the joint.

        Args:
            joint: index of the joint.
            postures: postures to choose from.
            m: index of the candidate's posture.
            force: (3,) force of the candidate [N].
        """
        torque = force @ postures.load_jacobian[m]
        reading = replace(
            postures.readable[m : m + 1],
            force=force[None],
            moment=np.zeros((1, 3)),
            order=self._next_order,
        )
        added = self._compressed.build_columns(Rows(self._robot, reading))
        before = self._spectrum.deviation(joint)
        after = Spectrum(np.vstack([self._columns, added])).deviation(joint)
        if after is None or abs(torque[joint]) <= _LEAST_LEVER * self._strength:
            return None
        units = JOINT_UNITS[self._kinds[joint]]
        name, size, i = self._names[joint], float(np.linalg.norm(force)), int(postures.observation[m])
        if i >= 0:  # a measured posture
            posture = f"in posture {self._labels[i]}"
        else:
            shown = posture_text(postures.joints[m].tolist(), self._kinds)
            posture = f"in posture {shown}, if this posture is free of collisions,"
        load = f"apply the load of {figure(size)} N as before"
        if not (self._one_direction and np.allclose(force, self._own, rtol=1e-9)):
            direction = ", ".join(f"{part / size + 0.0:.2f}" for part in force.tolist())
            load = f"apply {figure(size)} N along ({direction})"
        uncertainty, ratio = None, None if before is None else after / before
        if self._sigma is not None:
            shared, sigma = float(np.sqrt(self._shared[joint])), self._sigma * float(self._widening[joint])
            uncertainty = float(np.hypot(sigma * after, shared))
            ratio = None if before is None else uncertainty / float(np.hypot(sigma * before, shared))
        quantity, changes = self._describe_uncertainty(joint, uncertainty)
        if ratio is not None:
            changes.append(f"{figure(ratio, '.2g')} times its present value")
        # Without known uncertainties the gain is the load of the joint, such as "a torque of 12 N·m about
        # A2".
        gain = f"a {units.load.replace(' ', f' of {abs(torque[joint]):.3g} {units.effort} ', 1)} {name}"
        if changes:
            method = "" if self._same_method else "with method partial_pose "
            gain = f"{method}the uncertainty of {name}'s {quantity} falls to {', '.join(changes)}"
        return after, {
            "joint": name,
            "message": f"{posture} {load}: {gain}",
            "joints": postures.joints[m].tolist(),
            "observation": None if i < 0 else self._labels[i],
            "force": force.tolist(),
            "uncertainty_ratio": ratio,
            "standard_uncertainty": uncertainty,
        }

    def _describe_uncertainty(self, joint: int, uncertainty: float | None) -> tuple[str, list[str]]:
        """Return the quantity, "stiffness" or "compliance", and a list with its uncertainty in words.

        The list is empty if the uncertainty is unknown. The compliance is stated if it is less than its
        uncertainty, because the uncertainty of the stiffness would then mean nothing.

        Args:
            joint: index of the joint.
            uncertainty: standard uncertainty of the joint's compliance [rad/(N·m)]; None if unknown.
        """
        kind, compliance = self._kinds[joint], self._compliance[joint]
        quantity = "stiffness" if compliance > (uncertainty or 0.0) else "compliance"
        if uncertainty is None:
            return quantity, []
        if quantity == "stiffness":
            return quantity, [stiffness_text(uncertainty / compliance / compliance, kind)]
        return quantity, [f"{1e6 * uncertainty:.2g} {JOINT_UNITS[kind].micro_compliance}"]
