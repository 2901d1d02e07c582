"""Commands in remedies are calls of functions in Python."""

import pytest

import jointstiff as js
from jointstiff.service.problems import name_functions_in_text


@pytest.mark.parametrize(
    ("command", "call"),
    [
        ("import FILE --robot ROBOT", "read(FILE, robot=ROBOT)"),
        ("plan 'KUKA KR 6.urdf'", "plan('KUKA KR 6.urdf')"),
        ("geometry FILE --save robot.json", "geometry(FILE).save('robot.json')"),
        ("geometry FILE --save", "geometry(FILE).save()"),
        ("map FILE --csv --plane xy", "map(FILE, csv=True, plane='xy')"),
        ("plan", "plan"),
    ],
)
def test_a_command_becomes_the_call_of_its_function(command, call):
    assert name_functions_in_text(f"use `jointstiff {command}` first") == f"use `jointstiff.{call}` first"


def test_words_that_are_no_command_line_stay():
    text = "use `jointstiff plan robot's.urdf`"
    assert name_functions_in_text(text) == text


def test_a_urdf_whose_name_has_blanks_is_named_by_a_call_that_works(tmp_path):
    path = tmp_path / "KUKA KR 6.urdf"
    path.write_text('<robot name="a"/>')
    with pytest.raises(js.CampaignError, match=f"jointstiff.plan\\('{path}'\\)"):
        js.identify(path)
