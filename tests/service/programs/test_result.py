# ruff: noqa: E501  # lines of programs, and words that users read
"""What is told of a corrected program: counts, spreads, worst points, reasons, remarks, and its text."""

import pytest
from scipy import stats
from support.programs import FORCE, corrected, exact_run, path, request, tool_poses

from jointstiff.service.kinds.correction.files import compress_file, decompress_file
from jointstiff.service.kinds.correction.programs import ProgramWork
from jointstiff.service.kinds.correction.text import FaultsError
from jointstiff.service.problems import MovesLeftError, VerdictError
from jointstiff.simulator.programs import PROGRAM_FILES, program_text
from jointstiff.solver.errors import RequestError

KRL = program_text("krl", tool_poses(path(5)), 4)
NO_MASSES = "own weight is not included, because no masses are given"
NO_BOUND = "no bound of the model error at 95 %: 19 postures are needed, but the campaign has only 12"
CORRECTED = [
    "LIN {X 1809.7982,Y 268.9019,Z 1492.4719,A -161.49355,B 39.54087,C -170.98558} C_DIS",
    "LIN {X 1626.3291,Y 567.0796,Z 1314.0915,A -152.37076,B 31.46843,C -170.05938} C_DIS",
    "LIN {X 1461.1836,Y 634.9244,Z 1280.3935,A -149.02549,B 29.38830,C -167.81777} C_DIS",
    "LIN {X 1403.7961,Y 465.7394,Z 1377.9014,A -154.86064,B 33.50572,C -165.09595} C_DIS",
    "LIN {X 1366.6218,Y 139.5637,Z 1579.6621,A -168.26200,B 42.54072,C -162.74141} C_DIS",
]


def lines_of(result):
    return [line for line in decompress_file(result.files[0]).decode().splitlines() if "LIN" in line]


def figures(spread):
    return spread.median, spread.p95, spread.greatest


def about(*numbers):
    return pytest.approx(numbers, rel=1e-4)


ROWS = {
    "csv": (2, ["1;1809.798174;268.901883;1492.471897;-161.493549620;39.540872792;-170.985583357"]),
    "krl": (7, ["LIN {X 1809.7982,Y 268.9019,Z 1492.4719,A -161.49355,B 39.54087,C -170.98558} C_DIS"]),
    "fanuc": (
        12,
        [
            "\tX =  1809.7982  mm,\tY =   268.9019  mm,\tZ =  1492.4719  mm,",
            "\tW = -170.98558 deg,\tP =   39.54087 deg,\tR = -161.49355 deg",
        ],
    ),
    "rapid": (
        4,
        [
            "    MoveL [[1809.7982,268.9019,1492.4719],[0.34470976,-0.12461650,0.93021163,-0.01876795],[0,0,0,0],"
            "[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]],v50,z1,tMill\\WObj:=wPart;"
        ],
    ),
    "ur": (
        2,
        [
            "  movel(p[1.8097982, 0.2689019, 1.4924719, -0.3236165, 2.4156659, -0.0487385], a=1.2, v=0.05, r=0.001)"
        ],
    ),
}  # fmt: skip
"""The line of the first target, and its lines once corrected."""
ROUNDED = {
    "csv": (4.9425e-10, 6.1391e-10, 6.2385e-10),
    "krl": (5.0806e-8, 6.9320e-8, 7.1000e-8),
    "fanuc": (5.0806e-8, 6.9320e-8, 7.1000e-8),
    "rapid": (5.0803e-8, 6.9457e-8, 7.1188e-8),
    "ur": (5.0882e-8, 6.9555e-8, 7.1312e-8),
}


@pytest.mark.parametrize("kind", PROGRAM_FILES)
def test_each_language_has_the_same_correction_in_its_own_numbers(kind):
    text = program_text(kind, tool_poses(path(6)), 4)
    result = corrected(kind, text)
    line, rows = ROWS[kind]
    old = text.splitlines()
    new = [each for each in decompress_file(result.files[0]).decode().splitlines() if each not in old]
    assert new[: len(rows)] == rows
    assert len(new) == 6 * len(rows)
    assert (result.format, result.files[0].name) == (kind, PROGRAM_FILES[kind])
    assert (result.points, result.moves, result.corrected, result.moves_left, result.capped) == (
        6,
        6,
        6,
        0,
        0,
    )
    assert result.left_alone == {}
    assert figures(result.deflection) == about(0.0022214, 0.0027173, 0.0028202)
    assert figures(result.correction) == about(0.0022252, 0.0027227, 0.0028259)
    assert figures(result.residual) == pytest.approx(ROUNDED[kind], rel=1e-3)
    assert figures(result.rounding) == pytest.approx(ROUNDED[kind], rel=1e-3)
    step = 6 if kind == "fanuc" else 1
    assert [(each.number, each.line) for each in result.worst] == [
        (number, line + step * (number - 1)) for number in (1, 2, 6, 3, 5, 4)
    ]


def test_the_worst_point_is_told_with_place_deflection_correction_and_what_remains():
    result = corrected("krl", KRL)
    assert lines_of(result) == CORRECTED
    worst = result.worst[0]
    assert (worst.number, worst.name, worst.line, worst.share, worst.capped) == (1, "", 7, 1.0, False)
    assert worst.place == pytest.approx((1.8095679, 0.2692785, 1.4896807))
    assert (worst.deflection, worst.deflection_rotation) == about(0.00282024, 0.00266145)
    assert (worst.correction, worst.correction_rotation) == about(0.00282589, 0.00266893)
    assert (worst.residual, worst.residual_rotation) == pytest.approx((3.1310e-8, 7.9611e-8), rel=1e-3)
    assert worst.rounding == pytest.approx(worst.residual)
    assert result.confidence == 0.95
    assert result.remarks == [NO_MASSES, NO_BOUND]
    assert result.assessment.headline == "Use this program with care: 1 reason of its run"
    (reason,) = result.assessment.reasons
    assert (reason.code, reason.weight) == ("residuals_vanish", "use_with_care")


@pytest.mark.parametrize("confidence", [0.95, 0.5])
def test_an_interval_has_the_stated_confidence(confidence):
    """Student's distribution: three coordinates of three targets in 12 postures, less six compliances."""
    coverage = stats.t.ppf(0.5 + 0.5 * confidence, 12 * 3 * 3 - 6)
    worst = corrected("krl", KRL, confidence=confidence).worst[0]
    assert worst.standard_uncertainty == pytest.approx(2.8154e-5, rel=1e-4)
    half = coverage * worst.standard_uncertainty
    assert worst.interval == pytest.approx((worst.deflection - half, worst.deflection + half), rel=1e-6)


def test_a_bound_of_the_model_error_is_told_where_the_postures_suffice():
    of_half, of_most = (corrected("krl", KRL, confidence=confidence) for confidence in (0.5, 0.95))
    assert of_half.worst[0].interval_with_model_error == about(0.0028012, 0.0028393)
    assert of_half.remarks == [NO_MASSES]
    assert of_most.worst[0].interval_with_model_error is None
    assert of_most.remarks == [NO_MASSES, NO_BOUND]


def test_moves_outside_of_the_lines_of_a_load_have_none():
    segment = {"first_line": 8, "last_line": 9, "force": FORCE}
    result = corrected("krl", KRL, force=None, segments=[segment])
    before = [line for line in KRL.splitlines() if "LIN" in line]
    assert lines_of(result) == [before[0], *CORRECTED[1:3], *before[3:]]
    assert (result.points, result.moves, result.corrected) == (5, 5, 2)
    assert result.left_alone == {"no_load": 3}
    assert figures(result.deflection) == about(0.0022007, 0.0023123, 0.0023247)
    assert figures(result.correction) == about(0.0022049, 0.0023168, 0.0023292)
    assert [(each.number, each.line) for each in result.worst] == [(2, 8), (3, 9)]


def test_a_program_in_which_nothing_is_corrected_says_so_and_why():
    result = corrected("krl", KRL, force=[0, 0, 0])
    own, of_run = result.assessment.reasons
    assert (own.code, own.weight) == ("nothing_corrected", "use_with_care")
    assert own.message == (
        "nothing is corrected: no point is loaded, or each deflection is below its uncertainty"
    )
    assert own.remedy == "state the load; measure more if the deflections matter"
    assert of_run.code == "residuals_vanish"
    assert result.assessment.headline == (
        "Use this program with care: 1 reason of its own, 1 reason of its run"
    )
    assert (result.points, result.corrected, result.left_alone) == (5, 0, {})
    for spread in (result.deflection, result.correction, result.residual, result.rounding):
        assert figures(spread) == pytest.approx((0.0, 0.0, 0.0), abs=1e-14)


def test_a_longer_tool_is_deflected_more():
    result = corrected("krl", KRL, tools=[{"values": [0, 0, 500, 0, 0, 0]}])
    assert figures(result.deflection) == about(0.0030178, 0.0036964, 0.003811)
    assert figures(result.correction) == about(0.0030285, 0.0037101, 0.0038257)
    assert [each.number for each in result.worst[:3]] == [1, 5, 2]
    assert result.worst[0].standard_uncertainty == pytest.approx(3.7980e-5, rel=1e-3)


HEAVY = {"force": [3000, 0, -9000]}


def test_corrections_beyond_the_limits_are_refused_unless_that_is_accepted():
    with pytest.raises(VerdictError) as refused:
        corrected("krl", KRL, **HEAVY)
    assert str(refused.value) == (
        "max_displacement: the verdict on a program whose corrections exceed the limits is: do not use; follow the "
        "remedies of the reasons and identify again; to continue anyway, give `accept_verdict: do_not_use`"
    )
    result = corrected("krl", KRL, **HEAVY, accept_verdict="do_not_use")
    assert result.assessment.verdict == "do_not_use"
    assert (result.corrected, result.capped) == (5, 5)
    assert result.correction.greatest <= 5e-3 * (1 + 1e-9)
    worst = result.worst[0]
    assert worst.capped
    assert worst.correction_rotation <= 10e-3 * (1 + 1e-9)
    assert worst.correction / worst.deflection == pytest.approx(worst.share, rel=0.05)


UNREACHED = "the robot does not reach this target; check tool, base, `world` and `flange`"
NO_NUMBERS = (
    "tools: the program uses the frame 'TOOL_DATA[1]', but does not define its numbers; give the name "
    "'TOOL_DATA[1]' and the numbers in `tools`"
)
TWICE = "tools[1].name: two frames have the same name, or two frames have no name; give each frame only once"
LONG = [0, 0, 500, 0, 0, 0]
REFUSED = {
    "a load that the controller compensates": (
        {"accuracy_option": "compensates_load"},
        "accuracy_option: the controller already compensates the deflection under load, so a second compensation would be wrong; switch the controller's accuracy option off, repeat the measurement, and set `accuracy_option` to `off`",
    ),
    "no tool": ({"tools": []}, NO_NUMBERS),
    "another tool": ({"tools": [{"name": "TOOL_DATA[7]", "values": LONG}]}, NO_NUMBERS),
    "seven numbers": (
        {"tools": [{"values": [0.0] * 7}]},
        "tools[0].values: a frame needs 6 numbers that form a pose; give the position, then A, B, C about Z, Y', X'', in the "
        "program's units",
    ),
    "a tool twice": ({"tools": [{"values": LONG}] * 2}, TWICE),
    "a tool in two cases": (
        {"tools": [{"name": name, "values": LONG} for name in ("TOOL_DATA[1]", "tool_data[1]")]},
        TWICE,
    ),
    "one angle": (
        {"start": [0.0]},
        "start: there are 1 joint angles, but the robot has 6 joints; give the 6 controller angles of joint_1, "
        "joint_2, joint_3, joint_4, joint_5, joint_6",
    ),
    "a load of no move": (
        {"force": None, "segments": [{"first_line": 1, "last_line": 2, "force": FORCE}]},
        "segments: no move is under load; give loads for lines that contain moves, or for points that moves visit",
    ),
    "a table that is not there": (
        {"loads": "a.csv", "force": None},
        "loads: the table of loads was not sent; send the table together with the files of the program",
    ),
    "a moment without a unit": (
        {"force": None, "segments": [{"force": [0, 0, 0], "moment": [1, 0, 0]}]},
        "units.moment: the unit of a moment is not stated, and cannot be inferred because lengths "
        "are in mm; state units.moment, one of N.m, N.mm, kN.m, kgf.m, lbf.m, lbf.ft, lbf.in",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_request_that_cannot_be_answered_is_refused_with_its_field_and_a_remedy(case):
    changes, words = REFUSED[case]
    with pytest.raises(RequestError) as refused:
        corrected("krl", KRL, **changes)
    assert str(refused.value) == words


UNDER_PROGRAM = {
    "no configuration": (
        {"start": None},
        "'path.src', line 7: the program does not state the arm's configuration at this target; give `start`: "
        "the controller's angles near this target",
    ),
    "a base far away": (
        {"bases": [{"values": [9e3, 0, 0, 0, 0, 0]}]},
        "\n".join(f"'path.src', line {line}: {UNREACHED}" for line in range(7, 12)),
    ),
    "a load that breaks the arm": (
        {"force": [0, 0, 1e9]},
        "'path.src', line 7: the robot has no stable equilibrium under this load near the unloaded posture; check the units of "
        "force, moment and length, or reduce the load",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", UNDER_PROGRAM)
def test_a_point_that_cannot_be_corrected_is_named_by_its_line(case):
    changes, words = UNDER_PROGRAM[case]
    with pytest.raises(FaultsError) as refused:
        corrected("krl", KRL, **changes)
    assert str(refused.value) == words


def test_a_target_under_two_loads_is_refused():
    text = (
        "DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nXP1={X 1803,Y 290,Z 1505,A 18,B 140,C 9}\n"
        "LIN XP1\nLIN XP1\nEND"
    )
    segment = {"first_line": 5, "last_line": 5, "force": FORCE}
    with pytest.raises(FaultsError) as refused:
        corrected("krl", text, force=None, segments=[segment], tools=[], bases=[])
    assert str(refused.value) == (
        "'path.src', line 4: 'XP1': moves visit this target under two different loads; use a separate target for each load"
    )


MORE = ["LIN XP9", "LIN {X 1803,Y 290,Z 1505,A 18,B 140,C 9}:{X 1}", "PTP HOME", "PTP HOME"]
UNCERTAIN = KRL.replace("END\r\n", "\r\n".join([*MORE, "END", ""]))
NUMBERS = "write X, Y, Z, A, B, C (or A1 ... A6) in numbers, and send the .dat that declares them"
NO_XP9 = f"the target 'XP9' is not given by constant numbers; {NUMBERS}"
NO_POSE = (
    "the target is neither a whole pose nor all joint angles in numbers, or the text after it is unknown; "
    f"{NUMBERS}"
)


def test_a_program_with_uncertain_moves_is_refused_with_all_of_them():
    with pytest.raises(MovesLeftError) as refused:
        corrected("krl", UNCERTAIN)
    places = {place: f"{reason}; {remedy}" for place, reason, remedy in refused.value.items}
    assert places == {"'path.src', line 12": NO_XP9, "'path.src', line 13": NO_POSE}
    first, _, _ = NO_XP9.partition("; ")
    assert refused.value.reason == (
        f"2 of 7 moves cannot be corrected; 'path.src', line 12: {first}, and 1 more"
    )
    assert refused.value.remedy == (
        "write 2 of 7 moves anew; or state `leave_others: true` to correct only the other 5"
    )


def test_uncertain_moves_are_left_if_asked_and_told_in_reason_remarks_and_mark():
    result = corrected("krl", UNCERTAIN, leave_others=True, mark=True)
    own = result.assessment.reasons[0]
    assert (own.code, own.weight) == ("moves_left", "use_with_care")
    assert own.message == "5 of 7 moves were corrected, 2 were left unchanged"
    assert own.remedy == "check that the unchanged moves need no correction"
    assert (result.points, result.moves, result.moves_left, result.corrected) == (5, 7, 2, 5)
    assert result.remarks == [
        NO_MASSES,
        NO_BOUND,
        "lines 14, 15: a move to HOME, a position stored in the controller",
        f"line 12: left unchanged: {NO_XP9}",
        f"line 13: left unchanged: {NO_POSE}",
    ]
    lines = decompress_file(result.files[0]).decode().splitlines()
    assert lines[:2] == ["&ACCESS RVP", "DEF path()"]
    assert lines[2].startswith("; Jointstiff run ")
    assert lines[2].endswith(", verdict: use with care, 5 of 7 moves corrected, 2 left")
    assert lines[7:] == [*CORRECTED, *MORE, "END"]


@pytest.mark.parametrize(
    ("count", "words"), [(5, "14, 15, 16, 17, 18"), (7, "14, 15, 16, 17, 18 and 2 more")]
)
def test_a_remark_of_many_lines_names_the_first_five(count, words):
    text = UNCERTAIN.replace("PTP HOME\r\n" * 2, "PTP HOME\r\n" * count)
    result = corrected("krl", text, leave_others=True)
    assert f"lines {words}: a move to HOME, a position stored in the controller" in result.remarks


def test_a_remark_on_a_line_of_a_further_file_names_the_file():
    program = program_text("krl", tool_poses(path(3)), 4).replace("\nEND", "\ngrip_all()\nEND")
    further = compress_file("grip_all.src", b"DEF grip_all()\r\n\r\ngripper()\r\nEND\r\n")
    asked = request("krl", program, leave_alone=["gripper"])
    robot, run = exact_run()
    work = ProgramWork(robot, "robot", run, asked.model_copy(update={"files": [*asked.files, further]}))
    permission = "the request states that this routine neither moves the robot nor changes frames"
    assert f"line 3 of 'grip_all.src': gripper is called; {permission}" in work.conclude(()).remarks
