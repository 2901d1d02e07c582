"""Readings from files whose columns the robot explains: a proposal, its acceptance, and the campaign."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any, Unpack

from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.meaning import TableMeaning
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.catalogue import find_arm, nominal_robot
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.importing.source_files import read_sources
from jointstiff.service.library.campaigns import Campaign
from jointstiff.service.library.imported import ImportedReadings, ImportFields
from jointstiff.service.problems import (
    CampaignError,
    FilesError,
    as_campaign_error,
    http_problem,
    naming_missing_file,
    problem_from_error,
)
from jointstiff.service.process import one_thread
from jointstiff.service.proposals.frames import is_in_another_frame, propose_frame
from jointstiff.service.proposals.options import OPTIONS_OF_COLUMNS, OPTIONS_OF_NAMES
from jointstiff.service.proposals.proposed_import import NoProposal, ProposedImport
from jointstiff.service.proposals.search import propose_import
from jointstiff.service.resources.documents import parse_document, read_robot
from jointstiff.service.resources.imports import import_files, lack_meaning
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import KnownRobot


class ProposedReadings:
    """Proposal of the robot for the meaning of files; `print` shows the proposal in a sentence."""

    def __init__(self, proposed: ProposedImport, robot: RobotDocument, fields: ImportFields) -> None:
        """Keep a proposal with its robot, and the statements about the readings."""
        self._proposed, self._robot, self._fields = proposed, robot, fields

    def __str__(self) -> str:
        """Return the proposal in words, and the question that the numbers cannot decide."""
        return self._proposed.text

    __repr__ = __str__

    @property
    def robot(self) -> RobotDocument:
        """Robot that fits."""
        return self._robot

    @property
    def residual(self) -> float:
        """Median distance of the positions from their places by the robot [mm]; NaN without positions."""
        return 1e3 * self._proposed.proposal.residual

    @property
    def next_residual(self) -> float:
        """Median distance of the best other meaning [mm]; infinite if no other meaning fits to 300 mm."""
        return 1e3 * self._proposed.proposal.next_residual

    @property
    def doubt(self) -> str:
        """Question that the numbers cannot decide; empty without one."""
        return self._proposed.proposal.doubt

    @property
    def meaning(self) -> TableMeaning | None:
        """Columns, units, targets and states of the proposal; None of displacements without positions."""
        return self._proposed.meaning

    def accept(self, *, despite_doubt: bool = False, **statements: Any) -> ImportedReadings:  # noqa: ANN401
        """Import the readings as the proposal says.

        Args:
            despite_doubt: accept a proposal with a question that the numbers cannot decide.
            statements: what no file contains, such as `encoders` or `load_point` of `import_files`.

        Raises:
            RequestError: the proposal has a doubt.
            CampaignError: a statement is not valid, or the readings are refused.
        """
        if self.doubt and not despite_doubt:
            raise RequestError(
                f"the numbers cannot decide: {self.doubt}",
                where="files",
                remedy="check the axes and the signs of the joints, or state the robot; then call "
                "`accept(despite_doubt=True)`",
            )
        fields = self._proposed.request.model_dump(exclude_unset=True) | self._fields | statements
        request = parse_document({**fields, **self._list_cleared()}, ImportRequest)
        try:
            answer = self._proposed.accept(request)
        except FilesError as error:
            raise CampaignError(problem_from_error(error)) from error
        return ImportedReadings.model_validate(dict(answer)).with_robot(self._robot)

    def _list_cleared(self) -> dict[str, Any]:
        """Return options that the written table does not need: of columns, names, and a force that it has."""
        request = self._proposed.request.model_dump()
        replaced = {"force": None} if request["force"] is None and self._fields.get("force") else {}
        return {name: request[name] for name in (*OPTIONS_OF_COLUMNS, *OPTIONS_OF_NAMES)} | replaced

    @property
    def campaign(self) -> Campaign:
        """Campaign of the accepted readings, if nothing is missing and the proposal has no doubt."""
        return self.accept().campaign


@one_thread()
@naming_missing_file()
def read(
    *files: str | PathLike[str],
    robot: Any = None,  # noqa: ANN401 - as of a campaign
    **options: Unpack[ImportFields],
) -> ProposedReadings | ImportedReadings:
    """Read files of readings: by the names of their columns, or else by a proposal of the robot.

    Args:
        files: tables of joints and positions; text, Excel or arrays. Headers may be missing or unknown.
        robot: measured robot: a document, a file, or an arm of the catalogue; None tries the whole catalogue.
        options: statements about the readings, as in `import_files`.

    Returns:
        The readings, if names explain all columns, in R0. Otherwise a proposal: `print` shows the proposal in
        words, `.accept()` returns the readings, `.campaign` their campaign.

    Raises:
        CampaignError: neither names nor a robot explain the columns, or an option is not valid.
    """
    request = parse_document(dict(options), ImportRequest)
    sources = read_sources(files)
    document = _find_robot(robot)
    robots = _prepare_robots(document)
    try:
        answer = import_files(sources, request, robots[0].robot if document is not None else None)
    except FilesError as error:
        if not lack_meaning(sources, request, robots[0].robot if document is not None else None):
            raise CampaignError(problem_from_error(error)) from error
        proposed = propose_import(sources, request, robots)
        if isinstance(proposed, NoProposal):
            if proposed.remedy:
                raise CampaignError(http_problem(422, proposed.reason, proposed.remedy)) from error
            problem = problem_from_error(error)
            detail = f"{problem.detail}; the robot explains no columns either: {proposed.reason}"
            raise CampaignError(problem.model_copy(update={"detail": detail})) from error
        found = document or nominal_robot(find_arm(proposed.known.name, "robot"))
        return ProposedReadings(proposed, found, options)
    if document is not None and is_in_another_frame(answer):
        turned = propose_frame(sources, request, robots[0], answer)
        if turned is not None:
            return ProposedReadings(turned, document, options)
    readings = ImportedReadings.model_validate(dict(answer))
    return readings if document is None else readings.with_robot(document)


def _find_robot(robot: Any) -> RobotDocument | None:  # noqa: ANN401 - as of a campaign
    """Return the document of a robot: a message, a mapping, a file or an arm of the catalogue.

    Raises:
        CampaignError: the argument is no robot.
    """
    if robot is None or isinstance(robot, RobotDocument):
        return robot
    if isinstance(robot, str | PathLike):
        return read_robot(str(robot))
    return parse_document(robot, RobotDocument)


def _prepare_robots(document: RobotDocument | None) -> Sequence[KnownRobot]:
    """Return the robots to try: the stated one, or the catalogue.

    Raises:
        CampaignError: the document is no valid robot.
    """
    if document is None:
        return list(catalogue_robots())
    with as_campaign_error("robot"):
        return [KnownRobot(document.name, prepare_robot(document).robot)]
