"""What is stated of loads counts in a fit by own weight, too."""

from dataclasses import replace

import numpy as np
import pytest
from support.sagging import ARM, BODIES, LOAD_POINT, POINTS, burden_of, campaign, state_loads
from support.springs import readings_of

from jointstiff.simulator import deflections, random_configurations
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.mechanics.measurements import CommonUncertainty
from jointstiff.solver.own_weight.estimate import identify_weight

OF_POSITIONS = {
    "load_point": (1e-6, 5e-2),
    "scale": (1e-5, 5e-2),
    "direction": (1e-6, 2e-2),
    "drift": (1e-9, 1e-4),
}
"""A small and a large standard uncertainty of each statement, in its SI unit."""
OF_DEFLECTIONS = OF_POSITIONS | {
    "target_places": (1e-6, 5e-2),
    "axis_position": (1e-6, 2e-2),
    "axis_direction": (1e-6, 2e-2),
}
POSTURES = 10
PAYLOAD = 80.0


def hung(seed=0, off=(0.0, 0.0, 0.0), **stated):
    """Positions without and with a load whose point is stated wrong, with what is stated of the load."""
    readings = campaign(postures=POSTURES, payload=PAYLOAD, seed=seed, stated=burden_of(BODIES, 0.05))
    moved = replace(readings, load_point=readings.load_point + off)
    return state_loads(moved, CommonUncertainty(**stated))


def pushed(**stated):
    """Deflections by known loads."""
    q = random_configurations(ARM, POSTURES, seed=9)
    force = np.random.default_rng(3).standard_normal((POSTURES, 3)) * 800.0
    before, after = deflections(ARM, q, force, np.zeros((POSTURES, 3)), LOAD_POINT, POINTS)
    noise = 3e-5 * np.sqrt(2.0) * np.random.default_rng(4).standard_normal(before.shape)
    return readings_of(
        q,
        force,
        LOAD_POINT,
        before,
        after - before + noise,
        sigma=3e-5,
        common_uncertainty=CommonUncertainty(**stated),
    )


def widths(estimate):
    ends = np.array([joint.compliance_interval or (np.nan, np.nan) for joint in estimate.joints])
    return ends[:, 1] - ends[:, 0]


def widest_change(compute, statements):
    """Return the largest relative change of an interval's width by each statement's large uncertainty."""
    small = {name: uncertainties[0] for name, uncertainties in statements.items()}
    exact = widths(compute(small))
    changes = {}
    for name, (_, large) in statements.items():
        changes[name] = np.nanmax(np.abs(widths(compute(small | {name: large})) / exact - 1.0))
    return changes


def test_each_statement_on_the_load_of_positions_counts():
    def compute(stated):
        return identify_weight(hung(**stated))

    changes = widest_change(compute, OF_POSITIONS)
    assert min(changes.values()) > 1e-3, changes


def test_each_statement_on_deflections_counts():
    unloaded = campaign(postures=POSTURES, stated=burden_of(BODIES, 0.1))
    changes = widest_change(
        lambda stated: identify_weight(replace(unloaded, loaded=pushed(**stated))), OF_DEFLECTIONS
    )
    assert min(changes.values()) > 1e-3, changes


def test_loads_of_positions_and_of_deflections_have_one_uncertainty():
    readings = hung(load_point=0.02)
    assert replace(readings, loaded=pushed(load_point=0.02)).common_uncertainty.load_point == 0.02
    with pytest.raises(MeasurementError, match="have different stated uncertainties"):
        replace(readings, loaded=pushed(load_point=0.01))


@pytest.mark.slow
def test_a_load_point_off_by_what_is_stated_leaves_intervals_that_contain_the_truth():
    held = {True: [], False: []}
    for seed in range(12):
        off = 0.02 * np.random.default_rng(seed).standard_normal(3)
        readings = hung(seed, off, load_point=0.02)
        for counts in held:
            found = identify_weight(readings if counts else replace(readings, stated=None))
            for joint, truth in zip(found.joints, ARM.compliances, strict=True):
                if joint.compliance_interval is not None:
                    least, most = joint.compliance_interval
                    held[counts].append(least <= truth <= most)
    assert np.mean(held[True]) > 0.92
    assert np.mean(held[False]) < np.mean(held[True])


def test_residuals_are_those_after_the_fitted_error_of_the_load():
    readings = hung(off=(0.03, 0.0, 0.0), load_point=0.03)
    with_statement = identify_weight(readings)
    left = with_statement.residual[readings.poses.present]
    assert np.sqrt(np.square(left).mean()) < 1.2 * 3e-5
