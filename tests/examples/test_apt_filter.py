"""The filter of APT files: corrected points, other lines as they are, and what is refused."""

import numpy as np
import pytest
from support.clients import load_client
from support.programs import START, TOOL, exact_run, loaded_poses, path, tool_poses

from jointstiff.solver.mechanics.inverse import InverseKinematics

FILTER = load_client("apt_filter")
FORCE = (0.0, 200.0, -900.0)


def apt(poses, digits=6):
    """An APT file of poses [m], with a rapid move, a feed and a comment."""
    lines = ["PARTNO/TEST", "$$ a comment", "UNITS/MM", "RAPID", "FEDRAT/1000.0,MMPM"]
    for pose in poses:
        numbers = [f"{1e3 * each:.{digits}f}" for each in pose[:3, 3]]
        numbers += [f"{-each:.9f}" for each in pose[:3, 2]]
        lines.append(f"GOTO/{','.join(numbers[:3])},$")
        lines.append("  " + ",".join(numbers[3:]))
    return "\n".join([*lines, "SPINDL/OFF", "FINI"]) + "\n"


def poses_of_rule(poses):
    """The poses with the same points and axes, turned so that x is near x of R0."""
    turned = poses.copy()
    z = poses[:, :3, 2]
    x = np.array([1.0, 0.0, 0.0]) - z * z[:, :1]
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    turned[:, :3, 0], turned[:, :3, 1] = x, np.cross(z, x)
    return turned


def corrector():
    _, run = exact_run()
    tool = np.eye(4)
    tool[:3, 3] = 1e3 * TOOL
    return lambda poses, forces: run.correct(poses, forces=forces, tool=tool, start=np.degrees(START))


def test_the_loaded_tool_is_on_the_points_and_other_lines_stay():
    robot, _ = exact_run()
    wanted = poses_of_rule(tool_poses(path(10)))
    text = apt(wanted)
    written = FILTER.correct_apt(text, corrector(), FORCE)
    kept = [line for line in text.splitlines() if not line.startswith(("GOTO", "  "))]
    assert [line for line in written.splitlines() if not line.startswith(("GOTO", "  "))] == kept
    points = FILTER.read_points(written)
    poses = FILTER.make_poses(points, (1.0, 0.0, 0.0))
    poses[:, :3, 3] *= 1e-3
    tool = np.eye(4)
    tool[:3, 3] = TOOL
    near = path(10)
    angles, reached = InverseKinematics(robot).follow_branches(poses @ np.linalg.inv(tool), near)
    assert reached.all()
    loaded = loaded_poses(angles[1:], FORCE)  # the first point is reached by RAPID, without load
    off = np.linalg.norm((loaded - wanted[1:])[:, :3, 3], axis=1)
    # The rule states the turn again for the corrected axis, so that a milliradian of it is lost.
    assert off.max() < 2e-6
    assert (poses[0, :3, 3] == pytest.approx(wanted[0, :3, 3], abs=1e-8)) is True


def test_inches_and_systems_of_coordinates_come_back_as_they_were():
    wanted = poses_of_rule(tool_poses(path(4)))
    text = apt(wanted)
    in_mm = FILTER.correct_apt(text, corrector(), FORCE)
    shifted = wanted.copy()
    shifted[:, :3, 3] -= [1.0, 0.5, 0.2]
    shifted[:, :3, 3] /= 25.4
    system = "MSYS/39.370078740157,19.685039370079,7.874015748031,1,0,0,0,1,0"
    inches = apt(shifted, 9).replace("UNITS/MM", f"UNITS/INCHES\n{system}")
    points = [FILTER.read_points(each) for each in (in_mm, FILTER.correct_apt(inches, corrector(), FORCE))]
    places = [np.array([point.place for point in each]) for each in points]
    np.testing.assert_allclose(places[0], places[1], atol=5e-3)


@pytest.mark.parametrize(
    "line", ["CIRCLE/0,0,0,10", "CYCLE/DRILL,5", "CUTCOM/LEFT", "TRACUT/1,0,0", "GODLTA/0,0,5"]
)
def test_a_line_that_is_not_followed_is_refused_with_its_number(line):
    text = apt(poses_of_rule(tool_poses(path(3)))).replace("SPINDL/OFF", line)
    with pytest.raises(ValueError, match=rf"line 12: {line.split('/')[0]} is not followed"):
        FILTER.correct_apt(text, corrector(), FORCE)


def test_a_point_out_of_reach_is_refused_with_its_line():
    poses = poses_of_rule(tool_poses(path(3)))
    poses[2, :3, 3] += 5.0
    with pytest.raises(ValueError, match="line 10: the point is not reached"):
        FILTER.correct_apt(apt(poses), corrector(), FORCE)
