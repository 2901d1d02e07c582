"""Programs in the forms of people: how many moves to numbers are known as sent, and after one question.

The shares are printed by

    python -m benchmarks shares
"""

import pytest
from program_support.program_forms import LANGUAGES, judge, read_forms

LEAST = {"krl": (0.7, 0.9), "rapid": (0.9, 0.95), "urscript": (0.65, 0.8), "fanuc": (0.4, 0.6)}
"""Least share of the moves to numbers that are known as sent, and after the question."""


@pytest.mark.parametrize("language", LANGUAGES)
def test_there_are_enough_programs_and_moves(language):
    forms = list(read_forms(language))
    assert len(forms) >= 20
    assert sum(len(form.truth) for form in forms) >= 300


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("trust_routines", [False, True])
def test_moves_to_numbers_are_known_and_none_of_them_wrongly(language, trust_routines):
    judgements = [judge(form, trust_routines=trust_routines) for form in read_forms(language)]
    assert [each for judgement in judgements for each in judgement.wrong] == []
    count = sum(len(each.literal) for each in judgements)
    known = sum(len(each.known) for each in judgements)
    assert known >= LEAST[language][trust_routines] * count
