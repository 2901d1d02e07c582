"""Arms that slide and links that weigh something, as users state and fit them."""

import copy
import csv
import io
import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.api import post, posted
from support.programs import FORCE, TOOL, path, request
from support.slides import arm_on_rail, scara

import jointstiff
import jointstiff as js
from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.measurement import Reading
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Campaign, RunRequest
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.importing.reading import SourceFile
from jointstiff.service.kinds.identification import identification
from jointstiff.service.kinds.plan import readings_sheet
from jointstiff.service.kinds.program_work import ProgramWork, unpacked
from jointstiff.service.kinds.run import RUN
from jointstiff.service.problems import CampaignError
from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.reports.exports import ExportedModel, joints_table
from jointstiff.service.reports.job import job_parts
from jointstiff.service.resources.imports import ImportRefusedError, import_files
from jointstiff.service.resources.inputs import FromFile
from jointstiff.service.tables.files import csv_text
from jointstiff.service.tables.report import View
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.service.tables.table import Table
from jointstiff.simulator import TARGETS, default_arm, equilibrium, random_configurations, simulate_campaign
from jointstiff.simulator.own_weight import default_bodies, sag, unloaded_campaign
from jointstiff.simulator.programs import program_text
from jointstiff.solver.errors import MeasurementError, RequestError, RobotError
from jointstiff.solver.mechanics.configuration import InverseKinematics

MILLIMETRES = {"length": "mm", "angle": "deg", "force": "N"}
RAIL = 1.25
"""Where the rail stands [m]."""


@lru_cache
def campaign(name, units="mm"):
    arm, force = {"SCARA": (scara(), 300.0), "rail": (arm_on_rail(), 1500.0)}[name]
    stated = MILLIMETRES if units == "mm" else {"length": "m", "angle": "rad", "force": "N"}
    document = simulate_campaign(arm, load="pull", force=force, configurations=24, seed=3, units=stated)
    return document | {"run": {}}


@lru_cache
def run(name, units="mm"):
    return js.identify(campaign(name, units))


@lru_cache
def exact_rail():
    """The robot, and a run of exact readings under small loads: its compliances are the springs'."""
    document = simulate_campaign(
        arm_on_rail(), load="pull", force=1500.0, configurations=14, sigma=0.0, noise=False, seed=1
    )
    document["run"] = {"complementary_stiffness": "included"}
    known = Campaign.model_validate(document)
    return prepare_robot(known.robot).robot, js.identify(known, known.run)


def text_of(job, unit="MNm/rad"):
    parts = job_parts(RUN, job, View(True, UNITS[unit]))
    lines = [str(part.shown() if isinstance(part, Table) else part) for part in parts]
    return "\n".join(lines)


@pytest.mark.parametrize("name", ["SCARA", "rail"])
def test_readings_in_mm_and_degrees_are_those_in_si(name):
    in_mm, in_si = (run(name, units).result.joints for units in ("mm", "m"))
    for one, other in zip(in_mm, in_si, strict=True):
        assert one.kind == other.kind
        assert one.compliance == pytest.approx(other.compliance, rel=1e-6)


@pytest.mark.parametrize(("name", "slide", "stiffness"), [("SCARA", 2, 4.0e6), ("rail", 0, 20e6)])
def test_the_slide_is_in_newtons_per_metre_and_shown_in_newtons_per_micron(name, slide, stiffness):
    found = run(name)
    joint = found.result.joints[slide]
    assert joint.kind == "prismatic"
    assert abs(joint.stiffness - stiffness) < 4 * joint.standard_uncertainty * joint.stiffness**2
    assert found.result.joint_kinds[joint.name] == "prismatic"
    for unit, factor, label in (("MNm/rad", 1e-6, "N/µm"), ("kNm/deg", 1e-6, "N/µm"), ("Nm/rad", 1.0, "N/m")):
        value, _, _ = UNITS[unit].cells(joint)
        number, _, shown = value.partition(" ")
        assert shown == label
        assert float(number) == pytest.approx(factor * joint.stiffness, rel=0.05)
        assert label in text_of(found, unit)
    assert UNITS["urad/Nm"].cells(joint)[0].endswith("µm/N")


def test_the_table_of_joints_says_both_units():
    robot = prepare_robot(Campaign.model_validate(campaign("SCARA")).robot).robot
    sheet = joints_table(ExportedModel.of(run("SCARA"), robot, "SCARA"))
    assert sheet.columns["kind"] == ["revolute", "revolute", "prismatic", "revolute"]
    assert "stiffness [N.m/rad, prismatic N/m]" in sheet.columns
    assert "compliance [rad/(N.m), prismatic m/N]" in sheet.columns


def test_a_map_holds_the_rail_still_and_a_scara_has_none():
    near = [RAIL, *path(1)[0]]
    area = [[1.3, RAIL - 0.1, 1.2], [1.5, RAIL + 0.1, 1.4]]
    options = {"area": area, "grid": [2, 2, 2], "place": [0, 0, 0.2], "force": [0, 0, -300]}
    found = js.map(run("rail"), near=near, **options)
    assert found.result.counts.reached == 8
    assert found.result.worst.joints[0] == RAIL
    assert found.result.joint_kinds["joint_1"] == "prismatic"
    with pytest.raises(js.CampaignError, match="where the linear axis joint_1 stands"):
        js.map(run("rail"), **options)
    with pytest.raises(js.CampaignError, match="3 revolute joints"):
        js.map(run("SCARA"), **options)


def test_a_prediction_takes_lengths_from_a_table(tmp_path):
    table = "label,J1 [mm],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg],J7 [deg],Fx [N],Fy [N],Fz [N]\n"
    joints = [RAIL, *path(1)[0]]
    cells = [1e3 * RAIL, *np.degrees(joints[1:])]
    row = ",".join(map(str, ["a", *cells, *FORCE]))
    si = {"length": "m", "angle": "rad", "force": "N"}
    (tmp_path / "cases.csv").write_text(table + row)
    answers = [
        js.predict(run("rail"), cases, load_point=tuple(TOOL), units=si)
        for cases in (tmp_path / "cases.csv", [{"joints": joints, "force": FORCE}])
    ]
    first, second = (answer.cases[0].displacement for answer in answers)
    np.testing.assert_allclose(first, second, rtol=1e-9)
    (tmp_path / "wrong.csv").write_text(table.replace("J1 [mm]", "J1 [deg]") + row)
    with pytest.raises(js.CampaignError, match="the unit deg"):
        js.predict(run("rail"), tmp_path / "wrong.csv", load_point=(0, 0, 0.1), units=si)


def test_a_plan_has_lengths_and_comes_back_as_a_campaign():
    load = {"kind": "any_direction", "force": 1500.0}
    plan = js.plan(campaign("rail"), readings=10, load=load, candidates=300)
    sheet = readings_sheet(plan)
    assert list(sheet.columns)[1:3] == ["joint_1 [mm]", "joint_2 [deg]"]
    first = plan.result.readings[0]
    assert sheet.columns["joint_1 [mm]"][0] == pytest.approx(1e3 * first.joints[0])
    assert sheet.columns["joint_1 [mm]"][0] == round(sheet.columns["joint_1 [mm]"][0])  # in whole mm
    text = filled(csv_text(sheet))
    assert read(text).measurement_set.joint_kinds == ["prismatic", *["revolute"] * 6]
    robot = prepare_robot(Campaign.model_validate(campaign("rail")).robot).robot
    assert read(text, robot).findings is not None
    with pytest.raises(ImportRefusedError, match="joint_1 is read as an angle"):
        read(text.replace("joint_1 [mm]", "joint_1 [deg]"), robot)
    with pytest.raises(ImportRefusedError, match="joint_2 is read as a length"):
        read(text.replace("joint_2 [deg]", "joint_2 [mm]"), robot)
    inches = read(text.replace("[mm]", "[in]")).measurement_set
    assert inches.observations[0].joints[0] == pytest.approx(25.4 * 1e3 * first.joints[0])


def filled(text):
    """The plan with readings of targets that stand where the simulator's arm brings them."""
    arm, rows = arm_on_rail(), list(csv.reader(io.StringIO(text)))
    head = rows[0]
    names = [re.match(r"(\S+) unloaded x", each)[1] for each in head if "unloaded x" in each]
    places = {"P10": (0.147, 0.055, 0.05), "P11": (-0.137, 0.087, 0.085), "P12": (-0.007, -0.14, 0.12)}
    for row in rows[1:]:
        q = np.array(
            [float(row[head.index(f"joint_{j} [{'mm' if j == 1 else 'deg'}]")]) for j in range(1, 8)]
        )
        q = np.where(np.arange(7) == 0, q / 1e3, np.radians(q))
        for name in names:
            at = arm.posture(q).point_to_base(np.array(places[name]))
            for k, axis in enumerate("xyz"):
                row[head.index(f"{name} unloaded {axis} [mm]")] = f"{1e3 * at[k]:.4f}"
                row[head.index(f"{name} loaded {axis} [mm]")] = f"{1e3 * at[k] - 0.1:.4f}"
    out = io.StringIO()
    csv.writer(out).writerows(rows)
    return out.getvalue()


def read(text, robot=None):
    request = ImportRequest(encoders="motor", accept_unusual=True)
    return import_files([SourceFile("plan.csv", text.encode())], request, robot)


def test_kinds_that_are_stated_are_those_of_the_robot():
    document = campaign("SCARA")
    stated = document["measurement_set"] | {"joint_kinds": ["revolute"] * 4}
    with pytest.raises((js.CampaignError, MeasurementError), match="joint_3 is read as an angle"):
        js.identify(document | {"measurement_set": stated})


def test_secondary_encoders_of_a_slide_are_refused():
    document = campaign("SCARA", "m")
    readings = {"encoder_readings": [{"joint": "joint_3", "unloaded": 0.0, "loaded": 1e-5}]}
    observations = [each | readings for each in document["measurement_set"]["observations"]]
    noise = document["measurement_set"]["noise"] | {"encoder_sigma": 1e-6}
    stated = document["measurement_set"] | {"observations": observations, "noise": noise}
    with pytest.raises((js.CampaignError, MeasurementError), match="joint_3, a prismatic joint"):
        js.identify(document | {"measurement_set": stated})


def test_geometry_and_own_weight_refuse_a_slide():
    document = campaign("rail", "m")
    poses = [
        {"joints": each["joints"], "targets": {r["target"]: r["unloaded"] for r in each["readings"]}}
        for each in document["measurement_set"]["observations"]
    ]
    units = {"length": "m", "angle": "rad"}
    with pytest.raises((js.CampaignError, RobotError), match="joint_1 slides"):
        js.geometry({"name": "cell", "robot": document["robot"], "units": units, "poses": poses})
    bodies = [{"name": "arm", "joint": "joint_3", "mass": 200.0, "centre": [0.0, 0.0, 0.5]}]
    heavy = document | {"robot": document["robot"] | {"bodies": bodies}, "run": {"weight": {}}}
    assert "joint_1 slides" in js.identify(heavy).error.detail


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


def test_a_program_is_compensated_with_the_rail_standing_still():
    robot, known = exact_rail()
    wanted = on_rail(9)
    text = program_text("krl", tool_poses(wanted), 6)
    work = ProgramWork(robot, "robot", known, request("krl", text, start=start()))
    result = work.conclude(())
    assert result.corrected == 9
    assert result.deflection.median > 5e-4
    assert result.residual.greatest < 1e-6
    written = unpacked(result.files[0]).decode("latin-1")
    poses = np.array([pose_of(line) for line in written.splitlines() if line.startswith("LIN")])
    commanded, reached = InverseKinematics(robot, wanted[0]).polished(flange_of(poses), wanted[:, 1:])
    assert reached.all()
    assert off_path(commanded, wanted) < 2e-6
    with pytest.raises((RequestError, ProgramError), match="where the linear axis joint_1 stands"):
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


def test_joint_targets_are_compensated_by_the_arm_alone():
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
    result = ProgramWork(robot, "robot", known, request("krl", text, start=start(), bases=[])).conclude(())
    assert result.corrected == 5
    assert result.residual.greatest < 1e-6
    written = unpacked(result.files[0]).decode("latin-1")
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


def identified(document, **options):
    campaign = Campaign.model_validate(document)
    inputs = FromFile()
    set_id = inputs.add_set(campaign.measurement_set, prepare_robot(campaign.robot))
    request = RunRequest(measurement_set_id=set_id, **{**campaign.run.model_dump(), **options})
    return identification(inputs, request).conclude(())


@pytest.fixture(scope="module")
def result(document):
    return identified(document)


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


def intervals(result):
    return np.array([joint.compliance_interval for joint in result.joints[1:]])


def test_a_set_without_loads_gives_the_joints_that_carry_weight(result):
    assert result.assessment.verdict == "use"
    assert result.joints[0].status == "not_observable"
    found = intervals(result)
    assert ((found[:, 0] <= ARM.compliances[1:]) & (ARM.compliances[1:] <= found[:, 1])).all()
    assert result.certificate.complementarity <= 1e-8
    shares = result.weight.joints
    assert shares[0].masses is None
    assert all(each.masses + each.readings == pytest.approx(1.0) for each in shares[1:])
    assert shares[1].masses > shares[3].masses
    assert result.weight.rms_residual < 4e-5 < 2e-4 < result.weight.rms_without_sag
    assert len(result.residuals) == 90
    assert result.compensation > 0.9


def test_predictions_maps_and_programs_hold_the_sag_if_asked(client, document):
    run_id = posted(client, document, weight={})["id"]
    q = random_configurations(ARM, 5, seed=8)
    asked = still(run_id, q)
    found = client.post("/v1/deflections", json=asked).json()
    assert any("sag" in remark for remark in found["remarks"])
    truth = true_sag(default_bodies(), q)
    moved = np.array([case["displacement"] for case in found["cases"]])
    assert np.linalg.norm(moved - truth, axis=1).max() < 0.05 * np.linalg.norm(truth, axis=1).max()
    area = {"area": [[1.4, 0.0, 1.0], [1.8, 0.0, 1.4]], "grid": [3, 1, 3], "place": POINT}
    unloaded = {"run_id": run_id, "force": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, 1.0], **area}
    assert client.post("/v1/maps", json=unloaded).status_code == 422
    mapped = client.post("/v1/maps", json={**unloaded, "absolute": True}).json()["result"]
    assert mapped["worst"]["deflection"] > 1e-3
    low, high = mapped["worst"]["readings_only"]
    assert low < mapped["worst"]["deflection"] < high
    mass = {"joint": "joint_2", "mass": 10.0, "centre": [0.0, 0.0, 0.1]}
    assert client.post("/v1/deflections", json={**asked, "masses": [mass]}).status_code == 422
    set_id = client.get(f"/v1/runs/{run_id}").json()["request"]["measurement_set_id"]
    robot_id = client.get(f"/v1/measurement-sets/{set_id}").json()["robot_id"]
    assert "own weight" in client.get(f"/v1/robots/{robot_id}/trend").json()["left_out"][0]["reason"]
    loaded = posted(client, simulate_campaign(ARM), method="partial_pose")["id"]
    refused = client.post("/v1/deflections", json={**asked, "run_id": loaded})
    assert refused.status_code == 422
    assert "own weight" in refused.text


def test_sag_of_joints_without_a_number_counts(client):
    masses = default_bodies().masses * [0.4, 1.7, 0.5, 1.6, 0.4, 1.7]
    vague = unloaded_campaign(ARM, replace(default_bodies(), masses=masses), configurations=20, seed=1)
    for body, mass in zip(vague["robot"]["bodies"], default_bodies().masses.tolist(), strict=True):
        body |= {"mass": mass, "mass_uncertainty": 0.9, "centre_uncertainty": 0.2}
    run_id = posted(client, vague, weight={})["id"]
    found = client.get(f"/v1/runs/{run_id}").json()["result"]["joints"]
    assert {joint["status"] for joint in found[2:]} == {"not_observable"}
    q = random_configurations(ARM, 20, seed=91)
    predicted = post(client, "/v1/deflections", still(run_id, q), 200)["cases"]
    moved = np.array([case["displacement"] for case in predicted])
    interval = np.array([case["readings_only"]["displacement"] for case in predicted])
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
    after = [joint.standard_uncertainty for joint in identified(more).joints[1:]]
    np.testing.assert_allclose(promised, after, rtol=0.15)


@pytest.mark.parametrize(
    ("other", "said"),
    [({}, "no stiffness of a joint"), ({"work_area": [[1.0, 0.0, 1.0], [2.0, 1.0, 2.0]]}, "no work area")],
)
def test_plans_for_own_weight_need_stiffness_and_no_load(client, document, other, said):
    robot = client.post("/v1/robots", json=document["robot"]).json()
    asked = {"robot_id": robot["id"], "load": {"kind": "own_weight"}, "targets": {"a": [0.1, 0.0, 0.1]}}
    guess = {"stiffness": {"joint_2": 3e6}} if other else {}
    refused = client.post("/v1/plans", json={**asked, **guess, **other})
    assert refused.status_code == 422
    assert said in refused.text


def test_a_run_that_determines_no_joint_is_not_to_be_used(document):
    vague = copy.deepcopy(document)
    for body in vague["robot"]["bodies"]:
        body["mass_uncertainty"] = 0.9999
    result = identified(vague)
    assert {joint.status for joint in result.joints} == {"not_observable"}
    assert result.assessment.verdict == "do_not_use"
    assert [reason.code for reason in result.assessment.reasons] == ["no_joint_identified"]
    assert result.model is None


def test_a_noise_that_the_residuals_refuted_caps_the_verdict(document):
    refuted = copy.deepcopy(document)
    refuted["measurement_set"]["noise"] = {"sigma": 1e-6, "refuted": True}
    assessment = identified(refuted).assessment
    assert assessment.verdict == "use_with_care"
    assert "that they refuted" in assessment.reasons[0].message


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


def test_plans_take_the_gravity_of_the_cell_and_refuse_balancers(client, document):
    robot = client.post("/v1/robots", json=document["robot"]).json()
    wall = {"kind": "own_weight", "gravity": [9.80665, 0.0, 0.0]}
    asked = {"robot_id": robot["id"], "targets": {"a": [0.1, 0.0, 0.1], "b": [0.0, 0.1, 0.1]}}
    guess = {"stiffness": dict.fromkeys(ARM.joint_names, 1e6), "readings": 12, "candidates": 40}
    answer = post(client, "/v1/plans", {**asked, **guess, "load": wall})
    assert "joint_1" not in answer["result"]["left_out"]
    refused = client.post("/v1/plans", json={**asked, **guess, "load": {**wall, "estimate_gravity": True}})
    assert refused.status_code == 422
    assert "no balancers" in refused.text


def test_units_and_frames_change_nothing(document, result):
    other = copy.deepcopy(document)
    measured = other["measurement_set"]
    measured["units"] = {"length": "mm", "angle": "deg", "force": "kN"}
    measured["noise"]["sigma"] *= 1e3
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([1.0, -2.0, 0.5])
    measured["frame"] = {"rotation": turn.tolist(), "translation": (1e3 * shift).tolist()}
    for observation in measured["observations"]:
        observation["joints"] = np.degrees(observation["joints"]).tolist()
        for reading in observation["readings"]:
            place = turn.T @ (np.array(reading["unloaded"]) - shift)
            reading["unloaded"] = (1e3 * place).tolist()
    np.testing.assert_allclose(intervals(identified(other)), intervals(result), rtol=1e-4)


def test_deflections_beside_loaded_positions_leave_these_as_positions():
    both = unloaded_campaign(ARM, configurations=30, seed=1, payload=100.0)
    alone = identified(both)
    measured, points = both["measurement_set"], dict(zip(TARGETS, POINTS.tolist(), strict=True))
    measured["flange_targets"] = points
    first = measured["observations"][0]
    read = first["readings"][0]
    moved = np.subtract(read.pop("loaded"), read.pop("unloaded"))
    measured["observations"].append(
        {**first, "label": "gauge", "readings": [{**read, "deflection": moved.tolist()}]}
    )
    first["readings"] = first["readings"][1:]
    found = identified(both)
    assert found.goodness.chi_square < 1.1 * alone.goodness.chi_square
    assert found.assessment.verdict == "use"


def test_other_work_refuses_a_set_without_loads(document):
    with pytest.raises(RequestError, match="show no deflection"):
        identified(document, weight=None)
    with pytest.raises(CampaignError, match="show no deflection"):
        jointstiff.compare(document)


def test_inertials_of_a_urdf_are_bodies(document):
    stated = copy.deepcopy(document)
    bodies = stated["robot"].pop("bodies")
    urdf = stated["robot"]["model"]["urdf"]
    for number, body in enumerate(bodies, start=1):
        centre = " ".join(map(repr, body["centre"]))
        inertial = f'<inertial><origin xyz="{centre}"/><mass value="{body["mass"]}"/></inertial>'
        urdf = urdf.replace(f'<link name="link_{number}"/>', f'<link name="link_{number}">{inertial}</link>')
    stated["robot"]["model"]["urdf"] = urdf
    prepared = prepare_robot(Campaign.model_validate(stated).robot)
    assert [body.mass for body in prepared.document.bodies] == [body["mass"] for body in bodies]
    assert [body.mass_uncertainty for body in prepared.document.bodies] == [0.2] * 6
    np.testing.assert_allclose([b.centre for b in prepared.robot.bodies], [b["centre"] for b in bodies])
    plain = prepare_robot(Campaign.model_validate(document).robot)
    assert prepared.content_hash == plain.content_hash


@pytest.mark.parametrize(
    ("message", "document", "said"),
    [
        (RunOptions, {"weight": {}, "method": "complete_pose"}, "does not go with"),
        (RunOptions, {"weight": {}, "loss": "huber"}, "does not go with"),
        (RunOptions, {"weight": {}, "elasticity": "joints_and_links"}, "does not go with"),
        (RunOptions, {"weight": {}, "positive": False}, "does not go with"),
        (RunOptions, {"weight": {"gravity": [0.0, 0.0, 0.0]}}, "gravity must be"),
        (RunOptions, {"weight": {"gravity": [0.0, 0.0, -9806.65]}}, "gravity must be"),
        (Reading, {"target": "P10", "loaded": [0.0, 0.0, 0.0]}, "`unloaded` alone"),
    ],
)
def test_what_own_weight_does_not_know_is_refused(message, document, said):
    with pytest.raises(ValueError, match=said):
        message.model_validate(document)
