"""What a comparison draws of two campaigns: observations are a pair only in one posture under one load."""

import copy
import json

import pytest
from support.readings import with_encoders

import jointstiff as js
from jointstiff.service.kinds.comparison.kind import make_charts
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.files import example_files


@pytest.fixture(scope="module")
def campaign():
    return simulate_campaign_of(seed=3)


def simulate_campaign_of(**options):
    return simulate_campaign(default_arm(), configurations=12, load="pull", **options)


def read_again(campaign):
    """Return the campaign with loaded readings that are 1 µm elsewhere, as no two readings are equal."""
    again = copy.deepcopy(campaign)
    for observation in again["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            reading["loaded"][0] += 1e-6
    return again


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
    assert paired(campaign, read_again(campaign)) == labels
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


def with_gearboxes_read(motor, secondary):
    """Return pulls by both loops; encoders of joints 1 to 3 read what the second loop removes."""
    first = with_encoders(motor, simulate_campaign(motor, load="pull", seed=5), joints=(0, 1, 2))
    part = 1.0 - secondary.compliances / motor.compliances
    for observation in first["measurement_set"]["observations"]:
        for reading, share in zip(observation["encoder_readings"], part[:3], strict=True):
            reading["loaded"] = reading["unloaded"] + share * (reading["loaded"] - reading["unloaded"])
    return first, simulate_campaign(secondary, load="pull", seed=5, noise_seed=6, encoders="secondary")


def test_encoders_that_close_the_other_loop_give_gearbox_and_structure():
    motor, secondary = default_arm("motor"), default_arm("secondary")
    comparison = js.compare(*with_gearboxes_read(motor, secondary), methods=[])
    names = ["joint_1", "joint_2", "joint_3"]
    truth = {"gearboxes": motor.compliances - secondary.compliances, "structures": secondary.compliances}
    for field, compliances in truth.items():
        parts = getattr(comparison.result, field)
        assert [part.name for part in parts] == names
        for part, c in zip(parts, compliances.tolist(), strict=False):
            assert part.compliance_interval[0] <= c <= part.compliance_interval[1]
    assert "Gearbox and structure apart" in comparison.summary()
    alone = js.compare(simulate_campaign_of(seed=3), simulate_campaign_of(seed=3, noise_seed=1), methods=[])
    assert alone.result.gearboxes == alone.result.structures == []


def test_an_encoder_that_does_not_show_what_the_loop_removes_is_a_reason():
    first, second = with_gearboxes_read(default_arm("motor"), default_arm("secondary"))
    for observation in first["measurement_set"]["observations"]:
        reading = observation["encoder_readings"][1]
        reading["loaded"] = reading["unloaded"] + 0.6 * (reading["loaded"] - reading["unloaded"])
    assessment = js.compare(first, second, methods=[]).result.assessment
    (reason,) = [each for each in assessment.reasons if each.code == "encoder_against_difference"]
    assert reason.where == "joint_2"
    assert reason.message.startswith(
        "the encoder of joint_2 shows less deflection than the encoders in the loop"
    )
    assert assessment.verdict == "use_with_care"
