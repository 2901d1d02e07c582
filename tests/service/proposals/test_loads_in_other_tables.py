"""Loads of postures in other tables than the joints: with the readings, or in a table of their own."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=31, configurations=14)
COUNT = len(READINGS.joints)
FIRST = 1e3 * READINGS.position[:, 0]
FORCES = np.random.default_rng(31).uniform(-120.0, 120.0, (COUNT, 3)).round(1)
LOADED = FIRST + 2e-3 * FORCES
NAMES = [f"C{number:02}" for number in range(1, COUNT + 1)]
AXES = ("Fx [N]", "Fy [N]", "Fz [N]")
R0 = np.eye(3)
POINT = {"load_point": [0, 0, 100]}


def texts(numbers):
    return [f"{each:.4f}" for each in numbers]


def joints(extra=(), values=()):
    values = values or [()] * COUNT
    rows = [
        [name, *texts(angles), *own]
        for name, angles, own in zip(NAMES, np.rad2deg(READINGS.joints), values, strict=True)
    ]
    return [["ID", *(f"{axis} [deg]" for axis in "SLURBT"), *extra], *rows]


def points(extra=(), values=(), turn=R0):
    values = values or [()] * COUNT
    rows = [
        [name, state, *texts(turn @ place), *own]
        for state, places in (("U", FIRST), ("L", LOADED))
        for name, place, own in zip(NAMES, places, values, strict=True)
    ]
    return [["ID", "State", "Wert a", "Wert b", "Wert c", *extra], *rows]


def loads(values=FORCES, head=AXES):
    return [["ID", *head], *([name, *map(str, own)] for name, own in zip(NAMES, values, strict=True))]


def read(folder, tables, **stated):
    for name, rows in tables.items():
        (folder / name).write_text("".join(";".join(row) + "\n" for row in rows))
    return js.read(*(folder / name for name in tables), robot=ARM, encoders="motor", **{**POINT, **stated})


def set_of(proposal):
    return proposal.accept().campaign.measurement_set


def forces_of(proposal):
    return np.array([own.force for own in set_of(proposal).observations])


def in_states(empty):
    """Return a table of forces with a row for each posture and state, `empty` without load."""
    free = [[name, "U", *empty] for name in NAMES]
    loaded = [[name, "L", *map(str, own)] for name, own in zip(NAMES, FORCES, strict=True)]
    return [["ID", "State", *AXES], *free, *loaded]


@pytest.mark.parametrize(
    "own",
    [loads(), [loads()[0], *loads()[:0:-1]], in_states(("0", "0", "0")), in_states(("", "", ""))],
    ids=["row a posture", "other order", "0 without load", "empty without load"],
)
def test_forces_in_a_table_of_their_own_are_those_of_the_postures_of_their_names(tmp_path, own):
    proposal = read(tmp_path, {"j.csv": joints(), "p.csv": points(), "l.csv": own})
    assert "'Fx [N]', 'Fy [N]', 'Fz [N]' of l.csv as the force of each posture" in str(proposal)
    assert np.allclose(forces_of(proposal), FORCES)


def test_forces_in_the_table_of_readings_are_those_of_the_postures(tmp_path):
    tables = {"j.csv": joints(), "p.csv": points(AXES, FORCES.astype(str).tolist())}
    assert np.allclose(forces_of(read(tmp_path, tables)), FORCES)


def test_forces_beside_readings_of_a_tracker_are_turned_into_r0_with_them(tmp_path):
    turn = np.array([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]])
    rows = points(AXES, (FORCES @ turn.T).round(6).astype(str).tolist(), turn)
    proposal = read(tmp_path, {"j.csv": joints(), "p.csv": rows})
    assert "from the instrument's axes into R0" in str(proposal)
    assert np.abs(forces_of(proposal) - FORCES).max() < 0.5


def test_forces_of_0_in_the_table_of_readings_without_load_give_way(tmp_path):
    rows = points(AXES, FORCES.astype(str).tolist())
    free = [rows[0], *([*row[:-3], "0", "0", "0"] for row in rows[1 : COUNT + 1])]
    tables = {"j.csv": joints(), "free.csv": free, "loaded.csv": [rows[0], *rows[COUNT + 1 :]]}
    tables = {name: [[row[0], *row[2 - (name == "j.csv") :]] for row in own] for name, own in tables.items()}
    assert np.allclose(forces_of(read(tmp_path, tables)), FORCES)


def test_forces_without_names_are_in_the_order_of_the_postures_if_the_caller_says_so(tmp_path):
    tables = {"j.csv": joints(), "p.csv": points(), "l.csv": [row[1:] for row in loads()]}
    assert np.allclose(forces_of(read(tmp_path, tables, by_order=True)), FORCES)


def test_forces_without_names_are_refused_beside_named_postures(tmp_path):
    tables = {"j.csv": joints(), "p.csv": points(), "l.csv": [row[1:] for row in loads()]}
    with pytest.raises(js.CampaignError, match="by_order") as error:
        read(tmp_path, tables).accept()
    assert "'l.csv' is not read" in str(error.value)


def test_sizes_along_unit_vectors_in_a_table_of_their_own_are_the_forces_of_the_postures(tmp_path):
    sizes = np.linalg.norm(FORCES, axis=1, keepdims=True)
    own = loads(np.hstack([sizes, FORCES / sizes]), ("Magnitude [N]", "dir x", "dir y", "dir z"))
    proposal = read(tmp_path, {"j.csv": joints(), "p.csv": points(), "l.csv": own})
    assert "'Magnitude [N]' of l.csv along the unit vectors of columns 3–5" in str(proposal)
    assert np.allclose(forces_of(proposal), FORCES, atol=1e-3)


def test_sizes_along_unit_vectors_in_a_table_that_the_deflections_contradict_are_no_forces(tmp_path):
    sizes = np.linalg.norm(FORCES, axis=1, keepdims=True)
    vectors = np.roll(FORCES / sizes, 3, axis=0)
    own = loads(np.hstack([sizes, vectors]), ("Magnitude [N]", "dir x", "dir y", "dir z"))
    with pytest.raises(js.CampaignError, match=r"'l.csv' is not read"):
        read(tmp_path, {"j.csv": joints(), "p.csv": points(), "l.csv": own}).accept()


def along_axes(sign=1.0):
    """Return loaded positions, and a table of the sizes and the directions of the forces."""
    axes, forces = np.argmax(np.abs(FORCES), axis=1), np.zeros_like(FORCES)
    rows = np.arange(COUNT)
    forces[rows, axes] = FORCES[rows, axes]
    words = ["+-"[int(own < 0.0)] + "XYZ"[axis] for own, axis in zip(forces.sum(axis=1), axes, strict=True)]
    values = list(zip(np.abs(forces.sum(axis=1)), words, strict=True))
    table = points()
    for row, place in zip(table[1 + COUNT :], FIRST + sign * 2e-3 * forces, strict=True):
        row[2:5] = texts(place)
    return forces, table, loads(values, ("Betrag [N]", "Richtung"))


def test_sizes_along_directions_in_a_table_of_their_own_are_the_forces_of_the_postures(tmp_path):
    forces, positions, own = along_axes()
    proposal = read(tmp_path, {"j.csv": joints(), "p.csv": positions, "l.csv": own})
    assert "'Betrag [N]' along the directions of 'Richtung' of l.csv in R0" in str(proposal)
    assert np.allclose(forces_of(proposal), forces)


def test_directions_in_a_table_against_which_the_targets_move_are_no_forces(tmp_path):
    _, positions, own = along_axes(sign=-1.0)
    with pytest.raises(js.CampaignError, match=r"do not move along 'Richtung' of l.csv in R0"):
        read(tmp_path, {"j.csv": joints(), "p.csv": positions, "l.csv": own}).accept()


def test_moments_and_load_points_of_a_table_are_those_of_the_postures(tmp_path):
    head = (
        *AXES,
        "Mx [Nm]",
        "My [Nm]",
        "Mz [Nm]",
        "load point x [mm]",
        "load point y [mm]",
        "load point z [mm]",
    )
    moments = np.arange(3.0 * COUNT).reshape(COUNT, 3)
    places = np.tile([0.0, 10.0, 100.0], (COUNT, 1))
    own = loads(np.hstack([FORCES, moments, places]), head)
    proposal = read(tmp_path, {"j.csv": joints(), "p.csv": points(), "l.csv": own}, load_point=None)
    found = set_of(proposal)
    assert np.allclose(forces_of(proposal), FORCES)
    assert np.allclose([each.moment for each in found.observations], moments)


def test_masses_of_a_table_are_weights(tmp_path):
    masses = [4 + number % 3 for number in range(COUNT)]
    own = loads([(mass, 3, 21.5) for mass in masses], ("mass [kg]", "hook", "room temperature [°C]"))
    proposal = read(tmp_path, {"j.csv": joints(), "p.csv": points(), "l.csv": own})
    assert "'mass [kg]' of l.csv as weights along −z of R0" in str(proposal)
    assert set_of(proposal).units.force == "kgf"
    assert np.allclose(forces_of(proposal), np.outer(masses, [0, 0, -1]))


def test_a_posture_with_two_forces_in_a_table_is_refused_by_its_line(tmp_path):
    rows = points(AXES, FORCES.astype(str).tolist())
    rows[-1][-1] = "55"
    with pytest.raises(js.CampaignError, match="the force differs from that of the same posture") as error:
        read(tmp_path, {"j.csv": joints(), "p.csv": rows}).accept()
    assert "line 15, column 6: the force differs from that of the same posture in line 29" in str(error.value)


def test_a_posture_with_two_forces_in_two_tables_is_refused_by_its_name(tmp_path):
    others = FORCES.copy()
    others[2, 1] += 5.0
    tables = {
        "j.csv": joints(AXES, FORCES.astype(str).tolist()),
        "p.csv": points(),
        "l.csv": loads(others),
    }
    with pytest.raises(js.CampaignError, match=r"the force of posture 'C03' differs from that of 'l\.csv'"):
        read(tmp_path, tables).accept()


def test_forces_of_two_tables_that_agree_are_read(tmp_path):
    head = ("Fx [kN]", "Fy [kN]", "Fz [kN]")
    tables = {
        "j.csv": joints(AXES, FORCES.astype(str).tolist()),
        "p.csv": points(),
        "l.csv": loads((1e-3 * FORCES).round(7), head),
    }
    assert np.allclose(forces_of(read(tmp_path, tables)), FORCES)


def test_a_stated_force_beside_forces_of_another_table_is_refused(tmp_path):
    tables = {"j.csv": joints(), "p.csv": points(), "l.csv": loads()}
    with pytest.raises(js.CampaignError, match="force"):
        read(tmp_path, tables, force=[0, 0, -100], units={"force": "N"}).accept()


def test_the_preview_shows_the_columns_of_each_file_alone(tmp_path):
    proposal = read(tmp_path, {"j.csv": joints(), "p.csv": points(), "l.csv": loads()})
    shown = [[each.header for each in file.columns] for file in proposal.accept().files]
    assert shown == [joints()[0], points()[0], loads()[0]]
