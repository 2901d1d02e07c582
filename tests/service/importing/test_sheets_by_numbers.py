"""Sheets of a workbook that a proposal reads: those whose numbers fit the robot, whatever their names."""

import pytest
from support.strange_files import JOINTS, both, digits, simulate
from support.workbooks import workbook

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=12)
UNLOADED, LOADED = both(CAMPAIGN)
STATED = {
    "encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm",
    "force": [0, 0, -900], "units": {"force": "N"},
}  # fmt: skip


def numbers(rows):
    return [[f"P{number}", *map(float, digits(row))] for number, row in enumerate(rows, 1)]


def build(**sheets):
    def add(book, first):
        for name, rows in sheets.items():
            sheet = book.create_sheet(name)
            for row in rows:
                sheet.append(row)
        book.remove(first)

    return workbook([["x"]], add)


POSTURES = [["Pose", *(f"{joint} (deg)" for joint in JOINTS)], *numbers(CAMPAIGN.joints)]
HEADER = ["Pose", "X (mm)", "Y (mm)", "Z (mm)"]
FREE, HUNG = [HEADER, *numbers(UNLOADED)], [HEADER, *numbers(LOADED)]
READINGS = [
    ["Pose", "Condition", "X (mm)", "Y (mm)", "Z (mm)"],
    *([row[0], "free", *row[1:]] for row in FREE[1:]),
    *([row[0], "loaded", *row[1:]] for row in HUNG[1:]),
]
RESULTS = [["axis", "k", "low", "high"], *([f"A{n}", 1.5 * n, 1.4 * n, 1.6 * n] for n in range(1, 6))]


def propose(folder, **sheets):
    (folder / "a.xlsx").write_bytes(build(**sheets))
    return js.read(folder / "a.xlsx", robot=ARM, **STATED)


@pytest.mark.parametrize(
    ("sheets", "said"),
    [
        ({"Poses": POSTURES, "Readings": READINGS}, "sheets 'Poses', 'Readings' read"),
        ({"Axes": POSTURES, "Empty cell": FREE, "With load": HUNG}, "'Axes', 'Empty cell', 'With load' read"),
        (
            {"Poses": POSTURES, "Readings": READINGS, "Results": RESULTS},
            "sheets 'Poses', 'Readings' read, not 'Results'",
        ),
    ],
)
def test_sheets_are_told_by_their_numbers_and_named_in_the_proposal(sheets, said, tmp_path):
    proposed = propose(tmp_path, **sheets)
    assert said in str(proposed)
    assert len(proposed.accept().measurement_set.observations) == len(CAMPAIGN.joints)


def test_a_sheet_that_may_have_readings_is_never_left_out(tmp_path):
    again = [HEADER, *numbers(LOADED[::-1] - [0.0, 3.0, 1.0])]
    with pytest.raises(js.CampaignError, match="Second day"):
        propose(tmp_path, Poses=POSTURES, Readings=READINGS, **{"Second day": again})


def group(positions):
    """Return the rows of three targets in each posture, as a tracker's software writes them."""
    rows = [
        [f"P{posture}", f"N{target}", *map(float, digits(1e3 * place))]
        for posture, places in enumerate(positions, 1)
        for target, place in enumerate(places, 1)
    ]
    return [["Group", "Name", "X (mm)", "Y (mm)", "Z (mm)"], *rows]


@pytest.mark.parametrize("missing", [(), (5,), (5, 20)])
def test_groups_of_points_in_sheets_of_states_are_postures_even_if_points_are_missing(missing, tmp_path):
    loaded = [row for number, row in enumerate(group(CAMPAIGN.loaded)) if number not in missing]
    sheets = {"Joints": POSTURES, "Unloaded": group(CAMPAIGN.unloaded), "Loaded 0.9 kN": loaded}
    proposed = propose(tmp_path, **sheets)
    assert "sheets 'Joints', 'Unloaded', 'Loaded 0.9 kN' read" in str(proposed)
    readings = [each for row in proposed.accept().measurement_set.observations for each in row.readings]
    assert {each.target for each in readings} == {"N1", "N2", "N3"}
    assert len(readings) == 3 * len(CAMPAIGN.joints) - len(missing)
