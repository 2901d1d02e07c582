"""The whole path against published numbers, exact springs and exact algebra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import METHODS, estimate, prepare
from support.shared_data import shared

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.campaign import TARGETS, plan_experiment
from jointstiff.simulator.equilibrium import deflections, linear_deflections
from jointstiff.solver.errors import NotObservableError, UnsupportedMethodError
from jointstiff.solver.evidence.prediction import predict
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.chain import ChainJoint, KinematicChain
from jointstiff.solver.robot.configuration import Configurations, find_wrist
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms import block as regressor
from jointstiff.solver.terms.block import regressor_blocks

FANUC_STIFFNESS = (861071.8805, 2743390.9984, 2069594.5785, 359217.0978, 444155.9142, 137986.3549)
FANUC_COMPENSATION = 0.810339
FANUC_RESIDUAL = 0.34469e-3

METHODS_AND_WEIGHTS = [
    ("complete_pose", "covariance"),
    ("complete_pose", "characteristic_length"),
    ("complete_pose", "uniform"),
    ("partial_pose", "covariance"),
    ("partial_pose", "uniform"),
    ("decoupled_partial_pose", "covariance"),
    ("decoupled_partial_pose", "uniform"),
]


@pytest.fixture(scope="module")
def pulls() -> tuple[Robot, Measurements]:
    """Our own simulated pulls: every joint is observable."""
    return prepare(simulate_campaign(default_arm(), load="pull", configurations=12, seed=3))


@pytest.fixture(scope="module")
def dead_weight() -> tuple[Robot, Measurements]:
    """Our own simulated dead weight: the first joint is not observable."""
    return prepare(simulate_campaign(default_arm(), load="dead_weight", seed=4))


class TestSharedData:
    @pytest.mark.parametrize("weighting", ["uniform", "covariance"])
    def test_fanuc_stiffnesses_are_those_published(self, weighting):
        robot, measurements = prepare(shared("fanuc_r2000ic/campaign"))
        found = estimate(robot, measurements, method="partial_pose", weighting=weighting)
        prediction = predict(robot, measurements, found.compliance)
        # The reference is printed to four decimals, which is 1e-10 to 1e-9 relative.
        np.testing.assert_allclose(1 / found.compliance, FANUC_STIFFNESS, rtol=1e-8)
        assert prediction.compensation == pytest.approx(FANUC_COMPENSATION, abs=5e-7)
        assert prediction.rms_residual == pytest.approx(FANUC_RESIDUAL, rel=1e-5)
        assert not found.sigma_given
        assert found.degrees_of_freedom == pytest.approx(84)

    @pytest.mark.parametrize("name", ["dead_weight_motor", "dead_weight_secondary", "pull_40"])
    @pytest.mark.parametrize("method", METHODS)
    def test_truth_within_four_standard_uncertainties(self, name, method):
        truth = shared("simulated/truth")[name]
        found = estimate(*prepare(shared(f"simulated/{name}")), method=method)
        for joint, stiffness in zip(found.joints, truth["stiffness"], strict=True):
            if joint.name in truth["not_observable"]:
                assert joint.status == "not_observable"
                assert "never twists" in joint.reason
                assert joint.compliance is joint.standard_uncertainty is joint.compliance_interval is None
            else:
                assert joint.status == "identified"
                assert abs(joint.compliance - 1 / stiffness) < 4 * joint.standard_uncertainty

    def test_a_wrong_joint_map_gives_a_negative_stiffness_unconstrained_and_never_constrained(self):
        document = shared("fanuc_r2000ic/campaign")
        del document["robot"]["joint_map"]
        robot, measurements = prepare(document)
        free = estimate(robot, measurements, positive=False)
        positive = estimate(robot, measurements, positive=True)
        assert 1 / free.compliance[1] == pytest.approx(-1.86e6, rel=0.01)
        assert (positive.compliance >= 0).all()
        assert positive.joints[1].status == "at_bound"


class TestEquivalence:
    def test_complete_pose_equals_partial_pose_on_three_equal_targets(self, pulls, dead_weight):
        for campaign in (pulls, dead_weight):
            complete = estimate(*campaign, method="complete_pose")
            partial = estimate(*campaign, method="partial_pose")
            np.testing.assert_allclose(complete.compliance, partial.compliance, rtol=1e-9)
            np.testing.assert_allclose(complete.covariance, partial.covariance, rtol=1e-8, atol=1e-25)

    @pytest.mark.parametrize("method", METHODS)
    @pytest.mark.parametrize("scale", [1e-3, 1e3])
    def test_unit_of_length(self, pulls, method, scale):
        robot, measurements = pulls
        scaled = replace(
            measurements,
            moment=scale * measurements.moment,
            load_point=scale * measurements.load_point,
            position=scale * measurements.position,
            deflection=scale * measurements.deflection,
            sigma=scale * measurements.sigma,
        )
        found = estimate(_scaled(robot, scale), scaled, method=method)
        expected = estimate(robot, measurements, method=method)
        # In the other unit a torque is `scale` times the number, so a compliance is 1/scale of it.
        np.testing.assert_allclose(scale * found.compliance, expected.compliance, rtol=1e-9)

    @pytest.mark.parametrize("method", METHODS)
    @pytest.mark.parametrize("seed", range(5))
    def test_base_frame(self, pulls, method, seed):
        robot, measurements = pulls
        rng = np.random.default_rng(seed)
        rotation = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        rotation *= np.linalg.det(rotation)
        shift = rng.uniform(-5, 5, 3)
        moved = replace(
            measurements,
            force=measurements.force @ rotation.T,
            moment=measurements.moment @ rotation.T,
            position=measurements.position @ rotation.T + shift,
            deflection=measurements.deflection @ rotation.T,
        )
        found = estimate(_mounted(robot, rotation, shift), moved, method=method)
        expected = estimate(robot, measurements, method=method)
        np.testing.assert_allclose(found.compliance, expected.compliance, rtol=1e-9)

    @pytest.mark.parametrize(("method", "weighting"), METHODS_AND_WEIGHTS)
    def test_order_of_observations_and_targets(self, pulls, method, weighting):
        robot, measurements = pulls
        rng = np.random.default_rng(0)
        shuffled = measurements[rng.permutation(len(measurements))]
        order = [2, 0, 1]
        shuffled = replace(
            shuffled, position=shuffled.position[:, order], deflection=shuffled.deflection[:, order]
        )
        expected = estimate(robot, measurements, method=method, weighting=weighting)
        found = estimate(robot, shuffled, method=method, weighting=weighting)
        np.testing.assert_allclose(found.compliance, expected.compliance, rtol=1e-6)

    def test_blocks_do_not_matter(self, pulls, monkeypatch):
        expected = [estimate(*pulls, method=method) for method in METHODS]
        monkeypatch.setattr(regressor, "BLOCK_LENGTH", 5)
        for method, whole in zip(METHODS, expected, strict=True):
            pieces = estimate(*pulls, method=method)
            np.testing.assert_allclose(pieces.compliance, whole.compliance, rtol=1e-11)
            np.testing.assert_allclose(pieces.covariance, whole.covariance, rtol=1e-9, atol=1e-26)

    def test_a_missing_reading_is_as_good_as_none(self, pulls):
        """Padding for targets that were not read must not be taken for readings of zero."""
        robot, measurements = pulls
        present = measurements.present.copy()
        present[::2, 1] = False
        holes = replace(
            measurements,
            present=present,
            position=np.where(present[..., None], measurements.position, 0.0),
            deflection=np.where(present[..., None], measurements.deflection, 0.0),
        )
        found = estimate(robot, holes)
        rows = [b.A[b.measurements.present].reshape(-1, 6) for b in regressor_blocks(robot, measurements)]
        A = np.concatenate(rows)[np.repeat(present.ravel(), 3)]
        d = measurements.deflection[present].ravel()
        np.testing.assert_allclose(found.compliance, np.linalg.lstsq(A, d, rcond=None)[0], rtol=1e-9)
        assert found.degrees_of_freedom == pytest.approx(len(d) - 6)


class TestModel:
    def test_error_of_the_regressor_falls_in_proportion_to_the_load(self):
        arm = default_arm()
        robot, _ = prepare(simulate_campaign(arm, seed=0))
        plan = plan_experiment(arm, configurations=8, load="pull", force=2000.0, moment=300.0, seed=5)
        targets = np.array([[0.1, 0.15, 0.0], [0.1, -0.1, 0.12], [0.12, -0.08, -0.13]])
        errors = []
        for share in (1.0, 0.5, 0.25, 0.125):
            force, moment = share * plan.forces, share * plan.moments
            unloaded, loaded = deflections(arm, plan.joints, force, moment, plan.load_points, targets)
            (block,) = regressor_blocks(
                robot, _measurements(plan, force, moment, unloaded, loaded - unloaded)
            )
            predicted = block.A @ arm.compliances
            exact = loaded - unloaded
            errors.append(np.linalg.norm(predicted - exact) / np.linalg.norm(exact))
            linear = linear_deflections(arm, plan.joints, force, moment, plan.load_points, targets)
            np.testing.assert_allclose(predicted, linear, rtol=1e-9, atol=1e-15)
        ratios = np.array(errors[:-1]) / errors[1:]
        np.testing.assert_allclose(ratios, 2.0, atol=0.02)
        assert errors[0] < 0.01

    def test_deflections_with_targets_in_the_flange_frame_agree_with_positions(self):
        arm = default_arm()
        options = {"load": "pull", "configurations": 10, "seed": 6, "sigma": 0.0}
        by_position = estimate(*prepare(simulate_campaign(arm, readings="positions", **options)))
        by_deflection = estimate(*prepare(simulate_campaign(arm, readings="deflections", **options)))
        np.testing.assert_allclose(by_position.compliance, by_deflection.compliance, rtol=1e-9)


class TestUncertainty:
    @pytest.mark.parametrize(("method", "weighting"), METHODS_AND_WEIGHTS)
    @pytest.mark.parametrize("load", ["pull", "dead_weight"])
    def test_covariance_is_that_of_the_linear_map(self, pulls, dead_weight, method, weighting, load):
        """ĉ = H d, so its covariance is H Σ Hᵀ; H is found by moving one reading at a time."""
        robot, measurements = pulls if load == "pull" else dead_weight
        measurements = measurements[:7]  # 63 readings say as much as all: each has a column of H
        options = {"method": method, "weighting": weighting, "positive": False}
        if weighting == "characteristic_length":
            options["characteristic_length"] = 0.5
        found = estimate(robot, measurements, **options)
        step = 1e-4
        columns = []
        for index in np.ndindex(measurements.deflection.shape):
            deflection = measurements.deflection.copy()
            deflection[index] += step
            moved = estimate(robot, replace(measurements, deflection=deflection), **options)
            columns.append((moved.compliance - found.compliance) / step)
        H = np.array(columns).T
        expected = 2 * measurements.sigma**2 * H @ H.T
        scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal())) + 1e-30
        np.testing.assert_allclose(found.covariance / scale, expected / scale, atol=1e-6)

    @pytest.mark.parametrize("method", METHODS)
    def test_sigma_and_intervals_are_honest_over_many_campaigns(self, method):
        """Noise on a linear campaign: chi-square has its degrees of freedom, intervals cover."""
        arm = default_arm()
        robot, measurements = prepare(simulate_campaign(arm, load="pull", seed=7, sigma=0.0))
        (block,) = regressor_blocks(robot, measurements)
        exact = block.A @ arm.compliances
        rng = np.random.default_rng(8)
        sigma, trials = 2e-5, 200
        chi_squares, sigmas, covered = [], [], []
        for _ in range(trials):
            noisy = exact + rng.normal(0, np.sqrt(2) * sigma, exact.shape)
            given = estimate(robot, replace(measurements, deflection=noisy, sigma=sigma), method=method)
            free = estimate(robot, replace(measurements, deflection=noisy, sigma=None), method=method)
            chi_squares.append(given.chi_square / given.degrees_of_freedom)
            sigmas.append(free.sigma)
            for result in (given, free):
                truth = zip(result.joints, arm.compliances, strict=True)
                inside = [j.compliance_interval[0] <= c <= j.compliance_interval[1] for j, c in truth]
                covered.append(inside)
        freedom = given.degrees_of_freedom
        assert np.mean(chi_squares) == pytest.approx(1, abs=5 * np.sqrt(2 / freedom / trials))
        assert np.sqrt(np.mean(np.square(sigmas))) == pytest.approx(sigma, rel=0.01)
        # 200 campaigns with two intervals of 95 % each: 3.9 points are 2.5 standard deviations. A joint
        # whose intervals cover 88 % is seen with a power of 90 %; tests/studies sees smaller faults.
        assert np.abs(np.mean(covered, axis=0) - 0.95).max() < 0.039


class TestObservability:
    def test_load_that_never_twists_a_joint(self, dead_weight):
        found = estimate(*dead_weight)
        assert [joint.status for joint in found.joints] == ["not_observable"] + ["identified"] * 5
        assert "add loads that twist it" in found.joints[0].reason

    def test_target_on_the_axis(self):
        document = simulate_campaign(
            default_arm(), load="pull", targets={"P10": (0.0, 0.0, 0.3)}, readings="deflections"
        )
        found = estimate(*prepare(document))
        assert found.joints[5].status == "not_observable"
        assert "no target moves when joint_6 turns" in found.joints[5].reason

    def test_noise_that_hides_a_joint(self, dead_weight):
        """A base that leans by 1e-5 rad gives joint 1 a torque, but no information."""
        robot, measurements = dead_weight
        lean = np.array([[1, 0, 1e-5], [0, 1, 0], [-1e-5, 0, 1]])
        found = estimate(robot, replace(measurements, force=measurements.force @ lean.T))
        assert found.joints[0].status == "not_observable"
        assert "joint_1 is hidden by noise" in found.joints[0].reason
        expected = estimate(robot, measurements)
        np.testing.assert_allclose(found.compliance[1:], expected.compliance[1:], rtol=1e-2)

    def test_joints_that_show_only_together(self, pulls):
        """Two joints on one axis: their sum is determined, the other joints are not disturbed."""
        robot, measurements = pulls
        joints = list(robot.chain.joints)
        twin = replace(joints[0], name="twin", child="twin_link", rotation=np.eye(3), translation=np.zeros(3))
        chain = KinematicChain("twins", robot.chain.base, robot.chain.flange, (joints[0], twin, *joints[1:]))
        extended = replace(measurements, joints=np.insert(measurements.joints, 1, 0.0, axis=1))
        found = estimate(Robot(chain), extended)
        assert [j.status for j in found.joints[:2]] == ["not_observable"] * 2
        assert "only a combination of joint_1, twin" in found.joints[0].reason
        assert all(j.compliance is None for j in found.joints[:2])
        expected = estimate(robot, measurements)
        assert found.compliance[:2].sum() == pytest.approx(expected.compliance[0], rel=1e-9)
        np.testing.assert_allclose(found.compliance[2:], expected.compliance[1:], rtol=1e-9)
        assert found.identifiability[0].rank == 6

    @pytest.mark.parametrize("offset", [0.0, 1e-12, 1e-10, 1e-9, 1e-8, 1e-7])
    @pytest.mark.parametrize("sigma", [2e-5, None])
    def test_joints_that_nearly_show_only_together(self, pulls, offset, sigma):
        """Whatever the rounding: no number for the twins, and the degrees of freedom stay countable."""
        robot, measurements = pulls
        joints = list(robot.chain.joints)
        aside = np.array([offset, 0.0, 0.0])
        twin = replace(joints[0], name="twin", child="twin_link", rotation=np.eye(3), translation=aside)
        chain = KinematicChain("twins", robot.chain.base, robot.chain.flange, (joints[0], twin, *joints[1:]))
        extended = replace(measurements, joints=np.insert(measurements.joints, 1, 0.0, axis=1), sigma=sigma)
        found = estimate(Robot(chain), extended)
        assert [j.status for j in found.joints[:2]] == ["not_observable"] * 2
        assert found.degrees_of_freedom == pytest.approx(12 * 9 - 6, abs=1.1)
        assert found.sigma == pytest.approx(2e-5, rel=0.3)
        expected = estimate(robot, measurements)
        np.testing.assert_allclose(found.compliance[2:], expected.compliance[1:], rtol=1e-2)

    @pytest.mark.parametrize("method", METHODS)
    @pytest.mark.parametrize("sigma", [2e-5, None])
    def test_a_wrist_that_is_straight_throughout(self, method, sigma):
        """Axes 4 and 6 coincide: their sum is known, and neither of them."""
        arm = default_arm()
        robot, campaign = prepare(simulate_campaign(arm, load="pull", seed=2))
        q = campaign.joints.copy()
        q[:, 4] = 0.0
        points = np.array(list(TARGETS.values()))
        unloaded, loaded = deflections(arm, q, campaign.force, campaign.moment, campaign.load_point, points)
        noise = np.random.default_rng(0).normal(0, np.sqrt(2) * 2e-5, loaded.shape)
        moved = loaded - unloaded + noise
        straight = replace(campaign, joints=q, position=unloaded, deflection=moved, sigma=sigma)
        found = estimate(robot, straight, method=method)
        hidden = ["not_observable" if j in {3, 5} else "identified" for j in range(6)]
        assert [j.status for j in found.joints] == hidden
        assert found.sigma == pytest.approx(2e-5, rel=0.3)
        # Least squares leaves rows − p; the decoupled method, which is none, leaves a little more.
        assert 19 * 9 - 5.1 < found.degrees_of_freedom < 19 * 9 + 20
        for j in (0, 1, 2, 4):
            joint = found.joints[j]
            assert abs(joint.compliance - arm.compliances[j]) < 5 * joint.standard_uncertainty

    def test_an_arm_joint_that_does_not_move_the_wrist_centre(self, pulls):
        """A seventh axis through the wrist centre: the decoupled method cannot see it, and says so."""
        robot, measurements = pulls
        axis = np.array([1.0, 0.0, 0.0])
        before, after = robot.chain.joints[:3], robot.chain.joints[3:]
        to_centre = _wrist_centre(robot) - sum(joint.translation for joint in before)
        roll = ChainJoint("roll", "revolute", np.eye(3), to_centre, axis, None, "roll_link")
        back = replace(after[0], translation=after[0].translation - to_centre)
        chain = replace(robot.chain, joints=(*before, roll, back, *after[1:]))
        seven = replace(measurements, joints=np.insert(measurements.joints, 3, 0.0, axis=1))
        with pytest.raises(UnsupportedMethodError, match="wrist centre does not move when roll turns"):
            estimate(Robot(chain), seven, method="decoupled_partial_pose")

    def test_nothing_moved(self, pulls):
        robot, measurements = pulls
        still = replace(measurements, deflection=np.zeros_like(measurements.deflection))
        with pytest.raises(NotObservableError, match="no target moved"):
            estimate(robot, still)

    def test_as_many_readings_as_joints_and_no_sigma(self, pulls):
        robot, measurements = pulls
        few = measurements[:2]
        present = np.zeros_like(few.present)
        present[:, 0] = True
        moved = np.where(present[..., None], few.deflection, 0.0)
        found = estimate(robot, replace(few, sigma=None, present=present, deflection=moved), positive=False)
        assert found.sigma is None
        assert all(j.standard_uncertainty is None and "unknown" in j.reason for j in found.joints)

    def test_no_load_at_all(self, pulls):
        robot, measurements = pulls
        nothing = replace(measurements, force=np.zeros_like(measurements.force))
        with pytest.raises(NotObservableError, match="never twists joint_1"):
            estimate(robot, nothing)


class TestConstraints:
    def test_noise_makes_negative_stiffness_unconstrained_and_never_constrained(self, dead_weight):
        robot, measurements = dead_weight
        rng = np.random.default_rng(1)
        negative = 0
        for _ in range(25):
            noisy = measurements.deflection + rng.normal(0, 5e-4, measurements.deflection.shape)
            changed = replace(measurements, deflection=noisy, sigma=5e-4)
            for method in METHODS:
                free = estimate(robot, changed, method=method, positive=False)
                positive = estimate(robot, changed, method=method, positive=True)
                negative += (free.compliance < 0).any()
                assert (positive.compliance >= 0).all()
                assert all(c.is_optimal() for c in positive.certificates)
        assert negative > 10

    def test_stiffness_bounds_hold_and_are_named(self, pulls):
        bounds = {"joint_2": (1e6, 2e6), "joint_5": (5e5, None)}
        found = estimate(*pulls, stiffness_bounds=bounds)
        assert found.joints[1].status == found.joints[4].status == "at_bound"
        assert found.joints[1].compliance == 1 / 2e6
        assert found.joints[4].compliance == 1 / 5e5
        assert "maximum stiffness" in found.joints[1].reason
        assert "minimum stiffness" in found.joints[4].reason


class TestRefusals:
    @pytest.mark.parametrize("method", ["complete_pose", "decoupled_partial_pose"])
    def test_fewer_than_three_targets(self, method):
        campaign = prepare(simulate_campaign(default_arm(), targets={"P10": (0.1, 0.1, 0.0)}))
        with pytest.raises(UnsupportedMethodError, match="needs 3 targets") as refused:
            estimate(*campaign, method=method)
        assert refused.value.where == "observations[0].readings"

    @pytest.mark.parametrize("method", ["complete_pose", "decoupled_partial_pose"])
    def test_targets_on_a_line(self, method):
        line = {f"P{i}": (0.1, 0.05 * i, 0.0) for i in range(3)}
        campaign = prepare(simulate_campaign(default_arm(), targets=line, load="pull"))
        with pytest.raises(UnsupportedMethodError, match="on a line"):
            estimate(*campaign, method=method)

    def test_wrist_whose_axes_miss(self):
        campaign = prepare(simulate_campaign(default_arm(wrist_offset=0.05), load="pull"))
        with pytest.raises(UnsupportedMethodError, match=r"miss each other by [\d.]+ mm"):
            estimate(*campaign, method="decoupled_partial_pose")

    @pytest.mark.parametrize("method", ["partial_pose", "decoupled_partial_pose"])
    def test_characteristic_length_without_rotations(self, pulls, method):
        with pytest.raises(UnsupportedMethodError, match="needs rotations"):
            estimate(*pulls, method=method, weighting="characteristic_length")


def test_characteristic_length_is_that_of_least_condition(pulls):
    robot, measurements = pulls
    best = estimate(robot, measurements, method="complete_pose", weighting="characteristic_length")

    def condition(length: float) -> float:
        found = estimate(
            robot,
            measurements,
            method="complete_pose",
            weighting="characteristic_length",
            characteristic_length=length,
        )
        return found.identifiability[0].condition_number

    least = condition(best.characteristic_length)
    assert 0.1 < best.characteristic_length < 3
    assert all(condition(best.characteristic_length * f) > least for f in (0.5, 0.9, 1.1, 2.0))


def test_partial_pose_takes_different_targets_in_each_observation(pulls):
    robot, measurements = pulls
    present = measurements.present.copy()
    present[0] = [True, False, False]
    reduced = replace(
        measurements,
        present=present,
        deflection=np.where(present[..., None], measurements.deflection, 0.0),
    )
    found = estimate(robot, reduced)
    assert found.degrees_of_freedom == pytest.approx(3 * present.sum() - 6)


def _scaled(robot: Robot, scale: float) -> Robot:
    chain = robot.chain
    joints = tuple(replace(joint, translation=scale * joint.translation) for joint in chain.joints)
    return Robot(replace(chain, joints=joints), robot.joint_map)


def _wrist_centre(robot: Robot) -> np.ndarray:
    """In R0, all angles zero."""
    zero = Configurations(robot, np.zeros((1, robot.n)))
    return zero.to_base(np.broadcast_to(find_wrist(robot).centre, (1, 1, 3)))[0, 0]


def _mounted(robot: Robot, rotation: np.ndarray, shift: np.ndarray) -> Robot:
    """The same robot, its base placed in another frame."""
    chain = robot.chain
    mount = ChainJoint("mount", "fixed", rotation, shift, np.array([0.0, 0.0, 1.0]), None, "pedestal")
    return Robot(replace(chain, base="floor", joints=(mount, *chain.joints)), robot.joint_map)


def _measurements(plan, force, moment, unloaded, deflection) -> Measurements:
    present = np.ones(unloaded.shape[:2], dtype=bool)
    return Measurements(
        joints=np.array(plan.joints),
        force=np.array(force),
        moment=np.array(moment),
        load_point=np.broadcast_to(plan.load_points, force.shape).copy(),
        position=np.array(unloaded),
        in_flange=~present,
        deflection=np.array(deflection),
        present=present,
    )


def test_a_joint_that_the_order_holds_names_the_other():
    """Joint 6, the softest, is to be as stiff as joint 2, the stiffest: each names the other."""
    robot, measurements = prepare(simulate_campaign(default_arm(), load="pull", configurations=15, seed=5))
    joints = estimate(robot, measurements, stiffness_order=[["joint_6", "joint_2"]]).joints
    held = {each.name: each.reason.split()[-1] for each in joints if "stiffness_order" in (each.reason or "")}
    assert held == {"joint_2": "joint_6", "joint_6": "joint_2"}
