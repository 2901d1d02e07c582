"""Identification against exact springs: methods, uncertainty, observability, prismatic joints."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.campaigns import (
    ARM,
    METHODS,
    METHODS_AND_WEIGHTS,
    SIGMA,
    assert_covariance,
    covariance_by_moving,
    estimate,
    held,
    prepare,
    simulated,
    spring_columns,
    straight_wrist,
)
from support.examples import examples
from support.readings import with_encoders
from support.shared_data import shared
from support.slides import arm_on_rail, scara
from support.springs import SpringCampaign, load_cases, robot_of

from jointstiff.simulator import equilibrium, simulate_campaign, torques
from jointstiff.simulator.own_weight import Bodies, sag
from jointstiff.solver.errors import JointstiffError, MeasurementError, UnsupportedMethodError
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.estimate import predict
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.triangle import Triangle
from jointstiff.solver.mechanics import block as regressor
from jointstiff.solver.mechanics.block import OwnWeight, get_whole_block, regressor_blocks
from jointstiff.solver.mechanics.chain import ChainJoint
from jointstiff.solver.mechanics.measurements import whitener
from jointstiff.solver.mechanics.postures import Postures, find_wrist
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.models import JointModel

FANUC_STIFFNESS = (861071.8805, 2743390.9984, 2069594.5785, 359217.0978, 444155.9142, 137986.3549)
FANUC_COMPENSATION = 0.810339
FANUC_RESIDUAL = 0.34469e-3


@pytest.fixture(scope="module")
def pulls():
    """Our own simulated pulls: every joint is observable."""
    return simulated(load="pull", configurations=12, seed=3)


@pytest.fixture(scope="module")
def dead_weight():
    """Our own simulated dead weight: the first joint is not observable."""
    return simulated(load="dead_weight", seed=4)


class TestSharedData:
    @pytest.mark.parametrize("weighting", ["uniform", "covariance"])
    def test_fanuc_stiffnesses_are_those_published(self, weighting):
        robot, measurements = prepare(shared("fanuc_r2000ic/campaign"))
        found = estimate(robot, measurements, method="partial_pose", weighting=weighting)
        prediction = predict(Rows(robot, measurements), found.compliance)
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


class TestEquivalence:
    @pytest.mark.parametrize("case", ["pulls", "dead_weight", "anisotropic", "encoders", "huber"])
    def test_complete_pose_equals_partial_pose_on_a_rigid_flange(self, pulls, dead_weight, case):
        """The rigid displacement of three targets leaves nothing out, whatever they weigh."""
        robot, measurements = dead_weight if case == "dead_weight" else pulls
        options = {"loss": "huber"} if case == "huber" else {}
        if case == "encoders":
            document = simulate_campaign(ARM, load="pull", seed=3)
            robot, measurements = prepare(with_encoders(ARM, document, noise=5e-6))
        if case == "anisotropic":
            measurements = replace(measurements, covariance=np.diag([1.0, 2.0, 5.0]))
        if case == "huber":
            spoilt = measurements.deflection.copy()
            spoilt[4, 1] += 20 * SIGMA
            measurements = replace(measurements, deflection=spoilt)
        complete, partial = (
            estimate(robot, measurements, method=method, **options)
            for method in ("complete_pose", "partial_pose")
        )
        np.testing.assert_allclose(complete.compliance, partial.compliance, rtol=1e-9)
        np.testing.assert_allclose(complete.covariance, partial.covariance, rtol=1e-8, atol=1e-25)
        assert complete.chi_square == pytest.approx(partial.chi_square, rel=1e-9)

    @pytest.mark.parametrize(("method", "loss"), [*((m, "squared") for m in METHODS), (METHODS[1], "huber")])
    def test_blocks_do_not_matter(self, dead_weight, monkeypatch, method, loss):
        whole = estimate(*dead_weight, method=method, loss=loss)
        monkeypatch.setattr(regressor, "BLOCK_LENGTH", 5)
        pieces = estimate(*dead_weight, method=method, loss=loss)
        np.testing.assert_allclose(pieces.compliance, whole.compliance, rtol=1e-11)
        np.testing.assert_allclose(pieces.covariance, whole.covariance, rtol=1e-9, atol=1e-26)
        found, expected = pieces.complementary_stiffness, whole.complementary_stiffness
        assert found.largest_ratio == pytest.approx(expected.largest_ratio, rel=1e-9)
        assert found.largest_shift == pytest.approx(expected.largest_shift, rel=1e-9)


def test_the_regressor_is_that_of_the_simulator_to_first_order():
    pull = {"load": "pull", "configurations": 8, "force": 2000.0, "moment": 300.0, "seed": 5}
    robot, measurements = simulated(sigma=0.0, **pull)
    (block,) = regressor_blocks(robot, measurements)
    expected = spring_columns(measurements)
    c = ARM.compliances
    np.testing.assert_allclose(block.A * c, expected * c, rtol=1e-9, atol=1e-15)


class TestUncertainty:
    @pytest.mark.parametrize(("method", "weighting"), METHODS_AND_WEIGHTS)
    @pytest.mark.parametrize("load", ["pull", pytest.param("dead_weight", marks=pytest.mark.slow)])
    def test_covariance_is_that_of_the_linear_map(self, pulls, dead_weight, method, weighting, load):
        """ĉ = H d, so its covariance is H Σ Hᵀ; H is found by moving one reading at a time."""
        robot, measurements = pulls if load == "pull" else dead_weight
        root = np.broadcast_to(np.sqrt(2.0) * np.eye(3), (5, 3, 3, 3))
        if load == "pull":  # correlated coordinates, of each reading its own
            root = np.eye(3) + 0.5 * np.random.default_rng(0).standard_normal(root.shape)
        # 45 readings say as much as all: each has a column of H.
        measurements = replace(measurements[:5], covariance=root @ np.swapaxes(root, -1, -2))
        options = {"method": method, "weighting": weighting, "positive": False}
        if weighting == "characteristic_length":
            options["characteristic_length"] = 0.5
        nothing = np.zeros_like(measurements.deflection)

        def compliance(white=nothing):
            deflection = measurements.deflection + (root @ white[..., None])[..., 0]
            return estimate(robot, replace(measurements, deflection=deflection), **options).compliance

        expected = covariance_by_moving(compliance, white=(nothing, measurements.sigma))
        assert_covariance(estimate(robot, measurements, **options).covariance, expected, atol=1e-6)

    @pytest.mark.parametrize(
        ("method", "trials"),
        [
            *((method, 60) for method in METHODS[1:]),
            *(pytest.param(method, 200, marks=pytest.mark.slow) for method in METHODS),
        ],
    )
    def test_sigma_and_intervals_are_honest_over_many_campaigns(self, method, trials):
        """Noise on a linear campaign: chi-square has its degrees of freedom, intervals cover."""
        robot, measurements = simulated(load="pull", seed=7, sigma=0.0)
        (block,) = regressor_blocks(robot, measurements)
        exact = block.A @ ARM.compliances
        rng = np.random.default_rng(8)
        chi_squares, sigmas, covered = [], [], []
        for _ in range(trials):
            noisy = exact + rng.normal(0, np.sqrt(2) * SIGMA, exact.shape)
            given, free = (
                estimate(robot, replace(measurements, deflection=noisy, sigma=sigma), method=method)
                for sigma in (SIGMA, None)
            )
            chi_squares.append(given.chi_square / given.degrees_of_freedom)
            sigmas.append(free.sigma)
            covered += [held(result.joints, ARM.compliances) for result in (given, free)]
        freedom = given.degrees_of_freedom
        assert np.mean(chi_squares) == pytest.approx(1, abs=5 * np.sqrt(2 / freedom / trials))
        assert np.sqrt(np.mean(np.square(sigmas))) == pytest.approx(
            SIGMA, rel=2.5 / np.sqrt(2 * freedom * trials)
        )
        # 200 campaigns see a coverage of 88 % with a power of 90 %; tests/studies see smaller faults.
        assert np.abs(np.mean(covered, axis=0) - 0.95).max() < 2.5 * np.sqrt(0.95 * 0.05 / trials)


class TestObservability:
    @pytest.mark.parametrize("method", METHODS)
    @pytest.mark.parametrize("sigma", [SIGMA, None])
    def test_a_wrist_that_is_straight_throughout(self, method, sigma):
        """Axes 4 and 6 coincide, turning the same way: their sum is known, and neither of them."""
        robot, exact = straight_wrist(0.0)
        noise = np.random.default_rng(0).normal(0, np.sqrt(2) * SIGMA, exact.deflection.shape)
        straight = replace(exact, deflection=exact.deflection + noise, sigma=sigma)
        found = estimate(robot, straight, method=method)
        hidden = ["not_observable" if j in {3, 5} else "identified" for j in range(6)]
        assert [j.status for j in found.joints] == hidden
        assert "c(joint_4) + c(joint_6):" in found.joints[3].reason
        assert found.joints[5].reason == found.joints[3].reason
        assert found.sigma == pytest.approx(SIGMA, rel=0.3)
        # Least squares leaves rows − p; the decoupled method, which is none, leaves a little more.
        assert 19 * 9 - 5.1 < found.degrees_of_freedom < 19 * 9 + 20
        for j in (0, 1, 2, 4):
            joint = found.joints[j]
            assert abs(joint.compliance - ARM.compliances[j]) < 5 * joint.standard_uncertainty

    def test_an_arm_joint_that_does_not_move_the_wrist_centre(self, pulls):
        """A seventh axis through the wrist centre: the decoupled method cannot see it, and says so."""
        robot, measurements = pulls
        axis = np.array([1.0, 0.0, 0.0])
        before, after = robot.chain.joints[:3], robot.chain.joints[3:]
        zero = Postures(robot, np.zeros((1, robot.n)))
        wrist_centre = zero.to_base(np.broadcast_to(find_wrist(robot).centre, (1, 1, 3)))[0, 0]
        to_centre = wrist_centre - sum(joint.translation for joint in before)
        roll = ChainJoint("roll", "revolute", np.eye(3), to_centre, axis, None, "roll_link")
        back = replace(after[0], translation=after[0].translation - to_centre)
        chain = replace(robot.chain, joints=(*before, roll, back, *after[1:]))
        seven = replace(measurements, joints=np.insert(measurements.joints, 3, 0.0, axis=1))
        with pytest.raises(UnsupportedMethodError, match="wrist centre does not move when roll turns"):
            estimate(Robot(chain.model()), seven, method="decoupled_partial_pose")


def test_noise_makes_negative_stiffness_unconstrained_and_never_constrained(dead_weight):
    robot, measurements = dead_weight
    rng = np.random.default_rng(1)
    negative = 0
    for _ in range(10):
        noisy = measurements.deflection + rng.normal(0, 1e-3, measurements.deflection.shape)
        changed = replace(measurements, deflection=noisy, sigma=1e-3)
        for method in METHODS:
            free = estimate(robot, changed, method=method, positive=False)
            positive = estimate(robot, changed, method=method, positive=True)
            negative += (free.compliance < 0).any()
            assert (positive.compliance >= 0).all()
            assert all(c.is_optimal() for c in positive.certificates)
    assert negative > 4


class TestRefusals:
    @pytest.mark.parametrize("method", ["complete_pose", "decoupled_partial_pose"])
    @pytest.mark.parametrize(
        ("targets", "reason"),
        [
            ({"P10": (0.1, 0.1, 0.0)}, r"^observations\[0\].readings: .* needs 3 targets"),
            ({f"P{i}": (0.1, 0.05 * i, 0.0) for i in range(3)}, "on a line"),
        ],
    )
    def test_targets_that_show_no_pose(self, method, targets, reason):
        with pytest.raises(UnsupportedMethodError, match=reason):
            estimate(*simulated(targets=targets, load="pull"), method=method)


@pytest.fixture(scope="module")
def campaign():
    return simulated(load="pull", configurations=6, seed=2)


@pytest.mark.parametrize("q", [np.zeros((2, 5)), np.zeros(6), np.full((1, 6), np.nan)])
def test_angles_of_another_shape_are_refused(campaign, q):
    with pytest.raises(MeasurementError, match="joint angles have shape"):
        Postures(campaign[0], q)


@examples(50)
@given(cuts=st.lists(st.integers(0, 40), max_size=4), seed=st.integers(0, 2**32 - 1))
def test_any_partition_keeps_every_residual(cuts, seed):
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((40, 5)) * 10.0 ** rng.uniform(-6, 6, 5)
    triangle = Triangle(joints=4)
    for part in np.split(rows, sorted(cuts)):
        triangle.add(part)
    assert triangle.rows == 40
    scale = np.linalg.norm(rows, axis=0)
    for _ in range(5):
        x = rng.standard_normal(5) / scale
        full, compressed = (np.linalg.norm(M @ x) for M in (rows, triangle.R))
        assert compressed == pytest.approx(full, rel=1e-12)


@pytest.mark.parametrize(
    "bad",
    [
        np.diag([1.0, 1.0, 0.0]),
        np.diag([1.0, -1.0, 1.0]),
        np.array([[1.0, 0.5, 0], [0.2, 1.0, 0], [0, 0, 1.0]]),
        np.diag([1.0, np.nan, 1.0]),
        np.diag([1.0, np.inf, 1.0]),
    ],
)
def test_refuses_what_is_no_covariance(bad):
    with pytest.raises(MeasurementError, match="not finite, symmetric and positive definite"):
        whitener(bad)


class TestMeasurements:
    @pytest.mark.parametrize("name", ["joints", "force", "moment", "load_point", "position", "deflection"])
    def test_refuses_what_is_not_finite_and_wrong_shapes(self, campaign, name):
        _, measurements = campaign
        array = getattr(measurements, name).copy()
        array.flat[0] = np.nan
        with pytest.raises(MeasurementError, match="not finite") as refused:
            replace(measurements, **{name: array})
        assert refused.value.where == name
        with pytest.raises(MeasurementError, match="shape"):
            replace(measurements, **{name: getattr(measurements, name)[:-1].copy()})

    @pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, np.inf])
    def test_refuses_sigma(self, campaign, sigma):
        with pytest.raises(MeasurementError, match="sigma"):
            replace(campaign[1], sigma=sigma)

    def test_refuses_no_observation(self, campaign):
        with pytest.raises(MeasurementError, match="no observation"):
            campaign[1][:0]

    @pytest.mark.parametrize("names", ["labels", "targets"])
    def test_names_of_another_number_are_refused(self, campaign, names):
        with pytest.raises(MeasurementError, match=f"7 {names}"):
            replace(campaign[1], **{names: tuple("abcdefg")})


def test_errors_say_where_why_and_what_to_do_even_in_another_process():
    sent = UnsupportedMethodError("too few targets", where="readings", remedy="read three")
    assert isinstance(sent, JointstiffError)
    received = pickle.loads(pickle.dumps(sent))
    assert type(received) is UnsupportedMethodError
    for error in (sent, received):
        assert str(error) == "readings: too few targets; read three"
        assert (error.reason, error.where, error.remedy) == ("too few targets", "readings", "read three")


ROBOTS = {"SCARA": scara(), "arm on a rail": arm_on_rail()}
every_robot = pytest.mark.parametrize("arm", ROBOTS.values(), ids=ROBOTS.keys())


def exact_readings(arm, *, configurations=24, seed=1, force=1500.0):
    campaign = SpringCampaign.of(arm, configurations=configurations, seed=seed, force=force)
    return robot_of(arm), campaign.measurements(campaign.unloaded, campaign.loaded, sigma=SIGMA)


def model_of(arm, weight=None):
    n = len(arm.stiffnesses)
    return JointModel(robot_of(arm), arm.compliances, None, Constraints(Bounds.positive(n)), weight=weight)


@every_robot
def test_columns_and_efforts_are_those_of_the_simulator(arm):
    robot, load = robot_of(arm), load_cases(arm)
    at = Postures(robot, load.joints)
    posture = arm.posture(load.joints)
    point = posture.point_to_base(load.load_point)
    columns, effort = at.load(load.load_point, load.force, load.moment)
    np.testing.assert_allclose(columns, posture.velocities(point).transpose(0, 2, 1), atol=1e-14)
    np.testing.assert_allclose(
        effort, torques(arm, load.joints, load.force, load.moment, load.load_point), atol=1e-10
    )
    (slide,) = arm.prismatic
    along = np.einsum("bi,bi->b", posture.axis_directions[:, slide], load.force)
    np.testing.assert_allclose(effort[:, slide], along, atol=1e-10)
    assert not at.angular_jacobian[:, :, slide].any()


@every_robot
def test_complementary_stiffness_is_the_derivative_of_the_efforts(arm):
    robot, measurements = exact_readings(arm, configurations=5)
    plan, step = SpringCampaign.of(arm, configurations=5, seed=1).experiment, 1e-6
    measurements = replace(measurements, moment=np.tile([40.0, -60.0, 90.0], (5, 1)))
    wrench = (measurements.force, measurements.moment, measurements.load_point)
    expected = np.stack(
        [
            (torques(arm, plan.joints + h, *wrench) - torques(arm, plan.joints - h, *wrench)) / (2 * step)
            for h in step * np.eye(len(arm.stiffnesses))
        ],
        axis=-1,
    )
    found = get_whole_block(robot, measurements).complementary_stiffness
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@every_robot
@pytest.mark.parametrize("method", ["partial_pose", "complete_pose"])
def test_identification_is_exact(arm, method):
    """K_c is included up to the third order of the deflection: the error falls with the load's square."""
    options = {"method": method, "complementary_stiffness": "included"}
    errors = []
    for force in (500.0, 50.0, 10.0):
        found = estimate(*exact_readings(arm, force=force), **options)
        errors.append(np.abs(found.compliance * arm.stiffnesses - 1.0).max())
    assert errors[0] < 2e-6
    assert errors[1] < 0.02 * errors[0]
    assert errors[2] < 1e-9


@every_robot
@pytest.mark.parametrize("moment", [0.0, 60.0])
def test_predictions_are_those_of_the_exact_balance(arm, moment):
    load = load_cases(arm, moment=moment)
    found = model_of(arm).deflect(load)
    bent = load.joints + equilibrium(arm, load.joints, load.force, load.moment, load.load_point)
    before, after = (arm.posture(q).point_to_base(load.place) for q in (load.joints, bent))
    np.testing.assert_allclose(found.displacement, after - before, rtol=0, atol=5e-14)


def bodies_of(arm, seed=7):
    generator = np.random.default_rng(seed)
    n = len(arm.stiffnesses)
    return Bodies(
        generator.uniform(5.0, 60.0, n), generator.uniform(-0.2, 0.2, (n, 3)), np.array([1.0, 2.0, -9.0])
    )


@every_robot
def test_own_weight_of_a_prismatic_joint_is_the_weight_along_its_axis(arm):
    robot, bodies = robot_of(arm), bodies_of(arm)
    frames, origins = Postures(robot, np.zeros((1, robot.n))).joint_frames
    centre = np.einsum("jki,jk->ji", frames[0], arm.axis_points + bodies.centres - origins[0])
    weight = OwnWeight(bodies.masses, centre, bodies.gravity)
    q = load_cases(arm).joints
    effort, slope = weight.torque_and_stiffness(robot, Postures(robot, q))
    (slide,) = arm.prismatic
    along = arm.posture(q).axis_directions[:, slide] @ bodies.gravity
    np.testing.assert_allclose(effort[:, slide], along * bodies.masses[slide:].sum(), rtol=1e-12)
    step = 1e-6
    for k, h in enumerate(step * np.eye(robot.n)):
        ahead, behind = (weight.torque_and_stiffness(robot, Postures(robot, q + s))[0] for s in (h, -h))
        np.testing.assert_allclose(slope[:, :, k], (ahead - behind) / (2 * step), atol=1e-5)
    # The springs' sag by the energy's minimum: relative to the posture that the weight alone takes.
    load = load_cases(arm, force=300.0, moment=0.0)
    at_rest = load.joints + sag(arm, bodies, load.joints)
    loaded = load.joints + sag(arm, bodies, load.joints, force=load.force, load_point=load.load_point)
    before, after = (arm.posture(each).point_to_base(load.place) for each in (at_rest, loaded))
    found = model_of(arm, weight).deflect(replace(load, joints=at_rest))
    np.testing.assert_allclose(found.displacement, after - before, rtol=0, atol=5e-12)


def test_a_wrist_turns():
    assert find_wrist(robot_of(scara())) is None
    assert find_wrist(robot_of(arm_on_rail())).spherical


def test_an_order_across_arm_and_wrist_holds_at_the_constrained_arm():
    """The decoupled method fits the wrist to the arm as the order leaves it, not as its readings show it."""
    order = [["joint_3", "joint_2"], ["joint_6", "joint_3"]]
    campaign = simulated(load="pull", configurations=15, seed=5)
    c = estimate(*campaign, method="decoupled_partial_pose", stiffness_order=order).compliance
    np.testing.assert_allclose(c[[2, 5]], c[1], rtol=1e-12)
