"""Tables and workbooks that are read, understood or asked about, and come back as they were written."""

import io

import numpy as np
import openpyxl
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from support.examples import examples, is_full
from support.importing_samples import CAMPAIGN, MM, Dialect, answered, points_of, read, values_of
from support.memory import peak_of
from support.shared_data import MISSING, SHARED
from support.workbooks import SHEET, repacked, table_of, workbook

import jointstiff
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.parsing import MAX_SET_BYTES
from jointstiff.service.importing import grid, limits
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grid import MAX_FILE_BYTES
from jointstiff.simulator import default_arm
from jointstiff.simulator.own_weight import unloaded_campaign

SPACE = b"http://schemas.openxmlformats.org/spreadsheetml/2006/main"


@pytest.mark.timeout(30)
@pytest.mark.parametrize(
    ("cells", "reason"),
    [
        (b"<row><c><v>1</v></c></row>" * 400_000, "100 times as large"),
        (b"<row>" + b"<c/>" * 257 + b"</row>", "more than 256 columns"),
        (b'<row><c r="IV%d"/></row>', "or the sheets 500000 cells"),
        (b"<row>" + b"<x/>" * 100_001 + b"</row>", "100000 in one"),
        (b"<row><c><v>" + b"1" * 400_000 + b"</v></c></row>", "a text in the file has more than"),
    ],
)
def test_small_files_that_unpack_to_much_are_refused_at_once(cells, reason):
    if b"%d" in cells:
        cells = b"".join(cells % line for line in range(1, 3000))
    sheet = b'<worksheet xmlns="%s"><sheetData>%s</sheetData></worksheet>' % (SPACE, cells)
    content = repacked(workbook(), SHEET, lambda _: sheet)
    with pytest.raises(ImportFileError, match=reason):
        read(("a.xlsx", content))


def test_a_single_part_that_is_encrypted_is_enough():
    content = workbook()
    flags = content.index(b"PK\1\2") + 8
    with pytest.raises(ImportFileError, match="the file is encrypted"):
        read(("a.xlsx", content[:flags] + b"\1" + content[flags + 1 :]))


LAST = {  # cells of the last column: of two whole lines, and of one without an end
    "taken": "1.25 2.75 3.50, 1.2 2.7 3.6, 1.1234567 2.1234567 3.123456, P10 P12 P11, P10 Q1 P1",
    "doubted": "1.25 2.75 3.5, 1.2 2.755 3.6, 1.5 2.5 333, 1.123456 2.123456 3.12345, 125 275 3",
    "cut off": "1.20 2.75 3.5, 1.25 2.75 3., 1.5 2.5 3, 1.5 2.5 -3, 125 275 27, P10 P12 P1, P1 P12 P",
}


@pytest.mark.parametrize("outcome", LAST)
def test_a_last_line_without_an_end_may_be_cut_off(outcome):
    for cells in map(str.split, LAST[outcome].split(",")):
        table = "\n".join(["J1 [deg];Fx [N];Fy [N];Fz [N];label", *(f"1;0;0;-5;{cell}" for cell in cells)])
        whole = read(("a.csv", table + "\n"), by_order=True)  # labels need no numbers
        assert [*whole.unusual, *whole.preview.files[0].assumptions] == []
        if outcome == "cut off":
            with pytest.raises(ImportFileError, match="the file is cut off"):
                read(("a.csv", table))
            continue
        asked = f"the last number {cells[-1]} ('a.csv', line 4, column 5), whose line has no line break"
        assert list(read(("a.csv", table)).unusual) == [asked] * (outcome == "doubted")


@pytest.mark.slow
@pytest.mark.process
def test_a_sheet_at_the_limits_takes_little_memory():
    """A list of points, of nearly as many cells as a sheet may have, and the postures."""
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet()
    for number in range(3_600 * 16 * 2):
        label, target = divmod(number // 2, 16)
        name = f"c{label:04d}_P{target}_{'loaded' if number % 2 else 'unloaded'}"
        sheet.append([name, *(number * factor % 9973 / 10_000 for factor in (7, 11, 13))])
    output = io.BytesIO()
    book.save(output)
    rows = (f"c{label:04d};{label % 90};{label % 77};0;0;-100" for label in range(3_600))
    joints = "\n".join(["label;J1 [deg];J2 [deg];Fx [N];Fy [N];Fz [N]", *rows])
    files = ("points.xlsx", output.getvalue()), ("joints.csv", joints)

    def imported():
        answer = answered(*files, units=MM, accept_unusual=True)
        assert answer.reading_count == 57_600
        assert answer.measurement_set is not None

    peak, outcome = peak_of(imported)
    assert outcome == "taken"
    assert peak < 256


NUMBERS = st.one_of(
    st.floats(-1e12, 1e12, allow_nan=False),
    st.floats(-3000, 3000, allow_nan=False),
    st.integers(-10_000, 10_000).map(float),
    st.decimals(-3000, 3000, places=4).map(float),
)
NAMES = st.text(st.characters(codec="latin-1", categories=("L", "N")), min_size=1, max_size=8).map(
    lambda text: "n" + text
)
DIALECTS = st.builds(
    Dialect,
    delimiter=st.sampled_from(["comma", "semicolon", "tab", "whitespace"]),
    mark=st.sampled_from([".", ","]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    quote=st.booleans(),
)


@st.composite
def campaigns(draw):
    """A header in some order, and numbers by label and meaning."""
    labels = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    targets = draw(st.lists(NAMES, max_size=3, unique_by=str.casefold))
    assume(not any(word in "sigma nominal" for word in targets))
    vectors = {"force": [f"F{axis} [N]" for axis in "xyz"]}
    vectors["joint"] = [f"J{number} [deg]" for number in range(1, 1 + draw(st.integers(1, 7)))]
    for target in targets:
        for state in ("unloaded", "loaded") if draw(st.booleans()) else ("deflection",):
            vectors[target, state] = [f"{target}_{state}_{axis} [mm]" for axis in "xyz"]
    header = draw(st.permutations(["label", *(name for names in vectors.values() for name in names)]))
    table = {label: {name: draw(NUMBERS) for name in header if name != "label"} for label in labels}
    return header, vectors, table


def expected(vectors, table):
    values, points = {}, {}
    for label, cells in table.items():
        for key, names in vectors.items():
            vector = tuple(cells[name] for name in names)
            if isinstance(key, str):
                values[label, key] = vector
            else:
                points[label, *key] = vector
    return values, points


@given(campaigns(), DIALECTS)
@examples(60)
def test_text(campaign, dialect):
    header, vectors, table = campaign
    rows = [
        header,
        *([label, *(repr(table[label][name]) for name in header if name != "label")] for label in table),
    ]
    place = header.index("label")
    rows = [header, *([*row[1 : place + 1], row[0], *row[place + 1 :]] for row in rows[1:])]
    content = dialect.write(rows)
    try:
        imported = read(("a.csv", content))
    except ImportFileError as error:
        if "thousands separator" not in error.reason:
            raise
        imported = read(("a.csv", content), decimal_mark="comma")
    assert (values_of(imported), points_of(imported)) == expected(vectors, table)
    file = imported.preview.files[0]
    assert file.delimiter == dialect.delimiter
    assert imported.preview.observation_count == len(table)


@given(campaigns())
@examples(20)
def test_excel(campaign):
    header, vectors, table = campaign
    book = openpyxl.Workbook()
    book.active.append(header)
    for label, cells in table.items():
        book.active.append([label if name == "label" else cells[name] for name in header])
    output = io.BytesIO()
    book.save(output)
    # openpyxl writes 16 digits, of which it reads these numbers again
    sheet = openpyxl.load_workbook(io.BytesIO(output.getvalue())).active
    stored = [dict(zip(header, row, strict=True)) for row in sheet.iter_rows(min_row=2, values_only=True)]
    imported = read(("a.xlsx", output.getvalue()))
    by_label = {row["label"]: row for row in stored}
    assert (values_of(imported), points_of(imported)) == expected(vectors, by_label)


@given(
    st.dictionaries(st.tuples(NAMES, NAMES, st.sampled_from(["unloaded", "loaded"])),
                    st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=8),
    DIALECTS, st.sampled_from(["_", "::"]),
)  # fmt: skip
@examples(60)
def test_points(points, dialect, separator):
    rows = [[separator.join(key), *map(repr, vector)] for key, vector in points.items()]
    options = {"units": {"length": "mm", "angle": "deg", "force": "N"}, "allow_missing": True}
    one_state = len({state for _, _, state in points}) == 1
    complete = {
        key: vector for key, vector in points.items()
        if one_state or {(*key[:2], "unloaded"), (*key[:2], "loaded")} <= set(points)
    }  # fmt: skip
    try:
        imported = read(("a.txt", dialect.write(rows)), **options)
    except ImportFileError as error:
        if "thousands separator" not in error.reason:
            if complete or "no observation has a reading" not in error.reason:
                raise
            return
        imported = read(("a.txt", dialect.write(rows)), decimal_mark="comma", **options)
    assert points_of(imported) == complete


UR = {
    "ur5": ((0, 0.089159), (-0.425, 0), (-0.39225, 0), (0, 0.10915), (0, 0.09465), (0, 0.0823)),
    "ur10": ((0, 0.1273), (-0.612, 0), (-0.5723, 0), (0, 0.163941), (0, 0.1157), (0, 0.0922)),
}
"""The maker's a and d, in m."""
TWISTS = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)


def robot_of(name):
    rows = [
        {"a": a, "alpha": alpha, "d": d, "theta": 0.0} for (a, d), alpha in zip(UR[name], TWISTS, strict=True)
    ]
    model = {"format": "dh", "convention": "standard", "rows": rows}
    return RobotDocument.model_validate({"name": name, "model": model})


def ur5():
    """1,000 poses, read as target plus deviation; 0.15 mm are the best residuals published."""
    columns = {"step_order": "label", **{f"joint_{number}": f"J{number} [deg]" for number in range(1, 7)}}
    for axis in "xyz":
        columns |= {f"{axis}_t": f"tool unloaded {axis} [mm]"}
        columns |= {f"{axis}_dif": f"tool unloaded plus {axis} [mm]"}
    file = SHARED / "ur5_grid" / "3D_UR5_uncalibrated_grid_cleaned.csv"
    return jointstiff.import_files(file, columns=columns).geometry


def ur10():
    """632 poses of a T-Mac: decimal commas, no labels, uncertainties that are no U(95)."""
    joints = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    columns = {f"{name}_joint": f"J{number} [rad]" for number, name in enumerate(joints, 1)}
    columns |= {f"measurement_{axis}": f"TMAC unloaded {axis} [mm]" for axis in "xyz"}
    file = SHARED / "ur10_poses" / "measurements_iso_cubes.csv"
    ignore = [header for header in file.read_text().splitlines()[0].split(";") if header not in columns]
    return jointstiff.import_files(file, columns=columns, ignore=ignore, by_order=True).geometry


@pytest.mark.skipif(not SHARED.is_dir(), reason=MISSING)
@pytest.mark.parametrize(
    ("imported", "count", "step", "sigma"),
    [pytest.param(ur5, 1_000, 5, 0.15e-3, marks=pytest.mark.slow), (ur10, 632, 12, 1e-3)],
)
def test_the_poses_of_a_real_robot_give_its_geometry(imported, count, step, sigma):
    request = imported()
    assert len(request.poses) == count
    few = request.model_copy(update={"poses": request.poses[::step]})
    found = jointstiff.geometry(few.model_dump(mode="json"), robot=robot_of(imported.__name__))
    assert found.result.sigma < sigma


def test_limits(monkeypatch):
    assert MAX_FILE_BYTES == MAX_SET_BYTES
    assert (limits.MAX_ROWS, grid.MAX_LINES) == (320_000, 400_000)
    monkeypatch.setattr(limits, "MAX_ROWS", 300)
    with pytest.raises(ImportFileError, match=r"line 301: .*more than 300 rows"):
        read(("a.csv", b"a\n" * 301))
    monkeypatch.setattr(grid, "MAX_LINES", 400)
    with pytest.raises(ImportFileError, match=r"'a.csv': .*more than 400 lines together"):
        read(("a.csv", b"\n" * 400 + b"a b\r\n"))
    read(("a.csv", (CAMPAIGN + "\n" * 201).replace("\n", "\r\n").encode("utf-16")))


@pytest.mark.parametrize(
    "content",
    [
        b"ab\n" * 2_700_000,
        (b";".join([b"11"] * 250) + b"\n") * 11_000,
        (b"# " + b"11," * 250 + b"\n") * 11_000 + b"P1,1,2,3\n",
        b"no_state_in_this_name 1 2 3\n" * 50_000,
    ],
    ids=["lines", "cells", "cells of comments", "unclear names"],
)
@pytest.mark.process
def test_what_is_refused_takes_little_memory(content):
    peak, outcome = peak_of(lambda: read(("a.csv", content), units=MM))
    assert outcome == "ImportFileError"
    assert peak < 100


@pytest.mark.parametrize(
    "content",
    [
        b";" * 65_000,
        b'""' * 30_000,
        b"\t" * 60_000 + b"a",
        b"#" * 100_000,
        b"a;b\n" * (100_000 if is_full() else 10_000),
        b"\r" * 10_000 + b"x",
        b"label;J1 [deg];;Fx [N];Fy [N];Fz [N]\nc01;1;;0;0;-1\nc02;2;7;0;0;-1\n",  # of no header
        b"name;x [mm];y [mm];z [mm]\nc01 u::P10;1;2;3\n",
        b"name;x [mm];y [mm];z [mm]\nc01:: unloaded;1;2;3\n",
    ],
)
def test_hostile_and_unclear_texts(content):
    with pytest.raises(ImportFileError):
        read(("a.csv", content))


UNLOADED = unloaded_campaign(default_arm(), configurations=30, seed=4)


def test_a_robot_with_masses_makes_a_set_that_is_identified_without_an_option(tmp_path):
    """The numbers are those of the campaign as it was simulated; nothing says `weight`."""
    table = tmp_path / "grid.csv"
    table.write_bytes(table_of(UNLOADED) + b"\n")
    options = {"encoders": "motor", "noise": {"sigma": 0.03}, "length_unit": "mm"}
    answer = jointstiff.import_files(table, robot=UNLOADED["robot"], **options)
    assert (answer.missing, answer.findings) == ([], [])
    assert {one.force for one in answer.measurement_set.observations} == {(0.0, 0.0, 0.0)}
    read = answer.measurement_set.model_dump(mode="json", exclude_none=True)
    run = jointstiff.identify({"robot": UNLOADED["robot"], "measurement_set": read})
    stated = jointstiff.identify(UNLOADED)
    assert run.request.weight is not None
    pairs = [
        (one.stiffness, other.stiffness)
        for one, other in zip(run.result.joints, stated.result.joints, strict=True)
    ]
    numbers = [pair for pair in pairs if None not in pair]
    assert len(numbers) >= 3
    assert all(one == pytest.approx(other, rel=1e-6) for one, other in numbers)
    assert all(pair == (None, None) for pair in pairs if None in pair)
