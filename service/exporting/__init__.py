"""Identified models as files that other programs load: tables, workbooks, URDF, SDF and MJCF."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.solver.doors import names_of

if TYPE_CHECKING:
    from jointstiff.service.exporting.formats import FORMATS, Format, ModelFormat, export_model
    from jointstiff.service.exporting.model import ExportedModel, why_no_stiffness
    from jointstiff.service.exporting.pairs import pair_csv
    from jointstiff.service.exporting.tables import joints_csv
else:
    __getattr__ = names_of(
        __name__,
        formats="FORMATS Format ModelFormat export_model",
        model="ExportedModel why_no_stiffness",
        pairs="pair_csv",
        tables="joints_csv",
    )

__all__ = [
    "FORMATS",
    "ExportedModel",
    "Format",
    "ModelFormat",
    "export_model",
    "joints_csv",
    "pair_csv",
    "why_no_stiffness",
]
