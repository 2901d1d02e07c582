"""Loads whose masses the files state: their weights are the forces of a proposal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.conversion.units import KGF
from jointstiff.service.importing.errors import NOWHERE, ImportFileError
from jointstiff.service.importing.grammar import find_unit_of_weight
from jointstiff.service.importing.loads import find_newtons
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.rewriting import list_masses
from jointstiff.service.proposals.tables.numbers import NumberTable, find_table
from jointstiff.solver.meaning.proposal import Proposal

_SAME_WEIGHT: Final = 0.02
"""Largest difference of a stated force and the weight of a column of masses, as a part of the weight."""


def describe_weights(masses: Iterable[float | None]) -> str:
    """Return the forces that are taken of loads [kg] in names, in words."""
    forces = [f"loaded {mass:g} kg: force 0, 0, −{KGF * mass:.4g} N" for mass in masses if mass is not None]
    return ", ".join(forces)


def has_masses(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> bool:
    """Return whether the loads that names state are the masses of the readings.

    A force that the caller or a column states takes precedence for one load.

    Raises:
        ImportFileError: several loads have one force, or a column of masses has another one.
    """
    masses = list_masses(named)
    joints = find_table(tables, proposal.joints.table)
    has_force = request.force is not None or joints.has_column_of("force")
    if request.force is not None and (len(masses) > 1 or _differs_from_mass(masses, joints, request)):
        listed = " and ".join("another load" if mass is None else f"{mass:g} kg" for mass in masses)
        reason = f"there are readings under {listed}, and `force` states one force for all"
        if len(masses) == 1:
            reason = f"there are readings under {listed}, and `force` is not this weight"
        raise ImportFileError(NOWHERE, reason, "omit `force`: the masses are those of the files", "force")
    return None not in masses and bool(masses) and not has_force


def _differs_from_mass(masses: Sequence[float | None], joints: NumberTable, request: ImportRequest) -> bool:
    """Return whether the stated force is not the weight of the one mass of a column of masses."""
    unit = None if request.units is None else request.units.force
    has_column = any(map(find_unit_of_weight, joints.headers)) and any(name.mass for name in joints.turn)
    mass = masses[0] if masses else None
    if not has_column or mass is None or request.force is None or unit is None:
        return False
    weight = KGF * mass
    stated = find_newtons(unit) * float(np.linalg.norm(request.force))
    return abs(stated - weight) > _SAME_WEIGHT * weight
