"""Files as instruments, controllers and metrologists write them become the campaign that was measured."""

import json
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from support.command_lines import assert_said, refused, typed
from support.measured_arms import TRACKER
from support.strange_files import (
    FORMS,
    GERMAN,
    JOINTS,
    both,
    deflection,
    digits,
    in_turn,
    joints,
    judge,
    names,
    places,
    points,
    simulate,
    table,
    wide,
)

from jointstiff.schemas.imports import FilePreview
from jointstiff.service.cli import imports

ARMS = ("KUKA KR 210 R2700 extra", "Universal Robots UR10e", "Yaskawa GP25", "FANUC M-20iD/25")
STATED = "--encoders motor --load-point 0,0,120"
FORCE = "--force 0,0,-981 --units force=N"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def write(files):
    for name, text in files.items():
        Path(name).write_text(text)
    return " ".join(files)


def line(files, arm, more=FORCE):
    return f"import {write(files)} --robot '{arm}' {STATED} {more} --yes -o c.json"


def read_set():
    return json.loads(Path("c.json").read_text())["measurement_set"]


@pytest.mark.parametrize("name", FORMS)
def test_one_proposal_gives_the_measured_campaign(name):
    form = FORMS[name]
    arm = ARMS[list(FORMS).index(name) % len(ARMS)]
    campaign = simulate(arm, seed=1000 + len(name), postures=14)
    typed(line(form.write(campaign), arm, f"{FORCE if form.states_force else ''} {form.options}"))
    assert judge(campaign, read_set(), form.load_count) == []


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("rows_of_files_in_other_orders", "rows of the files joined by their names"),
        ("units_and_other_columns", "not read: RMS [mm], Temp [°C], RMS' [mm]"),
        (
            "displacements_in_micrometres_without_units",
            "dX, dY, dZ in µm added to the positions without load",
        ),
        ("a_file_in_metres_and_one_in_millimetres", "the other positions of loaded.txt converted from mm"),
        ("a_force_along_z_alone", "only the force along z has a column: along x and y it is 0"),
        ("repeats_with_a_number", "the mean of repeated readings"),
        ("loads_in_headers", "each load is an observation, with the same readings without load"),
    ],
)
def test_a_proposal_says_what_it_did_with_rows_and_columns(name, said):
    form = FORMS[name]
    campaign = simulate(ARMS[0], seed=3, postures=14)
    shown = typed(line(form.write(campaign), ARMS[0], FORCE if form.states_force else ""))
    assert_said(shown, said, "wrote c.json")


def repeat_a_row(rows):
    return [*rows[:1], rows[0], *rows[1:]]


def move_a_repeat(rows):
    return [*rows[:1], [*rows[0][:-1], f"{float(rows[0][-1]) + 3.0}"], *rows[1:]]


@pytest.mark.parametrize(
    ("change", "more", "said"),
    [
        (repeat_a_row, "", "has this row twice"),
        (move_a_repeat, "--mean-of-repeats", "repeated readings are 1.5 mm from their mean"),
    ],
)
def test_a_row_too_many_is_named_and_without_it_the_file_is_read(change, more, said):
    campaign = simulate(ARMS[0], seed=5, postures=14)
    header = ["Pose", *JOINTS, "Zustand", *"XYZ"]
    rows = in_turn(campaign, ("unbelastet", "belastet"), both(campaign))
    assert said in refused(line({"a.csv": table(header, change(rows))}, ARMS[0], f"{FORCE} {more}"))
    typed(line({"a.csv": table(header, rows)}, ARMS[0]))
    assert judge(campaign, read_set(), 1) == []


def test_a_missing_row_is_a_missing_reading_that_the_proposal_names():
    campaign = simulate(ARMS[0], seed=5, postures=14)
    header = ["Pose", *JOINTS, "Zustand", *"XYZ"]
    rows = in_turn(campaign, ("unbelastet", "belastet"), both(campaign))
    shown = typed(line({"a.csv": table(header, [*rows[:5], *rows[6:]])}, ARMS[0], FORCE))
    assert_said(shown, "P03: target T1 was read only unloaded; skipped")
    assert len(read_set()["observations"]) == 13
    assert judge(campaign, read_set(), 1)[:-1] == []  # the last is the reading that is left out


def test_a_name_of_json_that_is_too_long_is_refused():
    campaign = simulate(ARMS[0], seed=5, postures=14)
    headers = [*JOINTS, *"XYZ", "n" * 300]
    rows = [[*row[1:], "0"] for row in wide(campaign, places(campaign))]
    lines = "".join(json.dumps(dict(zip(headers, row, strict=True))) + "\n" for row in rows)
    said = refused(line({"a.jsonl": lines}, ARMS[0]))
    assert "a name has more than 256 characters" in said
    assert "shorten the name" in said


def test_repeats_below_the_loaded_rows_are_not_read_after_unloading():
    campaign = simulate(ARMS[1], seed=3, postures=14)
    typed(line(FORMS["repeats_with_the_loaded_ones_first"].write(campaign), ARMS[1]))
    readings = [each for one in read_set()["observations"] for each in one["readings"]]
    assert len(readings) == 14
    assert all(each.get("unloaded_after") is None for each in readings)


def test_the_preview_shows_the_files_as_they_are_written():
    campaign = simulate(ARMS[0], seed=3, postures=14)
    shown = typed(line(FORMS["times_and_an_operator"].write(campaign), ARMS[0]))
    assert_said(shown, "log.csv: utf-8, comma between cells", "Operator", "ignored", "T1 x")


# ---- nothing of a file is left out in silence


def write_parts(campaign, loaded):
    """Write joints, positions without load and `loaded` rows as three files without headers."""
    parts = {
        "j.txt": [row[1:] for row in wide(campaign)],
        "u.txt": [digits(each) for each in places(campaign)],
        "l.txt": loaded,
    }
    return {name: table([], rows, " ") for name, rows in parts.items()}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda rows: rows[:-1], "'l.txt' is not read: it has 13 rows for 14 postures"),
        (
            lambda rows: rows[::-1],
            "'l.txt' is not read: its numbers are no positions in the postures",
        ),
    ],
    ids=["a row less", "another order"],
)
def test_a_file_that_is_not_read_is_refused(change, said):
    campaign = simulate(ARMS[1], seed=4, postures=14)
    files = write_parts(campaign, change([digits(each) for each in places(campaign, 0, 1)]))
    assert_said(refused(line(files, ARMS[1])), said, "remedy:")
    assert not Path("c.json").exists()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("notes.txt", "hall 3, Monday\n"),
        ("README.md", "# Test\n\n- `q` (14, 6) deg\n- a mass of 5 kg hangs at (0, 0, 120) mm\n"),
        ("LEEME.txt", "ensayo del 3 de julio\n  angulos  14x6\n  pesa de 3 kg en la brida\n"),
    ],
)
def test_a_text_in_words_is_left_out_by_name_and_its_load_is_read(name, text):
    campaign = simulate(ARMS[1], seed=4, postures=14)
    files = write_parts(campaign, [digits(each) for each in places(campaign, 0, 1)])
    assert_said(
        typed(line(files | {name: text}, ARMS[1])), f"{name} has no rows of numbers, and was left out"
    )
    assert judge(campaign, read_set()) == []
    if "kg" in text:
        assert_said(refused(line(files | {name: text}, ARMS[1], "")), f"'{name}' says", "kg")


@pytest.mark.parametrize(
    "text",
    ["point 1 at 12.5\n" * 9, "1 100\n2 200\n3 300\n4 400\n5 500\n", "load;mass\nL1;5\nL2;10\n"],
    ids=["decimals", "numbers", "cells"],
)
def test_a_text_with_readings_that_are_no_rows_is_refused(text):
    campaign = simulate(ARMS[1], seed=4, postures=14)
    files = write_parts(campaign, [digits(each) for each in places(campaign, 0, 1)])
    assert_said(refused(line(files | {"more.txt": text}, ARMS[1])), "more.txt has no rows of numbers")


def test_columns_that_may_be_the_loaded_positions_are_not_dropped():
    campaign = simulate(ARMS[2], seed=4, postures=14)
    rows = [row[1:] for row in wide(campaign, places(campaign), deflection(campaign))]
    shown = refused(line({"dx.txt": table([], rows, " ")}, ARMS[2]))
    assert_said(shown, "column 10, column 11, column 12 of 'dx.txt' are not read")


def test_a_posture_without_a_row_in_another_file_is_named_and_left_out():
    campaign = simulate(ARMS[2], seed=4, postures=14)
    header = ["Pose", "X", "Y", "Z"]
    loaded = [row for row in points(campaign, 1) if row[0] != "P04"]
    files = {
        "achsen.csv": joints(campaign, label="Pose"),
        "ohne_last.csv": table(header, points(campaign, 0)),
        "mit_last.csv": table(header, loaded),
    }
    shown = typed(line(files, ARMS[2], FORCE))
    assert_said(shown, "P04: target T1 was read only unloaded; skipped")
    assert_said(shown, "P04: no reading is complete; the observation was skipped")
    assert len(read_set()["observations"]) == 13
    assert judge(campaign, read_set())[:-1] == []  # the last is the reading that is left out


@pytest.mark.parametrize("target", [0, 2])
@pytest.mark.parametrize("joint_files", ["own file", "each file"])
@pytest.mark.parametrize("lack", [[], [["P04", *6 * [""]]]], ids=["no row", "empty row"])
def test_a_posture_that_one_target_lacks_keeps_its_other_readings(target, joint_files, lack):
    """Each target has its own file, with the positions in both states."""
    campaign = simulate(ARMS[2], seed=4, postures=14)
    header = ["Pose", *(f"{state} {axis}" for state in GERMAN for axis in "XYZ")]
    points = [[digits([*u, *w]) for u, w in zip(*both(campaign, each), strict=True)] for each in range(3)]
    of_targets = [[[name, *row] for name, row in zip(names(campaign), each, strict=True)] for each in points]
    of_targets[target][3:4] = lack
    files = {"achsen.csv": joints(campaign, label="Pose")}
    if joint_files == "each file":
        header, files = [*header, *JOINTS], {}
        angles = {name: digits(q) for name, q in zip(names(campaign), campaign.joints, strict=True)}
        of_targets = [[[*row, *angles[row[0]]] for row in each] for each in of_targets]
    files |= {f"T{number}.csv": table(header, each) for number, each in enumerate(of_targets, start=1)}
    shown = typed(line(files, ARMS[2]))
    assert_said(shown, f"P04: the cells of target T{target + 1} are empty; skipped")
    assert "left out" not in shown
    read = {o["label"]: {each["target"] for each in o["readings"]} for o in read_set()["observations"]}
    assert read.pop("P04") == {"T1", "T2", "T3"} - {f"T{target + 1}"}
    assert list(read.values()) == 13 * [{"T1", "T2", "T3"}]


def test_sheets_are_no_files_and_the_sheet_of_successive_columns_is_named_once():
    campaign = simulate(ARMS[2], seed=4, postures=14)
    book = openpyxl.Workbook()
    book.remove(book.active)
    for state, title in enumerate(("ohne Last", "mit Last")):
        sheet = book.create_sheet(title)
        sheet.append(["Pose", *JOINTS, *(f"{target} {axis}" for target in ("M1", "M2") for axis in "XYZ")])
        for row in wide(campaign, places(campaign, 0, state), places(campaign, 1, state)):
            sheet.append([row[0], *map(float, row[1:])])
    book["mit Last"].delete_rows(5)
    book.save("a.xlsx")
    shown = typed(f"import a.xlsx --robot '{ARMS[2]}' {STATED} {FORCE} --yes -o c.json")
    assert_said(
        shown,
        "a.xlsx, ohne Last columns 2–7 as J1…J6 [deg], 8–10 as M1 unloaded [mm], 11–13 as M2 unloaded [mm], "
        "a.xlsx, mit Last 8–10 as M1 loaded [mm] and 11–13 as M2 loaded [mm]",
        "rows of the tables joined by their names",
        f"not read: a.xlsx, mit Last {', '.join(JOINTS)}",
        "P04: target M1 was read only unloaded; skipped, P04: target M2 was read only unloaded; skipped",
    )


def test_a_block_without_a_reading_is_named_and_one_without_joints_is_refused_at_its_line():
    campaign = simulate(ARMS[3], seed=4, postures=14)
    files = FORMS["a_block_for_each_posture"].write(campaign)
    lines = files["postures.txt"].splitlines()
    without_reading, without_joints = ([*lines[:gone], *lines[gone + 1 :]] for gone in (10, 8))
    shown = typed(line({"postures.txt": "\n".join(without_reading) + "\n"}, ARMS[3], FORCE))
    assert_said(shown, "Posture 2: target T1 was read only unloaded; skipped")
    shown = refused(line({"postures.txt": "\n".join(without_joints) + "\n"}, ARMS[3]))
    assert_said(shown, "'postures.txt', line 9: this block has 4 rows of numbers, and the others have 5")


# ---- what a person states


def write_unknown(campaign, *blocks):
    """Write a table with the headers K1 to K6, then A, B, … for x, y and z of each block of positions."""
    headers = [f"K{number}" for number in range(1, 7)]
    axes = [f"{letter}{axis}" for letter, _ in zip("ABC", blocks, strict=False) for axis in "xyz"]
    return {"a.csv": table(["Pose", *headers, *axes], wide(campaign, *blocks))}


def test_stated_columns_decide_which_positions_are_loaded():
    campaign = simulate(ARMS[0], seed=5, postures=14)
    files = write_unknown(campaign, places(campaign, 0, 1), places(campaign))
    stated = [
        f"--column '{letter}{axis}=P1 {state} {axis} [mm]'"
        for letter, state in (("A", "loaded"), ("B", "unloaded"))
        for axis in "xyz"
    ]
    typed(line(files, ARMS[0], " ".join(["--force 0,0,981 --units force=N", *stated])))
    assert judge(campaign, read_set()) == []


def test_ignored_columns_are_no_positions():
    campaign = simulate(ARMS[1], seed=5, postures=14)
    files = write_unknown(campaign, places(campaign), places(campaign, 0, 1), places(campaign, 1))
    typed(line(files, ARMS[1], f"{FORCE} --ignore 'C*'"))
    assert judge(campaign, read_set()) == []


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("--ignore Cx", "`--ignore` names the header 'Cx', but no file has this header"),
        ("--column 'Cx=P1 loaded x'", "`--column` names the header 'Cx', but no file has this header"),
        (
            " ".join(f"--column 'A{axis}=P1 unloaded {axis} [m]'" for axis in "xyz"),
            "`--column` states that 'Ax' is P1 unloaded x [m], but by the robot it is P1 unloaded x [mm]",
        ),
        (
            "--column 'K2=J1 [deg]'",
            "states that 'K2' is J1 [deg], but by the robot it is J2 [deg]",
        ),
    ],
)
def test_a_statement_that_does_not_hold_is_refused(option, said):
    campaign = simulate(ARMS[2], seed=5, postures=14)
    files = write_unknown(campaign, places(campaign), places(campaign, 0, 1))
    assert_said(refused(line(files, ARMS[2], f"{FORCE} {option}")), said, "remedy:")
    assert not Path("c.json").exists()


def test_one_force_for_several_loads_is_refused():
    campaign = simulate(ARMS[3], seed=6, postures=14)
    shown = refused(line(FORMS["loads_in_headers"].write(campaign), ARMS[3]))
    assert_said(shown, "there are readings under 50 kg and 100 kg, and `--force` states one force for all")


def test_displacements_that_may_be_in_two_units_need_a_unit():
    campaign = simulate(ARMS[3], seed=6, postures=14)
    rows = wide(campaign, places(campaign), 20.0 * deflection(campaign))
    files = {"dx.csv": table(["Pose", *JOINTS, "X", "Y", "Z", "dX", "dY", "dZ"], rows)}
    assert_said(refused(line(files, ARMS[3])), "so that their unit is not clear", "such as `dX [µm]`")


def test_a_template_keeps_what_was_stated_of_columns():
    campaign = simulate(ARMS[0], seed=7, postures=14)
    form = FORMS["displacements_with_a_stated_header"]
    typed(line(form.write(campaign), ARMS[0], f"{FORCE} {form.options} --save-template t.json"))
    next_day = simulate(ARMS[0], seed=8, postures=12)
    files = write(form.write(next_day))
    typed(f"import {files} --robot '{ARMS[0]}' --template t.json -o c.json --overwrite")
    assert judge(next_day, read_set()) == []


def test_names_of_all_joints_of_a_maker_need_no_proposal():
    campaign = simulate(ARMS[2], seed=9, postures=14)
    headers = [
        "label",
        *(f"{letter}-axis [deg]" for letter in "SLURBT"),
        *(f"T1 {state} {axis} [mm]" for state in ("unloaded", "loaded") for axis in "xyz"),
    ]
    files = {"a.csv": table(headers, wide(campaign, places(campaign), places(campaign, 0, 1)))}
    shown = typed(line(files, ARMS[2]))
    assert " fit the " not in shown
    assert judge(campaign, read_set()) == []


# ---- one question, then the proposal


def answer(monkeypatch, text, answers):
    monkeypatch.setattr(imports, "is_terminal_input", lambda: True)
    return typed(text.replace(" --yes", ""), input="".join(f"{each}\n" for each in answers))


NAMES_OF_ALL = ["Pose", *(f"{joint} [deg]" for joint in JOINTS)]
NAMES_OF_ALL += [f"P10 {state} {axis} [mm]" for state in ("unloaded", "loaded") for axis in "xyz"]


@pytest.mark.parametrize("forces", [["Fx [N]", "Fy [N]", "Fz [N]"], ["Fx", "Fy", "Fz"]])
def test_names_that_say_everything_leave_the_frame_to_the_robot(monkeypatch, forces):
    campaign = simulate(ARMS[0], seed=12, postures=14)
    turned = [each @ TRACKER + [300.0, -200.0, 800.0] for each in both(campaign)]
    rows = [[*row[:7], "0", "0", "-981", *row[7:]] for row in wide(campaign, *turned)]
    files = {"named.csv": table([*NAMES_OF_ALL[:7], *forces, *NAMES_OF_ALL[7:]], rows)}
    has_unit = "[" in forces[0]
    shown = answer(monkeypatch, line(files, ARMS[0], ""), ["", "", "", "", ""][has_unit:])
    asked = "Unit of forces (N, daN, kN, kgf, lbf) [N]:"
    assert_said(shown, *([] if has_unit else [asked]), "in a frame of the instrument fit", "Take it? [Y/n]")
    assert_said(shown, "wrote c.json, a campaign")
    document = read_set()
    read = [each["readings"][0] for each in document["observations"]]
    shifts = [np.subtract(each["loaded"], each["unloaded"]) for each in read]
    assert {each["target"] for each in read} == {"P10"}
    assert np.abs(np.array(shifts) - deflection(campaign)).max() < 0.005
    assert [each["force"] for each in document["observations"]] == [[0.0, 0.0, -981.0]] * 14


def write_unknown_words(campaign):
    rows = in_turn(campaign, ("weg", "dran"), both(campaign))
    return {"a.csv": table(["Pose", *JOINTS, "Gewichtsstein", *"XYZ"], rows)}


def test_two_words_that_nobody_knows_are_one_question(monkeypatch):
    campaign = simulate(ARMS[1], seed=13, postures=14)
    command = line(write_unknown_words(campaign), ARMS[1], "")
    assert_said(refused(command), "may be words for states", "`--force`", "`--state-word`")
    shown = answer(monkeypatch, command, ["", "", "0,0,-981 N", *[""] * 5])
    assert_said(shown, "'weg' and 'dran' may be words for states", "(weg, dran) [weg]:", "Take it? [Y/n]")
    assert judge(campaign, read_set()) == []


def test_a_stated_force_answers_what_two_words_mean():
    campaign = simulate(ARMS[1], seed=13, postures=14)
    shown = typed(line(write_unknown_words(campaign), ARMS[1]))
    assert_said(shown, "'weg' is unloaded and 'dran' is loaded", "move along `--force`")
    assert judge(campaign, read_set()) == []


@pytest.mark.parametrize("sign", [1, -1])
def test_a_force_of_constant_size_needs_no_header(sign):
    campaign = simulate(ARMS[1], seed=14, postures=14)
    shifts = deflection(campaign)
    forces = sign * 500.0 * shifts / np.linalg.norm(shifts, axis=1)[:, None]
    rows = [row[1:] for row in wide(campaign, forces, places(campaign), places(campaign, 0, 1))]
    text = line({"a.txt": table([], rows, " ")}, ARMS[1], "--units force=N")
    if sign < 0:  # a force against which the targets move is no force on the robot
        assert_said(refused(text), "information is missing: the force")
        return
    assert_said(typed(text), "columns 7–9 as the force: its size is constant", "wrote c.json")
    read = [each["force"] for each in read_set()["observations"]]
    assert np.abs(np.array(read) - forces).max() < 1e-3


def test_states_that_only_their_order_gives_must_agree_with_the_force():
    campaign = simulate(ARMS[1], seed=10, postures=14)
    rows = [row[1:] for row in wide(campaign, places(campaign, 0, 1), places(campaign))]
    files = {"a.txt": table([], rows, " ")}
    assert_said(refused(line(files, ARMS[1])), "but the targets then move against `--force`", "`--header`")
    headers = ";".join([*JOINTS, *(f"{axis}_{state}" for state in ("mit", "ohne") for axis in "XYZ")])
    typed(line(files, ARMS[1], f"{FORCE} --header '{headers}'"))
    assert judge(campaign, read_set()) == []


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (0, 2, 1)])
def test_nominal_positions_without_a_header_are_no_third_state(order):
    campaign = simulate(ARMS[1], seed=10, postures=14)
    scatter = np.random.default_rng(4).normal(0.0, 0.5, (14, 3))
    blocks = [places(campaign), places(campaign, 0, 1), places(campaign) + scatter]
    rows = [row[1:] for row in wide(campaign, *(blocks[number] for number in order))]
    assert_said(
        refused(line({"a.txt": table([], rows, " ")}, ARMS[1])), "so that headers must name the states"
    )


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ({"file": "a.ods", "format": "xlsx", "sheet": "s"}, "OpenDocument, sheet 's', 0 rows"),
        ({"file": "a.xlsx", "format": "xlsx"}, "Excel, 0 rows"),
        ({"file": "a.json", "format": "text", "decimal_mark": "point"}, "decimal point, 0 rows"),
        ({"file": "a.script", "format": "text"}, "0 rows"),
        ({"file": "a.md", "format": "text", "encoding": "utf-8", "delimiter": "tab"}, "utf-8, Markdown, "),
        (
            {"file": "a.md", "format": "text", "encoding": "utf-8", "delimiter": "comma"},
            "utf-8, comma between",
        ),
    ],
)
def test_the_format_of_a_file_has_the_words_of_its_owner(file, words):
    assert imports._describe_format(FilePreview.model_validate(file)).startswith(words)


def test_a_table_of_several_files_names_no_delimiter_that_they_do_not_have():
    campaign = simulate(ARMS[1], seed=4, postures=14)
    files = {"j.csv": table(["pose", *JOINTS], [[n, *q] for n, (_, *q) in enumerate(wide(campaign), 1)], ",")}
    for number in range(14):
        rows = [[f"T{k + 1}", *digits(places(campaign, k)[number])] for k in range(3)]
        files[f"pose{number + 1:02}_noload.csv"] = table(["target", *"XYZ"], rows, ",")
        rows = [[f"T{k + 1}", *digits(places(campaign, k, 1)[number])] for k in range(3)]
        files[f"pose{number + 1:02}_6kg.csv"] = table(["target", *"XYZ"], rows, ",")
    assert "semicolon" not in typed(line(files, ARMS[1]))
