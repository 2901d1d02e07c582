"""Screening of springs and beams that balance the load exactly: what it accuses, and what it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import estimate, first_target, only_deflections, prepare
from support.shared_data import shared

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.elastic_links import ElasticArm, beam_arm, elastic_campaign
from jointstiff.solver.evidence.causes import LINKS_LEVEL, MISTAKE_LEVEL, Screening, screen_estimate
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot


def screened(robot: Robot, measurements: Measurements, k_c="included") -> Screening:
    fit = estimate(robot, measurements, complementary_stiffness=k_c)
    return screen_estimate(robot, measurements, fit)


def springs(seed: int, load: str = "pull", **options) -> tuple[Robot, Measurements]:
    return prepare(simulate_campaign(default_arm(), load=load, seed=seed, **options))


def beams(seed: int, softness: float = 1.0, **options) -> tuple[Robot, Measurements]:
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
            mistake = screened(robot, wrong).mistake
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

    def test_a_load_point_is_not_taken_for_links(self):
        robot, measurements = springs(5, configurations=30)
        wrong = replace(measurements, load_point=measurements.load_point + np.array([0.0, 0.15, 0.0]))
        screening = screened(robot, wrong)
        assert screening.links_p_value < LINKS_LEVEL
        assert not screening.links_speak


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
