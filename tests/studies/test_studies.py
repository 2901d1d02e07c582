"""The studies of benchmarks/, each night: coverage, common uncertainty, own weight, links.

Shares are judged by the binomial distribution: a sound one fails one of these tests in some 10,000 seeds.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation
from scipy.stats import binom, norm
from support.campaigns import estimate, prepare
from support.shared_data import shared
from support.springs import robot_of

from benchmarks.designs import SIGMA, planned_design
from benchmarks.studies.coverage import Way, interior_campaigns, judge, run
from benchmarks.studies.links_fanuc import held_out_compensation
from benchmarks.studies.own_weight import BOTH, KNOWN, WITHIN, WRONG, estimates, harmful, summary
from jointstiff.simulator import TARGETS, default_arm, deflections, linear_deflections, torques
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.fit.cone import Block, WithMasses
from jointstiff.solver.fit.problem import LeastSquares, Problem
from jointstiff.solver.fit.solution import GAP, solve
from jointstiff.solver.fit.stages import Likelihood
from jointstiff.solver.mechanics.measurements import CommonUncertainty, EncoderReadings
from jointstiff.solver.models import JOINTS, LINKS_AND_BASE

pytestmark = pytest.mark.slow  # the studies of benchmarks/, each night

ARM = default_arm()
DESIGN = planned_design(ARM, seed=0)
ROBOT = robot_of(ARM)
ALL = CommonUncertainty(scale=0.02, direction=3e-3, load_point=2e-3, target_places=1e-3)
WAYS = {
    "partial pose": {},
    "complete pose": {"method": "complete_pose"},
    "characteristic length": {"method": "complete_pose", "weighting": "characteristic_length"},
    "decoupled": {"method": "decoupled_partial_pose"},
    "uniform": {"weighting": "uniform"},
    "prior": {"priors": {"joint_2": {"stiffness": 3.1e6, "standard_uncertainty": 2e5}}},
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
    likelihood = Likelihood(np.arange(3), np.zeros(3), np.linalg.pinv(R.T @ R), R).add_common_errors(S)
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


DESIGNS, DRAWS = 2, 50
RISK = 1e-4
DIFFERENT = ("partial pose", "decoupled")


def test_the_bound_is_that_of_the_linear_model():
    """`cramer_rao`, from differences of the exact simulator, beside the formula of method.md §2."""
    design = planned_design(default_arm(), seed=0)
    arm, plan = design.arm, design.experiment
    posture = arm.posture(plan.joints)
    places = posture.targets_to_base(np.array(list(TARGETS.values())))
    levers = places[:, :, None] - posture.axis_points[:, None]
    velocities = np.cross(posture.axis_directions[:, None], levers)
    J = (velocities * torques(arm, plan.joints, *plan.wrenches)[:, None, :, None]).transpose(0, 1, 3, 2)
    J = J.reshape(-1, 6) * arm.compliances
    expected = 2.0 * SIGMA**2 * np.linalg.inv(J.T @ J) * np.outer(arm.compliances, arm.compliances)
    np.testing.assert_allclose(np.diag(design.cramer_rao()), np.diag(expected), rtol=0.02)


def test_noise_is_what_it_says():
    design = planned_design(default_arm(), seed=0)
    exact = design.loaded - design.unloaded
    errors = np.array([m.deflection - exact for m in design.measured(200, seed=1)])
    assert abs(errors.std() / (np.sqrt(2.0) * SIGMA) - 1.0) < 0.02
    assert abs(errors.mean()) < 4 * errors.std() / np.sqrt(errors.size)


def test_spread_is_the_least_there_is_and_as_reported():
    """Empirical deviations beside the Cramér-Rao bound and the reported ones, pooled over designs."""
    interior = judge([Way(method) for method in DIFFERENT], interior_campaigns(DESIGNS, DRAWS))
    plans = [planned_design(default_arm(), seed=seed) for seed in range(DESIGNS)]
    bounds = np.sqrt([np.diag(plan.cramer_rao()) for plan in plans])[:, None]
    tolerance = norm.ppf(1 - RISK / 2) / np.sqrt(2 * DESIGNS * (DRAWS - 1))
    over_bound = {}
    for method in DIFFERENT:
        found = interior[Way(method)]
        errors = (found.compliance - found.truth).reshape(DESIGNS, DRAWS, -1) / bounds
        reported = found.standard_uncertainty.reshape(DESIGNS, DRAWS, -1) / bounds
        variance = errors.var(axis=1, ddof=1).mean(axis=0)
        over_bound[method] = np.sqrt(variance)
        np.testing.assert_allclose(np.square(reported).mean(axis=(0, 1)) / variance, 1.0, atol=2 * tolerance)
    np.testing.assert_allclose(over_bound["partial pose"], 1.0, atol=tolerance)
    assert max(over_bound["decoupled"]) > 1.3  # what decoupling costs where there is only noise


class TestFull:
    """The figures of issue 4, as `python -m benchmarks` prints them."""

    @pytest.mark.timeout(1800)
    def test_figures_are_met(self):
        sections = run(quick=False)
        assert all(len(row) == len(section.columns) for section in sections for row in section.rows)
        figures = [figure for section in sections for figure in section.figures]
        assert [figure for figure in figures if not figure.met and not self.chance(figure)] == []

    @staticmethod
    def chance(figure):
        """What holds in 95 % exactly falls short of it in half of all studies; 600 campaigns a joint."""
        nominal = "least of the rigid" in figure.what
        return nominal and figure.measured >= 100 * binom.ppf(RISK, 600, 0.95) / 600


CAMPAIGNS = 30


def test_intervals_with_exact_masses_hold_the_truth_as_often_as_they_say():
    covered, _, gap = summary(estimates(KNOWN, range(CAMPAIGNS)))
    assert (np.round(covered * CAMPAIGNS) >= binom.ppf(1e-4, CAMPAIGNS, 0.95)).all()
    assert gap <= 1e-8


def test_uncertain_masses_leave_intervals_that_a_payload_narrows():
    covered, width, _ = summary(estimates(WITHIN, range(10)))
    assert (covered[:2] >= 0.9).all()
    assert width[0] <= 0.2
    assert (summary(estimates(BOTH, range(5)))[1] <= 0.5 * width).all()


def test_wrong_masses_and_geometry_harm_nobody_unsaid():
    assert not any(harmful(each) for each in estimates(WRONG, range(5)))


def false_certificates(seeds):
    """Count certified optima that exceed the true one, and return the greatest gap.

    A block of c and ζ in a box is the cone of the box's corners, so that the true optimum is a least
    squares problem with zero or positive shares of corners, which Lawson and Hanson solve without Clarabel.
    """
    false, gaps = 0, []
    for seed in seeds:
        draws = np.random.default_rng([seed, 43])
        boxes = draws.integers(1, 4, draws.integers(1, 5))
        cones = WithMasses(tuple(Block(int(count)) for count in boxes), np.full(len(boxes), 100.0))
        corners = [
            np.insert(np.array(list(product((-1.0, 1.0), repeat=count))), 0, 1.0, axis=1).T
            for count in boxes.tolist()
        ]
        size = sum(block.size for block in cones.blocks)
        A = draws.standard_normal((size, size)) * 10.0 ** draws.uniform(-2.0, 0.0, size)
        A[:, cones.first] /= np.linalg.norm(A[:, cones.first], axis=0)  # as the fit scales them
        b = draws.standard_normal(size)
        problem = Problem(LeastSquares(A, b), cones)
        found = solve(problem)
        truth = nnls(A @ block_diag(*corners), b)[1] ** 2
        gaps.append(found.certificate.gap)
        false += bool(problem.squares.loss(found.x) > truth + GAP * float(b @ b))
    return false, max(gaps)


def test_no_certificate_is_false():
    false, gap = false_certificates(range(100))
    assert false == 0
    assert gap <= 1e-8


@pytest.mark.parametrize("splits", [1, pytest.param(20, marks=pytest.mark.slow)])
def test_fanuc_held_out_compensation_gains_from_links(splits):
    """The weight is chosen within the fitted part."""
    robot, measurements = prepare(shared("fanuc_r2000ic/campaign"))
    gains = []
    for seed in range(splits):
        drawn = np.random.default_rng(seed).permutation(len(measurements))
        parts = measurements[np.sort(drawn[:20])], measurements[np.sort(drawn[20:])]
        models = (JOINTS, LINKS_AND_BASE)
        both = [held_out_compensation(robot, *parts, model.name, seed=seed) for model in models]
        gains.append(both[1] - both[0])
    assert np.mean(gains) > 0.04
