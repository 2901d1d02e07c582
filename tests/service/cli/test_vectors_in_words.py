"""Numbers of a vector that a shell splits into several words, and words that need an explanation."""

import pytest
from support.command_lines import refused, typed

VECTORS = {
    "--force 0 300 -500": "--force 0,300,-500",
    "--force -1 0, -5e2": "--force -1,0,-5e2",
    "--force 0 -300,-500": "--force 0,-300,-500",
    "--load-point 0 0 120.5": "--load-point 0,0,120.5",
    "--start 10 -5 10 5 45 3": "--start 10,-5,10,5,45,3",
    "--spindle 0 0 -1": "--spindle 0,0,-1",
}


@pytest.mark.parametrize("vector", VECTORS)
def test_a_vector_in_several_words_is_answered_by_one_word(vector):
    answer = refused(f"correct pull.json path.src -o out.src {vector}")
    assert answer.endswith(f"the numbers are one text, with commas and without blanks: {VECTORS[vector]}")
    assert "one text" not in refused(f"correct pull.json path.src -o out.src {VECTORS[vector]}")


def test_a_named_vector_and_a_quoted_vector():
    answer = refused("import a.csv --flange-target P1=0, 0, 120")
    assert answer.endswith("--flange-target P1=0,0,120")
    assert "one text" not in refused("correct pull.json path.src -o out.src --start '10 -5 10 5 45 3'")


def test_an_option_behind_a_vector_is_no_part_of_the_vector():
    answer = refused("plan robot.json --target P10=147,55,50 --load-point=-60,20,180")
    assert "one text" not in answer


def test_words_of_a_choice_are_explained():
    assert "'absolute' is not one of 'motor', 'secondary'" in refused("import a.csv --encoders absolute")
    assert "`covariance`: by their uncertainty" in refused("identify a.json --weighting weights")
    assert typed("robots").strip()
