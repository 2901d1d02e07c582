"""Readings from files or data frames: the mapping of their columns, and the campaign with their robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from jointstiff.schemas.imports import ImportAnswer, ImportQuestion, ImportRequest
from jointstiff.schemas.imports import Mapping as ImportMapping
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.imports.answer import import_files, import_tables
from jointstiff.service.imports.formats import read_sources, table_from_columns
from jointstiff.service.imports.show import show
from jointstiff.service.library.campaigns import Campaign
from jointstiff.service.library.here import Here
from jointstiff.service.problems import as_campaign_error, naming_missing_file
from jointstiff.service.process import one_thread
from jointstiff.service.resources.documents import parse_document, read_document, read_robot
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import KnownRobot

if TYPE_CHECKING:
    from jointstiff.service.library.results import TabledRun

Vector = Sequence[float]


class ImportedReadings:
    """Readings with the mapping of their columns; `print` shows the tables with a role above each column."""

    def __init__(self, answer: ImportAnswer, robot: RobotDocument | None) -> None:
        """Keep the answer of an import, with the robot that was measured."""
        self.answer, self.robot = answer, robot

    def __str__(self) -> str:
        """Return the tables with the roles of their columns, and the next question."""
        return show(self.answer)

    __repr__ = __str__

    @property
    def mapping(self) -> ImportMapping:
        """Mapping that was proposed or applied: edit it, and pass it to `read`."""
        return self.answer.mapping

    @property
    def questions(self) -> list[ImportQuestion]:
        """Questions that only a person answers; each choice has the mapping after it."""
        return self.answer.questions

    @property
    def campaign(self) -> Campaign:
        """Campaign of the readings and their robot.

        Raises:
            CampaignError: a question or a fault is open, no robot was stated, or the files have no loads.
        """
        with as_campaign_error("files"):
            return self._build_campaign()

    def _build_campaign(self) -> Campaign:
        """Return the campaign; errors as of `campaign`, as RequestError."""
        answer = self.answer
        if answer.questions:
            remedy = "answer it in the mapping: read(…, mapping=…), or state encoders, load_point or force"
            raise RequestError(answer.questions[0].text, where="files", remedy=remedy)
        if answer.faults:
            causes = [each.message for each in answer.findings or () if each.weight == "do_not_use"]
            remedy = "correct the files or the mapping; `answer.measurement_set` has the readings as they are"
            raise RequestError("; ".join([answer.faults[0], *causes[:1]]), where="files", remedy=remedy)
        if answer.measurement_set is None:
            remedy = "use `jointstiff.geometry(readings.answer.geometry)` or `jointstiff.gearbox(file)`"
            raise RequestError("the files have no loads", where="files", remedy=remedy)
        if self.robot is None:
            raise RequestError("the readings have no robot", where="robot", remedy="state `robot` in `read`")
        return Campaign(robot=self.robot, measurement_set=answer.measurement_set)

    def identify(self, **options: Any) -> TabledRun:  # noqa: ANN401 - options of a run
        """Identify the joint stiffnesses of the readings; arguments as of `jointstiff.identify`."""
        return Here().identify(self.campaign, **options)


@one_thread()
@naming_missing_file()
def read(
    *files: Any,  # noqa: ANN401 - paths or data frames
    robot: Any = None,  # noqa: ANN401 - as of a campaign
    mapping: ImportMapping | Mapping[str, Any] | str | PathLike[str] | None = None,
    encoders: Literal["motor", "secondary"] | None = None,
    load_point: Vector | None = None,
    force: Vector | None = None,
    name: str | None = None,
    **stated: Any,  # noqa: ANN401 - further fields of the mapping
) -> ImportedReadings:
    """Read tables of readings by a mapping, by documented headers, or by a proposal of the robot.

    Args:
        files: paths of tables (csv, xlsx, xls, ods, json, mat, npz, hdf5, parquet), or data frames.
        robot: measured robot: a document, a file, or an arm of the catalogue.
        mapping: what the columns mean: a message, a document, or a file that `jointstiff import` wrote.
        encoders: encoders that close the position loop.
        load_point: (3,) in the flange frame [mm].
        force: (3,) on the robot in R0 [N], if no column has the force.
        name: name of the measurement set.
        stated: further fields of the mapping, such as `load_point_target` or `noise`.

    Raises:
        CampaignError: a file is no table, or an argument is not valid.
    """
    document = _find_robot(robot)
    if isinstance(mapping, str | PathLike):
        mapping = read_document(Path(mapping), ImportMapping)
    base = (
        mapping.model_dump(exclude_unset=True) if isinstance(mapping, ImportMapping) else dict(mapping or {})
    )
    given = {"encoders": encoders, "load_point": load_point, "force": force}
    fields = base | {key: value for key, value in given.items() if value is not None} | stated
    request = parse_document({"mapping": fields} | ({"name": name} if name else {}), ImportRequest)
    with as_campaign_error("robot"):
        known = None if document is None else KnownRobot(document.name, prepare_robot(document).robot)
    with as_campaign_error("files"):
        if any(hasattr(file, "columns") for file in files):
            tables = [
                table_from_columns(f"frame {number}", {str(key): list(frame[key]) for key in frame.columns})
                for number, frame in enumerate(files, 1)
            ]
            answer = import_tables(tables, request, known)
        else:
            answer = import_files(read_sources(files), request, known)
    return ImportedReadings(answer, document)


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
