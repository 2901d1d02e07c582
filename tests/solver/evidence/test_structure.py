"""Encoders with a tracker: play in gears is no mistake, structure behind the encoders is taken apart."""

from dataclasses import replace

import numpy as np
import pytest
from support.encoder_campaigns import READ, STATED, EncoderCampaign, Errors, compare_pair, simulate_pair
from support.encoder_campaigns import simulate as simulate_on
from support.springs import SpringCampaign, robot_of

from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.comparison.campaigns import SharedErrors
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements, Scatter
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.run import run

ARM = default_arm()
ROBOT = robot_of(ARM)
PLAY = Errors(play=20e-6)
SAME_LOAD = SharedErrors(load=True)


def simulate(errors: Errors, seed: int) -> EncoderCampaign:
    """Return a campaign of random postures and pulls."""
    return simulate_on(SpringCampaign.of(ARM, seed=seed), errors, seed)


def joints_of(measurements: Measurements) -> JointsAlone:
    return JointsAlone(Rows(ROBOT, measurements), Settings.from_options(RunOptions(), ROBOT))


def test_rows_of_tracker_and_encoders_are_whitened_together():
    """The covariance of the readings of a posture, by its definition, becomes that of independent noise."""
    measurements = simulate(Errors(), 0).measurements
    noise = (2.0, 1.5, 3.0, 1.0, 1.0, 1.0)
    scatter = Scatter(joints=2e-5 / measurements.sigma, station=0.7, encoders=noise)
    block = Rows(ROBOT, replace(measurements, scatter=scatter)).block
    first = block.measurements.present[0].size
    size = 3 * first + len(READ)
    turns = np.concatenate([block.jacobian[0].reshape(-1, 6), np.eye(6)[list(READ)]])
    shifts = np.concatenate([np.tile(np.eye(3), (first, 1)), np.zeros((len(READ), 3))])
    own = np.concatenate([np.full(3 * first, measurements.sigma), STATED * np.array(noise)[list(READ)]])
    covariance = np.diag(2.0 * own**2) + (2e-5) ** 2 * turns @ turns.T
    covariance += 0.5 * 2.0 * (0.7 * measurements.sigma) ** 2 * shifts @ shifts.T
    root = np.linalg.cholesky(covariance)
    targets = np.broadcast_to(root[: 3 * first].reshape(first, 3, size), (len(block.torque), first, 3, size))
    encoders = np.zeros((len(block.torque), 6, size))
    encoders[:, list(READ)] = root[3 * first :]
    whitened = np.concatenate(
        [block.whiten(targets)[0].reshape(-1, size), block.whiten_encoders(encoders, targets)[0, list(READ)]]
    )
    np.testing.assert_allclose(whitened @ whitened.T, measurements.sigma**2 * np.eye(size), atol=1e-16)


@pytest.mark.parametrize("errors", [PLAY, Errors(encoder=20e-6)], ids=["play", "encoders off"])
def test_errors_that_no_data_sheet_states_widen_intervals_and_are_no_reason(errors: Errors):
    held: list[bool] = []
    for seed in range(3):
        campaign = simulate(errors, seed)
        result = run(ROBOT, campaign.measurements, RunOptions())
        assert result.assessment.verdict == "use"
        notes = " ".join(result.assessment.notes)
        # Tracker and encoders both see play, which is how far joints do not return.
        expected = result.goodness.repeatability if errors.play else "The encoders scatter more" in notes
        assert expected
        for joint, c in zip(result.joints, campaign.arm.compliances, strict=True):
            lower, upper = joint.compliance_interval
            held.append(lower <= c <= upper)
    assert sum(held) >= 15  # of 18


def widths(measurements: Measurements) -> FloatArray:
    """Standard uncertainties of the joints with an encoder."""
    return np.array([joints_of(measurements).estimate.joints[j].standard_uncertainty for j in READ])


def test_encoders_as_good_as_stated_sharpen_the_joints():
    measurements = simulate(Errors(), 0).measurements
    assert (widths(measurements) < 0.7 * widths(replace(measurements, encoders=None))).all()


def test_structure_behind_the_encoders_is_taken_apart():
    """Two fifths of each compliance are behind the encoder; the joints are those that the targets show."""
    held: list[bool] = []
    for seed in range(3):
        campaign = simulate(Errors(play=20e-6, structure=0.4), seed)
        joints = joints_of(campaign.measurements)
        c = campaign.arm.compliances[list(READ)]
        truth = np.stack([0.6 * c, 0.4 * c])
        lower, upper = joints.apart.interval[..., 0], joints.apart.interval[..., 1]
        held += ((lower <= truth) & (truth <= upper)).ravel().tolist()
        assert joints.apart.shows_structure
        by_targets = joints_of(replace(campaign.measurements, encoders=None)).estimate
        np.testing.assert_array_equal(joints.estimate.compliance, by_targets.compliance)
    assert sum(held) >= 16  # of 18


def test_a_run_prints_gearboxes_and_structure_whose_compliances_add_up():
    campaign = simulate(Errors(structure=0.4), 1)
    result = run(ROBOT, campaign.measurements, RunOptions())
    names = [f"joint_{j + 1}" for j in READ]
    assert [each.name for each in result.gearboxes] == [each.name for each in result.structures] == names
    for joint, gearbox, structure in zip(result.joints, result.gearboxes, result.structures, strict=False):
        whole = gearbox.compliance + structure.compliance
        assert whole == pytest.approx(joint.compliance, rel=0.02)
        lower, upper = gearbox.compliance_interval
        assert gearbox.stiffness_interval == pytest.approx((1.0 / upper, 1.0 / lower))
        assert gearbox.status == structure.status == "identified"
    assert any("structure behind the encoders bends" in note for note in result.assessment.notes)


def test_an_encoder_that_sees_more_than_the_targets_is_named():
    measurements = simulate(Errors(), 0).measurements
    encoders = measurements.encoders
    factor = np.array([1.0, 1.3, 1.0, 1.0, 1.0, 1.0])
    wrong = replace(measurements, encoders=replace(encoders, deflection=factor * encoders.deflection))
    assessment = run(ROBOT, wrong, RunOptions()).assessment
    (reason,) = [each for each in assessment.reasons if each.where == "joint_2"]
    assert reason.code == "encoder_deflection_implausibly_large"
    assert assessment.verdict == "use_with_care"


def test_columns_of_encoders_are_in_the_stack():
    measurements = simulate(Errors(), 0).measurements
    rows = Rows(ROBOT, measurements)
    stack = rows.stack([JOINTS], np.zeros(6))
    assert stack.read.tolist() == [12] * len(measurements)
    of_encoders = stack.rows[:, -6:, :6]
    expected = measurements.sigma / STATED / np.sqrt(2.0) * rows.block.torque[..., None] * np.eye(6)
    expected[:, 3:] = 0.0
    np.testing.assert_allclose(of_encoders, expected)


STATED_LOADS = CommonUncertainty(scale=0.002, load_point=0.002)


def test_two_runs_give_gearbox_and_structure_in_one_fit():
    """Errors are within 3.5 standard uncertainties; joint 2 has at most 0.6 of the difference's width."""
    ratios = []
    for seed in range(3):
        pair = simulate_pair(SpringCampaign.of(ARM, seed=seed), STATED_LOADS, seed, SAME_LOAD)
        compared = compare_pair(pair, SAME_LOAD)
        apart = compared.apart
        assert apart.joints.tolist() == list(READ)
        truth = np.stack([pair.gearboxes, pair.structure])
        assert (np.abs(apart.free_compliance - truth) < 3.5 * apart.uncertainty).all()
        assert not len(apart.differing)
        difference = np.ptp(compared.differences[1].compliance_interval)
        ratios.append(np.ptp(apart.interval[0, 1]) / difference)
    assert np.median(ratios) <= 0.6


def test_structure_is_sharper_by_two_runs_than_by_one():
    pair = simulate_pair(SpringCampaign.of(ARM, seed=4), STATED_LOADS, 4, SAME_LOAD)
    by_two = compare_pair(pair, SAME_LOAD).apart
    by_one = joints_of(pair.motor).apart
    assert (np.ptp(by_two.interval[1], axis=1) < 0.9 * np.ptp(by_one.interval[1], axis=1)).all()


def test_an_encoder_that_is_not_the_one_in_the_loop_is_named():
    """The loop removes all of the gearbox, but the encoder read on joint 2 sees three quarters of it."""
    pair = simulate_pair(SpringCampaign.of(ARM, seed=5), STATED_LOADS, 5, SAME_LOAD)
    factor = np.array([1.0, 0.75, 1.0, 1.0, 1.0, 1.0])
    encoders = replace(pair.motor.encoders, deflection=factor * pair.motor.encoders.deflection)
    wrong = replace(pair, motor=replace(pair.motor, encoders=encoders))
    apart = compare_pair(wrong, SAME_LOAD).apart
    assert apart.differing.tolist() == [1]
    assert apart.excess[1] < 0.0


def test_without_encoders_in_the_loop_of_one_run_nothing_is_taken_apart():
    pair = simulate_pair(SpringCampaign.of(ARM, seed=4), STATED_LOADS, 4, SAME_LOAD)
    repeated = replace(pair, secondary=replace(pair.secondary, closed_on_links=False))
    assert compare_pair(repeated, SAME_LOAD).apart is None


def test_the_order_of_the_two_runs_does_not_matter():
    pair = simulate_pair(SpringCampaign.of(ARM, seed=4), STATED_LOADS, 4, SAME_LOAD)
    swapped = replace(pair, motor=pair.secondary, secondary=pair.motor)
    first, second = (compare_pair(each, SAME_LOAD).apart for each in (pair, swapped))
    np.testing.assert_allclose(first.interval, second.interval, rtol=1e-9)
