"""Model error: bounds from held-out postures hold on arms that the model does not describe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import METHODS, prepare, shared
from support.springs import SpringCampaign, robot_of

from jointstiff.simulator import default_arm
from jointstiff.solver.convex.solution import Bounds
from jointstiff.solver.errors import RequestError
from jointstiff.solver.estimate import identify
from jointstiff.solver.evidence.estimate import predict
from jointstiff.solver.fitting.method import Settings
from jointstiff.solver.predict.forward import LoadCases
from jointstiff.solver.predict.model_error import MOST_STEPS, ModelError, leave_postures_out, merged_steps
from jointstiff.solver.predict.models import JointModel

ROBOT = robot_of(default_arm())
DESIGN = SpringCampaign.of(default_arm())


def left_out(robot, measurements, method="partial_pose", **options):
    settings = Settings(method, "covariance", Bounds.positive(robot.n), **options)
    estimate = identify(robot, measurements, settings)
    model = JointModel.of(robot, estimate, settings.constraints)
    return model, leave_postures_out(robot, measurements, settings, estimate, model)


def noisy():
    return next(iter(DESIGN.measured(1, seed=4)))


@pytest.mark.parametrize("method", METHODS)
def test_scores_are_those_of_fits_repeated_without_each_posture(method):
    measurements = noisy()
    _, error = left_out(ROBOT, measurements, method)
    assert error.postures == len(measurements)
    found = sorted(error.score)
    expected = []
    for i in range(len(measurements)):
        others = np.delete(np.arange(len(measurements)), i)
        rest, _ = left_out(ROBOT, measurements[others], method)
        one = measurements[np.array([i])]
        size = np.linalg.norm(one.force) / np.linalg.norm(measurements.force, axis=1).max()
        # The linear model, as the refits have it.
        residual = predict(ROBOT, one, rest.compliance).residual[0]
        expected += list(np.linalg.norm(residual, axis=1) / np.sqrt(size))
    ratio = np.sqrt(np.square(found).mean() / np.square(expected).mean())
    np.testing.assert_allclose(found, ratio * np.sort(expected), rtol=1e-6, atol=1e-12)
    # On exact springs nearly all of a residual is the reading's own error, of six coordinates.
    noise, mean = 6.0 * measurements.sigma**2, np.square(expected).mean()
    assert ratio**2 * mean < 0.3 * noise
    assert ratio**2 * mean > mean - 1.2 * noise


def test_without_a_stated_noise_nothing_is_known_to_be_the_readings_own():
    """But for what the missing posture would have told."""
    measurements = replace(noisy(), sigma=None)
    _, error = left_out(ROBOT, measurements)
    _, stated = left_out(ROBOT, noisy())
    residuals = []
    for i in range(len(measurements)):
        rest, _ = left_out(ROBOT, measurements[np.delete(np.arange(len(measurements)), i)])
        residuals.append(predict(ROBOT, measurements[np.array([i])], rest.compliance).residual[0])
    whole = np.square(residuals).sum(axis=-1).mean()
    assert 0.95 * whole < np.square(error.score).mean() <= (1.0 + 1e-5) * whole
    assert np.square(stated.score).mean() < 0.3 * whole


def test_too_few_postures_bound_nothing():
    _, error = left_out(ROBOT, noisy()[np.arange(10)])
    assert [ModelError.needed(level) for level in (0.5, 0.9, 0.95, 0.99)] == [1, 9, 19, 99]
    assert np.isfinite(error.quantile(0.9))
    assert np.isinf(error.quantile(0.95))


def test_one_posture_alone_cannot_be_left_out():
    same = noisy()[np.array([0, 0, 0, 1, 1, 1])]
    _, error = left_out(ROBOT, same)
    assert error.postures == 2
    alone = replace(noisy()[np.arange(6)], joints=np.repeat(noisy().joints[:1], 6, axis=0))
    with pytest.raises(RequestError, match="two postures"):
        left_out(ROBOT, alone)


def test_merged_steps_round_quantiles_up_by_little():
    """Beside the least score with the share, found by counting over all readings."""
    generator = np.random.default_rng(5)
    posture = np.sort(generator.integers(0, 150, 3000))
    score = generator.random(len(posture)) * (1.0 + posture)
    score[generator.random(len(score)) < 0.01] = np.inf
    merged, share = merged_steps(posture, score)
    assert len(merged) <= MOST_STEPS + 1
    error = ModelError(150, merged, share, 1.0, 0.0, 0.1, 1.0)

    def exact(confidence):
        counts = np.bincount(posture)
        shares = [(1.0 / counts[posture])[score <= q].sum() / 151 for q in np.unique(score)]
        return np.unique(score)[np.argmax(np.array(shares) >= confidence)]

    for confidence in (0.05, 0.5, 0.9, 0.95, 0.98):
        assert exact(confidence) <= error.quantile(confidence) <= exact(confidence + 1.0 / MOST_STEPS)
    assert np.isinf(error.quantile(0.999))


def test_a_force_where_only_moments_were_measured_has_no_bound():
    plan = DESIGN.experiment
    twisted = replace(noisy(), moment=noisy().force, force=np.zeros_like(noisy().force))
    model, error = left_out(ROBOT, twisted)
    cases = LoadCases(plan.joints, plan.forces, plan.moments, plan.load_points, np.array(plan.load_points))
    bound = error.bound(cases, model.deflect(cases).leverage, 0.9)
    assert np.isinf(bound.radius).all()
    assert bound.unmeasured == "force"


def test_extrapolation_widens_and_is_named():
    model, error = left_out(ROBOT, noisy())
    plan = DESIGN.experiment
    place = np.array(plan.load_points)
    cases = LoadCases(plan.joints, plan.forces, plan.moments, plan.load_points, place)
    inside = error.bound(cases, model.deflect(cases).leverage, 0.9)
    np.testing.assert_allclose(inside.load_ratio, 1.0, rtol=1e-5)
    stronger = replace(cases, force=3.0 * cases.force)
    outside = error.bound(stronger, model.deflect(stronger).leverage, 0.9)
    np.testing.assert_allclose(outside.load_ratio, 3.0, rtol=1e-5)
    assert (outside.radius >= 2.99 * inside.radius).all()
    weaker = replace(cases, force=0.1 * cases.force)
    below = error.bound(weaker, model.deflect(weaker).leverage, 0.9)
    np.testing.assert_allclose(below.radius, inside.radius, rtol=1e-3)  # all loads of the campaign are equal
    far = replace(cases, place=place + np.array([0.0, 0.0, 5.0]))
    bound = error.bound(far, model.deflect(far).leverage, 0.9)
    assert (bound.leverage_ratio > 1.0).any()
    assert (bound.radius > 1.5 * inside.radius).any()
    turned = replace(cases, moment=np.full(cases.moment.shape, 10.0))
    unknown = error.bound(turned, model.deflect(turned).leverage, 0.9)
    assert unknown.unmeasured == "moment"
    assert np.isinf(unknown.radius).all()


def test_held_out_postures_of_a_real_robot():
    """FANUC: elastic links and no noise to speak of; 20 fitted, 10 held out (benchmark `deflection`)."""
    robot, measurements = prepare(shared("fanuc_r2000ic/campaign"))
    held, readings = [], []
    for seed in range(12):
        order = np.random.default_rng(seed).permutation(30)
        fitted, rest = measurements[np.sort(order[:20])], measurements[np.sort(order[20:])]
        model, error = left_out(robot, fitted, confidence=0.9)
        cases = LoadCases(rest.joints, rest.force, rest.moment, rest.load_point, rest.position[:, 0].copy())
        found = model.deflect(cases)
        read = rest.deflection[:, 0]
        bound = error.bound(cases, found.leverage, 0.9)
        held.append(np.linalg.norm(read - found.displacement, axis=1) <= bound.radius)
        of_readings = found.interval(0.9)
        readings.append((of_readings[:, :3, 0] <= read) & (read <= of_readings[:, :3, 1]))
        ends = bound.interval(found.displacement, of_readings)
        assert (ends[..., 0] <= of_readings[:, :3, 0]).all()
    assert np.mean(held) >= 0.85
    assert np.mean(readings) < 0.6  # what is not said by readings alone
