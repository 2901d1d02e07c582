"""Errors that all observations share, against springs whose true load and places are off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom
from support.campaigns import estimate
from support.springs import robot_of

from benchmarks.designs import SIGMA, planned_design
from benchmarks.studies.coverage import Way, judge
from jointstiff.simulator import TARGETS, default_arm, deflections, linear_deflections, torques
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.estimation.fit import Likelihood
from jointstiff.solver.mechanics.measurements import CommonUncertainty, EncoderReadings

pytestmark = pytest.mark.slow  # the studies of benchmarks/, each night

ARM = default_arm()
DESIGN = planned_design(ARM, seed=0)
ROBOT = robot_of(ARM)
ALL = CommonUncertainty(scale=0.02, direction=3e-3, load_point=2e-3, target_places=1e-3)
PRIOR = {"joint_2": {"stiffness": 3.1e6, "standard_uncertainty": 2e5}}
WAYS = {
    "partial pose": {},
    "complete pose": {"method": "complete_pose"},
    "characteristic length": {"method": "complete_pose", "weighting": "characteristic_length"},
    "decoupled": {"method": "decoupled_partial_pose"},
    "uniform": {"weighting": "uniform"},
    "prior": {"priors": PRIOR},
}


POINTS = np.array(list(TARGETS.values()))
ERRORS = 7 + POINTS.size
"""Scale, three angles, load point, and the coordinates of the targets, one after the other."""


def measured(error, *, encoders: bool = False):
    """The campaign with noiseless linear springs whose load and places are off by `error` (7 + 3 T)."""
    plan = DESIGN.experiment
    true = [(1 + error[0]) * w + np.cross(error[1:4], w) for w in (plan.forces, plan.moments)]
    load_points, points = plan.load_points + error[4:7], POINTS + error[7:].reshape(-1, 3)
    moved = linear_deflections(ARM, plan.joints, *true, load_points, points)
    found = stated(DESIGN, moved)
    if not encoders:
        return found
    bent = ARM.compliances * torques(ARM, plan.joints, *true, load_points)
    return replace(found, encoders=EncoderReadings(bent, np.ones(bent.shape, dtype=np.bool_), 5e-6))


@pytest.mark.parametrize("options", WAYS.values(), ids=WAYS)
@pytest.mark.parametrize("encoders", [False, True])
def test_each_error_moves_the_estimate_as_stated(options, encoders):
    """Column k of `common` is what an error of one standard uncertainty does, by repeating the campaign."""
    if encoders and options.get("weighting"):
        pytest.skip("encoders are weighed by covariance only")
    right = replace(measured(np.zeros(ERRORS), encoders=encoders), common_uncertainty=ALL)
    found = estimate(ROBOT, right, positive=False, **options)
    sizes = np.repeat([ALL.scale, ALL.direction, ALL.load_point, ALL.target_places], [1, 3, 3, POINTS.size])
    for k, error in enumerate(np.diag(sizes)):
        off = estimate(ROBOT, measured(error, encoders=encoders), positive=False, **options)
        back = estimate(ROBOT, measured(-error, encoders=encoders), positive=False, **options)
        difference = 0.5 * (off.compliance - back.compliance)
        np.testing.assert_allclose(
            found.common.responses[:, k], difference, rtol=1e-6, atol=1e-6 * np.abs(difference).max()
        )


def off_axis(step, turn):
    """Estimate from linear springs on an arm one of whose axes is off: (n, 3) steps and rotation vectors."""
    directions = ARM.axis_directions + np.cross(turn, ARM.axis_directions)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    arm = replace(ARM, axis_points=ARM.axis_points + step, axis_directions=directions)
    plan = DESIGN.experiment
    moved = linear_deflections(arm, plan.joints, *plan.wrenches, POINTS)
    found = replace(measured(np.zeros(ERRORS)), deflection=moved)
    return estimate(ROBOT, found, positive=False).compliance


def test_axes_that_are_off_move_the_estimate_as_stated():
    stated = CommonUncertainty(axis_position=1e-4, axis_direction=1e-4)
    right = replace(measured(np.zeros(ERRORS)), common_uncertainty=stated)
    found = estimate(ROBOT, right, positive=False).common
    assert {source for source, part in found.by_source.items() if part.size} == {"axes"}
    moved = []
    for j, axis in enumerate(ARM.axis_directions):
        for across in np.linalg.svd(axis[None])[2][1:]:
            error = np.zeros((6, 3))
            error[j] = 1e-4 * across
            moved.append(0.5 * (off_axis(error, 0 * error) - off_axis(-error, 0 * error)))
            moved.append(0.5 * (off_axis(0 * error, error) - off_axis(0 * error, -error)))
    moved = np.array(moved).T
    size = np.sqrt(np.diagonal(moved @ moved.T))
    assert (size > 1e-5 * ARM.compliances).all()
    np.testing.assert_allclose(
        found.responses @ found.responses.T,
        moved @ moved.T,
        rtol=1e-5,
        atol=1e-5 * size.min() ** 2,
    )


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


STREAM = 21


def wrong_campaigns(designs, draws, uncertainty):
    """Campaigns whose true load and places differ from what they state.

    Args:
        designs: how many.
        draws: campaigns of each.
        uncertainty: of the errors, drawn once a campaign.
    """
    for seed in range(designs):
        design = planned_design(default_arm(), seed=seed)
        generator = np.random.default_rng([seed, STREAM])
        for _ in range(draws):
            force, moment, load_points, points = drawn(design, uncertainty, generator)
            joints = design.experiment.joints
            exact = np.stack(deflections(design.arm, joints, force, moment, load_points, points))
            unloaded, loaded = exact + SIGMA * generator.standard_normal(exact.shape)
            yield design, replace(stated(design, loaded - unloaded), common_uncertainty=uncertainty)


def drawn(design, uncertainty, generator):
    """Draw true forces, moments and load points (N, 3), and targets (T, 3)."""
    plan = design.experiment
    scale, *turn = generator.standard_normal(4)
    rotation = Rotation.from_rotvec(uncertainty.direction * np.array(turn)).as_matrix()
    force, moment = (
        (1.0 + uncertainty.scale * scale) * wrench @ rotation.T for wrench in (plan.forces, plan.moments)
    )
    load_points = plan.load_points + uncertainty.load_point * generator.standard_normal(3)
    points = POINTS + uncertainty.target_places * generator.standard_normal(POINTS.shape)
    return force, moment, load_points, points


def stated(design, deflection):
    """Return deflections (N, T, 3) of targets whose places in the flange frame are stated."""
    plain = design.measurements(np.zeros_like(deflection), deflection, sigma=SIGMA)
    position = np.broadcast_to(POINTS, deflection.shape).copy()
    return replace(plain, position=position, in_flange=plain.present)


def test_intervals_hold_the_truth_where_load_and_places_are_off():
    found = judge([Way("partial pose")], wrong_campaigns(2, 50, ALL))
    covered = found[Way("partial pose")].covered
    least, greatest = binom.ppf([1e-4, 1 - 1e-4], len(covered), 0.95)
    assert (covered.sum(axis=0) >= least).all()
    assert (covered.sum(axis=0) <= greatest).all()


@pytest.mark.parametrize("wrong", [{"scale": -0.1}, {"direction": float("nan")}, {"load_point": -1.0}])
def test_no_standard_uncertainty(wrong):
    with pytest.raises(MeasurementError, match="zero or positive"):
        CommonUncertainty(**wrong)
