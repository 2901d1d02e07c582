"""Secondary encoders as observations: information adds up in every method, and mistakes are noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import METHODS, estimate, prepare, settings_of
from support.encoders import with_encoders

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.campaign import torques
from jointstiff.simulator.document import experiment_of
from jointstiff.solver.convex.problem import Bounds
from jointstiff.solver.errors import MeasurementError, UnsupportedMethodError
from jointstiff.solver.evidence.prediction import predict_encoders
from jointstiff.solver.integrity import inspect
from jointstiff.solver.readings.measurements import EncoderReadings
from jointstiff.solver.resampling import ResamplingPlan, gram_blocks, resample

ARM = default_arm()
SIGMA, ENCODER_SIGMA = 2e-5, 5e-6


def campaign(*, joints=None, noise=ENCODER_SIGMA, **options):
    document = simulate_campaign(ARM, **{"load": "pull", "seed": 3, **options})
    return with_encoders(ARM, document, joints=joints, sigma=ENCODER_SIGMA, noise=noise), document


@pytest.mark.parametrize("method", ["partial_pose", "complete_pose"])
@pytest.mark.parametrize("joints", [(1,), (0, 1, 2), None])
def test_information_adds_up_exactly(method, joints):
    document, without = campaign(joints=joints)
    experiment = experiment_of(without)
    torque = torques(ARM, experiment.joints, *experiment.wrenches)
    chosen = range(6) if joints is None else joints
    added = np.array([(torque[:, j] ** 2).sum() if j in chosen else 0.0 for j in range(6)])
    added /= 2 * ENCODER_SIGMA**2
    before = estimate(*prepare(without), method=method, positive=False).covariance
    after = estimate(*prepare(document), method=method, positive=False).covariance
    expected = np.linalg.inv(before) + np.diag(added)
    np.testing.assert_allclose(np.linalg.inv(after), expected, rtol=1e-7, atol=1e-7 * np.abs(expected).min())
    assert (np.diag(after)[list(chosen)] < np.diag(before)[list(chosen)]).all()


@pytest.mark.parametrize("method", METHODS)
def test_covariance_is_that_of_a_linear_function_of_all_readings(method):
    """ĉ = H d: H by perturbing one reading at a time, then H Σ Hᵀ with no formula of ours."""
    robot, measurements = prepare(campaign(configurations=6)[0])
    exact = estimate(robot, measurements, method=method, positive=False)

    def shifted(of_target=0.0, of_encoder=0.0):
        encoders = measurements.encoders
        moved = replace(
            measurements,
            deflection=measurements.deflection + of_target,
            encoders=replace(encoders, deflection=encoders.deflection + of_encoder),
        )
        return estimate(robot, moved, method=method, positive=False).compliance - exact.compliance

    covariance = np.zeros((6, 6))
    for shape, name, sigma in (
        (measurements.deflection.shape, "of_target", SIGMA),
        (measurements.encoders.deflection.shape, "of_encoder", ENCODER_SIGMA),
    ):
        for place in np.ndindex(*shape):
            unit = np.zeros(shape)
            unit[place] = np.sqrt(2) * sigma
            change = shifted(**{name: unit})
            covariance += np.outer(change, change)
    size = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        exact.covariance / np.outer(size, size), covariance / np.outer(size, size), atol=1e-7
    )


def test_complete_pose_still_equals_partial_pose():
    robot, measurements = prepare(campaign()[0])
    partial, complete = (estimate(robot, measurements, method=m) for m in ("partial_pose", "complete_pose"))
    np.testing.assert_allclose(complete.compliance, partial.compliance, rtol=1e-9)
    assert complete.chi_square == pytest.approx(partial.chi_square, rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_encoders_count_in_chi_square_and_its_degrees_of_freedom(method):
    document, without = campaign(joints=(0, 1, 4), configurations=40)
    after = estimate(*prepare(document), method=method, positive=False)
    before = estimate(*prepare(without), method=method, positive=False)
    if method != "decoupled_partial_pose":  # whose degrees of freedom are no whole number
        assert after.degrees_of_freedom == pytest.approx(before.degrees_of_freedom + 3 * 40)
    ratio = after.chi_square / after.degrees_of_freedom
    assert abs(ratio - 1.0) < 5 * np.sqrt(2 / after.degrees_of_freedom)


@pytest.mark.parametrize("method", METHODS)
def test_precise_encoders_decide(method):
    """Exact encoder readings under a small load: the truth, to the change of torque with deflection."""
    document, _ = campaign(noise=0.0, force=100.0)
    robot, measurements = prepare(document)
    sharp = replace(measurements, encoders=replace(measurements.encoders, sigma=1e-10))
    found = estimate(robot, sharp, method=method, positive=False)
    np.testing.assert_allclose(found.compliance, ARM.compliances, rtol=2e-4)


@pytest.mark.parametrize("method", METHODS)
def test_truth_lies_within_the_uncertainties(method):
    document, _ = campaign(configurations=30)
    found = estimate(*prepare(document), method=method, positive=False)
    deviation = (found.compliance - ARM.compliances) / np.sqrt(np.diag(found.covariance))
    assert np.abs(deviation).max() < 4.5


def test_an_encoder_shows_what_no_target_sees():
    """A target on the axis of joint 6 stands still when it turns."""
    on_axis = {"P0": (0.0, 0.0, 0.1)}
    document, without = campaign(
        targets=on_axis, joints=(5,), load_point=(0.2, 0.0, 0.1), noise=0.0, readings="deflections"
    )
    hidden = estimate(*prepare(without)).joints[5]
    assert hidden.status == "not_observable"
    seen = estimate(*prepare(document)).joints[5]
    assert seen.status == "identified"
    assert seen.compliance == pytest.approx(ARM.compliances[5], rel=0.01)


@pytest.mark.parametrize("method", METHODS)
def test_an_encoder_says_nothing_of_a_joint_without_torque(method):
    document, _ = campaign(load="dead_weight")
    joint = estimate(*prepare(document), method=method).joints[0]
    assert joint.status == "not_observable"
    assert "never twists" in joint.reason


@pytest.mark.parametrize("units", [{"length": "mm", "angle": "deg", "force": "kN"}])
def test_units_do_not_matter(units):
    same = estimate(*prepare(campaign(noise=0.0)[0]))
    other = estimate(*prepare(campaign(noise=0.0, units=units)[0]))
    # The documents are rounded to about twelve digits of an angle of radians.
    np.testing.assert_allclose(other.compliance, same.compliance, rtol=1e-5)
    np.testing.assert_allclose(
        other.covariance, same.covariance, rtol=1e-5, atol=1e-5 * same.covariance.max()
    )


def test_part_of_the_encoders_in_part_of_the_observations():
    robot, measurements = prepare(campaign()[0])
    present = measurements.encoders.present.copy()
    present[::2] = False
    some = replace(measurements, encoders=replace(measurements.encoders, present=present))
    full = estimate(robot, measurements, positive=False).covariance
    half = estimate(robot, some, positive=False).covariance
    none = estimate(robot, replace(measurements, encoders=None), positive=False).covariance
    assert (np.diag(full) < np.diag(half)).all()
    assert (np.diag(half) < np.diag(none)).all()


@pytest.mark.parametrize("method", METHODS)
def test_resampling_takes_the_encoders_along(method):
    robot, measurements = prepare(campaign(configurations=12, joints=(1, 2, 4))[0])
    settings = settings_of(robot, method=method)
    plan = ResamplingPlan(size=8, repetitions=5, seed=2)
    drawn = resample(gram_blocks(robot, measurements, settings), plan, Bounds.positive(6), 0, 5)
    for rows, compliance in zip(plan.draw(12, 0, 5), drawn.compliance, strict=True):
        alone = estimate(robot, measurements[rows], method=method)
        np.testing.assert_allclose(compliance, alone.compliance, rtol=1e-7)


@pytest.mark.parametrize("seed", range(10))
def test_clean_encoders_raise_no_finding(seed):
    assert not inspect(*prepare(campaign(seed=seed)[0]), degrees=False)


def test_a_wrong_sign_is_noticed():
    robot, measurements = prepare(campaign()[0])
    turned = measurements.encoders.deflection * np.array([1, 1, -1, 1, 1, 1])
    encoders = replace(measurements.encoders, deflection=turned)
    (finding,) = inspect(robot, replace(measurements, encoders=encoders), degrees=False)
    assert finding.code == "encoder_against_torque"
    assert finding.observation is None
    assert "joint_3" in finding.message
    assert "sign" in finding.remedy


def test_one_swapped_reading_is_noticed_where_it_is():
    robot, measurements = prepare(campaign(load="dead_weight")[0])
    swapped = measurements.encoders.deflection.copy()
    swapped[7, 1] *= -1
    encoders = replace(measurements.encoders, deflection=swapped)
    (finding,) = inspect(robot, replace(measurements, encoders=encoders), degrees=False)
    assert (finding.code, finding.observation) == ("encoder_against_torque", "c08")


def test_an_angle_in_another_unit_is_noticed():
    robot, measurements = prepare(campaign()[0])
    encoders = replace(measurements.encoders, deflection=np.rad2deg(measurements.encoders.deflection))
    codes = {f.code for f in inspect(robot, replace(measurements, encoders=encoders), degrees=False)}
    assert codes == {"encoder_deflection_implausibly_large"}


def test_predicted_deflections_are_those_of_springs_under_a_small_load():
    document, _ = campaign(noise=0.0, force=10.0)
    robot, measurements = prepare(document)
    predicted = predict_encoders(robot, measurements, ARM.compliances)
    exact = measurements.encoders.deflection
    np.testing.assert_allclose(predicted, exact, atol=2e-4 * np.abs(exact).max())


@pytest.mark.parametrize(
    ("method", "weighting"),
    [("partial_pose", "uniform"), ("complete_pose", "characteristic_length"), ("complete_pose", "uniform")],
)
def test_other_weightings_are_refused(method, weighting):
    with pytest.raises(UnsupportedMethodError, match="encoder") as refusal:
        estimate(*prepare(campaign()[0]), method=method, weighting=weighting)
    assert refusal.value.where == "weighting"


def _without_noise(document):
    return {k: v for k, v in document.items() if k != "noise"}


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (_without_noise, "noise"),
        (lambda d: d | {"noise": {"sigma": 2e-5}}, "noise.encoder_sigma"),
        (lambda d: d | {"encoders": "secondary"}, "observations[0].encoder_readings"),
    ],
)
def test_readings_without_their_worth_are_refused(change, where):
    document, _ = campaign()
    with pytest.raises(MeasurementError) as refusal:
        prepare(document | {"measurement_set": change(document["measurement_set"])})
    assert refusal.value.where == where
    assert refusal.value.remedy


@pytest.mark.parametrize(
    ("readings", "where", "reason"),
    [
        (
            [{"joint": "elbow", "unloaded": 0.0, "loaded": 0.0}],
            "observations[2].encoder_readings",
            "no joint",
        ),
        (
            [{"joint": "joint_2", "unloaded": 0.0, "loaded": 0.0}] * 2,
            "observations[2].encoder_readings[1].joint",
            "two readings",
        ),
    ],
)
def test_unknown_and_repeated_joints_are_refused(readings, where, reason):
    document, _ = campaign()
    document["measurement_set"]["observations"][2]["encoder_readings"] = readings
    with pytest.raises(MeasurementError, match=reason) as refusal:
        prepare(document)
    assert refusal.value.where == where


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, np.inf])
def test_a_sigma_that_is_none_is_refused(sigma):
    with pytest.raises(MeasurementError, match="sigma"):
        EncoderReadings(np.zeros((1, 2)), np.ones((1, 2), dtype=bool), sigma)


def test_arrays_of_another_shape_are_refused():
    _, measurements = prepare(campaign()[0])
    narrow = EncoderReadings(np.zeros((19, 2)), np.ones((19, 2), dtype=bool), 1e-6)
    with pytest.raises(MeasurementError, match="shape"):
        replace(measurements, encoders=narrow)
    with pytest.raises(MeasurementError, match="finite"):
        EncoderReadings(np.full((1, 2), np.nan), np.ones((1, 2), dtype=bool), 1e-6)
