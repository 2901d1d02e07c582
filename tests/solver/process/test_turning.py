"""Turns along a path beside exact springs, all sequences, and what may never happen."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.campaigns import prepare
from support.catalogue_arms import build_nominal_robots
from support.process_paths import FORCE, SHAPES, process_path, reach_centre, spindle_at, spiral
from support.slides import arm_on_rail
from support.springs import robot_of

from jointstiff.schemas.options import CrossValidation
from jointstiff.simulator import default_arm, equilibrium
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign
from jointstiff.solver.choice.held_out import Folds
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.problem import Bounds, Constraints
from jointstiff.solver.fit.reduced import Candidate
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import Postures, flange_poses
from jointstiff.solver.models import Columns, find_model
from jointstiff.solver.predict.models import ElasticPredictor, JointModel
from jointstiff.solver.process.blend import blend_loads
from jointstiff.solver.process.candidates import find_branches, list_candidates
from jointstiff.solver.process.deflection import PathDeflection
from jointstiff.solver.process.inspection import Inspector
from jointstiff.solver.process.knots import find_knots, find_spacing
from jointstiff.solver.process.pace import Pace
from jointstiff.solver.process.path import apply_feed_frames, find_feed_frames
from jointstiff.solver.process.prior import build_prior_model
from jointstiff.solver.process.sequence import LineLimits, Trellis
from jointstiff.solver.process.turning import Lattice, TurnTask, choose_turns

ARM = default_arm()
ROBOT = robot_of(ARM)
POSITIVE = Constraints(Bounds.positive(6))
MODEL = JointModel(ROBOT, ARM.compliances, None, POSITIVE)
INVERSE = InverseKinematics(ROBOT)
STEP = np.radians(20.0)
SPEEDS = np.radians([123.0, 115.0, 112.0, 179.0, 172.0, 219.0])


def task(count, turns=36, feed=0.05, greatest=False, speeds=SPEEDS):
    return TurnTask.free(turns, 0.04, Pace(np.full(count, feed), speeds), greatest=greatest)


def step_limits(candidates, p, step=STEP):
    """Limits by which each joint, and the turn, may move by a step from point to point."""
    count = len(p)
    limits = np.full((count, candidates.angles.shape[1]), step)
    return LineLimits(limits, np.full(count, 2.0 * np.pi), np.full(count, 1.0))


TASK = task(40)
CENTRE = np.array([1.7, 0.0, 0.8])


def path(shape="pocket", **options):
    return process_path(shape, CENTRE, **options)


def exact_lengths(arm, p, joints):
    """Distance [m] by which exact springs let the tool go from where it is without load."""
    turn = equilibrium(arm, joints, p.force, p.moment, p.load_point)
    ends = (arm.posture(at).point_to_base(p.place) for at in (joints, joints + turn))
    before, after = ends
    return np.linalg.norm(after - before, axis=1)


@pytest.mark.parametrize("shape", SHAPES)
def test_deflection_along_the_turned_path_is_that_of_the_exact_balance(shape):
    p = path(shape)
    choice = choose_turns(MODEL, INVERSE, p, task(len(p)))
    exact = exact_lengths(ARM, p, choice.joints)
    foretold = np.linalg.norm(MODEL.deflect(p.cases(np.arange(40), choice.joints)).displacement, axis=1)
    np.testing.assert_allclose(foretold, exact, rtol=0, atol=1e-8)
    assert choice.size == pytest.approx(np.sqrt(p.weights @ exact**2), abs=1e-8)


@pytest.mark.parametrize("shape", SHAPES)
def test_tool_and_spindle_stay_on_the_path_whatever_the_turn(shape):
    p = path(shape)
    choice = choose_turns(MODEL, INVERSE, p, task(len(p)))
    at = Postures(ROBOT, choice.joints)
    np.testing.assert_allclose(at.to_base(p.place[:, None])[:, 0], p.centres, rtol=0, atol=1e-9)
    np.testing.assert_allclose((at.flange_rotation @ p.spindle[..., None])[..., 0], p.axes, rtol=0, atol=1e-9)
    expected = p.turn(np.arange(len(p)), choice.turn)
    np.testing.assert_allclose(at.flange_pose, expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("degrees", "is_beyond"), [(90.0, False), (150.0, False), (200.0, True), (360.0, True)]
)
def test_a_line_on_which_the_controller_turns_the_tool_the_other_way_is_left(degrees, is_beyond):
    """Between two points a controller turns the tool by less than half a turn, whatever joint 6 would do."""
    limits = np.radians([(-370, 370), (-100, 100), (-150, 150), (-720, 720), (-350, 350), (-720, 720)])
    robot = robot_of(replace(ARM, limits=limits))
    model = JointModel(robot, ARM.compliances, None, POSITIVE)
    start = np.array([0.1, -0.2, 0.3, 0.4, 0.8, 0.2])
    joints = np.array([start, start + np.radians([0.0, 0.0, 0.0, 0.0, 0.0, degrees])])
    p = path(count=2)
    p = replace(p, poses=flange_poses(robot, joints), force=0.0 * p.force)
    found = Inspector(model, InverseKinematics(robot), p, 0.0, corrects=False).inspect(joints, np.zeros(2))
    assert found.beyond.tolist() == [False, is_beyond]


def test_the_need_of_a_line_is_that_of_its_fastest_place():
    """A motion along lines of 2 mm, which the joints are followed on at every 0.02 mm."""
    count, parts = 30, 100
    centres = np.column_stack([2e-3 * np.arange(count), np.zeros((count, 2))])
    p = process_path("blade", CENTRE, count=count)
    p = replace(p, poses=p.poses.copy())
    p.poses[:, :3, :3] = p.poses[0, :3, :3]
    p.poses[:, :3, 3] = p.poses[0, :3, 3] + centres
    turn = 0.1 * np.sin(np.linspace(0.0, 6.0, count))
    start, _ = INVERSE.solve(p.turn(np.array([0]), turn[:1]))
    near = next(each for each in start[0] if np.isfinite(each).all())
    q, reached = INVERSE.refine(p.turn(np.arange(count), turn), np.tile(near, (count, 1)))
    assert reached.all()
    motion = Inspector(MODEL, INVERSE, p, 1e-3, corrects=False).inspect(q, turn).motion[1:]
    owner, t = np.repeat(np.arange(count - 1), parts), np.tile(np.arange(parts) / parts, count - 1)
    at = p.turn(np.arange(count), turn)
    change = Rotation.from_matrix(at[1:, :3, :3] @ at[:-1, :3, :3].transpose(0, 2, 1)).as_rotvec()
    rotation = Rotation.from_rotvec(t[:, None] * change[owner]).as_matrix() @ at[owner, :3, :3]
    centre = p.centres[owner] + t[:, None] * np.diff(p.centres, axis=0)[owner]
    poses = np.tile(np.eye(4), (len(owner), 1, 1))
    poses[:, :3, :3] = rotation
    poses[:, :3, 3] = centre - (rotation @ p.place[owner][..., None])[..., 0]
    fine, _ = INVERSE.refine(poses, q[owner])
    fine = np.vstack([fine, q[-1:]])
    true = (np.abs(np.diff(fine, axis=0)) / (2e-3 / parts)).reshape(count - 1, parts, 6).max(axis=1)
    assert (motion >= (1.0 - 1e-3) * true).all()
    assert (motion <= 1.01 * true + 1e-3).all()


def test_dynamic_programming_finds_the_best_of_all_sequences():
    """Every sequence of a short path with few turns is tried by hand."""
    p = path(count=4)
    angles = np.radians([0.0, 15.0, 30.0])
    candidates = list_candidates(MODEL, INVERSE, p, angles, 0.04)
    trellis = Trellis.link(candidates, angles, p.continuous, step_limits(candidates, p))
    value = np.square(candidates.size) / np.square(candidates.size).mean()
    found = trellis.find_best(value)
    greatest = trellis.find_best(value, greatest=True)
    least, least_greatest = np.inf, np.inf
    for rows in product(*(range(each.start, each.stop) for each in trellis.rows)):
        joints, side = candidates.joints[list(rows)], candidates.side[list(rows)]
        if np.abs(np.diff(joints, axis=0)).max() > STEP or (np.diff(side) != 0).any():
            continue
        turns = angles[candidates.turn[list(rows)]]
        total = value[list(rows)].sum() + 1e-4 * np.square(np.diff(turns)).sum()
        least, least_greatest = min(least, total), min(least_greatest, value[list(rows)].max())
    turns = angles[candidates.turn[found]]
    assert value[found].sum() + 1e-4 * np.square(np.diff(turns)).sum() == pytest.approx(least, rel=1e-12)
    assert value[greatest].max() == pytest.approx(least_greatest, rel=1e-12)


def draws(count, seed=3):
    """Random arms of the catalogue, shapes, places and spindles."""
    draw = np.random.default_rng(seed)
    robots = [each.robot for each in build_nominal_robots() if (each.robot.payload or 0) > 100]
    for _ in range(count):
        robot = robots[draw.integers(len(robots))]
        place = reach_centre(robot, draw.uniform(0.5, 0.75), draw.uniform(0.1, 0.4), draw.uniform(-0.3, 0.3))
        yield (
            robot,
            process_path(
                draw.choice(list(SHAPES)),
                place,
                yaw=draw.uniform(0.0, 2 * np.pi),
                count=int(draw.integers(8, 16)),
                angle=float(draw.choice([np.pi / 4, np.pi / 2])),
            ),
        )


@pytest.mark.parametrize("greatest", [False, True])
def test_limits_speeds_and_rate_are_kept_and_no_fixed_turn_is_better(greatest):
    """On random arms and paths."""
    found = 0
    for robot, p in draws(12):
        stated = task(len(p), 18, greatest=greatest, speeds=robot.speeds)
        model = build_prior_model(robot)
        try:
            choice = choose_turns(model, InverseKinematics(robot), p, stated)
        except RequestError:
            continue
        found += 1
        q = robot.joint_map.model_angles(choice.joints)
        assert (q >= robot.limits[:, 0]).all()
        assert (q <= robot.limits[:, 1]).all()
        assert choice.size <= choice.fixed.min() * (1.0 + 1e-3) * (1.0 + 1e-3)
        steps = np.linalg.norm(np.diff(p.centres, axis=0), axis=1)
        speed = np.abs(np.diff(q, axis=0)) / steps[:, None] * 0.05
        assert stated.pace.shares(choice.motion).max() <= 0.5 * (1.0 + 1e-6)
        assert (speed <= 0.5 * np.where(np.isnan(robot.speeds), np.inf, robot.speeds)).all()
        assert (np.abs(np.diff(choice.turn)) <= np.radians(1.0) * 1e3 * steps * (1.0 + 1e-6)).all()
        lengths = np.linalg.norm(
            model.deflect(p.cases(np.arange(len(p)), choice.joints)).displacement, axis=1
        )
        own = lengths.max() if greatest else np.sqrt(p.weights @ lengths**2)
        assert choice.size == pytest.approx(own, rel=1e-12)
    assert found >= 6


@pytest.mark.parametrize(
    ("shape", "seed"), [("pocket", 3), ("blade", 4), ("pocket", 6), ("trim", 11), ("blade", 13)]
)
def test_no_fixed_turn_is_better_where_the_knots_do_not_show_the_force(shape, seed):
    """Forces at the knots are those of no other point, so that deflections there err differently by turn."""
    p = path(shape, count=400)
    stated = task(400, 72, feed=0.2)
    knots = find_knots(p, find_spacing(p, stated.pace, stated.step), np.arange(400))
    p.force[knots] += np.random.default_rng(seed).normal(0.0, 200.0, 3)
    choice = choose_turns(MODEL, INVERSE, p, stated)
    assert choice.size <= choice.fixed.min() * (1.0 + 1e-9)


def test_the_choice_does_not_depend_on_how_densely_a_path_is_sampled():
    sizes = []
    for count in (121, 601, 2401):
        p = path(count=count)
        sizes.append(choose_turns(MODEL, INVERSE, p, task(count)).size)
    assert max(sizes) <= 1.01 * min(sizes)


@pytest.mark.parametrize("shape", SHAPES)
def test_another_route_is_far_from_the_best_one_halfway_and_keeps_the_rate(shape):
    p = path(shape)
    asked = task(len(p))
    knots = find_knots(p, find_spacing(p, asked.pace, asked.step), np.arange(len(p)))
    lattice = Lattice.build(MODEL, INVERSE, p, asked, np.arange(len(p)), knots)
    best = lattice.find_free()
    other = lattice.find_other(best)
    assert lattice.measure(other) >= lattice.measure(best)
    lengths = p.lengths[knots]
    halfway = np.argmin(np.abs(lengths - 0.5 * lengths[-1]))
    difference = lattice.turns(other)[halfway] - lattice.turns(best)[halfway]
    assert np.cos(difference) < np.cos(np.radians(44.9))
    turned = np.abs(np.diff(lattice.turns(other)))
    assert (turned <= asked.pace.rate * np.diff(lengths) * (1.0 + 1e-9)).all()


def test_of_two_routes_that_are_nearly_as_good_at_the_knots_the_better_smooth_one_is_followed(monkeypatch):
    """The programmed turn decides which route is better at the knots, and must not decide the choice."""
    monkeypatch.setitem(SHAPES, "spiral", spiral)
    robot = next(each.robot for each in build_nominal_robots() if each.name == "KUKA KR 210 R2700 extra")
    factors = np.array([1.26176483, 1.41170377, 0.69027273, 1.8400706, 1.83034005, 1.52330591])
    model = JointModel(robot, factors * build_prior_model(robot).compliance, None, POSITIVE)
    centre = np.array([1.48, -0.03, 0.33])
    p = process_path("spiral", centre, yaw=2.0, count=637, force=np.array([-150.0, 350.0, -120.0]))
    sizes = []
    for turn in np.radians([0.0, 5.0]):
        turned = replace(p, poses=p.turn(np.arange(637), np.full(637, turn)))
        stated = task(637, feed=0.05, speeds=robot.speeds)
        sizes.append(choose_turns(model, InverseKinematics(robot), turned, stated).size)
    assert max(sizes) <= 1.01 * min(sizes)


def corrected_shares(model, p, joints, pace):
    """Parts (m - 1, n) of the joints' speeds that the corrected targets need, by their means on each line."""
    q, cases = model.robot.joint_map.model_angles(joints), p.cases(np.arange(len(p)), joints)
    blend = blend_loads(model, cases, p.continuous, pace.limits())
    loads = cases if blend is None else blend.cases
    commanded = model.compute_commands(loads, Postures(model.robot, q), np.ones(len(p)))
    centres = Postures(model.robot, commanded).to_base(p.place[:, None])[:, 0]
    lengths = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    speed = np.abs(np.diff(commanded, axis=0)) / lengths[:, None] * pace.feed[1:, None]
    return speed / pace.speeds


@pytest.mark.parametrize(("yaw", "low", "high"), [(1.4, -30.0, 0.0), (4.9, 0.0, 30.0)])
def test_corrected_joints_keep_half_of_their_speeds_where_the_turn_is_at_its_limit(yaw, low, high):
    """A soft arm, at a feed at which turn zero needs 0.4995 of a joint's speed, and 0.5036 as corrected."""
    model = JointModel(ROBOT, 4.0 * ARM.compliances, None, POSITIVE)
    p = path(count=60, yaw=yaw, force=np.array([-150.0, 350.0, -120.0]))
    slow = Pace(np.full(60, 0.05), SPEEDS)
    zero = choose_turns(model, INVERSE, p, TurnTask(np.zeros(1), 0.04, slow))
    pace = Pace(slow.feed * 0.4995 / slow.shares(zero.motion).max(), SPEEDS)
    assert corrected_shares(model, p, zero.joints, pace).max() > 0.503
    choice = choose_turns(model, INVERSE, p, TurnTask.within(*np.radians([low, high]), 36, 0.04, pace))
    assert pace.shares(choice.motion).max() <= 0.5 * (1.0 + 1e-6)
    assert corrected_shares(model, p, choice.joints, pace).max() <= 0.5 * (1.0 + 1e-3)
    assert choice.size < zero.size


def test_a_faster_feed_turns_less_and_keeps_the_joints_below_half_of_their_speeds():
    p = path(count=400)
    choices = [choose_turns(MODEL, INVERSE, p, task(400, feed=feed)) for feed in (0.05, 0.4)]
    assert choices[0].size < choices[1].size
    for feed, choice in zip((0.05, 0.4), choices, strict=True):
        speed = feed * np.abs(np.diff(choice.joints, axis=0)) / p.steps[1:, None]
        assert (speed <= 0.5 * SPEEDS * (1.0 + 1e-6)).all()


def test_without_a_feed_neither_tool_nor_joints_turn_faster_than_the_rate():
    p = path(count=400)
    for rate in (1.0, 0.3):
        pace = Pace(np.full(400, np.nan), SPEEDS, np.radians(rate) * 1e3)
        choice = choose_turns(MODEL, INVERSE, p, replace(task(400), pace=pace))
        needed = np.degrees(np.abs(np.diff(choice.joints, axis=0)) / p.steps[1:, None]) * 1e-3
        assert needed.max() <= rate * (1.0 + 1e-6)
        assert choice.size < choice.fixed.min()


def test_a_path_that_is_too_fast_is_followed_and_its_need_is_known():
    """Points of 0.1 s: at 4 m/s no turn keeps the joints below half of their speeds."""
    p = path(count=200)
    stated = task(200, feed=4.0)
    choice = choose_turns(MODEL, INVERSE, p, stated)
    speed = 4.0 * np.abs(np.diff(choice.joints, axis=0)) / p.steps[1:, None] / SPEEDS
    assert stated.pace.shares(choice.motion).max() == pytest.approx(speed.max(), rel=0.02)
    assert speed.max() > 0.5


def test_a_spindle_along_the_last_axis_gains_nothing():
    choice = choose_turns(MODEL, INVERSE, path(angle=0.0, offset=(0.0, 0.0, 0.3)), TASK)
    assert not choice.gains
    np.testing.assert_array_equal(choice.turn, 0.0)  # so the tool is not turned
    assert choice.fixed.max() == pytest.approx(choice.fixed.min(), rel=1e-6)
    assert choose_turns(MODEL, INVERSE, path(), TASK).gains


def test_a_spindle_along_the_last_axis_but_beside_it_gains():
    """The tool's centre off the axis moves the wrist when it turns."""
    assert choose_turns(MODEL, INVERSE, path(angle=0.0, offset=(0.3, 0.0, 0.3)), TASK).gains


def test_turns_stay_in_the_range_that_is_stated():
    low, high = np.radians([-25.0, 40.0])
    stated = TurnTask.within(low, high, 36, 0.04, TASK.pace)
    choice = choose_turns(MODEL, INVERSE, path(), stated)
    assert choice.turn.min() >= low - 1e-12
    assert choice.turn.max() <= high + 1e-12
    assert 0.0 in stated.angles
    assert choice.size >= choose_turns(MODEL, INVERSE, path(), TASK).size


def test_a_point_out_of_reach_is_named():
    p = path()
    far = replace(p, poses=p.poses + 0.0)
    far.poses[7, 0, 3] += 9.0
    with pytest.raises(RequestError, match="point 8 of the path: the robot does not reach the point"):
        choose_turns(MODEL, INVERSE, far, TASK)


def test_a_target_that_is_visited_again_has_one_posture():
    p = path("pocket", count=24)
    first = np.arange(24)
    first[23] = 0  # the contour ends where it began
    free = choose_turns(MODEL, INVERSE, p, task(len(p)))
    same = choose_turns(MODEL, INVERSE, p, task(len(p)), first)
    np.testing.assert_array_equal(same.joints[0], same.joints[23])
    assert same.size >= free.size
    assert same.size <= same.fixed.min() * (1.0 + 1e-3)


def list_postures(candidates, point):
    """Yield masks of the candidates if a point, and the last one, have one of the point's postures."""
    ends = np.isin(candidates.point, [point, candidates.point[-1]])
    for k in np.flatnonzero(candidates.point == point):
        yield ~ends | (candidates.joints == candidates.joints[k]).all(axis=1)


@pytest.mark.parametrize("greatest", [False, True])
@pytest.mark.parametrize(("angle", "yaw", "step"), [(45, 0.3, 30), (90, 2.0, 30), (90, 4.0, 20)])
def test_a_closed_contour_has_the_best_of_all_sequences_that_close(greatest, angle, yaw, step):
    """Beside the best sequence of each posture in which the contour may begin and end."""
    p = path("pocket", count=12, angle=np.radians(angle), yaw=yaw)
    first = np.append(np.arange(11), 0)
    angles = task(12, 18).angles
    candidates = list_candidates(MODEL, INVERSE, p, angles, 0.04)
    limits = step_limits(candidates, p, np.radians(step))
    trellis = Trellis.link(candidates, angles, p.continuous, limits)
    value = np.square(candidates.size) / np.square(candidates.size).mean()
    least = np.inf
    for kept in list_postures(candidates, 0):
        part = trellis.restrict(kept)
        rows = part.find_best(value[kept], greatest=greatest)
        if rows is not None:
            least = min(least, part.total(value[kept], rows, greatest=greatest))
    found = trellis.find_consistent(value, first, greatest=greatest)
    assert np.isfinite(least)
    np.testing.assert_array_equal(candidates.joints[found[0]], candidates.joints[found[-1]])
    assert trellis.total(value, found, greatest=greatest) == pytest.approx(least, rel=1e-12)
    bound = trellis.least_through(value, greatest=greatest)
    best = trellis.find_best(value, greatest=greatest)
    np.testing.assert_allclose(bound[best], bound.min(), rtol=1e-9)


def test_many_targets_that_are_visited_again_have_one_posture_each(monkeypatch):
    """A contour that is milled twice, also where no trials are left."""
    once = path("pocket", count=10)
    p = replace(
        once,
        **{
            name: np.concatenate([getattr(once, name)] * 2)
            for name in ("poses", "spindle", "place", "load_point", "force", "moment", "given")
        },
        continuous=np.arange(20) > 0,
    )
    first = np.tile(np.arange(10), 2)
    choice = choose_turns(MODEL, INVERSE, p, task(len(p)), first)
    np.testing.assert_array_equal(choice.joints[:10], choice.joints[10:])
    assert choice.size <= choice.fixed.min() * (1.0 + 1e-3)
    monkeypatch.setattr("jointstiff.solver.process.sequence.MOST_TRIALS", 0)
    again = choose_turns(MODEL, INVERSE, p, task(len(p)), first)
    np.testing.assert_array_equal(again.joints[:10], again.joints[10:])
    assert again.size >= choice.size * (1.0 - 1e-9)


def test_joints_that_are_given_stay_and_a_free_motion_may_change_the_branch():
    p = path("trim", count=12)
    start = np.radians([0.0, -20.0, 20.0, 0.0, 40.0, 0.0])
    given = p.given.copy()
    given[0] = start
    continuous = p.continuous.copy()
    continuous[[0, 1]] = False
    fixed = replace(
        p, given=given, continuous=continuous, force=np.where(np.arange(12)[:, None], p.force, 0.0)
    )
    choice = choose_turns(MODEL, INVERSE, fixed, task(12))
    np.testing.assert_allclose(choice.joints[0], start, rtol=0, atol=1e-12)
    assert np.isnan(choice.turn[0])
    assert np.isfinite(choice.turn[1:]).all()
    speed = 0.05 * np.abs(np.diff(choice.joints[1:], axis=0)) / p.steps[2:, None]
    assert (speed <= 0.5 * SPEEDS).all()


def test_postures_along_a_motion_without_singularity_have_one_branch_and_solutions_differ():
    """Of a spherical wrist and of three parallel axes; all solutions of a pose have different numbers."""
    for each in build_nominal_robots():
        if each.name not in {"KUKA KR 210 R2700 extra", "FANUC R-2000iC/165F", "Universal Robots UR10e"}:
            continue
        robot, inverse = each.robot, InverseKinematics(each.robot)
        start = np.radians([10.0, -70.0, 80.0, 20.0, 50.0, 30.0])
        solutions, _ = inverse.solve(flange_poses(robot, start[None]))
        solutions = solutions[0][np.isfinite(solutions[0, :, 0])]
        numbers = find_branches(inverse, Postures(robot, solutions))
        assert len(set(numbers.tolist())) == len(numbers) > 1
        line = start + np.linspace(0.0, 1.0, 30)[:, None] * np.radians([40.0, 5.0, 10.0, 90.0, 30.0, -200.0])
        regular = np.linalg.det(Postures(robot, line).jacobian)
        if (np.sign(regular) == np.sign(regular[0])).all():
            assert len(set(find_branches(inverse, Postures(robot, line)).tolist())) == 1


def test_a_path_that_keeps_its_branch_has_only_postures_of_it():
    p = path("trim", count=10)
    free = choose_turns(MODEL, INVERSE, p, task(len(p)))
    near = np.repeat(free.best_fixed[:1], 10, axis=0)
    kept = choose_turns(MODEL, INVERSE, replace(p, near=near), task(10))
    numbers = find_branches(INVERSE, Postures(ROBOT, kept.joints))
    assert set(numbers.tolist()) == set(find_branches(INVERSE, Postures(ROBOT, near)).tolist())
    assert np.abs(kept.joints[0] - near[0]).max() <= np.pi


def test_feed_frames_follow_the_path_and_a_feed_along_the_axis_has_none():
    t = np.linspace(0.0, 1.5, 30)
    centres = np.column_stack([np.cos(t), np.sin(t), 0.0 * t])
    down = np.tile([0.0, 0.0, -1.0], (30, 1))
    frames = find_feed_frames(centres, down, np.arange(30) > 0)
    tangent = np.column_stack([-np.sin(t), np.cos(t), 0.0 * t])
    np.testing.assert_allclose(frames[1:-1, :, 0], tangent[1:-1], atol=1e-12)
    # Seen from the spindle, above, the normal points to the right: outward on a turn to the left.
    np.testing.assert_allclose(frames[1:-1, :, 1], centres[1:-1], atol=1e-12)
    drilled = find_feed_frames(np.outer(t, [0.0, 0.0, -1.0]), down, np.arange(30) > 0)
    along = apply_feed_frames(drilled, np.tile([0.0, 0.0, -100.0], (30, 1)), "axes")
    np.testing.assert_allclose(along, np.tile([0.0, 0.0, 100.0], (30, 1)))
    with pytest.raises(RequestError, match="no direction of feed"):
        apply_feed_frames(drilled, np.tile(FORCE, (30, 1)), "axes")


def test_the_spindle_of_the_test_is_where_it_says():
    assert spindle_at(np.pi / 2) == pytest.approx([1.0, 0.0, 0.0])


def test_an_arm_on_a_rail_turns_while_the_rail_rests():
    arm = arm_on_rail()
    robot = robot_of(arm)
    model = JointModel(robot, arm.compliances, None, Constraints(Bounds.positive(7)))
    inverse = InverseKinematics(robot, np.array([0.4, *np.zeros(6)]))
    p = process_path("trim", CENTRE + np.array([0.0, 0.4, 0.0]), count=8, joints=7)
    choice = choose_turns(model, inverse, p, task(8, speeds=np.append(1.0, SPEEDS)))
    np.testing.assert_allclose(choice.joints[:, 0], 0.4, rtol=0, atol=0)
    alone = choose_turns(MODEL, INVERSE, process_path("trim", CENTRE, count=8), task(8))
    assert choice.size == pytest.approx(alone.size, rel=0.05)  # the rail bends a little, too
    np.testing.assert_allclose(
        exact_lengths(arm, p, choice.joints),
        np.linalg.norm(model.deflect(p.cases(np.arange(8), choice.joints)).displacement, axis=1),
        rtol=0,
        atol=1e-8,
    )


def test_elastic_links_take_the_same_way():
    """Two ways of an arm whose links bend are ranked by the covariance of all entries."""
    robot, measurements = prepare(elastic_campaign(beam_arm(ARM), configurations=30, sigma=2e-5, seed=3))
    columns = Columns(6, tuple(range(6)))
    folds = Folds(Rows(robot, measurements), columns, np.ones(6, dtype=bool), CrossValidation(folds=3), None)
    elastic = folds.fit_whole_set(Candidate(find_model("joints_and_links"), columns), 1e-4)
    model = ElasticPredictor.from_estimate(robot, elastic)
    p = process_path("trim", CENTRE, count=6)
    choice = choose_turns(model, InverseKinematics(robot), p, task(6))
    assert choice.size <= choice.fixed.min() * (1.0 + 1e-3)
    cases = [p.cases(np.arange(6), joints) for joints in (choice.joints, choice.best_fixed)]
    turned, fixed = (PathDeflection.predict(model, None, each) for each in cases)
    low, high = turned.compare(fixed, 0.95).difference.readings
    assert low <= turned.size - fixed.size <= high


def test_too_many_motions_are_refused(monkeypatch):
    monkeypatch.setattr("jointstiff.solver.process.sequence.MOST_LINKS", 1_000)
    with pytest.raises(RequestError, match="more than 1,000 motions"):
        choose_turns(MODEL, INVERSE, path(), TASK)


def test_the_feed_of_a_cut_is_not_that_of_the_approach_nor_of_a_rest():
    """A motion of the joints has no feed; a tool that rests has those before and after the rest."""
    places = np.array([[0, 9, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0], [5, 5, 0]], float)
    continuous = np.array([False, False, True, True, True, True, False])
    frames = find_feed_frames(places, np.tile([0.0, 0.0, -1.0], (7, 1)), continuous)
    half = np.sqrt(0.5)
    expected = [[1, 0, 0], *np.tile([half, half, 0], (3, 1)), [0, 1, 0]]
    np.testing.assert_allclose(frames[1:6, :, 0], expected, atol=1e-15)
    assert np.isnan(frames[[0, 6], 0, 0]).all(), "only motions of the joints lead there"


def test_the_feed_along_an_arc_is_its_tangent():
    """Two points of a quarter of a circle after a line that does not run into it smoothly."""
    t = np.radians([0.0, 30.0, 90.0])
    circle = np.column_stack([3.0 + np.cos(t), np.sin(t) - 2.0, 0.5 + 0.0 * t])
    places = np.vstack([circle[:1] - [0.0, 1.0, 0.0], circle])
    middles = np.array([False, False, True, False])
    frames = find_feed_frames(places, np.tile([0.0, 0.0, -1.0], (4, 1)), np.arange(4) > 0, middles)
    tangents = np.column_stack([-np.sin(t), np.cos(t), 0.0 * t])
    np.testing.assert_allclose(frames[1:, :, 0], tangents, atol=1e-12)
    straight = places.copy()
    straight[1:] = np.outer([0.0, 0.4, 1.0], [1.0, 0.0, 0.0])
    frames = find_feed_frames(straight, np.tile([0.0, 0.0, -1.0], (4, 1)), np.arange(4) > 0, middles)
    np.testing.assert_allclose(frames[2:, :, 0], [[1.0, 0.0, 0.0]] * 2, atol=1e-12)
