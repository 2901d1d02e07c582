"""Observation, target and state of each row: by columns, names of points, of files, or order.

A template such as `{label}_{target}_{state}` is what people can write safely: no field may contain a
character that begins a literal text between fields, so a name fits in one way or in none.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Final, NamedTuple

from jointstiff.schemas.fields import MAX_NAME_LENGTH
from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.service.importing.errors import NOWHERE, Faults, ImportFileError, Place, shown
from jointstiff.service.importing.grammar import DIGITS, Kind, names_a_state, state_named
from jointstiff.service.importing.grid import Row
from jointstiff.service.importing.layout import Layout

_FIELD: Final = re.compile(r"\{([^{}]*)\}")
_FIELDS: Final = ("label", "target", "state", "any")


class Naming(NamedTuple):
    """Parts of a name; None where the name has no such part."""

    label: str | None = None
    target: str | None = None
    state: State | None = None

    def merged(self, other: Naming) -> Naming:
        """Return the parts that either of two names has."""
        for kind, one, two in zip(self._fields, self, other, strict=True):
            if one is not None and two is not None and one != two:
                reason = f"the {kind} is {shown(one)} in one name and {shown(two)} in another"
                remedy = "correct the name of the point or of the file, or the templates"
                raise ImportFileError(NOWHERE, reason, remedy)
        return Naming(self.label or other.label, self.target or other.target, self.state or other.state)


class Template:
    """A template that was checked."""

    def __init__(self, text: str) -> None:
        """Check a template."""
        self.text = text
        literals, self._fields = _FIELD.split(text)[::2], _FIELD.findall(text)
        named = [field for field in self._fields if field != "any"]
        faulty = not set(self._fields) <= set(_FIELDS) or not named or len(set(named)) != len(named)
        if faulty or any(not literal for literal in literals[1:-1]) or "{" in "".join(literals):
            remedy = (
                "use each of {label}, {target}, {state} at most once, {any} for the rest, with a text such "
            )
            raise ImportFileError(
                NOWHERE, f"the template {shown(text)} is invalid", f"{remedy}as _ between them"
            )
        excluded = "".join({literal[0] for literal in literals if literal})
        part = f"([^{re.escape(excluded)}]+)" if excluded else "(.+)"
        self._pattern = re.compile(part.join(re.escape(literal) for literal in literals), re.DOTALL)

    def parse(self, name: str, state_words: Mapping[str, State]) -> Naming:
        """Take a name apart."""
        match = self._pattern.fullmatch(name)
        parts = dict(zip(self._fields, match.groups(), strict=True)) if match else {}
        state = state_named(parts["state"], {**DIGITS, **state_words}) if "state" in parts else None
        if match is None or (state is None and "state" in parts):
            raise ImportFileError(
                NOWHERE,
                f"the name {shown(name)} does not fit the template {shown(self.text)}",
                "change the template or rename the point; states are `unloaded`, `loaded`, `deflection`, "
                "and the words in `state_words`",
            )
        return Naming(parts.get("label"), parts.get("target"), state)


def check_name(text: str) -> None:
    """Refuse what no label or target can be."""
    if not text.isprintable() or text != text.strip() or not 0 < len(text) <= MAX_NAME_LENGTH:
        remedy = f"give 1 to {MAX_NAME_LENGTH} printable characters, without blanks at the ends"
        raise ImportFileError(NOWHERE, f"{shown(text)} is not a valid name", remedy)


def names_of(layout: Layout, options: ImportOptions, notes: list[str]) -> Names:
    """Return what names the rows of a file.

    The column `target` of a tracker's own table is its reflector: names of points say the target if they
    do, or that of the file if it says target and state.
    """
    if layout.columns.probe and "target" in layout.columns.texts and layout.rows:
        remarks: list[str] = []
        with suppress(ImportFileError):
            names = Names(layout, options, remarks, without=("target",))
            names.of(layout.rows[0])
            by_file = any("target" in lacking for lacking in names.by_file)
            if not by_file or names_a_state(layout.grid.stem, options.state_words):
                note = f"{layout.grid.file}: the column of targets was read as the instrument's reflector"
                notes += [*remarks, note]
                return names
    return Names(layout, options, notes)


class Names:
    """Label, target and state of each row: from columns, from the point's name, from the file's name."""

    def __init__(
        self, layout: Layout, options: ImportOptions, notes: list[str], without: Sequence[Kind] = ()
    ) -> None:
        """Prepare to name rows; `without` columns that are not used."""
        self._grid, self._notes, self._words = layout.grid, notes, options.state_words
        self._texts = {kind: index for kind, index in layout.columns.texts.items() if kind not in without}
        self._needed = layout.columns.needed | {*without}
        self._named = "name" in self._texts
        self._wanted = (*(("label",) if self._named else ()), *sorted(self._needed))
        kinds: tuple[Kind, ...] = ("collection", "group", "name")
        self._kinds = [kind for kind in kinds if kind in self._texts]
        self.by_file: dict[frozenset[str], Naming] = {}  # what rows have from the name of the file
        self._digits = not names_a_state(layout.grid.stem, options.state_words)
        self._point: Template | None = None
        self._file = Naming()
        try:
            if self._needed and options.point_name:
                self._point = Template(options.point_name)
            if self._needed and options.file_name:
                self._file = Template(options.file_name).parse(self._grid.stem, self._words)
        except ImportFileError as fault:
            raise fault.at(Place(layout.grid.file)) from None

    def of(self, row: Row) -> Naming:
        """Return what is said of a row."""
        name, columns = self._joined(row), self._in_columns(row)
        naming = Naming()
        try:
            if self._named:
                naming = self._point.parse(name, self._words) if self._point else self._default_point(name)
            naming = columns.merged(naming).merged(self._file)
            lacking = frozenset(kind for kind in self._wanted if getattr(naming, kind) is None)
            if lacking:
                naming = naming.merged(self._default_file(lacking))
            if self._named:
                check_name(naming.label or "")
        except ImportFileError as fault:
            raise fault.at(self._grid.place(row, self._texts.get("name"))) from None
        return naming

    def _default_point(self, name: str) -> Naming:
        """Split a name without a template by `::`, else by `_`; the label comes before the target."""
        if not self._needed:
            return Naming(label=name)
        most = 2 if "target" in self._needed else 1
        for words in (self._words, {**DIGITS, **self._words})[: 1 + self._digits]:
            parts, state = _parts(name, words)
            if 1 <= len(parts) <= most and (state is None or "state" in self._needed):
                if words is not self._words:
                    self._note("0 and 1 in names were read as `unloaded` and `loaded`")
                return Naming(parts[0], parts[1] if len(parts) > 1 else None, state)
        reason = f"the name {shown(name)} does not show which observation, target and state it is"
        remedy = "give a template `point_name`, such as {label}_{target}_{state}"
        raise ImportFileError(NOWHERE, reason, remedy, "point_name")

    def _default_file(self, lacking: frozenset[str]) -> Naming:
        """Return what points of a file have in common, from its name: `P10_loaded`, `loaded` or `P10`."""
        if lacking not in self.by_file:
            parts, state = _parts(self._grid.stem, self._words)
            naming = Naming(None, parts[0] if len(parts) == 1 else None, state)
            if len(parts) > 1 or any(getattr(naming, kind) is None for kind in lacking):
                listed = " and the ".join(sorted(lacking, reverse=True))
                raise ImportFileError(
                    Place(self._grid.file),
                    f"the {listed} is given neither by the table nor by the names of points or the file",
                    "name points as in `c01_P10_loaded`, or the file as in `P10_loaded.txt`, or give "
                    "templates `point_name` or `file_name`",
                    "point_name",
                )
            said = " and ".join(f"{kind} {getattr(naming, kind)}" for kind in sorted(lacking))
            self._note(f"{self._grid.file}: {said} by the name of the file")
            self.by_file[lacking] = naming
        return self.by_file[lacking]

    def _note(self, note: str) -> None:
        if note not in self._notes:
            self._notes.append(note)

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
        state = state_named(word, {**DIGITS, **self._words})
        if state is None:
            place = self._grid.place(row, self._texts["state"])
            remedy = "use `unloaded`, `loaded` or `deflection`, or give `state_words`"
            raise ImportFileError(
                place, f"{shown(word)} is not a known state", remedy, "state_words", (word,)
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


def _parts(name: str, words: Mapping[str, State]) -> tuple[list[str], State | None]:
    """The parts of a name without the one that is a word for a state."""
    parts = name.split("::") if "::" in name else name.split("_")
    if not all(parts):
        return [name], None
    states = [state_named(part, words) for part in parts]
    known = [state for state in states if state is not None]
    if len(known) != 1:
        return parts, None
    return [part for part, state in zip(parts, states, strict=True) if state is None], known[0]


def is_whole(layout: Layout) -> bool:
    """Return whether a table has one row for each observation."""
    return not layout.columns.needed and not {"target", "state"} & layout.columns.texts.keys()


def labels_in_order(layouts: Sequence[Layout], faults: Faults) -> list[str]:
    """Return the labels of observations by row, for files without names.

    Returns:
        Those of the table that has a row for each observation; numbers from 1 if there is none.
    """
    unnamed = [layout for layout in layouts if "name" not in layout.columns.texts]
    tables = [layout for layout in layouts if "name" in layout.columns.texts and is_whole(layout)]
    if not unnamed:
        return []
    named = [[row.cells[layout.columns.texts["name"]] for row in layout.rows] for layout in tables]
    labels = named[0] if named else [str(number + 1) for number in range(len(unnamed[0].rows))]
    first, told = shown((tables or unnamed)[0].grid.file), len(faults.found)
    for layout, other in zip(tables, named, strict=True):
        if other != labels:
            reason = f"the labels are not those of {first} in their order"
            faults.report(Place(layout.grid.file), reason, "give every table the same labels")
    for layout in unnamed:
        if len(layout.rows) != len(labels):
            counts = f"there are {len(layout.rows)} rows, but {len(labels)} in {first}"
            reason = f"{counts}: they cannot be matched by their order"
            remedy = "give every file a row for each observation, or name the points"
            faults.report(Place(layout.grid.file), reason, remedy)
    return labels if len(faults.found) == told else []
