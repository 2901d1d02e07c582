"""Unloaded poses with deviations, and tables of masses: what they make together with readings."""

from functools import cache

import numpy as np
import pytest
from support.importing_samples import POSES, answered, refusals
from support.workbooks import table_of

from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.own_weight import unloaded_campaign

PLUS = {f"d{axis}": f"P1 unloaded plus {axis} [mm]" for axis in "xyz"}


def test_deviations_are_added_to_positions():
    answer = answered(("poses.csv", POSES), columns=PLUS)
    poses = answer.geometry.poses
    assert [([*one.joints], one.targets) for one in poses] == [
        ([10.0, 20.0], {"P1": (1000.5, 199.75, 300.125)}),
        ([30.0, 40.0], {"P1": (899.5, 400.75, 350.0)}),
    ]
    assert (answer.geometry.name, answer.geometry.units.length, answer.geometry.units.angle) == (
        "poses",
        "mm",
        "deg",
    )
    assert (answer.measurement_set, answer.missing_fields) == (None, ["force", "loaded"])
    assert answer.missing[1] == (
        "the positions under load, or the robot's masses (`bodies`, or a table of masses), for its own weight"
    )


def test_the_noise_of_poses_is_the_root_mean_square_of_their_uncertainties():
    head = POSES.splitlines()[0].replace(
        "dx,dy,dz", ",".join(f"P1 unloaded U95 {axis} [mm]" for axis in "xyz")
    )
    rows = ["c01,10,20,1000,200,300,0.5,0.25,0.125", "c02,30,40,900,400,350,0.5,0.75,0"]
    answer = answered(("poses.csv", "\n".join([head, *rows, ""])))
    stated = np.array([0.5, 0.25, 0.125, 0.5, 0.75, 5e-4]) / 1.96  # 0 is 0.5 µm
    assert answer.geometry.noise.sigma == pytest.approx(np.sqrt(np.mean(stated**2)), rel=1e-12)


@cache
def own_weight():
    """Return a campaign of unloaded readings, and its robot without masses."""
    document = unloaded_campaign(default_arm(), configurations=8, seed=4)
    bare = {name: value for name, value in document["robot"].items() if name != "bodies"}
    return document, prepare_robot(RobotDocument.model_validate(bare)).robot


def masses(joint="{name}", bound="± [%]", share=100.0):
    """Write the table of masses; a bound is a share of the mass, or in kilograms."""
    rows = [f"body;joint;mass [kg];{bound};cog x [mm];cog y [mm];cog z [mm]"]
    for number, body in enumerate(own_weight()[0]["robot"]["bodies"], start=1):
        width = body["mass_uncertainty"] * (body["mass"] if share == 1.0 else share)
        centre = ";".join(f"{1e3 * each:.10g}" for each in body["centre"])
        where = joint.format(name=body["joint"], number=number)
        rows.append(f"{body['name']};{where};{body['mass']!r};{width:.12g};{centre}")
    return "\n".join(rows) + "\n"


def grid():
    return "grid.csv", table_of(own_weight()[0]) + b"\n"


@pytest.mark.parametrize(
    "written",
    [{}, {"joint": "{number}"}, {"joint": "Axis {number}"}, {"bound": "± [kg]", "share": 1.0}],
)
def test_a_table_of_masses_gives_the_bodies_of_the_robot(written):
    document, robot = own_weight()
    answer = answered(grid(), ("masses.csv", masses(**written)), robot=robot, load_point=None)
    for body, stated in zip(answer.bodies, document["robot"]["bodies"], strict=True):
        assert (body.name, body.joint, body.mass) == (stated["name"], stated["joint"], stated["mass"])
        numbers = [body.mass_uncertainty, *body.centre]
        assert numbers == pytest.approx([stated["mass_uncertainty"], *stated["centre"]], rel=1e-9)
    assert (answer.missing, answer.files[1].assumptions) == ([], ["read as masses"])
    assert {one.force for one in answer.measurement_set.observations} == {(0.0, 0.0, 0.0)}


def test_the_bodies_of_a_robot_make_readings_without_load_a_set():
    document, bare = own_weight()
    whole = prepare_robot(RobotDocument.model_validate(document["robot"])).robot
    assert answered(grid(), robot=whole, load_point=None).measurement_set is not None
    assert answered(grid(), robot=bare, load_point=None).measurement_set is None


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("mass [kg]", "mass", ":1:3: the unit of 'mass' is not one of kg; write the unit as in `mass [kg]`"),
        ("± [%]", "±", ":1:4: the unit of '±' is not one of %, kg; write the unit as in `± [%]`"),
        ("body;", "x;", ":1:1: the unit of 'x' is not one of m, mm; write the unit as in `x [m]`"),
        (
            "cog z [mm]", "cog w [mm]",
            ":1:7: the header 'cog w [mm]' of a table of masses is unknown, or occurs twice; "
            "use `body`, `joint`, `mass [kg]`, `± [%]`, `centre x [mm]`, y, z, `centre ± [mm]`",
        ),
        (
            "link 1;joint_1;", "link 1;joint_1;-",
            ":2: the row does not describe a body: mass: input should be greater than 0; correct the "
            "numbers of the row",
        ),
    ],
)  # fmt: skip
def test_a_table_of_masses_with_a_fault_is_refused(old, new, said):
    table = masses().replace(old, new, 1)
    assert refusals(grid(), ("masses.csv", table), robot=own_weight()[1]) == [f"masses.csv{said}"]


def test_masses_are_those_of_the_joints_of_a_robot_with_readings():
    table = "masses.csv", masses().replace("joint_1", "elbow", 1)
    assert refusals(grid(), table, robot=own_weight()[1]) == [
        "the robot has no joint 'elbow', which carries 'link 1'; "
        "use one of joint_1, joint_2, joint_3, joint_4, joint_5, joint_6"
    ]
    assert refusals(("masses.csv", masses())) == [
        "the files contain masses, but no readings; import the masses together with the readings of the robot"
    ]


def test_a_load_point_in_the_wrong_unit_is_blamed_on_itself():
    light = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)
    robot = prepare_robot(RobotDocument.model_validate(light["robot"])).robot
    options = {"robot": robot, "length_unit": "mm"}
    answer = answered(("a.csv", table_of(light)), load_point=(0, 0, 0.12), **options)
    (finding,) = answer.findings
    assert (finding.code, finding.weight, finding.remedy) == (
        "length_unit_suspect", "do_not_use", "check the unit of `load_point`"
    )  # fmt: skip
    assert finding.message == (
        "the load points are up to 120 µm from the origin of the flange frame (2 mm to 10 m "
        "is plausible), "
        "while the targets were read up to 3.52 m from the origin of R0"
    )
    assert answer.measurement_set.load_point == pytest.approx((0.0, 0.0, 0.00012))
    assert answered(("a.csv", table_of(light)), load_point=(0, 0, 120), **options).findings == []
