"""Errors that a posture's targets share: found, weighted as one reading, and no excuse for mistakes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support.springs import SIGMA, SpringCampaign, robot_of

from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import TARGETS, default_arm, deflections
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.scatter import (
    ASSUMED_REPEATABILITY,
    ASSUMED_STATION_ERROR,
    Repeatability,
    RestrictedLikelihood,
    compute_target_motion,
)
from jointstiff.solver.evidence.term_tests import LINKS_LEVEL
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.block import get_whole_block
from jointstiff.solver.mechanics.measurements import Scatter
from jointstiff.solver.mechanics.springs import JOINTS

ARM = default_arm()
ROBOT = robot_of(ARM)
SETTINGS = Settings.from_options(RunOptions(complementary_stiffness="neglected"), ROBOT)
POINTS = np.array(list(TARGETS.values()))


def scattered(scatter, *, seed=0, station=0.0, sigma=SIGMA, count=24):
    """Readings of joints that come back with a standard deviation [rad], and of a station that errs [m]."""
    campaign = SpringCampaign.of(ARM, configurations=count, seed=seed)
    generator, plan = np.random.default_rng([seed, 3]), campaign.experiment
    joints = plan.joints + scatter * generator.standard_normal(plan.joints.shape)
    loaded = deflections(ARM, joints, *plan.wrenches, POINTS)[1]
    loaded = loaded + station * generator.standard_normal((count, 1, 3))
    noise = SIGMA * generator.standard_normal((2, *loaded.shape))
    return campaign.measurements(campaign.unloaded + noise[0], loaded + noise[1], sigma=sigma)


@pytest.mark.parametrize("sigma", [SIGMA, None])
@pytest.mark.parametrize("planted", [1e-5, 2e-5, 4e-5])
def test_the_repeatability_of_the_joints_is_found(planted, sigma):
    found = []
    for seed in range(4):
        joints = JointsAlone(Rows(ROBOT, scattered(planted, seed=seed, sigma=sigma)), SETTINGS)
        found.append(Repeatability.from_rows(joints.rows, joints.estimate.sigma).joint)
    assert np.mean(found) == pytest.approx(planted, rel=0.25)


@pytest.mark.parametrize("sigma", [SIGMA, None])
def test_joints_that_repeat_show_no_scatter(sigma):
    for seed in range(6):
        joints = JointsAlone(Rows(ROBOT, scattered(0.0, seed=seed, sigma=sigma)), SETTINGS)
        assert not joints.shows_scatter
        assert Repeatability.from_rows(joints.rows, joints.estimate.sigma) is None


def test_a_scatter_that_is_only_assumed_never_excuses_or_doubts_a_stated_sigma():
    """The residuals are tested under the stated noise alone, whatever errors the intervals allow for."""
    for factor in (1.0, 1.6, 1.0 / 1.6):
        measurements = scattered(0.0, sigma=factor * SIGMA)
        joints = JointsAlone(Rows(ROBOT, measurements), SETTINGS)
        assert not joints.shows_scatter
        alone = identify(Rows(ROBOT, measurements), SETTINGS)
        assert joints.estimate.sigma_test == alone.sigma_test


def test_a_repeatability_that_is_not_significant_widens_the_intervals():
    measurements = scattered(0.0, count=6)
    joints = JointsAlone(Rows(ROBOT, measurements), SETTINGS)
    assert not joints.shows_scatter
    exact = identify(Rows(ROBOT, measurements), SETTINGS)
    ratio = np.sqrt(np.diag(joints.estimate.covariance) / np.diag(exact.covariance))
    assert (ratio > 1.0).all()
    assert np.median(ratio) < 1.3


@pytest.mark.parametrize("sigma", [SIGMA, None])
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_readings_correct_a_stated_repeatability(factor, sigma):
    """Twenty-four postures know the repeatability better than a figure that is wrong by a factor of two."""
    found = []
    for seed in range(4):
        measurements = replace(scattered(3e-5, seed=seed, sigma=sigma), repeatability=factor * 3e-5)
        if sigma:
            measurements = replace(measurements, scatter=Scatter(factor * 3e-5 / sigma))
        joints = JointsAlone(Rows(ROBOT, measurements), SETTINGS)
        found.append(joints.measurements.scatter.joints * joints.estimate.sigma)
    assert np.mean(found) == pytest.approx(3e-5, rel=0.2)


def test_a_repeatability_that_is_stated_as_zero_is_exact():
    joints = JointsAlone(Rows(ROBOT, replace(scattered(0.0), repeatability=0.0)), SETTINGS)
    assert joints.measurements.scatter.joints == 0.0


def test_the_error_of_a_station_is_not_taken_for_that_of_three_targets():
    joints = JointsAlone(Rows(ROBOT, scattered(0.0, station=5e-5)), SETTINGS)
    assert joints.measurements.scatter.station * SIGMA == pytest.approx(5e-5, rel=0.3)


def test_the_motion_of_the_targets_is_that_of_drawn_shifts_and_joints():
    """Shifts along three axes and turns of six joints, drawn and moved by the simulator."""
    generator, plan = np.random.default_rng(4), SpringCampaign.of(ARM, configurations=24).experiment
    scatter, squares = Scatter(joints=1.5, station=2.0), []
    for _ in range(400):
        joints = plan.joints + scatter.joints * SIGMA * generator.standard_normal(plan.joints.shape)
        shift = scatter.station * SIGMA * generator.standard_normal((24, 1, 3))
        at, moved = (ARM.posture(each).targets_to_base(POINTS) for each in (plan.joints, joints))
        squares.append(np.square(moved - at + shift).sum(axis=-1).mean())
    block = get_whole_block(ROBOT, scattered(0.0))
    assert compute_target_motion(block, scatter, SIGMA) == pytest.approx(np.sqrt(np.mean(squares)), rel=0.02)


def test_a_fit_with_scatter_is_generalised_least_squares():
    """Independent of whitening: the estimate and its covariance by the inverse of the whole covariance."""
    scatter = Scatter(joints=1.2, station=0.7)
    measurements = replace(scattered(2e-5), scatter=scatter)
    found = identify(Rows(ROBOT, measurements), SETTINGS)
    block = get_whole_block(ROBOT, measurements)
    A, J = (each.reshape(len(measurements), -1, ROBOT.n) for each in (block.A, block.jacobian))
    d = measurements.deflection.reshape(len(measurements), -1)
    ones = np.tile(np.eye(3), (len(POINTS), 1))
    V = 2.0 * np.eye(d.shape[1]) + scatter.joints**2 * J @ J.mT + scatter.station**2 * ones @ ones.T
    N = (A.mT @ np.linalg.solve(V, A)).sum(axis=0)
    expected = np.linalg.solve(N, (A.mT @ np.linalg.solve(V, d[..., None])).sum(axis=0))[:, 0]
    np.testing.assert_allclose(found.compliance, expected, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, SIGMA**2 * np.linalg.inv(N), rtol=1e-8)


def test_the_posterior_is_the_restricted_likelihood_of_whole_covariances_times_the_priors():
    """Independent of eigenvectors: each node by the inverse and the determinant of the whole covariance."""
    measurements = scattered(2e-5, count=8)
    rows = Rows(ROBOT, measurements)
    compliance = identify(rows, SETTINGS).compliance
    likelihood = RestrictedLikelihood.from_rows(rows, [JOINTS], compliance, np.ones(ROBOT.n, dtype=bool))
    posterior = likelihood.compute_posterior(likelihood.find_significant()[0])
    block = get_whole_block(ROBOT, measurements)
    A, J = (each.reshape(len(measurements), -1, ROBOT.n) for each in (block.A, block.jacobian))
    d = measurements.deflection.reshape(len(measurements), -1, 1)
    ones = np.tile(np.eye(3), (len(POINTS), 1))
    expected = np.empty((len(posterior.turns), len(posterior.station)))
    for s, turn in enumerate(posterior.turns):
        for u, shift in enumerate(posterior.station):
            V = SIGMA**2 * (2.0 * np.eye(d.shape[1]) + turn**2 * J @ J.mT + shift**2 * ones @ ones.T)
            N = (A.mT @ np.linalg.solve(V, A)).sum(axis=0)
            fit = np.linalg.solve(N, (A.mT @ np.linalg.solve(V, d)).sum(axis=0))
            r = d - A @ fit
            squares = (r.mT @ np.linalg.solve(V, r)).sum()
            log_likelihood = -0.5 * (np.linalg.slogdet(V)[1].sum() + squares + np.linalg.slogdet(N)[1])
            of_turns = stats.cauchy.logpdf(turn * SIGMA / ASSUMED_REPEATABILITY)
            of_station = stats.cauchy.logpdf(shift * SIGMA / ASSUMED_STATION_ERROR)
            expected[s, u] = log_likelihood + of_turns + of_station
    found = posterior.density.reshape(expected.shape)
    np.testing.assert_allclose(found, np.exp(expected - expected.max()), rtol=1e-6, atol=1e-9)


def test_a_further_posture_without_shared_errors_has_its_expected_likelihood():
    """By the inverse of the whole covariance: ``−½ (log|V| + tr V⁻¹)``, in units of the noise, on average."""
    measurements = scattered(0.0, count=8)
    rows = Rows(ROBOT, measurements)
    compliance = identify(rows, SETTINGS).compliance
    likelihood = RestrictedLikelihood.from_rows(rows, [JOINTS], compliance, np.ones(ROBOT.n, dtype=bool))
    posterior = likelihood.compute_posterior(likelihood.find_significant()[0])
    J = get_whole_block(ROBOT, measurements).jacobian.reshape(len(measurements), -1, ROBOT.n)
    ones, noise = np.tile(np.eye(3), (len(POINTS), 1)), np.eye(J.shape[1])
    expected = np.empty((len(posterior.turns), len(posterior.station)))
    for s, turn in enumerate(posterior.turns):
        for u, shift in enumerate(posterior.station):
            V = noise + 0.5 * (turn**2 * J @ J.mT + shift**2 * ones @ ones.T)
            traces = np.trace(np.linalg.inv(V), axis1=1, axis2=2)
            expected[s, u] = -0.5 * (np.linalg.slogdet(V)[1] + traces).mean()
    found = posterior.motions.expect_without_shared_errors(posterior.turns, posterior.station)
    found = found.reshape(expected.shape)
    np.testing.assert_allclose(found - found[0, 0], expected - expected[0, 0], rtol=1e-3, atol=1e-3)


def test_the_scatter_of_more_readings_is_foreseen():
    """The prior leaves less and less where readings show nothing."""
    foreseen, found = [], []
    for seed in range(8):
        whole = scattered(0.0, seed=seed)
        few = JointsAlone(Rows(ROBOT, whole[:6]), SETTINGS).identified
        now = few.posterior.expect(0).scatter
        assert now.joints == pytest.approx(few.rows.measurements.scatter.joints, rel=0.1)
        later = few.posterior.expect(18).scatter
        assert later.joints < now.joints
        foreseen.append(later.joints)
        found.append(JointsAlone(Rows(ROBOT, whole), SETTINGS).rows.measurements.scatter.joints)
    assert np.mean(foreseen) == pytest.approx(np.mean(found), rel=0.3)


def test_complete_and_partial_pose_agree_with_scatter():
    """Three targets of all coordinates tell as much as their pose, whatever they share."""
    measurements = replace(scattered(2e-5), scatter=Scatter(1.0, 0.5))
    complete = Settings.from_options(
        RunOptions(method="complete_pose", complementary_stiffness="neglected"), ROBOT
    )
    np.testing.assert_allclose(
        identify(Rows(ROBOT, measurements), complete).compliance,
        identify(Rows(ROBOT, measurements), SETTINGS).compliance,
        rtol=1e-8,
    )


def test_equal_weights_stay_equal_with_scatter():
    measurements = scattered(2e-5)
    uniform = Settings.from_options(
        RunOptions(weighting="uniform", complementary_stiffness="neglected"), ROBOT
    )
    plain = identify(Rows(ROBOT, measurements), uniform)
    shared = identify(Rows(ROBOT, measurements).with_scatter(Scatter(1.0, 0.5)), uniform)
    np.testing.assert_allclose(shared.compliance, plain.compliance, rtol=1e-9)
    assert (np.diag(shared.covariance) > np.diag(plain.covariance)).all()


@pytest.mark.parametrize("station", [5e-5, 1e-4])
def test_the_scatter_of_few_postures_is_not_taken_for_links(station):
    """The links' many unknowns explain such a scatter, so that no scatter would seem to be left with them."""
    for seed in (1, 5, 12, 13, 22):
        measurements = scattered(0.0, seed=seed, station=station, count=7)
        joints = JointsAlone(Rows(ROBOT, measurements), SETTINGS)
        assert joints.screening.links_p_value > LINKS_LEVEL


def test_one_wrong_posture_is_no_scatter():
    measurements = scattered(0.0)
    off = measurements.deflection.copy()
    off[7] += 2e-3
    joints = JointsAlone(Rows(ROBOT, replace(measurements, deflection=off)), SETTINGS)
    assert not joints.measurements.scatter


def test_an_unknown_that_only_a_wrong_posture_shows_changes_no_likelihood_of_the_others():
    measurements = scattered(2e-5, count=8)
    off = measurements.deflection.copy()
    off[7] += 2e-3
    rows = Rows(ROBOT, replace(measurements, deflection=off))
    stack = rows.stack([JOINTS], identify(rows, SETTINGS).compliance)
    column = np.zeros((*stack.rows.shape[:2], 1))
    column[7, 0] = 1.0
    more = replace(
        stack,
        rows=np.concatenate([stack.rows[..., :-1], column, stack.rows[..., -1:]], axis=-1),
        widths=stack.widths | {"shown once": 1},
    )
    likelihoods = (
        RestrictedLikelihood(rows.block, each, np.arange(each.rows.shape[-1] - 1)) for each in (stack, more)
    )
    without, with_unknown = (likelihood.fit_shared_errors() for likelihood in likelihoods)
    assert with_unknown[0].joints == pytest.approx(without[0].joints, rel=1e-4)
    assert with_unknown[1] == pytest.approx(without[1], rel=1e-6)


def test_residuals_beyond_any_robot_in_order_are_no_scatter():
    assert not JointsAlone(Rows(ROBOT, scattered(5e-4)), SETTINGS).measurements.scatter


@pytest.mark.parametrize("sigma", [SIGMA, None])
def test_a_repeatability_that_is_stated_is_used(sigma):
    measurements = replace(scattered(3e-5, sigma=sigma), repeatability=3e-5)
    if sigma:
        measurements = replace(measurements, scatter=Scatter(3e-5 / sigma))
    joints = JointsAlone(Rows(ROBOT, measurements), SETTINGS)
    found = Repeatability.from_rows(joints.rows, joints.estimate.sigma)
    assert found.source == "given"
    assert found.joint == pytest.approx(3e-5, rel=1e-9 if sigma else 0.1)


def test_a_stated_repeatability_excuses_no_larger_errors():
    """0.4 mm of a station are no repeatability of 10 µrad."""
    measurements = replace(scattered(0.0, station=4e-4), repeatability=1e-5, scatter=Scatter(1e-5 / SIGMA))
    joints = JointsAlone(Rows(ROBOT, measurements), SETTINGS)
    assert joints.measurements.scatter == Scatter(1e-5 / SIGMA)
    assert joints.estimate.sigma_test.result == "residuals_too_large"


def test_a_straight_wrist_hides_no_scatter():
    """Axes 4 and 6 coincide in every posture: their columns depend on each other."""
    found = []
    for seed in range(4):
        campaign = SpringCampaign.of(ARM, configurations=24, seed=seed)
        plan = replace(
            campaign.experiment, joints=campaign.experiment.joints * [1.0, 1.0, 1.0, 1.0, 0.0, 1.0]
        )
        generator = np.random.default_rng([seed, 5])
        turned = plan.joints + 1.2e-5 * generator.standard_normal(plan.joints.shape)
        straight = SpringCampaign.by(ARM, plan)
        loaded = deflections(ARM, turned, *plan.wrenches, POINTS)[1]
        noise = SIGMA * generator.standard_normal((2, *loaded.shape))
        read = straight.measurements(straight.unloaded + noise[0], loaded + noise[1], sigma=SIGMA)
        joints = JointsAlone(Rows(ROBOT, read), SETTINGS)
        found.append(joints.measurements.scatter.joints * SIGMA)
    assert np.mean(found) == pytest.approx(1.2e-5, rel=0.3)


def test_noise_of_one_target_that_is_stated_too_small_is_no_scatter():
    for seed in range(4):
        measurements = scattered(0.0, seed=seed, sigma=SIGMA / 1.6, count=30)
        one = replace(measurements, present=np.arange(3) == np.zeros((30, 1)))
        one = replace(one, deflection=np.where(one.present[..., None], one.deflection, 0.0))
        joints = JointsAlone(Rows(ROBOT, one), SETTINGS)
        assert not joints.shows_scatter
        assert joints.estimate.sigma_test.result == "residuals_too_large"


@pytest.mark.parametrize("stated", [-1e-6, np.nan, np.inf])
def test_a_repeatability_that_is_none_is_refused(stated):
    with pytest.raises(MeasurementError, match="repeatability"):
        replace(scattered(0.0), repeatability=stated)


def test_one_unsteady_joint_has_a_scatter_of_its_own():
    """Joint 1 returns to 60 µrad, the others exactly."""
    turns = 6e-5 * np.eye(6)[0]
    for seed in range(3):
        joints = JointsAlone(Rows(ROBOT, scattered(turns, seed=seed)), SETTINGS)
        scatter = joints.rows.measurements.scatter
        found = SIGMA * scatter.list_turns(6)
        assert found.argmax() == 0
        assert found[0] == pytest.approx(6e-5, rel=0.5)
        assert np.all(found[1:] < 0.8 * found[0])


def shared_readings(postures, loads, seed=0):
    """Readings of several loads in each posture, whose unloaded targets are read once."""
    campaign = SpringCampaign.of(ARM, configurations=postures * loads, seed=seed)
    plan, generator = campaign.experiment, np.random.default_rng([seed, 5])
    joints = np.repeat(plan.joints[:postures], loads, axis=0)
    unloaded, loaded = deflections(ARM, joints, *plan.wrenches, POINTS)
    noise_of_postures = SIGMA * generator.standard_normal((postures, *unloaded.shape[1:]))
    unloaded = unloaded + np.repeat(noise_of_postures, loads, axis=0)
    loaded = loaded + SIGMA * generator.standard_normal(loaded.shape)
    read = campaign.measurements(unloaded, loaded, sigma=SIGMA)
    return replace(read, joints=joints, position=unloaded, deflection=loaded - unloaded)


@pytest.mark.parametrize("scatter", [Scatter(), Scatter(joints=1.0, station=0.5)])
def test_deflections_that_share_an_unloaded_reading_are_whitened_by_their_whole_covariance(scatter):
    """Three loads in each of two postures: ``½ (I + 1 1ᵀ)`` for the noise; a load has shared errors anew."""
    measurements = replace(shared_readings(2, 3), scatter=scatter)
    assert measurements.number_unloaded_readings().tolist() in ([0, 0, 0, 1, 1, 1], [1, 1, 1, 0, 0, 0])
    block = get_whole_block(ROBOT, measurements)
    by_joints, by_station = (motion[0] for motion in block.shared_motion)
    G = np.concatenate([scatter.joints * by_joints, scatter.station * by_station], axis=-1)
    size = len(G)
    covariance = np.kron(0.5 * (np.eye(3) + 1.0), np.eye(size)) + np.kron(np.eye(3), G @ G.T)
    rows = np.zeros((6, len(POINTS), 3, 3 * size))
    rows[:3] = np.eye(3 * size).reshape(3, len(POINTS), 3, 3 * size)
    root_of_variance = np.sqrt(
        measurements.covariance[0, 0]
    )  # of a deflection, the difference of two readings
    W = root_of_variance * block.whiten(rows)[:3].reshape(3 * size, 3 * size)
    np.testing.assert_allclose(W, W.T, atol=1e-9)
    np.testing.assert_allclose(W.T @ W, np.linalg.inv(covariance), atol=1e-9)


def test_loads_that_share_an_unloaded_reading_name_no_false_cause():
    """Six postures of ten loads: one error of an unloaded reading is in ten deflections."""
    for seed in range(3):
        joints = JointsAlone(Rows(ROBOT, shared_readings(6, 10, seed)), SETTINGS)
        assert joints.screening.causes == ()
