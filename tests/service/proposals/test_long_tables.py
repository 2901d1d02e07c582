"""Tables with a row for each posture, state and target, or for each joint: targets are found, not repeats."""

import numpy as np
import pytest
from support.strange_files import JOINTS, digits, judge, names, simulate, table

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=10)
STATED = {
    "encoders": "motor", "load_point": [0, 0, 120], "force": [0, 0, -981], "units": {"force": "N"},
    "length_unit": "mm",
}  # fmt: skip
STATES = ("Sin carga", "Con carga")


def write_rows(words, positions):
    """Return a row for each posture, state and word; `positions` has those of each word in each state [m]."""
    return [
        [label, state, word, *digits(1e3 * positions[number][k][posture]), *digits(CAMPAIGN.joints[posture])]
        for posture, label in enumerate(names(CAMPAIGN))
        for k, state in enumerate(STATES)
        for number, word in enumerate(words)
    ]


def propose(header, rows, folder):
    path = folder / "largo.csv"
    path.write_text(table(["Postura", "Estado", header, *"XYZ", *JOINTS], rows), encoding="utf-8")
    return js.read(path, robot=ARM, **STATED)


def places_of(target):
    return CAMPAIGN.unloaded[:, target], CAMPAIGN.loaded[:, target]


@pytest.mark.parametrize(
    "header", ["Objetivo", "Marke", "Alvo", "Bersaglio", "мишень", "目标", "Kugel", "Which one"]
)
def test_the_column_of_targets_is_known_by_its_word_or_by_its_texts(header, tmp_path):
    rows = write_rows(["T1", "T2", "T3"], [places_of(target) for target in range(3)])
    answer = propose(header, rows, tmp_path).accept()
    assert answer.targets == ["T1", "T2", "T3"]
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_texts_of_readings_at_one_place_are_no_targets(tmp_path):
    """Readings of one target by two trackers differ by 20 µm; these are no two targets."""
    first, second = places_of(0), tuple(each + 2e-5 for each in places_of(0))
    with pytest.raises(js.CampaignError) as refused:
        propose("Tracker", write_rows(["Faro", "Leica"], [first, second]), tmp_path)
    assert "'Faro' and 'Leica', which may be words for states" in str(refused.value.problem)


def write_phases(folder, phases=("vazio", "pesado"), shift=(0.0, 0.0, -5e-3)):
    """Write a table with a row for each of two phases of each posture, between which a target moves [m]."""
    positions = CAMPAIGN.unloaded[:, 0], CAMPAIGN.unloaded[:, 0] + shift
    rows = [
        [label, word, *digits(1e3 * positions[number][posture]), *digits(CAMPAIGN.joints[posture])]
        for posture, label in enumerate(names(CAMPAIGN))
        for number, word in enumerate(phases)
    ]
    path = folder / "longo.csv"
    path.write_text(table(["Postura", "Fase", *"XYZ", *JOINTS], rows), encoding="utf-8")
    return path


def test_texts_of_one_target_that_moves_by_millimetres_are_no_targets(tmp_path):
    """Two unknown words may be states: a heavy load moves a target by 5 mm in each posture."""
    with pytest.raises(js.CampaignError) as refused:
        js.read(write_phases(tmp_path), robot=ARM, **{**STATED, "force": None})
    problem = str(refused.value.problem)
    assert "'vazio' and 'pesado' may be words for states" in problem
    assert "state `force`, along which the targets move under load" in problem


def test_a_stated_force_shows_which_of_two_unknown_words_is_under_load(tmp_path):
    proposed = js.read(write_phases(tmp_path), robot=ARM, **STATED)
    assert "'vazio' is unloaded and 'pesado' is loaded, as the targets then move along `force`" in str(
        proposed
    )
    observations = proposed.accept().measurement_set.model_dump(mode="json")["observations"]
    shifts = [
        np.subtract(own["loaded"], own["unloaded"]) for each in observations for own in each["readings"]
    ]
    assert np.allclose(shifts, [0.0, 0.0, -5.0], atol=1e-3)


@pytest.mark.parametrize(
    ("phases", "shift"),
    [(("vazio", "pesado"), (0.0, 0.0, 5e-3)), (("Faro", "Leica"), (2e-5, 2e-5, 2e-5))],
    ids=["against the force", "two instruments"],
)
def test_a_force_against_which_targets_move_shows_no_states(phases, shift, tmp_path):
    """The words may have another order, the force another sign: a person must say which."""
    with pytest.raises(js.CampaignError, match="may be words for states"):
        js.read(write_phases(tmp_path, phases, shift), robot=ARM, **STATED)


@pytest.mark.parametrize("count", [2, 3])
def test_points_far_apart_are_targets_beside_repeats_and_loads(count, tmp_path):
    """Only the distances say that `a` and `b` are points, and no states."""
    rows = [
        [posture + 1, repeat + 1, 9 * state, "abc"[target], *digits(1e3 * place), *digits(joints)]
        for posture, joints in enumerate(CAMPAIGN.joints)
        for state in range(2)
        for repeat in range(2)
        for target in range(count)
        for place in [places_of(target)[state][posture]]
    ]
    path = tmp_path / "lang.tsv"
    header = ["houding", "herhaling", "last_kg", "doel", "x_mm", "y_mm", "z_mm", *JOINTS]
    path.write_text(table(header, rows, "\t"), encoding="utf-8")
    stated = {key: value for key, value in STATED.items() if key not in ("force", "units")}
    answer = js.read(path, robot=ARM, **stated).accept()
    assert answer.targets == list("abc"[:count])
    document = answer.measurement_set.model_dump(mode="json")
    assert document["units"]["force"] == "kgf"
    assert [each["force"] for each in document["observations"]] == [[0.0, 0.0, -9.0]] * len(CAMPAIGN.joints)
    shifts = [
        np.subtract(own["loaded"], own["unloaded"])
        for each in document["observations"]
        for own in each["readings"]
    ]
    true = [
        1e3 * np.subtract(*places_of(k)[::-1])[p] for p in range(len(CAMPAIGN.joints)) for k in range(count)
    ]
    assert np.allclose(shifts, true, atol=5e-3)


@pytest.mark.parametrize("words", [("NoLoad", "Loaded150"), ("unloaded0", "loaded1")])
def test_numbers_stand_behind_words_for_states_without_a_blank(words, tmp_path):
    document = js.read(write_phases(tmp_path, words), robot=ARM, **STATED).accept().measurement_set
    shifts = [
        np.subtract(own.loaded, own.unloaded) for each in document.observations for own in each.readings
    ]
    assert np.allclose(np.array(shifts)[:, 2], shifts[0][2])
    assert shifts[0][2] < 0.0


@pytest.mark.parametrize("header", ["opakování", "herhaling", "повтор"])
def test_repeats_beside_a_temperature_are_averaged(header, tmp_path):
    """The air warms up by 0.4 °C between repeats: a temperature is no coordinate."""
    rows = [
        [posture + 1, repeat, 6 * state, *digits(1e3 * place), 21.37 + 0.4 * repeat, *digits(joints)]
        for posture, joints in enumerate(CAMPAIGN.joints)
        for state in range(2)
        for repeat in range(1, 4)
        for place in [places_of(0)[state][posture]]
    ]
    path = tmp_path / "mereni.csv"
    names_of_columns = ["poloha", header, "zátěž [kg]", *"XYZ", "teplota [°C]", *JOINTS]
    path.write_text(table(names_of_columns, rows), encoding="utf-8")
    stated = {key: value for key, value in STATED.items() if key not in ("force", "units")}
    document = js.read(path, robot=ARM, **stated).accept().measurement_set.model_dump(mode="json")
    assert len(document["observations"]) == len(CAMPAIGN.joints)
    assert document["observations"][0]["force"] == [0.0, 0.0, -6.0]


def test_rows_in_different_places_are_not_called_repeats(tmp_path):
    """Two columns tell the rows of a posture apart: nobody says which of them names the targets."""
    rows = write_rows(["1;4", "2;5"], [places_of(0), places_of(1)])
    with pytest.raises(js.CampaignError) as refused:
        propose("No.;Side", rows, tmp_path)
    text = str(refused.value.problem)
    assert "'P01' has several rows of unloaded in different places" in text
    assert "header `target`" in text
    assert "mean_of_repeats" not in text


@pytest.mark.parametrize("header", ["No.", "측정점", "SMR #"])
def test_numbers_of_points_that_keep_their_distances_are_targets(header, tmp_path):
    rows = write_rows("123", [places_of(target) for target in range(3)])
    answer = propose(header, rows, tmp_path).accept()
    assert answer.targets == ["1", "2", "3"]
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_numbers_of_points_that_do_not_keep_their_distances_are_no_targets(tmp_path):
    """The second place of each posture is the other posture's: no target is fixed to the flange."""
    first, second = places_of(0), tuple(each[::-1] for each in places_of(1))
    with pytest.raises(js.CampaignError) as refused:
        propose("No.", write_rows("12", [first, second]), tmp_path)
    assert "several rows of unloaded in different places" in str(refused.value.problem)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)], ids=["posture first", "point first"])
def test_a_count_of_postures_beside_names_of_points_makes_these_targets(order, tmp_path):
    """A column `point` names postures elsewhere; here three points keep their distances in each of `n`."""
    rows = [
        [
            *[(str(posture + 1), "abc"[target])[k] for k in order],
            12 * state,
            *digits(1e3 * places_of(target)[state][posture]),
        ]
        for posture in range(len(CAMPAIGN.joints))
        for state in range(2)
        for target in range(3)
    ]
    header = [*[("n", "point")[k] for k in order], "load", *"xyz"]
    (tmp_path / "joints.csv").write_text(table(JOINTS, map(digits, CAMPAIGN.joints)), encoding="utf-8")
    (tmp_path / "tracker.csv").write_text(table(header, rows), encoding="utf-8")
    answer = js.read(tmp_path / "joints.csv", tmp_path / "tracker.csv", robot=ARM, **STATED).accept()
    assert answer.targets == ["a", "b", "c"]
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def propose_points(campaign, template, targets, folder):
    """Return the proposal for joints with numbers, and for a list of points of each state."""
    rows = [[number, *digits(q)] for number, q in enumerate(campaign.joints, 1)]
    paths = [folder / "joints.csv"]
    paths[0].write_text(table(["label", *JOINTS], rows), encoding="utf-8")
    for state, word in enumerate(("without", "with")):
        points = [
            [template.format(posture=posture + 1, target=target + 1), *digits(1e3 * place[posture])]
            for posture in range(len(campaign.joints))
            for target in targets
            for place in [(campaign.unloaded, campaign.loaded)[state][:, target]]
        ]
        paths.append(folder / f"{word}.txt")
        paths[-1].write_text(table([], points, "\t"), encoding="utf-8")
    return js.read(*paths, robot=ARM, **STATED)


@pytest.mark.parametrize("template", ["P{posture}_{target}", "{target}_P{posture}", "{posture}-{target}"])
@pytest.mark.parametrize("postures", [3, 4, 10])
def test_a_number_in_a_name_is_the_posture_in_which_the_others_are_targets(template, postures, tmp_path):
    """Each number of a target is also the number of a posture, also where there are as many of both."""
    campaign = simulate(ARM, seed=5, postures=postures)
    answer = propose_points(campaign, template, range(3), tmp_path).accept()
    assert answer.targets == ["1", "2", "3"]
    assert judge(campaign, answer.measurement_set.model_dump(mode="json")) == []


# ---- a row for each joint

AXES = [f"A{number}" for number in range(1, 7)]


def rows_of_joints(cells=AXES, *further, step=1):
    """Return a row for each posture and joint: its label, its cell, further numbers, the angle in degrees."""
    return [
        [label, cell, *further, *digits([angle])]
        for label, q in zip(names(CAMPAIGN), CAMPAIGN.joints, strict=True)
        for cell, angle in list(zip(cells, q, strict=True))[::step]
    ]


def melt(rows):
    """Return the rows of each joint together, as a program melts a table."""
    return [row for joint in range(6) for row in rows[joint::6]]


def propose_joints(header, rows, folder):
    readings = [
        [label, *digits(1e3 * CAMPAIGN.unloaded[posture, 0]), *digits(1e3 * CAMPAIGN.loaded[posture, 0])]
        for posture, label in enumerate(names(CAMPAIGN))
    ]
    states = [f"{state} {axis} [mm]" for state in ("unloaded", "loaded") for axis in "xyz"]
    (folder / "joints.csv").write_text(table(header, rows, ","), encoding="utf-8")
    (folder / "readings.csv").write_text(table(["pose", *states], readings, ","), encoding="utf-8")
    return js.read(folder / "joints.csv", folder / "readings.csv", robot=ARM, **STATED)


@pytest.mark.parametrize(
    ("header", "rows"),
    [
        (["pose", "joint", "angle_deg"], rows_of_joints()),
        (["pose", "variable", "value"], melt(rows_of_joints())),
        (["Punkt", "Achse", "Winkel [°]"], rows_of_joints("123456")),
        (
            ["pose", "joint", "current", "angle [deg]"],
            rows_of_joints([f"joint_{k}" for k in range(1, 7)], "0.0"),
        ),
        (["pose", "axis", "angle [deg]"], rows_of_joints(step=-1)),
    ],
    ids=["names", "melted", "numbers", "another number", "reversed"],
)
def test_a_table_with_a_row_for_each_joint_is_read(header, rows, tmp_path):
    answer = propose_joints(header, rows, tmp_path).accept()
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []
    assert "the rows of 10 postures by joint were joined" in answer.files[0].assumptions


def test_a_posture_with_a_joint_twice_is_no_table_by_joint(tmp_path):
    rows = rows_of_joints()
    rows[7][1] = "A1"
    with pytest.raises(js.CampaignError) as refused:
        propose_joints(["pose", "joint", "angle_deg"], rows, tmp_path)
    assert "joints.csv has no rows of numbers" in str(refused.value.problem)
