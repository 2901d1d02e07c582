"""Words that people write for those of the API."""

import pytest

import jointstiff as js
from jointstiff.schemas.options import METHODS_IN_SHORT
from jointstiff.service.cli.imports import _cells
from jointstiff.service.cli.kinds import _one_of
from jointstiff.simulator import default_arm, simulate_campaign

CAMPAIGN = simulate_campaign(default_arm(), configurations=12, load="pull")


@pytest.mark.parametrize(("short", "method"), [*METHODS_IN_SHORT.items(), ("dpp", "decoupled_partial_pose")])
def test_the_papers_abbreviations_are_taken_for_the_methods(short, method):
    assert js.identify(CAMPAIGN, method=short).request.method == method
    assert _one_of(list(METHODS_IN_SHORT.values()))(short) == method


@pytest.mark.parametrize(("field", "word", "accepted"), [("encoders", "motors", "'motor' or 'secondary'")])
def test_another_word_is_answered_with_those_that_are_accepted(field, word, accepted):
    document = CAMPAIGN | {"measurement_set": CAMPAIGN["measurement_set"] | {field: word}}
    with pytest.raises(js.CampaignError, match=accepted) as refused:
        js.identify(document)
    assert "words named" in refused.value.problem.errors[0].remedy


def test_hyphens_stand_for_underlines_at_the_terminal():
    assert _one_of(["same_as_measured", "off"])("same-as-measured") == "same_as_measured"
    with pytest.raises(ValueError, match="'on' is not one of 'same_as_measured', 'off'"):
        _one_of(["same_as_measured", "off"])("on")


@pytest.mark.parametrize(
    "text", ["group;point;x;y;z", "group, point, x, y, z", "group\tpoint\tx\ty\tz", "group point x y z"]
)
def test_a_header_is_split_as_its_file_is(text):
    assert _cells(text) == ["group", "point", "x", "y", "z"]
