"""Priors against Bayes' rule in closed form; observability indices and reasons against exact cases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats
from support.campaigns import (
    ARM,
    estimate,
    first_target,
    simulated,
    straight_wrist,
    twins,
)
from support.examples import examples

from jointstiff.schemas.run import JointResult
from jointstiff.simulator.campaign import torques
from jointstiff.solver.errors import RequestError, UnsupportedMethodError
from jointstiff.solver.estimation.assessment import judge
from jointstiff.solver.estimation.fit import sigma_test
from jointstiff.solver.estimation.method import Prior
from jointstiff.solver.estimation.observability import (
    Observability,
    Spectrum,
    analyse,
    observability_indices,
)
from jointstiff.solver.mechanics.block import regressor_blocks
from jointstiff.solver.messages import message as message_of

STIFFNESS = {"joint_5": (4e5, 4e4), "joint_2": (3e6, 1e6)}
PRIORS = {name: {"stiffness": k, "standard_uncertainty": u} for name, (k, u) in STIFFNESS.items()}


@pytest.fixture(scope="module")
def pulls():
    return simulated(load="pull", configurations=6, force=150.0, seed=3)


@pytest.mark.parametrize("sigma", [2e-5, None])
def test_partial_pose_is_bayes_rule(pulls, sigma):
    """``(AᵀA/s² + S₀⁻¹)⁻¹ (Aᵀd/s² + S₀⁻¹ c₀)``, s² = 2 sigma² of a deflection's coordinate."""
    robot, measurements = pulls[0], replace(pulls[1], sigma=sigma)
    found = estimate(robot, measurements, priors=PRIORS, positive=False)
    alone = estimate(robot, measurements, positive=False)
    assert found.sigma == alone.sigma  # a prior tells nothing of sigma
    (block,) = regressor_blocks(robot, measurements)
    A, d = block.A.reshape(-1, 6), measurements.deflection.ravel()
    known = np.zeros(6)
    known[[1, 4]] = [(3e6**2 / 1e6) ** 2, (4e5**2 / 4e4) ** 2]
    unit = np.linalg.norm(A, axis=0)
    information = A.T @ A / (2 * found.sigma**2) + np.diag(known)
    moment = A.T @ d / (2 * found.sigma**2) + known / np.array([1, 3e6, 1, 1, 4e5, 1])
    expected = np.linalg.solve(information / np.outer(unit, unit), moment / unit) / unit
    np.testing.assert_allclose(found.compliance, expected, rtol=1e-9)
    covariance = np.linalg.inv(information / np.outer(unit, unit)) / np.outer(unit, unit)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-7, atol=1e-22)
    for j, (k, u) in {4: STIFFNESS["joint_5"], 1: STIFFNESS["joint_2"]}.items():
        ratio = (k**2 / u) ** 2 * alone.joints[j].standard_uncertainty ** 2
        assert found.joints[j].prior_to_data == pytest.approx(ratio, rel=1e-9)
    assert found.joints[0].prior_to_data is None
    complete = estimate(robot, measurements, priors=PRIORS, positive=False, method="complete_pose")
    np.testing.assert_allclose(complete.compliance, expected, rtol=1e-8)


def test_a_joint_that_nothing_was_measured_of_has_no_number():
    robot, measurements = simulated(load="dead_weight", seed=4)
    found = estimate(robot, measurements, priors={"joint_1": PRIORS["joint_2"]})
    joint = found.joints[0]
    assert (joint.status, joint.compliance, joint.prior_to_data) == ("not_observable", None, None)
    assert "never twists" in joint.reason
    assert "prior" in joint.reason
    np.testing.assert_allclose(found.compliance, estimate(robot, measurements).compliance, rtol=1e-12)


def test_a_combination_that_the_prior_tells_apart():
    """Two joints on one axis: their sum is measured, the prior of one leaves the rest to the other."""
    campaign = simulated(load="pull", seed=3)
    whole = estimate(*campaign)
    prior = {"twin": {"stiffness": 1e7, "standard_uncertainty": 1e5}}
    found = estimate(*twins(*campaign), priors=prior)
    assert [joint.status for joint in found.joints[:2]] == ["identified"] * 2
    np.testing.assert_allclose(found.compliance[:2], [whole.compliance[0] - 1e-7, 1e-7], rtol=1e-6)
    assert found.joints[1].prior_to_data == np.inf
    message = message_of(JointResult, found.joints[1], verdict="use", budget=None)
    assert message.prior_to_data is None
    assert "only its prior separates them" in message.reason
    assert found.identifiability[0].rank == 6  # of the readings, whatever the prior adds
    assert "prior_dominates" in {finding.code for finding in judge(found)}


def test_a_prior_that_outweighs_the_readings_is_a_warning(pulls):
    robot, measurements = pulls
    for uncertainty, warned in ((1.0, True), (1.9e5, False)):
        prior = {"joint_5": {"stiffness": 4e5, "standard_uncertainty": uncertainty}}
        found = estimate(robot, replace(measurements, sigma=1e-7), priors=prior)
        codes = {finding.code for finding in judge(found)}
        assert ("prior_dominates" in codes) == warned == (found.joints[4].prior_to_data > 1)


class TestRefusals:
    def test_without_sigma_and_degrees_of_freedom(self, pulls):
        robot, measurements = pulls
        with pytest.raises(UnsupportedMethodError, match="a prior needs sigma"):
            # Two observations of one target: as many readings as joints.
            estimate(robot, first_target(replace(measurements[:2], sigma=None)), priors=PRIORS)

    @pytest.mark.parametrize("uncertainty", [0.0, -1.0, np.nan, np.inf])
    def test_an_uncertainty_that_is_none(self, uncertainty):
        with pytest.raises(RequestError, match="not positive"):
            Prior(np.array([1.0]), np.array([uncertainty]))


NAMES = ("a", "b", "c", "d")


class TestVisibleJoints:
    def test_joints_without_a_trace_are_left_out(self):
        found = estimate(*simulated(load="dead_weight", seed=4))
        assert found.joints[0].status == "not_observable"
        R, observability = found.regressor[:, 1:], visibility_of(found.observability.excitation[1:])
        assert observability_indices(found.regressor, found.observability) == observability_indices(
            R, observability
        )

    def test_no_index_where_joints_show_only_together(self):
        assert observability_indices(np.ones((4, 2)), visibility_of(np.ones(2))) is None


class TestCombinations:
    @staticmethod
    def analysed(*columns):
        R = np.column_stack(columns)
        return analyse(Spectrum(R), np.arange(R.shape[1]))

    def test_sums_of_three(self):
        u, v = np.random.default_rng(0).standard_normal((2, 9))
        for columns, words in (
            ((u, v, 2 * u, -3 * u), "c(a) + 2 c(c) - 3 c(d)"),
            ((u, v, 0.5 * u + 4 * v), "c(a) + 0.5 c(c) and c(b) + 4 c(c)"),
        ):
            (group,) = self.analysed(*columns).combinations
            assert group.in_words(NAMES) == words

    @examples(60)
    @given(seed=st.integers(0, 2**32 - 1), seen=st.integers(1, 3))
    def test_sums_tell_all_that_the_readings_do(self, seed, seen):
        """Every row of the regressor is made of the sums, and there are no more of them than its rank."""
        rng = np.random.default_rng(seed)
        R = rng.standard_normal((9, seen)) @ rng.standard_normal((seen, 4)) * 10.0 ** rng.uniform(-3, 3, 4)
        norms = np.linalg.norm(R, axis=0)
        null = np.linalg.svd(R / norms)[2][seen:]
        assume((np.abs(null.T @ null) > 1e-4).all())  # a joint that takes no part is none of the group
        (group,) = self.analysed(*R.T).combinations
        assert group.seen.shape == (seen, 4)
        sums, rows = group.seen / norms, R / norms
        left = rows - rows @ np.linalg.pinv(sums) @ sums
        assert np.abs(left).max() < 1e-7

    def test_a_wrist_that_is_nearly_straight(self):
        (analysis,) = estimate(*straight_wrist(2e-3)).identifiability
        assert analysis.condition_number > 100
        assert analysis.weakest.joints == (3, 5)
        np.testing.assert_allclose(analysis.weakest.change, [1, -1], atol=0.05)
        words = analysis.weakest.in_words([f"joint_{i + 1}" for i in range(6)])
        assert words.startswith("joint_4, joint_6 are hard to distinguish")

    def test_the_weakest_direction_is_one_of_compliances(self):
        """Columns u and 10 u + little: c_0 up by 1 and c_1 down by 0.1 is what hardly shows."""
        u, v = np.linalg.qr(np.random.default_rng(0).standard_normal((9, 2)))[0].T
        weakest = self.analysed(u, 10 * (u + 1e-3 * v)).weakest
        np.testing.assert_allclose(weakest.change, [1, -0.1], rtol=1e-3)
        assert weakest.attenuation == pytest.approx(2e3, rel=1e-3)

    @pytest.mark.parametrize(
        ("factor", "words"),
        [
            (1.0, "c(a) + c(c)"),
            (0.8, "c(a) + 0.8 c(c)"),
            (-2.5, "c(a) - 2.5 c(c)"),
            (3e6, "c(a) + 3e+06 c(c)"),
        ],
    )
    def test_two_joints_in_their_proportion(self, factor, words):
        u, v = np.random.default_rng(0).standard_normal((2, 9))
        (group,) = self.analysed(u, v, factor * u).combinations
        assert group.joints == (0, 2)
        assert f"only a combination of a, c is observable, {words}: add" in group.reason(NAMES)


def visibility_of(excitation):
    n = len(excitation)
    kinds = ("revolute",) * n
    return Observability(np.zeros(n, dtype=bool), np.ones(n), (None,) * n, excitation, np.ones(n), kinds)


def test_a_stated_sigma_is_tested_on_both_sides():
    tails = {0.3: "consistent", 0.004: "residuals_too_large", 0.996: "residuals_too_small"}
    for tail, verdict in tails.items():
        found = sigma_test(float(stats.chi2.isf(tail, 100)), 100.0)
        assert (found.verdict, found.p_value) == (verdict, pytest.approx(2.0 * min(tail, 1.0 - tail)))
    assert sigma_test(0.0, 0.0) is None


def test_noise_that_hides_a_joint_is_told_with_the_torques():
    """A base that leans by 1e-5 rad gives joint 1 a torque, but no information."""
    robot, upright = simulated(load="dead_weight", seed=4)
    lean = np.array([[1, 0, 1e-5], [0, 1, 0], [-1e-5, 0, 1]])
    m = replace(upright, force=upright.force @ lean.T)
    found, expected = estimate(robot, m), estimate(robot, upright)
    most = np.abs(torques(ARM, m.joints, m.force, m.moment, m.load_point)).max(axis=0)
    strongest = int(most.argmax())
    greatest = round(most[strongest], -2)
    told = f"at most {most[0]:.2g} N.m, and joint_{strongest + 1} with up to {greatest:.0f} N.m:"
    assert found.joints[0].status == "not_observable"
    assert "joint_1 is hidden by noise" in found.joints[0].reason
    assert told in found.joints[0].reason
    np.testing.assert_allclose(found.compliance[1:], expected.compliance[1:], rtol=1e-2)
