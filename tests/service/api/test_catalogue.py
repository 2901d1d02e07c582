"""The catalogue as the API answers it: where each base is, what its reach is, how controllers show angles."""

import re

import numpy as np
import pytest
from support.api import post

from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture(scope="module")
def answer(local):
    return local.get("/v1/catalogue").json()


ARMS = {
    "FANUC R-2000iC/165F": (
        "fanuc",
        2.655,
        "wrist_centre",
        "at the height of axis 2, 670 mm above the floor",
    ),
    "FANUC R-2000iC/210F": (
        "fanuc",
        2.655,
        "wrist_centre",
        "at the height of axis 2, 670 mm above the floor",
    ),
    "FANUC M-20iD/25": ("fanuc", 1.831, "wrist_centre", "at the height of axis 2, 425 mm above the floor"),
    "FANUC LR Mate 200iD": (
        "fanuc",
        0.717,
        "wrist_centre",
        "at the height of axis 2, 330 mm above the floor",
    ),
    "KUKA KR 210 R2700 extra": ("kuka", 2.696, "wrist_centre", "at the floor"),
    "KUKA KR 6 R900 sixx": ("kuka", 0.9015, "wrist_centre", "at the floor"),
    "ABB IRB 6640-185/2.8": (None, 2.8, "wrist_centre", "at the floor"),
    "ABB IRB 6700-200/2.60": (None, 2.6, "wrist_centre", "at the floor"),
    "ABB IRB 4600-60/2.05": (None, 2.05, "wrist_centre", "at the floor"),
    "ABB IRB 120-3/0.6": (None, 0.58, "wrist_centre", "at the floor"),
    "Yaskawa GP12": ("yaskawa", 1.44, "wrist_centre", "at the height of axis 2, 450 mm above the floor"),
    "Yaskawa GP25": ("yaskawa", 1.73, "wrist_centre", "at the height of axis 2, 505 mm above the floor"),
    "Yaskawa GP180": ("yaskawa", 2.702, "wrist_centre", "at the height of axis 2, 650 mm above the floor"),
    "Stäubli TX2-60": (None, 0.67, "flange", "at the height of axis 2, 375 mm above the floor"),
    "Stäubli TX2-90": (None, 1.0, "flange", "at the height of axis 2, 478 mm above the floor"),
    "Universal Robots UR3e": (None, 0.5, "stated", "at the mounting surface"),
    "Universal Robots UR5e": (None, 0.85, "stated", "at the mounting surface"),
    "Universal Robots UR10e": (None, 1.3, "stated", "at the mounting surface"),
    "Universal Robots UR3": (None, 0.5, "stated", "at the mounting surface"),
    "Universal Robots UR5": (None, 0.85, "stated", "at the mounting surface"),
    "Universal Robots UR10": (None, 1.3, "stated", "at the mounting surface"),
}


def test_the_arms_stand_in_the_order_of_their_makers_with_base_reach_and_sources(answer):
    assert [arm["name"] for arm in answer["arms"]] == list(ARMS)
    for arm in answer["arms"]:
        preset, reach, reach_of, base = ARMS[arm["name"]]
        assert arm["name"].startswith(arm["maker"])
        assert (arm["joint_map_preset"], arm["reach"], arm["reach_of"]) == (preset, reach, reach_of)
        assert arm["base"] == f"on axis 1, {base}"
        of_payload = [source for source in arm["sources"] if source.startswith("payload: ")]
        assert len(of_payload) == (arm["payload"] is not None)
        assert len(arm["sources"]) > len(of_payload)
        assert arm["model"]["format"] == "dh"


def test_the_payload_is_the_one_that_the_name_of_the_arm_states(answer):
    payloads = {arm["name"]: arm["payload"] for arm in answer["arms"]}
    for name, payload in payloads.items():
        stated = re.search(r"(?:iC/|iD/|KR |GP|IRB \d+-)(\d+)", name)
        assert stated is None or payload == float(stated[1])
    assert payloads["FANUC LR Mate 200iD"] == 7.0
    assert [payloads[f"Universal Robots UR{size}e"] for size in (3, 5, 10)] == [3.0, 5.0, 12.5]
    assert [name for name, payload in payloads.items() if payload is None] == [
        "Stäubli TX2-60",
        "Stäubli TX2-90",
    ]


MAPS = {
    "fanuc": ([1, 1, -1, -1, -1, -1], -1.0, "FANUC: J3 from the horizontal"),
    "kuka": ([-1, 1, 1, -1, 1, -1], 0.0, "KUKA: A1, A4 and A6 turn the other way"),
    "yaskawa": ([1, 1, -1, -1, -1, -1], 0.0, "Yaskawa: U, R, B and T turn the other way"),
    "horizontal_third": ([1] * 6, -1.0, "Third axis from the horizontal, signs as in the table"),
}


def test_a_joint_map_turns_axes_and_couples_the_third_to_the_second(answer):
    assert [each["id"] for each in answer["joint_maps"]] == list(MAPS)
    for each in answer["joint_maps"]:
        signs, coupling, name = MAPS[each["id"]]
        matrix = np.diag(signs).astype(float)
        matrix[2, 1] = coupling
        assert each["joint_map"] == {"matrix": matrix.tolist(), "offset": [0.0] * 6}
        assert each["name"] == name
        of_arms = [arm["joint_map"] for arm in answer["arms"] if arm["joint_map_preset"] == each["id"]]
        assert all(arm == each["joint_map"] for arm in of_arms)


def test_a_table_of_an_arm_is_in_metres_and_radians(answer):
    rows = answer["arms"][0]["model"]["rows"]
    assert answer["arms"][0]["model"]["convention"] == "modified"
    assert [row["a"] for row in rows] == [0.0, 0.312, 1.075, 0.225, 0.0, 0.0]
    assert [row["d"] for row in rows] == [0.0, 0.0, 0.0, 1.28, 0.0, 0.215]
    turn = np.pi / 2
    assert [row["alpha"] for row in rows] == pytest.approx([0.0, -turn, 0.0, -turn, turn, -turn])
    assert [row["theta"] for row in rows] == pytest.approx([0.0, -turn, 0.0, 0.0, 0.0, 0.0])
    lower, upper = np.degrees([rows[1]["lower"], rows[1]["upper"]])
    assert (lower, upper) == pytest.approx((-60.0, 76.0))
    assert (rows[2]["lower"], rows[2]["upper"]) == (None, None)  # couples with the second


def test_kinematics_give_axes_and_flange_of_a_stored_robot_and_of_a_document(local):
    document = simulate_campaign(default_arm(), configurations=2)["robot"]
    robot = post(local, "/v1/robots", document)["id"]
    angles = [[0.0] * 6, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]]
    straight, bent = post(local, "/v1/kinematics", {"robot_id": robot, "joints": angles}, 200)
    assert straight["joint_names"] == [f"joint_{i}" for i in range(1, 7)]
    assert straight["joint_kinds"] == ["revolute"] * 6
    assert straight["joint_axes"] == [
        [0.0, 0.0, 1.0],
        [0.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [-1.0, 0.0, 0.0],
    ]
    assert np.array(straight["joint_origins"])[:, [0, 2]] == pytest.approx(
        np.array([[0, 0], [0.33, 0.78], [0.33, 1.9], [0.33, 1.96], [1.64, 1.96], [1.64, 1.96]])
    )
    assert straight["flange_origin"] == pytest.approx([1.88, 0.0, 1.96])
    assert np.array(straight["flange_axes"]) == pytest.approx(
        np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]]), abs=1e-12
    )
    assert bent["flange_origin"] == pytest.approx([1.86009, 0.141599, 1.1083], abs=1e-5)
    assert bent["flange_axes"][0] == pytest.approx([-0.478782, -0.854192, -0.20279], abs=1e-5)
    assert post(local, "/v1/kinematics", {"robot": document, "joints": angles[1:]}, 200) == [bent]
