"""Advice on what to measure next: followed with exact springs, it brings what it promised."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from flint import fmpq_mat
from hypothesis import given
from hypothesis import strategies as st
from support.campaigns import estimate, prepare, straight_wrist
from support.examples import examples
from support.shared_data import shared

from jointstiff.simulator import LOAD_POINT, TARGETS, default_arm, simulate_campaign
from jointstiff.simulator.campaign import SpringArm
from jointstiff.simulator.equilibrium import deflections
from jointstiff.solver.design.advice import Advice, advise, new_postures
from jointstiff.solver.design.criteria import uncertainty_of
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.results import to_identifiability
from jointstiff.solver.robot.chain import KinematicChain
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot


def advised(document: dict, **options):
    """Robot, measurements, the estimate and the advice."""
    robot, measurements = prepare(document)
    found = estimate(robot, measurements, **options)
    return robot, measurements, found, advise(robot, measurements, found)


class TestUncertainty:
    @examples(100)
    @given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6))
    def test_is_that_of_the_exact_inverse(self, seed, n):
        rows = np.random.default_rng(seed).integers(-9, 10, (n + 3, n))
        G = fmpq_mat((rows.T @ rows).tolist()) if n else None
        if G.det() == 0:
            return
        inverse = G.inv()
        # The least information of such integers is 1/det; double precision finds it to what is left.
        variance = [float(inverse[j, j].p) / float(inverse[j, j].q) for j in range(n)]
        assert uncertainty_of(rows.T @ rows, n) ** 2 == pytest.approx(variance, rel=1e-6)

    def test_of_what_is_not_determined_is_infinite(self):
        rows = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 2.0], [2.0, 2.0, 0.0, 1.0]])
        # Of joint 3 the sum of the first two takes a share: 5 − 2²/5.
        expected = [np.inf, np.inf, np.inf, (5 - 4 / 5) ** -0.5]
        assert uncertainty_of(rows.T @ rows, 4) == pytest.approx(expected, rel=1e-12)

    def test_all_matrices_at_once(self):
        rows = np.random.default_rng(0).standard_normal((5, 7, 4))
        G = rows.swapaxes(1, 2) @ rows
        expected = np.sqrt(np.diagonal(np.linalg.inv(G), axis1=1, axis2=2))
        np.testing.assert_allclose(uncertainty_of(G, 2), expected[:, :2], rtol=1e-9)


class TestFollowed:
    """What the advice promised is what the same identification finds with the advised reading."""

    @pytest.mark.parametrize("name", ["dead_weight_motor", "dead_weight_secondary"])
    def test_the_joint_that_a_weight_never_twists(self, name):
        robot, measurements, _, (advice,) = advised(shared(f"simulated/{name}"))
        stiffness = shared("simulated/truth")[name]["stiffness"]
        assert advice.joint == 0
        assert advice.uncertainty_ratio is None
        # Along an axis, which is easier; sideways, as upwards is as blind as downwards
        assert np.sort(np.abs(advice.force)) == pytest.approx([0.0, 0.0, 1500.0], abs=1e-9)
        assert abs(advice.force[2]) < 1e-9
        followed = follow(arm_of(robot, stiffness), robot, measurements, advice)
        joint = estimate(robot, followed).joints[0]
        assert joint.status == "identified"
        assert joint.standard_uncertainty == pytest.approx(advice.standard_uncertainty, rel=0.01)
        assert abs(joint.compliance - 1 / stiffness[0]) < 4 * joint.standard_uncertainty

    @pytest.mark.parametrize("sigma", [2e-5, None])
    @pytest.mark.parametrize("seed", range(3))
    def test_few_readings(self, seed, sigma):
        """Weights: another direction, and a posture with the weights as they are. Both hold good."""
        arm = default_arm()
        robot, measurements = prepare(simulate_campaign(arm, configurations=3, seed=seed + 1))
        measurements = replace(measurements, sigma=sigma)
        found = estimate(robot, measurements)
        pieces = advise(robot, measurements, found)
        assert {piece.joint for piece in pieces} > {0}
        assert any(piece.own_direction and piece.observation is None for piece in pieces)
        for piece in pieces:
            after = estimate(robot, follow(arm, robot, measurements, piece))
            deviation = after.joints[piece.joint].standard_uncertainty / after.sigma
            assert deviation == pytest.approx(piece.deviation, rel=0.01)
            if piece.uncertainty_ratio is not None:
                before = found.joints[piece.joint].standard_uncertainty / found.sigma
                assert deviation / before == pytest.approx(piece.uncertainty_ratio, rel=0.01)
                assert piece.uncertainty_ratio < 0.99

    def test_a_straight_wrist_is_to_be_bent(self):
        robot, measurements = straight_wrist(0.0)
        pieces = advise(robot, measurements, estimate(robot, measurements))
        assert [piece.joint for piece in pieces] == [3, 5]
        assert all(piece.observation is None and abs(piece.joints[4]) > 0.1 for piece in pieces)
        after = estimate(robot, follow(default_arm(), robot, measurements, pieces[0]))
        assert after.joints[3].status == after.joints[5].status == "identified"
        assert after.joints[3].standard_uncertainty == pytest.approx(pieces[0].standard_uncertainty, rel=0.01)

    def test_several_joints_without_a_trace(self):
        """One posture with the weight above the wrist: joints 1 and others show nothing."""
        arm = default_arm()
        robot, measurements, _, pieces = advised(simulate_campaign(arm, configurations=1, seed=1))
        assert pieces
        for piece in pieces:
            after = estimate(robot, follow(arm, robot, measurements, piece))
            joint = after.joints[piece.joint]
            assert joint.standard_uncertainty == pytest.approx(piece.standard_uncertainty, rel=0.01)


class TestBest:
    def test_no_direction_does_much_better(self):
        """Against 2,000 directions in every posture of the set, by regressors of the simulator."""
        arm = default_arm()
        _, measurements, _, (advice, *_) = advised(simulate_campaign(arm, configurations=6, seed=0))
        assert advice.joint == 0
        rows = [rows_of(arm, measurements.joints[i], measurements.force[i]) for i in range(6)]
        rng = np.random.default_rng(0)
        best = np.inf
        for q in measurements.joints:
            directions = rng.standard_normal((350, 3))
            forces = 1500.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
            along_axes = np.stack([rows_of(arm, q, axis) for axis in np.eye(3)])
            for added in np.einsum("di,irj->drj", forces, along_axes):  # linear in the force
                R = np.vstack([*rows, added])
                best = min(best, np.sqrt(2 * np.linalg.inv(R.T @ R)[0, 0]))
        assert best < advice.deviation < 1.06 * best

    def test_the_same_every_time(self):
        robot, measurements, found, first = advised(
            simulate_campaign(default_arm(), configurations=3, seed=0)
        )
        for a, b in zip(first, advise(robot, measurements, found), strict=True):
            np.testing.assert_array_equal(a.joints, b.joints)
            np.testing.assert_array_equal(a.force, b.force)


class TestNone:
    def test_where_all_joints_are_well_determined(self):
        *_, pieces = advised(shared("simulated/pull_40"))
        assert pieces == ()

    def test_where_no_force_was_applied(self):
        document = simulate_campaign(default_arm(), force=0.0, moment=300.0, configurations=2, sigma=1e-3)
        *_, found, pieces = advised(document)
        assert any(joint.status != "identified" for joint in found.joints)
        assert pieces == ()

    def test_where_all_forces_meet_the_axis(self):
        """The load point lies on the last axis; rounding leaves it levers of some 1e-17 m."""
        document = simulate_campaign(default_arm(), load="pull", seed=3, load_point=(0, 0, 0.12))
        *_, found, pieces = advised(document)
        assert found.joints[5].status == "not_observable"
        assert all(advice.joint != 5 for advice in pieces)

    def test_where_nothing_could_tell_two_joints_apart(self):
        """Two joints on one axis."""
        robot, measurements = prepare(simulate_campaign(default_arm(), load="pull", seed=3))
        joints = list(robot.chain.joints)
        twin = replace(joints[0], name="twin", child="twin_link", rotation=np.eye(3), translation=np.zeros(3))
        chain = KinematicChain("twins", robot.chain.base, robot.chain.flange, (joints[0], twin, *joints[1:]))
        extended = replace(measurements, joints=np.insert(measurements.joints, 1, 0.0, axis=1))
        twins = Robot(chain)
        found = estimate(twins, extended)
        assert found.joints[0].status == "not_observable"
        assert advise(twins, extended, found) == ()


class TestNewPostures:
    def test_within_limits_and_span_in_whole_degrees(self):
        robot, measurements = limited(simulate_campaign(default_arm(), load="pull", seed=3), (-0.3, 0.25))
        found = new_postures(robot, measurements, 30)
        assert len(found) == 30
        np.testing.assert_allclose(np.degrees(found), np.round(np.degrees(found)), atol=1e-9)
        assert (found >= robot.limits[:, 0]).all()
        assert (found <= robot.limits[:, 1]).all()
        least, greatest = measurements.joints.min(axis=0), measurements.joints.max(axis=0)
        allowed = np.maximum(greatest - least, 1.0) / 2 + np.radians(0.5)  # one radian at the least
        assert (np.abs(found - (least + greatest) / 2) <= allowed).all()

    def test_none_where_the_limits_leave_no_room(self):
        document = simulate_campaign(default_arm(), configurations=3, seed=3)
        confined, measurements = limited(document, (3.0, 3.1))
        # The measured postures are beyond these limits, too, and none of them is advised again.
        assert not advise(confined, measurements, estimate(confined, measurements))


class TestMessages:
    def test_with_label_direction_and_numbers(self):
        document = shared("simulated/dead_weight_motor")
        robot, measurements, found, pieces = advised(document)
        message = to_identifiability(found, pieces, robot, measurements)
        (advice,) = message.advice
        direction = ", ".join(f"{abs(x) / 1500:.2f}" for x in advice.force)
        assert advice.message == (
            f"in posture {advice.observation} apply 1500 N along ({direction}): "
            f"u(joint_1) falls to {advice.standard_uncertainty:.2g} rad/(N.m)"
        )
        assert advice.joints == pytest.approx(
            document["measurement_set"]["observations"][measurements.labels.index(advice.observation)][
                "joints"
            ]
        )
        json.dumps(message.model_dump(mode="json"), allow_nan=False)

    @pytest.mark.parametrize(
        ("method", "weighting", "same"),
        [
            ("partial_pose", "covariance", True),
            ("complete_pose", "covariance", True),
            ("complete_pose", "uniform", False),
            ("decoupled_partial_pose", "covariance", False),
        ],
    )
    def test_of_a_method_that_will_find_another_uncertainty(self, method, weighting, same):
        arm = default_arm()
        options = {"method": method, "weighting": weighting}
        document = simulate_campaign(arm, configurations=4, seed=2)
        robot, measurements, found, pieces = advised(document, **options)
        after = estimate(robot, follow(arm, robot, measurements, pieces[0]), **options)
        kept = after.joints[0].standard_uncertainty == pytest.approx(pieces[0].standard_uncertainty, rel=0.01)
        assert kept == same
        (first, *_) = to_identifiability(found, pieces, robot, measurements).advice
        assert ("with method partial_pose u(joint_1)" in first.message) != same

    def test_of_a_new_posture_and_without_sigma(self):
        robot, measurements, found, pieces = advised(
            simulate_campaign(default_arm(), configurations=3, seed=1)
        )
        messages = to_identifiability(found, pieces, robot, measurements).advice
        (new, *_) = (piece for piece in messages if piece.observation is None)
        assert "if it is free of collisions, apply the load of 1500 N as before" in new.message
        assert f", {new.uncertainty_ratio:.2g} times its present value" in new.message
        unknown = replace(found, sigma=None)
        (first, *_) = to_identifiability(
            unknown, advise(robot, measurements, unknown), robot, measurements
        ).advice
        assert first.joint == "joint_1"
        assert "about the axis of joint_1" in first.message
        assert first.standard_uncertainty is None


def rows_of(arm: SpringArm, q: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Regressor (9, 6) of one reading of the default targets, by the simulator."""
    posture = arm.posture(q)
    load, *targets = (
        posture.velocities(posture.point_to_base(point)).T for point in (LOAD_POINT, *TARGETS.values())
    )
    return np.vstack(targets) * (force @ load)


def limited(document: dict, limits: tuple[float, float]) -> tuple[Robot, Measurements]:
    """Robot with other limits of joint_2, and measurements."""
    robot, measurements = prepare(document)
    joints = (
        replace(joint, limits=limits) if joint.name == "joint_2" else joint for joint in robot.chain.joints
    )
    return Robot(replace(robot.chain, joints=tuple(joints))), measurements


def follow(arm: SpringArm, robot: Robot, measurements: Measurements, advice: Advice) -> Measurements:
    """The set with the advised reading, taken on springs that balance the load exactly."""
    first = Configurations(robot, measurements.joints[:1])
    places = (measurements.position[0] - first.flange_translation[0]) @ first.flange_rotation[0]
    reading = {
        "joints": advice.joints[None],
        "force": advice.force[None],
        "moment": np.zeros((1, 3)),
        "load_point": measurements.load_point[advice.observation or 0][None],
    }
    unloaded, loaded = deflections(arm, *reading.values(), places)
    noise = np.random.default_rng(0).normal(0, np.sqrt(2) * (measurements.sigma or 0.0), loaded.shape)
    reading |= {"position": unloaded, "deflection": loaded - unloaded + noise}
    reading |= {"in_flange": measurements.in_flange[:1], "present": measurements.present[:1]}
    joined = {name: np.concatenate([getattr(measurements, name), new]) for name, new in reading.items()}
    return replace(measurements, **joined, labels=(*measurements.labels, "advised"))


def arm_of(robot: Robot, stiffness: list[float]) -> SpringArm:
    """The simulator's arm with this robot's geometry, read off its chain at zero."""
    rotation, translation = np.eye(3), np.zeros(3)
    points, directions, limits = [], [], []
    for joint in robot.chain.joints:
        translation = translation + rotation @ joint.translation
        rotation = rotation @ joint.rotation
        if joint.kind == "revolute":
            points.append(translation)
            directions.append(rotation @ joint.axis)
            limits.append(joint.limits)
    return SpringArm(
        axis_points=np.array(points),
        axis_directions=np.array(directions),
        flange_rotation=rotation,
        flange_translation=translation,
        stiffnesses=np.array(stiffness),
        limits=np.array(limits),
    )
