"""Mutations of files of readings: delimiters, units, columns, rows, decimal marks, encodings.

Each changes how a known content stands in a file, or damages it so that it cannot be read as something else.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace

from benchmarks.spreadsheets import FACTORS, Dialect, Sheet, Upload, number

__all__ = ["MUTATIONS", "mutated"]

_SWAPS = {"mm": ("m", 1e-3), "deg": ("rad", FACTORS["rad"]), "°": ("rad", FACTORS["rad"]), "N": ("kN", 1e-3)}
_UNIT = re.compile(r"(?<![A-Za-z.])(mm|deg|°|N|m|rad|kN)(?![A-Za-z.])")
Random = random.Random
Mutation = Callable[[Random, Upload], Upload]


def _on_sheet(change: Callable[[Random, Sheet], Sheet]) -> Mutation:
    def mutate(generator: Random, upload: Upload) -> Upload:
        sheets = list(upload.sheets)
        index = generator.randrange(len(sheets))
        sheets[index] = change(generator, sheets[index])
        return replace(upload, sheets=tuple(sheets))

    return mutate


def _on_data(change: Callable[[Random, list[list[str]]], None]) -> Mutation:
    """Change the rows of data of a sheet in place."""

    def mutate(generator: Random, sheet: Sheet) -> Sheet:
        data = [list(row) for row in sheet.rows[sheet.head :]]
        change(generator, data)
        return replace(sheet, rows=[*sheet.rows[: sheet.head], *data])

    return _on_sheet(mutate)


def _dialect(generator: Random, upload: Upload) -> Upload:
    dialect = Dialect(
        delimiter=generator.choice(";,\t "),
        mark=generator.choice(".,"),
        encoding=generator.choice(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"]),
        end=generator.choice(["\n", "\r\n", "\r"]),
        quoted=generator.random() < 0.3,
    )
    return replace(upload, dialect=dialect)


def _mark(generator: Random, upload: Upload) -> Upload:
    return replace(upload, dialect=replace(upload.dialect, mark=generator.choice(".,")))


def _marks_mixed(generator: Random, data: list[list[str]]) -> None:
    row = generator.choice(data)
    column = generator.choice([index for index, cell in enumerate(row) if "." in cell] or [0])
    row[column] = row[column].replace(".", generator.choice([",", "'", " ", ".."]))


def _thousands(generator: Random, data: list[list[str]]) -> None:
    mark = generator.choice(", '\u00a0")
    for row in data:
        for index, cell in enumerate(row):
            value = number(cell)
            if value is not None and abs(value) >= 1000:
                row[index] = f"{value:,}".replace(",", mark)


def _converted(generator: Random, upload: Upload) -> Upload:
    """Write all numbers of one unit in another, and the other in the header."""
    unit = generator.choice(list(_SWAPS))
    other, factor = _SWAPS[unit]
    pattern = re.compile(_UNIT.pattern.replace("mm|deg|°|N|m|rad|kN", re.escape(unit)))
    return replace(upload, sheets=tuple(_in_unit(sheet, pattern, other, factor) for sheet in upload.sheets))


def _in_unit(sheet: Sheet, pattern: re.Pattern[str], other: str, factor: float) -> Sheet:
    head = [list(row) for row in sheet.rows[: sheet.head]]
    data = [list(row) for row in sheet.rows[sheet.head :]]
    for column in range(len(data[0])):
        cells = [row for row in head if column < len(row) and pattern.search(row[column])]
        for row in cells:
            row[column] = pattern.sub(other, row[column])
        for row in data if cells else []:
            value = number(row[column])
            if value is not None:
                row[column] = repr(float(f"{value * factor:.15g}"))
    return replace(sheet, rows=[*head, *data])


def _one_unit(generator: Random, sheet: Sheet) -> Sheet:
    """Give one header another unit of its dimension."""
    rows = [list(row) for row in sheet.rows]
    places = [
        (row, column)
        for row in range(sheet.head)
        for column, cell in enumerate(rows[row])
        if _UNIT.search(cell) and number(cell) is None
    ]
    if not places:
        return replace(
            sheet, comments=tuple(text.replace("(Inches)", "(furlongs)") for text in sheet.comments)
        )
    row, column = generator.choice(places)
    unit = generator.choice(["mm", "m", "in", "rad", "deg", "N", "kN", "kg", "lbf", "grad", "cm", "%"])
    if unit not in rows[row][column]:
        rows[row][column] = _UNIT.sub(unit, rows[row][column])
    return replace(sheet, rows=rows)


def _no_units(_: Random, sheet: Sheet) -> Sheet:
    rows = [
        [re.sub(r"\s*(\[[^]]*\]|\([^)]*\))|_(rad|kN|m)$", "", cell) for cell in row]
        if index < sheet.head
        else row
        for index, row in enumerate(sheet.rows)
    ]
    return replace(sheet, rows=rows)


def _units_stated(generator: Random, upload: Upload) -> Upload:
    units = {
        "length": generator.choice(["mm", "m", "in"]),
        "angle": generator.choice(["deg", "rad"]),
        "force": generator.choice(["N", "kN", "kgf"]),
    }
    kept = generator.sample(sorted(units), generator.randint(1, 3))
    return replace(upload, options=upload.options | {"units": {kind: units[kind] for kind in kept}})


def _columns_moved(generator: Random, sheet: Sheet) -> Sheet:
    if len({len(row) for row in sheet.rows}) > 1 or not sheet.rows[sheet.head - 1][0]:
        return sheet  # titles and groups do not move with their columns
    order = list(range(len(sheet.rows[0])))
    generator.shuffle(order)
    return replace(sheet, rows=[[row[column] for column in order] for row in sheet.rows])


def _column_lost(generator: Random, sheet: Sheet) -> Sheet:
    lost = generator.randrange(1, len(sheet.rows[-1]))
    return replace(sheet, rows=[[*row[:lost], *row[lost + 1 :]] for row in sheet.rows])


def _column_added(generator: Random, sheet: Sheet) -> Sheet:
    place = generator.randrange(1, len(sheet.rows[-1]) + 1)
    text, cell = generator.choice(
        [("comment", "ok"), ("shift", "night"), ("T", "20.5"), ("", ""), ("x", "1.5")]
    )
    rows = [
        [*row[:place], text if index == sheet.head - 1 else "" if index < sheet.head else cell, *row[place:]]
        for index, row in enumerate(sheet.rows)
    ]
    return replace(sheet, rows=rows)


def _column_twice(generator: Random, sheet: Sheet) -> Sheet:
    place = generator.randrange(1, len(sheet.rows[-1]))
    rows = [[*row[: place + 1], *row[place : place + 1], *row[place + 1 :]] for row in sheet.rows]
    return replace(sheet, rows=rows)


def _header_spelt(generator: Random, sheet: Sheet) -> Sheet:
    """Lose or double a letter of a header, or empty it."""
    rows = [list(row) for row in sheet.rows]
    row = generator.choice(rows[: sheet.head])
    column = generator.randrange(len(row))
    text = row[column]
    at = generator.randrange(len(text) or 1)
    row[column] = generator.choice([text[:at] + text[at + 1 :], text[: at + 1] + text[at:], "", text.upper()])
    return replace(sheet, rows=rows)


def _head_lost(generator: Random, sheet: Sheet) -> Sheet:
    lost = generator.randrange(sheet.head)
    return replace(sheet, rows=[*sheet.rows[:lost], *sheet.rows[lost + 1 :]], head=sheet.head - 1)


def _head_twice(generator: Random, sheet: Sheet) -> Sheet:
    place = generator.randrange(sheet.head, len(sheet.rows) + 1)
    return replace(sheet, rows=[*sheet.rows[:place], *sheet.rows[: sheet.head], *sheet.rows[place:]])


def _title(generator: Random, sheet: Sheet) -> Sheet:
    title = generator.choice(
        [["Zelle 3"], ["P10"], ["Datum", "2026-11-20"], ["loaded"], ["x"], ["T", "20.5", "°C"]]
    )
    return replace(sheet, rows=[title, *sheet.rows], head=sheet.head + 1)


def _rows_moved(generator: Random, data: list[list[str]]) -> None:
    generator.shuffle(data)


def _row_lost(generator: Random, data: list[list[str]]) -> None:
    del data[generator.randrange(len(data))]


def _row_twice(generator: Random, data: list[list[str]]) -> None:
    data.insert(generator.randrange(len(data) + 1), list(generator.choice(data)))


def _row_empty(generator: Random, data: list[list[str]]) -> None:
    data.insert(generator.randrange(len(data) + 1), [""] * generator.choice([0, len(data[0])]))


def _row_above(generator: Random, sheet: Sheet) -> Sheet:
    """Put a row of data above the header."""
    index = generator.randrange(sheet.head, len(sheet.rows))
    rows = [sheet.rows[index], *sheet.rows[:index], *sheet.rows[index + 1 :]]
    return replace(sheet, rows=rows, head=sheet.head + 1)


def _footer(generator: Random, data: list[list[str]]) -> None:
    data.append(generator.choice([["Ende der Messung"], ["mean", "1.5", "2.5"], ["# end"], ["c99"]]))


def _cell_shifted(generator: Random, data: list[list[str]]) -> None:
    row = generator.choice(data)
    place = generator.randrange(len(row))
    row.insert(place, "")
    if generator.random() < 0.5:
        row.pop()


def _cell_lost(generator: Random, data: list[list[str]]) -> None:
    row = generator.choice(data)
    del row[generator.randrange(len(row))]


def _cell_spoilt(generator: Random, data: list[list[str]]) -> None:
    row = generator.choice(data)
    place = generator.choice([index for index, cell in enumerate(row) if number(cell) is not None])
    row[place] = generator.choice(["", "-", "n/a", "NaN", "#REF!", "1e", row[place] + " mm", "1.2.3"])


def _row_cut(generator: Random, data: list[list[str]]) -> None:
    data[-1] = data[-1][: generator.randrange(1, len(data[-1]))]


def _trailing(generator: Random, sheet: Sheet) -> Sheet:
    return replace(sheet, trailing=generator.randint(0, 2))


def _comments(generator: Random, sheet: Sheet) -> Sheet:
    text = generator.choice(
        ["// AXES = CARTESIAN: X, Y, Z (m)", "# cell 3", "% x y z", "// AXES = POLAR: R, A, Z"]
    )
    return replace(sheet, comments=(*sheet.comments, text))


MUTATIONS: Mapping[str, Mapping[str, Mutation]] = {
    "delimiters": {
        "dialect": _dialect,
        "trailing": _on_sheet(_trailing),
        "cell shifted": _on_data(_cell_shifted),
        "cell lost": _on_data(_cell_lost),
    },
    "units": {
        "converted": _converted,
        "one header": _on_sheet(_one_unit),
        "none": _on_sheet(_no_units),
        "stated": _units_stated,
        "comments": _on_sheet(_comments),
    },
    "columns": {
        "moved": _on_sheet(_columns_moved),
        "lost": _on_sheet(_column_lost),
        "added": _on_sheet(_column_added),
        "twice": _on_sheet(_column_twice),
        "header misspelt": _on_sheet(_header_spelt),
    },
    "rows": {
        "moved": _on_data(_rows_moved),
        "lost": _on_data(_row_lost),
        "twice": _on_data(_row_twice),
        "empty": _on_data(_row_empty),
        "above the header": _on_sheet(_row_above),
        "footer": _on_data(_footer),
        "cut": _on_data(_row_cut),
        "header row lost": _on_sheet(_head_lost),
        "header twice": _on_sheet(_head_twice),
        "title": _on_sheet(_title),
    },
    "decimal marks": {
        "all": _mark,
        "mixed": _on_data(_marks_mixed),
        "thousands": _on_data(_thousands),
        "cell spoilt": _on_data(_cell_spoilt),
    },
    "encodings": {"dialect": _dialect},
}

_UNSTATED = frozenset({"units: none", "rows: header row lost"})


def mutated(generator: Random, upload: Upload) -> tuple[Upload, str, str]:
    """Return an upload after one to three mutations, and the kind and the names of them."""
    kind = generator.choice(list(MUTATIONS))
    names = []
    for count in range(generator.choice((1, 1, 2, 3))):
        group = kind if count == 0 else generator.choice(list(MUTATIONS))
        name = generator.choice(list(MUTATIONS[group]))
        names.append(f"{group}: {name}")
        if "units: stated" in names and not _UNSTATED.isdisjoint(names):
            names.pop()
            continue  # a unit that only the caller states is the caller's
        if all(len(sheet.rows) > sheet.head > 0 for sheet in upload.sheets):
            with suppress(ValueError, IndexError):  # nothing is left that it could change
                upload = MUTATIONS[group][name](generator, upload)
    return upload, kind, ", ".join(names)
