"""Names of columns of the table of places, which its map of the work area reads."""

from __future__ import annotations

from typing import Final

OF_GRID: Final = "of grid"
"""Column of the table of places: whether the place is one of the grid."""
OF_AREA: Final = ("x [m]", "y [m]", "deflection [m]")
"""Columns of the map of the work area."""
