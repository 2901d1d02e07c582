"""Requests of geometries that cannot be used are refused with their place; a base that moved is found."""

import json

import pytest
from support.cases import campaign as recorded
from support.documents import changed
from support.refusals import told

import jointstiff as js

SCHEMA = "correct the field as the reason says"
LINE, CURVE = (
    {f"B{i}": [float(i), float(y), float(y)] for i, y in enumerate(heights)}
    for heights in ((0, 1, 2), (0, 1, 4))
)
ERROR = {"constant": 1e-5, "per_distance": 0}


@pytest.fixture(scope="module")
def swept():
    return recorded("sweeps_small")


def of_sweep(document, j, change):
    """Change each position of a sweep."""
    sweep = document["sweeps"][j]
    sweep["observations"] = [one | change(i, one) for i, one in enumerate(sweep["observations"])]


def three_positions(document):
    document["sweeps"][3]["observations"] = document["sweeps"][3]["observations"][:3]


def joint_3_still(document):
    of_sweep(document, 2, lambda _, one: {"joints": [*one["joints"][:2], 0.1, *one["joints"][3:]]})


def five_angles(document):
    document["sweeps"][1]["observations"][3]["joints"].pop()


def target_of_its_own_each_time(document):
    of_sweep(document, 0, lambda i, _: {"targets": {f"T{i}": [1.0, 2.0, 3.0 + 0.1 * i]}})


def far_away(document):
    of_sweep(document, 0, lambda _, one: {"targets": dict.fromkeys(one["targets"], (1e12, -1e12, 1e12))})


def all_targets_in_one_place(document, **fields):
    for j in range(6):
        of_sweep(
            document, j, lambda _, one: {"targets": dict.fromkeys(one["targets"], one["targets"]["P10"])}
        )
    document.update(fields)


def thirtyfold(document):
    for sweep in document["sweeps"]:
        sweep["observations"] = 30 * sweep["observations"]


def tracker_at_a_target(document):
    station = document["sweeps"][0]["observations"][0]["targets"]["P10"]
    document["noise"] = {"instrument": {"station": station, "range": ERROR, "transverse": ERROR}}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda d: d["sweeps"].pop(4),
            (
                "sweeps",
                "no sweep determines the axis of model joint 5",
                "turn each joint alone in a sweep of its own",
            ),
        ),
        (
            three_positions,
            (
                "sweep of joint_4",
                "the sweep has 3 positions; at least 4 are needed",
                "record more positions; 10 to 20 over a wide arc are good practice",
            ),
        ),
        (
            joint_3_still,
            (
                "sweep of joint_3",
                "the joint did not move: its angle changes by only 0°",
                "name the joint that was turned, or repeat the sweep",
            ),
        ),
        (
            five_angles,
            (
                "sweeps[1].observations[3].joints",
                "there are 5 joint angles, but 6 joints",
                "give the angles of all controller joints in every position",
            ),
        ),
        (
            lambda d: d["sweeps"][0].update(joint="J1"),
            (
                "sweeps[0].joint",
                "there is no joint 'J1'",
                "use one of joint_1, joint_2, joint_3, joint_4, joint_5, joint_6",
            ),
        ),
        (
            lambda d: d["sweeps"].append(d["sweeps"][0]),
            (
                "sweeps",
                "2 sweeps turn model joint 1",
                "give one sweep per joint; add the positions of a repeated sweep to the first",
            ),
        ),
        (
            target_of_its_own_each_time,
            (
                "sweeps",
                "there are 11 different targets, more than 8",
                "use the same name for the same target everywhere",
            ),
        ),
        (
            far_away,
            (
                "sweep of joint_1",
                "the joint did not move: the controller shows 100°, but no target moved by more than 0 mm",
                "check that readings and angles belong together, that the targets were tracked, and "
                "units.length",
            ),
        ),
        (
            lambda d: d.pop("sweeps"),
            ("body", "1 fault; first: body: give either `sweeps` or `poses`", SCHEMA),
        ),
        (
            lambda d: d.update(poses=d["sweeps"][0]["observations"]),
            ("body", "1 fault; first: body: give either `sweeps` or `poses`", SCHEMA),
        ),
        (
            lambda d: d.pop("units"),
            ("units", "1 fault; first: units: required field is missing", "add this field"),
        ),
        (
            lambda d: d.update(robot_id="nobody"),
            ("robot_id", "there is no robot 'nobody'", "check the id; list them with GET /v1/robots"),
        ),
        (
            lambda d: d.update(flange="targets", flange_targets=["P10", "P11", "Q"]),
            ("flange_targets[2]", "target 'Q' has no reading", "choose three of P10, P11, P12"),
        ),
        (
            lambda d: d.update(flange="nominal"),
            (
                "body",
                "1 fault; first: body: give `robot_id` or `robot`, or place the frames by `axes` or "
                "`targets`",
                SCHEMA,
            ),
        ),
        (
            tracker_at_a_target,
            (
                "noise.instrument.station",
                "a target is only 0 mm away from the tracker",
                "give the tracker's station in R0, in `units.length`",
            ),
        ),
        (
            lambda d: d.update(joint_map={"matrix": [[1.0]], "offset": [0.0]}),
            (
                "sweep of joint_1",
                "the sweep has 6 angles, but the robot 1 joints",
                "give the angles of all joints in every position, and a joint map of this robot",
            ),
        ),
        (
            lambda d: d.update(base_targets_before=LINE, base_targets_after=LINE),
            (
                "base_targets_after",
                "the base targets lie on a line, so a rotation about that line cannot be determined",
                "place the targets so that they form a triangle",
            ),
        ),
        (
            lambda d: d.update(
                base_targets_before=CURVE,
                base_targets_after={name.lower(): place for name, place in CURVE.items()},
            ),
            (
                "base_targets_after",
                "only 0 base targets were read both times; three are needed",
                "read at least three targets both times, with the same names",
            ),
        ),
        (
            lambda d: all_targets_in_one_place(d, flange="targets", flange_targets=["P10", "P11", "P12"]),
            (
                "targets",
                "the three targets lie on a line and do not define a flange frame",
                "choose three targets that form a triangle",
            ),
        ),
        (
            thirtyfold,
            (
                "body",
                "1 fault; first: body: give at most 1400 positions in all sweeps together, not 1440: leave "
                "out every other one, 15 to 20 spread over each joint's arc are enough",
                SCHEMA,
            ),
        ),
    ],
)
def test_sweeps_that_cannot_be_used_are_refused(local, swept, change, said):
    document = json.loads(json.dumps(swept))
    change(document)
    assert told(local.request("POST", "/v1/geometries", json=document)) == (422, *said)


def test_one_target_is_enough_where_the_axes_place_the_flange(local, swept):
    document = json.loads(json.dumps(swept))
    all_targets_in_one_place(document)
    answer = local.request("POST", "/v1/geometries", json=document)
    assert answer.status_code == 201
    assert [each["way"] for each in answer.json()["result"]["wrist"]["estimates"]] == ["axes", "sphere"]


def test_poses_have_at_most_so_many_readings(local):
    posed = recorded("poses_small")
    posed["poses"] *= 1401 // len(posed["poses"]) + 1
    assert told(local.request("POST", "/v1/geometries", json=posed)) == (
        422,
        "body",
        "1 fault; first: body: give at most 4200 readings of targets in all, not 4212: leave out every other "
        "position, or targets beyond three",
        SCHEMA,
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
