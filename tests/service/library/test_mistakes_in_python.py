"""Campaigns with mistakes and without: the verdict, its reasons, what helps, and the numbers."""

import re

import pytest
from support.cases import campaign
from support.command_lines import assert_said
from support.rows import rows_of

import jointstiff as js

CERTAIN = re.compile(r"p = \de-(?:[2-9]\d|\d{3})")
"""A p-value that is next to zero."""
FORCES = (
    "If N and kgf were confused, every stiffness would be wrong by a factor of 9.81, and no reading would "
    "show it."
)
POINT = "The load point is assumed to be known to ±10 mm."
SCALE = "The forces are assumed to be known to ±1 %."
ONCE = (
    "Each posture was read only once without load, so a deflection that remains after unloading is not "
    "detected."
)
IN_DETAILS = ("explains ", "residual ", "Forces up to ", "The set has deflections but no positions")
"""Beginnings of sentences that `print(run)` leaves to `run.details()`."""


FORGOTTEN = {"mistake_zero": 160.0}
"""Campaign → weight in N that its stated forces forget besides what they forget in the file."""


def identified(name, forgotten=None):
    document = campaign(name)
    for observation in document["measurement_set"]["observations"]:
        observation["force"][2] += FORGOTTEN.get(name, 0.0) if forgotten is None else forgotten
    return js.identify(document, method="partial_pose", elasticity="joints")


@pytest.mark.parametrize(("place", "expected"), rows_of(__file__, "mistakes.txt"))
def test_a_mistake_is_not_to_be_used_and_named_with_what_helps(place, expected):
    name, number = place.split()
    assessment = identified(name).result.assessment
    reason = assessment.reasons[int(number)]
    kind = reason.action and reason.action.kind
    message = CERTAIN.sub("p = 0", reason.message)
    assert f"{reason.code} | {message} | {reason.remedy} | {kind}" == expected
    assert assessment.verdict == assessment.reasons[0].weight == "do_not_use"


def test_a_weight_that_moves_no_joint_far_is_named_all_the_same():
    assessment = identified("mistake_zero", forgotten=0.0).result.assessment
    (reason,) = assessment.reasons
    assert CERTAIN.sub("p = 0", reason.message) == (
        "with a weight of (78.5) N that hangs with every load, the joints explain the readings significantly "
        "better (F test, p = 0); compliances change by up to 3.5 %"
    )
    assert (assessment.verdict, reason.action.kind) == ("use_with_care", "fit_causes")


def test_a_graver_reason_comes_first():
    weights = {
        name: [each.weight for each in identified(name).result.assessment.reasons]
        for name in ("mistake_sign", "mistake_point", "mistake_bumped", "mistake_swap")
    }
    assert weights == {
        "mistake_sign": ["do_not_use", "do_not_use"],
        "mistake_point": ["do_not_use", "use_with_care"],
        "mistake_bumped": ["do_not_use", "use_with_care"],
        "mistake_swap": ["do_not_use"],
    }


def test_a_reason_names_its_observation_and_its_action_what_it_changes():
    row = identified("mistake_row").result.assessment.reasons[0]
    assert (row.where, row.observation) == ("observations[4] 'c005'", "c005")
    assert row.action.observations == ["c005"]
    bumped = identified("mistake_bumped").result.assessment.reasons[0]
    assert (bumped.where, bumped.observation) == ("observations[12] 'c013'", "c013")
    assert identified("mistake_swap").result.assessment.reasons[0].action.joints == ["joint_2", "joint_3"]
    for name, cause in (("mistake_point", "load_point"), ("mistake_zero", "hook_weight")):
        (fitted,) = identified(name).result.assessment.reasons[0].action.causes
        assert fitted.name == cause


@pytest.mark.parametrize(
    ("name", "sentences"),
    [
        (
            "mistake_exchanged",
            [
                "Do not use: 2 reasons the work of the load on the joints is -32.5 J",
                "│ joint_1 │ — │ — │ at bound │",
                "joint_1, joint_2, joint_3, joint_4, joint_5, joint_6: these readings cannot distinguish "
                "the joint from a rigid joint",
                "explains 0.0 % of the mean deflection, residual 1.45 mm rms",
                "To do 1. change the sign of every force",
                "2. exchange unloaded and loaded readings",
            ],
        ),
        (
            "mistake_swap",
            [
                "Do not use: 1 reason",
                "│ joint_4 │ 0.81 │ 0.40 … 1.42 │ do not use │",
                "│ joint_6 │ — │ — │ at bound │",
                "joint_6: these readings cannot distinguish the joint from a rigid joint",
                "explains 59.6 % of the mean deflection, residual 594 µm rms",
            ],
        ),
        (
            "no_sigma",
            [
                "Use: all 6 joints passed the checks",
                "│ joint_4 │ 0.513 │ 0.444 … 0.609 │ determined │",
                "explains 96.2 % of the mean deflection, residual 50.5 µm rms (3-D), sigma of a reading 20.3 "
                "µm (residuals)",
            ],
        ),
        (
            "one_target",
            [
                "Use with care: 5 of 6 joints are known within a factor of 1.5",
                "the stiffness is known to a factor of 1.58, and the joint may carry 12 % of the deflection; "
                "the goal is a factor of 1.5 between the ends of its interval",
                "│ joint_4 │ 0.474 │ 0.388 … 0.610 │ use with care │",
                "explains 96.7 % of the mean deflection, residual 41.5 µm rms (3-D), sigma of a reading 20 "
                "µm (given)",
                "To do 1. measure more postures and loads that twist joint_4; a plan proposes them",
            ],
        ),
        (
            "units",
            [
                "Forces up to 1200 N (122 kgf), deflections up to 2.81 mm.",
                "│ joint_2 │ 3.722 │ 3.626 … 3.822 │ well determined │",
                "residual 52.2 µm rms (3-D), sigma of a reading 20 µm (given)",
            ],
        ),
        (
            "stiff_joint",
            [
                "Use 5 of 6 joints: no number of the other joints passed the checks",
                "│ joint_3 │ 4.121 │ 3.926 … 4.315 │ well determined │",
                "│ joint_4 │ > 7.86 │ one-sided │ at bound │",
                "joint_4: stiffer than 7.86 · 10⁶ N·m/rad at 95 %: these readings cannot distinguish the "
                "joint from a rigid joint",
            ],
        ),
        (
            "gauges",
            [
                "The set has deflections but no positions, so the joint angles and the geometry of robot, "
                "frames and targets cannot be checked.",
                "│ joint_6 │ 0.1021 │ 0.0996 … 0.1047 │ well determined │",
                "residual 3.61 µm rms (3-D), sigma of a reading 3 µm (given)",
            ],
        ),
    ],
)
def test_a_run_is_printed_with_verdicts_numbers_and_what_to_do(name, sentences):
    run = identified(name)
    in_details = [each for each in sentences if each.startswith(IN_DETAILS)]
    assert_said(" ".join(str(run).split()), *(each for each in sentences if each not in in_details))
    words = " ".join(run.details().split())
    assert [each for each in in_details if each not in words] == []


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("units", [FORCES, POINT, SCALE, ONCE]),
        ("mistake_point", [FORCES, SCALE, ONCE]),
        ("mistake_exchanged", [FORCES, ONCE]),
    ],
)
def test_what_is_assumed_is_noted_where_it_counts(name, known):
    notes = identified(name).result.assessment.notes
    assert len(notes) == len(known)
    assert all(words in note for words, note in zip(known, notes, strict=True))
