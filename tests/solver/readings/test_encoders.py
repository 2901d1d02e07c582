"""Secondary encoders as observations: information adds up in every method, and mistakes are noticed."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import (
    ARM,
    METHODS,
    SIGMA,
    assert_covariance,
    covariance_by_moving,
    estimate,
    prepare,
    settings_of,
    wrench_of,
)
from support.encoders import with_encoders

from jointstiff.simulator import simulate_campaign
from jointstiff.simulator.campaign import torques
from jointstiff.solver.convex.problem import Bounds
from jointstiff.solver.errors import MeasurementError, UnsupportedMethodError
from jointstiff.solver.evidence.prediction import predict_encoders
from jointstiff.solver.integrity import inspect
from jointstiff.solver.readings.measurements import EncoderReadings
from jointstiff.solver.resampling import ResamplingPlan, gram_blocks, resample

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
    robot, measurements = prepared(configurations=6)

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
    robot, measurements = prepared(noise=0.0, force=100.0)
    sharp = changed(measurements, sigma=1e-10)
    found = estimate(robot, sharp, method=method, positive=False)
    np.testing.assert_allclose(found.compliance, ARM.compliances, rtol=2e-4)


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
    joint = estimate(*prepared(load="dead_weight"), method=method).joints[0]
    assert joint.status == "not_observable"
    assert "never twists" in joint.reason


def test_units_do_not_matter():
    same = estimate(*prepared(noise=0.0))
    other = estimate(*prepared(noise=0.0, units={"length": "mm", "angle": "deg", "force": "kN"}))
    # The documents are rounded to about twelve digits of an angle of radians.
    np.testing.assert_allclose(other.compliance, same.compliance, rtol=1e-5)
    np.testing.assert_allclose(
        other.covariance, same.covariance, rtol=1e-5, atol=1e-5 * same.covariance.max()
    )


@pytest.mark.parametrize("method", METHODS)
def test_resampling_takes_the_encoders_along(method):
    robot, measurements = prepared(configurations=12, joints=(1, 2, 4))
    settings = settings_of(robot, method=method)
    plan = ResamplingPlan(size=8, repetitions=5, seed=2)
    drawn = resample(gram_blocks(robot, measurements, settings), plan, Bounds.positive(6), 0, 5)
    for rows, compliance in zip(plan.draw(12, 0, 5), drawn.compliance, strict=True):
        alone = estimate(robot, measurements[rows], method=method)
        np.testing.assert_allclose(compliance, alone.compliance, rtol=1e-7)


@pytest.mark.parametrize("seed", range(10))
def test_clean_encoders_raise_no_finding(seed):
    assert not inspect(*prepared(seed=seed), degrees=False)


def one_swapped(deflection):
    swapped = deflection.copy()
    swapped[7, 1] *= -1
    return swapped


@pytest.mark.parametrize(
    ("change", "code", "observation", "words"),
    [
        (lambda d: d * [1, 1, -1, 1, 1, 1], "encoder_against_torque", None, "joint_3 .* sign"),
        (one_swapped, "encoder_against_torque", "c08", "joint_2"),
        (np.rad2deg, "encoder_deflection_implausibly_large", None, "unit"),
    ],
)
def test_mistakes_are_noticed_where_they_are(change, code, observation, words):
    robot, measurements = prepared(load="dead_weight" if observation else "pull")
    mistaken = changed(measurements, deflection=change(measurements.encoders.deflection))
    findings = inspect(robot, mistaken, degrees=False)
    assert {finding.code for finding in findings} == {code}
    if code == "encoder_against_torque":
        (finding,) = findings
        assert finding.observation == observation
    assert re.search(words, f"{findings[0].message} {findings[0].remedy}", re.DOTALL)


def test_predicted_deflections_are_those_of_springs_under_a_small_load():
    robot, measurements = prepared(noise=0.0, force=10.0)
    predicted = predict_encoders(robot, measurements, ARM.compliances)
    exact = measurements.encoders.deflection
    np.testing.assert_allclose(predicted, exact, atol=2e-4 * np.abs(exact).max())


@pytest.mark.parametrize(
    ("method", "weighting"),
    [("partial_pose", "uniform"), ("complete_pose", "characteristic_length"), ("complete_pose", "uniform")],
)
def test_other_weightings_are_refused(method, weighting):
    with pytest.raises(UnsupportedMethodError, match="encoder") as refusal:
        estimate(*prepared(), method=method, weighting=weighting)
    assert refusal.value.where == "weighting"


def reading(joint):
    return {"joint": joint, "unloaded": 0.0, "loaded": 0.0}


def third_reads(*joints):
    def change(readings):
        readings["observations"][2]["encoder_readings"] = [reading(joint) for joint in joints]
        return readings

    return change


@pytest.mark.parametrize(
    ("change", "where", "reason"),
    [
        (lambda d: {k: v for k, v in d.items() if k != "noise"}, "noise", None),
        (lambda d: d | {"noise": {"sigma": 2e-5}}, "noise.encoder_sigma", None),
        (lambda d: d | {"encoders": "secondary"}, "observations[0].encoder_readings", None),
        (third_reads("elbow"), "observations[2].encoder_readings", "no joint"),
        (third_reads("joint_2", "joint_2"), "observations[2].encoder_readings[1].joint", "two readings"),
    ],
)
def test_readings_that_say_nothing_are_refused(change, where, reason):
    document, _ = campaign()
    with pytest.raises(MeasurementError, match=reason) as refusal:
        prepare(document | {"measurement_set": change(document["measurement_set"])})
    assert refusal.value.where == where
    assert refusal.value.remedy


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, np.inf])
def test_a_sigma_that_is_none_is_refused(sigma):
    with pytest.raises(MeasurementError, match="sigma"):
        EncoderReadings(np.zeros((1, 2)), np.ones((1, 2), dtype=bool), sigma)


def test_arrays_of_another_shape_are_refused():
    _, measurements = prepared()
    narrow = EncoderReadings(np.zeros((19, 2)), np.ones((19, 2), dtype=bool), 1e-6)
    with pytest.raises(MeasurementError, match="shape"):
        replace(measurements, encoders=narrow)
    with pytest.raises(MeasurementError, match="finite"):
        EncoderReadings(np.full((1, 2), np.nan), np.ones((1, 2), dtype=bool), 1e-6)
