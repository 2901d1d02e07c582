"""Files that a stranger keeps: notes, logs, displacements, a file for each posture, words for states.

Each form has other forms of the same cause next to it; one proposal reads all of them.
"""

import re
from contextlib import suppress

import numpy as np
import pytest
from support.measured_arms import TRACKER
from support.strange_files import (
    JOINTS,
    both,
    deflection,
    digits,
    in_turn,
    joint_rows,
    joints,
    judge,
    names,
    places,
    points,
    simulate,
    table,
    wide,
)

import jointstiff as js
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grid import split_line
from jointstiff.service.importing.texts.joint_states import read_joint_states

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=14)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "units": {"force": "N"}, "length_unit": "mm"}
FORCE = {"force": [0, 0, -981]}
WIDE = wide(CAMPAIGN, *both(CAMPAIGN))
HEADERS = ["Pose", *JOINTS, *(f"{axis} {state}" for state in ("unloaded", "loaded") for axis in "XYZ")]
TABLE = table(HEADERS, WIDE)
COUNT = len(WIDE)


def propose(files, folder, **stated):
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return js.read(*(folder / name for name in files), robot=ARM, **(STATED | FORCE | stated))


def read(files, folder, **stated):
    proposed = propose(files, folder, **stated)
    answer = proposed.accept() if hasattr(proposed, "accept") else proposed
    assert answer.missing == []
    return answer.measurement_set.model_dump(mode="json")


def assert_read(files, folder, **stated):
    assert judge(CAMPAIGN, read(files, folder, **stated)) == []


def refuse(files, folder, **stated):
    with pytest.raises(js.CampaignError) as error:
        propose(files, folder, **stated)
    return error.value.problem


# ---- quotation marks that enclose no cell


def blocks_below_titles():
    parts = [
        "Notebook, page 3",
        'SMR 1.5"',
        "",
        "Joints",
        table(JOINTS, [row[1:] for row in joint_rows(CAMPAIGN)]),
    ]
    for state, title in enumerate(("unloaded", 'loaded (hook 2" ring)')):
        parts += [title, table(["X", "Y", "Z"], [row[1:] for row in points(CAMPAIGN, state)])]
    return "\n".join(parts)


def add_remark(text):
    rows = [[*row, text if number % 5 == 0 else ""] for number, row in enumerate(WIDE)]
    return table([*HEADERS, "Remark"], rows)


QUOTED = {
    "inches in a title": 'Notebook of 3 March; tool 1.5" ball\nrobot in hall 3\n\n' + TABLE,
    "inches in a remark": add_remark('tool 1.5" SMR'),
    "a mark that begins a title": '"Notebook\n' + TABLE,
    "two marks with commas": 'Tool: SMR 1.5", magnet\nHall 3, cell "B\n' + table(HEADERS, WIDE, ","),
    "marks around a word": add_remark('"B" side'),
    "tabs": 'Ball 1.5"\n' + table(HEADERS, WIDE, "\t"),
    "blanks": 'Ball 1.5" in the "nest\n' + table([each.replace(" ", "_") for each in HEADERS], WIDE, " "),
    "no known header": 'SMR 1.5"\nTool 3"\n' + table(["N", *"abcdefxyzuvw"], WIDE),
    "cells in marks": '"Messung ""Halle 3"""\n'
    + table([], [[f'"{cell}"' for cell in row] for row in (HEADERS, *WIDE)]),
    "blocks": blocks_below_titles(),
}


@pytest.mark.parametrize("form", QUOTED)
def test_a_quotation_mark_in_words_swallows_no_line(form, tmp_path):
    assert_read({"notes.csv": QUOTED[form]}, tmp_path)


def test_an_open_quotation_in_a_row_of_numbers_is_refused(tmp_path):
    rows = [[row[0], *row[1:-1], f'"{row[-1]}'] if number == 4 else row for number, row in enumerate(WIDE)]
    problem = refuse({"notes.csv": table(HEADERS, rows)}, tmp_path)
    assert "quotation marks do not enclose a whole cell" in problem.detail


def test_hostile_marks_end():
    for part in ('"', '"a"";', '";', '"a""";', 'x"'):
        text = (part * 65_000)[:65_000]
        with suppress(ImportFileError):
            split_line("a.csv", 1, text, "semicolon", are_marks_literal=True)


# ---- lists in brackets


def lines(form, first=1):
    """Return a line for each posture, with its number, and its joints and positions as lists."""
    unloaded, loaded = both(CAMPAIGN)
    return "".join(
        form.format(
            n=number,
            q=", ".join(digits(q)),
            u=", ".join(digits(unloaded[number - first])),
            l=", ".join(digits(loaded[number - first])),
        )
        for number, q in enumerate(CAMPAIGN.joints, first)
    )


POSITIONS = {"points.csv": table(["X0", "Y0", "Z0", "X1", "Y1", "Z1"], [row[7:] for row in WIDE])}
LISTED = {
    "index and braces": "{n}: {{{q}}}\n",
    "index and brackets": "{n}: [{q}]\n",
    "a point of a teach pendant": 'P[{n}:"p"] {{ {q} }};\n',
    "an array": "jPos[{n}] = {{{q}}}\n",
    "a name and parentheses": "p{n} = ({q});\n",
    "braces alone": "{{{q}}}\n",
    "a time": "2026-03-01 10:{n}:05 joint {{{q}}}\n",
}
COMPLETE = {
    "three lists": "{n}: {{{q}}} {{{u}}} {{{l}}}\n",
    "words before lists": "{n}: {{{q}}} unloaded {{{u}}} loaded {{{l}}} // hall 3\n",
    "lines of a posture": "Pose {n}\n J: {{{q}}}\n U: {{{u}}}\n L: {{{l}}}\n",
    "a line for each list": "{n}: {{{q}}}\nunloaded: {{{u}}}\nloaded: {{{l}}}\n",
    "states in turn": "{n} loaded: {{{q}}} ; {{{l}}}\n{n} unloaded: {{{q}}} ; {{{u}}}\n",
    "words behind lists": "{n}: {{{q}}} {{{l}}} belastet\n{n}: {{{q}}} {{{u}}} unbelastet\n",
}


@pytest.mark.parametrize("form", LISTED)
def test_lists_in_brackets_are_rows_of_joints(form, tmp_path):
    assert_read({"log.txt": "VAL3 log\n" + lines(LISTED[form]), **POSITIONS}, tmp_path)


def state_log(joints, words=("VIDE", "CHARGE"), first=0):
    """Return a log with a title for each state, and lines of joints and of a reading for each posture."""
    states = (first, 1 - first)
    return "controller and tracker, mm\n" + "".join(
        f"--- {words[state]} ---\n"
        + lines("[{n:02}] " + joints + "\n[{n:02}] LT  " + "ul"[state] + "={{{" + "ul"[state] + "}}}\n")
        for state in states
    )


def write_axes(text):
    """Return a text whose lists of positions are `x=… y=… z=…`."""
    return re.sub(r"[ul]=\{(.*), (.*), (.*)\}", r"x=\1 y=\2 z=\3", text)


BESIDE_READINGS = {
    "a call with braces": "herej() = {{{q}}}",
    "a name with brackets": "q = [{q}]",
    "a name with a colon and parentheses": "joints: ({q})",
    "a unit behind the list": "actual=[{q}] deg",
}


@pytest.mark.parametrize("form", BESIDE_READINGS)
def test_a_list_behind_a_name_has_the_joints_of_the_reading_below(form, tmp_path):
    assert_read({"log.txt": write_axes(state_log(BESIDE_READINGS[form]))}, tmp_path)


def test_a_list_behind_a_name_with_the_loaded_state_first_is_not_read_with_states_exchanged(tmp_path):
    problem = refuse({"log.txt": write_axes(state_log("herej() = {{{q}}}", first=1))}, tmp_path)
    assert "the targets then move against `force`" in problem.detail


def test_a_list_behind_a_name_with_too_few_numbers_is_refused(tmp_path):
    text = write_axes(state_log("herej() = {{{q}}}"))
    place = text.index("{") + 1
    refuse({"log.txt": text[:place] + text[text.index(",", place) + 1 :]}, tmp_path)


@pytest.mark.parametrize("form", COMPLETE)
def test_a_log_of_lists_has_joints_and_positions(form, tmp_path):
    assert_read({"log.txt": lines(COMPLETE[form])}, tmp_path)


def test_a_list_with_decimal_commas_has_semicolons(tmp_path):
    text = lines(COMPLETE["three lists"]).replace(", ", "; ").replace(".", ",")
    assert_read({"log.txt": text}, tmp_path)


def test_a_posture_without_a_list_is_not_left_out(tmp_path):
    text = lines(COMPLETE["a line for each list"]).splitlines()
    refuse({"log.txt": "\n".join([*text[:4], *text[5:]])}, tmp_path)


def test_a_list_with_a_word_in_place_of_a_number_is_not_left_out(tmp_path):
    text = lines("p{n} = ({q}) ({u}) ({l})\n").splitlines()
    damaged = text[3].replace("(", "(x", 1)
    refuse({"log.txt": "\n".join([*text[:3], damaged, *text[4:]])}, tmp_path)


# ---- displacements without positions

PLACE = {"flange_targets": {"T1": [0, 0, 200]}}
MICROMETRES = wide(CAMPAIGN, 1e3 * deflection(CAMPAIGN), count=2)
MILLIMETRES = wide(CAMPAIGN, deflection(CAMPAIGN))
DISPLACED = {
    "µm": (["dX [µm]", "dY [µm]", "dZ [µm]"], MICROMETRES),
    "um": (["dX [um]", "dY [um]", "dZ [um]"], MICROMETRES),
    "unit of the first column": (["dX [um]", "dY", "dZ"], MICROMETRES),
    "slash": (["ΔX/µm", "ΔY/µm", "ΔZ/µm"], MICROMETRES),
    "mm": (["dX [mm]", "dY [mm]", "dZ [mm]"], MILLIMETRES),
    "German": ([f"Verschiebung {axis} [mm]" for axis in "XYZ"], MILLIMETRES),
    "no unit": (["dx", "dy", "dz"], MICROMETRES),
}


@pytest.mark.parametrize("form", DISPLACED)
def test_displacements_alone_need_the_place_of_the_target_only(form, tmp_path):
    headers, rows = DISPLACED[form]
    files = {"dx.csv": table(["Pose", *JOINTS, *headers], rows)}
    proposed = propose(files, tmp_path)
    said = "displacements under load of T1 in axes of R0 without positions, which the robot cannot check"
    assert said in str(proposed)
    assert [*proposed.accept().missing_fields] == ["flange_targets"]
    document = proposed.accept(**PLACE).measurement_set
    read_shifts = np.array([each.readings[0].deflection for each in document.observations])
    assert np.abs(read_shifts - deflection(CAMPAIGN)).max() < 1e-4
    assert np.abs([each.joints for each in document.observations] - CAMPAIGN.joints).max() < 1e-3
    assert document.units.angle == "deg"


def test_displacements_of_several_targets_in_a_file_of_their_own(tmp_path):
    shifts = 1e3 * np.hstack([deflection(CAMPAIGN, 0), deflection(CAMPAIGN, 1)])
    rows = [[name, *digits(row, 2)] for name, row in zip(names(CAMPAIGN), shifts, strict=True)]
    headers = ["Pose", *(f"T{target} d{axis} [um]" for target in (1, 2) for axis in "xyz")]
    files = {"j.csv": joints(CAMPAIGN, label="Pose"), "d.csv": table(headers, rows[::-1])}
    places_of_targets = {"flange_targets": {"T1": [0, 0, 200], "T2": [100, 0, 100]}}
    document = propose(files, tmp_path).accept(**places_of_targets).measurement_set
    read_shifts = [[each.deflection for each in one.readings] for one in document.observations]
    assert np.abs(np.array(read_shifts).reshape(COUNT, 6) - shifts / 1e3).max() < 1e-4


def test_displacements_against_the_force_are_refused(tmp_path):
    files = {"dx.csv": table(["Pose", *JOINTS, "dX [um]", "dY [um]", "dZ [um]"], MICROMETRES)}
    problem = refuse(files, tmp_path, force=[0, 0, 981])
    assert "the targets move against the force" in problem.detail


def test_displacements_need_the_names_of_the_joints(tmp_path):
    headers = ["Pose", *"abcdef", "dX [um]", "dY [um]", "dZ [um]"]
    files = {"dx.csv": table(headers, MICROMETRES)}
    problem = refuse(files, tmp_path)
    assert "without positions, so that the robot cannot find the joints" in problem.detail
    named = propose(files, tmp_path, header=["Pose", *JOINTS, *headers[7:]])
    assert named.accept(**PLACE).missing == []


def test_positions_that_do_not_fit_are_not_left_out_for_displacements(tmp_path):
    generator = np.random.default_rng(0)
    rows = wide(CAMPAIGN, 1e3 * generator.uniform(size=(COUNT, 3)), deflection(CAMPAIGN))
    headers = ["Pose", *JOINTS, "A", "B", "C", "dX [mm]", "dY [mm]", "dZ [mm]"]
    refuse({"dx.csv": table(headers, rows)}, tmp_path)


# ---- a file for each posture and state

STATES = [
    ("unloaded", "loaded"),
    ("unbelastet", "belastet"),
    ("vorher", "nachher"),
    ("before", "after"),
    ("sans_charge", "avec_charge"),
    ("leer", "last"),
    ("0kg", "100kg"),
]


def list_targets(number, state, form="T{k} {x} {y} {z}\n", targets=3):
    cells = [digits(places(CAMPAIGN, target, state)[number]) for target in range(targets)]
    return "".join(form.format(k=k, x=x, y=y, z=z) for k, (x, y, z) in enumerate(cells, 1))


def write_postures(name, content=list_targets, label="{n}", order=range(COUNT), states=(0, 1)):
    files = {name(n, state): content(n, state) for state in states[::-1] for n in range(COUNT)}
    rows = [[label.format(n=n + 1), *digits(CAMPAIGN.joints[n])] for n in order]
    return files | {"joints.csv": table(["Pose", *JOINTS], rows)}


SHUFFLED = np.random.default_rng(2).permutation(COUNT)
HEADED = "Target;X [mm];Y [mm];Z [mm]\n"
POSTURES = {
    **{
        f"{words[1]}": write_postures(
            lambda n, s, words=words: f"pose{n + 1:02}_{words[s]}.txt", label="pose{n:02}"
        )
        for words in STATES
    },
    "other labels in another order": write_postures(
        lambda n, s: f"Stellung_{n + 1}_{STATES[1][s]}.txt", order=SHUFFLED
    ),
    "labels with a letter": write_postures(
        lambda n, s: f"pose{n + 1:02}_{STATES[0][s]}.txt", label="P{n}", order=SHUFFLED
    ),
    "state first": write_postures(lambda n, s: f"{STATES[1][s]}_{n + 1:02}.txt"),
    "no separator": write_postures(lambda n, s: f"Pose{n + 1}{STATES[0][s].capitalize()}.txt"),
    "headers": write_postures(
        lambda n, s: f"pose{n + 1}_{STATES[0][s]}.csv",
        lambda n, s: HEADED + list_targets(n, s, "T{k};{x};{y};{z}\n"),
    ),
    "targets in their order": write_postures(
        lambda n, s: f"pose{n + 1}_{STATES[0][s]}.txt", lambda n, s: list_targets(n, s, "{x} {y} {z}\n")
    ),
    "one target": write_postures(
        lambda n, s: f"pose{n + 1}_{STATES[0][s]}.txt",
        lambda n, s: list_targets(n, s, "X;Y;Z\n{x};{y};{z}\n", 1),
    ),
    "names and values": write_postures(
        lambda n, s: f"pose{n + 1}_{STATES[0][s]}.txt",
        lambda n, s: list_targets(n, s, "T{k}: X={x} Y={y} Z={z}\n"),
    ),
    "both states": write_postures(
        lambda n, _: f"pose{n + 1}.txt",
        lambda n, _: (
            "Target;state;X;Y;Z\n"
            + "".join(list_targets(n, s, f"T{{k}};{STATES[0][s]};{{x}};{{y}};{{z}}\n") for s in (0, 1))
        ),
        states=(0,),
    ),
    "a target in each file": write_postures(
        lambda n, s: f"P{n + 1}_T2_{STATES[1][s]}.txt",
        lambda n, s: list_targets(n, s, "X;Y;Z\n{x};{y};{z}\n", 1),
    ),
}


@pytest.mark.parametrize("form", POSTURES)
def test_files_of_postures_and_states_are_one_table(form, tmp_path):
    assert_read(POSTURES[form], tmp_path)


def write_features(header, form, conditions):
    """Return files of one posture each with rows of both states, whose columns have texts."""
    return write_postures(
        lambda n, _: f"pose{n + 1}.csv",
        lambda n, _: (
            f"{header},X,Y,Z\n"
            + "".join(list_targets(n, s, form.format(state=conditions[s]) + ",{x},{y},{z}\n") for s in (0, 1))
        ),
        states=(0,),
    )


@pytest.mark.parametrize("conditions", [("free", "100kg"), ("no load", "load"), ("unbelastet", "belastet")])
@pytest.mark.parametrize(
    ("header", "form"),
    [
        ("Feature,Condition", "P{{k}},{state}"),
        ("Condition,Feature", "{state},P{{k}}"),
        ("Element,Art,Zustand", "P{{k}},Kugel,{state}"),
    ],
)
def test_names_that_files_of_postures_share_are_targets(header, form, conditions, tmp_path):
    proposed = propose(write_features(header, form, conditions), tmp_path)
    answer = proposed.accept()
    document = answer.measurement_set.model_dump(mode="json")
    assert judge(CAMPAIGN, document) == []
    assert {each["target"] for each in document["observations"][0]["readings"]} == {"P1", "P2", "P3"}
    assert str(proposed).partition("not read: ")[2] == ("pose….csv Art." if "Art" in header else "")


def test_of_several_columns_of_names_none_is_taken_for_the_targets(tmp_path):
    files = write_features("Feature,Element,Condition", "P{{k}},N{{k}},{state}", ("free", "100kg"))
    answer = propose(files, tmp_path).accept()
    assert answer.targets == ["T1", "T2", "T3"]
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_words_of_files_that_nobody_knows_are_one_question(tmp_path):
    files = write_postures(lambda n, s: f"pose{n + 1}_{('weg', 'dran')[s]}.txt")
    problem = refuse(files, tmp_path)
    assert "'weg' may be words for states" in problem.detail
    assert_read(files, tmp_path, state_words={"weg": "unloaded", "dran": "loaded"})


def test_files_of_targets_are_no_postures(tmp_path):
    files = {
        f"T{k + 1}_{STATES[1][s]}.txt": table([], [row[1:] for row in points(CAMPAIGN, s, target=k)], " ")
        for k in range(3)
        for s in (0, 1)
    }
    assert_read(files | {"joints.csv": joints(CAMPAIGN)}, tmp_path)


# ---- words for states, the loaded ones first


WORDS = [
    *STATES,
    ("ohne", "mit"),
    ("vide", "charge"),
    ("avant", "apres"),
    ("off", "on"),
    ("ohne_Gewicht", "mit_Gewicht"),
    ("scarico", "carico"),
    ("entladen", "beladen"),
    ("no_load", "load"),
]


@pytest.mark.parametrize("prefix", ["", "messung_03_"])
@pytest.mark.parametrize("words", WORDS, ids=[words[1] for words in WORDS])
def test_words_in_names_of_files_say_which_state_is_loaded(words, prefix, tmp_path):
    files = {"joints.csv": joints(CAMPAIGN, label="Pose")}
    files |= {f"{prefix}{words[s]}.csv": table(["Pose", *"XYZ"], points(CAMPAIGN, s)) for s in (1, 0)}
    assert_read(files, tmp_path)


@pytest.mark.parametrize("words", WORDS, ids=[words[1] for words in WORDS])
def test_words_in_headers_say_which_state_is_loaded(words, tmp_path):
    headers = ["Pose", *JOINTS, *(f"{words[s]}_{axis}" for s in (1, 0) for axis in "xyz")]
    assert_read({"a.csv": table(headers, wide(CAMPAIGN, *both(CAMPAIGN)[::-1]))}, tmp_path)


UNNAMED = {
    "names of files": {
        "joints.csv": joints(CAMPAIGN, label="Pose"),
        "run_b.csv": table(["Pose", *"XYZ"], points(CAMPAIGN, 1)),
        "run_a.csv": table(["Pose", *"XYZ"], points(CAMPAIGN, 0)),
    },
    "numbers behind axes": {
        "a.csv": table(
            ["Pose", *JOINTS, *["X1", "Y1", "Z1", "X2", "Y2", "Z2"]], wide(CAMPAIGN, *both(CAMPAIGN)[::-1])
        )
    },
    "letters before axes": {
        "a.csv": table(
            ["Pose", *JOINTS, *["aX", "aY", "aZ", "bX", "bY", "bZ"]], wide(CAMPAIGN, *both(CAMPAIGN)[::-1])
        )
    },
    "words of headers": {
        "a.csv": table(
            ["Pose", *JOINTS, *(f"Messung {letter} {axis}" for letter in "AB" for axis in "XYZ")],
            wide(CAMPAIGN, *both(CAMPAIGN)[::-1]),
        )
    },
    "numbers in a column": {
        "a.csv": table(["Pose", *JOINTS, "Step", *"XYZ"], in_turn(CAMPAIGN, "21", both(CAMPAIGN)[::-1]))
    },
}


@pytest.mark.parametrize("form", UNNAMED)
def test_words_that_the_remedy_names_settle_a_move_against_the_force(form, tmp_path):
    problem = refuse(UNNAMED[form], tmp_path)
    assert "the targets then move against `force`" in problem.detail
    found = re.search(r"`state_words`, such as '(\w+)' as `loaded` and '(\w+)' as `unloaded`", problem.remedy)
    loaded, unloaded = found.groups()
    assert_read(UNNAMED[form], tmp_path, state_words={loaded: "loaded", unloaded: "unloaded"})


def test_one_word_for_one_of_two_states_is_enough(tmp_path):
    assert_read(UNNAMED["names of files"], tmp_path, state_words={"b": "loaded"})


# ---- forces


@pytest.mark.parametrize(
    "headers",
    [
        ["F_1", "F_2", "F_3"],
        ["F1 [N]", "F2 [N]", "F3 [N]"],
        ["F[0]", "F[1]", "F[2]"],
        ["Kraft 1", "Kraft 2", "Kraft 3"],
        ["Kraft_x", "Kraft_y", "Kraft_z"],
        ["X_Force", "Y_Force", "Z_Force"],
        ["load x [N]", "load y [N]", "load z [N]"],
        ["Fx_R0", "Fy_R0", "Fz_R0"],
    ],
    ids=lambda headers: headers[0],
)
def test_three_columns_of_a_force_are_its_axes(headers, tmp_path):
    rows = [[*row[:7], "0", "1.5", "-981", *row[7:]] for row in WIDE]
    files = {"a.csv": table([*HEADERS[:7], *headers, *HEADERS[7:]], rows)}
    document = read(files, tmp_path, force=None)
    assert judge(CAMPAIGN, document) == []
    assert [each["force"] for each in document["observations"]] == [[0.0, 1.5, -981.0]] * COUNT


def test_six_numbered_columns_are_no_force(tmp_path):
    rows = [[*row[:7], *"123456", *row[7:]] for row in WIDE]
    files = {"a.csv": table([*HEADERS[:7], *(f"F{n}" for n in range(1, 7)), *HEADERS[7:]], rows)}
    document = read(files, tmp_path)
    assert [each["force"] for each in document["observations"]] == [[0.0, 0.0, -981.0]] * COUNT


# ---- uncertainties

COVERAGE = 1.96


def with_unsure(headers, cells, start=10):
    """Return rows with a cell behind the positions without load, and others behind those under load."""
    names_of_all = ["Pose", *JOINTS, "X0", "Y0", "Z0", *headers[:1], "X1", "Y1", "Z1", *headers[1:]]
    return table(names_of_all, [[*row[:start], *cells[:1], *row[start:], *cells[1:]] for row in WIDE])


def test_an_uncertainty_behind_each_position_is_read(tmp_path):
    document = read({"a.csv": with_unsure(["U95", "U95 "], ["0.030", "0.040"])}, tmp_path)
    expected = np.sqrt((0.03**2 + 0.04**2) / 2.0) / (COVERAGE * np.sqrt(3.0))
    sigmas = [each["readings"][0]["sigma"] for each in document["observations"]]
    np.testing.assert_allclose(sigmas, expected, rtol=1e-3)


@pytest.mark.parametrize(("header", "cell"), [("U95 [mm]", "0.03"), ("U95 [µm]", "30"), ("U(95)", "30")])
def test_an_uncertainty_in_files_of_states_is_read(header, cell, tmp_path):
    files = {"j.csv": joints(CAMPAIGN, label="Pose")}
    for state, name in enumerate(("unloaded", "loaded")):
        rows = [[*row, cell] for row in points(CAMPAIGN, state)]
        files[f"{name}.csv"] = table(["Pose", *"XYZ", header], rows)
    document = read(files, tmp_path)
    sigmas = [each["readings"][0]["sigma"] for each in document["observations"]]
    np.testing.assert_allclose(sigmas, 0.03 / (COVERAGE * np.sqrt(3.0)), rtol=1e-3)


def test_uncertainties_of_coordinates_are_read(tmp_path):
    rows = [[*row, "0.01", "0.02", "0.03"] for row in WIDE]
    headers = ["Pose", *JOINTS, "X0", "Y0", "Z0", "X1", "Y1", "Z1", "U95 x", "U95 y", "U95 z"]
    document = read({"a.csv": table(headers, rows)}, tmp_path)
    expected = np.diag(np.square(np.array([0.01, 0.02, 0.03]) / COVERAGE))
    for each in document["observations"]:
        np.testing.assert_allclose(each["readings"][0]["loaded_covariance"], expected, rtol=1e-3)


def test_uncertainties_of_coordinates_in_another_frame_are_those_of_points(tmp_path):
    turned = [each @ TRACKER + [300.0, -200.0, 800.0] for each in both(CAMPAIGN)]
    rows = [[*row, "0.01", "0.02", "0.02"] for row in wide(CAMPAIGN, *turned)]
    headers = ["Pose", *JOINTS, "X0", "Y0", "Z0", "X1", "Y1", "Z1", "U95 x", "U95 y", "U95 z"]
    document = read({"a.csv": table(headers, rows)}, tmp_path)
    sigmas = [each["readings"][0]["sigma"] for each in document["observations"]]
    np.testing.assert_allclose(sigmas, 0.03 / (COVERAGE * np.sqrt(3.0)), rtol=1e-3)


@pytest.mark.parametrize("headers", [["sigma [mm]", "sigma [mm] "], ["u [mm]", "u [mm] "], ["RMS", "RMS "]])
def test_columns_that_are_no_expanded_uncertainties_are_named(headers, tmp_path):
    proposed = propose({"a.csv": with_unsure(headers, ["0.030", "0.040"])}, tmp_path)
    assert f"not read: {headers[0]}, {headers[0]}" in str(proposed)


def test_an_uncertainty_of_one_of_two_files_is_named(tmp_path):
    files = {
        "j.csv": joints(CAMPAIGN, label="Pose"),
        "unloaded.csv": table(["Pose", *"XYZ", "U95 [mm]"], [[*row, "0.03"] for row in points(CAMPAIGN, 0)]),
        "loaded.csv": table(["Pose", *"XYZ"], points(CAMPAIGN, 1)),
    }
    assert "not read: unloaded.csv U95 [mm]" in str(propose(files, tmp_path))


# ---- messages of ROS


def write_message(number, form="name: [a, b]\nposition: [{n}.5,\n  1.5]\n"):
    return (
        f"header:\n  stamp: {{sec: {number}}}\n  frame_id: ''\n"
        + form.format(n=number)
        + "velocity: []\n---\n"
    )


def test_lists_of_messages_may_have_several_lines():
    found = read_joint_states("".join(map(write_message, range(4))))
    assert found.headers == ("a", "b")
    assert [cells for _, cells in found.rows] == [(f"{number}.5", "1.5") for number in range(4)]
    assert [line for line, _ in found.rows] == [1, 9, 17, 25]


@pytest.mark.parametrize(
    "form",
    [
        "name: &x [a, b]\nposition: [{n}, 1]\n",
        "name: [a, b]\nposition: &p [{n}, 1]\nmore: *p\n",
        "name: [a, b]\nposition: [{n}, 1\n",
        "name: [a, b]\nposition: [{n}, 1]\nx: " + 70_000 * "a" + "\n",
        "name: [a, b]\nposition: [{n}, 1, 2]\n",
    ],
    ids=["anchor", "alias", "damaged", "too long", "more numbers"],
)
def test_messages_with_more_than_lists_are_no_joint_states(form):
    assert read_joint_states("".join(write_message(number, form) for number in range(4))) is None


def test_deep_lists_of_messages_end():
    text = "".join(write_message(number) + "x: " + 20_000 * "[" + "\n---\n" for number in range(4))
    assert read_joint_states(text) is None


# ---- joints in comments


def write_commented_log(angles):
    """Return a log with the joints of each posture in a comment above its points."""
    parts = ["// Stiffness  SA Export, mm\n"]
    for row, *positions in zip(joint_rows(CAMPAIGN), *both(CAMPAIGN), strict=True):
        number = row[0][1:]
        parts.append(f"// Pos {number}: {' '.join(map(angles.format, range(1, 7), row[1:]))}\n")
        parts += [f"R::Stiff::S1_{number}_{'UL'[s]} {' '.join(digits(p))}\n" for s, p in enumerate(positions)]
    return {"log.txt": "".join(parts)}


@pytest.mark.parametrize("angles", ["A{}={}", "J{} = {}", "A{}: {}", "A{}={};"])
def test_joints_in_comments_have_the_unit_that_the_robot_decided(angles, tmp_path):
    assert_read(write_commented_log(angles), tmp_path)


def test_a_posture_in_a_comment_has_the_words_before_its_joints_as_its_label(tmp_path):
    labels = [each["label"] for each in read(write_commented_log("A{}={}"), tmp_path)["observations"]]
    assert labels == [f"Pos {name[1:]}" for name in names(CAMPAIGN)]


@pytest.mark.parametrize("label", ["P{}: A1={} A2={} A3={}", "P{} x: {}; y: {}; z: {}"])
def test_labels_that_name_numbers_make_no_other_file_of_a_table(label, tmp_path):
    rows = [[label.format(row[0], *row[1:]), *row[1:]] for row in WIDE]
    headers = ["what", *"abcdef", *"uvwxyz"]
    assert_read({"all.csv": table(headers, rows, "\t")}, tmp_path)


# ---- groups of points as states


def write_groups(*groups):
    """Return joints, and an export of SpatialAnalyzer with a group without load and one under load."""
    lines = ["// Collection, Group, Point, X, Y, Z"]
    for state, group in enumerate(groups):
        for target in (0, 1):
            rows = points(CAMPAIGN, state, target=target)
            lines += [", ".join(["A", group, f"T{target + 1}_{name}", *place]) for name, *place in rows]
    return {"SA.txt": "\n".join(lines) + "\n", "j.csv": joints(CAMPAIGN, label="Pose")}


@pytest.mark.parametrize("loaded", ["LOADED_100KG", "loaded 100 kg", "100kg"])
def test_groups_whose_words_are_states_state_the_load(loaded, tmp_path):
    proposed = propose(write_groups("UNLOADED", loaded), tmp_path, force=None)
    assert "loaded 100 kg: force 0, 0, −980.7 N" in str(proposed)
    (tmp_path / "again").mkdir()
    assert_read(write_groups("UNLOADED", loaded), tmp_path / "again", force=None)


def test_groups_that_name_the_load_of_another_group_are_without_load(tmp_path):
    assert_read(write_groups("UNLOADED_100KG", "LOADED_100KG"), tmp_path, force=None)


@pytest.mark.parametrize("words", [{"BETA": "loaded"}, {"ALPHA": "unloaded"}, {"BETA_2": "loaded"}])
def test_a_stated_word_of_a_group_is_its_state(words, tmp_path):
    assert_read(write_groups("ALPHA_1", "BETA_2"), tmp_path, state_words=words)


@pytest.mark.parametrize("groups", [("ZERO_1", "RUN_2"), ("RUN_1", "ZERO_2")])
def test_the_word_that_is_likely_without_load_is_offered_as_unloaded(groups, tmp_path):
    problem = refuse(write_groups(*groups), tmp_path)
    assert "'ZERO' as `unloaded`" in problem.remedy
