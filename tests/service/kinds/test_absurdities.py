"""Nothing says *use* above what nobody can use: planted absurdities, and the head line of each result."""

from __future__ import annotations

import pytest
from support.guide_files import ROOT

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign

DOCUMENT = simulate_campaign(default_arm(), load="pull", configurations=19, seed=1)
WEIGHTS = simulate_campaign(default_arm(), configurations=19, seed=1)
POCKET = ROOT / "examples" / "pocket.src"
POSTURE = [[0, -20, 30, 0, 45, 0]]
POINT = (0, 0, 0.12)
AREA = {"area": [[1.4, -0.2, 0.6], [1.8, 0.2, 0.6]], "grid": (3, 3, 1), "place": (0, 0, 0.25)}
FAR = AREA | {"area": [[14.0, -2.0, 6.0], [18.0, 2.0, 6.0]]}
ACCEPTED = {"accept_verdict": "do_not_use"}
MILLING = {"accuracy_option": "off"}


@pytest.fixture(scope="module")
def run():
    return js.identify(DOCUMENT)


@pytest.fixture(scope="module")
def by_weights():
    run = js.identify(WEIGHTS)
    assert run.joints["joint_1"].stiffness is None
    return run


KILONEWTONS = (0, 0, -500_000)
ABSURD = {
    "prediction, kN for N": lambda run, _: run.predict(POSTURE, KILONEWTONS, at=POINT),
    "prediction, mm for m in the load point": lambda run, _: run.predict(
        POSTURE, (0, 0, -500), load_point=(0, 0, 120), place=POINT
    ),
    "prediction, mm for m in the place": lambda run, _: run.predict(
        POSTURE, (0, 0, -500), load_point=POINT, place=(0, 0, 120)
    ),
    "prediction, a few metres": lambda run, _: run.predict(POSTURE, (0, 0, -500), at=(0, 0, 4.0)),
    "prediction, joint without a number": lambda _, less: less.predict(POSTURE, (0, 500, 0), at=POINT),
    "map, kN for N": lambda run, _: js.map(run, force=KILONEWTONS, **AREA),
    "map, mm for m": lambda run, _: js.map(run, force=(0, 0, -500), **AREA | {"place": (0, 0, 250)}),
    "map, no place reached": lambda run, _: js.map(run, force=(0, 0, -500), **FAR),
    "map, joint without a number": lambda _, less: js.map(less, force=(0, 500, 0), **AREA),
    "program, kN for N": lambda run, _: js.compensate(run, POCKET, force=KILONEWTONS, **MILLING),
    "program, all capped": lambda run, _: js.compensate(
        run, POCKET, force=(0, 0, -500), limits={"displacement": 1e-4}, **MILLING
    ),
    "program, all capped, accepted": lambda run, _: js.compensate(
        run, POCKET, force=(0, 0, -500), limits={"displacement": 1e-4}, **MILLING, **ACCEPTED
    ),
    "program, nothing to correct": lambda run, _: js.compensate(run, POCKET, force=(0, 0, 0), **MILLING),
    "plan, joint without a load": lambda *_: js.plan(WEIGHTS, readings=4, candidates=100),
    "run, joint without a number": lambda _, less: less,
}


@pytest.mark.parametrize("name", ABSURD)
def test_no_head_says_use(name, run, by_weights):
    try:
        result = ABSURD[name](run, by_weights)
    except js.CampaignError as refused:
        assert refused.problem.remedy  # noqa: PT017 - one of two outcomes
        return
    head = str(result).splitlines()[0]
    if name.startswith("run"):
        assert head.startswith("Use 5 of 6 joints: the others have no number")
        return
    assert head.startswith(("Do not use this", "Use this")), head
    assert "Do not use" in head or "with care" in head, head


def test_a_program_with_a_capped_point_needs_a_confirmation(run):
    with pytest.raises(js.CampaignError, match="do not use") as refused:
        ABSURD["program, all capped"](run, None)
    assert "limits reduce the corrections of 4 of 4" in str(refused.value.problem.errors)
    program = ABSURD["program, all capped, accepted"](run, None)
    assert program.result.assessment.verdict == "do_not_use"
    assert "limits reduce the corrections" in program.result.assessment.reasons[0].message


def test_what_is_sound_says_of_what_it_is(run):
    prediction = run.predict(POSTURE, (0, 0, -500), at=POINT)
    area = js.map(run, force=(0, 0, -500), **AREA)
    program = js.compensate(run, POCKET, force=(0, 0, -500), **MILLING)
    for name, result in (("prediction", prediction), ("map", area.result), ("program", program.result)):
        words = f"Use this {name}: nothing speaks against it; all 6 joints of its run passed the checks"
        assert result.assessment.headline == words
