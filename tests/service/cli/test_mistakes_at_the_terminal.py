"""Mistakes at the terminal: the answer names the cause, and its remedy, carried out, works."""

import json
import shlex

import pytest
from support.documents import campaign
from support.terminal import terminal

from jointstiff.schemas.correction import are_programs
from robotprograms import FORMATS

POSTURES = """\
label,J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg],Fx [N],Fy [N],Fz [N]
a,0,0,0,0,30,0,0,0,-500
"""

POINTS = ";".join(f"A {state} {axis} [mm]" for state in ("unloaded", "loaded") for axis in "xyz")
READINGS = f"""\
label;J1 [deg];{POINTS}
a;10;1000.1;20.5;300.2;1000.2;20.4;299.1
b;20;950.3;310.4;301.7;950.2;310.6;300.4
"""

AREA = {
    "area": [[1.4, -0.2, 0.6], [1.8, 0.2, 0.6]],
    "grid": [2, 2, 1],
    "place": [0, 0, 0.25],
    "force": [0, 0, -500],
}


def table_of(document):
    """Return a campaign's readings as a table of text, with the states as columns."""
    observations = document["measurement_set"]["observations"]
    targets = [reading["target"] for reading in observations[0]["readings"]]
    header = ["label", *(f"J{i} [rad]" for i in range(1, 7)), *(f"F{axis} [N]" for axis in "xyz")]
    states = ("unloaded", "loaded")
    header += [f"{target} {state} {axis} [m]" for target in targets for state in states for axis in "xyz"]
    rows = [header]
    for each in observations:
        places = [reading[state] for reading in each["readings"] for state in states]
        rows.append([each["label"], *each["joints"], *each["force"], *(c for place in places for c in place)])
    return "\n".join(";".join(map(str, row)) for row in rows)


CORRECTED = "--tool 0,0,250,0,0,0 --force 0,0,-500 -o rows.csv --overwrite"
COMPENSATED = "--force 0,0,-500 --accuracy-option off -o program.src --overwrite"
FIRST_MOVE = "PTP {A1 2,A2 40,A3 -48,A4 0,A5 60,A6 0}\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mistakes")
    (folder / "pull.json").write_text(json.dumps(campaign("pull", 8, 2)))
    (folder / "postures.csv").write_text(POSTURES)
    (folder / "bounds.json").write_text(json.dumps({"stiffness_bounds": {"joint_2": [1e6, None]}}))
    (folder / "map.json").write_text(json.dumps(AREA))
    in_millimetres = [[1e3 * part for part in corner] for corner in AREA["area"]]
    (folder / "far.json").write_text(json.dumps(AREA | {"area": in_millimetres}))
    (folder / "my pull.json").write_text(json.dumps(campaign("pull", 8, 2)))
    (folder / "result.json").write_text(json.dumps({"kind": "plan", "result": {}, "provenance": {}}))
    (folder / "monday").mkdir()
    (folder / "monday" / "m.json").write_text(json.dumps(campaign("pull", 8, 3)))
    (folder / "other.json").write_text(json.dumps(campaign("pull", 8, 4)))
    (folder / "readings.csv").write_text(READINGS)
    (folder / "all.csv").write_text(table_of(campaign("pull", 8, 2)))
    (folder / "arm.json").write_text(json.dumps(campaign("pull", 8, 2)["robot"]))
    (folder / "path.src").write_text(PROGRAM)
    (folder / "path.ls").write_text(PROGRAM)
    (folder / "lin.src").write_text(PROGRAM.replace(FIRST_MOVE, ""))
    (folder / "poses.csv").write_text("\n".join(row.partition(";")[2] for row in ROWS.splitlines()))
    return folder


@pytest.mark.parametrize(
    ("mistake", "answer", "correction"),
    [
        ("identify pul.json", "does not exist; give pull.json", "identify pull.json"),
        ("identify -", "give /dev/stdin to read the standard input", "identify pull.json"),
        (
            "identify my pull.json",
            "a name with blanks needs quotes: 'my pull.json'",
            "identify 'my pull.json'",
        ),
        (
            "identify 'KUKA KR 210 R2700'",
            "is an arm of the catalogue, which has no readings",
            "identify pull.json",
        ),
        (
            "robots KUKA KR",
            "Write the name of the arm in quotes",
            "robots 'KUKA KR 210 R2700 extra'",
        ),
        (
            "identify pull.json --save nowhere/run.json",
            "there is no folder 'nowhere'",
            "identify pull.json --save saved.json",
        ),
        (
            "geometry result.json",
            "give readings, not a result: `jointstiff examples FOLDER` writes examples",
            "examples shown",
        ),
        (
            "identify monday",
            "'monday' is a folder; give a file in it: monday/m.json",
            "identify monday/m.json",
        ),
        (
            "identify pull.json --options bound.json",
            "give bounds.json",
            "identify pull.json --options bounds.json",
        ),
        (
            "identify pull.json --prior joint_2=3.1:0.1",
            "give stiffnesses in N·m/rad (prismatic: N/m); 3.1 · 10⁶ N·m/rad in a table is 3.1e6",
            "identify pull.json --prior joint_2=3.1e6:1e5",
        ),
        (
            "correct pull.json path.src --accuracy-option off -o o.src --overwrite --force 0,0,-50kg",
            "'0,0,-50kg' must be numbers in N, such as 0,0,-490.3 for 50 kg: 1 kg weighs 9.80665 N",
            "correct pull.json path.src --accuracy-option off -o o.src --overwrite --force 0,0,-490.3",
        ),
        ("identify pull.json --method magic", "'partial_pose'", "identify pull.json --method partial_pose"),
        ("identify pull.json --unit furlong", "'Nm/arcmin'", "identify pull.json --unit Nm/arcmin"),
        ("identify pull.json --cause moon", "give one of: constant_force", "identify pull.json --cause play"),
        (
            "identify pull.json --confidence 95",
            "less than or equal to",
            "identify pull.json --confidence 0.95",
        ),
        ("identify pull.json --leave-out c99", "no observation 'c99'", "identify pull.json --leave-out c08"),
        (
            "identify pull.json --confidence 95%",
            "'95%' must be a number",
            "identify pull.json --confidence 0.95",
        ),
        (
            "map pull.json --area 1400,-200,600",
            'State `area` in a JSON file, such as {"area": [[1.2, -0.6, 0.4], [2.0, 0.6, 0.8]]} in m, and '
            "give the file by --options",
            "map pull.json --options map.json",
        ),
        ("map pull.json map.json", "such as --options map.json", "map pull.json --options map.json"),
        (
            "plan pull.json 1 --candidates 50",
            "Give a value after the name of its option, and a list with commas, such as --readings 1",
            "plan pull.json --candidates 50 --readings 1",
        ),
        (
            "identify pull.json --leave-out c01 c08",
            "a list with commas",
            "identify pull.json --leave-out c08",
        ),
        (
            "identify pull.json -leave-out c08",
            "Invalid value for --leave-out: is written with two dashes",
            "identify pull.json --leave-out c08",
        ),
        (
            "identify pull.json --json again.json",
            "--json prints the result; --save again.json writes it",
            "identify pull.json --save again.json --overwrite",
        ),
        (
            "identify all.csv arm.json",
            "all.csv is a table: `jointstiff import all.csv --robot ROBOT --output CAMPAIGN.json`",
            "import all.csv --robot arm.json --output again.json --overwrite --encoders motor "
            "--load-point 0,0,120 --sigma 0.02 --yes",
        ),
        (
            "import all.csv arm.json --encoders motor --load-point 0,0,120",
            "the file has no table of numbers",
            "import all.csv --robot arm.json --encoders motor --load-point 0,0,120 --yes",
        ),
        (
            "identify pull.json --html",
            "`jointstiff report FILE -o report.html` writes such a file",
            "report pull.json -o report.html --overwrite",
        ),
        (
            "predict pull.json postures.csv --load-point 0,0,120 --force 0,0,-500",
            "State forces in the columns Fx [N], Fy [N] and Fz [N] of the table POSTURES",
            "predict pull.json postures.csv --load-point 0,0,120",
        ),
        (
            "plan pull.json --readings many --candidates 50",
            "'many' must be a whole number",
            "plan pull.json --readings 1 --candidates 50",
        ),
        ("identify pull.json --resample many", "many", "identify pull.json --resample 6:10"),
        (
            "identify pull.json --robot KR210",
            "No such option: --robot. The campaign states it: import the readings again, `jointstiff import "
            "READINGS --robot ROBOT`, or change `robot` in the campaign's file",
            "import all.csv --robot pull.json --encoders motor --load-point 0,0,120 --sigma 0.02 --yes "
            "--output again.json --overwrite",
        ),
        (
            "compare pull.json --encoders secondary",
            "`jointstiff import READINGS --encoders <motor|secondary>`, or change "
            "`measurement_set.encoders` in the campaign's file",
            "compare pull.json",
        ),
        (
            "identify pull.json --goal 15%",
            "--goal is an option of `jointstiff plan`, `jointstiff measure`",
            "plan pull.json --goal 15% --candidates 200",
        ),
        (
            "pull.json",
            "it is a file. Give the command first: jointstiff identify pull.json",
            "identify pull.json",
        ),
        (
            "compare pull.json pull.json",
            "both campaigns have the same robot and the same readings, so that each ratio is 1 remedy: give "
            "two different campaigns; or give one campaign, to compare methods",
            "compare pull.json",
        ),
        (
            "identify pull.json monday/m.json",
            "Give one campaign: `jointstiff compare` takes two",
            "compare pull.json monday/m.json",
        ),
        (
            "compare pull.json monday/m.json other.json",
            "Give one or two campaigns",
            "compare pull.json monday/m.json",
        ),
        (
            "identify arm.json",
            "arm.json is a robot without readings remedy: measure the robot first: `jointstiff plan FILE` "
            "plans what to measure, and `jointstiff import READINGS --robot FILE` makes a campaign of the "
            "readings",
            "import all.csv --robot arm.json --encoders motor --load-point 0,0,120 --yes --output made.json "
            "--overwrite",
        ),
        (
            "--method complete_pose identify pull.json",
            "Give the options of a command after its name: jointstiff COMMAND FILE --OPTION",
            "identify pull.json --method complete_pose",
        ),
        ("identify -h", "No such option: -h (Possible options: --help)", "identify --help"),
        ("help", "Did you mean 'jointstiff --help'?", "--help"),
        ("identify pull.json --weight 3", "No such option", "identify pull.json --weighting uniform"),
        (
            "predict pull.json postures.csv",
            "--load-point",
            "predict pull.json postures.csv --load-point 0,0,120",
        ),
        (
            "predict pull.json postures.csv --load-point 0,0,99999",
            "check the unit of the point",
            "predict pull.json postures.csv --load-point 0,0,99.999",
        ),
        (
            "predict pull.json poses.csv --load-point 0,0,120",
            "a table of poses is for `jointstiff correct`",
            f"correct pull.json poses.csv {CORRECTED} --start 3,-45,70,0,65,0",
        ),
        (
            f"correct pull.json poses.csv {CORRECTED} --start 0.05,-0.79,1.22,0,1.13,0",
            "the start seems to be in radians, not in degrees",
            f"correct pull.json poses.csv {CORRECTED} --start 2.865,-45.26,69.9,0,64.74,0",
        ),
        (
            f"correct pull.json lin.src {COMPENSATED} --start 0.05,-0.79,1.22,0,1.13,0",
            "the start seems to be in radians, not in degrees",
            f"correct pull.json lin.src {COMPENSATED} --start 2.865,-45.26,69.9,0,64.74,0",
        ),
        (
            f"correct pull.json path.ls {COMPENSATED}",
            "is a program in KUKA's language, but was read as FANUC's language",
            f"correct pull.json path.ls {COMPENSATED} --format krl",
        ),
        (
            "plan pull.json --readings 6 --candidates 200 --area 15000,-500,600,20000,500,1200",
            "its nearest place is 15 m from the origin of R0, and the arm reaches at most",
            "plan pull.json --readings 6 --candidates 500 --area 1000,-1000,300,2500,1000,2500",
        ),
        ("plan pull.json --readings 0 --candidates 50", "1", "plan pull.json --readings 1 --candidates 50"),
    ],
)
def test_a_mistake_is_answered_with_a_remedy_that_works(folder, monkeypatch, mistake, answer, correction):
    monkeypatch.chdir(folder)
    refused = terminal(*shlex.split(mistake), width=200)
    assert refused.exit_code != 0
    said = " ".join((refused.stdout + refused.stderr).split())
    assert answer in said
    assert "openapi" not in said
    assert terminal(*shlex.split(correction), width=200).exit_code == 0


def test_a_map_in_metres_is_at_the_base_and_its_unit_is_named(folder, monkeypatch):
    monkeypatch.chdir(folder)
    small = [[1e-3 * part for part in corner] for corner in AREA["area"]]
    (folder / "small.json").write_text(json.dumps(AREA | {"area": small}))
    said = " ".join(terminal("map", "pull.json", "--options", "small.json", width=200).stdout.split())
    assert (
        "check the unit of `area`, and move it: all its places are within 1.91 mm of the origin of R0" in said
    )


def test_a_map_in_millimetres_is_beyond_reach_and_its_unit_is_named(folder, monkeypatch):
    monkeypatch.chdir(folder)
    said = " ".join(terminal("map", "pull.json", "--options", "far.json", width=200).stdout.split())
    advice = "move `area`, whose lengths are in m: its nearest place is 1540 m from the origin of R0"
    assert f"{advice}, and the tool reaches at most" in said
    assert advice[:10] not in terminal("map", "pull.json", "--options", "map.json", width=200).stdout


ROWS = """\
{header};x [mm];y [mm];z [mm];rx [deg];ry [deg];rz [deg]
P1;1700.0;100.0;900.0;0.0;180.0;0.0
P2;1710.0;110.0;900.0;0.0;180.0;0.0
"""
CORRECT = ("--tool", "0,0,250,0,0,0", "--force", "0,0,-800")
PROGRAM = """\
DEF drill()
$TOOL={X 0,Y 0,Z 250,A 0,B 0,C 0}
$BASE={X 0,Y 0,Z 0,A 0,B 0,C 0}
PTP {A1 2,A2 40,A3 -48,A4 0,A5 60,A6 0}
LIN {X 1700,Y 100,Z 900,A 0,B 180,C 0}
END
"""


def words_of(result):
    return " ".join((result.stdout + result.stderr).split())


class TestCorrect:
    """Mistakes in a call of `correct`."""

    @pytest.fixture(autouse=True)
    def in_folder(self, folder, monkeypatch):
        monkeypatch.chdir(folder)

    @pytest.mark.parametrize("header", ["label", "Punkt", "Name", "Point", "Messpunkt"])
    def test_a_header_that_names_rows_for_an_import_names_them_here(self, folder, header):
        (folder / "rows.csv").write_text(ROWS.format(header=header))
        result = terminal("correct", "pull.json", "rows.csv", *CORRECT, width=200)
        assert result.exit_code == 1  # without `--start` the posture is not certain
        assert "rows: 2 ambiguous" in result.stdout

    def test_an_unknown_column_of_texts_is_named_with_its_file_and_the_header_to_write(self, folder):
        (folder / "rows.csv").write_text(ROWS.format(header="Bahn"))
        words = words_of(terminal("correct", "pull.json", "rows.csv", *CORRECT, width=200))
        assert "of the column 'Bahn' is not a number" in words
        assert "correction.rows" not in words
        assert "if the column names the rows, call the column `label`" in words

    def test_no_file_is_written_without_a_corrected_row_so_that_the_remedy_works(self, folder):
        (folder / "rows.csv").write_text(ROWS.format(header="label"))
        call = ("correct", "pull.json", "rows.csv", *CORRECT, "-o", "out.csv")
        refused = terminal(*call, width=200)
        assert refused.exit_code == 1
        assert "`--start`" in words_of(refused)
        assert "1 reason of its own" in words_of(refused)
        assert "out.csv was not written: no row is corrected" in words_of(refused)
        assert not (folder / "out.csv").exists()
        started = terminal(*call, "--start", "3,-45,70,0,65,0", width=200)
        assert "exists" not in words_of(started)
        assert started.exit_code == 0, words_of(started)
        assert (folder / "out.csv").exists()

    def test_every_ending_of_a_program_is_known(self):
        endings = {each for language in FORMATS.values() for each in language.suffixes.split()}
        assert [each for each in endings if not are_programs([f"a{each}"], None)] == [".csv"]

    def test_a_program_is_corrected(self, folder):
        (folder / "drill.src").write_text(PROGRAM)
        call = ("correct", "pull.json", "drill.src", "--force", "0,0,-800", "--accuracy-option", "off")
        done = terminal(*call, "-o", "mended.src", width=200)
        assert done.exit_code == 0, words_of(done)
        assert (folder / "mended.src").exists()
