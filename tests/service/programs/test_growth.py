"""Time to read hostile lines grows in proportion to their length."""

import gc
import time
from contextlib import suppress

import pytest
from support.repeated_words import patterns_of, repeated_in, text_of

from jointstiff.service.programs import fanuc, krl, rapid, ur
from jointstiff.service.programs.language import Misread

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
