"""The flange of a URDF with a gripper: the error names the link, and its remedy works in each door."""

import json

import pytest
from support.documents import campaign
from support.terminal import terminal

import jointstiff as js
from jointstiff.service.conversion.urdf_links import convert_urdf

LIMIT = '<limit lower="0" upper="0.04" effort="1" velocity="1"/>'
MIMIC = '<mimic joint="joint_6"/>'
ARM = campaign(configurations=6)["robot"]["model"]["urdf"].replace('"flange"', '"tool0"')


def joint(name, parent, child, kind="fixed", inside=""):
    limit = LIMIT if kind != "fixed" else ""
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="0 0 0.1"/>{limit}{inside}</joint>'
    )


def with_parts(*parts, arm=ARM):
    return arm.replace("</robot>", "".join(parts) + "</robot>")


UNNAMED = ARM.replace('"tool0"', '"hand_mount"')
CASES = {
    "two fixed fingers": (with_parts(joint("l", "tool0", "left"), joint("r", "tool0", "right")), "tool0"),
    "two sliding fingers": (
        with_parts(
            joint("hand", "tool0", "hand"),
            joint("l", "hand", "left", "prismatic"),
            joint("r", "hand", "right", "prismatic", '<mimic joint="l"/>'),
        ),
        "tool0",
    ),
    "a hand without a usual name": (
        with_parts(
            joint("l", "hand_mount", "left", "prismatic"),
            joint("r", "hand_mount", "right", "prismatic"),
            arm=UNNAMED,
        ),
        "hand_mount",
    ),
    "fingers that turn": (
        with_parts(
            joint("l", "hand_mount", "left", "revolute"),
            joint("r", "hand_mount", "right", "revolute"),
            arm=UNNAMED,
        ),
        "hand_mount",
    ),
    "one sliding finger": (with_parts(joint("grip", "tool0", "finger", "prismatic")), "tool0"),
    "one finger that follows a joint": (
        with_parts(joint("grip", "hand_mount", "finger", "revolute", MIMIC), arm=UNNAMED),
        "hand_mount",
    ),
    "a camera at the forearm": (
        with_parts(joint("camera", "link_3", "camera"), arm=UNNAMED),
        "hand_mount",
    ),
    "a camera and a gripper": (
        with_parts(
            joint("camera", "link_3", "camera"),
            joint("l", "tool0", "left", "prismatic"),
            joint("r", "tool0", "right", "prismatic"),
        ),
        "tool0",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_the_link_of_the_flange_is_named_and_stating_it_works(case):
    urdf, flange = CASES[case]
    with pytest.raises(js.CampaignError) as refused:
        js.robot(urdf)
    problem = refused.value.problem
    assert problem.where == "robot.flange"
    assert f"'{flange}'" in problem.detail
    assert problem.remedy == f"name the link of the flange: jointstiff.robot(urdf, flange='{flange}')"
    robot = js.robot(urdf, flange=flange)
    assert robot.model.flange == flange


def test_the_flange_with_two_fingers_is_where_the_branches_part(tmp_path):
    """In the terminal, in a robot file and over HTTP the same arm is found."""
    urdf, _ = CASES["two fixed fingers"]
    file = tmp_path / "arm.urdf"
    file.write_text(urdf)
    shown = " ".join(terminal("plan", file, width=300).output.split())
    assert shown == (
        "robot.flange: the URDF ends in 2 links, so that the flange is not certain: left, right; the "
        "branches part at 'tool0' remedy: name the link of the flange behind the name of the file: "
        'FILE.urdf#tool0; in a robot file and over HTTP, state "flange": "tool0"; do not remove links'
    )
    options = ("--target", "P1=0,0,0.1", "--load", "dead_weight:1500")
    assert terminal("plan", f"{file}#tool0", *options).exit_code == 0
    model = {"format": "urdf", "urdf": urdf, "base": "base_link", "flange": "tool0"}
    in_file = {"name": "arm", "model": model}
    (tmp_path / "robot.json").write_text(json.dumps(in_file))
    assert js.robot(tmp_path / "robot.json").model == js.robot(f"{file}#tool0").model
    shown = " ".join(terminal("plan", f"{file}#tool1", width=300).output.split())
    assert "there is no link 'tool1' for the flange frame" in shown


def test_a_slide_at_the_end_of_a_scara_is_its_own_joint():
    turning = 'type="revolute"><limit lower="-3" upper="3" effort="1" velocity="1"/><axis xyz="0 0 1"/>'
    links = [f'<link name="l{i}"/>' for i in range(5)]
    joints = [
        f'<joint name="j{i}" {turning}<parent link="l{i - 1}"/><child link="l{i}"/></joint>'
        for i in (1, 2, 3)
    ]
    slide = joint("j4", "l3", "l4", "prismatic").partition("/>")[2]
    urdf = f'<robot name="scara">{"".join(links)}{"".join(joints)}{slide}</robot>'
    assert convert_urdf(urdf, None, None)["flange"] == "l4"


def test_links_that_are_no_tree_are_refused():
    with pytest.raises(js.CampaignError, match="2 links that may be the base: base_link, loose"):
        js.robot(with_parts('<link name="loose"/>'))
    with pytest.raises(js.CampaignError, match="each link of the URDF carries another link"):
        js.robot(with_parts(joint("back", "tool0", "base_link").partition("/>")[2]), base="base_link")
