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
    POINTS,
    assert_covariance,
    covariance_by_moving,
    estimate,
    first_target,
    settings_of,
    simulated,
    spring_columns,
    straight_wrist,
    twins,
)
from support.examples import examples

from jointstiff.schemas.run import JointResult
from jointstiff.simulator.campaign import torques
from jointstiff.solver.errors import RequestError, UnsupportedMethodError
from jointstiff.solver.estimate import identify
from jointstiff.solver.evidence.assessment import judge
from jointstiff.solver.fitting.fit import sigma_test
from jointstiff.solver.fitting.method import Prior
from jointstiff.solver.fitting.observability import (
    Observability,
    Spectrum,
    analyse,
    indices_by,
    observability_indices,
)
from jointstiff.solver.messages import message as message_of
from jointstiff.solver.robot.model import ChainJoint, KinematicChain, Robot
from jointstiff.solver.terms.block import regressor_blocks

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


NAMES = ("a", "b", "c", "d")


@pytest.fixture(scope="module")
def exact_pulls():
    return simulated(load="pull", configurations=9, moment=200.0, sigma=0.0, seed=3)


def indices_of(robot, measurements, **options):
    found = estimate(robot, measurements, **options)
    return np.array(list(dict(observability_indices(found.regressor, found.observability)).values()))


def test_definitions_on_powers_of_two():
    found = indices_by(np.array([1.0, 0.5, 0.25]))
    assert found.o1 == pytest.approx(0.5, rel=1e-15)
    assert (found.o2, found.o3, found.o4) == (0.25, 0.25, 0.0625)
    assert found.o5 == pytest.approx(1 / 7, rel=1e-15)


class TestScale:
    @pytest.mark.parametrize("method", ["partial_pose", "decoupled_partial_pose"])
    def test_columns_are_shares_of_what_the_levers_allow(self, exact_pulls, method):
        """Regressor and levers from the simulator; the indices do not depend on the method."""
        _, m = exact_pulls
        columns = spring_columns(m).reshape(-1, 6)
        posture = ARM.posture(m.joints)
        lever = np.linalg.norm(posture.velocities(posture.point_to_base(m.load_point)), axis=-1)
        force, moment = (np.linalg.norm(x, axis=1)[:, None] for x in (m.force, m.moment))
        places = np.moveaxis(posture.targets_to_base(POINTS), 1, 0)
        seen = [np.linalg.norm(posture.velocities(place), axis=-1) for place in places]
        potential = ((lever * force + moment) ** 2 * np.square(seen).sum(axis=0)).sum(axis=0)
        s = np.linalg.svd(columns / np.sqrt(potential), compute_uv=False)
        least, most = s.min(), s.max()
        expected = [np.prod(s) ** (1 / 6), least / most, least, least**2 / most, 1 / (1 / s).sum()]
        np.testing.assert_allclose(indices_of(*exact_pulls, method=method), expected, rtol=1e-7)

    def test_one_joint_pulled_across_its_lever_is_seen_as_well_as_can_be(self):
        z = np.array([0.0, 0.0, 1.0])
        arm = ChainJoint("arm", "revolute", np.eye(3), np.zeros(3), z, None, "tip")
        robot = Robot(KinematicChain("one", "base", "tip", (arm,)))
        _, example = simulated(load="pull", configurations=3)
        angles = np.array([[0.0], [0.5], [2.0]])
        across = np.hstack([-np.sin(angles), np.cos(angles), 0 * angles])
        along = np.hstack([np.cos(angles), np.sin(angles), 0 * angles])
        at_tip = replace(example, joints=angles, load_point=np.tile([2.0, 0.0, 0.0], (3, 1)))
        best = replace(at_tip, force=800.0 * across)
        assert indices_of(robot, best) == pytest.approx([1.0] * 5, rel=1e-12)
        half = replace(at_tip, force=800.0 * (0.5 * across + np.sqrt(0.75) * along))
        assert indices_of(robot, half) == pytest.approx([0.5, 1.0, 0.5, 0.5, 0.5], rel=1e-12)


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
        return analyse(Spectrum(R), np.arange(R.shape[1]), R.shape[1])

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

    def test_nothing_is_weak_where_all_shows_well(self, exact_pulls):
        assert estimate(*exact_pulls).identifiability[0].weakest is None


def test_noise_that_hides_a_joint_is_told_with_the_torques():
    """A base that leans by 1e-5 rad gives joint 1 a torque, but no information."""
    robot, upright = simulated(load="dead_weight", seed=4)
    lean = np.array([[1, 0, 1e-5], [0, 1, 0], [-1e-5, 0, 1]])
    m = replace(upright, force=upright.force @ lean.T)
    found, expected = estimate(robot, m), estimate(robot, upright)
    most = np.abs(torques(ARM, m.joints, m.force, m.moment, m.load_point)).max(axis=0)
    strongest = int(most.argmax())
    told = f"at most {most[0]:.2g} N.m, and joint_{strongest + 1} with up to {most[strongest]:.2g} N.m:"
    assert found.joints[0].status == "not_observable"
    assert "joint_1 is hidden by noise" in found.joints[0].reason
    assert told in found.joints[0].reason
    np.testing.assert_allclose(found.compliance[1:], expected.compliance[1:], rtol=1e-2)


def visibility_of(excitation):
    n = len(excitation)
    kinds = ("revolute",) * n
    return Observability(np.zeros(n, dtype=bool), np.ones(n), (None,) * n, excitation, np.ones(n), kinds)


def test_the_inverse_of_a_spectrum_is_the_pseudo_inverse():
    """Also where a column is a combination of others, in units of its own."""
    rng = np.random.default_rng(3)
    R = rng.standard_normal((8, 3))
    assert Spectrum(R).inverse == pytest.approx(np.linalg.solve(R.T @ R, R.T), abs=1e-12)
    lost = np.hstack([R, R[:, :1]])
    twice = Spectrum(lost).inverse
    assert lost @ twice @ lost == pytest.approx(lost, abs=1e-12)
    wide = Spectrum(R[:2])
    assert wide.null_space.shape == (1, 3)
    assert R[:2] / wide.scale @ wide.null_space.T == pytest.approx(np.zeros((2, 1)), abs=1e-12)


def test_a_stated_sigma_is_tested_on_both_sides():
    tails = {0.3: "consistent", 0.004: "residuals_too_large", 0.996: "residuals_too_small"}
    for tail, verdict in tails.items():
        found = sigma_test(float(stats.chi2.isf(tail, 100)), 100.0)
        assert (found.verdict, found.p_value) == (verdict, pytest.approx(2.0 * min(tail, 1.0 - tail)))
    assert sigma_test(0.0, 0.0) is None
