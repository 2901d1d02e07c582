"""Programs come back as they were written, but for numbers; hostile ones are refused in few words."""

from pathlib import Path
from random import Random

import numpy as np
import pytest
from program_support.rotations import rotation_about, rotation_of_angles
from program_support.written_programs import moves_of, rewritten, targets_of

from robotprograms import columns
from robotprograms.errors import ProgramError
from robotprograms.formats import FORMATS, read_program
from robotprograms.notation import Notation, Orientation, format_new_numbers

PROGRAMS = {
    "krl": (["cell.src", "cell.dat"], ["SPINDLE_ON"]),
    "fanuc": (["CELL.LS"], ["SPINDLE_OFF"]),
    "rapid": (["cell.mod"], []),
    "ur": (["cell.script"], []),
    "csv": (["cell.csv"], []),
}


def files_of(kind):
    return [(name, (Path(__file__).parent / "samples" / name).read_bytes()) for name in PROGRAMS[kind][0]]


def read(kind):
    return read_program(files_of(kind), leave_alone=PROGRAMS[kind][1])


def refusal(name, content, **options):
    with pytest.raises(ProgramError) as caught:
        read_program([(name, content.encode("latin-1"))], **options)
    return caught.value


def test_every_format_has_a_sample():
    assert set(PROGRAMS) == set(FORMATS)


@pytest.mark.parametrize("kind", PROGRAMS)
def test_identity_gives_identical_bytes(kind):
    program = read(kind)
    files = rewritten(program, np.arange(len(program.targets)), program.targets.values[:, :7])[0]
    assert dict(zip([s.name for s in program.sources], files, strict=True)) == dict(files_of(kind))


@pytest.mark.parametrize("kind", PROGRAMS)
def test_nothing_but_numbers_of_targets_changes(kind):
    program = read(kind)
    step = 0.125 * (np.arange(7) < 3)  # a quaternion has to stay a unit one
    moved = program.targets.values[:, :7] + step
    files, values = rewritten(program, np.arange(len(moved)), moved)
    again = read_program(
        list(zip([s.name for s in program.sources], files, strict=True)), leave_alone=PROGRAMS[kind][1]
    )
    np.testing.assert_array_equal(again.targets.values[:, :7], values)
    for i, new in enumerate(targets_of(again)):
        np.testing.assert_allclose(new.values, moved[i, : len(new.values)], rtol=0, atol=1e-9)
    for source, other in zip(program.sources, again.sources, strict=True):
        assert without_numbers(program, source) == without_numbers(again, other)


def without_numbers(program, source):
    index = program.sources.index(source)
    spans = sorted(
        span
        for target in targets_of(program)
        if target.source == index
        for span in zip(target.spans[::2], target.spans[1::2], strict=True)
    )
    text = source.text
    for start, end in reversed(spans):
        text = text[:start] + text[end:]
    return text


def krl(p):
    return "LIN {{X {:.3f},Y {:.3f},Z {:.3f},A {:.3f},B {:.3f},C {:.3f}}} C_DIS".format(*p)


def ur(p):
    values = [*(x / 1000 for x in p[:3]), *np.radians(p[3:])]
    return "movel(p[{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f}], a=1, v=0.1)".format(*values)


def draw_programs(line, comment):
    """Yield 300 texts of up to eight moves, each with a comment of any characters but line ends and NUL."""
    draw = Random(5)  # noqa: S311
    characters = [chr(code) for code in range(1, 256) if chr(code) not in "\n\r"]
    for _ in range(300):
        targets = [[draw.uniform(-3000, 3000) for _ in range(3)] for _ in range(draw.randint(1, 8))]
        notes = ["".join(draw.choices(characters, k=draw.randint(0, 40))) for _ in targets]
        poses = [[*target, *(draw.uniform(-180, 180) for _ in range(3))] for target in targets]
        lines = [part for p, note in zip(poses, notes, strict=True) for part in (line(p), comment + note)]
        end = draw.choice(["\n", "\r\n"])
        yield end.join(lines) + end, len(targets)


@pytest.mark.parametrize(("name", "line", "comment"), [("a.src", krl, ";"), ("a.script", ur, "#")])
def test_any_bytes_in_comments_survive(name, line, comment):
    for text, count in draw_programs(line, comment):
        content = text.encode("latin-1")
        program = read_program([(name, content)])
        assert len(program.targets) == count
        values, every = program.targets.values[:, :7], np.arange(count)
        assert rewritten(program, every, values)[0][0] == content
        moved = rewritten(program, every, values + (np.arange(7) < 3))[0][0]
        assert moved.count(comment.encode()) == content.count(comment.encode())


@pytest.mark.parametrize(("kind", "order"), [("krl", [3, 4, 5]), ("fanuc", [5, 4, 3])])
@pytest.mark.parametrize("middle", [0.0, 37.0, 90.0, -90.0, 89.9999])
def test_angles_are_rewritten_near_what_was_written(kind, order, middle):
    """A small rotation of a target changes its angles little, away from the lock, and is exact everywhere."""
    notation = next(n for n in read(kind).targets.notations if n.has_pose)
    near = np.array([[100.0, 0, 0, 175.0, middle, -178.0]])
    poses = notation.to_poses(near)
    np.testing.assert_allclose(poses[0, :3, :3], rotation_of_angles(near[0, order]), atol=1e-15)
    poses[0, :3, :3] = rotation_about([1e-4, -2e-4, 5e-5]) @ poses[0, :3, :3]
    new = notation.from_poses(poses, near)
    np.testing.assert_allclose(notation.to_poses(new), poses, atol=1e-8)
    if abs(middle) < 80:
        assert np.abs(new - near)[:, 3:].max() < 0.1


NEAR = {
    Orientation.EULER_ZYX: [[10.0, 20, 30], [-170, 100, 200], [380, -90, 15], [-100, 90, 40]],
    Orientation.FIXED_XYZ: [[10.0, 20, 30], [200, 100, -170], [15, -90, 380], [40, 90, -100]],
    Orientation.QUATERNION: [[0.6, 0, 0.8, 0], [-0.6, 0, -0.8, 0], [0.6003, 0, 0, -0.8004], [0, 0, 0, -1]],
    Orientation.ROTATION_VECTOR: [[0.0, 0, 0], [0, 216, 288], [0, -432, 576], [100, 20, 30], [0, 300, 150]],
}


@pytest.mark.parametrize("orientation", NEAR)
def test_an_unchanged_target_keeps_its_numbers_in_each_notation(orientation):
    """Numbers of no, one and two full turns, at the lock, of either sign and of a length beside 1."""
    near = np.array([[1.0, -2, 3, *each] for each in NEAR[orientation]])
    poses = Notation(orientation).to_poses(near)
    np.testing.assert_allclose(poses[:, :3, 3] * 1e3, near[:, :3])
    np.testing.assert_allclose(Notation(orientation).from_poses(poses, near), near, atol=1e-9)


WRITTEN = """1.000 1.0006 1.001, 1.000 0.9994 0.999, 1.000 -1 -1.000, 5.000 -0.0004 0.000, 5.000 0.0004 0.000,
-0.0002 0 0.0000, +1.5 2 +2.000, +1.5 -2 -2.000, 1.25e-1 0.126 0.126, 1.2345E+0 1.23456 1.2346, 7 8 8.000"""
KEPT = "1.000 1.0004 1.000, 0.000 -0.0004 0.000, -0.000 0.0004 0.000, 1.23456 1.234564 1.23456"


@pytest.mark.parametrize(("cases", "changes"), [(WRITTEN, True), (KEPT, False)])
def test_a_number_is_written_with_its_digits_and_differs_where_they_do(cases, changes):
    """An old number, a new one, and what is written: three digits at least, no -0; one beside it has more."""
    for old, new, text in (case.split() for case in cases.split(",")):
        line = f"12.3456789 {old}"
        spans = np.array([(0, 10), (11, len(line))], dtype=np.int32)
        signs, read = np.frombuffer(line.encode(), dtype=np.uint8), np.array(line.split(), dtype=float)
        texts, differ = format_new_numbers(signs, spans, np.array([0.5, float(new)]), read, np.array([3, 3]))
        assert (texts, differ[1]) == (["0.5000000", text], changes)


UNITS = {"mm mm mm ° ° °": (1e-3, np.pi / 180, 6, 9), "m m m rad rad rad": (1.0, 1.0, 9, 9)}
OTHERS = ("mm mm m ° ° °", "mm mm mm ° rad °", "mm mm ° ° ° °", "mm mm mm ° mm °")


@pytest.mark.parametrize("units", [*UNITS, *OTHERS])
def test_columns_of_a_table_have_one_unit_for_each_quantity(units):
    header = ";".join(map("{} [{}]".format, "xyzabc", units.split()))
    text = f"# a remark\n{header}\n1;2;3;4;5;6\n"
    if units in OTHERS:
        fault = refusal("a.csv", text).faults[0]
        assert (fault.line, "different units" in fault.reason) == (2, True)
        return
    (one,) = read_program([("a.csv", text.encode("latin-1"))]).targets.notations
    found = one.length, one.angle, one.length_decimals, one.angle_decimals
    assert found == pytest.approx(UNITS[units])
    assert "same name" in refusal("a.csv", text.replace("y [", "x [")).faults[0].reason


FREE_FRAMES = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]"
LIN = "LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}"
SHARE = 10
"""Part of the limit that a large file has here."""
BIG = 10 * 1024 * 1024 // SHARE
PLACE = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
HOSTILE = {
    "one letter": "A" * BIG,
    "braces": "{" * BIG,
    "line ends": "\n" * BIG,
    "all bytes": bytes(range(1, 256)).decode("latin-1") * (400 // SHARE),
    "deep folds": ";FOLD x\n" * (100_000 // SHARE),
    "deep braces": "LIN " + "{A " * 1000 + "\n",
    "deep loops": "LOOP\n" * (50_000 // SHARE) + f"LIN {PLACE}\n",
    "NaN": PLACE.replace("1", "NaN"),
    "huge number": "LIN " + PLACE.replace("1", "1e999"),
    "long number": "LIN " + PLACE.replace("1", "1" * 3000),
    "unclosed": f"LIN {PLACE[:-1]}\n" * (5000 // SHARE),
    "relative": "LIN_REL {X 1}\n" * (10_000 // SHARE),
    "variables": "LIN P1\n" * (10_000 // SHARE),
    "brackets": "[" * (BIG // 2),
    "quotes": '"' * 4000 + "\n" + "[1,2,'" * 600,
}
EVERYWHERE = ("all bytes", "brackets", "quotes", "relative")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        *(("a.src", content) for content in HOSTILE.values()),
        *((name, HOSTILE[each]) for name in ("a.LS", "a.mod", "a.script", "a.csv") for each in EVERYWHERE),
    ],
    ids=lambda text: text[:8].strip(),
)
def test_hostile_programs_are_refused_in_few_words(name, content):
    error = refusal(name, content)
    assert len(str(error).encode()) < 8000


@pytest.mark.timeout(30)
@pytest.mark.parametrize("name", ["a.src", "a.LS", "a.mod", "a.script", "a.csv"])
@pytest.mark.parametrize(
    ("piece", "count"), [("\n", 300_000), (" " * 4000 + "\n", 100), ("$\n", 50_000), ("PROC a(", 500)]
)
def test_large_files_of_nothing_are_refused_soon(name, piece, count):
    """Each of these took minutes once: a pattern that began anew on each line."""
    error = refusal(name, piece * (count // SHARE) + "\n")
    assert len(str(error)) < 8000


def test_many_routines_and_names_are_followed_soon():
    """2,000 routines that call one another, or are called in turn; 2,000 branches over as many names."""
    count = 2000 // SHARE
    some = range(count)
    chain = (
        "r0()\nEND\n"
        + "".join(f"DEF r{i}()\n{LIN}\nr{i + 1}()\nEND\n" for i in some)
        + f"DEF r{count}()\nEND"
    )
    turns = "".join(f"r{i}()\n" for i in some) + "END\n" + "".join(f"DEF r{i}()\n{LIN}\nEND\n" for i in some)
    names = "".join(f"P{i}={PLACE}\nIF x THEN\nLIN P{i}\nENDIF\n" for i in some) + "END"
    for body in (chain, turns, names):
        program = read_program([("a.src", f"DEF a()\n{FREE_FRAMES}\n{body}".encode())])
        assert len(program.moves) == count


@pytest.mark.parametrize("ending", ["WITH", "C_PTP", "C_DIS", "C_VEL", "C_ORI", "C_SPL"])
@pytest.mark.parametrize(
    "behind", ["", " C_DIS", " C_ORI C_DIS", " WITH $VEL.CP=NOWWITH", " WITH $VEL.CP=1 C_DIS"]
)
def test_a_name_that_ends_with_a_word_of_the_move_is_the_whole_name(ending, behind):
    """Another target has the name without the ending."""
    places = f"MY={PLACE}\nMY{ending}={PLACE.replace('X 1', 'X 7')}"
    text = f"DEF a()\n{FREE_FRAMES}\n{places}\nLIN MY{ending}{behind}\nEND"
    program = read_program([("a.src", text.encode())])
    (move,) = moves_of(program)
    (target,) = (targets_of(program)[i] for i in move.targets)
    assert (target.name, target.values[0], program.left_moves) == (f"MY{ending}", 7.0, ())


@pytest.mark.parametrize("loop", ["I=STO TO 5", "I=1 TO MYSTEP STEP 2", "I=1 TO STO STEP MYSTEP"])
def test_a_name_that_ends_with_a_word_of_the_loop_is_the_whole_name(loop):
    text = f"DEF a()\n{FREE_FRAMES}\nFOR {loop}\n{LIN}\nENDFOR\nEND"
    assert len(read_program([("a.src", text.encode())]).moves) == 1


@pytest.mark.parametrize(("most", "line"), [("MAX_VISITS", 5), ("MAX_REMARKS", 8)])
def test_a_small_file_cannot_ask_for_endless_work(monkeypatch, most, line):
    monkeypatch.setattr(columns, most, 2)
    text = f"DEF a()\nP1={PLACE}\n" + 3 * "LIN P1\n" + 3 * "s()\n" + "END"
    assert refusal("a.src", text, leave_alone=["s"]).faults[0].line == line


@pytest.mark.parametrize("kind", ["krl", "fanuc", "rapid", "ur"])
@pytest.mark.parametrize("stated", ["krl", "fanuc", "rapid", "ur"])
def test_a_program_of_another_language_is_named_with_its_suffix(kind, stated):
    if kind == stated:
        return
    (_, content), *_ = files_of(kind)
    name = f"cell{FORMATS[stated].suffixes.split()[0]}"
    with pytest.raises(ProgramError, match=r"the file is a program in .*, but was read as ") as refused:
        read_program([(name, content)])
    (fault,) = refused.value.faults
    suffix = FORMATS[kind].suffixes.split()[0]
    assert fault.remedy == f"give the file its own suffix, {suffix}, or state `format`: {kind}"
    routines = PROGRAMS[kind][1]
    files = [(name, content), *files_of(kind)[1:]]
    assert len(moves_of(read_program(files, kind, routines, leave_others=True))) > 0
