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

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from robotprograms import language as ir
from robotprograms.calls import Calls, Work
from robotprograms.collecting import ChangeCollector
from robotprograms.columns import Cause, Columns
from robotprograms.control_flow import ControlFlow, UnmatchedEnd
from robotprograms.effects import Effects
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
    """Read and interpret a program.

    Args:
        kind: name of the program's format.
        sources: files of the program.
        language: language of the format.
        permissions: what the user states about routines of other files.
        own: own numbers of moves that take the place of names in the first file.

    Raises:
        ProgramError: the text is not understood.
    """
    statements = _read_statements(kind, sources, language, own)
    flow = _find_control_flow(statements)
    faults = _note_faults(statements, flow)
    work = Work(statements.refuse)
    calls = Calls(flow, statements.changes, work, permissions.allowed, trusted=permissions.trusts_routines)
    effects = Effects(statements, flow, calls)
    collector = ChangeCollector(statements, flow, calls, effects, faults)
    collector.collect()
    moves = MoveRecorder(statements, flow, calls)
    moves.collect_targets()
    bodies = {name: [i for i in body if i not in collector.unread] for name, body in flow.bodies.items()}
    liveness = TrafficFinder(statements, calls, effects).find_liveness(bodies, flow)
    propagation = Propagation(statements, flow, calls, effects, faults, work, liveness, moves.record)
    propagation.run(bodies, collector.callers)
    moves.trace_uses()
    moves.remark_conditions()
    moves.note_assumption()
    _note_left_files(statements)
    return Interpretation(statements.columns, statements.uses.used, statements.changes.causes)


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
    ops, places, names = statements.ops, statements.places, list[str]()
    for i, (place, op) in enumerate(zip(places, ops, strict=True)):
        if isinstance(op, ir.Flow):
            ops[i] = op.settle_bounds(place.values[place.first :])
        names.append(place.qualify(op.name) if isinstance(op, ir.Flow) else "")
    try:
        flow = ControlFlow(ops, names)
    except UnmatchedEnd as fault:
        place = places[fault.place]
        statements.refuse(place.line, fault.reason, fault.remedy, place.source)
    places += places[-1:] * (len(ops) - len(places))
    return flow


def _note_faults(statements: Statements, flow: ControlFlow) -> dict[int, Cause]:
    """Return the causes of operations that do not fit, by their indices; add a remark to each."""
    faults = {i: statements.places[i].make_cause(*words) for i, words in sorted(flow.faults.items())}
    for cause in faults.values():
        statements.changes.causes.append(cause)
        statements.columns.add_remark(At(cause.line, cause.source), cause.reason)
    return faults


def _note_left_files(statements: Statements) -> None:
    """Add a remark on the moves of each further file, which are not corrected."""
    for source, count in sorted(statements.left_in_file.items()):
        file = quote_text(statements.sources[source].name)
        moves = "1 move" if count == 1 else f"{count} moves"
        text = f"{moves} of {file} are left as they are: to correct them, send that file as the first one"
        statements.columns.add_remark(At(1), text)
