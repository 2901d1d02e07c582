"""Feasible readings of a plan, with the information that each adds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.design.candidates import Candidates
from jointstiff.solver.design.experiment import Equipment, Motion, drawn_postures, whitened_rows
from jointstiff.solver.design.feasibility import Cell, Strikes, feasible
from jointstiff.solver.design.parameters import Parameters, parameters_of
from jointstiff.solver.errors import RequestError
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot

CriterionName = Literal["relative_a", "work_area", "d", "e", "worst_place"]


@dataclass(frozen=True, eq=False)
class PlanRequest:
    """Hold what a plan is made for and by which rules."""

    equipment: Equipment  #: instrument, targets and loads
    readings: int  #: how many, those for validation included
    nominal: FloatArray  #: (n,) compliance [rad/(N·m)]; nan where it is not known
    #: (n,) standard uncertainty of the compliance known beforehand [rad/(N·m)]; inf for none
    prior: FloatArray
    cell: Cell = field(default_factory=Cell)  #: surroundings of the robot
    criterion: CriterionName = "relative_a"  #: criterion to minimise
    postures: FloatArray | None = None  #: (N, n) to choose from, controller's angles [rad]; drawn if None
    candidates: int = 5_000  #: how many to draw
    joints: IndexArray | None = None  #: to be determined; all if None
    #: (2, 3) corners of the box in which predictions matter, in R0 [m]; None for none
    work_area: FloatArray | None = None
    #: (D, 3) unit vectors in R0, along one of which each reading is taken; None if all coordinates are read
    directions: FloatArray | None = None
    links: bool = False  #: whether elastic links are a nuisance
    link_share: float = 0.3  #: deflection by links, relative to that by joints, before any reading
    angle: float = float(np.radians(10.0))  #: two postures differ by at least this in a joint [rad]
    validation: float = 0.2  #: share of the readings that are held out
    so_far: Measurements | None = None  #: readings of the campaign at hand; None to begin
    #: rows (N, 3 T, P) of unloaded positions in postures (N, n) [m], joints first, then a nuisance in units
    #: of what is known of it beforehand; None where loads bend the arm
    by_weight: Callable[[FloatArray], FloatArray] | None = None
    seed: int = 0  #: of drawn postures, validation and random plans


_WITH_LINKS: Final = 600
"""Candidates where elastic links or the geometry are a nuisance, those in the work area first: each costs
fifty times as much."""
_PLACES: Final = 60
"""Postures in the work area at which predictions are judged."""
_FEWEST_PLACES: Final = 3
_BLOCK: Final = 2_048
"""Candidates whose rows are computed at a time."""
_SAMPLED: Final = 500
"""Candidates from whose rows the parameters are chosen."""


@dataclass(frozen=True, eq=False)
class Pool:
    """Feasible readings: posture, anchor and strength of each, with their information in absolute units."""

    joints: FloatArray
    anchor: IndexArray
    strength: FloatArray
    candidates: Candidates
    parameters: Parameters
    base: FloatArray
    strikes: Strikes
    equipment: Equipment
    #: (R, p, p) AᵀA of the deflection at places of the work area [m²], mean over axes; None without one
    places: FloatArray | None
    feasible: int  #: number of feasible readings, of which the candidates may be a selection
    along: FloatArray | None  #: direction along which each is read; None if all coordinates are

    @classmethod
    def of(cls, robot: Robot, request: PlanRequest) -> Pool:
        """Draw or take postures, strike out what is not feasible, and compute what each reading adds.

        Raises:
            RequestError: no reading is feasible, or nothing excites a joint.
        """
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
        if not kept.any():
            counts = ", ".join(f"{name} {count}" for name, count in strikes.reasons.items())
            raise RequestError(
                f"none of {strikes.considered} readings is feasible: {counts}",
                where="candidates",
                remedy="relax the condition that excludes most of them, or give other postures or loads",
            )
        total, inside = int(kept.sum()), _inside(robot, request, joints, kept)
        if request.links or request.by_weight is not None:
            kept = _thinned(kept, inside, _WITH_LINKS)
            inside &= kept
        predicted = _predicted(robot, request, joints[inside])
        joints, anchor = joints[kept], anchor[kept] if loads.kind == "cable" else np.full(kept.sum(), -1)
        strength = equipment.strength(robot, joints) if free else np.full(len(joints), loads.force)
        directions = np.eye(3)[:, None] if free else direction[kept][None]  # type: ignore[index]
        forces = [np.broadcast_to(strength[:, None] * each, (len(joints), 3)) for each in directions]
        along = None
        if request.directions is not None:
            count, times = len(joints), len(request.directions)
            along = np.tile(request.directions, (count, 1))
            joints, anchor, strength, *forces = (
                np.repeat(each, times, axis=0) for each in (joints, anchor, strength, *forces)
            )
        sample = np.linspace(0, len(joints) - 1, min(len(joints), _SAMPLED)).astype(np.intp)
        some = _rows(robot, request, joints, forces, along, sample)
        if request.so_far is not None:
            some.append(_read(robot, request, request.so_far))
        seen = np.concatenate([rows.reshape(-1, some[0].shape[-1]) for rows in some]) / equipment.sigma
        parameters = parameters_of(
            seen,
            seen if predicted is None else predicted.reshape(-1, seen.shape[1]),
            robot.joint_names,
            request.joints,
            request.nominal,
            request.link_share if request.by_weight is None else None,
        )
        candidates = _candidates(robot, request, joints, forces, along, parameters)
        base = parameters.prior + _known(robot, request, parameters)
        places = None
        if predicted is not None:
            A = parameters.rows(predicted)
            places = A.transpose(0, 2, 1) @ A / 3.0
        return cls(
            joints, anchor, strength, candidates, parameters, base, strikes, equipment, places, total, along
        )

    def force(self, robot: Robot, unit: FloatArray, index: IndexArray) -> FloatArray:
        """Return the forces (k, 3) [N] of candidates, along unit vectors where their direction is free."""
        if not self.candidates.free:
            unit = np.array(
                [self.equipment.direction(robot, self.joints[[i]], self.anchor[i])[0] for i in index]
            )
        force: FloatArray = self.strength[index, None] * unit
        return force


def _candidates(
    robot: Robot,
    request: PlanRequest,
    joints: FloatArray,
    forces: list[FloatArray],
    along: FloatArray | None,
    parameters: Parameters,
) -> Candidates:
    """Return the information of all readings, block by block, in units of 1/variance."""
    parts = []
    for start in range(0, len(joints), _BLOCK):
        rows = _rows(robot, request, joints, forces, along, slice(start, start + _BLOCK))
        parts.append(np.stack([parameters.rows(each) for each in rows], axis=1) / request.equipment.sigma)
    stack = np.concatenate(parts)
    return Candidates.from_rows(stack if len(forces) > 1 else stack[:, 0])


def _rows(
    robot: Robot,
    request: PlanRequest,
    joints: FloatArray,
    forces: list[FloatArray],
    along: FloatArray | None,
    part: slice | IndexArray,
) -> list[FloatArray]:
    """Return the rows (k, 3 T, P) of a part of N readings under each of some loads, in units of sigma."""
    joints, forces = joints[part], [F[part] for F in forces]
    equipment = request.equipment
    if request.by_weight is not None:
        return [request.by_weight(joints)]
    if along is not None:
        equipment = replace(equipment, along=along[part, None])
    if not request.links:
        motion = Motion.of(robot, equipment, joints)
        return [motion.rows(F) for F in forces]
    return [whitened_rows(robot, equipment.measurements(robot, joints, F), links=True) for F in forces]


def _read(robot: Robot, request: PlanRequest, so_far: Measurements) -> FloatArray:
    """Return the rows of readings that were taken."""
    if request.by_weight is not None:
        rows = request.by_weight(so_far.joints)
        taken = so_far.present & ~so_far.in_flange
        return rows * np.repeat(taken, 3, axis=1)[..., None]
    return whitened_rows(robot, so_far, links=request.links)


def _known(robot: Robot, request: PlanRequest, parameters: Parameters) -> FloatArray:
    """Return the information of the readings so far, and of priors on the joints (p, p)."""
    p = parameters.basis.shape[1]
    known = np.zeros((p, p))
    if request.so_far is not None:
        sigma = request.so_far.sigma or request.equipment.sigma
        rows = (parameters.rows(_read(robot, request, request.so_far)) / sigma).reshape(-1, p)
        known += rows.T @ rows
    s = parameters.interest
    relative = request.prior[parameters.joints] / parameters.nominal[parameters.joints]
    known[np.arange(s), np.arange(s)] += 1.0 / np.square(relative)
    return known


def _inside(robot: Robot, request: PlanRequest, joints: FloatArray, kept: BoolArray) -> BoolArray:
    """Return which candidates that are kept have their load point in the work area; none without one."""
    if request.work_area is None:
        return np.zeros(len(kept), dtype=np.bool_)
    at = request.equipment.load_place(robot, joints)
    inside = kept & ((at >= request.work_area[0]) & (at <= request.work_area[1])).all(axis=1)
    if inside.sum() < _FEWEST_PLACES:
        raise RequestError(
            f"{inside.sum()} of {kept.sum()} candidates have their load point in the work area",
            where="work_area",
            remedy="give a larger work area, in R0 and in metres, or more candidates",
        )
    return np.asarray(inside)


def _predicted(robot: Robot, request: PlanRequest, inside: FloatArray) -> FloatArray | None:
    """Return rows (R, 9, P) of the deflection at places of the work area, by forces along the axes of R0 [m].

    Args:
        robot: n joints.
        request: with the load.
        inside: postures of candidates in the work area; none without one.
    """
    if not len(inside):
        return None
    joints, point = inside[:: max(1, len(inside) // _PLACES)][:_PLACES], request.equipment.load_point
    equipment = Equipment(point[None], point, request.equipment.loads, 1.0)
    forces = [np.broadcast_to(request.equipment.loads.force * axis, (len(joints), 3)) for axis in np.eye(3)]
    rows = [
        whitened_rows(robot, equipment.measurements(robot, joints, force), links=request.links)
        for force in forces
    ]
    # Whitened as a difference of two readings of sigma 1.
    return np.asarray(np.sqrt(2.0) * np.concatenate(rows, axis=1))


def _thinned(kept: BoolArray, first: BoolArray, count: int) -> BoolArray:
    """Return the mask with at most so many, some of them first, and evenly spread."""
    thinned = np.zeros(len(kept), dtype=np.bool_)
    for index in (np.flatnonzero(kept & first), np.flatnonzero(kept & ~first)):
        room = count - int(thinned.sum())
        if room > 0:
            thinned[index[:: max(1, -(-len(index) // room))]] = True
    return thinned
