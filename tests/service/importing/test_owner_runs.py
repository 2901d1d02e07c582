"""Files as their owners have them, of readings and of robots: from each file to the stiffnesses of a run.

The readings are those of springs that balance a load exactly, so that the run has to find these springs.
Robot and readings are files; at most three options or answers go with them.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from support.workbooks import arrays, hdf5, parquet, workbook

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign

ROOT = Path(__file__).parents[3]
ARM = default_arm()
DOCUMENT = simulate_campaign(
    ARM, configurations=12, sigma=0.0, noise=False, units={"length": "mm", "angle": "deg", "force": "N"}
)
SET = DOCUMENT["measurement_set"]
STATED = {"encoders": "motor", "load_point": SET["load_point"]}
"""What each of these files leaves to say: two options."""
JOINTS = [f"J{i} [deg]" for i in range(1, 7)]
FORCE = ["Fx [N]", "Fy [N]", "Fz [N]"]
TARGETS = ["P10", "P11", "P12"]
STATES = ["unloaded", "loaded"]


def columns_of(state):
    return [f"{target} {state} {axis} [mm]" for target in TARGETS for axis in "xyz"]


def cells(states=STATES, *, joints=True):
    """Return the rows of a table with these states: a header and a row for each posture."""
    header = [
        "label",
        *(JOINTS if joints else []),
        *FORCE,
        *(c for state in states for c in columns_of(state)),
    ]
    rows = [header]
    for each in SET["observations"]:
        places = [x for state in states for reading in each["readings"] for x in reading[state]]
        rows.append([each["label"], *(each["joints"] if joints else []), *each["force"], *places])
    return rows


def text(rows, delimiter=";", mark="."):
    lines = (
        delimiter.join(str(cell).replace(".", mark) if row else str(cell) for cell in cells)
        for row, cells in enumerate(rows)
    )
    return "\n".join(lines) + "\n"


def points(name="{label}_{target}_{state}", line="{name};{x};{y};{z}"):
    return [
        line.format(
            name=name.format(label=each["label"], target=reading["target"], state=state),
            label=each["label"], target=reading["target"], state=state,
            **dict(zip("xyz", reading[state], strict=True)),
        )
        for each in SET["observations"] for reading in each["readings"] for state in STATES
    ]  # fmt: skip


def joints_only():
    rows = [[each["label"], *each["joints"], *each["force"]] for each in SET["observations"]]
    return text([["label", *JOINTS, *FORCE], *rows])


def with_row(row, place=4):
    lines = text(cells()).splitlines()
    return "\n".join([*lines[:place], row, *lines[place:]]) + "\n"


def two_sheets(book, _sheet):
    second = book.create_sheet("Punkte")
    for row in cells():
        second.append([row[0], *row[10:]])


def sheet_of(state):
    """Return a sheet of one state, which only its name says: titles, names above axes, and a row of units."""
    targets = [text for target in TARGETS for text in (target, "", "")]
    rows = [
        [each["label"], *each["joints"], *each["force"], *(x for r in each["readings"] for x in r[state])]
        for each in SET["observations"]
    ]
    return [
        ["Steifigkeit, Zelle 3"],
        ["Datum:", "12.03.2026", "", "Bediener:", "M. Weber"],
        ["Pose", *(f"A{i}" for i in range(1, 7)), "Fx", "Fy", "Fz", *targets],
        [""] * 10 + ["X", "Y", "Z"] * len(TARGETS),
        ["", *["°"] * 6, *["N"] * 3, *["mm"] * 3 * len(TARGETS)],
        *rows,
    ]


def sheets_of_states(book, sheet):
    sheet.title = "unbelastet"
    second = book.create_sheet("belastet")
    for row in sheet_of("loaded"):
        second.append(row)


def below_titles(rows):
    """Return a table whose joints and readings have titles above them, one of them with the unit."""
    header, *rest = rows
    titles = ["", "Robot joints [deg]", *([""] * 5), "Load", *([""] * (len(header) - 8))]
    return [titles, [name.replace(" [deg]", "") for name in header], *rest]


def rows_of_states():
    """Return a table with a row for each state, in which the unloaded rows have no force."""
    rows = [["label", *JOINTS, "state", *FORCE, *(f"{target} {a} [mm]" for target in TARGETS for a in "xyz")]]
    for each in SET["observations"]:
        for state in STATES:
            force = each["force"] if state == "loaded" else [0, 0, 0]
            places = [x for reading in each["readings"] for x in reading[state]]
            rows.append([each["label"], *each["joints"], state, *force, *places])
    return rows


def with_thousands(cell):
    whole, point, decimals = f"{cell:.8f}".partition(".") if isinstance(cell, float) else (str(cell), "", "")
    sign, digits = ("-", whole[1:]) if whole.startswith("-") else ("", whole)
    grouped = f"{int(digits):,}".replace(",", ".") if digits.isdigit() else digits
    return f"{sign}{grouped},{decimals}" if point else str(cell)


def matrices():
    observations = SET["observations"]
    places = {
        f"{target}_{state}_mm": np.array([each["readings"][k][state] for each in observations])
        for k, target in enumerate(TARGETS) for state in STATES
    }  # fmt: skip
    return {
        "label": [each["label"] for each in observations],
        "J_deg": np.array([each["joints"] for each in observations]),
        "force_N": np.array([each["force"] for each in observations]),
        **places,
    }


def matrices_in_states():
    """Return the matrices as a struct of MATLAB: those of readings in a struct for each state."""
    plain = matrices()
    places = {
        state: {f"{target}_mm": plain[f"{target}_{state}_mm"] for target in TARGETS} for state in STATES
    }
    labels = np.array(plain.pop("label"), dtype=object).reshape(-1, 1)
    return {"label": labels, "J_deg": plain["J_deg"], "force_N": plain["force_N"], **places}


def in_one_group(file):
    for name, values in matrices().items():
        file[name] = values


def in_groups(file):
    for name, values in matrices().items():
        for group in ("joints", "points") if name == "label" else ("points" if "P1" in name else "joints",):
            file[f"{group}/{name}"] = values


def columns():
    header, *rows = cells()
    return {name: [row[k] for row in rows] for k, name in enumerate(header)}


SPACE_ROWS = points(line="A, {state}, {label}_{target}, {x}, {y}, {z}, 20.11.2026 10:05:33")
COMMAS = [[str(cell).replace(".", ",") if k else cell for cell in row] for k, row in enumerate(cells())]
SHIFTED = text(cells(["loaded"])).replace(
    str(SET["observations"][0]["joints"][0]), str(SET["observations"][0]["joints"][0] + 0.004)
)
READINGS = {
    "a file for each state": ({"u.csv": text(cells(["unloaded"])), "l.csv": SHIFTED}, {}),
    "SpatialAnalyzer with a time behind": (
        {
            "j.csv": joints_only(),
            "p.txt": "// AXES = CARTESIAN: X,  Y,  Z (mm)\n" + "\n".join(SPACE_ROWS) + "\n",
        },
        {"point_name": "{any}::{state}::{label}_{target}"},
    ),
    "repeated readings": (
        {"j.csv": joints_only(), "p.csv": "point;x [mm];y [mm];z [mm]\n" + "\n".join(2 * points()) + "\n"},
        {"mean_of_repeats": True},
    ),
    "whole rows repeated": (
        {"a.csv": text([cells()[0], *(row for row in cells()[1:] for _ in range(3))])},
        {"mean_of_repeats": True},
    ),
    "a row for each state, without a force where unloaded": ({"a.csv": text(rows_of_states())}, {}),
    "joints from zero": (
        {"a.csv": re.sub(r"J(\d) ", lambda match: f"Joint{int(match[1]) - 1} ", text(cells()))}, {},
    ),
    "a row of remarks": ({"a.csv": with_row("Pause, Hallentor offen" + ";" * 27)}, {}),
    "a row of means": ({"a.csv": with_row("Mittel;" + ";".join(["1"] * 27), 13)}, {}),
    "numbers as texts with commas": (
        {"a.xlsx": workbook(COMMAS)}, {"decimal_mark": "comma"},
    ),
    "numbers as texts with separators of thousands": (
        {"a.xlsx": workbook([cells()[0], *([with_thousands(x) for x in row] for row in cells()[1:])])},
        {"decimal_mark": "comma"},
    ),
    "sheets named after states": (
        {"a.xlsx": workbook(sheet_of("unloaded"), sheets_of_states)},
        {"sheet": "unbelastet; belastet"},
    ),
    "titles above the columns": ({"a.xlsx": workbook(below_titles(cells()))}, {}),
    "states in long names of files": (
        {f"Messung_2026-03-12_{state}.csv": text(
            [["Pose", *JOINTS, *FORCE, *(f"{t} {a} [mm]" for t in TARGETS for a in "xyz")],
             *cells([word])[1:]]) for state, word in (("ohne_Last", "unloaded"), ("mit_Last", "loaded"))}, {},
    ),
    "joints of a controller's log": (
        {"a.csv": re.sub(r"J(\d) ", lambda match: f"actual_q_{int(match[1]) - 1} ", text(cells()))}, {},
    ),
    "joints in brackets, with the word angle": (
        {"a.csv": re.sub(r"J(\d) \[deg\]", r"Joint \1 angle (°)", text(cells()))}, {},
    ),
    "SpatialAnalyzer with a unit at each axis": (
        {
            "j.csv": joints_only(),
            "p.txt": "// AXES = X (mm), Y (mm), Z (mm)\n" + "\n".join(SPACE_ROWS) + "\n",
        },
        {"point_name": "{any}::{state}::{label}_{target}"},
    ),
    "two sheets": (
        {"a.xlsx": workbook([row[:10] for row in cells()], two_sheets)}, {"sheet": "Sheet; Punkte"},
    ),
}  # fmt: skip
ARRAYS = {
    "MATLAB": lambda: ({"a.mat": arrays(**matrices())}, {}),
    "a struct of MATLAB": lambda: ({"a.mat": arrays(data=matrices_in_states())}, {}),
    "HDF5": lambda: ({"a.h5": hdf5(in_one_group)}, {}),
    "two groups of HDF5": lambda: ({"a.h5": hdf5(in_groups)}, {"sheet": "joints; points"}),
    "Parquet": lambda: ({"a.parquet": parquet(columns())}, {}),
}


def write(folder, files):
    paths = [folder / name for name in files]
    for path, content in zip(paths, files.values(), strict=True):
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return paths


def run_of(paths, robot, options):
    """Return the run of the files of readings and of a robot, with three options at most."""
    assert len(options) <= 3
    imported = js.import_files(*paths, robot=robot, **options)
    assert not imported.missing
    return imported.identify()


def assert_springs_are_found(run):
    """The load is a weight, so that it never twists the vertical axis 1."""
    found = {name: joint.stiffness for name, joint in run.joints.items() if joint.stiffness}
    assert list(found) == [f"joint_{i}" for i in range(2, 7)]
    assert list(found.values()) == pytest.approx(ARM.stiffnesses[1:].tolist(), rel=1e-4)


@pytest.mark.parametrize("form", READINGS)
def test_a_file_of_readings_becomes_a_run_with_the_springs_of_the_arm(form, tmp_path):
    files, options = READINGS[form]
    assert_springs_are_found(run_of(write(tmp_path, files), DOCUMENT["robot"], STATED | options))


@pytest.mark.process
@pytest.mark.parametrize("form", ARRAYS)
def test_a_file_of_arrays_becomes_a_run_with_the_springs_of_the_arm(form, tmp_path):
    files, options = ARRAYS[form]()
    assert_springs_are_found(run_of(write(tmp_path, files), DOCUMENT["robot"], STATED | options))


def write_bag(folder):
    """Write joint states as ROS 2 records them, in the order of their names on an arm such as UR's."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="rosbags is not installed")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["sensor_msgs/msg/JointState"]
    stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    with rosbag2.Writer(folder, version=9) as writer:
        topic = writer.add_connection("/joint_states", kind.__msgtype__, typestore=store)
        for number, each in enumerate(SET["observations"]):
            message = kind(
                header=header, name=[f"joint_{i}" for i in (3, 2, 1, 4, 5, 6)],
                position=np.radians(each["joints"])[[2, 1, 0, 3, 4, 5]],
                velocity=np.zeros(6), effort=np.zeros(6),
            )  # fmt: skip
            writer.write(topic, number, store.serialize_cdr(message, kind.__msgtype__))


def test_a_bag_of_ros_becomes_a_run_by_the_example(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "day1_bag")
    lines = (ROOT / "examples" / "clients" / "ros_bag.py").read_text(encoding="utf-8")
    exec(compile(lines, "ros_bag.py", "exec"), {})  # noqa: S102 - the example's own lines
    labels = {each["label"]: f"c{number:02}" for number, each in enumerate(SET["observations"], 1)}
    rows = [[labels.get(row[0], row[0]), *row[1:]] for row in cells(joints=False)]
    (points,) = write(tmp_path, {"points.csv": text(rows)})
    assert_springs_are_found(run_of([Path("joints.csv"), points], DOCUMENT["robot"], STATED))


URDF = DOCUMENT["robot"]["model"]["urdf"]
PAPER = [  # a [mm], alpha [°], d [mm], theta [°] of the same arm, by Denavit and Hartenberg
    [330.0, -90.0, 780.0, 0.0],
    [1120.0, 0.0, 0.0, -90.0],
    [60.0, 90.0, 0.0, 0.0],
    [0.0, -90.0, -1310.0, 0.0],
    [0.0, 90.0, 0.0, 0.0],
    [0.0, 180.0, -240.0, 180.0],
]
CALIBRATED = [
    [a, alpha, d + (0, 5e5, -5e5, 0, 0, 0)[i], theta] for i, (a, alpha, d, theta) in enumerate(PAPER)
]


def in_degrees(match):
    return f'{match[1]}="{np.degrees(float(match[2]))}"'


ROBOTS = {
    "an axis with rpy": ("arm.urdf", URDF.replace("<axis ", '<axis rpy="0 0 0" ')),
    "no name": ("arm.urdf", URDF.replace(' name="simulated 6R"', "", 1)),
    "limits in degrees": ("arm.urdf", re.sub(r'(lower|upper)="([^"]*)"', in_degrees, URDF)),
    "a table in mm and degrees": (PAPER, "mm, deg, N"),
    "a calibrated table": (CALIBRATED, "mm, deg, N"),
}


@pytest.mark.parametrize("form", ROBOTS)
def test_a_description_of_a_robot_becomes_a_run_with_the_springs_of_the_arm(form, tmp_path):
    (readings,) = write(tmp_path, {"a.csv": text(cells())})
    source, more = ROBOTS[form]
    if isinstance(source, str):
        (path,) = write(tmp_path, {source: more})
        robot = js.robot(path)
    else:
        columns = "a alpha d theta lower upper" if len(source[0]) == 6 else "a alpha d theta"
        robot = js.robot(source, convention="standard", columns=columns, units=more)
    assert_springs_are_found(run_of([readings], robot, STATED))


@pytest.mark.process
def test_a_file_of_xacro_becomes_a_run_with_the_springs_of_the_arm(tmp_path):
    pytest.importorskip("xacro")
    macro = URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1)
    macro = macro.replace("<link ", '<xacro:property name="reach" value="1.31"/>\n<link ', 1)
    assert "1.31 0 0" in macro
    macro = macro.replace("1.31 0 0", "${reach} 0 0")
    readings, arm = write(tmp_path, {"a.csv": text(cells()), "arm.urdf.xacro": macro})
    assert_springs_are_found(run_of([readings], js.robot(arm), STATED))


def test_a_joint_that_cannot_move_is_named_before_any_run(tmp_path):
    still = re.sub(r'(name="joint_4".*?lower=)"[^"]*"( upper=)"[^"]*"', r'\1"0.5"\2"0.5"', URDF, flags=re.S)
    readings, arm = write(tmp_path, {"a.csv": text(cells()), "arm.urdf": still})
    with pytest.raises(js.CampaignError, match=r"joint_4.*make a joint that cannot move a fixed joint"):
        run_of([readings], js.robot(arm), STATED)
