"""Forces as people name and write them: in words of several languages, as a size, in lists and in arrays."""

import io
import json
import re

import numpy as np
import pytest
import scipy.io
from support.strange_files import JOINTS, both, digits, joint_rows, judge, simulate, table, wide

import jointstiff as js
from jointstiff.service.problems import http_problem

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=14)
UNLOADED, LOADED = both(CAMPAIGN)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}
POINTS = [f"{axis} {word} [mm]" for word in ("unloaded", "loaded") for axis in "xyz"]


def propose(files, folder, **stated):
    for name, content in files.items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return js.read(*(folder / name for name in files), robot=ARM, **(STATED | stated))


def accept(files, folder, **stated):
    proposed = propose(files, folder, **stated)
    return proposed.accept() if hasattr(proposed, "accept") else proposed


def read_force(files, folder, **stated):
    """Return the force of the first observation [N]; the readings are those of the campaign."""
    document = accept(files, folder, **stated).measurement_set.model_dump(mode="json")
    newtons = {"N": 1.0, "kN": 1e3, "kgf": 9.80665}[document["units"]["force"]]
    force = [newtons * each for each in document["observations"][0]["force"]]
    document["units"]["force"] = "N"
    assert judge(CAMPAIGN, document) == []
    return force


def with_columns(headers, cells, loaded=LOADED):
    rows = [[*row[:7], *cells, *row[7:]] for row in wide(CAMPAIGN, UNLOADED, loaded)]
    return {"a.csv": table(["Pose", *(f"{joint} [deg]" for joint in JOINTS), *headers, *POINTS], rows)}


@pytest.mark.parametrize(
    ("form", "newtons"),
    [
        ("Fuerza {} (N)", 1),
        ("Forza {} [N]", 1),
        ("Força {} (N)", 1),
        ("Force en {} (N)", 1),
        ("Kracht {} [N]", 1),
        ("力{}[N]", 1),
        ("Kraft {} [kN]", 1e3),
        ("Kraft in {} [kN]", 1e3),
        ("Applied load {} [N]", 1),
        ("F.{} [N]", 1),
        ("力F{}/N", 1),
        ("Сила F{}, N", 1),
        ("Kraft F{} [kN]", 1e3),
        ("Effort {} (daN)", 10),
        ("F{}_daN", 10),
    ],
)
def test_parts_of_a_force_are_known_by_its_word_and_an_axis(form, newtons, tmp_path):
    headers = [form.format(axis) for axis in "XYZ"]
    files = with_columns(headers, ["0", "0", f"{-981 / newtons}"])
    assert read_force(files, tmp_path) == pytest.approx([0.0, 0.0, -981.0])


@pytest.mark.parametrize("unit", ["kip", "t", "u.a."])
def test_an_unknown_unit_of_a_force_is_named_with_what_to_state(unit, tmp_path):
    proposed = propose(with_columns([f"F{axis} [{unit}]" for axis in "xyz"], ["0", "0", "-1"]), tmp_path)
    assert (
        f"'{unit}' of Fx [{unit}], Fy [{unit}], Fz [{unit}] is no known unit of force: convert the numbers "
        "to N, daN, kN, kgf or lbf, or state `force` and leave the columns out with `ignore`"
    ) in str(proposed)


def test_keys_of_a_force_are_its_parts_in_the_stated_unit(tmp_path):
    files = with_columns(["force.x", "force.y", "force.z"], ["0", "0", "-981"])
    assert read_force(files, tmp_path, units={"force": "N"}) == pytest.approx([0.0, 0.0, -981.0])


def write_wrenches(moment, **units):
    return json.dumps(
        {
            "units": units,
            "measurements": [
                {
                    "pose": n + 1,
                    "joints": CAMPAIGN.joints[n].tolist(),
                    "unloaded": {"ball": UNLOADED[n].tolist()},
                    "loaded": {"ball": LOADED[n].tolist()},
                    "wrench": [0, 0, -981, *moment],
                }
                for n in range(len(CAMPAIGN.joints))
            ],
        }
    )


def test_a_wrench_is_a_force_and_a_moment_in_the_unit_of_its_document(tmp_path):
    files = {"a.json": write_wrenches([0, 0, 0], force="N")}
    document = accept(files, tmp_path).measurement_set
    assert document.units.force == "N"
    assert document.observations[0].force == (0.0, 0.0, -981.0)


def test_the_moment_of_a_wrench_needs_a_unit(tmp_path):
    with pytest.raises(js.CampaignError, match="moment x and 2 other columns have no unit"):
        propose({"a.json": write_wrenches([0, 5, 0], force="N")}, tmp_path)


@pytest.mark.parametrize(
    "headers", [["Kraft quer", "Kraft hoch"], ["wrench 1", "wrench 2"], ["a [N]", "b [N]"]]
)
def test_a_stated_force_does_not_replace_columns_that_look_like_forces(headers, tmp_path):
    files = with_columns(headers, ["30", "981"])
    stated = {"force": [0, 0, -981], "units": {"force": "N"}}
    with pytest.raises(js.CampaignError, match=f"look like forces: {re.escape(', '.join(headers))}"):
        propose(files, tmp_path, **stated)
    assert read_force(files, tmp_path, ignore=headers, **stated) == pytest.approx([0.0, 0.0, -981.0])


@pytest.mark.parametrize("header", ["Carga [kg]", "Last [kg]", "Load (kg)", "Carico [kg]"])
def test_a_load_in_kg_hangs_at_the_load_point(header, tmp_path):
    assert read_force(with_columns([header], ["100"]), tmp_path) == pytest.approx([0.0, 0.0, -980.665])


def test_a_load_in_kg_is_read_beside_missing_readings(tmp_path):
    rows = [[*row[:7], "100", *row[7:]] for row in wide(CAMPAIGN, UNLOADED, LOADED)]
    rows[2][-3:] = ["---"] * 3
    header = ["Pose", *(f"{joint} [deg]" for joint in JOINTS), "Load [kg]", *POINTS]
    document = accept({"a.csv": table(header, rows)}, tmp_path, allow_missing=True).measurement_set
    assert document.units.force == "kgf"
    assert [each.force for each in document.observations] == [(0.0, 0.0, -100.0)] * (len(rows) - 1)


@pytest.mark.parametrize(
    ("header", "cell"),
    [("Kraft [kN]", "0.981"), ("Fuerza (N)", "-981"), ("F [N]", "981"), ("Last [N]", "981")],
)
def test_a_force_without_an_axis_is_a_weight_if_the_targets_move_down(header, cell, tmp_path):
    files = with_columns([header], [cell])
    assert f"{header!r} as the size of a force along −z of R0" in str(propose(files, tmp_path))
    assert read_force(files, tmp_path) == pytest.approx([0.0, 0.0, -981.0])


DOWN = [
    ("Zugkraft (nach unten) kN", "0.981"),
    ("Kraft nach unten [N]", "981"),
    ("effort vers le bas (daN)", "98.1"),
    ("Fuerza hacia abajo [N]", "981"),
    ("force down [N]", "981"),
    ("Сила (вниз) [Н]", "981"),
]


@pytest.mark.parametrize(("header", "cell"), DOWN)
def test_a_force_down_in_words_is_a_weight_if_the_targets_move_down(header, cell, tmp_path):
    files = with_columns([header], [cell])
    assert f"{header!r} as the size of a force along −z of R0" in str(propose(files, tmp_path))
    assert read_force(files, tmp_path) == pytest.approx([0.0, 0.0, -981.0])
    aside = with_columns([header], [cell], UNLOADED + np.array([0.0, 0.7, -0.2]))
    assert "the force of each observation" in accept(aside, tmp_path).missing[0]


def test_a_force_up_in_words_is_no_weight(tmp_path):
    answer = accept(with_columns(["Zugkraft (nach oben) [N]"], ["981"]), tmp_path)
    assert "the force of each observation" in answer.missing[0]


@pytest.mark.parametrize("header", ["Zugkraft (nach unten) kN", "pull_N", "F [kN]", "travel_mm"])
def test_a_column_with_another_unit_is_no_mass_even_if_the_caller_states_it(header, tmp_path):
    files = with_columns([header], ["0.981"])
    with pytest.raises(js.CampaignError, match=r"is in (N|kN|mm), but `columns` states 'mass \[kg\]'"):
        accept(files, tmp_path, columns={header: "mass [kg]"})


def test_a_force_without_an_axis_is_no_weight_if_the_targets_move_aside(tmp_path):
    files = with_columns(["Kraft [N]"], ["981"], UNLOADED + np.array([0.0, 0.7, -0.2]))
    answer = accept(files, tmp_path)
    assert answer.measurement_set is None
    assert "the force of each observation" in answer.missing[0]


@pytest.mark.parametrize("tilt", [15.0, 22.0, 45.0])
def test_a_force_without_an_axis_is_no_weight_if_the_targets_move_aside_by_turns(tilt, tmp_path):
    tilt, turns = np.radians(tilt), 2.0 * np.arange(len(UNLOADED))
    down = np.full(len(UNLOADED), -np.cos(tilt))
    moves = np.column_stack([np.sin(tilt) * np.cos(turns), np.sin(tilt) * np.sin(turns), down])
    answer = accept(with_columns(["Kraft [N]"], ["981"], UNLOADED + 0.0005 * moves), tmp_path)
    assert answer.measurement_set is None
    assert "the force of each observation" in answer.missing[0]


def test_a_stated_force_of_another_size_than_that_of_the_file_is_refused(tmp_path):
    files = with_columns(["Kraft [kN]"], ["0.981"])
    with pytest.raises(js.CampaignError, match="`force` is 500 N, but 'Kraft \\[kN\\]' has 981 N"):
        propose(files, tmp_path, force=[0, 0, -500], units={"force": "N"})
    aside = read_force(files, tmp_path, force=[0, -981, 0], units={"force": "N"})
    assert aside == pytest.approx([0.0, -981.0, 0.0])


@pytest.mark.parametrize("is_turned", [False, True])
@pytest.mark.parametrize(
    ("unloaded", "loaded"),
    [
        ("antes carga", "después carga"),
        ("carga antes", "carga despues"),
        ("prima carico", "dopo carico"),
        ("Last weg", "Last"),
        ("charge enlevée", "charge"),
        ("carga retirada", "carga"),
    ],
)
def test_words_of_time_and_removal_tell_the_states_in_each_order(unloaded, loaded, is_turned, tmp_path):
    states = [(unloaded, UNLOADED), (loaded, LOADED)]
    (first, before), (second, behind) = reversed(states) if is_turned else states
    points = [f"{word} {axis} [mm]" for word in (first, second) for axis in "xyz"]
    header = ["Pose", *(f"{joint} [deg]" for joint in JOINTS), *points]
    files = {"a.csv": table(header, wide(CAMPAIGN, before, behind))}
    assert read_force(files, tmp_path, force=[0, 0, -981], units={"force": "N"}) == [0.0, 0.0, -981.0]


AXES = {"+X": [1, 0, 0], "-X": [-1, 0, 0], "+Y": [0, 1, 0], "−Y": [0, -1, 0], "-Z": [0, 0, -1]}


def with_directions(turn=0):
    """Return a file with a pull along an axis in each posture; `turn` exchanges the directions."""
    names = [list(AXES)[n % len(AXES)] for n in range(len(UNLOADED))]
    pulled = UNLOADED + 0.0005 * np.array([AXES[name] for name in names])
    rows = wide(CAMPAIGN, UNLOADED, pulled)
    names = names[turn:] + names[:turn]
    cells = [[*row[:7], name, "1.2", *row[7:]] for row, name in zip(rows, names, strict=True)]
    header = ["Pose", *(f"{joint} [deg]" for joint in JOINTS), "Zugrichtung Basis", "Kraft kN [kN]", *POINTS]
    return {"a.csv": table(header, cells)}


def test_directions_beside_a_size_are_the_axes_of_the_force(tmp_path):
    files = with_directions()
    assert "'Kraft kN [kN]' along the directions of 'Zugrichtung Basis'" in str(propose(files, tmp_path))
    document = accept(files, tmp_path).measurement_set
    assert document.units.force == "kN"
    expected = 1.2 * np.array([AXES[list(AXES)[n % len(AXES)]] for n in range(len(UNLOADED))])
    np.testing.assert_allclose([each.force for each in document.observations], expected)


def test_directions_against_the_moves_of_the_targets_are_refused(tmp_path):
    with pytest.raises(js.CampaignError, match="the targets do not move along 'Zugrichtung Basis' in R0"):
        propose(with_directions(turn=1), tmp_path)


def test_sizes_of_several_forces_in_turn_are_loads_of_a_posture(tmp_path):
    rows = [
        [*row, str(size), *digits(UNLOADED[n] + size / 1000 * (LOADED[n] - UNLOADED[n]))]
        for n, row in enumerate(joint_rows(CAMPAIGN))
        for size in (0, 500, 1000)
    ]
    header = ["Pose", *(f"{joint} [deg]" for joint in JOINTS), "Kraft [N]", *"XYZ"]
    observations = accept({"a.csv": table(header, rows)}, tmp_path).measurement_set.observations
    assert [each.force[2] for each in observations] == [-500.0] * 14 + [-1000.0] * 14


def as_list(numbers):
    return ", ".join(digits(numbers))


@pytest.mark.parametrize(
    "line", ["F = [0 0 -981] N", "F = [0, 0, -98.1] daN", "F = [0, 0, -0.981] kN", "Kraft: [0; 0; -981] N"]
)
@pytest.mark.parametrize("is_in_each_posture", [True, False])
def test_a_list_of_a_force_in_a_log_has_the_unit_behind_it(line, is_in_each_posture, tmp_path):
    text = "" if is_in_each_posture else f"{line}\n"
    for n, angles in enumerate(CAMPAIGN.joints):
        text += f"Pose {n + 1}\n q = [{as_list(angles)}] deg\n"
        text += f" {line}\n" if is_in_each_posture else ""
        text += f" p0 = [{as_list(UNLOADED[n])}]\n p1 = [{as_list(LOADED[n])}]\n"
    assert read_force({"log.txt": text}, tmp_path) == pytest.approx([0.0, 0.0, -981.0])


ARRAYS = {"q": CAMPAIGN.joints, "p0": UNLOADED, "p1": LOADED}
FORCE = np.array([0.0, 0.0, -981.0])


def write_npz(arrays):
    output = io.BytesIO()
    np.savez(output, **arrays)
    return {"d.npz": output.getvalue()}


def write_mat(arrays):
    output = io.BytesIO()
    scipy.io.savemat(output, arrays)
    return {"d.mat": output.getvalue()}


def write_json(arrays):
    return {"d.json": json.dumps({name: array.round(4).tolist() for name, array in arrays.items()})}


def write_records(arrays):
    records = [{name: each[n].round(4).tolist() for name, each in ARRAYS.items()} for n in range(14)]
    once = {name: array.tolist() for name, array in arrays.items() if name not in ARRAYS}
    return {"d.json": json.dumps({**once, "measurements": records})}


def write_matlab(arrays):
    lines = [
        f"{name} = [" + "; ".join(" ".join(digits(row)) for row in np.atleast_2d(array)) + "];\n"
        for name, array in arrays.items()
    ]
    return {"d.m": "".join(lines)}


@pytest.mark.process
@pytest.mark.parametrize("write", [write_npz, write_mat, write_json, write_records, write_matlab])
@pytest.mark.parametrize(("name", "units"), [("F", {"force": "N"}), ("force_N", None), ("F_N", None)])
def test_a_force_that_a_file_states_once_is_that_of_all_postures(write, name, units, tmp_path):
    stated = {} if units is None else {"units": units}
    assert read_force(write({**ARRAYS, name: FORCE}), tmp_path, **stated) == pytest.approx([0.0, 0.0, -981.0])


@pytest.mark.process
@pytest.mark.parametrize("write", [write_npz, write_mat])
@pytest.mark.parametrize("name", ["F_ext", "force_applied", "F_meas", "Kraft_ext"])
def test_the_only_question_for_a_force_with_words_that_say_no_more_is_its_unit(name, write, tmp_path):
    files = write({**ARRAYS, name: FORCE + np.arange(14)[:, None]})
    with pytest.raises(js.CampaignError, match=r'have no unit.*`units`: {"force": "N"}'):
        propose(files, tmp_path)
    assert read_force(files, tmp_path, units={"force": "N"}) == pytest.approx([0.0, 0.0, -981.0])


@pytest.mark.parametrize("form", ["F_ext_{}", "F{}_ext", "Applied force {}", "force_measured_{}"])
def test_parts_of_a_force_with_words_that_say_no_more_need_no_unit_in_their_headers(form, tmp_path):
    files = with_columns([form.format(axis) for axis in "xyz"], ["0", "0", "-981"])
    assert read_force(files, tmp_path, units={"force": "N"}) == pytest.approx([0.0, 0.0, -981.0])


@pytest.mark.parametrize("form", ["F_tcp_{}", "F_sensor_{}", "force_tool_{}", "F_cmd_{}", "F_std_{}"])
def test_parts_of_a_force_in_other_axes_or_of_other_numbers_are_no_forces(form, tmp_path):
    files = with_columns([form.format(axis) for axis in "xyz"], ["0", "0", "-981"])
    assert accept(files, tmp_path, units={"force": "N"}).missing_fields == ["force"]


@pytest.mark.process
@pytest.mark.parametrize("write", [write_npz, write_mat, write_json, write_records, write_matlab])
def test_a_force_in_decanewtons_that_a_file_states_once_is_in_newtons(write, tmp_path):
    assert read_force(write({**ARRAYS, "F_daN": FORCE / 10}), tmp_path) == pytest.approx([0.0, 0.0, -981.0])


@pytest.mark.process
@pytest.mark.parametrize("write", [write_npz, write_mat, write_json])
def test_a_force_of_each_posture_is_a_matrix_of_its_name(write, tmp_path):
    files = write({**ARRAYS, "F_N": np.tile(FORCE, (14, 1))})
    assert read_force(files, tmp_path) == pytest.approx([0.0, 0.0, -981.0])


@pytest.mark.process
@pytest.mark.parametrize("name", ["forces", "force_N"])
@pytest.mark.parametrize("write", [write_npz, write_mat, write_matlab])
def test_a_vector_is_not_the_force_of_all_postures_beside_a_force_of_each(write, name, tmp_path):
    files = write({**ARRAYS, "f": np.array([0.1, 0.2, -0.3]), name: np.tile(FORCE, (14, 1))})
    assert read_force(files, tmp_path, units={"force": "N"}) == pytest.approx([0.0, 0.0, -981.0])


@pytest.mark.process
def test_a_vector_is_no_force_beside_a_matrix_that_may_be_one(tmp_path):
    files = write_npz({**ARRAYS, "f": np.array([0.1, 0.2, -0.3]), "F_all": np.tile(FORCE, (14, 1))})
    assert accept(files, tmp_path, units={"force": "N"}).measurement_set is None


@pytest.mark.process
@pytest.mark.parametrize("write", [write_npz, write_mat, write_matlab])
def test_the_force_of_all_postures_is_named(write, tmp_path):
    answer = accept(write({**ARRAYS, "F_N": FORCE}), tmp_path)
    assert "'F_N' as the force of all rows" in answer.files[0].assumptions


@pytest.mark.process
def test_another_vector_of_three_numbers_is_no_column(tmp_path):
    files = write_npz({**ARRAYS, "F_N": FORCE, "tool_mm": np.array([0.0, 0.0, 120.0])})
    assert read_force(files, tmp_path) == pytest.approx([0.0, 0.0, -981.0])


@pytest.mark.parametrize("units", [("(°)", "(kN)", "(mm)"), ("[deg]", "[kN]", "[mm]"), ("deg", "kN", "mm")])
def test_a_unit_in_a_merged_cell_below_the_axes_holds_for_its_group(units, tmp_path):
    angle, force, length = units
    header = [
        ["Pose", "Gelenke", *[""] * 5, "Kraft", "", "", "unbelastet", "", "", "belastet", "", ""],
        ["", *JOINTS, *"XYZ" * 3],
        ["", angle, *[""] * 5, force, "", "", length, *[""] * 5],
    ]
    rows = [[*row[:7], "0", "0", "-0.981", *row[7:]] for row in wide(CAMPAIGN, UNLOADED, LOADED)]
    text = "".join(";".join(row) + "\n" for row in [*header, *rows])
    assert read_force({"a.csv": text}, tmp_path) == pytest.approx([0.0, 0.0, -981.0])


@pytest.mark.parametrize(
    ("line", "said", "force"),
    [
        (
            "# Gewicht 150 kg am Flansch",
            'says "Gewicht 150 kg" in line 1: if this load hangs',
            "0,0,-150kgf",
        ),
        ("# Weight of 10 kg hung", 'says "Weight of 10 kg" in line 1: if this load hangs', "0,0,-10kgf"),
        ("# Effort 80 daN, -Z", 'says "Effort 80 daN" in line 1', "0,0,-80daN"),
        ("# payload_kg: 8.0", 'says "payload_kg: 8.0" in line 1: if this load hangs', "0,0,-8.0kgf"),
        ("# F = 60 N in -X", 'says "F = 60 N in -X" in line 1: if this force acts', "-60,0,0N"),
        ("# F = 60 N in Z", 'says "F = 60 N in Z" in line 1', ""),
    ],
)
def test_the_question_for_the_force_names_a_load_in_words(line, said, force, tmp_path):
    content = table(
        ["Pose", *(f"{joint} [deg]" for joint in JOINTS), *POINTS], wide(CAMPAIGN, UNLOADED, LOADED)
    )
    answer = accept({"a.csv": f"{line}\n{content}"}, tmp_path)
    assert answer.measurement_set is None
    assert said in answer.missing[0]
    assert (
        answer.missing[0].endswith(f"`force` is {force}") if force else "`force` is" not in answer.missing[0]
    )


def test_several_loads_in_words_are_named_without_a_likely_force(tmp_path):
    content = table(
        ["Pose", *(f"{joint} [deg]" for joint in JOINTS), *POINTS], wide(CAMPAIGN, UNLOADED, LOADED)
    )
    answer = accept({"a.csv": f"# plate: 20 kg\n# weight: 150 kg\n{content}"}, tmp_path)
    assert '"plate 20 kg" in line 1, ' in answer.missing[0]
    assert "`force` is" not in answer.missing[0]


def test_many_masses_in_words_are_no_load(tmp_path):
    rows = [
        [*row[:7], f"part of {n + 1} kg", *row[7:]] for n, row in enumerate(wide(CAMPAIGN, UNLOADED, LOADED))
    ]
    files = {"a.csv": table(["Pose", *(f"{joint} [deg]" for joint in JOINTS), "Remark", *POINTS], rows)}
    assert accept(files, tmp_path).missing[0].endswith("(N, daN, kN, kgf, lbf)")


def test_a_load_in_words_is_quoted_without_the_number_of_the_cell_before(tmp_path):
    rows = [
        [*row, load]
        for row, load in zip(wide(CAMPAIGN, UNLOADED, LOADED), ["160 kg", *[""] * 13], strict=True)
    ]
    headers = ["Pose", *(f"{joint} [deg]" for joint in JOINTS), *POINTS, "Remark"]
    (missing,) = propose({"a.csv": table(headers, rows)}, tmp_path).accept().missing
    assert 'says "160 kg"' in missing
    assert "`force` is 0,0,-160kgf" in missing


def test_a_refusal_without_the_force_shows_the_likely_force_whole(tmp_path):
    rows = wide(CAMPAIGN, UNLOADED, LOADED)
    headers = ["Pose", *(f"{joint} [deg]" for joint in JOINTS), *POINTS]
    name = "a long name of a file of readings of a robot in a cell.csv"
    (missing,) = propose({name: f"# Last: 150 kg\n{table(headers, rows)}"}, tmp_path).accept().missing
    refused = http_problem(422, f"nothing was written, because information is missing: {missing}")
    assert refused.detail.endswith("`force` is 0,0,-150kgf")


@pytest.mark.parametrize(
    "header", ["load_kg", "payload_kg", "carga_kg", "last_kg", "mass_kg", "Zuladung (kg)"]
)
def test_loads_in_kg_of_the_rows_of_a_posture_are_several_loads(header, tmp_path):
    more = LOADED + (LOADED - UNLOADED)
    rows = [
        [f"P{number}", load, *digits(joints), *digits(place)]
        for number, (joints, *places) in enumerate(
            zip(CAMPAIGN.joints, UNLOADED, LOADED, more, strict=True), 1
        )
        for load, place in zip(("0", "10", "20"), places, strict=True)
    ]
    text = table(["pose", header, *(f"{joint}_deg" for joint in JOINTS), "x_mm", "y_mm", "z_mm"], rows)
    proposed = propose({"a.csv": text}, tmp_path)
    assert "not read" not in str(proposed)
    answer = proposed.accept()
    assert answer.measurement_set.units.force == "kgf"
    forces = {tuple(each.force) for each in answer.measurement_set.observations}
    assert sorted(np.round([force[2] for force in forces], 1)) == pytest.approx([-20.0, -10.0])
    assert len(answer.measurement_set.observations) == 2 * len(CAMPAIGN.joints)


@pytest.mark.parametrize(
    ("header", "newtons"),
    [
        ("load_lb", 4.4482216),
        ("Zuladung (lb)", 4.4482216),
        ("peso_lbs", 4.4482216),
        ("負荷 [lb]", 4.4482216),
        ("load_lbf", 4.4482216),
        ("Zugkraft [daN]", 10.0),
        ("carga [N]", 1.0),
        ("effort (N)", 1.0),
        ("carico_kgf", 9.80665),
        ("нагрузка [кН]", 1000.0),
    ],
)
def test_loads_in_any_unit_of_mass_or_force_of_the_rows_of_a_posture_are_several_loads(
    header, newtons, tmp_path
):
    more = LOADED + (LOADED - UNLOADED)
    sizes = [f"{size / newtons:.6g}" for size in (0.0, 500.0, 1000.0)]
    rows = [
        [f"P{number}", load, *digits(joints), *digits(place)]
        for number, (joints, *places) in enumerate(
            zip(CAMPAIGN.joints, UNLOADED, LOADED, more, strict=True), 1
        )
        for load, place in zip(sizes, places, strict=True)
    ]
    text = table(["pose", header, *(f"{joint}_deg" for joint in JOINTS), "x_mm", "y_mm", "z_mm"], rows)
    answer = propose({"a.csv": text}, tmp_path).accept()
    assert answer.missing == []
    unit = {"N": 1.0, "kN": 1000.0, "kgf": 9.80665, "lbf": 4.4482216}[answer.measurement_set.units.force]
    forces = {round(unit * each.force[2]) for each in answer.measurement_set.observations}
    assert forces == {-500, -1000}
    assert len(answer.measurement_set.observations) == 2 * len(CAMPAIGN.joints)


@pytest.mark.parametrize(("newtons", "is_weight"), [(98.1, True), (900.0, False)])
def test_a_stated_force_is_refused_if_a_column_of_masses_has_another_weight(newtons, is_weight, tmp_path):
    rows = [
        [f"P{number}", load, *digits(joints), *digits(place)]
        for number, (joints, *places) in enumerate(zip(CAMPAIGN.joints, UNLOADED, LOADED, strict=True), 1)
        for load, place in zip(("0", "10"), places, strict=True)
    ]
    header = ["pose", "load_kg", *(f"{joint}_deg" for joint in JOINTS), "x_mm", "y_mm", "z_mm"]
    stated = {"force": [0, 0, -newtons], "units": {"force": "N"}}
    files = {"a.csv": table(header, rows)}
    if is_weight:
        assert read_force(files, tmp_path, **stated) == pytest.approx([0.0, 0.0, -newtons])
        return
    with pytest.raises(js.CampaignError, match="under 10 kg, and `force` is not this weight"):
        propose(files, tmp_path, **stated)
