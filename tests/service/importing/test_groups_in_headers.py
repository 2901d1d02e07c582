"""Headers of two rows: groups of states and targets, and columns that no group is above."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js
from jointstiff.service.importing.loads import find_load, remove_load

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=18, configurations=12)
PLACES = [1e3 * READINGS.position[:, target] for target in (0, 1)]
SAG = np.array([0.01, 0.02, -0.5])
STATED = {"encoders": "motor", "load_point": [0, 0, 100]}
GROUPS = {
    "a sign between state and target": [
        f"{state} - T{n} (mm)" for state in ("No load", "Loaded 30 lb") for n in (1, 2)
    ],
    "a colon": [f"{state} : T{n} (mm)" for state in ("unbelastet", "belastet 30 lbs") for n in (1, 2)],
}


def write(path, groups):
    rows = [
        ["", "Joint angles (deg)", *[""] * 7, *(cell for group in groups for cell in (group, "", ""))],
        ["Pose", *(f"J{i}" for i in range(1, 7)), "Hall temp (C)", "Operator", *"XYZ" * 4],
    ]
    blocks = [np.rad2deg(READINGS.joints), *PLACES, *(place + SAG for place in PLACES)]
    for number in range(len(READINGS.joints)):
        joints, *points = [[f"{each:.3f}" for each in block[number]] for block in blocks]
        rows.append([f"P{number:02}", *joints, "21.5", "JK", *(cell for point in points for cell in point)])
    path.write_text("".join(",".join(row) + "\n" for row in rows))


@pytest.mark.parametrize("form", GROUPS)
def test_states_and_loads_above_targets_are_those_of_one_target(tmp_path, form):
    write(tmp_path / "a.csv", GROUPS[form])
    proposal = js.read(tmp_path / "a.csv", robot=ARM, **STATED)
    assert "loaded 13.6078 kg: force 0, 0, −133.4 N" in str(proposal)
    observations = proposal.accept().campaign.measurement_set.observations
    assert len(observations) == len(READINGS.joints)
    for own in observations:
        assert own.force == pytest.approx([0.0, 0.0, -30 * 0.45359237], rel=1e-5)  # kgf
        assert [each.target for each in own.readings] == ["T1", "T2"]
        for each in own.readings:
            assert np.allclose(np.subtract(each.loaded, each.unloaded), SAG, atol=2e-3)


def test_a_group_of_joints_ends_before_columns_that_are_no_joints(tmp_path):
    write(tmp_path / "a.csv", GROUPS["a sign between state and target"])
    proposal = js.read(tmp_path / "a.csv", robot=ARM, **STATED)
    assert "not read: Hall temp (C), Operator" in str(proposal)


@pytest.mark.parametrize("text", ["T1 300 lb", "T1 300lbs", "300 LB T1"])
def test_a_load_in_pounds_is_a_mass(text):
    assert find_load(text) == pytest.approx(136.078, abs=1e-3)
    assert remove_load(text) == "T1"


@pytest.mark.parametrize("text", ["300 lbf", "3 lb 5 lb", "slb 3"])
def test_other_texts_are_no_mass_in_pounds(text):
    assert find_load(text) is None
