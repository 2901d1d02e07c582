"""Mistakes of users in Python: the answer names the cause, and its remedy, carried out, works."""

import copy
import json
import re
from pathlib import Path

import numpy as np
import pytest

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import JointstiffError

FORCE, AT = (0.0, 0.0, -500.0), (0, 0, 120)
ZERO = np.zeros((2, 6))
AREA = {
    "area": [[1400, -200, 600], [1800, 200, 600]],
    "grid": (2, 2, 1),
    "place": (0, 0, 250),
    "force": FORCE,
}


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="pull", configurations=8, seed=3)


@pytest.fixture(scope="module")
def run(document):
    return js.identify(document)


def option(wrong, right):
    """Return a mistake in an option of `identify`, and its correction."""
    return lambda _, document: js.identify(document, **wrong), lambda _, document: js.identify(
        document, **right
    )


def first_observation(wrong, right):
    """Return a mistake in the first observation of a campaign, and its correction."""

    def identify(changes):
        def call(_, document):
            changed = copy.deepcopy(document)
            changed["measurement_set"]["observations"][0].update(changes)
            return js.identify(changed)

        return call

    return identify(wrong), identify(right)


def of_run(wrong, right):
    """Return a mistake in a call with a run, and its correction; both are functions of the run."""
    return lambda run, _: wrong(run), lambda run, _: right(run)


def of_joints(change):
    """Return the arrays of a campaign with changed joints as a mistake, and the campaign as correction."""

    def build(joints_of):
        def call(_, document):
            observations = document["measurement_set"]["observations"]
            joints = np.array([observation["joints"] for observation in observations])
            return js.Campaign.from_arrays(
                document["robot"],
                joints_of(joints),
                forces=[observation["force"] for observation in observations],
                deflections=np.full((len(joints), 1, 3), 0.1),
                load_point=AT,
                targets={"P": (0.0, 0.0, 100.0)},
            )

        return call

    return build(change), build(lambda joints: joints)


def with_infinite_angle(joints):
    """Return the joints with an infinite angle of joint_2 in observation 4."""
    changed = joints.copy()
    changed[3, 1] = np.inf
    return changed


def of_arrays(wrong, right):
    """Return an argument of `Campaign.from_arrays` as a mistake, and its correction."""

    def build(changes):
        def call(_, document):
            observations = document["measurement_set"]["observations"]
            arrays = {
                "joints": [observation["joints"] for observation in observations],
                "forces": [observation["force"] for observation in observations],
                "deflections": np.full((len(observations), 1, 3), 0.1),
                "load_point": AT,
                "targets": {"P": (0.0, 0.0, 100.0)},
            }
            return js.Campaign.from_arrays(document["robot"], **(arrays | changes))

        return call

    return build(wrong), build(right)


def with_joints_named(name):
    """Return a comparison with another set, of a robot whose joints are called `name`1, `name`2, …"""

    def call(_, document):
        other = copy.deepcopy(document)
        other["robot"]["model"]["urdf"] = other["robot"]["model"]["urdf"].replace("joint_", name)
        del other["measurement_set"]["observations"][-1]
        return js.compare(document, other)

    return call


def exchanging(first, second):
    """Return a weight step in whose readings `first` has the angles of `second`, and the reverse."""

    def call(_, _document):
        step = copy.deepcopy(weight_step())
        readings = [each for row in step["observations"] for each in row["encoder_readings"]]
        for state in (each[name] for each in readings for name in ("unloaded", "loaded")):
            state["motor"], state["link"] = state[first], state[second]
        found = js.gearbox(step)
        refused = [each for each in found.result.assessment.reasons if each.weight == "do_not_use"]
        if refused:
            raise ValueError(f"{refused[0].message}; remedy: {refused[0].remedy}")
        return found

    return call


def weight_step():
    """Return the document of the example of a weight step."""
    return json.loads((Path(__file__).parents[3] / "examples" / "weight_step.json").read_text())


def with_centre(centre):
    """Return an identification of the robot with one body, whose centre of mass is given [m]."""

    def call(_, document):
        body = {"name": "arm", "joint": "joint_2", "mass": 200.0, "centre": centre}
        return js.identify(document | {"robot": document["robot"] | {"bodies": [body]}})

    return call


def with_flange(link):
    """Return an identification of the robot whose flange is a link of the URDF."""

    def call(_, document):
        model = document["robot"]["model"] | {"flange": link}
        return js.identify(document | {"robot": document["robot"] | {"model": model}})

    return call


def observing(factor):
    """Return a live reading whose positions are `factor` times those in m."""

    def call(_, document):
        first = document["measurement_set"]["observations"][0]
        with js.measure(document, goal="15 %", source=None) as live:
            unloaded, loaded = (
                {each["target"]: factor * np.array(each[state]) for each in first["readings"]}
                for state in ("unloaded", "loaded")
            )
            joints, force = np.degrees(first["joints"]), first["force"]
            return str(live.observe(unloaded, loaded, label="a", joints=joints, force=force))

    return call


POSES = np.array([[1700.0, 100.0, 900.0, 0.0, 180.0, 0.0], [1710.0, 110.0, 900.0, 0.0, 180.0, 0.0]])
START = np.array([3.0, -45.0, 70.0, 0.0, 65.0, 0.0])


def corrected_from(start):
    return lambda run: run.correct(POSES, tool=[0, 0, 250, 0, 0, 0], forces=FORCE, start=start)


MISTAKES = {
    "joints of other names": (
        with_joints_named("A"),
        with_joints_named("joint_"),
        "both robots have the same axes: rename the joints in the second robot's URDF, A1 to joint_1, A2 to",
    ),
    "motor and link exchanged": (
        exchanging("link", "motor"),
        exchanging("motor", "link"),
        "motor and link angles of joint_2 seem to be exchanged.*exchange `motor` and `link`",
    ),
    "centre of mass in mm": (
        with_centre([20.0, -90.0, 520.0]),
        with_centre([0.02, -0.09, 0.52]),
        r"528.1 m from its joint.*seem to be in mm; remedy: give the centre in m.*\[0.02, -0.09, 0.52\]",
    ),
    "flange before the wrist": (
        with_flange("link_4"),
        with_flange("flange"),
        "there are 6 joint angles, but the robot has 4 joints",
    ),
    "live positions in metres": (
        observing(1.0),
        observing(1000.0),
        "of the origin of their frame: their unit seems to be wrong",
    ),
    "start in radians": (
        *of_run(corrected_from(np.radians(START)), corrected_from(START)),
        "the start seems to be in radians, not in degrees.*give the start in degrees: 3, -45, 70, 0, 65, 0",
    ),
    # Arguments of another type
    "no quantity": (
        *of_arrays({"units": {"lenght": "mm"}}, {"units": {"length": "mm"}}),
        "'mm' is not a known unit of lenght; remedy: .*length m, mm",
    ),
    "sigma with unit": (
        *of_arrays({"sigma": "20 um"}, {"sigma": 0.02}),
        "`sigma` is '20 um'.*such as 0.02 in mm",
    ),
    "negative sigma": (*of_arrays({"sigma": -0.02}, {}), "`sigma` is -0.02.* or leave it out"),
    "number of targets": (
        *of_arrays({"targets": 1}, {"targets": {"P1": (0, 0, 100)}}),
        r"`targets` is 1.* such as {'P1': \(0, 0, 100\)}",
    ),
    "infinite force": (
        *of_arrays({"forces": (0, 0, float("inf"))}, {"forces": FORCE}),
        r"`forces` has an infinite value at \[2\]; remedy: give finite numbers$",
    ),
    "infinite angle": (
        *of_joints(with_infinite_angle),
        r"`joints` has an infinite value at \[3, 1\]",
    ),
    "no arm of this name": (
        lambda _, _document: js.robot("KUKA KR210"),
        lambda _, _document: js.robot("KUKA KR 210 R2700 extra"),
        "^robot: .*'KUKA KR210' is not the whole name of one arm .*: KUKA KR 210 R2700 extra",
    ),
    # Arrays in another form
    "joints transposed": (*of_joints(np.transpose), r"`deflections` has the shape .*, not \(6, "),
    "joints None": (*of_joints(lambda _: None), r"joints.*shape"),
    "forces with moments": (
        *of_arrays({"forces": np.ones((8, 6))}, {"forces": np.ones((8, 3)), "moments": np.ones((8, 3))}),
        r"`forces` has the shape \(8, 6\), not \(3,\) or \(8, 3\)",
    ),
    "prior as a pair": (
        *option(
            {"priors": {"joint_2": (3e6, 1e5)}},
            {"priors": {"joint_2": {"stiffness": 3e6, "standard_uncertainty": 1e5}}},
        ),
        "give its fields by name, in braces",
    ),
    "observations by number": (
        *option({"leave_out": [3]}, {"leave_out": ["c03"]}),
        "give labels of observations as texts, in quotes, not their numbers",
    ),
    "no such label": (
        *option({"leave_out": ["3"]}, {"leave_out": ["c03"]}),
        "no observation '3'.*c01, c02, .*c08",
    ),
    "postures in radians": (
        *of_run(
            lambda run: run.predict(np.radians([[0, -20, 30, 0, 45, 0]]), FORCE, at=AT),
            lambda run: run.predict(np.radians([[0, -20, 30, 0, 45, 0]]), FORCE, at=AT, units="mm, rad, N"),
        ),
        "they seem to be radians; remedy: state the unit of the angles: units='mm, rad, N'",
    ),
    "a plan in place of a run": (
        lambda _, document: js.map(js.plan(document, readings=3, candidates=50), **AREA),
        lambda _, document: js.map(js.identify(document), **AREA),
        r"not `Plan`; remedy: give the campaign itself, or the run that `identify` makes of it",
    ),
    "another word for a convention": (
        lambda _, _document: js.robot(
            [[0.0, 700.0, 300.0, -90.0]] * 2, columns="theta d a alpha", convention="mdh", units="mm, deg"
        ),
        lambda _, _document: js.robot(
            [[0.0, 700.0, 300.0, -90.0]] * 2,
            columns="theta d a alpha",
            convention="modified",
            units="mm, deg",
        ),
        "'mdh', not 'standard' or 'modified'.*state convention='standard' or convention='modified'",
    ),
    "misspelt option": (*option({"methd": "CP"}, {"method": "CP"}), "methd: unknown field"),
    # Values
    "percent": (*option({"confidence": 95}, {"confidence": 0.95}), "must be less than or equal to 0.9999"),
    "method": (*option({"method": "partial"}, {"method": "partial_pose"}), "must be .*'partial_pose'"),
    "loss": (*option({"loss": "l1"}, {"loss": "huber"}), "must be 'squared', 'huber'"),
    "truth as a text": (*option({"positive": "yes"}, {"positive": True}), "give true or false"),
    "one label": (*option({"leave_out": 3}, {"leave_out": ["c03"]}), "must be a list"),
    "label": (*option({"leave_out": ["c99"]}, {"leave_out": ["c08"]}), "no observation 'c99'"),
    "weighting": (*option({"weighting": "none"}, {"weighting": "uniform"}), "must be .*'uniform'"),
    "elasticity": (
        *option({"elasticity": "joint"}, {"elasticity": "joints"}),
        "must be 'joints', 'joints_and_base'",
    ),
    "sampling": (
        *option({"resampling": 8}, {"resampling": {"size": 6, "repetitions": 10}}),
        "give its fields by name",
    ),
    "prior of no joint": (
        *option(
            {"priors": {"J1": {"stiffness": 3e6, "standard_uncertainty": 1e6}}},
            {"priors": {"joint_1": {"stiffness": 3e6, "standard_uncertainty": 1e6}}},
        ),
        "no joint 'J1'; remedy: use one of joint_1",
    ),
    "order": (
        *option({"stiffness_order": ["joint_2", "joint_4"]}, {"stiffness_order": [["joint_2", "joint_4"]]}),
        "must be a list",
    ),
    "length without weighting": (
        *option(
            {"characteristic_length": 500},
            {"characteristic_length": 500, "weighting": "characteristic_length", "method": "CP"},
        ),
        "needs the weighting `characteristic_length`",
    ),
    # Readings
    "nan": (*first_observation({"force": [float("nan"), 0, 0]}, {}), r"force\[0\]: must be a finite number"),
    "text": (*first_observation({"force": ["a", 0, 0]}, {}), r"force\[0\]: must be a number"),
    "two components": (
        *first_observation({"force": [1, 2]}, {}),
        r"force\[2\]: entry 3 of the list is missing",
    ),
    "None": (*first_observation({"joints": None}, {}), r"observations\[0\].joints: must be a list"),
    "five angles": (
        *first_observation({"joints": [0] * 5}, {}),
        r"observations\[1\].joints: .*'c02' has 6 joint angles, but the first observation has 5",
    ),
    "one label twice": (*first_observation({"label": "c02"}, {}), "give every observation a unique label"),
    "no campaign": (
        lambda _, _document: js.identify(None),
        lambda _, document: js.identify(document),
        "a campaign is a file, a document",
    ),
    # Results
    "no joint": (
        *of_run(lambda run: run.joints["J2"], lambda run: run.joints["joint_2"]),
        "its joints are joint_1, joint_2",
    ),
    "level of an interval": (
        *of_run(lambda run: run.conf_int(0.05), lambda run: run.conf_int("stiffness")),
        "give `compliance` or `stiffness`",
    ),
    "no table": (
        *of_run(lambda run: run.to_frame("resid"), lambda run: run.to_frame("residuals")),
        "its tables are joints, residuals",
    ),
    "no joint to draw": (
        *of_run(lambda run: run.plot(joints=["J1"]), lambda run: run.plot(joints=["joint_1"])),
        "the joints are joint_1",
    ),
    "no campaign of this name": (
        *of_run(lambda _: js.datasets.load("fanuc"), lambda _: js.datasets.load("fanuc_r2000ic")),
        "use one of .*fanuc_r2000ic",
    ),
    # Predictions and maps
    "five angles to predict": (
        *of_run(
            lambda run: run.predict(np.zeros((2, 5)), FORCE, at=AT),
            lambda run: run.predict(ZERO, FORCE, at=AT),
        ),
        "give the 6 controller angles",
    ),
    "angle that is nan": (
        *of_run(
            lambda run: run.predict(ZERO * np.nan, FORCE, at=AT), lambda run: run.predict(ZERO, FORCE, at=AT)
        ),
        "must be a finite number",
    ),
    "shape of forces": (
        *of_run(
            lambda run: run.predict(ZERO, np.zeros((3, 3)), at=AT),
            lambda run: run.predict(ZERO, np.full((2, 3), 9.0), at=AT),
        ),
        r"`forces` has the shape \(3, 3\), not \(3,\) or \(2, 3\)",
    ),
    "no forces": (
        *of_run(lambda run: run.predict(ZERO, at=AT), lambda run: run.predict(ZERO, forces=FORCE, at=AT)),
        "`forces` are missing",
    ),
    "far point": (
        *of_run(
            lambda run: run.predict(ZERO, FORCE, at=(0, 0, 99999)),
            lambda run: run.predict(ZERO, FORCE, at=(0, 0, 99.999)),
        ),
        "check the unit of the point",
    ),
    "point as a text": (
        *of_run(
            lambda run: run.predict(ZERO, FORCE, at="flange"),
            lambda run: run.predict(ZERO, FORCE, at=(0, 0, 100)),
        ),
        "^prediction.at: .*could not convert string to float: 'flange'",
    ),
    "point of two coordinates": (
        *of_run(
            lambda run: run.predict(ZERO, FORCE, at=(0, 100)),
            lambda run: run.predict(ZERO, FORCE, at=(0, 0, 100)),
        ),
        r"`at` has the shape \(2,\)",
    ),
    "unit": (
        *of_run(
            lambda run: run.predict(ZERO, FORCE, at=AT, units="mm, deg, newton"),
            lambda run: run.predict(ZERO, FORCE, at=AT, units="mm, deg, N"),
        ),
        "'newton' is not a known unit; remedy: .*force N",
    ),
    "no area": (
        *of_run(lambda run: js.map(run, force=FORCE), lambda run: js.map(run, **AREA)),
        "area: required field is missing; remedy: add this field",
    ),
    "other word for a force": (
        *of_run(
            lambda run: js.map(run, **{**AREA, "force": None}, forces=FORCE),
            lambda run: js.map(run, **AREA),
        ),
        "force: must be a list",
    ),
    # Corrections and plans
    "poses": (
        *of_run(
            lambda run: run.correct(np.zeros((1, 5)), tool=np.eye(4), forces=FORCE, joints=ZERO[:1]),
            lambda run: run.correct([[1700, 0, 1500, 0, 1.5, 0]], tool=(0, 0, 0, 0, 0, 0), forces=FORCE),
        ),
        r"give poses \(N, 4, 4\), or \(N, 6\)",
    ),
    "number of readings": (
        *of_run(
            lambda run: js.plan(run, readings=0, candidates=50),
            lambda run: js.plan(run, readings=1, candidates=50),
        ),
        "must be greater than or equal to 1",
    ),
    "criterion": (
        *of_run(
            lambda run: js.plan(run, readings=1, candidates=50, criterion="D"),
            lambda run: js.plan(run, readings=1, candidates=50, criterion="d"),
        ),
        "must be .*'d'",
    ),
    "goal": (
        *of_run(
            lambda run: js.plan(run, goal="15", candidates=50),
            lambda run: js.plan(run, goal="15 %", candidates=50),
        ),
        'write "15 %" for every joint',
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_answered_with_a_remedy_that_works(run, document, name):
    mistake, correction, answer = MISTAKES[name]
    with pytest.raises((js.CampaignError, JointstiffError, KeyError, ValueError)) as refused:
        mistake(run, document)
    assert re.search(answer, str(refused.value)), str(refused.value)
    assert "openapi" not in str(refused.value)
    done = correction(run, document)
    assert getattr(done, "state", "succeeded") == "succeeded"


def test_an_ending_that_no_file_has_is_answered_with_those_that_work(run, tmp_path):
    with pytest.raises(ValueError, match="must end in ") as refused:
        run.save(tmp_path / "run.docx")
    endings = re.findall(r"(\.\w+)(?=,| or|$)", str(refused.value).partition("must end in ")[2])
    assert endings == [".json", ".csv", ".xlsx", ".svg", ".png", ".html", ".pdf", ".mjcf"]
    for ending in endings:
        run.save(tmp_path / f"run{ending}")
        assert (tmp_path / f"run{ending}").stat().st_size > 0


MISSING = {
    "campaign": js.identify,
    "result": js.load,
    "robot": lambda path: js.robot(path.with_suffix(".urdf")),
    "readings": js.read,
    "table": lambda path: js.predict(simulate_campaign(default_arm(), configurations=8), path),
}


@pytest.mark.parametrize("name", MISSING)
def test_a_missing_file_is_answered_with_its_folder(name, tmp_path):
    with pytest.raises(
        js.CampaignError, match=r"there is no file '.*missing\.\w+', in the folder"
    ) as refused:
        MISSING[name](tmp_path / "missing.json")
    assert isinstance(refused.value, FileNotFoundError)
    assert refused.value.problem.remedy == "give the name of a file that exists"


def test_a_misspelt_file_is_answered_with_the_name_that_works(document, tmp_path):
    js.Campaign.model_validate(document).save(tmp_path / "campaign.json")
    with pytest.raises(js.CampaignError) as refused:
        js.identify(tmp_path / "campaing.json")
    right = refused.value.problem.remedy.removeprefix("give ")
    assert js.identify(right).state == "succeeded"


def test_an_option_is_named_only_where_it_exists(document):
    """`resampling` is an option of `identify`: a plan has none."""
    with pytest.raises(js.CampaignError, match="bootstrap: unknown field") as refused:
        js.plan(document, bootstrap=100)
    assert "resampling" not in str(refused.value)


@pytest.mark.parametrize("source", [None, 3, 2.5])
def test_no_number_and_no_nothing_is_a_robot(source):
    with pytest.raises(js.CampaignError, match=r"robot.source: .* describes no robot; remedy: give a file,"):
        js.robot(source)


TYPES = {
    "number of processes": (
        lambda run: js.identify(run, resampling={"size": 6, "repetitions": 10}, executor=4),
        "give `concurrent.futures.ProcessPoolExecutor\\(\\)`, or leave it out",
    ),
    "number of processes for many": (lambda run: js.identify_many([run], executor=4), "or leave it out"),
}


@pytest.mark.parametrize("name", TYPES)
def test_an_argument_of_another_type_is_answered_with_what_to_give(run, name):
    mistake, answer = TYPES[name]
    with pytest.raises(TypeError, match=answer):
        mistake(run)


def test_a_word_for_axes_is_answered_with_what_draws(run):
    with pytest.raises(ValueError, match=r"`ax` is 'stiffness'.*leave it out"):
        run.plot("stiffness")
    assert run.plot().axes


def test_a_missing_table_is_answered_with_its_folder(tmp_path):
    with pytest.raises(js.CampaignError, match=r"there is no file .*; remedy: give the name of a file"):
        js.read(tmp_path / "readings.csv")


@pytest.mark.parametrize("source", ["document", "campaign"])
def test_a_campaign_is_a_robot_in_any_form(document, source):
    campaign = document if source == "document" else js.identify(document).campaign
    assert js.robot(campaign).name == document["robot"]["name"]


def test_readings_too_wrong_for_a_fit_fail_with_the_mistake_that_was_found():
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    for observation in document["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            reading["loaded"] = [1000.0 * each for each in reading["loaded"]]
    failed = js.identify(document)
    assert (failed.state, failed.error.status) == ("failed", 422)
    assert "they seem to be in mm where the others are in m" in failed.error.detail
    assert failed.error.remedy.startswith("convert all loaded readings from mm to m")
