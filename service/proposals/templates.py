"""Proposals for files of a form that was accepted before: the robot finds the same meaning, or none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.meaning import TableMeaning
from jointstiff.service.importing.grammar import Vocabulary
from jointstiff.service.proposals.completion import build_import
from jointstiff.service.proposals.forces.naming import name_forces, take_loads
from jointstiff.service.proposals.found_meaning import find_proposal
from jointstiff.service.proposals.names.naming import NamedReading, name_readings
from jointstiff.service.proposals.no_proposal import NoProposalError
from jointstiff.service.proposals.proposed_import import ProposedImport
from jointstiff.service.proposals.tables.numbers import NumberTable
from jointstiff.service.proposals.template_meaning import build_meaning
from jointstiff.service.proposals.uncertainties import add_uncertainties
from jointstiff.solver.mechanics.robot import KnownRobot

_LARGEST_WORSENING: Final = 3.0
"""Largest ratio of the residuals of files and of those of their template."""
_TURNS_OF_AXES: Final = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
"""Orders of x, y and z that keep the hand of a frame. Where two axes are exchanged, the place of the
instrument decides which order is proposed; a template keeps the order of its first files."""


def propose_as_template(
    tables: Sequence[NumberTable],
    request: ImportRequest,
    robots: Sequence[KnownRobot],
    template: TableMeaning,
) -> ProposedImport:
    """Return the proposal of the robots for tables of numbers, with the meaning and names of a template.

    Raises:
        NoProposalError: no meaning fits, or another meaning than that of the template.
    """
    if not _has_columns(tables, template):
        raise NoProposalError("the files have fewer columns than those of the template")
    tables = _restrict_columns(tables, template)
    proposal = find_proposal(tables, request, robots)
    tables, load_notes = take_loads(proposal, tables, request)
    reasons = []
    for order in _TURNS_OF_AXES:
        turned = proposal.with_axes(order)
        named = _name_by_template(name_readings(turned, tables, request), template)
        reason = _find_difference(build_meaning(turned, named, tables), template)
        if not reason:
            words = Vocabulary(request, turned.robots[0].robot.joint_names)
            named = add_uncertainties(named, tables, words, turned.unit)
            tables, notes = name_forces(turned, named, tables, request)
            return build_import(turned, named, tables, request, [*load_notes, *notes])
        reasons.append(reason)
    raise NoProposalError(reasons[0])


def _has_columns(tables: Sequence[NumberTable], template: TableMeaning) -> bool:
    """Return whether the tables have all columns of a template."""
    widths = {number: each.table.size[1] for number, each in enumerate(tables, 1)}
    parts = [(template.joints.file, template.joints.columns)]
    parts += [(points.file, points.columns) for points in template.points]
    return all(max(columns) <= widths.get(file, 0) for file, columns in parts)


def _restrict_columns(tables: Sequence[NumberTable], template: TableMeaning) -> list[NumberTable]:
    """Return the tables with no other columns than those of a template, whose columns count from 1."""
    restricted = []
    for number, each in enumerate(tables, 1):
        points = [points for points in template.points if points.file == number]
        joints: tuple[int, ...] = ()
        if template.joints.file == number:
            joints = tuple(column - 1 for column in template.joints.columns)
        used = {column - 1 for group in points for column in group.columns} | set(joints)
        others = frozenset(range(each.table.size[1])) - used
        restricted.append(replace(each, table=replace(each.table, joints=joints, others=others)))
    return restricted


def _name_by_template(named: Sequence[NamedReading], template: TableMeaning) -> list[NamedReading]:
    """Return the readings with the targets and states of a template, in their order."""
    if len(named) != len(template.points):
        return list(named)
    return [
        replace(each, target=points.target, state=points.state)
        for each, points in zip(named, template.points, strict=True)
    ]


def _find_difference(meaning: TableMeaning, template: TableMeaning) -> str:
    """Return how files differ from those of a template; empty if they mean the same and fit as well."""
    if meaning.joints != template.joints or meaning.points != template.points:
        return "the columns have another meaning than those of the template"
    if meaning.unit != template.unit:
        return f"the positions are in {meaning.unit}, and those of the template in {template.unit}"
    if meaning.residual > _LARGEST_WORSENING * template.residual:
        own, earlier = 1e3 * meaning.residual, 1e3 * template.residual
        return f"the robot fits to {own:.2g} mm; the files of the template fitted to {earlier:.2g} mm"
    return ""
