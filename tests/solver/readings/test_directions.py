"""Readings along one direction: a gauge's row is a row of the tracker's, in every method that takes it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import ARM, assert_covariance, estimate, prepare, settings_of
from support.gauges import by_gauges, triads

from jointstiff.simulator import simulate_campaign
from jointstiff.simulator.campaign import torques
from jointstiff.simulator.document import experiment_of
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.resampling import gram_blocks

SPREAD = {"P0": (0.15, 0.0, 0.1), "P1": (-0.1, 0.12, 0.1), "P2": (-0.1, -0.12, 0.05)}


ONE = {"P0": (0.1, 0.05, 0.1)}


def campaign(targets=ONE, **options):
    options = {"load": "pull", "seed": 3, "configurations": 20, "readings": "deflections"} | options
    return simulate_campaign(ARM, targets=targets, **options)


def deflections_of(document):
    return np.array([o["readings"][0]["deflection"] for o in document["measurement_set"]["observations"]])


def as_exact(document, of_gauges, **options):
    """Both fits, which must agree to 1e-9."""
    tracker, gauges = (estimate(*prepare(each), **options) for each in (document, of_gauges))
    np.testing.assert_allclose(gauges.compliance, tracker.compliance, rtol=1e-9, atol=1e-15)
    assert_covariance(gauges.covariance, tracker.covariance, atol=1e-9)
    assert gauges.chi_square == pytest.approx(tracker.chi_square, rel=1e-9)
    assert gauges.degrees_of_freedom == pytest.approx(tracker.degrees_of_freedom)
    return gauges


@pytest.mark.parametrize("weighting", ["covariance", "uniform"])
@pytest.mark.parametrize("stiffness", ["neglected", "included"])
@pytest.mark.parametrize("frame", ["base", "flange"])
def test_three_gauges_at_right_angles_are_as_exact_as_a_target(weighting, stiffness, frame):
    document = campaign()
    rotation = ARM.posture(experiment_of(document).joints).flange_rotation if frame == "flange" else None
    of_gauges = by_gauges(document, 3.0 * triads(20), rotation)
    as_exact(document, of_gauges, weighting=weighting, complementary_stiffness=stiffness)


def test_one_gauge_reads_one_row_of_the_tracker():
    """Least squares of the gauges' rows alone, written out here with the simulator's kinematics."""
    document = campaign(configurations=30)
    directions = triads(30)[:, :1]
    robot, measurements = prepare(by_gauges(document, directions))
    found = estimate(robot, measurements, positive=False)
    experiment = experiment_of(document)
    posture = ARM.posture(experiment.joints)
    target = posture.point_to_base(np.broadcast_to([0.1, 0.05, 0.1], (30, 3)))
    torque = torques(ARM, experiment.joints, *experiment.wrenches)
    A = np.einsum("ni,nji->nj", directions[:, 0], posture.velocities(target)) * torque
    y = np.einsum("ni,ni->n", directions[:, 0], deflections_of(document))
    c, left, *_ = np.linalg.lstsq(A, y)
    np.testing.assert_allclose(found.compliance, c, rtol=1e-9)
    assert found.degrees_of_freedom == pytest.approx(30 - 6)
    assert found.chi_square == pytest.approx(left[0] / (2 * measurements.sigma**2), rel=1e-9)
    np.testing.assert_allclose(
        found.covariance, 2 * measurements.sigma**2 * np.linalg.inv(A.T @ A), rtol=1e-7
    )


@pytest.mark.parametrize("method", ["partial_pose", "complete_pose", "decoupled_partial_pose"])
def test_gauges_join_targets_in_every_method(method):
    """A target read by three gauges beside three targets of a tracker is a fourth target."""
    four = SPREAD | {"P3": (0.05, 0.02, 0.2)}
    document = campaign(targets=four)
    gauges = by_gauges(document, triads(20))
    mixed = [
        tracker | {"readings": tracker["readings"][:3] + gauge["readings"][9:]}
        for tracker, gauge in zip(
            document["measurement_set"]["observations"],
            gauges["measurement_set"]["observations"],
            strict=True,
        )
    ]
    places = gauges["measurement_set"]["flange_targets"] | four
    measured = document["measurement_set"] | {"observations": mixed, "flange_targets": places}
    as_exact(document, document | {"measurement_set": measured}, method=method)


def test_resampling_takes_the_same_rows():
    document = campaign()
    blocks = [
        gram_blocks(robot, measurements, settings_of(robot))
        for robot, measurements in (prepare(document), prepare(by_gauges(document, triads(20))))
    ]
    np.testing.assert_allclose(blocks[1].stages[0].gram, blocks[0].stages[0].gram, rtol=1e-9, atol=1e-12)


def test_what_gauges_do_not_support_is_refused():
    robot, measurements = prepare(by_gauges(campaign(targets=SPREAD), triads(20)))
    with pytest.raises(UnsupportedMethodError, match="3 targets"):
        estimate(robot, measurements, method="complete_pose")
    with pytest.raises(UnsupportedMethodError, match="one direction"):
        estimate(robot, measurements, loss="huber")


def test_a_stated_motion_across_the_direction_is_not_kept():
    _, measurements = prepare(by_gauges(campaign(targets=SPREAD), triads(20)))
    along = measurements.shown(measurements.deflection)
    np.testing.assert_allclose(measurements.deflection, along, atol=1e-18)
    moved = replace(measurements, deflection=np.ones_like(measurements.deflection))
    across = moved.deflection - moved.direction * (moved.direction * moved.deflection).sum(-1, keepdims=True)
    np.testing.assert_allclose(across, 0.0, atol=1e-15)
