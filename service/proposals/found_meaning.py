"""Meaning of the columns of tables by the robot that fits, with all positions in one unit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.grammar import Vocabulary
from jointstiff.service.proposals.columns.left import (
    leave_positions,
    list_columns_left,
    list_unexplained_numbers,
)
from jointstiff.service.proposals.forces.naming import order_by_forces
from jointstiff.service.proposals.joined_tables import JoinedTables, join_numbers
from jointstiff.service.proposals.names.joining import label_by_joints
from jointstiff.service.proposals.names.naming import name_readings
from jointstiff.service.proposals.no_proposal import NoProposalError, UnreadError
from jointstiff.service.proposals.repeated_postures import bring_visits_together, separate_visits
from jointstiff.service.proposals.tables.lengths import convert_columns
from jointstiff.service.proposals.tables.numbers import NumberTable, find_table
from jointstiff.service.proposals.unread import describe_turned_table
from jointstiff.solver.meaning.proposal import Proposal, propose
from jointstiff.solver.mechanics.robot import KnownRobot

_NOTE: Final = "rows with the same joints are one posture"


class FoundMeaning(NamedTuple):
    """Meaning of the columns by the robot that fits, and the numbers in one unit."""

    numbers: JoinedTables
    proposal: Proposal


def tell_postures_by_joints(
    found_meaning: FoundMeaning, request: ImportRequest, names: Sequence[str]
) -> JoinedTables | None:
    """Return the numbers with the rows of a posture in turn, if the joints that were found tell the postures.

    Names tell the states of the rows, or else the order of the visits to a posture. None if the rows are in
    turn, or if the joints do not tell the postures. `names` are those of the joints.

    Raises:
        NoProposalError: rows of a posture do not fit each other.
    """
    numbers, joints = found_meaning.numbers, found_meaning.proposal.joints
    table = find_table(numbers.tables, joints.table)
    if joints.groups.count == len(table.turn):
        return None
    labelled = label_by_joints(numbers.separate, joints, request)
    if labelled is not None:
        joined = join_numbers(numbers.files, labelled, request, names)
        return joined._replace(notes=[*joined.notes, _NOTE])
    together = bring_visits_together(found_meaning.proposal, numbers.tables, request)
    return None if together is None else numbers._replace(tables=together, notes=[*numbers.notes, _NOTE])


def find_in_one_unit(
    numbers: JoinedTables, request: ImportRequest, robots: Sequence[KnownRobot]
) -> FoundMeaning:
    """Return the meaning of tables; columns that are not read are tried in metres or mm, as the others are.

    Raises:
        NoProposalError: no robot fits, several meanings fit alike, or the request states other units.
    """
    proposal = find_proposal(numbers.tables, request, robots)
    left = list_columns_left(proposal, numbers.tables)
    named = name_readings(proposal, numbers.tables, request)
    if not leave_positions(left, named):
        return FoundMeaning(numbers, proposal)
    converted, names = list(numbers.tables), list[str]()
    for position, each in enumerate(left):
        columns = list_unexplained_numbers(each)
        table = convert_columns(each.table, columns, proposal.unit) if columns else None
        if table is not None:
            converted[position] = table
            names.append(each.table.name)
    if not names:
        return FoundMeaning(numbers, proposal)
    again = propose([each.table for each in converted], robots).best
    if again is None or len(again.readings) <= len(proposal.readings):
        return FoundMeaning(numbers, proposal)
    other_unit = "m" if proposal.unit == "mm" else "mm"
    note = f"the other positions of {', '.join(names)} converted from {other_unit}"
    in_one_unit = numbers._replace(tables=converted, notes=[*numbers.notes, note])
    return FoundMeaning(in_one_unit, order_by_forces(again, converted, request))


def find_proposal(
    tables: Sequence[NumberTable], request: ImportRequest, robots: Sequence[KnownRobot]
) -> Proposal:
    """Return the meaning of tables by the robot that fits best; its first state has no load.

    Raises:
        NoProposalError: no robot fits, several meanings fit alike, or the request states other units.
    """
    found = propose([each.table for each in tables], robots)
    if found.best is None:
        words = Vocabulary(request, robots[0].robot.joint_names)
        if turned := describe_turned_table([each.grid for each in tables], words):
            raise UnreadError(
                f"{found.reason}; {turned}", "give each posture a row: exchange rows and columns"
            )
        raise UnreadError(found.reason)
    if reason := _find_contradiction(found.best, request):
        raise NoProposalError(reason)
    separate = separate_visits(found.best, tables)
    if separate is not None:
        return find_proposal(separate, request, robots)
    return order_by_forces(found.best, tables, request)


def _find_contradiction(proposal: Proposal, request: ImportRequest) -> str:
    """Return which stated unit contradicts the robot; empty if none does."""
    if request.units is None:
        return ""
    found = {"length": proposal.unit, "angle": proposal.joints.unit}
    for dimension, unit in found.items():
        stated = getattr(request.units, dimension)
        if stated not in (None, unit):
            return f"by the robot the {dimension}s are in {unit}, but `units` states {stated}"
    return ""
