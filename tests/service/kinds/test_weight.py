"""Arms that slide and links that weigh something, as users state and fit them."""

import copy
import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.api import post, posted
from support.programs import FORCE, TOOL, flat, path, request
from support.slides import arm_on_rail

import jointstiff as js
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.kinds.correction.files import decompress_file
from jointstiff.service.kinds.correction.programs import ProgramWork
from jointstiff.service.kinds.correction.text import FaultsError
from jointstiff.simulator import TARGETS, default_arm, equilibrium, random_configurations, simulate_campaign
from jointstiff.simulator.own_weight import default_bodies, sag, unloaded_campaign
from jointstiff.simulator.programs import program_text
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.inverse import InverseKinematics

RAIL = 1.25
"""Where the rail stands [m]."""


@lru_cache
def exact_rail():
    """The robot, and a run of exact readings under small loads: its compliances are the springs'."""
    document = simulate_campaign(
        arm_on_rail(), load="pull", force=1500.0, configurations=14, sigma=0.0, noise=False, seed=1
    )
    document["run"] = {"complementary_stiffness": "included"}
    known = Campaign.model_validate(document)
    return prepare_robot(known.robot).robot, js.identify(known, known.run)


# ---- programs


def tool_poses(joints):
    posture = arm_on_rail().posture(joints)
    poses = np.tile(np.eye(4), (len(joints), 1, 1))
    poses[:, :3, :3] = posture.flange_rotation
    poses[:, :3, 3] = posture.point_to_base(np.tile(TOOL, (len(joints), 1)))
    return poses


def on_rail(count):
    arm = path(count)
    return np.column_stack([np.full(len(arm), RAIL), arm])


def off_path(commanded, wanted):
    """How far the tool is off its path [m] if an arm on exact springs, its rail still, is so commanded."""
    commands = np.column_stack([np.full(len(commanded), RAIL), commanded])
    force = np.broadcast_to(FORCE, (len(commands), 3))
    tool = np.tile(TOOL, (len(commands), 1))
    bent = commands + equilibrium(arm_on_rail(), commands, force, np.zeros_like(force), tool)
    off = tool_poses(bent)[:, :3, 3] - tool_poses(wanted)[:, :3, 3]
    return np.linalg.norm(off, axis=1).max()


def start():
    return [1e3 * RAIL, *np.degrees(path(1)[0]).tolist()]


def test_a_program_is_corrected_with_the_rail_standing_still():
    robot, known = exact_rail()
    wanted = on_rail(9)
    text = program_text("krl", tool_poses(wanted), 6)
    work = ProgramWork(robot, "robot", known, request("krl", text, start=start()))
    result = flat(work.conclude(()))
    assert result.corrected == 9
    assert result.deflection.median > 5e-4
    assert result.residual.greatest < 1e-6
    written = decompress_file(result.files[0]).decode("latin-1")
    poses = np.array([pose_of(line) for line in written.splitlines() if line.startswith("LIN")])
    commanded, reached = InverseKinematics(robot, wanted[0]).refine(flange_of(poses), wanted[:, 1:])
    assert reached.all()
    assert off_path(commanded, wanted) < 2e-6
    with pytest.raises(
        (RequestError, FaultsError),
        match="the request does not give the position of the linear axis joint_1",
    ):
        ProgramWork(robot, "robot", known, request("krl", text, start=None)).conclude(())


def pose_of(line):
    """Pose of a KRL frame: Z-Y-X angles."""
    x, y, z, a, b, c = (float(re.search(rf"{key} (-?[0-9.]+)", line)[1]) for key in "XYZABC")
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("ZYX", [a, b, c], degrees=True).as_matrix()
    pose[:3, 3] = np.array([x, y, z]) / 1e3
    return pose


def flange_of(tools):
    poses = tools.copy()
    poses[:, :3, 3] -= np.einsum("bij,j->bi", tools[:, :3, :3], TOOL)
    return poses


def test_joint_targets_are_corrected_by_the_arm_alone():
    robot, known = exact_rail()
    wanted = on_rail(5)
    lines = [
        "PTP {"
        + ",".join(f"A{j} {a:.6f}" for j, a in enumerate(np.degrees(q[1:]), 1))
        + f",E1 {1e3 * RAIL:.3f}}}"
        for q in wanted
    ]
    head = ["&ACCESS RVP", "DEF path()", ";FOLD INI", ";ENDFOLD", "$TOOL=TOOL_DATA[1]", "$BASE=BASE_DATA[1]"]
    text = "\r\n".join([*head, *lines, "END", ""])
    work = ProgramWork(robot, "robot", known, request("krl", text, start=start(), bases=[]))
    result = flat(work.conclude(()))
    assert result.corrected == 5
    assert result.residual.greatest < 1e-6
    written = decompress_file(result.files[0]).decode("latin-1")
    assert written.count(f"E1 {1e3 * RAIL:.3f}") == 5
    moves = [line for line in written.splitlines() if "PTP" in line]
    numbers = [[float(re.search(rf"A{j} (-?[0-9.]+)", line)[1]) for j in range(1, 7)] for line in moves]
    assert off_path(np.radians(numbers), wanted) < 2e-6


ARM = default_arm()
POINTS = np.array(list(TARGETS.values()))
POINT = [-0.06, 0.02, 0.18]


@pytest.fixture(scope="module")
def document():
    return unloaded_campaign(ARM, configurations=30, seed=1)


def still(run_id, joints):
    """A request for the sag of postures (N, 6) [rad] under no load."""
    return {
        "run_id": run_id,
        "units": {"length": "m", "angle": "rad", "force": "N"},
        "load_point": POINT,
        "absolute": True,
        "cases": [{"joints": each, "force": [0.0, 0.0, 0.0]} for each in joints.tolist()],
    }


def true_sag(bodies, joints):
    """How far POINT sags in each posture, by springs that balance the weight exactly [m]."""
    places = np.tile(POINT, (len(joints), 1))
    there, here = (ARM.posture(q).point_to_base(places) for q in (joints + sag(ARM, bodies, joints), joints))
    return there - here


def test_predictions_hold_the_sag_if_asked(client, document):
    run_id = posted(client, document, weight={})["id"]
    q = random_configurations(ARM, 5, seed=8)
    asked = still(run_id, q)
    found = client.post("/v1/deflections", json=asked).json()
    assert any("sag" in remark for remark in found["remarks"])
    truth = true_sag(default_bodies(), q)
    moved = np.array([case["displacement"] for case in found["cases"]])
    assert np.linalg.norm(moved - truth, axis=1).max() < 0.05 * np.linalg.norm(truth, axis=1).max()


def test_sag_of_joints_without_a_number_counts(client):
    masses = default_bodies().masses * [0.4, 1.7, 0.5, 1.6, 0.4, 1.7]
    vague = unloaded_campaign(ARM, replace(default_bodies(), masses=masses), configurations=20, seed=1)
    for body, mass in zip(vague["robot"]["bodies"], default_bodies().masses.tolist(), strict=True):
        body |= {"mass": mass, "mass_uncertainty": 0.9, "centre_uncertainty": 0.2}
    run_id = posted(client, vague, weight={})["id"]
    found = client.get(f"/v1/jobs/{run_id}").json()["result"]["joints"]
    assert {joint["status"] for joint in found[2:]} == {"not_observable"}
    q = random_configurations(ARM, 20, seed=91)
    predicted = post(client, "/v1/deflections", still(run_id, q), 200)["cases"]
    moved = np.array([case["displacement"] for case in predicted])
    interval = np.array([case["readings_only"] for case in predicted])
    truth = true_sag(replace(default_bodies(), masses=masses), q)
    off = np.linalg.norm(moved - truth, axis=1)
    assert np.median(off) < 0.2 * np.median(np.linalg.norm(truth, axis=1))
    assert ((interval[..., 0] <= truth) & (truth <= interval[..., 1])).mean() > 0.9


def test_plans_tell_joints_apart_from_geometry_and_masses(client, document):
    known = copy.deepcopy(document)
    for body in known["robot"]["bodies"]:
        body["mass_uncertainty"] = 0.0
    del known["measurement_set"]["observations"][25:]
    run = posted(client, known, weight={})
    asked = {"measurement_set_id": run["request"]["measurement_set_id"], "readings": 5, "validation": 0.0}
    plan = post(client, "/v1/plans", {**asked, "candidates": 600})["result"]
    assert plan["left_out"] == ["joint_1"]
    assert plan["random_efficiency"] < 0.9
    assert all(reading["force"] == [0.0, 0.0, 0.0] for reading in plan["readings"])
    before = [joint["before"] for joint in plan["joints"]]
    found = [joint["standard_uncertainty"] for joint in run["result"]["joints"][1:]]
    np.testing.assert_allclose(before, found, rtol=0.15)
    promised = [joint["standard_uncertainty"] for joint in plan["joints"]]
    readings = np.array([reading["joints"] for reading in plan["readings"]])
    more = copy.deepcopy(known)
    draws = np.random.default_rng(6)
    places = ARM.posture(readings + sag(ARM, default_bodies(), readings)).targets_to_base(POINTS)
    places += 3e-5 * draws.standard_normal(places.shape)
    for number, (joints, read) in enumerate(zip(readings.tolist(), places.tolist(), strict=True)):
        targets = [{"target": name, "unloaded": place} for name, place in zip(TARGETS, read, strict=True)]
        more["measurement_set"]["observations"].append(
            {"label": f"p{number}", "joints": joints, "force": [0.0, 0.0, 0.0], "readings": targets}
        )
    after = [joint.standard_uncertainty for joint in js.identify(more).result.joints[1:]]
    np.testing.assert_allclose(promised, after, rtol=0.15)


def test_plans_count_the_readings_that_were_taken_only(client, document):
    some = copy.deepcopy(document)
    for body in some["robot"]["bodies"]:
        body["mass_uncertainty"] = 0.0
    for observation in some["measurement_set"]["observations"][8:]:
        del observation["readings"][1:]
    run = posted(client, some, weight={})
    set_id = run["request"]["measurement_set_id"]
    asked = {"measurement_set_id": set_id, "readings": 2, "validation": 0.0, "candidates": 50}
    plan = client.post("/v1/plans", json=asked).json()["result"]
    found = [joint["standard_uncertainty"] for joint in run["result"]["joints"][1:]]
    np.testing.assert_allclose([joint["before"] for joint in plan["joints"]], found, rtol=0.15)
