"""Readings of one arm with the model of another: the measured arm is named, never a wrong one."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

from jointstiff.solver.integrity import inspect_measurements
from jointstiff.solver.integrity.robots import inspect_other_robots
from jointstiff.solver.integrity.values import View
from jointstiff.solver.mechanics.robot import KnownRobot, Robot

KNOWN = build_nominal_robots()
ARMS = {known.name: known for known in KNOWN}
TWINS = {"FANUC R-2000iC/165F", "FANUC R-2000iC/210F"}
"""Arms of the same kinematics, which no position distinguishes."""


GENERATIONS = {f"Universal Robots UR{size}": f"Universal Robots UR{size}e" for size in (3, 5, 10)}
"""Two generations of an arm, whose places differ by as much as a real arm and its nominal model."""


def found(robot, measurements, others=KNOWN):
    """Return what is found without asking first whether another mistake explains the positions."""
    return list(inspect_other_robots(View(robot, measurements), others))


def named(*arguments):
    return [finding.action.robot for finding in found(*arguments)]


def alike(name):
    return TWINS if name in TWINS else {name}


@pytest.mark.parametrize("measured", ARMS)
def test_each_arm_is_named_in_place_of_each_other_one(measured):
    measurements = readings_on(ARMS[measured].robot, seed=len(measured))
    sibling = {old: new for pair in GENERATIONS.items() for old, new in (pair, pair[::-1])}.get(measured)
    for chosen in ARMS.keys() - alike(measured) - {sibling}:
        names = named(ARMS[chosen].robot, measurements)
        assert names[0] in alike(measured), chosen
        assert set(names) - {sibling} == alike(measured), chosen
    for chosen in alike(measured):
        assert named(ARMS[chosen].robot, measurements) == [], chosen


@pytest.mark.parametrize("measured", ["FANUC M-20iD/25", "KUKA KR 210 R2700 extra", "Yaskawa GP180"])
@pytest.mark.parametrize("seed", [9, 28])
def test_an_arm_far_from_its_nominal_model_is_named_all_the_same(measured, seed):
    """Errors of its links move targets by up to 8 mm, mostly as a turn or a shift of R0 would."""
    measurements = readings_on(ARMS[measured].robot, seed, configurations=16, length=1.5e-3, angle=1e-3)
    assert named(ARMS["ABB IRB 120-3/0.6"].robot, measurements) == [measured]


def test_one_damaged_reading_hides_no_robot():
    measurements = readings_on(ARMS["FANUC M-20iD/25"].robot, seed=3, configurations=16)
    position = measurements.position.copy()
    position[5] += 0.4
    damaged = replace(measurements, position=position)
    assert named(ARMS["Yaskawa GP12"].robot, damaged) == ["FANUC M-20iD/25"]


def test_the_finding_gives_its_figures_and_the_remedy():
    measurements = readings_on(ARMS["KUKA KR 6 R900 sixx"].robot, seed=3, configurations=40)
    (finding,) = found(ARMS["KUKA KR 210 R2700 extra"].robot, measurements)
    assert re.fullmatch(
        r"with the robot 'KUKA KR 6 R900 sixx', the targets keep their places on the flange in 40 of 40 "
        r"observations, within [12]\.\d+ mm; with the chosen robot, in only \d of 40, within 20 mm",
        finding.message,
    ), finding.message
    assert finding.remedy == (
        "check which robot was measured; if 'KUKA KR 6 R900 sixx' was measured, choose this robot"
    )
    assert (finding.weight, finding.observation) == ("do_not_use", None)
    assert (finding.action.kind, finding.action.robot_id) == ("choose_robot", None)


def test_a_tie_is_named_as_a_tie():
    measurements = readings_on(ARMS["FANUC R-2000iC/210F"].robot, seed=1)
    first, second = found(ARMS["Yaskawa GP180"].robot, measurements)
    assert first.message.endswith("; 'FANUC R-2000iC/210F' fits as well")
    assert second.message.endswith("; 'FANUC R-2000iC/165F' fits as well")


def test_a_calibrated_robot_comes_before_its_nominal_arm():
    """The stored robot is as it was measured, the nominal arm has a link that is 2 mm too long."""
    nominal = ARMS["KUKA KR 6 R900 sixx"]
    measurements = readings_on(nominal.robot, seed=2, length=0.0, angle=0.0)
    off = nominal.robot.model.copy()
    off.jointPlacements[3] = off.jointPlacements[3] * pin.SE3(np.eye(3), np.array([2e-3, 0.0, 0.0]))
    others = [
        KnownRobot("nominal", Robot(off, nominal.robot.joint_map)),
        KnownRobot("cell 3", nominal.robot, "c3"),
    ]
    findings = found(ARMS["KUKA KR 210 R2700 extra"].robot, measurements, others)
    assert [(each.action.robot, each.action.robot_id) for each in findings] == [
        ("cell 3", "c3"),
        ("nominal", None),
    ]
    assert "as well" not in findings[0].message + findings[1].message


def moved(measurements, shift=(0.0, 0.0, 0.0), turn=0.0):
    """Return readings in a base frame that is turned about its z axis [rad], then shifted [m]."""
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return replace(
        measurements, position=measurements.position @ R.T + shift, deflection=measurements.deflection @ R.T
    )


def with_joints(measurements, change):
    joints = measurements.joints.copy()
    change(joints)
    return replace(measurements, joints=joints)


def scaled(*columns, by):
    def change(joints):
        joints[:, columns] *= by

    return lambda measurements: with_joints(measurements, change)


def turned(column, by):
    def change(joints):
        joints[:, column] += by

    return lambda measurements: with_joints(measurements, change)


MISTAKES = {
    "base on the floor": lambda m: moved(m, (0.0, 0.0, 0.67)),
    "base elsewhere": lambda m: moved(m, (0.3, -0.1, 0.0)),
    "base turned": lambda m: moved(m, turn=np.pi / 2),
    "frame of the tracker": lambda m: moved(m, (2.0, -1.0, 0.4), turn=0.7),
    "one sign": scaled(2, by=-1.0),
    "two signs": scaled(3, 5, by=-1.0),
    "three signs": scaled(0, 3, 5, by=-1.0),
    "zero of joint 2": turned(1, np.pi / 2),
    "zero of joint 3": turned(2, -np.pi / 2),
    "encoder of joint 2 in radians": scaled(1, by=np.pi / 180.0),
    "encoder of joint 3 in degrees": scaled(2, by=180.0 / np.pi),
    "all angles in degrees": scaled(*range(6), by=180.0 / np.pi),
    "half the angle of joint 5": scaled(4, by=0.5),
    "random order": lambda m: replace(m, joints=m.joints[np.random.default_rng(0).permutation(len(m))]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_another_mistake_names_no_robot(mistake):
    for seed, known in enumerate(KNOWN[::3]):
        measurements = MISTAKES[mistake](readings_on(known.robot, seed))
        assert named(known.robot, measurements) == [], known.name


def test_a_robot_that_is_not_known_is_not_named():
    """Its links are 3 % off those of an arm of the catalogue, or it is an arm that is not in the list."""
    for seed, known in enumerate(ARMS.values()):
        others = [each for each in ARMS.values() if each.name not in alike(known.name)]
        measurements = readings_on(known.robot, seed)
        assert named(others[seed % len(others)].robot, measurements, others) == [], known.name
    longer = ARMS["ABB IRB 120-3/0.6"].robot.model.copy()
    for place in longer.jointPlacements:
        place.translation = 1.03 * place.translation
    assert named(ARMS["Stäubli TX2-60"].robot, readings_on(Robot(longer), seed=5)) == []


def test_few_readings_name_no_robot():
    measurements = readings_on(ARMS["KUKA KR 6 R900 sixx"].robot, seed=3)
    assert named(ARMS["Yaskawa GP12"].robot, measurements[np.arange(3)]) == []


def test_the_finding_takes_the_place_of_those_that_follow_from_it():
    """Where a mistake in the readings explains them, no robot is tried, and none is built."""
    measurements = readings_on(ARMS["KUKA KR 6 R900 sixx"].robot, seed=3)

    def codes(chosen, changed, others):
        return {
            each.code for each in inspect_measurements(chosen.robot, changed, degrees=True, others=others)
        }

    alone = codes(ARMS["Yaskawa GP12"], measurements, ())
    assert "target_off_model" in alone
    with_others = codes(ARMS["Yaskawa GP12"], measurements, KNOWN)
    assert with_others - {"joint_outside_limits"} == {"another_robot_fits"}
    never = (pytest.fail("a robot was built") for _ in range(1))
    wrong_sign = MISTAKES["one sign"](measurements)
    assert "joint_sign_suspect" in codes(ARMS["KUKA KR 6 R900 sixx"], wrong_sign, never)
