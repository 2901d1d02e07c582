"""Files as instruments and people write them: SpatialAnalyzer 2022, Leica's columns, words for states."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import pytest
from support.importing_samples import CAMPAIGN, JOINTS, answered, faults, points_of, read
from support.importing_samples import READ_POINTS as READ

# ---- SpatialAnalyzer 2022


SA = """// SpatialAnalyzer SA 2022.2.0624.7 ( x64 )
// Points Relative to Coordinate Frame '{frame}'
// AXES = CARTESIAN: X,  Y,  Z ({unit})
// Collection,  Group,  Point,  X,  Y,  Z

"""


def sa(gap=", ", unit="mm", frame="Frames::WORLD", states=("unloaded", "loaded")):
    scale = {"mm": 1.0, "Inches": 25.4}[unit]
    rows = [
        gap.join([f"{state}", label, target, *(f"{value / scale:.9f}" for value in xyz)])
        for (label, target, state), xyz in READ.items()
        if state in states
    ]
    return SA.format(unit=unit, frame=frame) + "\n".join(rows) + "\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
@pytest.mark.parametrize("gap", [",", ", ", ",  ", "  "])
@pytest.mark.parametrize("unit", ["mm", "Inches"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_spatial_analyzer_2022(encoding, gap, unit, end):
    content = sa(gap, unit).replace("\n", end).encode(encoding)
    imported = read(("day 1.txt", content))
    assert imported.units == {"length": "mm"}
    for key, xyz in points_of(imported).items():
        assert xyz == pytest.approx(READ[key], abs=1e-7)
    assert len(points_of(imported)) == 4
    assert any("the frame 'Frames::WORLD'" in note for note in imported.preview.files[0].assumptions)


def test_groups_with_brackets_and_several_files():
    files = []
    for state in ("unloaded", "loaded"):
        bracketed = sa(states=(state,)).replace(f"{state}, ", f"{state}, Cell [3] ")
        files.append((f"{state}.txt", bracketed.replace("// Coll", "//  Coll")))
    assert {(f"Cell [3] {a}", b, c): xyz for (a, b, c), xyz in READ.items()} == points_of(read(*files))


def test_files_of_two_frames_are_refused_with_both_names():
    other = sa(frame="Frames::best fit", states=("loaded",))
    (fault,) = faults(("a.txt", sa(states=("unloaded",))), ("b.txt", other))
    assert fault.reason == "the frame is Frames::best fit, but Frames::WORLD in other files"
    (fault,) = faults(("a.txt", sa(unit="Inches")), units={"length": "mm"})
    assert fault.reason == "position x is in inches by the file's comment, but in mm by `units`"


# ---- Leica


HEADERS = [
    "Name", "X  [mm]", "Y  [mm]", "Z  [mm]", "U(95)  [mm]", "U(95) X  [mm]", "U(95) Y  [mm]", "U(95) Z  [mm]",
    "Tilt  [deg]", "Q0 ", "Q1 ", "Q2 ", "Q3 ", "Image RMS  [µm]", "Target", "Temperature  [°C]",
    "Pressure  [mBar]", "Humidity  [%]", "Time Stamp", "OTG Applied", "Delete",
]  # fmt: skip
U95 = (0.031, 0.012, 0.0)


def leica_rows(*, deleted=()):
    total = sum(u * u for u in U95) ** 0.5
    rows = []
    for index, ((label, target, state), xyz) in enumerate(READ.items()):
        name = f"{label}_{target}_{state}"
        rows.append([
            name, *(f"{value:.4f}" for value in xyz), f"{total:.6f}", *(f"{u:.3f}" for u in U95),
            "0.00", "0.7071", "0.0", "0.0", "0.7071", "3", "CCR 1.5in", f"2{index}.5", "1013.2", "41.0",
            f"'08.11.2022 16:1{index}:28.353", "False", str(index in deleted),
        ])  # fmt: skip
    return rows


def leica(
    delimiter=",", mark=".", order=1, encoding="latin-1", end="\r\n", trailing=True, without=(), **options
):
    """Leica's table; names are last if `order` is -1."""
    kept = [index for index, header in enumerate(HEADERS) if header not in without][::order]
    lines = []
    for row in [HEADERS, *leica_rows(**options)]:
        cells = [row[index] for index in kept]
        cells = [cell.replace(".", mark) if re.fullmatch(r"-?\d+\.\d+", cell) else cell for cell in cells]
        lines.append(delimiter.join(cells) + (delimiter if trailing else ""))
    return (end.join(lines) + end).encode(encoding)


@pytest.mark.parametrize(
    "form",
    [
        {},
        {"encoding": "utf-8"},
        {"encoding": "utf-16"},
        {"end": "\n"},
        {"end": "\r"},
        {"trailing": False},
        {"delimiter": ";"},
        {"delimiter": ";", "mark": ","},
        {"delimiter": "\t", "mark": ","},
        {"order": -1},
        {"order": -1, "delimiter": "\t", "encoding": "utf-8-sig"},
        {"without": ("Tilt  [deg]", "OTG Applied", "U(95)  [mm]")},
    ],
)
def test_leicas_columns(form):
    imported = read(("tracker.csv", leica(**form)))
    assert points_of(imported) == READ
    assert imported.preview.joint_count is None  # Q1 to Q3 are a rotation
    assert imported.preview.uncertainty == "coordinate"
    point = imported.observations[0].points["P10"]["loaded"]
    assert point.sigma == pytest.approx((0.031 / 1.96, 0.012 / 1.96, 0.0005 / 1.96), rel=1e-12)
    assert imported.surroundings.measured_at == datetime(2022, 11, 8, 16, 10, 28, 353_000, UTC)


def test_uncertainties_of_coordinates_become_covariances():
    answer = answered(("joints.csv", JOINTS), ("tracker.csv", leica()))
    reading = answer.measurement_set.observations[0].readings[0]
    assert reading.sigma is None
    diagonal = [row[index] for index, row in enumerate(reading.unloaded_covariance)]
    assert diagonal == pytest.approx([(u / 1.96) ** 2 for u in (0.031, 0.012, 0.0005)], rel=1e-12)
    assert reading.unloaded_covariance[0][1:] == (0.0, 0.0)
    notes = " ".join(answer.preview.assumptions)
    assert "σ = U/1.96" in notes
    assert "U(95) of 0 is rounded to 1 µm, and was read as 0.5 µm (4 cells)" in notes
    assert answer.measurement_set.measured_at == datetime(2022, 11, 8, 16, 10, 28, 353_000, UTC)


def test_the_points_uncertainty_only_where_its_coordinates_have_none():
    axes = [header for header in HEADERS if re.match(r"U\(95\) [XYZ]", header)]
    answer = answered(("joints.csv", JOINTS), ("tracker.csv", leica(without=axes)))
    sigma = float(f"{sum(u * u for u in U95) ** 0.5:.6f}") / (1.96 * 3**0.5)
    assert answer.measurement_set.observations[1].readings[0].sigma == pytest.approx(sigma, rel=1e-12)
    assert answer.preview.uncertainty == "point"
    assert any("σ = U/(1.96 √3)" in note for note in answer.preview.assumptions)
    neither = answered(("joints.csv", JOINTS), ("tracker.csv", leica(without=[*axes, "U(95)  [mm]"])))
    assert neither.measurement_set.observations[0].readings[0].sigma is None
    assert neither.preview.uncertainty is None


def test_rows_marked_delete_are_left_out_and_counted():
    imported = read(("tracker.csv", leica(deleted=(2, 3))))
    assert {label for label, _, _ in points_of(imported)} == {"c01"}
    assert "rows marked as deleted were left out: 2" in imported.preview.files[0].assumptions
    (fault,) = faults(("tracker.csv", leica(deleted=(3,))))
    assert fault.reason == "c02: target P10 was read only unloaded"
    (fault,) = faults(("tracker.csv", leica().replace(b"False,\r\n", b"perhaps,\r\n", 1)))
    assert "does not show whether the row is deleted" in fault.reason


def test_leicas_target_is_its_reflector_unless_nothing_else_names_one():
    content = leica().replace(b"_P10", b"")
    labels = {(label, target) for label, target, _ in points_of(read(("tracker.csv", content)))}
    assert labels == {("c01", "CCR 1.5in"), ("c02", "CCR 1.5in")}
    loaded = "\n".join(line for line in content.decode("latin-1").splitlines() if "_unloaded" not in line)
    named = read(("P7_loaded.csv", loaded.replace("_loaded", "") + "\n"))
    assert {(target, state) for _, target, state in points_of(named)} == {("P7", "loaded")}


# ---- words for states


@pytest.mark.parametrize(
    ("unloaded", "loaded"),
    [
        ("before", "after"), ("vorher", "nachher"), ("avant", "après"), ("0", "1"), ("ohne", "mit"),
        ("off", "on"), ("Before", "AFTER"), ("sans", "avec"), ("unloaded", "loaded"),
    ],
)  # fmt: skip
def test_words_for_states(unloaded, loaded):
    def written(text):
        text = text.replace("unloaded", unloaded)
        return text.replace(" loaded", f" {loaded}").replace("_loaded", f"_{loaded}")

    plain = points_of(read(("a.csv", CAMPAIGN)))
    assert points_of(read(("a.csv", written(CAMPAIGN)))) == plain
    names = "".join(f"{a}_{b}_{c};{x};{y};{z}\n" for (a, b, c), (x, y, z) in READ.items())
    assert points_of(read(("a.csv", written(names)), units={"length": "mm"})) == READ
    column = "label;target;state;x [mm];y [mm];z [mm]\n" + "".join(
        f"{a};{b};{unloaded if c == 'unloaded' else loaded};{x};{y};{z}\n"
        for (a, b, c), (x, y, z) in READ.items()
    )
    assert points_of(read(("a.csv", column))) == READ


def test_digits_are_states_only_where_nothing_else_can_be_meant():
    """A target may be called 1, and a file may say that all of its points are loaded."""
    header = ";".join(["label", *(f"SMR {number} {axis} [mm]" for number in "01" for axis in "xyz")])
    assert points_of(read(("loaded.csv", f"{header}\nc01;1;2;3;4;5;6.5\n"))) == {
        ("c01", "SMR 0", "loaded"): (1, 2, 3),
        ("c01", "SMR 1", "loaded"): (4, 5, 6.5),
    }
    names = "c01_P1_0 1 2 3.5\nc01_P1_1 1 2 4.5\n"
    assert "does not show which" in faults(("loaded.txt", names), units={"length": "mm"})[0].reason
    digits = read(("day.txt", names), units={"length": "mm"})
    assert points_of(digits)["c01", "P1", "loaded"] == (1, 2, 4.5)
    assert "0 and 1 in names were read as `unloaded` and `loaded`" in digits.preview.assumptions


def test_unknown_words_for_states_are_asked_about_once():
    """Fifteen columns of five targets are one question, and the targets keep their names."""
    header, states = ["label"], {"pre": "unloaded", "post": "loaded"}
    header += [f"P{t} {s} {a} [mm]" for t in range(1, 6) for s in states for a in "xyz"]
    rows = [";".join([f"c{row:02}", *(f"{row + i}.5" for i in range(30))]) for row in range(12)]
    content = "\n".join([";".join(header), *rows]) + "\n"
    (fault,) = faults(("a.csv", content))
    assert (fault.option, fault.words) == ("state_words", ("pre", "post"))
    imported = read(("a.csv", content), state_words=states)
    assert imported.preview.targets == ["P1", "P2", "P3", "P4", "P5"]
    assert imported.preview.states == ["unloaded", "loaded"]


# ---- headers as a whole, files that were cut off, values far from all others


def test_a_stated_header_is_taken_as_a_whole():
    content = CAMPAIGN.replace("P10 unloaded x [mm]", "x_t").replace("P10 loaded x [mm]", "pos_rad")
    columns = {"x_t": "P10 unloaded x [mm]", "pos_rad": "P10 loaded x [mm]"}
    assert points_of(read(("a.csv", content), columns=columns)) == points_of(read(("a.csv", CAMPAIGN)))
    (fault,) = faults(("a.csv", CAMPAIGN.replace("P10 unloaded x [mm]", "shift_mm")),
                      columns={"shift_mm": "P10 unloaded x [m]"})  # fmt: skip
    assert "is in mm, but" in fault.reason


@pytest.mark.parametrize("cut", [1, 2, 3, 4, 5])
def test_a_file_that_is_cut_off_within_a_number_is_refused(cut):
    content = CAMPAIGN.rstrip("\n")
    assert points_of(read(("a.csv", content))) == points_of(read(("a.csv", CAMPAIGN)))
    (fault,) = faults(("a.csv", content[:-cut]))
    assert fault.reason.startswith("the file is cut off")
    assert fault.place.line == 5


@pytest.mark.parametrize("last", ["22", "2", "-2"])
def test_a_number_that_is_cut_off_at_its_point_is_refused(last):
    """Zeros are dropped here: 63.6 has one decimal less than the others, and a cut one might have, too."""
    names = ("c01_P10_unloaded", "c01_P10_loaded", "c02_P10_unloaded", "c02_P10_loaded")

    def points(*heights):
        return "\n".join(
            ("x [mm];y [mm];name;z [mm]", *(f"1;2;{n};{z}" for n, z in zip(names, heights, strict=True)))
        )

    (fault,) = faults(("a.csv", points("836.13", "-63.6", "97.31", last)))
    assert fault.reason.startswith("the file is cut off")
    assert read(("a.csv", points("-12", "-10", "11", "-9")))  # numbers without decimals may be short


def test_rows_by_order_beside_deleted_ones_are_refused():
    """What is left of a file without some rows would be paired with other postures."""
    table = "x [mm];y [mm];z [mm];Delete\n1.5;0;0;0\n2.5;0;0;{}\n3.5;0;0;{}\n4.5;0;0;0\n"
    files = (("P_unloaded.csv", table.format(1, 0)), ("P_loaded.csv", table.format(0, 1)))
    assert {fault.option for fault in faults(*files, by_order=True)} == {"by_order"}


def test_a_name_that_is_cut_off_is_refused():
    content = "x [mm];y [mm];z [mm];name\n1;2;3.5;c01_P10_unloaded\n1;2;3;c01_P10_loaded"
    assert read(("a.csv", content))
    targets = "label;state;x [mm];y [mm];z [mm];target\nc1;u;1;2;3.5;P10\nc1;l;1;2;3.5;P1"
    (fault,) = faults(("a.csv", targets))
    assert "'P1' is shorter than its column" in fault.reason


def test_a_value_far_from_its_column_is_asked_about():
    rows = [
        f"c{i:02};{10 * i}.5;0;0;-1471.5;{1200 + 7 * i}.5;2.5;3;{1200 + 7 * i};2.5;{3 - i / 8}"
        for i in range(20)
    ]
    header = "label;J1 [deg];Fx [N];Fy [N];Fz [N];" + ";".join(
        f"P1 {s} {a} [mm]" for s in "ul" for a in "xyz"
    )

    def answer(**options):
        return answered(("day.csv", "\n".join([header, *rows]) + "\n"), **options)

    assert answer().missing == []
    rows[7] = rows[7].replace(";1249.5;", ";12495;")
    found = answer()
    assert found.missing_fields == ["accept_unusual"]
    assert "P1 unloaded x 12495 ('day.csv', line 9, column 6) is" in found.missing[0]
    assert found.measurement_set is None
    confirmed = answer(accept_unusual=True)
    assert confirmed.measurement_set is not None
    assert not confirmed.template.accept_unusual, "the next file is asked about again"


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"load_point": (0.0, 0.0, 5000.0)}, None),
        ({"load_point": (0.0, 120.0, 5.1), "length_unit": "m"}, "load point is 120.108 m from the flange"),
        ({"load_point": (0.0, 0.0, 6000.0), "accept_unusual": True}, None),
    ],
)
def test_a_load_point_beyond_5_m_is_asked_about(options, reason):
    answer = answered(("a.csv", CAMPAIGN), **options)
    assert (answer.measurement_set is None) == (reason is not None)
    assert answer.missing_fields == (["accept_unusual"] if reason else [])
    assert (reason or "") in "".join(answer.missing)


def test_lengths_of_the_request_are_converted_to_the_files_unit():
    noise = {"sigma": 0.02, "force": {"scale": 0.01}}
    options = {"load_point": (0.0, -20.5, 120.0), "noise": noise, "length_unit": "mm"}
    metres = ("a.csv", CAMPAIGN.replace("[mm]", "[m]"))
    document = answered(metres, **options, accept_unusual=True).measurement_set
    assert document.load_point == pytest.approx((0.0, -0.0205, 0.12), rel=1e-15)
    assert (document.noise.sigma, document.noise.force.scale) == (pytest.approx(2e-5), 0.01)
    assert answered(("a.csv", CAMPAIGN), **options).measurement_set.load_point == (0.0, -20.5, 120.0)


# ---- other instruments


@pytest.mark.parametrize(
    ("head", "row"),
    [
        ("Name;Object Type;X;Y;Z;Probe Radius", "{n};Point;{x};{y};{z};19.05"),
        ("Name;Actual X [mm];Actual Y [mm];Actual Z [mm];Upper Tol;Lower Tol", "{n};{x};{y};{z};0.1;-0.1"),
        ("Point;X;Y;Z;Temp;Press;Hum;Azimuth;Elevation;Distance", "{n};{x};{y};{z};20;1013;40;1;2;3"),
        ("Name;Frame;Sub Frame;RX;RY;RZ;TX [mm];TY [mm];TZ [mm]", "{n};17;0;0.1;0.2;0.3;{x};{y};{z}"),
        (
            "Name;Tool ID;Port;Frame;Face;Status;Q0;Qx;Qy;Qz;Tx [mm];Ty [mm];Tz [mm];Error;Markers",
            "{n};1;A;77;0;OK;1;0;0;0;{x};{y};{z};0.02;4",
        ),
    ],
    ids=["PolyWorks", "measuring machine", "API", "Vicon", "NDI"],
)
def test_headers_of_other_instruments(head, row):
    rows = [row.format(n="_".join(key), x=x, y=y, z=z) for key, (x, y, z) in READ.items()]
    assert points_of(read(("a.csv", "\n".join([head, *rows]) + "\n"), units={"length": "mm"})) == READ


@pytest.mark.parametrize("header", ["Tx", "Tx [N.m]"])
def test_a_translation_has_a_unit_of_length_as_it_may_be_a_moment(header):
    table = f"name;{header};{header.replace('x', 'y')};{header.replace('x', 'z')}\nc01_P10_loaded;1;2;3.5\n"
    assert faults(("a.csv", table), units={"length": "mm"})


@pytest.mark.parametrize(
    "header", ["tip along z [mm]", "dial gauge z [mm]", "Messuhr 1 z [mm]", "LVDT dz [mm]"]
)
def test_dial_gauges_by_their_word(header):
    table = f"label;J1 [deg];Fx [N];Fy [N];Fz [N];{header}\nc01;1;0;0;-100;0.25\nc02;2;0;0;-100;-0.5\n"
    answer = answered(
        ("a.csv", table), flange_targets={header.split(" along")[0].split(" z")[0].split(" dz")[0]: (0, 0, 9)}
    )
    readings = [one.readings[0] for one in answer.measurement_set.observations]
    assert [reading.displacement for reading in readings] == [0.25, -0.5]
    assert {reading.direction for reading in readings} == {(0.0, 0.0, 1.0)}


def test_an_unknown_gauge_learns_the_form():
    (fault,) = faults(("a.csv", "label;J1 [deg];Weg [mm]\nc01;1;0.25\n"))
    assert "`tip along z [mm]` of a gauge" in fault.remedy


def test_a_target_called_gauge_has_positions_where_states_are_named():
    content = CAMPAIGN.replace("P10", "gauge")
    assert {target for _, target, _ in points_of(read(("a.csv", content)))} == {"gauge"}


def test_groups_of_spatial_analyzer_that_end_with_the_state():
    rows = "".join(f"{a} {c}, {b}, {x}, {y}, {z}\n" for (a, b, c), (x, y, z) in READ.items())
    assert points_of(read(("a.txt", "// X, Y, Z in mm\n" + rows))) == READ
