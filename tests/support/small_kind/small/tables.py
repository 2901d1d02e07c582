"""Tables of a small kind."""

from __future__ import annotations

from jointstiff.service.kinds.small.messages import Small, SmallResult
from jointstiff.service.tables.report import Report, View
from jointstiff.service.tables.table import Column, Sheet, Table


def report(_job: Small, result: SmallResult, _view: View) -> Report:
    """Return the counts."""
    columns = [Column("observations", [result.observations]), Column("readings", [result.readings])]
    return Report([Table(columns, title="Readings of the set")])


def counts_sheet(job: Small) -> Sheet:
    """Return the counts."""
    return Sheet.of_rows([] if job.result is None else [job.result.model_dump()])


SHEETS = {"counts": counts_sheet}
