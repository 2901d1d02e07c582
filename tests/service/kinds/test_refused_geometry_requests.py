"""Geometries over HTTP: bounds of what is posted, one target, and a base that moved."""

import json

import pytest
from support.cases import campaign as recorded
from support.documents import changed
from support.refusals import told

import jointstiff as js

SCHEMA = "correct the field as the reason says"


@pytest.fixture
def swept():
    return recorded("sweeps_small")


def posted(local, document):
    return local.request("POST", "/v1/geometries", json=document)


def test_names_of_joints_and_targets_and_numbers_of_angles_are_checked(local, swept):
    def said(change):
        document = json.loads(json.dumps(swept))
        change(document["sweeps"])
        return told(posted(local, document))

    def own_target_each_time(sweeps):
        for i, one in enumerate(sweeps[0]["observations"]):
            one["targets"] = {f"T{i}": [1.0, 2.0, 3.0 + 0.1 * i]}

    assert said(lambda sweeps: sweeps[1]["observations"][3]["joints"].pop()) == (
        "422 | sweeps[1].observations[3].joints | there are 5 joint angles, but the robot has 6 joints | "
        "give the angles of all controller joints in every position"
    )
    assert said(lambda sweeps: sweeps[0].update(joint="J1")) == (
        "422 | sweeps[0].joint | the robot has no joint 'J1' | use one of joint_1, joint_2, joint_3, "
        "joint_4, joint_5, joint_6"
    )
    assert said(own_target_each_time) == (
        "422 | sweeps | there are 11 different targets, more than 8 | use the same name for the same "
        "target everywhere"
    )
    assert said(lambda sweeps: sweeps.pop(4)) == (
        "422 | sweeps | no sweep determines the axis of model joint 5 | turn each joint alone in a "
        "sweep of its own"
    )


def test_sweeps_and_poses_have_at_most_so_many_positions_and_exclude_each_other(local, swept):
    posed = recorded("poses_small")
    both = swept | {"poses": swept["sweeps"][0]["observations"]}
    assert (
        told(posted(local, both))
        == f"422 | body | 1 fault; first: body: give either `sweeps` or `poses` | {SCHEMA}"
    )
    for sweep in swept["sweeps"]:
        sweep["observations"] *= 30
    assert told(posted(local, swept)) == (
        "422 | body | 1 fault; first: body: give at most 1400 positions in all sweeps together, not "
        "1440: omit every second position; 15 to 20 positions over each joint's arc are enough | "
        f"{SCHEMA}"
    )
    posed["poses"] *= 1401 // len(posed["poses"]) + 1
    assert told(posted(local, posed)) == (
        "422 | body | 1 fault; first: body: give at most 4200 readings of targets in all, not 4212: "
        f"omit every second position, or give only three targets | {SCHEMA}"
    )


def test_one_target_is_enough_where_the_axes_place_the_flange(local, swept):
    for sweep in swept["sweeps"]:
        for one in sweep["observations"]:
            one["targets"] = dict.fromkeys(one["targets"], one["targets"]["P10"])
    answer = posted(local, swept)
    assert answer.status_code == 201
    assert [each["way"] for each in answer.json()["result"]["wrist"]["estimates"]] == ["axes", "sphere"]
    by_targets = swept | {"flange": "targets", "flange_targets": ["P10", "P11", "P12"]}
    assert told(posted(local, by_targets)) == (
        "422 | targets | the three targets lie on a line and do not define a flange frame | choose "
        "three targets that form a triangle"
    )


def test_a_base_that_stood_still_has_no_drift_and_a_target_that_moved_is_named():
    document = recorded("sweeps_moved")
    x, y, z = document["base_targets_after"]["B4"]

    def drift(change):
        found = js.geometry(changed(document, change)).result
        findings = [(each.code, each.where) for each in found.findings if "base" in each.code]
        return found.drift.significant, found.drift.moved_targets, findings

    assert drift(("base_targets_after", document["base_targets_before"])) == (False, [], [])
    assert drift(("base_targets_after.B4", [x + 1e-3, y, z])) == (
        True,
        ["B4"],
        [("base_drifted", "base_targets_after"), ("base_target_moved", "base_targets_after.B4")],
    )
