"""Sheets of a workbook that a proposal reads, if the names of the sheets do not show them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, islice
from typing import Final, NamedTuple

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import quote
from jointstiff.service.importing.grid import COORDINATES
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.proposals.tables.numbers import NumberTable, read_number_tables
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.table import find_moving_columns

_MOST_CHOICES: Final = 16
"""Choices of sheets that are tried: those of five sheets without two of them."""
_LEAST_PART: Final = 0.5
"""Least number of rows of a sheet that may have readings, as a part of the postures."""


class SheetChoice(NamedTuple):
    """Sheets of a workbook with data: those that are read, and those that are not."""

    read: tuple[str, ...]
    left: tuple[str, ...]

    def state_in(self, request: ImportRequest) -> ImportRequest:
        """Return the request with the sheets that are read."""
        return request.model_copy(update={"sheet": ";".join(self.read)})

    @property
    def note(self) -> str:
        """Sheets in words."""
        read = f"sheets {', '.join(map(quote, self.read))} read"
        return f"{read}, not {', '.join(map(quote, self.left))}" if self.left else read


def list_choices(names: Sequence[str], *, is_robot_stated: bool) -> Iterator[SheetChoice]:
    """Yield choices of the sheets of a workbook with data: first all, then without one, without two ….

    Without a stated robot, whose tables take long, all sheets are the only choice.
    """
    if any(";" in name for name in names):  # separates names in the option
        return
    choices = (
        SheetChoice(tuple(name for name in names if name not in left), left)
        for count in range(len(names))
        for left in combinations(names, count)
    )
    yield from islice(choices, _MOST_CHOICES if is_robot_stated else 1)


def may_have_readings(
    choice: SheetChoice, proposal: Proposal, files: Sequence[SourceFile], request: ImportRequest
) -> bool:
    """Return whether a sheet that is not read may have readings, or loads, of the postures of a proposal.

    Raises:
        ImportFileError: a sheet cannot be read.
    """
    if not choice.left:
        return False
    postures = len(proposal.readings[0].positions)
    others = SheetChoice(choice.left, ()).state_in(request)
    tables = read_number_tables(files, others, proposal.robots[0].robot.joint_names).tables
    return any(_has_numbers_of(table, postures) for table in tables)


def _has_numbers_of(table: NumberTable, postures: int) -> bool:
    """Return whether a table may have readings or loads for at least half the postures."""
    has_loads = any(each is not None and each.kind in ("force", "mass") for each in table.meanings)
    moving_count = sum(find_moving_columns(table.table.numbers))
    return len(table.rows) >= _LEAST_PART * postures and (has_loads or moving_count >= COORDINATES)
