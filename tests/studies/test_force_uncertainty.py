"""Uncertainty of the force, against springs that balance the true load while the campaign states another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom
from support.campaigns import estimate

from benchmarks.campaigns import default_robot
from benchmarks.designs import SIGMA, planned_design
from benchmarks.force import force_campaigns
from benchmarks.verdicts import Way, judge
from jointstiff.simulator import TARGETS, default_arm, linear_deflections, torques
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.fitting import Likelihood
from jointstiff.solver.readings import EncoderReadings, ForceUncertainty

pytestmark = pytest.mark.slow  # the studies of benchmarks/, each night

ARM = default_arm()
DESIGN = planned_design(ARM, seed=0)
ROBOT = default_robot(ARM)
BOTH = ForceUncertainty(scale=0.02, direction=3e-3)
PRIOR = {"joint_2": {"stiffness": 3.1e6, "standard_uncertainty": 2e5}}
WAYS = {
    "partial pose": {},
    "complete pose": {"method": "complete_pose"},
    "characteristic length": {"method": "complete_pose", "weighting": "characteristic_length"},
    "decoupled": {"method": "decoupled_partial_pose"},
    "uniform": {"weighting": "uniform"},
    "prior": {"priors": PRIOR},
}


def measured(error, *, encoders: bool = False):
    """The campaign with noiseless linear springs under a wrench that is off by (ε, φ)."""
    plan = DESIGN.experiment
    true = [(1 + error[0]) * w + np.cross(error[1:], w) for w in (plan.forces, plan.moments)]
    points = np.array(list(TARGETS.values()))
    moved = linear_deflections(ARM, plan.joints, *true, plan.load_points, points)
    found = replace(DESIGN.measurements(DESIGN.unloaded, DESIGN.loaded, sigma=SIGMA), deflection=moved)
    if not encoders:
        return found
    bent = ARM.compliances * torques(ARM, plan.joints, *true, plan.load_points)
    return replace(found, encoders=EncoderReadings(bent, np.ones(bent.shape, dtype=np.bool_), 5e-6))


@pytest.mark.parametrize("options", WAYS.values(), ids=WAYS)
@pytest.mark.parametrize("encoders", [False, True])
def test_each_error_moves_the_estimate_as_stated(options, encoders):
    """Column k of `common` is what an error of one standard uncertainty does, by repeating the campaign."""
    if encoders and options.get("weighting"):
        pytest.skip("encoders are weighed by covariance only")
    right = replace(measured(np.zeros(4), encoders=encoders), force_uncertainty=BOTH)
    found = estimate(ROBOT, right, positive=False, **options)
    for k, error in enumerate(np.diag(BOTH.standard_uncertainties)):
        off = estimate(ROBOT, measured(error, encoders=encoders), positive=False, **options)
        difference = off.compliance - found.compliance
        np.testing.assert_allclose(
            found.common[:, k], difference, rtol=1e-6, atol=1e-6 * np.abs(difference).max()
        )


def test_the_scale_goes_one_to_one_into_every_joint():
    exact = measured(np.zeros(4))
    alone = estimate(ROBOT, exact)
    found = estimate(ROBOT, replace(exact, force_uncertainty=ForceUncertainty(scale=0.01)))
    np.testing.assert_array_equal(found.compliance, alone.compliance)
    for joint, before in zip(found.joints, alone.joints, strict=True):
        assert joint.budget.force_scale == pytest.approx(0.01 * joint.compliance, rel=1e-9)
        assert joint.budget.readings == pytest.approx(before.standard_uncertainty, rel=1e-6)
        assert joint.budget.force_direction == 0.0
        u = np.hypot(before.standard_uncertainty, 0.01 * joint.compliance)
        assert joint.standard_uncertainty == pytest.approx(u, rel=1e-9)
        half = np.ptp(joint.compliance_interval) / 2
        assert half == pytest.approx(1.959964 * u, rel=1e-6)
        assert before.budget is None
    correlated = found.covariance - alone.covariance
    np.testing.assert_allclose(correlated, 1e-4 * np.outer(found.compliance, found.compliance), rtol=1e-6)


def test_exact_readings_leave_the_force_alone():
    exact = replace(measured(np.zeros(4)), sigma=None, force_uncertainty=ForceUncertainty(scale=0.01))
    for joint in estimate(ROBOT, exact).joints:
        assert joint.standard_uncertainty == pytest.approx(0.01 * joint.compliance, rel=1e-3)


def test_what_is_not_told_apart_keeps_its_information():
    """Rows of rank 2 for 3 compliances: on their range the covariance grows by S Sᵀ; off it, nothing."""
    R = np.array([[2.0, 1.0, 0.0], [0.0, 1.0, 3.0]])
    S = np.array([[0.3], [0.1], [0.2]])
    likelihood = Likelihood(np.arange(3), np.zeros(3), np.linalg.pinv(R.T @ R), R).with_common(S)
    information = likelihood.rows.T @ likelihood.rows
    null = np.linalg.svd(R)[2][-1]
    assert np.abs(information @ null).max() < 1e-14
    expected = np.linalg.inv(np.eye(2) + R @ S @ S.T @ R.T)  # covariance of R c
    np.testing.assert_allclose(information, R.T @ expected @ R, rtol=1e-12, atol=1e-14)


def test_intervals_hold_the_truth_where_the_force_is_wrong():
    found = judge([Way("partial pose")], force_campaigns(2, 50, ForceUncertainty(scale=0.02, direction=5e-3)))
    covered = found[Way("partial pose")].covered
    least, greatest = binom.ppf([1e-4, 1 - 1e-4], len(covered), 0.95)
    assert (covered.sum(axis=0) >= least).all()
    assert (covered.sum(axis=0) <= greatest).all()


@pytest.mark.parametrize("wrong", [{"scale": -0.1}, {"direction": float("nan")}])
def test_no_standard_uncertainty(wrong):
    with pytest.raises(MeasurementError, match="zero or positive"):
        ForceUncertainty(**wrong)
