"""Programs that post-processors of CAD systems write are corrected whole, but for the controller's places."""

import re
from pathlib import Path

import pytest
from program_support.written_programs import moves_of, targets_of

from robotprograms.formats import read_program

POSTS = dict(
    post.split("\n", 1)
    for post in (Path(__file__).parent / "samples" / "posts.txt").read_text().split("=== ")[1:]
)
# Each has a joint move, lines to five points, an arc over two and a line to one: what differs is below.
KUKA = [0, -90, 90, 0, 10, 0], [(800 + x, -20.5 * x, 450, 0, 90, 0) for x in (0, 1, 2, 3, 4, 5, 5.5, 6)]
ABB = [0, 3.9, -14.7, 0, 14.3, 0], [(*point[:3], 0.5**0.5, 0, 0.5**0.5, 0) for point in KUKA[1]]
UR = (
    [-0.806066, -0.118249, -0.358652, 1.245933, 0.865461, -5.280451],
    [((point[0] - 400) / 1e3, point[1] / 1e3, 0.45, 2.221441, 2.221441, 0) for point in KUKA[1]],
)
PLACES = {
    "BASE": (0.801, -0.0205, 0.45),
    "TOOL": (0.802, -0.041, 0.45),
    "WOBJ": (0.807767, -0.9637, 0.041479),
    "TCP": (0.0625, -0.108253, 0.1),
    "zero": (0, 0, 0),
}
TCP = "active TCP of line {}"
WANTED = {
    "KUKA KRC2": (KUKA, [31, *range(56, 63)], ("$BASE of line 29", "BASE"), ("$TOOL of line 30", "TOOL")),
    "KUKA KRC4": (KUKA, [*range(29, 37)], ("$BASE of line 27", "BASE"), ("$TOOL of line 28", "TOOL")),
    "KUKA custom": (KUKA, [*range(39, 47)], ("$BASE of line 13", "BASE"), ("$TOOL of line 14", "TOOL")),
    "KUKA CamRob": (KUKA, [*range(15, 23)], ("BASE_DATA[2]", None), ("TOOL_DATA[1]", None)),
    "ABB IRC5": (ABB, [*range(17, 22), 28, 29, 30], ("rdkWObj", "WOBJ"), ("rdkTool", "TCP")),
    "ABB simplified": (ABB, [*range(17, 22), 28, 29, 30], ("rdkWObj", "WOBJ"), ("rdkTool", "TCP")),
    "ABB S4C": (ABB, [*range(15, 20), 26, 27, 28], ("rdkWObj", "zero"), ("rdkTool", "zero")),
    "ABB custom": (ABB, [*range(14, 19), 25, 26, 27], ("wobj_3", None), ("tool_7", None)),
    "UR": (UR, [13, *range(20, 27)], ("robot base", "zero"), (TCP.format(9), "TCP")),
    "UR with helpers": (UR, [38, *range(45, 52)], ("robot base", "zero"), (TCP.format(34), "TCP")),
    "UR movep": (UR, [13, *range(20, 27)], ("robot base", "zero"), (TCP.format(9), "TCP")),
    "UR sub-program": (UR, [17, *range(24, 31)], ("robot base", "zero"), (TCP.format(13), "TCP")),
}
KEPT = {
    "KUKA KRC2": [(27, "$AXIS_ACT")],
    "KUKA KRC4": [(25, "$AXIS_ACT")],
    "KUKA custom": [(47, "$AXIS_ACT")],
    "KUKA KRC2 with .dat": [(17, "XHOME")],
}


def read(post):
    _, *texts = re.split(r"^--- (.*)\n", POSTS[post], flags=re.MULTILINE)
    program = read_program(
        [(name, text.encode()) for name, text in zip(texts[::2], texts[1::2], strict=True)]
    )
    targets = targets_of(program)
    return program, moves_of(program), [targets[i] for move in moves_of(program) for i in move.targets]


def placed(frame):
    name = None if frame.pose is None else tuple(frame.pose[:3, 3].tolist())
    return frame.name, name


@pytest.mark.parametrize("post", POSTS)
def test_every_move_is_corrected_but_those_to_places_of_the_controller(post):
    program = read(post)[0]
    assert program.faults == program.left_moves == ()
    assert [(each.line, each.target) for each in program.left_alone] == KEPT.get(post, [])


@pytest.mark.parametrize("post", WANTED)
def test_moves_have_the_numbers_and_frames_of_the_program(post):
    (home, path), lines, base, tool = WANTED[post]
    _, moves, targets = read(post)
    assert [move.line for move in moves] == lines
    assert [move.motion.value for move in moves] == ["joint", *["linear"] * 5, "circular", "linear"]
    assert [each.values for each in targets] == [pytest.approx(each, abs=1e-6) for each in (home, *path)]
    for each in targets:
        for frame, (name, place) in ((each.base, base), (each.tool, tool)):
            assert placed(frame) == (name, place and pytest.approx(PLACES[place], abs=1e-6))


@pytest.mark.parametrize(
    ("post", "first", "lines"), [("KUKA KRC2 with .dat", 24, 8), ("KUKA KRC4 with .dat", 15, 8)]
)
def test_points_of_a_dat_file_have_their_lines_there_and_their_status_and_turn(post, first, lines):
    program, moves, targets = read(post)
    assert [move.line for move in moves] == [first + lines * i for i in range(7)]
    assert {move.motion.value for move in moves} == {"linear"}
    assert [(each.name, each.source, each.line) for each in targets] == [
        (f"XP{i}", 1, 5 + 3 * i) for i in range(7)
    ]
    points = [each for i, each in enumerate(KUKA[1]) if i != 6]
    assert [each.values for each in targets] == [pytest.approx(each) for each in points]
    assert {(each.base.name, each.tool.name) for each in targets} == {("BASE_DATA[2]", "TOOL_DATA[1]")}
    text = program.sources[1].text
    words = {tuple((name, text[start:end]) for name, start, end in each.words) for each in targets}
    assert words == {(("S", "'B010'"), ("T", "'B000010'"))}


def test_a_target_in_a_frame_of_ur_has_that_frame_and_an_arc_of_the_base_has_none():
    _, moves, targets = read("UR with a frame")
    assert [move.line for move in moves] == [14, *range(21, 28)]
    base, frame = ("robot base", (0, 0, 0)), ("ref_frame of line 8", pytest.approx((0.5, 0, 0.1)))
    assert [placed(each.base) for each in targets] == [base, *[frame] * 5, base, base, frame]
    assert [each.values for each in targets] == [pytest.approx(each, abs=1e-6) for each in (UR[0], *UR[1])]


def test_joint_moves_of_ur_have_their_angles():
    _, moves, targets = read("UR joints")
    assert [(move.line, move.motion.value) for move in moves] == [(n, "joint") for n in (13, *range(20, 27))]
    assert [each.values for each in targets[1:]] == [
        pytest.approx((0.01 * i, -1.57, 1.57, 0.1, 0.2, 0.3), abs=1e-9) for i in range(7)
    ]


def test_moves_of_fanuc_have_the_positions_that_they_name():
    _, moves, targets = read("FANUC")
    assert [move.line for move in moves] == [*range(11, 17), 18]
    assert [move.motion.value for move in moves] == [*["linear"] * 5, "circular", "linear"]
    numbers = [1, 3, 5, 7, 9, 11, 12, 13]
    assert [(each.name, each.line) for each in targets] == [(f"P[{n}]", 20 + 6 * n) for n in numbers]
    assert [each.values for each in targets] == [
        pytest.approx((800 + n, -20 * n, 450, 0, 90, 0)) for n in numbers
    ]
    assert {(each.base.name, each.tool.name, each.letters) for each in targets} == {("UF 1", "UT 2", "NUT")}
