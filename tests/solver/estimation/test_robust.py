"""The Huber loss against Clarabel's cone programs, problems solved by hand, and gross errors that we made."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.optima import huber_by_clarabel, huber_objective
from scipy import stats
from support.campaigns import (
    ARM,
    METHODS_AND_WEIGHTS,
    SIGMA,
    estimate,
    first_target,
    held,
    simulated,
    spring_columns,
    wrench_of,
)
from support.examples import examples
from support.springs import readings_of

from jointstiff.simulator.equilibrium import torques
from jointstiff.solver.errors import SolverError, UnsupportedMethodError
from jointstiff.solver.estimation import fit as robust
from jointstiff.solver.mechanics.measurements import EncoderReadings
from jointstiff.solver.mechanics.robot import ChainJoint, JointMap, KinematicChain, Robot


@pytest.fixture(scope="module")
def pulls():
    """Deflections of the linear model, exactly: what is estimated from them has no bias of its own."""
    robot, measurements = simulated(load="pull", configurations=15, sigma=0.0, seed=6)
    deflection = spring_columns(measurements) @ ARM.compliances
    return robot, replace(measurements, deflection=deflection, sigma=SIGMA)


@pytest.fixture(scope="module")
def bad(pulls):
    """The same with noise, a tenth of the readings 20 sigma off."""
    robot, exact = pulls
    return robot, spoilt(noisy(exact, 2), 2)[0]


def noisy(measurements, seed):
    noise = np.random.default_rng([seed, 1]).standard_normal(measurements.deflection.shape)
    return replace(measurements, deflection=measurements.deflection + SIGMA * np.sqrt(2.0) * noise)


def spoilt(measurements, seed, *, share=0.1, size=20.0):
    """Add errors of so many sigma, in directions of their own, to a share of the readings."""
    rng = np.random.default_rng([seed, 2])
    count, targets = measurements.present.shape
    bad = rng.permutation(count * targets)[: round(share * count * targets)]
    directions = rng.standard_normal((len(bad), 3))
    directions *= size * np.sqrt(2.0) * SIGMA / np.linalg.norm(directions, axis=1, keepdims=True)
    deflection = measurements.deflection.copy()
    deflection.reshape(-1, 3)[bad] += directions
    places = {divmod(int(i), targets) for i in bad}
    return replace(measurements, deflection=deflection), places


def rows_of(robot, measurements):
    """(K, 3, n) and (K, 3) whitened rows, by the simulator: a column is the deflection by one soft joint."""
    A = spring_columns(measurements)[measurements.present]
    return A / np.sqrt(2.0), measurements.deflection[measurements.present] / np.sqrt(2.0)


class TestAgainstConePrograms:
    @pytest.mark.parametrize(("seed", "threshold"), [(0, 0.3), (1, 2.8), (2, 10.0)])
    def test_partial_pose_is_the_huber_estimate(self, pulls, threshold, seed):
        robot, measurements = pulls
        measurements, _ = spoilt(noisy(measurements, seed), seed)
        found = estimate(robot, measurements, loss="huber", huber_threshold=threshold)
        A, d = rows_of(robot, measurements)
        expected, value = huber_by_clarabel(A, d, threshold)
        uncertainty = np.sqrt(np.diag(found.covariance))
        np.testing.assert_allclose((found.compliance - expected) / uncertainty, 0.0, atol=2e-4)
        # To the objective, which it is sharper in, ours is no worse than the cone program's.
        assert huber_objective(A, d, found.compliance, threshold) <= value * (1 + 1e-9)

    @pytest.mark.parametrize(
        ("options", "program", "at_bound"),
        [
            (
                {"stiffness_bounds": {"joint_2": (3.3e6, None), "joint_5": (None, 0.2e6)}},
                {"limits": lambda c: [c[1] <= 1 / 3.3, c[4] >= 1 / 0.2]},
                [1, 4],
            ),
            ({"stiffness_order": [["joint_6", "joint_5"]]}, {"limits": lambda c: [c[5] <= c[4]]}, [4, 5]),
            (
                {"priors": {"joint_4": {"stiffness": 1e6 / 3.0, "standard_uncertainty": 1e5 / 9.0}}},
                {"extra": lambda c: cp.square((c[3] - 3.0) / 0.1) / 2},
                [],
            ),
        ],
    )
    def test_with_what_is_known_of_the_joints(self, bad, options, program, at_bound):
        found = estimate(*bad, loss="huber", **options)
        expected, _ = huber_by_clarabel(*rows_of(*bad), 2.8, **program)
        np.testing.assert_allclose(found.compliance, expected, rtol=1e-4)
        assert [j for j in range(6) if found.joints[j].status == "at_bound"] == at_bound
        assert (found.compliance[4] == found.compliance[5]) == ("stiffness_order" in options)

    def test_encoders_keep_the_squared_loss(self, bad):
        robot, measurements = bad
        torque = torques(ARM, measurements.joints, *wrench_of(measurements))
        deflection = 1.01 * ARM.compliances * torque + np.random.default_rng(0).normal(0.0, 1e-5, (15, 6))
        present = np.zeros((15, 6), dtype=bool)
        present[:, 1] = True
        encoders = EncoderReadings(np.where(present, deflection, 0.0), present, 5e-6)
        found = estimate(robot, replace(measurements, encoders=encoders), loss="huber")

        def squared(c):
            residual = (deflection[:, 1] - torque[:, 1] * c[1] * 1e-6) / (np.sqrt(2.0) * 5e-6)
            return cp.sum_squares(residual) / 2

        expected, _ = huber_by_clarabel(*rows_of(*bad), 2.8, extra=squared)
        np.testing.assert_allclose(found.compliance, expected, rtol=1e-4)


def one_joint(deflections, sigma=1e-5):
    """A joint about z that 1000 N·m twist, and a target 1 m away that moves along y [m]."""
    z = np.array([0.0, 0.0, 1.0])
    joint = ChainJoint("joint_1", "revolute", np.eye(3), np.zeros(3), z, None, "flange")
    robot = Robot(KinematicChain("one", "base", "flange", (joint,)), JointMap.identity(1))
    count = len(deflections)
    moved = np.zeros((count, 1, 3))
    moved[:, 0, 1] = deflections
    tip = [1.0, 0.0, 0.0]
    everywhere = np.ones((count, 1), dtype=bool)
    loads = (np.zeros((count, 1)), [0.0, 1000.0, 0.0], tip, tip)
    return robot, readings_of(*loads, moved, in_flange=everywhere, sigma=sigma)


class TestByHand:
    """One joint: the deflection of the target is 1000 c, and k = threshold √2 sigma is a length."""

    @pytest.mark.parametrize(
        ("readings", "expected"),
        [
            ([1.0, 1.0, 1.0, 21.0], 1.0 + 1 / 3),  # 3 (x - 1) = k
            ([1.0, 1.0, 1.0, 21.0, 31.0], 1.0 + 2 / 3),  # 3 (x - 1) = 2 k
            ([-20.0, 1.0, 2.0, 40.0], 1.5),  # the outliers cancel
            ([1.0, 1.5, 2.0], 1.5),  # all within: the mean
            ([-50.0, 3.0, 100.0], 3.0),  # the median
        ],
    )
    def test_conditions_solved_on_paper(self, readings, expected):
        k = 2.0 * np.sqrt(2.0) * 1e-5
        robot, measurements = one_joint([k * reading for reading in readings])
        found = estimate(robot, measurements, loss="huber", huber_threshold=2.0, positive=False)
        assert 1000.0 * found.compliance[0] / k == pytest.approx(expected, rel=1e-12)

    def test_weights_are_threshold_over_norm(self):
        k = 2.0 * np.sqrt(2.0) * 1e-5
        robot, measurements = one_joint([k, k, k, 21.0 * k])
        found = estimate(robot, measurements, loss="huber", huber_threshold=2.0, positive=False)
        far = 21.0 - 4.0 / 3.0
        np.testing.assert_allclose(found.robust.weight[:, 0], [1, 1, 1, 1 / far], rtol=1e-12)
        np.testing.assert_allclose(found.robust.residual_norm[3, 0], 2.0 * far, rtol=1e-12)
        assert found.robust.suspicious.tolist() == [[3, 0]]
        # Huber's a / b² beside weighted least squares: mean of 3 w² t² / 3 over its slope, squared.
        norm = stats.chi(3)
        good = norm.expect(lambda x: x**2, ub=2.0) / norm.cdf(2.0) / 3.0
        a, b = (3 * good + 2.0**2 / 3.0) / 4.0, (3.0 + 2.0 / 3.0 / far) / 4.0
        expected = 2.0 * 1e-10 / 1000.0**2 / 4.0 * a / b**2
        assert found.covariance[0, 0] / expected == pytest.approx(1.0, rel=1e-9)

    def test_a_tie_has_a_whole_interval_of_optima(self):
        k = 0.1 * np.sqrt(2.0) * 1e-5
        robot, measurements = one_joint([0.0, 0.0, 100 * k, 100 * k])
        found = estimate(robot, measurements, loss="huber", huber_threshold=0.1, positive=False)
        assert k <= 1000.0 * found.compliance[0] <= 99.0 * k
        assert found.certificates[0].is_optimal()


class TestGrossErrors:
    @pytest.mark.parametrize(
        ("method", "weighting", "sigma"),
        [
            ("partial_pose", "covariance", None),
            ("complete_pose", "characteristic_length", SIGMA),
            ("decoupled_partial_pose", "covariance", SIGMA),
            *(pytest.param(*chosen, SIGMA, marks=pytest.mark.slow) for chosen in METHODS_AND_WEIGHTS[:-1]),
        ],
    )
    def test_bias_stays_below_a_standard_uncertainty_where_the_squared_loss_fails(
        self, pulls, method, weighting, sigma
    ):
        robot, exact = pulls
        options = {"method": method, "weighting": weighting}
        if weighting == "characteristic_length":
            options["characteristic_length"] = 0.6
        changes = {"huber": [], "squared": []}
        for seed in range(10):
            clean = noisy(replace(exact, sigma=sigma), seed)
            bad, _ = spoilt(clean, seed)
            expected = estimate(robot, clean, **options)
            uncertainty = np.sqrt(np.diag(expected.covariance))
            for loss, found in changes.items():
                result = estimate(robot, bad, loss=loss, **options)
                found.append((result.compliance - expected.compliance) / uncertainty)
        bias = {loss: np.abs(np.mean(found, axis=0)).max() for loss, found in changes.items()}
        deviation = {loss: np.sqrt(np.mean(np.square(found), axis=0)) for loss, found in changes.items()}
        # Gross errors in random directions bias no loss much on average; they ruin each squared fit.
        assert bias["huber"] < 1.0
        assert (deviation["huber"] < 1.5).all()
        assert (deviation["squared"] > 2.0).all()

    def test_constants_are_quantiles_of_the_norm_of_a_good_residual(self):
        norm = stats.chi(3)
        assert norm.cdf(robust.DEFAULT_THRESHOLD) == pytest.approx(0.95, abs=1e-3)
        assert norm.cdf(robust.SUSPICIOUS_NORM) == pytest.approx(0.999)


class TestProperties:
    @examples(25)
    @given(
        seed=st.integers(0, 2**32 - 1),
        threshold=st.floats(0.1, 100.0),
        share=st.floats(0.0, 0.6),
        size=st.floats(0.0, 6.0),
        positive=st.booleans(),
        known=st.booleans(),
        count=st.integers(3, 15),
    )
    def test_is_always_certified(self, pulls, seed, threshold, share, size, positive, known, count):
        robot, exact = pulls
        bad, _ = spoilt(noisy(exact[:count], seed), seed, share=share, size=10.0**size)
        bad = replace(bad, sigma=SIGMA if known else None)
        found = estimate(robot, bad, loss="huber", huber_threshold=threshold, positive=positive)
        assert all(certificate.is_optimal() for certificate in found.certificates)
        assert len(found.certificates) == 2
        assert ((found.robust.weight > 0) & (found.robust.weight <= 1)).all()
        assert _stationary(robot, bad, found, threshold) < 1e-7


def _stationary(robot, measurements, found, threshold):
    """Largest gradient of the free joints, as a cosine; the rows are the simulator's."""
    A, d = rows_of(robot, measurements)
    residual = d - A @ found.compliance
    norm = np.linalg.norm(residual, axis=1)
    pull = residual * np.minimum(1.0, threshold * found.sigma / np.maximum(norm, 1e-300))[:, None]
    root = np.sqrt(found.robust.weight[measurements.present])[:, None]
    columns = np.linalg.norm(root[..., None] * A, axis=(0, 1))
    cosine = np.einsum("kij,ki->j", A, pull) / (columns * np.linalg.norm(root * d))
    free = found.compliance != 0.0  # a joint at its bound may also be hidden by the noise
    return float(np.abs(cosine[free]).max(initial=0.0))


class TestRefusals:
    def test_no_sigma_and_no_readings_to_spare(self, pulls):
        robot, exact = pulls
        few = first_target(replace(noisy(exact, 0)[:2], sigma=None))
        with pytest.raises(UnsupportedMethodError, match="needs sigma"):
            estimate(robot, few, loss="huber")

    def test_an_optimum_without_a_certificate_is_none(self, bad, monkeypatch):
        monkeypatch.setattr(robust, "MOST_ROUNDS", 2)
        monkeypatch.setattr(robust, "MOST_STATED", 0)
        with pytest.raises(SolverError, match="did not converge to an optimum"):
            estimate(*bad, loss="huber")


@pytest.mark.parametrize("count", [20, pytest.param(60, marks=pytest.mark.slow)])
def test_intervals_cover_the_truth_although_a_tenth_of_the_readings_is_wrong(pulls, count):
    robot, exact = pulls
    covered = []
    for seed in range(count):
        found = estimate(robot, spoilt(noisy(exact, seed), seed)[0], loss="huber")
        covered += held(found.joints, ARM.compliances)
    # Six intervals of 95 % a campaign, which are correlated: half as good as independent ones at least.
    assert abs(np.mean(covered) - 0.95) < 2.5 * np.sqrt(0.95 * 0.05 / (3 * count))
