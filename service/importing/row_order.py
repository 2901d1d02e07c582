"""Labels of rows by their order, for files without names."""

from __future__ import annotations

from collections.abc import Sequence

from jointstiff.service.importing.errors import Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grid import Grid
from jointstiff.service.importing.layout import Layout


def labels_in_order(tables: Sequence[tuple[Grid, Layout]], faults: Faults) -> list[str]:
    """Return the labels of observations by row, for files without names.

    Args:
        tables: all files.
        faults: where to tell of rows that cannot be matched.

    Returns:
        Those of the table that has a row for each observation; numbers from 1 if there is none.
    """
    named = [(grid, [row.cells[layout.columns.texts["name"]] for row in layout.rows])
             for grid, layout in tables if "name" in layout.columns.texts and is_whole(layout)]  # fmt: skip
    unnamed = [(grid, layout) for grid, layout in tables if "name" not in layout.columns.texts]
    if not unnamed:
        return []
    first, labels = named[0] if named else (unnamed[0][0], [])
    told = len(faults.found)
    labels = labels or [str(number) for number in range(1, 1 + len(unnamed[0][1].rows))]
    for grid, other in named[1:]:
        if other != labels:
            reason = f"the labels are not those of {shown(first.file)} in their order"
            faults.add(ImportFileError(Place(grid.file), reason, "give every table the same labels"))
    for grid, layout in unnamed:
        if len(layout.rows) != len(labels):
            fault = ImportFileError(
                Place(grid.file),
                f"there are {len(layout.rows)} rows, but {len(labels)} in {shown(first.file)}: they cannot "
                "be matched by their order",
                "give every file a row for each observation, or name the points",
            )
            faults.add(fault)
    return labels if len(faults.found) == told else []


def is_whole(layout: Layout) -> bool:
    """Return whether a table has one row for each observation."""
    columns = layout.columns
    return not columns.needed and "target" not in columns.texts and "state" not in columns.texts
