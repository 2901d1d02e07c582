"""Columns of a table in another order than stated: the error names the order, and this order works."""

import math
import re

import pytest

import jointstiff as js
from jointstiff.service.conversion.catalogue import catalogue

ROWS = [
    [0, 0, 780, 0],
    [330, -90, 0, -90],
    [1120, 0, 0, 0],
    [60, -90, 1310, 0],
    [0, 90, 0, 0],
    [0, -90, 240, 180],
]
"""a [mm], alpha [°], d [mm], theta [°]."""
PLAIN = "a alpha d theta"
IN_M = [[1e-3 * a, math.radians(alpha), 1e-3 * d, math.radians(theta)] for a, alpha, d, theta in ROWS]
SMALL = [[0.1 * a, alpha, 0.1 * d, theta] for a, alpha, d, theta in ROWS]
WORDS = [[str(a), f"{alpha}°", str(d), "θ"] for a, alpha, d, _ in ROWS]
ORDERS = (
    "theta d a alpha",
    "a alpha d theta",
    "alpha a theta d",
    "alpha a d theta",
    "d theta a alpha",
    "theta alpha a d",
)
"""Orders in which textbooks and makers print tables."""


def read(rows, columns, units="mm, deg"):
    return js.robot(rows, columns=columns, convention="modified", units=units).model


@pytest.mark.parametrize(
    ("rows", "columns", "units", "reason"),
    [
        (ROWS, "theta d a alpha", None, "theta of row 3 is 1120°, beyond a turn"),
        (ROWS, "d theta alpha a", "mm, deg", "alpha of row 1 is 780°, beyond a turn"),
        (IN_M, "theta d a alpha", "m, rad", "the numbers of the column d, 0.0, -1.57"),
        (SMALL, "theta d a alpha", "mm, deg", "the numbers of the column d, 0, -90, 0, -90"),
        (WORDS, "theta d a alpha", "mm, deg", "theta of row 3 is 1120°, beyond a turn"),
        (WORDS[4:], "theta d a alpha", "mm, deg", "d of row 1: '90°' is not a number: it is an angle"),
    ],
)
def test_another_order_than_stated_is_refused_and_the_named_order_works(rows, columns, units, reason):
    with pytest.raises(js.CampaignError) as refused:
        read(rows, columns, units)
    problem = refused.value.problem
    assert problem.detail.startswith(reason)
    assert problem.where == "robot.columns"
    assert problem.remedy == (
        "compare the order with the head of the table: columns='a alpha d theta' fits, as columns 1 and 3 "
        "look like lengths, 2 and 4 like angles"
    )
    assert len(read(rows, "a alpha d theta", units).rows) == len(rows)


def test_angles_in_degrees_that_are_stated_in_rad_are_refused_and_the_named_unit_works():
    rows = [[1e-3 * a, alpha, 1e-3 * d, theta] for a, alpha, d, theta in ROWS]
    with pytest.raises(js.CampaignError, match="alpha of row 2 is -90 rad, beyond a turn") as refused:
        read(rows, PLAIN, "m, rad")
    assert refused.value.problem.remedy == "state units='m, deg', which fits every angle"
    assert read(rows, PLAIN, "m, deg") == read(ROWS, PLAIN)


def test_a_number_that_fits_in_no_order_is_named_in_the_units_of_the_call():
    rows = [[0, 0, 780, 0], [330, -917, 0, -917]]
    with pytest.raises(js.CampaignError, match="alpha of row 2 is -917°, beyond a turn") as refused:
        read(rows, PLAIN)
    assert "columns='a alpha d theta', units='mm, deg'" in refused.value.problem.remedy


def test_columns_with_names_are_checked_in_their_units():
    names = PLAIN.split()
    table = [dict(zip(names, row, strict=True)) for row in ROWS]
    with pytest.raises(js.CampaignError, match=r"a of row 2 is 330 m, beyond ±100 m.*units='mm, deg'"):
        js.robot(table, convention="modified", units="m, deg")
    exchanged = [{**row, "theta": row["a"], "a": row["theta"]} for row in table]
    with pytest.raises(js.CampaignError, match="theta of row 3 is 1120 deg, beyond ±360 deg"):
        js.robot(exchanged, convention="modified", units="mm, deg")


SIZES = {"a": 1e3, "d": 1e3, "alpha": 180.0 / math.pi, "theta": 180.0 / math.pi}


@pytest.mark.parametrize("arm", catalogue().arms, ids=lambda arm: arm.name)
def test_tables_of_makers_in_another_printed_order_are_refused_with_their_order(arm):
    """Of all pairs of printed orders that exchange lengths and angles, three of four are refused."""
    named, accepted = [], 0
    for order in ORDERS:
        rows = [[getattr(row, name) * SIZES[name] for name in order.split()] for row in arm.model.rows]
        for stated in ORDERS:
            lengths = [[name in {"a", "d"} for name in names.split()] for names in (order, stated)]
            if lengths[0] == lengths[1]:
                continue
            try:
                js.robot(rows, columns=stated, convention=arm.model.convention, units="mm, deg")
                accepted += 1
            except js.CampaignError as error:
                named.append(re.search("columns='([^']*)' fits", error.problem.remedy)[1] == order)
    assert all(named)
    assert len(named) >= 3 * accepted
