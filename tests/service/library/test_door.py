"""`import jointstiff` as in a notebook: light, a run is a table, with the hashes of a service."""

import json
import subprocess
import sys

import pytest

import jointstiff
from jointstiff.schemas.comparison import ComparisonRequest
from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Campaign, RunRequest
from jointstiff.service.jobs import Parts
from jointstiff.service.library.here import run_of
from jointstiff.service.problems import CampaignError
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign

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
        assert getattr(jointstiff, name).__name__ == name
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
    found = jointstiff.predict(run, table, load_point=(0.0, 0.0, 0.1))
    assert len(found.cases) == 1
    with pytest.raises(CampaignError) as caught:
        jointstiff.predict(run_of(run, other), table, load_point=(0.0, 0.0, 0.1))
    assert caught.value.problem.where == "prediction.run_id"
    assert "other readings" in caught.value.problem.detail
    label = one.measurement_set.observations[0].label
    left_out = run.model_copy(update={"request": run.request.model_copy(update={"leave_out": [label]})})
    with pytest.raises(CampaignError):
        jointstiff.predict(run_of(left_out, one), table, load_point=(0.0, 0.0, 0.1))


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
