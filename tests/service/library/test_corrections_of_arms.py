"""On three arms of the catalogue: wrong frames and units are refused, and no row is silent."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jointstiff as js
from jointstiff.schemas.correction import CorrectionOptions
from jointstiff.service.library.robots import prepare_once
from jointstiff.service.runs.correction.answer import TableCorrection
from jointstiff.service.runs.correction.poses import PoseTable
from jointstiff.service.runs.correction.verdict import NAMES, REASONS
from jointstiff.solver.correct.correct import RowStatus
from jointstiff.solver.correct.frames import FramesError
from jointstiff.solver.mechanics.postures import flange_poses

ARMS = ["KUKA KR 210 R2700 extra", "FANUC R-2000iC/210F", "ABB IRB 6700-200/2.60"]
TOOL = [50.0, -20.0, 250.0, 0.1, 0.2, -0.1]
BASE = [1000.0, 200.0, 500.0, 0.0, 0.05, 0.5]
FORCE = [100.0, -300.0, -150.0]
UNITS = {"length": "mm", "angle": "rad", "force": "N"}
ROWS = 12
WITHOUT_NUMBERS = {name for status, name in enumerate(NAMES) if status > RowStatus.UNCERTAIN}


def as_pose(numbers):
    """A pose [mm] of X, Y, Z and a rotation vector."""
    pose = np.eye(4)
    pose[:3, 3], pose[:3, :3] = numbers[:3], Rotation.from_rotvec(numbers[3:]).as_matrix()
    return pose


def as_numbers(pose):
    return [*pose[:3, 3].tolist(), *Rotation.from_matrix(pose[:3, :3]).as_rotvec().tolist()]


@cache
def arm(name):
    """The robot, and controller's joints away from its limits and from the stretched wrist [rad]."""
    robot = prepare_once(js.robot(name)).robot
    middle = robot.joint_map.model_angles(np.zeros((1, 6)))[0]
    start = np.clip(middle, robot.limits[:, 0] + 0.6, robot.limits[:, 1] - 0.6)
    start[4] += 0.9
    return robot, robot.joint_map.controller_angles(start[None])[0]


def columns_of(name, joints, *, with_joints=True):
    """The columns of a request for joints (N, 6) that the controller shows [rad]."""
    robot, _ = arm(name)
    flange = flange_poses(robot, robot.joint_map.model_angles(joints))
    flange[:, :3, 3] *= 1e3
    poses = np.linalg.inv(as_pose(BASE)) @ flange @ as_pose(TOOL)
    vectors = Rotation.from_matrix(poses[:, :3, :3]).as_rotvec()
    columns = dict(zip(("x", "y", "z", "rx", "ry", "rz"), [*poses[:, :3, 3].T, *vectors.T], strict=True))
    stated = {f"j{number}": column for number, column in enumerate(joints.T, 1)}
    return columns | (stated if with_joints else {})


def correct(name, columns, **changes):
    robot, _ = arm(name)
    stated = {"units": UNITS, "tool": TOOL, "base": BASE, "force": FORCE} | changes
    options = CorrectionOptions.model_validate(
        {key: value for key, value in stated.items() if value is not None}
    )
    work = TableCorrection.prepare(
        robot, None, options, PoseTable.from_columns(columns, options.units, robot)
    )
    return work.conclude([work.path.correct(0, len(work.path))])


def random_pose(generator, distance, angle):
    """A pose at least a tenth as far [mm] and turned a tenth as much [rad] as stated, in any direction."""
    vectors = generator.normal(size=(2, 3))
    vectors *= generator.uniform(0.1, 1.0, (2, 1)) / np.linalg.norm(vectors, axis=1, keepdims=True)
    return as_pose([*(distance * vectors[0]), *(angle * vectors[1])])


def wrong_tool(generator, columns):
    return {"tool": as_numbers(as_pose(TOOL) @ random_pose(generator, 200.0, 0.3))}, columns


def wrong_base(generator, columns):
    return {"base": as_numbers(random_pose(generator, 500.0, 0.3) @ as_pose(BASE))}, columns


def wrong_world(generator, columns):
    """The controller's world is elsewhere than R0, and its flange is turned."""
    flange = as_pose([0.0, 0.0, 0.0, 0.0, 0.0, generator.choice([-1.0, 1.0]) * np.pi / 2])
    tool, _ = wrong_tool(generator, columns)
    base, _ = wrong_base(generator, columns)
    tool["tool"] = as_numbers(flange @ as_pose(tool["tool"]))
    return tool | base, columns


def wrong_units(generator, columns):
    """Degrees for radians, inches or m for mm."""
    joints = [name for name in columns if name[0] == "j"]
    places = ["x", "y", "z"]
    group, factor = [(joints, 180 / np.pi), (joints, np.pi / 180), (places, 1 / 25.4), (places, 1e-3)][
        generator.integers(4)
    ]
    return {}, columns | {name: factor * columns[name] for name in group}


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("mistake", [wrong_tool, wrong_base, wrong_world, wrong_units])
def test_100_of_100_are_refused_where_joints_are_given(name, mistake):
    generator = np.random.default_rng(1)
    _, start = arm(name)
    refused = 0
    for _ in range(100):
        right = columns_of(name, start + generator.uniform(-0.3, 0.3, size=(ROWS, 6)))
        changes, columns = mistake(generator, right)
        with pytest.raises(FramesError, match="poses and joints differ") as caught:
            correct(name, columns, **changes)
        refused += caught.value.remedy != ""
    assert refused == 100
    assert correct(name, right).statuses == ["corrected"] * ROWS


def strange_table(generator, name):
    """Columns and options of a table with rows that cannot be corrected, each for one reason or another."""
    robot, start = arm(name)
    count = 40
    steps = np.cumsum(generator.normal(scale=0.03, size=(count, 6)), axis=0)
    is_resting = not generator.integers(5)  # the tool stays where it is: no feed
    if is_resting:
        steps[:] = 0.0
    joints = start + np.clip(steps, -0.5, 0.5)
    columns = columns_of(name, joints, with_joints=bool(generator.integers(2)))
    loads = np.tile(FORCE, (count, 1)) * generator.choice([0.0, 1.0, 1e6], (count, 1), p=[0.1, 0.8, 0.1])
    columns |= dict(zip(("fx", "fy", "fz"), loads.T, strict=True))
    far, contradictory = generator.choice(count, (2, 4), replace=False)
    columns = {each: column.copy() for each, column in columns.items()}
    if not is_resting:
        columns["x"][far] += 9e3
    if "j1" in columns and not is_resting:
        columns["j1"][contradictory] += 0.1
        angles = robot.joint_map.model_angles(joints[:1])
        angles[0, 1] = robot.limits[1, 1] + 0.02
        beyond = columns_of(name, robot.joint_map.controller_angles(angles))
        for each, number in beyond.items():
            columns[each][0] = number[0]
    options = {
        "axes": "feed" if generator.integers(2) else "robot",
        "force": None,
        "max_displacement": generator.choice([0.1, 50.0]).item(),
    }
    if "j1" not in columns:
        options["start"] = joints[0].tolist()
    return columns, options


@pytest.mark.parametrize("name", ARMS)
def test_every_row_without_a_number_says_why(name):
    generator, seen = np.random.default_rng(2), set()
    for _ in range(30):
        columns, options = strange_table(generator, name)
        done = correct(name, columns, **options)
        rows = done.rows
        numbers = np.column_stack([rows.joints, rows.poses.reshape(len(rows), -1), rows.deflection])
        is_silent = np.array([each not in WITHOUT_NUMBERS for each in done.statuses])
        has_all, has_any = np.isfinite(numbers).all(axis=1), np.isfinite(numbers).any(axis=1)
        np.testing.assert_array_equal(has_all, is_silent)
        np.testing.assert_array_equal(has_any, is_silent)
        described = done.describe(arm(name)[0])
        for status in WITHOUT_NUMBERS.intersection(done.statuses):
            reason, remedy = REASONS[status]
            count, first = done.statuses.count(status), done.statuses.index(status) + 1
            line = f"{count} of {len(rows)} rows, first row {first}: {reason}; {remedy}"
            assert line in described["remarks"]
            assert (described["counts"][status], described["first"][status]) == (count, first)
        seen.update(done.statuses)
    assert seen >= {"corrected", "no_load", "capped"}
    # A prior knows all joints; whether a posture is ambiguous depends on the arm.
    assert seen >= WITHOUT_NUMBERS - {"unseen_joint", "ambiguous"}


def test_every_status_without_numbers_has_a_reason_and_a_remedy():
    assert set(REASONS) >= WITHOUT_NUMBERS
    assert all(reason and remedy for reason, remedy in REASONS.values())
