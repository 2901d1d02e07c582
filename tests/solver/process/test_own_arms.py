"""Turns on arms unlike the simulator's, beside kinematics and a balance of springs written for these tests.

The product of exponentials and the balance share no code with the solver or the simulator.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.process_paths import process_path
from support.slides import arm_on_rail, scara
from support.springs import robot_of

from jointstiff.simulator import SpringArm, default_arm
from jointstiff.solver.errors import RequestError, RobotError
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.process.pace import Pace
from jointstiff.solver.process.turning import TurnTask, choose_turns

X, Y, Z = np.eye(3)
BASE = default_arm()
TURNING = np.radians([(-370, 370), (-100, 100), (-150, 150), (-720, 720), (-350, 350), (-720, 720)])
COBOT = SpringArm(
    axis_points=np.array(
        [[0, 0, 0], [0, 0, 0.18], [0, 0, 0.79], [0, 0, 1.36], [0, 0.17, 1.36], [0, 0.17, 1.48]]
    ),
    axis_directions=np.array([Z, Y, Y, Y, Z, Y]),
    flange_rotation=np.column_stack([X, -Z, Y]),
    flange_translation=np.array([0.0, 0.29, 1.48]),
    stiffnesses=np.array([9e4, 9e4, 6e4, 2e4, 2e4, 1.5e4]),
    limits=np.radians([(-360, 360)] * 6),
)
"""An arm whose wrist is offset: its axes 2, 3 and 4 are parallel."""
ARMS = {
    "limits of several turns": (replace(BASE, limits=TURNING), [1.7, 0.0, 0.8], 1.0),
    "offset wrist": (COBOT, [0.6, 0.0, 0.4], 0.2),
    "rail": (arm_on_rail(), [1.7, 1.3, 0.8], 1.0),
}
TOOLS = {
    "far off axis 6": (90.0, (0.5, 0.2, 0.3)),
    "opposite to axis 6": (180.0, (0.1, 0.0, 0.3)),
    "backwards": (135.0, (0.3, -0.3, 0.2)),
}
"""Angle of the spindle to the last axis [deg], and centre of the tool in the flange frame [m]."""


def task_of(p, turns, clearance=0.04, **options):
    """A free turn at 50 mm/s, for joints whose speeds nobody states."""
    joints = p.given.shape[1]
    pace = Pace(np.full(len(p), 0.05), np.full(joints, np.nan), np.radians(3.0) * 1e3)
    return TurnTask.free(turns, clearance, pace, **options)


def needed(choice, p):
    """Motions of the joints for a length of the path [°/mm]."""
    return np.degrees(np.abs(np.diff(choice.joints, axis=0)) / p.steps[1:, None]) * 1e-3


def place_flange(arm, q):
    """Rotation (3, 3), origin (3,) [m] of the flange in R0, and axes and points of the joints."""
    rotation, origin, joints = np.eye(3), np.zeros(3), []
    for j, angle in enumerate(q):
        axis, point = rotation @ arm.axis_directions[j], rotation @ arm.axis_points[j] + origin
        joints.append((axis, point, j in arm.prismatic))
        if j in arm.prismatic:
            origin = origin + angle * axis
        else:
            turn = Rotation.from_rotvec(angle * axis).as_matrix()
            rotation, origin = turn @ rotation, point + turn @ (origin - point)
    return (
        rotation @ arm.flange_rotation,
        rotation @ arm.flange_translation + origin,
        joints,
    )


def balance(arm, q, force, moment, load_point):
    """Motions (n,) of the joints [rad or m] with which springs carry a dead load, by Newton's method."""

    def lack(bent):
        rotation, origin, joints = place_flange(arm, q + bent)
        lever = rotation @ load_point + origin
        torque = [
            axis @ force if slides else axis @ (np.cross(lever - point, force) + moment)
            for axis, point, slides in joints
        ]
        return bent - np.array(torque) / arm.stiffnesses

    bent, h = np.zeros(len(q)), 1e-5
    for _ in range(30):
        error = lack(bent)
        if np.abs(error).max() < 1e-15:
            return bent
        slope = [(lack(bent + h * each) - lack(bent - h * each)) / (2.0 * h) for each in np.eye(len(q))]
        bent = bent - np.linalg.solve(np.column_stack(slope), error)
    raise AssertionError("no balance was found")


def set_up(name, tool, shape, *, count=14):
    """An arm with its model, inverse kinematics and a path."""
    arm, centre, scale = ARMS[name]
    angle, offset = TOOLS[tool]
    n = len(arm.stiffnesses)
    p = process_path(
        shape,
        np.array(centre),
        count=count,
        angle=np.radians(angle),
        offset=tuple((0.3 if name == "offset wrist" else 1.0) * np.array(offset)),
        joints=n,
        force=scale * np.array([-150.0, -300.0, -120.0]),
    )
    p = replace(p, moment=20.0 * scale * np.random.default_rng(1).normal(size=(count, 3)))
    robot = robot_of(arm)
    fixed = np.array([1.3, *np.zeros(6)]) if name == "rail" else None
    model = JointModel(robot, arm.compliances, None, Constraints(Bounds.positive(n)))
    return arm, model, InverseKinematics(robot, fixed), p


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize(("shape", "greatest"), [("trim", False), ("pocket", True)])
def test_what_is_foretold_is_the_balance_and_what_is_promised_is_kept(name, tool, shape, greatest):
    arm, model, inverse, p = set_up(name, tool, shape)
    clearance = 0.02 if name == "offset wrist" else 0.04
    task = task_of(p, 24, clearance, greatest=greatest)
    if (name, tool) == ("rail", "opposite to axis 6"):
        with pytest.raises(RequestError, match="exceed the joints' limits"):
            choose_turns(model, inverse, p, task)
        return
    choice = choose_turns(model, inverse, p, task)
    lengths = []
    for i, q in enumerate(choice.joints):
        rotation, origin, _ = place_flange(arm, q)
        tip = rotation @ p.place[i] + origin
        np.testing.assert_allclose(tip, p.centres[i], rtol=0, atol=1e-9)
        np.testing.assert_allclose(rotation @ p.spindle[i], p.axes[i], rtol=0, atol=1e-9)
        bent = balance(arm, q, p.force[i], p.moment[i], p.load_point[i])
        rotation, origin, _ = place_flange(arm, q + bent)
        lengths.append(np.linalg.norm(rotation @ p.place[i] + origin - tip))
    found = model.deflect(p.cases(np.arange(len(p)), choice.joints)).displacement
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), lengths, rtol=0, atol=1e-8)
    size = max(lengths) if greatest else np.sqrt(p.weights @ np.square(lengths))
    assert choice.size == pytest.approx(size, abs=1e-8)
    assert choice.size <= choice.fixed.min() * (1.0 + 1e-3)
    assert (choice.joints >= arm.limits[:, 0]).all()
    assert (choice.joints <= arm.limits[:, 1]).all()
    assert needed(choice, p).max() <= 3.0 * (1.0 + 1e-6)


def test_joints_pass_half_a_turn_without_a_jump():
    """A contour around which the wrist turns past ±180°: angles go on, as the controller counts them."""
    _, model, inverse, p = set_up("limits of several turns", "backwards", "pocket", count=30)
    task = task_of(p, 36)
    choice = choose_turns(model, inverse, p, task)
    assert needed(choice, p).max() <= 3.0 * (1.0 + 1e-6)
    everywhere = np.arange(len(p))
    poses = p.turn(everywhere, np.full(len(p), choice.turn[0]))  # so that the given posture is not turned
    beyond = replace(p, poses=poses, given=p.given.copy())
    beyond.given[0] = choice.joints[0] + 2.0 * np.pi * np.sign(0.0 - choice.joints[0]) * (np.arange(6) == 5)
    again = choose_turns(model, inverse, beyond, task)
    assert needed(again, p).max() <= 3.0 * (1.0 + 1e-6)
    assert np.abs(again.joints[1, 5] - choice.joints[1, 5]) > np.pi, "the path goes on in the other turn"
    assert again.size == pytest.approx(choice.size, rel=0.05)


def follow(arm, place, start, ends):
    """Joints (10, 6) along a line of the tool's centre, with one turn of the tool, by Newton's method."""
    (r0, t0, _), (r1, t1, _) = (place_flange(arm, each) for each in (start, ends))
    turn, tips = Rotation.from_matrix(r0.T @ r1).as_rotvec(), (r0 @ place + t0, r1 @ place + t1)
    q, found = start.copy(), []
    for part in np.linspace(0.1, 1.0, 10):
        rotation = r0 @ Rotation.from_rotvec(part * turn).as_matrix()
        origin = (1.0 - part) * tips[0] + part * tips[1] - rotation @ place
        for _ in range(30):
            r, t, joints = place_flange(arm, q)
            gap = np.append(origin - t, Rotation.from_matrix(rotation @ r.T).as_rotvec())
            columns = [np.append(np.cross(axis, t - point), axis) for axis, point, _ in joints]
            q = q + np.linalg.solve(np.column_stack(columns), gap)
            if np.abs(gap).max() < 1e-12:
                break
        found.append(q)
    np.testing.assert_allclose(q, ends, rtol=0, atol=1e-8)
    return np.array(found)


def test_limits_are_kept_between_points_where_the_controller_interpolates():
    """Limits are narrowed to the points of a path of few points, so that its joints pass them between."""
    beyond = followed = 0
    for yaw in (0.0, 1.5, 3.0, 4.5):
        p = process_path("pocket", np.array([1.7, 0.2, 0.8]), count=10, yaw=yaw)
        task = task_of(p, 36, corrects=False)
        model = JointModel(robot_of(BASE), BASE.compliances, None, Constraints(Bounds.positive(6)))
        loose = choose_turns(model, InverseKinematics(model.robot), p, task)
        limits = np.column_stack([loose.joints.min(axis=0) - 1e-6, loose.joints.max(axis=0) + 1e-6])
        narrow = replace(BASE, limits=limits)
        lines = [follow(BASE, p.place[i], *loose.joints[i : i + 2]) for i in range(len(p) - 1)]
        beyond += any((each < limits[:, 0]).any() or (each > limits[:, 1]).any() for each in lines)
        model = JointModel(robot_of(narrow), BASE.compliances, None, Constraints(Bounds.positive(6)))
        try:
            choice = choose_turns(model, InverseKinematics(model.robot), p, task)
        except RequestError:
            continue
        followed += 1
        for i in range(len(p) - 1):
            line = follow(BASE, p.place[i], *choice.joints[i : i + 2])
            assert (line >= limits[:, 0] - 1e-4).all()
            assert (line <= limits[:, 1] + 1e-4).all()
    assert beyond
    assert followed


@pytest.mark.parametrize("count", [1, 2, 1_000])
def test_paths_of_one_point_and_of_a_thousand(count):
    arm, model, inverse, p = set_up("rail", "far off axis 6", "blade", count=40)
    at = np.linspace(0, 39, count).round().astype(int)  # points repeat: the tool rests
    names = ("poses", "spindle", "place", "load_point", "force", "moment", "given")
    long = replace(p, continuous=np.arange(count) > 0, **{name: getattr(p, name)[at] for name in names})
    choice = choose_turns(model, inverse, long, task_of(long, 12))
    assert np.isfinite(choice.size)
    assert choice.size <= choice.fixed.min() * (1.0 + 1e-3)
    rests = long.steps[1:] == 0.0
    np.testing.assert_array_equal(np.diff(choice.joints, axis=0)[rests], 0.0)
    assert len(arm.stiffnesses) == choice.joints.shape[1]


def test_a_path_into_a_singularity_is_refused_or_keeps_its_distance():
    """The wrist stretches along a line on which the program's turn meets the singularity of axes 4 and 6."""
    robot = robot_of(BASE)
    inverse = InverseKinematics(robot)
    model = JointModel(robot, BASE.compliances, None, Constraints(Bounds.positive(6)))
    p = process_path("trim", np.array([1.7, 0.0, 0.8]), count=15, angle=np.pi / 2, offset=(0.1, 0.0, 0.3))
    angles = np.radians(np.column_stack([np.zeros((15, 4)), np.linspace(-14.0, 14.0, 15), np.zeros(15)]))
    angles[:, 1:3] = np.radians([10.0, 20.0])
    angles[:, 3] = np.radians(30.0)
    poses = np.tile(np.eye(4), (15, 1, 1))
    for i, q in enumerate(angles):
        poses[i, :3, :3], poses[i, :3, 3], _ = place_flange(BASE, q)
    line = replace(p, poses=poses)
    kept = replace(task_of(line, 36), angles=np.zeros(1))
    with pytest.raises(RequestError, match=r"singularity|moves by at least"):
        choose_turns(model, inverse, line, kept)
    choice = choose_turns(model, inverse, line, task_of(line, 36))
    for i, q in enumerate(choice.joints):
        _, origin, joints = place_flange(BASE, q)
        jacobian = [np.concatenate([np.cross(axis, origin - point), axis]) for axis, point, _ in joints]
        assert np.linalg.svd(np.array(jacobian), compute_uv=False)[-1] >= 0.04 * (1.0 - 1e-9), i
    assert needed(choice, line).max() <= 3.0 * (1.0 + 1e-6)


@pytest.mark.parametrize(
    ("arm", "reason"),
    [
        (scara(), "3 revolute joints"),
        (default_arm(wrist_offset=0.08), "no closed-form inverse kinematics"),
    ],
)
def test_arms_that_cannot_be_turned_say_why(arm, reason):
    with pytest.raises(RobotError, match=reason):
        InverseKinematics(robot_of(arm))
