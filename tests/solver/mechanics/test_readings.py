"""Readings of all kinds, and the terms that explain them: springs, own stiffness of the load, the base."""

from dataclasses import replace

import numpy as np
import pytest
from reference.kinematics import product_of_exponentials
from support.campaigns import (
    ARM,
    METHODS,
    METHODS_AND_WEIGHTS,
    POINTS,
    SIGMA,
    assert_covariance,
    covariance_by_moving,
    estimate,
    prepare,
    simulated,
    wrench_of,
)
from support.readings import with_encoders
from support.slides import arm_on_rail, scara
from support.springs import robot_of

from jointstiff.schemas.options import CrossValidation
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.base import pedestal_campaign
from jointstiff.simulator.campaign import LOAD_POINT
from jointstiff.simulator.equilibrium import deflections, torques
from jointstiff.solver.choice.held_out import WITH_BASE, Folds, list_models_to_compare
from jointstiff.solver.errors import SolverError
from jointstiff.solver.evidence.causes import screen_estimate
from jointstiff.solver.evidence.term_tests import LINKS_LEVEL
from jointstiff.solver.fit import identify as iteration
from jointstiff.solver.fit.cone import to_vector
from jointstiff.solver.fit.effective import build_effective_rows, compute_effective_compliances
from jointstiff.solver.fit.estimate import predict
from jointstiff.solver.fit.part import generate_elastic_rows
from jointstiff.solver.fit.reduced import Candidate
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.integrity import inspect_measurements
from jointstiff.solver.mechanics import block as regressor
from jointstiff.solver.mechanics.block import OwnWeight, regressor_blocks
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.measurements import Instrument
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.springs import BASE, NEGLECTED_STIFFNESS
from jointstiff.solver.models import ELASTIC_MODELS, Columns, find_model
from jointstiff.solver.predict.models import ElasticPredictor

ENCODER_SIGMA = 5e-6


def campaign(*, joints=None, noise=ENCODER_SIGMA, **options):
    document = simulate_campaign(ARM, **{"load": "pull", "seed": 3, **options})
    return with_encoders(ARM, document, joints=joints, sigma=ENCODER_SIGMA, noise=noise), document


def prepared(**options):
    return prepare(campaign(**options)[0])


def changed(measurements, **encoders):
    return replace(measurements, encoders=replace(measurements.encoders, **encoders))


@pytest.mark.parametrize("method", ["partial_pose", "complete_pose"])
@pytest.mark.parametrize(("joints", "every"), [([1], 1), ([0, 1, 2], 1), (None, 1), (None, 2)])
def test_information_adds_up_exactly(method, joints, every):
    """Of the joints that have encoders, in the observations where they were read."""
    robot, measurements = prepared(joints=joints)
    present = measurements.encoders.present.copy()
    present[np.arange(len(present)) % every > 0] = False
    m = changed(measurements, present=present)
    torque = torques(ARM, m.joints, *wrench_of(m))
    added = np.where(present, torque**2, 0.0).sum(axis=0) / (2 * ENCODER_SIGMA**2)
    before, after = (
        estimate(robot, each, method=method, positive=False).covariance
        for each in (replace(m, encoders=None), m)
    )
    expected = np.linalg.inv(before) + np.diag(added)
    np.testing.assert_allclose(np.linalg.inv(after), expected, rtol=1e-7, atol=1e-7 * np.abs(expected).min())
    seen = present.any(axis=0)
    assert (np.diag(after)[seen] < np.diag(before)[seen]).all()


@pytest.mark.parametrize("method", METHODS)
def test_covariance_is_that_of_a_linear_function_of_all_readings(method):
    """ĉ = H d: H by perturbing one reading at a time, then H Σ Hᵀ with no formula of ours."""
    robot, measurements = prepared(configurations=4)

    def compliance(targets=measurements.deflection, encoders=measurements.encoders.deflection):
        moved = replace(changed(measurements, deflection=encoders), deflection=targets)
        return estimate(robot, moved, method=method, positive=False).compliance

    expected = covariance_by_moving(
        compliance,
        targets=(measurements.deflection, np.sqrt(2) * SIGMA),
        encoders=(measurements.encoders.deflection, np.sqrt(2) * ENCODER_SIGMA),
    )
    found = estimate(robot, measurements, method=method, positive=False)
    assert_covariance(found.covariance, expected, atol=1e-7)


@pytest.mark.parametrize("seed", range(10))
def test_clean_encoders_raise_no_finding(seed):
    assert not inspect_measurements(*prepared(seed=seed), degrees=False)


def test_predicted_deflections_are_those_of_springs_under_a_small_load():
    robot, measurements = prepared(noise=0.0, force=10.0)
    predicted = predict(Rows(robot, measurements), ARM.compliances).encoders
    exact = measurements.encoders.deflection
    np.testing.assert_allclose(predicted, exact, atol=2e-4 * np.abs(exact).max())


STATION = (3.5, -2.0, 0.8)
SHEET = {
    "range": {"constant": 3e-6, "per_distance": 1e-6},
    "transverse": {"constant": 2e-5, "per_distance": 2e-5},
}
TRACKER = {"instrument": {"station": list(STATION), **SHEET}}


def pulled(noise, **options):
    document = simulate_campaign(ARM, load="pull", seed=4, **options)
    document["measurement_set"]["noise"] = noise
    return document


def readings_of(document):
    return [r for o in document["measurement_set"]["observations"] for r in o["readings"]]


def estimate_of(document, **options):
    return estimate(*prepare(document), **options)


def same_estimates(one, other):
    np.testing.assert_allclose(one.compliance, other.compliance, rtol=1e-9)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-9)
    assert one.chi_square == pytest.approx(other.chi_square, rel=1e-9)
    assert one.degrees_of_freedom == pytest.approx(other.degrees_of_freedom)
    for a, b in zip(one.joints, other.joints, strict=True):
        np.testing.assert_allclose(a.compliance_interval, b.compliance_interval, rtol=1e-6)


class TestInstrument:
    @pytest.mark.parametrize(
        ("instrument", "place", "covariance"),
        [
            # Along and across the line of sight, at 5 m and at 10 m.
            (((1, 0, 0), 1e-5, 2e-6, 3e-5, 4e-6), (6, 0, 0), np.diag([2e-5, 5e-5, 5e-5]) ** 2),
            (((1, 0, 0), 1e-5, 2e-6, 3e-5, 4e-6), (1, -10, 0), np.diag([7e-5, 3e-5, 7e-5]) ** 2),
            # In the direction (3, 4, 0)/5, by hand: σ_r = 1, σ_t = 2 give Σ = 4 I − 3 u uᵀ.
            (
                ((0, 0, 0), 1.0, 0.0, 2.0, 0.0),
                (3, 4, 0),
                [[2.92, -1.44, 0.0], [-1.44, 2.08, 0.0], [0.0, 0.0, 4.0]],
            ),
        ],
    )
    def test_covariance_by_hand(self, instrument, place, covariance):
        found = Instrument(*instrument).covariance(np.array([place], dtype=float))
        np.testing.assert_allclose(found[0], covariance, rtol=1e-12, atol=1e-15 * np.max(covariance))


class TestKindsAgree:
    """The same noise said in three ways is one noise, in every method and unit."""

    def test_targets_given_in_the_flange_are_as_far_as_those_read(self):
        documents = (pulled(TRACKER, readings=readings) for readings in ("positions", "deflections"))
        by_position, in_flange = (m.sigma**2 * m.covariance for _, m in map(prepare, documents))
        np.testing.assert_allclose(in_flange, by_position, atol=1e-4 * by_position.max())

    def test_equal_per_reading_and_by_instrument(self):
        """Covariances worked out here, reading by reading, are those of the instrument."""
        by_hand = pulled(None)
        for reading in readings_of(by_hand):
            for state in ("unloaded", "loaded"):
                reading[f"{state}_covariance"] = covariance_at(reading[state])
        same_estimates(estimate_of(pulled(TRACKER)), estimate_of(by_hand))


def covariance_at(place):
    """By rotation into the line of sight, unlike the projection under test."""
    sight = np.subtract(place, STATION)
    d = np.linalg.norm(sight)
    axes = np.linalg.qr(np.column_stack([sight, np.eye(3)[:, :2]]))[0]
    r, t = (SHEET[k]["constant"] + SHEET[k]["per_distance"] * d for k in ("range", "transverse"))
    matrix = axes @ np.diag([r**2, t**2, t**2]) @ axes.T
    return (0.5 * (matrix + matrix.T)).tolist()


def exact(load="pull", *, configurations=19, **options):
    """Readings without noise, of springs that balance the load, with the sigma that a tracker would have."""
    options = {"load": load, "configurations": configurations, "sigma": 0.0, "seed": 3} | options
    robot, measurements = simulated(**options)
    return robot, replace(measurements, sigma=SIGMA)


@pytest.fixture(scope="module")
def pulls():
    return exact()


@pytest.fixture(scope="module")
def dead_weight():
    return exact("dead_weight")


def derivative(measurements, step=1e-5):
    """(N, 6, 6) derivatives of the simulator's torques by the joints [N·m/rad]."""
    load = wrench_of(measurements)
    ends = [
        [torques(ARM, measurements.joints + s * np.eye(6)[k], *load) for s in (step, -step)] for k in range(6)
    ]
    return np.stack([(ahead - behind) / (2 * step) for ahead, behind in ends], axis=-1)


class TestMatrix:
    @pytest.mark.parametrize("moment", [0.0, 400.0])
    def test_is_the_derivative_of_the_simulators_torques(self, moment):
        robot, measurements = exact(configurations=7, moment=moment, seed=11)
        measurements = replace(measurements, moment=measurements.moment * [1.0, 1.0, 0.0])
        (block,) = regressor_blocks(robot, measurements)
        # Torques of 4 kN.m have third derivatives of as much, and 1e-12 of rounding.
        np.testing.assert_allclose(block.complementary_stiffness, derivative(measurements), atol=1e-5)

    def test_its_greatest_ratio_is_that_over_all_postures(self, pulls):
        robot, measurements = pulls
        found = estimate(robot, measurements)
        ratios = np.abs(derivative(measurements)) * found.compliance[:, None]
        assert found.complementary_stiffness.largest_ratio == pytest.approx(ratios.max(), rel=1e-6)
        assert ratios.max(axis=(1, 2)).argmax() not in (0, len(measurements) - 1)

    def test_what_is_neglected_is_second_order_and_known_to_third(self):
        errors = []
        for force in (1500.0, 150.0):
            robot, measurements = exact(force=force, moment=0.2 * force)
            (block,) = regressor_blocks(robot, measurements)
            missing = measurements.deflection - block.A @ ARM.compliances
            found = NEGLECTED_STIFFNESS.motion(block, ARM.compliances).targets[..., 0]
            assert np.abs(found - missing).max() < 0.02 * np.abs(missing).max()
            errors.append(np.abs(found - missing).max())
        assert errors[0] / errors[1] == pytest.approx(1000.0, rel=0.05)


class TestDeflectedRegressor:
    @pytest.mark.parametrize("readings", ["positions", "deflections"])
    def test_predicts_the_exact_deflection_to_third_order(self, readings):
        errors = []
        for force in (1500.0, 150.0):
            robot, measurements = exact(force=force, moment=0.2 * force, readings=readings)
            (block,) = regressor_blocks(robot, measurements, ARM.compliances)
            error = np.abs(block.A @ ARM.compliances - measurements.deflection).max()
            assert error < 2e-6 * np.abs(measurements.deflection).max()
            errors.append(error)
        assert errors[0] / errors[1] == pytest.approx(1000.0, rel=0.05)

    def test_torques_are_those_of_the_balance(self, pulls):
        robot, measurements = pulls
        (block,) = regressor_blocks(robot, measurements, ARM.compliances)
        bent = measurements.joints + ARM.compliances * block.torque
        expected = torques(ARM, bent, *wrench_of(measurements))
        np.testing.assert_allclose(block.torque, expected, rtol=1e-10, atol=1e-9)


class TestIncluded:
    @pytest.mark.parametrize("load", ["pull", "dead_weight"])
    @pytest.mark.parametrize(("method", "weighting"), METHODS_AND_WEIGHTS)
    def test_removes_the_bias(self, method, weighting, load):
        robot, measurements = exact(load)
        options = {"method": method, "weighting": weighting}
        neglected = estimate(robot, measurements, **options)
        included = estimate(robot, measurements, complementary_stiffness="included", **options)
        known = np.array([joint.compliance is not None for joint in included.joints])
        truth, uncertainty = ARM.compliances[known], np.sqrt(np.diag(included.covariance))[known]
        bias = np.abs(included.compliance[known] - truth)
        assert (bias / truth).max() < 1e-5
        assert (bias / uncertainty).max() < 1e-3
        # A fifth for weightings of larger uncertainty, three quarters for the decoupled method.
        before = np.abs(neglected.compliance[known] - truth)
        assert 0.15 < (before / uncertainty).max() < 0.9

    def test_prediction_is_the_exact_balance(self, pulls):
        robot, measurements = pulls
        found = estimate(robot, measurements, complementary_stiffness="included")
        included = predict(Rows(robot, measurements, found.compliance), found.compliance)
        linear = predict(Rows(robot, measurements), found.compliance)
        load = measurements.force, measurements.moment, LOAD_POINT
        unloaded, loaded = deflections(ARM, measurements.joints, *load, POINTS)
        assert np.abs(included.predicted - (loaded - unloaded)).max() < 1e-8
        assert included.rms_residual < 1e-8 < 1e-6 < linear.rms_residual

    def test_compliances_that_never_settle_are_no_answer_and_the_answer_without_k_c_says_why(
        self, pulls, monkeypatch
    ):
        monkeypatch.setattr(iteration, "MAX_ITERATIONS", 1)
        with pytest.raises(SolverError, match="still change"):
            iteration.find_rest(np.cos, np.zeros(1), unit=np.array([1e-9]), most_steps=1)
        found = estimate(*pulls, complementary_stiffness="included")
        effect, neglected = found.complementary_stiffness, estimate(*pulls)
        assert (effect.included, effect.iterations) == (False, 0)
        assert "still change" in effect.obstacle
        assert np.array_equal(found.compliance, neglected.compliance)


class TestReported:
    def test_shift_of_a_large_set_is_that_of_an_even_part_of_it(self, monkeypatch):
        robot, measurements = exact("dead_weight", configurations=200)
        whole = estimate(robot, measurements).complementary_stiffness
        monkeypatch.setattr(regressor, "BLOCK_LENGTH", 30)
        monkeypatch.setattr(iteration, "SHIFT_OBSERVATIONS", 100)
        part = estimate(robot, measurements).complementary_stiffness
        assert part.largest_ratio == pytest.approx(whole.largest_ratio, rel=1e-12)
        assert part.largest_shift == pytest.approx(whole.largest_shift, rel=0.1)
        assert part.largest_shift != whole.largest_shift


STIFFNESS, FOOT = np.array([8e6, 2e7]), -0.8
COLUMNS = Columns(6, tuple(range(6)))
TILT = np.array([[0.0, FOOT, 0.0, 1.0, 0.0, 0.0], [-FOOT, 0.0, 0.0, 0.0, 1.0, 0.0]])
"""Motion of R0's origin by a tilt about x and y of the foot: translation, then rotation."""


def compliances():
    """Compliances of the arm, and of its pedestal about the origin of R0."""
    truth = np.zeros(COLUMNS.width)
    truth[COLUMNS.joints] = ARM.compliances
    truth[COLUMNS.link_columns(BASE)] = to_vector(TILT.T @ np.diag(1.0 / STIFFNESS) @ TILT)
    return truth


@pytest.mark.parametrize("force", [1500.0, 150.0])
def test_the_exact_balance_on_a_pedestal_is_the_linear_model_to_first_order(force):
    document = pedestal_campaign(ARM, STIFFNESS, foot=FOOT, configurations=8, force=force, sigma=0.0, seed=2)
    robot, measurements = prepare(document)
    rows = np.concatenate(
        [each.targets[..., :-1] for each in generate_elastic_rows(Rows(robot, measurements), COLUMNS)]
    )
    apart = np.abs(rows @ compliances() - measurements.deflection).max()
    assert apart < 2.0e-6 * force * np.abs(measurements.deflection).max()


def test_a_turn_of_the_base_about_the_first_axis_is_joint_1(pedestal):
    robot, measurements = pedestal
    found, *_ = generate_elastic_rows(Rows(robot, measurements), COLUMNS)
    rows = found.targets
    about = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    turned = rows[..., COLUMNS.link_columns(BASE)] @ to_vector(np.outer(about, about))
    np.testing.assert_allclose(turned, rows[..., 0], atol=1e-9 * np.abs(rows[..., 0]).max())
    effective = build_effective_rows(robot, COLUMNS)[:, COLUMNS.link_columns(BASE)] @ to_vector(
        np.outer(about, about)
    )
    np.testing.assert_allclose(effective, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-12)


@pytest.fixture(scope="module")
def pedestal():
    return prepare(pedestal_campaign(ARM, STIFFNESS, foot=FOOT, seed=1))


@pytest.fixture(scope="module")
def found(pedestal):
    folds = Folds(Rows(*pedestal), COLUMNS, np.ones(6, dtype=bool), CrossValidation(folds=3, draws=1), None)
    return folds.fit_whole_set(Candidate(find_model("joints_and_base"), COLUMNS), 1e-3)


def test_base_and_joints_are_found_together(pedestal, found):
    effective = compute_effective_compliances(pedestal[0], found, 0.95)
    np.testing.assert_allclose(effective.compliance[:3], ARM.compliances[:3], rtol=0.05)
    assert found.base is not None
    assert found.base.parameters == 21
    softest = [each.value for each in found.base.rotation]
    np.testing.assert_allclose(softest[:2], 1.0 / STIFFNESS, rtol=0.15)
    assert softest[2] < 0.1 * softest[1]
    assert not found.links
    assert [each.kind for each in found.elements].count("base") == 1


def test_the_model_predicts_other_postures_and_places(pedestal, found):
    """At other postures, and where no target was."""
    robot = pedestal[0]
    document = pedestal_campaign(ARM, STIFFNESS, foot=FOOT, configurations=20, sigma=0.0, seed=9)
    _, other = prepare(document)
    at = Postures(robot, other.joints)
    place = (other.position[:, 0] - at.flange_translation)[:, None] @ at.flange_rotation
    cases = LoadCases(other.joints, other.force, other.moment, other.load_point, place[:, 0])
    predicted = ElasticPredictor.from_estimate(robot, found).deflect(cases)
    off = np.linalg.norm(predicted.displacement - other.deflection[:, 0], axis=1)
    assert off.mean() < 0.02 * np.linalg.norm(other.deflection[:, 0], axis=1).mean()


def test_a_test_speaks_for_a_pedestal_and_links_have_nothing_to_say_beside_it(pedestal):
    screening = screen_estimate(Rows(*pedestal), estimate(*pedestal))
    assert screening.base_needs_validation
    assert screening.base_p_value < 1e-20
    assert screening.links_p_value_with_base > LINKS_LEVEL
    assert list_models_to_compare(screening, None) == ("joints", "joints_and_base")


def test_a_clean_arm_has_no_base(pedestal):
    clean = prepare(pedestal_campaign(ARM, np.inf, seed=1))
    screening = screen_estimate(Rows(*clean), estimate(*clean))
    assert not screening.base_needs_validation
    assert not WITH_BASE & set(list_models_to_compare(screening, None))
    assert not WITH_BASE & set(list_models_to_compare(screening, "joints_and_links"))
    assert list_models_to_compare(screening, "joints_and_base") == tuple(each.name for each in ELASTIC_MODELS)


@pytest.mark.parametrize("make", [scara, arm_on_rail, default_arm])
def test_own_weight_pulls_as_its_energy_falls(make):
    """Energy by a product of exponentials in extended precision, and its differences."""
    robot, rng = robot_of(make()), np.random.default_rng(1)
    mass, centre = rng.uniform(1.0, 20.0, robot.n), rng.uniform(-0.3, 0.3, (robot.n, 3))
    gravity, q, steps = np.array([1.0, -2.0, -9.0]), rng.uniform(-1.0, 1.0, robot.n), 1e-4 * np.eye(robot.n)

    def energy(q):
        frames = product_of_exponentials(robot.chain, q)[1]
        places = (frames[:, :3, :3] @ centre[..., None])[..., 0] + frames[:, :3, 3]
        return -(mass * (places @ gravity)).sum()

    def torque(q):
        return np.array([energy(q - h) - energy(q + h) for h in steps]) / 2e-4

    stiffness = np.stack([torque(q + h) - torque(q - h) for h in steps], axis=1) / 2e-4
    weight, at = OwnWeight(mass, centre, gravity), Postures(robot, q[None])
    pull, change = weight.torque_and_stiffness(robot, at)
    np.testing.assert_allclose(pull[0], torque(q).astype(float), atol=1e-5)
    np.testing.assert_allclose(change[0], stiffness.astype(float), atol=1e-5)
