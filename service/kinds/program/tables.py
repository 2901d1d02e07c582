"""A compensated program for people: what it promises, and its worst points."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from jointstiff.schemas.program import Program, ProgramResult, Spread
from jointstiff.service.tables.terminal import problem_text

_SHOWN = 8
_REASONS = {
    "no_load": "without load",
    "uncertain": "whose deflection is less than its uncertainty",
    "not_used": "that no move uses",
}


def program_report(program: Program) -> RenderableType:
    """Lay out counts, spreads, the worst points and what was left alone."""
    result = program.result
    if result is None:
        return problem_text(program.error) if program.error else Text(f"the program is {program.state}")
    parts: list[RenderableType] = [Text(_counts(result)), _spreads(result)]
    if result.worst:
        parts.append(_worst(result))
    return Group(*parts, *(Text(remark) for remark in result.remarks))


def _counts(result: ProgramResult) -> str:
    left = ", ".join(f"{count} {_REASONS[reason]}" for reason, count in result.left_alone.items())
    capped = f"; {result.capped} held back by the limits" if result.capped else ""
    alone = f"; left alone: {left}" if left else ""
    return f"{result.corrected} of {result.points} targets corrected{capped}{alone}"


def _spreads(result: ProgramResult) -> Table:
    table = Table(title="Distance of the loaded tool from its target, mm", title_justify="left")
    table.add_column("")
    for heading in ("median", "95 %", "greatest"):
        table.add_column(heading, justify="right")
    for name, spread in (
        ("without correction", result.deflection),
        ("as written, predicted", result.residual),
        ("  of that, rounding", result.rounding),
        ("displacement of targets", result.correction),
    ):
        table.add_row(name, *_millimetres(spread))
    return table


def _worst(result: ProgramResult) -> Table:
    table = Table(title="Worst points", title_justify="left")
    for heading in (
        "point",
        "name",
        "line",
        r"deflection \[mm]",
        rf"{100 * result.confidence:g} %, readings only \[mm]",
        r"with model error \[mm]",
        r"residual \[mm]",
    ):
        table.add_column(heading, justify="right")
    for point in result.worst[:_SHOWN]:
        capped = " (capped)" if point.capped else ""
        table.add_row(
            str(point.number),
            Text(point.name),
            str(point.line),
            f"{1e3 * point.deflection:.3f}",
            _interval(point.interval),
            _interval(point.interval_with_model_error),
            f"{1e3 * point.residual:.4f}{capped}",
        )
    return table


def _interval(ends: tuple[float, float] | None) -> str:
    return "—" if ends is None else f"{1e3 * ends[0]:.3f} … {1e3 * ends[1]:.3f}"


def _millimetres(spread: Spread | None) -> tuple[str, ...]:
    if spread is None:
        return ("—",) * 3
    return tuple(f"{1e3 * value:.4f}" for value in (spread.median, spread.p95, spread.greatest))
