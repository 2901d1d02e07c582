"""Places of the workpiece, what one way gains over another, and the prior of an arm that nobody measured."""

from dataclasses import replace

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots
from support.process_paths import process_path
from support.springs import robot_of

from jointstiff.simulator import default_arm
from jointstiff.solver.errors import RobotError
from jointstiff.solver.evidence.payload import payload_torque
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.stages import Likelihood
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import measure_reach
from jointstiff.solver.predict.models import JointModel, ModelError
from jointstiff.solver.process.deflection import PathDeflection
from jointstiff.solver.process.pace import Pace
from jointstiff.solver.process.placing import (
    PlaceBox,
    coarsen,
    evaluate_places,
    find_flatness,
    search_around,
)
from jointstiff.solver.process.prior import PRIOR_ARMS, build_prior_model
from jointstiff.solver.process.turning import TurnTask, choose_turns

ARM = default_arm()
ROBOT = robot_of(ARM)
POSITIVE = Constraints(Bounds.positive(6))
INVERSE = InverseKinematics(ROBOT)


def task(count, *, greatest=False):
    return TurnTask.free(18, 0.04, Pace(np.full(count, 0.05), np.full(6, np.nan)), greatest=greatest)


CENTRE = np.array([1.7, 0.0, 0.8])


def model(deviation=0.05):
    """The arm, whose compliances are each known to 5 %, without correlation."""
    covariance = np.diag(np.square(deviation * ARM.compliances))
    return JointModel(ROBOT, ARM.compliances, Likelihood(np.arange(6), ARM.compliances, covariance), POSITIVE)


def predicted(p, joints, **options):
    stated = {"is_prior": True} | options
    return PathDeflection.predict(model(), None, p.cases(np.arange(len(p)), joints), **stated)


def test_a_place_moves_path_and_forces_together():
    p = process_path("pocket", CENTRE, count=12)
    moved = p.move(np.array([0.1, -0.2, 0.05]), np.pi / 2)
    np.testing.assert_allclose(moved.middle, p.middle + np.array([0.1, -0.2, 0.05]), atol=1e-12)
    np.testing.assert_allclose(moved.force[:, 1], p.force[:, 0], atol=1e-9)
    feed, moved_feed = (np.diff(each.centres, axis=0) for each in (p, moved))
    cosine = np.einsum("ij,ij->i", feed, p.force[1:]), np.einsum("ij,ij->i", moved_feed, moved.force[1:])
    np.testing.assert_allclose(*cosine, atol=1e-9)


def test_the_search_finds_the_best_place_of_its_grid_and_then_a_better_one():
    p = process_path("trim", CENTRE, count=10)
    half = np.array([0.3, 0.3, 0.0])
    box = PlaceBox(CENTRE - half, CENTRE + half, (3, 3, 1), np.array([0.0, np.pi / 2]))
    places = box.places()
    assert len(places) == 18
    sizes = evaluate_places(model(), INVERSE, p, task(len(p)), places)
    best = int(np.nanargmin(sizes))
    p_best = p.move(places[best, :3] - p.middle, places[best, 3])
    assert choose_turns(model(), INVERSE, p_best, task(len(p))).size == pytest.approx(sizes[best], rel=2e-2)

    def evaluate(trials):
        return evaluate_places(model(), INVERSE, p, task(len(p)), trials)

    place, size = search_around(box, places[best], float(sizes[best]), evaluate)
    assert size <= sizes[best]
    assert (place[:3] >= box.low - 1e-12).all()
    assert (place[:3] <= box.high + 1e-12).all()
    flat = find_flatness(np.vstack([places, place]), np.append(sizes, size))
    good = places[sizes <= 1.05 * size]
    assert len(good) <= flat.count <= len(good) + 1
    assert (flat.low <= place + 1e-9).all()
    assert (flat.high >= place - 1e-9).all()


def test_a_place_out_of_reach_has_no_number():
    p = process_path("trim", CENTRE, count=6)
    sizes = evaluate_places(
        model(), INVERSE, p, task(len(p)), np.array([[9.0, 0.0, 0.8, 0.0], [*CENTRE, 0.0]])
    )
    assert np.isnan(sizes[0])
    assert np.isfinite(sizes[1])


def test_a_coarse_path_is_a_part_of_the_path_by_length():
    p = process_path("pocket", CENTRE, count=400)
    continuous = p.continuous.copy()
    continuous[150] = False  # a move of the joints
    broken = replace(p, continuous=continuous)
    thinned, coarse, first = coarsen(broken, task(400), np.arange(400))
    assert 20 <= len(thinned) <= 24
    assert np.flatnonzero(~thinned.continuous).tolist()[0] == 0
    assert (~thinned.continuous).sum() == 2
    assert len(coarse.pace.feed) == len(thinned)
    assert thinned.steps.max() <= 1.05 * broken.lengths[-1] / 20
    np.testing.assert_array_equal(first, np.arange(len(thinned)))


def test_a_coarse_path_keeps_loads_branches_and_the_middle_of_the_path():
    """A corner far off and a short cut of a long program count in the search of places, too."""
    p = process_path("pocket", CENTRE, count=200)
    poses, force = p.poses.copy(), p.force.copy()
    poses[7, :3, 3] += [0.4, 0.0, 0.0]
    force[np.setdiff1d(np.arange(200), np.arange(101, 107))] = 0.0
    force[103] *= 5.0
    near = np.arange(200.0)[:, None] * np.ones(6)
    long = replace(p, poses=poses, force=force, near=near)
    thinned, _, _ = coarsen(long, task(200, greatest=True), np.arange(200))
    assert np.linalg.norm(thinned.force, axis=1).max() == np.linalg.norm(force[103])
    assert 3 <= thinned.loaded.sum() < len(thinned) <= 41
    kept = thinned.near[:, 0].astype(int)
    assert 7 in kept
    np.testing.assert_array_equal(thinned.poses, poses[kept])
    np.testing.assert_array_equal(thinned.middle, long.middle)
    moved = thinned.move(np.array([0.1, 0.0, 0.0]), 1.0)
    np.testing.assert_allclose(moved.centres, long.move(np.array([0.1, 0.0, 0.0]), 1.0).centres[kept])
    np.testing.assert_allclose(moved.middle, long.middle + np.array([0.1, 0.0, 0.0]))


def test_the_interval_of_a_root_mean_square_is_that_of_its_derivative():
    """Beside central differences in each compliance."""
    p = process_path("blade", CENTRE, count=9)
    joints = choose_turns(model(), INVERSE, p, task(len(p))).joints
    found = predicted(p, joints)
    variance = 0.0
    for j in range(6):
        ends = []
        for sign in (1.0, -1.0):
            compliance = ARM.compliances.copy()
            compliance[j] *= 1.0 + sign * 1e-4
            bent = JointModel(ROBOT, compliance, None, POSITIVE).deflect(p.cases(np.arange(9), joints))
            ends.append(np.sqrt(np.mean(np.square(np.linalg.norm(bent.displacement, axis=1)))))
        variance += (0.05 * (ends[0] - ends[1]) / 2e-4) ** 2
    band = found.band(0.95)
    assert band.readings[1] - band.value == pytest.approx(1.959964 * np.sqrt(variance), rel=1e-5)
    assert band.with_model_error is None


def test_a_common_error_cancels_in_the_difference_and_equal_ways_have_no_order():
    p = process_path("pocket", CENTRE, count=12)
    choice = choose_turns(model(), INVERSE, p, task(len(p)))
    turned, fixed = predicted(p, choice.joints), predicted(p, choice.best_fixed)
    ranking = turned.compare(fixed, 0.95)
    low, high = ranking.difference.readings
    own = turned.band(0.95).readings
    assert high - low < own[1] - own[0]
    assert turned.compare(turned, 0.95).difference.readings == (0.0, 0.0)
    assert not turned.compare(turned, 0.95).is_ordered
    # An error of the force that is the same at all points changes no order.
    parts = 0.25 * np.stack([p.force, 0.0 * p.force, 0.0 * p.force], axis=2)
    worse = predicted(p, choice.joints, force_parts=parts)
    assert worse.band(0.95).readings[1] - worse.size > 0.49 * worse.size
    again = worse.compare(predicted(p, choice.best_fixed, force_parts=parts), 0.95)
    assert again.is_ordered == ranking.is_ordered
    assert again.first_is_less
    assert again.difference.value == ranking.difference.value
    unknown = predicted(p, choice.joints, is_prior=False).compare(turned, 0.95)
    assert unknown.difference.with_model_error is None
    assert not unknown.is_ordered, "the readings alone do not rank"


def test_the_model_error_of_each_way_widens_the_interval_of_their_difference():
    """Held-out residuals of 30 and 60 µm at 1 kN: a third of their square along a direction, by Student."""
    p = process_path("pocket", CENTRE, count=12)
    load = np.linalg.norm(p.force[0]) / 1000.0
    scores, share = np.array([3e-5, 6e-5]), np.array([0.5, 1.0]) * 20.0 / 21.0
    error = ModelError(20, scores, share, force=1000.0, moment=0.0, least_load=0.1, leverage=1.0)
    assert error.deviation == pytest.approx(np.sqrt((3e-5**2 + 6e-5**2) / 6.0))
    choice = choose_turns(model(), INVERSE, p, task(len(p)))
    ways = [
        PathDeflection.predict(model(), error, p.cases(np.arange(12), joints))
        for joints in (choice.joints, choice.best_fixed)
    ]
    difference = ways[0].compare(ways[1], 0.95).difference
    # The deflections of all points count, each by its fraction of the root mean square.
    parts = [np.mean(each.length) / each.size * error.deviation * np.sqrt(load) for each in ways]
    half = np.hypot(difference.readings[1] - difference.value, 2.093024 * np.hypot(*parts))
    assert difference.with_model_error == pytest.approx((difference.value - half, difference.value + half))
    unknown = replace(error, score=np.array([3e-5, np.inf]))
    again = PathDeflection.predict(model(), unknown, p.cases(np.arange(12), choice.joints))
    assert again.compare(ways[1], 0.95).difference.with_model_error is None


def test_the_true_difference_lies_in_its_interval_as_often_as_stated():
    """Arms are drawn whose compliances err by 5 %; the interval foretells the difference on the true arm."""
    p = process_path("trim", CENTRE, count=8)
    draw, inside = np.random.default_rng(0), 0
    choice = choose_turns(model(), INVERSE, p, task(len(p)))
    cases = [p.cases(np.arange(8), joints) for joints in (choice.joints, choice.best_fixed)]
    for _ in range(200):
        estimate = ARM.compliances * (1.0 + 0.05 * draw.standard_normal(6))
        covariance = np.diag(np.square(0.05 * ARM.compliances))
        drawn = JointModel(ROBOT, estimate, Likelihood(np.arange(6), estimate, covariance), POSITIVE)
        first, second = (PathDeflection.predict(drawn, None, each) for each in cases)
        low, high = first.compare(second, 0.95).difference.readings
        truth = [predicted(p, each).size for each in (choice.joints, choice.best_fixed)]
        inside += low <= truth[0] - truth[1] <= high
    assert 180 <= inside <= 199


def test_the_prior_of_a_measured_arm_is_within_a_factor_of_two_of_it():
    robot = next(each.robot for each in build_nominal_robots() if each.name == "KUKA KR 210 R2700 extra")
    prior = 1.0 / build_prior_model(robot).compliance
    scale = payload_torque(210, measure_reach(robot))
    assert np.exp(np.log(prior[1:] / scale).mean()) == pytest.approx(98.4, abs=1.0)  # 93 and 104
    for arm in PRIOR_ARMS:
        ratio = prior[1:] / scale / arm.ratios()
        assert (ratio > 0.5).all()
        assert (ratio < 2.0).all()


def test_an_arm_without_payload_has_no_prior():
    with pytest.raises(RobotError, match="no payload"):
        build_prior_model(ROBOT.with_payload(None))
