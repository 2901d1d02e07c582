"""Tables side by side in one sheet, each with its own labels, beside a sheet of joints."""

import pytest
from support.strange_files import JOINTS, digits, joint_rows, judge, names, shuffled, simulate, table
from support.workbooks import workbook_of_sheets

import jointstiff as js
from jointstiff.service.importing.grid import looks_like_a_number

ARM = "FANUC M-20iD/25"
CAMPAIGN = simulate(ARM, seed=4, postures=9)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}
FORCE = {"force": [0, 0, -981], "units": {"force": "N"}}
MISSING = 5, 1  # posture and target without a reading


def rows_of_state(state, targets=("L", "P"), order=None):
    """Return label, target and position [mm] of each reading; one reading is empty."""
    positions = 1e3 * (CAMPAIGN.loaded if state else CAMPAIGN.unloaded)
    return [
        [
            names(CAMPAIGN)[posture],
            name,
            *(["", "", ""] if (posture, k) == MISSING else digits(positions[posture, k])),
        ]
        for posture in (range(len(CAMPAIGN.joints)) if order is None else order)
        for k, name in enumerate(targets)
    ]


def beside(first, second, words=("Bez zátěže", "Zátěž 100 kg"), gap=1):
    """Return rows with both tables side by side below their titles, with a column of remarks."""
    header = ["Poloha", "Odražeč", "X", "Y", "Z"]
    empty = [""] * gap
    rows = [[words[0], *[""] * 4, *empty, words[1], *[""] * 4, "Poznámka"], [*header, *empty, *header, ""]]
    for one, other in zip(first, second, strict=True):
        rows.append([*one, *empty, *other, "" if one[2] else "paprsek přerušen"])
    return rows


def workbook(**sheets):
    return workbook_of_sheets(
        **{name: [list(map(number, row)) for row in rows] for name, rows in sheets.items()}
    )


def number(cell):
    """Return a text that is a number as a number, and None for an empty text."""
    return float(cell) if looks_like_a_number(cell) else cell or None


def propose(content, folder, name="mereni.xlsx", **stated):
    path = folder / name
    path.write_bytes(content)
    return js.read(path, robot=ARM, **STATED, **stated)


def assert_read(answer):
    """Assert that all readings are right, and one of target P is missing."""
    document = answer.measurement_set.model_dump(mode="json")
    assert len(document["observations"][MISSING[0]]["readings"]) == 1
    assert judge(CAMPAIGN, document) == ["17 of 18 readings"]


JOINT_SHEET = [["Poloha", *JOINTS], *joint_rows(CAMPAIGN)]


@pytest.mark.parametrize("gap", [0, 1, 2])
def test_two_tables_side_by_side_are_read_with_the_sheet_of_joints(gap, tmp_path):
    rows = beside(rows_of_state(0), rows_of_state(1), gap=gap)
    answer = propose(workbook(Měření=rows, Klouby=JOINT_SHEET), tmp_path).accept()
    assert [each.sheet for each in answer.files] == ["Měření Bez zátěže", "Měření Zátěž 100 kg", "Klouby"]
    assert_read(answer)


def test_tables_side_by_side_with_their_rows_in_other_orders_are_joined_by_labels(tmp_path):
    rows = beside(rows_of_state(0), rows_of_state(1, order=shuffled(CAMPAIGN, 3)))
    answer = propose(workbook(Měření=rows, Klouby=JOINT_SHEET), tmp_path).accept()
    assert_read(answer)


def test_joints_and_readings_side_by_side_in_a_text_are_read(tmp_path):
    blocks = [CAMPAIGN.unloaded[:, 0], CAMPAIGN.loaded[:, 0]]
    rows = [
        [*q, "", *(cell for block in blocks for cell in (label, *digits(1e3 * block[posture]), ""))]
        for posture, (label, q) in enumerate(zip(names(CAMPAIGN), joint_rows(CAMPAIGN), strict=True))
    ]
    header = ["Pose", *JOINTS, "", *["Pose", *"XYZ", ""] * 2]
    titles = ["Joints", *[""] * 7, "unloaded", *[""] * 4, "loaded", *[""] * 4]
    content = table(titles, [header, *rows]).encode()
    answer = propose(content, tmp_path, "all.csv", **FORCE).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_a_target_whose_name_is_a_word_for_a_state_is_numbered(tmp_path):
    """`L` is short for loaded in a header, and left in a column of reflectors."""
    rows = beside(rows_of_state(0), rows_of_state(1))
    answer = propose(workbook(Měření=rows, Klouby=JOINT_SHEET), tmp_path).accept()
    assert answer.targets == ["T1", "T2"]


def test_targets_below_an_unknown_header_are_found_where_a_row_is_missing(tmp_path):
    rows = [row for row in rows_of_state(0, ("A", "B")) if row[2]]
    header = ["Pose", "Which one", "X", "Y", "Z"]
    loaded = [row for row in rows_of_state(1, ("A", "B")) if row[2]]
    content = workbook(unloaded=[header, *rows], loaded=[header, *loaded], Klouby=JOINT_SHEET)
    answer = propose(content, tmp_path, **FORCE).accept()
    assert answer.targets == ["A", "B"]
    assert_read(answer)
