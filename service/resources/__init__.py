"""Robots and measurement sets as stored resources."""

from __future__ import annotations

from jointstiff.service.resources.imports import FilesError, import_files
from jointstiff.service.resources.measurement_sets import MeasurementSets, assembled
from jointstiff.service.resources.prepared import PreparedSet
from jointstiff.service.resources.robots import Robots

__all__ = ["FilesError", "MeasurementSets", "PreparedSet", "Robots", "assembled", "import_files"]
