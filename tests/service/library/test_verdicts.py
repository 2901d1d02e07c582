"""Campaigns with mistakes and without: the verdict, its reasons, what helps, and the numbers."""

import re

import pytest
from support.cases import campaign
from support.command_lines import assert_said

import jointstiff as js

CERTAIN = re.compile(r"p = \de-[2-9]\d")
"""A p-value that is next to zero."""
FORCES = "If N and kgf are confused, every stiffness is wrong by 9.81, and no reading shows it."
POINT = "Load point: ±10 mm assumed."
SCALE = "Forces: ±1 % assumed."
FRAMES = (
    "check frames, joint map, units and noise; if all are correct, something besides the joints deflects: "
    "omit "
    "`noise` so that sigma is estimated from the residuals"
)
SIGN = "change the sign of every force (it is the force on the robot); or exchange unloaded and loaded"
RIGID = "the readings identify no joint: 6 at bound"


def identified(name):
    return js.identify(campaign(name), method="partial_pose", elasticity="joints")


def against(work):
    """The reason of forces or readings that are turned round."""
    return (
        "force_sign_suspect",
        f"the work of the load on the joints is {work} J, but must be positive; the targets moved against "
        f"the force "
        "in 24 of 24 observations",
        SIGN,
        "exchange_readings",
    )


BOUND = (
    "no_joint_identified",
    RIGID,
    "exchange unloaded and loaded readings, or change the sign of every force",
    "exchange_readings",
)


def larger(times):
    """The reason of residuals that are so many times as large."""
    return (
        "residuals_exceed_sigma",
        f"the residuals are {times} times as large as the stated noise allows, so the uncertainties are "
        f"too small; "
        "how much depends on what the model leaves unexplained",
        FRAMES,
        "omit_noise",
    )


MISTAKES = {
    "mistake_bumped": [
        (
            "targets_not_rigid",
            "the distance between 'P10' and 'P12' (unloaded) differs by 715 µm from its median (limit 221 "
            "µm): 'P10' "
            "moved (and 9 more of this kind)",
            "check 'P10' for a bump, a turned reflector or a wrong name; repeat the observation, or remove "
            "that "
            "reading",
            None,
        ),
        (
            "drift_in_time",
            "over the whole set, the unloaded targets drifted by 326 µm relative to the robot's model (x "
            "187 µm, "
            "y 191 µm, z 187 µm; p = 1e-10)",
            "check the tracker's stand, warm-up and temperature; a deflection is affected only by drift "
            "between its "
            "two readings",
            None,
        ),
    ],
    "mistake_exchanged": [against(-32.5), BOUND],
    "mistake_sign": [against(-30.6), BOUND],
    "mistake_point": [
        (
            "alternative_explains_better",
            "with every load point moved by (-68.4, -60.6, -65.5) mm in the flange frame, the joints "
            "explain the "
            "readings better than chance allows (F test, p = 0); a compliance changes by 67 %",
            "measure the load point on the flange",
            "fit_causes",
        ),
        larger(2.7),
    ],
    "mistake_row": [
        (
            "target_off_model",
            "target 'P12' is 2.41 m away from its median position on the flange",
            "check that positions are in R0 and in `units.length`, the angles and their order, the joint "
            "map, and "
            "the robot's model",
            "leave_out_readings",
        ),
    ],
    "mistake_swap": [
        (
            "alternative_explains_better",
            "with the columns of joint_2 and joint_3 exchanged, the joints explain 96.7 % of the mean "
            "deflection "
            "instead of 59.6 %; the sum of squared residuals falls to 0.63 %",
            "check the columns of joint_2 and joint_3; if they are exchanged, exchange them back",
            "exchange_columns",
        ),
    ],
    "mistake_zero": [
        (
            "alternative_explains_better",
            "with a constant force of (2.5, 3.23, -77.7) N (axes of R0) added to every load, the joints "
            "explain the "
            "readings better than chance allows (F test, p = 0); a compliance changes by 12 %",
            "check for a weight that hangs on the flange only while loaded, and the load cell's zero",
            "fit_causes",
        ),
        larger(1.73),
    ],
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_not_to_be_used_and_named_with_what_helps(name):
    assessment = identified(name).result.assessment
    assert (assessment.verdict, assessment.headline) == ("do_not_use", None)
    found = [
        (each.code, CERTAIN.sub("p = 0", each.message), each.remedy, each.action and each.action.kind)
        for each in assessment.reasons
    ]
    assert found == MISTAKES[name]
    first, *others = (each.weight for each in assessment.reasons)
    graver = "do_not_use" if found[-1] == BOUND else "use_with_care"
    assert (first, others) == ("do_not_use", [graver] * len(others))


def test_a_reason_names_its_observation_and_its_action_what_it_changes():
    row = identified("mistake_row").result.assessment.reasons[0]
    assert (row.where, row.observation) == ("observations[4] 'c005'", "c005")
    assert row.action.observations == ["c005"]
    bumped = identified("mistake_bumped").result.assessment.reasons[0]
    assert (bumped.where, bumped.observation) == ("observations[12] 'c013'", "c013")
    assert identified("mistake_swap").result.assessment.reasons[0].action.joints == ["joint_2", "joint_3"]
    for name, cause in (("mistake_point", "load_point"), ("mistake_zero", "constant_force")):
        (fitted,) = identified(name).result.assessment.reasons[0].action.causes
        assert fitted.name == cause


@pytest.mark.parametrize(
    ("name", "sentences"),
    [
        (
            "mistake_bumped",
            [
                "Do not use: 2 reasons observations[12] 'c013': the distance between 'P10' and 'P12'",
                "Forces up to 1200 N (122 kgf), deflections up to 3 mm.",
                "│ joint_1 │ 1.400 │ 0.020 │ 1.361 … 1.441 │ do not use │",
                "explains 96.8 % of the mean deflection, residual 52.3 µm rms",
                "To do 1. check 'P10' for a bump",
                "2. check the tracker's stand",
            ],
        ),
        (
            "mistake_exchanged",
            [
                "Do not use: 2 reasons the work of the load on the joints is -32.5 J",
                "│ joint_1 │ rigid │ — │ — │ at bound │",
                "joint_1, joint_2, joint_3, joint_4, joint_5, joint_6: these readings cannot distinguish "
                "it from a "
                "rigid joint",
                "explains 0.0 % of the mean deflection, residual 1.45 mm rms",
                "To do 1. change the sign of every force",
                "2. exchange unloaded and loaded readings",
            ],
        ),
        (
            "mistake_point",
            [
                "│ joint_5 │ 0.1632 │ 0.0021 │ 0.1592 … 0.1675 │ do not use │",
                "explains 90.4 % of the mean deflection, residual 130 µm rms",
                "To do 1. measure the load point on the flange 2. check frames",
            ],
        ),
        (
            "mistake_row",
            [
                "│ joint_6 │ 0.94 │ 0.33 │ 0.56 … 2.93 │ do not use │",
                "explains 78.9 % of the mean deflection, residual 363 µm rms",
                "1 warning (--details) To do 1. check that positions are in R0",
            ],
        ),
        (
            "mistake_swap",
            [
                "Do not use: 1 reason",
                "│ joint_4 │ 0.813 │ 0.079 │ 0.397 … 1.420 │ do not use │",
                "│ joint_6 │ rigid │ — │ — │ at bound │",
                "joint_6: these readings cannot distinguish it from a rigid joint",
                "explains 59.6 % of the mean deflection, residual 594 µm rms",
            ],
        ),
        (
            "mistake_zero",
            [
                "Forces up to 1261 N (129 kgf), deflections up to 2.96 mm.",
                "│ joint_4 │ 0.365 │ 0.023 │ 0.325 … 0.417 │ do not use │",
                "explains 94.8 % of the mean deflection, residual 83.4 µm rms",
            ],
        ),
        (
            "no_sigma",
            [
                "Use: all 6 joints passed the checks",
                "│ joint_4 │ 0.514 │ 0.052 │ 0.428 … 0.643 │ roughly known │",
                "explains 96.2 % of the mean deflection, residual 50.7 µm rms (3-D), sigma of a reading 21 "
                "µm "
                "(residuals)",
                "To do 1. joint_4: 1200 N along (-1.00, 0.00, 0.00) in posture c005: u 10 % → 9.6 %",
            ],
        ),
        (
            "one_target",
            [
                "Use: all 6 joints passed the checks",
                "│ joint_3 │ 4.03 │ 0.17 │ 3.72 … 4.39 │ determined │",
                "To do 1. joint_4: 1200 N along (0.00, -1.00, 0.00) in posture c008: u 11 % → 10 %",
            ],
        ),
        (
            "two_points",
            [
                "Use: all 6 joints passed the checks",
                "│ joint_4 │ 0.427 │ 0.033 │ 0.371 … 0.505 │ determined │",
                "explains 96.9 % of the mean deflection, residual 46.1 µm rms",
            ],
        ),
        (
            "few",
            [
                "Forces up to 1500 N (153 kgf), deflections up to 2.7 mm.",
                "│ joint_1 │ 1.364 │ 0.037 │ 1.294 … 1.441 │ determined │",
                "│ joint_2 │ 3.631 │ 0.056 │ 3.524 … 3.744 │ well determined │",
            ],
        ),
        (
            "units",
            [
                "Forces up to 1200 N (122 kgf), deflections up to 2.81 mm.",
                "│ joint_2 │ 3.722 │ 0.049 │ 3.628 … 3.819 │ well determined │",
                "residual 52.2 µm rms (3-D), sigma of a reading 20 µm (given)",
            ],
        ),
        (
            "missing",
            [
                "│ joint_4 │ 0.387 │ 0.035 │ 0.329 … 0.469 │ determined │",
                "explains 96.9 % of the mean deflection, residual 44.7 µm rms",
            ],
        ),
        (
            "stiff_joint",
            [
                "Use 5 of 6 joints: the others have no number that passed the checks",
                "│ joint_3 │ 4.13 │ 0.15 │ 3.85 … 4.48 │ determined │",
                "│ joint_4 │ rigid │ — │ > 7.66 │ at bound │",
                "joint_4: stiffer than 7.66 · 10⁶ N·m/rad at 95 %: these readings cannot distinguish it "
                "from a rigid "
                "joint",
                "To do 1. joint_4: 1200 N along (-0.87, -0.43, -0.22) in posture c005: u(c) becomes 0.14 "
                "µrad/(N·m)",
            ],
        ),
        (
            "gauges",
            [
                "The set has deflections and no positions, so the geometry of robot, frames and targets, "
                "and the "
                "joint angles, cannot be checked.",
                "│ joint_6 │ 0.1015 │ 0.0070 │ 0.0895 … 0.1173 │ determined │",
                "residual 3.64 µm rms (3-D), sigma of a reading 3 µm (given)",
            ],
        ),
        (
            "encoders",
            [
                "│ joint_3 │ 4.154 │ 0.054 │ 4.052 … 4.262 │ well determined │",
                "explains 96.6 % of the mean deflection, residual 49.5 µm rms",
            ],
        ),
        (
            "moments",
            [
                "Forces up to 900 N (91.8 kgf), deflections up to 2.66 mm.",
                "│ joint_6 │ 0.1003 │ 0.0035 │ 0.0939 … 0.1078 │ determined │",
                "explains 96.1 % of the mean deflection, residual 44.9 µm rms",
            ],
        ),
    ],
)
def test_a_run_is_printed_with_verdicts_numbers_and_what_to_do(name, sentences):
    assert_said(" ".join(str(identified(name)).split()), *sentences)


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("units", [FORCES, POINT, SCALE]),
        ("mistake_point", [FORCES, SCALE]),
        ("mistake_exchanged", [FORCES]),
    ],
)
def test_what_is_assumed_is_noted_where_it_counts(name, known):
    notes = identified(name).result.assessment.notes
    assert len(notes) == len(known)
    assert all(words in note for words, note in zip(known, notes, strict=True))
