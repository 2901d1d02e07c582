"""Loads in another order than the readings are named; loads in their own rows never are."""

import json

import numpy as np
import pytest

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign


def find_orders(document):
    """Return the findings on the order of the rows."""
    run = js.identify(document)
    return [each for each in run.result.assessment.reasons if each.code == "observations_out_of_order"]


def permute_forces(document, order):
    changed = json.loads(json.dumps(document))
    rows = document["measurement_set"]["observations"]
    for row, other in zip(changed["measurement_set"]["observations"], order, strict=True):
        row["force"] = rows[other]["force"]
    return changed


def list_forces(document):
    return np.array([row["force"] for row in document["measurement_set"]["observations"]])


@pytest.fixture(scope="module", params=[1, 2, 3])
def campaign(request):
    return simulate_campaign(default_arm(), load="pull", configurations=14, seed=request.param)


ORDERS = {
    "sorted by size": lambda force: np.argsort(np.linalg.norm(force, axis=1)),
    "belong to other rows": lambda force: np.random.default_rng(5).permutation(len(force)),
}


@pytest.mark.parametrize("words", ORDERS)
def test_forces_in_another_order_are_named(campaign, words):
    (finding,) = find_orders(permute_forces(campaign, ORDERS[words](list_forces(campaign))))
    assert (words in finding.message, finding.weight) == (True, "do_not_use"), finding.message
    assert finding.remedy.startswith("match the forces with the observations again, row by row")


def test_two_exchanged_forces_are_named_by_their_rows(campaign):
    force = list_forces(campaign)
    first, second = 0, int(np.linalg.norm(force - force[0], axis=1).argmax())
    order = np.arange(len(force))
    order[[first, second]] = second, first
    labels = [row["label"] for row in campaign["measurement_set"]["observations"]]
    (finding,) = find_orders(permute_forces(campaign, order))
    assert f"'{labels[first]}' fits the force of '{labels[second]}'" in finding.message


def test_forces_in_their_rows_are_not_accused(campaign):
    assert find_orders(campaign) == []


def test_readings_that_no_order_of_the_forces_explains_are_not_accused(campaign):
    """Deflections of unrelated rows and axes: the best of all orders leaves too much."""
    changed = json.loads(json.dumps(campaign))
    random = np.random.default_rng(4)
    for row in changed["measurement_set"]["observations"]:
        for reading in row["readings"]:
            turned = random.permutation(np.subtract(reading["loaded"], reading["unloaded"]))
            reading["loaded"] = [*np.add(reading["unloaded"], turned * random.choice([-1, 1], 3))]
    assert find_orders(changed) == []


def label_rows(document, labels):
    changed = json.loads(json.dumps(document))
    for row, label in zip(changed["measurement_set"]["observations"], labels, strict=True):
        row["label"] = label
    return changed


@pytest.mark.parametrize(
    ("rows_by", "forces_by", "words"),
    [
        ("number", "text", "sorted as text"),
        ("text", "number", "by their numbers"),
    ],
)
def test_forces_in_the_order_of_sorted_labels_are_matched_by_label(campaign, rows_by, forces_by, words):
    numbered = [f"c{i}" for i in range(1, 15)]
    orders = {"number": numbered, "text": sorted(numbered)}
    labels = orders[rows_by]
    campaign = label_rows(campaign, labels)
    force_of = dict(zip(labels, list_forces(campaign).tolist(), strict=True))
    mistaken = permute_forces(campaign, [labels.index(label) for label in orders[forces_by]])
    (finding,) = find_orders(mistaken)
    assert words in finding.message
    assert finding.remedy.startswith("match the forces with the observations by label, not by position")
    posted = dict(zip(orders[forces_by], list_forces(mistaken).tolist(), strict=True))
    assert posted == force_of  # the remedy: each label gets its own force
    assert find_orders(campaign) == []


def test_a_shift_that_an_order_beats_is_not_proposed(campaign):
    """Labels without numbers: most rows are three rows late, as after sorting by another name."""
    order = [0, *range(10, 14), *range(1, 10)]
    (finding,) = find_orders(permute_forces(campaign, order))
    assert "shifted" not in finding.message
    assert "in another order" in finding.message


@pytest.mark.parametrize("shift", [-1, 2])
def test_forces_late_by_some_rows_are_still_a_shift(campaign, shift):
    order = np.roll(np.arange(14), shift)
    (finding,) = find_orders(permute_forces(campaign, order))
    assert finding.message.startswith("the forces are shifted by")
