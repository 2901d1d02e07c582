"""Tables of a database: poses, loads and readings in tables of their own, joined by their keys."""

import numpy as np
import pytest
from support.sprung_arm import ARM, STATED, TURN, in_tracker, measure
from support.strange_files import JOINTS, digits, table

import jointstiff as js
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grammar import parse_header

FORCES = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -900.0], [0.0, 900.0, 0.0], [-700.0, 0.0, 0.0]])
"""Loads of a database [N], the first of which is none."""
COUNT = 12
"""Postures."""


def write_database(loads_of_posture, turn=None):
    """Return tables of poses, loads and readings of two targets.

    `loads_of_posture` has the numbers of the loads of each posture; `turn` turns R0 into the tracker's frame.
    """
    loads = [[n, *digits(force), f"load {n}"] for n, force in enumerate(FORCES)]
    readings = []
    for target, name in enumerate("NE"):
        measured = [measure(np.tile(force, (COUNT, 1)), error=0.0, place=target) for force in FORCES]
        joints = measured[0][0]
        positions = [1e3 * (each if turn is None else in_tracker(each, turn)) for _, each in measured]
        readings += [
            [101 + n, load, name, *digits(positions[load][n, 1])]
            for n in range(COUNT)
            for load in (0, *loads_of_posture(n))
        ]
    poses = [[101 + n, f"PROG{n}", *digits(angles)] for n, angles in enumerate(joints)]
    return {
        "loads.csv": write(["load_id", "fx_n", "fy_n", "fz_n", "description"], loads),
        "poses.csv": write(["pose_id", "program", *(f"{joint}_deg" for joint in JOINTS)], poses),
        "readings.csv": write(["pose_id", "load_id", "target", "x_mm", "y_mm", "z_mm"], readings),
    }


def write(headers, rows):
    return table(headers, [[str(cell) for cell in row] for row in rows])


def propose(files, folder, **stated):
    for name, text in files.items():
        (folder / name).write_text(text)
    return js.read(*(folder / name for name in files), robot=ARM, **(STATED | stated))


def read_forces(proposed):
    return np.array([each.force for each in proposed.accept().measurement_set.observations])


@pytest.mark.parametrize("turn", [None, TURN])
def test_the_load_of_each_posture_is_that_of_its_key_and_zero_is_without_load(turn, tmp_path):
    proposed = propose(write_database(lambda n: [1 + n % 3], turn=turn), tmp_path)
    assert "loads.csv joined to readings.csv by 'load_id'" in str(proposed)
    assert "poses.csv joined to readings.csv by 'pose_id'" in str(proposed)
    expected = FORCES[[1 + n % 3 for n in range(COUNT)]]
    np.testing.assert_allclose(read_forces(proposed), expected, atol=1e-3)


def test_each_load_of_a_posture_is_an_observation_with_the_same_unloaded_readings(tmp_path):
    document = propose(write_database(lambda _: [1, 2, 3]), tmp_path).accept().measurement_set
    assert len(document.observations) == 3 * COUNT
    forces = [each.force for each in document.observations]
    np.testing.assert_allclose(forces, np.repeat(FORCES[1:], COUNT, axis=0), atol=1e-3)
    unloaded = np.array([each.readings[0].unloaded for each in document.observations])
    np.testing.assert_array_equal(unloaded[:COUNT], unloaded[COUNT : 2 * COUNT])
    np.testing.assert_array_equal(unloaded[:COUNT], unloaded[2 * COUNT :])


@pytest.mark.parametrize(
    ("header", "kind", "unit"),
    [
        ("fx_n", "force", "N"),
        ("fy_kn", "force", "kN"),
        ("force_z_dan", "force", "daN"),
        ("mx_nm", "moment", "N.m"),
        ("mz_knm", "moment", "kN.m"),
    ],
)
def test_a_vector_in_lower_case_ends_with_its_unit_as_a_length_does(header, kind, unit):
    meaning = parse_header(header, {})
    assert (meaning.kind, meaning.unit) == (kind, unit)


@pytest.mark.parametrize("header", ["load_n", "fx_mn", "Fx_n", "px_nm"])
def test_another_name_in_lower_case_has_no_unit_of_a_force(header):
    with pytest.raises(ImportFileError, match="unknown column header"):
        parse_header(header, {})


@pytest.mark.parametrize("stated", [{}, {"mean_of_repeats": True}])
def test_rows_that_a_column_of_loads_tells_apart_are_never_offered_or_read_as_repeats(stated, tmp_path):
    files = write_database(lambda n: [1 + n % 3])
    del files["loads.csv"]
    with pytest.raises(js.CampaignError, match="of 'load_id', which may be states or loads") as refused:
        propose(files, tmp_path, **stated)
    assert "load_id=state" in str(refused.value)
    assert "mean_of_repeats" not in str(refused.value)


def test_the_key_of_no_load_is_suggested_as_the_state_without_load(tmp_path):
    files = write_database(lambda n: [1 + n % 3])
    rows = files["readings.csv"].splitlines()
    of_one_target = "\n".join(row for row in rows if ";E;" not in row)
    files = {"poses.csv": files["poses.csv"], "readings.csv": of_one_target}
    with pytest.raises(js.CampaignError, match="such as '0' as `unloaded`"):
        propose(files, tmp_path)
