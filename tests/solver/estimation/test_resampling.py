"""Resamples against identify on the same configurations, which goes through the rows, not their squares."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from support.campaigns import (
    METHODS,
    METHODS_AND_WEIGHTS,
    blocks_of_set,
    prepare,
    settings_of,
    simulated,
    with_targets,
)
from support.shared_data import shared

from jointstiff.schemas.options import Resampling
from jointstiff.solver.errors import (
    NotObservableError,
    UnsupportedMethodError,
)
from jointstiff.solver.estimation import resampling as module
from jointstiff.solver.estimation import solution
from jointstiff.solver.estimation.estimate import predict
from jointstiff.solver.estimation.identify import identify
from jointstiff.solver.estimation.method import Settings
from jointstiff.solver.estimation.resampling import (
    GramBlocks,
    Resamples,
    StageBlocks,
    draws_of,
    resample,
    summarise,
)
from jointstiff.solver.estimation.solution import Bounds

POSITIVE, FREE = Bounds.positive(6), Bounds.unconstrained(6)
BOXED = Bounds(np.full(6, 3e-7), np.array([np.inf, 6e-7, 1e-6, 5e-6, 5e-6, 2e-5]))


@pytest.fixture(scope="module")
def noisy():
    """19 configurations with noise that drives some compliances below zero."""
    return simulated(load="pull", configurations=19, sigma=6e-4)


@pytest.fixture(scope="module")
def blocks(noisy):
    return blocks_of_set(*noisy, settings("partial_pose"))


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
            for k, drawn in enumerate(draws_of(plan, 19, 0, 8)):
                expected = identify(robot, measurements[drawn], options)
                prediction = predict(robot, measurements, expected.compliance)
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
        for k, drawn in enumerate(draws_of(plan, len(measurements), 0, 5)):
            expected = identify(robot, measurements[drawn], options)
            np.testing.assert_allclose(found.compliance[k, 1:], expected.compliance[1:], rtol=1e-8)
            prediction = predict(robot, measurements, expected.compliance)
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
        blocks = GramBlocks(5, stages, np.arange(5), rng.standard_normal((5, 3, 6)), np.ones((3, 6)))
        found = resample(blocks, plan_of(1, 1, 0), Bounds.unconstrained(5))
        unknown = {"combined": [0, 1, 3, 4], "null": [0, 3, 4], "null_at_targets": [0], "determined": []}
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.compliance[0])), unknown[case])
        if case in {"null_at_targets", "determined"}:
            rows = targets[draws_of(plan_of(1, 1, 0), 2, 0, 1)[0, 0]]
            left = rows[:, 5] - rows[:, 2:5] @ np.nan_to_num(found.compliance[0, :3])
            expected = np.linalg.lstsq(rows[:, :2], left, rcond=None)[0]
            np.testing.assert_allclose(found.compliance[0, 3:], expected, rtol=1e-9)


class TestPlan:
    def test_draws_are_rows_of_one_table(self):
        table = np.random.default_rng(5).random((100, 19))
        drawn = draws_of(plan_of(10, 100, 5), 19, 40, 60)
        np.testing.assert_array_equal(drawn, np.argsort(table, axis=1)[40:60, :10])
        again = draws_of(plan_of(10, 100, 5, replacement=True), 19, 40, 60)
        np.testing.assert_array_equal(again, np.floor(19 * table[40:60, :10]))

    def test_what_the_full_set_cannot_support_is_refused_in_its_words(self, noisy):
        robot, measurements = noisy
        few = replace(measurements, present=np.arange(3) < np.full((19, 1), 2))
        with pytest.raises(UnsupportedMethodError, match="needs 3 targets"):
            blocks_of_set(robot, few, settings("complete_pose"))
        nothing = replace(measurements, force=np.zeros((19, 3)))
        with pytest.raises(NotObservableError, match="never twists"):
            blocks_of_set(robot, nothing, settings("partial_pose"))

    @pytest.mark.parametrize(
        ("options", "reason"),
        [
            ({"loss": "huber"}, "^resampling: "),
            ({"priors": {"joint_2": {"stiffness": 3e6, "standard_uncertainty": 1e6}}}, "supports neither"),
            ({"stiffness_order": [["joint_2", "joint_3"]]}, "supports neither"),
        ],
    )
    def test_refuses_what_is_not_linear_or_not_of_the_readings(self, noisy, options, reason):
        with pytest.raises(UnsupportedMethodError, match=reason):
            blocks_of_set(*noisy, settings_of(noisy[0], **options))


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
        monkeypatch.setattr("jointstiff.solver.estimation.resampling.TILE_RESIDUALS", 600)
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


class TestSummary:
    def test_of_numbers_that_are_known(self):
        nan = np.nan
        compliance = np.array([[1.0, -2.0, nan], [2.0, 0.0, nan], [4.0, 2.0, nan], [nan, 4.0, nan]])
        draws = Resamples(compliance, np.array([0.5, 0.7, 0.9, nan]))
        found = summarise(draws, ["a", "b", "c"], confidence=0.5)
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
        assert found.compensation.mean == pytest.approx(0.7)
        assert found.compensation.deviation == pytest.approx(0.2)
        assert found.compensation.interval == pytest.approx((0.6, 0.8))
        hidden = summarise(draws, ["a", "b", "c"], hidden=np.array([False, True, False]), confidence=0.5)
        assert hidden.joints[0] == a
        assert hidden.joints[1] == c.model_copy(update={"name": "b"})


def test_fanuc_ten_of_thirty():
    """Issue 4: 10 to 14 % of unconstrained fits have a negative stiffness, constrained ones none."""
    robot, measurements = prepare(shared("fanuc_r2000ic/campaign"))
    blocks = blocks_of_set(robot, measurements, settings("partial_pose"))
    plan = plan_of(10, 2000, 2017)
    draws = (resample(blocks, plan, bounds) for bounds in (FREE, POSITIVE))
    free, positive = (summarise(each, robot.joint_names) for each in draws)
    assert 0.10 <= free.share_any_negative <= 0.14
    assert positive.share_any_negative == 0.0
    assert positive.compensation.mean >= free.compensation.mean


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
    return StageBlocks(joints, known, rows, np.swapaxes(rows, 1, 2) @ rows, np.ones(len(joints) + len(known)))
