"""Results come back: a saved or pickled result of any kind is the same result, and works like it."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from support.command_lines import refused, typed
from support.documents import own_weight
from support.guide_files import EXAMPLES
from support.weight_steps import simulate as simulate_step

import jointstiff as js
from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.library.client import Client
from jointstiff.simulator import default_arm, simulate_campaign

FORCE = (0, 0, -500.0)
POSTURES = [[0, 0, 0, 0, 30, 0], [10, 0, 0, 0, 30, 0]]
AREA = {
    "area": [[1400, -200, 600], [1800, 200, 600]],
    "grid": (2, 2, 1),
    "place": (0, 0, 250),
    "force": FORCE,
}
KINDS = [
    "run",
    "run by own weight",
    "run of a live campaign",
    "comparison",
    "geometry",
    "gearbox",
    "plan",
    "map",
    "program",
    "prediction",
    "trend",
]
IN_PROCESS = [*(name for name in KINDS if name != "trend"), "rehearsal"]  # a trend needs a store


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="pull", configurations=12, seed=3)


def measured_live(backend, document):
    """Return the run of a live campaign, whose readings a simulated tracker gave."""
    with backend.measure(document, "15 %", "simulated:1") as campaign:
        campaign.run_source(most=10)
        campaign.close()
    return campaign.run


def results_of(backend, document):
    run = backend.identify(document)
    return {
        "run": run,
        "run by own weight": backend.identify(own_weight(30, 1), weight={}),
        "run of a live campaign": measured_live(backend, document),
        "comparison": backend.compare(run, constraints=["positive"]),
        "geometry": backend.geometry(EXAMPLES / "sweeps.json"),
        "gearbox": backend.gearbox(simulate_step(3).document),
        "plan": backend.plan(run, readings=2, candidates=200),
        "map": backend.map(run, **AREA),
        "program": backend.correct(run, EXAMPLES / "pocket.src", accuracy_option="off", force=FORCE),
        "prediction": run.predict(POSTURES, FORCE, at=(0, 0, 120)),
    }


@pytest.fixture(scope="module")
def in_process(document):
    results = results_of(js, document)
    return results | {"rehearsal": js.rehearse(results["run"])}


@pytest.fixture(scope="module")
def by_client(document, served_in_process):
    with Client(served_in_process.url) as client:
        results = results_of(client, document)
        set_id = results["run"].request.measurement_set_id
        results["trend"] = client.trend(client.measurement_sets.get(set_id).robot_id)
        yield results


@pytest.fixture(
    params=[("in_process", name) for name in IN_PROCESS] + [("by_client", name) for name in KINDS]
)
def result(request):
    backend, name = request.param
    return request.getfixturevalue(backend)[name]


def test_each_kind_of_work_is_a_case():
    arrays = {"correction"}  # `correct` returns arrays, which are saved as tables
    assert {*KINDS} | arrays >= ROOMS.keys()


def test_the_runs_are_those_of_their_names(in_process):
    assert in_process["run by own weight"].result.weight is not None
    live = in_process["run of a live campaign"]
    assert live.campaign.measurement_set.name != in_process["run"].campaign.measurement_set.name


def test_a_saved_result_is_the_same_result(result, tmp_path):
    result.save(tmp_path / "result.json")
    loaded = js.load(tmp_path / "result.json")
    assert loaded == result
    assert type(loaded).__name__ == type(result).__name__
    assert (repr(loaded), str(loaded)) == (repr(result), str(result))
    for place, each in (("one", result), ("other", loaded)):
        each.save(tmp_path / f"{place}.csv")
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "other.csv").read_bytes()
    loaded.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "result.json").read_bytes()


def test_a_pickled_result_is_the_same_result(result):
    pickled = pickle.loads(pickle.dumps(result))
    assert pickled == result
    assert pickled.to_frame().equals(result.to_frame())


@pytest.mark.parametrize("backend", ["in_process", "by_client"])
def test_every_verb_accepts_a_saved_run(backend, request, tmp_path, document):
    results, file = request.getfixturevalue(backend), tmp_path / "run.json"
    results["run"].save(file)
    loaded = js.load(file)
    assert loaded.campaign.measurement_set.name == document["measurement_set"]["name"]
    assert js.identify(file).result == results["run"].result
    assert js.plan(file, readings=2, candidates=200).result == results["plan"].result
    assert js.map(file, **AREA).result == results["map"].result
    assert str(js.compare(file, constraints=["positive"])) == str(results["comparison"])  # other ids of runs
    program = js.correct(file, EXAMPLES / "pocket.src", accuracy_option="off", force=FORCE)
    assert program.result.program.worst == results["program"].result.program.worst
    assert js.rehearse(file).joints == js.rehearse(results["run"]).joints
    for predicted in (
        js.predict(file, POSTURES, FORCE, at=(0, 0, 120)),
        loaded.predict(POSTURES, FORCE, at=(0, 0, 120)),
    ):
        assert predicted == results["prediction"]
    (again,) = js.identify_many([file])
    assert again.result == results["run"].result
    loaded.export(tmp_path / "model.mjcf")
    loaded.report(tmp_path / "report.html")


@pytest.mark.parametrize("name", ["run", "run by own weight", "run of a live campaign"])
def test_a_client_accepts_a_saved_run(name, in_process, served_in_process, tmp_path):
    """Every verb that uses a run gives by a service what it gives in this process."""
    run, file = in_process[name], tmp_path / "run.json"
    run.save(file)
    cut = {"accuracy_option": "off", "force": FORCE}
    with Client(served_in_process.url) as client:
        assert client.identify(file).result == run.result
        for verb, arguments, options, view in (
            ("map", (), AREA, lambda result: result.places),
            ("correct", (EXAMPLES / "pocket.src",), cut, lambda result: result.program.worst),
        ):
            there, here = (getattr(each, verb)(file, *arguments, **options) for each in (client, js))
            assert view(there.result) == view(here.result), verb
        assert client.predict(file, POSTURES, FORCE, at=(0, 0, 120)) == (
            js.predict(file, POSTURES, FORCE, at=(0, 0, 120))
        )
        if name != "run by own weight":
            assert client.plan(file, readings=2, candidates=200).result == (
                js.plan(file, readings=2, candidates=200).result
            )
            assert str(client.compare(file)) == str(js.compare(file))


def test_a_run_keeps_the_options_with_which_it_was_identified(document, tmp_path):
    run = js.identify(document, method="complete_pose", leave_out=["c02"])
    run.save(tmp_path / "run.json")
    again = js.identify(tmp_path / "run.json")
    assert (again.request.method, again.request.leave_out) == ("complete_pose", ["c02"])
    assert again.result == run.result


COMMANDS = [
    "identify run.json",
    "compare run.json",
    "plan run.json --readings 2 --candidates 200",
    "map run.json --options area.json",
    "predict run.json postures.csv --load-point 0,0,120",
    "correct run.json pocket.src --accuracy-option off --force 0,0,-500 -o out.src",
    "export run.json -o model.csv",
    "report run.json -o report.html",
    "report plan.json -o plan.html",
    "report map.json -o map.html",
    "rehearse run.json",
    "rehearse plan.json --robot robot.json",
    "report comparison.json -o comparison.html",
    "report program.json -o program.html",
]


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_reads_a_saved_result(line, in_process, document, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("run", "plan", "map", "comparison", "program"):
        in_process[name].save(f"{name}.json")
    Path("robot.json").write_text(json.dumps(document["robot"]))
    area = AREA | {"area": [[1.4, -0.2, 0.6], [1.8, 0.2, 0.6]], "place": (0, 0, 0.25)}  # in SI units
    Path("area.json").write_text(json.dumps(area))
    for name in ("postures.csv", "pocket.src"):
        Path(name).write_bytes((EXAMPLES / name).read_bytes())
    assert typed(line)


def test_a_command_writes_a_result_that_python_reads(document, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("campaign.json").write_text(json.dumps(document))
    typed("identify campaign.json --save run.json")
    assert js.load("run.json").result == js.identify(document).result
    typed("plan run.json --readings 2 --candidates 200 --save plan.json")
    assert len(js.load("plan.json").result.readings) == 2


def test_a_file_of_another_kind_than_stated_is_refused(document, tmp_path, monkeypatch, in_process):
    monkeypatch.chdir(tmp_path)
    in_process["plan"].save("plan.json")
    Path("campaign.json").write_text(json.dumps(document))
    assert js.load("plan.json", "plan").result == js.load("plan.json").result
    assert js.load("campaign.json", "campaign").robot == js.load("campaign.json").robot
    with pytest.raises(js.CampaignError, match=r"plan\.json has the kind 'plan', not 'run'") as caught:
        js.load("plan.json", "run")
    assert caught.value.problem.remedy == 'use `jointstiff.load("plan.json", "plan")`'
    with pytest.raises(js.CampaignError, match="has the kind 'campaign', not 'run'"):
        js.load("campaign.json", "run")
    with pytest.raises(TypeError, match=r"kind must be one of: run, comparison, .*; not 'runs'"):
        js.load("plan.json", "runs")


def test_a_file_without_a_result_is_refused_by_its_name(tmp_path, monkeypatch, in_process):
    monkeypatch.chdir(tmp_path)
    Path("other.json").write_text('{"kind": "song"}')
    with pytest.raises(js.CampaignError, match=r"other\.json has the unknown kind 'song'"):
        js.load("other.json")
    Path("bare.json").write_text(in_process["run"].model_dump_json())  # as the API answers
    assert js.load("bare.json").result == in_process["run"].result
    with pytest.raises(js.CampaignError, match="a result without a campaign"):
        js.identify("bare.json")
    in_process["plan"].save("plan.json")
    assert "a result without a campaign" in refused("identify plan.json")
    for wrong in (
        {"campaign": 5},
        {"campaign": {}},
        {"request": 5},
        {"result": {"joints": 1}},
        {"made_from": [1]},
        {"made_from": {"kind": "run"}},
        {"tables": {"a": 1}},
        {"files": {"a": "é"}},
        {"kind": ["run"]},
        {"more": 1},
    ):
        document = json.loads(Path("bare.json").read_text()) | wrong
        Path("wrong.json").write_text(json.dumps(document))
        with pytest.raises(js.CampaignError):
            js.load("wrong.json")
    Path("large.json").write_bytes(b" " * (32 * 1024**2 + 1))
    with pytest.raises(js.CampaignError, match=r"large\.json exceeds 32 MiB"):
        js.load("large.json")
    Path("broken.json").write_text("[1, 2")
    with pytest.raises(js.CampaignError, match="Invalid JSON: EOF while parsing"):
        js.load("broken.json")


def test_stiffnesses_compliances_and_intervals_are_arrays(in_process):
    run = in_process["run"]
    joints = list(run.joints.values())
    assert run.stiffness.tolist() == [joint.stiffness for joint in joints]
    assert run.compliance.tolist() == [joint.compliance for joint in joints]
    assert run.conf_int().tolist() == [list(joint.compliance_interval) for joint in joints]
    assert run.conf_int("stiffness").tolist() == [list(joint.stiffness_interval) for joint in joints]
    assert np.sqrt(np.diag(run.covariance)) == pytest.approx([joint.standard_uncertainty for joint in joints])


def test_a_joint_without_a_number_is_nan_and_without_an_upper_end_infinite():
    run = js.identify(simulate_campaign(default_arm(), load="dead_weight", configurations=12, seed=3))
    unseen = [name for name, joint in run.joints.items() if joint.stiffness is None]
    assert unseen
    numbers = dict(zip(run.joints, run.stiffness, strict=True))
    assert [name for name, number in numbers.items() if np.isnan(number)] == unseen
    ends = dict(zip(run.joints, run.conf_int("stiffness"), strict=True))
    assert np.isnan(ends[unseen[0]]).all() or np.isinf(ends[unseen[0]][1])


def test_the_names_of_a_result_are_ours(in_process):
    for name, result in in_process.items():
        names = dir(result)
        assert {"plot", "save", "summary", "to_frame"} <= set(names), name
        assert not [each for each in names if each.startswith("model_") or each in {"copy", "dict", "json"}]


def test_a_trend_of_an_earlier_version_is_read(by_client, tmp_path):
    """Its campaigns had no verdict of their own, and it had all campaigns."""
    trend = by_client["trend"]
    trend.save(tmp_path / "trend.json")
    document = json.loads((tmp_path / "trend.json").read_text())
    del document["campaign_count"], document["schema"]
    for campaign in document["campaigns"]:
        del campaign["verdict"]
    (tmp_path / "old.json").write_text(json.dumps(document))
    read = js.load(tmp_path / "old.json")
    assert read.campaigns == trend.campaigns
    assert read.campaign_count == len(trend.campaigns) > 0
