"""Further layouts of strangers: logs of robots, YAML, turned sheets, reports by axis, paths of ROS, .npz."""

import io
import json
import pickle

import numpy as np
import openpyxl
import pytest
from support.importing_samples import refusals
from support.strange_files import both, digits, joints, judge, places, points, simulate, table

import jointstiff as js
from jointstiff.schemas.imports import ImportOptions
from jointstiff.service.importing.formats.json_rows import read_json_rows
from jointstiff.service.importing.grammar import Vocabulary
from jointstiff.service.importing.texts.joint_states import read_rows_of_joint_states

ARM = "KUKA KR 210 R2700 extra"
UR = "Universal Robots UR10e"
CAMPAIGN = simulate(ARM, seed=5, postures=9)
UR_CAMPAIGN = simulate(UR, seed=6, postures=9)
COUNT = len(CAMPAIGN.joints)
STATED = {
    "encoders": "motor",
    "load_point": [0, 0, 120],
    "force": [0, 0, -981],
    "units": {"force": "N"},
    "length_unit": "mm",
}
ROS = [
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
]


def propose(files, folder, arm):
    for name, content in files.items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return js.read(*(folder / name for name in files), robot=arm, **STATED)


def assert_read(files, folder, campaign=CAMPAIGN):
    proposed = propose(files, folder, campaign.arm)
    answer = proposed.accept() if hasattr(proposed, "accept") else proposed
    assert judge(campaign, answer.measurement_set.model_dump(mode="json")) == []


def refuse(files, folder, arm=ARM):
    with pytest.raises(js.CampaignError) as error:
        propose(files, folder, arm)
    return str(error.value)


# ---- logs with the robot's own writing of joint positions


def of_krl(q):
    axes = ", ".join(f"A{axis} {angle}" for axis, angle in enumerate(digits(q), 1))
    return f"$AXIS_ACT={{E6AXIS: {axes}, E1 0.0, E2 0.0}}"


def of_rapid(q):
    return f"jointtarget now:=[[{','.join(digits(q))}],[9E9,9E9,9E9,9E9,9E9,9E9]];"


def log(title, write_joints, form, states=("ohne Last", "mit Last"), order=lambda _number, rows: rows):
    text = "cell 3, Leica AT960, R1 R2 (mm)\n\n"
    for number, q in enumerate(CAMPAIGN.joints):
        rows = [
            form.format(k=k + 1, state=states[s], p=digits(places(CAMPAIGN, k, s)[number]))
            for s in (0, 1)
            for k in (0, 1)
        ]
        text += "\n".join([*title(number + 1), write_joints(q), *order(number, rows)]) + "\n"
    return text


SIGNED = "R{k} {state}: X={p[0]}  Y={p[1]}  Z={p[2]}"
LOGS = {
    "dashes, KRL": log(lambda n: [f"--- Stellung {n} ---"], of_krl, SIGNED),
    "KRL without titles": log(lambda _: [], of_krl, SIGNED),
    "commas and units": log(
        lambda n: [f"== Pose {n} =="], of_krl, "R{k} {state}, X={p[0]} mm, Y={p[1]} mm, Z={p[2]} mm",
        ("unloaded", "loaded"),
    ),
    "RAPID, no names of coordinates": log(
        lambda n: [f"Pose {n}"], of_rapid, "R{k} {state}: {p[0]}; {p[1]}; {p[2]}"
    ),
    "another order in some postures": log(
        lambda n: [f"Stellung {n}"], of_krl, SIGNED, order=lambda n, rows: rows[::-1] if n % 3 else rows
    ),
}  # fmt: skip


def stamp(text, form):
    """Return a text whose lines each begin with a time of day of their own."""
    lines = enumerate(text.splitlines())
    return "\n".join(f"{form.format(10 + n // 3600, n // 60 % 60, n % 60)} {line}" for n, line in lines)


STAMPS = ["[{:02}:{:02}:{:02}]", "2024-01-25 {:02}:{:02}:{:02},125", "25.01.2024 {:02}:{:02}:{:02} -"]


@pytest.mark.parametrize("form", STAMPS)
def test_a_time_at_the_start_of_a_line_is_no_part_of_the_name_of_its_row(form, tmp_path):
    assert_read({"messung.log": stamp(LOGS["dashes, KRL"], form)}, tmp_path)


@pytest.mark.parametrize("form", LOGS)
def test_a_log_with_a_joint_position_above_lines_of_targets_is_read(form, tmp_path):
    assert_read({"messung.log": LOGS[form]}, tmp_path)


def test_a_log_in_which_a_posture_has_another_target_is_refused_at_its_line(tmp_path):
    text = LOGS["dashes, KRL"].replace("R2 mit Last", "R7 mit Last", 1)
    lines = [number for number, line in enumerate(text.splitlines(), 1) if "R2 mit" in line]
    said = refuse({"messung.log": text}, tmp_path)
    assert "the first block has no row 'R2 mit Last: X Y Z'" in said
    assert f"line {lines[0]}" in said


# ---- YAML


def records(campaign):
    return [
        {
            "name": f"pose_{number}",
            "joint_names": ROS,
            "position": [float(each) for each in digits(np.radians(q), 6)],
            "targets": {
                f"t{k + 1}": {
                    state: [float(each) for each in digits(places(campaign, k, s)[number] / 1e3, 6)]
                    for s, state in enumerate(("unloaded", "loaded"))
                }
                for k in (0, 1)
            },
        }
        for number, q in enumerate(campaign.joints)
    ]


def write_yaml(value, indent=""):
    """Write a value as block YAML, with lists of numbers and names in brackets."""
    if isinstance(value, dict):
        return "".join(
            f"{indent}{key}:"
            + (f"\n{write_yaml(each, indent + '  ')}" if is_block(each) else f" {show(each)}\n")
            for key, each in value.items()
        )
    return "".join(f"{indent}- {write_yaml(each, indent + '  ').lstrip()}" for each in value)


def is_block(value):
    return isinstance(value, dict) or (isinstance(value, list) and isinstance(value[0], dict))


def show(value):
    return f"[{', '.join(map(str, value))}]" if isinstance(value, list) else str(value)


def turn_names(record):
    """Return a record with its joints in alphabetical order, as ROS writes them."""
    order = sorted(range(6), key=lambda axis: ROS[axis])
    return record | {key: [record[key][axis] for axis in order] for key in ("joint_names", "position")}


RECORDS = records(UR_CAMPAIGN)
DOCUMENTS = {
    "a list in a field": ("a.yaml", "# AT403, metres\npostures:\n" + write_yaml(RECORDS)),
    "a list": ("a.yml", write_yaml(RECORDS)),
    "another ending": ("a.txt", write_yaml(RECORDS)),
    "names as fields": ("a.yaml", write_yaml({each["name"]: each for each in RECORDS})),
    "a document for each posture": ("a.yaml", "---\n".join(map(write_yaml, RECORDS))),
    "joints by the alphabet": ("a.yaml", write_yaml(list(map(turn_names, RECORDS)))),
    "in two fields": ("a.yaml", write_yaml({"campaign": {"cell": 3, "postures": RECORDS}})),
    "JSON with names of joints": ("a.json", json.dumps(list(map(turn_names, RECORDS)))),
}


@pytest.mark.parametrize("form", DOCUMENTS)
def test_a_list_of_postures_in_yaml_is_read_like_json(form, tmp_path):
    name, text = DOCUMENTS[form]
    assert_read({name: text}, tmp_path, UR_CAMPAIGN)


WITHOUT_NAMES = [
    {key: each for key, each in turn_names(record).items() if key != "joint_names"} for record in RECORDS
]
HEADER = {"frame_id": "base", "units": {"length": "m", "angle": "rad"}, "payload_kg": 100}
NAMES = {"joint_names": sorted(ROS)}
WITH_NAMES = {
    "names beside the list": {"header": HEADER, **NAMES, "poses": WITHOUT_NAMES},
    "names in the header": {"header": HEADER | NAMES, "poses": WITHOUT_NAMES},
    "another name of the list": {**NAMES, "units": HEADER["units"], "observations": WITHOUT_NAMES},
}


@pytest.mark.parametrize("write", [write_yaml, json.dumps])
@pytest.mark.parametrize("form", WITH_NAMES)
def test_names_of_joints_that_a_document_states_once_are_those_of_all_its_poses(form, write, tmp_path):
    name = "a.yaml" if write is write_yaml else "a.json"
    assert_read({name: write(WITH_NAMES[form])}, tmp_path, UR_CAMPAIGN)


def test_names_of_joints_that_a_document_states_once_name_no_other_numbers():
    poses = [{"q": [*range(k, k + 6)], "wrench": [1, 2, 3, 4, 5, 6]} for k in range(3)]
    (grid,) = read_json_rows("a.json", json.dumps(NAMES | {"poses": poses}).encode())
    assert list(grid.rows[0].cells) == [*sorted(ROS), *(f"wrench {n}" for n in range(1, 7))]


@pytest.mark.parametrize("form", ["a.yaml", "a.json"])
def test_poses_of_others_that_are_not_read_are_not_called_a_campaign(form):
    document = {"cell": 3, "poses": WITHOUT_NAMES}
    text = json.dumps(document) if form == "a.json" else write_yaml(document)
    (refused,) = refusals((form, text.encode()))
    assert "needs no import" not in refused
    assert "has no list" not in refused
    assert "rename the field 'poses', such as to 'postures'" in refused


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: &x [1]\nb: *x\nc: 1\n", "a.yaml:1: the YAML has an anchor or an alias"),
        ("a: 1\nb: [1, 2\nc: 1\n", "a.yaml:3: invalid YAML"),
        ("a: 1\na: 2\nc: 1\n", "a.yaml:2: the name 'a' occurs twice"),
        ("a: 1\nb: 2\nc: " + "[" * 900, "a.yaml:3: the YAML has too many values, or lists in lists"),
        ("a: 1\nb: 2\nc: 3\n", "the YAML has no list of 3 objects or more, one for each posture"),
    ],
    ids=["alias", "open bracket", "name twice", "depth", "no list"],
)
def test_yaml_that_is_no_list_of_postures_is_refused_in_a_sentence(text, said):
    assert said in refusals(("a.yaml", text.encode()))[0]


def test_a_list_of_yaml_with_an_anchor_is_refused_whatever_its_name_is(tmp_path):
    text = write_yaml(RECORDS).replace("joint_names: [", "joint_names: &names [", 1)
    assert "'a.txt', line 2: the YAML has an anchor or an alias" in refuse({"a.txt": text}, tmp_path, UR)


# ---- turned sheets


def turned_rows(campaign, names):
    """Return rows of a name and a number for each posture."""
    rows = list(zip(*[digits(q) for q in campaign.joints], strict=True))
    columns = [[name, *row] for name, row in zip(names, rows, strict=True)]
    for k in (0, 1):
        for s, state in enumerate(("unloaded", "loaded")):
            numbers = zip(*[digits(p) for p in places(campaign, k, s)], strict=True)
            columns += [
                [f"T{k + 1} {state} {axis} [mm]", *row] for axis, row in zip("xyz", numbers, strict=True)
            ]
    return columns


def sheet(rows):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append([float(cell) if cell.lstrip("-")[:1].isdigit() else cell or None for cell in row])
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


POSES = ["", *(f"Pose {number}" for number in range(1, COUNT + 1))]
YASKAWA = simulate("Yaskawa GP180", seed=7, postures=COUNT)
LETTERS = turned_rows(YASKAWA, [f"{letter} [deg]" for letter in "SLURBT"])
SPOKEN = turned_rows(YASKAWA, [f"{letter}-axis [deg]" for letter in "SLURBT"])
OF_ROS = turned_rows(UR_CAMPAIGN, [name.replace("_joint", "") for name in ROS])
NUMBERED = turned_rows(CAMPAIGN, [f"A{number} [deg]" for number in range(1, 7)])
TURNED = {
    "a maker's letters": (YASKAWA, [POSES, *LETTERS]),
    "letters with words": (YASKAWA, [POSES, *SPOKEN]),
    "names of the arm": (UR_CAMPAIGN, [POSES, *OF_ROS]),
    "numbers": (CAMPAIGN, [["label", *POSES[1:]], *NUMBERED]),
}


@pytest.mark.parametrize("form", TURNED)
def test_a_sheet_with_a_column_for_each_posture_is_read(form, tmp_path):
    campaign, rows = TURNED[form]
    assert_read({"t.xlsx": sheet(rows)}, tmp_path, campaign)


def test_a_transposed_sheet_with_rows_of_remarks_is_read(tmp_path):
    remarks = [[f"Remark {n}", *["ok"] * COUNT] for n in range(5)]
    assert_read({"t.xlsx": sheet([POSES, *LETTERS, *remarks])}, tmp_path, YASKAWA)


def test_a_refused_sheet_that_looks_transposed_is_named_so(tmp_path):
    """The sheet is of another arm."""
    remarks = [[f"Remark {n}", *["ok"] * COUNT] for n in range(5)]
    said = refuse({"t.xlsx": sheet([POSES, *LETTERS, *remarks])}, tmp_path, ARM)
    assert "the first column of t.xlsx names joints, so that the table looks transposed" in said


# ---- reports with a name above lines of X, Y and Z


def report(form, name="POINT  {label}_{state}_B{k}", head="Metrolog X4\nUnité : mm\n\n", *, comma=False):
    text = head
    for s, state in enumerate(("VIDE", "CHARGE")):
        for k in (0, 1):
            for label, *p in points(CAMPAIGN, s, target=k):
                text += name.format(label=label, state=state, k=k + 1) + "\n"
                text += "".join(
                    form.format(axis=axis, value=value) + "\n" for axis, value in zip("XYZ", p, strict=True)
                )
    return text.replace(".", ",") if comma else text


REPORTS = {
    "Metrolog": report("   {axis}   {value}"),
    "signs and units": report("{axis} = {value} mm", "{label} {state} B{k}:", head=""),
    "decimal commas": report("{axis}: {value}", "Point {label} {state} B{k}", comma=True),
}


@pytest.mark.parametrize("form", REPORTS)
def test_a_report_with_names_above_coordinates_is_read(form, tmp_path):
    angles = joints(CAMPAIGN, [f"A{n}" for n in range(1, 7)], "Conf", comma=form == "decimal commas")
    assert_read({"rapport.txt": REPORTS[form], "axes.csv": angles}, tmp_path)


def test_a_point_without_a_coordinate_is_refused_at_its_line():
    lines = report("{axis} {value}").splitlines()
    del lines[9]  # Y of the second point
    said = refusals(("rapport.txt", "\n".join(lines).encode()))[0]
    assert said.startswith("rapport.txt:9:")
    assert "belongs to no point with a name and one X, Y and Z" in said


def test_a_file_with_readings_that_are_no_rows_is_not_to_be_left_out(tmp_path):
    lines = [
        f"{label} {axis} at {number}"
        for label, *p in points(CAMPAIGN, 0)
        for axis, number in zip("xyz", p, strict=True)
    ]
    said = refuse({"axes.csv": joints(CAMPAIGN), "report.txt": "\n".join(lines)}, tmp_path)
    assert "report.txt has no rows of numbers" in said
    assert "leave this file out" not in said


# ---- names of joints in paths


def meanings(headers, names=()):
    words = Vocabulary(ImportOptions(), names)
    words.add_names_of_table(headers)
    found = [words.find(header) for header in headers]
    return [each.axis if each is not None and each.kind == "joint" else None for each in found]


ALPHABET = sorted(ROS)
ORDER = [ROS.index(name) for name in ALPHABET]
NONE = [None] * 6


@pytest.mark.parametrize(
    ("form", "others"),
    [
        ("/joint_states/{}/position", ["/joint_states/{}/velocity", "/joint_states/{}/effort"]),
        ("joint_states.position.{}", []),
        ("/ur/actual/{}", ["/ur/target/{}"]),
    ],
)
def test_a_path_names_its_joint_in_any_order(form, others):
    headers = [each.format(name) for each in (form, *others) for name in ALPHABET]
    assert meanings(headers) == ORDER + NONE * len(others)


def test_numbered_joints_and_those_of_the_robot_are_found_in_paths():
    assert meanings([f"/joint_states/joint_{n}/position" for n in (2, 1, 3, 4, 5, 6)]) == [1, 0, 2, 3, 4, 5]
    own = [f"lbr_a{n}" for n in range(1, 8)]
    assert meanings([f"/states/{name}/position" for name in own[::-1]], own) == [6, 5, 4, 3, 2, 1, 0]


@pytest.mark.parametrize(
    "headers",
    [
        [f"{n}.{axis}" for n in range(1, 7) for axis in "xyz"],
        [f"A{n}.{axis}" for n in range(1, 7) for axis in "xyz"],
        [f"/{arm}/{name}/position" for arm in ("left", "right") for name in ROS],
    ],
    ids=["targets by numbers", "targets like axes", "two arms"],
)
def test_paths_that_are_not_clear_name_no_joint(headers):
    assert set(meanings(headers)) == {None}


def test_a_table_of_ros_is_read_with_its_joints_by_the_alphabet(tmp_path):
    angles = np.radians(UR_CAMPAIGN.joints)[:, ORDER]
    header = ["time", *(f"/joint_states/{name}/position" for name in ALPHABET)]
    rows = [[f"{1.7e9 + 60 * n:.3f}", *digits(q, 7)] for n, q in enumerate(angles)]
    unloaded, loaded = both(UR_CAMPAIGN)
    numbers = [digits(p, 4) for p in np.hstack([unloaded, loaded])]
    tracker = table(["x0", "y0", "z0", "x1", "y1", "z1"], numbers)
    assert_read({"joints.csv": table(header, rows, ","), "tracker.csv": tracker}, tmp_path, UR_CAMPAIGN)


def write_rows_of_messages(name, position):
    """Return rows of `rostopic echo -p` with columns of names and positions, the joints by the alphabet."""
    headers = ["%time", "field.header.seq", *map(name, range(6)), *map(position, range(6))]
    angles = np.radians(UR_CAMPAIGN.joints)[:, ORDER]
    rows = [[10**18 + n, 7 * n, *ALPHABET, *digits(q, 7)] for n, q in enumerate(angles)]
    return table(headers, rows, ",")


@pytest.mark.parametrize(
    ("name", "position"),
    [
        ("field.name{}".format, "field.position{}".format),
        ("name_{}".format, "position_{}".format),
        ("/joint_states/name[{}]".format, "/joint_states/position[{}]".format),
    ],
    ids=["rostopic echo -p", "bagpy", "PlotJuggler"],
)
def test_names_in_cells_say_the_joint_of_each_position(name, position, tmp_path):
    tracker = table(["x0", "y0", "z0", "x1", "y1", "z1"], [digits(p) for p in np.hstack(both(UR_CAMPAIGN))])
    files = {"states.csv": write_rows_of_messages(name, position), "tracker.csv": tracker}
    assert_read(files, tmp_path, UR_CAMPAIGN)


def test_names_that_change_between_messages_name_no_position():
    text = write_rows_of_messages("field.name{}".format, "field.position{}".format)
    assert read_rows_of_joint_states(text).headers[2:] == tuple(ALPHABET)
    first, second = ALPHABET[:2]
    swapped = text[::-1].replace(f"{first},{second}"[::-1], f"{second},{first}"[::-1], 1)[::-1]
    assert read_rows_of_joint_states(swapped) is None


# ---- archives of NumPy


def archive(save=np.savez, **arrays):
    output = io.BytesIO()
    save(output, **arrays)
    return output.getvalue()


NPZ = {
    "q": np.radians(CAMPAIGN.joints),
    "unloaded": CAMPAIGN.unloaded,
    "loaded": CAMPAIGN.loaded,
    "force": np.tile([0.0, 0.0, -981.0], (COUNT, 1)),
}


@pytest.mark.process
@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_an_archive_of_numpy_is_read_like_a_mat_file(save, tmp_path):
    (tmp_path / "data.npz").write_bytes(archive(save, **NPZ))
    stated = {key: each for key, each in STATED.items() if key != "force"}
    answer = js.read(tmp_path / "data.npz", robot=ARM, **stated).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


@pytest.mark.process
def test_arrays_by_columns_and_names_with_units_are_a_table():
    names = {"J_deg": CAMPAIGN.joints, "P1_unloaded_mm": 1e3 * CAMPAIGN.unloaded[:, 0]}
    content = archive(**{name: np.asfortranarray(each) for name, each in names.items()})
    with_columns = archive(**names)
    assert refusals(("a.npz", content)) == refusals(("a.npz", with_columns))


def with_axes(order):
    """Return joints (n, 6), two targets (n, 2, 3) and forces (n, 3), the axes of positions in this order."""
    stacks = {
        name: np.transpose(1e3 * each[:, :2], order)
        for name, each in (("p_free", CAMPAIGN.unloaded), ("p_load", CAMPAIGN.loaded))
    }
    return {"q_deg": CAMPAIGN.joints, **stacks, "F": NPZ["force"]}


@pytest.mark.process
@pytest.mark.parametrize(
    ("order", "is_turned"),
    [((0, 1, 2), False), ((2, 0, 1), True), ((1, 0, 2), True), ((2, 1, 0), True)],
    ids=["n×2×3, forces n×3", "3×n×2, forces 3×n", "2×n×3, forces 3×n", "3×2×n, forces 3×n"],
)
def test_arrays_are_read_whichever_axis_is_that_of_postures(order, is_turned, tmp_path):
    arrays = with_axes(order)
    forces = arrays["F"].T if is_turned else arrays["F"]
    (tmp_path / "data.npz").write_bytes(archive(**{**arrays, "F": forces}))
    stated = {key: each for key, each in STATED.items() if key != "force"}
    answer = js.read(tmp_path / "data.npz", robot=ARM, **stated).accept()
    measured = answer.measurement_set.model_dump(mode="json")
    assert judge(CAMPAIGN, measured) == []
    assert {tuple(each["force"]) for each in measured["observations"]} == {(0.0, 0.0, -981.0)}


class Harm:
    def __reduce__(self):
        return (print, ("harm",))


@pytest.mark.process
def test_a_pickled_object_is_refused_and_never_read(capfd):
    content = archive(q=np.zeros((4, 6)), harm=np.array([Harm()], dtype=object))
    assert "the array 'harm' has pickled objects of Python" in refusals(("a.npz", content))[0]
    assert "harm" not in capfd.readouterr().out
    assert pickle.dumps(Harm())  # the object would run on reading


@pytest.mark.process
def test_a_small_archive_with_a_huge_array_is_refused():
    content = archive(np.savez_compressed, q=np.zeros((100, 200, 1000)))
    assert len(content) < 1_000_000
    assert "the arrays of the file are larger than 64 MiB" in refusals(("a.npz", content))[0]


@pytest.mark.process
def test_a_damaged_archive_is_refused_in_a_sentence():
    content = archive(**NPZ)
    position = content.index(b"NUMPY") + 40
    damaged = content[:position] + b"\0" * 20 + content[position + 20 :]
    assert "damaged" in refusals(("a.npz", damaged))[0]


# ---- misspelt names of points


NAMED_POINTS = [
    [f"{label}_{target}_{state}", *p]
    for k, target in enumerate(("T10", "T11"))
    for s, state in enumerate(("unloaded", "loaded"))
    for label, *p in points(CAMPAIGN, s, target=k)
]


@pytest.mark.parametrize("states", [("loaded",), ("unloaded", "loaded")])
def test_a_misspelt_target_is_named_at_its_line_with_the_name_that_is_meant(states, tmp_path):
    misspelt = {f"P04_T10_{state}": f"P04_T1O_{state}" for state in states}
    rows = [[misspelt.get(name, name), *p] for name, *p in NAMED_POINTS]
    line = 1 + next(number for number, row in enumerate(rows, 1) if "T1O" in row[0])  # below the header
    said = refuse({"axes.csv": joints(CAMPAIGN), "points.csv": table(["name", *"XYZ"], rows)}, tmp_path)
    state = states[0]
    assert f"'points.csv', line {line}: only 'P04' has a row of T1O {state}" in said
    assert f"'P04' has no row of T10 {state}, which most observations have" in said
    assert f"if 'T10' was read, rename 'P04_T1O_{state}' to 'P04_T10_{state}'" in said


def test_a_row_that_few_observations_have_is_named_instead_of_the_others(tmp_path):
    rows = [*NAMED_POINTS, ["P06_T13_loaded", *NAMED_POINTS[0][1:]]]
    said = refuse({"axes.csv": joints(CAMPAIGN), "points.csv": table(["name", *"XYZ"], rows)}, tmp_path)
    assert f"line {1 + len(rows)}: only 'P06' has a row of T13 loaded; remedy: correct the name" in said
