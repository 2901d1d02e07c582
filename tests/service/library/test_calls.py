"""Calls with wrong arguments name what was given, and the call that works."""

import numpy as np
import pytest

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)


@pytest.fixture(scope="module")
def arrays(document):
    """Angles [deg], forces [N], and positions without and with load [m]."""
    rows = document["measurement_set"]["observations"]
    joints = np.degrees([row["joints"] for row in rows])
    unloaded, loaded = (
        np.array([[reading[state] for reading in row["readings"]] for row in rows])
        for state in ("unloaded", "loaded")
    )
    return joints, np.array([row["force"] for row in rows]), unloaded, loaded


@pytest.mark.parametrize("verb", ["identify", "plan", "compare"])
def test_bare_arrays_are_named_by_their_shapes_in_the_call_that_works(verb, arrays):
    with pytest.raises(js.CampaignError) as refused:
        getattr(js, verb)(*arrays)
    assert isinstance(refused.value, TypeError)
    problem = refused.value.problem
    shapes = ("(12, 6)", "(12, 3)", "(12, 3, 3)", "(12, 3, 3)")
    assert problem.detail.startswith(f"{verb}({', '.join(f'array {shape}' for shape in shapes)})")
    assert (
        "jointstiff.Campaign.from_arrays(ROBOT, joints, forces, unloaded=…, loaded=…, load_point=…)"
        in problem.remedy
    )
    for named in (
        "joints is argument 1, (12, 6)",
        "forces is argument 2, (12, 3)",
        "unloaded and loaded are arguments 3 and 4, (12, 3, 3)",
    ):
        assert named in problem.remedy


def test_the_call_that_is_named_works(document, arrays):
    joints, forces, unloaded, loaded = arrays
    campaign = js.Campaign.from_arrays(
        document["robot"],
        joints,
        forces,
        unloaded=unloaded,
        loaded=loaded,
        load_point=document["measurement_set"]["load_point"],
        units="m, deg, N, N.m",
    )
    assert js.identify(campaign).state == "succeeded"


def test_arrays_of_uncertain_shapes_are_not_named(document, arrays):
    joints, forces, unloaded, _ = arrays
    one_target = unloaded[:, 0]
    with pytest.raises(js.CampaignError) as refused:
        js.identify(joints, forces, one_target, one_target)
    assert "joints is argument 1, (12, 6); forces (N, 3); positions without and with load (N, T, 3)" in (
        refused.value.problem.remedy
    )


CALLS = {
    "no campaign": (lambda _: js.identify(), "missing a required argument: 'campaign'", "identify(campaign"),
    "by name": (lambda c: js.identify(campaign=c), "campaign", "give `campaign` without its name"),
    "options as mapping": (
        lambda c: js.identify(c, {"loss": "huber"}),
        "not a dict",
        "identify(campaign, loss=…",
    ),
    "number as option": (lambda c: js.plan(c, 6), "PlanOptions, not a int", "plan(source, option=value)"),
    "too many": (lambda c: js.map(c, 1, 2), "map(dict, 1, 2): too many", "call map(run, option=value)"),
    "no postures": (lambda c: js.predict(c), "argument: 'postures'", "call predict(run, postures, forces"),
    "array of a file": (lambda _: js.read([1.0, 2.0]), "`files` is an array", "call read(*files"),
    "constructor": (lambda _: js.Campaign("a.json"), "no arguments by position", "`Campaign.read(path)`"),
    "no robot": (lambda _: js.Campaign.from_arrays(np.ones((9, 6)), np.ones((9, 3))), "not a robot", "ROBOT"),
    "misspelt array": (
        lambda c: js.Campaign.from_arrays(c["robot"], np.ones((9, 6)), loadedd=1),
        "from_arrays() has no argument `loadedd`",
        "give `loaded` in its place",
    ),
    "readings of gears": (lambda _: js.gearbox(np.ones((3, 3))), "`readings` is an array", "call gearbox("),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_call_names_what_was_given_and_the_call_that_works(name, document):
    mistake, reason, remedy = CALLS[name]
    with pytest.raises(js.CampaignError) as refused:
        mistake(document)
    assert isinstance(refused.value, TypeError)
    assert reason in refused.value.problem.detail
    assert remedy in refused.value.problem.remedy


def test_rows_of_denavit_and_hartenberg_are_still_a_robot():
    rows = np.array([[0.0, 400.0, 100.0, 90.0]] * 6)
    assert js.robot(rows, columns="theta d a alpha", convention="standard").model is not None


def test_an_unknown_option_is_answered_with_the_options_there_are(document):
    with pytest.raises(js.CampaignError, match="verbose: unknown field") as refused:
        js.identify(document, verbose=True)
    assert refused.value.problem.remedy.startswith("remove this field, or use one of causes, ")
    assert "measurement_set_id" not in refused.value.problem.remedy


FORCE = {"place": [0, 0, 250], "force": [0, 0, -500]}
VALUES = {
    "units in texts": (
        lambda c: js.Campaign.from_arrays(c["robot"], [["10 deg"] * 6], unloaded=[[1.0] * 3]),
        "`joints` has texts such as '10 deg', not numbers",
        "units='mm, deg, N'",
    ),
    "rows of several lengths": (
        lambda c: js.Campaign.from_arrays(c["robot"], [[1.0] * 6, [1.0] * 3], unloaded=[[1.0] * 3] * 2),
        "`joints` has rows of different lengths: 6 in the first, 3 in row 2",
        "give every row the same number of values",
    ),
    "corners as one list": (
        lambda c: js.map(c, area=[1400, -200, 600, 1800, 200, 600], grid=[3, 3, 1], **FORCE),
        "area: must have at most 2 items",
        "give two corners of the box, each with its x, y and z",  # in any unit
    ),
    "cause as a text": (
        lambda c: js.identify(c, causes="play"),
        "must be a list",
        'such as [{"name": "play"}]',
    ),
}


@pytest.mark.parametrize("name", VALUES)
def test_a_wrong_value_is_answered_with_what_works(name, document):
    mistake, reason, remedy = VALUES[name]
    with pytest.raises(js.CampaignError) as refused:
        mistake(document)
    assert reason in refused.value.problem.detail
    assert remedy in refused.value.problem.remedy


@pytest.mark.parametrize("read", [js.identify, js.load, js.read])
def test_a_folder_in_the_place_of_a_file_is_answered_with_files_of_the_folder(read, tmp_path):
    (tmp_path / "day1.json").write_text("{}")
    with pytest.raises(js.CampaignError) as refused:
        read(tmp_path)
    assert isinstance(refused.value, IsADirectoryError)
    assert refused.value.problem.remedy == f"give a file in it: {tmp_path / 'day1.json'}"


def test_files_in_a_list_are_given_one_by_one(tmp_path):
    file = tmp_path / "readings.csv"
    file.write_text("J1 [deg]\n1\n")
    with pytest.raises(js.CampaignError, match=r"read\(\*files\)"):
        js.read([file])


def test_a_table_alone_is_not_named_as_joints():
    with pytest.raises(js.CampaignError) as refused:
        js.plan([[0.0, -90.0, 0.35, 0.675]] * 6)
    assert "joints is argument" not in str(refused.value)
