"""Reports that people sign: one document a run or another job, as PDF and as HTML."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.solver.doors import names_of

if TYPE_CHECKING:
    from jointstiff.service.reports.document import Document, Section, State, Table
    from jointstiff.service.reports.job import REPORTED_KINDS, job_document
    from jointstiff.service.reports.laboratory import (
        LaboratorySettings,
        SettingsError,
        read_laboratory,
    )
    from jointstiff.service.reports.page import POLICY, report_page
    from jointstiff.service.reports.pdf import NoTypstError, report_pdf
    from jointstiff.service.reports.run import RunSubject, run_document
    from jointstiff.service.reports.state import draft, state_of
else:
    __getattr__ = names_of(
        __name__,
        document="Document Section State Table",
        job="REPORTED_KINDS job_document",
        laboratory="LaboratorySettings SettingsError read_laboratory",
        page="POLICY report_page",
        pdf="NoTypstError report_pdf",
        run="RunSubject run_document",
        state="draft state_of",
    )

__all__ = [
    "POLICY",
    "REPORTED_KINDS",
    "Document",
    "LaboratorySettings",
    "NoTypstError",
    "RunSubject",
    "Section",
    "SettingsError",
    "State",
    "Table",
    "draft",
    "job_document",
    "read_laboratory",
    "report_page",
    "report_pdf",
    "run_document",
    "state_of",
]
