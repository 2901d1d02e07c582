"""Pairs as resources: sets and runs of one robot beside each other, over HTTP and in a terminal."""

from __future__ import annotations

import io
import json
from functools import lru_cache

import pytest
from pydantic import ValidationError
from rich.console import Console
from support.shared_data import shared
from typer.testing import CliRunner

import jointstiff
from jointstiff.schemas.measurement import MeasurementSetRequest
from jointstiff.schemas.pair import Pair, PairRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run import RunRequest
from jointstiff.service.cli.app import app
from jointstiff.service.jobs.life import Parts
from jointstiff.service.kinds.pair import PAIR
from jointstiff.service.problems.errors import NotFoundError
from jointstiff.service.reports.job import job_report
from jointstiff.service.store.records import IdempotencyKey
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import RequestError, UnsupportedMethodError


@pytest.fixture
def parts(database_url):
    with Store.open(database_url) as store:
        yield Parts.of(store)


@pytest.fixture(scope="module")
def memory():
    with Store.open("sqlite://") as store:
        yield Parts.of(store)


def stored(parts, document, robot_id=None):
    """The ids of robot and set."""
    if robot_id is None:
        robot = RobotDocument.model_validate_json(json.dumps(document["robot"]))
        robot_id = parts.robots.create(robot, None).id
    readings = MeasurementSetRequest.model_validate_json(
        json.dumps(document["measurement_set"] | {"robot_id": robot_id})
    )
    return robot_id, parts.sets.create(readings, None).id


@lru_cache
def usual_robot(parts):
    """Stored once a store: a process of its own vets each URDF."""
    robot = simulate_campaign(default_arm(), configurations=1)["robot"]
    return parts.robots.create(RobotDocument.model_validate_json(json.dumps(robot)), None).id


def two_encoders(parts, **options):
    ids = []
    for k, encoders in enumerate(("motor", "secondary")):
        document = simulate_campaign(
            default_arm(encoders), load="pull", encoders=encoders, seed=7, sigma=2e-5 * (1 + k), **options
        )
        ids.append(stored(parts, document, usual_robot(parts))[1])
    return ids


def request(first, second, **changes):
    sides = {"first": {"measurement_set_id": first}, "second": {"measurement_set_id": second}}
    return PairRequest.model_validate(sides | changes)


def made(parts, body):
    return parts.jobs["pair"].current(parts.jobs["pair"].create(body, None).id)


def test_a_pair_is_stored_and_listed_on_every_database(parts):
    first, second = two_encoders(parts)
    key = IdempotencyKey("key", "hash")
    body = request(first, second, ordered=True)
    records = [parts.jobs["pair"].create(body, key) for _ in range(2)]
    assert records[0] == records[1]
    pair = parts.jobs["pair"].current(records[0].id)
    assert pair.state == "succeeded"
    assert Pair.model_validate_json(parts.jobs["pair"].document(pair.id)) == pair
    (entry,) = parts.jobs["pair"].page(PAIR.query()).items
    assert (entry.first_set_id, entry.second_set_id) == (first, second)
    for column, value in (("first_set_id", first), ("second_set_id", second), ("state", "succeeded")):
        assert len(parts.jobs["pair"].page(PAIR.query(**{column: value})).items) == 1
    assert not parts.jobs["pair"].page(PAIR.query(first_set_id=second)).items
    assert records[0].robot_id == entry.robot_id


def test_ratios_and_share_with_their_uncertainties(memory):
    pair = made(memory, request(*two_encoders(memory)))
    assert pair.result.ordered is None
    for joint, ratio in zip(pair.result.joints, (6.6 / 3.8, 5.7 / 3.1, 6.1 / 2.5, 1, 1, 1), strict=True):
        low, high = joint.ratio_interval
        assert low < joint.ratio < high
        assert abs(joint.ratio - ratio) < 2.5 * (high - low) / 2
        assert joint.first.stiffness
        assert joint.second.stiffness
    assert [joint.p_value < 1e-6 for joint in pair.result.joints[:3]] == [True] * 3
    avoided = pair.result.avoided
    assert avoided.matching == 19
    assert avoided.measured.value == pytest.approx(avoided.predicted, abs=0.02)
    assert {c.side for c in avoided.configurations} == {"both"}


def test_the_ordered_problem(memory):
    result = made(memory, request(*two_encoders(memory), ordered=True)).result
    for joint in result.ordered.joints:
        assert joint.compliance_second <= joint.compliance_first
        for value, interval in (
            (joint.compliance_first, joint.compliance_interval_first),
            (joint.compliance_second, joint.compliance_interval_second),
        ):
            assert interval[0] <= value <= interval[1]
    assert result.ordered.certificate.dual == 0.0
    assert any(joint.equal for joint in result.ordered.joints)


def test_sets_and_their_runs_give_the_same(memory):
    first, second = two_encoders(memory)
    options = {"method": "decoupled_partial_pose", "confidence": 0.8}
    runs = [
        memory.jobs["run"].create(RunRequest(measurement_set_id=set_id, **options), None).id
        for set_id in (first, second)
    ]
    by_set = made(memory, request(first, second, options=options))
    sides = {"first": {"run_id": runs[0]}, "second": {"run_id": runs[1]}, "confidence": 0.8}
    by_run = made(memory, PairRequest.model_validate(sides))
    assert by_run.result == by_set.result
    assert (by_run.first_set_id, by_run.second_set_id) == (first, second)


def test_units_a_and_b_are_two_robots(memory):
    document = simulate_campaign(default_arm(), load="pull", seed=3)
    (_, first), (_, second) = stored(memory, document, usual_robot(memory)), stored(memory, document)
    result = made(memory, request(first, second)).result
    assert not result.warnings
    other = simulate_campaign(default_arm(wrist_offset=0.02), load="pull", seed=3)
    _, third = stored(memory, other)
    (warning,) = made(memory, request(first, third)).result.warnings
    assert warning.code == "robot_models_differ"


def test_other_postures_are_said(memory):
    document, robot_id = simulate_campaign(default_arm(), load="pull", seed=3), usual_robot(memory)
    _, first = stored(memory, document, robot_id)
    _, second = stored(memory, simulate_campaign(default_arm(), load="pull", seed=4), robot_id)
    result = made(memory, request(first, second)).result
    assert result.avoided.matching == 0
    assert result.avoided.measured is None
    assert len(result.avoided.configurations) == 38
    assert result.assessment.verdict == "use_with_care"
    assert result.assessment.reasons[-1].code == "no_common_configuration"
    assert [warning.code for warning in result.warnings] == ["configurations_differ"]


def test_warnings_say_which_side(memory):
    document, robot_id = simulate_campaign(default_arm(), load="pull", seed=3), usual_robot(memory)
    _, first = stored(memory, document, robot_id)
    document["measurement_set"]["observations"][4]["force"] = [0.0, 0.0, 0.0]
    _, second = stored(memory, document, robot_id)
    result = made(memory, request(first, second)).result
    assert any(
        w.code == "zero_load" and w.where.startswith("second.observations[4]") for w in result.warnings
    )
    reasons = result.assessment.reasons
    assert any(r.code == "residuals_exceed_sigma" and r.where == "second" for r in reasons)


def test_a_result_does_not_depend_on_the_store(memory, database_url):
    body = {"ordered": True}
    results = []
    with Store.open(database_url) as store:
        for parts in (memory, Parts.of(store)):
            pair = made(parts, request(*two_encoders(parts), **body))
            results.append(pair.result)
    assert results[0] == results[1]


@pytest.mark.parametrize("side", ["first", "second"])
@pytest.mark.parametrize("field", ["measurement_set_id", "run_id"])
def test_what_is_not_there_is_refused_with_its_place(memory, side, field):
    first, second = two_encoders(memory, configurations=6)
    body = {"first": {"measurement_set_id": first}, "second": {"measurement_set_id": second}}
    with pytest.raises(RequestError) as refusal:
        memory.jobs["pair"].create(PairRequest.model_validate(body | {side: {field: "nobody"}}), None)
    assert refusal.value.where == f"{side}.{field}"


def test_a_method_that_the_readings_cannot_support_is_refused(memory):
    one_target = {"targets": {"P0": (0.1, 0.0, 0.1)}, "configurations": 8}
    first, second = two_encoders(memory, **one_target)
    with pytest.raises(UnsupportedMethodError):
        memory.jobs["pair"].create(request(first, second, options={"method": "complete_pose"}), None)


def test_other_robots_are_refused(memory):
    document = simulate_campaign(default_arm(), load="pull", seed=3)
    _, first = stored(memory, document, usual_robot(memory))
    document["robot"]["model"]["urdf"] = document["robot"]["model"]["urdf"].replace("joint_3", "elbow")
    _, second = stored(memory, document)
    with pytest.raises(RequestError, match="have different joints"):
        memory.jobs["pair"].create(request(first, second), None)


@pytest.mark.parametrize(
    "body",
    [
        {"first": {}, "second": {"run_id": "b"}},
        {"first": {"measurement_set_id": "a", "run_id": "b"}, "second": {"run_id": "b"}},
        {
            "first": {"run_id": "a"},
            "second": {"run_id": "b"},
            "options": {"resampling": {"size": 5, "repetitions": 5}},
        },
        {
            "first": {"run_id": "a"},
            "second": {"run_id": "b"},
            "options": {"priors": {"joint_2": {"stiffness": 1e6, "standard_uncertainty": 1e5}}},
        },
    ],
)
def test_bodies_that_make_no_sense(body):
    with pytest.raises(ValidationError):
        PairRequest.model_validate(body)


def test_a_run_with_a_prior_is_refused(memory):
    first, second = two_encoders(memory)
    priors = {"joint_2": {"stiffness": 3e6, "standard_uncertainty": 3e5}}
    run = memory.jobs["run"].create(RunRequest(measurement_set_id=first, priors=priors), None).id
    body = {"first": {"run_id": run}, "second": {"measurement_set_id": second}}
    with pytest.raises(RequestError, match="independent"):
        memory.jobs["pair"].create(PairRequest.model_validate(body), None)


def test_over_http(client):
    robot = None
    ids = []
    for encoders in ("motor", "secondary"):
        document = simulate_campaign(default_arm(encoders), load="pull", encoders=encoders, seed=7)
        robot = robot or client.post("/v1/robots", json=document["robot"]).json()["id"]
        body = document["measurement_set"] | {"robot_id": robot}
        ids.append(client.post("/v1/measurement-sets", json=body).json()["id"])
    sides = {"first": {"measurement_set_id": ids[0]}, "second": {"measurement_set_id": ids[1]}}
    response = client.post("/v1/pairs", json=sides | {"ordered": True})
    assert response.status_code == 201
    pair = response.json()
    assert client.get(response.headers["Location"]).json() == pair
    listed = client.get("/v1/pairs", params={"first_set_id": ids[0]}).json()["items"]
    assert [item["id"] for item in listed] == [pair["id"]]
    missing = client.post("/v1/pairs", json=sides | {"second": {"run_id": "nobody"}})
    assert (missing.status_code, missing.json()["where"]) == (422, "second.run_id")
    assert client.get("/v1/pairs/nobody").status_code == 404
    assert client.get("/v1/pairs", params={"colour": "red"}).status_code == 422


def test_not_found(memory):
    with pytest.raises(NotFoundError):
        memory.jobs["pair"].current("nobody")


@pytest.fixture
def files(tmp_path):
    paths = []
    for encoders in ("motor", "secondary"):
        document = simulate_campaign(default_arm(encoders), encoders=encoders, seed=7)
        paths.append(tmp_path / f"{encoders}.json")
        paths[-1].write_text(json.dumps(document))
    return [str(path) for path in paths]


def test_in_a_terminal(files):
    shown = CliRunner().invoke(app, ["pair", *files, "--ordered"], env={"COLUMNS": "100"})
    assert shown.exit_code == 0, shown.output
    assert "ratio" in shown.output
    assert "joint_2" in shown.output
    assert "never twists joint_1" in shown.output
    assert "held equal" in shown.output
    assert "19 observations on both sides" in shown.output


def test_as_json(files, tmp_path):
    options = tmp_path / "options.json"
    options.write_text('{"options": {"method": "complete_pose"}}')
    shown = CliRunner().invoke(app, ["pair", *files, "--options", str(options), "--json"])
    pair = Pair.model_validate_json(shown.stdout)
    assert pair.request.options.method == "complete_pose"
    assert pair.result.avoided.matching == 19


def test_a_file_that_is_refused_says_which(files, tmp_path):
    document = json.loads((tmp_path / "secondary.json").read_text())
    document["measurement_set"]["load_point"] = None
    (tmp_path / "secondary.json").write_text(json.dumps(document))
    shown = CliRunner().invoke(app, ["pair", *files])
    assert shown.exit_code == 2
    assert "second.measurement_set.observations[0].load_point" in shown.output


def test_shared_pair_in_a_terminal_of_80_columns(memory):
    robot_id = None
    ids = []
    for name in ("motor", "secondary"):
        robot_id, set_id = stored(memory, shared(f"simulated/dead_weight_{name}"), robot_id)
        ids.append(set_id)
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(job_report(PAIR, made(memory, request(*ids, ordered=True))))
    text = console.export_text()
    assert "(48.08 ± 0.21) %" in text
    assert max(map(len, text.splitlines())) <= 80


def test_an_assumed_load_point_is_the_same_on_both_sides():
    """Each side's intervals hold it, and the ratios are as narrow as with a load point stated as exact."""

    def paired(noise):
        documents = [simulate_campaign(default_arm(), load="pull", seed=seed) for seed in (1, 2)]
        for document in documents:
            document["measurement_set"]["noise"] = {"sigma": 2e-5} | noise
        return jointstiff.pair(*documents).result

    assumed, exact = paired({}), paired({"load_point": 1e-9})
    assert "±10 mm" in assumed.assessment.notes[0]
    for one, other in zip(assumed.joints, exact.joints, strict=True):
        assert one.ratio_interval == pytest.approx(other.ratio_interval, rel=1e-5)
        assert one.first.standard_uncertainty > 1.01 * other.first.standard_uncertainty
