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

    Args:
        proposal: meaning of the tables.
        tables: the tables of the proposal.
        forces: (N, 3) forces on the robot in axes of R0, in any unit.
    """
    first, second = (_read_state(proposal, tables, state) for state in (0, 1))
    targets = sorted(first.keys() & second.keys())
    if not targets:
        return proposal
    moved = np.array([second[target] - first[target] for target in targets])
    work = np.einsum("ni,kni->kn", forces, moved)
    if float(np.nansum(work)) >= 0.0:
        return proposal
    exchanged = [
        replace(each, state=1 - each.state) if each.state < 2 else each for each in proposal.readings
    ]
    return replace(proposal, readings=tuple(exchanged))


def _read_state(proposal: Proposal, tables: Sequence[Table], state: int) -> dict[int, FloatArray]:
    """Return target → positions (N, 3) in R0 [m] of one state."""
    by_name = {table.name: table for table in tables}
    positions = {}
    for each in proposal.readings:
        if each.state == state:
            numbers = by_name[each.points.table].numbers[:, list(each.points.columns)]
            rows = each.points.groups.split(numbers)[:, each.index]
            positions[each.target] = proposal.frame.to_base(rows)
    return positions
