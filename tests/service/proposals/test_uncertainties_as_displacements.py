"""Uncertainties in columns `dX`, `dY`, `dZ` of points whose groups name posture and state."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=25, configurations=12)
SAG = np.array([0.01, 0.02, -0.5])
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -100], "units": {"force": "N"}}


def read_groups(folder, uncertainties, group="{state} P{number:02}"):
    """Return the proposal for joints, and for an export whose groups name posture and state."""
    joints = ["label,J1,J2,J3,J4,J5,J6"]
    for number, row in enumerate(np.rad2deg(READINGS.joints), 1):
        joints.append(",".join([f"P{number:02}", *(f"{each:.3f}" for each in row)]))
    points = ["// units: mm", "// Collection, Group, Point, X, Y, Z, dX, dY, dZ"]
    for state, shift in (("unloaded", 0.0 * SAG), ("loaded", SAG)):
        for number, positions in enumerate(READINGS.position, 1):
            for target, place in zip("AB", 1e3 * positions, strict=False):
                name = group.format(state=state, number=number)
                numbers = [*(f"{each:.4f}" for each in place + shift), *uncertainties]
                points.append(", ".join(["Main", name, target, *numbers]))
    (folder / "joints.csv").write_text("\n".join(joints) + "\n")
    (folder / "points.txt").write_text("\n".join(points) + "\n")
    return js.read(folder / "joints.csv", folder / "points.txt", robot=ARM, **STATED)


@pytest.mark.parametrize("group", ["{state} P{number:02}", "P{number}_{state}"])
def test_uncertainties_under_headers_of_displacements_are_left_out_with_a_remark(tmp_path, group):
    proposal = read_groups(tmp_path, ["0.0090", "0.0110", "0.0080"], group)
    assert "dX, dY, dZ ignored as uncertainties: all are above 0 and below 0.1 mm" in str(proposal)
    readings = [
        each for own in proposal.accept().campaign.measurement_set.observations for each in own.readings
    ]
    assert {each.target for each in readings} == {"A", "B"}
    shifts = [np.subtract(each.loaded, each.unloaded) for each in readings]
    assert shifts == pytest.approx(np.tile(SAG, (24, 1)), abs=1e-3)


@pytest.mark.parametrize("numbers", [["-0.0090", "0.0110", "0.0080"], ["0.0090", "0.0110", "0.2"]])
def test_displacements_with_a_sign_or_of_a_load_are_no_uncertainties(tmp_path, numbers):
    try:
        text = str(read_groups(tmp_path, numbers))
    except js.CampaignError as error:
        text = str(error)
    assert "as uncertainties" not in text
