"""Tables of a weight step: motor and link angles of a row, read as the same request as JSON or refused."""

import io
import json
import random
from pathlib import Path

import openpyxl
import pytest
from support.terminal import terminal

import jointstiff as js
from jointstiff.schemas.gearbox import parse_load
from jointstiff.schemas.imports import ImportOptions
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.reading import understand_files
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.problems import CampaignError

EXAMPLES = Path(__file__).parents[3] / "examples"
STEP = json.loads((EXAMPLES / "weight_step.json").read_text())
HEADER = [
    "label",
    *(f"J{number} [deg]" for number in range(1, 7)),
    *("joint", "state", "approach", "motor [deg]", "link [deg]"),
]
JOINT, STATE, APPROACH, MOTOR, LINK = range(7, 12)


def rows_of(step):
    """The header, then a row of cells for each state of each reading."""
    rows = [HEADER]
    for posture in step["observations"]:
        joints = [repr(float(each)) for each in posture["joints"]]
        for reading in posture["encoder_readings"]:
            for state in ("unloaded", "loaded"):
                angles = [repr(reading[state][encoder]) for encoder in ("motor", "link")]
                rows.append(
                    [posture["label"], *joints, reading["joint"], state, reading["approach"], *angles]
                )
    return rows


def text_of(rows, delimiter=","):
    return "\n".join(delimiter.join(row) for row in rows) + "\n"


def understand(content, name="step.csv", joints=(), **options):
    content = content.encode() if isinstance(content, str) else content
    return understand_files([SourceFile(name, content)], ImportOptions(**options), joints)


def read(rows, **options):
    """The observations of a table as a document."""
    understood = understand(text_of(rows), **options)
    if understood.faults:
        raise understood.faults[0]
    return understood.weight_step.model_dump(mode="json")["observations"]


def changed(row, column, cell):
    rows = [list(each) for each in rows_of(STEP)]
    rows[row][column] = cell
    return rows


def workbook(rows):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append([float(cell) if _is_number(cell) else cell for cell in row])
    content = io.BytesIO()
    book.save(content)
    return content.getvalue()


def _is_number(cell):
    try:
        float(cell)
    except ValueError:
        return False
    return True


def test_a_table_has_the_readings_of_the_same_step_in_json():
    assert read(rows_of(STEP)) == STEP["observations"]


def test_a_table_in_excel_or_with_decimal_commas_is_the_same():
    of_excel = understand(workbook(rows_of(STEP)), "step.xlsx")
    assert of_excel.weight_step.model_dump(mode="json")["observations"] == STEP["observations"]
    commas = text_of(rows_of(STEP), ";").replace(".", ",")
    assert understand(commas).weight_step.model_dump(mode="json")["observations"] == STEP["observations"]


def test_rows_may_be_in_any_order_and_joints_have_numbers():
    head, *rows = rows_of(STEP)
    random.Random(1).shuffle(rows)  # noqa: S311
    numbered = [[*row[:JOINT], row[JOINT].removeprefix("joint_"), *row[STATE:]] for row in rows]
    names = [f"joint_{number}" for number in range(1, 7)]

    def sort(observations):
        return {posture["label"]: sorted(posture["encoder_readings"], key=str) for posture in observations}

    assert sort(read([head, *numbered], joints=names)) == sort(STEP["observations"])


def test_a_table_is_identified_as_the_same_step_in_json(tmp_path):
    file = tmp_path / "step.csv"
    numbered = text_of(rows_of(STEP)).replace("joint_", "J")
    file.write_text(numbered.replace("J2,", "2,"))  # as people write numbers of joints
    (tmp_path / "robot.json").write_text(json.dumps(STEP["robot"]))
    by_table = js.gearbox(file, robot=str(tmp_path / "robot.json"), load=STEP["load"])
    by_json = js.gearbox(STEP)
    assert by_table.result.gearboxes == by_json.result.gearboxes


def test_an_import_has_the_step_and_names_its_use(tmp_path):
    file = tmp_path / "step.csv"
    file.write_text(text_of(rows_of(STEP)))
    readings = js.import_files(file, robot=STEP["robot"])
    assert readings.weight_step.units.model_dump() == {"length": "mm", "angle": "deg"}
    assert (readings.observation_count, readings.reading_count, readings.missing) == (12, 48, [])
    with pytest.raises(CampaignError, match="identify its gearboxes") as refused:
        _ = readings.campaign
    assert refused.value.problem.where == "files"


def test_the_terminal_imports_a_table_and_identifies_it_with_its_load(tmp_path):
    file, robot, step = tmp_path / "step.csv", tmp_path / "robot.json", tmp_path / "step.json"
    file.write_text(text_of(rows_of(STEP)))
    robot.write_text(json.dumps(STEP["robot"]))
    imported = terminal("import", file, "--robot", robot, "-o", step)
    assert "complete: a weight step of two encoders" in imported.output
    assert set(json.loads(step.read_text())) == {"units", "observations", "robot"}
    shown = [
        terminal("gearbox", *source, "--load", "100±0.3,0,0,150", "--json")
        for source in ((file, "--robot", robot), (step,))
    ]
    one, other = (json.loads(each.stdout)["result"]["gearboxes"] for each in shown)
    assert one == other
    assert one[0]["stiffness"] > 1e6


REFUSED = {
    "an unknown state": (changed(1, STATE, "half"), "the state 'half' is unknown"),
    "an unknown side": (changed(1, APPROACH, "up"), "the approach 'up' is unknown"),
    "an angle that is none": (changed(1, MOTOR, "n/a"), "'n/a'"),
    "another posture of one label": (changed(2, 1, "44.0"), "joint 1 of 's01' is at 44, and at 4.2759"),
    "a state twice": (changed(2, STATE, "unloaded"), "has two rows of joint_2 that are unloaded"),
    "a state that is missing": (
        [row for k, row in enumerate(rows_of(STEP)) if k != 2],
        "'s01' has no row of joint_2 from \\+ that is loaded",
    ),
    "a link in gon": (changed(0, LINK, "link [gon]"), "the unit of 'link \\[gon\\]' is not one of deg, rad"),
    "a link in rad": (changed(0, LINK, "link [rad]"), "have different units"),
    "no joints": ([[row[0], *row[JOINT:]] for row in rows_of(STEP)], "has no column J1, J2"),
    "a joint left out": ([[row[0], *row[2:]] for row in rows_of(STEP)], "has no column J1, J2"),
    "another column": (
        changed(0, APPROACH, "torque [N.m]"),
        "'torque \\[N.m\\]' of a weight step is unknown",
    ),
    "no rows": ([HEADER], "has no row"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_understood_is_refused_by_its_place(case):
    rows, words = REFUSED[case]
    with pytest.raises(ImportFileError, match=words):
        read(rows)


def test_a_joint_that_the_robot_lacks_is_refused():
    with pytest.raises(ImportFileError, match="the robot has no joint 'joint_3'"):
        read(rows_of(STEP), joints=("A1", "A2"))


def test_a_step_is_imported_alone():
    text = text_of(rows_of(STEP))
    files = [SourceFile("a.csv", text.encode()), SourceFile("b.csv", f"{text}\n".encode())]
    (fault,) = understand_files(files, ImportOptions()).faults
    assert fault.reason == "a weight step was sent with further tables"


def test_a_damaged_table_is_refused_or_differs_in_the_damaged_cell_alone():
    draw = random.Random(7)  # noqa: S311
    rows = rows_of(STEP)[:17]
    text, without_joints = text_of(rows), {(row[0], *row[JOINT:]) for row in rows[1:]}
    accepted = 0
    for _ in range(400):
        place = draw.randrange(len(text))
        damaged = text[:place] + draw.choice(',;\n\t"-+.x0é') + text[place + draw.choice([0, 1]) :]
        understood = understand(damaged)
        if understood.weight_step is None:
            assert understood.faults
            continue
        accepted += 1
        found = rows_of(understood.weight_step.model_dump(mode="json"))[1:]
        assert len({(row[0], *row[JOINT:]) for row in found} - without_joints) <= 2
    assert 15 < accepted < 385


def test_another_table_is_no_weight_step(tmp_path):
    with pytest.raises(js.CampaignError, match="no columns of motor and link angles"):
        js.gearbox(Path(EXAMPLES / "readings.csv"), robot=STEP["robot"], load=STEP["load"])


def test_a_load_on_the_command_line_is_a_mass_and_its_place():
    assert parse_load("100.2±0.1,0,0,150") == {
        "mass": 100.2,
        "mass_uncertainty": 0.1,
        "point": [0.0, 0.0, 150.0],
    }
    assert parse_load("5, 0 0 80") == {"mass": 5.0, "point": [0.0, 0.0, 80.0]}
    with pytest.raises(ValueError, match="must state a mass in kg and the place of its centre"):
        parse_load("heavy,0,0,0")
