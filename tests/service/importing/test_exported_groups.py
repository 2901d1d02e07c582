"""Exports of points whose whole names are in one column, with collection, group and target between `::`."""

import pytest
from support.importing_samples import JOINTS as FILE_OF_JOINTS
from support.importing_samples import points_of, read, refusals
from support.strange_files import JOINTS, both, digits, judge, names, simulate, table, wide

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=4, postures=12)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}
REMARK = "// ASCII export   Working frame: A::Tracker_0 (AT960)   Units: Millimeters\n"


def write_points(header, groups, remark=REMARK):
    rows = []
    for state, group in enumerate(groups):
        for target in range(3):
            positions = both(CAMPAIGN, target)[state]
            rows += [
                [f"Halle_4::{group}::{name}_SMR{target + 1}", *digits(position), "11.03.2025 08:42:22"]
                for name, position in zip(names(CAMPAIGN), positions, strict=True)
            ]
    return remark + header + table([], rows, ", ")


def propose(points, folder, **stated):
    (folder / "points.txt").write_text(points)
    (folder / "joints.csv").write_text(table(["label", *JOINTS], wide(CAMPAIGN)))
    return js.read(folder / "points.txt", folder / "joints.csv", robot=ARM, **STATED, **stated)


@pytest.mark.parametrize(
    "groups", [("unbelastet", "belastet_150kg"), ("0kg", "150 kg"), ("no_load", "150kg")]
)
@pytest.mark.parametrize("last", ["Target", "Point Name"])
def test_groups_of_whole_names_are_states_and_loads(groups, last, tmp_path):
    header = f"// Collection::Group::{last}, X, Y, Z, Timestamp\n"
    answer = propose(write_points(header, groups), tmp_path).accept()
    assert answer.missing == []
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []
    readings = answer.measurement_set.observations[0].readings
    assert {reading.target for reading in readings} == {"SMR1", "SMR2", "SMR3"}
    assert answer.measurement_set.units.force == "kgf"
    assert answer.measurement_set.observations[0].force == (0.0, 0.0, -150.0)


EXPORT = "// Working frame: A::R0   Units: {unit}\n// Collection::Group::Target, X, Y, Z\n"
POINTS = "A::c01 unloaded::P10, 1, 2, 4.5\nA::c01 loaded::P10, 1, 2, 4\n"
TEMPLATE = {"point_name": "{any}::{label} {state}::{target}"}


@pytest.mark.parametrize(("unit", "size"), [("Millimeters", 1.0), ("mm, deg", 1.0), ("Inches", 25.4)])
def test_a_comment_on_all_units_is_the_unit_of_positions(unit, size):
    imported = read(("a.txt", EXPORT.format(unit=unit) + POINTS), **TEMPLATE)
    assert points_of(imported)["c01", "P10", "unloaded"] == pytest.approx((size, 2 * size, 4.5 * size))
    assert "positions are in the frame 'A::R0', as the file states" in imported.preview.files[0].assumptions


@pytest.mark.parametrize(
    "remark", ["Deflection units: mm", "Units: mm; last column in m", "Units of loads: mm"]
)
def test_a_comment_on_some_units_leaves_the_question(remark):
    text = f"// {remark}\n// Collection::Group::Target, X, Y, Z\n" + POINTS
    (refusal,) = refusals(("a.txt", text), ("joints.csv", FILE_OF_JOINTS), **TEMPLATE)
    assert "have no unit" in refusal


def test_units_in_a_comment_never_contradict_headers():
    text = "// Units: Inches\nCollection::Group::Target, X [mm], Y [mm], Z [mm]\n" + POINTS
    found = refusals(("a.txt", text), ("joints.csv", FILE_OF_JOINTS), **TEMPLATE)
    assert "'Inches' is given here, but lengths are in mm" in found[0]
