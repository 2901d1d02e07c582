"""A table of a weight step: a row for each angle pair of two encoders, without and with the load."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, Literal

from jointstiff.schemas.gearbox import (
    MAX_POSTURES,
    EncoderAngles,
    GearboxUnits,
    StepPosture,
    StepReadings,
    TwistReading,
)
from jointstiff.schemas.imports import (
    ColumnMeaning,
    DecimalMark,
    FilePreview,
    ImportOptions,
    State,
)
from jointstiff.service.importing.errors import NOWHERE, Faults, ImportFileError, Place, quote
from jointstiff.service.importing.grammar import (
    STEPS,
    find_known_unit,
    find_state,
    joint_number,
    split_unit,
)
from jointstiff.service.importing.grid import Grid, Row, decide_decimal_mark, read_number
from jointstiff.service.tables.labels import fold_word

_Approach = Literal["+", "-"]
_NEEDED: Final = ("label", "joint", "state", "motor", "link")
_NUMBERS: Final = ("motor", "link")
_IGNORED: Final = "ignored"
_ANGLES: Final = ("deg", "rad")
_REMEDY: Final = (
    "use `label`, `J1 [deg]` …, `joint`, `state` (unloaded or loaded), `approach` (+ or -), `motor [deg]` "
    "and `link [deg]`"
)
_APPROACHES: Final[Mapping[str, _Approach | None]] = MappingProxyType(
    {"+": "+", "plus": "+", "positive": "+", "-": "-", "\u2212": "-", "minus": "-", "negative": "-", "": None}
)
_MOVED: Final = 5e-3
"""Greatest difference of a joint between rows of one posture [rad or m]."""
_SIZES: Final[Mapping[str, float]] = MappingProxyType({"deg": 57.3, "rad": 1.0, "mm": 1e3, "m": 1.0})
"""Numbers in a radian or in a metre, by unit."""


@dataclass(frozen=True)
class _Header:
    """Columns of the table."""

    of_kind: Mapping[str, int]  # column of each kind, such as `motor`
    joints: Sequence[int]  # columns of the joints' positions, in order
    units: Mapping[int, str]  # unit of each column of numbers

    @property
    def numbers(self) -> list[int]:
        """All columns of numbers."""
        return [*self.joints, *(self.of_kind[kind] for kind in _NUMBERS)]


@dataclass
class _Posture:
    """Rows of one label."""

    joints: list[float]
    # (joint, approach) → state → angles, and the row that began the reading
    readings: dict[tuple[str, _Approach | None], dict[State, EncoderAngles]] = field(default_factory=dict)
    rows: dict[tuple[str, _Approach | None], Row] = field(default_factory=dict)


def is_step_table(grid: Grid) -> bool:
    """Return whether the first row of a table names a column of motor angles and one of link angles."""
    kinds = [STEPS.get(fold_word(split_unit(cell)[0])) for cell in grid.rows[0].cells]
    return "motor" in kinds and "link" in kinds


def read_step_table(
    grid: Grid, options: ImportOptions, faults: Faults, joints: Sequence[str]
) -> tuple[StepReadings | None, FilePreview]:
    """Return the readings of a weight step, and the preview of the file; add faults of rows to `faults`.

    `joints` are the names of the robot's joints; without a robot, joints are as the table names them. The
    readings are None if there are faults.

    Raises:
        ImportFileError: a header is not understood, has no known unit, or is missing.
    """
    first, *rows = grid.rows
    header = _read_header(grid, first, has_rows=bool(rows))
    complete = [row for row in rows if len(row.cells) == len(first.cells)]
    for row in rows:
        if len(row.cells) != len(first.cells):
            reason = f"the row has {len(row.cells)} cells, but the header {len(first.cells)}"
            faults.report(grid.place(row), reason, "give every row the same number of cells")
    mark, note_on_mark = decide_decimal_mark(grid, complete, header.numbers, options.decimal_mark)
    postures = dict[str, _Posture]()
    if mark is not None:
        for row in complete:
            with faults.collect(grid.place(row)):
                _add_row(postures, row, header, mark, joints, options)
    observations = _build_observations(grid, postures, faults)
    meanings = [
        ColumnMeaning(column=column + 1, header=cell, meaning=kind, unit=header.units.get(column))
        for column, (cell, kind) in enumerate(zip(first.cells, _name_kinds(header, first), strict=True))
    ]
    kind_of_table = "read as a weight step of two encoders"
    notes = [*grid.preview.assumptions, kind_of_table, *([note_on_mark] if note_on_mark else [])]
    preview = grid.preview_table([first.line], rows, meanings, mark, notes)
    if faults.found:
        return None, preview
    lengths = [unit for unit in header.units.values() if unit not in _ANGLES]
    angle = header.units[header.of_kind["motor"]]
    units = GearboxUnits.model_validate({"length": lengths[0] if lengths else "mm", "angle": angle})
    return StepReadings(units=units, observations=observations), preview


def _name_kinds(header: _Header, first: Row) -> list[str]:
    """Return the meaning of each column, as the preview shows it."""
    names = {column: kind for kind, column in header.of_kind.items()}
    names |= {column: f"joint {number}" for number, column in enumerate(header.joints, 1)}
    return [names.get(column, _IGNORED) for column in range(len(first.cells))]


def _read_header(grid: Grid, first: Row, *, has_rows: bool) -> _Header:
    """Return the columns of a table of a weight step; `has_rows` is False if no row follows the header.

    Raises:
        ImportFileError: a header is unknown or occurs twice, has no unit, or is missing, or no row follows.
    """
    of_kind, numbered, units = dict[str, int](), dict[int, int](), dict[int, str]()
    for column, text in _list_used_cells(first):
        base, unit_text = split_unit(text)
        kind, number = STEPS.get(fold_word(base)), None if base.isdecimal() else joint_number(base)
        place = grid.place(first, column)
        is_unknown = kind is None and number is None
        if is_unknown or kind in of_kind or number in numbered:
            reason = f"the header {quote(text)} of a weight step is unknown, or occurs twice"
            raise ImportFileError(place, reason, _REMEDY)
        if kind is None or kind in _NUMBERS:
            units[column] = _read_unit(place, text, unit_text, allows_length=kind is None)
        if kind is not None:
            of_kind[kind] = column
        elif number is not None:
            numbered[number] = column
    whole = Place(grid.file, first.line)
    absent = [kind for kind in _NEEDED if kind not in of_kind]
    is_numbered = sorted(numbered) == list(range(1, len(numbered) + 1))
    if not (numbered and is_numbered):
        absent.append("J1, J2, …")
    if absent or not has_rows:
        reason = f"the weight step has no {'row' if not absent else 'column ' + ', '.join(absent)}"
        raise ImportFileError(whole, reason, _REMEDY)
    _refuse_mixed_units(whole, units.values())
    return _Header(of_kind, [numbered[number] for number in sorted(numbered)], units)


def _list_used_cells(first: Row) -> list[tuple[int, str]]:
    """Return column and text of the headers, but those of columns without a reading, such as remarks."""
    kinds = [STEPS.get(fold_word(split_unit(cell)[0])) for cell in first.cells]
    return [(column, first.cells[column]) for column, kind in enumerate(kinds) if kind != _IGNORED]


def _refuse_mixed_units(place: Place, units: Collection[str]) -> None:
    """Refuse angles, or lengths, in different units.

    Raises:
        ImportFileError: the units differ.
    """
    angles = {unit for unit in units if unit in _ANGLES}
    lengths = {unit for unit in units if unit not in _ANGLES}
    if len(angles) > 1 or len(lengths) > 1:
        reason = "the columns of angles, or those of lengths, have different units"
        raise ImportFileError(place, reason, "write all of them in one unit")


def _read_unit(place: Place, header: str, unit_text: str | None, *, allows_length: bool) -> str:
    """Return the unit of a column of numbers.

    Raises:
        ImportFileError: the header has no unit, or one that is not accepted there.
    """
    known = None if unit_text is None else find_known_unit(unit_text)
    unit = known[1] if known is not None else ""
    accepted = (*_ANGLES, "m", "mm") if allows_length else _ANGLES
    if unit not in accepted:
        reason = f"the unit of {quote(header)} is not one of {', '.join(accepted)}"
        raise ImportFileError(place, reason, "write the unit as in `motor [deg]`")
    return unit


def _add_row(
    postures: dict[str, _Posture],
    row: Row,
    header: _Header,
    mark: DecimalMark,
    joints: Sequence[str],
    options: ImportOptions,
) -> None:
    """Add a row to the posture of its label.

    Raises:
        ImportFileError: a cell is not understood, or the row contradicts another.
    """
    cells = {kind: row.cells[column] for kind, column in header.of_kind.items()}
    positions = [read_number(row.cells[column], mark) for column in header.joints]
    posture = postures.setdefault(cells["label"], _Posture(positions))
    _refuse_other_posture(cells["label"], positions, posture, header)
    state = find_state(cells["state"], options.state_words)
    if state not in ("unloaded", "loaded"):
        reason = f"the state {quote(cells['state'])} is unknown"
        raise ImportFileError(NOWHERE, reason, "write unloaded or loaded")
    approach = fold_word(cells.get("approach", ""))
    if approach not in _APPROACHES:
        reason = f"the approach {quote(approach)} is unknown"
        raise ImportFileError(NOWHERE, reason, "write + or -: the sense in which the joint turned last")
    key = _name_joint(cells["joint"], joints), _APPROACHES[approach]
    states = posture.readings.setdefault(key, {})
    posture.rows.setdefault(key, row)
    if state in states:
        reason = f"{quote(cells['label'])} has two rows of {key[0]} that are {state}, from the same side"
        raise ImportFileError(NOWHERE, reason, "state another `approach`, or remove one of the rows")
    motor, link = (read_number(cells[kind], mark) for kind in _NUMBERS)
    states[state] = EncoderAngles(motor=motor, link=link)


def _refuse_other_posture(label: str, positions: Sequence[float], posture: _Posture, header: _Header) -> None:
    """Refuse a row whose joints are elsewhere than in the first row of its label.

    Raises:
        ImportFileError: names the joint.
    """
    for number, column in enumerate(header.joints, 1):
        here, before = positions[number - 1], posture.joints[number - 1]
        if abs(here - before) > _MOVED * _SIZES[header.units[column]]:
            raise ImportFileError(
                NOWHERE,
                f"joint {number} of {quote(label)} is at {here:g}, and at {before:g} in a row above",
                "give each posture a label of its own",
            )


def _name_joint(text: str, joints: Sequence[str]) -> str:
    """Return the name of a joint by its name or number; without a robot, the text.

    Raises:
        ImportFileError: the robot has no such joint.
    """
    is_name = not joints or text in joints
    if is_name:
        return text
    number = joint_number(text)
    if number is None or not 1 <= number <= len(joints):
        raise ImportFileError(
            NOWHERE, f"the robot has no joint {quote(text)}", f"use a number, or one of {', '.join(joints)}"
        )
    return joints[number - 1]


def _build_observations(grid: Grid, postures: Mapping[str, _Posture], faults: Faults) -> list[StepPosture]:
    """Return the postures with their readings; report readings that lack a state."""
    if len(postures) > MAX_POSTURES:
        reason = f"the table has {len(postures)} postures, more than {MAX_POSTURES}"
        faults.report(Place(grid.file), reason, "leave some of them out")
        return []
    observations = []
    for label, posture in postures.items():
        readings = []
        for (joint, approach), states in posture.readings.items():
            absent = [state for state in ("unloaded", "loaded") if state not in states]
            if absent:
                side = f" from {approach}" if approach else ""
                reason = f"{quote(label)} has no row of {joint}{side} that is {absent[0]}"
                row = posture.rows[joint, approach]
                faults.report(grid.place(row), reason, "read both states from the same sides")
                continue
            readings.append(
                TwistReading(
                    joint=joint, approach=approach, unloaded=states["unloaded"], loaded=states["loaded"]
                )
            )
        if readings:
            observations.append(StepPosture(label=label, joints=posture.joints, encoder_readings=readings))
    return observations
