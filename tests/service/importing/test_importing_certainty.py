"""What is not understood for certain is asked about or refused, never guessed."""

import pytest
from support.importing_samples import (
    CAMPAIGN,
    MM,
    POINTS,
    answered,
    faults,
    points_of,
    read,
    refused,
    sources_of,
    values_of,
)
from support.workbooks import table_of

from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.resources.imports import import_files
from jointstiff.simulator import default_arm, simulate_campaign

ROWS = [line.split(";") for line in POINTS.splitlines()]


def force_as(header):
    return CAMPAIGN.replace("Fz [N]", header)


# ---- words for states


@pytest.mark.parametrize(
    "word", ["StdDev", "Std.Dev", "stddev", "Unc", "Median", "RMSE", "Standardabweichung"]
)
def test_statistics_are_no_targets(word):
    between = CAMPAIGN.replace("P10 unloaded", f"P10 {word} before").replace(
        "P10 loaded", f"P10 {word} after"
    )
    for content in (between, CAMPAIGN.replace("P10 ", "P10StdDev ")):
        assert all(one.reason.startswith("unknown column header") for one in faults(("a.csv", content)))
    assert read(("a.csv", CAMPAIGN.replace("P10 ", "SD1 "))).preview.targets == ["SD1"]


# ---- frames and units in remarks


# ---- headers


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


# ---- times, temperatures, uncertainties


def uncertain(header, *cells):
    head = f"name;x [mm];y [mm];z [mm];{header}\n"
    return head + "".join(f"{';'.join(row)};{cell}\n" for row, cell in zip(ROWS, cells, strict=True))


def test_an_empty_position_needs_no_uncertainty():
    table = uncertain("U95 [mm]", "0.03", "0.03", "", "").replace(";".join(ROWS[2][1:]), ";;")
    imported = read(("a.csv", table.replace(";".join(ROWS[3][1:]), ";;")), allow_missing=True)
    assert {label for label, _, _ in points_of(imported)} == {"c01"}


# ---- faults that hide others, or say the same many times

UNCLEAR = "x [mm];y [mm];z [mm];name\n" + "".join(f"1;2;3.5;c{row}-P10-A_1_2_3\n" for row in range(40))
OTHERWISE = "label;J1 [deg];Fx [N];Fy [N];Fz [N]\n01;1;0;0;-15\n02;1;0;0;-15\n"


@pytest.mark.parametrize(
    ("files", "options", "reasons", "remedy"),
    [
        (
            [("a.csv", " \n"), ("b.csv", CAMPAIGN.replace("-20.25", "?"))],
            {},
            ["the file is empty", "'?' is not a number with a decimal point"],
            "check the export",
        ),
        (
            [("a.csv", UNCLEAR)],
            {},
            [
                "the name 'c0-P10-A_1_2_3' does not show which observation, target and state it is, "
                "and 39 other names are not clear either"
            ],
            "point_name",
        ),
        (
            [("j.csv", OTHERWISE), ("p.csv", POINTS)],
            {"units": MM},
            [
                "'c01' and 1 others have no joint, but other labels have: '01', '02'",
                "'c01' and 1 others have no force, but other labels have: '01', '02'",
                "01: target P10 has no reading",
                "02: target P10 has no reading",
            ],
            "'c01', 'c02'",
        ),
        (
            [("a.csv", "label;x_t;y_t;z_t\nc01;1;2;3\n")],
            {},
            ["'x_t', read as t x, has no unit, nor have 2 others"],
            "`x_t [mm]`, or give `units`; if it means something else, give `columns`, such as x_t=x",
        ),
    ],
)
def test_faults_are_told_once(files, options, reasons, remedy):
    found = faults(*files, **options)
    assert [fault.reason for fault in found] == reasons
    assert remedy in found[0].remedy


def test_a_name_is_not_taken_for_an_option():
    fault = refused(
        ("a.csv", "shift;x [mm];y [mm];z [mm]\nok;1;2;3.5\n"), line=1, ignore=["shift"], reason="no column"
    )
    assert "`name`" not in fault.remedy  # the terminal would say `--name` for it


# ---- names and templates of what is made of the files


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
    small = "the numbers seem to be in m, but are read as mm"
    assert finding.remedy == f"check the unit of `load_point`; {small}"
