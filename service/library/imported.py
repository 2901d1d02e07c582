"""Readings from files: the meaning of the files, with the measured robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, TypedDict, Unpack, cast

from pydantic import PrivateAttr

from jointstiff.schemas.imports import ImportAnswer
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.library.campaigns import Campaign
from jointstiff.service.library.here import Here
from jointstiff.service.library.results import Presented, TabledRun
from jointstiff.service.problems import (
    CampaignError,
    as_campaign_error,
    http_problem,
    naming_missing_file,
    problem_from_error,
)
from jointstiff.service.process import one_thread
from jointstiff.service.resources.documents import parse_document, read_robot
from jointstiff.service.tables.table import Line, Part, Sheet
from jointstiff.solver.errors import RequestError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jointstiff.schemas.imports import ImportUnits
    from jointstiff.schemas.measurement import Noise
    from jointstiff.service.kinds.verb import Vector
    from jointstiff.service.reports.plots import PlotStyle


class ImportFields(TypedDict, total=False):
    """Options of `import_files`."""

    units: str | ImportUnits | Mapping[str, Any] | None
    columns: Mapping[str, str]
    layouts: Sequence[Sequence[str]]
    delimiter: Literal["comma", "semicolon", "tab", "whitespace"] | None
    decimal_mark: Literal["point", "comma"] | None
    header: Sequence[str] | None
    ignore: Sequence[str]
    sheet: str | None
    point_name: str | None
    file_name: str | None
    state_words: Mapping[str, Literal["unloaded", "loaded", "deflection"]]
    state: Literal["unloaded", "loaded", "deflection"] | None
    by_order: bool
    allow_missing: bool
    mean_of_repeats: bool
    joint_tolerance: float
    name: str | None
    encoders: Literal["motor", "secondary"] | None
    noise: Noise | Mapping[str, Any] | None
    flange_targets: Mapping[str, Vector]
    load_point: Vector | None
    load_point_target: str | None
    length_unit: Literal["m", "mm"] | None
    accept_unusual: bool
    force: Vector | None
    robot_id: str | None
    accept_proposal: bool
    show_faults: bool


class ImportedReadings(Presented, ImportAnswer):
    """Readings from files, from which a campaign is made; shown in one line."""

    _saved_kind: ClassVar[str] = "imported"
    _robot: Any = PrivateAttr(default=None)  # document of the measured robot

    @classmethod
    def _from_fields(cls, fields: Mapping[str, Any]) -> Self:
        """Return the readings from their document, with the robot."""
        stated = dict(fields)
        robot = stated.pop("robot", None)
        readings = super()._from_fields(stated)
        return readings if robot is None else readings.with_robot(robot)

    def _to_document(self) -> dict[str, Any]:
        """Return the readings as a document, with the robot."""
        document = super()._to_document()
        if self.robot is not None:
            document["robot"] = self.robot.model_dump(mode="json", exclude_unset=True)
        return document

    def _parts(self) -> Sequence[Part]:
        """Return the line of the report, and lines of what is missing and of suspicious readings."""
        counts = [f"{self.observation_count} observations", f"{len(self.targets)} targets"]
        if self.joint_count is not None:
            counts.append(f"{self.joint_count} joints")
        state = f"missing: {', '.join(self.missing)}" if self.missing else "complete"
        files = ", ".join(each.file for each in self.files)
        lines = [f"{files}: {', '.join(counts)}; {state}", *self.assumptions]
        return [*map(Line, lines), *(Line(finding.message) for finding in self.findings or ())]

    def _sheets(self) -> Mapping[str, Callable[[], Sheet]]:
        """Return, by its name, the function that makes the only table: the columns and their meanings."""
        return {"columns": self._make_columns_sheet}

    def _make_columns_sheet(self) -> Sheet:
        """Return the table of the columns of all files: header, meaning and unit."""
        columns = [(file.file, column) for file in self.files for column in file.columns]
        rows = {
            "file": [name for name, _ in columns],
            "header": [column.header for _, column in columns],
            "meaning": [column.meaning for _, column in columns],
        }
        return Sheet(rows, frozenset(rows))

    def _draw_figure(self, style: PlotStyle) -> Figure:  # noqa: ARG002 - nothing is drawn
        """Refuse: readings have no plot before they are identified."""
        raise ValueError("imported readings have no plot: identify the readings, and plot the run")

    @property
    def robot(self) -> RobotDocument | None:
        """Measured robot, with the masses of a table of masses; None if `import_files` got no robot."""
        return cast("RobotDocument | None", self._robot)

    def with_robot(self, robot: RobotDocument | Mapping[str, Any]) -> Self:
        """Return the readings with their robot, a message or a document.

        Raises:
            CampaignError: the document is no robot.
        """
        readings = self.model_copy()
        readings._robot = robot if isinstance(robot, RobotDocument) else parse_document(robot, RobotDocument)
        return readings

    @property
    def campaign(self) -> Campaign:
        """Campaign of the readings and their robot, without the observations of a column `validation`.

        Raises:
            CampaignError: no robot was given, or something is missing in the files.
        """
        with as_campaign_error(""):
            return self._build_campaign()

    def _build_campaign(self) -> Campaign:
        """Return the campaign.

        Raises:
            RequestError: no robot was given, or something is missing in the files.
        """
        if self._robot is None:
            raise RequestError(
                "the readings have no robot", where="robot", remedy="call `import_files` with `robot`"
            )
        if self.weight_step is not None:
            raise RequestError(
                "the file contains a weight step, which is read by two encoders instead of targets",
                where="files",
                remedy="identify its gearboxes: `jointstiff.gearbox(file, robot=…, load=…)`",
            )
        if self.measurement_set is None:
            raise RequestError(
                f"the files are no campaign: {', '.join(self.missing) or 'the files have no loads'}",
                where="files",
                remedy="give the missing information as options of `import_files`",
            )
        robot = self._robot.model_copy(update={"bodies": self.bodies}) if self.bodies else self._robot
        run = RunOptions(leave_out=self.leave_out) if self.leave_out else RunOptions()
        return Campaign(robot=robot, measurement_set=self.measurement_set, run=run)

    def accept(self) -> ImportedReadings:
        """Return these readings: names explain all columns, so that no proposal is left to accept."""
        return self

    def identify(self, options: RunOptions | None = None, **fields: Any) -> TabledRun:  # noqa: ANN401
        """Identify the joint stiffnesses of the readings; arguments as of `jointstiff.identify`."""
        return Here().identify(self.campaign, options, **fields)


@naming_missing_file()
@one_thread()
def import_files(
    *files: str | PathLike[str],
    robot: Any = None,  # noqa: ANN401 - as of a campaign
    payload: float | None = None,
    **options: Unpack[ImportFields],
) -> ImportedReadings:
    """Import files of readings, as the command `jointstiff import` does.

    Args:
        files: tables of readings, lists of points, a table of masses or of a weight step; text or Excel.
        robot: measured robot: a document, as in a campaign, or a file. With a robot, the answer has the
            findings of the integrity checks; unloaded positions of a robot with masses become a set that is
            identified by the robot's own weight.
        payload: largest payload of the robot by its maker [kg]; default: that of the robot.
        options: fields of `ImportRequest`, such as `columns={"A1": "J1 [deg]"}`.

    Returns:
        The readings with the preview of the files; `.campaign` is a campaign of robot and readings, and
        `.identify()` returns its run.

    Raises:
        CampaignError: a file or an option was not understood.
    """
    from jointstiff.schemas.imports import ImportRequest
    from jointstiff.service.importing.source_files import read_sources
    from jointstiff.service.problems import FilesError
    from jointstiff.service.resources import imports

    request = parse_document(options, ImportRequest)
    sources = read_sources(files)
    robot_model = None
    if robot is None and payload is not None:
        problem = http_problem(422, "payload: the robot is unknown", "give `robot`, too")
        raise CampaignError(problem)
    if robot is not None:
        if isinstance(robot, str | PathLike):
            robot = read_robot(str(robot))
        elif not isinstance(robot, RobotDocument):
            robot = parse_document(robot, RobotDocument)
        if payload is not None:
            fields = robot.model_dump(mode="json", exclude_unset=True)
            robot = parse_document(fields | {"payload": payload}, RobotDocument)
        with as_campaign_error("robot"):
            robot_model = prepare_robot(robot).robot
    try:
        answer = imports.import_files(sources, request, robot_model)
    except FilesError as error:
        raise CampaignError(problem_from_error(error)) from error
    readings = ImportedReadings.model_validate(dict(answer))
    return readings if robot is None else readings.with_robot(robot)
