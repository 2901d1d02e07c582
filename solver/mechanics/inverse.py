"""Inverse kinematics of arms with six revolute joints: all branches, and the branch that a path follows.

Prismatic joints, such as a rail below the arm, do not move; the arm consists of the other joints. All
branches are found in closed form (EAIK) and made exact by Newton steps. EAIK finds how a chain decomposes
into subproblems of known solution (Ostermeier, Külz, Althoff, *Automatic Geometric Decomposition for
Analytical Inverse Kinematics*, 2024). A chain that was identified by measurement has no such decomposition,
as no two of its axes are exactly parallel or meet exactly: Newton's method then starts from the branches of
the nearest chain with a decomposition. If several postures reach a pose of a path, the ranges of angles that
a program states decide between them; without such ranges the posture before decides.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, are_regular
from jointstiff.solver.errors import CasesError, RequestError, RobotError
from jointstiff.solver.mechanics.postures import Postures, flange_poses, rotation_vectors
from jointstiff.solver.mechanics.robot import Robot, fix_prismatic_joints

BRANCHES: Final = 8
"""Greatest number of solutions kept for a pose; more exist only where a joint can turn freely."""
_JOINTS: Final = 6
_STEPS: Final = 8
_REACHED: Final = 1e-10
"""Distance [m] and angle [rad] from a pose within which it counts as reached."""
_LAST_STEP: Final = 1e-6
"""Step of Newton's method [rad] after which the error is rounding: its square times an arm's reach."""
_NOT_DESIGNED: Final = 1e-2
"""Components of an axis, or of a step between axes [m], below which they are deviations from the design."""
_REFINED_AT_ONCE: Final = 4096
"""Number of postures that are refined at a time: as many as the processor's cache holds."""
_DAMPING: Final = 1e-12
_FAR_START: Final = 0.2
"""Least distance [rad] of a start from the first pose's posture at which its unit is doubted."""
_NEAR_START: Final = 1.0 / 3.0
"""Greatest ratio of the distances with the other unit and with the stated unit that shows a mistaken unit."""
_NEARER_START: Final = 0.9
"""Greatest such ratio of a start whose numbers look like radians."""
_LEAST_RADIANS: Final = 0.5
"""Least greatest angle of a start in radians; a start of smaller numbers is the zero posture in degrees."""
_ROUND: Final = 1e-6
"""Greatest distance of ten times an angle from a whole number at which the angle has one decimal."""
_SAME_SOLUTION: Final = 1e-3
"""Difference [rad] below which two solutions count as the same solution."""
_SINGULAR: Final = 2e-3
"""Least singular value up to which branches cannot be distinguished."""
_LEAST_STEP: Final = 1.0 / 1024.0
"""Smallest fraction of a straight line that is followed in one step."""
_WORKERS: Final = 1
"""Threads of EAIK; more would take the processor from other work."""
_TURN: Final = 2.0 * np.pi
_TURNS: Final = np.arange(-2, 3) * _TURN
"""Full turns that are tried about an angle [rad]."""
_TOLERANCE: Final = 1e-4
"""Angle by which a stated range or a joint's limit may be missed [rad]: programs are rounded."""
_NEAR_SINGULAR: Final = 0.04
"""Least singular value of a solution up to which another solution close by may be missing."""
_POSES_AT_ONCE: Final = 4096
"""Poses of a path whose solutions are held at a time."""
_LONGEST_RUN: Final = 2048
"""Most poses along which a branch is followed at a time."""
_SHORTEST_RUN: Final = 16
"""Poses along which a branch is followed at a time behind a pose where the branch is not certain."""
_SURE_STEP: Final = 0.5 * np.pi
"""Step of a joint [rad] up to which it is clear which of several full turns is meant."""


class InverseKinematics:
    """Inverse kinematics: joint angles that bring the flange to given poses while prismatic joints rest.

    Attributes:
        arm: robot without its prismatic joints, with six revolute joints; angles (..., 6) are of this arm.
        revolute: (6,) indices of the revolute joints among the robot's joints.
    """

    def __init__(self, robot: Robot, fixed: FloatArray | None = None) -> None:
        """Find a closed-form solution of the chain, or of the nearest chain that has a closed-form solution.

        Args:
            robot: n joints, six of them revolute.
            fixed: (n,) controller's joint positions [rad or m], needed if the robot has prismatic joints:
                only the positions of prismatic joints are used, which stay there.

        Raises:
            RobotError: the robot does not have six revolute joints, the position of a prismatic joint is not
                known, or no closed-form solution is known.
        """
        self._arguments = robot, fixed
        self.revolute = np.flatnonzero(~robot.prismatic)
        if len(self.revolute) != _JOINTS:
            remedy = "inverse kinematics needs an arm with six revolute joints"
            count = f"{len(self.revolute)} revolute joints" if robot.prismatic.any() else f"{robot.n} joints"
            raise RobotError(f"the robot has {count}", remedy=remedy, where="robot")
        # Positions of all joints; those of the prismatic joints are used: controller's, then model's
        self.arm, self._fixed, self._fixed_in_model = robot, np.zeros(robot.n), np.zeros(robot.n)
        if robot.prismatic.any():
            if fixed is None:
                linear = ", ".join(np.array(robot.joint_names)[robot.prismatic])
                raise RobotError(
                    f"the request does not give the position of the linear axis {linear}",
                    remedy="give the positions of all joints in `near` or `start`; the linear axis stays at "
                    "its position",
                    where="robot",
                )
            self.arm = fix_prismatic_joints(robot, fixed)
            self._fixed, self._fixed_in_model = fixed, robot.joint_map.model_angles(fixed[None])[0]
        try:
            from eaik.pybindings import EAIK
        except ImportError:
            raise RobotError(
                "inverse kinematics needs EAIK, which is not installed",
                remedy="use Python 3.11 to 3.13, for which EAIK has wheels",
                where="robot",
            ) from None
        robot = self.arm
        flange = Postures(robot, np.zeros((1, robot.n)))
        rotation, origin = flange.joint_frames
        axes = np.stack([R @ axis for R, axis in zip(rotation[0], robot.axes, strict=True)])
        # Steps from R0 to the first joint, from each joint to the next, and to the flange [m].
        steps = np.diff(np.vstack([np.zeros(3), origin[0], flange.flange_translation]), axis=0)
        # Try the identified chain first; if EAIK cannot solve this chain, try the chain as designed.
        for self._exact in (True, False):
            if not self._exact:  # remove the small deviations from design that identification found
                axes, steps = (np.where(np.abs(each) < _NOT_DESIGNED, 0.0, each) for each in (axes, steps))
                axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
            self._solver = EAIK.Robot(axes.T, steps.T, flange.flange_rotation[0], [], True)
            if self._solver.has_known_decomposition():
                return
        raise RobotError(
            "no closed-form inverse kinematics is known for this arrangement of axes",
            remedy="use an arm with three parallel axes, or with a wrist whose axes meet",
            where="robot",
        )

    def __reduce__(self) -> tuple[type[InverseKinematics], tuple[Robot, FloatArray | None]]:
        """Pickle the constructor's arguments only: EAIK's decomposition is found again when unpickled."""
        return InverseKinematics, self._arguments

    def select_arm_joints(self, joints: FloatArray) -> FloatArray:
        """Select the arm's six joints from the positions of all joints (..., n); return (..., 6)."""
        return joints if self.arm.n == len(self._fixed) else joints[..., self.revolute]

    def insert_held_joints(self, angles: FloatArray, *, of_model: bool = False) -> FloatArray:
        """Return the positions (..., n) [rad or m] of all joints: the arm's, and the fixed prismatic joints'.

        The arm's angles (..., 6) [rad] are the controller's, or the model's if `of_model` is true.
        """
        if self.arm.n == len(self._fixed):
            return angles
        fixed = self._fixed_in_model if of_model else self._fixed
        joints = np.broadcast_to(fixed, (*angles.shape[:-1], len(fixed))).copy()
        joints[..., self.revolute] = angles
        joints[np.isnan(angles[..., 0])] = np.nan  # postures without a solution have no positions at all
        return joints

    def reach_with_held_joints(self, robot: Robot, commanded: FloatArray) -> FloatArray:
        """Return positions (m, n) that reach the poses of `commanded` (m, n) with fixed prismatic joints.

        All positions are the model's [rad or m].

        Raises:
            CasesError: the arm does not reach a pose without moving a prismatic joint.
        """
        if self.arm is robot:
            return commanded
        angles, reached = self.refine(flange_poses(robot, commanded), self.select_arm_joints(commanded))
        if not reached.all():
            raise CasesError(
                "the arm does not reach the corrected target while the linear axis stays in place",
                failed=~reached,
                cause="not_reached",
                remedy="move the part away from the singularity",
            )
        return self.insert_held_joints(angles, of_model=True)

    def solve(self, poses: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Find all solutions of flange poses (m, 4, 4) in R0 [m].

        Without a closed form, Newton's method starts from the closed-form solutions of a nearby chain. Near
        singularities the method may fail, or reach one solution twice: then solutions may be missing.

        Returns:
            The model's angles (m, 8, 6) in [−π, π] [rad], padded with NaN, and a mask (m,) of poses with all
            solutions found.
        """
        angles, complete = self._solve_closed_form(poses)
        if not self._exact:
            pose_of_solution, branch_of_solution = np.nonzero(np.isfinite(angles[:, :, 0]))
            refined, is_reached = self.refine(
                poses[pose_of_solution], angles[pose_of_solution, branch_of_solution]
            )
            refined[~is_reached] = np.nan
            complete[pose_of_solution[~is_reached]] = False
            angles[pose_of_solution, branch_of_solution] = refined
            # Two equal solutions show that another solution was not found: compare all pairs of branches.
            for i in range(1, BRANCHES):
                gaps = compute_angle_gaps(angles[:, i:], angles[:, :-i])
                complete &= ~(np.nan_to_num(gaps, nan=np.inf) < _SAME_SOLUTION).any(axis=1)
            is_singular = ~self.keep_clearance(refined[is_reached], _SINGULAR)
            complete[pose_of_solution[is_reached][is_singular]] = False
        return angles, complete

    def _solve_closed_form(self, poses: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return EAIK's solutions (m, 8, 6) [rad], padded with NaN, and a mask of complete poses.

        `poses` (m, 4, 4) are of the flange in R0 [m]; the mask (m,) is true where no solution is missing.
        """
        solutions = self._solver.calculate_IK_batched(poses, _WORKERS)
        branches = [solution.Q for solution in solutions]
        counts = np.array([len(each) for each in branches])
        if not counts.any():
            return np.full((len(poses), BRANCHES, _JOINTS), np.nan), np.full(len(poses), self._exact)
        all_solutions = np.concatenate([each for each in branches if len(each)])
        is_least_squares = np.concatenate([solution.is_LS for solution in solutions]).astype(bool)
        is_complete: BoolArray = np.asarray((counts <= BRANCHES) | self._exact)
        pose_of_solution = np.repeat(np.arange(len(poses)), counts)
        # Least-squares solutions mean that the pose is out of reach. An exact chain drops them; with an
        # approximate chain, Newton's method decides.
        if self._exact:
            all_solutions = all_solutions[~is_least_squares]
            pose_of_solution = pose_of_solution[~is_least_squares]
            counts = np.bincount(pose_of_solution, minlength=len(poses))
        else:
            is_complete[pose_of_solution[is_least_squares]] = False
        is_filled = np.arange(max(BRANCHES, counts.max())) < counts[:, None]
        angles = np.full((*is_filled.shape, _JOINTS), np.nan)
        angles[is_filled] = all_solutions
        return angles[:, :BRANCHES], is_complete

    def is_same_branch(self, angles: FloatArray, reference: FloatArray) -> BoolArray:
        """Return a mask (m,) of postures that are surely on the same branch of solutions as a reference.

        The Jacobian changes by about as much as the angles. Within half the least singular value of a
        solution there is therefore no other solution.

        Args:
            angles: (m, 6) angles of the postures [rad].
            reference: (m, 6) angles of the references [rad].
        """
        change = np.abs(angles - reference).max(axis=1, initial=0.0)
        solved = np.flatnonzero(np.isfinite(change))
        is_same = np.zeros(len(angles), dtype=np.bool_)
        is_same[solved] = self.keep_clearance(angles[solved], np.maximum(2.0 * change[solved], _SINGULAR))
        return is_same

    def keep_clearance(self, angles: FloatArray, clearance: FloatArray | float) -> BoolArray:
        """Return a mask (m,) of joint angles (m, 6) whose `least_singular_value` is at least a clearance.

        Args:
            angles: (m, 6) angles of the arm's joints [rad].
            clearance: one clearance, or (m,) of them, positive; SI units.
        """
        if not len(angles):
            return np.zeros(0, dtype=np.bool_)
        return are_regular(Postures(self.arm, angles).flange_jacobian, clearance)

    def least_singular_value(self, angles: FloatArray) -> FloatArray:
        """Return the least singular value (m,) of the flange's Jacobian at joint angles (m, 6), SI units."""
        if not len(angles):
            return np.zeros(0)
        jacobian = Postures(self.arm, angles).flange_jacobian
        return np.asarray(np.linalg.svd(jacobian, compute_uv=False)[:, -1])

    def follow_branches(self, poses: FloatArray, start_angles: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Follow branches of solutions from start angles along straight lines to other poses.

        Args:
            poses: (m, 4, 4) poses of the flange to reach [m].
            start_angles: (m, 6) model's angles at which the lines start [rad].

        Returns:
            The model's angles (m, 6) at the poses [rad], and a mask (m,) of poses that were reached on the
            same branch with certainty.
        """
        start_poses, current_angles = flange_poses(self.arm, start_angles), start_angles.copy()
        # Fractions of the line: the part that is already followed, and the length of the next step.
        followed_fraction, step = np.zeros(len(poses)), np.ones(len(poses))
        unfinished = np.arange(len(poses))
        while len(unfinished):
            fraction = np.minimum(followed_fraction[unfinished] + step[unfinished], 1.0)
            next_poses = _interpolate_poses(start_poses[unfinished], poses[unfinished], fraction)
            angles, is_sure = self.refine(next_poses, current_angles[unfinished])
            is_sure &= self.is_same_branch(angles, current_angles[unfinished])
            current_angles[unfinished[is_sure]] = angles[is_sure]
            followed_fraction[unfinished[is_sure]] = fraction[is_sure]
            step[unfinished] *= np.where(is_sure, 2.0, 0.5)  # a failed step is tried again at half the length
            unfinished = unfinished[(followed_fraction[unfinished] < 1.0) & (step[unfinished] >= _LEAST_STEP)]
        return current_angles, followed_fraction >= 1.0

    def refine(self, poses: FloatArray, start_angles: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Solve for poses (m, 4, 4) [m] using Newton's method, from start angles (m, 6) of the model [rad].

        Returns:
            The model's angles (m, 6) [rad], and a mask (m,) of the poses that are reached.
        """
        angles, is_reached = start_angles.copy(), np.zeros(len(start_angles), dtype=np.bool_)
        for start in range(0, len(poses), _REFINED_AT_ONCE):
            block = slice(start, start + _REFINED_AT_ONCE)
            angles[block], is_reached[block] = self.refine_from(
                poses[block], Postures(self.arm, start_angles[block])
            )
        return angles, is_reached

    def refine_from(self, poses: FloatArray, postures: Postures) -> tuple[FloatArray, BoolArray]:
        """Solve for poses (m, 4, 4) [m] using Newton's method, starting from m postures.

        Returns:
            The model's angles (m, 6) [rad], and a mask (m,) of the poses that are reached.
        """
        angles, is_reached = postures.q.copy(), np.zeros(len(postures), dtype=np.bool_)
        unfinished = np.arange(len(postures))
        for step_number in range(_STEPS):
            if step_number:
                postures = Postures(self.arm, angles[unfinished])
            pose_gaps = np.empty((len(unfinished), 6))  # displacement and rotation vector to the poses
            pose_gaps[:, :3] = poses[unfinished, :3, 3] - postures.flange_translation
            pose_gaps[:, 3:] = rotation_vectors(poses[unfinished, :3, :3], postures.flange_rotation)
            jacobian = postures.flange_jacobian
            normal = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING * np.eye(6)
            step = (jacobian.transpose(0, 2, 1) @ np.linalg.solve(normal, pose_gaps[..., None]))[..., 0]
            # Near singularities the damped step does not close the gap completely.
            remaining_gaps = pose_gaps - (jacobian @ step[..., None])[..., 0]
            angles[unfinished] += step
            is_near = np.abs(remaining_gaps).max(axis=1, initial=0.0) <= 0.5 * _REACHED
            is_reached[unfinished] = is_near & (np.abs(step).max(axis=1, initial=0.0) <= _LAST_STEP)
            unfinished = unfinished[~is_reached[unfinished]]
            if not len(unfinished):
                break
        return angles, is_reached


def _interpolate_poses(begin: FloatArray, end: FloatArray, fraction: FloatArray) -> FloatArray:
    """Return poses (m, 4, 4) at fractions (m,) in [0, 1] of the motions from `begin` to `end`.

    A motion shifts the origin along a straight line and turns about a fixed axis.
    """
    poses = end.copy()
    column = fraction[:, None]
    poses[:, :3, 3] = (1.0 - column) * begin[:, :3, 3] + column * end[:, :3, 3]
    turn = rotation_vectors(end[:, :3, :3], begin[:, :3, :3])
    poses[:, :3, :3] = Rotation.from_rotvec(column * turn).as_matrix() @ begin[:, :3, :3]
    # The end of a line is the given pose itself, without rounding.
    return np.asarray(np.where(fraction[:, None, None] < 1.0, poses, end))


class Unreached(IntEnum):
    """Reasons why no posture was chosen for a pose."""

    NO = 0
    OUT_OF_REACH = 1
    OUT_OF_LIMITS = 2
    NOT_AS_STATED = 3
    AMBIGUOUS = 4
    NOT_FOLLOWED = 5


def choose_postures(
    inverse: InverseKinematics,
    poses: FloatArray,
    joint_targets: FloatArray,
    ranges: FloatArray,
    ranges_decide: BoolArray,
    start: FloatArray | None = None,
) -> tuple[FloatArray, IndexArray]:
    """Choose a posture for each target of a path.

    A target with given joint angles keeps them. A pose for which ranges decide gets a solution with angles in
    its ranges, the nearest to the posture before if there are several; any other pose gets the nearest
    solution.

    Args:
        inverse: kinematics of the robot.
        poses: (m, 4, 4) poses of the flange in R0 [m]; ignored for joint targets.
        joint_targets: (m, 6) controller's angles of targets that are given by angles [rad]; NaN for poses.
        ranges: (m, 6, 2) least and greatest controller's angles [rad] that the program states; ∓inf if it
            states none.
        ranges_decide: (m,) mask of poses for which the ranges decide; the ranges also decide where no posture
            before is known.
        start: (n,) controller's joint positions near the first pose [rad or m]; None if unknown.

    Returns:
        The controller's joint positions (m, n) [rad or m], NaN without posture; and (m,) values of
        `Unreached`.

    Raises:
        RobotError: the joint map lets a model joint depend on the controller's angle of a joint farther from
            the base.
    """
    chosen = _choose(inverse, poses, joint_targets, ranges, ranges_decide, start)
    return chosen.joints, chosen.unreached


@dataclass(frozen=True, eq=False)
class FollowedPoses:
    """Postures along m poses, each the nearest to the posture before."""

    joints: FloatArray  #: (m, n) controller's joint positions [rad or m]; NaN without a posture
    unreached: IndexArray  #: (m,) values of `Unreached`
    #: (m,) mask of poses where the nearest branch is not surely that of the posture before: the step is long,
    #: or another branch is close
    doubtful: BoolArray
    #: (m,) difference between the posture and the nearest other posture that reaches the pose [rad]; inf if
    #: there is no other
    apart: FloatArray


def follow_poses(inverse: InverseKinematics, poses: FloatArray, start: FloatArray | None) -> FollowedPoses:
    """Choose a posture for each pose of a path: the nearest to the posture before.

    Args:
        inverse: kinematics of the robot.
        poses: (m, 4, 4) poses of the flange in R0 [m].
        start: (n,) controller's joint positions near the first pose [rad or m]; None if unknown.

    Raises:
        RobotError: the joint map lets a model joint depend on the controller's angle of a joint farther from
            the base.
    """
    count = len(poses)
    free = np.full((count, _JOINTS), np.nan)
    unlimited = np.broadcast_to([-np.inf, np.inf], (count, _JOINTS, 2))
    return _choose(inverse, poses, free, unlimited, np.zeros(count, dtype=np.bool_), start)


def _choose(
    inverse: InverseKinematics,
    poses: FloatArray,
    joint_targets: FloatArray,
    ranges: FloatArray,
    ranges_decide: BoolArray,
    start: FloatArray | None,
) -> FollowedPoses:
    """Choose a posture for each target of a path, as `choose_postures` describes."""
    robot = inverse.arm
    if np.triu(robot.joint_map.matrix, 1).any():
        raise RobotError(
            "a model joint depends on the controller's angle of a joint farther from the base",
            remedy="give a joint map without entries above the diagonal",
            where="joint_map.matrix",
        )
    joints, unreached = joint_targets.copy(), np.zeros(len(poses), dtype=np.intp)
    doubtful, apart = np.zeros(len(poses), dtype=np.bool_), np.full(len(poses), np.inf)
    previous_angles = None if start is None else inverse.select_arm_joints(start)
    for first in range(0, len(poses), _POSES_AT_ONCE):
        block = slice(first, first + _POSES_AT_ONCE)
        posture_choice = _PostureChoice(
            inverse, poses[block], joint_targets[block], ranges[block], ranges_decide[block]
        )
        if first == 0 and previous_angles is not None:
            posture_choice.refuse_start_in_other_unit(previous_angles)
        previous_angles = posture_choice.follow(joints[block], unreached[block], previous_angles)
        doubtful[block], apart[block] = posture_choice.doubtful, posture_choice.apart
        _mark_beyond_limits(robot, joints[block], unreached[block])
    return FollowedPoses(inverse.insert_held_joints(joints), unreached, doubtful, apart)


def _mark_beyond_limits(robot: Robot, joints: FloatArray, unreached: IndexArray) -> None:
    """Mark postures beyond the joints' limits as `OUT_OF_LIMITS`, unless there is another reason.

    Args:
        robot: six revolute joints.
        joints: (m, 6) controller's angles [rad]; NaN without a posture.
        unreached: (m,) values of `Unreached`, to be changed.
    """
    is_known: BoolArray = np.asarray(np.isfinite(joints).all(axis=1))
    angles = robot.joint_map.model_angles(np.where(is_known[:, None], joints, 0.0))
    lower, upper = robot.limits.T
    is_beyond = np.maximum(lower - angles, angles - upper).max(axis=1) > _TOLERANCE
    unreached[is_known & is_beyond & (unreached == Unreached.NO)] = Unreached.OUT_OF_LIMITS


class _PostureChoice:
    """Choice of postures for m consecutive targets of a path, with all solutions of the poses [rad]."""

    def __init__(
        self,
        inverse: InverseKinematics,
        poses: FloatArray,
        joint_targets: FloatArray,
        ranges: FloatArray,
        ranges_decide: BoolArray,
    ) -> None:
        """Find all solutions of the poses.

        Args:
            inverse: inverse kinematics of the robot.
            poses: (m, 4, 4) poses of the flange in R0 [m].
            joint_targets: (m, 6) controller's angles of targets that are given by angles [rad]; NaN for
                poses.
            ranges: (m, 6, 2) least and greatest controller's angles [rad]; ∓inf without a stated range.
            ranges_decide: (m,) mask of poses for which the ranges decide.
        """
        self._inverse, self._robot, self._poses = inverse, inverse.arm, poses
        self._is_pose, self._ranges, self._ranges_decide = (
            np.isnan(joint_targets[:, 0]),
            ranges,
            ranges_decide,
        )
        solutions, is_complete = inverse.solve(poses[self._is_pose])
        is_used = np.isfinite(solutions[:, :, 0]).any(axis=0)
        # Solutions (m, k, 6) of each pose on its k ≤ 8 branches, and a mask (m,) of poses with all solutions
        self._branches = np.full((len(poses), int(is_used.sum()), _JOINTS), np.nan)
        self._branches[self._is_pose] = solutions[:, is_used]
        self._complete = np.ones(len(poses), dtype=np.bool_)
        self._complete[self._is_pose] = is_complete
        # As of `FollowedPoses`
        self.doubtful, self.apart = np.zeros(len(poses), dtype=np.bool_), np.full(len(poses), np.inf)

    def refuse_start_in_other_unit(self, start: FloatArray) -> None:
        """Refuse a start that is near the first pose only if its numbers have the other unit of angles.

        Args:
            start: (6,) controller's angles near the first pose, as converted from the stated unit [rad].

        Raises:
            RequestError: the numbers of the start are radians where degrees are stated, or degrees where
                radians are stated.
        """
        if not np.isfinite(self._branches[0, :, 0]).any():
            return
        distance = self._measure_from_start(start)
        if distance < _FAR_START:
            return
        turn = 2.0 * np.pi
        is_beyond_a_turn = np.abs(start).max() > turn  # otherwise the start may well be in radians
        for unit, stated, corrected in (
            ("radians", "degrees", np.rad2deg(start)),
            ("degrees", "radians", np.deg2rad(start)),
        ):
            is_possible = np.abs(corrected).max() <= turn if stated == "degrees" else is_beyond_a_turn
            corrected_distance = self._measure_from_start(corrected)
            looks_like_radians = stated == "degrees" and _has_numbers_of_radians(start)
            nearer = _NEARER_START if looks_like_radians else _NEAR_START
            if is_possible and corrected_distance < nearer * distance:
                shown = np.rad2deg(corrected) if stated == "degrees" else corrected
                numbers = ", ".join(f"{each:.4g}" for each in shown)
                remedy = f"give the start in {stated}: {numbers}"
                if corrected_distance >= _NEAR_START * distance:
                    remedy += "; or, if it is in degrees, to a tenth of a degree"
                raise RequestError(
                    f"the start seems to be in {unit}, not in {stated}: the nearest posture of the first "
                    f"pose differs by {np.rad2deg(distance):.3g}° in an angle; with the numbers taken as "
                    f"{unit}, by {np.rad2deg(corrected_distance):.3g}°",
                    where="start",
                    remedy=remedy,
                )

    def _measure_from_start(self, start: FloatArray) -> float:
        """Return how far the nearest posture of the first pose is from a start (6,) [rad], in one angle."""
        angles = self._robot.joint_map.model_angles(start[None])[0]
        return float(np.nanmin(compute_angle_gaps(self._branches[0], angles)))

    def follow(
        self, joints: FloatArray, unreached: IndexArray, previous: FloatArray | None
    ) -> FloatArray | None:
        """Choose a posture for each pose in order, or store the reason why no posture was chosen.

        Args:
            joints: (m, 6) controller's angles [rad] to be filled in.
            unreached: (m,) values of `Unreached` to be filled in.
            previous: (6,) controller's angles of the posture before [rad]; None if unknown.

        Returns:
            The controller's angles (6,) of the last known posture [rad]; None if no posture is known.
        """
        out_of_reach = self._is_pose & np.isnan(self._branches[:, :, 0]).all(axis=1)
        unreached[out_of_reach] = Unreached.OUT_OF_REACH
        path, position, length = np.flatnonzero(~out_of_reach), 0, _LONGEST_RUN
        while position < len(path):
            pose = path[position]
            if not self._is_pose[pose]:  # a joint target already has its angles
                position += 1
            elif self._ranges_decide[pose] or previous is None:
                joints[pose], unreached[pose] = self.choose_in_ranges(pose, previous)
                position += 1
            else:  # follow the branch up to the next joint target, or pose for which the ranges decide
                poses_to_follow = path[position : position + length]
                stops = np.flatnonzero(self._ranges_decide[poses_to_follow] | ~self._is_pose[poses_to_follow])
                poses_to_follow = poses_to_follow[: stops[0]] if len(stops) else poses_to_follow
                angles, unreached[pose] = self.follow_nearest(poses_to_follow, previous)
                if not unreached[pose]:
                    joints[poses_to_follow[: len(angles)]] = angles
                    pose = poses_to_follow[len(angles) - 1]
                position += len(angles)
                is_certain = len(angles) == len(poses_to_follow)
                length = min(2 * length, _LONGEST_RUN) if is_certain else _SHORTEST_RUN
            previous = joints[pose] if np.isfinite(joints[pose]).all() else previous
        return previous

    def choose_in_ranges(self, pose: int, previous: FloatArray | None) -> tuple[FloatArray, Unreached]:
        """Choose the solution of a pose within the stated ranges, the nearest to the posture before.

        Args:
            pose: index of the pose.
            previous: (6,) controller's angles of the posture before [rad]; None if unknown.

        Returns:
            Controller's angles (6,) [rad], and `Unreached.NO` or the reason why the angles must not be used.
        """
        fits, angles = fit_to_ranges(self._robot, self._branches[pose], self._ranges[pose], previous)
        fitting = angles[fits]
        if not len(fitting):
            return np.full(6, np.nan), Unreached.NOT_AS_STATED
        if previous is None:  # only one solution may fit, as no posture decides between several
            spread = np.abs(fitting - fitting[0]).max()
            if spread > _TOLERANCE:
                return fitting[0], Unreached.AMBIGUOUS
        chosen = fitting[0 if previous is None else np.argmin(np.abs(fitting - previous).max(axis=1))]
        if not self._complete[pose]:
            # Solutions may be missing; near a singularity a missing solution may be the nearer one.
            least_singular_value = self._inverse.least_singular_value(
                self._robot.joint_map.model_angles(chosen[None])
            )
            return chosen, Unreached.NOT_FOLLOWED if least_singular_value[
                0
            ] < _NEAR_SINGULAR else Unreached.NO
        return chosen, Unreached.NO

    def follow_nearest(self, run: IndexArray, previous: FloatArray) -> tuple[FloatArray, Unreached]:
        """Choose solutions near the posture before along a run of poses, as far as the branch is certain.

        Returns:
            Controller's angles (k, 6) [rad] of the first k ≥ 1 poses, and `Unreached.NO` or the reason why
            the first pose has no posture.
        """
        joint_map = self._robot.joint_map
        previous_angles = joint_map.model_angles(previous[None])[0]
        gaps = compute_angle_gaps(self._branches[run[0]], previous_angles)
        b = int(np.nanargmin(gaps))  # nearest branch
        if (
            not self._complete[run[0]]
            and not self._continues_branch(self._branches[run[:1], b], previous_angles[None])[0]
        ):
            # The branch of the posture before may be missing among the solutions: follow it by Newton steps
            found, known = self._inverse.follow_branches(self._poses[run[:1]], previous_angles[None])
            return joint_map.controller_angles(found), Unreached.NO if known[0] else Unreached.NOT_FOLLOWED
        first_apart = compute_angle_gaps(self._branches[run[0]], self._branches[run[0], b])
        first_apart[b] = np.inf
        self.apart[run[0]] = np.nanmin(first_apart)
        self.doubtful[run[0]] = gaps[b] > _SURE_STEP or 2.0 * gaps[b] >= self.apart[run[0]]
        followed = self._branches[run, b]  # (m, 6) solutions on one branch
        step = compute_angle_gaps(followed[1:], followed[:-1])
        others = compute_angle_gaps(self._branches[run[1:]], followed[1:, None])
        others[:, b] = np.inf
        # A solution that is more than twice as far from all others as from the posture before is the nearest
        # to that posture, by the triangle inequality.
        apart = np.fmin.reduce(others, axis=1)  # solutions of NaN do not count
        is_sure = 2.0 * step < apart
        incomplete = np.flatnonzero(~self._complete[run[1:]])
        is_sure[incomplete] &= self._continues_branch(followed[1:][incomplete], followed[:-1][incomplete])
        breaks = np.flatnonzero(~is_sure)
        count = int(breaks[0]) + 1 if len(breaks) else len(run)
        self.apart[run[1:count]] = apart[: count - 1]
        angles = np.unwrap(np.vstack([previous_angles, followed[:count]]), axis=0)[1:]
        return joint_map.controller_angles(angles), Unreached.NO

    def _continues_branch(self, angles: FloatArray, before: FloatArray) -> BoolArray:
        """Return a mask (k,) of solutions (k, 6) [rad] on the branches of `before`, up to full turns."""
        return self._inverse.is_same_branch(before + wrap_angles(angles - before), before)


def _has_numbers_of_radians(angles: FloatArray) -> bool:
    """Return whether angles look, in degrees, like radians: some to ±π, with more than one decimal."""
    numbers = np.rad2deg(angles)
    are_round = bool((np.abs(10.0 * numbers - np.round(10.0 * numbers)) < _ROUND).all())
    return _LEAST_RADIANS <= float(np.abs(numbers).max()) <= np.pi and not are_round


def compute_angle_gaps(angles: FloatArray, reference: FloatArray) -> FloatArray:
    """Return the greatest joint-angle difference (...) [rad] between postures (..., 6), up to full turns."""
    gaps = np.moveaxis(wrap_angles(angles - reference), -1, 0)
    # With joints on the first axis, the maximum takes a tenth of the time.
    return np.asarray(np.abs(gaps, order="C").max(axis=0))


def wrap_angles(angle: FloatArray) -> FloatArray:
    """Return angles [rad] reduced by full turns to [−π, π]."""
    return angle - _TURN * np.round(angle / _TURN)


def fit_to_ranges(
    robot: Robot, solutions: FloatArray, ranges: FloatArray, previous: FloatArray | None
) -> tuple[BoolArray, FloatArray]:
    """Add full turns to solutions (b, 6), so that the controller's angles are within ranges and limits.

    Joints are treated from the base on, as a controller's angle depends at most on the angles before it.

    Args:
        robot: six revolute joints.
        solutions: angles of the model [rad]; NaN in rows without a solution.
        ranges: (6, 2) least and greatest controller's angles [rad]; ∓inf where no range is stated.
        previous: (6,) controller's angles of the posture before [rad]; of several angles in range, which
            differ by full turns, the angle nearest to the previous angle is chosen. None for zeros.

    Returns:
        A mask (b,) of solutions with all angles in their ranges, and the controller's angles (b, 6) [rad].
    """
    matrix, offset, limits = robot.joint_map.matrix, robot.joint_map.offset, robot.limits
    controller_angles = np.zeros_like(solutions)
    fits: BoolArray = np.asarray(np.isfinite(solutions).all(axis=1))
    near = np.zeros(len(offset)) if previous is None else previous
    for j in range(len(offset)):
        model_angle = solutions[:, j, None] + _TURNS  # (b, 5), by up to two turns either way
        coupled = (controller_angles[:, :j] @ matrix[j, :j])[:, None]  # due to the joints before
        angle = (model_angle - offset[j] - coupled) / matrix[j, j]
        outside = (model_angle < limits[j, 0] - _TOLERANCE) | (model_angle > limits[j, 1] + _TOLERANCE)
        outside |= (angle < ranges[j, 0] - _TOLERANCE) | (angle > ranges[j, 1] + _TOLERANCE)
        cost = np.where(outside | np.isnan(angle), np.inf, np.abs(angle - near[j]))
        best = np.argmin(cost, axis=1)
        rows = np.arange(len(solutions))
        fits &= np.isfinite(cost[rows, best])
        controller_angles[:, j] = angle[rows, best]
    return fits, controller_angles
