"""Words that people write for those of the API."""

import pytest
from typer.testing import CliRunner

import jointstiff as js
from jointstiff.schemas.options import METHODS_IN_SHORT
from jointstiff.service.cli.app import app
from jointstiff.service.cli.fields import _make_word_parser
from jointstiff.service.cli.options import UnknownWordError, _parse_unit
from jointstiff.simulator import default_arm, simulate_campaign

CAMPAIGN = simulate_campaign(default_arm(), configurations=12, load="pull")


@pytest.mark.parametrize(("short", "method"), [*METHODS_IN_SHORT.items(), ("dpp", "decoupled_partial_pose")])
def test_the_papers_abbreviations_are_taken_for_the_methods(short, method):
    assert js.identify(CAMPAIGN, method=short).request.method == method
    assert _make_word_parser(list(METHODS_IN_SHORT.values()))(short) == method


@pytest.mark.parametrize(("field", "word", "accepted"), [("encoders", "motors", "'motor' or 'secondary'")])
def test_another_word_is_answered_with_those_that_are_accepted(field, word, accepted):
    document = CAMPAIGN | {"measurement_set": CAMPAIGN["measurement_set"] | {field: word}}
    with pytest.raises(js.CampaignError, match=accepted) as refused:
        js.identify(document)
    assert "`secondary` if by encoders behind the gearboxes" in refused.value.problem.errors[0].remedy


def test_hyphens_stand_for_underlines_at_the_terminal():
    assert _make_word_parser(["same_as_measured", "off"])("same-as-measured") == "same_as_measured"
    with pytest.raises(UnknownWordError, match="'on' is not one of 'same_as_measured', 'off'"):
        _make_word_parser(["same_as_measured", "off"])("on")


@pytest.mark.parametrize("command", ["identify", "compare", "post"])
def test_units_are_shown_as_they_are_spelt(command):
    shown = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "100"}).output
    assert "--unit <MNm/rad|Nm/arcmin>" in shown
    refused = CliRunner().invoke(app, [command, __file__, "--unit", "furlong"]).output
    assert "'MNm/rad', 'Nm/arcmin'" in " ".join(refused.split())


def test_a_unit_is_understood_in_any_case():
    assert _parse_unit("mnm/RAD") == "MNm/rad"
