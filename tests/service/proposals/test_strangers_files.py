"""Files as people write them who have not read our documentation: one proposal leads to a set."""

import io

import numpy as np
import openpyxl
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=4, configurations=12)
DEGREES = np.rad2deg(READINGS.joints)
UNLOADED = 1e3 * READINGS.position[:, 0]
LOADED = UNLOADED - [0.0, 0.0, 0.4]
COUNT = len(DEGREES)
STATED = {
    "encoders": "motor",
    "load_point": [0, 0, 100],
    "force": [0, 0, -100],
    "units": {"force": "N"},
    "length_unit": "mm",
}


def rows_of(*blocks, digits=4):
    table = np.column_stack([np.asarray(block, float) for block in blocks])
    return [[f"{value:.{digits}f}" for value in row] for row in table.tolist()]


def text(rows, delimiter=";", *, comma=False):
    lines = [delimiter.join(row) for row in rows]
    content = "\n".join(lines) + "\n"
    return (content.replace(".", ",") if comma else content).encode()


def workbook(*sheets):
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets:
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(
                [float(cell) if cell.lstrip("-").replace(".", "", 1).isdigit() else cell for cell in row]
            )
    output = io.BytesIO()
    book.save(output)
    return book, output.getvalue()


def merged_titles():
    header = ["Punkt", *(f"A{i}" for i in range(1, 7)), *"XYZ", *"XYZ"]
    units = ["", *["°"] * 6, *["mm"] * 6]
    states = ["", *[""] * 6, "ohne Last", "", "", "mit Last", "", ""]
    data = [[f"P{i}", *row] for i, row in enumerate(rows_of(DEGREES, UNLOADED, LOADED), 1)]
    book, _ = workbook(
        ("Messung", [["Messprotokoll Roboter 3"], ["Prüfer: Huber"], states, header, units, *data])
    )
    book.active.merge_cells("A1:M1")
    book.active.merge_cells("H3:J3")
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


ACHSEN = [f"Achse {i} [Grad]" for i in range(1, 7)]
NUMBERS = [f"{i}" for i in range(1, COUNT + 1)]
QUATERNIONS = np.tile([1.0, 0.0, 0.0, 0.0], (COUNT, 1)) + 0.01 * np.arange(COUNT)[:, None]
TIMES = [f"08.11.2022 16:{i:02d}:05" for i in range(COUNT)]
FILES = {
    "German headers, decimal commas": {
        "messung.csv": text(
            [
                ["Nr", *ACHSEN, "X ohne", "Y ohne", "Z ohne", "X mit", "Y mit", "Z mit"],
                *([n, *row] for n, row in zip(NUMBERS, rows_of(DEGREES, UNLOADED, LOADED), strict=True)),
            ],
            comma=True,
        )
    },
    "A1 to A6, units in a second row, tabs": {
        "data.txt": text(
            [
                [*(f"A{i}" for i in range(1, 7)), *"xyz"],
                [*["deg"] * 6, *["mm"] * 3],
                *rows_of(DEGREES, UNLOADED),
            ],
            "\t",
        ),
        "loaded.txt": text([list("xyz"), *rows_of(LOADED)], "\t"),
    },
    "Excel, merged titles, units below": {"Messung.xlsx": merged_titles()},
    "two blocks in one file": {
        "blocks.csv": b"unloaded\n"
        + text([["j1", "j2", "j3", "j4", "j5", "j6", "x", "y", "z"], *rows_of(DEGREES, UNLOADED)])
        + b"\nloaded\n"
        + text([["j1", "j2", "j3", "j4", "j5", "j6", "x", "y", "z"], *rows_of(DEGREES, LOADED)])
    },
    "a file for each state with the joints in both": {
        "before.csv": text([[*(f"q{i}" for i in range(6)), *"xyz"], *rows_of(DEGREES, UNLOADED)], ","),
        "after.csv": text([[*(f"q{i}" for i in range(6)), *"xyz"], *rows_of(DEGREES, LOADED)], ","),
    },
    "positions with quaternions": {
        "poses.csv": text(
            [
                [*(f"joint{i}" for i in range(1, 7)), "px", "py", "pz", "qw", "qx", "qy", "qz"],
                *rows_of(READINGS.joints, UNLOADED / 1e3, QUATERNIONS, digits=7),
            ],
            ",",
        ),
        "p2.csv": text([["px", "py", "pz"], *rows_of(LOADED / 1e3, digits=7)], ","),
    },
    "states in turn, named in words": {
        "turns.csv": text(
            [
                ["Zustand", *ACHSEN, "X", "Y", "Z"],
                *(
                    [word, *row]
                    for pair in zip(rows_of(DEGREES, UNLOADED), rows_of(DEGREES, LOADED), strict=True)
                    for word, row in zip(("leer", "150 kg"), pair, strict=True)
                ),
            ]
        )
    },
    "Excel, joints and points in two sheets": {
        "two.xlsx": workbook(
            ("joints", [[f"J{i}" for i in range(1, 7)], *rows_of(DEGREES)]),
            ("points", [["x0", "y0", "z0", "x1", "y1", "z1"], *rows_of(UNLOADED, LOADED)]),
        )[1]
    },
    "date, time and operator": {
        "log.csv": text(
            [
                ["Datum", "Bediener", *(f"θ{i}" for i in range(1, 7)), "X1", "Y1", "Z1", "X2", "Y2", "Z2"],
                *(
                    [t, "Huber", *row]
                    for t, row in zip(TIMES, rows_of(DEGREES, UNLOADED, LOADED), strict=True)
                ),
            ]
        )
    },
    "a comment as header, aligned by blanks": {
        "t.dat": b"# a1 a2 a3 a4 a5 a6 x y z xl yl zl\n"
        + text([[cell.rjust(12) for cell in row] for row in rows_of(DEGREES, UNLOADED, LOADED)], " ")
    },
    "no header, tabs and decimal commas": {
        "export.txt": text(rows_of(DEGREES, UNLOADED, LOADED), "\t", comma=True)
    },
    "a mean and a remark at the end": {
        "table.csv": text(
            [
                [
                    "Pos",
                    *(f"J{i}" for i in range(1, 7)),
                    "TCP_X",
                    "TCP_Y",
                    "TCP_Z",
                    "TCP_X_L",
                    "TCP_Y_L",
                    "TCP_Z_L",
                ],
                *([n, *row] for n, row in zip(NUMBERS, rows_of(DEGREES, UNLOADED, LOADED), strict=True)),
                ["Mittel", *[""] * 6, *(f"{v:.4f}" for v in [*UNLOADED.mean(0), *LOADED.mean(0)])],
                ["Bemerkung: Halle 22 Grad", *[""] * 12],
            ]
        )
    },
}


@pytest.mark.parametrize("form", FILES)
def test_one_proposal_leads_from_a_strangers_file_to_a_set(form, tmp_path):
    for name, content in FILES[form].items():
        (tmp_path / name).write_bytes(content)
    more = {"sheet": "joints; points"} if "two sheets" in form else {}
    proposal = js.read(*(tmp_path / name for name in FILES[form]), robot=ARM, **STATED, **more)
    assert len(proposal.accept().campaign.measurement_set.observations) == COUNT
