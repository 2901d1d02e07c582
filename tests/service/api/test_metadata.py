"""Metadata, names and archived of sets and robots; kinematics for those who draw a robot."""

import math

import pytest


def test_a_span_that_ends_before_it_begins_is_refused(local):
    span = {"measured_from": "2026-11-21T00:00:00Z", "measured_to": "2026-11-20T00:00:00Z"}
    answer = local.get("/v1/measurement-sets", params=span)
    assert answer.status_code == 422
    assert "after" in answer.text


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
