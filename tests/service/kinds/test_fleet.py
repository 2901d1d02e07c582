"""A fleet: many sets in one job, each as a run of its own."""

import csv
import json
import pickle
from contextlib import closing

import pytest
from support.claims import Claims
from support.in_process import Client
from support.jobs import set_of
from support.terminal import terminal

import jointstiff as js
from jointstiff.schemas.fleet import MAX_SETS, FleetRequest
from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.schemas.run import RunRequest
from jointstiff.service.jobs import Parts
from jointstiff.service.kinds.fleet import work as fleet_work
from jointstiff.service.kinds.run import one_of_many
from jointstiff.service.kinds.work import pack_arrays
from jointstiff.service.problems import StoreUnavailableError
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import RequestError

JOINTS = {"elasticity": "joints"}


def campaign(seed, name="", **options):
    document = simulate_campaign(default_arm(), load="pull", configurations=8, seed=seed, **options)
    document["robot"]["name"] = name or f"robot {seed}"
    return document


@pytest.fixture
def store(either_database_url):
    with Store.open(either_database_url) as opened:
        yield opened


@pytest.fixture
def claims(store, either_database_url):
    with closing(Claims(store, either_database_url)) as queue:
        yield queue


@pytest.fixture
def parts(store, claims):
    """The parts of a service that leaves long jobs to workers."""
    return Parts(store, claims.enqueue)


@pytest.fixture
def sets(parts):
    return [set_of(parts, campaign(seed)) for seed in range(5)]


@pytest.fixture
def two_a_step(monkeypatch):
    monkeypatch.setattr(fleet_work, "SETS_PER_STEP", 2)


def posted(parts, **request):
    return parts.jobs["fleet"].create(FleetRequest.model_validate({"run": JOINTS} | request), None).id


def current(parts, job):
    return parts.jobs["fleet"].current(job)


def run_of(parts, set_id, **options):
    record = parts.jobs["run"].create(RunRequest(measurement_set_id=set_id, **options), None)
    return parts.jobs["run"].current(record.id).result


def unloaded(document):
    """Return a campaign whose readings are positions without a load."""
    for observation in document["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            del reading["loaded"]
    return document


@pytest.mark.parametrize("options", [JOINTS, {}, {"elasticity": "joints", "leave_out": ["c01"]}])
def test_each_row_is_that_of_a_run_of_its_own_bit_for_bit(parts, claims, sets, two_a_step, options):
    job = posted(parts, measurement_set_ids=sets, run=options)
    claims.work_all(parts.jobs_of)
    fleet = current(parts, job)
    assert fleet.state == "succeeded"
    assert [row.measurement_set_id for row in fleet.result.rows] == sets
    assert [row.robot_name for row in fleet.result.rows] == [f"robot {seed}" for seed in range(5)]
    for row, set_id in zip(fleet.result.rows, sets, strict=True):
        run = run_of(parts, set_id, **options)
        assert row.verdict == run.assessment.verdict
        assert row.stiffness == {joint.name: joint.stiffness for joint in run.joints}
        assert row.stiffness_interval == {joint.name: joint.stiffness_interval for joint in run.joints}
    assert sum(fleet.result.counts.values()) == 5


def test_draws_change_no_number_of_a_row(parts, claims, sets):
    drawn = JOINTS | {"resampling": {"size": 6, "repetitions": 20, "seed": 1}}
    jobs = [posted(parts, measurement_set_ids=sets[:2], run=run) for run in (JOINTS, drawn)]
    claims.work_all(parts.jobs_of)
    plain, resampled = (current(parts, job) for job in jobs)
    assert plain.progress is None, "few sets without draws are identified at once"
    assert resampled.progress.total == 2
    assert plain.result.rows == resampled.result.rows


def test_a_set_that_fails_is_a_row_with_its_problem(parts, claims, sets, two_a_step):
    other = campaign(9)
    for text in ("joint_2", "joint_3"):
        other["robot"]["model"]["urdf"] = other["robot"]["model"]["urdf"].replace(text, f"other_{text}")
    alien, deleted = set_of(parts, other), set_of(parts, campaign(8))
    parts.sets.delete(deleted)
    run = JOINTS | {"stiffness_bounds": {"joint_2": [1.0, None]}}
    job = posted(parts, measurement_set_ids=[sets[0], alien, deleted, sets[1]], run=run)
    claims.work_all(parts.jobs_of)
    result = current(parts, job).result
    assert [row.error is None for row in result.rows] == [True, False, False, True]
    assert [row.verdict is None for row in result.rows] == [False, True, True, False]
    assert "joint_2" in result.rows[1].error.detail
    assert deleted in result.rows[2].error.detail
    assert (result.counts["failed"], result.rows[1].stiffness) == (2, {})
    with pytest.raises(RequestError) as refused:
        run_of(parts, alien, **run)
    assert refused.value.reason in result.rows[1].error.detail


@pytest.mark.parametrize(
    "options",
    [JOINTS, JOINTS | {"stiffness_bounds": {"joint_2": [1.0, None]}}, JOINTS | {"leave_out": ["c01", "no"]}],
    ids=["all fit", "one refused", "all refused"],
)
def test_a_fleet_and_identify_many_give_the_same_runs_of_the_same_campaigns(options):
    other = campaign(9)
    other["robot"]["model"]["urdf"] = other["robot"]["model"]["urdf"].replace("joint_2", "other_2")
    campaigns = [campaign(1), other, campaign(2)]
    rows = js.fleet(*campaigns, run=options).result.rows
    runs = list(js.identify_many(campaigns, js.RunOptions.model_validate(options)))
    assert len(rows) == len(runs) == 3
    for row, run in zip(rows, runs, strict=True):
        assert (row.error is None) == (run.error is None)
        if run.error is not None:
            said = [(each.type, each.detail, each.remedy, each.errors) for each in (row.error, run.error)]
            assert said[0] == said[1]
            assert row.error.where in run.error.where, "with the name of the campaign before it"
        else:
            assert row.verdict == run.result.assessment.verdict
            assert row.joint_kinds == run.result.joint_kinds
            assert row.stiffness == {joint.name: joint.stiffness for joint in run.result.joints}


def test_an_unexpected_fault_in_one_set_is_a_row(parts, claims, sets, two_a_step, monkeypatch):
    identify = one_of_many.prepare_identification

    def fail(inputs, request):
        if request.measurement_set_id == sets[3]:
            raise ZeroDivisionError
        return identify(inputs, request)

    monkeypatch.setattr(one_of_many, "prepare_identification", fail)
    job = posted(parts, measurement_set_ids=sets)
    claims.work_all(parts.jobs_of)
    rows = current(parts, job).result.rows
    assert [row.error and row.error.status for row in rows] == [None, None, None, 500, None]


def test_another_process_gets_the_sets_of_its_step_alone(parts, sets, two_a_step):
    """Of 10,000 sets all of them went with each of 1,000 calls."""
    job = posted(parts, measurement_set_ids=sets)
    work = parts.jobs["fleet"].work(job)
    sizes = [len(pickle.dumps(work.detach_for_step(span))) for span in work.steps()]
    assert len(sizes) == 3
    assert sizes[2] < 0.75 * sizes[0], "one set in place of two"


def test_a_database_that_does_not_answer_is_no_failed_fleet(parts, sets, monkeypatch):
    """A quick fleet reads its sets at its end; whoever posts it gets a 503, and posts it again."""

    def away(*_):
        raise StoreUnavailableError("no answer", "try again")

    monkeypatch.setattr(fleet_work, "prepare_identification", away)
    with pytest.raises(StoreUnavailableError):
        Parts(parts.store).jobs["fleet"].create(FleetRequest(measurement_set_ids=sets[:1], run=JOINTS), None)


def test_the_terminal_says_that_a_set_has_failed(tmp_path):
    """Complete pose needs three targets, of which one campaign has one."""
    few = campaign(1)
    for observation in few["measurement_set"]["observations"]:
        observation["readings"] = observation["readings"][:1]
    for name, document in {
        "all": campaign(0),
        "few": few,
        "options": {"run": {"method": "complete_pose"}},
    }.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(document))
    options = ("--options", tmp_path / "options.json")
    assert terminal("fleet", tmp_path / "all.json", *options).exit_code == 0
    both = terminal("fleet", tmp_path / "all.json", tmp_path / "few.json", *options)
    assert (both.exit_code, "failed" in both.stdout) == (1, True)


def test_it_is_cancelled_between_steps(parts, claims, sets, two_a_step, monkeypatch):
    compute, jobs = fleet_work.FleetWork.compute, parts.jobs["fleet"]
    job = posted(parts, measurement_set_ids=sets)
    assert current(parts, job).state == "queued"

    def cancelling(work, span):
        if span[0] == 2:
            jobs.cancel(job)
        return compute(work, span)

    monkeypatch.setattr(fleet_work.FleetWork, "compute", cancelling)
    claims.work_all(parts.jobs_of)
    ended = current(parts, job)
    assert (ended.state, ended.progress.done, ended.progress.total) == ("cancelled", 2, 5)


def test_after_a_death_the_sets_that_were_identified_are_kept(
    store, parts, claims, sets, two_a_step, monkeypatch
):
    compute, computed = fleet_work.FleetWork.compute, []

    def noted(work, span):
        computed.append(span)
        return compute(work, span)

    monkeypatch.setattr(fleet_work.FleetWork, "compute", noted)
    job = posted(parts, measurement_set_ids=sets)
    part, spans = claims.claim("dies"), parts.jobs["fleet"].work(job).steps()
    parts.jobs["fleet"].mark_running(job)
    assert store.steps.store_result(
        job, spans[0], pack_arrays(parts.jobs["fleet"].work(job).compute(spans[0]))
    )
    assert current(parts, job).progress.done == 2
    computed.clear()
    others = Parts(store, claims.enqueue)  # another worker
    others.jobs["fleet"].carry_out(part, claims)  # it counts the deaths over the part anew
    claims.work_all(others.jobs_of)
    assert (current(parts, job).state, computed) == ("succeeded", [(2, 4), (4, 5)])
    at_once = Parts(store).jobs["fleet"].create(FleetRequest(measurement_set_ids=sets, run=JOINTS), None)
    assert current(parts, job).result == current(parts, at_once.id).result


def test_without_ids_it_has_the_last_set_with_loads_of_each_robot_that_is_not_deleted(parts, claims):
    robots = {}
    for name, seed, when, change in (
        ("a", 1, "2026-05-01T00:00:00Z", None),
        ("a", 2, "2026-03-01T00:00:00Z", None),  # posted later, measured before
        ("b", 3, None, None),
        ("b", 4, None, unloaded),
        ("c", 5, None, unloaded),
        ("d", 6, None, None),
    ):
        document = campaign(seed, name)
        document["measurement_set"] |= {"measured_at": when} if when else {}
        document = change(document) if change else document
        if name in robots:
            readings = document["measurement_set"] | {"robot_id": robots[name][0]}
            set_id = parts.sets.create(MeasurementSetRequest.model_validate(readings), None).id
        else:
            set_id = set_of(parts, document)
        robots.setdefault(name, [parts.store.sets.get(set_id).robot_id]).append(set_id)
    parts.sets.delete(robots["d"][1])
    parts.robots.delete(robots["d"][0])
    job = posted(parts)
    expected = [robots["a"][1], robots["b"][1]]
    assert current(parts, job).request.measurement_set_ids == expected
    late = set_of(parts, campaign(7, "late"))
    claims.work_all(parts.jobs_of)
    fleet = current(parts, job)
    assert [row.measurement_set_id for row in fleet.result.rows] == expected
    assert late not in fleet.request.measurement_set_ids


def test_there_must_be_sets(parts):
    with pytest.raises(RequestError, match="no measurement set with loads"):
        posted(parts)


@pytest.fixture
def client(store):
    return Client(store)


def test_limits_and_unknown_ids_are_refused_with_their_places(client, parts, sets):
    def refused(ids):
        answer = client.request("POST", "/v1/fleets", json={"measurement_set_ids": ids})
        assert answer.status_code == 422, answer.text
        return answer.json()

    many = [f"set{i}" for i in range(MAX_SETS + 1)]
    assert refused(many)["where"] == "measurement_set_ids"
    assert refused([])["where"] == "measurement_set_ids"
    assert "duplicates" in refused([sets[0], sets[0]])["detail"]
    unknown = refused([sets[0], "nobody"])
    assert unknown["where"] == "measurement_set_ids[1]"
    assert "nobody" in unknown["detail"]
    assert refused(many[:-1])["where"] == "measurement_set_ids[0]"


def test_the_table_has_a_row_a_set_and_joint(client, parts, sets):
    deleted = set_of(parts, campaign(8))
    parts.sets.delete(deleted)
    body = {"measurement_set_ids": [sets[0], deleted], "run": JOINTS, "name": "after the update"}
    job = client.request("POST", "/v1/fleets", json=body).json()
    lines = client.get(f"/v1/jobs/{job['id']}/files/table.csv").text.splitlines()
    rows = list(csv.DictReader(lines))
    stated = job["result"]["rows"][0]
    assert {
        row["joint"]: float(row["stiffness [N.m/rad]"]) for row in rows if row["stiffness [N.m/rad]"]
    } == {name: value for name, value in stated["stiffness"].items() if value}
    assert [row["overall verdict"] for row in rows] == [stated["verdict"]] * 6 + [""]
    assert "was deleted" in rows[-1]["error"]
    tables = client.get(f"/v1/jobs/{job['id']}/files/tables.json").json()["tables"]
    assert [row[0] for row in tables[0]["rows"]] == ["failed", "do not use", "use with care", "use"]
    assert [row[0] for row in tables[1]["rows"]] == ["robot 8", "robot 0"], "what needs attention comes first"
    (listed,) = client.get("/v1/jobs?kind=fleet&name=after%20the%20update").json()["items"]
    assert listed["id"] == job["id"]
