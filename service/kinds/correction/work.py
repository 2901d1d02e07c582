"""The work of a corrected table: its steps are blocks of rows, after the postures of all rows are found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jointstiff.schemas.correction import (
    MAX_ROWS,
    CorrectionOptions,
    CorrectionRequest,
    CorrectionResult,
    ProgramFile,
)
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.readings import hash_texts
from jointstiff.service.kinds.correction.files import compress_file, decompress_file
from jointstiff.service.kinds.work import (
    Arrays,
    Span,
    Work,
    as_request_errors,
    concatenate_steps,
    cut_into_spans,
)
from jointstiff.service.problems import naming_missing_extra
from jointstiff.service.resources.inputs import Inputs
from jointstiff.service.runs.correction.answer import (
    CorrectedTable,
    TableCorrection,
    refuse_foreign_fields,
)
from jointstiff.service.runs.correction.columns import (
    TABLE_LIMITS,
    convert_headers,
    make_sheet,
    name_joint_columns,
)
from jointstiff.service.runs.correction.poses import PoseTable
from jointstiff.service.runs.verdicts import find_accepted_run
from jointstiff.service.tables.packed import pack_sheet, unpack_sheet
from jointstiff.service.tables.reading import LABEL, read_number_table
from jointstiff.service.tables.table import Sheet
from jointstiff.solver.correct.correct import CorrectedRows
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import Robot

if TYPE_CHECKING:
    from jointstiff.solver.arrays import FloatArray

STEP_ROWS: Final = 10_000
"""Rows of a step, which takes a quarter of a second."""
_MAX_PROGRAM_BYTES: Final = 16 * 1024 * 1024
"""Greatest size of the files of a program [bytes]."""


class CorrectionWork(Work):
    """Work of a corrected table, whose units are rows; a table that is corrected at once has no steps."""

    unit = "rows"
    activity = "correcting"

    def __init__(
        self,
        robot: Robot,
        run: Run | None,
        options: CorrectionOptions,
        columns: dict[str, FloatArray],
        labels: list[str] | None = None,
    ) -> None:
        """Read the columns, which are in the units of the options.

        Raises:
            RequestError: columns are missing, unknown, of different lengths, or not finite.
        """
        self.robot_id = None
        self._robot, self._run, self._options, self._labels = robot, run, options, labels
        self._table = PoseTable.from_columns(columns, options.units, robot)

    @cached_property
    def _correction(self) -> TableCorrection:
        """The correction, with the postures of all rows.

        Raises:
            RequestError: the run has no model, the options contradict each other, or poses and joints do.
        """
        with as_request_errors():
            return TableCorrection.prepare(self._robot, self._run, self._options, self._table)

    def __len__(self) -> int:
        return len(self._table.poses)

    def spans(self) -> tuple[Span, ...]:
        """Return all rows, cut into blocks."""
        return cut_into_spans(len(self), STEP_ROWS)

    def steps(self) -> Sequence[Span]:
        """Return a step for each block of rows; no steps for few rows."""
        return self.spans() if len(self) > MAX_ROWS else ()

    def compute(self, span: Span) -> Arrays:
        """Return the corrected rows of a block, as the fields of `CorrectedRows` by name.

        Raises:
            RequestError: the request cannot be carried out.
        """
        return vars(self._correction.path.correct(*span))

    def correct(self, parts: Sequence[Arrays]) -> CorrectedTable:
        """Return the corrected table, from the arrays of all blocks; without any, they are computed."""
        parts = parts or [self.compute(span) for span in self.spans()]
        return self._correction.conclude([CorrectedRows(**concatenate_steps(parts))])

    def list_columns(self, done: CorrectedTable) -> dict[str, Any]:
        """Return the columns of the corrected table by name, in the units of the options."""
        labels = {} if self._labels is None else {LABEL: self._labels}
        return labels | done.list_columns(self._table, self._options.units, self._robot)


class StoredCorrectionWork(CorrectionWork):
    """Work of a table in a request; the result has the corrected table."""

    def __init__(
        self, robot: Robot, robot_id: str, run: Run | None, request: CorrectionRequest, content: str = ""
    ) -> None:
        """Unpack the table of a request.

        Without a run, the model is the prior of the robot, and `content` is the hash of the robot.

        Raises:
            RequestError: the request has no table, or its columns cannot be used.
        """
        if len(request.files) != 1 or request.columns:
            raise RequestError(
                "the request needs one table", where="files", remedy="send one file, without `columns`"
            )
        (file,) = request.files
        sheet = unpack_sheet(decompress_file(file))
        numbers = {name: column for name, column in sheet.columns.items() if name not in sheet.texts}
        columns = convert_headers(numbers, request.units, robot)
        super().__init__(robot, run, request, columns, sheet.columns.get(LABEL))
        self.robot_id = robot_id
        options = request.model_dump_json(exclude={"run_id", "robot_id", "columns", "files"})
        model_hash = f"{content} {robot.payload!r}" if run is None else run.provenance.input_hash
        self.input_hash = hash_texts(model_hash, options, file.sha256 or "")

    def conclude(self, parts: Sequence[Arrays]) -> CorrectionResult:
        """Return counts, verdict, and the packed table of all rows.

        Raises:
            RequestError: the request cannot be carried out.
        """
        done = self.correct(parts)
        sheet = make_sheet(self.list_columns(done), self._options.units, self._robot.prismatic.tolist())
        table = compress_file("rows", pack_sheet(sheet))
        return CorrectionResult(**done.describe(self._robot), table=table)


def pack_file(name: str, content: bytes) -> ProgramFile:
    """Read a CSV or Parquet file of poses; return it as a request stores it.

    Raises:
        RequestError: the file is not understood, or has too many columns.
        TooManyRowsError: the file has too many rows.
        MissingExtraError: the library for Parquet is not installed.
    """
    table = read_number_table(content, TABLE_LIMITS)
    labels = {} if table.labels is None else {LABEL: table.labels}
    return compress_file(name, pack_sheet(Sheet(labels | table.columns, frozenset(labels))))


def pack_columns(columns: dict[str, Any], options: CorrectionOptions, robot: Robot) -> ProgramFile:
    """Return the columns of a request, in the units of its options, as the table of a stored request.

    Raises:
        RequestError: columns are missing, unknown, of different lengths, or not finite.
        TooManyRowsError: the table has too many rows.
    """
    TABLE_LIMITS.refuse_rows(max(map(len, columns.values())))
    columns = name_joint_columns(columns, robot)
    PoseTable.from_columns(columns, options.units, robot)
    small = {name.lower(): np.asarray(column, dtype=np.float64) for name, column in columns.items()}
    sheet = make_sheet(small, options.units, robot.prismatic.tolist())
    return compress_file("columns", pack_sheet(replace(sheet, digits="")))


def prepare_correction(inputs: Inputs, request: CorrectionRequest) -> Work:
    """Fetch the run or robot of a request, and return the work of its table or program.

    Raises:
        RequestError: run or robot do not exist or give no model, the table or program cannot be used, or an
            option does not concern it.
    """
    is_program = request.is_program
    refuse_foreign_fields(request, is_program=is_program)
    if request.run_id is None:
        robot_id = request.robot_id or ""
        if is_program:
            remedy = "give `run_id`: the model of a run corrects a program"
            raise RequestError("a program needs a run", where="robot_id", remedy=remedy)
        robot, content = inputs.robot(robot_id, "robot_id")
        return StoredCorrectionWork(robot, robot_id, None, request, content)
    run = find_accepted_run(inputs, request.run_id, request.accept_verdict)
    robot, robot_id = run.prepared.robot, run.prepared.robot_id
    if not is_program:
        return StoredCorrectionWork(robot, robot_id, run.run, request)
    if sum(file.bytes for file in request.files) > _MAX_PROGRAM_BYTES:
        raise RequestError("the files exceed 16 MiB", where="files", remedy="split the program")
    with naming_missing_extra("a program file"):
        from jointstiff.service.kinds.correction.programs import ProgramWork, refuse_corrected_files
    refuse_corrected_files(inputs, request, robot_id)
    return ProgramWork(robot, robot_id, run.run, request)
