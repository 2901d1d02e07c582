"""Screening of springs and beams that balance the load exactly; contributions beside levers by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import estimate, first_target, only_deflections, prepare
from support.shared_data import shared
from support.springs import readings_of

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.elastic_links import ElasticArm, beam_arm, elastic_campaign
from jointstiff.solver.evidence.causes import LINKS_LEVEL, MISTAKE_LEVEL, screen_estimate
from jointstiff.solver.evidence.estimate import predict
from jointstiff.solver.robot.model import DhRow, Robot, dh_chain


def screened(robot, measurements, k_c="included"):
    fit = estimate(robot, measurements, complementary_stiffness=k_c)
    return screen_estimate(robot, measurements, fit)


def springs(seed, load="pull", **options):
    return prepare(simulate_campaign(default_arm(), load=load, seed=seed, **options))


def beams(seed, softness=1.0, **options):
    elastic = beam_arm(default_arm())
    soft = ElasticArm(elastic.arm, softness * elastic.links)
    return prepare(elastic_campaign(soft, seed=seed, **options))


class TestClean:
    @pytest.mark.parametrize("load", ["pull", "dead_weight"])
    def test_springs_alone_are_accused_of_nothing(self, load):
        for seed in range(12):
            robot, measurements = springs(seed, load, configurations=10 + 3 * seed)
            for clean in (measurements, replace(only_deflections(measurements), sigma=None)):
                screening = screened(robot, clean)
                assert screening.mistake is None
                assert screening.links_p_value > LINKS_LEVEL / 3
                assert not screening.lack_of_fit

    def test_a_load_that_matters_for_the_geometry_is_taken_into_account(self):
        """Without K_c at the test the posture under the load would be taken for links."""
        robot, measurements = springs(3, force=8000.0)
        for choice in ("included", "neglected"):
            assert not screened(robot, measurements, choice).links_speak

    def test_exact_readings_leave_nothing_to_accuse(self):
        robot, measurements = springs(2, sigma=0.0)
        screening = screened(robot, measurements)
        assert screening.mistake is None
        assert not screening.links_speak

    def test_too_few_readings_tell_nothing(self):
        robot, measurements = springs(1, configurations=4)
        assert not screened(robot, first_target(measurements), "neglected").lack_of_fit


class TestLoad:
    @pytest.mark.parametrize("load", ["pull", "dead_weight"])
    @pytest.mark.parametrize("offset", [0.05, 0.15])
    def test_a_load_point_elsewhere_is_proved_and_found(self, load, offset):
        for seed in range(4):
            robot, measurements = springs(seed, load, configurations=30)
            direction = np.random.default_rng(seed).standard_normal(3)
            moved = offset * direction / np.linalg.norm(direction)
            wrong = replace(measurements, load_point=measurements.load_point + moved)
            screening = screened(robot, wrong)
            assert not screening.links_speak
            mistake = screening.mistake
            assert mistake.kind == "load_point"
            assert mistake.p_value < MISTAKE_LEVEL
            assert mistake.proved
            # Pulls tell the point to a centimetre, a dead weight hardly across itself.
            assert np.linalg.norm(mistake.correction + moved) < (0.02 if load == "pull" else 0.5 * offset)
            found = estimate(robot, mistake.corrected(wrong), complementary_stiffness="included")
            u = np.sqrt(np.maximum(np.diag(found.covariance), 1e-30))
            seen = found.estimated
            assert (np.abs(found.compliance - default_arm().compliances)[seen] < 6 * u[seen]).all()

    def test_exact_readings_tell_the_load_point_exactly(self):
        """150 mm is far for one step of Gauss and Newton: the steps go on until it stands still."""
        for seed in range(3):
            robot, measurements = springs(seed, configurations=30, sigma=0.0)
            moved = np.array([0.15, -0.05, 0.1])
            wrong = replace(measurements, load_point=measurements.load_point + moved)
            mistake = screened(robot, wrong).mistake
            np.testing.assert_allclose(mistake.correction, -moved, atol=1e-6)

    @pytest.mark.parametrize("force", [100.0, 300.0])
    def test_a_forgotten_payload_is_proved_and_found(self, force):
        for seed in range(4):
            robot, measurements = springs(seed, configurations=30)
            payload = np.array([0.0, 0.0, -force])
            screening = screened(robot, replace(measurements, force=measurements.force - payload))
            assert screening.mistake.kind == "constant_force"
            assert screening.mistake.proved
            np.testing.assert_allclose(screening.mistake.correction, payload, atol=25.0)
            assert not screening.links_speak
            assert not screening.mistake.movement_as_well

    @pytest.mark.parametrize("load", ["pull", "dead_weight"])
    @pytest.mark.parametrize("turn", [0.0, 5e-5])
    def test_a_tracker_that_moved_is_no_constant_force_alone(self, load, turn):
        """It moved by 0.1 mm, or turned, too, between the unloaded and the loaded readings."""
        forces = 0
        for seed in range(8):
            robot, measurements = springs(seed, load, configurations=20)
            shift, axis = np.random.default_rng(seed).standard_normal((2, 3))
            moved = 1e-4 * shift / np.linalg.norm(shift) + turn * np.cross(axis, measurements.position)
            wrong = replace(measurements, deflection=measurements.deflection + moved)
            mistake = screened(robot, wrong).mistake
            if mistake is not None and mistake.kind == "constant_force":
                forces += 1
                assert mistake.movement_as_well
        assert forces >= 6


class TestLinks:
    @pytest.mark.parametrize("configurations", [20, 40])
    @pytest.mark.parametrize("softness", [2.0, 0.1])
    def test_beams_speak(self, configurations, softness):
        for seed in range(3):
            robot, measurements = beams(seed, softness, configurations=configurations)
            screening = screened(robot, measurements)
            assert screening.links_speak
            assert screening.lack_of_fit
            assert screening.mistake is None or not screening.mistake.proved

    def test_stiff_beams_stay_below_the_noise(self):
        robot, measurements = beams(0, 1e-4, configurations=20)
        assert not screened(robot, measurements).links_speak

    def test_the_real_robot_speaks(self):
        robot, measurements = prepare(shared("fanuc_r2000ic/campaign"))
        screening = screened(robot, measurements)
        assert screening.links_p_value == pytest.approx(6e-8, rel=0.1)
        assert screening.mistake is None


LEVERS = Robot(dh_chain([DhRow(1.0, 0.0, 0.0, 0.0)] * 2, "standard", "levers"))
"""Two levers of 1 m along x, both turning about z."""


def pulled(forces):
    """Read the flange of the stretched levers twice under each force, under the last one once."""
    n = len(forces)
    present = np.ones((n, 2), dtype=np.bool_)
    present[-1, 1] = False
    still = np.zeros((n, 2, 3))
    return readings_of(
        np.zeros((n, 2)), forces, np.zeros(3), still, still, in_flange=present, present=present
    )


def test_is_torque_times_compliance_times_lever():
    """1 kN across gives 2000 and 1000 N.m, on levers of 2 and 1 m."""
    found = predict(LEVERS, pulled([[0, -1000, 0], [0, 500, 0]]), np.array([1e-6, 4e-6])).contributions
    np.testing.assert_allclose(found.by_observation, [[4e-3, 2e-3], [4e-3, 2e-3]], rtol=1e-12)
    np.testing.assert_allclose(found.mean, [10e-3 / 3, 10e-3 / 3], rtol=1e-12)  # three readings
    np.testing.assert_allclose(found.share, [0.5, 0.5], rtol=1e-12)


def test_shares_add_up_to_one_and_may_be_negative_and_vanish_along_the_levers():
    found = predict(LEVERS, pulled([[0, -1000, 0]]), np.array([1e-6, -3e-7])).contributions
    assert found.share.sum() == pytest.approx(1.0)
    assert found.share[1] < 0
    assert not predict(LEVERS, pulled([[1000, 0, 0]]), np.array([1e-6, 4e-6])).contributions.share.any()


def test_a_joint_without_an_estimate_counts_as_rigid():
    measurements = pulled([[0, -1000, 0]])
    found = predict(LEVERS, measurements, np.array([1e-6, 4e-6]), estimated=np.array([False, True]))
    assert found.contributions.mean.tolist() == [0.0, pytest.approx(4e-3)]
    np.testing.assert_allclose(found.predicted[0, 0], [0.0, -8e-3, 0.0], atol=1e-15)


@pytest.mark.parametrize("included", [False, True])
def test_means_add_up_to_the_mean_length_of_the_prediction(included):
    robot, measurements = prepare(simulate_campaign(default_arm(), load="pull", configurations=8, seed=1))
    compliance = estimate(robot, measurements).compliance
    found = predict(robot, measurements, compliance, balanced=compliance if included else None)
    lengths = np.linalg.norm(found.predicted, axis=2)
    assert found.contributions.mean.sum() == pytest.approx(lengths[measurements.present].mean())
    np.testing.assert_allclose(found.contributions.by_observation.sum(axis=0), lengths.mean(axis=1))
