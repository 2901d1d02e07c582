"""Plans and advice on what to measure next: followed with exact springs, they keep their promise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flint import fmpq_mat
from hypothesis import given
from hypothesis import strategies as st
from support.campaigns import ARM, estimate, prepare
from support.examples import examples
from support.shared_data import shared
from support.springs import SpringCampaign

from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.plan import Surroundings
from jointstiff.service.kinds.identification import to_settings
from jointstiff.simulator import LOAD_POINT, TARGETS, simulate_campaign
from jointstiff.simulator.campaign import Experiment
from jointstiff.simulator.equilibrium import deflections
from jointstiff.solver.design.candidates import (
    Equipment,
    Loads,
    PlanRequest,
    Pool,
    feasible,
)
from jointstiff.solver.design.optimum import uncertainty_of
from jointstiff.solver.design.plan import advise, plan_campaign
from jointstiff.solver.errors import RequestError
from jointstiff.solver.estimation.identify import identify
from jointstiff.solver.mechanics.configuration import Configurations
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Instrument
from jointstiff.solver.mechanics.robot import Robot

N = len(ARM.stiffnesses)
PLACES = np.array(list(TARGETS.values()))
SIGMA = 2e-5
AREA = np.array([[0.5, -2.0, 0.0], [3.0, 2.0, 2.5]])


@pytest.fixture(scope="module")
def robot():
    return prepare(simulate_campaign(ARM, configurations=3))[0]


def equipment(kind="any_direction", force=1500.0, **options):
    anchors = np.array(options.pop("anchors", np.empty((0, 3))))
    limit = options.pop("torque_limit", np.full(N, np.inf))
    return Equipment(PLACES, np.array(LOAD_POINT), Loads(kind, force, limit, anchors), SIGMA, **options)


def request_of(tools, **options):
    defaults = {"readings": 12, "candidates": 150, "validation": 0.0}
    return PlanRequest(
        tools, **{"nominal": ARM.compliances, "prior": np.full(N, np.inf)} | defaults | options
    )


def read(plan, noise):
    """Return what a tracker reads, on springs that balance the load exactly."""
    moments, points = np.zeros_like(plan.force), np.tile(LOAD_POINT, (len(plan.force), 1))
    exact = np.stack(deflections(ARM, plan.joints, plan.force, moments, points, PLACES))
    campaign = SpringCampaign(ARM, Experiment(plan.joints, plan.force, moments, points), *exact)
    return campaign.measurements(*(exact + SIGMA * noise), sigma=SIGMA)


class TestPromise:
    @pytest.mark.parametrize("draws", [30, pytest.param(100, marks=pytest.mark.slow)])
    def test_is_what_is_found_on_exact_springs(self, robot, draws):
        """The estimates scatter as promised, within the sampling error."""
        plan = plan_campaign(robot, request_of(equipment()))
        rng = np.random.default_rng(0)
        settings = to_settings(RunOptions(positive=False, complementary_stiffness="included"), robot)
        readings = (read(plan, rng.standard_normal((2, 12, 3, 3))) for _ in range(draws))
        found = [identify(robot, each, settings) for each in readings]
        promised = plan.uncertainty * ARM.compliances
        stated = np.mean([[joint.standard_uncertainty for joint in each.joints] for each in found], axis=0)
        np.testing.assert_allclose(stated, promised, rtol=0.01)
        # Of 100, whose standard error is 7 %, a standard deviation off by a third is seen by 95 % power.
        scatter = np.std([each.compliance for each in found], axis=0, ddof=1)
        np.testing.assert_allclose(scatter, promised, rtol=2.0 * np.sqrt(1.0 / draws))

    def test_one_that_goes_on_counts_the_readings_so_far(self, robot):
        first = plan_campaign(robot, request_of(equipment(), readings=6))
        so_far = read(first, np.zeros((2, 6, 3, 3)))
        second = plan_campaign(robot, request_of(equipment(), readings=6, so_far=so_far))
        np.testing.assert_allclose(second.before, first.uncertainty, rtol=0.01)
        assert (second.uncertainty < first.uncertainty).all()
        alone = plan_campaign(robot, request_of(equipment(), readings=6, seed=1))
        assert np.square(second.uncertainty).sum() < np.square(alone.uncertainty).sum()

    def test_of_a_gauge_is_what_its_rows_say(self, robot):
        """The promise by the simulator's kinematics, and better than one direction for all readings."""
        tools = replace(equipment(), targets=PLACES[:1])
        axes = np.eye(3)
        plan = plan_campaign(robot, request_of(tools, readings=12, directions=axes))
        assert {int(np.argmax(row)) for row in plan.along} > {0}
        posture = ARM.posture(plan.joints)
        target = posture.point_to_base(np.broadcast_to(PLACES[0], (12, 3)))
        load = posture.point_to_base(np.broadcast_to(LOAD_POINT, (12, 3)))
        torque = np.einsum("nji,ni->nj", posture.velocities(load), plan.force)
        A = np.einsum("nji,ni->nj", posture.velocities(target), plan.along) * torque * ARM.compliances
        promised = np.sqrt(np.diag(np.linalg.inv(A.T @ A))) * np.sqrt(2.0) * SIGMA
        np.testing.assert_allclose(plan.uncertainty, promised, rtol=1e-6)
        up = plan_campaign(robot, request_of(tools, readings=12, directions=axes[2:]))
        assert np.square(plan.uncertainty).sum() < np.square(up.uncertainty).sum()

    @pytest.mark.parametrize("kind", ["dead_weight", "any_direction", "cable"])
    def test_better_than_other_plans_and_certified(self, robot, kind):
        tools = equipment(kind, anchors=[[3.0, 3.0, 0.0], [3.0, -3.0, 0.0], [0.0, 3.0, 3.0]])
        wanted = np.arange(1, N) if kind == "dead_weight" else None
        plan = plan_campaign(robot, request_of(tools, joints=wanted, readings=15, validation=0.2))
        assert plan.random.efficiency < 0.6
        assert plan.one_at_a_time.efficiency < 1.0 + 1e-9
        assert 0.9 < plan.efficiency <= 1.0
        assert plan.validation.sum() == 3
        apart = np.abs(plan.joints[:, None] - plan.joints).max(axis=2) + 9.0 * np.eye(15)
        assert apart.min() >= np.radians(10.0) - 1e-9
        np.testing.assert_allclose(np.linalg.norm(plan.force, axis=1), 1500.0)
        if kind == "dead_weight":
            np.testing.assert_allclose(plan.force[:, :2], 0.0)

    def test_for_a_work_area_with_elastic_links_as_nuisance(self, robot):
        options = {"criterion": "work_area", "work_area": AREA, "readings": 12, "candidates": 60}
        alone, with_links = (
            plan_campaign(robot, request_of(equipment(), **options, links=links)) for links in (False, True)
        )
        assert set(alone.efficiencies) == {"relative_a", "d", "work_area"}
        assert alone.deflection[0] <= alone.deflection[1] < 1e-4
        assert with_links.deflection[0] > alone.deflection[0]
        assert (with_links.uncertainty > alone.uncertainty).all()

    @pytest.mark.slow
    def test_the_worst_place_with_elastic_links(self, robot):
        request = request_of(equipment(), work_area=AREA, readings=12, candidates=40, links=True)
        worst = plan_campaign(robot, replace(request, criterion="worst_place"))
        mean = plan_campaign(robot, replace(request, criterion="work_area"))
        assert worst.weights_gap < 0.02
        assert worst.deflection[1] < 1.05 * mean.deflection[1]
        assert mean.deflection[0] < 1.05 * worst.deflection[0]

    def test_the_links_that_the_work_area_sees_are_kept(self, robot):
        """All but a hundredth of what links of 30 % of the joints' deflection do there, not the first few."""
        request = request_of(equipment(), criterion="work_area", work_area=AREA, candidates=120, links=True)
        pool = Pool.of(robot, request)
        variance = np.diagonal(pool.places, axis1=1, axis2=2).mean(axis=0)
        by_joints, by_links = variance[:N].sum(), variance[N:]
        assert by_links.sum() / by_joints == pytest.approx(0.09 * 0.99, rel=0.02)
        assert len(by_links) > 18
        np.testing.assert_array_equal(
            np.diagonal(pool.parameters.prior), np.r_[np.zeros(N), np.ones(len(by_links))]
        )


DOWN = np.array([[0.0, 0.0, -1.0]])
BOX = np.array([1.64 + 0.24, 0.0, 0.78 + 1.12 + 0.06]) + np.array([[-0.1], [0.1]])  # about the flange at zero
AHEAD, BEHIND = (Instrument((x, 0.0, z), 1e-5, 0.0, 1e-5, 0.0) for x, z in ((5.0, 2.0), (-5.0, 1.2)))
TURNED = Surroundings(link_radius=0.0, facing=dict.fromkeys(TARGETS, (0.0, 0.0, 1.0)), acceptance=0.5)
CABLE = equipment("cable", anchors=[[-3.0, 0.0, 1.2]])
BESIDE = equipment("cable", anchors=[[2.06, 3.02, 5.02], [2.06, 0.02, 2.07]])  # the second too near the load


def box_aside(distance):
    """A box that far to the side of where the flange is at zero; the links have their default radius."""
    return Surroundings(obstacles=[np.add(BOX, [0.0, distance, 0.0]).tolist()])


class TestFeasibility:
    @pytest.mark.parametrize(
        ("reason", "tools", "cell", "degrees", "direction"),
        [
            ("joint_limits", equipment(), Surroundings(), 100, None),
            ("torque", equipment("dead_weight", torque_limit=np.full(N, 100.0)), Surroundings(), 0, DOWN),
            ("floor_or_box", equipment(), Surroundings(floor=3.0), 0, None),
            ("floor_or_box", equipment(), Surroundings(obstacles=[BOX.tolist()]), 0, None),
            ("floor_or_box", equipment(), Surroundings(inside=(BOX + 9.0).tolist()), 0, None),
            ("floor_or_box", equipment(), box_aside(0.2), 0, None),
            (None, equipment(), box_aside(0.4), 0, None),
            ("line_of_sight", equipment(instrument=BEHIND), Surroundings(link_radius=0.15), 0, None),
            ("reflector_acceptance", equipment(instrument=BEHIND), TURNED, 0, None),
            ("cable", CABLE, Surroundings(link_radius=0.15), 0, [[-1.0, 0.0, -0.2]]),
            ("cable", BESIDE, Surroundings(link_radius=0.0), 0, [[0.0, 0.0, 1.0]]),
            (None, equipment(instrument=AHEAD), Surroundings(floor=0.1), 0, None),
        ],
    )
    def test_each_reason_strikes_out_what_it_should(self, robot, reason, tools, cell, degrees, direction):
        joints = np.radians([[0.0, degrees, 0.0, 0.0, 0.0, 0.0]])
        kept, struck_out = feasible(
            robot, tools, cell, joints, direction if direction is None else np.array(direction)
        )
        assert struck_out == ({} if reason is None else {reason: 1})
        assert kept.tolist() == [reason is None]


THREE = np.random.default_rng(0).uniform(-1.0, 1.0, (3, N))


class TestRefusals:
    def test_a_joint_that_no_weight_twists_is_left_out_unless_it_is_named(self, robot):
        every = np.arange(robot.n)
        with pytest.raises(RequestError, match="no candidate load twists joint_1"):
            plan_campaign(robot, request_of(equipment("dead_weight"), joints=every))
        plan = plan_campaign(robot, request_of(equipment("dead_weight")))
        assert plan.pool.parameters.joints.tolist() == every[1:].tolist()

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"cell": Surroundings(floor=9.0)}, "none of 150 readings is feasible: floor_or_box 150"),
            ({"readings": 1}, "1 readings without those held out do not determine 6 joints"),
            ({"criterion": "work_area"}, "needs a work area"),
            ({"work_area": [[50.0] * 3, [60.0] * 3]}, "0 of 150 candidates have their load point"),
            ({"readings": 9, "angle": 9.0}, "only 1 candidates are in postures 516° apart"),
            ({"postures": THREE, "validation": 0.5, "readings": 4}, "0 of 2 readings for validation"),
        ],
    )
    def test_what_cannot_be_planned(self, robot, options, message):
        tools = replace(equipment(), targets=PLACES[:1])
        with pytest.raises(RequestError, match=message):
            plan_campaign(robot, request_of(tools, **options))


def advised(document, **options):
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


class TestFollowed:
    """What the advice promised is what the same identification finds with the advised reading."""

    def test_several_joints_without_a_trace(self):
        """One posture with the weight above the wrist: joints 1 and others show nothing."""
        robot, measurements, _, pieces = advised(simulate_campaign(ARM, configurations=1, seed=1))
        assert pieces
        for piece in pieces:
            assert np.linalg.norm(piece.force) == pytest.approx(1500.0)
            after = estimate(robot, follow(robot, measurements, piece))
            joint = after.joints[robot.joint_names.index(piece.joint)]
            assert joint.standard_uncertainty == pytest.approx(piece.standard_uncertainty, rel=0.01)


class TestWords:
    @pytest.mark.parametrize(("force", "whose"), [(100.0, "compliance"), (250.0, "stiffness")])
    def test_the_uncertainty_left_is_that_of_a_stiffness_only_where_it_is_less(self, force, whose):
        """A compliance may be less than its uncertainty: that of its inverse would be more than itself."""
        *_, found, pieces = advised(simulate_campaign(ARM, configurations=4, seed=3, force=force))
        assert found.joints[5].compliance > 0.0
        (piece,) = (each for each in pieces if each.joint == "joint_6")
        assert (piece.standard_uncertainty < found.joints[5].compliance) == (whose == "stiffness")
        assert f"the uncertainty of joint_6's {whose} falls to" in piece.message


class TestNone:
    def test_where_all_joints_are_well_determined(self):
        *_, pieces = advised(shared("simulated/pull_40"))
        assert pieces == ()

    def test_where_an_error_of_all_readings_is_the_most(self):
        """Of a joint that the load point decides, no reading tells more."""
        document = simulate_campaign(ARM, load="pull", configurations=8, seed=3, sigma=6e-5)
        robot, measurements = prepare(document)
        sure, unsure = (
            replace(measurements, common_uncertainty=CommonUncertainty(load_point=place))
            for place in (0.0, 0.01)
        )
        found = estimate(robot, unsure)
        assert "joint_6" in {piece.joint for piece in advise(robot, sure, estimate(robot, sure))}
        pieces = advise(robot, unsure, found)
        assert {piece.joint for piece in pieces} == {"joint_4"}
        for piece in pieces:
            after = estimate(robot, follow(robot, unsure, piece))
            j = robot.joint_names.index(piece.joint)
            before, left = (each.covariance[j, j] for each in (found, after))
            assert left < 0.97**2 * before
            assert np.sqrt(left) == pytest.approx(piece.standard_uncertainty, rel=0.05)

    def test_where_no_force_was_applied(self):
        document = simulate_campaign(ARM, force=0.0, moment=300.0, configurations=2, sigma=1e-3)
        *_, found, pieces = advised(document)
        assert any(joint.status != "identified" for joint in found.joints)
        assert pieces == ()


class TestNewPostures:
    def test_none_where_the_limits_leave_no_room(self):
        document = simulate_campaign(ARM, configurations=3, seed=3)
        confined, measurements = limited(document, (3.0, 3.1))
        # The measured postures are beyond these limits, too, and none of them is advised again.
        assert not advise(confined, measurements, estimate(confined, measurements))


def limited(document, limits):
    """Robot with other limits of joint_2, and measurements."""
    robot, measurements = prepare(document)
    joints = (
        replace(joint, limits=limits) if joint.name == "joint_2" else joint for joint in robot.chain.joints
    )
    return Robot(replace(robot.chain, joints=tuple(joints))), measurements


def follow(robot, measurements, advice):
    """The set with the advised reading, taken on springs that balance the load exactly."""
    first = Configurations(robot, measurements.joints[:1])
    places = (measurements.position[0] - first.flange_translation[0]) @ first.flange_rotation[0]
    index = 0 if advice.observation is None else measurements.labels.index(advice.observation)
    reading = {
        "joints": np.array([advice.joints]),
        "force": np.array([advice.force]),
        "moment": np.zeros((1, 3)),
        "load_point": measurements.load_point[index][None],
    }
    unloaded, loaded = deflections(ARM, *reading.values(), places)
    noise = np.random.default_rng(0).normal(0, np.sqrt(2) * (measurements.sigma or 0.0), loaded.shape)
    reading |= {"position": unloaded, "deflection": loaded - unloaded + noise}
    reading |= {"in_flange": measurements.in_flange[:1], "present": measurements.present[:1]}
    joined = {name: np.concatenate([getattr(measurements, name), new]) for name, new in reading.items()}
    return replace(measurements, **joined, labels=(*measurements.labels, "advised"))
