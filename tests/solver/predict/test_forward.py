"""Predicted deflections and compensation beside exact springs, and the error of the model."""

from dataclasses import replace

import numpy as np
import pytest
from support.calibrated_arms import arm
from support.campaigns import estimate, prepare, shared
from support.springs import SIGMA, SpringCampaign, load_cases, robot_of

from jointstiff.schemas.options import CrossValidation
from jointstiff.schemas.robot import DhRow
from jointstiff.simulator import TARGETS, default_arm, equilibrium, torques
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign, elastic_deflections
from jointstiff.solver.choice.held_out import Folds
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.estimate import PostureJackknife, UncertaintyBudget
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.reduced import Candidate
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.block import OwnWeight
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.chain import chain_dh_rows
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import Postures, flange_poses
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.models import Columns, find_model
from jointstiff.solver.predict import models
from jointstiff.solver.predict.answers import STATUSES, MapTask, compute_tool_rotations, map_places
from jointstiff.solver.predict.forward import CorrectionLimits, compensate, compute_ramp_shares
from jointstiff.solver.predict.models import (
    MOST_STEPS,
    ElasticPredictor,
    JointModel,
    ModelError,
    estimate_error_by_leaving_postures_out,
    merge_score_steps,
)

ARM = default_arm()
ROBOT = robot_of(ARM)
COUNT = 6
POSITIVE = Constraints(Bounds.positive(6))
MODEL = JointModel(ROBOT, ARM.compliances, None, POSITIVE)
ANY = CorrectionLimits(1.0, 1.0)


def cases(count=COUNT, **options):
    return load_cases(ARM, count, **{"force": 1500.0, "moment": 0.0, "seed": 0} | options)


def exact_pose(joints, load, force, moment):
    """Place (B, 3) and axes (B, 3, 3) of the flange in the exact balance."""
    posture = ARM.posture(joints + equilibrium(ARM, joints, force, moment, load.load_point))
    return posture.point_to_base(load.place), posture.flange_rotation


def still_pose(load):
    """Return the same of the arm that does not bend."""
    posture = ARM.posture(load.joints)
    return posture.point_to_base(load.place), posture.flange_rotation


def rotation_between(first, second):
    """Rotation vectors by the logarithm of a quaternion-free formula, for small angles."""
    R = second @ np.swapaxes(first, -1, -2)
    w = 0.5 * np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=-1)
    sine = np.linalg.norm(w, axis=1, keepdims=True)
    return w * np.arcsin(sine) / sine


@pytest.mark.parametrize("moment", [0.0, 200.0])
def test_displacement_and_rotation_are_those_of_the_exact_balance(moment):
    load = cases(moment=moment)
    found = MODEL.deflect(load)
    before, axes = still_pose(load)
    after, turned = exact_pose(load.joints, load, load.force, load.moment)
    np.testing.assert_allclose(found.displacement, after - before, rtol=0, atol=2e-14)
    np.testing.assert_allclose(found.rotation, rotation_between(axes, turned), rtol=0, atol=2e-14)
    assert found.interval(0.95) is None
    assert not found.unseen.any()


@pytest.mark.parametrize("moment", [0.0, 200.0])
def test_compliance_is_the_difference_of_exact_balances(moment):
    """At the load point, where a further force is part of the same dead wrench."""
    load = cases(moment=moment)
    load = replace(load, place=load.load_point)
    found = MODEL.deflect(load).compliance

    def differences(step):
        columns = []
        for k in range(6):
            size = step if k < 3 else step / 3
            unit = size * np.eye(6)[k]
            ends = [
                exact_pose(load.joints, load, load.force + s * unit[:3], load.moment + s * unit[3:])
                for s in (1, -1)
            ]
            moved = np.concatenate(
                [ends[0][0] - ends[1][0], rotation_between(ends[1][1], ends[0][1])], axis=1
            )
            columns.append(moved / (2 * size))
        return np.stack(columns, axis=-1)

    expected = (4 * differences(60.0) - differences(120.0)) / 3  # the error of h² cancels
    scale = np.abs(expected).max(axis=(0, 2), keepdims=True)
    assert (np.abs(found.matrix - expected) / scale).max() <= 1e-8
    asymmetry = np.abs(found.matrix - np.swapaxes(found.matrix, 1, 2)).max()
    assert found.symmetric.all() == (moment == 0.0)
    assert (asymmetry < 1e-18) == (moment == 0.0)


def test_the_three_stiffnesses_are_what_their_names_say():
    """Springs that block what each blocks, tried out on the compliance; and their order."""
    load = cases()
    found = MODEL.deflect(load).compliance
    u = load.force / np.linalg.norm(load.force, axis=1, keepdims=True)
    free, lateral = found.stiffness_lateral_free(u), found.stiffness_lateral_blocked(u)
    rotation = found.stiffness_rotation_blocked(u)
    for b in range(COUNT):
        across = np.linalg.svd(u[b][None])[2][1:]
        blocked = [np.r_[row, 0, 0, 0] for row in across]
        turned = [*blocked, *np.eye(6)[3:]]
        for stiffness, held in ((free[b], []), (lateral[b], blocked), (rotation[b], turned)):
            springs = 1e16 * sum((np.outer(row, row) for row in held), np.zeros((6, 6)))
            C = found.matrix[b]
            moved = np.linalg.solve(np.eye(6) + C @ springs, C @ np.r_[u[b], 0, 0, 0])
            assert 1.0 / (u[b] @ moved[:3]) == pytest.approx(stiffness, rel=1e-5)
    assert (free <= lateral).all()
    assert (lateral <= rotation).all()


def test_rigid_joints_have_a_compliance_and_no_endless_numbers():
    rigid = replace(ARM, stiffnesses=np.where([0, 1, 1, 0, 1, 0], ARM.stiffnesses, np.inf))
    found = replace(MODEL, compliance=rigid.compliances).deflect(cases()).compliance
    assert np.isfinite(found.matrix).all()
    u = np.tile([1.0, 0.0, 0.0], (COUNT, 1))
    assert np.isfinite(found.stiffness_lateral_free(u)).all()
    assert np.isinf(found.stiffness_rotation_blocked(u)).all()  # three springs cannot give six freedoms


def test_own_weight_is_a_load_that_moves_with_the_links():
    """A mass on the flange is a dead force there, whose change alone counts; one on link 3 as well."""
    load = cases()
    centre = np.zeros((6, 3))
    mass = np.array([0, 0, 0, 0, 0, 40.0])
    rotation, origin = Postures(ROBOT, load.joints).joint_frames
    posture = ARM.posture(load.joints)
    tool = posture.point_to_base(load.load_point)
    centre[5] = np.swapaxes(rotation[0, 5], 0, 1) @ (tool[0] - origin[0, 5])
    weight = OwnWeight(mass, centre)
    found = replace(MODEL, weight=weight).deflect(load)
    pull = np.broadcast_to([0.0, 0.0, -40.0 * 9.80665], (COUNT, 3))
    still = np.zeros((COUNT, 3))
    # The same springs, whose rest is where the weight alone keeps the robot in q: q₀ = q − c ∘ g(q).
    rest = load.joints - ARM.compliances * torques(ARM, load.joints, pull, still, load.load_point)
    loaded = rest + equilibrium(ARM, rest, load.force + pull, still, load.load_point)
    expected = ARM.posture(loaded).point_to_base(load.place) - posture.point_to_base(load.place)
    np.testing.assert_allclose(found.displacement, expected, rtol=0, atol=2e-14)
    without = MODEL.deflect(load)
    assert np.abs(without.displacement - found.displacement).max() > 1e-7


def test_the_length_of_a_displacement_has_an_uncertainty_by_source():
    """Beside differences of exact balances in which one joint is softer by a tenth of a per mille."""
    load = cases()
    found = MODEL.deflect(load)
    step = 1e-4 * ARM.compliances
    covariances = np.stack([np.outer(step, step), np.diag(step**2), np.zeros((6, 6))])
    lengths = [
        np.linalg.norm(replace(MODEL, compliance=ARM.compliances + change).deflect(load).displacement, axis=1)
        for change in (*np.diag(step), step, 0.0 * step)
    ]
    changes = np.array(lengths[:-1]) - lengths[-1]
    expected = np.stack([np.abs(changes[6]), np.linalg.norm(changes[:6], axis=0), 0.0 * changes[6]], axis=1)
    np.testing.assert_allclose(found.length_uncertainties(covariances), expected, rtol=1e-3, atol=1e-18)


@pytest.mark.parametrize("across", [0.0, 1.0])
def test_a_load_that_cancels_the_spring_is_refused_by_its_case(across):
    """A push of k/a along an arm of length a: I − diag(c) K_c is exactly singular, by powers of two."""
    compliance = 2.0**-20
    robot = Robot(chain_dh_rows([DhRow(a=1.0, alpha=0.0, d=0.0, theta=0.0)], "standard", "arm").model())
    model = JointModel(robot, np.array([compliance]), None, Constraints(Bounds.positive(1)))
    force = np.array([[0.0, 100.0, 0.0], [-1.0 / compliance, across, 0.0]])
    still = np.zeros((2, 3))
    load = LoadCases(np.zeros((2, 1)), force, still, still, still)
    with pytest.raises(RequestError, match="no stable equilibrium") as caught:
        model.deflect(load)
    assert caught.value.where == "cases[1]"
    assert model.find_overloads(load, Postures(robot, load.joints)).tolist() == [False, True]


class TestIdentified:
    """Models from readings."""

    design = SpringCampaign.of(ARM)

    def model(self, measurements=None, **options):
        if measurements is None:
            measurements = self.design.measurements(self.design.unloaded, self.design.loaded, sigma=SIGMA)
        found = estimate(ROBOT, measurements, complementary_stiffness="included", **options)
        return JointModel.from_estimate(
            ROBOT, found, POSITIVE if options.get("positive", True) else Constraints(Bounds.unconstrained(6))
        )

    @pytest.mark.parametrize("draws", [40, pytest.param(150, marks=pytest.mark.slow)])
    def test_intervals_hold_the_truth(self, draws):
        load = cases(seed=3)
        truth, held = MODEL.deflect(load).motion, []
        for measurements in self.design.measured(draws, seed=5):
            ends = self.model(measurements).deflect(load).interval(0.95)
            held.append((ends[..., 0] <= truth) & (truth <= ends[..., 1]))
        assert abs(np.mean(held) - 0.95) <= 1.7 * np.sqrt(0.95 * 0.05 / draws)

    def test_an_unseen_joint_is_named_where_the_load_twists_it(self):
        plan = self.design.experiment
        down = np.broadcast_to([0.0, 0.0, -1500.0], plan.forces.shape)
        still = np.zeros_like(down)
        loaded = plan.joints + equilibrium(ARM, plan.joints, down, still, plan.load_points)
        points = np.array(list(TARGETS.values()))
        readings = [ARM.posture(q).targets_to_base(points) for q in (plan.joints, loaded)]
        model = self.model(replace(self.design.measurements(*readings, sigma=SIGMA), force=down))
        load = cases()
        assert model.deflect(load).unseen[:, 0].all()
        dead = replace(load, force=np.tile([0.0, 0.0, -900.0], (COUNT, 1)))
        assert not model.deflect(dead).unseen.any()
        last = replace(dead, force=np.vstack([dead.force[1:], load.force[:1]]))
        with pytest.raises(RequestError, match="twists joint_1, but the readings do not determine"):
            compensate(model, last, ANY)

    @pytest.mark.parametrize("draws", [40, pytest.param(150, marks=pytest.mark.slow)])
    def test_the_worst_direction_is_uncertain_as_the_readings_make_it(self, draws):
        load = cases()
        found = [self.model(m).deflect(load).compliance.worst for m in self.design.measured(draws, seed=2)]
        most = 3.4 / np.sqrt(2.0 * draws)
        spread = np.std([worst.compliance for worst in found], axis=0)
        stated = np.mean([worst.compliance_uncertainty for worst in found], axis=0)
        np.testing.assert_allclose(spread / stated, 1.0, atol=most)
        truth = MODEL.deflect(load).compliance.worst.direction
        cosine = [np.abs((worst.direction * truth).sum(axis=1)) for worst in found]
        angle = np.sqrt(np.mean(np.square(np.arccos(np.minimum(cosine, 1.0))), axis=0))
        stated = np.mean([worst.direction_uncertainty for worst in found], axis=0)
        np.testing.assert_allclose(angle / stated, 1.0, atol=most)


POINTS = 40


def path(force=1500.0):
    point = np.tile([0.0, 0.05, 0.25], (POINTS, 1))
    return replace(cases(POINTS, force=force, seed=5), load_point=point, place=point.copy())


def bent(joints, wanted):
    return exact_pose(joints, wanted, wanted.force, wanted.moment)


def test_the_loaded_tool_is_where_it_is_wanted():
    wanted = path()
    found = compensate(MODEL, wanted, ANY)
    for there, goal in zip(bent(found.commanded, wanted), still_pose(wanted), strict=True):
        np.testing.assert_allclose(there, goal, rtol=0, atol=1e-12)
    assert np.abs(found.residual).max() < 1e-12
    np.testing.assert_allclose(found.share, 1.0)
    moved = bent(wanted.joints, wanted)[0] - still_pose(wanted)[0]
    np.testing.assert_allclose(found.uncorrected[:, :3], moved, atol=1e-12)


def test_limits_hold_corrections_back_and_say_so():
    found = compensate(MODEL, path(), CorrectionLimits(displacement=5e-4))
    size = np.linalg.norm(found.correction[:, :3], axis=1)
    assert found.capped.any()
    assert size.max() < 5e-4 * 1.01
    np.testing.assert_allclose(size[found.capped], 5e-4, rtol=0.01)
    assert (np.linalg.norm(found.residual[found.capped, :3], axis=1) > 1e-6).all()
    assert (np.linalg.norm(found.residual[~found.capped, :3], axis=1) < 1e-12).all()


def test_ramps_begin_where_the_load_sets_in():
    wanted = path()
    force = wanted.force.copy()
    force[:5] = force[-5:] = 0.0
    wanted = replace(wanted, force=force)
    found = compensate(MODEL, wanted, ANY, compute_ramp_shares(ROBOT, wanted, 0.8))
    place = ARM.posture(wanted.joints).point_to_base(wanted.place)
    assert found.share[5] == pytest.approx(0.0)
    assert found.share[6] == pytest.approx(np.linalg.norm(place[6] - place[5]) / 0.8)
    assert found.share[20] == pytest.approx(1.0)
    assert (np.diff(found.share[5:8]) >= 0).all()
    np.testing.assert_allclose(found.correction[:5], 0.0, atol=1e-15)


@pytest.fixture(scope="module")
def links():
    """Exact beams, read and fitted."""
    document = elastic_campaign(beam_arm(ARM), configurations=30, sigma=2e-5, seed=3)
    robot, measurements = prepare(document)
    columns = Columns(6, tuple(range(6)))
    folds = Folds(Rows(robot, measurements), columns, np.ones(6, dtype=bool), CrossValidation(folds=3), None)
    model = Candidate(find_model("joints_and_links"), columns)
    return ElasticPredictor.from_estimate(robot, folds.fit_whole_set(model, 1e-4))


def exact_beams(joints, cases):
    """Exact places (m, 3) of beams in balance, without load and with it: code that shares nothing."""
    places = cases.place[:1]
    still, loaded = elastic_deflections(beam_arm(ARM), joints, cases.force, cases.load_point, places)
    return still[:, 0], loaded[:, 0]


def test_as_much_is_compensated_as_is_predicted(links):
    wanted = path()
    found = compensate(links, wanted, ANY)
    assert np.abs(found.residual).max() < 1e-11
    goal, loaded = exact_beams(wanted.joints, wanted)
    size = np.linalg.norm(loaded - goal, axis=1).mean()
    predicted = 1.0 - np.linalg.norm(loaded - goal - found.uncorrected[:, :3], axis=1).mean() / size
    reached = exact_beams(found.commanded, wanted)[1]
    compensated = 1.0 - np.linalg.norm(reached - goal, axis=1).mean() / size
    assert predicted > 0.97
    assert compensated == pytest.approx(predicted, abs=1e-3)


INVERSE = InverseKinematics(ROBOT)
TOOL = np.array([0.0, 0.0, 0.25])
AREA = np.stack(np.meshgrid([1.2, 1.6, 2.0], [-0.6, 0.0, 0.6], [0.4, 0.9], indexing="ij"), axis=-1).reshape(
    -1, 3
)
FREE = np.tile([-np.inf, np.inf], (6, 1))


def task(*, directions=((0.0, 0.0, -1.0),), turns=1, force=(0.0, 800.0, 300.0), near=None, limits=FREE):
    rotation = compute_tool_rotations(np.array([0.0, 0.0, 1.0]), np.array(directions, dtype=float), turns)
    unit = np.array(force) / np.linalg.norm(force)
    ones = np.ones((len(rotation), 1))
    wrench = ones * force, np.zeros((len(rotation), 3)), ones * unit
    return MapTask(rotation, *wrench, TOOL, np.array([0.0, 0.0, 0.1]), limits, near, 0.95)


def tool_pose(joints):
    posture = ARM.posture(joints)
    return posture.point_to_base(np.tile(TOOL, (len(joints), 1))), posture.flange_rotation


def exact_displacement(asked, joints, force):
    loads = np.tile(force, (len(joints), 1)), np.zeros((len(joints), 3))
    turn = equilibrium(ARM, joints, *loads, np.tile(asked.load_point, (len(joints), 1)))
    return tool_pose(joints + turn)[0] - tool_pose(joints)[0]


def test_the_tool_stands_where_it_was_asked_to_and_bends_as_springs_do():
    asked = task(turns=4)
    found = map_places(MODEL, None, asked, INVERSE, AREA)
    assert found.reached.all()
    place, axes = tool_pose(found.joints)
    np.testing.assert_allclose(place, AREA, rtol=0, atol=1e-12)
    np.testing.assert_allclose(axes, asked.rotation[found.orientation], rtol=0, atol=1e-12)
    np.testing.assert_allclose(axes[:, :, 2], np.tile([0.0, 0.0, -1.0], (len(AREA), 1)), rtol=0, atol=1e-12)
    exact = exact_displacement(asked, found.joints, [0.0, 800.0, 300.0])
    np.testing.assert_allclose(found.displacement, exact, rtol=0, atol=1e-13)
    assert np.isnan(found.readings).all()
    assert np.isnan(found.with_model_error).all()


def test_the_stiffest_posture_is_no_softer_than_any_other():
    asked = task(turns=3)
    found = map_places(MODEL, None, asked, INVERSE, AREA[:4])
    for place, length in zip(AREA, found.length, strict=False):
        poses = np.tile(np.eye(4), (3, 1, 1))
        poses[:, :3, :3] = asked.rotation
        poses[:, :3, 3] = place - asked.rotation @ TOOL
        joints = INVERSE.solve(poses)[0].reshape(-1, 6)
        joints = joints[np.isfinite(joints).all(axis=1)]
        joints = joints[((joints >= ROBOT.limits[:, 0]) & (joints <= ROBOT.limits[:, 1])).all(axis=1)]
        others = np.linalg.norm(exact_displacement(asked, joints, [0.0, 800.0, 300.0]), axis=1)
        assert length <= others.min() * (1 + 5e-3)  # it is chosen to first order


def test_the_nearest_posture_and_its_full_turns():
    home = map_places(MODEL, None, task(), INVERSE, AREA[:1]).joints[0]
    turned = home + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2 * np.pi])
    joints = tuple(replace(joint, limits=None) for joint in ROBOT.chain.joints)
    unlimited = Robot(replace(ROBOT.chain, joints=joints).model(), ROBOT.joint_map)
    model = JointModel(unlimited, ARM.compliances, None, POSITIVE)
    found = map_places(model, None, task(near=turned), InverseKinematics(unlimited), AREA[:1])
    np.testing.assert_allclose(found.joints[0], turned, rtol=0, atol=1e-9)


def test_near_singularities_a_map_keeps_the_branch_or_refuses_the_place():
    """Near its wrist's singularity the closed form of an identified arm loses branches."""
    robot, draw = arm("r2000ic", 1e-3), np.random.default_rng(2)
    inverse = InverseKinematics(robot)
    model = JointModel(robot, ARM.compliances, None, POSITIVE)
    statuses = []
    for _ in range(20):
        joints = draw.uniform([-2.5, -0.5, -0.5, -2.5, -0.02, -2.5], [2.5, 0.8, 0.8, 2.5, 0.02, 2.5])
        near = robot.joint_map.controller_angles((joints + 0.02 * draw.choice([-1.0, 1.0], 6))[None])[0]
        pose = flange_poses(robot, joints[None])[0]
        wrench = np.tile([0.0, 0.0, -1.0], (3, 1, 1))
        asked = MapTask(pose[None, :3, :3], *wrench, np.zeros(3), np.zeros(3), FREE, near, 0.95)
        found = map_places(model, None, asked, inverse, pose[None, :3, 3])
        statuses.append(STATUSES[found.status[0]])
        if found.reached[0]:
            apart = robot.joint_map.model_angles(found.joints)[0] - joints
            assert np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))).max() < 1e-6
    assert set(statuses) == {"reached", "not_followed"}
    assert statuses.count("reached") >= 7


def left_out(robot, measurements, method="partial_pose", **options):
    settings = Settings(method, "covariance", Bounds.positive(robot.n), **options)
    estimate = identify(Rows(robot, measurements), settings)
    model = JointModel.from_estimate(robot, estimate, settings.constraints)
    return model, estimate_error_by_leaving_postures_out(Rows(robot, measurements), settings, estimate, model)


def noisy():
    return next(iter(SpringCampaign.of(ARM).measured(1, seed=4)))


def test_numbers_that_are_not_finite_are_no_dispersion_over_the_postures():
    found = identify(Rows(ROBOT, noisy()), Settings("partial_pose", "covariance", Bounds.positive(ROBOT.n)))
    fits = found.compliance * (1.0 + 0.1 * np.random.default_rng(2).standard_normal((30, ROBOT.n)))
    known = UncertaintyBudget.from_estimate(found, 0.95, PostureJackknife(fits[1:], 30))
    fits[0] = np.inf
    with_infinite = UncertaintyBudget.from_estimate(found, 0.95, PostureJackknife(fits, 30))
    for one, other in zip(known.components, with_infinite.components, strict=True):
        np.testing.assert_array_equal(one.covariance, other.covariance)
    assert "model_error" in [part.source for part in known.components]
    nothing = replace(found, covariance=np.full((ROBOT.n, ROBOT.n), np.nan))
    budget = UncertaintyBudget.from_estimate(nothing, 0.95, PostureJackknife(fits, 30))
    assert "model_error" not in [part.source for part in budget.components]


def test_of_many_postures_some_are_left_out_evenly_spread(monkeypatch):
    monkeypatch.setattr(models, "MOST_LEFT_OUT", 5)
    assert left_out(ROBOT, noisy())[1].postures == 5


def test_merged_steps_round_quantiles_up_by_little():
    """Beside the least score with the share, found by counting over all readings."""
    generator = np.random.default_rng(5)
    posture = np.sort(generator.integers(0, 150, 3000))
    score = generator.random(len(posture)) * (1.0 + posture)
    score[generator.random(len(score)) < 0.01] = np.inf
    merged, share = merge_score_steps(posture, score)
    assert len(merged) <= MOST_STEPS + 1
    error = ModelError(150, merged, share, 1.0, 0.0, 0.1, 1.0)

    def exact(confidence):
        counts = np.bincount(posture)
        shares = [(1.0 / counts[posture])[score <= q].sum() / 151 for q in np.unique(score)]
        return np.unique(score)[np.argmax(np.array(shares) >= confidence)]

    for confidence in (0.05, 0.5, 0.9, 0.95, 0.98):
        assert exact(confidence) <= error.quantile(confidence) <= exact(confidence + 1.0 / MOST_STEPS)
    assert np.isinf(error.quantile(0.999))
    load = replace(cases(1), force=np.array([[4.0, 0.0, 0.0]]))
    growing = replace(error, noise=1e-5).bound(load, np.array([3e-5]), 0.5)
    assert growing.radius == pytest.approx(error.quantile(0.5) * np.hypot(4.0, 3.0))


def test_held_out_postures_of_a_real_robot():
    """FANUC: elastic links and no noise to speak of; 20 fitted, 10 held out (benchmark `deflection`)."""
    robot, measurements = prepare(shared("fanuc_r2000ic/campaign"))
    held, readings = [], []
    for seed in range(12):
        order = np.random.default_rng(seed).permutation(30)
        fitted, rest = measurements[np.sort(order[:20])], measurements[np.sort(order[20:])]
        model, error = left_out(robot, fitted, confidence=0.9)
        cases = LoadCases(rest.joints, rest.force, rest.moment, rest.load_point, rest.position[:, 0].copy())
        found = model.deflect(cases)
        read = rest.deflection[:, 0]
        bound = error.bound(cases, found.leverage, 0.9)
        held.append(np.linalg.norm(read - found.displacement, axis=1) <= bound.radius)
        of_readings = found.interval(0.9)
        readings.append((of_readings[:, :3, 0] <= read) & (read <= of_readings[:, :3, 1]))
        ends = bound.interval(found.displacement, of_readings)
        assert (ends[..., 0] <= of_readings[:, :3, 0]).all()
    assert np.mean(held) >= 0.85
    assert np.mean(readings) < 0.6  # what is not said by readings alone
