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
    none = np.zeros(len(visits.targets), dtype=np.bool_)
    if _states_loaded_lines(request):
        return visits, none
    is_cut = _find_cuts(program, request)
    if not is_cut.any():
        return visits, none
    is_cut_target = np.zeros(len(visits.order), dtype=np.bool_)
    is_cut_target[visits.number[is_cut]] = True
    keeps_load = is_cut_target[visits.number]  # (v,)
    loads = replace(visits.loads, of_visit=np.where(keeps_load, visits.loads.of_visit, 0))
    loaded = visits.loaded[is_cut_target[visits.loaded] | request.absolute]
    return replace(visits, loads=loads, loaded=loaded), ~keeps_load


def _states_loaded_lines(request: ProcessRequest) -> bool:
    """Return whether the request states itself which lines of the program are loaded."""
    load = request.load or request.cut
    return load is None or load.first_line is not None or load.last_line is not None


def _find_cuts(program: Program, request: ProcessRequest) -> BoolArray:
    """Return a mask (v,) of the visits that are cuts: lines and arcs that are not faster than a cut may be.

    The greatest feed of a cut is the feed of the request, or else twice the least feed of the program. A line
    without a known feed counts as a cut.
    """
    of_joints = program.moves.is_visit_of_joint_move
    feeds = read_feeds(program)  # (v,) [m/s], NaN or 0 if unknown
    if request.feed is not None:
        most = SAME_FEED * LENGTH[request.units.length] * request.feed
    else:
        known = feeds[~of_joints & (feeds > 0.0)]
        most = APPROACH * known.min() if len(known) else np.inf
    return np.asarray(~of_joints & ~(feeds > most))
