"""Columns of loads, such as a payload or a load cell, whose numbers show which rows are under load."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from jointstiff.schemas.imports import State
from jointstiff.service.importing.grammar import is_hung, looks_like_a_force
from jointstiff.service.importing.grid import COORDINATES
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.arrays import FloatArray

_NEAR_ZERO: Final = 0.1
"""Largest size of a load that is none, as a part of the greatest: noise and the zero of a load cell."""
_LEAST_LOAD: Final = 0.3
"""Least size of a load, as a part of the greatest."""
_LEAST_ROWS: Final = 3
"""Rows in each state, at least."""
PART: Final = re.compile(r"[\s_.-]{0,3}(?:[xyz]|\[?[0-6]\]?)$", re.IGNORECASE)
"""End of a header that names a part of a vector, such as `force_0`."""


def find_states_of_loads(sizes: FloatArray) -> list[State] | None:
    """Return the state of each row by the size of its load; None unless each is near zero, or large.

    A size that is not finite shows no state.
    """
    greatest = float(np.abs(sizes).max(initial=0.0))
    if not np.isfinite(sizes).all() or greatest == 0.0:
        return None
    is_none, is_load = np.abs(sizes) <= _NEAR_ZERO * greatest, np.abs(sizes) >= _LEAST_LOAD * greatest
    are_clear = bool((is_none | is_load).all()) and min(is_none.sum(), is_load.sum()) >= _LEAST_ROWS
    if not are_clear:
        return None
    return ["loaded" if each else "unloaded" for each in is_load]


def list_states_of_columns(table: NumberTable) -> list[State] | None:
    """Return the state of each row by the columns whose headers have a word for a load or a force.

    None if no column shows the states, or if two columns contradict each other.
    """
    parts: dict[str, list[int]] = {}
    for column, header in enumerate(table.headers):
        if table.is_unknown(column) and (is_hung(header) or looks_like_a_force(header)):
            parts.setdefault(PART.sub("", header), []).append(column)
    found = set[tuple[State, ...]]()
    for columns in parts.values():
        vector = columns[:COORDINATES] if len(columns) >= COORDINATES else columns[:1]
        states = find_states_of_loads(np.linalg.norm(table.table.numbers[:, vector], axis=1))
        found.update([] if states is None else [tuple(states)])
    return list(found.pop()) if len(found) == 1 else None
