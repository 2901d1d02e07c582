"""Forms of one posture each, in sheets or in blocks of a sheet, are read as a table with a row for each."""

import io
from itertools import chain

import openpyxl
import pytest
from support.strange_files import JOINTS, judge, simulate

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=10)
STATED = {
    "encoders": "motor", "load_point": [0, 0, 120], "force": [0, 0, -981], "units": {"force": "N"},
    "length_unit": "mm",
}  # fmt: skip


def places_of(posture, target):
    """Return x, y and z without and under load [mm], to 0.1 µm."""
    return [
        [round(1e3 * float(each), 4) for each in positions[posture, target]]
        for positions in (CAMPAIGN.unloaded, CAMPAIGN.loaded)
    ]


def angles_of(posture):
    return [round(float(each), 4) for each in CAMPAIGN.joints[posture]]


def write_form(posture, *, states=("ohne Last", "mit Last")):
    """Return the rows of a form: joints below each other, targets as rows, states as groups of columns."""
    joints = [[f"A{number}", angle] for number, angle in enumerate(angles_of(posture), 1)]
    targets = [[f"T{k + 1}", *chain.from_iterable(places_of(posture, k))] for k in range(3)]
    return [
        ["Messprotokoll", "Halle 3", None, "Blatt", posture + 1],
        [],
        ["Achse", "Winkel [°]"],
        *joints,
        [],
        ["Marke", states[0], None, None, states[1]],
        [None, *(f"{axis} [mm]" for axis in "XYZ"), *(f"{axis} [mm]" for axis in "XYZ")],
        *targets,
    ]


def write_block(posture):
    """Return the rows of a block: a title, joints in a row, and a row for each target and state."""
    rows = [
        [f"T{k + 1}", state, *places]
        for k in range(2)
        for state, places in zip(("sem carga", "com carga"), places_of(posture, k), strict=True)
    ]
    return [
        [f"Postura {posture + 1}"],
        ["Eixos (°)", *JOINTS],
        [None, *angles_of(posture)],
        ["Alvo", "Condição", "X (mm)", "Y (mm)", "Z (mm)"],
        *rows,
        [],
    ]


def workbook(sheets):
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    content = io.BytesIO()
    book.save(content)
    return content.getvalue()


def write_sheets(change=lambda _posture, rows: rows):
    info = {"Info": [["Roboter", "KR 210"], ["Gewicht", "100 kg"]]}
    return info | {f"Pose {k + 1:02}": change(k, write_form(k)) for k in range(len(CAMPAIGN.joints))}


def write_blocks():
    blocks = [row for posture in range(len(CAMPAIGN.joints)) for row in write_block(posture)]
    return {"Ensaio": [["Ensaio de rigidez"], ["Carga: 20 kg"], [], *blocks]}


def propose(sheets, folder, **options):
    path = folder / "forms.xlsx"
    path.write_bytes(workbook(sheets))
    return js.read(path, robot=ARM, **STATED, **options)


@pytest.mark.parametrize("write", [write_sheets, write_blocks])
def test_forms_of_postures_are_read_as_one_table(write, tmp_path):
    answer = propose(write(), tmp_path).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []
    assert answer.states == ["unloaded", "loaded"]
    assert "10 forms were read as postures" in answer.files[0].assumptions


@pytest.mark.parametrize("gap", [[], [[]]])
def test_fields_of_two_texts_in_a_form_are_no_groups_of_its_columns(gap, tmp_path):
    def add_fields(posture, rows):
        joints = [["Giunti [°]", *JOINTS], [None, *angles_of(posture)]]
        return [
            ["Posizione", posture + 1],
            ["Robot", "KR-210"],
            ["Carico", "12 kg"],
            *gap,
            *joints,
            *rows[9:],
        ]

    answer = propose(write_sheets(add_fields), tmp_path).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_a_sheet_that_is_no_form_is_named(tmp_path):
    answer = propose(write_sheets(), tmp_path).accept()
    assert "the sheet 'Info' has no table, and was not read" in answer.files[0].assumptions


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda rows: [*rows[:6], *rows[7:]], "the form 'Pose 05' lacks 'A4 [°]'"),
        (
            lambda rows: [*rows, ["T9", *[1.5] * 6]],
            "the form 'Pose 05' has, unlike other forms, 'T9 ohne Last X [mm]'",
        ),
    ],
)
def test_a_form_with_other_numbers_is_refused(change, reason, tmp_path):
    with pytest.raises(js.CampaignError) as refused:
        propose(write_sheets(lambda k, rows: change(rows) if k == 4 else rows), tmp_path)
    assert reason in str(refused.value.problem)


def test_states_follow_the_words_of_the_forms_wherever_their_columns_are(tmp_path):
    def exchange(_posture, rows):
        exchanged = [row if len(row) < 7 else [row[0], *row[4:7], *row[1:4]] for row in rows]
        return [
            ["Marke", "mit Last", None, None, "ohne Last"] if row[:1] == ["Marke"] else row
            for row in exchanged
        ]

    answer = propose(write_sheets(exchange), tmp_path).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


@pytest.mark.parametrize("hidden", [1, 3])
@pytest.mark.parametrize("marks", [None, ["-"] * 6 + ["hidden"], ["NaN"] * 6])
def test_a_form_that_lacks_a_target_is_read_without_that_target(hidden, marks, tmp_path):
    def hide(k, rows):
        if k != 4:
            return rows
        return [
            row if row[:1] != [f"T{hidden}"] else [*row[:1], *marks]
            for row in rows
            if marks or row[:1] != [f"T{hidden}"]
        ]

    answer = propose(write_sheets(hide), tmp_path, allow_missing=True).accept()
    readings = [len(each.readings) for each in answer.measurement_set.observations]
    assert readings == [2 if k == 4 else 3 for k in range(10)]


def write_note(posture, order=(0, 1)):
    """Return the text of a file of one posture: joints in one line, and a small table for each state."""
    angles = "; ".join(f"J{axis} = {angle:.3f}" for axis, angle in enumerate(angles_of(posture), 1))
    lines = [f"Positie: {posture + 1}", "Datum: 03-10-2023", f"Hoeken (graden): {angles}"]
    for state in order:
        lines += ["", ("Zonder gewicht", "Met gewicht 100 kg")[state], "\tX [mm]\tY [mm]\tZ [mm]"]
        for target in range(3):
            place = places_of(posture, target)[state]
            lines.append("\t".join([f"kogel {target + 1}", *(f"{each:.3f}" for each in place)]))
    return "\n".join(lines).replace(".", ",") + "\n"


def write_notes(folder, order):
    paths = [folder / f"positie_{posture + 1:02}.txt" for posture in range(len(CAMPAIGN.joints))]
    for posture, path in enumerate(paths):
        path.write_text(write_note(posture, order), encoding="utf-8")
    return paths


def test_notes_of_one_posture_in_each_file_are_read_as_one_text(tmp_path):
    answer = js.read(*write_notes(tmp_path, (0, 1)), robot=ARM, **STATED).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_notes_under_load_first_are_never_read_as_unloaded(tmp_path):
    with pytest.raises(js.CampaignError, match="the targets then move against `force`"):
        js.read(*write_notes(tmp_path, (1, 0)), robot=ARM, **STATED)


def test_notes_of_which_one_lacks_a_table_are_no_campaign(tmp_path):
    paths = write_notes(tmp_path, (0, 1))
    paths[4].write_text(write_note(4, (0,)), encoding="utf-8")
    with pytest.raises(js.CampaignError):
        js.read(*paths, robot=ARM, **STATED)
