"""Joints that a campaign does not see: the prior of the arm takes their place, with its uncertainty."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots
from support.process_paths import process_path, reach_centre

from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.stages import Likelihood
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.process.deflection import PathDeflection
from jointstiff.solver.process.pace import Pace
from jointstiff.solver.process.prior import assume_unseen_joints, build_prior_model
from jointstiff.solver.process.turning import TurnTask, choose_turns

ROBOT = next(each.robot for each in build_nominal_robots() if each.name == "KUKA KR 210 R2700 extra")
SEEN = np.array([1, 2, 3, 4])


def campaign(draw):
    """A run that does not see joints 1 and 6, and true compliances within a factor of two of the prior."""
    prior = build_prior_model(ROBOT).compliance
    truth = prior * np.exp(draw.normal(0.0, 0.5 * np.log(2.0), 6))
    estimate = truth * (1.0 + 0.03 * draw.standard_normal(6))
    covariance = np.diag(np.square(0.03 * truth[SEEN]))
    known = np.where(np.isin(np.arange(6), SEEN), estimate, 0.0)
    likelihood = Likelihood(SEEN, estimate[SEEN], covariance)
    return JointModel(ROBOT, known, likelihood, Constraints(Bounds.positive(6))), truth


def test_without_the_prior_a_process_is_refused_and_with_it_answered():
    model, _ = campaign(np.random.default_rng(0))
    p = process_path("trim", reach_centre(ROBOT), count=12)
    pace = Pace(np.full(12, 0.05), ROBOT.speeds)
    filled, names = assume_unseen_joints(model)
    assert names == ("joint_1", "joint_6")
    choice = choose_turns(filled, InverseKinematics(ROBOT), p, TurnTask.free(24, 0.04, pace))
    cases = p.cases(np.arange(12), choice.joints)
    with pytest.raises(RequestError, match="joint_1"):
        PathDeflection.predict(model, None, cases)
    low, high = PathDeflection.predict(filled, None, cases).band(0.95).readings
    assert low < choice.size < high


def test_a_run_that_sees_all_joints_stays_as_it_is():
    prior = build_prior_model(ROBOT)
    assert assume_unseen_joints(prior) == (prior, ())


def test_the_true_size_and_difference_lie_in_their_intervals():
    """Of 200 campaigns, whose unseen compliances are drawn by the law of the prior."""
    draw, inverse = np.random.default_rng(1), InverseKinematics(ROBOT)
    p = process_path("trim", reach_centre(ROBOT), count=8)
    pace = Pace(np.full(8, 0.05), ROBOT.speeds)
    filled, _ = assume_unseen_joints(campaign(draw)[0])
    choice = choose_turns(filled, inverse, p, TurnTask.free(24, 0.04, pace))
    ways = [p.cases(np.arange(8), joints) for joints in (choice.joints, choice.best_fixed)]
    sizes = differences = 0
    for _ in range(200):
        model, truth = campaign(draw)
        filled, _ = assume_unseen_joints(model)
        exact = JointModel(ROBOT, truth, None, Constraints(Bounds.positive(6)))
        true = [np.sqrt(np.mean(np.square(exact.deflect(each).displacement).sum(axis=1))) for each in ways]
        first, second = (PathDeflection.predict(filled, None, each) for each in ways)
        low, high = first.band(0.95).readings
        sizes += low <= true[0] <= high
        low, high = first.compare(second, 0.95).difference.readings
        differences += low <= true[0] - true[1] <= high
    assert sizes >= 185
    assert differences >= 186
