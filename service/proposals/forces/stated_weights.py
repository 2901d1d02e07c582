"""Weights that files state once in words, as a force along −z of R0 that the deflections confirm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.importing.stated_loads import describe_source, find_stated_loads
from jointstiff.service.proposals.columns.left import list_columns_left
from jointstiff.service.proposals.forces.evidence import ForceEvidence
from jointstiff.service.proposals.forces.likely import describe_likely_force, may_be_force
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.numbers import NumberTable, find_table
from jointstiff.solver.meaning.proposal import Proposal


def take_stated_weight(
    proposal: Proposal,
    named: Sequence[NamedReading],
    tables: Sequence[NumberTable],
    request: ImportRequest,
    sources: Sequence[SourceFile],
) -> tuple[Sequence[NumberTable], list[str]]:
    """Return the tables with the only load that files state in words, if it is certain; and a note.

    The words have a unit, and say that the load hangs or pulls down, or are a vector along −z; the targets
    move along the force; and nothing else may be a force. Otherwise the tables stay, and the load is a likely
    answer to the question.
    """
    if request.force is not None or _has_other_loads(proposal, named, tables):
        return tables, []
    loads = find_stated_loads(sources)
    if len(loads) != 1 or not loads[0].is_certain:
        return tables, []
    (load,) = loads
    joints = find_table(tables, proposal.joints.table)
    force = np.array([0.0, 0.0, -load.newtons])
    moved = ForceEvidence(proposal, named, joints, request).count_moved_along(force)
    if moved is None:
        return tables, []
    loaded = joints.add_forces(np.tile(force, (len(joints.rows), 1)), "N")
    note = (
        f"force 0,0,-{load.newtons:.4g} N along −z of R0, as {describe_source(load)}, and the targets move "
        f"along it in {moved.along} of {moved.total} postures: if another force acts, state `force`"
    )
    return [loaded if table is joints else table for table in tables], [note]


def _has_other_loads(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable]
) -> bool:
    """Return whether columns or names state loads, or columns that are not read may do so."""
    loaded = {(each.mass, each.force) for each in named if each.state == "loaded"}
    left = list_columns_left(proposal, tables, named)
    may_be_forces = any(may_be_force(each.table, column) for each in left for column in each.columns)
    has_columns = any(table.has_column_of(kind) for table in tables for kind in ("force", "moment", "mass"))
    return loaded != {(None, "")} or has_columns or may_be_forces or bool(describe_likely_force(left))
