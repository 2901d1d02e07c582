"""What `import` shows, writes, refuses and asks."""

import json
from pathlib import Path

import pytest
from support.command_lines import answered, assert_said, refused, typed
from support.importing_samples import CAMPAIGN, JOINTS, POINTS
from support.workbooks import table_of

from jointstiff.service.cli import imports
from jointstiff.simulator import default_arm, simulate_campaign

MEASURED = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)
TABLE = table_of(MEASURED)
STATED = "--encoders motor --load-point 0,0,120 --sigma 0.02"
FILES: dict[str, str | bytes] = {
    "table.csv": CAMPAIGN,
    "joints.csv": JOINTS,
    "points.txt": POINTS,
    "cell.csv": TABLE,
    "wrong.csv": TABLE.replace(b"[rad]", b"[deg]"),
    "robot.json": json.dumps(MEASURED["robot"]),
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    monkeypatch.chdir(tmp_path)


def test_a_table_is_shown_as_it_is_read_with_what_is_missing():
    assert_said(
        typed("import table.csv"),
        "table.csv: utf-8, semicolon between cells, decimal point, 3 rows",
        "┃ ┃ header ┃ read as ┃ unit ┃ first values ┃",
        "│ 1 │ label │ name │ │ c01; c02 │",
        "│ 3 │ J2 [deg] │ joint 2 │ deg │ -20.25; -35.125 │",
        "│ 7 │ Fz [N] │ force z │ N │ -1471.5; -1471.5 │",
        "│ 8 │ P10 unloaded x [mm] │ P10 unloaded x │ mm │ 1245.7134; 1102.5518 │",
        "│ 13 │ P10 loaded z [mm] │ P10 loaded z │ mm │ 237.9853; 316.8891 │",
        "assumed: comments were skipped (1 line); the first: 'cell 3, dead weight, 2026-11-20'",
        "3 observations (c01, c02, c03), 3 joints, 3 complete readings; targets: P10; states: unloaded, "
        "loaded",
        "missing: the load point (`--load-point`), in the flange frame",
        "missing: the encoders that close the position loop (`--encoders`): motor or secondary",
    )


def test_a_complete_table_is_written_as_a_set_in_its_own_units():
    about = "--about operator=A --about measured_at=2021-02-03T04:05:06Z"
    assert_said(
        typed(f"import table.csv {STATED} --name 'cell 3' -o set.json {about}"),
        "complete: a measurement set",
        "wrote set.json, a measurement set; now: add a robot with --robot",
    )
    stored = json.loads(Path("set.json").read_text())
    assert stored["units"] == {"length": "mm", "angle": "deg", "force": "N"}
    assert (stored["name"], stored["operator"]) == ("cell 3", "A")
    assert stored["measured_at"] == "2021-02-03T04:05:06Z"
    assert (stored["encoders"], stored["noise"]["sigma"]) == ("motor", 0.02)
    assert stored["load_point"] == [0.0, 0.0, 120.0]
    assert stored["observations"][1] == {
        "label": "c02",
        "joints": [-15.0, -35.125, 42.75],
        "force": [0.0, 0.0, -1471.5],
        "readings": [
            {
                "target": "P10",
                "unloaded": [1102.5518, 402.9017, 318.4406],
                "loaded": [1102.4127, 402.8613, 316.8891],
            }
        ],
    }


def test_a_template_states_what_the_next_file_of_the_form_needs():
    typed(f"import table.csv {STATED} --save-template t.json")
    template = json.loads(Path("t.json").read_text())
    assert template["columns"]["J1 [deg]"] == "joint 1 [deg]"
    assert template["columns"]["P10 loaded z [mm]"] == "P10 loaded z [mm]"
    assert len(template["layouts"][0]) == len(template["columns"]) == 13
    assert (template["delimiter"], template["decimal_mark"]) == ("semicolon", "point")
    assert (template["encoders"], template["noise"]) == ("motor", {"sigma": 0.02})
    assert (template["load_point"], template["length_unit"]) == ([0.0, 0.0, 120.0], "mm")
    answer = answered("import table.csv --template t.json")
    assert (answer["missing_fields"], answer["faults"]) == ([], [])
    assert (answer["observation_count"], answer["joint_count"], answer["reading_count"]) == (3, 3, 3)
    assert (answer["first_labels"], answer["targets"]) == (["c01", "c02", "c03"], ["P10"])
    (file,) = answer["files"]
    assert (file["header_lines"], file["first_lines"], file["row_count"]) == ([2], [3, 4, 5], 3)
    assert file["first_rows"][2][:4] == ["c03", "0.5", "-50", "61.0625"]
    assert not any(column["guessed"] for column in file["columns"])


def test_joints_and_points_in_two_files_are_one_set_and_guesses_are_marked():
    assert_said(
        typed(
            "import joints.csv points.txt --units length=mm,angle=deg,force=N --encoders secondary "
            "--load-point 0,0,120"
        ),
        "joints.csv: utf-8, comma between cells, decimal point, 2 rows",
        "points.txt: utf-8, semicolon between cells, decimal point, 4 rows",
        "│ 1 │ │ name ? │ │ c01_P10_unloaded; c01_P10_loaded │",
        "│ 2 │ │ position x ? │ mm │ 1245.7134; 1245.6021 │",
        "assumed: no header found; assumed columns: name, x, y, z",
        "2 observations (c01, c02), 2 joints, 2 complete readings; targets: P10; states: unloaded, loaded",
        "complete: a measurement set",
    )


def test_readings_of_a_known_robot_are_inspected_and_a_file_is_not_written_over():
    line = f"import cell.csv --robot robot.json {STATED} --output new.json"
    assert_said(
        typed(line),
        "│ 2 │ J1 [rad] │ joint 1 │ rad │ 0.393; -1.5543 │",
        "6 observations (c01, c02, c03, c04, c05, …), 6 joints, 18 complete readings; targets: P10, P11, "
        "P12; states: unloaded, loaded",
        "complete: a measurement set integrity: nothing suspicious",
        "wrote new.json, a campaign; now: jointstiff identify new.json",
    )
    written = Path("new.json").read_bytes()
    assert_said(typed(line), "new.json has this content already; now: jointstiff identify new.json")
    assert Path("new.json").read_bytes() == written
    other = line.replace("import ", "import --payload 310 ")
    assert refused(other).endswith("new.json exists remedy: choose another name, or use --overwrite")
    assert Path("new.json").read_bytes() == written


def test_readings_with_errors_are_written_only_despite_them():
    line = f"import wrong.csv --robot robot.json {STATED} --output other.json"
    past = "if the numbers are right, state `--despite-errors` to use the result"
    errors = (
        "do not use: the "
        "angles seem to be in rad, not in deg as declared: with the data as given, the targets keep their "
        "positions on the flange (up to 20 mm is plausible) in only 1 of 6 observations; with all "
        f"angles taken as radians, in 6 of 6, within 56.3 µm; change the unit of angles in the headers "
        f"from deg to rad; {past}"
    )
    assert_said(
        typed(line, status=1),
        f"{errors} other.json was not written: correct the errors, or use --despite-errors",
    )
    assert not Path("other.json").exists()
    assert_said(
        typed(f"{line} --despite-errors"),
        f"{errors} wrote other.json, a campaign; now: jointstiff identify other.json",
    )
    assert json.loads(Path("other.json").read_text())["measurement_set"]["units"]["angle"] == "deg"


@pytest.fixture
def asking(monkeypatch):
    """The commands ask as at a terminal."""
    monkeypatch.setattr(imports, "is_terminal_input", lambda: True)


@pytest.mark.usefixtures("asking")
def test_what_is_missing_is_asked_for_until_the_answer_can_be_used():
    bare = TABLE.decode().replace(" [rad]", "").replace(" [m]", "")
    lines = (line.replace(";", ";night;" if i else ";shift;", 1) for i, line in enumerate(bare.splitlines()))
    Path("cell.csv").write_text("\n".join(lines) + "\n")
    answers = [
        "",
        "rad",
        "mm in",
        "m",
        "",
        "0,0",
        "0,0,120",
        "",
        "robot.json",
        "drawing",
        "cell",
        "false",
        "still",
    ]
    said = typed("import cell.csv --output asked.json", input="\n".join(answers) + "\n")
    assert_said(
        said,
        "│ 2 │ shift │ ignored │ │ night; night │",
        "│ 3 │ J1 │ joint 1 │ rad │ 0.393; -1.5543 │",
        "complete: a measurement set integrity: nothing suspicious",
        "Press Enter for the answer in brackets; a question without brackets needs an answer.",
        "Meaning of column 'shift', such as J1 [deg] [ignore]:",
        "Unit of angles (rad, deg) [deg]:",
        "Unit of lengths (m, mm, in) [mm]:",
        "Error: answer one of m, mm, in Unit of lengths (m, mm, in) [mm]:",
        "Load point in the flange frame, X,Y,Z in mm (at the flange: 0,0,0), or the target at the hook:",
        "Load point in the flange frame, X,Y,Z in mm (at the flange: 0,0,0), or the target at the hook:",
        "Error: '0,0' must be three numbers, such as 0,0,120.5",
        "Encoders that close the position loop (motor, secondary) [motor]:",
        "Measured robot, for the integrity checks: file or arm [none]:",
        "How the load point is known (tracker, drawing, hand, unknown) [unknown]:",
        "wrote asked.json, a campaign; now: jointstiff identify asked.json",
    )
    stored = json.loads(Path("asked.json").read_text())["measurement_set"]
    assert stored["units"] == {"length": "m", "angle": "rad", "force": "N"}
    assert stored["load_point"] == pytest.approx([0.0, 0.0, 0.12])
    assert stored["encoders"] == "motor"
    assert stored["noise"]["grounds"] == {
        "load_point": "drawing",
        "force": "cell",
        "tared": False,
        "between": "still",
    }


@pytest.mark.usefixtures("asking")
def test_words_of_states_and_a_far_load_point_are_asked_for():
    Path("pre.csv").write_text(CAMPAIGN.replace("unloaded", "pre").replace("loaded", "post"))
    said = typed(
        "import pre.csv --output asked.json",
        input="\n".join(["", "0,0,6000", "", "y", "none", "", "", ""]) + "\n",
    )
    assert_said(
        said,
        "│ 8 │ P10 pre x [mm] │ P10 unloaded x │ mm │ 1245.7134; 1102.5518 │",
        "│ 11 │ P10 post x [mm] │ P10 loaded x │ mm │ 1245.6021; 1102.4127 │",
        "Word for readings without load (pre, post) [pre]:",
        "Encoders that close the position loop (motor, secondary) [motor]:",
        "Is this value correct: the load point is 6 m from the flange (up to 5 m is plausible)? [y/N]:",
        "wrote asked.json, a measurement set; now: add a robot with --robot",
    )
    stored = json.loads(Path("asked.json").read_text())
    assert stored["load_point"] == [0.0, 0.0, 6000.0]
    assert "noise" not in stored  # who presses Enter states nothing


@pytest.mark.usefixtures("asking")
def test_a_ground_that_an_option_states_is_not_asked_for():
    Path("pre.csv").write_text(CAMPAIGN)
    options = "--load-point 0,0,120 --encoders motor --sigma 0.02 --ground load_point=tracker"
    said = typed(f"import pre.csv {options} --output stated.json", input="none\n\n\n")
    assert "How the load point is known" not in said
    noise = json.loads(Path("stated.json").read_text())["noise"]
    assert (noise["sigma"], noise["grounds"]) == (0.02, {"load_point": "tracker"})


@pytest.mark.usefixtures("asking")
def test_the_target_at_the_hook_answers_the_question_about_the_load_point():
    """Its ground is then no question: the reading shows the load point."""
    Path("pre.csv").write_text(CAMPAIGN)
    said = typed("import pre.csv --encoders motor --output hook.json", input="P10\nnone\n\n\n")
    assert "How the load point is known" not in said
    stored = json.loads(Path("hook.json").read_text())
    assert (stored["load_point_target"], stored.get("load_point")) == ("P10", None)


@pytest.mark.parametrize("between", ["payload_declared", "gravity_compensated"])
def test_readings_of_a_load_that_the_controller_knew_of_are_not_written(between):
    Path("pre.csv").write_text(CAMPAIGN)
    options = f"--load-point 0,0,120 --encoders motor --ground between={between} --output known.json"
    said = typed(f"import pre.csv {options}", status=2)
    assert_said(said, "the readings without and under load", "measure again with", "`still`")
    assert not Path("known.json").exists()


@pytest.mark.usefixtures("asking")
def test_only_a_load_cell_has_the_question_whether_it_was_tared():
    Path("pre.csv").write_text(CAMPAIGN)
    options = "--load-point 0,0,120 --encoders motor --ground load_point=hand"
    question = "Whether the load cell was tared before each reading (true, false, unknown)"
    said = typed(f"import pre.csv {options} --output pulley.json", input="none\npulley\n\n")
    assert "What the force is known by (scales, cell, pulley, catalogue, unknown)" in said
    assert question not in said
    said = typed(f"import pre.csv {options} --ground force=cell --output cell.json", input="none\ntrue\n\n")
    assert question in said
    grounds = [
        json.loads(Path(f"{name}.json").read_text())["noise"]["grounds"] for name in ("pulley", "cell")
    ]
    assert grounds == [
        {"load_point": "hand", "force": "pulley"},
        {"load_point": "hand", "force": "cell", "tared": True},
    ]


@pytest.mark.parametrize(
    ("option", "where", "words"),
    [
        ("force=guess", "--ground.force", "'scales', 'cell', 'pulley' or 'catalogue'"),
        ("force=cell --ground tared=maybe", "--ground.tared", "must be true or false"),
        ("tared=true", "--ground", "state `force` as `cell`"),
    ],
)
def test_a_ground_of_the_force_that_cannot_be_used_is_refused_with_a_remedy(option, where, words):
    Path("pre.csv").write_text(CAMPAIGN)
    assert_said(typed(f"import pre.csv --ground {option}", status=2), where, words)


def test_an_unknown_ground_is_refused_with_the_known_ones():
    Path("pre.csv").write_text(CAMPAIGN)
    said = typed("import pre.csv --ground load_point=guess", status=2)
    assert_said(said, "--ground.load_point", "'tracker', 'drawing' or 'hand'")


@pytest.mark.parametrize(
    ("old", "new", "answer", "remedy"),
    [
        ("P10 unloaded ", "P10 roh ", "'P10 roh z [mm]'", "--state-word roh=unloaded"),
        ("Fz [N]", "Kraft [kg]", "kg is the unit of a mass", "--column 'Kraft [kg]=mass [kg]'"),
    ],
)
def test_a_printed_option_for_a_header_explains_the_header(old, new, answer, remedy):
    text = Path("table.csv").read_text()
    if new.startswith("Kraft"):  # one column of load instead of three
        rows = [line.split(";") for line in text.splitlines() if not line.startswith("#")]
        text = "\n".join(";".join(row[:4] + row[6:]) for row in rows).replace("-1471.5", "150")
    assert old in text
    Path("table.csv").write_text(text.replace(old, new))
    words = refused("import table.csv")
    assert answer in words
    assert f"`{remedy}`" in words
    assert "3 complete readings" in typed(f"import table.csv {remedy}")


WITHOUT_FORCE = "\n".join(
    ";".join(cell for n, cell in enumerate(line.split(";")) if n not in (4, 5, 6))
    for line in CAMPAIGN.splitlines()[1:]
)


@pytest.mark.parametrize(
    ("force", "newtons"),
    [
        ("0,0,-1177.2N", [0.0, 0.0, -1177.2]),
        ("0 0 -1177.2 N", [0.0, 0.0, -1177.2]),
        ("[0; 0; -1.1772] kN", [0.0, 0.0, -1177.2]),
        ("0,0,-98.1daN", [0.0, 0.0, -981.0]),
        ("-120kg", [0.0, 0.0, -120 * 9.80665]),
        ("120 kg", [0.0, 0.0, -120 * 9.80665]),
        ("0,0,-120 kp", [0.0, 0.0, -120 * 9.80665]),
    ],
)
@pytest.mark.parametrize("is_option", [True, False])
def test_a_force_is_typed_with_its_unit(force, newtons, is_option, monkeypatch):
    Path("free.csv").write_text(WITHOUT_FORCE)
    if is_option:
        typed(f"import free.csv {STATED} --force='{force}' -o set.json")
    else:
        monkeypatch.setattr(imports, "is_terminal_input", lambda: True)
        typed(f"import free.csv {STATED} -o set.json", input=f"{force}\nnone\n\n\n\n\n")
    stored = json.loads(Path("set.json").read_text())
    size = {"N": 1.0, "kN": 1e3, "kgf": 9.80665}[stored["units"]["force"]]
    assert [size * each for each in stored["observations"][0]["force"]] == pytest.approx(newtons)


@pytest.mark.parametrize("force", ["0,0", "100", "0,0,-100 t", "0,0,-100 mm", "1e", "N", "0,0,-1N,2"])
def test_a_force_without_three_numbers_or_a_known_unit_is_refused(force):
    Path("free.csv").write_text(WITHOUT_FORCE)
    said = refused(f"import free.csv {STATED} --force='{force}' -o set.json")
    assert "three numbers with their unit N, daN, kN, kgf or lbf" in " ".join(said.split())


def test_a_force_in_another_unit_than_the_units_option_is_refused():
    Path("free.csv").write_text(WITHOUT_FORCE)
    said = refused(f"import free.csv {STATED} --force=0,0,-1N --units force=kN")
    assert "is in N, but --units has force=kN" in " ".join(said.split())
