"""A compensated program for people: what it promises, and its worst points."""

from __future__ import annotations

from jointstiff.schemas.program import Program, ProgramResult
from jointstiff.service.tables.report import Report, View
from jointstiff.service.tables.table import Column, Line, Part, Sheet, Table, ends, number

_SHOWN = 8
_REASONS = {
    "no_load": "without load",
    "uncertain": "whose deflection is less than its uncertainty",
    "not_used": "that no move uses",
}


def report(_job: Program, result: ProgramResult, _view: View) -> Report:
    """Return counts, spreads, the worst points, and what was left alone."""
    left = ", ".join(f"{count} {_REASONS[reason]}" for reason, count in result.left_alone.items())
    capped = f"; {result.capped} held back by the limits" if result.capped else ""
    alone = f"; left alone: {left}" if left else ""
    counts = Line(f"{result.corrected} of {result.points} targets corrected{capped}{alone}")
    worst: list[Part] = [_worst(result)] if result.worst else []
    return Report([counts, _spreads(result), *worst, *map(Line, result.remarks)])


def _spreads(result: ProgramResult) -> Table:
    rows = {
        "without correction": result.deflection,
        "as written, predicted": result.residual,
        "  of that, rounding": result.rounding,
        "displacement of targets": result.correction,
    }
    shown = number(".4f", 1e3)
    return Table(
        [
            Column("quantity", list(rows), text=True),
            Column("median", [each and each.median for each in rows.values()], shown),
            Column("95 %", [each and each.p95 for each in rows.values()], shown),
            Column("greatest", [each and each.greatest for each in rows.values()], shown),
        ],
        title="Distance of the loaded tool from its target, mm",
    )


def _worst(result: ProgramResult) -> Table:
    points, interval = result.worst[:_SHOWN], ends(".3f", 1e3, " … ")
    return Table(
        [
            Column("point", [point.number for point in points]),
            Column("name", [point.name for point in points], text=True),
            Column("line", [point.line for point in points]),
            Column("deflection", [point.deflection for point in points], number(".3f", 1e3), "mm"),
            Column(
                f"{100 * result.confidence:g} %, readings only",
                [point.interval for point in points],
                interval,
                "mm",
            ),
            Column("with model error", [point.interval_with_model_error for point in points], interval, "mm"),
            Column("residual", points, lambda p: f"{1e3 * p.residual:.4f}{p.capped * ' (capped)'}", "mm"),
        ],
        title="Worst points",
    )


def points_sheet(job: Program) -> Sheet:
    """Return all points: place, posture, deflection, correction, intervals, residual, what was left alone."""
    from jointstiff.service.kinds.program.points import points_sheet  # reports do without the solver
    from jointstiff.service.kinds.program.work import unpacked

    if job.result is None:
        raise ValueError("the program has no result")
    return points_sheet(unpacked(job.result.table))
