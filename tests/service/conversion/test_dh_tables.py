"""Tables of Denavit and Hartenberg as people have them: each becomes the same rows, or is refused."""

import math

import numpy as np
import pandas as pd
import polars as pl
import pytest

import jointstiff as js
from jointstiff.schemas.robot import DhRow
from jointstiff.service.conversion.catalogue import catalogue
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.solver.errors import RobotError

ROWS = [[330.0, -90.0, 780.0, 0.0], [1120.0, 0.0, 0.0, -90.0], [60.0, 90.0, 0.0, 180.0]]
"""a [mm], alpha [°], d [mm], theta [°]."""
WANTED = [
    (0.33, -math.pi / 2, 0.78, 0.0),
    (1.12, 0.0, 0.0, -math.pi / 2),
    (0.06, math.pi / 2, 0.0, math.pi),
]
"""The same in m and rad."""
IN_SI = [[*row] for row in WANTED]
ORDER = ["theta", "d", "a", "alpha"]
PLAIN = "a alpha d theta"
"""The order of the columns of ROWS."""


def reordered(rows, names=ORDER):
    """Return the rows as mappings, with the columns in another order."""
    columns = dict(zip(["a", "alpha", "d", "theta"], range(4), strict=True))
    return [{name: row[columns[key]] for name, key in zip(names, ORDER, strict=True)} for row in rows]


PRINTED = [
    ["330", "\u221290°", "780", "θ1"],
    ["1120", "0", "0", "θ2 - 90°"],
    ["60", "π/2", "0", "q3+pi"],
]
TABLES = {
    "an array": (np.array(ROWS), "mm, deg"),
    "lists in m and rad": (IN_SI, "m, rad"),
    "cells as papers print them": (PRINTED, "mm, deg"),
    "a data frame in another order": (pd.DataFrame(reordered(ROWS)), "mm, deg, N"),
    "a frame of polars in another order": (pl.DataFrame(reordered(ROWS)), "mm, deg, N"),
    "a frame of polars without names": (pl.DataFrame(np.array(ROWS)), "mm, deg"),
    "mappings in m and rad": (reordered(IN_SI), "m, rad, N"),
    "units in the names": (
        pd.DataFrame(reordered(ROWS, ["θ_i [°]", "d_i (mm)", "a_i [mm]", "α_{i} [deg]"])),
        None,
    ),
    "a column of numbers": (pd.DataFrame(reordered(ROWS)).assign(i=[1, 2, 3]), "mm, deg"),
    "a data frame without names": (pd.DataFrame(ROWS), "mm, deg"),
    "messages in m and rad": ([DhRow(**row) for row in reordered(IN_SI)], None),
    "an array with names": (pd.DataFrame(reordered(ROWS)).to_records(index=False), "mm, deg"),
}


def has_names(rows):
    """Return whether the columns of a table have names of their own."""
    if isinstance(rows, pd.DataFrame):
        return all(isinstance(name, str) for name in rows.columns)
    if isinstance(rows, pl.DataFrame):
        return rows.columns[0] != "column_0"
    return bool(getattr(getattr(rows, "dtype", None), "names", None)) or isinstance(rows[0], dict | DhRow)


@pytest.mark.parametrize("form", TABLES)
def test_a_table_has_the_same_rows_in_each_form(form):
    rows, units = TABLES[form]
    columns = None if has_names(rows) else PLAIN
    model = js.robot(rows, convention="standard", columns=columns, units=units).model
    found = [(row.a, row.alpha, row.d, row.theta) for row in model.rows]
    np.testing.assert_allclose(found, WANTED, rtol=1e-12, atol=1e-12)


def test_limits_of_a_prismatic_joint_are_lengths():
    rows = [{"a": 0, "alpha": 0, "d": 100, "theta": 0, "kind": "P", "lower": -500, "upper": 500}]
    (row,) = js.robot(rows, convention="modified", units="mm, deg").model.rows
    assert (row.kind, row.d, row.lower, row.upper) == ("prismatic", 0.1, -0.5, 0.5)


REFUSED = {
    "names without units": (
        reordered(ROWS),
        None,
        "the columns theta, d, a, alpha of the table have no units",
    ),
    "rows without units": (ROWS, None, "the columns a, alpha, d, theta of the table have no units"),
    "an unknown column": (
        [{**reordered(ROWS)[0], "beta": 0.0}],
        "mm, deg",
        "column 'beta' of the table is unknown",
    ),
    "a column twice": ([{**reordered(ROWS)[0], "θ": 0.0}], "mm, deg", "the table has two columns theta"),
    "a column that is missing": ([{"a": 1.0, "alpha": 0.0, "d": 0.0}], "mm, deg", "has no column theta"),
    "a word": ([["x", "0", "1", "0"]], "mm, deg", "a of row 1: 'x' is not a number"),
    "a coupled angle": ([["1", "0", "1", "q2 - q1"]], "mm, deg", "theta of row 1: 'q2 - q1' is not a number"),
    "a length with pi": ([["pi", "0", "1", "0"]], "mm, deg", "a of row 1: 'pi' is not a number"),
    "a factor of the joint's angle": ([["1", "0", "1", "2*q2"]], "mm, deg", "'2\\*q2' is not a number"),
    "a reversed angle": ([["1", "0", "1", "-1*q2"]], "mm, deg", "is not a number"),
    "a division by zero": ([["1", "pi/0", "1", "0"]], "mm, deg", "alpha of row 1: 'pi/0' is not a number"),
    "a huge number": ([[10**400, 0, 1, 0]], "mm, deg", "is not a number"),
    "a long name": ([{"a" + " " * 9000 + "!": 1}], "mm, deg", "name the columns a, alpha"),
    "half of the units": (
        IN_SI,
        {"angle": "rad"},
        "the columns a, alpha, d, theta of the table have no units",
    ),
    "names of the other convention": (
        [{"a_{i-1}": 1.0, "alpha_{i-1}": 0.0, "d_i": 0.0, "theta_i": 0.0}],
        "mm, deg",
        "belong to the modified convention",
    ),
    "five columns": ([[1.0, 2.0, 3.0, 4.0, 5.0]], None, r"1 rows of \[5\] cells, but 4 columns have names"),
    "a column r, which is a in some tables and d in others": (
        [{"theta": 0.0, "d": 1.0, "r": 0.0, "alpha": 0.0}],
        "mm, deg",
        "the column 'r' of the table is unknown",
    ),
}


@pytest.mark.parametrize("form", REFUSED)
def test_a_table_that_is_not_certain_is_refused_with_a_remedy(form):
    rows, units, reason = REFUSED[form]
    columns = None if has_names(rows) else PLAIN
    with pytest.raises(js.CampaignError, match=reason):
        js.robot(rows, convention="standard", columns=columns, units=units)


@pytest.mark.parametrize(
    ("source", "arguments"),
    [
        ("UR5e", {"convention": "modified"}),
        ("UR5e", {"flange": "tool0"}),
        ({"name": "a", "model": {"format": "catalogue", "arm": "UR5e"}}, {"units": "mm, deg, N"}),
        ("<robot/>", {"units": "mm, deg, N"}),
        ("UR5e", {"columns": PLAIN}),
        (ROWS, {"convention": "standard", "base": "world"}),
        (ROWS, {"convention": "standard", "flange": "tool0"}),
    ],
)
def test_an_argument_that_does_not_concern_the_source_is_refused(source, arguments):
    with pytest.raises(js.CampaignError, match="has no meaning for"):
        js.robot(source, **arguments)


@pytest.mark.parametrize("joint_map", ["fanuc", [1, -1, 1]])
def test_a_joint_map_of_another_kind_is_refused(joint_map):
    with pytest.raises(js.CampaignError, match="joint_map"):
        js.robot("UR5e", joint_map=joint_map)


def test_offsets_of_a_joint_map_in_degrees_are_refused():
    joint_map = {"matrix": np.eye(3).tolist(), "offset": [0, 90, 0]}
    robot = js.robot(ROWS, convention="standard", columns=PLAIN, units="mm, deg", joint_map=joint_map)
    with pytest.raises(
        RobotError, match=r"the offset of joint 2 is 90 rad, but this number seems to be in degrees"
    ):
        prepare_robot(robot)


@pytest.mark.parametrize("rows", [[], pd.DataFrame({"a": [], "alpha": [], "d": [], "theta": []})])
def test_a_table_without_rows_is_refused(rows):
    with pytest.raises(js.CampaignError, match=r"names of the columns are neither|has 0 rows"):
        js.robot(rows, convention="standard", units="mm, deg")


@pytest.mark.parametrize("source", [None, 3])
def test_what_is_no_table_and_no_file_is_refused_with_what_to_give(source):
    with pytest.raises(js.CampaignError, match="describes no robot; remedy: give a file, the name of an arm"):
        js.robot(source, convention="standard", units="mm, deg")


PRINTED_ORDERS = (
    "theta d a alpha",
    "a alpha d theta",
    "alpha a theta d",
    "alpha a d theta",
    "d theta a alpha",
    "theta alpha a d",
)
"""Orders in which textbooks and makers print tables."""
ARMS = [arm.name for arm in catalogue().arms][:10]


def printed(arm, order):
    """Return the table of an arm in mm and degrees, its columns in an order, and the arm's model."""
    model = next(each for each in catalogue().arms if each.name == arm).model
    sizes = {"a": 1e3, "d": 1e3, "alpha": 180.0 / math.pi, "theta": 180.0 / math.pi}
    table = [[getattr(row, name) * sizes[name] for name in order.split()] for row in model.rows]
    return table, model


@pytest.mark.parametrize("order", PRINTED_ORDERS)
@pytest.mark.parametrize("arm", ARMS)
def test_a_table_in_any_order_is_read_by_its_names_and_refused_without(arm, order):
    """Sixty tables: with names or `columns` each gives the arm, without them none is accepted."""
    table, wanted = printed(arm, order)
    named = pd.DataFrame(table, columns=order.split())
    for rows, columns in ((named, None), (table, order), (np.array(table), order.split())):
        model = js.robot(rows, convention=wanted.convention, columns=columns, units="mm, deg").model
        for row, expected in zip(model.rows, wanted.rows, strict=True):
            assert (row.a, row.alpha, row.d, row.theta) == pytest.approx(
                (expected.a, expected.alpha, expected.d, expected.theta), abs=1e-12
            )
    for rows in (table, np.array(table), pd.DataFrame(table)):
        with pytest.raises(
            js.CampaignError, match="names of the columns are neither in the table nor in `columns`"
        ) as refused:
            js.robot(rows, convention=wanted.convention, units="mm, deg")
        assert "columns='theta d a alpha'" in refused.value.problem.remedy


@pytest.mark.parametrize(
    ("columns", "convention", "reason"),
    [
        ("theta d a", "standard", "the table has no column alpha"),
        ("theta d a a", "standard", "the table has two columns a"),
        ("theta d a beta", "standard", "the column 'beta' of the table is unknown"),
        ("theta [deg], d [mm], a, alpha", "standard", "the columns a, alpha of the table have no units"),
        ("theta d a alpha lower", "standard", "but 5 columns have names"),
    ],
)
def test_columns_that_are_not_certain_are_refused(columns, convention, reason):
    width = 3 if columns == "theta d a" else 4
    with pytest.raises(js.CampaignError, match=reason):
        js.robot(
            [[90.0, 100.0, 200.0, 0.0][:width]],
            convention=convention,
            columns=columns,
            units=None if "[" in columns else "mm, deg",
        )


@pytest.mark.parametrize("rows", [pd.DataFrame(reordered(ROWS)), [DhRow(**row) for row in reordered(IN_SI)]])
def test_columns_of_a_table_with_names_are_refused(rows):
    with pytest.raises(
        js.CampaignError, match="names of the columns are given twice: by `columns` and by the table"
    ):
        js.robot(rows, convention="standard", columns=PLAIN, units="mm, deg")


def test_a_length_in_a_column_of_angles_is_refused_when_the_robot_is_prepared():
    with pytest.raises(RobotError, match=r"19.5477 rad is not a finite number within"):
        prepare_robot(
            js.robot([[1120, 0, 0, 0]], convention="standard", columns="theta d a alpha", units="mm, deg")
        )


def test_limits_need_a_unit_as_the_other_columns_do():
    rows = pd.DataFrame(reordered(ROWS, ["theta [rad]", "d [m]", "a [m]", "alpha [rad]"])).assign(upper=3.1)
    with pytest.raises(js.CampaignError, match="the columns upper of the table have no units"):
        js.robot(rows, convention="standard")
