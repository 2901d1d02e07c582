"""What each joint contributes to the predicted deflection, against levers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from support.campaigns import estimate, prepare

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.evidence.prediction import predict
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.chain import DhRow, dh_chain
from jointstiff.solver.robot.model import Robot

LEVERS = Robot(dh_chain([DhRow(1.0, 0.0, 0.0, 0.0)] * 2, "standard", "levers"))
"""Two levers of 1 m along x, both turning about z."""


def pulled(forces):
    """Read the flange of the stretched levers twice under each force, under the last one once."""
    n = len(forces)
    present = np.ones((n, 2), dtype=np.bool_)
    present[-1, 1] = False
    return Measurements(
        joints=np.zeros((n, 2)),
        force=np.array(forces, dtype=float),
        moment=np.zeros((n, 3)),
        load_point=np.zeros((n, 3)),
        position=np.zeros((n, 2, 3)),
        in_flange=present,
        deflection=np.zeros((n, 2, 3)),
        present=present,
    )


def test_is_torque_times_compliance_times_lever():
    """1 kN across gives 2000 and 1000 N.m, on levers of 2 and 1 m."""
    found = predict(LEVERS, pulled([[0, -1000, 0], [0, 500, 0]]), np.array([1e-6, 4e-6])).contributions
    np.testing.assert_allclose(found.by_observation, [[4e-3, 2e-3], [4e-3, 2e-3]], rtol=1e-12)
    np.testing.assert_allclose(found.mean, [10e-3 / 3, 10e-3 / 3], rtol=1e-12)  # three readings
    np.testing.assert_allclose(found.share, [0.5, 0.5], rtol=1e-12)


def test_shares_add_up_to_one_and_may_be_negative_and_vanish_along_the_levers():
    found = predict(LEVERS, pulled([[0, -1000, 0]]), np.array([1e-6, -3e-7])).contributions
    assert found.share.sum() == pytest.approx(1.0)
    assert found.share[1] < 0
    assert not predict(LEVERS, pulled([[1000, 0, 0]]), np.array([1e-6, 4e-6])).contributions.share.any()


def test_a_joint_without_an_estimate_counts_as_rigid():
    measurements = pulled([[0, -1000, 0]])
    found = predict(LEVERS, measurements, np.array([1e-6, 4e-6]), estimated=np.array([False, True]))
    assert found.contributions.mean.tolist() == [0.0, pytest.approx(4e-3)]
    np.testing.assert_allclose(found.predicted[0, 0], [0.0, -8e-3, 0.0], atol=1e-15)


@pytest.mark.parametrize("included", [False, True])
def test_means_add_up_to_the_mean_length_of_the_prediction(included):
    robot, measurements = prepare(simulate_campaign(default_arm(), load="pull", configurations=8, seed=1))
    compliance = estimate(robot, measurements).compliance
    found = predict(robot, measurements, compliance, complementary_stiffness=included)
    lengths = np.linalg.norm(found.predicted, axis=2)
    assert found.contributions.mean.sum() == pytest.approx(lengths[measurements.present].mean())
    np.testing.assert_allclose(found.contributions.by_observation.sum(axis=0), lengths.mean(axis=1))
