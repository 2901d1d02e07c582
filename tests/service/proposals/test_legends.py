"""Legends: what a word for a state means, as a sheet, a comment or a line of the files themselves states."""

import io

import openpyxl
import pytest
from support.strange_files import JOINTS, both, digits, joint_rows, judge, simulate, table, wide

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=14)
UNLOADED, LOADED = both(CAMPAIGN)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}
HEADER = ["Pose", *JOINTS, "Last [kg]", *(f"{axis}{word}" for word in "ab" for axis in "XYZ")]


def propose(files, folder, **stated):
    for name, content in files.items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return js.read(*(folder / name for name in files), robot=ARM, **(STATED | stated))


def judge_files(files, folder):
    proposed = propose(files, folder)
    answer = proposed.accept() if hasattr(proposed, "accept") else proposed
    assert answer.missing == []
    return judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")), answer


def list_rows(is_loaded_first):
    positions = (LOADED, UNLOADED) if is_loaded_first else (UNLOADED, LOADED)
    return [[*row[:7], "100", *row[7:]] for row in wide(CAMPAIGN, *positions)]


def write_legend(form, is_loaded_first):
    states = ["avec charge", "sans charge"] if is_loaded_first else ["sans charge", "avec charge"]
    return form.format(a=states[0], b=states[1])


FORMS = [
    "# a = {a}, b = {b}",
    "# a = {a}\n# b = {b}",
    "# Xa Ya Za = position {a}; Xb Yb Zb = position {b}",
    "Légende ; a : {a} ; b : {b}",
    "Légende :\na = {a}\nb = {b}\n",
]


@pytest.mark.parametrize("is_loaded_first", [True, False])
@pytest.mark.parametrize("form", FORMS)
def test_a_legend_in_lines_states_the_words_of_headers(form, is_loaded_first, tmp_path):
    text = f"{write_legend(form, is_loaded_first)}\n{table(HEADER, list_rows(is_loaded_first))}"
    faults, answer = judge_files({"a.csv": text}, tmp_path)
    assert faults == []
    state = "loaded" if is_loaded_first else "unloaded"
    assert f"'a' is {state}" in str(answer.assumptions)
    assert "of 'a.csv'" in str(answer.assumptions)


def write_workbook(rows, legend):
    book = openpyxl.Workbook()
    book.active.title = "Essais"
    for row in (HEADER, *([row[0], *map(float, row[1:])] for row in rows)):
        book.active.append(row)
    sheet = book.create_sheet("Légende")
    for row in legend:
        sheet.append(row)
    output = io.BytesIO()
    book.save(output)
    return {"a.xlsx": output.getvalue()}


@pytest.mark.parametrize("is_loaded_first", [True, False])
@pytest.mark.parametrize("words", [("a", "b"), ("Xa Ya Za", "Xb Yb Zb"), ("Xa, Ya, Za", "Xb, Yb, Zb")])
@pytest.mark.parametrize("unit", [[], ["mm"]])
def test_a_sheet_states_the_words_of_headers(words, unit, is_loaded_first, tmp_path):
    states = ["position sous effort", "position avant effort"]
    in_order = states if is_loaded_first else states[::-1]
    legend = [[word, state, *unit] for word, state in zip(words, in_order, strict=True)]
    files = write_workbook(list_rows(is_loaded_first), [*legend, ["Last", "masse suspendue", "kg"]])
    faults, answer = judge_files(files, tmp_path)
    assert faults == []
    assert "row 1 of the sheet 'Légende'" in str(answer.assumptions)


def test_a_legend_states_the_words_of_a_column(tmp_path):
    rows = [
        [*row, state, *digits(places[n])]
        for n, row in enumerate(joint_rows(CAMPAIGN))
        for state, places in (("a", LOADED), ("b", UNLOADED))
    ]
    text = "# a = mit Last 100 kg, b = ohne Last\n" + table(["Pose", *JOINTS, "Fall", *"XYZ"], rows)
    proposed = propose({"a.csv": text}, tmp_path, force=[0, 0, -981], units={"force": "N"})
    assert judge(CAMPAIGN, proposed.accept().measurement_set.model_dump(mode="json")) == []
    assert "'a' is loaded and 'b' is unloaded" in str(proposed)


def test_a_legend_states_the_words_of_a_named_column_of_states(tmp_path):
    text = "# a = loaded, b = unloaded\nlabel;target;state;J1 [deg];x [mm];y [mm];z [mm]\n"
    text += "c1;P1;a;10;1;2;2.5\nc1;P1;b;10;1;2;3\n"
    (tmp_path / "a.csv").write_text(text)
    answer = js.read(tmp_path / "a.csv", **STATED, force=[0, 0, -981], units={"force": "N"})
    (reading,) = answer.measurement_set.observations[0].readings
    assert (reading.unloaded, reading.loaded) == ((1.0, 2.0, 3.0), (1.0, 2.0, 2.5))
    assert "'a' is loaded and 'b' is unloaded" in str(answer.assumptions)


@pytest.mark.parametrize(
    "legend",
    [
        "# a = avec charge",
        "# a = avec charge, b = avec charge",
        "# a = avec charge, b = position du point",
        "# a = sans charge, b = avec charge\n# a = avec charge",
        "# a = sans charge puis avec charge, b = avec charge",
        "# c = sans charge, d = avec charge",
        "# a = not unloaded, b = loaded",
    ],
)
def test_a_legend_that_is_not_clear_leaves_the_question(legend, tmp_path):
    text = f"{legend}\n{table(HEADER, list_rows(is_loaded_first=True))}"
    with pytest.raises(js.CampaignError, match="state_words"):
        propose({"a.csv": text}, tmp_path)


def test_a_legend_against_the_force_is_no_silent_exchange(tmp_path):
    rows = wide(CAMPAIGN, UNLOADED, LOADED)
    header = [each for each in HEADER if each != "Last [kg]"]
    text = "# a = loaded, b = unloaded\n" + table(header, rows)
    proposed = propose({"a.csv": text}, tmp_path, force=[0, 0, -981], units={"force": "N"})
    assert "'a' is loaded and 'b' is unloaded according to line 1 of 'a.csv'" in str(proposed)
    assert "deflections_unexplained" in [finding.code for finding in proposed.accept().findings]


HEADER_OF_COMPARISON = ["Name", *JOINTS, *(f"{word} {axis}" for word in ("Ref", "Meas") for axis in "XYZ")]


def compare_points(legend, is_loaded_first):
    positions = (LOADED, UNLOADED) if is_loaded_first else (UNLOADED, LOADED)
    return {"a.csv": f"{legend}\n{table(HEADER_OF_COMPARISON, wide(CAMPAIGN, *positions))}"}


@pytest.mark.parametrize("is_loaded_first", [True, False])
@pytest.mark.parametrize("measured", ["data", "measured", "Measurement"])
def test_a_legend_explains_the_abbreviations_of_its_words(measured, is_loaded_first, tmp_path):
    states = ["loaded 100 kg", "unloaded survey"] if is_loaded_first else ["unloaded survey", "loaded 100 kg"]
    legend = f"Comparison points - {measured} = {states[1]}, reference = {states[0]}"
    files = compare_points(legend, is_loaded_first)
    proposed = propose(files, tmp_path, force=[0, 0, -981], units={"force": "N"})
    assert judge(CAMPAIGN, proposed.accept().measurement_set.model_dump(mode="json")) == []
    reference, other = ("loaded", "unloaded") if is_loaded_first else ("unloaded", "loaded")
    assert f"'Ref' is {reference}" in str(proposed)
    assert f"'Meas' is {other}" in str(proposed)
    assert "according to line 1 of 'a.csv'" in str(proposed)


@pytest.mark.parametrize(
    "legend",
    [
        "Comparison points",
        "reference = unloaded survey",
        "data = loaded 100 kg, measured = unloaded survey, reference = unloaded survey",
        "measured = loaded 100 kg, reference = unloaded survey, refined = loaded 50 kg",
        "data = loaded 100 kg, re = unloaded survey",
    ],
)
def test_abbreviations_that_no_legend_explains_leave_the_question_with_the_likely_states(legend, tmp_path):
    with pytest.raises(js.CampaignError, match="'Ref' as `unloaded` and 'Meas' as `loaded`"):
        propose(compare_points(legend, is_loaded_first=False), tmp_path)


def write_three_sheets(words, legend):
    """Return a workbook of joints with masses in turn, of points named `P01-1-u`, and of a legend."""
    book = openpyxl.Workbook()
    book.active.title = "Gelenkwinkel"
    book.active.append(["Messpose", *JOINTS, "Last [kg]"])
    for number, (label, *angles) in enumerate(joint_rows(CAMPAIGN)):
        book.active.append([label, *map(float, angles), 60 - 30 * (number % 2)])
    points = book.create_sheet("Punkte")
    points.append(["Punktname", *"XYZ"])
    for number, (label, *_) in enumerate(joint_rows(CAMPAIGN)):
        for state, word in enumerate(words):
            for target in (0, 1):
                points.append(
                    [f"{label}-{target + 1}-{word}", *both(CAMPAIGN, target)[state][number].tolist()]
                )
    if legend:
        sheet = book.create_sheet("Legende")
        for row in legend:
            sheet.append(row)
    output = io.BytesIO()
    book.save(output)
    return {"a.xlsx": output.getvalue()}


@pytest.mark.parametrize("words", [("u", "b"), ("v", "w")])
def test_a_legend_states_the_last_words_of_names_of_points_beside_joints_with_other_masses(words, tmp_path):
    meanings = ("unbelastet", "belastet (Gewicht am Flansch)")
    legend = [*zip(words, meanings, strict=True), ("1, 2", "Reflektornester")]
    proposed = propose(write_three_sheets(words, legend), tmp_path)
    document = proposed.accept().measurement_set
    forces = [each.force for each in document.observations]
    assert forces == [(0.0, 0.0, -60.0), (0.0, 0.0, -30.0)] * (len(CAMPAIGN.joints) // 2)
    assert {each.target for each in document.observations[0].readings} == {"1", "2"}
    assert f"{words[0]!r} is unloaded and {words[1]!r} is loaded according to row 1 of the sheet" in str(
        proposed
    )


def test_last_words_of_names_of_points_without_a_legend_are_the_question(tmp_path):
    with pytest.raises(js.CampaignError, match="'v' as `unloaded` and 'w' as `loaded`"):
        propose(write_three_sheets(("v", "w"), []), tmp_path)
