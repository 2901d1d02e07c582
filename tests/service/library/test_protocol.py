"""One protocol: each verb takes the same arguments in process, over a client, and awaited; same numbers."""

import json
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest
from anyio.from_thread import start_blocking_portal
from support.guide_files import ROOT

import jointstiff as js
from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.simulator import default_arm, simulate_campaign

EXAMPLES = ROOT / "examples"
DOCUMENT = simulate_campaign(default_arm(), load="pull", configurations=10, seed=4)
FORCE = np.array([0.0, 0.0, -500.0])
AREA = [[1.4, -0.2, 0.6], [1.8, 0.2, 0.6]]
POSTURES = [[0, -20, 30, 0, 45, 0], [40, -10, 5, 7, 30, 2]]


class Awaited:
    """An `AsyncClient` whose calls are waited for."""

    def __init__(self, client, portal):
        self._client, self._portal = client, portal

    def __getattr__(self, name):
        method = getattr(self._client, name)
        return lambda *sources, **options: self._portal.call(partial(method, *sources, **options))


@contextmanager
def opened(door, services):
    database, _, awaited = door.partition(" ")
    if database == "here":
        yield js
    elif awaited:
        with start_blocking_portal() as portal:
            client = js.AsyncClient(services(database).url)
            yield Awaited(client, portal)
            portal.call(partial(client.__aexit__, None, None, None))
    else:
        with js.Client(services(database).url) as client:
            yield client


@pytest.fixture(scope="module", params=["here", "sqlite", "sqlite awaited"])
def door(request, services):
    with opened(request.param, services) as verbs:
        yield verbs


@pytest.fixture(scope="module")
def sources(door, tmp_path_factory):
    """The same campaign as all that a verb takes."""
    path = tmp_path_factory.mktemp("contract") / "campaign.json"
    path.write_text(json.dumps(DOCUMENT))
    campaign = js.Campaign.read(path)
    here = js.identify(path)
    run = door.identify(path)
    return {
        "path": path,
        "text": str(path),
        "document": DOCUMENT,
        "campaign": campaign,
        "run": run,
        "run of elsewhere": here,
    }


def program(result):
    worst = [point.model_dump() for point in result.result.worst]
    return result.result.points, result.result.corrected, worst


VERBS = {
    "identify": (
        lambda door, source: door.identify(source, method="complete_pose"),
        lambda run: run.result.joints,
    ),
    "compare": (
        lambda door, source: door.compare(source, constraints=["positive"]),
        lambda job: [entry.model_copy(update={"run_id": "r"}) for entry in job.result.entries],
    ),
    "plan": (lambda door, source: door.plan(source, readings=4, candidates=100), lambda job: job.result),
    "map": (
        lambda door, source: door.map(source, area=AREA, grid=(2, 2, 1), place=(0, 0, 0.25), force=FORCE),
        lambda job: job.result,
    ),
    "compensate": (
        lambda door, source: door.compensate(
            source, EXAMPLES / "pocket.src", accuracy_option="off", force=FORCE
        ),
        program,
    ),
    "predict": (
        lambda door, source: door.predict(source, POSTURES, FORCE, at=(0, 0, 0.12)),
        lambda result: result.displacement.tolist(),
    ),
}
"""Each verb of a campaign or a run: the call, and what of its result is the same everywhere."""
ALIKE = ["path", "text", "document", "campaign", "run", "run of elsewhere"]


@pytest.fixture(scope="module")
def expected():
    return {name: view(call(js, DOCUMENT)) for name, (call, view) in VERBS.items()}


def by_day(verb, form):
    """Tell whether a case is of the day: all forms of a campaign and a run, and each verb with two forms."""
    return verb in {"identify", "map"} or form in {"path", "run of elsewhere"}


@pytest.mark.parametrize(
    ("verb", "form"),
    [
        pytest.param(verb, form, marks=() if by_day(verb, form) else pytest.mark.slow)
        for verb in VERBS
        for form in ALIKE
    ],
)
def test_a_verb_takes_a_file_a_document_a_campaign_or_a_run(door, sources, expected, verb, form):
    call, view = VERBS[verb]
    assert view(call(door, sources[form])) == expected[verb]


def test_the_verbs_of_other_sources(door, tmp_path):
    """Sweeps as file, document and message; a robot by name; postures as file and cases; tables."""
    sweeps = json.loads((EXAMPLES / "sweeps.json").read_text())
    forms = [EXAMPLES / "sweeps.json", sweeps, js.GeometryRequest.model_validate(sweeps)]
    points = [[axis.base.point for axis in door.geometry(form).result.axes] for form in forms]
    here = [axis.base.point for axis in js.geometry(EXAMPLES / "sweeps.json").result.axes]
    np.testing.assert_allclose(points, [here] * 3, rtol=0, atol=1e-12)
    options = {"readings": 4, "candidates": 100, "load": {"kind": "any_direction", "force": 1000.0}}
    options |= {"targets": {"P": [0.0, 0.0, 0.1]}}
    path = tmp_path / "robot.json"
    path.write_text(js.robot("KUKA KR 210 R2700 extra").model_dump_json())
    name = "KUKA KR 210 R2700 extra"
    arms = [name, js.robot(name), path, json.loads(path.read_text())]
    expected = js.plan(name, **options).result
    assert all(door.plan(arm, **options).result == expected for arm in arms)
    of_table = door.predict(DOCUMENT, EXAMPLES / "postures.csv", load_point=(0, 0, 0.12))
    case = {"label": "drill", "joints": [10, -20, 30, 0, 45, 0], "force": (0, 0, -800)}
    of_cases = door.predict(DOCUMENT, [case], load_point=(0, 0, 0.12), units="m, deg, N")
    np.testing.assert_allclose(of_table.displacement, of_cases.displacement, rtol=1e-12)


@pytest.mark.parametrize("form", ALIKE)
def test_a_live_campaign_is_measured_alike(door, sources, form):
    """The same readings in the same order, the same state after each, and the same run of the closed set."""
    with (
        door.measure(sources[form], "15 %", "simulated:1") as there,
        js.measure(DOCUMENT, goal="15 %", source="simulated:1") as here,
    ):
        state = there.run_source(most=3)
        assert state.readings == here.run_source(most=3).readings
        assert state.next == here.state.next
        assert there.close().joints == here.close().joints
    assert door.identify(there.run).joints == here.run.joints


def test_files_are_imported_alike(door):
    stated = {"encoders": "motor", "load_point": (0, 0, 120)}
    for options in (stated, stated | {"robot": "KUKA KR 210 R2700 extra"}):
        answer = door.import_files(EXAMPLES / "readings.csv", **options)
        assert answer == js.import_files(EXAMPLES / "readings.csv", **options)
        assert len(answer.measurement_set.observations) == 12


def test_what_a_reason_advises_is_applied_alike(door):
    """Unloaded and loaded are exchanged in the file; the run's action puts them right."""
    wrong = json.loads(json.dumps(DOCUMENT))
    for observation in wrong["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            reading["unloaded"], reading["loaded"] = reading["loaded"], reading["unloaded"]
    mended = door.identify(wrong).apply("exchange_readings")
    for name, joint in js.identify(DOCUMENT).joints.items():
        if joint.compliance is not None:
            assert mended.joints[name].compliance == pytest.approx(joint.compliance, rel=1e-6)


def test_every_verb_is_tested_and_every_door_has_it(door):
    tested = {*VERBS, "geometry", "measure", "import_files"}
    verbs = {name for name in js.__all__ if name.islower() and name != "robot"}
    assert tested == {room.command for room in ROOMS.values()} | verbs
    assert all(callable(getattr(door, verb)) for verb in tested)


STEPPED = {"repetitions": 100_000, "size": 500}


def test_progress_is_told_and_work_is_cancelled(door):
    told, options = [], {"elasticity": "joints", "resampling": STEPPED}
    long = simulate_campaign(default_arm(), load="pull", configurations=1_000, seed=4)  # six seconds of draws
    run = door.identify(long, **options, on_progress=told.append, cancel=lambda: bool(told))
    assert run.state == "cancelled"
    assert 0 < told[0].done + 1 <= told[0].total == STEPPED["repetitions"]


def test_a_result_of_any_door_writes_the_same_files(door, sources, tmp_path):
    run, contents = sources["run"], []
    for each in (run, js.identify(DOCUMENT)):
        area = door.map(each, area=AREA, grid=(2, 2, 1), place=(0, 0, 0.25), force=FORCE)
        milled = door.compensate(each, EXAMPLES / "pocket.src", accuracy_option="off", force=FORCE)
        each.save(tmp_path / "arm.urdf")
        area.save(tmp_path / "map.csv")
        milled.save(tmp_path / "out.src")
        points = milled.to_frame()
        named = milled.request.run_id
        texts = [(tmp_path / name).read_text().replace(named, "") for name in ("map.csv", "out.src")]
        contents.append([*texts, list(points["deflection [mm]"])])
    assert contents[0] == contents[1]
    assert run.campaign.measurement_set == js.Campaign.read(sources["path"]).measurement_set
    assert door.identify(run.campaign).joints == run.joints
