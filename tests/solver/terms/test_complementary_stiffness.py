"""K_c against springs that balance the load exactly; regressors are kept with their set alone."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import (
    ARM,
    METHODS_AND_WEIGHTS,
    POINTS,
    SIGMA,
    blocks_of_set,
    estimate,
    first_target,
    settings_of,
    simulated,
    wrench_of,
)

from jointstiff.simulator.campaign import LOAD_POINT
from jointstiff.simulator.equilibrium import deflections, torques
from jointstiff.solver import estimate as iteration
from jointstiff.solver.errors import SolverError
from jointstiff.solver.estimate import identify
from jointstiff.solver.evidence.assessment import judge
from jointstiff.solver.evidence.causes import screen_estimate
from jointstiff.solver.evidence.estimate import predict
from jointstiff.solver.resampling import ResamplingPlan, gram_blocks, resample
from jointstiff.solver.terms import block as regressor
from jointstiff.solver.terms.block import regressor_blocks
from jointstiff.solver.terms.springs import NEGLECTED_STIFFNESS, complementary_stiffness


def exact(load="pull", *, configurations=19, **options):
    """Readings without noise, of springs that balance the load, with the sigma that a tracker would have."""
    options = {"load": load, "configurations": configurations, "sigma": 0.0, "seed": 3} | options
    robot, measurements = simulated(**options)
    return robot, replace(measurements, sigma=SIGMA)


@pytest.fixture(scope="module")
def pulls():
    return exact()


@pytest.fixture(scope="module")
def dead_weight():
    return exact("dead_weight")


class TestMatrix:
    @pytest.mark.parametrize("moment", [0.0, 400.0])
    def test_is_the_derivative_of_the_simulators_torques(self, moment):
        robot, measurements = exact(configurations=7, moment=moment, seed=11)
        measurements = replace(measurements, moment=measurements.moment * [1.0, 1.0, 0.0])
        (block,) = regressor_blocks(robot, measurements)
        found, step = complementary_stiffness(block), 1e-5
        for k in range(6):
            ahead, behind = (
                torques(ARM, measurements.joints + s * np.eye(6)[k], *wrench_of(measurements))
                for s in (step, -step)
            )
            # Torques of 4 kN.m have third derivatives of as much, and 1e-12 of rounding.
            np.testing.assert_allclose(found[:, :, k], (ahead - behind) / (2 * step), atol=1e-5)

    def test_what_is_neglected_is_second_order_and_known_to_third(self):
        errors = []
        for force in (1500.0, 150.0):
            robot, measurements = exact(force=force, moment=0.2 * force)
            (block,) = regressor_blocks(robot, measurements)
            missing = measurements.deflection - block.A @ ARM.compliances
            found = NEGLECTED_STIFFNESS.motion(block, ARM.compliances).targets[..., 0]
            assert np.abs(found - missing).max() < 0.02 * np.abs(missing).max()
            errors.append(np.abs(found - missing).max())
        assert errors[0] / errors[1] == pytest.approx(1000.0, rel=0.05)


class TestDeflectedRegressor:
    @pytest.mark.parametrize("readings", ["positions", "deflections"])
    def test_predicts_the_exact_deflection_to_third_order(self, readings):
        errors = []
        for force in (1500.0, 150.0):
            robot, measurements = exact(force=force, moment=0.2 * force, readings=readings)
            (block,) = regressor_blocks(robot, measurements, ARM.compliances)
            error = np.abs(block.A @ ARM.compliances - measurements.deflection).max()
            assert error < 2e-6 * np.abs(measurements.deflection).max()
            errors.append(error)
        assert errors[0] / errors[1] == pytest.approx(1000.0, rel=0.05)

    def test_torques_are_those_of_the_balance(self, pulls):
        robot, measurements = pulls
        (block,) = regressor_blocks(robot, measurements, ARM.compliances)
        bent = measurements.joints + ARM.compliances * block.torque
        expected = torques(ARM, bent, *wrench_of(measurements))
        np.testing.assert_allclose(block.torque, expected, rtol=1e-10, atol=1e-9)

    def test_rigid_joints_do_not_bend_and_leave_the_plain_regressor(self, pulls):
        (plain,) = regressor_blocks(*pulls)
        (rigid,) = regressor_blocks(*pulls, np.zeros(6))
        np.testing.assert_allclose(rigid.A, plain.A, rtol=1e-10, atol=1e-10)

    def test_a_load_that_buckles_the_arm_is_refused(self, pulls):
        with pytest.raises(SolverError, match="no equilibrium"):
            next(regressor_blocks(*pulls, 1e3 * ARM.compliances))


class TestIncluded:
    @pytest.mark.parametrize("load", ["pull", "dead_weight"])
    @pytest.mark.parametrize(("method", "weighting"), METHODS_AND_WEIGHTS)
    def test_removes_the_bias(self, method, weighting, load):
        robot, measurements = exact(load)
        options = {"method": method, "weighting": weighting}
        neglected = estimate(robot, measurements, **options)
        included = estimate(robot, measurements, complementary_stiffness="included", **options)
        known = np.array([joint.compliance is not None for joint in included.joints])
        truth, uncertainty = ARM.compliances[known], np.sqrt(np.diag(included.covariance))[known]
        bias = np.abs(included.compliance[known] - truth)
        assert (bias / truth).max() < 1e-5
        assert (bias / uncertainty).max() < 1e-3
        # A fifth for weightings of larger uncertainty, three quarters for the decoupled method.
        before = np.abs(neglected.compliance[known] - truth)
        assert 0.15 < (before / uncertainty).max() < 0.9

    def test_with_the_huber_loss(self, pulls):
        robot, measurements = pulls
        spoilt = measurements.deflection.copy()
        spoilt[4, 1] += [1e-3, 0.0, -1e-3]
        found, squared = (
            estimate(
                robot, replace(measurements, deflection=spoilt), complementary_stiffness="included", loss=loss
            )
            for loss in ("huber", "squared")
        )
        uncertainty = np.sqrt(np.diag(found.covariance))
        off = [np.abs((each.compliance - ARM.compliances) / uncertainty).max() for each in (found, squared)]
        assert off[0] < 1.0 < 5.0 < off[1]
        assert found.robust.suspicious.tolist() == [[4, 1]]

    def test_prediction_is_the_exact_balance(self, pulls):
        robot, measurements = pulls
        found = estimate(robot, measurements, complementary_stiffness="included")
        included = predict(robot, measurements, found.compliance, balanced=found.compliance)
        linear = predict(robot, measurements, found.compliance)
        load = measurements.force, measurements.moment, LOAD_POINT
        unloaded, loaded = deflections(ARM, measurements.joints, *load, POINTS)
        assert np.abs(included.predicted - (loaded - unloaded)).max() < 1e-8
        assert included.rms_residual < 1e-8 < 1e-6 < linear.rms_residual

    def test_compliances_that_never_settle_are_refused(self, pulls, monkeypatch):
        monkeypatch.setattr(iteration, "MAX_ITERATIONS", 1)
        with pytest.raises(SolverError, match="still change"):
            estimate(*pulls, complementary_stiffness="included")


class TestReported:
    @pytest.mark.parametrize(("method", "weighting"), METHODS_AND_WEIGHTS)
    def test_shift_is_what_including_it_would_change(self, method, weighting):
        robot, measurements = simulated(load="dead_weight", seed=8)
        options = {"method": method, "weighting": weighting}
        neglected = estimate(robot, measurements, **options)
        included = estimate(robot, measurements, complementary_stiffness="included", **options)
        change = included.compliance - neglected.compliance
        known = np.array([joint.compliance is not None for joint in neglected.joints])
        uncertainty = np.sqrt(np.diag(neglected.covariance))
        expected = np.abs(change[known] / uncertainty[known]).max()
        size = neglected.complementary_stiffness
        assert size.largest_shift == pytest.approx(expected, rel=0.03)
        np.testing.assert_allclose(
            size.shift[known] / uncertainty[known], change[known] / uncertainty[known], atol=0.03 * expected
        )
        assert (size.included, size.iterations) == (False, 0)
        other = included.complementary_stiffness
        assert other.included
        assert 1 <= other.iterations <= 8
        assert other.largest_shift == pytest.approx(expected, rel=0.01)

    def test_ratio_is_that_of_the_joints_with_an_estimate(self, dead_weight):
        found = estimate(*dead_weight)
        assert found.joints[0].compliance is None
        (block,) = regressor_blocks(*dead_weight)
        ratios = np.abs(complementary_stiffness(block)).max(axis=0) * found.compliance[:, None]
        assert found.complementary_stiffness.largest_ratio == pytest.approx(ratios[1:, 1:].max())

    def test_shift_of_a_large_set_is_that_of_an_even_part_of_it(self, monkeypatch):
        robot, measurements = exact("dead_weight", configurations=200)
        whole = estimate(robot, measurements).complementary_stiffness
        monkeypatch.setattr(regressor, "BLOCK_LENGTH", 30)
        monkeypatch.setattr(iteration, "SHIFT_OBSERVATIONS", 100)
        part = estimate(robot, measurements).complementary_stiffness
        assert part.largest_ratio == pytest.approx(whole.largest_ratio, rel=1e-12)
        assert part.largest_shift == pytest.approx(whole.largest_shift, rel=0.1)
        assert part.largest_shift != whole.largest_shift

    def test_no_sigma_and_no_freedom_leave_the_shift_unknown(self):
        robot, measurements = exact(configurations=2)
        one = replace(first_target(measurements), sigma=None)
        assert estimate(robot, one).complementary_stiffness.largest_shift is None

    @pytest.mark.parametrize(
        ("sigma", "choice", "warned"),
        [(SIGMA, "neglected", True), (3 * SIGMA, "neglected", False), (SIGMA, "included", False)],
    )
    def test_says_so_where_it_matters(self, dead_weight, sigma, choice, warned):
        robot, measurements = dead_weight[0], replace(dead_weight[1], sigma=sigma)
        found = estimate(robot, measurements, complementary_stiffness=choice)
        assert (found.complementary_stiffness.largest_shift > 0.5) == (sigma == SIGMA)
        remedies = [f.remedy for f in judge(found) if f.code == "complementary_stiffness_matters"]
        assert ["complementary_stiffness: included" in remedy for remedy in remedies] == [True] * warned


@pytest.mark.parametrize(("method", "weighting"), METHODS_AND_WEIGHTS)
def test_resamples_find_the_springs(pulls, method, weighting):
    """Each draw of readings without noise finds the springs, with K_c at the whole set's compliances."""
    found, neglected = (
        resample(blocks_of_set(*pulls, settings), ResamplingPlan(10, 6, 1), settings.bounds)
        for settings in (
            settings_of(pulls[0], method=method, weighting=weighting, complementary_stiffness=choice)
            for choice in ("included", "neglected")
        )
    )
    true = np.broadcast_to(ARM.compliances, found.compliance.shape)
    np.testing.assert_allclose(found.compliance, true, rtol=1e-4)
    assert np.abs(neglected.compliance / true - 1).max() > 1e-3
    assert (found.compensation > 1 - 1e-5).all()


def test_the_same_set_has_the_same_regressors_and_others_have_their_own():
    robot, measurements = simulated(seed=8)
    (first,) = regressor_blocks(robot, measurements)
    (again,) = regressor_blocks(robot, measurements)
    assert again.A is first.A
    assert again.measurements is measurements
    (bent,) = regressor_blocks(robot, measurements, np.full(robot.n, 1e-6))
    assert (bent.A != first.A).any()
    (stronger,) = regressor_blocks(robot, replace(measurements, force=2.0 * measurements.force))
    np.testing.assert_allclose(stronger.A, 2.0 * first.A, rtol=1e-12)
    other, _ = simulated(seed=8)
    (of_other,) = regressor_blocks(other, measurements)
    assert of_other.A is not first.A


def test_nothing_depends_on_what_else_is_asked_of_the_same_set(pulls):
    """A service asks one set several questions at once, and its regressors are kept with it."""
    robot, settings = pulls[0], settings_of(pulls[0], complementary_stiffness="included")

    def answers(*others):
        measurements = replace(pulls[1])
        found = identify(robot, measurements, settings)
        answered = [found.compliance]
        for question in (
            lambda: predict(robot, measurements, found.compliance, balanced=found.balanced).predicted,
            lambda: [test.p_value for test in screen_estimate(robot, measurements, found).tests],
            lambda: gram_blocks(robot, measurements, settings, found).regressor,
        ):
            for other in others:
                list(regressor_blocks(robot, measurements, other))
            answered.append(question())
        return answered

    for alone, together in zip(answers(), answers(np.full(robot.n, 1e-6)), strict=True):
        np.testing.assert_array_equal(alone, together)


def test_a_set_that_is_gone_leaves_nothing_behind():
    robot, measurements = simulated(seed=8)
    (block,) = regressor_blocks(robot, measurements)
    kept = weakref.ref(block.configurations)
    del block, measurements
    gc.collect()
    assert kept() is None
