"""Correction of arrays beside bare calls of EAIK, on three arms; wrong frames; rows of another branch.

The calls of EAIK and the corrections alternate in one process. The truth of a branch is the path of joints
from which the poses were made.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from statistics import median
from time import process_time

import numpy as np
from scipy.spatial.transform import Rotation

import jointstiff
from benchmarks.report import Figure, Section
from jointstiff.service.library.robots import prepare_once
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.correct.correct import CorrectedRows, Waypoints, correct
from jointstiff.solver.correct.frames import FrameProposal, FramesError
from jointstiff.solver.correct.prior import build_prior_model
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import flange_poses
from jointstiff.solver.predict.models import ModelError

__all__ = ["run"]

ARMS = ("KUKA KR 210 R2700 extra", "FANUC R-2000iC/210F", "ABB IRB 6700-200/2.60")
POSES = 100_000
ROUNDS = 3
WRONG = 100
PATHS = 60
_FORCE = np.array([100.0, -300.0, -150.0, 0.0, 0.0, 0.0])
_SIX = 6
_ERROR = ModelError(
    postures=24,
    score=np.array([1e-5]),
    share=np.array([0.96]),
    force=1500.0,
    moment=0.0,
    least_load=0.1,
    leverage=1e-5,
)
"""A bound of the model error, which takes its time, too."""


class Arm:
    """A catalogue arm with its prior model, a tool, a base and a start."""

    def __init__(self, name: str) -> None:
        robot = prepare_once(jointstiff.robot(name)).robot
        self.name, self.robot, self.model = name, robot, build_prior_model(robot)
        self.inverse = InverseKinematics(robot)
        self.tool, self.base = np.eye(4), np.eye(4)
        self.tool[:3, 3] = [0.05, 0.0, 0.25]
        self.base[:3, :3] = Rotation.from_rotvec([0.0, 0.0, 0.5]).as_matrix()
        self.base[:3, 3] = [1.0, 0.2, 0.5]
        middle = robot.joint_map.model_angles(np.zeros((1, _SIX)))[0]
        start = np.clip(middle, robot.limits[:, 0] + 0.6, robot.limits[:, 1] - 0.6)
        start[4] += 0.9  # away from the stretched wrist
        self.start = robot.joint_map.controller_angles(start[None])[0]

    def path(self, count: int) -> FloatArray:
        """Return joints (N, 6) of a smooth path [rad]."""
        t = np.linspace(0.0, 1.0, count)
        wave = np.stack([np.sin(3 * t), np.cos(2 * t) - 1, np.sin(2 * t), t, 0.5 * t, -t], axis=1)
        return np.asarray(self.start + 0.25 * wave)

    def waypoints(self, joints: FloatArray, *, has_joints: bool) -> Waypoints:
        """Return the poses of joints, with the joints or with the first posture."""
        flange = flange_poses(self.robot, self.robot.joint_map.model_angles(joints))
        poses = np.linalg.inv(self.base) @ flange @ self.tool
        stated = joints if has_joints else None
        return Waypoints(poses, self.tool, self.base, stated, joints[0])

    def correct(self, waypoints: Waypoints) -> CorrectedRows:
        """Return the corrected rows."""
        loads = np.tile(_FORCE, (len(waypoints), 1))
        return correct(self.model, _ERROR, self.inverse, waypoints, loads)


def run(*, quick: bool) -> list[Section]:
    """Time corrections, refuse wrong frames, and look for rows of another branch."""
    arms = [Arm(name) for name in ARMS]
    count, wrong, paths = (2_000, 12, 6) if quick else (POSES, WRONG, PATHS)
    return [_times(arms, count), _wrong_frames(arms, wrong), _branches(arms, paths)]


def _seconds(work: Callable[[], object]) -> float:
    """Return the processor time of a call [s]."""
    begin = process_time()
    work()
    return process_time() - begin


def _call_eaik(inverse: InverseKinematics, poses: FloatArray) -> None:
    """Call EAIK for each pose, as inverse kinematics do."""
    solve = inverse._solver.calculate_IK
    for pose in poses:
        solve(pose)


def _times(arms: list[Arm], count: int) -> Section:
    rows, ratios = [], []
    for arm in arms:
        for has_joints in (True, False):
            waypoints = arm.waypoints(arm.path(count), has_joints=has_joints)
            call_eaik = partial(_call_eaik, arm.inverse, waypoints.flange_poses)
            share = arm.correct(waypoints).has_numbers.mean()
            bare, whole = [], []
            for _ in range(ROUNDS):
                bare.append(_seconds(call_eaik))
                whole.append(_seconds(partial(arm.correct, waypoints)))
            ratios.append(median(whole) / median(bare))
            given = "poses and joints" if has_joints else "poses"
            cells = (f"{1e6 * median(each) / count:.1f}" for each in (bare, whole))
            rows.append((arm.name, given, *cells, f"{ratios[-1]:.2f}", f"{share:.3f}"))
    return Section(
        title=f"{count:,} poses corrected, beside a bare loop of EAIK's calls",
        columns=("arm", "given", "EAIK [µs a pose]", "correct [µs a pose]", "ratio", "rows with numbers"),
        rows=tuple(rows),
        figures=(Figure("correction of a pose beside EAIK", max(ratios), "at most", 5.0),),
    )


def _random_pose(generator: np.random.Generator, distance: float, angle: float) -> FloatArray:
    """Return a pose 5 to 100 % as far and turned as stated."""
    pose = np.eye(4)
    vectors = generator.normal(size=(2, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    pose[:3, 3] = distance * generator.uniform(0.05, 1.0) * vectors[0]
    pose[:3, :3] = Rotation.from_rotvec(angle * generator.uniform(0.05, 1.0) * vectors[1]).as_matrix()
    return pose


def _is_right(arm: Arm, proposal: FrameProposal) -> bool:
    """Return whether a proposal has the arm's tool and base, or names the unit of the joints."""
    is_same = [
        np.allclose(proposed, own, atol=1e-6)
        for proposed, own in ((proposal.tool, arm.tool), (proposal.base, arm.base))
    ]
    return proposal.cause == "joints" or all(is_same)


def _wrong_frames(arms: list[Arm], count: int) -> Section:
    generator, rows = np.random.default_rng(1), []
    refused = proposed = 0
    kinds = ("tool", "base", "units", "world and flange")
    for kind in kinds:
        found = right = 0
        for number in range(count // len(kinds)):
            arm = arms[number % len(arms)]
            joints = arm.start + generator.uniform(-0.3, 0.3, size=(12, _SIX))
            points = arm.waypoints(joints, has_joints=True)
            tool, base, poses = points.tool, points.base, points.poses
            if kind in {"tool", "world and flange"}:
                tool = tool @ _random_pose(generator, 0.2, 0.3)
            if kind in {"base", "world and flange"}:
                base = _random_pose(generator, 0.5, 0.3) @ base
            if kind == "units":
                joints = joints * (180 / np.pi if number % 2 else np.pi / 180)
            try:
                arm.correct(Waypoints(poses, tool, base, joints))
            except FramesError as error:
                found += 1
                proposal = error.proposal
                right += proposal is not None and _is_right(arm, proposal)
        rows.append((kind, str(count // len(kinds)), str(found), str(right)))
        refused, proposed = refused + found, proposed + right
    total = count // len(kinds) * len(kinds)
    return Section(
        title="Wrong frames and units, 12 poses with joints",
        columns=("wrong", "tried", "refused", "right numbers proposed"),
        rows=tuple(rows),
        figures=(
            Figure("wrong frames and units that are refused", refused / total, "at least", 1.0),
            Figure("of which the right numbers are proposed", proposed / total, "at least", 1.0),
        ),
    )


def _branches(arms: list[Arm], count: int) -> Section:
    generator, rows = np.random.default_rng(2), []
    silent_count = 0
    for arm in arms:
        total = with_numbers = silent = 0
        for _ in range(count // len(arms)):
            size = generator.choice([0.003, 0.02, 0.1])
            steps = generator.normal(size=(_SIX,)) + 0.5 * generator.normal(size=(200, _SIX))
            limits = arm.robot.limits
            angles = arm.robot.joint_map.model_angles(arm.start + np.cumsum(size * steps, axis=0))
            inside = ((angles > limits[:, 0]) & (angles < limits[:, 1])).all(axis=1)
            angles = angles[: int(np.argmin(inside)) if not inside.all() else len(angles)]
            if not len(angles):
                continue
            joints = arm.robot.joint_map.controller_angles(angles)
            points = arm.waypoints(joints, has_joints=False)
            done = arm.correct(points)
            known = np.isfinite(done.wanted[:, 0])
            off = np.abs(done.wanted - joints).max(axis=1) > 1e-4
            total, with_numbers = total + len(known), with_numbers + int(known.sum())
            silent += int((known & off).sum())
        rows.append((arm.name, str(total), str(with_numbers), str(silent)))
        silent_count += silent
    return Section(
        title="Random paths of joints, through singularities, too; poses only",
        columns=("arm", "rows", "rows with numbers", "of another branch"),
        rows=tuple(rows),
        figures=(Figure.none("rows that are silently of another branch", silent_count),),
    )
