"""What is not understood for certain is asked about or refused, never guessed."""

import pytest
from support.importing_samples import (
    CAMPAIGN,
    POINTS,
    answered,
    points_of,
    read,
    sources_of,
    values_of,
)
from support.workbooks import table_of

from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.importing.reading import SourceFile, understand_files
from jointstiff.service.resources.imports import import_files
from jointstiff.simulator import default_arm, simulate_campaign

ROWS = [line.split(";") for line in POINTS.splitlines()]


def force_as(header):
    return CAMPAIGN.replace("Fz [N]", header)


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


def uncertain(header, *cells):
    head = f"name;x [mm];y [mm];z [mm];{header}\n"
    return head + "".join(f"{';'.join(row)};{cell}\n" for row, cell in zip(ROWS, cells, strict=True))


def test_an_empty_position_needs_no_uncertainty():
    table = uncertain("U95 [mm]", "0.03", "0.03", "", "").replace(";".join(ROWS[2][1:]), ";;")
    imported = read(("a.csv", table.replace(";".join(ROWS[3][1:]), ";;")), allow_missing=True)
    assert {label for label, _, _ in points_of(imported)} == {"c01"}


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
    assert finding.message.startswith("the lengths seem to be in m, not in mm as declared: the load points")
    assert finding.remedy == "check the unit of `load_point`"


def test_the_preview_has_the_rows_with_faults_beyond_the_first_ones():
    rows = [f"c{i:02d},10,20,{'1.2.3' if i == 11 else '5'}" for i in range(1, 13)]
    table = "\n".join(["label,joint_1 [deg],joint_2 [deg],joint_3 [deg]", *rows, ""])
    understood = understand_files([SourceFile("a.csv", table.encode())])
    file = understood.preview.files[0]
    assert any(fault.place.line == 12 for fault in understood.faults)
    assert 12 not in file.first_lines
    assert (file.fault_lines, file.fault_rows) == ([12], [["c11", "10", "20", "1.2.3"]])


def test_a_template_reads_the_same_form_and_no_other():
    files = [SourceFile("a.csv", CAMPAIGN.replace("[deg]", "").encode())]
    request = ImportRequest(units={"angle": "deg"}, encoders="motor", load_point=(0.0, 0.0, 0.0), name="x")
    first = import_files(files, request)
    template = ImportRequest.model_validate_json(first.template.model_dump_json())
    again = import_files([SourceFile("day2.csv", files[0].content)], template)
    assert again.measurement_set.model_copy(update={"name": "x"}) == first.measurement_set
    assert again.template == first.template
    for old, new, reason in (
        ("J1 ", "q1 ", "does not fit the template; missing: 'J1'; not in the template: 'q1'"),
        ("[mm]", "[m]", "does not fit the template"),
        (";", ",", "does not fit the template"),
        (".", ",", "decimal"),
    ):
        changed = SourceFile("a.csv", files[0].content.decode().replace(old, new).encode())
        shown = import_files([changed], template.model_copy(update={"show_faults": True}))
        assert any(reason in fault.reason for fault in shown.faults), (old, shown.faults)
