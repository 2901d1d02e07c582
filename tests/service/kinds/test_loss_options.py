"""Robust loss, complementary stiffness and errors that all observations share, as a user states them."""

import numpy as np
import pytest
from pydantic import ValidationError

import jointstiff
from jointstiff.schemas.measurement import Noise
from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture(scope="module")
def document():
    """A dead weight, and a target that was bumped in one observation."""
    simulated = simulate_campaign(default_arm(), load="dead_weight", seed=2)
    simulated["measurement_set"]["observations"][4]["readings"][1]["loaded"][2] -= 2e-3
    return simulated


def test_readings_without_a_balance_are_identified_without_it():
    """Deflections a thousand times too large: joints as soft as they say would not carry the load."""
    wrong = simulate_campaign(default_arm(), load="pull", seed=2)
    for observation in wrong["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            moved = np.subtract(reading["loaded"], reading["unloaded"])
            reading["loaded"] = (reading["unloaded"] + 1e3 * moved).tolist()
    found = jointstiff.identify(wrong, elasticity="joints").result
    size = found.complementary_stiffness
    assert (size.included, size.iterations) == (False, 0)
    (reason,) = (each for each in found.assessment.reasons if each.code == "complementary_stiffness_matters")
    assert "had to be neglected: there is no equilibrium" in reason.message
    assert "units" in reason.remedy
    assert found.assessment.verdict == "do_not_use"
    assert "include_complementary_stiffness" not in {
        reason.action.kind for reason in found.assessment.reasons if reason.action
    }


def identified(noise, **options):
    document = simulate_campaign(default_arm(), configurations=8, load="pull", **options)
    document["measurement_set"]["noise"] = noise
    return jointstiff.identify(document)


ALL = {
    "sigma": 2e-5,
    "force": {"scale": 0.01, "direction": 0.002},
    "load_point": 5e-4,
    "target_places": 5e-4,
    "axes": {"position": 1e-4, "direction": 1e-4},
}


def test_each_source_is_named_and_all_add_up():
    result = identified(ALL).result
    budget = result.budget
    assert [(part.source, part.evaluation) for part in budget.components if part.included] == [
        ("readings", "B"),
        ("force_scale", "B"),
        ("force_direction", "B"),
        ("load_point", "B"),
        ("target_places", "B"),
        ("axes", "B"),
    ]
    assert budget.missing == []
    beyond = {part.source: part for part in budget.components if not part.included}
    assert set(beyond) == {"model_error"}
    assert beyond["model_error"].degrees_of_freedom == 7
    for j, joint in enumerate(result.joints):
        parts = [part.contributions[j] ** 2 for part in budget.components if part.included]
        assert sum(parts) == pytest.approx(joint.standard_uncertainty**2, rel=1e-9)
        assert budget.expanded_uncertainty[j] == pytest.approx(
            1.959964 * joint.standard_uncertainty, rel=1e-6
        )
        own = joint.budget.model_dump().values()
        assert sum(value**2 for value in own) == pytest.approx(joint.standard_uncertainty**2, rel=1e-9)


def test_a_stated_direction_of_the_force_says_nothing_of_its_size():
    sources = {part.source for part in identified({"force": {"direction": 0.002}}).result.budget.components}
    assert sources >= {"assumed_force_scale", "force_direction"}


def test_lengths_are_in_the_units_of_the_set():
    places = {"load_point": 0.5, "target_places": 0.5, "axes": {"position": 0.1, "direction": 1e-4}}
    metres = identified(ALL).result.budget
    in_mm = {"length": "mm", "angle": "rad", "force": "N"}
    millimetres = identified(ALL | {"sigma": 0.02} | places, units=in_mm).result.budget
    for one, other in zip(metres.components, millimetres.components, strict=True):
        assert one.contributions == pytest.approx(other.contributions, rel=1e-6)


def test_intervals_hold_the_truth_where_the_load_point_is_10_mm_off():
    """In each of twelve directions at random; without the assumption most of joint 6 would miss."""
    arm, generator = default_arm(), np.random.default_rng(6)
    inside = by_readings = count = 0
    for seed in range(12):
        document = simulate_campaign(arm, configurations=19, load="pull", seed=seed)
        moved = document["measurement_set"]["load_point"] + 0.01 * generator.standard_normal(3)
        document["measurement_set"]["load_point"] = moved.tolist()
        for joint, truth in zip(
            jointstiff.identify(document, elasticity="joints").result.joints, arm.compliances, strict=True
        ):
            low, high = joint.compliance_interval
            count += 1
            inside += low <= truth <= high
            by_readings += abs(joint.compliance - truth) <= 1.96 * joint.budget.readings
    assert inside >= 0.93 * count
    assert by_readings < 0.8 * count


WRONG = [
    *({"force": force} for force in ({}, {"scale": 0.6}, {"scale": -0.1}, {"direction": 1.0})),
    {"axes": {}},
    {"axes": {"direction": 1.0}},
    {"load_point": 0.0},
    {"target_places": -1.0},
]


@pytest.mark.parametrize("noise", WRONG)
def test_no_such_uncertainty(noise):
    with pytest.raises(ValidationError):
        Noise.model_validate(noise)
