"""Feeds of a program: stated by the request, by the table of loads, by the program, or by the cut."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.schemas.program import ProgramOptions
from jointstiff.service.kinds.program.path import Visits
from jointstiff.solver.arrays import FloatArray
from robotprograms import Program

ROUNDING: Final = 1.01
"""Ratio to a stated feed up to which the feed of a program is the same."""
_M: Final = 1e-3
"""Unit of the feeds of a program [m/s]."""


def read_feeds(program: Program) -> FloatArray:
    """Return the feed (v,) that the program states for each visit of a target [m/s]; NaN if none."""
    return np.asarray(_M * program.moves.feed[program.moves.move_of_visit])


def find_feeds(
    program: Program, options: ProgramOptions, visits: Visits, wanted: float | None = None
) -> FloatArray:
    """Return the feed (v,) with which the tool comes to each visit of a target [m/s]; NaN if unknown.

    The table of loads comes first, then the wanted feed [m/s] of a request, the program and the cut. Moves
    that the program states faster than the wanted feed keep the program's feed.
    """
    stated = read_feeds(program)
    feed = stated.copy()
    if wanted is not None:
        feed = np.where(stated > ROUNDING * wanted, stated, wanted)
    elif options.cut is not None:
        feed = np.where(np.isnan(stated), options.cut.feed, stated)
    of_table = visits.loads.feed
    if of_table is not None:
        of_visit = of_table[visits.loads.of_visit]
        feed = np.where(np.isnan(of_visit), feed, of_visit)
    return np.where(program.moves.is_visit_of_joint_move, np.nan, feed)
