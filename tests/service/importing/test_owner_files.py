"""Files as their owners have them: from each file to a set, with three options or answers at most."""

import re
from statistics import fmean, pstdev, stdev

import pytest
from support.importing_samples import (
    CAMPAIGN,
    CAMPAIGN_NUMBERS,
    JOINTS,
    MM,
    POINTS,
    READ_POINTS,
    answered,
    numbers_of,
    points_of,
    read,
    refusals,
    sources_of,
)
from support.workbooks import ROWS, rows_of_values, workbook

from jointstiff.schemas.imports import ImportOptions
from jointstiff.service.importing.grammar import find_state_in_name, fits_header, parse_header
from jointstiff.service.importing.grid import remove_thousands_separators
from jointstiff.service.importing.reading import understand_files

UNLOADED = """\
label;J1 [deg];J2 [deg];P10 unloaded x [mm];P10 unloaded y [mm];P10 unloaded z [mm]
c01;10.5;-20.25;1245.7134;-310.1127;239.2014
c02;-15;-35.125;1102.5518;402.9017;318.4406
"""
LOADED = UNLOADED.replace("unloaded", "loaded").replace("-35.125", "-35.1291").replace("10.5;", "10.4995;")


@pytest.mark.parametrize("files", [(UNLOADED, LOADED), (LOADED, UNLOADED)])
def test_each_state_may_have_joints_of_its_own_and_the_unloaded_ones_count(files):
    imported = read(*((f"{i}.csv", text) for i, text in enumerate(files)))
    assert [each.vector("joint") for each in imported.observations] == [(10.5, -20.25), (-15.0, -35.125)]
    (note,) = [each for each in imported.preview.assumptions if "differ between files" in each]
    assert "by up to 0.0041 (deg or mm)" in note


def test_joints_that_differ_more_are_told_once_with_the_greatest_difference():
    wrong = UNLOADED.replace("unloaded", "loaded").replace("-35.125", "-35.2").replace("10.5;", "10.55;")
    assert refusals(("u.csv", UNLOADED), ("l.csv", wrong)) == [
        "l.csv:3: the joint angles of 'c02' differ by 0.075° from those at 'u.csv', line 3, at joint 2; "
        "up to 0.01° is plausible; give each observation a unique label, correct one of the two rows, or "
        "raise `joint_tolerance` (in ° or mm) [joint_tolerance]"
    ]


def test_repeated_readings_have_their_mean_and_a_note_says_their_spread():
    repeated = POINTS + "c01_P10_loaded;1245.6041;-310.1098;237.9853\n"
    imported = read(("j.csv", JOINTS), ("p.txt", repeated), units=MM, mean_of_repeats=True)
    found = points_of(imported)
    assert found["c01", "P10", "loaded"] == pytest.approx((1245.6031, -310.1098, 237.9853))
    assert {key: value for key, value in found.items() if key != ("c01", "P10", "loaded")} == {
        key: value for key, value in READ_POINTS.items() if key != ("c01", "P10", "loaded")
    }
    (note,) = [each for each in imported.preview.assumptions if "repeated" in each]
    assert "1 points" in note
    assert "0.816 µm in each coordinate; the greatest distance from a mean is 1 µm" in note


def test_joints_may_be_numbered_from_zero():
    text = re.sub(r"J(\d) ", lambda match: f"Joint{int(match[1]) - 1} ", CAMPAIGN)
    assert "Joint0 [deg]" in text
    assert numbers_of(answered(("a.csv", text))) == CAMPAIGN_NUMBERS


REMARKS = [
    "Bemerkung: Zelle 3, Hallentor offen;;;;;;;;;;;;",
    "lunch break;;;;;;;;;;;;",
    "; Pause",
    "EOF",
    "---------",
]
STATISTICS = [
    f"{word};1;2;3;4;5;6;7;8;9;10;11;12"
    for word in ("mean", "Mittel", "σ", "Std Dev", "Mittelwert:", "StdDev (n-1)", "Peak-to-peak")
]


@pytest.mark.parametrize("row", [*REMARKS, *STATISTICS])
@pytest.mark.parametrize("place", [3, 5])
def test_rows_of_remarks_and_of_statistics_are_left_out(row, place):
    lines = CAMPAIGN.splitlines()
    answer = answered(("a.csv", "\n".join([*lines[:place], row, *lines[place:]]) + "\n"))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert any("were omitted: 1, the first" in note for note in answer.files[0].assumptions)


def row_of(statistic, name, digits=4):
    values = zip(*(map(float, row[1:]) for row in ROWS[1:]), strict=True)
    return ";".join([name, *(f"{statistic(column):.{digits}f}" for column in values)])


@pytest.mark.parametrize(
    "rows",
    [
        [row_of(fmean, "c01-c03")],
        [row_of(fmean, "")],
        [row_of(fmean, "M", 3), row_of(stdev, "S", 3)],
        [row_of(fmean, "alle"), row_of(pstdev, "s")],
    ],
)
def test_rows_with_the_means_of_all_others_are_left_out_by_any_name(rows):
    answer = answered(("a.csv", CAMPAIGN + "\n".join(rows) + "\n"))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert any(f"statistics were omitted: {len(rows)}" in note for note in answer.files[0].assumptions)


def test_a_last_row_that_is_near_the_means_is_an_observation():
    near = row_of(lambda column: fmean(column) + 0.001, "c04")
    assert len(numbers_of(answered(("a.csv", f"{CAMPAIGN}{near}\n")))) == 4


def test_a_row_with_a_label_and_no_numbers_is_no_remark():
    assert refusals(("a.csv", CAMPAIGN + "c04;;;;;;;;;;;;\n"))
    assert refusals(("a.csv", CAMPAIGN + "c04\n"))
    assert refusals(("a.csv", CAMPAIGN + "last;;;;;;;;;;;;\n"))


@pytest.mark.parametrize("mark", [",", "."])
def test_numbers_as_texts_of_a_sheet_need_one_answer(mark):
    rows = [[cell.replace(".", mark) for cell in row] for row in ROWS]
    rows[0] = ROWS[0]
    file = "a.xlsx", workbook(rows)
    (said,) = refusals(file)
    assert said.endswith("[decimal_mark]")
    words = "comma" if mark == "," else "point"
    assert numbers_of(answered(file, decimal_mark=words)) == CAMPAIGN_NUMBERS


def test_two_sheets_are_two_tables_of_one_campaign():
    rows = rows_of_values()

    def divided(book, _sheet):
        second = book.create_sheet("Punkte")
        for row in rows:
            second.append([row[0], *row[7:]])

    file = "a.xlsx", workbook([row[:7] for row in rows], divided)
    assert numbers_of(answered(file, sheet="Sheet; Punkte")) == CAMPAIGN_NUMBERS


TIMES = ["11/20/2026 10:05:33 AM", "20.11.2026 10:05:33", "2026-11-20 10:05:33.120"]


@pytest.mark.parametrize("time", TIMES)
def test_points_of_spatial_analyzer_may_have_a_time_behind(time):
    lines = [
        "// AXES = CARTESIAN: X,  Y,  Z (mm)",
        *(
            f"A, {name.rpartition('_')[2]}, {'_'.join(name.split('_')[:2])}, {x}, {y}, {z}, {time}"
            for name, x, y, z in (line.split(";") for line in POINTS.splitlines())
        ),
    ]
    text = "\n".join(lines) + "\n"
    options = {"point_name": "{any}::{state}::{label}_{target}"}
    imported = read(("p.txt", text), **options)
    assert points_of(imported) == READ_POINTS


def test_columns_may_have_the_names_of_the_robots_joints():
    joints = ["elbow_joint", "pan_joint", "lift_joint"]
    text = re.sub(r"J(\d) ", lambda match: f"{joints[int(match[1]) - 1]} ", CAMPAIGN)
    understood = understand_files(sources_of(("a.csv", text)), ImportOptions(), joints)
    assert not understood.faults
    plain = read(("a.csv", CAMPAIGN))
    assert [each.vector("joint") for each in understood.observations] == [
        each.vector("joint") for each in plain.observations
    ]
    assert [fault.reason for fault in understand_files(sources_of(("a.csv", text))).faults]


@pytest.mark.parametrize(
    ("name", "state"),
    [
        ("Messung_2026-03-12_ohne_Last", "unloaded"),
        ("day 1, with load", "loaded"),
        ("run-no-load", "unloaded"),
        ("Run 1 (no load)", "unloaded"),
        ("x-nicht-belastet", "unloaded"),
        ("c1_load_0kg", None),  # perhaps without a load
        ("un-loaded", None),
        ("load_removed", "unloaded"),
        ("last_day", None),
        ("before_repair", None),
        ("delta_robot_cell", None),
        ("c-after-unloading", "unloaded_after"),
        ("robot_on_table_unloaded", None),  # `on` means loaded elsewhere
        ("cell_on_monday", None),  # a short word is not enough
        ("unloaded_and_loaded", None),
        ("off_load", "unloaded"),
    ],
)
def test_one_word_of_a_long_name_says_the_state(name, state):
    assert find_state_in_name(name, {}) == state


def test_words_of_the_caller_say_the_state_of_a_name_before_all_others():
    assert find_state_in_name("c1_load_0kg", {"0kg": "unloaded", "150kg": "loaded"}) == "unloaded"


@pytest.mark.parametrize("text", ["2.652,5", "2652,5", "2.652", "1,234.5"])
def test_separators_of_thousands_are_taken_only_where_decimals_follow(text):
    kept = text if text != "2.652,5" else "2652,5"
    assert remove_thousands_separators(text, "comma") == kept


def test_a_second_header_that_contradicts_the_first_is_refused():
    table = "".join(line for line in CAMPAIGN.splitlines(keepends=True) if line[0] != "#")
    header = table.splitlines()[0]
    assert refusals(("a.csv", header.replace("J2 [deg]", "J2 [mm]") + "\n" + table))


def test_a_row_of_least_or_greatest_numbers_is_left_out_only_if_they_are():
    least, greatest = row_of(min, "*min*"), row_of(max, "Maximum")
    assert numbers_of(answered(("a.csv", f"{CAMPAIGN}{least}\n{greatest}\n"))) == CAMPAIGN_NUMBERS
    posture = least.replace("*min*", "Min").rpartition(";")[0] + ";85.5"
    assert len(numbers_of(answered(("a.csv", f"{CAMPAIGN}{posture}\n")))) == 4


@pytest.mark.parametrize(
    "name", ["{label}_{state}::{target}", "{label}::{target}_{state}", "{label}::{target}_u"]
)
def test_a_part_of_a_point_of_spatial_analyzer_may_end_with_the_state(name):
    lines = []
    for line in POINTS.splitlines():
        point, _, numbers = line.partition(";")
        label, target, state = point.split("_")
        text = name.format(label=label, target=target, state=state)
        lines.append(f"{text.replace('_u', '_l') if state == 'loaded' and '_u' in name else text};{numbers}")
    assert points_of(read(("p.txt", "\n".join(lines) + "\n"), units=MM)) == READ_POINTS


def test_readings_before_with_and_after_a_load_are_no_repeated_readings():
    header = "label;state;target;x [mm];y [mm];z [mm]\n"
    rows = "c01;before;P10;1;2;3\nc01;loaded;P10;1;2;2.9\nc01;after;P10;1;2;3.001\n"
    (fault,) = refusals(("p.csv", header + rows), mean_of_repeats=True)
    assert "'loaded' and 'after' both mean loaded" in fault
    found = read(("p.csv", header + rows), state_words={"after": "unloaded_after"})
    assert {state for _, _, state in points_of(found)} == {"unloaded", "loaded", "unloaded_after"}


def test_a_stated_header_is_that_of_the_files_without_a_known_one():
    points = "".join(f"{line};0.0041;12.03.2026\n" for line in POINTS.splitlines())
    files = ("j.csv", JOINTS), ("p.txt", points)
    imported = read(*files, header=["name", "x", "y", "z", "ignore", "date"], units=MM)
    assert points_of(imported) == READ_POINTS


def test_a_star_ignores_all_columns_of_a_kind():
    lines = CAMPAIGN.splitlines()
    first = next(k for k, line in enumerate(lines) if line[0] != "#")
    table = [line + (";Dev X;Dev Y;3D Dev" if k == first else ";1;2;3") for k, line in enumerate(lines)]
    text = "\n".join(line if k >= first else lines[k] for k, line in enumerate(table)) + "\n"
    assert refusals(("a.csv", text))
    assert numbers_of(answered(("a.csv", text), ignore=["Dev *", "3D*"])) == CAMPAIGN_NUMBERS
    (fault,) = refusals(("a.csv", CAMPAIGN), ignore=["Dev *"])
    assert "names the header 'Dev *', but no file has this header" in fault


def test_two_loads_of_one_label_are_refused_also_if_one_is_zero():
    header = "label;state;Fx [N];Fy [N];Fz [N];P10 x [mm];P10 y [mm];P10 z [mm]\n"
    rows = "c01;unloaded;0;0;-100;1;2;3\nc01;loaded;0;0;-500;1;2;2.9\n"
    assert "the force of 'c01' differs" in refusals(("a.csv", header + rows))[0]
    zero_loaded = rows.replace("-100", "-500").replace("loaded;0;0;-500;1;2;2.9", "loaded;0;0;0;1;2;2.9")
    assert "the force of 'c01' differs" in refusals(("a.csv", header + zero_loaded))[0]


@pytest.mark.parametrize("name", ["mass_kg", "mass [kg]", "Payload kg"])
def test_a_mass_may_have_its_unit_behind_a_blank_or_an_underscore(name):
    assert (parse_header(name, {}).kind, parse_header(name, {}).unit) == ("mass", "kgf")


@pytest.mark.parametrize(
    ("pattern", "header", "fits"),
    [
        ("a*b", "axb", True),
        ("a*b", "ab", True),
        ("a*b", "abc", False),
        ("ab*ba", "aba", False),
        ("*x*x*", "axbx", True),
        ("*x*x*", "ax", False),
        ("P10 [mm]", "P10  [mm]", True),
        ("*a" * 200, "b" * 400, False),
    ],
)
def test_a_star_stands_for_any_text(pattern, header, fits):
    assert fits_header(pattern, header) == fits


def two_named_sheets(first, second):
    """Return a workbook of points in two sheets, unloaded and loaded."""
    lines = [line.split(";") for line in POINTS.splitlines()]
    rows = {
        state: [["name", "target", "x [mm]", "y [mm]", "z [mm]"]]
        + [[n.split("_")[0], "P10", *map(float, xyz)] for n, *xyz in lines if n.endswith(f"_{state}")]
        for state in ("unloaded", "loaded")
    }

    def divided(book, sheet):
        sheet.title = first
        other = book.create_sheet(second)
        for row in rows["loaded"]:
            other.append(row)

    return workbook(rows["unloaded"], divided)


def test_a_sheet_says_the_state_only_if_several_are_chosen():
    content = two_named_sheets("no load", "with load")
    found = read(("readings.xlsx", content), sheet="no load; with load")
    assert points_of(found) == READ_POINTS
    assert points_of(read(("readings.xlsx", content))) == READ_POINTS  # both, as their names tell states
    found = read(("P10_unloaded.xlsx", two_named_sheets("after", "x")), sheet="after")
    assert {state for _, _, state in points_of(found)} == {"unloaded"}
    (fault,) = {
        each.partition(";")[0] for each in refusals(("unloaded.xlsx", content), sheet="no load; with load")
    }
    assert fault == "unloaded.xlsx: the name of the sheet 'with load' says loaded, that of the file unloaded"


def test_repeated_readings_in_two_sheets_have_no_mean():
    faults = refusals(
        ("a.xlsx", two_named_sheets("with load 1", "with load 2")),
        sheet="with load 1; with load 2",
        mean_of_repeats=True,
    )
    assert all("occurs in two files or sheets" in fault for fault in faults)


def test_a_digit_behind_a_state_may_be_a_target():
    names = POINTS.replace("P10_unloaded", "unloaded_2").replace("P10_loaded", "loaded_2")
    assert set(points_of(read(("p.txt", names), units=MM))) == {(a, "2", c) for a, _, c in READ_POINTS}


def test_targets_may_be_called_as_words_for_states_are():
    text = POINTS.replace("_P10_", "::L_")
    assert set(points_of(read(("p.txt", text), units=MM))) == {(a, "L", c) for a, _, c in READ_POINTS}


@pytest.mark.parametrize("end", ["gam", "loaded\n"])
def test_a_cut_label_and_a_row_with_a_state_are_no_remarks(end):
    assert refusals(("a.csv", CAMPAIGN + end))


def test_rows_of_remarks_do_not_hide_an_observation_called_max():
    lines = CAMPAIGN.replace("c02;", "max;").splitlines()
    text = "\n".join([*lines, "end of file" + ";" * 12]) + "\n"
    assert len(numbers_of(answered(("a.csv", text)))) == 3


@pytest.mark.parametrize(
    ("title", "column"),
    [
        ("Forces [kN]", "Fx [N]"),
        ("Robot joints [rad]", "J1 [deg]"),
        ("Robot joints [grad]", "J1"),
    ],
)
def test_a_title_that_contradicts_its_columns_is_refused(title, column):
    table = [line.split(";") for line in CAMPAIGN.splitlines() if line[0] != "#"]
    named = column if column in table[0] else f"{column} [deg]"
    table[0][table[0].index(named)] = column
    titles = [title if name == column else "" for name in table[0]]
    assert refusals(("a.csv", "\n".join(map(";".join, [titles, *table])) + "\n"))


def test_names_of_the_robots_joints_come_before_numbers():
    joints = ["joint_7", "joint_1", "joint_2"]
    text = re.sub(r"J(\d) ", lambda match: f"{joints[int(match[1]) - 1]} ", CAMPAIGN)
    understood = understand_files(sources_of(("a.csv", text)), ImportOptions(), joints)
    assert [each.vector("joint") for each in understood.observations] == [
        each.vector("joint") for each in read(("a.csv", CAMPAIGN)).observations
    ]
