"""Greatest speeds of joints: from a URDF, a table or the catalogue to the robot, and back."""

import numpy as np
import pytest

from jointstiff.schemas.robot import CatalogueModel, DhModel, DhRow, RobotDocument, UrdfModel
from jointstiff.service.conversion.dh_tables import convert_dh_rows
from jointstiff.service.conversion.prepared import build_robot, prepare_robot
from jointstiff.solver.mechanics.urdf import read_urdf, write_urdf

KUKA = (123.0, 115.0, 112.0, 179.0, 172.0, 219.0)
"""KUKA's data sheet of the KR 210 R2700 extra [°/s]."""
URDF = """<robot name="two">
<link name="a"/><link name="b"/><link name="c"/>
<joint name="one" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="2.5"/></joint>
<joint name="two" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1" velocity="{velocity}"/></joint></robot>"""


def test_an_arm_of_the_catalogue_has_the_speeds_of_its_data_sheet():
    robot = prepare_robot(
        RobotDocument(name="r", model=CatalogueModel(format="catalogue", arm="KUKA KR 210 R2700 extra"))
    ).robot
    np.testing.assert_allclose(np.degrees(robot.speeds), KUKA)


def test_a_urdf_keeps_its_speeds_and_zero_or_huge_ones_are_unknown():
    chain = read_urdf(URDF.format(velocity="0.4"), "a", "c")
    assert [joint.speed for joint in chain.joints] == [2.5, 0.4]
    again = read_urdf(write_urdf(chain), "a", "c")
    assert [joint.speed for joint in again.joints] == [2.5, 0.4]
    for velocity in ("0", "1e16"):
        unknown = read_urdf(URDF.format(velocity=velocity), "a", "c")
        assert [joint.speed for joint in unknown.joints] == [2.5, None]


def test_a_speed_does_not_change_the_hash_of_a_robot():
    """A campaign of a robot is the same campaign, whether the speeds of its joints are known or not."""
    hashes = set()
    for speed in (None, 2.0):
        row = DhRow(a=0.5, alpha=0.0, d=0.1, theta=0.0, speed=speed)
        model = DhModel(format="dh", convention="standard", rows=[row, row])
        prepared = prepare_robot(RobotDocument(name="r", model=model))
        expected = np.nan if speed is None else speed
        np.testing.assert_equal(build_robot(prepared.document).speeds, np.full(2, expected))
        hashes.add(prepared.content_hash)
    assert len(hashes) == 1
    urdfs = {
        prepare_robot(
            RobotDocument(
                name="r",
                model=UrdfModel(format="urdf", urdf=URDF.format(velocity=each), base="a", flange="c"),
            )
        ).content_hash
        for each in ("0", "0.4")
    }
    assert len(urdfs) == 1


@pytest.mark.parametrize(("header", "factor"), [("speed [deg/s]", np.pi / 180.0), ("velocity [rad/s]", 1.0)])
def test_a_table_of_a_paper_states_speeds_by_a_column(header, factor):
    row = {"a [mm]": 500.0, "alpha [deg]": 0.0, "d [mm]": 0.0, "theta [deg]": 0.0, header: 100.0}
    model = convert_dh_rows([row], "standard", {"length": "mm", "angle": "deg"})
    assert model["rows"][0]["speed"] == pytest.approx(100.0 * factor)
