"""Causes of the load's path and of the arm: named, fitted and mended, by springs in exact balance."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import estimate
from support.springs import SpringCampaign, robot_of

from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import TARGETS, plan_experiment
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.solver.evidence.causes import screen_estimate
from jointstiff.solver.evidence.fitted_causes import fit_causes
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.block import fitted_errors
from jointstiff.solver.mechanics.measurements import (
    ROPE_ZERO_IF_TARED,
    ROPE_ZERO_OF_CELL,
    CommonUncertainty,
)
from jointstiff.solver.mechanics.terms import STIFFNESS, limit_to_later
from jointstiff.solver.text import unknowns_text

ARM = default_arm()
ROBOT = robot_of(ARM)
POINTS = np.array(list(TARGETS.values()))
COUNT = 28


def plan_of(sizes=(1.0,)):
    """Return pulls of 1500 N in all directions, times the sizes in turn."""
    plan = plan_experiment(ARM, configurations=COUNT, load="pull", force=1500.0, seed=11)
    factors = np.resize(sizes, COUNT)[:, None]
    return replace(plan, forces=factors * plan.forces)


def read(campaign, motion=0.0):
    """Return readings of a campaign whose targets also move by a motion (N, T, 3) under load [m]."""
    return next(replace(campaign, loaded=campaign.loaded + motion).measured(1, seed=5))


def tool(campaign):
    """A tool of 2e7 N/m and 1e6 N·m/rad between flange and targets."""
    plan = campaign.experiment
    rotation = ARM.posture(plan.joints).flange_rotation
    forces, moments, _ = (np.asarray(each) for each in plan.wrenches)
    moment = moments + np.cross(np.einsum("nij,nj->ni", rotation, plan.load_points), forces)
    levers = np.einsum("nij,tj->nti", rotation, POINTS)
    return read(campaign, forces[:, None] / 2e7 + np.cross(moment[:, None] / 1e6, levers))


def growth(campaign):
    return read(campaign, 6e-5 * campaign.loaded)


def growth_over_time(campaign):
    return read(campaign, 5e-6 * np.arange(COUNT)[:, None, None] * campaign.loaded)


def softer(campaign):
    """Joints 2 and 3 are softer by half from the thirteenth observation on."""
    plan = campaign.experiment
    factors = np.array([1.0, 1.5, 1.5, 1.0, 1.0, 1.0])
    bent = equilibrium(replace(ARM, stiffnesses=ARM.stiffnesses / factors), plan.joints, *plan.wrenches)
    motion = ARM.posture(plan.joints + bent).targets_to_base(POINTS) - campaign.loaded
    motion[:12] = 0.0
    return read(campaign, motion)


def hook(campaign):
    measured = read(campaign)
    return replace(measured, force=measured.force + np.array([0.0, 0.0, 30.0]))


def along_rope(campaign, zero=70.0):
    """Forces read from a cell with a zero along the rope [N]."""
    measured = read(campaign)
    along = measured.force / np.linalg.norm(measured.force, axis=1, keepdims=True)
    return replace(measured, force=measured.force + zero * along)


THREE = (0.5, 0.75, 1.0)
EXPECTED = {
    "tool": (tool, (1.0,), [5e-8, 1e-6]),
    "growth": (growth, (1.0,), [6e-5]),
    "growth_over_time": (growth_over_time, (1.0,), [5e-6]),
    "hook_weight": (hook, (1.0,), [30.0]),
    "rope_zero": (along_rope, THREE, [-70.0]),
}


def screened(measurements):
    found = estimate(ROBOT, measurements, complementary_stiffness="included")
    return screen_estimate(Rows(ROBOT, measurements), found)


def named(measurements):
    return [(cause.suspect.name, cause.suspect.first) for cause in screened(measurements).causes]


def assert_mended(measurements, causes):
    """Assert that with the causes fitted each joint is within 3.5 standard uncertainties of the truth."""
    settings = Settings.from_options(RunOptions(), ROBOT)
    mended = JointsAlone(Rows(ROBOT, fit_causes(Rows(ROBOT, measurements), causes)), settings).estimate
    for joint, truth in zip(mended.joints, ARM.compliances, strict=True):
        assert abs(joint.compliance - truth) < 3.5 * joint.standard_uncertainty, joint.name


@pytest.mark.parametrize("name", EXPECTED)
def test_a_cause_of_the_loads_path_is_named_alone_with_its_size_and_mended(name):
    plant, sizes, expected = EXPECTED[name]
    measurements = plant(SpringCampaign.by(ARM, plan_of(sizes)))
    assert named(measurements) == [(name, None)]
    fitted = fitted_errors(fit_causes(Rows(ROBOT, measurements), [(name, None)]))
    uncertainties = np.linalg.norm(fitted.root, axis=1)
    assert (np.abs(fitted.unknowns[0] - expected) < 4.0 * uncertainties).all()
    assert (uncertainties < 0.5 * np.abs(expected)).all()
    assert_mended(measurements, [(name, None)])


def test_another_stiffness_is_named_with_the_observation_since_which_it_acts():
    measurements = softer(SpringCampaign.by(ARM, plan_of()))
    first = measurements.labels[12]
    assert named(measurements) == [("stiffness", first)]
    assert_mended(measurements, [("stiffness", first)])


def test_another_stiffness_also_moves_what_encoders_see_since_that_observation_only():
    measurements = read(SpringCampaign.by(ARM, plan_of()))
    block = Rows(ROBOT, measurements).block
    later = limit_to_later(STIFFNESS, measurements.labels, measurements.labels[12])
    motion, whole = later.motion(block, ARM.compliances), STIFFNESS.motion(block, ARM.compliances)
    assert not motion.joints[:12].any()
    np.testing.assert_array_equal(motion.joints[12:], whole.joints[12:])
    np.testing.assert_array_equal(motion.targets[12:], block.jacobian[12:] * block.torque[12:, None, None])


def test_loads_of_one_size_cannot_show_a_zero_along_the_rope():
    measurements = along_rope(SpringCampaign.by(ARM, plan_of()))
    assert "rope_zero" not in {test.name for test in screened(measurements).tests}


def test_of_two_sizes_a_zero_along_the_rope_and_scales_of_the_loads_are_a_tie():
    measurements = along_rope(SpringCampaign.by(ARM, plan_of((0.5, 1.0))))
    assert {name for name, _ in named(measurements)} >= {"rope_zero", "load_scale"}


def test_a_clean_campaign_of_three_sizes_names_nothing():
    assert named(read(SpringCampaign.by(ARM, plan_of(THREE)))) == []


def test_sizes_are_in_units_that_people_read():
    assert unknowns_text("m/N, rad/(N·m)", [5e-8, 1e-6]) == "(50) µm/kN and (1) µrad/(N·m)"
    assert unknowns_text("m/m", [6e-5]) == "(60) µm/m"


CELL = CommonUncertainty(rope_zero=ROPE_ZERO_OF_CELL)


def list_errors(measurements):
    """Return for each joint its error in standard uncertainties."""
    joints = estimate(ROBOT, measurements, complementary_stiffness="included").joints
    uncertainties = np.array([joint.standard_uncertainty for joint in joints])
    return (np.array([joint.compliance for joint in joints]) - ARM.compliances) / uncertainties


@pytest.mark.parametrize("sizes", [(1.0,), THREE])
@pytest.mark.parametrize("zero", [-50.0, 50.0])
def test_the_zero_of_a_cell_is_within_the_intervals_if_the_ground_is_a_cell(sizes, zero):
    measurements = along_rope(SpringCampaign.by(ARM, plan_of(sizes)), zero)
    assert np.abs(list_errors(measurements)).max() > 3.5
    stated = replace(measurements, common_uncertainty=CELL)
    assert np.abs(list_errors(stated)).max() < 2.5


def test_loads_of_three_sizes_show_the_zero_of_a_cell():
    """The zero then costs little: with one size, it is a scale that the readings cannot distinguish."""
    widths = []
    for sizes in ((1.0,), THREE):
        campaign = replace(read(SpringCampaign.by(ARM, plan_of(sizes))), common_uncertainty=CELL)
        joints = estimate(ROBOT, campaign, complementary_stiffness="included").joints
        widths.append(joints[1].standard_uncertainty / joints[1].compliance)
    assert widths[0] == pytest.approx(ROPE_ZERO_OF_CELL / 1500.0, rel=0.1)
    assert widths[1] < 0.7 * widths[0]


def test_the_zero_of_a_cell_is_a_source_of_the_budget():
    measurements = replace(read(SpringCampaign.by(ARM, plan_of())), common_uncertainty=CELL)
    common = estimate(ROBOT, measurements).common
    np.testing.assert_allclose(
        np.abs(common.responses_to("rope_zero")[1]) / ARM.compliances[1],
        ROPE_ZERO_OF_CELL / 1500.0,
        rtol=0.05,
    )


def test_a_zero_is_tested_against_the_ground_of_the_force():
    """A zero of 70 N is named without a ground; one of a cell that was not tared may be as large."""
    measurements = along_rope(SpringCampaign.by(ARM, plan_of(THREE)))
    tared = CommonUncertainty(rope_zero=ROPE_ZERO_IF_TARED)
    assert named(replace(measurements, common_uncertainty=CELL)) == []
    assert named(replace(measurements, common_uncertainty=tared)) == [("rope_zero", None)]


def test_a_joint_near_the_line_of_a_fitted_load_point_keeps_its_true_stiffness_possible():
    """The load hangs within 5 mm of joint 6's axis, and its place is stated 10 cm away from there."""
    settings, held = Settings.from_options(RunOptions(), ROBOT), list[bool]()
    for seed in range(24):
        plan = SpringCampaign.of(ARM, configurations=16, seed=seed).experiment
        place = np.tile([0.005 * (seed % 2), 0.0, 0.12], (16, 1))
        (true,) = SpringCampaign.by(ARM, replace(plan, load_points=place)).measured(1, seed=seed)
        stated = replace(true, load_point=place + np.array([0.08, -0.05, 0.03]))
        mended = fit_causes(Rows(ROBOT, stated), [("load_point", None)])
        joint = identify(Rows(ROBOT, mended), settings).joints[5]
        low, high = joint.compliance_interval or joint.one_sided or (0.0, np.inf)
        held.append(low <= ARM.compliances[5] <= high)
    assert sum(held) >= 21  # fewer of 24 intervals of 95 %: p = 0.03
