"""Import of files whose columns have no known meaning: the robot proposes one, a person accepts it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.schemas.imports import ImportAnswer, ImportRequest
from jointstiff.schemas.meaning import JointsMeaning, PointsMeaning, TableMeaning
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.numbers import NumberTable, read_number_tables
from jointstiff.service.importing.reading import SourceFile, understand_files
from jointstiff.service.importing.rewriting import NamedReading, name_readings, write_readings
from jointstiff.service.resources.imports import ImportRefusedError, import_files
from jointstiff.solver.meaning.proposal import Proposal, propose
from jointstiff.solver.meaning.states import order_states
from jointstiff.solver.meaning.words import describe, remark
from jointstiff.solver.mechanics.robot import KnownRobot

OPTIONS_OF_COLUMNS: Final = (
    "columns",
    "header",
    "ignore",
    "layouts",
    "delimiter",
    "decimal_mark",
    "units",
    "by_order",
)
"""Options that explain the columns of files, which the written table explains itself."""


_LARGEST_WORSENING: Final = 3.0
"""Largest ratio of the residuals of files and of those of their template."""


@dataclass(frozen=True, eq=False)
class ProposedImport:
    """Meaning of files by the robot, and the table that is imported if a person accepts it."""

    proposal: Proposal
    named: tuple[NamedReading, ...]  # targets and states of the positions
    table: SourceFile  # with headers that the import understands
    request: ImportRequest  # options that are left for this table
    meaning: TableMeaning  # for a template

    @property
    def sentence(self) -> str:
        """The proposal in words, and what a person should know about its fit."""
        states = [each.state.replace("_", " ") for each in self.named]
        names = [f"{each.target} {state}" for each, state in zip(self.named, states, strict=True)]
        text, note = describe(self.proposal, names), remark(self.proposal)
        return f"{text}; {note}" if note else text

    @property
    def text(self) -> str:
        """The proposal in words, with the question that the numbers cannot decide."""
        doubt = self.proposal.doubt
        return f"{self.sentence}. Undecided: {doubt}." if doubt else f"{self.sentence}."

    @property
    def known(self) -> KnownRobot:
        """Robot that fits."""
        return self.proposal.robots[0]

    def find_fault(self) -> ImportFileError | None:
        """Return the first fault of the table with the proposed meaning; None if a person can accept it."""
        faults = understand_files([self.table], self.request, self.known.robot.joint_names).faults
        return faults[0] if faults else None

    def accept(self, request: ImportRequest | None = None) -> ImportAnswer:
        """Import the table as the proposal says; `request` has other statements about the readings."""
        answer = import_files([self.table], request or self.request, self.known.robot)
        return answer.model_copy(update={"assumptions": [self.sentence, *answer.assumptions]})


@dataclass(frozen=True)
class NoProposal:
    """Reason why no robot has a proposal for the meaning of files."""

    reason: str


def propose_import(
    files: Sequence[SourceFile],
    request: ImportRequest,
    robots: Iterable[KnownRobot],
    template: TableMeaning | None = None,
) -> ProposedImport | NoProposal:
    """Find the meaning of files by the robots that may have been measured.

    Args:
        files: tables of joints and positions, whose headers may be missing or unknown.
        request: options of the import.
        robots: robots that may have been measured.
        template: meaning of earlier files of the same form, that these files must have; None for any meaning.
    """
    known = list(robots)
    names = known[0].robot.joint_names if len(known) == 1 else ()
    tables = _read_tables(files, request, names)
    if isinstance(tables, NoProposal):
        return tables
    if template is not None:
        if not _has_columns(tables, template):
            return NoProposal("the files have fewer columns than those of the template")
        tables = _restrict_columns(tables, template)
    found = propose([table.table for table in tables], known)
    if found.best is None:
        return NoProposal(found.reason)
    if reason := _find_contradiction(found.best, request):
        return NoProposal(reason)
    proposal = _order_by_forces(found.best, tables)
    named = name_readings(proposal, tables, request.state_words)
    if template is not None:
        named = _name_by_template(named, template)
        if reason := _find_difference(_build_meaning(proposal, named, tables), template):
            return NoProposal(reason)
    table = write_readings(proposal, named, tables)
    kept = request.model_copy(update={**_clear_headers(), **_state_units(request)})
    proposed = ProposedImport(proposal, tuple(named), table, kept, _build_meaning(proposal, named, tables))
    return proposed if template is not None else _require_importable(proposed)


def _require_importable(proposed: ProposedImport) -> ProposedImport | NoProposal:
    """Return a proposal that a person can accept; else the reason why its table is refused."""
    fault = proposed.find_fault()
    if fault is None:
        return proposed
    return NoProposal(f"{proposed.sentence}, but the import of these columns is refused: {fault.reason}")


def _read_tables(
    files: Sequence[SourceFile], request: ImportRequest, joints: Sequence[str]
) -> list[NumberTable] | NoProposal:
    """Return the tables of numbers of the files, or why there are none; `joints` are names of joints."""
    try:
        tables = read_number_tables(files, request, joints)
    except ImportFileError as fault:
        return NoProposal(str(fault))
    return tables or NoProposal("the files have no rows of numbers")


def import_or_propose(
    files: Sequence[SourceFile],
    request: ImportRequest,
    robot: KnownRobot | None,
    others: Iterable[KnownRobot],
) -> ImportAnswer:
    """Import files by the names of their columns, or else by the proposal of the robot.

    The proposal is in the answer, and is followed if the request accepts the proposal.

    Args:
        files: files of readings.
        request: options of the import.
        robot: robot that was measured; None if unknown, and then nothing is proposed.
        others: robots that may have been measured instead.

    Raises:
        ImportRefusedError: the files were not understood, and the request does not have `show_faults`.
    """
    if robot is None:
        return import_files(files, request, None, others)
    try:
        answer = import_files(files, request, robot.robot, others)
        refusal = None
    except ImportRefusedError as error:
        refusal = error
    if refusal is None and not answer.faults:
        return answer
    proposed = propose_import(files, request, [robot])
    if isinstance(proposed, ProposedImport) and request.accept_proposal:
        answer = proposed.accept()
        template = answer.template and answer.template.model_copy(update=_clear_headers())
        return answer.model_copy(update={"proposal": proposed.text, "template": template})
    if refusal is not None:
        raise refusal
    sentence = None if isinstance(proposed, NoProposal) else proposed.text
    return answer.model_copy(update={"proposal": sentence})


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


def _has_columns(tables: Sequence[NumberTable], template: TableMeaning) -> bool:
    """Return whether the tables have all columns of a template."""
    widths = {number: each.table.size[1] for number, each in enumerate(tables, 1)}
    parts = [(template.joints.file, template.joints.columns)]
    parts += [(points.file, points.columns) for points in template.points]
    return all(max(columns) <= widths.get(file, 0) for file, columns in parts)


def _restrict_columns(tables: Sequence[NumberTable], template: TableMeaning) -> list[NumberTable]:
    """Return the tables with no other columns than those of a template."""
    restricted = []
    for number, each in enumerate(tables, 1):
        joints, points = template.joints, [points for points in template.points if points.file == number]
        own = tuple(column - 1 for column in joints.columns) if joints.file == number else ()
        used = {column - 1 for each_points in points for column in each_points.columns} | set(own)
        others = frozenset(range(each.table.size[1])) - used
        restricted.append(replace(each, table=replace(each.table, joints=own, others=others)))
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


def _clear_headers() -> dict[str, object]:
    """Return the options that explain columns, with their defaults."""
    empty = ImportRequest()
    return {name: getattr(empty, name) for name in OPTIONS_OF_COLUMNS}


def _state_units(request: ImportRequest) -> dict[str, object]:
    """Return the units of forces and moments, which the written table may leave open."""
    if request.units is None:
        return {}
    return {"units": request.units.model_copy(update={"length": None, "angle": None})}


def _order_by_forces(proposal: Proposal, tables: Sequence[NumberTable]) -> Proposal:
    """Return the proposal with the state first that has no load, if columns of forces show which one."""
    joints = next(table for table in tables if table.name == proposal.joints.table)
    columns = {
        meaning.axis: column
        for column, meaning in enumerate(joints.meanings)
        if meaning is not None and meaning.kind == "force"
    }
    if sorted(axis for axis in columns if axis is not None) != [0, 1, 2]:
        return proposal
    groups = proposal.joints.groups
    forces = groups.split(joints.table.numbers[:, [columns[axis] for axis in (0, 1, 2)]])[:, 0]
    return order_states(proposal, [table.table for table in tables], np.nan_to_num(forces))


def _build_meaning(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable]
) -> TableMeaning:
    """Return the meaning of the columns for a template."""
    joints = proposal.joints
    numbers = {table.name: number for number, table in enumerate(tables, 1)}
    return TableMeaning(
        robot=proposal.robots[0].name,
        joints=JointsMeaning(
            file=numbers[joints.table],
            columns=[column + 1 for column in joints.columns],
            unit=joints.unit,
            counting=joints.counting.name,
            order=joints.groups.order,
            count=joints.groups.count,
        ),
        points=[
            PointsMeaning(
                file=numbers[each.reading.points.table],
                columns=[column + 1 for column in each.reading.points.columns],
                order=each.reading.points.groups.order,
                count=each.reading.points.groups.count,
                row=each.reading.index + 1,
                target=each.target,
                state=each.state,
            )
            for each in named
        ],
        unit=proposal.unit,
        residual=proposal.residual,
    )
