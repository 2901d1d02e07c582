"""Terminal tables and reports."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.solver.doors import names_of

if TYPE_CHECKING:
    from jointstiff.service.render.arms import arm_report, arms_table
    from jointstiff.service.render.geometry_table import geometry_report
    from jointstiff.service.render.import_table import import_report
    from jointstiff.service.render.keys_table import keys_table
    from jointstiff.service.render.map_table import map_report
    from jointstiff.service.render.methods_table import comparison_report
    from jointstiff.service.render.pair_table import pair_report
    from jointstiff.service.render.plan_table import plan_csv, plan_report
    from jointstiff.service.render.program_table import program_report
    from jointstiff.service.render.run_table import run_report
    from jointstiff.service.render.stiffness import UNITS
    from jointstiff.service.render.terminal import METHOD_NAMES, console, problem_text, progress_bar
else:
    __getattr__ = names_of(
        __name__,
        arms="arm_report arms_table",
        geometry_table="geometry_report",
        import_table="import_report",
        keys_table="keys_table",
        map_table="map_report",
        methods_table="comparison_report",
        pair_table="pair_report",
        plan_table="plan_csv plan_report",
        program_table="program_report",
        run_table="run_report",
        stiffness="UNITS",
        terminal="METHOD_NAMES console problem_text progress_bar",
    )

__all__ = [
    "METHOD_NAMES",
    "UNITS",
    "arm_report",
    "arms_table",
    "comparison_report",
    "console",
    "geometry_report",
    "import_report",
    "keys_table",
    "map_report",
    "pair_report",
    "plan_csv",
    "plan_report",
    "problem_text",
    "program_report",
    "progress_bar",
    "run_report",
]
