"""Terminal tables and reports."""

from __future__ import annotations

from jointstiff.service.render.comparison_table import comparison_table
from jointstiff.service.render.geometry_table import geometry_report
from jointstiff.service.render.import_table import import_report
from jointstiff.service.render.pair_table import pair_report
from jointstiff.service.render.terminal import console, problem_text, progress_bar, run_report

__all__ = [
    "comparison_table",
    "console",
    "geometry_report",
    "import_report",
    "pair_report",
    "problem_text",
    "progress_bar",
    "run_report",
]
