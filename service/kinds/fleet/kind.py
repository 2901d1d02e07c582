"""A fleet, the campaigns of many robots, identified in one job: declaration of the kind, report and files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from jointstiff.schemas.fields import Message, Name, Stiffness
from jointstiff.schemas.fleet import Fleet, FleetOptions, FleetOutcome, FleetRequest, FleetResult, FleetRow
from jointstiff.schemas.joints import JointKind
from jointstiff.service.kinds.kind import File, Kind
from jointstiff.service.tables.report import OVERALL, VERDICTS, Report, View
from jointstiff.service.tables.stiffness import StiffnessUnit
from jointstiff.service.tables.table import Column, Line, Part, Sheet, Style, Table, as_line

if TYPE_CHECKING:
    from jointstiff.service.kinds.work import Work
    from jointstiff.service.resources.inputs import Inputs

_REQUEST_BYTES: Final = 1024 * 1024
"""Greatest size of a request, with the ids of as many sets as a fleet may have."""
_SHOWN: Final = 500
"""Greatest number of sets in the table of a report, which begins with the sets that need attention."""
_MOST_JOINTS: Final = 8
"""Greatest number of joints for which the table has columns; with more joints it has no column of a joint."""
_OUTCOMES: Final[dict[FleetOutcome, tuple[str, Style]]] = {
    "failed": ("failed", "bad"),
    "do_not_use": (VERDICTS["do_not_use"], "bad"),
    "use_with_care": (VERDICTS["use_with_care"], "care"),
    "use": (VERDICTS["use"], "good"),
}
"""Words and style of each outcome, from the outcome that most needs attention to the best."""


def _make_report(_job: Fleet, result: FleetResult, view: View) -> Report:
    """Return a headline, the number of sets by outcome, and the table of sets, worst first."""
    order = list(_OUTCOMES)
    rows = sorted(result.rows, key=lambda row: order.index(row.outcome))
    columns = [
        Column("outcome", [_OUTCOMES[outcome][0] for outcome in order], text=True),
        Column("sets", [result.counts[outcome] for outcome in order]),
    ]
    counts = Table(columns, title="Sets by verdict")
    parts: list[Part] = [_headline(result), counts, _sets_table(rows[:_SHOWN], view.unit)]
    hidden = len(rows) - _SHOWN
    if hidden > 0:
        remark = f"and {hidden:,} more sets with the same or better verdicts: table.csv lists all sets"
        parts.append(Line(remark, "dim"))
    return Report(parts)


def _headline(result: FleetResult) -> Line:
    """Return a line with the number of sets not to use or, if that is zero, the number of sets to use."""
    total, unusable = len(result.rows), result.counts["do_not_use"]
    failed = f"; {result.counts['failed']:,} failed" if result.counts["failed"] else ""
    if unusable:
        return Line(f"Do not use {unusable:,} of {total:,} sets{failed}", "verdict_not")
    usable = result.counts["use"]
    style: Style = "verdict_use" if usable == total else "verdict_care"
    return Line(f"Use {usable:,} of {total:,} sets{failed}", style)


def _sets_table(rows: list[FleetRow], unit: StiffnessUnit) -> Table:
    """Return a row for each set: robot, verdict, stiffness of each joint, and the problem if it failed."""
    names = list(dict.fromkeys(name for row in rows for name in row.stiffness))
    verdicts = [Line(*_OUTCOMES[row.outcome]) for row in rows]
    columns = [
        Column("robot", [row.robot_name for row in rows], text=True),
        Column("measurement set", [row.measurement_set_name for row in rows], text=True),
        Column("verdict", verdicts, as_line, text=True),
    ]
    if len(names) <= _MOST_JOINTS:
        columns += [_stiffness_column(name, rows, unit) for name in names]
    problems = [None if row.error is None else row.error.detail for row in rows]
    if any(problems):
        columns.append(Column("problem", problems, text=True))
    return Table(
        columns,
        title="Sets",
        caption=f"{unit.quantity} (interval) of the joints in {unit.label}",
    )


def _stiffness_column(name: str, rows: Sequence[FleetRow], unit: StiffnessUnit) -> Column:
    """Return the column of a joint: its stiffness in each set."""
    return Column(name, [_stiffness_cell(row, name, unit) for row in rows], as_line)


def _stiffness_cell(row: FleetRow, joint: str, unit: StiffnessUnit) -> Line:
    """Format the stiffness of a named joint in a row with its interval; a dash if the set has no number."""
    interval = row.stiffness_interval.get(joint)
    kind = row.joint_kinds.get(joint, "revolute")
    return unit.show_stiffness(
        row.stiffness.get(joint), interval, kind, may_be_used=row.verdict != "do_not_use"
    ).cell


class _SheetRow(Message):
    """Row of the file `table.csv`: a joint of a set; the only row of a failed set has no joint."""

    set: FleetRow
    detail: str | None
    joint: Name | None = None
    stiffness: Stiffness[float | None] = None
    interval: Stiffness[tuple[float, float | None] | None] = None


_COLUMNS: Final = {
    "robot_id": "set.robot_id",
    "robot": "set.robot_name",
    "measurement_set_id": "set.measurement_set_id",
    "measurement_set": "set.measurement_set_name",
    OVERALL: "set.verdict",
    "joint": "joint",
    "stiffness": "stiffness",
    "stiffness_{low high}": "interval",
    "error": "detail",
}


def sets_sheet(job: Fleet) -> Sheet:
    """Return the file `table.csv`: a row for each set and joint; a failed set has one row, with its error."""
    rows: list[_SheetRow] = []
    kinds: list[JointKind | None] = []
    for each in job.result.rows if job.result else ():
        row = _SheetRow.model_construct(set=each, detail=None if each.error is None else each.error.detail)
        joint_fields = [
            {"joint": name, "stiffness": value, "interval": each.stiffness_interval[name]}
            for name, value in each.stiffness.items()
        ]
        # A failed set has no joints: one row without a joint shows the error.
        rows += [row.model_copy(update=fields) for fields in joint_fields or [{}]]
        kinds += [each.joint_kinds.get(name, "revolute") for name in each.stiffness] or [None]
    return Sheet.with_joint_kinds(Sheet.from_messages(rows, _COLUMNS), kinds)


def _prepare_work(inputs: Inputs, request: FleetRequest) -> Work:
    """Return the work of a fleet, which is computed later; numerical modules are imported here."""
    from jointstiff.service.kinds.fleet.work import FleetWork

    return FleetWork(inputs, request)


FLEET: Final = Kind[Fleet, FleetRequest](
    message=Fleet,
    request=FleetRequest,
    options=FleetOptions,
    prepare_work=_prepare_work,
    make_report=_make_report,
    sources=("sets",),
    title="Fleet",
    stepped=True,
    max_bytes=_REQUEST_BYTES,
    examples={"stated sets": {"measurement_set_ids": ["ID_OF_A_STORED_SET"], "run": {"positive": False}}},
    files=(
        File(
            name="table.csv",
            description="one row per measurement set and joint: stiffness with its interval and verdict, or "
            "the error of the set",
            sheet=sets_sheet,
            made_of="result",
        ),
    ),
    description="""Identify the measurement sets of many robots in one job, such as after an update.

Each set is identified as by a run with the same options. A set that cannot be
identified is a row with its `error`, not the end of the job. No runs are stored.""",
)
