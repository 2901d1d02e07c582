"""One campaign written by thirteen habits: what people and measuring software make of the same numbers.

Own samples in the makers' forms; no code of the importer is used.
"""

from __future__ import annotations

import csv
import io
import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import openpyxl

__all__ = ["HABITS", "Campaign", "Dialect", "Sheet", "Upload", "campaign_of"]

STATES = ("unloaded", "loaded")
FACTORS = {"mm": 1.0, "m": 1e-3, "in": 1 / 25.4, "deg": 1.0, "rad": math.pi / 180, "N": 1.0, "kN": 1e-3}
"""Numbers in these units for one mm, degree or newton."""


@dataclass(frozen=True)
class Campaign:
    """Numbers of a campaign in mm, deg and N, as they are written: the truth.

    Attributes:
        joints: by label.
        force: by label.
        points: by label, target, state.
    """

    joints: Mapping[str, tuple[float, ...]]
    force: Mapping[str, tuple[float, ...]]
    points: Mapping[tuple[str, str, str], tuple[float, ...]]

    @property
    def labels(self) -> list[str]:
        """Return the labels in order."""
        return list(self.joints)

    @property
    def targets(self) -> list[str]:
        """Return the names of the targets in order."""
        return list(dict.fromkeys(target for _, target, _ in self.points))


@dataclass(frozen=True)
class Dialect:
    """Delimiter, decimal mark, encoding, line ends and quotation marks of a text."""

    delimiter: str = ";"
    mark: str = "."
    encoding: str = "utf-8"
    end: str = "\n"
    quoted: bool = False


@dataclass(frozen=True)
class Sheet:
    """A file before it is written: rows of cells, numbers with a decimal point.

    Attributes:
        name: of the file.
        rows: titles, header and data.
        head: number of rows that are no data.
        comments: lines before them.
        trailing: delimiters at the end of rows, one for each.
    """

    name: str
    rows: list[list[str]]
    head: int = 1
    comments: tuple[str, ...] = ()
    trailing: int = 0

    def write(self, dialect: Dialect) -> bytes:
        """Return the bytes of the file."""
        if self.name.endswith(".xlsx"):
            return self._workbook()
        output = io.StringIO()
        for line in self.comments:
            output.write(line + dialect.end)
        writer = csv.writer(
            output,
            delimiter=dialect.delimiter,
            lineterminator=dialect.end,
            quoting=csv.QUOTE_ALL if dialect.quoted else csv.QUOTE_MINIMAL,
        )
        for row in self.rows:
            cells = [cell.replace(".", dialect.mark) if number(cell) is not None else cell for cell in row]
            writer.writerow([*cells, *[""] * self.trailing])
        return output.getvalue().encode(dialect.encoding, errors="replace")

    def _workbook(self) -> bytes:
        book = openpyxl.Workbook()
        sheet = book.active
        assert sheet is not None  # noqa: S101 - a new workbook has one
        for row in self.rows:
            sheet.append(
                [None if not cell else cell if number(cell) is None else number(cell) for cell in row]
            )
        output = io.BytesIO()
        book.save(output)
        return output.getvalue()


@dataclass(frozen=True)
class Upload:
    """All files of an import, and its options."""

    sheets: tuple[Sheet, ...]
    dialect: Dialect = Dialect()
    options: dict[str, Any] = field(default_factory=dict)

    def files(self) -> list[tuple[str, bytes]]:
        """Return names and bytes."""
        return [(sheet.name, sheet.write(self.dialect)) for sheet in self.sheets]


def number(cell: str) -> float | None:
    """Return the number of a cell, or None."""
    try:
        return float(cell)
    except ValueError:
        return None


def campaign_of(generator: random.Random) -> Campaign:
    """Return a small campaign of a random arm."""
    count, joints = generator.randint(2, 4), generator.randint(2, 6)
    labels = [f"c{index:02}" for index in range(1, count + 1)]

    def vector(size: float, digits: int, length: int = 3) -> tuple[float, ...]:
        return tuple(round(generator.uniform(-size, size), digits) for _ in range(length))

    targets = ["P10", "P11"][: generator.randint(1, 2)]
    return Campaign(
        joints={label: vector(170.0, 3, joints) for label in labels},
        force={label: (0.0, 0.0, round(-generator.uniform(100, 2500), 2)) for label in labels},
        points={
            (label, target, state): vector(2500.0, 4)
            for label in labels
            for target in targets
            for state in STATES
        },
    )


def written(value: float, unit: str) -> str:
    """Return a number as it stands in a file, from mm, deg or N."""
    return repr(value) if FACTORS[unit] == 1.0 else repr(float(f"{value * FACTORS[unit]:.15g}"))


def _data(campaign: Campaign, units: Sequence[str], *, points: bool = True) -> list[list[str]]:
    angle, force, length = units
    rows = []
    for label in campaign.labels:
        row = [label, *(written(value, angle) for value in campaign.joints[label])]
        row += [written(value, force) for value in campaign.force[label]]
        if points:
            for target in campaign.targets:
                for state in STATES:
                    row += [written(value, length) for value in campaign.points[label, target, state]]
        rows.append(row)
    return rows


def _headers(
    campaign: Campaign, label: str, joint: str, force: str, point: str, states: Sequence[str]
) -> list[str]:
    """Return a header in one row by templates of `{n}`, `{axis}`, `{target}`, `{state}`."""
    count = len(campaign.joints[campaign.labels[0]])
    header = [label, *(joint.format(n=index) for index in range(1, count + 1))]
    header += [force.format(axis=axis) for axis in "xyz"]
    for target in campaign.targets:
        for state in states:
            header += [point.format(target=target, state=state, axis=axis) for axis in "xyz"]
    return header


def _one_row(
    name: str, words: Sequence[str], states: Sequence[str] = STATES, units: Sequence[str] = ("deg", "N", "mm")
) -> Callable[[Campaign], Upload]:
    def write(campaign: Campaign) -> Upload:
        header = _headers(campaign, words[0], words[1], words[2], words[3], states)
        return Upload((Sheet(name, [header, *_data(campaign, units)]),))

    return write


def _groups(campaign: Campaign, *, repeated: bool) -> list[list[str]]:
    """Return rows of groups, of axes and of units."""
    count = len(campaign.joints[campaign.labels[0]])
    blocks = [("Joint", [str(index) for index in range(1, count + 1)], "deg"), ("Force", list("xyz"), "N")]
    blocks += [(f"{target} {state}", list("xyz"), "mm") for target in campaign.targets for state in STATES]
    rows: list[list[str]] = [["Label"], [""], [""]]
    for group, axes, unit in blocks:
        rows[0] += [group if repeated or not index else "" for index in range(len(axes))]
        rows[1] += axes
        rows[2] += [unit] * len(axes)
    return rows


def _three_rows(campaign: Campaign) -> Upload:
    head = _groups(campaign, repeated=False)
    return Upload((Sheet("three.csv", [*head, *_data(campaign, ("deg", "N", "mm"))], head=3),))


def _two_rows(campaign: Campaign) -> Upload:
    groups, axes, units = _groups(campaign, repeated=True)
    groups = [f"{group} [{unit}]" if unit else group for group, unit in zip(groups, units, strict=True)]
    return Upload((Sheet("two.csv", [groups, axes, *_data(campaign, ("deg", "N", "mm"))], head=2),))


def _titles(campaign: Campaign) -> Upload:
    upload = _one_row("titles.csv", ("label", "J{n} [deg]", "F{axis} [N]", "{target} {state} {axis} [mm]"))
    sheet = upload(campaign).sheets[0]
    titles = [["Messung Zelle 3"], ["Temperatur", "20.5"], ["Bediener", "Meier"]]
    return Upload((replace(sheet, rows=[*titles, *sheet.rows], head=4),))


def _workbook(campaign: Campaign) -> Upload:
    upload = _three_rows(campaign)
    sheet = upload.sheets[0]
    return Upload((replace(sheet, name="book.xlsx", rows=[["Campaign of cell 3"], *sheet.rows], head=4),))


def _joints(campaign: Campaign) -> Sheet:
    header = _headers(campaign, "label", "J{n} [deg]", "F{axis} [N]", "", ())
    return Sheet("joints.csv", [header, *_data(campaign, ("deg", "N", "mm"), points=False)])


def _spatial_analyzer(campaign: Campaign) -> Upload:
    comments = (
        "// SpatialAnalyzer SA 2022.2.0624.7 ( x64 )",
        "// Points Relative to Coordinate Frame 'Frames::WORLD'",
        "// AXES = CARTESIAN: X,  Y,  Z (Inches)",
    )
    rows = [["Collection", "Group", "Point", "X", "Y", "Z"]]
    for (label, target, state), values in campaign.points.items():
        rows.append([state.title(), label, target, *(written(value, "in") for value in values)])
    points = Sheet("points.txt", rows, comments=comments)
    return Upload((_joints(campaign), points), Dialect(","))


def _leica(campaign: Campaign) -> Upload:
    rows = [
        ["Name", "X  [mm]", "Y  [mm]", "Z  [mm]", *(f"U(95){axis}  [mm]" for axis in ("", " X", " Y", " Z"))]
    ]
    rows[0] += ["Tilt  [deg]", "Q0 ", "Q1 ", "Q2 ", "Q3 ", "Image RMS  [µm]", "Target", "Temperature  [°C]"]
    rows[0] += ["Pressure  [mBar]", "Humidity  [%]", "Time Stamp", "OTG Applied", "Delete"]
    for (label, target, state), values in campaign.points.items():
        row = [f"{label}_{target}_{state}", *(written(value, "mm") for value in values)]
        row += ["0.0325", "0.031", "0.009", "0.004", "0.00", "0.7071", "0.0", "0.0", "0.7071", "3", "CCR"]
        rows.append([*row, "20.5", "1013.2", "41.0", "'08.11.2022 16:17:28.353", "False", "False"])
    return Upload((_joints(campaign), Sheet("leica.csv", rows, trailing=1)), Dialect(",", quoted=True))


def _long(campaign: Campaign) -> Upload:
    rows = [["Punkt", "Reflektor", "Zustand", "x [mm]", "y [mm]", "z [mm]"]]
    for (label, target, state), values in campaign.points.items():
        word = {"unloaded": "unbelastet", "loaded": "belastet"}[state]
        rows.append([label, target, word, *(written(value, "mm") for value in values)])
    return Upload((_joints(campaign), Sheet("long.csv", rows)))


HABITS: dict[str, Callable[[Campaign], Upload]] = {
    "one row": _one_row("one.csv", ("label", "J{n} [deg]", "F{axis} [N]", "{target} {state} {axis} [mm]")),
    "units behind names": _one_row(
        "names.csv",
        ("pose", "theta{n}_rad", "force_{axis}_kN", "{target}_{state}_{axis}_m"),
        units=("rad", "kN", "m"),
    ),
    "German": _one_row(
        "deutsch.csv",
        ("Punkt", "Achse {n} [°]", "Kraft {axis} [N]", "{target} {state} {axis} [mm]"),
        ("unbelastet", "belastet"),
    ),
    "French": _one_row(
        "francais.csv",
        ("nom", "axe {n} (deg)", "effort {axis} (N)", "{target} {state} {axis} (mm)"),
        ("à vide", "chargé"),
    ),
    "before and after": _one_row(
        "states.csv",
        ("label", "J{n} [deg]", "F{axis} [N]", "{target} {state} {axis} [mm]"),
        ("before", "after"),
    ),
    "0 and 1": _one_row(
        "digits.csv", ("label", "J{n} [deg]", "F{axis} [N]", "{target}_{state}_{axis} [mm]"), ("0", "1")
    ),
    "two rows, repeated": _two_rows,
    "three rows, merged": _three_rows,
    "titles": _titles,
    "Excel, titles and three rows": _workbook,
    "SpatialAnalyzer, inches": _spatial_analyzer,
    "Leica, U(95)": _leica,
    "a row for each point": _long,
}
