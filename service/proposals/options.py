"""Options of an import that explain files, and those that a proposal leaves for the table that it writes."""

from __future__ import annotations

from typing import Final

from jointstiff.schemas.imports import ImportRequest

OPTIONS_OF_COLUMNS: Final = (
    "columns",
    "header",
    "ignore",
    "layouts",
    "delimiter",
    "decimal_mark",
    "units",
    "by_order",
)
"""Options that explain the columns of files, which the written table explains itself."""

OPTIONS_OF_NAMES: Final = ("state", "point_name", "file_name", "state_words")
"""Options that explain names of points, files and states, which the written table does not need either."""

OPTIONS_OF_FILES: Final = (
    *("columns", "header", "ignore", "delimiter", "decimal_mark", "by_order"),
    *("state", "state_words", "point_name", "sheet"),
)
"""Options that a template keeps of files that a proposal explains."""


def clear_headers() -> dict[str, object]:
    """Return the options that explain columns, with their defaults."""
    empty = ImportRequest()
    return {name: getattr(empty, name) for name in OPTIONS_OF_COLUMNS}


def clear_names() -> dict[str, object]:
    """Return the options that explain names of points, files and states, with their defaults."""
    empty = ImportRequest()
    return {name: getattr(empty, name) for name in OPTIONS_OF_NAMES}


def state_units(request: ImportRequest) -> dict[str, object]:
    """Return the units of forces and moments, which the written table may leave open."""
    if request.units is None:
        return {}
    return {"units": request.units.model_copy(update={"length": None, "angle": None})}
