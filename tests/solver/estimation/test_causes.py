"""Screening of springs and beams that balance the load exactly; contributions beside levers by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import estimate, first_target, only_deflections, prepare

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.elastic_links import ElasticArm, beam_arm, elastic_campaign
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.solver.errors import RequestError
from jointstiff.solver.estimation.causes import LINKS_LEVEL, MISTAKE_LEVEL, fit_causes, screen_estimate
from jointstiff.solver.mechanics.measurements import DifferenceNoise, Instrument
from jointstiff.solver.text import stiffness_text, unknowns_text


def screened(robot, measurements, k_c="included"):
    fit = estimate(robot, measurements, complementary_stiffness=k_c)
    return screen_estimate(robot, measurements, fit)


def springs(seed, load="pull", **options):
    return prepare(simulate_campaign(default_arm(), load=load, seed=seed, **options))


def beams(seed, softness=1.0, **options):
    elastic = beam_arm(default_arm())
    soft = ElasticArm(elastic.arm, softness * elastic.links)
    return prepare(elastic_campaign(soft, seed=seed, **options))


def named(screening):
    return [(cause.suspect.name, cause.suspect.first) for cause in screening.causes]


class TestClean:
    @pytest.mark.parametrize("load", ["pull", "dead_weight"])
    def test_springs_alone_are_accused_of_nothing(self, load):
        for seed in range(0, 12, 3):
            robot, measurements = springs(seed, load, configurations=10 + 3 * seed)
            for clean in (measurements, replace(only_deflections(measurements), sigma=None)):
                screening = screened(robot, clean)
                assert not screening.causes
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
        assert not screening.causes
        assert not screening.links_speak

    def test_too_few_readings_tell_nothing(self):
        robot, measurements = springs(1, configurations=4)
        assert not screened(robot, first_target(measurements), "neglected").lack_of_fit


class TestLoad:
    @pytest.mark.parametrize("load", ["pull", "dead_weight"])
    @pytest.mark.parametrize("offset", [0.05, 0.15])
    def test_a_load_point_elsewhere_is_proved_and_found(self, load, offset):
        for seed in range(2):
            robot, measurements = springs(seed, load, configurations=30)
            direction = np.random.default_rng(seed).standard_normal(3)
            moved = offset * direction / np.linalg.norm(direction)
            wrong = replace(measurements, load_point=measurements.load_point + moved)
            screening = screened(robot, wrong)
            assert not screening.links_speak
            (cause,) = screening.causes
            assert cause.suspect.name == "load_point"
            assert cause.p_value < MISTAKE_LEVEL
            assert screening.proved
            # Pulls tell the point to a centimetre, a dead weight hardly across itself.
            assert np.linalg.norm(cause.unknowns + moved) < (0.02 if load == "pull" else 0.5 * offset)
            beside = fit_causes(robot, wrong, named(screening))
            found = estimate(robot, beside, complementary_stiffness="included")
            u = np.sqrt(np.maximum(np.diag(found.covariance), 1e-30))
            seen = found.estimated
            assert (np.abs(found.compliance - default_arm().compliances)[seen] < 4 * u[seen]).all()

    def test_exact_readings_tell_the_load_point_exactly(self):
        """150 mm is far for one step of Gauss and Newton: the steps go on until it stands still."""
        robot, measurements = springs(0, configurations=30, sigma=0.0)
        moved = np.array([0.15, -0.05, 0.1])
        wrong = replace(measurements, load_point=measurements.load_point + moved)
        (cause,) = screened(robot, wrong).causes
        np.testing.assert_allclose(cause.unknowns, -moved, atol=1e-6)

    @pytest.mark.parametrize("force", [100.0, 300.0])
    def test_a_forgotten_payload_is_proved_and_found(self, force):
        for seed in range(2):
            robot, measurements = springs(seed, configurations=30)
            payload = np.array([0.0, 0.0, -force])
            screening = screened(robot, replace(measurements, force=measurements.force - payload))
            (cause,) = screening.causes
            assert cause.suspect.name == "constant_force"
            np.testing.assert_allclose(cause.unknowns, payload, atol=25.0)
            assert not screening.links_speak

    @pytest.mark.parametrize("turn", [0.0, 5e-5])
    @pytest.mark.parametrize(("load", "first"), [("pull", 8), ("dead_weight", 0)])
    def test_a_tracker_that_moved_is_named_or_in_a_tie(self, load, turn, first):
        """It moved by 0.1 mm, or turned, too, between the unloaded and the loaded readings of a row."""
        for seed in range(2):
            robot, measurements = springs(seed, load, configurations=20)
            shift, axis = np.random.default_rng(seed).standard_normal((2, 3))
            moved = 1e-4 * shift / np.linalg.norm(shift) + turn * np.cross(axis, measurements.position)
            moved = np.where(np.arange(20)[:, None, None] >= first, moved, 0.0)
            wrong = replace(measurements, deflection=measurements.deflection + moved)
            found = named(screened(robot, wrong))
            assert {"shift", "turn"} & {name for name, _ in found}, found

    def test_play_in_the_gears_is_named_and_measured(self):
        """The simulator turns each joint on by 0.15 mrad to the side that the load pushes it."""
        arm, play = default_arm(), 1.5e-4
        robot, measurements = springs(6, configurations=30)
        load = measurements.force, measurements.moment, measurements.load_point
        places = measurements.position[0] - arm.posture(measurements.joints[0]).flange_translation
        places = places @ arm.posture(measurements.joints[0]).flange_rotation
        bent = measurements.joints + equilibrium(arm, measurements.joints, *load)
        further = play * np.sign(bent - measurements.joints)
        before, after = (arm.posture(q).targets_to_base(places) for q in (bent, bent + further))
        wrong = replace(measurements, deflection=measurements.deflection + after - before)
        screening = screened(robot, wrong)
        (cause,) = screening.causes
        assert cause.suspect.name == "play"
        # The pulls hardly twist the last two joints.
        np.testing.assert_allclose(cause.unknowns[:4], 2.0 * play, rtol=0.2)
        found = estimate(robot, fit_causes(robot, wrong, named(screening)))
        u = np.sqrt(np.diag(found.covariance))
        assert (np.abs(found.compliance - arm.compliances) < 3 * u).all()

    def test_a_noise_of_the_wrong_shape_accuses_nothing(self):
        """A data sheet says 7 µm along the line of sight and 30 across; the noise is 20 µm anywhere."""
        sheet = Instrument((4.0, 1.0, 1.5), 3e-6, 1e-6, 1e-5, 5e-6)
        for seed in range(3):
            robot, measurements = springs(seed, configurations=20)
            noise = DifferenceNoise.by(sheet, robot, measurements)
            stated = replace(measurements, sigma=noise.sigma, covariance=noise.covariance)
            screening = screened(robot, stated)
            assert not screening.causes
            assert not screening.links_speak

    @pytest.mark.parametrize("row", [0, 10, 17, 18, 19])
    def test_one_wrong_posture_is_no_tracker_that_moved(self, row):
        """Half a millimetre off, in one observation of 20."""
        for seed in range(2):
            robot, measurements = springs(seed, configurations=20)
            wrong = measurements.deflection.copy()
            wrong[row] += [3e-4, 0.0, -4e-4]
            found = named(screened(robot, replace(measurements, deflection=wrong)))
            assert found == [], seed

    def test_causes_that_hold_each_other_are_fitted_as_one(self):
        """A turn holds a shift: both together leave nothing that could not be told."""
        robot, measurements = springs(4, configurations=20)
        moved = replace(measurements, deflection=np.add(measurements.deflection, [1e-4, 0.0, 0.0]))
        beside = fit_causes(robot, moved, [("shift", None), ("turn", None)])
        assert [term.name for term in beside.common_uncertainty.fitted.terms] == ["turn"]
        found = estimate(robot, beside, complementary_stiffness="included")
        u = np.sqrt(np.diag(found.covariance))
        assert (np.abs(found.compliance - default_arm().compliances) < 3 * u).all()

    def test_a_cause_that_the_readings_cannot_show_is_refused(self):
        robot, measurements = springs(1)
        for unknown in (("ghost", None), ("shift", "no such label")):
            with pytest.raises(RequestError, match=unknown[1] or unknown[0]):
                fit_causes(robot, measurements, [unknown])


@pytest.mark.parametrize(
    ("unit", "values", "text"),
    [
        ("m", [0.0, 2e-3, 1e-4], "(0, 2, 0.1) mm"),
        ("m, rad", [1e-4, -2e-4, 0.0, 2e-6, 0.0, 0.0], "(100, -200, 0) µm and (2, 0, 0) µrad"),
        ("rad", [np.radians(0.5)], "(30) arcmin"),
        ("1", [0.02], "(2) %"),
    ],
)
def test_unknowns_are_said_in_units_of_their_size(unit, values, text):
    assert unknowns_text(unit, values) == text


class TestLinks:
    @pytest.mark.parametrize(
        ("softness", "configurations"),
        [
            (2.0, 20),
            (0.1, 40),
        ],
    )
    def test_beams_speak(self, configurations, softness):
        for seed in range(2):
            robot, measurements = beams(seed, softness, configurations=configurations)
            screening = screened(robot, measurements)
            assert screening.links_speak
            assert screening.lack_of_fit
            assert not screening.proved


@pytest.mark.parametrize(
    ("stiffness", "kind", "text"),
    [
        (6543.0, "revolute", "6543 N·m/rad"),
        (9999.9, "revolute", "0.01 · 10⁶ N·m/rad"),
        (2.01e7, "prismatic", "20.1 N/µm"),
        (999.9e6, "revolute", "1 · 10⁹ N·m/rad"),
        (9.999e9, "revolute", "1 · 10¹⁰ N·m/rad"),
        (-3e12, "revolute", "-3 · 10¹² N·m/rad"),
    ],
)
def test_the_unit_of_a_stiffness_suits_what_is_printed(stiffness, kind, text):
    assert stiffness_text(stiffness, kind) == text
