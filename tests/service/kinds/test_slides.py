"""Arms that slide: lengths in their units, springs in N/µm, and what is known of revolute joints alone."""

import csv
import io
import json

import numpy as np
import pytest
from support.documents import changed
from support.importing_samples import sources_of
from support.programs import FORCE, path
from support.refusals import refused
from support.slides import arm_on_rail, scara
from support.terminal import terminal

import jointstiff as js
from jointstiff.schemas.imports import ImportRequest, Mapping
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.imports.answer import import_files
from jointstiff.service.kinds.plan.kind import readings_sheet
from jointstiff.service.tables.files import csv_text
from jointstiff.simulator import TARGETS, simulate_campaign
from jointstiff.solver.mechanics.robot import KnownRobot

MILLIMETRES, SI = (
    {"length": "mm", "angle": "deg", "force": "N"},
    {"length": "m", "angle": "rad", "force": "N"},
)
ARMS = {"scara": (scara, 300.0), "rail": (arm_on_rail, 1500.0)}
RAIL = 1.25
"""Where the arm stands on its rail [m]."""
NEAR = [RAIL, *path(1)[0].tolist()]
AREA = {
    "area": [[1.3, RAIL - 0.1, 1.2], [1.5, RAIL + 0.1, 1.4]],
    "grid": [2, 2, 2],
    "place": [0, 0, 0.2],
    "force": [0, 0, -300],
}


def sliding(name, units=MILLIMETRES, seed=3):
    arm, force = ARMS[name]
    return simulate_campaign(arm(), load="pull", force=force, configurations=24, seed=seed, units=units)


@pytest.fixture(scope="module")
def runs():
    return {name: js.identify(sliding(name)) for name in ARMS}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The campaigns as files."""
    folder = tmp_path_factory.mktemp("slides")
    for name in ARMS:
        (folder / f"{name}.json").write_text(json.dumps(sliding(name)))
    return folder


@pytest.mark.parametrize(
    ("name", "slides"), [("scara", [2]), ("rail", [0])], ids=["spindle of a SCARA", "arm on a rail"]
)
def test_readings_in_millimetres_are_those_in_metres_and_each_joint_is_beside_its_spring(name, slides):
    in_mm, in_si = (js.identify(sliding(name, units, seed=2)).result for units in (MILLIMETRES, SI))
    kinds = list(in_mm.joint_kinds.values())
    assert [i for i, kind in enumerate(kinds) if kind == "prismatic"] == slides
    compliances = [joint.compliance for joint in in_si.joints]
    assert [joint.compliance for joint in in_mm.joints] == pytest.approx(compliances, rel=1e-6)
    for joint, truth in zip(in_mm.joints, ARMS[name][0]().compliances, strict=True):
        assert abs(joint.compliance - truth) < joint.standard_uncertainty


@pytest.mark.parametrize(
    ("unit", "lines"),
    [
        (
            "mnm/rad",
            [
                "joint_1 │ 0.596 │ 0.557 … 0.640 │ determined",
                "joint_3 │ 4.22 N/µm │ 3.58 … 5.15 │ determined",
                "stiffness and its interval in 10⁶ N·m/rad, or N/µm where stated",
            ],
        ),
    ],
)
def test_a_slide_is_shown_in_the_unit_that_goes_with_the_chosen_one(files, unit, lines):
    words = " ".join(terminal("identify", files / "scara.json", "--unit", unit, width=120).stdout.split())
    others = [
        "Use with care: 3 of 4 joints are known within a factor of 1.5 joint_4: the stiffness is known to "
        "a factor of 1.67, and the joint may carry 13 % of the deflection",
        "│ joint_4 │ 0.0257 │ 0.0196 … 0.0328 │ use with care │",
        "assumed: load point ± 10 mm, force ± 1 %; --details",
    ]
    for line in lines + others:
        assert line in words


def test_the_details_of_a_slide_have_its_fit_and_its_assumptions(files):
    words = " ".join(terminal("identify", files / "scara.json", "--details", width=120).stdout.split())
    for line in [
        "explains 86.1 % of the mean deflection, residual 46.3 µm rms (3-D), sigma of a reading "
        "20 µm (given)",
        "The model has elastic joints alone: no test shows that other parts bend (F test of links added to "
        "the joints: p = 0.06).",
        "Forces up to 300 N (30.6 kgf), deflections up to 733 µm.",
        "The load point is assumed to be known to ±10 mm.",
        "The forces are assumed to be known to ±1 %.",
        "Each posture was read only once without load, so a deflection that remains after unloading is not "
        "detected.",
    ]:
        assert line in words


def test_the_rail_is_shown_first_and_the_axes_in_their_unit(files):
    words = " ".join(terminal("identify", files / "rail.json", width=120).stdout.split())
    for line in [
        "Use: all 7 joints passed the checks",
        "joint_1 │ 19.0 N/µm │ 16.3 … 22.7 │ determined",
        "joint_2 │ 3.796 │ 3.716 … 3.879 │ well determined",
        "joint_7 │ 0.1008 │ 0.0891 … 0.1133 │ determined",
    ]:
        assert line in words


def test_the_table_of_joints_has_both_units_in_its_head(files, tmp_path):
    assert terminal("export", files / "scara.json", "-o", tmp_path / "joints.csv").exit_code == 0
    head, *rows = csv.reader((tmp_path / "joints.csv").read_text().splitlines())
    assert head[:12] == [
        "joint",
        "kind",
        "status",
        "verdict",
        "reason",
        "stiffness [N.m/rad, prismatic N/m]",
        "stiffness low [N.m/rad, prismatic N/m]",
        "stiffness high [N.m/rad, prismatic N/m]",
        "stiffness at least, one-sided [N.m/rad, prismatic N/m]",
        "compliance [rad/(N.m), prismatic m/N]",
        "compliance standard uncertainty [rad/(N.m), prismatic m/N]",
        "compliance low [rad/(N.m), prismatic m/N]",
    ]
    assert [row[:5] for row in rows] == [
        ["joint_1", "revolute", "identified", "use", ""],
        ["joint_2", "revolute", "identified", "use", ""],
        ["joint_3", "prismatic", "identified", "use", ""],
        ["joint_4", "revolute", "identified", "use_with_care", ""],
    ]
    numbers = [4.22415e6, 3.57977e6, 5.1514e6, 3.66978e6, 2.36734e-7, 2.1742e-8, 1.94121e-7, 2.7935e-7]
    assert [float(cell) for cell in rows[2][5:13]] == pytest.approx(numbers, rel=1e-4)


def test_a_model_of_mujoco_has_a_slide_and_says_what_it_is_made_of(files, tmp_path):
    assert terminal("export", files / "rail.json", "-o", tmp_path / "rail.mjcf").exit_code == 0
    text = (tmp_path / "rail.mjcf").read_text()
    for line in [
        "<!-- Method: partial pose, covariance weights, compliances not negative. Intervals at 95 %. -->",
        "<!-- Verdict on the result: use. -->",
        "<!-- Geometry: as in the robot's model, not identified. -->",
        "<!-- Lengths in m, angles in rad, stiffness in N·m/rad, of prismatic joints in N/m. "
        "Angles are those "
        "of the model, in the frame of the link base_link. -->",
        "<!-- joint_1: 19.0 N/µm (95 % interval 16.3 … 22.7); verdict: use -->",
        "<!-- joint_5: 0.430 · 10⁶ N·m/rad (95 % interval 0.400 … 0.464); verdict: use -->",
        '<compiler angle="radian" eulerseq="XYZ" autolimits="true" boundmass="1" boundinertia="1" />',
        '<option gravity="0 0 0" />',
        '<joint name="joint_1" type="slide" axis="0.0 1.0 0.0" range="-1.0 5.0" />',
    ]:
        assert line in text
    assert (text.count('type="hinge"'), text.count("<position ")) == (6, 7)


class TestWorkOfARail:
    def test_a_map_needs_to_know_where_the_rail_stands(self, runs):
        found = js.map(runs["rail"], near=NEAR, units="m, rad, N", **AREA).result
        assert (found.counts["reached"], found.worst.joints[0]) == (8, RAIL)
        assert [name for name, kind in found.joint_kinds.items() if kind == "prismatic"] == ["joint_1"]
        assert refused(js.map, runs["rail"], units="m, rad, N", **AREA) == (
            "map.run_id | the request does not give the position of the linear axis joint_1 | give "
            "the positions of all joints in `near` or `start`; the linear axis stays at its position"
        )
        assert refused(js.map, runs["scara"], units="m, rad, N", **AREA) == (
            "map.run_id | the robot has 3 revolute joints | inverse kinematics needs an arm with six "
            "revolute joints"
        )

    def test_lengths_of_a_table_are_told_apart_from_angles(self, runs, tmp_path):
        head = f"label,J1 [mm],{','.join(f'J{j} [deg]' for j in range(2, 8))},Fx [N],Fy [N],Fz [N]\n"
        row = ",".join(map(str, ["a", 1e3 * RAIL, *np.degrees(NEAR[1:]).tolist(), *FORCE]))
        right, wrong = tmp_path / "cases.csv", tmp_path / "wrong.csv"
        right.write_text(head + row)
        wrong.write_text(head.replace("J1 [mm]", "J1 [deg]") + row)
        options = {"load_point": (0.01, -0.02, 0.2155), "units": SI}
        one, other = (
            js.predict(runs["rail"], cases, **options).cases[0].displacement
            for cases in (right, [{"joints": NEAR, "force": FORCE}])
        )
        assert one == pytest.approx(other, rel=1e-9)
        assert one == pytest.approx([-0.000234755, 0.000403190, -0.00278497], rel=1e-3)
        assert refused(js.predict, runs["rail"], wrong, **options) == (
            "wrong.csv, line 1 | the header 'J1 [deg]' has the unit deg | write one of [m], [mm] behind "
            "the name"
        )

    def test_a_plan_in_a_terminal_is_a_table_of_whole_millimetres_and_degrees(self, files):
        lines = terminal("plan", files / "rail.json", "--readings", 3, "--candidates", 200, "--csv").stdout
        head, *rows = csv.reader(lines.splitlines())
        assert head[:3] == ["label", "joint_1 [mm]", "joint_2 [deg]"]
        assert head[8:15] == [
            "Fx [N]",
            "Fy [N]",
            "Fz [N]",
            "load point x [mm]",
            "load point y [mm]",
            "load point z [mm]",
            "anchor",
        ]
        assert [row[0] for row in rows] == ["p1", "v2", "p3"]
        assert list(map(float, rows[0][1:14])) == [
            *[-438.0, 83.0, 23.0, 44.0, -19.0, -22.0, -70.0],
            *[-29.7, 1498.8, 52.3, -60.0, 20.0, 180.0],
        ]


@pytest.fixture(scope="module")
def filled():
    """The list with a reading of each target that moves 0.1 mm along the force."""
    load = {"kind": "any_direction", "force": 1500.0}
    plan = js.plan(sliding("rail"), readings=5, load=load, candidates=200)
    rows = list(csv.DictReader(io.StringIO(csv_text(readings_sheet(plan)))))
    for row, reading in zip(rows, plan.result.readings, strict=True):
        posture = arm_on_rail().posture(np.array(reading.joints))
        assert float(row["joint_1 [mm]"]) == pytest.approx(1e3 * reading.joints[0])
        assert float(row["joint_1 [mm]"]).is_integer()
        for name, place in TARGETS.items():
            at = posture.point_to_base(np.array(place))
            along = np.array(reading.force) / np.linalg.norm(reading.force)
            for state, size in (("unloaded", 0.0), ("loaded", 0.1)):
                moved = 1e3 * at + size * along
                row.update({f"{name} {state} {axis} [mm]": f"{moved[k]:.4f}" for k, axis in enumerate("xyz")})
    out = io.StringIO()
    writer = csv.DictWriter(out, rows[0])
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


class TestThePlansListIsFilledIn:
    def read(self, text):
        robot = prepare_robot(RobotDocument.model_validate(sliding("rail")["robot"])).robot
        request = ImportRequest(mapping=Mapping(encoders="motor"))
        return import_files(sources_of(("plan.csv", text)), request, KnownRobot("rail", robot))

    def test_and_read_again_as_a_campaign(self, filled):
        answer = self.read(filled)
        assert (answer.questions, answer.faults) == ([], [])
        document = answer.measurement_set
        assert list(document.load_point) == [-60.0, 20.0, 180.0]
        assert list(document.joint_kinds) == ["prismatic", *["revolute"] * 6]
        assert [each.label for each in document.observations] == ["v1", "p2", "p3", "p4", "p5"]
        first = document.observations[0]
        assert [each.target for each in first.readings] == ["P10", "P11", "P12"]
        assert first.joints[:3] == pytest.approx([412.0, 16.0, 8.0])
        assert list(first.readings[0].unloaded) == pytest.approx([1728.8, 719.43, 1378.8], rel=1e-4)

    @pytest.mark.parametrize("change", [("joint_1 [mm]", "joint_1 [deg]"), ("joint_2 [deg]", "joint_2 [mm]")])
    def test_a_column_of_the_other_kind_is_refused(self, filled, change):
        answer = self.read(filled.replace(*change))
        assert answer.measurement_set is None
        assert "the joints of the robot are in mm, deg, deg, deg, deg, deg, deg" in answer.questions[0].text

    def test_inches_of_a_rail_are_read_and_do_not_fit_the_robot(self, filled):
        answer = self.read(filled.replace("joint_1 [mm]", "joint_1 [in]"))
        assert "mm away from the positions" in answer.faults[0]


class TestWhatDoesNotGoWithASlide:
    def test_angles_of_a_spindle(self):
        document = changed(sliding("scara", SI), ("measurement_set.joint_kinds", ["revolute"] * 4))
        assert refused(js.identify, document) == (
            "measurement_set.joint_kinds | joint joint_3 is read as revolute, but in the robot this joint "
            "is prismatic | give lengths of this joint, in `units.length`, or check the robot and the "
            "order of the joints"
        )

    def test_secondary_encoders(self):
        document = sliding("scara", SI)
        read = {"encoder_readings": [{"joint": "joint_3", "unloaded": 0.0, "loaded": 1e-5}]}
        observations = [each | read for each in document["measurement_set"]["observations"]]
        document = changed(
            document,
            ("measurement_set.observations", observations),
            ("measurement_set.noise.encoder_sigma", 1e-6),
        )
        assert refused(js.identify, document) == (
            "measurement_set.observations[0].encoder_readings | observation 'c01': the robot has no revolute "
            "joint 'joint_3' | use one of joint_1, joint_2, joint_4"
        )

    def test_a_geometry(self):
        document = sliding("rail", SI)
        poses = [
            {
                "joints": each["joints"],
                "targets": {read["target"]: read["unloaded"] for read in each["readings"]},
            }
            for each in document["measurement_set"]["observations"]
        ]
        units = {"length": "m", "angle": "rad"}
        cell = {"name": "cell", "robot": document["robot"], "units": units, "poses": poses}
        assert refused(js.geometry, cell) == (
            "robot | only axes of revolute joints can be identified, but joint_1 is prismatic | make this "
            "joint fixed in the model (URDF: type fixed, at its present position), and omit the joint from "
            "the readings; or use the nominal model"
        )

    def test_own_weight(self):
        body = {"name": "arm", "joint": "joint_3", "mass": 200.0, "centre": [0.0, 0.0, 0.5]}
        document = changed(sliding("rail", SI), ("robot.bodies", [body]), ("run", {"weight": {}}))
        run = js.identify(document)
        assert (run.state, run.error.detail) == (
            "failed",
            "only axes of revolute joints can be identified, but joint_1 is prismatic",
        )
