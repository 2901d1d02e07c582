"""The meaning of columns as a template stores it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from jointstiff.schemas.meaning import JointsMeaning, PointsMeaning, TableMeaning
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.table import JointColumns


def build_meaning(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable]
) -> TableMeaning:
    """Return the meaning of the columns for a template: files, columns and rows count from 1."""
    file_numbers = {table.name: number for number, table in enumerate(tables, 1)}
    return TableMeaning(
        robot=proposal.robots[0].name,
        joints=_build_joints_meaning(proposal.joints, file_numbers),
        points=[_build_points_meaning(each, file_numbers) for each in named],
        unit=proposal.unit,
        residual=proposal.residual,
    )


def _build_joints_meaning(joints: JointColumns, file_numbers: Mapping[str, int]) -> JointsMeaning:
    """Return which columns are the joints, for a template; `file_numbers` is table → number of its file."""
    return JointsMeaning(
        file=file_numbers[joints.table],
        columns=[column + 1 for column in joints.columns],
        unit=joints.unit,
        counting=joints.counting.name,
        order=joints.groups.order,
        count=joints.groups.count,
    )


def _build_points_meaning(named: NamedReading, file_numbers: Mapping[str, int]) -> PointsMeaning:
    """Return which columns are the positions of a target in a state, for a template.

    `file_numbers` is table → number of its file.
    """
    points = named.reading.points
    return PointsMeaning(
        file=file_numbers[points.table],
        columns=[column + 1 for column in points.columns],
        order=points.groups.order,
        count=points.groups.count,
        row=named.reading.index + 1,
        target=named.target,
        state=named.state,
    )
