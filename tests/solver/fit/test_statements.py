"""Statements about load and places join the fit: as generalised least squares, and in the budget."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.springs import SIGMA, SpringCampaign, robot_of

from jointstiff.schemas.options import Resampling, RunOptions
from jointstiff.simulator import default_arm
from jointstiff.solver.fit.estimate import UncertaintyBudget
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import CommonUncertainty
from jointstiff.solver.mechanics.springs import JOINTS
from jointstiff.solver.mechanics.terms import TERMS
from jointstiff.solver.run import run

ARM = default_arm()
ROBOT = robot_of(ARM)
NEGLECTED = Settings.from_options(RunOptions(complementary_stiffness="neglected"), ROBOT)
ASSUMED = CommonUncertainty(load_point=0.01, scale=0.01, assumed=frozenset({"load_point", "force_scale"}))


def hung(offset, *, seed=0, common=ASSUMED, sigma=SIGMA):
    """Readings of a load that hangs off its stated place (3,) [m]."""
    stated = SpringCampaign.of(ARM, configurations=24, seed=seed)
    plan = replace(stated.experiment, load_points=stated.experiment.load_points + np.asarray(offset))
    (read,) = SpringCampaign.by(ARM, plan).measured(1, seed=seed, sigma=SIGMA)
    return replace(read, load_point=stated.experiment.load_points, common_uncertainty=common, sigma=sigma)


@pytest.mark.parametrize(
    "common",
    [
        CommonUncertainty(load_point=0.01),
        CommonUncertainty(load_point=2e-3, direction=3e-3, target_places=1e-3),
        CommonUncertainty(axis_position=1e-3),
        CommonUncertainty(drift=3e-6),
        CommonUncertainty(rope_zero=35.0, load_point=1e-3),
    ],
)
def test_a_fit_with_statements_is_generalised_least_squares(common):
    """The errors of a statement have the covariance B S Bᵀ over the whole campaign."""
    measurements = hung([4e-3, -6e-3, 2e-3], common=common)
    found = identify(Rows(ROBOT, measurements), NEGLECTED)
    terms = [term for term in TERMS.values() if any(term.prior(common))]
    (rows,) = Rows(ROBOT, measurements).generate([JOINTS, *terms], found.compliance)
    flat = rows.targets.reshape(-1, rows.targets.shape[-1])
    A, B, d = flat[:, : ROBOT.n], flat[:, ROBOT.n : -1], flat[:, -1]
    stated = np.concatenate([np.resize(term.prior(common), rows.widths[term.name]) for term in terms])
    V = SIGMA**2 * np.eye(len(d)) + (B * stated**2) @ B.T
    N = A.T @ np.linalg.solve(V, A)
    # The columns of a statement depend on the compliances, so that the fit ends within 1e-4 uncertainties.
    expected, covariance = np.linalg.solve(N, A.T @ np.linalg.solve(V, d)), np.linalg.inv(N)
    u = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found.compliance / u, expected / u, atol=2e-4)
    first_order = found.covariance - found.square_second_order()  # the rest is that of a short lever
    np.testing.assert_allclose(first_order / np.outer(u, u), covariance / np.outer(u, u), atol=1e-4)


@pytest.mark.parametrize("axis", range(3))
def test_a_turn_of_all_loads_turns_forces_and_moments_as_the_springs_say(axis):
    """The columns are the difference between balances of springs under turned wrenches."""
    generator, angle = np.random.default_rng(6), 1e-3
    plan = SpringCampaign.of(ARM, configurations=6, force=100.0).experiment
    moments = 100.0 * generator.standard_normal(plan.forces.shape)

    def springs(turn):
        R = Rotation.from_rotvec(turn * np.eye(3)[axis]).as_matrix()
        return SpringCampaign.by(ARM, replace(plan, forces=plan.forces @ R.T, moments=moments @ R.T))

    (read,) = springs(0.0).measured(1, seed=0)
    moved = (springs(angle).loaded - springs(-angle).loaded) / (2.0 * angle)
    columns = TERMS["force_direction"].motion(Rows(ROBOT, read).block, ARM.compliances).targets
    np.testing.assert_allclose(columns[..., axis], moved, atol=2e-3 * np.abs(moved).max())


def test_the_parts_of_a_budget_add_up_and_none_is_negative():
    found = identify(Rows(ROBOT, hung([5e-3, 5e-3, 5e-3])), Settings.from_options(RunOptions(), ROBOT))
    budget = UncertaintyBudget.from_estimate(found, 0.95)
    by_source = {part.source: np.diag(part.covariance) for part in budget.components}
    assert set(by_source) == {"readings", "assumed_load_point", "assumed_force_scale"}
    assert min(each.min() for each in by_source.values()) > 0.0
    np.testing.assert_allclose(sum(by_source.values()), np.diag(found.covariance), rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(by_source["assumed_force_scale"]), 0.01 * found.compliance, rtol=0.02)


def test_a_stated_drift_is_corrected_whatever_rows_are_left_out():
    """Loaded positions of springs move by 6 µm from one observation to the next, 140 µm in all."""
    common = CommonUncertainty(drift=5e-6)
    measurements = hung([0.0, 0.0, 0.0], common=common)
    drift = measurements.order[:, None, None] * np.array([3.6e-6, 0.0, -4.8e-6])
    drifted = replace(measurements, deflection=measurements.deflection + drift)
    rows = np.array([0, 1, *range(5, 24)])
    for part, moved in ((measurements, drifted), (measurements[rows], drifted[rows])):
        still = identify(Rows(ROBOT, part), NEGLECTED)
        found = identify(Rows(ROBOT, moved), NEGLECTED)
        u = np.sqrt(np.diag(still.covariance))
        assert np.abs((found.compliance - still.compliance) / u).max() < 0.5
        exact = identify(Rows(ROBOT, replace(moved, common_uncertainty=CommonUncertainty())), NEGLECTED)
        assert np.abs((exact.compliance - still.compliance) / u).max() > 1.0
        assert (u < 1.1 * np.sqrt(np.diag(exact.covariance))).all()


def test_a_load_point_as_far_off_as_is_assumed_is_no_mistake_and_is_corrected():
    for seed in range(5):
        offset = 0.01 * np.random.default_rng(seed).choice([-1.0, 1.0], 3)
        for sigma in (SIGMA, None):
            result = run(ROBOT, hung(offset, seed=seed, sigma=sigma), RunOptions())
            assert result.assessment.verdict == "use"
            for joint, truth in zip(result.joints, ARM.compliances, strict=True):
                assert abs(joint.compliance - truth) < 4.0 * joint.standard_uncertainty


@pytest.mark.parametrize("stated", [CommonUncertainty(load_point=1e-3, scale=0.01), ASSUMED])
def test_a_statement_that_the_readings_refute_is_named(stated):
    """80 mm: far beyond what is stated or assumed."""
    result = run(ROBOT, hung([0.08, 0.0, 0.0], common=stated), RunOptions())
    (reason,) = [one for one in result.assessment.reasons if one.code == "alternative_explains_better"]
    assert "load point" in reason.message
    assert result.assessment.verdict == "do_not_use"


def test_joint_6_is_known_better_by_the_readings_than_by_the_assumption():
    free = identify(Rows(ROBOT, hung(np.zeros(3))), NEGLECTED)
    exact = identify(Rows(ROBOT, hung(np.zeros(3), common=CommonUncertainty())), NEGLECTED)
    assumed_alone = free.common.responses_to("assumed_load_point")[5]
    assert np.linalg.norm(assumed_alone) < np.sqrt(free.covariance[5, 5])
    assert free.covariance[5, 5] < 4.0 * exact.covariance[5, 5]


def test_residuals_are_those_of_the_fit_with_the_load_point_that_it_found():
    """χ² of the three coordinates of each reading is that of the residuals that a user sees."""
    measurements = hung([0.01, -0.01, 0.01])
    result = run(ROBOT, measurements, RunOptions())
    squares = sum(np.square(each.residual).sum() for each in result.residuals) / (2.0 * SIGMA**2)
    statements = identify(Rows(ROBOT, measurements), NEGLECTED).statements
    stated = np.square(statements.unknowns).sum()
    assert squares + stated == pytest.approx(result.goodness.chi_square, rel=1e-3)


@pytest.mark.parametrize("method", ["partial_pose", "complete_pose"])
def test_resampled_fits_scatter_about_the_estimate_of_the_run(method):
    measurements = hung([0.01, -0.01, 0.01])
    resampling = Resampling(size=12, repetitions=400, replacement=False)
    result = run(ROBOT, measurements, RunOptions(method=method, resampling=resampling))
    for joint, drawn in zip(result.joints, result.resampling.joints, strict=True):
        least, most = drawn.compliance_interval
        assert least < joint.compliance < most
        assert abs(drawn.compliance_mean - joint.compliance) < drawn.compliance_deviation
