"""Causes: several at once, springs that are not linear, and what the readings of a set can show."""

from dataclasses import replace

import numpy as np
from support.campaigns import estimate
from support.springs import SIGMA, SpringCampaign, robot_of

from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import plan_experiment
from jointstiff.solver.estimation.causes import screen_estimate
from jointstiff.solver.estimation.fitted_causes import fit_causes
from jointstiff.solver.estimation.suspects import group_distinct_loads
from jointstiff.solver.mechanics.block import fitted_errors

ARM = default_arm()
ROBOT = robot_of(ARM)


def pulls(seed, configurations=24, sigma=SIGMA):
    """Return readings of pulls of 1500 N in all directions."""
    return next(SpringCampaign.of(ARM, configurations=configurations, seed=seed).measured(1, seed=seed))


def screened(measurements):
    found = estimate(ROBOT, measurements, complementary_stiffness="included")
    return screen_estimate(ROBOT, measurements, found)


def named(screening):
    return [(cause.suspect.name, cause.suspect.first) for cause in screening.causes]


def test_errors_that_targets_share_widen_what_is_claimed_of_a_cause():
    """Under a station of 60 µm three targets of a posture are one reading: a shift is known to 60 µm / √N."""
    claimed = []
    for station in (0.0, 6e-5):
        measurements = pulls(1, configurations=40)
        errors = station * np.random.default_rng(2).standard_normal((40, 1, 3))
        moved = measurements.deflection + errors
        fitted = fitted_errors(fit_causes(ROBOT, replace(measurements, deflection=moved), [("shift", None)]))
        claimed.append(np.linalg.norm(fitted.root, axis=1))
    independent = SIGMA * np.sqrt(2.0 / 120.0)
    shared = np.hypot(6e-5 / np.sqrt(40.0), independent)
    # The joints take a part of what the readings know of the shift.
    assert (claimed[0] > independent).all()
    assert (claimed[0] < 1.5 * independent).all()
    assert (claimed[1] > 0.8 * shared).all()
    assert (claimed[1] < 1.8 * shared).all()


def test_a_fitted_force_makes_no_distinct_loads():
    """Pulls along +x and -x are one load, even if a constant force along x makes them differ by a fifth."""
    plan = plan_experiment(ARM, configurations=30, load="pull", force=1500.0, seed=3)
    forces = 1500.0 * np.outer(np.where(np.arange(30) % 2, 1.0, -1.0), [1.0, 0.0, 0.0])
    campaign = SpringCampaign.by(ARM, replace(plan, forces=forces))
    (measurements,) = campaign.measured(1, seed=3)
    wrong = replace(measurements, force=forces - np.array([150.0, 0.0, 0.0]))
    assert group_distinct_loads(measurements) == (measurements.labels,)
    fitted = [("constant_force", None)]
    mended = fit_causes(ROBOT, measurements, fitted)
    assert group_distinct_loads(mended) == (measurements.labels,)
    # What is advised after the fit can be fitted, too.
    two = group_distinct_loads(wrong)
    assert [len(group) for group in two] == [15, 15]
    assert group_distinct_loads(fit_causes(ROBOT, wrong, fitted)) == two
