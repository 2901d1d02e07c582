"""Profile-likelihood intervals against closed forms, brute force and a cone solver; their coverage."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from support.campaigns import METHODS, estimate, prepare

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import SolverError
from jointstiff.solver.estimation import estimate as module
from jointstiff.solver.estimation.estimate import profile_ends
from jointstiff.solver.estimation.fit import Likelihood, rows_of
from jointstiff.solver.estimation.solution import Bounds, Constraints
from jointstiff.solver.mechanics.block import regressor_blocks
from jointstiff.solver.mechanics.measurements import CommonUncertainty

RADII = np.array([1.959963984540054, 1.6448536269514722])
"""Two-sided and one-sided at 95 %."""


def likelihood(R, centre):
    R = np.asarray(R, dtype=float)
    return Likelihood(np.arange(R.shape[1]), np.asarray(centre, dtype=float), np.linalg.pinv(R.T @ R), R)


def positive(n, *order):
    return Constraints(Bounds.positive(n), order)


def ends_of(found, constraints, radii=RADII, wanted=None):
    wanted = np.arange(len(found.centre)) if wanted is None else np.asarray(wanted)
    rows = np.eye(len(found.centre))[wanted]
    return profile_ends(found, constraints, rows, np.atleast_1d(np.asarray(radii, dtype=float)))


class TestClosedForms:
    def test_where_no_constraint_matters_it_is_the_interval_of_wald(self):
        R = np.array([[2.0, 0.3], [0.0, 5.0]])
        found = likelihood(R, [10.0, 7.0])
        deviation = np.sqrt(np.diag(np.linalg.inv(R.T @ R)))
        expected = found.centre[:, None] + RADII[:, None, None] * deviation[:, None] * np.array([-1.0, 1.0])
        np.testing.assert_allclose(ends_of(found, positive(2)), expected, rtol=1e-14)

    def test_a_joint_at_its_bound_and_one_beside_it(self):
        """Centre (1, −1), unit metric, Δ = 1: the nearest point is (1, 0), so ρ² = 2."""
        ends = ends_of(likelihood(np.eye(2), [1.0, -1.0]), positive(2), 1.0)[0]
        np.testing.assert_allclose(ends, [[0.0, 2.0], [0.0, sqrt(2) - 1]], atol=1e-12)

    def test_two_joints_in_an_order(self):
        """Centre (1, 0), c₀ ≤ c₁, Δ = 1: the nearest point is (½, ½), so ρ² = 3/2."""
        ends = ends_of(likelihood(np.eye(2), [1.0, 0.0]), positive(2, (0, 1)), 1.0)[0]
        np.testing.assert_allclose(ends, [[0.0, 0.5 + sqrt(0.5)], [0.0, sqrt(1.5)]], atol=1e-12)

    def test_a_joint_that_reaches_its_bound_inside_the_ball(self):
        ends = ends_of(likelihood(np.eye(2), [0.5, 3.0]), Constraints(Bounds(np.zeros(2), np.ones(2))), 3.0)
        np.testing.assert_array_equal(ends[0, 0], [0.0, 1.0])

    def test_of_a_point_both_ends_are_the_constrained_optimum(self):
        """As one-sided bounds at 50 % are, also where the constraints cost nothing: c₁ + c₂ = 2 is exact."""
        ends = ends_of(likelihood(np.eye(2), [1.0, -1.0]), positive(2), [1.0, 0.0])
        np.testing.assert_allclose(ends[1], [[1.0, 1.0], [0.0, 0.0]], atol=1e-12)
        found = likelihood([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]], [1.0, -1.0, 3.0])
        np.testing.assert_allclose(ends_of(found, positive(3), [1.0, 0.0], [0]), [[[0.0, 2.0]], [[1.0, 1.0]]])

    def test_equal_columns_are_one_joint_to_the_others(self):
        """Joints 2 and 3 show only together; to joints 0 and 1 they are one, whose compliance is the sum."""
        rng = np.random.default_rng(3)
        for _ in range(50):
            R, centre = rng.standard_normal((6, 3)), rng.standard_normal(3)
            whole = ends_of(likelihood(R, centre), positive(3), wanted=[0, 1])
            twins = likelihood(R[:, [0, 1, 2, 2]], np.r_[centre[:2], centre[2] / 2, centre[2] / 2])
            np.testing.assert_allclose(
                ends_of(twins, positive(4), wanted=[0, 1]), whole, rtol=1e-8, atol=1e-8
            )

    def test_rows_from_a_covariance_are_those_of_its_inverse(self):
        rng = np.random.default_rng(0)
        R = rng.standard_normal((7, 5)) * 10.0 ** np.arange(-10, 15, 5)
        rows = rows_of(np.linalg.inv(R.T @ R))
        np.testing.assert_allclose(rows.T @ rows, R.T @ R, rtol=1e-9)


class TestIndependently:
    def test_an_interval_holds_the_profiles_walds_and_the_estimate(self):
        rng, others = np.random.default_rng(4), 0
        for _ in range(20):
            R, centre = rng.standard_normal((6, 3)), rng.standard_normal(3)
            found, value = likelihood(R, centre), np.maximum(centre, 0.0)
            half = RADII[0] * np.sqrt(np.diag(np.linalg.inv(R.T @ R)))
            wald = np.maximum(centre[:, None] + half[:, None] * [-1.0, 1.0], 0.0)
            profile = ends_of(found, positive(3), RADII[0])[0]
            ends = module.interval_ends(found, positive(3), np.eye(3), RADII[:1], value, by_profile=True)[0]
            parts = np.stack([wald, profile, np.stack([value, value], axis=1)])
            np.testing.assert_allclose(ends[:, 0], parts[..., 0].min(axis=0), atol=1e-12)
            np.testing.assert_allclose(ends[:, 1], parts[..., 1].max(axis=0), atol=1e-12)
            others += int((np.abs(profile - wald) > 1e-3).sum())
        assert others > 10

    def test_an_end_that_is_not_certified_is_an_error(self, monkeypatch):
        monkeypatch.setattr(module, "MOST_ROUNDS", 0)
        with pytest.raises(SolverError, match="end of a confidence interval"):
            ends_of(likelihood(np.eye(2), [1.0, -1.0]), positive(2))


@pytest.fixture(scope="module")
def rigid_joint():
    """Pulls at an arm whose fourth joint is rigid, and noise that makes it look less than that."""
    robot, measurements = prepare(simulate_campaign(default_arm(), load="pull", seed=0))
    (block,) = regressor_blocks(robot, measurements)
    truth = default_arm().compliances.copy()
    truth[3] = 0.0
    return robot, measurements, block.A @ truth, truth


def read_with_noise(rigid_joint, seed):
    robot, measurements, exact, _ = rigid_joint
    noise = np.random.default_rng(seed).normal(0, sqrt(2) * measurements.sigma, exact.shape)
    return robot, replace(measurements, deflection=exact + noise)


class TestJoints:
    @pytest.mark.parametrize("method", METHODS)
    def test_a_joint_at_zero_is_stiffer_than_a_number(self, rigid_joint, method):
        seed = next(
            seed
            for seed in range(50)
            if estimate(*read_with_noise(rigid_joint, seed), method=method).compliance[3] == 0
        )
        joint = estimate(*read_with_noise(rigid_joint, seed), method=method).joints[3]
        assert (joint.status, joint.compliance, joint.stiffness) == ("at_bound", 0.0, None)
        assert joint.compliance_interval[0] == 0.0 < joint.compliance_interval[1]
        assert joint.stiffness_interval == (1 / joint.compliance_interval[1], None)
        assert joint.one_sided.stiffness_at_most is None
        least = joint.one_sided.stiffness_at_least
        assert least > joint.stiffness_interval[0]
        number = 1e6 * float(joint.reason.split("stiffer than ")[1].split(" · 10⁶ N·m/rad at 95 %")[0])
        assert 0.99 * least < number <= least

    def test_confidence_and_students_t(self, rigid_joint):
        robot, measurements = read_with_noise(rigid_joint, 1)
        free = estimate(robot, replace(measurements, sigma=None), positive=False, confidence=0.99)
        # Student's t of 165 degrees of freedom: 0.995 for two sides, 0.99 for one.
        joint = free.joints[0]
        assert free.degrees_of_freedom == pytest.approx(165)
        half = (joint.compliance_interval[1] - joint.compliance_interval[0]) / 2 / joint.standard_uncertainty
        assert half == pytest.approx(2.6060, abs=1e-4)
        above = (joint.one_sided.compliance_at_most - joint.compliance) / joint.standard_uncertainty
        assert above == pytest.approx(2.3492, abs=1e-4)


def test_an_error_that_moves_some_joints_alone_is_in_the_budget():
    """A dead weight never twists joint 1: the scale of its force goes one to one into the others."""
    robot, measurements = prepare(simulate_campaign(default_arm(), load="dead_weight", seed=1))
    found = estimate(robot, replace(measurements, common_uncertainty=CommonUncertainty(scale=0.01)))
    components = module.UncertaintyBudget.of(found, 0.95).components
    (scale,) = [part for part in components if part.source == "force_scale"]
    np.testing.assert_allclose(scale.uncertainty[1:], 0.01 * found.compliance[1:], rtol=1e-6)
