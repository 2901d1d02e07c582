# ruff: noqa: E501  # fragments of a language a line
"""Every motion word of mutated programs is accounted for; statements are in constructs/."""

import random
import re
from collections import Counter
from pathlib import Path

import pytest

from robotprograms.errors import ProgramError
from robotprograms.formats import read_program

POINT = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
P = "p[0.1,0.2,0.3,0,0,0]"
ROB = "[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
KINDS = {"krl": "src", "rapid": "mod", "fanuc": "LS", "ur": "script"}

MOTIONS = {
    "krl": r"\b(?:S?PTP|S?LIN|S?CIRC|SPL)(?:_REL)?\b",
    "rapid": r"\b(?:Move(?:[LJC](?:DO|Sync)?|AbsJ|ExtJ)|Trigg[LJC])\b",
    "fanuc": r"(?m)(?:^[ \t]*\d*[ \t]*:[ \t]*|(?<=[ ;]))[JLCAS][ \t]+PR?\[",
    "ur": r"\b(?:movej|movel|movep|movec)\b",
}


def without_comments(kind, text):
    """The text with blanks in place of comments and texts, by patterns of their own."""
    hidden = {
        "krl": r'"[^"\n]*"|;[^\n]*',
        "rapid": r'"[^"\n]*"|![^\n]*',
        "fanuc": r"'[^'\n]*'|:[ \t]*(?:!|//|--)[^\n]*",
        "ur": r'"[^"\n]*"|#[^\n]*',
    }
    return re.sub(hidden[kind], lambda found: " " * len(found[0]), text)


def motion_lines(kind, text):
    """The line of each motion word outside of comments and texts."""
    plain = without_comments(kind, text)
    if kind == "fanuc":
        plain = plain.partition("/POS")[0]
    flags = re.IGNORECASE if kind in {"krl", "rapid"} else 0
    return [plain.count("\n", 0, found.start()) + 1 for found in re.finditer(MOTIONS[kind], plain, flags)]


FRAGMENTS = {
    "krl": [f"LIN {POINT}", "LIN P1", "PTP HOME", "IF x THEN", "ENDIF", "LOOP", ";", '"', "x=1", "C_DIS", "\n", "LIN_REL {X 1}"],
    "rapid": [f"MoveL {ROB},v1,z1,t1;", "MoveJ p20,v1,z1,t1;", "IF n=1 THEN", "ENDIF", "ELSE", ";", '"', "!", "\n", "CASE 1:"],
    "fanuc": ["L P[1] 50mm/sec FINE", "   9:J P[2] 5% FINE ;", "!", "'", "\n", ";", "C P[1]", ":", "  9:  CALL X ;", "RTCP"],
    "ur": [f"movel({P})", "movej(p1)", "if x:", "end", "#", '"', "\n", "movel(p9)", "x = 1", "set_tcp(p1)"],
}  # fmt: skip


def mutated(draw, kind, text):
    """A text with pieces taken out, put in, doubled or exchanged."""
    for _ in range(draw.randint(1, 4)):
        a, b = sorted(draw.randrange(len(text)) for _ in range(2))
        b = min(b, a + 80)
        piece = draw.choice([*FRAGMENTS[kind], text[a:b], "", " ", draw.choice("()[]{},;:=\\\"'#!")])
        text = draw.choice([text[:a] + piece + text[b:], text[:a] + piece + text[a:], text[:a] + text[b:]])
    return text


def motions_found(name, program):
    """Lines of the moves that are corrected, kept or left; the refusal, if the whole text is not understood."""
    try:
        read = read_program([(name, program.encode())], leave_others=True)
    except ProgramError as refused:
        return [left.line for left in refused.left_moves], None if refused.left_moves else refused.faults
    kept = [remark.line for remark in read.left_alone if "stored in the controller" in remark.text]
    return [*read.moves.line.tolist(), *kept, *(left.line for left in read.left_moves)], ()


@pytest.mark.parametrize("count", [150, pytest.param(2_500, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_each_motion_word_is_read_or_refused(kind, count):
    """Mutated programs in each of four languages: no motion word outside of comments and texts is passed over."""
    frame = (Path(__file__).parent / "samples" / f"frame.{KINDS[kind]}").read_text()
    text = "".join(line for line in frame.splitlines(keepends=True) if not set(line) & set("…§"))
    draw, read = random.Random(27), 0  # noqa: S311
    for _ in range(count):
        program = mutated(draw, kind, text)
        lines, refusal = motions_found(f"a.{KINDS[kind]}", program)
        if refusal:
            continue  # the text is not understood: nothing of it is taken
        read += refusal == ()
        missing = Counter(motion_lines(kind, program)) - Counter(lines)
        assert not missing, program
    assert read > count // 25  # or the mutations show nothing


@pytest.mark.parametrize(
    ("target", "certain"),
    [
        (f"pose_trans({P},{P})", True),
        (f"pose_trans({P},pose_trans({P},{P}))", False),
        (f"pose_trans({P},{P},{P})", False),
        (f"pose_trans({P})", False),
    ],
)
def test_a_target_in_a_frame_is_certain_where_both_are_numbers(target, certain):
    program = f"def a():\nset_tcp({P})\nmovel({target})\nend\n"
    assert motions_found("a.script", program) == ([3], () if certain else None)
