"""Causes: several at once, springs that are not linear, and what the readings of a set can show."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import estimate
from support.springs import SIGMA, SpringCampaign, robot_of

from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import TARGETS, plan_experiment, torques
from jointstiff.solver.estimation.assessment import report_causes
from jointstiff.solver.estimation.causes import screen_estimate
from jointstiff.solver.estimation.fitted_causes import fit_causes
from jointstiff.solver.estimation.suspects import Suspect, group_distinct_loads
from jointstiff.solver.mechanics.block import Motion, Term, fitted_errors, whole_block
from jointstiff.solver.mechanics.terms import PLAY, TERMS

ARM = default_arm()
ROBOT = robot_of(ARM)


def pulls(seed, configurations=24, sigma=SIGMA):
    """Return readings of pulls of 1500 N in all directions."""
    return next(SpringCampaign.of(ARM, configurations=configurations, seed=seed).measured(1, seed=seed))


def screened(measurements):
    found = estimate(ROBOT, measurements, complementary_stiffness="included")
    return screen_estimate(ROBOT, measurements, found)


def named(screening):
    return [(cause.suspect.name, cause.suspect.first) for cause in screening.causes]


def test_errors_that_targets_share_widen_what_is_claimed_of_a_cause():
    """Under a station of 60 µm three targets of a posture are one reading: a shift is known to 60 µm / √N."""
    claimed = []
    for station in (0.0, 6e-5):
        measurements = pulls(1, configurations=40)
        errors = station * np.random.default_rng(2).standard_normal((40, 1, 3))
        moved = measurements.deflection + errors
        fitted = fitted_errors(fit_causes(ROBOT, replace(measurements, deflection=moved), [("shift", None)]))
        claimed.append(np.linalg.norm(fitted.root, axis=1))
    independent = SIGMA * np.sqrt(2.0 / 120.0)
    shared = np.hypot(6e-5 / np.sqrt(40.0), independent)
    # The joints take a part of what the readings know of the shift.
    assert (claimed[0] > independent).all()
    assert (claimed[0] < 1.5 * independent).all()
    assert (claimed[1] > 0.8 * shared).all()
    assert (claimed[1] < 1.8 * shared).all()


def test_a_fitted_force_makes_no_distinct_loads():
    """Pulls along +x and -x are one load, even if a constant force along x makes them differ by a fifth."""
    plan = plan_experiment(ARM, configurations=30, load="pull", force=1500.0, seed=3)
    forces = 1500.0 * np.outer(np.where(np.arange(30) % 2, 1.0, -1.0), [1.0, 0.0, 0.0])
    campaign = SpringCampaign.by(ARM, replace(plan, forces=forces))
    (measurements,) = campaign.measured(1, seed=3)
    wrong = replace(measurements, force=forces - np.array([150.0, 0.0, 0.0]))
    assert group_distinct_loads(measurements) == (measurements.labels,)
    fitted = [("constant_force", None)]
    mended = fit_causes(ROBOT, measurements, fitted)
    assert group_distinct_loads(mended) == (measurements.labels,)
    # What is advised after the fit can be fitted, too.
    two = group_distinct_loads(wrong)
    assert [len(group) for group in two] == [15, 15]
    assert group_distinct_loads(fit_causes(ROBOT, wrong, fitted)) == two


@pytest.fixture
def unseen_term():
    """A suspected term whose motion no reading shows, among the others."""
    before = dict(TERMS)
    TERMS["unseen"] = Term("unseen", "m", move_nothing, suspected=True, words="{}", remedy="none")
    yield
    TERMS.clear()
    TERMS.update(before)


def move_nothing(block, compliance):
    """Return the motion by two unknowns that move no target."""
    return Motion(np.zeros((*block.points.shape, 2)))


def test_a_term_that_no_reading_shows_changes_no_answer(request):
    """Without it, the level of each test would be divided by one more."""
    for moved in (0.0, 4.0e-5):
        measurements = pulls(4)
        wrong = replace(measurements, deflection=measurements.deflection + moved)
        before = screened(wrong)
        request.getfixturevalue("unseen_term")
        after = screened(wrong)
        assert after.tests == before.tests
        assert named(after) == named(before)
        assert after.links_p_value == before.links_p_value


def hardened(seed, hardening):
    """Return pulls on springs ``τ = k δθ (1 + h (k δθ / τ_max)²)``, in exact balance."""
    campaign = SpringCampaign.of(ARM, configurations=30, seed=seed)
    plan, angle = campaign.experiment, np.zeros((30, 6))
    largest = np.abs(torques(ARM, plan.joints, *plan.wrenches)).max(axis=0)
    for _ in range(60):
        torque = torques(ARM, plan.joints + angle, *plan.wrenches)
        linear = angle / ARM.compliances / largest
        angle = torque * ARM.compliances / (1.0 + hardening * linear**2)
    loaded = ARM.posture(plan.joints + angle).targets_to_base(np.array(list(TARGETS.values())))
    return next(replace(campaign, loaded=loaded).measured(1, seed=seed))


@pytest.mark.parametrize("hardening", [0.2, 0.5])
def test_springs_that_harden_are_no_play(hardening):
    """They are named, and the stiffness at small torques is within its interval after the mend."""
    for seed in range(2):
        measurements = hardened(seed, hardening)
        screening = screened(measurements)
        (cause,) = screening.causes
        assert cause.suspect.name == "curved_springs"
        assert (cause.unknowns[:3] < 0.0).all()
        found = estimate(ROBOT, fit_causes(ROBOT, measurements, named(screening)))
        u = np.sqrt(np.diag(found.covariance))
        assert (np.abs(found.compliance - ARM.compliances) < 3 * u).all()


def test_play_and_curved_springs_in_a_tie_are_not_linear():
    """Readings at one size of the load do not distinguish them: the finding says what does."""
    measurements = hardened(0, 0.3)
    found = estimate(ROBOT, measurements, complementary_stiffness="included")
    (curved,) = screen_estimate(ROBOT, measurements, found).causes
    play = replace(curved, suspect=Suspect("play", PLAY))
    finding = report_causes([curved, play], found)
    assert finding.message.startswith("the joints are not linear: with compliances that change by (")
    assert ", or with play of (" in finding.message
    assert finding.remedy.startswith("not linear: read two postures at half the load")
    assert [cause.name for cause in finding.action.causes] == ["curved_springs", "play"]
    assert "not linear" not in report_causes([curved], found).message


def test_the_torque_that_takes_up_play_is_uncertain_from_zero_to_what_makers_state():
    """Mean and scatter of the turn are those of draws of this torque."""
    measurements = pulls(5, configurations=12)
    block = whole_block(ROBOT, measurements)
    play = np.full(6, 2e-4)
    drawn = np.random.default_rng(1).uniform(0.0, 1.0, (20_000, 1, 1))
    largest = np.minimum(50.0, 3e-5 / ARM.compliances)
    turn = 0.5 * np.clip(block.torque / (drawn * largest), -1.0, 1.0)
    mean = PLAY.motion(block, ARM.compliances).joints
    spread = PLAY.doubt(play).motion(block, ARM.compliances).joints
    np.testing.assert_allclose(np.diagonal(mean, axis1=1, axis2=2), turn.mean(axis=0), atol=5e-3)
    scatter = np.abs(np.diagonal(spread, axis1=1, axis2=2)) / play
    np.testing.assert_allclose(scatter, turn.std(axis=0), atol=5e-3)
    assert (scatter > 0.05).any()
