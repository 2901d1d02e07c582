"""Label, target and state of each row of a table."""

from __future__ import annotations

from pathlib import PurePath

from jointstiff.schemas.importing import ImportOptions
from jointstiff.service.importing.errors import Fault, ImportFileError, Place, shown
from jointstiff.service.importing.grid import Grid, Row
from jointstiff.service.importing.header import Kind, state_named
from jointstiff.service.importing.layout import Layout
from jointstiff.service.importing.naming import Naming, Template, check_name, default_file, default_point


class Names:
    """Label, target and state of each row: from columns, from the point's name, from the file's name."""

    def __init__(self, grid: Grid, layout: Layout, options: ImportOptions, notes: list[str]) -> None:
        """Prepare to name rows.

        Args:
            grid: the file.
            layout: its columns.
            options: of the caller.
            notes: where to tell what the file's name was taken for.

        Raises:
            ImportFileError: a template is faulty, or the file's name does not fit it.
        """
        self._grid, self._notes = grid, notes
        self._texts = layout.columns.texts
        self._needed = layout.columns.needed
        self._named = "name" in self._texts
        self._wanted = (*(("label",) if self._named else ()), *sorted(self._needed))
        kinds: tuple[Kind, ...] = ("collection", "group", "name")
        self._kinds = [kind for kind in kinds if kind in self._texts]
        self._words = options.state_words
        self._stem = PurePath(grid.file).stem
        self._defaults: dict[frozenset[str], Naming] = {}
        self._point: Template | None = None
        self._file = Naming()
        try:
            if options.point_name and self._needed:
                self._point = Template(options.point_name)
            if options.file_name and self._needed:
                self._file = Template(options.file_name).parse(self._stem, self._words)
        except Fault as fault:
            raise fault.at(Place(grid.file)) from None

    def of(self, row: Row) -> Naming:
        """Return what is said of a row.

        Raises:
            ImportFileError: something is missing or contradicts.
        """
        name, columns = self._joined(row), self._in_columns(row)
        try:
            if not self._named:
                naming = Naming()
            elif self._point is not None:
                naming = self._point.parse(name, self._words)
            else:
                naming = default_point(name, self._needed, self._words)
            naming = _merged(_merged(columns, naming), self._file)
            lacking = frozenset(kind for kind in self._wanted if getattr(naming, kind) is None)
            if lacking:
                naming = _merged(naming, self._default(lacking))
            if self._named:
                check_name(naming.label or "")
        except Fault as fault:
            raise fault.at(self._grid.place(row, self._texts.get("name"))) from None
        return naming

    def _default(self, lacking: frozenset[str]) -> Naming:
        if lacking not in self._defaults:
            try:
                found = self._defaults[lacking] = default_file(self._stem, lacking, self._words)
                said = [f"{kind} {getattr(found, kind)}" for kind in sorted(lacking)]
                self._notes.append(f"{self._grid.file}: {' and '.join(said)} by the name of the file")
            except Fault as fault:
                raise fault.at(Place(self._grid.file)) from None
        return self._defaults[lacking]

    def _joined(self, row: Row) -> str:
        """The name of a point, with its collection and group before it if there are such columns."""
        parts = [self._text(row, kind) for kind in self._kinds]
        if len(parts) > 1 and any("::" in part for part in parts):
            place = self._grid.place(row, self._texts["name"])
            raise ImportFileError(place, f"the name {shown('::'.join(parts))} contains ::", "rename it")
        return "::".join(parts)

    def _in_columns(self, row: Row) -> Naming:
        target = self._text(row, "target") if "target" in self._texts else None
        if "state" not in self._texts:
            return Naming(None, target)
        word = self._text(row, "state")
        state = state_named(word, self._words)
        if state is None:
            raise ImportFileError(
                self._grid.place(row, self._texts["state"]),
                f"{shown(word)} is not a known state",
                "use `unloaded`, `loaded` or `deflection`, or give `state_words`",
                "state_words",
            )
        return Naming(None, target, state)

    def _text(self, row: Row, kind: Kind) -> str:
        index = self._texts[kind]
        place = self._grid.place
        if row.kinds is not None and row.kinds[index] not in ("text", "number"):
            raise ImportFileError(place(row, index), f"{row.kinds[index]} as {kind}", "enter it as text")
        if not row.cells[index]:
            raise ImportFileError(place(row, index), f"the {kind} is empty", "fill it in, in every row")
        return row.cells[index]


def _merged(first: Naming, second: Naming) -> Naming:
    for kind in ("label", "target", "state"):
        one, other = getattr(first, kind), getattr(second, kind)
        if one is not None and other is not None and one != other:
            raise Fault(
                f"the {kind} is {shown(one)} by one name and {shown(other)} by another",
                "correct the name of the point or of the file, or the templates",
            )
    return Naming(first.label or second.label, first.target or second.target, first.state or second.state)
