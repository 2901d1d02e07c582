"""Campaigns by own weight with a mistake in their positions: the cause is named, not the masses."""

import numpy as np
import pytest

import jointstiff
from jointstiff.simulator import default_arm
from jointstiff.simulator.own_weight import unloaded_campaign


def reasons_of(change, **weight):
    """Return codes and messages of the run of a campaign whose observations were changed, and its verdict."""
    document = unloaded_campaign(default_arm(), configurations=20, seed=3)
    change(document["measurement_set"]["observations"])
    document["run"]["weight"] = weight
    job = jointstiff.identify(document)
    if job.result is None:
        return "failed", [job.error.detail]
    assessment = job.result.assessment
    return assessment.verdict, [f"{reason.code}: {reason.message}" for reason in assessment.reasons]


def positions_in_inches(observations):
    for reading in (each for observation in observations for each in observation["readings"]):
        reading["unloaded"] = (np.array(reading["unloaded"]) / 25.4).tolist()


def turned_frame(observations):
    for reading in (each for observation in observations for each in observation["readings"]):
        x, y, z = reading["unloaded"]
        reading["unloaded"] = [y + 2.0, -x, z]


def left_handed_frame(observations):
    for reading in (each for observation in observations for each in observation["readings"]):
        x, y, z = reading["unloaded"]
        reading["unloaded"] = [y + 2000.0, x, z]


def exchanged_axes(observations):
    for reading in (each for observation in observations for each in observation["readings"]):
        reading["unloaded"].reverse()


def test_lengths_in_another_unit_are_the_only_reason():
    verdict, (reason,) = reasons_of(positions_in_inches)
    assert verdict in ("do_not_use", "failed")
    assert "the lengths seem to be in inch" in reason


def test_another_frame_is_named_unless_gravity_is_estimated():
    verdict, (reason,) = reasons_of(turned_frame)
    assert (verdict, "the positions are not in R0" in reason) == ("do_not_use", True)
    _, reasons = reasons_of(turned_frame, estimate_gravity=True)
    assert not [reason for reason in reasons if "R0" in reason]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (left_handed_frame, "the positions are in a left-handed frame"),
        (
            exchanged_axes,
            "the axes of the positions are exchanged: x, y, z of R0 are z, y, x of the readings",
        ),
    ],
)
def test_a_left_handed_frame_is_named_even_if_gravity_is_estimated(change, words):
    """No direction of gravity makes a frame right-handed."""
    verdict, (reason,) = reasons_of(change, estimate_gravity=True)
    assert verdict in ("do_not_use", "failed")
    assert words in reason
