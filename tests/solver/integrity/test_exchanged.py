"""Targets with exchanged unloaded and loaded readings in all rows are named; in clean sets none is named."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import only_deflections, prepare, simulated

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.solver.integrity import inspect_measurements
from jointstiff.solver.integrity.exchanged import exchange_targets

NAMES = ("P10", "P11", "P12")


def inspect(robot, measurements):
    return inspect_measurements(robot, measurements, degrees=False)


def name_exchanged(robot, measurements):
    """Return the targets that each finding of an exchange advises to exchange; None if it has no action."""
    return [
        each.action and tuple(each.action.targets)
        for each in inspect(robot, measurements)
        if "exchanged in all observations" in each.message
    ]


@pytest.mark.parametrize("exchanged", [("P10",), ("P11",), ("P10", "P12")])
@pytest.mark.parametrize("sigma", [None, 2e-5])
@pytest.mark.parametrize("kind", ["positions", "deflections"])
def test_the_exchanged_targets_alone_are_named_and_nothing_else(exchanged, sigma, kind):
    """Two of three targets leave one distance of three unchanged, as one target does."""
    robot, clean = simulated(load="pull", configurations=12, seed=3)
    measurements = replace(clean if kind == "positions" else only_deflections(clean), sigma=sigma)
    mistaken = exchange_targets(measurements, np.isin(NAMES, exchanged))
    (found,) = inspect(robot, mistaken)
    assert (found.code, found.weight) == ("deflection_against_force", "do_not_use")
    assert (found.action.kind, tuple(found.action.targets)) == ("exchange_readings", exchanged)
    assert inspect(robot, exchange_targets(mistaken, np.isin(NAMES, exchanged))) == []


def test_the_finding_states_the_scatter_of_the_distances_before_and_after():
    robot, clean = simulated(load="pull", configurations=12, seed=3)
    mistaken = exchange_targets(replace(clean, sigma=None), np.isin(NAMES, "P10"))
    (found,) = inspect(robot, mistaken)
    assert found.message == (
        "the unloaded and the loaded readings of 'P10' are exchanged in all observations: distances to the "
        "other targets "
        "scatter by 1.61 mm, and after the exchange by 19.6 µm"
    )
    assert found.remedy == "exchange the unloaded and the loaded readings of 'P10'"


def test_of_two_targets_the_load_decides_which_is_exchanged():
    """Their one distance is the same whichever is exchanged; springs yield to the load in one case only."""
    robot, clean = simulated(load="dead_weight", configurations=12, seed=3)
    fields = {
        name: getattr(clean, name)[:, :2] for name in ("position", "deflection", "in_flange", "present")
    }
    two = replace(clean, sigma=None, targets=NAMES[:2], **fields)
    for exchanged in ("P10", "P11"):
        mistaken = exchange_targets(two, np.isin(NAMES[:2], exchanged))
        assert name_exchanged(robot, mistaken) == [(exchanged,)]
    # Without a load nothing decides, so that a person has to.
    at_rest = replace(mistaken, force=np.zeros_like(mistaken.force), moment=np.zeros_like(mistaken.moment))
    assert name_exchanged(robot, at_rest) == [None]


@pytest.mark.parametrize("seed", range(12))
def test_no_clean_set_is_named_even_if_one_target_is_inaccurate(seed):
    """Small deflections, few rows, a real robot's links, and a target with fifty times the noise."""
    random = np.random.default_rng(seed)
    sigma, force, factor = random.choice([5e-6, 2e-5, 1e-4]), random.choice([100.0, 1500.0]), 50.0
    arm = with_link_errors(default_arm(), length=3e-4, angle=np.radians(0.02), seed=seed)
    options = {"configurations": 4 + 2 * seed, "sigma": float(sigma), "force": float(force)}
    robot, clean = prepare(
        simulate_campaign(arm, load=["pull", "dead_weight"][seed % 2], seed=seed, **options)
    )
    unloaded, loaded = factor * sigma * random.standard_normal((2, len(clean), 3))
    position, deflection = clean.position.copy(), clean.deflection.copy()
    position[:, seed % 3] += unloaded
    deflection[:, seed % 3] += loaded - unloaded
    inaccurate = replace(clean, sigma=None, position=position, deflection=deflection)
    for measurements in (clean, replace(clean, sigma=None), only_deflections(clean), inaccurate):
        assert name_exchanged(robot, measurements) == []


def test_a_mistaken_row_does_not_hide_the_exchange():
    robot, clean = simulated(load="pull", configurations=12, seed=3)
    position = clean.position.copy()
    position[4, 2] += 0.004
    mistaken = exchange_targets(replace(clean, sigma=None, position=position), np.isin(NAMES, "P10"))
    codes = {(each.code, each.observation) for each in inspect(robot, mistaken)}
    assert {("deflection_against_force", None), ("targets_not_rigid", "c05")} <= codes
