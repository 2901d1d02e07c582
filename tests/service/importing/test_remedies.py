"""Each remedy of an import, carried out on the file that caused it: the fault is gone.

A case that edits the file does what the sentence says. A case that states an option states one that the
sentence names. Together the cases pass every place of the importer that reports a fault.
"""

import ast
import json
import math
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from support import strange_files as strange
from support.importing_samples import CAMPAIGN, JOINTS, MM, POINTS, sources_of
from support.workbooks import ROWS as SHEET_ROWS
from support.workbooks import SHEET, arrays, hdf5, repacked, workbook

from jointstiff.schemas.imports import ImportAnswer, ImportFault, ImportRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service import importing
from jointstiff.service.conversion.prepared import build_robot
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.proposals.answers import import_or_propose
from jointstiff.service.resources.imports import ImportRefusedError, import_files
from jointstiff.service.resources.known_robots import catalogue_robots

ROOM = Path(importing.__file__).parent
SITES = (
    *sorted(ROOM.rglob("*.py")),
    *sorted((ROOM.parent / "proposals").rglob("*.py")),
    ROOM.parent / "resources" / "imports.py",
)
"""Modules that report faults of files."""
EXCLUDED = "the position has no target or no state"
"""Reason that `Names` excludes before: no file causes it."""

POSES = """\
label;J1 [deg];J2 [deg];P10 unloaded x [mm];P10 unloaded y [mm];P10 unloaded z [mm]
c01;10.5;-20.25;1245.7134;-310.1127;239.2014
c02;-15;-35.125;1102.5518;402.9017;318.4406
"""
MARKDOWN = "| " + POSES.replace(";", " | ").replace("\n", " |\n|" + 6 * "---|" + "\n| ", 1)
"""The same poses as a table of Markdown."""
LATEX = "\\begin{tabular}{l}\n" + "".join(
    " & ".join(line.split(";")) + " \\\\\n" for line in CAMPAIGN.splitlines()[1:]
)
"""A table of LaTeX without its end."""
PAGE = "<html><table>" + "".join(
    "<tr><td>" + "<td>".join(line.split(";")) + "</tr>\n" for line in CAMPAIGN.splitlines()[1:]
)
"""A web page without its end."""
READINGS = arrays(
    label=["c01", "c02"],
    q_deg=[[10.0, 20.0], [30.0, 40.0]],
    force_N=[[0.0, 0.0, -100.0]] * 2,
    P_deflection_mm=[[0.1, 0.2, 0.3]] * 2,
)
"""Joints, forces and deflections as MATLAB saves them."""
Content = str | bytes
Files = Mapping[str, Content] | tuple[tuple[str, Content], ...]


_, _HEADER, *_ROWS = CAMPAIGN.splitlines()
OBJECTS = [dict(zip(_HEADER.split(";"), row.split(";"), strict=True)) for row in _ROWS]


@dataclass(frozen=True)
class Case:
    """A fault, and its remedy carried out."""

    fault: str  # pattern of the reason
    files: Files
    mended: Files | None = None  # files after the remedy; None: as before
    options: Mapping[str, Any] = field(default_factory=dict)
    stated: Mapping[str, Any] | None = None  # options after the remedy; None: as before
    robot: RobotDocument | None = None
    limits: Mapping[str, Any] = field(
        default_factory=dict
    )  # by module and name, so that small files reach them

    def answer(self, *, mended: bool) -> ImportAnswer:
        """Return the answer before or after the remedy."""
        files = self.files if not mended or self.mended is None else self.mended
        options = self.options if not mended or self.stated is None else self.stated
        request = ImportRequest.model_validate({"units": MM, **options, "show_faults": True})
        pairs = files.items() if isinstance(files, Mapping) else files
        robot = None if self.robot is None else build_robot(self.robot)
        return import_files(sources_of(*pairs), request, robot)


def table(fault: str, wrong: Content, right: Content, **options: Any) -> Case:
    """Return a table with a mistake, and the same table as the remedy asks for it."""
    assert wrong != right
    return Case(fault, {"a.csv": wrong}, {"a.csv": right}, options)


def mistake(fault: str, right: str, wrong: str, text: str = "", **options: Any) -> Case:
    """Return a table in which something stands wrong, and the table with it corrected."""
    text = text or CAMPAIGN
    assert right in text
    return table(fault, text.replace(right, wrong, 1), text, **options)


def option(fault: str, content: Content, /, **stated: Any) -> Case:
    """Return a table with a question, and the option that answers it."""
    return Case(fault, {"a.csv": content}, stated=stated)


def omitted(fault: str, content: Content, /, **stated: Any) -> Case:
    """Return a table with an option that contradicts it, and the import without the option."""
    return Case(fault, {"a.csv": content}, options=stated, stated={})


def masses(fault: str, wrong: str) -> Case:
    """Return a table of masses with a mistake beside readings, and the same table without it."""
    return Case(fault, {"m.csv": wrong, "a.csv": CAMPAIGN}, {"m.csv": MASSES, "a.csv": CAMPAIGN})


def limited(fault: str, wrong: Files, right: Files, **limits: int) -> Case:
    """Return files beyond a limit, here a low one, and files within it."""
    return Case(fault, wrong, right, limits=limits)


def with_column(header: str, *cells: str, text: str = CAMPAIGN) -> str:
    """Return a table with one more column behind its others."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return "".join(f"{line};{cell}\n" for line, cell in zip(lines, (header, *cells), strict=True))


TWO_AXES = RobotDocument.model_validate(
    {"name": "two axes", "model": {"format": "dh", "convention": "standard", "rows": 2 * [
        {"a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0}
    ]}}
)  # fmt: skip
SET: Mapping[str, Any] = {"encoders": "motor", "load_point": (0.0, 0.0, 1.0)}
"""What a measurement set needs beside tables."""
NAMED_VALUES = "".join(
    f"label={{label}} target={target} state={state} x={x} y=-310.1127 z=239.2014\n"
    for target, state, x in (
        ("P10", "unloaded", "1245.7134"),
        ("P10", "loaded", "1245.6021"),
        ("P11", "unloaded", "1102.5518"),
        ("P11", "loaded", "1102.4423"),
    )
)
"""Lines of names and values, with a place for the label."""
MASSES = "body;joint;mass [kg];centre x [mm];y [mm];z [mm]\narm;2;120;0;0;350\n"
STATES = (
    "label;target;state;x [mm];y [mm];z [mm]\n"
    "c01;P10;unloaded;1245.7134;-310.1127;239.2014\n"
    "c01;P10;loaded;1245.6021;-310.1098;237.9853\n"
)
BOTH_STATES = (
    STATES + "c02;P10;unloaded;1102.5518;402.9017;318.4406\nc02;P10;loaded;1102.4127;402.8613;316.8891\n"
)
POINTS_IN_STATES = {
    state: [["name", "target", "x [mm]", "y [mm]", "z [mm]"]]
    + [
        [name.split("_")[0], "P10", *map(float, place)]
        for name, *place in (line.split(";") for line in POINTS.splitlines())
        if name.endswith(f"_{state}")
    ]
    for state in ("unloaded", "loaded")
}


def add_loaded_sheet(book: Any, sheet: Any) -> None:
    """Name the sheet of a workbook, and add a sheet with the loaded points."""
    sheet.title = "no load"
    other = book.create_sheet("with load")
    for row in POINTS_IN_STATES["loaded"]:
        other.append(row)


SHEETS_OF_STATES = workbook(POINTS_IN_STATES["unloaded"], add_loaded_sheet)
UNSURE = "name;x [mm];y [mm];z [mm];U95 x [mm];U95 y [mm];U95 z [mm]\n" + "".join(
    f"{line};0.02;0.02;0.03\n" for line in POINTS.splitlines()
)
OTHERS = "name;x [mm];y [mm];z [mm]\n" + POINTS.replace("P10", "P11")
PLUS = (
    "label;P10 unloaded x [mm];P10 unloaded y [mm];P10 unloaded z [mm];"
    "P10 unloaded plus x [mm];P10 unloaded plus y [mm];P10 unloaded plus z [mm]\n"
    "c01;1;2;3.5;0.1;0.2;0.3\nc02;1;2.5;3.5;0.1;0.2;0.4\n"
)
HUNG = "label;J1 [deg];mass [kg]\nc01;10;150\nc02;20.5;150\n"
WORDS = "label;P10 pre x [mm];P10 pre y [mm];P10 pre z [mm];P10 post x [mm];P10 post y [mm];P10 post z [mm]\n"
WORDS += "c01;1;2;3.5;1.1;2.1;3.4\nc02;1;2;4.5;1.1;2.1;4.4\n"
MANY = "label;J1 [deg];Fx [N];Fy [N];Fz [N];" + ";".join(f"q {letter}" for letter in "abcdef") + "\n"
MANY += "c01;1.5;0;0;-5;1;2;3;4;5;6\n"
BOOK = workbook()


def sheets(book: Any, sheet: Any) -> None:
    """Add a second sheet with the rows of the first."""
    more = book.create_sheet("again")
    for row in sheet.iter_rows(values_only=True):
        more.append(row)


def damaged(_data: bytes) -> bytes:
    return b"<worksheet><row></worksheet>"


COLUMNS = {
    "unknown header corrected": mistake("unknown column header 'labl'", "label;", "labl;"),
    "unknown header with a meaning": option(
        "unknown column header 'elbow'", CAMPAIGN.replace("J1 [deg]", "elbow"), columns={"elbow": "J1 [deg]"}
    ),
    "unknown header ignored": option(
        "unknown column header 'shift'", with_column("shift", "1", "1", "2"), ignore=["shift"]
    ),
    "many unknown headers": option("unknown column headers", MANY, ignore=[f"q {one}" for one in "abcdef"]),
    "many unknown headers with meanings": option(
        "unknown column headers", MANY, columns={f"q {one}": "ignore" for one in "abcdef"}
    ),
    "unit of another dimension": mistake("'kg' is not a known unit of force", "Fx [N]", "Fx [kg]"),
    "hung mass in place of a force": table(
        "'kg' is not a known unit of force", HUNG.replace("mass [kg]", "Fz [kg]"), HUNG
    ),
    "mass that is called a force": mistake(
        "unknown column header 'Kraft \\[kg\\]': kg is the unit of a mass", "mass [kg]", "Kraft [kg]", HUNG
    ),
    "mass that is called a force, stated": option(
        "unknown column header 'Kraft \\[kg\\]'",
        HUNG.replace("mass [kg]", "Kraft [kg]"),
        columns={"Kraft [kg]": "mass [kg]"},
    ),
    "mass that is called a force, stated without unit": option(
        "unknown column header 'Kraft \\[kg\\]'",
        HUNG.replace("mass [kg]", "Kraft [kg]"),
        columns={"Kraft [kg]": "mass"},
    ),
    "gauge without a target": mistake(
        "a reading along an axis needs the name of a target",
        "tip along z [mm]",
        "along z [mm]",
        "label;tip along z [mm]\nc01;0.1\nc02;0.25\n",
    ),
    "unit of a text": mistake("has a unit, but its column has texts", "label;", "label [mm];"),
    "hung mass in newton": mistake("the unit of a hung mass must be kg", "mass [kg]", "mass [N]", HUNG),
    "joint zero": mistake("column joint 3 is missing", "J2 [deg]", "J0 [deg]"),
    "two units by header and option": Case(
        "is in deg, but",
        {"a.csv": CAMPAIGN.replace("J1 [deg]", "A1 [deg]")},
        options={"columns": {"A1 [deg]": "J1 [rad]"}},
        stated={"columns": {"A1 [deg]": "J1 [deg]"}},
    ),
    "second column": mistake("is a second column for joint 1", "J2 [deg]", "J1 [deg]"),
    "second column ignored": option(
        "is a second column for joint 1", with_column("axis 1 [deg]", "1", "1", "2"), ignore=["axis 1 [deg]"]
    ),
    "missing column": mistake("column joint 2 is missing", "J2 [deg]", "J4 [deg]"),
    "axes spelt in two ways": mistake("are not spelt alike", "P10 loaded z", "P10 loaded Z"),
    "axes spelt in two ways, with meanings": option(
        "are not spelt alike",
        CAMPAIGN.replace("P10 loaded z", "P10 loaded Z"),
        columns={"P10 loaded Z [mm]": "P10 loaded z"},
    ),
    "states that may be": option("may be states", WORDS, state_words={"pre": "unloaded", "post": "loaded"}),
    "no column of names": mistake("no column names the observations", "label;", "remark;"),
    "no column of names, by order": option(
        "no column names the observations", CAMPAIGN.replace("label;", "remark;"), by_order=True
    ),
    "no column of numbers": table(
        "no column with numbers is recognised", "label;remark\nc01;warm\nc02;cold\n", CAMPAIGN
    ),
    "mass beside forces": option(
        "states the load, but columns of forces state the load, too",
        with_column("mass [kg]", "150", "150", "150"),
        ignore=["mass [kg]"],
    ),
    "uncertainty of no position": table(
        "but the table has no columns of this position", UNSURE.replace("U95 ", "P11 U95 "), UNSURE
    ),
    "uncertainty of no position, ignored": option(
        "but the table has no columns of this position",
        with_column("P11 loaded U95 [mm]", "0.02", "0.02", "0.03"),
        ignore=["P11 loaded U95 [mm]"],
    ),
    "state in some headers": table(
        "some columns of positions name their state",
        CAMPAIGN.replace("P10 loaded ", "P10 "),
        CAMPAIGN,
    ),
    "state of an unknown word": option(
        "other columns do not: 'P10 roh x \\[mm\\]', 'P10 roh y \\[mm\\]', 'P10 roh z \\[mm\\]'$",
        CAMPAIGN.replace("P10 unloaded ", "P10 roh "),
        state_words={"roh": "unloaded"},
    ),
    "state in headers and in a column": table(
        "there is a column `state`", with_column("state", "loaded", "loaded", "loaded"), CAMPAIGN
    ),
    "two units of angles": mistake(
        "is in rad, but other columns are in deg", "J2 [deg]", "J2 [rad]", units=None
    ),
    "unit of header and option": Case(
        "according to its header, but in", {"a.csv": CAMPAIGN}, options={"units": {"length": "m"}}, stated={}
    ),
    "no unit in the header": mistake("have no unit", "J1 [deg];J2 [deg];J3 [deg]", "J1;J2;J3", units=None),
    "no unit, stated": Case(
        "have no unit",
        {"a.csv": CAMPAIGN.replace(" [deg]", "")},
        options={"units": None},
        stated={"units": {"angle": "deg"}},
    ),
    "no unit, another meaning": Case(
        "read as .* have no unit",
        {
            "a.csv": STATES.replace("target;", "")
            .replace("P10;", "")
            .replace("x [mm];y [mm];z [mm]", "tip x;tip y;tip z")
        },
        options={"units": None},
        stated={"units": {"length": "mm"}, "columns": {f"tip {one}": f"P10 {one}" for one in "xyz"}},
    ),
}
ROWS = {
    "no header": table("there is no header", "c01;1;2;3;4;5;6;7\n", CAMPAIGN),
    "no header, stated": option(
        "there is no header",
        "c01;1;2;3;0;0;-5\n",
        header=["label", "J1 [deg]", "J2 [deg]", "J3 [deg]", "Fx [N]", "Fy [N]", "Fz [N]"],
    ),
    "number for a name": table(
        "without a header, the name of a point must be where", "1.5;1;2;3.5\n", POINTS
    ),
    "number for a name, header stated": option(
        "without a header, the name of a point must be where",
        "1;1.5;2.5;3.5\n1.5;2;3;4.5\n",
        header=["J1 [deg]", "Fx [N]", "Fy [N]", "Fz [N]"],
        by_order=True,
    ),
    "comment like a header": table(
        "looks like a header, but is not understood", "# y x z\n" + POINTS, POINTS
    ),
    "comment like a header, corrected": table(
        "looks like a header, but is not understood", "# y x z\n" + POINTS, "# name;y;x;z\n" + POINTS
    ),
    "comment like a header, stated": option(
        "looks like a header, but is not understood", "# y x z\n" + POINTS, header=["name", "y", "x", "z"]
    ),
    "row of Markdown": table(
        "but not the 6 cells of the table above", MARKDOWN.replace("-15 | ", "-15 "), MARKDOWN
    ),
    "cell of a page": table(
        "a cell has more than 256 characters",
        PAGE.replace("c02", "c02" + "a" * 300) + "</table></html>",
        PAGE + "</table></html>",
    ),
    "table of LaTeX": table("the table has no end", LATEX, LATEX + "\\end{tabular}\n"),
    "page that is cut off": table("the page is cut off within an element", PAGE, PAGE + "</table></html>"),
    "large document": Case(
        "the document has more than 100 characters",
        {"a.htm": PAGE},
        {"a.csv": CAMPAIGN},
        limits={"formats.documents._MAX_CHARACTERS": 100},
    ),
    "header without rows": table("a header but no row of data", CAMPAIGN.splitlines()[1] + "\n", CAMPAIGN),
    "row above the header": table(
        "is above the header in line 3, but looks like data",
        "cell 3;dead weight;of;150;kg;hung;below;the flange;;;;;\n" + CAMPAIGN,
        CAMPAIGN,
    ),
    "rows of other lengths": mistake("the row has 12 cells", "c02;-15;", "c02;"),
    "cut off in its last line": table(
        "the file ends in the middle of line", CAMPAIGN[: CAMPAIGN.rindex(";", 0, -40)], CAMPAIGN
    ),
    "cut off": table("the file is cut off", CAMPAIGN[:-4], CAMPAIGN),
    "cut off, complete": table("the file is cut off", CAMPAIGN[:-4], CAMPAIGN[:-4] + "\n"),
    "deleted or not": mistake(
        "does not show whether the row is deleted",
        ";0\n",
        ";perhaps\n",
        with_column("deleted", "0", "1", "0"),
    ),
    "deleted or not, ignored": option(
        "does not show whether the row is deleted",
        with_column("deleted", "perhaps", "1", "0"),
        ignore=["deleted"],
    ),
    "all deleted": table(
        "all rows are marked as deleted", with_column("deleted", *"111"), with_column("deleted", *"100")
    ),
    "deleted rows without names": Case(
        "the numbers of the other rows are uncertain",
        {"a.csv": with_column("deleted", *"010").replace("label;", "remark;")},
        {"a.csv": with_column("deleted", *"010")},
        {"by_order": True},
    ),
    "polar coordinates": table(
        "'spherical' coordinates",
        "# AXES = SPHERICAL\n" + POINTS,
        "# AXES = CARTESIAN: X, Y, Z (mm)\n" + POINTS,
    ),
    "unknown unit in a remark": table(
        "of x, y, z is not known",
        "# AXES = CARTESIAN: X, Y, Z (furlong)\n" + POINTS,
        "# AXES = CARTESIAN: X, Y, Z (mm)\n" + POINTS,
    ),
    "two frames in a file": table(
        "the frame of the positions is", "# Frame: A\n# Frame: B\n" + POINTS, "# Frame: A\n" + POINTS
    ),
    "remark of an unknown unit": table(
        "is not known", "# Units: furlong\n" + POINTS, "# Units: mm\n" + POINTS
    ),
    "remark of another unit": table(
        "is given here, but", "# Units: m\n" + CAMPAIGN, "# Units: mm\n" + CAMPAIGN
    ),
    "file of another template": Case(
        "does not fit the template",
        {"a.csv": CAMPAIGN},
        options={"layouts": [["label", "J1 [deg]"]]},
        stated={},
    ),
    "no rows": table("the file has no row of data", "# only a comment\n", CAMPAIGN),
    "empty": table("the file is empty", " \n", CAMPAIGN),
    "too many columns": table("more than 256 columns", ";" * 300 + "\n1;2\n", CAMPAIGN),
    "text of a name=value line": table(
        "a text has more than 256 characters",
        NAMED_VALUES.format(label="c" * 300),
        NAMED_VALUES.format(label="c01"),
    ),
    "too many rows": limited(
        "more than 3 rows",
        {"a.csv": CAMPAIGN},
        {"a.csv": CAMPAIGN.rpartition("c03")[0]},
        **{"limits.MAX_ROWS": 3},
    ),
    "control character": mistake("control character", "c02", "c\x002"),
    "damaged text": table("the text is damaged", "posé;1;2;3\n".encode() + b"b\xff;1;2;3", CAMPAIGN),
    "comma of two kinds": table(
        "the comma may be the delimiter, or",
        "1,5 c01\n2,5 c02\n",
        "1,5;c01\n2,5;c02\n",
        header=["J1 [deg]", "label"],
    ),
    "comma as decimal mark": Case(
        "the comma may be the delimiter, or",
        {"a.csv": "1,5 c01\n2,5 c02\n"},
        options={"header": ["J1 [deg]", "label"]},
        stated={"header": ["J1 [deg]", "label"], "delimiter": "whitespace"},
    ),
    "long line": table("a line has more than", "a" * 70_000, CAMPAIGN),
    "open quotation": mistake("do not enclose a whole cell", "label;", '"label;'),
    "long cell": table("a cell has more than", "label;J1 [deg]\n" + "c" * 5_000 + ";1\n", CAMPAIGN),
    "quotation mark in a cell": mistake("a quotation mark occurs within a cell", "label;", 'la"bel;'),
    "points and commas": mistake("has decimal points and decimal commas", "-20.25", "-20,25"),
    "comma of thousands": table(
        "may have a decimal comma or a thousands separator",
        "label;J1 [deg]\nc01;1,234\nc02;2,345\n",
        "label;J1 [deg]\nc01;1.234\nc02;2.345\n",
    ),
    "comma of thousands, stated": option(
        "may have a decimal comma or a thousands separator",
        "label;J1 [deg]\nc01;1,234\nc02;2,345\n",
        decimal_mark="comma",
    ),
    "mark of a missing number": option(
        "'n/a' is no number", CAMPAIGN.replace("1102.5518", "n/a"), allow_missing=True
    ),
    "empty number": mistake("the cell is empty, but needs a number", "42.75", ""),
    "no number": mistake("is not a number with a decimal point", "42.75", "1.2.3"),
    "huge number": mistake("is outside", "42.75", "4e275"),
}
NAMES = {
    "name twice": mistake("occurs twice", "c02;", "c01;"),
    "point twice": mistake("occurs twice", "c02_P10_loaded", "c01_P10_loaded", POINTS),
    "point repeated": option(
        "occurs twice", POINTS + "c02_P10_loaded;1102.4128;402.8613;316.8891\n", mean_of_repeats=True
    ),
    "points far apart as repeated ones": mistake(
        "for repeated readings, at most 0.1 mm is plausible",
        "c02_P10_loaded",
        "c01_P10_loaded",
        POINTS,
        mean_of_repeats=True,
    ),
    "a sheet and a file of two states": Case(
        "the name of the sheet 'with load' says loaded, that of the file unloaded",
        {"j.csv": JOINTS, "unloaded.xlsx": SHEETS_OF_STATES},
        {"j.csv": JOINTS, "readings.xlsx": SHEETS_OF_STATES},
        options={"sheet": "no load; with load"},
    ),
    "point repeated in two files": Case(
        "occurs in two files",
        {"a.csv": JOINTS, "b.csv": POINTS, "c.csv": "c02_P10_loaded;1102.4128;402.8613;316.8891\n"},
        {"a.csv": JOINTS, "b.csv": POINTS},
        options={"mean_of_repeats": True},
    ),
    "point read in two files": Case(  # a mean of two files is no remedy
        "occurs in two files",
        {"a.csv": JOINTS, "b.csv": POINTS, "c.csv": "c02_P10_loaded;1102.4128;402.8613;316.8891\n"},
        {"a.csv": JOINTS, "b.csv": POINTS},
    ),
    "two words for a state": option(
        "'loaded' and 'after' both mean loaded",
        POINTS.replace("c02_P10_loaded", "c02_P10_after"),
        state_words={"after": "loaded"},
    ),
    "two words in a column of states": Case(
        "'loaded' and 'after' both mean loaded",
        {"a.csv": JOINTS, "b.csv": BOTH_STATES.replace("c02;P10;loaded", "c02;P10;after")},
        {"a.csv": JOINTS, "b.csv": BOTH_STATES},
    ),
    "numbers as texts": Case(
        "cells have numbers as texts",
        {"a.xlsx": workbook(SHEET_ROWS)},
        stated={"decimal_mark": "point"},
    ),
    "joints of two files": Case(
        "the joint angles of 'c02' differ by 0.02",
        {"u.csv": POSES, "l.csv": POSES.replace("-35.125", "-35.105").replace("unloaded", "loaded")},
        stated={"joint_tolerance": 0.05},
    ),
    "name that is none": mistake("is not a valid name", "c02;", "c\u20282;"),
    "unclear name": mistake("does not show the observation", "c02_P10_loaded", "c02_P10_1_loaded", POINTS),
    "unclear name, template": option(
        "does not show the observation",
        "".join(f"cell_{line}\n" for line in POINTS.splitlines()),
        point_name="{any}_{label}_{target}_{state}",
    ),
    "template in error": Case(
        "the template .* is invalid",
        {"a.txt": POINTS},
        options={"point_name": "{label}{target}_{state}"},
        stated={"point_name": "{label}_{target}_{state}"},
    ),
    "name that does not fit": Case(
        "does not fit the template",
        {"a.txt": POINTS},
        options={"point_name": "{label}::{target}::{state}"},
        stated={"point_name": "{label}_{target}_{state}"},
    ),
    "name with another word": Case(
        "does not fit the template",
        {"a.txt": POINTS.replace("_loaded", "_hung")},
        options={"point_name": "{label}_{target}_{state}"},
        stated={"point_name": "{label}_{target}_{state}", "state_words": {"hung": "loaded"}},
    ),
    "two names that contradict": Case(
        "in one name and 'P10' in another|in one name and 'P11' in another",
        {"P11_loaded.txt": POINTS},
        {"P10.txt": POINTS},
        {"point_name": "{label}_{target}_{state}", "file_name": "{target}_{state}"},
        {"point_name": "{label}_{target}_{state}"},
    ),
    "name with two colons": table(
        "contains ::",
        "group;name;x [mm];y [mm];z [mm]\nc01 unloaded;P10::a;1;2;3.5\nc01 loaded;P10::a;1;2;3.4\n",
        "group;name;x [mm];y [mm];z [mm]\nc01 unloaded;P10 a;1;2;3.5\nc01 loaded;P10 a;1;2;3.4\n",
    ),
    "state by no word": mistake("is not a known state", ";loaded;", ";hung;", STATES),
    "state by another word": option(
        "is not a known state", STATES.replace(";loaded;", ";hung;"), state_words={"hung": "loaded"}
    ),
    "date for a name": Case(
        "the name is in a cell of type",
        {"a.xlsx": workbook(change=lambda _book, sheet: setattr(sheet["A2"], "value", True))},
        {"a.xlsx": BOOK},
    ),
    "empty name": mistake("the name is empty", "c02;", ";"),
    "nothing says the state": Case(
        "is given neither by the table",
        {"a.txt": POINTS.replace("_unloaded", "").replace("_loaded", "")},
        {"a.txt": POINTS},
    ),
    "nothing says the state: stated": option(
        "is given neither by the table",
        "c01_P10;1;2;3.5\nc02_P10;1;2;4.5\n",
        state="unloaded",
    ),
    "state without a need": omitted("the state of all positions is given", CAMPAIGN, state="loaded"),
    "nothing says the state: the file": Case(
        "is given neither by the table",
        {"a.txt": "c01_P10;1;2;3.5\nc02_P10;1;2;4.5\n"},
        {"unloaded.txt": "c01_P10;1;2;3.5\nc02_P10;1;2;4.5\n"},
    ),
    "nothing says the state: template": Case(
        "is given neither by the table",
        {"P10-loaded.txt": "c01;1;2;3.5\nc02;1;2;4.5\n"},
        stated={"file_name": "{target}-{state}"},
    ),
    "nothing says the state: names": Case(
        "is given neither by the table",
        {"a.txt": "c01-P10-loaded;1;2;3.5\nc02-P10-loaded;1;2;4.5\n"},
        stated={"point_name": "{label}-{target}-{state}"},
    ),
    "header without a need": omitted(
        "the header that is stated is not needed", CAMPAIGN, header=["label", "x", "y", "z"]
    ),
    "template without a need": omitted("is not needed", CAMPAIGN, point_name="{label}_{state}"),
    "file name without a need": omitted("is not needed", CAMPAIGN, file_name="{target}"),
    "header that no file has": Case(
        "'shift', but no file has this header",
        {"a.csv": with_column("Shift", *"112")},
        options={"ignore": ["shift"], "columns": {"Shift": "ignore"}},
        stated={"ignore": ["Shift"]},
    ),
}
VALUES = {
    "held out or not": mistake("is neither 0 nor 1", ";1\n", ";yes\n", with_column("validation", *"001")),
    "no deviation": table("the deviation to be added is empty", PLUS.replace("0.1;0.2;0.4", ";;"), PLUS),
    "uncertainty below zero": mistake("an uncertainty must be positive", "0.02;", "-0.02;", UNSURE),
    "uncertainty below zero, ignored": option(
        "an uncertainty must be positive",
        UNSURE.replace("0.02;", "-0.02;", 1),
        ignore=["U95 x [mm]", "U95 y [mm]", "U95 z [mm]"],
    ),
    "text for a number": Case(
        "a number is needed, but the cell has type",
        {"a.xlsx": workbook(change=lambda _book, sheet: setattr(sheet["C3"], "value", "20 deg"))},
        {"a.xlsx": BOOK},
    ),
    "row without a force": mistake(
        "this row has no force", "c02;-15;-35.125;42.75;0;0;-1471.5", "c02;-15;-35.125;42.75;;;"
    ),
    "mass below zero": mistake("a hung mass is negative", "20.5;150", "20.5;-150", HUNG),
    "other force for one label": Case(
        "the force of 'c01' differs",
        {"j.csv": JOINTS, "k.csv": JOINTS.replace("-1471.5", "-1500.5")},
        {"j.csv": JOINTS, "k.csv": JOINTS.replace("-1471.5", "-1471.50")},
    ),
    "too many targets": Case(
        "there are more than 16 targets",
        {"a.txt": "".join(f"P10_c{row:02}_{state} 1 2 3.5\n" for row in range(17) for state in "ul")},
        stated={"point_name": "{target}_{label}_{state}", "state_words": {"u": "unloaded", "l": "loaded"}},
    ),
    "label without a force": Case(
        "has no joint, but other labels have",
        {"j.csv": JOINTS.replace("c02", "c2"), "p.txt": POINTS},
        {"j.csv": JOINTS, "p.txt": POINTS},
    ),
    "reading that is missing": table("was read only", POINTS.rpartition("c02_P10_loaded")[0], POINTS),
    "reading that is missing, allowed": option(
        "was read only", POINTS.rpartition("c02_P10_loaded")[0], allow_missing=True
    ),
    "no reading": Case(
        "no observation has a reading",
        {"a.txt": POINTS.replace("c02_P10_l", "c03_P10_l").replace("c01_P10_u", "c04_P10_u")},
        {"a.txt": POINTS},
        {"allow_missing": True},
    ),
    "positions and a deflection": option(
        "has both positions and a deflection",
        CAMPAIGN.replace("P10 loaded z [mm]", "P10 loaded z [mm];P10 dx [mm];P10 dy [mm];P10 dz [mm]")
        .replace("\nc0", ";0.1;0.1;0.1\nc0")
        .replace("[mm];0.1;0.1;0.1", "[mm]")
        .rstrip()
        + ";0.1;0.1;0.1\n",
        ignore=["P10 dx [mm]", "P10 dy [mm]", "P10 dz [mm]"],
    ),
    "uncertainty of some points": Case(
        "the point has no uncertainty, but other points have one",
        {"a.csv": UNSURE, "b.csv": OTHERS},
        {"a.csv": UNSURE, "b.csv": UNSURE.replace("P10", "P11")},
    ),
    "uncertainty of some points, ignored": Case(
        "the point has no uncertainty, but other points have one",
        {"a.csv": UNSURE, "b.csv": OTHERS},
        stated={"ignore": ["U95 x [mm]", "U95 y [mm]", "U95 z [mm]"]},
    ),
    "joints of other numbers": Case(
        "joint angles, but",
        {"j.csv": JOINTS, "k.csv": "label,J1 [deg],Fx [N],Fy [N],Fz [N]\nc03,10.5,0,0,-1471.5\n"},
        {"j.csv": JOINTS},
    ),
}
FILES = {
    "two sheets": Case(
        "several sheets have data", {"a.xlsx": workbook(change=sheets)}, stated={"sheet": "again"}
    ),
    "no such sheet": Case(
        "the workbook has no sheet 'Data'",
        {"a.xlsx": BOOK},
        options={"sheet": "Data"},
        stated={"sheet": "Sheet"},
    ),
    "damaged workbook": Case(
        "is not well-formed", {"a.xlsx": repacked(BOOK, SHEET, damaged)}, {"a.xlsx": BOOK}
    ),
    "no table": Case("a PDF document, not a table", {"a.csv": b"%PDF-1.7"}, {"a.csv": CAMPAIGN}),
    "damaged YAML": Case("invalid YAML", {"a.yaml": "a: 1\nb: [1\nc: 2\n"}, {"a.csv": CAMPAIGN}),
    "YAML without a list": Case(
        "the YAML has no list", {"a.yaml": "a: 1\nb: 2\nc: 3\n"}, {"a.csv": CAMPAIGN}
    ),
    "list with the name of one of ours": Case(
        "the field 'poses' is that of a campaign",
        {"a.json": json.dumps({"poses": OBJECTS})},
        {"a.json": json.dumps({"postures": OBJECTS})},
    ),
    "damaged campaign": Case("Invalid JSON", {"a.json": "{,}"}, {"a.csv": CAMPAIGN}),
    "one file twice": Case(
        "two files have this name", (("a.csv", CAMPAIGN), ("a.csv", CAMPAIGN)), {"a.csv": CAMPAIGN}
    ),
    "second download of a file": Case(
        "the file is equal to 'a.csv', byte by byte",
        {"a.csv": CAMPAIGN, "a (1).csv": CAMPAIGN},
        {"a.csv": CAMPAIGN},
    ),
    "no files": Case("0 files were sent", {}, {"a.csv": CAMPAIGN}),
    "too large": limited(
        "exceed 0 MiB together",
        {"a.csv": CAMPAIGN, "b.csv": CAMPAIGN},
        {"a.csv": CAMPAIGN},
        **{"grid.MAX_FILE_BYTES": len(CAMPAIGN) + 1},
    ),
    "too many lines": limited(
        "more than 7 lines", {"a.csv": CAMPAIGN + "\n\n\n"}, {"a.csv": CAMPAIGN}, **{"grid.MAX_LINES": 7}
    ),
    "a second header": table(
        "the header occurs again: two tables seem to be joined in one file",
        CAMPAIGN + next(row for row in CAMPAIGN.splitlines() if not row.startswith("#")) + "\n",
        CAMPAIGN,
    ),
    "too many observations": limited(
        "more than 2 observations",
        {"a.csv": CAMPAIGN},
        {"a.csv": CAMPAIGN.rpartition("c03")[0]},
        **{"merging.MAX_OBSERVATIONS": 2},
    ),
    "too many joints": limited(
        "there are more than 3 joints",
        {"a.csv": with_column("J4 [deg]", *"112")},
        {"a.csv": CAMPAIGN},
        **{"header.MAX_JOINTS": 3},
    ),
    "masses alone": Case("masses, but no readings", {"m.csv": MASSES}, {"m.csv": MASSES, "a.csv": CAMPAIGN}),
    "masses with an unknown header": masses(
        "of a table of masses is unknown", MASSES.replace("body", "thing")
    ),
    "masses without a unit": masses("the unit of 'mass' is not one of", MASSES.replace("mass [kg]", "mass")),
    "masses without a column": masses(
        "the table of masses has no column z", MASSES.replace(";z [mm]", "").replace(";350", "")
    ),
    "masses of other lengths": masses("but the header 6", MASSES.replace(";350", "")),
    "mass that is none": masses("the row does not describe a body", MASSES.replace("120", "-120")),
    "two units of lengths": Case(
        "the unit of length is",
        {"j.csv": JOINTS, "a.csv": STATES, "b.csv": STATES.replace("[mm]", "[m]").replace("P10", "P11")},
        {"a.csv": STATES, "b.csv": STATES.replace("P10", "P11")},
    ),
    "two frames": Case(
        "the frame is",
        {"a.csv": "# Frame: A\n" + STATES, "b.csv": STATES.replace("P10", "P11")},
        {"a.csv": "# Frame: A\n" + STATES, "b.csv": "# Frame: A\n" + STATES.replace("P10", "P11")},
    ),
    "noise of file and request": Case(
        "`noise` states another uncertainty",
        {"j.csv": JOINTS, "a.csv": UNSURE},
        options={**SET, "noise": {"sigma": 0.02}},
        stated=SET,
    ),
    "noise of file and request, ignored": Case(
        "`noise` states another uncertainty",
        {"j.csv": JOINTS, "a.csv": UNSURE},
        options={**SET, "noise": {"sigma": 0.02}},
        stated={**SET, "noise": {"sigma": 0.02}, "ignore": ["U95 x [mm]", "U95 y [mm]", "U95 z [mm]"]},
    ),
    "force of file and request": Case(
        "`force` states another force",
        {"a.csv": CAMPAIGN},
        options={**SET, "force": (0.0, 0.0, -5.0)},
        stated=SET,
    ),
    "masses of another robot": Case(
        "the robot has no joint 'J7'",
        {"m.csv": MASSES.replace(";2;", ";J7;"), "j.csv": JOINTS},
        {"m.csv": MASSES, "j.csv": JOINTS},
        robot=TWO_AXES,
    ),
    "readings of another robot": Case(
        "the readings do not fit the robot",
        {"a.csv": CAMPAIGN},
        {"j.csv": JOINTS, "p.txt": POINTS},
        SET,
        robot=TWO_AXES,
    ),
    "set beyond its limits": Case(
        "do not make a valid measurement set",
        {"j.csv": JOINTS, "a.csv": UNSURE.replace("0.02;", "2e11;")},
        {"j.csv": JOINTS, "a.csv": UNSURE},
        SET,
    ),
}
TWICE = {"q": [[10.0, 20.0], [30.0, 40.0]], "q1": [[10.0], [30.0]]}


def two_days(file: Any) -> None:
    for day in ("day1", "day2"):
        file[f"{day}/label"], file[f"{day}/q_deg"] = ["c01", "c02"], [[10.0, 20.0], [30.0, 40.0]]


def two_units(file: Any) -> None:
    file["q_deg"] = [[10.0, 20.0], [30.0, 40.0]]
    file["q_deg"].attrs["units"] = "rad"


STEP = """\
label;J1 [deg];J2 [deg];joint;state;approach;motor [deg];link [deg]
s01;10;20;2;unloaded;+;20.001;20.002
s01;10;20;2;loaded;+;20.003;20.012
"""
"""A weight step of two encoders: one twist of the second joint."""


def step(fault: str, right: str, wrong: str, **more: Any) -> Case:
    """Return a weight step in which something is wrong, and the step with that corrected."""
    assert right in STEP
    return Case(fault, {"a.csv": STEP.replace(right, wrong, 1)}, {"a.csv": STEP}, **more)


STEPS = {
    "a weight step with another table": Case(
        "sent with further tables", {"a.csv": STEP, "b.csv": CAMPAIGN}, {"a.csv": STEP}
    ),
    "a step with a short row": step("the row has 7 cells, but the header 8", "20.001;20.002", "20.001"),
    "a step with an unknown header": step("'torque' of a weight step is unknown", "approach", "torque"),
    "a step without a column": Case(
        "has no column J1, J2",
        {"a.csv": STEP.replace("J1 [deg];J2 [deg]", "J2 [deg];J3 [deg]")},
        {"a.csv": STEP},
    ),
    "a step with an empty number": step("the cell is empty, but needs a number", "20.001;", ";"),
    "a step in two units": step("have different units", "link [deg]", "link [rad]"),
    "a step in gon": step("is not one of deg, rad", "motor [deg]", "motor [gon]"),
    "a step in an unknown state": step("the state 'half' is unknown", ";unloaded;", ";half;"),
    "a step from an unknown side": step("the approach 'up' is unknown", ";+;", ";up;"),
    "a state of a step twice": step("has two rows of 2 that are unloaded", ";loaded;", ";unloaded;"),
    "a step of two postures with one label": step(
        "is at 20, and at 44 in a row above", "s01;10;20;2;unl", "s01;10;44;2;unl"
    ),
    "a step of a joint that the robot lacks": step(
        "the robot has no joint '3'", "2;unloaded", "3;unloaded", robot=TWO_AXES
    ),
    "too many postures of a step": limited(
        "has 2 postures, more than 1",
        {"a.csv": STEP + "".join(STEP.replace("s01", "s02").splitlines(keepends=True)[1:])},
        {"a.csv": STEP},
        **{"weight_steps.MAX_POSTURES": 1},
    ),
    "a state of a step that is missing": Case(
        "has no row of 2 from \\+ that is loaded",
        {"a.csv": "".join(STEP.splitlines(keepends=True)[:2])},
        {"a.csv": STEP},
    ),
}
"""Weight steps."""

ARRAYS = {
    "no library": Case(
        "needs the extra `tables`",
        {"a.h5": b"\x89HDF\r\n\x1a\n"},
        {"a.csv": CAMPAIGN},
        limits={"formats.arrays.LIBRARIES": {"hdf5": "a_library_that_is_not_installed"}},
    ),
    "damaged arrays": Case("a MATLAB file that is damaged", {"a.mat": READINGS[:150]}, {"a.mat": READINGS}),
    "slow arrays": Case(
        "ended without a result", {"a.mat": READINGS}, {"a.csv": CAMPAIGN}, limits={"child.MAX_WAIT": 0}
    ),
    "large arrays": Case(
        "larger than 64 MiB", {"a.mat": arrays(q=np.zeros((3000, 3000)))}, {"a.mat": READINGS}
    ),
    "long text in arrays": Case(
        "more than 256 characters",
        {"a.mat": arrays(label=["c" * 300, "d"], q_deg=[[1.0, 2.0]] * 2)},
        {"a.mat": READINGS},
    ),
    "no arrays": Case("has no arrays of numbers", {"a.mat": arrays(text="a")}, {"a.mat": READINGS}),
    "one column of two arrays": Case(
        "two arrays give the same column 'q1'", {"a.mat": arrays(**TWICE)}, {"a.mat": READINGS}
    ),
}


def dcc(*lists: str, head: str = "") -> str:
    """Return a made-up calibration certificate with lists of quantities in one result."""
    names = 'xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si"'
    root = f"dcc:digitalCalibrationCertificate {names}"
    found = "".join(f"<dcc:list>{each}</dcc:list>" for each in lists)
    return f"{head}<{root}><dcc:result><dcc:data>{found}</dcc:data></dcc:result></{root.split()[0]}>\n"


def quantity(name: str, content: str) -> str:
    """Return a quantity of a certificate."""
    names = f"<dcc:name><dcc:content>{name}</dcc:content></dcc:name>"
    return f"<dcc:quantity>{names}{content}</dcc:quantity>"


def listed(header: str, *values: str, units: str | None = None) -> str:
    """Return a quantity that is a list of values; its unit is that of the header."""
    name, _, unit = header.partition(" [")
    if not unit:
        return quantity(name, f"<dcc:charsXMLList>{' '.join(values)}</dcc:charsXMLList>")
    stated = units or {"deg": r"\degree", "mm": r"\milli\metre", "N": r"\newton"}[unit.strip("]")]
    of_values = f"<si:valueXMLList>{' '.join(values)}</si:valueXMLList>"
    of_units = f"<si:unitXMLList>{stated}</si:unitXMLList>"
    return quantity(name, f"<si:realListXMLList>{of_values}{of_units}</si:realListXMLList>")


def single(name: str, value: str, unit: str) -> str:
    """Return a quantity that is one value."""
    return quantity(name, f"<si:real><si:value>{value}</si:value><si:unit>{unit}</si:unit></si:real>")


CELLS = [line.split(";") for line in CAMPAIGN.splitlines()[1:]]
LISTED = [listed(header, *column) for header, *column in zip(*CELLS, strict=True)]
CERTIFICATE = dcc("".join(LISTED))
ROWS_OF_SINGLES = [single("J1", str(i), r"\degree") for i in range(3)]
LONG_NAME = listed("q" * 500, "a", "b", "c")


def xml(fault: str, wrong: str) -> Case:
    """Return a certificate with a mistake, and one without it."""
    return Case(fault, {"a.xml": wrong}, {"a.xml": CERTIFICATE})


VAL3 = (
    '<Database xmlns="http://www.staubli.com/robotics/VAL3/Data/2"><Datas><Data name="j" type="jointRx">'
    + "".join(
        f'<Value key="{k}" j1="{k + 1}.5" j2="-20" j3="30" j4="0" j5="45" j6="{k}0"/>' for k in range(3)
    )
    + "</Data></Datas></Database>"
)


def val3(fault: str, wrong: str) -> Case:
    """Return joint positions of VAL3 with a mistake, and some without it."""
    return Case(fault, {"a.dtx": wrong}, {"a.dtx": VAL3})


CERTIFICATES = {
    "VAL3 data without positions": val3("no array of 3 joint positions", VAL3.replace("jointRx", "num")),
    "position of VAL3 without an axis": val3("lacks an axis", VAL3.replace(' j6="10"', "")),
    "another XML": xml("is no calibration certificate", '<a xmlns="https://ptb.de/dcc"/>'),
    "certificate without a list": xml("has no list of 3 values", dcc("")),
    "lists of other lengths": xml(
        "quantities of one list have 3 and 4 values",
        dcc("".join([*LISTED, listed("q [mm]", "1", "2", "3", "4")])),
    ),
    "single values in two units": xml(
        "quantities have several units", dcc(*ROWS_OF_SINGLES, single("J1", "3", r"\radian"))
    ),
    "list in two units": xml(
        "a quantity has several units",
        dcc("".join([*LISTED, listed("q [mm]", "1", "2", "3", units=r"\metre \milli\metre \metre")])),
    ),
    "two quantities of one name": xml(
        "two quantities have the name", dcc("".join([*LISTED, listed("J1 [deg]", "1", "2", "3")]))
    ),
    "long name of a quantity": xml("a cell has more than", dcc("".join([*LISTED, LONG_NAME]))),
    "damaged XML": xml("the XML is not well-formed", CERTIFICATE[:-20]),
    "document type": xml(
        "declares a document type", dcc("".join(LISTED), head="<!DOCTYPE a [<!ENTITY b 'c'>]>\n")
    ),
}
PLACES = [line.split(";") for line in POINTS.splitlines()]
DMIS = "UNITS/MM\n" + "".join(f"FA({name})=FEAT/POINT,CART,{x},{y},{z},0,0,1\n" for name, x, y, z in PLACES)
PC_DMIS = "".join(
    f"DIM L{i}= LOCATION OF POINT {name}  UNITS=MM\nAX NOMINAL MEAS\nX 0 {x}\nY 0 {y}\nZ 0 {z}\n"
    "END OF DIMENSION\n"
    for i, (name, x, y, z) in enumerate(PLACES)
)
NAMED_LINES = "UNITS: mm\n" + "".join(f"{name}\nX {x}\nY {y}\nZ {z}\n" for name, x, y, z in PLACES)
TRIPLES = "".join(f"{name} X {x} Y {y} Z {z}\n" for name, x, y, z in PLACES)


def report(fault: str, wrong: str, right: str, **limits: int) -> Case:
    """Return a report of a measuring machine with a mistake, and one without it."""
    assert wrong != right
    return Case(fault, {"a.txt": wrong}, {"a.txt": right}, limits=limits)


REPORTS = {
    "computed matrix": Case(
        "the text computes with matrix 'Q'", {"a.m": "Q = [1 2 3; 4 5 6; 7 8 9] / 10;"}, {"a.csv": CAMPAIGN}
    ),
    "nominal features": report("nominal features only", DMIS.replace("FA(", "F("), DMIS),
    "polar feature": report("has no Cartesian coordinates", DMIS.replace("CART", "POL", 1), DMIS),
    "point without a measured value": report(
        "has no measured value", PC_DMIS.replace("Z 0", "Q 0", 1), PC_DMIS
    ),
    "dimensions without points": report(
        "no dimension has X, Y and Z", PC_DMIS.replace("POINT", "CIRCLE").replace("Z 0", "D 0"), PC_DMIS
    ),
    "report in two units": report("the points have several units", DMIS + "UNITS/INCH\n", DMIS),
    "report in an unknown unit": report("unknown unit", DMIS.replace("MM", "FURLONG"), DMIS),
    "line that is no point": report(
        "is no point of the report", TRIPLES.replace("\n", "\nhand guided\n", 1), TRIPLES
    ),
    "point without Z": report(
        "belongs to no point", NAMED_LINES.replace(f"Z {PLACES[1][3]}\n", ""), NAMED_LINES
    ),
    "report with too many points": Case(
        "the file has more than 3 points",
        {"a.txt": DMIS},
        {
            "a.txt": "".join(DMIS.splitlines(keepends=True)[:3]),
            "b.txt": "UNITS/MM\n" + "".join(DMIS.splitlines(keepends=True)[3:]),
        },
        limits={"limits.MAX_ROWS": 3},
    ),
}

CASES: Mapping[str, Case] = {
    **COLUMNS,
    **ROWS,
    **NAMES,
    **VALUES,
    **FILES,
    **STEPS,
    **ARRAYS,
    **CERTIFICATES,
    **REPORTS,
}


def groups() -> dict[str, Case]:
    """Return the cases of HDF5, whose files need h5py."""
    days, other = hdf5(two_days), hdf5(lambda file: file.create_group("empty"))
    return {
        "two groups": Case("several groups or arrays", {"a.h5": days}, stated={"sheet": "day1"}),
        "no such group": Case(
            "has no group or array", {"a.h5": days}, options={"sheet": "day3"}, stated={"sheet": "day2"}
        ),
        "no groups": Case("has no arrays of numbers", {"a.h5": other}, {"a.mat": READINGS}),
        "two units of an array": Case("in its attribute", {"a.h5": hdf5(two_units)}, {"a.mat": READINGS}),
    }


ARM = "KUKA KR 210 R2700 extra"
MEASURED = strange.simulate(ARM, seed=3, postures=14)
UNLOADED, LOADED = strange.both(MEASURED)
WIDE = ["Pose", *strange.JOINTS, *"ABCDEF"]
"""Headers that name no positions."""
NUMBERED = strange.wide(MEASURED, UNLOADED, LOADED)
IN_TURN = ["Pose", *strange.JOINTS, "Zustand", *"XYZ"]
TURNS = strange.in_turn(MEASURED, ("unbelastet", "belastet"), (UNLOADED, LOADED))
OF_TWO_TARGETS = [
    [row[0], number, *row[1:]]
    for first, second in zip(
        TURNS,
        strange.in_turn(MEASURED, ("unbelastet", "belastet"), strange.both(MEASURED, 1)),
        strict=True,
    )
    for number, row in (("1", first), ("2", second))
]
FORM_ROWS: list[list[Any]] = [
    row
    for number, joints in enumerate(MEASURED.joints)
    for row in (
        [f"Pose {number + 1}"],
        [None, *strange.JOINTS],
        [None, *joints.tolist()],
        ["Target", *"XYZ"],
        ["T1 unloaded", *UNLOADED[number].tolist()],
        ["T1 loaded", *LOADED[number].tolist()],
    )
]
"""Six rows for each posture."""
STATEMENTS: Mapping[str, Any] = {
    "encoders": "motor", "load_point": (0.0, 0.0, 120.0), "force": (0.0, 0.0, -981.0), "length_unit": "mm",
    "units": {"force": "N"},
}  # fmt: skip
"""What files of a stranger do not contain."""


@dataclass(frozen=True)
class Proposed:
    """Files that the robot explains only after a remedy, and the remedy carried out."""

    fault: str  # pattern of the reason
    files: Mapping[str, str]
    mended: Mapping[str, str] | None = None  # files after the remedy; None: as before
    options: Mapping[str, Any] = field(default_factory=dict)
    stated: Mapping[str, Any] | None = None  # options after the remedy; None: as before

    def answer(self, *, mended: bool) -> ImportAnswer:
        """Return the import by the robot's proposal, before or after the remedy."""
        files = self.files if not mended or self.mended is None else self.mended
        options = self.options if not mended or self.stated is None else self.stated
        given = {name: value for name, value in (STATEMENTS | options).items() if value is not None}
        request = ImportRequest.model_validate({**given, "accept_proposal": True})
        robot = next(known for known in catalogue_robots() if known.name == ARM)
        return import_or_propose(sources_of(*files.items()), request, robot, ())


def edit(rows: Sequence[Sequence[str]], number: int, column: int, cell: str) -> list[list[str]]:
    """Return rows with another cell."""
    edited = [list(row) for row in rows]
    edited[number][column] = cell
    return edited


def look_at(place: Sequence[float]) -> tuple[float, float, float]:
    """Return the horizontal and the zenith angle [rad] of a place, and its distance."""
    distance = float(np.linalg.norm(place))
    return math.atan2(place[1], place[0]), math.acos(place[2] / distance), distance


def log_line(line: str) -> str:
    """Return a line of a block as a log of a robot has it."""
    name, *cells = line.split(";")
    if name == "joints":
        axes = ", ".join(f"A{axis} {angle}" for axis, angle in enumerate(cells, 1))
        return f"$AXIS_ACT={{E6AXIS: {axes}, E1 0.0, E2 0.0}}"
    if not cells:
        return line
    state, *position = cells
    return f"{name} {state}: " + " ".join(
        f"{axis}={each}" for axis, each in zip("XYZ", position, strict=True)
    )


def strangers() -> dict[str, Proposed]:
    """Return the cases of proposals."""
    table, joints = strange.table, strange.joints(MEASURED, label="Pose")
    turns, wide = table(IN_TURN, TURNS), table(WIDE, NUMBERED)
    three = {"j.csv": joints}
    three |= {
        f"{name}.csv": table(["Pose", *"XYZ"], strange.points(MEASURED, s)) for s, name in enumerate("ab")
    }
    behind = [[f"{name}_b", *place] for name, *place in strange.points(MEASURED, 1)]
    named_behind = {
        "j.csv": joints,
        "p.csv": table(["Pose", *"XYZ"], [*strange.points(MEASURED, 0), *behind]),
    }
    unnamed = {
        name: "\n".join(line.split(";", 1)[1] for line in text.splitlines()) for name, text in three.items()
    }
    shifts = 20.0 * (LOADED - UNLOADED)
    moved = strange.wide(MEASURED, UNLOADED, shifts)
    of_shifts = ["Pose", *strange.JOINTS, "X", "Y", "Z", "dX", "dY", "dZ"]
    alone = ["Pose", *strange.JOINTS, "dX", "dY", "dZ"]
    lone = strange.wide(MEASURED, 20.0 * (LOADED - UNLOADED))
    blocks = strange.FORMS["a_block_for_each_posture"].write(MEASURED)["postures.txt"]
    lines = blocks.splitlines(keepends=True)
    log = "\n".join(map(log_line, blocks.splitlines()))
    report = "Unité : mm\n\n" + "".join(
        f"POINT {label}_{state}_B1\n"
        + "".join(f"{axis} {value}\n" for axis, value in zip("XYZ", p, strict=True))
        for s, state in enumerate(("VIDE", "CHARGE"))
        for label, *p in strange.points(MEASURED, s)
    )
    json_rows = [json.dumps(dict(zip(WIDE, map(float, ["0", *row[1:]]), strict=True))) for row in NUMBERED]
    records = "\n".join(json_rows)
    loads = {"a.csv": table(["Pose", *strange.JOINTS, "Load", *"XYZ"], strange.in_turn(
        MEASURED, ("0 kg", "50 kg", "100 kg"), strange.loads(MEASURED)))}  # fmt: skip
    against = table(["Pose", *strange.JOINTS, *(f"{w} {a}" for w in ("ba", "bb") for a in "XYZ")],
                    strange.wide(MEASURED, LOADED, UNLOADED))  # fmt: skip
    named = ["Pose", "Target", *IN_TURN[1:]]
    of_targets = [[row[0], f"T{row[1]}", *row[2:]] for row in OF_TWO_TARGETS]
    misspelt = [*of_targets[:6], [of_targets[6][0], "TI", *of_targets[6][2:]], *of_targets[7:]]
    twice = [";".join([*row[1:7], *row[8:]]) for row in TURNS]  # without the words for states
    forces = ["Fx [N];Fy [N];Fz [N]\n", *(len(MEASURED.joints) * ["0;0;-981\n"])]
    with_forces = {
        name: "".join(f"{row};{own}" for row, own in zip(three[name].splitlines(), forces, strict=True))
        for name in ("a.csv", "b.csv")
    }
    of_states = table(["Pose", "Zustand", *"XYZ", "Fx [N]", "Fy [N]", "Fz [N]"],
                      [[row[0], *row[7:], "0", "0", "-981"] for row in TURNS])  # fmt: skip
    sized = list(enumerate(strange.wide(MEASURED, UNLOADED, LOADED)))
    numbered_cases = [
        [row[0], target, *row[1:]]
        for number, target in enumerate("AB")
        for row in strange.in_turn(MEASURED, (5, 7), strange.both(MEASURED, number))
    ]
    sights = [[*row[:-3], *map(str, look_at([float(each) for each in row[-3:]]))] for row in TURNS]
    stated_sights = {"p": "horizontal angle [rad]", "q": "vertical angle [rad]", "r": "distance [mm]"}
    uneven = [[*row[:3], f"{float(row[3]) + 0.3 * (n % 2)}", *row[4:]] for n, row in enumerate(TURNS)]
    return {
        "block": Proposed(
            "this block has 4 rows", {"p.txt": "".join(lines[:8] + lines[9:])}, {"p.txt": blocks}
        ),
        "row with fewer cells": Proposed(
            "cells, but the other rows of the table have",
            {"a.csv": table(WIDE, [*NUMBERED[:4], NUMBERED[4][:-1], *NUMBERED[5:]])},
            {"a.csv": wide},
        ),
        "row of other words in a block": Proposed(
            "the first block has no row 'T2 loaded",
            {"p.txt": log.replace("T2 loaded", "T7 loaded", 1)},
            {"p.txt": log},
        ),
        "words that may be states": Proposed(
            "which may be words for states",
            {
                "a.csv": table(
                    IN_TURN,
                    strange.in_turn(
                        MEASURED, ("before", "loaded", "with"), (UNLOADED, LOADED, LOADED + 1e-4)
                    ),
                )
            },
            {"a.csv": table(IN_TURN, strange.in_turn(MEASURED, ("before", "loaded"), (UNLOADED, LOADED)))},
        ),
        "line of no point": Proposed(
            "belongs to no point with a name",
            {"j.csv": joints, "r.txt": f"{report}X 5.0\n"},
            {"j.csv": joints, "r.txt": report},
        ),
        "anchor in YAML": Proposed("has an anchor", {"a.yaml": "a: &x [1]\nb: *x\nc: 1\n"}, {"a.csv": turns}),
        "YAML without a list": Proposed("has no list of", {"a.yaml": "a: 1\nb: 2\nc: 3\n"}, {"a.csv": turns}),
        "unit of displacements": Proposed(
            "so that their unit is not clear",
            {"d.csv": table(of_shifts, moved)},
            {"d.csv": table([*of_shifts[:-3], "dX [µm]", "dY [µm]", "dZ [µm]"], moved)},
        ),
        "unit of displacements alone": Proposed(
            "so that their unit is not clear",
            {"d.csv": table(alone, lone)},
            {"d.csv": table([*alone[:-3], "dX [µm]", "dY [µm]", "dZ [µm]"], lone)},
        ),
        "posture without a row": Proposed(
            "has no row here",
            {**three, "b.csv": table(["Pose", *"XYZ"], strange.points(MEASURED, 1)[:3])},
            three,
        ),
        "targets in one of two columns of numbers": Proposed(
            "has several rows of unloaded in different places",
            {"a.csv": table(["Pose", "No.", *IN_TURN[1:], "Nest"], [[*r, r[1]] for r in OF_TWO_TARGETS])},
            stated={"columns": {"No.": "target"}},
        ),
        "form that lacks a row": Proposed(
            "the form 'Pose 3' lacks 'J1'",
            {"a.xlsx": workbook([row for row in FORM_ROWS if row != FORM_ROWS[14]])},
            {"a.xlsx": workbook(FORM_ROWS)},
        ),
        "row twice": Proposed(
            "has this row twice", {"a.csv": table(IN_TURN, [TURNS[0], *TURNS])}, {"a.csv": turns}
        ),
        "row twice, told apart by a column": Proposed(
            "which may be states or loads",
            {"a.csv": table(["Pose", "Target", *strange.JOINTS, "case_no", *"XYZ"], numbered_cases)},
            stated={"columns": {"case_no": "state"}, "state_words": {"5": "unloaded", "7": "loaded"}},
        ),
        "row twice, its mean": Proposed(
            "has this row twice",
            {"a.csv": table(IN_TURN, [TURNS[0], *TURNS])},
            stated={"mean_of_repeats": True},
        ),
        "repeat far from the mean": Proposed(
            "repeated readings are",
            {"a.csv": table(IN_TURN, [[*TURNS[0][:-1], "5000.1"], *TURNS])},
            {"a.csv": turns},
            options={"mean_of_repeats": True},
        ),
        "misspelt target": Proposed(
            "only '.*' has a row of TI loaded",
            {"a.csv": table(named, misspelt)},
            {"a.csv": table(named, of_targets)},
        ),
        "states behind names": Proposed(
            "points whose names end with 'b' would be left out",
            named_behind,
            stated={"state_words": {"b": "loaded"}},
        ),
        "rows too few": Proposed(
            "has no row",
            {"a.csv": table(IN_TURN, [*TURNS[: len(TURNS) // 2 : 2], *TURNS[len(TURNS) // 2 :]])},
            {"a.csv": turns},
        ),
        "unknown words": Proposed(
            "may be words for states",
            {
                "a.csv": turns.replace("Zustand", "Step")
                .replace("unbelastet", "weg")
                .replace("belastet", "dran")
            },
            stated={"state_words": {"weg": "unloaded", "dran": "loaded"}},
        ),
        "measured nominals": Proposed(
            "the nominal positions are no exact ones",
            {
                "a.csv": table(
                    [
                        "Pose",
                        *strange.JOINTS,
                        *(f"{axis} {word}" for word in ("nominal", "meas") for axis in "xyz"),
                    ],
                    NUMBERED,
                )
            },
            stated={"state_words": {"nominal": "unloaded"}},
        ),
        "words with one meaning": Proposed(
            "differ by 'loaded' and 'with', which may be words for states",
            {
                "a.csv": table(
                    IN_TURN,
                    strange.in_turn(MEASURED, ("before", "loaded", "with"), (UNLOADED, LOADED, UNLOADED)),
                )
            },
            stated={"state_words": {"with": "unloaded"}},
        ),
        "long name of JSON": Proposed(
            "a name has more than 256 characters",
            {"a.jsonl": records.replace("Pose", 300 * "n")},
            {"a.jsonl": records},
        ),
        "columns left": Proposed(
            "are not read, and all positions are unloaded",
            {"a.csv": table([*WIDE[:-3], *"DEF"], strange.wide(MEASURED, UNLOADED, LOADED[::-1]))},
            stated={"ignore": [*"DEF"], "force": None},
        ),
        "columns that look like forces": Proposed(
            "look like forces: Kraft quer",
            {
                "a.csv": table(
                    [*WIDE, "Kraft quer"],
                    [[*row, str(n + 1)] for n, row in enumerate(strange.wide(MEASURED, UNLOADED, LOADED))],
                )
            },
            stated={"ignore": ["Kraft quer"]},
        ),
        "size of another force": Proposed(
            "but 'pull \\[N\\]' has .* under load",
            {"a.csv": table([*WIDE, "pull [N]"], [[*row, f"{900 + n}"] for n, row in sized])},
            stated={"ignore": ["pull [N]"]},
        ),
        "size of a force in some postures": Proposed(
            "'pull \\[N\\]' has no force in some postures",
            {"a.csv": table([*WIDE, "pull [N]"], [[*row, f"{975 + n}" if n else ""] for n, row in sized])},
            {"a.csv": table([*WIDE, "pull [N]"], [[*row, f"{975 + n}"] for n, row in sized])},
        ),
        "one force with unit vectors": Proposed(
            "the unit vectors nx, ny, nz differ by posture",
            {
                "a.csv": table(
                    [*WIDE, "pull [N]", "nx", "ny", "nz"],
                    [
                        [*row, str(975 + n), *(["0", "0", "-1"] if n % 2 else ["0", "-0.6", "-0.8"])]
                        for n, row in sized
                    ],
                )
            },
            stated={"ignore": ["nx", "ny", "nz"]},
        ),
        "rows of other numbers": Proposed(
            "it has 13 rows for 14 postures",
            {**unnamed, "b.csv": "\n".join(unnamed["b.csv"].splitlines()[:-1])},
            unnamed,
        ),
        "rows in another order": Proposed(
            "its numbers are no positions in the postures",
            {**unnamed, "b.csv": "\n".join(["X;Y;Z", *unnamed["b.csv"].splitlines()[:0:-1]])},
            unnamed,
        ),
        "loads without names of postures": Proposed(
            "no names of postures join its loads to those of 'j.csv'",
            {
                "j.csv": unnamed["j.csv"],
                "unloaded.csv": unnamed["a.csv"],
                "loaded.csv": unnamed["b.csv"],
                "f.csv": "".join(forces),
            },
            options={"force": None},
            stated={"force": None, "by_order": True},
        ),
        "two forces of a posture": Proposed(
            "the force differs from that of the same posture in line",
            {"j.csv": joints, "p.csv": of_states.replace("-981", "-90", 1)},
            {"j.csv": joints, "p.csv": of_states.replace("-981", "0", 1)},
            options={"force": None},
        ),
        "two forces of a posture in two files": Proposed(
            "the force of posture .* differs from that of 'b.csv'",
            {**three, **with_forces, "b.csv": with_forces["b.csv"].replace("-981", "-90", 1)},
            {**three, **with_forces},
            options={"force": None},
        ),
        "joints that differ in a posture": Proposed(
            "the 2 rows of a posture have different joints",
            {"a.csv": table(IN_TURN, uneven)},
            stated={"joint_tolerance": 0.5},
        ),
        "postures that occur twice": Proposed(
            "so that some may be under load",
            {"a.csv": "\n".join(twice[:-1])},
            stated={"state": "unloaded"},
        ),
        "part of a polar reading alone": Proposed(
            "'p' is stated to be a part of a polar reading",
            {"a.csv": table([*IN_TURN[:-3], *stated_sights], sights)},
            options={"columns": {"p": "horizontal angle [rad]"}},
            stated={"columns": stated_sights},
        ),
        "header of other columns": Proposed(
            "`header` names 3 columns",
            {"a.csv": wide},
            options={"header": ["x", "y", "z"]},
            stated={"header": WIDE},
        ),
        "header that is ignored and no file has": Proposed(
            "no file has this header", {"a.csv": wide}, options={"ignore": ["G"]}, stated={"ignore": []}
        ),
        "header that is stated and no file has": Proposed(
            "no file has this header",
            {"a.csv": wide},
            options={"columns": {"G": "ignore"}},
            stated={"columns": {}},
        ),
        "one force of several loads": Proposed(
            "`force` states one force for all",
            loads,
            options={"force": STATEMENTS["force"]},
            stated={"force": None},
        ),
        "move against the force": Proposed(
            "move against `force`",
            {"a.csv": against},
            stated={"state_words": {"ba": "loaded", "bb": "unloaded"}},
        ),
    }


def matching(answer: ImportAnswer, case: Case) -> list[ImportFault]:
    return [fault for fault in answer.faults if re.search(case.fault, fault.reason)]


def lowered(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    for place, value in case.limits.items():
        module, _, name = place.rpartition(".")
        monkeypatch.setattr(import_module(f"jointstiff.service.importing.{module}"), name, value)


def named_options(remedy: str) -> set[str]:
    """Return the options that a sentence names."""
    return set(re.findall(r"`(\w+)`", remedy)) & ImportRequest.model_fields.keys()


def changed(case: Case | Proposed) -> set[str]:
    """Return the options that the remedy states or takes away."""
    after = case.options if case.stated is None else case.stated
    return {name for name in {*case.options, *after} if case.options.get(name) != after.get(name)}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.process if name in ARRAYS else ()) for name in CASES]
)
def test_the_remedy_takes_the_fault_away(name, monkeypatch):
    check_remedy(CASES[name], monkeypatch)


@pytest.mark.process
@pytest.mark.parametrize("name", ["two groups", "no such group", "no groups", "two units of an array"])
def test_the_remedy_takes_a_fault_of_hdf5_away(name, monkeypatch):
    check_remedy(groups()[name], monkeypatch)


def check_remedy(case, monkeypatch):
    lowered(case, monkeypatch)
    found = matching(case.answer(mended=False), case)
    assert len(found) >= 1, case.answer(mended=False).faults
    assert case.answer(mended=True).faults == []
    if case.stated is not None:
        named = {one for fault in found for one in named_options(fault.remedy)}
        assert changed(case) & named


@pytest.mark.parametrize("name", strangers())
def test_the_remedy_leads_to_the_proposal_of_the_robot(name):
    case = strangers()[name]
    with pytest.raises(ImportRefusedError) as refused:
        case.answer(mended=False)
    assert re.search(case.fault, str(refused.value))
    mended = case.answer(mended=True)
    assert mended.faults == []
    assert mended.proposal is not None
    if case.stated is not None:
        named = {one for fault in refused.value.faults for one in named_options(fault.remedy)}
        assert changed(case) & named


@pytest.mark.process
def test_the_cases_pass_every_place_that_reports_a_fault(monkeypatch):
    passed: dict[tuple[str, int], set[str]] = {}

    def noted(frame: FrameType, event: str, _: object) -> None:
        """Note where a fault is made, and the options that its remedy names."""
        if event != "call" or frame.f_code is not ImportFileError.__init__.__code__:
            return
        maker = frame.f_back
        while maker is not None and maker.f_code.co_filename.endswith("importing/errors.py"):
            maker = maker.f_back
        if maker is not None:
            at = Path(maker.f_code.co_filename).name, maker.f_lineno
            passed.setdefault(at, set()).update(named_options(frame.f_locals["remedy"]))

    tried = set[str]()
    for case in (*CASES.values(), *groups().values()):
        with monkeypatch.context() as patch:
            lowered(case, patch)
            sys.setprofile(noted)
            try:
                case.answer(mended=False)
            finally:
                sys.setprofile(None)
        tried |= changed(case)
    for stranger in strangers().values():
        sys.setprofile(noted)
        try:
            with suppress(ImportRefusedError):
                stranger.answer(mended=False)
        finally:
            sys.setprofile(None)
        tried |= changed(stranger)
    missing = [
        f"{path.name}:{call.lineno}"
        for path in SITES
        for call in reports(path)
        if not any(at[0] == path.name and call.lineno <= at[1] <= (call.end_lineno or 0) for at in passed)
    ]
    assert missing == [], missing
    assert {one for names in passed.values() for one in names} - tried == set()


def reports(path: Path) -> Iterable[ast.Call]:
    """Yield the calls of a module that make or report a fault."""
    if path.name == "errors.py":
        return
    for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(call, ast.Call):
            name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
            if name in ("ImportFileError", "report") and EXCLUDED not in ast.unparse(call):
                yield call
