"""The usual mistakes of a whole set: each is named by its cause, in one sentence, and nothing else is."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on
from support.slides import gantry
from support.springs import readings_of, robot_of

from jointstiff.solver.integrity import inspect_measurements, inspect_unloaded
from jointstiff.solver.integrity.values import InstrumentFrame
from jointstiff.solver.mechanics.robot import JointMap, Robot

ROBOTS = {known.name: known for known in build_nominal_robots()}
ARMS = (
    "ABB IRB 4600-60/2.05",
    "Universal Robots UR10e",
    "FANUC M-20iD/25",
    "Stäubli TX2-60",
    "Yaskawa GP25",
)
TURN = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
LENGTH, ANGLE, ROWS = "length_unit_suspect", "angle_unit_suspect", "observations_out_of_order"
SIGN, SWAPPED, COUNTED = "joint_sign_suspect", "joints_swapped", "joints_counted_otherwise"
FRAME, LEFT_HANDED = "frame_mistaken", "frame_left_handed"


def moved(change):
    """Return a mistake in all positions."""

    def make(measurements):
        unloaded = change(measurements.position)
        loaded = change(measurements.position + measurements.deflection)
        return replace(measurements, position=unloaded, deflection=loaded - unloaded)

    return make


def turned(change):
    """Return a mistake in all joints (N, n)."""
    return lambda measurements: replace(measurements, joints=change(measurements.joints))


def reverse(*joints):
    signs = np.where(np.isin(np.arange(6), joints), -1.0, 1.0)
    return turned(lambda q: q * signs)


def of_one_target(change):
    """Return a mistake in the positions of the second target."""

    def make(measurements):
        parts = [measurements.position, measurements.position + measurements.deflection]
        unloaded, loaded = (each.copy() for each in parts)
        for each in (unloaded, loaded):
            each[:, 1] = change(each[:, 1])
        return replace(measurements, position=unloaded, deflection=loaded - unloaded)

    return make


def equal_targets(m):
    position, deflection = m.position.copy(), m.deflection.copy()
    position[:, 1], deflection[:, 1] = position[:, 0], deflection[:, 0]
    return replace(m, position=position, deflection=deflection)


def load_not_on(*rows):
    """Return the mistake that the load was not on in some rows."""

    def make(measurements):
        deflection = measurements.deflection.copy()
        deflection[list(rows)] = 0.0
        return replace(measurements, deflection=deflection)

    return make


def copied_target(m):
    deflection = m.deflection.copy()
    deflection[3, 1] = 0.0
    return replace(m, deflection=deflection)


def forces_in(axes):
    """Return a mistake of the axes of all forces and moments."""
    return lambda m: replace(m, force=m.force @ np.array(axes).T, moment=m.moment @ np.array(axes).T)


def loaded_of_another_row(m):
    return replace(m, deflection=np.roll(m.position + m.deflection, 1, axis=0) - m.position)


def of_both(factor, convert):
    """Return the change of all lengths, those in the flange frame too, and of all angles."""
    return lambda m: replace(
        turned(convert)(m),
        position=factor * m.position,
        deflection=factor * m.deflection,
        load_point=factor * m.load_point,
    )


def deflections_as_loaded(m):
    return replace(m, deflection=m.deflection - m.position)


MISTAKES = {
    "inches as mm": (moved(lambda p: p / 25.4), LENGTH, "in inch, not in mm"),
    "cm as mm": (moved(lambda p: p / 10.0), LENGTH, "in cm, not in mm"),
    "m as mm": (moved(lambda p: p / 1000.0), LENGTH, "in m, not in mm"),
    "a scale of 1.01": (moved(lambda p: 1.01 * p), "lengths_differ", "times those of the robot's model"),
    "degrees as radians": (turned(np.rad2deg), ANGLE, "in deg, not in rad"),
    "radians as degrees": (turned(np.deg2rad), ANGLE, "in rad, not in deg"),
    "mm and degrees as m and radians": (
        of_both(1000.0, np.rad2deg), LENGTH, "in mm, not in m as declared, and the angles seem to be in deg"
    ),
    "rolled by one": (turned(lambda q: np.roll(q, 1, axis=0)), ROWS, "the row after"),
    "rolled by five": (turned(lambda q: np.roll(q, 5, axis=0)), ROWS, "the row that is 5 rows after"),
    "joints reversed": (turned(lambda q: q[:, ::-1]), SWAPPED, "the joints in reverse order"),
    "z y x": (moved(lambda p: p[..., [2, 1, 0]]), LEFT_HANDED, "are z, y, x of the readings"),
    "y z x": (moved(lambda p: p[..., [1, 2, 0]]), FRAME, "are z, x, y of the readings"),
    "a tracker's frame": (moved(lambda p: p @ TURN.T + [2.5, -1.2, 0.4]), FRAME, "not in R0"),
    "a left-handed frame": (
        moved(lambda p: (p @ TURN.T + [2.5, -1.2, 0.4]) * [1, -1, 1]), LEFT_HANDED, "in a left-handed frame"
    ),
    "loaded rolled by one": (loaded_of_another_row, ROWS, "the loaded readings of 14 of 14"),
    "loaded minus unloaded": (deflections_as_loaded, "deflection_implausibly_large", "to be deflections"),
    "sign of one joint": (reverse(2), SIGN, "{2} reversed"),
    "signs of joints 1, 4, 6": (reverse(0, 3, 5), SIGN, "{0}, {3}, {5} reversed"),
    "signs of joints 2, 3, 5": (reverse(1, 2, 4), SIGN, "{1}, {2}, {4} reversed"),
    "no signs": (turned(np.abs), SIGN, "the signs are missing"),
    "two joints exchanged": (turned(lambda q: q[:, [0, 1, 2, 4, 3, 5]]), SWAPPED, "{3} and {4} exchanged"),
    "third joint with the second": (
        turned(lambda q: q + q[:, [1]] * np.eye(6)[2]), COUNTED, "{2} minus {1} as the angle of {2}"
    ),
    "axes of a target": (
        of_one_target(lambda p: p[..., [1, 0, 2]]), "target_off_model", "With y, x, z of its readings"
    ),
    "sign of an axis of a target": (
        of_one_target(lambda p: p * [1, 1, -1]), "target_off_model", "With x, y, −z of its readings"
    ),
    "a target in m": (
        of_one_target(lambda p: p / 1000.0), "target_off_model", "in m where the others are in mm"
    ),
    "a target in inches": (
        of_one_target(lambda p: p / 25.4), "target_off_model", "in inch where the others are in mm"
    ),
    "loads that were not on": (
        load_not_on(0, 5), "deflection_implausibly_small", "equal in every digit: '1', '2"
    ),
    "a copied target": (copied_target, "deflection_implausibly_small", "equal in every digit: '2' in '4'"),
    "equal targets": (equal_targets, "repeated_readings", "readings to the last digit in 14 observations"),
    "a zero that is 2° away": (
        turned(lambda q: q + np.radians(2.0) * np.eye(6)[4]), COUNTED, " rad added to {4}"
    ),
    "a quarter turn": (turned(lambda q: q + 0.5 * np.pi * np.eye(6)[1]), COUNTED, "-90° added to {1}"),
}  # fmt: skip


def name_cause(known, measurements, *, degrees=False):
    """Return the findings that are more than remarks."""
    others = [each for each in ROBOTS.values() if each is not known]
    findings = inspect_measurements(known.robot, measurements, degrees=degrees, others=others)
    return [finding for finding in findings if finding.weight != "use"]


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_of_the_whole_set_is_named_by_its_cause_alone(mistake, arm):
    make, code, words = MISTAKES[mistake]
    known = ROBOTS[arm]
    measurements = make(readings_on(known.robot, seed=11, configurations=14))
    (cause,) = name_cause(known, measurements, degrees=mistake.endswith("degrees"))
    assert cause.code == code
    assert words.format(*known.robot.joint_names) in cause.message


@pytest.mark.parametrize("arm", [arm for arm in ARMS if "TX2-60" not in arm])
def test_lengths_in_m_and_angles_in_radians_are_named_together(arm):
    """The smallest arm is left out: its targets hardly move in these units, and keep their places."""
    known = ROBOTS[arm]
    mistaken = of_both(1e-3, np.deg2rad)(readings_on(known.robot, seed=11, configurations=14))
    (cause,) = name_cause(known, mistaken, degrees=True)
    assert "in m, not in mm as declared, and the angles seem to be in rad, not in deg" in cause.message
    assert cause.remedy.startswith("set `units.length` to m and set `units.angle` to rad")


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("configurations", [6, 7])
def test_joints_that_are_transposed_are_named_if_their_array_is_square(configurations, arm):
    known = ROBOTS[arm]
    right = readings_on(known.robot, seed=11, configurations=configurations)
    assert not any("rows and columns" in cause.message for cause in name_cause(known, right))
    if configurations == 6:
        causes = name_cause(known, replace(right, joints=right.joints.T.copy()))
        (cause,) = [each for each in causes if each.code != "joint_outside_limits"]
        assert cause.code == SWAPPED
        assert "with rows and columns of the joints exchanged, in 6 of 6" in cause.message
        assert cause.remedy.startswith("transpose the array of the joints")


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("of_joint", [True, False])
def test_forces_that_are_columns_of_something_else_are_the_only_mistake_named(of_joint, arm):
    known = ROBOTS[arm]
    right = readings_on(known.robot, seed=11, configurations=14)
    other = np.degrees(right.joints[:, 5]) if of_joint else 1e3 * right.position[:, 0, 0]
    mistaken = replace(right, force=np.column_stack([other, right.force[:, :2]]))
    (cause,) = name_cause(known, mistaken)
    what = f"the angles of {known.robot.joint_names[5]}" if of_joint else "x of target '1'"
    assert f"the forces along x are {what} in all observations, digit by digit" in cause.message
    assert "where the slices of joints, forces and targets begin" in cause.remedy


@pytest.mark.parametrize(("joint", "factor"), [(1, 10.0), (0, 350.0)])
def test_forces_that_are_designed_by_an_angle_are_no_mistake(joint, factor):
    known = ROBOTS[ARMS[0]]
    right = readings_on(known.robot, seed=11, configurations=14)
    planned = np.column_stack([factor * right.joints[:, joint], right.force[:, 1:]])
    causes = name_cause(known, replace(right, force=planned))
    assert not any("digit by digit" in cause.message for cause in causes)


def test_a_small_load_that_moves_targets_by_less_than_a_digit_is_no_copy():
    known = ROBOTS[ARMS[0]]
    right = readings_on(known.robot, seed=11, configurations=14)
    force, deflection = right.force.copy(), right.deflection.copy()
    force[[3, 8]] *= 0.01
    deflection[[3, 8]] = 0.0
    causes = name_cause(known, replace(right, force=force, deflection=deflection))
    assert not any("equal in every digit" in cause.message for cause in causes)


def test_many_copied_readings_are_counted():
    known = ROBOTS[ARMS[0]]
    right = readings_on(known.robot, seed=11, configurations=14)
    copied = np.random.default_rng(1).random(right.present.shape) < 0.4
    (cause,) = (
        each
        for each in name_cause(
            known, replace(right, deflection=np.where(copied[..., None], 0.0, right.deflection))
        )
        if "equal in every digit" in each.message
    )
    assert f"{copied.sum()} readings in all" in cause.message
    assert len(cause.message) < 600


@pytest.mark.parametrize("arm", ["FANUC R-2000iC/165F", "KUKA KR 210 R2700 extra", "ABB IRB 6640-185/2.8"])
@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]], "with all forces turned by 37"),
        ([[0, 1, 0], [1, 0, 0], [0, 0, 1]], "with y, x, z of the forces as x, y, z"),
        ([[1, 0, 0], [0, 0, -1], [0, 1, 0]], "with x, z, −y of the forces as x, y, z"),
    ],
)
def test_forces_in_other_axes_are_named_where_loads_move_the_arm_by_more_than_noise(axes, words, arm):
    known = ROBOTS[arm]
    mistaken = forces_in(axes)(readings_on(known.robot, seed=11, configurations=14))
    (cause,) = [each for each in name_cause(known, mistaken) if each.code != "joint_outside_limits"]
    assert cause.code == FRAME
    assert words in cause.message


NEED_LOADS = ("loaded rolled by one", "loaded minus unloaded", "loads that were not on", "a copied target")


@pytest.mark.parametrize("mistake", [name for name in MISTAKES if name not in NEED_LOADS])
def test_a_mistake_is_named_without_loads_too(mistake):
    make, code, words = MISTAKES[mistake]
    known = ROBOTS[ARMS[0]]
    mistaken = without_loads(make(readings_on(known.robot, seed=11, configurations=14)))
    (cause,) = name_cause_without_loads(known, mistaken, degrees=mistake.endswith("degrees"))
    assert cause.code == code
    assert words.format(*known.robot.joint_names) in cause.message


def test_another_arm_and_exchanged_targets_are_named_without_loads():
    known = ROBOTS[ARMS[0]]
    right = without_loads(readings_on(known.robot, seed=11, configurations=14))
    assert name_cause_without_loads(known, right) == []
    causes = name_cause_without_loads(ROBOTS[ARMS[1]], right)
    assert ARMS[0] in {cause.action.robot for cause in causes}
    positions = right.position.copy()
    positions[10] = positions[10][[1, 0, 2]]
    (cause,) = name_cause_without_loads(known, replace(right, position=positions))
    assert "are exchanged in the unloaded readings of" in cause.message


def without_loads(measurements):
    """Return the measurements as those of a set by own weight: no target was read under load."""
    none = np.zeros_like(measurements.present)
    still = np.zeros_like(measurements.deflection)
    return replace(measurements, present=none, unloaded_only=~none, deflection=still)


def name_cause_without_loads(known, measurements, *, degrees=False):
    others = [each for each in ROBOTS.values() if each is not known]
    findings = inspect_unloaded(known.robot, measurements, degrees=degrees, others=others)
    return [finding for finding in findings if finding.weight != "use"]


@pytest.mark.parametrize("joint", range(5))
def test_a_mistyped_angle_is_named_with_the_angle_that_fits(joint):
    known = ROBOTS[ARMS[0]]
    right = readings_on(known.robot, seed=11, configurations=14)
    joints = right.joints.copy()
    joints[5, joint] += np.radians(30.0)
    (cause,) = name_cause(known, replace(right, joints=joints), degrees=True)
    name, fitting = known.robot.joint_names[joint], float(np.degrees(right.joints[5, joint]))
    assert (cause.code, cause.observation) == ("target_off_model", right.labels[5])
    words = cause.message.partition(f"with {name} at ")[2]
    assert float(words.partition("°")[0]) == pytest.approx(fitting, abs=0.5)
    assert f"check the angle of {name} for a typing error" in cause.remedy


def test_a_wrong_reading_of_three_linear_axes_is_no_mistyped_angle():
    arm, draw = gantry(), np.random.default_rng(1)
    joints = draw.uniform(0.0, 1.0, (5, 3))
    unloaded = joints[:, None] + arm.flange_translation + np.array([[0.1, 0.0, -0.2]])
    unloaded[3] += [0.2, 0.1, 0.3]
    pulls = 400.0 * draw.standard_normal((5, 3))
    deflection = np.full_like(unloaded, 1e-4)
    measurements = readings_of(joints, pulls, np.zeros(3), unloaded, deflection, sigma=2e-5, targets=("A",))
    findings = inspect_measurements(robot_of(arm), measurements, degrees=True, others=[])
    (cause,) = [finding for finding in findings if finding.weight == "do_not_use"]
    assert (cause.code, cause.observation) == ("target_off_model", measurements.labels[3])
    assert "typing error" not in cause.remedy


def gantry_readings(change, count=14):
    """Return the readings of three linear axes, whose positions (N, 1, 3) were changed."""
    arm, draw = gantry(), np.random.default_rng(1)
    joints = draw.uniform(0.0, 1.0, (count, 3))
    unloaded = change(joints[:, None] + arm.flange_translation + np.array([[0.1, 0.0, -0.2]]))
    pulls = 400.0 * draw.standard_normal((count, 3))
    deflection = np.full_like(unloaded, 1e-4)
    return readings_of(joints, pulls, np.zeros(3), unloaded, deflection, sigma=2e-5, targets=("A",))


@pytest.mark.parametrize("row", [0, 3, 13])
def test_a_wrong_reading_of_linear_axes_is_no_wrong_frame(row):
    def shift(positions):
        positions[row] += [0.2, 0.1, 0.3]
        return positions

    measurements = gantry_readings(shift)
    findings = inspect_measurements(robot_of(gantry()), measurements, degrees=True, others=[])
    (cause,) = [finding for finding in findings if finding.weight == "do_not_use"]
    assert (cause.code, cause.observation) == ("target_off_model", measurements.labels[row])


def test_a_turned_frame_of_linear_axes_is_named_without_a_place():
    """Where the origin is cannot be known: the targets may be elsewhere on the flange."""
    measurements = gantry_readings(lambda positions: positions @ TURN.T)
    findings = inspect_measurements(robot_of(gantry()), measurements, degrees=True, others=[])
    (cause,) = [finding for finding in findings if finding.code == FRAME]
    assert "whose origin" not in cause.message
    assert "do not show `translation`" in cause.remedy


STATED = InstrumentFrame(TURN, np.array([2.5, -1.2, 0.4]))
OTHER = InstrumentFrame(TURN @ TURN, np.array([-0.7, 1.6, 0.2]))


@pytest.mark.parametrize("unit", ["m", "mm"])
@pytest.mark.parametrize("stated", [STATED, OTHER], ids=["the inverse", "another frame"])
def test_the_remedy_of_a_wrong_frame_is_the_frame_to_state(stated, unit):
    known, true = ROBOTS[ARMS[0]], STATED.inverse
    right = readings_on(known.robot, seed=11, configurations=14)
    as_read = moved(lambda p: (p - true.translation) @ true.rotation)(right)
    given = moved(lambda p: p @ stated.rotation.T + stated.translation)(as_read)
    findings = inspect_measurements(known.robot, given, degrees=True, frame=stated, length_unit=unit)
    (cause,) = [finding for finding in findings if finding.code == FRAME]
    assert ("the stated `frame` is the inverse" in cause.message) == (stated is STATED)
    numbers = np.array([float(each) for each in re.findall(r"-?\d+\.\d+", cause.remedy)])
    np.testing.assert_allclose(numbers[:9].reshape(3, 3), true.rotation, atol=5e-3)
    size = {"m": 1.0, "mm": 1e-3}[unit]
    np.testing.assert_allclose(size * numbers[9:], true.translation, atol=1e-2)
    assert f"] {unit} fit" in cause.remedy


def test_the_remedy_of_a_left_handed_frame_leads_to_the_frame():
    known = ROBOTS[ARMS[0]]
    mistaken = MISTAKES["a left-handed frame"][0](readings_on(known.robot, seed=11, configurations=14))
    (cause,) = name_cause(known, mistaken)
    assert "reverse the sign of y of all positions" in cause.remedy
    (after,) = name_cause(known, moved(lambda p: p * [1, -1, 1])(mistaken))
    assert (after.code, "state the `frame`" in after.remedy) == (FRAME, True)


@pytest.mark.parametrize("arm", ARMS)
def test_another_arm_is_named_and_right_readings_have_no_cause(arm):
    known = ROBOTS[arm]
    measurements = readings_on(known.robot, seed=11, configurations=14)
    assert name_cause(known, measurements) == []
    chosen = ROBOTS[ARMS[ARMS.index(arm) - 1]]
    causes = name_cause(chosen, measurements)
    assert {cause.code for cause in causes} == {"another_robot_fits"}
    assert arm in {cause.action.robot for cause in causes}


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_no_mistake_has_a_wrong_cause_in_any_campaign(mistake, arm):
    """One target, one damaged row, or more postures: the cause is right, or none is named for the set."""
    make, code, _ = MISTAKES[mistake]
    known = ROBOTS[arm]
    for seed in range(20, 26):
        measurements = readings_on(known.robot, seed=seed, configurations=8 + 6 * (seed % 3))
        if seed % 2:
            damaged = measurements.position.copy()
            damaged[3] += 0.3
            measurements = replace(measurements, position=damaged)
        causes = name_cause(known, make(measurements), degrees=mistake.endswith("degrees"))
        assert {cause.code for cause in causes if cause.where is None} <= {code}, (seed, causes)


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("mistake", ["joints reversed", "signs of joints 2, 3, 5", "a quarter turn"])
def test_the_suggested_joint_map_mends_the_set(mistake, arm):
    known = ROBOTS[arm]
    mistaken = MISTAKES[mistake][0](readings_on(known.robot, seed=11, configurations=14))
    (cause,) = name_cause(known, mistaken)
    assert cause.action.kind == "apply_joint_map"
    joint_map = JointMap(np.array(cause.action.joint_map), np.array(cause.action.offset))
    mended = replace(known, robot=Robot(known.robot.model, joint_map))
    assert [each for each in name_cause(mended, mistaken) if each.code != "joint_outside_limits"] == []


def with_length(robot, joint, axis, change):
    """Return a robot whose joint is mounted elsewhere on the joint before it: `change` of a length [m]."""
    model = robot.model.copy()
    placement = model.jointPlacements[joint]
    length = placement.translation.copy()
    length[axis] = change(length[axis])
    placement.translation = length
    model.jointPlacements[joint] = placement
    return Robot(model, robot.joint_map, flange=robot.flange, payload=robot.payload)


def test_an_unknown_robot_is_suspected_once_where_no_single_mistake_explains_the_set():
    known = ROBOTS[ARMS[0]]
    right = readings_on(known.robot, seed=11, configurations=14)
    several = known.robot
    for joint in (2, 3, 4):
        axis = int(np.abs(several.model.jointPlacements[joint].translation).argmax())
        several = with_length(several, joint, axis, lambda length: 1.3 * length)
    findings = [each for each in inspect_measurements(several, right, degrees=True) if each.weight != "use"]
    suspected = ["another robot may have been measured" in finding.message for finding in findings]
    assert suspected == [True] + [False] * (len(findings) - 1)


@pytest.mark.parametrize("configurations", [6, 8, 14])
def test_a_zero_that_is_far_off_is_no_wrong_length(configurations):
    """The map of this arm turns the third joint back, so that the zero of the second moves the elbow."""
    known = ROBOTS["FANUC M-20iD/25"]
    right = readings_on(known.robot, seed=11, configurations=configurations)
    mistaken = turned(lambda q: q + np.radians(3.0) * np.eye(6)[1])(right)
    findings = inspect_measurements(known.robot, mistaken, degrees=True)
    assert "lengths_differ" not in {finding.code for finding in findings}
    assert "do_not_use" in {finding.weight for finding in findings}
