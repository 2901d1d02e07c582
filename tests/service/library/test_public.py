"""The public names of the library: verbs, campaigns from arrays, results as they print themselves."""

import json
import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pandas
import pinocchio as pin
import polars
import pytest
from reference.kinematics import flange_by_pinocchio
from support.guide_files import ROOT

import jointstiff
import jointstiff as js
from jointstiff.schemas.comparison import ComparisonRequest
from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Campaign, RunRequest
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.jobs import Parts
from jointstiff.service.library.here import attach_campaign
from jointstiff.service.problems import CampaignError
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign, truth
from jointstiff.solver.mechanics.postures import flange_poses

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


def at(state, height):
    """One target of the fifth observation stands at another place."""
    values = positions(state)
    values[4, 1] = [0.0, 0.0, height]
    return values


PLACES = {name: [0.0, 30.0 * t, 100.0] for t, name in enumerate(TARGETS)}
FREE = {"unloaded": None, "loaded": None, "targets": PLACES}


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
        "forces": [polars.Series(part) for part in column("force").T],
    },
    "by target": {
        state: {TARGETS[t]: positions(state)[:, t] for t in (2, 0, 1)} for state in ("unloaded", "loaded")
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
    moved, along = positions("loaded") - positions("unloaded"), (0.0, 0.0, 1.0)
    whole = js.Campaign.from_arrays(**arrays(deflections=moved, **FREE)).measurement_set
    gauge = js.Campaign.from_arrays(**arrays(deflections=moved[..., 2], directions=along, **FREE))
    places = {name: tuple(place) for name, place in PLACES.items()}
    assert whole.flange_targets == gauge.measurement_set.flange_targets == places
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
        ({"units": "m, deg, N", "load_point": (0, 0, 0.12)}, "loaded"),
        ({"loaded": positions("loaded") + 2e3}, "loaded"),
        ({"unloaded": at("unloaded", -99e3), "loaded": at("loaded", -101e3)}, "loaded"),
        ({"unloaded": at("unloaded", 2e3), "loaded": at("loaded", 999.0)}, "loaded"),
        ({"loaded": np.where(at("loaded", 1.0) == 1.0, np.nan, positions("loaded"))}, "loaded[4]"),
        ({"forces": np.where(np.eye(12, 3), np.nan, column("force"))}, "forces"),
        (FREE | {"deflections": np.full((12, 3), 0.5), "directions": np.ones((2, 3))}, "directions"),
        ({"loaded": {TARGETS[0]: positions("loaded")[:, 0]}}, "loaded"),
        ({"loaded": positions("loaded")[:, :2]}, "loaded"),
        ({"units": "mm, m, deg, N"}, "units"),
        ({"labels": ["a"]}, "labels"),
        ({"robot": "KUKA KR 9999"}, "robot"),
        ({"operatr": "M. Keller"}, "operatr"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(changes, where):
    with pytest.raises(js.CampaignError) as refused:
        js.identify(js.Campaign.from_arrays(**arrays(**changes)))
    assert (refused.value.problem.where or "").startswith(where)
    assert refused.value.problem.remedy


def test_what_an_arm_may_just_reach_is_taken_and_load_points_of_each_observation_are_kept():
    points = np.array([[0.0, 0.0, 100.0 + i] for i in range(len(OBSERVATIONS))])
    taken = {"unloaded": at("unloaded", 99e3), "loaded": at("loaded", 98001.0), "load_point": points}
    measured = js.Campaign.from_arrays(**arrays(**taken, labels=None, targets=None)).measurement_set
    reading = measured.observations[4].readings[1]
    assert (measured.load_point, reading.target, reading.unloaded) == (None, "T2", (0.0, 0.0, 99e3))
    assert [each.load_point for each in measured.observations] == [*map(tuple, points.tolist())]
    assert [each.label for each in measured.observations] == [f"c{i:02}" for i in range(1, 13)]


def chain_of(robot):
    return prepare_robot(robot).robot


def test_robots_of_a_name_of_rows_of_a_urdf_and_of_pinocchio_are_the_same_arm(tmp_path):
    named = js.robot("KUKA KR 210 R2700 extra")
    rows = [[1e3 * r.a, np.degrees(r.alpha), 1e3 * r.d, np.degrees(r.theta)] for r in named.model.rows]
    stated = {"convention": named.model.convention, "columns": "a alpha d theta", "units": "mm, deg, N"}
    table = js.robot(rows, joint_map=named.joint_map, **stated)
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
    with pytest.raises(js.CampaignError, match="the robot has no frame 'tool' behind the last joint"):
        js.robot(bare, flange="tool")
    flange = bare.getFrameId(name)
    for end in ("one", "two"):
        place = bare.frames[flange].placement
        bare.addFrame(pin.Frame(end, last, flange, place, pin.FrameType.OP_FRAME))
    with pytest.raises(js.CampaignError, match="the robot has several frames that may be the flange"):
        js.robot(bare)
    np.testing.assert_allclose(flange_poses(chain_of(js.robot(bare, flange="two")), q), whole, atol=1e-12)


def test_a_model_without_frames_ends_at_its_last_joint():
    model = pin.Model()
    for number in range(2):
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5]))
        model.addJoint(number, pin.JointModelRY(), place, f"joint_{number + 1}")
    (pose,) = flange_poses(chain_of(js.robot(model)), np.zeros((1, 2)))
    np.testing.assert_allclose(pose, pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0])).homogeneous, atol=1e-12)
    with pytest.raises(js.CampaignError, match="has no frame 'tool'"):
        js.robot(model, flange="tool")


def test_a_model_of_pinocchio_keeps_limits_of_either_side_and_masses():
    model, place = pin.Model(), pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5]))
    for number, (lower, upper) in enumerate([(-1.5, 2.5), (-1e300, 2.5), (-1.5, 1e300)]):
        ends = [np.array([each]) for each in (1.0, 1.0, lower, upper)]
        model.addJoint(number, pin.JointModelRY(), place, f"joint_{number + 1}", *ends)
    model.appendBodyToJoint(2, pin.Inertia(4.0, np.array([0.0, 0.1, 0.2]), np.eye(3)), pin.SE3.Identity())
    robot = js.robot(model)
    assert chain_of(robot).limits.tolist() == [[-1.5, 2.5], [-np.inf, 2.5], [-1.5, np.inf]]
    (body,) = robot.bodies
    assert (body.joint, body.mass, body.centre) == ("joint_2", 4.0, (0.0, 0.1, 0.2))


def test_a_run_gives_back_the_model_of_pinocchio_that_it_was_given():
    model = pin.buildModelFromXML(default_arm_urdf())
    campaign = js.Campaign.model_validate(DOCUMENT | {"robot": js.robot(model)})
    run = js.identify(campaign)
    assert run.robot.model is model
    of_urdf = js.identify(DOCUMENT)
    assert of_urdf.robot.model.nv == 6
    given, written = (
        {joint.name: joint.compliance for joint in each.result.joints if joint.compliance is not None}
        for each in (run, of_urdf)
    )
    assert len(given) >= 4
    assert given == pytest.approx(written, rel=1e-9)


def default_arm_urdf():
    return json.loads(json.dumps(DOCUMENT))["robot"]["model"]["urdf"]


def test_a_model_that_is_no_arm_is_refused():
    with pytest.raises(js.CampaignError, match=r"branches|FreeFlyer"):
        js.robot(pin.buildSampleModelHumanoid())
    with pytest.raises(js.CampaignError, match="convention"):
        js.robot(np.zeros((6, 4)))


SERVICE = ("sqlalchemy", "psycopg", "fastapi", "starlette", "uvicorn")
HEAVY = {
    "jointstiff": ("numpy", "pinocchio", "cvxpy", "pydantic", "httpx2", "rich", *SERVICE),
    "jointstiff.service.library.here": SERVICE,
}
"""What a module does not import."""


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="pull", configurations=30, seed=3)


@pytest.mark.process
@pytest.mark.parametrize("module", HEAVY)
def test_the_package_and_its_campaigns_are_light(module):
    program = f"import sys, {module}; print([name for name in {HEAVY[module]} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_its_names_are_there_and_no_others():
    for name in jointstiff.__all__:
        assert getattr(jointstiff, name).__name__.rpartition(".")[2] == name
    assert set(jointstiff.__all__) < set(dir(jointstiff))
    assert jointstiff.__version__.count(".") == 2
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = jointstiff.nothing


def test_options_take_the_place_of_the_campaigns(document):
    run = jointstiff.identify(document | {"run": {"positive": False}}, method="complete_pose")
    assert (run.request.method, run.request.positive) == ("complete_pose", False)


def test_a_run_shows_itself_as_a_table(document):
    document = json.loads(json.dumps(document))
    document["robot"]["name"] = "<script>alert(1)</script>"
    run = jointstiff.identify(document)
    shown = run._repr_html_()
    assert shown.startswith("<pre")
    assert all(joint.name in shown for joint in run.result.joints)
    assert "<script" not in shown


@pytest.mark.process
def test_a_client_identifies_and_prints_without_the_numerics(document, service, tmp_path):
    path = tmp_path / "campaign.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    program = f"""
import sys, jointstiff
with jointstiff.Client({service.url!r}) as client:
    run = client.identify({str(path)!r})
    print(run, file=sys.stderr)
    run.save({str(tmp_path / "joints.csv")!r})
print([name for name in ("numpy", "scipy", "pinocchio", "cvxpy") if name in sys.modules])
import matplotlib
matplotlib.use("Agg")
run.plot()
print([name for name in ("scipy", "pinocchio", "cvxpy") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n[]\n"
    assert "joint_6" in done.stderr
    assert (tmp_path / "joints.csv").read_text().count("\n") == 7


def campaign(seed=1, **changes):
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=seed)
    return Campaign.model_validate_json(json.dumps(document | changes))


def test_numbers_and_hashes_are_those_of_a_service():
    one, other = campaign(1), campaign(2)
    with Store.open("sqlite://") as store:
        parts = Parts(store)
        sets = []
        for each in (one, other):
            robot = parts.robots.create(each.robot, None)
            document = {"robot_id": robot.id, **each.measurement_set.model_dump()}
            sets.append(parts.sets.create(MeasurementSetRequest.model_validate(document), None).id)
        run, comparison = parts.jobs["run"], parts.jobs["comparison"]
        stored = run.current(run.create(RunRequest(measurement_set_id=sets[0]), None).id)
        asked = [RunRequest(measurement_set_id=each, elasticity="joints") for each in sets]
        request = ComparisonRequest(run_ids=[run.create(each, None).id for each in asked])
        paired = comparison.current(comparison.create(request, None).id)
    here = jointstiff.identify(one, one.run)
    assert (here.state, here.result) == (stored.state, stored.result)
    assert here.provenance.input_hash == stored.provenance.input_hash
    beside = jointstiff.compare(one, other, methods=[])
    assert (beside.result.joints, beside.result.avoided) == (paired.result.joints, paired.result.avoided)
    assert beside.result.assessment == paired.result.assessment
    numbers = [[each.result.entries[i].joints for i in (0, 1)] for each in (beside, paired)]
    assert numbers[0] == numbers[1]


def test_what_the_run_of_a_file_leaves_out_is_left_out_of_all_that_is_made_of_the_file():
    whole = campaign()
    held = [each.label for each in whole.measurement_set.observations[9:]]
    run = whole.run.model_copy(update={"leave_out": held})
    leaving, less = whole.model_copy(update={"run": run}), campaign()
    del less.measurement_set.observations[9:]
    found, expected = (jointstiff.compare(each).result for each in (leaving, less))
    for one, other in zip(found.entries, expected.entries, strict=True):
        assert (one.joints, one.compensation) == (other.joints, other.compensation)
    found, expected = (jointstiff.compare(each, campaign(2), methods=[]) for each in (leaving, less))
    assert found.result.joints == expected.result.joints
    given = jointstiff.identify(leaving, RunOptions())
    assert given.request.leave_out == held
    assert given.result.joints == jointstiff.identify(less).result.joints


def test_a_run_of_other_readings_does_not_predict(tmp_path):
    """Its robot has the same joints."""
    table = tmp_path / "postures.csv"
    table.write_text(
        "J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg],Fx [N],Fy [N],Fz [N]\n" + "0," * 8 + "-100\n"
    )
    one, other = campaign(1), campaign(2)
    run = jointstiff.identify(one, RunOptions(complementary_stiffness="included"))
    found = jointstiff.predict(run, table, load_point=(0.0, 0.0, 100.0))
    assert len(found.cases) == 1
    with pytest.raises(CampaignError) as caught:
        jointstiff.predict(attach_campaign(run, other), table, load_point=(0.0, 0.0, 100.0))
    assert caught.value.problem.where == "prediction.run_id"
    assert "other readings" in caught.value.problem.detail
    label = one.measurement_set.observations[0].label
    left_out = run.model_copy(update={"request": run.request.model_copy(update={"leave_out": [label]})})
    with pytest.raises(CampaignError):
        jointstiff.predict(attach_campaign(left_out, one), table, load_point=(0.0, 0.0, 100.0))


def test_stored_resources_are_refused_with_their_place():
    document = campaign().model_dump(mode="json")
    document["measurement_set"]["frame"] = {"geometry_id": "g1"}
    framed = Campaign.model_validate_json(json.dumps(document))
    with pytest.raises(CampaignError) as caught:
        jointstiff.identify(framed, framed.run)
    assert caught.value.problem.where == "measurement_set.frame.geometry_id"
    assert "rotation and translation" in caught.value.problem.remedy
    sweep = {"joints": [0.0], "targets": {"P": [1, 0, 1]}}
    request = GeometryRequest.model_validate(
        {
            "units": {"length": "m", "angle": "rad"},
            "robot_id": "r1",
            "sweeps": [{"joint": "joint_1", "observations": [sweep]}],
        }
    )
    with pytest.raises(CampaignError) as caught:
        jointstiff.geometry(request)
    assert caught.value.problem.where == "robot_id"


mpl.use("Agg")
EXAMPLES = ROOT / "examples"
PULLED = simulate_campaign(default_arm(), load="pull", configurations=12, seed=3)
AREA = np.array([[1400.0, -200.0, 600.0], [1800.0, 200.0, 600.0]])
POINT = (0.0, 0.0, 120.0)


@pytest.fixture(scope="module")
def run():
    return js.identify(PULLED)


@pytest.fixture(scope="module")
def results(run):
    """A result of each kind, and a prediction."""
    force = np.array([0.0, 0.0, -500.0])
    return {
        "run": run,
        "comparison": js.compare(run),
        "geometry": js.geometry(EXAMPLES / "sweeps.json"),
        "plan": js.plan(run, readings=6, candidates=200),
        "map": js.map(run, area=AREA, grid=(3, 3, 1), place=(0, 0, 250), force=force),
        "program": js.correct(run, EXAMPLES / "pocket.src", accuracy_option="off", force=force),
        "prediction": run.predict([[0, 0, 0, 0, 30, 0], [10, 0, 0, 0, 30, 0]], force, at=POINT),
    }


def test_each_kind_has_a_plot(results):
    for name, result in results.items():
        figure = result.plot()
        assert all(axes.has_data() for axes in figure.axes), name
        assert figure.get_figwidth() == pytest.approx(88 / 25.4), "a column of a paper"
        assert all(axes.get_xlabel() and axes.get_ylabel() for axes in figure.axes[:1]), name


def test_files_of_a_program_keep_their_names_in_a_folder_and_none_takes_the_place_of_another(
    results, tmp_path
):
    sent, saved = tmp_path / "sent", tmp_path / "saved"
    sent.mkdir()
    saved.mkdir()
    (sent / "pocket.src").write_bytes((EXAMPLES / "pocket.src").read_bytes())
    (sent / "more.src").write_text("DEF more( )\nWAIT SEC 1\nEND\n")
    paths = [sent / "pocket.src", sent / "more.src"]
    program = js.correct(results["run"], paths, accuracy_option="off", force=(0.0, 300.0, -500.0))
    program.save(saved)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["saved", "sent"]
    assert sorted(each.name for each in saved.iterdir()) == ["more.src", "pocket.src"]
    assert (saved / "more.src").read_text() == (sent / "more.src").read_text()
    assert (saved / "pocket.src").read_text() != (sent / "pocket.src").read_text()
    program.save(tmp_path / "both.src")
    for name, kept in (("both.src", "pocket.src"), ("both_more.src", "more.src")):
        assert (tmp_path / name).read_text() == (saved / kept).read_text()


def test_a_single_program_has_the_name_that_it_is_given(results, tmp_path):
    results["program"].save(tmp_path / "out.txt")
    assert "LIN" in (tmp_path / "out.txt").read_text()


def test_a_prediction_of_arrays_is_that_of_cases_and_near_the_simulator(run):
    """Each row by itself, in other units, and against springs that balance the load."""
    q, force = (
        np.array([[0.0, -20.0, 30.0, 0.0, 45.0, 0.0], [40.0, -10.0, 5.0, 7.0, 30.0, 2.0]]),
        (0, 0, -800),
    )
    rows = run.predict(q, force, at=POINT)
    other = run.predict(np.radians(q), np.array(force) / 1e3, at=1e-3 * np.array(POINT), units="m, rad, kN")
    cases = [{"joints": row.tolist(), "force": force} for row in q]
    units = {"length": "m", "angle": "deg", "force": "N"}
    same = js.predict(run, cases, load_point=1e-3 * np.array(POINT), units=units)
    np.testing.assert_allclose(rows.displacement, other.displacement, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(rows.displacement, same.displacement)
    assert rows.intervals.shape == (2, 3, 2)
    assert (rows.intervals[..., 0] <= rows.displacement).all()
    with pytest.raises(js.CampaignError, match="a joint angle of 45 rad exceeds two turns"):
        run.predict(q, force, at=POINT, units="mm, rad, N")
    with pytest.raises(js.CampaignError, match="where no tool reaches; up to 5 m is plausible"):
        run.predict(q, force, at=(0, 0, 120e3))


def test_the_covariance_matrix_has_the_standard_uncertainties(run):
    joints = list(run.joints.values())
    spread = np.sqrt(np.diag(run.covariance))
    np.testing.assert_allclose(spread, [joint.standard_uncertainty for joint in joints], rtol=1e-9)
    assert (np.linalg.eigvalsh(run.covariance / np.outer(spread, spread)) > 0).all()
    true = truth(default_arm(), PULLED)["compliance"]
    off = np.array([joint.compliance for joint in joints]) - true
    assert off @ np.linalg.solve(run.covariance, off) < 22.5  # χ² of 6 joints at 99.9 %


@pytest.mark.parametrize("nothing", [None, 5, [1], np.zeros((3, 6))], ids=lambda each: type(each).__name__)
def test_what_is_no_campaign_is_refused_with_what_a_campaign_is(nothing):
    for verb in (js.identify, js.compare, js.plan):
        with pytest.raises(
            js.CampaignError, match=r"a campaign is a file, a document, a `Campaign`|` is an array"
        ) as caught:
            verb(nothing)
        given = "array" if isinstance(nothing, list | np.ndarray) else type(nothing).__name__
        assert given in str(caught.value)
        assert "jointstiff.Campaign.from_arrays" in caught.value.problem.remedy


@pytest.mark.parametrize("word", ["positiv", "weigthing"])
def test_an_unknown_option_is_refused_by_its_name(word):
    with pytest.raises(js.CampaignError, match=f"{word}: unknown field"):
        js.identify(simulate_campaign(default_arm()), **{word: True})


def test_a_misspelt_verb_has_what_python_needs_to_name_the_right_one():
    with pytest.raises(AttributeError, match="no attribute 'identfy'") as caught:
        js.identfy  # noqa: B018
    assert (caught.value.name, caught.value.obj) == ("identfy", js)


@pytest.mark.parametrize(
    ("option", "place"),
    [("robot", "or check its spelling"), ("load_point", "it is stated in the measurement set")],
)
def test_what_a_campaign_states_is_no_option_of_a_run(option, place):
    campaign = js.datasets.load("pull")
    with pytest.raises(
        js.CampaignError, match=f"{option}: unknown field; remedy: remove this field[:,] {place}"
    ):
        js.identify(campaign, **{option: [0.0, 0.0, 0.1]})
    assert js.identify(campaign).result is not None
