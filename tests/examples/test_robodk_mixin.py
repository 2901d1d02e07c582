"""The mixin of RoboDK's posts: zero force the same text; with force the loaded tool is on its targets."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.clients import JointPost, LinePost, Mat, load_client
from support.programs import TOOL, exact_run, loaded_poses, path, tool_poses

from jointstiff.schemas.correction import CorrectionRequest
from jointstiff.service.runs.correction.answer import correct_request

MIXIN = load_client("robodk_mixin")
FORCE = (100.0, 200.0, -900.0)
FRAME = np.eye(4)
FRAME[:3, :3] = Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()
FRAME[:3, 3] = [900.0, 200.0, 300.0]
TOOL_POSE = np.eye(4)
TOOL_POSE[:3, 3] = 1e3 * TOOL
POSTS = [LinePost, JointPost]


class Service:
    """The service's answers in this process, and the requests that it got."""

    def __init__(self):
        self.requests = []

    def __call__(self, body):
        self.requests.append(body)
        robot, run = exact_run()
        request = CorrectionRequest.model_validate(body)
        return correct_request(robot, run, request).model_dump(mode="json")


def targets(joints):
    """Targets in the frame [mm], as RoboDK passes them."""
    poses = tool_poses(joints)
    poses[:, :3, 3] *= 1e3
    return [Mat((np.linalg.inv(FRAME) @ pose).tolist()) for pose in poses]


def drive(post, joints, *, is_marked=True):
    """Drive a post as RoboDK does: frames, a joint move, a cut with lines and an arc, and the way back."""
    poses, angles = targets(joints), np.degrees(joints).tolist()
    post.ProgStart("cut")
    post.setFrame(Mat(FRAME.tolist()), 1, "part")
    post.setTool(Mat(TOOL_POSE.tolist()), 1, "spindle")
    post.setSpeed(50.0)
    post.MoveJ(poses[0], angles[0])
    post.MoveL(poses[0], angles[0])
    if is_marked:
        post.RunCode("CUT_ON", True)
    for pose, each in zip(poses[1:-2], angles[1:-2], strict=True):
        post.MoveL(pose, each)
    post.MoveC(poses[-2], angles[-2], poses[-1], angles[-1])
    if is_marked:
        post.RunCode("CUT_OFF", True)
    post.MoveL(poses[0], angles[0])
    post.MoveL(None, angles[0])
    post.ProgFinish("cut")
    return post.lines


def corrected(post, service, force=FORCE, **options):
    return MIXIN.corrected(post, transport=service, run_id="r", force=force, **options)()


@pytest.mark.parametrize("post", POSTS)
def test_without_a_force_the_program_is_the_same_and_nothing_is_sent(post):
    service = Service()
    assert drive(corrected(post, service, (0.0, 0.0, 0.0)), path(12)) == drive(post(), path(12))
    assert service.requests == []


@pytest.mark.parametrize("post", POSTS)
@pytest.mark.parametrize("is_marked", [True, False])
def test_with_a_force_only_numbers_of_the_cut_change(post, is_marked):
    service = Service()
    lines = drive(corrected(post, service), path(12), is_marked=is_marked)
    plain = drive(post(), path(12), is_marked=is_marked)
    assert len(service.requests) == 1  # all targets at once
    mark, lines = lines[1], lines[:1] + lines[2:]
    assert mark.startswith("; Jointstiff: ")
    without_numbers = [[re.sub(r"-?\d+\.\d+", "#", line) for line in each] for each in (lines, plain)]
    assert without_numbers[0] == without_numbers[1]
    changed = [number for number, (a, b) in enumerate(zip(lines, plain, strict=True)) if a != b]
    first = next(i for i, line in enumerate(lines) if line.startswith(("LIN", "MoveJ")))
    begin = first + 2 if is_marked else first
    assert changed[0] == begin
    assert len(changed) == (10 if is_marked else 12)


@pytest.mark.parametrize("axes", ["robot", "base", "tool"])
def test_the_loaded_tool_is_on_its_targets_within_the_digits_of_the_post(axes):
    joints = path(12)
    lines = drive(corrected(JointPost, Service(), axes=axes), joints)
    written = [line for line in lines if line.startswith("MoveJ [")][1:-2]  # of the cut's lines
    commanded = np.radians([[float(each) for each in line[7:-1].split(", ")] for line in written])
    wanted = tool_poses(joints[1:-2])
    turn = {"robot": np.eye(3), "base": FRAME[:3, :3], "tool": wanted[:, :3, :3]}[axes]
    force = np.einsum("...ij,j->...i", turn, FORCE)
    reached = loaded_poses(commanded, force)
    assert np.linalg.norm((reached - wanted)[:, :3, 3], axis=1).max() < 1e-7
    assert np.linalg.norm((loaded_poses(joints[1:-2], force) - wanted)[:, :3, 3], axis=1).min() > 1e-4


def test_external_axes_stay_behind_the_corrected_joints():
    post = corrected(JointPost, Service())
    joints = path(4)
    poses, angles = targets(joints), [[*each, 1250.0] for each in np.degrees(joints).tolist()]
    post.ProgStart("rail")
    post.setFrame(Mat(FRAME.tolist()))
    post.setTool(Mat(TOOL_POSE.tolist()))
    for pose, each in zip(poses, angles, strict=True):
        post.MoveL(pose, each)
    post.ProgFinish("rail")
    moves = [line for line in post.lines if line.startswith("MoveJ")]
    assert all(line.endswith("1250.000000]") for line in moves)


def test_a_wrong_tool_ends_with_the_words_of_the_service():
    post = corrected(LinePost, Service())
    joints = path(6)
    post.ProgStart("cut")
    post.setFrame(Mat(FRAME.tolist()))
    post.setTool(Mat(np.eye(4).tolist()))
    for pose, each in zip(targets(joints), np.degrees(joints).tolist(), strict=True):
        post.MoveL(pose, each)
    with pytest.raises(Exception, match=r"poses and joints differ .* agree with `tool` 10, -20, 215.5 mm"):
        post.ProgFinish("cut")


def test_a_target_that_cannot_be_corrected_is_refused_unless_it_may_be_left():
    joints = path(8)
    poses, angles = targets(joints), np.degrees(joints).tolist()
    angles[3][0] += 5.0

    def run(**options):
        post = corrected(LinePost, Service(), **options)
        post.ProgStart("cut")
        post.setFrame(Mat(FRAME.tolist()))
        post.setTool(Mat(TOOL_POSE.tolist()))
        for pose, each in zip(poses, angles, strict=True):
            post.MoveL(pose, each)
        post.ProgFinish("cut")
        return post.lines

    with pytest.raises(MIXIN.CorrectionError, match=r"1 targets contradictory, 7 targets corrected; state"):
        run()
    assert run(leave_others=True)[1].startswith("; Jointstiff: 1 targets contradictory")
