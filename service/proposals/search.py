"""Search for the meaning of files whose columns have no known meaning: the robot proposes one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial

from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.meaning import TableMeaning
from jointstiff.service.importing.errors import ImportFileError, quote
from jointstiff.service.importing.formats.blocks import join_numbered_texts
from jointstiff.service.importing.grammar import find_state_in_name
from jointstiff.service.importing.legends import find_legend
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.proposals.completion import complete
from jointstiff.service.proposals.found_meaning import find_in_one_unit, tell_postures_by_joints
from jointstiff.service.proposals.joined_tables import (
    JoinedTables,
    describe_fault,
    join_numbers,
    read_numbers,
)
from jointstiff.service.proposals.lone_deflections import propose_deflections
from jointstiff.service.proposals.names.naming import list_state_words
from jointstiff.service.proposals.no_proposal import NoProposalError, UnfinishedError, UnreadError
from jointstiff.service.proposals.proposed_import import NoProposal, ProposedImport
from jointstiff.service.proposals.tables.lengths import unify_lengths
from jointstiff.service.proposals.tables.numbers import GridReader, NumberTable, read_tables
from jointstiff.service.proposals.tables.polar import list_cartesian
from jointstiff.service.proposals.tables.stencils import read_stencils
from jointstiff.service.proposals.templates import propose_as_template
from jointstiff.service.proposals.workbook_sheets import list_choices, may_have_readings
from jointstiff.solver.mechanics.robot import KnownRobot


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
    if template is None and isinstance(found, NoProposal):
        found = _propose_by_force(files, request, known, found) or found
    legend = find_legend(files, _list_open_words(found)) if template is None else None
    if legend is None:
        return found
    stated = request.model_copy(update={"state_words": {**request.state_words, **legend.states}})
    return _propose_or_decline(files, stated, known, template).add_note(legend.note)


def _propose_by_force(
    files: Sequence[SourceFile], request: ImportRequest, robots: Sequence[KnownRobot], found: NoProposal
) -> ProposedImport | None:
    """Return the proposal in which the force that the caller states shows what words for states mean.

    The first word is that without load; the second, if there are two, is the other one. None if the targets
    do not clearly move along the force: then the order of the words or the sign of the force is wrong. The
    argument `found` asks what the words mean.
    """
    fault = found.fault
    if fault is None or fault.option != "state_words" or len(fault.words) > 2 or request.force is None:
        return None
    words = dict(zip(fault.words, ("unloaded", "loaded"), strict=False))
    stated = request.model_copy(update={"state_words": {**request.state_words, **words}})
    proposed = _propose_or_decline(files, stated, robots, None)
    if isinstance(proposed, NoProposal) or not proposed.moves_along_force:
        return None
    shown = " and ".join(f"{quote(word)} is {state}" for word, state in words.items())
    return proposed.add_note(f"{shown}, as the targets then move along `force`")


def _list_open_words(found: ProposedImport | NoProposal) -> Sequence[str]:
    """Return the words of files that may be states, and that a legend may explain; () without such words.

    A letter may be a state in one language and the other state in the next; certain words need no legend.
    """
    if isinstance(found, NoProposal):
        is_question = found.fault is not None and found.fault.option == "state_words"
        return found.fault.words if found.fault is not None and is_question else ()
    words = list_state_words(found.named) if found.named else ()
    are_certain = all(find_state_in_name(word, {}) is not None for word in words)
    return () if are_certain else words


def _propose_or_decline(
    files: Sequence[SourceFile],
    request: ImportRequest,
    known: Sequence[KnownRobot],
    template: TableMeaning | None,
) -> ProposedImport | NoProposal:
    """Return the proposal of the robots, or why there is none; arguments as of `propose_import`."""
    try:
        return _propose_files(files, request, known, template)
    except UnfinishedError as error:
        return NoProposal(error.reason, error.remedy, error.fault)
    except NoProposalError as error:
        found = _propose_joined(files, request, known) if template is None else None
        return found or NoProposal(error.reason, error.remedy, error.fault)


def _propose_joined(
    files: Sequence[SourceFile], request: ImportRequest, robots: Sequence[KnownRobot]
) -> ProposedImport | NoProposal | None:
    """Return the proposal for the joined texts of files of one posture each; None if no meaning fits."""
    joined = join_numbered_texts([(each.name, each.content) for each in files])
    if joined is None:
        return None
    try:
        proposed = _propose_files([SourceFile(*joined)], request, robots, None)
    except UnfinishedError as error:
        return NoProposal(error.reason, error.remedy, error.fault)
    except NoProposalError:
        return None
    return replace(proposed, originals=tuple(files))


def _propose_files(
    files: Sequence[SourceFile],
    request: ImportRequest,
    robots: Sequence[KnownRobot],
    template: TableMeaning | None,
) -> ProposedImport:
    """Return the proposal of the robots for the tables, or else the repeated places, of files.

    Raises:
        NoProposalError: no meaning fits, or a person cannot accept the meaning that fits.
    """
    try:
        return _propose_tables(files, request, robots, template)
    except UnreadError as error:
        if template is not None:
            raise
        return _propose_by_stencils(files, request, robots, error)


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
    numbers = read_numbers(files, request, names, read)
    if template is None:
        proposed = _propose_polar(numbers, request, robots, names) or _propose_importable(
            numbers, request, robots
        )
    else:
        proposed = propose_as_template(numbers.tables, request, robots, template)
    return replace(proposed, masses=numbers.masses, originals=tuple(files))


def _propose_polar(
    numbers: JoinedTables, request: ImportRequest, robots: Sequence[KnownRobot], joints: Sequence[str]
) -> ProposedImport | None:
    """Return the proposal for polar readings by the only convention that fits the robot; None without one.

    The other sense of the horizontal angles mirrors the frame, which fits the robot with reversed joints: the
    joints have the robot's own counting.

    Raises:
        UnfinishedError: a convention fits, but a person must state more.
        NoProposalError: the caller states polar readings, but not all three with their units.
    """
    fitting, unfinished = list[ProposedImport](), list[UnfinishedError]()
    for tables, note in _list_polar_tables(numbers):
        try:
            joined = join_numbers(numbers.files, unify_lengths(tables), request, joints)
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


def _list_polar_tables(numbers: JoinedTables) -> list[tuple[list[NumberTable], str]]:
    """Return the tables with polar readings as x, y, z by each convention, and a note; [] without readings.

    Raises:
        NoProposalError: the caller states polar readings, but not all three with their units.
    """
    try:
        return list(list_cartesian(numbers.files.tables))
    except ImportFileError as fault:
        raise describe_fault(fault) from fault


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
    numbers: JoinedTables, request: ImportRequest, robots: Sequence[KnownRobot]
) -> ProposedImport:
    """Return the proposal of the robots for tables of numbers; a person can accept it.

    Raises:
        NoProposalError: no meaning fits, or the import refuses the table with the proposed meaning.
    """
    try:
        found_meaning = find_in_one_unit(numbers, request, robots)
    except NoProposalError:
        alone = propose_deflections(numbers, request, robots)
        if alone is None:
            raise
        return alone
    try:
        labelled = tell_postures_by_joints(found_meaning, request, robots[0].robot.joint_names)
        if labelled is not None:
            found_meaning = find_in_one_unit(labelled, request, robots)
        return complete(found_meaning, request)
    except NoProposalError as error:
        raise UnfinishedError(error.reason, error.remedy, error.fault) from error
