"""Programs over the simulated arm: paths, the exact run, and what is made of them."""

import json
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

import jointstiff
from jointstiff.schemas.correction import CorrectionRequest, CorrectionResult
from jointstiff.schemas.run import Campaign, Run
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.kinds.correction.files import compress_file
from jointstiff.service.kinds.correction.programs import ProgramWork
from jointstiff.simulator import default_arm, equilibrium, simulate_campaign
from jointstiff.simulator.programs import PROGRAM_FILES
from jointstiff.solver.mechanics.robot import Robot

ARM = default_arm()
START = np.radians([10.0, -5.0, 10.0, 5.0, 45.0, 3.0])
TOOL = np.array([0.01, -0.02, 0.2155])
FORCE = (300.0, 400.0, -1400.0)
KUKA_TOOL = [10.0, -20.0, 215.5, 0.0, 0.0, 0.0]
FRAMES = {
    "krl": (KUKA_TOOL, [0.0] * 6),
    "fanuc": (KUKA_TOOL, [0.0] * 6),
    "csv": (KUKA_TOOL, [0.0] * 6),
    "rapid": ([10.0, -20.0, 215.5, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
    "ur": ([0.01, -0.02, 0.2155, 0.0, 0.0, 0.0], None),
}


@lru_cache
def exact_run() -> tuple[Robot, Run]:
    """The robot and a run of exact readings: its compliances are those of the arm, but for rounding."""
    document = simulate_campaign(ARM, load="pull", configurations=12, sigma=0.0, noise=False, seed=1)
    document["run"] = {"method": "partial_pose", "complementary_stiffness": "included"}
    campaign = Campaign.model_validate_json(json.dumps(document))
    return prepare_robot(campaign.robot).robot, jointstiff.identify(campaign, campaign.run)


def path(count: int) -> np.ndarray:
    """Angles (count, 6) [rad] of a smooth path."""
    t = np.linspace(0.0, 1.0, count)
    wave = np.stack([np.sin(3 * t), np.cos(2 * t) - 1, np.sin(2 * t), t, 0.5 * t, -t], axis=1)
    return START + 0.3 * wave


def tool_poses(joints: np.ndarray) -> np.ndarray:
    """Poses (m, 4, 4) of the tool's centre [m], axes of the flange, by the simulator's kinematics."""
    posture = ARM.posture(joints)
    poses = np.tile(np.eye(4), (len(joints), 1, 1))
    poses[:, :3, :3] = posture.flange_rotation
    poses[:, :3, 3] = posture.point_to_base(np.tile(TOOL, (len(joints), 1)))
    return poses


def loaded_poses(joints: np.ndarray, force: Any = FORCE) -> np.ndarray:
    """The same once exact springs balance a force at the tool's centre."""
    shape = (len(joints), 3)
    deflection = equilibrium(
        ARM, joints, np.broadcast_to(force, shape), np.zeros(shape), np.tile(TOOL, (len(joints), 1))
    )
    return tool_poses(joints + deflection)


def options(kind: str, **changes: Any) -> dict[str, Any]:
    """Options of a program of one of the simulator's files."""
    tool, base = FRAMES[kind]
    return {
        "units": {"length": "mm", "angle": "deg", "force": "N"},
        "accuracy_option": "off",
        "mark": False,
        "force": FORCE,
        "tools": [{"values": tool}],
        "bases": [{"values": base}] if base else [],
        "start": np.degrees(START).tolist(),
    } | changes


def small_program_options() -> dict[str, Any]:
    """Options of a KRL program in R0 under 500 N, which is marked."""
    return options("krl", force=[0.0, 0.0, -500.0], mark=True)


def request(kind: str, text: str | bytes, name: str | None = None, **changes: Any) -> CorrectionRequest:
    """The request of a program."""
    content = text.encode("latin-1") if isinstance(text, str) else text
    file = compress_file(name or PROGRAM_FILES[kind], content)
    return CorrectionRequest.model_validate({"run_id": "r", "files": [file], **options(kind, **changes)})


def work_of(kind: str, text: str | bytes, name: str | None = None, **changes: Any) -> ProgramWork:
    """The work of a program on the exact run."""
    robot, run = exact_run()
    return ProgramWork(robot, "robot", run, request(kind, text, name, **changes))


def corrected(kind: str, text: str | bytes, name: str | None = None, **changes: Any) -> Any:
    """The result of a program, carried out at once."""
    return flat(work_of(kind, text, name, **changes).conclude(()))


def flat(result: CorrectionResult) -> Any:
    """The fields of a result and those of its program, in one object."""
    return SimpleNamespace(**dict(result) | dict(result.program or ()))


def corrected_with_table(text: str, table: str) -> Any:
    """The result of a program of KUKA under the loads of a table."""
    asked = request("krl", text)
    files = [*asked.files, compress_file("loads.csv", table.encode())]
    changed = asked.model_copy(update={"force": None, "loads": "loads.csv", "files": files})
    robot, run = exact_run()
    return flat(ProgramWork(robot, "robot", run, changed).conclude(()))
