"""What is not understood for certain is asked about or refused, never guessed."""

from datetime import UTC, datetime

import pytest
from support.importing_samples import (
    CAMPAIGN,
    JOINTS,
    MM,
    POINTS,
    READ_POINTS,
    answered,
    faults,
    points_of,
    read,
    refused,
    sources_of,
    values_of,
)
from support.workbooks import table_of

from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.resources.imports import import_files
from jointstiff.simulator import default_arm, simulate_campaign

ROWS = [line.split(";") for line in POINTS.splitlines()]
NUMBERED = "name;P_0 x [mm];P_0 y [mm];P_0 z [mm];P_1 x [mm];P_1 y [mm];P_1 z [mm]\n"


def force_as(header):
    return CAMPAIGN.replace("Fz [N]", header)


# ---- words for states


def numbered(*names):
    return NUMBERED + "".join(f"{name};1;2;3.5;101;2;4.5\n" for name in names)


@pytest.mark.parametrize(
    ("file", "names", "options", "expected"),
    [
        ("day.csv", ("c01_loaded", "c01_unloaded"), {}, ("P_1", "unloaded", (101, 2, 4.5))),
        ("day.csv", ("c01_loaded", "c01_unloaded"), {}, ("P_0", "loaded", (1, 2, 3.5))),
        ("day.csv", ("L+c01", "U+c01"), {"point_name": "{state}+{label}"}, ("P_1", "loaded", (101, 2, 4.5))),
        ("day#loaded.csv", ("c01",), {"file_name": "{any}#{state}"}, ("P_0", "loaded", (1, 2, 3.5))),
        ("day#loaded.csv", ("c01",), {"file_name": "{any}#{state}"}, ("P_1", "loaded", (101, 2, 4.5))),
        ("day.csv", ("c01",), {}, ("P", "loaded", (101, 2, 4.5))),
    ],
)
def test_0_and_1_are_targets_where_names_say_the_state(file, names, options, expected):
    """Taken for states they would make a deflection of 100 mm."""
    found = points_of(read((file, numbered(*names)), **options))
    assert found["c01", *expected[:2]] == expected[2]
    assert faults(("day.csv", numbered("c01_loaded", "c02")))  # some names only


PROBE = "name;x [mm];y [mm];z [mm];Q0;Q1;Q2;Q3\n"


@pytest.mark.parametrize(
    ("content", "options", "reason"),
    [
        (CAMPAIGN, {"point_name": "{label}_{state}"}, "'{label}_{state}' is not needed"),
        (CAMPAIGN, {"file_name": "{target}"}, "'{target}' is not needed"),
        (CAMPAIGN, {"columns": {"P10 Loaded x": "P11 loaded x"}}, "no file has the header 'P10 Loaded x'"),
        (CAMPAIGN, {"ignore": ["shift"]}, "no file has the header 'shift'"),
        (
            "name;unloaded x [mm];unloaded y [mm];unloaded z [mm]\nc01_P10_loaded;1;2;3.5\n",
            {"point_name": "{label}_{target}_{state}"},
            "is not needed: headers or columns give the state",
        ),
        ("name;Y;x;Z\n" + POINTS, {"units": MM}, "are not spelt alike"),
        (PROBE + "".join(";".join([*row, "0.1;0.2;0.3;0.4\n"]) for row in ROWS), {}, "numbered from 1"),
        (force_as("K [Pfund]"), {"columns": {"K [Pfund]": "Fz [N]"}}, "'Pfund' is not a known unit of force"),
        (force_as("K N"), {"columns": {"K N": "Fz [kN]"}}, "is in N, but"),
        (force_as("K lbf"), {"columns": {"K lbf": "Fz [N]"}}, "'lbf' is not a known unit of force"),
        (force_as("K (kg)"), {"columns": {"K (kg)": "Fz [N]"}}, "'kg' is not a known unit of force"),
        (force_as("K [mm]"), {"columns": {"K [mm]": "Fz [N]"}}, "is in mm, but"),
        ('{"measurement_set": {}}\n', {}, "the file is a JSON document, not a table"),
        ('\ufeff [\n{"a": 1}\n]', {}, "the file is a JSON document, not a table"),
        ("label;J1 [deg];Fx [N];Fy [N];Fz [N]\nc01;1;0;0;-1471\nc02;2;0;0;-5\nc03;3;0;0;-14", {}, "cut off"),
    ],
)
def test_what_is_refused_first(content, options, reason):
    found = faults(("a.csv", content), **options)
    assert reason in found[0].reason
    if "JSON" in reason:
        assert "jointstiff identify" in found[0].remedy
        assert "jointstiff post" in found[0].remedy


@pytest.mark.parametrize(
    "word", ["StdDev", "Std.Dev", "stddev", "Unc", "Median", "RMSE", "Standardabweichung"]
)
def test_statistics_are_no_targets(word):
    between = CAMPAIGN.replace("P10 unloaded", f"P10 {word} before").replace(
        "P10 loaded", f"P10 {word} after"
    )
    for content in (between, CAMPAIGN.replace("P10 ", "P10StdDev ")):
        assert all(one.reason.startswith("unknown column header") for one in faults(("a.csv", content)))
    assert read(("a.csv", CAMPAIGN.replace("P10 ", "SD1 "))).preview.targets == ["SD1"]


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
    for other, named in ((world, "Frames::WORLD"), (listed(state="loaded"), "not named")):
        (fault,) = faults(listed(remark), other)
        assert fault.reason == f"the frame is {named}, but Frames::best fit in other files"
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


# ---- headers


REORDERED = {"y x z": (-310.1127, 1245.7134, 239.2014), "z y x": (239.2014, -310.1127, 1245.7134)}


@pytest.mark.parametrize(
    ("comment", "expected"),
    [
        ("# name y x z", REORDERED["y x z"]),
        ("# name, z, y, x", REORDERED["z y x"]),
        ("# y x z", "header"),
        ("# x y z name", "point_name"),
        ("# Name | Y | X | Z (mm)", "header"),
        ("# Punkt;Rechtswert;Hochwert;Höhe", "header"),
        ("# nom;abscisse;ordonnée;altitude", "header"),
        ("# R Theta Z", "header"),
        ("# E N U", "header"),
        ("# Nr. / Hochwert / Rechtswert / Höhe", "header"),
        ("# format: ID ZYX", "header"),
        ("# x, y, z of two states", READ_POINTS["c01", "P10", "unloaded"]),
        ("# name x y z", READ_POINTS["c01", "P10", "unloaded"]),
        ("# X  Y  Z (mm)", READ_POINTS["c01", "P10", "unloaded"]),
        ("# day 3", READ_POINTS["c01", "P10", "unloaded"]),
    ],
)
def test_a_comment_that_may_be_the_header_is_not_replaced(comment, expected):
    file = ("a.csv", f"{comment}\n{POINTS}")
    if isinstance(expected, str):
        assert faults(file, units=MM)[0].option == expected
    else:
        assert points_of(read(file, units=MM))["c01", "P10", "unloaded"] == expected


@pytest.mark.parametrize("header", ["Kraft_C_t_mean", "Kraft C (links)", "Kraft C N", "Kraft_x_m"])
def test_a_tail_that_is_no_unit_of_it_is_not_taken_for_one(header):
    found = read(("a.csv", force_as(header)), columns={header: "Fz [N]"})
    assert values_of(found) == values_of(read(("a.csv", CAMPAIGN)))
    measured = CAMPAIGN.replace("P10 unloaded x [mm]", "x_m")
    found = read(("a.csv", measured), columns={"x_m": "P10 unloaded x [mm]"})
    assert points_of(found) == points_of(read(("a.csv", CAMPAIGN)))


@pytest.mark.parametrize("word", ["Zoll", "pouces", "INCHES"])
def test_inches_are_read_in_three_languages(word):
    found = read(("a.csv", f"name;x [{word}];y [{word}];z [{word}]\n{POINTS.splitlines()[0]}\n"))
    inches = pytest.approx((31641.12036, -7876.86258, 6075.71556))
    assert points_of(found)["c01", "P10", "unloaded"] == inches


ROTATIONS = ["1;0;0;0", "0.7071;0;0;0.7071", "0.5;-0.5;0.5;0.5", "0;0;0;1"]


@pytest.mark.parametrize(("first", "rotations"), [(0, ROTATIONS), (1, ROTATIONS), (0, [";;;"] * 4)])
def test_a_rotation_is_known_by_its_numbers(first, rotations):
    head = ";".join(["name", "x [mm]", "y [mm]", "z [mm]", *(f"Q{first + part}" for part in range(4))])
    cells = [";".join([*row, turned]) for row, turned in zip(ROWS, rotations, strict=True)]
    imported = read(("a.csv", "\n".join([head, *cells]) + "\n"))
    assert points_of(imported) == READ_POINTS
    assert imported.preview.joint_count is None
    note = f"Q{first} to Q{first + 3} were ignored as the rotation"
    assert note in " ".join(imported.preview.files[0].assumptions)


TURNS = "label;Q{};Q{};Q{};Q{}\nc01;1;0;0;0\nc02;0.5;-0.5;0.5;-0.5\n"


@pytest.mark.parametrize(
    ("table", "options"),
    [
        (TURNS.format(1, 2, 3, 4).replace("1;0;0;0", "0.1;0.2;0.3;0.4"), {"units": MM}),
        (TURNS.format("1 [rad]", 2, 3, 4), {"units": MM | {"angle": "rad"}}),
        (TURNS.format(0, 1, 2, 3), {"columns": {f"Q{part}": f"J{part + 1} [rad]" for part in range(4)}}),
    ],
)
def test_angles_are_joints_by_their_numbers_their_unit_or_the_caller(table, options):
    values = values_of(read(("a.csv", table), **options))
    assert values["c02", "joint"] == (0.5, -0.5, 0.5, -0.5)
    assert values["c01", "joint"] == tuple(map(float, table.splitlines()[1].split(";")[1:]))


@pytest.mark.parametrize(("end", "unusual"), [("-12", True), ("-12\n", False), ("-5", False)])
def test_a_number_without_an_end_is_asked_about_unless_another_row_has_it(end, unusual):
    head = "label;J1 [deg];Fx [N];Fy [N];Fz [N]\nc01;1;0;0;-1471\nc02;2;0;0;-5\nc03;3;0;0;"
    asked = "the last number -12 ('a.csv', line 4, column 5), whose line has no end"
    assert read(("a.csv", head + end)).unusual == ((asked,) if unusual else ())
    assert read(("a.csv", CAMPAIGN.rstrip("\n"))).unusual == ()


@pytest.mark.parametrize(
    ("content", "options", "guessed"),
    [
        (CAMPAIGN, {}, []),
        (CAMPAIGN.replace("J1 [deg]", "J1_deg"), {}, [2]),
        ("# name x[mm] y[mm] z[mm]\n" + POINTS, {}, [1, 2, 3, 4]),
        (POINTS, {"units": MM}, [1, 2, 3, 4]),
        (force_as("Kraft N"), {"columns": {"Kraft N": "Fz"}}, [7]),
        (numbered("c01"), {}, [2, 3, 4, 5, 6, 7]),
    ],
)
def test_meanings_that_were_assumed_are_marked(content, options, guessed):
    columns = read(("a.csv", content), **options).preview.files[0].columns
    assert [column.column for column in columns if column.guessed] == guessed


# ---- times, temperatures, uncertainties


def surrounded(*cells, header="Time"):
    rows = "".join(";".join([row[0], cell, *row[1:]]) + "\n" for row, cell in zip(ROWS, cells, strict=True))
    return "a.csv", f"name;{header};x [mm];y [mm];z [mm]\n{rows}"


NOON = datetime(2022, 11, 8, 16, 17, 28, 353_000, UTC)


@pytest.mark.parametrize(
    ("cells", "header", "time"),
    [
        (["'08.11.2022 16:17:28.353"] * 4, "Time", NOON),
        (["2022-11-08T16:17:28.353"] * 4, "Time", NOON),
        (["2022-11-08 16:17:28,353Z"] * 4, "Zeit", NOON),
        (["8.11.2022 16:17:28.353"] * 4, "Datum", NOON),
        (["08.11.2022;16:17:28.353"] * 4, "Datum;Uhrzeit", NOON),
        (["16:17:28.353;2022-11-08"] * 4, "Time;Date", NOON),
        (["2022-11-08T18:17:28.353+02:00"] * 4, "Time", NOON),
        (["2022-11-08T18:17:28.353+0200"] * 4, "Time", NOON),
        (["2022-11-08T12:17:28.353-04:00"] * 4, "Time", NOON),
    ],
)
def test_times_that_are_clear_are_read(cells, header, time):
    assert read(surrounded(*cells, header=header)).surroundings.measured_at == time


@pytest.mark.parametrize(
    "cell", ["05/11/2026 9:00", "05-11-2026 09:00", "44873.678", "16:17:28", "2022-11-08", "31.02.2022 10:00",
             "8.11.22 10:00", "2022-11-08 25:00", "2022-11-08 13:00 PM", "2022-11-08 10:00:60",
             "13/11/2026 9:05", "2022/11/8 4:17:28.353 PM", "2022/11/08, 16:17:28.353"]
)  # fmt: skip
def test_times_that_are_not_clear_are_said(cell):
    imported = read(surrounded(cell, cell, cell, "2022-11-08 10:00"))
    assert imported.surroundings.measured_at is None
    (note,) = [note for note in imported.preview.assumptions if "times were not understood" in note]
    assert f"{cell!r} (3 rows)" in note
    assert "`measured_at`" in note


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
    imported = read(("a.csv", table.replace(";".join(ROWS[3][1:]), ";;")), allow_missing=True)
    assert {label for label, _, _ in points_of(imported)} == {"c01"}


# ---- faults that hide others, or say the same many times

UNCLEAR = "x [mm];y [mm];z [mm];name\n" + "".join(f"1;2;3.5;c{row}-P10-A_1_2_3\n" for row in range(40))
OTHERWISE = "label;J1 [deg];Fx [N];Fy [N];Fz [N]\n01;1;0;0;-15\n02;1;0;0;-15\n"


@pytest.mark.parametrize(
    ("files", "options", "reasons", "remedy"),
    [
        (
            [("a.csv", " \n"), ("b.csv", CAMPAIGN.replace("-20.25", "?"))],
            {},
            ["the file is empty", "'?' is not a number with a decimal point"],
            "check the export",
        ),
        (
            [("a.csv", UNCLEAR)],
            {},
            [
                "the name 'c0-P10-A_1_2_3' does not show which observation, target and state it is, "
                "and 39 other names are not clear either"
            ],
            "point_name",
        ),
        (
            [("j.csv", OTHERWISE), ("p.csv", POINTS)],
            {"units": MM},
            [
                "'c01' and 1 others have no joint, but other labels have: '01', '02'",
                "'c01' and 1 others have no force, but other labels have: '01', '02'",
                "01: target P10 has no reading",
                "02: target P10 has no reading",
            ],
            "'c01', 'c02'",
        ),
        (
            [("a.csv", "label;x_t;y_t;z_t\nc01;1;2;3\n")],
            {},
            ["'x_t', read as t x, has no unit, nor have 2 others"],
            "`x_t [mm]`, or give `units`; if it means something else, give `columns`, such as x_t=x",
        ),
    ],
)
def test_faults_are_told_once(files, options, reasons, remedy):
    found = faults(*files, **options)
    assert [fault.reason for fault in found] == reasons
    assert remedy in found[0].remedy


def test_a_name_is_not_taken_for_an_option():
    fault = refused(
        ("a.csv", "shift;x [mm];y [mm];z [mm]\nok;1;2;3.5\n"), line=1, ignore=["shift"], reason="no column"
    )
    assert "`name`" not in fault.remedy  # the terminal would say `--name` for it


# ---- names and templates of what is made of the files


@pytest.mark.parametrize("file", [" .csv", "\u2028.csv", "a" * 240 + ".csv"])
def test_any_file_name_gives_a_name(file):
    poses = "name;J1 [deg];P unloaded x [mm];P unloaded y [mm];P unloaded z [mm]\nc01;1;2;3;4\n"
    name = "readings" if len(file) < 10 else "a" * 200
    assert import_files(sources_of((file, poses)), ImportRequest()).poses.name == name
    assert answered((file, CAMPAIGN)).measurement_set.name == name


def wide():
    """Two files of more headers than a template holds."""
    head, *rows = CAMPAIGN.splitlines()[1:]
    spare = [f"spare {number}" for number in range(256)]
    first = "\n".join([";".join([head, *spare[:240]]), *(row + ";1" * 240 for row in rows)])
    joints = [";".join(row.split(";")[:4]) for row in (head, *rows)]
    other = "\n".join([";".join([joints[0], *spare[240:]]), *(row + ";1" * 16 for row in joints[1:])])
    return [("a.csv", first + "\n"), ("b.csv", other + "\n")], {"ignore": spare}


def long():
    """A file whose headers of two rows are longer than those of a template."""
    head, *rows = CAMPAIGN.splitlines()[1:]
    name, below = "P" * 200, "position coordinate position coordinate position"
    headers = [header.split() for header in head.split(";")]
    groups = [f"{name} {words[1]}" if "P10" in words else "" for words in headers]
    axes = [" ".join([below, *words[2:]] if "P10" in words else words) for words in headers]
    return [("a.csv", "\n".join([";".join(groups), ";".join(axes), *rows]) + "\n")], {}


@pytest.mark.parametrize("files", [wide, long])
def test_files_beyond_what_a_template_holds_are_read_without_one(files):
    contents, options = files()
    answer = answered(*contents, **options)
    assert (answer.measurement_set is not None, answer.template) == (True, None)
    assert answer.preview.targets == (["P" * 200] if files is long else ["P10"])


def test_a_load_point_in_metres_is_blamed_on_itself():
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)
    robot = prepare_robot(RobotDocument.model_validate(campaign["robot"])).robot
    request = ImportRequest(encoders="motor", load_point=(0.0, 0.0, 0.12), length_unit="mm")
    findings = import_files(sources_of(("a.csv", table_of(campaign))), request, robot).findings
    (finding,) = [one for one in findings if one.code == "length_unit_suspect"]
    small = "the numbers seem to be in m, but are read as mm"
    assert finding.remedy == f"check the unit of `load_point`; {small}"
