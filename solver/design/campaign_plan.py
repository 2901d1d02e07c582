"""Plan of a campaign: from equipment and surroundings to an ordered list of readings with its certificate.

postures → feasible readings → rows → optimal weights → list → validation → order → beside other plans
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.design.candidates import Atoms
from jointstiff.solver.design.criteria import (
    AOptimality,
    Criterion,
    DOptimality,
    EOptimality,
    GOptimality,
    SmoothCriterion,
)
from jointstiff.solver.design.exact import exact_design
from jointstiff.solver.design.feasibility import Strikes
from jointstiff.solver.design.optimum import optimise
from jointstiff.solver.design.other_plans import (
    OtherPlan,
    drawn_directions,
    one_at_a_time,
    random_plans,
    uncertainty_of,
)
from jointstiff.solver.design.parameters import Parameters
from jointstiff.solver.design.pool import PlanRequest, Pool
from jointstiff.solver.design.problem import DesignProblem, Distinct, list_efficiency
from jointstiff.solver.errors import RequestError
from jointstiff.solver.robot.model import Robot


def ordered(joints: FloatArray, group: IndexArray) -> IndexArray:
    """Order readings group by group, each by the nearest next posture, improved by reversing parts.

    Args:
        joints: (n, q) [rad].
        group: (n,) of equal loads.

    Returns:
        (n,) order. Travel is the greatest change of a joint's angle from one posture to the next.
    """
    order: list[int] = []
    for each in np.unique(group):
        members = np.flatnonzero(group == each)
        start = joints[order[-1]] if order else np.zeros(joints.shape[1])
        places = np.vstack([start, joints[members]])
        distance = np.abs(places[:, None] - places).max(axis=2)
        left, path = set(range(1, len(places))), [0]
        while left:
            path.append(min(left, key=lambda i: distance[path[-1], i]))
            left.remove(path[-1])
        improved = True
        while improved:
            improved = False
            for i in range(1, len(path) - 1):
                for j in range(i + 1, len(path)):
                    before = distance[path[i - 1], path[i]]
                    after = distance[path[i - 1], path[j]]
                    if j + 1 < len(path):
                        before += distance[path[j], path[j + 1]]
                        after += distance[path[i], path[j + 1]]
                    if after < before - 1e-9:
                        path[i : j + 1] = path[i : j + 1][::-1]
                        improved = True
        order += [int(members[i - 1]) for i in path[1:]]
    return np.array(order, dtype=np.intp)


def travel(joints: FloatArray) -> float:
    """Return the sum of the greatest joint moves from one posture to the next [rad]."""
    return float(np.abs(np.diff(joints, axis=0)).max(axis=1).sum())


_LINKS_GAP, _OTHERS_GAP = 1e-2, 1e-4
"""Gaps at which the search ends where elastic links are a nuisance, and for criteria not asked for."""
_WORST_PLACES: Final = 12
"""The same for the criterion of the worst place, whose program has a cone for each."""


@dataclass(frozen=True, eq=False)
class CampaignPlan:
    """An ordered list of readings."""

    joints: FloatArray  #: (n, q) controller's angles [rad], in the order in which to take them
    force: FloatArray  #: (n, 3) on the robot, axes of R0 [N]
    anchor: IndexArray  #: (n,) anchor of the cable; -1 without one
    along: FloatArray | None  #: (n, 3) unit vectors in R0 along which to read; None if all coordinates are
    validation: BoolArray  #: (n,) which readings are held out from the fit
    efficiency: float  #: least share of the greatest φ of all lists that obey the same rules
    weights_gap: float  #: 1 − efficiency of the optimal weights that lead to the list
    efficiencies: Mapping[str, float]  #: least efficiency of the list by each criterion that applies
    parameters: Parameters  #: parameters to determine
    uncertainty: FloatArray  #: (s,) standard uncertainty of each joint's relative compliance after the list
    before: FloatArray  #: (s,) the same before it; inf where it is not determined
    #: standard uncertainty of the predicted deflection in the work area under the load [m]: root mean
    #: square and greatest; None without a work area
    deflection: tuple[float, float] | None
    random: OtherPlan  #: mean of random plans
    one_at_a_time: OtherPlan  #: each reading the best next one
    feasible: int  #: how many candidates there are
    strikes: Strikes  #: infeasible readings by reason


def plan_campaign(robot: Robot, request: PlanRequest) -> CampaignPlan:
    """Plan a campaign.

    Raises:
        RequestError: no reading is feasible, nothing excites a joint, there are too few readings or distinct
            postures.
    """
    pool = Pool.of(robot, request)
    held_out = round(request.validation * request.readings)
    fitted = request.readings - held_out
    rows = (3 if request.directions is None else 1) * len(request.equipment.targets) * fitted
    if fitted < 1 or (request.so_far is None and rows < pool.parameters.interest):
        raise RequestError(
            f"{fitted} readings without those held out do not determine {pool.parameters.interest} joints",
            where="readings",
            remedy="ask for more readings, or a smaller share for validation",
        )
    criteria = _criteria(request, pool)
    problem = DesignProblem(pool.candidates, criteria[request.criterion], fitted, pool.base)
    distinct = Distinct(pool.joints, request.angle)
    design = optimise(problem, _LINKS_GAP if request.links else None)
    exact = exact_design(problem, design, distinct, seed=request.seed)
    validation = _validation(pool, distinct, exact.atoms.index, held_out, request.seed)
    index = np.concatenate([exact.atoms.index, validation.index])
    force = pool.force(robot, np.concatenate([exact.atoms.force, validation.force]), index)
    order = ordered(pool.joints[index], pool.anchor[index])
    index = index[order]
    s = pool.parameters.interest
    # Least efficiency of a list by the criterion that was asked for, and by the smooth ones
    gap = _LINKS_GAP if request.links else _OTHERS_GAP
    found = {}
    for name, criterion in criteria.items():
        if criterion is not problem.criterion and not isinstance(criterion, SmoothCriterion):
            continue
        other = DesignProblem(problem.candidates, criterion, problem.readings, problem.base)
        best = design if criterion is problem.criterion else optimise(other, gap)
        found[name] = list_efficiency(other, distinct, exact.matrix, best.matrix, best.bound)
    return CampaignPlan(
        joints=pool.joints[index],
        force=force[order],
        anchor=pool.anchor[index],
        along=None if pool.along is None else pool.along[index],
        validation=order >= fitted,
        efficiency=exact.efficiency,
        weights_gap=1.0 - design.bound.efficiency,
        efficiencies=found,
        parameters=pool.parameters,
        uncertainty=uncertainty_of(exact.matrix, s),
        before=uncertainty_of(pool.base, s),
        deflection=_deflection(criteria, exact.matrix),
        random=random_plans(problem, exact.matrix, s, request.seed),
        one_at_a_time=one_at_a_time(problem, distinct, exact.matrix, s),
        feasible=pool.feasible,
        strikes=pool.strikes,
    )


def _criteria(request: PlanRequest, pool: Pool) -> dict[str, Criterion]:
    """Return the criteria that apply, by name."""
    s, p = pool.parameters.interest, pool.parameters.basis.shape[1]
    relative = np.diag(np.r_[np.ones(s), np.zeros(p - s)]) / s
    criteria: dict[str, Criterion] = {
        "relative_a": AOptimality(relative),
        "d": DOptimality(s),
        "e": EOptimality(np.ones(s)),
    }
    places = pool.places
    if places is not None:
        few = places[:: -(-len(places) // _WORST_PLACES)]
        criteria |= {"work_area": AOptimality(places.mean(axis=0)), "worst_place": GOptimality(few)}
    if request.criterion not in criteria:
        raise RequestError(
            f"criterion {request.criterion} needs a work area",
            where="work_area",
            remedy="give the corners of the work area, or use criterion relative_a, d or e",
        )
    return criteria


def _deflection(criteria: Mapping[str, Criterion], M: FloatArray) -> tuple[float, float] | None:
    worst = criteria.get("worst_place")
    if not isinstance(worst, GOptimality):
        return None
    mean = criteria["work_area"].information(M)
    variances = worst.variances(M)
    return float(mean**-0.5), float(np.sqrt(variances.max()))


def _validation(pool: Pool, distinct: Distinct, chosen: IndexArray, count: int, seed: int) -> Atoms:
    """Draw readings at random that are distinct from those chosen, and under loads drawn at random."""
    random = np.random.default_rng([seed, 1])
    free = np.ones(len(pool.candidates), dtype=np.bool_)
    for i in chosen:
        free &= ~distinct.near(pool.joints[i], slice(None))
    validation: list[int] = []
    for i in random.permutation(len(free)):
        if len(validation) == count:
            break
        if free[i]:
            validation.append(int(i))
            free &= ~distinct.near(pool.joints[i], slice(None))
    if len(validation) < count:
        raise RequestError(
            f"{len(validation)} of {count} readings for validation are in postures distinct from the others",
            where="distinct_angle",
            remedy="ask for fewer readings, a smaller angle, or more candidates",
        )
    return pool.candidates.under(np.array(validation, dtype=np.intp), drawn_directions(random, count))
