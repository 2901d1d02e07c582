"""Robots from the calibration of a Universal Robots arm, compared with its Denavit-Hartenberg parameters."""

import numpy as np
import pytest
from support.terminal import terminal

import jointstiff as js
from jointstiff.service.conversion.catalogue import find_arm
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.solver.mechanics.postures import flange_poses


def step(theta, a, d, alpha):
    """The transform of a row of the standard convention."""
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
    )


def meet(first, second):
    """The feet of the common normal of two lines, given by a point and a direction, and its direction."""
    (p, u), (q, v) = first, second
    normal = np.cross(u, v)
    along = np.linalg.solve(np.column_stack([u, -v, normal]), q - p)
    return p + along[0] * u, q + along[1] * v, normal / np.linalg.norm(normal)


def calibrate(rows, tilt=3e-4, shift=1e-4):
    """Deviations of the parameters of an arm whose axes are tilted [rad] and moved [m] by chance."""
    rng = np.random.default_rng(11)
    poses = [np.eye(4)]
    for row in rows:
        poses.append(poses[-1] @ step(row.theta, row.a, row.d, row.alpha))
    lines = [(pose[:3, 3], pose[:3, 2]) for pose in poses]
    for i in range(1, 6):
        direction = lines[i][1] + np.cross(rng.normal(scale=tilt, size=3), lines[i][1])
        lines[i] = lines[i][0] + rng.normal(scale=shift, size=3), direction / np.linalg.norm(direction)
    deltas = {name: [] for name in ("theta", "a", "d", "alpha")}
    origin, x = np.zeros(3), np.array([1.0, 0.0, 0.0])
    for row, pose, line, following in zip(rows[:5], poses[1:6], lines[:5], lines[1:6], strict=True):
        foot, next_origin, normal = meet(line, following)
        normal = normal * np.sign(normal @ pose[:3, 0])
        z, next_z = line[1], following[1]
        found = {
            "theta": np.arctan2(np.cross(x, normal) @ z, x @ normal),
            "a": (next_origin - foot) @ normal,
            "d": (foot - origin) @ z,
            "alpha": np.arctan2(np.cross(z, next_z) @ normal, z @ next_z),
        }
        for name, value in found.items():
            deltas[name].append(float(value - getattr(row, name)))
        origin, x = next_origin, normal
    return {name: [*values, 0.0] for name, values in deltas.items()}


DELTAS = calibrate(find_arm("UR10e", "robot").model.rows)
CONF = "[mounting]\n" + "".join(
    f"delta_{name} = [ {', '.join(map(repr, numbers))} ]\n" for name, numbers in DELTAS.items()
)
POSTURES = np.random.default_rng(3).uniform(-2.0, 2.0, (20, 6))


def flange_by_parameters(q):
    """The flange by the parameters of the arm and their deviations, row by row."""
    pose = np.eye(4)
    for i, row in enumerate(find_arm("UR10e", "robot").model.rows):
        theta, a, d, alpha = (getattr(row, name) + DELTAS[name][i] for name in ("theta", "a", "d", "alpha"))
        pose = pose @ step(theta + q[i], a, d, alpha)
    return pose


def test_a_controllers_calibration_gives_the_flange_of_its_parameters(tmp_path):
    """Two parallel axes have frames far away in the file, and none in the robot."""
    assert max(map(abs, DELTAS["d"])) > 0.1
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
            "the name of the file names no arm.*named by its arm as `ur10e_calibration.conf`",
        ),
        (
            "ur10e_calibration.conf",
            CONF.replace(f"{DELTAS['d'][3]!r}, ", ""),
            "`delta_d` of the calibration does not have six",
        ),
        ("a.yaml", YAML.replace("z: 0.1807, ", ""), "of six links: 'z'; remedy"),
        ("a.yaml", YAML.replace("0.1807", "0.1807mm"), "could not convert string to float: '0.1807mm'"),
        (
            "a.yaml",
            YAML.replace("0.1807", "180.7"),
            "z of shoulder is 180.7 m or rad, too much for an arm",
        ),
        ("a.yaml", YAML.replace("1.570796327,", "90,"), "roll of wrist_2 is 90 m or rad"),
        ("a.yaml", YAML.replace("0.1807", ".nan"), "z of shoulder is nan"),
        ("a.yaml", YAML.replace("  forearm:", "  elbow:"), "of six links: 'forearm'"),
        ("a.yaml", "kinematics:\n" + "  - [" * 5000, "the file does not have x, y, z"),
        ("a.yaml", "kinematics:\n" + " \n" * 200_000, "has more than 65,536 characters"),
        (
            "ur10e_calibration.conf",
            CONF.replace(repr(DELTAS["theta"][1]), "31.0"),
            "moves the flange of a .*UR10e by .* mm",
        ),
        (
            "ur3_calibration.conf",
            CONF,
            "moves the flange of a .*UR3 by .* mm, so the calibration belongs to another arm",
        ),
        (
            "ur10e_calibration.conf",
            CONF.replace(repr(DELTAS["d"][1]), "1e999"),
            "`delta_d` of the calibration does not",
        ),
        ("ur10e_calibration.conf", CONF + CONF, "the file has no calibration: .*already exists"),
        ("a.conf", "[mounting]\n", "the file has no calibration.*give `calibration.conf` of the controller"),
    ],
)
def test_another_file_is_refused_with_what_is_needed(name, text, reason, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(js.CampaignError, match=reason):
        js.robot(tmp_path / name)


def test_a_comment_of_a_calibration_is_no_number(tmp_path):
    commented = YAML.replace("forearm: {x: -0.6127,", "forearm: {x: -0.6127, # x: 3\n   ")
    (tmp_path / "a.yaml").write_text(commented)
    (tmp_path / "b.yaml").write_text(YAML)
    found = [prepare_robot(js.robot(tmp_path / name)).robot for name in ("a.yaml", "b.yaml")]
    assert (flange_poses(found[0], POSTURES) == flange_poses(found[1], POSTURES)).all()


def test_the_terminal_reads_a_calibration_as_a_robot(tmp_path):
    (tmp_path / "ur10e_calibration.conf").write_text(CONF)
    planned = terminal(
        "plan", tmp_path / "ur10e_calibration.conf", "--target", "P1=0,0,0.1", "--load", "dead_weight:100"
    )
    assert planned.exit_code == 0, planned.output
