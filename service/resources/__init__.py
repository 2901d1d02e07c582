"""Robots and measurement sets as stored resources; imports, which are not stored."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.solver.doors import names_of

if TYPE_CHECKING:
    from jointstiff.service.resources.composition import Resources
    from jointstiff.service.resources.imports import import_files, inspect_import
    from jointstiff.service.resources.measurement_sets import MeasurementSets, assembled
    from jointstiff.service.resources.nominal_arms import catalogue, find_arm, nominal_robot
    from jointstiff.service.resources.robots import Robots, described
    from jointstiff.service.resources.stored_jobs import read_job, stored_job
    from jointstiff.service.resources.trends import Trends
else:
    __getattr__ = names_of(
        __name__,
        nominal_arms="catalogue find_arm nominal_robot",
        composition="Resources",
        imports="import_files inspect_import",
        measurement_sets="MeasurementSets assembled",
        robots="Robots described",
        stored_jobs="read_job stored_job",
        trends="Trends",
    )

__all__ = [
    "MeasurementSets",
    "Resources",
    "Robots",
    "Trends",
    "assembled",
    "catalogue",
    "described",
    "find_arm",
    "import_files",
    "inspect_import",
    "nominal_robot",
    "read_job",
    "stored_job",
]
