"""Tables and figures of the paper for a comparison: Ambiehl, Garnier, Subrin, Furet, IROS 2017."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from jointstiff.schemas.comparison import ComparedRun, ComparedSide, Comparison, ComparisonResult, Side
from jointstiff.schemas.finding import Problem
from jointstiff.service.kinds.comparison.kind import COMPARISON, make_charts
from jointstiff.service.problems import CampaignError, http_problem
from jointstiff.service.reports.document import Document, Letterhead, Section, list_versions
from jointstiff.service.reports.job import job_parts
from jointstiff.service.reports.pictures import draw_bars
from jointstiff.service.tables.report import View
from jointstiff.service.tables.table import NO_NUMBER, Line, Table, build_text_table, format_percent

if TYPE_CHECKING:  # few comparisons have a geometry
    from jointstiff.schemas.geometry import Geometry, WristResult

_TITLE = "Stiffness by three methods, as in Ambiehl et al. (IROS 2017)"


def build_paper(job: Comparison, view: View | None = None, geometry: Geometry | None = None) -> Document:
    """Build a document of a comparison with the tables and figures of the paper.

    Table I has the wrist centre by three targets with their offsets, Table II the stiffnesses; figure 7 has
    the deflection of each configuration, figure 8 what the methods leave over.

    Args:
        job: comparison with a result.
        view: how numbers are shown.
        geometry: geometry of the same robot by sweeps, for Table I; None leaves the table out.

    Raises:
        CampaignError: the comparison has no result, or the geometry has no wrist centre by targets.
    """
    result = require_result(job)
    sections = list[Section]()
    if geometry is not None:
        sections.append(_make_wrist_section(require_wrist(geometry)))
    deflections = _make_deflection_table(result)
    sections.append(Section("Measurement sets and explained deflection", tables=[deflections]))
    sections.append(_make_stiffness_section(job, view or View()))
    pictures = [draw_bars(chart) for chart in make_charts(result)]
    sections.append(Section("Figures 7 and 8", pictures=pictures))
    sections.append(Section("Origin", facts=[("Versions", list_versions(job))]))
    return Document(
        title=_TITLE,
        number=job.id,
        letterhead=Letterhead("", []),
        dated=job.provenance.ended_at or job.provenance.created_at,
        sections=sections,
        signs=False,
    )


def _make_stiffness_section(job: Comparison, view: View) -> Section:
    """Return Table II: the stiffnesses by each method, with the notes of the comparison."""
    tables, notes = list[Table](), list[str]()
    for part in job_parts(COMPARISON, job, view):
        if isinstance(part, Table):
            tables.append(part)
        elif isinstance(part, Line) and part.text.strip():
            notes.append(part.text.strip())
    return Section("Table II: stiffness", tables=tables, notes=notes)


def require_result(job: Comparison) -> ComparisonResult:
    """Return the result of a comparison; raise CampaignError with its error, if it has none."""
    if job.result is None:
        problem: Problem = job.error or http_problem(409, f"the comparison is {job.state}", "compare again")
        raise CampaignError(problem)
    return job.result


def require_wrist(geometry: Geometry) -> WristResult:
    """Return the wrist centre of a geometry with the offsets of targets.

    Raises:
        CampaignError: the geometry has no wrist centre by targets.
    """
    wrist = None if geometry.result is None else geometry.result.wrist
    if wrist is None or not wrist.targets:
        remedy = (
            "give a result of `jointstiff geometry SWEEPS.json --save FILE` with sweeps of the wrist's joints"
        )
        raise CampaignError(http_problem(422, "the geometry has no wrist centre by three targets", remedy))
    return wrist


def _make_wrist_section(wrist: WristResult) -> Section:
    """Return Table I: the wrist centre by three targets, with their offsets."""
    # Imported here, as few comparisons have a geometry
    from jointstiff.service.kinds.geometry.kind import make_wrist_table, make_wrist_targets_table

    return Section(
        "Table I: wrist centre by three targets",
        tables=[make_wrist_targets_table(wrist), make_wrist_table(wrist)],
    )


def _make_deflection_table(result: ComparisonResult) -> Table:
    """Return the table that compares both sets, with a row for each set.

    A row has the number of configurations, the mean deflection [mm], and for each method the fraction of the
    deflection that the method explains.
    """
    methods = list(dict.fromkeys(_name_method(entry) for entry in result.entries))
    rows = list[list[str]]()
    for side in result.sides:
        explained = _list_explained(result.entries, side.side)
        fractions = [explained.get(method, NO_NUMBER) for method in methods]
        rows.append([side.side, str(len(side.configurations)), _format_mean_deflection(side), *fractions])
    head = ["set", "configurations", "mean deflection [mm]", *methods]
    caption = "of each method: fraction of the mean deflection that the method explains"
    return build_text_table(head, rows, caption=caption)


def _name_method(entry: ComparedRun) -> str:
    """Return method and weighting in words: "partial pose", or "partial pose, uniform"."""
    name = entry.method.replace("_", " ")
    if entry.weighting == "covariance":
        return name
    return f"{name}, {entry.weighting.replace('_', ' ')}"


def _list_explained(entries: Sequence[ComparedRun], side: Side) -> dict[str, str]:
    """Return method → the fraction of the deflection that it explains on a side, as text.

    A method with and without the constraint of positive stiffness has two entries: the constrained entry is
    the last, and replaces the other.
    """
    return {
        _name_method(entry): format_percent(entry.compensation) for entry in entries if entry.side == side
    }


def _format_mean_deflection(side: ComparedSide) -> str:
    """Return the mean deflection [mm] of a side's configurations; a dash if it is not known."""
    lengths = [length for length in side.deflection if length is not None]
    return f"{1e3 * sum(lengths) / len(lengths):.3f}" if lengths else NO_NUMBER
