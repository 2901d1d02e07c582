"""Sweeps, poses and targets that define no geometry are refused, each with its place, reason and remedy."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import ARM
from support.geometry_truth import FANUC_MAP, HOME, NAMES, SIGMA, Cell, nominal, swept, with_sweep
from support.refusals import refused

from jointstiff.solver.geometry.frames import (
    BaseTargets,
    FlangeConvention,
    find_base_frame,
    identify_model,
)
from jointstiff.solver.geometry.identification import Conventions, identify_from_sweeps, report_sweep
from jointstiff.solver.geometry.poses import Poses, calibrate
from jointstiff.solver.geometry.sweeps import SweepSet, fit_axis, identify_axes
from jointstiff.solver.mechanics.chain import KinematicChain
from jointstiff.solver.mechanics.robot import JointMap

CELL, COUPLED, CHAIN = Cell(), Cell(matrix=FANUC_MAP), nominal()
SHORT = KinematicChain("short", CHAIN.base, CHAIN.joints[4].child, CHAIN.joints[:5])
SWEEPS = CELL.sweeps()
ALONE = "turn each joint alone in a sweep of its own"


def poses(count):
    limits = ARM.limits
    angles = 0.6 * np.random.default_rng([1, 31]).uniform(limits[:, 0], limits[:, 1], (count, 6))
    present = np.ones((count, 3), dtype=bool)
    return Poses(angles, CELL.readings(angles), present, NAMES, JointMap.identity(6), SIGMA)


def arc(low, high, count=15):
    """Sweep joint 3 over an arc [°]."""
    angles = CELL.sweep(2, np.radians(np.linspace(low, high, count)))
    return swept(CELL, 2, angles, np.random.default_rng(0))


def joint_3_turned_with_joint_2():
    angles = SWEEPS.sweeps[1].angles.copy()
    angles[:, 2] += np.linspace(0.0, 0.3, len(angles))
    return with_sweep(SWEEPS, 1, swept(CELL, 1, angles))


def coupled_sweep_from_elsewhere():
    moved = COUPLED.sweeps(home=HOME + np.radians([5.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    return with_sweep(COUPLED.sweeps(), 2, moved.sweeps[2])


def only_joint_1():
    alone = CELL.sweeps(np.random.default_rng(0)).sweeps[0]
    one = replace(alone, angles=alone.angles[:, :1])
    return SweepSet((one,), NAMES, JointMap.identity(1), SIGMA)


def parallel_cell():
    """Return a cell whose joint 2 turns about an axis 0.01 rad off that of joint 1."""
    directions = ARM.axis_directions[[0, 0, 2, 3, 4, 5]]
    directions[1] = [0.0, np.sin(0.01), np.cos(0.01)]
    return Cell(replace(ARM, axis_directions=directions))


@pytest.mark.parametrize(
    ("do", "said"),
    [
        (
            lambda: identify_from_sweeps(only_joint_1(), Conventions("axes", "axes")),
            "sweeps | a single axis does not define a base frame | give the transform from the tracker's "
            "frame to R0 explicitly",
        ),
        (
            lambda: identify_axes(coupled_sweep_from_elsewhere()),
            "sweep of joint_2 | this sweep turns model joints 2 and 3, and it was recorded in another "
            "configuration than the sweep of joint_3 | start both sweeps from the same configuration of "
            "the other joints",
        ),
        (
            lambda: identify_axes(with_sweep(COUPLED.sweeps(), 2)),
            f"sweeps | no sweep determines the axis of model joint 3 | {ALONE}",
        ),
        (
            lambda: identify_axes(joint_3_turned_with_joint_2()),
            "sweep of joint_2 | model joints 2 and 3 turn in one sweep | turn one controller joint at a "
            "time; if the joint map couples more than two joints, move the other joints so that one axis "
            "turns; check the order of the rows",
        ),
        (
            lambda: identify_axes(with_sweep(with_sweep(SWEEPS, 4), 3)),
            f"sweeps | no sweep determines the axis of model joint 4, 5 | {ALONE}",
        ),
        (
            lambda: with_sweep(SWEEPS, 5, SWEEPS.sweeps[0]),
            "sweeps | 2 sweeps turn model joint 1 | give one sweep per joint; add the positions of a "
            "repeated sweep to the first sweep",
        ),
        (
            lambda: find_base_frame(identify_axes(parallel_cell().sweeps())),
            "sweeps | the two axes that should define the frame are nearly parallel (0.57°) | give the "
            "transform explicitly; parallel axes do not define a frame",
        ),
    ],
)
def test_sweeps_that_do_not_determine_each_axis_are_refused(do, said):
    assert refused(do) == said


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (
            1e3,
            "units.length | a target moves by 2,166 m; 10 mm to 50 m is plausible | check units.length: "
            "positions in mm seem to be declared in m; for a machine of another size give the robot as a "
            "URDF or table",
        ),
        (
            2e-3,
            "units.length | no target moves farther than 4.3 mm; 10 mm to 50 m is plausible | check "
            "units.length: positions in m seem to be declared in mm; for a machine of another size give the "
            "robot as a URDF or table",
        ),
        (
            1e-3,
            "sweep of joint_4 | the joint did not move: the controller shows 160°, but no target moved "
            "by more than 0.734 mm | check that readings and angles belong together, that the targets "
            "were tracked, and units.length",
        ),
    ],
)
def test_positions_in_another_unit_are_told_by_how_far_targets_move(factor, said):
    def scaled():
        return replace(
            SWEEPS, sweeps=tuple(replace(one, points=one.points * factor) for one in SWEEPS.sweeps)
        )

    assert refused(scaled) == said


ARC = arc(-40.0, 60.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {name: getattr(ARC, name)[:3] for name in ("angles", "points", "present")},
            "the sweep has 3 positions; at least 4 are needed | record more positions; 10 to 20 over a "
            "wide arc are good practice",
        ),
        (
            {"joint": 1},
            "the joint did not move: its angle changes by only 0°, while joint 3 turned | name the joint "
            "that was turned, or repeat the sweep",
        ),
        (
            {"angles": ARC.angles[:1].repeat(len(ARC), axis=0)},
            "the joint did not move: its angle changes by only 0° | name the joint that was turned, or "
            "repeat the sweep",
        ),
        (
            {"points": ARC.points[:1].repeat(len(ARC), axis=0)},
            "the joint did not move: the controller shows 100°, but no target moved by more than 0 mm | "
            "check that readings and angles belong together, that the targets were tracked, and "
            "units.length",
        ),
        (
            {"points": np.where(ARC.points == ARC.points[3, 1, 0], np.nan, ARC.points)},
            "an angle or a coordinate is not finite | omit or repeat the reading",
        ),
        (
            {"points": ARC.points[:, :2]},
            "the angles have shape (15, 6), the readings (15, 2, 3), and their covariance (3, 3) | give "
            "all joint angles and a reading of each target for each position, and one covariance for all "
            "readings or one for each",
        ),
    ],
)
def test_a_sweep_turns_its_joint_and_moves_its_targets(changes, said):
    assert refused(replace, ARC, **changes) == f"sweep of joint_3 | {said}"


def test_a_short_arc_is_a_finding_and_a_shorter_one_is_refused():
    assert refused(SweepSet, (arc(0.0, 4.0),), NAMES, JointMap.identity(6), SIGMA) == (
        "sweep of joint_3 | the arc of 4° is too short to determine the axis | sweep at least 5°, "
        "better 90° or more"
    )
    short = arc(0.0, 20.0)
    (finding,) = report_sweep(fit_axis(short, short.angles[:, 2], sigma=SIGMA), NAMES)
    assert (finding.code, finding.where) == ("short_arc", "sweep of joint_3")
    assert finding.message == "an arc of 20° determines the axis only within 234 µm"
    assert finding.remedy == "sweep at least 90°"


def test_targets_on_a_line_define_no_frame():
    line = np.linspace(0.0, 1.0, 4)[:, None] * np.ones(3)
    on_a_line = np.outer([1.0, 2.0, 3.0], [0.0, 0.1, 0.0])
    assert refused(FlangeConvention((0, 1, 2)).place, (), on_a_line) == (
        "targets | the three targets lie on a line and do not define a flange frame | choose three "
        "targets that form a triangle"
    )
    base = BaseTargets(line, line, np.eye(3), ("1", "2", "3", "4"))
    assert refused(base.fit_drift, SIGMA, np.ones(3)) == (
        "base_targets_after | the base targets lie on a line, so a rotation about that line cannot "
        "be determined | place the targets so that they form a triangle"
    )


def test_a_nominal_model_has_the_joints_that_were_swept():
    found = identify_axes(CELL.sweeps(np.random.default_rng(0)))
    frame = find_base_frame(found)
    assert refused(identify_model, found, frame, FlangeConvention(), nominal=SHORT) == (
        "nominal | the nominal model has 5 revolute joints, but the sweeps show 6 axes | give the "
        "nominal model of the robot that was measured"
    )


@pytest.mark.parametrize(
    ("do", "said"),
    [
        (
            lambda: calibrate(CHAIN, poses(3)),
            "27 measured coordinates do not determine 33 unknowns | record more poses, or more targets "
            "in each pose",
        ),
        (
            lambda: calibrate(CHAIN, poses(1)),
            "9 measured coordinates do not determine 33 unknowns | record more poses, or more targets in "
            "each pose",
        ),
        (
            lambda: calibrate(SHORT, poses(30)),
            "the nominal model has 5 revolute joints, but the poses have 6 angles | give the nominal "
            "model of the robot that was measured",
        ),
        (
            lambda: replace(poses(30), points=poses(4).points),
            "the angles have shape (30, 6), the readings (4, 3, 3), and their covariance (3, 3) | give "
            "all joint angles and a reading of each target for each position, and one covariance for all "
            "readings or one for each",
        ),
        (
            lambda: replace(poses(30), angles=np.full((30, 6), np.nan)),
            "an angle or a coordinate is not finite | omit or repeat the reading",
        ),
    ],
)
def test_poses_that_determine_no_arm_are_refused(do, said):
    assert refused(do) == f"poses | {said}"
