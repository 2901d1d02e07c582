"""The simulator and its imperfections against physics that it does not contain."""

import dataclasses
import json

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from support.examples import examples

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.campaign import (
    LOAD_POINT,
    TARGETS,
    EquilibriumError,
    SpringArm,
    deflections,
    equilibrium,
    experiment_of,
    linear_deflections,
    plan_experiment,
    random_configurations,
    simulate_positions,
    torques,
)
from jointstiff.simulator.elastic_links import beam_compliance
from jointstiff.simulator.equilibrium import torque_derivative
from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.simulator.own_weight import Balancer, default_bodies, energy, sag
from jointstiff.simulator.urdf import roll_pitch_yaw, urdf_text

NOTHING = (0.0, 0.0, 0.0)
POINTS = np.array(list(TARGETS.values()))
FORCE = np.array([900.0, -700.0, -1100.0])
MOMENT = np.array([300.0, 500.0, -400.0])


def skew_arm(joints: int = 5, seed: int = 3) -> SpringArm:
    """Axes and flange in no particular direction, springs soft enough for large deflections."""
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((joints, 3))
    return SpringArm(
        axis_points=rng.uniform(-1.0, 1.0, (joints, 3)),
        axis_directions=directions / np.linalg.norm(directions, axis=1, keepdims=True),
        flange_rotation=Rotation.random(rng=rng).as_matrix(),
        flange_translation=rng.uniform(-1.0, 1.0, 3),
        stiffnesses=rng.uniform(2e4, 6e4, joints),
    )


def arm_of_levers(stiffnesses: list[float], direction: tuple[float, ...], length: float = 1.0) -> SpringArm:
    """Parallel axes, so far apart along x."""
    places = length * np.eye(3)[[0]] * np.arange(len(stiffnesses) + 1)[:, None]
    directions = np.tile(direction, (len(stiffnesses), 1))
    return SpringArm(places[:-1], directions, np.eye(3), places[-1], np.array(stiffnesses))


def lever(length: float, stiffness: float) -> SpringArm:
    """A horizontal lever along x that turns about y; positive angles lower its end."""
    return arm_of_levers([stiffness], (0.0, 1.0, 0.0), length)


ARMS = {
    "spherical wrist": default_arm(),
    "secondary encoders": default_arm("secondary"),
    "offset wrist": default_arm(wrist_offset=0.12),
    "skew axes": skew_arm(),
}
every_arm = pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS.keys())


def pinocchio_model(arm: SpringArm) -> tuple[pin.Model, pin.Data, int]:
    model = pin.buildModelFromXML(urdf_text(arm))
    assert list(model.names)[1:] == list(arm.joint_names)
    assert model.existFrame("flange")
    return model, model.createData(), model.getFrameId("flange")


def pinocchio_torques(arm, q, force, moment, load_point):
    """Joint torques from pinocchio's Jacobian, moved from the flange to the load point."""
    model, data, flange = pinocchio_model(arm)
    J = pin.computeFrameJacobian(model, data, q, flange, pin.LOCAL_WORLD_ALIGNED)
    lever_arm = data.oMf[flange].rotation @ load_point
    return J[:3].T @ force + J[3:].T @ (moment + np.cross(lever_arm, force))


class TestKinematics:
    @every_arm
    def test_the_urdf_describes_the_same_arm(self, arm):
        model, data, flange = pinocchio_model(arm)
        for q in random_configurations(arm, 10, seed=4):
            posture = arm.posture(q)
            pin.framesForwardKinematics(model, data, q)
            placement = data.oMf[flange]
            assert posture.flange_rotation == pytest.approx(placement.rotation, abs=1e-13)
            assert posture.flange_translation == pytest.approx(placement.translation, abs=1e-13)

    def test_the_urdf_states_the_limits(self):
        arm = default_arm()
        model, _, _ = pinocchio_model(arm)
        assert model.lowerPositionLimit == pytest.approx(arm.limits[:, 0])
        assert model.upperPositionLimit == pytest.approx(arm.limits[:, 1])

    @every_arm
    def test_torques_are_those_of_pinocchio(self, arm):
        for q in random_configurations(arm, 5, seed=5):
            expected = pinocchio_torques(arm, q, FORCE, MOMENT, LOAD_POINT)
            assert torques(arm, q, FORCE, MOMENT, LOAD_POINT) == pytest.approx(expected, abs=1e-9)

    @pytest.mark.parametrize("pitch", [-np.pi / 2, -0.7, 0.0, 1.1, np.pi / 2])
    @pytest.mark.parametrize(("roll", "yaw"), [(0.0, 0.0), (0.4, -2.0), (-3.0, 1.5)])
    def test_roll_pitch_yaw_even_where_they_are_not_unique(self, roll, pitch, yaw):
        expected = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
        actual = Rotation.from_euler("xyz", roll_pitch_yaw(expected)).as_matrix()
        assert actual == pytest.approx(expected, abs=1e-14)


class TestEquilibrium:
    @pytest.mark.parametrize("start", [0.0, 0.3, -1.2])
    @pytest.mark.parametrize("ratio", [1e-6, 1e-2, 0.9])
    def test_a_lever_balances_its_weight(self, start, ratio):
        length, weight = 1.7, 800.0
        stiffness = weight * length / ratio
        expected = brentq(lambda x: x - ratio * np.cos(start + x), -2.0, 2.0, xtol=1e-15, rtol=1e-15)
        actual = equilibrium(lever(length, stiffness), [start], (0.0, 0.0, -weight), NOTHING, NOTHING)
        assert actual == pytest.approx([expected], rel=1e-13)

    @every_arm
    @pytest.mark.parametrize("moment", [np.zeros(3), MOMENT], ids=["force", "force and moment"])
    def test_springs_balance_the_torques_pinocchio_finds_when_deflected(self, arm, moment):
        for q in random_configurations(arm, 5, seed=6):
            twist = equilibrium(arm, q, FORCE, moment, LOAD_POINT)
            expected = pinocchio_torques(arm, q + twist, FORCE, moment, LOAD_POINT)
            assert arm.stiffnesses * twist == pytest.approx(expected, rel=1e-10, abs=1e-9)

    @every_arm
    def test_the_derivative_of_the_torques(self, arm):
        q, step = random_configurations(arm, 1, seed=9)[0], 1e-6
        actual = torque_derivative(arm, q, FORCE, MOMENT, LOAD_POINT)
        for k in range(len(q)):
            change = step * np.eye(len(q))[k]
            ahead = torques(arm, q + change, FORCE, MOMENT, LOAD_POINT)
            behind = torques(arm, q - change, FORCE, MOMENT, LOAD_POINT)
            assert actual[:, k] == pytest.approx((ahead - behind) / (2 * step), abs=1e-4)

    def test_a_moment_turns_parallel_springs_exactly(self):
        stiffnesses = [3e3, 1e3, 2e3]
        parallel, q, moment = arm_of_levers(stiffnesses, (0.0, 0.0, 1.0)), [0.3, -0.8, 1.1], 400.0
        actual = equilibrium(parallel, q, NOTHING, (250.0, -90.0, moment), (0.3, 0.1, 0.2))
        assert actual == pytest.approx(moment / np.array(stiffnesses), rel=1e-14)

    def test_rigid_joints_do_not_move(self):
        soft = skew_arm()
        stiffnesses = soft.stiffnesses.copy()
        stiffnesses[[1, 3]] = np.inf
        arm = dataclasses.replace(soft, stiffnesses=stiffnesses)
        twist = equilibrium(arm, random_configurations(arm, 6), FORCE, MOMENT, LOAD_POINT)
        assert not twist[:, [1, 3]].any()
        assert np.all(twist[:, [0, 2, 4]] != 0.0)

    def test_a_column_beyond_its_critical_load_is_refused(self):
        """A lever pushed along itself buckles at F = k / L."""
        arm = lever(2.0, 1000.0)
        below = equilibrium(arm, [0.0], (-499.0, 0.0, 0.0), NOTHING, NOTHING)
        assert below == pytest.approx([0.0])
        with pytest.raises(EquilibriumError, match="buckles"):
            equilibrium(arm, [0.0], (-501.0, 0.0, 0.0), NOTHING, NOTHING)


def test_it_is_the_tangent_of_the_exact_deflection():
    """A central difference over the load has no first-order term left."""
    arm, step = default_arm(), 0.01
    plan = plan_experiment(arm, load="pull", moment=300.0)
    forces, moments, load_points = plan.wrenches
    ends = [
        deflections(arm, plan.joints, s * forces, s * moments, load_points, POINTS)[1] for s in (step, -step)
    ]
    linear = linear_deflections(arm, plan.joints, *plan.wrenches, POINTS)
    assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(linear, abs=1e-11)


class TestCampaign:
    def test_a_seed_always_gives_the_same_document(self):
        once, again, other = (simulate_campaign(default_arm(), seed=s) for s in (5, 5, 6))
        assert json.dumps(once) == json.dumps(again)
        assert json.dumps(once) != json.dumps(other)

    def test_without_noise_the_document_is_the_exact_arm(self):
        arm = default_arm(wrist_offset=0.1)
        document = simulate_campaign(arm, sigma=0.0, load="pull", moment=150.0)
        plan = experiment_of(document)
        unloaded, loaded = deflections(arm, plan.joints, *plan.wrenches, POINTS)
        assert read_array(document, "unloaded") == pytest.approx(unloaded, abs=1e-14)
        assert read_array(document, "loaded") == pytest.approx(loaded, abs=1e-14)
        assert "noise" not in document["measurement_set"]

    def test_noise_has_the_sigma_that_is_stated(self):
        arm, sigma = default_arm(), 3e-5
        plan = plan_experiment(arm, configurations=300, load="pull")
        exact = simulate_positions(arm, plan, TARGETS)
        read = simulate_positions(arm, plan, TARGETS, sigma=sigma)
        residuals = np.array(read) - np.array(exact)
        expected = pytest.approx(sigma, rel=4.0 / np.sqrt(2 * residuals[0].size))
        assert np.std(residuals[0]) == expected
        assert np.std(residuals[1]) == expected
        assert abs(np.corrcoef(residuals[0].ravel(), residuals[1].ravel())[0, 1]) < 0.08

    @pytest.mark.parametrize("sigma", [1e-9, 1e-6, 2e-5, 1e-3])
    def test_rounding_is_far_below_the_noise(self, sigma):
        read = simulate_positions(default_arm(), plan_experiment(default_arm()), TARGETS, sigma=sigma)
        steps = np.array(read) / (10.0 ** np.floor(np.log10(sigma / 100)))
        assert steps == pytest.approx(np.round(steps), abs=1e-3)

    def test_deflections_are_the_differences_of_the_positions(self):
        positions = simulate_campaign(default_arm())
        document = simulate_campaign(default_arm(), readings="deflections")
        expected = read_array(positions, "loaded") - read_array(positions, "unloaded")
        assert read_array(document, "deflection") == pytest.approx(expected, abs=1e-13)
        targets = document["measurement_set"]["flange_targets"]
        assert targets == {name: list(point) for name, point in TARGETS.items()}


def read_array(document, reading):
    """Readings of a document, in its unit of length, (N, T, 3)."""
    observations = document["measurement_set"]["observations"]
    return np.array([[r[reading] for r in o["readings"]] for o in observations])


ARM = default_arm()


@given(st.floats(0, 0.05), st.floats(0, 0.1), st.integers(0, 10**6))
@examples(100)
def test_link_errors_have_the_stated_size(length, angle, seed):
    wrong = with_link_errors(ARM, length=length, angle=angle, seed=seed)
    nominal, found = (
        np.diff(np.vstack([np.zeros(3), arm.axis_points, arm.flange_translation]), axis=0)
        for arm in (ARM, wrong)
    )
    np.testing.assert_allclose(np.linalg.norm(found - nominal, axis=1), length, atol=1e-14)
    sine = np.linalg.norm(np.cross(ARM.axis_directions, wrong.axis_directions), axis=1)
    cosine = np.einsum("ji,ji->j", ARM.axis_directions, wrong.axis_directions)
    np.testing.assert_allclose(np.arctan2(sine, cosine), angle, atol=1e-14)


def test_another_seed_errs_in_another_direction():
    first, second = (with_link_errors(ARM, length=1e-3, angle=1e-3, seed=seed) for seed in (0, 1))
    assert np.abs(first.axis_points - second.axis_points).max() > 1e-4
    assert np.abs(first.axis_directions - second.axis_directions).max() > 1e-4


def test_a_beam_bends_as_the_tables_say():
    """Cantilever of length L: tip deflection F L³/3EI + F L/GA, tip rotation M L/EI, F L²/2EI."""
    length, bending, shear = 1.2, 3e6, 5e8
    C = beam_compliance([length, 0, 0], bending=bending, torsion=2e6, axial=1e9, shear=shear)
    # Force along y at the tip: about the origin it is a force and a moment F L about z.
    wrench = np.array([0.0, 1.0, 0.0, 0.0, 0.0, length])
    at_origin = C @ wrench
    tip = at_origin[1] + at_origin[5] * length
    assert tip == pytest.approx(length**3 / (3 * bending) + length / shear)
    assert at_origin[5] == pytest.approx(length**2 / (2 * bending))
    assert C[0, 0] == pytest.approx(length / 1e9)
    assert C[3, 3] == pytest.approx(length / 2e6)
    assert np.linalg.eigvalsh(C).min() >= 0.0


def test_the_sag_is_where_the_energy_has_its_minimum():
    bodies, q = default_bodies(), random_configurations(ARM, 20)
    spring = Balancer(3e4, 0.3, np.array([-0.2, 0.0, 0.5]), 1, np.array([-0.3, 0.0, 0.2]))
    force, point = np.array([[300.0, -200.0, -900.0]] * 20), np.tile(LOAD_POINT, (20, 1))
    theta = sag(ARM, bodies, q, force=force, load_point=point, balancer=spring)
    least = energy(ARM, bodies, q, theta, force, point, spring)
    for step in 1e-5 * np.eye(6):
        for sign in (-1.0, 1.0):
            assert (energy(ARM, bodies, q, theta + sign * step, force, point, spring) > least).all()
