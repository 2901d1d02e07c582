"""Refusals of a campaign name the observation by its label, and the section of the file that it is in."""

import copy
import re

import pytest
from support.api import post
from support.terminal import terminal

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.own_weight import unloaded_campaign

CAMPAIGN = simulate_campaign(default_arm(), configurations=19, load="pull", seed=3)


def observation(document, index):
    return document["measurement_set"]["observations"][index]


def without_loaded(document):
    del observation(document, 2)["readings"][0]["loaded"]


def with_one_target(document):
    del observation(document, 2)["readings"][1:]
    document["run"] = {"method": "complete_pose"}


def with_five_joints(document):
    observation(document, 2)["joints"].pop()


def without_load_point(document):
    del document["measurement_set"]["load_point"]
    for each in document["measurement_set"]["observations"]:
        each["load_point"] = [0.0, 0.0, 0.1]
    del observation(document, 2)["load_point"]


def with_noise_of_some(document):
    for each in document["measurement_set"]["observations"]:
        for reading in each["readings"]:
            reading["sigma"] = 2e-5
    del document["measurement_set"]["noise"]
    for reading in observation(document, 2)["readings"]:
        del reading["sigma"]


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (without_loaded, "readings"),
        (with_one_target, "readings"),
        (with_five_joints, "joints"),
        (without_load_point, "load_point"),
        (with_noise_of_some, "readings"),
    ],
)
def test_a_refusal_names_observation_and_section(client, change, field):
    document = copy.deepcopy(CAMPAIGN)
    change(document)
    label = observation(document, 2)["label"]
    answer = post(client, "/v1/campaigns", document, 422)
    with pytest.raises(js.CampaignError) as refused:
        js.identify(document)
    for problem in (answer, refused.value.problem.model_dump()):
        assert problem["where"] == f"measurement_set.observations[2].{field}"
        assert f"'{label}'" in problem["detail"]


def test_one_reading_without_its_loaded_position_is_counted(client):
    document = copy.deepcopy(CAMPAIGN)
    without_loaded(document)
    detail = post(client, "/v1/campaigns", document, 422)["detail"]
    assert detail == "observations[2] 'c03', target P10: `loaded` is missing (1 of 57 readings)"


def test_positions_with_and_without_load_are_identified_by_the_own_weight():
    document = copy.deepcopy(CAMPAIGN)
    without_loaded(document)
    document["robot"]["bodies"] = unloaded_campaign(default_arm())["robot"]["bodies"]
    assert js.identify(document, weight={}).state == "succeeded"


def test_a_refusal_at_the_terminal_names_no_option_that_the_command_lacks(tmp_path):
    document = copy.deepcopy(CAMPAIGN)
    without_loaded(document)
    path = tmp_path / "campaign.json"
    path.write_text(js.Campaign.model_validate(document).model_dump_json(exclude_none=True))
    shown = terminal("identify", path)
    assert shown.exit_code == 2
    assert "c03" in shown.stderr
    assert "`weight` in the run" in " ".join(shown.stderr.split())
    assert not re.search(r"--weight\b", shown.stderr)
