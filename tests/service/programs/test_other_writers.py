"""The posture follows what programs say of it: status and turn, quadrants, letters; and the path."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.examples import examples
from support.programs import FORCE, START, corrected, tool_poses, work_of

from jointstiff.service.kinds.correction.files import decompress_file
from jointstiff.service.kinds.correction.path import _WORDS
from jointstiff.service.kinds.correction.text import FaultsError
from jointstiff.simulator.programs import program_text
from robotprograms.errors import ProgramError
from robotprograms.formats import read_program

FREE = "[9E9,9E9,9E9,9E9,9E9,9E9]"


@pytest.mark.timeout(30)
def test_blanks_within_a_line_of_fanuc_take_no_time():
    """A pattern that gives blanks back took their cube: a minute for one line."""
    text = "/PROG A\n/MN\n" + "".join(f"   {i}:!x{' ' * 4000}x ;\n" for i in range(1, 20)) + "/POS\n/END\n"
    with suppress(ProgramError):
        read_program([("a.ls", text.encode())])


FRAMES = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]"


def postures(kind, text, **changes):
    """The chosen posture of each point of the path [°]."""
    return np.degrees(work_of(kind, text, **changes)._path.cases.joints)


def krl_numbers(joints):
    (line,) = (
        each for each in program_text("krl", tool_poses(joints[None]), 5).split("\r\n") if "LIN" in each
    )
    return line.partition("{")[2].partition("}")[0]


def status_and_turn(joints):
    """S (bit 2 alone) and T by KUKA's manual: T has bit i where axis i + 1 is below zero."""
    return 4 * int(joints[4] < 0.0), sum(1 << i for i in range(6) if joints[i] < 0.0)


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1), (1, -1, 1), (-1, -1, -1)])
def test_krl_status_and_turn_choose_the_posture(signs):
    joints = np.radians([20.0, -10.0, 15.0, 60.0, 40.0, 100.0]) * [
        signs[0],
        1,
        1,
        signs[1],
        signs[1],
        signs[2],
    ]
    s, t = status_and_turn(joints)
    for turn in (t, f"'B{t:06b}'"):
        text = f"DEF a()\n{FRAMES}\nPTP {{{krl_numbers(joints)},S {s},T {turn}}}\nEND"
        np.testing.assert_allclose(postures("krl", text, start=None)[0], np.degrees(joints), atol=1e-3)


def test_krl_turn_adds_full_turns():
    joints = np.radians([20.0, -10.0, 15.0, 60.0, 40.0, 100.0])
    for far in (0.0, 360.0):
        turned = joints - np.radians([0, 0, 0, 0, 0, far])
        s, t = status_and_turn(turned)
        text = f"DEF a()\n{FRAMES}\nPTP {{{krl_numbers(joints)},S {s},T {t}}}\nEND"
        np.testing.assert_allclose(postures("krl", text, start=None)[0], np.degrees(turned), atol=1e-3)


def test_krl_linear_moves_keep_the_configuration_whatever_they_state():
    joints = np.radians([20.0, -10.0, 15.0, 60.0, 40.0, 100.0])
    s, t = status_and_turn(joints)
    text = (
        f"DEF a()\n{FRAMES}\nPTP {{{krl_numbers(joints)},S {s},T {t}}}\n"
        f"LIN {{{krl_numbers(joints + 0.02)},S {4 - s},T {63 - t}}}\nEND"
    )
    found = postures("krl", text, start=None)
    np.testing.assert_allclose(found[1], np.degrees(joints + 0.02), atol=1e-3)


def test_what_no_posture_has_is_refused_by_line():
    s, t = status_and_turn(START)
    text = f"DEF a()\n{FRAMES}\nPTP {{{krl_numbers(START)},S {s},T {t ^ 2}}}\nEND"
    with pytest.raises(FaultsError, match="configuration") as caught:
        work_of("krl", text)._path  # noqa: B018
    assert caught.value.faults[0].line == 4


def test_krl_turn_is_rewritten_where_an_axis_crosses_zero():
    joints = np.radians([0.005, -10.0, 15.0, 60.0, 40.0, 100.0])
    s, t = status_and_turn(joints)
    text = f"DEF a()\n{FRAMES}\nPTP {{{krl_numbers(joints)},S {s},T {t}}}\nEND"
    crossing = []
    for sign in (1.0, -1.0):
        result = corrected("krl", text, start=None, force=tuple(sign * np.array(FORCE)))
        crossing.append(f"T {t}}}" not in decompress_file(result.files[0]).decode())
        assert f"T {t | 1 if crossing[-1] else t}}}" in decompress_file(result.files[0]).decode()
    assert sorted(crossing) == [False, True]


def rapid_move(joints, confdata, move="MoveJ"):
    (line,) = (
        each for each in program_text("rapid", tool_poses(joints[None]), 5).split("\n") if "MoveL" in each
    )
    return line.replace("MoveL", move).replace("[0,0,0,0]", confdata).strip()


def module(*lines):
    return "\n".join(["MODULE a", "PROC main()", *lines, "ENDPROC", "ENDMODULE"])


def confdata(joints):
    """Quadrants of axes 1, 4 and 6, and cfx, whose least bit says that axis 5 is negative (ABB's manual)."""
    quadrants = np.floor(np.degrees(joints) / 90.0).astype(int)
    return f"[{quadrants[0]},{quadrants[3]},{quadrants[5]},{int(joints[4] < 0)}]"


@pytest.mark.parametrize("last", [100.0, -100.0, 200.0])
@pytest.mark.parametrize("flip", [1, -1])
def test_rapid_confdata_chooses_the_posture(last, flip):
    joints = np.radians([20.0, -10.0, 15.0, 60.0 * flip, 40.0 * flip, last])
    text = module(rapid_move(joints, confdata(joints)))
    np.testing.assert_allclose(
        postures("rapid", text, start=np.degrees(joints + 0.1).tolist())[0], np.degrees(joints), atol=1e-3
    )


def test_rapid_conf_j_off_takes_the_nearest():
    joints = np.radians([20.0, -10.0, 15.0, 60.0, 40.0, 100.0])
    angles = ",".join(map(str, np.degrees(joints)))
    first = f"MoveAbsJ [[{angles}],{FREE}],v50,fine,tMill;"
    stays = module("ConfJ\\Off;", first, rapid_move(joints, "[1,1,1,1]"))
    np.testing.assert_allclose(postures("rapid", stays)[1], np.degrees(joints), atol=1e-3)
    with pytest.raises(FaultsError, match="configuration"):
        postures("rapid", stays.replace("ConfJ\\Off;", ""))


def test_fanuc_letters_that_change_are_refused():
    text = program_text("fanuc", tool_poses(START + 0.01 * np.arange(3)[:, None]), 4)
    assert len(postures("fanuc", text)) == 3
    head, _, tail = text.rpartition("N U T")
    with pytest.raises(FaultsError, match="N/F") as caught:
        postures("fanuc", f"{head}F U T{tail}")
    assert len(caught.value.faults) == 1


def test_fanuc_turn_numbers_choose_full_turns():
    joints = START.copy()
    joints[5] += 2 * np.pi
    text = program_text("fanuc", tool_poses(joints[None]), 4).replace("0, 0, 0'", "0, 0, 1'")
    text = text.replace("1:L P[1] 50mm/sec CNT100", "1:J P[1] 50% FINE")
    found = postures("fanuc", text, start=np.degrees(START).tolist())[0]
    assert found[5] == pytest.approx(
        np.degrees(joints[5]) if np.degrees(joints[5]) < 350 else found[5], abs=1e-3
    )


def test_turns_follow_the_path():
    """Full turns add up along a path, as the controller's do."""
    angles = np.radians(np.linspace(-300.0, 300.0, 61))
    joints = np.tile(START, (61, 1))
    joints[:, 5] = angles
    text = program_text("krl", tool_poses(joints), 5)
    found = postures("krl", text, start=np.degrees(joints[0]).tolist())
    np.testing.assert_allclose(found, np.degrees(joints), atol=1e-3)


EVERY = [(name, word) for name, words in _WORDS.items() for word in words]


@pytest.mark.parametrize(("name", "word"), EVERY, ids=[f"{name}-{word.joint}" for name, word in EVERY])
@examples(200)
@given(angle=st.floats(-9.0, 9.0).filter(lambda angle: abs(angle) > 1e-6), before=st.integers(0, 63))
def test_what_is_written_holds_the_angle(name, word, angle, before):
    number = word.update_number(before, angle)
    ((low, high),) = word.ranges(np.array([float(number)]))
    assert low - 1e-9 <= angle <= high + 1e-9
    width = {"sign": np.inf, "quadrant": np.pi / 2, "turn": 2 * np.pi}[word.kind]
    assert high - low == pytest.approx(width)
    if word.bit is not None:
        assert (number ^ before) & ~(1 << word.bit) == 0
    assert word.ranges(np.array([np.nan])).tolist() == [[-np.inf, np.inf]]
