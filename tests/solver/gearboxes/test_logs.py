"""Logs of a motion: intervals hold the truth, and what logs cannot say is refused."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support.kr300 import read_kr300
from support.motion_logs import JOINTS, read, simulate

import jointstiff as js
from jointstiff.solver.gearboxes.log_fit import LogFit, fit_logs
from jointstiff.solver.gearboxes.log_outcome import _Joint, identify_from_logs
from jointstiff.solver.gearboxes.motion import GasSpring

LENGTH = 2500
"""Number of samples of a log of 10 s."""


@pytest.fixture(scope="module")
def swung():
    """Two logs of an arm that swings."""
    return simulate(0, logs=2)


def test_each_interval_of_an_arm_that_swings_holds_the_true_gearbox(swung):
    result = identify_from_logs(read(swung.document))
    assert [gearbox.joint for gearbox in result.gearboxes] == ["joint_1", "joint_2", "joint_3"]
    for joint, gearbox in zip(JOINTS, result.gearboxes, strict=True):
        least, greatest = gearbox.stiffness_interval
        assert least <= swung.stiffness[joint] <= greatest
        assert gearbox.half_width < 0.2
    assert result.not_observed == ["joint_4", "joint_5", "joint_6"]


def test_each_slow_log_alone_holds_the_true_gearbox():
    """In a slow sweep errors of encoders and gears change as slowly as the torque: samples repeat."""
    slow = simulate(1, is_slow=True, logs=6)
    campaign = read(slow.document)
    for number in range(6):
        fit = fit_logs(campaign, 1, [number])
        least, greatest = fit.interval
        assert least <= 1.0 / slow.stiffness[1] <= greatest
        assert 20.0 < fit.independent < 100.0


def test_logs_are_never_more_than_a_check(swung):
    result = identify_from_logs(read(swung.document))
    assert result.assessment.verdict == "use_with_care"
    check = next(finding for finding in result.findings if finding.code == "check_by_log")
    assert "150 kg ± 5 %" in check.message


def test_the_delay_between_the_encoders_is_found(swung):
    shifted = copy.deepcopy(swung.document)
    for log in shifted["motion"]["logs"]:
        log["link"] = {name: [*samples[1:], samples[-1]] for name, samples in log["link"].items()}
    before, after = (identify_from_logs(read(each)).gearboxes[1] for each in (swung.document, shifted))
    assert before.delay - after.delay == pytest.approx(0.004, abs=1e-5)
    assert after.compliance == pytest.approx(before.compliance, rel=0.02)


def test_a_heavier_payload_makes_the_gearbox_stiffer(swung):
    heavier = copy.deepcopy(swung.document)
    heavier["motion"]["payload"]["mass"] *= 1.5
    before, after = (identify_from_logs(read(each)).gearboxes[1] for each in (swung.document, heavier))
    assert after.stiffness > 1.1 * before.stiffness


def test_encoders_of_the_wrong_sign_are_not_used(swung):
    turned = copy.deepcopy(swung.document)
    for log in turned["motion"]["logs"]:
        motor, link = log["motor"]["joint_2"], log["link"]["joint_2"]
        log["motor"]["joint_2"], log["link"]["joint_2"] = link, motor
    result = identify_from_logs(read(turned))
    assert result.assessment.verdict == "do_not_use"
    assert "encoder_against_torque" in {finding.code for finding in result.findings}


@pytest.mark.parametrize("factor", [-1.0, 57.3, 0.01])
def test_a_twist_that_no_gearbox_survives_is_not_used_and_other_joints_are_identified(swung, factor):
    """A sign, a unit, or a gear ratio."""
    wrong = copy.deepcopy(swung.document)
    for log in wrong["motion"]["logs"]:
        log["link"]["joint_2"] = (factor * np.array(log["link"]["joint_2"])).tolist()
    result = identify_from_logs(read(wrong))
    assert result.assessment.verdict == "do_not_use"
    assert "encoder_deflection_implausibly_large" in {finding.code for finding in result.findings}
    assert result.gearboxes[1].stiffness is None
    assert result.gearboxes[2].stiffness is not None


def test_a_joint_that_rests_is_refused_alone(swung):
    still = copy.deepcopy(swung.document)
    log = still["motion"]["logs"][0]
    log["motor"]["joint_1"] = [0.1] * LENGTH
    log["link"]["joint_1"] = [0.1] * LENGTH
    first, second, _ = identify_from_logs(read(still)).gearboxes
    assert "rests" in first.reason
    assert second.reason is None or "contradict" in second.reason


def test_angles_that_wrap_are_those_of_a_turn(swung):
    wrapped = copy.deepcopy(swung.document)
    for log in wrapped["motion"]["logs"]:
        angles = np.array(log["link"]["joint_2"])
        log["link"]["joint_2"] = np.where(angles > 0.25, angles - 2.0 * np.pi, angles).tolist()
    before, after = (identify_from_logs(read(each)).gearboxes[1] for each in (swung.document, wrapped))
    assert after.stiffness == pytest.approx(before.stiffness, rel=1e-3)


def test_logs_with_different_loads_contradict_each_other_and_are_refused():
    one, other = simulate(3, logs=1), simulate(3, logs=1)
    joined = copy.deepcopy(one.document)
    log = copy.deepcopy(other.document["motion"]["logs"][0])
    twist = np.array(log["motor"]["joint_2"]) - np.array(log["link"]["joint_2"])
    # As if the second log were of a gearbox of half the stiffness.
    log["motor"]["joint_2"] = (np.array(log["motor"]["joint_2"]) + twist - twist.mean()).tolist()
    joined["motion"]["logs"].append({**log, "label": "log 2"})
    gearbox = identify_from_logs(read(joined)).gearboxes[1]
    assert gearbox.stiffness is None
    assert gearbox.stiffness_interval is None
    assert "contradict" in gearbox.reason


FIT = LogFit(
    joint=1,
    compliance=2.0e-7,
    interval=(1.8e-7, 2.2e-7),
    delay=0.003,
    lost_motion=10e-6,
    noise=1e-6,
    independent=100.0,
    least_torque=-2000.0,
    greatest_torque=2000.0,
    against_torque=0.0,
)
"""Fit of a log: its torque twists the gearbox by 800 µrad, 80 times its lost motion."""


def shift(deviations, **changes):
    """The fit of a log whose compliance is off by some standard uncertainties."""
    off = deviations * FIT.uncertainty
    return replace(
        FIT, compliance=FIT.compliance + off, interval=tuple(end + off for end in FIT.interval), **changes
    )


def judge(*fits):
    """A joint with these fits of its logs."""
    return _Joint("joint_2", FIT, {f"log {number}": fit for number, fit in enumerate(fits, 1)})


def test_a_log_that_turns_against_friction_alone_contradicts_no_other_log():
    silent = {"least_torque": -37.0, "greatest_torque": 37.0}  # 1.48 times the lost motion
    assert judge(FIT, shift(-9.0, **silent)).has_number
    heard = {"least_torque": -38.0, "greatest_torque": 38.0}  # 1.52 times
    refused = judge(FIT, shift(-9.0, **heard))
    assert not refused.has_number
    assert "contradict" in refused.describe().reason


@pytest.mark.parametrize(("count", "least"), [(2, 0.005), (5, 0.002)])
def test_logs_contradict_each_other_below_one_percent_over_their_number(count, least):
    """One log differs from the others: χ² with one degree of freedom less than logs."""
    for factor, has_number in ((1.02, False), (0.98, True)):
        size = np.sqrt(factor * stats.chi2.isf(least, count - 1) / (1.0 - 1.0 / count))
        joint = judge(*[FIT] * (count - 1), shift(size))
        assert joint.has_number is has_number
        assert bool(list(joint.report())) is not has_number


def test_a_joint_whose_torque_is_below_the_lost_motion_has_no_number():
    weak = replace(FIT, least_torque=-37.0, greatest_torque=37.0)
    assert "too small against friction" in _Joint("joint_2", weak, {}).describe().reason
    strong = replace(FIT, least_torque=-38.0, greatest_torque=38.0)
    assert _Joint("joint_2", strong, {}).has_number


def test_a_joint_without_torque_is_refused():
    still = simulate(1, is_slow=True, logs=1)
    first = identify_from_logs(read(still.document)).gearboxes[0]
    assert first.stiffness is None
    assert "too small" in first.reason


def test_a_gas_spring_pulls_as_the_change_of_its_energy():
    spring = GasSpring(1, 0.8, 0.2, 1.66, 1.7e-3, 1.6e7, 0.96e-3, 0.1)
    position = np.linspace(-1.0, 1.0, 50)

    def energy(q):
        length = np.sqrt(0.8**2 + 0.2**2 - 2 * 0.8 * 0.2 * np.cos(q + 1.66))
        return -1.6e7 * 0.96e-3 * np.log(1.0 - 1.7e-3 * (length - 0.6) / 0.96e-3)

    change = (energy(position + 1e-5) - energy(position - 1e-5)) / 2e-5
    np.testing.assert_allclose(spring.holding_torque(position), change, rtol=1e-6)


def test_each_log_of_a_measured_arm_agrees_with_both_on_axes_2_and_3_and_axis_1_is_refused():
    result = js.gearbox(**read_kr300()).result
    first, second, third = result.gearboxes
    assert first.stiffness is None
    assert first.reason
    for gearbox in (second, third):
        alone = [each for each in result.by_log if each.joint == gearbox.joint]
        assert len(alone) == 2
        for each in alone:
            least, greatest = each.stiffness_interval
            assert least <= gearbox.stiffness <= (np.inf if greatest is None else greatest)
    # Three independent programs of a prototype, from three logs: 7.7 and 5.3 · 10⁶ N·m/rad
    assert second.stiffness_interval[0] <= 7.7e6 <= second.stiffness_interval[1]
    assert third.stiffness_interval[0] <= 5.3e6 <= third.stiffness_interval[1]
    assert 0.0028 < second.delay < 0.0032


def test_the_report_of_logs_begins_with_the_payload_on_which_the_numbers_rest(swung):
    job = js.gearbox(swung.document)
    lines = [line.strip() for line in str(job).splitlines() if line.strip()]
    assert "use with care" in lines[0].lower()
    assert lines[1].startswith("the numbers hold if the payload is 150 kg ± 5 %")


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (lambda motion: motion["logs"][0]["motor"].pop("joint_4"), "motion.logs[0].motor"),
        (lambda motion: motion.update(start=[0.0]), "motion.start"),
        (lambda motion: motion.pop("bodies"), "motion.bodies"),
        (lambda motion: motion["bodies"][0].update(inertia=[1.0, 0, 0, 1.0, 0, 5.0]), "inertia"),
        (lambda motion: motion["gas_springs"][0].update(volume=1e-4), "gas_springs.volume"),
        (
            lambda motion: motion["logs"][0]["link"].update(joint_9=motion["logs"][0]["link"]["joint_1"]),
            "link",
        ),
    ],
)
def test_what_cannot_be_used_is_named_by_its_place(swung, change, where):
    broken = copy.deepcopy(swung.document)
    change(broken["motion"])
    with pytest.raises(js.CampaignError) as refused:
        js.gearbox(broken)
    assert where in str(refused.value)
