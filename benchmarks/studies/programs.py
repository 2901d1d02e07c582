"""Programs: what the loaded tool misses, bytes that stay, and time beside a bare loop of EAIK.

The truth is the simulator's: springs that balance a load exactly, and programs that it writes by
formulas of its own.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

import jointstiff
from benchmarks.report import Figure, Section
from jointstiff.schemas.program import ProgramRequest
from jointstiff.schemas.run import Campaign, Run
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.kinds.program_work import (
    Corrections,
    ProgramWork,
    packed,
    points_sheet,
    rewritten,
    unpacked,
)
from jointstiff.service.kinds.work import joined
from jointstiff.service.problems.table import problem_of
from jointstiff.service.programs.formats import read_program
from jointstiff.service.tables.files import csv_text
from jointstiff.simulator import default_arm, equilibrium, simulate_campaign
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign, elastic_deflections
from jointstiff.simulator.programs import PROGRAM_FILES, program_text
from jointstiff.solver.errors import JointstiffError
from jointstiff.solver.predict.answers import forward_model
from jointstiff.solver.predict.forward import CorrectionLimits, LoadCases, compensate
from jointstiff.solver.robot.inverse import InverseKinematics, flange_poses
from jointstiff.solver.robot.model import Robot

__all__ = ["run"]

Array = npt.NDArray[np.float64]

ARM = default_arm()
START = np.radians([10.0, -5.0, 10.0, 5.0, 45.0, 3.0])
TOOL = np.array([0.01, -0.02, 0.2155])
FORCE = np.array([600.0, 800.0, -1118.0])
"""1500 N."""
FULL_DIGITS = 13
KUKA_TOOL = [10.0, -20.0, 215.5, 0.0, 0.0, 0.0]
_QUATERNION = [1.0, 0.0, 0.0, 0.0]
FRAMES: dict[str, tuple[list[float], list[float] | None]] = {
    "rapid": ([*KUKA_TOOL[:3], *_QUATERNION], [0.0, 0.0, 0.0, *_QUATERNION]),
    "ur": ([0.01, -0.02, 0.2155, 0, 0, 0], None),
}
MOST_BYTES = 8_000
KIND_OF = {
    "a.src": "krl",
    "a.LS": "fanuc",
    "a.mod": "rapid",
    "a.script": "ur",
    "a.csv": "csv",
}


def exact_run() -> tuple[Robot, Run]:
    """Identify exact readings of the arm."""
    document = simulate_campaign(ARM, load="pull", configurations=12, sigma=0.0, noise=False, seed=1)
    document["run"] = {"method": "partial_pose", "complementary_stiffness": "included"}
    campaign = Campaign.model_validate_json(json.dumps(document))
    return prepare_robot(campaign.robot).robot, jointstiff.identify(campaign, campaign.run)


def path(count: int) -> Array:
    t = np.linspace(0.0, 1.0, count)
    wave = np.stack([np.sin(3 * t), np.cos(2 * t) - 1, np.sin(2 * t), t, 0.5 * t, -t], axis=1)
    return np.asarray(START + 0.3 * wave)


def tool_poses(joints: Array) -> Array:
    posture = ARM.posture(joints)
    poses = np.tile(np.eye(4), (len(joints), 1, 1))
    poses[:, :3, :3] = posture.flange_rotation
    poses[:, :3, 3] = posture.point_to_base(np.tile(TOOL, (len(joints), 1)))
    return poses


def loaded_poses(joints: Array) -> Array:
    shape = (len(joints), 3)
    place = np.tile(TOOL, (len(joints), 1))
    return tool_poses(
        joints + equilibrium(ARM, joints, np.broadcast_to(FORCE, shape), np.zeros(shape), place)
    )


def work_of(robot: Robot, run: Run, kind: str, text: str, force: Array = FORCE) -> ProgramWork:
    tool, base = FRAMES.get(kind, (KUKA_TOOL, [0.0] * 6))
    request = {
        "run_id": "r",
        "files": [packed(PROGRAM_FILES[kind], text.encode("latin-1"))],
        "units": {"length": "mm", "angle": "deg", "force": "N"},
        "accuracy_option": "off",
        "mark": False,
        "load": {"force": force.tolist()},
        "tools": [{"values": tool}],
        "bases": [{"values": base}] if base else [],
        "start": np.degrees(START).tolist(),
    }
    return ProgramWork(robot, "robot", run, ProgramRequest.model_validate(request))


def formats(robot: Robot, run: Run, count: int) -> Iterator[tuple[str, ...]]:
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
            parsed = max(parsed, np.abs(notation.poses(numbers) - goal).max())
        digits = program_text(kind, goal, 3)
        same = work_of(robot, run, kind, digits, np.zeros(3)).conclude(())
        identical = unpacked(same.files[0]) == digits.encode()
        result = work_of(robot, run, kind, text).conclude(())
        short = work_of(robot, run, kind, digits).conclude(())
        off = "-"
        if notation.has_pose:
            new = read_program([(name, unpacked(result.files[0]))])
            poses = notation.poses(new.targets.values[:, : 3 + notation.count])
            angles, _ = inverse.polished(poses @ np.linalg.inv(to_tool), joints)
            off = f"{np.linalg.norm(loaded_poses(angles)[:, :3, 3] - goal[:, :3, 3], axis=1).max():.1e}"
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
    off = loaded_poses(joints - deflection)[:, :3, 3] - tool_poses(joints)[:, :3, 3]
    return float(np.linalg.norm(off, axis=1).max())


def timing(robot: Robot, run: Run, count: int) -> list[tuple[str, float]]:
    """Return seconds of a bare loop of EAIK's calls, and of the parts of a compensated program."""
    poses = flange_poses(robot, robot.joint_map.model_angles(path(count)))
    solver = InverseKinematics(robot)._solver
    text = program_text("csv", tool_poses(path(count)), 4)
    took, begin = [], time.perf_counter()

    def lap(name: str) -> None:
        nonlocal begin
        now = time.perf_counter()
        took.append((name, now - begin))
        begin = time.perf_counter()

    for pose in poses:
        solver.calculate_IK(pose)
    lap("bare loop of EAIK")
    work = work_of(robot, run, "csv", text)
    lap("read")
    made = work._path
    lap("postures")
    found = Corrections(**joined(map(work.compute, work._spans())))
    lap("compensate")
    _, points = rewritten(made, found, work._used.model, work._inverse, 2.0)
    lap("write and certify")
    csv_text(points_sheet(points.table()))
    lap("table")
    return took


def hostile() -> Iterator[tuple[str, str, bytes]]:
    """Yield programs that try to harm: name, file, content."""
    big = 10 * 1024 * 1024
    point = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
    bodies = {
        "empty": b"",
        "10 MB of one letter": b"A" * big,
        "10 MB of braces": b"{" * big,
        "10 MB of line ends": b"\n" * big,
        "NUL": b"LIN \0",
        "UTF-16": "LIN {X 1}".encode("utf-16"),
        "all bytes": bytes(range(1, 256)) * 400,
        "deep folds": b";FOLD x\n" * 100_000,
        "deep braces": b"LIN " + b"{A " * 1000 + b"\n",
        "deep loops": b"LOOP\n" * 50_000 + f"LIN {point}\n".encode(),
        "NaN": b"LIN {X NaN,Y 2,Z 3,A 0,B 0,C 0}",
        "huge number": b"LIN {X 1e999,Y 2,Z 3,A 0,B 0,C 0}",
        "long number": b"LIN {X " + b"1" * 3000 + b",Y 2,Z 3,A 0,B 0,C 0}",
        "unclosed": b"LIN {X 1,Y 2,Z 3,A 0,B 0,C 0\n" * 5000,
        "relative": b"LIN_REL {X 1}\n" * 50_000,
        "variables": b"LIN P1\n" * 50_000,
    }
    for label, body in bodies.items():
        yield f"krl, {label}", "a.src", body
    for name in ("a.LS", "a.mod", "a.script", "a.csv"):
        yield f"{name}, 5 MB of brackets", name, b"[" * (big // 2)
        yield f"{name}, all bytes", name, bytes(range(1, 256)) * 400
        yield f"{name}, quotes", name, b'"' * 4000 + b"\n" + b"[1,2,'" * 600
        yield f"{name}, spaces", name, (b" " * 4000 + b"\n") * 1000
        yield f"{name}, KRL", name, f"LIN {point}\n".encode() * 20_000


def run(*, quick: bool) -> list[Section]:
    """Formats beside the truth, time beside EAIK, and hostile programs."""
    robot, found = exact_run()
    return [
        _formats(robot, found, 50 if quick else 1000),
        _beams(20 if quick else 300),
        _times(robot, found, 2_000 if quick else 100_000),
        _hostile(robot, found),
    ]


def _formats(robot: Robot, run: Run, count: int) -> Section:
    rows = tuple(formats(robot, run, count))
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


def _beams(count: int) -> Section:
    """Compensate by fitted elastic links in postures that were not fitted, and bend exact beams there."""
    document = elastic_campaign(beam_arm(ARM), configurations=40, sigma=2e-5, seed=3)
    document["run"] = {
        "method": "partial_pose",
        "elasticity": "joints_and_links",
        "link_penalty": 1e-4,
    }
    campaign = Campaign.model_validate_json(json.dumps(document))
    robot = prepare_robot(campaign.robot).robot
    stored = jointstiff.identify(campaign, campaign.run).result
    if stored is None or stored.model is None or stored.model.elastic is None:
        raise RuntimeError("no elastic model")
    links, _ = forward_model(robot, stored.model)
    generator = np.random.default_rng(7)
    low, high = ARM.limits.T
    joints = 0.5 * (low + high) + 0.25 * (high - low) * generator.uniform(-1, 1, (count, 6))
    direction = generator.standard_normal((count, 3))
    force = 1500.0 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    place = np.tile(TOOL, (count, 1))
    wanted = LoadCases(joints, force, np.zeros_like(force), place, place.copy())
    found = compensate(links, wanted, CorrectionLimits(1.0, 1.0))
    goal, loaded = (
        each[:, 0] for each in elastic_deflections(beam_arm(ARM), joints, force, place, TOOL[None])
    )
    reached = elastic_deflections(beam_arm(ARM), found.commanded, force, place, TOOL[None])[1][:, 0]
    size = np.linalg.norm(loaded - goal, axis=1).mean()
    left = np.linalg.norm(reached - goal, axis=1).mean()
    unpredicted = np.linalg.norm(loaded - goal - found.uncorrected[:, :3], axis=1).mean()
    predicted, compensated = 1.0 - unpredicted / size, 1.0 - left / size
    certificate = np.abs(found.residual[:, :3]).max()
    return Section(
        title=f"{count} postures of exact beams that were not fitted, 1500 N",
        columns=("deflection [mm]", "predicted [%]", "compensated [%]", "left [µm]", "certificate [m]"),
        rows=(
            (
                f"{1e3 * size:.2f}",
                f"{100 * predicted:.2f}",
                f"{100 * compensated:.2f}",
                f"{1e6 * left:.0f}",
                f"{certificate:.0e}",
            ),
        ),
        figures=(
            Figure(
                "compensated beside predicted, of the deflection", compensated / predicted, "at least", 0.999
            ),
        ),
    )


def _times(robot: Robot, run: Run, count: int) -> Section:
    took = timing(robot, run, count)
    bare = took[0][1]
    whole = sum(seconds for name, seconds in took[1:] if name != "table")
    return Section(
        title=f"{count:,} points beside a bare loop of EAIK's calls",
        columns=("part", "seconds", "times the loop"),
        rows=tuple((name, f"{seconds:.2f}", f"{seconds / bare:.1f}") for name, seconds in took),
        figures=(
            Figure("reading, postures, corrections, writing, certificate", whole / bare, "at most", 8.0),
        ),
    )


def _hostile(robot: Robot, run: Run) -> Section:
    rows, largest = [], 0
    for label, name, content in hostile():
        begin, size = time.perf_counter(), 0
        try:
            work_of(robot, run, KIND_OF[name], content.decode("latin-1")).conclude(())
            end = "taken"
        except JointstiffError as error:
            size = max(len(problem_of(error).model_dump_json().encode()), len(str(error).encode()))
            end = "refused"
        largest = max(largest, size)
        rows.append((label, end, f"{size:,}", f"{time.perf_counter() - begin:.2f}"))
    return Section(
        title=f"{len(rows)} hostile programs",
        columns=("program", "end", "answer [bytes]", "seconds"),
        rows=tuple(rows),
        figures=(Figure("largest answer", largest, "at most", MOST_BYTES, "bytes"),),
    )
