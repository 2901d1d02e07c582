"""Names that files give their targets are kept: in groups of groups, in any words, in rows and in objects."""

import io
import json

import openpyxl
import pytest
from support.strange_files import JOINTS, both, digits, joint_rows, judge, names, simulate, table, wide

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=12)
TARGETS = [both(CAMPAIGN, target) for target in range(3)]
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}
STATED |= {"force": [0, 0, -981], "units": {"force": "N"}}


def propose(content, folder, name="a.csv"):
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return js.read(folder / name, robot=ARM, **STATED)


def judge_targets(proposed, expected):
    answer = proposed.accept() if hasattr(proposed, "accept") else proposed
    assert {each.target for each in answer.measurement_set.observations[0].readings} == set(expected)
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


@pytest.mark.parametrize(("words", "name"), [(("空载", "负载"), "靶球"), (("no load", "loaded"), "Ball ")])
def test_groups_above_groups_name_target_and_state(words, name, tmp_path):
    book = openpyxl.Workbook()
    groups = [[f"{name}{n} (mm)", *[None] * 5] for n in (1, 2, 3)]
    book.active.append(["序号", "Joints (°)", *[None] * 5, *(cell for group in groups for cell in group)])
    book.active.append([None, *JOINTS, *[words[1], None, None, words[0], None, None] * 3])
    book.active.append([None] * 7 + ["X", "Y", "Z"] * 6)
    blocks = [places for target in TARGETS for places in (target[1], target[0])]
    for number, row in enumerate(wide(CAMPAIGN, *blocks), start=1):
        book.active.append([number, *map(float, row[1:])])
    output = io.BytesIO()
    book.save(output)
    proposed = propose(output.getvalue(), tmp_path, "a.xlsx")
    judge_targets(proposed, [f"{name}{n}" for n in (1, 2, 3)])


@pytest.mark.parametrize(
    "form",
    ["Kugel {n} {state} [mm] {axis}", "tracker/Kugel {n} ({state}).{axis}", "{state} {axis} of Kugel {n}"],
)
def test_words_that_the_headers_of_a_target_share_are_its_name(form, tmp_path):
    header = [
        form.format(n=n, state=state, axis=axis)
        for n in (1, 2, 3)
        for state in ("mit Last", "ohne Last")
        for axis in "XYZ"
    ]
    blocks = [places for target in TARGETS for places in (target[1], target[0])]
    proposed = propose(table(["Pose", *JOINTS, *header], wide(CAMPAIGN, *blocks)), tmp_path)
    found = {each.target for each in proposed.accept().measurement_set.observations[0].readings}
    assert all(f"Kugel {n}" in " ".join(sorted(found)) for n in (1, 2, 3))
    assert judge(CAMPAIGN, proposed.accept().measurement_set.model_dump(mode="json")) == []


@pytest.mark.parametrize(
    "words", [("nezatíženo", "zatíženo"), ("neopterećeno", "opterećeno"), ("nieobciążony", "obciążony")]
)
def test_rows_of_negated_participles_keep_their_targets(words, tmp_path):
    rows = [
        [label, word, f"R{target + 1}", *digits(TARGETS[target][state][number])]
        for number, label in enumerate(names(CAMPAIGN))
        for state, word in ((1, words[1]), (0, words[0]))
        for target in (0, 1)
    ]
    (tmp_path / "b.csv").write_text(table(["poloha", *JOINTS], joint_rows(CAMPAIGN)))
    (tmp_path / "a.csv").write_text(table(["poloha", "stav", "bod", "X [mm]", "Y [mm]", "Z [mm]"], rows))
    proposed = js.read(tmp_path / "a.csv", tmp_path / "b.csv", robot=ARM, **STATED)
    judge_targets(proposed, ["R1", "R2"])


def test_an_object_with_a_unit_is_no_part_of_the_name_of_a_target(tmp_path):
    lines = [
        {"pose_id": n, "state": word, "q": list(angles), "tracker_mm": {"smr": list(TARGETS[0][state][n])}}
        for state, word in ((0, "free"), (1, "loaded"))
        for n, angles in enumerate(CAMPAIGN.joints)
    ]
    judge_targets(propose("\n".join(map(json.dumps, lines)), tmp_path, "a.jsonl"), ["smr"])


def test_the_sentence_lists_the_columns_of_joints_that_do_not_follow_each_other(tmp_path):
    order = [2, 1, 0, 3, 4, 5]
    rows = [[*(row[1:7][joint] for joint in order), *row[7:]] for row in wide(CAMPAIGN, *TARGETS[0])]
    header = [
        *(f"A{joint + 1}" for joint in order),
        *(f"tip ({word}).{axis}" for word in ("free", "hung") for axis in "xyz"),
    ]
    proposed = propose(table(header, rows), tmp_path)
    assert "columns 3, 2, 1, 4, 5, 6 as J1…J6 [deg]" in str(proposed)


@pytest.mark.parametrize("sign", [" = ", " : ", "="])
def test_each_angle_of_a_line_has_the_name_before_it(sign, tmp_path):
    text = ""
    for n, angles in enumerate(CAMPAIGN.joints):
        named = "  ".join(f"A{k + 1}{sign}{angle:.4f}" for k, angle in enumerate(angles))
        text += f"--- Postura {n + 1} ---\nEixos: {named}\n"
        for state, word in ((0, "sem carga"), (1, "com carga")):
            text += f"{word}:\n"
            text += "".join(f"  alvo {k + 1}: {'  '.join(digits(TARGETS[k][state][n]))}\n" for k in (0, 1))
    answer = propose(text, tmp_path, "a.txt").accept()
    headers = [column.header for column in answer.files[0].columns][:6]
    assert all(header.endswith(f"A{k + 1}") for k, header in enumerate(headers))
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_letters_of_axes_above_a_block_are_no_part_of_the_names_of_its_targets(tmp_path):
    """A form has a block for each posture, with `Punto;X;Y;Z` above the rows of its targets."""
    lines = ["Ensayo de rigidez;;;"]
    for posture, joints in enumerate(CAMPAIGN.joints):
        angles = ";".join(f"J{axis}={value}" for axis, value in enumerate(digits(joints), 1))
        lines += ["", f"Postura {posture + 1};;;", f"Ejes;{angles}", "Punto;X;Y;Z"]
        for state, words in enumerate(("sin carga", "con carga")):
            for name, places in zip("AB", TARGETS, strict=False):
                lines.append(";".join([f"{name} {words}", *digits(places[state][posture])]))
    proposed = propose("\n".join(lines), tmp_path)
    targets = {each.target for each in proposed.accept().measurement_set.observations[0].readings}
    assert targets == {"Punto A", "Punto B"}
    judge_targets(proposed, targets)


def write_titles(without, under, targets=("T1", "T2", "T3")):
    """Return a table whose groups are titles of states above targets above axes."""
    header = [
        f"{state} {target} {axis}" for state in (without, under) for target in targets for axis in "XYZ"
    ]
    blocks = [each[state] for state in (0, 1) for each in TARGETS]
    return table(["Pose", *JOINTS, *header], wide(CAMPAIGN, *blocks))


@pytest.mark.parametrize(
    ("without", "under"),
    [
        ("Kuormittamaton", "Kuormitettu 1320 N"),
        ("unloaded", "loaded 1,32 kN"),
        ("unloaded 0 N", "loaded_135kgf"),
        ("ohne Last", "300 lbf mit Last"),
    ],
)
def test_a_force_in_the_title_of_the_loaded_targets_is_no_part_of_their_names(without, under, tmp_path):
    judge_targets(propose(write_titles(without, under), tmp_path), ["T1", "T2", "T3"])


def test_a_number_with_a_unit_in_both_titles_is_a_name_and_no_force(tmp_path):
    names_of_targets = ["Tor 3 N", "Tor 4 N", "Tor 5 N"]
    judge_targets(propose(write_titles("unloaded", "loaded", names_of_targets), tmp_path), names_of_targets)


def test_words_of_one_state_alone_part_no_target_from_its_readings_in_the_other(tmp_path):
    content = write_titles("unloaded", "loaded at 5 bar")
    judge_targets(propose(content, tmp_path), ["T1", "T2", "T3"])


@pytest.mark.parametrize("word", ["sigma", "max", "x", "U95"])
def test_names_that_the_written_table_cannot_keep_are_numbers(word, tmp_path):
    rows = [
        [label, state, f"{word} {target}", *digits(TARGETS[target][number][posture])]
        for posture, label in enumerate(names(CAMPAIGN))
        for number, state in enumerate(("unloaded", "loaded"))
        for target in (0, 1)
    ]
    (tmp_path / "b.csv").write_text(table(["Pose", *JOINTS], joint_rows(CAMPAIGN)))
    (tmp_path / "a.csv").write_text(table(["Pose", "state", "target", "A", "B", "C"], rows))
    proposed = js.read(tmp_path / "a.csv", tmp_path / "b.csv", robot=ARM, **STATED)
    judge_targets(proposed, ["T1", "T2"])
