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
    ("order", "remedy"),
    [((1, 0, 2), "transpose(1, 0, 2)"), ((2, 0, 1), "transpose(1, 2, 0)"), ((1, 2, 0), "transpose(2, 0, 1)")],
)
def test_exchanged_axes_of_readings_are_exchanged_back(document, arrays, order, remedy):
    """Three targets have three coordinates, so that only the axis of the observations shows its place."""
    loaded = arrays["loaded"][:, :2].transpose(order)
    unloaded = arrays["unloaded"][:, :2].transpose(order)
    answer = refused(document, arrays, unloaded=unloaded, loaded=loaded)
    assert answer.endswith(f"its axes seem to be exchanged; remedy: give unloaded.{remedy}")
    inverse = np.argsort(order).tolist()
    assert f"transpose({', '.join(map(str, inverse))})" == remedy
    given = {"unloaded": unloaded.transpose(inverse), "loaded": loaded.transpose(inverse)}
    assert js.Campaign.from_arrays(document["robot"], **(arrays | given))


def test_transposed_forces_and_rows_of_single_readings_are_arranged(document, arrays):
    answer = refused(document, arrays, forces=arrays["forces"].T)
    assert answer.endswith("its axes seem to be exchanged; remedy: give forces.T")
    answer = refused(document, arrays, unloaded=arrays["unloaded"].reshape(-1, 3))
    assert answer.endswith("target after target; remedy: give unloaded.reshape(12, 3, 3)")


def test_arrays_that_are_all_transposed_are_named_one_after_another(document, arrays):
    """A column for each posture, as of MATLAB; readings by target."""
    turned = {"joints": arrays["joints"].T, "forces": arrays["forces"].T}
    for state in ("unloaded", "loaded"):
        turned[state] = {f"P{t}": each.T for t, each in enumerate(np.moveaxis(arrays[state], 1, 0))}
    answer = refused(document, arrays, **turned)
    assert "`joints` has 6 rows, but 12 observations were read" in answer
    turned["joints"] = arrays["joints"]
    for state in ("unloaded", "loaded"):
        answer = refused(document, arrays, **(turned | {"forces": arrays["forces"]}))
        assert answer.endswith(f"remedy: give {{target: array.T for target, array in {state}.items()}}")
        turned[state] = {target: array.T for target, array in turned[state].items()}
    assert refused(document, arrays, **turned).endswith("remedy: give forces.T")
    turned["forces"] = arrays["forces"]
    assert js.Campaign.from_arrays(document["robot"], **(arrays | turned))


@pytest.mark.parametrize("name", ["joints", "forces"])
def test_an_observation_that_lacks_numbers_is_named_and_left_out(document, arrays, name):
    lacking = arrays[name].copy()
    lacking[[4, 7], 1] = np.nan
    answer = refused(document, arrays, **{name: lacking})
    assert f"`{name}` lacks numbers in observations 5, 8 (counted from 1); remedy: give these" in answer
    assert answer.endswith(f"array[np.isfinite({name}).all(axis=1)]")
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
        with pytest.raises(js.CampaignError, match="a tool is not a joint, and its length belongs to"):
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
        (b"{'robot': None}", "seems to be printed by Python"),
        (b'{"robot": {"name": "a"', "ends in the middle of the JSON document"),
        ("Use: all 6 joints\n│ joint_1 │\n".encode(), "is a table that jointstiff printed"),
        (b"// mine\n{}", "begins with a comment"),
        (b"[laboratory]\nname = 1\n", "is a text in TOML"),
        (
            b'{"robot": 1}\n{"robot": 1}',
            "has further text after the end of the JSON document",
        ),
        (b"campaign.json", "is only the name 'campaign.json' of a file"),
    ],
)
def test_a_file_that_is_no_document_is_named(tmp_path, document, content, cause):
    path = tmp_path / "cut.json"
    path.write_bytes(content)
    with pytest.raises(js.CampaignError, match=re.escape(cause)):
        js.identify(path)
    path.write_text(json.dumps(document))
    assert js.identify(path)
