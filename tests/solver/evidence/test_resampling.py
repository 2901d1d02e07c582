"""Resampling, priors and observability, beside identification itself."""

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats
from scipy.optimize import brentq
from support.campaigns import (
    ARM,
    METHODS,
    METHODS_AND_WEIGHTS,
    blocks_of_set,
    estimate,
    prepare,
    simulated,
    straight_wrist,
    twins,
    with_targets,
)
from support.examples import examples
from support.shared_data import shared

from jointstiff.schemas.options import Resampling
from jointstiff.simulator.campaign import torques
from jointstiff.solver.errors import RequestError
from jointstiff.solver.evidence import resampling as module
from jointstiff.solver.evidence.resampling import (
    MethodStacks,
    Resamples,
    StageStack,
    draw_configurations,
    resample,
    summarise_resamples,
)
from jointstiff.solver.fit import solution
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.estimate import predict
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.observability import (
    Observability,
    Spectrum,
    analyse_spectrum,
    observability_indices,
)
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.fit.stages import sigma_test
from jointstiff.solver.mechanics.block import regressor_blocks
from jointstiff.solver.outcome.result import build_joint_results
from jointstiff.solver.outcome.rules import Assessment, report_implausible_results

POSITIVE, FREE = Bounds.positive(6), Bounds.unconstrained(6)
BOXED = Bounds(np.full(6, 3e-7), np.array([np.inf, 6e-7, 1e-6, 5e-6, 5e-6, 2e-5]))


@pytest.fixture(scope="module")
def noisy():
    """19 configurations with noise that drives some compliances below zero."""
    return simulated(load="pull", configurations=19, sigma=6e-4)


@pytest.fixture(scope="module")
def rarely_twisted(noisy):
    """Joint 1 is twisted in the first three configurations only."""
    robot, measurements = noisy
    force = measurements.force.copy()
    force[3:, :2] = 0.0
    return robot, replace(measurements, force=force)


def plan_of(size, repetitions, seed, replacement=False):
    return Resampling(size=size, repetitions=repetitions, seed=seed, replacement=replacement)


def settings(method, weighting="covariance", bounds=POSITIVE):
    length = 0.6 if weighting == "characteristic_length" else None
    return Settings(method, weighting, bounds, characteristic_length=length)


def draw(measurements, drawn):
    """Return the drawn configurations; one that is drawn twice counts as two readings."""
    apart = 1e-13 * np.arange(len(drawn))[:, None, None]  # equal positions would be one reading [m]
    return replace(measurements[drawn], position=measurements.position[drawn] + apart)


class TestAgainstIdentify:
    @pytest.mark.parametrize(
        ("method", "weighting", "bounds"),
        [
            *((*chosen, BOXED) for chosen in METHODS_AND_WEIGHTS),
            *(("partial_pose", "covariance", bounds) for bounds in (POSITIVE, FREE)),
        ],
    )
    def test_each_resample_is_identify_on_what_was_drawn(self, noisy, monkeypatch, method, weighting, bounds):
        """By the squares of the rows, and by the rows, to which all go if none is conditioned enough."""
        robot, measurements = noisy
        options = settings(method, weighting, bounds)
        blocks = blocks_of_set(robot, measurements, options)
        for plan in (plan_of(10, 8, 1), plan_of(19, 8, 2, replacement=True)):
            by_squares = resample(blocks, plan, bounds)
            with monkeypatch.context() as patch:
                patch.setattr(solution, "LEAST_EIGENVALUE", np.inf)
                by_rows = resample(blocks, plan, bounds)
            for k, drawn in enumerate(draw_configurations(plan, 19, 0, 8)):
                expected = identify(Rows(robot, draw(measurements, drawn)), options)
                prediction = predict(Rows(robot, measurements), expected.compliance)
                at_bound = [joint.status == "at_bound" for joint in expected.joints]
                for found in (by_squares, by_rows):
                    np.testing.assert_allclose(found.compliance[k], expected.compliance, rtol=1e-8)
                    assert found.compensation[k] == pytest.approx(prediction.compensation, rel=1e-9)
                    np.testing.assert_array_equal(_held(found, bounds)[k], at_bound)
            for found in (by_squares, by_rows):
                assert bounds is FREE or _held(found, bounds).any()
                assert ((bounds.lower <= found.compliance) & (found.compliance <= bounds.upper)).all()

    @pytest.mark.parametrize("method", METHODS)
    def test_dead_weight_and_missing_readings(self, method):
        """A joint that the full set does not show has no number; a reading that is not there no weight."""
        robot, measurements = simulated(load="dead_weight", seed=4)
        if method == "partial_pose":
            present = measurements.present.copy()
            present[::2, 1] = False
            measurements = with_targets(measurements, present)
        plan, options = plan_of(10, 5, 3), settings(method)
        found = resample(blocks_of_set(robot, measurements, options), plan, POSITIVE)
        assert np.isnan(found.compliance[:, 0]).all()
        for k, drawn in enumerate(draw_configurations(plan, len(measurements), 0, 5)):
            expected = identify(Rows(robot, draw(measurements, drawn)), options)
            np.testing.assert_allclose(found.compliance[k, 1:], expected.compliance[1:], rtol=1e-8)
            prediction = predict(Rows(robot, measurements), expected.compliance)
            assert found.compensation[k] == pytest.approx(prediction.compensation, rel=1e-9)


class TestUndetermined:
    def test_fewer_readings_than_joints(self, noisy):
        robot, measurements = noisy
        one = replace(measurements, present=np.arange(3) == np.zeros((19, 1)))
        found = resample(blocks_of_set(robot, one, settings("partial_pose")), plan_of(1, 10, 0), FREE)
        assert np.isnan(found.compliance).all()

    @pytest.mark.parametrize("case", ["combined", "null", "null_at_targets", "determined"])
    def test_wrist_behind_an_arm_that_is_not_determined(self, case):
        """What is not known of the arm cannot be told from the wrist, unless the targets do not show it."""
        rng = np.random.default_rng(0)
        centre = rng.standard_normal((2, 9, 4))  # columns: the arm (3), what moved
        targets = rng.standard_normal((2, 9, 6))  # the wrist (2), the arm (3), what moved
        if case == "combined":
            centre[:, :, 1] = 2 * centre[:, :, 0]
        elif case != "determined":
            centre[:, :, 0] = 0.0
        if case == "null_at_targets":
            targets[:, :, 2] = 0.0
        arm, wrist = np.arange(3), np.array([3, 4])
        stages = (_stage(centre, arm, arm[:0]), _stage(targets, wrist, arm))
        blocks = MethodStacks(5, stages, np.arange(5), rng.standard_normal((5, 3, 6)), np.ones((3, 6)))
        found = resample(blocks, plan_of(1, 1, 0), Bounds.unconstrained(5))
        unknown = {"combined": [0, 1, 3, 4], "null": [0, 3, 4], "null_at_targets": [0], "determined": []}
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.compliance[0])), unknown[case])
        if case in {"null_at_targets", "determined"}:
            rows = targets[draw_configurations(plan_of(1, 1, 0), 2, 0, 1)[0, 0]]
            left = rows[:, 5] - rows[:, 2:5] @ np.nan_to_num(found.compliance[0, :3])
            expected = np.linalg.lstsq(rows[:, :2], left, rcond=None)[0]
            np.testing.assert_allclose(found.compliance[0, 3:], expected, rtol=1e-9)


class TestPlan:
    def test_draws_are_rows_of_one_table(self):
        table = np.random.default_rng(5).random((100, 19))
        drawn = draw_configurations(plan_of(10, 100, 5), 19, 40, 60)
        np.testing.assert_array_equal(drawn, np.argsort(table, axis=1)[40:60, :10])
        again = draw_configurations(plan_of(10, 100, 5, replacement=True), 19, 40, 60)
        np.testing.assert_array_equal(again, np.floor(19 * table[40:60, :10]))


class TestSameNumbers:
    @pytest.mark.parametrize("method", METHODS)
    @pytest.mark.parametrize("replacement", [False, True])
    def test_whatever_the_chunks(self, rarely_twisted, monkeypatch, method, replacement):
        """To the last bit, those that go back to the rows included."""
        blocks = blocks_of_set(*rarely_twisted, settings(method))
        plan = plan_of(7, 50, 9, replacement=replacement)
        whole = resample(blocks, plan, POSITIVE)
        assert np.isnan(whole.compliance).any()
        cuts = [0, 1, 2, 13, 13, 40, 50]
        parts = [resample(blocks, plan, POSITIVE, *cut) for cut in pairwise(cuts)]
        assert _bytes(Resamples.concatenate(parts)) == _bytes(whole)
        monkeypatch.setattr(module, "TILE", 7)
        monkeypatch.setattr("jointstiff.solver.evidence.resampling.TILE_RESIDUALS", 600)
        assert _bytes(resample(blocks, plan, POSITIVE)) == _bytes(whole)

    @pytest.mark.process
    def test_whatever_the_threads(self):
        folder = Path(__file__).parent
        paths = [str(path) for path in (folder, folder.parents[1], folder.parents[2])]
        program = f"import sys; sys.path[:0] = {paths}; import test_resampling as t; print(t.digest())"
        digests = set()
        for count in ("1", "2"):
            threads = {"OPENBLAS_NUM_THREADS": count, "OMP_NUM_THREADS": count}
            command = [sys.executable, "-c", program]
            digests.add(subprocess.check_output(command, env=os.environ | threads))
        assert len(digests) == 1


def test_a_summary_of_numbers_that_are_known():
    nan = np.nan
    compliance = np.array([[1.0, -2.0, nan], [2.0, 0.0, nan], [4.0, 2.0, nan], [nan, 4.0, nan]])
    draws = Resamples(compliance, np.array([0.5, 0.7, 0.9, nan]))
    found = summarise_resamples(draws, ["a", "b", "c"], confidence=0.5)
    a, b, c = found.joints
    assert (a.compliance_mean, b.compliance_mean) == pytest.approx((7 / 3, 1.0))
    assert (a.compliance_deviation, b.compliance_deviation) == pytest.approx(
        (np.sqrt(7 / 3), np.sqrt(20 / 3))
    )
    assert a.compliance_interval == pytest.approx((1.5, 3.0))
    assert b.compliance_interval == pytest.approx((-0.5, 2.5))
    assert (a.stiffness_mean, b.stiffness_mean) == pytest.approx((7 / 12, 1 / 12))
    assert [joint.share_negative for joint in found.joints] == [0, 0.25, 0]
    assert [joint.share_infinite for joint in found.joints] == [0, 0.25, 0]
    assert [joint.share_undetermined for joint in found.joints] == [0.25, 0, 1]
    assert c.compliance_mean is c.compliance_interval is c.stiffness_mean is None
    assert found.share_any_negative == 0.25
    assert found.compensation_mean == pytest.approx(0.7)
    assert found.compensation_deviation == pytest.approx(0.2)
    assert found.compensation_interval == pytest.approx((0.6, 0.8))
    hidden = summarise_resamples(
        draws, ["a", "b", "c"], is_hidden=np.array([False, True, False]), confidence=0.5
    )
    assert hidden.joints[0] == a
    assert hidden.joints[1] == c.model_copy(update={"name": "b"})


def test_fanuc_ten_of_thirty():
    """Issue 4: 10 to 14 % of unconstrained fits have a negative stiffness, constrained ones none."""
    robot, measurements = prepare(shared("fanuc_r2000ic/campaign"))
    blocks = blocks_of_set(robot, measurements, settings("partial_pose"))
    plan = plan_of(10, 2000, 2017)
    draws = (resample(blocks, plan, bounds) for bounds in (FREE, POSITIVE))
    free, positive = (summarise_resamples(each, robot.joint_names) for each in draws)
    assert 0.10 <= free.share_any_negative <= 0.14
    assert positive.share_any_negative == 0.0
    assert positive.compensation_mean >= free.compensation_mean


def digest():
    """Of the numbers of a plan, by both paths, for another process to compare."""
    blocks = blocks_of_set(*simulated(load="pull", configurations=500), settings("partial_pose"))
    plan = plan_of(250, 100, 0)
    together = resample(blocks, plan, POSITIVE)
    solution.LEAST_EIGENVALUE = np.inf
    by_rows = resample(blocks, plan, POSITIVE)
    return hashlib.sha256(_bytes(together) + _bytes(by_rows)).hexdigest()


def _bytes(resamples):
    return b"".join(a.tobytes() for a in (resamples.compliance, resamples.compensation))


def _held(resamples, bounds):
    return (resamples.compliance == bounds.lower) | (resamples.compliance == bounds.upper)


def _stage(rows, joints, known):
    read = np.full(len(rows), rows.shape[1])
    stack = Stack(rows, read, {"joints": len(joints), "known": len(known)})
    return StageStack(joints, known, stack, np.ones(len(joints) + len(known)))


STIFFNESS = {"joint_5": (4e5, 4e4), "joint_2": (3e6, 1e6)}
PRIORS = {name: {"stiffness": k, "standard_uncertainty": u} for name, (k, u) in STIFFNESS.items()}


@pytest.fixture(scope="module")
def pulls():
    return simulated(load="pull", configurations=6, force=150.0, seed=3)


@pytest.mark.parametrize("sigma", [2e-5, None])
def test_partial_pose_is_bayes_rule(pulls, sigma):
    """``(AᵀA/s² + S₀⁻¹)⁻¹ (Aᵀd/s² + S₀⁻¹ c₀)``, s² = 2 sigma² of a deflection's coordinate."""
    robot, measurements = pulls[0], replace(pulls[1], sigma=sigma)
    found = estimate(robot, measurements, priors=PRIORS, positive=False)
    alone = estimate(robot, measurements, positive=False)
    assert found.sigma == alone.sigma  # a prior tells nothing of sigma
    (block,) = regressor_blocks(robot, measurements)
    A, d = block.A.reshape(-1, 6), measurements.deflection.ravel()
    known = np.zeros(6)
    known[[1, 4]] = [(3e6**2 / 1e6) ** 2, (4e5**2 / 4e4) ** 2]
    unit = np.linalg.norm(A, axis=0)
    information = A.T @ A / (2 * found.sigma**2) + np.diag(known)
    moment = A.T @ d / (2 * found.sigma**2) + known / np.array([1, 3e6, 1, 1, 4e5, 1])
    expected = np.linalg.solve(information / np.outer(unit, unit), moment / unit) / unit
    np.testing.assert_allclose(found.compliance, expected, rtol=1e-9)
    covariance = np.linalg.inv(information / np.outer(unit, unit)) / np.outer(unit, unit)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-7, atol=1e-22)
    for j, (k, u) in {4: STIFFNESS["joint_5"], 1: STIFFNESS["joint_2"]}.items():
        ratio = (k**2 / u) ** 2 * alone.joints[j].standard_uncertainty ** 2
        assert found.joints[j].prior_to_data == pytest.approx(ratio, rel=1e-9)
    assert found.joints[0].prior_to_data is None
    complete = estimate(robot, measurements, priors=PRIORS, positive=False, method="complete_pose")
    np.testing.assert_allclose(complete.compliance, expected, rtol=1e-8)


def contradicted(found):
    return {
        finding.where for finding in report_implausible_results(found) if "contradicts" in finding.message
    }


@pytest.mark.parametrize("fraction", [0.003, 0.02, 0.1])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_prior_beyond_five_standard_uncertainties_of_the_difference_is_reported(fraction, direction):
    """The uncertainty of the readings alone is that of a fit without priors, with all errors of the load.

    The prior has a fraction of the stiffness as its uncertainty. A difference is counted in uncertainties of
    the stiffness by the prior, and of the compliance by the readings.
    """
    robot, measurements = simulated(load="pull", configurations=6, force=1500.0, seed=3)
    alone = estimate(robot, measurements, positive=False)
    c, u = alone.compliance[1], float(np.sqrt(alone.covariance[1, 1]))

    def deviate(factor):
        """Return the deviation of a prior whose stiffness is that of the readings times a factor."""
        return 1.0 / np.hypot(fraction / (factor - 1.0), u / (c * (1.0 / factor - 1.0)))

    for deviation, reported in ((4.8, False), (5.2, True)):
        ends = (1.0001, 3.0) if direction > 0 else (0.3, 0.9999)
        factor = brentq(lambda factor, wanted=deviation: abs(deviate(factor)) - wanted, *ends)
        prior = {"stiffness": factor / c, "standard_uncertainty": fraction / c}
        found = estimate(robot, measurements, positive=False, priors={"joint_2": prior})
        assert contradicted(found) == ({"joint_2"} if reported else set()), (deviation, factor)


@pytest.mark.parametrize(("stiffness", "uncertainty"), [(3.1, 1.0), (3.1e3, 1e2), (3.1e9, 1e8)])
def test_a_prior_in_another_unit_is_no_result_to_use_without_a_word(stiffness, uncertainty):
    robot, measurements = simulated(load="pull", configurations=6, force=1500.0, seed=3)
    prior = {"joint_2": {"stiffness": stiffness, "standard_uncertainty": uncertainty}}
    found = estimate(robot, measurements, priors=prior)
    (finding,) = [each for each in report_implausible_results(found) if "contradicts" in each.message]
    assert (finding.code, finding.where, finding.weight) == ("prior_dominates", "joint_2", "do_not_use")
    assert "standard uncertainties of the difference" in finding.message
    assert finding.remedy == "check the prior, and that its numbers are in N·m/rad; or omit the prior"


def test_a_prior_with_an_uncertainty_in_per_cent_is_named_and_ten_per_cent_are_offered():
    """A data sheet says 3.5e6 N·m/rad to 10 %; the uncertainty is stated as 10 N·m/rad."""
    robot, measurements = simulated(load="pull", configurations=6, force=1500.0, seed=3)
    stated = {"stiffness": 3.5e6, "standard_uncertainty": 10.0}
    found = estimate(robot, measurements, priors={"joint_2": stated})
    (finding,) = [each for each in report_implausible_results(found) if each.where == "joint_2"]
    assert (finding.code, finding.weight) == ("prior_dominates", "do_not_use")
    assert "± 10 N·m/rad (0.00029 %)" in finding.message
    assert "such as 350000 N·m/rad for 10 %" in finding.remedy
    mended = estimate(robot, measurements, priors={"joint_2": stated | {"standard_uncertainty": 3.5e5}})
    assert contradicted(mended) == set()


def test_a_combination_that_the_prior_tells_apart():
    """Two joints on one axis: their sum is measured, the prior of one leaves the rest to the other."""
    campaign = simulated(load="pull", seed=3)
    whole = estimate(*campaign)
    prior = {"twin": {"stiffness": 1e7, "standard_uncertainty": 1e5}}
    found = estimate(*twins(*campaign), priors=prior)
    assert [joint.status for joint in found.joints[:2]] == ["identified"] * 2
    np.testing.assert_allclose(found.compliance[:2], [whole.compliance[0] - 1e-7, 1e-7], rtol=1e-6)
    assert found.joints[1].prior_to_data == np.inf
    verdicts = Assessment("use", (), ("use",) * len(found.joints))
    message = build_joint_results(verdicts, found.joints)[1]
    assert message.prior_to_data is None
    assert "only the prior separates twin from these joints" in message.reason
    assert found.identifiability[0].rank == 6  # of the readings, whatever the prior adds
    assert "prior_dominates" in {finding.code for finding in report_implausible_results(found)}


class TestRefusals:
    @pytest.mark.parametrize("uncertainty", [0.0, -1.0, np.nan, np.inf])
    def test_an_uncertainty_that_is_none(self, uncertainty):
        with pytest.raises(RequestError, match="not positive"):
            Prior(np.array([1.0]), np.array([uncertainty]))


NAMES = ("a", "b", "c", "d")


class TestVisibleJoints:
    def test_no_index_where_joints_show_only_together(self):
        assert observability_indices(np.ones((4, 2)), visibility_of(np.ones(2))) is None


class TestCombinations:
    @staticmethod
    def analysed(*columns):
        R = np.column_stack(columns)
        return analyse_spectrum(Spectrum(R), np.arange(R.shape[1]))

    def test_sums_of_two_or_three(self):
        u, v = np.random.default_rng(0).standard_normal((2, 9))
        for columns, together, words in (
            ((u, v, 2 * u, -3 * u), "a, c, d", "c(a) + 2 c(c) - 3 c(d)"),
            ((u, v, 0.5 * u + 4 * v), "a, b, c", "c(a) + 0.5 c(c) and c(b) + 4 c(c)"),
            ((u, v, u), "a, c", "c(a) + c(c)"),
            ((u, v, 0.8 * u), "a, c", "c(a) + 0.8 c(c)"),
            ((u, v, 3e6 * u), "a, c", "c(a) + 3e+06 c(c)"),
        ):
            (group,) = self.analysed(*columns).combinations
            assert f"only a combination of {together} is observable, {words}: add" in group.reason(NAMES)

    @examples(60)
    @given(seed=st.integers(0, 2**32 - 1), seen=st.integers(1, 3))
    def test_sums_tell_all_that_the_readings_do(self, seed, seen):
        """Every row of the regressor is made of the sums, and there are no more of them than its rank."""
        rng = np.random.default_rng(seed)
        R = rng.standard_normal((9, seen)) @ rng.standard_normal((seen, 4)) * 10.0 ** rng.uniform(-3, 3, 4)
        norms = np.linalg.norm(R, axis=0)
        null = np.linalg.svd(R / norms)[2][seen:]
        assume((np.abs(null.T @ null) > 1e-4).all())  # a joint that takes no part is none of the group
        (group,) = self.analysed(*R.T).combinations
        assert group.seen.shape == (seen, 4)
        sums, rows = group.seen / norms, R / norms
        left = rows - rows @ np.linalg.pinv(sums) @ sums
        assert np.abs(left).max() < 1e-7

    def test_a_wrist_that_is_nearly_straight(self):
        (analysis,) = estimate(*straight_wrist(2e-3)).identifiability
        assert analysis.condition_number > 100
        assert analysis.weakest.joints == (3, 5)
        np.testing.assert_allclose(analysis.weakest.change, [1, -1], atol=0.05)
        words = analysis.weakest.in_words([f"joint_{i + 1}" for i in range(6)])
        assert words.startswith("joint_4, joint_6 are hard to distinguish")

    def test_the_weakest_direction_is_one_of_compliances(self):
        """Columns u and 10 u + little: c_0 up by 1 and c_1 down by 0.1 is what hardly shows."""
        u, v = np.linalg.qr(np.random.default_rng(0).standard_normal((9, 2)))[0].T
        weakest = self.analysed(u, 10 * (u + 1e-3 * v)).weakest
        np.testing.assert_allclose(weakest.change, [1, -0.1], rtol=1e-3)
        assert weakest.attenuation == pytest.approx(2e3, rel=1e-3)


def visibility_of(excitation):
    n = len(excitation)
    kinds = ("revolute",) * n
    return Observability(
        np.zeros(n, dtype=bool), np.ones(n), (None,) * n, excitation, np.ones(n), np.zeros((n, n)), kinds
    )


def test_a_stated_sigma_is_tested_on_both_sides():
    tails = {0.3: "consistent", 0.004: "residuals_too_large", 0.996: "residuals_too_small"}
    for tail, verdict in tails.items():
        found = sigma_test(float(stats.chi2.isf(tail, 100)), 100.0)
        assert (found.result, found.p_value) == (verdict, pytest.approx(2.0 * min(tail, 1.0 - tail)))
    assert sigma_test(0.0, 0.0) is None


def test_noise_that_hides_a_joint_is_told_with_the_torques():
    """A base that leans by 1e-5 rad gives joint 1 a torque, but no information."""
    robot, upright = simulated(load="dead_weight", seed=4)
    lean = np.array([[1, 0, 1e-5], [0, 1, 0], [-1e-5, 0, 1]])
    m = replace(upright, force=upright.force @ lean.T)
    found, expected = estimate(robot, m), estimate(robot, upright)
    most = np.abs(torques(ARM, m.joints, m.force, m.moment, m.load_point)).max(axis=0)
    strongest = int(most.argmax())
    greatest = round(most[strongest], -2)
    told = f"at most {most[0]:.2g} N.m, and joint_{strongest + 1} with up to {greatest:.0f} N.m:"
    assert found.joints[0].status == "not_observable"
    assert "hidden by noise" in found.joints[0].reason
    assert told in found.joints[0].reason
    np.testing.assert_allclose(found.compliance[1:], expected.compliance[1:], rtol=1e-2)
