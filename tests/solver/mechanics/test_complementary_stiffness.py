"""K_c against springs that balance the load exactly; regressors are kept with their set alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import (
    ARM,
    METHODS_AND_WEIGHTS,
    POINTS,
    SIGMA,
    estimate,
    first_target,
    simulated,
    wrench_of,
)

from jointstiff.simulator.campaign import LOAD_POINT
from jointstiff.simulator.equilibrium import deflections, torques
from jointstiff.solver.errors import SolverError
from jointstiff.solver.estimation import identify as iteration
from jointstiff.solver.estimation.estimate import predict
from jointstiff.solver.mechanics import block as regressor
from jointstiff.solver.mechanics.block import regressor_blocks
from jointstiff.solver.mechanics.springs import NEGLECTED_STIFFNESS, complementary_stiffness


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


def derivative(measurements, step=1e-5):
    """(N, 6, 6) derivatives of the simulator's torques by the joints [N·m/rad]."""
    load = wrench_of(measurements)
    ends = [
        [torques(ARM, measurements.joints + s * np.eye(6)[k], *load) for s in (step, -step)] for k in range(6)
    ]
    return np.stack([(ahead - behind) / (2 * step) for ahead, behind in ends], axis=-1)


class TestMatrix:
    @pytest.mark.parametrize("moment", [0.0, 400.0])
    def test_is_the_derivative_of_the_simulators_torques(self, moment):
        robot, measurements = exact(configurations=7, moment=moment, seed=11)
        measurements = replace(measurements, moment=measurements.moment * [1.0, 1.0, 0.0])
        (block,) = regressor_blocks(robot, measurements)
        # Torques of 4 kN.m have third derivatives of as much, and 1e-12 of rounding.
        np.testing.assert_allclose(complementary_stiffness(block), derivative(measurements), atol=1e-5)

    def test_its_greatest_ratio_is_that_over_all_postures(self, pulls):
        robot, measurements = pulls
        found = estimate(robot, measurements)
        ratios = np.abs(derivative(measurements)) * found.compliance[:, None]
        assert found.complementary_stiffness.largest_ratio == pytest.approx(ratios.max(), rel=1e-6)
        assert ratios.max(axis=(1, 2)).argmax() not in (0, len(measurements) - 1)

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
