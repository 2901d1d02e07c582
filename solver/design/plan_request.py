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
    """Hold what a plan is made for and by which rules."""

    equipment: Equipment  #: instrument, targets and loads
    readings: int  #: how many, those for validation included
    nominal: FloatArray  #: (n,) compliance [rad/(N·m)]; nan where it is not known
    #: (n,) standard uncertainty of the compliance known beforehand [rad/(N·m)]; inf for none
    prior: FloatArray
    cell: Cell = field(default_factory=Cell)  #: surroundings of the robot
    criterion: CriterionName = "relative_a"  #: what to make least
    postures: FloatArray | None = None  #: (N, n) to choose from, controller's angles [rad]; drawn if None
    candidates: int = 5_000  #: how many to draw
    joints: IndexArray | None = None  #: to be determined; all if None
    #: (2, 3) corners of the box in which predictions matter, in R0 [m]; None for none
    work_area: FloatArray | None = None
    links: bool = False  #: whether elastic links are a nuisance
    link_share: float = 0.3  #: deflection by links, relative to that by joints, before any reading
    angle: float = float(np.radians(10.0))  #: two postures differ by at least this in a joint [rad]
    validation: float = 0.2  #: share of the readings that are held out
    so_far: Measurements | None = None  #: readings of the campaign at hand; None to begin
    seed: int = 0  #: of drawn postures, validation and random plans
