"""Robots as their owners have them: units of papers, calibrated tables, URDFs with odd attributes."""

import math
import re
import sys
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import jointstiff as js
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion import child
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.problems import CampaignError
from jointstiff.solver.errors import RobotError
from jointstiff.solver.mechanics.urdf import read_urdf, write_urdf

PAPER = [  # a [mm], alpha [°], d [mm], theta [°], lower [°], upper [°]
    [350.0, -90.0, 675.0, 0.0, -185.0, 185.0],
    [1150.0, 0.0, 0.0, -90.0, -140.0, -5.0],
    [41.0, -90.0, 0.0, 0.0, -120.0, 155.0],
    [0.0, 90.0, 1200.0, 0.0, -350.0, 350.0],
    [0.0, -90.0, 0.0, 0.0, -122.5, 122.5],
    [0.0, 0.0, 215.0, 0.0, -350.0, 350.0],
]
NAMES = ("a", "alpha", "d", "theta", "lower", "upper")


def document(rows, **units):
    table = [dict(zip(NAMES, row, strict=True)) for row in rows]
    model = {"format": "dh", "convention": "standard", "rows": table, **units}
    return RobotDocument.model_validate({"name": "paper", "model": model})


def test_a_table_may_be_in_mm_and_degrees_as_papers_print_it():
    mm, deg = 1e-3, math.pi / 180
    in_si = [[row[0] * mm, row[1] * deg, row[2] * mm, *(each * deg for each in row[3:])] for row in PAPER]
    stated = prepare_robot(document(PAPER, length_unit="mm", angle_unit="deg"))
    plain = prepare_robot(document(in_si))
    assert stated.document.model == plain.document.model
    assert stated.content_hash == plain.content_hash
    np.testing.assert_allclose(stated.robot.limits, np.radians([row[4:] for row in PAPER]), rtol=1e-15)


def test_a_table_in_mm_without_units_is_refused_with_the_fields_that_say_them():
    with pytest.raises(RobotError, match="350 m is not a finite number") as refused:
        prepare_robot(document(PAPER))
    assert "`length_unit` and `angle_unit`" in refused.value.remedy


def test_offsets_of_calibrated_parallel_axes_may_be_large_if_they_cancel():
    """d of the two axes that are nearly parallel grow without bound as they become parallel."""
    half = math.pi / 2
    rows = [
        [0.0, half, 0.089, 0.0],
        [-0.425, 0.0, 512.25, 0.0],
        [-0.392, 0.0, -512.14, 0.0],
        [0.0, half, 0.0, 0.0],
        [0.0, -half, 0.095, 0.0],
        [0.0, 0.0, 0.082, 0.0],
    ]
    robot = js.robot(rows, convention="standard", columns="a alpha d theta", units="m, rad, N")
    assert prepare_robot(robot).robot.n == 6
    rows[2][2] = 0.1
    with pytest.raises(RobotError, match="the flange is 512") as refused:
        prepare_robot(js.robot(rows, convention="standard", columns="a alpha d theta", units="m, rad, N"))
    assert "plausible only if the offsets cancel" in refused.value.remedy


def urdf(limits, name=' name="arm"', axis='<axis xyz="0 0 1"/>'):
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0 0 0.5"/>{axis}<limit lower="{lower}" upper="{upper}"/></joint>'
        for i, (lower, upper) in enumerate(limits)
    )
    links = "".join(f'<link name="l{i}"/>' for i in range(len(limits) + 1))
    return f"<robot{name}>{links}{joints}</robot>"


DEGREES = [(-185, 185), (-140, -5), (-120, 155), (-350, 350), (-122.5, 122.5), (-350, 350)]


def test_limits_of_a_urdf_in_degrees_are_recognised():
    chain = read_urdf(urdf(DEGREES), "l0", "l6")
    assert [joint.limits for joint in chain.joints] == [pytest.approx(np.radians(each)) for each in DEGREES]


@pytest.mark.parametrize(
    "limits", [[(-6.28319, 6.28319)] * 6, [(-3.1, 3.1), (-2, 2), (-30, 30)], [(-180, 180)] * 2]
)
def test_limits_that_may_be_in_rad_stay(limits):
    chain = read_urdf(urdf(limits), "l0", f"l{len(limits)}")
    assert [joint.limits for joint in chain.joints] == limits


def test_a_robot_without_a_name_and_an_axis_with_a_rotation_of_zero_are_read():
    chain = read_urdf(urdf(DEGREES, name="", axis='<axis xyz="0 0 1" rpy="0 0 0"/>'), "l0", "l6")
    assert chain.name == "robot"
    assert all((joint.axis == [0, 0, 1]).all() for joint in chain.joints)
    with pytest.raises(RobotError, match="is outside"):
        read_urdf(urdf(DEGREES, axis='<axis xyz="0 0 1" rpy="0 0 1.57"/>'), "l0", "l6")


@pytest.mark.process
def test_xacro_is_expanded_by_its_package_or_refused_in_one_sentence(tmp_path, monkeypatch):
    path = tmp_path / "arm.urdf.xacro"
    path.write_text("<robot/>")
    with monkeypatch.context() as patched:
        patched.setitem(sys.modules, "xacro", None)
        with pytest.raises(CampaignError, match="needs the package xacro"):
            js.robot(path)
    path.write_text(urdf(DEGREES).replace("<robot ", f"<robot {NAMESPACE} ", 1))
    assert prepare_robot(js.robot(path)).robot.n == 6


NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
ENDLESS = {
    "a power": '<link name="a${9**9**9}"/>',
    "a large list": '<link name="${len(list(range(10**12)))}"/>',
    "a macro that calls itself": '<xacro:macro name="m"><xacro:m/><xacro:m/></xacro:macro><xacro:m/>',
    "an unknown name": '<link name="${reach}"/>',
    "no XML": "<link",
    "a package of ROS": '<xacro:include filename="$(find arm)/arm.xacro"/>',
}


@pytest.mark.process
@pytest.mark.parametrize("title", ENDLESS)
def test_expressions_of_xacro_have_limits_of_time_and_memory(title, tmp_path, monkeypatch):
    monkeypatch.setattr(child, "MAX_WAIT", 40.0)
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(f"<robot name='a' {NAMESPACE}>{ENDLESS[title]}</robot>")
    reason = r"needs more than 5 s or 384 MiB|cannot be expanded: "
    with pytest.raises(CampaignError, match=reason) as refused:
        js.robot(path)
    assert "Traceback" not in str(refused.value)
    assert refused.value.problem.remedy


@pytest.mark.process
@pytest.mark.parametrize("place", ["around", "next to it", "path"])
@pytest.mark.parametrize("name", ["arm.urdf.xacro", "arm.urdf"])
def test_packages_are_found_by_their_manifests_without_ros(place, name, tmp_path, monkeypatch):
    """The file of a cell finds the macro and the yaml of its arm, whose folder has another name."""
    own = tmp_path / "cell"
    package = {"around": own, "next to it": tmp_path / "arm-2.1", "path": tmp_path / "ros" / "src" / "arm"}[
        place
    ]
    for folder, package_name in ((own, "cell_description"), (package, "arm_description")):
        (folder / "urdf").mkdir(parents=True, exist_ok=True)
        (folder / "package.xml").write_text(f"<package format='3'><name>{package_name}</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros" / "src") if place == "path" else "")
    (package / "limits.yaml").write_text("first: 1.5\n")
    plain = urdf(DEGREES)
    body = plain[plain.index("<link") : plain.rindex("</robot>")]
    macro = f"<robot {NAMESPACE}><xacro:macro name='arm' params=''>{body}</xacro:macro></robot>"
    (package / "urdf" / "arm_macro.xacro").write_text(macro)
    (own / "urdf" / name).write_text(
        f"<robot name='cell' {NAMESPACE}>"
        "<xacro:include filename='$(find arm_description)/urdf/arm_macro.xacro'/>"
        "<xacro:property name='limits' value=\"${xacro.load_yaml('$(find arm_description)/limits.yaml')}\"/>"
        "<xacro:if value=\"${limits['first'] == 1.5}\"><xacro:arm/></xacro:if></robot>"
    )
    assert prepare_robot(js.robot(own / "urdf" / name)).robot.n == 6


def test_a_joint_that_cannot_move_is_named():
    with pytest.raises(RobotError, match="the joint limits 0 and 0 rad leave no range") as refused:
        read_urdf(urdf([(-1, 1), (0, 0)]), "l0", "l2")
    assert refused.value.where == "joint 'j1' limits"
    assert "make a joint that cannot move a fixed joint" in refused.value.remedy


@pytest.mark.parametrize(
    ("limits", "read"),
    [
        ([185, 140, 155, 350, 125, 350], "degrees"),
        ([185, 140, 155, 900, 125, 900], "degrees"),
        ([1000] * 6, "radians"),
        ([3.2, 2.4, 2.7, 6.1, 2.2, 6.1], "radians"),
    ],
)
def test_limits_in_degrees_are_converted_once(limits, read):
    robot = js.robot(PAPER, convention="standard", columns=NAMES, units="mm, deg, N")
    chain = prepare_robot(robot).robot.chain
    bounds = {f"joint_{number}": (-limit, limit) for number, limit in enumerate(limits, 1)}
    joints = tuple(replace(joint, limits=bounds.get(joint.name)) for joint in chain.joints)
    urdf = write_urdf(replace(chain, joints=joints))
    prepared = prepare_robot(js.robot(urdf))
    wanted = np.radians(limits) if read == "degrees" else np.array(limits, dtype=float)
    np.testing.assert_allclose(prepared.robot.limits[:, 1], wanted, rtol=1e-12)
    np.testing.assert_allclose(prepare_robot(prepared.document).robot.limits[:, 1], wanted, rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<sdf version='1.9'><model name='a'/></sdf>", "the root element is <sdf>, not <robot>"),
        ("<mujoco/>", "send a URDF document, not SDF or MJCF"),
        ("<robot xmlns:xacro='x'><xacro:macro name='m'/></robot>", "expand the document first: xacro"),
    ],
)
def test_a_document_that_is_no_urdf_is_named_before_its_links(text, reason):
    with pytest.raises(CampaignError) as refused:
        js.robot(text)
    assert reason in str(refused.value)


ORIGIN = '<origin xyz="0 0 0.5"/>'


@pytest.mark.parametrize(
    ("right", "wrong", "remedy"),
    [
        (ORIGIN, '<orgin xyz="0 0 0.5"/>', "write <origin> if this is meant, or remove the element"),
        (ORIGIN, "<pose>0 0 0.5 0 0 0</pose>", "remove the element"),
        (ORIGIN, '<translation xyz="0 0 0.5"/>', "remove the element"),
        (
            '<axis xyz="0 0 1"/>',
            '<axes xyz="0 0 1"/>',
            "write <axis> if this is meant, or remove the element",
        ),
        ('<link name="l1"/>', '<link name="l1"><inertail/></link>', "write <inertial> if this is meant"),
        ('<link name="l0"/>', '<link name="l0"><pose>1 0 0 0 0 0</pose></link>', "remove the element"),
    ],
)
def test_an_unknown_element_of_a_joint_or_link_on_the_chain_is_refused_by_name(right, wrong, remedy):
    text = urdf(DEGREES)
    assert right in text
    with pytest.raises(RobotError, match="unknown element <") as refused:
        read_urdf(text.replace(right, wrong, 1), "l0", "l6")
    assert refused.value.remedy.startswith(remedy)


def test_elements_of_other_programs_and_branches_off_the_chain_are_read_over():
    text = urdf(DEGREES)
    extended = text.replace(
        ORIGIN,
        f'{ORIGIN}<calibration rising="0"/><dynamics damping="1"/><safety_controller k_velocity="1"/>'
        '<drake:gear_ratio value="3"/><gazebo><provideFeedback>1</provideFeedback></gazebo>'
        "<hardwareInterface>PositionJointInterface</hardwareInterface><transmission/>"
        "<springStiffness>0</springStiffness><springReference>0</springReference><stopCfm>0</stopCfm>"
        "<stopErp>0.2</stopErp><cfm_damping>1</cfm_damping><fudgeFactor>1</fudgeFactor>",
    ).replace(
        '<link name="l1"/>',
        '<link name="l1"><inertial/><visual/><collision/><contact/><self_collide/><fdir1/><drake:x/></link>',
    )
    branch = (
        '<link name="tool"><pose/></link><joint name="t" type="fixed"><parent link="l6"/><child link="tool"/>'
    )
    whole = extended.replace("</robot>", f"{branch}<orgin/></joint></robot>")
    plain, read = read_urdf(text, "l0", "l6"), read_urdf(whole, "l0", "l6")
    assert [(each.name, each.limits) for each in read.joints] == [
        (each.name, each.limits) for each in plain.joints
    ]
    with pytest.raises(RobotError, match="unknown element"):
        read_urdf(whole, "l0", "tool")


def rotated(rpy):
    """Return a URDF whose first joint has a rotation."""
    return urdf([(-3, 3)] * 3).replace('xyz="0 0 0.5"', f'xyz="0 0 0.5" rpy="{rpy}"', 1)


@pytest.mark.parametrize("rpy", ["0 90 0", "180 0 0", "0 0 -45", "30 0 0", "0 355 0"])
def test_a_rotation_of_a_urdf_in_degrees_is_refused_with_the_right_angles(rpy):
    with pytest.raises(RobotError, match="a URDF is in radians") as refused:
        read_urdf(rotated(rpy), "l0", "l3")
    found = re.search(r'rpy="(.*)"$', refused.value.remedy)
    chain = read_urdf(rotated(found[1]), "l0", "l3")
    wanted = pin.rpy.rpyToMatrix(*(math.radians(float(angle)) for angle in rpy.split()))
    np.testing.assert_allclose(chain.joints[0].rotation, wanted, atol=1e-8)


@pytest.mark.parametrize("rpy", ["0 7.85398 0", "6.2832 0 -3.1416", "-12.566 0 0", "5 0 0"])
def test_a_rotation_that_may_be_in_rad_stays(rpy):
    chain = read_urdf(rotated(rpy), "l0", "l3")
    wanted = pin.rpy.rpyToMatrix(*map(float, rpy.split()))
    np.testing.assert_allclose(chain.joints[0].rotation, wanted, atol=1e-12)


def test_limits_of_some_joints_in_degrees_are_refused_with_the_right_limits():
    given = urdf([(-3.2, 3.2), (-140, -5), (-2.1, 2.7), (-350, 350)])
    with pytest.raises(RobotError, match="as if they were in degrees") as refused:
        read_urdf(given, "l0", "l4")
    assert refused.value.where == "joint 'j1' <limit>"
    assert 'lower="-2.443460953" upper="-0.0872664626"' in refused.value.remedy
