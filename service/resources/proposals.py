"""Import of files whose columns have no known meaning: the robot proposes one, a person accepts it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.schemas.imports import ImportAnswer, ImportRequest
from jointstiff.schemas.meaning import JointsMeaning, PointsMeaning, TableMeaning
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.numbers import NumberTable, read_number_tables
from jointstiff.service.importing.reading import SourceFile, understand_files
from jointstiff.service.importing.rewriting import NamedReading, name_readings, write_readings
from jointstiff.service.resources.imports import ImportRefusedError, import_files, lack_meaning
from jointstiff.solver.meaning.proposal import Proposal, propose
from jointstiff.solver.meaning.states import order_states
from jointstiff.solver.meaning.table import JointColumns
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
_CLEARLY_FARTHER: Final = 2.0
"""Ratio of the distances to positions without and under load from which a reading is one under load."""
_TURNS_OF_AXES: Final = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
"""Orders of x, y and z that keep the hand of a frame. Where two axes are exchanged, the place of the
instrument decides which order is proposed; a template keeps the order of its first files."""


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
    try:
        tables = _read_tables(files, request, names)
        if template is None:
            return _propose_importable(tables, request, known)
        return _propose_as_template(tables, request, known, template)
    except _NoProposalError as error:
        return NoProposal(error.reason)


class _NoProposalError(Exception):
    """Error that no robot has a proposal for the meaning of files; `propose_import` answers its reason."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason  # why there is no proposal, in words


def _propose_importable(
    tables: Sequence[NumberTable], request: ImportRequest, robots: Sequence[KnownRobot]
) -> ProposedImport:
    """Return the proposal of the robots for tables of numbers; a person can accept it.

    Raises:
        _NoProposalError: no meaning fits, or the import refuses the table with the proposed meaning.
    """
    proposal = _find_proposal(tables, request, robots)
    named = name_readings(proposal, tables, request.state_words)
    _refuse_loaded_after_unloading(named)
    proposed = _build_import(proposal, named, tables, request)
    fault = proposed.find_fault()
    if fault is not None:
        sentence = proposed.sentence
        raise _NoProposalError(f"{sentence}, but the import of these columns is refused: {fault.reason}")
    return proposed


def _refuse_loaded_after_unloading(named: Sequence[NamedReading]) -> None:
    """Refuse positions after unloading that are nearer to those under load than to those before.

    Raises:
        _NoProposalError: a target has such positions: a second load, or the same load once more.
    """
    positions = {(each.target, each.state): each.reading.positions for each in named}
    for target in dict.fromkeys(each.target for each in named):
        unloaded = positions.get((target, "unloaded"))
        loaded = positions.get((target, "loaded"))
        after = positions.get((target, "unloaded_after"))
        if unloaded is None or loaded is None or after is None:
            continue
        to_loaded, to_unloaded = (
            float(np.nanmedian(np.linalg.norm(after - other, axis=1))) for other in (loaded, unloaded)
        )
        if to_unloaded > _CLEARLY_FARTHER * to_loaded:
            raise _NoProposalError(
                f"the third positions of {target} are {1e3 * to_unloaded:.2g} mm from those without load and "
                f"{1e3 * to_loaded:.2g} mm from those under load, so that headers must name the states"
            )


def _propose_as_template(
    tables: Sequence[NumberTable],
    request: ImportRequest,
    robots: Sequence[KnownRobot],
    template: TableMeaning,
) -> ProposedImport:
    """Return the proposal of the robots for tables of numbers, with the meaning and names of a template.

    Raises:
        _NoProposalError: no meaning fits, or another meaning than that of the template.
    """
    if not _has_columns(tables, template):
        raise _NoProposalError("the files have fewer columns than those of the template")
    tables = _restrict_columns(tables, template)
    proposal = _find_proposal(tables, request, robots)
    reasons = []
    for order in _TURNS_OF_AXES:
        turned = proposal.with_axes(order)
        named = _name_by_template(name_readings(turned, tables, request.state_words), template)
        reason = _find_difference(_build_meaning(turned, named, tables), template)
        if not reason:
            return _build_import(turned, named, tables, request)
        reasons.append(reason)
    raise _NoProposalError(reasons[0])


def _find_proposal(
    tables: Sequence[NumberTable], request: ImportRequest, robots: Sequence[KnownRobot]
) -> Proposal:
    """Return the meaning of tables by the robot that fits best; its first state has no load.

    Raises:
        _NoProposalError: no robot fits, several meanings fit alike, or the request states other units.
    """
    found = propose([each.table for each in tables], robots)
    if found.best is None:
        raise _NoProposalError(found.reason)
    if reason := _find_contradiction(found.best, request):
        raise _NoProposalError(reason)
    return _order_by_forces(found.best, tables)


def _build_import(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> ProposedImport:
    """Return a proposal with the table that the import understands, and the options left for this table.

    Options about columns are left out, because the written table has headers that explain its columns.

    Args:
        proposal: meaning of the columns by the robot that fits.
        named: names of targets and states of the positions.
        tables: numbers of the files.
        request: options of the import of the files.
    """
    table = write_readings(proposal, named, tables)
    options = request.model_copy(update={**_clear_headers(), **_state_units(request)})
    meaning = _build_meaning(proposal, named, tables)
    return ProposedImport(proposal, tuple(named), table, options, meaning)


def _read_tables(
    files: Sequence[SourceFile], request: ImportRequest, joints: Sequence[str]
) -> list[NumberTable]:
    """Return the tables of numbers of the files; `joints` are names of joints.

    Raises:
        _NoProposalError: a file cannot be read, or no file has rows of numbers.
    """
    try:
        tables = read_number_tables(files, request, joints)
    except ImportFileError as fault:
        raise _NoProposalError(str(fault)) from fault
    if not tables:
        raise _NoProposalError("the files have no rows of numbers")
    return tables


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
    except ImportRefusedError:
        if not request.accept_proposal or not lack_meaning(files, request, robot.robot):
            raise
        proposed = propose_import(files, request, [robot])
        if isinstance(proposed, ProposedImport):
            return _accept_proposal(proposed)
        raise
    if not answer.faults or not lack_meaning(files, request, robot.robot):
        return answer
    proposed = propose_import(files, request, [robot])
    if isinstance(proposed, NoProposal):
        return answer.model_copy(update={"proposal": None})
    if request.accept_proposal:
        return _accept_proposal(proposed)
    return answer.model_copy(update={"proposal": proposed.text})


def _accept_proposal(proposed: ProposedImport) -> ImportAnswer:
    """Import files as a proposal says; a template of them has no options about columns.

    Files of the same form have no known headers either, so that the robot has to find their meaning, too.
    """
    answer = proposed.accept()
    template = answer.template and answer.template.model_copy(update=_clear_headers())
    return answer.model_copy(update={"proposal": proposed.text, "template": template})


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
    columns = _find_force_columns(joints)
    if columns is None:
        return proposal
    groups = proposal.joints.groups
    forces = groups.split(joints.table.numbers[:, columns])[:, 0]
    return order_states(proposal, [table.table for table in tables], np.nan_to_num(forces))


def _find_force_columns(table: NumberTable) -> list[int] | None:
    """Return the columns of Fx, Fy and Fz of a table, by their headers; None unless there are all three."""
    column_of_axis = {}
    for column, meaning in enumerate(table.meanings):
        if meaning is not None and meaning.kind == "force" and meaning.axis is not None:
            column_of_axis[meaning.axis] = column
    if sorted(column_of_axis) != [0, 1, 2]:
        return None
    return [column_of_axis[axis] for axis in (0, 1, 2)]


def _build_meaning(
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
