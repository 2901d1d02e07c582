"""Mistakes that are planted in readings: what is said of each, and what the advised action gives."""

import json
from math import degrees, pi
from pathlib import Path

import pytest
from support.documents import campaign, changed
from support.terminal import terminal

from jointstiff.simulator import TARGETS

OBSERVATIONS = "measurement_set.observations"


@pytest.fixture(scope="module")
def clean():
    places = {name: list(place) for name, place in TARGETS.items()}
    return changed(campaign(configurations=12, seed=8), ("measurement_set.flange_targets", places))


def each(document, key, change):
    """Change a part of every observation."""
    observations = [one | {key: change(one[key])} for one in document["measurement_set"]["observations"]]
    return changed(document, (OBSERVATIONS, observations))


def of_states(document, change):
    """Change the two positions of every reading."""
    return each(document, "readings", lambda rows: [row | change(row) for row in rows])


def columns_exchanged(document):
    return each(document, "joints", lambda q: [q[0], q[2], q[1], *q[3:]])


def load_point_and_target_exchanged(document):
    measured = document["measurement_set"]
    return changed(
        document,
        ("measurement_set.load_point", measured["flange_targets"]["P11"]),
        ("measurement_set.flange_targets.P11", measured["load_point"]),
    )


MISTAKES = {
    "degrees as radians": lambda d: each(d, "joints", lambda q: list(map(degrees, q))),
    "kilonewtons as newtons": lambda d: each(d, "force", lambda f: [1e-3 * x for x in f]),
    "forces turned round": lambda d: each(d, "force", lambda f: [-x for x in f]),
    "states exchanged": lambda d: of_states(d, lambda r: {"unloaded": r["loaded"], "loaded": r["unloaded"]}),
    "states of a target exchanged": lambda d: of_states(
        d, lambda r: {"unloaded": r["loaded"], "loaded": r["unloaded"]} if r["target"] == "P10" else {}
    ),
    "columns exchanged": columns_exchanged,
    "zero elsewhere": lambda d: each(d, "joints", lambda q: [*q[:2], q[2] + pi / 2, *q[3:]]),
    "millimetres as metres": lambda d: of_states(
        d, lambda r: {state: [1e3 * x for x in r[state]] for state in ("unloaded", "loaded")}
    ),
    "load point and target exchanged": load_point_and_target_exchanged,
    "noise far too small": lambda d: changed(d, ("measurement_set.noise", {"sigma": 1e-7})),
}
MENDED = {"load point and target exchanged": "use_with_care", "noise far too small": "use_with_care"}
"""Verdicts after the first action, where it is not `use`: what was refuted stays on record."""
SAID = [
    row.split(" | ")
    for row in Path(__file__).with_name("planted_mistakes.txt").read_text(encoding="utf-8").splitlines()
]
"""Mistake, joints identified, and of each reason its code, weight, action, message, and remedy."""


@pytest.mark.parametrize("name", MISTAKES)
def test_each_mistake_is_said_with_what_remedies_it(local, clean, name):
    body = MISTAKES[name](clean) | {"run": {"elasticity": "joints"}}
    run = local.request("POST", "/v1/campaigns", json=body).json()
    assessment = run["result"]["assessment"]
    assert assessment["verdict"] == "do_not_use"
    identified = str(assessment["joints_identified"])
    kinds = [(each["action"] or {"kind": "-"})["kind"] for each in assessment["reasons"]]
    assert [
        [name, identified, each["code"], each["weight"], kind, each["message"], each["remedy"]]
        for each, kind in zip(assessment["reasons"], kinds, strict=True)
    ] == [row for row in SAID if row[0] == name]
    assert (
        "If N and kgf were confused, every stiffness would be wrong by a factor of 9.81"
        in assessment["notes"][0]
    )
    answer = local.request("POST", f"/v1/runs/{run['id']}/apply", json=assessment["reasons"][0]["action"])
    assert answer.status_code == 201, answer.text
    mended = answer.json()["result"]["assessment"]
    assert (mended["verdict"], mended["joints_identified"]) == (MENDED.get(name, "use"), 6)


def test_the_terminal_shows_numbers_before_and_after_an_action(tmp_path, clean):
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps(columns_exchanged(clean)))

    def applied(action):
        return terminal("identify", file, "--elasticity", "joints", "--apply", action, width=120)

    first, again, unknown = map(applied, ("exchange_columns", "exchange_columns", "dance"))
    words = " ".join(first.output.split())
    for line in [
        "Before and after",
        "│ verdict │ do not use │ use │",
        "│ explained │ 83.4 % │ 98.6 % │",
        "│ rms residual │ 609 µm │ 44.2 µm │",
        "│ joint_1 │ 2.868 (",
        "│ joint_4 │ — │ 0.434 (",
        "stiffness (interval) in 10⁶ N·m/rad",
        "Use: all 6 joints passed the checks",
        "│ joint_5 │ 0.2529 │ 0.2396 … 0.2678 │ determined │",
    ]:
        assert line in words
    written = tmp_path / "wrong-exchange-columns.json"
    assert first.exit_code == 0
    assert "".join(first.stderr.split()) == f"wrote{written}"
    assert json.loads(written.read_text())["measurement_set"]["observations"][0]["joints"] == pytest.approx(
        clean["measurement_set"]["observations"][0]["joints"]
    )
    assert again.exit_code == unknown.exit_code == 2
    assert "".join(again.stderr.split()) == (f"{written}existsremedy:chooseanothername,oruse--overwrite")
    assert " ".join(unknown.stderr.split()) == (
        "apply: the assessment does not recommend 'dance' remedy: give one of: exchange_columns"
    )
