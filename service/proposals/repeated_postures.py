"""Postures that occur twice with different readings: some of them may be under load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.numbers import NumberTable, find_table
from jointstiff.solver.meaning.hypotheses import number_postures
from jointstiff.solver.meaning.proposal import Proposal

_LEAST_REPEATED: Final = 3
"""Postures that occur twice, at least: an arm returns to one posture to check the instrument."""
_LEAST_PART: Final = 0.5
"""Least part of the postures that occur twice."""
_REPEATABLE: Final = 5e-5
"""Distance [m] of two readings of a posture up to which they are repeats: noise, and the arm's return."""


def refuse_repeated_postures(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> None:
    """Refuse positions in one state if postures occur twice, with readings that differ by more than noise.

    Raises:
        ImportFileError: there are such postures, and the request states no state.
    """
    joints = find_table(tables, proposal.joints.table)
    states = {each.state for each in named}
    if request.state is not None or states != {"unloaded"}:
        return
    indices = np.arange(len(joints.rows), dtype=float)[:, np.newaxis]
    first_rows = proposal.joints.groups.split(indices)[:, 0, 0].astype(int)  # of each posture
    numbers = joints.table.numbers[first_rows][:, list(proposal.joints.columns)]
    postures = number_postures(numbers)
    counts = np.bincount(postures)
    rows_of_postures = np.split(np.argsort(postures, kind="stable"), np.cumsum(counts)[:-1])
    repeated = [rows for rows in rows_of_postures if len(rows) > 1]
    count = len(counts)
    if len(repeated) < max(_LEAST_REPEATED, _LEAST_PART * count):
        return
    positions = named[0].reading.positions
    apart = [float(np.linalg.norm(np.ptp(positions[rows], axis=0))) for rows in repeated]
    distance = float(np.nanmedian(apart))
    if not distance > _REPEATABLE:
        return
    first, second = (joints.rows[first_rows[row]] for row in repeated[0][:2])
    raise ImportFileError(
        joints.grid.place(second),
        f"row {second.line} has the joints of row {first.line}, as in {len(repeated)} of {count} postures, "
        f"with positions {1e3 * distance:.2g} mm apart, so that some may be under load",
        'add a column with the header "state" and the word unloaded or loaded in each row; if no row is '
        "under load, give `state`",
        "state",
    )
