"""Loads of the rows of a table: the masses, forces and states that its columns of numbers show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from jointstiff.service.importing.grammar import find_unit_of_size, find_unit_of_weight
from jointstiff.service.importing.loads import KILOGRAMS, find_state_of_load
from jointstiff.service.proposals.names.labels import MOST_CODES
from jointstiff.service.proposals.tables.load_columns import find_states_of_loads, list_states_of_columns
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.service.proposals.tables.row_name import RowName
from jointstiff.solver.arrays import FloatArray


def add_loads(table: NumberTable, names: Sequence[RowName]) -> list[RowName]:
    """Return the names with the loads of columns, which tell the rows of an observation apart."""
    masses = _list_masses(table)
    forces = _list_forces(table, names) or _list_loads(table)
    named = []
    for number, name in enumerate(names):
        if masses is not None and name.mass is None:
            name = name._replace(mass=masses[number], state=find_state_of_load(masses[number]))
        if forces is not None and name.state is None:
            name = name._replace(state=forces[number].state, force=forces[number].force)
        named.append(name)
    return named


def _list_masses(table: NumberTable) -> list[float] | None:
    """Return the mass [kg] that hangs in each row; None without a column, or for one mass."""
    for column, header in enumerate(table.headers):
        meaning = table.meanings[column]
        is_mass = meaning is not None and meaning.kind == "mass"
        unit = "kgf" if is_mass else find_unit_of_weight(header)
        if unit is None or (meaning is not None and not is_mass):
            continue
        masses = [KILOGRAMS[unit] * float(mass) for mass in table.table.numbers[:, column]]
        if all(mass >= 0.0 for mass in masses) and 1 < len(set(masses)) <= MOST_CODES:
            return masses
    return None


def _list_forces(table: NumberTable, names: Sequence[RowName]) -> list[RowName] | None:
    """Return state and force of each row by its columns of forces, if some rows have none; else None.

    Sizes that occur in one posture are those of one load that was read in each posture, and no further loads,
    as are sizes if no posture has two. `names` have the postures; without a name, each row counts.
    """
    columns = [column for column, meaning in enumerate(table.meanings) if meaning and meaning.kind == "force"]
    size_column = table.find_size_of_force()
    columns += [] if size_column is None else [size_column]
    states = find_states_of_loads(np.linalg.norm(np.nan_to_num(table.table.numbers[:, columns]), axis=1))
    if not columns or states is None:
        return None
    postures = [row if name.label is None else name.label for row, name in enumerate(names)]
    vectors = np.nan_to_num(table.table.numbers[:, columns])
    written = _write_forces(vectors, postures)
    sizes = [text if state == "loaded" else "" for text, state in zip(written, states, strict=True)]
    loads_of_postures = {(size, posture) for size, posture in zip(sizes, postures, strict=True) if size}
    counts = Counter(size for size, _ in loads_of_postures)
    most_in_posture = max(Counter(posture for _, posture in loads_of_postures).values(), default=0)
    may_have_several = most_in_posture > 1 or any(name.label is None for name in names)
    has_several = may_have_several and 1 < len(counts) <= MOST_CODES and min(counts.values()) > 1
    meaning = table.meanings[columns[0]]
    unit = find_unit_of_size(table.headers[columns[0]]) if meaning is None else meaning.unit
    return [
        RowName(state=state, force=f"{size} {unit or ''}".strip() if has_several and size else "")
        for state, size in zip(states, sizes, strict=True)
    ]


def _write_forces(vectors: FloatArray, postures: Sequence[int | str]) -> list[str]:
    """Return the size of the force (rows, m) of each row; its parts if a posture has two of a size.

    Forces of a size along nearly the same direction are the same force.
    """
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    directions = np.round(vectors / np.where(lengths > 0.0, lengths, 1.0), 1) + 0.0
    sizes = [f"{length:.4g}" for (length,) in lengths]
    forces = list(zip(sizes, map(tuple, directions.tolist()), strict=True))
    of_postures = set(zip(postures, forces, strict=True))
    repeated = Counter((posture, size) for posture, (size, _) in of_postures)
    if max(repeated.values()) == 1:
        return sizes
    parts = dict[tuple[str, tuple[float, ...]], str]()
    for force, vector in zip(forces, vectors, strict=True):
        parts.setdefault(force, ",".join(f"{part:.4g}" for part in vector + 0.0))
    return [parts[force] for force in forces]


def _list_loads(table: NumberTable) -> list[RowName] | None:
    """Return the state of each row by a column of loads such as `payload`; None without one."""
    states = list_states_of_columns(table)
    return None if states is None else [RowName(state=state) for state in states]
