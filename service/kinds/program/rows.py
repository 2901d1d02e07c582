"""A path as an array in place of a program's text: rows of numbers in, rows of other numbers out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.schemas.measurement import Units
from jointstiff.service.conversion.units import ANGLE, LENGTH
from jointstiff.service.runs.correction.columns import POSITION, TABLE_LIMITS, convert_headers
from jointstiff.service.runs.correction.orientation import ROTATION_VECTOR
from jointstiff.service.runs.correction.poses import PoseTable
from jointstiff.service.tables.files import write_sheet
from jointstiff.service.tables.packed import is_packed, unpack_sheet
from jointstiff.service.tables.table import Sheet
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import Robot
from robotprograms import BLOCK, Edit, Notation, Orientation, Program

_COLUMNS: Final = (*POSITION, *ROTATION_VECTOR)
_ANSWER: Final = "path.csv"
"""Name of the table that is written, and of the rows in messages."""


@dataclass(frozen=True, eq=False)
class PathRows:
    """N poses of a tool in a base, position and rotation vector, along a path of lines."""

    program: Program  # a move to each row
    units: Units  # of the program's numbers

    @classmethod
    def unpack(cls, content: bytes, units: Units, robot: Robot) -> PathRows:
        """Read packed columns of poses, whose headers have units.

        Raises:
            RequestError: the bytes are damaged, a column is missing or unknown, or a number is not finite.
        """
        sheet = unpack_sheet(content)
        if sheet.texts:
            raise RequestError("the packed path has texts", where="files", remedy="pack numbers alone")
        TABLE_LIMITS.refuse_columns(len(sheet.columns))
        TABLE_LIMITS.refuse_rows(max(map(len, sheet.columns.values()), default=0))
        columns = convert_headers(sheet.columns, units, robot)
        _refuse_other_columns(columns)
        PoseTable.from_columns(columns, units, robot)  # refuses what `correct` refuses
        numbers = np.stack([columns[name] for name in _COLUMNS], axis=1)
        notation = Notation(Orientation.ROTATION_VECTOR, LENGTH[units.length], ANGLE[units.angle])
        return cls(Program.from_rows(_ANSWER, numbers, notation), units)


def _refuse_other_columns(columns: Mapping[str, FloatArray]) -> None:
    """Refuse rows that have other columns than a position and a rotation vector.

    Raises:
        RequestError: names a column that is missing, or is too many.
    """
    others = sorted(columns.keys() ^ set(_COLUMNS))
    if others:
        raise RequestError(
            f"the column {others[0]} of the packed path is missing, or is not a column of a pose",
            where="files",
            remedy="give x, y, z and a rotation vector rx, ry, rz, with units in the headers",
        )


def find_rows(files: Mapping[str, bytes], units: Units, robot: Robot) -> PathRows | None:
    """Return the rows in the sent files of a path, by name; None if these are the texts of a program.

    Raises:
        RequestError: the rows cannot be used, or there are further files.
    """
    if not any(is_packed(content) for content in files.values()):
        return None
    if len(files) > 1:
        raise RequestError(
            "a packed path was sent with further files", where="files", remedy="send one path, and its loads"
        )
    (content,) = files.values()
    return PathRows.unpack(content, units, robot)


class RowsWriting:
    """Rows of a path while their numbers are replaced; they have all digits."""

    def __init__(self, rows: PathRows) -> None:
        """Begin with the numbers as sent."""
        targets = rows.program.targets
        self.program = replace(rows.program, targets=replace(targets, values=targets.values.copy()))
        self._units = rows.units

    def blocks(self, indices: IndexArray) -> Iterator[IndexArray]:
        """Divide targets, given by their indices, into blocks of positions in `indices`."""
        for start in range(0, len(indices), BLOCK):
            yield np.arange(start, min(start + BLOCK, len(indices)))

    def replace(
        self,
        rows: IndexArray,
        values: FloatArray,
        words: Sequence[tuple[int, Edit]] = (),  # noqa: ARG002 - as of `Rewriting`: rows state no configuration
    ) -> FloatArray:
        """Replace the numbers of m rows by new ones (m, 7), unless these are NaN; return all as written."""
        written = self.program.targets.values
        count = values.shape[1]
        written[rows, :count] = np.where(np.isfinite(values), values, written[rows, :count])
        return np.asarray(written[rows, :count])

    def files(self) -> list[bytes]:
        """Return the rows as a CSV table, in the units of the request."""
        length, angle = self._units.length, self._units.angle
        headers = [f"{name} [{length}]" for name in POSITION]
        headers += [f"{name} [{angle}]" for name in ROTATION_VECTOR]
        numbers = self.program.targets.values[:, : len(headers)].T
        return [write_sheet(Sheet(dict(zip(headers, numbers, strict=True))), "csv")]
