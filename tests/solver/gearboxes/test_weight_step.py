"""Gearboxes of simulated weight steps, whose springs are in exact equilibrium with the weights."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support.weight_steps import JOINTS, MISTAKES, PLACE, POSTURES, read, simulate, with_mistake

from jointstiff.simulator import default_arm
from jointstiff.simulator.weight_step import Gears, SteppedArm, simulate_weight_step
from jointstiff.solver.errors import MeasurementError, NotObservableError, RequestError
from jointstiff.solver.gearboxes.identification import fit_gearboxes
from jointstiff.solver.gearboxes.outcome import identify_gearboxes

PERFECT = Gears(0.0, (), (), eccentricity=0.0, drift=0.0, encoder_noise=0.0)


def exact_step(*, link_holds: bool, gears: Gears = PERFECT) -> tuple[dict, np.ndarray]:
    """Return a step of an arm without own weight, whose joints without two encoders are rigid."""
    stiffness = np.full(6, np.inf)
    stiffness[list(JOINTS)] = 3.1e6, 2.5e6
    arm = replace(default_arm(), stiffnesses=stiffness)
    postures = np.random.default_rng(4).uniform(*np.array(arm.limits).T, (POSTURES, 6))
    stepped = SteppedArm(arm, 100.0, PLACE, np.zeros(6))
    document = simulate_weight_step(
        stepped, postures, JOINTS, gears, np.random.default_rng(1), link_holds=link_holds
    )
    document["load"] |= {"mass_uncertainty": 0.0, "point_uncertainty": 0.0}
    return document, stiffness


@pytest.mark.parametrize(("drift", "error"), [(0.0, 1e-11), (50e-6, 1e-4)])
@pytest.mark.parametrize("link_holds", [False, True])
def test_the_stiffness_is_that_of_the_springs(link_holds, drift, error):
    """Whichever encoder closes the loop; an encoder that drifts moves the posture by as much, no more."""
    document, stiffness = exact_step(link_holds=link_holds, gears=replace(PERFECT, drift=drift))
    result = identify_gearboxes(read(document))
    assert [each.joint for each in result.gearboxes] == ["joint_2", "joint_3"]
    found = [each.stiffness for each in result.gearboxes]
    np.testing.assert_allclose(found, stiffness[list(JOINTS)], rtol=error)
    assert result.not_observed == ["joint_1", "joint_4", "joint_5", "joint_6"]


def test_with_an_exact_load_the_interval_is_students():
    document, _ = exact_step(link_holds=False, gears=Gears())
    step = read(document)
    for fit in fit_gearboxes(step, [step.select(joint) for joint in JOINTS]):
        by_scipy = stats.linregress(fit.steps.torques[0], fit.steps.step)
        half = stats.t.ppf(0.975, POSTURES - 2) * by_scipy.stderr
        np.testing.assert_allclose(fit.interval, [by_scipy.slope - half, by_scipy.slope + half], rtol=1e-6)


@pytest.mark.parametrize(
    ("options", "widest"), [({}, 0.025), ({"is_planned": False}, 0.04), ({"is_cobot": True}, 0.04)]
)
def test_intervals_hold_the_truth(options, widest):
    """At 95 %, of 40 gearboxes at least 34; the study `weight_steps` has 200 arms."""
    held, widths = 0, []
    for seed in range(20):
        simulated = simulate(seed, **options)
        for joint, gearbox in zip(
            JOINTS, identify_gearboxes(read(simulated.document)).gearboxes, strict=True
        ):
            assert gearbox.stiffness_interval is not None
            lower, upper = gearbox.stiffness_interval
            held += lower <= simulated.stiffness[joint] <= upper
            widths.append(gearbox.half_width)
    assert held >= 34
    assert np.median(widths) <= widest


@pytest.mark.parametrize("postures", [5, 6, 8])
@pytest.mark.parametrize("place", [0.01, 0.1])
def test_intervals_of_few_postures_hold_the_truth_however_unsure_the_place(postures, place):
    """Of 40 at least 34: free errors of the load take no noise in."""
    held = 0
    for seed in range(20):
        simulated = simulate(seed, is_planned=False, postures=postures)
        simulated.document["load"]["point_uncertainty"] = place
        step = read(simulated.document)
        for fit in fit_gearboxes(step, [step.select(joint) for joint in JOINTS]):
            lower, upper = fit.interval
            held += lower <= 1.0 / simulated.stiffness[fit.steps.joint] <= upper
    assert held >= 34


def test_the_weight_acts_along_gravity():
    document, stiffness = exact_step(link_holds=False)
    wrong = identify_gearboxes(read(document | {"gravity": [0.0, 2.0, -9.6]})).gearboxes
    assert abs(wrong[0].stiffness / stiffness[1] - 1.0) > 0.01
    exact = identify_gearboxes(read(document | {"gravity": [0.0, 0.0, -9.80665]})).gearboxes
    np.testing.assert_allclose(exact[0].stiffness, stiffness[1], rtol=1e-11)


def test_encoders_may_count_from_zero_again():
    document, stiffness = exact_step(link_holds=False)
    for posture in document["observations"]:
        for reading in posture["encoder_readings"]:
            for state in ("unloaded", "loaded"):
                reading[state] = {name: angle % (2.0 * np.pi) for name, angle in reading[state].items()}
    result = identify_gearboxes(read(document))
    np.testing.assert_allclose(result.gearboxes[0].stiffness, stiffness[1], rtol=1e-9)
    assert "posture_against_encoders" not in {finding.code for finding in result.findings}


def test_motor_angles_that_are_not_divided_by_the_gear_ratio_are_the_only_mistake_named():
    document = simulate(0).document
    for posture in document["observations"]:
        for reading in posture["encoder_readings"]:
            for state in ("unloaded", "loaded"):
                reading[state]["motor"] *= 161.0
    findings = identify_gearboxes(read(document)).findings
    wrong = [finding for finding in findings if finding.code != "no_joint_identified"]
    assert {finding.code for finding in wrong} == {"posture_against_encoders"}
    for finding in wrong:
        assert "are 161 times the stated angles" in finding.message
        assert f"divide the motor angles of {finding.where} by its gear ratio" in finding.remedy


@pytest.mark.parametrize("seed", range(3))
def test_a_step_without_a_mistake_is_used(seed):
    assert identify_gearboxes(read(simulate(seed).document)).assessment.verdict == "use"


@pytest.mark.parametrize("name", MISTAKES)
@pytest.mark.parametrize("seed", range(3))
def test_no_step_with_a_mistake_is_used(name, seed):
    document = with_mistake(simulate(seed).document, name, seed)
    assert identify_gearboxes(read(document)).assessment.verdict != "use"


def test_a_rigid_gearbox_has_a_limit_in_place_of_a_number():
    document, _ = exact_step(link_holds=False, gears=Gears(drift=0.0))
    document = with_mistake(document, "load never hung")
    for gearbox in identify_gearboxes(read(document)).gearboxes:
        assert gearbox.stiffness is None
        assert gearbox.reason is not None
        assert gearbox.stiffness_interval is None or gearbox.stiffness_interval[1] is None


def test_postures_alike_are_refused_with_the_joint():
    document, _ = exact_step(link_holds=False)
    for posture in document["observations"][1:]:
        posture["joints"] = document["observations"][0]["joints"]
        posture["encoder_readings"] = document["observations"][0]["encoder_readings"]
    with pytest.raises(NotObservableError, match="joint_2: the load's torque about it is the same"):
        identify_gearboxes(read(document))
    document["observations"] = document["observations"][:2]
    with pytest.raises(NotObservableError, match="at least 3 are needed"):
        identify_gearboxes(read(document))


def test_joints_that_the_joint_map_couples_are_refused():
    document, _ = exact_step(link_holds=False)
    matrix = np.eye(6)
    matrix[2, 1] = -1.0  # a parallelogram: the motor of joint 3 stands on the base
    document["robot"]["joint_map"] = {"matrix": matrix.tolist(), "offset": [0.0] * 6}
    with pytest.raises(RequestError, match="the joint map couples joint_2 with other joints"):
        read(document)


def test_a_position_of_no_arm_is_refused():
    document, _ = exact_step(link_holds=False)
    document["observations"][3]["joints"][0] = 1e3
    with pytest.raises(MeasurementError, match="more than 100 rad or m from zero"):
        read(document)
