"""Plan of a campaign: from equipment and surroundings to an ordered list of readings with its certificate.

postures → feasible readings → rows → optimal weights → list → validation → order → beside other plans
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.design.candidates import Atoms, Candidates, PackedCandidates
from jointstiff.solver.design.certificate import list_efficiency
from jointstiff.solver.design.criteria import (
    AOptimality,
    Criterion,
    DOptimality,
    EOptimality,
    GOptimality,
    SmoothCriterion,
)
from jointstiff.solver.design.distinct import Distinct
from jointstiff.solver.design.exact import exact_design
from jointstiff.solver.design.experiment import Equipment, drawn_postures, whitened_rows
from jointstiff.solver.design.feasibility import Cell, Strikes, feasible
from jointstiff.solver.design.optimum import Design, optimise
from jointstiff.solver.design.ordering import ordered
from jointstiff.solver.design.parameters import Parameters, parameters_of
from jointstiff.solver.design.problem import DesignProblem
from jointstiff.solver.errors import RequestError
from jointstiff.solver.readings import Measurements
from jointstiff.solver.robot import Robot

CriterionName = Literal["relative_a", "work_area", "d", "e", "worst_place"]

_RANDOM_PLANS: Final = 20
_PLACES: Final = 60
"""Postures in the work area at which predictions are judged."""
_WORST_PLACES: Final = 12
"""The same for the criterion of the worst place, whose program has a cone for each."""
_FEWEST_PLACES: Final = 3
_WITH_LINKS: Final = 800
"""Candidates where elastic links are a nuisance: each costs fifteen times as much."""
_SAMPLED: Final = 500
"""Candidates from whose rows the parameters are chosen."""


@dataclass(frozen=True, eq=False)
class PlanRequest:
    """Hold what a plan is made for and by which rules.

    Attributes:
        equipment: instrument, targets and loads.
        cell: surroundings of the robot.
        readings: how many, those for validation included.
        criterion: what to make least.
        postures: (N, n) to choose from, controller's angles [rad]; drawn if None.
        candidates: how many to draw.
        joints: to be determined; all if None.
        nominal: (n,) compliance [rad/(N·m)]; nan where it is not known.
        work_area: (2, 3) corners of the box in which predictions matter, in R0 [m]; None for none.
        links: whether elastic links are a nuisance.
        link_share: deflection by links, relative to that by joints.
        angle: two postures differ by at least this in a joint [rad].
        validation: share of the readings that are held out.
        so_far: readings of the campaign at hand; None to begin.
        prior: (n,) standard uncertainty of the compliance known beforehand [rad/(N·m)]; inf for none.
        seed: of drawn postures, validation and random plans.
    """

    equipment: Equipment
    readings: int
    nominal: FloatArray
    prior: FloatArray
    cell: Cell = field(default_factory=Cell)
    criterion: CriterionName = "relative_a"
    postures: FloatArray | None = None
    candidates: int = 5_000
    joints: IndexArray | None = None
    work_area: FloatArray | None = None
    links: bool = False
    link_share: float = 0.2
    angle: float = float(np.radians(10.0))
    validation: float = 0.2
    so_far: Measurements | None = None
    seed: int = 0


@dataclass(frozen=True, eq=False)
class OtherPlan:
    """A plan of as many readings made in another way.

    Attributes:
        efficiency: φ relative to the plan's.
        uncertainty: (s,) standard uncertainty of each joint's relative compliance.
    """

    efficiency: float
    uncertainty: FloatArray


@dataclass(frozen=True, eq=False)
class CampaignPlan:
    """An ordered list of readings.

    Attributes:
        joints: (n, q) controller's angles [rad], in the order in which to take them.
        force: (n, 3) on the robot, axes of R0 [N].
        anchor: (n,) of the cable; -1 without one.
        validation: (n,) which readings are held out from the fit.
        efficiency: least share of the greatest φ of all lists that obey the same rules.
        weights_gap: 1 − efficiency of the optimal weights that lead to the list.
        efficiencies: least efficiency of the list by each criterion that applies.
        parameters: what is determined.
        uncertainty: (s,) standard uncertainty of each joint's relative compliance after the list.
        before: (s,) the same before it; inf where it is not determined.
        deflection: standard uncertainty of the predicted deflection in the work area under the load [m]: root
            mean square and greatest; None without a work area.
        random: mean of random plans.
        one_at_a_time: each reading the best next one.
        feasible: how many candidates there are.
        strikes: what was struck out, and why.
    """

    joints: FloatArray
    force: FloatArray
    anchor: IndexArray
    validation: BoolArray
    efficiency: float
    weights_gap: float
    efficiencies: Mapping[str, float]
    parameters: Parameters
    uncertainty: FloatArray
    before: FloatArray
    deflection: tuple[float, float] | None
    random: OtherPlan
    one_at_a_time: OtherPlan
    feasible: int
    strikes: Strikes


def plan_campaign(robot: Robot, request: PlanRequest) -> CampaignPlan:
    """Plan a campaign.

    Args:
        robot: n joints.
        request: what to plan.

    Returns:
        The plan with its certificate.

    Raises:
        RequestError: no reading is feasible, nothing excites a joint, there are too few readings or distinct
            postures.
    """
    pool = _Pool.of(robot, request)
    held_out = round(request.validation * request.readings)
    fitted = request.readings - held_out
    _refuse_too_few(request, fitted, pool.parameters)
    criteria = _criteria(robot, request, pool)
    problem = DesignProblem(pool.candidates, criteria[request.criterion], fitted, pool.base)
    distinct = Distinct(pool.joints, request.angle)
    design = optimise(problem)
    exact = exact_design(problem, design, distinct, seed=request.seed)
    validation = _validation(pool, distinct, exact.atoms.index, held_out, request.seed)
    index = np.concatenate([exact.atoms.index, validation.index])
    force = pool.force(robot, np.concatenate([exact.atoms.force, validation.force]), index)
    order = ordered(pool.joints[index], pool.anchor[index])
    index = index[order]
    s = pool.parameters.interest
    return CampaignPlan(
        joints=pool.joints[index],
        force=force[order],
        anchor=pool.anchor[index],
        validation=order >= fitted,
        efficiency=exact.efficiency,
        weights_gap=1.0 - design.bound.efficiency,
        efficiencies=_efficiencies(criteria, problem, distinct, exact.matrix, design),
        parameters=pool.parameters,
        uncertainty=_uncertainty(exact.matrix, s),
        before=_uncertainty(pool.base, s),
        deflection=_deflection(criteria, exact.matrix),
        random=_random_plans(problem, exact.matrix, s, request.seed),
        one_at_a_time=_one_at_a_time(problem, distinct, exact.matrix, s),
        feasible=len(pool.candidates),
        strikes=pool.strikes,
    )


@dataclass(frozen=True, eq=False)
class _Pool:
    """Feasible readings: posture, anchor and strength of each, with their information in absolute units."""

    joints: FloatArray
    anchor: IndexArray
    strength: FloatArray
    candidates: Candidates
    parameters: Parameters
    base: FloatArray
    strikes: Strikes
    equipment: Equipment

    @classmethod
    def of(cls, robot: Robot, request: PlanRequest) -> _Pool:
        equipment, loads = request.equipment, request.equipment.loads
        postures = request.postures
        if postures is None:
            postures = drawn_postures(robot, request.candidates, request.seed)
        free = loads.kind == "any_direction"
        joints = np.repeat(postures, loads.choices, axis=0)
        anchor = np.tile(np.arange(loads.choices), len(postures))
        direction = None
        if not free:
            direction = np.concatenate(
                [equipment.direction(robot, joints[a :: loads.choices], a) for a in range(loads.choices)]
            )
            direction = direction.reshape(loads.choices, -1, 3).transpose(1, 0, 2).reshape(-1, 3)
        kept, strikes = feasible(robot, equipment, request.cell, joints, direction)
        _refuse_none(kept, strikes)
        if request.links:
            kept = _thinned(kept, _WITH_LINKS)
        joints, anchor = joints[kept], anchor[kept] if loads.kind == "cable" else np.full(kept.sum(), -1)
        strength = equipment.strength(robot, joints) if free else np.full(len(joints), loads.force)
        directions = np.eye(3)[:, None] if free else direction[kept][None]  # type: ignore[index]
        forces = [np.broadcast_to(strength[:, None] * each, (len(joints), 3)) for each in directions]
        sample = slice(None, None, max(1, len(joints) // _SAMPLED))
        some = [
            whitened_rows(
                robot, equipment.measurements(robot, joints[sample], F[sample]), links=request.links
            )
            for F in forces
        ]
        if request.so_far is not None:
            some.append(whitened_rows(robot, request.so_far, links=request.links))
        parameters = parameters_of(
            np.concatenate([rows.reshape(-1, some[0].shape[-1]) for rows in some]) / equipment.sigma,
            robot.joint_names,
            request.joints,
            request.nominal,
            request.link_share,
        )
        candidates = _candidates(robot, request, joints, forces, parameters)
        base = parameters.prior + _known(robot, request, parameters)
        return cls(joints, anchor, strength, candidates, parameters, base, strikes, equipment)

    def force(self, robot: Robot, unit: FloatArray, index: IndexArray) -> FloatArray:
        """Return the forces (k, 3) [N] of candidates, along unit vectors where their direction is free."""
        if not self.candidates.free:
            unit = np.array(
                [self.equipment.direction(robot, self.joints[[i]], self.anchor[i])[0] for i in index]
            )
        force: FloatArray = self.strength[index, None] * unit
        return force


def _candidates(
    robot: Robot, request: PlanRequest, joints: FloatArray, forces: list[FloatArray], parameters: Parameters
) -> Candidates:
    """Return the information of all readings, block by block, in units of 1/variance."""
    equipment, parts = request.equipment, []
    for start in range(0, len(joints), 2048):
        part = slice(start, start + 2048)
        rows = [
            parameters.rows(
                whitened_rows(
                    robot, equipment.measurements(robot, joints[part], F[part]), links=request.links
                )
            )
            / equipment.sigma
            for F in forces
        ]
        parts.append(np.stack(rows, axis=1))
    stack = np.concatenate(parts)
    return PackedCandidates.from_rows(stack if len(forces) > 1 else stack[:, 0])


def _known(robot: Robot, request: PlanRequest, parameters: Parameters) -> FloatArray:
    """Return the information of the readings so far, and of priors on the joints (p, p)."""
    p = parameters.basis.shape[1]
    known = np.zeros((p, p))
    if request.so_far is not None:
        sigma = request.so_far.sigma or request.equipment.sigma
        rows = parameters.rows(whitened_rows(robot, request.so_far, links=request.links)) / sigma
        rows = rows.reshape(-1, p)
        known += rows.T @ rows
    s = parameters.interest
    relative = request.prior[parameters.joints] / parameters.nominal[parameters.joints]
    known[np.arange(s), np.arange(s)] += 1.0 / np.square(relative)
    return known


def _criteria(robot: Robot, request: PlanRequest, pool: _Pool) -> dict[str, Criterion]:
    """Return the criteria that apply, by name."""
    s, p = pool.parameters.interest, pool.parameters.basis.shape[1]
    relative = np.diag(np.r_[np.ones(s), np.zeros(p - s)]) / s
    criteria: dict[str, Criterion] = {
        "relative_a": AOptimality(relative),
        "d": DOptimality(s),
        "e": EOptimality(np.ones(s)),
    }
    places = _places(robot, request, pool)
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


def _places(robot: Robot, request: PlanRequest, pool: _Pool) -> FloatArray | None:
    """Return AᵀA of the predicted deflection at places of the work area, mean over the force's axes [m²]."""
    if request.work_area is None:
        return None
    at = request.equipment.load_place(robot, pool.joints)
    inside = np.flatnonzero(((at >= request.work_area[0]) & (at <= request.work_area[1])).all(axis=1))
    if len(inside) < _FEWEST_PLACES:
        raise RequestError(
            f"{len(inside)} of {len(at)} candidates have their load point in the work area",
            where="work_area",
            remedy="give a larger work area, in R0 and in metres, or more candidates",
        )
    joints = pool.joints[inside[:: max(1, len(inside) // _PLACES)][:_PLACES]]
    point = Equipment(
        request.equipment.load_point[None], request.equipment.load_point, request.equipment.loads, 1.0
    )
    total = np.zeros((len(joints), pool.candidates.parameters, pool.candidates.parameters))
    for axis in np.eye(3):
        force = np.broadcast_to(request.equipment.loads.force * axis, (len(joints), 3))
        rows = whitened_rows(robot, point.measurements(robot, joints, force), links=request.links)
        A = np.sqrt(2.0) * pool.parameters.rows(rows)  # whitened as a difference of two readings of sigma 1
        total += A.transpose(0, 2, 1) @ A / 3.0
    return total


def _uncertainty(M: FloatArray, s: int) -> FloatArray:
    """Return the standard uncertainties of the first parameters (s,); inf where M does not determine them."""
    unit = 1.0 / np.sqrt(np.where(np.diagonal(M) > 0.0, np.diagonal(M), 1.0))
    values, vectors = np.linalg.eigh(M * np.outer(unit, unit))
    null = values <= 1e-12 * max(values[-1], 1e-300)
    free = np.square(vectors[:s, null]).sum(axis=1) > 1e-9
    variance = np.square(vectors[:s, ~null]) @ (1.0 / values[~null])
    return np.where(free, np.inf, unit[:s] * np.sqrt(variance))


def _deflection(criteria: Mapping[str, Criterion], M: FloatArray) -> tuple[float, float] | None:
    worst = criteria.get("worst_place")
    if not isinstance(worst, GOptimality):
        return None
    mean = criteria["work_area"].information(M)
    variances = worst.variances(M)
    return float(mean**-0.5), float(np.sqrt(variances.max()))


def _efficiencies(
    criteria: Mapping[str, Criterion],
    problem: DesignProblem,
    distinct: Distinct,
    M: FloatArray,
    design: Design,
) -> dict[str, float]:
    """Return the least efficiency of a list by the criterion that was asked for, and by the smooth ones."""
    found = {}
    for name, criterion in criteria.items():
        if criterion is not problem.criterion and not isinstance(criterion, SmoothCriterion):
            continue
        other = DesignProblem(problem.candidates, criterion, problem.readings, problem.base)
        best = design if criterion is problem.criterion else optimise(other, 1e-4)
        found[name] = list_efficiency(other, distinct, M, best.matrix, best.bound)
    return found


def _validation(pool: _Pool, distinct: Distinct, chosen: IndexArray, count: int, seed: int) -> Atoms:
    """Draw readings at random that are distinct from those chosen, and under loads drawn at random."""
    random = np.random.default_rng([seed, 1])
    free = np.ones(len(pool.candidates), dtype=np.bool_)
    for i in chosen:
        free &= ~distinct.near(pool.joints[i], slice(None))
    found: list[int] = []
    for i in random.permutation(len(free)):
        if len(found) == count:
            break
        if free[i]:
            found.append(int(i))
            free &= ~distinct.near(pool.joints[i], slice(None))
    if len(found) < count:
        raise RequestError(
            f"{len(found)} of {count} readings for validation are in postures distinct from the others",
            where="distinct_angle",
            remedy="ask for fewer readings, a smaller angle, or more candidates",
        )
    return pool.candidates.under(np.array(found, dtype=np.intp), _directions(random, count))


def _random_plans(problem: DesignProblem, M: FloatArray, s: int, seed: int) -> OtherPlan:
    """Return the mean of random plans of the same candidates."""
    random = np.random.default_rng([seed, 2])
    n, values, variances = problem.readings, [], []
    for _ in range(_RANDOM_PLANS):
        index = random.integers(0, len(problem.candidates), n)
        other = problem.base + problem.candidates.under(index, _directions(random, n)).information.sum(axis=0)
        values.append(problem.criterion.information(other))
        variances.append(np.square(_uncertainty(other, s)))
    efficiency = float(np.mean(values)) / problem.criterion.information(M)
    return OtherPlan(efficiency, np.sqrt(np.mean(variances, axis=0)))


def _one_at_a_time(problem: DesignProblem, distinct: Distinct, M: FloatArray, s: int) -> OtherPlan:
    """Return the plan in which each reading is the best next one by its price."""
    other = problem.base.copy()
    share = 1e-6 * (M - problem.base)
    free = np.ones(len(problem.candidates), dtype=np.bool_)
    for _ in range(problem.readings):
        G = problem.criterion.support(other + share)
        best = np.array([int(np.argmax(np.where(free, problem.candidates.prices(G), -np.inf)))])
        other = other + problem.candidates.atoms(best, G).information[0]
        free &= ~distinct.near(distinct.postures[best[0]], slice(None))
    efficiency = problem.criterion.information(other) / problem.criterion.information(M)
    return OtherPlan(efficiency, _uncertainty(other, s))


def _directions(random: np.random.Generator, count: int) -> FloatArray:
    """Draw unit vectors (count, 3)."""
    draws = random.standard_normal((count, 3))
    unit: FloatArray = draws / np.linalg.norm(draws, axis=1, keepdims=True)
    return unit


def _thinned(kept: BoolArray, count: int) -> BoolArray:
    """Return the mask with at most so many, evenly spread."""
    index = np.flatnonzero(kept)
    thinned = np.zeros(len(kept), dtype=np.bool_)
    thinned[index[:: max(1, -(-len(index) // count))]] = True
    return thinned


def _refuse_none(kept: BoolArray, strikes: Strikes) -> None:
    if not kept.any():
        counts = ", ".join(f"{name} {count}" for name, count in strikes.reasons.items())
        raise RequestError(
            f"none of {strikes.considered} readings is feasible: {counts}",
            where="candidates",
            remedy="loosen what strikes most of them out, or give other postures or loads",
        )


def _refuse_too_few(request: PlanRequest, fitted: int, parameters: Parameters) -> None:
    rows = 3 * len(request.equipment.targets) * fitted
    if fitted < 1 or (request.so_far is None and rows < parameters.interest):
        raise RequestError(
            f"{fitted} readings without those held out do not determine {parameters.interest} joints",
            where="readings",
            remedy="ask for more readings, or a smaller share for validation",
        )
