"""Interpreter of programs: constants are propagated along the control flow, and moves recorded.

statements   operations of the text, declarations and uses of names, added by the reader of the language
control_flow the operations that may follow each operation
calls        routines that a call may start; unknown routines
effects      what an operation changes in a state; contents: what a name contains in a state
collecting   changes of names anywhere in the program
traffic      operations that read and write names; liveness: names that nothing reads any more
propagation  states along the control flow, until no state changes
moves        moves in their states; frames: their bases and tools
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import NamedTuple

from robotprograms import language as ir
from robotprograms.calls import Calls, Work
from robotprograms.collecting import ChangeCollector
from robotprograms.columns import Cause, Columns
from robotprograms.control_flow import ControlFlow, UnmatchedEnd, find_control_flow
from robotprograms.effects import Effects, FollowedProgram
from robotprograms.errors import quote_text
from robotprograms.language import Language
from robotprograms.moves import MoveRecorder
from robotprograms.notation import Numerals
from robotprograms.program import At, OwnNumbers, Source
from robotprograms.propagation import Propagation
from robotprograms.statements import Statements
from robotprograms.traffic import TrafficFinder


@dataclass(frozen=True)
class Permissions:
    """Statements of the user about routines of other files."""

    allowed: Collection[str] = ()  # routines that neither move the robot nor change frames
    trusts_routines: bool = False  # whether no routine of another file does so


@dataclass(frozen=True)
class Interpretation:
    """A program after its interpretation."""

    columns: Columns  # targets and moves
    used: dict[str, At]  # place of use of each name that is used otherwise than as a target
    causes: list[Cause]  # causes why statements are not understood


def interpret(
    kind: str,
    sources: tuple[Source, ...],
    language: Language,
    permissions: Permissions,
    own: Sequence[OwnNumbers] = (),
) -> Interpretation:
    """Find the targets and moves of a program, each move with its base and tool on all paths of execution.

    A move whose targets or frames are not certain is noted as one that cannot be corrected.

    Args:
        kind: name of the program's format.
        sources: files of the program.
        language: language of the format.
        permissions: what the user states about routines of other files.
        own: numbers of targets that moves already have in the first file, in place of the targets' names.

    Raises:
        ProgramError: the text is not understood.
    """
    statements = _read_statements(kind, sources, language, own)
    flow = _find_control_flow(statements)
    faults = _note_faults(statements, flow)
    work = Work(statements.refuse)
    calls = Calls(flow, statements.changes, work, permissions.allowed, trusted=permissions.trusts_routines)
    effects = Effects(statements, flow, calls)
    program = FollowedProgram(statements, flow, faults, calls, effects, work)
    routines = _collect_changes(program)
    moves = MoveRecorder(statements, flow, calls)
    moves.collect_targets()
    _follow_execution(program, routines, moves)
    moves.trace_uses()
    moves.remark_conditions()
    moves.note_assumption()
    _note_left_files(statements, _find_linked_files(statements, flow, calls, routines.callers))
    return Interpretation(statements.columns, statements.uses.used, statements.changes.causes)


class _ChangedRoutines(NamedTuple):
    """Routines of a program, as far as they can matter for moves."""

    bodies: dict[str, list[int]]  # operations of each routine, by index, that can matter for moves
    callers: Mapping[str, Set[str]]  # routines that call each routine


def _collect_changes(program: FollowedProgram) -> _ChangedRoutines:
    """Find which names can change, and by what, without regard to the order of execution.

    The changes are noted in the statements. Operations that change only names which nothing reads, such as
    counters, are left out of the routines.
    """
    collector = ChangeCollector(program)
    collector.collect()
    bodies = {}
    for routine, body in program.flow.bodies.items():
        bodies[routine] = [i for i in body if i not in collector.unread]
    return _ChangedRoutines(bodies, collector.callers)


def _follow_execution(program: FollowedProgram, routines: _ChangedRoutines, moves: MoveRecorder) -> None:
    """Follow all paths of execution, and record each move with what the names contain there."""
    traffic = TrafficFinder(program.statements, program.calls, program.effects)
    liveness = traffic.find_liveness(routines.bodies, program.flow)
    Propagation(program, liveness, moves.record).run(routines.bodies, routines.callers)


def _read_statements(
    kind: str, sources: tuple[Source, ...], language: Language, own: Sequence[OwnNumbers]
) -> Statements:
    """Return the statements of a program, as the reader of its language adds them.

    Raises:
        ProgramError: the text is not understood.
    """
    numerals = [Numerals.from_text(source.text, language.number) for source in sources]
    columns = Columns(kind, sources, numerals, language, own)
    statements = Statements(sources, language, numerals, columns)
    if language.read:
        language.read(statements, sources)
    else:
        statements.add_statements(0, sources[0].starts, sources[0].ends)
    # All statements are translated: the texts without numbers take as much memory as the files.
    numerals[:] = [replace(each, masked_text="") for each in numerals]
    return statements


def _find_control_flow(statements: Statements) -> ControlFlow:
    """Return the control flow; ends that the text lacks get the place of the last statement.

    Raises:
        ProgramError: branches, loops or routines are nested too deep.
    """
    _settle_bounds(statements)
    ops, places = statements.ops, statements.places
    names = _name_flow_operations(statements)
    try:
        flow = find_control_flow(ops, names)
    except UnmatchedEnd as fault:
        place = places[fault.place]
        statements.refuse(place.line, fault.reason, fault.remedy, place.source)
    missing_ends = len(ops) - len(places)
    last_place = places[-1:]
    places += last_place * missing_ends
    return flow


def _settle_bounds(statements: Statements) -> None:
    """Let each loop be one that runs at least once if the numbers of its statement say so.

    `FOR i=1 TO 3` runs; `FOR i=1 TO n` may be skipped.
    """
    for i, (place, op) in enumerate(zip(statements.places, statements.ops, strict=True)):
        if isinstance(op, ir.Flow):
            numbers_of_statement = place.values[place.first :]
            statements.ops[i] = op.settle_bounds(numbers_of_statement)


def _name_flow_operations(statements: Statements) -> list[str]:
    """Return the full name of each operation that begins a routine, marks a label or jumps; else ""."""
    names = list[str]()
    for place, op in zip(statements.places, statements.ops, strict=True):
        names.append(place.qualify(op.name) if isinstance(op, ir.Flow) else "")
    return names


def _note_faults(statements: Statements, flow: ControlFlow) -> dict[int, Cause]:
    """Return the causes of operations that do not fit, such as an end without a beginning, by their indices.

    Each one is also noted in the statements as a cause and a remark.
    """
    faults = dict[int, Cause]()
    for i, (reason, remedy) in sorted(flow.faults.items()):
        cause = statements.places[i].make_cause(reason, remedy)
        faults[i] = cause
        statements.changes.causes.append(cause)
        statements.columns.add_remark(At(cause.line, cause.source), cause.reason)
    return faults


def _find_linked_files(
    statements: Statements, flow: ControlFlow, calls: Calls, callers: Mapping[str, Set[str]]
) -> set[int]:
    """Return the indices of files that call another file, or that another file calls.

    Args:
        statements: statements of the program.
        flow: control flow with the routines of the program.
        calls: calls of the program, with the routines that are attached to events.
        callers: routines that call each routine.
    """
    files = {routine: statements.places[body[0]].source for routine, body in flow.bodies.items() if body}
    linked = {files[routine] for routine in calls.attached_routines if routine in files}
    for routine, callers_of_routine in callers.items():
        files_of_call = {files[name] for name in (routine, *callers_of_routine) if name in files}
        if len(files_of_call) > 1:
            linked |= files_of_call
    return linked


def _note_left_files(statements: Statements, linked: Set[int]) -> None:
    """Add a remark on the moves of each further file, which are not corrected.

    Args:
        statements: statements of the program.
        linked: indices of the files that call another file, or that another file calls.
    """
    first = quote_text(statements.sources[0].name)
    for source, count in sorted(statements.left_in_file.items()):
        file = quote_text(statements.sources[source].name)
        left = f"{count} moves of {file} are left as they are"
        if count == 1:
            left = f"1 move of {file} is left as it is"
        text = f"{left}: to correct such moves, send that file as the first one"
        if source not in linked:
            alone = f"send {file} without {first}"
            text = f"{left}: {file} and {first} do not call each other; to correct such moves, {alone}"
        statements.columns.add_remark(At(1), text)
