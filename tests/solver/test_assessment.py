"""Assessments and causes: what is wrong with readings is named, and clean ones are accused of nothing."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import estimate, only_deflections, prepare
from support.shared_data import shared

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.elastic_links import ElasticArm, beam_arm, elastic_campaign
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.solver.evidence.causes import screen_estimate
from jointstiff.solver.evidence.fitted_causes import fit_causes
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.term_tests import LINKS_LEVEL, MISTAKE_LEVEL
from jointstiff.solver.fit.estimate import JointCompliance, predict
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.integrity import inspect_measurements
from jointstiff.solver.mechanics.measurements import (
    CommonUncertainty,
    DifferenceNoise,
    EncoderReadings,
    Instrument,
)
from jointstiff.solver.mechanics.robot import JointMap, Robot
from jointstiff.solver.outcome.rules import assess, report_implausible_joints
from jointstiff.solver.text import stiffness_text, unknowns_text

TRUTH = default_arm().compliances
COLUMNS = [(0, 1), (0, 3), (1, 2), (1, 4), (2, 3), (2, 5), (3, 4), (3, 5), (4, 5)]


@pytest.fixture(scope="module")
def pulls():
    """Pulls of 1500 N that show every joint, sigma stated."""
    return prepare(simulate_campaign(default_arm(), load="pull", seed=3))


@pytest.fixture(scope="module")
def deflections(pulls):
    """The same where no position was read, and sigma is not stated."""
    return pulls[0], replace(only_deflections(pulls[1]), sigma=None)


@pytest.fixture(scope="module")
def fanuc():
    """Readings of a real robot."""
    return prepare(shared("fanuc_r2000ic/campaign"))


def exchanged(measurements, columns):
    joints = measurements.joints.copy()
    joints[:, columns] = joints[:, columns[::-1]]
    return replace(measurements, joints=joints)


def assessed(robot, measurements, *, findings=None, prior=None, **options):
    """Inspect, identify, and assess with the options of a run; K_c included if nothing is said."""
    options = {"complementary_stiffness": "included"} | options
    settings = replace(Settings.from_options(RunOptions(**options), robot), prior=prior)
    if findings is None:
        findings = tuple(inspect_measurements(robot, measurements, degrees=False))
    joints = JointsAlone(Rows(robot, measurements), settings, findings)
    found = joints.estimate
    prediction = predict(Rows(robot, measurements, found.balanced), found.compliance)
    return assess(joints, found, prediction, joints.screening), found


def reason_of(assessment, code):
    reasons = [reason for reason in assessment.reasons if reason.code == code]
    assert len(reasons) == 1, assessment.reasons
    return reasons[0]


def is_true(found, truth=TRUTH):
    u = np.array([joint.standard_uncertainty for joint in found.joints])
    return bool((np.abs(found.compliance - truth) < 5 * u).all())


class TestAlternatives:
    """Where no position was read, the deflections alone show a mistake."""

    @pytest.mark.parametrize("columns", COLUMNS)
    def test_exchanged_columns_are_named_and_exchanged_back(self, deflections, columns):
        robot, measurements = deflections
        wrong = exchanged(measurements, list(columns))
        assessment, found = assessed(robot, wrong)
        reason = reason_of(assessment, "joints_swapped")
        assert assessment.verdict == reason.weight == "do_not_use"
        assert set(assessment.joints) == {"do_not_use"}
        assert reason.action.kind == "exchange_columns"
        assert reason.action.joints == [robot.joint_names[j] for j in columns]
        assert f"{reason.action.joints[0]} and {reason.action.joints[1]}" in reason.message
        back = [robot.joint_names.index(name) for name in reason.action.joints]
        assessment, found = assessed(robot, exchanged(wrong, back))
        assert assessment.verdict == "use"
        assert is_true(found)

    @pytest.mark.parametrize(("joint", "turn"), [(0, 0.5), (1, -0.5), (2, 0.5), (4, 1.0)])
    def test_another_zero_of_a_joint_is_corrected_in_the_joint_map(self, deflections, joint, turn):
        right, measurements = deflections
        joints = measurements.joints.copy()
        joints[:, joint] += turn * np.pi
        assessment, _ = assessed(right, replace(measurements, joints=joints))
        action = reason_of(assessment, "joints_counted_otherwise").action
        assert action.kind == "apply_joint_map"
        joint_map = JointMap(np.array(action.joint_map), np.array(action.offset))
        mended = Robot(right.chain.model(), joint_map, payload=right.payload)
        assessment, found = assessed(mended, replace(measurements, joints=joints))
        assert assessment.verdict == "use"
        assert is_true(found)

    def test_on_a_real_robot_without_joint_map_the_makers_map_is_found(self, fanuc):
        right, measurements = fanuc
        assessment, _ = assessed(Robot(right.chain.model()), measurements)
        action = reason_of(assessment, "joints_counted_otherwise").action
        np.testing.assert_array_equal(action.joint_map, right.joint_map.matrix)

    def test_parts_of_a_real_set_have_no_better_alternative(self, fanuc):
        robot, measurements = fanuc
        rng = np.random.default_rng(0)
        for count in (5, 8, 12, 20):
            for _ in range(4):
                part = measurements[np.sort(rng.permutation(30)[:count])]
                codes = {reason.code for reason in assessed(robot, part)[0].reasons}
                assert not codes & {
                    "alternative_explains_better",
                    "joints_counted_otherwise",
                    "joints_swapped",
                }


class TestReadings:
    @pytest.mark.parametrize(("row", "left_out"), [(2, ["c01", "c02"]), (17, ["c18", "c19"]), (9, None)])
    def test_of_a_target_that_stays_elsewhere_the_shorter_side_is_left_out(self, pulls, row, left_out):
        label = pulls[1].labels[row]
        moved = Finding(code="target_moved", weight="do_not_use", observation=label, message="m", remedy="r")
        action = reason_of(assessed(*pulls, findings=(moved,))[0], "target_moved").action
        assert (action and action.observations) == left_out


class TestFit:
    def test_the_posture_to_look_at_is_that_of_the_largest_residual(self, pulls):
        robot, measurements = pulls
        deflection = measurements.deflection.copy()
        deflection[3, 1] += [0.0, 0.02, 0.0]  # of one target alone
        wrong = replace(measurements, force=measurements.force[:, [1, 2, 0]], deflection=deflection)
        assessment, found = assessed(robot, wrong, findings=(), complementary_stiffness="neglected")
        left = np.linalg.norm(predict(Rows(robot, wrong), found.compliance).residual, axis=2)
        shown = reason_of(assessment, "deflection_unexplained").action.observations
        assert shown == ["c04"] == [measurements.labels[left.max(axis=1).argmax()]]
        assert left.min(axis=1).argmax() != 3

    def test_neglected_complementary_stiffness_is_included_at_a_click(self):
        campaign = simulate_campaign(default_arm(), load="pull", seed=5, force=4000.0, sigma=5e-6)
        robot, measurements = prepare(campaign)
        measurements = replace(measurements, sigma=2e-5)  # so that the residuals agree with sigma
        assessment, found = assessed(robot, measurements, complementary_stiffness="neglected", findings=())
        assert found.complementary_stiffness.largest_shift > 0.5
        reason = reason_of(assessment, "complementary_stiffness_matters")
        assert assessment.verdict == "use_with_care"
        assert reason.action.kind == "include_complementary_stiffness"
        assert assessed(robot, measurements, findings=())[0].verdict == "use"

    def test_causes_that_hold_each_other_are_fitted_as_one(self):
        """A turn holds a shift: both together leave nothing that could not be told."""
        robot, measurements = springs(4, configurations=20)
        moved = replace(measurements, deflection=np.add(measurements.deflection, [1e-4, 0.0, 0.0]))
        beside = fit_causes(Rows(robot, moved), [("shift", None), ("turn", None)])
        assert [term.name for term in beside.fitted.terms] == ["turn"]
        found = estimate(robot, beside, complementary_stiffness="included")
        u = np.sqrt(np.diag(found.covariance))
        assert (np.abs(found.compliance - default_arm().compliances) < 3 * u).all()

    def test_behind_a_gross_error_no_smaller_cause_is_sought(self, pulls):
        """A load point 5 cm off is one; another finding that forbids nothing does not matter."""
        robot, measurements = pulls
        wrong = replace(measurements, load_point=np.add(measurements.load_point, [0.05, 0.0, 0.0]))
        told = [Finding(code="zero_load", weight=w, message="m", remedy="r") for w in ("use", "do_not_use")]
        for findings, sought in (((), True), (told[:1], True), (told, False)):
            assessment, _ = assessed(robot, wrong, findings=findings)
            kinds = [reason.action.kind for reason in assessment.reasons if reason.action]
            assert ("fit_causes" in kinds) == sought


@pytest.mark.parametrize(
    ("stiffnesses", "named", "remedy"),
    [
        ([1e6, 2e6, -3e6], "", ""),
        ([1e6, 2e6, -30.0], "joint_3", "set `positive` to true"),
        ([1e6, 2e6, 30.0], "joint_3", "the stiffnesses of the other joints are plausible"),
        ([1e2, 2e2, 30.0], "joint_1 joint_2 joint_3", "check the units of force, length and moment"),
        ([1e10, 2e6, 3e6], "joint_1", "the stiffnesses of the other joints are plausible"),
        ([1e2, 2e2, -30.0], "joint_3", "set `positive` to true"),
    ],
)
def test_the_remedy_of_an_implausible_stiffness(stiffnesses, named, remedy):
    """A sign is the order or the map, one joint its own column, all joints together a unit."""
    joints = [
        JointCompliance(f"joint_{number}", "revolute", "identified", 1.0 / stiffness, 1e-9)
        for number, stiffness in enumerate(stiffnesses, 1)
    ]
    joints.append(JointCompliance("joint_4", "revolute", "not_observable", reason="never twists"))
    found = list(report_implausible_joints(joints))
    assert set(named.split()) <= {finding.where for finding in found}
    assert bool(named) == bool(found)
    for finding in found:
        assert finding.where is not None
        if finding.where in named:
            assert remedy in finding.remedy


@pytest.mark.parametrize(
    ("offset", "stated", "weight"),
    [(0.02, None, None), (0.06, None, "do_not_use"), (0.02, 1e-4, "do_not_use")],
)
def test_a_load_point_elsewhere_does_harm_beyond_what_the_intervals_hold(pulls, offset, stated, weight):
    """A load point that is assumed to 10 mm may be 20 mm off; one that was stated to 0.1 mm may not."""
    robot, measurements = pulls
    assumed = frozenset(() if stated else ("load_point",))
    common = CommonUncertainty(load_point=stated or 0.01, assumed=assumed)
    wrong = replace(
        measurements,
        load_point=np.add(measurements.load_point, [offset, 0.0, 0.0]),
        common_uncertainty=common,
    )
    reasons = assessed(robot, wrong, findings=())[0].reasons
    found = [reason for reason in reasons if reason.code == "alternative_explains_better"]
    assert [reason.weight for reason in found] == [weight] * bool(weight)
    for reason in found:
        assert [cause.name for cause in reason.action.causes] == ["load_point"]


def screened(robot, measurements, k_c="included"):
    fit = estimate(robot, measurements, complementary_stiffness=k_c)
    return screen_estimate(Rows(robot, measurements), fit)


def springs(seed, load="pull", **options):
    return prepare(simulate_campaign(default_arm(), load=load, seed=seed, **options))


def beams(seed, softness=1.0, **options):
    elastic = beam_arm(default_arm())
    soft = ElasticArm(elastic.arm, softness * elastic.links)
    return prepare(elastic_campaign(soft, seed=seed, **options))


def named(screening):
    return [(cause.suspect.name, cause.suspect.first) for cause in screening.causes]


class TestSpringsAlone:
    @pytest.mark.parametrize("load", ["pull", "dead_weight"])
    def test_springs_alone_are_accused_of_nothing(self, load):
        for seed in range(0, 12, 3):
            robot, measurements = springs(seed, load, configurations=10 + 3 * seed)
            for clean in (measurements, replace(only_deflections(measurements), sigma=None)):
                screening = screened(robot, clean)
                assert not screening.causes
                assert screening.links_p_value > LINKS_LEVEL / 3
                assert not screening.lack_of_fit

    def test_a_load_that_matters_for_the_geometry_is_taken_into_account(self):
        """Without K_c at the test the posture under the load would be taken for links."""
        robot, measurements = springs(3, force=8000.0)
        for choice in ("included", "neglected"):
            assert not screened(robot, measurements, choice).links_need_validation


class TestLoad:
    @pytest.mark.parametrize("load", ["pull", "dead_weight"])
    @pytest.mark.parametrize("offset", [0.05, 0.15])
    def test_a_load_point_elsewhere_is_proved_and_found(self, load, offset):
        for seed in range(2):
            robot, measurements = springs(seed, load, configurations=30)
            direction = np.random.default_rng(seed).standard_normal(3)
            moved = offset * direction / np.linalg.norm(direction)
            wrong = replace(measurements, load_point=measurements.load_point + moved)
            screening = screened(robot, wrong)
            assert not screening.links_need_validation
            (cause,) = screening.causes
            assert cause.suspect.name == "load_point"
            assert cause.p_value < MISTAKE_LEVEL
            assert screening.makes_links_unnecessary
            # Pulls tell the point to a centimetre, a dead weight hardly across itself.
            assert np.linalg.norm(cause.unknowns + moved) < (0.02 if load == "pull" else 0.5 * offset)
            beside = fit_causes(Rows(robot, wrong), named(screening))
            found = estimate(robot, beside, complementary_stiffness="included")
            u = np.sqrt(np.maximum(np.diag(found.covariance), 1e-30))
            seen = found.estimated
            assert (np.abs(found.compliance - default_arm().compliances)[seen] < 4 * u[seen]).all()

    def test_exact_readings_tell_the_load_point_exactly(self):
        """150 mm is far for one step of Gauss and Newton: the steps go on until it stands still."""
        robot, measurements = springs(0, configurations=30, sigma=0.0)
        moved = np.array([0.15, -0.05, 0.1])
        wrong = replace(measurements, load_point=measurements.load_point + moved)
        (cause,) = screened(robot, wrong).causes
        np.testing.assert_allclose(cause.unknowns, -moved, atol=1e-6)

    @pytest.mark.parametrize("weight", [100.0, 300.0])
    def test_a_forgotten_payload_is_proved_and_found(self, weight):
        for seed in range(2):
            robot, measurements = springs(seed, configurations=30)
            payload = np.array([0.0, 0.0, -weight])
            screening = screened(robot, replace(measurements, force=measurements.force - payload))
            (cause,) = screening.causes
            assert cause.suspect.name == "hook_weight"
            np.testing.assert_allclose(cause.unknowns, [weight], atol=25.0)
            assert not screening.links_need_validation

    @pytest.mark.parametrize("force", [(60.0, 0.0, -80.0), (0.0, 180.0, 240.0)])
    def test_a_forgotten_force_that_is_no_weight_is_proved_and_found(self, force):
        """A force of 100 or 300 N, oblique or upwards, is not explained by a weight."""
        for seed in range(2):
            robot, measurements = springs(seed, configurations=30)
            screening = screened(robot, replace(measurements, force=measurements.force - force))
            (cause,) = screening.causes
            assert cause.suspect.name == "constant_force"
            np.testing.assert_allclose(cause.unknowns, force, atol=25.0)
            assert not screening.links_need_validation

    @pytest.mark.parametrize("turn", [0.0, 5e-5])
    @pytest.mark.parametrize(("load", "first"), [("pull", 8), ("dead_weight", 0)])
    def test_a_tracker_that_moved_is_named_or_in_a_tie(self, load, turn, first):
        """It moved by 0.1 mm, or turned, too, between the unloaded and the loaded readings of a row."""
        for seed in range(2):
            robot, measurements = springs(seed, load, configurations=20)
            shift, axis = np.random.default_rng(seed).standard_normal((2, 3))
            moved = 1e-4 * shift / np.linalg.norm(shift) + turn * np.cross(axis, measurements.position)
            moved = np.where(np.arange(20)[:, None, None] >= first, moved, 0.0)
            wrong = replace(measurements, deflection=measurements.deflection + moved)
            found = named(screened(robot, wrong))
            assert {"shift", "turn"} & {name for name, _ in found}, found

    def test_play_in_the_gears_is_named_and_measured(self):
        """The simulator turns each joint on by 0.15 mrad to the side that the load pushes it."""
        arm, play = default_arm(), 1.5e-4
        robot, measurements = springs(6, configurations=30)
        load = measurements.force, measurements.moment, measurements.load_point
        places = measurements.position[0] - arm.posture(measurements.joints[0]).flange_translation
        places = places @ arm.posture(measurements.joints[0]).flange_rotation
        bent = measurements.joints + equilibrium(arm, measurements.joints, *load)
        further = play * np.sign(bent - measurements.joints)
        before, after = (arm.posture(q).targets_to_base(places) for q in (bent, bent + further))
        wrong = replace(measurements, deflection=measurements.deflection + after - before)
        screening = screened(robot, wrong)
        (cause,) = screening.causes
        assert cause.suspect.name == "play"
        # The pulls hardly twist the last two joints.
        np.testing.assert_allclose(cause.unknowns[:4], 2.0 * play, rtol=0.2)
        found = estimate(robot, fit_causes(Rows(robot, wrong), named(screening)))
        u = np.sqrt(np.diag(found.covariance))
        assert (np.abs(found.compliance - arm.compliances) < 3 * u).all()
        elastic = bent - measurements.joints
        behind = EncoderReadings(elastic + further, np.ones((30, 6), np.bool_), 5e-6)
        mended = fit_causes(
            Rows(robot, replace(wrong, encoders=behind)), [("play", None)]
        ).encoders.deflection
        twisted = (np.abs(elastic) > 5e-5) & (np.arange(6) < 4)
        np.testing.assert_allclose(mended[twisted], elastic[twisted], atol=3e-5)

    def test_a_noise_of_the_wrong_shape_accuses_nothing(self):
        """A data sheet says 7 or 0.1 µm along the line of sight, 30 across; the noise is 20 µm anywhere."""
        usual = Instrument((4.0, 1.0, 1.5), 3e-6, 1e-6, 1e-5, 5e-6)
        sharp = Instrument((4.0, 1.0, 1.5), 1e-7, 0.0, 3e-5, 5e-6)
        for seed, sheet in ((0, usual), (1, usual), (7, sharp)):
            robot, measurements = springs(seed, configurations=20)
            noise = DifferenceNoise.from_instrument(sheet, robot, measurements)
            stated = replace(measurements, sigma=noise.sigma, covariance=noise.covariance)
            screening = screened(robot, stated)
            assert not screening.causes
            assert not screening.links_need_validation

    @pytest.mark.parametrize("row", [0, 10, 17, 18, 19])
    def test_one_wrong_posture_is_no_tracker_that_moved(self, row):
        """Half a millimetre off, in one observation of 20."""
        for seed in range(2):
            robot, measurements = springs(seed, configurations=20)
            wrong = measurements.deflection.copy()
            wrong[row] += [3e-4, 0.0, -4e-4]
            found = named(screened(robot, replace(measurements, deflection=wrong)))
            assert found == [], seed


@pytest.mark.parametrize(("offset", "told"), [(0.15, ["load_point"]), (0.03, [])])
def test_a_load_point_elsewhere_is_told_beside_links_unless_these_explain_more(offset, told):
    robot, measurements = beams(0, 0.1, configurations=30)
    wrong = replace(measurements, load_point=np.add(measurements.load_point, [offset, 0.0, 0.0]))
    screening = screened(robot, wrong)
    assert [cause.suspect.name for cause in screening.causes] == told
    assert not screening.makes_links_unnecessary


@pytest.mark.parametrize(("softness", "configurations"), [(2.0, 20), (0.1, 40)])
def test_beams_speak(configurations, softness):
    for seed in range(2):
        robot, measurements = beams(seed, softness, configurations=configurations)
        screening = screened(robot, measurements)
        assert screening.links_need_validation
        assert screening.lack_of_fit
        assert not screening.makes_links_unnecessary


def test_numbers_are_said_in_units_of_their_size():
    assert unknowns_text("m", [0.0, 2e-3, 1e-4]) == "(0, 2, 0.1) mm"
    pose = [1e-4, -2e-4, 0.0, 2e-6, 0.0, 0.0]
    assert unknowns_text("m, rad", pose) == "(100, -200, 0) µm and (2, 0, 0) µrad"
    assert unknowns_text("rad", [np.radians(0.5)]) == "(30) arcmin"
    assert unknowns_text("1", [0.02]) == "(2) %"
    assert stiffness_text(6543.0, "revolute") == "6543 N·m/rad"
    assert stiffness_text(9999.9, "revolute") == "0.01 · 10⁶ N·m/rad"
    assert stiffness_text(2.01e7, "prismatic") == "20.1 N/µm"
    assert stiffness_text(999.9e6, "revolute") == "1 · 10⁹ N·m/rad"
    assert stiffness_text(9.999e9, "revolute") == "1 · 10¹⁰ N·m/rad"
    assert stiffness_text(-3e12, "revolute") == "-3 · 10¹² N·m/rad"
