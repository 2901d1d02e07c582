"""Names of arms of the catalogue that are not clear."""

import pytest

from jointstiff.service.conversion.catalogue import find_arm
from jointstiff.solver.errors import RequestError

ADVICE = "`jointstiff robots` and GET /v1/catalogue list its arms; or describe the arm by a DH table or URDF"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "IRB",
            "'IRB' is not the whole name of one arm of the catalogue; similar names: ABB IRB 6640-185/2.8, "
            f"ABB IRB 6700-200/2.60, ABB IRB 4600-60/2.05, ABB IRB 120-3/0.6; {ADVICE}",
        ),
        (
            "R10e",
            "'R10e' is not the whole name of one arm of the catalogue; similar names: Universal Robots "
            f"UR10e; {ADVICE}",
        ),
        ("", f"the catalogue has no arm ''; {ADVICE}"),
        ("/", f"the catalogue has no arm '/'; {ADVICE}"),
        ("💥", f"the catalogue has no arm '💥'; {ADVICE}"),
    ],
)
def test_an_unclear_name_is_answered_with_arms_that_are_meant(name, said):
    with pytest.raises(RequestError) as refused:
        find_arm(name, "model.arm")
    assert (refused.value.where, str(refused.value)) == ("model.arm", f"model.arm: {said}")


@pytest.mark.parametrize("name", ["IRB 6700-200", "KR 210", "M-20iD", "LR Mate", "TX2-9", "GP18"])
def test_a_name_without_the_digits_of_a_reach_is_not_chosen(name):
    with pytest.raises(RequestError):
        find_arm(name, "--robot")


@pytest.mark.parametrize(
    "name", ["UR1", "Robots UR", "R5", "LR Mate 200", "LR Mate 200i", "R-2000iC/165", "R10e"]
)
def test_a_part_of_a_word_is_not_chosen(name):
    with pytest.raises(RequestError):
        find_arm(name, "--robot")


@pytest.mark.parametrize(
    ("name", "whole"),
    [
        ("KUKA KR 210 R2700", "KUKA KR 210 R2700 extra"),
        ("ur5e", "Universal Robots UR5e"),
        ("irb 6700 200 2.60", "ABB IRB 6700-200/2.60"),
        ("LR Mate 200iD", "FANUC LR Mate 200iD"),
        ("kr6r900", "KUKA KR 6 R900 sixx"),
        ("UR 10e", "Universal Robots UR10e"),
    ],
)
def test_a_part_with_all_digits_names_its_arm(name, whole):
    assert find_arm(name, "--robot").name == whole


@pytest.mark.parametrize("name", ["UR3", "UR5", "UR10", "UR5e", "Universal Robots UR10"])
def test_a_whole_word_names_its_generation(name):
    assert find_arm(name, "--robot").name.split()[-1] == name.split()[-1]
