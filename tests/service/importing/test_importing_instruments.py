"""Files as instruments and people write them: SpatialAnalyzer 2022, Leica's columns, words for states."""

import re
from datetime import UTC, datetime

import pytest
from support.importing_samples import CAMPAIGN, JOINTS, answered, faults, points_of, read
from support.importing_samples import READ_POINTS as READ

# ---- SpatialAnalyzer 2022


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


def test_groups_of_spatial_analyzer_that_end_with_the_state():
    rows = "".join(f"{a} {c}, {b}, {x}, {y}, {z}\n" for (a, b, c), (x, y, z) in READ.items())
    assert points_of(read(("a.txt", "// X, Y, Z in mm\n" + rows))) == READ
