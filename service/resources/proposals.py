"""Import of files whose columns have no known meaning: the robot proposes one, a person accepts it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.imports import FilePreview, ImportAnswer, ImportRequest
from jointstiff.schemas.meaning import JointsMeaning, PointsMeaning, TableMeaning
from jointstiff.schemas.measurement import MeasurementSetDocument, Observation
from jointstiff.service.conversion.units import KGF
from jointstiff.service.importing.deflections import (
    Deflection,
    add_deflections,
    list_displacement_columns,
    list_lone_displacements,
)
from jointstiff.service.importing.errors import NOWHERE, ImportFileError, quote
from jointstiff.service.importing.grammar import Vocabulary, is_in_kg
from jointstiff.service.importing.joining import join_tables, label_by_joints
from jointstiff.service.importing.legends import find_legend
from jointstiff.service.importing.lengths import convert_columns, unify_lengths
from jointstiff.service.importing.loads import find_newtons
from jointstiff.service.importing.naming import (
    NamedReading,
    are_distinct,
    find_unknown_words,
    find_words_against_order,
    list_state_words,
    name_readings,
)
from jointstiff.service.importing.numbers import (
    GridReader,
    NumberFiles,
    NumberTable,
    read_number_tables,
    read_tables,
)
from jointstiff.service.importing.polar import list_cartesian
from jointstiff.service.importing.reading import SourceFile, Understood, understand_files
from jointstiff.service.importing.rewriting import (
    has_column_of,
    list_masses,
    note_mean_of_joints,
    write_deflections,
    write_readings,
)
from jointstiff.service.importing.stencils import read_stencils
from jointstiff.service.importing.uncertainties import add_uncertainties
from jointstiff.service.importing.unread import (
    advise_on_files_without_rows,
    describe_turned_table,
)
from jointstiff.service.resources.columns_left import (
    ColumnsLeft,
    confirms_joints,
    describe_likely_force,
    find_contradiction,
    leave_positions,
    list_columns_left,
    list_other_columns,
    list_unexplained_numbers,
    name_columns_left,
    refuse_columns_left,
    refuse_force_beside_columns,
    refuse_single_rows,
    refuse_unknown_headers,
)
from jointstiff.service.resources.imports import ImportRefusedError, import_files, lack_meaning
from jointstiff.service.resources.named_forces import (
    name_forces,
    note_force,
    order_by_forces,
    read_forces,
    take_loads,
    take_stated_force,
)
from jointstiff.service.resources.no_proposal import NoProposalError, UnfinishedError, UnreadError
from jointstiff.service.resources.nominal_positions import refuse_measured_nominals
from jointstiff.service.resources.previews import preview_tables
from jointstiff.service.resources.repeated_postures import refuse_repeated_postures
from jointstiff.service.resources.workbook_sheets import list_choices, may_have_readings
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.meaning.hypotheses import list_countings
from jointstiff.solver.meaning.proposal import Proposal, propose
from jointstiff.solver.meaning.refinement import FramePlacement
from jointstiff.solver.meaning.table import METRES, AngleUnit, JointColumns
from jointstiff.solver.meaning.words import describe, join, remark
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

OPTIONS_OF_NAMES: Final = ("state", "point_name", "file_name", "state_words")
"""Options that explain names of points, files and states, which the written table does not need either."""

OPTIONS_OF_FILES: Final = (
    *("columns", "header", "ignore", "delimiter", "decimal_mark", "by_order"),
    *("state", "state_words", "point_name", "sheet"),
)
"""Options that a template keeps of files that a proposal explains."""

_SAME_WEIGHT: Final = 0.02
"""Largest difference of a stated force and the weight of a column of masses, as a part of the weight."""
_LARGEST_WORSENING: Final = 3.0
"""Largest ratio of the residuals of files and of those of their template."""
_CLEARLY_FARTHER: Final = 2.0
"""Ratio of the distances to positions without and under load from which a reading is one under load."""
_LARGEST_REMAINDER: Final = 0.25
"""Largest distance of positions after unloading from those before, as a part of that from those under load,
if no name says that the load was taken off."""
_LARGEST_TURN: Final = 2.2 * np.pi
"""Largest joint that is measured [rad]: larger numbers are degrees."""
_LEAST_WITHIN: Final = 0.5
"""Least fraction of the postures within the limits of joints that may be in radians."""
_MOST_SKIPPED: Final = 6
"""Missing readings that a sentence names."""
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
    meaning: TableMeaning | None  # for a template; None without positions
    notes: tuple[str, ...] = ()  # what a person should know of rows and columns
    masses: tuple[SourceFile, ...] = ()  # files with the masses of the robot's bodies
    previews: tuple[FilePreview, ...] = ()  # of the files as they are written
    originals: tuple[SourceFile, ...] = ()  # files as they were sent
    statement: str = ""  # the proposal in words, if it has no positions that the robot could fit
    likely_force: str = ""  # end of a sentence on columns that may be the load

    @property
    def files(self) -> list[SourceFile]:
        """Files to import in place of those of the readings."""
        return [self.table, *self.masses]

    @property
    def sentence(self) -> str:
        """The proposal in words, and what a person should know about its fit, its rows and its columns."""
        if self.statement:
            return "; ".join(each for each in (self.statement, *self.notes) if each)
        text, note = describe(self.proposal, [each.words for each in self.named]), remark(self.proposal)
        return "; ".join(each for each in (text, note, *self.notes) if each)

    @property
    def text(self) -> str:
        """The proposal in words, with the question that the numbers cannot decide."""
        doubt = self.proposal.doubt
        return f"{self.sentence}. Undecided: {doubt}." if doubt else f"{self.sentence}."

    @property
    def known(self) -> KnownRobot:
        """Robot that fits."""
        return self.proposal.robots[0]

    def add_note(self, note: str) -> ProposedImport:
        """Return the proposal with a note on what the files state."""
        return replace(self, notes=(*self.notes, note))

    def find_fault(self) -> ImportFileError | None:
        """Return the first fault of the table with the proposed meaning; None if a person can accept it."""
        faults = self._understand().faults
        return faults[0] if faults else None

    def _understand(self) -> Understood:
        """Read the table with the proposed meaning."""
        return understand_files(self.files, self.request, self.known.robot.joint_names)

    def skip_missing(self) -> ProposedImport | None:
        """Return the proposal without readings that are missing or incomplete, which a note names.

        None if something else is wrong with the table, or most readings are missing.
        """
        request = self.request.model_copy(update={"allow_missing": True})
        skipping = replace(self, request=request)
        understood = skipping._understand()
        if understood.faults or len(understood.skipped) > understood.preview.reading_count:
            return None
        return replace(skipping, notes=(*self.notes, _describe_skipped(understood.skipped)))

    def accept(self, request: ImportRequest | None = None) -> ImportAnswer:
        """Import the table as the proposal says; `request` has other statements about the readings."""
        robot = self.known.robot
        answer = import_files(
            self.files,
            request or self.request,
            robot,
            originals=self.originals,
            likely_force=self.likely_force,
        )
        assumptions = [self.sentence, *answer.assumptions]
        return answer.model_copy(update={"assumptions": assumptions, "files": list(self.previews)})


def _describe_skipped(sentences: Sequence[str]) -> str:
    """Return a note on readings that are left out, which names the first of them."""
    count = len(sentences)
    counted = "1 reading is" if count == 1 else f"{count} readings are"
    others = f" and {count - _MOST_SKIPPED} more" if count > _MOST_SKIPPED else ""
    return f"{counted} missing or incomplete ({', '.join(sentences[:_MOST_SKIPPED])}{others})"


@dataclass(frozen=True)
class NoProposal:
    """Reason why no robot has a proposal for the meaning of files."""

    reason: str
    remedy: str = ""  # what to do, if the robot explains some columns and the others must be stated
    fault: ImportFileError | None = None  # that an option of the import removes, so that a person can answer

    def add_note(self, note: str) -> NoProposal:
        """Return this reason with a note on what the files state."""
        return replace(self, reason=f"{self.reason}; {note}")


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
    found = _propose_or_decline(files, request, known, template)
    legend = find_legend(files, _list_open_words(found)) if template is None else None
    if legend is None:
        return found
    stated = request.model_copy(update={"state_words": {**request.state_words, **legend.states}})
    return _propose_or_decline(files, stated, known, template).add_note(legend.note)


def _list_open_words(found: ProposedImport | NoProposal) -> Sequence[str]:
    """Return the words of files that may be states, and that no name explains; () without such words."""
    if isinstance(found, NoProposal):
        is_question = found.fault is not None and found.fault.option == "state_words"
        return found.fault.words if found.fault is not None and is_question else ()
    by_order = [each for each in found.named if each.is_by_order]
    return list_state_words(by_order) if by_order else ()


def _propose_or_decline(
    files: Sequence[SourceFile],
    request: ImportRequest,
    known: Sequence[KnownRobot],
    template: TableMeaning | None,
) -> ProposedImport | NoProposal:
    """Return the proposal of the robots, or why there is none; arguments as of `propose_import`."""
    try:
        try:
            return _propose_tables(files, request, known, template)
        except UnreadError as error:
            if template is not None:
                raise
            return _propose_by_stencils(files, request, known, error)
    except NoProposalError as error:
        return NoProposal(error.reason, error.remedy, error.fault)


def _propose_tables(
    files: Sequence[SourceFile],
    request: ImportRequest,
    robots: Sequence[KnownRobot],
    template: TableMeaning | None,
) -> ProposedImport:
    """Return the proposal of the robots for the tables of files; arguments as of `propose_import`.

    Raises:
        NoProposalError: no meaning fits, or a person cannot accept the meaning that fits.
    """
    try:
        return _propose(files, request, robots, template)
    except NoProposalError as error:
        is_sheet_open = error.fault is not None and error.fault.option == "sheet"
        if not is_sheet_open or request.sheet is not None:
            raise
        return _propose_by_sheets(files, request, robots, error)


def _propose_by_stencils(
    files: Sequence[SourceFile],
    request: ImportRequest,
    robots: Sequence[KnownRobot],
    unread: UnreadError,
) -> ProposedImport:
    """Return the proposal for the repeated places of files, whose rows or columns are the postures.

    `unread` is the error that no table of the files has a meaning.

    Raises:
        NoProposalError: no meaning fits, or a person cannot accept the meaning that fits.
    """
    for are_turned in (False, True):
        try:
            return _propose(files, request, robots, read=partial(read_stencils, are_turned=are_turned))
        except UnfinishedError:
            raise
        except (NoProposalError, ImportFileError):
            continue
    lacking = _propose_lacking_lines(files, request, robots)
    if lacking is None:
        raise unread
    return lacking


def _propose_lacking_lines(
    files: Sequence[SourceFile], request: ImportRequest, robots: Sequence[KnownRobot]
) -> ProposedImport | None:
    """Return the proposal for repeated places that some blocks, sheets or objects lack; None without one.

    Raises:
        UnfinishedError: there is such a proposal, and the request does not accept a proposal.
    """
    if request.allow_missing:
        return None
    try:
        proposed = _propose(files, request, robots, read=partial(read_stencils, may_lack_lines=True))
    except (NoProposalError, ImportFileError):
        return None
    if request.accept_proposal:
        return replace(proposed, notes=(*proposed.notes, "a posture lacks lines that the others have"))
    raise UnfinishedError(
        f"{proposed.sentence}, but a posture lacks lines that the others have",
        "complete this posture, or use `allow_missing` to leave out what is missing",
    )


def _propose(
    files: Sequence[SourceFile],
    request: ImportRequest,
    robots: Sequence[KnownRobot],
    template: TableMeaning | None = None,
    read: GridReader = read_tables,
) -> ProposedImport:
    """Return the proposal of the robots for files; arguments as of `propose_import`.

    `read` reads a file as tables.

    Raises:
        NoProposalError: no meaning fits, or a person cannot accept the meaning that fits.
    """
    names = robots[0].robot.joint_names if len(robots) == 1 else ()
    numbers = _read_numbers(files, request, names, read)
    if template is None:
        proposed = _propose_polar(numbers, request, robots, names) or _propose_importable(
            numbers, request, robots
        )
    else:
        proposed = _propose_as_template(numbers.tables, request, robots, template)
    return replace(proposed, masses=numbers.masses, originals=tuple(files))


def _propose_polar(
    numbers: _Numbers, request: ImportRequest, robots: Sequence[KnownRobot], joints: Sequence[str]
) -> ProposedImport | None:
    """Return the proposal for polar readings by the only convention that fits the robot; None without one.

    The other sense of the horizontal angles mirrors the frame, which fits the robot with reversed joints: the
    joints have the robot's own counting.

    Raises:
        UnfinishedError: a convention fits, but a person must state more.
    """
    fitting, unfinished = list[ProposedImport](), list[UnfinishedError]()
    for tables, note in list_cartesian(numbers.files.tables):
        try:
            joined = _join(numbers.files, unify_lengths(tables), request, joints)
            proposed = _propose_importable(joined._replace(notes=[*joined.notes, note]), request, robots)
        except UnfinishedError as error:
            unfinished.append(error)
        except NoProposalError:
            continue
        else:
            found = proposed.proposal
            if proposed.named and found.joints.counting.is_own and not found.frame.is_mirrored:
                fitting.append(proposed)
    if len(fitting) == 1:
        return fitting[0]
    if unfinished and not fitting:
        raise unfinished[0]
    return None


def _propose_by_sheets(
    files: Sequence[SourceFile],
    request: ImportRequest,
    robots: Sequence[KnownRobot],
    question: NoProposalError,
) -> ProposedImport:
    """Return the proposal for those sheets of a workbook whose numbers fit the robot.

    A sheet that may have readings of the postures is never left out. `question` is the error that asks for
    the sheets.

    Raises:
        NoProposalError: no choice of sheets has a proposal.
    """
    unfinished: UnfinishedError | None = None
    names = () if question.fault is None else question.fault.words
    for choice in list_choices(names, is_robot_stated=len(robots) == 1):
        try:
            proposed = _propose(files, choice.state_in(request), robots)
            if proposed.named and not may_have_readings(choice, proposed.proposal, files, request):
                return replace(proposed, notes=(choice.note, *proposed.notes))
        except UnfinishedError as error:
            unfinished = unfinished or error
        except (NoProposalError, ImportFileError):
            continue
    raise unfinished or question


def _propose_importable(
    numbers: _Numbers, request: ImportRequest, robots: Sequence[KnownRobot]
) -> ProposedImport:
    """Return the proposal of the robots for tables of numbers; a person can accept it.

    Raises:
        NoProposalError: no meaning fits, or the import refuses the table with the proposed meaning.
    """
    try:
        found_meaning = _find_in_one_unit(numbers, request, robots)
    except NoProposalError:
        alone = _propose_deflections(numbers, request, robots)
        if alone is None:
            raise
        return alone
    try:
        labelled = _label_by_joints(found_meaning, request, robots[0].robot.joint_names)
        if labelled is not None:
            found_meaning = _find_in_one_unit(labelled, request, robots)
        return _complete(found_meaning, request)
    except NoProposalError as error:
        raise UnfinishedError(error.reason, error.remedy, error.fault) from error


def _complete(found_meaning: _FoundMeaning, request: ImportRequest) -> ProposedImport:
    """Return the proposal with names of targets and states, and with the load.

    Raises:
        NoProposalError: a person must state more, or the import refuses the table with the proposed meaning.
    """
    numbers, proposal = found_meaning.numbers, found_meaning.proposal
    tables, load_notes = take_loads(proposal, numbers.tables, request)
    named = name_readings(proposal, tables, request)
    _refuse_contradiction(proposal, named, tables)
    _refuse_repeats_without_names(proposal, named)
    _refuse_order_against_words(proposal, named)
    _refuse_loaded_after_unloading(named)
    _refuse_states_against_force(proposal, named, tables, request)
    tables, request, force_notes = take_stated_force(proposal, named, tables, request)
    if not force_notes:
        tables, force_notes = name_forces(proposal, named, tables, request)
    _refuse_unknown_words(proposal, named, tables, request)
    words = Vocabulary(request, proposal.robots[0].robot.joint_names)
    named = add_uncertainties(named, tables, words, proposal.unit)
    left = list_columns_left(proposal, tables, named)
    joints = next(table for table in tables if table.name == proposal.joints.table)
    notes = [*numbers.notes, *load_notes, *force_notes, *note_force(joints), *_note_uncertainties(named)]
    confirming = [each for each in left if confirms_joints(each.table, proposal, joints)]
    unread = [each for each in left if each not in confirming]
    notes += [*note_mean_of_joints(proposal, joints), *name_columns_left(unread, tables, request.state_words)]
    notes += [f"{each.table.name} has the same joints" for each in confirming]
    try:
        refuse_single_rows(proposal, tables)
        refuse_columns_left(left, proposal, named, tables)
        refuse_measured_nominals(proposal, named, tables)
        refuse_repeated_postures(proposal, named, tables, request)
        refuse_force_beside_columns(left, request, joints)
        proposed = _build_import(proposal, named, tables, request, notes)
    except ImportFileError as error:
        found = describe(proposal, [each.words for each in named])
        raise NoProposalError(f"{found}, but {error.reason}", error.remedy, error) from error
    proposed = replace(proposed, likely_force=describe_likely_force(left))
    fault = proposed.find_fault()
    if fault is not None and fault.option == "allow_missing" and _have_same_states(named):
        _refuse_damaged_numbers(proposal, tables)
        complete = proposed.skip_missing()
        if complete is not None:
            return complete
    if fault is not None:
        are_cells_missing = fault.option == "allow_missing" and _have_same_states(named)
        is_unit_missing = (fault.option or "").startswith("units.")
        remedy = fault.remedy if are_cells_missing or is_unit_missing else ""
        reason = f"{proposed.sentence}, but the import of these columns is refused: {fault.reason}"
        raise NoProposalError(reason, remedy, fault)
    return proposed


def _propose_deflections(
    numbers: _Numbers, request: ImportRequest, robots: Sequence[KnownRobot]
) -> ProposedImport | None:
    """Return the proposal for displacements under load without positions; None of other tables.

    No position shows whether the joints are right, so that headers have to name them, and one robot is
    stated.

    Raises:
        NoProposalError: no header names the joints, the unit of the displacements is not clear, or the
            targets move against the force.
    """
    if len(robots) != 1:
        return None
    known = robots[0]
    found = _find_lone_deflections(numbers.tables, request, known)
    if found is None:
        return None
    joints, deflections = found.joints, found.deflections
    _refuse_deflections_against_force(joints, deflections, request)
    unit = _find_unit_of_joints(found, known, request)
    columns = JointColumns(joints.name, joints.table.joints, unit or "deg", list_countings(known.robot)[0])
    frame = FramePlacement(np.eye(3), np.zeros(3), METRES["mm"])
    proposal = Proposal((known,), columns, (), "mm", frame, math.nan, math.inf, fitting=0, count=0)
    targets = join([each.target for each in deflections])
    statement = (
        f"{joints.name} has joints by their names, and there are displacements under load of {targets} "
        "in axes of R0 without positions, which the robot cannot check"
    )
    options = request.model_copy(update={**_clear_headers(), **_clear_names(), "units": request.units})
    table = write_deflections(joints, unit, deflections)
    unread = name_columns_left(found.left, numbers.tables, request.state_words)
    notes = (*numbers.notes, *note_force(joints), *unread)
    return ProposedImport(proposal, (), table, options, None, notes, statement=statement)


class _LoneDeflections(NamedTuple):
    """Joints that headers name, and displacements under load without positions."""

    joints: NumberTable
    deflections: Sequence[Deflection]
    left: Sequence[ColumnsLeft]  # other columns

    @property
    def row_count(self) -> int:
        """Rows of each posture in the table of joints."""
        return len(self.joints.rows) // len(self.deflections[0].shifts)

    @property
    def angles(self) -> FloatArray:
        """Joints (N, n) of the postures as they are written."""
        return self.joints.table.numbers[:: self.row_count, list(self.joints.table.joints)]


def _find_lone_deflections(
    tables: Sequence[NumberTable], request: ImportRequest, known: KnownRobot
) -> _LoneDeflections | None:
    """Return joints and displacements of tables that have no other numbers; None of other tables.

    Raises:
        NoProposalError: no header names the joints, or the unit of the displacements is not clear.
    """
    words = Vocabulary(request, known.robot.joint_names)
    left = [_list_without_positions(table, words) for table in tables]
    count_left = sum(len(list_unexplained_numbers(each)) for each in left)
    with_joints = [table for table in tables if table.table.joints]
    may_be_joints = not with_joints and count_left == known.robot.n
    if count_left and not may_be_joints:
        return None
    try:
        deflections = list_lone_displacements(tables, words)
    except ImportFileError as fault:
        raise _describe_fault(fault) from fault
    if deflections and may_be_joints:
        raise NoProposalError(
            "there are displacements under load without positions, so that the robot cannot find the joints",
            "name the joints in the headers, such as `J1 [deg]`, or all columns by `header`",
        )
    counts = {len(each.shifts) for each in deflections}
    has_each_target_once = len({each.target for each in deflections}) == len(deflections)
    if len(with_joints) != 1 or len(counts) != 1 or not has_each_target_once:
        return None
    found = _LoneDeflections(with_joints[0], deflections, left)
    return found if len(with_joints[0].rows) == found.row_count * counts.pop() else None


def _list_without_positions(table: NumberTable, words: Vocabulary) -> ColumnsLeft:
    """Return the columns of a table that are neither joints nor displacements by their headers."""
    read = {*table.table.joints, *list_displacement_columns(table, words)}
    return list_other_columns(table, read)


def _find_unit_of_joints(
    found: _LoneDeflections, known: KnownRobot, request: ImportRequest
) -> AngleUnit | None:
    """Return the unit of joints that headers or the request state, or that numbers and limits leave.

    None if the joints may be in both units.
    """
    meanings = [found.joints.meanings[column] for column in found.joints.table.joints]
    stated = {meaning.unit for meaning in meanings if meaning is not None}
    if request.units is not None and stated == {None}:
        stated = {request.units.angle}
    if stated != {None}:
        units: dict[str | None, AngleUnit] = {"deg": "deg", "rad": "rad"}
        return units.get(next(iter(stated))) if len(stated) == 1 else None
    if np.abs(found.angles).max() > _LARGEST_TURN:
        return "deg"
    is_within_as_radians = np.mean(known.robot.within_limits(found.angles)) >= _LEAST_WITHIN
    return None if is_within_as_radians else "deg"


def _refuse_deflections_against_force(
    table: NumberTable, deflections: Sequence[Deflection], request: ImportRequest
) -> None:
    """Refuse displacements without positions against the force: no springs move so, whatever their stiffness.

    Raises:
        NoProposalError: the work of the force is negative in most postures.
    """
    count = len(deflections[0].shifts)
    forces = read_forces(table)
    if forces is not None:
        forces = forces[:: len(table.rows) // count]
    elif request.force is not None:
        forces = np.tile(np.array(request.force), (count, 1))
    else:
        return
    work = np.array([np.einsum("ni,ni->n", forces, each.shifts) for each in deflections])
    if float(np.nansum(work)) < 0.0:
        raise NoProposalError(
            "the targets move against the force",
            "write displacements as loaded minus unloaded in axes of R0, or correct the sign of `force`",
        )


def _refuse_damaged_numbers(proposal: Proposal, tables: Sequence[NumberTable]) -> None:
    """Refuse a coordinate with digits that are no number: only an empty cell, or one with words, is missing.

    Raises:
        NoProposalError: a cell of a position has such digits.
    """
    for table in tables:
        columns = {
            column
            for reading in proposal.readings
            if reading.points.table == table.name
            for column in reading.points.columns
        }
        is_unread = np.isnan(table.table.numbers)
        for number, row in enumerate(table.rows):
            for column in sorted(columns):
                text = row.cells[column]
                if is_unread[number, column] and any(map(str.isdigit, text)):
                    place = table.grid.place(row, column)
                    raise NoProposalError(f"{place}: {quote(text)} is no number", "correct the cell")


def _have_same_states(named: Sequence[NamedReading]) -> bool:
    """Return whether all targets were read in the same states, so that only cells can be missing."""
    states_of_target: dict[str, set[str]] = {}
    for each in named:
        states_of_target.setdefault(each.target, set()).add(each.state)
    return len({frozenset(states) for states in states_of_target.values()}) == 1


def _label_by_joints(
    found_meaning: _FoundMeaning, request: ImportRequest, names: Sequence[str]
) -> _Numbers | None:
    """Return the numbers with the rows of a posture in turn, if the joints that were found tell the postures.

    None if the rows are in turn, or if the joints do not tell the postures. `names` are those of the joints.

    Raises:
        NoProposalError: rows of a posture do not fit each other.
    """
    numbers, joints = found_meaning.numbers, found_meaning.proposal.joints
    table = next(table for table in numbers.tables if table.name == joints.table)
    if joints.groups.count == len(table.turn):
        return None
    labelled = label_by_joints(numbers.separate, joints, request)
    if labelled is None:
        return None
    joined = _join(numbers.files, labelled, request, names)
    return joined._replace(notes=[*joined.notes, "rows with the same joints are one posture"])


class _FoundMeaning(NamedTuple):
    """Meaning of the columns by the robot that fits, and the numbers in one unit."""

    numbers: _Numbers
    proposal: Proposal


def _find_in_one_unit(
    numbers: _Numbers, request: ImportRequest, robots: Sequence[KnownRobot]
) -> _FoundMeaning:
    """Return the meaning of tables; columns that are not read are tried in metres or mm, as the others are.

    Raises:
        NoProposalError: no robot fits, several meanings fit alike, or the request states other units.
    """
    proposal = _find_proposal(numbers.tables, request, robots)
    left = list_columns_left(proposal, numbers.tables)
    named = name_readings(proposal, numbers.tables, request)
    if not leave_positions(left, named):
        return _FoundMeaning(numbers, proposal)
    converted, names = list(numbers.tables), list[str]()
    for position, each in enumerate(left):
        columns = list_unexplained_numbers(each)
        table = convert_columns(each.table, columns, proposal.unit) if columns else None
        if table is not None:
            converted[position] = table
            names.append(each.table.name)
    if not names:
        return _FoundMeaning(numbers, proposal)
    again = propose([each.table for each in converted], robots).best
    if again is None or len(again.readings) <= len(proposal.readings):
        return _FoundMeaning(numbers, proposal)
    other_unit = "m" if proposal.unit == "mm" else "mm"
    note = f"the other positions of {', '.join(names)} converted from {other_unit}"
    in_one_unit = numbers._replace(tables=converted, notes=[*numbers.notes, note])
    return _FoundMeaning(in_one_unit, order_by_forces(again, converted, request))


def _refuse_contradiction(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable]
) -> None:
    """Refuse a proposal that contradicts what the caller states of columns.

    Raises:
        NoProposalError: a stated column has another meaning, or is not read.
    """
    contradiction = find_contradiction(proposal, named, tables)
    if contradiction:
        remedy = "correct `columns`, or leave the statement out"
        raise NoProposalError(contradiction, remedy)


def _refuse_repeats_without_names(proposal: Proposal, named: Sequence[NamedReading]) -> None:
    """Refuse repeated readings of a target in one state, if the order gives some of them this state.

    Raises:
        NoProposalError: there are such positions: the order of repeats tells no state.
    """
    if are_distinct(named) or not any(each.is_by_order for each in named):
        return
    most = max(Counter(each.target for each in named).items(), key=lambda item: item[1])
    raise NoProposalError(
        f"{describe(proposal, [each.words for each in named])} by their order, but {most[0]} has {most[1]} "
        "positions in a posture, and no names of postures and states tell which of them are repeats",
        "name the posture of each row in a column with the header `label`, and state or load in another one",
    )


def _refuse_loaded_after_unloading(named: Sequence[NamedReading]) -> None:
    """Refuse positions after unloading that are not clearly nearer to those before than to those under load.

    Where names state the positions, those after unloading may be far from those before, but not farther.

    Raises:
        NoProposalError: a target has such positions: of a second load, of the same load, or nominal ones.
    """
    positions = {(each.target, each.state): each.reading.positions for each in named}
    for each in named:
        unloaded = positions.get((each.target, "unloaded"))
        loaded = positions.get((each.target, "loaded"))
        if each.state != "unloaded_after" or unloaded is None or loaded is None:
            continue
        to_loaded, to_unloaded = (
            float(np.nanmedian(np.linalg.norm(each.reading.positions - other, axis=1)))
            for other in (loaded, unloaded)
        )
        ratio = _LARGEST_REMAINDER if each.is_by_order else _CLEARLY_FARTHER
        if to_unloaded > ratio * to_loaded or _is_first_loaded(each, named):
            raise NoProposalError(
                f"the third positions of {each.target} are {1e3 * to_unloaded:.2g} mm from the first, and "
                f"{1e3 * to_loaded:.2g} mm from the second, so that headers must name the states",
                "write states or loads in the headers (`header`) or in a column, such as `X 50 kg`, or leave "
                "columns out with `ignore`",
            )


def _is_first_loaded(after: NamedReading, named: Sequence[NamedReading]) -> bool:
    """Return whether forces alone make the first of three positions of a target the one under load."""
    own = [each for each in named if each.target == after.target]
    states = [each.state for each in own]
    are_by_order = all(each.is_by_order for each in own)
    return are_by_order and states.index("loaded") < states.index("unloaded")


def _propose_as_template(
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
    proposal = _find_proposal(tables, request, robots)
    tables, load_notes = take_loads(proposal, tables, request)
    reasons = []
    for order in _TURNS_OF_AXES:
        turned = proposal.with_axes(order)
        named = _name_by_template(name_readings(turned, tables, request), template)
        reason = _find_difference(_build_meaning(turned, named, tables), template)
        if not reason:
            words = Vocabulary(request, turned.robots[0].robot.joint_names)
            named = add_uncertainties(named, tables, words, turned.unit)
            tables, notes = name_forces(turned, named, tables, request)
            return _build_import(turned, named, tables, request, [*load_notes, *notes])
        reasons.append(reason)
    raise NoProposalError(reasons[0])


def _find_proposal(
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
    return order_by_forces(found.best, tables, request)


def _build_import(
    proposal: Proposal,
    named: Sequence[NamedReading],
    tables: Sequence[NumberTable],
    request: ImportRequest,
    notes: Sequence[str] = (),
) -> ProposedImport:
    """Return a proposal with the table that the import understands, and the options left for this table.

    Options about columns are left out, because the written table has headers that explain its columns.

    Args:
        proposal: meaning of the columns by the robot that fits.
        named: names of targets and states of the positions.
        tables: numbers of the files.
        request: options of the import of the files.
        notes: what a person should know of rows and columns.

    Raises:
        ImportFileError: readings under several loads have one force.
    """
    with_masses = _has_masses(proposal, named, tables, request)
    table = write_readings(proposal, named, tables, with_masses=with_masses)
    options = request.model_copy(update={**_clear_headers(), **_clear_names(), **_state_units(request)})
    meaning = _build_meaning(proposal, named, tables)
    if with_masses:
        notes = (*notes, _describe_weights(list_masses(named)))
    if with_masses and len(list_masses(named)) > 1:
        notes = (*notes, "each load is an observation, with the same readings without load")
    previews = tuple(preview_tables(proposal, named, tables, request.state_words))
    return ProposedImport(proposal, tuple(named), table, options, meaning, tuple(notes), previews=previews)


def _describe_weights(masses: Iterable[float | None]) -> str:
    """Return the forces that are taken of loads [kg] in names, in words."""
    forces = [f"loaded {mass:g} kg: force 0, 0, −{KGF * mass:.4g} N" for mass in masses if mass is not None]
    return ", ".join(forces)


def _has_masses(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> bool:
    """Return whether the loads that names state are the masses of the readings.

    A force that the caller or a column states takes precedence for one load.

    Raises:
        ImportFileError: several loads have one force, or a column of masses has another one.
    """
    masses = list_masses(named)
    joints = next(table for table in tables if table.name == proposal.joints.table)
    has_force = request.force is not None or has_column_of(joints, "force")
    if request.force is not None and (len(masses) > 1 or _differs_from_mass(masses, joints, request)):
        listed = " and ".join("another load" if mass is None else f"{mass:g} kg" for mass in masses)
        reason = f"there are readings under {listed}, and `force` states one force for all"
        if len(masses) == 1:
            reason = f"there are readings under {listed}, and `force` is not this weight"
        raise ImportFileError(NOWHERE, reason, "omit `force`: the masses are those of the files", "force")
    return None not in masses and bool(masses) and not has_force


def _differs_from_mass(masses: Sequence[float | None], joints: NumberTable, request: ImportRequest) -> bool:
    """Return whether the stated force is not the weight of the one mass of a column in kg."""
    unit = None if request.units is None else request.units.force
    has_column = any(map(is_in_kg, joints.headers)) and any(name.mass for name in joints.turn)
    mass = masses[0] if masses else None
    if not has_column or mass is None or request.force is None or unit is None:
        return False
    weight = KGF * mass
    stated = find_newtons(unit) * float(np.linalg.norm(request.force))
    return abs(stated - weight) > _SAME_WEIGHT * weight


class _Numbers(NamedTuple):
    """Tables of numbers with their rows in one order."""

    tables: Sequence[NumberTable]
    notes: Sequence[str]  # what a person should know of the rows
    masses: tuple[SourceFile, ...]  # files with the masses of the robot's bodies
    files: NumberFiles  # as they were read
    separate: Sequence[NumberTable]  # with their rows in the order of the files


def _read_numbers(
    files: Sequence[SourceFile], request: ImportRequest, joints: Sequence[str], read: GridReader
) -> _Numbers:
    """Return the tables of numbers of the files with their rows in one order.

    `joints` are names of joints, and `read` reads a file as tables.

    Raises:
        NoProposalError: a file cannot be read or has no rows of numbers, or names of rows or headers do not
            fit.
    """
    try:
        found = read_number_tables(files, request, joints, read)
    except ImportFileError as fault:
        is_settled_by_option = fault.option is not None
        kind = UnreadError if fault.is_of_document or fault.option == "sheet" else NoProposalError
        if is_settled_by_option:
            raise kind(str(fault), fault=fault) from fault
        raise _describe_fault(fault, kind) from fault
    if not found.tables:
        raise UnreadError("the files have no rows of numbers")
    if found.without:
        reason = f"{', '.join(found.without)} has no rows of numbers"
        raise UnreadError(reason, advise_on_files_without_rows(files, found.without))
    try:
        refuse_unknown_headers(found.tables, request)
    except ImportFileError as fault:
        raise _describe_fault(fault) from fault
    return _join(found, unify_lengths(found.tables), request, joints)


def _join(
    found: NumberFiles, tables: Sequence[NumberTable], request: ImportRequest, joints: Sequence[str]
) -> _Numbers:
    """Return tables of files with their rows in one order; `joints` are names of joints.

    Raises:
        NoProposalError: names of rows or headers do not fit.
    """
    try:
        joined = join_tables(tables, request)
        arranged, notes = add_deflections(joined.tables, Vocabulary(request, joints))
    except ImportFileError as fault:
        raise _describe_fault(fault) from fault
    return _Numbers(arranged, [*found.notes, *joined.notes, *notes], found.masses, found, tables)


def _describe_fault(fault: ImportFileError, kind: type[NoProposalError] = NoProposalError) -> NoProposalError:
    """Return the error, of a kind, that a fault of files, at its place, forbids a proposal."""
    place = "" if fault.place == NOWHERE else f"{fault.place}: "
    return kind(f"{place}{fault.reason}", fault.remedy, fault)


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
        if request.accept_proposal and lack_meaning(files, request, robot.robot):
            return _import_by_proposal(files, request, robot)
        raise
    proposed: ProposedImport | NoProposal | None
    if is_in_another_frame(answer):
        proposed = propose_frame(files, request, robot, answer)
    elif answer.faults and lack_meaning(files, request, robot.robot):
        proposed = propose_import(files, request, [robot])
    else:
        return answer
    if proposed is None or isinstance(proposed, NoProposal):
        return answer.model_copy(update={"proposal": None})
    if request.accept_proposal:
        return _accept_proposal(proposed)
    return answer.model_copy(update={"proposal": proposed.text})


def is_in_another_frame(answer: ImportAnswer) -> bool:
    """Return whether names explain files whose positions are in another frame than R0."""
    return any(finding.code == "frame_mistaken" for finding in answer.findings or ())


def propose_frame(
    files: Sequence[SourceFile], request: ImportRequest, robot: KnownRobot, answer: ImportAnswer
) -> ProposedImport | None:
    """Propose the frame of positions that names explain; None unless nothing but the frame changes.

    Args:
        files: files of readings.
        request: options of the import.
        robot: robot that was measured.
        answer: import of the files by the names of their columns, with a measurement set.
    """
    proposed = propose_import(files, request, [robot])
    if isinstance(proposed, NoProposal) or proposed.proposal.doubt or answer.measurement_set is None:
        return None
    turned = proposed.accept().measurement_set
    if turned is None or not _have_same_readings(turned, answer.measurement_set):
        return None
    return proposed


def _have_same_readings(turned: MeasurementSetDocument, by_names: MeasurementSetDocument) -> bool:
    """Return whether two sets have the same joints, forces and shifts under load, in different frames."""
    observations = list(zip(turned.observations, by_names.observations, strict=False))
    if len(turned.observations) != len(by_names.observations):
        return False
    length = METRES[turned.units.length] / METRES[by_names.units.length]
    for own, named in observations:
        own_shifts, named_shifts = _measure_shifts(own), _measure_shifts(named)
        if own.force != named.force or len(own_shifts) != len(named_shifts):
            return False
        if not np.allclose(own.joints, named.joints, atol=1e-6):
            return False
        if not np.allclose(length * own_shifts, named_shifts, rtol=1e-3, atol=1e-6):
            return False
    return True


def _measure_shifts(observation: Observation) -> FloatArray:
    """Return the distances (N,) between the positions with and without load, in the order of readings."""
    positions = [(each.unloaded, each.loaded) for each in observation.readings]
    known = [(first, second) for first, second in positions if first is not None and second is not None]
    return np.array([np.linalg.norm(np.subtract(second, first)) for first, second in known])


def _import_by_proposal(
    files: Sequence[SourceFile], request: ImportRequest, robot: KnownRobot
) -> ImportAnswer:
    """Import files that names do not explain by the proposal of the robot.

    Raises:
        ImportRefusedError: there is no proposal.
    """
    proposed = propose_import(files, request, [robot])
    if isinstance(proposed, ProposedImport):
        return _accept_proposal(proposed)
    if proposed.remedy:
        raise ImportRefusedError([ImportFileError(NOWHERE, proposed.reason, proposed.remedy)])
    return import_files(files, request, robot.robot)


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


def _clear_names() -> dict[str, object]:
    """Return the options that explain names of points, files and states, with their defaults."""
    empty = ImportRequest()
    return {name: getattr(empty, name) for name in OPTIONS_OF_NAMES}


def _state_units(request: ImportRequest) -> dict[str, object]:
    """Return the units of forces and moments, which the written table may leave open."""
    if request.units is None:
        return {}
    return {"units": request.units.model_copy(update={"length": None, "angle": None})}


def _refuse_states_against_force(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> None:
    """Refuse states by the order of positions that move against the force that the request states.

    Raises:
        NoProposalError: the first positions may be those under load, or the force has the wrong sign.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    if request.force is None or read_forces(joints) is not None:
        return
    by_order = [each for each in named if each.target in {own.target for own in named if own.is_by_order}]
    positions = {(each.target, each.state): each.reading.positions for each in by_order}
    work = 0.0
    for target in {each.target for each in by_order}:
        if (target, "unloaded") in positions and (target, "loaded") in positions:
            deflections = positions[target, "loaded"] - positions[target, "unloaded"]  # (N, 3)
            work += float(np.nansum(deflections @ np.array(request.force)))
    if work >= 0.0:
        return
    found = describe(proposal, [each.words for each in named])
    reason = f"{found}, but the targets then move against `force`"
    words = list_state_words(by_order)
    if words:
        raise _build_words_error(reason, words)
    remedy = (
        "name the states in the headers (`header`) or in the names of files; or correct the sign of `force`"
    )
    raise NoProposalError(reason, remedy)


def _refuse_order_against_words(proposal: Proposal, named: Sequence[NamedReading]) -> None:
    """Refuse states by the order of positions that words of headers, files or cells contradict.

    Raises:
        NoProposalError: a word may state another state.
    """
    words = find_words_against_order(named)
    if words:
        found = describe(proposal, [each.words for each in named])
        raise _build_words_error(f"{found} by their order, but words may state other states", words)


def _refuse_unknown_words(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> None:
    """Refuse states by the order of positions whose words are not known, if no force shows the states.

    Raises:
        NoProposalError: words may state other states than the order.
    """
    joints = next(table for table in tables if table.name == proposal.joints.table)
    is_shown_by_force = request.force is not None or read_forces(joints) is not None
    words = () if is_shown_by_force else find_unknown_words(named)
    if words:
        found = describe(proposal, [each.words for each in named])
        reason = f"{found} by their order, but the words {' and '.join(map(quote, words))} are not known"
        raise _build_words_error(reason, words, ("unloaded", "loaded"))


def _build_words_error(
    reason: str, words: Sequence[str], states: tuple[str, str] = ("loaded", "unloaded")
) -> NoProposalError:
    """Return the error that words of headers, files or cells may be the states of positions.

    `states` are the likely states of two words.
    """
    listed = " and ".join(map(quote, words))
    kind_of_words = "words for states" if len(words) > 1 else "a word for a state"
    pairs = list(zip(words, states if len(words) > 1 else ("loaded",), strict=False))
    in_order = tuple(word for word, _ in sorted(pairs, key=lambda pair: pair[1] != "unloaded"))
    examples = [f"{quote(word)} as `{state}`" for word, state in pairs]
    remedy = f"state what these words mean by `state_words`, such as {' and '.join(examples)}"
    fault = ImportFileError(NOWHERE, f"{listed} may be {kind_of_words}", remedy, "state_words", in_order)
    return NoProposalError(reason, remedy, fault)


def _note_uncertainties(named: Sequence[NamedReading]) -> list[str]:
    """Return the note that expanded uncertainties of the positions are read, if all have one."""
    are_read = all(each.uncertainty is not None for each in named)
    return ["U95 as expanded uncertainties of the positions"] if are_read else []


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
