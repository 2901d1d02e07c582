# one case a line
"""Compensated programs beside springs that balance a load exactly, in every format."""

import numpy as np
import pytest
from support.programs import (
    FORCE,
    compensated,
    exact_run,
    loaded_poses,
    path,
    request,
    tool_poses,
    work_of,
)

from jointstiff.service.kinds.program_work import ProgramWork, packed, unpacked
from jointstiff.service.kinds.work import pack, unpack
from jointstiff.service.problems import FilesError
from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.programs.formats import read_program
from jointstiff.simulator.programs import PROGRAM_FILES, program_text

KINDS = list(PROGRAM_FILES)
FULL = 13
"""Digits behind a millimetre's point, with which rounding is no matter."""


def commanded_poses(kind, result):
    """Poses of the tool that the corrected file states, and the posture before rounding."""
    file = result.files[0]
    program = read_program([(file.name, unpacked(file))])
    (notation,) = program.targets.notations
    return notation.poses(program.targets.values[:, : 3 + notation.count])


def inverse(poses, near):
    """Angles that bring the tool to poses, by Newton's method on the simulator's kinematics."""
    q = near.copy()
    for _ in range(6):
        here = tool_poses(q)
        step = twist(here, poses)
        columns = [twist(here, tool_poses(q + 1e-6 * unit)) / 1e-6 for unit in np.eye(6)]
        q = q + np.linalg.solve(np.stack(columns, axis=2), step[..., None])[..., 0]
    return q


def twist(from_, to):
    turn = to[:, :3, :3] @ from_[:, :3, :3].transpose(0, 2, 1)
    skew = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1
    )
    return np.concatenate([to[:, :3, 3] - from_[:, :3, 3], skew], axis=1)


@pytest.mark.parametrize("kind", ["krl", "fanuc", "rapid", "ur", "csv"])
def test_the_loaded_tool_is_where_the_program_says(kind):
    joints = path(25)
    goal = tool_poses(joints)
    result = compensated(kind, program_text(kind, goal, FULL))
    reached = loaded_poses(inverse(commanded_poses(kind, result), joints))
    assert np.linalg.norm(reached[:, :3, 3] - goal[:, :3, 3], axis=1).max() < 1e-9
    np.testing.assert_allclose(reached, goal, atol=1e-9)
    assert result.residual.greatest < 1e-9
    assert result.corrected == 25
    mirror = 2.0 * goal[:, :3, 3] - loaded_poses(joints)[:, :3, 3]
    assert np.linalg.norm(mirror - commanded_poses(kind, result)[:, :3, 3], axis=1).max() > 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_the_certificate_knows_the_rounding(kind):
    joints = path(25)
    result = compensated(kind, program_text(kind, tool_poses(joints), 3))
    exact = np.linalg.norm(loaded_poses(joints)[:, :3, 3] - tool_poses(joints)[:, :3, 3], axis=1)
    assert result.deflection.greatest == pytest.approx(exact.max(), rel=1e-4)
    assert 0.0 < result.rounding.greatest <= result.residual.greatest < 3e-6


@pytest.mark.parametrize("kind", KINDS)
def test_no_force_gives_identical_bytes(kind):
    text = program_text(kind, tool_poses(path(20)), 4)
    result = compensated(kind, text, load={"force": (0.0, 0.0, 0.0)})
    assert unpacked(result.files[0]) == text.encode()
    assert result.corrected == 0


def test_joint_targets_are_commanded_exactly():
    joints = path(10)
    rows = ["j1 [rad],j2 [rad],j3 [rad],j4 [rad],j5 [rad],j6 [rad]"]
    rows += [",".join(f"{v:.15f}" for v in row) for row in joints]
    result = compensated("csv", "\n".join(rows) + "\n", bases=[], start=None)
    program = read_program([("path.csv", unpacked(result.files[0]))])
    commanded = program.targets.values[:, :6]
    np.testing.assert_allclose(loaded_poses(commanded), tool_poses(joints), atol=1e-9)


def test_loads_by_lines_and_by_points():
    text = program_text("krl", tool_poses(path(10)), 4)
    segments = [{"first_line": 9, "last_line": 12, "force": FORCE}]
    by_lines = compensated("krl", text, load=None, segments=segments)
    assert by_lines.left_alone == {"no_load": 6}
    assert by_lines.corrected == 4
    before, after = text.encode().split(b"\r\n"), unpacked(by_lines.files[0]).split(b"\r\n")
    assert [i + 1 for i in range(len(before)) if before[i] != after[i]] == [9, 10, 11, 12]
    table = "point,Fx [N],Fy [N],Fz [kN]\n" + "".join(f"{i},300,400,-1.4\n" for i in range(3, 7))
    by_points = compensated_with_table(text, table)
    assert unpacked(by_points.files[0]) == unpacked(by_lines.files[0])


def compensated_with_table(text, table):
    asked = request("krl", text)
    files = [*asked.files, packed("loads.csv", table.encode())]
    changed = asked.model_copy(update={"load": None, "loads": "loads.csv", "files": files})
    robot, run = exact_run()
    return ProgramWork(robot, "robot", run, changed).conclude(())


def test_the_frames_of_the_controller():
    """Base, world, tool and flange in other places give the same correction."""
    joints = path(5)
    goal = tool_poses(joints)
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, -0.2, 0.1]
    plain = compensated("krl", program_text("krl", goal, FULL))
    base = [500.0, -200.0, 100.0, 90.0, 0.0, 0.0]
    moved = program_text("krl", np.linalg.inv(turned) @ goal, FULL)
    for frames in ({"bases": [{"name": "base_data[1]", "values": base}]}, {"world": base}):
        result = compensated("krl", moved, **frames)
        np.testing.assert_allclose(
            turned @ commanded_poses("krl", result), commanded_poses("krl", plain), atol=1e-9
        )
    half = {"tools": [{"values": [0, 0, 115.5, 0, 0, 0]}], "flange": [10.0, -20.0, 100.0, 0, 0, 0]}
    other = compensated("krl", program_text("krl", goal, FULL), **half)
    np.testing.assert_allclose(commanded_poses("krl", other), commanded_poses("krl", plain), atol=1e-9)


def test_steps_give_the_same_program():
    text = program_text("krl", tool_poses(path(30)), 4)
    work = work_of("krl", text, limits={"ramp": 20.0})
    whole = work.conclude(())
    parts = [unpack(pack(work.compute(span))) for span in ((0, 7), (7, 9), (9, 30))]
    assert work.conclude(parts) == whole


def test_one_target_under_two_loads_is_refused():
    frames = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME"
    text = f"DEF a()\n{frames}\nXP1={{X 1803,Y 290,Z 1505,A 18,B 140,C 9}}\nLIN XP1\nLIN XP1\nEND"
    segments = [{"first_line": 5, "last_line": 5, "force": FORCE}]
    with pytest.raises(ProgramError, match="two loads"):
        compensated("krl", text, load=None, segments=segments, tools=[], bases=[])


@pytest.mark.parametrize("rest", ["\n" * 2_000, "," * 20_000])
def test_a_table_of_loads_has_no_more_lines_and_cells_than_points_need(rest):
    table = packed("loads.csv", f"point,Fx [N],Fy [N],Fz [N]\n1,0,0,9\n{rest}".encode())
    asked = request("krl", program_text("krl", tool_poses(path(2)), 4), load=None, loads="loads.csv")
    robot, run = exact_run()
    request_with_table = asked.model_copy(update={"files": [*asked.files, table]})
    with pytest.raises(FilesError, match="more lines or cells"):
        ProgramWork(robot, "robot", run, request_with_table)


@pytest.mark.parametrize("kind", KINDS)
def test_a_corrected_program_carries_its_mark_and_nothing_else_differs(kind):
    text = program_text(kind, tool_poses(path(5)), 4)
    plain = unpacked(compensated(kind, text).files[0])
    marked = unpacked(compensated(kind, text, mark=True).files[0])
    lines, more = plain.splitlines(keepends=True), marked.splitlines(keepends=True)
    added = [line for line in more if line not in lines]
    assert [line for line in more if line not in added] == lines
    assert b"Jointstiff run " in added[0]
    assert b"verdict: use" in b"".join(added)
    assert len(added) == (3 if kind == "fanuc" else 1)
    with pytest.raises(ProgramError, match="corrected already"):
        read_program([(PROGRAM_FILES[kind], marked)])
    still = compensated(kind, text, mark=True, load={"force": (0.0, 0.0, 0.0)})
    assert unpacked(still.files[0]) == text.encode()


def test_the_worst_points_are_those_that_bend_most_and_equal_remarks_are_one():
    text = program_text("krl", tool_poses(path(30)), 4).replace("END\r\n", "PTP HOME\r\nPTP HOME\r\nEND\r\n")
    result = compensated("krl", text)
    deflections = [point.deflection for point in result.worst]
    assert deflections == sorted(deflections, reverse=True)
    assert deflections[0] == result.deflection.greatest
    (home,) = [remark for remark in result.remarks if "HOME" in remark]
    assert home.startswith("lines 37, 38: ")
