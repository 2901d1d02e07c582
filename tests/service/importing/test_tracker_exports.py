"""Exports of measuring software: frames, units, comments, uncertainties, times, other instruments."""

import pytest
from support.importing_samples import (
    JOINTS,
    LEICA,
    MM,
    POINTS,
    READ_POINTS,
    SPATIAL_ANALYZER,
    TRACKER,
    answered,
    meanings_of,
    points_of,
    read,
    refusals,
)


def exported(*edits):
    """Return the file of SpatialAnalyzer with edits."""
    text = SPATIAL_ANALYZER
    for old, new in edits:
        text = text.replace(old, new)
    return "a.txt", text


def test_groups_and_collections_of_spatial_analyzer_are_labels_and_states():
    imported = read(exported())
    assert points_of(imported) == {
        ("c01", "P10", "unloaded"): (1.0, 2.0, 4.5),
        ("c01", "P10", "loaded"): (1.0, 2.0, 4.0),
    }
    assert imported.preview.files[0].assumptions == [
        "comments were skipped (3 lines); the first: 'SpatialAnalyzer'",
        "positions are in the frame 'A::R0', as the file states",
        "positions are in mm, as the file states",
    ]


def test_inches_that_a_comment_states_are_converted():
    imported = read(exported(("(mm)", "(Inches)"), ("Collection", "// Collection"), ("Point", "Target")))
    assert points_of(imported)["c01", "P10", "unloaded"] == pytest.approx((25.4, 50.8, 114.3))
    assert imported.preview.files[0].assumptions[1:] == [
        "the comment in line 4 was used as the header",
        "positions are in the frame 'A::R0', as the file states",
        "positions are in inches, as the file states",
        "lengths in inches, also those in the options, were converted to mm",
    ]


OF_POINTS = (
    "U(95) was read as the expanded uncertainty of each point, that is the root of the sum of the squares "
    "for x, y and z: σ = U/(1.96 √3); the σ of a reading is the root mean square over its two positions"
)
OF_COORDINATES = "U(95) X, Y, Z was read as the expanded uncertainty of each coordinate: σ = U/1.96"
FIRST = "time of the first reading, in UTC if the file names no time zone: "


def test_the_uncertainty_of_points_is_that_of_their_readings():
    joints = "joints.csv", "\n".join(JOINTS.splitlines()[:2])
    answer = answered(joints, ("leica.csv", LEICA))
    (reading,) = answer.measurement_set.observations[0].readings
    assert reading.sigma == pytest.approx((0.03**2 / 2 + 0.04**2 / 2) ** 0.5 / (1.96 * 3**0.5), rel=1e-9)
    assert (reading.unloaded, reading.loaded) == ((1.5, 2.25, 3.5), (1.5, 2.25, 3.1))
    assert answer.measurement_set.measured_at.isoformat() == "2026-11-20T10:00:01+00:00"
    assert (answer.uncertainty, answer.assumptions) == (
        "point",
        [OF_POINTS, f"{FIRST}2026-11-20 10:00:01+00:00"],
    )
    assert answer.files[1].assumptions == [
        "every row ends with a delimiter; the empty last column was ignored"
    ]
    assert refusals(joints, ("leica.csv", LEICA), noise={"sigma": 0.01}) == [
        "the files give the uncertainty of each reading, and `noise` states another uncertainty; "
        "omit `noise`, or skip the columns of U(95) with `ignore` [noise]"
    ]
    assert answered(("a.csv", LEICA), ignore=["U(95) [mm]"]).uncertainty is None


def test_an_uncertainty_of_zero_is_rounded():
    answer = answered(("a.csv", LEICA.replace("0.04", "0")))
    assert (
        answer.assumptions[-1] == "an uncertainty U(95) of 0, rounded to 1 µm, was read as 0.5 µm (1 cells)"
    )


def test_uncertainties_of_coordinates_make_covariances():
    answer = answered(("joints.csv", JOINTS), ("tracker.csv", TRACKER))
    (reading,) = answer.measurement_set.observations[1].readings
    for covariance in (reading.unloaded_covariance, reading.loaded_covariance):
        assert [covariance[i][i] for i in range(3)] == pytest.approx(
            [(0.031 / 1.96) ** 2, (0.012 / 1.96) ** 2, (0.0005 / 1.96) ** 2], rel=1e-9
        )
        assert covariance[0][1] == covariance[1][2] == covariance[2][0] == 0.0
    assert reading.unloaded == (1102.5518, 402.9017, 318.4406)
    assert answer.measurement_set.measured_at.isoformat() == "2022-11-08T16:10:28.353000+00:00"
    assert answer.uncertainty == "coordinate"
    assert answer.assumptions == [
        "tracker.csv: the column of targets was read as the instrument's reflector",
        OF_COORDINATES,
        f"{FIRST}2022-11-08 16:10:28+00:00",
        "an uncertainty U(95) of 0, rounded to 1 µm, was read as 0.5 µm (4 cells)",
    ]
    assert meanings_of(answer, 1)[4:] == [
        "U95 x [mm]", "U95 y [mm]", "U95 z [mm]", "target", "ignored", "time", "deleted"
    ]  # fmt: skip


def test_a_column_of_targets_names_them_where_names_do_not():
    assert answered(("tracker.csv", TRACKER.replace("_P10", ""))).targets == ["CCR 1.5in"]


def test_rows_that_are_marked_as_deleted_are_left_out():
    deleted = "".join(
        row.replace("False", "True") if row.startswith("c02") else row
        for row in TRACKER.splitlines(keepends=True)
    )
    answer = answered(("tracker.csv", deleted))
    assert (answer.first_labels, answer.reading_count) == (["c01"], 1)
    assert answer.files[0].assumptions[-1] == "rows marked as deleted were omitted: 2"


def uncertain(header, cell, points=POINTS):
    """Write a list of points with an uncertainty."""
    return f"name;x [mm];y [mm];z [mm];{header}\n" + "".join(f"{row};{cell}\n" for row in points.splitlines())


def test_points_and_coordinates_may_be_uncertain_side_by_side():
    unloaded, loaded = (
        "\n".join(row for row in POINTS.splitlines() if word in row) for word in ("_un", "_lo")
    )
    answer = answered(
        ("joints.csv", JOINTS),
        ("unloaded.csv", uncertain("U95 [mm]", "0.03", unloaded)),
        ("loaded.csv", uncertain("U95 x [mm];U95 y [mm];U95 z [mm]", "0.01;0.02;0.04", loaded)),
    )
    (reading,) = answer.measurement_set.observations[0].readings
    variances = [
        [one[i][i] for i in range(3)] for one in (reading.unloaded_covariance, reading.loaded_covariance)
    ]
    assert variances[0] == pytest.approx([(0.03 / 1.96) ** 2 / 3] * 3, rel=1e-9)
    assert variances[1] == pytest.approx([(each / 1.96) ** 2 for each in (0.01, 0.02, 0.04)], rel=1e-9)
    assert answer.uncertainty == "coordinate"
    assert answer.assumptions[:2] == [f"{OF_COORDINATES} (2 points)", f"{OF_POINTS} (2 points)"]


def timed(cell, header="Time"):
    """Write the list of points with a column, or two, of times."""
    rows = "".join(row.replace(";", f";{cell};", 1) + "\n" for row in POINTS.splitlines())
    return "a.csv", f"name;{header};x [mm];y [mm];z [mm]\n{rows}"


@pytest.mark.parametrize(
    ("cell", "header", "time"),
    [
        ("'08.11.2022 16:17:28.353", "Time", "2022-11-08 16:17:28+00:00"),
        ("2022-11-08 16:17:28,353Z", "Zeit", "2022-11-08 16:17:28+00:00"),
        ("08.11.2022;16:17:28.353", "Datum;Uhrzeit", "2022-11-08 16:17:28+00:00"),
        ("16:17:28.353;2022-11-08", "Time;Date", "2022-11-08 16:17:28+00:00"),
        ("8.11.2022 16:17:28.353", "Datum", "2022-11-08 16:17:28+00:00"),
        ("2022-11-08T16:17:28.353", "Time", "2022-11-08 16:17:28+00:00"),
        ("2022-11-08T18:17:28.353+0200", "Time", "2022-11-08 18:17:28+02:00"),
        ("2022-11-08T12:17:28.353-04:00", "Time", "2022-11-08 12:17:28-04:00"),
    ],
)
def test_a_time_is_read_with_its_zone(cell, header, time):
    answer = answered(timed(cell, header))
    assert answer.assumptions == [f"{FIRST}{time}"]
    assert answer.reading_count == 2


@pytest.mark.parametrize(
    "cell",
    [
        "05/11/2026 9:00", "05-11-2026 09:00", "44873.678", "16:17:28", "2022-11-08", "31.02.2022 10:00",
        "8.11.22 10:00", "2022-11-08 25:00", "2022-11-08 13:00 PM", "2022-11-08 10:00:60", "13/11/2026 9:05",
        "2022/11/8 4:17:28.353 PM", "2022/11/08, 16:17:28.353",
    ],
)  # fmt: skip
def test_a_time_that_can_be_read_in_two_ways_or_none_is_not_used(cell):
    assert answered(timed(cell)).assumptions == [
        f"times were not understood and not used, such as '{cell}' (4 rows): give the time with `measured_at`"
    ]


def listed(*remarks, state="unloaded"):
    """Write the points of one state below remarks."""
    rows = [row for row in POINTS.splitlines() if f"_{state};" in row]
    return f"{state}.csv", "\n".join([*remarks, "name;x [mm];y [mm];z [mm]", *rows, ""])


@pytest.mark.parametrize(
    "remark",
    [
        "// Points Relative to Coordinate Frame 'A::fit'",
        "\"// Points Relative to Coordinate Frame 'A::fit'\"",
        "Points Relative to Coordinate Frame 'A::fit'",
        "# Frame: A::fit", "Frame;A::fit", "Koordinatensystem: A::fit", "# Repère : A::fit",
        "% FRAME = A::fit", "# Working frame A::fit", "# Reference system: A::fit",
    ],
)  # fmt: skip
def test_files_in_two_frames_are_refused(remark):
    assert refusals(listed(remark), listed("// FRAME = WORLD", state="loaded")) == [
        "loaded.csv: the frame is WORLD, but A::fit in other files; "
        "export all files in one frame; add a line `# Frame: NAME` to a file that names no frame"
    ]


@pytest.mark.parametrize(
    ("remark", "unit"),
    [
        ("# Units: meters", "meters"), ("Units;m", "m"), ("# Einheit: Zoll", "Zoll"),
        ("# coordinates [m]", "m"),
        ("// positions in meters", "meters"), ("# Units: m, deg, N", "m"), ("# Unités : pouces", "pouces"),
        ("# x y z [m]", "m"), ("# Length unit = cm", "cm"), ("Einheit m", "m"),
        ("# Maßeinheit: Meter", "Meter"), ("# coordonnées en mètres", "mètres"),
    ],
)  # fmt: skip
def test_a_remark_with_another_unit_than_the_header_is_refused(remark, unit):
    assert refusals(listed(remark)) == [
        f"unloaded.csv:1: '{unit}' is given here, but lengths are in mm; "
        "correct the unit, or remove the remark [units.length]"
    ]


def test_a_remark_with_an_unknown_unit_is_refused():
    assert refusals(listed("Units: furlongs")) == [
        "unloaded.csv:1: the unit 'furlongs' is not known; correct or remove the remark"
    ]


@pytest.mark.parametrize(
    "remark",
    [
        "# x, y, z in robot base coordinates", "// X Y Z (left handed)", "# Units: mm", "# Units: mm, deg, N",
        "# unit of the cell", "# Measuring unit: Leica AT960", "# Durchmesser 38.1 mm",
        "# reflector of 1.5 inch",
        "# tracker 2 m away (warm)", "# ( x64 )", "# units of cm were used",
    ],
)  # fmt: skip
def test_a_remark_that_states_no_other_unit_is_skipped(remark):
    imported = read(listed(remark))
    assert points_of(imported) == {key: place for key, place in READ_POINTS.items() if key[2] == "unloaded"}
    said = f"comments were skipped (1 line); the first: '{remark.lstrip('#/ ')}'"
    assert imported.preview.files[0].assumptions == [said]
    assert imported.preview.files[0].columns[1].unit == "mm"


@pytest.mark.parametrize(
    ("comment", "order"),
    [
        ("# name y x z", "yxz"),
        ("# name, z, y, x", "zyx"),
        ("# name x y z", "xyz"),
        ("# name x[mm] y[mm] z[mm]", "xyz"),
    ],
)
def test_a_comment_that_names_the_columns_is_their_header(comment, order):
    imported = read(("a.csv", f"{comment}\n{POINTS}"), units=MM)
    columns = dict(zip(order, zip(*READ_POINTS.values(), strict=True), strict=True))
    assert list(points_of(imported).values()) == list(zip(*(columns[axis] for axis in "xyz"), strict=True))
    assert imported.preview.files[0].assumptions[1] == "the comment in line 1 was used as the header"


@pytest.mark.parametrize("comment", ["x, y, z of two states", "X  Y  Z (mm)", "day 3"])
def test_a_comment_that_changes_no_order_is_skipped(comment):
    imported = read(("a.csv", f"# {comment}\n{POINTS}"), units=MM)
    assert points_of(imported) == READ_POINTS
    assert imported.preview.files[0].assumptions[:2] == [
        f"comments were skipped (1 line); the first: '{comment}'",
        "no header found; assumed columns: name, x, y, z",
    ]


@pytest.mark.parametrize(
    "comment",
    [
        "y x z", "Name | Y | X | Z (mm)", "Punkt;Rechtswert;Hochwert;Höhe", "nom;abscisse;ordonnée;altitude",
        "R Theta Z", "E N U", "Nr. / Hochwert / Rechtswert / Höhe", "format: ID ZYX",
    ],
)  # fmt: skip
def test_a_comment_that_may_be_another_order_is_asked_about(comment):
    assert refusals(("a.csv", f"# {comment}\n{POINTS}"), units=MM) == [
        f"a.csv:1: the comment '{comment}' looks like a header, but is not understood as the header of the 4 "
        "columns; correct or remove the comment, or give `header` [header]"
    ]


def with_columns(head, row):
    """Write the list of points in the columns of another instrument."""
    rows = (dict(zip("nxyz", line.split(";"), strict=True)) for line in POINTS.splitlines())
    return "a.csv", "\n".join([head, *(row.format(**each) for each in rows)]) + "\n"


@pytest.mark.parametrize(
    ("head", "row"),
    [
        ("Name;Object Type;X;Y;Z;Probe Radius", "{n};Point;{x};{y};{z};19.05"),
        ("Name;Frame;Sub Frame;RX;RY;RZ;TX [mm];TY [mm];TZ [mm]", "{n};17;0;0.1;0.2;0.3;{x};{y};{z}"),
        ("Name;Actual X [mm];Actual Y [mm];Actual Z [mm];Upper Tol;Lower Tol", "{n};{x};{y};{z};0.1;-0.1"),
        ("Point;X;Y;Z;Temp;Press;Hum;Azimuth;Elevation;Distance", "{n};{x};{y};{z};20;1013;40;1;2;3"),
        (
            "Name;Tool ID;Port;Frame;Face;Status;Q0;Qx;Qy;Qz;Tx [mm];Ty [mm];Tz [mm];Error;Markers",
            "{n};1;A;77;0;OK;1;0;0;0;{x};{y};{z};0.02;4",
        ),
    ],
)
def test_columns_of_other_instruments_are_skipped(head, row):
    assert points_of(read(with_columns(head, row), units={"length": "mm"})) == READ_POINTS


def rotated(*quaternions):
    """Write the list of points, each with the rotation of a probe."""
    rows = zip(POINTS.splitlines(), quaternions, strict=True)
    return "a.csv", "name;x [mm];y [mm];z [mm];Q0;Q1;Q2;Q3\n" + "".join(f"{row};{q}\n" for row, q in rows)


def test_quaternions_are_the_rotation_of_a_probe_and_other_numbers_joints():
    imported = read(rotated("1;0;0;0", "0.7071;0;0;0.7071", "0.5;-0.5;0.5;0.5", "0;0;0;1"))
    assert points_of(imported) == READ_POINTS
    assert imported.preview.files[0].assumptions == ["Q0 to Q3 were ignored as the rotation of a probe"]
    assert [
        each.partition(";")[0]
        for each in refusals(rotated("1;0;0;0", "0.1;0.2;0.3;0.4", "0.5;-0.5;0.5;0.5", "0;0;0;1"))
    ] == ["a.csv:1:5: joint 1 and 3 other columns have no unit"]
    joints = "label;Q1;Q2;Q3;Q4\nc01;0.1;0.2;0.3;0.4\nc02;0.5;-0.5;0.5;-0.5\n"
    assert meanings_of(answered(("a.csv", joints), units=MM))[1:3] == ["joint 1 [deg]", "joint 2 [deg]"]


@pytest.mark.parametrize(
    ("header", "target"),
    [
        ("tip along z [mm]", "tip"), ("dial gauge z [mm]", "dial gauge"),
        ("Messuhr 1 z [mm]", "Messuhr 1"), ("LVDT dz [mm]", "LVDT"),
    ],
)  # fmt: skip
def test_a_gauge_reads_along_one_axis(header, target):
    table = f"label;J1 [deg];Fx [N];Fy [N];Fz [N];{header}\nc01;1;0;0;-100;0.25\nc02;2;0;0;-100;-0.5\n"
    answer = answered(("a.csv", table), flange_targets={target: (0, 0, 50)})
    readings = [one.readings[0] for one in answer.measurement_set.observations]
    assert [each.displacement for each in readings] == [0.25, -0.5]
    assert {each.direction for each in readings} == {(0.0, 0.0, 1.0)}
    assert answered(("a.csv", table)).missing_fields == ["flange_targets"]
    assert meanings_of(answer)[-1] == f"{target} along z [mm]{'' if target == 'tip' else '?'}"
