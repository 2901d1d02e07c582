"""Robots from the calibration of a Universal Robots arm, compared with its Denavit-Hartenberg parameters."""

import numpy as np
import pytest
from support.terminal import terminal

import jointstiff as js
from jointstiff.service.conversion.catalogue import find_arm
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.solver.mechanics.postures import flange_poses

DELTAS = {
    "theta": [-5.2e-5, 0.31, -0.42, 0.11, 3e-5, 0.0],
    "a": [2e-5, 0.012, -0.003, 1e-4, -2e-5, 0.0],
    "d": [1e-4, 205.3, -212.8, 7.5, -1e-4, 4e-5],
    "alpha": [3e-4, 1.1e-3, -8e-4, -2e-4, 1e-4, 0.0],
}
CONF = "[mounting]\n" + "".join(
    f"delta_{name} = [ {', '.join(map(repr, numbers))} ]\n" for name, numbers in DELTAS.items()
)
POSTURES = np.random.default_rng(3).uniform(-2.0, 2.0, (20, 6))


def flange_by_parameters(q):
    """The flange by the parameters of the arm and their deviations, row by row."""
    pose = np.eye(4)
    for i, row in enumerate(find_arm("UR10e", "robot").model.rows):
        a, alpha, d, theta = (getattr(row, name) + DELTAS[name][i] for name in ("a", "alpha", "d", "theta"))
        ct, st, ca, sa = np.cos(theta + q[i]), np.sin(theta + q[i]), np.cos(alpha), np.sin(alpha)
        turned = [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st]]
        pose = pose @ np.array([*turned, [0, sa, ca, d], [0, 0, 0, 1]])
    return pose


def test_a_controllers_calibration_gives_the_flange_of_its_parameters(tmp_path):
    """Two parallel axes have frames 200 m away in the file, and none in the robot."""
    (tmp_path / "ur10e_calibration.conf").write_text(CONF)
    robot = js.robot(tmp_path / "ur10e_calibration.conf")
    prepared = prepare_robot(robot).robot
    found = flange_poses(prepared, POSTURES)
    wanted = np.array([flange_by_parameters(q) for q in POSTURES])
    assert found == pytest.approx(wanted, abs=1e-9)
    assert (robot.name, robot.payload) == ("Universal Robots UR10e (calibrated)", 12.5)


YAML = """kinematics:
  shoulder: {x: 0, y: 0, z: 0.1807, roll: -0, pitch: 0, yaw: -0}
  upper_arm:
    x: 0
    y: 0
    z: 0
    roll: 1.570796327
    pitch: 0
    yaw: -0
  forearm: {x: -0.6127, y: 0, z: 0, roll: -0, pitch: 0, yaw: -0}
  wrist_1: {x: -0.57155, y: 0, z: 0.17415, roll: -0, pitch: 0, yaw: -0}
  wrist_2: {x: 0, y: -0.11985, z: -2.458164590756244e-11, roll: 1.570796327, pitch: 0, yaw: -0}
  wrist_3: {x: 0, y: 0.11655, z: -2.39e-11, roll: 1.570796326589793, pitch: 3.1415926536, yaw: 3.1415926536}
  hash: calib_12788084448423163542
"""


def test_the_nominal_file_of_ros_gives_the_arm_of_the_catalogue(tmp_path):
    (tmp_path / "default_kinematics.yaml").write_text(YAML)
    found = flange_poses(prepare_robot(js.robot(tmp_path / "default_kinematics.yaml")).robot, POSTURES)
    wanted = flange_poses(prepare_robot(js.robot("Universal Robots UR10e")).robot, POSTURES)
    assert found == pytest.approx(wanted, abs=1e-8)


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        (
            "calibration.conf",
            CONF,
            "does not name its arm.*rename the file, such as `ur10e_calibration.conf`",
        ),
        (
            "ur10e_calibration.conf",
            CONF.replace("7.5, ", ""),
            "`delta_d` of the calibration does not have six",
        ),
        ("a.yaml", YAML.replace("z: 0.1807", ""), "the calibration has no z of shoulder"),
        ("a.conf", "[mounting]\n", "the file has no calibration.*give `calibration.conf` of the controller"),
    ],
)
def test_another_file_is_refused_with_what_is_needed(name, text, reason, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(js.CampaignError, match=reason):
        js.robot(tmp_path / name)


def test_the_terminal_reads_a_calibration_as_a_robot(tmp_path):
    (tmp_path / "ur10e_calibration.conf").write_text(CONF)
    planned = terminal(
        "plan", tmp_path / "ur10e_calibration.conf", "--target", "P1=0,0,0.1", "--load", "dead_weight:100"
    )
    assert planned.exit_code == 0, planned.output
