"""Approaches and retracts of a program, which carry no force: they are faster than the cut."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from jointstiff.schemas.process import ProcessRequest
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.kinds.program.path import SAME_FEED, Visits, read_feeds
from jointstiff.solver.arrays import BoolArray
from robotprograms import Program

APPROACH: Final = 2.0
"""Ratio to the least feed of a program beyond which a move is an approach or a retract."""


def unload_approaches(program: Program, request: ProcessRequest, visits: Visits) -> tuple[Visits, BoolArray]:
    """Return the visits with approaches and retracts unloaded, and a mask (v,) of these visits.

    Only a load of all moves concerns them: loads by lines, by label, point or length are as stated. An
    approach is a move of the joints, or a line that the program states faster than the feed of the request,
    or than twice its least feed. A target that a cut visits, too, keeps its load.
    """
    load = request.load or request.cut
    is_stated = load is None or load.first_line is not None or load.last_line is not None
    of_joints = program.moves.is_visit_of_joint_move
    none = np.zeros(len(visits.targets), dtype=np.bool_)
    if is_stated or of_joints.all():
        return visits, none
    stated = read_feeds(program)
    known = stated[~of_joints & (stated > 0.0)]
    most = APPROACH * known.min() if len(known) else np.inf
    if request.feed is not None:
        most = SAME_FEED * LENGTH[request.units.length] * request.feed
    cuts = ~of_joints & ~(stated > most)
    if not cuts.any():
        return visits, none
    is_cut = np.zeros(len(visits.order), dtype=np.bool_)
    is_cut[visits.number[cuts]] = True
    loads = replace(visits.loads, of_visit=np.where(is_cut[visits.number], visits.loads.of_visit, 0))
    loaded = visits.loaded[is_cut[visits.loaded] | request.absolute]
    return replace(visits, loads=loads, loaded=loaded), ~is_cut[visits.number]
