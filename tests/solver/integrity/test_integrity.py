"""Mistakes of a long day are noticed with their figure, and clean sets are left in peace."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import METHODS, estimate, prepare
from support.shared_data import shared

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.campaign import TARGETS, experiment_of, linear_deflections
from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.solver.evidence.assessment import fit_reasons
from jointstiff.solver.evidence.prediction import predict
from jointstiff.solver.integrity import MAX_FINDINGS_PER_CODE, inspect
from jointstiff.solver.robot.configuration import Configurations


@pytest.fixture(scope="module")
def campaign():
    return prepare(simulate_campaign(default_arm(), load="pull", configurations=15, seed=5))


def codes(robot, measurements, *, degrees=False):
    return {finding.code for finding in look(robot, measurements, degrees=degrees)}


def look(robot, measurements, *, degrees=False):
    return inspect(robot, measurements, degrees=degrees)


@pytest.mark.parametrize("load", ["pull", "dead_weight"])
@pytest.mark.parametrize("seed", range(20))
def test_clean_sets_raise_no_finding(load, seed):
    robot, measurements = prepare(simulate_campaign(default_arm(), load=load, seed=seed))
    assert look(robot, measurements) == []


@pytest.mark.parametrize(
    "name", ["fanuc_r2000ic/campaign", "simulated/pull_40", "simulated/dead_weight_motor"]
)
def test_shared_sets_raise_no_finding(name):
    assert look(*prepare(shared(name))) == []


def only(findings, *codes):
    """The findings, which must be of these kinds and no other."""
    assert {finding.code for finding in findings} == set(codes), findings
    return findings


def moved(measurements, row, target, shift, *, lasting, state="unloaded"):
    """One target displaced by (3,) along the axes of R0, unloaded and what follows, or loaded alone."""
    position, deflection = measurements.position.copy(), measurements.deflection.copy()
    if state == "loaded":
        deflection[row, target] += shift
    else:
        position[row : None if lasting else row + 1, target] += shift
    return replace(measurements, position=position, deflection=deflection)


def test_a_target_that_moved_for_once(campaign):
    robot, measurements = campaign
    bumped = moved(measurements, 4, 1, [0.0, 4e-4, 0.0], lasting=False)
    (finding,) = only(look(robot, bumped), "targets_not_rigid")
    assert (finding.where, finding.weight) == ("observations[4] 'c05'", "do_not_use")
    assert "'P11'" in finding.remedy
    assert "µm" in finding.message


def test_a_target_bumped_for_good_is_named_with_the_first_row(campaign):
    robot, measurements = campaign
    position = measurements.position.copy()
    at = Configurations(robot, robot.joint_map.model_angles(measurements.joints))
    position[9:, 2] += at.flange_rotation[9:] @ np.array([3e-4, -6e-4, 5e-4])
    (finding,) = only(look(robot, replace(measurements, position=position)), "target_moved")
    assert finding.observation == "c10"
    assert "'P12' is displaced by 8" in finding.message  # 837 µm


@pytest.mark.parametrize("row", [1, 14])
def test_one_posture_on_a_side_is_no_step(campaign, row):
    """That posture is named instead, by its distances."""
    robot, measurements = campaign
    position = measurements.position.copy()
    at = Configurations(robot, robot.joint_map.model_angles(measurements.joints))
    position[row:, 2] += at.flange_rotation[row:] @ np.array([3e-4, -6e-4, 5e-4])
    (finding,) = only(look(robot, replace(measurements, position=position)), "targets_not_rigid")
    assert finding.observation == ("c01" if row == 1 else "c15")


@pytest.mark.parametrize(("repeated", "code"), [(True, "targets_not_rigid"), (False, "target_moved")])
def test_a_step_needs_two_postures_on_each_side(campaign, repeated, code):
    """The same rows with the second posture measured again, or another, before the target was bumped."""
    robot, measurements = campaign
    if repeated:
        order = np.r_[0, 0, 2 : len(measurements)]
        shift = 1e-6 * np.arange(len(order))[:, None, None]  # no copies of each other
        measurements = replace(measurements[order], position=measurements.position[order] + shift)
    position = measurements.position.copy()
    at = Configurations(robot, robot.joint_map.model_angles(measurements.joints))
    position[2:, 2] += at.flange_rotation[2:] @ np.array([3e-4, -6e-4, 5e-4])
    steps = {"target_moved", "targets_not_rigid"}
    assert codes(robot, replace(measurements, position=position)) & steps == {code}


def test_a_target_whose_distances_hold_has_not_moved(campaign):
    """Across the plane of the three targets by 2 mm: an error of the flange's direction looks the same."""
    robot, measurements = campaign
    position = measurements.position.copy()
    arms = position[9:, :2] - position[9:, 2:]
    normal = np.cross(arms[:, 0], arms[:, 1])
    position[9:, 2] += 2e-3 * normal / np.linalg.norm(normal, axis=1, keepdims=True)
    lengths = np.linalg.norm(position[:, :2] - position[:, 2:], axis=2)
    assert np.ptp(lengths, axis=0).max() < 2e-4
    assert "target_moved" not in codes(robot, replace(measurements, position=position))


def test_targets_that_turn_together_are_the_models_error(campaign):
    """From a row on the flange's direction is wrong by 2 mrad: no distance between targets changes."""
    robot, measurements = campaign
    position = measurements.position.copy()
    middle = position[9:].mean(axis=1, keepdims=True)
    turn = np.array([[1.0, -2e-3, 0.0], [2e-3, 1.0, 0.0], [0.0, 0.0, 1.0]])
    at = Configurations(robot, robot.joint_map.model_angles(measurements.joints)).flange_rotation[9:]
    arms = (position[9:] - middle) @ at
    position[9:] = middle + np.einsum("nij,ntj->nti", at, arms @ turn.T)
    assert "target_moved" not in codes(robot, replace(measurements, position=position))


def test_exact_readings_raise_no_finding(campaign):
    """Rounding is neither drift nor outlier, of springs in exact balance or of the linear model."""
    robot, _ = campaign
    arm = default_arm()
    document = simulate_campaign(arm, load="pull", configurations=15, sigma=0.0, seed=5)
    _, exact = prepare(document)
    assert look(robot, exact) == []
    plan = experiment_of(document)
    linear = linear_deflections(arm, plan.joints, *plan.wrenches, np.array(list(TARGETS.values())))
    assert look(robot, replace(exact, deflection=linear)) == []
    assert look(robot, unplaced(replace(exact, deflection=linear))) == []


def test_a_target_bumped_under_load(campaign):
    robot, measurements = campaign
    findings = look(robot, moved(measurements, 6, 0, [0.0, 0.0, 1e-3], lasting=False, state="loaded"))
    only(findings, "targets_not_rigid", "residual_outlier")
    assert {finding.observation for finding in findings} == {"c07"}


@pytest.mark.parametrize("state", ["both", "loaded"])
def test_swapped_targets_are_named(campaign, state):
    robot, measurements = campaign
    unloaded, loaded = measurements.position.copy(), measurements.position + measurements.deflection
    loaded[2, [0, 1]] = loaded[2, [1, 0]]
    if state == "both":
        unloaded[2, [0, 1]] = unloaded[2, [1, 0]]
    found = look(robot, replace(measurements, position=unloaded, deflection=loaded - unloaded))
    (finding,) = [f for f in found if f.code == "targets_swapped"]
    assert finding.observation == "c03"
    assert "'P10' is 'P11', 'P11' is 'P10'" in finding.message
    assert state == "loaded" or len(found) == 1


def test_rigidity_without_sigma_is_judged_by_the_other_observations(campaign):
    robot, measurements = campaign
    assert codes(robot, replace(measurements, sigma=None)) == set()
    position = measurements.position.copy()
    position[2, 0] += 1e-3
    assert "targets_not_rigid" in codes(robot, replace(measurements, sigma=None, position=position))


def test_sign_of_the_force(campaign):
    robot, measurements = campaign
    (finding,) = only(look(robot, replace(measurements, force=-measurements.force)), "force_sign_suspect")
    assert finding.weight == "do_not_use"
    assert "of 15 observations" in finding.message


def test_sign_of_one_force(campaign):
    robot, measurements = campaign
    force = measurements.force.copy()
    force[3] *= -1.0
    (finding,) = only(look(robot, replace(measurements, force=force)), "deflection_against_force")
    assert finding.observation == "c04"


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("read", ["positions", "deflections"])
def test_sign_of_a_joint(campaign, joint, read):
    robot, measurements = campaign
    joints = measurements.joints.copy()
    joints[:, joint] *= -1.0
    wrong = replace(measurements if read == "positions" else unplaced(measurements), joints=joints)
    (finding,) = only(within_limits(look(robot, wrong)), "joint_sign_suspect")
    assert f"joint_{joint + 1}" in finding.remedy


def within_limits(findings):
    """Other findings than that wrong angles are beyond the robot's limits."""
    return [finding for finding in findings if finding.code != "joint_outside_limits"]


def unplaced(measurements):
    """The same readings as deflections alone."""
    places = np.broadcast_to(np.array(list(TARGETS.values())), measurements.position.shape)
    return replace(measurements, position=places, in_flange=measurements.present)


@pytest.mark.parametrize("pair", [(0, 3), (1, 2), (3, 5), (4, 5)])
def test_swapped_joints(campaign, pair):
    robot, measurements = campaign
    joints = measurements.joints.copy()
    joints[:, pair] = joints[:, pair[::-1]]
    found = within_limits(look(robot, replace(measurements, joints=joints)))
    (finding,) = only(found, "joints_swapped")
    assert f"joint_{pair[0] + 1} and joint_{pair[1] + 1}" in finding.remedy


@pytest.mark.parametrize("first", [0, 3, 11])
def test_shifted_rows(campaign, first):
    """From row `first` on each reading was written a row too late; the last one came first."""
    robot, measurements = campaign
    order = np.arange(15)
    order[first:] = np.roll(order[first:], 1)
    wrong = replace(
        measurements, position=measurements.position[order], deflection=measurements.deflection[order]
    )
    findings = only(look(robot, wrong), "observations_out_of_order")
    assert "the row before" in findings[0].remedy


def test_readings_of_two_rows_exchanged(campaign):
    robot, measurements = campaign
    order = np.arange(15)
    order[[4, 9]] = 9, 4
    wrong = replace(
        measurements, position=measurements.position[order], deflection=measurements.deflection[order]
    )
    findings = only(look(robot, wrong), "observations_out_of_order")
    assert [f.observation for f in findings] == ["c05", "c10"]
    assert "observations[9]" in findings[0].message


def test_a_duplicated_row(campaign):
    robot, measurements = campaign
    (finding,) = only(look(robot, measurements[np.array([*range(15), 6])]), "duplicated_observation")
    assert finding.where.startswith("observations[15]")
    assert "observations[6]" in finding.message


def test_repetitions_tell_sigma(campaign):
    """Ten postures, each measured four times with noise of its own: 90·3 degrees of freedom."""
    robot, _ = campaign
    exact = prepare(simulate_campaign(default_arm(), load="pull", configurations=10, sigma=0.0, seed=5))[1]
    rows = np.repeat(np.arange(10), 4)
    unloaded, change = 3e-5 * np.random.default_rng(3).standard_normal((2, 40, 3, 3))
    repeated = replace(
        exact[rows],
        position=exact.position[rows] + unloaded,
        deflection=exact.deflection[rows] + change - unloaded,
        sigma=3e-5,
    )
    deflections, positions = only(look(robot, repeated), "repeated_readings")
    assert (deflections.weight, positions.weight) == ("use", "use")
    for finding in (deflections, positions):
        assert 28.0 < float(re.search(r"(\S+) µm", finding.message)[1]) < 32.0
    found = look(robot, replace(repeated, sigma=1e-5))
    assert next(f for f in found if f.code == "repeated_readings").weight == "use_with_care"


def test_a_tracker_that_drifts(campaign):
    robot, measurements = campaign
    drift = np.linspace(0.0, 1.0, 15)[:, None, None] * np.array([3e-4, 0.0, -4e-4])
    (finding,) = only(
        look(robot, replace(measurements, position=measurements.position + drift)), "drift_in_time"
    )
    assert finding.weight == "use_with_care"
    assert "drifted by 5" in finding.message  # 500 µm


def test_a_drift_is_told_where_a_target_was_hidden_for_once(campaign):
    """A row without one of the targets has no barycentre to compare: the others tell the drift."""
    robot, measurements = campaign
    drift = np.linspace(0.0, 1.0, 15)[:, None, None] * np.array([3e-4, 0.0, -4e-4])
    present = measurements.present.copy()
    present[7, 0] = False
    read = present[..., None]
    hidden = replace(
        measurements,
        present=present,
        position=np.where(read, measurements.position + drift, 0.0),
        deflection=np.where(read, measurements.deflection, 0.0),
    )
    (finding,) = only(look(robot, hidden), "drift_in_time")
    assert "drifted by 5" in finding.message


def test_a_reading_that_no_springs_explain(campaign):
    robot, measurements = campaign
    deflection = measurements.deflection.copy()
    deflection[5] += [8e-4, -8e-4, 8e-4]
    (finding,) = only(look(robot, replace(measurements, deflection=deflection)), "residual_outlier")
    assert finding.observation == "c06"


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_forces_in_the_other_unit(campaign, factor):
    robot, measurements = campaign
    assert "force_unit_suspect" in codes(robot, replace(measurements, force=factor * measurements.force))


def test_many_findings_are_counted(campaign):
    robot, measurements = campaign
    still = replace(measurements, force=np.zeros((15, 3)))
    found = [f for f in look(robot, still) if f.code == "zero_load"]
    assert len(found) == MAX_FINDINGS_PER_CODE
    assert "5 more of this kind" in found[-1].message


@pytest.mark.parametrize("load", ["pull", "dead_weight"])
@pytest.mark.parametrize("seed", range(10))
def test_a_robot_that_is_not_its_model_raises_no_finding(load, seed):
    """Links wrong by 0.3 mm and axes by 0.02°, as real robots are."""
    arm = default_arm()
    real = with_link_errors(arm, length=3e-4, angle=np.radians(0.02), seed=seed)
    document = simulate_campaign(real, load=load, configurations=10 + 3 * seed, seed=seed)
    robot, _ = prepare(simulate_campaign(arm, configurations=1))
    _, measurements = prepare(document)
    assert look(robot, measurements) == []
    assert look(robot, unplaced(measurements)) == []
    assert look(robot, replace(measurements, sigma=None)) == []


def test_angles_in_the_other_unit(campaign):
    robot, measurements = campaign
    degrees = replace(measurements, joints=np.rad2deg(measurements.joints))
    assert {"angle_unit_suspect", "joint_outside_limits"} <= codes(robot, degrees)
    radians = replace(measurements, joints=np.deg2rad(measurements.joints))
    assert "angle_unit_suspect" in codes(robot, radians, degrees=True)


def test_lengths_in_the_other_unit(campaign):
    robot, measurements = campaign
    millimetres = replace(measurements, deflection=1e3 * measurements.deflection)
    assert "deflection_implausibly_large" in codes(robot, millimetres)
    everything = replace(millimetres, position=1e3 * measurements.position)
    assert "length_unit_suspect" in codes(robot, everything)


def test_too_little_and_no_load(campaign):
    robot, measurements = campaign
    still = measurements.deflection.copy()
    still[3] = 1e-6
    assert "deflection_below_noise" in codes(robot, replace(measurements, deflection=still))
    force = measurements.force.copy()
    force[7] = 0.0
    assert [(f.code, f.observation) for f in look(robot, replace(measurements, force=force))] == [
        ("zero_load", "c08")
    ]


def test_lengths_far_too_small(campaign):
    robot, measurements = campaign
    metres_as_millimetres = replace(
        measurements, deflection=1e-3 * measurements.deflection, position=1e-3 * measurements.position
    )
    assert {"deflection_implausibly_small", "length_unit_suspect"} <= codes(robot, metres_as_millimetres)


def test_positions_in_another_frame(campaign):
    robot, measurements = campaign
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    elsewhere = replace(measurements, position=measurements.position @ turn.T + [1.0, 2.0, 0.0])
    assert "target_off_model" in codes(robot, elsewhere)


def test_a_typing_error_in_an_angle(campaign):
    robot, measurements = campaign
    joints = measurements.joints.copy()
    joints[5, 1] += 0.1
    (finding,) = look(robot, replace(measurements, joints=joints))
    assert (finding.code, finding.observation) == ("target_off_model", "c06")
    assert "mm away from its median position on the flange" in finding.message


def test_a_misspelt_target(campaign):
    robot, measurements = campaign

    def widen(array):
        wide = np.concatenate([array, np.zeros_like(array[:, :1])], axis=1)
        wide[3, 3], wide[3, 0] = wide[3, 0], 0
        return wide

    names = ("position", "deflection", "present", "in_flange")
    typo = replace(
        measurements,
        targets=(*measurements.targets, "P01"),
        **{name: widen(getattr(measurements, name)) for name in names},
    )
    (finding,) = look(robot, typo)
    assert finding.code == "target_name_suspect"
    assert "'P01' is read in only 1 of 15 observations" in finding.message


def test_sigma_in_the_other_unit(campaign):
    robot, measurements = campaign
    assert "sigma_suspect" in codes(robot, replace(measurements, sigma=0.02))


class TestFits:
    def judged(self, robot, measurements, **options):
        fit = estimate(robot, measurements, **options)
        found = fit_reasons(measurements, fit, predict(robot, measurements, fit.compliance))
        return {finding.code for finding in found}

    @pytest.mark.parametrize("method", METHODS)
    def test_good_fits_raise_nothing(self, campaign, method):
        assert self.judged(*campaign, method=method) == set()

    def test_residuals_far_above_sigma(self, campaign):
        robot, measurements = campaign
        assert "residuals_exceed_sigma" in self.judged(robot, replace(measurements, sigma=1e-6))
        assert self.judged(robot, replace(measurements, sigma=None)) == set()

    def test_force_in_the_wrong_direction(self, campaign):
        robot, measurements = campaign
        turned = replace(measurements, force=measurements.force[:, [1, 2, 0]])
        assert {"deflection_unexplained", "residuals_exceed_sigma"} <= self.judged(robot, turned)

    def test_force_in_the_wrong_unit(self, campaign):
        robot, measurements = campaign
        kilo = replace(measurements, force=1e6 * measurements.force)
        assert "stiffness_implausible" in self.judged(robot, kilo)

    def test_real_robot(self):
        assert self.judged(*prepare(shared("fanuc_r2000ic/campaign"))) == {"sigma_implausible"}
