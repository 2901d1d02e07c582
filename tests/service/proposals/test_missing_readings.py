"""Readings that are missing: a proposal names and omits them; damaged numbers are errors."""

from itertools import product

import numpy as np
import pytest
from support.strange_files import JOINTS, digits, joint_rows, places, simulate, table

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=12)
STATED = {
    "encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm",
    "force": [0, 0, -900], "units": {"force": "N"},
}  # fmt: skip
HEADER = ["Pose", *(f"{joint} [deg]" for joint in JOINTS), "Condition", "SMR", "X", "Y", "Z"]


def list_rows():
    """Return a row for each posture, state and target, in turn."""
    rows = []
    for number, row in enumerate(joint_rows(CAMPAIGN)):
        for state, word in enumerate(("free", "loaded")):
            for target in (0, 1):
                place = places(CAMPAIGN, target, state)[number]
                rows.append([*row, word, f"B{target + 1}", *digits(place)])
    return rows


def read(folder, rows, header=HEADER, **stated):
    (folder / "a.csv").write_text(table(header, rows))
    return js.read(folder / "a.csv", robot=ARM, **(STATED | stated))


def count_readings(proposed):
    return sum(len(each.readings) for each in proposed.accept().measurement_set.observations)


@pytest.mark.parametrize("mark", ["", "n/a", "beam lost"])
def test_a_reading_without_numbers_is_named_in_the_proposal_and_left_out(mark, tmp_path):
    rows = list_rows()
    rows[7][-3:] = [mark] * 3
    proposed = read(tmp_path, rows)
    assert "1 reading is missing or incomplete (P02: target B2 was read only unloaded; skipped)" in str(
        proposed
    )
    assert count_readings(proposed) == 23


@pytest.mark.parametrize("number", [7, 20])
def test_a_row_that_is_missing_is_a_missing_reading(number, tmp_path):
    rows = list_rows()
    del rows[number]
    proposed = read(tmp_path, rows)
    assert "1 reading is missing or incomplete" in str(proposed)
    assert count_readings(proposed) == 23


def list_rows_with_forces():
    """Return a row for each posture, state and target, with the force of the posture under load."""
    rows = []
    for number, row in enumerate(joint_rows(CAMPAIGN)):
        for state, target in product((0, 1), (0, 1)):
            force = digits([0.0, 0.0, -state * (900.0 + 35.0 * number)])
            rows.append([*row, f"B{target + 1}", *force, *digits(places(CAMPAIGN, target, state)[number])])
    return rows


@pytest.mark.parametrize("number", [None, 0, 7, 20, 22])
def test_a_size_of_force_in_one_posture_is_the_load_of_all_its_targets(number, tmp_path):
    rows = list_rows_with_forces()
    if number is not None:
        del rows[number]
    header = [*HEADER[:7], "SMR", "Fx [N]", "Fy [N]", "Fz [N]", "X", "Y", "Z"]
    proposed = read(tmp_path, rows, header, force=None)
    assert ("1 reading is missing or incomplete" in str(proposed)) == (number is not None)
    forces = [each.force[2] for each in proposed.accept().measurement_set.observations]
    np.testing.assert_allclose(forces, [-900.0 - 35.0 * number for number in range(12)])
    assert count_readings(proposed) == (24 if number is None else 23)


def test_digits_that_are_no_number_are_an_error(tmp_path):
    rows = list_rows()
    rows[7][-1] = rows[7][-1].replace(".", ".1.")
    with pytest.raises(js.CampaignError, match="is no number"):
        read(tmp_path, rows)


def test_most_readings_of_a_target_are_never_left_out(tmp_path):
    rows = [row for number, row in enumerate(list_rows()) if number % 4 != 3 or number < 12]
    with pytest.raises(js.CampaignError):
        read(tmp_path, rows)


def test_a_remark_behind_the_last_column_omits_no_row(tmp_path):
    header = [*HEADER[:7], *(f"{axis} {word} [mm]" for word in ("free", "loaded") for axis in "XYZ")]
    pairs = zip(joint_rows(CAMPAIGN), places(CAMPAIGN), places(CAMPAIGN, 0, 1), strict=True)
    rows = [[*row, *digits(free), *digits(loaded)] for row, free, loaded in pairs]
    rows[0].append("shaky")
    readings = read(tmp_path, rows, header=["Nr", *header[1:]])
    assert len(readings.accept().measurement_set.observations) == 12
