"""Model error: bounds from held-out postures hold on arms that the model does not describe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import prepare, shared
from support.springs import SpringCampaign, robot_of

from jointstiff.simulator import default_arm
from jointstiff.solver.errors import RequestError
from jointstiff.solver.estimation.estimate import LeftOut, UncertaintyBudget
from jointstiff.solver.estimation.identify import identify
from jointstiff.solver.estimation.method import Settings
from jointstiff.solver.estimation.solution import Bounds
from jointstiff.solver.predict.forward import LoadCases
from jointstiff.solver.predict.models import (
    MOST_STEPS,
    JointModel,
    ModelError,
    leave_postures_out,
    merged_steps,
)

ROBOT = robot_of(default_arm())
DESIGN = SpringCampaign.of(default_arm())


def left_out(robot, measurements, method="partial_pose", **options):
    settings = Settings(method, "covariance", Bounds.positive(robot.n), **options)
    estimate = identify(robot, measurements, settings)
    model = JointModel.of(robot, estimate, settings.constraints)
    return model, leave_postures_out(robot, measurements, settings, estimate, model)


def noisy():
    return next(iter(DESIGN.measured(1, seed=4)))


def test_too_few_postures_bound_nothing():
    _, error = left_out(ROBOT, noisy()[np.arange(10)])
    assert [ModelError.needed(level) for level in (0.5, 0.9, 0.95, 0.99)] == [1, 9, 19, 99]
    assert np.isfinite(error.quantile(0.9))
    assert np.isinf(error.quantile(0.95))


def test_numbers_that_are_not_finite_are_no_dispersion_over_the_postures():
    found = identify(ROBOT, noisy(), Settings("partial_pose", "covariance", Bounds.positive(ROBOT.n)))
    fits = found.compliance * (1.0 + 0.1 * np.random.default_rng(2).standard_normal((30, ROBOT.n)))
    known = UncertaintyBudget.of(found, 0.95, LeftOut(fits[1:], 30))
    fits[0] = np.inf
    with_infinite = UncertaintyBudget.of(found, 0.95, LeftOut(fits, 30))
    for one, other in zip(known.components, with_infinite.components, strict=True):
        np.testing.assert_array_equal(one.covariance, other.covariance)
    assert "model_error" in [part.source for part in known.components]
    nothing = replace(found, covariance=np.full((ROBOT.n, ROBOT.n), np.nan))
    budget = UncertaintyBudget.of(nothing, 0.95, LeftOut(fits, 30))
    assert "model_error" not in [part.source for part in budget.components]


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
