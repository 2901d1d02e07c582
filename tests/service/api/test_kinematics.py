"""Kinematics for those who draw a robot, against a table that one can do by hand."""

import math

import pytest

TWO_LINKS = {
    "name": "two links",
    "model": {
        "format": "dh",
        "convention": "standard",
        "rows": [
            {"a": 1.0, "alpha": 0.0, "d": 0.5, "theta": 0.0},
            {"a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0},
        ],
    },
}


def test_two_links_stand_where_trigonometry_puts_them(client):
    first, second = 0.3, 0.4
    answer = client.post("/v1/kinematics", json={"robot": TWO_LINKS, "joints": [[first, second]]}).json()
    (posture,) = answer["postures"]
    elbow = (math.cos(first), math.sin(first), 0.5)
    tip = (elbow[0] + 0.5 * math.cos(first + second), elbow[1] + 0.5 * math.sin(first + second), 0.5)
    # An axis is a line: the origin of joint 1 may lie anywhere along it.
    assert posture["joint_origins"][0][:2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert posture["joint_origins"][1][:2] == pytest.approx(elbow[:2], abs=1e-12)
    assert posture["joint_axes"] == [[0, 0, 1], [0, 0, 1]]
    assert posture["flange_origin"] == pytest.approx(tip, abs=1e-12)
    heading = (math.cos(first + second), math.sin(first + second), 0.0)
    assert posture["flange_axes"][0] == pytest.approx(heading, abs=1e-12)


def test_a_stored_robot_is_the_same_as_the_one_that_was_posted(client):
    robot_id = client.post("/v1/robots", json=TWO_LINKS).json()["id"]
    joints = [[0.1, 0.2], [-1.0, 2.0]]
    stored = client.post("/v1/kinematics", json={"robot_id": robot_id, "joints": joints}).json()
    assert stored == client.post("/v1/kinematics", json={"robot": TWO_LINKS, "joints": joints}).json()
    assert len(stored["postures"]) == 2


@pytest.mark.parametrize(
    ("body", "status", "where"),
    [
        ({"robot_id": "0" * 32}, 404, None),
        ({"robot": TWO_LINKS, "joints": [[0.0]]}, 422, "joints[0]"),
        ({"robot": TWO_LINKS, "robot_id": "0" * 32}, 422, "body"),
        ({"robot": TWO_LINKS, "joints": [[0.0, 0.0]] * 1001}, 422, "joints"),
    ],
)
def test_what_cannot_be_drawn_is_refused_by_name(client, body, status, where):
    answer = client.post("/v1/kinematics", json=body)
    assert answer.status_code == status
    assert answer.json().get("where") == where
