"""Programs: what the loaded tool misses, bytes that stay, and time beside a bare loop of EAIK.

The truth is the simulator's: springs that balance a load exactly, and programs that it writes by
formulas of its own.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from benchmarks.report import Figure, Section
from jointstiff.service.kinds.correction.files import decompress_file
from jointstiff.service.kinds.correction.programs import (
    Corrections,
    points_sheet,
    write_corrected_program,
)
from jointstiff.service.kinds.work import concatenate_steps
from jointstiff.service.tables.files import csv_text
from jointstiff.simulator import equilibrium
from jointstiff.simulator.programs import PROGRAM_FILES, program_text
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import flange_poses
from jointstiff.solver.mechanics.robot import Robot
from robotprograms import Rewriting, read_program
from tests.support.programs import ARM, TOOL, corrected, exact_run, loaded_poses, path, tool_poses, work_of

__all__ = ["run"]

FORCE = np.array([600.0, 800.0, -1118.0])
"""1500 N."""
FULL_DIGITS = 13


def formats(robot: Robot, count: int) -> Iterator[tuple[str, ...]]:
    """Yield a row a format: parsed beside what was meant, identity, loaded tool off its target, rounding."""
    joints = path(count)
    goal = tool_poses(joints)
    inverse = InverseKinematics(robot)
    to_tool = np.eye(4)
    to_tool[:3, 3] = TOOL
    for kind, name in PROGRAM_FILES.items():
        text = program_text(kind, goal, FULL_DIGITS)
        program = read_program([(name, text.encode())])
        (notation,) = program.targets.notations
        numbers = program.targets.values[:, : 3 + notation.count]
        parsed = np.abs(numbers[:, :3] * notation.length - goal[:, :3, 3]).max()
        if notation.has_pose:
            parsed = max(parsed, np.abs(notation.to_poses(numbers) - goal).max())
        digits = program_text(kind, goal, 3)
        same = corrected(kind, digits, force=[0.0, 0.0, 0.0])
        identical = decompress_file(same.files[0]) == digits.encode()
        result = corrected(kind, text, force=FORCE.tolist())
        short = corrected(kind, digits, force=FORCE.tolist())
        off = "-"
        if notation.has_pose:
            new = read_program([(name, decompress_file(result.files[0]))])
            poses = notation.to_poses(new.targets.values[:, : 3 + notation.count])
            angles, _ = inverse.refine(poses @ np.linalg.inv(to_tool), joints)
            off = (
                f"{np.linalg.norm(loaded_poses(angles, FORCE)[:, :3, 3] - goal[:, :3, 3], axis=1).max():.1e}"
            )
        certificate = result.residual.greatest if result.residual else np.nan
        rounding = short.rounding.greatest if short.rounding else np.nan
        yield (
            kind,
            f"{parsed:.1e}",
            "yes" if identical else "NO",
            off,
            f"{certificate:.1e}",
            f"{1e6 * rounding:.2f}",
        )


def mirror(count: int) -> float:
    """Return how far the mirror x − δ(x) leaves the loaded tool off its target [m]."""
    joints = path(count)
    shape = (count, 3)
    place = np.tile(TOOL, (count, 1))
    deflection = equilibrium(ARM, joints, np.broadcast_to(FORCE, shape), np.zeros(shape), place)
    off = loaded_poses(joints - deflection, FORCE)[:, :3, 3] - tool_poses(joints)[:, :3, 3]
    return float(np.linalg.norm(off, axis=1).max())


def timing(robot: Robot, count: int) -> list[tuple[str, float]]:
    """Return processor seconds of a bare loop of EAIK's calls, and of the parts of a corrected program."""
    poses = flange_poses(robot, robot.joint_map.model_angles(path(count)))
    solver = InverseKinematics(robot)._solver
    text = program_text("csv", tool_poses(path(count)), 4)
    took, begin = [], time.process_time()

    def lap(name: str) -> None:
        nonlocal begin
        now = time.process_time()
        took.append((name, now - begin))
        begin = time.process_time()

    for pose in poses:
        solver.calculate_IK(pose)
    lap("bare loop of EAIK")
    work = work_of("csv", text, force=FORCE.tolist())
    lap("read")
    made = work._path
    lap("postures")
    found = Corrections(**concatenate_steps(map(work.compute, work._spans())))
    lap("correct")
    rewriting = Rewriting(made.program)
    points = write_corrected_program(made, found, work._run_model.model, work._inverse, 2.0, rewriting)
    lap("write and certify")
    csv_text(points_sheet(points.pack_table()))
    lap("table")
    return took


def run(*, quick: bool) -> list[Section]:
    """Formats beside the truth, and time beside EAIK."""
    robot, _ = exact_run()
    return [_formats(robot, 50 if quick else 1000), _times(robot, 2_000 if quick else 100_000)]


def _formats(robot: Robot, count: int) -> Section:
    rows = tuple(formats(robot, count))
    off = max(float(row[3]) for row in rows if row[3] != "-")
    parsed = max(float(row[1]) for row in rows)
    identical = sum(row[2] == "yes" for row in rows)
    return Section(
        title=f"{count} poses a format on exact springs, 1500 N",
        columns=(
            "format",
            "parsed [m, 1]",
            "identity",
            "loaded tool off [m]",
            "certificate [m]",
            "3 digits of mm [µm]",
        ),
        rows=rows,
        figures=(
            Figure("loaded tool off its target, all digits written", off, "at most", 1e-9, "m"),
            Figure("parsed beside what was written", parsed, "at most", 1e-9, "m"),
            Figure("formats whose bytes stay without a load", identical, "at least", len(rows)),
        ),
        notes=(f"the mirror x − δ(x) leaves the loaded tool {1e6 * mirror(count):.1f} µm off",),
    )


def _times(robot: Robot, count: int) -> Section:
    took = timing(robot, count)
    bare = took[0][1]
    whole = sum(seconds for name, seconds in took[1:] if name != "table")
    return Section(
        title=f"{count:,} points beside a bare loop of EAIK's calls",
        columns=("part", "seconds of the processor", "times the loop"),
        rows=tuple((name, f"{seconds:.2f}", f"{seconds / bare:.1f}") for name, seconds in took),
        figures=(
            Figure("reading, postures, corrections, writing, certificate", whole / bare, "at most", 12.0),
        ),
    )
