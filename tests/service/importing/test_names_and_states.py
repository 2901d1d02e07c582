"""Names of points and files: label, target and state; words for states; rows matched by their order."""

import pytest
from support.importing_samples import (
    CAMPAIGN,
    CAMPAIGN_NUMBERS,
    JOINTS,
    MM,
    POINTS,
    READ_POINTS,
    answered,
    meanings_of,
    numbers_of,
    points_of,
    read,
    refusals,
)

from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.rows import Template

NEITHER = (
    "the target and the state is given neither by the table nor by the names of points or the file; "
    "state it by `state`, name points as in `c01_P10_loaded`, or the file as in `P10_loaded.txt`, "
    "or give templates `point_name` or `file_name` [state]"
)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("before", "after"), ("vorher", "nachher"), ("avant", "après"), ("ohne", "mit"), ("off", "on"),
        ("Before", "AFTER"), ("sans", "avec"),
    ],
)  # fmt: skip
def test_states_have_words_in_three_languages(before, after):
    table = CAMPAIGN.replace("unloaded", before).replace(" loaded", f" {after}")
    assert numbers_of(answered(("a.csv", table))) == CAMPAIGN_NUMBERS


def test_the_digits_of_states_are_a_guess_that_is_shown():
    answer = answered(("a.csv", CAMPAIGN.replace("unloaded", "0").replace(" loaded", " 1")))
    assert numbers_of(answer) == CAMPAIGN_NUMBERS
    assert answer.files[0].assumptions[1] == "0 and 1 in headers were read as `unloaded` and `loaded`"
    assert [meaning.endswith("?") for meaning in meanings_of(answer)] == 7 * [False] + 6 * [True]


def test_words_that_may_be_states_are_asked_about():
    file = "a.csv", CAMPAIGN.replace("unloaded", "pre").replace(" loaded", " post")
    assert refusals(file) == [
        "a.csv:2:8: 'pre' and 'post' in the headers of positions may be states, but their meaning is "
        "unknown; "
        'name the state of each, such as `state_words`: {"pre": "unloaded", "post": "loaded"} [state_words]'
    ]
    assert answered(file, show_faults=True).faults[0].words == ["pre", "post"]
    assert numbers_of(answered(file, state_words={"pre": "unloaded", "post": "loaded"})) == CAMPAIGN_NUMBERS


AFTER = """label,j1 [deg],Fx [N],Fy [N],Fz [N],P1 unloaded x [mm],P1 unloaded y [mm],P1 unloaded z [mm],\
P1 loaded x [mm],P1 loaded y [mm],P1 loaded z [mm],P1 WORDS x [mm],P1 WORDS y [mm],P1 WORDS z [mm]
c01,0,0,0,-500,1,2,3,1,2,2.5,1,2,2.9
c02,10,0,0,-500,4,5,6,4,5,5.5,,,
"""


@pytest.mark.parametrize("words", ["unloaded after", "unloaded 2", "nach Entlastung", "again", "UL2"])
def test_a_position_after_unloading_has_a_state_of_its_own_and_may_be_missing(words):
    imported = read(("day.csv", AFTER.replace("WORDS", words)))
    assert points_of(imported) == {
        ("c01", "P1", "unloaded"): (1.0, 2.0, 3.0),
        ("c01", "P1", "loaded"): (1.0, 2.0, 2.5),
        ("c01", "P1", "unloaded_after"): (1.0, 2.0, 2.9),
        ("c02", "P1", "unloaded"): (4.0, 5.0, 6.0),
        ("c02", "P1", "loaded"): (4.0, 5.0, 5.5),
        ("c02", "P1", "unloaded_after"): None,
    }


DIGITS = "c01_P1_0 1 2 3.5\nc01_P1_1 1 2 4.5\n"


def test_digits_behind_names_are_states_where_nothing_else_says_them():
    imported = read(("day.txt", DIGITS), units={"length": "mm"})
    assert points_of(imported) == {
        ("c01", "P1", "unloaded"): (1.0, 2.0, 3.5),
        ("c01", "P1", "loaded"): (1.0, 2.0, 4.5),
    }
    assert imported.preview.assumptions == ["0 and 1 in names were read as `unloaded` and `loaded`"]
    assert refusals(("loaded.txt", DIGITS), units={"length": "mm"}) == [
        "loaded.txt:1:1: the name 'c01_P1_0' does not show the observation, the target and the state of "
        "the point, and 1 other names are also unclear; give a template `point_name`, such as "
        "{label}_{target}_{state} [point_name]"
    ]


NUMBERED = "name;P_0 x [mm];P_0 y [mm];P_0 z [mm];P_1 x [mm];P_1 y [mm];P_1 z [mm]\n"


def test_digits_behind_targets_are_theirs_where_rows_name_the_state():
    rows = "c01_loaded;1;2;3.5;101;2;4.5\nc01_unloaded;1;2;3;101;2;4\n"
    imported = read(("day.csv", NUMBERED + rows))
    assert points_of(imported) == {
        ("c01", "P_0", "loaded"): (1.0, 2.0, 3.5), ("c01", "P_1", "loaded"): (101.0, 2.0, 4.5),
        ("c01", "P_0", "unloaded"): (1.0, 2.0, 3.0), ("c01", "P_1", "unloaded"): (101.0, 2.0, 4.0),
    }  # fmt: skip
    file = read(("day#loaded.csv", f"{NUMBERED}c01;1;2;3.5;101;2;4.5\n"), file_name="{any}#{state}")
    assert sorted(points_of(file)) == [("c01", "P_0", "loaded"), ("c01", "P_1", "loaded")]
    assert refusals(("day.csv", f"{NUMBERED}c01_loaded;1;2;3.5;101;2;4.5\nc02;1;2;3.5;101;2;4.5\n")) == [
        f"day.csv: {NEITHER.replace('the target and the state', 'the state')}"
    ]


def by_state(name, unit=None):
    """Write a file for each state, and its target and state in the name of the file."""
    for state in ("unloaded", "loaded"):
        rows = [row.replace(f"_P10_{state};", " ") for row in POINTS.splitlines() if f"_{state};" in row]
        head = [f"name x[{unit[state]}] y[{unit[state]}] z[{unit[state]}]"] if unit else []
        text = "\n".join([*head, *(row.replace(";", " ") for row in rows)])
        yield name.format(target="P10", state=state), f"{text}\n"


@pytest.mark.parametrize("name", ["{target}_{state}.txt", "{state}_{target}.xyz"])
def test_a_file_may_be_named_by_target_and_state(name):
    files = list(by_state(name))
    imported = read(*files, units=MM)
    assert points_of(imported) == READ_POINTS
    assert imported.preview.assumptions == [
        f"{file}: state {state} and target P10 by the name of the file"
        for (file, _), state in zip(files, ("unloaded", "loaded"), strict=True)
    ]


def test_another_name_of_a_file_needs_a_template():
    files = list(by_state("2026-11-20 P10 {state}.txt"))
    assert refusals(*files, units=MM) == [f"{name}: {NEITHER}" for name, _ in files]
    imported = read(*files, units=MM, file_name="{any} {target} {state}")
    assert (points_of(imported), imported.preview.assumptions) == (READ_POINTS, [])


def test_lengths_of_all_files_are_in_one_unit():
    files = by_state("{target}_{state}.txt", unit={"unloaded": "mm", "loaded": "m"})
    assert refusals(*files) == [
        "P10_loaded.txt: the unit of length is m, but mm in other files; use one unit for every quantity"
    ]


@pytest.mark.parametrize("separator", [("_P10_", "::P10 "), ("_P10_", "_P10_")])
def test_names_are_read_with_either_separator(separator):
    assert points_of(read(("a.csv", POINTS.replace(*separator)), units=MM)) == READ_POINTS


@pytest.mark.parametrize(
    ("template", "name"),
    [
        ("{label}_{target}_{state}", "c_01_P10_loaded"),
        ("{state}_{target}_{label}", "loaded_P_10_c01"),
        ("{label}_{target}_{state}", "c01_P10_hot"),
        ("{label}_{target}_{state}", "c01__loaded"),
        ("{label}_{target}_{state}", "_" * 200),
        ("c.{label}", "cx1"),
    ],
)
def test_a_name_fits_a_template_in_one_way_or_is_refused(template, name):
    with pytest.raises(ImportFileError) as caught:
        Template("point_name", template).parse(name, {})
    shown = name if len(name) <= 60 else f"{name[:60]}…"
    assert str(caught.value) == (
        f"the name '{shown}' does not fit the template '{template}'; "
        "change `point_name` or rename the point; "
        "states are `unloaded`, `loaded`, `deflection`, and the words in `state_words`"
    )


def test_names_that_do_not_fit_a_template_are_counted():
    assert refusals(("points.txt", POINTS), units=MM, point_name="{state}_{target}_{label}") == [
        "points.txt:1:1: the name 'c01_P10_unloaded' does not fit the template '{state}_{target}_{label}', "
        "and 3 other names are also unclear; change `point_name` or rename the point; states are "
        "`unloaded`, `loaded`, `deflection`, and the words in `state_words` [point_name]"
    ]


def test_names_of_points_and_files_agree():
    templates = {"point_name": "{label}_{target}_{state}", "file_name": "{target}_{state}"}
    assert refusals(("P11_loaded.txt", POINTS), units=MM, **templates) == [
        "P11_loaded.txt:1:1: the target is 'P10' in one name and 'P11' in another, and 3 other names are "
        "also unclear; correct the name of the point or of the file, or `point_name` or `file_name`"
    ]


def test_there_are_sixteen_targets_at_most():
    rows = [f"P10_c{number:02}_{state} 1 2 3.5\n" for number in range(17) for state in "ul"]
    assert len(answered(("a", "".join(rows[:32])), units=MM).targets) == 16
    assert refusals(("a", "".join(rows)), units=MM) == [
        "a:33:2: there are more than 16 targets: "
        "'c00, c01, c02, c03, c04, c05, c06, c07, c08, c09, c10, c11, …'; "
        "check which part of a name is the target; use `point_name` or `file_name`"
    ]


UNNAMED = [
    ("P10_u.csv", "X [mm],Y [mm],Z [mm]\n1.5,2,3\n1.5,2,4\n"),
    ("P10_l.csv", "X [mm],Y [mm],Z [mm]\n1.5,2,2.5\n1.5,2,3.5\n"),
]


def test_rows_without_names_are_matched_by_their_order_only_if_it_is_stated():
    unnamed = "\n".join(line.partition(",")[2] for line in JOINTS.splitlines()) + "\n"
    answer = answered(("joints.csv", unnamed), *UNNAMED, by_order=True)
    force = (0.0, 0.0, -1471.5)
    assert numbers_of(answer) == [
        ("1", [10.5, -20.25], force, {"P10": ((1.5, 2.0, 3.0), (1.5, 2.0, 2.5))}),
        ("2", [-15.0, -35.125], force, {"P10": ((1.5, 2.0, 4.0), (1.5, 2.0, 3.5))}),
    ]
    assert answer.files[0].assumptions == [
        "rows were numbered, the first as observation 1, as `by_order` requires"
    ]
    assert refusals(("joints.csv", unnamed), *UNNAMED) == [
        f"{name}:1: no column names the observations or points; add a column with the header "
        '"label" or "name", or use `by_order` to number the rows of each file [by_order]'
        for name in ("joints.csv", "P10_u.csv", "P10_l.csv")
    ]


def test_numbers_of_rows_do_not_match_labels_or_shorter_files():
    said = refusals(("joints.csv", JOINTS), *UNNAMED, by_order=True)
    assert [each.partition(";")[0] for each in said] == [
        "P10_u.csv:2: '1' and 1 others have no joint, but other labels have: 'c01', 'c02'",
        "P10_u.csv:2: '1' and 1 others have no force, but other labels have: 'c01', 'c02'",
        "joints.csv:2: c01: target P10 has no reading",
        "joints.csv:3: c02: target P10 has no reading",
    ]
    (shorter,) = refusals(("P10_u.csv", UNNAMED[0][1].rsplit("\n", 2)[0]), UNNAMED[1], by_order=True)
    assert shorter.startswith("P10_l.csv:3:1: 2: target P10 was read only loaded; add the reading")


def test_rows_are_not_numbered_where_some_are_deleted():
    marked = "x [mm];y [mm];z [mm];Delete\n1.5;0;0;0\n2.5;0;0;{}\n3.5;0;0;{}\n4.5;0;0;0\n"
    files = ("P_unloaded.csv", marked.format(1, 0)), ("P_loaded.csv", marked.format(0, 1))
    assert refusals(*files, by_order=True) == [
        f"{name}: rows are marked as deleted, so the numbers of the other rows are uncertain; "
        "give every row a label, or delete these rows from all files [by_order]"
        for name, _ in files
    ]


def test_a_last_name_without_an_end_may_be_cut_off():
    table = "label;state;x [mm];y [mm];z [mm];target\nc1;u;1;2;3.5;P10\n{}c1;l;1;2;3.5;P1"
    assert refusals(("a.csv", table.format(""))) == [
        "a.csv:3:6: the file is cut off: its last line has no line break, and 'P1' is shorter than the "
        "cells above; export or copy the file again; if the file is complete, end its last line with a "
        "line break"
    ]
    said = refusals(("a.csv", table.format("c1;u;1;2;3.5;X\n")))
    assert [each.partition(";")[0] for each in said] == [
        "a.csv:2:3: c1: target P10 was read only unloaded",
        "a.csv:3:3: c1: target X was read only unloaded",
        "a.csv:4:3: c1: target P1 was read only loaded",
        "a.csv:2: no observation has a reading",
    ]


@pytest.mark.parametrize(
    ("unloaded", "loaded"),
    [
        ("frei", "last"),
        ("FREI", "LAST"),
        ("libre", "cargado"),
        ("sin carga", "con carga"),
        ("libero", "carico"),
        ("vide", "charge"),
        ("onbelast", "belast"),
        ("無負荷", "負荷"),
    ],
)
def test_words_of_states_in_names_of_points_are_read_in_many_languages(unloaded, loaded):
    named = POINTS.replace("_unloaded", f"_{unloaded}").replace("_loaded", f"_{loaded}")
    assert points_of(read(("joints.csv", JOINTS), ("points.txt", named), units=MM)) == READ_POINTS
