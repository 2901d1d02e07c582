"""Mistakes of a long day are noticed with their figure, and clean sets are left in peace."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import prepare, shared

from examples.simulator import default_arm, simulate_campaign
from solver.integrity import MAX_FINDINGS_PER_CODE, inspect


@pytest.fixture(scope="module")
def campaign():
    return prepare(simulate_campaign(default_arm(), load="pull", configurations=15, seed=5))


def codes(robot, measurements, *, degrees=False):
    return {finding.code for finding in inspect(robot, measurements, degrees=degrees)}


@pytest.mark.parametrize("load", ["pull", "dead_weight"])
@pytest.mark.parametrize("seed", range(20))
def test_clean_sets_raise_no_finding(load, seed):
    robot, measurements = prepare(simulate_campaign(default_arm(), load=load, seed=seed))
    assert inspect(robot, measurements, degrees=False) == []


@pytest.mark.parametrize(
    "name", ["fanuc_r2000ic/campaign", "simulated/pull_40", "simulated/dead_weight_motor"]
)
def test_shared_sets_raise_no_finding(name):
    assert inspect(*prepare(shared(name)), degrees=False) == []


def test_a_target_that_moved(campaign):
    robot, measurements = campaign
    position = measurements.position.copy()
    position[4, 1] += [0.0, 3e-4, 0.0]
    (finding,) = [
        f
        for f in inspect(robot, replace(measurements, position=position), degrees=False)
        if f.code == "targets_not_rigid"
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
    found = inspect(robot, replace(measurements, force=-measurements.force), degrees=False)
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
    found = inspect(robot, replace(measurements, force=force), degrees=False)
    assert [(f.code, f.observation) for f in found] == [("zero_load", 7)]
