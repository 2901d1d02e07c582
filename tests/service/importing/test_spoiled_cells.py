"""Tables with one header or cell changed: named with line and column, or read as the number that it is."""

import pytest
from support.importing_samples import CAMPAIGN, JOINTS, MM, POINTS, answered, points_of, read, values_of

TABLES = {
    "a.csv": (CAMPAIGN.split("\n", 1)[1], ";", {}),
    "b.csv": (JOINTS, ",", {}),
    "p.txt": (POINTS, ";", {"units": MM}),
}
NUMBER = "use digits with at most one decimal mark, no unit, no thousands separator, no NaN"
HEADERS = "use headers such as `label`, `J1 [deg]`, `Fx [N]`, `P10 unloaded x [mm]`"
TEMPLATE = "give a template `point_name`, such as {label}_{target}_{state}"
MARKS = "the file has decimal points and decimal commas"
FILL_OR_LEAVE_OUT = "fill in the cell, or use `allow_missing` to leave this reading out"
PAIRED = "add the reading, check the spelling of names, or use `allow_missing`"


def rows_of(name):
    table, mark, _ = TABLES[name]
    return [line.split(mark) for line in table.splitlines()]


def with_cell(name, row, column, new):
    """Return the table with another cell."""
    rows = rows_of(name)
    rows[row][column] = new
    return "".join(f"{TABLES[name][1].join(each)}\n" for each in rows)


def faults(name, row, column, new):
    """Return place, reason and remedy of each fault of the table with another cell."""
    table = with_cell(name, row, column, new)
    made = answered((name, table), show_faults=True, **TABLES[name][2])
    return [((each.line, each.column), each.reason, each.remedy) for each in made.faults]


def numbers(name, row, column, new):
    """Return all numbers of the table with another cell."""
    found = read((name, with_cell(name, row, column, new)), **TABLES[name][2])
    return points_of(found) | values_of(found)


def flat(numbers_by_name):
    return {(key, i): each for key, values in numbers_by_name.items() for i, each in enumerate(values)}


def as_it_is(name):
    return numbers(name, 0, 0, rows_of(name)[0][0])


def cells(*names, rows, columns=slice(None)):
    """Cells of tables: name, row, column and text."""
    return [
        pytest.param(name, row, column, cell, id=f"{name} {row + 1}:{column + 1}")
        for name in names
        for row in rows
        for column, cell in list(enumerate(rows_of(name)[row]))[columns]
    ]


HEADS = cells("a.csv", "b.csv", rows=[0])
VALUES = cells("a.csv", "b.csv", rows=[1, 2], columns=slice(1, None)) + cells(
    "p.txt", rows=[0, 1, 2], columns=slice(1, None)
)


@pytest.mark.parametrize(("name", "row", "column", "cell"), HEADS)
def test_a_header_that_is_misspelt_is_named_with_its_place(name, row, column, cell):
    for new in ("", f"{cell} {cell}", cell[:-1], f"{cell}x", "1e3"):
        ((place, reason, remedy),) = faults(name, row, column, new)[:1]
        assert (place, reason) == ((1, column + 1), f"unknown column header {new!r}")
        assert remedy.startswith(HEADERS)


@pytest.mark.parametrize(("name", "row", "column", "cell"), HEADS)
def test_a_header_in_quotation_marks_means_the_same(name, row, column, cell):
    assert numbers(name, row, column, f'"{cell}"') == as_it_is(name)


@pytest.mark.parametrize(("name", "row", "column", "cell"), HEADS)
def test_a_header_in_capitals_means_the_same_but_coordinates_are_spelt_alike(name, row, column, cell):
    if not cell.startswith("P10"):
        assert numbers(name, row, column, cell.upper()) == as_it_is(name)
        return
    first = column - (column - 7) % 3
    spelt = [each.upper() if i == column else each for i, each in enumerate(rows_of(name)[0])]
    x, y, z = spelt[first : first + 3]
    assert faults(name, row, column, cell.upper()) == [
        (
            (1, first + 1),
            f"{x!r} and {y!r} and {z!r} are not spelt alike",
            "write x, y and z alike, or give their meaning in `columns`",
        )
    ]


@pytest.mark.parametrize(
    ("name", "row", "column", "cell"), [each for each in VALUES if each.values[:2] != ("p.txt", 0)]
)
def test_a_cell_that_is_no_number_is_named_with_its_place(name, row, column, cell):
    place = (row + 1, column + 1)
    is_of_reading = name == "p.txt" or column >= 7
    remedy = FILL_OR_LEAVE_OUT if is_of_reading else "fill in the cell"
    assert faults(name, row, column, "")[0] == (place, "the cell is empty, but needs a number", remedy)
    for mark in ("n/a", "NA", "NaN", "-", "–", "null"):
        assert faults(name, row, column, mark)[0] == (place, f"{mark!r} is no number", remedy)
    for new in (f"{cell} {cell}", f"{cell}x"):
        reason = f"{new!r} is not a number with a decimal point"
        assert faults(name, row, column, new)[0] == (place, reason, NUMBER)


@pytest.mark.parametrize(("name", "row", "column", "cell"), VALUES)
def test_a_number_is_read_as_it_is_written_and_changes_no_other(name, row, column, cell):
    whole = flat(as_it_is(name))
    assert flat(numbers(name, row, column, f'"{cell}"')) == whole
    for new in (cell[:-1] if len(cell) > 3 else "7", "1e3"):
        found = flat(numbers(name, row, column, new))
        assert found.keys() == whole.keys()
        changed = {key for key in whole if found[key] != whole[key]}
        assert len(changed) == 1
        (key,) = changed
        scale = whole[key] / float(cell) if float(cell) else 1.0
        assert found[key] == pytest.approx(float(new) * scale, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "row", "column", "cell"), [each for each in VALUES if "." in each.values[3]]
)
def test_a_table_has_one_decimal_mark(name, row, column, cell):
    """Of two marks the second is named; between commas a decimal comma makes a cell more."""
    place, reason, remedy = faults(name, row, column, cell.replace(".", ","))[0]
    if name == "b.csv":
        assert (place, reason) == ((row + 1, 7), "the row has 7 cells, but line 1 has 6 (delimiter: comma)")
        assert remedy.startswith("give every row the same number of cells; check for a missing or doubled")
        return
    is_first = all(
        "." not in each for line in rows_of(name)[bool(name == "a.csv") : row] for each in line[1:]
    ) and all("." not in each for each in rows_of(name)[row][1:column])
    if not is_first:
        assert (place, reason.partition(":")[0]) == ((row + 1, column + 1), repr(cell.replace(".", ",")))
    else:
        assert place == (row + 1, column + 2)
    assert reason.endswith(f": {MARKS}")
    assert remedy == "use one decimal mark and no thousands separators"


@pytest.mark.parametrize("column", [1, 2, 3])
def test_a_first_row_that_is_no_point_is_taken_for_a_header(column):
    row = rows_of("p.txt")[0]
    for new in ("", f"{row[column]} {row[column]}", f"{row[column]}x"):
        place, reason, _ = faults("p.txt", 0, column, new)[0]
        shown = ", ".join(map(repr, [*row[:column], new, *row[column + 1 :]]))
        assert (place, reason) == ((1, 1), f"unknown column headers {shown}")


@pytest.mark.parametrize(
    ("name", "row"), [("a.csv", 1), ("a.csv", 2), ("b.csv", 1), ("p.txt", 0), ("p.txt", 2)]
)
def test_a_row_needs_its_name(name, row):
    assert faults(name, row, 0, "")[0] == (
        (row + 1, 1),
        "the name is empty",
        "fill in this cell in every row",
    )


@pytest.mark.parametrize("row", [0, 1, 2])
def test_the_name_of_a_point_shows_observation_target_and_state(row):
    name = rows_of("p.txt")[row][0]
    for new in (f"{name} {name}", name[:-1], f"{name}x"):
        reason = f"the name {new!r} does not show the observation, the target and the state of the point"
        assert faults("p.txt", row, 0, new)[0] == ((row + 1, 1), reason, TEMPLATE)
    assert faults("p.txt", row, 0, "1e3")[0] == (
        (row + 1, 1),
        "without a header, the name of a point must be where '1e3' is",
        "give rows of name x y z, add a header, or give `header`",
    )


@pytest.mark.parametrize(("row", "state", "left"), [(0, "unloaded", "loaded"), (1, "loaded", "unloaded")])
def test_names_in_capitals_are_other_names_and_both_lack_a_reading(row, state, left):
    found = faults("p.txt", row, 0, rows_of("p.txt")[row][0].upper())
    names = (
        {"unloaded": "C01", "loaded": "c01"} if state == "unloaded" else {"loaded": "C01", "unloaded": "c01"}
    )
    assert found == [
        ((line, 2), f"{names[each]}: target P10 was read only {each}", PAIRED)
        for line, each in ((1, "unloaded"), (2, "loaded"))
    ]


def test_joints_alone_lack_readings_and_points_alone_lack_angles_and_forces():
    joints, points = (answered((name, TABLES[name][0]), **TABLES[name][2]) for name in ("b.csv", "p.txt"))
    assert (joints.observation_count, joints.reading_count, joints.measurement_set) == (2, 0, None)
    assert joints.missing == ["readings: columns such as `P10 unloaded x [mm]`, or lists of points"]
    assert (points.observation_count, points.reading_count, points.measurement_set) == (2, 2, None)
    assert points.missing == [
        "joint angles of each observation: columns `J1 [deg]`, `J2 [deg]`, … (lengths as `J3 [mm]`)",
        "the force of each observation in axes of R0: columns `Fx [N]`, `Fy [N]`, `Fz [N]`, or one `force` "
        "(N, daN, kN, kgf, lbf)",
    ]
