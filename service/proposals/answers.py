"""Import of files by the names of their columns, or else by the proposal of the robot."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from jointstiff.schemas.imports import ImportAnswer, ImportRequest
from jointstiff.service.importing.errors import NOWHERE, ImportFileError
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.proposals.frames import is_in_another_frame, propose_frame
from jointstiff.service.proposals.options import clear_headers
from jointstiff.service.proposals.proposed_import import NoProposal, ProposedImport
from jointstiff.service.proposals.search import propose_import
from jointstiff.service.resources.imports import ImportRefusedError, import_files, lack_meaning
from jointstiff.solver.mechanics.robot import KnownRobot


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
    template = answer.template and answer.template.model_copy(update=clear_headers())
    return answer.model_copy(update={"proposal": proposed.text, "template": template})
