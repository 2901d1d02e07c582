"""Own weight: compliances, intervals and loads that join in; sag predicted and corrected."""

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
from support.springs import readings_of

from jointstiff.simulator import deflections, random_configurations
from jointstiff.simulator.base import SPRINGS, on_pedestal, standing
from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.simulator.own_weight import Bodies, sag
from jointstiff.solver.errors import MeasurementError, RequestError
from jointstiff.solver.fit.cone import Block
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.masses import (
    FreedMass,
    find_contradicted_mass,
    fit_freed_masses,
    report_unchecked_masses,
    widen_mass_bounds,
)
from jointstiff.solver.fit.weight_rows import Burden, linearise_readings
from jointstiff.solver.geometry.poses import PoseState, list_chain_axes, transform_points
from jointstiff.solver.mechanics.block import OwnWeight
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Body
from jointstiff.solver.own_weight.estimate import identify_weight
from jointstiff.solver.predict.forward import CorrectionLimits, compensate
from jointstiff.solver.predict.models import JointModel


def compliances(estimate):
    return np.array([joint.compliance or np.nan for joint in estimate.joints])


def intervals(estimate):
    return np.array([joint.compliance_interval or (np.nan, np.nan) for joint in estimate.joints])


def holds_the_truth(estimate):
    found = intervals(estimate)[1:]
    return ((found[:, 0] <= ARM.compliances[1:]) & (ARM.compliances[1:] <= found[:, 1])).all()


@pytest.fixture(scope="module")
def uncertain():
    """40 postures, true masses 8 % off, stated within ± 10 %."""
    return identify_weight(campaign(bodies=OFF, stated=burden_of(BODIES, 0.1), seed=4))


def test_wrong_geometry_of_every_link_costs_nothing():
    arm = with_link_errors(ARM, length=1e-3, angle=1e-3, seed=3)
    estimate = identify_weight(campaign(sigma=0.0, arm=arm))
    np.testing.assert_allclose(compliances(estimate)[1:5], ARM.compliances[1:5], rtol=4e-3)
    assert estimate.rms_residual < 1e-6


def test_uncertain_masses_leave_intervals_that_hold_the_truth(uncertain):
    assert holds_the_truth(uncertain)
    assert np.ptp(intervals(uncertain)[1]) / 2.0 <= 0.2 * ARM.compliances[1]
    assert uncertain.certificate.gap <= 1e-8
    assert not uncertain.reasons
    for joint in uncertain.joints[1:]:
        determined = joint.compliance_interval[0] > 0.0
        assert (joint.status == "identified") == (joint.reason is None) == determined


def test_an_uncertain_centre_of_mass_widens_the_intervals():
    near, far = (identify_weight(campaign(stated=burden_of(BODIES, 0.0, radius))) for radius in (0.005, 0.05))
    inner, outer = intervals(near)[1:], intervals(far)[1:]
    assert (outer[:, 0] < inner[:, 0]).all()
    assert (outer[:, 1] > inner[:, 1]).all()


def test_masses_far_from_the_truth_are_contradicted_by_a_payload():
    heavy = replace(BODIES, masses=1.4 * BODIES.masses)
    readings = campaign(bodies=heavy, stated=burden_of(BODIES, 0.05), payload=100.0)
    estimate = identify_weight(readings)
    assert [reason.code for reason in estimate.reasons] == ["masses_contradicted"]
    assert estimate.reasons[0].weight == "do_not_use"


@pytest.mark.parametrize(("link", "payload"), [(2, 0.0), (4, 100.0)])
def test_a_link_twice_as_heavy_as_stated_is_named_and_the_intervals_hold(link, payload):
    masses = BODIES.masses * np.where(np.arange(6) == link, 2.0, 1.0)
    heavy, stated = replace(BODIES, masses=masses), burden_of(BODIES, 0.1)
    estimate = identify_weight(campaign(bodies=heavy, stated=stated, payload=payload))
    (reason,) = estimate.reasons
    assert (reason.code, reason.weight) == ("masses_contradicted", "use_with_care")
    assert f"mass of link_{link + 1}:" in reason.message
    assert holds_the_truth(estimate)


def test_a_base_that_tilts_is_found_and_takes_nothing_from_the_joints():
    arm, none = on_pedestal(ARM, 8e6), np.zeros((SPRINGS, 3))
    bodies = Bodies(np.append(none[:, 0], BODIES.masses), np.vstack([none, BODIES.centres]))
    readings = campaign(stated=burden_of(BODIES, 0.1))
    q = standing(readings.poses.angles)
    points = arm.posture(q + sag(arm, bodies, q)).targets_to_base(POINTS)
    points = points + 3e-5 * np.random.default_rng(5).standard_normal(points.shape)
    estimate = identify_weight(replace(readings, poses=replace(readings.poses, points=points)))
    assert [reason.code for reason in estimate.reasons] == ["base_bends"]
    assert holds_the_truth(estimate)
    np.testing.assert_allclose(estimate.fit.base[:2], 1.0 / 8e6, rtol=0.5)
    assert np.sqrt(np.square(estimate.residual).mean()) < 4e-5


def test_a_mass_of_which_no_reading_tells_is_neither_checked_nor_contradicted():
    readings = campaign(postures=12, stated=burden_of(BODIES, 0.1))
    problem = identify_weight(readings).fit.reduced
    assert fit_freed_masses(problem, readings.burden, 1.0)
    squares, first = problem.convex.squares, problem.convex.cone.first
    by_joints = np.zeros(squares.R.shape)
    by_joints[:, first] = squares.R[:, first]
    convex = replace(problem.convex, squares=replace(squares, R=by_joints))
    freed = fit_freed_masses(replace(problem, convex=convex), readings.burden, 1.0)
    assert [each.uncertainty for each in freed] == [np.inf] * 5
    assert not any(each.change_if_doubled.any() for each in freed)
    assert find_contradicted_mass(freed) is None


@pytest.mark.parametrize("body", [1, 4])
def test_of_one_body_alone_its_weight_times_compliances_is_told_and_twice_its_mass_halves_them(body):
    """The sag is c m: no campaign tells c from m, and dc/c = -dm/m."""
    alone = replace(BODIES, masses=np.where(np.arange(6) == body, BODIES.masses, 0.0))
    stated = Burden((burden_of(BODIES, 0.1).bodies[body],), ())
    readings = campaign(bodies=alone, stated=stated)
    estimate = identify_weight(readings)
    (freed,) = fit_freed_masses(estimate.fit.reduced, stated, 1.0)
    assert freed.uncertainty == np.inf
    np.testing.assert_allclose(freed.change_if_doubled, -1.0, rtol=1e-6)
    remark = report_unchecked_masses(stated.bodies, [freed])
    assert f"do not check the mass of {stated.bodies[0].name}: " in remark.message
    assert "by up to 1e+02 %" in remark.message


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 3))])
def test_few_postures_that_do_not_tell_the_tilt_of_the_base_are_fitted_with_a_rigid_one(seed):
    readings = campaign(postures=6, stated=burden_of(BODIES, 0.1), seed=seed)
    estimate = identify_weight(readings)
    assert not estimate.fit.base.any()
    assert holds_the_truth(estimate)
    asked = identify_weight(readings, free_base=True)
    assert "base_unchecked" in [reason.code for reason in asked.reasons]
    np.testing.assert_array_equal(intervals(asked), intervals(estimate))


def test_gravity_may_be_estimated_where_the_tracker_is_not_levelled():
    tilted = np.array([0.02, -0.01, 0.0]) * 9.80665 + BODIES.gravity
    bodies = Bodies(BODIES.masses, BODIES.centres, tilted * 9.80665 / np.linalg.norm(tilted))
    readings = campaign(bodies=bodies, sigma=0.0)
    estimate = identify_weight(readings, free_gravity=True)
    np.testing.assert_allclose(estimate.fit.gravity, bodies.gravity, atol=1e-4)
    np.testing.assert_allclose(compliances(estimate)[1:], ARM.compliances[1:], rtol=1e-4)
    assert identify_weight(readings).rms_residual > 1e-6


def test_a_balancer_joins_by_its_attachment_points():
    readings = campaign(balancer=SPRING, stated=burden_of(BODIES, balancers=[stated_spring()]))
    estimate = identify_weight(readings)
    assert holds_the_truth(estimate)
    assert estimate.weight is None  # springs leave no sag to predict
    assert identify_weight(replace(readings, burden=burden_of(BODIES))).reasons


def pushed(along=(1.0, 1.0, 1.0)):
    """Return deflections by 15 known loads."""
    q = random_configurations(ARM, 15, seed=9)
    force = np.random.default_rng(3).standard_normal((15, 3)) * 800.0 * along
    before, after = deflections(ARM, q, force, np.zeros((15, 3)), LOAD_POINT, POINTS)
    noise = 3e-5 * np.sqrt(2.0) * np.random.default_rng(4).standard_normal(before.shape)
    return readings_of(q, force, LOAD_POINT, before, after - before + noise, sigma=3e-5)


def test_loaded_deflections_join_the_unloaded_positions():
    unloaded, loaded = campaign(stated=burden_of(BODIES, 0.1)), pushed()
    alone, both = identify_weight(unloaded), identify_weight(replace(unloaded, loaded=loaded))
    found = intervals(both)
    assert ((found[:, 0] <= ARM.compliances) & (ARM.compliances <= found[:, 1])).all()
    assert (np.ptp(found[1:], axis=1) < np.ptp(intervals(alone)[1:], axis=1)).all()
    with pytest.raises(MeasurementError, match="not all of their uncertainties"):
        identify_weight(replace(unloaded, loaded=replace(loaded, sigma=None)))


def test_readings_that_join_in_count_once_along_a_direction():
    unloaded, loaded = campaign(stated=burden_of(BODIES, 0.1)), pushed()
    oblique = replace(loaded, direction=np.full(loaded.position.shape, 3.0**-0.5))
    vectors, gauges = (
        identify_weight(replace(unloaded, loaded=each)).degrees_of_freedom for each in (loaded, oblique)
    )
    assert gauges == vectors - 2 * loaded.present.sum()


@pytest.mark.parametrize("joints", [(), (6,), (0, -1)])
def test_a_burden_that_is_none_is_refused(joints):
    readings, bodies = campaign(postures=5), [Body.within("link", j, 1.0, (0.0, 0.0, 0.0)) for j in joints]
    with pytest.raises(MeasurementError, match="belongs to none of the 6 joints"):
        replace(readings, burden=Burden(tuple(bodies)), carried=np.ones((5, len(joints))))
    with pytest.raises(MeasurementError, match="shape"):
        replace(readings, force=np.zeros((4, 3)))


def test_bounds_of_a_spring_are_in_order():
    for bounds in ((0.0, 1.0), (1.0, 1.0)):
        stated_spring(bounds, bounds)
    for bounds in ((2.0, 1.0), (-1.0, 1.0), (0.0, 0.0), (1.0, np.inf), (np.nan, 1.0)):
        for name in ("rate", "pull"):
            with pytest.raises(RequestError, match="in ascending order"):
                replace(stated_spring(), **{name: bounds})


def hung(readings, relative):
    """Return the same with a body of 100 kg in place of the force that its weight is."""
    at = Postures(ROBOT, np.zeros((1, 6)))
    rotations, origins = at.joint_frames
    arm = at.to_base(LOAD_POINT[None, None])[0, 0] - origins[0, -1]
    body = Body.within("payload", 5, 100.0, tuple(arm @ rotations[0, -1]), relative=relative)
    carried = np.column_stack([readings.carried, readings.force.any(axis=1)])
    burden = replace(readings.burden, bodies=(*readings.burden.bodies, body))
    return replace(readings, burden=burden, carried=carried, force=0.0 * readings.force)


def test_a_body_that_hangs_on_in_some_postures_is_the_force_of_its_weight():
    pulled = campaign(postures=8, payload=100.0)
    torques, hanging = rows_of(pulled).torques, rows_of(hung(pulled, 0.1)).torques
    for name in ("known", "base_moment"):
        np.testing.assert_allclose(getattr(hanging, name), getattr(torques, name), atol=1e-9)
    less = replace(pulled, force=0.9 * pulled.force)
    difference = torques.known - rows_of(less).torques.known
    np.testing.assert_allclose(difference, hanging.of_unknowns[..., 0], atol=1e-9)


def test_a_payload_of_uncertain_mass_widens_the_intervals():
    readings = campaign(postures=8, payload=100.0, stated=burden_of(BODIES, 0.05))
    exact, loose = (intervals(identify_weight(hung(readings, each)))[1:5] for each in (0.0, 0.3))
    assert (np.ptp(loose, axis=1) > 1.05 * np.ptp(exact, axis=1)).all()


def test_a_joint_that_known_loads_alone_twist_is_identified():
    """Vertical forces twist joint 6, which carries nothing, and not joint 1."""
    bodies = Bodies(BODIES.masses * (np.arange(6) < 5), BODIES.centres)
    stated = burden_of(Bodies(bodies.masses[:5], bodies.centres[:5]))
    unloaded = campaign(bodies=bodies, postures=12, stated=stated)
    found = identify_weight(replace(unloaded, loaded=pushed([0.0, 0.0, 1.0]))).joints
    assert [joint.status for joint in found[::5]] == ["not_observable", "identified"]
    assert np.prod(found[5].compliance_interval - ARM.compliances[5]) < 0.0


def test_a_mass_is_widened_by_two_standard_uncertainties():
    body = Body("arm", 1, 10.0, 9.0, 11.0, (0.0, 0.0, 0.0))
    for mass, bounds in ((5.0, (3, 11)), (20.0, (9, 22)), (1.0, (0, 11)), (10.0, (8, 12))):
        (wide,) = widen_mass_bounds((body,), FreedMass(0, mass, 1.0, 20.0, np.zeros(1)))
        assert (wide.least, wide.most) == bounds


SPRING_STATED = stated_spring((3e4, 3e4), (9e3, 9e3))
COUNT = 30


def rows_of(readings, theta=None):
    """Return the rows about the nominal geometry, at a sag of zero if None."""
    axes, flange = list_chain_axes(ROBOT.chain)
    theta = np.zeros(readings.poses.angles.shape) if theta is None else theta
    state = PoseState(axes, transform_points(flange, POINTS), np.zeros(len(theta)))
    return linearise_readings(readings, state, theta, theta[0])


@pytest.mark.parametrize("spring", [None, SPRING])
@pytest.mark.parametrize("payload", [0.0, 120.0])
def test_the_balance_of_the_solver_holds_where_the_simulator_rests(spring, payload):
    stated = burden_of(BODIES, balancers=[SPRING_STATED] if spring else [])
    readings = campaign(sigma=0.0, payload=payload, balancer=spring, stated=stated)
    q = readings.poses.angles
    theta = sag(ARM, BODIES, q, force=readings.force, load_point=readings.load_point, balancer=spring)
    flange_at = Postures(ROBOT, q + ARM.compliances * rows_of(readings, theta).torques.known)
    places = flange_at.to_base(np.broadcast_to(POINTS, (len(q), *POINTS.shape)))
    np.testing.assert_allclose(places, ARM.posture(q + theta).targets_to_base(POINTS), rtol=0, atol=1e-12)


FOREARM = Body("forearm", 3, 80.0, 70.0, 90.0, (0.4, 0.1, 0.2), radius=0.1)
LOOSE = replace(SPRING_STATED, rate=(2e4, 4e4), pull=(8e3, 1e4))


def test_a_centre_of_mass_counts_where_any_of_its_moments_acts():
    burden = Burden((FOREARM,))  # ± 10 kg of 80
    for acts, block, which in (
        ((1, 1, 0, 0), Block(1, ((0, 0.125),)), [0, 1, 2, 3]),
        ((0, 0, 0, 1), Block(0, ((-1, 0.0),)), [1, 2, 3]),
    ):
        assert burden.build_block(np.array(acts, dtype=bool)) == (block, which)


@pytest.mark.parametrize(
    ("column", "size", "body", "spring"),
    [  # in half-widths: 10 kg, 0.1 m of 80 kg, 1e4 N/m, 1e3 N
        (0, 0.2, replace(FOREARM, mass=82.0, least=72.0, most=92.0), LOOSE),
        (2, 0.5, replace(FOREARM, centre=(0.4, 0.15, 0.2)), LOOSE),
        (4, 0.01, FOREARM, replace(LOOSE, rate=(2.01e4, 4.01e4))),
        (5, 0.01, FOREARM, replace(LOOSE, pull=(8.01e3, 1.001e4))),
    ],
    ids=["mass", "centre", "rate", "pull"],
)
def test_torques_of_the_unknowns_at_their_bounds_are_differences_of_known_torques(column, size, body, spring):
    burdens = Burden((FOREARM,), (LOOSE,)), Burden((body,), (spring,))
    before, after = (rows_of(campaign(sigma=0.0, stated=burden)).torques for burden in burdens)
    np.testing.assert_allclose(after.known - before.known, size * before.of_unknowns[..., column], atol=1e-8)
    assert np.abs(after.known - before.known).max() > 1.0


def cases(load=0.0):
    q, still = random_configurations(ARM, COUNT, seed=91), np.zeros((COUNT, 3))
    point = np.tile(LOAD_POINT, (COUNT, 1))
    return LoadCases(q, np.tile([0.0, 0.0, -load], (COUNT, 1)), still, point, point)


def model_of(found):
    return JointModel(ROBOT, found.fit.compliance, None, Constraints(Bounds.positive(6)), found.weight)


def displaced(bodies, asked):
    """Return the displacement from the arm that does not bend, by the simulator."""
    theta = sag(ARM, bodies, asked.joints, force=asked.force, load_point=asked.load_point)
    there, here = (ARM.posture(q).point_to_base(asked.place) for q in (asked.joints + theta, asked.joints))
    return there - here


@pytest.mark.parametrize("load", [0.0, 900.0])
def test_exact_readings_and_masses_give_the_sag_exactly(load):
    readings = campaign(sigma=0.0)
    estimate, q = identify_weight(readings), readings.poses.angles
    bent, rigid = (ARM.posture(angles).targets_to_base(POINTS) for angles in (q + sag(ARM, BODIES, q), q))
    np.testing.assert_allclose(estimate.displacement, bent - rigid, rtol=0, atol=1e-6)
    found = model_of(estimate).deflect(cases(load))
    truth = displaced(BODIES, cases(load))
    assert np.linalg.norm(truth, axis=1).max() > 3e-3
    np.testing.assert_allclose(found.displacement, truth, rtol=0, atol=2e-8)


@pytest.fixture(scope="module")
def uncertain_centres():
    """40 postures, true masses 8 % off, stated within ± 10 %."""
    return identify_weight(campaign(bodies=OFF, stated=burden_of(BODIES, 0.1, 0.01), seed=4))


@pytest.mark.parametrize("load", [0.0, 900.0])
def test_positions_tell_the_sag_better_than_masses_and_compliances(uncertain_centres, load):
    found, truth = model_of(uncertain_centres).deflect(cases(load)), displaced(OFF, cases(load))
    interval = found.interval(0.95)[:, :3]
    assert ((interval[..., 0] <= truth) & (truth <= interval[..., 1])).mean() >= 0.9
    along = found.interval_along(np.tile([0.0, 0.0, 1.0], (COUNT, 1)), 0.95)
    np.testing.assert_allclose(along, interval[:, 2], rtol=0, atol=1e-15)
    if not load:
        off = np.linalg.norm(found.displacement - truth, axis=1)
        assert np.median(off) < 0.03 * np.median(np.linalg.norm(truth, axis=1))
        wide = np.ptp(uncertain_centres.joints[1].compliance_interval) / uncertain_centres.fit.compliance[1]
        assert np.median(np.ptp(interval[:, 2], axis=1)) < 0.5 * wide * np.abs(truth[:, 2]).max()


def test_a_corrected_command_brings_the_bent_arm_to_absolute_places(uncertain_centres):
    wanted = cases(900.0)
    found = compensate(model_of(uncertain_centres), wanted, CorrectionLimits(displacement=1.0, rotation=1.0))
    assert np.abs(found.residual).max() < 1e-12
    reached = displaced(OFF, replace(wanted, joints=found.commanded))
    reached += ARM.posture(found.commanded).point_to_base(wanted.place)
    off = np.linalg.norm(reached - ARM.posture(wanted.joints).point_to_base(wanted.place), axis=1)
    before = np.linalg.norm(found.uncorrected[:, :3], axis=1)
    assert np.median(off) < 0.05 * np.median(before)


def test_a_joint_of_whose_sag_nothing_is_told_leaves_no_prediction(uncertain_centres):
    assert not model_of(uncertain_centres).deflect(cases()).unseen.any()  # joint 1 carries no weight
    hidden = uncertain_centres.weight.root.reshape(-1, uncertain_centres.weight.root.shape[1]).copy()
    hidden[1] = 0.0
    hidden[6 + 24 : 6 + 48] = 0.0
    model = replace(model_of(uncertain_centres), weight=replace(uncertain_centres.weight, root=hidden))
    unseen = model.deflect(cases()).unseen
    assert unseen[:, 1].mean() > 0.9
    assert not np.delete(unseen, 1, axis=1).any()
    with pytest.raises(RequestError, match="do not determine"):
        compensate(model, cases())


def test_masses_that_joints_feel_differently_have_the_stiffness_of_their_torques():
    draws = np.random.default_rng(5)
    weight = OwnWeight(draws.uniform(10.0, 100.0, (6, 6)), draws.standard_normal((6, 6, 3)))
    q, step = cases().joints, 1e-6

    def torque(angles):
        return weight.torque_and_stiffness(ROBOT, Postures(ROBOT, angles))[0]

    stiffness = weight.torque_and_stiffness(ROBOT, Postures(ROBOT, q))[1]
    slopes = [(torque(q + step * e) - torque(q - step * e)) / (2.0 * step) for e in np.eye(6)]
    np.testing.assert_allclose(stiffness, np.stack(slopes, axis=-1), atol=1e-5)
