"""A log of the joints for each state, and columns of yes and no below a header of a load."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=31, configurations=12)
FIRST = 1e3 * READINGS.position[:, 0]
SAG = np.array([0.01, 0.02, -0.5])
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -100], "units": {"force": "N"}}


def write(folder, name, *blocks, first=0.0):
    table = np.column_stack([first + np.arange(len(READINGS.joints)), *blocks])
    lines = [",".join(f"{value:.6f}" for value in row) for row in table.tolist()]
    (folder / name).write_text("\n".join(lines) + "\n")
    return folder / name


def log(folder, change=0.0):
    return [
        write(folder, "free_joints.csv", READINGS.joints),
        write(folder, "free_points.csv", FIRST),
        write(folder, "loaded_joints.csv", READINGS.joints + change, first=900.0),
        write(folder, "loaded_points.csv", FIRST + SAG, first=900.0),
    ]


def shifts_of(proposal):
    observations = proposal.accept().campaign.measurement_set.observations
    return [np.subtract(each.loaded, each.unloaded) for own in observations for each in own.readings]


def test_a_second_log_of_the_same_joints_confirms_the_first(tmp_path):
    proposal = js.read(*log(tmp_path), robot=ARM, **STATED)
    assert "loaded_joints.csv has the same joints" in str(proposal)
    assert np.allclose(shifts_of(proposal), SAG, atol=2e-3)


def test_a_second_log_of_other_joints_is_refused(tmp_path):
    with pytest.raises(js.CampaignError):
        js.read(*log(tmp_path, change=0.01), robot=ARM, **STATED)


@pytest.mark.parametrize(
    ("header", "no", "yes"),
    [
        ("Chargement", "non", "oui"),
        ("Carga", "não", "sim"),
        ("Obciążenie", "nie", "tak"),
        ("Нагрузка", "нет", "да"),
    ],
)
def test_no_and_yes_below_a_load_are_states_in_several_languages(tmp_path, header, no, yes):
    rows = [["Nr", *(f"J{k}" for k in range(1, 7)), header, "X", "Y", "Z"]]
    for number, (angles, place) in enumerate(zip(np.rad2deg(READINGS.joints), FIRST, strict=True), 1):
        for word, shift in ((no, 0.0), (yes, SAG)):
            rows.append([str(number), *(f"{each:.3f}" for each in angles), word])
            rows[-1] += [f"{each:.4f}" for each in place + shift]
    (tmp_path / "a.csv").write_text("\n".join(";".join(row) for row in rows) + "\n")
    proposal = js.read(tmp_path / "a.csv", robot=ARM, **STATED)
    assert np.allclose(shifts_of(proposal), SAG, atol=2e-3)


def controller_log(change=0.0):
    """Return three lines a stop, without and under load, with registers of the posture and the state.

    `change` is by how much the joints under load differ [rad].
    """
    noise = np.random.default_rng(7).normal(0.0, 5e-6, (2, 3, *READINGS.joints.shape))
    rows = [
        [*(READINGS.joints[k] + noise[state, line, k] + change * state), k + 1, state]
        for state in (0, 1)
        for k in range(len(READINGS.joints))
        for line in range(3)
    ]
    header = " ".join([*(f"actual_q_{k}" for k in range(6)), "int_register_0", "int_register_1"])
    lines = [" ".join(f"{value:.6f}" for value in row[:6]) + f" {row[6]} {row[7]}" for row in rows]
    return "\n".join([header, *lines]) + "\n"


def tracker_log():
    rows = [
        f"{k + 1},{state}," + ",".join(f"{value:.4f}" for value in FIRST[k] + state * SAG)
        for state in (0, 1)
        for k in reversed(range(len(FIRST)))
    ]
    return "\n".join(["pose,loaded,x,y,z", *rows]) + "\n"


def read_controller(tmp_path, change=0.0, **stated):
    (tmp_path / "robot.csv").write_text(controller_log(change))
    (tmp_path / "tracker.csv").write_text(tracker_log())
    return js.read(tmp_path / "robot.csv", tmp_path / "tracker.csv", robot=ARM, **STATED, **stated)


def test_several_lines_of_a_controller_at_each_stop_are_one_posture(tmp_path):
    proposal = read_controller(tmp_path)
    assert "the mean of the joints of a posture in several lines" in str(proposal)
    assert shifts_of(proposal) == pytest.approx(np.tile(SAG, (12, 1)), abs=2e-3)


def test_joints_that_differ_between_the_states_are_one_posture_within_a_stated_tolerance_only(tmp_path):
    with pytest.raises(js.CampaignError):
        read_controller(tmp_path, change=1e-3)
    proposal = read_controller(tmp_path, change=1e-3, joint_tolerance=0.1)
    assert shifts_of(proposal) == pytest.approx(np.tile(SAG, (12, 1)), abs=2e-3)


def samples_of_stops(states=(0, 1), samples=3, spread=0.01):
    """Return lines of a log merged with a tracker: samples of each stop without load, then under load."""
    noise = np.random.default_rng(8).normal(0.0, spread, (2, samples, *FIRST.shape))
    rows = [
        [*READINGS.joints[k], 8.0 * state, *(FIRST[k] + state * SAG + noise[state, line, k])]
        for state in states
        for k in (range(len(FIRST)) if state == 0 else reversed(range(len(FIRST))))
        for line in range(samples)
    ]
    header = [*(f"target_q_{k}" for k in range(6)), "payload", "lt_x", "lt_y", "lt_z"]
    return [header, *([f"{value:.7f}" for value in row] for row in rows)]


def write_cells(path, rows):
    path.write_text("\n".join(",".join(cells) for cells in rows) + "\n")
    return path


def test_samples_of_a_stop_with_the_same_joints_are_repeats_of_one_posture(tmp_path):
    proposal = js.read(write_cells(tmp_path / "log.csv", samples_of_stops()), robot=ARM, **STATED)
    assert "rows with the same joints are one posture" in str(proposal)
    assert shifts_of(proposal) == pytest.approx(np.tile(SAG, (12, 1)), abs=0.03)


def test_states_with_other_numbers_of_samples_are_repeats_too(tmp_path):
    rows = samples_of_stops()[:-1]
    proposal = js.read(write_cells(tmp_path / "log.csv", rows), robot=ARM, **STATED)
    assert shifts_of(proposal) == pytest.approx(np.tile(SAG, (12, 1)), abs=0.03)


def test_samples_of_a_stop_are_repeats_where_two_files_have_the_rows_in_one_order(tmp_path):
    rows = samples_of_stops()
    files = [
        write_cells(tmp_path / "robot.csv", [cells[:7] for cells in rows]),
        write_cells(tmp_path / "tracker.csv", [cells[6:] for cells in rows]),
    ]
    proposal = js.read(*files, robot=ARM, **STATED)
    assert shifts_of(proposal) == pytest.approx(np.tile(SAG, (12, 1)), abs=0.03)


def test_samples_of_a_stop_that_are_far_apart_are_no_repeats(tmp_path):
    rows = samples_of_stops(spread=0.5)
    with pytest.raises(js.CampaignError, match="has this row twice"):
        js.read(write_cells(tmp_path / "log.csv", rows), robot=ARM, **STATED)


def test_a_mean_of_repeats_is_never_that_of_several_postures_without_names(tmp_path):
    rows = samples_of_stops()
    proposal = js.read(write_cells(tmp_path / "log.csv", rows), robot=ARM, **STATED, mean_of_repeats=True)
    assert len(shifts_of(proposal)) == len(FIRST)


def test_a_stop_that_lacks_its_state_under_load_is_left_out_with_a_note(tmp_path):
    rows = samples_of_stops()[:-3]
    proposal = js.read(write_cells(tmp_path / "log.csv", rows), robot=ARM, **STATED)
    assert "1: target lt was read only unloaded" in str(proposal)
    assert len(shifts_of(proposal)) == len(FIRST) - 1


def read_lines(tmp_path, header, no, yes):
    """Read a table with rows of two targets, whose states are words below a header."""
    names = ("pose_id", header, "nest")
    rows = [["ts", *(f"J{k} [deg]" for k in range(1, 7)), *names, *(f"p {axis} [mm]" for axis in "xyz")]]
    for word in (no, yes):
        for k, angles in enumerate(np.rad2deg(READINGS.joints)):
            for target in (0, 1):
                place = 1e3 * READINGS.position[k, target] + (SAG if word == yes else 0.0)
                cells = [f"{value:.4f}" for value in (*angles, *place)]
                names = (str(k + 20), word, f"nest{target + 1}")
                rows.append([str(1700000000 + 7 * len(rows)), *cells[:6], *names, *cells[6:]])
    return js.read(write_cells(tmp_path / "log.csv", rows), robot=ARM, **STATED)


def test_rows_name_the_postures_and_targets_of_positions_with_one_header(tmp_path):
    proposal = read_lines(tmp_path, "loaded", "false", "true")
    observations = proposal.accept().campaign.measurement_set.observations
    assert [each.label for each in observations] == [str(k + 20) for k in range(12)]
    assert {each.target for own in observations for each in own.readings} == {"nest1", "nest2"}
    assert shifts_of(proposal) == pytest.approx(np.tile(SAG, (24, 1)), abs=2e-3)


@pytest.mark.parametrize(
    ("header", "no", "yes"),
    [
        *(("loaded", *words) for words in (("0", "1"), ("FALSE", "TRUE"), ("nein", "ja"), ("no", "yes"))),
        *(("is_loaded", *words) for words in (("0", "1"), ("false", "true"))),
        *(("unloaded", *words) for words in (("1", "0"), ("true", "false"), ("ja", "nein"))),
        ("LAST", "0", "1"),
    ],
)
def test_a_flag_below_a_state_says_whether_the_state_is_that_of_the_row(tmp_path, header, no, yes):
    proposal = read_lines(tmp_path, header, no, yes)
    assert "by their order" not in str(proposal)
    assert shifts_of(proposal) == pytest.approx(np.tile(SAG, (24, 1)), abs=2e-3)


def readings_of_stops(names=False):
    """Return a table with a row for each posture, and one with two samples of each state of each posture."""
    joints = [[f"q{k}" for k in range(6)], *([f"{each:.6f}" for each in row] for row in READINGS.joints)]
    points = [["payload", "x", "y", "z"]]
    for k, place in enumerate(FIRST):
        joints[k + 1] += [f"P{k}"] if names else []
        for state, sample in ((0, 0.0), (0, 0.01), (1, 0.0), (1, 0.01)):
            cells = [f"{value:.4f}" for value in (8.0 * state, *(place + state * SAG + sample))]
            points.append([*cells, f"P{k}"] if names else cells)
    for rows in (joints, points) if names else ():
        rows[0].append("label")
    return joints, points


def read_stops(tmp_path, names):
    tables = zip(("joints.csv", "points.csv"), readings_of_stops(names), strict=True)
    return js.read(*(write_cells(tmp_path / name, rows) for name, rows in tables), robot=ARM, **STATED)


def test_the_order_of_several_samples_of_each_state_never_tells_the_states(tmp_path):
    with pytest.raises(
        js.CampaignError, match="no names of postures and states tell which of them are repeats"
    ):
        read_stops(tmp_path, names=False)
    proposal = read_stops(tmp_path, names=True)
    assert shifts_of(proposal) == pytest.approx(np.tile(SAG, (12, 1)), abs=2e-3)


def write_stops(folder, states, name="M{target}_{stop:03}", write_angles=None):
    """Write a log of a controller with a line for each stop, and points of two targets at each stop."""
    log, points = ["Protokoll Start 08:55:10"], ["Point;X [mm];Y [mm];Z [mm]"]
    for state in states:
        for k, angles in enumerate(np.rad2deg(READINGS.joints), 1):
            stop = len(log)
            log.append(f"08:57:{stop:02}  POS  {write_angles(state, angles)}")
            for target in (0, 1):
                place = 1e3 * READINGS.position[k - 1, target] + state * SAG
                names = name.format(target=target + 1, stop=stop)
                points.append(f"{names};" + ";".join(f"{value:.4f}" for value in place))
    (folder / "log.txt").write_text("\n".join(log) + "\n")
    (folder / "points.csv").write_text("\n".join(points) + "\n")
    return [folder / "log.txt", folder / "points.csv"]


def write_krl(state, angles):
    axes = ",".join(f"A{axis} {angle:.4f}" for axis, angle in enumerate(angles, 1))
    return f"LAST={state}  $AXIS_ACT={{{axes}}}"


def write_rapid(state, angles):
    axes = ",".join(f"{angle:.4f}" for angle in angles)
    return f"load = {state} [[{axes}],[9E9,9E9,9E9,9E9,9E9,9E9]]"


@pytest.mark.parametrize("states", [(0, 1), (1, 0)])
@pytest.mark.parametrize("write_angles", [write_krl, write_rapid])
def test_a_field_of_a_log_says_the_state_of_the_points_of_each_stop(write_angles, states, tmp_path):
    proposal = js.read(*write_stops(tmp_path, states, write_angles=write_angles), robot=ARM, **STATED)
    observations = proposal.accept().campaign.measurement_set.observations
    assert {each.target for own in observations for each in own.readings} == {"M1", "M2"}
    assert shifts_of(proposal) == pytest.approx(np.tile(SAG, (24, 1)), abs=2e-3)


NAMES_WITHOUT_STOPS = pytest.mark.parametrize("name", ["ball", "M{target}", "{stop:03}"])


@NAMES_WITHOUT_STOPS
def test_points_in_the_order_of_their_stops_need_no_numbers(name, tmp_path):
    proposal = js.read(*write_stops(tmp_path, (0, 1), name, write_krl), robot=ARM, **STATED)
    assert shifts_of(proposal) == pytest.approx(np.tile(SAG, (24, 1)), abs=2e-3)


@NAMES_WITHOUT_STOPS
def test_points_without_numbers_of_stops_under_load_first_are_a_question(name, tmp_path):
    with pytest.raises(js.CampaignError):
        js.read(*write_stops(tmp_path, (1, 0), name, write_krl), robot=ARM, **STATED)


def test_a_flag_of_a_state_is_no_mass(tmp_path):
    files = write_stops(tmp_path, (0, 1), write_angles=write_krl)
    proposal = js.read(*files, robot=ARM, **STATED | {"force": None})
    assert "'LAST' has 1" not in str(proposal.accept().missing)


@pytest.mark.parametrize("states", [(0, 1), (1, 0)])
@pytest.mark.parametrize("words", [("unloaded", "loaded"), ("leer", "200 kg")])
def test_states_of_named_postures_in_a_log_are_those_of_the_points_of_each_stop(words, states, tmp_path):
    _, points = write_stops(tmp_path, states, write_angles=write_krl)
    rows = [["Pos", *(f"J{k} [deg]" for k in range(1, 7)), "state"]]
    for state in states:
        for k, angles in enumerate(np.rad2deg(READINGS.joints), 1):
            rows.append([f"P{k:02}", *(f"{angle:.4f}" for angle in angles), words[state]])
    proposal = js.read(write_cells(tmp_path / "log.csv", rows), points, robot=ARM, **STATED)
    observations = proposal.accept().campaign.measurement_set.observations
    assert [each.label for each in observations] == [f"P{k:02}" for k in range(1, 13)]
    assert shifts_of(proposal) == pytest.approx(np.tile(SAG, (24, 1)), abs=2e-3)
