"""What a comparison draws of two campaigns: observations are a pair only in one posture under one load."""

import copy
import json

import pytest

import jointstiff as js
from jointstiff.service.kinds.comparison.kind import make_charts
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.files import example_files


@pytest.fixture(scope="module")
def campaign():
    return simulate_campaign_of(seed=3)


def simulate_campaign_of(**options):
    return simulate_campaign(default_arm(), configurations=12, load="pull", **options)


def paired(first, second):
    """Return the observations in the figure of both sides; none where there is no such figure."""
    both = [
        chart
        for chart in make_charts(js.compare(first, second, methods=[]).result)
        if "both sides" in chart.title
    ]
    return [str(label) for chart in both for label in chart.names]


def test_only_observations_of_one_posture_and_load_are_drawn_as_a_pair(campaign):
    other = copy.deepcopy(campaign)
    observations = other["measurement_set"]["observations"]
    observations[0]["joints"][1] += 0.01
    observations[1]["force"] = [1.1 * part for part in observations[1]["force"]]
    labels = [each["label"] for each in observations]
    assert paired(campaign, campaign) == labels
    assert paired(campaign, other) == labels[2:]


def test_labels_alone_make_no_pair(campaign):
    assert paired(campaign, simulate_campaign_of(seed=4)) == []


def test_the_example_campaigns_of_motor_and_secondary_encoders_share_their_postures():
    texts = dict(example_files())
    first, second = (json.loads(texts[f"{name}.json"]) for name in ("motor", "secondary"))
    assert len(paired(first, second)) == len(first["measurement_set"]["observations"])
    one, two = (
        each["measurement_set"]["observations"][0]["readings"][0]["unloaded"] for each in (first, second)
    )
    assert one != two  # each has noise of its own
