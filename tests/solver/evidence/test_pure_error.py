"""Coordinates that no motion of the flange touches show the tracker's noise, whatever the model."""

from dataclasses import replace

import numpy as np
import pytest
from support.springs import SIGMA, SpringCampaign, robot_of

from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.solver.evidence.pure_error import compute_pure_error
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.block import get_whole_block
from jointstiff.solver.run import run

ARM = default_arm()
ROBOT = robot_of(ARM)


def read(*, seed=0, sigma=None, factor=None, configurations=24):
    """Readings with noise; `factor` (N,) is the part of the stated load that hung on the arm."""
    campaign = SpringCampaign.of(ARM, configurations=configurations, seed=seed)
    (found,) = campaign.measured(1, seed=seed, sigma=SIGMA)
    if factor is not None:
        found = replace(found, force=found.force / factor[:, None])
    return replace(found, sigma=sigma)


def test_noise_is_found_without_any_model():
    """Over 40 campaigns: the whole deflection, centimetres of motion, counts as nothing but motion."""
    found = []
    for seed in range(40):
        measurements = read(seed=seed)
        pure = compute_pure_error(Rows(ROBOT, measurements), measurements.deflection, 0.0)
        found.append(pure.sigma)
        assert pure.shows_motion
    # The standard error of a root mean square over 40 · 24 · 3 coordinates is 1.3 %.
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(SIGMA, rel=0.05)


def test_a_motion_of_the_flange_is_no_noise():
    measurements = read()
    block = get_whole_block(ROBOT, measurements)
    turns = 1e-4 * np.random.default_rng(0).standard_normal((len(block.torque), ROBOT.n))
    moved = np.einsum("btij,bj->bti", block.jacobian, turns)
    pure = compute_pure_error(Rows(ROBOT, measurements), moved, 6.0)
    assert pure.sigma < 1e-7 < 1e-6 < pure.left


def test_one_load_that_is_wrong_leaves_more_than_noise():
    factor = np.ones(24)
    factor[7] = 1.2
    result = run(ROBOT, read(factor=factor), RunOptions())
    wrong, reason = result.assessment.reasons
    assert (wrong.code, wrong.action.observations) == ("residual_outlier", ["8"])
    assert (reason.code, result.assessment.verdict) == ("sigma_implausible", "use_with_care")
    assert "that the tracker reads to within 18.6 µm" in reason.message


def test_an_instrument_that_reads_coarsely_is_no_lack_of_the_model():
    """0.2 mm, as photogrammetry reads: far above a laser tracker, and yet the noise of the readings."""
    campaign = SpringCampaign.of(ARM, configurations=40, seed=3)
    (found,) = campaign.measured(1, seed=3, sigma=2e-4)
    result = run(ROBOT, replace(found, sigma=None), RunOptions())
    assert result.sigma == pytest.approx(2e-4, rel=0.15)
    assert not any(reason.code == "sigma_implausible" for reason in result.assessment.reasons)


def test_two_targets_do_not_show_noise_apart_from_motion():
    measurements = read()
    present = measurements.present.copy()
    present[:, 2] = False
    two = replace(measurements, present=present)
    assert compute_pure_error(Rows(ROBOT, two), two.deflection, 0.0) is None
