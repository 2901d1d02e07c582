"""Mistakes of a long day are noticed with their figure, and clean sets are left in peace."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import only_deflections, prepare

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.campaign import TARGETS, experiment_of, linear_deflections
from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.solver.integrity import MAX_FINDINGS_PER_CODE, inspect
from jointstiff.solver.mechanics.configuration import Configurations

ROBOT, CAMPAIGN = prepare(simulate_campaign(default_arm(), load="pull", configurations=15, seed=5))
JOINTS, FORCE, POSITION, DEFLECTION = (
    getattr(CAMPAIGN, name) for name in ("joints", "force", "position", "deflection")
)


def look(measurements=CAMPAIGN, *, degrees=False, **changed):
    """Return the findings of a set with these arrays."""
    return inspect(ROBOT, replace(measurements, **changed), degrees=degrees)


def codes(*measurements, **changed):
    return {finding.code for finding in look(*measurements, **changed)}


def with_part(array, part, change):
    """Return a copy of an array to whose part something is added."""
    array = array.copy()
    array[part] += change
    return array


@pytest.mark.parametrize("load", ["pull", "dead_weight"])
@pytest.mark.parametrize("seed", range(20))
def test_clean_sets_raise_no_finding(load, seed):
    robot, measurements = prepare(simulate_campaign(default_arm(), load=load, seed=seed))
    assert inspect(robot, measurements, degrees=False) == []


def only(findings, *codes):
    """The findings, which must be of these kinds and no other."""
    assert {finding.code for finding in findings} == set(codes), findings
    return findings


BUMP = np.array([3e-4, -6e-4, 5e-4])
DRIFT = np.linspace(0.0, 1.0, 15)[:, None, None] * np.array([3e-4, 0.0, -4e-4])


def bumped(measurements, row):
    """Return the positions where target P12 sits elsewhere on the flange from a row on."""
    at = Configurations(ROBOT, ROBOT.joint_map.model_angles(measurements.joints))
    return with_part(measurements.position, np.s_[row:, 2], at.flange_rotation[row:] @ BUMP)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (
            {"position": with_part(POSITION, np.s_[4, 1], [0.0, 4e-4, 0.0])},
            r"targets_not_rigid do_not_use c05 observations\[4\] 'c05' .*µm.*: 'P11' moved",
        ),
        # 837 µm from the tenth row on
        ({"position": bumped(CAMPAIGN, 9)}, "target_moved do_not_use c10 .*'P12' is displaced by 8"),
        # One posture on a side is no step: that posture is named instead, by its distances
        ({"position": bumped(CAMPAIGN, 1)}, "targets_not_rigid do_not_use c01 "),
        ({"position": bumped(CAMPAIGN, 14)}, "targets_not_rigid do_not_use c15 "),
        # Drifts by 500 µm
        ({"position": POSITION + DRIFT}, "drift_in_time use_with_care None .*drifted by 5"),
        (
            {"force": -FORCE},
            "force_sign_suspect do_not_use None .*against the force in 15 of 15 observations",
        ),
        ({"force": with_part(FORCE, 3, -2.0 * FORCE[3])}, "deflection_against_force do_not_use c04 "),
        ({"force": with_part(FORCE, 7, -FORCE[7])}, "zero_load use c08 "),
        (
            {"deflection": with_part(DEFLECTION, 5, [8e-4, -8e-4, 8e-4])},
            "residual_outlier use_with_care c06 ",
        ),
        (
            {"joints": with_part(JOINTS, np.s_[5, 1], 0.1)},
            "target_off_model do_not_use c06 .*mm away from its median position on the flange",
        ),
        (
            {"load_point": 1e3 * CAMPAIGN.load_point},
            r"length_unit_suspect do_not_use None .*from the origin of R0 state `load_point`",
        ),
        (
            {"measurements": CAMPAIGN[np.array([*range(15), 6])]},
            r"duplicated_observation do_not_use c07 .*observations\[15\].*observations\[6\]",
        ),
    ],
)
def test_a_mistake_is_the_only_finding(changed, told):
    (finding,) = look(**changed)
    where = f"{finding.code} {finding.weight} {finding.observation} {finding.where}"
    assert re.match(told, f"{where} {finding.message} {finding.remedy}")


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"force": 1e3 * FORCE}, {"force_unit_suspect"}),
        ({"force": 1e-3 * FORCE}, {"force_unit_suspect"}),
        ({"joints": np.rad2deg(JOINTS)}, {"angle_unit_suspect", "joint_outside_limits"}),
        ({"joints": np.deg2rad(JOINTS), "degrees": True}, {"angle_unit_suspect"}),
        ({"deflection": 1e3 * DEFLECTION}, {"deflection_implausibly_large"}),
        ({"deflection": 1e3 * DEFLECTION, "position": 1e3 * POSITION}, {"length_unit_suspect"}),
        (
            {"deflection": 1e-3 * DEFLECTION, "position": 1e-3 * POSITION},
            {"deflection_implausibly_small", "length_unit_suspect"},
        ),
        ({"deflection": with_part(DEFLECTION, 3, 1e-6 - DEFLECTION[3])}, {"deflection_below_noise"}),
        # Positions in another frame
        ({"position": POSITION[..., [1, 0, 2]] * [-1, 1, 1] + [1, 2, 0]}, {"target_off_model"}),
        ({"sigma": 0.02}, {"sigma_suspect"}),
        # Without sigma rigidity is judged by the other observations
        ({"sigma": None, "position": with_part(POSITION, np.s_[2, 0], 1e-3)}, {"targets_not_rigid"}),
    ],
)
def test_a_mistake_in_a_unit_a_frame_or_a_size_is_among_the_findings(changed, expected):
    assert expected <= codes(**changed)


def test_a_residual_that_grew_with_the_load_is_no_outlier():
    """One posture with ten times the load: ten times the residual is as unusual beside its deflection."""
    tenfold = {
        "force": with_part(FORCE, 5, 9 * FORCE[5]),
        "deflection": with_part(DEFLECTION, 5, 9 * DEFLECTION[5]),
    }
    assert look(only_deflections(CAMPAIGN), sigma=None, **tenfold) == []


def exchanged(measurements, row, states):
    """Return the set with P10 and P11 exchanged in these states of a row."""
    before, after = measurements.position.copy(), measurements.position + measurements.deflection
    for state in states:
        readings = {"unloaded": before, "loaded": after}[state]
        readings[row, :2] = readings[row, 1::-1]
    return replace(measurements, position=before, deflection=after - before)


@pytest.mark.parametrize(
    "mistakes",
    [
        {4: ["unloaded"]},
        {4: ["loaded"]},
        {4: ["unloaded", "loaded"]},
        {4: ["unloaded"], 8: ["loaded"]},
        {row: ["loaded"] for row in range(9)},
    ],
    ids=str,
)
def test_exchanged_targets_are_told_with_their_state_and_nothing_else(mistakes):
    """What the remedies say mends the set."""
    wrong = CAMPAIGN
    for row, states in mistakes.items():
        wrong = exchanged(wrong, row, states)
    findings = only(look(wrong), "targets_swapped")
    assert {finding.observation for finding in findings} == {f"c{row + 1:02}" for row in mistakes}
    for finding in findings:
        names, label = "'P10' and 'P11'", finding.observation
        told = re.fullmatch(f"exchange (?:only )?the (.*) values of {names} in '{label}'", finding.remedy)
        assert finding.message == f"{names} are exchanged in the {told[1]} readings of '{label}'"
        wrong = exchanged(wrong, int(finding.observation[1:]) - 1, told[1].split(" and "))
    assert look(wrong) == []


def test_a_loaded_reading_of_a_target_that_was_not_read_is_to_be_removed():
    """P10 is P11 under load, and P11 is hidden: there is nothing to exchange."""
    wrong = exchanged(CAMPAIGN, 4, ["loaded"])
    present = CAMPAIGN.present.copy()
    present[4, 1] = False
    read = present[..., None]
    hidden = {name: np.where(read, getattr(wrong, name), 0.0) for name in ("position", "deflection")}
    (finding,) = only(look(wrong, present=present, **hidden), "targets_swapped")
    assert finding.message == "in the loaded readings of 'c05' the target named 'P10' is 'P11'"
    assert "remove these readings of 'P10'" in finding.remedy


@pytest.mark.parametrize(("repeated", "code"), [(True, "targets_not_rigid"), (False, "target_moved")])
def test_a_step_needs_two_postures_on_each_side(repeated, code):
    """The same rows with the second posture measured again, or another, before the target was bumped."""
    measurements = CAMPAIGN
    if repeated:
        order = np.r_[0, 0, 2 : len(measurements)]
        shift = 1e-6 * np.arange(len(order))[:, None, None]  # no copies of each other
        measurements = replace(measurements[order], position=measurements.position[order] + shift)
    steps = {"target_moved", "targets_not_rigid"}
    assert codes(measurements, position=bumped(measurements, 2)) & steps == {code}


def test_exact_readings_raise_no_finding():
    """Rounding is neither drift nor outlier, of springs in exact balance or of the linear model."""
    arm = default_arm()
    document = simulate_campaign(arm, load="pull", configurations=15, sigma=0.0, seed=5)
    _, exact = prepare(document)
    assert look(exact) == []
    plan = experiment_of(document)
    linear = linear_deflections(arm, plan.joints, *plan.wrenches, np.array(list(TARGETS.values())))
    assert look(exact, deflection=linear) == []
    assert look(only_deflections(replace(exact, deflection=linear))) == []


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("read", ["positions", "deflections"])
def test_sign_of_a_joint(joint, read):
    joints = CAMPAIGN.joints.copy()
    joints[:, joint] *= -1.0
    wrong = replace(CAMPAIGN if read == "positions" else only_deflections(CAMPAIGN), joints=joints)
    (finding,) = only(within_limits(look(wrong)), "joint_sign_suspect")
    assert f"joint_{joint + 1}" in finding.remedy


def within_limits(findings):
    """Other findings than that wrong angles are beyond the robot's limits."""
    return [finding for finding in findings if finding.code != "joint_outside_limits"]


@pytest.mark.parametrize(
    ("first", "shift", "row"), [(0, 1, "before"), (3, 1, "before"), (11, 1, "before"), (3, -1, "after")]
)
def test_shifted_rows(first, shift, row):
    """From row `first` on each reading was written a row too late, or too early."""
    order = np.arange(15)
    order[first:] = np.roll(order[first:], shift)
    wrong = replace(CAMPAIGN, position=CAMPAIGN.position[order], deflection=CAMPAIGN.deflection[order])
    findings = only(look(wrong), "observations_out_of_order")
    assert f"the row {row}" in findings[0].remedy


def test_repetitions_tell_sigma():
    """Ten postures, each measured four times with noise of its own: 90·3 degrees of freedom."""
    exact = prepare(simulate_campaign(default_arm(), load="pull", configurations=10, sigma=0.0, seed=5))[1]
    rows = np.repeat(np.arange(10), 4)
    unloaded, change = 3e-5 * np.random.default_rng(3).standard_normal((2, 40, 3, 3))
    repeated = replace(
        exact[rows],
        position=exact.position[rows] + unloaded,
        deflection=exact.deflection[rows] + change - unloaded,
        sigma=3e-5,
    )
    deflections, positions = only(look(repeated), "repeated_readings")
    assert (deflections.weight, positions.weight) == ("use", "use")
    for finding in (deflections, positions):
        assert 28.0 < float(re.search(r"(\S+) µm", finding.message)[1]) < 32.0
    found = look(repeated, sigma=1e-5)
    assert next(f for f in found if f.code == "repeated_readings").weight == "use_with_care"


def test_a_drift_is_told_where_a_target_was_hidden_for_once():
    """A row without one of the targets has no barycentre to compare: the others tell the drift."""
    present = CAMPAIGN.present.copy()
    present[7, 0] = False
    read = present[..., None]
    hidden = replace(
        CAMPAIGN,
        present=present,
        position=np.where(read, CAMPAIGN.position + DRIFT, 0.0),
        deflection=np.where(read, CAMPAIGN.deflection, 0.0),
    )
    (finding,) = only(look(hidden), "drift_in_time")
    assert "drifted by 5" in finding.message


def test_many_findings_are_counted():
    still = replace(CAMPAIGN, force=np.zeros((15, 3)))
    found = [f for f in look(still) if f.code == "zero_load"]
    assert len(found) == MAX_FINDINGS_PER_CODE
    assert "5 more of this kind" in found[-1].message


@pytest.mark.parametrize("load", ["pull", "dead_weight"])
@pytest.mark.parametrize("seed", range(10))
def test_a_robot_that_is_not_its_model_raises_no_finding(load, seed):
    """Links wrong by 0.3 mm and axes by 0.02°, as real robots are."""
    arm = default_arm()
    real = with_link_errors(arm, length=3e-4, angle=np.radians(0.02), seed=seed)
    document = simulate_campaign(real, load=load, configurations=10 + 3 * seed, seed=seed)
    _, measurements = prepare(document)
    assert look(measurements) == []
    assert look(only_deflections(measurements)) == []
    assert look(measurements, sigma=None) == []
