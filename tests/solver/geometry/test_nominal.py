"""Geometries with a mistake of unit, arm or sign: none is "use", and the mistake is named.

The readings are those of the simulator, which shares no code with the solver: of four arms of the catalogue,
each with its links 0.5 mm and its axes 0.4 mrad off the nominal model.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from support.catalogue_arms import build_nominal_robots, spring_arm

from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.simulator.sweeps import TrackedArm
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.identification import (
    Conventions,
    identify_from_poses,
    identify_from_sweeps,
)
from jointstiff.solver.geometry.nominal import ComparedReadings, inspect_nominal
from jointstiff.solver.geometry.poses import Poses
from jointstiff.solver.geometry.sweeps import Sweep, SweepSet

ROBOTS = {known.name: known.robot for known in build_nominal_robots()}
ARMS = ["FANUC R-2000iC/210F", "KUKA KR 6 R900 sixx", "ABB IRB 120-3/0.6", "Universal Robots UR5e"]
TARGETS = ("A", "B", "C")
SIGMA = 15e-6
INCH, CM = 1e-3 / 0.0254, 0.1
"""Ratios of readings in these units that are declared in mm to lengths in mm."""
WRONG = [
    ("inch", INCH, "poses"),
    ("inch", INCH, "sweeps"),
    ("cm", CM, "poses"),
    ("cm", CM, "sweeps"),
    ("arm", None, "poses"),
    ("arm", None, "sweeps"),
    ("sign", (0,), "poses"),
    ("sign", (3,), "sweeps"),
    ("sign", (5,), "poses"),
    ("sign", (0, 3, 5), "poses"),
]
"""Mistakes, each made with four arms."""
CODES = {"arm": "another_robot_fits", "sign": "joint_sign_suspect"}


@cache
def cell(name, seed=1):
    return TrackedArm(with_link_errors(spring_arm(ROBOTS[name]), length=5e-4, angle=4e-4, seed=seed))


def read(name, model_angles, sigma=SIGMA, targets=3):
    """Return the controller's angles and noisy readings of an arm at angles of the model."""
    robot, generator = ROBOTS[name], np.random.default_rng(2)
    points = cell(name).readings(model_angles)[:, :targets]
    points = points + sigma * generator.standard_normal(points.shape)
    shown = np.linalg.solve(robot.joint_map.matrix, (model_angles - robot.joint_map.offset).T).T
    return shown, points


def poses(name, chosen, *, factor=1.0, reversed_joints=()):
    """Return poses of one arm, read as those of the chosen one."""
    shown, points = read(name, np.random.default_rng(1).uniform(-1.2, 1.2, (24, 6)))
    shown[:, list(reversed_joints)] *= -1.0
    present = np.ones(points.shape[:2], dtype=bool)
    return Poses(shown, factor * points, present, TARGETS, ROBOTS[chosen].joint_map, factor * SIGMA)


def sweeps(name, chosen, *, factor=1.0, reversed_joints=()):
    """Return sweeps of one arm, read as those of the chosen one."""
    robot, parts = ROBOTS[name], []
    home = np.linalg.solve(robot.joint_map.matrix, np.array([0.2, -0.4, 0.3, 0.2, 0.6, -0.5]))
    for joint in range(6):
        turned = np.tile(home, (12, 1))
        turned[:, joint] = np.linspace(-0.9, 0.9, 12)
        shown, points = read(name, robot.joint_map.model_angles(turned))
        shown[:, list(reversed_joints)] *= -1.0
        present = np.ones(points.shape[:2], dtype=bool)
        parts.append(Sweep(shown, factor * points, present, f"joint_{joint + 1}", joint))
    return SweepSet(tuple(parts), TARGETS, ROBOTS[chosen].joint_map, factor * SIGMA)


def mistaken(name, kind, mistake, form):
    """Return the readings with a mistake, and the robot that was chosen for them."""
    chosen = ARMS[(ARMS.index(name) + 1) % len(ARMS)] if kind == "arm" else name
    changes = {"reversed_joints": mistake} if kind == "sign" else {"factor": mistake or 1.0}
    return (poses if form == "poses" else sweeps)(name, chosen, **changes), chosen


def compared(readings):
    if isinstance(readings, Poses):
        return ComparedReadings.sample(readings.angles, readings.points, readings.present)
    angles = np.concatenate([sweep.angles for sweep in readings.sweeps])
    return ComparedReadings.sample(angles, readings.whitened.points, readings.present)


def identify(readings, chosen):
    function = identify_from_poses if isinstance(readings, Poses) else identify_from_sweeps
    conventions = Conventions("nominal", "nominal")
    return function(readings, conventions, nominal=ROBOTS[chosen].chain, others=build_nominal_robots())


def outcome(readings, chosen):
    """Return the result, or the words of the refusal."""
    try:
        return identify(readings, chosen)
    except MeasurementError as error:
        return str(error)


@pytest.mark.parametrize(("kind", "mistake", "form"), WRONG)
@pytest.mark.parametrize("name", ARMS)
def test_the_mistake_of_a_wrong_geometry_is_named_and_forbids_its_use(name, kind, mistake, form):
    readings, chosen = mistaken(name, kind, mistake, form)
    joint_map, others = ROBOTS[chosen].joint_map, build_nominal_robots()
    (finding,) = inspect_nominal(ROBOTS[chosen].chain, joint_map, compared(readings), others)
    assert (finding.code, finding.weight) == (CODES.get(kind, "length_unit_suspect"), "do_not_use")
    if kind == "arm":
        assert f"the robot '{finding.action.robot}' fits the readings within" in finding.message
        assert ROBOTS[finding.action.robot].chain.joints[1].translation == pytest.approx(
            ROBOTS[name].chain.joints[1].translation
        )
    elif kind == "sign":
        assert finding.where == ", ".join(ROBOTS[name].joint_names[joint] for joint in mistake)
    else:
        assert f"the readings seem to be in {kind}, not in mm" in finding.message


@pytest.mark.parametrize("form", [poses, sweeps])
@pytest.mark.parametrize("name", ARMS)
def test_right_readings_are_compared_with_no_other_robot(name, form):
    def others():
        pytest.fail("another robot was tried")
        yield

    readings, robot = form(name, name), ROBOTS[name]
    assert list(inspect_nominal(robot.chain, robot.joint_map, compared(readings), others())) == []


FAST = [(ARMS[1], *WRONG[0]), (ARMS[1], *WRONG[4]), (ARMS[2], *WRONG[7])]


@pytest.mark.parametrize(
    ("name", "kind", "mistake", "form"),
    [*FAST, *(pytest.param(name, *each, marks=pytest.mark.slow) for name in ARMS for each in WRONG)],
)
def test_a_wrong_geometry_is_refused_or_not_to_be_used(name, kind, mistake, form):
    """Forty geometries: none is "use" or "use with care", and each names its mistake."""
    readings, chosen = mistaken(name, kind, mistake, form)
    words = {"unit": "seem to be in", "arm": "fits the readings within", "sign": "reversed, the nominal"}
    found = outcome(readings, chosen)
    if isinstance(found, str):
        assert words.get(kind, words["unit"]) in found
        return
    assert found.assessment.verdict == "do_not_use"
    code = CODES.get(kind, "length_unit_suspect")
    assert {reason.code for reason in found.assessment.reasons} == {code}


def test_a_unit_of_the_nominal_model_is_named():
    chain = ROBOTS[ARMS[1]].chain
    small = replace(chain, joints=tuple(replace(j, translation=0.1 * j.translation) for j in chain.joints))
    readings = poses(ARMS[1], ARMS[1])
    (finding,) = inspect_nominal(small, readings.joint_map, compared(readings), ())
    assert "the nominal model seems to be in cm, not in mm" in finding.message
    assert finding.remedy == "multiply all lengths of the nominal model by 10"


def test_an_arm_of_another_size_is_named_before_a_ratio_that_no_unit_has():
    chain = ROBOTS[ARMS[3]].chain
    large = replace(chain, joints=tuple(replace(j, translation=1.4 * j.translation) for j in chain.joints))
    readings = poses(ARMS[3], ARMS[3])
    (named,) = inspect_nominal(large, readings.joint_map, compared(readings), build_nominal_robots())
    assert (named.code, named.action.robot) == ("another_robot_fits", ARMS[3])
    (unnamed,) = inspect_nominal(large, readings.joint_map, compared(readings), ())
    assert (unnamed.code, unnamed.weight) == ("length_unit_suspect", "do_not_use")
    assert "are 0.714" in unnamed.message
    assert "no unit has this ratio" in unnamed.message


def test_readings_that_no_known_mistake_explains_have_links_far_from_the_nominal_ones():
    """The zero of joint 2 is elsewhere by 20°: the fitted lengths are right, R0 and flange may not be."""
    readings = poses(ARMS[1], ARMS[1])
    moved = readings.angles.copy()
    moved[:, 1] += np.radians(20.0)
    result = identify(replace(readings, angles=moved), ARMS[1])
    assert result.assessment.verdict == "use_with_care"
    (reason,) = result.assessment.reasons
    assert (reason.code, reason.where) == ("target_off_model", "links")
    assert "theta" in reason.message


def test_a_residual_above_a_millimetre_is_never_used():
    readings = poses(ARMS[1], ARMS[1])
    noise = 3e-3 * np.random.default_rng(4).standard_normal(readings.points.shape)
    result = identify(replace(readings, points=readings.points + noise, sigma=None), ARMS[1])
    assert result.assessment.verdict == "do_not_use"
    assert "up to 1 mm is plausible" in result.assessment.reasons[0].message


def one_orientation(name, count=15):
    """Return angles of the model at which the flange keeps its orientation."""
    arm, generator = cell(name).arm, np.random.default_rng(5)
    home = np.array([0.1, -0.3, 0.4, 0.3, 0.7, -0.4])
    kept = arm.posture(home).flange_rotation
    angles = []
    for _ in range(count):
        first = home[:3] + generator.uniform(-0.4, 0.4, 3)

        def turn(wrist, first=first):
            rotation = arm.posture(np.concatenate([first, wrist])).flange_rotation
            return Rotation.from_matrix(kept.T @ rotation).as_rotvec()

        wrist = least_squares(turn, home[3:], xtol=1e-14, ftol=1e-14, gtol=1e-14)
        angles.append(np.concatenate([first, wrist.x]))
    return np.array(angles)


@pytest.mark.parametrize(
    "name", [ARMS[3], *(pytest.param(each, marks=pytest.mark.slow) for each in ARMS[:3])]
)
def test_what_poses_of_one_orientation_do_not_determine_keeps_its_nominal_value(name):
    shown, points = read(name, one_orientation(name), targets=1)
    present = np.ones(points.shape[:2], dtype=bool)
    readings = Poses(shown, points, present, TARGETS[:1], ROBOTS[name].joint_map, SIGMA)
    result = identify(readings, name)
    kept = [each for each in result.findings if each.code == "parameters_not_identified"]
    assert result.assessment.verdict == "use_with_care"
    assert any("target A" in each.message and "nominal values are kept" in each.message for each in kept)
    assert max(abs(link.difference) for link in result.links if link.unit == "m") < 5e-3
