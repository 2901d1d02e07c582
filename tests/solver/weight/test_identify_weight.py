"""Compliances from own weight: exact campaigns, intervals, what cannot be told, loads that join in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.sagging import (
    ARM,
    BODIES,
    LOAD_POINT,
    OFF,
    POINTS,
    ROBOT,
    SPRING,
    burden_of,
    campaign,
    stated_spring,
)

from jointstiff.simulator import TARGETS, deflections, random_configurations
from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.simulator.own_weight import Bodies
from jointstiff.solver.errors import MeasurementError, NotObservableError
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Body
from jointstiff.solver.weight.bodies import Burden
from jointstiff.solver.weight.identification import identify_weight


def compliances(estimate):
    return np.array([joint.joint.compliance or np.nan for joint in estimate.joints])


def intervals(estimate):
    return np.array([joint.joint.compliance_interval or (np.nan, np.nan) for joint in estimate.joints])


def holds_the_truth(estimate):
    found = intervals(estimate)[1:]
    return ((found[:, 0] <= ARM.compliances[1:]) & (ARM.compliances[1:] <= found[:, 1])).all()


@pytest.fixture(scope="module")
def uncertain():
    """40 postures, true masses 8 % off, stated within ± 10 %."""
    return identify_weight(ROBOT, campaign(bodies=OFF, stated=burden_of(BODIES, 0.1), seed=4))


def test_exact_readings_and_masses_give_the_compliances():
    estimate = identify_weight(ROBOT, campaign(sigma=0.0))
    np.testing.assert_allclose(compliances(estimate)[1:], ARM.compliances[1:], rtol=2e-6)
    assert estimate.certificate.gap <= 1e-8
    assert estimate.rms_residual < 1e-9 < 1e-4 < estimate.rms_without_sag


def test_wrong_geometry_of_every_link_costs_nothing():
    arm = with_link_errors(ARM, length=1e-3, angle=1e-3, seed=3)
    estimate = identify_weight(ROBOT, campaign(sigma=0.0, arm=arm))
    np.testing.assert_allclose(compliances(estimate)[1:5], ARM.compliances[1:5], rtol=4e-3)
    assert estimate.rms_residual < 1e-6


def test_uncertain_masses_leave_intervals_that_hold_the_truth(uncertain):
    assert holds_the_truth(uncertain)
    assert np.ptp(intervals(uncertain)[1]) / 2.0 <= 0.2 * ARM.compliances[1]
    assert uncertain.certificate.gap <= 1e-8
    assert not uncertain.reasons


def test_shares_say_what_an_interval_is_due_to(uncertain):
    shares = {joint.joint.name: joint.share_of_masses for joint in uncertain.joints[1:]}
    assert shares["joint_2"] > 0.7 > shares["joint_4"]
    exact = identify_weight(ROBOT, campaign(seed=4))
    assert all(joint.share_of_readings == pytest.approx(1.0) for joint in exact.joints[1:])


def test_the_first_joint_of_a_floor_mounted_arm_cannot_be_told(uncertain):
    joint = uncertain.joints[0].joint
    assert joint.status == "not_observable"
    assert "vertical axis" in joint.reason


def test_an_uncertain_centre_of_mass_widens_the_intervals():
    near, far = (
        identify_weight(ROBOT, campaign(stated=burden_of(BODIES, 0.0, radius))) for radius in (0.005, 0.05)
    )
    inner, outer = intervals(near)[1:], intervals(far)[1:]
    assert (outer[:, 0] < inner[:, 0]).all()
    assert (outer[:, 1] > inner[:, 1]).all()


def test_a_known_payload_as_second_state_at_least_halves_the_widths(uncertain):
    both = campaign(bodies=OFF, stated=burden_of(BODIES, 0.1), seed=4, payload=100.0)
    alone, with_payload = (
        np.ptp(intervals(each)[1:], axis=1) for each in (uncertain, identify_weight(ROBOT, both))
    )
    assert (with_payload <= 0.5 * alone).all()


def test_a_payload_may_be_a_body_of_uncertain_mass():
    readings = campaign(payload=100.0)
    place = ARM.flange_rotation @ LOAD_POINT + ARM.flange_translation - ARM.axis_points[-1]
    tool = Body.within("payload", 5, 95.0, tuple(place.tolist()), relative=0.1)
    burden = replace(readings.burden, bodies=(*readings.burden.bodies, tool))
    carried = np.column_stack([readings.carried, np.repeat([0.0, 1.0], 40)])
    stated = replace(readings, burden=burden, carried=carried, force=np.zeros((80, 3)))
    assert holds_the_truth(identify_weight(ROBOT, stated))


def test_masses_far_from_the_truth_are_contradicted_by_a_payload():
    heavy = replace(BODIES, masses=1.4 * BODIES.masses)
    readings = campaign(bodies=heavy, stated=burden_of(BODIES, 0.05), payload=100.0)
    estimate = identify_weight(ROBOT, readings)
    assert [reason.code for reason in estimate.reasons] == ["masses_contradicted"]
    assert estimate.reasons[0].weight == "do_not_use"


def test_residuals_beyond_sigma_are_said_and_widen_the_intervals():
    readings = campaign(sigma=9e-5)
    stated = replace(readings, poses=replace(readings.poses, sigma=3e-5))
    estimate = identify_weight(ROBOT, stated)
    assert [reason.code for reason in estimate.reasons] == ["residuals_exceed_sigma"]
    assert estimate.sigma == pytest.approx(9e-5, rel=0.1)
    unknown = identify_weight(ROBOT, replace(readings, poses=replace(readings.poses, sigma=None)))
    np.testing.assert_allclose(intervals(unknown), intervals(estimate), rtol=1e-6)


def test_gravity_may_be_estimated_where_the_tracker_is_not_levelled():
    tilted = np.array([0.02, -0.01, 0.0]) * 9.80665 + BODIES.gravity
    bodies = Bodies(BODIES.masses, BODIES.centres, tilted * 9.80665 / np.linalg.norm(tilted))
    readings = campaign(bodies=bodies, sigma=0.0)
    estimate = identify_weight(ROBOT, readings, free_gravity=True)
    np.testing.assert_allclose(estimate.fit.gravity, bodies.gravity, atol=1e-4)
    np.testing.assert_allclose(compliances(estimate)[1:], ARM.compliances[1:], rtol=1e-4)
    assert identify_weight(ROBOT, readings).rms_residual > 1e-6


def test_a_balancer_joins_by_its_attachment_points():
    readings = campaign(balancer=SPRING, stated=burden_of(BODIES, balancers=[stated_spring()]))
    estimate = identify_weight(ROBOT, readings)
    assert holds_the_truth(estimate)
    assert estimate.weight is None  # springs leave no sag to predict
    assert identify_weight(ROBOT, replace(readings, burden=burden_of(BODIES))).reasons


def pushed():
    """Return deflections by 15 known loads."""
    q = random_configurations(ARM, 15, seed=9)
    force = np.random.default_rng(3).standard_normal((15, 3)) * 800.0
    before, after = deflections(ARM, q, force, np.zeros((15, 3)), LOAD_POINT, POINTS)
    noise = 3e-5 * np.sqrt(2.0) * np.random.default_rng(4).standard_normal(before.shape)
    return Measurements(
        joints=q,
        force=force,
        moment=np.zeros((15, 3)),
        load_point=np.tile(LOAD_POINT, (15, 1)),
        position=before,
        in_flange=np.zeros((15, len(TARGETS)), dtype=bool),
        deflection=after - before + noise,
        present=np.ones((15, len(TARGETS)), dtype=bool),
        sigma=3e-5,
    )


def test_loaded_deflections_join_the_unloaded_positions():
    unloaded, loaded = campaign(stated=burden_of(BODIES, 0.1)), pushed()
    alone, both = identify_weight(ROBOT, unloaded), identify_weight(ROBOT, unloaded, loaded=loaded)
    found = intervals(both)
    assert ((found[:, 0] <= ARM.compliances) & (ARM.compliances <= found[:, 1])).all()
    assert (np.ptp(found[1:], axis=1) < np.ptp(intervals(alone)[1:], axis=1)).all()
    with pytest.raises(MeasurementError, match="not all of their uncertainties"):
        identify_weight(ROBOT, unloaded, loaded=replace(loaded, sigma=None))


def test_readings_that_join_in_count_once_along_a_direction():
    unloaded, loaded = campaign(stated=burden_of(BODIES, 0.1)), pushed()
    oblique = replace(loaded, direction=np.full(loaded.position.shape, 3.0**-0.5))
    vectors, gauges = (
        identify_weight(ROBOT, unloaded, loaded=each).degrees_of_freedom for each in (loaded, oblique)
    )
    assert gauges == vectors - 2 * loaded.present.sum()


def test_postures_that_do_not_determine_the_geometry_are_refused():
    readings = campaign(postures=3)
    with pytest.raises(NotObservableError):
        identify_weight(ROBOT, readings)


def test_a_burden_that_is_none_is_refused():
    readings = campaign(postures=5)
    with pytest.raises(MeasurementError, match="on none of the 6 joints"):
        replace(
            readings, burden=Burden((Body.within("link", 6, 1.0, (0.0, 0.0, 0.0)),)), carried=np.ones((5, 1))
        )
    with pytest.raises(MeasurementError, match="shape"):
        replace(readings, force=np.zeros((4, 3)))
