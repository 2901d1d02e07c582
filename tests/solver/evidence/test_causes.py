"""Causes: several at once, springs that are not linear, and what the readings of a set can show."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import estimate, prepare
from support.springs import SIGMA, SpringCampaign, robot_of

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import TARGETS, plan_experiment, torques
from jointstiff.simulator.elastic_links import ElasticArm, beam_arm, elastic_campaign
from jointstiff.solver.evidence.causes import Screening, screen_estimate
from jointstiff.solver.evidence.fitted_causes import fit_causes
from jointstiff.solver.evidence.refuted import leave_out, list_refuted
from jointstiff.solver.evidence.suspects import Suspect, group_distinct_loads
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.integrity import inspect_measurements
from jointstiff.solver.mechanics.block import Motion, Term, fitted_errors, get_whole_block
from jointstiff.solver.mechanics.terms import PLAY, SHIFT, TERMS
from jointstiff.solver.outcome.rules import report_causes
from jointstiff.solver.run import run

ARM = default_arm()
ROBOT = robot_of(ARM)


def pulls(seed, configurations=24, sigma=SIGMA):
    """Return readings of pulls of 1500 N in all directions."""
    return next(SpringCampaign.of(ARM, configurations=configurations, seed=seed).measured(1, seed=seed))


def screened(measurements):
    found = estimate(ROBOT, measurements, complementary_stiffness="included")
    return screen_estimate(Rows(ROBOT, measurements), found)


def named(screening):
    return [(cause.suspect.name, cause.suspect.first) for cause in screening.causes]


def test_errors_that_targets_share_widen_what_is_claimed_of_a_cause():
    """Under a station of 60 µm three targets of a posture are one reading: a shift is known to 60 µm / √N."""
    claimed = []
    for station in (0.0, 6e-5):
        measurements = pulls(1, configurations=40)
        errors = station * np.random.default_rng(2).standard_normal((40, 1, 3))
        moved = measurements.deflection + errors
        fitted = fitted_errors(
            fit_causes(Rows(ROBOT, replace(measurements, deflection=moved)), [("shift", None)])
        )
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
    mended = fit_causes(Rows(ROBOT, measurements), fitted)
    assert group_distinct_loads(mended) == (measurements.labels,)
    # What is advised after the fit can be fitted, too.
    two = group_distinct_loads(wrong)
    assert [len(group) for group in two] == [15, 15]
    assert group_distinct_loads(fit_causes(Rows(ROBOT, wrong), fitted)) == two


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
        found = estimate(ROBOT, fit_causes(Rows(ROBOT, measurements), named(screening)))
        u = np.sqrt(np.diag(found.covariance))
        assert (np.abs(found.compliance - ARM.compliances) < 3 * u).all()


def test_play_and_curved_springs_in_a_tie_are_not_linear():
    """Readings at one size of the load do not distinguish them: the finding says what does."""
    measurements = hardened(0, 0.3)
    found = estimate(ROBOT, measurements, complementary_stiffness="included")
    (curved,) = screen_estimate(Rows(ROBOT, measurements), found).causes
    play = replace(curved, suspect=Suspect("play", PLAY))
    finding = report_causes([curved, play], found)
    assert finding.message.startswith("the joints are not linear: with compliances that differ by (")
    assert ", or with play of (" in finding.message
    assert finding.remedy.startswith("not linear: read two postures again at half the load")
    assert [cause.name for cause in finding.action.causes] == ["curved_springs", "play"]
    assert "not linear" not in report_causes([curved], found).message


def test_the_torque_that_takes_up_play_is_uncertain_from_zero_to_what_makers_state():
    """Mean and scatter of the turn are those of draws of this torque."""
    measurements = pulls(5, configurations=12)
    block = get_whole_block(ROBOT, measurements)
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


def judged(measurements, **options):
    """Inspect and identify, and return the result of the run."""
    findings = tuple(inspect_measurements(ROBOT, measurements, degrees=False))
    return run(ROBOT, measurements, RunOptions(**options), findings)


def errors_of(result):
    """Return the error of each joint's compliance, in standard uncertainties."""
    u = np.array([joint.standard_uncertainty for joint in result.joints])
    return np.abs(np.array([joint.compliance for joint in result.joints]) - ARM.compliances) / u


def bumped(measurements, row, moved=(4e-4, -2e-4, 3e-4)):
    """Return readings of which all targets of one posture are read elsewhere under the load."""
    deflection = measurements.deflection.copy()
    deflection[row] += moved
    return replace(measurements, deflection=deflection)


class TestSeveralMistakes:
    """One finding names what happened, and one action mends it."""

    def test_two_causes_are_named_together_and_fitted_at_once(self):
        measurements = pulls(6, configurations=30)
        wrong = replace(measurements, load_point=measurements.load_point + np.array([0.06, -0.04, 0.03]))
        later = np.arange(30)[:, None, None] >= 14
        wrong = replace(wrong, deflection=wrong.deflection + np.where(later, [1e-4, 0.0, -5e-5], 0.0))
        result = judged(wrong)
        assert result.assessment.verdict == "do_not_use"
        (finding,) = (each for each in result.assessment.reasons if each.action)
        assert finding.message.startswith("with every load point moved by (")
        assert ", and with a shift of all readings under load by (" in finding.message
        assert {each.name for each in finding.action.causes} == {"load_point", "shift"}
        assert finding.action.observations == []
        mended = judged(wrong, causes=finding.action.causes)
        assert mended.assessment.verdict == "use_with_care"
        assert (errors_of(mended) < 3.0).all()
        assert errors_of(result).max() > 10.0
        assert {each.code for each in mended.assessment.reasons} == {"cause_fitted"}

    def test_a_wrong_posture_and_a_cause_are_named_together(self):
        """Huber's loss is offered for neither: it is no mend for a cause that moves all postures."""
        measurements = pulls(7, configurations=30)
        wrong = bumped(replace(measurements, force=measurements.force - np.array([150.0, 0.0, -90.0])), 11)
        result = judged(wrong)
        (finding,) = (each for each in result.assessment.reasons if each.action)
        assert finding.action.kind == "fit_causes"
        assert [each.name for each in finding.action.causes] == ["constant_force"]
        assert finding.action.observations == ["12"]
        assert finding.message.startswith("without '12', and with a constant force of (")
        assert finding.remedy.endswith("; repeat the readings of '12'")
        mended = judged(leave_out(wrong, ["12"]), causes=finding.action.causes)
        assert (errors_of(mended) < 3.0).all()

    def test_a_wrong_posture_alone_is_no_cause(self):
        """One of 30 postures, which Huber's loss mends."""
        wrong = bumped(pulls(8, configurations=30), 4)
        screening = screened(wrong)
        assert screening.wrong == ("5",)
        assert not screening.causes
        assert not screening.links_need_validation
        result = judged(wrong)
        (outlier,) = (each for each in result.assessment.reasons if each.code == "residual_outlier")
        assert outlier.observation == "5"
        assert outlier.action.kind == "use_huber"
        mended = judged(wrong, loss="huber")
        assert (errors_of(mended) < 3.0).all()

    def test_many_wrong_postures_are_not_single_mistakes(self):
        """A quarter of the postures have something in common, so that none is left out."""
        wrong = pulls(9, configurations=24)
        generator = np.random.default_rng(4)
        for row in range(0, 24, 4):
            wrong = bumped(wrong, row, 5e-4 * generator.standard_normal(3))
        assert screened(wrong).wrong == ()

    def test_links_that_bend_are_no_wrong_postures(self):
        for seed in (0, 2, 3):
            elastic = beam_arm(ARM)
            soft = ElasticArm(elastic.arm, 0.1 * elastic.links)
            robot, measurements = prepare(elastic_campaign(soft, seed=seed, configurations=30))
            found = estimate(robot, measurements, complementary_stiffness="included")
            screening = screen_estimate(Rows(robot, measurements), found)
            assert screening.wrong == ()
            assert not screening.causes
            assert screening.links_need_validation

    def test_clean_readings_have_no_wrong_posture(self):
        for seed in range(20, 26):
            screening = screened(pulls(seed, configurations=20))
            assert (screening.wrong, screening.causes) == ((), ())

    def test_what_a_run_cannot_fit_is_not_proposed(self):
        """A run fits four causes at most: the best of each step come first."""
        measurements = pulls(3, configurations=30)
        wrong = replace(measurements, load_point=measurements.load_point + 0.05)
        found = estimate(ROBOT, wrong, complementary_stiffness="included")
        (cause,) = screen_estimate(Rows(ROBOT, wrong), found).causes
        tie = replace(cause, suspect=Suspect("play", PLAY))
        last = replace(cause, suspect=Suspect("shift", SHIFT), step=1)
        for most, names in ((3, ["load_point", "shift", "play"]), (2, ["load_point", "shift"])):
            action = report_causes([cause, tie, last], found, most=most).action
            assert [each.name for each in action.causes] == names
        assert report_causes([cause], found, most=0).action is None


class TestRefutedReadings:
    """A single reading that is refuted does not shape the number; the verdict stays."""

    def test_the_posture_of_another_reading_in_one_of_twenty(self):
        clean = pulls(10, configurations=20)
        angles = clean.joints.copy()
        angles[7] = angles[3]
        results = [judged(each) for each in (clean, replace(clean, joints=angles))]
        assert [each.assessment.verdict for each in results] == ["use", "do_not_use"]
        right, refuted = (np.array([joint.compliance for joint in each.joints]) for each in results)
        assert np.abs(refuted / right - 1.0).max() < 0.05
        assert (errors_of(results[1]) < 3.0).all()
        (reason,) = results[1].assessment.reasons
        assert reason.action.kind == "leave_out_readings"
        assert reason.action.observations == ["8"]
        assert "The stiffnesses are identified without the refuted '8'." in results[1].assessment.notes
        assert {residual.observation for residual in results[1].residuals} == set(clean.labels) - {"8"}

    def test_the_number_is_that_without_the_reading(self):
        clean = pulls(11, configurations=20)
        angles = clean.joints.copy()
        angles[2] = angles[9]
        refuted = judged(replace(clean, joints=angles))
        without = judged(leave_out(clean, ["3"]))
        for one, other in zip(refuted.joints, without.joints, strict=True):
            assert one.compliance == pytest.approx(other.compliance, rel=1e-9)

    @pytest.mark.parametrize(("count", "refuted"), [(2, 2), (3, 0)])
    def test_many_refuted_readings_put_the_whole_set_in_doubt(self, count, refuted):
        measurements = pulls(12, configurations=20)
        findings = [
            Finding(code="targets_swapped", weight="do_not_use", observation=label, message="m", remedy="r")
            for label in measurements.labels[:count]
        ]
        assert len(list_refuted(measurements, findings)) == refuted

    def test_a_target_that_moved_for_good_is_no_single_mistake(self):
        measurements = pulls(12, configurations=20)
        finding = Finding(code="target_moved", weight="do_not_use", observation="5", message="m", remedy="r")
        assert list_refuted(measurements, [finding]) == ()
        assert leave_out(measurements, ()) is measurements


@pytest.mark.parametrize(
    ("links_with_base", "base_with_links", "is_tie"),
    [(0.5, 0.5, True), (1e-9, 0.5, False), (0.5, 1e-9, False), (1e-9, 1e-9, False)],
)
def test_links_may_be_a_base_only_if_neither_explains_more_after_the_other(
    links_with_base, base_with_links, is_tie
):
    screening = Screening(
        1e-9,
        (),
        (),
        base_p_value=1e-9,
        links_p_value_with_base=links_with_base,
        base_p_value_with_links=base_with_links,
    )
    assert screening.links_may_be_base == is_tie
