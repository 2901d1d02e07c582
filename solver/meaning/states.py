"""State of the targets that is loaded, by the work of the forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.table import Table


def order_states(proposal: Proposal, tables: Sequence[Table], forces: FloatArray) -> Proposal:
    """Return the proposal with the unloaded state first: the forces move the targets along themselves.

    The states of all targets are exchanged if the forces did negative work from the first state to the
    second. A proposal without a target in two states is returned as it is.

    Args:
        proposal: meaning of the tables.
        tables: the tables of the proposal.
        forces: (N, 3) forces on the robot in axes of R0, in any unit.
    """
    first = _read_state(proposal, tables, state=0)
    second = _read_state(proposal, tables, state=1)
    targets = sorted(first.keys() & second.keys())
    if not targets:
        return proposal
    deflections = np.array([second[target] - first[target] for target in targets])  # (K, N, 3)
    work = np.einsum("ni,kni->kn", forces, deflections)  # force times deflection
    first_is_unloaded = float(np.nansum(work)) >= 0.0
    return proposal if first_is_unloaded else _exchange_first_states(proposal)


def _exchange_first_states(proposal: Proposal) -> Proposal:
    """Return the proposal with the first two states of each target exchanged; further states stay."""
    exchanged_state = {0: 1, 1: 0}
    readings = []
    for reading in proposal.readings:
        state = exchanged_state.get(reading.state, reading.state)
        readings.append(replace(reading, state=state))
    return replace(proposal, readings=tuple(readings))


def _read_state(proposal: Proposal, tables: Sequence[Table], state: int) -> dict[int, FloatArray]:
    """Return target → positions (N, 3) in R0 [m] of one state."""
    table_of_name = {table.name: table for table in tables}
    positions = {}
    for reading in proposal.readings:
        if reading.state == state:
            points = reading.points
            numbers = table_of_name[points.table].numbers[:, list(points.columns)]
            rows_of_postures = points.groups.split(numbers)  # (N, rows of a posture, 3)
            positions[reading.target] = proposal.frame.to_base(rows_of_postures[:, reading.index])
    return positions
