"""What a plan strikes out or refuses, with its reason, and what is advised beyond the readings."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import ARM, estimate, prepare
from support.documents import campaign
from support.refusals import refused

from jointstiff.schemas.plan import LoadPointGoal, Surroundings
from jointstiff.simulator import LOAD_POINT, TARGETS, truth
from jointstiff.simulator.document import experiment_of
from jointstiff.simulator.equilibrium import equilibrium
from jointstiff.solver.design.candidates import Equipment, Loads, PlanRequest, find_feasible_readings
from jointstiff.solver.design.optimum import Candidates, DesignProblem, DOptimality, optimise_design
from jointstiff.solver.design.plan import (
    DistinctPostures,
    advise_next_readings,
    find_exact_design,
    plan_campaign,
)
from jointstiff.solver.mechanics.measurements import Instrument

PLACES, FREE = np.array(list(TARGETS.values())), np.full(6, np.inf)
THREE = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 6))
BOX = np.array([1.64 + 0.24, 0.0, 0.78 + 1.12 + 0.06]) + np.array([[-0.1], [0.1]])
"""About the flange with all joints at zero."""
AHEAD, BEHIND = (Instrument((x, 0.0, z), 1e-5, 0.0, 1e-5, 0.0) for x, z in ((5.0, 2.0), (-5.0, 1.2)))
TURNED = {"link_radius": 0.0, "facing": dict.fromkeys(TARGETS, (0.0, 0.0, 1.0)), "acceptance": 0.5}


@pytest.fixture(scope="module")
def robot():
    return prepare(campaign(configurations=3))[0]


def equipment(kind="any_direction", targets=3, limit=FREE, anchors=(), **options):
    loads = Loads(kind, 1500.0, limit, np.array(anchors).reshape(-1, 3))
    return Equipment(PLACES[:targets], np.array(LOAD_POINT), loads, 2e-5, **options)


def plan(robot, kind="any_direction", **options):
    """Plan twelve readings of a target, or what the options say."""
    asked = {"readings": 12, "candidates": 150, "validation": 0.0, "nominal": ARM.compliances, "prior": FREE}
    return plan_campaign(robot, PlanRequest(equipment(kind, 1), **asked | options))


FEWER = "request fewer readings, a smaller angle, or more candidates"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"kind": "dead_weight", "joints": np.arange(6)},
            "joints | no candidate load twists joint_1, or no target moves when these joints turn | allow "
            "loads in other directions, or omit these joints from `joints`",
        ),
        (
            {"cell": Surroundings(floor=9.0)},
            "candidates | none of 150 candidate readings is feasible: floor_or_box 150 | relax the "
            "condition that excludes most readings, or give other postures or loads",
        ),
        (
            {"readings": 1},
            "readings | without the readings for validation, 1 readings remain, too few to determine 6 "
            "joints | "
            "request more readings, or a smaller fraction for validation",
        ),
        (
            {"criterion": "work_area"},
            "work_area | criterion work_area needs a work area | give `work_area`, two corners of a box, or "
            "use criterion relative_a, d or e",
        ),
        (
            {"goal": LoadPointGoal(kind="load_point", mistake=0.02), "nominal": np.full(6, np.nan)},
            "goal | an error of the load point shows in deflections, but no stiffness is known to compute "
            "the deflections | continue a campaign, or state the expected `stiffness` of the joints",
        ),
        (
            {"work_area": [[50.0] * 3, [60.0] * 3]},
            "work_area | only 0 of 150 candidate postures have their load point in the work area: its "
            "nearest place is 86.6 m from the origin of R0, and the arm reaches at most 3.67 m | check the "
            "unit and the digits of the work area's corners in R0, and move it within reach",
        ),
        (
            {"work_area": [[1.5, 0.0, 1.0], [1.501, 0.001, 1.001]]},
            "work_area | only 0 of 150 candidate postures have their load point in the work area, of 1 mm × "
            "1 mm × 1 mm | check the unit of the work area's corners in R0, and give a larger work area, or "
            "more candidates",
        ),
        (
            {"work_area": [[1.0, -0.5, 0.6], [1.5, 0.5, 0.6]]},
            "work_area | only 0 of 150 candidate postures have their load point in the work area: its two "
            "corners have the same z, so that it has no volume | give two opposite corners of the box in "
            "R0; the second one is no size",
        ),
        (
            {"readings": 9, "angle": 9.0},
            "distinct_angle | only 1 candidates are in postures that differ by 516°, but 9 readings are "
            f"requested | {FEWER}",
        ),
        (
            {"postures": THREE, "validation": 0.5, "readings": 4},
            "distinct_angle | only 0 of 2 readings for validation are in postures that differ from those "
            "of all other readings | "
            f"{FEWER}",
        ),
    ],
)
def test_a_plan_that_cannot_be_made_says_why(robot, options, said):
    assert refused(plan, robot, **options) == said


def test_a_plan_leaves_out_a_joint_that_no_load_twists(robot):
    assert plan(robot, "dead_weight").pool.parameters.joints.tolist() == [1, 2, 3, 4, 5]


def problem(rows, n=6):
    return DesignProblem(Candidates.from_rows(rows), DOptimality(4), n, np.zeros((4, 4)))


def test_a_design_needs_candidates_that_determine_all_parameters_in_postures_apart():
    rows = np.random.default_rng(1).standard_normal((30, 2, 4)) * [1.0, 0.3, 2.0, 0.7]
    assert refused(problem, rows * [1, 1, 0, 1]) == (
        "candidates | all candidates together determine only 3 of 4 parameters; no load changes parameter "
        "[2] | add loads or postures that change the missing parameters, or leave these parameters out"
    )
    ten, three_postures = (
        problem(rows, 10),
        DistinctPostures(np.repeat([[0.0], [1.0], [2.0]], 10, axis=0), 0.5),
    )
    assert refused(find_exact_design, ten, optimise_design(ten), three_postures) == (
        "distinct_angle | only 3 candidates are in postures that differ by 28.6°, but 10 readings are "
        f"requested | {FEWER}"
    )


@pytest.mark.parametrize(
    ("cell", "options", "struck_out"),
    [
        ({}, {"joint_2": 100.0}, "joint_limits"),
        (
            {},
            {"kind": "dead_weight", "direction": [[0.0, 0.0, -1.0]], "limit": np.full(6, 100.0)},
            "torque",
        ),
        ({"floor": 3.0}, {}, "floor_or_box"),
        ({"obstacles": [BOX.tolist()]}, {}, "floor_or_box"),
        ({"inside": (BOX + 9.0).tolist()}, {}, "floor_or_box"),
        ({"obstacles": [np.add(BOX, [0.0, 0.2, 0.0]).tolist()]}, {}, "floor_or_box"),
        ({"obstacles": [np.add(BOX, [0.0, 0.4, 0.0]).tolist()]}, {}, None),
        ({"link_radius": 0.15}, {"instrument": BEHIND}, "line_of_sight"),
        (TURNED, {"instrument": BEHIND}, "reflector_acceptance"),
        ({"floor": 0.1}, {"instrument": AHEAD}, None),
        (
            {"link_radius": 0.15},
            {"kind": "cable", "direction": [[-1.0, 0.0, -0.2]], "anchors": [[-3.0, 0.0, 1.2]]},
            "cable",
        ),
        (
            {"link_radius": 0.0},
            {
                "kind": "cable",
                "direction": [[0.0, 0.0, 1.0]],
                "anchors": [[2.06, 3.02, 5.02], [2.06, 0.02, 2.07]],  # the second too near the load
            },
            "cable",
        ),
    ],
)
def test_a_reading_is_struck_out_by_what_stands_in_its_way(robot, cell, options, struck_out):
    options = dict(options)
    joints = np.radians([[0.0, options.pop("joint_2", 0.0), 0.0, 0.0, 0.0, 0.0]])
    direction = options.pop("direction", None)
    direction = None if direction is None else np.array(direction)
    kept, reasons = find_feasible_readings(
        robot, equipment(**options), Surroundings(**cell), joints, direction
    )
    assert kept.tolist() == [struck_out is None]
    assert reasons == ({} if struck_out is None else {struck_out: 1})


def advice(robot, measurements):
    return advise_next_readings(robot, measurements, estimate(robot, measurements))


@pytest.mark.parametrize(
    ("force", "uncertainties", "falls_to"),
    [
        (
            100.0,
            [4.609e-8, 2.005e-6],
            ["compliance falls to 0.046 µrad/(N·m)", "compliance falls to 2 µrad/(N·m)"],
        ),
        (
            250.0,
            [1.844e-8, 8.02e-7],
            ["compliance falls to 0.018 µrad/(N·m)", "stiffness falls to 0.913 · 10⁶ N·m/rad"],
        ),
    ],
)
def test_advice_names_posture_and_load_and_what_they_give(force, uncertainties, falls_to):
    """A compliance may be less than its uncertainty: that of its inverse would be more than itself."""
    pieces = advice(*prepare(campaign("dead_weight", configurations=4, seed=3, force=force)))
    assert [piece.joint for piece in pieces] == ["joint_1", "joint_4"]
    assert [piece.standard_uncertainty for piece in pieces] == pytest.approx(uncertainties, rel=1e-3)
    assert [np.linalg.norm(piece.force) for piece in pieces] == pytest.approx([force] * 2, rel=1e-3)
    first, second = (piece.message for piece in pieces)
    begins = f"in posture c03 apply {force:.0f} N along (0.00, 1.00, 0.00): the uncertainty of joint_1's"
    assert first == f"{begins} {falls_to[0]}"
    same = (
        "in posture (-31, 1, -38, 79, -59, -42)°, if this posture is free of collisions, apply the load of "
        f"{force:.0f} N as before: the uncertainty of"
    )
    assert second == f"{same} joint_4's {falls_to[1]}, 0.4 times its present value"


def test_nothing_is_advised_without_a_force_or_outside_of_the_limits():
    assert advice(*prepare(campaign("dead_weight", 2, force=0.0, moment=300.0, sigma=1e-3))) == ()
    robot, readings = prepare(campaign("dead_weight", 3, seed=3))
    narrow = tuple(
        replace(joint, limits=(3.0, 3.1)) if joint.name == "joint_2" else joint
        for joint in robot.chain.joints
    )
    assert advice(type(robot)(replace(robot.chain, joints=narrow).model()), readings) == ()


def test_the_truth_of_a_simulated_campaign_names_what_no_load_shows():
    hung = campaign("dead_weight")
    experiment = experiment_of(hung)
    assert not equilibrium(ARM, experiment.joints, *experiment.wrenches)[:, 0].any()
    found = truth(ARM, hung)
    assert found["not_observable"] == ["joint_1"]
    assert found["joints"] == [f"joint_{i}" for i in range(1, 7)]
    assert found["stiffness"] == pytest.approx(ARM.stiffnesses)
    assert found["compliance"] == pytest.approx(1.0 / ARM.stiffnesses)
    rigid = truth(replace(ARM, stiffnesses=np.array([1e6, np.inf, 1e6, 1e5, 1e5, 1e5])), hung)
    assert rigid["stiffness"] == [1e6, None, 1e6, 1e5, 1e5, 1e5]
    assert rigid["compliance"] == pytest.approx([1e-6, 0.0, 1e-6, 1e-5, 1e-5, 1e-5])
