"""Rows to observations: which observation, target and state each row speaks of, and its numbers.

Names are split at `::` or `_`, or by a template such as `{label}_{target}_{state}`, which people can write
safely: no field may contain a character that begins a text between fields, so a name fits in one way or none.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from math import sqrt
from typing import Final, NamedTuple

from jointstiff.schemas.fields import MAX_NAME_LENGTH
from jointstiff.schemas.imports import ImportOptions, State
from jointstiff.service.importing.errors import NOWHERE, Faults, ImportFileError, Place, quote
from jointstiff.service.importing.grammar import (
    POINTS,
    STATE_OF_DIGIT,
    Kind,
    Quantity,
    contains_state_word,
    find_state,
    find_state_in_name,
    find_unit_of_readings,
    lacks_number,
)
from jointstiff.service.importing.grid import (
    CellKind,
    Row,
    looks_like_a_number,
    read_number,
    remove_thousands_separators,
)
from jointstiff.service.importing.layout import Layout
from jointstiff.service.importing.phrases import join_state_phrases
from jointstiff.service.tables.labels import fold_word

_FIELD: Final = re.compile(r"\{([^{}]*)\}")
_FIELDS: Final = ("label", "target", "state", "any")
_ONLY_TARGET: Final = "T1"
"""Name of a target that neither headers nor names give."""
_POINT_NAME_COLUMNS: Final[tuple[Kind, ...]] = ("collection", "group", "name")
"""Columns that make the name of a point."""
_MIN_STATE_LETTERS: Final = 4
"""Fewest letters of a state word at the end of a name: shorter words may be abbreviations of other things."""
_COVERAGE_FACTOR: Final = 1.96
"""Coverage factor of the expanded uncertainties U(95) that trackers write."""
_HALF_MICROMETRE: Final = 5e-4
"""Expanded uncertainty [mm] assumed for a written 0: trackers round to whole micrometres."""
_DAY_MONTH_YEAR: Final = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})[ T,]+(.*)")
"""A date by day, month and year, and a time of day."""
_ENTER_A_NUMBER: Final = (
    "enter a number, and format the cell as a number; replace a formula without a stored value by its value"
)
_REMEDIES: Final[Mapping[CellKind, str]] = {
    "complex number": "save the real part, or skip the column with `ignore`",
    "half-precision number": "save the numbers in single or double precision, as these have three digits",
}
"""What to do about a cell of an array that is no number."""
_UNCERTAINTIES: Final[tuple[Kind, ...]] = ("uncertainty", "point uncertainty")


# ---- names


class NameParts(NamedTuple):
    """Parts of a name; None where the name has no such part."""

    label: str | None = None
    target: str | None = None
    state: State | None = None

    def merge(self, other: NameParts) -> NameParts:
        """Return the label, target and state that two names together give.

        Raises:
            ImportFileError: the names contradict each other.
        """
        for kind, own_part, other_part in zip(self._fields, self, other, strict=True):
            if own_part is not None and other_part is not None and own_part != other_part:
                reason = f"the {kind} is {quote(own_part)} in one name and {quote(other_part)} in another"
                remedy = "correct the name of the point or of the file, or `point_name` or `file_name`"
                raise ImportFileError(NOWHERE, reason, remedy)
        return NameParts(self.label or other.label, self.target or other.target, self.state or other.state)


def _are_distinct_fields(fields: list[str]) -> bool:
    """Return whether the fields of a template are known, one of them is no `any`, and none is named twice."""
    named = [field for field in fields if field != "any"]
    return bool(named) and set(fields) <= set(_FIELDS) and len(set(named)) == len(named)


def _separate_fields(literals: list[str]) -> bool:
    """Return whether the texts before, between and behind the fields of a template separate the fields.

    A text between two fields must not be empty; no text has a brace, which would be a broken field.
    """
    return all(literals[1:-1]) and not any("{" in literal for literal in literals)


class Template:
    """Checked template of names, such as `{label}_{target}_{state}`."""

    def __init__(self, option: str, text: str) -> None:
        """Check the text of a template and compile its pattern; `option` is the option that has the text.

        Raises:
            ImportFileError: the template is invalid.
        """
        self.option, self.text = option, text
        literals, self._fields = _FIELD.split(text)[::2], _FIELD.findall(text)  # literals are between fields
        if not _are_distinct_fields(self._fields) or not _separate_fields(literals):
            allowed_fields = "{label}, {target}, {state} at most once, {any} for the rest"
            reason = f"the template {quote(text)} is invalid"
            remedy = f"in `{option}` use each of {allowed_fields}, with a text such as _ between them"
            raise ImportFileError(NOWHERE, reason, remedy, option)
        # No field contains a character that begins a text between fields: a name then fits in one way only.
        excluded = "".join({literal[0] for literal in literals if literal})
        field_pattern = f"([^{re.escape(excluded)}]+)" if excluded else "(.+)"
        self._pattern = re.compile(field_pattern.join(re.escape(literal) for literal in literals), re.DOTALL)

    def parse(self, name: str, state_words: Mapping[str, State]) -> NameParts:
        """Split a name into label, target and state; None for a part that the template lacks.

        `state_words` are the caller's words for states.

        Raises:
            ImportFileError: the name does not fit the template.
        """
        match = self._pattern.fullmatch(name)
        parts = dict(zip(self._fields, match.groups(), strict=True)) if match else {}
        state = find_state(parts["state"], {**STATE_OF_DIGIT, **state_words}) if "state" in parts else None
        if match is None or (state is None and "state" in parts):
            reason = f"the name {quote(name)} does not fit the template {quote(self.text)}"
            kind_of_name = "point" if self.option == "point_name" else "file"
            words = "states are `unloaded`, `loaded`, `deflection`, and the words in `state_words`"
            remedy = f"change `{self.option}` or rename the {kind_of_name}; {words}"
            raise ImportFileError(NOWHERE, reason, remedy, self.option)
        return NameParts(parts.get("label"), parts.get("target"), state)


def check_name(text: str) -> None:
    """Refuse a text that cannot be the name of an observation or a target.

    Raises:
        ImportFileError: the text is empty, too long, not printable, or has blanks at its ends.
    """
    if not text.isprintable() or text != text.strip() or not 0 < len(text) <= MAX_NAME_LENGTH:
        remedy = f"give 1 to {MAX_NAME_LENGTH} printable characters, without blanks at the ends"
        raise ImportFileError(NOWHERE, f"{quote(text)} is not a valid name", remedy)


class NameReader:
    """Reader of label, target and state of each row: from columns, the point's name, the file's name."""

    def __init__(
        self, layout: Layout, options: ImportOptions, notes: list[str], *, has_one_target: bool = False
    ) -> None:
        """Prepare to read the names of rows; assumptions are added to `notes`.

        `has_one_target` tells whether a target that nothing names is the only one of all files.
        """
        self._has_one_target = has_one_target
        self._grid, self._notes, self._state_words = layout.grid, notes, options.state_words
        self._stated_state = options.state
        self._word_of_state: dict[State, str] = {}  # the word that rows of the table have for each state
        self._text_columns, self._needed_kinds = dict(layout.columns.texts), set(layout.columns.needed)
        # Parts from the name of the file, by the kinds of parts that a row lacks.
        self._parts_from_file: dict[frozenset[str], NameParts] = {}
        self._table_name = self._choose_table_name(self._grid.own_sheet)
        self._file_says_state = contains_state_word(self._table_name, self._state_words)
        self._point_template: Template | None = None
        self._file_parts = NameParts()
        if self._needed_kinds:
            self._read_templates(options)
        if layout.columns.probe and "target" in self._text_columns and layout.rows:
            self._ignore_reflector_column(layout.rows[0])

    def _choose_table_name(self, sheet: str) -> str:
        """Return the name that may give target and state of rows: a sheet's with a state, else the file's.

        Raises:
            ImportFileError: the names of sheet and file give different states.
        """
        state = find_state_in_name(sheet, self._state_words)
        if state is None:
            return self._grid.stem
        other_state = find_state_in_name(self._grid.stem, self._state_words)
        if other_state not in (None, state):
            reason = f"the name of the sheet {quote(sheet)} says {state}, that of the file {other_state}"
            raise ImportFileError(Place(self._grid.file), reason, "rename the sheet or the file")
        return sheet

    def _read_templates(self, options: ImportOptions) -> None:
        """Prepare the template of points' names, and split the name of the file by its template.

        Raises:
            ImportFileError: a template is invalid, or the name of the file does not fit its template.
        """
        try:
            if options.point_name:
                self._point_template = Template("point_name", options.point_name)
            if options.file_name:
                template = Template("file_name", options.file_name)
                self._file_parts = template.parse(self._grid.stem, self._state_words)
        except ImportFileError as fault:
            raise fault.add_place(Place(self._grid.file)) from None

    def _ignore_reflector_column(self, row: Row) -> None:
        """Ignore the column `target` of a tracker's table if names give the targets.

        The column then holds the reflector. The targets are in the names of points, or in the name of the
        file if that gives target and state.
        """
        # The column is left out at first, so that the point's name can be split as if the column were absent.
        column = self._text_columns.pop("target")
        self._needed_kinds.add("target")
        split = split_name(self._table_name, self._state_words)
        names_give_target = split.state is not None and len(split.parts) == 1
        with suppress(ImportFileError):
            names_give_target = self._split_point_name(row).target is not None or names_give_target
        if names_give_target:
            self._note_once(
                f"{self._grid.file}: the column of targets was read as the instrument's reflector"
            )
        else:
            self._text_columns["target"] = column
            self._needed_kinds.remove("target")

    def name_row(self, row: Row) -> NameParts:
        """Return label, target and state of a row, from its columns, the point's name and the file's name.

        The label is None if the table has no column of names.

        Raises:
            ImportFileError: a part is missing, unclear or contradictory.
        """
        has_names = "name" in self._text_columns
        try:
            parts = self._read_column_parts(row).merge(self._split_point_name(row)).merge(self._file_parts)
            required_kinds = (*(("label",) if has_names else ()), *self._needed_kinds)
            lacking_kinds = frozenset(kind for kind in required_kinds if getattr(parts, kind) is None)
            if lacking_kinds:
                parts = parts.merge(self._read_file_parts(lacking_kinds))
            if has_names:
                check_name(parts.label or "")
        except ImportFileError as fault:
            raise fault.add_place(self._grid.place(row, self._text_columns.get("name"))) from None
        return parts

    def _split_point_name(self, row: Row) -> NameParts:
        """Split the name of a point, after its collection and group if the table has these columns.

        Raises:
            ImportFileError: the name does not show label, target and state.
        """
        parts = [self._read_text(row, kind) for kind in _POINT_NAME_COLUMNS if kind in self._text_columns]
        name = "::".join(parts)
        if len(parts) > 1 and any("::" in part for part in parts):
            raise ImportFileError(NOWHERE, f"the name {quote(name)} contains ::", "rename the point")
        if "name" not in self._text_columns:
            return NameParts()
        if self._point_template is not None:
            return self._point_template.parse(name, self._state_words)
        if not self._needed_kinds:
            return NameParts(label=name)
        return self._split_without_template(name)

    def _split_without_template(self, name: str) -> NameParts:
        """Split the name of a point at `::`, else at `_`; the label is before the target: `c01_P10_loaded`.

        The digits 0 and 1 are tried as states only if the name of the file does not give the state.

        Raises:
            ImportFileError: the name does not show label, target and state.
        """
        split = self._split_with_states(name, self._state_words)
        if split is None and not self._file_says_state:
            split = self._split_with_states(name, {**STATE_OF_DIGIT, **self._state_words})
            if split is not None:
                self._note_once("0 and 1 in names were read as `unloaded` and `loaded`")
        if split is None:
            reason = (
                f"the name {quote(name)} does not show the observation, the target and the state of the point"
            )
            example = "{any}::{label}_{state}::{target}" if "::" in name else "{label}_{target}_{state}"
            remedy = f"give a template `point_name`, such as {example}"
            raise ImportFileError(NOWHERE, reason, remedy, "point_name")
        self._refuse_second_word(split.word, split.state)
        target = split.parts[1] if len(split.parts) > 1 else None
        return NameParts(split.parts[0], target, split.state)

    def _split_with_states(self, name: str, words: Mapping[str, State]) -> SplitName | None:
        """Split the name of a point into its label, and target and state if names of this table give these.

        None if there are more parts, or a state that a column gives. `words` are words for states.
        """
        split = split_name(name, words)
        most_parts = 2 if "target" in self._needed_kinds else 1
        may_have_state = split.state is None or "state" in self._needed_kinds
        return split if 1 <= len(split.parts) <= most_parts and may_have_state else None

    def _read_file_parts(self, lacking: frozenset[str]) -> NameParts:
        """Return the target and state that all points of a file get from the file's name; note them once.

        `lacking` are the kinds (target, state) that a row itself lacks.

        Raises:
            ImportFileError: the file's name does not give a kind that is needed.
        """
        if lacking not in self._parts_from_file:
            found = self._split_table_name(lacking)
            parts, source = found.parts, found.source
            if parts is None and self._has_one_target and lacking == {"target"}:
                parts, source = NameParts(target=_ONLY_TARGET), "as nothing names the only target"
            if parts is None or any(getattr(parts, kind) is None for kind in lacking):
                raise self._build_lacking_error(lacking)
            found_text = " and ".join(f"{kind} {getattr(parts, kind)}" for kind in sorted(lacking))
            self._note_once(f"{self._grid.file}: {found_text} {source}")
            self._parts_from_file[lacking] = parts
        return self._parts_from_file[lacking]

    def _split_table_name(self, lacking: frozenset[str]) -> _FileParts:
        """Return the target and state in the name of the file or sheet: `P10_loaded`, `loaded` or `P10`.

        If the name has no state, the option `state` gives it. `lacking` are the kinds (target, state) that
        are needed.
        """
        split = split_name(self._table_name, self._state_words)
        names, state = split.parts, split.state
        source = f"by the name of the {'file' if self._table_name == self._grid.stem else 'sheet'}"
        state_anywhere = find_state_in_name(self._table_name, self._state_words)
        if "target" not in lacking and state_anywhere is not None:
            names, state = [], state_anywhere
        if state is None and "state" in lacking and self._stated_state is not None:
            names = [self._table_name] if "target" in lacking else []
            state = self._stated_state
            source = "by `state` and the name of the file" if names else "by `state`"
        if len(names) > 1:
            return _FileParts(None, source)
        return _FileParts(NameParts(None, names[0] if names else None, state), source)

    def _build_lacking_error(self, lacking: frozenset[str]) -> ImportFileError:
        """Return the error that neither table nor names give the kinds `lacking`, target or state."""
        kind_words = " and the ".join(sorted(lacking, reverse=True))
        option, state_hint = "point_name", ""
        if "state" in lacking:
            option, state_hint = "state", "state it by `state`, "
        return ImportFileError(
            Place(self._grid.file),
            f"the {kind_words} is given neither by the table nor by the names of points or the file",
            f"{state_hint}name points as in `c01_P10_loaded`, or the file as in `P10_loaded.txt`, or "
            "give templates `point_name` or `file_name`",
            option,
        )

    def _note_once(self, note: str) -> None:
        """Add a note for the user, unless it is there already."""
        if note not in self._notes:
            self._notes.append(note)

    def _read_column_parts(self, row: Row) -> NameParts:
        """Return target and state from the columns `target` and `state` of a row; None without the column.

        Raises:
            ImportFileError: a word is no known state.
        """
        target = self._read_text(row, "target") if "target" in self._text_columns else None
        if "state" not in self._text_columns:
            return NameParts(None, target)
        word = self._read_text(row, "state")
        state = find_state(word, {**STATE_OF_DIGIT, **self._state_words})
        if state is None:
            place = self._grid.place(row, self._text_columns["state"])
            remedy = "use `unloaded`, `loaded` or `deflection`, or give `state_words`"
            reason = f"{quote(word)} is not a known state"
            raise ImportFileError(place, reason, remedy, "state_words", (word,))
        self._refuse_second_word(word, state)
        return NameParts(None, target, state)

    def _refuse_second_word(self, word: str, state: State | None) -> None:
        """Refuse a second word for a state in one table: `after` next to `loaded` may be unloaded again.

        Args:
            word: word of a row that means the state.
            state: state of the row; None if the row itself has none.

        Raises:
            ImportFileError: a row before has another word for this state, and the caller's words do not have
                the word of this row.
        """
        if state is None:
            return
        first = self._word_of_state.setdefault(state, word)
        stated = {fold_word(each) for each in self._state_words}
        if fold_word(first) == fold_word(word) or fold_word(word) in stated:
            return
        reason = f"{quote(first)} and {quote(word)} both mean {state}"
        remedy = "use one word for each state, or give `state_words`"
        raise ImportFileError(NOWHERE, reason, remedy, "state_words", (word,))

    def _read_text(self, row: Row, kind: Kind) -> str:
        """Return the text of a row's column of some kind.

        Raises:
            ImportFileError: the cell is empty, or holds something else than a text or a number.
        """
        index = self._text_columns[kind]
        place = self._grid.place(row, index)
        if row.kinds is not None and row.kinds[index] not in ("text", "number"):
            reason = f"the {kind} is in a cell of type {row.kinds[index]}"
            raise ImportFileError(place, reason, f"enter the {kind} as text")
        if not row.cells[index]:
            raise ImportFileError(place, f"the {kind} is empty", "fill in this cell in every row")
        return row.cells[index]


class _FileParts(NamedTuple):
    """Target and state that the name of a file gives, and the source in words."""

    parts: NameParts | None  # None if the name has too many parts
    source: str  # such as `by the name of the file`


class SplitName(NamedTuple):
    """Name that was split at `::` or `_`."""

    parts: list[str]  # parts that name no state
    state: State | None = None  # state that one part names; None if none or several do
    word: str = ""  # word of this state


def split_name(name: str, words: Mapping[str, State]) -> SplitName:
    """Split a name at `::` or `_`; `words` are words for states.

    In `c01_P10_loaded` the state is a part; in `c01 unloaded::P10` and `c01::P10_loaded` it is the last word
    of a part.
    """
    name = join_state_phrases(name)
    parts = name.split("::") if "::" in name else name.split("_")
    if not all(parts):
        return SplitName([name])
    states = [find_state(part, words) for part in parts]
    positions = [position for position, state in enumerate(states) if state is not None]
    if not positions and "::" in name:
        return _split_last_words(parts, words)
    if len(positions) != 1:
        return SplitName(parts)
    word = parts.pop(positions[0])
    return SplitName(parts, states[positions[0]], word)


def _split_last_words(parts: list[str], words: Mapping[str, State]) -> SplitName:
    """Split the last word from the one part whose last word names a state: `c01 unloaded`, `P10`.

    A short word behind a blank may be an abbreviation of something else, and names no state.
    """
    found = list[tuple[int, SplitName]]()  # position of the part, and the split name
    for position, part in enumerate(parts):
        end = re.fullmatch(r"(.+)([ _])([^ _]+)", part)
        if end and (end[2] == "_" or len(end[3]) >= _MIN_STATE_LETTERS):
            state = find_state(end[3], words)
            if state is not None:
                shortened = [*parts[:position], end[1], *parts[position + 1 :]]
                found.append((position, SplitName(shortened, state, end[3])))
    return found[0][1] if len(found) == 1 else SplitName(parts)


# ---- numbers, times, uncertainties

Vector = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Value:
    """Numbers of one quantity of an observation."""

    # numbers in the unit of the files; None if the cells are empty, () if a cell is faulty
    vector: Vector | None
    place: Place  # place of the first cell
    # standard uncertainty of each coordinate, in the unit of length, if the file has it
    sigma: Vector | None = None
    by_point: bool = False  # whether sigma comes from U(95) of the whole point, not of each coordinate
    lacks_coordinate: bool = False  # whether a cell is empty, but not all; then the numbers are None


@dataclass(slots=True)
class ObservationRecord:
    """Values of one observation: first those of one row, later those of all rows with the same label."""

    label: str  # label of the observation
    place: Place  # place of the first row with this label
    whole: bool = False  # whether the row claims to be the only one of its observation in this file
    table: str = ""  # file and sheet of the row
    held_out: bool = False  # whether the column `validation` holds the observation out from the fit
    values: dict[Quantity, Value] = field(default_factory=dict)  # values by quantity; positions have a state

    def vector(self, kind: Kind) -> Vector | None:
        """Return the numbers of a kind without target, such as joint angles; None if the row has none."""
        value = self.values.get(Quantity(kind))
        return None if value is None else value.vector

    @property
    def points(self) -> dict[str, dict[State, Value]]:
        """Target → state → value, for positions, deflections and readings along an axis."""
        points: dict[str, dict[State, Value]] = {}
        for quantity, value in self.values.items():
            if quantity.target is not None and quantity.state is not None:
                points.setdefault(quantity.target, {})[quantity.state] = value
        return points


def _parse_time(text: str) -> datetime | None:
    """Return the time in a text that has a date and a time of day, in UTC without a zone; None for others."""
    match = _DAY_MONTH_YEAR.fullmatch(text)
    iso = f"{match[3]}-{match[2]:0>2}-{match[1]:0>2} {match[4]}" if match else text
    try:
        time = datetime.fromisoformat(iso)
    except ValueError:
        return None
    if ":" not in iso or "-" not in iso[:5]:
        return None
    return time if time.tzinfo else time.replace(tzinfo=UTC)


@dataclass
class TimesAndRoundings:
    """Times at which the points of all files were measured, and the count of uncertainties rounded to 0."""

    times: list[datetime] = field(default_factory=list)
    unclear: list[str] = field(default_factory=list)  # texts that could not be read as times
    rounded: int = 0  # number of cells with an expanded uncertainty of 0

    def add_time(self, cells: list[str]) -> None:
        """Add the time of a row from one cell, or from a cell with the date and a cell with the time.

        Times are written as `2022-11-08 16:17:28` or `8.11.2022 16:17:28`, and are in UTC without a zone.
        """
        # The cell with the date, which has no colon, comes before the cell with the time.
        date_first = sorted((cell.strip("' ") for cell in cells), key=lambda part: ":" in part)
        text = " ".join(date_first).strip()
        if not any(map(str.isdigit, text)):
            return
        time = _parse_time(text)
        if time is None:
            self.unclear.append(text)
        else:
            self.times.append(time)

    @property
    def measured_at(self) -> datetime | None:
        """Time of the first reading; None if no time is known, or if a time in the files is unclear."""
        return None if self.unclear else min(self.times, default=None)

    @property
    def notes(self) -> list[str]:
        """Notes for the user on times and rounded uncertainties."""
        notes = []
        if self.measured_at is not None:
            time = self.measured_at.isoformat(" ", "seconds")
            notes.append(f"time of the first reading, in UTC if the file names no time zone: {time}")
        if self.unclear:
            example = f"such as {quote(self.unclear[0])} ({len(self.unclear)} rows)"
            notes.append(
                f"times were not understood and not used, {example}: give the time with `measured_at`"
            )
        if self.rounded:
            notes.append(
                f"an uncertainty U(95) of 0, rounded to 1 µm, was read as 0.5 µm ({self.rounded} cells)"
            )
        return notes


class _UnclearNames:
    """Faults of names of points: names that are unclear for the same reason make one fault.

    Of the faults with one remedy only the first is kept, so that a file without any clear name takes no
    more memory than others.
    """

    def __init__(self) -> None:
        self._first_faults: dict[str, ImportFileError] = {}  # by remedy
        self._counts: Counter[str] = Counter()  # number of faults with each remedy

    def add(self, fault: ImportFileError) -> None:
        """Add the fault of one name."""
        self._first_faults.setdefault(fault.remedy, fault)
        self._counts[fault.remedy] += 1

    def summarize(self) -> Iterator[ImportFileError]:
        """Yield the first fault with each remedy, with the number of other names to which it applies."""
        for remedy, first in self._first_faults.items():
            other_count = self._counts[remedy] - 1
            concerns_point = bool(first.place.line)  # a fault without a line concerns the name of the file
            if other_count and concerns_point:
                first.reason += f", and {other_count} other names are also unclear"
            yield first


class _Uncertainty(NamedTuple):
    """Standard uncertainty of a position."""

    sigma: Vector | None  # of x, y and z; None if unknown
    is_of_point: bool = False  # whether it comes from U(95) of the whole point, not of each coordinate


_NO_UNCERTAINTY: Final = _Uncertainty(None)


class RowReader:
    """Reader of the rows of a file, by the meanings of its columns."""

    def __init__(
        self,
        layout: Layout,
        names: NameReader,
        times_and_roundings: TimesAndRoundings,
        *,
        allow_missing: bool,
    ) -> None:
        self._layout, self._names, self._times_and_roundings = layout, names, times_and_roundings
        self._allows_missing = allow_missing
        self._grid, self._columns = layout.grid, layout.columns
        self._decimal_mark = layout.decimal_mark or "point"
        is_in_metres = layout.columns.units.get("length") == "m"
        self._zero_replacement = _HALF_MICROMETRE / 1e3 if is_in_metres else _HALF_MICROMETRE
        self._targets: set[str] = set()

    def read_records(self, faults: Faults) -> Iterator[ObservationRecord]:
        """Yield the values of each row; unclear names and cells that do not fit their columns are faults.

        Names that are unclear for the same reason are reported as one fault.
        """
        unclear_names = _UnclearNames()
        meanings = enumerate(self._columns.meanings)
        time_columns = [index for index, meaning in meanings if meaning.kind == "time"]
        for row_number, row in enumerate(self._layout.rows, start=1):
            if faults.full:
                break
            self._times_and_roundings.add_time([row.cells[column] for column in time_columns])
            try:
                name_parts = self._names.name_row(row)
            except ImportFileError as fault:
                unclear_names.add(fault)
                continue
            label = name_parts.label or str(row_number)
            with faults.collect():
                yield self._read_record(row, name_parts, label, faults)
        for each in unclear_names.summarize():
            faults.add(each)

    def _read_record(self, row: Row, name_parts: NameParts, label: str, faults: Faults) -> ObservationRecord:
        """Return the values of one row as a record with a label; report all faults in the row's cells."""
        whole = self._columns.whole and name_parts.label is not None
        table = f"{self._grid.file} {self._grid.preview.sheet}"
        record = ObservationRecord(label, self._grid.place(row), whole, table)
        for quantity, indices in self._columns.quantities.items():
            if quantity.kind == "addition" or quantity.kind in _UNCERTAINTIES:
                continue  # read with the position to which the columns belong
            if quantity.kind in POINTS:
                self._read_point(row, quantity, name_parts, record, faults)
                continue
            vector = self._read_vector(row, indices, faults)
            if vector is None:
                place = self._grid.place(row, indices[0])
                faults.report(place, f"this row has no {quantity.kind}", "fill in the cells")
            elif quantity.kind == "mass":
                if min(vector, default=0.0) < 0.0:
                    place = self._grid.place(row, indices[0])
                    remedy = "give the mass as a positive number in kg"
                    faults.report(place, "a hung mass is negative", remedy)
                # The weight pulls along −z of R0; its unit is kgf, so that the mass is its number.
                weight = (0.0, 0.0, *(-mass for mass in vector))
                record.values[Quantity("force")] = Value(weight, record.place)
            else:
                record.values[quantity] = Value(vector, record.place)
        record.held_out = self._is_held_out(row, faults)
        return record

    def _read_point(
        self, row: Row, quantity: Quantity, name_parts: NameParts, record: ObservationRecord, faults: Faults
    ) -> None:
        """Add a position, deflection or reading along an axis to the record of its row, with its uncertainty.

        Args:
            row: row of the table.
            quantity: quantity of the columns, as the header states it.
            name_parts: target and state by the names of the row.
            record: record of the row.
            faults: collection to which faults of cells are added.
        """
        indices = self._columns.quantities[quantity]
        place = self._grid.place(row, indices[0])
        lacks_coordinate = self._skips_point(row, indices)
        vector = None if lacks_coordinate else self._read_vector(row, indices, faults)
        if vector is None and quantity.kind == "along":
            return  # a gauge reads one direction in a posture, and another in the next
        named = self._complete_quantity(quantity, name_parts, place)
        vector = self._add_deviation(row, quantity, vector, faults)
        uncertainty = _NO_UNCERTAINTY
        if vector:
            uncertainty = self._read_uncertainty(row, quantity, named.state, faults)
        record.values[named] = Value(
            vector, place, uncertainty.sigma, uncertainty.is_of_point, lacks_coordinate
        )

    def _is_held_out(self, row: Row, faults: Faults) -> bool:
        """Return whether the column `validation` holds a row out from the fit; it may be 0, 1 or empty."""
        index = self._columns.texts.get("validation")
        held = "0" if index is None else row.cells[index].strip() or "0"
        if held not in ("0", "1"):
            reason = f"{quote(held)} is neither 0 nor 1"
            remedy = "write 1 to hold the observation out from the fit, else 0"
            faults.report(self._grid.place(row, index), reason, remedy)
        return held == "1"

    def _complete_quantity(self, quantity: Quantity, name_parts: NameParts, place: Place) -> Quantity:
        """Return a quantity whose target and state are those of its header, or else of the row's names.

        Raises:
            ImportFileError: the target's name is not valid, at the given place.
        """
        target = quantity.target or name_parts.target
        state = quantity.state or name_parts.state
        if target is None or state is None:  # cannot happen: `NameReader` has refused such a row
            raise ImportFileError(place, "the position has no target or no state", "give `point_name`")
        if target not in self._targets:
            try:
                check_name(target)
            except ImportFileError as fault:
                raise fault.add_place(place) from None
            self._targets.add(target)
        return Quantity(quantity.kind, target, state)

    def _add_deviation(
        self, row: Row, position: Quantity, vector: Vector | None, faults: Faults
    ) -> Vector | None:
        """Return a position plus the deviation in columns such as `plus x`.

        Without these columns, or without numbers in `vector`, `vector` is returned unchanged.
        """
        indices = self._columns.quantities.get(position.with_kind("addition"))
        if indices is None or not vector:
            return vector
        added = self._read_vector(row, indices, faults)
        if added is None:
            place = self._grid.place(row, indices[0])
            faults.report(place, "the deviation to be added is empty", "fill in the cell")
        return tuple(map(sum, zip(vector, added or (), strict=False)))

    def _read_uncertainty(
        self, row: Row, position: Quantity, state: State | None, faults: Faults
    ) -> _Uncertainty:
        """Return the standard uncertainty σ of x, y and z, by columns U(95) X, Y, Z or U(95) of the point.

        For coordinates σ = U/1.96. U(95) of the point is the root of the squares of three equal
        uncertainties: σ = U/(1.96 √3).
        """
        columns = self._list_uncertainty_columns(position)
        if not columns:
            return _NO_UNCERTAINTY
        expanded = self._read_expanded_uncertainty(row, columns, faults)
        reason = ""
        if state == "deflection":
            reason = (
                "an uncertainty of a deflection cannot be used: give the uncertainties of its two positions"
            )
        elif expanded is None or min(expanded, default=0.0) < 0.0:
            reason = "an uncertainty must be positive"
        if reason:
            place = self._grid.place(row, columns[0][0])
            faults.report(place, reason, "correct the uncertainty, or skip the column with `ignore`")
        if not expanded:
            return _NO_UNCERTAINTY
        self._times_and_roundings.rounded += sum(value == 0.0 for value in expanded)
        sigma = tuple((value or self._zero_replacement) / _COVERAGE_FACTOR for value in expanded)
        if len(sigma) == 1:
            return _Uncertainty((sigma[0] / sqrt(3.0),) * 3, is_of_point=True)
        return _Uncertainty(sigma)

    def _list_uncertainty_columns(self, position: Quantity) -> list[tuple[int, ...]]:
        """Return the columns U(95) X, Y, Z of a position and the column U(95) of the point, if they exist."""
        quantities = self._columns.quantities
        columns = [quantities.get(position.with_kind(kind), ()) for kind in _UNCERTAINTIES]
        return [indices for indices in columns if indices]

    def _read_expanded_uncertainty(
        self, row: Row, columns: list[tuple[int, ...]], faults: Faults
    ) -> Vector | None:
        """Return the numbers of the first group of columns that has any; None if all cells are empty."""
        for indices in columns:
            expanded = self._read_vector(row, indices, faults)
            if expanded is not None:
                return expanded
        return None

    def _read_vector(self, row: Row, indices: tuple[int, ...], faults: Faults) -> Vector | None:
        """Return the numbers of some columns; None if all cells lack a number, () if one is faulty."""
        if all(lacks_number(row.cells[index]) for index in indices):
            return None
        numbers: list[float] = []
        for index in indices:
            with faults.collect(self._grid.place(row, index)):
                numbers.append(self._read_number(row, index))
        return tuple(numbers) if len(numbers) == len(indices) else ()

    def _skips_point(self, row: Row, indices: tuple[int, ...]) -> bool:
        """Return whether gaps are allowed, and some cells of a point lack a number, but not all."""
        are_filled = [not lacks_number(row.cells[index]) for index in indices]
        return self._allows_missing and any(are_filled) and not all(are_filled)

    def _read_number(self, row: Row, index: int) -> float:
        """Return the number of a cell in the unit of the readings: inches are converted to mm, daN to N.

        Raises:
            ImportFileError: the cell does not hold a number.
        """
        text = row.cells[index]
        if lacks_number(text):
            raise self._describe_missing_number(text, index)
        kind = "text" if row.kinds is None else row.kinds[index]
        mark = "point" if kind == "number" else self._decimal_mark
        if kind == "text" and self._layout.are_thousands_separated:
            text = remove_thousands_separators(text, mark)
        is_text = row.kinds is None or (kind == "text" and looks_like_a_number(text))
        if kind != "number" and not is_text:
            reason = f"a number is needed, but the cell has type {kind}: {quote(text)}"
            raise ImportFileError(self._grid.place(row, index), reason, _REMEDIES.get(kind, _ENTER_A_NUMBER))
        unit = self._columns.meanings[index].unit
        factor = 1.0 if unit is None else find_unit_of_readings(unit).factor
        return factor * read_number(text, mark)

    def _describe_missing_number(self, text: str, index: int) -> ImportFileError:
        """Return the error for a cell without a number; only readings of points may be left out."""
        reason = f"{quote(text)} is no number" if text else "the cell is empty, but needs a number"
        if self._columns.meanings[index].kind != "position":
            return ImportFileError(NOWHERE, reason, "fill in the cell")
        remedy = "fill in the cell, or use `allow_missing` to leave this reading out"
        return ImportFileError(NOWHERE, reason, remedy, "allow_missing")
