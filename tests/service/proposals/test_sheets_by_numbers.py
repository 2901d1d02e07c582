"""Sheets of a workbook that a proposal reads: those whose numbers fit the robot, whatever their names."""

import pytest
from support.strange_files import JOINTS, both, digits, judge, simulate
from support.workbooks import workbook_of_sheets

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
    (folder / "a.xlsx").write_bytes(workbook_of_sheets(**sheets))
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


# ---- a workbook of joints, and another with a sheet for each state

TIMED = [*HEADER, "Messdauer [s]"]
AFTER = UNLOADED + 0.01


def readings_of(positions):
    return [TIMED, *([*row, 2] for row in numbers(positions))]


def propose_states(folder, names, positions=(UNLOADED, LOADED, AFTER)):
    sheets = {name: readings_of(own) for name, own in zip(names, positions, strict=True)}
    (folder / "joints.xlsx").write_bytes(workbook_of_sheets(Achsen=POSTURES))
    (folder / "leica.xlsx").write_bytes(workbook_of_sheets(**sheets))
    return js.read(folder / "joints.xlsx", folder / "leica.xlsx", robot=ARM, **STATED)


@pytest.mark.parametrize(
    "names",
    [
        ("1 vorher ohne Last", "2 Last", "3 nachher ohne Last"),
        ("unbelastet", "belastet", "danach"),
        ("before", "under load", "afterwards"),
        ("No load", "Load", "No load afterwards"),
        ("sin carga antes", "con carga", "sin carga después"),
    ],
)
def test_a_sheet_after_unloading_is_told_by_its_name(names, tmp_path):
    answer = propose_states(tmp_path, names).accept()
    assert answer.states == ["unloaded", "loaded", "unloaded_after"]
    document = answer.measurement_set.model_dump(mode="json")
    assert judge(CAMPAIGN, document) == []
    after = [each["readings"][0]["unloaded_after"] for each in document["observations"]]
    assert after == [pytest.approx(position, abs=1e-3) for position in AFTER.tolist()]


def test_after_with_a_load_is_the_loaded_state(tmp_path):
    answer = propose_states(tmp_path, ("vorher ohne Last", "nachher mit Last"), (UNLOADED, LOADED)).accept()
    assert answer.states == ["unloaded", "loaded"]
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_after_without_load_is_never_read_as_loaded(tmp_path):
    """The sheets are in another order, and two states are not three."""
    names = "nachher ohne Last", "mit Last", "vorher ohne Last"
    answer = propose_states(tmp_path, names, (AFTER, LOADED, UNLOADED)).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_sheets_of_timed_readings_are_no_postures(tmp_path):
    """The times of ten points are no joints, so that three sheets of points are no three postures."""
    answer = propose_states(tmp_path, ("Tabelle1", "Tabelle2", "Tabelle3")).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []
