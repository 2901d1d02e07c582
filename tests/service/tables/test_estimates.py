"""Estimates for people: one form, with the digits that the interval allows, dimmed if not to be used."""

import math

import pytest

from jointstiff.schemas.robot import Estimate
from jointstiff.schemas.run import JointResult
from jointstiff.service.tables.estimate import (
    estimate_columns,
    half_width,
    percent_text,
    show_cell,
    show_estimate,
    width_cell,
)
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.service.tables.table import Column, Line, Table, as_line


def joint(compliance, interval, **changes):
    """A joint with a compliance and its interval; if this begins at zero, the joint has a lower limit."""
    at_least = 1.0 / interval[1] if interval and interval[0] == 0.0 else None
    fields = {
        "name": "joint_1",
        "status": "identified",
        "verdict": "use",
        "reason": None,
        "compliance": compliance,
        "standard_uncertainty": 1e-8,
        "compliance_interval": interval,
        "stiffness": 1.0 / compliance if compliance else None,
        "stiffness_interval": None,
        "stiffness_at_least": at_least,
    }
    return JointResult.model_validate(fields | changes)


@pytest.mark.parametrize(
    ("value", "ends", "text"),
    [
        (3.0741, (2.9731, 3.1822), "3.074 (2.973 … 3.182)"),
        (1.23e6, (1.2e6, 1.3e6), "1230000 (1200000 … 1300000)"),
        (0.00006, (0.0, 0.0277), "0.000 (0.000 … 0.028)"),
        (0.5, (0.43, None), "0.500 (0.430 … no limit)"),
        (2.0, (2.0, 2.0), "2 (2 … 2)"),
        (2.0, None, "2 (no interval)"),
        (None, None, "—"),
    ],
)
def test_a_number_has_its_interval_behind_it_with_the_digits_that_the_interval_allows(value, ends, text):
    assert show_estimate(value, ends).cell.text == text


@pytest.mark.parametrize(
    ("compliance", "interval", "stiffness"),
    [
        (4e-7, (3.7e-7, 4.3e-7), "2.500 (2.326 … 2.703)"),
        (0.0, (0.0, 5e-7), "> 2"),
        (1e-7, (0.0, 5e-7), "> 2"),
        (2e-7, (-1e-7, 5e-7), "5.0 (not -10.0 … 2.0)"),
        (-2e-7, (-3e-7, -1e-7), "-5.00 (-10.00 … -3.33)"),
        (2e-7, None, "5 (no interval)"),
        (None, None, "—"),
    ],
    ids=["usual", "rigid", "open", "may be negative", "negative", "no uncertainty", "unseen"],
)
def test_a_joint_has_a_number_with_its_interval_or_a_limit(compliance, interval, stiffness):
    shown = joint(compliance, interval)
    assert UNITS["MNm/rad"].show_joint(shown).cell.text == stiffness


def test_a_joint_that_must_not_be_used_is_dim_and_gives_no_limit():
    refuted = joint(4e-7, (3.8e-7, 4.2e-7), verdict="do_not_use")
    shown = UNITS["MNm/rad"].show_joint(refuted)
    assert shown.cell == Line("2.500 (2.381 … 2.632)", "dim")
    assert (shown.value_cell.style, shown.interval_cell.style) == ("dim", "dim")
    for compliance in (0.0, 1e-7):
        without_limit = joint(compliance, (0.0, 5e-7), verdict="do_not_use")
        assert UNITS["MNm/rad"].show_joint(without_limit).cell == Line("—", "dim")


def test_a_prismatic_joint_has_its_own_unit_behind_the_number():
    rail = joint(4e-8, (3.8e-8, 4.2e-8), kind="prismatic")
    shown = UNITS["MNm/rad"].show_joint(rail)
    assert shown.value_cell.text == "25.00 N/µm"
    assert shown.interval_cell.text == "23.81 … 26.32"


def test_a_relative_number_and_a_half_width_are_at_95_percent():
    assert percent_text(Estimate(value=-0.1, standard_uncertainty=0.012)) == "-10.0 % (-12.4 … -7.6 %)"
    assert percent_text(Estimate(value=-0.1, standard_uncertainty=None)) == "-10 %"
    assert half_width(0.1, 100.0) == "± 20"
    assert half_width(None) is None
    assert math.isclose(float(half_width(1.0, form=".6g").removeprefix("± ")), 1.95996)


def test_a_table_for_the_page_has_each_number_in_its_parts():
    """The page prints numbers by its own component: value, interval and width are apart."""
    estimates = [
        UNITS["MNm/rad"].show_joint(joint(1 / 3e6, (1 / 3.3e6, 1 / 2.7e6))),
        UNITS["MNm/rad"].show_joint(joint(0.0, (0.0, 1e-6), verdict="use_with_care")),
        UNITS["MNm/rad"].show_joint(joint(None, None)),
    ]
    columns = [
        Column("joint", ["joint_1", "joint_2", "joint_3"], text=True),
        Column("both", estimates, show_cell),
        *estimate_columns("apart", estimates, 0.95),
        Column("plan", [width_cell("± 15 %", 0.15), None, None], as_line),
    ]
    shown = {
        (row, column): [
            (*(each[name] for name in ("value", "interval", "limit")), each["relative"]) for each in numbers
        ]
        for row, column, numbers in Table(columns).shown()["numbers"]
    }
    assert shown == {
        (0, 1): [("3.00", "2.70 … 3.30", "", pytest.approx(0.1))],
        (0, 2): [("3.00", "", "", pytest.approx(0.1))],
        (0, 3): [("", "2.70 … 3.30", "", None)],
        (0, 4): [("± 15 %", "", "", 0.15)],
        (1, 1): [("rigid", "", "> 1", None)],
        (1, 2): [("rigid", "", "> 1", None)],
    }
