"""What `import` proposes for files without names: Enter takes it, scripts say `--yes`, templates keep it."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.command_lines import assert_said, refused, typed
from support.measured_arms import measure, wide, write_bare

from jointstiff.service.cli import imports
from jointstiff.service.resources.known_robots import catalogue_robots

ARM = "Yaskawa GP25"
STATED = "--encoders motor --load-point 0,0,120 --force 0,0,-90 --units force=N"
PROPOSAL = (
    "j.txt columns 1–6 as J1…J6 [deg], u.txt 1–3 as T1 unloaded [mm] and l.txt 1–3 as T1 loaded [mm] fit"
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    known = next(each for each in catalogue_robots() if each.name == ARM)
    for seed, day in enumerate(("", "2"), 1):
        joints, points = measure(known, seed=seed)
        write_bare(tmp_path / f"j{day}.txt", joints)
        write_bare(tmp_path / f"u{day}.txt", points[:, 0])
        write_bare(tmp_path / f"l{day}.txt", points[:, 0] - [0.0, 0.0, 0.6])
    write_bare(tmp_path / "signs.txt", wide(joints * [-1, 1, 1, -1, 1, -1], points))
    write_bare(tmp_path / "rolled.txt", wide(joints, points[[*range(1, 16), 0]]))
    monkeypatch.chdir(tmp_path)


def test_enter_takes_the_proposal_and_a_complete_campaign_is_written(monkeypatch):
    monkeypatch.setattr(imports, "is_terminal_input", lambda: True)
    shown = typed(f"import j.txt u.txt l.txt --robot '{ARM}' {STATED} -o c.json", input="\n\n\n\n")
    assert_said(
        shown,
        PROPOSAL,
        "Take it? [Y/n]",
        "How the load point is known (tracker, drawing, hand, unknown) [unknown]:",
        "What the force is known by (scales, cell, pulley, catalogue, unknown) [unknown]:",
        "What the controller did between the readings without and under load",
        "wrote c.json, a campaign; now: jointstiff identify c.json",
    )


def test_without_a_terminal_nothing_is_taken_and_the_option_is_named():
    shown = refused(f"import j.txt u.txt l.txt --robot '{ARM}' {STATED} -o c.json")
    assert_said(shown, PROPOSAL, "--yes accepts this proposal.")
    assert not Path("c.json").exists()


def test_a_proposal_whose_import_is_refused_is_not_offered():
    joints = [f"J{number} [deg]" for number in range(1, 7)]
    places = [
        f"P{target} {state} {axis} [mm]"
        for target in (1, 2)
        for state in ("unloaded", "loaded")
        for axis in "xyz"
    ]
    known = next(each for each in catalogue_robots() if each.name == ARM)
    angles, points = measure(known, seed=1)
    targets = [points[:, 0], points[:, 1]]
    columns = [angles, *(each for target in targets for each in (target, target - [0.0, 0.0, 0.6]))]
    table = np.column_stack(columns)
    lacking = places.index("P1 loaded z [mm]")
    header = ";".join(["label", *joints, *(name for name in places if name != places[lacking])])
    kept = np.delete(table, 6 + lacking, axis=1)
    rows = [";".join([f"c{number}", *map(str, row)]) for number, row in enumerate(kept.tolist(), 1)]
    Path("lacking.csv").write_text("\n".join([header, *rows]) + "\n")
    shown = refused(f"import lacking.csv --robot '{ARM}' {STATED} -o c.json")
    assert_said(shown, "column P1 loaded z is missing")
    assert "--yes" not in shown


NAMED = ";".join(
    ["label", *(f"J{n} [deg]" for n in range(1, 7))]
    + [f"P1 {state} {axis} [mm]" for state in ("unloaded", "loaded") for axis in "xyz"]
)


def write_named(name, change):
    """Write a table whose headers explain all columns; `change` alters the cells of a row of a number."""
    known = next(each for each in catalogue_robots() if each.name == ARM)
    angles, points = measure(known, seed=1)
    table = np.column_stack([angles, points[:, 0], points[:, 0] - [0.0, 0.0, 0.6]])
    rows = [change(n, [f"c{n:02}", *map(str, row)]) for n, row in enumerate(table.tolist(), 1)]
    Path(name).write_text("\n".join([NAMED, *map(";".join, rows)]) + "\n")


@pytest.mark.parametrize("yes", ["", " --yes"])
def test_where_headers_explain_all_columns_only_the_faulty_cell_is_named(yes):
    write_named("named.csv", lambda n, row: ["c03", *row[1:]] if n == 4 else row)
    assert refused(f"import named.csv --robot '{ARM}' {STATED} -o c.json{yes}") == (
        "named.csv:5: the label 'c03' occurs twice, first at 'named.csv', line 4 "
        "remedy: rename or remove one of the two rows"
    )


def lack_number(n, row):
    return [*row[:7], "n/a", *row[8:]] if n == 5 else row


def test_a_script_that_states_nothing_refuses_a_missing_number():
    write_named("named.csv", lack_number)
    assert refused(f"import named.csv --robot '{ARM}' {STATED} -o c.json") == (
        "named.csv:6:8: 'n/a' is no number remedy: fill in the cell, or use `--allow-missing` to leave "
        "this reading out"
    )


@pytest.mark.parametrize("option", ["--allow-missing", "--yes"])
def test_a_reading_with_a_mark_for_a_missing_number_is_left_out(option):
    write_named("named.csv", lack_number)
    shown = typed(f"import named.csv --robot '{ARM}' {STATED} {option} -o c.json")
    assert_said(shown, "c05: a coordinate of target P1 unloaded has no number; skipped", "wrote c.json")


def test_yes_leaves_out_a_line_that_a_posture_lacks():
    angles, points = measure(next(each for each in catalogue_robots() if each.name == ARM), seed=1)
    lines = []
    for n, (joints, places) in enumerate(zip(angles, points, strict=True), 1):
        lines += ["", f"Pose {n}: J = [{', '.join(f'{each:.3f}' for each in joints)}] deg"]
        for name, place in zip("AB", places, strict=False):
            loaded = " ".join(f"{each:.4f}" for each in place - [0.0, 0.0, 0.6])
            lines += [f"SMR {name} unloaded: " + " ".join(f"{each:.4f}" for each in place)]
            lines += [f"SMR {name} loaded: " + ("not seen" if (n, name) == (5, "B") else loaded)]
    Path("book.txt").write_text("\n".join(["Lab book, mm", *lines]) + "\n")
    said = refused(f"import book.txt --robot '{ARM}' {STATED} -o c.json")
    assert_said(said, "a posture lacks lines that the others have")
    shown = typed(f"import book.txt --robot '{ARM}' {STATED} --yes -o c.json")
    assert_said(shown, "5: target SMR B was read only unloaded; skipped", "wrote c.json")
    readings = json.loads(Path("c.json").read_text())["measurement_set"]["observations"][4]["readings"]
    assert [each["target"] for each in readings] == ["SMR A"]


def test_enter_leaves_out_a_missing_reading_that_the_question_names(monkeypatch):
    monkeypatch.setattr(imports, "is_terminal_input", lambda: True)
    write_named("named.csv", lack_number)
    shown = typed(f"import named.csv --robot '{ARM}' {STATED} -o c.json", input="\n\n\n\n")
    assert_said(shown, "Leave out incomplete readings ('n/a' is no number in line 6)? [Y/n]", "wrote c.json")


def test_equal_faults_of_many_rows_are_one_with_their_places():
    write_named("named.csv", lambda _n, row: [*row, "1"])
    shown = refused(f"import named.csv --robot '{ARM}' {STATED} -o c.json")
    assert shown.count("the row has 14 cells, but line 1 has 13") == 1
    assert_said(shown, "named.csv:2:14:", "the same at 3:14, 4:14, 5:14 and in 12 more places")


def test_units_of_headers_are_corrected_in_the_headers():
    """The remedy is carried out: an option with another unit than the headers would be refused."""
    write_named("named.csv", lambda _n, row: [*row[:7], *(f"{float(each) / 1e3:.7f}" for each in row[7:])])
    stated = f"--robot '{ARM}' {STATED} -o c.json"
    shown = typed(f"import named.csv {stated}", status=1)
    assert_said(shown, "change the unit of lengths in the headers from mm to m")
    Path("named.csv").write_text(Path("named.csv").read_text().replace("[mm]", "[m]"))
    assert_said(typed(f"import named.csv {stated}"), "wrote c.json, a campaign")


def test_a_template_keeps_the_meaning_and_reads_the_next_day_without_a_question():
    typed(f"import j.txt u.txt l.txt --robot '{ARM}' {STATED} --yes --save-template t.json")
    assert json.loads(Path("t.json").read_text())["meaning"]["joints"]["columns"] == [1, 2, 3, 4, 5, 6]
    shown = typed(f"import j2.txt u2.txt l2.txt --robot '{ARM}' --template t.json -o c.json")
    assert_said(shown, "wrote c.json, a campaign")


def test_a_third_reading_under_load_is_no_reading_after_unloading(tmp_path):
    joints, points = measure(next(each for each in catalogue_robots() if each.name == ARM))
    loaded = points[:, 0] - [0.0, 0.0, 0.6]
    for name, third in (("again", loaded + 0.01), ("after", points[:, 0] + 0.01)):
        write_bare(tmp_path / f"{name}.txt", wide(joints, points[:, 0], loaded, third))
    shown = refused(f"import again.txt --robot '{ARM}' {STATED} --yes -o c.json")
    assert_said(shown, "the third positions of T1 are", "so that headers must name the states")
    assert_said(typed(f"import after.txt --robot '{ARM}' {STATED} --yes -o c.json"), "T1 unloaded after")


@pytest.mark.parametrize(("separator", "mark"), [(" ", ","), (".", ","), (",", "."), ("'", ".")])
def test_numbers_with_separated_thousands_are_read_by_a_proposal(tmp_path, separator, mark):
    joints, points = measure(next(each for each in catalogue_robots() if each.name == ARM))
    numbers = wide(joints, points[:, 0], points[:, 0] - [0.0, 0.0, 0.6])

    def write(number):
        return f"{number:,.3f}".translate({ord(","): separator, ord("."): mark})

    rows = [";".join(map(write, row)) for row in numbers]
    (tmp_path / "a.csv").write_text("\n".join(rows) + "\n")
    shown = typed(f"import a.csv --robot '{ARM}' {STATED} --yes -o c.json")
    assert_said(shown, "7–9 as T1 unloaded [mm] and 10–12 as T1 loaded [mm] fit", "wrote c.json")


def test_a_template_with_exchanged_axes_reads_files_of_an_instrument_that_stands_elsewhere(
    monkeypatch, tmp_path
):
    """Each place of the instrument has its own nearest right-handed frame: the template's one is kept."""
    known = next(each for each in catalogue_robots() if each.name == "Stäubli TX2-60")
    joints, points = measure(known)
    loaded = points - [0.0, 0.3, 0.8]
    turns = (np.eye(3), np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]))
    for name, turn in zip(("first", "second"), turns, strict=True):
        both = np.stack([points, loaded], axis=2) @ turn
        write_bare(tmp_path / f"{name}.txt", wide(joints, both[..., [1, 0, 2]]))
    monkeypatch.setattr(imports, "is_terminal_input", lambda: True)
    words = f"--robot '{known.name}' {STATED}"
    typed(f"import first.txt {words} --save-template t.json -o c.json", input="y\n\n\n\n")
    typed(f"import second.txt {words} --template t.json -o d.json", input="y\n\n\n\n")
    assert Path("d.json").exists()


def test_a_template_refuses_files_in_another_order():
    typed(f"import j.txt u.txt l.txt --robot '{ARM}' {STATED} --yes --save-template t.json")
    shown = refused(f"import u2.txt j2.txt l2.txt --robot '{ARM}' --template t.json -o c.json")
    assert_said(shown, "the files do not fit the template: the files have fewer columns")


def test_yes_accepts_no_proposal_with_a_doubt():
    shown = refused(f"import signs.txt --robot '{ARM}' --yes -o c.json")
    assert_said(shown, "--yes does not accept a doubtful proposal: two of x, y and z may be exchanged")


def test_rows_that_are_shifted_get_no_proposal():
    shown = refused(f"import rolled.txt --robot '{ARM}' --yes -o c.json")
    assert_said(shown, "no proposal: no columns fit the robot")


def test_a_missing_unit_of_matrices_is_the_last_word():
    known = next(each for each in catalogue_robots() if each.name == ARM)
    joints, points = measure(known, seed=1)
    loaded = points[:, 0] - [0.0, 0.0, 0.6]
    force = np.tile([0.0, 0.0, -90.0], (len(joints), 1))
    matrices = {"q": joints, "p_free": points[:, 0], "p_loaded": loaded, "F": force}
    lines = [
        f"{name} = [\n" + ";\n".join(" ".join(f"{each:.4f}" for each in row) for row in rows) + "];"
        for name, rows in matrices.items()
    ]
    Path("data.m").write_text("\n\n".join(lines) + "\n")
    stated = f"data.m --robot '{ARM}' --encoders motor --load-point 0,0,120 --yes -o c.json"
    shown = refused(f"import {stated}")
    assert_said(shown, "force x and 2 other columns have no unit", "such as `--units force=N`")
    assert "cells" not in shown
    assert_said(typed(f"import {stated} --units force=N"), "data.m: utf-8, decimal point, 16 rows")


def test_a_unit_of_a_force_that_is_not_known_names_the_options():
    header = [*(f"A{number}" for number in range(1, 7)), *(f"F{axis} [kip]" for axis in "xyz")]
    joints = np.loadtxt("j.txt")
    rows = [[*(f"{each:.4f}" for each in row), "0", "0", "-1"] for row in joints.tolist()]
    Path("k.csv").write_text("".join(";".join(row) + "\n" for row in [header, *rows]))
    stated = STATED.replace("--force 0,0,-90", "")
    shown = refused(f"import k.csv u.txt l.txt --robot '{ARM}' {stated} --yes -o c.json")
    assert_said(
        shown,
        "'kip' of Fx [kip], Fy [kip], Fz [kip] is no known unit of force: convert the numbers to N, daN, kN, "
        "kgf or lbf, or state `--force` and leave the columns out with `--ignore`",
    )
    assert not Path("c.json").exists()
