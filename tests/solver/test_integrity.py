"""Mistakes of a long day are noticed with their figure, and clean sets are left in peace."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import METHODS, estimate, prepare, shared

from examples.simulator import default_arm, simulate_campaign
from solver.integrity import MAX_FINDINGS_PER_CODE, inspect
from solver.plausibility import judge
from solver.prediction import predict


@pytest.fixture(scope="module")
def campaign():
    return prepare(simulate_campaign(default_arm(), load="pull", configurations=15, seed=5))


def codes(robot, measurements, *, degrees=False):
    return {finding.code for finding in look(robot, measurements, degrees=degrees)}


def look(robot, measurements, *, degrees=False):
    names = tuple(f"P{t}" for t in range(measurements.present.shape[1]))
    return inspect(robot, measurements, names, degrees=degrees)


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


def test_a_target_that_moved(campaign):
    robot, measurements = campaign
    position = measurements.position.copy()
    position[4, 1] += [0.0, 3e-4, 0.0]
    (finding,) = [
        f for f in look(robot, replace(measurements, position=position)) if f.code == "targets_not_rigid"
    ]
    assert finding.observation == 4
    assert "µm" in finding.message


def test_swapped_targets(campaign):
    robot, measurements = campaign
    position = measurements.position.copy()
    position[2, [0, 1]] = position[2, [1, 0]]
    assert "targets_not_rigid" in codes(robot, replace(measurements, position=position))


def test_rigidity_without_sigma_is_judged_by_the_other_observations(campaign):
    robot, measurements = campaign
    assert codes(robot, replace(measurements, sigma=None)) == set()
    position = measurements.position.copy()
    position[2, 0] += 1e-3
    assert "targets_not_rigid" in codes(robot, replace(measurements, sigma=None, position=position))


def test_sign_of_the_force(campaign):
    robot, measurements = campaign
    found = look(robot, replace(measurements, force=-measurements.force))
    against = [f for f in found if f.code == "deflection_against_force"]
    assert len(against) == MAX_FINDINGS_PER_CODE
    assert "5 more of this kind" in against[-1].message


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


def test_too_little_and_no_load(campaign):
    robot, measurements = campaign
    still = measurements.deflection.copy()
    still[3] = 1e-6
    assert "deflection_below_noise" in codes(robot, replace(measurements, deflection=still))
    force = measurements.force.copy()
    force[7] = 0.0
    found = look(robot, replace(measurements, force=force))
    assert [(f.code, f.observation) for f in found] == [("zero_load", 7)]


def test_lengths_far_too_small(campaign):
    robot, measurements = campaign
    metres_as_millimetres = replace(
        measurements, deflection=1e-3 * measurements.deflection, position=1e-3 * measurements.position
    )
    assert {"deflection_implausibly_small", "target_off_model"} <= codes(robot, metres_as_millimetres)


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
    assert (finding.code, finding.observation) == ("target_off_model", 5)
    assert "mm from its median place on the flange" in finding.message


def test_a_misspelt_target(campaign):
    robot, measurements = campaign

    def widen(array):
        wide = np.concatenate([array, np.zeros_like(array[:, :1])], axis=1)
        wide[3, 3], wide[3, 0] = wide[3, 0], 0
        return wide

    names = ("position", "deflection", "present", "in_flange")
    typo = replace(measurements, **{name: widen(getattr(measurements, name)) for name in names})
    (finding,) = look(robot, typo)
    assert finding.code == "target_name_suspect"
    assert "'P3' is read in 1 of 15 observations" in finding.message


def test_sigma_in_the_other_unit(campaign):
    robot, measurements = campaign
    assert "sigma_suspect" in codes(robot, replace(measurements, sigma=0.02))


class TestFits:
    def judged(self, robot, measurements, **options):
        found = estimate(robot, measurements, **options)
        return {f.code for f in judge(found, predict(robot, measurements, found.compliance))}

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
        assert {"low_compensation", "residuals_exceed_sigma"} <= self.judged(robot, turned)

    def test_force_in_the_wrong_unit(self, campaign):
        robot, measurements = campaign
        kilo = replace(measurements, force=1e6 * measurements.force)
        assert "stiffness_implausible" in self.judged(robot, kilo)

    def test_real_robot(self):
        assert self.judged(*prepare(shared("fanuc_r2000ic/campaign"))) == set()
