"""Time to read hostile lines grows in proportion to their length."""

import cProfile
import gc
import time
from contextlib import suppress

import pytest
from program_support.repeated_words import patterns_of, repeated_in, text_of

from robotprograms import fanuc, krl, rapid, ur
from robotprograms.formats import read_program
from robotprograms.language import Misread

MOST = 2.5
"""Greatest ratio of times at twice as many repetitions."""
ENDS = ("\x7f", " X", "WITHX")


def seconds(language, shape):
    begin = time.process_time()
    with suppress(Misread):
        language.translate(shape)
    return time.process_time() - begin


def growth(language, before, part, end):
    """Return the ratio of times at 2n repetitions over n, the least of some: noise only adds."""
    count = 100
    while seconds(language, text_of(before, part, count, end)) < 0.02 and count * len(part) < 50_000:
        count *= 2
    least = float("inf")
    for repeats in (1, 3, 9):
        short, long = (
            min(seconds(language, text_of(before, part, n, end)) for _ in range(repeats))
            for n in (count, 2 * count)
        )
        least = min(least, long / max(short, 5e-3))
        if least <= MOST:
            break
    return least


@pytest.mark.timeout(20)  # what grew with the cube took hours
def test_a_move_with_very_many_words_of_approximate_positioning_is_read():
    assert seconds(krl.LANGUAGE, "LIN {X \0}" + " C_DIS" * 20_000 + " WITHX") > 0.0


MOVES = ("LIN {X \0}", "LIN XP1", "SPLINE")
"""Beginnings of statements whose rest functions of the rules divide, not the rules themselves."""
REPEATED = (" C_DIS", "WITH ", ",", ",$V=1 C_DIS")


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("part", REPEATED)
def test_twice_the_words_behind_a_move_take_at_most_two_and_a_half_times_as_long(part):
    """Behind the target, and in the settings after WITH."""
    begins = [move + behind for move in MOVES for behind in ("", " WITH $V=1")]
    gc.disable()
    try:
        found = {
            (begin, end): growth(krl.LANGUAGE, begin, part, end) for begin in begins for end in ("", "WITHX")
        }
    finally:
        gc.enable()
    assert {case: ratio for case, ratio in found.items() if ratio > MOST} == {}


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("module", [krl, fanuc, rapid, ur], ids=lambda module: module.__name__)
def test_twice_each_repeatable_word_of_every_rule_takes_at_most_two_and_a_half_times_as_long(module):
    """Each part that a rule of the language repeats, behind what the rule matches before it."""
    rules = [pattern for name, pattern in patterns_of([module]).items() if "rule" in name]
    assert len(rules) >= len(module.LANGUAGE.rules)
    gc.disable()
    try:
        found = {
            (before, part, end): growth(module.LANGUAGE, before, part, end)
            for pattern in rules
            for before, part in repeated_in(pattern)
            for end in ENDS
        }
    finally:
        gc.enable()
    assert {case: ratio for case, ratio in found.items() if ratio > MOST} == {}
    assert len(found) > 20


POINT = "[[500,0,500],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
PLACE = "{X 500,Y 0,Z 500,A 0,B 0,C 0}"
WHOLE = {
    "RAPID: counters and branches in routines with handlers of errors": (
        "m.mod",
        "MODULE m\nPROC main()\nENDPROC\n",
        f"VAR num v#:=0;\nPROC r#()\nMoveL {POINT},v1,z1,tool0;\nv#:=v#+1;\nIF v#>3 THEN\nIncr v#;\nENDIF\n"
        "ERROR\nRETRY;\nENDPROC\n",
        "ENDMODULE",
    ),
    "RAPID: counters in one routine with a handler of errors": (
        "m.mod",
        "MODULE m\nPROC main()\n",
        f"v#:=0;\nMoveL {POINT},v1,z1,tool0;\n",
        "ERROR\nRETRY;\nENDPROC\nENDMODULE",
    ),
    "RAPID: branches with calls of unknown routines": (
        "m.mod",
        "MODULE m\nPROC main()\n",
        f"v#:=1;\nMoveL {POINT},v1,z1,tool0;\nIF v#=1 THEN\nGripper;\nENDIF\n",
        "ENDPROC\nENDMODULE",
    ),
    "RAPID: routines that call each other": (
        "m.mod",
        "MODULE m\nPROC main()\nENDPROC\n",
        f"PROC r#()\nv#:=1;\nMoveL {POINT},v1,z1,tool0;\nr@;\nENDPROC\n",
        "ENDMODULE",
    ),
    "KRL: counters, calls and an interrupt": (
        "m.src",
        "DEF m()\nINTERRUPT DECL 3 WHEN $IN[1] DO S()\nINTERRUPT ON 3\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n",
        f"LIN {PLACE}\nV#=1\nIF V#==1 THEN\nGLUE()\nENDIF\n",
        "END\nDEF S()\nRESUME\nEND\n",
    ),
    "RAPID: a point assigned in each routine with a handler of errors": (
        "m.mod",
        "MODULE m\nPROC main()\nENDPROC\n",
        f"PROC r#()\np#:={POINT};\nMoveL p#,v1,z1,tool0;\nERROR\nRETRY;\nENDPROC\n",
        "ENDMODULE",
    ),
    "RAPID: points assigned in one routine with a handler of errors": (
        "m.mod",
        "MODULE m\nPROC main()\n",
        f"p#:={POINT};\nMoveL p#,v1,z1,tool0;\n",
        "ERROR\nRETRY;\nENDPROC\nENDMODULE",
    ),
    "RAPID: points assigned in branches": (
        "m.mod",
        "MODULE m\nPROC main()\n",
        f"IF x THEN\np#:={POINT};\nMoveL p#,v1,z1,tool0;\nENDIF\n",
        "ENDPROC\nENDMODULE",
    ),
    "KRL: points assigned, and an interrupt": (
        "m.src",
        "DEF m()\nINTERRUPT DECL 3 WHEN $IN[1] DO S()\nINTERRUPT ON 3\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n",
        f"P#={PLACE}\nLIN P#\n",
        "END\nDEF S()\nRESUME\nEND\n",
    ),
    "URScript: counters and branches": (
        "m.script",
        "def m():\nset_tcp(p[0,0,0.1,0,0,0])\n",
        "v#=1\nif v#==1:\nmovel(p[0.5,0,0.5,0,0,0])\ngrip()\nend\n",
        "end\n",
    ),
}


def text_of_parts(shape, count):
    """Return the text of a program with a part as often as stated."""
    _, head, part, end = shape
    parts = [part.replace("#", str(i)).replace("@", str(i + 1)) for i in range(1000, 1000 + count)]
    return head + "".join(parts) + end


def steps_to_read(name, text):
    """Return the number of Python's function calls, those of functions in C included, and the moves."""
    profile = cProfile.Profile()
    profile.enable()
    program = read_program([(name, text.encode())], leave_others=True)
    profile.disable()
    count = len(program.moves) + len(program.left_moves)
    return sum(entry.callcount for entry in profile.getstats()), count


@pytest.mark.parametrize("title", WHOLE)
def test_twice_the_lines_take_twice_the_steps(title):
    """Calls of functions are counted, not seconds: a state has no names that nothing reads."""
    name = WHOLE[title][0]
    steps_to_read(name, text_of_parts(WHOLE[title], 2))  # what is made once
    short, long = (steps_to_read(name, text_of_parts(WHOLE[title], count)) for count in (50, 100))
    assert (short[1], long[1]) == (50, 100)
    assert long[0] <= 2.2 * short[0]


CALLED = {
    "RAPID": (
        "m.mod",
        "MODULE m\nPROC main()\n",
        "r#;\n",
        f"PROC r#()\np#:={POINT};\nMoveL p#,v1,z1,tool0;\nERROR\nRETRY;\nENDPROC\n",
        "ENDPROC\n",
        "ENDMODULE",
    ),
    "KRL": (
        "m.src",
        "DEF m()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n",
        "r#()\n",
        f"DEF r#()\nP#={PLACE}\nLIN P#\nEND\n",
        "END\n",
        "",
    ),
}
"""Name of the file, head, call, routine, end of the head, and end."""


@pytest.mark.parametrize("title", CALLED)
def test_twice_the_routines_called_in_turn_take_twice_the_steps(title):
    name, head, call, routine, end_of_head, end = CALLED[title]
    found = []
    for count in (2, 50, 100):
        numbers = [str(i) for i in range(1000, 1000 + count)]
        calls = "".join(call.replace("#", number) for number in numbers)
        routines = "".join(routine.replace("#", number) for number in numbers)
        found.append(steps_to_read(name, f"{head}{calls}{end_of_head}{routines}{end}"))
    assert [moves for _, moves in found] == [2, 50, 100]
    assert found[2][0] <= 2.2 * found[1][0]
