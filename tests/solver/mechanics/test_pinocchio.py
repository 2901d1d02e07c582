"""What the solver computes with Pinocchio's model, compared with Pinocchio itself and with moved arms."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.campaigns import only_deflections, simulated
from support.examples import examples

from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import build_robot
from jointstiff.simulator import default_arm
from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.block import regressor_blocks, wrench_stiffness
from jointstiff.solver.mechanics.chain import ChainJoint, KinematicChain
from jointstiff.solver.mechanics.postures import Postures, flange_poses
from jointstiff.solver.mechanics.robot import Robot, fix_prismatic_joints
from jointstiff.solver.mechanics.terms import AXES

Z = np.array([0.0, 0.0, 1.0])
DH = {"a": 0.3, "alpha": 0.0, "d": 0.1, "theta": 0.0}


def arm_of_kinds(kinds: tuple[JointKind, ...], seed: int) -> Robot:
    """An arm with axes and placements by chance."""
    rng, joints = np.random.default_rng(seed), []
    for i, kind in enumerate(kinds):
        axis, place = rng.normal(size=3), pin.SE3.Random()
        axis /= np.linalg.norm(axis)
        joints.append(ChainJoint(f"j{i}", kind, place.rotation, 0.3 * place.translation, axis, None, f"l{i}"))
    flange = pin.SE3.Random()
    joints.append(ChainJoint("mount", "fixed", flange.rotation, flange.translation, Z, None, "flange"))
    return Robot(KinematicChain("arm", "base", "flange", tuple(joints)).model())


def test_a_row_of_the_regressor_is_equation_12_of_the_paper_by_calls_of_pinocchio_alone():
    """τ = J_v(p_W)ᵀ F, and the deflection of a target is J_v(x) diag(τ) c."""
    robot, measurements = simulated(load="pull", seed=2)
    block = next(regressor_blocks(robot, measurements))
    model, data, q = robot.model, robot.model.createData(), measurements.joints[3]
    frames = [
        model.addFrame(pin.Frame(name, robot.n, robot.flange_placement * place, pin.FrameType.OP_FRAME))
        for name, place in (
            ("load", pin.SE3(np.eye(3), measurements.load_point[3])),
            ("target", pin.SE3(np.eye(3), block.postures.to_flange(measurements.position)[3, 1])),
        )
    ]
    data = model.createData()
    at_load, at_target = (
        pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3] for frame in frames
    )
    torque = at_load.T @ measurements.force[3]
    np.testing.assert_allclose(block.A[3, 1], at_target * torque, rtol=1e-12, atol=1e-12)


@examples(60)
@given(
    st.lists(st.sampled_from(["revolute", "prismatic"]), min_size=1, max_size=8).map(tuple),
    st.integers(0, 99),
)
def test_complementary_stiffness_is_pinocchios_static_torque_derivative_and_the_turn_of_a_dead_load(
    kinds, seed
):
    robot, rng = arm_of_kinds(kinds, seed), np.random.default_rng(seed)
    n, q = robot.n, rng.uniform(-1.5, 1.5, (1, len(kinds)))
    point, force, moment = (
        rng.normal(0.0, 0.2, (1, 3)),
        rng.normal(0.0, 500.0, (1, 3)),
        rng.normal(0.0, 80.0, (1, 3)),
    )
    at = Postures(robot, q)
    place, (load_jacobian, _) = at.to_base(point[:, None])[0, 0], at.load(point, force, moment)

    model = robot.model.copy()
    model.gravity.linear = np.zeros(3)
    data, external = model.createData(), pin.StdVec_Force()
    for _ in range(model.njoints):
        external.append(pin.Force.Zero())
    pin.forwardKinematics(model, data, q[0])
    wrench = pin.Force(force[0], moment[0] + np.cross(place, force[0]))
    external[n] = data.oMi[n].actInv(wrench)
    follower = -pin.computeStaticTorqueDerivatives(model, data, q[0], external)
    J_v, J_w = load_jacobian[0], at.angular_jacobian[0]
    dead = J_v.T @ (pin.skew(force[0]) @ J_w) + J_w.T @ (pin.skew(moment[0]) @ J_w)

    found = wrench_stiffness(at.angular_jacobian, load_jacobian, force, moment)[0]
    np.testing.assert_allclose(found, follower + dead, rtol=0, atol=1e-12 * (1.0 + np.abs(found).max()))


def moved_axis(robot: Robot, joint: int, translation: np.ndarray, turn: np.ndarray) -> Robot:
    """The robot with one axis moved in its frame; at position zero nothing else moves."""
    chain, rotation = robot.chain, pin.exp3(turn)
    own, behind = chain.joints[joint : joint + 2]
    moved = replace(
        own, rotation=own.rotation @ rotation, translation=own.translation + own.rotation @ translation
    )
    back = replace(
        behind,
        rotation=rotation.T @ behind.rotation,
        translation=rotation.T @ (behind.translation - translation),
    )
    joints = (*chain.joints[:joint], moved, back, *chain.joints[joint + 2 :])
    return Robot(replace(chain, joints=joints).model(), robot.joint_map)


@pytest.mark.parametrize("on_flange", [False, True])
@pytest.mark.parametrize("with_stiffness", [False, True])
def test_a_displaced_axis_moves_targets_and_joints_as_a_robot_with_a_moved_axis_says(
    on_flange, with_stiffness
):
    robot, measurements = simulated(load="pull", seed=2)
    measurements = only_deflections(measurements) if on_flange else measurements
    compliance = 1.0 / default_arm().stiffnesses
    balanced = compliance if with_stiffness else None
    found = AXES.motion(next(regressor_blocks(robot, measurements, balanced)), compliance)

    step, column = 1e-5, 0
    for joint, axis in enumerate(robot.axes):
        for across in np.linalg.svd(axis[None])[2][1:]:
            for translation, turn in ((across, 0.0 * across), (0.0 * across, across)):
                ahead, behind = (
                    next(
                        regressor_blocks(
                            moved_axis(robot, joint, s * translation, s * turn), measurements, balanced
                        )
                    )
                    for s in (step, -step)
                )
                targets = (ahead.A - behind.A) @ compliance / (2.0 * step)
                joints = (ahead.torque - behind.torque) * compliance / (2.0 * step)
                np.testing.assert_allclose(found.targets[..., column], targets, rtol=0, atol=1e-9)
                np.testing.assert_allclose(found.joints[..., column], joints, rtol=0, atol=1e-9)
                column += 1
    assert column == found.targets.shape[-1]


@pytest.mark.parametrize(
    "kinds", [("revolute",) * 6, ("prismatic", "revolute", "revolute"), ("revolute", "prismatic")]
)
def test_motions_of_an_axis_are_those_of_a_robot_with_a_moved_axis(kinds):
    robot = arm_of_kinds(kinds, 7)
    q = np.random.default_rng(3).uniform(-1.0, 1.0, (4, robot.n))
    at, step = Postures(robot, q), 1e-6
    for joint in range(robot.n):
        for k, motion in enumerate(np.eye(6)):
            ends = [
                Postures(moved_axis(robot, joint, s * motion[:3], s * motion[3:]), q).flange_pose
                for s in (step, -step)
            ]
            slope = (ends[0] - ends[1]) / (2.0 * step)
            v, w = np.split(at.axis_motions[:, joint, :, k], 2, axis=1)
            moved = v + np.cross(w, at.flange_translation)
            np.testing.assert_allclose(slope[:, :3, 3], moved, rtol=0, atol=1e-8)
            turned = np.stack([pin.skew(each) for each in w]) @ at.flange_rotation
            np.testing.assert_allclose(slope[:, :3, :3], turned, rtol=0, atol=1e-8)


def test_poses_without_jacobians_are_those_of_the_kinematics_to_the_last_bit():
    robot, measurements = simulated(load="pull", seed=2)
    q = measurements.joints
    assert np.array_equal(flange_poses(robot, q), Postures(robot, q).flange_pose)


def test_levers_of_weights_are_torques_of_pinocchios_gravity():
    robot = arm_of_kinds(("revolute", "prismatic", "revolute", "revolute"), 5)
    rng = np.random.default_rng(0)
    q, gravity = rng.uniform(-1.0, 1.0, (3, 4)), rng.normal(0.0, 9.0, 3)
    mass, centre = rng.uniform(1.0, 50.0, 4), rng.normal(0.0, 0.3, (4, 3))
    model = robot.model.copy()
    for i in range(4):
        model.inertias[i + 1] = pin.Inertia(mass[i], centre[i], np.eye(3))
    model.gravity.linear = gravity
    data = model.createData()
    expected = [-pin.computeGeneralizedGravity(model, data, each).copy() for each in q]
    moments = np.column_stack([mass, mass[:, None] * centre])
    found = np.einsum("bjlpi,lp,i->bj", Postures(robot, q).weight_levers, moments, gravity)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-10)


def test_a_robot_keeps_the_model_that_it_is_given():
    model = pin.buildSampleModelManipulator()
    assert Robot(model, flange="effector_body").model is model


def test_an_unbounded_joint_of_pinocchio_turns_by_its_angle():
    model = pin.Model()
    model.addJoint(0, pin.JointModelRUBZ(), pin.SE3.Random(), "turntable")
    model.addJoint(1, pin.JointModelRY(), pin.SE3.Random(), "arm")
    robot, q = Robot(model), np.array([[3.5, 0.2], [-1.0, 0.5]])
    bounded = Robot(robot.chain.model())
    np.testing.assert_allclose(Postures(robot, q).jacobian, Postures(bounded, q).jacobian, rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        Postures(robot, q).flange_pose, Postures(bounded, q).flange_pose, rtol=0, atol=1e-15
    )
    assert robot.limits.tolist()[0] == [-np.inf, np.inf]


@pytest.mark.parametrize("order", [("prismatic", "revolute"), ("revolute", "prismatic")])
def test_a_model_without_frames_keeps_its_flange_while_its_linear_axis_stands_still(order):
    kinds, model = {"prismatic": pin.JointModelPX, "revolute": pin.JointModelRZ}, pin.Model()
    for i, kind in enumerate(order):
        model.addJoint(i, kinds[kind](), pin.SE3.Random(), kind)
    robot, q = Robot(model), np.array([0.3, 0.7])
    still = fix_prismatic_joints(robot, q)
    turned = Postures(still, q[[order.index("revolute")]][None]).flange_pose
    np.testing.assert_allclose(turned, Postures(robot, q[None]).flange_pose, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("joint", "reason"), [(pin.JointModelSpherical(), "Spherical"), (pin.JointModelPlanar(), "Planar")]
)
def test_a_joint_of_several_degrees_of_freedom_is_refused_by_name(joint, reason):
    model = pin.Model()
    model.addJoint(0, joint, pin.SE3.Identity(), "shoulder")
    with pytest.raises(RobotError, match=f"'shoulder' is a JointModel{reason}"):
        Robot(model)


def test_a_branched_or_empty_model_is_refused():
    model = pin.Model()
    with pytest.raises(RobotError, match="0 joints"):
        Robot(model)
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "left")
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "right")
    with pytest.raises(RobotError, match="branches"):
        Robot(model)


def test_masses_of_a_robot_document_are_inertias_of_the_model():
    document = {"name": "pan", "model": {"format": "dh", "convention": "standard", "rows": [DH, DH]}}
    tool = {"name": "tool", "joint": "joint_2", "mass": 12.0, "centre": [0.1, 0.0, 0.2]}
    robot = build_robot(RobotDocument.model_validate(document | {"bodies": [tool, tool | {"name": "part"}]}))
    inertia = robot.model.inertias[2]
    assert (robot.model.inertias[1].mass, inertia.mass) == (0.0, 24.0)
    np.testing.assert_allclose(inertia.lever, [0.1, 0.0, 0.2], rtol=1e-15)
