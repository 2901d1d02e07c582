"""Request of a plan: equipment, surroundings and rules."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.design.experiment import Equipment
from jointstiff.solver.design.feasibility import Cell
from jointstiff.solver.readings.measurements import Measurements

CriterionName = Literal["relative_a", "work_area", "d", "e", "worst_place"]


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
