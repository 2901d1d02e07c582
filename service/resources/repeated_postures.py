"""Postures that occur twice with different readings: some of them may be under load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.naming import NamedReading
from jointstiff.service.importing.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.meaning.hypotheses import find_joint_noise
from jointstiff.solver.meaning.proposal import Proposal

_LEAST_REPEATED: Final = 3
"""Postures that occur twice, at least: an arm returns to one posture to check the instrument."""
_LEAST_PART: Final = 0.5
"""Least part of the postures that occur twice."""
_REPEATABLE: Final = 5e-5
"""Distance [m] of two readings of a posture up to which they are repeats: noise, and the arm's return."""
_CELL: Final = 4.0
"""Size of a cell of joints in which rows are one posture, in the noise of joints."""
_HALVES: Final = (0.0, 0.5)
"""Shifts of the cells: noise crosses a border of one grid at most."""


def refuse_repeated_postures(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> None:
    """Refuse positions in one state if postures occur twice, with readings that differ by more than noise.

    Raises:
        ImportFileError: there are such postures, and the request states no state.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    states = {each.state for each in named}
    if request.state is not None or states != {"unloaded"} or proposal.joints.groups.count > 1:
        return
    numbers = joints.table.numbers[:, list(proposal.joints.columns)]
    found = (_find_repeated(numbers, shift) for shift in _HALVES)
    repeated, count = max(found, key=lambda each: len(each[0]))
    if len(repeated) < max(_LEAST_REPEATED, _LEAST_PART * count):
        return
    positions = named[0].reading.positions
    apart = [float(np.linalg.norm(np.ptp(positions[rows], axis=0))) for rows in repeated]
    distance = float(np.nanmedian(apart))
    if not distance > _REPEATABLE:
        return
    first, second = (joints.rows[row] for row in repeated[0][:2])
    raise ImportFileError(
        joints.grid.place(second),
        f"row {second.line} has the joints of row {first.line}, as in {len(repeated)} of {count} postures, "
        f"with positions {1e3 * distance:.2g} mm apart, so that some may be under load",
        'add a column with the header "state" and the word unloaded or loaded in each row; if no row is '
        "under load, give `state`",
        "state",
    )


def _find_repeated(joints: FloatArray, shift: float) -> tuple[list[IndexArray], int]:
    """Return the rows of each posture that occurs twice or more, and the number of postures.

    Joints (N, n) are one posture if they are in one cell of a grid, which is shifted by a part of a cell.
    """
    cells = np.floor(joints / (_CELL * find_joint_noise(joints)) + shift)
    _, posture, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(posture.reshape(-1), kind="stable")
    rows_of_postures = np.split(order, np.cumsum(counts)[:-1])
    repeated = [rows for rows in rows_of_postures if len(rows) > 1]
    return sorted(repeated, key=lambda rows: int(rows[0])), len(counts)
