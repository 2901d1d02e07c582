"""Campaigns of arrays are those of the file with the same numbers; what is no reading is refused by name."""

import json

import numpy as np
import pandas
import pinocchio as pin
import polars
import pytest
from reference.kinematics import flange_by_pinocchio

import jointstiff as js
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.mechanics.configuration import flange_poses

DOCUMENT = simulate_campaign(
    default_arm(),
    load="pull",
    configurations=12,
    seed=5,
    units={"length": "mm", "angle": "deg", "force": "N", "moment": "N.mm"},
    load_point=(0, 0, 0.12),
)
OBSERVATIONS = DOCUMENT["measurement_set"]["observations"]
TARGETS = [each["target"] for each in OBSERVATIONS[0]["readings"]]


def column(field):
    return np.array([each[field] for each in OBSERVATIONS], dtype=float)


def positions(state):
    return np.array([[r[state] for r in each["readings"]] for each in OBSERVATIONS], dtype=float)


def arrays(**changes):
    whole = DOCUMENT["measurement_set"]
    return {
        "robot": DOCUMENT["robot"],
        "joints": column("joints"),
        "forces": column("force"),
        "moments": column("moment"),
        "unloaded": positions("unloaded"),
        "loaded": positions("loaded"),
        "targets": TARGETS,
        "load_point": whole["load_point"],
        "sigma": whole["noise"]["sigma"],
        "labels": [each["label"] for each in OBSERVATIONS],
        "units": "mm, deg, N, N·mm",
        "run": DOCUMENT["run"],
    } | changes


def wide(state):
    return pandas.DataFrame(positions(state).reshape(len(OBSERVATIONS), -1))


FORMS = {
    "arrays": {},
    "lists": {"joints": column("joints").tolist(), "loaded": positions("loaded").tolist()},
    "pandas": {
        "joints": pandas.DataFrame(column("joints")),
        "forces": [pandas.Series(part) for part in column("force").T],
        "unloaded": wide("unloaded"),
    },
    "polars": {
        "joints": polars.DataFrame(column("joints")),
        "forces": {name: polars.Series(part) for name, part in zip("xyz", column("force").T, strict=True)},
    },
    "by target": {
        state: {name: positions(state)[:, t] for t, name in enumerate(TARGETS)}
        for state in ("unloaded", "loaded")
    },
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_arrays_are_the_campaign_of_the_file_with_these_numbers(form, tmp_path):
    campaign = js.Campaign.from_arrays(**arrays(**form))
    campaign.save(tmp_path / "c.json")
    runs = [js.identify(each) for each in (campaign, tmp_path / "c.json", DOCUMENT)]
    assert len({run.provenance.input_hash for run in runs}) == 1
    size = f"12 observations, {len(TARGETS)} targets, motor encoders"
    assert repr(campaign) == f"<Campaign 'readings from arrays' of '{DOCUMENT['robot']['name']}': {size}>"


def test_a_target_that_was_not_read_is_left_out():
    loaded = positions("loaded")
    loaded[3, 1] = np.nan
    readings = js.Campaign.from_arrays(**arrays(loaded=loaded)).measurement_set.observations[3].readings
    assert [each.target for each in readings] == [TARGETS[0], *TARGETS[2:]]


def test_deflections_and_lengths_along_directions_are_read_at_their_places():
    places, along = {name: [0.0, 30.0 * t, 100.0] for t, name in enumerate(TARGETS)}, (0.0, 0.0, 1.0)
    moved = positions("loaded") - positions("unloaded")
    free = {"unloaded": None, "loaded": None, "targets": places}
    whole = js.Campaign.from_arrays(**arrays(deflections=moved, **free)).measurement_set
    gauge = js.Campaign.from_arrays(**arrays(deflections=moved[..., 2], directions=along, **free))
    assert (
        whole.flange_targets
        == gauge.measurement_set.flange_targets
        == {n: tuple(p) for n, p in places.items()}
    )
    reading = gauge.measurement_set.observations[2].readings[1]
    assert (reading.displacement, reading.direction) == (moved[2, 1, 2], along)
    assert whole.observations[2].readings[1].deflection == tuple(moved[2, 1])


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"joints": column("joints")[:, :5]}, "measurement_set"),
        ({"joints": column("joints")[:7]}, "unloaded"),
        ({"joints": "six"}, "joints"),
        ({"forces": column("force")[:, 2]}, "forces"),
        ({"loaded": None}, "unloaded"),
        ({"unloaded": None}, "unloaded"),
        ({"units": "mm, deg"}, "units"),
        ({"units": "inch, deg, N"}, "units"),
        ({"units": "m, deg, N"}, "load_point"),
        ({"units": "m, deg, N", "load_point": (0, 0, 0.12)}, "unloaded["),
        ({"targets": dict.fromkeys(TARGETS, (0.0, 0.0, 9000.0))}, f"targets['{TARGETS[0]}']"),
        ({"loaded": positions("loaded") + 2e3}, "loaded["),
        ({"labels": ["a"]}, "labels"),
        ({"robot": "KUKA KR 9999"}, "--robot"),
        ({"operatr": "M. Keller"}, "operatr"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(changes, where):
    with pytest.raises(js.CampaignError) as refused:
        js.identify(js.Campaign.from_arrays(**arrays(**changes)))
    assert (refused.value.problem.where or "").startswith(where)
    assert refused.value.problem.remedy


@pytest.mark.parametrize("row", [0, 4, 11])
@pytest.mark.parametrize(("field", "size"), [("unloaded", 60.0), ("loaded", 60.0), ("deflections", 6.0)])
def test_the_row_of_a_number_that_no_arm_reaches_is_named(field, size, row):
    """One coordinate of one target, in m beside numbers in mm."""
    changes = {"units": "mm, deg, N, N·mm"}
    if field == "deflections":
        places = {name: [0.0, 30.0 * t, 100.0] for t, name in enumerate(TARGETS)}
        values = positions("loaded") - positions("unloaded")
        changes |= {"unloaded": None, "loaded": None, "targets": places}
    else:
        values = positions(field)
    values[row, 1, 2] = 1e3 * size
    with pytest.raises(js.CampaignError) as refused:
        js.Campaign.from_arrays(**arrays(**changes, **{field: values}))
    assert (refused.value.problem.where or "").endswith(
        f"loaded[{row}]" if "loaded" in field else f"{field}[{row}]"
    )


def chain_of(robot):
    return prepare_robot(robot).robot


def test_robots_of_a_name_of_rows_of_a_urdf_and_of_pinocchio_are_the_same_arm(tmp_path):
    named = js.robot("KUKA KR 210 R2700 extra")
    rows = [[1e3 * r.a, np.degrees(r.alpha), 1e3 * r.d, np.degrees(r.theta)] for r in named.model.rows]
    table = js.robot(rows, convention=named.model.convention, units="mm, deg, N", joint_map=named.joint_map)
    urdf = default_arm_urdf()
    (tmp_path / "arm.urdf").write_text(urdf)
    model = pin.buildModelFromXML(urdf)
    arms = [js.robot(each) for each in (urdf, tmp_path / "arm.urdf", model)]
    q = np.random.default_rng(1).uniform(-1, 1, (5, 6))
    np.testing.assert_allclose(flange_poses(chain_of(table), q), flange_poses(chain_of(named), q), atol=1e-9)
    ends = (arms[0].model.base, arms[0].model.flange)
    for arm in arms:
        for angles, pose in zip(q, flange_poses(chain_of(arm), q), strict=True):
            by_name = dict(zip(chain_of(arms[0]).joint_names, angles, strict=True))
            np.testing.assert_allclose(pose, flange_by_pinocchio(urdf, by_name, *ends), atol=1e-12)


def test_the_flange_of_a_model_of_pinocchio_is_its_last_frame_or_the_one_that_is_named():
    bare = pin.buildModelFromXML(default_arm_urdf())
    last = bare.njoints - 1
    (name,) = [f.name for f in bare.frames if f.parentJoint == last and f.name == "flange"]
    q = np.random.default_rng(2).uniform(-1, 1, (5, 6))
    named, whole = (flange_poses(chain_of(js.robot(bare, **each)), q) for each in ({"flange": name}, {}))
    np.testing.assert_allclose(named, whole, atol=1e-12)
    with pytest.raises(js.CampaignError, match="'tool' is no frame behind the last joint"):
        js.robot(bare, flange="tool")
    flange = bare.getFrameId(name)
    for end in ("one", "two"):
        place = bare.frames[flange].placement
        bare.addFrame(pin.Frame(end, last, flange, place, pin.FrameType.OP_FRAME))
    with pytest.raises(js.CampaignError, match="several frames may be the flange"):
        js.robot(bare)
    np.testing.assert_allclose(flange_poses(chain_of(js.robot(bare, flange="two")), q), whole, atol=1e-12)


def test_a_model_without_frames_ends_at_its_last_joint():
    model = pin.Model()
    for number in range(2):
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5]))
        model.addJoint(number, pin.JointModelRY(), place, f"joint_{number + 1}")
    (pose,) = flange_poses(chain_of(js.robot(model)), np.zeros((1, 2)))
    np.testing.assert_allclose(pose, pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0])).homogeneous, atol=1e-12)
    with pytest.raises(js.CampaignError, match="'tool' is no frame"):
        js.robot(model, flange="tool")


def default_arm_urdf():
    return json.loads(json.dumps(DOCUMENT))["robot"]["model"]["urdf"]


def test_a_model_that_is_no_arm_is_refused():
    with pytest.raises(js.CampaignError, match=r"branches|FreeFlyer"):
        js.robot(pin.buildSampleModelHumanoid())
    with pytest.raises(js.CampaignError, match="convention"):
        js.robot(np.zeros((6, 4)))
