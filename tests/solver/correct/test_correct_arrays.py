"""Correction of arrays: the loaded tool on its poses, wrong frames refused, a status in place of a number."""

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.programs import FORCE, START, TOOL, exact_run, loaded_poses, path, tool_poses
from support.programs import corrected as corrected_program

from jointstiff.service.kinds.correction.files import decompress_file
from jointstiff.service.runs.verdicts import RunModel
from jointstiff.simulator.programs import PROGRAM_FILES, program_text
from jointstiff.solver.correct.correct import (
    CorrectionSettings,
    RowStatus,
    Waypoints,
    correct,
    place_forces,
    turn_loads,
)
from jointstiff.solver.correct.frames import FramesError
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.stages import Likelihood
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.predict.forward import CorrectionLimits
from robotprograms import NUMBERS, Rewriting
from robotprograms.formats import read_program

TOOL_POSE = np.eye(4)
TOOL_POSE[:3, 3] = TOOL
BASE = np.eye(4)
BASE[:3, :3] = Rotation.from_rotvec([0.0, 0.0, np.pi / 2]).as_matrix()
BASE[:3, 3] = [1.0, 0.2, 0.5]
NAN = float("nan")


@lru_cache
def parts():
    robot, run = exact_run()
    return RunModel.from_run(robot, run), InverseKinematics(robot, START)


def waypoints(meant, **stated):
    """The poses of the joints that are meant, by the simulator's kinematics, in a base of their own."""
    poses = np.linalg.inv(BASE) @ tool_poses(meant)
    return replace(Waypoints(poses, TOOL_POSE, BASE), **stated)


def loads(count, force=FORCE):
    return np.tile([*force, 0.0, 0.0, 0.0], (count, 1))


def corrected(points, load=None, **more):
    run_model, inverse = parts()
    load = loads(len(points)) if load is None else load
    return correct(run_model.model, run_model.error, inverse, points, load, **more)


def statuses(rows):
    return [RowStatus(each).name for each in rows.status]


def random_pose(generator, distance, angle):
    """A pose at least half as far and turned half as much as stated, in any direction."""
    pose = np.eye(4)
    for size, place in ((distance, "shift"), (angle, "turn")):
        vector = generator.normal(size=3)
        vector *= size * generator.uniform(0.5, 1.0) / np.linalg.norm(vector)
        if place == "shift":
            pose[:3, 3] = vector
        else:
            pose[:3, :3] = Rotation.from_rotvec(vector).as_matrix()
    return pose


def spread_joints(generator, count=12):
    return START + generator.uniform(-0.5, 0.5, size=(count, 6))


@pytest.mark.parametrize("has_joints", [True, False])
def test_the_loaded_tool_is_on_its_poses(has_joints):
    joints = path(40)
    points = waypoints(joints, joints=joints) if has_joints else waypoints(joints, start=joints[0])
    done = corrected(points)
    assert statuses(done) == ["CORRECTED"] * 40
    np.testing.assert_allclose(loaded_poses(done.joints), tool_poses(joints), atol=1e-9)
    np.testing.assert_allclose(BASE @ done.poses, tool_poses(done.joints), atol=1e-12)
    bent = (loaded_poses(joints) - tool_poses(joints))[:, :3, 3] @ BASE[:3, :3]
    np.testing.assert_allclose(done.deflection, bent, atol=1e-9)
    assert done.residual.max() < 1e-12


@pytest.mark.parametrize("kind", ["krl", "fanuc", "ur", "csv"])
def test_reading_correcting_arrays_and_writing_is_correcting_a_program_to_the_byte(kind):
    text = program_text(kind, tool_poses(path(25)), 6)
    program = read_program([(PROGRAM_FILES[kind], text.encode())])
    (notation,) = program.targets.notations
    sent = program.targets.values[:, : 3 + notation.count]
    done = corrected(Waypoints(notation.to_poses(sent), TOOL_POSE, np.eye(4), start=START))
    numbers = np.full((25, NUMBERS), np.nan)
    numbers[:, : 3 + notation.count] = notation.from_poses(done.poses, sent)
    writer = Rewriting(program)
    writer.replace(np.arange(25), numbers, [])
    (file,) = corrected_program(kind, text).files
    assert writer.files() == [decompress_file(file)]


def refusal(points):
    with pytest.raises(FramesError) as caught:
        corrected(points)
    return caught.value


class TestWrongFrames:
    """With joints, a wrong tool, base, unit or world is refused, and what would agree is proposed."""

    @pytest.mark.parametrize("wrong", ["tool", "base", "world_and_flange"])
    def test_a_wrong_frame_is_refused_and_the_right_one_is_proposed(self, wrong):
        generator = np.random.default_rng(1)
        for _ in range(30):
            joints = spread_joints(generator)
            points = waypoints(joints, joints=joints)
            if wrong != "base":
                points = replace(points, tool=TOOL_POSE @ random_pose(generator, 0.2, 0.3))
            if wrong != "tool":
                points = replace(points, base=random_pose(generator, 0.5, 0.3) @ BASE)
            proposal = refusal(points).proposal
            np.testing.assert_allclose(proposal.tool, TOOL_POSE, atol=1e-9)
            np.testing.assert_allclose(proposal.base, BASE, atol=1e-9)

    @pytest.mark.parametrize(
        ("factor", "words"),
        [(1e3, "mm where m are stated"), (1e-3, "m where mm are stated"), (1 / 25.4, "inches where mm")],
    )
    def test_a_wrong_unit_of_lengths_is_named(self, factor, words):
        joints = spread_joints(np.random.default_rng(2))
        points = waypoints(joints, joints=joints)
        scaled = [each.copy() for each in (points.poses, points.tool, points.base)]
        for each in scaled:
            each[..., :3, 3] *= factor
        error = refusal(Waypoints(*scaled, joints=joints))
        assert error.proposal.cause == "lengths"
        assert words in error.remedy

    @pytest.mark.parametrize("factor", [180 / np.pi, np.pi / 180])
    def test_a_wrong_unit_of_joints_is_named(self, factor):
        joints = spread_joints(np.random.default_rng(3))
        error = refusal(waypoints(joints, joints=factor * joints))
        assert error.proposal.cause == "joints"

    @pytest.mark.parametrize("order", [[2, 1, 0], [1, 0, 2], [1, 2, 0]])
    def test_exchanged_columns_of_a_rotation_vector_are_named(self, order):
        joints = spread_joints(np.random.default_rng(11))
        points = waypoints(joints, joints=joints)
        wrong = points.poses.copy()
        vectors = Rotation.from_matrix(wrong[:, :3, :3]).as_rotvec()
        wrong[:, :3, :3] = Rotation.from_rotvec(vectors[:, order]).as_matrix()
        check_columns(points, wrong, ["rx", "ry", "rz"], order)

    @pytest.mark.parametrize("order", [[2, 1, 0], [1, 0, 2], [2, 0, 1]])
    def test_exchanged_columns_of_a_position_are_named(self, order):
        joints = spread_joints(np.random.default_rng(12))
        points = waypoints(joints, joints=joints)
        wrong = points.poses.copy()
        wrong[:, :3, 3] = wrong[:, order, 3]
        check_columns(points, wrong, ["x", "y", "z"], order)

    def test_orientations_of_another_path_are_refused_without_a_proposal(self):
        """Of some such orientations, the best linear fit is one rotation and one mirror image."""
        generator = np.random.default_rng(13)
        for _ in range(20):
            joints = spread_joints(generator, 8)
            points = waypoints(joints, joints=joints)
            points.poses[:, :3, :3] = Rotation.random(8, random_state=generator).as_matrix()
            assert refusal(points).proposal is None

    def test_one_direction_of_the_tool_is_refused_too(self):
        """Along one line with one orientation, world and flange are not determined together."""
        joints = path(20)
        error = refusal(
            replace(
                waypoints(joints, joints=joints),
                tool=TOOL_POSE @ random_pose(np.random.default_rng(4), 0.1, 0),
            )
        )
        np.testing.assert_allclose(error.proposal.tool, TOOL_POSE, atol=1e-9)

    @pytest.mark.parametrize("digits", [2, 3, 4, 6])
    def test_a_proposal_has_no_digits_of_noise(self, digits):
        joints = spread_joints(np.random.default_rng(6), 40)
        rounded = np.radians(np.round(np.degrees(joints), digits))
        points = replace(waypoints(joints, joints=rounded), tool=np.eye(4))
        assert "`tool` 10, -20, 215.5 mm, rotation vector 0, 0, 0°" in refusal(points).remedy

    @pytest.mark.parametrize("wrong", ["tool", "base", "world_and_flange"])
    def test_the_words_of_a_proposal_are_accepted(self, wrong):
        generator = np.random.default_rng(7)
        for _ in range(10):
            joints = spread_joints(generator, 20)
            rounded = np.radians(np.round(np.degrees(joints), 2))
            points = waypoints(joints, joints=rounded)
            stated = {"tool": TOOL_POSE, "base": BASE}
            if wrong != "base":
                stated["tool"] = TOOL_POSE @ random_pose(generator, 0.2, 0.3)
            if wrong != "tool":
                stated["base"] = random_pose(generator, 0.5, 0.3) @ BASE
            words = refusal(replace(points, **stated)).remedy
            proposed = re.findall(r"`(tool|base)` ([^m]*) mm, rotation vector ([^°]*)°", words)
            assert proposed
            for name, position, vector in proposed:
                numbers = [float(each) for each in f"{position}, {vector}".replace("−", "-").split(", ")]
                stated[name] = np.eye(4)
                stated[name][:3, 3] = 1e-3 * np.array(numbers[:3])
                stated[name][:3, :3] = Rotation.from_rotvec(numbers[3:], degrees=True).as_matrix()
            done = corrected(replace(points, **stated))
            assert (done.status != RowStatus.CONTRADICTORY).all()

    @pytest.mark.parametrize("wrong", ["tool", "base", "world_and_flange"])
    @pytest.mark.parametrize("bad", [[6], [2, 17]])
    def test_single_rows_with_a_mistake_do_not_hide_a_wrong_frame(self, wrong, bad):
        generator = np.random.default_rng(8)
        for size in (0.003, 0.05, 1.0):
            joints = spread_joints(generator, 20)
            stated = joints.copy()
            stated[bad, 1] += size
            points = waypoints(joints, joints=stated)
            if wrong != "base":
                points = replace(points, tool=TOOL_POSE @ random_pose(generator, 0.2, 0.3))
            if wrong != "tool":
                points = replace(points, base=random_pose(generator, 0.5, 0.3) @ BASE)
            error = refusal(points)
            np.testing.assert_allclose(error.proposal.tool, TOOL_POSE, atol=1e-9)
            np.testing.assert_allclose(error.proposal.base, BASE, atol=1e-9)
            assert f"{20 - len(bad)} of 20 rows agree with `" in error.remedy
            named = ", ".join(str(row + 1) for row in bad)
            assert error.remedy.endswith(f"; check pose and joints of row {named}, too")

    def test_single_rows_with_a_mistake_do_not_hide_a_wrong_unit(self):
        joints = spread_joints(np.random.default_rng(9), 20)
        stated = np.degrees(joints)
        stated[4, 2] += 20.0
        error = refusal(waypoints(joints, joints=stated))
        assert error.proposal.cause == "joints"
        assert error.remedy.endswith("; check pose and joints of row 5, too")

    def test_joints_of_another_robot_are_refused_without_a_proposal(self):
        generator = np.random.default_rng(5)
        joints = spread_joints(generator)
        error = refusal(waypoints(joints, joints=joints + generator.uniform(-0.3, 0.3, joints.shape)))
        assert error.proposal is None
        assert "check tool, base, units" in error.remedy

    def test_rounded_joints_are_no_contradiction(self):
        joints = path(50)
        rounded = np.radians(np.round(np.degrees(joints), 2))
        done = corrected(waypoints(joints, joints=rounded))
        assert statuses(done) == ["CORRECTED"] * 50
        np.testing.assert_allclose(done.joints, corrected(waypoints(joints, joints=joints)).joints, atol=1e-9)


def check_columns(points, wrong, names, order):
    """Exchange columns as the remedy of a refusal says, and check that the right poses come out."""
    error = refusal(replace(points, poses=wrong))
    assert error.proposal.cause == "columns"
    moved = {names[order[k]]: names[k] for k in range(3) if order[k] != k}
    assert dict(error.proposal.columns) == moved
    for column, source in moved.items():
        assert f"as `{column}` those of `{source}`" in error.remedy


class TestRows:
    """A row without numbers says why, and the others keep theirs."""

    def check_numbers(self, done):
        is_finite = np.isfinite(done.poses).all(axis=(1, 2)) & np.isfinite(done.joints).all(axis=1)
        assert (is_finite == done.has_numbers).all()

    def test_a_contradictory_row_is_named_and_the_others_are_corrected(self):
        joints = path(20)
        points = waypoints(joints, joints=joints.copy())
        points.joints[7] += 0.05
        done = corrected(points)
        assert np.flatnonzero(done.status != RowStatus.CORRECTED).tolist() == [7]
        assert statuses(done)[7] == "CONTRADICTORY"
        self.check_numbers(done)

    def test_rows_without_load_are_as_sent(self):
        joints = path(10)
        points = waypoints(joints, joints=joints)
        load = loads(10)
        load[3:6] = 0.0
        done = corrected(points, load)
        assert statuses(done)[3:6] == ["NO_LOAD"] * 3
        assert (done.poses[3:6] == points.poses[3:6]).all()
        assert (done.joints[3:6] == joints[3:6]).all()
        assert set(statuses(done)) == {"CORRECTED", "NO_LOAD"}

    def test_a_correction_beyond_its_limits_is_capped(self):
        joints = path(10)
        limits = CorrectionSettings(CorrectionLimits(displacement=1e-4))
        done = corrected(waypoints(joints, joints=joints), settings=limits)
        assert statuses(done) == ["CAPPED"] * 10
        moved = np.linalg.norm((done.poses - waypoints(joints).poses)[:, :3, 3], axis=1)
        assert moved.max() <= 1e-4 * (1 + 1e-3)

    def test_a_pose_out_of_reach_leaves_the_branch_as_it_is(self):
        joints = path(20)
        points = waypoints(joints, start=joints[0])
        points.poses[5, :3, 3] += 9.0
        done = corrected(points)
        assert [name for name in statuses(done) if name != "CORRECTED"] == ["NOT_REACHED"]
        np.testing.assert_allclose(done.wanted[6:], joints[6:], atol=1e-9)
        self.check_numbers(done)

    def test_a_posture_beyond_its_limits_has_no_numbers(self):
        robot, _ = exact_run()
        joints = path(6)
        joints[2, 0] = robot.limits[0, 1] + 0.2
        done = corrected(waypoints(joints, joints=joints))
        assert statuses(done)[2] == "BEYOND_LIMITS"
        self.check_numbers(done)

    def test_without_joints_and_start_all_poses_are_ambiguous(self):
        done = corrected(waypoints(path(10)))
        assert statuses(done) == ["AMBIGUOUS"] * 10
        self.check_numbers(done)

    def test_a_load_that_breaks_the_arm_concerns_its_rows_alone(self):
        joints = path(10)
        load = loads(10)
        load[4:7] *= 1e4
        done = corrected(waypoints(joints, joints=joints), load)
        assert statuses(done)[4:7] == ["OVERLOADED"] * 3
        others = np.r_[0:4, 7:10]
        alone = corrected(waypoints(joints[others], joints=joints[others]))
        assert (done.joints[others] == alone.joints).all()
        self.check_numbers(done)

    def test_a_joint_that_the_readings_do_not_show_is_named_by_its_rows(self):
        run_model, inverse = parts()
        likelihood = run_model.model.likelihood
        shown = likelihood.joints != 0
        unseen = replace(
            run_model.model,
            likelihood=Likelihood(
                likelihood.joints[shown],
                likelihood.centre[shown],
                likelihood.covariance[np.ix_(shown, shown)],
            ),
        )
        joints = path(6)
        load = loads(6, (0.0, 0.0, -500.0))
        load[2, 0] = 300.0  # across the arm, which twists joint 1
        joints[:, 0] = 0.0
        done = correct(unseen, None, inverse, waypoints(joints, joints=joints), load)
        assert statuses(done)[2] == "UNSEEN_JOINT"
        assert statuses(done).count("UNSEEN_JOINT") < 6
        self.check_numbers(done)

    def test_a_load_along_a_feed_needs_a_motion(self):
        joints = np.repeat(path(4)[:1], 4, axis=0)
        points = waypoints(joints, joints=joints)
        along_feed = turn_loads(points.find_axes("feed"), loads(4, (100.0, 0.0, 0.0)))
        assert statuses(corrected(points, along_feed)) == ["NO_DIRECTION"] * 4


class TestBranches:
    """No row is silently of another branch."""

    @pytest.mark.parametrize("seed", range(6))
    def test_rows_are_on_their_branch_or_say_that_they_are_ambiguous(self, seed):
        generator = np.random.default_rng(seed)
        steps = generator.normal(size=(60, 6)) * generator.choice([0.002, 0.05, 0.3], size=(60, 1))
        joints = START + np.cumsum(steps, axis=0)
        robot, _ = exact_run()
        joints = np.clip(joints, robot.limits[:, 0] + 0.01, robot.limits[:, 1] - 0.01)
        done = corrected(waypoints(joints, start=joints[0]))
        has_numbers = done.has_numbers
        assert has_numbers[0]
        np.testing.assert_allclose(done.wanted[has_numbers], joints[has_numbers], atol=1e-6)

    def test_a_wrist_that_is_turned_over_is_followed(self):
        joints = path(30)
        joints[:, 4] = np.linspace(0.3, -0.3, 30)
        done = corrected(waypoints(joints, start=joints[0]))
        has_numbers = done.has_numbers
        np.testing.assert_allclose(done.wanted[has_numbers], joints[has_numbers], atol=1e-6)

    def test_an_elbow_that_may_have_been_stretched_is_ambiguous_from_there_on(self):
        """An elbow that passes through its singularity and one that returns have the same poses."""
        joints = np.tile(START, (41, 1))
        joints[:, 2] = np.linspace(-1.3, -1.7, 41)
        done = corrected(waypoints(joints, start=joints[0]))
        has_numbers = done.has_numbers
        assert 0 < has_numbers.sum() < 41
        assert set(statuses(done)[int(has_numbers.sum()) :]) == {"AMBIGUOUS"}
        np.testing.assert_allclose(done.wanted[has_numbers], joints[has_numbers], atol=1e-6)

    def test_joints_keep_their_branch_through_a_singularity(self):
        joints = path(30)
        joints[:, 4] = np.linspace(0.3, -0.3, 30)
        done = corrected(waypoints(joints, joints=joints))
        has_numbers = done.has_numbers
        assert has_numbers.sum() >= 28
        np.testing.assert_allclose(done.wanted[has_numbers], joints[has_numbers], atol=1e-6)


def test_forces_by_length_are_interpolated():
    lengths = np.array([0.0, 1.0, 2.0, 4.0])
    table = np.array([[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, -200.0], [4.0, 0.0, 0.0, -200.0]])
    assert place_forces(table, lengths)[:, 2].tolist() == [0.0, -100.0, -200.0, -200.0]


def test_two_rows_of_one_length_are_a_step_of_the_force():
    table = np.array(
        [[0.0, 0.0, 0.0, -1.0], [2.0, 0.0, 0.0, -1.0], [2.0, 0.0, 0.0, -5.0], [4.0, 0.0, 0.0, -5.0]]
    )
    assert place_forces(table, np.array([0.0, 1.0, 3.0]))[:, 2].tolist() == [-1.0, -1.0, -5.0]


@pytest.mark.parametrize(
    ("lengths", "reason"),
    [
        ([2.0, 0.0, 4.0], "the length 0 in row 2 of the forces is less than the length 2 in the row before"),
        ([0.0, 1.0, NAN], "the length in row 3 of the forces is not a finite number"),
    ],
)
def test_forces_whose_lengths_are_not_in_rising_order_are_refused(lengths, reason):
    table = np.column_stack([lengths, np.zeros((3, 2)), [0.0, -200.0, -200.0]])
    with pytest.raises(RequestError, match=reason) as caught:
        place_forces(table, np.array([0.0, 1.0, 2.0, 4.0]))
    assert caught.value.where == "forces"


def test_the_joint_speed_follows_from_the_feed():
    joints = path(50)
    points = waypoints(joints, joints=joints)
    done = corrected(points, feed=0.05)
    duration = np.linalg.norm(np.diff(points.poses[:, :3, 3], axis=0), axis=1) / 0.05
    expected = np.abs(np.diff(joints, axis=0)).max(axis=1) / duration
    np.testing.assert_allclose(done.joint_speed[1:], expected, rtol=1e-2)
    assert np.isnan(done.joint_speed[0])
