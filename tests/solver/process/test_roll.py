"""The roll of a program: a free turn does not follow its jumps, and follows what keeps the rate."""

from dataclasses import replace

import numpy as np
import pytest
from support.process_paths import process_path
from support.springs import robot_of

from jointstiff.simulator import default_arm
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.process.pace import RATE, Pace
from jointstiff.solver.process.placing import coarsen, evaluate_places
from jointstiff.solver.process.roll import find_rolls, steady_roll, wrap_turns
from jointstiff.solver.process.turning import TurnTask, choose_turns

ARM = default_arm()
ROBOT = robot_of(ARM)
MODEL = JointModel(ROBOT, ARM.compliances, None, Constraints(Bounds.positive(6)))
INVERSE = InverseKinematics(ROBOT)
SPEEDS = np.radians([123.0, 115.0, 112.0, 179.0, 172.0, 219.0])
COUNT = 300
EVERY = np.arange(COUNT)
TASK = TurnTask.free(36, 0.04, Pace(np.full(COUNT, 0.05), SPEEDS))
PATH = process_path("blade", np.array([1.7, 0.0, 0.8]), count=COUNT)
ROLLS = {
    "a jump": np.where(EVERY < 150, 0.0, np.pi / 2.0),
    "there and back": np.where((EVERY > 100) & (EVERY < 200), 0.6, 0.0),
    "from point to point": np.radians(10.0) * (EVERY % 2),
    "at random": np.append(0.0, np.random.default_rng(0).uniform(-3.0, 3.0, COUNT - 1)),
    "faster than the rate": 1.5 * RATE * PATH.lengths,
}


def rolled(roll, path=PATH):
    return replace(path, poses=path.turn(np.arange(len(path)), roll))


@pytest.fixture(scope="module")
def plain():
    return choose_turns(MODEL, INVERSE, PATH, TASK)


@pytest.mark.parametrize("roll", ROLLS)
def test_a_free_turn_does_not_depend_on_a_roll_that_jumps(roll, plain):
    path = rolled(ROLLS[roll])
    choice = choose_turns(MODEL, INVERSE, path, TASK)
    assert choice.size == pytest.approx(plain.size, rel=5e-3)
    assert TASK.pace.shares(choice.motion).max() <= 0.5 * (1.0 + 1e-6)
    assert choice.unturned is None
    reached = INVERSE.refine(path.turn(EVERY, choice.turn), INVERSE.select_arm_joints(choice.joints))[0]
    np.testing.assert_allclose(reached, ROBOT.joint_map.model_angles(choice.joints), atol=1e-8)


@pytest.mark.parametrize("roll", ["at random", "from point to point", "faster than the rate"])
def test_a_turn_behind_each_jump_is_within_half_a_turn_of_the_programmed_orientation(roll):
    choice = choose_turns(MODEL, INVERSE, rolled(ROLLS[roll]), TASK)
    assert np.abs(choice.turn).max() <= np.pi + 1e-9


def test_turns_are_shifted_by_whole_turns_between_jumps_only():
    turn = np.linspace(0.0, 3.0, COUNT) + 6.0 * np.pi
    jump = np.where(EVERY < 150, 0.0, 4.0 * np.pi)
    wrapped = wrap_turns(turn + jump, jump, PATH)
    np.testing.assert_allclose(wrapped, np.linspace(0.0, 3.0, COUNT), atol=1e-9)
    turn[:10] = np.nan
    assert np.isnan(wrap_turns(turn, jump, PATH)[:10]).all()


def test_a_roll_within_the_rate_is_followed_and_is_what_fixed_turns_do():
    roll = 0.5 * RATE * PATH.lengths
    np.testing.assert_allclose(np.cumsum(find_rolls(rolled(roll)) - find_rolls(PATH)), roll, atol=1e-6)
    assert not steady_roll(rolled(roll), RATE, EVERY).any()


@pytest.mark.parametrize("roll", ROLLS)
def test_the_roll_without_jumps_is_that_of_a_tool_that_is_carried_along(roll):
    path = rolled(ROLLS[roll])
    turn = steady_roll(path, RATE, EVERY)
    assert turn[0] == 0.0
    rolls = find_rolls(rolled(turn, path))
    assert (np.abs(rolls) <= RATE * PATH.steps + 1e-6).all()


def test_the_orientation_of_targets_that_are_visited_again_and_of_given_joints_stays():
    path = rolled(ROLLS["a jump"])
    again = np.where(EVERY == COUNT - 1, 0, EVERY)
    assert not steady_roll(path, RATE, again).any()
    given = path.given.copy()
    given[10] = 0.0
    assert not steady_roll(replace(path, given=given), RATE, EVERY).any()
    closed = rolled(ROLLS["there and back"])
    assert steady_roll(closed, RATE, again).any()


def test_a_turn_within_a_range_is_from_the_programmed_orientation():
    path = rolled(ROLLS["a jump"])
    task = TurnTask.within(-0.5, 0.5, 36, 0.04, TASK.pace)
    steady, roll = task.steady(path, EVERY)
    assert steady is path
    assert not roll.any()


def test_places_do_not_depend_on_a_roll_that_jumps():
    sizes = []
    for path in (PATH, rolled(ROLLS["at random"])):
        coarse, task, first = coarsen(path, TASK, EVERY)
        x, y, z = path.middle
        place = np.array([[x, y, z, 0.0], [x + 0.1, y + 0.1, z, 0.5]])
        sizes.append(evaluate_places(MODEL, INVERSE, coarse, task, place, first))
    np.testing.assert_allclose(sizes[1], sizes[0], rtol=5e-3)
