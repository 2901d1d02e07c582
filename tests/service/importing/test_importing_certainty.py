"""What is not understood for certain is asked about or refused, never guessed."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest
from support.importing_samples import (
    CAMPAIGN,
    JOINTS,
    POINTS,
    READ_POINTS,
    points_of,
    read,
    sources_of,
    values_of,
)
from support.workbooks import table_of

from jointstiff.schemas.imports import ImportOptions, ImportRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.importing.reading import understand_files
from jointstiff.service.resources.imports import import_files
from jointstiff.simulator import default_arm, simulate_campaign

MM = {"length": "mm", "angle": "deg", "force": "N"}
ROWS = [line.split(";") for line in POINTS.splitlines()]


def faults(*files, **options):
    understood = understand_files(sources_of(*files), ImportOptions.model_validate(options))
    assert understood.faults
    return understood.faults


def reasons(*files, **options):
    return [fault.reason for fault in faults(*files, **options)]


# ---- words for states


NUMBERED = "name;P_0 x [mm];P_0 y [mm];P_0 z [mm];P_1 x [mm];P_1 y [mm];P_1 z [mm]\n"


def numbered(*names):
    return NUMBERED + "".join(f"{name};1;2;3.5;101;2;4.5\n" for name in names)


def test_0_and_1_are_targets_where_names_say_the_state():
    """Taken for states they would make a deflection of 100 mm."""
    found = points_of(read(("day.csv", numbered("c01_loaded", "c01_unloaded"))))
    assert found["c01", "P_0", "loaded"] == (1, 2, 3.5)
    assert found["c01", "P_1", "unloaded"] == (101, 2, 4.5)
    by_template = points_of(read(("day.csv", numbered("L+c01", "U+c01")), point_name="{state}+{label}"))
    assert by_template["c01", "P_1", "loaded"] == (101, 2, 4.5)
    by_file = points_of(read(("day#loaded.csv", numbered("c01")), file_name="{any}#{state}"))
    assert set(by_file) == {("c01", "P_0", "loaded"), ("c01", "P_1", "loaded")}
    assert ("c01", "P", "loaded") in points_of(read(("day.csv", numbered("c01"))))
    assert reasons(("day.csv", numbered("c01_loaded", "c02")))  # some names only


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"point_name": "{label}_{state}"}, "'{label}_{state}' is not needed"),
        ({"file_name": "{target}"}, "'{target}' is not needed"),
        ({"columns": {"P10 Loaded x": "P11 loaded x"}}, "no file has the header 'P10 Loaded x'"),
        ({"ignore": ["shift"]}, "no file has the header 'shift'"),
    ],
)
def test_a_statement_that_nothing_needs_is_refused(options, words):
    (reason,) = reasons(("a.csv", CAMPAIGN), **options)
    assert words in reason


def test_a_template_that_repeats_the_headers_is_refused():
    table = "name;unloaded x [mm];unloaded y [mm];unloaded z [mm]\nc01_P10_loaded;1;2;3.5\n"
    (reason,) = reasons(("a.csv", table), point_name="{label}_{target}_{state}")
    assert "is not needed: headers or columns give the state" in reason


# ---- frames and units in remarks


def listed(*remarks, state="unloaded", end="\n"):
    head = "name;x [mm];y [mm];z [mm]\n"
    rows = "".join(";".join(row) + end for row in ROWS if row[0].endswith("_" + state))
    return f"{state}.csv", "".join(f"{remark}\n" for remark in remarks) + head + rows


@pytest.mark.parametrize(
    "remark",
    [
        "// Points Relative to Coordinate Frame 'Frames::best fit'",
        "\"// Points Relative to Coordinate Frame 'Frames::best fit'\"",
        "Points Relative to Coordinate Frame 'Frames::best fit'",
        "# Frame: Frames::best fit",
        "Frame;Frames::best fit",
        "Koordinatensystem: Frames::best fit",
        "# Repère : Frames::best fit",
        "% FRAME = Frames::best fit",
        "# Working frame Frames::best fit",
        "# Reference system: Frames::best fit",
    ],
)
def test_a_frame_is_compared_however_it_is_written(remark):
    world = listed("// FRAME = Frames::WORLD", state="loaded")
    (reason,) = reasons(listed(remark), world)
    assert reason == "the frame is Frames::WORLD, but Frames::best fit in other files"
    (reason,) = reasons(listed(remark), listed(state="loaded"))
    assert reason == "the frame is not named, but Frames::best fit in other files"
    assert points_of(read(listed(remark), listed(remark, state="loaded"), ("j.csv", JOINTS))) == READ_POINTS


@pytest.mark.parametrize(
    "remark",
    [
        "# Units: meters", "Units;m", "# Einheit: Zoll", "# coordinates [m]", "// positions in meters",
        "# Units: m, deg, N", "# Unités : pouces", "# x y z [m]", "# Length unit = cm", "Units: furlongs",
        "Einheit m", "# Maßeinheit: Meter", "# coordonnées en mètres",
    ],
)  # fmt: skip
def test_a_unit_in_a_remark_is_not_overruled(remark):
    (fault,) = faults(listed(remark))
    assert fault.place.line == 1
    bare = listed(remark)[1].replace(" [mm]", "")
    assert faults(("unloaded.csv", bare), units=MM)[0].place.line == 1


@pytest.mark.parametrize(
    "remark",
    [
        "# x, y, z in robot base coordinates", "// X Y Z (left handed)", "# Units: mm", "# Units: mm, deg, N",
        "# unit of the cell", "# Measuring unit: Leica AT960", "# Durchmesser 38.1 mm",
        "# reflector of 1.5 inch", "# tracker 2 m away (warm)",
        "# ( x64 )",
    ],
)  # fmt: skip
def test_prose_is_no_unit(remark):
    assert len(points_of(read(listed(remark)))) == 2


# ---- headers in comments


@pytest.mark.parametrize(
    "comment",
    [
        "# name y x z", "# name, z, y, x", "# y x z", "# x y z name", "# Name | Y | X | Z (mm)",
        "# Punkt;Rechtswert;Hochwert;Höhe", "# nom;abscisse;ordonnée;altitude", "# R Theta Z", "# E N U",
        "# Nr. / Hochwert / Rechtswert / Höhe", "# format: ID ZYX",
    ],
)  # fmt: skip
def test_a_comment_that_may_be_the_header_is_not_replaced(comment):
    found = understand_files(sources_of(("a.csv", f"{comment}\n{POINTS}")), ImportOptions(units=MM))
    if found.faults:
        assert found.faults[0].option == ("point_name" if comment.endswith("name") else "header")
    else:  # its cells are separated otherwise than those of the data
        first = points_of(found)["c01", "P10", "unloaded"]
        assert (
            first
            == {"yxz": (-310.1127, 1245.7134, 239.2014), "zyx": (239.2014, -310.1127, 1245.7134)}[
                "".join(letter for letter in comment if letter in "xyz")
            ]
        )


@pytest.mark.parametrize("comment", ["# x, y, z of two states", "# name x y z", "# X  Y  Z (mm)", "# day 3"])
def test_other_comments_are_none(comment):
    assert points_of(read(("a.csv", f"{comment}\n{POINTS}"), units=MM)) == READ_POINTS


# ---- units in headers


@pytest.mark.parametrize(
    ("header", "meaning", "words"),
    [
        ("Kraft C [Pfund]", "Fz [N]", "'Pfund' is not a known unit of force"),
        ("Kraft C N", "Fz [kN]", "is in N, but"),
        ("Kraft C lbf", "Fz [N]", "'lbf' is not a known unit of force"),
        ("Kraft C (kg)", "Fz [N]", "'kg' is not a known unit of force"),
        ("Kraft C [mm]", "Fz [N]", "is in mm, but"),
    ],
)
def test_a_unit_of_a_header_is_not_overruled(header, meaning, words):
    content = CAMPAIGN.replace("Fz [N]", header)
    assert words in reasons(("a.csv", content), columns={header: meaning})[0]


@pytest.mark.parametrize("header", ["Kraft_C_t_mean", "Kraft C (links)", "Kraft C N", "Kraft_x_m"])
def test_a_tail_that_is_no_unit_of_it_is_not_taken_for_one(header):
    content = CAMPAIGN.replace("Fz [N]", header)
    assert values_of(read(("a.csv", content), columns={header: "Fz [N]"})) == values_of(
        read(("a.csv", CAMPAIGN))
    )
    measured = CAMPAIGN.replace("P10 unloaded x [mm]", "x_m")
    found = read(("a.csv", measured), columns={"x_m": "P10 unloaded x [mm]"})
    assert points_of(found) == points_of(read(("a.csv", CAMPAIGN)))


def test_inches_are_read_in_three_languages():
    for word in ("Zoll", "pouces", "INCHES"):
        content = POINTS.replace(";", ";").splitlines()[0]
        found = read(("a.csv", f"name;x [{word}];y [{word}];z [{word}]\n{content}\n"))
        assert points_of(found)["c01", "P10", "unloaded"] == pytest.approx(
            (31641.12036, -7876.86258, 6075.71556)
        )


# ---- rotations of probes, statistics, letters


def probed(first, rows, unit=""):
    head = ";".join(["name", "x [mm]", "y [mm]", "z [mm]", *(f"Q{first + part}{unit}" for part in range(4))])
    cells = [";".join([*row, *turned]) for row, turned in zip(ROWS, rows, strict=True)]
    return "a.csv", "\n".join([head, *cells]) + "\n"


ROTATIONS = [
    ("1", "0", "0", "0"),
    ("0.7071", "0", "0", "0.7071"),
    ("0.5", "-0.5", "0.5", "0.5"),
    ("0", "0", "0", "1"),
]
ANGLES = [("0.1", "0.2", "0.3", "0.4")] * 4


def test_a_rotation_is_known_by_its_numbers():
    for first in (0, 1):
        imported = read(probed(first, ROTATIONS))
        assert points_of(imported) == READ_POINTS
        assert imported.preview.joint_count is None
        assert f"Q{first} to Q{first + 3} were ignored as the rotation" in " ".join(
            imported.preview.files[0].assumptions
        )
    assert read(probed(0, [("", "", "", "")] * 4)).preview.joint_count is None
    table = "label;Q1;Q2;Q3;Q4\nc01;0.1;0.2;0.3;0.4\nc02;0.5;-0.5;0.5;-0.5\n"
    assert values_of(read(("a.csv", table), units=MM))["c01", "joint"] == (0.1, 0.2, 0.3, 0.4)
    with_unit = table.replace("0.1;0.2;0.3;0.4", "1;0;0;0").replace(";Q", ";Q").replace("Q1;", "Q1 [rad];")
    assert values_of(read(("a.csv", with_unit), units=MM | {"angle": "rad"}))["c02", "joint"] == (
        0.5,
        -0.5,
        0.5,
        -0.5,
    )
    assert "numbered from 1" in reasons(probed(0, ANGLES))[0]


def test_angles_counted_from_0_are_joints_if_the_caller_says_so():
    table = "label;Q0;Q1;Q2;Q3\nc01;1;0;0;0\nc02;0.5;-0.5;0.5;-0.5\n"
    stated = {f"Q{part}": f"J{part + 1} [rad]" for part in range(4)}
    assert values_of(read(("a.csv", table), columns=stated))["c02", "joint"] == (0.5, -0.5, 0.5, -0.5)


@pytest.mark.parametrize(
    "word", ["StdDev", "Std.Dev", "stddev", "Unc", "Median", "RMSE", "Standardabweichung"]
)
def test_statistics_are_no_targets(word):
    content = CAMPAIGN.replace("P10 unloaded", f"P10 {word} before").replace(
        "P10 loaded", f"P10 {word} after"
    )
    assert all(reason.startswith("unknown column header") for reason in reasons(("a.csv", content)))
    assert read(("a.csv", CAMPAIGN.replace("P10 ", "SD1 "))).preview.targets == ["SD1"]
    joined = CAMPAIGN.replace("P10 ", "P10StdDev ")
    assert all(reason.startswith("unknown column header") for reason in reasons(("a.csv", joined)))


def test_an_x_that_is_not_written_as_y_and_z_are_is_refused():
    table = "name;Y;x;Z\n" + POINTS
    assert "are not spelt alike" in reasons(("a.csv", table), units=MM)[0]


# ---- ends of files


def test_a_cut_number_as_long_as_another_is_refused_or_asked_about():
    head = "label;J1 [deg];Fx [N];Fy [N];Fz [N]\nc01;1;0;0;-1471\nc02;2;0;0;-5\nc03;3;0;0;"
    (reason,) = reasons(("a.csv", head + "-14"))
    assert reason.startswith("the file is cut off")
    asked = read(("a.csv", head + "-12")).unusual
    assert asked == ("the last number -12 ('a.csv', line 4, column 5), whose line has no end",)
    assert read(("a.csv", head + "-12\n")).unusual == ()
    assert read(("a.csv", head + "-5")).unusual == (), "as in another row"
    assert read(("a.csv", CAMPAIGN.rstrip("\n"))).unusual == ()


# ---- times, temperatures, uncertainties


def surrounded(*cells, header="Time"):
    head = f"name;{header};x [mm];y [mm];z [mm]\n"
    return "a.csv", head + "".join(
        ";".join([row[0], cell, *row[1:]]) + "\n" for row, cell in zip(ROWS, cells, strict=True)
    )


@pytest.mark.parametrize(
    ("cell", "header"),
    [
        ("'08.11.2022 16:17:28.353", "Time"),
        ("2022-11-08T16:17:28.353", "Time"), ("2022-11-08 16:17:28,353Z", "Zeit"),
        ("8.11.2022 16:17:28.353", "Datum"), ("08.11.2022;16:17:28.353", "Datum;Uhrzeit"),
        ("16:17:28.353;2022-11-08", "Time;Date"), ("2022/11/8 4:17:28.353 PM", "Time Stamp"),
        ("2022-11-08T18:17:28.353+02:00", "Time"), ("2022/11/08, 16:17:28.353", "Time"),
    ],
)  # fmt: skip
def test_times_that_are_clear_are_read(cell, header):
    imported = read(surrounded(*[cell] * 4, header=header))
    assert imported.surroundings.measured_at == datetime(2022, 11, 8, 16, 17, 28, 353_000, UTC)


def test_a_day_is_told_from_a_month_by_the_other_rows():
    day_first = surrounded("5/11/2026 9:05", "6/11/2026 9:05", "13/11/2026 9:05", "7/11/2026 9:05")
    assert read(day_first).surroundings.measured_at == datetime(2026, 11, 5, 9, 5, tzinfo=UTC)
    month_first = surrounded("5/11/2026 9:05", "6/11/2026 9:05", "5/13/2026 9:05", "7/11/2026 9:05")
    assert read(month_first).surroundings.measured_at == datetime(2026, 5, 11, 9, 5, tzinfo=UTC)


@pytest.mark.parametrize(
    "cell", ["05/11/2026 9:00", "05-11-2026 09:00", "44873.678", "16:17:28", "2022-11-08", "31.02.2022 10:00",
             "8.11.22 10:00", "2022-11-08 25:00", "2022-11-08 13:00 PM"]
)  # fmt: skip
def test_times_that_are_not_clear_are_said(cell):
    imported = read(surrounded(cell, cell, cell, "2022-11-08 10:00"))
    assert imported.surroundings.measured_at is None
    (note,) = [note for note in imported.preview.assumptions if "times were not understood" in note]
    assert f"{cell!r} (3 rows)" in note
    assert "`measured_at`" in note


def test_temperatures_of_two_units_are_not_mixed():
    files = [(f"{state}.csv", surrounded("20", "21", "22", "23", header=f"Temperature [{unit}]")[1])
             for state, unit in (("a", "°C"), ("b", "°F"))]  # fmt: skip
    second = files[1][1].replace("c0", "d0")
    imported = read(files[0], ("b.csv", second))
    assert imported.surroundings.conditions == "temperature 20 to 23 °C, 20 to 23 °F"


def uncertain(header, *cells):
    head = f"name;x [mm];y [mm];z [mm];{header}\n"
    return head + "".join(f"{';'.join(row)};{cell}\n" for row, cell in zip(ROWS, cells, strict=True))


def test_uncertainties_of_points_and_of_coordinates_are_both_said():
    by_point = uncertain("U95 [mm]", *["0.03"] * 4)
    by_axis = uncertain("U95 x [mm];U95 y [mm];U95 z [mm]", *["0.01;0.01;0.01"] * 4).replace("_P10_", "_P11_")
    notes = " ".join(read(("a.csv", by_point), ("b.csv", by_axis)).preview.assumptions)
    assert "σ = U/1.96 (4 points)" in notes
    assert "for both states the root of the mean square (4 points)" in notes


def test_an_empty_position_needs_no_uncertainty():
    table = uncertain("U95 [mm]", "0.03", "0.03", "", "").replace(";".join(ROWS[2][1:]), ";;")
    table = table.replace(";".join(ROWS[3][1:]), ";;")
    imported = read(("a.csv", table), allow_missing=True)
    assert {label for label, _, _ in points_of(imported)} == {"c01"}


# ---- faults that hide others, or say the same many times


def test_an_empty_file_does_not_hide_the_faults_of_others():
    found = faults(("a.csv", " \n"), ("b.csv", CAMPAIGN.replace("-20.25", "?")))
    assert [(fault.place.file, fault.reason[:12]) for fault in found] == [
        ("a.csv", "the file is "),
        ("b.csv", "'?' is not a"),
    ]


def test_names_that_are_not_clear_for_one_reason_are_one_fault():
    table = "x [mm];y [mm];z [mm];name\n" + "".join(
        f"1;2;3.5;c{row}-P10-loaded-A_1_2_3\n" for row in range(40)
    )
    (fault,) = faults(("a.csv", table))
    assert fault.reason.startswith("the name 'c0-P10")
    assert fault.reason.endswith("and 39 other names are not clear either")


def test_labels_spelt_in_two_ways_are_one_fault_that_shows_both():
    joints = "label;J1 [deg];Fx [N];Fy [N];Fz [N]\n" + "".join(f"{row:02};1;0;0;-15\n" for row in (1, 2))
    found = faults(("j.csv", joints), ("p.csv", POINTS), units=MM)
    assert found[0].reason == "'c01' and 1 others have no joint, but other labels have: '01', '02'"
    assert "'c01', 'c02'" in found[0].remedy
    assert len([fault for fault in found if "joint" in fault.reason]) == 1


def test_a_header_without_a_unit_is_named_as_it_stands():
    (fault,) = faults(("a.csv", "label;x_t;y_t;z_t\nc01;1;2;3\n"))
    assert fault.reason == "'x_t', read as t x, has no unit, nor have 2 others"
    assert "`x_t [mm]`" in fault.remedy
    assert "`columns`, such as x_t=x" in fault.remedy


@pytest.mark.parametrize("content", ['{"measurement_set": {}}\n', '\ufeff [\n{"a": 1}\n]'])
def test_json_is_named_and_its_command_too(content):
    (fault,) = faults(("campaign.json", content))
    assert fault.reason == "the file is a JSON document, not a table"
    assert "jointstiff identify" in fault.remedy
    assert "jointstiff post" in fault.remedy


def test_a_name_is_not_taken_for_an_option():
    (fault,) = faults(("a.csv", "shift;x [mm];y [mm];z [mm]\nok;1;2;3.5\n"), ignore=["shift"])
    assert "`name`" not in fault.remedy  # the terminal would say `--name` for it


# ---- names and templates of what is made of the files


@pytest.mark.parametrize("file", [" .csv", "\u2028.csv", "a" * 240 + ".csv"])
def test_any_file_name_gives_a_name(file):
    poses = "name;J1 [deg];P unloaded x [mm];P unloaded y [mm];P unloaded z [mm]\nc01;1;2;3;4\n"
    answer = import_files(sources_of((file, poses)), ImportRequest())
    assert answer.poses.name == ("readings" if len(file) < 10 else "a" * 200)
    request = ImportRequest(encoders="motor", load_point=(0.0, 0.0, 120.0))
    assert import_files(sources_of((file, CAMPAIGN)), request).measurement_set.name == answer.poses.name


def test_files_beyond_what_a_template_holds_are_read_without_one():
    head, *rows = CAMPAIGN.splitlines()[1:]
    spare = [f"spare {number}" for number in range(256)]
    first = "\n".join([";".join([head, *spare[:240]]), *(row + ";1" * 240 for row in rows)])
    joints = [";".join(row.split(";")[:4]) for row in (head, *rows)]
    other = "\n".join([";".join([joints[0], *spare[240:]]), *(row + ";1" * 16 for row in joints[1:])])
    request = ImportRequest(encoders="motor", load_point=(0.0, 0.0, 120.0), ignore=spare)
    answer = import_files(sources_of(("a.csv", first + "\n"), ("b.csv", other + "\n")), request)
    assert (answer.measurement_set is not None, answer.template) == (True, None)


def test_long_headers_of_two_rows_are_read_without_a_template():
    head, *rows = CAMPAIGN.splitlines()[1:]
    long, below = "P" * 200, "position coordinate position coordinate position"
    groups = [f"{long} {header.split()[1]}" if "P10" in header else "" for header in head.split(";")]
    axes = [
        f"{below} {' '.join(header.split()[2:])}" if "P10" in header else header for header in head.split(";")
    ]
    content = "\n".join([";".join(groups), ";".join(axes), *rows]) + "\n"
    answer = import_files(
        sources_of(("a.csv", content)), ImportRequest(encoders="motor", load_point=(0.0, 0.0, 120.0))
    )
    assert (answer.measurement_set is not None, answer.template) == (True, None)
    assert answer.preview.targets == [long]


def test_a_load_point_in_metres_is_blamed_on_itself():
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)
    robot = prepare_robot(RobotDocument.model_validate(campaign["robot"])).robot
    table = table_of(campaign)
    request = ImportRequest(encoders="motor", load_point=(0.0, 0.0, 0.12), length_unit="mm")
    findings = import_files(sources_of(("a.csv", table)), request, robot).findings
    (finding,) = [one for one in findings if one.code == "length_unit_suspect"]
    assert finding.remedy == (
        "check the unit of `load_point`; the numbers seem to be in m, but are read as mm"
    )
