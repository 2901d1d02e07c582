"""Mistakes in arrays, tables and files: the answer names the cause, and its remedy, carried out, works."""

import copy
import json
import re

import numpy as np
import pytest

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign

TABLE = [
    (0, 0, 780, 0),
    (330, -90, 0, -90),
    (1120, 0, 0, 0),
    (60, -90, 1310, 0),
    (0, 90, 0, 0),
    (0, -90, 240, 180),
]
"""a, alpha, d, theta of the arm that is measured, in mm and degrees, in the modified convention."""
SIGNS = (1, 1, 1, -1, 1, -1)


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="pull", configurations=12, seed=3)


@pytest.fixture(scope="module")
def arrays(document):
    observations = document["measurement_set"]["observations"]
    read = [[[r["unloaded"], r["loaded"]] for r in each["readings"]] for each in observations]
    positions = np.array(read)
    return {
        "joints": np.array([each["joints"] for each in observations]),
        "forces": np.array([each["force"] for each in observations]),
        "unloaded": positions[:, :, 0],
        "loaded": positions[:, :, 1],
        "load_point": document["measurement_set"]["load_point"],
        "units": "m, rad, N",
    }


def refused(document, arrays, **changes):
    with pytest.raises(js.CampaignError) as answer:
        js.Campaign.from_arrays(document["robot"], **(arrays | changes))
    return str(answer.value)


@pytest.mark.parametrize(
    ("name", "wrong", "expected"),
    [
        ("unloaded", lambda a: a[:, :2].transpose(1, 0, 2), "(12, 12, 3)"),
        ("unloaded", lambda a: a.reshape(-1, 3), "(12, 1, 3)"),
        (
            "unloaded",
            lambda a: {f"P{t}": each.T for t, each in enumerate(np.moveaxis(a, 1, 0))},
            "(12, 3, 3)",
        ),
        ("forces", lambda a: a.T, "(3,) or (12, 3)"),
    ],
)
def test_an_array_in_another_order_is_refused_with_the_expected_shape(
    document, arrays, name, wrong, expected
):
    answer = refused(document, arrays, **{name: wrong(arrays[name])})
    assert f"`{name}` has the shape" in answer
    assert f"not {expected}" in answer


@pytest.mark.parametrize("name", ["joints", "forces"])
def test_an_observation_that_lacks_numbers_is_named_and_left_out(document, arrays, name):
    lacking = arrays[name].copy()
    lacking[[4, 7], 1] = np.nan
    answer = refused(document, arrays, **{name: lacking})
    assert f"`{name}` lacks numbers in row 5; remedy: give these numbers, or leave out such rows" in answer
    kept = np.isfinite(lacking).all(axis=1)
    rest = {each: arrays[each][kept] for each in ("joints", "forces", "unloaded", "loaded")}
    assert js.Campaign.from_arrays(document["robot"], **(arrays | rest))


@pytest.mark.parametrize(
    ("order", "cause", "mend"),
    [
        (lambda f: np.roll(f, 1, axis=0), "shifted by one row", lambda f: np.roll(f, -1, axis=0)),
        (lambda f: np.roll(f, -2, axis=0), "shifted by 2 rows", lambda f: np.roll(f, 2, axis=0)),
        (lambda f: f[::-1], "in reverse order", lambda f: f[::-1]),
    ],
)
def test_forces_of_other_rows_are_named_with_their_order(document, arrays, order, cause, mend):
    forces = order(arrays["forces"])
    answer = js.identify(js.Campaign.from_arrays(document["robot"], **(arrays | {"forces": forces})))
    reason = answer.result.assessment.reasons[0]
    assert (reason.code, reason.message.partition(cause)[0][:10]) == (
        "observations_out_of_order",
        "the forces",
    )
    assert cause in reason.message
    if "rows" in cause:
        assert "the force of each observation is 2 rows before its own row" in reason.remedy
    mended = js.identify(js.Campaign.from_arrays(document["robot"], **(arrays | {"forces": mend(forces)})))
    assert mended.result.assessment.verdict == "use"


def described(rows=TABLE, convention="modified", **fields):
    """Return the document of the arm by a table."""
    names = ("a", "alpha", "d", "theta")
    return {
        "name": "cell 7",
        "payload": 240,
        "model": {
            "format": "dh",
            "convention": convention,
            "length_unit": "mm",
            "angle_unit": "deg",
            "rows": [dict(zip(names, row, strict=True)) for row in rows],
        },
        "joint_map": {"offset": [0] * 6, "matrix": np.diag(SIGNS).tolist()},
        **fields,
    }


@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        (described(convention="standard"), "in the convention modified"),
        (described([(d, al, a, th) for a, al, d, th in TABLE]), "with the columns a and d exchanged"),
        (described([(a, th, d, al) for a, al, d, th in TABLE]), "with the columns alpha and theta exchanged"),
        (described([(-a, al, d, th) for a, al, d, th in TABLE]), "with the opposite signs of a"),
        (described(TABLE[::-1]), "with the rows in reverse order"),
        (described([*TABLE[:3], TABLE[4], TABLE[3], TABLE[5]]), "with the rows 4 and 5 exchanged"),
        (described([(a, np.radians(al), d, th) for a, al, d, th in TABLE]), "with alpha in rad"),
        (
            described([(a, np.radians(al), d, np.radians(th)) for a, al, d, th in TABLE]),
            "with all angles in rad",
        ),
        (described([(a, al, -d, th) for a, al, d, th in TABLE]), "with the opposite signs of d"),
    ],
)
def test_a_mistaken_table_is_named(document, wrong, cause):
    """The simulated arm has this table: the readings fit the right table."""
    answer = js.identify(document | {"robot": wrong})
    assert cause in answer.result.assessment.reasons[0].message


def test_a_table_in_another_unit_of_angles_is_read_again_in_the_unit_that_is_named(document):
    in_radians = described([(a, np.radians(al), d, np.radians(th)) for a, al, d, th in TABLE])
    (reason, *_) = js.identify(document | {"robot": in_radians}).result.assessment.reasons
    assert reason.remedy.startswith("set `angle_unit` of the Denavit-Hartenberg table to `rad`")
    in_radians["model"]["angle_unit"] = "rad"
    assert js.identify(document | {"robot": in_radians}).result.assessment.verdict == "use"


def test_a_tool_as_a_row_of_the_table_is_named(document):
    rows = [*TABLE, (0, 0, 120, 0)]
    without_map = described(rows, joint_map=None)
    for wrong in (described(rows), without_map):
        with pytest.raises(
            js.CampaignError, match=r"a tool is not a joint|6 joint angles, but the robot has 7"
        ):
            js.identify(document | {"robot": wrong})
    assert js.identify(document | {"robot": described()}).result.assessment.verdict == "use"


@pytest.mark.parametrize(("payload", "unit"), [(2354, "in N (240 kg)"), (2400, "in N (245 kg)")])
def test_a_payload_in_another_unit_is_one_of_two_causes(document, payload, unit):
    changed = copy.deepcopy(document)
    changed["robot"]["payload"] = payload
    (reason,) = [
        each
        for each in js.identify(changed).result.assessment.reasons
        if each.code == "stiffness_against_payload"
    ]
    assert f"the payload of {payload:g} kg is {unit}".replace("2.4e+05", "240000") in reason.message.replace(
        " ", " "
    )
    assert ("or the forces are in" in reason.message, reason.action) == (True, None)
    assert "state `payload` in kg" in reason.remedy
    changed["robot"]["payload"] = 240
    assert js.identify(changed).result.assessment.verdict == "use"


@pytest.mark.parametrize("goal", [0.15, 15])
def test_a_number_is_no_goal(document, goal):
    for verb in (js.plan, js.measure):
        with pytest.raises(js.CampaignError, match=re.escape(f"'{goal}' is not a goal")) as answer:
            verb(document, goal=goal)
        assert 'write "15 %" for every joint' in str(answer.value)


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        (b"", "is empty"),
        (b"{'robot': None}", "Invalid JSON: key must be a string at line 1 column 2"),
        (b'{"robot": {"name": "a"', "Invalid JSON: EOF while parsing an object at line 1 column"),
        ("Use: all 6 joints\n│ joint_1 │\n".encode(), "is a table that jointstiff printed"),
        (b"// mine\n{}", "is a text, not a JSON document"),
        (b"[laboratory]\nname = 1\n", "Invalid JSON: expected value at line 1 column 2"),
        (
            b'{"robot": 1}\n{"robot": 1}',
            "Invalid JSON: trailing characters at line 2 column 1",
        ),
        (b"campaign.json", "is a text, not a JSON document"),
    ],
)
def test_a_file_that_is_no_document_is_named(tmp_path, document, content, cause):
    path = tmp_path / "cut.json"
    path.write_bytes(content)
    with pytest.raises(js.CampaignError, match=re.escape(cause)):
        js.identify(path)
    path.write_text(json.dumps(document))
    assert js.identify(path)
