"""A run as an Excel workbook: a sheet for joints, kinematics, provenance and warnings each."""

from __future__ import annotations

from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.exporting.tables import joints_table, kinematics_table, remarks_table, warnings_table
from jointstiff.service.tables.files import xlsx_bytes


def workbook(model: ExportedModel) -> bytes:
    """Return the workbook; numbers have 16 digits, and no cell is a formula."""
    sheets = {
        "joints": joints_table(model),
        "kinematics": kinematics_table(model),
        "provenance": remarks_table(model),
        "warnings": warnings_table(model),
    }
    return xlsx_bytes({name: sheet for name, sheet in sheets.items() if sheet.columns})
