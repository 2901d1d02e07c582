"""Readings after the load was removed: a spring comes back, a set remains, and both readings count."""

from dataclasses import replace

import numpy as np
import pytest
from support.springs import SIGMA, SpringCampaign, robot_of

from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.solver.evidence.unloading import compare_unloaded_positions
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import ISOTROPIC_DIFFERENCE, ReturnReadings
from jointstiff.solver.run import run

ARM = default_arm()
ROBOT = robot_of(ARM)


def read(*, remains=0.0, again=1.0, seed=0, configurations=16):
    """Readings before, under and after the load; a share `remains`, a part of the postures is read again."""
    campaign = SpringCampaign.of(ARM, configurations=configurations, seed=seed)
    (first,) = campaign.measured(1, seed=seed, sigma=SIGMA)
    exact = campaign.loaded - campaign.unloaded
    generator = np.random.default_rng([seed, 1])
    noise = SIGMA * generator.standard_normal((3, *exact.shape))
    present = np.broadcast_to(generator.random((len(exact), 1)) < again, exact.shape[:2]).copy()
    before, loaded, after = noise[0], exact + noise[1], remains * exact + noise[2]
    unloaded = np.where(present[..., None], 0.5 * (before + after), before)
    return replace(
        first,
        deflection=loaded - unloaded,
        covariance=np.where(present[..., None, None], 0.75, 1.0) * ISOTROPIC_DIFFERENCE,
        returned=ReturnReadings(np.where(present[..., None], after - before, 0.0), present),
        sigma=SIGMA,
    )


def test_the_share_that_remains_is_found_within_its_uncertainty():
    errors = []
    for seed in range(60):
        measurements = read(remains=0.05, seed=seed)
        found = compare_unloaded_positions(Rows(ROBOT, measurements), ARM.compliances)
        errors.append((found.share - 0.05) / found.standard_uncertainty)
        assert found.remains
    # Student's t with 15 degrees of freedom has a standard deviation of 1.07.
    assert np.std(errors) == pytest.approx(1.07, rel=0.3)


def test_springs_come_back():
    found = [compare_unloaded_positions(Rows(ROBOT, read(seed=seed)), ARM.compliances) for seed in range(40)]
    assert not any(each.remains for each in found)
    # The distance of two positions with three coordinates is √6 σ.
    assert np.median([each.distance for each in found]) == pytest.approx(np.sqrt(6.0) * SIGMA, rel=0.05)


def test_a_run_names_a_set_and_says_how_well_targets_come_back():
    with_set = run(ROBOT, read(remains=0.06), RunOptions()).assessment
    assert [reason.code for reason in with_set.reasons] == ["deflection_remains"]
    assert with_set.verdict == "use_with_care"
    without = run(ROBOT, read(), RunOptions()).assessment
    assert without.verdict == "use"
    assert any(note.startswith("After unloading, the targets return to within 4") for note in without.notes)


def test_two_unloaded_readings_make_intervals_narrower_and_hold_the_truth():
    held, ratios = [], []
    for seed in range(20):
        twice = run(ROBOT, read(seed=seed), RunOptions()).joints
        once = run(ROBOT, read(seed=seed, again=0.0), RunOptions()).joints
        for joint, plain, truth in zip(twice, once, ARM.compliances, strict=True):
            held.append(joint.compliance_interval[0] <= truth <= joint.compliance_interval[1])
            ratios.append(joint.standard_uncertainty / plain.standard_uncertainty)
    assert np.mean(held) > 0.9
    # Without statements the variance falls to three quarters.
    assert np.median(ratios) == pytest.approx(np.sqrt(0.75), rel=0.05)


def test_a_part_of_the_postures_may_be_read_again():
    measurements = read(remains=0.06, again=0.4, configurations=24)
    found = compare_unloaded_positions(Rows(ROBOT, measurements), ARM.compliances)
    assert found.postures == int(measurements.returned.present[:, 0].sum()) < 24
    assert found.remains
