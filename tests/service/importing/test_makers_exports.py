"""Exports of instruments and controllers as their makers write them, read by one proposal."""

import io

import numpy as np
import openpyxl
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on
from support.importing_samples import refusals

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=11, configurations=10)
DEGREES = np.rad2deg(READINGS.joints)
UNLOADED = 1e3 * READINGS.position[:, 0]
LOADED = UNLOADED - [0.0, 0.0, 0.4]
COUNT = len(DEGREES)
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -100], "units": {"force": "N"}}
NUMBERS = np.column_stack([DEGREES, UNLOADED, LOADED])


def propose(folder, *, allow_missing=False, **files):
    paths = []
    for name, content in files.items():
        path = folder / name.replace("__", ".")
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        paths.append(path)
    return js.read(*paths, robot=ARM, allow_missing=allow_missing, **STATED)


def assert_read(proposal, count=COUNT):
    observations = proposal.accept().measurement_set.observations
    assert len(observations) == count
    joints = [observation.joints for observation in observations]
    assert np.abs(np.array(joints) - DEGREES[:count]).max() < 1e-3
    for observation in observations:
        for reading in observation.readings:
            assert np.subtract(reading.loaded, reading.unloaded) == pytest.approx([0, 0, -0.4], abs=2e-3)


# ---- rows of numbers are read, said or refused

HEADER = "\t".join(
    [f"J{i} [deg]" for i in range(1, 7)]
    + [f"{axis} {state} [mm]" for state in ("free", "loaded") for axis in "XYZ"]
)


def channels(*, remarks=(), preamble=(), footer=(), rows=NUMBERS):
    lines = ["LabVIEW Measurement", "Separator\tTab", "***End_of_Header***", "", *preamble]
    lines += ["X_Value\t" + HEADER + "\tComment"]
    for number, row in enumerate(rows.tolist()):
        cells = [f"{number}.000000", *(f"{value:.6f}" for value in row)]
        lines.append("\t".join([*cells, *(["calibrated"] if number in remarks else [])]))
    return "\n".join([*lines, *footer]) + "\n"


def test_lines_of_channels_above_a_header_are_no_postures_and_are_said(tmp_path):
    preamble = ["Samples" + "\t10" * 12, "X0" + "\t0.0E+0" * 12, "Delta_X" + "\t1.0" * 12]
    proposal = propose(tmp_path, rope__lvm=channels(preamble=preamble))
    assert_read(proposal)
    assert "rows of numbers outside the table were not read: 5 ('Samples')" in str(proposal)


@pytest.mark.parametrize("remarks", [(0,), (4,), (9,), (0, 1, 2, 3, 4, 5, 6)])
def test_a_row_with_a_remark_behind_its_last_column_is_a_posture(remarks, tmp_path):
    assert_read(propose(tmp_path, rope__lvm=channels(remarks=remarks)))


def test_a_row_of_a_table_that_lacks_a_number_is_refused_at_its_line(tmp_path):
    lines = channels().splitlines()
    lines[7] = lines[7].rpartition("\t")[0]
    with pytest.raises(js.CampaignError, match="line 8: the row has 12 cells, but the other rows"):
        propose(tmp_path, rope__lvm="\n".join(lines) + "\n")


def test_rows_of_numbers_below_a_table_are_said(tmp_path):
    proposal = propose(tmp_path, rope__lvm=channels(footer=["", "Tool\t0\t0\t150"]))
    assert_read(proposal)
    assert "not read: 17 ('Tool')" in str(proposal)


# ---- postures as columns


def sheet(*rows):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append([cell or None for cell in row])
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


JOINT_ROWS = [[f"Axel {n}", "grader", *column] for n, column in enumerate(DEGREES.T.round(4).tolist(), 1)]
STATE_ROWS = {
    state: [[axis, "mm", *column] for axis, column in zip("XYZ", numbers.T.round(4).tolist(), strict=True)]
    for state, numbers in (("Utan last", UNLOADED), ("Med last", LOADED))
}
POSES = ["Pos.", "", *range(1, COUNT + 1)]


def test_a_sheet_of_columns_below_a_title_with_groups_in_titles_is_read(tmp_path):
    groups = [row for state, rows in STATE_ROWS.items() for row in ([], [state], *rows)]
    rows = [["Styvhetsprov cell 3"], [], POSES, ["Ledvinklar"], *JOINT_ROWS, *groups]
    assert_read(propose(tmp_path, t__xlsx=sheet(*rows)))


def test_a_sheet_of_columns_with_groups_in_merged_cells_is_read(tmp_path):
    groups = [
        [state if axis == 0 else "", *row]
        for state, rows in STATE_ROWS.items()
        for axis, row in enumerate(rows)
    ]
    joints = [["", *row] for row in JOINT_ROWS]
    assert_read(propose(tmp_path, t__xlsx=sheet(["Test"], ["", *POSES], *joints, *groups)))


# ---- joints above the table of a posture


def comma(values):
    return ";".join(f"{value:.3f}".replace(".", ",") for value in values)


def targets(k):
    states = (("bez obciążenia", UNLOADED), ("z obciążeniem", LOADED))
    rows = [f"{name};{state};{comma(p[k] + shift)}" for state, p in states for name, shift in SHIFTS.items()]
    return "\n".join(["punkt;stan;X [mm];Y [mm];Z [mm]", *rows]) + "\n"


SHIFTS = {"A": 0.0}
ABOVE = {
    "a list in a comment": lambda k: f"# pomiar\n# pozycja;{k + 1}\n# J1-J6 [st];{comma(DEGREES[k])}\n",
    "names in comments": lambda k: "".join(f"# J{n} = {comma([q])}\n" for n, q in enumerate(DEGREES[k], 1)),
    "lines of names": lambda k: (
        f"pose: {k + 1}\n" + "".join(f"J{n} = {comma([q])}\n" for n, q in enumerate(DEGREES[k], 1))
    ),
}


@pytest.mark.parametrize("form", ABOVE)
def test_files_of_a_posture_each_with_joints_above_the_table_are_read(form, tmp_path):
    texts = {f"poz_{k + 1:02}__csv": ABOVE[form](k) + targets(k) for k in range(COUNT)}
    assert_read(propose(tmp_path, **texts))


def test_blocks_with_joints_in_their_comments_are_read(tmp_path):
    blocks = [ABOVE["a list in a comment"](k) + targets(k) for k in range(COUNT)]
    assert_read(propose(tmp_path, all__csv="\n".join(blocks)))


def test_comments_of_equal_numbers_above_tables_are_no_joints(tmp_path):
    head = "# probe 1.5 2.5 3.5 4.5 5.5 6.5\n"
    header = ";".join([f"J{n} [deg]" for n in range(1, 7)] + list("XYZ")) + "\n"
    tables = [
        head + f"# {state}\n" + header + "\n".join(map(comma, np.column_stack([DEGREES, p]))) + "\n"
        for state, p in (("unloaded", UNLOADED), ("loaded", LOADED))
    ]
    assert_read(propose(tmp_path, all__csv="\n".join(tables)))


@pytest.mark.parametrize("line", ["", "B;z obciążeniem;-;-;-\n"])
def test_a_file_of_a_posture_without_a_target_is_read_without_that_target(line, tmp_path):
    texts = {}
    for k in range(COUNT):
        text = ABOVE["a list in a comment"](k) + targets(k)
        second = [row.replace("A;", "B;") for row in text.splitlines() if row.startswith("A;")]
        text += "\n".join(second) + "\n"
        texts[f"poz_{k + 1:02}__csv"] = text if k != 3 else text.replace(second[1] + "\n", line)
    proposal = propose(tmp_path, allow_missing=True, **texts)
    counts = [len(each.readings) for each in proposal.accept().measurement_set.observations]
    assert counts == [1 if k == 3 else 2 for k in range(COUNT)]


# ---- lists of points


def points(head, name):
    rows = [
        f"{name(k, state)} {x:.5f} {y:.5f} {z:.5f}"
        for state, p in (("NOLOAD", UNLOADED), ("LOADED", LOADED))
        for k, (x, y, z) in enumerate(p / 25.4)
    ]
    return "\n".join([*head, *rows]) + "\n"


def joints(header=("Pos", "J1", "J2", "J3", "J4", "J5", "J6")):
    rows = [f"P{k + 1:02};" + ";".join(f"{q:.4f}" for q in row) for k, row in enumerate(DEGREES.tolist())]
    return "\n".join([";".join(header), *rows]) + "\n"


HEAD = ["// SpatialAnalyzer 2021.1", "// Working Frame: A::WORLD", "// Units: Inches"]


@pytest.mark.parametrize("kind", ["Cartesian (X, Y, Z)", "Rectangular"])
@pytest.mark.parametrize("collection", ["A ", ""])
def test_the_kind_of_a_coordinate_system_is_no_second_frame(kind, collection, tmp_path):
    head = [*HEAD, f"// Coordinate System: {kind}"]
    text = points(head, lambda k, state: f"{collection}P{k + 1:02}_{state} T1")
    assert_read(propose(tmp_path, points__txt=text, joints__csv=joints()))


def test_coordinates_that_are_not_cartesian_are_refused_whatever_the_remark_is():
    text = points([*HEAD, "// Coordinate System: Cylindrical (R, Theta, Z)"], lambda k, s: f"{k}_{s} T1")
    assert "the file has 'cylindrical' coordinates" in refusals(("points.txt", text))[0]


# ---- data of VAL3


def val3(*arrays, head=""):
    data = []
    for name, type_, values in arrays:
        cells = [
            f'<Value key="{k}" ' + " ".join(f'j{n}="{q:.4f}"' for n, q in enumerate(row, 1)) + "/>"
            for k, row in enumerate(values)
        ]
        data.append(f'<Data name="{name}" type="{type_}" size="{len(cells)}">{"".join(cells)}</Data>')
    namespace = "http://www.staubli.com/robotics/VAL3/Data/2"
    return (
        f'<?xml version="1.0"?>{head}<Database xmlns="{namespace}"><Datas>{"".join(data)}</Datas></Database>'
    )


def reports(order):
    rows = [
        f"{state}_{k};{x:.4f};{y:.4f};{z:.4f}"
        for state, p in (("VIDE", UNLOADED), ("CHARGE", LOADED))
        for k, (x, y, z) in zip(order, p[order].tolist(), strict=True)
    ]
    return "\n".join(["Nom;X;Y;Z", *rows]) + "\n"


def test_joints_of_val3_data_are_joined_to_points_by_their_keys(tmp_path):
    text = val3(("jHome", "jointRx", DEGREES[:1]), ("jMesure", "jointRx", DEGREES))
    proposal = propose(tmp_path, mesure__dtx=text, rapport__txt=reports([3, 1, 2, 0, 9, 8, 4, 5, 6, 7]))
    assert_read(proposal)
    assert "joint positions of fewer postures were not read: 'jHome'" in str(proposal.accept().files)


def named_points(of_unloaded, of_loaded, lost=4):
    """Return points named after the data of VAL3, without one reading under load."""
    rows = []
    for k, (unloaded, loaded) in enumerate(zip(UNLOADED, LOADED, strict=True)):
        rows.append([f"jMes[{k}]{of_unloaded}", *unloaded])
        if k != lost:
            rows.append([f"jMes[{k}]{of_loaded}", *loaded])
    return "Nom;X;Y;Z\n" + "".join(f"{name};{x:.4f};{y:.4f};{z:.4f}\n" for name, x, y, z in rows)


@pytest.mark.parametrize(
    ("of_unloaded", "of_loaded"),
    [("_vide", "_50N"), ("_vide", "_5daN"), ("_0N", "_50N"), ("", "_50N"), ("", "_10kg"), ("_a", "_b")],
)
def test_loads_in_names_of_points_are_states_though_a_point_is_absent(of_unloaded, of_loaded, tmp_path):
    text = val3(("jMes", "jointRx", DEGREES))
    points = named_points(of_unloaded, of_loaded)
    proposal = propose(tmp_path, allow_missing=True, mes__dtx=text, points__csv=points)
    assert_read_without(proposal, lost=4)


def assert_read_without(proposal, lost):
    observations = proposal.accept().measurement_set.observations
    assert [each.label for each in observations] == [str(k) for k in range(COUNT) if k != lost]
    shifts = [
        np.subtract(reading.loaded, reading.unloaded) for each in observations for reading in each.readings
    ]
    assert shifts == pytest.approx(np.tile([0.0, 0.0, -0.4], (COUNT - 1, 1)), abs=2e-3)


def test_points_with_an_unknown_word_behind_the_names_of_others_are_never_left_out(tmp_path):
    text = val3(("jMes", "jointRx", DEGREES))
    with pytest.raises(js.CampaignError) as refused:
        propose(tmp_path, mes__dtx=text, points__csv=named_points("", "_50kip"))
    assert "points whose names end with '50kip' would be left out" in str(refused.value)
    assert "state_words" in str(refused.value)


def repeated_points(distance):
    """Return two numbered readings of each point, at a distance [mm] from each other."""
    rows = [
        f"pos{k}_{state}_{repeat};{x:.4f};{y:.4f};{z + distance * repeat:.4f}\n"
        for k in range(COUNT)
        for state, places in (("free", UNLOADED), ("load", LOADED))
        for x, y, z in places[k : k + 1]
        for repeat in (1, 2)
    ]
    return "Nom;X;Y;Z\n" + "".join(rows)


@pytest.mark.parametrize(("distance", "targets"), [(0.02, ["T1"]), (1.0, ["1", "2"])])
def test_numbers_behind_names_are_repeats_if_their_points_are_near(distance, targets, tmp_path):
    joints = "Pos;" + ";".join(f"J{i}" for i in range(1, 7)) + "\n"
    joints += "".join(f"pos{k};" + ";".join(f"{q:.4f}" for q in row) + "\n" for k, row in enumerate(DEGREES))
    proposal = propose(tmp_path, joints__csv=joints, points__csv=repeated_points(distance))
    assert ("the mean of repeated readings" in str(proposal)) == (len(targets) == 1)
    first = proposal.accept().measurement_set.observations[0]
    assert [reading.target for reading in first.readings] == targets


ENTITIES = '<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]>'
HOSTILE = {
    "declares a document type": val3(("j", "jointRx", DEGREES), head=ENTITIES),
    "elements or 64 levels": "<Database>" + "<Data>" * 100_000,
    "more than 400000 elements": "<Database>" + "<Data/>" * 400_001,
    "not well-formed": val3(("j", "jointRx", DEGREES))[:-20],
    "no array of 3 joint positions": val3(("j", "jointRx", DEGREES[:1])),
    "lacks an axis": val3(("j", "jointRx", DEGREES[:, :5])),
    "too long a text": val3(("j", "jointRx", DEGREES)).replace('key="3"', f'key="{3 * "9" * 300}"'),
}


@pytest.mark.parametrize("said", HOSTILE)
def test_hostile_data_of_val3_are_refused_in_a_sentence(said):
    assert said in refusals(("a.dtx", HOSTILE[said]))[0]
