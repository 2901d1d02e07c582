"""A run as an Excel workbook: a sheet for joints, kinematics, provenance and warnings each."""

from __future__ import annotations

import io
from typing import Any

from openpyxl import Workbook
from openpyxl.styles import Font
from openpyxl.utils import get_column_letter

from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.exporting.tables import (
    Table,
    joints_table,
    kinematics_table,
    remarks_table,
    warnings_table,
)
from jointstiff.service.kinds.comparison.csv_table import guarded


def workbook(model: ExportedModel) -> bytes:
    """Return the workbook; numbers have 16 digits, and no cell is a formula."""
    book = Workbook(write_only=False)
    book.remove(book.worksheets[0])
    for name, table in (
        ("joints", joints_table(model)),
        ("kinematics", kinematics_table(model)),
        ("provenance", remarks_table(model)),
        ("warnings", warnings_table(model)),
    ):
        if table:
            _fill(book.create_sheet(name), table)
    content = io.BytesIO()
    book.save(content)
    return content.getvalue()


def _fill(sheet: Any, table: Table) -> None:  # noqa: ANN401 - the library has no types
    sheet.append([guarded(header) for header in table[0]])
    for row in table:
        sheet.append([guarded(cell) for cell in row.values()])
    for place, cell in enumerate(sheet[1], 1):
        cell.font = Font(bold=True)
        sheet.column_dimensions[get_column_letter(place)].width = min(len(str(cell.value)) + 2, 40)
    sheet.freeze_panes = "B2"
