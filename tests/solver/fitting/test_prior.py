"""Priors against Bayes' rule in closed form, and everything they must not do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import (
    assert_covariance,
    covariance_by_moving,
    estimate,
    first_target,
    settings_of,
    simulated,
    twins,
)

from jointstiff.schemas.run import JointResult
from jointstiff.solver.errors import RequestError, UnsupportedMethodError
from jointstiff.solver.estimate import identify
from jointstiff.solver.evidence.assessment import judge
from jointstiff.solver.fitting.settings import Prior
from jointstiff.solver.messages import message as message_of
from jointstiff.solver.terms.block import regressor_blocks

STIFFNESS = {"joint_5": (4e5, 4e4), "joint_2": (3e6, 1e6)}
PRIORS = {name: {"stiffness": k, "standard_uncertainty": u} for name, (k, u) in STIFFNESS.items()}


@pytest.fixture(scope="module")
def pulls():
    return simulated(load="pull", configurations=6, force=150.0, seed=3)


def test_conversion_to_first_order(pulls):
    prior = settings_of(pulls[0], priors=PRIORS).prior
    np.testing.assert_array_equal(prior.known, [False, True, False, False, True, False])
    assert prior.mean[4] == 1 / 4e5
    np.testing.assert_allclose(prior.standard_uncertainty[4], 4e4 / 4e5**2, rtol=1e-14)


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


def test_decoupled_covariance_is_that_of_the_linear_estimator(pulls):
    """ĉ = H d + H₀ c₀, found by moving each reading and each prior: sigma² (2 H Hᵀ) + H₀ S₀ H₀ᵀ."""
    robot, measurements = pulls
    settings = settings_of(robot, priors=PRIORS, positive=False, method="decoupled_partial_pose")
    known = settings.prior.standard_uncertainty

    def compliance(deflection=measurements.deflection, mean=settings.prior.mean):
        changed = replace(settings, prior=Prior(mean, known))
        return identify(robot, replace(measurements, deflection=deflection), changed).compliance

    expected = covariance_by_moving(
        compliance,
        deflection=(measurements.deflection, np.sqrt(2) * measurements.sigma),
        mean=(settings.prior.mean, np.where(settings.prior.known, known, 0.0)),
    )
    assert_covariance(identify(robot, measurements, settings).covariance, expected, atol=1e-6)


@pytest.mark.parametrize("method", ["partial_pose", "decoupled_partial_pose"])
def test_limits(pulls, method):
    """A vague prior says nothing, a sharp one everything of its joint."""
    robot, measurements = pulls
    alone = estimate(robot, measurements, method=method)
    settings = settings_of(robot, method=method)
    mean, unknown = np.full(6, np.nan), np.full(6, np.inf)
    mean[4] = 2.5e-6
    for uncertainty, expected in ((1e3, alone.compliance[4]), (1e-16, 2.5e-6)):
        unknown[4] = uncertainty
        found = identify(robot, measurements, replace(settings, prior=Prior(mean.copy(), unknown.copy())))
        np.testing.assert_allclose(found.compliance[4], expected, rtol=1e-6)
    if method == "partial_pose":  # what the prior answered, the readings were not asked for
        assert found.degrees_of_freedom == pytest.approx(alone.degrees_of_freedom + 1, abs=1e-3)


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
    @pytest.mark.parametrize("weighting", ["uniform", "characteristic_length"])
    def test_other_weightings(self, pulls, weighting):
        with pytest.raises(UnsupportedMethodError, match=r"^weighting: .* weigh a prior against"):
            estimate(*pulls, priors=PRIORS, weighting=weighting, method="complete_pose")

    def test_without_sigma_and_degrees_of_freedom(self, pulls):
        robot, measurements = pulls
        with pytest.raises(UnsupportedMethodError, match="a prior needs sigma"):
            # Two observations of one target: as many readings as joints.
            estimate(robot, first_target(replace(measurements[:2], sigma=None)), priors=PRIORS)

    def test_of_a_joint_that_the_robot_does_not_have(self, pulls):
        with pytest.raises(RequestError, match="no joint 'joint_9'"):
            settings_of(pulls[0], priors={"joint_9": PRIORS["joint_2"]})

    @pytest.mark.parametrize("uncertainty", [0.0, -1.0, np.nan, np.inf])
    def test_an_uncertainty_that_is_none(self, uncertainty):
        with pytest.raises(RequestError, match="not positive"):
            Prior(np.array([1.0]), np.array([uncertainty]))
