"""A SCARA and an arm on a rail, as their users ask: runs, tables, maps, plans, predictions, programs."""

import csv
import io
import re
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.programs import FORCE, TOOL, path, request
from support.slides import arm_on_rail, scara

import jointstiff as js
from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.importing.reading import SourceFile
from jointstiff.service.kinds.plan import readings_sheet
from jointstiff.service.kinds.program_work import ProgramWork, unpacked
from jointstiff.service.kinds.run import RUN
from jointstiff.service.programs.errors import ProgramError
from jointstiff.service.reports.exports import ExportedModel, joints_table
from jointstiff.service.reports.job import job_parts
from jointstiff.service.resources.imports import ImportRefusedError, import_files
from jointstiff.service.tables.files import csv_text
from jointstiff.service.tables.report import View
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.service.tables.table import Table
from jointstiff.simulator import equilibrium, simulate_campaign
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
