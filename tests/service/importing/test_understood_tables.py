"""Tables that are understood: units, forces, masses, decimal marks, headers, missing readings, templates."""

import pytest
from support.importing_samples import (
    BARE,
    CAMPAIGN,
    CAMPAIGN_NUMBERS,
    GROUPED,
    JOINTS,
    MM,
    POINTS,
    READ_POINTS,
    STATES,
    answered,
    meanings_of,
    numbers_of,
    points_of,
    read,
    refusals,
)

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.conversion.units import FORCE, MOMENT

COMMENT = "comments were skipped (1 line); the first: 'cell 3, dead weight, 2026-11-20'"
ROWS = [line.split(";") for line in CAMPAIGN.splitlines()[1:]]
BODY = "".join(f"{';'.join(row)}\n" for row in ROWS[1:])
JOINTS_MISSING = "joint angles of each observation: columns `J1 [deg]`, `J2 [deg]`, … (lengths as `J3 [mm]`)"
FORCE_MISSING = (
    "the force of each observation in axes of R0: columns `Fx [N]`, `Fy [N]`, `Fz [N]`, or one `force` "
    "(N, daN, kN, kgf, lbf)"
)


def test_a_table_becomes_a_measurement_set():
    answer = answered(("a.csv", CAMPAIGN), noise={"sigma": 0.02}, name="x")
    made = answer.measurement_set
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert made.units.model_dump() == {"length": "mm", "angle": "deg", "force": "N", "moment": None}
    assert (made.name, made.encoders, made.load_point) == ("x", "motor", (0.0, 0.0, 120.0))
    assert (made.noise.sigma, made.joint_kinds) == (0.02, ["revolute"] * 3)
    assert (answer.observation_count, answer.joint_count, answer.reading_count) == (3, 3, 3)
    assert (answer.targets, answer.states) == (["P10"], ["unloaded", "loaded"])
    assert (answer.missing, answer.assumptions, answer.leave_out) == ([], [], [])
    assert answer.files[0].assumptions == [COMMENT]
    assert meanings_of(answer)[3:9] == [
        "joint 3 [deg]", "force x [N]", "force y [N]", "force z [N]",
        "P10 unloaded x [mm]", "P10 unloaded y [mm]",
    ]  # fmt: skip


def test_a_row_that_is_a_comment_is_not_read_and_told():
    answer = answered(("a.csv", CAMPAIGN.replace("c02;", "#2;")))
    assert numbers_of(answer) == [CAMPAIGN_NUMBERS[0], CAMPAIGN_NUMBERS[2]]
    assert answer.files[0].assumptions == [
        COMMENT.replace("1 line", "2 lines"),
        "1 comments look like rows of data, and were not read",
    ]


@pytest.mark.parametrize(
    ("text", "options", "notes", "guesses"),
    [
        (CAMPAIGN.replace(".", ","), {}, ["the comma was used as the decimal mark"], []),
        (BARE, {"units": MM}, [], []),
        (CAMPAIGN.replace("J1 [deg]", "Winkel  A [deg]").replace("label", "Nr"),
         {"columns": {"Winkel A [deg]": "J1", "Nr": "label"}}, [], []),
        (CAMPAIGN.replace("Fz [N]", "Kraft_C_t_mean"), {"columns": {"Kraft_C_t_mean": "Fz [N]"}}, [], []),
        (CAMPAIGN.replace("Fz [N]", "Kraft C (links)"), {"columns": {"Kraft C (links)": "Fz [N]"}}, [], []),
        (CAMPAIGN.replace("Fz [N]", "Kraft C N"), {"columns": {"Kraft C N": "Fz [N]"}}, [], ["force z [N]?"]),
        (CAMPAIGN.replace("Fz [N]", "Kraft_x_m"), {"columns": {"Kraft_x_m": "Fz [N]"}}, [], []),
        (CAMPAIGN.replace("Fz [N]", "Kraft N"), {"columns": {"Kraft N": "Fz"}}, [], ["force z [N]?"]),
        (CAMPAIGN.replace("J1 [deg]", "J1_deg"), {}, [], ["joint 1 [deg]?"]),
        (CAMPAIGN.replace("P10 unloaded x [mm]", "x_m"), {"columns": {"x_m": "P10 unloaded x [mm]"}}, [], []),
    ],
    ids=["commas", "no units", "other words", "t", "links", "N", "m", "unit of the header", "deg", "x"],
)  # fmt: skip
def test_the_same_readings_written_otherwise_are_the_same_set(text, options, notes, guesses):
    answer = answered(("a.csv", text), encoders="secondary", **options)
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].assumptions == [COMMENT, *notes]
    assert [meaning for meaning in meanings_of(answer) if meaning.endswith("?")] == guesses
    assert (answer.measurement_set.name, answer.measurement_set.encoders) == ("a", "secondary")


def test_joints_and_a_list_of_points_make_one_set():
    answer = answered(("joints.csv", JOINTS), ("points.txt", POINTS), units=MM)
    read_points = {
        (label, target, state): place
        for label, _, _, targets in numbers_of(answer)
        for target, places in targets.items()
        for state, place in zip(("unloaded", "loaded"), places, strict=True)
    }
    assert read_points == READ_POINTS
    assert [(label, joints) for label, joints, _, _ in numbers_of(answer)] == [
        ("c01", [10.5, -20.25]),
        ("c02", [-15.0, -35.125]),
    ]
    assert answer.measurement_set.name == "joints"
    assert answer.files[1].assumptions == ["no header found; assumed columns: name, x, y, z"]
    assert meanings_of(answer, 1) == ["name?", "position x [mm]?", "position y [mm]?", "position z [mm]?"]


DEFLECTIONS = """label,J1 [rad],J2 [rad],Fx [kgf],Fy [kgf],Fz [kgf],Mx [Nm],My [Nm],Mz [Nm],\
load point x [m],load point y [m],load point z [m],target,dx [m],dy [m],dz [m],comment
c01,0.1,0.2,0,0,-150,1,2,3,0.1,0.2,0.3,P10,0.0001,0.0002,-0.0013,ok
c01,0.1,0.2,0,0,-150,1,2,3,0.1,0.2,0.3,P11,0.0002,0.0003,-0.0012,
"""


def test_deflections_moments_and_load_points_keep_their_units():
    targets = {"P10": (0, 0, 0.1), "P11": (0.1, 0, 0.1)}
    answer = answered(("a.csv", DEFLECTIONS), flange_targets=targets, load_point=None)
    (one,) = answer.measurement_set.observations
    assert answer.measurement_set.units.model_dump() == {
        "length": "m", "angle": "rad", "force": "kgf", "moment": "N.m"
    }  # fmt: skip
    assert (one.label, [*one.joints], one.force) == ("c01", [0.1, 0.2], (0.0, 0.0, -150.0))
    assert (one.moment, one.load_point) == ((1.0, 2.0, 3.0), (0.1, 0.2, 0.3))
    assert [(each.target, each.deflection) for each in one.readings] == [
        ("P10", (0.0001, 0.0002, -0.0013)),
        ("P11", (0.0002, 0.0003, -0.0012)),
    ]
    assert meanings_of(answer)[-1] == "ignored"


def test_pounds_and_foot_pounds_are_units_of_forces_and_moments():
    targets = {"P10": (0, 0, 0.1), "P11": (0.1, 0, 0.1)}
    table = DEFLECTIONS.replace("[kgf]", "[lbf]").replace("[Nm]", "[ft·lbf]")
    units = answered(("a.csv", table), flange_targets=targets, load_point=None).measurement_set.units
    assert (units.force, units.moment) == ("lbf", "lbf.ft")
    assert FORCE["lbf"] == pytest.approx(0.45359237 * 9.80665, rel=1e-15)
    assert MOMENT["lbf.ft"] == pytest.approx(0.3048 * FORCE["lbf"], rel=1e-15)
    assert 12.0 * MOMENT["lbf.in"] == pytest.approx(MOMENT["lbf.ft"], rel=1e-15)


def test_deflections_need_targets_and_a_load_point_that_a_tool_reaches():
    answer = answered(("a.csv", DEFLECTIONS))
    assert answer.measurement_set is None
    assert list(zip(answer.missing_fields, answer.missing, strict=True)) == [
        ("flange_targets", "the targets' positions in the flange frame (`flange_targets`), for deflections"),
        (
            "accept_unusual",
            "a confirmation (`accept_unusual`) that these values are correct: the load point is 120 m from "
            "the flange (up to 5 m is plausible)",
        ),
    ]


STATE_POINTS = {("c01", "P10", "unloaded"): (1.0, 2.0, 3.5), ("c01", "P10", "loaded"): (1.5, 2.0, 3.0)}


def test_states_stand_in_a_column_in_any_case():
    answer = answered(("a.txt", STATES))
    assert points_of(read(("a.txt", STATES))) == STATE_POINTS
    assert (answer.missing_fields, answer.missing) == (["joints", "force"], [JOINTS_MISSING, FORCE_MISSING])
    assert (answer.reading_count, answer.joint_count) == (1, None)


def test_a_word_for_a_state_is_stated():
    warm = "a.txt", STATES.replace("Loaded", "warm")
    assert answered(warm, show_faults=True).faults[0].words == ["warm"]
    assert points_of(read(warm, state_words={"Warm": "loaded"})) == STATE_POINTS


def hung(header="mass [kg]", mass="150"):
    """Write the table with a hung mass in place of forces."""
    rows = [[*row[:4], header if index == 0 else mass, *row[7:]] for index, row in enumerate(ROWS)]
    return "a.csv", "\n".join(map(";".join, rows)) + "\n"


@pytest.mark.parametrize(
    "header", ["mass [kg]", "Payload (kg)", "hung_mass [kg]", "Gewicht [kg]", "weight [kgf]"]
)
def test_a_hung_mass_pulls_down_by_its_weight(header):
    answer = answered(hung(header))
    assert {one.force for one in answer.measurement_set.observations} == {(0.0, 0.0, -150.0)}
    assert answer.measurement_set.units.force == "kgf"
    assert [row[3] for row in numbers_of(answer)] == [row[3] for row in CAMPAIGN_NUMBERS]
    assert answer.files[0].assumptions == [
        "the weight of each mass, 9.80665 N per kilogram, pulls along −z of R0"
    ]


def test_a_hung_mass_stands_in_place_of_forces():
    lines = [f"{';'.join(row)};{'150' if index else 'mass [kg]'}" for index, row in enumerate(ROWS)]
    assert refusals(("a.csv", "\n".join(lines) + "\n")) == [
        "a.csv:1:14: 'mass [kg]' states the load, but columns of forces state the load, too; skip one of "
        "these columns with `ignore`"
    ]


ONE = "label;J1 [deg];Fx [N];Fy [N];Fz [N]\nc01;{};0;0;-1500\n"


@pytest.mark.parametrize(
    ("text", "options", "angle", "assumed"),
    [
        (ONE.format("1,234"), {"decimal_mark": "comma"}, 1.234, []),
        (ONE.format("1,234") + "c02;0,5;0;0;-1500\n", {}, 1.234, ["the comma was used as the decimal mark"]),
        (ONE.format("1.234"), {}, 1.234,
         ["the point was read as the decimal mark, although three digits follow it in every "
          "number: check that the point is not a thousands separator"]),
    ],
)  # fmt: skip
def test_three_digits_behind_a_mark_are_decimals_where_that_is_sure(text, options, angle, assumed):
    imported = read(("a", text), **options)
    assert next(iter(imported.observations[0].values.values())).vector == (angle,)
    assert imported.preview.files[0].assumptions == assumed


def test_a_comma_that_may_separate_thousands_is_asked_about():
    assert refusals(("a", ONE.format("1,234"))) == [
        "a:2:2: '1,234' may have a decimal comma or a thousands separator; no other number in the file "
        "shows which; give `decimal_mark`, or write a decimal point [decimal_mark]"
    ]
    said = refusals(("a", ONE.format("1,234")), decimal_mark="point")
    assert said[0].startswith("a:2:2: '1,234' is not a number with a decimal point; use digits with")


GAP = "a.csv", CAMPAIGN.replace("1102.5518;402.9017;318.4406", ";;")


def test_a_missing_reading_is_skipped_only_if_it_is_allowed():
    assert refusals(GAP) == [
        "a.csv:4:8: c02: target P10 was read only loaded; "
        "add the reading, check the spelling of names, or use `allow_missing` [allow_missing]"
    ]
    answer = answered(GAP, allow_missing=True)
    assert numbers_of(answer) == [CAMPAIGN_NUMBERS[0], CAMPAIGN_NUMBERS[2]]
    assert answer.assumptions == [
        "c02: target P10 was read only loaded; skipped",
        "c02: no reading is complete; the observation was skipped",
    ]
    more = answered(
        ("j.csv", JOINTS + "c04,1,2,0,0,-1471.5\n"), ("p.txt", POINTS), units=MM, allow_missing=True
    )
    assert [row[0] for row in numbers_of(more)] == ["c01", "c02"]
    assert more.assumptions[0] == "c04: target P10 has no reading; skipped"


@pytest.mark.parametrize(
    ("cells", "hole", "state"),
    [
        ("1102.5518;402.9017;318.4406", "1102.5518;;318.4406", "unloaded"),
        ("1102.4127;402.8613;316.8891", "1102.4127;402.8613;", "loaded"),
    ],
)
def test_a_target_with_an_empty_coordinate_is_left_out_whole_if_gaps_are_allowed(cells, hole, state):
    holed = "a.csv", CAMPAIGN.replace(cells, hole)
    (refused,) = refusals(holed)
    assert refused.endswith(
        "the cell is empty, but needs a number; fill in the cell, or use `allow_missing` to leave this "
        "reading out [allow_missing]"
    )
    answer = answered(holed, allow_missing=True)
    assert numbers_of(answer) == [CAMPAIGN_NUMBERS[0], CAMPAIGN_NUMBERS[2]]
    assert answer.assumptions[0] == f"c02: a coordinate of target P10 {state} has no number; skipped"


@pytest.mark.parametrize("mark", ["n/a", "N/A", "NA", "NaN", "-", "–", "null", '""'])
@pytest.mark.parametrize("count", [1, 3])
def test_a_mark_for_a_missing_number_is_an_empty_cell_of_a_reading(mark, count):
    """With one coordinate or all three marked, only this reading is left out, if gaps are allowed."""
    point = ["1102.4127", "402.8613", "316.8891"]
    holed = "a.csv", CAMPAIGN.replace(";".join(point), ";".join([*[mark] * count, *point[count:]]))
    assert all("`allow_missing`" in each for each in refusals(holed))
    assert numbers_of(answered(holed, allow_missing=True)) == [CAMPAIGN_NUMBERS[0], CAMPAIGN_NUMBERS[2]]


def test_an_unloaded_point_with_an_empty_coordinate_is_left_out_with_a_note():
    lines = [f"p0{k},{k},{10 * k},30,1000,{cell},3" for k, cell in enumerate(("2", "", "4"), 1)]
    header = "label,J1 [deg],J2 [deg],J3 [deg],P1 x [mm],P1 y [mm],P1 z [mm]"
    answer = answered(("a.csv", "\n".join([header, *lines])), state="unloaded", allow_missing=True)
    assert "p02: a coordinate of target P1 has no number; skipped" in answer.assumptions
    assert [each.targets["P1"][1] for each in answer.geometry.poses] == [2.0, 4.0]


def held(*marks):
    """Write the table with a column of observations that judge the fit."""
    rows = zip(ROWS, ("validation", *marks), strict=True)
    return "a.csv", "".join(";".join([row[0], mark, *row[1:]]) + "\n" for row, mark in rows)


def test_observations_are_held_out_by_a_column():
    answer = answered(held("1", "", "0"))
    assert (answer.leave_out, numbers_of(answer)) == (["c01"], CAMPAIGN_NUMBERS)
    assert answer.assumptions == ["observations held out from the fit, to check the fit: c01"]
    assert [each.unit for each in answer.files[0].columns if each.meaning == "validation"] == [None]
    assert refusals(held("yes", "", "0")) == [
        "a.csv:2:2: 'yes' is neither 0 nor 1; write 1 to hold the observation out from the fit, else 0"
    ]


def test_a_header_is_stated_for_a_file_without_one():
    assert numbers_of(answered(("a.csv", BODY), header=ROWS[0])) == CAMPAIGN_NUMBERS


@pytest.mark.parametrize("word", ["in", "Zoll", "pouces", "INCHES"])
def test_inches_become_millimetres(word):
    imported = read(("a.csv", f"name;x [{word}];y [{word}];z [{word}]\n{POINTS.splitlines()[0]}\n"))
    (place,) = points_of(imported).values()
    assert place == pytest.approx((31641.12036, -7876.86258, 6075.71556), rel=1e-12)
    assert imported.preview.files[0].assumptions == [
        "lengths in inches, also those in the options, were converted to mm"
    ]


def test_decanewtons_of_columns_become_newtons():
    table = CAMPAIGN.replace("[N]", "[daN]")
    answer = answered(("a.csv", table))
    forces = [tuple(10.0 * each for each in force) for _, _, force, _ in CAMPAIGN_NUMBERS]
    assert [force for _, _, force, _ in numbers_of(answer)] == forces
    assert answer.measurement_set.units.force == "N"
    assert "forces in daN were converted to N" in answer.files[0].assumptions
    again = import_again(("a.csv", table), answer)
    assert numbers_of(again) == numbers_of(answer)


def import_again(file, answer):
    """Import a file with the template of an earlier import."""
    return answered(file, **answer.template.model_dump(exclude_unset=True))


def test_decanewtons_of_the_option_become_newtons():
    columns = answered(("a.csv", CAMPAIGN.replace(" [N]", "")), units={"force": "daN"})
    forces = [tuple(10.0 * each for each in force) for _, _, force, _ in CAMPAIGN_NUMBERS]
    assert [force for _, _, force, _ in numbers_of(columns)] == forces
    stated = answered(("a.csv", GROUPED), units={**MM, "force": "daN"}, force=(0.0, 0.0, -98.1))
    assert stated.measurement_set.units.force == "N"
    assert [each.force for each in stated.measurement_set.observations] == [(0.0, 0.0, -981.0)]


def test_moments_without_a_unit_are_never_in_decanewtons_times_metres():
    table = "label;J1 [deg];Fx [daN];Fy [daN];Fz [daN];Mx;My;Mz;P10 dx;P10 dy;P10 dz\n"
    table += "c01;10.5;0;0;-98;0;5;0;0.001;0.002;-0.00125\n"
    assert refusals(("a.csv", table), units={"length": "m"})[0].startswith(
        "a.csv:1:6: moment x and 2 other columns have no unit"
    )


def test_a_header_of_two_rows_below_a_title_is_combined():
    table = (
        "Messung Zelle 3\nPunkt;Achse [deg];;Kraft [N];;;P10 unbelastet [mm];;;P10 mit Last [mm];;\n"
        ";1;2;x;y;z;x;y;z;x;y;z\nc01;10,5;-20;0;0;-1471,5;1,5;2;3;1,5;2;2,5\n"
    )
    answer = answered(("a.csv", table))
    places = ((1.5, 2.0, 3.0), (1.5, 2.0, 2.5))
    assert numbers_of(answer) == [("c01", [10.5, -20.0], (0.0, 0.0, -1471.5), {"P10": places})]
    assert answer.files[0].assumptions == [
        "rows above the header were read as titles: 1",
        "the header was combined from rows 2, 3",
        "the comma was used as the decimal mark",
    ]
    assert all(meaning.endswith("?") for meaning in meanings_of(answer))
    assert answered(("a.csv", GROUPED), units=MM).missing_fields == ["force"]
    assert points_of(read(("a.csv", GROUPED), units=MM))["c01", "P10", "loaded"] == (1.0, 2.0, 2.5)


def test_numbers_far_from_their_column_are_asked_about():
    rows = [
        f"c{i:02};{10 * i}.5;0;0;-1471.5;{1200 + 7 * i}.5;2.5;3;{1200 + 7 * i};2.5;{3 - i / 8}"
        for i in range(20)
    ]
    rows[7] = rows[7].replace(";1249.5;", ";12495;")
    rows[9] = rows[9].replace(";90.5;", ";90500;")
    places = ";".join(f"P1 {state} {axis} [mm]" for state in "ul" for axis in "xyz")
    file = "day.csv", "\n".join([f"label;J1 [deg];Fx [N];Fy [N];Fz [N];{places}", *rows]) + "\n"
    answer = answered(file)
    assert (answer.missing_fields, answer.measurement_set) == (["accept_unusual"], None)
    assert answer.missing == [
        "a confirmation (`accept_unusual`) that these values are correct: "
        "joint 1 90500 ('day.csv', line 11) is 1608 times the spread of the "
        "other values away from the median (up to 100 times is plausible); "
        "P1 unloaded x 12495 ('day.csv', line 9, column 6) is 287 times the spread of the "
        "other values away from the median (up to 100 times is plausible)"
    ]
    accepted = numbers_of(answered(file, accept_unusual=True))
    assert (accepted[9][1], accepted[7][3]["P1"][0][0]) == ([90500.0], 12495.0)


def test_a_load_point_beyond_five_metres_is_asked_about():
    assert answered(("a.csv", CAMPAIGN), load_point=(0, 0, 5000)).missing == []
    assert answered(("a.csv", CAMPAIGN), load_point=(0, 0, 5001)).missing_fields == ["accept_unusual"]


@pytest.mark.parametrize(
    ("file", "name", "length"),
    [(" .csv", "readings", 8), ("\u2028.csv", "readings", 8), ("a" * 240 + ".csv", "a" * 10, 200)],
)
def test_a_set_has_a_name_whatever_that_of_its_file(file, name, length):
    poses = "name;J1 [deg];P unloaded x [mm];P unloaded y [mm];P unloaded z [mm]\nc01;1;2;3;4\n"
    for made in (answered((file, poses)).geometry, answered((file, CAMPAIGN)).measurement_set):
        assert (made.name[:10], len(made.name)) == (name, length)


PLAIN = CAMPAIGN.replace(" [deg]", "")


def test_a_template_reads_the_same_form_again():
    whole = answered(("a.csv", PLAIN), units={"angle": "deg"}, name="x")
    again_as_json = ImportRequest.model_validate_json(whole.template.model_dump_json())
    options = again_as_json.model_dump(exclude_none=True)
    again = answered(("day2.csv", PLAIN), **options, name="x")
    assert again.measurement_set == whole.measurement_set
    assert numbers_of(again) == CAMPAIGN_NUMBERS
    assert again.template == whole.template.model_copy(update={"name": again.template.name})


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("J1;", "q1;", "missing: 'J1'; not in the template: 'q1'"),
        ("[mm]", "[m]", "missing: 'P10 unloaded x [mm], P10 unloaded y [mm], P10 unloaded z [mm…'; "
         "not in the template: 'P10 unloaded x [m], P10 unloaded y [m], P10 unloaded z [m], …'"),
    ],
)  # fmt: skip
def test_a_template_refuses_another_form(old, new, said):
    template = answered(("a.csv", PLAIN), units={"angle": "deg"}).template.model_dump(exclude_none=True)
    assert refusals(("a.csv", PLAIN.replace(old, new)), **template)[0] == (
        f"a.csv:2: the file does not fit the template; {said}; import the file without the template "
        "(`layouts`), or correct the file"
    )
    comma = refusals(("a.csv", PLAIN.replace(".", ",")), **template)
    assert comma[0].startswith("a.csv:3:2: '10,5' is not a number with a decimal point")


def test_files_beyond_what_a_template_holds_are_read_without_one():
    spare = [f"spare {number}" for number in range(256)]
    head, rows = ";".join(ROWS[0]), BODY.splitlines()
    joints = [";".join(row[:4]) for row in ROWS]
    first = "\n".join([";".join([head, *spare[:240]]), *(row + ";1" * 240 for row in rows)]) + "\n"
    second = "\n".join([";".join([joints[0], *spare[240:]]), *(row + ";1" * 16 for row in joints[1:])]) + "\n"
    answer = answered(("a.csv", first), ("b.csv", second), ignore=spare)
    assert (numbers_of(answer), answer.template) == (CAMPAIGN_NUMBERS, None)
