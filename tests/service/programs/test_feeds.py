"""Feeds of programs, tables and requests, and the moves that carry no force."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.programs import exact_run, options

from jointstiff.schemas.process import ProcessRequest
from jointstiff.service.kinds.process.tables import turns_sheet
from jointstiff.service.kinds.process.work import ProcessWork
from jointstiff.service.kinds.program.files import compress_file, decompress_file

POSE = "{X 1809.6,Y 139.9,Z %d,A -168.3,B 42.4,C -162.9}"
KRL = "\n".join(
    [
        "DEF path()",
        "$TOOL=TOOL_DATA[1]",
        "$BASE=BASE_DATA[1]",
        "$VEL.CP=0.2",
        f"LIN {POSE % 1577}",
        "$VEL.CP = 0.02 ; m/s",
        f"LIN {POSE % 1560}",
        f"LIN {POSE % 1540}",
        "BAS(#VEL_CP,0.2)",
        f"LIN {POSE % 1578}",
        "END\n",
    ]
)


def work(text=KRL, files=(), **changes):
    robot, run = exact_run()
    sent = [compress_file("p.src", text.encode()), *(compress_file(*each) for each in files)]
    stated = options("krl", spindle=[0.6, 0.0, 0.8], axes="robot") | changes
    request = ProcessRequest.model_validate({"run_id": "r", "files": sent, **stated})
    return ProcessWork(robot, "robot", run, request)


def forces(result):
    table = turns_sheet(decompress_file(result.choice)).columns
    return np.asarray(table["turned [mm]"]) > 1e-3


def test_approach_and_retract_carry_no_force_unless_their_lines_state_it():
    result = work().conclude(())
    assert result.feed == pytest.approx(0.02)
    assert not forces(result)[[0, 3]].any()
    assert any(
        each.startswith("approaches and retracts carry no force: lines 5, 10") for each in result.remarks
    )
    stated = options("krl")["load"] | {"first_line": 1, "last_line": 10}
    assert forces(work(load=stated).conclude(())).all()


def test_a_feed_of_the_request_tells_cuts_from_approaches():
    """At 0.2 m/s nothing is faster, so that all lines are cuts."""
    result = work(feed=200.0).conclude(())
    assert forces(result).all()
    assert result.feed == pytest.approx(0.2)


def test_the_table_of_loads_states_the_feed_of_each_point():
    table = b"point,Fx [N],Fy [N],Fz [N],feed [mm/s]\n2,300,400,-1400,15\n3,300,400,-1400,30\n"
    result = work(files=[("loads.csv", table)], loads="loads.csv", load=None).conclude(())
    assert result.feed == pytest.approx(0.2), "the approaches keep the program's feed"
    assert forces(result).tolist() == [False, True, True, False]


def test_without_a_feed_the_result_says_what_the_joints_need_at_50_mm_per_second():
    text = "\n".join(line for line in KRL.split("\n") if "VEL" not in line)
    result = work(text).conclude(())
    assert result.feed is None
    assert len(result.needed_speeds) == 6
    assert any("at 50 mm/s they need joint_1" in each for each in result.remarks)


def test_a_program_that_is_too_fast_as_it_was_sent_is_named():
    fast = KRL.replace("0.02 ;", "2.0 ;").replace("$VEL.CP=0.2", "$VEL.CP=2.0")
    robot, run = exact_run()
    slow = robot.with_speeds(np.full(6, 0.05))
    sent = [compress_file("p.src", fast.encode())]
    stated = options("krl", spindle=[0.6, 0.0, 0.8])
    request = ProcessRequest.model_validate({"run_id": "r", "files": sent, **stated})
    result = ProcessWork(slow, "robot", run, request).conclude(())
    assert "too_fast" in {each.code for each in result.assessment.reasons}
    assert max(result.sent_speed_shares) > 1.0


def test_a_roll_that_jumps_is_named_and_not_followed():
    """At the third target the tool, which has the flange's axes, is turned about the spindle by 40°."""
    rotation = Rotation.from_euler("ZYX", [-168.3, 42.4, -162.9], degrees=True)
    turned = rotation * Rotation.from_rotvec(np.radians(40.0) * np.array([0.6, 0.0, 0.8]))
    a, b, c = turned.as_euler("ZYX", degrees=True)
    rolled = KRL.replace(f"LIN {POSE % 1540}", f"LIN {{X 1809.6,Y 139.9,Z 1540,A {a},B {b},C {c}}}")
    found = [work(text, turn="free", feed=20.0).conclude(()) for text in (KRL, rolled)]
    named = [[each for each in result.remarks if "faster than `rate`" in each] for result in found]
    assert named[0] == []
    assert named[1] == [
        "the program turns the tool about the spindle faster than `rate` on the way to lines 8, 10: the "
        "chosen turn does not follow there"
    ]
    assert found[1].turned.value == pytest.approx(found[0].turned.value, rel=1e-3)


@pytest.mark.parametrize(
    ("lines", "speed", "is_blended", "is_named"),
    [(40, 0.002, False, False), (1, 0.002, True, False), (1, 0.0001, True, True)],
)
def test_a_correction_changes_over_a_length_and_is_named_where_no_length_is_enough(
    lines, speed, is_blended, is_named
):
    """The force turns back on one line of 1 mm in the middle of the path, or over 40 of them."""
    count = 60
    path = ["DEF path()", "$TOOL=TOOL_DATA[1]", "$BASE=BASE_DATA[1]", "$VEL.CP=0.05"]
    path += [f"LIN {POSE % (1577 - i)}" for i in range(count)]
    share = np.clip((np.arange(count) - 10) / lines, 0.0, 1.0) * 2.0 - 1.0
    rows = [f"{i + 1},{300 * each},{400 * each},{-1400 * each}" for i, each in enumerate(share)]
    loads = "\n".join(["point,Fx [N],Fy [N],Fz [N]", *rows, ""])
    robot, run = exact_run()
    sent = [
        compress_file(*each)
        for each in (("p.src", "\n".join([*path, "END\n"]).encode()), ("loads.csv", loads.encode()))
    ]
    stated = options("krl", spindle=[0.6, 0.0, 0.8], axes="robot", load=None, loads="loads.csv", turn="keep")
    request = ProcessRequest.model_validate({"run_id": "r", "files": sent, **stated})
    # The path does not need the first joint, which is slow: the correction needs 0.004 rad/s on one line
    slow = robot.with_speeds(np.array([speed, 0.1, 0.1, 0.1, 0.1, 0.1]))
    result = ProcessWork(slow, "robot", run, request).conclude(())
    blended = [each for each in result.remarks if "the correction changes over" in each]
    named = [each for each in result.assessment.reasons if each.code == "too_fast"]
    assert max(result.speed_shares) < 0.5
    assert (bool(blended), bool(named)) == (is_blended, is_named)
    if is_named:
        assert "at 50 mm/s the corrected path needs" in named[0].message
        assert "force that changes over a length" in named[0].remedy
        assert result.assessment.verdict == "use_with_care"
